"""Worlds by name, by file and by function, and how they are added to plants."""

import dataclasses as dc
import functools
import os
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

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

from arm_drake.description.elements import free_name
from arm_drake.description.entry import models_folder
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.plant.contact import add_ground
from arm_drake.plant.plant import drake_messages
from arm_drake.worlds.sdf_files import name_of
from arm_drake.worlds.sdf_models import FOLDER
from arm_drake.worlds.sdf_world import LoadedWorld, SdfWorld, read_world

# Files that are worlds, by the ends of their names.
WORLD_SUFFIXES = (".world", ".sdf")

# Name of a built-in world, see `WORLDS`; an SDF file, as a Path or as a text that ends
# like one; what adds a world to a plant; or a world that is loaded already.
World = str | Path | Callable[[MultibodyPlant], None] | LoadedWorld

WORLDS: Mapping[str, LoadedWorld | Path] = {
    "empty": LoadedWorld("empty", add_ground),
    "house": models_folder() / "worlds/house/house.sdf",
    "house_table": models_folder() / "worlds/house_table/house_table.sdf",
    "void": LoadedWorld("void"),
}


def load_world(world: World, package_paths: Sequence[Path] = ()) -> LoadedWorld:
    """Return a world that can be added to plants.

    Args:
        world: Name of a built-in world, see `WORLDS`; the file of an SDF world, as
            Gazebo has them; or a function that adds bodies, joints and shapes to the
            plant, and doesn't finalize it; it may call `add_world(plant, "empty")` for
            the ground. A loaded world is returned.
        package_paths: Folders to search first for models of an SDF world.

    Raises:
        InputError: If there is no such world, or its file can't be used.
    """
    if isinstance(world, LoadedWorld):
        return world
    if callable(world):
        return LoadedWorld(add_to=_checked(world), has_things=True)
    if isinstance(world, str) and world in WORLDS:
        return _load_built_in(world)
    if isinstance(world, Path) or (isinstance(world, str) and _is_file_name(world)):
        return load_sdf_world(Path(world).expanduser(), package_paths)
    if not isinstance(world, str):
        raise InputError(
            "world: expected a name, a file or a function of the plant, "
            f"got {world!r}; known: {', '.join(sorted(WORLDS))}"
        )
    hint = suggest(world, WORLDS)
    raise InputError(f"unknown world {world!r}; {hint}, or a .world or .sdf file")


def add_world(plant: MultibodyPlant, world: World) -> None:
    """Add a world to a plant that isn't finalized.

    Args:
        plant: Where to add it.
        world: As that of `load_world`.

    Raises:
        InputError: If there is no such world, if its file can't be used, or if the
            function finalizes the plant.
    """
    load_world(world).add_to(plant)


@functools.cache
def _load_built_in(name: str) -> LoadedWorld:
    """Return a built-in world; a process reads its file once."""
    world = WORLDS[name]
    return world if isinstance(world, LoadedWorld) else load_sdf_world(world)


def _is_file_name(world: str) -> bool:
    return world.lower().endswith(WORLD_SUFFIXES) or os.sep in world


def _checked(
    function: Callable[[MultibodyPlant], None],
) -> Callable[[MultibodyPlant], None]:
    def add_to(plant: MultibodyPlant) -> None:
        function(plant)
        if plant.is_finalized():
            raise InputError(
                "world: the function finalized the plant; the robots come after it"
            )

    return add_to


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
    world: SdfWorld, elements: list[Element]
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
    world: SdfWorld, elements: Sequence[Element]
) -> tuple[MultibodyPlant, SceneGraph]:
    """Return a plant of its own with some elements; RuntimeError if Drake refuses."""
    plant, scene_graph = MultibodyPlant(time_step=1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    _parse(plant, world, elements)
    plant.Finalize()
    return plant, scene_graph


def _parse(plant: MultibodyPlant, world: SdfWorld, elements: Sequence[Element]) -> None:
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
