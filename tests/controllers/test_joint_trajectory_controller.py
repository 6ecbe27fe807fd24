from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    ConstantValueSource,
    MatrixGain,
    ZeroOrderHold,
)

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.joint_trajectory_controller import (
    JointTrajectoryController,
    JointTrajectoryControllerParameters,
    _make_rules,
)
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
    GoalStatus,
    JointState,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    SendGoal,
)

# The robot has its joints in another order than the controller, and one more.
ROBOT = ("joint2", "gripper", "joint1")
JOINTS = ("joint1", "joint2")
MEASURED = interfaces.interface_names(ROBOT, interfaces.STATE_INTERFACES)
READ = MEASURED[:6]  # Without efforts.
START = {"joint1/position": 1.0, "joint2/position": 2.0, "gripper/position": 0.04}
PERIOD = 0.01

MINIMAL = {
    "joints": list(JOINTS),
    "command_interfaces": ["position"],
    "state_interfaces": ["position", "velocity"],
}


def load(**changes: Any) -> JointTrajectoryControllerParameters:
    """Return parameters; `__` in a name stands for a dot, None leaves one out."""
    given = {name.replace("__", "."): v for name, v in {**MINIMAL, **changes}.items()}
    parameters = {
        name: Parameter(value, Path("arm.yaml"), line)
        for line, (name, value) in enumerate(given.items(), start=1)
        if value is not None
    }
    return load_parameters(
        JointTrajectoryControllerParameters,
        parameters,
        "arm_controller",
        Path("arm.yaml"),
        LoadReport(),
    )


def make_params(
    update_rate: int = 100, joint_types: Mapping[str, str] | None = None
) -> ControllerInterfaceParams:
    return ControllerInterfaceParams(
        controller_name="arm_controller",
        update_rate=update_rate,
        period=1.0 / update_rate,
        joint_types=joint_types or dict.fromkeys(ROBOT, "revolute"),
        command_interfaces=frozenset(f"{joint}/position" for joint in ROBOT),
        state_interfaces=frozenset(MEASURED),
        measured=MEASURED,
        initial_commands=START,
    )


def make_controller(**changes: Any) -> JointTrajectoryController:
    return JointTrajectoryController(load(**changes), make_params())


def make_message(time: float, *positions: float) -> JointTrajectory:
    point = JointTrajectoryPoint(positions, time_from_start=time)
    return JointTrajectory(joint_names=JOINTS, points=(point,))


def make_diagram(controller: JointTrajectoryController) -> Diagram:
    """Return the controller in a loop with joints that follow within 1 ms."""
    builder = DiagramBuilder()
    builder.AddSystem(controller)
    # From commands and their rates to positions and velocities.
    gain = np.zeros((len(READ), 4))
    for column, name in enumerate(interfaces.interface_names(JOINTS, ("position",))):
        gain[READ.index(name), column] = 1.0
        speed = name.replace("position", "velocity")
        gain[READ.index(speed), column + 2] = 1.0
    joints = builder.AddNamedSystem("joints", MatrixGain(gain))
    delay = builder.AddNamedSystem("delay", ZeroOrderHold(0.001, len(READ)))
    command = controller.GetOutputPort("command_interfaces")
    builder.Connect(command, joints.get_input_port())
    builder.Connect(joints.get_output_port(), delay.get_input_port())
    state = controller.GetInputPort("state_interfaces")
    builder.Connect(delay.get_output_port(), state)
    for port in ("joint_trajectory", "follow_joint_trajectory"):
        builder.ExportInput(controller.GetInputPort(port), port)
    for port in ("command_interfaces", "controller_state", "events"):
        builder.ExportOutput(controller.GetOutputPort(port), port)
    return builder.Build()


