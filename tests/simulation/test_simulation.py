"""Simulation: messages in, news and a rollout out."""

import dataclasses as dc
import gc
import time

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError, MotionError, SimulationError
from arm_drake.manager.state import ControllerFailure
from arm_drake.messages import Float64MultiArray, SwitchControllerResult, TopicRejected
from arm_drake.simulation.motion_files import parse_motion
from tests.models import load, pendulum
from tests.robots import real_robot

JTC = "joint_trajectory_controller"
JOINTS = tuple(f"joint{i}" for i in range(1, 7))


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("doosan_a0912")


@pytest.fixture
def sim(robot) -> ad.Simulation:
    options = ad.SimulationOptions(time_step=0.01)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def trajectory(positions, time: float = 0.2, joints=JOINTS) -> ad.JointTrajectory:
    point = ad.JointTrajectoryPoint(positions, time_from_start=time)
    return ad.JointTrajectory(joint_names=joints, points=[point])


def test_joint_states_hold_when_they_are_read(sim):
    sim.advance_to(0.25)

    assert sim.joint_states().header.stamp == ad.messages.Time(0, 250_000_000)


def test_a_simulation_and_a_controller_are_short_in_notebooks(sim):
    sim.advance_to(0.25)

    assert repr(sim) == "<Simulation, robots ['a0912'], 0.25 s>"
    assert repr(sim.controller(JTC)) == (
        f"<ControllerHandle '{JTC}' of type '{JTC}/JointTrajectoryController'>"
    )


@pytest.mark.slow
def test_a_goal_goes_through_its_life(sim):
    handle = sim.controller(JTC).send_goal(trajectory([0.05] * 6))
    assert handle.status is ad.GoalStatus.PENDING

    sim.advance_to(0.1)
    assert handle.status is ad.GoalStatus.EXECUTING
    assert handle.result is None

    sim.advance_to(0.5)
    assert handle.status is ad.GoalStatus.SUCCEEDED
    assert handle.result.error_code == 0


def test_feedback_comes_at_the_action_monitor_rate(sim):
    handle = sim.controller(JTC).send_goal(trajectory([0.1] * 6, time=1.0))
    sim.advance_to(0.9)
    # 20 Hz, the first after 50 ms.
    stamps = [feedback.header.stamp.to_seconds() for feedback in handle.feedback]
    np.testing.assert_allclose(np.diff(stamps), 0.05)
    assert len(stamps) == 17
    assert handle.feedback[0].joint_names == JOINTS


@pytest.mark.slow
def test_two_goals_at_once_are_taken_one_after_the_other(sim):
    controller = sim.controller(JTC)
    first = controller.send_goal(trajectory([0.1] * 6))
    second = controller.send_goal(trajectory([-0.05] * 6))

    sim.advance_to(1.0)

    assert first.status is ad.GoalStatus.ABORTED
    assert first.result.error_string == (
        "Current goal preempted by new incoming action."
    )
    assert second.status is ad.GoalStatus.SUCCEEDED
    np.testing.assert_allclose(sim.joint_states().position, -0.05, atol=2e-3)


@pytest.mark.slow
def test_a_cancelled_goal_stops_the_arm(sim):
    controller = sim.controller(JTC)
    handle = controller.send_goal(trajectory([1.0] * 6, time=2.0))
    sim.advance_to(1.0)

    controller.cancel()
    sim.advance_to(2.5)

    assert handle.status is ad.GoalStatus.CANCELED
    # Half-way, and it stayed there.
    np.testing.assert_allclose(sim.joint_states().position, 0.5, atol=0.05)
    np.testing.assert_allclose(sim.joint_states().velocity, 0.0, atol=1e-3)


@pytest.mark.slow
def test_a_rejected_goal_says_why(sim):
    handle = sim.controller(JTC).send_goal(trajectory([0.0], joints=["joint1"]))
    sim.advance_to(0.1)
    assert handle.status is ad.GoalStatus.REJECTED
    assert handle.result.error_string.startswith("joints ['joint2', 'joint3'")


