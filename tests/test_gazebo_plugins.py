"""Gazebo's joint plugins in a robot: who moves what, at which rate, what is told."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.plugin_control import GAZEBO_RATE, PLUGIN_TYPES
from arm_drake.errors import InputError
from arm_drake.simulation.motion_files import parse_motion
from tests.models import LENGTH, bob, joint, ros2_control
from tests.robots import real_robot, robots_folder

POSITION = "gz::sim::systems::JointPositionController"
VELOCITY = "gz::sim::systems::JointController"
TRAJECTORY = "gz::sim::systems::JointTrajectoryController"
PUBLISHER = "gz::sim::systems::JointStatePublisher"

# The goal of the myCobot tutorial's script [rad].
GOAL = {
    "link1_to_link2": -1.345,
    "link2_to_link3": -1.23,
    "link3_to_link4": 0.264,
    "link4_to_link5": -0.296,
    "link5_to_link6": 0.389,
    "link6_to_link6flange": -1.5,
}


def plugin(name, *tags, filename=None):
    kind = name.rpartition("::")[2]
    library = (
        filename
        or "gz-sim-"
        + "".join(f"-{c.lower()}" if c.isupper() else c for c in kind).removeprefix("-")
        + "-system"
    )
    inside = "".join(f"<{tag}>{text}</{tag}>" for tag, text in tags)
    return (
        f'<gazebo><plugin filename="{library}" name="{name}">{inside}</plugin></gazebo>'
    )


def classic(name, *tags):
    inside = "".join(f"<{tag}>{text}</{tag}>" for tag, text in tags)
    library = f"libgazebo_ros_{name}.so"
    return f'<gazebo><plugin filename="{library}" name="x">{inside}</plugin></gazebo>'


def two_links(*blocks, control=""):
    """Return two bobs one below the other, with plugins."""
    return f"""
<robot name="two">
  <link name="base"/>{bob("upper")}{bob("lower")}
  {joint("shoulder", "base", "upper")}
  {joint("elbow", "upper", "lower", xyz=f"0 0 {-LENGTH}")}
  {"".join(blocks)}{control}
</robot>"""


def load(folder, text, **options):
    path = folder / "two.urdf"
    path.write_text(text, encoding="utf-8")
    return ad.load_robot(path, **options)


def simulate(robot, **options):
    options = ad.SimulationOptions(**options)
    return ad.Simulation(ad.build_diagram(robot, world="void", options=options))


def lines(robot):
    return [
        f"{entry.severity}: {entry.where}: {entry.what}; {entry.done}"
        for entry in robot.report
    ]


def states_of(sim):
    return {row.name: row.state for row in sim.list_controllers()}


def mycobot(name="mycobot_280_gazebo"):
    return ad.load_robot(
        real_robot(f"mycobot_280/mycobot_gazebo/urdf/{name}.urdf.xacro"),
        package_paths=[robots_folder() / "mycobot_280"],
    )


@pytest.mark.slow
def test_a_joint_follows_its_topic(tmp_path):
    gains = (("p_gain", 400), ("d_gain", 40), ("i_gain", 0))
    robot = load(
        tmp_path,
        two_links(
            plugin(POSITION, ("joint_name", "shoulder"), *gains),
            plugin(POSITION, ("joint_name", "elbow"), *gains),
        ),
    )
    sim = simulate(robot, gravity=False)
    assert states_of(sim) == {"JointPositionController": "active"}

    sim.topic("/model/two/joint/elbow/cmd_pos").publish(0.5)
    sim.advance_to(3.0)

    assert sim.joint_states().position == pytest.approx((0.0, 0.5), abs=1e-3)


def test_the_manager_runs_at_the_rate_of_gazebo_s_steps(tmp_path):
    text = two_links(plugin(POSITION, ("joint_name", "elbow")))

    robot = load(tmp_path, text)

    assert robot.controllers.update_rate == GAZEBO_RATE


YAML = """
controller_manager:
  ros__parameters:
    update_rate: {rate}
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    group: {{type: position_controllers/JointGroupPositionController}}
group:
  ros__parameters: {{joints: [shoulder]}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "manager"), [(100, 1000), (250, 1000), (225, 900)])
