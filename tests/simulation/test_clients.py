"""Handles of controllers: what they send, what they refuse, what they read."""

import warnings

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

import arm_drake as ad
from arm_drake.errors import InputError, ParameterError
from arm_drake.messages import GripperCommand, MultiDOFCommand, ParametersRejected
from arm_drake.simulation.motion_files import parse_motion
from tests.models import load, pendulum, ros2_control, trajectory_controllers
from tests.robots import real_robot

DEMO = "ros2_control_demos/ros2_control_demo_example_1"
JTC = "joint_trajectory_position_controller"
FORWARD = "forward_position_controller"
FORWARD_TYPE = "forward_command_controller/ForwardCommandController"
JSB_TYPE = "joint_state_broadcaster/JointStateBroadcaster"

PID = """
controller_manager:
  ros__parameters:
    update_rate: 100
    jsb: {type: joint_state_broadcaster/JointStateBroadcaster}
    pid: {type: pid_controller/PidController}
pid:
  ros__parameters:
    dof_names: [swing]
    command_interface: effort
    reference_and_state_interfaces: [position, velocity]
    gains: {swing: {p: 100.0, i: 50.0, d: 10.0}}
"""


@pytest.fixture(scope="module")
def rrbot() -> ad.Robot:
    """Return a real robot with a forward and an inactive trajectory controller."""
    files = ("rrbot_controllers.yaml", "rrbot_jtc.yaml")
    return ad.load_robot(
        real_robot(f"{DEMO}/urdf/rrbot.urdf.xacro"),
        controllers=[real_robot(f"{DEMO}/config/{name}") for name in files],
        variables={"joint_prefix": "joint"},
    )


@pytest.fixture
def sim(rrbot) -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(rrbot))


@pytest.fixture
def following(rrbot) -> ad.Simulation:
    """Return a simulation of the same robot with its trajectory controller active."""
    options = ad.SimulationOptions(active=(JTC,), inactive=(FORWARD,))
    return ad.Simulation(ad.build_diagram(rrbot, options=options))


@pytest.fixture
def servoed(tmp_path) -> ad.Simulation:
    """Return a simulation of a pendulum with a PidController."""
    urdf = pendulum(control=ros2_control("swing", command="effort"))
    return ad.Simulation(ad.build_diagram(load(tmp_path, urdf, PID)))


def trajectory(positions, time: float = 1.0) -> ad.JointTrajectory:
    point = ad.JointTrajectoryPoint(positions, time_from_start=time)
    return ad.JointTrajectory(joint_names=["joint1", "joint2"], points=[point])


def parameters_of(sim: ad.Simulation, controller: str):
    """Return the parameters on a controller's port."""
    _, _, system = sim.directory.find(controller)
    context = system.GetMyContextFromRoot(sim.simulator.get_context())
    return system.GetInputPort("parameters").Eval(context)


# Commands


@pytest.mark.slow
@pytest.mark.parametrize("values", [[0.3, -0.2], (0.3, -0.2), np.array([0.3, -0.2])])
def test_commands_move_a_real_robot(sim, values):
    sim.controller(FORWARD).command(values)
    sim.advance_to(2.0)
    np.testing.assert_allclose(sim.joint_states().position, [0.3, -0.2], atol=1e-3)


def test_references_of_a_pid_controller_have_all_its_names(servoed):
    servoed.controller("pid").command([0.5], values_dot=[0.0])

    port = servoed.diagram.GetInputPort("pid.reference")
    (message,) = port.Eval(servoed.simulator.get_context())
    assert isinstance(message, MultiDOFCommand)
    assert (message.dof_names, message.values, message.values_dot) == (
        ("swing",),
        (0.5,),
        (0.0,),
    )


@pytest.mark.slow
def test_a_pid_controller_holds_its_reference(servoed):
    servoed.controller("pid").command([0.5])
    servoed.advance_to(6.0)
    assert servoed.joint_states().position[0] == pytest.approx(0.5, abs=1e-3)
    (dof,) = servoed.controller("pid").state().dof_states
    assert (dof.name, dof.reference) == ("swing", 0.5)


