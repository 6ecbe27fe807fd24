"""Command lines of a shell, as far as they only make files from other files.

Launch files in YAML and XML have no other way to fill in a template: they start `sed`.
"""

import contextlib
import os
import re
import resource
import shlex
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

# What returns the text of a xacro file with arguments.
Expand = Callable[[str, Mapping[str, str]], str]

_SHELLS = (["bash", "-c"], ["sh", "-c"])

# Processor time of a pattern [s]: Python may search for ever what sed finds at once.
_TIME = 2.0

# A part of a shell's word that stands for nothing else, and what its text is made of.
_PART = (
    r"""[^\s|&;<>()$`\\"'*?\[\]#~!{}]|'[^']*'|"(?:[^"$`\\]|\\.)*"|\\[^\n]"""  # No "$x".
)
_TOKEN = re.compile(
    r"(?P<blank>(?:[ \t]|\\\n)+)|(?P<end>&&|;|\n)|(?P<into>(?<!\d)>)"
    rf"|(?P<word>(?:{_PART})(?:{_PART}|#)*)",
    re.DOTALL,
)

# What may stand between the parts of a substitution of sed.
_MARKS = "/|,#@!%:;~=_"

# What a pattern of sed is made of, without and with -E.
_BRACKET = r"\[\^?\]?(?:\[:\w+:\]|[^\]])*\]"
_BASIC = re.compile(rf"{_BRACKET}|\\{{\d{{1,3}}(?:,\d{{0,3}})?\\}}|\\.|.", re.DOTALL)
_EXTENDED = re.compile(rf"{_BRACKET}|{{\d{{1,3}}(?:,\d{{0,3}})?}}|\\.|.", re.DOTALL)

_CLASSES = {
    "[:alnum:]": "a-zA-Z0-9",
    "[:alpha:]": "a-zA-Z",
    "[:blank:]": r" \t",
    "[:digit:]": "0-9",
    "[:lower:]": "a-z",
    "[:space:]": r"\s",
    "[:upper:]": "A-Z",
}
_PLACES = {"<": r"\b(?=\w)", ">": r"\b(?<=\w)", "b": r"\b"}
_CONTROLS = {"n": "\n", "\n": "\n", "r": "\r", "t": "\t"}


class _Command(NamedTuple):
    """A program's words, and the file that its output goes into."""

    words: list[str]
    target: str | None = None


class _Rule(NamedTuple):
    """What sed puts in place of a pattern, once in a line or everywhere."""

    pattern: re.Pattern[str]
    replace: Callable[[re.Match[str]], str]
    is_global: bool

    def apply(self, line: str) -> str:
        """Return a line with it replaced."""
        found: list[str] = []
        at, end = 0, -1
        for match in self.pattern.finditer(line):
            # An empty match right after another one is none for sed.
            if match.start() == match.end() == end:
                continue
            found += [line[at : match.start()], self.replace(match)]
            at = end = match.end()
            if not self.is_global:
                break
        return "".join(found) + line[at:]


def split_command(text: str) -> list[str]:
    """Return a command's words; of a shell's, those of what `tee` only copies."""
    words = shlex.split(text)
    if not _is_shell(words):
        return words
    first, *copies = words[-1].replace("\\\n", " ").split("|")
    is_same = all(copy.split()[:1] == ["tee"] for copy in copies)
    return shlex.split(first) if is_same else words


def write_files(words: Sequence[str], expand: Expand) -> bool:
    """Do what a command does that only writes files made from others.

    Those of `cat`, `cp`, `mkdir`, `sed` and xacro, one after the other. Of all else
    nothing is done, and False is returned: also where a shell puts in values, and of
    patterns that Python reads in another way than sed.
    """
    try:
        own = [_Command(list(words))] if words else []
        commands = _commands(words[-1]) if _is_shell(words) else own
        made = [_read(command, expand) for command in commands]
        if None in made:
            return False
        for write in made:
            assert write is not None
            write()
    except (OSError, ValueError, re.error):
        return False
    return bool(made)


def _is_shell(words: Sequence[str]) -> bool:
    return [os.path.basename(word) for word in words[:-1]] in _SHELLS


