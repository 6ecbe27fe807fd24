"""Recordings: the logs in a diagram as a Rollout, in memory and in a file."""

import dataclasses as dc
import functools
import math
import platform
import weakref
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import VectorLogSink

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot, name_portably
from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.manager.connections import COMMAND_LOG, reference_joints
from arm_drake.messages import (
    ActionRequest,
    FollowJointTrajectoryResult,
    Header,
    JointState,
    Message,
)
from arm_drake.messages.base import NANOSECONDS, stamp_of
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import CONTACT_LOG, Shape
from arm_drake.plant.initial_poses import read_free_poses
from arm_drake.python_system import PythonSystem
from arm_drake.rollout.rollout import (
    ClientInput,
    GoalRecord,
    Reference,
    Rollout,
    SentMessage,
    to_plain,
)
from arm_drake.simulation.mailbox import GoalHandle, Mailbox, Sent
from arm_drake.simulation.motion import Motion

Ticks = NDArray[np.int64]

# A tick is at the first time that isn't earlier by more than this part of a period.
_TOLERANCE = 1e-6


def read_rollout(
    diagram: Diagram,
    context: Context,
    manager: ControllerManager,
    since: float = -math.inf,
) -> Rollout:
    """Return what was recorded of a robot so far.

    It has the ticks that are in the logs: into a rebuilt diagram a saved context brings
    its last tick alone. Where a tick was logged twice, for the simulation was set back,
    the latest counts, and so does nothing that lies ahead.
    """
    joints = manager.robot.description.movable_joints
    period = manager.log_period
    logs = _Logs(diagram, context, manager, since)
    rows, ticks = logs.read("joint_states", logs.sampled("sample"), period)
    # Before tick 0 nothing was sampled.
    first = np.searchsorted(ticks, 0)
    # Drake's times are sums of rounded numbers; ROS counts nanoseconds.
    time = np.round(period * ticks[first:], 9)
    position, velocity, effort = np.split(rows[first:], 3, axis=1)
    # Without physics nothing holds back what is commanded, and stands as its effort.
    plant = diagram.GetSubsystemByName("plant")
    has_physics = isinstance(plant, MultibodyPlant)
    limits = [joint.limits.effort if has_physics else None for joint in joints]
    commanded = _read_commands(logs, time)
    return Rollout(
        time=time,
        joint_names=tuple(joint.name for joint in joints),
        position=position,
        velocity=velocity,
        effort=effort,
        effort_limit=np.array([np.inf if e is None else e for e in limits]),
        joint_types=tuple(joint.type for joint in joints),
        references=_references(manager, commanded, of_all=math.isfinite(since)),
        robot_name=manager.robot.name,
        namespace=manager.namespace,
        has_own_namespace=bool(manager.namespace) and not manager.prefix,
        command_names=tuple(manager.commands),
        command=commanded.values,
        controllers={c.name: c.type for c in manager.controllers},
        active=commanded.active,
        free_poses=read_free_poses(
            diagram,
            context,
            manager.robot,
            time,
            prefix=manager.prefix,
            period=period,
        ),
        contact_forces=_read_contacts(logs, ticks[first:]),
        sensor_messages=_read_sensors(logs),
        description=manager.robot.portable_source,
    )


def read_joint_states(
    diagram: Diagram, context: Context, manager: ControllerManager
) -> JointState:
    """Return position, velocity and effort of every movable joint of a robot, now."""
    port = diagram.GetOutputPort(f"{manager.prefix}joint_states")
    values = port.Eval(context).reshape(3, -1)
    return JointState(
        header=Header.from_nanoseconds(round(context.get_time() * NANOSECONDS)),
        name=tuple(j.name for j in manager.robot.description.movable_joints),
        position=tuple(values[0].tolist()),
        velocity=tuple(values[1].tolist()),
        effort=tuple(values[2].tolist()),
    )


class _Logs(NamedTuple):
    """The logs of a robot, since a time [s]."""

    diagram: Diagram
    context: Context
    manager: ControllerManager
    since: float

    def sampled(self, name: str, port: str = "") -> Array:
        """Return what a system samples for a log, now; on its only port, or this."""
        system = self.diagram.GetSubsystemByName(f"{self.manager.prefix}{name}")
        output = system.GetOutputPort(port) if port else system.get_output_port()
        return cast(Array, output.Eval(system.GetMyContextFromRoot(self.context)))

    def read(self, name: str, present: Array, period: float) -> tuple[Array, Ticks]:
        """Return what ticks left behind, in order, each once, and their numbers.

        `present` is what the last one left.
        """
        sink = self.diagram.GetSubsystemByName(f"{self.manager.prefix}log:{name}")
        log = sink.FindLog(self.context)
        rows, times = cast(Array, log.data().T), cast(Array, log.sample_times())
        if math.isfinite(self.since):
            # What was commanded for a row was logged up to two ticks before it.
            longest = max(self.manager.period, self.manager.log_period)
            is_recent = times >= self.since - 3.0 * longest
            rows, times = rows[is_recent], times[is_recent]
        return _latest(rows, times, present, self.context.get_time(), period)

    def read_at(self, ticks: Ticks, name: str, present: Array, period: float) -> Array:
        """Return what some ticks left behind; NaN where that isn't known."""
        rows, known = self.read(name, present, period)
        at = np.minimum(np.searchsorted(known, ticks), len(known) - 1)
        return np.where((known[at] == ticks)[:, None], rows[at], np.nan)