def test_controllers_keep_their_rate_beside_a_plugin(tmp_path, rate, manager):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=rate), encoding="utf-8")
    control = ros2_control("shoulder", states=("elbow",))
    text = two_links(plugin(POSITION, ("joint_name", "elbow")), control=control)

    robot = load(tmp_path, text, controllers=yaml)
    sim = simulate(robot)
    sim.advance_to(0.1)

    assert robot.controllers.update_rate == manager
    assert states_of(sim) == dict.fromkeys(
        ("joint_state_broadcaster", "group", "JointPositionController"), "active"
    )
    rates = [sim.directory.find(n)[2].params.update_rate for n in ("group",)]
    assert rates == [rate]


@pytest.mark.slow
def test_a_joint_that_is_missing_is_reported_and_the_rest_runs(tmp_path):
    robot = load(
        tmp_path,
        two_links(
            plugin(POSITION, ("joint_name", "elbo")),
            plugin(POSITION),
            plugin(POSITION, ("joint_name", "shoulder"), ("p_gain", 50)),
        ),
    )

    reported = "\n".join(lines(robot))
    assert "the robot has no joint 'elbo'" in reported
    assert "elbow" in reported
    assert "the robot has none of its joints: elbo; the plugin is left out" in reported
    assert "no joint; expected <joint_name>; the plugin is left out" in reported
    sim = simulate(robot)
    topics = [row.name for row in sim.list_topics()]
    assert "/model/two/joint/shoulder/cmd_pos" in topics
    assert not any("elbo" in name and name.endswith("cmd_pos") for name in topics)


@pytest.mark.slow
def test_of_two_plugins_on_a_joint_the_last_one_moves_it(tmp_path):
    robot = load(
        tmp_path,
        two_links(
            plugin(POSITION, ("joint_name", "elbow"), ("topic", "/first")),
            plugin(POSITION, ("joint_name", "elbow"), ("topic", "/second")),
            plugin(VELOCITY, ("joint_name", "shoulder")),
            plugin(POSITION, ("joint_name", "shoulder"), ("topic", "/third")),
        ),
    )

    reported = [line for line in lines(robot) if "another Gazebo plugin" in line]
    assert reported == [
        "warning: Gazebo plugin JointPositionController: another Gazebo plugin moves "
        "joint 'elbow' too; the last one does",
        "warning: Gazebo plugin JointController: another Gazebo plugin moves joint "
        "'shoulder' too; the last one does",
    ]
    topics = [row.name for row in simulate(robot).list_topics()]
    assert {"/second", "/third"} <= set(topics)
    assert "/first" not in topics


@pytest.mark.slow
def test_a_joint_that_a_controller_commands_is_left_to_it(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=100), encoding="utf-8")
    robot = load(
        tmp_path,
        two_links(
            plugin(POSITION, ("joint_name", "shoulder")),
            plugin(POSITION, ("joint_name", "elbow")),
            control=ros2_control("shoulder"),
        ),
        controllers=yaml,
    )

    assert (
        "warning: Gazebo plugin JointPositionController: controller 'group' commands "
        "joint 'shoulder' too; the plugin leaves 'shoulder' alone"
    ) in lines(robot)
    sim = simulate(robot)
    assert states_of(sim)["group"] == "active"
    with pytest.raises(InputError, match="shoulder"):
        sim.topic("/model/two/joint/shoulder/cmd_pos").publish(1.0)


def test_what_a_tag_asks_for_in_vain_is_reported(tmp_path):
    tag = plugin(POSITION, ("joint_name", "elbow"), ("use_actuator_msg", "true"))

    robot = load(tmp_path, two_links(tag))

    assert any("use_actuator_msg" in line for line in lines(robot))