def _commands(text: str) -> Iterator[_Command]:
    """Yield the commands of a shell's text, or raise ValueError."""
    words: list[str] = []
    targets: list[str] = []
    before, last, at = "\n", "\n", 0
    text = text.strip() + "\n"
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            raise ValueError(text)
        at, kind = token.end(), token.lastgroup or ""
        if kind == "word":
            (targets if before == "into" else words).append(_unquote(token[0]))
        elif kind != "blank" and before == "into":
            raise ValueError(text)
        elif kind == "end" and (words or targets):
            if not words or len(targets) > 1:
                raise ValueError(text)
            yield _Command(words, *targets)
            last, words, targets = token[0], [], []
        elif kind == "end" and token[0] != "\n":
            raise ValueError(text)
        before = kind if kind != "blank" else before
    if last == "&&":
        raise ValueError(text)


def _unquote(word: str) -> str:
    """Return a shell's word without its quotes."""

    def bare(part: re.Match[str]) -> str:
        text = part[0]
        if text[0] == '"':  # There a backslash is for these alone.
            return re.sub(r'\\(["\\$`])|\\\n', lambda m: m[1] or "", text[1:-1])
        if text[0] == "\\":
            return text[1:]
        return text[1:-1] if text[0] == "'" else text

    return re.sub(f"{_PART}|#", bare, word, flags=re.DOTALL)


def _read(command: _Command, expand: Expand) -> Callable[[], None] | None:
    """Return what does a command, None for one that isn't known."""
    (program, *words), target = command
    match os.path.basename(program), words:
        case ("xacro", _):
            return _read_xacro(words, target, expand)
        case ("sed", _):
            return _read_sed(words, target)
        case (_, [name, *_]) if name[:1] == "-" and name != "-p":
            return None
        case ("mkdir", ["-p", *folders]) if folders and target is None:
            return lambda: _make_folders(folders)
        case ("cp", [source, copy]) if target is None:
            return lambda: _copy(source, copy)
        case ("cat", [_, *_]) if target is not None:
            return lambda: _write(target, b"".join(_bytes(w, target) for w in words))
    return None


def _make_folders(names: Sequence[str]) -> None:
    for name in names:
        os.makedirs(name, exist_ok=True)


def _copy(source: str, copy: str) -> None:
    if os.path.isdir(copy):
        copy = os.path.join(copy, os.path.basename(source))
    _write(copy, _bytes(source, copy))


def _read_xacro(
    words: Sequence[str], target: str | None, expand: Expand
) -> Callable[[], None] | None:
    rest = list(words)
    if "-o" in rest[:-1] and target is None:
        at = rest.index("-o")
        target = rest[at + 1]
        del rest[at : at + 2]
    arguments = dict(word.split(":=", 1) for word in rest if ":=" in word)
    files = [word for word in rest if ":=" not in word]
    if target is None or len(files) != 1 or files[0].startswith("-"):
        return None
    return lambda: _write(target, expand(files[0], arguments).encode())


def _read_sed(words: Sequence[str], target: str | None) -> Callable[[], None] | None:
    scripts, names = [], []
    is_in_place = is_extended = False
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word in ("-e", "--expression") and rest:
            scripts.append(rest.pop(0))
        elif word in ("-i", "--in-place"):
            is_in_place = True
        elif word in ("-E", "-r"):
            is_extended = True
        elif word.startswith("-"):
            return None
        else:
            names.append(word)
    scripts = scripts or [names.pop(0) if names else ""]
    if len(names) != 1 or is_in_place == (target is not None):
        return None
    rules = [_read_rule(script, is_extended=is_extended) for script in scripts]
    (name,) = names

    def write() -> None:
        lines = _bytes(name, target).decode().split("\n")
        ending = [] if lines[-1] else [lines.pop()]
        with _limited():
            for rule in rules:
                lines = [rule.apply(line) for line in lines]
        _write(target or name, "\n".join(lines + ending).encode())

    return write


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    """Raise TimeoutError if something takes too long."""

    def end(*args: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, _TIME)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def _read_rule(script: str, *, is_extended: bool) -> _Rule:
    """Return what `s/.../.../g` says, or raise ValueError."""
    mark = script[1:2]
    part = rf"((?:[^\\{re.escape(mark)}]|\\.)*)"
    found = re.fullmatch(rf"s(.){part}\1{part}\1(g?)", script, re.DOTALL)
    if found is None or mark not in _MARKS:
        raise ValueError(script)
    old, new = (
        re.sub(r"\\(.)", lambda m: m[m[1] == mark], text, flags=re.DOTALL)
        for text in found.group(2, 3)
    )
    pattern = re.compile(_to_python(old, is_extended=is_extended), re.DOTALL)
    pieces = re.findall(r"\\.|[^\\]+", new, re.DOTALL)
    for piece in pieces:
        sign = piece[1:]
        if piece[0] != "\\":
            is_known = "\n" not in piece
        elif sign.isdigit():
            is_known = int(sign) <= pattern.groups
        else:
            is_known = not sign.isalnum() or sign in _CONTROLS
        if not is_known:
            raise ValueError(script)

    def replace(match: re.Match[str]) -> str:
        return "".join(
            piece.replace("&", match[0])
            if piece[0] != "\\"
            else match[int(piece[1])]
            if piece[1].isdigit()
            else _CONTROLS.get(piece[1], piece[1])
            for piece in pieces
        )

    return _Rule(pattern, replace, bool(found[4]))