def forget_rows(diagram: Diagram, context: Context, before: float) -> None:
    """Forget what was logged before a time."""
    for system in diagram.GetSystems():
        if isinstance(system, VectorLogSink):
            log = system.FindMutableLog(context)
            times, rows = log.sample_times().copy(), log.data().T.copy()
            log.Clear()
            for row in range(int(np.searchsorted(times, before)), len(times)):
                log.AddData(times[row], rows[row])
        elif isinstance(system, PythonSystem) and hasattr(system, "forget_before"):
            system.forget_before(context, before)


def _ticks_done(time: Array | float, period: float) -> Ticks:
    """Return the number of the last tick that Drake has done at a time, -1 if none.

    It does tick k at the float k * period; one at this very time is still to come.
    """
    number = np.round(np.asarray(time) / period).astype(np.int64)
    return np.where(number * period < time, number, number - 1)


def _ticks_before(time: Array, period: float) -> Ticks:
    """Return the number of the last tick before a time, -1 if there is none."""
    return np.ceil(np.asarray(time) / period - _TOLERANCE).astype(np.int64) - 1


def _latest(
    rows: Array, logged_at: Array, present: Array, now: float, period: float
) -> tuple[Array, Ticks]:
    """Return what ticks left behind, in order, each of them once."""
    # What a tick leaves behind is seen from then on, and logged before the next one.
    ticks, last = _ticks_done(logged_at, period), int(_ticks_done(now, period))
    # A row of this instant counts: Drake may already have taken its next sample.
    candidates = np.flatnonzero((ticks < last) | (logged_at == now))[::-1]
    ticks, at = np.unique(ticks[candidates], return_index=True)
    rows = rows[candidates[at]]
    if not len(ticks) or ticks[-1] < last:
        rows, ticks = np.vstack([rows, present]), np.append(ticks, last)
    return rows, ticks


def _read_contacts(logs: _Logs, ticks: Ticks) -> dict[str, Array]:
    """Return the forces on links [N] at ticks of the log, shape (N, 3), if recorded."""
    manager = logs.manager
    if not logs.diagram.HasSubsystemNamed(f"{manager.prefix}log:{CONTACT_LOG}"):
        return {}
    present = logs.sampled("sample:contacts")
    forces = logs.read_at(ticks, CONTACT_LOG, present, manager.log_period)
    return {
        link: forces[:, 3 * index : 3 * index + 3]
        for index, link in enumerate(manager.robot.description.links)
        if link != WORLD
    }


def _read_sensors(logs: _Logs) -> dict[str, tuple[Message, ...]]:
    """Return what cameras and lidars told, if recorded, by topic."""
    diagram, manager = logs.diagram, logs.manager
    found: dict[str, tuple[Message, ...]] = {}
    if manager.sensors:
        # Robots that have none pay for nothing.
        from arm_drake.perception.sensors import log_name

        for sensor in manager.sensors:
            name = log_name(manager.prefix, sensor.sensor.name)
            if diagram.HasSubsystemNamed(name):
                log: Any = diagram.GetSubsystemByName(name)
                for topic, logged in log.read(logs.context, logs.since).items():
                    # Of several on a topic those of a time are in the sensors' order.
                    both = (*found.get(topic, ()), *logged)
                    found[topic] = tuple(sorted(both, key=stamp_of))
    return found


class _Commanded(NamedTuple):
    """Commands in the cycle before each of N rows, and their controllers."""

    # Values of C command interfaces, shape (N, C); NaN where it wasn't recorded.
    values: Array

    # Whether each of K controllers was active, 1 or 0, shape (N, K); NaN likewise.
    active: Array

    # References of controllers that command no positions, by name.
    references: Mapping[str, Reference]


def _read_commands(logs: _Logs, time: Array) -> _Commanded:
    """Return what was commanded at times [s], shape (N,)."""
    manager = logs.manager
    # A command acts after its tick.
    ticks = _ticks_before(time, manager.period)
    present = logs.sampled(COMMAND_LOG, "log")
    rows = logs.read_at(ticks, COMMAND_LOG, present, manager.period)
    values, active, found = manager.logged.split(rows)
    joints = {c.name: reference_joints(c.system) for c in manager.controllers}
    references = {
        controller: Reference(joints[controller], position)
        for controller, position in found.items()
    }
    return _Commanded(values, active, references)


