import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.controllers.joint_trajectory.parameters import (
    JointTrajectoryControllerParameters,
    check_change,
    make_rules,
)
from arm_drake.controllers.joint_trajectory.state import JointTrajectoryRules
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    CancelGoal,
    CancelResponse,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GoalEvent,
    GoalStatus,
    JointState,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    ParametersRejected,
    SendGoal,
    SpeedScalingFactor,
    TopicRejected,
)
from tests.controllers.driving import NAME, Driven, make_params

# The robot has its joints in another order than the controller, and one more.
ROBOT = ("joint2", "gripper", "joint1")
JOINTS = ("joint1", "joint2")

# Measured positions and velocities of the robot's joints.
START = [2.0, 0.04, 1.0, 0.2, 0.0, 0.1]

MINIMAL = {
    "joints": list(JOINTS),
    "command_interfaces": ["position"],
    "state_interfaces": ["position", "velocity"],
}
VELOCITY = {"command_interfaces": ["velocity"], "gains__joint1__p": 10.0}


def load(
    distro: str = "jazzy", report: LoadReport | None = None, **changes: Any
) -> JointTrajectoryControllerParameters:
    """Return parameters; `__` in a name stands for a dot, None leaves one out."""
    values = {name.replace("__", "."): v for name, v in {**MINIMAL, **changes}.items()}
    parameters = {
        name: Parameter(value, Path("arm.yaml"), line)
        for line, (name, value) in enumerate(values.items(), start=1)
        if value is not None
    }
    return load_parameters(
        JointTrajectoryControllerParameters,
        parameters,
        "arm_controller",
        Path("arm.yaml"),
        LoadReport() if report is None else report,
        distro=distro,
    )


def make(
    parameters: JointTrajectoryControllerParameters,
    *,
    update_rate: int = 100,
    joint_types: Mapping[str, str] | None = None,
    velocity_limits: Mapping[str, float] | None = None,
    distro: str = "jazzy",
) -> JointTrajectoryRules:
    return make_rules(
        parameters,
        update_rate=update_rate,
        joint_types=joint_types or dict.fromkeys(JOINTS, "revolute"),
        velocity_limits=velocity_limits or {},
        distro=distro,
    )


def make_controller(**changes: Any) -> JointTrajectoryController:
    return JointTrajectoryController(load(**changes), make_params(ROBOT))


def drive(command_values: tuple[float, ...] = (), **changes: Any) -> Driven:
    driven = Driven(make_controller(**changes), command_values)
    driven.measure(START)
    return driven


def make_message(time: float, *positions: float, **fields: Any) -> JointTrajectory:
    point = JointTrajectoryPoint(positions, time_from_start=time, **fields)
    return JointTrajectory(joint_names=JOINTS, points=(point,))


def make_goal(time: float, *positions: float) -> SendGoal:
    return SendGoal(FollowJointTrajectoryGoal(make_message(time, *positions)))


def on(port: str, *messages: Any) -> dict[str, Any]:
    return {port: AbstractValue.Make(messages)}


def commands_of(driven: Driven, num: int, **how: Any) -> np.ndarray:
    """Return the commands of so many cycles."""
    return np.array([driven.run(**how).command for _ in range(num)])


def news(driven: Driven) -> list[Any]:
    """Return all news but feedback."""
    events = [event for _, event in driven.output("events")]
    return [e for e in events if not isinstance(e, GoalEvent) or e.feedback is None]


def test_ports_are_named_as_documented() -> None:
    controller = make_controller()
    inputs = [controller.get_input_port(i) for i in range(controller.num_input_ports())]
    outputs = [
        controller.get_output_port(i) for i in range(controller.num_output_ports())
    ]

    assert {port.get_name() for port in inputs} == {
        "controller_manager",
        "state_interfaces",
        "joint_trajectory",
        "follow_joint_trajectory",
        "speed_scaling_input",
        "parameters",
    }
    assert {port.get_name() for port in outputs} == {
        "command_interfaces",
        "controller_state",
        "events",
    }
    assert controller.get_name() == NAME


