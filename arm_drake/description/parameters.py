"""Typed loading: flat ROS parameters into a frozen parameter dataclass.

A schema is a dataclass whose field names are the parameters' names. A field that is a
dataclass is a group (`constraints.goal_time`). A field with the metadata of
`per_element_of` is a group per element of another parameter
(`constraints.<joint>.goal`). A plain `dict[str, Any]` takes all that lies below it.

The default of a field is jazzy's. What is different in other distros stands in a `Rule`
beside its type: `rate: Annotated[float, Rule(humble=50.0)] = 20.0`. What takes more
than a rule is done by the schema's static method ``adapt``, on what was `Given`.
"""

import dataclasses as dc
import difflib
import typing
from pathlib import Path
from typing import Any

from arm_drake.description.given import (
    DISTROS,
    Given,
    NodeParameters,
    Parameter,
    Parameters,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError

__all__ = [
    "DISTROS",
    "Given",
    "Parameter",
    "Parameters",
    "Rule",
    "load_parameters",
    "per_element_of",
]

T = typing.TypeVar("T")

# Of every controller, and without meaning in a simulation.
_OF_THREADS = ("is_async", "thread_priority", "async_parameters")


@dc.dataclass(frozen=True)
class Rule:
    """What is to say of a parameter besides its type and its default."""

    # Defaults of other distros; `...` is the field's.
    humble: Any = ...
    kilted: Any = ...
    rolling: Any = ...

    # First and last distro that have it. In others it is reported.
    since: str = DISTROS[0]
    until: str = DISTROS[-1]

    # Whether it is taken in distros without it; if not, it is ignored.
    is_kept: bool = False

    # Whether nothing is lost where it is ignored.
    is_harmless: bool = False

    # What acts in its place in distros without it.
    instead: str = ""

    # Older names.
    was: tuple[str, ...] = ()

    # The only value that the controller acts on so far; `...` is every one.
    only: Any = ...

    def knows(self, distro: str) -> bool:
        """Return whether a distro has the parameter."""
        first, at, last = (DISTROS.index(d) for d in (self.since, distro, self.until))
        return first <= at <= last


def per_element_of(parameter: str) -> Any:
    """Return a field: a group of parameters per element of a string list.

    Args:
        parameter: Name of the list at the top of the schema, such as "joints", or of a
            single string.
    """
    return dc.field(default_factory=dict, metadata={"per_element_of": parameter})


def load_parameters(
    schema: type[T],
    parameters: Parameters,
    node: str,
    file: Path,
    report: LoadReport,
    *,
    distro: str = "jazzy",
) -> T:
    """Build a ``schema`` dataclass from the parameters of a node.

    Args:
        schema: Dataclass to build. Fields without a default are required.
        parameters: Parameters of the node.
        node: Name of the node, for messages.
        file: File to name when a parameter is missing.
        report: Where parameters that have no effect are recorded.
        distro: Distribution whose defaults and names hold, one of `DISTROS`.

    Raises:
        ParameterError: If a parameter is missing, of the wrong type or out of range.
    """
    node_parameters = NodeParameters(parameters, node, file, report, distro)
    loader = _Loader(node_parameters)
    result = loader.load(schema, "")
    for name in sorted(node_parameters.by_name.keys() - loader.used):
        if name.partition(".")[0] in _OF_THREADS:
            if node_parameters.by_name[name].value is not False:
                what = "a simulation has no threads"
                node_parameters.add(name, "info", "ignored", what, "it has no effect")
            continue
        what = f"unknown parameter{_closest(name, loader.known)}"
        node_parameters.add(name, "warning", "ignored", what, "it has no effect")
    return result


def _closest(name: str, known: set[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return f"; did you mean {close[0]!r}?" if close else ""


class _Loader:
    """Loads one node's parameters and remembers which of them were used."""

    def __init__(self, node: NodeParameters) -> None:
        self._node = node
        self._lists: dict[str, tuple[str, ...]] = {}
        self.used: set[str] = set()
        self.known: set[str] = set()

    def load(self, schema: type[T], prefix: str) -> T:
        given = Given(self._node, prefix)
        adapt = getattr(schema, "adapt", None)
        if adapt is not None:
            adapt(given)
        hints = typing.get_type_hints(schema, include_extras=True)
        values: dict[str, Any] = {}
        for field in dc.fields(schema):  # type: ignore[arg-type]
            expected, rule = hints[field.name], Rule()
            if typing.get_origin(expected) is typing.Annotated:
                expected, rule = typing.get_args(expected)
            for old in rule.was:
                given.rename(old, field.name)
            default = getattr(rule, self._node.distro, ...)
            if default is ...:
                default = field.default
            self._sort_out(rule, prefix + field.name, default)
            value = self._value(field, expected, prefix)
            if value is dc.MISSING:
                value = default
            elif rule.only not in (..., value):
                done = f"the controller acts as with {rule.only!r}"
                what = f"{value!r} is not acted on yet"
                given.add(field.name, "warning", "unsupported", what, done)
            if value is not dc.MISSING:
                values[field.name] = value
            elif field.default_factory is dc.MISSING:
                raise ParameterError(
                    "is required but missing",
                    file=self._node.file,
                    where=f"{self._node.name}.{prefix}{field.name}",
                )
        try:
            return schema(**values)
        except ValueError as error:  # from the schema's own __post_init__
            places = [self._node.by_name.get(prefix + key) for key in values]
            first = next(filter(None, places), None)
            raise ParameterError(
                str(error),
                file=first.file if first else self._node.file,
                where=f"{self._node.name}.{prefix}".rstrip("."),
            ) from None

    def _sort_out(self, rule: Rule, name: str, default: Any) -> None:
        """Report what the distro doesn't have, and drop it unless it is kept."""
        given, distro = self._node.by_name, self._node.distro
        if rule.knows(distro):
            return
        is_old = DISTROS.index(distro) > DISTROS.index(rule.until)
        below = [key for key in given if key == name or key.startswith(f"{name}.")]
        for key in below:
            # What was put in the place of an older parameter is there for this distro.
            if key in self._node.adapted and not is_old:
                continue
            if given[key].value != default:
                version = f"up to {rule.until}" if is_old else f"since {rule.since}"
                done = "it is taken" if rule.is_kept else "it has no effect"
                self._node.add(
                    key,
                    "info" if rule.is_harmless else "warning",
                    "repair" if rule.is_kept else "ignored",
                    f"a parameter {version} only, not of {distro}",
                    f"{done}: {rule.instead}" if rule.instead else done,
                )
            if not rule.is_kept:
                del given[key]

    def _value(self, field: "dc.Field[Any]", expected: Any, prefix: str) -> Any:
        """Return the value of a field; MISSING if it is a parameter not given."""
        name = prefix + field.name
        elements = field.metadata.get("per_element_of")
        if elements is not None:
            group = typing.get_args(expected)[1]
            return {
                element: self.load(group, f"{prefix}{element}.")
                for element in self._lists.get(elements, ())
            }
        if typing.get_origin(expected) is dict:
            below = {key for key in self._node.by_name if key.startswith(f"{name}.")}
            self.used |= below
            return {
                key.removeprefix(f"{name}."): self._node.by_name[key].value
                for key in sorted(below)
            }
        if dc.is_dataclass(expected):
            return self.load(typing.cast(type, expected), f"{name}.")
        self.known.add(name)
        parameter = self._node.by_name.get(name)
        if parameter is None:
            return dc.MISSING
        self.used.add(name)
        value = self._node.convert(expected, parameter, name)
        if isinstance(value, tuple | str):
            self._lists[name] = value if isinstance(value, tuple) else (value,)
        return value