@pytest.mark.slow
def test_goals_that_were_rejected_or_aborted_are_failures(sim):
    controller = sim.controller(JTC)
    rejected = controller.send_goal(trajectory([0.0], joints=["joint1"]))
    aborted = controller.send_goal(
        ad.FollowJointTrajectoryGoal(
            trajectory=trajectory([1.0] * 6, time=0.1),
            path_tolerance=[ad.JointTolerance("joint1", position=1e-3)],
        )
    )
    sim.advance_to(0.5)

    done = controller.send_goal(trajectory([0.0] * 6))
    sim.advance_to(1.5)
    canceled = controller.send_goal(trajectory([0.1] * 6))
    sim.advance_to(1.6)
    controller.cancel()
    sim.advance_to(2.0)

    assert sim.failures == [rejected, aborted]
    assert "path tolerance violation (position of 'joint1' is off by" in repr(aborted)
    assert done.status is ad.GoalStatus.SUCCEEDED
    assert canceled.status is ad.GoalStatus.CANCELED


@pytest.mark.slow
def test_a_trajectory_on_the_topic_moves_the_arm(sim):
    sim.controller(JTC).send_trajectory(trajectory([0.1] * 6))
    sim.advance_to(1.0)
    np.testing.assert_allclose(sim.joint_states().position, 0.1, atol=2e-3)


def test_a_refused_message_is_news(sim):
    news = []
    sim.on_event(news.append)
    message = trajectory([0.1] * 5)

    sim.controller(JTC).send_trajectory(message)
    sim.advance_to(0.1)

    reason = "points[0].positions has 5 elements; expected 6, one per joint"
    assert news == [TopicRejected(message, reason)]
    assert sim.rejected == news


def test_the_controllers_state_is_as_upstream_publishes_it(sim):
    sim.controller(JTC).send_goal(trajectory([0.2] * 6, time=0.2))
    sim.advance_to(0.105)

    state = sim.controller(JTC).state()

    assert state.header.stamp.to_seconds() == pytest.approx(0.1)
    assert state.joint_names == JOINTS
    # Half of the straight line from 0 to 0.2 rad.
    np.testing.assert_allclose(state.reference.positions, 0.1)
    np.testing.assert_allclose(state.reference.velocities, 1.0)
    np.testing.assert_allclose(
        state.error.positions,
        np.subtract(state.reference.positions, state.feedback.positions),
    )
    # The command looks one period ahead.
    np.testing.assert_allclose(state.output.positions, 0.11)


@pytest.mark.slow
def test_advancing_in_small_steps_changes_nothing(robot):
    ends = []
    for chunk in (1.0, 0.25, 0.0037):
        sim = ad.Simulation(ad.build_diagram(robot))
        sim.controller(JTC).send_goal(trajectory([0.3] * 6, time=0.5))
        while sim.time < 1.0:
            sim.advance_to(min(sim.time + chunk, 1.0))
        ends.append(sim.joint_states())
    assert ends[0] == ends[1] == ends[2]


@pytest.mark.slow
def test_reset_starts_over(sim):
    sim.controller(JTC).send_goal(trajectory([0.3] * 6))
    sim.advance_to(0.5)
    first = sim.rollout()

    sim.reset()
    assert sim.time == 0.0
    assert sim.joint_states().position == (0.0,) * 6
    assert sim.goals == []
    sim.controller(JTC).send_goal(trajectory([0.3] * 6))
    sim.advance_to(0.5)

    np.testing.assert_array_equal(sim.rollout().position, first.position)


@pytest.mark.slow
def test_a_simulation_outlives_the_diagrams_python_names(robot):
    sim = ad.Simulation(ad.build_diagram(robot))
    gc.collect()
    sim.advance_to(0.2)
    np.testing.assert_allclose(sim.joint_states().position, 0.0, atol=1e-6)


