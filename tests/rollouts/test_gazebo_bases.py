"""Bases that Gazebo's plugins drive go where they are told, and where wheels say."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import arm_drake as ad
from arm_drake.messages import Float64, Odometry, Twist, Vector3
from tests import models
from tests.carts import (
    RADIUS,
    ackermann_steering,
    cart,
    classic_ackermann,
    classic_drive,
    diff_drive,
    load,
    plugin,
    steered_cart,
)

SPEED, TURN = 0.25, 0.8
REST = Twist()

GZ_TOPICS = "/model/cart/cmd_vel", "/model/cart/odometry"
CLASSIC_TOPICS = "/cmd_vel", "/odom"

# Of the plant [s], on long ways; turns are shown at the default, a fifth of it.
STEP = 5e-3

ENCODER = ("odometry_source", 0)

PLUGINS = {
    "gz": (diff_drive(), GZ_TOPICS),
    "gz, limited": (
        diff_drive(("max_linear_acceleration", 0.5), ("min_linear_acceleration", -0.5)),
        GZ_TOPICS,
    ),
    "classic": (classic_drive(ENCODER), CLASSIC_TOPICS),
    "classic, limited": (
        classic_drive(ENCODER, ("max_wheel_acceleration", 0.5)),
        CLASSIC_TOPICS,
    ),
}


class Cart:
    """A cart in the world, settled on its wheels."""

    description = staticmethod(lambda plugin, limit: cart(plugin, limit=limit))

    def __init__(
        self,
        folder: Path,
        plugin: str,
        topics: tuple[str, str],
        limit: str = "",
        step: float = 1e-3,
    ) -> None:
        self.robot = load(folder, self.description(plugin, limit))
        # A step is no longer than a period of the manager, of 1 ms by default.
        robot = models.at_rate_of(self.robot, step)
        options = ad.SimulationOptions(time_step=step)
        self.sim = ad.Simulation(ad.build_diagram(robot, options=options))
        self.command, self.odom = (self.sim.topic(name) for name in topics)
        self.sim.run(0.5)
        self.start, self.start_odom = self.pose(), self.odometry()

    def pose(self) -> RigidTransform:
        """Return the truth: where the base is."""
        return self.sim.link_poses()["base_link"]

    def odometry(self) -> Odometry:
        message = self.odom.value()
        assert isinstance(message, Odometry)
        return message

    def drive(self, v: float, w: float, duration: float) -> None:
        """Command once, for the plugins go on by themselves; then stop."""
        self.command.publish(Twist(Vector3(x=v), Vector3(z=w)))
        self.sim.run(duration)
        self.command.publish(REST)
        self.sim.run(1.5)

    def moved(self) -> tuple[float, float, float]:
        """Return how far the base is from its start, really: x, y [m], yaw [rad]."""
        pose = self.start.inverse() @ self.pose()
        x, y = pose.translation()[:2]
        return x, y, yaw(pose)

    def counted(self) -> tuple[float, float, float]:
        """Return the same as the odometry has it."""
        first, last = (to_pose(m) for m in (self.start_odom, self.odometry()))
        pose = first.inverse() @ last
        x, y = pose.translation()[:2]
        return x, y, yaw(pose)


def yaw(pose: RigidTransform) -> float:
    return float(RollPitchYaw(pose.rotation()).yaw_angle())


def to_pose(message: Odometry) -> RigidTransform:
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    angle = 2.0 * np.arctan2(turn.z, turn.w)
    return RigidTransform(
        RollPitchYaw(0.0, 0.0, angle), [position.x, position.y, position.z]
    )


@pytest.mark.parametrize("name", PLUGINS)
def test_a_cart_drives_a_metre(tmp_path: Path, name: str) -> None:
    base = Cart(tmp_path, *PLUGINS[name], step=STEP)

    base.drive(SPEED, 0.0, 1.0 / SPEED)

    assert base.robot.has_free_base
    x, y, angle = base.moved()
    # The wheels say where it is to 5 % of the way, and all of it was driven.
    assert base.counted() == pytest.approx((x, y, angle), abs=0.05)
    assert x == pytest.approx(1.0, abs=0.05)
    assert abs(y) < 0.05
    assert abs(angle) < 0.05


@pytest.mark.parametrize("name", PLUGINS)
def test_a_cart_turns_on_the_spot(tmp_path: Path, name: str) -> None:
    base = Cart(tmp_path, *PLUGINS[name])

    base.drive(0.0, TURN, np.pi / 2.0 / TURN)

    x, y, angle = base.moved()
    counted = base.counted()
    # 5 % of the angle; it stays where it is.
    assert counted[2] == pytest.approx(angle, rel=0.05)
    assert angle == pytest.approx(np.pi / 2.0, rel=0.05)
    assert np.hypot(x, y) < 0.02
    assert np.hypot(counted[0], counted[1]) < 0.02


def test_the_odometry_of_the_world_is_the_truth(tmp_path: Path) -> None:
    base = Cart(tmp_path, classic_drive(), CLASSIC_TOPICS)
    base.command.publish(Twist(Vector3(x=SPEED), Vector3(z=TURN)))

    # Up to the tick before the next one: what is published is at most 10 ms old.
    base.sim.run(3.0)

    message, pose = base.odometry(), base.pose()
    position = message.pose.pose.position
    said = np.array([position.x, position.y, position.z])
    # It moves by 2.5 mm in 10 ms.
    assert np.linalg.norm(said - pose.translation()) < 0.003
    assert yaw(to_pose(message)) == pytest.approx(yaw(pose), abs=0.01)
    velocity = message.twist.twist
    # The wheels slip a little.
    assert velocity.linear.x == pytest.approx(SPEED, rel=0.05)
    assert abs(velocity.linear.y) < 0.02
    assert velocity.angular.z == pytest.approx(TURN, rel=0.05)


def test_the_wheels_of_classic_have_the_torque_of_the_tag(tmp_path: Path) -> None:
    # To move the caster takes more than 0.2 N·m; 0.4 N·m are less than the 1 N·m of the
    # joints.
    tags = (ENCODER, ("max_wheel_torque", 0.4))
    limit = '<limit effort="1" velocity="0.5"/>'
    base = Cart(tmp_path, classic_drive(*tags), CLASSIC_TOPICS, limit, STEP)

    base.drive(SPEED, 0.0, 4.0)

    rollout = base.sim.rollout()
    assert np.abs(rollout.effort).max() == pytest.approx(0.4, abs=1e-9)
    # And not the speed of the joints, which is 0.05 m/s at the rim.
    assert rollout.velocity.max() * RADIUS == pytest.approx(SPEED, rel=0.02)


@pytest.mark.parametrize("load", [0.0, 2000.0])
def test_the_load_of_a_cart_does_not_press_its_wheels_into_the_ground(
    tmp_path: Path, load: float
) -> None:
    ballast = f"""<link name="load"><inertial><origin xyz="0 0 0.1"/>
        <mass value="{load}"/><inertia ixx="20" iyy="20" izz="20" ixy="0" ixz="0"
          iyz="0"/></inertial></link>
      <joint name="load" type="fixed"><parent link="base_link"/><child link="load"/>
        <origin xyz="-0.02 0 0"/></joint>"""
    base = Cart(tmp_path, (ballast if load else "") + diff_drive(), GZ_TOPICS)

    # It has settled, and turning wheels would roll as if they were smaller.
    base.sim.run(1.0)

    assert float(base.pose().translation()[2]) == pytest.approx(0.0, abs=1e-3)


def test_a_payload_does_not_press_it_in_either(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(diff_drive()))
    payload = ad.Payload(2000.0, (-0.02, 0.0, 0.1))
    diagram = ad.build_diagram(robot, payloads={"base_link": payload})
    sim = ad.Simulation(diagram)

    sim.run(0.5)

    height = float(sim.link_poses()["base_link"].translation()[2])
    assert height == pytest.approx(0.0, abs=1.1e-3)


ODOMETRY = "gz-sim-odometry-publisher-system"


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_odometry_of_a_publisher_is_the_truth(
    tmp_path: Path, dimensions: int
) -> None:
    truth = plugin(
        ODOMETRY,
        ("dimensions", dimensions),
        ("odom_topic", "truth"),
        ("robot_base_frame", "mast"),
        ("xyz_offset", "0 0 0.5"),
        ("rpy_offset", f"0 0 {np.pi / 2.0}"),
    )
    base = Cart(tmp_path, diff_drive() + truth, GZ_TOPICS)
    base.command.publish(Twist(Vector3(x=SPEED), Vector3(z=TURN)))

    # Between two ticks of the publisher, at the end of one.
    base.sim.advance_to(2.0)
    message = base.sim.topic("/truth").value()

    assert isinstance(message, Odometry)
    assert (message.header.frame_id, message.child_frame_id) == ("cart/odom", "mast")
    shown = to_pose(message)
    moved = base.pose()
    x, y, _ = moved.translation()
    # It is published each 20 ms, in which the cart goes 5 mm.
    assert shown.translation()[:2] == pytest.approx([x, y], abs=6e-3)
    assert shown.translation()[2] == pytest.approx((0.0, 0.5)[dimensions - 2], abs=1e-3)
    assert yaw(shown) == pytest.approx(yaw(moved) + np.pi / 2.0, abs=0.02)
    # The frame is turned by 90 degrees, so it goes to its right.
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    assert (linear.x, linear.y) == pytest.approx((0.0, -SPEED), abs=0.01)
    assert angular.z == pytest.approx(TURN, abs=0.03)
    (transform,) = base.sim.topic("/model/cart/pose").value().transforms
    assert transform.transform.rotation == message.pose.pose.orientation


def test_a_publisher_that_was_off_tells_no_velocity_of_that_time(
    tmp_path: Path,
) -> None:
    truth = plugin(ODOMETRY, ("odom_topic", "truth"))
    base = Cart(tmp_path, diff_drive() + truth, GZ_TOPICS, step=STEP)
    base.command.publish(Twist(Vector3(x=SPEED)))
    base.sim.run(0.5)
    base.sim.switch_controllers(deactivate=["OdometryPublisher"])
    base.sim.run(1.0)
    base.sim.switch_controllers(activate=["OdometryPublisher"])

    speeds = []
    for _ in range(20):
        base.sim.run(STEP)
        message = base.sim.topic("/truth").value()
        assert isinstance(message, Odometry)
        speeds.append(message.twist.twist.linear.x)

    assert max(speeds) == pytest.approx(SPEED, rel=0.1)


def test_messages_may_be_as_far_apart_as_one_likes(tmp_path: Path) -> None:
    rare = ("odom_publish_frequency", 1e-320)
    base = Cart(
        tmp_path, diff_drive(rare) + plugin(ODOMETRY, rare), GZ_TOPICS, step=STEP
    )

    assert base.odometry().header.frame_id == ""


def test_what_an_odometry_publisher_cannot_do_is_reported(tmp_path: Path) -> None:
    noisy = plugin(ODOMETRY, ("gaussian_noise", 0.1), ("odom_topic", "a"))
    odd = plugin(ODOMETRY, ("dimensions", 4))
    short = plugin(ODOMETRY, ("xyz_offset", "1 2"))
    twice = plugin(ODOMETRY, ("odom_topic", "a"), ("tf_topic", "/a"))

    robot = load(tmp_path, cart(diff_drive(), noisy, odd, short, twice))

    lines = [str(line) for line in robot.report if line.severity != "info"]
    assert [line.partition(".urdf:")[2].lstrip("1: ") for line in lines] == [
        "Gazebo plugin 'drive': dimensions: expected 2 or 3, got 4; "
        "the plugin is left out",
        "Gazebo plugin 'drive': xyz_offset: expected three numbers, got 2; "
        "the plugin is left out",
        "Gazebo plugin 'drive': odom_topic and tf_topic are both 'a'; "
        "the plugin is left out",
        "OdometryPublisher: gaussian_noise: velocities are told exactly; "
        "it has no effect",
    ]


FORCE = "gz-sim-apply-joint-force-system"
PUSHED = "".join(plugin(FORCE, ("joint_name", side)) for side in ("left", "right"))


def push(sim: ad.Simulation, torque: float) -> None:
    for side in ("left", "right"):
        sim.topic(f"/model/cart/joint/{side}/cmd_force").publish(Float64(torque))


def test_torques_on_wheels_roll_a_base(tmp_path: Path) -> None:
    slides = '<gazebo reference="caster"><mu1>0</mu1></gazebo>'
    robot = load(tmp_path, cart(PUSHED, slides))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.2)
    x = sim.link_poses()["base_link"].translation()[0]

    push(sim, 0.1)
    sim.run(1.0)

    assert robot.has_free_base
    # Of 6.2 kg and two wheels of 0.0025 kg·m^2; nothing else holds it.
    a = 2.0 * 0.1 / RADIUS / (6.2 + 2.0 * 0.0025 / RADIUS**2)
    moved = sim.link_poses()["base_link"].translation()[0] - x
    assert moved == pytest.approx(a / 2.0, rel=0.02)


def test_a_torque_stays_until_it_is_switched_off_and_within_the_limit(
    tmp_path: Path,
) -> None:
    fixed = '<link name="world"/><joint name="stand" type="fixed">'
    fixed += '<parent link="world"/><child link="base_link"/>'
    fixed += '<origin xyz="0 0 1"/></joint>'
    limit = '<limit effort="0.01" velocity="100"/>'
    robot = load(tmp_path, cart(PUSHED, fixed, limit=limit))
    sim = ad.Simulation(ad.build_diagram(robot))

    push(sim, 5.0)
    sim.run(0.5)
    fast = sim.rollout().velocity[-1]
    push(sim, float("nan"))
    sim.switch_controllers(deactivate=["ApplyJointForce"])
    sim.run(0.5)

    assert not robot.has_free_base
    # 0.01 N·m turns a wheel of 0.0025 kg·m^2 for half a second.
    assert fast == pytest.approx([2.0, 2.0], rel=0.01)
    assert sim.rollout().velocity[-1] == pytest.approx(fast, rel=0.01)


def test_a_joint_that_is_not_pushed_leaves_the_base_fixed(tmp_path: Path) -> None:
    # Gazebo takes the first name of a plugin, here of what is no wheel.
    lift = """<link name="lift"/><joint name="lift" type="revolute">
        <parent link="base_link"/><child link="lift"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
    pushed = plugin(FORCE, ("joint_name", "lift"), ("joint_name", "left"))

    assert not load(tmp_path, cart(lift + pushed)).has_free_base


