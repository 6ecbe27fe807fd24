"""Which joints drive and steer mobile bases, and which links are their wheels."""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence

from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.gazebo_drives import DiffDrive, GazeboRosDiffDrive
from arm_drake.description.given import Parameter
from arm_drake.description.joints import JointInfo
from arm_drake.description.summary import total_mass
from arm_drake.description.tree import last_master
from arm_drake.description.urdf import RobotDescription

# Parameters of the types that name driven joints, and those that name steered ones.
_STEERING = (("traction_joints_names",), ("steering_joints_names",))
_PARAMETERS: Mapping[str, tuple[Sequence[str], Sequence[str]]] = {
    "diff_drive_controller/DiffDriveController": (
        ("left_wheel_names", "right_wheel_names"),
        (),
    ),
    "mecanum_drive_controller/MecanumDriveController": (
        tuple(
            f"{end}_{side}_wheel_command_joint_name"
            for end, side in (
                ("front", "left"),
                ("front", "right"),
                ("rear", "right"),
                ("rear", "left"),
            )
        ),
        (),
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": (("wheel_names",), ()),
    "tricycle_controller/TricycleController": (
        ("traction_joint_name",),
        ("steering_joint_name",),
    ),
    "ackermann_steering_controller/AckermannSteeringController": _STEERING,
    "bicycle_steering_controller/BicycleSteeringController": _STEERING,
    "tricycle_steering_controller/TricycleSteeringController": _STEERING,
}

# Humble's names of the driven and of the steered joints, by `front_steering`.
_OF_HUMBLE = {
    True: ("rear_wheels_names", "front_wheels_names"),
    False: ("front_wheels_names", "rear_wheels_names"),
}


@dc.dataclass(frozen=True)
class MobileBase:
    """A base as one controller drives it."""

    # Name of the controller.
    controller: str

    # Joints that it drives, and joints that it steers, as its parameters order them.
    driven: tuple[str, ...]
    steered: tuple[str, ...]

    # Link whose odometry the controller publishes.
    link: str


def find_bases(
    description: RobotDescription, config: ControllerManagerConfig
) -> tuple[MobileBase, ...]:
    """Return the bases that controllers and Gazebo's plugins drive.

    Joints that the description lacks are left out: their controllers don't load.

    Args:
        description: The robot.
        config: What the YAML configures.
    """
    bases = []
    joints = {joint.name for joint in description.movable_joints}
    for controller in config.controllers:
        tags = [
            tag
            for tag in controller.plugins
            if isinstance(tag, DiffDrive | GazeboRosDiffDrive)
        ]
        if tags:
            names = [n for tag in tags for n in (*tag.left_joints, *tag.right_joints)]
            driven = tuple(n for n in dict.fromkeys(names) if n in joints)
            link = tags[0].base_link or description.base
            bases.append(MobileBase(controller.name, driven, (), link))
        if controller.type not in _PARAMETERS:
            continue
        given = controller.parameters
        driving, steering = _PARAMETERS[controller.type]
        if _PARAMETERS[controller.type] is _STEERING:
            steers_front = given.get("front_steering")
            is_front = steers_front is None or bool(steers_front.value)
            older = _OF_HUMBLE[is_front]
            driving, steering = (*driving, older[0]), (*steering, older[1])
        frame = given.get("base_frame_id")
        link = "base_link" if frame is None else str(frame.value)
        bases.append(
            MobileBase(
                controller.name,
                tuple(n for n in _names(given, driving) if n in joints),
                tuple(n for n in _names(given, steering) if n in joints),
                link if link in description.links else description.base,
            )
        )
    return tuple(bases)


def _names(given: Mapping[str, Parameter], parameters: Iterable[str]) -> list[str]:
    """Return the texts that parameters have, each once."""
    found: list[str] = []
    for name in parameters:
        value = given[name].value if name in given else ()
        texts = [value] if isinstance(value, str) else value
        if isinstance(texts, Sequence):
            found += [text for text in texts if isinstance(text, str)]
    return list(dict.fromkeys(found))


def moved_joints(description: RobotDescription, joint: str) -> list[JointInfo]:
    """Return a joint, and the mimic joints that follow it.

    Args:
        description: The robot.
        joint: Name of a movable joint.
    """
    movable = {j.name: j for j in description.movable_joints}
    return [j for j in movable.values() if last_master(j, movable)[0] == joint]


def rigid_links(description: RobotDescription, link: str) -> list[str]:
    """Return a link, and those that fixed joints attach to it, directly or not.

    Args:
        description: The robot.
        link: The link that is nearest to the root.
    """
    found = [link]
    for parent in found:
        found += [
            j.child
            for j in description.joints
            if j.type == "fixed" and j.parent == parent
        ]
    return found


def wheel_links(description: RobotDescription, joint: str) -> list[str]:
    """Return the links of the wheels that a joint drives, mimic joints included.

    Args:
        description: The robot.
        joint: Name of a driven joint.
    """
    return [
        link
        for moved in moved_joints(description, joint)
        for link in rigid_links(description, moved.child)
    ]


def carried_inertia(
    description: RobotDescription, bases: Iterable[MobileBase]
) -> dict[str, float]:
    """Return what driven joints move on the ground besides their wheels [kg·m^2].

    That is the robot's mass at the rim of the wheels, shared by the joints of a base.
    Wheels that are neither cylinders nor spheres are left out.

    Args:
        description: The robot.
        bases: What its controllers drive.
    """
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    mass = total_mass(description)
    carried: dict[str, float] = {}
    for base in bases:
        for joint in base.driven:
            radius = max(
                (_radius(links[name]) for name in wheel_links(description, joint)),
                default=0.0,
            )
            if radius > 0.0:
                carried[joint] = mass * radius**2 / len(base.driven)
    return carried


def _radius(link: ET.Element) -> float:
    """Return the radius of the largest cylinder or sphere to collide with [m]."""
    shapes = (
        shape
        for tag in ("cylinder", "sphere")
        for shape in link.iterfind(f"collision/geometry/{tag}")
    )
    radii = [float(shape.get("radius", "0")) for shape in shapes]
    return max((r for r in radii if math.isfinite(r)), default=0.0)
