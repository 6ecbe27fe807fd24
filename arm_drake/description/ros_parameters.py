"""ROS 2 parameter files, read into the parameters of nodes as rcl reads them.

A file maps node names, with wildcards and name spaces, to `ros__parameters`. The rules
are those of rcl_yaml_param_parser (parse.c) and of rclcpp's parameter_map. What they
refuse but can only mean one thing is taken, with a line in the report.

Launch files put `$(var NAME)` and its kin into parameter files. Vendors have templates
of their own, `<NAME>` and `${NAME}`, which their scripts fill.
"""

import dataclasses as dc
import functools
import math
import os
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from arm_drake import yaml_files
from arm_drake.description.packages import PackageFinder
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError, ParameterError, find_close
from arm_drake.importing import dataclass

_TRUE = ("Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON")
_FALSE = ("N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF")
_INT = re.compile(r"[-+]?(0[xX][\da-fA-F]+|0[0-7]*|[1-9]\d*)", re.ASCII)
_FLOAT = re.compile(
    r"[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[iI][nN][fF]([iI][nN][iI][tT][yY])?"
    r"|[nN][aA][nN])",
    re.ASCII,
)
_HEX_FLOAT = re.compile(
    r"[-+]?0[xX]([\da-fA-F]+\.?[\da-fA-F]*|\.[\da-fA-F]+)([pP][-+]?\d+)?", re.ASCII
)
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_TAG = "tag:yaml.org,2002:"

# Tag of scalars whose tag isn't written.
UNTAGGED = "untagged"
_TYPES = {f"{_TAG}bool": bool, f"{_TAG}int": int, f"{_TAG}float": float}


def scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    """Return the value that rcl gives a scalar."""
    text = str(node.value)
    if node.tag == f"{_TAG}str" or (node.tag == UNTAGGED and node.style in ("'", '"')):
        return text
    value = _number_or_text(text)
    if node.tag == UNTAGGED:
        return value
    if node.tag not in _TYPES:
        raise _unknown_tag(node)
    expected = _TYPES[node.tag]
    if expected is float and type(value) is int:
        return float(value)
    if type(value) is not expected:
        problem = f"{text!r} is no {expected.__name__}"
        raise yaml_files.YamlError(problem, node.start_mark.line + 1)
    return value


def check_tag(node: yaml.Node) -> None:
    """Raise YamlError if a list or a mapping has a tag of its own."""
    if node.tag not in (UNTAGGED, f"{_TAG}seq", f"{_TAG}map"):
        raise _unknown_tag(node)


def _unknown_tag(node: yaml.Node) -> yaml_files.YamlError:
    return yaml_files.YamlError(
        f"the tag {node.tag.replace(_TAG, '!!')!r} is not taken; known: !!bool, "
        "!!float, !!int, !!str",
        node.start_mark.line + 1,
    )