def make_context(system: LeafSystem | Diagram, **messages: Any) -> Context:
    """Return a context with joints at their start and messages on ports."""
    context = system.CreateDefaultContext()
    measured = np.array([START.get(name, 0.0) for name in READ])
    if isinstance(system, Diagram):
        delay = system.GetSubsystemByName("delay")
        delay.GetMyMutableContextFromRoot(context).SetDiscreteState(measured)
    else:
        system.GetInputPort("state_interfaces").FixValue(context, measured)
    for port, message in messages.items():
        system.GetInputPort(port).FixValue(context, AbstractValue.Make(message))
    return context


def outputs(
    system: LeafSystem | Diagram, context: Context, *, until: float
) -> np.ndarray:
    """Return commands and rates after every 5 ms."""
    simulator = Simulator(system, context)
    rows = []
    start = context.get_time()
    for step in range(1, round((until - start) / 0.005) + 1):
        simulator.AdvanceTo(start + 0.005 * step)
        rows.append(system.GetOutputPort("command_interfaces").Eval(context))
    return np.array(rows)


@pytest.fixture
def controller() -> JointTrajectoryController:
    return make_controller()


def test_ports_are_named_and_sized_as_documented(
    controller: JointTrajectoryController,
) -> None:
    inputs = [controller.get_input_port(i) for i in range(controller.num_input_ports())]
    outputs = [
        controller.get_output_port(i) for i in range(controller.num_output_ports())
    ]

    assert {port.get_name(): port.size() for port in inputs} == {
        "state_interfaces": 6,
        "joint_trajectory": 0,
        "follow_joint_trajectory": 0,
    }
    assert {port.get_name(): port.size() for port in outputs} == {
        "command_interfaces": 4,
        "controller_state": 0,
        "events": 0,
    }
    assert controller.get_name() == "arm_controller"


def test_interfaces_are_claimed_by_name(controller: JointTrajectoryController) -> None:
    assert controller.command_interfaces == ("joint1/position", "joint2/position")
    assert controller.state_interfaces == (
        "joint1/position",
        "joint2/position",
        "joint1/velocity",
        "joint2/velocity",
    )


def test_outputs_depend_on_no_input(controller: JointTrajectoryController) -> None:
    assert not controller.HasAnyDirectFeedthrough()


def test_before_the_first_tick_commands_hold_and_nothing_else_is_known(
    controller: JointTrajectoryController,
) -> None:
    context = controller.CreateDefaultContext()

    def output(name: str) -> Any:
        return controller.GetOutputPort(name).Eval(context)

    assert output("command_interfaces").tolist() == [1.0, 2.0, 0.0, 0.0]
    assert output("controller_state") == JointTrajectoryControllerState(
        joint_names=JOINTS
    )
    assert output("events") == ()


def test_commands_hold_between_ticks_and_their_rates_are_differences(
    controller: JointTrajectoryController,
) -> None:
    message = make_message(0.1, 1.5, 2.0)
    context = make_context(controller, joint_trajectory=message)

    rows = outputs(controller, context, until=0.135)

    # Rows are 5 ms and 10 ms after every tick.
    assert (rows[::2][:13] == rows[1::2]).all()
    commands, rates = rows[::2, :2], rows[::2, 2:4]
    progress = (np.arange(1, 15) / 10).clip(max=1.0)
    np.testing.assert_allclose(commands[:, 0], 1.0 + 0.5 * progress, rtol=1e-9)
    np.testing.assert_allclose(commands[:, 1], 2.0, rtol=1e-9)
    # The first command is a jump of 0.05 rad, which is no speed.
    np.testing.assert_allclose(
        rates[:, 0], [0.0] + [5.0] * 9 + [0.0] * 4, rtol=1e-9, atol=1e-9
    )
    assert (rates[:, 1] == 0.0).all()


