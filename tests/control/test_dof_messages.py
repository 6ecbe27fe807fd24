import numpy as np
import pytest

from arm_drake.control.dof_messages import find_fault, sort_values
from arm_drake.messages import MultiDOFCommand

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
