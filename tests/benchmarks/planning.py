"""Plans: how many problems are solved, how long that takes, and whether they are free.

A problem is five boxes and a table around a robot, and two free configurations whose
straight line in joint space is blocked. It is taken only if it can be solved: else a
search of ten seconds looks for a way. All that is returned is judged by pinocchio and
coal, with the robot's own collision shapes, at each 5 mrad of the way: against boxes
and against itself, but for links that an SRDF lets touch or that touch at both ends.

    python -m tests.benchmarks.planning [--problems 100] [--robots NAME ...]
"""

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.errors import ArmDrakeError
from arm_drake.plant.joint_ranges import joint_ranges
from tests.benchmarks.inverse_kinematics import load

# By name: how large a scene is beside the arm's reach of about a metre.
ROBOTS = {
    "doosan_a0912": 1.0,
    "example:ur5_robot": 0.8,
    "example:panda": 0.75,
    "mycobot_280": 0.28,
}

# A step of the judge [rad].
STEP = 5e-3

# How far around 0 joints are at both ends [rad].
RANGE = 2.5


class Scene(NamedTuple):
    """Boxes: their sizes [m] and their poses."""

    boxes: tuple[tuple[np.ndarray, RigidTransform], ...]

    def add_to(self, plant: MultibodyPlant) -> None:
        """Add them to a plant."""
        for index, (size, X_WB) in enumerate(self.boxes):
            plant.RegisterCollisionGeometry(
                plant.world_body(),
                X_WB,
                Box(*size),
                f"box_{index}",
                CoulombFriction(1.0, 1.0),
            )


def make_scene(rng: np.random.Generator, scale: float) -> Scene:
    """Return a table below the robot's base, and five boxes."""
    table = (
        np.array([3.0, 3.0, 0.1]) * scale,
        RigidTransform([0.0, 0.0, -0.1 * scale - 0.02]),
    )
    boxes = [table]
    for _ in range(5):
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.9) * scale
        height = rng.uniform(0.1, 0.9) * scale
        place = [radius * np.cos(angle), radius * np.sin(angle), height]
        turn = RollPitchYaw(rng.uniform(-np.pi, np.pi, 3))
        boxes.append((rng.uniform(0.1, 0.3, 3) * scale, RigidTransform(turn, place)))
    return Scene(tuple(boxes))


class Judge:
    """pinocchio and coal."""

    def __init__(self, robot: ad.Robot) -> None:
        """Read the robot's own description."""
        import pinocchio as pin

        self._pin = pin
        self._model = pin.buildModelFromXML(robot.description.source)
        self._data = self._model.createData()
        self._shapes = pin.buildGeomFromUrdfString(
            self._model,
            robot.description.source,
            pin.GeometryType.COLLISION,
            package_dirs=[str(folder) for folder in robot.description.file.parents],
        )
        for each in self._shapes.geometryObjects:  # Drake's shapes are convex hulls.
            if hasattr(each.geometry, "buildConvexHull"):
                each.geometry.buildConvexHull(True, "Qt")
                each.geometry = each.geometry.convex
        self._count = len(self._shapes.geometryObjects)
        self._disabled = find_disabled_collisions(robot, LoadReport())

    def prepare(self, scene: Scene) -> Any:
        """Return shapes of robot and scene, with the pairs that count."""
        import coal

        pin, shapes = self._pin, self._shapes.copy()
        for index, (size, X) in enumerate(scene.boxes):
            place = pin.SE3(X.rotation().matrix(), X.translation())
            box = pin.GeometryObject(f"box_{index}", 0, place, coal.Box(*size))
            shapes.addGeometryObject(box)
        for a, b in itertools.combinations(range(len(shapes.geometryObjects)), 2):
            one, two = (shapes.geometryObjects[i].parentJoint for i in (a, b))
            adjacent = one == two or one in (self._model.parents[two],)
            adjacent |= two in (self._model.parents[one],)
            if b >= self._count and a < self._count:
                adjacent = one == 0
            frames = [shapes.geometryObjects[i].parentFrame for i in (a, b)]
            known = [f for f in frames if f < len(self._model.frames)]
            links = tuple(sorted(self._model.frames[f].name for f in known))
            if not adjacent and links not in self._disabled:
                shapes.addCollisionPair(pin.CollisionPair(a, b))
        return shapes

    def touching(self, shapes: Any, q: np.ndarray) -> set[int]:
        """Return the pairs that touch."""
        data = shapes.createData()
        self._pin.computeCollisions(self._model, self._data, shapes, data, q, False)
        return {i for i, r in enumerate(data.collisionResults) if r.isCollision()}

    def configuration(self, positions: dict[str, float]) -> np.ndarray:
        """Return pinocchio's positions."""
        q = self._pin.neutral(self._model)
        for joint, value in positions.items():
            at = self._model.joints[self._model.getJointId(joint)]
            values = [value] if at.nq == 1 else [np.cos(value), np.sin(value)]
            q[at.idx_q : at.idx_q + at.nq] = values
        return q

    def is_free(
        self, scene: Scene, way: np.ndarray, named: Callable[[np.ndarray], dict]
    ) -> bool:
        """Whether nothing touches on a way, but for what does at both ends."""
        shapes = self.prepare(scene)
        ends = [
            self.touching(shapes, self.configuration(named(x))) for x in way[[0, -1]]
        ]
        allowed = ends[0] & ends[1]
        for x, y in itertools.pairwise(way):
            count = max(1, int(np.ceil(np.max(np.abs(y - x)) / STEP)))
            for part in np.arange(1, count + 1) / count:
                q = self.configuration(named(x + part * (y - x)))
                if self.touching(shapes, q) - allowed:
                    return False
        return True