def _number_or_text(text: str) -> bool | int | float | str:
    """Return what rcl makes of a text without quotes, with strtol and strtod."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if len(text) < 30 and _INT.fullmatch(text):
        digits = text.lstrip("+-").lower()
        base = 16 if digits.startswith("0x") else 8 if digits[0] == "0" else 10
        number = int(text, base)
        if -(2**63) <= number < 2**63:
            return number
        return float(number)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    if len(text) < 30 and _HEX_FLOAT.fullmatch(text):
        return float.fromhex(text)
    if not _FLOAT.fullmatch(text):
        return text
    value = float(text)
    mantissa = re.split("[eE]", text)[0]
    overflows = math.isinf(value) and "n" not in text.lower()
    underflows = value == 0.0 and bool(re.search("[1-9]", mantissa))
    return text if overflows or underflows else value


_BRACKET = re.compile(r"(\$\(|\))")
_TEMPLATE = re.compile(r"\$\{(\w+)\}|<(\w+)>")
_WITH_DEFAULT = ("var", "arg", "env")
_OF_PACKAGES = ("find", "find-pkg-share")


class Substitutions:
    """Values for the substitutions of parameter files."""

    def __init__(
        self,
        variables: Mapping[str, str],
        packages: PackageFinder | None,
        report: LoadReport,
    ) -> None:
        """Create it."""
        self._variables = {name: str(value) for name, value in variables.items()}
        self._packages = packages
        self._report = report
        self._used: set[str] = set()

    @property
    def unused(self) -> list[str]:
        """Names of the unused variables."""
        return sorted(self._variables.keys() - self._used)

    def fill_templates(self, text: str) -> str:
        """Return a text with the templates filled whose value is known.

        It is done before the text is parsed: `[${prefix}joint1]` is no YAML.
        """

        def fill(match: re.Match[str]) -> str:
            name = match.group(1) or match.group(2)
            if name not in self._variables:
                return match.group()
            self._used.add(name)
            return self._variables[name]

        return _TEMPLATE.sub(fill, text)

    def apply(
        self, root: yaml.Node, file: Path, loader: type[yaml_files.Loader]
    ) -> yaml.Node:
        """Return the nodes of a file with every `$(...)` replaced."""
        task = _Task(self._variables, self._packages, loader)
        result = task.visit(root)
        self._used |= task.used
        if task.aliases:
            what = "aliases and merges (`*`, `<<`) are refused by rcl"
            line = task.aliases[0]
            self._report.add(
                "info", "repair", what, "they are taken", file=file, line=line
            )
        for template, line in task.templates.items():
            what = f"the template {template!r} has no value"
            variable = _TEMPLATE.sub(_name, template)
            done = f"it stays as it is; --var {variable}=VALUE, in Python "
            done += f"variables={{{variable!r}: ...}}, fills it"
            self._report.add("warning", "missing", what, done, file=file, line=line)
        for text, (name, line) in task.missing.items():
            what = f"package {name!r} not found"
            done = f"{text} stays as it is; --package-path names the package's folder"
            self._report.add("error", "missing", what, done, file=file, line=line)
        if task.unresolved:
            raise _unresolved(task.unresolved, file)
        return result


def _name(match: re.Match[str]) -> str:
    return match.group(1) or match.group(2)


# Texts of substitutions: name of the value or package, line.
_Unresolved = dict[str, tuple[str, int]]


@dc.dataclass
class _Task:
    """Replaces the substitutions of one file."""

    variables: Mapping[str, str]
    packages: PackageFinder | None
    loader: type[yaml_files.Loader]

    # What has been visited, and what replaces it; an alias is a second visit.
    visited: dict[int, tuple[yaml.Node, yaml.Node]] = dc.field(default_factory=dict)

    used: set[str] = dc.field(default_factory=set)
    unresolved: _Unresolved = dc.field(default_factory=dict)
    missing: _Unresolved = dc.field(default_factory=dict)
    templates: dict[str, int] = dc.field(default_factory=dict)
    aliases: list[int] = dc.field(default_factory=list)

    def visit(self, node: yaml.Node) -> yaml.Node:
        if id(node) in self.visited:
            self.aliases.append(node.start_mark.line + 1)
            return self.visited[id(node)][1]
        result = node
        if isinstance(node, yaml.ScalarNode):
            result = self._replace(node)
        elif isinstance(node, yaml.SequenceNode):
            node.value = [self.visit(item) for item in node.value]
        else:
            node.value = [(self.visit(key), self.visit(v)) for key, v in node.value]
        self.visited[id(node)] = node, result
        return result

    def _replace(self, node: yaml.ScalarNode) -> yaml.Node:
        line = node.start_mark.line
        for match in _TEMPLATE.finditer(node.value):
            self.templates.setdefault(match.group(), line + 1)
        if "$(" not in node.value:
            return node
        node.value = self._expand(node.value, line + 1)
        if node.style is None and node.value.startswith(("[", "{")):
            # The empty lines give its nodes their lines.
            text = "\n" * line + node.value
            return yaml_files.compose(text, self.loader) or node
        return node

    def _expand(self, text: str, line: int) -> str:
        """Return a text with its substitutions replaced, the innermost ones first."""
        levels: list[list[str]] = [[]]
        for part in _BRACKET.split(text):
            if part == "$(":
                levels.append([])
            elif part == ")" and len(levels) > 1:
                inner = "".join(levels.pop())
                levels[-1].append(self._value(inner, line))
            else:
                levels[-1].append(part)
        if len(levels) > 1:
            raise yaml_files.YamlError(f"'$(' without ')' in {text!r}", line)
        return "".join(levels[0])

    def _value(self, inner: str, line: int) -> str:
        kind, *arguments = inner.split(maxsplit=1) if inner.strip() else [""]
        argument = _unquote(arguments[0]) if arguments else kind
        name, default = argument, None
        if kind in _WITH_DEFAULT:
            first, *rest = argument.split(maxsplit=1) or [""]
            name, default = _unquote(first), _unquote(rest[0]) if rest else None
        if name in self.variables:
            self.used.add(name)
            return self.variables[name]
        if kind == "env" and name in os.environ:
            return os.environ[name]
        if default is not None:
            return default
        text = f"$({inner})"
        if kind not in _OF_PACKAGES:
            self.unresolved.setdefault(text, (name, line))
            return ""
        if self.packages is not None:
            try:
                return str(self.packages.find(name))
            except PackageError:
                pass
        self.missing.setdefault(text, (name, line))
        return text


def _unquote(text: str) -> str:
    text = text.strip()
    if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    return text


def _unresolved(unresolved: _Unresolved, file: Path) -> ParameterError:
    """Return one error that names all substitutions without a value."""
    first = next(iter(unresolved.values()))[1]
    texts = [
        text if line == first else f"{text} (line {line})"
        for text, (_, line) in unresolved.items()
    ]
    names = dict.fromkeys(name for name, _ in unresolved.values())
    assignments = ", ".join(f"{name!r}: ..." for name in names)
    options = " ".join(f"--var {name}=VALUE" for name in names)
    noun = "one" if len(names) == 1 else "them"
    verb = "has" if len(texts) == 1 else "have"
    problem = f"{', '.join(texts)} {verb} no value"
    hint = f"give {noun} with variables={{{assignments}}} ({options})"
    return ParameterError(f"{problem}; {hint}", file=file, line=first)


PARAMETERS = "ros__parameters"

# Bytes of a parameter file that are read.
MAX_SIZE = 1_000_000

_SHAPE = f"<node>: {{{PARAMETERS}: {{...}}}}"

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 80


@dataclass(frozen=True)
class Section:
    """The parameters under one node key."""

    # Fully qualified name of the node; may hold the wildcards "*" and "**".
    node: str

    parameters: dict[str, Parameter]
    file: Path
    line: int

    @property
    def name(self) -> str:
        """Name of the node without its name space."""
        return self.node.rpartition("/")[2]

    @property
    def namespace(self) -> str:
        """Name space of the node, "" for the root."""
        return self.node.rpartition("/")[0]

    def matches(self, node: str) -> bool:
        """Return whether the node of a fully qualified name gets the parameters."""
        return bool(self._pattern.fullmatch(node))

    @functools.cached_property
    def _pattern(self) -> re.Pattern[str]:
        pattern = re.escape(self.node).replace(r"/\*", r"(/\w+)")
        try:
            return re.compile(pattern.replace(r"\*", "*"), re.ASCII)
        except re.error:
            problem = f"{self.node!r} is no pattern of nodes; expected /* or /** in it"
            raise ParameterError(problem, file=self.file, line=self.line) from None


class ParameterReader:
    """Reads parameter files with one set of variables."""

    def __init__(
        self,
        variables: Mapping[str, str],
        report: LoadReport,
        packages: PackageFinder | None = None,
    ) -> None:
        """Create a reader."""
        self.substitutions = Substitutions(variables, packages, report)
        self._report = report

    def read(self, file: Path) -> list[Section]:
        """Return the sections of a file in their order."""
        try:
            text = yaml_files.read_text(file, MAX_SIZE)
            text = self.substitutions.fill_templates(text)
            root = yaml_files.compose(text, _Loader)
            if root is None or _is_empty(root):
                raise yaml_files.YamlError(f"it is empty; expected {_SHAPE}")
            if isinstance(root, yaml.MappingNode):
                _check_kind(root)
            root = self.substitutions.apply(root, file, _Loader)
            sections = _File(file, self._report).sections(root)
        except yaml_files.YamlError as error:
            raise ParameterError(error.problem, file=file, line=error.line) from None
        return sections


class _Loader(yaml_files.Loader):
    """Leaves the types of scalars to the rules of rcl."""

    def resolve(
        self, kind: type[yaml.Node], value: Any, implicit: tuple[bool, bool]
    ) -> Any:
        if kind is yaml.ScalarNode and not (implicit[0] and value == "<<"):
            return UNTAGGED
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]


def _check_kind(root: yaml.MappingNode) -> None:
    """Raise YamlError if a file has no parameters anywhere."""
    waiting: list[yaml.Node] = [root]
    seen = set()
    is_ros_1 = False
    while waiting:
        node = waiting.pop()
        if not isinstance(node, yaml.MappingNode) or id(node) in seen:
            continue
        seen.add(id(node))
        for key, value in yaml_files.items(node):
            if _means_parameters(key.value):
                return
            is_ros_1 |= key.value == "type" and isinstance(value, yaml.ScalarNode)
            waiting.append(value)
    kind = "this is a ROS 1 configuration" if is_ros_1 else "no ROS 2 parameter file"
    raise yaml_files.YamlError(f"{kind}: no {PARAMETERS!r} anywhere; expected {_SHAPE}")


def _means_parameters(key: str) -> bool:
    """Return whether a key is `ros__parameters` or a misspelling of it."""
    letters = re.sub(r"[\W_]", "", key).lower()
    name = PARAMETERS.replace("_", "")
    # The comparison is slow, and there may be many keys.
    return letters.startswith("ro") and find_close(letters, [name], 0.8) is not None


class _File:
    """Makes sections of the nodes of one file."""

    def __init__(self, file: Path, report: LoadReport) -> None:
        self._file = file
        self._report = report
        self._sections: dict[str, Section] = {}

    def sections(self, root: yaml.Node) -> list[Section]:
        self._walk(root, "")
        return list(self._sections.values())

    def _walk(self, node: yaml.Node, path: str) -> None:
        """Collect the sections below a node key, nested name spaces included."""
        if not isinstance(node, yaml.MappingNode):
            above, _, last = path.strip("/").rpartition("/")
            lost = f"; or is {PARAMETERS!r} missing between {above!r} and {last!r}?"
            raise self._misplaced(
                node,
                f"a mapping that ends in {PARAMETERS!r}",
                path,
                lost if above else "",
            )
        check_tag(node)
        for key, value in yaml_files.items(node):
            if self._is_parameters(key, value, path):
                self._add(key, value, path)
            elif _is_empty(value):
                below = f"{path}/{key.value.strip('/')}"
                self._warn(key, below, "nothing stands below it", "it has no effect")
            else:
                self._walk(value, f"{path}/{key.value.strip('/')}")

    def _is_parameters(self, key: yaml.ScalarNode, value: yaml.Node, path: str) -> bool:
        if key.value == PARAMETERS:
            return True
        if not _means_parameters(key.value):
            return False
        if isinstance(value, yaml.MappingNode) and any(
            other.value == PARAMETERS for other, _ in yaml_files.items(value)
        ):
            return False  # A node has this name.
        self._warn(key, path, f"{key.value!r} is misspelt", f"taken as {PARAMETERS!r}")
        return True

    def _add(self, key: yaml.ScalarNode, value: yaml.Node, path: str) -> None:
        """Add a section; rcl keeps one for a name, at its first place in the file."""
        if not path:
            self._warn(key, "", "it has no node name", "it is taken for every node")
        node, line = path or "/**", key.start_mark.line + 1
        section = self._sections.setdefault(node, Section(node, {}, self._file, line))
        if isinstance(value, yaml.MappingNode):
            self._flatten(value, "", section.parameters, path)
        elif _is_empty(value):
            self._warn(key, path, "it has no parameters", "defaults are used")
        else:
            raise self._misplaced(value, "a mapping of parameters", path)

    def _flatten(
        self, node: yaml.Node, name: str, flat: dict[str, Parameter], path: str
    ) -> None:
        if not isinstance(node, yaml.ScalarNode):
            check_tag(node)
        if isinstance(node, yaml.MappingNode):
            entries = yaml_files.items(node)
            for key, value in entries:
                below = f"{name}.{key.value}" if name else str(key.value)
                self._flatten(value, below, flat, path)
            if name and not entries:
                self._warn(node, f"{path}.{name}", "it is empty", "it has no effect")
        elif _is_empty(node):
            what = "it has no value; rcl refuses the file"
            self._warn(node, f"{path}.{name}", what, "taken as not given")
        elif isinstance(node, yaml.SequenceNode) and any(
            isinstance(item, yaml.MappingNode) for item in node.value
        ):
            self._flatten(self._only_mapping(node, f"{path}.{name}"), name, flat, path)
        else:
            value = self._value(node, f"{path}.{name}")
            line = node.start_mark.line + 1
            if name in flat:
                what = f"it stands on line {flat[name].line}, too"
                self._warn(node, f"{path}.{name}", what, "what stands last counts")
            flat[name] = Parameter(value, self._file, line)

    def _only_mapping(self, node: yaml.SequenceNode, where: str) -> yaml.MappingNode:
        """Return the mapping in a list, which rcl reads as if there were no list.

        A second mapping or a plain value would end up in parameters of other names.
        """
        (item, *others) = node.value
        if others or any(isinstance(v, yaml.ScalarNode) for _, v in item.value):
            raise self._misplaced(node, "a list of values", where)
        return item

    def _value(self, node: yaml.Node, where: str) -> Any:
        """Return the value of a parameter: a scalar, or a list of those of one type."""
        if isinstance(node, yaml.ScalarNode):
            return scalar(node)
        if any(not isinstance(item, yaml.ScalarNode) for item in node.value):
            raise self._misplaced(node, "a list of single values", where)
        values = [scalar(item) for item in node.value]
        for item, value in zip(node.value, values, strict=True):
            if _is_empty(item):
                raise self._misplaced(item, "a value", where)
            if type(value) is not type(values[0]):
                expected = f"values of one type, as rcl does ({values[0]!r} is first)"
                raise self._misplaced(item, expected, where)
        return values

    def _misplaced(
        self, node: yaml.Node, expected: str, where: str, hint: str = ""
    ) -> ParameterError:
        problem = f"expected {expected}, got {_SHORT.repr(_plain(node))}{hint}"
        place, line = where.lstrip("/"), node.start_mark.line + 1
        return ParameterError(problem, file=self._file, line=line, where=place)

    def _warn(self, node: yaml.Node, where: str, what: str, done: str) -> None:
        place, line = where.lstrip("/"), node.start_mark.line + 1
        self._report.add(
            "warning", "repair", what, done, where=place, file=self._file, line=line
        )


def _is_empty(node: yaml.Node) -> bool:
    """Return whether nothing is written where a value should be."""
    return isinstance(node, yaml.ScalarNode) and not node.value and node.style is None


def _plain(node: yaml.Node) -> Any:
    """Return what a node holds, for a message."""
    if isinstance(node, yaml.ScalarNode):
        return None if _is_empty(node) else scalar(node)
    if isinstance(node, yaml.MappingNode):
        return {key.value: _plain(value) for key, value in yaml_files.items(node)}
    return [_plain(item) for item in node.value]
