"""URDF text to a RobotDescription: parsed, normalised, repaired.

What Drake can't take as it stands is changed in the text handed to it, and every change
is a line in the load report.
"""

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.packages import PackageFinder
from arm_drake.description.repairs import normalise
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    GazeboPlugin,
    HardwareInfo,
    read_gazebo_plugins,
    read_hardware,
)
from arm_drake.errors import DescriptionError, suggest

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
JOINT_TYPES = (*MOVABLE_TYPES, "fixed", "floating", "planar")

WORLD = "world"


@dc.dataclass(frozen=True)
class JointLimits:
    """`<limit>` of a joint; None where nothing is said, or 0 or inf for "unset"."""

    # [rad] or [m].
    lower: float | None = None
    upper: float | None = None

    # [N·m] or [N].
    effort: float | None = None

    # [rad/s] or [m/s].
    velocity: float | None = None


@dc.dataclass(frozen=True)
class Mimic:
    """`<mimic>`: position = multiplier * position of ``joint`` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dc.dataclass(frozen=True)
class JointInfo:
    """A joint of a robot."""

    name: str

    # One of JOINT_TYPES.
    type: str

    parent: str
    child: str
    limits: JointLimits = JointLimits()

    # Viscous damping [N·m·s/rad] or [N·s/m].
    damping: float = 0.0

    # Dry friction [N·m] or [N].
    friction: float = 0.0

    mimic: Mimic | None = None

    @property
    def is_movable(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.type in MOVABLE_TYPES


@dc.dataclass(frozen=True)
class RobotDescription:
    """A robot as its files describe it."""

    # Name in the `<robot>` tag.
    name: str

    # Entry file.
    file: Path

    links: tuple[str, ...]

    # In the order of the file.
    joints: tuple[JointInfo, ...]

    # Blocks of `<ros2_control>`.
    hardware: tuple[HardwareInfo, ...]

    gazebo_plugins: tuple[GazeboPlugin, ...]

    # The expanded description, as it was written.
    source: str

    # The description as Drake takes it: meshes converted, repairs made.
    urdf: str

    @property
    def movable_joints(self) -> tuple[JointInfo, ...]:
        """The joints with a degree of freedom, in the order of the file."""
        return tuple(joint for joint in self.joints if joint.is_movable)

    @property
    def roots(self) -> tuple[str, ...]:
        """The links that no joint attaches to anything, the world left out."""
        children = {joint.child for joint in self.joints}
        return tuple(n for n in self.links if n not in children and n != WORLD)

    def joint(self, name: str) -> JointInfo:
        """Return the joint of this name.

        Raises:
            KeyError: If there is none.
        """
        return {joint.name: joint for joint in self.joints}[name]


def parse_urdf(
    text: str, file: Path, packages: PackageFinder, report: LoadReport
) -> RobotDescription:
    """Return the robot that a URDF text describes.

    Args:
        text: Expanded URDF.
        file: File it came from; relative mesh paths start in its folder.
        packages: What resolves package URIs.
        report: Where every repair is recorded.

    Raises:
        DescriptionError: If the text is no robot.
    """
    root = _parse_xml(text, file)
    if root.tag != "robot":
        raise DescriptionError(
            f"the root element is <{root.tag}>; expected <robot>", file=file
        )
    links = tuple(link.get("name", "") for link in root.iterfind("link"))
    if "" in links:
        raise DescriptionError(
            'a link has no name; expected <link name="...">', file=file
        )
    if not links:
        raise DescriptionError(
            "no robot was instantiated: the file has no <link>; a file that only "
            "defines macros needs one that calls them",
            file=file,
        )
    joints = tuple(_joint(element, file) for element in root.iterfind("joint"))
    _check_structure(links, joints, file)
    hardware = read_hardware(root, [joint.name for joint in joints], report, file)
    plugins = read_gazebo_plugins(root)
    normalise(root, file, packages, report)
    robot = RobotDescription(
        name=root.get("name") or file.name.partition(".")[0],
        file=file,
        links=links,
        joints=joints,
        hardware=hardware,
        gazebo_plugins=plugins,
        source=text,
        urdf=ET.tostring(root, encoding="unicode"),
    )
    is_attached = any(joint.parent == WORLD for joint in joints)
    if len(robot.roots) + (WORLD in links or is_attached) > 1:
        report.add(
            "warning",
            "repair",
            f"links {sorted(robot.roots)} are attached to nothing",
            "they are fixed to the world",
            file=file,
        )
    return robot


def _parse_xml(text: str, file: Path) -> ET.Element:
    try:
        return ET.fromstring(text)  # noqa: S314  expat fetches no external entities.
    except ET.ParseError as error:
        line, _ = error.position
        reason = str(error).partition(":")[0]
        raise DescriptionError(
            f"malformed XML: {reason}", file=file, line=line
        ) from None


def _joint(element: ET.Element, file: Path) -> JointInfo:
    name = element.get("name")
    if not name:
        raise DescriptionError(
            'a joint has no name; expected <joint name="...">', file=file
        )
    where = f"joint {name!r}"
    joint_type = element.get("type", "")
    if joint_type not in JOINT_TYPES:
        raise DescriptionError(
            f"type {joint_type!r}; expected one of {', '.join(JOINT_TYPES)}",
            file=file,
            where=where,
        )
    mimic = element.find("mimic")
    try:
        return JointInfo(
            name=name,
            type=joint_type,
            parent=_child_attribute(element, "parent", "link"),
            child=_child_attribute(element, "child", "link"),
            limits=_limits(element.find("limit"), joint_type),
            damping=_number(element.find("dynamics"), "damping", 0.0),
            friction=_number(element.find("dynamics"), "friction", 0.0),
            mimic=None
            if mimic is None
            else Mimic(
                joint=mimic.get("joint", ""),
                multiplier=_number(mimic, "multiplier", 1.0),
                offset=_number(mimic, "offset", 0.0),
            ),
        )
    except ValueError as error:
        raise DescriptionError(str(error), file=file, where=where) from None


def _child_attribute(element: ET.Element, tag: str, attribute: str) -> str:
    child = element.find(tag)
    value = None if child is None else child.get(attribute)
    if not value:
        raise ValueError(f'expected <{tag} {attribute}="...">')
    return value


def _limits(element: ET.Element | None, joint_type: str) -> JointLimits:
    if element is None:
        return JointLimits()
    effort = abs(_number(element, "effort", 0.0))
    velocity = abs(_number(element, "velocity", 0.0))
    lower, upper = (_number(element, end, 0.0) for end in ("lower", "upper"))
    has_range = joint_type != "continuous"
    if has_range and lower > upper:
        raise ValueError(f"lower: expected at most upper, {upper}, got {lower}")
    return JointLimits(
        lower=lower if has_range else None,
        upper=upper if has_range else None,
        effort=effort if 0.0 < effort < math.inf else None,
        velocity=velocity if 0.0 < velocity < math.inf else None,
    )


def _number(element: ET.Element | None, attribute: str, default: float) -> float:
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise ValueError(f"{attribute}: expected a number, got {text!r}")
    return number


def _check_structure(
    links: tuple[str, ...], joints: tuple[JointInfo, ...], file: Path
) -> None:
    for kind, names in (("link", links), ("joint", [j.name for j in joints])):
        repeated = sorted({name for name in names if list(names).count(name) > 1})
        if repeated:
            raise DescriptionError(
                f"two {kind}s are called {repeated[0]!r}; names must be unique",
                file=file,
            )
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links and link != WORLD:
                raise DescriptionError(
                    f"{role} link {link!r} doesn't exist; {suggest(link, links)}",
                    file=file,
                    where=f"joint {joint.name!r}",
                )
    _check_tree(joints, file)
    _check_mimics({joint.name: joint for joint in joints}, file)


def _check_tree(joints: tuple[JointInfo, ...], file: Path) -> None:
    holders: dict[str, JointInfo] = {}
    for joint in joints:
        other = holders.setdefault(joint.child, joint)
        if other is not joint:
            raise DescriptionError(
                f"joint {other.name!r} holds link {joint.child!r} already; "
                "a link is the child of one joint",
                file=file,
                where=f"joint {joint.name!r}",
            )
    is_tree: set[str] = set()
    for joint in joints:
        path, link = {joint.child}, joint.parent
        while link in holders and link not in is_tree:
            if link in path:
                raise DescriptionError(
                    f"link {link!r} hangs on itself; links and joints form a tree",
                    file=file,
                    where=f"joint {holders[link].name!r}",
                )
            path.add(link)
            link = holders[link].parent
        is_tree |= path


def _check_mimics(joints: dict[str, JointInfo], file: Path) -> None:
    for joint in joints.values():
        master, seen = joint, {joint.name}
        while master.mimic is not None:
            name = master.mimic.joint
            if name not in joints:
                problem = f"mimics {name!r}, which doesn't exist; "
                problem += suggest(name, joints)
            elif name in seen:
                problem = f"mimics itself, through {name!r}"
            elif joint.is_movable and not joints[name].is_movable:
                problem = f"mimics {name!r}, which is {joints[name].type}; "
                problem += f"expected one of {', '.join(MOVABLE_TYPES)}"
            else:
                master = joints[name]
                seen.add(name)
                continue
            raise DescriptionError(problem, file=file, where=f"joint {joint.name!r}")
