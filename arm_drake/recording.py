"""A Rollout of what the logs in a diagram hold."""

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram

from arm_drake import interfaces
from arm_drake.manager import ControllerManager
from arm_drake.rollout import Reference, Rollout

# A row is due at the first time that isn't earlier by more than this part of a period.
_TOLERANCE = 1e-6


def read_rollout(
    diagram: Diagram, context: Context, manager: ControllerManager
) -> Rollout:
    """Return what was recorded of a robot so far.

    Args:
        diagram: The diagram.
        context: Its context.
        manager: The robot's controller manager.
    """
    joints = manager.robot.description.movable_joints
    period = manager.log_period
    number = math.ceil(context.get_time() / period - _TOLERANCE)
    rows = _log(diagram, context, manager, "joint_states")[1:]
    if len(rows) < number:  # What the last tick left behind isn't logged yet.
        sample = diagram.GetSubsystemByName(f"{manager.prefix}sample")
        mine = sample.GetMyContextFromRoot(context)
        rows = np.vstack([rows, sample.get_output_port().Eval(mine)])
    # Drake's times are sums of rounded numbers; ROS counts nanoseconds.
    time = np.round(period * np.arange(number), 9)
    position, velocity, effort = np.split(rows[:number], 3, axis=1)
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
) -> NDArray[np.float64]:
    """Return the rows of a log."""
    sink = diagram.GetSubsystemByName(f"{manager.prefix}log:{name}")
    return cast(NDArray[np.float64], sink.FindLog(context).data().T)


def _references(
    diagram: Diagram,
    context: Context,
    manager: ControllerManager,
    time: NDArray[np.float64],
) -> dict[str, Reference]:
    """Return what controllers wanted of their joints, NaN while they were inactive.

    Args:
        diagram: The diagram.
        context: Its context.
        manager: The robot's controller manager.
        time: When [s], shape (N,).
    """
    values, active = (
        np.vstack(
            [
                _log(diagram, context, manager, name),
                manager.GetOutputPort(name).Eval(manager.GetMyContextFromRoot(context)),
            ]
        )
        for name in (interfaces.VALUES_PORT, "active")
    )
    # Row k of the logs is what tick k - 1 left behind.
    ticks = np.ceil(time / manager.period - _TOLERANCE).astype(int)
    references = {}
    for index, controller in enumerate(manager.controllers):
        is_active = active[ticks, index] > 0.0
        if controller.system is None or not is_active.any():
            continue
        names = [
            name
            for name in controller.system.command_interfaces
            if name.endswith(f"/{interfaces.POSITION}")
        ]
        if names:
            at = [manager.commands.index(name) for name in names]
            wanted = np.where(is_active[:, None], values[ticks][:, at], np.nan)
            joints = tuple(name.rpartition("/")[0] for name in names)
            references[controller.name] = Reference(joints, wanted)
    return references
