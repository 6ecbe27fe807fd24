"""run_many and iterate_many: many runs, on processes or executors.

That is here, one after the other; in threads; in processes; or by choice, for which
runs that are executed here take the time. How many at a time is by the cores that this
process may use.
"""

import contextlib
import contextvars
import dataclasses as dc
import math
import os
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypedDict, TypeVar, Unpack, overload

from arm_drake.batch.processes import (
    NO_LIMITS,
    Limits,
    Pool,
    SendError,
    attempt,
    is_warm,
)
from arm_drake.batch.runs import (
    Done,
    Outcome,
    Run,
    Runner,
    RunResult,
    RunResults,
    RunsInterrupted,
    RunStore,
    Stop,
    enter_thread,
    is_nested,
)
from arm_drake.errors import ArmDrakeError, InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.simulation.simulation import Simulation


def run_serially(
    function: Callable[[Any], Any], items: Sequence[Any], indices: Iterable[int]
) -> Iterator[Done]:
    """Run the inputs in some places one after the other."""
    for index in indices:
        yield attempt(function, index, items[index])


def run_in_threads(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    indices: Iterable[int],
    num_threads: int,
) -> Iterator[Done]:
    """Run inputs in threads; yield what becomes of them as they end.

    Who closes the iterator waits for what is under way: a Run stops within 0.1 s of its
    simulated time, a function of a user ends first.
    """
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    num_waiting = 0
    for index in indices:
        waiting.put(index)
        num_waiting += 1
    ended: queue.SimpleQueue[Done] = queue.SimpleQueue()
    stop = threading.Event()

    def work() -> None:
        enter_thread(stop)
        while not stop.is_set():
            try:
                index = waiting.get_nowait()
                ended.put(attempt(function, index, items[index]))
            except (queue.Empty, Stop):
                return
            except BaseException as error:  # Nobody else would tell.
                ended.put(Done(index, None, RuntimeError(repr(error)), 0.0))

    threads = [
        threading.Thread(target=contextvars.copy_context().run, args=(work,))
        for _ in range(min(num_threads, num_waiting))
    ]
    for thread in threads:
        thread.start()
    try:
        for _ in range(num_waiting):
            yield ended.get()
    finally:
        stop.set()
        for thread in threads:
            thread.join()


# What the first workers of a program take to start, and what later ones do [s];
# tests/benchmarks/many.py measures them.
COLD_START, WARM_START = 1.3, 0.1

# The first run may be slow by what it imports. With a gain of so many starts, there is
# no doubt.
_SURE = 4.0


@dc.dataclass
class Choice:
    """Backend and number of workers chosen so far."""

    backend: str
    workers: int

    # One line: why.
    why: str


@dataclass(frozen=True)
class Work:
    """Function, inputs and limits of the runs to execute."""

    function: Callable[[Any], Any]
    items: Sequence[Any]

    # How many may run at a time.
    workers: int

    # What each of them may take.
    limits: Limits = NO_LIMITS


def run_in_processes(work: Work) -> Iterator[Done]:
    """Run inputs in worker processes, or raise SendError of the function.

    Runs that have no worker, for none can begin, have the error that tells why.
    """
    waiting, is_done = deque(range(len(work.items))), False
    pool = Pool(work.function, work.items, waiting, work.limits)
    try:
        pool.start(work.workers)
        yield from pool.run()
        is_done = True
    finally:
        pool.close(kill=not is_done)
    for index in waiting:
        yield Done(index, None, pool.trouble, 0.0)


