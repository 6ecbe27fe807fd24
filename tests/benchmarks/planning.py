"""Plans: how many problems are solved, how long that takes, and whether they are free.

A problem is a scene around a robot, and two free configurations whose straight line in
joint space is blocked. Scenes are five boxes and a table; a shelf, with one end inside
a compartment and the other outside; and the house's kitchen, the robot on its table.
It is taken only if it can be solved: else a search of ten seconds looks for a way. All
that is returned is judged by pinocchio and coal, with the robot's own collision shapes,
at each 5 mrad of the way: against the scene and against itself, but for links that an
SRDF lets touch or that touch at both ends. Times are the processor's, that of the limit
too, so that what is solved doesn't depend on what else the machine does. With `--ompl`
lengths of the corners in joint space are compared with those of OMPL's RRT-Connect with
its own `simplifyMax` on the same model, where the search had something to go around.

    python -m tests.benchmarks.planning [--problems 100] [--robots NAME ...]
        [--scenes boxes shelf kitchen] [--ompl]
"""

import argparse
import itertools
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Box, Cylinder, SceneGraph, Shape, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex

import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.description.srdf import find_disabled_collisions
from arm_drake.errors import ArmDrakeError
from arm_drake.planning.collisions import CollisionModel
from arm_drake.planning.groups import find_group
from arm_drake.planning.inverse_kinematics import complete_positions
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.worlds.world import load_world
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

# The limit of a plan, and of the search that says whether there is one: processor time,
# and a wall time that isn't reached [s].
LIMIT, LONG_LIMIT, WALL = 5.0, 10.0, 600.0

# So many questions whether it is over ask for the time once: it is the kernel that has
# the processor's, and on a busy machine a call of it takes as long as a check.
CLOCK = 32

# How far around 0 joints are at both ends [rad].
RANGE = 2.5


class Scene(NamedTuple):
    """Shapes, and their poses in the world."""

    shapes: tuple[tuple[Shape, RigidTransform], ...]

    def add_to(self, plant: MultibodyPlant) -> None:
        """Add them to a plant."""
        for index, (shape, X_WS) in enumerate(self.shapes):
            friction = CoulombFriction(1.0, 1.0)
            plant.RegisterCollisionGeometry(
                plant.world_body(), X_WS, shape, f"shape_{index}", friction
            )


def make_boxes(rng: np.random.Generator, scale: float) -> Scene:
    """Return a table below the robot's base, and five boxes."""
    table = (
        Box(*(np.array([3.0, 3.0, 0.1]) * scale)),
        RigidTransform([0.0, 0.0, -0.1 * scale - 0.02]),
    )
    boxes = [table]
    for _ in range(5):
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 0.9) * scale
        height = rng.uniform(0.1, 0.9) * scale
        place = [radius * np.cos(angle), radius * np.sin(angle), height]
        turn = RollPitchYaw(rng.uniform(-np.pi, np.pi, 3))
        size = rng.uniform(0.1, 0.3, 3) * scale
        boxes.append((Box(*size), RigidTransform(turn, place)))
    return Scene(tuple(boxes))


# A compartment of the shelf: its middle, and its depth, width and height, in scales.
MIDDLE, SIZE = np.array([0.6, 0.0, 0.55]), np.array([0.3, 0.4, 0.35])


def make_shelf(rng: np.random.Generator, scale: float) -> Scene:
    """Return a shelf of two by three compartments, turned about the robot."""
    depth, width, height = SIZE
    board = 0.03
    parts = [
        ([depth, 2 * width + board, board], [0.0, 0.5 * width, level * height])
        for level in (-1.5, -0.5, 0.5, 1.5)
    ]
    parts += [
        ([depth, board, 3 * height], [0.0, side * width, 0.0])
        for side in (-0.5, 0.5, 1.5)
    ]
    parts.append(
        (
            [board, 2 * width + board, 3 * height],
            [0.5 * (depth + board), 0.5 * width, 0.0],
        )
    )
    turn = RigidTransform(RollPitchYaw(0.0, 0.0, rng.uniform(-1.0, 1.0)), [0, 0, 0])
    shapes = [
        (
            Box(*(scale * np.array(size))),
            turn @ RigidTransform(scale * (MIDDLE + np.array(place))),
        )
        for size, place in parts
    ]
    return Scene(tuple(shapes))


# Where a robot stands in the house: on the kitchen's table.
KITCHEN = (6.8, 0.95, 0.8)