@pytest.mark.slow
def test_messages_of_a_motion_are_sent_when_they_are_due(sim):
    point = {"positions": [0.1] * 6, "time_from_start": 0.1}
    message = {"joint_names": list(JOINTS), "points": [point]}
    motion = parse_motion(
        [
            {"at": 0.33, "controller": JTC, "goal": message},
            {"at": 0.1, "controller": JTC, "trajectory": message},
        ]
    )
    sim.run(0.3, motion)
    assert sim.goals == []
    position = sim.rollout().position[:, 0]
    assert np.abs(position[:11]).max() < 1e-6
    assert position[-1] > 0.05

    sim.reset()
    sim.run(0.5, motion)
    (goal,) = sim.goals
    assert goal.status is ad.GoalStatus.SUCCEEDED


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (
            {"controller": "jtc", "cancel": True},
            "[0].cancel: no controller 'jtc'; known: end_effector_sensor, "
            "joint_state_broadcaster, "
            "joint_trajectory_controller",
        ),
        (
            {"controller": "joint_state_broadcaster", "cancel": True},
            "[0].cancel: controller 'joint_state_broadcaster' of type "
            "'joint_state_broadcaster/JointStateBroadcaster' has no "
            "follow_joint_trajectory",
        ),
    ],
)
def test_a_motion_for_the_wrong_controller_is_an_error_before_the_start(
    sim, step, message
):
    with pytest.raises(MotionError) as error:
        sim.run(1.0, parse_motion([step]))
    assert str(error.value) == message
    assert sim.time == 0.0


def test_time_does_not_go_back(sim):
    sim.advance_to(0.2)
    with pytest.raises(ValueError, match=r"can't go from 0\.2 s to 0\.1 s"):
        sim.advance_to(0.1)
    with pytest.raises(ValueError, match=r"up to \[s\], got '2'"):
        sim.advance_to("2")


def test_a_diagram_without_a_robot_is_refused():
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import ConstantVectorSource

    builder = DiagramBuilder()
    builder.AddSystem(ConstantVectorSource([1.0]))
    with pytest.raises(InputError) as error:
        ad.Simulation(builder.Build())
    assert str(error.value) == (
        "the diagram has no robot at its top; expected one of build_diagram"
    )


@pytest.mark.slow
def test_two_robots_have_names_of_their_own():
    robots = [
        ad.load_robot("doosan_a0912", name="left", pose=[0, 0.5, 0, 0, 0, 0]),
        ad.load_robot("doosan_a0912", name="right", pose=[0, -0.5, 0, 0, 0, 0]),
    ]
    options = ad.SimulationOptions(time_step=0.01)
    sim = ad.Simulation(ad.build_diagram(robots, options=options))

    sim.controller(f"left/{JTC}").send_goal(trajectory([0.1] * 6))
    sim.advance_to(0.5)

    np.testing.assert_allclose(sim.joint_states("left").position, 0.1, atol=2e-3)
    np.testing.assert_allclose(sim.joint_states("right").position, 0.0, atol=1e-6)
    assert sim.link_poses("right")["base_0"].translation()[1] == -0.5
    assert sim.rollout("left").position[-1, 0] > 0.09


@pytest.mark.parametrize("moment", [float("nan"), float("inf")])
def test_a_time_that_is_no_number_is_refused(sim, moment):
    with pytest.raises(ValueError, match="can't go from"):
        sim.advance_to(moment)
    with pytest.raises(ValueError, match="duration must be at least 0 s"):
        sim.run(moment)


@pytest.mark.slow
def test_a_motion_is_given_by_name_by_file_or_as_itself():
    robot = ad.load_robot("doosan_a0912")
    motion = ad.load_motion("tutorial", robot=robot)
    options = ad.SimulationOptions(preset="kinematic")
    ends = []
    for given in ("tutorial", motion.file, motion):
        sim = ad.Simulation(ad.build_diagram(robot, options=options))
        sim.run(motion=given)
        ends.append((sim.time, *sim.joint_states().position))

    assert ends[0][0] == motion.duration + 1.0
    assert ends[0] == ends[1] == ends[2]
    assert max(ends[0][1:]) > 0.1


