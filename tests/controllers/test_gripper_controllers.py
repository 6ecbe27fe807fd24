"""The gripper controllers: conformance vectors K1 to K16, efforts, the plain topic."""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest

from arm_drake import interfaces
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    CancelGoal,
    Float32,
    FollowJointTrajectoryGoal,
    GoalEvent,
    GoalStatus,
    GripperCommand,
    GripperCommandGoal,
    JointState,
    ParallelGripperCommandGoal,
    SendGoal,
)
from tests.controllers.driving import Driven, make_params
from tests.controllers.parameters import EFFORT_GRIPPER, GRIPPER, PARALLEL_GRIPPER, load

BOTH = (GRIPPER, PARALLEL_GRIPPER)

# Ticks of the controllers here [Hz].
RATE = 100

# Open and closed [rad].
RANGE = (0.0, 0.8)


class Gripper:
    """A gripper controller on joint1, and the goals that it was sent."""

    def __init__(self, type_: str, *, ranges: Any = None, **values: Any) -> None:
        params = dc.replace(
            make_params(("joint1",), rate=RATE), gripper_ranges=ranges or {}
        )
        parameters = load(type_, {"joint": "joint1", **values})
        make = CONTROLLER_TYPES[type_].system
        assert make is not None
        self.type = type_
        self.driven = Driven(make(parameters, params))
        self.events: dict[SendGoal, list[GoalEvent]] = {}
        self.num_seen = 0

    def measure(self, position: float, velocity: float = 0.0) -> None:
        self.driven.measure([position, velocity])

    def run(self, *requests: Any, cycles: int = 1, **keywords: Any) -> None:
        topics = {"gripper_cmd": requests} if requests else {}
        for _ in range(cycles):
            self.driven.run(topics, **keywords)
            topics = {}
            for number, event in self.driven.output("events"):
                if number >= self.num_seen:
                    self.num_seen = number + 1
                    if isinstance(event, GoalEvent):
                        self.events.setdefault(event.request, []).append(event)

    def goal(self, position: float, max_effort: float = 0.0) -> SendGoal:
        if self.type == PARALLEL_GRIPPER:
            state = JointState(position=(position,))
            return SendGoal(ParallelGripperCommandGoal(state))
        return SendGoal(GripperCommandGoal(GripperCommand(position, max_effort)))

    def last(self, goal: SendGoal) -> GoalEvent:
        return self.events[goal][-1]

    @property
    def command(self) -> list[float]:
        return [float(value) for value in self.driven.command_values]


# K1.
@pytest.mark.parametrize("type_", [*BOTH, EFFORT_GRIPPER])
def test_a_joint_must_be_named(type_):
    with pytest.raises(ParameterError, match="joint must not be empty"):
        load(type_, {"joint": ""})


# K2.
@pytest.mark.parametrize(
    ("type_", "claimed"),
    [(GRIPPER, "position"), (EFFORT_GRIPPER, "effort"), (PARALLEL_GRIPPER, "position")],
)
def test_it_claims_one_interface_and_reads_two(type_, claimed):
    system = Gripper(type_).driven.system

    assert system.command_interfaces == (f"joint1/{claimed}",)
    assert system.state_interfaces == ("joint1/position", "joint1/velocity")


# K3, K4.
@pytest.mark.parametrize("type_", BOTH)
def test_an_activation_holds_the_present_position(type_):
    gripper = Gripper(type_)
    gripper.measure(1.1)
    gripper.run()
    assert gripper.command == [1.1]

    gripper.run(activation=None)
    gripper.measure(0.7)
    gripper.run(activation=2)

    assert gripper.command == [0.7]


# K5, K6.
@pytest.mark.parametrize("type_", BOTH)
@pytest.mark.parametrize(("position", "is_reached"), [(0.495, True), (0.49, False)])
def test_a_goal_is_reached_strictly_within_its_tolerance(type_, position, is_reached):
    gripper = Gripper(type_)
    gripper.measure(position)
    goal = gripper.goal(0.5)

    gripper.run(goal, cycles=10)

    event = gripper.last(goal)
    assert event.status is (
        GoalStatus.SUCCEEDED if is_reached else GoalStatus.EXECUTING
    )
    if is_reached:
        result = event.result
        assert (result.reached_goal, result.stalled) == (True, False)
        where = result.position if type_ == GRIPPER else result.state.position[0]
        assert where == position
    assert gripper.command == [0.5]


