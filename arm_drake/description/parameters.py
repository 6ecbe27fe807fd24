"""Typed loading: flat ROS parameters into a frozen parameter dataclass.

A schema is a dataclass whose field names are the parameters' names. A field that is a
dataclass is a group (`constraints.goal_time`). A field with the metadata of
`per_element_of` is a group per element of another parameter
(`constraints.<joint>.goal`).
"""

import dataclasses as dc
import difflib
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError

T = typing.TypeVar("T")


@dc.dataclass(frozen=True)
class Parameter:
    """A value and the place where it was written."""

    value: Any
    file: Path
    line: int


# Parameters of one node by their full dotted name.
Parameters = Mapping[str, Parameter]


def per_element_of(parameter: str) -> Any:
    """Return a field: a group of parameters per element of a string list.

    Args:
        parameter: Name of the list at the top of the schema, such as "joints".
    """
    return dc.field(default_factory=dict, metadata={"per_element_of": parameter})


def load_parameters(
    schema: type[T], parameters: Parameters, node: str, file: Path, report: LoadReport
) -> T:
    """Build a ``schema`` dataclass from the parameters of a node.

    Args:
        schema: Dataclass to build. Fields without a default are required.
        parameters: Parameters of the node.
        node: Name of the node, for messages.
        file: File to name when a parameter is missing.
        report: Where parameters that have no effect are recorded.

    Raises:
        ParameterError: If a parameter is missing, of the wrong type or out of range.
    """
    loader = _Loader(parameters, node, file, report)
    result = loader.load(schema, "")
    for name in sorted(set(parameters) - loader.used):
        parameter = parameters[name]
        report.add(
            "info",
            "ignored",
            f"unknown parameter{_closest(name, loader.known)}",
            "it has no effect",
            where=f"{node}.{name}",
            file=parameter.file,
            line=parameter.line,
        )
    return result


def _closest(name: str, known: set[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return f"; did you mean {close[0]!r}?" if close else ""


class _Loader:
    """Loads one node's parameters and remembers which of them were used."""

    def __init__(
        self, parameters: Parameters, node: str, file: Path, report: LoadReport
    ) -> None:
        self._parameters = parameters
        self._node = node
        self._file = file
        self._report = report
        self._lists: dict[str, tuple[str, ...]] = {}
        self.used: set[str] = set()
        self.known: set[str] = set()

    def load(self, schema: type[T], prefix: str) -> T:
        hints = typing.get_type_hints(schema)
        values: dict[str, Any] = {}
        for field in dc.fields(schema):  # type: ignore[arg-type]
            name, expected = prefix + field.name, hints[field.name]
            elements = field.metadata.get("per_element_of")
            if elements is not None:
                group = typing.get_args(expected)[1]
                names = self._lists.get(elements, ())
                values[field.name] = {
                    element: self.load(group, f"{prefix}{element}.")
                    for element in names
                }
                continue
            if dc.is_dataclass(expected):
                values[field.name] = self.load(typing.cast(type, expected), f"{name}.")
                continue
            self.known.add(name)
            parameter = self._parameters.get(name)
            if parameter is not None:
                self.used.add(name)
                values[field.name] = self._convert(expected, parameter, name)
                if isinstance(values[field.name], tuple):
                    self._lists[name] = values[field.name]
            elif field.default is dc.MISSING and field.default_factory is dc.MISSING:
                raise ParameterError(
                    "is required but missing",
                    file=self._file,
                    where=f"{self._node}.{name}",
                )
        try:
            return schema(**values)
        except ValueError as error:  # from the schema's own __post_init__
            first = next(
                (
                    self._parameters[prefix + key]
                    for key in values
                    if prefix + key in self._parameters
                ),
                None,
            )
            raise ParameterError(
                str(error),
                file=first.file if first else self._file,
                where=f"{self._node}.{prefix}".rstrip("."),
            ) from None

    def _convert(self, expected: Any, parameter: Parameter, name: str) -> Any:
        """Return a value as the ``expected`` type, or raise ParameterError."""
        origin, args = typing.get_origin(expected), typing.get_args(expected)
        value = parameter.value
        if origin is typing.Literal:
            if value in args and type(value) in {type(arg) for arg in args}:
                return value
            expectation = f"one of {list(args)}"
        elif origin is tuple:
            if isinstance(value, list):
                return tuple(
                    self._convert(args[0], dc.replace(parameter, value=item), name)
                    for item in value
                )
            expectation = f"a list of {args[0].__name__}"
        # A bool is an int too: keep it out. rcl takes larger numbers for doubles.
        elif expected is float and type(value) is int and abs(value) < 2**63:
            self._report.add(
                "info",
                "repair",
                f"{value} is an integer; ros2_control refuses it for a double",
                f"taken as {float(value)}",
                where=f"{self._node}.{name}",
                file=parameter.file,
                line=parameter.line,
            )
            return float(value)
        elif type(value) is expected:
            return value
        else:
            expectation = str(expected.__name__)
        raise ParameterError(
            f"expected {expectation}, got {value!r}",
            file=parameter.file,
            line=parameter.line,
            where=f"{self._node}.{name}",
        )
