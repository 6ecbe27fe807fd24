"""Rollouts as arrays of NumPy, with everything, in an `.npz` file."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake.errors import InputError
from arm_drake.rollout.rollout import GoalRecord, Rollout, SentMessage, to_plain

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


# What isn't an array.
_STATIC = "rollout"


def write_npz(rollout: Rollout, path: Path) -> None:
    """Write all of a rollout.

    Args:
        rollout: The rollout.
        path: File to write.
    """
    arrays: dict[str, Any] = {
        "time": rollout.time,
        "joint_names": np.array(rollout.joint_names, dtype=np.str_),
        "position": rollout.position,
        "velocity": rollout.velocity,
        "effort": rollout.effort,
        "effort_limit": rollout.effort_limit,
        "joint_types": np.array(rollout.joint_types, dtype=np.str_),
        "command_names": np.array(rollout.command_names, dtype=np.str_),
        "command": rollout.command,
        "controller_names": np.array(list(rollout.controllers), dtype=np.str_),
        "active": rollout.active,
        # An array of characters, for one of texts loses zeros at its end.
        _STATIC: np.frombuffer(make_static(rollout).encode(), dtype=np.uint8),
    }
    for name, reference in rollout.references.items():
        arrays[f"{name}/reference"] = reference.position
        arrays[f"{name}/joint_names"] = np.array(reference.joint_names, dtype=np.str_)
    for link, poses in rollout.free_poses.items():
        arrays[f"{link}/pose"] = poses
    for link, forces in rollout.contact_forces.items():
        arrays[f"{link}/contact_force"] = forces
    with path.open("wb") as file:
        np.savez(file, **arrays)


def read_npz(path: Path) -> dict[str, Any]:
    """Return the fields of a rollout.

    Args:
        path: File of `write_npz`.

    Raises:
        InputError: If it is something else.
    """
    with path.open("rb") as content:
        if not zipfile.is_zipfile(content):
            problem = "it is no .npz file, or only a part of one"
            raise InputError(f"can't be read: {problem}", file=path)
    try:
        # NumPy doesn't close what it has opened itself, if it can't be read.
        with path.open("rb") as content, np.load(content) as file:
            arrays = dict(file)
        static = read_static(bytes(arrays[_STATIC]).decode())
        fields = {name: static[name] for name in AS_THEY_ARE}
        for name in ("time", "position", "velocity", "effort", "effort_limit"):
            fields[name] = arrays[name]
        return fields | {
            "command": arrays["command"],
            "active": arrays["active"],
            "references": {
                name: (joints, arrays[f"{name}/reference"])
                for name, joints in static["references"].items()
            },
            "free_poses": {
                link: arrays[f"{link}/pose"] for link in static["free_poses"]
            },
            "contact_forces": {
                link: arrays[f"{link}/contact_force"]
                for link in static["contact_forces"]
            },
        }
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        problem = f"no rollout; expected a file of Rollout.save ({error})"
        raise InputError(problem, file=path) from None