def test_controller_state_tells_of_the_last_tick(
    controller: JointTrajectoryController,
) -> None:
    message = make_message(0.1, 1.5, 2.0)
    context = make_context(controller, joint_trajectory=message)

    outputs(controller, context, until=0.045)

    state = controller.GetOutputPort("controller_state").Eval(context)
    assert state.header.stamp.to_nanoseconds() == 40_000_000
    assert state.joint_names == JOINTS
    assert state.reference.positions == pytest.approx((1.2, 2.0), rel=1e-9)
    assert state.reference.velocities == pytest.approx((5.0, 0.0), abs=1e-9)
    assert state.reference.time_from_start.to_nanoseconds() == 40_000_000
    assert state.feedback.positions == (1.0, 2.0)
    assert state.feedback.velocities == (0.0, 0.0)
    assert state.error.positions == pytest.approx((0.2, 0.0), abs=1e-9)
    # As upstream: there is no velocity command, so velocity errors stay 0.
    assert state.error.velocities == (0.0, 0.0)
    assert state.output.positions == pytest.approx((1.25, 2.0), rel=1e-9)


def test_states_are_read_by_their_interface() -> None:
    controller = make_controller(state_interfaces=["velocity", "position"])
    context = make_context(controller)

    outputs(controller, context, until=0.005)

    state = controller.GetOutputPort("controller_state").Eval(context)
    assert state.feedback.positions == (1.0, 2.0)
    assert state.feedback.velocities == (0.0, 0.0)


def test_a_goal_is_reached_in_a_loop() -> None:
    diagram = make_diagram(make_controller(constraints__joint1__goal=0.01))
    goal = SendGoal(FollowJointTrajectoryGoal(make_message(0.1, 1.5, 2.5)))
    context = make_context(diagram, follow_joint_trajectory=goal)

    rows = outputs(diagram, context, until=0.2)

    events = diagram.GetOutputPort("events").Eval(context)
    assert [number for number, _ in events] == list(range(len(events)))
    assert [event.status for _, event in events if event.feedback is None] == [
        GoalStatus.EXECUTING,
        GoalStatus.SUCCEEDED,
    ]
    assert all(event.request is goal for _, event in events)
    success = FollowJointTrajectoryResult(0, "Goal successfully reached!")
    assert events[-1][1].result == success
    assert rows[-1, :4].tolist() == [1.5, 2.5, 0.0, 0.0]


def test_clones_of_a_context_go_on_to_the_same_bits() -> None:
    diagram = make_diagram(make_controller())
    goal = SendGoal(FollowJointTrajectoryGoal(make_message(0.3, 1.5, 2.5)))
    context = make_context(diagram, follow_joint_trajectory=goal)
    outputs(diagram, context, until=0.1)
    clones = [context.Clone(), context.Clone()]

    original, *cloned = (outputs(diagram, one, until=0.5) for one in (context, *clones))

    assert original[0, 0] < 1.5  # In motion when it was cloned,
    assert original[-1, 0] == 1.5  # and there in the end.
    for rows in cloned:
        assert rows.tobytes() == original.tobytes()
    port = diagram.GetOutputPort("events")
    assert port.Eval(clones[0]) == port.Eval(context)


def test_a_context_that_stays_behind_is_not_disturbed(
    controller: JointTrajectoryController,
) -> None:
    message = make_message(0.3, 1.5, 2.5)
    context = make_context(controller, joint_trajectory=message)
    outputs(controller, context, until=0.1)
    clone = context.Clone()
    before = controller.GetOutputPort("command_interfaces").Eval(clone).copy()

    outputs(controller, context, until=0.3)

    after = controller.GetOutputPort("command_interfaces").Eval(clone)
    assert (after == before).all()


