"""Real robots under their own controllers YAML: goals succeed, commands are reached.

The robots are those of the index; `ARM_DRAKE_ROBOTS` names its folder.
"""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.drive_gains import find_drive_gains
from arm_drake.description.joints import JointInfo
from tests.robots import load_real_robot, read_index, robot_names

JTC = "JointTrajectoryController"
FORWARD = {
    "forward_command_controller/ForwardCommandController",
    "position_controllers/JointGroupPositionController",
}

# Largest move [rad] or [m], and as a part of the range of positions.
MOVE = {"revolute": 0.4, "continuous": 0.4, "prismatic": 0.05}
PART = 0.25

# A robot that can't hold all poses is moved less: where it starts it may be strong
# enough.
WEAK_PART = 0.2

# Largest speed of a move [rad/s] or [m/s], and as a part of the joint's own.
SPEED = 0.5

# How near positions are in the end [rad] or [m], and as a part of the move.
FINAL = 2e-3
FINAL_PART = 0.1

# How near they are on the way, besides what is travelled in a period.
ON_THE_WAY = 5e-3

# And besides where dry friction holds a joint at first.
STUCK = 0.01

# So high that no target is below the ground; what drives stays there.
HIGH_UP = (0.0, 0.0, 3.0, 0.0, 0.0, 0.0)

# How long it takes to come to rest [s]: the servo 0.15 s, the rest is friction.
REST = 1.0


@dc.dataclass(frozen=True)
class Case:
    """A robot as loaded, and what is to be tried with it."""

    robot: ad.Robot

    # Names of controllers by what they are.
    trajectory: tuple[str, ...]
    forward: tuple[str, ...]

    @property
    def joints(self) -> dict[str, JointInfo]:
        return {joint.name: joint for joint in self.robot.description.movable_joints}

    @property
    def is_too_weak(self) -> bool:
        """Whether the load report says that gravity asks for more than there is."""
        return any("gravity asks for" in entry.what for entry in self.robot.report)


def with_controllers(*types: str, unknown: bool = False) -> list[str]:
    """Return the robots of the index with a controller of a type that ends so.

    Args:
        types: Ends of the types.
        unknown: Whether those count of whose controllers the index says nothing.
    """
    names = robot_names()
    if names == ["none"]:
        return names
    found = []
    for name, row in read_index().items():
        controllers = row["expected"].get("controllers") or {}
        of_type = [p for p in controllers.values() if p["type"].endswith(types)]
        if of_type or (unknown and not controllers):
            found.append(name)
    return found


@pytest.fixture
def case(request: pytest.FixtureRequest) -> Case:
    row = read_index()[request.param]
    types = [p["type"] for p in (row["expected"].get("controllers") or {}).values()]
    drives = any("Drive" in name or "Steering" in name for name in types)
    robot = load_real_robot(request.param, pose=None if drives else HIGH_UP)
    configured = robot.controllers.controllers
    return Case(
        robot,
        tuple(c.name for c in configured if c.type.endswith(JTC)),
        tuple(c.name for c in configured if c.type in FORWARD),
    )


def rounds(case: Case, names: tuple[str, ...]) -> list[tuple[ad.Simulation, list[str]]]:
    """Return simulations in which each of the controllers is active once.

    First those that are so by themselves; then those that others keep from it. What
    can't be active at all has a line in the report.
    """
    found = []
    waiting = list(names)
    active: tuple[str, ...] = ()
    while waiting:
        options = ad.SimulationOptions(active=active)
        sim = ad.Simulation(ad.build_diagram(case.robot, options=options))
        states = {row.name: row.state for row in sim.list_controllers()}
        tried = [name for name in waiting if states[name] == "active"]
        if not tried and active:
            for name in waiting:
                assert any(name in entry.where for entry in sim.report), name
            break
        if tried:
            found.append((sim, tried))
        waiting = [name for name in waiting if name not in tried]
        active = tuple(waiting)
    return found


def move(case: Case, joint: JointInfo, start: float) -> float:
    """Return by how much a joint is to move, towards the middle of its range."""
    size, limits = MOVE[joint.type], joint.limits
    if case.is_too_weak:
        size *= WEAK_PART
    low, high = limits.lower, limits.upper
    if joint.type == "continuous" or low is None or high is None:
        return size
    size = min(size, PART * (high - low))
    return size if start <= (low + high) / 2.0 else -size


