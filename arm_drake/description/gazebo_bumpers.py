"""Contact sensors of Gazebo, with the fields of their tags.

Sources: gz-sim, src/systems/contact/Contact.cc; gazebo_ros_pkgs, branch ros2,
gazebo_plugins/src/gazebo_ros_bumper.cpp.
"""

import dataclasses as dc


@dc.dataclass(frozen=True)
class ContactSensorTag:
    """A contact sensor."""

    name: str

    link: str

    # The shapes that it feels with, "<link>::<shape>".
    shapes: tuple[str, ...]

    # Topic that its tag names; empty is Gazebo's default.
    topic: str = ""

    # Whether Gazebo Classic's plugin publishes what it feels.
    is_classic: bool = False

    # Link in whose frame that is told; empty is the world's.
    frame: str = ""

    namespace: str = ""
    remappings: tuple[str, ...] = ()


def shape_name(link: str, number: int) -> str:
    """Return what the n-th collision shape of a link is called, from 0 on."""
    return f"{link}_collision" + (f"_{number}" if number else "")
