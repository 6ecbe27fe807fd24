"""tune_gains: gains of a robot's PIDs from its mass matrix, polished over rollouts.

A joint with the inertia m, in the pose where that is largest, and a PID with

    p = a m w²    i = c m w³    d = b m w - damping

has the characteristic polynomial s³ + b w s² + a w² s + c w³: all it does scales with
the bandwidth w. That is as large as what is asked needs, and not larger than the effort
limit and the controller's rate allow in the pose where the inertia is least. Then w and
(a, b, c) are changed, all joints' at once and one by one, as long as moves in several
poses with several payloads get better.
"""

import contextlib
import dataclasses as dc
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydrake.multibody.tree import JacobianWrtVariable

from arm_drake.arrays import Array
from arm_drake.batch.api import Progress, iterate_many, run_many
from arm_drake.batch.changes import Gains, Pid, find_pids, with_gains, yaml_gains
from arm_drake.controllers.gazebo.plugin import position_topic, velocity_topic
from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.drive_gains import simulator_of
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import CLASSIC
from arm_drake.diagram import build_diagram
from arm_drake.errors import ArmDrakeError, InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import unit_of_all
from arm_drake.messages import (
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
    Twist,
    Vector3,
)
from arm_drake.options import GRAVITY, SimulationOptions
from arm_drake.plant.joint_dynamics import velocity_map
from arm_drake.plant.joint_ranges import find_gripper_joints, joint_ranges, randomize
from arm_drake.plant.payloads import check_link
from arm_drake.plant.plant import trial_plant
from arm_drake.simulation.simulation import Simulation

# Shapes (a, b, c) of the polynomial: three equal roots; less and hardly any integral.
_SHAPES = ((3.0, 3.0, 1.0), (2.0, 3.0, 0.35), (1.0, 2.0, 0.1))

# Bandwidths that are tried, over that which settles in time; and how far beyond what
# effort limit and rate allow in the worst pose.
_SCALES = ((1.0, 1.0), (1.5, 1.0), (1.0, 3.0), (1.5, 3.0), (2.3, 3.0), (4.0, 10.0))

# A triple root at w has settled within 5 % after this over w.
_SETTLES = 6.3

# Largest derivative gain over m / period: from 2 on, a sampled velocity's loop grows.
_MOST_DAMPING = 1.0

# Steps of the moves [rad, m]; within this part of it a joint has settled. Of a base
# [m/s].
_STEP, _BAND, _SPEED = 0.3, 0.05, 0.2
_STEP_OF_RANGE = 0.15

# How often a base is told its velocity [s].
_AGAIN = 0.1

# How many poses the mass matrix is sampled in.
_NUM_SAMPLES = 200

# How a round of the polish changes bandwidths.
_ROUNDS = (1.5, 1.25, 1.12)

# Figures that are this good count alike [rad, m].
_END = 0.002

# A figure that is worse counts no more: it has failed.
_WORST = 50.0


class Response(NamedTuple):
    """Step response of joints; of several moves the worst of each figure."""

    # Largest error at the end [rad, m, or their rates].
    end_error: float

    # How far beyond its target a joint comes, of its step.
    overshoot: float

    # When the last joint has come to stay within 5 % of its step [s].
    settling_time: float

    def is_better(self, other: "Response") -> bool:
        """Return whether all three are."""
        return all(mine < theirs for mine, theirs in zip(self, other, strict=True))

    def __str__(self) -> str:
        """Return it in words."""
        return self.describe()

    def describe(self, unit: str = "") -> str:
        """Return it in words, with the unit of its error if that is given."""
        error = f"{self.end_error:.4f} {unit}".rstrip()
        return (
            f"end error {error}, overshoot {100 * self.overshoot:.1f} %, "
            f"settled {self.settling_time:.2f} s"
        )


class Move(NamedTuple):
    """A step in a pose, with what is carried."""

    # Positions of all independent joints [rad, m]; steps of those that are tuned.
    start: Mapping[str, float]
    steps: tuple[float, ...]

    # Mass by link [kg].
    payloads: Mapping[str, float]