def _references(
    manager: ControllerManager, commanded: _Commanded, *, of_all: bool
) -> dict[str, Reference]:
    """Return the references of controllers for the robot's joints.

    It is NaN while they were inactive, and where it wasn't recorded.
    """
    joints = {joint.name for joint in manager.robot.description.movable_joints}
    references = {}
    for index, controller in enumerate(manager.controllers):
        is_active = commanded.active[:, index] > 0.0
        if controller.system is None or not (of_all or is_active.any()):
            continue
        if controller.name in commanded.references:
            reference = commanded.references[controller.name]
            names, positions = list(reference.joint_names), reference.position
        else:
            # One that stays inactive may ask for interfaces that there are not.
            names = [
                name
                for name in controller.system.command_interfaces
                if name.endswith(f"/{interfaces.POSITION}") and name in manager.commands
            ]
            positions = commanded.values[:, [manager.commands.index(n) for n in names]]
            names = [name.rpartition("/")[0] for name in names]
        # A GPIO may have a position, too.
        known = [k for k, name in enumerate(names) if name in joints]
        if known:
            references[controller.name] = Reference(
                tuple(names[k] for k in known),
                np.where(is_active[:, None], positions[:, known], np.nan),
            )
    return references


# Name of the system that keeps it.
_NAME = "build_info"


class BuildInfo(PythonSystem):
    """Keeps how a diagram was built.

    .. pydrake_system::

        name: BuildInfo

    It has no ports and no state.
    """

    def __init__(self, options: SimulationOptions, world: str) -> None:
        """Keep options, and the name of the world."""
        super().__init__()
        self.options, self.world = options, world

        # Shapes that pass through each other at the start.
        self.parted: Sequence[tuple[Shape, Shape]] = ()
        self.set_name(_NAME)


def find_build_info(diagram: Diagram) -> BuildInfo | None:
    """Return how a diagram was built, or None if it doesn't say."""
    if not diagram.HasSubsystemNamed(_NAME):
        return None
    info = diagram.GetSubsystemByName(_NAME)
    assert isinstance(info, BuildInfo)
    return info


def describe_provenance(
    robot: Robot, diagram: Diagram, motions: Sequence[Motion]
) -> dict[str, Any]:
    """Return what made a rollout, as plain data without folders of this machine."""
    found: dict[str, Any] = {
        "versions": dict(_versions()),
        "robot": dict(_describe_robot(robot)),
        "motions": [_describe_motion(motion) for motion in motions],
    }
    build = find_build_info(diagram)
    if build is not None:
        found["world"] = build.world
        found["options"] = to_plain(build.options)
    return found