def make_kitchen(rng: np.random.Generator, scale: float) -> Scene:
    """Return what of the house is within reach, as seen by a robot on the table."""
    plant, scene_graph = MultibodyPlant(1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    load_world("house", ()).add_to(plant)
    plant.Finalize()
    context, inspector = plant.CreateDefaultContext(), scene_graph.model_inspector()
    X_RW = RigidTransform(
        RollPitchYaw(0.0, 0.0, rng.uniform(-np.pi, np.pi)), KITCHEN
    ).inverse()
    shapes = []
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        X_RB = X_RW @ plant.EvalBodyPoseInWorld(context, body)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            shape = inspector.GetShape(geometry)
            X_RS = X_RB @ inspector.GetPoseInFrame(geometry)
            if isinstance(shape, Box | Cylinder | Sphere):
                shapes.append((shape, RigidTransform(X_RS)))
    return Scene(tuple(shapes))


SCENES: dict[str, Callable[[np.random.Generator, float], Scene]] = {
    "boxes": make_boxes,
    "shelf": make_shelf,
    "kitchen": make_kitchen,
}


def to_coal(shape: Shape) -> Any:
    """Return coal's shape for one of Drake's."""
    import coal

    if isinstance(shape, Box):
        return coal.Box(*shape.size())
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius(), shape.length())
    assert isinstance(shape, Sphere)
    return coal.Sphere(shape.radius())


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
        pin, shapes = self._pin, self._shapes.copy()
        for index, (shape, X) in enumerate(scene.shapes):
            place = pin.SE3(X.rotation().matrix(), X.translation())
            name = f"shape_{index}"
            shapes.addGeometryObject(pin.GeometryObject(name, 0, place, to_coal(shape)))
        for a, b in itertools.combinations(range(len(shapes.geometryObjects)), 2):
            if a >= self._count:
                break
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


class Problem(NamedTuple):
    """A scene and two ends whose straight line is blocked."""

    scene: Scene
    start: dict[str, float]
    end: dict[str, float]

    # Ours, and the ends of the joints that were sampled.
    model: CollisionModel
    low: np.ndarray
    high: np.ndarray


def find_problem(
    robot: ad.Robot, rng: np.random.Generator, name: str, kind: str
) -> Any:
    """Return a problem of a kind."""
    group, scale = find_group(robot, None), ROBOTS[name]
    joints = group.joints
    ranges = {r.name: r for r in joint_ranges(robot.description)}
    low = np.array([max(ranges[n].lower, -RANGE) for n in joints])
    high = np.array([min(ranges[n].upper, RANGE) for n in joints])
    while True:
        scene = SCENES[kind](rng, scale)
        model = CollisionModel(
            robot,
            joints,
            scene.add_to,
            padding=0.006,
            positions=robot.initial_positions,
        )
        samples = rng.uniform(low, high, (2000 if kind == "shelf" else 60, len(joints)))
        if kind == "shelf":
            samples = _with_inside(robot, group.tip, joints, scene, scale, samples)
        free = [x for x in samples if model.is_free(x)]
        for x, y in itertools.pairwise(free):
            is_inside = [
                _is_inside(robot, group.tip, joints, scene, scale, z) for z in (x, y)
            ]
            if kind == "shelf" and is_inside[0] == is_inside[1]:
                continue
            if not model.is_edge_free(x, y, 0.05):
                ends = [dict(zip(joints, map(float, e), strict=True)) for e in (x, y)]
                return Problem(scene, *ends, model, low, high)


def _is_inside(
    robot: ad.Robot,
    tip: str,
    joints: tuple[str, ...],
    scene: Scene,
    scale: float,
    x: np.ndarray,
) -> bool:
    """Whether a link's origin is within the first compartment of a shelf."""
    point = robot.forward_kinematics(
        dict(zip(joints, x, strict=True)), tip
    ).translation()
    X_WS = scene.shapes[0][1]  # The lowest board.
    place = X_WS.inverse() @ point / scale - np.array(
        [0.0, -0.5 * SIZE[1], 1.5 * SIZE[2]]
    )
    return bool(np.all(np.abs(place) < 0.45 * SIZE))


def _with_inside(
    robot: ad.Robot,
    tip: str,
    joints: tuple[str, ...],
    scene: Scene,
    scale: float,
    samples: np.ndarray,
) -> np.ndarray:
    """Return configurations with the tip inside and outside, one after the other."""
    inside = [x for x in samples if _is_inside(robot, tip, joints, scene, scale, x)]
    X_WS = scene.shapes[0][1]
    for _ in range(40):
        place = np.array([-0.1, -0.5 * SIZE[1], 1.5 * SIZE[2]]) * scale
        try:
            seed = samples[len(inside)]
            found = ad.solve_ik(
                robot,
                tip,
                RigidTransform(X_WS @ place),
                seed=dict(zip(joints, seed, strict=True)),
                group=joints,
                mask=(True,) * 3 + (False,) * 3,
                all_solutions=True,
            )
        except ad.NoSolution:
            break
        each = (found.positions, *found.others)
        inside += [np.array([q[name] for name in joints]) for q in each]
        if len(inside) > 60:
            break
    pairs = zip(inside, samples, strict=False)
    return np.array([x for pair in pairs for x in pair])


