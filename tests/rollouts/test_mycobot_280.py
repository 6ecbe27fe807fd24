"""The myCobot tutorial: Gazebo's soft plugins, ros2_control, Classic's poses."""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, models_folder
from arm_drake.simulation.motion import Motion

ROBOT = "mycobot_280"
ARM = (
    "link1_to_link2",
    "link2_to_link3",
    "link3_to_link4",
    "link4_to_link5",
    "link5_to_link6",
    "link6_to_link6flange",
)

# The tutorial's goal of the arm, and its gripper's closed position [rad].
GOAL = (-1.345, -1.23, 0.264, -0.296, 0.389, -1.5)
CLOSED = -0.7

# Joints that follow gripper_controller, and their ratios.
FOLLOWERS = {
    "gripper_base_to_gripper_left2": 1.0,
    "gripper_left3_to_gripper_left1": -1.0,
    "gripper_base_to_gripper_right3": -1.0,
    "gripper_base_to_gripper_right2": -1.0,
    "gripper_right3_to_gripper_right1": 1.0,
}

# Positions of link6_flange and gripper_base [m], of the published URDF in Drake.
POSES = {
    "home": ((0.0,) * 6, (0.06062, 0.04560, 0.41014), (0.06062, 0.07960, 0.41014)),
    "goal": (GOAL, (0.26852, 0.01723, 0.20409), (0.27495, 0.03194, 0.17412)),
    "one joint": ((-2.0, *(0.0,) * 5), None, (0.04715, -0.08825, 0.41014)),
}
GRIPPER_AT_GOAL = POSES["goal"][2]


def load(control: str = "gazebo", **args: str) -> ad.Robot:
    return ad.load_robot(ROBOT, xacro_args={"control": control, **args})


# What controllers and drives do isn't the physics' step [s]; Gazebo's gains are.
STEP = 5e-3


def simulate(robot: ad.Robot, **options: Any) -> ad.Simulation:
    chosen = ad.SimulationOptions(**options)
    return ad.Simulation(ad.build_diagram(robot, world="void", options=chosen))


def motion(name: str) -> Motion:
    return ad.load_motion(bundled_motions(ROBOT)[name])


def publish(sim: ad.Simulation, positions: dict[str, float]) -> None:
    for joint, position in positions.items():
        sim.topic(f"/model/mycobot_280/joint/{joint}/cmd_pos").publish(position)


def position(sim: ad.Simulation, joint: str) -> float:
    state = sim.joint_states()
    return float(state.position[state.name.index(joint)])


def place(sim: ad.Simulation, link: str) -> np.ndarray:
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    X_WL = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link))
    return np.array(X_WL.translation())


def columns(rollout: ad.Rollout, *joints: str) -> np.ndarray:
    at = [rollout.joint_names.index(joint) for joint in joints]
    return np.asarray(rollout.position[:, at])


def ratio_error(rollout: ad.Rollout) -> float:
    """Return how far a follower is ever from where it is to be [rad]."""
    master = columns(rollout, "gripper_controller")
    error = columns(rollout, *FOLLOWERS) - master * list(FOLLOWERS.values())
    return float(np.abs(error).max())


@pytest.mark.parametrize("pose", POSES)
def test_forward_kinematics_are_the_published_ones(pose: str) -> None:
    joints, *places = POSES[pose]
    start = dict(zip(ARM, joints, strict=True))
    sim = simulate(ad.load_robot(ROBOT, initial_positions=start))

    for link, p_WL in zip(("link6_flange", "gripper_base"), places, strict=True):
        if p_WL is not None:
            # The figures have five decimals.
            np.testing.assert_allclose(place(sim, link), p_WL, atol=6e-6)


@pytest.mark.parametrize(
    ("control", "said"),
    [
        ("gazebo", []),
        # The published parameter has a newer name.
        (
            "ros2_control",
            ["arm_controller.open_loop_control", "grip_controller.open_loop_control"],
        ),
        # Classic's plugin puts joints to places, whatever it takes.
        ("classic", ["gazebo_ros_joint_pose_trajectory sets the positions"]),
    ],
)
def test_nothing_is_reported_but_what_the_tutorial_asks_for(
    control: str, said: list[str]
) -> None:
    robot = load(control)

    lines = [f"{entry.where} {entry.what}" for entry in robot.report]
    assert len(lines) == len(said)
    for line, words in zip(lines, said, strict=True):
        assert words in line
    assert {entry.severity for entry in robot.report} <= {"info"}


# Simulated in Drake with the plugin's gains and no dry friction, by others, with two
# decimals; here it may also be a sample of 1 ms earlier or later, at 0.18 rad/s.
SAGS = {1.0: -1.95, 5.0: -1.80, 10.0: -1.62}


