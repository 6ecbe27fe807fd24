"""RobotDescription: a robot as its URDF describes it, read once and mended for Drake.

What Drake can't take as it stands is changed in the tree that is handed to it, see
`repairs`, and every change is a line in the load report.
"""

import dataclasses as dc
import functools
import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from arm_drake.description.elements import (
    ElementReader,
    parse_float,
    parse_xml,
    quote_attribute,
)
from arm_drake.description.gazebo import (
    CONTACT,
    GazeboPlugin,
    GazeboSensor,
    read_friction,
    read_gazebo_plugins,
    read_gazebo_sensors,
    read_joint_plugins,
    report_gazebo,
)
from arm_drake.description.gazebo_plugins import JointPlugin
from arm_drake.description.joints import (
    FREE_TYPES,
    JOINT_TYPES,
    WORLD,
    JointInfo,
    JointLimits,
    Mimic,
    SafetyController,
    check_structure,
    drop_bad_mimics,
    find_mimics,
    links_on,
    report_degrees,
    write_mimics,
)
from arm_drake.description.links import LinkInfo, read_axis, read_link, read_origin
from arm_drake.description.packages import PackageFinder
from arm_drake.description.repairs import normalise
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    HardwareInfo,
    read_hardware,
    report_hardware,
)
from arm_drake.errors import DescriptionError, InputError, counted, suggest

if TYPE_CHECKING:
    from arm_drake.description.perception_sensors import PerceptionSensor

# Shapes of a kind that one link may have.
_MOST_SHAPES = 1000

# What a description may have in all; with so much it takes some 20 s to load and build.
# Drake's time grows with the square of links that have shapes, and mass matrices with
# that of movable joints.
_MOST_ELEMENTS = 100_000
_MOST = {"link": 3000, "link/visual": 3000, "link/collision": 3000}
_MOST_MOVABLE_JOINTS = 1000

# How packages with an SRDF are called.
_MOVEIT = "moveit_config"


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

    # Those of them that move or report joints, with the fields they have.
    joint_plugins: tuple[JointPlugin, ...]

    # Sensors in `<gazebo>` tags.
    gazebo_sensors: tuple[GazeboSensor, ...]

    # Cameras and lidars among them.
    perception_sensors: "tuple[PerceptionSensor, ...]"

    # Friction coefficients by link, at most 1, of those that `<gazebo>` tags state.
    friction: Mapping[str, float]

    # Links with one collision shape as written; several shapes of such a link are
    # convex parts of its mesh.
    undivided: frozenset[str]

    # Files of meshes and textures, as they are named.
    mesh_names: tuple[str, ...]

    # The expanded description, as it was written.
    source: str

    # The description as Drake takes it: meshes converted, repairs made. Nobody changes
    # it; what needs another makes a copy.
    root: ET.Element = dc.field(repr=False, compare=False)

    # Folders that were searched for packages.
    package_paths: tuple[Path, ...] = dc.field(default=(), repr=False, compare=False)

    def __repr__(self) -> str:
        """Return its name and what moves; its fields are long."""
        joints = [joint.name for joint in self.movable_joints]
        links = counted(len(self.links), "link")
        return f"<RobotDescription {self.name!r}, {links}, joints {joints}>"

    def __eq__(self, other: object) -> bool:
        """Return whether all is the same; trees are compared as texts."""
        if not isinstance(other, RobotDescription):
            return NotImplemented
        names = [field.name for field in dc.fields(self) if field.compare]
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        return same and self.urdf == other.urdf

    @functools.cached_property
    def urdf(self) -> str:
        """The description as Drake takes it, as a text."""
        return ET.tostring(self.root, encoding="unicode")

    @functools.cached_property
    def link_infos(self) -> tuple[LinkInfo, ...]:
        """The links as they are simulated, in the order of the file."""
        return tuple(map(read_link, self.root.iterfind("link")))

    @functools.cached_property
    def _links_by_name(self) -> Mapping[str, LinkInfo]:
        return {link.name: link for link in self.link_infos}

    @functools.cached_property
    def moveit_folders(self) -> tuple[Path, ...]:
        """Its own package and those of MoveIt around it; all packages are looked at."""
        own = [f for f in self.file.parents if (f / "package.xml").is_file()][:1]
        known = PackageFinder(self.file, self.package_paths).known()
        return (*own, *(folder for name, folder in known if _MOVEIT in name))

    @property
    def movable_joints(self) -> tuple[JointInfo, ...]:
        """The joints with a degree of freedom, in the order of the file."""
        return tuple(joint for joint in self.joints if joint.is_movable)

    @property
    def roots(self) -> tuple[str, ...]:
        """The links that no joint attaches to anything, the world left out."""
        children = {joint.child for joint in self.joints}
        return tuple(n for n in self.links if n not in children and n != WORLD)

    @property
    def base(self) -> str:
        """The root that carries most links: what moves if the robot's base does."""
        return max(self.roots, key=lambda root: len(links_on(self.joints, root)))

    def link(self, name: str) -> LinkInfo:
        """Return the link of this name; KeyError if there is none."""
        return self._links_by_name[name]

    def joint(self, name: str) -> JointInfo:
        """Return the joint of this name; KeyError if there is none."""
        return {joint.name: joint for joint in self.joints}[name]


