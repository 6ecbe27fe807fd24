"""True motions of bases beside their odometry."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity

import arm_drake as ad
from arm_drake.description.entry import configs_folder
from arm_drake.hardware.mobile_bases import BaseTruth, Wheel
from arm_drake.messages import Odometry, Twist, Vector3
from tests import models
from tests.carts import RADIUS, SEPARATION, cart
from tests.snippets import read_blocks

YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    base: {{type: diff_drive_controller/DiffDriveController}}
base:
  ros__parameters:
    left_wheel_names: [left]
    right_wheel_names: [right]
    wheel_separation: {SEPARATION}
    wheel_radius: {RADIUS}
"""

CONTROL = models.ros2_control("left", "right", command="velocity")

# A wheel of 0.1 m, and how it is turned: it looks along y, and leans over.
WHEEL = Wheel("j", 1, np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.1)
YAW, LEAN = np.pi / 2.0, 0.3


def slip(
    v: list[float],
    w: list[float],
    rpy: tuple[float, float, float],
    wheel: Wheel = WHEEL,
) -> np.ndarray:
    """Return the slip of a wheel with a velocity [m/s], [rad/s] in the world."""
    system = BaseTruth("base", 0, RigidTransform(), [wheel])
    context = system.CreateDefaultContext()
    poses = [RigidTransform(), RigidTransform(RollPitchYaw(*rpy), [3.0, 2.0, 0.1])]
    velocities = [SpatialVelocity.Zero(), SpatialVelocity(w, v)]
    for name, value in (("body_poses", poses), ("body_velocities", velocities)):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    return system.GetOutputPort("wheel_slip").Eval(context)


@pytest.mark.parametrize(
    ("v", "w", "rpy", "expected"),
    [
        # It rolls: forwards, and backwards, and along y.
        ([0.5, 0.0, 0.0], [0.0, 5.0, 0.0], (0.0, 0.0, 0.0), (0.0, 0.0)),
        ([-0.5, 0.0, 0.0], [0.0, -5.0, 0.0], (0.0, 1.0, 0.0), (0.0, 0.0)),
        ([0.0, 0.5, 0.0], [-5.0, 0.0, 0.0], (0.0, 0.0, YAW), (0.0, 0.0)),
        # It spins on the spot, and stands while it is pushed.
        ([0.0, 0.0, 0.0], [0.0, 5.0, 0.0], (0.0, 0.0, 0.0), (-0.5, 0.0)),
        ([0.3, 0.2, 0.0], [0.0, 0.0, 0.0], (0.0, 0.0, 0.0), (0.3, 0.2)),
        ([0.3, 0.2, 0.0], [0.0, 0.0, 0.0], (0.0, 0.0, YAW), (0.2, -0.3)),
        # It turns about its lowest point.
        ([0.0, 0.0, 0.0], [0.0, 0.0, 5.0], (0.0, 0.0, 0.0), (0.0, 0.0)),
        # It leans: the lowest point is 0.1 m sin(0.3) beside its middle.
        (
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 5.0],
            (LEAN, 0.0, 0.0),
            (-5.0 * 0.1 * np.sin(LEAN), 0.0),
        ),
    ],
)
def test_slip_is_the_velocity_of_the_lowest_point(
    v: list[float],
    w: list[float],
    rpy: tuple[float, float, float],
    expected: tuple[float, float],
) -> None:
    assert slip(v, w, rpy) == pytest.approx(expected, abs=1e-12)


def test_slip_of_rollers_is_along_the_axis_of_the_one_that_is_down() -> None:
    # Forwards and to the left: as on the right side of a mecanum base.
    wheel = WHEEL._replace(roller=(0.6, 0.8))

    pushed = slip([0.3, 0.2, 0.0], [0.0, 0.0, 0.0], (0.0, 0.0, 0.0), wheel)
    spun = slip([0.0, 0.0, 0.0], [0.0, 5.0, 0.0], (0.0, 0.0, YAW), wheel)
    rolled = slip([-0.4, 0.3, 0.0], [0.0, 0.0, 0.0], (0.0, 0.0, 0.0), wheel)

    np.testing.assert_allclose(pushed, [0.6 * 0.3 + 0.8 * 0.2, 0.0], atol=1e-12)
    # Its lowest point goes to its left.
    np.testing.assert_allclose(spun, [0.8 * 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(rolled, [0.0, 0.0], atol=1e-12)


def test_slip_stands_along_all_wheels_first_and_then_across() -> None:
    second = WHEEL._replace(body=0)
    system = BaseTruth("base", 0, RigidTransform(), [WHEEL, second])
    context = system.CreateDefaultContext()
    velocities = [SpatialVelocity(np.zeros(3), [3, 4, 0])]
    velocities.append(SpatialVelocity(np.zeros(3), [1, 2, 0]))
    for name, value in (
        ("body_poses", [RigidTransform()] * 2),
        ("body_velocities", velocities),
    ):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))

    found = system.GetOutputPort("wheel_slip").Eval(context)

    assert found == pytest.approx([1.0, 3.0, 2.0, 4.0])


