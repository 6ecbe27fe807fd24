"""RobotDescription: a robot as its URDF describes it, read once and mended for Drake.

Tags and attributes that nobody reads, and all that becomes something else because Drake
can't take it as it stands, are lines in the load report, one for each kind.
"""

import collections
import dataclasses as dc
import functools
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from arm_drake.description.elements import parse_xml, quote_attribute
from arm_drake.description.gazebo import (
    GazeboPlugin,
    add_mimics,
    read_friction,
    read_gazebo_plugins,
    read_joint_plugins,
    report_gazebo,
)
from arm_drake.description.gazebo_plugins import JointPlugin
from arm_drake.description.gazebo_sensors import (
    CONTACT,
    IMU,
    GazeboSensor,
    read_gazebo_sensors,
    report_unsimulated,
)
from arm_drake.description.inertia import repair_inertials
from arm_drake.description.joints import (
    WORLD,
    JointInfo,
    check_structure,
    drop_bad_mimics,
    extent,
    find_mimics,
    fit_mimic_limits,
    joints_on_links,
    links_on,
    read_joint,
    report_degrees,
    write_joint,
)
from arm_drake.description.links import SIZES, LinkInfo, Origin, read_links, write_link
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.ros2_control import (
    HardwareInfo,
    read_hardware,
    report_hardware,
)
from arm_drake.errors import (
    MISSPELT,
    DescriptionError,
    InputError,
    counted,
    find_close,
    suggest,
)
from arm_drake.importing import dataclass

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


@dataclass(frozen=True)
class RobotDescription:
    """A robot as its files describe it."""

    # Name in the `<robot>` tag.
    name: str

    # Entry file.
    file: Path

    # In the order of the file, as they are simulated.
    link_infos: tuple[LinkInfo, ...]

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

    # Folders that were searched for packages.
    package_paths: tuple[Path, ...] = dc.field(default=(), repr=False, compare=False)

    def __repr__(self) -> str:
        """Return its name and what moves; its fields are long."""
        joints = [joint.name for joint in self.movable_joints]
        links = counted(len(self.links), "link")
        return f"<RobotDescription {self.name!r}, {links}, joints {joints}>"

    @functools.cached_property
    def urdf(self) -> str:
        """The description as a text that Drake takes; damping in a plane is three."""
        return write_urdf(self.name, self.link_infos, self.joints)

    @functools.cached_property
    def links(self) -> tuple[str, ...]:
        """The names of the links, in the order of the file."""
        return tuple(link.name for link in self.link_infos)

    @functools.cached_property
    def _links_by_name(self) -> Mapping[str, LinkInfo]:
        return {link.name: link for link in self.link_infos}

    @functools.cached_property
    def moveit_folders(self) -> tuple[Path, ...]:
        """Its own package and those of MoveIt around it; all packages are looked at."""
        own = [f for f in self.file.parents if (f / "package.xml").is_file()][:1]
        known = PackageFinder(self.file, self.package_paths).known()
        return (*own, *(folder for name, folder in known if _MOVEIT in name))

    @functools.cached_property
    def movable_joints(self) -> tuple[JointInfo, ...]:
        """The joints with a degree of freedom, in the order of the file."""
        return tuple(joint for joint in self.joints if joint.is_movable)

    @property
    def independent_joints(self) -> tuple[JointInfo, ...]:
        """The movable joints that follow no other."""
        return tuple(joint for joint in self.movable_joints if joint.mimic is None)

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


