"""Bases of real robots stand still, and drive where their wheels say that they are."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import arm_drake as ad
from arm_drake.messages import Twist, Vector3
from tests.robots import read_index, robots_folder

# Controller of each base, and the frame whose odometry it publishes.
BASES = {
    "create3": ("diffdrive_controller", "base_link"),
    "pmb2": ("mobile_base_controller", "base_footprint"),
    "gz_ackermann_drive": ("ackermann_steering_controller", "base_link"),
}

# What is commanded [m/s], [rad/s].
SPEED, TURN = 0.2, 0.5

# How often commands are sent [s].
PERIOD = 0.1


class Base:
    """A base in the world, driven by the commands of its controller."""

    def __init__(self, name: str) -> None:
        row, folder = read_index()[name], robots_folder()
        self.robot = ad.load_robot(
            folder / row["entry"],
            xacro_args=row["xacro_args"],
            controllers=[folder / file for file in row["controllers_yaml"]],
            variables=row["launch_vars"],
        )
        self.sim = ad.Simulation(ad.build_diagram(self.robot))
        self.plant = self.sim.diagram.GetSubsystemByName("plant")
        controller, self.frame = BASES[name]
        self.controller = self.sim.controller(controller)
        steers = "steering" in controller
        self.odom = self.sim.topic(f"/{controller}/{'odometry' if steers else 'odom'}")

    def pose(self) -> RigidTransform:
        """Return the truth: where the base is."""
        context = self.plant.GetMyContextFromRoot(self.sim.simulator.get_context())
        body = self.plant.GetBodyByName(self.frame)
        return self.plant.EvalBodyPoseInWorld(context, body)

    def drive(self, v: float, w: float, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            twist = Twist(Vector3(x=v), Vector3(z=w))
            self.controller.send_velocity(twist)
            self.sim.run(PERIOD)

    def stop(self) -> None:
        self.drive(0.0, 0.0, 2.0)


def yaw(pose: RigidTransform) -> float:
    return float(RollPitchYaw(pose.rotation()).yaw_angle())


@pytest.mark.parametrize("name", BASES)
def test_a_base_stands_still(name: str) -> None:
    base = Base(name)
    base.sim.run(1.0)  # It settles on its wheels.
    before = base.pose()

    base.sim.run(10.0)

    moved = base.pose().translation() - before.translation()
    assert np.linalg.norm(moved) < 1e-3
    assert abs(yaw(base.pose()) - yaw(before)) < 1e-3


@pytest.mark.parametrize("name", ["create3", "pmb2"])
def test_a_base_drives_a_square(name: str) -> None:
    base = Base(name)
    base.sim.run(1.0)
    start, path, worst = base.pose(), 0.0, 0.0

    for _ in range(4):
        base.drive(SPEED, 0.0, 1.0 / SPEED)
        base.stop()
        base.drive(0.0, TURN, np.pi / 2.0 / TURN)
        base.stop()
        path += 1.0
        truth = start.inverse() @ base.pose()
        pose = base.odom.value().pose.pose
        x, y = truth.translation()[:2]
        worst = max(worst, np.hypot(pose.position.x - x, pose.position.y - y) / path)

    # What the wheels say is within 5 % of the way that was driven.
    assert worst < 0.05
    # And it did drive, about all that was commanded; a start takes its time.
    assert np.linalg.norm((start.inverse() @ base.pose()).translation()[:2]) < 0.3
    assert base.odom.value().child_frame_id.endswith(base.frame)


def test_a_car_turns_on_the_circle_of_its_geometry() -> None:
    base = Base("gz_ackermann_drive")
    v, w = 0.3, 0.2
    base.drive(v, w, 4.0)

    points = []
    for _ in range(60):
        base.drive(v, w, PERIOD)
        points.append(base.pose().translation()[:2])

    # The circle nearest to the points: x^2 + y^2 = 2 a x + 2 b y + c.
    path = np.array(points)
    table = np.column_stack([2.0 * path, np.ones(len(path))])
    a, b, c = np.linalg.lstsq(table, np.sum(path**2, axis=1), rcond=None)[0]
    radius = np.sqrt(c + a**2 + b**2)
    assert radius == pytest.approx(v / w, rel=0.05)
    # A good part of it was driven.
    assert np.ptp(path[:, 1]) > 1.0
