"""What of a rollout is neither a row nor an array, as one JSON text."""

import json
from typing import Any

from arm_drake.rollout.records import to_plain
from arm_drake.rollout.rollout import GoalRecord, Rollout, SentMessage

# Grows when a reader of before couldn't understand what is written.
VERSION = 1


def make_static(rollout: Rollout, *, is_whole: bool = True) -> str:
    """Return what isn't in the rows, as JSON.

    Args:
        rollout: A rollout.
        is_whole: Whether with what is also elsewhere in a bag: goals, messages, the
            robot's description.
    """
    more = (
        {
            "goals": rollout.goals,
            "messages": rollout.messages,
            "description": rollout.description,
        }
        if is_whole
        else {}
    )
    return json.dumps(
        to_plain(
            {
                "version": VERSION,
                "robot_name": rollout.robot_name,
                "namespace": rollout.namespace,
                "joint_names": rollout.joint_names,
                "joint_types": rollout.joint_types,
                "effort_limit": rollout.effort_limit.tolist(),
                "command_names": rollout.command_names,
                "controllers": rollout.controllers,
                "references": {
                    name: reference.joint_names
                    for name, reference in rollout.references.items()
                },
                "free_poses": list(rollout.free_poses),
                "contact_forces": list(rollout.contact_forces),
                "info": rollout.info,
                **more,
            }
        ),
        ensure_ascii=False,
    )


def read_static(text: str) -> dict[str, Any]:
    """Return what `make_static` has written.

    Args:
        text: The JSON.

    Raises:
        ValueError: If it isn't that.
    """
    data = json.loads(text)
    if not isinstance(data, dict) or data.pop("version", None) != VERSION:
        raise ValueError(f"expected version {VERSION} of a rollout")
    for name in ("joint_names", "joint_types", "command_names"):
        data[name] = tuple(data[name])
    data["references"] = {k: tuple(v) for k, v in data["references"].items()}
    goals, messages = data.get("goals", ()), data.get("messages", ())
    data["goals"] = tuple(GoalRecord(**goal) for goal in goals)
    data["messages"] = tuple(SentMessage(**message) for message in messages)
    data["effort_limit"] = [float(limit) for limit in data["effort_limit"]]
    return data


# Fields of a Rollout that are what they are here.
AS_THEY_ARE = (
    "robot_name",
    "namespace",
    "joint_names",
    "joint_types",
    "command_names",
    "controllers",
    "goals",
    "messages",
    "info",
    "description",
)
