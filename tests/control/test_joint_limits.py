"""Commands of one joint, held to hard and soft limits."""

import math

import pytest

from arm_drake.control.joint_limits import (
    NO_COMMAND,
    JointControlInterfacesData,
    LimitedCommand,
    PositionOutOfBoundsError,
    limit,
)
from arm_drake.description.joint_limits import JointLimits, SoftJointLimits

NAN, INF, PI = math.nan, math.inf, math.pi

Data = JointControlInterfacesData
POSITIONS = JointLimits(-PI, PI)
# One degree per second.
SOFT_SPEED = PI / 180


def run(
    limits: JointLimits,
    desired: Data,
    measured: Data = NO_COMMAND,
    previous: Data = NO_COMMAND,
    *,
    soft: SoftJointLimits | None = None,
    dt: float = 1.0,
) -> LimitedCommand:
    return limit(limits, soft, previous, measured, desired, dt)


def position(limits: JointLimits, desired: float, *args, **kwargs) -> float:
    found = run(limits, Data(desired), *args, **kwargs)
    assert found.is_limited == (found.command.position != desired)
    return found.command.position


def velocity(limits: JointLimits, desired: float, *args, **kwargs) -> float:
    found = run(limits, Data(velocity=desired), *args, **kwargs)
    assert found.is_limited == (found.command.velocity != desired)
    return found.command.velocity


def effort(limits: JointLimits, desired: float, *args, **kwargs) -> float:
    found = run(limits, Data(effort=desired), *args, **kwargs)
    assert found.is_limited == (found.command.effort != desired)
    return found.command.effort


@pytest.mark.parametrize(
    ("desired", "limited"), [(4.0, PI), (-5.0, -PI), (0.5, 0.5), (PI, PI), (INF, PI)]
)
@pytest.mark.parametrize("soft", [None, SoftJointLimits()])
def test_a_position_is_held_to_its_range(soft, desired, limited):
    assert position(POSITIONS, desired, soft=soft) == limited


@pytest.mark.parametrize(
    ("limits", "desired", "limited"),
    [
        (JointLimits(min_position=-1.0), -2.0, -1.0),
        (JointLimits(min_position=-1.0), 9.0, 9.0),
        (JointLimits(max_position=1.0), 2.0, 1.0),
        (JointLimits(max_position=1.0), -9.0, -9.0),
        (JointLimits(), 99.0, 99.0),
        # Upstream swaps two that are the wrong way round.
        (JointLimits(2.0, -2.0), 3.0, 2.0),
        (JointLimits(2.0, -2.0), 1.0, 1.0),
    ],
)
def test_a_limit_that_is_not_given_does_not_hold(limits, desired, limited):
    assert position(limits, desired) == limited


def test_a_position_moves_no_faster_than_the_joint_from_the_command_before():
    limits = JointLimits(-PI, PI, max_velocity=2.0)
    previous, measured = Data(1.0), Data(0.5)

    assert position(limits, 3.0, measured, previous, dt=0.1) == 1.2
    assert position(limits, -3.0, measured, previous, dt=0.1) == 0.8
    assert position(limits, 1.1, measured, previous, dt=0.1) == 1.1


def test_a_joint_of_speed_zero_stays_where_it_is():
    limits = JointLimits(max_velocity=0.0)

    assert position(limits, 3.0, Data(0.5), Data(1.0)) == 1.0
    assert velocity(limits, 3.0, Data(0.5), Data(1.0)) == 0.0


def test_the_first_position_starts_from_the_measured_one():
    limits = JointLimits(-PI, PI, max_velocity=2.0)

    assert position(limits, 3.0, Data(0.5), dt=0.1) == 0.7
    assert position(limits, 3.0, Data(0.5), Data(effort=1.0), dt=0.1) == 0.7
    assert position(limits, 3.0, dt=0.1) == 3.0
    # Nothing says from where.
    assert position(limits, 3.0, previous=Data(effort=1.0), dt=0.1) == 3.0


