"""The servo moves, holds and brakes as its equations say, in Drake's physics."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    LogVectorOutput,
    TrajectorySource,
    VectorLogSink,
)
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.hardware.drives import commanded_joints, effort_limits, make_robot_drive
from arm_drake.hardware.hardware import add_hardware, connect_forces
from arm_drake.plant.joint_dynamics import sample_dynamics, sample_gravity
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    set_initial_positions,
)
from tests import models

W0 = ad.SimulationOptions().servo_bandwidth
STEPS = [1e-3, 2e-3, 5e-3, 1e-2]

# (1 + w0 t) exp(-w0 t) has fallen to 2 % then.
SETTLING_TIME = 5.834 / W0


class Motion(NamedTuple):
    """What a run logs at every step of the plant."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    friction: np.ndarray | None


def run(
    folder: Path,
    urdf: str,
    duration: float,
    *,
    target: Sequence[float] | PiecewisePolynomial | None = None,
    step: float = 1e-3,
    payload: tuple[str, float] | None = None,
    initial: dict[str, float] | None = None,
    **options: Any,
) -> Motion:
    """Run a robot whose commanded joints get a command at once, without controllers.

    Args:
        folder: Where to write the robot.
        urdf: The robot.
        duration: How long [s].
        target: Command of the commanded joints; None holds the initial positions.
        step: Step of the plant [s].
        payload: A link, and a mass [kg] at its centre that the servo knows nothing of.
        initial: Initial positions.
        options: Fields of SimulationOptions.
    """
    robot = models.load(folder, urdf, initial_positions=initial)
    settings = ad.SimulationOptions(time_step=step, **options)
    builder = DiagramBuilder()
    plant, _ = add_plant(builder, step, settings)
    model = add_robot_model(plant, robot.description, "robot", None)
    joints = commanded_joints(robot.description)
    add_actuators(plant, model, [j.name for j in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    if payload is not None:
        add_payload(plant, *payload)
    plant.Finalize()
    hardware = add_hardware(
        builder,
        plant,
        model,
        robot.description,
        prefix="",
        drive=make_robot_drive(robot.description, None, settings, step),
        initial=robot.initial_positions,
        options=settings,
    )
    if hardware.friction is not None:
        connect_forces(builder, plant, {model: hardware.friction})
    if hardware.command is not None:
        held = [robot.initial_positions[joint.name] for joint in joints]
        source = (
            TrajectorySource(target, 1)
            if isinstance(target, PiecewisePolynomial)
            else ConstantVectorSource(
                [*(held if target is None else target)] + [0.0] * len(joints)
            )
        )
        builder.AddSystem(source)
        builder.Connect(source.get_output_port(), hardware.command)
    log = LogVectorOutput(hardware.joint_states, builder, step)
    friction_log = None
    if hardware.friction is not None:
        friction_log = LogVectorOutput(hardware.friction, builder, step)
    return simulate(builder.Build(), log, friction_log, duration)


def add_payload(plant: MultibodyPlant, link: str, mass: float) -> None:
    center = np.array([0.0, 0.0, -models.LENGTH])
    inertia = SpatialInertia(
        mass, center, UnitInertia.SolidSphere(0.01).ShiftFromCenterOfMass(center)
    )
    instance = plant.AddModelInstance("payload")
    body = plant.AddRigidBody("payload", instance, inertia)
    plant.WeldFrames(plant.GetFrameByName(link), body.body_frame())


def simulate(
    diagram: Diagram,
    log: VectorLogSink,
    friction_log: VectorLogSink | None,
    duration: float,
) -> Motion:
    simulator = Simulator(diagram)
    simulator.AdvanceTo(duration)
    context = simulator.get_context()
    logged = log.FindLog(context)
    position, velocity, effort = np.split(logged.data().T, 3, axis=1)
    friction = None
    if friction_log is not None:
        friction = friction_log.FindLog(context).data().T
    return Motion(logged.sample_times(), position, velocity, effort, friction)


def step_response(time: np.ndarray, h: float) -> np.ndarray:
    """Return the error of a unit step from rest: two poles at z, one zero.

    The first step moves by h^2 kp = (1 - z)^2, so e[k] = z^k (1 + k (1 - z)).
    """
    z, k = math.exp(-W0 * h), np.round(time / h)
    return z**k * (1.0 + k * (1.0 - z))


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    ("urdf", "start", "joint"),
    [
        (models.pendulum(dynamics='<dynamics damping="0.7"/>'), {"swing": 1.0}, 0),
        (models.TWO_LINKS, {"shoulder": 0.5, "elbow": 1.2}, 0),
        (models.TWO_LINKS, {"shoulder": 0.5, "elbow": 1.2}, 1),
        (models.LIFT, {"slide": 0.1}, 0),
    ],
    ids=["pendulum", "shoulder", "elbow", "lift"],
)
def test_a_position_step_settles_as_the_poles_say(
    tmp_path: Path, urdf: str, start: dict[str, float], joint: int, h: float
) -> None:
    size = 1e-2
    before = np.array(list(start.values()))
    target = before.copy()
    target[joint] += size

    motion = run(tmp_path, urdf, 0.5, target=target, step=h, initial=start)

    error = (target - motion.position) / size
    # The servo's dynamics are exactly those of Drake's step: rounding errors remain.
    np.testing.assert_allclose(
        error[:, joint], step_response(motion.time, h), atol=1e-9
    )
    others = np.delete(error, joint, axis=1)
    np.testing.assert_allclose(others, np.zeros_like(others), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("joint", [0, 1])
def test_a_step_settles_in_time_without_overshoot_or_moving_others(
    tmp_path: Path, joint: int, h: float
) -> None:
    target = np.zeros(2)
    target[joint] = 1e-2

    motion = run(tmp_path, models.TWO_LINKS, 0.5, target=target, step=h)

    error = (target - motion.position) / 1e-2
    is_outside = np.abs(error[:, joint]) > 0.02
    settled = motion.time[is_outside][-1] + h
    # The sampled response differs from the continuous one by less than a step.
    assert settled == pytest.approx(SETTLING_TIME, abs=1.5 * h)
    assert error[:, joint].min() > -1e-3
    assert np.abs(error[:, 1 - joint]).max() < 1e-2


def test_the_bandwidth_option_sets_how_fast_a_step_settles(tmp_path: Path) -> None:
    motion = run(
        tmp_path, models.pendulum(), 0.5, target=[1e-2], servo_bandwidth=W0 / 2
    )

    settled = motion.time[np.abs(1e-2 - motion.position[:, 0]) > 2e-4][-1]
    assert settled == pytest.approx(2 * SETTLING_TIME, abs=2e-3)


@pytest.mark.parametrize("h", STEPS)
def test_a_ramp_is_followed_without_lag(tmp_path: Path, h: float) -> None:
    speed = 0.5
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 2.0], [[0.0, 2.0 * speed]])

    motion = run(tmp_path, models.pendulum(), 1.0, target=ramp, step=h)

    # Sampling leaves a lag of v_d (kd / kp - 2 / w0): w0^2 h^2 / 12 of 2 / w0. Without
    # the desired velocity it would be 2 / w0 itself.
    z = math.exp(-W0 * h)
    lag = speed * (h * (1.0 + z) / (1.0 - z) - 2.0 / W0)
    at_end = speed * motion.time[-1] - motion.position[-1, 0]
    assert at_end == pytest.approx(lag, abs=1e-9)


