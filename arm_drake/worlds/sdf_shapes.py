"""Visuals and collisions of SDF files, as Drake takes them."""

import copy
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from arm_drake.description.meshes.conversion import (
    Scale,
    convert_collision,
    convert_visual,
)
from arm_drake.description.values import parse_number
from arm_drake.plant.ground import GROUND_FRICTION
from arm_drake.worlds.sdf_colors import COLORS
from arm_drake.worlds.sdf_files import SdfFile, text_of
from arm_drake.worlds.sdf_models_part import ModelFinder
from arm_drake.worlds.sdf_notes import Notes

# Geometries that Drake knows, beside meshes and planes.
_PRIMITIVES = ("box", "sphere", "cylinder", "capsule", "ellipsoid")

# Thickness of what collides as a plane, and of what is seen as one [m].
_THICKNESS = {"collision": 1.0, "visual": 1e-3}

# Size of a plane that doesn't say it [m].
_PLANE_SIZE = (100.0, 100.0)

# Sizes of other shapes [m].
_SMALLEST, _LARGEST = 1e-9, 1e6

# What is rougher than the built-in ground is as rough as that: Gazebo takes the smaller
# coefficient of two surfaces, Drake 2ab/(a + b), which a very rough ground doubles.
_LARGEST_FRICTION = GROUND_FRICTION


def pose_of(element: ET.Element, file: SdfFile) -> RigidTransform:
    """Return the pose of an element, the identity without one.

    Raises:
        InputError: If it is malformed.
    """
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return RigidTransform()
    found = [parse_number(word) for word in (pose.text or "").split()]
    values = [x for x in found if x is not None and np.isfinite(x)]
    is_quaternion = pose.get("rotation_format") == "quat_xyzw"
    if len(values) != len(found) or len(values) != (7 if is_quaternion else 6):
        count = "7 numbers" if is_quaternion else "x y z roll pitch yaw"
        raise file.error(f"<pose>: expected {count}, got {pose.text!r}", pose)
    if is_quaternion:
        x, y, z, w = values[3:]
        norm = float(np.linalg.norm(values[3:]))
        if norm == 0.0:
            raise file.error("<pose>: a quaternion of length 0", pose)
        quaternion = Quaternion(*(np.array([w, x, y, z]) / norm))
        return RigidTransform(RotationMatrix(quaternion), np.array(values[:3]))
    angles = np.array(values[3:])
    if pose.get("degrees", "") in ("true", "1"):
        angles = np.deg2rad(angles)
    return RigidTransform(RollPitchYaw(angles), np.array(values[:3]))


def is_flat(X: RigidTransform) -> bool:
    """Return whether the plane z = 0 of a frame is that of its parent."""
    upwards = X.rotation().col(2)
    return bool(X.translation()[2] == 0.0 and np.allclose(upwards, [0.0, 0.0, 1.0]))


def clean_shapes(
    link: ET.Element,
    file: SdfFile,
    models: ModelFinder,
    notes: Notes,
    *,
    where: str,
    ground: str | None,
) -> None:
    """Make every `<visual>` and `<collision>` of a link fit for Drake, or remove it.

    Args:
        link: The link, changed in place.
        file: File that it is in.
        models: What finds meshes.
        notes: Where every change is recorded.
        where: What messages call the link.
        ground: What a plane is called that collides; its visual isn't drawn. None:
            planes of the link aren't the ground.

    Raises:
        InputError: If a number is malformed.
    """
    for index, element in enumerate(list(link)):
        if element.tag in ("visual", "collision"):
            element.attrib.setdefault("name", f"{element.tag}_{index}")
            place = f"{where}, {element.tag} {element.get('name')!r}"
            shape = _Shape(element, file, models, notes, place, ground)
            at = list(link).index(element)
            link.remove(element)
            for part in reversed(shape.clean()):
                link.insert(at, part)


