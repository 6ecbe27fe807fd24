"""Rollouts as arrays of NumPy, with everything, in an `.npz` file."""

import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake.errors import InputError
from arm_drake.messages import Message
from arm_drake.rollout.rollout import (
    STATIC_FIELDS,
    Rollout,
    make_static,
    read_static,
    to_plain,
)
from arm_drake.rollout.sensor_messages import SENSOR_TYPES, make_message, to_fields

# What isn't an array.
_STATIC = "rollout"

# Of a topic of cameras and lidars, after its name: fields as JSON, and their bytes.
_FIELDS, _DATA = "/messages", "/data"


def write_rollout(rollout: Rollout, path: Path) -> None:
    """Write all of a rollout."""
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
    for topic, messages in rollout.sensor_messages.items():
        if messages:
            arrays |= _sensor_arrays(topic, messages)
    with path.open("wb") as file:
        np.savez(file, **arrays)


def _sensor_arrays(topic: str, messages: Sequence[Message]) -> dict[str, Any]:
    """Return messages as arrays: their fields as JSON, their bytes as they are."""
    fields = [to_fields(message) for message in messages]
    data = [each.pop("data", b"") for each in fields]
    for each, content in zip(fields, data, strict=True):
        each["num_bytes"] = len(content)
    text = json.dumps(to_plain(fields), ensure_ascii=False)
    return {
        f"{topic}{_FIELDS}": np.frombuffer(text.encode(), dtype=np.uint8),
        f"{topic}{_DATA}": np.frombuffer(b"".join(data), dtype=np.uint8),
    }


def _read_sensor(
    fields: NDArray[Any], data: NDArray[Any], type_: str
) -> tuple[Message, ...]:
    """Return the messages of `_sensor_arrays`."""
    kind, content = SENSOR_TYPES[f"sensor_msgs/msg/{type_}"], data.tobytes()
    found, start = [], 0
    for each in json.loads(fields.tobytes().decode()):
        end = start + each.pop("num_bytes")
        each["data"], start = content[start:end], end
        found.append(make_message(kind, each))
    return tuple(found)


def read_fields(path: Path, robot: str | None = None) -> dict[str, Any]:
    """Return the fields of the only rollout; raise InputError if there is none."""
    with path.open("rb") as content:
        if not zipfile.is_zipfile(content):
            problem = "it is no .npz file, or only a part of one"
            raise InputError(f"can't be read: {problem}", file=path)
    try:
        # NumPy doesn't close what it has opened itself, if it can't be read.
        with path.open("rb") as content, np.load(content) as file:
            arrays = dict(file)
        static = read_static(bytes(arrays.pop(_STATIC)).decode())
        sensors = {
            topic: (
                arrays.pop(f"{topic}{_FIELDS}"),
                arrays.pop(f"{topic}{_DATA}"),
                type_,
            )
            for topic, type_ in static.get("sensor_messages", {}).items()
        }
        # Differences of booleans and of unsigned integers are none.
        arrays = {
            name: array.astype(float, copy=False)
            if array.dtype.kind in "iub"
            else array
            for name, array in arrays.items()
        }
        fields = {name: static[name] for name in STATIC_FIELDS}
        for name in ("time", "position", "velocity", "effort", "effort_limit"):
            fields[name] = arrays[name]
        return fields | {
            "command": arrays["command"],
            "active": arrays["active"],
            "references": {
                name: (joints, arrays[f"{name}/reference"])
                for name, joints in static["references"].items()
            },
            "sensor_messages": {
                topic: _read_sensor(*parts) for topic, parts in sensors.items()
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
