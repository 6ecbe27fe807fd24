"""A robot that an SDF model describes, as the text of a URDF.

Gazebo takes robots as SDF models, too. All that reads descriptions here reads URDF, so
a model is written as one: links and joints with their frames, and what URDF has no
words for, plugins, sensors and friction, in the `<gazebo>` tags in which URDF files
have it.

In URDF the frame of a link is that of the joint which moves it. So a link's content is
shifted where an SDF file has them apart. Below fixed joints the link's own frame stays.

Sources: SDFormat, sdf/1.11/{model,link,joint,inertial,pose}.sdf, and
http://sdformat.org/tutorials?tut=pose_frame_semantics.
"""

import copy
import functools
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.elements import (
    attribute,
    parse_floats,
    parse_number,
    parse_sdf_bool,
    parse_sdf_pose,
    parse_xml,
    text_of,
)
from arm_drake.description.gazebo import read_plugins
from arm_drake.description.joints import WORLD
from arm_drake.description.links import SIZES, Origin, Transform
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import DescriptionError, suggest
from arm_drake.importing import dataclass

# Finds the file that an address in a model names, from a folder; None if there is none.
FileFinder = Callable[[str, Path], Path | None]

_MODEL = "__model__"

# The name of the topmost element, behind a declaration and comments.
_FIRST_TAG = re.compile(r"\ufeff?\s*(?:(?><\?.*?\?>|<!--.*?-->)\s*)*+<(\w+)", re.DOTALL)

# SDF's joints that move about or along one axis, as URDF's.
_AXES = {"revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic"}

# Positions from which on SDF has no limit [rad] or [m].
_NO_LIMIT = 1e15

# The frame of axes before version 1.5 of SDF was the model's.
_AXES_IN_JOINT = (1, 5)

# Moments of inertia that SDF has where none are given [kg·m^2].
_MOMENTS = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}

# What has a frame in a model, and what of it a joint may connect.
_HOLDERS = ("link", "joint", "frame")
_ENDS = ("link", "frame")

# Poses that may be relative to one another; what finds them is recursive.
_MOST_RELATIVE = 300

# What links and models have that is read, or stands in a file for other reasons.
_OF_LINKS = {"pose", "inertial", "visual", "collision", "sensor", "plugin"}
_OF_LINKS |= {"must_be_base_link", "velocity_decay", "enable_wind"}
_OF_MODELS = {"link", "joint", "frame", "plugin", "pose", "static", "self_collide"}
_OF_MODELS |= {"allow_auto_disable", "enable_wind"}


def is_sdf(text: str) -> bool:
    """Return whether the text of a description is SDF."""
    first = _FIRST_TAG.match(text)
    return first is not None and first[1] == "sdf"


def moves_by_itself(text: str, file: Path) -> bool:
    """Return whether an SDF model has plugins that move it, or report its joints."""
    model = parse_xml(text, file).find("model")
    return model is not None and any(
        plugin.kind != "other" for plugin in read_plugins(model, "")
    )


def convert_sdf(text: str, file: Path, report: LoadReport, find: FileFinder) -> str:
    """Return an SDF model as the text of a URDF.

    Raises:
        DescriptionError: If there is no model, or a frame isn't there.
    """
    root = parse_xml(text, file)
    model = root.find("model")
    if model is None:
        holder = root.find("world")
        what = "a robot's <model>" if holder is None else "a robot's <model>, got a"
        what += "" if holder is None else " <world>, which --world takes"
        raise DescriptionError(f"<sdf>: expected {what}", file=file)
    version = attribute(root, "version")
    if not re.fullmatch(r"1\.[0-9]{1,3}", version, re.ASCII):
        found = f"the version {version!r}" if version else "no version"
        problem = f'<sdf> has {found}; expected such as version="1.9"'
        raise DescriptionError(problem, file=file)
    if model.find("link") is None:
        what = f"model {attribute(model, 'name')!r} has no <link> of its own"
        raise DescriptionError(f"{what}; expected a robot's links", file=file)
    is_old = tuple(map(int, version.split("."))) < _AXES_IN_JOINT
    names = [attribute(each, "name") for each in root.iterfind("model")]
    if len(names) > 1:
        what = f"models {', '.join(map(repr, names[1:]))}"
        done = f"the file's first, {names[0]!r}, is the robot"
        report.add("warning", "ignored", what, done, file=file)
    return _Model(model, file, report, find, has_axes_in_model=is_old).write()


