"""Messages of several degrees of freedom, in the order that a controller has them.

Source: ros2_controllers, `pid_controller` (version 6.9.0). Upstream takes the values in
the order in which they come, whatever their names are; here the names count.
"""

from collections.abc import Sequence

import numpy as np

from arm_drake.arrays import Array
from arm_drake.controllers.pid_control import PidControlState
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    MultiDOFCommand,
    MultiDOFState,
    MultiDOFStateStamped,
)
from arm_drake.messages.lazy import make_lazy


def find_fault(
    message: MultiDOFCommand, dofs: Sequence[str], *, takes_rates: bool = True
) -> str | None:
    """Return why a message can't be taken, or None if it can.

    Args:
        message: The message.
        dofs: Degrees of freedom, n of them.
        takes_rates: Whether there may be rates.
    """
    n, names = len(dofs), message.dof_names
    expected = ", ".join(dofs)
    if names and sorted(names) != sorted(dofs):
        return f"dof_names must be {expected}, got {', '.join(names)}"
    if len(message.values) != n:
        return f"values must have {n} elements ({expected}), got {len(message.values)}"
    if len(message.values_dot) not in (0, n):
        got = len(message.values_dot)
        return f"values_dot must have {n} elements ({expected}) or none, got {got}"
    if message.values_dot and not takes_rates:
        return "values_dot needs a second one of reference_and_state_interfaces"
    return None


def sort_values(
    message: MultiDOFCommand, dofs: Sequence[str], *, has_rate: bool
) -> Array:
    """Return the values of a message in our order, shape (n,); NaN is none.

    Args:
        message: One without a fault.
        dofs: Degrees of freedom, n of them.
        has_rate: Whether rates follow the values, shape (2n,). As upstream, there is
            none without a value.
    """
    names = message.dof_names or tuple(dofs)
    order = [names.index(dof) for dof in dofs]
    values = np.array(message.values)[order]
    if not has_rate:
        return values
    rates = np.full(len(values), np.nan)
    if message.values_dot:
        rates = np.where(np.isnan(values), np.nan, np.array(message.values_dot)[order])
    return np.concatenate([values, rates])


def make_state(
    dofs: Sequence[str], state: PidControlState, time_ns: int, period_ns: int
) -> MultiDOFStateStamped:
    """Return the topic controller_state; rates that there aren't are 0.

    It is made when a field is asked for.

    Args:
        dofs: Degrees of freedom, n of them.
        state: What the tick left behind.
        time_ns: Time of the tick [ns].
        period_ns: Time since the last one [ns].
    """
    return make_lazy(
        MultiDOFStateStamped, lambda: _make_state(dofs, state, time_ns, period_ns)
    )


def _make_state(
    dofs: Sequence[str], state: PidControlState, time_ns: int, period_ns: int
) -> MultiDOFStateStamped:
    n = len(dofs)
    measured, error = state.measured.tolist(), state.error.tolist()
    zeros = [0.0] * n
    columns = zip(
        dofs,
        state.references[:n].tolist(),
        measured[:n],
        measured[n:] or zeros,
        error[:n],
        error[n:] or zeros,
        [period_ns / NANOSECONDS] * n,
        state.output.tolist(),
        strict=True,
    )
    states = tuple(MultiDOFState(*row) for row in columns)
    return MultiDOFStateStamped(Header.from_nanoseconds(time_ns), states)