@pytest.mark.slow
def test_without_a_motion_it_runs_for_ten_seconds(sim):
    sim.run()

    assert sim.time == 10.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        ({"motion": "none"}, MotionError, "no motion 'none' of 'doosan_a0912'"),
        ({"motion": 3}, MotionError, "motion: expected a Motion, a name or a file"),
        ({"duration": "tutorial"}, ValueError, "duration must be at least 0 s"),
    ],
)
def test_what_is_no_motion_or_duration_is_refused(sim, words, error, message):
    with pytest.raises(error, match=message):
        sim.run(**words)


def test_a_bundled_motion_without_its_robot_says_what_is_missing():
    with pytest.raises(MotionError, match=r"of a robot needs robot="):
        ad.load_motion("tutorial")


@pytest.mark.slow
def test_the_same_message_once_more_is_a_new_one(sim):
    controller, message = sim.controller(JTC), trajectory([0.1] * 6)
    controller.send_trajectory(message)
    sim.advance_to(0.5)
    controller.send_trajectory(trajectory([0.0] * 6))
    sim.advance_to(1.0)

    controller.send_trajectory(message)
    sim.advance_to(1.5)

    np.testing.assert_allclose(sim.joint_states().position, 0.1, atol=2e-3)


@pytest.mark.slow
def test_a_simulation_goes_on_from_a_context_of_before(sim):
    sim.advance_to(0.5)
    before = sim.simulator.get_context().Clone()
    sim.advance_to(1.5)

    sim.simulator.reset_context(before)
    sim.simulator.Initialize()
    goal = sim.controller(JTC).send_goal(trajectory([0.1] * 6))
    sim.advance_to(1.0)

    assert goal.status is ad.GoalStatus.SUCCEEDED


@pytest.mark.slow
def test_a_simulation_goes_on_where_its_simulator_was_taken(sim):
    sim.simulator.AdvanceTo(0.505)
    goal = sim.controller(JTC).send_goal(trajectory([0.1] * 6))
    sim.advance_to(1.0)
    assert goal.status is ad.GoalStatus.SUCCEEDED


@pytest.mark.slow
def test_robots_with_different_rates_get_their_messages_in_time(robot):
    odd = dc.replace(
        robot,
        name="odd",
        pose=(0.0, 3.0, 0.0, 0.0, 0.0, 0.0),
        controllers=dc.replace(robot.controllers, update_rate=97),
    )
    sim = ad.Simulation(ad.build_diagram([robot, odd]))
    sim.advance_to(0.02)

    goals = [
        sim.controller(f"{name}/{JTC}").send_goal(trajectory([0.1] * 6, time=0.5))
        for name in ("a0912", "odd")
    ]
    sim.advance_to(0.9)

    assert [goal.status for goal in goals] == [ad.GoalStatus.SUCCEEDED] * 2


@pytest.mark.slow
def test_the_real_time_rate_counts_from_the_run(sim):
    sim.advance_to(5.0)
    start = time.perf_counter()
    sim.run(0.2, realtime_rate=1.0)
    assert 0.15 < time.perf_counter() - start < 3.0


@pytest.mark.slow
def test_a_tolerance_that_does_not_hold_is_noted(sim):
    goal = ad.FollowJointTrajectoryGoal(
        trajectory=trajectory([0.1] * 6),
        goal_tolerance=[ad.JointTolerance("elbow", position=0.1)],
    )
    handle = sim.controller(JTC).send_goal(goal)
    sim.advance_to(0.1)
    assert handle.note == (
        "goal_tolerance: no joint 'elbow'; known: joint1, joint2, joint3, joint4, "
        "joint5, joint6; the controller's defaults hold"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["servo", "plant", "frames", "joint_states"])
def test_a_controller_may_have_any_name(tmp_path, name):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(
        f"controller_manager: {{ros__parameters: {{update_rate: 100, {name}: "
        "{type: joint_state_broadcaster/JointStateBroadcaster}}}}\n".replace(
            "}}}}", "}}}"
        ),
        encoding="utf-8",
    )
    robot = ad.load_robot("doosan_a0912", controllers=yaml)
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.advance_to(0.02)
    published = sim.diagram.GetOutputPort(f"{name}.joint_states")
    assert published.Eval(sim.simulator.get_context()).name == JOINTS