def _origin(X: Transform) -> Origin:
    """Return a pose as URDF writes it."""
    R = X.rotation
    pitch = math.atan2(-R[2, 0], math.hypot(R[2, 1], R[2, 2]))
    if abs(R[2, 0]) < 1.0 - 1e-12:
        roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    else:
        roll, yaw = 0.0, math.atan2(-R[0, 1], R[1, 1])
    x, y, z = X.position
    # Digits beyond those of an angle's cosine are noise, and negative zeros confuse.
    numbers = [round(float(n), 12) + 0.0 for n in (x, y, z, roll, pitch, yaw)]
    return Origin(tuple(numbers[:3]), tuple(numbers[3:]))  # type: ignore[arg-type]


def _words(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.15g}" for number in numbers)


@dataclass(frozen=True, eq=False)
class _Model:
    """A `<model>` on its way to a URDF."""

    model: ET.Element
    file: Path
    report: LoadReport
    find: FileFinder
    has_axes_in_model: bool

    def write(self) -> str:
        """Return the URDF."""
        name = attribute(self.model, "name") or "robot"
        robot = ET.Element("robot", name=name)
        for child in self.model:
            if child.tag not in _OF_MODELS:
                what, done = f"<{child.tag}> in the model", "it is left out"
                self._note("error", "unsupported", what, done, child)
        joints = self.model.findall("joint")
        if any(self._end(joint, "parent") == WORLD for joint in joints):
            ET.SubElement(robot, "link", name=WORLD)
        carriers = self._carriers
        self._report_roots(carriers)
        for link in self.model.findall("link"):
            self._write_link(robot, link, carriers.get(attribute(link, "name")))
        for joint in joints:
            self._write_joint(robot, joint)
        for plugin in self.model.findall("plugin"):
            ET.SubElement(robot, "gazebo").append(copy.deepcopy(plugin))
        return ET.tostring(robot, encoding="unicode")

    def _note(
        self, severity: Severity, kind: Kind, what: str, done: str, element: ET.Element
    ) -> None:
        name = attribute(element, "name")
        where = f"{element.tag} {name!r}" if name else ""
        self.report.add(severity, kind, what, done, where=where, file=self.file)

    def _report_roots(self, carriers: Mapping[str, ET.Element]) -> None:
        """Record what no joint carries and isn't where the model is: it starts at 0."""
        links = [
            link
            for link in self.model.findall("link")
            if attribute(link, "name") not in carriers
        ]
        for link in links:
            origin = _origin(self._frame(attribute(link, "name")))
            if not any((*origin.xyz, *origin.rpy)):
                continue
            place = f"at {_words((*origin.xyz, *origin.rpy))} in the model"
            if len(links) == 1:
                what = f"the base is {place}"
                done = "a pose of the robot is that of the base, not of the model"
                self._note("info", "repair", what, done, link)
            else:
                what = f"{place}, where no joint holds it"
                done = "it is put where the robot's pose is"
                self._note("warning", "unsupported", what, done, link)

    # Frames.

    @functools.cached_property
    def _holders(self) -> dict[str, ET.Element]:
        """The links, joints and frames by name."""
        return {attribute(e, "name"): e for e in self.model if e.tag in _HOLDERS}

    @functools.cached_property
    def _poses(self) -> dict[str, Transform]:
        """Poses of them in the model that are known already."""
        return {}

    @functools.cached_property
    def _carriers(self) -> dict[str, ET.Element]:
        """The joints by the links that they carry."""
        return {self._end(j, "child"): j for j in self.model.iterfind("joint")}

    def _error(self, problem: str, where: str = "") -> DescriptionError:
        where = where or f"model {attribute(self.model, 'name')!r}"
        return DescriptionError(problem, file=self.file, where=where)

    def _guess(self, name: str, tags: Sequence[str]) -> str:
        """Return an unknown name, with a suggestion."""
        if "::" in name:
            return f"{name!r}: models in the model and includes are left out"
        known = [n for n, e in self._holders.items() if e.tag in tags]
        return f"{name!r}; {suggest(name, known)}"

    def _end(self, joint: ET.Element, tag: str) -> str:
        """Return the parent or the child of a joint: a link, or that of a frame."""
        where = f"joint {attribute(joint, 'name')!r}"
        name, passed = text_of(joint, tag), set[str]()
        while name != WORLD:
            if name in passed:
                raise self._error(f"frame {name!r} is attached to itself", where)
            passed.add(name)
            element = self._holders.get(name)
            if name == _MODEL:
                links = [attribute(e, "name") for e in self.model.iterfind("link")]
                name = attribute(self.model, "canonical_link") or next(iter(links), "")
            elif element is None:
                problem = f"no link or frame {self._guess(name, _ENDS)}"
                raise self._error(problem, where)
            elif element.tag == "frame":
                name = attribute(element, "attached_to") or _MODEL
            elif element.tag == "joint":
                name = text_of(element, "child")
            else:
                break
        return name

    def _frame(self, name: str, passed: tuple[str, ...] = ()) -> Transform:
        """Return the pose of a link, joint or frame in the model."""
        if name in ("", _MODEL, WORLD):
            return Transform()
        if name in self._poses:
            return self._poses[name]
        if name not in self._holders:
            raise self._error(f"no link, joint or frame {self._guess(name, _HOLDERS)}")
        if name in passed:
            raise self._error(f"the pose of {name!r} is relative to itself")
        if len(passed) >= _MOST_RELATIVE:
            problem = f"more than {_MOST_RELATIVE} poses are relative to one another"
            raise self._error(f"{problem}, up to that of {name!r}; no SDF needs that")
        element = self._holders[name]
        default = {
            "joint": text_of(element, "child"),
            "frame": attribute(element, "attached_to"),
        }.get(element.tag, _MODEL)
        self._poses[name] = self._placed(element, default, (*passed, name))
        return self._poses[name]

    def _placed(
        self, element: ET.Element, default: str, passed: tuple[str, ...] = ()
    ) -> Transform:
        """Return the pose of an element in the model; without a word in `default`."""
        pose = element.find("pose")
        other = "" if pose is None else attribute(pose, "relative_to")
        return self._frame(other or default, passed) @ self._pose(element)

    def _pose(self, element: ET.Element) -> Transform:
        """Return the pose that an element states."""
        pose = element.find("pose")
        if pose is None or not text_of(pose):
            return Transform()
        numbers = parse_sdf_pose(pose)
        if numbers is None:
            rotation = "roll, pitch, yaw"
            if attribute(pose, "rotation_format") == "quat_xyzw":
                rotation = "a quaternion x, y, z, w"
            what = f"pose: expected x, y, z and {rotation}, got {text_of(pose)!r}"
            self._note("error", "invalid", what, "taken as not given", element)
            return Transform()
        x, y, z, *angles = numbers
        if len(angles) == 4:
            return Transform(_rotation_of(np.array(angles)), np.array([x, y, z]))
        roll, pitch, yaw = angles
        return Origin((x, y, z), (roll, pitch, yaw)).transform

    def _link_frame(self, name: str) -> Transform:
        """Return the frame that a link has in the URDF, in the model."""
        joint = self._carriers.get(name)
        if joint is not None and self._type(joint) != "fixed":
            return self._frame(attribute(joint, "name"))
        return self._frame(name)

    # Links.

    def _write_link(
        self, robot: ET.Element, link: ET.Element, carrier: ET.Element | None
    ) -> None:
        name = attribute(link, "name")
        written = ET.SubElement(robot, "link", name=name)
        X_UM = self._link_frame(name).inverse()
        inertial = link.find("inertial")
        self._write_inertial(written, inertial, link, X_UM)
        for shape in link:
            if shape.tag in ("visual", "collision"):
                X_US = X_UM @ self._placed(shape, name)
                self._write_shape(written, link, shape, X_US)
        gazebo = ET.Element("gazebo", reference=name)
        is_ball = carrier is not None and attribute(carrier, "type") == "ball"
        mu = "0" if is_ball else self._friction(link)
        if mu:
            ET.SubElement(gazebo, "mu1").text = mu
        for child in link:
            if child.tag in ("sensor", "plugin"):
                copied = copy.deepcopy(child)
                if child.tag == "sensor":
                    self._place_sensor(copied, X_UM @ self._placed(child, name))
                gazebo.append(copied)
            elif child.tag not in _OF_LINKS and not _is_usual(child):
                gazebo.append(copy.deepcopy(child))
        if len(gazebo):
            robot.append(gazebo)

    def _write_inertial(
        self,
        written: ET.Element,
        inertial: ET.Element | None,
        link: ET.Element,
        X_UM: Transform,
    ) -> None:
        """Write mass and inertia; what isn't said is 1 kg and 1 kg·m^2, as in SDF."""
        X = X_UM @ self._frame(attribute(link, "name"))
        mass = text_of(inertial, "mass") or "1"
        if inertial is not None:
            X = X_UM @ self._placed(inertial, attribute(link, "name"))
            if parse_sdf_bool(attribute(inertial, "auto")):
                what, done = "<inertial auto>", f"its mass is {mass} kg"
                self._note("warning", "unsupported", what, done, link)
        moments = {
            key: text_of(inertial, f"inertia/{key}") or usual
            for key, usual in _MOMENTS.items()
        }
        part = ET.SubElement(written, "inertial")
        _write_origin(part, X)
        ET.SubElement(part, "mass", value=mass)
        ET.SubElement(part, "inertia", moments)

    def _write_shape(
        self, written: ET.Element, link: ET.Element, shape: ET.Element, X: Transform
    ) -> None:
        geometry = shape.find("geometry")
        kind = next(iter(geometry), None) if geometry is not None else None
        if kind is None or kind.tag == "empty":
            return
        if kind.tag not in (*SIZES, "mesh"):
            what = f"geometry <{kind.tag}> of {shape.tag} {attribute(shape, 'name')!r}"
            severity: Severity = "error" if shape.tag == "collision" else "warning"
            self._note(severity, "unsupported", what, "it is left out", link)
            return
        part = ET.SubElement(written, shape.tag, name=attribute(shape, "name"))
        _write_origin(part, X)
        place = ET.SubElement(part, "geometry")
        if kind.tag == "mesh":
            uri, scale = text_of(kind, "uri"), text_of(kind, "scale")
            path = self.find(uri, self.file.parent)
            names = {"filename": uri if path is None else str(path)}
            ET.SubElement(place, "mesh", names | ({"scale": scale} if scale else {}))
        else:
            # SDF writes as elements what are attributes in URDF.
            measures = {tag: text_of(kind, tag) for tag in SIZES[kind.tag]}
            ET.SubElement(place, kind.tag, measures)
        color = text_of(shape, "material/diffuse") or text_of(shape, "material/ambient")
        if shape.tag == "visual" and color:
            words = color.split()
            material = ET.SubElement(part, "material", name=f"color {' '.join(words)}")
            rgba = " ".join([*words, "1"][:4])
            ET.SubElement(material, "color", rgba=rgba)

    def _friction(self, link: ET.Element) -> str:
        """Return the friction of a link: that of the first of its shapes with one."""
        path = "collision/surface/friction/ode/mu"
        mu = self._number(link, link.find(path), "friction mu")
        return "" if mu is None else _words((mu,))

    def _place_sensor(self, sensor: ET.Element, X: Transform) -> None:
        for pose in sensor.findall("pose"):
            sensor.remove(pose)
        origin = _origin(X)
        if any((*origin.xyz, *origin.rpy)):
            text = _words((*origin.xyz, *origin.rpy))
            ET.SubElement(sensor, "pose").text = text

    # Joints.

    def _type(self, joint: ET.Element) -> str:
        """Return the type that a joint has in the URDF."""
        return _AXES.get(attribute(joint, "type"), "fixed")

    def _write_joint(self, robot: ET.Element, joint: ET.Element) -> None:
        name, sort = attribute(joint, "name"), attribute(joint, "type")
        parent, child = self._end(joint, "parent"), self._end(joint, "child")
        if sort not in (*_AXES, "fixed"):
            done = "the joint is fixed"
            if sort == "ball":
                done += ", and its link slides without friction, as a ball rolls"
            what = f"a joint of type {sort!r}"
            severity: Severity = "info" if sort == "ball" else "warning"
            self._note(severity, "unsupported", what, done, joint)
        written = ET.SubElement(robot, "joint", name=name, type=self._type(joint))
        X_PC = self._link_frame(parent).inverse() @ self._link_frame(child)
        _write_origin(written, X_PC)
        ET.SubElement(written, "parent", link=parent)
        ET.SubElement(written, "child", link=child)
        if written.get("type") == "fixed":
            # What fixed joints hold stays a link of its own, in SDF.
            kept = ET.SubElement(robot, "gazebo", reference=name)
            ET.SubElement(kept, "preserveFixedJoint").text = "true"
        else:
            self._write_axis(written, joint)
        for sensor in joint.findall("sensor"):
            gazebo = ET.SubElement(robot, "gazebo", reference=name)
            gazebo.append(copy.deepcopy(sensor))

    def _write_axis(self, written: ET.Element, joint: ET.Element) -> None:
        axis = joint.find("axis")
        xyz = None if axis is None else axis.find("xyz")
        numbers = parse_floats(text_of(xyz)) or ()
        direction = np.array([0.0, 0.0, 1.0])
        if len(numbers) == 3 and 0.0 < max(map(abs, numbers)) < _NO_LIMIT:
            direction = np.array(numbers) / np.linalg.norm(numbers)
        elif text_of(xyz):
            what = f"axis: expected a direction x, y, z, got {text_of(xyz)!r}"
            self._note("error", "invalid", what, "taken as 0 0 1", joint)
        other = "" if xyz is None else attribute(xyz, "expressed_in")
        is_parents = text_of(axis, "use_parent_model_frame")
        if not other and (self.has_axes_in_model or parse_sdf_bool(is_parents)):
            other = _MODEL
        if other:
            R_MJ = self._frame(attribute(joint, "name")).rotation
            direction = R_MJ.T @ self._frame(other).rotation @ direction
        ET.SubElement(written, "axis", xyz=_words(np.round(direction, 12) + 0.0))
        if axis is None:
            return
        limits = {
            key: self._limit(joint, axis, key)
            for key in ("lower", "upper", "effort", "velocity")
        }
        if written.get("type") == "revolute" and not any(
            math.isfinite(limits[key]) for key in _RANGE
        ):
            written.set("type", "continuous")
        if written.get("type") == "continuous":
            limits = {k: v for k, v in limits.items() if k not in _RANGE}
        if written.get("type") != "continuous" or min(limits.values()) < math.inf:
            limit = {key: _words((value,)) for key, value in limits.items()}
            ET.SubElement(written, "limit", limit)
        if parse_number(text_of(axis, "dynamics/spring_stiffness")):
            what, done = "<spring_stiffness> of the axis", "it is left out"
            self._note("warning", "unsupported", what, done, joint)
        dynamics = {
            key: text
            for key in ("damping", "friction")
            if (text := text_of(axis, f"dynamics/{key}"))
        }
        if dynamics:
            ET.SubElement(written, "dynamics", dynamics)
        self._write_mimic(written, joint, axis)

    def _limit(self, joint: ET.Element, axis: ET.Element, key: str) -> float:
        """Return a limit of a joint; infinity where SDF has none."""
        none = -math.inf if key == "lower" else math.inf
        number = self._number(joint, axis.find(f"limit/{key}"), f"limit {key}")
        if number is None or not abs(number) < _NO_LIMIT:
            return none
        return number if key in _RANGE or number >= 0.0 else none

    def _number(
        self, owner: ET.Element, element: ET.Element | None, name: str
    ) -> float | None:
        """Return the number of an element of a link or joint, or None without one."""
        text = text_of(element)
        number = parse_number(text)
        if number is not None and not math.isnan(number):
            return number
        if text:
            what = f"{name}: expected a number, got {text!r}"
            self._note("error", "invalid", what, "taken as not given", owner)
        return None

    def _write_mimic(
        self, written: ET.Element, joint: ET.Element, axis: ET.Element
    ) -> None:
        """Write that a joint follows another: m (leader - reference) + offset."""
        mimic = axis.find("mimic")
        if mimic is None:
            return
        factor, offset, reference = (
            self._number(joint, mimic.find(tag), f"mimic {tag}") or 0.0
            for tag in ("multiplier", "offset", "reference")
        )
        ET.SubElement(
            written,
            "mimic",
            joint=attribute(mimic, "joint"),
            multiplier=_words((factor,)),
            offset=_words((offset - factor * reference,)),
        )


_RANGE = ("lower", "upper")


def _is_usual(child: ET.Element) -> bool:
    """Return whether an element of a link says what holds without it."""
    usual = {"gravity": True, "kinematic": False, "self_collide": False}
    return child.tag in usual and (
        not text_of(child) or bool(parse_sdf_bool(text_of(child))) == usual[child.tag]
    )


def _rotation_of(quaternion: Array) -> Array:
    """Return the rotation of a quaternion x, y, z, w, shape (3, 3)."""
    x, y, z, w = quaternion / (np.linalg.norm(quaternion) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _write_origin(part: ET.Element, X: Transform) -> None:
    origin = _origin(X)
    if any((*origin.xyz, *origin.rpy)):
        xyz, rpy = _words(origin.xyz), _words(origin.rpy)
        ET.SubElement(part, "origin", xyz=xyz, rpy=rpy)
