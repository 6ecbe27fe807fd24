"""Robots for the benchmark, as one URDF text that every engine reads.

Visual elements are left out: nothing is drawn. What collides stays, and links of one
robot pass through each other in every engine.
"""

import math
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import yaml

import arm_drake as ad

# Rate of the controllers [Hz].
RATE = 100

CONTROLLER = "follower"

# Lengths, masses, efforts of a UR5e as its maker publishes them: per link its length
# along x, y, z [m], radius [m], mass [kg]; joints turn about `axis` at `origin`.
_UR5E = (
    ("shoulder_pan", "z", (0.0, 0.0, 0.1625), (0.0, 0.0, -0.1), 0.06, 3.761, 150.0),
    ("shoulder_lift", "y", (0.0, 0.0, 0.0), (0.425, 0.0, 0.0), 0.06, 8.058, 150.0),
    ("elbow", "y", (0.425, 0.0, 0.0), (0.3922, 0.0, 0.0), 0.05, 2.846, 150.0),
    ("wrist_1", "y", (0.3922, 0.1333, 0.0), (0.0, 0.0, -0.0997), 0.0375, 1.37, 28.0),
    ("wrist_2", "z", (0.0, 0.0, -0.0997), (0.0, 0.0996, 0.0), 0.0375, 1.3, 28.0),
    ("wrist_3", "y", (0.0, 0.0996, 0.0), (0.0, 0.04, 0.0), 0.0375, 0.365, 28.0),
)
_UR5E_SPEED = math.pi

_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}

# What turns a cylinder from z to an axis.
_TURNS = {"x": f"0 {math.pi / 2} 0", "y": f"{math.pi / 2} 0 0", "z": "0 0 0"}


class Mimic(NamedTuple):
    """A joint that follows another one: factor times its position, plus offset."""

    follower: str
    master: str
    factor: float
    offset: float


def ur5e_like() -> str:
    """Return the URDF of a six-joint arm with the size and weight of a UR5e."""
    parts, parent = [_link("base", "z", 0.1, 0.07, 4.0)], "base"
    for name, axis, origin, along, radius, mass, effort in _UR5E:
        way = next(a for a, length in zip("xyz", along, strict=True) if length)
        length = next(filter(None, along))
        link = f"{name}_link"
        parts += [
            _link(link, way, length, radius, mass),
            _joint(name, parent, link, axis, origin, effort, _UR5E_SPEED),
        ]
        parent = link
    return f'<robot name="ur5e_like">{"".join(parts)}</robot>'


def chain(num_joints: int) -> str:
    """Return the URDF of a chain whose joints turn about y and z in turns."""
    length, mass = 1.5 / num_joints, 12.0 / num_joints
    parts, parent, origin = [_link("base", "z", 0.1, 0.05, 1.0)], "base", (0.0,) * 3
    for i in range(num_joints):
        link = f"link{i}"
        parts += [
            _link(link, "x", length, 0.04, mass),
            _joint(f"joint{i}", parent, link, "yz"[i % 2], origin, 1e4, 10.0),
        ]
        parent, origin = link, (length, 0.0, 0.0)
    return f'<robot name="chain{num_joints}">{"".join(parts)}</robot>'


@cache
def bundled(name: str) -> str:
    """Return the URDF of a bundled robot, without what only ROS and viewers read."""
    root = ET.fromstring(ad.load_robot(name).description.urdf)  # noqa: S314  ours.
    for tag in ("ros2_control", "gazebo", "transmission"):
        for element in root.findall(tag):
            root.remove(element)
    for link in root.iterfind("link"):
        for element in link.findall("visual"):
            link.remove(element)
    # Engines differ in what a link "world" is.
    for element in root.findall("link"):
        if element.get("name") == "world":
            root.remove(element)
    for element in root.findall("joint"):
        parent = element.find("parent")
        if parent is not None and parent.get("link") == "world":
            root.remove(element)
    return ET.tostring(root, encoding="unicode")


