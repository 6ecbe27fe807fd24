"""Models and shapes of SDF files, cleaned for Drake: mended, or left out."""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from arm_drake.description.elements import (
    parse_float,
    parse_floats,
    parse_sdf_bool,
    parse_sdf_pose,
    text_of,
)
from arm_drake.description.meshes.conversion import (
    Scale,
    convert_collision,
    convert_visual,
    describe_loss,
)
from arm_drake.description.report import Severity
from arm_drake.errors import InputError
from arm_drake.importing import dataclass
from arm_drake.plant.contact import GROUND, GROUND_FRICTION
from arm_drake.plant.plant import pose_of, transform_of
from arm_drake.worlds.sdf_files import (
    ModelFinder,
    SdfFile,
    place_of,
    read_sdf,
    replace_child,
)

# Stands in an address for the folder of the cleaned files.
FOLDER = "@arm_drake@"

# What has no effect, of models and of links.
_OF_MODELS = ("plugin", "gripper", "sensor")
_OF_LINKS = (
    "sensor",
    "light",
    "plugin",
    "audio_sink",
    "audio_source",
    "battery",
    "particle_emitter",
    "projector",
)

# Models of Fuel and of Classic that are built in.
_SUN, _GROUND_PLANE = "sun", "ground plane"

_GROUND_MODEL = """
<model name="ground_plane"><static>true</static><link name="link">
<collision name="collision"><geometry><plane/></geometry></collision>
<visual name="visual"><geometry><plane/></geometry></visual></link></model>"""

# Red, green, blue and alpha, by the names after `Gazebo/`.
_COLORS = {
    "Black": "0 0 0 1",
    "Blue": "0 0 1 1",
    "BlueTransparent": "0 0 1 0.5",
    "Bricks": "0.6 0.35 0.3 1",
    "CeilingTiled": "0.85 0.85 0.82 1",
    "DarkGrey": "0.175 0.175 0.175 1",
    "DarkYellow": "0.7 0.7 0 1",
    "FlatBlack": "0.1 0.1 0.1 1",
    "Gold": "0.8 0.65 0.1 1",
    "Grass": "0.3 0.5 0.2 1",
    "Green": "0 1 0 1",
    "GreenTransparent": "0 1 0 0.5",
    "Grey": "0.7 0.7 0.7 1",
    "Gray": "0.7 0.7 0.7 1",
    "Indigo": "0.33 0 0.5 1",
    "Orange": "1 0.51 0.03 1",
    "Purple": "1 0 1 1",
    "Red": "1 0 0 1",
    "RedTransparent": "1 0 0 0.5",
    "SkyBlue": "0.13 0.44 0.7 1",
    "Turquoise": "0 1 1 1",
    "White": "1 1 1 1",
    "Wood": "0.6 0.43 0.27 1",
    "WoodFloor": "0.55 0.37 0.22 1",
    "Yellow": "1 1 0 1",
    "ZincYellow": "0.97 0.95 0.2 1",
}

# Geometries that Drake knows, beside meshes and planes.
_PRIMITIVES = ("box", "sphere", "cylinder", "capsule", "ellipsoid")

# Thickness of what collides as a plane, and of what is seen as one [m].
_THICKNESS = {"collision": 1.0, "visual": 1e-3}

# Size of a plane that doesn't say it, and at least of each that collides [m].
_PLANE_SIZE = (100.0, 100.0)

# Pictures that may cover the ground.
TEXTURES = (".png", ".jpg", ".jpeg")

# What the page draws itself, and only cameras see of the file.
_HIDDEN = "drake:illustration_properties"

# Sizes of other shapes [m].
_SMALLEST, _LARGEST = 1e-9, 1e6

# What is rougher than the built-in ground is as rough as that: Gazebo takes the smaller
# coefficient of two surfaces, Drake 2ab/(a + b), which a very rough ground doubles.
_LARGEST_FRICTION = GROUND_FRICTION


@dataclass(frozen=True, eq=False)
class GroundLook:
    """Appearance of the ground of a file, where it is drawn."""

    # Length along its x and y [m]; its frame in the world, in whose plane z = 0 it is.
    size: tuple[float, float]
    X_WG: RigidTransform

    # Red, green, blue and alpha from 0 to 1; None is the page's own colour.
    color: tuple[float, ...] | None = None

    # A picture that covers it once.
    texture: Path | None = None