def solve_by_ompl(problem: Problem, step: float) -> float:
    """Return the length of OMPL's own simplified way; none found is infinite."""
    from ompl import base, geometric, util

    from arm_drake.planning import search

    size = len(problem.low)
    ends = np.array([list(problem.start.values()), list(problem.end.values())])
    low = np.minimum(problem.low, ends.min(axis=0))
    high = np.maximum(problem.high, ends.max(axis=0))
    util.noOutputHandler()
    util.RNG.setSeed(1)
    information = search._find_information(problem.model, (low, high), step, None)
    space = information.getStateSpace()
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(search._state(space, ends[0]))
    goals = base.GoalStates(information)
    goals.addState(search._state(space, ends[1]))
    definition.setGoal(goals)
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(definition)
    planner.setup()
    deadline = time.monotonic() + 5.0
    planner.solve(base.PlannerTerminationCondition(lambda: time.monotonic() > deadline))
    if not definition.hasExactSolution():
        return float("inf")
    way = definition.getSolutionPath()
    geometric.PathSimplifier(information).simplifyMax(way)
    corners = np.array([search._values(state, size) for state in way.getStates()])
    return float(np.sum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))


def plan_within(
    robot: ad.Robot, problem: Problem, limit: float, seed: int = 0
) -> ad.Plan:
    """Return a plan that is found in so much processor time [s]."""
    end, calls, late = time.process_time() + limit, itertools.count(), False

    def is_late() -> bool:
        nonlocal late
        late = late or (next(calls) % CLOCK == 0 and time.process_time() > end)
        return late

    return ad.plan(
        robot,
        problem.end,
        start=problem.start,
        world=problem.scene.add_to,
        time_limit=WALL,
        seed=seed,
        should_stop=is_late,
    )


def measure(name: str, kind: str, problems: int, beside_ompl: bool) -> str:
    """Return a robot's line."""
    robot = load(name)
    judge, rng = Judge(robot), np.random.default_rng(2)
    times, lengths, theirs = [], [], []
    solved, free = 0, 0
    while len(times) < problems:
        problem = find_problem(robot, rng, name, kind)
        # Builds the model.
        plan_within(robot, problem._replace(end=problem.start), LIMIT)
        began = time.process_time()
        try:
            plan = plan_within(robot, problem, LIMIT)
        except ad.PlanningError as error:
            took = time.process_time() - began
            try:
                plan_within(robot, problem, LONG_LIMIT, seed=9)
            except ad.PlanningError:
                continue
            print(f"{name}: {error}", file=sys.stderr)
            times.append(took)
            continue
        times.append(time.process_time() - began)
        solved += 1
        free += is_plan_free(robot, judge, problem.scene, plan)
        if beside_ompl:
            began = time.process_time()
            other = solve_by_ompl(problem, 10.0 * problem.model.fine_step)
            if np.isfinite(other):
                theirs.append((other, time.process_time() - began))
                steps = np.diff(plan.path, axis=0)
                lengths.append(float(np.sum(np.linalg.norm(steps, axis=1))))
        print(f"{name} {kind}: {len(times)}", end="\r", file=sys.stderr, flush=True)
    ms = 1e3 * np.array(times)
    line = (
        f"{name:<18} {kind:<8} solved {solved}/{problems}  "
        f"judged free {free}/{solved}  "
        f"median {np.median(ms):4.0f} ms  mean {ms.mean():4.0f}  "
        f"p95 {np.percentile(ms, 95):5.0f}  max {ms.max():5.0f}"
    )
    if theirs:
        longer = np.median(np.array(lengths) / np.array([n for n, _ in theirs]))
        median = 1e3 * np.median([took for _, took in theirs])
        line += f"; length by OMPL's {longer:.2f}, whose median is {median:.0f} ms"
    return line


def is_plan_free(robot: ad.Robot, judge: Judge, scene: Scene, plan: ad.Plan) -> bool:
    """Whether a plan is free for the judge."""
    names, initial = plan.trajectory.joint_names, dict(robot.initial_positions)
    own = {j.name for j in robot.description.movable_joints if j.mimic is None}
    start = {k: v for k, v in initial.items() if k in own}

    def named(x: np.ndarray) -> dict[str, float]:
        values = dict(zip(names, map(float, x), strict=True))
        return complete_positions(robot, {**start, **values})

    way = np.array([point.positions for point in plan.trajectory.points])
    return judge.is_free(scene, way, named)


def main() -> int:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS))
    parser.add_argument("--scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--ompl", action="store_true", help="compare lengths")
    options = parser.parse_args()
    for name, kind in itertools.product(options.robots, options.scenes):
        try:
            print(measure(name, kind, options.problems, options.ompl), flush=True)
        except ArmDrakeError as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