def run_by_choice(work: Work, choice: Choice) -> Iterator[Done]:
    """Run inputs where it is quickest, by what those take that ran here."""
    waiting, is_done = deque(range(len(work.items))), False
    starter = _Starter(work, waiting, choice)
    try:
        while (index := starter.take()) is not None:
            (done,) = run_serially(work.function, work.items, [index])
            starter.note(done)
            yield done
        if starter.pool is not None:
            workers = starter.start_all()
            unsent: list[int] = []
            for done in starter.pool.run():
                if isinstance(done.error, SendError):
                    # So will be those that are left; here they need no sending.
                    unsent += [done.index, *waiting]
                    waiting.clear()
                    continue
                choice.backend, choice.workers = "processes", workers
                yield done
            if unsent:
                choice.why += f"; {len(unsent)} ran here, for they can't be sent"
                yield from run_serially(work.function, work.items, sorted(unsent))
            if waiting:
                choice.why += f"; {len(waiting)} ran here, for {starter.pool.trouble}"
            yield from run_serially(work.function, work.items, waiting)
        is_done = True
    finally:
        starter.close(kill=not is_done)


class _Starter:
    """Starts processes as soon as they pay, also in the midst of a run here."""

    def __init__(self, work: Work, waiting: deque[int], choice: Choice) -> None:
        """Create it with the places of runs that have not begun; choice.why is set."""
        # None before processes are started.
        self.pool: Pool | None = None
        self._work, self._waiting, self._choice = work, waiting, choice
        self._may_start = work.workers > 1
        self._cost = WARM_START if is_warm() else COLD_START
        # How many have ended well here, and what they took, but for the first one if
        # there are others; when the present one began [s].
        self._num_done, self._total = 0, 0.0
        self._began = math.inf
        self._lock, self._is_closed = threading.Lock(), threading.Event()
        self._watch = threading.Thread(target=self._watch_long_runs, daemon=True)
        if self._may_start:
            self._watch.start()

    def take(self) -> int | None:
        """Return the place of what is to run here; None if the rest isn't."""
        with self._lock:
            if self.pool is not None or not self._waiting:
                return None
            self._began = time.perf_counter()
            return self._waiting.popleft()

    def note(self, done: Done) -> None:
        """Note a run that has ended here; start processes for the rest if they pay."""
        with self._lock:
            self._began = math.inf
            left, workers = len(self._waiting), self._work.workers
            # Who fails may be quick.
            if not (self._may_start and left) or done.error is not None:
                return
            self._num_done += 1
            before = self._total if self._num_done > 2 else 0.0
            self._total = before + done.wall_time
            took = self._total / max(1, self._num_done - 1)
            gain = took * (left - math.ceil(left / workers))
            reason = f"a run took {took:.2g} s, {left} were left"
            if gain > self._cost * (1.0 if self._num_done > 1 else _SURE):
                self._start(workers, reason)
            else:
                self._choice.why = (
                    f"{reason}: starting processes takes longer than they gain"
                )

    def start_all(self) -> int:
        """Start workers for what is left; return how many there are."""
        assert self.pool is not None
        self.pool.start(self._work.workers)
        return self.pool.num_workers

    def close(self, *, kill: bool) -> None:
        """End what it has started, at once if they are to be killed."""
        self._is_closed.set()
        if self._watch.is_alive():
            self._watch.join()
        if self.pool is not None:
            self.pool.close(kill=kill)

    def _watch_long_runs(self) -> None:
        """Start processes if a run here takes longer than their start."""
        while self._may_start and not self._is_closed.wait(self._cost / 2):
            with self._lock:
                lasted = time.perf_counter() - self._began
                left = len(self._waiting)
                if self._may_start and left and lasted > self._cost:
                    reason = f"a run took longer than {lasted:.2g} s, {left} were left"
                    # It has a core of its own.
                    self._start(self._work.workers - 1, reason)

    def _start(self, num_workers: int, why: str) -> None:
        self._may_start = False
        self._choice.why = why
        try:
            self.pool = Pool(self._work.function, self._work.items, self._waiting)
        except ArmDrakeError as error:
            self._choice.why += f", but {error}"
            return
        self.pool.start(num_workers)


_V2 = Path("/sys/fs/cgroup")
_V1 = Path("/sys/fs/cgroup/cpu")


