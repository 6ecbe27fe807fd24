"""The command values of a robot, held to the limits of its joints."""

import math
from collections.abc import Collection, Mapping

import numpy as np
import pytest

from arm_drake.control.joint_limits import (
    CommandLimits,
    JointControlInterfacesData,
    LimitedCommands,
)
from arm_drake.description.joint_limits import JointLimits, SoftJointLimits

Data = JointControlInterfacesData

ORDER = ("a/position", "a/velocity", "b/position", "b/effort", "gpio/out")
MEASURED = ("a/position", "b/position", "a/velocity", "b/velocity")
LIMITS = {
    "a": (JointLimits(-1.0, 1.0, max_velocity=2.0), None),
    "b": (JointLimits(-0.5, 0.5, max_effort=3.0), None),
}
EVERYTHING = frozenset(ORDER)
DT = 0.01


def run(
    values: np.ndarray,
    *,
    claimed: Collection[str] = EVERYTHING,
    measured: Mapping[str, float] | None = None,
    previous: Mapping[str, Data] | None = None,
    limits: Mapping[str, tuple[JointLimits, SoftJointLimits | None]] = LIMITS,
    dt: float = DT,
) -> LimitedCommands:
    states = [(measured or {}).get(name, 0.0) for name in MEASURED]
    return CommandLimits(limits, ORDER, MEASURED).apply(
        claimed, values, np.array(states), previous or {}, dt
    )


def test_commands_within_the_limits_pass():
    values = np.array([0.01, 0.5, 0.2, -2.0, 99.0])

    found = run(values)

    assert values.tolist() == [0.01, 0.5, 0.2, -2.0, 99.0]
    assert (found.limited, found.out_of_bounds) == ((), {})


def test_each_joint_is_held_to_its_own_limits():
    values = np.array([0.5, 5.0, 4.0, -8.0, 99.0])

    found = run(values)

    # a moves by 2 rad/s for 10 ms at most; b has no such limit.
    assert values.tolist() == [pytest.approx(2.0 * DT), 2.0, 0.5, -3.0, 99.0]
    assert found.limited == ("a", "b")
    assert found.out_of_bounds == {}


def test_what_nobody_claims_is_left_alone():
    values = np.array([9.0, 9.0, 9.0, 9.0, 9.0])

    found = run(values, claimed={"b/effort", "gpio/out"})

    assert values.tolist() == [9.0, 9.0, 9.0, 3.0, 9.0]
    assert found.limited == ("b",)
    assert set(found.previous) == {"b"}


def test_a_claim_without_a_value_is_left_alone():
    values = np.zeros(len(ORDER))

    found = run(values, claimed={"a/effort"})

    assert found == LimitedCommands({}, (), {})


def test_a_command_starts_from_the_one_before():
    first, second = np.full(5, 1.0), np.full(5, 1.0)

    before = run(first, claimed={"a/position"})
    run(second, claimed={"a/position"}, previous=before.previous)

    assert first[0] == pytest.approx(2.0 * DT)
    assert second[0] == pytest.approx(4.0 * DT)


def test_the_first_command_starts_where_the_joint_is():
    values = np.full(5, 1.0)

    run(values, claimed={"a/position"}, measured={"a/position": 0.3})

    assert values[0] == pytest.approx(0.3 + 2.0 * DT)


def test_what_is_remembered_of_others_stays():
    of_b = Data(position=0.1)

    found = run(np.zeros(5), claimed={"a/position"}, previous={"b": of_b})

    assert found.previous["b"] is of_b
    assert found.previous["a"].position == 0.0


def test_what_was_remembered_is_not_changed():
    previous = {"a": Data(position=0.5)}

    run(np.full(5, 0.51), claimed={"a/position"}, previous=previous)

    assert previous == {"a": Data(position=0.5)}


def test_a_joint_far_out_of_bounds_is_named_and_the_others_are_limited():
    values = np.array([0.7, 9.0, 9.0, 0.0, 0.0])

    found = run(
        values,
        claimed={"a/position", "b/position"},
        measured={"a/position": 1.2},
        previous={"a": Data(position=0.9)},
    )

    assert list(found.out_of_bounds) == ["a"]
    assert found.limited == ("b",)
    assert values.tolist() == [0.7, 9.0, 0.5, 0.0, 0.0]
    assert found.previous["a"] == Data(position=0.9)


def test_a_joint_that_starts_out_of_bounds_is_remembered_where_it_is():
    found = run(np.full(5, 0.7), claimed={"a/position"}, measured={"a/position": 1.2})

    assert found.previous == {"a": Data(position=1.2)}


def test_soft_limits_are_those_of_the_joint():
    soft = SoftJointLimits(min_position=-0.2, max_position=0.2)
    limits = {joint: (JointLimits(-1.0, 1.0), None) for joint in ("a", "b")}
    limits["b"] = (JointLimits(-1.0, 1.0), soft)
    values = np.full(5, 0.9)

    found = run(values, claimed={"a/position", "b/position"}, limits=limits)

    assert values[[0, 2]].tolist() == [0.9, 0.2]
    assert found.limited == ("b",)


@pytest.mark.parametrize("command", [math.inf, -math.inf])
def test_an_infinite_command_becomes_the_limit(command):
    values = np.full(5, command)

    run(values, claimed={"b/effort"})

    assert values[3] == math.copysign(3.0, command)


def test_no_command_is_none():
    values = np.full(5, math.nan)

    found = run(values)

    assert np.isnan(values).all()
    assert found.limited == ()


def test_without_a_cycle_before_nothing_is_limited():
    values = np.full(5, 9.0)

    found = run(values, dt=0.0)

    assert values.tolist() == [9.0] * 5
    assert found.limited == ()


def test_what_is_not_measured_is_unknown():
    values = np.full(5, 9.0)
    limits = CommandLimits({"b": LIMITS["b"]}, ORDER, ("a/position",))

    # Measured, b would be far out of bounds.
    found = limits.apply({"b/position"}, values, np.array([9.0]), {}, DT)

    assert values[2] == 0.5
    assert (found.limited, found.out_of_bounds) == (("b",), {})