@pytest.mark.slow
def test_building_a_diagram_leaves_the_robots_report_alone(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    jtc = "joint_trajectory_controller/JointTrajectoryController"
    parameters = (
        "{ros__parameters: {joints: [joint1], command_interfaces: [position], "
        "state_interfaces: [position]}}"
    )
    yaml.write_text(
        "controller_manager:\n  ros__parameters:\n    update_rate: 100\n"
        f"    a: {{type: {jtc}}}\n    b: {{type: {jtc}}}\n"
        f"a: {parameters}\nb: {parameters}\n",
        encoding="utf-8",
    )
    robot = ad.load_robot("doosan_a0912", controllers=yaml)
    assert len(robot.report) == 0

    for options, inactive, active in (
        (ad.SimulationOptions(), "b", "a"),
        (ad.SimulationOptions(active=("b",)), "a", "b"),
    ):
        sim = ad.Simulation(ad.build_diagram(robot, options=options))
        (reported,) = (entry for entry in sim.report if entry.severity == "warning")
        assert str(reported) == (
            f"warning: {yaml}:{4 + (inactive == 'b')}: {inactive}: "
            f"'joint1/position' is claimed by {active!r}, which stays "
            "active; the controller stays inactive"
        )
    assert len(robot.report) == 0


@pytest.mark.slow
def test_messages_wait_for_the_tick_of_a_slower_controller(robot, tmp_path):
    (published,) = robot.controllers.files
    yaml = tmp_path / "controllers.yaml"
    text = published.read_text(encoding="utf-8")
    own = f"{JTC}:\n  ros__parameters:\n"
    assert own in text
    yaml.write_text(text.replace(own, f"{own}    update_rate: 20\n"), encoding="utf-8")
    slow = ad.load_robot("doosan_a0912", controllers=yaml)
    sim = ad.Simulation(ad.build_diagram(slow))
    sim.advance_to(0.01)

    goals = [
        sim.controller(JTC).send_goal(trajectory([angle] * 6)) for angle in (0.1, 0.05)
    ]
    sim.advance_to(1.0)

    # Both were seen, one after the other.
    assert [goal.status for goal in goals] == [
        ad.GoalStatus.ABORTED,
        ad.GoalStatus.SUCCEEDED,
    ]


# Switches, failures and what motions do with them


FORWARD = "forward_position_controller"
VELOCITY = "forward_velocity_controller"


@pytest.fixture(scope="module")
def multi() -> ad.Robot:
    """Return a real robot whose controllers compete for two joints."""
    package = "ros2_control_demos/ros2_control_demo_example_3"
    return ad.load_robot(
        real_robot(f"{package}/urdf/rrbot_system_multi_interface.urdf.xacro")
    )


@pytest.fixture
def competing(multi) -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(multi))


def states(sim: ad.Simulation) -> dict[str, str]:
    return {row.name: row.state for row in sim.list_controllers()}


@pytest.mark.slow
def test_the_list_of_controllers_reads_as_a_table(sim):
    listed = sim.list_controllers()
    assert str(listed).splitlines() == [
        "joint_state_broadcaster      joint_state_broadcaster/JointStateBroadcaster"
        "          active",
        "joint_trajectory_controller  joint_trajectory_controller/"
        "JointTrajectoryController  active",
        "end_effector_sensor          gazebo_plugins/GazeboRosBumper"
        "                         active",
    ]
    assert [row.name for row in listed] == [
        "joint_state_broadcaster",
        JTC,
        "end_effector_sensor",
    ]
    assert isinstance(listed, list)


@pytest.mark.slow
def test_a_switch_hands_the_joints_of_a_real_robot_over(competing):
    sim = competing
    sim.controller(FORWARD).command([0.3, 0.3])
    sim.advance_to(1.5)

    problems = sim.switch_controllers(activate=[VELOCITY], deactivate=[FORWARD])
    sim.controller(VELOCITY).command([0.2, -0.2])
    sim.advance_to(2.5)

    assert problems == ()
    assert (states(sim)[FORWARD], states(sim)[VELOCITY]) == ("inactive", "active")
    np.testing.assert_allclose(sim.joint_states().velocity, [0.2, -0.2], atol=1e-2)
    np.testing.assert_allclose(sim.joint_states().position, [0.5, 0.1], atol=0.03)
    assert (sim.rejected, sim.failures) == ([], [])