# Gains by joint, and a move to try them in.
_Task = tuple[Mapping[str, Gains], Move]


class Trace(NamedTuple):
    """Motion of joints in a move."""

    # Shapes (k,), (k, n) and (n,); what is measured starts at 0.
    time: Array
    moved: Array
    steps: Array

    def response(self) -> Response:
        """Return its figures."""
        size = np.abs(self.steps)
        error = (self.moved - self.steps) * np.sign(self.steps)
        if not np.isfinite(error).all():
            return Response(math.inf, math.inf, math.inf)
        late = np.flatnonzero((np.abs(error) > _BAND * size).any(axis=1))
        end = min(late[-1] + 1, len(self.time) - 1) if late.size else 0
        return Response(
            float(np.abs(error[-1]).max()),
            float(max(0.0, (error / size).max())),
            float(self.time[end]),
        )


@dataclass(frozen=True, eq=False)
class Tuning:
    """Result of `tune_gains`."""

    # The robot with the new gains.
    robot: Robot

    # Whose PIDs they are, with the gains before; and the new ones by joint.
    pids: tuple[Pid, ...]
    gains: Mapping[str, Gains]

    # The worst of moves in poses and with payloads that were not tuned for.
    before: Response
    after: Response

    # Of one of those moves.
    trace_before: Trace
    trace_after: Trace

    # What was asked for: settling time [s], and overshoot of a step.
    settle: float
    overshoot: float

    # How many rollouts it took.
    num_rollouts: int

    @property
    def keeps_promise(self) -> bool:
        """Whether the requested figures hold in the moves that were not tuned for."""
        after = self.after
        return after.settling_time <= self.settle and after.overshoot <= self.overshoot

    @property
    def error_unit(self) -> str:
        """Unit of the errors at the end."""
        types = [self.robot.description.joint(pid.joint).type for pid in self.pids]
        return unit_of_all(self.pids[0].quantity, types)

    def to_text(self) -> str:
        """Return the gains as YAML, or as the plugins' tags, with what they promise."""
        after, before = (
            each.describe(self.error_unit) for each in (self.after, self.before)
        )
        promise = f"{self.robot.name}: {after} (before: {before})"
        kind = self.pids[0].kind
        if kind == "plugin":
            tags = "".join(_tags_of(pid, self.gains) for pid in self.pids)
            return f"<!-- {promise} -->\n<robot>\n{tags}</robot>\n"
        return f"# {promise}\n" + yaml.safe_dump(self._to_yaml(), sort_keys=False)

    def _to_yaml(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for pid in self.pids:
            rounded = Gains(*(float(f"{x:.5g}") for x in self.gains[pid.joint]))
            if pid.kind == "parameters":
                node = found.setdefault(pid.controller, {"gains": {}})
                node["gains"][pid.joint] = yaml_gains(rounded)
                continue
            node = found.setdefault("gazebo_ros2_control", {"pid_gains": {}})
            joints = node["pid_gains"].setdefault(pid.quantity, {})
            joints[pid.joint] = {
                "kp": rounded.p,
                "ki": rounded.i,
                "kd": rounded.d,
                "max_integral_error": rounded.i_clamp,
                "min_integral_error": -rounded.i_clamp,
            }
        return {name: {"ros__parameters": node} for name, node in found.items()}


def _tags_of(pid: Pid, gains: Mapping[str, Gains]) -> str:
    """Return the tags of a plugin with new gains."""
    name = "Position" if pid.quantity == "position" else ""
    lower = "position-" if name else ""
    new = gains[pid.joint]
    tags = {"p_gain": new.p, "i_gain": new.i, "d_gain": new.d}
    if math.isfinite(new.i_clamp):
        tags |= {"i_max": new.i_clamp, "i_min": -new.i_clamp}
    else:
        tags |= {"i_max": -1.0, "i_min": 0.0}
    lines = "".join(f"      <{tag}>{x:.5g}</{tag}>\n" for tag, x in tags.items())
    return (
        f'  <gazebo>\n    <plugin filename="gz-sim-joint-{lower}controller-system"\n'
        f'            name="gz::sim::systems::Joint{name}Controller">\n'
        f"      <joint_name>{pid.joint}</joint_name>\n{lines}    </plugin>\n"
        "  </gazebo>\n"
    )


def tune_gains(
    robot: Robot,
    controller: str | None = None,
    *,
    settle: float = 0.3,
    overshoot: float = 0.02,
    robust_to: Mapping[str, tuple[float, float]] | None = None,
    joints: Sequence[str] | None = None,
    moves: int = 4,
    seed: int = 0,
    options: SimulationOptions | None = None,
    on: Any = None,
    progress: bool | None = None,
) -> Tuning:
    """Return gains of a robot's PIDs that settle a step in time without overshoot.

    Args:
        robot: The robot, with a controller that has PIDs: Gazebo's plugins of joints,
            a trajectory or PID controller of efforts, or joints of Gazebo Classic.
        controller: Whose; by default all of the robot.
        settle: When steps are to have settled within 5 % [s].
        overshoot: How far a joint may come beyond its target, of its step.
        robust_to: "payload", or links, each with the least and largest mass there [kg];
            "payload" is one on the last link that the joints move.
        joints: Which joints; by default all but those of grippers.
        moves: How many moves each trial has; as many others judge the result.
        seed: Of the poses.
        options: How to simulate.
        on: Where rollouts are executed, as for `run_many`.
        progress: Whether to tell how far it is, as for `run_many`.

    Raises:
        InputError: If there are no PIDs, or a joint can't hold the robot's weight.
    """
    _check_positive(settle=settle, overshoot=overshoot)
    pids = _choose_pids(robot, controller, joints)
    payloads = _payload_ranges(robot, pids, robust_to or {})
    rig = _Rig(robot, tuple(pids), settle, options or SimulationOptions())
    trained = _make_moves(rig, payloads, moves, seed)
    unseen = _make_moves(rig, payloads, moves, seed + 1_000_003)
    search = _Search(rig, _sample_plants(rig, payloads), trained, overshoot)
    num_rollouts = search.num_rollouts + 2 * len(unseen)
    with contextlib.closing(Progress(num_rollouts, progress)) as bar:
        follow = functools.partial(_follow_all, rig, on, bar)
        gains = search.run(follow)
        now = {pid.joint: pid.gains for pid in pids}
        traces = follow([(each, move) for each in (now, gains) for move in unseen])
    before, after = traces[: len(unseen)], traces[len(unseen) :]
    return Tuning(
        with_gains(robot, gains, pids),
        tuple(pids),
        gains,
        worst(before),
        worst(after),
        before[0],
        after[0],
        settle,
        overshoot,
        num_rollouts,
    )


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise InputError(f"{name}: expected a number above 0, got {value!r}")


def _follow_all(
    rig: "_Rig", on: Any, bar: Progress, tasks: Sequence[_Task]
) -> list[Trace]:
    """Return what joints do in moves with gains, and count them."""
    results = []
    for result in iterate_many(tasks, rig.follow, on=on, progress=False):
        bar.add(failed=result.error is not None)
        results.append(result)
    return [result.value for result in results]


def worst(traces: Sequence[Trace]) -> Response:
    """Return the worst of each figure."""
    return Response(*map(max, zip(*(t.response() for t in traces), strict=True)))


def measure_gains(
    robot: Robot,
    controller: str | None = None,
    *,
    robust_to: Mapping[str, tuple[float, float]] | None = None,
    joints: Sequence[str] | None = None,
    settle: float = 0.3,
    moves: int = 4,
    seed: int = 0,
    options: SimulationOptions | None = None,
) -> Response:
    """Return how a robot does with its gains in the moves that judge `tune_gains`.

    The arguments are those of `tune_gains`.
    """
    pids = _choose_pids(robot, controller, joints)
    payloads = _payload_ranges(robot, pids, robust_to or {})
    rig = _Rig(robot, tuple(pids), settle, options or SimulationOptions())
    now = {pid.joint: pid.gains for pid in pids}
    unseen = _make_moves(rig, payloads, moves, seed + 1_000_003)
    tasks = [(now, move) for move in unseen]
    return worst(run_many(tasks, rig.follow, progress=False).values)


def _choose_pids(
    robot: Robot, controller: str | None, joints: Sequence[str] | None
) -> list[Pid]:
    found = find_pids(robot, controller) or list(_missing_pids(robot))
    if not found:
        text = f"robot {robot.name!r} has no PIDs that push joints"
        raise InputError(f"{text}; its joints follow commands by themselves")
    names = [pid.joint for pid in found]
    if joints is None:
        grippers = {joint.name for joint in find_gripper_joints(robot)}
        mimics = {j.name for j in robot.description.movable_joints if j.mimic}
        joint_names = [name for name in names if name not in grippers | mimics] or names
    else:
        joint_names = list(joints)
        for name in joint_names:
            if name not in names:
                raise InputError(f"joint {name!r} has no PID; {suggest(name, names)}")
    chosen = [pid for pid in found if pid.joint in joint_names]
    return [pid for pid in chosen if pid.kind == chosen[0].kind]


def _missing_pids(robot: Robot) -> list[Pid]:
    """Return PIDs without gains of joints that Gazebo Classic could drive by them."""
    found = []
    for block in robot.description.hardware:
        if simulator_of(block) != CLASSIC:
            continue
        for joint in block.joints:
            commands = [each.name for each in joint.command_interfaces]
            quantity = next((q for q in ("position", "velocity") if q in commands), "")
            if quantity:
                none = Gains(0.0, 0.0, 0.0)
                found.append(Pid(joint.name, none, quantity, "", "hardware"))
    return found


def _payload_ranges(
    robot: Robot, pids: Sequence[Pid], robust_to: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return masses by link, [kg]."""
    links, found = robot.description.links, {}
    for name, bounds in robust_to.items():
        link = robot.description.joint(pids[-1].joint).child
        if name != "payload":
            check_link(name, (*links, "payload"), "robust_to")
            link = name
        try:
            low, high = map(float, bounds)
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        if not 0.0 <= low <= high < math.inf:
            text = f"robust_to: {name}: expected (least, largest) [kg], got {bounds!r}"
            raise InputError(text)
        found[link] = low, high
    return found


class _Plant(NamedTuple):
    """Inertia and load that a joint moves, over its workspace."""

    # Largest inertia with the other joints held, and least with them free [kg·m², kg].
    largest: float
    least: float

    # Largest effort of gravity, and the effort limit [N·m, N].
    weight: float
    limit: float

    damping: float


class _Rig(NamedTuple):
    """A robot on which gains are tried."""

    robot: Robot
    pids: tuple[Pid, ...]
    settle: float
    options: SimulationOptions

    @property
    def period(self) -> float:
        """Period of the PIDs [s]."""
        step = self.options.largest_step
        if self.pids[0].kind == "hardware":
            return step
        return max(step, 1.0 / self.robot.controllers.update_rate)

    @property
    def duration(self) -> float:
        """Observation time of a move [s]."""
        return max(1.0, 4.0 * self.settle)

    def follow(self, task: _Task) -> Trace:
        """Return what joints do in a move, with some gains."""
        gains, move = task
        joints = [pid.joint for pid in self.pids]
        robot = with_gains(self.robot, gains, list(self.pids))
        robot = dc.replace(
            robot, initial_positions={**robot.initial_positions, **move.start}
        )
        quantity = self.pids[0].quantity
        steps = np.array(move.steps)
        try:
            # Without a ground, for poses may be below it; bases need one.
            world = "void" if quantity == "position" else "empty"
            diagram = build_diagram(
                robot, world=world, options=self.options, payloads=move.payloads
            )
            simulation = Simulation(diagram)
            start = np.array([robot.initial_positions[name] for name in joints])
            steps = _command(simulation, self, joints, start, steps)
            while quantity == "velocity" and simulation.time < self.duration - _AGAIN:
                # Who hears nothing for a while stops a base.
                simulation.advance_to(simulation.time + _AGAIN)
                _command(simulation, self, joints, start, steps)
            simulation.advance_to(self.duration)
            rollout = simulation.rollout()
        except ArmDrakeError:  # What diverges has failed.
            failed = np.full((2, len(joints)), math.nan)
            return Trace(np.array([0.0, self.duration]), failed, steps)
        at = [rollout.joint_names.index(name) for name in joints]
        values = rollout.position if quantity == "position" else rollout.velocity
        zero = start if quantity == "position" else 0.0
        return Trace(rollout.time, values[:, at] - zero, steps)


def _command(
    simulation: Simulation,
    rig: _Rig,
    joints: Sequence[str],
    start: Array,
    steps: Array,
) -> Array:
    """Send the targets of a move; return the steps that they are."""
    robot, pids = rig.robot, rig.pids
    targets = start + steps if pids[0].quantity == "position" else steps
    goals = dict(zip(joints, map(float, targets), strict=True))
    for config in robot.controllers.controllers:
        if pids[0].kind == "plugin":
            for tag in config.plugins:
                names = getattr(tag, "joint_names", ())
                if names and names[0] in goals and hasattr(tag, "p_gain"):
                    is_position = pids[0].quantity == "position"
                    name = position_topic if is_position else velocity_topic
                    topic = name(tag, robot.name)
                    simulation.topic(topic).publish(goals[names[0]])
            continue
        if pids[0].controller not in ("", config.name):
            continue
        steps = _command_controller(simulation, config, goals, rig.settle, steps)
    return steps


def _command_controller(
    simulation: Simulation,
    config: ControllerConfig,
    goals: Mapping[str, float],
    settle: float,
    steps: Array,
) -> Array:
    """Send goals to a controller, if it has these joints; return the steps they are."""
    values = {name: each.value for name, each in config.parameters.items()}
    handle = simulation.controller(config.name)
    if "diff_drive" in config.type.lower():
        twist = Twist(linear=Vector3(_SPEED, 0.0, 0.0))
        handle.send_velocity(twist)
        return np.full(len(steps), _SPEED / float(values.get("wheel_radius", 0.1)))
    names = values.get("joints", values.get("dof_names"))
    if not names or not set(names) & set(goals):
        return steps
    now = simulation.joint_states()
    start = dict(zip(now.name, map(float, now.position), strict=True))
    points = [goals.get(name, start.get(name, 0.0)) for name in names]
    if config.type.endswith("JointTrajectoryController"):
        point = JointTrajectoryPoint(
            tuple(points), time_from_start=Duration.of(settle / 2)
        )
        joints = tuple(map(str, names))
        trajectory = JointTrajectory(joint_names=joints, points=(point,))
        # Said where from, it is not warned of: steps may be faster than joints.
        handle.send_trajectory(trajectory, where="step")
    else:
        handle.command(points)
    return steps


def _make_moves(
    rig: _Rig, payloads: Mapping[str, tuple[float, float]], number: int, seed: int
) -> list[Move]:
    """Return moves in random poses; the payloads are at their ends, and between."""
    generator = np.random.default_rng(seed)
    ranges = {each.name: each for each in joint_ranges(rig.robot.description)}
    moves = []
    for k in range(number):
        pose = dict(randomize(ranges.values(), generator))
        steps = []
        for j, pid in enumerate(rig.pids):
            each = ranges[pid.joint]
            size = min(_STEP, _STEP_OF_RANGE * (each.upper - each.lower))
            up = (j + k) % 2 == 0
            # Room for the step, and for what comes beyond it.
            low, high = each.lower + 2.0 * size, each.upper - 2.0 * size
            pose[pid.joint] = float(np.clip(pose[pid.joint], low, high))
            steps.append(size if up else -size)
        for name in list(pose):
            if name not in {pid.joint for pid in rig.pids}:
                pose[name] = float(rig.robot.initial_positions[name])
        part = (0.0, 1.0)[k] if k < 2 else generator.random()
        masses = {n: low + part * (up - low) for n, (low, up) in payloads.items()}
        moves.append(Move(pose, tuple(steps), {n: m for n, m in masses.items() if m}))
    return moves


def _sample_plants(
    rig: _Rig, payloads: Mapping[str, tuple[float, float]]
) -> list[_Plant]:
    """Return what each joint moves, over poses, with the largest payloads."""
    robot, joints = rig.robot, [rig.robot.description.joint(p.joint) for p in rig.pids]
    plant = trial_plant(robot)
    N = velocity_map(plant, robot.description, joints)
    context = plant.CreateDefaultContext()
    ranges, generator = joint_ranges(robot.description), np.random.default_rng(0)
    largest = weight = np.zeros(len(joints))
    least = np.full(len(joints), math.inf)
    for _ in range(_NUM_SAMPLES):
        q = plant.GetPositions(context)
        for name, position in randomize(ranges, generator).items():
            q[plant.GetJointByName(name).position_start()] = position
        plant.SetPositions(context, q)
        M = plant.CalcMassMatrix(context)
        tau = plant.CalcGravityGeneralizedForces(context)
        least = np.minimum(least, 1.0 / np.diag(np.linalg.inv(N.T @ M @ N)))
        for link, (_, mass) in payloads.items():
            J = _jacobian(plant, context, link)
            M = M + mass * J.T @ J
            tau = tau - mass * GRAVITY * J[2]
        largest = np.maximum(largest, np.diag(N.T @ M @ N))
        weight = np.maximum(weight, np.abs(N.T @ tau))
    rolled = _rolled_mass(rig, plant)
    plants = []
    for k, joint in enumerate(joints):
        limit = joint.limits.effort or math.inf
        if weight[k] >= limit and rig.pids[0].quantity == "position":
            text = f"joint {joint.name!r} can't hold the weight of {weight[k]:.3g} N·m"
            raise InputError(f"{text} with its effort limit of {limit:g}")
        parts = float(largest[k] + rolled), float(least[k] + rolled)
        plants.append(_Plant(*parts, float(weight[k]), limit, joint.damping))
    return plants


def _rolled_mass(rig: _Rig, plant: Any) -> float:
    """Return what a wheel moves besides itself, of a base that rolls [kg·m²]."""
    for config in rig.robot.controllers.controllers:
        radius = config.parameters.get("wheel_radius")
        if radius is not None and rig.pids[0].quantity == "velocity":
            mass = plant.CalcTotalMass(plant.CreateDefaultContext())
            return float(mass) * float(radius.value) ** 2 / len(rig.pids)
    return 0.0


def _jacobian(plant: Any, context: Any, link: str) -> Array:
    """Return a link's translational Jacobian, shape (3, v)."""
    world, frame = plant.world_frame(), plant.GetFrameByName(link)
    kind = JacobianWrtVariable.kV
    return np.asarray(
        plant.CalcJacobianTranslationalVelocity(
            context, kind, frame, np.zeros(3), world, world
        )
    )


class _Trial(NamedTuple):
    """Bandwidth of each joint [rad/s], and the shape of all."""

    bandwidths: tuple[float, ...]
    shape: tuple[float, float, float]


# Does the moves of many tasks.
_Follow = Callable[[Sequence[_Task]], list[Trace]]


class _Search:
    """Tries gains; keeps the best."""

    def __init__(
        self,
        rig: _Rig,
        plants: Sequence[_Plant],
        moves: Sequence[Move],
        overshoot: float,
    ) -> None:
        self._rig, self._plants, self._moves = rig, plants, moves
        self._overshoot = overshoot
        fastest = _SETTLES / rig.settle
        trials = [
            self._limited(_Trial((scale * fastest,) * len(plants), shape), beyond)
            for shape in _SHAPES
            for scale, beyond in _SCALES
        ]
        self._first = list(dict.fromkeys(trials))

    @property
    def num_rollouts(self) -> int:
        """Number of rollouts of `run`."""
        shapes, singles = self._changes(self._first[0], _ROUNDS[0])
        # In each round one has all changes of bandwidths that were better.
        polish = len(_ROUNDS) * (len(shapes) + len(singles) + 1)
        return (len(self._first) + polish) * len(self._moves)

    def run(self, follow: _Follow) -> dict[str, Gains]:
        """Return the best gains of all that were tried."""
        scores = self._score(self._first, follow)
        ranked = zip(scores, self._first, strict=True)
        score, best = min(ranked, key=lambda pair: pair[0])
        for factor in _ROUNDS:
            score, best = self._polish(score, best, factor, follow)
        return self._gains(best)

    def _changes(
        self, best: _Trial, factor: float
    ) -> tuple[list[_Trial], list[_Trial]]:
        """Return trials with another shape, and with a single bandwidth changed."""
        a, b, c = best.shape
        trials = [
            best._replace(shape=shape)
            for shape in (
                (a * factor, b, c),
                (a / factor, b, c),
                (a, b * factor, c),
                (a, b / factor, c),
                (a, b, c * factor**2),
                (a, b, c / factor**2),
            )
        ]
        singles = []
        for k, w in enumerate(best.bandwidths):
            for each in (w * factor, w / factor):
                changed = list(best.bandwidths)
                changed[k] = each
                singles.append(best._replace(bandwidths=tuple(changed)))
        return trials, singles

    def _polish(
        self, score: float, best: _Trial, factor: float, follow: _Follow
    ) -> tuple[float, _Trial]:
        """Return what is better with single bandwidths and shapes changed."""
        trials, singles = self._changes(best, factor)
        everything = [*trials, *singles]
        scores = self._score(everything, follow)
        ranked = sorted(zip(scores, everything, strict=True), key=lambda pair: pair[0])
        together = self._together(best, score, scores[len(trials) :], singles)
        ranked += [(self._score([together], follow)[0], together)]
        found = min(ranked, key=lambda pair: pair[0])
        return found if found[0] < score else (score, best)

    def _together(
        self,
        best: _Trial,
        score: float,
        scores: Sequence[float],
        singles: Sequence[_Trial],
    ) -> _Trial:
        """Return all changes of single bandwidths together that were better."""
        new = list(best.bandwidths)
        for k in range(len(new)):
            pair = [(scores[i], singles[i]) for i in (2 * k, 2 * k + 1)]
            least, trial = min(pair, key=lambda each: each[0])
            if least < score:
                new[k] = trial.bandwidths[k]
        return best._replace(bandwidths=tuple(new))

    def _limited(self, trial: _Trial, beyond: float) -> _Trial:
        """Return a trial within so much of what effort and rate allow."""
        _, b, _ = trial.shape
        limited = []
        for w, plant in zip(trial.bandwidths, self._plants, strict=True):
            by_rate = _MOST_DAMPING * plant.least / (b * plant.largest)
            by_effort = math.sqrt((plant.limit - plant.weight) / plant.largest / _STEP)
            limited.append(
                min(w, beyond * by_rate / self._rig.period, beyond * by_effort)
            )
        return trial._replace(bandwidths=tuple(limited))

    def _gains(self, trial: _Trial) -> dict[str, Gains]:
        found = {}
        for pid, plant, w in zip(
            self._rig.pids, self._plants, trial.bandwidths, strict=True
        ):
            a, b, c = trial.shape
            m = plant.largest
            clamp = plant.limit
            if pid.quantity == "position":
                d = max(0.0, b * m * w - plant.damping)
                gains = Gains(a * m * w**2, c * m * w**3, d, clamp)
            else:
                p = max(0.0, b * m * w - plant.damping)
                gains = Gains(p, c * a * m * w**2, 0.0, clamp)
            found[pid.joint] = gains
        return found

    def _score(self, trials: Sequence[_Trial], follow: _Follow) -> list[float]:
        """Return how bad trials are."""
        tasks = [(self._gains(t), move) for t in trials for move in self._moves]
        traces = follow(tasks)
        judge = functools.partial(
            _penalty, settle=self._rig.settle, overshoot=self._overshoot
        )
        each = np.array([judge(trace.response()) for trace in traces])
        by_trial = each.reshape(len(trials), len(self._moves))
        return [float(row.mean() + row.max()) for row in by_trial]


def _penalty(response: Response, settle: float, overshoot: float) -> float:
    parts = (
        response.settling_time / settle,
        response.overshoot / overshoot,
        response.end_error / _END,
    )
    # What is kept counts little, what is not much.
    return sum(
        min(part, 1.0) * 0.2 + min(max(part - 1.0, 0.0), _WORST) for part in parts
    )
