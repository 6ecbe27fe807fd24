"""Bases of real robots stand still, and drive where their wheels say that they are."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

import arm_drake as ad
from arm_drake.messages import Odometry, Twist, Vector3
from tests.robots import load_real_robot


class Row(NamedTuple):
    """What a test has to know of a base."""

    # Its controller, and the frame whose odometry that publishes.
    controller: str
    frame: str

    # How far the middle of its driven wheels is in front of that frame [m].
    forwards: float = 0.0

    # Distribution that it was written for.
    distro: str = "jazzy"

    # How fast it drives and turns on a square [m/s], [rad/s].
    speed: float = 0.4
    turn: float = 1.0


BASES = {
    "create3": Row("diffdrive_controller", "base_link"),
    # Its wheels are too weak for more than 0.27 m/s: 6 N·m against a friction of
    # 2 N·m, a damping of 1 N·m·s/rad, and casters.
    "pmb2": Row("mobile_base_controller", "base_footprint", speed=0.2, turn=0.5),
    "gz_ackermann_drive": Row("ackermann_steering_controller", "base_link"),
    # Its base is in the middle of a wheelbase of 0.325 m.
    "demo11_carlikebot": Row(
        "bicycle_steering_controller", "base_link", forwards=-0.1625
    ),
    # For Gazebo Classic, whose last distribution is humble; later a limit of the jerk
    # of 0, which it has, is one.
    "gzc_diff_drive_namespaced": Row(
        "diff_drive_base_controller", "chassis", forwards=0.554283, distro="humble"
    ),
}

# How often commands are sent [s].
PERIOD = 0.1

# Of the plant [s], on long ways: they are the same ways at the default, a fifth of it.
STEP = 5e-3


class Base:
    """A base in the world, driven by the commands of its controller."""

    def __init__(self, name: str, step: float = 1e-3) -> None:
        self.row = BASES[name]
        self.robot = load_real_robot(name, distro=self.row.distro)
        options = ad.SimulationOptions(time_step=step)
        self.sim = ad.Simulation(ad.build_diagram(self.robot, options=options))
        self.plant = self.sim.diagram.GetSubsystemByName("plant")
        controller = self.row.controller
        self.controller = self.sim.controller(controller)
        steers = "steering" in controller
        self.odom = self.sim.topic(f"/{controller}/{'odometry' if steers else 'odom'}")

    def pose(self) -> RigidTransform:
        """Return the truth: where the base is."""
        context = self.plant.GetMyContextFromRoot(self.sim.simulator.get_context())
        body = self.plant.GetBodyByName(self.row.frame)
        return self.plant.EvalBodyPoseInWorld(context, body)

    def middle(self) -> RigidTransform:
        """Return the truth: where the middle of the driven wheels is."""
        return self.pose() @ RigidTransform([self.row.forwards, 0.0, 0.0])

    def read(self, port: str) -> Any:
        """Return what an output of the diagram shows."""
        context = self.sim.simulator.get_context()
        return self.sim.diagram.GetOutputPort(port).Eval(context)

    def joints(self, quantity: int) -> dict[str, float]:
        """Return positions (0), velocities (1) or efforts (2) by joint."""
        names = [joint.name for joint in self.robot.description.movable_joints]
        values = self.read("joint_states").reshape(3, -1)[quantity]
        return dict(zip(names, values, strict=True))

    def drive(self, v: float, w: float, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            twist = Twist(Vector3(x=v), Vector3(z=w))
            self.controller.send_velocity(twist)
            self.step()

    def step(self) -> None:
        self.sim.run(PERIOD)

    def stop(self) -> None:
        self.drive(0.0, 0.0, 0.6)


class TracedBase(Base):
    """A base with two wheels, of which their speeds and slip are recorded."""

    # How often [s].
    SAMPLE = 0.01

    def __init__(self, name: str) -> None:
        super().__init__(name)
        truth = self.sim.diagram.GetSubsystemByName(f"{self.row.controller}:truth")
        self.wheels = truth.wheels
        self.trace = [self.sample()]

    def sample(self) -> list[float]:
        """Return the rim speeds of the wheels, and their slip, along and across."""
        spins = self.joints(1)
        rims = [wheel.radius * spins[wheel.joint] for wheel in self.wheels]
        return [*rims, *self.read(f"{self.row.controller}.wheel_slip")]

    def step(self) -> None:
        for _ in range(round(PERIOD / self.SAMPLE)):
            self.sim.run(self.SAMPLE)
            self.trace.append(self.sample())

    def path(self, *, slips: bool) -> np.ndarray:
        """Return x, y and heading at the end, from the wheels' speeds.

        Args:
            slips: Whether their slip is added.
        """
        samples = np.array(self.trace)
        context = self.plant.GetMyContextFromRoot(self.sim.simulator.get_context())
        left, right = (
            self.plant.EvalBodyPoseInWorld(
                context, self.plant.GetBodyByName(name)
            ).translation()
            for name in ("wheel_left_link", "wheel_right_link")
        )
        rims, along, across = samples[:, :2], samples[:, 2:4], samples[:, 4:]
        speeds = rims + along if slips else rims
        forwards = speeds.mean(axis=1)
        turning = (speeds[:, 1] - speeds[:, 0]) / np.linalg.norm(left - right)
        sideways = across.mean(axis=1) if slips else np.zeros(len(samples))
        x = y = heading = 0.0
        for v, u, w in zip(*map(_middles, (forwards, sideways, turning)), strict=True):
            middle = heading + w * self.SAMPLE / 2.0
            x += (v * np.cos(middle) - u * np.sin(middle)) * self.SAMPLE
            y += (v * np.sin(middle) + u * np.cos(middle)) * self.SAMPLE
            heading += w * self.SAMPLE
        return np.array([x, y, heading])


def _middles(samples: np.ndarray) -> np.ndarray:
    return (samples[1:] + samples[:-1]) / 2.0


def yaw(pose: RigidTransform) -> float:
    return float(RollPitchYaw(pose.rotation()).yaw_angle())


def pitch(pose: RigidTransform) -> float:
    return float(RollPitchYaw(pose.rotation()).pitch_angle())


@pytest.mark.parametrize("name", BASES)
def test_a_base_stands_still_from_the_start(name: str) -> None:
    base = Base(name)
    before = base.pose()

    base.sim.run(2.0)

    moved = base.pose().translation() - before.translation()
    # Twice what settling takes, and no more than 0.1 mm or mrad a second.
    assert np.linalg.norm(moved) < 2e-4
    assert abs(yaw(base.pose()) - yaw(before)) < 2e-4
    assert abs(pitch(base.pose()) - pitch(before)) < 2e-4
    # Not by chance: nothing moves at the end.
    assert max(map(abs, base.joints(1).values())) < 1e-3


@pytest.mark.parametrize("sides", [2, pytest.param(4, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["create3", "pmb2", "gzc_diff_drive_namespaced"])
def test_a_base_drives_a_square(name: str, sides: int) -> None:
    base, (speed, turn), side = Base(name, STEP), BASES[name][-2:], 0.5
    start, path, worst = base.middle(), 0.0, 0.0

    for _ in range(sides):
        base.drive(speed, 0.0, side / speed)
        base.stop()
        base.drive(0.0, turn, np.pi / 2.0 / turn)
        base.stop()
        path += side
        truth = start.inverse() @ base.middle()
        pose = base.odom.value().pose.pose
        x, y = truth.translation()[:2]
        worst = max(worst, np.hypot(pose.position.x - x, pose.position.y - y) / path)

    # What the wheels say is within 5 % of the way that was driven.
    assert worst < 0.05
    # And it did drive, about all that was commanded; a start takes its time.
    end = (start.inverse() @ base.middle()).translation()[:2]
    corner = [side, side] if sides == 2 else [0.0, 0.0]
    assert np.linalg.norm(end - corner) < 0.15
    assert base.odom.value().child_frame_id.endswith(base.row.frame)


def test_wheel_slip_explains_what_odometry_misses() -> None:
    base, (speed, turn) = TracedBase("pmb2"), BASES["pmb2"][-2:]
    start = base.middle()

    base.drive(speed, 0.0, 0.6 / speed)
    base.drive(0.0, turn, np.pi / 2.0 / turn)
    base.stop()

    truth = start.inverse() @ base.middle()
    x, y = truth.translation()[:2]
    known, guessed = base.path(slips=True), base.path(slips=False)
    pose = base.odom.value().pose.pose.position
    missed = np.hypot(pose.x - x, pose.y - y)
    # The sum of means of samples misses up to a T^2 / 8 at each kink of a speed, here
    # 0.5 m/s^2 (10 ms)^2 / 8 = 6 um, and there are four in each of two moves.
    assert np.hypot(known[0] - x, known[1] - y) < 5e-5
    assert known[2] == pytest.approx(yaw(truth) % (2.0 * np.pi), abs=1e-4)
    # Odometry misses much more, and without the slip so do the wheels' speeds.
    assert missed > 5e-4
    assert np.hypot(guessed[0] - x, guessed[1] - y) > 5e-4


def test_the_truth_is_told_beside_odometry() -> None:
    base, speed, turn = Base("pmb2"), 0.2, 0.2
    start = base.pose()

    base.drive(speed, turn, 2.0)

    truth: Odometry = base.read("mobile_base_controller.ground_truth")
    odom, moved = base.odom.value(), start.inverse() @ base.pose()
    assert truth.header.frame_id == odom.header.frame_id
    assert truth.child_frame_id == odom.child_frame_id
    where = truth.pose.pose.position
    assert [where.x, where.y] == pytest.approx(moved.translation()[:2], abs=1e-12)
    q = truth.pose.pose.orientation
    rotation = RollPitchYaw(Quaternion([q.w, q.x, q.y, q.z]))
    assert rotation.yaw_angle() == pytest.approx(yaw(moved), abs=1e-12)
    # Odometry is of the last tick, some ms ago at 0.2 m/s, and slips some mm.
    assert where.x == pytest.approx(odom.pose.pose.position.x, abs=0.01)
    assert truth.twist.twist.linear.x == pytest.approx(speed, rel=0.02)
    assert truth.twist.twist.angular.z == pytest.approx(turn, rel=0.02)


@pytest.mark.parametrize("v", [0.3, -0.3])
def test_a_base_drives_off_at_once_without_rocking(v: float) -> None:
    # The caster of create3 is 2.25 mm lower than its wheels: level, they would turn in
    # the air.
    base = Base("create3")
    before, tilts = pitch(base.pose()), []

    for _ in range(5):
        base.drive(v, 0.0, PERIOD)
        tilts.append(pitch(base.pose()) - before)

    # It leaves its caster on the ground: contact gives way by some um on 0.1 m.
    assert np.abs(tilts).max() < 1e-3
    # After the controller's ramp, 0.3 m/s / 0.9 m/s^2 = 0.33 s, and four times 1 / w0
    # the wheels are as fast as they should be, though the servo counts with a quarter
    # of what they carry.
    for joint in ("left_wheel_joint", "right_wheel_joint"):
        assert base.joints(1)[joint] == pytest.approx(v / 0.03575, rel=0.01)


@pytest.mark.parametrize(
    ("name", "w"),
    [
        ("gz_ackermann_drive", 0.2),
        # Its front wheels are parallel: one alone would roll on a circle that is half
        # the track, 0.13 m, smaller, the other one on one that much larger. So at
        # 0.1 rad/s the circle is known to 4.3 %.
        ("demo11_carlikebot", 0.1),
    ],
)
def test_a_car_turns_on_the_circle_of_its_geometry(name: str, w: float) -> None:
    base, v = Base(name, STEP), 0.3
    base.drive(v, w, 2.0)

    points = []
    for _ in range(round(1.2 / abs(w) / PERIOD)):
        base.drive(v, w, PERIOD)
        points.append(base.middle().translation()[:2])

    # The circle nearest to the points: x^2 + y^2 = 2 a x + 2 b y + c.
    path = np.array(points)
    table = np.column_stack([2.0 * path, np.ones(len(path))])
    a, b, c = np.linalg.lstsq(table, np.sum(path**2, axis=1), rcond=None)[0]
    radius = np.sqrt(c + a**2 + b**2)
    assert radius == pytest.approx(v / abs(w), rel=0.05)
    # A good part of it was driven, to the side that the description's axis says: that
    # of the demo for Gazebo points downwards, so it turns right when told left.
    assert np.ptp(path[:, 1]) > 1.0
    turned = w > 0.0 if name == "demo11_carlikebot" else w < 0.0
    assert (b > 0.0) == turned


def test_a_car_drives_straight_what_is_commanded() -> None:
    base = Base("demo11_carlikebot", STEP)
    start = base.pose()

    base.drive(0.3, 0.0, 5.0)
    base.stop()

    moved = start.inverse() @ base.pose()
    # Wheels and base start and stop alike late, so 1.5 m; friction lets them creep by
    # less than a hundredth.
    assert moved.translation()[0] == pytest.approx(1.5, rel=0.01)
    assert abs(moved.translation()[1]) < 1e-3
    assert abs(yaw(moved)) < 1e-3
