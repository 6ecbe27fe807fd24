"""Worlds as loaded, and the `<world>` of an SDF file, cleaned for Drake."""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.elements import (
    free_name,
    parse_floats,
    parse_sdf_bool,
    text_of,
)
from arm_drake.description.links import Vector
from arm_drake.description.report import LoadReport, Severity
from arm_drake.importing import dataclass
from arm_drake.worlds.lights import Light, read_lights
from arm_drake.worlds.sdf_files import (
    SdfFile,
    name_of,
    read_sdf,
    replace_child,
)
from arm_drake.worlds.sdf_models import Cleaner, GroundLook


def _add_nothing(plant: MultibodyPlant) -> None:
    del plant


@dataclass(frozen=True, eq=False)
class LoadedWorld:
    """A world as loaded."""

    # Its name, which topics of Gazebo contain.
    name: str = "empty"

    # Adds it to a plant that isn't finalized.
    add_to: Callable[[MultibodyPlant], None] = _add_nothing

    # Whether it may have things that move, and can be held.
    has_things: bool = False

    # Acceleration [m/s^2]; None is Earth's, 9.81 along -z.
    gravity: Vector | None = None

    # Whether the page shows its grid.
    has_grid: bool = True

    # How its ground looks, None where it draws none.
    ground: GroundLook | None = None

    # Colour of the page behind everything, red, green and blue from 0 to 1.
    background: Vector | None = None

    # Lights by which cameras see; None are those of a day.
    lights: tuple[Light, ...] | None = None

    # What was not taken as written.
    report: LoadReport = dc.field(default_factory=LoadReport)


def show_backdrop(
    meshcat: Meshcat,
    *,
    has_grid: bool = True,
    background: Vector | None = None,
) -> None:
    """Show a page as a world wants it; without a background it keeps Meshcat's."""
    meshcat.SetProperty("/Grid", "visible", has_grid)
    if background is not None:
        for end in ("top_color", "bottom_color"):
            meshcat.SetProperty("/Background", end, list(background))


# Plugins of a world that do what arm_drake does without them.
_BUILT_IN = (
    *("physics", "user-commands", "scene-broadcaster", "gazebo_ros_state"),
    *("sensors-system", "imu-system", "contact-system", "forcetorque-system"),
    *("gazebo_ros_init", "gazebo_ros_factory"),
)

# What else a world may have, and what becomes of it.
_WITHOUT_EFFECT = {
    "gui": "the page has its own camera",
    "audio": "it has no effect",
    "wind": "there is none",
    "atmosphere": "there is none",
    "magnetic_field": "sensors don't measure it",
    "spherical_coordinates": "they have no effect",
}
_LOST = {
    "actor": "it isn't shown",
    "population": "left out",
    "road": "it isn't shown",
}

# What Drake reads of a world beside models.
_FRAMES = ("frame", "joint")

# More than on any star; the solver of contacts gives up at 1e12 [m/s^2].
_MOST_GRAVITY = 1e6


@dataclass(frozen=True)
class SdfWorld:
    """A world on its way to Drake."""

    file: SdfFile

    # The same as loaded, but for what it adds to plants.
    loaded: LoadedWorld

    # Models and inclusions, those that stand still and those that move.
    static: Sequence[ET.Element]
    moving: Sequence[ET.Element]

    # Frames and joints of the world itself.
    frames: Sequence[ET.Element]

    # Files that inclusions name, by their names in `FOLDER`.
    included: dict[str, str]

    def text(self, elements: Iterable[ET.Element]) -> str:
        """Return an SDF text of some of its elements."""
        root = ET.Element("sdf", self.file.root.attrib)
        world = ET.SubElement(root, "world", name=self.loaded.name)
        world.extend(elements)
        return ET.tostring(root, encoding="unicode")