@pytest.mark.parametrize("kind", ["continuous", "revolute"])
def test_torques_on_what_is_no_wheel_leave_the_base_fixed(
    tmp_path: Path, kind: str
) -> None:
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    text = cart(PUSHED, limit=limit).replace('"continuous"', f'"{kind}"')

    assert load(tmp_path, text).has_free_base == (kind == "continuous")


class SteeredCart(Cart):
    """A cart with steered wheels, settled on them."""

    description = staticmethod(lambda plugin, limit: steered_cart(plugin))


@pytest.mark.parametrize("w", [0.2, -0.2])
def test_a_steered_cart_goes_round_a_circle(tmp_path: Path, w: float) -> None:
    # The wheels are steered before it drives; the radius is 1.25 m.
    block = ackermann_steering(("steer_p_gain", 10.0))
    base = SteeredCart(tmp_path, block, GZ_TOPICS, step=STEP)
    base.drive(0.25, w, 1.0)
    base.start, base.start_odom = base.pose(), base.odometry()

    base.drive(0.25, w, 4.0)

    x, y, angle = base.moved()
    assert base.robot.has_free_base
    # The wheels say where it is to 5 % of the way of a metre.
    assert base.counted() == pytest.approx((x, y, angle), abs=0.05)
    assert angle == pytest.approx(4.0 * w, rel=0.05)
    # Half the chord by the sine of half the angle.
    radius = np.hypot(x, y) / 2.0 / np.sin(abs(angle) / 2.0)
    assert radius == pytest.approx(1.25, rel=0.05)


