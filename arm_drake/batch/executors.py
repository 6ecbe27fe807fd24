"""Runs on executors: clusters of dask, and whatever is a concurrent.futures.Executor.

A call of `execute` there has one run, or some if they are short: a task costs dask some
milliseconds. Functions and loaded robots are many runs' and are named by their hash; a
worker that lacks one asks for it and keeps it, so that they go to each worker once.
Robots are loaded here, never there: their meshes go with them.
"""

import concurrent.futures as cf
import contextlib
import contextvars
import dataclasses as dc
import functools
import hashlib
import importlib.metadata
import io
import os
import pickle
import queue
import socket
import sys
import threading
import time
import uuid
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import cloudpickle

from arm_drake.batch.processes import (
    Limits,
    RunError,
    SendError,
    attempt,
    loads,
    pack,
    run_alone,
)
from arm_drake.batch.runs import Done, Run, describe, enter_thread, load_run
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.description.links import LinkInfo, ShapeInfo
from arm_drake.description.meshes.conversion import cache_directory
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.worlds.things import LoadedWorld
from arm_drake.worlds.world import WORLDS, load_world

# How often to look whether there are more workers [s].
_LOOK = 5.0

# So many functions and robots a worker keeps in memory.
_MOST_KEPT = 16

# Short runs go together for so long, as they took before [s], and so many bytes. A call
# costs program and scheduler some 5 ms: more workers get longer ones.
_BATCH_TIME, _TIME_PER_WORKER, _BATCH_BYTES = 0.25, 0.01, 1_000_000

# Part of a new wall time in the mean of them.
_SMOOTHING = 0.2


class Missing(NamedTuple):
    """The answer of a worker that lacks something: its hashes."""

    hashes: tuple[str, ...]


class Refused(NamedTuple):
    """The answer of a worker that has other versions."""

    why: str


@functools.cache
def versions() -> dict[str, str]:
    """Return what must be the same on both sides."""
    names = ("arm-drake", "drake")
    found = {name: importlib.metadata.version(name) for name in names}
    return {"Python": "{}.{}".format(*sys.version_info[:2]), **found}


def compare_versions(theirs: Mapping[str, str], ours: Mapping[str, str]) -> str:
    """Return why a worker can't be used; empty if it can."""
    return ", ".join(
        f"it has {name} {theirs.get(name, 'none')}, this program {version}"
        for name, version in ours.items()
        if theirs.get(name) != version
    )


@dc.dataclass
class _Kept:
    """Data that this process received, and later the object made of it."""

    value: Any


# By hash; the oldest go first. Whoever runs holds what it needs, whatever goes here.
_kept: OrderedDict[str, _Kept] = OrderedDict()
_lock = threading.Lock()


def execute(
    theirs: Mapping[str, str],
    needs: Sequence[str],
    sent: Mapping[str, bytes],
    items: Sequence[tuple[int, bytes]],
    limits: Limits,
    topic: str,
) -> list[bytes] | Missing | Refused:
    """Run inputs on a worker; return a Done of each in bytes, or why it can't be.

    `needs` are hashes of the function and of all that it and the inputs refer to,
    `sent` is some of that by hash. At `topic` dask is told who runs them; it is empty
    for others.
    """
    if why := compare_versions(versions(), theirs):
        return Refused(f"{name_worker()}: {why}")
    with _lock:
        for key, data in sent.items():
            _kept.setdefault(key, _Kept(data))
        missing = tuple(key for key in needs if key not in _kept)
        if missing:
            return Missing(missing)
        for key in needs:
            _kept.move_to_end(key)
        objects = {key: _kept[key] for key in needs}
    if topic:
        _log_to_dask(topic, [index for index, _ in items])
    answers = []
    for index, item in items:
        # What can't be read is that run's error, too.
        run = functools.partial(_run, objects, needs[0], limits, index)
        begun = attempt(run, index, item)
        done = begun if begun.error is not None else begun.value
        answers.append(pack(dc.replace(done, worker=name_worker())))
    with _lock:
        while len(_kept) > max(_MOST_KEPT, len(needs)):
            _kept.popitem(last=False)
    return answers