def read_world(path: Path, package_paths: Sequence[Path] = ()) -> SdfWorld:
    """Return the world of an SDF file, with all that it includes.

    A file that has a model and no world is a world with this model.
    """
    file = read_sdf(path, LoadReport())
    worlds = file.root.findall("world")
    if worlds:
        world = worlds[0]
    else:
        world = ET.Element("world", name=path.stem)
        world.extend(child for child in file.root if child.tag in ("model", "include"))
        if not len(world):
            raise file.error("<sdf> has no <world>, and no model either", file.root)
    if len(worlds) > 1:
        what = f"{len(worlds)} worlds in one file"
        done = f"the first, {world.get('name')!r}, is taken"
        file.note("warning", "unsupported", what, done, worlds[1])
    cleaner = Cleaner(file, package_paths)
    _apply_state(world)
    _report_rest(world, file)
    kept: dict[bool, list[ET.Element]] = {True: [], False: []}
    names: set[str] = set()
    for element in list(world):
        if element.tag in ("model", "include"):
            cleaned = cleaner.clean(element)
            if cleaned is not None:
                _rename(cleaned.element, cleaned.name, names, element, file)
                kept[cleaned.is_static].append(cleaned.element)
    cleaner.report_missing()
    scene, lights = world.find("scene"), world.findall("light")
    loaded = LoadedWorld(
        world.get("name") or "default",
        gravity=_read_gravity(world, file),
        has_grid=parse_sdf_bool(text_of(scene, "grid")) is not False,
        ground=cleaner.ground,
        background=_read_background(scene),
        lights=read_lights(lights, file) if lights else None,
        report=file.report,
    )
    return SdfWorld(
        file,
        loaded,
        kept[True],
        kept[False],
        [child for child in world if child.tag in _FRAMES],
        cleaner.included,
    )


def _apply_state(world: ET.Element) -> None:
    """Move models to where they were when Gazebo saved the world."""
    poses = {
        model.get("name"): model.find("pose")
        for model in world.iterfind("state/model")
        if model.find("pose") is not None
    }
    for model in world.iterfind("model"):
        saved = poses.get(model.get("name"))
        if saved is not None:
            replace_child(model, "pose", saved.text or "")


def _report_rest(world: ET.Element, file: SdfFile) -> None:
    lights = world.findall("light")
    if lights:
        names = ", ".join(repr(light.get("name", "")) for light in lights)
        what, done = f"lights {names}", "cameras see by them; the page has its own"
        file.note("info", "ignored", what, done, lights[0])
    seen: set[str] = set()
    for child in world:
        if child.tag == "plugin":
            name = child.get("filename") or child.get("name") or ""
            if name in seen:
                continue
            seen.add(name)
            severity: Severity = "warning"
            what, done = f"plugin {name!r}", "it has no effect"
            if any(word in name for word in _BUILT_IN):
                severity, done = "info", "what it does is there without it"
            file.note(severity, "ignored", what, done, child)
        elif child.tag == "physics":
            step = text_of(child, "max_step_size")
            what = f"<physics>{f', max_step_size {step} s' if step else ''}"
            done = "the step of the physics is the option time_step"
            file.note("info", "ignored", what, done, child)
        elif child.tag == "scene":
            rest = {e.tag for e in child} - {"grid", "background"}
            if rest:
                what = f"<scene>: {', '.join(sorted(rest))}"
                file.note("info", "ignored", what, "the page has its own light", child)
        elif child.tag in _LOST:
            done = _LOST[child.tag]
            file.note("warning", "unsupported", name_of(child), done, child)
        elif child.tag in _WITHOUT_EFFECT:
            done = _WITHOUT_EFFECT[child.tag]
            file.note("info", "ignored", name_of(child), done, child)


def _rename(
    element: ET.Element,
    name: str,
    names: set[str],
    original: ET.Element,
    file: SdfFile,
) -> None:
    """Give an element another name if one before it has that."""
    free = free_name(name, names.__contains__)
    names.add(free)
    if free == name:
        return
    what, done = f"a second model is called {name!r}", f"called {free!r}"
    file.note("warning", "repair", what, done, original)
    if element.tag == "model":
        element.set("name", free)
    else:
        replace_child(element, "name", free)


def _read_gravity(world: ET.Element, file: SdfFile) -> Vector | None:
    # Before SDF 1.6 it was a part of the physics.
    gravity = world.find("gravity")
    if gravity is None:
        gravity = world.find("physics/gravity")
    text = "" if gravity is None else (gravity.text or "").strip()
    if not text:
        return None
    values = _vector(text)
    if values is None:
        problem = f"<gravity>: expected x y z [m/s^2], got {text!r}"
        raise file.error(problem, gravity)
    if max(map(abs, values)) > _MOST_GRAVITY:
        problem = f"<gravity>: expected at most {_MOST_GRAVITY:g} m/s^2, got {text!r}"
        raise file.error(problem, gravity)
    return values


def _read_background(scene: ET.Element | None) -> Vector | None:
    words = text_of(scene, "background").split()
    color = _vector(" ".join(words[:3]))
    return color if color is not None and all(0.0 <= x <= 1.0 for x in color) else None


def _vector(text: str) -> Vector | None:
    values = parse_floats(text)
    if values is None or len(values) != 3:
        return None
    x, y, z = values
    return x, y, z
