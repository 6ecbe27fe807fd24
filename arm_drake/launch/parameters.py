"""Parameters of the nodes of a launch file: values, files, and what rewrites them.

They have the names of `launch_ros.parameter_descriptions` and `nav2_common.launch`.
"""

import datetime
import sys
import tempfile
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from arm_drake.launch.substitutions import (
    KEY,
    LaunchContext,
    Substitution,
    SubstitutionFailure,
    is_substitution,
    parse_substitution,
    perform,
)


def read_text(path: str) -> str:
    """Return the text of a file of parameters."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SubstitutionFailure(f"{path} can't be read: {reason}") from None


def read_parameter_file(path: str) -> Any:
    """Return what a YAML file of parameters holds."""
    try:
        return yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise SubstitutionFailure(f"{path} can't be read: {reason}") from None
    except RecursionError:
        raise SubstitutionFailure(f"{path} is nested too deeply") from None


def save_parameters(
    context: LaunchContext, text: str, source: str, *, has_its_lines: bool
) -> str:
    """Return the name of a new file with the rewritten text of another one."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as file:
        file.write(context.filled(text))
    # One that was rewritten before is so again.
    first, had_its_lines = context.rewritten.get(source, (source, True))
    context.rewritten[file.name] = (first, has_its_lines and had_its_lines)
    return file.name


def read_value(text: str) -> Any:
    """Return a value of a parameter as a command line or an XML file has it."""
    if KEY.fullmatch(text):
        return text
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    return found if isinstance(found, bool | int | float | list) else text


class RewrittenYaml(Substitution):
    """A YAML file with some values replaced, of `nav2_common.launch`."""

    def __init__(
        self,
        source_file: Any,
        param_rewrites: Mapping[str, Any] = types.MappingProxyType({}),
        root_key: Any = None,
        key_rewrites: Mapping[str, Any] | None = None,
        convert_types: bool = False,
        **kwargs: Any,
    ) -> None:
        super().__init__(source_file)
        self.param_rewrites, self.root_key = dict(param_rewrites), root_key
        self.convert_types, self.key_rewrites = convert_types, dict(key_rewrites or {})

    def text_of(self, context: LaunchContext) -> str:
        values = {
            name: yaml.safe_load(text) if self.convert_types else text
            for name, value in self.param_rewrites.items()
            for text in [perform(context, value)]
        }
        keys = {name: perform(context, k) for name, k in self.key_rewrites.items()}

        def rewrite(data: Any, path: str) -> Any:
            if not isinstance(data, Mapping):
                return data
            found = {}
            for key, value in data.items():
                full = f"{path}.{key}" if path else str(key)
                is_leaf = not isinstance(value, Mapping)
                if full in values or (is_leaf and key in values):
                    value = values.get(full, values.get(key))
                found[keys.get(key, key)] = rewrite(value, full)
            return found

        path = perform(context, self.args[0])
        data = rewrite(read_parameter_file(path), "")
        root = "" if self.root_key is None else perform(context, self.root_key)
        text = yaml.safe_dump({root: data} if root else data)
        return save_parameters(context, text, path, has_its_lines=False)


class ReplaceString(Substitution):
    """A file with some texts replaced, of `nav2_common.launch`."""

    def __init__(
        self, source_file: Any, replacements: Mapping[str, Any], condition: Any = None
    ) -> None:
        super().__init__(source_file)
        self.replacements, self.condition = replacements, condition

    def text_of(self, context: LaunchContext) -> str:
        path = perform(context, self.args[0])
        if self.condition is not None and not self.condition.evaluate(context):
            return path
        text = read_text(path)
        for old, new in self.replacements.items():
            text = text.replace(old, perform(context, new))
        return save_parameters(context, text, path, has_its_lines=True)


class HasNodeParams(Substitution):
    """Test for a node's parameters in a file, of `nav2_common.launch`."""

    def __init__(self, source_file: Any, node_name: str) -> None:
        super().__init__(source_file)
        self.node_name = node_name

    def text_of(self, context: LaunchContext) -> str:
        data = read_parameter_file(perform(context, self.args[0]))
        return str(isinstance(data, Mapping) and self.node_name in data)


class LaunchConfigAsBool(Substitution):
    """A configuration as "True" or "False", of `nav2_common.launch`."""

    def text_of(self, context: LaunchContext) -> str:
        name = perform(context, self.args[0])
        text = context.launch_configurations.get(name, "")
        return str(text.strip().lower() in ("true", "1", "yes", "on", "t", "y"))


