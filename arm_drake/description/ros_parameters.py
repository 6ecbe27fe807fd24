"""ROS 2 parameter files to the parameters of nodes, as rcl reads them.

A file maps node names, with wildcards and name spaces, to `ros__parameters`. The rules
are those of rcl_yaml_param_parser (parse.c) and of rclcpp's parameter_map. What they
refuse but can only mean one thing is taken, with a line in the report.
"""

import dataclasses as dc
import difflib
import functools
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from arm_drake import yaml_files
from arm_drake.description.given import Parameter
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_scalars import UNTAGGED, check_tag, scalar
from arm_drake.description.substitutions import Substitutions
from arm_drake.errors import ParameterError

PARAMETERS = "ros__parameters"

# Bytes of a parameter file that are read.
MAX_SIZE = 1_000_000

_SHAPE = f"<node>: {{{PARAMETERS}: {{...}}}}"

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 80


@dc.dataclass(frozen=True)
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
        return re.compile(pattern.replace(r"\*", "*"), re.ASCII)


class ParameterReader:
    """Reads parameter files with one set of variables."""

    def __init__(
        self,
        variables: Mapping[str, str],
        report: LoadReport,
        packages: PackageFinder | None = None,
    ) -> None:
        """Create a reader.

        Args:
            variables: Values of `$(var NAME)`.
            report: Where what is not taken as written is recorded.
            packages: What resolves `$(find-pkg-share PACKAGE)`.
        """
        self.substitutions = Substitutions(variables, packages, report)
        self._report = report

    def read(self, file: Path) -> list[Section]:
        """Return the sections of a file in their order.

        Raises:
            ParameterError: If the file can't be used.
        """
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
    wanted = PARAMETERS.replace("_", "")
    # The comparison is slow, and there may be many keys.
    return letters.startswith("ro") and bool(
        difflib.get_close_matches(letters, [wanted], cutoff=0.8)
    )


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
            raise self._misplaced(node, f"a mapping that ends in {PARAMETERS!r}", path)
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
        flat: dict[str, Parameter] = {}
        if isinstance(value, yaml.MappingNode):
            self._flatten(value, "", flat, path)
        elif _is_empty(value):
            self._warn(key, path, "it has no parameters", "defaults are used")
        else:
            raise self._misplaced(value, "a mapping of parameters", path)
        node = path or "/**"
        line = key.start_mark.line + 1
        section = self._sections.setdefault(node, Section(node, {}, self._file, line))
        section.parameters.update(flat)

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
            self._warn(
                node,
                f"{path}.{name}",
                "it has no value; rcl refuses the file",
                "taken as not given",
            )
        elif isinstance(node, yaml.SequenceNode) and any(
            isinstance(item, yaml.MappingNode) for item in node.value
        ):
            self._flatten(self._only_mapping(node, f"{path}.{name}"), name, flat, path)
        else:
            value = self._value(node, f"{path}.{name}")
            line = node.start_mark.line + 1
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

    def _misplaced(self, node: yaml.Node, expected: str, where: str) -> ParameterError:
        return ParameterError(
            f"expected {expected}, got {_SHORT.repr(_plain(node))}",
            file=self._file,
            line=node.start_mark.line + 1,
            where=where.lstrip("/"),
        )

    def _warn(self, node: yaml.Node, where: str, what: str, done: str) -> None:
        self._report.add(
            "warning",
            "repair",
            what,
            done,
            where=where.lstrip("/"),
            file=self._file,
            line=node.start_mark.line + 1,
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