def test_speed_is_scaled_where_positions_alone_are_commanded() -> None:
    assert not make_controller(**VELOCITY).HasInputPort("speed_scaling_input")


def test_interfaces_are_claimed_by_name() -> None:
    controller = make_controller(
        command_interfaces=["position", "velocity"], command_joints=["joint2"]
    )

    assert controller.command_interfaces == ("joint2/position", "joint2/velocity")
    assert controller.state_interfaces == (
        "joint1/position",
        "joint2/position",
        "joint1/velocity",
        "joint2/velocity",
    )


def test_interfaces_of_speed_scaling_are_claimed_last() -> None:
    controller = make_controller(
        speed_scaling__state_interface="speed/factor",
        speed_scaling__command_interface="speed/target",
    )

    assert controller.command_interfaces[-1] == "speed/target"
    assert controller.state_interfaces[-1] == "speed/factor"


def test_before_the_first_cycle_nothing_is_known() -> None:
    driven = drive()

    assert driven.output("controller_state") == JointTrajectoryControllerState(
        joint_names=JOINTS
    )
    assert driven.output("events") == ()


def test_joints_are_held_where_they_are_at_activation() -> None:
    rows = commands_of(drive(), 3)

    assert rows.tolist() == [[1.0, 2.0]] * 3


@pytest.mark.parametrize(("starts", "expected"), [(True, [1.5, 2.5]), (False, [1, 2])])
def test_joints_are_held_where_they_were_commanded_to_be(
    starts: bool, expected: list[float]
) -> None:
    name = "set_last_command_interface_value_as_state_on_activation"

    rows = commands_of(drive((1.5, 2.5), **{name: starts}), 2)

    assert rows.tolist() == [expected] * 2


def test_commands_look_ahead_by_one_period() -> None:
    driven = drive()

    first = driven.run(on("joint_trajectory", make_message(0.1, 1.5, 2.0))).command
    rows = np.array([first, *commands_of(driven, 12)])

    progress = (np.arange(1, 14) / 10).clip(max=1.0)
    np.testing.assert_allclose(rows[:, 0], 1.0 + 0.5 * progress, rtol=1e-9)
    np.testing.assert_allclose(rows[:, 1], 2.0, rtol=1e-9)


def test_controller_state_tells_of_the_last_tick() -> None:
    driven = drive()
    driven.run(on("joint_trajectory", make_message(0.1, 1.5, 2.0)))

    commands_of(driven, 4)

    state = driven.output("controller_state")
    assert state.header.stamp.to_nanoseconds() == 40_000_000
    assert state.joint_names == JOINTS
    assert state.reference.positions == pytest.approx((1.2, 2.0), rel=1e-9)
    assert state.reference.velocities == pytest.approx((5.0, 0.0), abs=1e-9)
    assert state.reference.time_from_start.to_nanoseconds() == 40_000_000
    assert state.feedback.positions == (1.0, 2.0)
    assert state.feedback.velocities == (0.1, 0.2)
    assert state.feedback.time_from_start.to_nanoseconds() == 40_000_000
    assert state.error.positions == pytest.approx((0.2, 0.0), abs=1e-9)
    # As upstream: there is no velocity command, so velocity errors stay 0.
    assert state.error.velocities == (0.0, 0.0)
    assert state.output.positions == pytest.approx((1.25, 2.0), rel=1e-9)
    assert state.speed_scaling_factor == 1.0


def test_states_are_read_by_their_interface() -> None:
    driven = drive(state_interfaces=["velocity", "position"])

    driven.run()

    state = driven.output("controller_state")
    assert state.feedback.positions == (1.0, 2.0)
    assert state.feedback.velocities == (0.1, 0.2)


def test_a_goal_is_reached() -> None:
    driven, goal = drive(), make_goal(0.1, 1.5, 2.5)
    driven.run(on("follow_joint_trajectory", goal))

    rows = commands_of(driven, 20)

    success = FollowJointTrajectoryResult(0, "Goal successfully reached!")
    assert [(e.status, e.result) for e in news(driven)] == [
        (GoalStatus.EXECUTING, None),
        (GoalStatus.SUCCEEDED, success),
    ]
    assert all(event.request is goal for _, event in driven.output("events"))
    assert rows[-1].tolist() == [1.5, 2.5]


