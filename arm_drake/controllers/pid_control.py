"""The tick of a PidController: n PIDs that take measurements to references.

The rules are those of ros2_controllers' `pid_controller` (version 6.9.0). References
and measurements are of one quantity, shape (n,), or of one and its rate, shape (2n,),
all of the quantity first.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.control.pid import EPSILON, Pid, PidState
from arm_drake.control.trajectory import shortest_angular_distance
from arm_drake.messages import Message

Mask = NDArray[np.bool_]


class PidControlState(NamedTuple):
    """What a tick leaves behind; arrays that nobody changes. NaN is unknown."""

    pid: PidState

    # Shape (n,) or (2n,); errors are references minus measurements, angles wrapped.
    references: Array
    measured: Array
    error: Array

    # Commands, shape (n,); NaN where there is no reference or no measurement.
    command: Array

    # What the command interfaces hold then, shape (n,).
    output: Array


@dc.dataclass(frozen=True, eq=False)
class PidControl(Message):
    """The rules of n degrees of freedom, made by `from_gains`."""

    pid: Pid

    # How much of the references is added to the commands, of their rates if there are
    # any; shape (n,), None if nothing is.
    feedforward_gain: Array | None

    # Which errors are angles, which wrap, shape (n,); None if none is.
    angle_wraparound: Mask | None

    # Which integral terms stay over a deactivation, shape (n,).
    save_i_term: Mask

    # Whether there are rates, too.
    has_rate: bool

    @classmethod
    def from_gains(
        cls,
        gains: Sequence[Any],
        *,
        has_rate: bool,
        enable_feedforward: bool = True,
        is_humble: bool = False,
    ) -> Self:
        """Return the rules of degrees of freedom with these gains.

        Args:
            gains: One object for each of the n degrees of freedom, with the attributes
                that `Pid.from_gains` reads, and feedforward_gain, angle_wraparound and
                save_i_term.
            has_rate: Whether references and measurements have rates.
            enable_feedforward: Whether feedforward_gain acts.
            is_humble: Whether the PIDs behave as those of ROS 2 Humble.

        Raises:
            ValueError: If a PID can't have its gains.
        """
        feedforward = np.array([one.feedforward_gain for one in gains], dtype=float)
        wraps = np.array([one.angle_wraparound for one in gains], dtype=bool)
        return cls(
            pid=Pid.from_gains(gains, is_humble=is_humble),
            feedforward_gain=(
                feedforward if enable_feedforward and feedforward.any() else None
            ),
            angle_wraparound=wraps if wraps.any() else None,
            save_i_term=np.array([one.save_i_term for one in gains], dtype=bool),
            has_rate=has_rate,
        )

    def initial(self) -> PidControlState:
        """Return the state before the first activation."""
        n = len(self.save_i_term)
        unknown, nothing = np.full(n * (1 + self.has_rate), np.nan), np.full(n, np.nan)
        pid = self.pid.initial()
        return PidControlState(pid, unknown, unknown, unknown, nothing, nothing)

    def start(
        self, state: PidControlState, references: Array, output: Array
    ) -> PidControlState:
        """Return the state at the start of an activation.

        Args:
            state: Where the PIDs are.
            references: References until others come, shape (n,) or (2n,).
            output: What the command interfaces hold, shape (n,).
        """
        pid = self.pid.reset(state.pid, self.save_i_term)
        return state._replace(pid=pid, references=references, output=output)

    def step(
        self, state: PidControlState, references: Array, measured: Array, dt: float
    ) -> PidControlState:
        """Return the state after a tick; it holds the commands.

        Where reference or measurement isn't finite, there is no command. Where only
        their rates aren't, the difference to the last error is the error's rate.

        Args:
            state: Where the PIDs are.
            references: Shape (n,) or (2n,).
            measured: As many.
            dt: Time since the last tick [s].
        """
        n, has_rate = len(self.save_i_term), self.has_rate
        error = references - measured
        if self.angle_wraparound is not None:
            with np.errstate(invalid="ignore"):
                turn = shortest_angular_distance(measured[:n], references[:n])
            np.copyto(error[:n], turn, where=self.angle_wraparound)
        # The quickest way to see that all are finite.
        if not math.isfinite(sum(error.tolist())):
            return self._step_some(state, references, measured, error, dt)
        if has_rate and dt > EPSILON:
            pid = self.pid.step_finite(state.pid, error[:n], dt, error[n:])
        else:
            rate = error[n:] if has_rate else None
            pid = self.pid.step(state.pid, error[:n], dt, rate)
        command = pid.command
        if self.feedforward_gain is not None:
            source = references[n:] if has_rate else references
            command = command + self.feedforward_gain * source
        return PidControlState(pid, references, measured, error, command, command)

    def _step_some(
        self,
        state: PidControlState,
        references: Array,
        measured: Array,
        error: Array,
        dt: float,
    ) -> PidControlState:
        """Do a step where some references or measurements aren't finite."""
        n = len(self.save_i_term)
        is_known = np.isfinite(references[:n]) & np.isfinite(measured[:n])
        has_rate = np.zeros(n, dtype=bool)
        if self.has_rate:
            has_rate = is_known & np.isfinite(error[n:])
        pid = state.pid
        for steps, rate in ((has_rate, error[n:]), (is_known & ~has_rate, None)):
            if steps.any():
                pid = self.pid.step(pid, error[:n], dt, rate, where=steps)
        command = pid.command
        if self.feedforward_gain is not None:
            source = references[n:] if self.has_rate else references
            known = np.where(np.isfinite(source), source, 0.0)
            command = command + self.feedforward_gain * known
        command = np.where(is_known, command, np.nan)
        output = np.where(is_known, command, state.output)
        return PidControlState(pid, references, measured, error, command, output)
