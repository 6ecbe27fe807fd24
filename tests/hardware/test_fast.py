"""The preset fast: what it claims, and what it leaves to the preset accurate."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    CoulombFriction,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.worlds.world import World, add_world
from tests import models
from tests.servo_rig import ServoRig

W0 = ad.SimulationOptions().servo_bandwidth
STEPS = [2e-3, 1e-2]
RATE = 100

YAML = models.trajectory_controllers({"arm": ["shoulder", "elbow"]})
SWING = models.trajectory_controllers({"arm": ["swing"]})


def simulate(robot: ad.Robot, preset: str = "fast", **options: Any) -> ad.Simulation:
    settings = ad.SimulationOptions(preset=preset, **options)
    return ad.Simulation(ad.build_diagram(robot, options=settings))


def goal(joints: tuple[str, ...], *points: tuple[float, ...]) -> ad.JointTrajectory:
    """Return a motion through points, a second for each, that ends at rest."""
    still = (0.0,) * len(joints)
    rows = [
        ad.JointTrajectoryPoint(point, still, time_from_start=float(k))
        for k, point in enumerate(points, start=1)
    ]
    return ad.JointTrajectory(joint_names=joints, points=tuple(rows))


def plant_of(sim: ad.Simulation) -> MultibodyPlant:
    plant = sim.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant


def obstacles_of(sim: ad.Simulation) -> list[str]:
    return [entry.what for entry in sim.report if entry.what.startswith("fast: ")]


@pytest.mark.parametrize(("rate", "step"), [(100, 1e-2), (500, 2e-3), (30, 1e-2 / 1.2)])
def test_a_step_is_as_long_as_the_controllers_period_but_10_ms_at_most(
    tmp_path: Path, rate: int, step: float
) -> None:
    yaml = models.trajectory_controllers({"arm": ["swing"]}, update_rate=rate)

    sim = simulate(models.load(tmp_path, models.pendulum(), yaml))

    assert plant_of(sim).time_step() == pytest.approx(step, rel=1e-9)
    assert not obstacles_of(sim)
    assert not any(entry.where == "time_step" for entry in sim.report)


@pytest.mark.slow
def test_it_says_what_it_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reported = {p: ad.SimulationOptions(preset=p).leaves_out for p in PRESETS}
    assert reported["accurate"] == ""
    assert reported["fast"].startswith("no contact: links pass through everything")

    # A preset that is asked for is nothing that was misread.
    arguments = ["sim", "doosan_a0912", "--headless", "--duration", "0.05", "--strict"]
    assert main([*arguments, "--preset", "fast"]) == 0

    assert f"preset fast: {reported['fast']}\n" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
def test_friction_and_damping_change_efforts_and_not_the_motion(
    tmp_path: Path, h: float
) -> None:
    """With friction f and damping D the effort is D v + f more, while it moves."""
    control = models.ros2_control("swing")
    flat = models.pendulum(control=control).replace('axis="0 1 0"', 'axis="0 0 1"')
    rough = models.pendulum(
        dynamics='<dynamics damping="3" friction="2"/>', control=control
    ).replace('axis="0 1 0"', 'axis="0 0 1"')
    assert rough != flat
    rows = []
    for name, urdf in (("flat", flat), ("rough", rough)):
        folder = tmp_path / name
        folder.mkdir()
        sim = simulate(models.load(folder, urdf, SWING), time_step=h)
        assert not obstacles_of(sim)
        sim.controller("arm").send_goal(goal(("swing",), (1.0,)))
        sim.advance_to(1.5)
        rows.append(sim.rollout())
    smooth, rough_rows = rows

    np.testing.assert_allclose(rough_rows.position, smooth.position, atol=1e-9)
    more = (rough_rows.effort - smooth.effort)[:, 0]
    is_moving = (smooth.time > 0.2) & (smooth.time < 0.8)
    # What is applied in a step belongs to the speed at its end.
    speed = np.roll(smooth.velocity[:, 0], -1)
    every = round(0.01 / h)
    if every == 1:
        expected = 3.0 * speed + 2.0
        np.testing.assert_allclose(more[is_moving], expected[is_moving], atol=1e-6)
    else:  # Several steps later, while it accelerates by 6 rad/s^2 at most.
        np.testing.assert_allclose(
            more[is_moving],
            3.0 * smooth.velocity[is_moving, 0] + 2.0,
            atol=3.0 * 6.0 * h * 1.01,
        )


@pytest.mark.parametrize("h", STEPS)
def test_limits_of_effort_and_speed_hold_in_a_step_over_the_whole_range(
    tmp_path: Path, h: float
) -> None:
    limit = 'lower="-3" upper="3" effort="15" velocity="1"'
    rig = ServoRig(
        models.load(tmp_path, models.pendulum(limit=limit)), step=h, preset="fast"
    )
    rig.command([2.0])

    motion = rig.run(4.0)

    assert np.abs(motion.effort).max() <= 15.0
    assert np.abs(motion.velocity).max() <= 1.0 + 1e-3
    assert motion.velocity.max() > 0.95
    assert motion.position[-1, 0] == pytest.approx(2.0, abs=1e-9)
    assert motion.position.max() < 2.0 + 1e-3


def test_a_joint_that_is_too_weak_has_its_limit_and_no_more(tmp_path: Path) -> None:
    # Horizontal, 4.905 N·m of gravity: the joint has 4 N·m.
    limit = 'lower="-3" upper="3" effort="4" velocity="10"'
    robot = models.load(
        tmp_path, models.pendulum(limit=limit), initial_positions={"swing": math.pi / 2}
    )
    rig = ServoRig(robot, step=1e-2, preset="fast")

    motion = rig.run(3.0)

    assert np.isfinite(motion.position).all()
    assert np.abs(motion.effort).max() == 4.0
    assert motion.effort[0, 0] == 4.0
    assert motion.position.min() < math.pi / 2 - 0.1


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
def test_a_joint_that_is_sent_beyond_its_stop_rests_there(
    tmp_path: Path, h: float
) -> None:
    robot = models.load(tmp_path, models.pendulum(), SWING)
    sim = simulate(robot, time_step=h)
    sim.controller("arm").send_goal(goal(("swing",), (3.5,)))
    sim.advance_to(4.0)

    position = sim.rollout().position[:, 0]

    assert position.max() <= 3.0 + 1e-3
    assert position[-1] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.slow
def test_the_work_of_the_drive_is_the_energy_that_is_gained(tmp_path: Path) -> None:
    """Lifted from rest to rest in a second; what steps lose or gain is of first order.

    In a step h the drive's work is effort times h v[+], with the speed at its end:
    sum(M u h v[+]) over a motion is M/2 h sum(h u^2), and gravity's part is a sum in
    the place of an integral, off by h/2 times sum(h g' v^2) at most.
    """
    lifted, missing = 1.5, []
    for rate in (100, 200, 400):
        yaml = models.trajectory_controllers({"arm": ["swing"]}, update_rate=rate)
        sim = simulate(models.load(tmp_path, models.pendulum(), yaml))
        sim.controller("arm").send_goal(goal(("swing",), (lifted,)))
        sim.advance_to(2.0)
        rollout = sim.rollout()
        work = rollout.effort[:-1, 0] @ np.diff(rollout.position[:, 0])
        weight = models.MASS * models.GRAVITY * models.LENGTH
        missing.append(work - weight * (1.0 - math.cos(lifted)))

    # A cubic of 1 s: its mean squares of acceleration and of speed are 12 and 1.2 times
    # the square of the way.
    squares = lifted**2 * np.array([12.0, 1.2])
    most = 1e-2 / 2.0 * (models.INERTIA * squares[0] + weight * squares[1])
    assert 0.0 < abs(missing[0]) < most
    ratios = np.array(missing[1:]) / np.array(missing[:-1])
    np.testing.assert_allclose(ratios, 0.5, atol=0.05)


def test_a_push_leaves_the_error_that_the_gain_says(tmp_path: Path) -> None:
    """Without an observer a torque T leaves T / (kp M)."""
    torque, h = 2.0, 1e-2
    robot = models.load(tmp_path, models.pendulum(), SWING)
    sim = simulate(robot)
    push = ExternallyAppliedSpatialForce()
    push.body_index = plant_of(sim).GetBodyByName("bob").index()
    push.F_Bq_W = SpatialForce(tau=[0.0, torque, 0.0], f=np.zeros(3))
    port = sim.diagram.GetInputPort("applied_spatial_force")
    port.FixValue(sim.simulator.get_mutable_context(), [push])

    sim.advance_to(2.0)

    z = math.exp(-W0 * h)
    error = torque / ((1.0 - z) ** 2 / h**2 * models.INERTIA)
    assert sim.rollout().position[-1, 0] == pytest.approx(error, rel=1e-6)


def test_it_saves_and_goes_on_bit_by_bit(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.TWO_LINKS, YAML)
    whole, sim = simulate(robot), simulate(robot)
    for other in (whole, sim):
        other.controller("arm").send_goal(goal(("shoulder", "elbow"), (1.0, -1.0)))
    whole.advance_to(1.0)
    sim.advance_to(0.435)
    saved = sim.simulator.get_context().Clone()
    sim.advance_to(0.8)

    sim.simulator.reset_context(saved)
    sim.simulator.Initialize()
    sim.advance_to(1.0)

    np.testing.assert_array_equal(
        sim.joint_states().position, whole.joint_states().position
    )


@pytest.mark.slow
def test_links_pass_through_the_ground(tmp_path: Path) -> None:
    """The joint's origin is 1 m above it, and the ball is sent to -0.5 m."""
    lift = models.LIFT.replace(
        models.bob("load", "0 0 0"), models.bob("load", "0 0 0", models.sphere(0.1))
    )
    yaml = models.trajectory_controllers({"arm": ["slide"]})
    robot = models.load(tmp_path, lift, yaml, pose=(0, 0, 0.3, 0, 0, 0))
    positions = {}
    for preset in ("accurate", "fast"):
        sim = simulate(robot, preset)
        sim.controller("arm").send_goal(goal(("slide",), (-0.5,)))
        sim.advance_to(3.0)
        positions[preset] = sim.rollout().position[-1, 0]

    assert positions["fast"] == pytest.approx(-0.5, abs=1e-9)
    assert positions["accurate"] == pytest.approx(-0.2, abs=1e-2)


VELOCITIES = """
controller_manager:
  ros__parameters:
    update_rate: 100
    wheels: {type: velocity_controllers/JointGroupVelocityController}
wheels: {ros__parameters: {joints: [swing]}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("urdf", "yaml", "options", "obstacle"),
    [
        (models.GRIPPER, "", {}, "joints are coupled by mimic"),
        (models.PARTLY_COMMANDED, "", {}, "nothing drives 'second'"),
        (
            models.pendulum(control=models.ros2_control("swing", command="velocity")),
            VELOCITIES,
            {},
            "controllers command velocity",
        ),
        (
            models.pendulum(limit='lower="-3" upper="3" effort="4" velocity="10"'),
            "",
            {},
            "effort limits don't bear its weight and friction",
        ),
        (models.pendulum(), "", {"self_collision": True}, "self_collision is contact"),
        (
            models.pendulum(),
            "",
            {"gravity_compensation": False},
            "weight that the drives don't know needs their observer",
        ),
        (
            models.pendulum(dynamics='<dynamics friction="1"/>'),
            "",
            {"friction_compensation": False},
            "friction that the drives don't know needs their observer",
        ),
    ],
)
def test_what_it_lacks_is_said_and_simulated_with_accurate(
    tmp_path: Path, urdf: str, yaml: str, options: dict[str, Any], obstacle: str
) -> None:
    robot = models.load(tmp_path, urdf, yaml or None)

    sims = {preset: simulate(robot, preset, **options) for preset in PRESETS}
    for sim in sims.values():
        sim.advance_to(0.3)

    assert obstacles_of(sims["fast"]) == [f"fast: {obstacle}"]
    assert obstacles_of(sims["accurate"]) == []
    assert plant_of(sims["fast"]).time_step() == pytest.approx(1e-3)
    fast, accurate = (sims[preset].rollout() for preset in PRESETS)
    np.testing.assert_array_equal(fast.position, accurate.position)
    np.testing.assert_array_equal(fast.effort, accurate.effort)


PRESETS = ("fast", "accurate")


@pytest.mark.slow
def test_a_robot_that_needs_more_takes_the_others_with_it(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    arm = models.load(tmp_path / "a", models.pendulum(), SWING, name="arm")
    gripper = models.load(tmp_path / "b", models.GRIPPER, name="gripper")
    options = ad.SimulationOptions(preset="fast")
    sim = ad.Simulation(ad.build_diagram([arm, gripper], options=options))

    reported = {
        name: [e.what for e in manager.report if e.where == "preset"]
        for name, manager in sim.directory.managers.items()
    }

    assert reported == {
        "arm": ["fast: another robot needs more"],
        "gripper": ["fast: joints are coupled by mimic"],
    }


@pytest.mark.slow
@pytest.mark.parametrize("rates", [(250, 333), (333, 100), (97, 101), (30, 125)])
def test_several_robots_tick_at_their_own_rates(
    tmp_path: Path, rates: tuple[int, int]
) -> None:
    robots = []
    for rate in rates:
        folder = tmp_path / str(rate)
        folder.mkdir()
        yaml = models.trajectory_controllers({"arm": ["swing"]}, update_rate=rate)
        robots.append(models.load(folder, models.pendulum(), yaml, name=f"r{rate}"))
    periods = {}
    for preset in PRESETS:
        options = ad.SimulationOptions(preset=preset)
        sim = ad.Simulation(ad.build_diagram(robots, options=options))
        managers = sim.directory.managers.values()
        periods[preset] = [manager.period for manager in managers]

    for fast, accurate in zip(*periods.values(), strict=True):
        assert fast == pytest.approx(accurate, rel=1e-9)


def add_wall(plant: MultibodyPlant) -> None:
    add_world(plant, "empty")
    place, friction = RigidTransform([1.0, 0.0, 0.0]), CoulombFriction(1.0, 1.0)
    shape, body = Box(0.1, 1.0, 1.0), plant.world_body()
    plant.RegisterCollisionGeometry(body, place, shape, "wall", friction)


def add_picture(plant: MultibodyPlant) -> None:
    add_world(plant, "empty")
    place, color = RigidTransform(), np.ones(4)
    plant.RegisterVisualGeometry(
        plant.world_body(), place, Box(1.0, 1.0, 1.0), "picture", color
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "is_there"),
    [
        ("empty", False),
        ("void", False),
        (add_picture, False),
        ("house", True),
        (add_wall, True),
    ],
)
def test_things_in_a_world_can_be_touched(
    tmp_path: Path, world: World, is_there: bool
) -> None:
    robot = models.load(tmp_path, models.pendulum(), SWING)
    options = ad.SimulationOptions(preset="fast")

    diagram = ad.build_diagram(robot, world=world, options=options)

    reported = ["fast: the world has things that can be touched"] if is_there else []
    assert obstacles_of(ad.Simulation(diagram)) == reported


@pytest.mark.parametrize(
    ("effort", "gravity", "is_strong"),
    [(6.0, None, True), (6.0, (0.0, 0.0, -20.0), False), (3.0, False, True)],
)
def test_whether_a_robot_bears_its_weight_is_asked_of_the_gravity_there(
    tmp_path: Path, effort: float, gravity: Any, is_strong: bool
) -> None:
    """Level, the bob's weight of 9.81 m/s^2 takes 4.9 N·m."""
    limit = f'lower="-3" upper="3" effort="{effort}" velocity="10"'
    sim = simulate(models.load(tmp_path, models.pendulum(limit=limit)), gravity=gravity)

    reported = (
        [] if is_strong else ["fast: effort limits don't bear its weight and friction"]
    )
    assert obstacles_of(sim) == reported


@pytest.mark.slow
@pytest.mark.parametrize("name", ["doosan_a0912", "lab5_arm"])
def test_bundled_arms_end_where_the_accurate_ones_do(name: str) -> None:
    robot = ad.load_robot(name)
    names = tuple(joint.name for joint in robot.description.movable_joints)
    controller = next(
        c.name for c in robot.controllers.controllers if "trajectory" in c.type.lower()
    )
    rollouts = []
    for preset in PRESETS:
        sim = simulate(robot, preset)
        sent = sim.controller(controller).send_goal(goal(names, (0.4,) * len(names)))
        sim.advance_to(2.0)
        assert sent.status is ad.GoalStatus.SUCCEEDED
        assert not obstacles_of(sim)
        rollouts.append(sim.rollout())
    fast, accurate = rollouts

    # Up to half a step of the accurate one, at 0.6 rad/s, of which a fifth is left.
    np.testing.assert_allclose(
        fast.position, accurate.position, rtol=0.0, atol=0.2 * 0.6 * 0.5e-3
    )
    np.testing.assert_allclose(fast.position[-1], accurate.position[-1], atol=1e-9)