# Frames fixed to links, by name: the link, and x, y, z [m], roll, pitch, yaw [rad].
Frames = Mapping[str, tuple[str, Sequence[float]]]


def add_frames(text: str, frames: Frames, file: Path) -> str:
    """Return a URDF text with links without mass, each fixed to another.

    InputError if a frame's link isn't there, its name is taken, or its pose wrong.
    """
    root = parse_xml(text, file)
    links = [link.get("name", "") for link in root.iterfind("link")]
    joints = {joint.get("name", "") for joint in root.iterfind("joint")}
    added = ""
    for name, frame in frames.items():
        where = f"frame {name!r}"
        if not isinstance(frame, Sequence) or isinstance(frame, str) or len(frame) != 2:
            problem = f"expected a link and a pose, got {frame!r}"
            raise InputError(problem, file=file, where=where)
        parent, pose = frame
        if not name or name in links:
            problem = "a link is called so" if name else "expected a name"
            raise InputError(problem, file=file, where=where)
        if parent not in links:
            problem = f"no link {parent!r}; {suggest(parent, links)}"
            raise InputError(problem, file=file, where=where)
        numbers = [float(number) for number in pose]
        if len(numbers) != 6 or not all(map(math.isfinite, numbers)):
            problem = f"expected x, y, z [m], roll, pitch, yaw [rad], got {list(pose)}"
            raise InputError(problem, file=file, where=where)
        joint = f"{name}_fixed_joint"
        while joint in joints:
            joint += "_"
        xyz, rpy = (" ".join(map(str, part)) for part in (numbers[:3], numbers[3:]))
        added += (
            f"<link name={quote_attribute(name)}/>"
            f'<joint name={quote_attribute(joint)} type="fixed">'
            f"<parent link={quote_attribute(parent)}/>"
            f"<child link={quote_attribute(name)}/>"
            f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
        )
        links.append(name)
    before, end, after = text.rpartition("</robot>")
    return before + added + end + after if end else text