@dataclass(frozen=True)
class Cleaned:
    """A model or an inclusion on its way to Drake."""

    element: ET.Element
    name: str
    is_static: bool


class Cleaner:
    """Cleans models and inclusions of one world."""

    def __init__(self, file: SdfFile, package_paths: Sequence[Path]) -> None:
        """Create it for the file of a world; `package_paths` are searched first."""
        self._world = file
        self._models = ModelFinder(file.path, package_paths)
        self._missing: dict[str, ET.Element] = {}
        self._names: dict[tuple[Path, bool | None], str] = {}
        self._files: dict[Path, SdfFile] = {}
        # Files whose models are being cleaned, each included by the one before.
        self._open: list[Path] = []

        # Texts of the files that inclusions name, by their names in `FOLDER`.
        self.included: dict[str, str] = {}

        # The look of the ground, of the first plane that is it.
        self.ground: GroundLook | None = None

    def clean(self, element: ET.Element) -> Cleaned | None:
        """Return a model or an inclusion, changed in place for Drake, or None."""
        return self._clean(element, self._world, None, "", 0)

    def report_missing(self) -> None:
        """Record the missing models, in one line."""
        if self._missing:
            names = sorted(self._missing)
            is_one = len(names) == 1
            what = "no model" if is_one else f"{len(names)} models aren't there:"
            what += f" {', '.join(map(repr, names))}"
            done = (
                "left out, nothing is downloaded; --package-path or GAZEBO_MODEL_PATH "
                "can name a folder that holds models"
            )
            first = next(iter(self._missing.values()))
            self._world.note("error", "missing", what, done, first)

    def _clean(
        self,
        element: ET.Element,
        file: SdfFile,
        is_static: bool | None,
        where: str,
        depth: int,
    ) -> Cleaned | None:
        """Clean a model or an inclusion; without `is_static` it decides itself."""
        place = place_of(element, where)
        if element.tag == "include":
            return self._include(element, file, is_static, place, depth)
        own = text_of(element, "static")
        if is_static is None and own:
            is_static = bool(parse_sdf_bool(own))
        replace_child(element, "static", "true" if is_static else None)
        file.remove(element, _OF_MODELS, place)
        is_level = (
            bool(is_static) and depth == 0 and not where and _is_flat(element, file)
        )
        X_WM = _pose_of(element, file) if is_level else None
        has_content = False
        for child in list(element):
            if child.tag == "link":
                has_content = True
                self._clean_link(child, file, place, X_WM)
            elif child.tag == "joint":
                _clean_joint(element, child, is_static=bool(is_static))
            elif child.tag in ("model", "include"):
                at = list(element).index(child)
                element.remove(child)
                inside = self._clean(
                    child, file, True if is_static else None, place, depth
                )
                if inside is not None:
                    has_content = True
                    element.insert(at, inside.element)
        if not has_content:
            return None
        return Cleaned(element, element.get("name", ""), bool(is_static))

    def _clean_link(
        self,
        link: ET.Element,
        file: SdfFile,
        where: str,
        X_WM: RigidTransform | None,
    ) -> None:
        """Make every `<visual>` and `<collision>` fit for Drake, or remove it.

        The plane z = 0 of a model with a pose `X_WM` is the ground.
        """
        place = place_of(link, where)
        file.remove(link, _OF_LINKS, place)
        ground = GROUND if X_WM is not None and _is_flat(link, file) else None
        for index, element in enumerate(list(link)):
            if element.tag in ("visual", "collision"):
                element.attrib.setdefault("name", f"{element.tag}_{index}")
                inside = f"{place}, {element.tag} {element.get('name')!r}"
                shape = _Shape(element, file, self._models, inside, ground)
                texture = shape.find_texture()
                at = list(link).index(element)
                link.remove(element)
                for part in reversed(shape.clean()):
                    link.insert(at, part)
                    is_ground = part.find(_HIDDEN) is not None
                    if is_ground and X_WM is not None and self.ground is None:
                        X_WL = X_WM @ _pose_of(link, file)
                        self.ground = _ground_look(part, file, X_WL, texture)

    def _include(
        self,
        include: ET.Element,
        file: SdfFile,
        is_static: bool | None,
        where: str,
        depth: int,
    ) -> Cleaned | None:
        file.remove(include, ("plugin",), where)
        uri = text_of(include, "uri")
        name = uri.rstrip("/").rpartition("/")[2].replace("%20", " ")
        known = name.lower().replace("_", " ")
        if known == _SUN:
            what, done = "the model of the sun", "the page has its own lamps"
            file.note("info", "ignored", what, done, include, where)
            return None
        if known == _GROUND_PLANE:
            return self._built_in_ground(include, file, depth)
        path = self._models.find_model(uri, file.path.parent)
        if path is None:
            self._missing.setdefault(name or uri, include)
            return None
        own = text_of(include, "static")
        if is_static is None and own:
            is_static = bool(parse_sdf_bool(own))
        try:
            included = self._files.setdefault(path, read_sdf(path, file.report))
            model = included.root.find("model")
            if model is None:
                raise included.error("<sdf> has no <model> to include", included.root)
            if is_static is None:
                is_static = bool(parse_sdf_bool(text_of(model, "static")))
            target = self._keep(included, model, is_static, where, depth)
        except InputError as error:
            what, place, line = error.problem, error.file, error.line
            file.report.add(
                "error", "invalid", what, "left out", where=where, file=place, line=line
            )
            return None
        if target is None:
            return None
        replace_child(include, "uri", f"file://{FOLDER}/{target}")
        replace_child(include, "static", "true" if is_static else None)
        called = text_of(include, "name") or (model.get("name") or "")
        return Cleaned(include, called, bool(is_static))

    def _keep(
        self,
        file: SdfFile,
        model: ET.Element,
        is_static: bool,
        where: str,
        depth: int,
    ) -> str | None:
        """Return the name of the cleaned file of a model, None if nothing is left."""
        key = (file.path, is_static)
        if key not in self._names:
            copied = file.copy(model)
            replace_child(copied, "static")
            if file.path in self._open:
                raise file.error("the model includes itself", model)
            self._open.append(file.path)
            try:
                cleaned = self._clean(copied, file, is_static, where, depth + 1)
            finally:
                self._open.pop()
            name = f"{len(self.included)}.sdf" if cleaned is not None else ""
            self._names[key] = name
            if cleaned is not None:
                root = ET.Element("sdf", file.root.attrib)
                root.append(cleaned.element)
                self.included[name] = ET.tostring(root, encoding="unicode")
        return self._names[key] or None

    def _built_in_ground(
        self, include: ET.Element, file: SdfFile, depth: int
    ) -> Cleaned | None:
        model = ET.fromstring(_GROUND_MODEL)  # noqa: S314  our own text.
        if text_of(include, "name"):
            model.set("name", text_of(include, "name"))
        model.extend(include.findall("pose"))
        return self._clean(model, file, True, "", depth)


