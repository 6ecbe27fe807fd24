"""An arm with its gripper in a simulation: what is there, ways to it, and motions.

Motions are generators of the times until which to simulate, so that whoever runs the
simulation does so. What is known of the scene is read from the simulation.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.geometry import Box, SceneGraph, SceneGraphInspector
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RigidBody

from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.manipulation.activities import (
    LOOK,
    Activity,
    Failure,
    Runner,
    choose_robot,
    find_drive,
    is_positive,
)
from arm_drake.perception.boxes import FoundBox
from arm_drake.planning.grasps import (
    Grasp,
    GraspedShape,
    explain_no_grasp,
    find_grasps,
)
from arm_drake.planning.grippers import Gripper, find_gripper
from arm_drake.planning.groups import WHOLE_POSE
from arm_drake.planning.inverse_kinematics import (
    NoSolution,
    find_reach,
    forward_kinematics,
    solve_ik,
)
from arm_drake.planning.motion_planning import Plan, plan
from arm_drake.planning.orientation_constraint import OrientationConstraint
from arm_drake.planning.setting import PlanningError, find_moving
from arm_drake.plant.plant import read_pose
from arm_drake.worlds.things import free_bodies

# A gripper has stalled if it moves by less than a part of its stroke per second for a
# while [s]; it has so long at most [s].
_STALLED, _STALL_TIME, _GRIPPER_PATIENCE = 0.02, 0.2, 6.0

# How long fingers may press on before they move [s]: those that close, and those that
# let go, with a target that comes back from behind a thing at its own speed.
_BEGIN, _LET_GO = 0.3, 2.0

# Distance that counts as a collision on straight ways to things and from them, and on
# other ways, if there are any that keep it [m].
_CLOSE, _FAR = 1e-3, 5e-3

# Joints that an arm needs to turn its gripper as it is asked to, and how nearly an axis
# of the gripper has to be one of the palm for the turn about it to be left out.
_TURNING, _ALONG = 6, 0.998

# How much fingers may be turned from the faces that they press on, and tilted along
# them by arms of five joints [rad].
_SKEW, _TILT = 0.12, 0.4

# Grasps whose reach is looked at, the best ones.
_LOOKED_AT = 40

# Turns of a thing that are tried where any will do.
_GOAL_TURNS = 8

# How much of the way back is tried.
_PARTS = (1.0, 0.6, 0.3)

# How far fingers open on either side to let go [m].
_RELEASE = 6e-3


@dataclass(frozen=True, kw_only=True)
class PickOptions:
    """Options of picking and placing: keyword arguments of `pick` and `place`."""

    # Which robot of the simulation, and which of its arms; None is the first.
    robot: str | None = None
    group: str | None = None

    # Where the thing is to be placed later: only grasps from which the arm reaches that
    # are taken. A pose as that of `place`; None is anywhere.
    goal: RigidTransform | Sequence[float] | None = None

    # To pick: the box as a camera saw it, in the world. Its pose and size are taken
    # from there; None is as the simulation knows them.
    seen: FoundBox | None = None

    # To pick: a camera of the simulation that looks for the box, before each grasp.
    # Labels tell which pixels show it, and which the robot; all else is from depths.
    camera: str | None = None

    # To place: the pose of the thing in the palm, as the result of a pick with `seen`
    # says; None is as the simulation knows it.
    held: RigidTransform | None = None

    # How far from a grasp its approach begins, how high things are lifted, and how far
    # the gripper draws back [m].
    approach: float = 0.05
    lift: float = 0.05
    retreat: float = 0.05

    # Grasps to try at most.
    tries: int = 4

    # How far the thing may tilt while it is carried [rad]; None is as far as it likes.
    upright: float | None = None

    # Parts of the joints' speed and acceleration to use.
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0

    # How long to look for a way, as that of `plan`, and the seed of the search.
    time_limit: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for what can't be."""
        for name in ("approach", "lift", "retreat"):
            if not is_positive(getattr(self, name)):
                value = getattr(self, name)
                raise InputError(f"{name}: expected a distance [m], got {value!r}")
        for name in ("robot", "group", "camera"):
            value = getattr(self, name)
            if not isinstance(value, str | None):
                raise InputError(f"{name}: expected a name, got {value!r}")
        if isinstance(self.tries, bool) or not isinstance(self.tries, int):
            raise InputError(f"tries: expected a number, got {self.tries!r}")
        if self.tries < 1:
            raise InputError(f"tries: expected at least 1, got {self.tries}")
        if self.upright is not None and not is_positive(self.upright):
            raise InputError(f"upright: expected an angle [rad], got {self.upright!r}")
        if self.goal is not None:
            read_goal(self.goal)
        if not isinstance(self.held, RigidTransform | None):
            raise InputError(f"held: expected a RigidTransform, got {self.held!r}")
        if self.seen is not None:
            if not hasattr(self.seen, "reason"):
                text = f"expected what find_box returns, got {self.seen!r}"
                raise InputError(f"seen: {text}")
            if self.seen.pose is None or self.seen.size is None:
                raise InputError(f"seen: it is no box: {self.seen.reason}")
        if self.seen is not None and self.camera is not None:
            raise InputError("seen: the camera says where the box is; leave one out")