def find_problem(
    robot: ad.Robot, rng: np.random.Generator, scale: float
) -> tuple[Scene, dict[str, float], dict[str, float]]:
    """Return a scene and two ends whose straight line is blocked."""
    from arm_drake.planning.collisions import CollisionModel
    from arm_drake.planning.groups import find_group

    joints = find_group(robot, None).joints
    ranges = {r.name: r for r in joint_ranges(robot.description)}
    low = np.array([max(ranges[n].lower, -RANGE) for n in joints])
    high = np.array([min(ranges[n].upper, RANGE) for n in joints])
    while True:
        scene = make_scene(rng, scale)
        model = CollisionModel(
            robot,
            joints,
            scene.add_to,
            padding=0.006,
            positions=robot.initial_positions,
        )
        free = [
            x for x in rng.uniform(low, high, (60, len(joints))) if model.is_free(x)
        ]
        for x, y in itertools.pairwise(free):
            if not model.is_edge_free(x, y, 0.05):
                ends = [dict(zip(joints, map(float, e), strict=True)) for e in (x, y)]
                return scene, ends[0], ends[1]


def measure(name: str, problems: int) -> str:
    """Return a robot's line."""
    robot = load(name)
    judge, rng = Judge(robot), np.random.default_rng(2)
    times, solved, free, tried = [], 0, 0, 0
    initial = dict(robot.initial_positions)
    while tried < problems:
        scene, start, end = find_problem(robot, rng, ROBOTS[name])
        world = scene.add_to
        ad.plan(robot, start, start=start, world=world)  # Builds the model.
        began = time.perf_counter()
        try:
            plan = ad.plan(robot, end, start=start, world=world)
        except ad.PlanningError as error:
            try:
                ad.plan(robot, end, start=start, world=world, time_limit=10.0, seed=9)
            except ad.PlanningError:
                continue
            print(f"{name}: {error}", file=sys.stderr)
            tried += 1
            times.append(time.perf_counter() - began)
            continue
        times.append(time.perf_counter() - began)
        tried += 1
        solved += 1
        names = plan.trajectory.joint_names
        way = np.array([point.positions for point in plan.trajectory.points])

        def named(x: np.ndarray, names: tuple[str, ...] = names) -> dict[str, float]:
            from arm_drake.planning.inverse_kinematics import complete_positions

            values = dict(zip(names, map(float, x), strict=True))
            own = {j.name for j in robot.description.movable_joints if j.mimic is None}
            start = {k: v for k, v in initial.items() if k in own}
            return complete_positions(robot, {**start, **values})

        free += judge.is_free(scene, way, named)
    ms = 1e3 * np.array(times)
    return (
        f"{name:<20} solved {solved}/{tried}  judged free {free}/{solved}  "
        f"median {np.median(ms):4.0f} ms  mean {ms.mean():4.0f}  "
        f"p95 {np.percentile(ms, 95):5.0f}  max {ms.max():5.0f}"
    )


def main() -> int:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS))
    options = parser.parse_args()
    for name in options.robots:
        try:
            print(measure(name, options.problems), flush=True)
        except ArmDrakeError as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
