"""Effort and velocity that a controller limits at run time, in closed form."""

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.messages import JointState, ParallelGripperCommandGoal
from tests.models import GRAVITY, INERTIA, LENGTH, MASS, bob, joint

YAML = """
controller_manager:
  ros__parameters:
    update_rate: 200
    gripper: {type: parallel_gripper_action_controller/GripperActionController}
    speeds: {type: velocity_controllers/JointGroupVelocityController}
    efforts: {type: effort_controllers/JointGroupEffortController}
gripper:
  ros__parameters:
    joint: swing
    max_effort_interface: swing/effort
    max_velocity_interface: swing/velocity
    max_velocity: 0.3
    max_effort: 3.0
    allow_stalling: true
speeds: {ros__parameters: {joints: [swing]}}
efforts: {ros__parameters: {joints: [swing]}}
"""

INTERFACES = "".join(
    f'<command_interface name="{name}"/>' for name in ("position", "velocity", "effort")
)
CONTROL = f"""
  <ros2_control name="hardware" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="swing">{INTERFACES}
      <state_interface name="position"/><state_interface name="velocity"/>
    </joint>
  </ros2_control>"""


def simulate(folder, *, distro="jazzy", yaml=YAML, **options):
    (folder / "swing.urdf").write_text(
        f'<robot name="swing"><link name="base"/>{bob("bob")}'
        f"{joint('swing', 'base', 'bob')}{CONTROL}</robot>",
        encoding="utf-8",
    )
    (folder / "controllers.yaml").write_text(yaml, encoding="utf-8")
    robot = ad.load_robot(
        folder / "swing.urdf", controllers=folder / "controllers.yaml", distro=distro
    )
    options = ad.SimulationOptions(**options)
    return ad.Simulation(ad.build_diagram(robot, world="void", options=options))


def goal(position, *, velocity=(), effort=()):
    state = JointState(position=(position,), velocity=velocity, effort=effort)
    return ParallelGripperCommandGoal(state)


@pytest.mark.slow
@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted", "rolling"])
def test_a_joint_keeps_the_largest_velocity(tmp_path, distro):
    sim = simulate(tmp_path, distro=distro, gravity=False)

    sim.controller("gripper").send_goal(goal(1.0))
    sim.advance_to(2.0)

    rollout = sim.rollout()
    speed = np.abs(rollout.velocity[:, 0])
    # It gets there like exp(-40 t) and stays, to rounding.
    assert speed.max() <= 0.3 * (1.0 + 1e-6)
    at = rollout.position[np.searchsorted(rollout.time, 1.0), 0]
    # 1 s at this velocity, less the time constant of the start, half of 1/40 s; to a
    # tick.
    assert at == pytest.approx(0.3 * (1.0 - 0.5 / 40.0), abs=0.3 * 5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("distro", ["jazzy", "rolling"])
def test_a_joint_that_is_led_keeps_the_largest_velocity_too(tmp_path, distro):
    sim = simulate(tmp_path, distro=distro, gravity=False)
    # Goals one after the other make a ramp of 1 rad/s.
    for step in range(200):
        sim.controller("gripper").send_goal(goal(0.005 * step))
        sim.advance_to(sim.time + 0.005)

    assert np.abs(sim.rollout().velocity).max() <= 0.3 * (1.0 + 1e-6)


# A constant effort does the work effort * q: on speed, and on lifting the bob.
@pytest.mark.slow
def test_a_joint_keeps_the_largest_effort(tmp_path):
    sim = simulate(tmp_path)

    sim.controller("gripper").send_goal(goal(1.5, velocity=(5.0,)))
    sim.advance_to(0.5)

    rollout = sim.rollout()
    np.testing.assert_allclose(rollout.effort[1:, 0], 3.0, rtol=1e-12)
    q, v = rollout.position[:, 0], rollout.velocity[:, 0]
    lifted = MASS * GRAVITY * LENGTH * (1.0 - np.cos(q))
    # First order in the step of 1 ms: acceleration is up to 12 rad/s^2, speed 3 rad/s.
    np.testing.assert_allclose(0.5 * INERTIA * v**2 + lifted, 3.0 * q, atol=0.01)
    assert v.max() > 2.0


@pytest.mark.slow
def test_no_limit_is_one_of_zero(tmp_path):
    sim = simulate(tmp_path)

    sim.controller("gripper").send_goal(goal(1.5, velocity=(0.0,), effort=(0.0,)))
    sim.advance_to(1.0)

    assert sim.joint_states().position[0] == pytest.approx(1.5, abs=1e-3)
    assert np.abs(sim.rollout().effort).max() > 4.0


@pytest.mark.slow
@pytest.mark.parametrize("other", ["speeds", "efforts"])
def test_who_takes_over_starts_from_rest_not_from_a_limit(tmp_path, other):
    sim = simulate(tmp_path)
    sim.controller("gripper").send_goal(goal(0.4))
    sim.advance_to(4.0)
    assert sim.joint_states().position[0] == pytest.approx(0.4, abs=1e-3)

    sim.switch_controllers([other], ["gripper"])
    sim.advance_to(5.0)

    # A velocity of none, or the effort that it applied.
    assert sim.joint_states().position[0] == pytest.approx(0.4, abs=1e-3)


@pytest.mark.slow
def test_limits_end_with_their_controller(tmp_path):
    sim = simulate(tmp_path, gravity=False)
    sim.controller("gripper").send_goal(goal(0.4))
    sim.advance_to(3.0)

    sim.switch_controllers(["speeds"], ["gripper"])
    sim.controller("speeds").command([2.0])
    sim.advance_to(3.5)

    assert sim.joint_states().velocity[0] == pytest.approx(2.0, rel=1e-3)


@pytest.mark.slow
def test_two_limits_are_two_interfaces(tmp_path):
    yaml = YAML.replace("swing/velocity", "swing/effort")

    sim = simulate(tmp_path, yaml=yaml)

    assert any("must be two interfaces" in entry.what for entry in sim.report)
