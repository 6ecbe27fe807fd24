"""Collisions of a robot with itself and with a world, for planning.

The model is Drake's SceneGraphCollisionChecker: the robot without what is only seen,
and every shape of the world, standing where it is. What the planned joints don't move
is checked against nothing but what they do.

Lines are checked at steps that bound how far any shape moves between two checks: each
joint counts with the longest way from it to a shape that it carries. With steps of
twice the padding nothing between them is missed.
"""

import functools
import itertools
import math
import re
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import (
    CalcObb,
    HalfSpace,
    QueryObject,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    ModelInstanceIndex,
)
from pydrake.planning import (
    BodyShapeDescription,
    LinearDistanceAndInterpolationProvider,
    RobotDiagramBuilder,
    SceneGraphCollisionChecker,
)

from arm_drake.description.joints import joints_above, last_master
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import Pairs, find_disabled_collisions
from arm_drake.planning.surroundings import (
    PlacedShape,
    distance_to,
    divide_shapes,
    find_standing,
    register_shapes,
)
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.plant.plant import (
    add_robot_model,
    drake_messages,
    fix_free_joints,
    without_shapes,
)
from arm_drake.worlds.things import LoadedWorld
from arm_drake.worlds.world import World

# Pairs of links that touch in so large a part of random configurations always do: their
# shapes overlap where they are joined. MoveIt's setup assistant takes the same part.
_ALWAYS, _SAMPLES = 0.95, 150

# Steps are never smaller than those for this padding [m].
_LEAST_PADDING = 1e-3

# The weight of a joint that carries no shape [m].
_NO_WEIGHT = 1e-3

# How many steps of a check ahead things are looked for. That is worth it where so many
# can be left out; where not, ever more are checked before it is tried again.
_STRIDE, _WORTH, _LONGEST_WAIT = 8.0, 2, 255

# Models that are kept, of different robots, groups and worlds.
_KEPT = 8

# Shapes that moved by less are where they were [m], [1].
_SAME_PLACE = 1e-6