def test_a_steered_cart_drives_straight_back(tmp_path: Path) -> None:
    base = SteeredCart(tmp_path, ackermann_steering(), GZ_TOPICS, step=STEP)

    base.drive(-0.5, 0.0, 2.0)

    x, y, angle = base.moved()
    assert x == pytest.approx(-1.0, abs=0.05)
    assert base.counted() == pytest.approx((x, y, angle), abs=0.05)
    assert (y, angle) == pytest.approx((0.0, 0.0), abs=0.02)


def test_a_cart_that_steers_alone_turns_its_wheels_alone(tmp_path: Path) -> None:
    block = ackermann_steering(("steering_only", "true"), ("steer_p_gain", 10.0))
    robot = load(tmp_path, steered_cart(block))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.topic("/model/cart/steer_angle").publish(0.3)

    sim.run(2.0)

    state = sim.joint_states()
    angles = dict(zip(state.name, state.position, strict=True))
    arm = 0.5 / np.tan(0.3)
    # Its wheel_separation is 0.4 m; friction turns with the wheels.
    found = (angles["left_steering"], angles["right_steering"])
    wanted = (np.arctan(0.5 / (arm - 0.2)), np.arctan(0.5 / (arm + 0.2)))
    assert found == pytest.approx(wanted, abs=0.02)
    assert np.linalg.norm(sim.link_poses()["base_link"].translation()[:2]) < 0.1


