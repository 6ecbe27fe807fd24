"""Runs: rollouts in words, what executes them, and their results.

This is the seam between a program and where its runs are executed: a Run goes there and
a RunResult comes back, both plain data that can be pickled. A RunStore keeps each in a
file as it ends, and what is in it is not run again.
"""

import contextvars
import dataclasses as dc
import fcntl
import hashlib
import math
import os
import pickle
import struct
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

import cloudpickle
import numpy as np

from arm_drake.batch.changes import change_robot
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot, list_robots
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError, OutputError
from arm_drake.importing import dataclass
from arm_drake.loading import load_robot
from arm_drake.messages import GoalStatus, Result
from arm_drake.options import SimulationOptions
from arm_drake.plant.payloads import Payloads
from arm_drake.rollout.rollout import Rollout
from arm_drake.simulation.mailbox import GoalHandle
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.motion_files import (
    MotionSource,
    find_motion,
)
from arm_drake.simulation.recording import list_failures, list_unfinished
from arm_drake.simulation.simulation import Simulation
from arm_drake.worlds.world import World

# In a thread that executes runs: whether to stop.
_STOP: contextvars.ContextVar[threading.Event | None] = contextvars.ContextVar(
    "arm_drake_stop", default=None
)

# Set in a worker process.
_IS_WORKER = threading.Event()


class Stop(BaseException):
    """Nobody waits for this run any more."""


def enter_thread(stop: threading.Event) -> None:
    """Mark this thread as one that executes runs, until the event is set."""
    _STOP.set(stop)


def enter_process() -> None:
    """Note that this process executes runs of another one."""
    _IS_WORKER.set()


def is_nested() -> bool:
    """Return whether this is within a run that has others beside it."""
    return _IS_WORKER.is_set() or _STOP.get() is not None


def check_stop() -> None:
    """Raise Stop if a stop of this run was requested."""
    stop = _STOP.get()
    if stop is not None and stop.is_set():
        raise Stop


# What a run says of the loading, none of which a loaded robot can be told.
_LOADING = ("controllers", "xacro_args", "package_paths", "initial_positions")


_NONE = type(None)

