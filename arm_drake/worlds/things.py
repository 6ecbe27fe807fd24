"""Worlds as loaded, and things that are added to them: boxes, cylinders and balls."""

import dataclasses as dc
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import CalcSpatialInertia, RigidBody
from pydrake.systems.framework import Context

from arm_drake.description.links import Pose, Vector
from arm_drake.description.report import LoadReport
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.plant.plant import transform_of

if TYPE_CHECKING:
    from arm_drake.worlds.lights import Light
    from arm_drake.worlds.sdf_models import GroundLook


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
    ground: "GroundLook | None" = None

    # Colour of the page behind everything, red, green and blue from 0 to 1.
    background: Vector | None = None

    # Lights by which cameras see; None are those of a day.
    lights: "tuple[Light, ...] | None" = None

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


# Colours by name: red, green and blue from 0 to 1.
COLORS: Mapping[str, tuple[float, float, float]] = {
    "black": (0.05, 0.05, 0.05),
    "blue": (0.1, 0.3, 0.85),
    "brown": (0.45, 0.28, 0.15),
    "cyan": (0.1, 0.75, 0.8),
    "gray": (0.5, 0.5, 0.5),
    "green": (0.15, 0.6, 0.2),
    "orange": (0.95, 0.5, 0.1),
    "pink": (0.95, 0.55, 0.7),
    "purple": (0.5, 0.2, 0.6),
    "red": (0.8, 0.1, 0.1),
    "white": (0.95, 0.95, 0.95),
    "yellow": (0.95, 0.8, 0.1),
}

# How many numbers say how large a thing is, and what it is for Drake.
SHAPES: Mapping[str, tuple[int, type[Box | Cylinder | Sphere]]] = {
    "box": (3, Box),
    "cylinder": (2, Cylinder),
    "sphere": (1, Sphere),
}


@dataclass(frozen=True)
class Thing:
    """A thing of a scene: a body that moves, or a shape that stands still."""

    name: str

    # "box", "cylinder" or "sphere".
    kind: str

    # Lengths along x, y and z; radius and length; or radius [m].
    size: tuple[float, ...]

    # Mass [kg], spread evenly; what is fixed needs none.
    mass: float | None = None

    # Red, green, blue, and how opaque it is, from 0 to 1.
    color: tuple[float, float, float, float] = (*COLORS["gray"], 1.0)

    # Coefficient of friction, static and dynamic.
    friction: float = 0.8

    # Where its middle is at the start: x, y, z [m], roll, pitch, yaw [rad].
    pose: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    # Whether it stands still.
    fixed: bool = False

    def __post_init__(self) -> None:
        """Raise InputError for what no thing can be."""
        if self.kind not in SHAPES:
            hint = suggest(str(self.kind), SHAPES)
            raise InputError(f"unknown kind {self.kind!r}; {hint}")
        count = SHAPES[self.kind][0]
        if len(self.size) != count or not all(0.0 < x < math.inf for x in self.size):
            text = f"expected positive numbers, {count} of them, got {self.size!r}"
            raise InputError(f"size of a {self.kind}: {text}")
        if self.mass is None and not self.fixed:
            raise InputError("expected mass [kg], or fixed: true")
        if self.mass is not None and not 0.0 < self.mass < math.inf:
            raise InputError(f"mass: expected a positive number, got {self.mass!r}")

    @property
    def radius(self) -> float:
        """Radius of the smallest ball about its middle that holds it [m]."""
        if self.kind == "cylinder":
            radius, length = self.size
            return math.hypot(radius, 0.5 * length)
        return self.size[0] if self.kind == "sphere" else 0.5 * math.hypot(*self.size)

    def add_to(self, plant: MultibodyPlant) -> None:
        """Add it to a plant that isn't finalized, as a model of one body."""
        if plant.HasModelInstanceNamed(self.name):
            text = f"thing {self.name!r}: the world has a model of this name"
            raise InputError(f"{text}; give it another")
        shape = SHAPES[self.kind][1](*self.size)
        model = plant.AddModelInstance(self.name)
        X_WB = transform_of(self.pose)
        label, friction = self.name, CoulombFriction(self.friction, self.friction)
        body, X_BG = plant.world_body(), X_WB
        if not self.fixed:
            # Drake takes a density [kg/m^3].
            density = self.mass / CalcSpatialInertia(shape, 1.0).get_mass()
            inertia = CalcSpatialInertia(shape, density)
            body, X_BG = plant.AddRigidBody(self.name, model, inertia), RigidTransform()
            plant.SetDefaultFloatingBaseBodyPose(body, X_WB)
        color = np.array(self.color)
        plant.RegisterVisualGeometry(body, X_BG, shape, label, color)
        plant.RegisterCollisionGeometry(body, X_BG, shape, label, friction)


@dataclass(frozen=True)
class _AddThings:
    """Adds a world and the things of a scene to plants."""

    world: LoadedWorld
    things: tuple[Thing, ...]

    def __call__(self, plant: MultibodyPlant) -> None:
        self.world.add_to(plant)
        for thing in self.things:
            thing.add_to(plant)


def with_things(world: LoadedWorld, things: Sequence[Thing]) -> LoadedWorld:
    """Return a world with things in it."""
    things = tuple(things)
    if not things:
        return world
    moves = any(not thing.fixed for thing in things)
    return dc.replace(
        world,
        add_to=_AddThings(world, things),
        has_things=world.has_things or moves,
    )


def free_bodies(plant: MultibodyPlant, robots: Collection[str]) -> Iterator[RigidBody]:
    """Yield the bodies that move freely and aren't those of robots, which are named."""
    models = {plant.GetModelInstanceByName(name) for name in robots}
    for index in plant.GetFloatingBaseBodies():
        body = plant.get_body(index)
        if body.model_instance() not in models:
            yield body


def free_poses(
    plant: MultibodyPlant, context: Context, robots: Collection[str]
) -> dict[str, RigidTransform]:
    """Return where free bodies are in the world, by name; the first of two alike.

    `context` is the root context.
    """
    own = plant.GetMyContextFromRoot(context)
    poses: dict[str, RigidTransform] = {}
    for body in free_bodies(plant, robots):
        X_WB = RigidTransform(plant.EvalBodyPoseInWorld(own, body))
        poses.setdefault(str(body.name()), X_WB)
    return poses