VELOCITY = "gz-sim-velocity-control-system"
PLANAR = "libgazebo_ros_planar_move.so"

# A base that slides on four feet, of 5 kg.
FEET = "".join(
    f"""<collision><origin xyz="{x} {y} -0.03"/><geometry><sphere radius="0.02"/>
    </geometry></collision>"""
    for x in (-0.2, 0.2)
    for y in (-0.2, 0.2)
)
SLED = f"""<robot name="cart"><link name="base_link"><inertial><mass value="5"/>
<inertia ixx="0.05" iyy="0.1" izz="0.12" ixy="0" ixz="0" iyz="0"/></inertial>{FEET}
</link>{{}}</robot>"""

# A motor's rotor in it, which nothing turns.
ROTOR = """<link name="rotor"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="spin" type="continuous"><parent link="base_link"/><child link="rotor"/>
<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/></joint>"""


def hold(
    folder: Path, text: str, *, world: str = "void", gravity: bool | None = False
) -> ad.Simulation:
    options = ad.SimulationOptions(gravity=gravity, time_step=1e-3)
    robot = load(folder, text)
    assert robot.has_free_base
    return ad.Simulation(ad.build_diagram(robot, world=world, options=options))


@pytest.mark.parametrize(
    ("block", "topic"),
    [
        (plugin(VELOCITY), "/model/cart/cmd_vel"),
        # Once set, it goes on in the void; it turns with the base each time.
        (plugin(PLANAR, ("update_rate", 0)), "/cmd_vel"),
    ],
)
def test_a_base_whose_velocity_is_set_goes_round_a_circle(
    tmp_path: Path, block: str, topic: str
) -> None:
    sim = hold(tmp_path, SLED.format(ROTOR + block))
    vx, vy, w, duration = 0.3, 0.2, 0.5, 2.0
    sim.run(0.1)
    start = sim.link_poses()["base_link"]
    sim.topic(topic).publish(Twist(Vector3(x=vx, y=vy), Vector3(z=w)))

    sim.run(duration)

    moved = start.inverse() @ sim.link_poses()["base_link"]
    sin, cos = np.sin(w * duration), np.cos(w * duration) - 1.0
    wanted = np.array([vx * sin + vy * cos, vy * sin - vx * cos, 0.0]) / w
    # It starts and turns one or two steps of 1 ms late.
    np.testing.assert_allclose(moved.translation(), wanted, atol=1.5e-3)
    assert yaw(moved) == pytest.approx(w * duration, abs=1.5e-3)