def parse_urdf(
    text: str,
    file: Path,
    packages: PackageFinder,
    report: LoadReport,
    *,
    decompose: bool = False,
    max_faces: int | None = None,
) -> RobotDescription:
    """Return the robot that a URDF text describes."""
    root = parse_xml(text, file)
    _check_size(root, file)
    links = _link_names(root, file)
    joints = tuple(_joint(element, file, report) for element in root.iterfind("joint"))
    check_structure(links, joints, file)
    report_degrees(joints, file, report)
    joints = drop_bad_mimics(joints, file, report)
    hardware = read_hardware(root, [joint.name for joint in joints], report, file)
    joints = find_mimics(joints, hardware, report, file)
    plugins = read_gazebo_plugins(root)
    report_hardware(hardware, report, file)
    sensors, seeing = _read_sensors(root, links, joints, hardware, report, file)
    as_written = _AsWritten.read(root, links)
    write_mimics(root, joints)
    normalise(root, file, packages, report, decompose=decompose, max_faces=max_faces)
    robot = RobotDescription(
        name=root.get("name") or file.name.partition(".")[0],
        file=file,
        links=links,
        joints=_with_places(joints, root),
        hardware=hardware,
        gazebo_plugins=plugins,
        joint_plugins=read_joint_plugins(
            plugins, [joint.name for joint in joints], report, file
        ),
        gazebo_sensors=sensors,
        perception_sensors=seeing,
        friction=as_written.friction,
        undivided=as_written.undivided,
        mesh_names=as_written.mesh_names,
        source=text,
        root=root,
        package_paths=packages.package_paths,
    )
    _report_loose(robot, report)
    return robot


def _check_size(root: ET.Element, file: Path) -> None:
    """Raise DescriptionError of what is larger than any robot."""
    movable = [e for e in root.iterfind("joint") if e.get("type") != "fixed"]
    counts = [
        ("elements", sum(1 for _ in root.iter()), _MOST_ELEMENTS),
        *((f"<{path}>", len(root.findall(path)), most) for path, most in _MOST.items()),
        ("joints that move", len(movable), _MOST_MOVABLE_JOINTS),
    ]
    for what, count, most in counts:
        if count > most:
            problem = f"{count} {what}; expected {most} at most"
            raise DescriptionError(problem, file=file)


def _link_names(root: ET.Element, file: Path) -> tuple[str, ...]:
    """Return the names of the links of what is a robot, else raise."""
    if root.tag != "robot":
        problem = f"the root element is <{root.tag}>; expected <robot>"
        raise DescriptionError(problem, file=file)
    links = tuple(link.get("name", "") for link in root.iterfind("link"))
    for link in root.iterfind("link"):
        for tag in ("visual", "collision"):
            if (count := len(link.findall(tag))) > _MOST_SHAPES:
                problem = (
                    f"{count} <{tag}> of one link; expected {_MOST_SHAPES} at most, "
                    "for Drake's time grows with their square: one mesh may hold all"
                )
                where = f"link {link.get('name', '')!r}"
                raise DescriptionError(problem, file=file, where=where)
    if "" in links:
        problem = 'a link has no name; expected <link name="...">'
        raise DescriptionError(problem, file=file)
    if not links:
        problem = "no robot was instantiated: the file has no <link>; "
        problem += "a file that only defines macros needs one that calls them"
        raise DescriptionError(problem, file=file)
    return links


def _read_sensors(
    root: ET.Element,
    links: Sequence[str],
    joints: Sequence[JointInfo],
    hardware: Sequence[HardwareInfo],
    report: LoadReport,
    file: Path,
) -> tuple[tuple[GazeboSensor, ...], "tuple[PerceptionSensor, ...]"]:
    """Return the sensors in `<gazebo>` tags, and cameras and lidars among them.

    What of the tags has no effect is recorded.
    """
    sensors = read_gazebo_sensors(root, report, file)
    components = {sensor.name for block in hardware for sensor in block.sensors}
    measuring = components.union(s.name for s in sensors if s.type == CONTACT)
    seeing: tuple[PerceptionSensor, ...] = ()
    realsenses = (p for p in read_gazebo_plugins(root) if p.is_realsense)
    if any(s.type != CONTACT for s in sensors) or any(realsenses):
        # Not at the top: its import takes 11 ms, and few robots have such a tag.
        from arm_drake.description import perception_sensors as perception

        seeing = perception.read_perception_sensors(root, links, joints, report, file)
        measuring.update(sensor.group or sensor.name for sensor in seeing)
        # Of those that are left out there is a line already.
        measuring.update(s.name for s in sensors if s.type in perception.TYPES)
    report_gazebo(root, report, file, sensors=measuring, sees=bool(seeing))
    return sensors, seeing


