"""Where runs are executed, and how "auto" finds out what is quickest."""

import dataclasses as dc
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from arm_drake.batch.forking import is_warm
from arm_drake.batch.local import run_serially
from arm_drake.batch.processes import Pool
from arm_drake.batch.results import Done
from arm_drake.batch.sending import SendError
from arm_drake.errors import ArmDrakeError

# What the first workers of a program take to start, and what later ones do [s];
# tests/benchmarks/many.py measures them.
COLD_START, WARM_START = 1.3, 0.1

# The first run may be slow by what it imports. With a gain of so many starts, there is
# no doubt.
_SURE = 4.0


@dc.dataclass
class Choice:
    """What was chosen, so far."""

    backend: str
    workers: int

    # One line: why.
    why: str


@dc.dataclass(frozen=True)
class Work:
    """What is to be run."""

    function: Callable[[Any], Any]
    items: Sequence[Any]

    # How many may run at a time.
    workers: int


def run_in_processes(work: Work) -> Iterator[Done]:
    """Run inputs in worker processes.

    Runs that have no worker, for none can begin, have the error that tells why.

    Args:
        work: What to run.

    Raises:
        SendError: If the function can't be sent to them.
    """
    waiting, is_done = deque(range(len(work.items))), False
    pool = Pool(work.function, work.items, waiting)
    try:
        pool.start(work.workers)
        yield from pool.run()
        is_done = True
    finally:
        pool.close(kill=not is_done)
    for index in waiting:
        yield Done(index, None, pool.trouble, 0.0)


def run_by_choice(work: Work, choice: Choice) -> Iterator[Done]:
    """Run inputs where it is quickest, by what those take that ran here.

    Args:
        work: What to run.
        choice: Is told what was chosen.
    """
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
        """Create it.

        Args:
            work: What to run.
            waiting: Places of the runs that have not begun.
            choice: Is told why.
        """
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
            said = f"a run took {took:.2g} s, {left} were left"
            if gain > self._cost * (1.0 if self._num_done > 1 else _SURE):
                self._start(workers, said)
            else:
                self._choice.why = (
                    f"{said}: starting processes takes longer than they gain"
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
                    said = f"a run took longer than {lasted:.2g} s, {left} were left"
                    # It has a core of its own.
                    self._start(self._work.workers - 1, said)

    def _start(self, num_workers: int, why: str) -> None:
        self._may_start = False
        self._choice.why = why
        try:
            self.pool = Pool(self._work.function, self._work.items, self._waiting)
        except ArmDrakeError as error:
            self._choice.why += f", but {error}"
            return
        self.pool.start(num_workers)