@pytest.mark.slow
def test_a_velocity_plugin_moves_at_the_velocity(tmp_path):
    robot = load(tmp_path, two_links(plugin(VELOCITY, ("joint_name", "elbow"))))
    sim = simulate(robot, gravity=False)

    sim.topic("/model/two/joint/elbow/cmd_vel").publish(0.8)
    sim.advance_to(1.0)

    at = list(sim.joint_states().name).index("elbow")
    assert sim.joint_states().velocity[at] == pytest.approx(0.8, rel=1e-3)


# A trajectory without interpolation: the target is the point that comes next.
@pytest.mark.slow
def test_gazebo_s_own_trajectory_controller_follows_points(tmp_path):
    gains = "900 900"
    robot = load(
        tmp_path,
        two_links(
            plugin(
                TRAJECTORY,
                ("joint_name", "shoulder"),
                ("joint_name", "elbow"),
                ("position_p_gain", gains),
                ("position_d_gain", "60 60"),
            )
        ),
    )
    sim = simulate(robot, gravity=False)
    point = ad.JointTrajectoryPoint

    sim.topic("/model/two/joint_trajectory").publish(
        ad.JointTrajectory(
            joint_names=("elbow", "shoulder"),
            points=(
                point((0.4, 0.2), time_from_start=2.0),
                point((0.0, -0.3), time_from_start=4.0),
            ),
        )
    )
    sim.advance_to(1.9)
    first = sim.joint_states().position
    progress = sim.topic("/model/two/joint_trajectory_progress").value()
    sim.advance_to(5.0)

    assert first == pytest.approx((0.2, 0.4), abs=2e-3)
    assert progress.data == 0.5
    assert sim.joint_states().position == pytest.approx((-0.3, 0.0), abs=2e-3)


@pytest.mark.slow
def test_the_published_mycobot_sags_as_its_pid_balances_gravity():
    """At rest p e + i-term equals the torque of gravity; here it creeps.

    So it is short of it by what damping and the d gain take, v (damping + d).
    """
    robot = mycobot()
    sim = simulate(robot, friction=False)
    for name, position in GOAL.items():
        sim.topic(f"/model/mycobot_280/joint/{name}/cmd_pos").publish(position)

    sim.advance_to(4.0)

    rollout = sim.rollout()
    names = list(rollout.joint_names)
    at = [names.index(name) for name in GOAL]
    errors = np.array(list(GOAL.values())) - rollout.position[:, at]
    steps = np.diff(rollout.time, prepend=rollout.time[0])[:, None]
    integral = np.clip(np.cumsum(0.1 * steps * errors, axis=0), -1.0, 1.0)[-1]
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    joints = [plant.GetJointByName(name) for name in GOAL]
    gravity = -plant.CalcGravityGeneralizedForces(context)
    damping = np.array([j.default_damping_vector()[0] for j in joints])
    balance = (
        1.0 * errors[-1] + integral - gravity[[j.velocity_start() for j in joints]]
    )
    velocity = rollout.velocity[-1, at]
    # What accelerations are left are below 0.01 rad/s^2, inertias below 0.02 kg m^2.
    np.testing.assert_allclose(balance, (damping + 0.01) * velocity, atol=3e-4)
    # It sags by 0.616 rad at that moment.
    assert errors[-1, 1] == pytest.approx(0.616, abs=0.01)


@pytest.mark.slow
def test_the_tutorial_s_script_moves_the_published_mycobot():
    """Without gravity, as the tutorial has it: a step to the goal, and on to it."""
    sim = simulate(mycobot(), gravity=False, friction=False)
    for name, position in GOAL.items():
        sim.topic(f"model/mycobot_280/joint/{name}/cmd_pos").publish(position)

    sim.advance_to(1.0)
    names = list(sim.joint_states().name)
    after_one = sim.joint_states().position[names.index("link2_to_link3")]
    sim.advance_to(5.0)

    after_five = sim.joint_states().position[names.index("link2_to_link3")]
    # Computed with the plugin's gains and Drake's own dynamics, by others.
    assert after_one == pytest.approx(-1.265, abs=0.002)
    assert after_five == pytest.approx(-1.243, abs=0.002)


