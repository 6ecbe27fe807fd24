"""YAML files, read safely, with numbers as ROS reads them."""

import re
from pathlib import Path
from typing import Any

import yaml

from arm_drake.errors import suggest_file

# Numbers as rcl reads them, with strtol and strtod. YAML 1.1 takes 1e-3 for a string,
# 1:30 for 90 and 2026-01-31 for a date.
_INT = re.compile(r"[-+]?(0[0-7]*|[1-9]\d*|0x[\da-fA-F]+)$")
_FLOAT = re.compile(
    r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$"
)
_TAG = "tag:yaml.org,2002:"

_LINE_ENDS = "\0\r\n\x85\u2028\u2029"

# Bytes of a file that are read. Real files have some 10 kB; a million values take
# seconds and gigabytes.
MAX_SIZE = 4_000_000

# More values than this are taken only if they are written out, not multiplied by
# aliases of aliases.
_MAX_ALIASED = 100_000

# So many brackets may be open. For each that is PyYAML looks at all others.
_MAX_OPEN = 200


class YamlError(ValueError):
    """A file that can't be read or parsed."""

    def __init__(self, problem: str, line: int | None = None) -> None:
        """Create the error; lines count from 1."""
        super().__init__(problem)
        self.problem = problem
        self.line = line


class Loader(yaml.SafeLoader):
    """Plain values only, as YAML's safe loader.

    TABs are taken where libyaml takes them, which PyYAML doesn't: after a value, and
    before a comment.
    """

    def scan_to_next_token(self) -> None:
        """Skip blanks and comments."""
        while True:
            self._skip_blanks()
            if self.peek() == "#":
                while self.peek() not in _LINE_ENDS:
                    self.forward()
            if not self.scan_line_break():  # type: ignore[no-untyped-call]
                return
            if not self.flow_level:
                self.allow_simple_key = True

    def _skip_blanks(self) -> None:
        while True:
            length = 0
            while self.peek(length) == " ":
                length += 1
            self.forward(length)
            if self.peek() != "\t":
                return
            length = 1
            while self.peek(length) in " \t":
                length += 1
            is_indentation = self.allow_simple_key and not self.flow_level
            if is_indentation and self.peek(length) not in f"#{_LINE_ENDS}":
                return
            self.forward(length)

    def fetch_flow_collection_start(self, token: type[yaml.Token]) -> None:
        """Take a bracket that opens a list or mapping."""
        if self.flow_level >= _MAX_OPEN:
            raise RecursionError
        super().fetch_flow_collection_start(token)


Loader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern)
        for tag, pattern in resolvers
        if tag.removeprefix(_TAG) not in ("int", "float", "timestamp")
    ]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(f"{_TAG}int", _INT, list("-+0123456789"))
Loader.add_implicit_resolver(f"{_TAG}float", _FLOAT, list("-+.0123456789"))


class _Constructor(yaml.constructor.SafeConstructor):
    """Makes plain values; an error says where."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError, KeyError) as error:
            raise yaml.constructor.ConstructorError(
                None, None, str(error), node.start_mark
            ) from None


def read_text(path: Path, max_size: int = MAX_SIZE) -> str:
    """Return the text of a file of at most so many bytes, or raise YamlError."""
    try:
        with path.open("rb") as stream:
            content = stream.read(max_size + 1)
    except OSError as error:
        hint = suggest_file(path) if isinstance(error, FileNotFoundError) else ""
        problem = f"can't be read: {error.strerror or error}{hint}"
        raise YamlError(problem) from None
    except ValueError:
        raise YamlError("can't be read: no file has such a name") from None
    if len(content) > max_size:
        raise YamlError(f"can't be read: it is larger than {max_size / 1e6:g} MB")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise YamlError("can't be read: it is not UTF-8 text") from None


def compose(text: str, loader: type[Loader] = Loader) -> yaml.Node | None:
    """Return the nodes of a YAML text, with their lines, or raise YamlError."""
    try:
        node = yaml.compose(text, Loader=loader)
    except yaml.reader.ReaderError as error:
        raise YamlError(
            f"malformed YAML: the character {chr(error.character)!r} is in no text",
            text.count("\n", 0, error.position) + 1,
        ) from None
    except yaml.YAMLError as error:
        raise _explain(error) from None
    except RecursionError:
        raise YamlError("malformed YAML: nested too deeply") from None
    if node is not None:
        sizes: dict[int, int] = {}
        size = _expanded_size(node, sizes)
        if size > max(_MAX_ALIASED, 2 * len(sizes)):
            raise YamlError(f"malformed YAML: aliases multiply to {size} values")
    return node


def _expanded_size(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Return how many values a node stands for, aliases written out."""
    if isinstance(node, yaml.ScalarNode):
        sizes[id(node)] = 1
        return 1
    if id(node) not in sizes:
        sizes[id(node)] = 0  # It is being counted.
        size = 1
        for item in node.value:
            for child in item if isinstance(item, tuple) else (item,):
                size += _expanded_size(child, sizes)
        sizes[id(node)] = size
    elif sizes[id(node)] == 0:
        line = node.start_mark.line + 1
        raise YamlError("malformed YAML: the value contains itself", line)
    return sizes[id(node)]


