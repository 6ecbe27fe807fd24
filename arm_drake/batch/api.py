"""run_many and iterate_many: what a program calls."""

import time
from collections.abc import Callable, Iterable, Iterator
from numbers import Integral
from typing import Any, Literal, TypeVar, overload

from arm_drake.batch.choice import Choice, Work, run_by_choice, run_in_processes
from arm_drake.batch.cores import available_cores
from arm_drake.batch.local import run_in_threads, run_serially
from arm_drake.batch.progress import Progress
from arm_drake.batch.results import RunResult, RunResults, RunsInterrupted
from arm_drake.batch.runs import Outcome, Run, Runner
from arm_drake.batch.stopping import is_nested
from arm_drake.errors import InputError, suggest
from arm_drake.simulation.simulation import Simulation

Input = TypeVar("Input")
Value = TypeVar("Value")

Backend = Literal["auto", "serial", "threads", "processes"]
_BACKENDS = ("auto", "serial", "threads", "processes")


@overload
def run_many(
    runs: Iterable[Run],
    *,
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
    raise_errors: bool = ...,
) -> RunResults[Outcome]: ...


@overload
def run_many(
    runs: Iterable[Run],
    *,
    keep: Callable[[Simulation], Value],
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
    raise_errors: bool = ...,
) -> RunResults[Value]: ...


@overload
def run_many(
    runs: Iterable[Input],
    function: Callable[[Input], Value],
    *,
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
    raise_errors: bool = ...,
) -> RunResults[Value]: ...


def run_many(
    runs: Iterable[Any],
    function: Callable[[Any], Any] | None = None,
    *,
    keep: Callable[[Simulation], Any] | None = None,
    workers: int | None = None,
    backend: Backend = "auto",
    progress: bool | None = None,
    raise_errors: bool = False,
) -> RunResults[Any]:
    """Run many rollouts, several at a time; return their results in input order.

    The results are the same bits wherever the runs are executed, in how many workers
    and in which order, but for functions that depend on what was before them.

    Args:
        runs: What to run: each a `Run`, or with `function` an input of it.
        function: Runs one input and returns what to keep of it. In other processes it
            and its input are pickled, and what it returns.
        keep: Returns what to keep of a Run's simulation, where it was executed; by
            default an `Outcome`: rollouts, goals, failures.
        workers: How many run at a time; by default as many as the cores that this
            process may use, and one within a run of another run_many.
        backend: Where: "serial" in this process; "threads" in it, too, where only
            Drake's own code runs at the same time; "processes" in others, whose death
            is an error of the run that they had. "auto" times runs here, and
            starts processes if they are quicker.
        progress: Whether to tell on standard error how far it is; None is in terminals
            and notebooks.
        raise_errors: Whether to raise the first error of a run at once. By default
            it is in the place of the run's value, and the others go on.

    Raises:
        InputError: If an argument can't be used.
        RunsInterrupted: At Ctrl-C, a KeyboardInterrupt; with what was finished.
    """
    execution = _Execution(runs, function, keep, workers, backend, progress)
    start = time.perf_counter()
    results = []
    try:
        for result in execution:
            results.append(result)
            if raise_errors and result.error is not None:
                result.error.add_note(f"in run {result.index}")
                raise result.error
    except KeyboardInterrupt:
        raise RunsInterrupted(_sorted(results), execution.num_runs) from None
    finally:
        execution.close()
    choice = execution.choice
    return RunResults(
        tuple(_sorted(results)),
        choice.backend,
        choice.workers,
        choice.why,
        time.perf_counter() - start,
    )


@overload
def iterate_many(
    runs: Iterable[Run],
    *,
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
) -> Iterator[RunResult[Outcome]]: ...


@overload
def iterate_many(
    runs: Iterable[Run],
    *,
    keep: Callable[[Simulation], Value],
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
) -> Iterator[RunResult[Value]]: ...


@overload
def iterate_many(
    runs: Iterable[Input],
    function: Callable[[Input], Value],
    *,
    workers: int | None = ...,
    backend: Backend = ...,
    progress: bool | None = ...,
) -> Iterator[RunResult[Value]]: ...