@pytest.mark.slow
def test_gazebo_classic_s_plugins_pose_the_mycobot_and_report_it():
    sim = simulate(mycobot("mycobot_280_classic_gazebo"))
    point = ad.JointTrajectoryPoint
    poses = [tuple(part * q for q in GOAL.values()) for part in (0.2, 0.4)]

    sim.topic("/set_joint_trajectory").publish(
        ad.JointTrajectory(
            header=ad.Header(frame_id="base_link"),
            joint_names=tuple(GOAL),
            points=tuple(point(pose, time_from_start=1.0) for pose in poses),
        )
    )
    sim.advance_to(0.95)
    names = list(sim.joint_states().name)
    at = [names.index(name) for name in GOAL]
    first = np.array(sim.joint_states().position)[at]
    sim.advance_to(2.0)

    np.testing.assert_allclose(first, poses[0], atol=2e-3)
    second = np.array(sim.joint_states().position)[at]
    np.testing.assert_allclose(second, poses[1], atol=2e-3)
    message = sim.topic("/joint_states").value()
    assert set(message.name) == set(names)
    np.testing.assert_allclose(
        np.array(message.position)[[message.name.index(n) for n in GOAL]],
        poses[1],
        atol=2e-3,
    )


@pytest.mark.slow
def test_a_trajectory_for_an_unknown_frame_is_refused():
    sim = simulate(mycobot("mycobot_280_classic_gazebo"))

    sim.topic("/set_joint_trajectory").publish(
        ad.JointTrajectory(
            header=ad.Header(frame_id="nowhere"),
            joint_names=("link1_to_link2",),
            points=(ad.JointTrajectoryPoint((0.5,)),),
        )
    )
    sim.advance_to(0.1)

    (rejected,) = sim.rejected
    assert "nowhere" in rejected.reason


@pytest.mark.slow
def test_controllers_of_the_package_stay_out_unless_they_are_asked_for():
    robot = mycobot()

    assert {c.name for c in robot.controllers.controllers} == {
        "JointPositionController",
        "JointStatePublisher",
    }
    assert any(
        "mycobot_280_controllers.yaml" in line and "--controllers" in line
        for line in lines(robot)
    )


def test_the_list_of_plugins_in_the_docs_is_complete():
    docs = Path(__file__).parents[1] / "docs/loading.md"
    listed = docs.read_text(encoding="utf-8").partition("## Gazebo's own plugins")[2]
    listed = listed.partition("\n## ")[0]

    for kind, name in PLUGIN_TYPES.items():
        library = name.rpartition("GazeboRos")[2]
        snake = "".join(f"_{c.lower()}" if c.isupper() else c for c in library)
        is_classic = "GazeboRos" in name
        row = f"libgazebo_ros{snake}.so" if is_classic else kind.__name__
        assert f"| `{row}` |" in listed


@pytest.mark.slow
def test_a_gripper_of_plugins_closes_by_the_plain_topic():
    """All six tags of the gripper follow, so that they don't pull against each other.

    Two fingers have limits of 0.5 rad, narrower than that of the joint they follow.
    """
    sim = simulate(mycobot(), gravity=False, friction=False)

    sim.topic("/gripper_command").publish(0.5)
    sim.advance_to(3.0)

    state = sim.joint_states()
    positions = dict(zip(state.name, state.position, strict=True))
    assert positions["gripper_controller"] == pytest.approx(-0.35, abs=2e-3)
    assert positions["gripper_right3_to_gripper_right1"] == pytest.approx(
        -0.35, abs=2e-3
    )


FINGER = f"""
<robot name="two">
  <link name="base"/>{bob("upper")}{bob("lower")}{bob("third")}
  {joint("shoulder", "base", "upper")}
  {joint("elbow", "upper", "lower", xyz=f"0 0 {-LENGTH}")}
  {joint("finger", "upper", "third", inside='<mimic joint="elbow" multiplier="2"/>')}
"""


def finger(*blocks, control=""):
    """Return two bobs and a third one that follows the second."""
    return FINGER + "".join(blocks) + control + "</robot>"