def test_several_messages_in_one_cycle_are_taken_in_order() -> None:
    driven = drive()
    goals = make_goal(0.1, 1.5, 2.5), make_goal(0.1, 1.2, 2.2)
    bad = CancelGoal(make_goal(0.1, 0.0, 0.0))

    driven.run(on("follow_joint_trajectory", *goals, bad))
    rows = commands_of(driven, 20)

    assert [(e.request, getattr(e, "status", None)) for e in news(driven)] == [
        (goals[0], GoalStatus.EXECUTING),
        (goals[1], GoalStatus.EXECUTING),
        (goals[0], GoalStatus.ABORTED),
        (bad, None),
        (goals[1], GoalStatus.SUCCEEDED),
    ]
    assert rows[-1].tolist() == [1.2, 2.2]


def test_an_inactive_controller_refuses_everything_and_says_so() -> None:
    driven, goal = drive(), make_goal(0.1, 1.5, 2.5)
    message = make_message(0.1, 1.5, 2.5)

    driven.run(
        {**on("joint_trajectory", message), **on("follow_joint_trajectory", goal)},
        activation=None,
    )
    tick = driven.run(activation=None)

    inactive = "the controller is inactive; activate it first"
    topic, rejected = news(driven)
    assert topic == TopicRejected(message, inactive)
    assert rejected.status is GoalStatus.REJECTED
    assert rejected.result == FollowJointTrajectoryResult(-1, inactive)
    assert np.isnan(tick.command).all()


def test_what_came_while_inactive_is_not_taken_later() -> None:
    driven = drive()
    message = make_message(0.1, 1.5, 2.5)
    driven.run(on("joint_trajectory", message), activation=None)

    rows = commands_of(driven, 20)

    assert rows.tolist() == [[1.0, 2.0]] * 20


def test_a_deactivation_aborts_the_goal_and_stops() -> None:
    driven = drive(
        command_interfaces=["position", "velocity"],
        allow_nonzero_velocity_at_trajectory_end=True,
    )
    goal = make_goal(1.0, 1.5, 2.5)
    driven.run(on("follow_joint_trajectory", goal))
    commands_of(driven, 9)

    tick = driven.run(activation=None)
    commands_of(driven, 10, activation=None)

    # Positions stay as they are.
    assert np.isnan(tick.command[:2]).all()
    assert tick.command[2:].tolist() == [0.0, 0.0]
    text = "Current goal cancelled during deactivate transition."
    assert news(driven)[-1].status is GoalStatus.ABORTED
    assert news(driven)[-1].result == FollowJointTrajectoryResult(-1, text)
    np.testing.assert_allclose(driven.command_values, [1.05, 2.05, 0.0, 0.0], rtol=1e-9)


def test_a_second_activation_holds_what_was_commanded() -> None:
    driven = drive()
    driven.run(on("joint_trajectory", make_message(0.1, 1.5, 2.5)))
    commands_of(driven, 20)
    commands_of(driven, 5, activation=None)

    rows = commands_of(driven, 5, activation=2)

    assert rows.tolist() == [[1.5, 2.5]] * 5


def test_a_cancelled_goal_is_answered() -> None:
    driven, goal = drive(), make_goal(1.0, 1.5, 2.5)
    cancel, again = CancelGoal(goal), CancelGoal(goal)
    driven.run(on("follow_joint_trajectory", goal))

    driven.run(on("follow_joint_trajectory", cancel))
    driven.run(on("follow_joint_trajectory", again))
    commands_of(driven, 5)

    _, accepted, refused, canceled = news(driven)
    assert isinstance(accepted, CancelResponse)
    assert (accepted.request, accepted.accepted) == (cancel, True)
    assert (refused.request, refused.accepted) == (again, False)
    assert canceled.status is GoalStatus.CANCELED


