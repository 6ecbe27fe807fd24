"""Gazebo's drives in a robot: which wheels they get, what they hear, what is told."""

import dataclasses
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import Bool, Odometry, TFMessage, Twist, TwistStamped, Vector3
from arm_drake.simulation.motion_files import load_motion, parse_motion
from tests.carts import (
    CLASSIC,
    GZ,
    ackermann_steering,
    cart,
    classic_ackermann,
    classic_drive,
    diff_drive,
    load,
    plugin,
    steered_cart,
)
from tests.models import bob, joint, ros2_control

COMMAND, ODOMETRY = "/model/cart/cmd_vel", "/model/cart/odometry"

FORWARDS = Twist(Vector3(x=0.2))

# rad/s of wheels with a radius of 0.1 m at 0.2 m/s.
SPEED = pytest.approx(2.0, rel=1e-3)

# Two more wheels.
REAR = "".join(
    bob(f"rear_{side}_wheel", "0 0 0")
    + joint(f"rear_{side}", "base_link", f"rear_{side}_wheel", type="continuous")
    for side in ("left", "right")
)


def simulate(robot: ad.Robot, world: str = "void") -> ad.Simulation:
    """Return a simulation; in the void the wheels turn freely."""
    options = ad.SimulationOptions(gravity=False)
    return ad.Simulation(ad.build_diagram(robot, world=world, options=options))


def lines(robot: ad.Robot) -> list[str]:
    return [f"{e.severity}: {e.where}: {e.what}; {e.done}" for e in robot.report]


def speeds(sim: ad.Simulation) -> dict[str, float]:
    state = sim.joint_states()
    return dict(zip(state.name, state.velocity, strict=True))


def topics(sim: ad.Simulation) -> dict[str, str]:
    return {row.name: row.type for row in sim.list_topics()}


@pytest.mark.parametrize(
    "filename",
    ["gz-sim-diff-drive-system", "libignition-gazebo6-diff-drive-system.so"],
)
def test_a_plugin_of_either_name_frees_the_base_and_has_its_topics(
    tmp_path: Path, filename: str
) -> None:
    robot = load(tmp_path, cart(diff_drive().replace(GZ, filename)))
    sim = simulate(robot)

    assert robot.has_free_base
    assert topics(sim) == {
        COMMAND: "Twist",
        "/model/cart/enable": "Bool",
        ODOMETRY: "Odometry",
        "/model/cart/tf": "TFMessage",
    }
    (row,) = sim.list_controllers()
    assert (row.name, row.type) == ("DiffDrive", "gz::sim::systems::DiffDrive")
    assert row.state == "active"


def test_classic_has_its_topics(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(classic_drive(("publish_odom_tf", "true"))))
    sim = simulate(robot)

    assert robot.has_free_base
    assert topics(sim) == {
        "/cmd_vel": "Twist",
        "/odom": "Odometry",
        "/tf": "TFMessage",
    }
    (row,) = sim.list_controllers()
    assert row.type == "gazebo_plugins/GazeboRosDiffDrive"


@pytest.mark.slow
def test_a_base_that_hangs_from_the_world_stays_there(tmp_path: Path) -> None:
    world = (
        '<link name="world"/><joint name="hold" type="fixed">'
        '<parent link="world"/><child link="base_link"/></joint>'
    )
    robot = load(tmp_path, cart(diff_drive(), world))
    sim = simulate(robot)
    sim.topic(COMMAND).publish(FORWARDS)
    sim.run(0.5)

    assert not robot.has_free_base
    assert speeds(sim) == {"left": SPEED, "right": SPEED}
    assert sim.topic(ODOMETRY).value().child_frame_id == "cart/base_link"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("block", "topic", "controller"),
    [
        (diff_drive(), COMMAND, "DiffDrive"),
        (classic_drive(), "/cmd_vel", "GazeboRosDiffDrive"),
        (classic_drive(), "cmd_vel", "GazeboRosDiffDrive"),
    ],
)
def test_motions_drive_it_by_topic_and_by_name(
    tmp_path: Path, block: str, topic: str, controller: str
) -> None:
    file = tmp_path / "motion.yaml"
    file.write_text(
        f"- {{at: 0.1, topic: {topic}, data: {{linear: {{x: 0.2}}}}}}\n"
        f"- {{at: 1.0, controller: {controller}, "
        "cmd_vel: {angular: {z: 1.0}}}\n",
        encoding="utf-8",
    )
    sim = simulate(load(tmp_path, cart(block)))
    motion = load_motion(file)

    sim.run(1.5, motion)

    assert sim.rejected == []
    rollout = sim.rollout()
    by_topic = rollout.velocity[rollout.time < 1.0][-1]
    assert by_topic == pytest.approx([2.0, 2.0], rel=1e-3)
    # Turning at 1 rad/s, with wheels 0.4 m apart.
    assert rollout.velocity[-1] == pytest.approx([-2.0, 2.0], rel=1e-3)


