"""Launch files in Python, XML and YAML, as what they describe."""

import functools
import importlib.util
import types
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

import yaml

from arm_drake.launch import actions, parameters, substitutions
from arm_drake.launch.actions import LaunchDescription
from arm_drake.launch.substitutions import (
    Condition,
    IfCondition,
    LaunchError,
    PackageNotFoundError,
    UnlessCondition,
    parse_command,
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
    line: int

    def get(self, name: str, default: Any = None) -> Any:
        """Return an attribute as what it stands for."""
        text = self.attributes.get(name)
        return default if text is None else parse_substitution(text)

    def all(self, *tags: str) -> "list[_Element]":
        return [child for child in self.children if child.tag in tags]

    def need(self, name: str) -> Any:
        """Return a required attribute as what it stands for."""
        return parse_substitution(self.attributes[name])

    @property
    def condition(self) -> Condition | None:
        for name, kind in (("if", IfCondition), ("unless", UnlessCondition)):
            if name in self.attributes:
                return kind(self.get(name))
        return None


def _parse_xml(text: str) -> _Element:
    parser = expat.ParserCreate()
    root = _Element("", {}, [], 0)
    opened = [root]

    def open_tag(tag: str, attributes: Mapping[str, str]) -> None:
        element = _Element(tag, attributes, [], parser.CurrentLineNumber)
        opened[-1].children.append(element)
        opened.append(element)

    parser.StartElementHandler = open_tag
    parser.EndElementHandler = lambda tag: opened.pop()
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise LaunchError(f"malformed XML: {reason}", line=error.lineno) from None
    if root.children[0].tag != "launch":
        raise LaunchError(f"expected <launch>, got <{root.children[0].tag}>")
    return root.children[0]


def _parse_yaml(text: str) -> _Element:
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.value == "launch":
                return _from_yaml("launch", value, loader)
    except yaml.YAMLError as error:
        reason, mark = str(error), getattr(error, "problem_mark", None)
        if mark is not None:
            reason = getattr(error, "problem", None) or reason
        line = None if mark is None else mark.line + 1
        problem = f"malformed YAML: {' '.join(reason.split())}"
        raise LaunchError(problem, line=line) from None
    raise LaunchError("expected a mapping with the key 'launch'")


def _from_yaml(tag: str, data: yaml.Node, loader: yaml.SafeLoader) -> _Element:
    """Return what an entry of YAML is: its simple values are attributes."""
    line = data.start_mark.line + 1
    element = _Element(tag, attributes := {}, [], line)
    is_list = isinstance(data, yaml.SequenceNode)
    if isinstance(data, yaml.ScalarNode) and not data.value:
        return element
    for entry in data.value if is_list else [data]:
        if not isinstance(entry, yaml.MappingNode):
            value = loader.construct_object(entry, deep=True)
            text = f"{tag}: expected a mapping, got {value!r}"
            raise LaunchError(text, line=entry.start_mark.line + 1)
        for key, value in entry.value:
            name = str(key.value)
            if is_list:
                element.children.append(_from_yaml(name, value, loader))
            elif name == "children":
                element.children.extend(_from_yaml(name, value, loader).children)
            elif _has_mappings(value):
                inner = [_from_yaml(name, each, loader) for each in value.value]
                element.children.extend(inner)
            else:
                found = loader.construct_object(value, deep=True)
                is_flag = isinstance(found, bool)
                attributes[name] = str(found).lower() if is_flag else str(found)
    return element


def _has_mappings(node: yaml.Node) -> bool:
    """Return whether something in YAML is a list of mappings."""
    first = node.value[:1] if isinstance(node, yaml.SequenceNode) else []
    return any(isinstance(each, yaml.MappingNode) for each in first)


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
            value = parameters.ParameterValue(_make_value(child))
            if child.attributes.get("type") == "str":
                value.value_type = str
            found.append({child.attributes["name"]: value})
    return found


def _make_value(element: _Element) -> Any:
    """Return the value of a parameter; with `value-sep` it is a list."""
    text = element.attributes.get("value", "")
    separator = element.attributes.get("value-sep")
    # One text each, not a list of the pieces that it is made of.
    values = [
        substitutions.StringJoinSubstitution(parse_substitution(part))
        for part in (text.split(separator) if separator else [text])
    ]
    return [parameters.ParameterValue(v) for v in values] if separator else values[0]


def _make_node(element: _Element) -> Any:
    remaps = element.all("remap")
    return actions.Node(
        package=element.get("pkg"),
        executable=element.need("exec"),
        name=element.get("name"),
        namespace=element.get("namespace"),
        parameters=_make_parameters(element),
        remappings=[(each.need("from"), each.need("to")) for each in remaps],
        arguments=actions.Words(
            [element.get("args", ""), " ", element.get("ros_args", "")]
        ),
    )


def _make_components(element: _Element) -> Any:
    loaded = [
        actions.ComposableNode(
            package=each.need("pkg"),
            plugin=each.need("plugin"),
            name=each.get("name"),
            namespace=each.get("namespace"),
            parameters=_make_parameters(each),
            remappings=[(r.need("from"), r.need("to")) for r in each.all("remap")],
            condition=each.condition,
        )
        for each in element.all("composable_node")
    ]
    return actions.LoadComposableNodes(composable_node_descriptions=loaded)


def _make_include(element: _Element) -> Any:
    arguments = [
        (arg.need("name"), arg.need("value")) for arg in element.all("arg", "let")
    ]
    source = actions.LaunchDescriptionSource(element.need("file"))
    return actions.IncludeLaunchDescription(source, launch_arguments=arguments)


def _make_group(element: _Element) -> Any:
    is_scoped = element.attributes.get("scoped", "true").lower() == "true"
    return actions.GroupAction(_make_actions(element), scoped=is_scoped)


def _make_argument(element: _Element) -> Any:
    choices = [child.attributes.get("value", "") for child in element.all("choice")]
    return actions.DeclareLaunchArgument(
        element.attributes["name"],
        default_value=element.get("default"),
        description=element.get("description", ""),
        choices=choices or None,
    )


def _make_timer(element: _Element) -> Any:
    period = element.need("period")
    return actions.TimerAction(period=period, actions=_make_actions(element))


def _make_pair(kind: Any, first: str = "name", second: str = "value") -> Any:
    return lambda element: kind(element.need(first), element.need(second))


def _make_set_parameter(element: _Element) -> Any:
    text = substitutions.StringJoinSubstitution(element.need("value"))
    value = parameters.ParameterValue(text)
    return actions.SetParameter(element.need("name"), value)


def _include(
    package: str, name: str, condition: Any = None, **arguments: Any
) -> actions.IncludeLaunchDescription:
    """Return an action of `ros_gz_sim` or its kin: a launch file of that package."""
    file = Path(substitutions.find_package(package), "launch", f"{name}.launch.py")
    values = {k: v for k, v in arguments.items() if v is not None}
    source = actions.LaunchDescriptionSource(str(file))
    return actions.IncludeLaunchDescription(
        source, launch_arguments=values, condition=condition
    )


# Actions of Gazebo's packages, which are launch files of theirs.
GAZEBO_ACTIONS: Mapping[str, Callable[..., Any]] = {
    "GzServer": functools.partial(_include, "ros_gz_sim", "gz_server"),
    "GzSpawnModel": functools.partial(_include, "ros_gz_sim", "gz_spawn_model"),
    "RosGzBridge": functools.partial(_include, "ros_gz_bridge", "ros_gz_bridge"),
}


def _make_gazebo(name: str) -> Any:
    """Return what makes an action of Gazebo's packages of an element."""

    def make(element: _Element) -> Any:
        given = element.attributes.keys() - {"if", "unless"}
        values = {each: element.get(each) for each in given}
        return GAZEBO_ACTIONS[name](**values)

    return make


_MAKERS: Mapping[str, Callable[[_Element], Any]] = {
    "arg": _make_argument,
    "executable": lambda e: actions.ExecuteProcess(
        cmd=parse_command(e.attributes["cmd"]),
        shell=e.attributes.get("shell", "").lower() == "true",
    ),
    "group": _make_group,
    "gz_server": _make_gazebo("GzServer"),
    "gz_spawn_model": _make_gazebo("GzSpawnModel"),
    "include": _make_include,
    "let": _make_pair(actions.SetLaunchConfiguration),
    "log": lambda e: actions.LogInfo(msg=e.need("message")),
    "log_info": lambda e: actions.LogInfo(msg=e.need("message")),
    "lifecycle_node": _make_node,
    "load_composable_node": _make_components,
    "node": _make_node,
    "node_container": _make_components,
    "push-ros-namespace": lambda e: actions.PushRosNamespace(e.need("namespace")),
    "push_ros_namespace": lambda e: actions.PushRosNamespace(e.need("namespace")),
    "ros_gz_bridge": _make_gazebo("RosGzBridge"),
    "ros_timer": _make_timer,
    "set_env": _make_pair(actions.SetEnvironmentVariable),
    "append_env": _make_pair(actions.AppendEnvironmentVariable),
    "set_parameter": _make_set_parameter,
    "set_parameters_from_file": lambda e: actions.SetParametersFromFile(
        e.need("filename")
    ),
    "set_remap": _make_pair(actions.SetRemap, "from", "to"),
    "set_use_sim_time": lambda e: actions.SetUseSimTime(
        parameters.ParameterValue(e.need("value"))
    ),
    "shutdown": lambda e: actions.Shutdown(),
    "timer": _make_timer,
    "unset_env": lambda e: actions.UnsetEnvironmentVariable(e.need("name")),
}


def _make_action(element: _Element) -> Any:
    if element.tag not in _MAKERS:
        known = ", ".join(sorted(_MAKERS))
        text = f"unknown <{element.tag}>; known: {known}"
        raise LaunchError(text, line=element.line)
    try:
        action = _MAKERS[element.tag](element)
        action.condition = element.condition
    except KeyError as error:
        text = f"<{element.tag}> has no attribute {error.args[0]!r}"
        raise LaunchError(text, line=element.line) from None
    except LaunchError as error:
        raise error.at(element.line) from None
    action.line = element.line
    return action


def _make_actions(element: _Element) -> list[Any]:
    return [_make_action(child) for child in element.children]


def _read_data(path: Path, text: str) -> LaunchDescription:
    """Return what an XML or YAML launch file describes."""
    is_xml = path.suffix == ".xml" or text.lstrip().startswith("<")
    root = _parse_xml(text) if is_xml else _parse_yaml(text)
    return LaunchDescription(_make_actions(root))


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
    except RecursionError:
        if path.suffix == ".py":
            raise
        raise LaunchError(f"{path}: elements are nested too deeply") from None
    except LaunchError as error:
        if str(path) in str(error):
            raise
        raise LaunchError(f"{path}: {error}", error.line) from None