CLAIMED = (
    "could not activate 'forward_illegal1_controller': 'joint1/position' is claimed by "
    "'forward_position_controller', which stays active"
)


def test_a_strict_switch_is_refused_as_a_whole(competing):
    with pytest.raises(InputError) as error:
        competing.switch_controllers(
            ["forward_illegal1_controller"], ["joint_state_broadcaster"]
        )
    competing.advance_to(0.1)

    assert str(error.value) == CLAIMED
    assert states(competing)["joint_state_broadcaster"] == "active"
    assert competing.failures == []


def test_the_result_of_a_switch_is_news(competing):
    news = []
    competing.on_event(news.append)

    problems = competing.switch_controllers(
        ["forward_illegal1_controller"],
        ["joint_state_broadcaster"],
        strictness="best_effort",
    )
    competing.advance_to(0.1)

    assert problems == (CLAIMED,)
    (result,) = news
    assert isinstance(result, SwitchControllerResult)
    # All controllers to activate were left out, so the service says no.
    assert (result.ok, result.message) == (False, CLAIMED)
    assert competing.failures == news
    assert states(competing)["joint_state_broadcaster"] == "inactive"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            (
                {name: value},
                f"{name}_controllers: expected names of controllers, got {value!r}",
            )
            for name in ("activate", "deactivate")
            for value in ("abc", None, 1, [1], [["a"]])
        ),
        (
            {"strictness": "stric"},
            "unknown strictness 'stric'; did you mean 'strict'? known: best_effort, "
            "strict",
        ),
        ({"strictness": ""}, "unknown strictness ''; known: best_effort, strict"),
        ({"robot": "r2"}, "no robot 'r2'; known: a0912"),
        ({"robot": ["r2"]}, "no robot ['r2']; known: a0912"),
        (
            {"activate": ["jtc"]},
            "no controller 'jtc'; known: end_effector_sensor, joint_state_broadcaster, "
            "joint_trajectory_controller",
        ),
    ],
)
def test_a_switch_that_makes_no_sense_is_refused(sim, arguments, message):
    with pytest.raises(InputError) as error:
        sim.switch_controllers(**arguments)
    assert str(error.value) == message


def test_a_request_to_switch_is_one(sim):
    with pytest.raises(InputError) as error:
        sim.request_switch(None)
    assert str(error.value) == "expected a SwitchController, got None"


@pytest.mark.slow
def test_a_controller_is_found_by_its_name_alone(sim):
    with pytest.raises(InputError, match=r"^no controller \[1\]; known: end_effector"):
        sim.controller([1])


@pytest.mark.slow
def test_a_switch_of_several_robots_names_them():
    robots = [
        ad.load_robot("doosan_a0912", name=name, pose=[0, y, 0, 0, 0, 0])
        for name, y in (("left", 0.5), ("right", -0.5))
    ]
    options = ad.SimulationOptions(time_step=0.01)
    sim = ad.Simulation(ad.build_diagram(robots, options=options))

    sim.switch_controllers(deactivate=[f"right/{JTC}"])
    sim.switch_controllers(deactivate=["joint_state_broadcaster"], robot="left")
    sim.advance_to(0.1)

    assert states(sim) == {
        "left/joint_state_broadcaster": "inactive",
        f"left/{JTC}": "active",
        "left/end_effector_sensor": "active",
        "right/joint_state_broadcaster": "active",
        f"right/{JTC}": "inactive",
        "right/end_effector_sensor": "active",
    }