def test_a_range_that_the_command_before_has_left_is_reached_at_once():
    limits = JointLimits(-1.0, 1.0, max_velocity=1.0)

    assert position(limits, 5.0, previous=Data(2.0), dt=0.1) == 1.0
    assert position(limits, -5.0, previous=Data(2.0), dt=0.1) == 1.0
    assert position(limits, 5.0, previous=Data(-2.0), dt=0.1) == -1.0


@pytest.mark.parametrize(
    ("measured", "limited"),
    [
        (None, 0.1),
        (0.0, 0.1),
        # 0.5 + 10 * 0.1
        (-0.5, 0.15),
        (0.5, 0.15),
        (7.0, 0.2),
    ],
)
def test_an_acceleration_limit_slows_a_position_down(measured, limited):
    limits = JointLimits(max_velocity=2.0, max_acceleration=10.0)
    state, previous = Data(0.0, measured), Data(0.0)

    found = position(limits, 3.0, state, previous, dt=0.1)

    assert found == pytest.approx(limited, rel=1e-12)


def test_an_acceleration_limit_alone_does_not_slow_a_position_down():
    limits = JointLimits(max_acceleration=10.0)

    assert position(limits, 3.0, Data(0.0, 0.0), Data(0.0), dt=0.1) == 3.0


@pytest.mark.parametrize(("q", "end"), [(1.0088, 1.0), (-1.0088, -1.0)])
@pytest.mark.parametrize("soft", [None, SoftJointLimits(-0.5, 0.5, 1.0)])
def test_no_position_is_commanded_far_out_of_bounds(soft, q, end):
    limits = JointLimits(-1.0, 1.0)

    with pytest.raises(PositionOutOfBoundsError) as caught:
        run(limits, Data(0.0, effort=1.0), Data(q), soft=soft)

    assert str(caught.value) == (
        f"the joint is at {q}; expected it between -1.0 and 1.0, or less than 0.0087 "
        "beyond"
    )
    assert isinstance(caught.value, ValueError)
    assert caught.value.previous == Data(q, effort=1.0)
    assert position(limits, 0.0, Data(end * 1.0086)) == 0.0


@pytest.mark.parametrize("desired", [Data(NAN), Data(velocity=0.5), Data(effort=0.5)])
def test_other_commands_far_out_of_bounds_are_no_error(desired):
    found = run(JointLimits(-1.0, 1.0), desired, Data(9.0))

    assert not found.is_limited


NEAR = 5.0 + 0.001
FAR = 5.0 + 0.004


@pytest.mark.parametrize(
    ("q", "desired", "limited"),
    [
        (None, 2.0, 1.0),
        (None, -INF, -1.0),
        (None, 0.8, 0.8),
        (0.0, 2.0, 1.0),
        # As far as the range goes within the period of 1 s.
        (4.5, 5.0, 0.5),
        (4.5, 0.3, 0.3),
        (5.0, 0.9, 0.0),
        (5.0, -0.9, -0.9),
        (-4.75, -6.0, -0.25),
        (-5.0, -1.0, 0.0),
        # Slightly outside, only back.
        (NEAR, 3.0, 0.0),
        (NEAR, 0.0, 0.0),
        (NEAR, -0.2, -0.2),
        (NEAR, -2.0, -1.0),
        (-NEAR, -3.0, 0.0),
        (-NEAR, 0.0, 0.0),
        (-NEAR, 0.2, 0.2),
        (-NEAR, 2.0, 1.0),
        # Farther outside, not at all.
        (FAR, -2.0, 0.0),
        (FAR, 2.0, 0.0),
        (-FAR, -2.0, 0.0),
        (-FAR, 2.0, 0.0),
    ],
)
def test_a_velocity_does_not_leave_the_range_of_positions(q, desired, limited):
    limits = JointLimits(-5.0, 5.0, max_velocity=1.0)

    assert velocity(limits, desired, Data(q)) == limited


def test_a_joint_slightly_outside_moves_back_within_one_period():
    limits = JointLimits(-5.0, 5.0, max_velocity=1.0)

    # Faster than its limit, as upstream: [-1, -10] is taken as [-10, -1].
    found = velocity(limits, -20.0, Data(NEAR), dt=1e-4)

    assert found == pytest.approx(-10.0, rel=1e-9)
    assert velocity(limits, -0.5, Data(NEAR), dt=1e-4) == -1.0