@pytest.mark.parametrize(
    ("port", "problem"),
    [
        (
            "joint_trajectory",
            "arm_controller.joint_trajectory: expected a JointTrajectory, got "
            f"{JointState()!r}",
        ),
        (
            "follow_joint_trajectory",
            "arm_controller.follow_joint_trajectory: expected a ActionRequest, got "
            f"{JointState()!r}",
        ),
    ],
)
def test_a_message_of_a_wrong_type_is_refused(
    controller: JointTrajectoryController, port: str, problem: str
) -> None:
    builder = DiagramBuilder()
    builder.AddSystem(controller)
    source = ConstantValueSource(AbstractValue.Make(JointState()))
    builder.AddNamedSystem("source", source)
    builder.Connect(source.get_output_port(), controller.GetInputPort(port))
    measured = controller.GetInputPort("state_interfaces")
    builder.ExportInput(measured, "state_interfaces")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, np.zeros(len(READ)))

    with pytest.raises(TypeError) as error:
        Simulator(diagram, context).AdvanceTo(0.005)

    assert str(error.value) == problem


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": None}, "arm.yaml: arm_controller.joints: is required but missing"),
        (
            {"joints": []},
            "arm.yaml: arm_controller: joints must have at least one element",
        ),
        (
            {"joints": ["joint1", "joint1"]},
            "arm.yaml: arm_controller: joints must not repeat elements, "
            "got ['joint1', 'joint1']",
        ),
        (
            {"joints": "joint1"},
            "arm.yaml:1: arm_controller.joints: expected a list of str, got 'joint1'",
        ),
        (
            {"command_interfaces": []},
            "arm.yaml: arm_controller: command_interfaces must have at least one "
            "element",
        ),
        (
            {"command_interfaces": ["bad_name"]},
            "arm.yaml:2: arm_controller.command_interfaces: expected one of "
            "['position', 'velocity', 'acceleration', 'effort'], got 'bad_name'",
        ),
        (
            {"state_interfaces": []},
            "arm.yaml: arm_controller: state_interfaces must have at least one element",
        ),
        (
            {"state_interfaces": ["velocity", "acceleration"]},
            "arm.yaml: arm_controller: state_interfaces must have 'position', "
            "got ['velocity', 'acceleration']",
        ),
        (
            {"action_monitor_rate": 0.05},
            "arm.yaml: arm_controller: action_monitor_rate must be at least 0.1 Hz, "
            "got 0.05",
        ),
        (
            {"cmd_timeout": -1.0},
            "arm.yaml: arm_controller: cmd_timeout must be at least 0, got -1.0",
        ),
        (
            {"interpolation_method": "cubic"},
            "arm.yaml:4: arm_controller.interpolation_method: expected one of "
            "['splines', 'none'], got 'cubic'",
        ),
        (
            {"constraints__goal_time": -1.0},
            "arm.yaml: arm_controller.constraints: goal_time must be at least 0, "
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

    tolerances = _make_rules(parameters, make_params()).tolerances

    assert tolerances.path.position.tolist() == [0.0, 0.1]
    assert tolerances.goal.position.tolist() == [0.03, 0.02]
    assert tolerances.goal.velocity.tolist() == [0.2, 0.2]
    assert tolerances.goal_time == 0.5


def test_defaults_are_upstream_s() -> None:
    rules = _make_rules(load(), make_params())

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


@pytest.mark.parametrize(
    ("cmd_timeout", "goal_time", "effective"),
    [(3.0, 2.0, 3.0), (1.0, 2.0, 0.0), (2.0, 2.0, 0.0)],
)
def test_cmd_timeout_must_exceed_goal_time(
    cmd_timeout: float, goal_time: float, effective: float
) -> None:
    parameters = load(cmd_timeout=cmd_timeout, constraints__goal_time=goal_time)

    assert _make_rules(parameters, make_params()).cmd_timeout == effective


def test_the_look_ahead_is_a_period_in_whole_nanoseconds() -> None:
    assert _make_rules(load(), make_params(update_rate=30)).look_ahead_ns == 33_333_333


@pytest.mark.parametrize(
    "name", ["open_loop_control", "interpolate_from_desired_state"]
)
def test_both_names_of_starting_from_the_last_command_work(name: str) -> None:
    parameters = load(**{name: True})

    assert _make_rules(parameters, make_params()).interpolate_from_desired_state


def test_joints_that_the_urdf_calls_continuous_wrap_around() -> None:
    types = {"joint1": "revolute", "joint2": "continuous", "gripper": "prismatic"}

    rules = _make_rules(load(), make_params(joint_types=types))

    assert rules.wraparound.tolist() == [False, True]
    assert _make_rules(load(), make_params()).wraparound is None