def test_time_passes_as_fast_as_the_topic_says() -> None:
    driven = drive()
    driven.run(on("speed_scaling_input", SpeedScalingFactor(0.5)))
    driven.run(on("joint_trajectory", make_message(0.1, 1.5, 2.0)))

    rows = commands_of(driven, 5)

    np.testing.assert_allclose(rows[:, 0], 1.0 + 0.5 * np.arange(1.5, 4, 0.5) / 10)
    assert driven.output("controller_state").speed_scaling_factor == 0.5


@pytest.mark.parametrize("factor", [-0.1, np.nan, np.inf])
def test_a_bad_factor_is_refused(factor: float) -> None:
    driven = drive()

    driven.run(on("speed_scaling_input", SpeedScalingFactor(factor)))

    assert driven.reasons() == [
        f"factor is {factor}; expected at least 0, 1 being full speed"
    ]
    assert driven.output("controller_state").speed_scaling_factor == 1.0


def test_the_interface_of_speed_scaling_is_told_the_factor() -> None:
    driven = drive(
        speed_scaling__command_interface="speed/target",
        speed_scaling__initial_scaling_factor=0.25,
    )
    first = driven.run().command

    last = driven.run(on("speed_scaling_input", SpeedScalingFactor(0.75))).command

    assert (first[-1], last[-1]) == (0.25, 0.75)


def test_velocities_are_commanded_by_a_pid() -> None:
    driven = drive(**VELOCITY, gains__joint2__ff_velocity_scale=2.0)
    driven.run(on("joint_trajectory", make_message(1.0, 2.0, 3.0)))

    tick = driven.run()

    # Errors after 10 ms: 0.01; the velocity is 1 throughout.
    np.testing.assert_allclose(tick.command, [10.0 * 0.01, 2.0], rtol=1e-9)


def test_gains_can_change_while_it_runs() -> None:
    driven = drive(**VELOCITY)
    driven.run(on("joint_trajectory", make_message(1.0, 2.0, 3.0)))
    new = load(**{**VELOCITY, "gains__joint1__p": 20.0})

    tick = driven.run({"parameters": AbstractValue.Make(new)})

    np.testing.assert_allclose(tick.command, [20.0 * 0.01, 0.0], rtol=1e-9)


@pytest.mark.parametrize(
    ("make_offer", "problem"),
    [
        (
            lambda: load(command_interfaces=["position", "velocity"]),
            "command_interfaces can't change while the controller runs",
        ),
        (
            lambda: load(constraints__joint2__max_deceleration_on_cancel=1.0),
            "constraints.joint2.max_deceleration_on_cancel can't change while the "
            "controller runs",
        ),
        (
            JointState,
            f"expected JointTrajectoryControllerParameters, got {JointState()!r}",
        ),
    ],
)
def test_parameters_that_can_not_change_are_refused(
    make_offer: Callable[[], Any], problem: str
) -> None:
    driven = drive()

    driven.run({"parameters": AbstractValue.Make(make_offer())})
    tick = driven.run()

    assert news(driven) == [ParametersRejected(problem)]
    assert tick.command.tolist() == [1.0, 2.0]


def test_parameters_offered_at_an_activation_hold_for_it() -> None:
    name = "set_last_command_interface_value_as_state_on_activation"
    driven = drive((1.5, 2.5), **{name: True})
    driven.run(activation=None)

    tick = driven.run({"parameters": AbstractValue.Make(load(**{name: False}))})

    # Held where the joints are, not where they were commanded to be.
    assert tick.command.tolist() == [1.0, 2.0]


def test_parameters_refused_at_an_activation_are_refused_once() -> None:
    driven = drive()
    driven.run(activation=None)

    driven.run({"parameters": AbstractValue.Make(JointState())})
    driven.run()

    assert len(news(driven)) == 1


def test_parameters_are_taken_once_also_from_a_copy_of_the_context() -> None:
    driven = drive()
    bad = load(command_interfaces=["position", "velocity"])
    driven.run({"parameters": AbstractValue.Make(bad)})
    assert len(news(driven)) == 1

    driven.context = driven.context.Clone()
    driven.simulator.reset_context(driven.context)
    driven.run()

    assert len(news(driven)) == 1