def test_a_velocity_changes_no_faster_than_the_joint_from_the_command_before():
    limits = JointLimits(max_velocity=1.0, max_acceleration=5.0)
    measured = Data(0.0, -0.9)

    for desired, limited in ((0.9, 0.7), (-0.9, -0.3), (0.3, 0.3)):
        previous = Data(velocity=0.2)
        assert velocity(limits, desired, measured, previous, dt=0.1) == limited
    assert velocity(limits, 3.0, measured, Data(velocity=0.8), dt=0.1) == 1.0
    assert velocity(limits, 3.0, previous=Data(1.0), dt=0.1) == 1.0


def test_a_first_velocity_slows_down_as_if_the_joint_had_it_already():
    limits = JointLimits(max_velocity=1.0, max_acceleration=5.0)

    # As upstream: [2.5, 1] is taken as [1, 2.5].
    assert velocity(limits, 3.0, dt=0.1) == 2.5
    assert velocity(limits, 3.0, Data(0.0, 0.5), dt=0.1) == 1.0


def test_a_joint_far_outside_stops_as_fast_as_it_can():
    limits = JointLimits(-1.0, 1.0, max_velocity=1.0, max_acceleration=5.0)

    # Between 0.8 - 0.5 and 0, in the other order.
    assert velocity(limits, 2.0, Data(FAR), Data(velocity=0.8), dt=0.1) == (
        pytest.approx(0.3, rel=1e-12)
    )
    assert velocity(limits, -2.0, Data(FAR), Data(velocity=0.8), dt=0.1) == 0.0


@pytest.mark.parametrize("soft", [None, SoftJointLimits(-0.5, 0.5, 1.0)])
def test_without_a_velocity_limit_a_velocity_passes(soft):
    limits = JointLimits(-1.0, 1.0, max_acceleration=1.0)
    measured, previous = Data(1.0, 0.0), Data(velocity=0.0)

    assert velocity(limits, 99.0, measured, previous, soft=soft) == 99.0


@pytest.mark.parametrize(
    ("q", "v", "desired", "limited"),
    [
        (0.0, 0.0, 20.0, 10.0),
        (0.0, 0.0, -20.0, -10.0),
        (0.0, 0.0, 5.0, 5.0),
        # At an end and not moving back.
        (5.0, 0.0, 20.0, 0.0),
        (5.0, 0.1, 20.0, 0.0),
        (5.0, 0.1, -20.0, -10.0),
        (5.0, -0.1, 20.0, 10.0),
        (-5.0, 0.0, -20.0, 0.0),
        (-5.0, -0.1, -20.0, 0.0),
        (-5.0, -0.1, 20.0, 10.0),
        (-5.0, 0.1, -20.0, -10.0),
        # Too fast.
        (0.0, 1.1, 20.0, 0.0),
        (0.0, 1.1, -20.0, -10.0),
        (0.0, -1.1, -20.0, 0.0),
        (0.0, -1.1, 20.0, 10.0),
        (0.0, 1.0, 20.0, 10.0),
        (0.0, -1.0, -20.0, -10.0),
        (None, 1.1, 20.0, 0.0),
        # It takes both to know.
        (5.0, None, 20.0, 10.0),
        (None, 0.0, 20.0, 10.0),
    ],
)
def test_an_effort_does_not_push_a_joint_out_of_its_limits(q, v, desired, limited):
    limits = JointLimits(-5.0, 5.0, max_velocity=1.0, max_effort=10.0)

    assert effort(limits, desired, Data(q, v)) == limited


def test_without_an_effort_limit_an_effort_passes():
    limits = JointLimits(-5.0, 5.0, max_velocity=1.0)
    soft = SoftJointLimits(-4.0, 4.0, 1.0, 1.0)

    assert effort(limits, 99.0, Data(5.0, 2.0)) == 99.0
    assert effort(limits, 99.0, Data(5.0, 2.0), soft=soft) == 99.0


def test_an_effort_knows_no_limits_but_those_that_are_given():
    assert effort(JointLimits(max_effort=10.0), 20.0, Data(9.0, 9.0)) == 10.0


