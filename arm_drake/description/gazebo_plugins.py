"""How a dataclass of a Gazebo plugin says from which tags its fields are read."""

import dataclasses as dc
from typing import Any


def tags(*names: str, default: Any = ()) -> Any:
    """Return a field that is read from these tags instead of the one of its name.

    Args:
        names: The tags; none if what stands there is found in the robot.
        default: Its value where none is given.
    """
    return dc.field(default=default, metadata={"tags": names})


def joint_tags(*names: str) -> Any:
    """Return a field of joint names, read from these tags."""
    return dc.field(default=(), metadata={"tags": names, "joints": True})
