"""Fields of a step of a motion file: checked values, or an error with their place."""

import dataclasses as dc
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from arm_drake.errors import MotionError, suggest
from arm_drake.messages import Duration, Time

T = TypeVar("T", bound=Time)


class Fields:
    """Checks the fields of one step; places are given from the step on."""

    def __init__(self, step: str, file: Path | None) -> None:
        """Create it.

        Args:
            step: Place of the step, such as "[0]".
            file: File of the step.
        """
        self.step = step
        self._file = file

    def error(self, where: str, problem: str) -> MotionError:
        """Return an error about a field; "" is the step itself."""
        place = f"{self.step}.{where}" if where else self.step
        return MotionError(problem, file=self._file, where=place)

    def mapping(
        self, value: Any, where: str, known: Iterable[str] | None = None
    ) -> Mapping[str, Any]:
        """Return a mapping, with no other keys than those known, if any are."""
        if not isinstance(value, Mapping):
            raise self.error(where, f"expected a mapping, got {value!r}")
        names = list(known or ())
        for key in value if known is not None else ():
            if key not in names:
                hint = suggest(str(key), names)
                raise self.error(where, f"unknown key {key!r}; {hint}")
        return value

    def list(self, value: Any, where: str) -> Sequence[Any]:
        """Return a list."""
        if not isinstance(value, list):
            raise self.error(where, f"expected a list, got {value!r}")
        return value

    def names(self, value: Any, where: str) -> tuple[str, ...]:
        """Return a list of names."""
        names = self.list(value, where)
        for name in names:
            if not isinstance(name, str):
                raise self.error(where, f"expected names, got {name!r}")
        return tuple(names)

    def number(self, value: Any, where: str) -> float:
        """Return a finite number."""
        if type(value) not in (int, float) or not abs(value) < math.inf:
            raise self.error(where, f"expected a finite number, got {value!r}")
        try:
            return float(value)
        except OverflowError:
            raise self.error(where, "the number is out of range") from None

    def numbers(self, value: Any, where: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        return tuple(
            self.number(number, f"{where}[{index}]")
            for index, number in enumerate(self.list(value, where))
        )

    def time(self, kind: type[T], value: Any, where: str) -> T:
        """Return a time, given in seconds or as {sec, nanosec}."""
        try:
            return kind.of(value)
        except ValueError as error:
            raise self.error(where, str(error)) from None
        except OverflowError:
            raise self.error(where, f"{value!r} s is out of range") from None

    def seconds(self, value: Any, where: str) -> float:
        """Return a duration of at least 0 s [s]."""
        seconds = self.time(Duration, value, where).to_seconds()
        if seconds < 0.0:
            raise self.error(where, f"expected at least 0 s, got {value!r}")
        return seconds

    def build(self, kind: Callable[..., Any], value: Any, where: str) -> Any:
        """Return a message whose fields are numbers, vectors, a time and a name."""
        fields = [field.name for field in dc.fields(kind)]  # type: ignore[arg-type]
        data = self.mapping(value, where, fields)
        for name in set(data) & {"position", "velocity", "acceleration"}:
            self.number(data[name], f"{where}.{name}")
        for name in set(data) & {"positions", "velocities", "accelerations", "effort"}:
            self.numbers(data[name], f"{where}.{name}")
        try:
            return kind(**data)
        except (TypeError, ValueError, OverflowError) as error:
            raise self.error(where, str(error)) from None