@pytest.mark.slow
def test_of_two_robots_each_is_driven_by_its_name(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(diff_drive()))
    robots = [dataclasses.replace(robot, name=name) for name in ("one", "two")]
    sim = ad.Simulation(ad.build_diagram(robots, world="void"))

    sim.controller("two/DiffDrive").send_velocity(FORWARDS)
    sim.run(0.2)

    moved = [sim.topic(f"/{n}/model/{n}/odometry").value() for n in ("one", "two")]
    assert [m.twist.twist.linear.x for m in moved] == pytest.approx(
        [0.0, 0.2], abs=1e-3
    )


@pytest.mark.slow
def test_a_motion_may_disable_it(tmp_path: Path) -> None:
    sim = simulate(load(tmp_path, cart(diff_drive())))
    motion = parse_motion(
        [
            {"at": 0.0, "controller": "DiffDrive", "cmd_vel": {"linear": {"x": 0.2}}},
            {"at": 0.5, "topic": "/model/cart/enable", "data": False},
        ]
    )

    sim.run(1.0, motion)

    assert speeds(sim) == pytest.approx({"left": 0.0, "right": 0.0}, abs=1e-4)


@pytest.mark.parametrize("data", [1.0, "no", [True]])
def test_what_is_no_bool_is_refused(tmp_path: Path, data: object) -> None:
    sim = simulate(load(tmp_path, cart(diff_drive())))

    with pytest.raises(InputError, match="takes true, false or a Bool, got"):
        sim.topic("/model/cart/enable").publish(data)
    sim.topic("/model/cart/enable").publish(Bool(True))


