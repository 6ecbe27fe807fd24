"""Whether a mobile base stands on the ground when it starts."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex

from arm_drake.description.axles import Axle
from arm_drake.description.base_wheels import MobileBase
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.rollers import Rollers
from arm_drake.hardware.wheels import find_wheels
from arm_drake.plant.ground import GROUND
from arm_drake.plant.placement import find_shapes
from arm_drake.plant.resting import (
    PlacedShape,
    lowest_height,
    lowest_points,
    placed_shape,
)

# So far above or below the ground a base doesn't stand on it [m].
_OFF_GROUND = 0.01

# Heights that differ less are one [m].
_TOUCHING = 1e-6

# So far above the lowest point of the robot a wheel doesn't touch the ground [m].
_GAP = 1e-3


def report_ground(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
    report: LoadReport,
    *,
    bases: Sequence[MobileBase],
    axles: Sequence[Axle],
    rollers: Sequence[Rollers],
) -> None:
    """Record a base that has no ground, or isn't on it, or whose wheels aren't.

    Heights are known above a ground at z = 0 alone, as the built-in worlds have it.
    Wheels with springs reach what they reach by themselves.

    Args:
        plant: The finalized plant; robots stand where they start.
        scene_graph: Its scene graph.
        model: The robot's model instance.
        robot: The robot.
        report: Where it is recorded.
        bases: What the robot's controllers drive.
        axles: Axles that the plant has besides.
        rollers: Rollers likewise.
    """
    if not robot.has_free_base:
        return
    file = robot.description.file
    standing = _what_stands(plant, scene_graph)
    if not standing:
        what = "a mobile base in a world without a ground"
        done = "it falls; expected world='empty', or one that has something to stand on"
        report.add("error", "missing", what, done, file=file)
        return
    shapes = find_shapes(
        plant, scene_graph, plant.GetBodyIndices(model), RigidTransform()
    )
    grounds = [shape for name, shape in standing if name == GROUND]
    if not shapes or not any(map(_is_at_zero, grounds)):
        return
    lowest = min(lowest_height(shape) for shape in shapes)
    if abs(lowest) > _OFF_GROUND:
        z = 0.0 if robot.pose is None else robot.pose[2]
        is_above = lowest > 0.0
        side, does = ("above", "falls") if is_above else ("below", "is pushed out")
        report.add(
            "warning",
            "invalid",
            f"the base starts {abs(lowest):.3g} m {side} the ground",
            f"it {does}; expected z = {z - lowest:.3g} m",
            where="pose",
            file=file,
        )
    for base in bases:
        wheels = find_wheels(
            plant, scene_graph, model, robot.description, base, axles, rollers
        )
        gaps = {}
        for wheel in wheels:
            if not _is_sprung(robot, wheel.joint, base.link):
                indices = map(BodyIndex, wheel.touching)
                own = find_shapes(plant, scene_graph, indices, RigidTransform())
                gaps[wheel.joint] = min(map(lowest_height, own)) - lowest
        off = {joint: gap for joint, gap in gaps.items() if gap > _GAP}
        for joint, gap in off.items():
            drives_nothing = len(off) == len(wheels)
            report.add(
                "error" if drives_nothing else "warning",
                "invalid",
                f"a driven wheel ends {gap:.3g} m above what the robot stands on",
                "it turns in the air; expected a wheel that reaches the ground",
                where=f"joint {joint!r}",
                file=file,
            )


def _what_stands(
    plant: MultibodyPlant, scene_graph: SceneGraph
) -> list[tuple[str, PlacedShape]]:
    """Return the collision shapes that are fixed in the world, with their names."""
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    found = []
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        if not plant.IsAnchored(body):
            continue
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            X_WG = X_WB @ inspector.GetPoseInFrame(geometry)
            name = inspector.GetName(geometry).rpartition("::")[2]
            found.append((name, placed_shape(inspector, geometry, X_WG)))
    return found


def _is_at_zero(shape: PlacedShape) -> bool:
    """Return whether the top of a shape is at z = 0."""
    highest = lowest_points(shape, np.array([0.0, 0.0, -1.0]))[:, 2].max()
    return bool(abs(highest) < _TOUCHING)


def _is_sprung(robot: Robot, joint: str, base: str) -> bool:
    """Return whether another joint than its own lets a wheel move up and down."""
    carriers = {j.child: j for j in robot.description.joints}
    link = robot.description.joint(joint).parent
    while link in carriers and link != base:
        if carriers[link].type not in ("fixed", "revolute", "continuous"):
            return True
        link = carriers[link].parent
    return False