@functools.cache
def _versions() -> dict[str, str]:
    from importlib.metadata import version  # It brings e-mail and more.

    return {
        "arm_drake": version("arm-drake"),
        "drake": version("drake"),
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


@functools.lru_cache(maxsize=8)
def _describe_robot(robot: Robot) -> dict[str, Any]:
    """Return what a robot was made of; a hash is of a file as it is now."""
    return {
        "name": robot.name,
        "bundled": robot.bundled,
        "distro": robot.distro,
        "description": {
            "file": robot.description.file.name,
            "sha256": _hash(robot.portable_source.encode()),
        },
        "pose": to_plain(robot.pose),
        "initial_positions": to_plain(robot.initial_positions),
        "files": [
            {"file": _name(file), "sha256": _hash_file(file)}
            for file in robot.source_files
        ],
    }


def _describe_motion(motion: Motion) -> dict[str, Any]:
    file = motion.file
    return {
        "file": file.name if file else None,
        "sha256": _hash_file(file) if file else None,
        "parameters": to_plain(motion.parameters),
    }


def _name(file: Path) -> str:
    """Return the package URI of a file, or its name if it is in no package."""
    name = name_portably(str(file))
    return file.name if name == str(file) else name


def _hash_file(file: Path) -> str | None:
    try:
        known = file.stat()
        return _hash_content(file, known.st_mtime_ns, known.st_size)
    except OSError:  # It has gone since it was loaded.
        return None


@functools.lru_cache(maxsize=1000)
def _hash_content(file: Path, time_ns: int, size: int) -> str:
    """Return the hash of a file that was changed last at this time."""
    return _hash(file.read_bytes())


def _hash(data: bytes) -> str:
    import hashlib  # It brings OpenSSL, 4 MB, and few runs are recorded.

    return hashlib.sha256(data).hexdigest()


# Goals that are done, which stay as they are.
_done: "weakref.WeakKeyDictionary[GoalHandle, GoalRecord]" = weakref.WeakKeyDictionary()


def list_failures(mailbox: Mailbox) -> list[str]:
    """Return a line for all that failed: goals, messages, switches, controllers."""
    lines = [f"{_place(goal)}: goal {goal.describe()}" for goal in mailbox.failed_goals]
    events = (*mailbox.rejected, *mailbox.failures)
    return lines + [mailbox.describe(event) for event in events]


def list_unfinished(mailbox: Mailbox) -> list[str]:
    """Return a line for each goal that has not ended."""
    return [
        f"{_place(goal)}: goal is still {goal.status.value}"
        for goal in mailbox.goals
        if not (goal.status.is_terminal or goal.is_part)
    ]


def _place(goal: GoalHandle) -> str:
    return f"{goal.where}: {goal.controller}" if goal.where else goal.controller


def collect_rollout(
    mailbox: Mailbox,
    manager: ControllerManager,
    motions: Sequence[Motion],
    since: float = -math.inf,
) -> Rollout:
    """Return what was recorded of a robot, rows and messages since a time [s]."""
    diagram, context = mailbox.diagram, mailbox.simulator.get_context()
    sent = (each for each in mailbox.sent if each.time >= since)
    return dc.replace(
        read_rollout(diagram, context, manager, since),
        goals=record_goals(mailbox.goals, manager),
        messages=record_messages(sent, manager),
        inputs=_inputs_of(mailbox, manager, since),
        info=describe_provenance(manager.robot, diagram, motions),
    )


def _inputs_of(
    mailbox: Mailbox, manager: ControllerManager, since: float
) -> tuple[ClientInput, ...]:
    """Return what came from outside since a time [s]; the first robot has all of it."""
    first = next(
        s for s in mailbox.diagram.GetSystems() if isinstance(s, type(manager))
    )
    if not mailbox.inputs or first is not manager:
        return ()
    return tuple(each for each in mailbox.inputs if each.time >= since)


def record_goals(
    goals: Iterable[GoalHandle], manager: ControllerManager
) -> tuple[GoalRecord, ...]:
    """Return the goals of a robot, in order."""
    names = {f"{manager.prefix}{c.name}" for c in manager.controllers}
    return tuple(_record_goal(goal) for goal in goals if goal.controller in names)


def record_messages(
    sent: Iterable[Sent], manager: ControllerManager
) -> tuple[SentMessage, ...]:
    """Return the messages for a robot but for goals, in order."""
    return tuple(
        SentMessage(
            each.time,
            topic_of(each.port, manager),
            type(each.message).__name__,
            to_plain(each.message),
        )
        for each in sent
        if each.port.removeprefix("/").startswith(manager.prefix)
        and not isinstance(each.message, ActionRequest)
    )


def topic_of(port: str, manager: ControllerManager) -> str:
    """Return the name in ROS of an input port of the diagram."""
    own = port.removeprefix("/").removeprefix(manager.prefix)
    for name in (MANAGER, *(c.name for c in manager.controllers)):
        if own.startswith(f"{name}."):
            return f"{manager.namespace}/{name}/{own[len(name) + 1 :]}"
    return f"/{manager.prefix}{own.removeprefix('/')}"


def _record_goal(handle: GoalHandle) -> GoalRecord:
    if handle in _done:
        return _done[handle]
    record = _make_record(handle)
    if handle.status.is_terminal:
        _done[handle] = record
    return record


def _make_record(handle: GoalHandle) -> GoalRecord:
    result, code, text = handle.result, None, handle.note
    if isinstance(result, FollowJointTrajectoryResult):
        code, text = int(result.error_code), result.error_string
    return GoalRecord(
        handle.controller,
        type(handle.request.goal).__name__,
        handle.sent_at,
        handle.ended_at,
        handle.status.value,
        code,
        text,
        to_plain(handle.request.goal),
        to_plain(result) if dc.is_dataclass(result) else None,
    )


class History:
    """Keeps the logs of a simulation from growing for ever."""

    def __init__(self, mailbox: Mailbox, duration: float) -> None:
        """Create it, to keep a duration [s] at least, at most twice as much."""
        self._mailbox = mailbox
        self._duration = duration
        self._start = mailbox.time

    def trim(self) -> None:
        """Forget rows that are too old, if there are many of them."""
        now = self._mailbox.time
        # A simulation that was reset has logged nothing of before.
        self._start = min(self._start, now)
        if now - self._start <= 2.0 * self._duration:
            return
        self._start = now - self._duration
        self._mailbox.forget_before(self._start)
        root = self._mailbox.simulator.get_mutable_context()
        forget_rows(self._mailbox.diagram, root, self._start)