def test_a_controller_that_fails_is_news(competing):
    news = []
    competing.on_event(news.append)
    # Past the handle, which would have found it.
    message = Float64MultiArray([1.0])
    competing.publish(f"{FORWARD}.commands", message, 0.01)

    competing.advance_to(0.1)

    rejected, failure = news
    assert (competing.rejected, competing.failures) == ([rejected], [failure])
    assert isinstance(failure, ControllerFailure)
    assert (failure.controller, failure.deactivated) == (FORWARD, (FORWARD,))
    assert states(competing)[FORWARD] == "inactive"
    assert [competing.mailbox.describe(event) for event in news] == [
        f"{FORWARD}: commands refused: data must have 2 values (joint1/position, "
        "joint2/position), got 1; the update fails",
        f"{FORWARD}: the update failed (data must have 2 values (joint1/position, "
        "joint2/position), got 1), the controller is deactivated",
    ]


def test_a_reset_forgets_failures(competing):
    competing.publish(f"{FORWARD}.commands", Float64MultiArray([1.0]), 0.01)
    competing.advance_to(0.1)
    competing.reset()
    assert (competing.rejected, competing.failures) == ([], [])
    competing.advance_to(0.1)
    assert (competing.rejected, competing.failures) == ([], [])
    assert states(competing)[FORWARD] == "active"


@pytest.mark.slow
def test_a_motion_commands_and_switches_controllers(competing):
    motion = parse_motion(
        [
            {"at": 0.0, "controller": FORWARD, "commands": [0.1, 0.1]},
            {
                "at": 1.0,
                "every": 0.02,
                "count": 51,
                "controller": FORWARD,
                "commands_from_to": [[0.1, 0.1], [0.6, -0.4]],
            },
            {
                "at": 3.0,
                "switch_controllers": {"activate": [VELOCITY], "deactivate": [FORWARD]},
            },
            {"at": 3.0, "controller": VELOCITY, "commands": [-0.1, 0.1]},
        ]
    )

    for _ in range(2):  # A motion can be played again.
        competing.run(3.0, motion)
        position, time = competing.rollout().position, competing.rollout().time
        middle = position[time.searchsorted(1.5)]
        np.testing.assert_allclose(middle, [0.35, -0.15], atol=0.03)
        np.testing.assert_allclose(position[-1], [0.6, -0.4], atol=1e-3)
        assert states(competing)[VELOCITY] == "inactive"
        competing.reset()

    competing.run(4.0, motion)
    assert states(competing)[VELOCITY] == "active"
    np.testing.assert_allclose(
        competing.joint_states().velocity, [-0.1, 0.1], atol=0.01
    )
    assert (competing.rejected, competing.failures) == ([], [])


@pytest.mark.slow
def test_a_motion_scales_the_speed(sim):
    point = {"positions": [0.2] * 6, "time_from_start": 1.0}
    message = {"joint_names": list(JOINTS), "points": [point]}
    motion = parse_motion(
        [
            {"at": 0.0, "controller": JTC, "speed_scaling": 0.5},
            {"at": 0.0, "controller": JTC, "goal": message},
        ]
    )
    sim.run(1.0, motion)
    (goal,) = sim.goals
    np.testing.assert_allclose(sim.joint_states().position, 0.1, atol=0.01)

    sim.advance_to(motion.duration + 0.5)

    assert motion.duration == 2.0
    assert goal.status is ad.GoalStatus.SUCCEEDED


def test_a_switch_that_a_motion_is_refused_is_a_failure_with_its_place(competing):
    switch = {"activate": ["forward_illegal1_controller"]}
    competing.run(0.1, parse_motion([{"at": 0.02, "switch_controllers": switch}]))

    (failure,) = competing.failures
    assert competing.mailbox.describe(failure) == (
        f"[0].switch_controllers: controller_manager: switch refused: {CLAIMED}"
    )


