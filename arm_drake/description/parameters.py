"""Typed loading: flat ROS parameters into a frozen parameter dataclass.

A schema is a dataclass whose field names are the parameters' names. A field that is a
dataclass is a group (`constraints.goal_time`). A field with the metadata of
`per_element_of` is a group per element of another parameter
(`constraints.<joint>.goal`). A plain `dict[str, Any]` takes all that lies below it.

The default of a field is jazzy's. What is different in other distros stands in a `Rule`
beside its type: `rate: Annotated[float, Rule(humble=50.0)] = 20.0`. What takes more
than a rule is done by the schema's static method ``adapt``, on the `ParameterGroup`.

Parameters as a YAML gives them, and the place of each of them.

A schema that renames or recomputes older parameters does so on the `ParameterGroup`,
before they become its fields.
"""

import dataclasses as dc
import functools
import math
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import ParameterError, did_you_mean, find_close
from arm_drake.importing import dataclass

# Distributions with rules of their own, the oldest first.
DISTROS = ("humble", "jazzy", "kilted", "rolling")


@dataclass(frozen=True)
class Parameter:
    """A value and the place where it was written."""

    value: Any
    file: Path
    line: int


# Parameters of one node by their full dotted name.
Parameters = Mapping[str, Parameter]


class NodeParameters:
    """Parameters of one node, which loading changes, and their report."""

    def __init__(
        self,
        parameters: Parameters,
        node: str,
        file: Path,
        report: LoadReport,
        distro: str,
    ) -> None:
        """Copy the parameters; `file` is named when one is missing."""
        self.name = node
        self.file = file
        self.distro = distro
        self.by_name = dict(parameters)

        # Names that stand in the place of older ones.
        self.adapted: set[str] = set()
        self._report = report

    def add(
        self, name: str, severity: Severity, kind: Kind, what: str, done: str
    ) -> None:
        """Add a line about a parameter to the report."""
        where, parameter = f"{self.name}.{name}", self.by_name[name]
        self._report.add(severity, kind, what, done, where=where, at=parameter)

    def reject(self, name: str, problem: str) -> NoReturn:
        """Raise ParameterError for a parameter."""
        where, parameter = f"{self.name}.{name}", self.by_name[name]
        raise ParameterError(problem, where=where, at=parameter)

    def convert(self, expected: Any, parameter: Parameter, name: str) -> Any:
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
                    self.convert(args[0], dc.replace(parameter, value=item), name)
                    for item in value
                )
            expectation = f"a list of {args[0].__name__}"
        # A bool is an int too: keep it out. rcl takes larger numbers for doubles.
        elif expected is float and type(value) is int and abs(value) < 2**63:
            what = f"{value} is an integer; ros2_control refuses it for a double"
            self.add(name, "info", "repair", what, f"taken as {float(value)}")
            return float(value)
        elif type(value) is expected:
            return value
        else:
            expectation = str(expected.__name__)
        self.reject(name, f"expected {expectation}, got {value!r}")


