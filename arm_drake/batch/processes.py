"""Processes that execute runs: how they are started, fed, watched and ended.

Workers are forked from a server, a process that has imported everything, once: so they
start at once and share its memory. They aren't forked from the program, which may have
threads, of Meshcat for one, whose locks would stay locked in a fork. The server has a
single thread, is started when it is first needed, and ends with its program however
that ends.

`serve` is the program of the server, `work` that of a worker; `Server` and `Pool` are
in the program whose runs they are.
"""

import atexit
import contextlib
import ctypes
import dataclasses as dc
import gc
import importlib
import os
import pickle
import resource
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle
import numpy as np

from arm_drake.batch.runs import Done, Stop, describe, enter_process, is_nested
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.errors import ArmDrakeError, InputError


class RunError(ArmDrakeError):
    """A run has no result: its process died, or its value can't be sent."""


class SendError(InputError):
    """Something can't be sent to other processes."""


def loads(data: bytes) -> Any:
    """Return what `dumps` has made bytes of."""
    return pickle.loads(data)  # noqa: S301  Of our own program.


def dumps(what: Any, role: str) -> bytes:
    """Return something as bytes that another process can read, or raise SendError.

    What modules define is sent by its name, and imported there. What a program or a
    notebook defines, lambdas, and functions in functions are sent with their code. The
    role is what it is in the message, as "the function".
    """
    try:
        return bytes(cloudpickle.dumps(what))
    except Exception as error:  # Whatever classes of users raise.
        raise SendError(
            f"{role} can't be sent to other processes: {error}; expected what "
            "cloudpickle takes, or backend='threads' or 'serial'"
        ) from None


class Limits(NamedTuple):
    """Limits of a run; None is no limit."""

    # Wall time, loading included [s].
    time: float | None = None

    # Memory beyond what its process has before [bytes].
    memory: int | None = None

    @property
    def are_set(self) -> bool:
        """Whether there are any."""
        return self.time is not None or self.memory is not None


NO_LIMITS = Limits()


def attempt(function: Callable[[Any], Any], index: int, item: Any) -> Done:
    """Run a function on an input; what it raises becomes the run's error."""
    start = time.perf_counter()
    value, error = None, None
    try:
        value = function(item)
    except Exception as raised:
        error = _without_frames(raised, raised)
    except Stop:
        raise
    except BaseException as raised:
        # Of Ctrl-C, where nobody sends this to threads and workers.
        if isinstance(raised, KeyboardInterrupt) and not is_nested():
            raise
        error = _without_frames(RunError(f"the run raised {raised!r}"), raised)
    return Done(index, value, error, time.perf_counter() - start)


def _without_frames(error: Exception, raised: BaseException) -> Exception:
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
    is_expected = isinstance(error, ArmDrakeError)
    text = RunError(str(error) if is_expected else describe(error))
    for note in getattr(error, "__notes__", ()):
        text.add_note(note)
    return text


# What runs need, and a program only when it loads a robot.
_REGISTRY = "arm_drake.controllers.registry"

READY = b"r"
FORK = b"f"

# A worker has ended by itself.
EXITED = 0

# How often to see whether the program is still there [s].
_PERIOD = 1.0

# Number of a call by which a process of Linux dies with its parent (prctl(2)).
_PR_SET_PDEATHSIG = 1


def serve(control_fd: int, program: int) -> None:
    """Fork workers on request, until the program (its process id) is gone.

    On the control socket each request comes with two more of them: one for the worker,
    and one for its exit code (the negative number of a signal). A worker is killed when
    the other end of the latter is closed.
    """
    # Ctrl-C is for the program, which stops the workers. What is ignored would be in
    # what a function starts, too.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        control = socket.socket(fileno=control_fd)
        importlib.import_module(_REGISTRY)
        gc.collect()
        # Else a collection in a worker copies pages that it shares: of its memory 37 MB
        # were its own, not 25 (Doosan, after a full collection).
        gc.freeze()
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
                self._reap()
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

            work(Connection(data_fd))
            code = EXITED
        except (BrokenPipeError, ConnectionResetError):  # Nobody waits any more.
            code = EXITED
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _reap(self) -> None:
        while self._status:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            status_socket = self._status.pop(pid)
            if status_socket in self._selector.get_map():
                self._selector.unregister(status_socket)
            with contextlib.suppress(OSError):  # Nobody wants to know.
                status_socket.sendall(b"%d" % os.waitstatus_to_exitcode(status))
            status_socket.close()


