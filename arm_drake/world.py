"""Worlds: what a robot stands on, bumps into and picks up."""

from collections.abc import Callable, Mapping

from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from arm_drake.errors import InputError, suggest

# Friction of the ground, static and dynamic.
_GROUND_FRICTION = 1.0

# A box, for Drake warns about half spaces [m].
_GROUND_SIZE = (100.0, 100.0, 1.0)


# Name of a built-in world, see `WORLDS`, or what adds one to a plant.
World = str | Callable[[MultibodyPlant], None]


def add_world(plant: MultibodyPlant, world: World) -> None:
    """Add a world to a plant that isn't finalized.

    Args:
        plant: Where to add it.
        world: Name of a built-in world, see `WORLDS`. Or a function that adds bodies,
            joints and shapes to the plant, and doesn't finalize it; it may call
            `add_world(plant, "empty")` for the ground.

    Raises:
        InputError: If there is no such world, or if the function finalizes the plant.
    """
    if callable(world):
        world(plant)
        if plant.is_finalized():
            raise InputError(
                "world: the function finalized the plant; the robots come after it"
            )
        return
    if not isinstance(world, str):
        raise InputError(
            "world: expected a name or a function of the plant, "
            f"got {world!r}; known: {', '.join(sorted(WORLDS))}"
        )
    if world not in WORLDS:
        raise InputError(f"unknown world {world!r}; {suggest(world, WORLDS)}")
    WORLDS[world](plant)


def _add_ground(plant: MultibodyPlant) -> None:
    """Add the ground plane z = 0, as Gazebo's empty world has it."""
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.0, 0.0, -_GROUND_SIZE[2] / 2.0]),
        Box(*_GROUND_SIZE),
        "ground",
        CoulombFriction(_GROUND_FRICTION, _GROUND_FRICTION),
    )


def _add_nothing(plant: MultibodyPlant) -> None:
    del plant


WORLDS: Mapping[str, Callable[[MultibodyPlant], None]] = {
    "empty": _add_ground,
    "void": _add_nothing,
}
