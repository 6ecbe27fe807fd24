"""Driven wheels of a base in the plant: where they turn, and how large they are."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from arm_drake.arrays import Array
from arm_drake.description.axles import Axle
from arm_drake.description.base_wheels import MobileBase, moved_joints, rigid_links
from arm_drake.description.link_tree import LinkTree
from arm_drake.description.rollers import Rollers
from arm_drake.description.urdf import RobotDescription
from arm_drake.plant.resting import PlacedShape, lowest_points, placed_shape

# Directions across a wheel's axis in which its radius is looked for.
_NUM_DIRECTIONS = 64


class Wheel(NamedTuple):
    """A driven wheel of a base, in the frame of the body that turns."""

    # Joint that turns it.
    joint: str

    # Index of the body.
    body: int

    # Middle of the wheel [m], and its axis, to the left of the base. Shapes (3,).
    center: Array
    axis: Array

    # [m].
    radius: float

    # Indices of the bodies that touch the ground.
    touching: tuple[int, ...] = ()

    # Where the axis of a roller that is down points: forwards, and to the left of the
    # wheel. None without rollers.
    roller: tuple[float, float] | None = None


def find_wheels(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    description: RobotDescription,
    base: MobileBase,
    axles: Sequence[Axle],
    rollers: Sequence[Rollers] = (),
) -> list[Wheel]:
    """Return the driven wheels of a base: what its joints turn, and what can collide.

    They are in the order of the joints, mimic joints where their masters are.

    Args:
        plant: The finalized plant.
        scene_graph: Its scene graph.
        model: The robot's model instance.
        description: The robot.
        base: The base.
        axles: Axles that the plant has besides.
        rollers: Rollers likewise.
    """
    turning = {axle.link: axle.wheel for axle in axles}
    tree = LinkTree(description)
    context = plant.CreateDefaultContext()
    link = plant.GetBodyByName(base.link, model)
    left = plant.EvalBodyPoseInWorld(context, link).rotation().matrix()[:, 1]
    wheels = []
    for moved in (j for name in base.driven for j in moved_joints(description, name)):
        parts = rigid_links(description, moved.child)
        rolling = [rim for rim in rollers if rim.link in parts]
        if rolling:
            wheels.append(_with_rollers(plant, model, moved.name, rolling[0], left))
            continue
        body = plant.GetBodyByName(turning.get(moved.child, moved.child), model)
        shapes = _shapes(plant, scene_graph, body)
        if not shapes:
            continue
        axis = tree.axis(moved.name)
        R_WB = plant.EvalBodyPoseInWorld(context, body).rotation()
        if R_WB @ axis @ left < 0.0:
            axis = -axis
        radius = max(_reach(shapes, direction) for direction in _across(axis))
        center = (_reach(shapes, axis) - _reach(shapes, -axis)) / 2.0 * axis
        index = int(body.index())
        wheels.append(Wheel(moved.name, index, center, axis, radius, (index,)))
    return wheels


def _with_rollers(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    joint: str,
    rim: Rollers,
    left: Array,
) -> Wheel:
    """Return a wheel with rollers.

    Args:
        plant: The finalized plant.
        model: The robot's model instance.
        joint: Joint that turns the wheel.
        rim: Its rollers.
        left: To the left of the base, in the world.
    """
    body = plant.GetBodyByName(rim.link, model)
    X_WB = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), body)
    axis = rim.axis * (1.0 if X_WB.rotation() @ rim.axis @ left >= 0.0 else -1.0)
    forwards = np.cross(axis, -rim.down)
    return Wheel(
        joint,
        int(body.index()),
        rim.center,
        axis,
        rim.radius,
        tuple(int(plant.GetBodyByName(n, model).index()) for n in rim.wheels),
        (float(rim.roller @ forwards), float(rim.roller @ axis)),
    )


def _shapes(
    plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody
) -> list[PlacedShape]:
    inspector = scene_graph.model_inspector()
    return [
        placed_shape(inspector, geometry, inspector.GetPoseInFrame(geometry))
        for geometry in plant.GetCollisionGeometriesForBody(body)
    ]


def _reach(shapes: Sequence[PlacedShape], direction: Array) -> float:
    """Return how far shapes reach in a direction from the origin [m]."""
    points = np.vstack([lowest_points(shape, -direction) for shape in shapes])
    return float((points @ direction).max())


def _across(axis: Array) -> Iterator[Array]:
    """Yield directions across an axis."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    for angle in np.linspace(0.0, 2.0 * np.pi, _NUM_DIRECTIONS, endpoint=False):
        yield np.cos(angle) * first + np.sin(angle) * second
