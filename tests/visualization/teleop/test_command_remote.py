"""Sliders of numbers: forward controllers, references, topics of Gazebo, outputs."""

import math
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.visualization.page.widgets import Slider
from arm_drake.visualization.teleop.remotes import (
    AdmittanceRemote,
    CommandRemote,
    ForwardRemote,
    GpioRemote,
    TopicRemote,
)
from tests import models
from tests.carts import plugin
from tests.robots import load_real_robot
from tests.visualization.teleop import panel

# How near a joint is to its goal at rest [rad], as in tests/rollouts.
FINAL = 2e-3

FORWARD = """
controller_manager:
  ros__parameters:
    update_rate: 100
    group: {{type: forward_command_controller/ForwardCommandController}}
group:
  ros__parameters:
    joints: [{joints}]
    interface_name: {interface}
"""


def forward(folder: Path, interface: str, **how: str) -> ad.Simulation:
    """Return a pendulum whose joint is commanded so."""
    control = models.ros2_control("swing", command=interface)
    yaml = FORWARD.format(joints="swing", interface=interface)
    urdf = models.pendulum(control=control, **how)
    return panel.simulate(models.load(folder, urdf, yaml))


def slider(remote: CommandRemote, part: str) -> Slider:
    widget = panel.leaves(remote)[part]
    assert isinstance(widget, Slider)
    return widget


@pytest.mark.slow
def test_a_slider_moves_its_joint_and_holds_the_others() -> None:
    sim = panel.simulate(ad.load_robot("centauri"))
    remote = panel.find(sim, "joint_group_position_controller", ForwardRemote)

    # The second is sent while the first is on its way.
    panel.use(remote, "value:joint2/position", 0.3)
    sim.run(0.05)
    panel.use(remote, "value:joint5/position", -0.4)
    panel.run(sim, 1.5, remote)

    at = panel.positions(sim)
    goals = {"joint2": 0.3, "joint5": -0.4}
    for joint in (f"joint{k}" for k in range(1, 7)):
        assert abs(at[joint] - goals.get(joint, 0.0)) <= FINAL
    assert panel.nothing_lost(sim)


@pytest.mark.parametrize(
    ("interface", "limit", "expected"),
    [
        (
            "position",
            'effort="5" velocity="4"',
            (-2.0, 1.0, "rad"),
        ),
        (
            "velocity",
            'effort="5" velocity="4"',
            (-4.0, 4.0, "rad/s"),
        ),
        ("effort", 'effort="5" velocity="4"', (-5.0, 5.0, "N·m")),
        # What is missing, or no limit at all.
        ("effort", 'effort="1e16" velocity="4"', (-1.0, 1.0, "N·m")),
        (
            "velocity",
            'effort="5" velocity="0"',
            (-1.0, 1.0, "rad/s"),
        ),
        ("effort", 'effort="0" velocity="4"', (-1.0, 1.0, "N·m")),
    ],
)
def test_ranges_are_those_of_the_joint(
    tmp_path: Path, interface: str, limit: str, expected: tuple[float, float, str]
) -> None:
    sim = forward(tmp_path, interface, limit=f'lower="-2" upper="1" {limit}')
    remote = panel.find(sim, "group", ForwardRemote)

    shown = slider(remote, f"value:swing/{interface}")

    assert (shown.lower, shown.upper, shown.unit) == expected
    has_zero = "zero" in panel.leaves(remote)
    assert has_zero == (interface != "position")


def test_the_hardware_may_have_narrower_limits() -> None:
    # Its joints have ±pi, the command interfaces ±1.
    sim = panel.simulate(load_real_robot("demo01_rrbot"))
    remote = panel.find(sim, "forward_position_controller", ForwardRemote)

    shown = slider(remote, "value:joint1/position")

    assert (shown.lower, shown.upper) == (-1.0, 1.0)


def test_a_velocity_holds_until_zero_is_clicked(tmp_path: Path) -> None:
    sim = forward(tmp_path, "velocity")
    remote = panel.find(sim, "group", ForwardRemote)

    panel.use(remote, "value:swing/velocity", 0.5)
    panel.run(sim, 1.0, remote)
    speed = sim.joint_states().velocity[0]
    panel.use(remote, "zero")
    panel.run(sim, 0.5, remote)

    # Tolerances of the velocity servo against gravity, see test_servo_modes.py.
    assert speed == pytest.approx(0.5, abs=5e-3)
    assert abs(sim.joint_states().velocity[0]) <= 5e-3
    assert slider(remote, "value:swing/velocity").value == 0.0