def available_cores() -> int:
    """Return how many cores this process may use: affinity, and a container's quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    quota = read_quota()
    return cores if quota is None else max(1, min(cores, math.ceil(quota)))


def read_quota(v2: Path = _V2, v1: Path = _V1) -> float | None:
    """Return how many cores a container may use by its cgroup, None if all.

    Source: the kernel's cgroup-v2 (`cpu.max`: quota and period in us, or "max") and
    cgroup-v1 (`cpu.cfs_quota_us`, -1 for none) documents.
    """
    try:
        quota, period = (v2 / "cpu.max").read_text().split()
    except (OSError, ValueError):
        try:
            quota = (v1 / "cpu.cfs_quota_us").read_text()
            period = (v1 / "cpu.cfs_period_us").read_text()
        except OSError:
            return None
    try:
        cores = float(quota) / float(period)
    except ValueError:  # "max"
        return None
    return cores if cores > 0.0 else None


# A terminal is told as often, a file as seldom [s].
_IN_PLACE, _AS_LINE = 0.1, 5.0

_WIDTH = 20


class Progress:
    """A bar in place on a terminal and in a notebook; lines elsewhere, or nothing."""

    def __init__(self, num_runs: int, shown: bool | None) -> None:
        """Create it, and show it: None is in terminals and notebooks alone."""
        self._is_in_place = _can_overwrite()
        self._is_shown = self._is_in_place if shown is None else shown
        self._num_runs = num_runs
        self._num_done = self._num_failed = 0
        self._start = time.perf_counter()
        self._printed_at = self._start if not self._is_in_place else -_AS_LINE
        self._width = 0
        if self._is_in_place and num_runs:
            self._print(self._start)

    def add(self, *, failed: bool) -> None:
        """Count a run that has ended."""
        self._num_done += 1
        self._num_failed += failed
        now = time.perf_counter()
        often = _IN_PLACE if self._is_in_place else _AS_LINE
        if now - self._printed_at >= often:
            self._print(now)

    def close(self) -> None:
        """Show where it ended, and leave that line."""
        if not (self._is_shown and self._num_runs):
            return
        self._print(time.perf_counter())
        if self._is_in_place:
            _write("\n")

    def _print(self, now: float) -> None:
        if not self._is_shown:
            return
        self._printed_at = now
        text = self._describe(now - self._start)
        if self._is_in_place:
            _write(f"\r{text.ljust(self._width)}")
            self._width = len(text)
        else:
            _write(f"{text}\n")

    def _describe(self, seconds: float) -> str:
        done, total = self._num_done, self._num_runs
        text = f"{done}/{total} runs, {_clock(seconds)}"
        if self._num_failed:
            text += f", {self._num_failed} failed"
        if 0 < done < total:
            text += f", {_clock(seconds / done * (total - done))} left"
        if not self._is_in_place:
            return text
        filled = _WIDTH * done // total
        return f"[{'#' * filled}{'.' * (_WIDTH - filled)}] {text}"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _write(text: str) -> None:
    # It may be closed, or none: of a program without a console.
    with contextlib.suppress(AttributeError, ValueError, OSError):
        sys.stderr.write(text)
        sys.stderr.flush()


def _can_overwrite() -> bool:
    """Return whether standard error is a terminal, or a notebook's."""
    is_notebook = type(sys.stderr).__module__.startswith("ipykernel")
    with contextlib.suppress(AttributeError, ValueError):
        return sys.stderr.isatty() or is_notebook
    return False


Input = TypeVar("Input")
Value = TypeVar("Value")

Backend = Literal["auto", "serial", "threads", "processes"]
_BACKENDS = ("auto", "serial", "threads", "processes")


class _ExecutionOptions(TypedDict, total=False):
    """Common options of `run_many` and `iterate_many`, for type checkers."""

    workers: int | None
    backend: Backend
    on: Any
    to: str | Path | None
    time_limit: float | None
    memory_limit: int | None
    progress: bool | None


