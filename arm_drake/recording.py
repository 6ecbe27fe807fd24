"""A Rollout of what the logs in a diagram hold."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram

from arm_drake import interfaces
from arm_drake.manager import ControllerManager
from arm_drake.rollout import Reference, Rollout

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]

# A tick is at the first time that isn't earlier by more than this part of a period.
_TOLERANCE = 1e-6


def read_rollout(
    diagram: Diagram, context: Context, manager: ControllerManager
) -> Rollout:
    """Return what was recorded of a robot so far.

    It has the ticks that are in the logs: into a rebuilt diagram a saved context brings
    its last tick alone. Where a tick was logged twice, for the simulation was set back,
    the latest counts, and so does nothing that lies ahead.

    Args:
        diagram: The diagram.
        context: Its context.
        manager: The robot's controller manager.
    """
    joints = manager.robot.description.movable_joints
    period = manager.log_period
    log, logged_at = _log(diagram, context, manager, "joint_states")
    sample = diagram.GetSubsystemByName(f"{manager.prefix}sample")
    present = sample.get_output_port().Eval(sample.GetMyContextFromRoot(context))
    rows, ticks = _latest(log, logged_at, present, context.get_time(), period)
    # Before tick 0 nothing was sampled.
    first = np.searchsorted(ticks, 0)
    # Drake's times are sums of rounded numbers; ROS counts nanoseconds.
    time = np.round(period * ticks[first:], 9)
    position, velocity, effort = np.split(rows[first:], 3, axis=1)
    limits = [joint.limits.effort for joint in joints]
    return Rollout(
        time=time,
        joint_names=tuple(joint.name for joint in joints),
        position=position,
        velocity=velocity,
        effort=effort,
        effort_limit=np.array([np.inf if e is None else e for e in limits]),
        joint_types=tuple(joint.type for joint in joints),
        references=_references(diagram, context, manager, time),
    )


def _log(
    diagram: Diagram, context: Context, manager: ControllerManager, name: str
) -> tuple[Array, Array]:
    """Return the rows of a log, and their times [s], in the order of their writing."""
    sink = diagram.GetSubsystemByName(f"{manager.prefix}log:{name}")
    log = sink.FindLog(context)
    return cast(Array, log.data().T), cast(Array, log.sample_times())


def _ticks_before(time: Array | float, period: float) -> Ticks:
    """Return the number of the last tick before a time, -1 if there is none.

    What a tick leaves behind is seen from then on, and logged before the next one.
    """
    return np.ceil(np.asarray(time) / period - _TOLERANCE).astype(np.int64) - 1


def _latest(
    rows: Array, logged_at: Array, present: Array, now: float, period: float
) -> tuple[Array, Ticks]:
    """Return what ticks left behind, in order, each of them once.

    Args:
        rows: Rows of a log, shape (N, k), in the order of their writing.
        logged_at: Their times [s], shape (N,).
        present: What is there now, for it isn't always logged yet, shape (k,).
        now: The present time [s].
        period: Period of the ticks [s].

    Returns:
        The values, shape (M, k), and the ticks, rising, shape (M,).
    """
    ticks, last = _ticks_before(logged_at, period), int(_ticks_before(now, period))
    # A row of this instant counts: Drake may already have taken its next sample.
    there = np.flatnonzero((ticks < last) | (logged_at == now))[::-1]
    ticks, at = np.unique(ticks[there], return_index=True)
    rows = rows[there[at]]
    if not len(ticks) or ticks[-1] < last:
        rows, ticks = np.vstack([rows, present]), np.append(ticks, last)
    return rows, ticks


def _references(
    diagram: Diagram,
    context: Context,
    manager: ControllerManager,
    time: Array,
) -> dict[str, Reference]:
    """Return what controllers wanted of their joints.

    It is NaN while they were inactive, and where it wasn't recorded.

    Args:
        diagram: The diagram.
        context: Its context.
        manager: The robot's controller manager.
        time: When [s], shape (N,).
    """
    mine, now = manager.GetMyContextFromRoot(context), context.get_time()
    (values, ticks), (active, _) = (
        _latest(
            *_log(diagram, context, manager, name),
            manager.GetOutputPort(name).Eval(mine),
            now,
            manager.period,
        )
        for name in (interfaces.VALUES_PORT, "active")
    )
    # A command acts after its tick.
    wanted_at = _ticks_before(time, manager.period)
    rows = np.minimum(np.searchsorted(ticks, wanted_at), len(ticks) - 1)
    is_there = ticks[rows] == wanted_at
    references = {}
    for index, controller in enumerate(manager.controllers):
        is_active = is_there & (active[rows, index] > 0.0)
        if controller.system is None or not is_active.any():
            continue
        names = [
            name
            for name in controller.system.command_interfaces
            if name.endswith(f"/{interfaces.POSITION}")
        ]
        if names:
            at = [manager.commands.index(name) for name in names]
            wanted = np.where(is_active[:, None], values[rows][:, at], np.nan)
            joints = tuple(name.rpartition("/")[0] for name in names)
            references[controller.name] = Reference(joints, wanted)
    return references
