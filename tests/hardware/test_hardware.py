"""Commands reach the right joints, and states come from them, whatever the order."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

import arm_drake as ad
from tests import models

WEIGHT = models.MASS * models.GRAVITY * models.LENGTH


def point(positions: dict[str, float], at: float = 0.5) -> ad.JointTrajectory:
    """Return a trajectory to rest at one point, `at` seconds from its start."""
    end = ad.JointTrajectoryPoint(
        positions=tuple(positions.values()),
        velocities=(0.0,) * len(positions),
        time_from_start=at,
    )
    return ad.JointTrajectory(joint_names=tuple(positions), points=(end,))


def simulate(robot: ad.Robot, **options: object) -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(robot, world="void", **options))


def plant_and_context(simulation: ad.Simulation) -> tuple[MultibodyPlant, object]:
    plant = simulation.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant, plant.GetMyContextFromRoot(simulation.simulator.get_context())


@pytest.mark.parametrize(
    ("urdf", "order"), [(models.TIP_FIRST, [0, 1]), (models.TWO_LINKS, [1, 0])]
)
def test_joint_states_are_positions_velocities_efforts_as_the_file_orders_joints(
    tmp_path: Path, urdf: str, order: list[int]
) -> None:
    start = {"elbow": 0.4, "shoulder": -0.7}
    simulation = simulate(models.load(tmp_path, urdf, initial_positions=start))

    simulation.advance_to(0.5)

    # Held against gravity; the elbow carries one bob, the shoulder both.
    lower = WEIGHT * math.sin(0.4 - 0.7)
    shoulder = 2.0 * WEIGHT * math.sin(-0.7) + lower
    port = simulation.diagram.GetOutputPort("joint_states")
    values = port.Eval(simulation.simulator.get_context())
    expected = np.array([[0.4, -0.7], [0.0, 0.0], [lower, shoulder]])[:, order]
    np.testing.assert_allclose(values, expected.ravel(), rtol=1e-9, atol=1e-12)


def test_joint_states_in_motion_are_those_of_the_plant(tmp_path: Path) -> None:
    controllers = models.trajectory_controllers({"arm": ["shoulder", "elbow"]})
    simulation = simulate(models.load(tmp_path, models.TIP_FIRST, controllers))
    simulation.controller("arm").send_trajectory(
        point({"shoulder": 0.5, "elbow": -1.0})
    )

    simulation.advance_to(0.25)

    states = simulation.joint_states()
    plant, context = plant_and_context(simulation)
    assert states.name == ("elbow", "shoulder")
    for name, position, velocity in zip(
        states.name, states.position, states.velocity, strict=True
    ):
        joint = plant.GetJointByName(name)
        assert position == joint.get_angle(context)
        assert velocity == joint.get_angular_rate(context)
    assert states.velocity[0] < -1.0
    assert states.velocity[1] > 0.5


@pytest.mark.slow
def test_a_controller_s_joints_move_whatever_their_order(tmp_path: Path) -> None:
    # The file has elbow first, the tree the shoulder, the controller again another.
    controllers = models.trajectory_controllers({"arm": ["shoulder", "elbow"]})
    simulation = simulate(models.load(tmp_path, models.TIP_FIRST, controllers))
    simulation.controller("arm").send_trajectory(
        point({"elbow": -1.0, "shoulder": 0.5})
    )

    simulation.advance_to(1.5)

    np.testing.assert_allclose(
        simulation.joint_states().position, [-1.0, 0.5], atol=1e-9
    )


@pytest.mark.slow
def test_joints_that_nobody_claims_hold_their_initial_positions(tmp_path: Path) -> None:
    start = {"shoulder": 0.8, "elbow": -0.6}
    controllers = models.trajectory_controllers({"arm": ["elbow"]})
    robot = models.load(
        tmp_path, models.TWO_LINKS, controllers, initial_positions=start
    )
    simulation = simulate(robot)
    simulation.controller("arm").send_trajectory(point({"elbow": 0.6}))

    simulation.advance_to(1.5)

    rollout = simulation.rollout()
    # Held exactly, though the elbow's motion pulls at it.
    np.testing.assert_allclose(rollout.position[:, 0], 0.8, atol=1e-9)
    assert rollout.position[-1, 1] == pytest.approx(0.6, abs=1e-9)


def test_joints_without_any_controller_hold_their_initial_positions(
    tmp_path: Path,
) -> None:
    start = {"shoulder": 0.8, "elbow": -0.6}
    simulation = simulate(
        models.load(tmp_path, models.TWO_LINKS, initial_positions=start)
    )

    simulation.advance_to(1.0)

    assert simulation.joint_states().position == pytest.approx((0.8, -0.6), abs=1e-9)


@pytest.mark.slow
def test_two_controllers_each_command_their_own_joints(tmp_path: Path) -> None:
    controllers = models.trajectory_controllers({"a": ["elbow"], "b": ["shoulder"]})
    simulation = simulate(models.load(tmp_path, models.TWO_LINKS, controllers))
    simulation.controller("a").send_trajectory(point({"elbow": -0.9}))
    simulation.controller("b").send_trajectory(point({"shoulder": 0.4}))

    simulation.advance_to(1.5)

    np.testing.assert_allclose(
        simulation.joint_states().position, [0.4, -0.9], atol=1e-9
    )


@pytest.mark.slow
def test_two_controllers_do_what_one_does(tmp_path: Path) -> None:
    goal = {"shoulder": 0.4, "elbow": -0.9}
    rollouts = []
    for joints_of in (
        {"a": ["elbow"], "b": ["shoulder"]},
        {"a": ["shoulder", "elbow"]},
    ):
        controllers = models.trajectory_controllers(joints_of)
        simulation = simulate(models.load(tmp_path, models.TWO_LINKS, controllers))
        for name, joints in joints_of.items():
            simulation.controller(name).send_trajectory(
                point({joint: goal[joint] for joint in joints})
            )
        simulation.advance_to(1.0)
        rollouts.append(simulation.rollout())

    # Desired velocities arrive too, else it would lag.
    np.testing.assert_allclose(rollouts[0].position, rollouts[1].position, atol=1e-12)
    np.testing.assert_allclose(rollouts[0].velocity, rollouts[1].velocity, atol=1e-10)


@pytest.mark.slow
def test_of_a_partly_commanded_robot_only_commanded_joints_apply_effort(
    tmp_path: Path,
) -> None:
    controllers = models.trajectory_controllers({"a": ["first"], "b": ["third"]})
    robot = models.load(tmp_path, models.PARTLY_COMMANDED, controllers)
    simulation = simulate(robot)
    simulation.controller("a").send_trajectory(point({"first": 0.3}))
    simulation.controller("b").send_trajectory(point({"third": 0.7}))

    simulation.advance_to(2.0)

    # All stays in a plane: the second joint turns about the arm, and isn't driven.
    states = simulation.joint_states()
    assert states.name == ("first", "second", "third")
    assert states.position == pytest.approx((0.3, 0.0, 0.7), abs=1e-9)
    third = WEIGHT * math.sin(1.0)
    first = WEIGHT * (math.sin(0.3) + 2.0 * math.sin(0.3)) + third
    # The second bob hangs below the second joint, which is below the first.
    second_and_third_joint = WEIGHT * math.sin(0.3)
    assert states.effort == pytest.approx(
        (first + 2.0 * second_and_third_joint, 0.0, third), rel=1e-9
    )


def test_a_robot_without_commanded_joints_runs(tmp_path: Path) -> None:
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    simulation = simulate(models.load(tmp_path, urdf, initial_positions={"swing": 0.5}))

    simulation.advance_to(0.5)

    (position,) = simulation.joint_states().position
    assert position < 0.4
    assert simulation.joint_states().effort == (0.0,)


@pytest.mark.slow
def test_effort_is_what_the_actuator_applies_friction_left_out(tmp_path: Path) -> None:
    urdf = models.pendulum(dynamics='<dynamics friction="2"/>')
    # A tick per step, for between ticks the command stands still.
    controllers = models.trajectory_controllers({"arm": ["swing"]}, update_rate=1000)
    simulation = simulate(models.load(tmp_path, urdf, controllers))
    simulation.controller("arm").send_trajectory(point({"swing": 1.0}, at=2.0))

    simulation.advance_to(1.0)

    # Halfway it is fastest: the actuator lifts the bob, beats friction, no more. The
    # command is that of the last tick, so v h behind: the servo brakes by kp M v h.
    states = simulation.joint_states()
    lifting = WEIGHT * math.sin(states.position[0])
    kp = ((1.0 - math.exp(-40.0 * 1e-3)) / 1e-3) ** 2
    braking = kp * models.INERTIA * states.velocity[0] * 1e-3
    assert states.effort[0] == pytest.approx(lifting + 2.0 - braking, rel=1e-3)
    plant, context = plant_and_context(simulation)
    applied = plant.get_net_actuation_output_port().Eval(context)
    assert states.effort == pytest.approx(applied, rel=1e-12)


@pytest.mark.parametrize("has_world_link", [False, True])
def test_a_tilted_robot_is_held_as_an_upright_one(
    tmp_path: Path, has_world_link: bool
) -> None:
    urdf = models.pendulum()
    if has_world_link:
        urdf = urdf.replace(
            '<link name="base"/>',
            '<link name="world"/><link name="base"/><joint name="mount" type="fixed">'
            '<parent link="world"/><child link="base"/></joint>',
        )
    pose = (0.0, 0.0, 1.0, 0.0, math.pi / 2, 0.0)
    simulation = simulate(models.load(tmp_path, urdf, pose=pose))

    simulation.advance_to(0.5)

    # Turned by a quarter about y: the bob sticks out, gravity acts in full.
    np.testing.assert_allclose(simulation.rollout().position, 0.0, atol=1e-12)
    assert simulation.joint_states().effort == pytest.approx((WEIGHT,), rel=1e-12)
