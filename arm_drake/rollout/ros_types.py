"""The types of ROS 2 messages, and messages as bytes, through the rosbags library."""

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from arm_drake.errors import MissingExtraError

# What no type store of rosbags has: the fields of `control_msgs` (jazzy), which are
# facts of the wire format.
_DEFINITIONS = {
    "InterfaceValue": "string[] interface_names\nfloat64[] values",
    "DynamicJointState": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "control_msgs/InterfaceValue[] interface_values"
    ),
    "JointTrajectoryControllerState": (
        "std_msgs/Header header\nstring[] joint_names\n"
        + "".join(
            f"trajectory_msgs/JointTrajectoryPoint {name}\n"
            for name in ("reference", "feedback", "error", "output")
        )
        + "string[] multi_dof_joint_names\n"
        + "".join(
            f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}\n"
            for name in ("reference", "feedback", "error", "output")
        )
        + "float64 speed_scaling_factor"
    ),
    "MultiDOFCommand": "string[] dof_names\nfloat64[] values\nfloat64[] values_dot",
    "SpeedScalingFactor": "float64 factor",
}

# Packages of the messages that are sent to controllers, by the class of the message.
_PACKAGES = {
    "JointTrajectory": "trajectory_msgs",
    "JointState": "sensor_msgs",
    **dict.fromkeys(
        ("Float64MultiArray", "Float64", "Float32", "Bool", "String"), "std_msgs"
    ),
    **dict.fromkeys(("Twist", "TwistStamped", "WrenchStamped"), "geometry_msgs"),
    **dict.fromkeys(("MultiDOFCommand", "SpeedScalingFactor"), "control_msgs"),
}


def type_of(message: str) -> str | None:
    """Return the type of a message in ROS, None if a bag has no topic for it.

    Args:
        message: Name of its class.
    """
    package = _PACKAGES.get(message)
    return package and f"{package}/msg/{message}"


@functools.cache
def load_types() -> "RosTypes":
    """Return the types.

    Raises:
        MissingExtraError: If rosbags isn't installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MissingExtraError("a log of ROS 2 messages (.mcap)", "bag") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, f"control_msgs/msg/{name}"))
    return RosTypes(store)


class RosTypes:
    """Makes messages of plain data."""

    def __init__(self, store: Any) -> None:
        """Create it.

        Args:
            store: A type store of rosbags.
        """
        self._store = store
        self._plans: dict[str, tuple[Any, dict[str, Any], dict[str, Any]]] = {}

    def schema(self, type_: str) -> str:
        """Return the definition of a type and of those that it contains."""
        text: str = self._store.generate_msgdef(type_, ros_version=2)[0]
        return text

    def hash(self, type_: str) -> str:
        """Return the hash by which ROS 2 knows a type."""
        text: str = self._store.hash_rihs01(type_)
        return text

    def encode(self, type_: str, fields: Mapping[str, Any]) -> bytes:
        """Return a message as bytes in CDR.

        Args:
            type_: Its type, such as "std_msgs/msg/String".
            fields: Its fields as plain data; those that are left out are 0 or empty.
        """
        return bytes(self._store.serialize_cdr(self._make(type_, fields), type_))

    def decode(self, type_: str, data: bytes) -> Any:
        """Return a message of bytes, with its fields as attributes."""
        return self._store.deserialize_cdr(data, type_)

    def _make(self, type_: str, fields: Mapping[str, Any]) -> Any:
        make, kinds, nothing = self._plan(type_)
        values = dict(nothing)
        for name, value in fields.items():
            if name in kinds and value is not None:
                values[name] = self._value(kinds[name], value)
        return make(**values)

    def _plan(self, type_: str) -> tuple[Any, dict[str, Any], dict[str, Any]]:
        """Return the class of a type, the kinds of its fields, and those of nothing."""
        plan = self._plans.get(type_)
        if plan is None:
            kinds = dict(self._store.fielddefs[type_][1])
            # Nobody changes them, so that all messages may share them.
            nothing = {name: self._value(kind, None) for name, kind in kinds.items()}
            plan = self._plans[type_] = (self._store.types[type_], kinds, nothing)
        return plan

    def _value(self, kind: Any, value: Any) -> Any:
        """Return a field's value; None is that of nothing."""
        node, inner = int(kind[0]), kind[1]
        if node == _BASE:
            make = _PYTHON.get(inner[0], int)
            return make() if value is None else make(value)
        if node == _NAME:
            return self._make(inner, value or {})
        element = inner[0]
        items = [] if value is None else value
        if node == _ARRAY and value is None:
            items = [None] * inner[1]
        if int(element[0]) == _BASE and element[1][0] != "string":
            if value is None:
                items = [0] * len(items)
            return np.ascontiguousarray(items, dtype=element[1][0])
        if int(element[0]) == _BASE and value is not None:
            return list(map(str, items))
        return [self._value(element, item) for item in items]


# Kinds of fields: rosbags.interfaces.Nodetype.
_BASE, _NAME, _ARRAY = 1, 2, 3

_PYTHON: dict[str, Any] = {
    "string": str,
    "float32": float,
    "float64": float,
    "bool": bool,
}
