"""What runs in a worker process: it gets a function, then inputs, one at a time."""

import contextlib
import dataclasses as dc
import os
import pickle
import resource
import sys
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from arm_drake.batch.results import Done, attempt, sendable
from arm_drake.batch.sending import dumps, loads
from arm_drake.batch.stopping import enter_process
from arm_drake.controllers import CONTROLLER_TYPES

# A worker that has grown by so much is replaced [bytes], whatever functions of users
# leave behind.
MAX_GROWTH = 256 * 2**20

# What follows each answer: whether the worker takes another input.
STAYS, LEAVES = b"stays", b"leaves"


class Setup(NamedTuple):
    """What a worker has to know before it can read the function."""

    environ: dict[str, str]
    path: list[str]
    argv: list[str]

    # None if it is gone.
    folder: str | None

    @classmethod
    def of_this_process(cls) -> "Setup":
        """Return what makes a worker see what this process sees."""
        try:
            folder = os.getcwd()
        except OSError:
            folder = None
        return cls(dict(os.environ), list(sys.path), list(sys.argv), folder)

    def apply(self) -> None:
        """Make this process see it."""
        os.environ.clear()
        os.environ.update(self.environ)
        sys.path[:] = self.path
        sys.argv[:] = self.argv
        if self.folder is not None:
            os.chdir(self.folder)


def work(connection: Connection) -> None:
    """Run what comes, until nobody is there any more.

    Args:
        connection: Gives a Setup, the registered controller types, the function, then
            pairs of index and input, all pickled; takes None or the error of the
            beginning, then each Done, and after it STAYS or LEAVES.
    """
    enter_process()
    # What a function forks doesn't hold it open.
    os.register_at_fork(after_in_child=connection.close)
    size = _peak_memory()
    try:
        beginning = attempt(_begin, -1, [connection.recv_bytes() for _ in range(3)])
        error = beginning.error
        connection.send_bytes(dumps(error and sendable(error), "the error"))
        if error is not None:
            return
        while True:
            index, sent = pickle.loads(connection.recv_bytes())  # noqa: S301
            done = attempt(lambda sent: beginning.value(loads(sent)), index, sent)
            for stream in (sys.stdout, sys.stderr):
                # It may be closed, or none.
                with contextlib.suppress(AttributeError, ValueError, OSError):
                    stream.flush()
            connection.send_bytes(_pack(done))
            # Nothing of it stays while the next one runs.
            del done, sent
            leaves = _peak_memory() - size > MAX_GROWTH
            connection.send_bytes(LEAVES if leaves else STAYS)
            if leaves:
                return
    except EOFError:
        return


def _begin(sent: list[bytes]) -> Any:
    """Return the function, in a process that is as the program."""
    setup, types, function = sent
    loads(setup).apply()
    # A module that was imported may have registered its types itself.
    for name, row in loads(types).items():
        CONTROLLER_TYPES.setdefault(name, row)
    return loads(function)


def _peak_memory() -> int:
    """Return the most memory that this process has had so far [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _pack(done: Done) -> bytes:
    """Return what became of a run as bytes."""
    if done.error is not None:
        done = dc.replace(done, error=sendable(done.error))
    try:
        return dumps(done, "the value of the run")
    except Exception as error:  # Whatever classes of users raise.
        failed = Done(done.index, None, sendable(error), done.wall_time)
        return dumps(failed, "the error")
