"""Command lines of a shell, as far as they only make files from other files.

Launch files in YAML and XML have no other way to fill in a template: they start `sed`.
"""

import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence

# What returns the text of a xacro file with arguments.
Expand = Callable[[str, Mapping[str, str]], str]

_SHELLS = (["bash", "-c"], ["sh", "-c"])


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
    nothing is done, and False is returned.
    """
    text = words[-1] if _is_shell(words) else shlex.join(words)
    try:
        made = [_read(command, expand) for command in _commands(text)]
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


def _commands(text: str) -> Iterator[list[str]]:
    """Yield the words of the commands of a shell's line, redirections among them."""
    text = text.replace("\\\n", " ").strip().replace("\n", " ; ")
    lexer = shlex.shlex(text, posix=True, punctuation_chars=";<>|&")
    lexer.whitespace_split, lexer.commenters = True, ""
    command: list[str] = []
    for word in [*lexer, ";"]:
        if word not in (";", "&&"):
            command.append(word)
        elif command:
            yield command
            command = []


def _read(command: Sequence[str], expand: Expand) -> Callable[[], None] | None:
    """Return what does a command, None for one that isn't known."""
    program, *words = command
    target = None
    if words[-2:-1] == [">"]:
        target = words[-1]
        del words[-2:]
    if any(word and set(word) <= set("<>|&") for word in words):
        return None
    match os.path.basename(program), words:
        case ("mkdir", ["-p", folder]) if target is None:
            return lambda: os.makedirs(folder, exist_ok=True)
        case ("cp", [source, copy]) if target is None and not os.path.isdir(copy):
            return lambda: _write(copy, _text(source))
        case ("cat", [source]) if target is not None:
            return lambda: _write(target, _text(source))
        case ("sed", [*words]):
            return _read_sed(words, target)
        case ("xacro", [*words]):
            return _read_xacro(words, target, expand)
    return None


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
    return lambda: _write(target, expand(files[0], arguments))


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
    rules = [_substitution(script, is_extended=is_extended) for script in scripts]
    (name,) = names

    def write() -> None:
        lines = _text(name).splitlines(keepends=True)
        for pattern, replace, count in rules:
            lines = [pattern.sub(replace, line, count) for line in lines]
        _write(target or name, "".join(lines))

    return write


def _substitution(
    script: str, *, is_extended: bool
) -> tuple[re.Pattern[str], Callable[[re.Match[str]], str], int]:
    """Return pattern, replacement and number of times of `s/.../.../g`."""
    if script[:1] != "s" or len(script) < 2:
        raise ValueError(script)
    mark = script[1]
    old, new, flags = re.split(rf"(?<!\\){re.escape(mark)}", script[2:])
    if flags not in ("", "g"):
        raise ValueError(script)
    old, new = (text.replace(f"\\{mark}", mark) for text in (old, new))
    if not is_extended:
        # There what is special in Python has a backslash in front, and the reverse.
        old = re.sub(
            r"\\?[(){}+?|]",
            lambda m: m[0][1] if len(m[0]) > 1 else f"\\{m[0]}",
            old,
        )

    def replace(match: re.Match[str]) -> str:
        def of(part: re.Match[str]) -> str:
            word = part[0]
            if word == "&":
                return match[0]
            return match[int(word[1])] if word[1].isdigit() else word[1]

        return re.sub(r"&|\\.", of, new)

    return re.compile(old), replace, 0 if flags else 1


def _text(name: str) -> str:
    with open(name, encoding="utf-8") as file:
        return file.read()


def _write(name: str, text: str) -> None:
    with open(name, "w", encoding="utf-8") as file:
        file.write(text)
