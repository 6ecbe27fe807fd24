"""Drives do what descriptions say of them, and reports say what drives do."""

import math
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.hardware.drives import make_robot_drive
from tests import models

H = 1e-3
RATE = 100
WEIGHT = models.MASS * models.GRAVITY * models.LENGTH
CLASSIC = "gazebo_ros2_control/GazeboSystem"
GZ = "gz_ros2_control/GazeboSimSystem"


def control(
    *commands: str, plugin: str = CLASSIC, joint: str = "swing", params: str = ""
) -> str:
    """Return a block that offers a joint's command interfaces."""
    interfaces = "".join(f'<command_interface name="{name}"/>' for name in commands)
    states = "".join(
        f'<state_interface name="{name}"/>' for name in ("position", "velocity")
    )
    return (
        f'<ros2_control name="hardware" type="system"><hardware><plugin>{plugin}'
        f'</plugin></hardware><joint name="{joint}">{interfaces}{states}{params}'
        "</joint></ros2_control>"
    )


def params(**values: float) -> str:
    return "".join(f'<param name="{k}">{v}</param>' for k, v in values.items())


def forward(interface: str, *joints: str) -> str:
    return (
        f"controller_manager: {{ros__parameters: {{update_rate: {RATE}, "
        "forward: {type: forward_command_controller/ForwardCommandController}}}\n"
        f"forward: {{ros__parameters: {{joints: [{', '.join(joints)}], "
        f"interface_name: {interface}}}}}\n"
    )


def simulate(
    folder: Path,
    urdf: str,
    yaml: str,
    *,
    start: float = 0.0,
    **options: object,
) -> ad.Simulation:
    robot = models.load(folder, urdf, yaml, initial_positions={"swing": start})
    settings = ad.SimulationOptions(log_rate=1.0 / H, **options)  # type: ignore[arg-type]
    return ad.Simulation(ad.build_diagram(robot, options=settings))


def servo_lines(sim: ad.Simulation) -> list[str]:
    return [f"{e.what}; {e.done}" for e in sim.report if e.where == "joint servo"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "gains"),
    [
        ("position", {"kp": 40.0, "ki": 0.0, "kd": 3.0}),
        ("position", {"kp": 40.0, "ki": 25.0, "kd": 3.0}),
        ("velocity", {"kp": 4.0, "ki": 30.0, "kd": 0.0}),
        ("velocity", {"kp": 4.0, "ki": 30.0, "kd": 0.01}),
    ],
)
@pytest.mark.parametrize("limit", [math.inf, 1.5])
def test_pid_gains_of_gazebo_classic_drive_a_joint_as_there(
    tmp_path: Path, kind: str, gains: dict[str, float], limit: float
) -> None:
    inputs = {f"{kind[:3]}_{name}": value for name, value in gains.items()}
    if np.isfinite(limit):
        inputs |= {
            f"{kind[:3]}_max_integral_error": limit,
            f"{kind[:3]}_min_integral_error": -limit,
        }
    urdf = models.pendulum(control=control(kind, params=params(**inputs)))
    sim = simulate(tmp_path, urdf, forward(kind, "swing"))
    target = 0.5

    sim.controller("forward").command([target])
    sim.advance_to(2.0)

    # control_toolbox's Pid on the error at every step, and the equation of motion.
    found, commanded = sim.rollout(), False
    q = v = summed = last = 0.0
    positions = []
    for _ in found.time:
        positions.append(q)
        wanted = target if commanded or len(positions) == 1 else 0.0
        commanded = True
        error = wanted - (q if kind == "position" else v)
        summed += H * error
        term = float(np.clip(gains["ki"] * summed, -limit, limit))
        tau = gains["kp"] * error + term + gains["kd"] * (error - last) / H
        tau = float(np.clip(tau, -100.0, 100.0))
        last = error
        v += H * (tau - WEIGHT * math.sin(q)) / models.INERTIA
        q += H * v
    np.testing.assert_allclose(found.position[:, 0], positions, atol=1e-9)
    assert any("PID gains" in line for line in servo_lines(sim))


@pytest.mark.slow
def test_a_plain_p_gain_balances_the_weight(tmp_path: Path) -> None:
    gains = params(pos_kp=40.0, pos_ki=0.0, pos_kd=4.0)
    urdf = models.pendulum(control=control("position", params=gains))
    sim = simulate(tmp_path, urdf, forward("position", "swing"))

    sim.controller("forward").command([1.0])
    sim.advance_to(6.0)

    (q,) = sim.joint_states().position
    assert 40.0 * (1.0 - q) == pytest.approx(WEIGHT * math.sin(q), rel=1e-6)


