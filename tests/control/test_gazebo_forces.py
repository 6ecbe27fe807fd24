import numpy as np
import pytest

from arm_drake.controllers.gazebo.plugin import JointForces


def test_forces_go_to_their_joints() -> None:
    forces = JointForces.from_joints({"b": 1, "a": 0, "c": 1}, {}, {})

    assert forces.joints == ("b", "a", "c")
    assert forces.to_efforts(np.array([10.0, 20.0])).tolist() == [20.0, 10.0, 20.0]


def test_a_force_is_limited_where_it_acts() -> None:
    forces = JointForces.from_joints({"a": 0, "b": 1, "c": 2}, {}, {"a": 5.0, "b": 5.0})

    efforts = forces.to_efforts(np.array([7.0, -7.0, 7.0]))

    assert efforts.tolist() == [5.0, -5.0, 7.0]


@pytest.mark.parametrize("velocity", [1.0, -0.25])
def test_a_master_does_the_work_of_all_forces(velocity: float) -> None:
    followed = {"left": ("finger", -1.0), "slide": ("finger", 0.125)}
    at = {"left": 0, "slide": 1, "finger": 2}
    pushed = np.array([3.0, 16.0, 2.0])

    forces = JointForces.from_joints(at, followed, {})
    (effort,) = forces.to_efforts(pushed)

    assert forces.joints == ("finger",)
    # The coupling is rigid: it does no work.
    rates = np.array([-1.0 * velocity, 0.125 * velocity, velocity])
    assert effort * velocity == pushed @ rates


def test_a_master_carries_forces_without_one_of_its_own() -> None:
    followed = {"b": ("a", -2.0)}

    forces = JointForces.from_joints({"b": 0}, followed, {"a": 1.0, "b": 4.0})

    # The limit is that of the place, before the gear.
    assert forces.joints == ("a",)
    assert forces.to_efforts(np.array([5.0])).tolist() == [-8.0]


def test_without_joints_there_are_no_efforts() -> None:
    forces = JointForces.from_joints({}, {}, {})

    assert forces.to_efforts(np.array([1.0])).shape == (0,)
