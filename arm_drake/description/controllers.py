"""Controllers YAML to a ControllerManagerConfig, as rcl reads parameter files.

A file maps node names, with wildcards and name spaces, to `ros__parameters`. Duplicate
keys merge, dotted and nested keys mean the same, a later section overrides an earlier
one, value by value.
"""

import dataclasses as dc
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import yaml

from arm_drake import yaml_files
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError, suggest

DEFAULT_UPDATE_RATE = 100  # Hz
MAX_UPDATE_RATE = 10_000  # Hz
MANAGER = "controller_manager"
_PARAMETERS = "ros__parameters"
_SUBSTITUTION = re.compile(r"\$\((\S+)\s+([^)]*)\)")


@dc.dataclass(frozen=True)
class ControllerConfig:
    """A controller as its YAML configures it."""

    name: str

    # ros2_control type, such as "forward_command_controller/ForwardCommandController".
    type: str

    # Its parameters by dotted name, without "type".
    parameters: dict[str, Parameter]

    # Where its type is given.
    file: Path
    line: int


@dc.dataclass(frozen=True)
class ControllerManagerConfig:
    """A controller manager and its controllers, in the order of the manager's list."""

    # Rate of the read-update-write loop [Hz].
    update_rate: int = DEFAULT_UPDATE_RATE

    controllers: tuple[ControllerConfig, ...] = ()

    # Files that were read.
    files: tuple[Path, ...] = ()


def load_controllers(
    files: Sequence[Path], variables: Mapping[str, str], report: LoadReport
) -> ControllerManagerConfig:
    """Return what controllers YAML files configure.

    Args:
        files: YAML files; a later one overrides an earlier one.
        variables: Values of `$(var NAME)`.
        report: Where sections without effect are recorded.

    Raises:
        ParameterError: If a file can't be used.
    """
    used: set[str] = set()
    sections = [
        section for file in files for section in _read_sections(file, variables, used)
    ]
    manager = _merge(section for section in sections if section.matches(MANAGER))
    types = {
        key.removesuffix(".type"): parameter
        for key, parameter in manager.items()
        if key.endswith(".type")
    }
    # A plain "/**" section reaches every node; the manager's keys in it are not theirs.
    managed = {
        key: parameter
        for key, parameter in manager.items()
        if key == "update_rate" or any(key.startswith(f"{name}.") for name in types)
    }
    controllers = {
        name: _controller(name, parameter, managed, sections)
        for name, parameter in types.items()
    }
    for section in sections:
        name = section.node.rpartition("/")[2]
        own_type = section.parameters.get("type")
        if own_type is not None and name not in (*controllers, MANAGER, "**", "*"):
            controllers[name] = _controller(name, own_type, managed, sections)
    rate = manager.get("update_rate")
    if rate is None:
        if files:
            report.add(
                "info",
                "missing",
                f"{MANAGER}.update_rate is not given",
                f"{DEFAULT_UPDATE_RATE} Hz is used",
                file=files[0],
            )
    elif type(rate.value) is not int or not 0 < rate.value <= MAX_UPDATE_RATE:
        raise ParameterError(
            f"expected an integer from 1 to {MAX_UPDATE_RATE} [Hz], got {rate.value!r}",
            file=rate.file,
            line=rate.line,
            where=f"{MANAGER}.update_rate",
        )
    if files and not controllers:
        report.add(
            "warning",
            "missing",
            "no controller is configured",
            "no controller runs",
            file=files[0],
        )
    for name in sorted(set(variables) - used):
        report.add(
            "warning",
            "ignored",
            f"no controllers YAML uses the variable {name!r}",
            "it has no effect",
        )
    _report_unmatched(sections, controllers, report)
    return ControllerManagerConfig(
        update_rate=rate.value if rate is not None else DEFAULT_UPDATE_RATE,
        controllers=tuple(controllers.values()),
        files=tuple(files),
    )


@dc.dataclass(frozen=True)
class _Section:
    """The parameters under one node key."""

    # Node key as a fully qualified name; may hold the wildcards "*" and "**".
    node: str
    parameters: dict[str, Parameter]
    file: Path
    line: int

    def matches(self, name: str) -> bool:
        pattern = re.escape(self.node).replace(r"/\*\*", r"(/\w+)*")
        pattern = pattern.replace(r"/\*", r"(/\w+)")
        # Without a launch file the name space is unknown: any one is taken.
        return bool(re.fullmatch(pattern, f"/{name}")) or (
            self.node.rpartition("/")[2] == name
        )


