"""The `<world>` of an SDF file, cleaned for Drake, and how it is added to plants."""

import dataclasses as dc
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from pydrake.geometry import RenderLabel, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    FixedOffsetFrame,
    ModelInstanceIndex,
    world_index,
)

from arm_drake.description.elements import (
    free_name,
    parse_floats,
    parse_sdf_bool,
    text_of,
)
from arm_drake.description.links import Vector
from arm_drake.description.report import LoadReport, Severity
from arm_drake.importing import dataclass
from arm_drake.plant.plant import drake_messages
from arm_drake.worlds.lights import read_lights
from arm_drake.worlds.sdf_files import (
    SdfFile,
    name_of,
    read_sdf,
    replace_child,
)
from arm_drake.worlds.sdf_models import FOLDER, Cleaner
from arm_drake.worlds.things import LoadedWorld

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


def load_sdf_world(path: Path, package_paths: Sequence[Path] = ()) -> LoadedWorld:
    """Return the world of an SDF file.

    What stands still becomes shapes of the world body, with a frame for each link, in
    a model instance for each model: bodies that are welded to the world would cost time
    in every step.
    """
    world = read_world(path, package_paths)
    is_linked = _is_linked(world)
    static = [] if is_linked else list(world.static)
    moving = [*world.static, *world.moving] if is_linked else list(world.moving)
    _check_empty(world)
    frames = _keep_what_drake_takes(world, static)
    moved = _keep_what_drake_takes(world, moving)

    def add_to(plant: MultibodyPlant) -> None:
        if static and frames is not None:
            _add_standing(plant, *frames)
        if moving:
            _parse(plant, world, moving)

    has_things = moved is not None and any(
        not moved[0].IsAnchored(moved[0].get_body(BodyIndex(i)))
        for i in range(moved[0].num_bodies())
    )
    adder = _AddSdfWorld(add_to, path, tuple(package_paths))
    return dc.replace(world.loaded, add_to=adder, has_things=has_things)


@dataclass(frozen=True, eq=False)
class _AddSdfWorld:
    """Adds the world of an SDF file to plants; elsewhere its file is read again."""

    add_to: Callable[[MultibodyPlant], None]
    path: Path
    package_paths: tuple[Path, ...]

    def __call__(self, plant: MultibodyPlant) -> None:
        self.add_to(plant)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _read_again, (self.path, self.package_paths)


def _read_again(
    path: Path, package_paths: tuple[Path, ...]
) -> Callable[[MultibodyPlant], None]:
    return load_sdf_world(path, package_paths).add_to


def _is_linked(world: SdfWorld) -> bool:
    """Return whether one model may be placed by, or joined to, another one."""
    poses = [e.find("pose") for e in (*world.static, *world.moving)]
    is_relative = any(p is not None and p.get("relative_to") for p in poses)
    return is_relative or bool(world.frames)


def _check_empty(world: SdfWorld) -> None:
    """Raise InputError if Drake doesn't take the file whatever is in its world."""
    try:
        _try_to_parse(world, [])
    except RuntimeError as error:
        raise world.file.error(str(error), world.file.root) from None


def _keep_what_drake_takes(
    world: SdfWorld, elements: list[ET.Element]
) -> tuple[MultibodyPlant, SceneGraph] | None:
    """Leave out of some elements what Drake refuses; return a plant with the rest."""
    if not elements:
        return None
    try:
        return _try_to_parse(world, elements)
    except RuntimeError as error:
        problem = str(error)
    refused = 0
    for element in list(elements):
        try:
            _try_to_parse(world, [element])
        except RuntimeError as error:
            elements.remove(element)
            refused += 1
            what, where = f"Drake refuses it: {error}", name_of(element)
            world.file.note("error", "invalid", what, "left out", element, where)
    if not refused:
        raise world.file.error(f"Drake refuses the world: {problem}", world.file.root)
    return _keep_what_drake_takes(world, elements)


def _try_to_parse(
    world: SdfWorld, elements: Sequence[ET.Element]
) -> tuple[MultibodyPlant, SceneGraph]:
    """Return a plant of its own with some elements; RuntimeError if Drake refuses."""
    plant, scene_graph = MultibodyPlant(time_step=1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    _parse(plant, world, elements)
    plant.Finalize()
    return plant, scene_graph


def _parse(
    plant: MultibodyPlant, world: SdfWorld, elements: Sequence[ET.Element]
) -> None:
    """Add elements to a plant, and what Drake says of them to the report."""
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    text = world.text([*world.frames, *elements])
    with tempfile.TemporaryDirectory(prefix="arm_drake_") as folder:
        for name, included in world.included.items():
            content = included.replace(FOLDER, folder)
            (Path(folder) / name).write_text(content, encoding="utf-8")
        try:
            with drake_messages() as messages:
                parser.AddModelsFromString(text.replace(FOLDER, folder), "sdf")
        except (RuntimeError, ValueError, LookupError, SystemExit) as error:
            # The reason is often what Drake warned about before.
            problems = map(_without_place, [*messages, " ".join(str(error).split())])
            raise RuntimeError("; ".join(dict.fromkeys(problems))) from None
    for message in messages:
        what = _without_place(message)
        file = world.file.path
        world.file.report.add("info", "ignored", what, "so says Drake", file=file)


def _without_place(message: str) -> str:
    """Return a message of Drake without its place, which is one in our text."""
    return re.sub(r"^.*?\b(warning|error): ", "", message, count=1).rstrip(".")


def _add_standing(
    plant: MultibodyPlant, parsed: MultibodyPlant, scene_graph: SceneGraph
) -> None:
    """Add the shapes of a parsed plant's bodies to the world body of another one."""
    instances: dict[str, ModelInstanceIndex] = {}
    context, inspector = parsed.CreateDefaultContext(), scene_graph.model_inspector()
    for index in range(1, parsed.num_bodies()):
        body = parsed.get_body(BodyIndex(index))
        X_WB = parsed.EvalBodyPoseInWorld(context, body)
        model = parsed.GetModelInstanceName(body.model_instance())
        if model not in instances:
            instances[model] = plant.AddModelInstance(
                free_name(model, plant.HasModelInstanceNamed)
            )
        name, instance = str(body.name()), instances[model]
        plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), X_WB, instance))
        frame_id = parsed.GetBodyFrameIdOrThrow(body.index())
        for geometry in inspector.GetGeometries(frame_id):
            X_WG = X_WB @ RigidTransform(inspector.GetPoseInFrame(geometry))
            last = inspector.GetName(geometry).rpartition("::")[2]
            label = f"{model}::{name}::{last}"
            properties = inspector.GetProximityProperties(geometry)
            if properties is not None:
                shape, owner = inspector.GetShape(geometry), plant.world_body()
                plant.RegisterCollisionGeometry(owner, X_WG, shape, label, properties)
                continue
            clone = inspector.CloneGeometryInstance(geometry)
            clone.set_pose(X_WG)
            clone.set_name(label)
            if clone.perception_properties() is not None:
                # It is that of the world body now, not that of the parsed one.
                seen = clone.mutable_perception_properties()
                seen.UpdateProperty("label", "id", RenderLabel(int(world_index())))
            plant.RegisterVisualGeometry(plant.world_body(), clone)