def duration(joint: JointInfo, distance: float) -> float:
    """Return the time that a smooth move takes [s]."""
    limit = joint.limits.velocity
    speed = SPEED * min(1.0, limit if limit is not None else 1.0)
    # The fastest point of a cubic is 1.5 times its mean.
    return max(1.0, 1.5 * abs(distance) / speed)


def is_near(found: Any, wanted: Any, distances: Any) -> bool:
    tolerance = np.minimum(FINAL, FINAL_PART * np.abs(distances))
    return bool((np.abs(np.subtract(found, wanted)) <= tolerance).all())


class Trial:
    """A goal of two points: there, and half the way back."""

    def __init__(self, case: Case, sim: ad.Simulation, name: str) -> None:
        """Send it to a controller."""
        self.case, self.name = case, name
        state = sim.controller(name).state()
        self.names = state.joint_names
        self.joints = [case.joints[joint] for joint in self.names]
        start = np.array(state.feedback.positions)
        self.moves = np.array(
            [move(case, j, q) for j, q in zip(self.joints, start, strict=True)]
        )
        self.target = start + self.moves / 2.0
        times = [duration(*jd) for jd in zip(self.joints, self.moves, strict=True)]
        still, time = [0.0] * len(self.joints), max(times)
        points = [
            ad.JointTrajectoryPoint(start + self.moves, still, time_from_start=time),
            ad.JointTrajectoryPoint(self.target, still, time_from_start=2.0 * time),
        ]
        self.end = sim.time + 2.0 * time
        self.goal = sim.controller(name).send_goal(
            ad.JointTrajectory(joint_names=self.names, points=points)
        )

    def check(self, sim: ad.Simulation) -> None:
        """Check that it succeeded, and was followed."""
        rollout, final = sim.rollout(), sim.joint_states()
        if self.case.is_too_weak and rollout.effort_saturation():
            # What becomes of its goals is up to gravity; they do end.
            assert self.goal.status.is_terminal
            return
        assert self.goal.status is ad.GoalStatus.SUCCEEDED, self.goal
        assert self.goal.result is not None
        assert self.goal.result.error_code == 0
        positions = dict(zip(final.name, final.position, strict=True))
        reached = [positions[name] for name in self.names]
        assert is_near(reached, self.target, self.moves), reached - self.target

        error = rollout.tracking_error(self.name)
        assert error.shape == (len(rollout.time), len(reached))
        assert np.isfinite(error).all()
        friction = np.array([joint.friction for joint in self.joints])
        period = 1.0 / self.case.robot.controllers.update_rate
        bound = ON_THE_WAY + SPEED * period + STUCK * (friction > 0.0)
        peak = np.abs(error).max(axis=0)
        assert (peak <= bound).all(), peak
        # What is compared did move.
        travelled = np.ptp(rollout.references[self.name].position, axis=0)
        assert (travelled >= 0.99 * np.abs(self.moves)).all()


@pytest.mark.parametrize("case", with_controllers(JTC, unknown=True), indirect=True)
def test_goals_succeed_under_its_own_parameters(case: Case) -> None:
    for sim, names in rounds(case, case.trajectory):
        sim.advance_to(0.1)
        trials = [Trial(case, sim, name) for name in names]
        sim.advance_to(max(trial.end for trial in trials) + REST)

        for trial in trials:
            trial.check(sim)


@pytest.mark.parametrize(
    "case",
    with_controllers("ForwardCommandController", "JointGroupPositionController"),
    indirect=True,
)
def test_commanded_positions_are_reached(case: Case) -> None:
    for sim, names in rounds(case, case.forward):
        commanded = {}
        for name in names:
            claims = sim.diagram.GetSubsystemByName(name).command_interfaces
            if not all(claim.endswith("/position") for claim in claims):
                continue
            joints = [case.joints[claim.rpartition("/")[0]] for claim in claims]
            for joint in joints:
                start = case.robot.initial_positions[joint.name]
                commanded[joint.name] = (start, move(case, joint, start))
            sim.controller(name).command(
                [sum(commanded[joint.name]) for joint in joints]
            )
        sim.advance_to(2.0)

        final = sim.joint_states()
        positions = dict(zip(final.name, final.position, strict=True))
        # PID gains of its own know nothing of its weight.
        for joint in find_drive_gains(case.robot, sim.report):
            commanded.pop(joint)
        if case.is_too_weak and sim.rollout().effort_saturation():
            continue
        for joint, (start, distance) in commanded.items():
            assert is_near(positions[joint], start + distance, distance), joint