ACTIVATE = {
    "at": 0.5,
    "switch_controllers": {"activate": [VELOCITY], "deactivate": [FORWARD]},
}


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        (
            [{"controller": FORWARD, "commands": [1]}],
            f"[0].commands: controller {FORWARD!r}: expected 2 values "
            "(joint1/position, joint2/position), got 1",
        ),
        (
            [{"controller": VELOCITY, "commands": [1, 2]}],
            f"[0].commands: controller {VELOCITY!r} is inactive, not active",
        ),
        (
            [{"controller": VELOCITY, "commands": [1, 2]}, ACTIVATE],
            f"[0].commands: controller {VELOCITY!r} is inactive, not active",
        ),
        (
            [{"at": 1.0, "controller": VELOCITY, "commands": [1]}, ACTIVATE],
            f"[0].commands: controller {VELOCITY!r}: expected 2 values "
            "(joint1/velocity, joint2/velocity), got 1",
        ),
        (
            [{"controller": "joint_state_broadcaster", "commands": [1]}],
            "[0].commands: controller 'joint_state_broadcaster' of type "
            "'joint_state_broadcaster/JointStateBroadcaster' has no commands",
        ),
        (
            [{"controller": FORWARD, "speed_scaling": 1}],
            f"[0].speed_scaling: controller {FORWARD!r} of type "
            "'forward_command_controller/ForwardCommandController' has no "
            "speed_scaling_input; it takes commands",
        ),
        (
            [{"switch_controllers": {"deactivate": ["forward_position_control"]}}],
            "[0].switch_controllers: no controller 'forward_position_control'; "
            "did you mean 'forward_position_controller'? known: "
            "forward_acceleration_controller, forward_illegal1_controller, "
            "forward_illegal2_controller, "
            "forward_position_controller, forward_velocity_controller, "
            "joint_state_broadcaster",
        ),
    ],
)
def test_a_motion_that_can_not_go_is_found_before_the_start(competing, steps, message):
    with pytest.raises(MotionError) as error:
        competing.run(1.0, parse_motion(steps))
    assert str(error.value) == message
    assert competing.time == 0.0


def test_a_kinematic_simulation_takes_the_same_messages(multi):
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(multi, options=options))

    sim.controller(FORWARD).command([0.3, -0.3])
    sim.advance_to(0.1)

    assert sim.joint_states().position == (0.3, -0.3)


@pytest.mark.slow
def test_what_was_sent_after_a_context_was_saved_is_undone_with_it(tmp_path):
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    sim.advance_to(0.3)
    saved = sim.simulator.get_context().Clone()
    sim.switch_controllers(deactivate=["joint_trajectory_controller"])
    sim.advance_to(0.5)

    sim.simulator.reset_context(saved.Clone())
    sim.switch_controllers(deactivate=["joint_state_broadcaster"])
    sim.advance_to(0.5)

    states = {row.name: row.state for row in sim.list_controllers()}
    assert states == {
        "joint_state_broadcaster": "inactive",
        "joint_trajectory_controller": "active",
        "end_effector_sensor": "active",
    }


def test_a_simulation_that_cannot_go_on_says_when_and_why(tmp_path):
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum())))
    sim.run(0.1)

    # Something outside of all numbers.
    context = sim.simulator.get_mutable_context()
    plant = sim.diagram.GetSubsystemByName("plant")
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), [1e308])
    plant.SetVelocities(plant.GetMyMutableContextFromRoot(context), [1e308])

    with pytest.raises(SimulationError, match=r"^the simulation can't go on at 0\.1"):
        sim.run(0.1)
    assert len(sim.rollout().time) > 0


@pytest.mark.slow
def test_messages_of_one_instant_lie_in_order_as_their_context_knows_them(sim):
    port, messages = f"{JTC}.joint_trajectory", [trajectory([0.1] * 6) for _ in "abcd"]

    def lying() -> list[int]:
        value = sim.diagram.GetInputPort(port).Eval(sim.simulator.get_context())
        return [next(k for k, m in enumerate(messages) if m is v) for v in value]

    for message in messages[:2]:
        sim.mailbox.publish(port, message, sim.period)
    before = sim.simulator.get_context().Clone()
    sim.mailbox.publish(port, messages[2], sim.period)
    assert lying() == [0, 1, 2]

    sim.simulator.reset_context(before)
    assert lying() == [0, 1]
    sim.mailbox.publish(port, messages[3], sim.period)
    assert lying() == [0, 1, 3]

    sim.run(3.0 * sim.period)
    sim.mailbox.publish(port, messages[0], sim.period)
    assert lying() == [0]