@pytest.mark.slow
def test_an_effort_is_a_force_at_the_joint(tmp_path: Path) -> None:
    sim = forward(tmp_path, "effort", dynamics='<dynamics damping="2.0"/>')
    remote = panel.find(sim, "group", ForwardRemote)
    effort = 2.0

    panel.use(remote, "value:swing/effort", effort)
    panel.run(sim, 8.0, remote)

    # It rests where the weight of the bob balances the effort.
    balance = math.asin(effort / (models.MASS * models.GRAVITY * models.LENGTH))
    # The swing decays with damping / (2 * inertia) = 4 / s: nothing is left.
    assert abs(panel.positions(sim)["swing"]) == pytest.approx(balance, abs=1e-6)


@pytest.mark.slow
def test_positions_that_nobody_sent_are_the_measured_ones(tmp_path: Path) -> None:
    yaml = FORWARD.format(joints="shoulder, elbow", interface="position")
    start = {"shoulder": 0.3, "elbow": -0.7}
    robot = models.load(tmp_path, models.TWO_LINKS, yaml, initial_positions=start)
    sim = panel.simulate(robot)
    remote = panel.find(sim, "group", ForwardRemote)
    first = slider(remote, "value:elbow/position")

    panel.use(remote, "value:shoulder/position", 0.5)
    panel.run(sim, 1.0, remote)

    assert first.value == pytest.approx(-0.7, abs=1e-4)
    assert abs(panel.positions(sim)["elbow"] + 0.7) <= FINAL
    assert abs(panel.positions(sim)["shoulder"] - 0.5) <= FINAL


@pytest.mark.slow
def test_references_of_a_pid_have_sliders(tmp_path: Path) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 200
    hold: {type: pid_controller/PidController}
hold:
  ros__parameters:
    dof_names: [swing]
    command_interface: effort
    reference_and_state_interfaces: [position, velocity]
    gains: {swing: {p: 60.0, i: 40.0, d: 12.0, u_clamp_max: 90.0, u_clamp_min: -90.0,
                    i_clamp_max: 50.0, i_clamp_min: -50.0}}
"""
    control = models.ros2_control("swing", command="effort")
    sim = panel.simulate(models.load(tmp_path, models.pendulum(control=control), yaml))
    remote = panel.find(sim, "hold", ForwardRemote)

    panel.use(remote, "value:swing/position", 0.5)
    panel.run(sim, 8.0, remote)

    assert set(panel.leaves(remote)) == {"value:swing/position"}
    # What the integral has still to do decays within seconds.
    assert abs(panel.positions(sim)["swing"] - 0.5) <= FINAL


@pytest.mark.slow
def test_topics_of_gazebo_have_sliders() -> None:
    robot = ad.load_robot("mycobot_280", xacro_args={"control": "gazebo"})
    sim = panel.simulate(robot)
    remote = panel.find(sim, "JointPositionController", TopicRemote)
    topic = "/model/mycobot_280/joint/link1_to_link2/cmd_pos"

    panel.use(remote, f"value:{topic}", 0.5)
    panel.run(sim, 4.0, remote)
    moved = panel.positions(sim)
    panel.use(remote, "close")
    panel.run(sim, 3.0, remote)

    # Its PIDs leave 0.05 rad at most, see tests/rollouts/test_mycobot_280.py.
    assert abs(moved["link1_to_link2"] - 0.5) <= 0.05
    assert slider(remote, f"value:{topic}").label == "link1_to_link2"
    assert abs(panel.positions(sim)["gripper_controller"] + 0.7) <= 0.05
    # The others were told nothing.
    other = slider(remote, f"value:{topic.replace('link1_to_link2', 'link2_to_link3')}")
    assert other.value == pytest.approx(
        panel.positions(sim)["link2_to_link3"], abs=1e-4
    )


@pytest.mark.slow
def test_velocities_of_gazebo_have_sliders(tmp_path: Path) -> None:
    drive = plugin("gz-sim-joint-controller-system", ("joint_name", "swing"))
    urdf = models.pendulum(control="").replace("</robot>", drive + "</robot>")
    sim = panel.simulate(models.load(tmp_path, urdf))
    remote = panel.find(sim, "JointController", TopicRemote)

    remote.command({"/model/pendulum/joint/swing/cmd_vel": 0.4})
    panel.run(sim, 1.0, remote)
    speed = sim.joint_states().velocity[0]
    remote.zero()
    panel.run(sim, 0.5, remote)

    assert speed == pytest.approx(0.4, abs=5e-3)
    assert abs(sim.joint_states().velocity[0]) <= 5e-3


@pytest.mark.slow
def test_a_topic_that_several_robots_have_is_told_to_one(tmp_path: Path) -> None:
    tags = (("joint_name", "swing"), ("topic", "go"))
    drive = plugin("gz-sim-joint-controller-system", *tags)
    urdf = models.pendulum(control="").replace("</robot>", drive + "</robot>")
    robots = [models.load(tmp_path, urdf, name=name) for name in ("left", "right")]
    sim = ad.Simulation(ad.build_diagram(robots))
    remote = panel.find(sim, "right/JointController", TopicRemote)

    panel.use(remote, "value:/go", 0.4)
    panel.run(sim, 0.5, remote)

    speeds = [sim.joint_states(name).velocity[0] for name in ("left", "right")]
    assert speeds == pytest.approx([0.0, 0.4], abs=5e-3)


def test_outputs_that_nobody_touches_are_left_alone() -> None:
    vacuum, analog = "flange_vacuum/vacuum", "flange_analog_IOs/analog_output1"
    sim = panel.simulate(load_real_robot("demo10_rrbot"))
    remote = panel.find(sim, "gpio_controller", GpioRemote)
    sim.run(0.1)
    before = commands(sim)

    panel.use(remote, f"value:{vacuum}", 1.0)
    panel.run(sim, 0.3, remote)

    after = commands(sim)
    assert set(panel.leaves(remote)) == {f"value:{analog}", f"value:{vacuum}", "zero"}
    assert after[vacuum] == 1.0
    np.testing.assert_equal(after[analog], before[analog])
    assert panel.nothing_lost(sim)


def commands(sim: ad.Simulation) -> dict[str, float]:
    """Return what all command interfaces hold."""
    (manager,) = sim.directory.managers.values()
    root = sim.simulator.get_context()
    values = manager.read_numbers(root, manager.numbers.values)
    return dict(zip(manager.commands, values, strict=True))


@pytest.mark.slow
def test_a_position_of_a_joint_without_end_is_the_nearest(tmp_path: Path) -> None:
    yaml = FORWARD.format(joints="swing", interface="position")
    urdf = models.pendulum(limit='effort="100" velocity="10"').replace(
        'type="revolute"', 'type="continuous"'
    )
    sim = panel.simulate(models.load(tmp_path, urdf, yaml))
    remote = panel.find(sim, "group", ForwardRemote)

    for angle in (1.5, 3.0, -3.0):
        panel.use(remote, "value:swing/position", angle)
        panel.run(sim, 1.5, remote)

    assert abs(panel.positions(sim)["swing"] - (2.0 * math.pi - 3.0)) <= FINAL
    assert slider(remote, "value:swing/position").value == pytest.approx(-3.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"swing": 1.0}, "no value 'swing'; did you mean 'swing/position'"),
        ({"swing/position": math.inf}, "swing/position: expected a finite number"),
    ],
)
def test_values_that_make_no_sense_are_refused(
    tmp_path: Path, values: dict[str, float], message: str
) -> None:
    sim = forward(tmp_path, "position")
    remote = panel.find(sim, "group", ForwardRemote)

    with pytest.raises(InputError, match=message):
        remote.command(values)
    with pytest.raises(InputError, match="none of its joints is known"):
        remote.close()


ADMITTANCE = """
controller_manager:
  ros__parameters:
    update_rate: 100
    soft: {type: admittance_controller/AdmittanceController}