def _lead_group(pid: int) -> None:
    """Make a worker's group of processes, which are killed together."""
    with contextlib.suppress(OSError):  # It may have ended.
        os.setpgid(pid, pid)


def _kill(pid: int) -> None:
    """Kill a worker, and what it has started."""
    with contextlib.suppress(OSError):
        os.killpg(pid, signal.SIGKILL)


_PROGRAM = (
    "import sys; sys.path[:] = {path!r}; "
    "from arm_drake.batch.processes import serve; serve({fd}, {pid})"
)

_STDERR = 2

# A server or worker that has nothing to do ends within so long, or is killed [s].
_LONGEST_END = 1.0


class Server:
    """The process that forks workers, as the program sees it."""

    def __init__(self) -> None:
        """Start it; it imports what runs need, which takes a second."""
        self.pid = os.getpid()
        _open_streams()
        self._control, child_socket = socket.socketpair()
        path = [str(folder) for folder in sys.path]
        program = _PROGRAM.format(path=path, fd=child_socket.fileno(), pid=self.pid)
        # Ctrl-C isn't for it, also before it can say so.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process = subprocess.Popen(  # noqa: S603  Our own.
                [sys.executable, "-c", program],
                stdin=subprocess.DEVNULL,
                pass_fds=[child_socket.fileno()],
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            child_socket.close()

    def is_alive(self) -> bool:
        """Return whether it runs, as a child of this very process."""
        return self.pid == os.getpid() and self._process.poll() is None

    def fork(self) -> tuple[Connection, socket.socket]:
        """Return the connection to a new worker, and where its exit code will come.

        Raises ConnectionError if this process has died, OSError if there can't be more
        open files.
        """
        with contextlib.ExitStack() as stack:
            (data, child_socket), (status, its) = (
                [stack.enter_context(end) for end in socket.socketpair()]
                for _ in range(2)
            )
            socket.send_fds(
                self._control, [FORK], [child_socket.fileno(), its.fileno()]
            )
            return Connection(data.detach()), status.dup()

    def close(self) -> None:
        """End it, with all its workers."""
        if self.pid != os.getpid():
            return
        try:
            reply = self._control.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
            self._control.shutdown(socket.SHUT_RDWR)
        except OSError:
            reply = b""
        self._control.close()
        if reply != READY:  # It is importing, for nobody, and has no workers yet.
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
    """Return what `Server.fork` does; start a server if there is none, or OSError."""
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


# A worker that has grown by so much is replaced [bytes], whatever functions of users
# leave behind.
MAX_GROWTH = 256 * 2**20

# What follows each answer: whether the worker takes another input.
STAYS, LEAVES = b"stays", b"leaves"


class Setup(NamedTuple):
    """Environment that a worker needs before it can read the function."""

    environ: dict[str, str]
    path: list[str]
    argv: list[str]

    # None if it is gone.
    folder: str | None

    # What may be allocated in the worker [bytes]; None is anything.
    memory: int | None = None

    @classmethod
    def of_this_process(cls, memory: int | None = None) -> "Setup":
        """Return what makes a worker see what this process sees."""
        try:
            folder = os.getcwd()
        except OSError:
            folder = None
        return cls(dict(os.environ), list(sys.path), list(sys.argv), folder, memory)

    def apply(self) -> None:
        """Make this process see it."""
        os.environ.clear()
        os.environ.update(self.environ)
        sys.path[:] = self.path
        sys.argv[:] = self.argv
        if self.folder is not None:
            os.chdir(self.folder)
        if self.memory is not None and sys.platform == "linux":
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            most = pages * resource.getpagesize() + self.memory
            resource.setrlimit(resource.RLIMIT_AS, (most, most))