def test_a_proportional_gain_that_is_given_makes_velocity_of_error(
    tmp_path: Path,
) -> None:
    plugin = (
        '<gazebo><plugin filename="libgz_ros2_control-system.so" '
        'name="gz_ros2_control::GazeboSimROS2ControlPlugin">'
        "<position_proportional_gain>0.05</position_proportional_gain>"
        "</plugin></gazebo>"
    )
    urdf = models.pendulum(
        limit='lower="-3" upper="3" effort="0" velocity="10"',
        control=control("position", plugin=GZ) + plugin,
    )
    sim = simulate(tmp_path, urdf, forward("position", "swing"))

    sim.controller("forward").command([0.2])
    sim.advance_to(1.0)

    # velocity = gain update_rate error, so the error shrinks by the same part a step.
    rollout, part = sim.rollout(), 1.0 - 0.05 * RATE * H
    steps = np.arange(len(rollout.time))
    expected = 0.2 * (1.0 - part**steps)
    np.testing.assert_allclose(rollout.position[:, 0], expected, atol=1e-9)


def test_a_joint_whose_commands_are_the_drivers_own_is_reported(
    tmp_path: Path,
) -> None:
    # Drivers of motors take such commands, and close the loop by themselves.
    urdf = models.pendulum(control=control("position_des"))
    sim = simulate(tmp_path, urdf, forward("position_des", "swing"), start=1.0)

    sim.controller("forward").command([0.2])
    sim.advance_to(0.5)

    (line,) = servo_lines(sim)
    assert line == (
        "no position, velocity or effort of 'swing' is commanded, only "
        "'position_des'; they hold their positions"
    )
    np.testing.assert_allclose(sim.rollout().position, 1.0, atol=1e-9)


@pytest.mark.parametrize("holds", [True, False])
def test_joints_that_nobody_commands_hold_unless_the_plugin_says_no(
    tmp_path: Path, holds: bool
) -> None:
    plugin = (
        '<gazebo><plugin filename="libgz_ros2_control-system.so" '
        'name="gz_ros2_control::GazeboSimROS2ControlPlugin">'
        f"<hold_joints>{str(holds).lower()}</hold_joints></plugin></gazebo>"
    )
    urdf = models.pendulum(control=control("position", plugin=GZ) + plugin)
    yaml = f"controller_manager: {{ros__parameters: {{update_rate: {RATE}}}}}\n"

    sim = simulate(tmp_path, urdf, yaml, start=1.0)
    sim.advance_to(1.0)

    (line,) = servo_lines(sim)
    assert line.startswith("no active controller commands 'swing'; they ")
    rollout = sim.rollout()
    if holds:
        assert line.endswith("hold their positions")
        np.testing.assert_allclose(rollout.position, 1.0, atol=1e-12)
        return
    assert line.endswith("swing freely")
    q, v, positions = 1.0, 0.0, []
    for _ in rollout.time:
        positions.append(q)
        v -= H * WEIGHT * math.sin(q) / models.INERTIA
        q += H * v
    np.testing.assert_allclose(rollout.position[:, 0], positions, atol=1e-9)
    np.testing.assert_array_equal(rollout.effort, 0.0)


def test_a_joint_without_command_interface_is_said_to_swing(tmp_path: Path) -> None:
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    yaml = f"controller_manager: {{ros__parameters: {{update_rate: {RATE}}}}}\n"

    sim = simulate(tmp_path, urdf, yaml, start=1.0)

    assert servo_lines(sim) == ["no command interface for 'swing'; it swings freely"]