def _is_flat(element: ET.Element, file: SdfFile) -> bool:
    """Return whether the plane z = 0 of an element is that of its parent."""
    pose = element.find("pose")
    is_relative = pose is not None and bool(pose.get("relative_to"))
    return not is_relative and _keeps_plane(_pose_of(element, file))


def _ground_look(
    plane: ET.Element, file: SdfFile, X_WL: RigidTransform, texture: Path | None
) -> GroundLook:
    """Return how a cleaned plane of a link looks."""
    if texture is not None and texture.suffix.lower() == ".png":
        material = plane.find("material")
        if material is None:
            material = ET.SubElement(plane, "material")
        ET.SubElement(material, "drake:diffuse_map").text = texture.as_uri()
    size = parse_floats(plane.findtext("geometry/box/size") or "") or _PLANE_SIZE
    color = parse_floats(plane.findtext("material/diffuse") or "")
    X_WG = X_WL @ _pose_of(plane, file)
    x, y, _ = X_WG.translation()
    return GroundLook(
        (size[0], size[1]), RigidTransform(X_WG.rotation(), [x, y, 0.0]), color, texture
    )


def _clean_joint(model: ET.Element, joint: ET.Element, *, is_static: bool) -> None:
    """Remove a joint where nothing moves; else let nothing drive it."""
    if joint.get("type") == "fixed":
        return
    if is_static:
        model.remove(joint)
        return
    for axis in [child for child in joint if child.tag in ("axis", "axis2")]:
        limit = axis.find("limit")
        if limit is None:
            limit = ET.SubElement(axis, "limit")
        # Drake has an actuator for each joint whose effort limit isn't 0.
        replace_child(limit, "effort", "0")