def write_urdf(
    name: str, links: Iterable[LinkInfo], joints: Iterable[JointInfo]
) -> str:
    """Return a URDF as Drake takes it."""
    parts = *map(write_link, links), *map(write_joint, joints)
    return f"<robot name={quote_attribute(name)}>{''.join(parts)}</robot>"


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
        x, y, z, roll, pitch, yaw = numbers
        origin = Origin((x, y, z), (roll, pitch, yaw))
        added += write_link(LinkInfo(name))
        added += write_joint(JointInfo(joint, "fixed", parent, name, origin=origin))
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
    joints = tuple(
        read_joint(element, file, report) for element in root.iterfind("joint")
    )
    check_structure(links, joints, file)
    report_degrees(joints, file, report)
    plugins = read_gazebo_plugins(root)
    followers = add_mimics(joints, plugins, report, file)
    joints = drop_bad_mimics(followers, file, report)
    names = [joint.name for joint in joints]
    hardware = read_hardware(root, names, report, file)
    joints = find_mimics(joints, hardware, report, file)
    joints = fit_mimic_limits(joints, file, report)
    report_hardware(hardware, report, file)
    sensors, seeing = _read_sensors(root, links, joints, hardware, report, file)
    report_unread(root, file, report)
    shaped = read_links(
        root,
        file,
        packages,
        report,
        extent=extent(joints),
        decompose=decompose,
        max_faces=max_faces,
    )
    robot = RobotDescription(
        name=root.get("name") or file.name.partition(".")[0],
        file=file,
        link_infos=repair_inertials(shaped, joints, report, file),
        joints=joints,
        hardware=hardware,
        gazebo_plugins=plugins,
        joint_plugins=read_joint_plugins(plugins, names, report, file),
        gazebo_sensors=sensors,
        perception_sensors=seeing,
        friction=read_friction(root, links),
        undivided=frozenset(
            link.get("name", "")
            for link in root.iterfind("link")
            if len(link.findall("collision")) == 1
        ),
        mesh_names=_mesh_names(root),
        source=text,
        package_paths=packages.package_paths,
    )
    _report_loose(robot, report)
    return robot


# Elements by their path below <robot>, with the attributes that are read.
_READ: Mapping[str, tuple[str, ...]] = {
    "material": ("name",),
    "material/color": ("rgba",),
    "material/texture": ("filename",),
    "link": ("name",),
    "link/inertial": (),
    "link/inertial/origin": ("xyz", "rpy"),
    "link/inertial/mass": ("value",),
    "link/inertial/inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    **{
        f"link/{tag}{path}": attributes
        for tag in ("visual", "collision")
        for path, attributes in {
            "": ("name",),
            "/origin": ("xyz", "rpy"),
            "/geometry": (),
            **{f"/geometry/{kind}": tuple(sizes) for kind, sizes in SIZES.items()},
            "/geometry/mesh": ("filename", "scale"),
        }.items()
    },
    "link/visual/material": ("name",),
    "link/visual/material/color": ("rgba",),
    "link/visual/material/texture": ("filename",),
    "joint": ("name", "type"),
    "joint/origin": ("xyz", "rpy"),
    "joint/parent": ("link",),
    "joint/child": ("link",),
    "joint/axis": ("xyz",),
    "joint/limit": ("lower", "upper", "effort", "velocity"),
    "joint/dynamics": ("damping", "friction"),
    "joint/mimic": ("joint", "multiplier", "offset"),
}

# Read elsewhere, and reported there.
_OTHERS = ("ros2_control", "gazebo", "joint/safety_controller")

# What is done about tags that mean something to others.
_MEANINGS = {
    "transmission": "actuators come from <ros2_control>",
    "joint/calibration": "joints are calibrated",
    "link/collision_checking": "collisions come from <collision>",
}

_NOTHING = "it has no effect"


class _Ignored(NamedTuple):
    """A kind of thing that isn't read."""

    # Path of a tag, and an attribute or "".
    path: str
    attribute: str

    # What it seems to be meant for, and the link or joint that it is in; else "".
    meant: str = ""
    where: str = ""


def report_unread(root: ET.Element, file: Path, report: LoadReport) -> None:
    """Record each kind of thing in a URDF that isn't read, once."""
    found: collections.Counter[_Ignored] = collections.Counter()
    for child in root:
        name = child.get("name")
        where = "" if name is None else f"{child.tag} {name!r}"
        for ignored in _unread(child, ""):
            found[ignored._replace(where=where) if ignored.meant else ignored] += 1
    for (path, attribute, meant, where), count in found.items():
        what = f"<{path} {attribute}=...>" if attribute else f"<{path}>"
        what += "" if count == 1 else f", {count} times"
        what += f"; did you mean {meant}?" if meant else ""
        severity: Severity = "warning" if meant else "info"
        done = (_MEANINGS.get(path) if not attribute else None) or _NOTHING
        report.add(severity, "ignored", what, done, where=where, file=file)