# Types of fields, and what they are in words.
_FIELDS: dict[str, tuple[tuple[type, ...], str]] = {
    "robot": ((str, Path, Robot, Sequence), "a name, a file, or loaded robots"),
    "motion": ((str, Path, Motion, _NONE), "a name, a file, or a loaded motion"),
    "parameters": ((Mapping,), "values by name"),
    "duration": ((Real, _NONE), "a number of seconds"),
    "controllers": ((str, Path, Sequence, _NONE), "a YAML file, or several"),
    "package_paths": ((Sequence,), "a list of folders"),
    "xacro_args": ((Mapping, _NONE), "values by name"),
    "initial_positions": ((Mapping, _NONE), "positions by joint"),
    "options": ((SimulationOptions,), "SimulationOptions"),
    "payloads": ((Mapping, _NONE), "payloads by link"),
    "changes": ((Mapping,), "numbers by name"),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """One rollout, in words: a robot, a motion, and how to simulate.

    Raises:
        InputError: If something is given that can't be used, or has no effect.
    """

    # What `load_robot` takes, or robots that it has loaded.
    robot: str | Path | Robot | Sequence[Robot]

    # Name of a bundled motion, a file, or a motion that is loaded. It is for the first
    # robot where there are several.
    motion: MotionSource | None = None

    # Values of the motion's parameters.
    parameters: Mapping[str, Any] = dc.field(default_factory=dict)

    # How long to simulate [s]; by default 1 s longer than the motion (one round of it),
    # 10 s without one.
    duration: float | None = None

    # As those of `load_robot`; None and () are its defaults.
    controllers: Any = None
    xacro_args: Mapping[str, str] | None = None
    package_paths: Any = ()
    initial_positions: Mapping[str, float] | None = None

    # As those of `build_diagram`.
    world: World = "empty"
    options: SimulationOptions = dc.field(default_factory=SimulationOptions)
    payloads: Payloads | None = None

    # What else of the robot is to be other than its files say, by name: factors such as
    # "scale.friction" (of all joints), "scale.friction.joint2", "scale.damping",
    # "scale.gains" or "scale.gains.joint2.p"; numbers such as "gains.joint2.p",
    # "initial.joint2" and "controller.arm_controller.constraints.goal_time".
    changes: Mapping[str, float] = dc.field(default_factory=dict)

    # Whatever tells it from the others.
    name: str = ""

    def __post_init__(self) -> None:
        """Reject what can't be used, and what would have no effect."""
        for name, (types, expected) in _FIELDS.items():
            value = getattr(self, name)
            if not isinstance(value, types) or isinstance(value, bool):
                raise InputError(f"{name}: expected {expected}, got {value!r}")
        if not isinstance(self.robot, str | Path):
            robots = [self.robot] if isinstance(self.robot, Robot) else self.robot
            for robot in robots:
                if not isinstance(robot, Robot):
                    raise InputError(
                        "robot: expected loaded robots in a list, as of load_robot, "
                        f"got {robot!r}"
                    )
            names = [name for name in _LOADING if getattr(self, name)]
            if names:
                raise InputError(
                    f"{names[0]} is for a robot that the run loads; this one is loaded "
                    f"already, give it to load_robot(..., {names[0]}=...)"
                )
        if self.parameters and (self.motion is None or isinstance(self.motion, Motion)):
            raise InputError(
                "parameters are for a motion by name or file, which the run loads; "
                + ("give motion, too" if self.motion is None else "this one is loaded")
            )
        seconds = self.duration
        if seconds is not None and not (math.isfinite(seconds) and seconds >= 0.0):
            raise InputError(f"duration must be at least 0 s, got {seconds!r}")


@dataclass(frozen=True)
class GoalOutcome:
    """Final status and result of a goal of a run."""

    # Name of the controller.
    controller: str

    status: GoalStatus
    result: Result | None

    # Status and result in words.
    text: str

    # Where it comes from, as a step of a motion file.
    where: str

    @classmethod
    def of(cls, goal: GoalHandle) -> "GoalOutcome":
        """Return what became of a goal."""
        return cls(
            goal.controller, goal.status, goal.result, goal.describe(), goal.where
        )


@dataclass(frozen=True, eq=False)
class Outcome:
    """Record of a run that is kept by default."""

    # What each robot did, by its name.
    rollouts: Mapping[str, Rollout]

    # Its goals, in the order in which they were sent.
    goals: tuple[GoalOutcome, ...]

    # A line for all that failed: goals, messages, switches, controllers.
    failures: tuple[str, ...]

    # What of the first robot was not taken as written.
    report: LoadReport

    # A line for each goal that had not ended when the run did.
    unfinished: tuple[str, ...] = ()

    @property
    def rollout(self) -> Rollout:
        """Rollout of the first robot."""
        return next(iter(self.rollouts.values()))

    @classmethod
    def of(cls, simulation: Simulation) -> "Outcome":
        """Return what became of a simulation that has run."""
        return cls(
            {name: simulation.rollout(name) for name in simulation.robots},
            tuple(GoalOutcome.of(goal) for goal in simulation.goals),
            tuple(list_failures(simulation.mailbox)),
            simulation.report,
            tuple(list_unfinished(simulation.mailbox)),
        )


# Loading and building read and change what is one for the process: xacro, Drake's log.
_PREPARING = threading.Lock()


class Runner:
    """Executes runs one after the other, each as if it were the first.

    A simulation that the last run left is reset and used again if the next one differs
    in its motion and duration alone: that is bit by bit the same as a fresh one. But
    where a function of a user gets it, it is that user's, and may be kept or changed.
    """

    def __init__(self, keep: Callable[[Simulation], Any] | None = None) -> None:
        """Create it with what returns what to keep; None is an Outcome."""
        self._keep = keep
        # Some leave simulations as they are.
        self._reuses = keep is None or getattr(keep, "only_reads", False)
        # Key, robot and simulation of each thread's last run.
        self._local = threading.local()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make another one: simulations can't be sent."""
        return (Runner, (self._keep,))

    def __call__(self, run: Run) -> Any:
        """Execute a run and return what is kept of it."""
        # An error leaves nothing to use again.
        last = getattr(self._local, "last", None)
        self._local.last = None
        key = _key(run) if self._reuses else None
        with _PREPARING:
            if last is not None and last[0] == key and _is_same(last[1], run.robot):
                simulation = last[2]
                simulation.reset()
            else:
                simulation = self._prepare(run)
            robot = next(iter(simulation.robots.values()))
            motion = _find_motion(run, robot)
        simulation.run(run.duration, motion, progress=lambda _: check_stop())
        value = (self._keep or Outcome.of)(simulation)
        if key is not None:
            self._local.last = (key, run.robot, simulation)
        return value

    def _prepare(self, run: Run) -> Simulation:
        """Return the simulation of a run, at time 0."""
        # The robot of the last run may be that of the next one, too.
        robots = getattr(self._local, "robots", {})
        loaded = load_run(dc.replace(run, motion=None, parameters={}), robots)
        self._local.robots = dict(list(robots.items())[-1:])
        robots_of: Any = loaded.robot
        first, *others = [robots_of] if isinstance(robots_of, Robot) else robots_of
        first = change_robot(first, run.changes)
        return Simulation(
            build_diagram(
                [first, *others],
                world=run.world,
                options=run.options,
                payloads=run.payloads,
            )
        )


def _key(run: Run) -> bytes | None:
    """Return what is the same for runs that can share a simulation, or None.

    It is without the robot.
    """
    if callable(run.world):  # It may add something else each time.
        return None
    building = ("world", "options", "payloads", "changes")
    what = [getattr(run, name) for name in (*_LOADING, *building)]
    try:
        return pickle.dumps(what)
    except Exception:  # Whatever functions and classes of users raise.
        return None


def _is_same(robot: Any, other: Any) -> bool:
    """Return whether robots of two runs are the same, or say the same."""
    if robot is other:
        return True
    try:
        return pickle.dumps(robot) == pickle.dumps(other)
    except Exception:  # Whatever functions and classes of users raise.
        return False


def load_run(run: Run, robots: dict[bytes, Robot]) -> Run:
    """Return a run that needs no files: its robot and its motion are loaded.

    `robots` has those that are loaded already, which change as they are needed.
    """
    robot = run.robot
    if isinstance(robot, str | Path):
        arguments = (robot, *(getattr(run, name) for name in _LOADING))
        key = pickle.dumps(arguments)
        if key not in robots:
            robots[key] = load_robot(
                robot,
                controllers=run.controllers,
                xacro_args=run.xacro_args,
                package_paths=run.package_paths,
                initial_positions=run.initial_positions,
            )
        robot = robots[key]
    first = robot if isinstance(robot, Robot) else list_robots(robot)[0]
    nothing: dict[str, Any] = dict.fromkeys(_LOADING)
    return dc.replace(
        run,
        robot=robot,
        motion=_find_motion(run, first),
        parameters={},
        **{**nothing, "package_paths": ()},
    )


def _find_motion(run: Run, robot: Robot) -> Motion | None:
    if run.motion is None:
        return None
    return find_motion(run.motion, robot, run.parameters)


Value = TypeVar("Value")


@dataclass(frozen=True, eq=False)
class Done:
    """A run that has ended, well or not."""

    # Its place in the list of runs.
    index: int

    value: Any
    error: Exception | None

    # How long it took where it ran [s].
    wall_time: float

    # Where that was, if it was on a cluster; how often it was begun, and the workers
    # that died with it.
    worker: str = ""
    attempts: int = 1
    died: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RunResult(Generic[Value]):
    """Result of one run."""

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

    # With `on`: the worker that had it, and those that died while they had it.
    worker: str = ""
    died: tuple[str, ...] = ()

    # How often it was begun.
    attempts: int = 1

    @property
    def value(self) -> Value:
        """Value kept of the run.

        Raises:
            Exception: The run's error, if it failed.
        """
        if self.error is not None:
            raise self.error
        return self.kept  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class RunResults(Sequence[RunResult[Value]]):
    """Results of all runs, in the order of the inputs."""

    results: tuple[RunResult[Value], ...]

    # Where they ran: "serial", "threads", "processes" or "executor", and in how many at
    # a time.
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
        """Return the number of runs."""
        return len(self.results)

    def __iter__(self) -> Iterator[RunResult[Value]]:
        """Iterate over the results."""
        return iter(self.results)

    @property
    def values(self) -> list[Value]:
        """Values kept of the runs.

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
        for result in self.results:
            if result.attempts > 1 and result.error is None:
                why = f", for {' and '.join(result.died)} died" if result.died else ""
                lines.append(f"run {result.index}: tried again{why}")
        for result in self.failed:
            lines.append(f"run {result.index}: {describe(result.error)}")
        return "\n".join(lines)


class RunsInterrupted(KeyboardInterrupt, Generic[Value]):
    """Ctrl-C while runs were under way; what was finished is here."""

    def __init__(self, results: Iterable[RunResult[Value]], num_runs: int) -> None:
        """Create it for the runs that were finished, of how many."""
        self.results = tuple(results)
        super().__init__(f"{len(self.results)} of {num_runs} runs were finished")


def describe(error: BaseException | None) -> str:
    """Return an error's type and text."""
    try:
        text = str(error)
    except Exception:  # Classes of others may raise anything.
        text = "it can't say what"
    return f"{type(error).__name__}: {text}"


# A file of results begins with a line, and has a record for each run that ended well:
# length and checksum, then index, fingerprint of the input, wall time and value in a
# pickle. A record that was cut short, by a kill or a full disk, is dropped when it is
# opened again.
_FIRST = b"arm_drake runs 1\n"

# Length and CRC-32 of what follows.
_HEAD = struct.Struct("<QI")


class RunStore:
    """The file of a study, open for this program alone."""

    def __init__(self, path: str | Path, items: Sequence[Any]) -> None:
        """Open or make it; InputError if it is of other runs, or another program's."""
        self.path = Path(path)
        self._prints = [fingerprint(item) for item in items]
        # What was there: the runs that ended well, by index.
        self.done: dict[int, Done] = {}
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise OutputError(f"it can't be opened: {error}", file=path) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise InputError("another program writes it", file=path) from None
        try:
            self._end = self._read()
        except BaseException:
            self.close()
            raise

    def _read(self) -> int:
        """Read the stored results; return where the last whole record ends."""
        with os.fdopen(os.dup(self._file), "rb") as file:
            first = file.read(len(_FIRST))
            if first and not _FIRST.startswith(first):
                text = "expected a file of results, or none"
                raise InputError(text, file=self.path)
            if first != _FIRST:
                return self._begin()
            end = file.tell()
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                size, checksum = _HEAD.unpack(head)
                data = file.read(min(size, os.fstat(self._file).st_size))
                if len(data) < size or zlib.crc32(data) != checksum:
                    break
                self._take(data)
                end = file.tell()
        return end

    def _begin(self) -> int:
        self._end = 0
        self._write(_FIRST)
        return len(_FIRST)

    def _take(self, data: bytes) -> None:
        index, mark, wall_time, value = pickle.loads(data)  # noqa: S301  A user's own.
        if not (index < len(self._prints) and self._prints[index] == mark):
            text = f"it has results of other runs: run {index} is another one now"
            raise InputError(f"{text}; name another file", file=self.path)
        self.done[index] = Done(index, value, None, wall_time)

    def add(self, done: Done) -> None:
        """Write a run that has ended; one that failed is left for the next time."""
        if done.error is not None:
            return
        mark = self._prints[done.index]
        data = cloudpickle.dumps((done.index, mark, done.wall_time, done.value))
        self._write(_HEAD.pack(len(data), zlib.crc32(data)) + data)

    def _write(self, data: bytes) -> None:
        try:
            written = 0
            while written < len(data):
                at = self._end + written
                written += os.pwrite(self._file, data[written:], at)
        except OSError as error:
            os.ftruncate(self._file, self._end)
            text = f"it can't be written: {error}; what it has is kept"
            raise OutputError(text, file=self.path) from None
        self._end += written

    def close(self) -> None:
        """Close it."""
        os.close(self._file)


def fingerprint(item: Any) -> str:
    """Return what is the same for the same input in every process."""
    return hashlib.sha256(repr(_plain(item)).encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """Return an object whose repr identifies an input."""
    if isinstance(value, Robot):
        # What it was made of; its files' content is in the description.
        files = hashlib.sha256(value.description.source.encode()).hexdigest()
        return ("Robot", value.name, files, _plain(value.load_options))
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.shape, value.tobytes())
    if isinstance(value, np.generic):
        return value.item()
    if dc.is_dataclass(value) and not isinstance(value, type):
        fields = [(f.name, _plain(getattr(value, f.name))) for f in dc.fields(value)]
        return (type(value).__qualname__, fields)
    if isinstance(value, Mapping):
        return [(_plain(key), _plain(each)) for key, each in value.items()]
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, set | frozenset):
        return sorted(map(repr, map(_plain, value)))
    if callable(value):
        return (value.__module__, getattr(value, "__qualname__", type(value).__name__))
    if isinstance(value, str | bytes | int | float | complex | Path) or value is None:
        return str(value) if isinstance(value, Path) else value
    return hashlib.sha256(cloudpickle.dumps(value)).hexdigest()
