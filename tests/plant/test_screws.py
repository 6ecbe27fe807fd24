"""Poses of links at many positions at once, against Drake's one by one."""

import numpy as np
import pytest
from pydrake.multibody.tree import JacobianWrtVariable

from arm_drake.plant.kinematics import Screws
from arm_drake.plant.plant import trial_plant
from tests.robots import load_real_robot

# Of a chain of some rotations.
ROUNDING = 1e-12


# Six that turn; a lift that slides beneath fingers that do, too.
@pytest.mark.parametrize(
    ("name", "link"),
    [("kuka_kr6_agilus", "tool0"), ("open_manipulator_x", "gripper_left_link")],
)
def test_poses_and_jacobians_are_drakes(name: str, link: str) -> None:
    plant = trial_plant(load_real_robot(name))
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    body, above = plant.GetBodyByName(link), []
    frame = body.body_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    above = [int(at) for at in np.flatnonzero(J.any(axis=0))]
    qs = np.random.default_rng(0).uniform(-2.0, 2.0, (20, plant.num_positions()))

    R, p, found = Screws(plant, link, above).poses(qs[:, above])

    for k, q in enumerate(qs):
        plant.SetPositions(context, q)
        X = plant.EvalBodyPoseInWorld(context, body)
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
        )
        assert R[k] == pytest.approx(X.rotation().matrix(), abs=ROUNDING)
        assert p[k] == pytest.approx(X.translation(), abs=ROUNDING)
        assert found[k, :3] == pytest.approx(J[3:, above], abs=ROUNDING)
        assert found[k, 3:] == pytest.approx(J[:3, above], abs=ROUNDING)