def mimics_of(urdf: str) -> tuple[Mimic, ...]:
    """Return the joints that follow others."""
    return tuple(
        Mimic(
            joint.attrib["name"],
            mimic.attrib["joint"],
            float(mimic.get("multiplier", "1")),
            float(mimic.get("offset", "0")),
        )
        for joint in ET.fromstring(urdf).iterfind("joint")  # noqa: S314
        if (mimic := joint.find("mimic")) is not None
    )


def joints_of(urdf: str) -> tuple[str, ...]:
    """Return the joints that move by themselves, in the order of the text."""
    return tuple(
        joint.attrib["name"]
        for joint in ET.fromstring(urdf).iterfind("joint")  # noqa: S314
        if joint.get("type") != "fixed" and joint.find("mimic") is None
    )


def damping_of(urdf: str) -> dict[str, float]:
    """Return the viscous damping of all movable joints [N·m·s/rad]."""
    found = {}
    for joint in ET.fromstring(urdf).iterfind("joint"):  # noqa: S314
        dynamics = joint.find("dynamics")
        if joint.get("type") != "fixed":
            value = "0" if dynamics is None else dynamics.get("damping", "0")
            found[joint.attrib["name"]] = float(value)
    return found


def load(urdf: str, *, name: str = "robot", place: float = 0.0) -> ad.Robot:
    """Return our robot of a URDF, with a position controller of all its joints.

    Args:
        urdf: The text.
        name: Name of the robot.
        place: Where it stands along y [m].
    """
    joints = joints_of(urdf)
    with tempfile.TemporaryDirectory() as folder:
        robot_file = Path(folder) / "robot.urdf"
        robot_file.write_text(urdf.replace("</robot>", _control(joints) + "</robot>"))
        controllers = Path(folder) / "controllers.yaml"
        controllers.write_text(yaml.safe_dump(_controllers(joints)))
        pose = (0.0, place, 0.0, 0.0, 0.0, 0.0)
        return ad.load_robot(robot_file, controllers=controllers, name=name, pose=pose)


def _control(joints: Sequence[str]) -> str:
    blocks = "".join(
        f'<joint name="{name}"><command_interface name="position"/>'
        '<state_interface name="position"/><state_interface name="velocity"/></joint>'
        for name in joints
    )
    plugin = "<hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>"
    return f'<ros2_control name="h" type="system">{plugin}{blocks}</ros2_control>'


def _controllers(joints: Sequence[str]) -> dict[str, object]:
    kind = "joint_trajectory_controller/JointTrajectoryController"
    state = "joint_state_broadcaster/JointStateBroadcaster"
    manager = {
        "update_rate": RATE,
        "broadcaster": {"type": state},
        CONTROLLER: {"type": kind},
    }
    settings = {
        "joints": list(joints),
        "command_interfaces": ["position"],
        "state_interfaces": ["position", "velocity"],
    }
    return {
        "controller_manager": {"ros__parameters": manager},
        CONTROLLER: {"ros__parameters": settings},
    }


def _link(name: str, way: str, length: float, radius: float, mass: float) -> str:
    """Return a cylinder from the link's origin along an axis."""
    centre = " ".join(str(length / 2.0 * (a == way)) for a in "xyz")
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    moments = " ".join(
        f'i{a}{a}="{mass * radius**2 / 2.0 if a == way else across}"' for a in "xyz"
    )
    return (
        f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
        f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{centre}" rpy="{_TURNS[way]}"/><geometry>'
        f'<cylinder radius="{radius}" length="{abs(length)}"/></geometry></collision>'
        "</link>"
    )


def _joint(
    name: str,
    parent: str,
    child: str,
    axis: str,
    origin: Sequence[float],
    effort: float,
    speed: float,
) -> str:
    place = " ".join(map(str, origin))
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{place}"/><axis xyz="{_AXES[axis]}"/>'
        f'<limit lower="-6.28" upper="6.28" effort="{effort}" velocity="{speed}"/>'
        "</joint>"
    )