# K7, K8.
@pytest.mark.parametrize("type_", BOTH)
@pytest.mark.parametrize("may_stall", [False, True])
def test_a_joint_that_stands_for_longer_than_the_timeout_stalls(type_, may_stall):
    gripper = Gripper(type_, allow_stalling=may_stall)
    gripper.measure(0.3)
    goal = gripper.goal(0.5)

    gripper.run(goal, cycles=101)
    # One second after its acceptance: not longer than that.
    assert gripper.last(goal).status is GoalStatus.EXECUTING
    gripper.run(cycles=6)

    event = gripper.last(goal)
    assert event.status is (GoalStatus.SUCCEEDED if may_stall else GoalStatus.ABORTED)
    assert (event.result.stalled, event.result.reached_goal) == (True, False)


# K9: at rest from 0.9 s on, the time of its last motion.
@pytest.mark.parametrize("type_", BOTH)
def test_a_joint_stalls_after_its_last_motion(type_):
    gripper = Gripper(type_)
    gripper.measure(0.3, 0.002)
    goal = gripper.goal(0.5)
    gripper.run(goal, cycles=91)

    gripper.measure(0.3, 0.0)
    gripper.run(cycles=100)
    assert gripper.last(goal).status is GoalStatus.EXECUTING
    gripper.run(cycles=6)

    assert gripper.last(goal).status is GoalStatus.ABORTED


# K10.
@pytest.mark.parametrize("type_", BOTH)
def test_a_goal_ends_the_one_before(type_):
    gripper = Gripper(type_)
    gripper.measure(0.3)
    first, second = gripper.goal(0.5), gripper.goal(0.6)
    gripper.run(first)

    gripper.run(second)

    assert gripper.last(first).status is GoalStatus.CANCELED
    assert gripper.last(second).status is GoalStatus.EXECUTING
    assert gripper.command == [0.6]


# K11.
@pytest.mark.parametrize("type_", BOTH)
def test_a_cancel_holds_the_position_of_that_moment(type_):
    gripper = Gripper(type_)
    goal = gripper.goal(0.5)
    gripper.measure(0.1)
    gripper.run(goal)

    gripper.measure(0.3)
    gripper.run(CancelGoal(goal))
    assert gripper.command == [0.3]
    gripper.measure(0.4)
    gripper.run(cycles=5)

    assert gripper.last(goal).status is GoalStatus.CANCELED
    assert gripper.command == [0.3]


# K12, K13.
@pytest.mark.parametrize(("max_effort", "effort"), [(5.0, 5.0), (0.0, 0.0)])
def test_an_effort_is_held_to_that_of_the_goal(max_effort, effort):
    gripper = Gripper(EFFORT_GRIPPER, **{"gains.joint1.p": 100.0})
    gripper.measure(0.4)

    gripper.run(gripper.goal(0.5, max_effort))

    assert gripper.command == [effort]


def test_an_effort_is_that_of_the_pid():
    gains = {"p": 10.0, "i": 2.0, "d": 0.5, "i_clamp": 0.03}
    gripper = Gripper(
        EFFORT_GRIPPER, **{f"gains.joint1.{name}": k for name, k in gains.items()}
    )
    gripper.measure(0.4, 0.2)
    goal = gripper.goal(0.5, 50.0)

    gripper.run(goal, cycles=3)

    # Error 0.1, rate -0.2: 1 - 0.1, and an integral of 0.002 at each tick, of which the
    # strategy "legacy" counts all three.
    np.testing.assert_allclose(gripper.command, [0.906], rtol=1e-12)
    gripper.run(cycles=20)
    np.testing.assert_allclose(gripper.command, [0.93], rtol=1e-12)


def test_the_effort_of_a_result_is_the_last_one_that_was_commanded():
    gripper = Gripper(EFFORT_GRIPPER, **{"gains.joint1.p": 100.0})
    gripper.measure(0.4)
    goal = gripper.goal(0.5, 5.0)
    gripper.run(goal)

    gripper.measure(0.499)
    gripper.run(cycles=6)

    assert gripper.last(goal).result.effort == 5.0


