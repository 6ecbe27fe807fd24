import math

import numpy as np
import pytest

from arm_drake.controllers.gazebo.joint_controllers import JointPositionController
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Float64, TopicRejected
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings, push, send

A, B = "/model/arm/joint/a/cmd_pos", "/model/arm/joint/b/cmd_pos"

# Only a proportional gain.
P_ONLY = {"i_gain": 0.0, "d_gain": 0.0}


def make_tag(*joints: str, **fields: float) -> gazebo_plugins.JointPositionController:
    return gazebo_plugins.JointPositionController(joints, **fields)  # type: ignore[arg-type]


def drive(
    *tags: gazebo_plugins.JointPositionController,
    joints: tuple[str, ...] = ("a", "b"),
    rate: int = 1000,
    **more: object,
) -> Driven:
    params = make_surroundings(*joints, rate=rate, **more)
    return Driven(JointPositionController(tags, params))


def test_a_tag_has_a_topic_and_an_effort() -> None:
    system = drive(make_tag("a"), make_tag("b", topic="/b")).system

    assert system.command_interfaces == ("a/effort", "b/effort")
    assert system.message_types == {A: Float64, "/b": Float64}
    assert all(system.HasInputPort(topic) for topic in system.message_types)


def test_the_force_is_that_of_gazebos_defaults() -> None:
    driven = drive(make_tag("a"), rate=2, joints=("a",))
    driven.measure([0.25])

    # p 1, i 0.1, d 0.01, in steps of 0.5 s.
    assert send(driven, A, 1.25)["a/effort"] == pytest.approx(1.0 + 0.05 + 0.02)
    assert send(driven, A, 1.25)["a/effort"] == pytest.approx(1.0 + 0.10)


def test_until_a_message_comes_the_target_is_the_initial_position() -> None:
    driven = drive(
        make_tag("a", **P_ONLY), make_tag("b", initial_position=-2, **P_ONLY)
    )
    driven.measure([0.5, 0.0])

    driven.run()

    assert commands(driven) == {"a/effort": -0.5, "b/effort": -2.0}


def test_a_message_holds_until_the_next_one() -> None:
    driven = drive(make_tag("a", **P_ONLY), make_tag("b", **P_ONLY))

    assert send(driven, A, 2.0) == {"a/effort": 2.0, "b/effort": 0.0}
    assert send(driven, B, 3.0) == {"a/effort": 2.0, "b/effort": 3.0}
    assert send(driven, A, 4.0, 5.0) == {"a/effort": 5.0, "b/effort": 3.0}


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_dropped(bad: float) -> None:
    driven = drive(make_tag("a", **P_ONLY))
    send(driven, A, 2.0)
    message = Float64(bad)

    driven.run({A: message})
    driven.run()

    assert commands(driven) == {"a/effort": 2.0}
    reason = f"{A}: data must be finite, got {bad}; it is dropped"
    assert driven.output("events") == ((0, TopicRejected(message, reason)),)


def test_all_joints_of_a_tag_get_the_force_of_the_first() -> None:
    driven = drive(make_tag("a", "b", p_gain=3.0, **P_ONLY))
    driven.measure([1.0, 50.0])

    driven.run()

    assert commands(driven) == {"a/effort": -3.0, "b/effort": -3.0}


def test_tags_with_one_topic_all_hear_it() -> None:
    driven = drive(
        make_tag("a", topic="t", **P_ONLY),
        make_tag("b", topic="/t", p_gain=2.0, **P_ONLY),
    )

    assert send(driven, "/t", 1.0) == {"a/effort": 1.0, "b/effort": 2.0}


def test_of_two_tags_with_a_joint_the_last_one_moves_it() -> None:
    driven = drive(make_tag("a", "b", **P_ONLY), make_tag("a", p_gain=5.0, topic="t"))

    driven.measure([-1.0, 0.0])
    driven.run()

    # i_gain 0.1 and d_gain 0.01 after 1 ms.
    assert commands(driven)["a/effort"] == pytest.approx(5.0 + 1e-4 + 10.0)
    assert commands(driven)["b/effort"] == 1.0


def test_a_force_is_limited_by_its_joint() -> None:
    driven = drive(make_tag("a", **P_ONLY), effort_limits={"a": 5.0})

    assert send(driven, A, 7.0)["a/effort"] == 5.0
    assert send(driven, A, -7.0)["a/effort"] == -5.0


def test_a_master_carries_the_forces_of_its_followers() -> None:
    driven = drive(
        make_tag("a", **P_ONLY),
        make_tag("b", **P_ONLY),
        followed={"b": ("a", -0.5)},
        effort_limits={"a": 5.0, "b": 2.0},
    )
    driven.measure([1.0, -0.5])

    driven.run({B: Float64(-3.5)})

    # At a -1, at b -3, limited to -2: with v_b = -0.5 v_a that is worth 1 at a.
    assert commands(driven) == {"a/effort": -1.0 + 1.0}
    assert send(driven, A, 2.0) == {"a/effort": 1.0 + 1.0}


def test_velocity_commands_reach_the_target_in_one_step() -> None:
    driven = drive(make_tag("a", use_velocity_commands=True))
    driven.measure([0.25])

    assert send(driven, A, 0.75) == {"a/velocity": pytest.approx(0.5 / 1e-3)}


