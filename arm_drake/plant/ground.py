"""The ground of built-in worlds."""

from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

# Name of its shape, also of the ground plane of an SDF file.
GROUND = "ground"

# Friction of the ground, static and dynamic.
GROUND_FRICTION = 1.0

# A box, for Drake warns about half spaces [m].
_SIZE = (100.0, 100.0, 1.0)


def add_ground(plant: MultibodyPlant) -> None:
    """Add the ground plane z = 0, as Gazebo's empty world has it."""
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.0, 0.0, -_SIZE[2] / 2.0]),
        Box(*_SIZE),
        GROUND,
        CoulombFriction(GROUND_FRICTION, GROUND_FRICTION),
    )