class ParameterGroup:
    """Parameters of one group as in the file, for its schema to adapt."""

    def __init__(self, node: NodeParameters, prefix: str) -> None:
        """Create a view; only the loader does."""
        self._node = node
        self._prefix = prefix
        self.distro = node.distro

    def __contains__(self, name: str) -> bool:
        """Return whether a parameter is set."""
        return self._prefix + name in self._node.by_name

    def is_before(self, distro: str) -> bool:
        """Return whether the distro is older than another."""
        return DISTROS.index(self.distro) < DISTROS.index(distro)

    def first_of(self, group: str) -> str | None:
        """Return the first parameter of a nested group; None if it is empty."""
        start = f"{self._prefix}{group}."
        names = (name for name in self._node.by_name if name.startswith(start))
        first = next(names, None)
        return first and first.removeprefix(self._prefix)

    def group(self, group: str) -> dict[str, Any]:
        """Return the values of a nested group as they are, by names within it."""
        start = f"{self._prefix}{group}."
        return {
            name.removeprefix(start): parameter.value
            for name, parameter in self._node.by_name.items()
            if name.startswith(start)
        }

    def get(self, name: str, expected: Any) -> Any:
        """Return a parameter as the ``expected`` type; None if it is unset."""
        name = self._prefix + name
        parameter = self._node.by_name.get(name)
        return parameter and self._node.convert(expected, parameter, name)

    def warn_of_nan(self, name: str, done: str) -> None:
        """Add a line about a number that is NaN, which upstream takes."""
        number = self.get(name, float)
        if number is not None and math.isnan(number):
            self.add(name, "warning", "ignored", "it is not a number", done)

    def replace(self, old: str, new: Mapping[str, Any]) -> None:
        """Replace a parameter by newer ones, with a line in the report.

        A newer one that is given itself stays as it is.
        """
        parameters = self._node.by_name
        taken = {n: v for n, v in new.items() if n == old or n not in self}
        listed = ", ".join(f"{n}: {value}" for n, value in new.items() if n != old)
        what = f"older parameter; later: {listed}"
        if taken:
            self.add(old, "info", "repair", what, "taken as that")
        else:
            self.add(old, "warning", "ignored", what, "it has no effect")
        parameter = parameters.pop(self._prefix + old)
        for name, value in taken.items():
            parameters[self._prefix + name] = dc.replace(parameter, value=value)
            self._node.adapted.add(self._prefix + name)

    def rename(self, old: str, new: str) -> None:
        """Rename a parameter that is set by its old name."""
        if old in self:
            self.replace(old, {new: self._node.by_name[self._prefix + old].value})

    def set(self, name: str, value: Any) -> None:
        """Change the value of a parameter."""
        name = self._prefix + name
        parameters = self._node.by_name
        parameters[name] = dc.replace(parameters[name], value=value)
        self._node.adapted.add(name)

    def drop(self, name: str) -> None:
        """Remove a parameter; a line in the report is the caller's."""
        del self._node.by_name[self._prefix + name]

    def add(
        self, name: str, severity: Severity, kind: Kind, what: str, done: str
    ) -> None:
        """Add a line about a parameter to the report."""
        self._node.add(self._prefix + name, severity, kind, what, done)

    def reject(self, name: str, problem: str) -> NoReturn:
        """Raise ParameterError for a parameter."""
        self._node.reject(self._prefix + name, problem)


__all__ = [
    "DISTROS",
    "Parameter",
    "ParameterGroup",
    "Parameters",
    "Rule",
    "load_parameters",
    "per_element_of",
]

T = typing.TypeVar("T")

# Of every controller, and without meaning in a simulation.
_OF_THREADS = ("is_async", "thread_priority", "async_parameters")


@dataclass(frozen=True)
class Rule:
    """Rules of a parameter besides its type and its default."""

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
    """Return a field: a group of parameters per element of a list, as "joints"."""
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
        given = node_parameters.by_name[name]
        # It is no misspelling of those that its file has beside it.
        beside = {
            other
            for other in loader.used & node_parameters.by_name.keys()
            if node_parameters.by_name[other].file == given.file
        }
        what = _explain_unknown(name, given.value, loader.known, loader.known - beside)
        node_parameters.add(name, "warning", "ignored", what, "it has no effect")
    return result


def _explain_unknown(name: str, value: Any, known: set[str], meant: set[str]) -> str:
    """Return what is wrong with a parameter that no schema has, and what is meant."""
    start = f"{name}."
    below = [key.removeprefix(start) for key in known if key.startswith(start)]
    keys = {key.partition(".")[0] for key in below}
    if keys:
        return f"expected a mapping of {', '.join(sorted(keys))}, got {value!r}"
    return f"unknown parameter{did_you_mean(name, meant, 0.7)}"


@functools.cache
def _hints_of(schema: type) -> dict[str, Any]:
    """Return the types of a schema's fields; to read them costs more than a load."""
    return typing.get_type_hints(schema, include_extras=True)