BOTH = JointLimits(max_acceleration=2.0, max_deceleration=3.0)


@pytest.mark.parametrize(
    ("limits", "v", "desired", "limited"),
    [
        (BOTH, 1.0, 9.0, 2.0),
        (BOTH, 1.0, -9.0, -3.0),
        (BOTH, -1.0, 9.0, 3.0),
        (BOTH, -1.0, -9.0, -2.0),
        (BOTH, 0.1, -9.0, -3.0),
        (BOTH, -0.1, 9.0, 3.0),
        (BOTH, 0.0, -9.0, -2.0),
        (BOTH, None, -9.0, -2.0),
        (BOTH, 1.0, -1.5, -1.5),
        (JointLimits(max_acceleration=2.0), 1.0, -9.0, -2.0),
        (JointLimits(max_deceleration=3.0), 1.0, -9.0, -3.0),
        (JointLimits(max_deceleration=3.0), 1.0, 9.0, 9.0),
        (JointLimits(), 1.0, 9.0, 9.0),
    ],
)
@pytest.mark.parametrize("soft", [None, SoftJointLimits()])
def test_an_acceleration_is_limited_by_whether_it_slows_down(
    soft, limits, v, desired, limited
):
    found = run(limits, Data(acceleration=desired), Data(0.0, v), soft=soft)

    assert found.command == Data(acceleration=limited)
    assert found.is_limited == (desired != limited)


@pytest.mark.parametrize(
    ("most", "desired", "limited"),
    [(5.0, 9.0, 5.0), (5.0, -9.0, -5.0), (5.0, 4.0, 4.0), (None, 9.0, 9.0)],
)
def test_a_jerk_is_limited(most, desired, limited):
    found = run(JointLimits(max_jerk=most), Data(jerk=desired))

    assert found.command == Data(jerk=limited)
    assert found.is_limited == (desired != limited)


def test_what_is_remembered_are_the_limited_commands():
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    desired, measured = Data(9.0, 9.0, 9.0, 9.0, 9.0), Data(0.25, 0.5)

    found = run(limits, desired, measured, dt=0.5)

    assert found.is_limited
    assert found.command == Data(0.75, 1.0, 1.0, 1.0, 1.0)
    assert found.previous == found.command


def test_a_nan_passes_and_is_not_remembered():
    limits = JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    previous = Data(0.1, 0.2, 0.3, 0.4, 0.5)

    found = run(limits, Data(NAN, NAN, NAN, NAN, NAN), Data(0.0, 0.0), previous)

    assert all(math.isnan(value) for value in found.command)
    assert not found.is_limited
    assert found.previous == previous


def test_a_first_nan_is_remembered_as_what_is_measured():
    found = run(POSITIONS, Data(NAN, NAN), Data(0.5))

    assert found.previous == Data(0.5)


def test_a_quantity_first_commanded_later_is_remembered_from_then_on():
    measured = Data(0.5, 0.6)
    first = run(JointLimits(), Data(1.0), measured)

    second = run(JointLimits(), Data(1.5, 2.0), measured, first.previous)

    assert first.previous == Data(1.0)
    assert second.previous == Data(1.5, 2.0)


@pytest.mark.parametrize("dt", [0.0, -0.1])
@pytest.mark.parametrize("soft", [None, SoftJointLimits(-0.5, 0.5, 1.0)])
def test_without_time_nothing_is_limited_or_remembered(soft, dt):
    desired, previous = Data(99.0), Data(0.5)

    found = run(POSITIONS, desired, Data(50.0), previous, soft=soft, dt=dt)

    assert found == LimitedCommand(desired, False, previous)


@pytest.mark.parametrize(
    ("soft", "limited"),
    [
        (SoftJointLimits(-1.0, 3.0), 3.0),
        (SoftJointLimits(max_position=3.0), PI),
        (SoftJointLimits(3.0, 3.0), PI),
        (SoftJointLimits(5.0, 3.0), PI),
        (SoftJointLimits(-INF, 3.0), PI),
        # Wider than the hard ones.
        (SoftJointLimits(-4.0, 4.0), PI),
        # Without a part in common the soft ones hold.
        (SoftJointLimits(4.0, 5.0), 4.0),
    ],
)
def test_soft_limits_of_the_position_count_if_both_do(soft, limited):
    assert position(POSITIONS, 3.9, soft=soft) == limited


