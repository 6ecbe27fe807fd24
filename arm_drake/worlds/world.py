"""Worlds by name, by file and by function, and how they are added to plants."""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.entry import models_folder
from arm_drake.errors import InputError, suggest
from arm_drake.plant.contact import add_ground
from arm_drake.worlds.things import LoadedWorld

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
        return _load_sdf(Path(world).expanduser(), package_paths)
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
    return world if isinstance(world, LoadedWorld) else _load_sdf(world)


def _load_sdf(path: Path, package_paths: Sequence[Path] = ()) -> LoadedWorld:
    from arm_drake.worlds.sdf_world import load_sdf_world  # Few runs are in one.

    return load_sdf_world(path, package_paths)


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