class _Loader:
    """Loads one node's parameters and remembers which of them were used."""

    def __init__(self, node: NodeParameters) -> None:
        self._node = node
        self._lists: dict[str, tuple[str, ...]] = {}
        self.used: set[str] = set()
        self.known: set[str] = set()

    def load(self, schema: type[T], prefix: str) -> T:
        group = ParameterGroup(self._node, prefix)
        adapt = getattr(schema, "adapt", None)
        if adapt is not None:
            adapt(group)
        hints = _hints_of(schema)  # type: ignore[arg-type]
        values: dict[str, Any] = {}
        for field in dc.fields(schema):  # type: ignore[arg-type]
            expected, rule = hints[field.name], Rule()
            if typing.get_origin(expected) is typing.Annotated:
                expected, rule = typing.get_args(expected)
            for old in rule.was:
                group.rename(old, field.name)
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
                group.add(field.name, "warning", "unsupported", what, done)
            if value is not dc.MISSING:
                values[field.name] = value
            elif field.default_factory is dc.MISSING:
                raise self._missing(prefix + field.name, schema, prefix)
        try:
            return schema(**values)
        except ValueError as error:  # from the schema's own __post_init__
            places = [self._node.by_name.get(prefix + key) for key in values]
            first = next(filter(None, places), None)
            # Its message begins with the name of what is wrong.
            wrong = self._node.by_name.get(
                prefix + str(error).partition(" ")[0].rstrip(":,")
            )
            first = wrong or first
            raise ParameterError(
                str(error),
                file=first.file if first else self._node.file,
                line=wrong.line if wrong else None,
                where=f"{self._node.name}.{prefix}".rstrip("."),
            ) from None

    def _missing(self, name: str, schema: type[T], prefix: str) -> ParameterError:
        """Return the error of a parameter that is missing or misspelt."""
        names = {prefix + field.name for field in dc.fields(schema)}  # type: ignore[arg-type]
        others = {key: p for key, p in self._node.by_name.items() if key not in names}
        close = find_close(name, others, 0.7)
        instead = f", {close!r} is given instead" if close else ""
        return ParameterError(
            f"is required but missing{instead}",
            file=others[close].file if close else self._node.file,
            line=others[close].line if close else None,
            where=f"{self._node.name}.{name}",
        )

    def _sort_out(self, rule: Rule, name: str, default: Any) -> None:
        """Report what the distro doesn't have, and drop it unless it is kept."""
        parameters, distro = self._node.by_name, self._node.distro
        if rule.knows(distro):
            return
        is_old = DISTROS.index(distro) > DISTROS.index(rule.until)
        below = [key for key in parameters if key == name or key.startswith(f"{name}.")]
        for key in below:
            # What was put in the place of an older parameter is there for this distro.
            if key in self._node.adapted and not is_old:
                continue
            if parameters[key].value != default:
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
                del parameters[key]

    def _value(self, field: "dc.Field[Any]", expected: Any, prefix: str) -> Any:
        """Return the value of a field; MISSING if it is an unset parameter."""
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


# Longer than any duration in ROS, which counts 64 bit nanoseconds [s].
_LONGEST = 2.0**63 / 1e9


def _require(
    owner: Any, names: Iterable[str], is_right: Callable[[float], bool], rule: str
) -> None:
    """Raise ValueError for a number that isn't right."""
    for name in names:
        value = getattr(owner, name)
        if not is_right(value):
            raise ValueError(f"{name} must be {rule}, got {value}")


def check_finite(owner: Any, *names: str) -> None:
    """Raise ValueError for a number that isn't finite."""
    _require(owner, names, math.isfinite, "a finite number")


def check_at_least(owner: Any, low: float, *names: str) -> None:
    """Raise ValueError for a number that isn't finite and at least ``low``."""
    _require(owner, names, lambda x: low <= x < math.inf, f"at least {low:g}")


def check_positive(owner: Any, *names: str) -> None:
    """Raise ValueError for a number that isn't finite and above 0."""
    _require(owner, names, lambda x: 0.0 < x < math.inf, "above 0")


def check_not_zero(owner: Any, *names: str) -> None:
    """Raise ValueError for a number that is 0 or isn't finite."""
    rule = "a finite number and not 0"
    _require(owner, names, lambda x: math.isfinite(x) and x != 0.0, rule)


def check_duration(owner: Any, *names: str) -> None:
    """Raise ValueError for a duration [s] that doesn't fit in 64 bit nanoseconds."""
    _require(owner, names, lambda x: abs(x) < _LONGEST, "a number of seconds")


def check_within(owner: Any, low: float, high: float, *names: str) -> None:
    """Raise ValueError for a number, or an element of a list, out of bounds."""
    for name in names:
        value = getattr(owner, name)
        for number in value if isinstance(value, tuple) else (value,):
            if not low <= number <= high:
                raise ValueError(f"{name} must be in [{low:g}, {high:g}], got {number}")


def check_not_empty(owner: Any, *names: str) -> None:
    """Raise ValueError for an empty string or list."""
    for name in names:
        value = getattr(owner, name)
        if value == ():
            raise ValueError(f"{name} must have at least one element")
        if value == "":
            raise ValueError(f"{name} must not be empty, got ''")


def check_unique(owner: Any, *names: str) -> None:
    """Raise ValueError for a list that has an element twice."""
    for name in names:
        values = getattr(owner, name)
        if len(set(values)) != len(values):
            raise ValueError(f"{name} must not repeat elements, got {list(values)}")


def check_length(owner: Any, length: int, *names: str) -> None:
    """Raise ValueError for a list that doesn't have ``length`` elements."""
    for name in names:
        values = getattr(owner, name)
        if len(values) != length:
            raise ValueError(
                f"{name} must have {length} elements, got {len(values)}: {list(values)}"
            )