SPEED = JointLimits(-PI, PI, max_velocity=1.0)


@pytest.mark.parametrize(
    ("q", "previous", "desired", "limited"),
    [
        # As fast as the joint can, far from the limits.
        (None, 0.0, 2.0, 0.5),
        (None, 0.0, -2.0, -0.5),
        (None, 0.0, 0.3, 0.3),
        # Half of what is left per second near a limit; away from it still fast.
        (None, 1.0, 2.0, 1.25),
        (None, 1.0, -2.0, 0.5),
        (None, 1.5, 2.0, 1.625),
        (None, -1.5, -2.0, -1.625),
        (None, -1.5, 2.0, -1.0),
        # By the command before, not the joint.
        (0.0, 1.5, 2.0, 1.625),
        (1.5, None, 2.0, 1.625),
    ],
)
def test_a_joint_comes_slowly_near_a_soft_limit(q, previous, desired, limited):
    soft = SoftJointLimits(-2.0, 2.0, k_position=0.5)
    before = Data(previous, effort=0.0)

    found = position(SPEED, desired, Data(q), before, soft=soft, dt=0.5)

    assert found == pytest.approx(limited, rel=1e-12)


def test_soft_limits_hold_a_joint_of_unknown_position_to_its_range_alone():
    soft, before = SoftJointLimits(-2.0, 2.0, k_position=0.5), Data(effort=0.0)

    assert position(SPEED, 1.9, previous=before, soft=soft) == 1.9
    assert position(SPEED, 3.0, previous=before, soft=soft) == 2.0


def test_an_infinite_command_before_counts_as_unknown_to_soft_limits():
    limits, soft = JointLimits(max_velocity=1.0), SoftJointLimits(-2.0, 2.0)

    found = position(limits, 0.0, Data(0.5), Data(INF), soft=soft, dt=0.25)

    # From 0.5 on as the soft ones have it; the hard ones have nothing in common.
    assert found == 0.25


@pytest.mark.parametrize("gain", [None, 0.0, INF])
def test_without_a_gain_a_joint_keeps_its_speed_near_a_soft_limit(gain):
    soft = SoftJointLimits(-2.0, 2.0, k_position=gain)

    found = position(SPEED, 5.0, previous=Data(1.5), soft=soft, dt=0.25)

    assert found == 1.75


def test_a_command_before_that_is_far_outside_soft_limits_is_given_up():
    soft = SoftJointLimits(-0.75, 0.75)

    assert position(SPEED, 2.0, previous=Data(2.0), soft=soft) == 0.75


@pytest.mark.parametrize(
    ("q", "desired", "limited"),
    [
        # Outside the soft limits: a degree per second, and only back.
        (2.1, 0.5, -SOFT_SPEED),
        (2.1, -0.5, -SOFT_SPEED),
        (-2.1, -0.5, SOFT_SPEED),
        (-2.1, 0.5, SOFT_SPEED),
        # Beyond the hard ones.
        (PI + 0.003, -0.5, 0.0),
        (-PI - 0.003, 0.5, 0.0),
        # At their ends, and inside.
        (2.0, 0.5, 0.0),
        (-2.0, -0.5, 0.0),
        (1.75, 0.5, 0.125),
        (1.75, -2.0, -1.0),
        (-1.75, -0.5, -0.125),
        (0.0, 0.9, 0.9),
    ],
)
def test_soft_limits_hold_a_velocity(q, desired, limited):
    soft = SoftJointLimits(-2.0, 2.0, k_position=0.5)

    found = velocity(SPEED, desired, Data(q), soft=soft)

    assert found == pytest.approx(limited, rel=1e-12)


