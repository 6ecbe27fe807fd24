"""Launch files in Python, XML and YAML, as what they describe."""

import importlib.util
import types
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from arm_drake.launch import actions, parameters
from arm_drake.launch.actions import LaunchDescription
from arm_drake.launch.substitutions import (
    Condition,
    IfCondition,
    LaunchError,
    PackageNotFoundError,
    UnlessCondition,
    parse_substitution,
)

_SUFFIXES = (".py", ".xml", ".yaml", ".yml")


def is_launch_file(path: Path) -> bool:
    """Return whether a file of a package is a launch file, by its name and folder."""
    is_one = "launch" in path.name or path.parent.name == "launch"
    return is_one and path.suffix in _SUFFIXES


class _Element(NamedTuple):
    """A tag of an XML launch file, or the same in YAML."""

    tag: str
    attributes: Mapping[str, str]
    children: "list[_Element]"

    def get(self, name: str, default: Any = None) -> Any:
        """Return an attribute as what it stands for."""
        text = self.attributes.get(name)
        return default if text is None else parse_substitution(text)

    def all(self, *tags: str) -> "list[_Element]":
        return [child for child in self.children if child.tag in tags]

    @property
    def condition(self) -> Condition | None:
        for name, kind in (("if", IfCondition), ("unless", UnlessCondition)):
            if name in self.attributes:
                return kind(self.get(name))
        return None


def _from_xml(node: ET.Element) -> _Element:
    return _Element(node.tag, dict(node.attrib), [_from_xml(child) for child in node])


def _from_yaml(tag: str, data: Any) -> _Element:
    attributes, children = {}, []
    entries = data if isinstance(data, list) else [data]
    for entry in entries:
        if not isinstance(entry, Mapping):
            raise LaunchError(f"{tag}: expected a mapping, got {entry!r}")
        for key, value in entry.items():
            if isinstance(data, list):
                children.append(_from_yaml(str(key), value))
            elif isinstance(value, list) and value and isinstance(value[0], Mapping):
                inner = [_from_yaml(str(key), each) for each in value]
                children += inner[0].children if key == "children" else inner
            else:
                is_flag = isinstance(value, bool)
                attributes[str(key)] = str(value).lower() if is_flag else str(value)
    return _Element(tag, attributes, children)


def _make_parameters(element: _Element) -> list[Any]:
    """Return what `<param>` say: files, and names with values."""
    found: list[Any] = []
    for child in element.all("param"):
        if "from" in child.attributes:
            is_replaced = child.attributes.get("allow_substs", "false")
            found.append(
                parameters.ParameterFile(
                    child.get("from"), allow_substs=is_replaced.lower() == "true"
                )
            )
        elif child.children:
            inner = {k: v for each in _make_parameters(child) for k, v in each.items()}
            found.append({child.attributes["name"]: inner})
        else:
            value = parameters.ParameterValue(child.get("value", [""]))
            if child.attributes.get("type") == "str":
                value.value_type = str
            found.append({child.attributes["name"]: value})
    return found


def _make_node(element: _Element) -> Any:
    remaps = element.all("remap")
    return actions.Node(
        package=element.get("pkg"),
        executable=element.get("exec"),
        name=element.get("name"),
        namespace=element.get("namespace"),
        parameters=_make_parameters(element),
        remappings=[(each.get("from"), each.get("to")) for each in remaps],
        arguments=actions.Words(
            [element.get("args", ""), " ", element.get("ros_args", "")]
        ),
        condition=element.condition,
    )


def _make_include(element: _Element) -> Any:
    given = [(arg.get("name"), arg.get("value")) for arg in element.all("arg", "let")]
    return actions.IncludeLaunchDescription(
        actions.LaunchDescriptionSource(element.get("file")),
        launch_arguments=given,
        condition=element.condition,
    )


def _make_group(element: _Element) -> Any:
    is_scoped = element.attributes.get("scoped", "true").lower() == "true"
    return actions.GroupAction(
        [_make_action(child) for child in element.children],
        scoped=is_scoped,
        condition=element.condition,
    )


def _make_argument(element: _Element) -> Any:
    choices = [child.attributes.get("value", "") for child in element.all("choice")]
    return actions.DeclareLaunchArgument(
        element.attributes["name"],
        default_value=element.get("default"),
        description=element.get("description", ""),
        choices=choices or None,
        condition=element.condition,
    )


