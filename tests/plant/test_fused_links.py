"""The plant of a servo, in which links that are fixed to each other are one body."""

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

import arm_drake as ad
from arm_drake.hardware.drives import make_servo_plant
from arm_drake.options import SimulationOptions
from arm_drake.plant.plant import fuse_fixed_links, trial_plant
from tests.robots import load_real_robot

Array = NDArray[np.float64]

# Of a chain of some rotations, beside the largest number.
ROUNDING = 1e-13


def torques(plant: MultibodyPlant, q: Array, v: Array, vd: Array) -> Array:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    efforts: Array = plant.CalcInverseDynamics(context, vd, forces)
    return efforts


# Bodies before and after, the world among them: frames of tools and bases; fingers with
# pads; a gripper with five mimic joints behind an arm; a hand that slides.
@pytest.mark.parametrize(
    ("name", "num_before", "num_after"),
    [
        ("kuka_kr6_agilus", 11, 7),
        ("robotiq_2f85", 10, 7),
        ("ifra_irb120", 18, 10),
        ("interbotix_wx250s", 15, 10),
    ],
)
def test_fused_links_move_as_the_links(
    name: str, num_before: int, num_after: int
) -> None:
    whole = trial_plant(load_real_robot(name))
    fused = fuse_fixed_links(whole)

    assert fused is not None
    assert (whole.num_bodies(), fused.num_bodies()) == (num_before, num_after)
    n = whole.num_velocities()
    draws = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 3, n))
    expected = np.array([torques(whole, *draw) for draw in draws])
    found = np.array([torques(fused, *draw) for draw in draws])
    assert found == pytest.approx(expected, abs=ROUNDING * np.abs(expected).max())
    for get in (
        MultibodyPlant.GetPositionLowerLimits,
        MultibodyPlant.GetPositionUpperLimits,
    ):
        assert get(fused).tolist() == get(whole).tolist()
    for index in whole.GetJointActuatorIndices():
        old = whole.get_joint_actuator(index)
        new = fused.GetJointActuatorByName(old.name())
        ends = old.joint(), new.joint()
        assert len({joint.velocity_start() for joint in ends}) == 1
        assert len({joint.default_damping_vector()[0] for joint in ends}) == 1


@pytest.mark.parametrize("name", ["denso_cobotta", "create3"])
def test_what_has_nothing_fixed_to_a_moving_link_stays_as_it_is(name: str) -> None:
    robot = load_real_robot(name)
    trial = trial_plant(robot)
    assert fuse_fixed_links(trial) is None

    plant = make_servo_plant(
        robot.description, None, SimulationOptions(), trial.time_step(), trial
    )

    # The trial's own is looked at by others, with their rotors.
    assert plant is not trial
    assert plant.num_bodies() == trial.num_bodies()


def test_a_link_may_be_called_as_a_joint_with_a_number() -> None:
    link = "j_1"
    inertial = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        'iyz="0"/></inertial>'
    )
    urdf = (
        f'<robot name="r"><link name="base"/><link name="{link}">{inertial}</link>'
        f'<link name="tip">{inertial}</link>'
        f'<joint name="j" type="continuous"><parent link="base"/><child link="{link}"/>'
        f'</joint><joint name="k" type="fixed"><parent link="{link}"/>'
        '<child link="tip"/></joint></robot>'
    )

    whole = trial_plant(ad.load_robot(urdf, controllers=[]))
    fused = fuse_fixed_links(whole)

    assert fused is not None
    assert fused.num_bodies() == whole.num_bodies() - 2