def test_the_truth_starts_where_the_base_does() -> None:
    # It looks along y, and has driven 2 m along it, 0.5 m above the ground.
    start = RigidTransform(RollPitchYaw(0.0, 0.0, YAW), [4.0, 5.0, 0.0])
    system = BaseTruth("base", 0, start, [])
    context = system.CreateDefaultContext()
    context.SetTime(1.5)
    now = RigidTransform(RollPitchYaw(0.0, 0.0, YAW + 0.2), [4.0, 7.0, 0.5])
    moves = SpatialVelocity([0.0, 0.0, 0.3], now.rotation() @ [0.7, 0.1, 0.0])
    for name, value in (("body_poses", [now]), ("body_velocities", [moves])):
        system.GetInputPort(name).FixValue(context, AbstractValue.Make(value))

    truth: Odometry = system.GetOutputPort("ground_truth").Eval(context)

    where, q = truth.pose.pose.position, truth.pose.pose.orientation
    assert (where.x, where.y, where.z) == pytest.approx((2.0, 0.0, 0.5))
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0.0, 0.0, np.sin(0.1), np.cos(0.1)))
    v, w = truth.twist.twist.linear, truth.twist.twist.angular
    assert (v.x, v.y, v.z) == pytest.approx((0.7, 0.1, 0.0))
    assert (w.x, w.y, w.z) == pytest.approx((0.0, 0.0, 0.3))
    assert truth.header.stamp.to_seconds() == 1.5
    assert (truth.header.frame_id, truth.child_frame_id) == ("odom", "base")


@pytest.mark.slow
def test_odometry_of_slipping_wheels_is_wrong_by_their_slip(tmp_path: Path) -> None:
    smooth = "".join(
        f'<gazebo reference="{link}"><mu1>{mu}</mu1></gazebo>'
        for link, mu in (("left_wheel", 0.05), ("right_wheel", 0.05), ("caster", 0.0))
    )
    robot = models.load(tmp_path, cart(CONTROL, smooth), YAML)
    sim = ad.Simulation(ad.build_diagram(robot))

    for _ in range(5):
        sim.controller("base").send_velocity(Twist(Vector3(x=1.0), Vector3()))
        sim.run(0.1)

    context = sim.simulator.get_context()
    found = sim.diagram.GetOutputPort("base.wheel_slip").Eval(context)
    truth = sim.diagram.GetOutputPort("base.ground_truth").Eval(context)
    joints = sim.diagram.GetOutputPort("joint_states").Eval(context)
    v = truth.twist.twist.linear.x
    # Friction gives 0.05 g at most, for 0.5 s, but for what the caster carries.
    assert 0.04 * 9.81 * 0.5 < v < 0.05 * 9.81 * 0.5
    assert joints[2:4] * RADIUS == pytest.approx([1.0, 1.0], abs=0.01)
    # The base is as fast as its wheels' rims and their slip together.
    true = joints[2:4] * RADIUS + found[:2]
    assert true.mean() == pytest.approx(v, abs=1e-6)
    assert found[:2].max() < -0.5


def test_several_robots_have_truths_of_their_own(tmp_path: Path) -> None:
    robots = [
        models.load(tmp_path, cart(CONTROL), YAML, name=name, pose=(0, y, 0, 0, 0, 0))
        for name, y in (("one", 0.0), ("two", 2.0))
    ]

    diagram = ad.build_diagram(robots)

    context = diagram.CreateDefaultContext()
    for name in ("one", "two"):
        slip_port = diagram.GetOutputPort(f"{name}/base.wheel_slip")
        assert slip_port.Eval(context) == pytest.approx(np.zeros(4))
        truth = diagram.GetOutputPort(f"{name}/base.ground_truth").Eval(context)
        assert truth.pose.pose.position.y == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["diff_drive", "bicycle"])
def test_bases_to_begin_with_go_where_their_geometry_says(kind: str) -> None:
    folder = configs_folder() / "wheeled_base"
    yaml = folder / f"{kind}_controllers.yaml"
    robot = ad.load_robot(folder / f"{kind}.urdf", controllers=yaml)
    # At the default step the program of the page has them.
    options = ad.SimulationOptions(time_step=5e-3)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))

    sim.run(6.0, folder / "drive.yaml")

    assert not len(robot.report)
    # 2 s straight on, then 3 s of a circle.
    speed, turn, curve = 0.4, 0.5, 3.0
    angle, radius = turn * curve, speed / turn
    x, y = speed * 2.0 + radius * math.sin(angle), radius * (1.0 - math.cos(angle))
    truth = sim.diagram.GetOutputPort("base.ground_truth").Eval(sim.context)
    place = truth.pose.pose.position
    # It speeds up and slows down, and the steered wheel takes its time to turn.
    assert (place.x, place.y) == pytest.approx((x, y), abs=0.04)
    assert place.z == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_the_program_of_bases_md_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = configs_folder().parent / "docs/bases.md"
    (block,) = [b for b in read_blocks(page) if b.language == "python"]
    monkeypatch.chdir(configs_folder().parent)

    exec(block.text, {})  # noqa: S102  our own text.

    assert capsys.readouterr().out.count("Point(x=1.5") == 2