@pytest.mark.slow
def test_the_same_values_once_more_are_a_new_message(sim):
    controller = sim.controller(FORWARD)
    for values in ([0.2, 0.2], [0.0, 0.0], [0.2, 0.2]):
        controller.command(values)
        sim.advance_to(sim.time + 1.0)
    np.testing.assert_allclose(sim.joint_states().position, 0.2, atol=1e-3)


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ([0.3], "expected 2 values (joint1/position, joint2/position), got 1"),
        ([], "expected 2 values (joint1/position, joint2/position), got 0"),
        ([0.0] * 3, "expected 2 values (joint1/position, joint2/position), got 3"),
        (0.3, "expected 2 values (joint1/position, joint2/position), got 0.3"),
        ([0.3, float("nan")], "joint2/position: expected a finite number, got nan"),
        ([float("-inf"), 0.3], "joint1/position: expected a finite number, got -inf"),
        (["0.1", 0.3], "joint1/position: expected a finite number, got '0.1'"),
        ([0.3, True], "joint2/position: expected a finite number, got True"),
        ([0.3, None], "joint2/position: expected a finite number, got None"),
        ([0.3, [0.1]], "joint2/position: expected a finite number, got [0.1]"),
    ],
)
def test_bad_commands_are_refused_before_they_are_sent(sim, values, problem):
    with pytest.raises(InputError) as error:
        sim.controller(FORWARD).command(values)
    assert str(error.value) == f"controller {FORWARD!r}: {problem}"
    port = sim.diagram.GetInputPort(f"{FORWARD}.commands")
    assert not port.HasValue(sim.simulator.get_context())


def test_a_pid_controller_says_what_it_takes(servoed):
    controller = servoed.controller("pid")

    with pytest.raises(InputError) as many:
        controller.command([0.5, 0.5])
    with pytest.raises(InputError) as rates:
        controller.command([0.5], values_dot=[0.0, 0.0])

    assert str(many.value) == (
        "controller 'pid': expected 1 value (swing/position), got 2"
    )
    assert str(rates.value) == (
        "controller 'pid': expected 1 value (swing/velocity), got 2"
    )


def test_rates_need_a_controller_that_takes_them(sim, tmp_path):
    text = PID.replace("[position, velocity]", "[position]")
    urdf = pendulum(control=ros2_control("swing", command="effort"))
    pid = ad.Simulation(ad.build_diagram(load(tmp_path, urdf, text)))

    with pytest.raises(InputError) as without:
        pid.controller("pid").command([0.5], values_dot=[0.0])
    with pytest.raises(InputError) as forward:
        sim.controller(FORWARD).command([0.1, 0.2], values_dot=[0.0, 0.0])

    assert str(without.value) == (
        "controller 'pid': it takes no rates (values_dot) without a second one of "
        "reference_and_state_interfaces"
    )
    assert str(forward.value) == (
        f"controller {FORWARD!r}: it takes no rates (values_dot)"
    )


def test_a_controller_without_a_topic_says_what_it_takes(sim, following):
    jtc, jsb = following.controller(JTC), sim.controller("joint_state_broadcaster")
    forward = sim.controller(FORWARD)
    kind = "joint_trajectory_controller/JointTrajectoryController"
    cases = (
        (
            lambda: jtc.command([0.1, 0.2]),
            f"controller {JTC!r} of type {kind!r} has no commands; it takes "
            "joint_trajectory, follow_joint_trajectory, speed_scaling_input",
        ),
        (
            lambda: jsb.command([0.1]),
            f"controller 'joint_state_broadcaster' of type {JSB_TYPE!r} has no "
            "commands",
        ),
        (
            lambda: forward.send_goal(trajectory([0.0, 0.0])),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r} has no "
            "follow_joint_trajectory; it takes commands",
        ),
        (
            lambda: forward.send_trajectory(trajectory([0.0, 0.0])),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r} has no "
            "joint_trajectory; it takes commands",
        ),
        (
            lambda: forward.set_speed_scaling(1.0),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r} has no "
            "speed_scaling_input; it takes commands",
        ),
        (
            lambda: forward.query_state(1.0),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r} has no query_state",
        ),
        (
            lambda: forward.state(),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r} publishes no "
            "controller_state",
        ),
        (
            lambda: forward.set_parameters({"interface_name": "velocity"}),
            f"controller {FORWARD!r} of type {FORWARD_TYPE!r}: no parameter can "
            "change while it runs",
        ),
    )
    for act, message in cases:
        with pytest.raises(InputError) as error:
            act()
        assert str(error.value) == message