@pytest.mark.slow
def test_with_gazebo_s_own_gains_the_arm_sags_under_gravity() -> None:
    sim = simulate(load(), friction=False)
    publish(sim, dict(zip(ARM, GOAL, strict=True)))

    for time, expected in SAGS.items():
        sim.advance_to(time)
        assert position(sim, "link2_to_link3") == pytest.approx(expected, abs=6e-3)


@pytest.mark.slow
def test_without_gravity_it_goes_where_it_is_sent() -> None:
    sim = simulate(load(), friction=False, gravity=False)
    publish(sim, dict(zip(ARM, GOAL, strict=True)))

    # Simulated as the sag was, with three decimals; the integral goes on creeping.
    sim.advance_to(1.0)
    assert position(sim, "link2_to_link3") == pytest.approx(-1.265, abs=1e-3)
    sim.advance_to(5.0)
    assert position(sim, "link2_to_link3") == pytest.approx(-1.243, abs=1e-3)


@pytest.mark.slow
def test_higher_gains_carry_the_arm() -> None:
    sim = simulate(load(p_gain="20", i_gain="20", d_gain="0.1"))
    publish(sim, dict(zip(ARM, GOAL, strict=True)))

    sim.advance_to(5.0)

    error = place(sim, "gripper_base") - GRIPPER_AT_GOAL
    assert np.linalg.norm(error) <= 3e-3


def test_ros2_control_carries_the_arm_and_closes_the_gripper() -> None:
    sim = simulate(load("ros2_control"), time_step=STEP)

    # The goal from 5 to 7.5 s, the gripper from 10 to 12.5 s.
    sim.run(14.9, motion("trajectories"))

    assert sim.rejected == []
    rollout = sim.rollout()
    late = rollout.time >= 8.0
    np.testing.assert_allclose(
        columns(rollout, *ARM)[late], np.tile(GOAL, (late.sum(), 1)), atol=2e-3
    )
    assert np.linalg.norm(place(sim, "gripper_base") - GRIPPER_AT_GOAL) <= 3e-3
    assert position(sim, "gripper_controller") == pytest.approx(CLOSED, abs=2e-3)
    assert ratio_error(rollout) <= 1e-3


def test_a_round_of_the_ping_pong_takes_5_2_seconds() -> None:
    ping_pong = motion("ping_pong")

    # 52 poses there and 52 back, 0.05 s each, for each of twelve joints.
    assert ping_pong.repeats
    assert ping_pong.duration == pytest.approx(5.2)
    assert len(ping_pong.steps) == 2 * 52 * 12
    name = "model/mycobot_280/joint/link2_to_link3/cmd_pos"
    sent = [s.message.data for s in ping_pong.steps if s.message.topic == name]
    there = np.arange(52) / 51 * -1.23
    np.testing.assert_allclose(sent, [*there, *there[::-1]], atol=1e-12)


@functools.cache
def ping_pong_once() -> ad.Simulation:
    """Return what two tests look at: a round, and 0.1 s of the next one."""
    sim = simulate(load(), gravity=False)
    sim.run(5.3, motion("ping_pong"))
    return sim


@pytest.mark.slow
def test_ping_pong_closes_and_opens_the_gripper_with_all_its_bars() -> None:
    sim = ping_pong_once()

    assert sim.rejected == []
    rollout = sim.rollout()
    (gripper,) = columns(rollout, "gripper_controller").T
    # Ends are sent twice, at 2.55 and 2.6 s, and at 5.15 and 5.2 s.
    ends = gripper[np.searchsorted(rollout.time, (2.65, 5.25))]
    # Six PIDs of 1 N·m/rad leave 5 mrad to six bars with 5 mN·m of dry friction each;
    # what damping takes, 0.06 N·m·s/rad of all, is gone within a few times 10 ms.
    assert ends == pytest.approx([CLOSED, 0.0], abs=6e-3)
    assert ratio_error(rollout) <= 1e-3


@pytest.mark.slow
def test_the_elbow_s_dry_friction_is_more_than_the_soft_gains_overcome() -> None:
    rollout = ping_pong_once().rollout()

    # Its PID asks for up to 0.264 N·m, and 0.1/s of that again for 5.3 s; 0.41 N·m of
    # friction give a little, and don't slip.
    elbow = columns(rollout, "link3_to_link4")
    assert np.abs(elbow).max() < 0.02