@pytest.mark.slow
def test_a_mimic_joint_s_plugin_yields_to_who_commands_its_master(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=100).replace("shoulder", "elbow"), "utf-8")
    robot = load(
        tmp_path,
        finger(
            plugin(POSITION, ("joint_name", "finger")),
            plugin(POSITION, ("joint_name", "shoulder")),
            control=ros2_control("elbow"),
        ),
        controllers=yaml,
    )

    assert (
        "warning: Gazebo plugin JointPositionController: controller 'group' commands "
        "joint 'elbow' too; the plugin leaves 'finger' alone"
    ) in lines(robot)
    states = states_of(simulate(robot))
    assert states["group"] == states["JointPositionController"] == "active"


@pytest.mark.slow
def test_a_plugin_on_a_mimic_joint_alone_moves_its_master(tmp_path):
    gains = (("p_gain", 100), ("i_gain", 0), ("d_gain", 10))
    text = finger(plugin(POSITION, ("joint_name", "finger"), *gains))

    robot = load(tmp_path, text)
    sim = simulate(robot, gravity=False)
    sim.topic("/model/two/joint/finger/cmd_pos").publish(0.4)
    sim.advance_to(4.0)

    assert not any("elbow" in line and "error" in line for line in lines(robot))
    state = sim.joint_states()
    positions = dict(zip(state.name, state.position, strict=True))
    assert positions["finger"] == pytest.approx(0.4, abs=2e-3)
    assert positions["elbow"] == pytest.approx(0.2, abs=2e-3)


@pytest.mark.slow
def test_two_kinds_of_plugins_on_coupled_joints_are_told_apart(tmp_path):
    robot = load(
        tmp_path,
        finger(
            plugin(POSITION, ("joint_name", "finger")),
            plugin(VELOCITY, ("joint_name", "elbow")),
            plugin(VELOCITY, ("joint_name", "shoulder")),
        ),
    )

    assert (
        "warning: Gazebo plugin JointPositionController: another Gazebo plugin moves "
        "joint 'finger' too; the last one does"
    ) in lines(robot)
    assert states_of(simulate(robot)) == {"JointController": "active"}


@pytest.mark.slow
def test_poses_leave_joints_of_controllers_alone(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=100), encoding="utf-8")
    robot = load(
        tmp_path,
        two_links(classic("joint_pose_trajectory"), control=ros2_control("shoulder")),
        controllers=yaml,
    )
    sim = simulate(robot)

    sim.topic("/set_joint_trajectory").publish(
        ad.JointTrajectory(
            header=ad.Header(frame_id="world"),
            joint_names=("elbow",),
            points=(ad.JointTrajectoryPoint((0.3,)),),
        )
    )
    sim.advance_to(1.0)

    assert set(states_of(sim).values()) == {"active"}
    assert sim.joint_states().position == pytest.approx((0.0, 0.3), abs=2e-3)


@pytest.mark.slow
def test_a_publisher_reads_joints_that_no_hardware_reports(tmp_path):
    robot = load(
        tmp_path,
        two_links(plugin(PUBLISHER), control=ros2_control("elbow")),
    )
    sim = simulate(robot)
    sim.advance_to(0.1)

    message = sim.topic("/world/void/model/two/joint_state").value()
    assert set(message.name) == {"shoulder", "elbow"}


@pytest.mark.slow
def test_a_tag_keeps_the_topic_of_its_first_joint(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=100), encoding="utf-8")
    tag = plugin(POSITION, ("joint_name", "shoulder"), ("joint_name", "elbow"))
    robot = load(
        tmp_path, two_links(tag, control=ros2_control("shoulder")), controllers=yaml
    )

    names = [row.name for row in simulate(robot).list_topics()]

    assert "/model/two/joint/shoulder/cmd_pos" in names


def test_the_rate_of_the_manager_is_reported(tmp_path):
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML.format(rate=100), encoding="utf-8")
    text = two_links(
        plugin(POSITION, ("joint_name", "elbow")), control=ros2_control("shoulder")
    )

    robot = load(tmp_path, text, controllers=yaml)

    assert any("the manager runs at 1000 Hz" in line for line in lines(robot))


