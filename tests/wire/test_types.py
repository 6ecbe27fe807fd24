"""Serialized messages, beside those of rosbags, which is none of ours."""

import base64
import dataclasses as dc
import json
import math
from random import Random
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from arm_drake import messages
from arm_drake.errors import InputError
from arm_drake.messages.base import ros_type
from arm_drake.wire.encodings import to_json
from arm_drake.wire.types import load_wire_types

STORE = get_typestore(Stores.ROS2_JAZZY)
NAMES = ((), ("a",), ("joint1", "x"), ("äö", "a_long_name_of_a_joint", "b"))


def stamped(frame_id: str) -> dict[str, Any]:
    return {"stamp": {"sec": -3, "nanosec": 7}, "frame_id": frame_id}


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("frame_id", ["", "a", "base_link"])
def test_joint_states_have_the_bytes_of_rosbags(
    frame_id: str, names: tuple[str, ...]
) -> None:
    values = [0.1 * index for index in range(len(names))]
    message = {
        "header": stamped(frame_id),
        "name": list(names),
        "position": values,
        "velocity": [math.nan] * len(names),
        "effort": values if len(names) != 2 else [],
    }
    types, kind = load_wire_types("jazzy"), "sensor_msgs/msg/JointState"

    data = types.encode(kind, message)

    found: Any = STORE.deserialize_cdr(data, kind)
    assert bytes(STORE.serialize_cdr(found, kind)) == data
    assert (found.header.frame_id, found.name) == (frame_id, list(names))
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (-3, 7)
    assert found.position.tolist() == values
    assert all(map(math.isnan, found.velocity))
    assert found.effort.tolist() == message["effort"]


@pytest.mark.parametrize("names", NAMES)
def test_frames_have_the_bytes_of_rosbags(names: tuple[str, ...]) -> None:
    transforms = [
        {
            "header": stamped("world"),
            "child_frame_id": name,
            "transform": {
                "translation": {"x": 1.0, "y": 2.0, "z": 3.0},
                "rotation": {"x": 0.1, "y": 0.2, "z": 0.3, "w": 0.4},
            },
        }
        for name in names
    ]
    types, kind = load_wire_types("jazzy"), "tf2_msgs/msg/TFMessage"

    data = types.encode(kind, {"transforms": transforms})

    found: Any = STORE.deserialize_cdr(data, kind)
    assert bytes(STORE.serialize_cdr(found, kind)) == data
    assert [each.child_frame_id for each in found.transforms] == list(names)
    for each in found.transforms:
        p, q = each.transform.translation, each.transform.rotation
        assert (p.x, p.y, p.z, q.x, q.y, q.z, q.w) == (1, 2, 3, 0.1, 0.2, 0.3, 0.4)


def test_pictures_are_bytes_and_base64_in_json() -> None:
    types, kind = load_wire_types("jazzy"), "sensor_msgs/msg/Image"
    image = types.fill(kind, {"height": 1, "width": 2, "data": [0, 255, 7, 1, 2, 3]})

    assert types.decode(kind, types.encode(kind, image))["data"] == image["data"]
    assert json.loads(to_json(image))["data"] == "AP8HAQID"
    assert types.fill(kind, {"data": "AP8HAQID"})["data"] == image["data"]


@pytest.mark.parametrize("size", [98_303, 98_304, 98_305, 300_000])
def test_large_pictures_are_whole(size: int) -> None:
    data = bytes(range(256)) * (size // 256) + b"x" * (size % 256)
    text = to_json({"a": data, "b": [data, math.nan], "c": "end"})
    found = json.loads(text)

    assert base64.b64decode(found["a"]) == base64.b64decode(found["b"][0]) == data
    assert (found["b"][1], found["c"]) == (None, "end")


def test_bytes_that_are_no_message_are_refused_and_take_no_memory() -> None:
    random = Random(0)  # noqa: S311
    types, kind = load_wire_types("jazzy"), "trajectory_msgs/msg/JointTrajectory"
    point = {"positions": [0.1], "time_from_start": {"sec": 1, "nanosec": 0}}
    whole = types.encode(kind, {"joint_names": ["a", "b"], "points": [point]})
    refused = 0
    for _ in range(1000):
        data = bytearray(whole)
        # Lengths beyond all that there is.
        at = random.randrange(4, len(data) - 3)
        data[at : at + 4] = random.choice((b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff"))
        try:
            types.decode(kind, bytes(data[: random.randrange(at, len(data))]))
        except InputError:
            refused += 1

    assert refused > 900


def test_every_message_of_a_topic_has_its_name_in_ros() -> None:
    kinds = [getattr(messages, name) for name in messages.__all__]
    unnamed = {
        kind.__name__
        for kind in kinds
        if isinstance(kind, type) and dc.is_dataclass(kind) and not ros_type(kind)
    }

    # Requests, answers and events, and parts of messages that we keep as fields.
    assert unnamed == {
        "CancelGoal",
        "CancelResponse",
        "Duration",
        "FollowJointTrajectoryFeedback",
        "FollowJointTrajectoryResult",
        "GoalEvent",
        "GripperCommandResult",
        "ParallelGripperCommandResult",
        "ParametersRejected",
        "PointField",
        "QueryTrajectoryState",
        "RegionOfInterest",
        "ResetOdometry",
        "SendGoal",
        "SetOdometry",
        "SwitchController",
        "SwitchControllerResult",
        "Time",
        "TopicRejected",
    }