@pytest.mark.slow
def test_a_motion_commands_a_pid_controller(servoed):
    steps = [{"at": 0.5, "controller": "pid", "commands": [0.5]}]
    servoed.run(6.0, parse_motion(steps))
    assert servoed.joint_states().position[0] == pytest.approx(0.5, abs=1e-3)


# Goals


def test_an_inactive_controller_rejects_a_goal(sim):
    goal = sim.controller(JTC).send_goal(trajectory([0.1, 0.1]))
    sim.advance_to(0.1)
    assert goal.status is ad.GoalStatus.REJECTED
    assert goal.result.error_string


@pytest.mark.slow
def test_speed_scaling_stretches_a_trajectory(following):
    controller = following.controller(JTC)
    controller.set_speed_scaling(0.5)
    goal = controller.send_goal(trajectory([0.4, 0.4]))

    following.advance_to(1.0)
    np.testing.assert_allclose(following.joint_states().position, 0.2, atol=0.02)
    assert goal.status is ad.GoalStatus.EXECUTING

    following.advance_to(2.5)
    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert controller.state().speed_scaling_factor == 0.5


@pytest.mark.parametrize("factor", [-0.1, float("nan"), float("inf"), "1", None, True])
def test_a_speed_scaling_is_a_number_of_at_least_0(following, factor):
    with pytest.raises(InputError) as error:
        following.controller(JTC).set_speed_scaling(factor)
    assert str(error.value) == (
        f"controller {JTC!r}: expected a speed scaling factor of at least 0, "
        f"got {factor!r}"
    )


def test_the_state_that_is_planned_for_a_time_can_be_asked(following):
    controller = following.controller(JTC)
    controller.send_trajectory(trajectory([1.0, -1.0], time=2.0))
    following.advance_to(0.5)

    answer = controller.query_state(1.0)

    assert answer.success
    assert answer.name == ("joint1", "joint2")
    np.testing.assert_allclose(answer.position, [0.5, -0.5], atol=0.01)
    np.testing.assert_allclose(answer.velocity, [0.5, -0.5], atol=0.01)
    # Asking changes nothing: what is planned for a later time is as it was.
    assert controller.query_state({"sec": 1}) == answer


@pytest.mark.parametrize("time", [float("nan"), "now", None])
def test_a_time_to_ask_for_is_a_time(following, time):
    with pytest.raises(InputError) as error:
        following.controller(JTC).query_state(time)
    assert str(error.value) == (
        f"controller {JTC!r}: time: expected seconds or {{sec: int, nanosec: int}}, "
        f"got {time!r}"
    )


# Parameters


@pytest.mark.slow
def test_gains_change_while_a_controller_runs(servoed):
    controller = servoed.controller("pid")
    controller.set_parameters({"gains": {"swing": {"p": 0.0, "i": 0.0, "d": 0.0}}})
    servoed.advance_to(0.1)
    controller.command([0.5])
    servoed.advance_to(1.0)
    # Nothing pulls at the pendulum, which hangs.
    assert servoed.joint_states().position[0] == pytest.approx(0.0, abs=1e-9)

    controller.set_parameters({"gains.swing.p": 100.0, "gains.swing.d": 10.0})
    servoed.advance_to(4.0)

    # 100 (0.5 - q) = m g l sin q
    q = servoed.joint_states().position[0]
    assert 100.0 * (0.5 - q) == pytest.approx(9.81 * 0.5 * np.sin(q), rel=1e-2)
    assert servoed.rejected == []