def _run(
    objects: Mapping[str, _Kept],
    function_key: str,
    limits: Limits,
    index: int,
    item: bytes,
) -> Done:
    """Run one input, with the function and the robots that it needs."""

    def run() -> Done:
        enter_thread(threading.Event())
        with _lock:
            function, value = _take(objects, function_key), _read(objects, item)
        if limits.are_set:
            return run_alone(function, index, value, limits)
        return attempt(function, index, value)

    return contextvars.copy_context().run(run)


def _log_to_dask(topic: str, indices: Sequence[int]) -> None:
    with contextlib.suppress(Exception):  # It is of no importance.
        distributed = sys.modules["distributed"]
        distributed.get_worker().log_event(topic, (indices, name_worker()))


def name_worker() -> str:
    """Return what this worker is called."""
    with contextlib.suppress(Exception):  # No dask, or no worker of it.
        return str(sys.modules["distributed"].get_worker().address)
    return f"{socket.gethostname()}, process {os.getpid()}"


def _take(objects: Mapping[str, _Kept], key: str) -> Any:
    """Return what a hash names; what was sent is read once."""
    kept = objects[key]
    if isinstance(kept.value, bytes):
        kept.value = _read(objects, kept.value)
    if isinstance(kept.value, _SentFunction):
        for name, row in kept.value.types.items():
            CONTROLLER_TYPES.setdefault(name, row)
        kept.value = kept.value.function
    elif isinstance(kept.value, _SentRobot | _SentWorld):
        kept.value = kept.value.unpack()
    return kept.value


class _Reader(pickle.Unpickler):
    """Reads what a _Sender has written."""

    def __init__(self, objects: Mapping[str, _Kept], data: bytes) -> None:
        super().__init__(io.BytesIO(data))
        self._objects = objects

    def persistent_load(self, pid: Any) -> Any:
        return _take(self._objects, pid)


def _read(objects: Mapping[str, _Kept], data: bytes) -> Any:
    return _Reader(objects, data).load()


class _SentFunction(NamedTuple):
    """A function, and the controller types that the program has registered."""

    function: Callable[[Any], Any]
    types: Mapping[str, Any]


class _SentRobot(NamedTuple):
    """A robot, and the files of the shapes that it collides with, by their names."""

    robot: Robot
    files: Mapping[str, bytes]

    @classmethod
    def of(cls, robot: Robot) -> "_SentRobot":
        # What it says of packages is found where they are.
        _ = robot.portable_source
        files: dict[str, bytes] = {}
        for link in robot.description.link_infos:
            for path in filter(None, map(_path_of, link.collisions)):
                files[str(path)] = path.read_bytes()
        return cls(robot, files)

    def unpack(self) -> Robot:
        """Return the robot with its files where this worker keeps them."""
        description = self.robot.description
        links = tuple(map(self._unpack_link, description.link_infos))
        description = dc.replace(description, link_infos=links)
        return dc.replace(self.robot, description=description)

    def _unpack_link(self, link: LinkInfo) -> LinkInfo:
        # Nobody looks at what is missing there.
        paths = [(visual, _path_of(visual)) for visual in link.visuals]
        visuals = [visual for visual, path in paths if not path or path.exists()]
        collisions = map(self._unpack_shape, link.collisions)
        return dc.replace(link, visuals=tuple(visuals), collisions=tuple(collisions))

    def _unpack_shape(self, shape: ShapeInfo) -> ShapeInfo:
        path = _path_of(shape)
        if path is None:
            return shape
        file = _keep_file(path, self.files[str(path)])
        mesh = dc.replace(shape.geometry, filename=file.as_uri())
        return dc.replace(shape, geometry=mesh)


def _path_of(shape: ShapeInfo) -> Path | None:
    """Return the file of a shape's mesh, None of other shapes."""
    mesh = shape.geometry
    if mesh.type != "mesh":
        return None
    return Path(unquote(mesh.filename.removeprefix("file://")))


class _SentWorld(NamedTuple):
    """A world that is one file, which refers to no other."""

    path: Path
    data: bytes

    @classmethod
    def of(cls, world: str | Path) -> "_SentWorld | None":
        """Return what is sent for a run's world; None if it goes as it is."""
        path = Path(world).expanduser()
        if world in WORLDS or not path.is_file():
            return None
        data = path.read_bytes()
        return None if b"<uri>" in data else cls(path.absolute(), data)

    def unpack(self) -> LoadedWorld:
        """Return the world, from where this worker keeps it."""
        return load_world(_keep_file(self.path, self.data))