# K14.
LIMITS = {
    "max_effort_interface": "joint1/effort",
    "max_velocity_interface": "joint1/velocity",
}


def test_interfaces_for_limits_are_claimed_too():
    system = Gripper(PARALLEL_GRIPPER, **LIMITS).driven.system

    assert system.command_interfaces == (
        "joint1/position",
        "joint1/effort",
        "joint1/velocity",
    )
    assert system.limit_interfaces == {
        "joint1/effort": interfaces.EFFORT,
        "joint1/velocity": interfaces.VELOCITY,
    }


# K15.
@pytest.mark.parametrize("positions", [(), (0.1, 0.2)])
def test_a_goal_has_one_position(positions):
    gripper = Gripper(PARALLEL_GRIPPER)
    goal = SendGoal(ParallelGripperCommandGoal(JointState(position=positions)))

    gripper.run(goal)

    event = gripper.last(goal)
    assert event.status is GoalStatus.REJECTED
    assert event.note == f"command.position must have 1 value, got {len(positions)}"


# K16.
@pytest.mark.parametrize(
    ("effort", "velocity", "limits"),
    [((7.0,), (), [7.0, 0.1]), ((), (0.5,), [10.0, 0.5]), ((), (), [10.0, 0.1])],
)
def test_limits_are_the_goal_s_or_the_parameters(effort, velocity, limits):
    gripper = Gripper(PARALLEL_GRIPPER, **LIMITS)
    command = JointState(position=(0.5,), effort=effort, velocity=velocity)

    gripper.run(SendGoal(ParallelGripperCommandGoal(command)))

    assert gripper.command == [0.5, *limits]


@pytest.mark.parametrize(
    ("type_", "goal", "reason"),
    [
        (
            GRIPPER,
            ParallelGripperCommandGoal(JointState(position=(0.1,))),
            "expected a GripperCommandGoal, got a ParallelGripperCommandGoal",
        ),
        (
            PARALLEL_GRIPPER,
            FollowJointTrajectoryGoal(),
            "expected a ParallelGripperCommandGoal, got a FollowJointTrajectoryGoal",
        ),
        (
            GRIPPER,
            GripperCommandGoal(GripperCommand(float("nan"))),
            "command.position must be finite, got nan",
        ),
    ],
)
def test_other_goals_are_rejected_with_a_reason(type_, goal, reason):
    gripper, request = Gripper(type_), SendGoal(goal)

    gripper.run(request)

    assert gripper.last(request).status is GoalStatus.REJECTED
    assert gripper.last(request).note == reason


def test_a_goal_before_the_first_activation_is_rejected():
    gripper = Gripper(GRIPPER)
    goal = gripper.goal(0.5)

    gripper.run(goal, activation=None)

    assert gripper.last(goal).status is GoalStatus.REJECTED
    assert "never active" in gripper.last(goal).note


@pytest.mark.parametrize(("part", "position"), [(0.0, 0.0), (0.25, 0.2), (1.0, 0.8)])
@pytest.mark.parametrize("type_", BOTH)
def test_the_plain_topic_opens_and_closes(type_, part, position):
    gripper = Gripper(type_, ranges={"joint1": RANGE})
    gripper.measure(0.3)
    goal = gripper.goal(0.5)
    gripper.run(goal)

    gripper.driven.run({"gripper_command": Float32(part)})

    assert gripper.command == pytest.approx([position], abs=1e-15)
    gripper.run()
    assert gripper.last(goal).status is GoalStatus.CANCELED


def test_the_plain_topic_takes_parts_of_the_range_only():
    gripper = Gripper(GRIPPER, ranges={"joint1": RANGE})
    gripper.measure(0.3)

    gripper.driven.run({"gripper_command": Float32(1.5)})

    assert gripper.command == [0.3]
    assert gripper.driven.reasons() == [
        "data must be from 0 (open) to 1 (closed), got 1.5"
    ]


def test_the_plain_topic_of_a_gripper_of_efforts_has_the_effort_it_needs():
    gripper = Gripper(
        EFFORT_GRIPPER, ranges={"joint1": RANGE}, **{"gains.joint1.p": 100.0}
    )
    gripper.measure(0.3)

    gripper.driven.run({"gripper_command": Float32(1.0)})

    np.testing.assert_allclose(gripper.command, [50.0], rtol=1e-12)