def iterate_many(
    runs: Iterable[Any],
    function: Callable[[Any], Any] | None = None,
    *,
    keep: Callable[[Simulation], Any] | None = None,
    workers: int | None = None,
    backend: Backend = "auto",
    progress: bool | None = None,
) -> Iterator[RunResult[Any]]:
    """Run many rollouts; yield each result as soon as those before it are there.

    The arguments and errors are those of `run_many`; RunsInterrupted has what wasn't
    yielded yet. While nobody asks for the next result, workers end what they have begun
    and wait. Who leaves the loop early ends what is under way.

    Args:
        runs: See `run_many`.
        function: See `run_many`.
        keep: See `run_many`.
        workers: See `run_many`.
        backend: See `run_many`.
        progress: See `run_many`.
    """
    # What can't be used is said at once, not when the first result is asked for.
    execution = _Execution(runs, function, keep, workers, backend, progress)
    return _in_order(execution)


def _in_order(execution: "_Execution") -> Iterator[RunResult[Any]]:
    early: dict[int, RunResult[Any]] = {}
    index = 0
    try:
        for result in execution:
            early[result.index] = result
            while index in early:
                yield early.pop(index)
                index += 1
    except KeyboardInterrupt:
        raise RunsInterrupted(_sorted(early.values()), execution.num_runs) from None
    finally:
        execution.close()


def _sorted(results: Iterable[RunResult[Any]]) -> list[RunResult[Any]]:
    return sorted(results, key=lambda result: result.index)


class _Execution:
    """Yields results as the runs end."""

    def __init__(
        self,
        runs: Iterable[Any],
        function: Callable[[Any], Any] | None,
        keep: Callable[[Simulation], Any] | None,
        workers: int | None,
        backend: str,
        progress: bool | None,
    ) -> None:
        if backend not in _BACKENDS:
            hint = suggest(str(backend), _BACKENDS)
            raise InputError(f"unknown backend {backend!r}; {hint}")
        if isinstance(runs, Run) or not isinstance(runs, Iterable):
            kind = type(runs).__name__
            raise InputError(f"runs: expected a list of what to run, got one {kind}")
        self._items = list(runs)
        self.num_runs = len(self._items)
        num_workers = _check_workers(workers)
        work = Work(
            _check_function(self._items, function, keep),
            self._items,
            max(1, min(num_workers, self.num_runs)),
        )
        self.choice, self._runs = _choose(work, backend)
        self._progress = Progress(self.num_runs, progress)

    def __iter__(self) -> Iterator[RunResult[Any]]:
        for done in self._runs:
            self._progress.add(failed=done.error is not None)
            item = self._items[done.index]
            yield RunResult(done.index, item, done.error, done.wall_time, done.value)

    def close(self) -> None:
        """End what is under way."""
        self._runs.close()
        self._progress.close()


def _check_workers(workers: int | None) -> int:
    if workers is None:
        return 1 if is_nested() else available_cores()
    if isinstance(workers, bool) or not isinstance(workers, Integral) or workers < 1:
        raise InputError(f"workers must be a number of at least 1, got {workers!r}")
    return int(workers)


def _check_function(
    items: list[Any],
    function: Callable[[Any], Any] | None,
    keep: Callable[[Simulation], Any] | None,
) -> Callable[[Any], Any]:
    """Return what runs an input."""
    for name, given in (("function", function), ("keep", keep)):
        if given is not None and not callable(given):
            raise InputError(f"{name}: expected a function, got {given!r}")
    if function is not None:
        if keep is not None:
            raise InputError(
                "keep is for Runs; a function returns what is to be kept itself"
            )
        return function
    for index, item in enumerate(items):
        if not isinstance(item, Run):
            kind = type(item).__name__
            raise InputError(
                f"runs[{index}]: expected a Run, got {kind}; or give function=, which "
                "runs such an input"
            )
    return Runner(keep)


def _choose(work: Work, backend: str) -> tuple[Choice, Any]:
    """Return where runs are executed, and what executes them."""
    function, items, workers = work.function, work.items, work.workers
    if backend == "auto":
        alone = workers == 1
        why = "one run at a time" if alone else "no run has told what runs take"
        choice = Choice("serial", 1, why)
        return choice, run_by_choice(work, choice)
    if backend == "serial":
        choice = Choice("serial", 1, "as asked")
        return choice, run_serially(function, items, range(len(items)))
    choice = Choice(backend, workers, "as asked")
    if backend == "threads":
        return choice, run_in_threads(function, items, range(len(items)), workers)
    return choice, run_in_processes(work)