@overload
def run_many(
    runs: Iterable[Run],
    *,
    raise_errors: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> RunResults[Outcome]: ...


@overload
def run_many(
    runs: Iterable[Run],
    *,
    keep: Callable[[Simulation], Value],
    raise_errors: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> RunResults[Value]: ...


@overload
def run_many(
    runs: Iterable[Input],
    function: Callable[[Input], Value],
    *,
    raise_errors: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> RunResults[Value]: ...


def run_many(
    runs: Iterable[Any],
    function: Callable[[Any], Any] | None = None,
    *,
    keep: Callable[[Simulation], Any] | None = None,
    workers: int | None = None,
    backend: Backend = "auto",
    on: Any = None,
    to: str | Path | None = None,
    time_limit: float | None = None,
    memory_limit: int | None = None,
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
            is an error of their run; "auto" times runs here and starts processes if
            they are quicker.
        on: Where instead: a Client of dask.distributed, a concurrent.futures.Executor,
            or a function that makes one, called again when that breaks. A run whose
            worker dies is tried once more.
        to: File for results, each written as its run ends; what it has is not run
            again. It is a pickle: open none of others.
        time_limit: Wall time of a run [s]; then its process is ended.
        memory_limit: What a run may allocate beyond what its process has [bytes].
        progress: Whether to tell on standard error how far it is; None is in terminals
            and notebooks.
        raise_errors: Whether to raise the first error of a run at once. By default
            it is in the place of the run's value, and the others go on.

    Raises:
        InputError: If an argument can't be used.
        RunsInterrupted: At Ctrl-C, a KeyboardInterrupt; with what was finished.
    """
    how = _How(workers, backend, on, to, time_limit, memory_limit, progress)
    execution = _Execution(runs, function, keep, how)
    return _collect(execution, raise_errors=raise_errors)


def _collect(execution: "_Execution", *, raise_errors: bool) -> RunResults[Any]:
    """Return the results of all runs."""
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
        execution.why,
        time.perf_counter() - start,
    )


@overload
def iterate_many(
    runs: Iterable[Run],
    *,
    ordered: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> Iterator[RunResult[Outcome]]: ...


@overload
def iterate_many(
    runs: Iterable[Run],
    *,
    keep: Callable[[Simulation], Value],
    ordered: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> Iterator[RunResult[Value]]: ...


@overload
def iterate_many(
    runs: Iterable[Input],
    function: Callable[[Input], Value],
    *,
    ordered: bool = ...,
    **execution: Unpack[_ExecutionOptions],
) -> Iterator[RunResult[Value]]: ...


def iterate_many(
    runs: Iterable[Any],
    function: Callable[[Any], Any] | None = None,
    *,
    keep: Callable[[Simulation], Any] | None = None,
    workers: int | None = None,
    backend: Backend = "auto",
    on: Any = None,
    to: str | Path | None = None,
    time_limit: float | None = None,
    memory_limit: int | None = None,
    progress: bool | None = None,
    ordered: bool = True,
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
        on: See `run_many`.
        to: See `run_many`.
        time_limit: See `run_many`.
        memory_limit: See `run_many`.
        progress: See `run_many`.
        ordered: Whether they come in the order of the runs, or as they end.
    """
    # What can't be used is said at once, not when the first result is asked for.
    how = _How(workers, backend, on, to, time_limit, memory_limit, progress)
    execution = _Execution(runs, function, keep, how)
    return _iterate(execution, ordered=ordered)


def _iterate(execution: "_Execution", *, ordered: bool) -> Iterator[RunResult[Any]]:
    early: dict[int, RunResult[Any]] = {}
    index = 0
    try:
        for result in execution:
            if not ordered:
                yield result
                continue
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


class _How(NamedTuple):
    """Backend, workers, limits and results file of an execution."""

    workers: int | None
    backend: str
    on: Any
    to: str | Path | None
    time_limit: float | None
    memory_limit: int | None
    progress: bool | None


class _Execution:
    """Yields results as the runs end."""

    def __init__(
        self,
        runs: Iterable[Any],
        function: Callable[[Any], Any] | None,
        keep: Callable[[Simulation], Any] | None,
        how: _How,
    ) -> None:
        if how.backend not in _BACKENDS:
            hint = suggest(str(how.backend), _BACKENDS)
            raise InputError(f"unknown backend {how.backend!r}; {hint}")
        if isinstance(runs, Run) or not isinstance(runs, Iterable):
            kind = type(runs).__name__
            raise InputError(f"runs: expected a list of what to run, got one {kind}")
        self._items = list(runs)
        self.num_runs = len(self._items)
        num_workers = _check_workers(how.workers)
        limits = _check_limits(how)
        function = _check_function(self._items, function, keep)
        self._store = None if how.to is None else RunStore(how.to, self._items)
        done = {} if self._store is None else self._store.done
        # Places of the runs that are left.
        self._left = [i for i in range(self.num_runs) if i not in done]
        work = Work(
            function,
            [self._items[index] for index in self._left],
            max(1, min(num_workers, len(self._left))),
            limits,
        )
        try:
            self.choice, self._runs = _choose(work, how)
        except BaseException:
            self._close_store()
            raise
        self._resumed = f"; {len(done)} were there already" if done else ""
        self._progress = Progress(self.num_runs, how.progress)

    @property
    def why(self) -> str:
        """One line: why runs are where they are, as far as that is known yet."""
        return self.choice.why + self._resumed

    def __iter__(self) -> Iterator[RunResult[Any]]:
        if self._store is not None:
            for done in self._store.done.values():
                yield self._result(done)
        for done in self._runs:
            done = dc.replace(done, index=self._left[done.index])
            if self._store is not None:
                self._store.add(done)
            yield self._result(done)

    def _result(self, done: Done) -> RunResult[Any]:
        self._progress.add(failed=done.error is not None)
        return RunResult(
            done.index,
            self._items[done.index],
            done.error,
            done.wall_time,
            done.value,
            done.worker,
            done.died,
            done.attempts,
        )

    def close(self) -> None:
        """End what is under way."""
        self._runs.close()
        self._progress.close()
        self._close_store()

    def _close_store(self) -> None:
        if self._store is not None:
            self._store.close()


def _check_limits(how: _How) -> Limits:
    for name, unit in (("time_limit", "s"), ("memory_limit", "bytes")):
        value = getattr(how, name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and 0.0 < value < math.inf):
            text = f"{name}: expected a number above 0 [{unit}], got {value!r}"
            raise InputError(text)
    memory = None if how.memory_limit is None else int(how.memory_limit)
    limits = Limits(how.time_limit, memory)
    if limits.are_set and how.on is None and how.backend in ("serial", "threads"):
        text = "a run with limits has a process of its own"
        raise InputError(f"backend {how.backend!r}: {text}; expected 'processes'")
    return limits


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
    for name, value in (("function", function), ("keep", keep)):
        if value is not None and not callable(value):
            raise InputError(f"{name}: expected a function, got {value!r}")
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


def _choose(work: Work, how: _How) -> tuple[Choice, Any]:
    """Return where runs are executed, and what executes them."""
    function, items, workers = work.function, work.items, work.workers
    if how.on is not None:
        if how.workers is not None or how.backend != "auto":
            raise InputError("on: it decides; expected neither workers nor backend")
        # Not at the top: it is for clusters.
        from arm_drake.batch.executors import Dispatch, RunPool

        pool = RunPool(how.on)
        choice = Choice("executor", pool.width() // 2, f"as asked: {pool}")
        return choice, Dispatch(pool, function, items, work.limits).run()
    backend = how.backend
    if work.limits.are_set:
        choice = Choice("processes", workers, "runs have limits")
        return choice, run_in_processes(work)
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