@pytest.mark.slow
def test_a_large_step_respects_velocity_and_effort_limits(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="15" velocity="1"'

    motion = run(tmp_path, models.pendulum(limit=limit), 4.0, target=[2.0])

    # On the way kp max_error = kd v, so v = v_max tanh(w0 h / 2) / (w0 h / 2).
    assert motion.velocity.max() == pytest.approx(1.0, rel=1e-3)
    assert np.abs(motion.effort).max() <= 15.0
    assert motion.position[-1, 0] == pytest.approx(2.0, abs=1e-6)
    assert motion.position.max() < 2.0 + 1e-3


@pytest.mark.slow
def test_effort_is_that_of_gravity_at_rest_and_of_the_limit_when_overloaded(
    tmp_path: Path,
) -> None:
    # Horizontal, 4.905 N·m of gravity: the joint has 4 N·m.
    limit = 'lower="-3" upper="3" effort="4" velocity="10"'
    weak = run(
        tmp_path, models.pendulum(limit=limit), 3.0, initial={"swing": math.pi / 2}
    )
    strong = run(tmp_path, models.pendulum(), 3.0, initial={"swing": math.pi / 2})

    weight = models.MASS * models.GRAVITY * models.LENGTH
    np.testing.assert_allclose(strong.effort, weight, rtol=1e-9)
    assert np.all(np.isfinite(weak.position))
    assert np.abs(weak.effort).max() == 4.0
    assert weak.effort[0, 0] == 4.0
    assert weak.position.min() < math.pi / 2 - 0.1
    assert np.abs(weak.velocity).max() < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    "dynamics",
    ["", '<dynamics damping="2"/>', '<dynamics damping="2" friction="1"/>'],
    ids=["free", "damped", "damped with friction"],
)
def test_gravity_is_held_without_sag(tmp_path: Path, dynamics: str, h: float) -> None:
    urdf = models.pendulum(dynamics=dynamics)

    motion = run(tmp_path, urdf, 1.0, step=h, initial={"swing": 1.0})

    np.testing.assert_allclose(motion.position, 1.0, atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 1.0, -1.0])