def _make_timer(element: _Element) -> Any:
    return actions.TimerAction(
        period=element.get("period"),
        actions=[_make_action(child) for child in element.children],
        condition=element.condition,
    )


def _make_pair(kind: Any, first: str = "name", second: str = "value") -> Any:
    def make(element: _Element) -> Any:
        given = (element.get(first), element.get(second, ""))
        return kind(*given, condition=element.condition)

    return make


_MAKERS: Mapping[str, Callable[[_Element], Any]] = {
    "arg": _make_argument,
    "executable": lambda e: actions.ExecuteProcess(
        cmd=[e.get("cmd")], condition=e.condition
    ),
    "group": _make_group,
    "include": _make_include,
    "let": _make_pair(actions.SetLaunchConfiguration),
    "log": lambda e: actions.LogInfo(msg=e.get("message"), condition=e.condition),
    "log_info": lambda e: actions.LogInfo(msg=e.get("message"), condition=e.condition),
    "node": _make_node,
    "push-ros-namespace": lambda e: actions.PushRosNamespace(e.get("namespace")),
    "push_ros_namespace": lambda e: actions.PushRosNamespace(e.get("namespace")),
    "set_env": _make_pair(actions.SetEnvironmentVariable),
    "append_env": _make_pair(actions.AppendEnvironmentVariable),
    "set_parameter": lambda e: actions.SetParameter(
        e.attributes["name"], parameters.ParameterValue(e.get("value"))
    ),
    "set_remap": _make_pair(actions.SetRemap, "from", "to"),
    "shutdown": lambda e: actions.Shutdown(condition=e.condition),
    "timer": _make_timer,
    "unset_env": lambda e: actions.UnsetEnvironmentVariable(e.get("name")),
}


def _make_action(element: _Element) -> Any:
    if element.tag not in _MAKERS:
        known = ", ".join(sorted(_MAKERS))
        raise LaunchError(f"unknown <{element.tag}>; known: {known}")
    try:
        return _MAKERS[element.tag](element)
    except KeyError as error:
        name = error.args[0]
        raise LaunchError(f"<{element.tag}> has no attribute {name!r}") from None


def _read_data(path: Path, text: str) -> LaunchDescription:
    """Return what an XML or YAML launch file describes."""
    if path.suffix == ".xml" or text.lstrip().startswith("<"):
        try:
            root = _from_xml(ET.fromstring(text))  # noqa: S314  no external entities.
        except ET.ParseError as error:
            raise LaunchError(f"malformed XML: {error}") from None
        if root.tag != "launch":
            raise LaunchError(f"expected <launch>, got <{root.tag}>")
    else:
        try:
            data = yaml.safe_load(text)
        except yaml.YAMLError as error:
            reason = " ".join(str(error).split())
            raise LaunchError(f"malformed YAML: {reason}") from None
        if not isinstance(data, Mapping) or "launch" not in data:
            raise LaunchError("expected a mapping with the key 'launch'")
        root = _from_yaml("launch", data["launch"] or [])
    return LaunchDescription([_make_action(child) for child in root.children])


def _read_python(path: Path) -> LaunchDescription:
    """Return what a launch file in Python describes."""
    code = compile(path.read_bytes(), str(path), "exec")
    names: dict[str, Any] = {"__name__": "python_launch_file", "__file__": str(path)}
    exec(code, names)  # noqa: S102  That is what a launch file is for.
    make = names.get("generate_launch_description")
    if not callable(make):
        raise LaunchError("it has no function generate_launch_description()")
    description = make()
    if not isinstance(description, LaunchDescription):
        raise LaunchError(
            "generate_launch_description(): expected a LaunchDescription, got "
            f"{type(description).__name__}"
        )
    return description


def load_as_module(path: str) -> types.ModuleType:
    """Return a Python file as a module, as `launch` does it."""
    spec = importlib.util.spec_from_file_location("python_launch_file", path)
    if spec is None or spec.loader is None:
        raise LaunchError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read_launch_file(path: Path) -> LaunchDescription:
    """Return what a launch file describes; it is a LaunchError if it can't be used."""
    try:
        if not path.is_file():
            raise LaunchError("no such file")
        if path.suffix == ".py":
            return _read_python(path)
        return _read_data(path, path.read_text(encoding="utf-8"))
    except PackageNotFoundError:
        raise
    except LaunchError as error:
        if str(path) in str(error):
            raise
        raise LaunchError(f"{path}: {error}") from None