def test_setting_a_base_s_velocity_leaves_its_joints_theirs(tmp_path: Path) -> None:
    sim = hold(tmp_path, SLED.format(ROTOR + plugin(VELOCITY)))

    sim.topic("/model/cart/cmd_vel").publish(Twist(angular=Vector3(z=2.0)))
    sim.run(0.5)

    # The rotor, whose center isn't on its axis, turns with the base, but for what
    # tips this within each step.
    (rate,) = sim.joint_states().velocity
    assert rate == pytest.approx(0.0, abs=1e-3)


def test_what_rubs_takes_from_a_base_what_it_takes_in_a_step(tmp_path: Path) -> None:
    sim = hold(tmp_path, SLED.format(plugin(VELOCITY)), world="empty", gravity=True)
    sim.topic("/model/cart/cmd_vel").publish(Twist(Vector3(y=0.2)))
    sim.run(0.5)
    before = sim.link_poses()["base_link"]

    sim.run(1.0)

    x, y, z = (before.inverse() @ sim.link_poses()["base_link"]).translation()
    # A friction of 1 brakes by g dt = 9.8 mm/s, with steps of 1 ms.
    assert y == pytest.approx(0.2 - 9.81e-3, abs=1e-3)
    assert (x, z) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_without_a_command_a_base_is_held_at_rest(tmp_path: Path) -> None:
    sim = hold(tmp_path, SLED.format(plugin(VELOCITY)), gravity=True)

    sim.run(0.1)
    before = sim.link_poses()["base_link"]

    sim.run(0.5)

    moved = before.inverse() @ sim.link_poses()["base_link"]
    # It falls by no more than what gravity adds in a step, g dt for 0.5 s.
    assert moved.translation()[2] == pytest.approx(-9.81e-3 * 0.5, rel=1e-3)


