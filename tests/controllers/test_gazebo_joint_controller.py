import math

import numpy as np
import pytest

from arm_drake.controllers.gazebo.joint_controllers import JointController
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Float64
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings, push, send

A, B = "/model/arm/joint/a/cmd_vel", "/model/arm/joint/b/cmd_vel"


def make_tag(*joints: str, **fields: float) -> gazebo_plugins.JointController:
    return gazebo_plugins.JointController(joints, **fields)  # type: ignore[arg-type]


def make_force_tag(*joints: str, **fields: float) -> gazebo_plugins.JointController:
    return make_tag(*joints, use_force_commands=True, **fields)


def drive(
    *tags: gazebo_plugins.JointController,
    joints: tuple[str, ...] = ("a", "b"),
    rate: int = 1000,
    **more: object,
) -> Driven:
    params = make_surroundings(*joints, rate=rate, **more)
    return Driven(JointController(tags, params))


def test_a_message_is_the_velocity() -> None:
    driven = drive(make_tag("a", initial_velocity=0.5), make_tag("b"))

    driven.run()
    at_start = commands(driven)

    assert driven.system.message_types == {A: Float64, B: Float64}
    assert at_start == {"a/velocity": 0.5, "b/velocity": 0.0}
    assert send(driven, B, -2.0) == {"a/velocity": 0.5, "b/velocity": -2.0}


def test_all_joints_of_a_tag_have_the_velocity() -> None:
    driven = drive(make_tag("a", "b"))

    assert send(driven, A, 2.0) == {"a/velocity": 2.0, "b/velocity": 2.0}


def test_a_value_that_is_not_finite_is_dropped() -> None:
    driven = drive(make_tag("a"))
    send(driven, A, 2.0)

    assert send(driven, A, math.nan) == {"a/velocity": 2.0}
    assert driven.reasons() == [f"{A}: data must be finite, got nan; it is dropped"]


def test_a_force_follows_from_the_velocity() -> None:
    # p 2, i 4 in steps of 0.5 s, of a velocity that is 0.25 too high.
    driven = drive(make_force_tag("a", "b", p_gain=2.0, i_gain=4.0), rate=2)
    driven.measure([9.0, 9.0, 1.25, 7.0])

    first = send(driven, A, 1.0)
    driven.run()

    assert first == {"a/effort": -0.5 - 0.5, "b/effort": -0.5 - 0.5}
    # The integral ends at 1.
    assert commands(driven)["a/effort"] == -0.5 - 1.0
    driven.run()
    assert commands(driven)["a/effort"] == -0.5 - 1.0


@pytest.mark.parametrize(
    ("target", "velocity", "effort"),
    [
        (2.0, 1.0, 1.0),
        (2.0, 2.0, 0.0),
        (2.0, 3.0, 0.0),
        (2.0, -1.0, 3.0),
        (-2.0, -1.0, -1.0),
        (-2.0, -3.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, -1.0, 0.0),
    ],
)
def test_without_braking_a_fast_joint_runs_free(
    target: float, velocity: float, effort: float
) -> None:
    driven = drive(make_force_tag("a", disable_braking=True), make_force_tag("b"))
    driven.measure([0.0, 0.0, velocity, 1.0])

    # The other joint brakes.
    assert send(driven, A, target) == {"a/effort": effort, "b/effort": -1.0}


def test_a_joint_that_runs_free_leaves_the_integral_as_it_is() -> None:
    driven = drive(
        make_force_tag("a", disable_braking=True, p_gain=0.0, i_gain=2.0), rate=2
    )
    driven.measure([0.0, 0.0, 0.75])
    send(driven, A, 1.0)
    driven.measure([0.0, 0.0, 99.0])
    driven.run()
    assert commands(driven) == {"a/effort": 0.0}

    driven.measure([0.0, 0.0, 0.5])
    driven.run()

    # i dt = 1.
    assert commands(driven) == {"a/effort": 0.25 + 0.5}


def test_a_master_carries_forces_and_has_velocities_of_its_own() -> None:
    follower = {"followed": {"b": ("a", 3.0)}, "effort_limits": {"b": 2.0}}

    by_force = drive(make_force_tag("b", p_gain=10.0), **follower)
    by_velocity = drive(make_tag("a"), make_tag("b"), **follower)

    assert send(by_force, B, 1.0) == {"a/effort": 3.0 * 2.0}
    send(by_velocity, B, 1.0)
    assert commands(by_velocity) == {"a/velocity": 0.0}


def test_a_deactivation_ends_efforts_and_velocities() -> None:
    driven = drive(make_tag("a"), make_force_tag("b"))
    driven.measure([0.0, 0.0, 0.25, 0.5])
    send(driven, A, 1.0)
    assert send(driven, B, 1.0) == {"a/velocity": 1.0, "b/effort": 0.5}

    driven.run(activation=None)

    assert commands(driven) == {"a/velocity": 0.0, "b/effort": 0.0}


def test_an_activation_starts_from_the_initial_velocity() -> None:
    driven = drive(make_tag("a", initial_velocity=0.5))
    send(driven, A, 2.0)
    driven.run(activation=None)

    driven.run(activation=2)

    assert commands(driven) == {"a/velocity": 0.5}


def test_a_force_with_p_alone_closes_in_exponentially() -> None:
    # v_k+1 = v_k - p dt (v_k - r) / m, of a mass of 2 kg.
    tag = make_force_tag("a", p_gain=4.0, initial_velocity=3.0)

    path = push(drive(tag, joints=("a",), rate=100), 1.0, mass=2.0)

    steps = np.arange(len(path))
    expected = 3.0 * (1.0 - (1.0 - 4.0 / 100 / 2.0) ** steps)
    # Rounding alone.
    np.testing.assert_allclose(path[:, 1], expected, rtol=0.0, atol=1e-13)


def test_without_braking_a_load_carries_a_joint_away() -> None:
    tag = make_force_tag("a", p_gain=4.0, initial_velocity=1.0, disable_braking=True)

    path = push(drive(tag, joints=("a",), rate=100), 2.0, load=6.0)

    # Above the target there is no force, and 6 N give a kilogram 6 m/s^2.
    (late,) = np.diff(path[-2:, 1])
    assert path[-1, 1] > 10.0
    assert late == pytest.approx(6.0 / 100)