class _AsWritten(NamedTuple):
    """What is read of links before anything is mended."""

    friction: Mapping[str, float]
    undivided: frozenset[str]
    mesh_names: tuple[str, ...]

    @classmethod
    def read(cls, root: ET.Element, links: Collection[str]) -> "_AsWritten":
        """Return what the elements say."""
        meshes = [
            mesh
            for tag in ("visual", "collision")
            for mesh in root.iterfind(f"link/{tag}/geometry/mesh")
        ]
        names = (e.get("filename", "") for e in (*meshes, *root.iter("texture")))
        return cls(
            read_friction(root, links),
            frozenset(
                link.get("name", "")
                for link in root.iterfind("link")
                if len(link.findall("collision")) == 1
            ),
            tuple(dict.fromkeys(filter(None, names))),
        )


def _with_places(
    joints: Sequence[JointInfo], root: ET.Element
) -> tuple[JointInfo, ...]:
    """Return joints with their origins and axes, whose numbers have been checked."""
    return tuple(
        dc.replace(joint, origin=read_origin(element), axis=read_axis(element))
        for joint, element in zip(joints, root.iterfind("joint"), strict=True)
    )


def _report_loose(robot: RobotDescription, report: LoadReport) -> None:
    """Record several roots, which are fixed to the world."""
    is_attached = any(joint.parent == WORLD for joint in robot.joints)
    if len(robot.roots) + (WORLD in robot.links or is_attached) > 1:
        what = f"links {sorted(robot.roots)} are attached to nothing"
        done = "they are fixed to the world"
        report.add("warning", "repair", what, done, file=robot.file)


def _joint(element: ET.Element, file: Path, report: LoadReport) -> JointInfo:
    name = element.get("name")
    if not name:
        problem = 'a joint has no name; expected <joint name="...">'
        raise DescriptionError(problem, file=file)
    where = f"joint {name!r}"
    joint_type = element.get("type", "")
    if joint_type not in JOINT_TYPES:
        problem = f"type {joint_type!r}; expected one of {', '.join(JOINT_TYPES)}"
        raise DescriptionError(problem, file=file, where=where)
    reader = ElementReader(where, report, file)
    limit, dynamics = element.find("limit"), element.find("dynamics")
    mimic = element.find("mimic")
    try:
        _report_lacking(limit, joint_type, reader)
        _order_limits(limit, joint_type, reader)
        _drop_negative(dynamics, reader)
        if joint_type in FREE_TYPES:
            what = f"the joint is {joint_type}"
            done = "it moves freely, no controller moves it"
            reader.note("info", "unsupported", what, done)
        return JointInfo(
            name=name,
            type=joint_type,
            parent=_child_attribute(element, "parent", "link"),
            child=_child_attribute(element, "child", "link"),
            limits=_limits(limit, joint_type),
            damping=_number(dynamics, "damping", 0.0),
            friction=_number(dynamics, "friction", 0.0),
            mimic=None
            if mimic is None
            else Mimic(
                joint=mimic.get("joint", ""),
                multiplier=_number(mimic, "multiplier", 1.0),
                offset=_number(mimic, "offset", 0.0),
            ),
            safety_controller=_safety_controller(element, reader),
        )
    except ValueError as error:
        raise DescriptionError(str(error), file=file, where=where) from None


def _safety_controller(
    joint: ET.Element, reader: ElementReader
) -> SafetyController | None:
    """Return the soft limits of a joint; a malformed one is left out, not the robot."""
    element = joint.find("safety_controller")
    if element is None:
        return None
    names = [field.name for field in dc.fields(SafetyController)]
    values = {name: reader.finite(element.get(name), name) for name in names}
    return SafetyController(**{n: v for n, v in values.items() if v is not None})


