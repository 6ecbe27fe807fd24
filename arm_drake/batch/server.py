"""The process whose children the workers are: it has imported everything, once.

Workers are forked from it, not from the program: that may have threads, of Meshcat for
one, whose locks would stay locked in a fork. It has a single thread, is started when it
is first needed, and ends with its program however that ends.

This module is the program of that process; `forking.py` has the other side.
"""

import contextlib
import ctypes
import gc
import importlib
import os
import selectors
import signal
import socket
import sys
import traceback
from multiprocessing.connection import Connection

import numpy as np

# What runs need, imported before the first fork.
_MODULES = (
    "arm_drake.batch.runs",
    "arm_drake.controllers.registry",
)

READY = b"r"
FORK = b"f"

# A worker has ended by itself.
EXITED = 0


# How often to see whether the program is still there [s].
_PERIOD = 1.0

# Number of a call by which a process of Linux dies with its parent (prctl(2)).
_PR_SET_PDEATHSIG = 1


def serve(control_fd: int, program: int) -> None:
    """Fork workers when asked to, until the program is gone.

    Args:
        control_fd: Socket on which each request comes with two more of them: one for
            the worker, and one for its exit code (the negative number of a signal). A
            worker is killed when the other end of the latter is closed.
        program: The program's process id.
    """
    # Ctrl-C is for the program, which stops the workers. What is ignored would be in
    # what a function starts, too.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        control = socket.socket(fileno=control_fd)
        for name in _MODULES:
            importlib.import_module(name)
        gc.collect()
        gc.freeze()  # A collection in a worker would copy all pages.
        control.send(READY)
        _Server(control, program).run()
    except ConnectionError:  # The program is gone.
        pass
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(0)


class _Server:
    """Forks, buries and kills."""

    def __init__(self, control: socket.socket, program: int) -> None:
        self._control = control
        self._program = program
        self._selector = selectors.DefaultSelector()
        self._selector.register(control, selectors.EVENT_READ)
        # Signals of dead children wake it.
        self._wake, wake = os.pipe()
        os.set_blocking(self._wake, False)
        os.set_blocking(wake, False)
        self._wakes = wake
        self._selector.register(self._wake, selectors.EVENT_READ)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(wake)
        # Where to tell of each child's end, and back.
        self._status: dict[int, socket.socket] = {}

    def run(self) -> None:
        """Serve until the program is gone; leave nobody behind."""
        try:
            # A fork of the program may hold its sockets.
            while self._serve_once() and os.getppid() == self._program:
                pass
        finally:
            for pid in self._status:
                _kill(pid)

    def _serve_once(self) -> bool:
        for key, _ in self._selector.select(_PERIOD):
            if key.fileobj is self._control:
                data, fds, *_ = socket.recv_fds(self._control, 1, 2)
                if not data:
                    return False
                self._fork(*fds)
            elif key.fileobj == self._wake:
                os.read(self._wake, 1024)
                self._bury()
            elif key.data in self._status:  # Nobody waits for this child.
                self._selector.unregister(key.fileobj)
                _kill(key.data)
        return True

    def _fork(self, data_fd: int, status_fd: int) -> None:
        server = os.getpid()
        pid = os.fork()
        if pid == 0:
            self._become_worker(data_fd, status_fd, server)
        _lead_group(pid)
        os.close(data_fd)
        status = socket.socket(fileno=status_fd)
        self._status[pid] = status
        self._selector.register(status, selectors.EVENT_READ, pid)

    def _become_worker(self, data_fd: int, status_fd: int, server: int) -> None:
        code = 1
        try:
            if sys.platform == "linux":
                ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != server:
                os._exit(code)
            _lead_group(os.getpid())
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            self._selector.close()
            for status in (*self._status.values(), self._control):
                status.close()
            for fd in (status_fd, self._wake, self._wakes):
                os.close(fd)
            # Forks would all have the same random numbers.
            np.random.seed()  # noqa: NPY002  That of users who seed none.
            from arm_drake.batch.worker import work

            work(Connection(data_fd))
            code = EXITED
        except (BrokenPipeError, ConnectionResetError):  # Nobody waits any more.
            code = EXITED
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _bury(self) -> None:
        while self._status:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            told = self._status.pop(pid)
            if told in self._selector.get_map():
                self._selector.unregister(told)
            with contextlib.suppress(OSError):  # Nobody wants to know.
                told.sendall(b"%d" % os.waitstatus_to_exitcode(status))
            told.close()


def _lead_group(pid: int) -> None:
    """Make a worker's group of processes, which are killed together."""
    with contextlib.suppress(OSError):  # It may have ended.
        os.setpgid(pid, pid)


def _kill(pid: int) -> None:
    """Kill a worker, and what it has started."""
    with contextlib.suppress(OSError):
        os.killpg(pid, signal.SIGKILL)