class CollisionModel:
    """Collision model of a robot and its world, when some joints move."""

    def __init__(
        self,
        robot: Robot,
        joints: Sequence[str],
        world: World,
        *,
        padding: float,
        positions: Mapping[str, float],
    ) -> None:
        """Create it for independent joints that move.

        What moves in the world stands where it starts. A distance of `padding` [m]
        counts as a collision. `positions` of all joints are those at first.
        """
        self.joints = tuple(joints)
        self.world = world  # As long as a model is kept, no other world has its id.
        standing = find_standing(world, robot.package_paths)
        # How many shapes the world has.
        self.count = len(standing)
        base = np.array(robot.pose[:3] if robot.pose else np.zeros(3))
        nearest, *others = divide_shapes(standing, base)
        self._parts = [_Part(each, distance_to(each, base), None) for each in others]
        self._build(robot, nearest, padding, positions)
        # What always touches doesn't depend on where joints are that aren't planned: a
        # model is kept, and has to be the same whenever it is made.
        self.set_positions(robot.initial_positions)
        self._filter(robot)
        self.set_positions(positions)

    def _build(
        self,
        robot: Robot,
        standing: Sequence[PlacedShape],
        padding: float,
        positions: Mapping[str, float],
    ) -> None:
        """Make the checker of the robot among shapes."""
        self._padding = max(padding, _LEAST_PADDING)
        builder = RobotDiagramBuilder()
        plant = self._plant = builder.plant()
        model = self._model = add_colliding_robot(plant, robot)
        register_shapes(plant, standing)
        plant.Finalize()
        self._at = {
            joint.name: plant.GetJointByName(joint.name, model).position_start()
            for joint in robot.description.movable_joints
        }
        self._find_followers(robot)
        self._robot = robot
        self._things: tuple[PlacedShape, ...] = ()
        # Links that have no padding to the world.
        self.unpadded: tuple[str, ...] = ()
        self._radii = {
            link: _radius(plant, builder.scene_graph(), link, model)
            for link in robot.description.links
            if plant.HasBodyNamed(link, model)
        }
        self._weights = self._find_weights(self._radii)
        self.set_positions(positions)
        with drake_messages():  # It tells how many contexts it has.
            self.checker = SceneGraphCollisionChecker(
                model=builder.Build(),
                robot_model_instances=[model],
                distance_and_interpolation_provider=(
                    LinearDistanceAndInterpolationProvider(plant)
                ),
                edge_step_size=1.0,
                env_collision_padding=padding,
                self_collision_padding=padding,
            )
        # The builder's is no more.
        self._plant = self.checker.plant()
        self._own_context = self._plant.CreateDefaultContext()
        self._checker_padding = float(self.checker.GetLargestPadding())
        self._names: dict[int, str] = {}
        # How far links may move between two checks [m]; nothing is missed then.
        self.fine_step = 2.0 * self._padding

    def _around(self, margin: float) -> Iterator["CollisionModel"]:
        """Yield models of the other parts of the world that are within reach [m]."""
        for index, part in enumerate(self._parts):
            if part.distance > self._reach + margin:
                continue
            if part.model is None:
                part = self._parts[index] = part._replace(model=self._among(part))
            assert part.model is not None
            yield part.model

    def _among(self, part: "_Part") -> "CollisionModel":
        """Return a model of a part of the world, where links may touch each other."""
        model = CollisionModel.__new__(CollisionModel)
        model.joints, model.world, model._parts = self.joints, self.world, []
        model.count = len(part.shapes)
        positions = {name: self._rest[at] for name, at in self._at.items()}
        model._build(self._robot, part.shapes, self._checker_padding, positions)
        model._bodies, model._filters = self._bodies, self._filters.copy()
        for one, two in itertools.product(self._bodies.values(), repeat=2):
            _disable(model._filters, one, two)
        model.checker.SetCollisionFilterMatrix(model._filters)
        model.set_things([each for each in self._things if each.link])
        return model

    @property
    def count_around(self) -> int:
        """Number of shapes of the world that may be within reach."""
        return self.count - sum(
            len(part.shapes) for part in self._parts if part.distance > self._reach
        )

    def set_things(self, things: Sequence[PlacedShape]) -> None:
        """Put what isn't part of the robot and the world, in place of what was.

        What a link carries may touch the links that it touches now.
        """
        attached_links = {each.link for each in things} - {None}
        if not (attached_links or _differ(things, self._things)):
            return
        self._things = tuple(things)
        for part in self._parts:
            if part.model is not None:
                part.model.set_things([each for each in things if each.link])
        checker, plant = self.checker, self._plant
        checker.RemoveAllAddedCollisionShapes()
        inspector = checker.model().scene_graph().model_inspector
        for each in things:
            body = each.link or plant.world_body().name()
            model = self._model if each.link else plant.world_body().model_instance()
            instance = plant.GetModelInstanceName(model)
            where = BodyShapeDescription(each.shape, each.pose, instance, body)
            checker.AddCollisionShape(each.name, where)
        known = {i.get_value() for i in inspector().GetAllGeometryIds()}
        present = self._query().inspector().GetAllGeometryIds()
        added = sorted({i.get_value() for i in present} - known)
        names = [each.name for each in things]
        self._names = dict(zip(added, names, strict=True))
        radii = dict(self._radii)
        for each in things:
            if each.link:
                reach = _reach(each.shape, each.pose) + (radii[each.link] or 0.0)
                radii[each.link] = reach
        self._weights = self._find_weights(radii)
        self._allow_touching(attached_links)

    def _allow_touching(self, attached_links: Collection[str | None]) -> None:
        """Let links that carry something touch what they do now."""
        matrix = self._filters.copy()
        self.checker.SetCollisionFilterMatrix(matrix)
        found = self.checker.CalcRobotClearance(self._rest, self._checker_padding)
        carrying = {int(self._bodies[link]) for link in attached_links if link}
        ours = set(self._bodies.values())
        pairs = zip(
            found.robot_indices(), found.other_indices(), found.distances(), strict=True
        )
        for one, two, distance in pairs:
            pair = {int(one), int(two)}
            if pair & carrying and pair <= ours and distance <= 0.0:
                _disable(matrix, int(one), int(two))
        self.checker.SetCollisionFilterMatrix(matrix)

    def set_positions(self, positions: Mapping[str, float]) -> None:
        """Put the joints that aren't planned [rad] or [m]."""
        self._rest = np.zeros(self._plant.num_positions())
        for name, value in positions.items():
            self._rest[self._at[name]] = value
        self._offset = self._rest - self._E_own @ self._rest[self._own]
        for part in self._parts:
            if part.model is not None:
                part.model.set_positions(positions)

    def configuration(self, x: np.ndarray) -> np.ndarray:
        """Return the model's positions where the planned joints have values."""
        return self._offset + self._E_own @ x

    def is_free(self, x: np.ndarray) -> bool:
        """Return whether nothing collides at values of the planned joints."""
        if not self._is_free(self.configuration(x)):
            return False
        return all(each.is_free(x) for each in self._around(self._padding))

    def _is_free(self, q: np.ndarray) -> bool:
        """Return whether nothing collides at positions, by the model's checker.

        Whether shapes overlap is seen sooner than how far: for a robot of many shapes
        that is a fifth of the time.
        """
        self.checker.UpdatePositions(q)
        query = self._query()
        if query.HasCollisions():
            return False
        if not query.ComputeSignedDistancePairwiseClosestPoints(self._checker_padding):
            return True
        return bool(self.checker.CheckConfigCollisionFree(q))

    def is_edge_free(self, x: np.ndarray, y: np.ndarray, step: float) -> bool:
        """Return whether a line is free, checked where links move by steps [m].

        The end is checked first, then the middle, and so on: what isn't free is seen
        soon.
        """
        return self.is_free(y) and self.is_inside_free(x, y, step) and self.is_free(x)

    def is_inside_free(self, x: np.ndarray, y: np.ndarray, step: float) -> bool:
        """Return whether a line is free, as `is_edge_free`, but for its ends."""
        p, q = self.configuration(x), self.configuration(y)
        count = math.ceil(float(self._weights @ np.abs(q - p)) / step)
        check, pq = self.checker.CheckConfigCollisionFree, q - p
        for part in _spread(max(count, 1)):  # No generator: it is called most often.
            if not check(p + part * pq):
                return False
        return all(
            each.is_inside_free(x, y, step) for each in self._around(self._padding)
        )

    def first_collision(self, path: np.ndarray) -> int | None:
        """Return the first segment of a path, shape (m, n), that isn't free.

        Links move by no more than `fine_step` between checks.
        """
        found = [self._first_collision(path)]
        found += [each.first_collision(path) for each in self._around(self._padding)]
        return min((at for at in found if at is not None), default=None)

    def _first_collision(self, path: np.ndarray) -> int | None:
        """Return the first segment of a path that isn't free by the model's checker.

        Where the next thing is far away, checks that can't fail are left out.
        """
        qs = np.array([self.configuration(x) for x in path])
        lengths = np.abs(np.diff(qs, axis=0)) @ self._weights
        at = np.append(0.0, np.cumsum(lengths))
        count = math.ceil(at[-1] / self.fine_step)
        if not count:  # One point is no path.
            return None if self.checker.CheckConfigCollisionFree(qs[0]) else 0
        places = np.linspace(0.0, at[-1], count + 1)
        segments = np.searchsorted(at, places, side="right") - 1
        segments = np.minimum(segments, len(path) - 2)
        parts = (places - at[segments]) / np.maximum(lengths[segments], 1e-12)
        step, number, waits, left = at[-1] / count, 0, 0, 0
        while number <= count:
            index = segments[number]
            q = qs[index] + min(parts[number], 1.0) * (qs[index + 1] - qs[index])
            if left:  # Distances take longer, and were of no use.
                left -= 1
                free, passed = self.checker.CheckConfigCollisionFree(q), 0
            else:
                distance = self._distance(q, _STRIDE * step)
                free, passed = distance > 0.0, math.ceil(distance / step) - 1
                waits = 0 if passed >= _WORTH else min(4 * waits + 3, _LONGEST_WAIT)
                left = waits
            if not free:
                return int(index)
            number += 1 + passed
        return None

    def _distance(self, q: np.ndarray, influence: float) -> float:
        """Return how much nearer things may come [m], `influence` at most."""
        found = np.array(self.checker.CalcRobotClearance(q, influence).distances())
        return float(np.min(found, initial=influence))  # Drake takes the padding off.

    @property
    def largest_weight(self) -> float:
        """Largest motion of a shape where the planned joints move by 1 [m]."""
        return float(np.linalg.norm(self._weights[self._own]))

    @property
    def links(self) -> tuple[str, ...]:
        """The robot's links."""
        return tuple(self._bodies)

    def rotation_of(self, link: str, x: np.ndarray) -> np.ndarray:
        """Return how a link is turned in the world, shape (3, 3)."""
        body = self._plant.get_body(BodyIndex(self._bodies[link]))
        self._plant.SetPositions(self._own_context, self.configuration(x))
        X_WB = self._plant.EvalBodyPoseInWorld(self._own_context, body)
        return np.array(X_WB.rotation().matrix())

    def turning_of(self, link: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how a link is turned, and how that changes by the joints, (3, n)."""
        plant, R = self._plant, self.rotation_of(link, x)
        world = plant.world_frame()
        J = plant.CalcJacobianAngularVelocity(
            self._own_context,
            JacobianWrtVariable.kQDot,
            plant.get_body(BodyIndex(self._bodies[link])).body_frame(),
            world,
            world,
        )
        return R, J @ self._E_own

    def clearance(self, path: np.ndarray, influence: float = 0.5) -> float:
        """Return the smallest distance on points of a path [m], `influence` at most."""
        smallest, paddings = influence, np.array(self.checker.GetPaddingMatrix())
        for x in path:
            found = self.checker.CalcRobotClearance(self.configuration(x), smallest)
            pairs = zip(found.robot_indices(), found.other_indices(), strict=True)
            added = [paddings[int(a), int(b)] for a, b in pairs]
            smallest = float(np.min(np.add(found.distances(), added), initial=smallest))
        around = (each.clearance(path, smallest) for each in self._around(smallest))
        return min([smallest, *around])

    def pad(self) -> None:
        """Give links without padding to the world theirs again."""
        self._set_padding(self._checker_padding)
        self.unpadded = ()

    def _set_padding(self, padding: float) -> None:
        """Set the padding to the world of links without one [m]."""
        world = self._plant.world_body().index()
        for link in self.unpadded:
            body = BodyIndex(self._bodies[link])
            self.checker.SetPaddingBetween(body, world, padding)

    def is_free_somehow(self, x: np.ndarray) -> bool:
        """Return whether nothing collides, if need be without padding of some links.

        They are those that are always closer to the world, wherever joints are, as a
        turntable is above its ground. Until `pad` they have no padding then.
        """
        if self.is_free(x):
            return True
        self.pad()
        self.unpadded = tuple(self._find_always_close())
        self._set_padding(0.0)
        return bool(self.unpadded) and self.is_free(x)

    def _find_always_close(self) -> Iterator[str]:
        """Yield links that are closer to the world than the padding nearly always."""
        counts = dict.fromkeys(self._bodies, 0)
        links = {body: link for link, body in self._bodies.items()}
        for q in self._random_configurations():
            found = self.checker.CalcRobotClearance(q, 0.0)
            pairs = zip(found.robot_indices(), found.other_indices(), strict=True)
            for link in {links[int(a)] for a, b in pairs if int(b) not in links}:
                counts[link] += 1
        yield from (link for link, n in counts.items() if n >= _ALWAYS * _SAMPLES)

    def describe(self, x: np.ndarray) -> list[str]:
        """Return what collides at values of the planned joints, in words."""
        found = self._find_collisions(x)
        for each in self._around(self._padding):
            found |= each._find_collisions(x)
        return [
            f"{words} overlap by {-1e3 * distance:.3g} mm"
            if distance < 0.0
            else f"{words} are {1e3 * distance:.3g} mm apart"
            for words, distance in sorted(found.items(), key=lambda item: item[1])
        ]

    def _find_collisions(self, x: np.ndarray) -> dict[str, float]:
        """Return the distances of what the model's checker finds too close [m]."""
        self.checker.UpdatePositions(self.configuration(x))
        plant, query = self._plant, self._query()
        inspector = query.inspector()
        matrix = self.checker.GetFilteredCollisionMatrix()
        found: dict[str, float] = {}
        near = max(self._checker_padding, 1e-9)
        for pair in query.ComputeSignedDistancePairwiseClosestPoints(near):
            bodies = [
                plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
                for geometry in (pair.id_A, pair.id_B)
            ]
            indices = [body.index() for body in bodies]
            if matrix[tuple(map(int, indices))] != 0:
                continue
            if pair.distance > self.checker.GetPaddingBetween(*indices) + 1e-9:
                continue
            names = sorted(
                self._names[geometry.get_value()]
                if geometry.get_value() in self._names
                # Numbers tell shapes of the world apart.
                else re.sub(
                    "^(WorldModelInstance::)+|(::[0-9]+)+$",
                    "",
                    inspector.GetName(geometry),
                )
                if body.index() == plant.world_body().index()
                else body.name()
                for body, geometry in zip(bodies, (pair.id_A, pair.id_B), strict=True)
            )
            words = " and ".join(map(repr, names))
            found[words] = min(found.get(words, np.inf), pair.distance)
        return found

    def _query(self) -> QueryObject:
        """Return what is where at the last positions of the checker."""
        context = self.checker.plant_context()
        return self._plant.get_geometry_query_input_port().Eval(context)

    def _find_followers(self, robot: Robot) -> None:
        size = self._plant.num_positions()
        joints = {joint.name: joint for joint in robot.description.movable_joints}
        self._E = np.zeros((size, size))
        for name, joint in joints.items():
            master, factor, _ = last_master(joint, joints)
            self._E[self._at[name], self._at[master]] = factor
        self._own = np.array([self._at[name] for name in self.joints])
        self._E_own = self._E[:, self._own]

    def _find_weights(self, radii: Mapping[str, float | None]) -> np.ndarray:
        """Return how far a shape moves at most for each unit of a joint [m].

        `radii` are how far shapes of links are from their origins at most [m].
        """
        description = self._robot.description
        ranges = {r.name: r for r in joint_ranges(description)}
        weights = np.full(self._plant.num_positions(), _NO_WEIGHT)
        # How far any shape may be from the origin of the robot's base [m].
        self._reach = 0.0
        for link, radius in radii.items():
            if radius is None:
                continue
            for joint in joints_above(description.joints, link):
                if joint.name in self._at:
                    at = self._at[joint.name]
                    is_slide = joint.type == "prismatic"
                    weights[at] = max(weights[at], 1.0 if is_slide else radius)
                    if is_slide:
                        r = ranges[joint.name]
                        radius += max(abs(r.lower), abs(r.upper))
                radius += float(np.linalg.norm(joint.origin.position))
            self._reach = max(self._reach, radius)
        # Whether there is anything that could collide.
        self.has_shapes = bool(np.any(weights[self._own] > _NO_WEIGHT))
        return weights

    def _filter(self, robot: Robot) -> None:
        """Leave out pairs of bodies that don't matter."""
        plant, description, model = self._plant, robot.description, self._model
        matrix = np.array(self.checker.GetFilteredCollisionMatrix())
        joints = {joint.name: joint for joint in description.movable_joints}
        # By what moves them: bodies with the same joints above stay as they are to each
        # other, as a gripper's fingers on an arm do.
        movers: list[tuple[str, ...]] = [()] * plant.num_bodies()
        index = {}
        for link in description.links:
            if plant.HasBodyNamed(link, model):
                at = int(plant.GetBodyByName(link, model).index())
                index[link] = at
                movers[at] = tuple(
                    joint.name
                    for joint in joints_above(description.joints, link)
                    if joint.name in joints
                    and last_master(joint, joints)[0] in self.joints
                )
        numbers = {each: number for number, each in enumerate(dict.fromkeys(movers))}
        kinds = np.array([numbers[each] for each in movers])
        matrix[np.equal.outer(kinds, kinds) & (matrix == 0)] = 1
        self._bodies, self._filters = index, matrix
        # Neither an SRDF nor what always touches depends on the world.
        known = _disabled.setdefault(robot, {})
        key = self.joints, self._checker_padding
        if key not in known:
            disabled = find_disabled_collisions(robot, LoadReport())
            self._leave_out(disabled)
            known[key] = disabled | self._find_touching()
        self._leave_out(known[key])

    def _leave_out(self, pairs: Pairs) -> None:
        """Leave out pairs of links."""
        for one, two in pairs:
            if one in self._bodies and two in self._bodies:
                _disable(self._filters, self._bodies[one], self._bodies[two])
        self.checker.SetCollisionFilterMatrix(self._filters)

    def _random_configurations(self) -> Iterator[np.ndarray]:
        """Yield configurations of the planned joints within their limits."""
        ranges = {r.name: r for r in joint_ranges(self._robot.description)}
        low = np.array([ranges[name].lower for name in self.joints])
        high = np.array([ranges[name].upper for name in self.joints])
        rng = np.random.default_rng(0)
        for _ in range(_SAMPLES):
            yield self.configuration(rng.uniform(low, high))

    def _find_touching(self) -> Pairs:
        """Return the pairs of links that touch wherever the joints are."""
        counts = np.zeros(self._filters.shape, dtype=int)
        for q in self._random_configurations():
            found = self.checker.CalcRobotClearance(q, 0.0)
            pairs = set(zip(found.robot_indices(), found.other_indices(), strict=True))
            for a, b in {tuple(sorted(map(int, pair))) for pair in pairs}:
                counts[a, b] += 1
        links = {body: link for link, body in self._bodies.items()}
        return frozenset(
            (links[int(a)], links[int(b)])
            for a, b in np.argwhere(counts >= _ALWAYS * _SAMPLES)
            if int(a) in links and int(b) in links
        )


@functools.cache
def _spread(count: int) -> tuple[float, ...]:
    """Return parts of a line between its ends, from the middle to ever finer halves."""
    found: list[int] = []
    waiting = [(0, count)]
    for low, high in waiting:  # It grows.
        middle = (low + high) // 2
        if low < middle < high:
            found.append(middle)
            waiting += [(low, middle), (middle, high)]
    return tuple(each / count for each in found)


def add_colliding_robot(plant: MultibodyPlant, robot: Robot) -> ModelInstanceIndex:
    """Add a robot's links that collide, its base fixed."""
    description = fix_free_joints(without_shapes(robot.description, "visuals"))
    return add_robot_model(plant, description, robot.name, robot.pose)


class _Part(NamedTuple):
    """A part of a world of many shapes."""

    shapes: tuple[PlacedShape, ...]

    # How far they are from the robot's base at least [m].
    distance: float

    # None until it is within reach.
    model: CollisionModel | None


def _radius(
    plant: MultibodyPlant, scene_graph: SceneGraph, link: str, model: ModelInstanceIndex
) -> float | None:
    """Return how far a link's shapes are from its origin at most [m]."""
    inspector = scene_graph.model_inspector()
    reaches = [
        _reach(inspector.GetShape(each), inspector.GetPoseInFrame(each))
        for each in plant.GetCollisionGeometriesForBody(
            plant.GetBodyByName(link, model)
        )
        if not isinstance(inspector.GetShape(each), HalfSpace)
    ]
    return max(reaches, default=None)


def _reach(shape: Shape, pose: RigidTransform) -> float:
    """Return how far a shape at a pose is from the origin at most [m]."""
    box = CalcObb(shape)
    X = pose @ box.pose()
    corners = np.array(list(itertools.product((-1, 1), repeat=3)))
    points = [X.multiply(corner * np.array(box.half_width())) for corner in corners]
    return float(np.linalg.norm(points, axis=1).max())


def _differ(one: Sequence[PlacedShape], other: Sequence[PlacedShape]) -> bool:
    """Return whether shapes are others, or elsewhere."""
    if len(one) != len(other):
        return True
    return any(
        (a.name, a.link) != (b.name, b.link)
        or type(a.shape) is not type(b.shape)
        or not a.pose.IsNearlyEqualTo(b.pose, _SAME_PLACE)
        for a, b in zip(one, other, strict=True)
    )


def _disable(matrix: np.ndarray, one: int, two: int) -> None:
    if matrix[one, two] == 0:
        matrix[one, two] = matrix[two, one] = 1


# The pairs of links that a robot's models leave out, by their joints and paddings.
_disabled: "weakref.WeakKeyDictionary[Robot, dict[tuple[object, ...], Pairs]]" = (
    weakref.WeakKeyDictionary()
)

# The latest models, of all robots. A model has its robot, so robots can't be weak keys:
# none would ever go.
_models: dict[tuple[object, ...], CollisionModel] = {}


def collision_model(
    robot: Robot,
    joints: Sequence[str],
    world: World,
    *,
    padding: float,
    positions: Mapping[str, float],
    things: Sequence[PlacedShape] = (),
) -> CollisionModel:
    """Return a model, one that is known where nothing but what moves differs.

    Building one takes half a second.
    """
    key = (robot, tuple(joints), _identity(world), padding)
    model = _models.pop(key, None)
    if model is None:
        model = CollisionModel(
            robot, joints, world, padding=padding, positions=positions
        )
    model.pad()
    model.set_positions(positions)
    model.set_things(things)
    _models[key] = model
    while len(_models) > _KEPT:
        del _models[next(iter(_models))]
    return model


def _identity(world: World) -> object:
    """Return a key of a world, which changes with its file."""
    if isinstance(world, str | Path):
        file = Path(world).expanduser()
        return world, file.stat().st_mtime_ns if file.is_file() else 0
    return id(world) if isinstance(world, LoadedWorld) else world