@pytest.mark.slow
def test_one_message_turns_one_joint_as_near_as_friction_lets_it() -> None:
    sim = simulate(load(), gravity=False)

    sim.run(4.0, motion("one_joint"))

    # At rest p e + i-term, with gains of 1 and 0.1/s, is what dry friction of 0.05 N·m
    # holds; it creeps at less than 1e-4 rad/s, which damping takes 5e-6 N·m for.
    rollout = sim.rollout()
    (error,) = -2.0 - columns(rollout, "link1_to_link2").T
    integral = 0.1 * np.sum(np.diff(rollout.time) * error[:-1])
    assert abs(error[-1] + integral) <= 0.05 + 1e-5
    assert abs(error[-1]) <= 0.05 + abs(integral)
    assert abs(integral) < 0.1


# The script's 79 poses: ten times home, fifty to the goal, ten to close, nine to wait.
def rows_of_the_script() -> np.ndarray:
    k = np.arange(79)[:, None]
    arm = np.clip(k - 9, 0, 50) / 50 * GOAL
    grip = np.clip(k - 59, 0, 10) / 10 * CLOSED * [1.0, *FOLLOWERS.values()]
    return np.hstack([arm, grip])


def test_the_classic_motion_has_the_script_s_79_poses_there_and_back() -> None:
    classic = motion("classic")

    assert classic.repeats
    assert classic.duration == pytest.approx(2 * 79 * 0.05)
    there, back = (step.message.data for step in classic.steps)
    assert [step.at for step in classic.steps] == [0.0, 3.95]
    assert there.joint_names == (*ARM, "gripper_controller", *FOLLOWERS)
    for message, rows in (
        (there, rows_of_the_script()),
        (back, rows_of_the_script()[::-1]),
    ):
        # A delay of n periods stands for n equal poses.
        delays = [p.time_from_start.to_nanoseconds() * 1e-9 for p in message.points]
        counts = np.rint(np.divide(delays, 0.05)).astype(int)
        poses = np.repeat([p.positions for p in message.points], counts, axis=0)
        np.testing.assert_allclose(poses, rows, atol=1e-6)


def test_classic_s_plugin_puts_the_arm_through_the_poses() -> None:
    sim = simulate(load("classic"), time_step=STEP)

    sim.run(7.85, motion("classic"))

    assert sim.rejected == []
    rollout = sim.rollout()
    arm, (gripper,) = columns(rollout, *ARM), columns(rollout, "gripper_controller").T
    # The gripper closes when the arm is there, and both wait; at last both are home.
    there, closed, home = np.searchsorted(rollout.time, (2.99, 4.3, 7.8))
    np.testing.assert_allclose(arm[closed], GOAL, atol=2e-3)
    np.testing.assert_allclose(arm[home], 0.0, atol=2e-3)
    expected = [0.0, CLOSED, 0.0]
    assert gripper[[there, closed, home]] == pytest.approx(expected, abs=2e-3)
    assert ratio_error(rollout) <= 1e-3


def test_topics_have_their_names_in_ros_and_in_gazebo() -> None:
    robot = load()
    sim = simulate(robot, gravity=False)
    ros = "model/mycobot_280/joint/link6_to_link6flange/cmd_pos"

    assert {alias.ros_name for alias in robot.topic_aliases} == {
        "/joint_states",
        *(
            f"/model/mycobot_280/joint/{joint}/cmd_pos"
            for joint in (*ARM, "gripper_controller", *FOLLOWERS)
        ),
    }
    sim.topic(ros).publish(0.5)
    sim.advance_to(0.5)
    assert position(sim, "link6_to_link6flange") > 0.1
    assert set(sim.topic("/joint_states").value().name) == set(sim.joint_states().name)
    sim.topic(ros.replace("/cmd_pos", "/0/cmd_pos")).publish(-0.5)
    sim.advance_to(1.0)
    assert position(sim, "link6_to_link6flange") < 0.0


TORSO = """
<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="torso">
  <xacro:include filename="$(find mycobot_280)/urdf/mycobot_280_macro.xacro"/>
  <link name="world"/>
  <link name="torso"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="torso"/><origin xyz="0 0 0.3"/>
  </joint>
  <xacro:mycobot_280 parent="torso" dynamics="${dynamics['gazebo']}">
    <origin xyz="0.2 0 0.5" rpy="0 0 0"/>
  </xacro:mycobot_280>
</robot>
"""


def test_the_arm_can_be_mounted_on_another_link(tmp_path: Path) -> None:
    path = tmp_path / "torso.urdf.xacro"
    path.write_text(TORSO, encoding="utf-8")

    sim = simulate(ad.load_robot(path, package_paths=[models_folder()]))

    p_WF = np.add((0.06062, 0.04560, 0.41014), (0.2, 0.0, 0.8))
    np.testing.assert_allclose(place(sim, "link6_flange"), p_WF, atol=6e-6)