def _keep_file(path: Path, data: bytes) -> Path:
    """Return a file with this content and name; write it if it isn't there."""
    with contextlib.suppress(OSError):
        if path.read_bytes() == data:
            return path
    folder = cache_directory().parent / "sent"
    # A world may be called as its file.
    kept = folder / hashlib.sha256(data).hexdigest() / path.name
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(f".{uuid.uuid4().hex}")
        part.write_bytes(data)
        part.replace(kept)
    return kept


class _Sender:
    """Makes bytes of functions and inputs, with hashes for robots and worlds."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.blobs: dict[str, bytes] = {}
        # What was sent by hash, with its hash, by identity.
        self._sent: dict[int, tuple[Any, str]] = {}
        self._worlds: dict[str, _SentWorld | None] = {}
        sent = _SentFunction(function, dict(CONTROLLER_TYPES.added))
        data, refers = self._dump(sent, "the function")
        # The function is the first of what is needed.
        self._function = (self._keep(data), *refers)

    def dump(self, item: Any) -> tuple[bytes, tuple[str, ...]]:
        """Return an input as bytes, and all hashes that it needs."""
        data, refers = self._dump(item, "the input of the run")
        return data, tuple(dict.fromkeys((*self._function, *refers)))

    def _dump(self, what: Any, role: str) -> tuple[bytes, list[str]]:
        refers: list[str] = []

        def refer(part: Any) -> str | None:
            if not isinstance(part, Robot | _SentWorld):
                return None
            refers.append(self._key_of(part))
            return refers[-1]

        file = io.BytesIO()
        try:
            pickler = type("_", (cloudpickle.Pickler,), {})(file)
            pickler.persistent_id = refer
            pickler.dump(what)
        except Exception as error:  # Whatever classes of users raise.
            text = f"{role} can't be sent to other processes: {error}"
            raise SendError(f"{text}; expected what cloudpickle takes") from None
        return file.getvalue(), refers

    def _key_of(self, part: "Robot | _SentWorld") -> str:
        if id(part) not in self._sent:
            sent = _SentRobot.of(part) if isinstance(part, Robot) else part
            self._sent[id(part)] = part, self._keep(cloudpickle.dumps(sent))
        return self._sent[id(part)][1]

    def with_world(self, run: Run) -> Run:
        """Return a run whose world is sent, if that is a file which can be."""
        if not isinstance(run.world, str | Path):
            return run
        name = str(run.world)
        if name not in self._worlds:
            self._worlds[name] = _SentWorld.of(run.world)
        world: Any = self._worlds[name]
        return run if world is None else dc.replace(run, world=world)

    def _keep(self, data: bytes) -> str:
        key = hashlib.sha256(data).hexdigest()
        self.blobs[key] = data
        return key


class RunPool:
    """Pool that executes runs: a client of dask, or an executor."""

    def __init__(self, on: Any) -> None:
        """Take it; raises InputError if it is neither."""
        self._on, self.topic = on, ""
        self._make = None if isinstance(on, cf.Executor) else on
        self._looked_at, self._width = -_LOOK, 0
        # Who began which run, as dask tells.
        self.began: dict[int, dict[str, None]] = {}
        if _is_client(on):
            self._join()
        elif self._make is None:
            self._executor = on
        elif callable(on):
            self._executor = self._made()
        else:
            raise InputError(
                "on: expected a Client of dask.distributed, a concurrent.futures."
                f"Executor, or a function that makes one, got {type(on).__name__}"
            )

    def _made(self) -> Any:
        executor = self._make()  # type: ignore[misc]
        if not hasattr(executor, "submit"):
            kind = type(executor).__name__
            raise InputError(f"on: expected it to make an Executor, got {kind}")
        return executor

    def _join(self) -> None:
        """Use a client of dask, and those of its workers that can be used."""
        found = self._on.run(versions, on_error="return")
        problems = {
            worker: describe(theirs)
            if isinstance(theirs, BaseException)
            else compare_versions(theirs, versions())
            for worker, theirs in found.items()
        }
        bad = [f"{worker}: {why}" for worker, why in problems.items() if why]
        if found and len(bad) == len(found):
            raise InputError(f"on: no worker can be used; {'; '.join(bad)}")
        for line in bad:
            print(f"run_many: not used: {line}", file=sys.stderr)
        good = [worker for worker, why in problems.items() if not why]
        options = {"workers": good} if bad else {}
        self._make = None
        self._executor = self._on.get_executor(pure=False, **options)
        self.topic = f"arm_drake-{uuid.uuid4().hex}"
        self._on.subscribe_topic(self.topic, self._note)

    def _note(self, event: tuple[float, tuple[Sequence[int], str]]) -> None:
        indices, worker = event[1]
        for index in indices:
            self.began.setdefault(index, {})[worker] = None

    def width(self) -> int:
        """Return how many calls should be under way: one works while one waits."""
        now = time.monotonic()
        if now - self._looked_at >= _LOOK:
            self._looked_at = now
            if self.topic:
                workers = sum(self._on.nthreads().values())
            else:
                workers = getattr(self._executor, "_max_workers", os.cpu_count() or 1)
            self._width = max(1, workers)
        return 2 * self._width

    def submit(self, *task: Any) -> Any:
        """Return the future of a call of `execute`."""
        return self._executor.submit(execute, *task, self.topic)

    def renew(self) -> bool:
        """Replace an executor that is broken; return whether that can be done."""
        if self._make is None:
            return False
        self._executor.shutdown(wait=False)
        self._executor = self._made()
        return True

    def close(self) -> None:
        """Forget what was made here."""
        if self.topic:
            self._on.unsubscribe_topic(self.topic)
        if self._make is not None:
            self._executor.shutdown(wait=False, cancel_futures=True)

    def __str__(self) -> str:
        """Return what it is."""
        return repr(self._on if self._make is None else self._executor)


def _is_client(on: Any) -> bool:
    distributed = sys.modules.get("distributed")
    return distributed is not None and isinstance(on, distributed.Client)


class _Packed(NamedTuple):
    """An input in bytes."""

    place: int
    data: bytes

    # Hashes of all that it needs, the function's first.
    needs: tuple[str, ...]


@dc.dataclass
class _Batch:
    """Runs that are under way together."""

    runs: list[_Packed]
    attempts: int = 1
    since: float = dc.field(default_factory=time.perf_counter)

    @property
    def needs(self) -> tuple[str, ...]:
        """Hashes of all that they need, the function's first."""
        return tuple(dict.fromkeys(key for run in self.runs for key in run.needs))

    def split(self, attempts: int) -> "list[_Batch]":
        """Return a batch for each."""
        return [_Batch([run], attempts, self.since) for run in self.runs]


