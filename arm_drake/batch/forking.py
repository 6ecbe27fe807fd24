"""The program's side of the process that forks workers; see `server.py`."""

import atexit
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import weakref
from multiprocessing.connection import Connection

from arm_drake.batch.server import FORK, READY

_PROGRAM = (
    "import sys; sys.path[:] = {path!r}; "
    "from arm_drake.batch.server import serve; serve({fd}, {pid})"
)

_STDERR = 2

# A server whose program is done with it ends within so long, or is killed [s].
_LONGEST_END = 1.0

# What a fork of the program must not hold open: the ends of connections, by which
# others know that they are to end.
_ours: weakref.WeakSet[socket.socket | Connection] = weakref.WeakSet()


def _close_ours() -> None:
    for end in list(_ours):
        end.close()


os.register_at_fork(after_in_child=_close_ours)


class Server:
    """The process that forks workers; see `server.py`."""

    def __init__(self) -> None:
        """Start it; it imports what runs need, which takes a second."""
        self.pid = os.getpid()
        _open_streams()
        self._control, theirs = socket.socketpair()
        _ours.add(self._control)
        path = [str(folder) for folder in sys.path]
        program = _PROGRAM.format(path=path, fd=theirs.fileno(), pid=self.pid)
        # Ctrl-C isn't for it, also before it can say so.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process = subprocess.Popen(  # noqa: S603  Our own.
                [sys.executable, "-c", program],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()

    def is_alive(self) -> bool:
        """Return whether it runs, as a child of this very process."""
        return self.pid == os.getpid() and self._process.poll() is None

    def fork(self) -> tuple[Connection, socket.socket]:
        """Return the connection to a new worker, and where its exit code will come.

        Raises:
            ConnectionError: If this process has died.
            OSError: If there can't be more open files.
        """
        with contextlib.ExitStack() as stack:
            (data, theirs), (status, its) = (
                [stack.enter_context(end) for end in socket.socketpair()]
                for _ in range(2)
            )
            socket.send_fds(self._control, [FORK], [theirs.fileno(), its.fileno()])
            connection, told = Connection(data.detach()), status.dup()
        _ours.update((connection, told))
        return connection, told

    def close(self) -> None:
        """End it, with all its workers."""
        if self.pid != os.getpid():
            return
        try:
            said = self._control.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
            self._control.shutdown(socket.SHUT_RDWR)
        except OSError:
            said = b""
        self._control.close()
        if said != READY:  # It is importing, for nobody, and has no workers yet.
            self._process.kill()
        try:
            self._process.wait(_LONGEST_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _open_streams() -> None:
    """Let no socket be a standard stream of a program that has closed them."""
    while (fd := os.open(os.devnull, os.O_RDWR)) <= _STDERR:
        os.set_inheritable(fd, True)
    os.close(fd)


_lock = threading.Lock()
_servers: list[Server] = []


def is_warm() -> bool:
    """Return whether workers would start at once."""
    with _lock:
        return bool(_servers) and _servers[0].is_alive()


def get_server() -> Server:
    """Return the server of this process; start it if there is none."""
    with _lock:
        if _servers and not _servers[0].is_alive():
            _servers.pop().close()
        if not _servers:
            _servers.append(Server())
            atexit.register(_close_at_exit)
        return _servers[0]


def fork_worker() -> tuple[Connection, socket.socket]:
    """Return what `Server.fork` does; start a server if there is none.

    Raises:
        OSError: If none can be started.
    """
    try:
        return get_server().fork()
    except ConnectionError:  # It has just died.
        close_server()
        return get_server().fork()


def close_server() -> None:
    """End the server, if there is one; the next call of run_many starts another."""
    with _lock:
        while _servers:
            _servers.pop().close()
        atexit.unregister(_close_at_exit)


def _close_at_exit() -> None:
    with contextlib.suppress(KeyboardInterrupt):  # Then it ends by itself.
        close_server()