class _Shape:
    """One `<visual>` or `<collision>` on its way to Drake."""

    def __init__(
        self,
        element: ET.Element,
        file: SdfFile,
        models: ModelFinder,
        notes: Notes,
        where: str,
        ground: str | None,
    ) -> None:
        self._element = element
        self._file = file
        self._models = models
        self._notes = notes
        self._where = where
        self._ground = ground

    def clean(self) -> list[ET.Element]:
        """Return what takes its place: elements that Drake takes, or none."""
        geometry = self._element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if geometry is None or shape is None or shape.tag == "empty":
            return []
        color = self._paint() if self._element.tag == "visual" else None
        self._limit_friction()
        if shape.tag == "mesh":
            return self._convert_mesh(shape, color)
        if shape.tag == "plane":
            return self._thicken(geometry, shape)
        if shape.tag not in _PRIMITIVES:
            return self._drop(f"a <{shape.tag}>, which Drake doesn't have")
        for child in shape:
            sizes = [parse_number(word) for word in (child.text or "").split()]
            if not all(x is not None and _SMALLEST <= x <= _LARGEST for x in sizes):
                bounds = f"{_SMALLEST:g} m to {_LARGEST:g} m"
                return self._drop(f"a <{shape.tag}> with a size that isn't {bounds}")
        return [self._element]

    def _drop(self, what: str) -> list[ET.Element]:
        is_visual = self._element.tag == "visual"
        self._notes.add(
            "warning" if is_visual else "error",
            "unsupported",
            what,
            "it isn't drawn" if is_visual else "nothing collides with it",
            file=self._file,
            element=self._element,
            where=self._where,
        )
        return []

    def _say(self, what: str, done: str) -> None:
        self._notes.add(
            "info",
            "unsupported",
            what,
            done,
            file=self._file,
            element=self._element,
            where=self._where,
        )

    def _paint(self) -> tuple[float, float, float, float] | None:
        """Leave nothing but a diffuse colour of the material; return it."""
        color = None
        for material in self._element.findall("material"):
            script = (material.findtext("script/name") or "").strip()
            text = text_of(material, "diffuse") or text_of(material, "ambient")
            if not text and script:
                text = COLORS.get(script.rpartition("/")[2], "")
                if not text:
                    self._say(f"material {script!r}", "it is drawn grey")
            if material.find(".//albedo_map") is not None:
                self._say("a texture", "drawn without it")
            self._element.remove(material)
            numbers = [parse_number(word) for word in text.split()]
            values = [float(np.clip(x, 0.0, 1.0)) for x in numbers if x is not None]
            if len(values) == len(numbers) and len(values) in (3, 4):
                red, green, blue, alpha = [*values, 1.0][:4]
                color = (red, green, blue, alpha)
                painted = ET.SubElement(self._element, "material")
                diffuse = ET.SubElement(painted, "diffuse")
                diffuse.text = " ".join(map(repr, color))
            elif text:
                problem = f"expected red green blue alpha, got {text!r}"
                raise self._file.error(f"<material>: {problem}", material)
        return color

    def _limit_friction(self) -> None:
        for ode in self._element.iterfind("surface/friction/ode"):
            given = [parse_number(text_of(ode, tag)) for tag in ("mu", "mu2")]
            found = [mu for mu in given if mu is not None and mu >= 0.0]
            for child in list(ode):
                ode.remove(child)
            least = min([*found, _LARGEST_FRICTION])
            for tag in ("mu", "mu2"):
                ET.SubElement(ode, tag).text = repr(least)
            if any(mu != least for mu in found):
                what = f"friction {' and '.join(f'{mu:g}' for mu in found)}"
                self._say(what, f"{least:g} is used")

    def _thicken(self, geometry: ET.Element, plane: ET.Element) -> list[ET.Element]:
        """Make a plane a box below it, for Drake warns about half spaces."""
        thickness = _THICKNESS[self._element.tag]
        normal = np.array(self._numbers(plane, "normal", (0.0, 0.0, 1.0)))
        size = self._numbers(plane, "size", _PLANE_SIZE)
        if not np.any(normal) or not min(size) > 0.0:
            return self._drop("a <plane> without a direction or a size")
        X_LP = pose_of(self._element, self._file)
        if normal[0] != 0.0 or normal[1] != 0.0 or normal[2] < 0.0:
            turn = RotationMatrix.MakeFromOneVector(normal, 2)
            X_LP = X_LP @ RigidTransform(turn, np.zeros(3))
        if self._ground is not None and is_flat(X_LP):
            if self._element.tag == "visual":
                self._say("the plane of the ground", "it isn't drawn")
                return []
            self._element.set("name", self._ground)
        X_LG = X_LP @ RigidTransform([0.0, 0.0, -thickness / 2.0])
        geometry.remove(plane)
        box = ET.SubElement(ET.SubElement(geometry, "box"), "size")
        box.text = f"{size[0]!r} {size[1]!r} {thickness!r}"
        pose = self._element.find("pose")
        if pose is None:
            pose = ET.SubElement(self._element, "pose")
        for name in ("degrees", "rotation_format"):
            pose.attrib.pop(name, None)
        angles = RollPitchYaw(X_LG.rotation()).vector()
        values = [*X_LG.translation().tolist(), *angles.tolist()]
        pose.text = " ".join(map(repr, values))
        return [self._element]

    def _numbers(
        self, parent: ET.Element, tag: str, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        text = text_of(parent, tag)
        if not text:
            return default
        found = [parse_number(word) for word in text.split()]
        values = tuple(x for x in found if x is not None and np.isfinite(x))
        if len(values) != len(found) or len(values) != len(default):
            problem = f"expected {len(default)} numbers, got {text!r}"
            raise self._file.error(f"<{tag}>: {problem}", parent.find(tag))
        return values

    def _convert_mesh(
        self, mesh: ET.Element, color: tuple[float, float, float, float] | None
    ) -> list[ET.Element]:
        uri = text_of(mesh, "uri")
        path = self._models.find_file(uri, self._file.path.parent)
        if path is None:
            return self._drop(f"no mesh file {uri!r}")
        x, y, z = self._numbers(mesh, "scale", (1.0, 1.0, 1.0))
        if mesh.find("submesh") is not None:
            self._say("a <submesh>", "all of the file is taken")
        for child in list(mesh):
            mesh.remove(child)
        target = ET.SubElement(mesh, "uri")
        parts = self._convert(path, (x, y, z), color)
        elements = []
        for number, part in enumerate(parts, start=1):
            target.text = part.as_uri()
            element = copy.deepcopy(self._element)
            if number > 1:
                element.set("name", f"{element.get('name')}_{number}")
            elements.append(element)
        return elements

    def _convert(
        self,
        path: Path,
        scale: Scale,
        color: tuple[float, float, float, float] | None,
    ) -> tuple[Path, ...]:
        report, where, file = self._notes.report, self._where, self._file.path
        if self._element.tag == "collision":
            return convert_collision(
                path, scale, report, where=where, file=file, by_piece=True
            )
        for material in self._element.findall("material"):
            self._element.remove(material)  # Drake refuses it beside those of a glTF.
        drawn = convert_visual(path, scale, report, where=where, file=file, color=color)
        return () if drawn is None else (drawn,)