def _unread(element: ET.Element, above: str) -> Iterator[_Ignored]:
    """Yield what isn't read in an element."""
    if not isinstance(element.tag, str):  # A comment.
        return
    path = f"{above}/{element.tag}" if above else element.tag
    is_shape = above.endswith("/geometry")  # One that is unknown is a repair.
    if path not in _READ and not is_shape:
        if path not in _OTHERS:
            yield _Ignored(path, "", _meant_tag(path))
        return
    for name in element.attrib:
        # Not of another name space.
        if path in _READ and name not in _READ[path] and not name.startswith("{"):
            lacking = [other for other in _READ[path] if other not in element.attrib]
            close = find_close(name, lacking, MISSPELT)
            yield _Ignored(path, name, repr(close) if close else "")
    for child in element:
        yield from _unread(child, path)


@functools.cache
def _meant_tag(path: str) -> str:
    """Return the tag that one that isn't read seems to be meant for, or ""."""
    above, _, tag = path.rpartition("/")
    known = [each.rpartition("/") for each in (*_READ, *_OTHERS, *_MEANINGS)]
    tags = [other for parent, _, other in known if parent == above]
    close = find_close(tag, tags, MISSPELT)
    return f"<{close}>" if close and path not in _MEANINGS else ""


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
    sensors = read_gazebo_sensors(root, joints, report, file)
    components = {sensor.name for block in hardware for sensor in block.sensors}
    plain = [sensor for sensor in sensors if sensor.type in (CONTACT, IMU)]
    measuring = components.union(sensor.name for sensor in plain)
    systems = {sensor.type for sensor in plain}
    seeing: tuple[PerceptionSensor, ...] = ()
    realsenses = (p for p in read_gazebo_plugins(root) if p.is_realsense)
    if len(plain) < len(sensors) or any(realsenses):
        # Not at the top: its import takes 11 ms, and few robots have such a tag.
        from arm_drake.description import perception_sensors as perception

        seeing = perception.read_perception_sensors(root, links, joints, report, file)
        measuring.update(sensor.group or sensor.name for sensor in seeing)
        # Of those that are left out there is a line already.
        measuring.update(s.name for s in sensors if s.type in perception.TYPES)
        systems.update({"sensors"} if seeing else ())
        report_unsimulated(sensors, components, perception.TYPES, report, file)
    report_gazebo(
        root, report, file, sensors=measuring, systems=systems, sees=bool(seeing)
    )
    return sensors, seeing


def _mesh_names(root: ET.Element) -> tuple[str, ...]:
    """Return the files of meshes and textures, each once."""
    meshes = [
        mesh
        for tag in ("visual", "collision")
        for mesh in root.iterfind(f"link/{tag}/geometry/mesh")
    ]
    names = (e.get("filename", "") for e in (*meshes, *root.iter("texture")))
    return tuple(dict.fromkeys(filter(None, names)))


def _report_loose(robot: RobotDescription, report: LoadReport) -> None:
    """Record several roots, which are fixed to the world."""
    is_attached = any(joint.parent == WORLD for joint in robot.joints)
    if len(robot.roots) + (WORLD in robot.links or is_attached) > 1:
        what = f"links {sorted(robot.roots)} are attached to nothing"
        done = "they are fixed to the world"
        report.add("warning", "repair", what, done, file=robot.file)


def total_mass(description: RobotDescription) -> float:
    """Return the mass of all links together [kg], as it is simulated."""
    return math.fsum(link.mass for link in description.link_infos)


def reach(description: RobotDescription) -> float:
    """Return how far the last link can be from the first movable joint [m].

    That is the length of the longest stretched chain of links; a prismatic joint adds
    its travel. Limits and geometry may allow less.
    """
    children, longest = joints_on_links(description.joints), 0.0
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