class Dispatch:
    """Gives runs to a pool, and yields what becomes of them as they end."""

    def __init__(
        self,
        pool: RunPool,
        function: Callable[[Any], Any],
        items: Sequence[Any],
        limits: Limits,
    ) -> None:
        """Create it, or raise SendError of the function."""
        self._pool, self._items, self._limits = pool, items, limits
        self._sender = _Sender(function)
        self._robots: dict[bytes, Robot] = {}
        self._waiting = deque(range(len(items)))
        # They were given before.
        self._again: deque[_Batch] = deque()
        self._under_way: dict[Any, _Batch] = {}
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._failed: list[Done] = []
        # What runs take, about [s]; None before the first one has ended.
        self._took: float | None = None

    def run(self) -> Iterator[Done]:
        """Yield what becomes of the runs; who closes it cancels the rest."""
        try:
            while self._waiting or self._again or self._under_way:
                while self._may_give():
                    batch = self._again.popleft() if self._again else self._pack()
                    if batch.runs:
                        self._give(batch)
                yield from self._take_failed()
                if self._under_way:
                    future = self._ended.get()
                    yield from self._take(future)
            yield from self._take_failed()
        finally:
            for future in self._under_way:
                future.cancel()
            self._pool.close()

    def _may_give(self) -> bool:
        """Return whether another batch may be submitted now."""
        if len(self._under_way) >= self._pool.width():
            return False
        if self._pool.topic or not (self._again or self._under_way):
            return bool(self._again or self._waiting)
        # An executor breaks as a whole: who was there when it did is alone there the
        # second time, so that nobody pays for another one.
        if self._again:
            return not self._under_way
        is_alone = any(batch.attempts > 1 for batch in self._under_way.values())
        return bool(self._waiting) and not is_alone

    def _take_failed(self) -> Iterator[Done]:
        failed, self._failed = self._failed, []
        yield from failed

    def _pack(self) -> _Batch:
        """Return the next runs as bytes, without those that can't be sent."""
        runs: list[_Packed] = []
        size = 0
        for _ in range(self._batch_size()):
            index = self._waiting.popleft()
            try:
                item = self._items[index]
                if isinstance(item, Run):
                    item = self._sender.with_world(load_run(item, self._robots))
                runs.append(_Packed(index, *self._sender.dump(item)))
            except Exception as error:
                failed = attempt(functools.partial(_raise, error), index, None)
                self._failed.append(failed)
                continue
            size += len(runs[-1].data)
            if size > _BATCH_BYTES:
                break
        return _Batch(runs)

    def _batch_size(self) -> int:
        """Return how many runs go together: few enough that all workers have some."""
        if self._took is None or self._limits.are_set:
            return 1
        width = self._pool.width()
        share = len(self._waiting) // (2 * width)
        lasts = max(_BATCH_TIME, _TIME_PER_WORKER * width / 2)
        return max(1, min(int(lasts / max(self._took, 1e-6)), share))

    def _give(self, batch: _Batch, sent: Mapping[str, bytes] | None = None) -> None:
        """Submit runs; what can't be is their error."""
        items = [(run.place, run.data) for run in batch.runs]
        task = (versions(), batch.needs, sent or {}, items, self._limits)
        try:
            future = self._pool.submit(*task)
        except Exception as error:
            if isinstance(error, cf.BrokenExecutor) and self._pool.renew():
                future = self._pool.submit(*task)
            else:
                self._fail(batch, f"it can't be submitted: {describe(error)}")
                return
        self._under_way[future] = batch
        future.add_done_callback(self._ended.put)

    def _fail(self, batch: _Batch, why: str) -> None:
        wall_time = time.perf_counter() - batch.since
        self._failed += [
            Done(run.place, None, RunError(why), wall_time, attempts=batch.attempts)
            for run in batch.runs
        ]

    def _take(self, future: Any) -> Iterator[Done]:
        batch = self._under_way.pop(future)
        try:
            answer = future.result()
        except cf.BrokenExecutor as error:
            self._try_again(batch, f"the executor broke while it was there: {error}")
            return
        except (Exception, cf.CancelledError) as error:
            self._note_error(batch, error)
            return
        if isinstance(answer, Missing):
            blobs = {key: self._sender.blobs[key] for key in answer.hashes}
            self._give(batch, blobs)
        elif isinstance(answer, Refused):
            self._try_again(batch, f"a worker refused it: {answer.why}")
        else:
            for data in answer:
                yield self._note_done(loads(data), batch)

    def _note_done(self, done: Done, batch: _Batch) -> Done:
        """Return what became of a run, with the workers that died with it."""
        before = 0.0 if self._took is None else (1.0 - _SMOOTHING) * self._took
        part = 1.0 if self._took is None else _SMOOTHING
        self._took = before + part * done.wall_time
        workers = self._pool.began.pop(done.index, {})
        died = tuple(worker for worker in workers if worker != done.worker)
        attempts = max(batch.attempts, 1 + len(died))
        return dc.replace(done, attempts=attempts, died=died)

    def _try_again(self, batch: _Batch, why: str) -> None:
        """Try runs once more, each alone, or let them fail."""
        if batch.attempts > 1:
            self._fail(batch, f"{why} (tried twice)")
            return
        self._again += batch.split(batch.attempts + 1)

    def _note_error(self, batch: _Batch, error: BaseException) -> None:
        """Note why runs have no answer: not their own errors, those are in answers."""
        kind, text = type(error).__name__, describe(error)
        if isinstance(error, ImportError):
            self._fail(batch, f"a worker can't run it: {text}; install arm-drake there")
        elif kind == "KilledWorker" and len(batch.runs) > 1:
            # Who it was is known once each was alone.
            self._again += batch.split(batch.attempts)
        elif kind == "KilledWorker":
            began = self._pool.began.pop(batch.runs[0].place, {})
            workers = ", ".join(began) or "its workers"
            self._fail(batch, f"{workers} died while they had this run")
        else:
            self._try_again(batch, f"its worker is lost: {text}")


def _raise(error: Exception, _: Any) -> None:
    raise error