def test_between_two_times_classic_lets_a_base_slow_down(tmp_path: Path) -> None:
    block = plugin(PLANAR, ("update_rate", 50))
    sim = hold(tmp_path, SLED.format(block), world="empty", gravity=True)
    sim.topic("/cmd_vel").publish(Twist(Vector3(x=0.4)))
    sim.run(0.5)
    before = sim.link_poses()["base_link"]

    sim.run(1.0)

    moved = before.inverse() @ sim.link_poses()["base_link"]
    # A friction of 1 brakes from 0.4 to 0.2 m/s in 20 ms.
    mean = 0.4 - 9.81 * 0.02 / 2.0
    assert moved.translation()[0] == pytest.approx(mean, abs=0.01)
    message = sim.topic("/odom").value()
    where = sim.link_poses()["base_link"].translation()
    # What was published is at most 50 ms old.
    assert message.pose.pose.position.x == pytest.approx(where[0], abs=0.05 * 0.4)
    assert 0.2 < message.twist.twist.linear.x < 0.4


def test_a_base_that_hangs_from_the_world_is_said_not_to_move(tmp_path: Path) -> None:
    world = '<link name="world"/><joint name="hold" type="fixed">'
    world += '<parent link="world"/><child link="base_link"/></joint>'
    robot = load(tmp_path, SLED.format(world + plugin(VELOCITY)))

    sim = ad.Simulation(ad.build_diagram(robot))

    assert not robot.has_free_base
    assert any(
        "a joint holds the base in the world; it doesn't move" in str(entry)
        for entry in sim.report
    )


@pytest.mark.parametrize("angle", [0.3, -0.3])
def test_classic_s_steered_cart_goes_round_a_circle(
    tmp_path: Path, angle: float
) -> None:
    block = classic_ackermann(("update_rate", 0))
    base = SteeredCart(tmp_path, block, CLASSIC_TOPICS)
    base.command.publish(Twist(Vector3(x=0.4), Vector3(z=angle)))
    base.sim.run(2.0)
    first = base.pose()

    base.sim.run(3.0)

    moved = first.inverse() @ base.pose()
    x, y = moved.translation()[:2]
    radius = np.hypot(x, y) / 2.0 / np.sin(yaw(moved) / 2.0)
    # The middle of the rear axle; 5 % of it.
    assert radius == pytest.approx(0.5 / np.tan(angle), rel=0.05)
    # The right rear wheel has the speed, whichever side it is on.
    speed = 0.4 * radius / (radius + 0.2)
    assert abs(yaw(moved) * radius) == pytest.approx(3.0 * speed, rel=0.05)
    message, pose = base.odometry(), base.pose()
    place = message.pose.pose.position
    # What was told is a tick old.
    where = pose.translation()
    assert [place.x, place.y, place.z] == pytest.approx(where.tolist(), abs=1e-3)


def test_classic_s_steered_cart_is_pushed_a_tenth_of_the_time(tmp_path: Path) -> None:
    block = classic_ackermann(("publish_distance", "true"))
    base = SteeredCart(tmp_path, block.replace("1 2 0", "2 0 0"), CLASSIC_TOPICS)

    base.command.publish(Twist(Vector3(x=0.4)))
    base.sim.run(0.285)

    # 10 kg and four wheels of 2.5e-3 kg·m^2; both rear wheels, a tenth of 2 N·m·s.
    mass = 10.0 + 4 * 2.5e-3 / RADIUS**2
    elapsed = 0.285 / (mass * RADIUS**2 / (2 * 0.1 * 2.0))
    speed = 0.4 * (1.0 - np.exp(-elapsed))
    assert base.odometry().twist.twist.linear.x == pytest.approx(speed, rel=0.1)
    way = base.sim.topic("/distance").value().data
    assert way == pytest.approx(base.moved()[0], abs=0.01)


def test_without_shapes_of_wheels_classic_s_plugin_is_left_out(tmp_path: Path) -> None:
    text = steered_cart(classic_ackermann())
    shape = f'<cylinder radius="{RADIUS}" length="0.04"/>'

    robot = load(tmp_path, text.replace(shape, '<box size="0.1 0.1 0.1"/>'))

    assert [
        f"{entry.severity}: {entry.where}: {entry.what}; {entry.done}"
        for entry in robot.report
        if entry.severity == "error"
    ] == [
        "error: Gazebo plugin GazeboRosAckermannDrive: its wheels lack <collision>, a "
        "cylinder or a sphere, or are all in one place: no radius, wheel separation or "
        "wheel base; it is left out"
    ]