@pytest.mark.parametrize(("target", "velocity"), [(1.0, 3.0), (-1.0, -3.0)])
def test_velocity_commands_are_limited_by_cmd_max(
    target: float, velocity: float
) -> None:
    driven = drive(make_tag("a", use_velocity_commands=True, cmd_max=3.0))

    assert send(driven, A, target) == {"a/velocity": velocity}
    # 2 mm are less than what 3 m/s cover in a step.
    assert send(driven, A, 0.002) == {"a/velocity": pytest.approx(2.0)}


def test_a_mimic_joint_is_left_to_its_master_by_velocity_commands() -> None:
    fast = {"use_velocity_commands": True}
    follower = {"followed": {"b": ("a", 2.0)}}

    alone = drive(make_tag("b", **fast), **follower)
    both = drive(make_tag("a", **fast), make_tag("b", **P_ONLY), **follower)

    assert alone.system.command_interfaces == ()
    alone.run({B: Float64(1.0)})
    # The master's velocity is given: no force changes it.
    assert both.system.command_interfaces == ("a/velocity",)
    assert send(both, A, 0.5) == {"a/velocity": pytest.approx(500.0)}


def test_forces_and_velocities_are_side_by_side() -> None:
    driven = drive(
        make_tag("a", use_velocity_commands=True, cmd_max=1.0), make_tag("b", **P_ONLY)
    )
    send(driven, A, 1.0)

    assert send(driven, B, 4.0) == {"a/velocity": 1.0, "b/effort": 4.0}


def test_a_deactivation_ends_efforts_and_velocities() -> None:
    driven = drive(
        make_tag("a", use_velocity_commands=True, cmd_max=1.0), make_tag("b", **P_ONLY)
    )
    send(driven, A, 1.0)
    send(driven, B, 4.0)

    driven.run(activation=None)

    assert commands(driven) == {"a/velocity": 0.0, "b/effort": 0.0}


def test_an_activation_starts_anew() -> None:
    driven = drive(make_tag("a", i_gain=1000.0, d_gain=0.0, initial_position=0.5))
    send(driven, A, 4.0)
    driven.run(activation=None)

    driven.run(activation=2)

    # A target of 0.5, and the integral of one step of 1 ms.
    assert commands(driven) == {"a/effort": 0.5 + 0.5}


def test_messages_for_an_inactive_controller_are_rejected() -> None:
    driven = drive(make_tag("a", **P_ONLY))
    driven.run(activation=None)

    send(driven, A, 1.0, activation=None)
    driven.run(activation=1)

    assert commands(driven) == {"a/effort": 0.0}
    assert driven.reasons() == [f"{A}: the controller is not active"]


def test_unmeasured_joints_get_no_force() -> None:
    driven = drive(make_tag("a"), make_tag("b", **P_ONLY))
    driven.measure([np.nan, 1.0])

    driven.run()

    assert commands(driven) == {"a/effort": 0.0, "b/effort": -1.0}


# A mass of 1 kg that p and d would take to the target with 10 rad/s, without overshoot.
STIFF = {"p_gain": 100.0, "d_gain": 20.0}


@pytest.mark.slow
def test_without_an_integral_the_sag_is_load_over_gain() -> None:
    driven = drive(make_tag("a", i_gain=0.0, **STIFF), joints=("a",), rate=500)

    path = push(driven, 4.0, load=-3.0)

    # What is left of the motion falls below 41 e^-40.
    assert path[-1] == pytest.approx([-3.0 / 100.0, 0.0], abs=1e-12)


@pytest.mark.slow
def test_an_integral_takes_off_no_more_than_its_limit() -> None:
    # At its limit the integral is worth 1 N, and the rest is left to p.
    driven = drive(make_tag("a", i_gain=200.0, **STIFF), joints=("a",), rate=500)

    path = push(driven, 5.0, load=-3.0)

    assert path[-1] == pytest.approx([-2.0 / 100.0, 0.0], abs=1e-12)


@pytest.mark.slow
def test_an_integral_below_its_limit_takes_off_all() -> None:
    driven = drive(make_tag("a", i_gain=200.0, **STIFF), joints=("a",), rate=500)

    path = push(driven, 10.0, load=-0.5)

    # Of s^3 + 20 s^2 + 100 s + 200 = 0 the slowest poles are -3.1 +- 2.2j: e^-31 is
    # left, 3e-14.
    assert path[-1] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_step_is_that_of_a_second_order_system() -> None:
    omega, zeta, end = 10.0, 0.5, 0.3
    gains = {"p_gain": omega**2, "d_gain": 2.0 * zeta * omega, "i_gain": 0.0}

    def position(rate: int) -> float:
        tag = make_tag("a", initial_position=1.0, cmd_max=0, cmd_min=1, **gains)
        driven = drive(tag, joints=("a",), rate=rate)
        return float(push(driven, end)[-1, 0])

    # Sampling makes an error of first order in the step; two steps tell how large, and
    # what is left is of second order: (omega dt)^2, 1e-4. Gains that are wrong by 1 %
    # make 4e-4 and more.
    extrapolated = 2.0 * position(2000) - position(1000)

    # The first derivative starts from an error of 0: an impulse of -d per unit of the
    # error, so the mass starts with a velocity of d.
    damped = omega * math.sqrt(1.0 - zeta**2)
    start = 2.0 * zeta * omega
    phase = damped * end
    decay = math.exp(-zeta * omega * end)
    sine = (start - zeta * omega) / damped * math.sin(phase)
    expected = 1.0 - decay * (math.cos(phase) - sine)
    assert extrapolated == pytest.approx(expected, abs=(omega * 1e-3) ** 2)
