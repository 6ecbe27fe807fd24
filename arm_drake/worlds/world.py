"""Worlds: what a robot stands on, bumps into and picks up."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pydrake.multibody.plant import MultibodyPlant

from arm_drake.errors import InputError, suggest
from arm_drake.plant.ground import add_ground
from arm_drake.worlds.loaded_world import LoadedWorld


def _add_house(plant: MultibodyPlant) -> None:
    # Not at the top: furniture takes long to import, and few runs have it.
    from arm_drake.worlds.house import add_house

    add_house(plant)


# Files that are worlds, by the ends of their names.
WORLD_SUFFIXES = (".world", ".sdf")

# Name of a built-in world, see `WORLDS`; an SDF file, as a Path or as a text that ends
# like one; what adds a world to a plant; or a world that is loaded already.
World = str | Path | Callable[[MultibodyPlant], None] | LoadedWorld

WORLDS: Mapping[str, LoadedWorld] = {
    "empty": LoadedWorld("empty", add_ground),
    "house": LoadedWorld("house", _add_house, has_grid=False),
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
        return WORLDS[world]
    if isinstance(world, Path) or (isinstance(world, str) and _is_file_name(world)):
        # Not at the top, as the house.
        from arm_drake.worlds.sdf_plant import load_sdf_world

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