class Place(NamedTuple):
    """Goal pose of a thing, and whether it may be turned there."""

    X_WG: RigidTransform
    turns: bool

    def poses(self, X_WO: RigidTransform, base: np.ndarray) -> Iterator[RigidTransform]:
        """Yield poses of a thing: as it stands now, then turned about the vertical.

        Before others it is turned as an arm does that turns at its base, a point (3,).
        """
        if not self.turns:
            yield self.X_WG
            return
        thing, goal = X_WO.translation() - base, self.X_WG.translation() - base
        with_arm = math.atan2(goal[1], goal[0]) - math.atan2(thing[1], thing[0])
        step = 2.0 * math.pi / _GOAL_TURNS
        # 0, then 45, -45, 90, ... degrees.
        others = [(n + 1) // 2 * (-1) ** n * step for n in range(1, _GOAL_TURNS)]
        for angle in (0.0, with_arm, *others):
            R = RotationMatrix.MakeZRotation(angle)
            yield RigidTransform(R @ X_WO.rotation(), self.X_WG.translation())


def read_goal(pose: RigidTransform | Sequence[float]) -> Place:
    """Return where a thing is to be placed, or raise InputError."""
    is_position = isinstance(pose, Sequence | np.ndarray) and len(pose) == 3
    whole = [*pose, 0.0, 0.0, 0.0] if is_position else pose
    return Place(read_pose(whole), is_position)


def shifted(X: RigidTransform, by: Sequence[float] | np.ndarray) -> RigidTransform:
    """Return a pose that is moved in the world [m]."""
    return RigidTransform(X.rotation(), X.translation() + np.asarray(by))


class Hand:
    """A robot's arm with its gripper, and what it can do."""

    def __init__(self, simulation: Runner, options: PickOptions) -> None:
        """Take a robot's arm, or raise InputError if none has a gripper."""
        self.simulation, self.options = simulation, options
        self.robot, prefix = choose_robot(simulation, options.robot)
        self.gripper: Gripper = find_gripper(self.robot, options.group)
        self._mask = self._find_mask()
        self._arm = find_drive(
            simulation, self.robot, prefix, self.gripper.group.joints
        )
        self._fingers = find_drive(
            simulation, self.robot, prefix, tuple(self.gripper.open)
        )
        camera = options.camera
        self.camera = None if camera is None else simulation.camera(camera)
        # What a camera saw of the thing, if one is asked.
        self.seen = options.seen

    def _find_mask(self) -> tuple[bool, ...]:
        """Return the axes of a pose that the arm keeps: with few joints one turn less.

        Four hold the gripper in the plane of the arm, and so say how it is turned about
        its approach. Five tilt it in that plane; faces stay on the fingers if that is
        about the axis along which they close.
        """
        joints = len(self.gripper.group.joints)
        is_planar = joints < _TURNING - 1
        gripper = self.gripper
        axis = np.abs(gripper.approach_axis if is_planar else gripper.closing_axis)
        if joints >= _TURNING or axis.max() < _ALONG:
            return WHOLE_POSE
        free = 3 + int(axis.argmax())
        return tuple(row != free for row in range(6))

    def find_thing(self, name: str) -> str:
        """Return the name of a body that can move, or raise InputError."""
        names = [body.name() for body in self._things()]
        if name not in names:
            hint = suggest(str(name), names) if names else "there is none"
            raise InputError(f"no thing {name!r} that could be moved; {hint}")
        return name

    def _things(self) -> Iterator[RigidBody]:
        return free_bodies(self.simulation.plant, self.simulation.robots)

    def pose_of(self, thing: str) -> RigidTransform:
        """Return the pose of a thing in the world."""
        return self._pose(next(b for b in self._things() if b.name() == thing))

    def known_pose_of(self, thing: str) -> RigidTransform:
        """Return the pose of a thing in the world, as it was seen if it was."""
        seen = self.seen
        return self.pose_of(thing) if seen is None or not seen.pose else seen.pose

    def known_pose_in_palm(self, thing: str) -> RigidTransform:
        """Return the pose of a held thing in the palm, as the options have it."""
        X_PO = self.options.held
        return self.pose_in_palm(thing) if X_PO is None else X_PO

    def palm(self) -> RigidTransform:
        """Return the pose of the palm in the world."""
        return self._pose(self._body(self.gripper.palm))

    def base(self) -> np.ndarray:
        """Return where the arm's first joint is in the world [m], shape (3,)."""
        plant = self.simulation.plant
        model = plant.GetModelInstanceByName(self.robot.name)
        joint = plant.GetJointByName(self.gripper.group.joints[0], model)
        context = plant.GetMyContextFromRoot(self.simulation.context)
        X = joint.frame_on_parent().CalcPoseInWorld(context)
        return np.array(X.translation())

    def pose_in_palm(self, thing: str) -> RigidTransform:
        """Return the pose of a thing in the palm."""
        return self.palm().inverse() @ self.pose_of(thing)

    def _body(self, link: str) -> RigidBody:
        plant = self.simulation.plant
        model = plant.GetModelInstanceByName(self.robot.name)
        return plant.GetBodyByName(link, model)

    def _inspector(self) -> SceneGraphInspector:
        scene_graph = self.simulation.diagram.GetSubsystemByName("scene_graph")
        assert isinstance(scene_graph, SceneGraph)
        return scene_graph.model_inspector()

    def _pose(self, body: RigidBody) -> RigidTransform:
        plant = self.simulation.plant
        context = plant.GetMyContextFromRoot(self.simulation.context)
        return RigidTransform(plant.EvalBodyPoseInWorld(context, body))

    def _shape_of(self, thing: str) -> tuple[GraspedShape, RigidTransform]:
        """Return the shape of a thing, and its pose on the body."""
        if self.seen is not None and self.seen.size is not None:
            return Box(self.seen.size), RigidTransform()
        body = next(b for b in self._things() if b.name() == thing)
        shapes = self.simulation.plant.GetCollisionGeometriesForBody(body)
        if len(shapes) != 1:
            raise InputError(
                f"thing {thing!r} has {len(shapes)} collision shapes; grasps are "
                "found for one"
            )
        inspector = self._inspector()
        shape = inspector.GetShape(shapes[0])
        return shape, RigidTransform(inspector.GetPoseInFrame(shapes[0]))

    def choose(
        self, thing: str, tried: Sequence[Grasp]
    ) -> tuple[Grasp, Mapping[str, float]] | str:
        """Return the best new grasp and where it begins, or why none is found.

        The arm gets there on a straight line, lifts the thing, and does so at its goal.
        """
        shape, X_OG = self._shape_of(thing)
        X_WO = self.known_pose_of(thing)
        grasps = find_grasps(self.gripper, shape, X_WO, X_OG=X_OG)
        if not grasps:
            return f"{thing!r}: {explain_no_grasp(self.gripper, shape)}"
        none = f"grasps of {thing!r} the arm reaches none"
        if reason := self._explain_distance(X_WO, grasps):
            return f"of {len(grasps)} {none}: {reason}"
        seen = 0
        # By what was done, the first one: those that fail at the goal got further.
        reasons: dict[str, str] = {}
        rejected: list[tuple[RigidTransform, Failure]] = []
        for grasp in grasps:
            if any(is_near(grasp.X_OP, other.X_OP) for other in tried):
                continue
            if seen >= _LOOKED_AT:
                break
            seen += 1
            X_WP = X_WO @ grasp.X_OP
            back = X_WO.rotation().matrix() @ grasp.approach
            before = shifted(X_WP, -self.options.approach * back)
            up = shifted(X_WP, [0.0, 0.0, self.options.lift])
            closed = self.gripper.positions(grasp.pre_grasp)
            try:
                starts = self.solve(X_WP)
                self._check_goal(X_WO, grasp, thing, rejected)
                found = self.find_way(starts, [before, up], thing, closed)
            except Failure as failure:
                reasons.setdefault(failure.stage, failure.reason)
                continue
            return grasp, found
        if not seen:
            return f"all {len(tried)} grasps of {thing!r} were tried"
        return f"of {seen} {none}: {reasons.get('goal') or reasons['reach']}"

    def _explain_distance(self, X_WO: RigidTransform, grasps: Sequence[Grasp]) -> str:
        """Return why no grasp is reached, if it is too far off, here or at its goal.

        X_WO: The pose of the thing.
        """
        joints = self.gripper.group.joints
        place, reach = find_reach(self.robot, self.gripper.palm, joints)
        reach += max(float(np.linalg.norm(g.X_OP.translation())) for g in grasps)
        poses = {"": X_WO}
        if self.options.goal is not None:
            poses["at its goal: "] = read_goal(self.options.goal).X_WG
        for where, X in poses.items():
            if np.linalg.norm(X.translation() - self._moved() @ place) > reach:
                try:
                    self.solve(X @ grasps[0].X_OP)
                except Failure as failure:
                    return f"{where}{failure.reason}"
        return ""

    def _check_goal(
        self,
        X_WO: RigidTransform,
        grasp: Grasp,
        thing: str,
        rejected: list[tuple[RigidTransform, Failure]],
    ) -> None:
        """Raise Failure if a grasp can't get to the goal; none of `rejected` could."""
        if self.options.goal is None:
            return
        failures = []
        for X_WG in read_goal(self.options.goal).poses(X_WO, self.base()):
            X_WP = X_WG @ grasp.X_OP
            known = next((f for X, f in rejected if is_near(X, X_WP)), None)
            try:
                if known is None:
                    self.find_way(self.solve(X_WP), self.retreat_poses(X_WP), thing)
                    return
            except Failure as failure:
                rejected.append((X_WP, known := failure))
            failures.append(known)
        raise Failure("goal", f"at its goal: {failures[0].reason}")

    def retreat_poses(self, X_WP: RigidTransform) -> list[RigidTransform]:
        """Return where the palm is above the place of a thing, and drawn back."""
        options = self.options
        back = X_WP.rotation().matrix() @ self.gripper.approach_axis
        return [
            shifted(X_WP, [0.0, 0.0, options.lift]),
            shifted(X_WP, -_PARTS[-1] * options.retreat * back),
        ]

    def find_way(
        self,
        starts: Sequence[Mapping[str, float]],
        lines: Sequence[RigidTransform],
        thing: str,
        fingers: Mapping[str, float] | None = None,
    ) -> Mapping[str, float]:
        """Return where the palm comes from on a straight line, or raise Failure.

        `starts` are joint positions where it goes, and `lines` poses: where it comes
        from, then others that it gets to. It may touch the thing.
        """
        reasons = []
        for start in starts:
            own = {**start, **(fingers or self.gripper.open)}
            try:
                ways = [
                    self._plan(to, straight=True, ignore=[thing], start=own)
                    for to in lines
                ]
            except (PlanningError, NoSolution) as error:
                # The line is planned from where it ends.
                refusal = "the robot would be in collision there"
                reasons.append(str(error).replace("the start is in collision", refusal))
                continue
            return ways[0].end
        raise Failure("reach", reasons[0])

    def solve(self, X_WP: RigidTransform) -> list[dict[str, float]]:
        """Return positions of the arm's joints for a pose, the nearest first."""
        palm, joints = self.gripper.palm, self.gripper.group.joints
        # Where it would be if the base hadn't moved.
        X_WP = self._moved().inverse() @ X_WP
        try:
            solution = solve_ik(
                self.robot,
                palm,
                X_WP,
                seed=self._positions(),
                group=joints,
                mask=self._mask,
                collision_free=True,
                all_solutions=True,
            )
        except NoSolution as error:
            raise Failure("reach", str(error)) from None
        X = forward_kinematics(self.robot, solution.positions, palm)
        _, miss = distance(X, X_WP)
        if miss > (_TILT if len(joints) == _TURNING - 1 else _SKEW):
            text = f"the arm holds {palm!r} turned by {miss:.2f} rad there"
            raise Failure("reach", text)
        every = (solution.positions, *solution.others)
        return [{name: each[name] for name in joints} for each in every]

    def _moved(self) -> RigidTransform:
        """Return how the robot's base has moved from where it was loaded."""
        if not self.robot.has_free_base:
            return RigidTransform()
        base = self.robot.description.base
        before = forward_kinematics(self.robot, self._positions(), base)
        return self._pose(self._body(base)) @ before.inverse()

    def _positions(self) -> dict[str, float]:
        """Return where the robot's independent joints are [rad] or [m]."""
        state = self.simulation.joint_states(self.robot.name)
        own = {joint.name for joint in self.robot.description.independent_joints}
        rows = zip(state.name, state.position, strict=True)
        return {name: position for name, position in rows if name in own}

    def width(self) -> float:
        """Return how far the pads are apart [m]."""
        return self.gripper.width_at(self._positions())

    def release(self) -> float:
        """Return how far the gripper is closed when it has let go of what it holds."""
        return self.gripper.at(self.width() + 2.0 * _RELEASE).closed

    def find_held(self) -> str | None:
        """Return the thing that both fingers press on, if any."""
        sides = [
            {int(self._body(link).index()) for link in links}
            for links in self.gripper.fingers
        ]
        touched: list[set[int]] = [set(), set()]
        for one, other in self._contacts():
            for side, links in enumerate(sides):
                if one in links:
                    touched[side].add(other)
                if other in links:
                    touched[side].add(one)
        for body in self._things():
            if int(body.index()) in touched[0] & touched[1]:
                return str(body.name())
        return None

    def _contacts(self) -> Iterator[tuple[int, int]]:
        """Yield the bodies that touch now, by their indices."""
        plant = self.simulation.plant
        context = plant.GetMyContextFromRoot(self.simulation.context)
        results = plant.get_contact_results_output_port().Eval(context)
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            yield int(info.bodyA_index()), int(info.bodyB_index())
        inspector = self._inspector()
        for index in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(index).contact_surface()
            one, other = (
                int(plant.GetBodyFromFrameId(inspector.GetFrameId(g)).index())
                for g in (surface.id_M(), surface.id_N())
            )
            yield one, other

    def move(
        self,
        to: RigidTransform | Mapping[str, float],
        stage: str,
        *,
        straight: bool = False,
        ignore: Sequence[str] = (),
        attached: str | None = None,
    ) -> Activity[None]:
        """Plan a motion of the arm and follow it, or raise Failure."""
        more: dict[str, Any] = {}
        if attached is not None:
            more["attached"] = {self.gripper.palm: attached}
            if self.options.upright is not None:
                limit = self.options.upright
                constraint = OrientationConstraint(self.gripper.palm, limit)
                more["path_constraint"] = constraint
        yield from self._settle()
        reasons = []
        # What the arm gets to on a straight line may be nearer than other ways keep.
        for padding in (_CLOSE,) if straight else (_FAR, _CLOSE):
            try:
                found = self._plan(
                    to, straight=straight, ignore=ignore, padding=padding, **more
                )
                break
            except (PlanningError, NoSolution) as error:
                reasons.append(str(error))
        else:
            raise Failure(stage, reasons[0])
        yield from self._arm.follow(self.simulation, found, stage)
        yield from self._settle()

    def _plan(
        self,
        to: RigidTransform | Mapping[str, float],
        *,
        straight: bool,
        ignore: Sequence[str],
        padding: float = _CLOSE,
        **more: Any,
    ) -> Plan:
        """Return a plan for the palm, or joints."""
        options = self.options
        return plan(
            self.simulation,
            to,
            name=self.robot.name,
            group=self.gripper.group.joints,
            frame=self.gripper.palm,
            straight=straight,
            ignore=ignore,
            mask=self._mask,
            padding=padding,
            velocity_scaling=options.velocity_scaling,
            acceleration_scaling=options.acceleration_scaling,
            time_limit=options.time_limit,
            seed=options.seed,
            **more,
        )

    def draw_back(self, thing: str) -> Activity[None]:
        """Move the open gripper straight back from a thing, as far as it gets."""
        X = self.palm()
        back = -(X.rotation().matrix() @ self.gripper.approach_axis)
        for part in _PARTS:
            to = shifted(X, part * self.options.retreat * back)
            try:
                yield from self.move(to, "", straight=True, ignore=[thing])
            except Failure as failure:
                last = failure
            else:
                return
        raise last

    def _settle(self) -> Activity[None]:
        """Wait until the arm rests."""
        end = self.simulation.time + 2.0
        while self.simulation.time < end:
            state = self.simulation.joint_states(self.robot.name)
            if not find_moving(state):
                return
            yield self.simulation.time + LOOK

    def move_gripper(
        self, closed: float, stage: str, *, needs_stall: bool = False
    ) -> Activity[None]:
        """Move the fingers, 0 is open and 1 closed, until they arrive or stall."""
        simulation, gripper = self.simulation, self.gripper
        goal = gripper.positions(closed)
        start = self._positions()
        yield from self._fingers.lead(simulation, start, goal)
        span = max(abs(gripper.closed[n] - gripper.open[n]) for n in goal)
        largest = max(abs(goal[n] - start[n]) for n in goal)
        if largest < 0.01 * span and not needs_stall:
            return
        begun, still, before = simulation.time, simulation.time, start
        while simulation.time < begun + _GRIPPER_PATIENCE:
            yield simulation.time + LOOK
            now = self._positions()
            moved = max(abs(now[n] - before[n]) for n in goal)
            if moved > _STALLED * span * LOOK:
                still = simulation.time
            before = now
            has_arrived = max(abs(goal[n] - now[n]) for n in goal) < _STALLED * span
            patience = _BEGIN if needs_stall or has_arrived else _LET_GO
            if simulation.time - max(still, begun + patience) >= _STALL_TIME:
                return
        raise Failure(stage, "the fingers neither arrive nor stall")


def distance(one: RigidTransform, other: RigidTransform) -> tuple[float, float]:
    """Return how far poses are apart [m], and turned from each other [rad]."""
    miss = one.inverse() @ other
    angle = float(miss.rotation().ToAngleAxis().angle())
    return float(np.linalg.norm(miss.translation())), angle


def is_near(one: RigidTransform, other: RigidTransform) -> bool:
    """Return whether two poses are nearly the same."""
    away, turn = distance(one, other)
    return away < 1e-3 and turn < 0.05
