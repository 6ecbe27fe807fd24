"""The servo follows velocities, accelerations and efforts, and what changes in flight.

All in Drake's physics, with gravity.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

import arm_drake as ad
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.servo import velocity_lead
from arm_drake.hardware.drives import commanded_joints, effort_limits, make_robot_drive
from arm_drake.hardware.hardware import add_hardware, connect_forces
from arm_drake.messages import Float64MultiArray
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    set_initial_positions,
)
from tests import models

W0 = ad.SimulationOptions().servo_bandwidth
STEPS = [1e-3, 2e-3, 5e-3, 1e-2]
WEIGHT = models.MASS * models.GRAVITY * models.LENGTH

# Bobs that are free to turn around.
FREE = models.pendulum(limit='effort="0" velocity="0"').replace(
    'type="revolute"', 'type="continuous"'
)


class Motion(NamedTuple):
    """What a run logs at every step of the plant, in the order of the description."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


def run(
    folder: Path,
    urdf: str,
    duration: float,
    commands: Mapping[str, float],
    *,
    step: float = 1e-3,
    initial: dict[str, float] | None = None,
) -> Motion:
    """Run a robot whose servo is told the same all the time, without controllers.

    Args:
        folder: Where to write the robot.
        urdf: The robot.
        duration: How long [s].
        commands: Values of the command interfaces that are claimed, such as
            {"joint1/velocity": 0.5}; other joints hold.
        step: Step of the plant [s].
        initial: Initial positions.
    """
    robot = models.load(folder, urdf, initial_positions=initial)
    options = ad.SimulationOptions(time_step=step)
    builder = DiagramBuilder()
    plant, _ = add_plant(builder, step, options)
    model = add_robot_model(plant, robot.description, "robot", None)
    joints = commanded_joints(robot.description)
    names = [joint.name for joint in joints]
    add_actuators(plant, model, names, effort_limits(joints))
    set_initial_positions(plant, model, dict(robot.initial_positions))
    plant.Finalize()
    hardware = add_hardware(
        builder,
        plant,
        model,
        robot.description,
        prefix="",
        drive=make_robot_drive(robot.description, None, options, step, lets_go=True),
        initial=robot.initial_positions,
        options=options,
        has_modes=True,
    )
    if hardware.friction is not None:
        connect_forces(builder, plant, {model: hardware.friction})
    order = tuple(commands)
    drive = DriveCommands(names, order, velocity_lead=velocity_lead(W0))
    held = drive.initial([robot.initial_positions[name] for name in names])
    mode = drive.mode(dict.fromkeys(commands, 1.0 / step))
    servo_input = drive.write(mode, np.array([*commands.values(), 0.0]), held)
    source = builder.AddSystem(ConstantVectorSource(drive.servo_input(servo_input)))
    assert hardware.command is not None
    builder.Connect(source.get_output_port(), hardware.command)
    log = LogVectorOutput(hardware.joint_states, builder, step)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    logged = log.FindLog(simulator.get_context())
    return Motion(logged.sample_times(), *np.split(logged.data().T, 3, axis=1))


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    "dynamics",
    ["", '<dynamics damping="2"/>', '<dynamics damping="0.5" friction="1"/>'],
    ids=["free", "damped", "damped with friction"],
)
def test_a_velocity_is_followed_without_drift(
    tmp_path: Path, dynamics: str, h: float
) -> None:
    urdf = models.pendulum(dynamics=dynamics)

    motion = run(
        tmp_path, urdf, 2.0, {"swing/velocity": 0.8}, step=h, initial={"swing": -0.5}
    )

    if "friction" in dynamics:
        # The observer has to find the friction out.
        is_late = motion.time > 1.0
        np.testing.assert_allclose(motion.velocity[is_late], 0.8, atol=1e-6)
        return
    # Every step takes away 1 - z of the error, whatever gravity and damping are.
    k = np.round(motion.time / h)
    expected = 0.8 * (1.0 - math.exp(-W0 * h) ** k)
    np.testing.assert_allclose(motion.velocity[:, 0], expected, atol=1e-9)
    travelled = h * np.cumsum(expected)
    np.testing.assert_allclose(motion.position[:, 0], travelled - 0.5, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("initial", [-1.4, 0.0, 1.4])
def test_a_velocity_of_zero_holds_without_drift(
    tmp_path: Path, initial: float, h: float
) -> None:
    motion = run(
        tmp_path,
        models.pendulum(),
        5.0,
        {"swing/velocity": 0.0},
        step=h,
        initial={"swing": initial},
    )

    np.testing.assert_allclose(motion.position, initial, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_velocity_is_limited_to_that_of_the_joint(
    tmp_path: Path, sign: float
) -> None:
    limit = 'lower="-3" upper="3" effort="100" velocity="1.5"'

    motion = run(
        tmp_path, models.pendulum(limit=limit), 1.0, {"swing/velocity": 9.0 * sign}
    )

    assert np.abs(motion.velocity).max() <= 1.5 + 1e-9
    assert motion.velocity[-1, 0] == pytest.approx(1.5 * sign, abs=1e-9)


def test_velocities_of_coupled_joints_do_not_disturb_each_other(
    tmp_path: Path,
) -> None:
    motion = run(tmp_path, models.TWO_LINKS, 1.0, {"shoulder/velocity": 1.0}, step=1e-3)

    assert motion.position[-1, 0] > 0.9
    np.testing.assert_allclose(motion.position[:, 1], 0.0, atol=1e-9)


def test_a_follower_moves_with_the_velocity_of_its_master(tmp_path: Path) -> None:
    motion = run(tmp_path, models.GRIPPER, 1.0, {"finger/velocity": 0.5})

    finger, follower = motion.velocity.T
    assert finger[-1] == pytest.approx(0.5, abs=1e-3)
    assert follower[-1] == pytest.approx(-0.25, abs=1e-3)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("dynamics", ["", '<dynamics damping="2"/>'])
def test_an_acceleration_is_what_the_joint_gets(
    tmp_path: Path, dynamics: str, h: float
) -> None:
    motion = run(
        tmp_path,
        models.pendulum(dynamics=dynamics),
        0.5,
        {"swing/acceleration": -2.0},
        step=h,
        initial={"swing": 0.7},
    )

    np.testing.assert_allclose(motion.velocity[:, 0], -2.0 * motion.time, atol=1e-9)


def test_an_acceleration_is_limited_by_what_the_effort_leaves(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="20" velocity="0"'

    motion = run(
        tmp_path, models.pendulum(limit=limit), 0.05, {"swing/acceleration": 1e4}
    )

    # All of it, less what gravity takes at each step.
    spare = 20.0 - WEIGHT * np.sin(motion.position[:-1, 0])
    rates = np.diff(motion.velocity[:, 0]) / 1e-3
    np.testing.assert_allclose(rates, spare / models.INERTIA, rtol=1e-9)


def test_an_acceleration_does_not_move_coupled_joints(tmp_path: Path) -> None:
    motion = run(tmp_path, models.TWO_LINKS, 0.5, {"elbow/acceleration": 3.0})

    np.testing.assert_allclose(motion.velocity[:, 1], 3.0 * motion.time, atol=1e-9)
    np.testing.assert_allclose(motion.position[:, 0], 0.0, atol=1e-9)


@pytest.mark.parametrize("h", STEPS)
def test_an_effort_is_applied_as_it_is(tmp_path: Path, h: float) -> None:
    motion = run(
        tmp_path,
        models.pendulum(),
        0.2,
        {"swing/effort": 1.25},
        step=h,
        initial={"swing": 0.3},
    )

    np.testing.assert_array_equal(motion.effort, 1.25)
    first = (1.25 - WEIGHT * math.sin(0.3)) / models.INERTIA
    assert motion.velocity[1, 0] == pytest.approx(first * h, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_effort_is_held_to_the_limit(tmp_path: Path, sign: float) -> None:
    limit = 'lower="-3" upper="3" effort="4" velocity="10"'

    motion = run(
        tmp_path, models.pendulum(limit=limit), 0.1, {"swing/effort": 50.0 * sign}
    )

    np.testing.assert_array_equal(motion.effort, 4.0 * sign)


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("amplitude", [0.1, 1.0, 2.5])
def test_without_effort_a_pendulum_swings_freely(
    tmp_path: Path, amplitude: float, h: float
) -> None:
    motion = run(
        tmp_path,
        FREE,
        8.0,
        {"swing/effort": 0.0},
        step=h,
        initial={"swing": amplitude},
    )

    # T = 4 K(sin(a / 2)) sqrt(I / m g l), the elliptic integral by Gauss's mean.
    mean, other = 1.0, math.cos(amplitude / 2.0)
    for _ in range(8):
        mean, other = (mean + other) / 2.0, math.sqrt(mean * other)
    period = 2.0 * math.pi / mean * math.sqrt(models.INERTIA / WEIGHT)
    q, t = motion.position[:, 0], motion.time
    (at,) = np.nonzero((q[:-1] > 0.0) & (q[1:] <= 0.0))
    crossings = t[at] + h * q[at] / (q[at] - q[at + 1])
    assert len(crossings) >= 2
    # Drake's step has an error of (w h)^2 / 24 for small swings, 8e-5 at 10 ms; that of
    # large ones is a few times as large.
    tolerance = 1e-5 + 4.0 * (WEIGHT / models.INERTIA) * h**2 / 24.0
    np.testing.assert_allclose(np.diff(crossings), period, rtol=tolerance)
    # It neither gains nor loses energy: the first order of the step only shakes it.
    assert q.max() == pytest.approx(amplitude, rel=5.0 * h)


@pytest.mark.slow
@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    "command",
    [{}, {"elbow/velocity": 1.0}, {"elbow/acceleration": 1.0}],
    ids=["nothing", "velocity", "acceleration"],
)
def test_joints_that_nobody_commands_hold(
    tmp_path: Path, command: dict[str, float], h: float
) -> None:
    motion = run(
        tmp_path,
        models.TWO_LINKS,
        1.0,
        command,
        step=h,
        initial={"shoulder": 0.7, "elbow": 0.2},
    )

    np.testing.assert_allclose(motion.position[:, 0], 0.7, atol=1e-9)
    assert (np.ptp(motion.position[:, 1]) > 0.3) == bool(command)


@pytest.mark.parametrize("h", STEPS)
def test_a_joint_holds_while_another_one_swings_freely(
    tmp_path: Path, h: float
) -> None:
    motion = run(
        tmp_path,
        models.TWO_LINKS,
        2.0,
        {"elbow/effort": 0.0},
        step=h,
        initial={"shoulder": 0.7, "elbow": 1.2},
    )

    assert np.ptp(motion.position[:, 1]) > 1.0
    # The elbow's acceleration is found out over some steps, so that is in proportion to
    # them; without it it would be 4 mrad at 1 ms.
    np.testing.assert_allclose(motion.position[:, 0], 0.7, atol=h)
    # At no step does it make the shoulder chatter.
    is_late = motion.time > 1.0
    assert np.abs(np.diff(motion.velocity[is_late, 0])).max() < h


def test_a_swinging_joint_s_effort_is_its_own(tmp_path: Path) -> None:
    motion = run(
        tmp_path,
        models.TWO_LINKS,
        1.0,
        {"elbow/effort": 0.3, "shoulder/velocity": 0.5},
        initial={"shoulder": 0.7, "elbow": 1.2},
    )

    np.testing.assert_array_equal(motion.effort[:, 1], 0.3)
    assert motion.velocity[-1, 0] == pytest.approx(0.5, abs=0.02)


KINDS = {
    "position": "position_controllers/JointGroupPositionController",
    "velocity": "forward_command_controller/ForwardCommandController",
    "effort": "forward_command_controller/ForwardCommandController",
}
COMMANDS = "".join(
    f'<joint name="{joint}">'
    + "".join(f'<command_interface name="{kind}"/>' for kind in KINDS)
    + '<state_interface name="position"/><state_interface name="velocity"/></joint>'
    for joint in ("shoulder", "elbow")
)
SWITCHED = models.TWO_LINKS.replace(
    models.ros2_control("shoulder", "elbow"),
    '<ros2_control name="hardware" type="system"><hardware>'
    f"<plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>{COMMANDS}"
    "</ros2_control>",
)


def groups(**joints: str) -> str:
    """Return a YAML with a controller per name, "<kind>" or "<kind>_<more>"."""
    rows, sections = "", []
    for name, names in joints.items():
        kind = name.partition("_")[0]
        rows += f", {name}: {{type: {KINDS[kind]}}}"
        more = "" if kind == "position" else f", interface_name: {kind}"
        parameters = f"{{joints: {names}{more}}}"
        sections.append(f"{name}: {{ros__parameters: {parameters}}}")
    manager = f"{{ros__parameters: {{update_rate: 100{rows}}}}}"
    return "\n".join([f"controller_manager: {manager}", *sections])


def simulate(folder: Path, yaml: str, active: str, h: float = 1e-3) -> ad.Simulation:
    start = {"shoulder": 0.6, "elbow": 0.5}
    robot = models.load(folder, SWITCHED, yaml, initial_positions=start)
    options = ad.SimulationOptions(active=(active,), log_rate=1.0 / h, time_step=h)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def command(sim: ad.Simulation, controller: str, *values: float) -> None:
    sim.publish(f"{controller}.commands", Float64MultiArray(values), 0.01)


@pytest.mark.slow
def test_joints_keep_their_speed_where_their_commands_change_kind(
    tmp_path: Path,
) -> None:
    both = "[shoulder, elbow]"
    sim = simulate(
        tmp_path, groups(velocity=both, effort=both, position=both), "velocity"
    )
    command(sim, "velocity", 0.5, -0.5)
    sim.advance_to(1.0)
    order = ("effort", "velocity", "position", "effort", "position", "velocity")

    now = "velocity"
    for number, new in enumerate(order, start=1):
        # No commands: each starts with what the hardware seeds.
        sim.switch_controllers([new], [now])
        sim.advance_to(1.0 + 0.05 * number)
        now = new
        assert {c.name for c in sim.list_controllers() if c.state == "active"} == {new}

    velocity = sim.rollout().velocity[990:]
    np.testing.assert_allclose(velocity[0], [0.5, -0.5], atol=1e-6)
    jumps = np.abs(np.diff(velocity, axis=0))
    assert jumps.max() <= 0.02, jumps.max(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [("velocity", "position"), ("position", "velocity"), ("position", "effort")],
)
def test_a_joint_in_motion_changes_kind_without_a_jump(
    tmp_path: Path, old: str, new: str
) -> None:
    yaml = groups(**dict.fromkeys(KINDS, "[shoulder, elbow]"))
    sim = simulate(tmp_path, yaml, old)
    for tick in range(100):
        # 0.6 rad/s on the shoulder, by whatever it is commanded.
        travelled = 0.6 + 0.006 * tick
        command(sim, old, *((0.6, 0.0) if old == "velocity" else (travelled, 0.5)))
        sim.advance_to(0.01 * (tick + 1))

    sim.switch_controllers([new], [old])
    sim.advance_to(1.5)

    velocity = sim.rollout().velocity
    assert velocity[1000, 0] == pytest.approx(0.6, abs=0.01)
    assert np.abs(np.diff(velocity[995:], axis=0)).max() <= 0.02
    if new == "velocity":
        assert velocity[-1, 0] == pytest.approx(velocity[1000, 0], abs=1e-6)
    if new == "position":
        assert velocity[-1, 0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.slow
def test_a_joint_that_is_let_go_and_taken_again_does_not_move(tmp_path: Path) -> None:
    yaml = groups(velocity="[shoulder, elbow]", position="[shoulder, elbow]")
    sim = simulate(tmp_path, yaml, "velocity")
    command(sim, "velocity", 0.5, 0.5)
    sim.advance_to(1.0)
    sim.switch_controllers(deactivate=["velocity"])
    sim.advance_to(2.0)

    sim.switch_controllers(activate=["position"])
    sim.advance_to(3.0)

    # Its position was commanded last where it started.
    position = sim.rollout().position
    assert position[1999, 0] > 1.0
    assert np.abs(position[2000:] - position[1999]).max() < 1e-4


@pytest.mark.slow
def test_one_joint_changes_kind_while_another_one_goes_on(tmp_path: Path) -> None:
    sim = simulate(
        tmp_path,
        groups(
            velocity_shoulder="[shoulder]", velocity_elbow="[elbow]", effort="[elbow]"
        ),
        "velocity_shoulder",
    )
    command(sim, "velocity_shoulder", 0.3)
    sim.advance_to(1.0)

    sim.switch_controllers(["effort"], ["velocity_elbow"])
    sim.advance_to(1.015)
    command(sim, "effort", 0.0)
    sim.advance_to(1.3)
    sim.switch_controllers(["velocity_elbow"], ["effort"])
    sim.advance_to(1.6)

    velocity = sim.rollout().velocity[1000:]
    assert np.ptp(velocity[:, 1]) > 0.5
    # Where the elbow's effort ends at once the shoulder feels it for some steps.
    error = np.abs(velocity[:, 0] - 0.3)
    assert error.max() < 0.06
    assert error[100:].max() < 0.01
