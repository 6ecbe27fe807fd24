"""Rollouts out of bags that this package has written."""

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake.arrays import Array
from arm_drake.errors import InputError, suggest
from arm_drake.rollout.bag_messages import (
    ACTIVE,
    COMMANDS,
    CONTACTS,
    CONTROLLER_STATE,
    DESCRIPTION,
    GOALS,
    JOINT_STATES,
    MESSAGES,
    POSES,
    STATIC,
    contact_topic,
    group_commands,
    pose_topic,
)
from arm_drake.rollout.mcap import MAGIC
from arm_drake.rollout.rollout import GoalRecord, SentMessage
from arm_drake.rollout.ros_types import load_types
from arm_drake.rollout.static import AS_THEY_ARE, read_static

# Messages of a topic with their times [ns].
_Messages = list[tuple[int, Any]]


def read_mcap(path: Path, robot: str | None = None) -> dict[str, Any]:
    """Return the fields of a rollout.

    Args:
        path: File of a BagWriter.
        robot: Name of the robot; by default the first one.

    Raises:
        InputError: If it is something else, or has no such robot.
        MissingExtraError: If rosbags isn't installed.
    """
    types = load_types()
    from rosbags.rosbag2 import Reader
    from rosbags.rosbag2.errors import ReaderError

    topics: dict[str, _Messages] = {}
    try:
        with Reader(path) as reader:
            ours = [c for c in reader.connections if _is_ours(c.topic)]
            for connection in ours:
                topics[connection.topic] = []
            for connection, time_ns, data in reader.messages(connections=ours):
                message = types.decode(connection.msgtype, data)
                topics[connection.topic].append((time_ns, message))
        return _read(topics, robot)
    except (ReaderError, ValueError, KeyError, TypeError, AssertionError) as error:
        if isinstance(error, InputError):
            raise InputError(error.problem, file=path) from None
        problem = f"no rollout; expected a bag of Rollout.save ({error})"
        with path.open("rb") as file:
            if isinstance(error, ReaderError) and file.read(len(MAGIC)) == MAGIC:
                problem += "; `mcap recover` mends a bag that was cut"
        raise InputError(problem, file=path) from None


def _is_ours(topic: str) -> bool:
    ours = (STATIC, GOALS, MESSAGES, ACTIVE, COMMANDS, JOINT_STATES, DESCRIPTION)
    return topic.endswith((*ours, CONTROLLER_STATE)) or any(
        part in topic for part in (POSES, CONTACTS)
    )


def _read(topics: Mapping[str, _Messages], robot: str | None) -> dict[str, Any]:
    statics = {
        topic.removesuffix(STATIC): read_static(messages[-1][1].data)
        for topic, messages in topics.items()
        if topic.endswith(STATIC)
    }
    names = {static["robot_name"]: prefix for prefix, static in statics.items()}
    if not names:
        raise KeyError(f"no topic {STATIC}")
    if robot is None:
        robot = next(iter(names))
    if robot not in names:
        raise InputError(f"no robot {robot!r}; {suggest(robot, names)}")
    prefix = names[robot]
    return _read_robot(topics, prefix, statics[prefix])


def _read_robot(
    topics: Mapping[str, _Messages], prefix: str, static: dict[str, Any]
) -> dict[str, Any]:
    def messages(topic: str) -> _Messages:
        return topics.get(f"{prefix}{topic}", [])

    states = messages(JOINT_STATES)
    rows = {time_ns: row for row, (time_ns, _) in enumerate(states)}
    num_joints = len(static["joint_names"])

    def fill(topic: str, size: int, read: Any) -> Array:
        """Return a value for each row, NaN where there is no message."""
        values = np.full((len(rows), size), np.nan)
        for time_ns, message in messages(topic):
            values[rows[time_ns]] = read(message)
        return values

    groups = group_commands(static["command_names"])
    order = [index for parts in groups.values() for _, index in parts]
    command = np.full((len(rows), len(order)), np.nan)
    command[:, order] = fill(
        COMMANDS,
        len(order),
        lambda m: [value for part in m.interface_values for value in part.values],
    )
    active = fill(ACTIVE, len(static["controllers"]), lambda m: m.data)
    changes = sorted(rows[time_ns] for time_ns, _ in messages(ACTIVE))
    for start, end in itertools.pairwise([*changes, len(rows)]):
        active[start:end] = active[start]
    goals = {}
    for _, message in messages(GOALS):
        each = json.loads(message.data)
        goals[each["number"]] = GoalRecord(**each["goal"])
    references = {
        name: (
            joints,
            fill(
                f"/{name}{CONTROLLER_STATE}",
                len(joints),
                lambda m: m.reference.positions,
            ),
        )
        for name, joints in static["references"].items()
        # Of one that never was active there are no messages.
        if messages(f"/{name}{CONTROLLER_STATE}") or not rows
    }
    description = messages(DESCRIPTION)
    return {
        # Goals, messages and description are in topics of their own.
        **{name: static[name] for name in AS_THEY_ARE if name in static},
        "time": np.array([time_ns for time_ns, _ in states], dtype=float) / 1e9,
        **{
            name: fill(JOINT_STATES, num_joints, lambda m, n=name: getattr(m, n))
            for name in ("position", "velocity", "effort")
        },
        "effort_limit": np.array(static["effort_limit"], dtype=float),
        "command": command,
        "active": active,
        "references": references,
        "free_poses": {
            link: fill(pose_topic("", link), 7, _pose) for link in static["free_poses"]
        },
        "contact_forces": {
            link: np.nan_to_num(fill(contact_topic("", link), 3, _force))
            for link in static["contact_forces"]
        },
        "goals": tuple(goals[number] for number in sorted(goals)),
        "messages": tuple(
            SentMessage(**json.loads(message.data)) for _, message in messages(MESSAGES)
        ),
        "description": description[-1][1].data if description else "",
    }


def _force(message: Any) -> list[float]:
    force = message.wrench.force
    return [force.x, force.y, force.z]


def _pose(message: Any) -> list[float]:
    p, q = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