def test_changes_add_up_and_the_rest_stays_as_in_the_file(servoed):
    controller = servoed.controller("pid")
    controller.set_parameters({"gains.swing.p": 1})
    controller.set_parameters({"gains": {"swing.d": np.float64(2.0)}})

    gains = parameters_of(servoed, "pid").gains.dof["swing"]

    assert (gains.p, gains.i, gains.d) == (1.0, 50.0, 2.0)


def test_changes_are_those_of_the_context(servoed):
    controller = servoed.controller("pid")
    controller.set_parameters({"gains.swing.p": 1.0})
    before = servoed.simulator.get_context().Clone()
    controller.set_parameters({"gains.swing.p": 2.0})
    servoed.simulator.reset_context(before)

    controller.set_parameters({"gains.swing.d": 3.0})

    gains = parameters_of(servoed, "pid").gains.dof["swing"]
    assert (gains.p, gains.d) == (1.0, 3.0)


def test_a_reset_takes_changes_back(servoed):
    controller = servoed.controller("pid")
    controller.set_parameters({"gains.swing.p": 1.0})
    servoed.reset()
    controller.set_parameters({"gains.swing.d": 3.0})

    gains = parameters_of(servoed, "pid").gains.dof["swing"]
    assert (gains.p, gains.d) == (100.0, 3.0)


PID_CAN = "enable_feedforward, gains.*, set_current_state_as_first_setpoint"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"gains.swng.p": 1.0},
            "pid.gains.swng.p: unknown parameter; did you mean 'gains.swing.p'?",
        ),
        (
            {"gains": {"swing": {"p": "high"}}},
            "pid.gains.swing.p: expected float, got 'high'",
        ),
        (
            {"gains.swing.u_clamp_max": 1.0, "gains.swing.u_clamp_min": 2.0},
            "pid: gains.swing.u_clamp_min must be below u_clamp_max, got 2.0 and 1.0",
        ),
        (
            {"dof_names": ["elbow"]},
            "pid.dof_names: can't change while the controller runs; these can: "
            f"{PID_CAN}",
        ),
        (
            {"command_interface": "position"},
            "pid.command_interface: can't change while the controller runs; these "
            f"can: {PID_CAN}",
        ),
        (5, "pid: expected parameters by name, got 5"),
        (
            {"update_rate": 50},
            "pid.update_rate: can't change while the controller runs",
        ),
    ],
)
def test_bad_parameters_are_refused_before_they_are_sent(servoed, changes, message):
    with pytest.raises(ParameterError) as error:
        servoed.controller("pid").set_parameters(changes)
    assert str(error.value) == message
    _, _, system = servoed.directory.find("pid")
    context = system.GetMyContextFromRoot(servoed.simulator.get_context())
    assert not system.GetInputPort("parameters").HasValue(context)


def test_a_value_as_it_is_is_no_change(servoed):
    servoed.controller("pid").set_parameters({"dof_names": ("swing",)})
    servoed.advance_to(0.1)
    assert servoed.rejected == []


def test_tolerances_of_a_trajectory_controller_change(following):
    controller = following.controller(JTC)
    controller.set_parameters(
        {"constraints": {"joint1": {"trajectory": 1e-9}, "goal_time": 0.5}}
    )
    # As upstream, a goal of the same tick is still judged by what was before.
    following.advance_to(0.1)
    goal = controller.send_goal(trajectory([1.0, 1.0], time=0.2))
    following.advance_to(1.0)
    assert goal.status is ad.GoalStatus.ABORTED
    assert goal.result.error_code == -4


def test_parameters_that_do_not_act_are_refused(following):
    with pytest.raises(ParameterError) as error:
        following.controller(JTC).set_parameters({"gains.joint1.p": 5.0})
    assert str(error.value) == (
        f"{JTC}.gains.joint1.p: gains act on 'velocity' or 'effort' alone, not on "
        "['position']"
    )