@pytest.mark.parametrize("q", [PI + 0.001, PI - 0.001])
def test_within_the_tolerance_of_hard_limits_a_joint_comes_back(q):
    soft = SoftJointLimits(-2.0, 2.0, k_position=0.5)

    down, up = (velocity(SPEED, -s * 0.5, Data(s * q), soft=soft) for s in (1, -1))

    assert (down, up) == pytest.approx((-SOFT_SPEED, SOFT_SPEED), rel=1e-12)


@pytest.mark.parametrize("q", [PI + 0.003, -PI - 0.003])
@pytest.mark.parametrize("desired", [2.0, -2.0])
def test_farther_outside_hard_limits_a_position_stays_where_it_is(q, desired):
    soft = SoftJointLimits(-2.0, 2.0, k_position=0.5)

    assert position(SPEED, desired, Data(q), Data(1.0), soft=soft) == 1.0


def test_soft_limits_without_hard_ones_hold_no_velocity():
    soft = SoftJointLimits(-2.0, 2.0, k_position=0.5)

    assert velocity(JointLimits(max_velocity=1.0), 0.9, Data(2.1), soft=soft) == 0.9


def test_the_soft_limiter_accelerates_from_the_measured_velocity():
    limits = JointLimits(max_velocity=1.0, max_acceleration=1.0)
    soft, previous = SoftJointLimits(), Data(velocity=0.25)

    def found(desired: float, v: float | None) -> float:
        return velocity(limits, desired, Data(0.0, v), previous, soft=soft, dt=0.25)

    # Within a quarter of both.
    assert found(0.9, 0.125) == 0.375
    assert found(-0.9, 0.375) == 0.125
    assert found(0.9, None) == 0.5
    # With nothing in common, the upper end of what is below counts.
    assert found(0.9, 2.0) == 0.5
    assert found(0.0, 2.0) == 0.5


EFFORT = JointLimits(-PI, PI, max_velocity=1.0, max_effort=10.0)


@pytest.mark.parametrize(
    ("limits", "gain", "v", "desired", "limited"),
    [
        # -4 * (0.5 - 1) and -4 * (0.5 + 1)
        (EFFORT, 4.0, 0.5, 9.0, 2.0),
        (EFFORT, 4.0, 0.5, -9.0, -6.0),
        (EFFORT, 4.0, -0.5, -9.0, -2.0),
        (EFFORT, 4.0, 1.0, 9.0, 0.0),
        # The joint's own limit, and that of one that is too fast.
        (EFFORT, 99.0, 0.5, 20.0, 10.0),
        (EFFORT, 99.0, 0.5, -20.0, -10.0),
        (EFFORT, 4.0, 1.5, -9.0, -9.0),
        # Brakes, where all that is allowed is below 0: -4 * (1.5 - 1).
        (EFFORT, 4.0, 1.5, 9.0, -2.0),
        (EFFORT, 4.0, -1.5, -9.0, 2.0),
        # No gain, no measurement.
        (EFFORT, None, 0.5, 20.0, 10.0),
        (EFFORT, INF, 0.5, 20.0, 10.0),
        (EFFORT, 4.0, None, 20.0, 10.0),
        # Any speed is allowed.
        (JointLimits(max_effort=10.0), 4.0, 0.5, 20.0, 10.0),
        # Infinity times nothing is no limit, as upstream.
        (JointLimits(max_effort=10.0), 0.0, 0.5, 20.0, 20.0),
    ],
)
def test_soft_limits_let_an_effort_speed_the_joint_up_less(
    limits, gain, v, desired, limited
):
    soft = SoftJointLimits(k_velocity=gain)

    assert effort(limits, desired, Data(0.0, v), soft=soft) == limited


def test_an_effort_is_softened_by_the_band_of_the_velocity_command_with_it():
    soft = SoftJointLimits(k_velocity=4.0)
    limits = JointLimits(max_velocity=1.0, max_effort=10.0, max_acceleration=1.0)
    measured, previous = Data(0.0, 0.0), Data(velocity=0.0)
    desired = Data(velocity=0.0, effort=9.0)

    found = run(limits, desired, measured, previous, soft=soft, dt=0.25)

    assert found.command.effort == 1.0
    assert effort(limits, 9.0, measured, previous, soft=soft, dt=0.25) == 4.0
