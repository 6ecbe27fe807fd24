"""What runs leave behind: values in the order of the inputs, and errors as values."""

import dataclasses as dc
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Generic, TypeVar, overload

from arm_drake.batch.sending import dumps, loads
from arm_drake.batch.stopping import Stop, is_nested
from arm_drake.errors import ArmDrakeError

Value = TypeVar("Value")


class RunError(ArmDrakeError):
    """A run has no result: its process died, or its value can't be sent."""


@dc.dataclass(frozen=True, eq=False)
class Done:
    """A run that has ended, well or not."""

    # Its place in the list of runs.
    index: int

    value: Any
    error: Exception | None

    # How long it took where it ran [s].
    wall_time: float


@dc.dataclass(frozen=True, eq=False)
class RunResult(Generic[Value]):
    """What became of one run."""

    # Its place in the list of runs.
    index: int

    # What was to be run: an element of that list.
    input: Any

    # Why there is no value, if there is none.
    error: Exception | None

    # How long the run took where it ran, loading included [s].
    wall_time: float

    # What was kept of the run. Read it as `value`.
    kept: Value | None = dc.field(default=None, repr=False)

    @property
    def value(self) -> Value:
        """What was kept of the run.

        Raises:
            Exception: The run's error, if it failed.
        """
        if self.error is not None:
            raise self.error
        return self.kept  # type: ignore[return-value]


@dc.dataclass(frozen=True, eq=False)
class RunResults(Sequence[RunResult[Value]]):
    """The results of all runs, in the order in which they were given."""

    results: tuple[RunResult[Value], ...]

    # Where they ran: "serial", "threads" or "processes", and in how many at a time.
    backend: str
    workers: int

    # One line: why there.
    why: str

    # From the first to the last [s].
    wall_time: float

    @overload
    def __getitem__(self, index: int) -> RunResult[Value]: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[RunResult[Value], ...]: ...

    def __getitem__(
        self, index: int | slice
    ) -> RunResult[Value] | tuple[RunResult[Value], ...]:
        """Return one result, or several."""
        return self.results[index]

    def __len__(self) -> int:
        """Return how many runs there were."""
        return len(self.results)

    def __iter__(self) -> Iterator[RunResult[Value]]:
        """Iterate over the results."""
        return iter(self.results)

    @property
    def values(self) -> list[Value]:
        """What was kept of each run.

        Raises:
            Exception: The error of the first run that failed, if one did.
        """
        return [result.value for result in self.results]

    @property
    def failed(self) -> list[RunResult[Value]]:
        """The runs that have an error in the place of a value."""
        return [result for result in self.results if result.error is not None]

    def __str__(self) -> str:
        """Return how it went, and a line for each run that failed."""
        lines = [
            f"{len(self)} runs in {self.wall_time:.2f} s, {len(self.failed)} failed; "
            f"{self.backend}: {self.why}"
        ]
        for result in self.failed:
            lines.append(f"run {result.index}: {_describe(result.error)}")
        return "\n".join(lines)


class RunsInterrupted(KeyboardInterrupt, Generic[Value]):
    """Ctrl-C while runs were under way; what was finished is here."""

    def __init__(self, results: Iterable[RunResult[Value]], num_runs: int) -> None:
        """Create it.

        Args:
            results: Of the runs that were finished, in input order.
            num_runs: How many there were to be.
        """
        self.results = tuple(results)
        super().__init__(f"{len(self.results)} of {num_runs} runs were finished")


def attempt(function: Callable[[Any], Any], index: int, item: Any) -> Done:
    """Run a function on an input; what it raises becomes the run's error.

    Args:
        function: What to run.
        index: The input's place in the list.
        item: The input.
    """
    start = time.perf_counter()
    value, error = None, None
    try:
        value = function(item)
    except Exception as raised:
        error = _tidy(raised, raised)
    except Stop:
        raise
    except BaseException as raised:
        # Of Ctrl-C, where nobody sends this to threads and workers.
        if isinstance(raised, KeyboardInterrupt) and not is_nested():
            raise
        error = _tidy(RunError(f"the run raised {raised!r}"), raised)
    return Done(index, value, error, time.perf_counter() - start)


def _tidy(error: Exception, raised: BaseException) -> Exception:
    """Return an error that holds no frames, hence no simulations.

    Where it was raised is a note, unless its message is meant for users.
    """
    if not isinstance(raised, ArmDrakeError):
        error.add_note("".join(traceback.format_exception(raised)).rstrip())
    error.__cause__ = error.__context__ = None
    return error.with_traceback(None)


def sendable(error: Exception) -> Exception:
    """Return an error as it is if it comes through a pickle, else its text."""
    try:
        copy = loads(dumps(error, "the error"))
        if type(copy) is type(error) and str(copy) == str(error):
            return error
    except Exception:  # noqa: S110  Classes of others may raise anything.
        pass
    is_told = isinstance(error, ArmDrakeError)
    text = RunError(str(error) if is_told else _describe(error))
    for note in getattr(error, "__notes__", ()):
        text.add_note(note)
    return text


def _describe(error: Exception | None) -> str:
    """Return an error's type and text."""
    try:
        text = str(error)
    except Exception:  # Classes of others may raise anything.
        text = "it can't say what"
    return f"{type(error).__name__}: {text}"