def check_keys(root: yaml.Node) -> None:
    """Raise YamlError if a key stands twice in a mapping of a text, as composed.

    It is for files of our own: of others ROS takes the last one.
    """
    waiting, known = [root], {id(root)}
    while waiting:
        node = waiting.pop()
        if isinstance(node, yaml.ScalarNode):
            continue
        children = list(node.value)
        if isinstance(node, yaml.MappingNode):
            names = set[str]()
            for key, _ in children:
                if not isinstance(key, yaml.ScalarNode) or key.tag == f"{_TAG}merge":
                    continue
                if key.value in names:
                    problem = f"the key {key.value!r} stands twice"
                    raise YamlError(problem, key.start_mark.line + 1)
                names.add(key.value)
            children = [value for _, value in children]
        new = [child for child in children if id(child) not in known]
        known.update(map(id, new))
        waiting += reversed(new)


def load(path: Path) -> Any:
    """Return the plain value of a YAML file, or raise YamlError."""
    return parse(read_text(path))


def parse(text: str) -> Any:
    """Return the plain value of a YAML text, or raise YamlError."""
    node = compose(text)
    return None if node is None else plain(node)


def _explain(error: yaml.YAMLError) -> YamlError:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or " ".join(str(error).split())
    if problem.startswith(r"found character '\t'"):
        problem = "a TAB indents this line; expected spaces"
    elif mark is not None and mark.buffer is not None:
        start = getattr(error, "context_mark", None)
        told = _in_our_words(problem, mark, start)
        if problem == "found unexpected end of stream" and start is not None:
            mark = start  # Where the quote opens, not the end of the file.
        problem = told
    return YamlError(f"malformed YAML: {problem}", mark.line + 1 if mark else None)


def _in_our_words(problem: str, mark: yaml.Mark, start: yaml.Mark | None) -> str:
    """Return what is wrong at a mark, for the usual mistakes in plain words.

    `start` is where PyYAML began to read what it couldn't end.
    """
    lines = str(mark.buffer).rstrip("\0").split("\n")
    line = lines[mark.line].strip() if mark.line < len(lines) else ""
    if problem.startswith("expected <block end>"):
        text = f"the indentation of {line!r}, {mark.column} columns, fits no line above"
        if start is not None and start.column == mark.column:
            text = f"{line!r} stands where the lines above begin otherwise"
            return f"{text}; expected either keys or items '- ...' in one block"
        own = "" if start is None else f"{start.column}, as in line {start.line + 1}"
        return f"{text}; expected {own or 'that of its neighbours'}"
    if problem == "mapping values are not allowed here":
        if len(re.findall(r":(?=\s|$)", line)) > 1:
            text = f"a second ': ' in {line!r}"
            return f"{text}; expected quotes around a text with ': ' in it"
        text = f"{line!r} goes on with the value of the line above"
        return f"{text}; expected its indentation, or ':' at its end"
    if problem == "found unexpected end of stream" and start is not None:
        opened = lines[start.line].strip()
        text = f"the quote that opens in {opened!r} never closes"
        return f"{text}; expected another one at the text's end"
    return problem


def plain(node: yaml.Node) -> Any:
    """Return the plain value of a node."""
    try:
        return _Constructor().construct_document(node)
    except yaml.YAMLError as error:
        raise _explain(error) from None


def find_line(node: yaml.Node, place: str) -> int | None:
    """Return the line of a place such as "[1].goal.points[0]", or of what it lies in.

    Lines count from 1; of a key it is that of the key.
    """
    mark = node.start_mark
    while place:
        index = re.match(r"\[(\d+)\]", place)
        if isinstance(node, yaml.SequenceNode) and index:
            number = int(index[1])
            if number >= len(node.value):
                break
            node, place = node.value[number], place[index.end() :]
            mark = node.start_mark
            continue
        name = place.removeprefix(".")
        found = [
            (len(key.value), key, value)
            for key, value in (
                items(node) if isinstance(node, yaml.MappingNode) else ()
            )
            # Keys may have dots, too.
            if re.match(rf"{re.escape(key.value)}(?=[.\[]|$)", name)
        ]
        if not found:
            break
        length, key, node = max(found, key=lambda each: each[0])
        mark, place = key.start_mark, name[length:]
    return None if mark is None else mark.line + 1


def items(node: yaml.MappingNode) -> list[tuple[yaml.ScalarNode, yaml.Node]]:
    """Return the keys and values of a mapping, those merged by `<<` first.

    YamlError if a key isn't a scalar, or a merge isn't one of mappings.
    """
    try:
        _Constructor().flatten_mapping(node)
    except yaml.YAMLError as error:
        raise _explain(error) from None
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            problem = f"malformed YAML: expected a name, got a {key.id}"
            raise YamlError(problem, key.start_mark.line + 1)
    return list(node.value)
