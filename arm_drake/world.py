"""Built-in worlds: what a robot stands on and bumps into."""

from collections.abc import Callable, Mapping

from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

from arm_drake.errors import InputError, suggest

# Friction of the ground, static and dynamic.
_GROUND_FRICTION = 1.0

# A box, for Drake warns about half spaces [m].
_GROUND_SIZE = (100.0, 100.0, 1.0)


def add_world(plant: MultibodyPlant, name: str) -> None:
    """Add a world to a plant that isn't finalized.

    Args:
        plant: Where to add it.
        name: Name of a built-in world, see `WORLDS`.

    Raises:
        InputError: If there is no such world.
    """
    if name not in WORLDS:
        raise InputError(f"unknown world {name!r}; {suggest(name, WORLDS)}")
    WORLDS[name](plant)


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