def _child_attribute(element: ET.Element, tag: str, attribute: str) -> str:
    child = element.find(tag)
    value = None if child is None else child.get(attribute)
    if not value:
        raise ValueError(f'expected <{tag} {attribute}="...">')
    return value


def _report_lacking(
    limit: ET.Element | None, joint_type: str, reader: ElementReader
) -> None:
    """Record what urdfdom asks of a limit: without it ROS refuses the robot."""
    if limit is None and joint_type in ("revolute", "prismatic"):
        what = f"no <limit>, without which ROS takes no {joint_type} joint"
        reader.note("warning", "missing", what, "it moves without limits")
    if limit is None:
        return
    for name in ("effort", "velocity"):
        if name not in limit.attrib:
            what = f"<limit> without {name!r}, which ROS takes in no joint"
            reader.note("warning", "missing", what, "taken as unset")


def _order_limits(
    limit: ET.Element | None, joint_type: str, reader: ElementReader
) -> None:
    """Swap a lower and an upper limit that are the wrong way round."""
    lower, upper = (_number(limit, end, 0.0) for end in ("lower", "upper"))
    if limit is not None and lower > upper and joint_type != "continuous":
        limit.set("lower", repr(upper))
        limit.set("upper", repr(lower))
        what = f"the lower limit {lower} is above the upper one, {upper}"
        reader.note("warning", "repair", what, "swapped")


def _drop_negative(dynamics: ET.Element | None, reader: ElementReader) -> None:
    """Remove a damping or friction that would drive the joint."""
    for name in ("damping", "friction"):
        if dynamics is not None and _number(dynamics, name, 0.0) < 0.0:
            what = f"{name} {dynamics.attrib.pop(name)} is negative"
            reader.note("warning", "repair", what, "taken as 0")


def _limits(element: ET.Element | None, joint_type: str) -> JointLimits:
    if element is None:
        return JointLimits()
    effort = abs(_number(element, "effort", 0.0))
    velocity = abs(_number(element, "velocity", 0.0))
    lower, upper = (_number(element, end, 0.0) for end in ("lower", "upper"))
    has_range = joint_type in ("revolute", "prismatic")
    return JointLimits(
        lower=lower if has_range and math.isfinite(lower) else None,
        upper=upper if has_range and math.isfinite(upper) else None,
        effort=effort if 0.0 < effort < math.inf else None,
        velocity=velocity if 0.0 < velocity < math.inf else None,
    )


def _number(element: ET.Element | None, attribute: str, default: float) -> float:
    text = None if element is None else element.get(attribute)
    if text is None:
        return default
    number = parse_float(text)
    if number is None or math.isnan(number):
        raise ValueError(f"{attribute}: expected a number, got {text!r}")
    return number


def total_mass(description: RobotDescription) -> float:
    """Return the mass of all links together [kg], as it is simulated."""
    return math.fsum(link.mass for link in description.link_infos)


def reach(description: RobotDescription) -> float:
    """Return how far the last link can be from the first movable joint [m].

    That is the length of the longest stretched chain of links; a prismatic joint adds
    its travel. Limits and geometry may allow less.
    """
    children: dict[str, list[JointInfo]] = {}
    for joint in description.joints:
        children.setdefault(joint.parent, []).append(joint)
    longest = 0.0
    # Link, length up to it, and whether a movable joint lies before it.
    waiting = [(name, 0.0, False) for name in (*description.roots, WORLD)]
    while waiting:
        link, length, has_moved = waiting.pop()
        longest = max(longest, length)
        for joint in children.get(link, ()):
            step = math.hypot(*joint.origin.xyz) if has_moved else 0.0
            if joint.type == "prismatic":
                ends = (joint.limits.lower or 0.0, joint.limits.upper or 0.0)
                step += max(map(abs, ends))
            moved = has_moved or joint.is_movable
            waiting.append((joint.child, length + step, moved))
    return longest