soft:
  ros__parameters:
    joints: [shoulder, elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    chainable_command_interfaces: [position, velocity]
    kinematics:
      plugin_name: kinematics_interface_kdl/KinematicsInterfaceKDL
      plugin_package: kinematics_interface
      base: base
      tip: lower
    ft_sensor: {name: wrist, frame: {id: lower}}
    control: {frame: {id: lower}}
    fixed_world_frame: {frame: {id: base}}
    gravity_compensation: {frame: {id: lower}, CoG: {pos: [0, 0, 0], force: 0.0}}
    admittance:
      selected_axes: [false, false, false, false, false, false]
      mass: [5.0, 5.0, 5.0, 1.0, 1.0, 1.0]
      stiffness: [50.0, 50.0, 50.0, 50.0, 50.0, 50.0]
      damping_ratio: [2.0, 2.0, 2.0, 2.0, 2.0, 2.0]
"""


@pytest.mark.slow
def test_references_of_an_admittance_have_sliders(tmp_path: Path) -> None:
    sensor = '<sensor name="wrist">' + "".join(
        f'<state_interface name="{part}.{axis}"/>'
        for part in ("force", "torque")
        for axis in "xyz"
    )
    urdf = models.TWO_LINKS.replace(
        "</ros2_control>", sensor + "</sensor></ros2_control>"
    )
    robot = models.load(tmp_path, urdf, ADMITTANCE, pose=(0, 0, 2, 0, 0, 0))
    sim = panel.simulate(robot)
    remote = panel.find(sim, "soft", AdmittanceRemote)
    assert remote.is_active, str(sim.report)

    panel.use(remote, "value:elbow/position", 0.3)
    panel.run(sim, 3.0, remote)

    # No axis gives way here: what a jump of the reference excites dies out.
    assert abs(panel.positions(sim)["elbow"] - 0.3) <= FINAL
    assert abs(panel.positions(sim)["shoulder"]) <= FINAL
    assert panel.nothing_lost(sim)
