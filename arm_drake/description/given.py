"""Parameters as a YAML gives them, and the place of each of them.

A schema that renames or recomputes older parameters does so on `Given`, before they
become its fields.
"""

import dataclasses as dc
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import ParameterError

# Distributions with rules of their own, the oldest first.
DISTROS = ("humble", "jazzy", "kilted", "rolling")


@dc.dataclass(frozen=True)
class Parameter:
    """A value and the place where it was written."""

    value: Any
    file: Path
    line: int


# Parameters of one node by their full dotted name.
Parameters = Mapping[str, Parameter]


class NodeParameters:
    """The given parameters of one node, which loading changes, and their report."""

    def __init__(
        self,
        parameters: Parameters,
        node: str,
        file: Path,
        report: LoadReport,
        distro: str,
    ) -> None:
        """Copy what is given.

        Args:
            parameters: Parameters of the node.
            node: Name of the node, for messages.
            file: File to name when a parameter is missing.
            report: Where lines about parameters go.
            distro: Distribution whose defaults and names hold, one of `DISTROS`.
        """
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
        """Add a line about a given parameter to the report."""
        parameter = self.by_name[name]
        self._report.add(
            severity,
            kind,
            what,
            done,
            where=f"{self.name}.{name}",
            file=parameter.file,
            line=parameter.line,
        )

    def reject(self, name: str, problem: str) -> NoReturn:
        """Raise ParameterError for a given parameter."""
        parameter = self.by_name[name]
        raise ParameterError(
            problem,
            file=parameter.file,
            line=parameter.line,
            where=f"{self.name}.{name}",
        )

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


class Given:
    """The parameters of one group as they were given, for its schema to adapt."""

    def __init__(self, node: NodeParameters, prefix: str) -> None:
        """Create a view; only the loader does."""
        self._node = node
        self._prefix = prefix
        self.distro = node.distro

    def __contains__(self, name: str) -> bool:
        """Return whether a parameter is given."""
        return self._prefix + name in self._node.by_name

    def is_before(self, distro: str) -> bool:
        """Return whether the distro is older than another."""
        return DISTROS.index(self.distro) < DISTROS.index(distro)

    def first_of(self, group: str) -> str | None:
        """Return the first given parameter of a nested group; None if there is none."""
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
        """Return a parameter as the ``expected`` type; None if it isn't given."""
        name = self._prefix + name
        parameter = self._node.by_name.get(name)
        return parameter and self._node.convert(expected, parameter, name)

    def replace(self, old: str, new: Mapping[str, Any]) -> None:
        """Put newer parameters in the place of a given one, with a line in the report.

        Args:
            old: Name of the given one.
            new: Values by newer names. One that is given itself stays as it is.
        """
        given = self._node.by_name
        taken = {n: v for n, v in new.items() if n == old or n not in self}
        listed = ", ".join(f"{n}: {value}" for n, value in new.items() if n != old)
        what = f"older parameter; later: {listed}"
        if taken:
            self.add(old, "info", "repair", what, "taken as that")
        else:
            self.add(old, "warning", "ignored", what, "it has no effect")
        parameter = given.pop(self._prefix + old)
        for name, value in taken.items():
            given[self._prefix + name] = dc.replace(parameter, value=value)
            self._node.adapted.add(self._prefix + name)

    def rename(self, old: str, new: str) -> None:
        """Give a parameter its newer name, if it is given by the old one."""
        if old in self:
            self.replace(old, {new: self._node.by_name[self._prefix + old].value})

    def set(self, name: str, value: Any) -> None:
        """Change the value of a given parameter."""
        name = self._prefix + name
        given = self._node.by_name
        given[name] = dc.replace(given[name], value=value)
        self._node.adapted.add(name)

    def drop(self, name: str) -> None:
        """Take a given parameter away; a line in the report is the caller's."""
        del self._node.by_name[self._prefix + name]

    def add(
        self, name: str, severity: Severity, kind: Kind, what: str, done: str
    ) -> None:
        """Add a line about a given parameter to the report."""
        self._node.add(self._prefix + name, severity, kind, what, done)

    def reject(self, name: str, problem: str) -> NoReturn:
        """Raise ParameterError for a given parameter."""
        self._node.reject(self._prefix + name, problem)