def test_speed_is_not_scaled_by_a_state_interface_beside_velocities() -> None:
    parameters = load(
        command_interfaces=["position", "velocity"],
        speed_scaling__state_interface="speed/factor",
    )

    assert not make(parameters).has_scaling_state
    assert make(load(speed_scaling__state_interface="speed/factor")).has_scaling_state


def test_the_state_interface_of_speed_scaling_is_claimed_in_any_case() -> None:
    controller = make_controller(
        command_interfaces=["position", "velocity"],
        speed_scaling__state_interface="speed/factor",
    )

    assert controller.state_interfaces[-1] == "speed/factor"


def test_tolerances_may_change() -> None:
    new = load(constraints__joint1__trajectory=0.5)

    assert check_change(load(), new) is new


def test_query_state_tells_what_is_planned_and_changes_nothing() -> None:
    driven, alone = drive(), drive()
    for one in (driven, alone):
        one.run(on("joint_trajectory", make_message(1.0, 2.0, 3.0)))

    answer = driven.system.query_state(driven.context, 0.5)

    assert answer.success
    assert answer.name == JOINTS
    assert answer.position == pytest.approx((1.5, 2.5), rel=1e-9)
    assert answer.velocity == pytest.approx((1.0, 1.0), rel=1e-9)
    assert commands_of(driven, 99).tolist() == commands_of(alone, 99).tolist()


def test_a_state_copies_as_itself() -> None:
    driven = drive()
    state = driven.run().state

    assert copy.deepcopy(state.control) is state.control


def test_clones_of_a_context_go_on_to_the_same_bits() -> None:
    driven = drive()
    driven.run(on("follow_joint_trajectory", make_goal(0.3, 1.5, 2.5)))
    commands_of(driven, 10)
    clone = driven.context.Clone()

    original = commands_of(driven, 30)
    driven.simulator.reset_context(clone)
    driven.context, driven.cycle = clone, driven.cycle - 30
    cloned = commands_of(driven, 30)

    assert original[0, 0] < 1.5
    assert original[-1, 0] == 1.5
    assert cloned.tobytes() == original.tobytes()


@pytest.mark.parametrize(
    ("port", "expected"),
    [
        ("joint_trajectory", "JointTrajectory"),
        ("follow_joint_trajectory", "ActionRequest"),
        ("speed_scaling_input", "SpeedScalingFactor"),
    ],
)
def test_a_message_of_a_wrong_type_is_refused(port: str, expected: str) -> None:
    controller = make_controller()
    builder = DiagramBuilder()
    builder.AddSystem(controller)
    source = ConstantValueSource(AbstractValue.Make(JointState()))
    builder.AddNamedSystem("source", source)
    builder.Connect(source.get_output_port(), controller.GetInputPort(port))
    builder.ExportInput(controller.GetInputPort("state_interfaces"), "state")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, np.zeros(6))

    with pytest.raises(TypeError) as error:
        Simulator(diagram, context).AdvanceTo(0.005)

    assert str(error.value) == (
        f"{NAME}.{port}: expected a {expected}, got {JointState()!r}"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": None}, "arm.yaml: arm_controller.joints: is required but missing"),
        (
            {"joints": []},
            "arm.yaml:1: arm_controller: joints must have at least one element",
        ),
        (
            {"joints": ["joint1", "joint1"]},
            "arm.yaml:1: arm_controller: joints must not repeat elements, "
            "got ['joint1', 'joint1']",
        ),
        (
            {"joints": "joint1"},
            "arm.yaml:1: arm_controller.joints: expected a list of str, got 'joint1'",
        ),
        (
            {"command_interfaces": []},
            "arm.yaml:2: arm_controller: command_interfaces must have at least one "
            "element",
        ),
        (
            {"command_interfaces": ["bad_name"]},
            "arm.yaml:2: arm_controller.command_interfaces: expected one of "
            "['position', 'velocity', 'acceleration', 'effort'], got 'bad_name'",
        ),
        (
            {"state_interfaces": []},
            "arm.yaml:3: arm_controller: state_interfaces must have at least one "
            "element",
        ),
        (
            {"state_interfaces": ["velocity", "acceleration"]},
            "arm.yaml:3: arm_controller: state_interfaces must have 'position', "
            "got ['velocity', 'acceleration']",
        ),
        (
            {"action_monitor_rate": 0.05},
            "arm.yaml:4: arm_controller: action_monitor_rate must be at least 0.1 Hz, "
            "got 0.05",
        ),
        (
            {"cmd_timeout": -1.0},
            "arm.yaml:4: arm_controller: cmd_timeout must be at least 0, got -1.0",
        ),
        (
            {"interpolation_method": "cubic"},
            "arm.yaml:4: arm_controller.interpolation_method: expected one of "
            "['splines', 'none'], got 'cubic'",
        ),
        (
            {"constraints__goal_time": -1.0},
            "arm.yaml:4: arm_controller.constraints: goal_time must be at least 0, "
            "got -1.0",
        ),
        (
            {"constraints__joint2__goal": "tight"},
            "arm.yaml:4: arm_controller.constraints.joint2.goal: expected float, "
            "got 'tight'",
        ),
        (
            {"allow_partial_joints_goal": "yes"},
            "arm.yaml:4: arm_controller.allow_partial_joints_goal: expected bool, "
            "got 'yes'",
        ),
    ],
)
def test_bad_parameters_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as error:
        load(**changes)

    assert str(error.value) == message