BRIDGE = """
- {ros_topic_name: /cmd_vel, gz_topic_name: /model/cart/cmd_vel, direction: ROS_TO_GZ,
   ros_type_name: geometry_msgs/msg/TYPE, gz_type_name: gz.msgs.Twist}
- {ros_topic_name: /odom, gz_topic_name: /model/cart/odometry, direction: GZ_TO_ROS,
   ros_type_name: nav_msgs/msg/Odometry, gz_type_name: gz.msgs.Odometry}
- {ros_topic_name: /tf, gz_topic_name: /model/cart/tf, direction: GZ_TO_ROS,
   ros_type_name: tf2_msgs/msg/TFMessage, gz_type_name: gz.msgs.Pose_V}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Twist", FORWARDS),
        ("Twist", {"linear": {"x": 0.2}}),
        ("TwistStamped", TwistStamped(twist=FORWARDS)),
        ("TwistStamped", {"twist": {"linear": {"x": 0.2}}}),
    ],
)
def test_a_bridge_gives_its_topics_names_in_ros(
    tmp_path: Path, kind: str, message: object
) -> None:
    bridge = tmp_path / "bridge.yaml"
    bridge.write_text(BRIDGE.replace("TYPE", kind), encoding="utf-8")
    robot = load(tmp_path, cart(diff_drive()), controllers=bridge)
    sim = simulate(robot)

    sim.topic("/cmd_vel").publish(message)
    sim.run(0.5)

    assert speeds(sim) == {"left": SPEED, "right": SPEED}
    assert isinstance(sim.topic("/odom").value(), Odometry)
    assert isinstance(sim.topic("/tf").value(), TFMessage)
    assert not any("bridge.yaml" in str(entry.file) for entry in robot.report)


@pytest.mark.slow
def test_a_missing_wheel_is_reported_and_the_others_turn(tmp_path: Path) -> None:
    block = diff_drive(("left_joint", "lef"))

    robot = load(tmp_path, cart(block))
    sim = simulate(robot)
    sim.topic(COMMAND).publish(FORWARDS)
    sim.run(0.5)

    assert any("the robot has no joint 'lef'" in line for line in lines(robot))
    assert speeds(sim) == {"left": SPEED, "right": SPEED}


@pytest.mark.parametrize(
    ("block", "problem"),
    [
        (
            plugin(CLASSIC, ("left_joint", "left"), ("right_joint", "rigth")),
            "the robot has none of its joints: rigth",
        ),
        (
            plugin(
                CLASSIC,
                ("left_joint", "left"),
                ("left_joint", "lef"),
                ("right_joint", "right"),
            ),
            "expected 1 left and 1 right joints, got 2 and 1",
        ),
        (
            plugin(
                CLASSIC,
                ("num_wheel_pairs", 2),
                *(("left_joint", name) for name in ("left", "lef")),
                *(("right_joint", name) for name in ("right", "left")),
            ),
            "the robot lacks one of its joints",
        ),
        (
            classic_drive(("left_joint", "left")),
            "expected 1 left and 1 right joints, got 2 and 1",
        ),
        (
            plugin(
                GZ,
                ("left_joint", "left"),
                ("right_joint", "right"),
                ("wheel_radius", 0),
            ),
            "wheel_radius: expected a length above 0 m, got 0",
        ),
    ],
)
def test_a_plugin_that_can_t_drive_is_reported_and_the_rest_runs(
    tmp_path: Path, block: str, problem: str
) -> None:
    other = plugin("gz-sim-joint-controller-system", ("joint_name", "left"))

    robot = load(tmp_path, cart(block, other))

    what = f"Gazebo plugin 'drive': {problem}; the plugin is left out"
    assert f"error: {what}" in lines(robot)
    names = {row.name: row.state for row in simulate(robot).list_controllers()}
    assert names["JointController"] == "active"


def test_of_two_plugins_on_the_same_wheels_the_last_one_drives(tmp_path: Path) -> None:
    blocks = diff_drive(("topic", "one")), diff_drive(("topic", "two"))

    robot = load(tmp_path, cart(*blocks))
    sim = simulate(robot)

    reported = [line for line in lines(robot) if "left" in line and "another" in line]
    assert reported == [
        "warning: Gazebo plugin DiffDrive: another Gazebo plugin moves joint 'left' "
        "too; the last one does"
    ]
    assert (
        "warning: Gazebo plugin DiffDrive: no wheels are left on both sides; it is "
        "left out"
    ) in lines(robot)
    assert {"/two"} == {"/one", "/two"} & set(topics(sim))


@pytest.mark.slow
def test_plugins_of_other_wheels_drive_together(tmp_path: Path) -> None:
    # As a base with four driven wheels may have it: a plugin for each axle.
    second = (
        diff_drive().replace(">left<", ">rear_left<").replace(">right<", ">rear_right<")
    )

    robot = load(tmp_path, cart(diff_drive(), second, REAR))
    sim = simulate(robot)
    sim.topic(COMMAND).publish(FORWARDS)
    sim.run(0.5)

    assert speeds(sim) == dict.fromkeys(
        ("left", "right", "rear_left", "rear_right"), SPEED
    )
    assert any(
        entry.where == "controller 'DiffDrive_2'"
        and "the topic '/model/cart/odometry', as 'DiffDrive' does" in entry.what
        for entry in sim.report
    )


YAML = """
controller_manager:
  ros__parameters:
    update_rate: 100
    group: {type: velocity_controllers/JointGroupVelocityController}
group:
  ros__parameters: {joints: [left]}
