"""What a simulation has recorded of a robot: rows, goals, messages, provenance."""

import dataclasses as dc
import math
import weakref
from collections.abc import Iterable, Sequence

from arm_drake.manager import MANAGER, ControllerManager
from arm_drake.messages import ActionRequest, FollowJointTrajectoryResult, GoalStatus
from arm_drake.rollout.records import to_plain
from arm_drake.rollout.rollout import GoalRecord, Rollout, SentMessage
from arm_drake.simulation.mailbox import GoalHandle, Mailbox, Sent
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.provenance import describe_provenance
from arm_drake.simulation.recording import read_rollout

_FAILED = (GoalStatus.REJECTED, GoalStatus.ABORTED)

# Goals that are done, which stay as they are.
_done: "weakref.WeakKeyDictionary[GoalHandle, GoalRecord]" = weakref.WeakKeyDictionary()


def list_failures(mailbox: Mailbox) -> list[str]:
    """Return a line for all that failed: goals, messages, switches, controllers.

    Args:
        mailbox: Of a simulation that has run.
    """
    lines = []
    for goal in mailbox.goals:
        if goal.status in _FAILED:
            place = f"{goal.where}: " if goal.where else ""
            lines.append(f"{place}{goal.controller}: goal {goal.describe()}")
    events = (*mailbox.rejected, *mailbox.failures)
    return lines + [mailbox.describe(event) for event in events]


def collect_rollout(
    mailbox: Mailbox,
    manager: ControllerManager,
    motions: Sequence[Motion],
    since: float = -math.inf,
) -> Rollout:
    """Return what was recorded of a robot so far.

    Args:
        mailbox: Of the simulation.
        manager: The robot's controller manager.
        motions: What was played, in order.
        since: From when on rows and messages are wanted [s], as `read_rollout`.
    """
    diagram, context = mailbox.diagram, mailbox.simulator.get_context()
    sent = (each for each in mailbox.sent if each.time >= since)
    return dc.replace(
        read_rollout(diagram, context, manager, since),
        goals=record_goals(mailbox.goals, manager),
        messages=record_messages(sent, manager),
        info=describe_provenance(manager.robot, diagram, motions),
    )


def record_goals(
    goals: Iterable[GoalHandle], manager: ControllerManager
) -> tuple[GoalRecord, ...]:
    """Return the goals of a robot, in order.

    Args:
        goals: Goals of all robots.
        manager: The robot's controller manager.
    """
    names = {f"{manager.prefix}{c.name}" for c in manager.controllers}
    return tuple(_record_goal(goal) for goal in goals if goal.controller in names)


def record_messages(
    sent: Iterable[Sent], manager: ControllerManager
) -> tuple[SentMessage, ...]:
    """Return the messages for a robot but for goals, in order.

    Args:
        sent: What was sent to all robots.
        manager: The robot's controller manager.
    """
    return tuple(
        SentMessage(
            each.time,
            topic_of(each.port, manager),
            type(each.message).__name__,
            to_plain(each.message),
        )
        for each in sent
        if each.port.startswith(manager.prefix)
        and not isinstance(each.message, ActionRequest)
    )


def topic_of(port: str, manager: ControllerManager) -> str:
    """Return the name in ROS of an input port of the diagram.

    Args:
        port: Name of the port, such as "arm.joint_trajectory".
        manager: The controller manager of its robot.
    """
    own = port.removeprefix(manager.prefix)
    for name in (MANAGER, *(c.name for c in manager.controllers)):
        if own.startswith(f"{name}."):
            return f"/{manager.prefix}{name}/{own[len(name) + 1 :]}"
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