def test_constraints_become_tolerances_in_the_order_of_the_joints() -> None:
    parameters = load(
        constraints__goal_time=0.5,
        constraints__stopped_velocity_tolerance=0.2,
        constraints__joint2__trajectory=0.1,
        constraints__joint2__goal=0.02,
        constraints__joint1__goal=0.03,
    )

    tolerances = make(parameters).tolerances

    assert tolerances.path.position.tolist() == [0.0, 0.1]
    assert tolerances.goal.position.tolist() == [0.03, 0.02]
    assert tolerances.goal.velocity.tolist() == [0.2, 0.2]
    assert tolerances.goal_time == 0.5


def test_defaults_are_upstream_s() -> None:
    rules = make(load())

    assert rules.tolerances.goal.position.tolist() == [0.0, 0.0]
    assert rules.tolerances.goal.velocity.tolist() == [0.01, 0.01]
    assert rules.tolerances.goal_time == 0.0
    assert rules.monitor_period_ns == 50_000_000
    assert rules.interpolation == "splines"
    assert not rules.interpolate_from_desired_state
    assert not rules.allowed.allow_partial_joints_goal
    assert not rules.allowed.allow_nonzero_velocity_at_trajectory_end
    assert not rules.allowed.allow_integration_in_goal_trajectories
    assert not rules.allowed.has_effort_command


def test_the_look_ahead_is_a_period_in_whole_nanoseconds() -> None:
    assert make(load(), update_rate=30).look_ahead_ns == 33_333_333


@pytest.mark.parametrize(
    "name", ["open_loop_control", "interpolate_from_desired_state"]
)
def test_both_names_of_starting_from_the_last_command_work(name: str) -> None:
    parameters = load(**{name: True})

    assert make(parameters).interpolate_from_desired_state


def test_joints_that_the_urdf_calls_continuous_wrap_around() -> None:
    types = {"joint1": "revolute", "joint2": "continuous", "gripper": "prismatic"}

    rules = make(load(), joint_types=types)

    assert rules.wraparound.tolist() == [False, True]
    assert make(load()).wraparound is None


def test_joints_brake_if_all_of_them_can() -> None:
    parameters = load(
        constraints__decelerate_on_cancel=True,
        constraints__joint1__max_deceleration_on_cancel=4.0,
        constraints__joint2__max_deceleration_on_cancel=2.0,
    )

    rules = make(parameters, velocity_limits={"joint1": 2.0, "joint2": 2.0})

    assert rules.deceleration is not None
    assert rules.deceleration.decelerations.tolist() == [4.0, 2.0]
    # From 2 rad/s, joint2 takes 1 s.
    assert rules.deceleration.num_points == 101
    # A joint has no velocity limit.
    assert make(parameters, velocity_limits={"joint1": 2.0}).deceleration is None