def test_parameters_that_the_controller_refuses_are_news(servoed):
    # Past the handle, which would have found it.
    _, _, system = servoed.directory.find("pid")
    root = servoed.simulator.get_mutable_context()
    system.GetInputPort("parameters").FixValue(
        system.GetMyMutableContextFromRoot(root), AbstractValue.Make(["gains"])
    )
    servoed.advance_to(0.1)

    (rejected,) = servoed.rejected
    assert isinstance(rejected, ParametersRejected)
    assert servoed.mailbox.describe(rejected) == (
        "pid: parameters refused: expected PidControllerParameters, got ['gains']"
    )


LACKING = """
controller_manager:
  ros__parameters:
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    hand: {type: position_controllers/GripperActionController}
    speeds: {type: velocity_controllers/JointGroupVelocityController}
    lost: {type: forward_command_controller/ForwardCommandControler}
    typo: {type: forward_command_controller/ForwardCommandController}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [velocity]
    state_interfaces: [position, velocity]
    gains: {swing: {p: 1.0}}
hand: {ros__parameters: {joint: fist}}
speeds: {ros__parameters: {joints: [swing]}}
typo: {ros__parameters: {interface_name: position}}
"""


def test_who_asks_a_controller_that_can_t_run_learns_why(tmp_path) -> None:
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum(), LACKING)))
    lacks = (
        "the controller can't be activated: joint 'swing' has no command interface "
        "'velocity'; it has ['position']"
    )
    trajectory = ad.JointTrajectory(
        joint_names=["swing"],
        points=[ad.JointTrajectoryPoint([0.1], time_from_start=1.0)],
    )

    goal = sim.controller("arm").send_goal(trajectory)
    grip = sim.controller("hand").send_goal(GripperCommand(0.1))
    sim.controller("speeds").command([0.1])
    sim.run(0.1)

    assert goal.result.error_string == lacks
    assert goal.describe() == f"REJECTED, error code -1: {lacks}"
    assert grip.describe().startswith(
        "REJECTED: the controller can't be activated: the robot has no joint 'fist'"
    )
    assert [each.reason for each in sim.rejected] == [lacks]
    step = {"controller": "speeds", "commands": [0.1]}
    with pytest.raises(InputError, match="'speeds' is inactive, not active: joint"):
        sim.run(0.1, parse_motion([step]))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        (
            "lost",
            "unknown controller type 'forward_command_controller/"
            "ForwardCommandControler'; did you mean 'forward_command_controller/"
            "ForwardCommandController'?",
        ),
        ("typo", "typo.joints: is required but missing"),
    ],
)
def test_a_controller_that_could_not_be_loaded_says_why(tmp_path, name, reason) -> None:
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum(), LACKING)))

    with pytest.raises(InputError) as caught:
        sim.controller(name)

    assert str(caught.value) == f"controller {name!r} could not be loaded: {reason}"


def test_a_program_is_warned_of_a_trajectory_beyond_the_limits(tmp_path) -> None:
    yaml = trajectory_controllers({"arm": ["swing"]})
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum(), yaml)))
    arm, topic = sim.controller("arm"), sim.topic("arm/joint_trajectory")

    def to(position: float, time: float) -> ad.JointTrajectory:
        point = ad.JointTrajectoryPoint([position], time_from_start=time)
        return ad.JointTrajectory(joint_names=["swing"], points=[point])

    beyond = r"^arm: points\[0\]: swing 4 is outside \[-3, 3\]$"
    fast = r"^arm: points\[0\]: swing would move at 20 rad/s, its limit is 10 rad/s$"
    for send in (arm.send_goal, arm.send_trajectory, topic.publish):
        with pytest.warns(ad.ArmDrakeWarning, match=beyond) as told:
            send(to(4.0, 9.0))
        assert told[0].filename == __file__
        with pytest.warns(ad.ArmDrakeWarning, match=fast):
            send(to(2.0, 0.1))

    goal = {"joint_names": ["swing"], "points": [{"positions": [4.0]}]}
    motion = parse_motion([{"controller": "arm", "goal": goal}])
    with pytest.warns(ad.ArmDrakeWarning, match=r"^\[0\]\.goal\.points\[0\]: swing 4 "):
        sim.run(0.1, motion)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.send_goal(to(2.9, 5.0))