"""


@pytest.mark.parametrize("block", [diff_drive(), classic_drive()])
def test_a_wheel_that_a_controller_commands_is_left_to_it(
    tmp_path: Path, block: str
) -> None:
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML, encoding="utf-8")
    control = ros2_control("left", command="velocity")

    robot = load(tmp_path, cart(block, control), controllers=yaml)
    sim = simulate(robot)

    reported = "\n".join(lines(robot))
    assert "controller 'group' commands joint 'left' too" in reported
    assert "no wheels are left on both sides; it is left out" in reported
    assert [row.name for row in sim.list_controllers()] == ["group"]


@pytest.mark.slow
def test_pairs_of_classic_stay_whole(tmp_path: Path) -> None:
    # The front wheels are taken; the pair behind them keeps its measures.
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(YAML, encoding="utf-8")
    block = plugin(
        CLASSIC,
        *(("left_joint", name) for name in ("left", "rear_left")),
        *(("right_joint", name) for name in ("right", "rear_right")),
        ("num_wheel_pairs", 2),
        ("wheel_diameter", 0.2),
        ("wheel_diameter", 0.4),
    )
    control = ros2_control("left", command="velocity")

    robot = load(tmp_path, cart(block, REAR, control), controllers=yaml)
    sim = simulate(robot)
    sim.topic("/cmd_vel").publish(FORWARDS)
    sim.run(0.5)

    wheels = speeds(sim)
    expected = {"rear_left": 1.0, "rear_right": 1.0}
    assert {name: wheels[name] for name in expected} == pytest.approx(
        expected, rel=1e-3
    )


def test_torques_of_wheels_are_told(tmp_path: Path) -> None:
    unlimited = load(tmp_path, cart(diff_drive()))
    limited = load(
        tmp_path, cart(diff_drive(), limit='<limit effort="3" velocity="9"/>')
    )
    classic = load(tmp_path, cart(classic_drive(("max_wheel_torque", 7))))

    # 2 m g r = 2 * 6.2 kg * 9.81 m/s^2 * 0.1 m.
    assert (
        "info: : DiffDrive has wheels without an effort limit: left, right; the limit "
        "is 12.2 N·m"
    ) in lines(unlimited)
    assert not any("effort limit" in line for line in lines(limited))
    assert (
        "info: : gazebo_ros_diff_drive turns left, right; the limit is 7 N·m; they "
        "have no velocity limit"
    ) in lines(classic)


def test_wheels_without_an_effort_limit_turn_against_their_own_damping(tmp_path):
    # As Stretch's, whose damping takes more than what slips on the ground.
    dynamics = '<dynamics damping="20" friction="5"/>'

    sim = simulate(load(tmp_path, cart(diff_drive(), limit=dynamics)))
    sim.topic(COMMAND).publish(FORWARDS)
    sim.run(0.5)

    assert speeds(sim) == {"left": SPEED, "right": SPEED}


def test_unused_measures_and_unknown_tags_are_reported(tmp_path: Path) -> None:
    block = classic_drive(("wheel_separation", 0.5), ("command_topic", "go"))

    reported = "\n".join(lines(load(tmp_path, cart(block))))

    assert (
        "wheel_separation: 2 values for 1 pairs of wheels; it has no effect" in reported
    )
    assert "unknown tags: command_topic; they have no effect" in reported


@pytest.mark.slow
def test_without_physics_the_wheels_turn_and_the_world_stands_still(
    tmp_path: Path,
) -> None:
    robot = load(tmp_path, cart(classic_drive(("publish_wheel_tf", "true"))))
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robot, options=options))

    sim.topic("/cmd_vel").publish(FORWARDS)
    sim.run(0.5)

    assert sim.topic("/odom").value().pose.pose.position.x == 0.0
    assert len(sim.topic("/tf").value().transforms) == 2


def test_a_steered_cart_has_its_topics_and_wheels_that_roll_freely(
    tmp_path: Path,
) -> None:
    robot = load(tmp_path, steered_cart(ackermann_steering()))
    sim = simulate(robot)

    assert topics(sim) == {
        COMMAND: "Twist",
        ODOMETRY: "Odometry",
        "/model/cart/tf": "TFMessage",
    }
    # No controller holds the front wheels.
    (row,) = sim.list_controllers()
    assert row.type == "gz::sim::systems::AckermannSteering"
    assert lines(robot) == [
        rolling("front_left, front_right"),
        "info: : AckermannSteering has joints without an effort limit: left, right; "
        "the limit is 19.6 N·m",
    ]


def rolling(joints: str) -> str:
    return (
        f"info: : no controller of {joints} beside a plugin that moves a base; taken "
        "as wheels, which roll freely; a controllers YAML may hold them"
    )


# An arm whose first and last joints turn without limits, and a caster.
ARM = "".join(
    bob(f"{name}_link", "0.1 0 0") + joint(name, parent, f"{name}_link", type=type_)
    for name, parent, type_ in (
        ("shoulder", "base_link", "continuous"),
        ("elbow", "shoulder_link", "revolute"),
        ("wrist", "elbow_link", "continuous"),
        ("swivel", "base_link", "continuous"),
        ("caster_wheel", "swivel_link", "continuous"),
    )
)


def test_an_arm_on_a_base_is_held_where_its_casters_roll(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(diff_drive(), ARM))

    (held,) = (
        controller.parameters["joints"].value
        for controller in robot.controllers.controllers
        if "joints" in controller.parameters
    )
    assert held == ["shoulder", "elbow", "wrist"]
    assert rolling("swivel, caster_wheel") in lines(robot)


def test_what_suspends_driven_wheels_is_not_held(tmp_path: Path) -> None:
    rocker = """<link name="rocker"><inertial><mass value="0.5"/>
      <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
      </link><joint name="rock" type="revolute"><parent link="base_link"/>
      <child link="rocker"/><axis xyz="0 1 0"/>
      <limit lower="-0.2" upper="0.2" effort="9" velocity="9"/></joint>"""
    text = cart(diff_drive(), rocker).replace(
        '<parent link="base_link"/><child link="left_wheel"/>',
        '<parent link="rocker"/><child link="left_wheel"/>',
    )

    robot = load(tmp_path, text)

    assert [c.name for c in robot.controllers.controllers] == ["DiffDrive"]
    assert lines(robot)[0] == (
        "info: : no controller of rock, which carry driven wheels; taken as a "
        "suspension, which moves as its wheels push it"
    )


def test_a_steered_cart_whose_steering_another_plugin_has_is_left_out(
    tmp_path: Path,
) -> None:
    other = plugin("gz-sim-joint-controller-system", ("joint_name", "left_steering"))

    robot = load(tmp_path, steered_cart(ackermann_steering(), other))

    assert (
        "warning: Gazebo plugin AckermannSteering: no joints are left of "
        "<left_steering_joint>; it is left out" in lines(robot)
    )


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        (
            plugin("gz-sim-velocity-control-system"),
            "info: : VelocityControl sets the velocity of link 'base_link'; a force "
            "without a limit does it, in every step",
        ),
        (
            plugin("libgazebo_ros_planar_move.so"),
            "info: : GazeboRosPlanarMove sets the velocity of link 'base_link'; a "
            "force without a limit does it, 20 times per second; in between, what rubs "
            "on the ground brakes it",
        ),
    ],
)
def test_it_is_said_how_a_base_s_velocity_is_set(
    tmp_path: Path, block: str, expected: str
) -> None:
    robot = load(tmp_path, cart(block))

    assert lines(robot) == [rolling("left, right"), expected]


def test_a_base_whose_velocity_is_set_takes_one_by_its_name(tmp_path: Path) -> None:
    sim = simulate(load(tmp_path, cart(plugin("gz-sim-velocity-control-system"))))

    sim.controller("VelocityControl").send_velocity(Twist(Vector3(y=0.2)))
    sim.run(0.5)

    assert sim.rejected == []
    y = sim.link_poses()["base_link"].translation()[1]
    assert y == pytest.approx(0.1, abs=1e-3)


def test_of_two_that_set_a_base_s_velocity_the_last_one_does(tmp_path: Path) -> None:
    first = plugin("gz-sim-velocity-control-system", ("initial_linear", "1 0 0"))
    second = plugin("gz-sim-velocity-control-system", ("initial_linear", "0 0.2 0"))
    robot = load(tmp_path, cart(first, second.replace('"drive"', '"other"')))

    sim = simulate(robot)
    sim.run(0.5)

    x, y, _ = sim.link_poses()["base_link"].translation()
    assert (x, y) == pytest.approx((0.0, 0.1), abs=1e-3)
    assert any("several plugins set the velocity" in str(e) for e in sim.report)


def test_classic_s_steered_cart_turns_its_steering_wheel_along(tmp_path: Path) -> None:
    wheel = bob("rim", "0 0 0") + joint("column", "base_link", "rim")
    block = classic_ackermann(
        ("steering_wheel_joint", "column"),
        ("update_rate", 0),
        ("max_steer", 0.5),
        ("max_steering_angle", 1.0),
        ("publish_wheel_tf", "true"),
        ("publish_odom_tf", "true"),
    )
    sim = simulate(load(tmp_path, steered_cart(wheel + block)))
    assert topics(sim) == {"/cmd_vel": "Twist", "/odom": "Odometry", "/tf": "TFMessage"}

    sim.topic("/cmd_vel").publish(Twist(angular=Vector3(z=0.3)))
    sim.run(2.0)

    state = sim.joint_states()
    angles = dict(zip(state.name, state.position, strict=True))
    both = (angles["left_steering"] + angles["right_steering"]) / 2.0
    assert both == pytest.approx(0.3, abs=0.02)
    assert angles["column"] == pytest.approx(2.0 * both, abs=0.01)
    frames = sim.topic("/tf").value().transforms
    assert [frame.child_frame_id for frame in frames] == [
        *("front_right_wheel", "front_left_wheel", "right_wheel", "left_wheel"),
        *("right_knuckle", "left_knuckle", "rim", "base_footprint"),
    ]


def test_of_two_robots_each_has_the_velocity_that_is_set(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(plugin("gz-sim-velocity-control-system")))
    robots = [
        dataclasses.replace(robot, name=name, pose=(x, 0.0, 0.0, 0.0, 0.0, 0.0))
        for name, x in (("one", 0.0), ("two", 3.0))
    ]
    options = ad.SimulationOptions(gravity=False)
    sim = ad.Simulation(ad.build_diagram(robots, world="void", options=options))

    sim.topic("/model/two/cmd_vel").publish(Twist(Vector3(y=0.2)))
    sim.run(0.5)

    one, two = (
        sim.link_poses(robot.name)["base_link"].translation()[:2] for robot in robots
    )
    assert one == pytest.approx([0.0, 0.0], abs=1e-3)
    assert two == pytest.approx([3.0, 0.1], abs=1e-3)