def _merge(sections: Iterator[_Section]) -> dict[str, Parameter]:
    merged: dict[str, Parameter] = {}
    for section in sections:
        merged.update(section.parameters)
    return merged


def _controller(
    name: str,
    type_: Parameter,
    managed: Mapping[str, Parameter],
    sections: Sequence[_Section],
) -> ControllerConfig:
    if not isinstance(type_.value, str):
        raise ParameterError(
            f"expected a controller type, got {type_.value!r}",
            file=type_.file,
            line=type_.line,
            where=f"{name}.type",
        )
    own = _merge(section for section in sections if section.matches(name))
    parameters = {
        key: parameter
        for key, parameter in own.items()
        if key != "type" and managed.get(key) is not parameter
    }
    return ControllerConfig(name, type_.value, parameters, type_.file, type_.line)


def _report_unmatched(
    sections: Sequence[_Section], controllers: Mapping[str, object], report: LoadReport
) -> None:
    for section in sections:
        if any(section.matches(name) for name in (*controllers, MANAGER)):
            continue
        known = [*controllers, MANAGER]
        report.add(
            "warning",
            "ignored",
            f"no controller of this name; {suggest(section.node.strip('/'), known)}",
            "the section has no effect",
            where=section.node.lstrip("/"),
            file=section.file,
            line=section.line,
        )


def _read_sections(
    file: Path, variables: Mapping[str, str], used: set[str]
) -> list[_Section]:
    try:
        text = _substitute(yaml_files.read_text(file), variables, file, used)
        root = yaml_files.compose(text)
        if root is None:
            return []
        is_foreign = isinstance(root, yaml.MappingNode) and _PARAMETERS not in text
        sections = [] if is_foreign else list(_sections(root, "", file))
    except yaml_files.YamlError as error:
        raise ParameterError(error.problem, file=file, line=error.line) from None
    if not sections:
        raise ParameterError(
            f"no {_PARAMETERS!r} anywhere: this is no ROS 2 parameter file "
            "(ROS 1 configurations have none)",
            file=file,
        )
    return sections


def _substitute(
    text: str, variables: Mapping[str, str], file: Path, used: set[str]
) -> str:
    """Replace `$(var NAME)`, and other substitutions of that name, outside comments.

    The names of the variables are added to ``used``.
    """
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        code, mark, comment = line.partition("#")

        def replace(match: re.Match[str], number: int = number) -> str:
            kind, name = match.group(1), match.group(2).strip()
            if name in variables:
                used.add(name)
                return str(variables[name])
            if kind == "env" and name in os.environ:
                return os.environ[name]
            raise ParameterError(
                f"{match.group(0)} has no value; give one with "
                f"variables={{{name!r}: ...}} (--var {name}=VALUE)",
                file=file,
                line=number,
            )

        lines.append(_SUBSTITUTION.sub(replace, code) + mark + comment)
    return "\n".join(lines)


def _sections(node: yaml.Node, path: str, file: Path) -> Iterator[_Section]:
    """Yield the sections below a node key, nested name spaces included."""
    if not isinstance(node, yaml.MappingNode):
        raise _misplaced(node, f"a mapping that ends in {_PARAMETERS!r}", path, file)
    for key, value in yaml_files.items(node):
        is_empty = isinstance(value, yaml.ScalarNode) and not value.value
        if key.value == _PARAMETERS:
            if not isinstance(value, yaml.MappingNode) and not is_empty:
                raise _misplaced(value, "a mapping of parameters", path, file)
            flat: dict[str, Parameter] = {}
            _flatten(value, "", flat, file)
            yield _Section(path or "/**", flat, file, key.start_mark.line + 1)
        elif not is_empty:
            yield from _sections(value, f"{path}/{key.value.strip('/')}", file)


def _misplaced(node: yaml.Node, expected: str, path: str, file: Path) -> ParameterError:
    return ParameterError(
        f"expected {expected}, got {yaml_files.plain(node)!r}",
        file=file,
        line=node.start_mark.line + 1,
        where=path.lstrip("/"),
    )


def _flatten(
    node: yaml.Node, prefix: str, flat: dict[str, Parameter], file: Path
) -> None:
    if isinstance(node, yaml.MappingNode):
        for key, value in yaml_files.items(node):
            name = f"{prefix}.{key.value}" if prefix else str(key.value)
            _flatten(value, name, flat, file)
    elif prefix:
        line = node.start_mark.line + 1
        flat[prefix] = Parameter(yaml_files.plain(node), file, line)