def test_acceleration_is_limited_by_what_gravity_leaves(
    tmp_path: Path, start: float
) -> None:
    limit = 'lower="-3" upper="3" effort="20" velocity="0"'

    motion = run(
        tmp_path,
        models.pendulum(limit=limit),
        0.1,
        target=[2.0],
        initial={"swing": start},
    )

    # The first step speeds up by h (effort - m g l sin q) / M.
    gravity = models.MASS * models.GRAVITY * models.LENGTH * math.sin(start)
    expected = 1e-3 * (20.0 - gravity) / models.INERTIA
    assert motion.velocity[1, 0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("h", STEPS)
def test_where_one_joint_is_too_weak_the_other_waits_for_it(
    tmp_path: Path, h: float
) -> None:
    # The elbow weighs up to 4.9 N·m; thrown about, it needs much more than 6.
    urdf = models.TWO_LINKS.replace('effort="100"', 'effort="6"')
    urdf = urdf.replace('effort="6"', 'effort="100"', 1)

    motion = run(tmp_path, urdf, 2.0, target=[1.5, -1.5], step=h)

    assert np.abs(motion.effort[:, 1]).max() == pytest.approx(6.0)
    # None runs away, and both arrive.
    assert np.abs(motion.velocity).max() <= 10.0
    np.testing.assert_allclose(motion.position[-1], [1.5, -1.5], atol=1e-6)
    assert motion.position[:, 0].max() <= 1.5 + 1e-3
    assert motion.position[:, 1].min() >= -1.5 - 1e-3


@pytest.mark.parametrize("h", STEPS)
def test_a_joint_brakes_in_time(tmp_path: Path, h: float) -> None:
    # From its speed of 10 rad/s 20 N·m stop it within 0.9 rad; the straight law would
    # brake in the last 0.5 rad only.
    limit = 'lower="-3" upper="3" effort="20" velocity="10"'

    motion = run(tmp_path, models.pendulum(limit=limit), 2.0, target=[2.9], step=h)

    assert motion.position.max() <= 2.9 + 1e-6
    assert motion.position[-1, 0] == pytest.approx(2.9, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
def test_what_pushes_into_a_stop_is_forgotten_when_it_stops(
    tmp_path: Path, h: float
) -> None:
    limit = 'lower="-3" upper="0.5" effort="100" velocity="10"'
    target = PiecewisePolynomial.ZeroOrderHold([0.0, 3.0, 4.0], [[0.51, 0.49, 0.49]])

    motion = run(tmp_path, models.pendulum(limit=limit), 3.5, target=target, step=h)

    # A step of 20 mrad from rest, no matter how long it pushed before.
    is_late = motion.time > 3.0 + SETTLING_TIME + 2.0 * h
    np.testing.assert_allclose(motion.position[is_late], 0.49, atol=0.02 * 0.02)


@pytest.mark.slow
def test_without_gravity_compensation_the_observer_finds_out_the_weight(
    tmp_path: Path,
) -> None:
    start = {"swing": 1.0}

    motion = run(
        tmp_path,
        models.pendulum(),
        2.0,
        initial=start,
        gravity_compensation=False,
    )

    assert np.abs(motion.position - 1.0).max() > 1e-4
    assert motion.position[-1, 0] == pytest.approx(1.0, abs=1e-9)


def test_without_an_observer_either_the_weight_leaves_an_error(tmp_path: Path) -> None:
    motion = run(
        tmp_path,
        models.pendulum(),
        2.0,
        initial={"swing": 1.0},
        gravity_compensation=False,
        disturbance_observer=False,
    )

    # kp M (q_d - q) = m g l sin q
    q = motion.position[-1, 0]
    kp = ((1.0 - math.exp(-W0 * 1e-3)) / 1e-3) ** 2
    weight = models.MASS * models.GRAVITY * models.LENGTH
    balance = weight * math.sin(q) / (kp * models.INERTIA)
    assert 1.0 - q == pytest.approx(balance, rel=1e-6)


@pytest.mark.parametrize("is_known", [True, False])
def test_dry_friction_is_made_up_for_if_it_is_known(
    tmp_path: Path, is_known: bool
) -> None:
    urdf = models.pendulum(dynamics='<dynamics friction="2"/>')

    motion = run(tmp_path, urdf, 0.5, target=[1e-2], friction_compensation=is_known)

    error = (1e-2 - motion.position[:, 0]) / 1e-2
    off = np.abs(error - step_response(motion.time, 1e-3)).max()
    assert bool(off < 1e-9) == is_known
    # Its drive bears it: 2 N·m against the motion.
    moving = (motion.velocity[:, 0] > 0.05) & (motion.time < 0.05)
    assert motion.friction is not None
    np.testing.assert_allclose(motion.friction[moving], -2.0, rtol=1e-6)


def test_a_light_joint_s_rotor_is_in_the_dynamics_and_can_be_left_out(
    tmp_path: Path,
) -> None:
    tip = (
        '<link name="tip"><inertial><mass value="0.01"/>'
        '<inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/>'
        "</inertial></link>"
    )
    wrist = models.joint("wrist", "bob", "tip", xyz=f"0 0 {-models.LENGTH}")
    urdf = models.pendulum(control=models.ros2_control("swing", "wrist"))
    urdf = urdf.replace("</robot>", f"{tip}{wrist}</robot>")

    # What lifts twice the robot at arm's length gives it 1000 rad/s^2.
    strength = 2.0 * models.GRAVITY * (models.MASS + 0.01) * models.LENGTH
    rotor = strength / 1000.0
    for option, step, expected in (
        (True, 1e-3, rotor),
        (False, 1e-2, 1e-6),
        (None, 1e-3, 1e-6),
        (None, 1e-2, rotor),
    ):
        robot = models.load(tmp_path, urdf)
        options = ad.SimulationOptions(reflected_inertia=option, time_step=step)
        diagram = ad.build_diagram(robot, options=options)
        plant = diagram.GetSubsystemByName("plant")
        at = plant.GetJointByName("wrist").velocity_start()
        M = plant.CalcMassMatrix(plant.CreateDefaultContext())
        assert M[at, at] == pytest.approx(expected, rel=1e-9)
        lines = [e for e in ad.Simulation(diagram).report if "rotors" in e.done]
        assert len(lines) == 1


@pytest.mark.slow
def test_the_observer_does_not_wind_up_while_the_effort_is_at_its_limit(
    tmp_path: Path,
) -> None:
    # 4 N·m can't hold the bob at a right angle; after 3 s it is to hang.
    limit = 'lower="-3" upper="3" effort="4" velocity="10"'
    target = PiecewisePolynomial.ZeroOrderHold(
        [0.0, 3.0, 4.0], [[math.pi / 2, 0.0, 0.0]]
    )

    motion = run(
        tmp_path,
        models.pendulum(limit=limit, dynamics='<dynamics damping="2"/>'),
        4.0,
        target=target,
        initial={"swing": math.pi / 2},
    )

    # The observer adds at most 2 effort / M, and unlearns 0.2 of the largest
    # acceleration, 0.1 effort / M, per step: 100 steps.
    is_lifting = motion.effort[:, 0] == 4.0
    assert is_lifting[(motion.time > 2.5) & (motion.time < 3.0)].all()
    assert not is_lifting[motion.time > 3.0 + 0.1 + 0.01].any()


def test_a_continuous_joint_settles(tmp_path: Path) -> None:
    urdf = models.pendulum().replace('type="revolute"', 'type="continuous"')

    motion = run(tmp_path, urdf, 1.0, target=[4.0])

    assert motion.position[-1, 0] == pytest.approx(4.0, abs=1e-6)


def test_effort_without_gravity_is_zero(tmp_path: Path) -> None:
    motion = run(
        tmp_path, models.pendulum(), 0.1, initial={"swing": 1.0}, gravity=False
    )

    np.testing.assert_array_equal(motion.effort, 0.0)
    np.testing.assert_array_equal(motion.position, 1.0)


@pytest.mark.parametrize("h", STEPS)
def test_an_unknown_payload_is_lifted_back(tmp_path: Path, h: float) -> None:
    # Half the mass again at the bob, horizontal.
    motion = run(
        tmp_path,
        models.pendulum(),
        2.0,
        step=h,
        payload=("bob", 0.5),
        initial={"swing": math.pi / 2},
    )

    weight = 1.5 * models.GRAVITY * models.LENGTH
    # Without the observer it would hang lower by 0.5 g l / (M w0^2) = 6 mrad.
    assert motion.position[-1, 0] == pytest.approx(math.pi / 2, abs=1e-9)
    assert motion.effort[-1, 0] == pytest.approx(weight, rel=1e-6)


def test_dry_friction_does_not_keep_the_servo_from_its_target(tmp_path: Path) -> None:
    urdf = models.pendulum(dynamics='<dynamics friction="2"/>')

    motion = run(tmp_path, urdf, 2.0, target=[0.5])

    # PD alone would stop 2 N·m / (M w0^2) = 5 mrad before it.
    assert motion.position[-1, 0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("h", STEPS)
def test_a_mimic_joint_follows_its_master(tmp_path: Path, h: float) -> None:
    motion = run(tmp_path, models.GRIPPER, 1.0, target=[0.6], step=h)

    finger, follower = motion.position.T
    # Drake's coupler is compliant: its error grows with the square of the step.
    tolerance = 1e-4 * (h / 1e-3) ** 2
    np.testing.assert_allclose(follower, -0.5 * finger + 0.1, atol=tolerance)
    assert finger[-1] == pytest.approx(0.6, abs=1e-4)
    # Virtual work: the master also carries the follower, at -0.5 of its angle.
    weight = models.MASS * models.GRAVITY * models.LENGTH
    load_inertia = weight * (math.sin(0.6) - 0.5 * math.sin(0.1 - 0.3))
    assert motion.effort[-1, 0] == pytest.approx(load_inertia, rel=1e-3)
    np.testing.assert_array_equal(motion.effort[:, 1], 0.0)


def test_a_master_carries_those_that_mimic_the_ones_that_mimic_it(
    tmp_path: Path,
) -> None:
    third = models.joint(
        "third",
        "base",
        "last",
        xyz="0 2 0",
        inside='<mimic joint="follower" multiplier="3" offset="0"/>',
    )
    urdf = models.GRIPPER.replace(
        '<link name="base"/>', f'<link name="base"/>{models.bob("last")}{third}'
    )

    motion = run(tmp_path, urdf, 0.01, initial={"finger": 0.6})

    # finger 0.6, follower 0.1 - 0.3, third 3 times that: velocities 1, -0.5, -1.5.
    weight = models.MASS * models.GRAVITY * models.LENGTH
    load_inertia = weight * (
        math.sin(0.6) - 0.5 * math.sin(-0.2) - 1.5 * math.sin(-0.6)
    )
    assert motion.effort[0, 1] == pytest.approx(load_inertia, rel=1e-9)


def test_dry_friction_of_a_mimic_joint_brakes_its_master(tmp_path: Path) -> None:
    urdf = models.GRIPPER.replace("<mimic", '<dynamics friction="1"/><mimic')
    (mimic,) = (
        joint.mimic
        for joint in models.load(tmp_path, urdf).description.movable_joints
        if joint.mimic is not None
    )

    motion = run(tmp_path, urdf, 0.5, target=[0.6])

    # By virtual work: the power of its friction of 1 N·m is that of the master's.
    assert mimic.multiplier not in (0.0, 1.0)
    assert np.abs(motion.friction).max() == pytest.approx(abs(mimic.multiplier))
    assert motion.position[-1, 0] == pytest.approx(0.6, abs=1e-3)


def alone(folder: Path, urdf: str, **positions: float) -> MultibodyPlant:
    """Return a robot's plant with default positions."""
    plant = MultibodyPlant(1e-3)
    model = add_robot_model(plant, models.load(folder, urdf).description, "r", None)
    set_initial_positions(plant, model, positions)
    plant.Finalize()
    return plant


def test_dynamics_are_sampled_first_where_the_robot_starts(tmp_path: Path) -> None:
    urdf = models.pendulum(dynamics='<dynamics damping="0.7"/>')

    samples = sample_dynamics(alone(tmp_path, urdf, swing=1.0), np.eye(1))

    weight = models.MASS * models.GRAVITY * models.LENGTH
    assert samples.gravity[0] == pytest.approx([weight * math.sin(1.0)])
    np.testing.assert_allclose(samples.mass_matrix, models.INERTIA, rtol=1e-12)
    np.testing.assert_array_equal(samples.damping, [0.7])


def test_dynamics_are_sampled_all_over_the_joints_range(tmp_path: Path) -> None:
    limit = 'lower="0.5" upper="0.9" effort="0" velocity="0"'

    plant = alone(tmp_path, models.pendulum(limit=limit), swing=0.7)
    samples = sample_dynamics(plant, np.eye(1))

    weight = models.MASS * models.GRAVITY * models.LENGTH
    angles = np.arcsin(samples.gravity / weight)
    assert angles.min() == pytest.approx(0.5, abs=0.02)
    assert angles.max() == pytest.approx(0.9, abs=0.02)
    assert angles.min() >= 0.5
    assert angles.max() <= 0.9


def test_samples_are_the_same_every_time(tmp_path: Path) -> None:
    plant = alone(tmp_path, models.TWO_LINKS)

    one, other = (sample_dynamics(plant, np.eye(2)) for _ in range(2))

    np.testing.assert_array_equal(one.mass_matrix, other.mass_matrix)
    np.testing.assert_array_equal(one.gravity, other.gravity)


def test_picked_joints_are_sampled_as_the_product_says(tmp_path: Path) -> None:
    plant = alone(tmp_path, models.TWO_LINKS)
    whole = sample_dynamics(plant, np.eye(2)).mass_matrix
    for N in (np.eye(2)[:, ::-1], np.eye(2)[:, 1:], np.array([[1.0], [0.5]])):
        picked = sample_dynamics(plant, N).mass_matrix
        np.testing.assert_array_equal(picked, [N.T @ mass @ N for mass in whole])


def test_a_master_has_the_inertia_and_damping_of_its_followers(tmp_path: Path) -> None:
    urdf = models.GRIPPER.replace("<mimic", '<dynamics damping="0.8"/><mimic')

    N = np.array([[1.0], [-0.5]])
    samples = sample_dynamics(alone(tmp_path, urdf), N)

    # Kinetic energy and power of both, at velocities 1 and -0.5.
    np.testing.assert_allclose(
        samples.mass_matrix, models.INERTIA * (1.0 + 0.25), rtol=1e-12
    )
    np.testing.assert_allclose(samples.damping, [0.25 * 0.8], rtol=1e-12)


@pytest.mark.parametrize(
    "limit", ['lower="-3" upper="3" effort="0" velocity="0"', 'lower="-3" upper="3"']
)
def test_a_joint_without_limits_of_effort_and_speed_settles(
    tmp_path: Path, limit: str
) -> None:
    motion = run(tmp_path, models.pendulum(limit=limit), 1.0, target=[1.0])

    assert motion.position[-1, 0] == pytest.approx(1.0, abs=1e-6)
    # It goes there at a turn a second at most.
    assert np.abs(motion.velocity).max() <= 2.0 * math.pi
    weight = models.MASS * models.GRAVITY * models.LENGTH
    fastest = 2.0 * W0 * 2.0 * math.pi
    assert np.abs(motion.effort).max() <= weight + fastest * models.INERTIA


# Dry friction: a pendulum of 1 kg at 0.5 m with 2 N·m of friction, not commanded.
FRICTION = 2.0
WEIGHT = models.MASS * models.GRAVITY * models.LENGTH
FREE_WITH_FRICTION = models.pendulum(
    dynamics=f'<dynamics friction="{FRICTION}"/>',
    control=models.ros2_control(states=("swing",)),
)


@pytest.mark.parametrize(("h", "slip"), [(1e-3, 1e-4), (1e-2, 2e-3)])
def test_a_pendulum_released_within_friction_sticks(
    tmp_path: Path, h: float, slip: float
) -> None:
    # m g l sin 0.3 = 1.45 N·m.
    motion = run(tmp_path, FREE_WITH_FRICTION, 5.0, step=h, initial={"swing": 0.3})

    # The bristle bends by m g l sin 0.3 / kf, with kf of the order of M / h^2.
    assert np.abs(motion.position - 0.3).max() < slip
    is_late = motion.time > 1.0
    creep = np.ptp(motion.position[is_late])
    assert creep < 1e-9
    assert motion.friction is not None
    assert motion.friction[-1, 0] == pytest.approx(WEIGHT * math.sin(0.3), rel=1e-2)


@pytest.mark.parametrize(("h", "tolerance"), [(1e-3, 5e-3), (1e-2, 5e-2)])
@pytest.mark.parametrize("start", [1.0, -1.0])
def test_a_swing_stops_where_friction_has_taken_its_energy(
    tmp_path: Path, start: float, h: float, tolerance: float
) -> None:
    motion = run(tmp_path, FREE_WITH_FRICTION, 5.0, step=h, initial={"swing": start})

    # m g l (cos q - cos 1) = f (1 - q) at the turning point q, by bisection; there
    # gravity is weaker than friction, so it stays.
    low, high = -0.5, 0.5
    for _ in range(60):
        middle = (low + high) / 2.0
        gained = WEIGHT * (math.cos(middle) - math.cos(1.0))
        low, high = (
            (low, middle) if gained > FRICTION * (1.0 - middle) else (middle, high)
        )
    stop = math.copysign(1.0, start) * middle
    assert WEIGHT * abs(math.sin(stop)) < FRICTION
    # The stopping angle's error is of first order in the step, of the path of 1.1 rad.
    assert motion.position[-1, 0] == pytest.approx(stop, abs=tolerance)
    assert abs(motion.velocity[-1, 0]) < 1e-9


def test_friction_brakes_with_its_full_force_and_never_more(tmp_path: Path) -> None:
    motion = run(tmp_path, FREE_WITH_FRICTION, 2.0, initial={"swing": 1.0})

    assert motion.friction is not None
    assert np.abs(motion.friction).max() <= FRICTION * (1.0 + 1e-12)
    is_sliding = np.abs(motion.velocity[:, 0]) > 0.1
    assert is_sliding.sum() > 100
    np.testing.assert_allclose(
        motion.friction[is_sliding, 0],
        -FRICTION * np.sign(motion.velocity[is_sliding, 0]),
        rtol=1e-12,
    )


def test_friction_can_be_turned_off(tmp_path: Path) -> None:
    motion = run(
        tmp_path, FREE_WITH_FRICTION, 0.5, initial={"swing": 0.3}, friction=False
    )

    assert motion.friction is None
    assert motion.position.min() < 0.0


def test_poses_are_sampled_within_limits_and_followers_follow(tmp_path: Path) -> None:
    # Beyond a half turn, and so narrow that a clipped range would miss it.
    limit = 'lower="4.6" upper="4.8" effort="0" velocity="0"'
    plant = alone(tmp_path, models.pendulum(limit=limit), swing=4.7)

    efforts = sample_gravity(plant, np.eye(1), 50)

    weight = models.MASS * models.GRAVITY * models.LENGTH
    low = weight * min(abs(math.sin(4.6)), abs(math.sin(4.8)))
    assert np.abs(efforts).min() >= low
    assert np.abs(efforts).max() <= weight * (1.0 + 1e-9)


def test_gravity_is_judged_in_poses_that_mimic_joints_allow(tmp_path: Path) -> None:
    # The master turns by 0.1 rad at most, and lifts 1 kg at 1 m through its follower.
    def link(name: str, x: float, mass: float) -> str:
        inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        origin = f'<origin xyz="{x} 0 0"/>'
        inertial = f'{origin}<mass value="{mass}"/>{inertia}'
        return f'<link name="{name}"><inertial>{inertial}</inertial></link>'

    def joint(name: str, child: str, limits: str, more: str = "") -> str:
        return (
            f'<joint name="{name}" type="revolute"><parent link="base"/>'
            f'<child link="{child}"/><axis xyz="0 1 0"/><limit {limits} effort="12" '
            f'velocity="1"/>{more}</joint>'
        )

    urdf = (
        '<robot name="r"><link name="base"/>'
        + link("a", 0.0, 0.1)
        + link("b", 1.0, 1.0)
        + joint("m", "a", 'lower="-0.1" upper="0.1"')
        + joint(
            "s",
            "b",
            'lower="-3" upper="3"',
            '<mimic joint="m" multiplier="1" offset="-1.3"/>',
        )
        + "</robot>"
    )

    robot = models.load(tmp_path, urdf)

    # 9.81 N·m * cos(1.2) = 3.6 at most; all around it would be 9.81.
    assert not [entry for entry in robot.report if "gravity" in entry.what]
    weak = models.load(tmp_path, urdf.replace('effort="12"', 'effort="3"'))
    (line,) = [entry.what for entry in weak.report if "gravity" in entry.what]
    assert line.startswith("gravity asks for 3.")
