"""Runs in worker processes: how they are started, fed, watched and ended."""

import contextlib
import pickle
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import wait
from typing import Any

from arm_drake.batch.forking import fork_worker
from arm_drake.batch.results import Done, RunError
from arm_drake.batch.sending import dumps, loads
from arm_drake.batch.server import EXITED
from arm_drake.batch.worker import LEAVES, Setup
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.errors import ArmDrakeError

# A worker that has nothing to do ends within so long, or is killed [s].
_LONGEST_END = 1.0


class _Worker:
    """One worker, and what it is doing."""

    def __init__(self, beginning: Iterable[bytes]) -> None:
        self.connection, self.status = fork_worker()
        self.is_ready = self.leaves = False
        # What it runs, and since when.
        self.index: int | None = None
        self.started = 0.0
        # Why it can't begin.
        self.trouble: Exception | None = None
        with contextlib.suppress(OSError):  # Its status tells why.
            for data in beginning:
                self.connection.send_bytes(data)

    def give(self, index: int, item: bytes) -> None:
        self.index, self.started = index, time.perf_counter()
        with contextlib.suppress(OSError):  # Its status tells why.
            self.connection.send_bytes(pickle.dumps((index, item)))

    def take(self) -> Done | None:
        """Return what it has to say: what became of its run, or that it is ready.

        Raises:
            EOFError: If it has died.
            OSError: If it has died.
        """
        data = self.connection.recv_bytes()
        if self.is_ready:
            self.leaves = self.connection.recv_bytes() == LEAVES
            return self._read(data)
        self.trouble = loads(data)
        self.is_ready = self.trouble is None
        return None

    def _read(self, data: bytes) -> Done:
        """Return what became of its run."""
        assert self.index is not None
        index, self.index = self.index, None
        try:
            done: Done = loads(data)
        except Exception as error:  # Whatever classes of users raise.
            text = (
                f"the value of the run can't be read: {type(error).__name__}: {error}"
            )
            wall_time = time.perf_counter() - self.started
            return Done(index, None, RunError(text), wall_time)
        return done

    def close(self, timeout: float) -> None:
        """End it; kill it if it takes longer than the timeout [s]."""
        self.connection.close()
        if timeout > 0.0:
            wait([self.status], timeout)
        self.status.close()


class Pool:
    """Workers that run one function on many inputs."""

    def __init__(
        self,
        function: Callable[[Any], Any],
        items: Sequence[Any],
        waiting: deque[int],
    ) -> None:
        """Create it, without workers.

        Args:
            function: What to run.
            items: The inputs.
            waiting: Places of those to run. What is left of them in the end had no
                workers, which is this one's `trouble`.

        Raises:
            SendError: If the function can't be sent to other processes.
        """
        self._beginning = (
            dumps(Setup.of_this_process(), "what workers are to see"),
            dumps(CONTROLLER_TYPES.added, "a registered controller type"),
            dumps(function, "the function"),
        )
        self._items, self._waiting = items, waiting
        self._workers: list[_Worker] = []
        # What has ended, and nobody was told.
        self._ended: list[Done] = []
        # Why the last worker that couldn't begin couldn't.
        self.trouble: Exception | None = None

    @property
    def num_workers(self) -> int:
        """How many workers there are."""
        return len(self._workers)

    def start(self, num_workers: int) -> None:
        """Start workers up to a number, each with a run; don't wait for them."""
        try:
            while self._waiting and len(self._workers) < num_workers:
                self._workers.append(_Worker(self._beginning))
                self._feed()
        except OSError as error:
            self.trouble = RunError(f"a worker process can't be started: {error}")

    def run(self) -> Iterator[Done]:
        """Yield what becomes of runs as they end."""
        while True:
            ended, self._ended = self._ended, []
            yield from ended
            if all(w.index is None for w in self._workers):
                return
            there: list[Any] = [w.connection for w in self._workers]
            there += [w.status for w in self._workers]
            ready = wait(there)
            for worker in list(self._workers):
                if worker.connection in ready:
                    self._take(worker)
                elif worker.status in ready:
                    self._bury(worker)
            # They go on while the caller looks at what has ended.
            self._feed()

    def close(self, *, kill: bool) -> None:
        """End all workers.

        Args:
            kill: Whether at once, in the midst of what they do.
        """
        deadline = time.perf_counter() + (0.0 if kill else _LONGEST_END)
        for worker in self._workers:
            # One that is only starting has nothing to end.
            left = deadline - time.perf_counter() if worker.is_ready else 0.0
            worker.close(left)
        self._workers.clear()

    def _feed(self) -> None:
        """Give runs to workers that have none."""
        for worker in self._workers:
            while self._waiting and worker.index is None:
                index = self._waiting.popleft()
                try:
                    data = dumps(self._items[index], "the input of the run")
                except ArmDrakeError as error:
                    self._ended.append(Done(index, None, error, 0.0))
                else:
                    worker.give(index, data)

    def _take(self, worker: _Worker) -> None:
        """Note what a worker says."""
        try:
            done = worker.take()
        except (EOFError, OSError):  # Its status tells why.
            self._bury(worker)
            return
        if done is not None:
            self._ended.append(done)
        if worker.trouble is not None:
            self._remove(worker, worker.trouble)
        elif worker.leaves:
            self._remove(worker)

    def _bury(self, worker: _Worker) -> None:
        """Note the end of a worker that died."""
        code = worker.status.recv(16)
        why = _describe_end(int(code) if code else None)
        if not worker.is_ready:
            self._remove(worker, RunError(f"a worker process couldn't start: it {why}"))
            return
        if worker.index is not None:
            error = RunError(f"the process of this run {why}")
            duration = time.perf_counter() - worker.started
            self._ended.append(Done(worker.index, None, error, duration))
        self._remove(worker)

    def _remove(self, worker: _Worker, trouble: Exception | None = None) -> None:
        """Forget a worker that has ended; start another one if it had no trouble."""
        worker.close(0.0)
        self._workers.remove(worker)
        if trouble is None:
            self.start(len(self._workers) + 1)
            return
        self.trouble = trouble
        if worker.index is not None:  # It hasn't begun.
            self._waiting.appendleft(worker.index)


def _describe_end(code: int | None) -> str:
    if code is None:
        return "is gone, and so is the process that started it"
    if code == EXITED or code > 0:
        return f"ended by itself, with exit code {code}"
    name = signal.Signals(-code).name
    if -code == signal.SIGKILL:
        return f"was killed ({name}), as the system does when memory runs out"
    return f"died of {name} ({signal.strsignal(-code)})"