class ParseMultiRobotPose(Substitution):
    """Robots and their poses by name, of `nav2_common.launch`.

    In an argument such as `one={x: 1.0, yaw: 3.1}; two={y: 2.0}`. In Jazzy it is the
    name of one on the command line, later what a configuration holds.
    """

    def value(self) -> dict[str, dict[str, float]]:
        """Return the poses of an argument on the command line."""
        start = f"{self.args[0]}:="
        return _poses_of(
            next((w.removeprefix(start) for w in sys.argv if w.startswith(start)), "")
        )

    def perform(self, context: LaunchContext) -> Any:
        text = self.args[0]
        return _poses_of(text if isinstance(text, str) else perform(context, text))


_AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def _poses_of(text: str) -> dict[str, dict[str, float]]:
    """Return poses by robot; an axis that isn't said is 0."""
    poses = {}
    for part in filter(str.strip, text.split(";")):
        name, _, pose = part.partition("=")
        try:
            data = yaml.safe_load(pose)
        except (yaml.YAMLError, RecursionError):
            data = None
        if not isinstance(data, Mapping):
            problem = "expected NAME={x: 0.0, y: 0.0, yaw: 0.0}; ..."
            raise SubstitutionFailure(f"robots {text[:200]!r}: {problem}")
        poses[name.strip()] = {**dict.fromkeys(_AXES, 0.0), **data}
    return poses


# What `nav2_common.launch` has.
OF_NAV2 = (
    HasNodeParams,
    LaunchConfigAsBool,
    ParseMultiRobotPose,
    ReplaceString,
    RewrittenYaml,
)


class ParameterValue:
    """A value of a parameter, with the type that it must have."""

    def __init__(self, value: Any, *, value_type: Any = None) -> None:
        """Take the value."""
        self.value, self.value_type = value, value_type

    def evaluate(self, context: LaunchContext) -> Any:
        """Return the value."""
        value = _evaluate(context, self.value, is_text=self.value_type is str)
        is_simple = self.value_type in (bool, int, float, str)
        return self.value_type(value) if is_simple else value


class ParameterFile:
    """A YAML file of parameters, in which substitutions may be."""

    def __init__(self, param_file: Any, *, allow_substs: Any = False) -> None:
        """Take the path."""
        self.param_file, self.allow_substs = param_file, allow_substs

    def evaluate(self, context: LaunchContext) -> str:
        """Return the path of the file, or of one with the texts in their places."""
        path = perform(context, self.param_file)
        allowed = self.allow_substs
        if not isinstance(allowed, bool):
            allowed = perform(context, allowed).lower() in ("true", "1")
        if not allowed:
            return path
        text = read_text(path)
        text = perform(context, parse_substitution(text))
        return save_parameters(context, text, path, has_its_lines=True)


class Parameter(ParameterValue):
    """A parameter with its name."""

    def __init__(self, name: Any, value: Any = None, **kwargs: Any) -> None:
        """Take name and value."""
        super().__init__(value, value_type=kwargs.get("value_type"))
        self.name = name


def read_parameters(context: LaunchContext, source: Any) -> Any:
    """Return the path of a file of parameters, or a mapping of their values."""
    if isinstance(source, Parameter):
        return {perform(context, source.name): source.evaluate(context)}
    if isinstance(source, ParameterFile):
        return source.evaluate(context)
    if not isinstance(source, Mapping):
        return perform(context, source)
    flat: dict[str, Any] = {}
    for name, value in source.items():
        key = perform(context, name)
        if isinstance(value, Mapping):
            inner = read_parameters(context, value)
            flat |= {f"{key}.{k}": v for k, v in inner.items()}
        else:
            flat[key] = _evaluate(context, value)
    return flat


def _evaluate(context: LaunchContext, value: Any, *, is_text: bool = False) -> Any:
    """Return a value of a parameter; what substitutions stand for is read as YAML."""
    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if is_substitution(value):
        text = perform(context, value)
        return text if is_text else read_value(text)
    if isinstance(value, datetime.date):  # As text, which JSON has, too.
        return str(value)
    if isinstance(value, set | frozenset):
        value = sorted(value, key=str)
    if isinstance(value, list | tuple):
        return [_evaluate(context, each) for each in value]
    if isinstance(value, str):
        return context.key_of(value)
    return str(value) if isinstance(value, Path) else value