def work(connection: Connection) -> None:
    """Run received inputs until the connection is closed.

    The connection gives a Setup, the registered controller types, the function, then
    pairs of index and input, all pickled; it takes None or the error of the beginning,
    then each Done, and after it STAYS or LEAVES.
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
            connection.send_bytes(pack(done))
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


def pack(done: Done) -> bytes:
    """Return what became of a run as bytes."""
    if done.error is not None:
        done = dc.replace(done, error=sendable(done.error))
    try:
        return dumps(done, "the value of the run")
    except Exception as error:  # Whatever classes of users raise.
        failed = Done(done.index, None, sendable(error), done.wall_time)
        return dumps(failed, "the error")


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
        """Return what became of its run, or None once it is ready.

        Raises EOFError or OSError if it has died.
        """
        data = self.connection.recv_bytes()
        if self.is_ready:
            self.leaves = self.connection.recv_bytes() == LEAVES
            return self._read(data)
        self.trouble = loads(data)
        self.is_ready = self.trouble is None
        self.started = time.perf_counter()
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
        data = socket.socket(fileno=self.connection.fileno())
        _end(data)
        data.detach()
        self.connection.close()
        if timeout > 0.0:
            wait([self.status], timeout)
        _end(self.status)
        self.status.close()


def _end(end: socket.socket) -> None:
    """Let the other end know; closing is not enough if a fork has this end, too."""
    with contextlib.suppress(OSError):  # It may be gone.
        end.shutdown(socket.SHUT_RDWR)


class Pool:
    """Workers that run one function on many inputs."""

    def __init__(
        self,
        function: Callable[[Any], Any],
        items: Sequence[Any],
        waiting: deque[int],
        limits: Limits = NO_LIMITS,
    ) -> None:
        """Create it, without workers, or raise SendError of the function.

        `waiting` are the places of the inputs to run. What is left of them in the end
        had no workers, which is this one's `trouble`.
        """
        self._limits = limits
        self._beginning = (
            dumps(Setup.of_this_process(limits.memory), "what workers are to see"),
            dumps(CONTROLLER_TYPES.added, "a registered controller type"),
            dumps(function, "the function"),
        )
        self._items, self._waiting = items, waiting
        self._pid = os.getpid()
        self._workers: list[_Worker] = []
        # What has ended, and nobody was told.
        self._ended: list[Done] = []
        # Why the last worker that couldn't begin couldn't.
        self.trouble: Exception | None = None

    @property
    def num_workers(self) -> int:
        """Number of workers."""
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
            handles: list[Any] = [w.connection for w in self._workers]
            handles += [w.status for w in self._workers]
            ready = wait(handles, self._time_left())
            for worker in list(self._workers):
                if worker.connection in ready:
                    self._take(worker)
                elif worker.status in ready:
                    self._note_death(worker)
                elif worker.index is not None and self._is_late(worker):
                    self._end_late(worker)
            # They go on while the caller looks at what has ended.
            self._feed()

    def _time_left(self) -> float | None:
        """Return how long the first run may still take [s]; None is for ever."""
        working = [w for w in self._workers if w.is_ready and w.index is not None]
        running = [w.started for w in working]
        if self._limits.time is None or not running:
            return None
        first = min(running)
        return max(0.0, first + self._limits.time - time.perf_counter())

    def _is_late(self, worker: _Worker) -> bool:
        limit = self._limits.time
        if limit is None or not worker.is_ready:
            return False
        return time.perf_counter() - worker.started >= limit

    def _end_late(self, worker: _Worker) -> None:
        """End a worker whose run takes too long."""
        assert worker.index is not None
        text = f"the run took longer than its limit of {self._limits.time:g} s"
        duration = time.perf_counter() - worker.started
        self._ended.append(Done(worker.index, None, RunError(text), duration))
        self._remove(worker)

    def close(self, *, kill: bool) -> None:
        """End all workers, at once in the midst of what they do if to be killed."""
        if self._pid != os.getpid():  # The program has forked: they aren't this one's.
            return
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
            self._note_death(worker)
            return
        if done is not None:
            self._ended.append(done)
        if worker.trouble is not None:
            self._remove(worker, worker.trouble)
        elif worker.leaves:
            self._remove(worker)

    def _note_death(self, worker: _Worker) -> None:
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


def run_alone(
    function: Callable[[Any], Any], index: int, item: Any, limits: Limits
) -> Done:
    """Run an input in a process of its own, which ends where its limits are."""
    pool = Pool(function, [item], deque([0]), limits)
    try:
        pool.start(1)
        for done in pool.run():
            return dc.replace(done, index=index)
        return Done(index, None, pool.trouble or RunError("it couldn't begin"), 0.0)
    finally:
        pool.close(kill=True)