@pytest.mark.slow
def test_forces_without_physics_are_reported(tmp_path):
    robot = load(tmp_path, two_links(plugin(POSITION, ("joint_name", "elbow"))))

    sim = simulate(robot, preset="kinematic")

    assert any("without physics" in entry.done for entry in sim.report)


# The script moves 12 joints to and fro, 52 poses one way, for ever.
SCRIPT_GOAL = {
    **GOAL,
    "gripper_controller": -0.7,
    "gripper_base_to_gripper_left2": -0.7,
    "gripper_left3_to_gripper_left1": 0.7,
    "gripper_base_to_gripper_right3": 0.7,
    "gripper_base_to_gripper_right2": 0.7,
    "gripper_right3_to_gripper_right1": -0.7,
}


@pytest.mark.slow
def test_a_motion_of_twelve_topics_runs_the_tutorial_s_script():
    sim = simulate(mycobot(), gravity=False, friction=False)
    names = [f"model/mycobot_280/joint/{joint}/cmd_pos" for joint in SCRIPT_GOAL]
    goal = list(SCRIPT_GOAL.values())
    step = {
        "at": 0.0,
        "every": 0.05,
        "count": 52,
        "ping_pong": True,
        "topics": names,
        "data_from_to": [[0.0] * len(goal), goal],
    }
    motion = parse_motion([step, {"repeat": True}])
    assert motion.duration == pytest.approx(5.2)

    sim.run(8.0, motion)

    assert sim.rejected == []
    rollout = sim.rollout()
    wrist = rollout.position[:, rollout.joint_names.index("link6_to_link6flange")]
    # There, back, and there again: its ends are sent twice, the first ones at 2.55 and
    # 2.6 s.
    ends = [wrist[np.searchsorted(rollout.time, t)] for t in (2.65, 5.2, 7.85)]
    assert ends == pytest.approx([-1.5, 0.0, -1.5], abs=0.03)


def _pushed(tmp_path, monkeypatch=None):
    """Return what pushed joints do, with a servo that could hold them if patched."""
    push = plugin(POSITION, ("joint_name", "elbow"), ("p_gain", 60), ("d_gain", 3))
    pull = plugin(VELOCITY, ("joint_name", "shoulder"), ("use_force_commands", 1))
    friction = "<dynamics damping='0.2' friction='0.1'/></joint>"
    text = two_links(push, pull).replace("</joint>", friction)
    robot = load(tmp_path, text)
    if monkeypatch is not None:
        monkeypatch.setattr("arm_drake.diagram.are_all_pushed", lambda *_: False)
    sim = simulate(robot)
    sim.topic("/model/two/joint/elbow/cmd_pos").publish(0.7)
    sim.topic("/model/two/joint/shoulder/cmd_vel").publish(-0.4)
    sim.advance_to(1.0)
    return sim


@pytest.mark.slow
def test_pushed_joints_move_to_the_bit_as_with_a_servo(tmp_path, monkeypatch):
    plain = _pushed(tmp_path)
    full = _pushed(tmp_path, monkeypatch)

    servos = [sim.diagram.GetSubsystemByName("servo") for sim in (plain, full)]
    names = [{system.get_name() for system in servo.GetSystems()} for servo in servos]
    assert "inverse_dynamics" in names[1] - names[0]
    moved = [sim.rollout() for sim in (plain, full)]
    assert np.abs(moved[0].velocity).max() > 0.1
    for quantity in ("position", "velocity", "effort"):
        assert np.array_equal(*(getattr(one, quantity) for one in moved))


@pytest.mark.slow
def test_nobody_holds_joints_that_plugins_no_longer_push(tmp_path):
    sim = _pushed(tmp_path)

    sim.switch_controllers(deactivate=("JointPositionController", "JointController"))
    sim.advance_to(2.0)

    late = sim.rollout().effort[1100:]
    assert np.array_equal(late, np.zeros_like(late))
