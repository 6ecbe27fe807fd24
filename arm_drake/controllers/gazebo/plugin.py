"""PIDs as Gazebo's joint plugins have them, n of them at a time.

The rule is that of gz-math's class ``PID`` (src/PID.cc). An error is measurement minus
target, the other way round than in ros2_control, and a command works against it. A
limit whose maximum lies below its minimum is none. Errors are in the unit of what is
controlled, such as [rad] or [m]; commands in the unit that the gains make of it.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.messages import Message

Mask = NDArray[np.bool_]


class GazeboPidState(NamedTuple):
    """What n PIDs remember; arrays of shape (n,) that nobody changes."""

    # Integral term, gain included.
    i_term: Array

    # Error that the next derivative starts from.
    error_last: Array


@dc.dataclass(frozen=True, eq=False)
class GazeboPid(Message):
    """Gains and limits of n PIDs, made by `from_gains`; arrays of shape (n,)."""

    # Proportional, integral and derivative gains.
    p: Array
    i: Array
    d: Array

    # Limits of the integral term, gain included; infinite where there are none.
    i_max: Array
    i_min: Array

    # Limits of the command; infinite where there are none.
    cmd_max: Array
    cmd_min: Array

    # What is added to every command, before its limits.
    cmd_offset: Array

    @classmethod
    def from_gains(
        cls,
        p: Sequence[float],
        i: Sequence[float],
        d: Sequence[float],
        i_max: Sequence[float],
        i_min: Sequence[float],
        cmd_max: Sequence[float],
        cmd_min: Sequence[float],
        cmd_offset: Sequence[float],
    ) -> Self:
        """Return PIDs with these gains, n of each.

        Args:
            p: Proportional gains.
            i: Integral gains.
            d: Derivative gains.
            i_max: Upper limits of the integral terms; none where below the lower one.
            i_min: Lower limits of the integral terms.
            cmd_max: Upper limits of the commands; none where below the lower one.
            cmd_min: Lower limits of the commands.
            cmd_offset: What is added to the commands.
        """
        highest, lowest = _limits(i_max, i_min)
        upper, lower = _limits(cmd_max, cmd_min)
        return cls(
            p=_array(p),
            i=_array(i),
            d=_array(d),
            i_max=highest,
            i_min=lowest,
            cmd_max=upper,
            cmd_min=lower,
            cmd_offset=_array(cmd_offset),
        )

    def initial(self) -> GazeboPidState:
        """Return the state before the first step; the last error is 0."""
        zeros = _array([0.0] * len(self.p))
        return GazeboPidState(zeros, zeros)

    def reset(self, state: GazeboPidState, where: Mask | None = None) -> GazeboPidState:
        """Return the initial state.

        Args:
            state: Where the PIDs are.
            where: Which PIDs start anew, shape (n,), the others stay; None is all.
        """
        if where is None:
            return self.initial()
        i_term, error_last = (np.where(where, 0.0, part) for part in state)
        return GazeboPidState(i_term, error_last)

    def step(
        self,
        state: GazeboPidState,
        error: Array,
        dt: float,
        *,
        where: Mask | None = None,
    ) -> tuple[GazeboPidState, Array]:
        """Return the state after one step, and the commands, shape (n,).

        The integral acts at once::

            i_term := clamp(i_term + i dt error, i_min, i_max)
            command = clamp(cmd_offset - p error - i_term - d (error - error_last) / dt)

        Where the error or its rate isn't finite, and with a `dt` of 0, the command is 0
        and nothing changes.

        Args:
            state: Where the PIDs are.
            error: Measurement minus target, shape (n,).
            dt: Time since the last step [s].
            where: Which PIDs step, shape (n,); the others stay and command 0. None is
                all.
        """
        if dt == 0.0:
            return state, np.zeros(len(self.p))
        # A copy, for the state keeps it and the caller may reuse its array.
        error = np.array(error, dtype=float)
        # The difference of errors that aren't finite isn't either.
        with np.errstate(invalid="ignore", over="ignore"):
            rate = (error - state.error_last) / dt
        # The quickest way to see that all are finite.
        if where is None and math.isfinite(sum(rate.tolist())):
            i_term, command = self._advance(state.i_term, error, rate, dt)
            return GazeboPidState(i_term, error), command

        steps = np.isfinite(rate) if where is None else where & np.isfinite(rate)
        usable_error, usable_rate = np.where(steps, [error, rate], 0.0)
        i_term, command = self._advance(state.i_term, usable_error, usable_rate, dt)
        after = GazeboPidState(
            np.where(steps, i_term, state.i_term),
            np.where(steps, error, state.error_last),
        )
        return after, np.where(steps, command, 0.0)

    def _advance(
        self, i_term: Array, error: Array, rate: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return the new integral terms and the commands; all is finite."""
        i_term = _clamp(i_term + self.i * dt * error, self.i_min, self.i_max)
        command = self.cmd_offset - self.p * error - i_term - self.d * rate
        return i_term, _clamp(command, self.cmd_min, self.cmd_max)


def _array(values: Sequence[float] | Array) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


def _limits(high: Sequence[float], low: Sequence[float]) -> tuple[Array, Array]:
    """Return upper and lower limits, infinite where there are none."""
    is_limited = np.array(high, dtype=float) >= np.array(low, dtype=float)
    return (
        _array(np.where(is_limited, high, math.inf)),
        _array(np.where(is_limited, low, -math.inf)),
    )


def _clamp(values: Array, low: Array, high: Array) -> Array:
    # np.clip does the same, slower.
    return np.minimum(np.maximum(values, low), high)