@pytest.mark.parametrize(
    ("distro", "is_blended", "is_pinned"),
    [
        ("humble", False, False),
        ("jazzy", False, True),
        ("kilted", False, False),
        ("rolling", True, False),
    ],
)
def test_distros_differ(distro: str, is_blended: bool, is_pinned: bool) -> None:
    rules = make(load(distro), distro=distro)

    assert rules.allow_replacement is is_blended
    assert rules.is_cursor_pinned is is_pinned
    is_canceled = rules.preempted_status is GoalStatus.CANCELED
    assert is_canceled is (distro == "humble")
    assert rules.carries_effort is (distro != "humble")


@pytest.mark.parametrize(("distro", "has_pid"), [("humble", False), ("jazzy", True)])
def test_open_loop_control_switches_humble_s_pid_off(
    distro: str, has_pid: bool
) -> None:
    parameters = load(distro, **VELOCITY, open_loop_control=True)

    assert (make(parameters, distro=distro).pid is not None) is has_pid


def test_joints_that_are_commanded_can_be_fewer() -> None:
    assert make(load(command_joints=["joint2"])).commanded_joints == (1,)
    # As many are taken by their place, whatever they are called.
    assert make(load(command_joints=["pid/a", "pid/b"])).commanded_joints is None


def test_angles_that_wrap_by_humble_s_gains_wrap_around() -> None:
    parameters = load("humble", **VELOCITY, gains__joint2__angle_wraparound=True)

    wraparound = make(parameters, distro="humble").wraparound

    assert wraparound is not None
    assert wraparound.tolist() == [False, True]


def test_the_monitor_s_rate_is_a_parameter() -> None:
    assert make(load(action_monitor_rate=100.0)).monitor_period_ns == 10_000_000


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"cmd_timeout": 1.0, "constraints__goal_time": 1.0},
            "it must exceed constraints.goal_time, 1.0",
        ),
        (
            {**VELOCITY, "speed_scaling__initial_scaling_factor": 0.5},
            "speed_scaling acts on 'position' alone, not on ['velocity']",
        ),
        (
            {"gains__joint1__p": 1.0},
            "gains act on 'velocity' or 'effort' alone, not on ['position']",
        ),
    ],
)
def test_parameters_without_effect_are_reported(
    changes: dict[str, Any], line: str
) -> None:
    report = LoadReport()

    load(report=report, **changes)

    assert [entry.what for entry in report] == [line]


def test_a_timeout_that_exceeds_the_goal_time_is_not_reported() -> None:
    report = LoadReport()

    load(report=report, cmd_timeout=1.5, constraints__goal_time=1.0)

    assert list(report) == []


def test_a_negative_goal_time_waits_for_ever_in_rolling() -> None:
    report, name = LoadReport(), "constraints__goal_time"

    parameters = load("rolling", report, cmd_timeout=0.5, **{name: -1.0})

    assert parameters.constraints.goal_time == 0.0
    lines = [(entry.severity, entry.what, entry.done) for entry in report]
    what = "-1.0 is how versions after 6.9.0 wait for ever"
    assert lines == [("info", what, "taken as 0")]
    assert make(parameters, distro="rolling").cmd_timeout == 0.5


@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted"])
def test_other_distros_refuse_a_negative_goal_time(distro: str) -> None:
    with pytest.raises(ParameterError, match="goal_time must be at least 0, got -1"):
        load(distro, constraints__goal_time=-1.0)


def test_points_that_are_commanded_as_they_are_need_their_velocities() -> None:
    driven = drive(**VELOCITY, interpolation_method="none")

    driven.run(on("joint_trajectory", make_message(1.0, 2.0, 3.0)))
    points = [JointTrajectoryPoint((2.0, 3.0), time_from_start=t) for t in (1.0, 2.0)]
    driven.run(
        on("joint_trajectory", JointTrajectory(joint_names=JOINTS, points=points))
    )

    # The velocity that is measured leads to the first point.
    assert driven.reasons() == [
        "points[1] has no velocities; with interpolation_method 'none' every point "
        "needs positions, velocities"
    ]