def _to_python(text: str, *, is_extended: bool) -> str:
    """Return a pattern of sed as Python has it, or raise ValueError.

    One with choices or with groups that repeat is refused: sed finds the longest match
    of all, Python the first one, which it may search for ever.
    """
    made: list[str] = []
    can_repeat = False
    tokens = (_EXTENDED if is_extended else _BASIC).findall(text)
    for part, after in zip(tokens, [*tokens[1:], ""], strict=True):
        is_first = made[-1:] in ([], ["("])
        sign = part[1] if len(part) == 2 and part[0] == "\\" else part
        # With a backslash these are special in one of the two syntaxes alone.
        is_special = sign in "(){}+?|" and (sign == part) == is_extended
        is_interval = len(part) > 2 and part[0] != "["
        is_star = part == "*" and (is_extended or not (is_first or made[-1] == "^"))
        if is_star or is_interval or (is_special and sign in "+?"):
            if not can_repeat:
                raise ValueError(text)
            piece = part.replace("\\", "") if is_interval else sign
        elif is_special:
            if sign not in "()":
                raise ValueError(text)
            piece = sign
        elif part == "^" and (is_extended or is_first):
            piece = "^"
        elif part == "$" and (is_extended or after in ("", r"\)")):
            piece = r"\Z"
        else:
            made.append(_to_atom(part))
            can_repeat = not made[-1].startswith((r"\b", "(?:"))
            continue
        made, can_repeat = [*made, piece], False
    if not made:
        raise ValueError(text)
    return "".join(made)


def _to_atom(part: str) -> str:
    """Return what is one character of sed's, or a place, or what was found before."""
    if part == ".":
        return part
    if part[0] == "[" and len(part) > 1:
        return _to_set(part)
    if part[0] != "\\":
        if part == "[":
            raise ValueError(part)
        return re.escape(part)
    sign = part[1:]
    if sign in _PLACES:
        return _PLACES[sign]
    if sign in (*"wWsSnrt",):
        return part
    if sign in (*"123456789",):
        return f"(?:{part})"
    if sign.isalnum() or sign in ("", "`", "'", "\n"):
        raise ValueError(part)
    return re.escape(sign)


def _to_set(part: str) -> str:
    """Return a bracket expression as Python has it."""
    start, inside = ("[^", part[2:-1]) if part[1] == "^" else ("[", part[1:-1])
    made = [start]
    for piece in re.findall(r"\[:\w+:\]|\[[.=]|.", inside, re.DOTALL):
        if piece == "\\" or (len(piece) > 1 and piece not in _CLASSES):
            raise ValueError(part)
        made.append(
            _CLASSES.get(piece) or (piece if piece == "-" else re.escape(piece))
        )
    return "".join([*made, "]"])


def _bytes(name: str, target: str | None = None) -> bytes:
    """Return what a file holds; it must be one, and another than is written."""
    is_same = target is not None and os.path.abspath(target) == os.path.abspath(name)
    if is_same or not os.path.isfile(name):
        raise ValueError(name)
    with open(name, "rb") as file:
        return file.read()


def _write(name: str, data: bytes) -> None:
    is_other = os.path.exists(name) and not os.path.isfile(name)
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    if is_other or name.endswith(os.sep) or len(data) > limit >= 0:
        raise ValueError(name)
    with open(name, "wb") as file:
        file.write(data)
