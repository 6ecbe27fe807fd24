import numpy as np
import pytest

from arm_drake.control.pid import PidState
from arm_drake.controllers.pid_controller import (
    PidControlState,
    find_fault,
    make_state,
    sort_values,
)
from arm_drake.messages import (
    Header,
    MultiDOFCommand,
    MultiDOFState,
    MultiDOFStateStamped,
    Time,
)

DOFS = ("a", "b")


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (MultiDOFCommand(values=[1, 2]), None),
        (MultiDOFCommand(("b", "a"), [1, 2], [3, 4]), None),
        (
            MultiDOFCommand(("a", "a"), [1, 2]),
            "dof_names must be a, b, got a, a",
        ),
        (MultiDOFCommand(("a",), [1]), "dof_names must be a, b, got a"),
        (MultiDOFCommand(DOFS, [1]), "values must have 2 elements (a, b), got 1"),
        (
            MultiDOFCommand(DOFS, [1, 2], [3]),
            "values_dot must have 2 elements (a, b) or none, got 1",
        ),
    ],
)
def test_a_message_has_a_value_for_each_degree_of_freedom(
    message: MultiDOFCommand, fault: str | None
) -> None:
    assert find_fault(message, DOFS) == fault


def test_rates_may_be_out_of_place() -> None:
    message = MultiDOFCommand(DOFS, [1, 2], [3, 4])

    assert find_fault(message, DOFS, takes_rates=False) == (
        "values_dot needs a second one of reference_and_state_interfaces"
    )


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (MultiDOFCommand((), [1, 2], [3, 4]), [1, 2, 3, 4]),
        (MultiDOFCommand(("b", "a"), [1, 2], [3, 4]), [2, 1, 4, 3]),
        (MultiDOFCommand(("b", "a"), [1, 2]), [2, 1, np.nan, np.nan]),
        (MultiDOFCommand((), [np.nan, 2], [3, np.nan]), [np.nan, 2, np.nan, np.nan]),
    ],
)
def test_values_are_sorted_by_name(
    message: MultiDOFCommand, expected: list[float]
) -> None:
    values = sort_values(message, DOFS, has_rate=True)

    np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(
        sort_values(message, DOFS, has_rate=False), expected[:2]
    )


@pytest.mark.parametrize(
    ("has_rate", "rates"), [(True, [(30.0, 50.0), (40.0, 60.0)]), (False, [(0, 0)] * 2)]
)
def test_a_report_has_what_the_tick_left(
    has_rate: bool, rates: list[tuple[float, float]]
) -> None:
    size = 4 if has_rate else 2
    state = PidControlState(
        PidState(*np.zeros((5, 2))),
        references=np.array([1.0, 2.0, 10.0, 20.0])[:size],
        measured=np.array([3.0, 4.0, 30.0, 40.0])[:size],
        error=np.array([5.0, 6.0, 50.0, 60.0])[:size],
        command=np.array([7.0, np.nan]),
        output=np.array([7.0, 8.0]),
    )

    message = make_state(DOFS, state, 1_500_000_000, 10_000_000)

    assert message == MultiDOFStateStamped(
        Header(Time(1, 500_000_000)),
        (
            MultiDOFState("a", 1.0, 3.0, rates[0][0], 5.0, rates[0][1], 0.01, 7.0),
            MultiDOFState("b", 2.0, 4.0, rates[1][0], 6.0, rates[1][1], 0.01, 8.0),
        ),
    )