@dataclass(frozen=True, eq=False)
class _Shape:
    """One `<visual>` or `<collision>` on its way to Drake."""

    element: ET.Element
    file: SdfFile
    models: ModelFinder
    where: str

    # Name under which a plane collides that is the ground; the page draws it itself.
    ground: str | None

    def find_texture(self) -> Path | None:
        """Return the picture of a plane that is the ground, and remove it there."""
        path, parent = "material/pbr/metal", self.element.find("material/pbr/metal")
        found = self.element.find(f"{path}/albedo_map")
        is_plane = self.element.find("geometry/plane") is not None
        if self.ground is None or not is_plane or found is None or parent is None:
            return None
        uri = (found.text or "").strip()
        texture = self.models.find_file(uri, self.file.path.parent)
        if texture is None or texture.suffix.lower() not in TEXTURES:
            has_texture = texture is not None
            expected = f"no {' or '.join(TEXTURES)}" if has_texture else "no such file"
            self._say(f"texture {uri!r}: {expected}", "drawn without it", "warning")
            texture = None
        parent.remove(found)
        return texture

    def clean(self) -> list[ET.Element]:
        """Return what takes its place: elements that Drake takes, or none."""
        geometry = self.element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if geometry is None or shape is None or shape.tag == "empty":
            return []
        color = self._paint() if self.element.tag == "visual" else None
        self._limit_friction()
        if shape.tag == "mesh":
            return self._convert_mesh(shape, color)
        if shape.tag == "plane":
            return self._thicken(geometry, shape)
        if shape.tag not in _PRIMITIVES:
            return self._drop(f"a <{shape.tag}>, which Drake doesn't have")
        for child in shape:
            sizes = parse_floats(child.text or "")
            if sizes is None or not all(_SMALLEST <= x <= _LARGEST for x in sizes):
                bounds = f"{_SMALLEST:g} m to {_LARGEST:g} m"
                return self._drop(f"a <{shape.tag}> with a size that isn't {bounds}")
        return [self.element]

    def _drop(self, what: str) -> list[ET.Element]:
        severity, done = describe_loss(is_visual=self.element.tag == "visual")
        self._say(what, done, severity)
        return []

    def _say(self, what: str, done: str, severity: Severity = "info") -> None:
        self.file.note(severity, "unsupported", what, done, self.element, self.where)

    def _paint(self) -> tuple[float, float, float, float] | None:
        """Leave nothing but a diffuse colour of the material; return it."""
        color = None
        for material in self.element.findall("material"):
            script = (material.findtext("script/name") or "").strip()
            text = text_of(material, "diffuse") or text_of(material, "ambient")
            if not text and script:
                text = _COLORS.get(script.rpartition("/")[2], "")
                if not text:
                    self._say(f"material {script!r}", "it is drawn grey")
            if material.find(".//albedo_map") is not None:
                self._say("a texture", "drawn without it")
            self.element.remove(material)
            numbers = [parse_float(word) for word in text.split()]
            values = [float(np.clip(x, 0.0, 1.0)) for x in numbers if x is not None]
            if len(values) == len(numbers) and len(values) in (3, 4):
                red, green, blue, alpha = [*values, 1.0][:4]
                color = (red, green, blue, alpha)
                painted = ET.SubElement(self.element, "material")
                diffuse = ET.SubElement(painted, "diffuse")
                diffuse.text = " ".join(map(repr, color))
            elif text:
                problem = f"expected red green blue alpha, got {text!r}"
                raise self.file.error(f"<material>: {problem}", material)
        return color

    def _limit_friction(self) -> None:
        for ode in self.element.iterfind("surface/friction/ode"):
            coefficients = [parse_float(text_of(ode, tag)) for tag in ("mu", "mu2")]
            found = [mu for mu in coefficients if mu is not None and mu >= 0.0]
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
        thickness = _THICKNESS[self.element.tag]
        normal = np.array(self._numbers(plane, "normal", (0.0, 0.0, 1.0)))
        size = self._numbers(plane, "size", _PLANE_SIZE)
        if self.element.tag == "collision" and min(size) > 0.0:
            # It has no end, says SDFormat's plane_shape.sdf; a size is how it looks.
            size = tuple(map(max, size, _PLANE_SIZE))
        if not np.any(normal) or not min(size) > 0.0:
            return self._drop("a <plane> without a direction or a size")
        X_LP = _pose_of(self.element, self.file)
        if normal[0] != 0.0 or normal[1] != 0.0 or normal[2] < 0.0:
            turn = RotationMatrix.MakeFromOneVector(normal, 2)
            X_LP = X_LP @ RigidTransform(turn, np.zeros(3))
        if self.ground is not None and _keeps_plane(X_LP):
            if self.element.tag == "visual":
                ET.SubElement(self.element, _HIDDEN).set("enabled", "false")
            else:
                self.element.set("name", self.ground)
        X_LG = X_LP @ RigidTransform([0.0, 0.0, -thickness / 2.0])
        geometry.remove(plane)
        box = ET.SubElement(ET.SubElement(geometry, "box"), "size")
        box.text = f"{size[0]!r} {size[1]!r} {thickness!r}"
        pose = self.element.find("pose")
        if pose is None:
            pose = ET.SubElement(self.element, "pose")
        for name in ("degrees", "rotation_format"):
            pose.attrib.pop(name, None)
        pose.text = " ".join(map(repr, pose_of(X_LG)))
        return [self.element]

    def _numbers(
        self, parent: ET.Element, tag: str, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        text = text_of(parent, tag)
        if not text:
            return default
        values = parse_floats(text)
        if values is None or len(values) != len(default):
            problem = f"expected {len(default)} numbers, got {text!r}"
            raise self.file.error(f"<{tag}>: {problem}", parent.find(tag))
        return values

    def _convert_mesh(
        self, mesh: ET.Element, color: tuple[float, float, float, float] | None
    ) -> list[ET.Element]:
        uri = text_of(mesh, "uri")
        path = self.models.find_file(uri, self.file.path.parent)
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
            element = copy.deepcopy(self.element)
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
        report, where, file = self.file.report, self.where, self.file.path
        if self.element.tag == "collision":
            return convert_collision(
                path, scale, report, where=where, file=file, by_piece=True
            )
        for material in self.element.findall("material"):
            self.element.remove(material)  # Drake refuses it beside those of a glTF.
        drawn = convert_visual(path, scale, report, where=where, file=file, color=color)
        return () if drawn is None else (drawn,)


def _pose_of(element: ET.Element, file: SdfFile) -> RigidTransform:
    """Return the pose of an element, the identity without one."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return RigidTransform()
    values = parse_sdf_pose(pose)
    if values is None:
        is_quaternion = pose.get("rotation_format") == "quat_xyzw"
        count = "7 numbers" if is_quaternion else "x y z roll pitch yaw"
        raise file.error(f"<pose>: expected {count}, got {pose.text!r}", pose)
    if len(values) == 7:
        x, y, z, w = values[3:]
        norm = float(np.linalg.norm(values[3:]))
        if norm == 0.0:
            raise file.error("<pose>: a quaternion of length 0", pose)
        quaternion = Quaternion(*(np.array([w, x, y, z]) / norm))
        return RigidTransform(RotationMatrix(quaternion), np.array(values[:3]))
    return transform_of(values)


def _keeps_plane(X: RigidTransform) -> bool:
    """Return whether the plane z = 0 of a frame is that of its parent."""
    upwards = X.rotation().col(2)
    return bool(X.translation()[2] == 0.0 and np.allclose(upwards, [0.0, 0.0, 1.0]))