def test_a_velocity_without_a_limit_is_said_to_be_followed(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="100" velocity="0"'
    urdf = models.pendulum(limit=limit, control=control("velocity", plugin=GZ))

    sim = simulate(tmp_path, urdf, forward("velocity", "swing"), start=-1.0)
    sim.controller("forward").command([15.0])
    sim.advance_to(0.2)

    assert servo_lines(sim) == [
        "no velocity limit: 'swing'; velocity commands are followed whatever they are"
    ]
    assert sim.joint_states().velocity[0] == pytest.approx(15.0, rel=0.01)


@pytest.mark.slow
def test_an_acceleration_beside_a_position_takes_the_lag_away(tmp_path: Path) -> None:
    errors = {}
    for kinds in (("position", "velocity"), ("position", "velocity", "acceleration")):
        urdf = models.pendulum(control=control(*kinds, plugin=GZ))
        yaml = (
            "controller_manager: {ros__parameters: {update_rate: 1000, arm: "
            "{type: joint_trajectory_controller/JointTrajectoryController}}}\n"
            "arm: {ros__parameters: {joints: [swing], command_interfaces: "
            f"[{', '.join(kinds)}], state_interfaces: [position, velocity]}}}}\n"
        )
        sim = simulate(tmp_path, urdf, yaml)
        still = (0.0,)
        sim.controller("arm").send_goal(
            ad.JointTrajectory(
                joint_names=("swing",),
                points=(
                    ad.JointTrajectoryPoint(
                        positions=(1.0,),
                        velocities=still,
                        accelerations=still,
                        time_from_start=1.0,
                    ),
                ),
            )
        )
        sim.advance_to(1.5)
        errors[kinds] = np.abs(sim.rollout().tracking_error("arm")).max()

    without, with_it = errors.values()
    # The largest acceleration of a quintic, 5.77, as it passes (s / w0 + 1)^-2, over
    # w0^2; and at most what it travels in half a step, for it is held.
    assert without == pytest.approx(5.65 / 1600.0, abs=1.875 * H / 2.0)
    assert with_it <= 1.1 * 1.875 * H


def test_an_effort_beyond_the_limit_is_clamped_and_counted(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="4" velocity="10"'
    urdf = models.pendulum(limit=limit, control=control("effort", plugin=GZ))

    sim = simulate(tmp_path, urdf, forward("effort", "swing"))
    sim.controller("forward").command([50.0])
    sim.advance_to(0.5)
    sim.controller("forward").command([1.0])
    sim.advance_to(1.0)

    rollout = sim.rollout()
    assert np.abs(rollout.effort).max() == 4.0
    assert rollout.effort_saturation() == {"swing": pytest.approx(0.5, abs=0.011)}


def test_a_step_that_does_not_fit_is_said(tmp_path: Path) -> None:
    yaml = forward("position", "swing").replace("100", "200")
    robot = models.load(tmp_path, models.pendulum(), yaml)
    options = ad.SimulationOptions(time_step=2e-3, log_rate=500.0)

    report = ad.Simulation(ad.build_diagram(robot, options=options)).report

    found = {entry.where: f"{entry.what}; {entry.done}" for entry in report}
    assert found["time_step"] == (
        "steps of 2 ms don't fit into the controller manager's period of 5 ms; "
        "the physics takes steps of 1.667 ms"
    )
    assert found["log_rate"] == (
        "500 Hz is no whole number of steps of 1.667 ms; "
        "a row shows the state after the last step"
    )


@pytest.mark.parametrize(
    ("gains", "problem"),
    [
        ("p: .nan", "p must be a finite number, got nan"),
        ("i: .inf", "i must be a finite number, got inf"),
    ],
)
def test_gains_that_are_no_numbers_are_refused(
    tmp_path: Path, gains: str, problem: str
) -> None:
    sim = simulate(tmp_path, EFFORT_PENDULUM, effort_arm(gains))

    assert [c.state for c in sim.list_controllers()] == ["unconfigured"]
    assert problem in str(sim.report)


@pytest.mark.parametrize(
    ("gains", "problem"),
    [
        ("p: -1.0", "p is -1.0: it pushes away from the goal"),
        ("p: 5.0, d: -0.1", "d is -0.1: it pushes away from the goal"),
        ("p: 0.0", "p, i and d are 0: no error moves the joint"),
    ],
)
def test_gains_that_are_hardly_meant_are_reported(
    tmp_path: Path, gains: str, problem: str
) -> None:
    sim = simulate(tmp_path, EFFORT_PENDULUM, effort_arm(gains))

    (line,) = (entry for entry in sim.report if entry.severity == "warning")
    assert (line.what, line.where) == (problem, "arm.gains.swing")
    assert [c.state for c in sim.list_controllers()] == ["active"]


EFFORT_PENDULUM = models.pendulum(control=control("effort", plugin=GZ))


def effort_arm(gains: str) -> str:
    return (
        f"controller_manager: {{ros__parameters: {{update_rate: {RATE}, arm: "
        "{type: joint_trajectory_controller/JointTrajectoryController}}}\n"
        "arm: {ros__parameters: {joints: [swing], command_interfaces: [effort], "
        f"state_interfaces: [position, velocity], gains: {{swing: {{{gains}}}}}}}}}\n"
    )


def test_gains_that_no_step_can_bear_are_reported(tmp_path: Path) -> None:
    gains = params(pos_kp=100.0, pos_ki=0.0, pos_kd=600.0)
    urdf = models.pendulum(control=control("position", params=gains))

    sim = simulate(tmp_path, urdf, forward("position", "swing"))

    (line,) = (entry for entry in sim.report if entry.severity == "warning")
    # kd h / M may be 2.
    assert line.what == (
        "kd of positions, 600, is too much for steps of 1 ms: it may be 502 at most"
    )


def test_a_joint_without_room_is_said_not_to_move(tmp_path: Path) -> None:
    limit = 'lower="0.5" upper="0.5" effort="100" velocity="10"'
    urdf = models.pendulum(limit=limit, control=control("position", plugin=GZ))

    sim = simulate(tmp_path, urdf, forward("position", "swing"), start=0.5)

    assert any("'swing'; they can't move" in line for line in servo_lines(sim))


def test_wheels_without_a_limit_move_a_base_that_is_far_heavier(tmp_path: Path) -> None:
    urdf = models.pendulum(limit='lower="0" upper="0" effort="0" velocity="0"')
    robot = models.load(tmp_path, urdf)
    options = ad.SimulationOptions()

    alone, laden = (
        make_robot_drive(
            robot.description, None, options, 1e-3, load_inertia=load_inertia
        )
        for load_inertia in ({}, {"swing": 100.0})
    )

    # What the observer may add grows with what is carried, not what is counted with.
    assert laden.gains.max_disturbance[0] > 10.0 * alone.gains.max_disturbance[0]
