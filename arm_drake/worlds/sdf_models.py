"""Models of SDF files, cleaned: what Drake can't take is mended or left out."""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from arm_drake.errors import InputError
from arm_drake.plant.ground import GROUND
from arm_drake.worlds.sdf_files import SdfFile, is_true, read_sdf, text_of
from arm_drake.worlds.sdf_models_part import ModelFinder
from arm_drake.worlds.sdf_notes import Notes
from arm_drake.worlds.sdf_shapes import clean_shapes, is_flat, pose_of

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


@dc.dataclass(frozen=True)
class Cleaned:
    """A model or an inclusion on its way to Drake."""

    element: ET.Element
    name: str
    is_static: bool


class Cleaner:
    """Cleans models and inclusions of one world."""

    def __init__(
        self, file: SdfFile, package_paths: Sequence[Path], notes: Notes
    ) -> None:
        """Create it.

        Args:
            file: The file of the world.
            package_paths: Folders to search first for models.
            notes: Where everything is recorded.
        """
        self._world = file
        self._models = ModelFinder(file.path, package_paths)
        self._notes = notes
        self._missing: dict[str, ET.Element] = {}
        self._names: dict[tuple[Path, bool | None], str] = {}
        self._files: dict[Path, SdfFile] = {}
        # Files whose models are being cleaned, each included by the one before.
        self._open: list[Path] = []

        # Texts of the files that inclusions name, by their names in `FOLDER`.
        self.included: dict[str, str] = {}

    def clean(self, element: ET.Element) -> Cleaned | None:
        """Return a model or an inclusion of the world as Drake takes it, or None.

        Args:
            element: The model or inclusion, changed in place.

        Raises:
            InputError: If a number in it is malformed.
        """
        return self._clean(element, self._world, None, "", 0)

    def report_missing(self) -> None:
        """Record the models that aren't there, in one line."""
        if self._missing:
            names = sorted(self._missing)
            count = (
                "no model" if len(names) == 1 else f"{len(names)} models aren't there:"
            )
            self._notes.add(
                "error",
                "missing",
                f"{count} {', '.join(map(repr, names))}",
                "left out, nothing is downloaded; --package-path or GAZEBO_MODEL_PATH "
                "can name a folder that holds models",
                file=self._world,
                element=next(iter(self._missing.values())),
            )

    def _clean(
        self,
        element: ET.Element,
        file: SdfFile,
        is_static: bool | None,
        where: str,
        depth: int,
    ) -> Cleaned | None:
        """Clean a model or an inclusion.

        Args:
            element: What to clean, in place.
            file: File that it is in.
            is_static: Whether what it is part of stands still; None if it decides.
            where: Place of what it is part of.
            depth: How many inclusions it is deep.
        """
        place = self._notes.place(where, element)
        if element.tag == "include":
            return self._include(element, file, is_static, place, depth)
        own = text_of(element, "static")
        if is_static is None and own:
            is_static = is_true(own)
        for child in element.findall("static"):
            element.remove(child)
        if is_static:
            ET.SubElement(element, "static").text = "true"
        self._notes.remove(element, _OF_MODELS, file=file, where=place)
        is_level = (
            bool(is_static) and depth == 0 and not where and _is_flat(element, file)
        )
        has_content = False
        for child in list(element):
            if child.tag == "link":
                has_content = True
                self._clean_link(child, file, place, is_level=is_level)
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
        self, link: ET.Element, file: SdfFile, where: str, *, is_level: bool
    ) -> None:
        place = self._notes.place(where, link)
        self._notes.remove(link, _OF_LINKS, file=file, where=place)
        ground = GROUND if is_level and _is_flat(link, file) else None
        clean_shapes(link, file, self._models, self._notes, where=place, ground=ground)

    def _include(
        self,
        include: ET.Element,
        file: SdfFile,
        is_static: bool | None,
        where: str,
        depth: int,
    ) -> Cleaned | None:
        self._notes.remove(include, ("plugin",), file=file, where=where)
        uri = text_of(include, "uri")
        name = uri.rstrip("/").rpartition("/")[2].replace("%20", " ")
        known = name.lower().replace("_", " ")
        if known == _SUN:
            what, done = "the model of the sun", "the page has its own lamps"
            self._notes.add(
                "info", "ignored", what, done, file=file, element=include, where=where
            )
            return None
        if known == _GROUND_PLANE:
            return self._built_in_ground(include, file, depth)
        path = self._models.find_model(uri, file.path.parent)
        if path is None:
            self._missing.setdefault(name or uri, include)
            return None
        own = text_of(include, "static")
        if is_static is None and own:
            is_static = is_true(own)
        try:
            included = self._files.setdefault(path, read_sdf(path))
            model = included.root.find("model")
            if model is None:
                raise included.error("<sdf> has no <model> to include", included.root)
            if is_static is None:
                is_static = is_true(text_of(model, "static"))
            target = self._keep(included, model, is_static, where, depth)
        except InputError as error:
            done = "left out"
            self._notes.report.add(
                "error",
                "invalid",
                error.problem,
                done,
                where=where,
                file=error.file,
                line=error.line,
            )
            return None
        if target is None:
            return None
        for tag in ("uri", "static"):
            for child in include.findall(tag):
                include.remove(child)
        ET.SubElement(include, "uri").text = f"file://{FOLDER}/{target}"
        if is_static:
            ET.SubElement(include, "static").text = "true"
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
            for child in copied.findall("static"):
                copied.remove(child)
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
    return not is_relative and is_flat(pose_of(element, file))


def _clean_joint(model: ET.Element, joint: ET.Element, *, is_static: bool) -> None:
    """Remove a joint where nothing moves; else let nothing drive it.

    Drake has an actuator for each joint whose effort limit isn't 0.
    """
    if joint.get("type") == "fixed":
        return
    if is_static:
        model.remove(joint)
        return
    for axis in [child for child in joint if child.tag in ("axis", "axis2")]:
        limit = axis.find("limit")
        if limit is None:
            limit = ET.SubElement(axis, "limit")
        for effort in limit.findall("effort"):
            limit.remove(effort)
        ET.SubElement(limit, "effort").text = "0"
