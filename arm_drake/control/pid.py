"""PIDs as ros2_control's controllers have them, n of them at a time.

The rules, and the parameters of one PID, are those of control_toolbox's class ``Pid``
(version 6.3.0). The strategy "legacy" is of its branch jazzy, and `is_humble` is all of
its branch humble, which has no strategies, limits of the command and deadband. There is
no filter on derivatives. An integral acts from the next step on; with "legacy" and of
humble it acts at once.

Errors are in the unit of what is controlled, such as [rad] or [m]; a command is in the
unit that the gains make of it.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal, NamedTuple, Self, get_args

import numpy as np

from arm_drake.arrays import Array, Mask, clamp
from arm_drake.description.parameters import ParameterGroup, Rule, check_finite
from arm_drake.importing import dataclass
from arm_drake.messages import Message

AntiwindupStrategy = Literal[
    "none", "conditional_integration", "back_calculation", "legacy"
]
STRATEGIES: Final[tuple[str, ...]] = get_args(AntiwindupStrategy)


def find_fault(gains: Any, *, is_humble: bool = False) -> str | None:
    """Return why no PID can have these gains, or None if one can."""
    low, high = gains.i_clamp_min, gains.i_clamp_max
    if is_humble:
        if low <= high:
            return None
        return f"i_clamp_min must not exceed i_clamp_max, got {low} and {high}"
    strategy = gains.antiwindup_strategy
    if strategy not in STRATEGIES:
        known = ", ".join(map(repr, STRATEGIES))
        return f"antiwindup_strategy: expected one of {known}, got {strategy!r}"
    if not gains.u_clamp_min < gains.u_clamp_max:
        return (
            f"u_clamp_min must be below u_clamp_max, got {gains.u_clamp_min} and "
            f"{gains.u_clamp_max}"
        )
    if not low <= 0.0 <= high:
        return (
            f"i_clamp_min and i_clamp_max must have 0 between them, got {low} and "
            f"{high}"
        )
    constant = gains.tracking_time_constant
    if strategy == "back_calculation" and not 0.0 <= constant < math.inf:
        return f"tracking_time_constant must be at least 0, got {constant}"
    return None


def time_constant(gains: Any) -> float:
    """Return the time constant that "back_calculation" uses [s].

    If it isn't given, it is made from the gains: sqrt(d / i), or p / i without d.
    Without i it isn't needed.
    """
    p, i, d = float(gains.p), float(gains.i), float(gains.d)
    constant = float(gains.tracking_time_constant)
    if gains.antiwindup_strategy != "back_calculation" or i == 0.0 or constant != 0.0:
        return constant
    if d == 0.0:
        return p / i
    return math.sqrt(d / i) if d / i >= 0.0 else math.nan


_ARRAYS: Final = (
    *("p", "i", "d", "u_clamp_max", "u_clamp_min", "i_clamp_max", "i_clamp_min"),
    "error_deadband",
)
# Steps up to this take no time [s].
EPSILON: Final = float(np.finfo(float).eps)


class PidState(NamedTuple):
    """State of n PIDs; arrays of shape (n,), never changed."""

    # Integral term, gain included; of humble the integral of the error, gain excluded.
    i_term: Array

    # Error that the next numeric derivative starts from.
    error_last: Array

    # What the last step commands.
    command: Array

    # Error of the last step and its rate [1/s], to be reported.
    error: Array
    error_rate: Array


@dataclass(frozen=True, eq=False)
class Pid(Message):
    """Gains and limits of n PIDs, made by `from_gains`; arrays of shape (n,).

    When gains change, a new Pid goes on with the state of the old one.
    """

    # Proportional, integral and derivative gains.
    p: Array
    i: Array
    d: Array

    # Limits of the command.
    u_clamp_max: Array
    u_clamp_min: Array

    # Limits of the integral term.
    i_clamp_max: Array
    i_clamp_min: Array

    # Time constant of "back_calculation" [s]. Where 0 is given, it is made from the
    # gains: sqrt(d / i), or p / i without d, or 0 without i.
    tracking_time_constant: Array

    # Errors up to this are not integrated.
    error_deadband: Array

    # What the integrals do while the command is at a limit.
    antiwindup_strategy: tuple[str, ...]

    # Of humble: whether the stored integral is clamped, or only its contribution. With
    # "legacy" both give the same numbers.
    antiwindup: Mask
    is_humble: bool

    # Whether any PID has it.
    _has_u_clamp: bool
    _has_i_clamp: bool
    _has_deadband: bool
    _has_integral: bool

    # Which PIDs have the strategy; None if none has.
    _conditional: Mask | None
    _back: Mask | None
    _legacy: Mask | None
    _is_all_legacy: bool

    @classmethod
    def from_gains(cls, gains: Sequence[Any], *, is_humble: bool = False) -> Self:
        """Return PIDs with the gains of n objects, or raise ValueError.

        They have the attributes p, i, d, u_clamp_max, u_clamp_min, i_clamp_max,
        i_clamp_min, error_deadband, tracking_time_constant, antiwindup_strategy and
        antiwindup.
        """
        for k, one in enumerate(gains):
            fault = find_fault(one, is_humble=is_humble)
            if fault is not None:
                raise ValueError(f"gains[{k}]: {fault}")

        arrays = {name: _array(gains, name) for name in _ARRAYS}
        constants = [time_constant(one) for one in gains]
        arrays["tracking_time_constant"] = np.array(constants, dtype=float)
        u_limits = arrays["u_clamp_max"], arrays["u_clamp_min"]
        i_limits = arrays["i_clamp_max"], arrays["i_clamp_min"]
        strategies = tuple(one.antiwindup_strategy for one in gains)
        is_conditional, is_back, is_legacy = (
            np.array([name == strategy for name in strategies], dtype=bool)
            for strategy in STRATEGIES[1:]
        )
        return cls(
            **arrays,
            antiwindup_strategy=strategies,
            antiwindup=_array(gains, "antiwindup") != 0.0,
            is_humble=is_humble,
            _has_u_clamp=bool(np.isfinite(u_limits).any()),
            _has_i_clamp=bool(np.isfinite(i_limits).any()),
            _has_deadband=bool((arrays["error_deadband"] > 0.0).any()),
            _has_integral=bool((arrays["i"] != 0.0).any()),
            _conditional=is_conditional if is_conditional.any() else None,
            _back=is_back & (arrays["i"] != 0.0) if is_back.any() else None,
            _legacy=is_legacy if is_legacy.any() else None,
            _is_all_legacy=bool(is_legacy.all()),
        )

    def initial(self) -> PidState:
        """Return the state before the first step."""
        return PidState(*[np.zeros(len(self.p))] * 5)

    def reset(self, state: PidState, save_i_term: bool | Mask = False) -> PidState:
        """Return the initial state; `save_i_term` shape (n,)."""
        i_term = np.where(save_i_term, state.i_term, 0.0)
        return self.initial()._replace(i_term=i_term)

    def step(
        self,
        state: PidState,
        error: Array,
        dt: float,
        error_rate: Array | None = None,
        *,
        where: Mask | None = None,
    ) -> PidState:
        """Return the state after one step; it holds the command.

        Where the error, shape (n,), or its rate isn't finite, the command is NaN, of
        humble 0, and the integral stays. With a `dt` of 0 [s] nothing changes; of
        humble the command is 0; a negative one is a ValueError. Without a rate [1/s] it
        is the difference to the error of the last step without one, over `dt`. `where`
        says which PIDs step; None is all.

        As upstream, "back_calculation" with an integral gain, but neither another gain
        nor a time constant, makes integral and command NaN.
        """
        if not dt > EPSILON:
            return self._hold(state, dt, where)
        # Copies, for the state keeps them and the caller may reuse its arrays.
        error, last = np.array(error, dtype=float), state.error_last
        if error_rate is None:
            rate, next_last = (error - last) / dt, error
        else:
            rate, next_last = np.array(error_rate, dtype=float), last
        # The quickest way to see that all are finite, without a warning if not.
        is_finite = math.isfinite(sum(error.tolist()) + sum(rate.tolist()))
        if is_finite and where is None:
            command, i_term = self._advance(state.i_term, error, rate, dt)
            return PidState(i_term, next_last, command, error, rate)

        steps = True if where is None else where
        # A numeric derivative skips errors that aren't finite.
        is_seen = steps & (np.isfinite(error) | (error_rate is not None))
        is_usable = is_seen & np.isfinite(error) & np.isfinite(rate)
        usable_error, usable_rate = np.where(is_usable, [error, rate], 0.0)
        command, i_term = self._advance(state.i_term, usable_error, usable_rate, dt)
        failed = np.where(steps, 0.0 if self.is_humble else math.nan, state.command)
        return PidState(
            i_term=np.where(is_usable, i_term, state.i_term),
            error_last=np.where(is_seen, next_last, last),
            command=np.where(is_usable, command, failed),
            error=np.where(is_seen, error, state.error),
            error_rate=np.where(is_seen, rate, state.error_rate),
        )

    def step_finite(
        self, state: PidState, error: Array, dt: float, error_rate: Array
    ) -> PidState:
        """Do a step of finite numbers in arrays that nobody changes; `dt` > 0."""
        command, i_term = self._advance(state.i_term, error, error_rate, dt)
        return PidState(i_term, state.error_last, command, error, error_rate)

    def _hold(self, state: PidState, dt: float, where: Mask | None) -> PidState:
        """Return the state after a step that takes no time."""
        if not dt >= -EPSILON:
            raise ValueError(f"dt must be at least 0, got {dt}")
        if not self.is_humble:
            return state
        steps = True if where is None else where
        return state._replace(command=np.where(steps, 0.0, state.command))

    def _advance(
        self, i_term: Array, error: Array, error_rate: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return the commands and the new integral terms; all is finite."""
        if self.is_humble:
            return self._advance_humble(i_term, error, error_rate, dt)
        gained = None
        if self._has_integral:
            gained = dt * self.i * error
            if self._has_deadband:
                gained *= np.abs(error) > self.error_deadband
        grown = self._grow(i_term, gained)
        used = i_term
        if self._legacy is not None:
            all_grown = self._is_all_legacy
            used = grown if all_grown else np.where(self._legacy, grown, i_term)
        command = self.p * error + used + self.d * error_rate
        if not self._has_u_clamp and self._back is None:
            return command, grown
        limited = clamp(command, self.u_clamp_min, self.u_clamp_max)
        if gained is not None and (
            self._conditional is not None or self._back is not None
        ):
            gained = self._unwind(gained, error, command, limited - command, dt)
            grown = self._grow(i_term, gained)
        return limited, grown

    def _grow(self, i_term: Array, gained: Array | None) -> Array:
        grown = i_term if gained is None else i_term + gained
        if not self._has_i_clamp:
            return grown
        return clamp(grown, self.i_clamp_min, self.i_clamp_max)

    def _unwind(
        self, gained: Array, error: Array, command: Array, excess: Array, dt: float
    ) -> Array:
        """Return the increments of integral terms after anti-windup."""
        if self._conditional is not None:
            winds_up = (np.abs(excess) > EPSILON) & (error * command > 0.0)
            gained = np.where(self._conditional & winds_up, 0.0, gained)
        if self._back is not None:
            is_on = self._back & (np.abs(error) > self.error_deadband)
            # The time constant is 0 where there is none to be made from the gains.
            with np.errstate(divide="ignore", invalid="ignore"):
                tracked = excess / self.tracking_time_constant
            gained = np.where(is_on, gained + dt * tracked, gained)
        return gained

    def _advance_humble(
        self, integral: Array, error: Array, error_rate: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return the commands and the new integrals of the error; all is finite."""
        grown = integral + dt * error
        i_term = clamp(self.i * grown, self.i_clamp_min, self.i_clamp_max)
        is_clamped = self.antiwindup & (self.i != 0.0)
        np.divide(i_term, self.i, out=grown, where=is_clamped)
        return self.p * error + i_term + self.d * error_rate, grown


class PlainPids:
    """Steps of n PIDs with given rates in plain numbers, while these are finite.

    To the bit what `Pid.step` gives, in a third of the time for six. What they remember
    is the 5 n numbers of a PidState, field after field.
    """

    def __init__(self, pid: Pid, dt: float) -> None:
        """Create them for steps of `dt` > `EPSILON` [s], of PIDs that `are_plain`."""
        self._dt, self._n = dt, len(pid.p)
        self._has_integral, self._has_i_clamp = pid._has_integral, pid._has_i_clamp
        self._has_deadband = pid._has_deadband
        self._is_limited = pid._has_u_clamp or pid._back is not None
        self._unwinds = pid._conditional is not None or pid._back is not None
        nothing = np.zeros(self._n, dtype=bool)
        columns: list[Any] = [
            *(pid.p, dt * pid.i, pid.d, pid.i_clamp_min, pid.i_clamp_max),
            *(pid.u_clamp_min, pid.u_clamp_max, pid.error_deadband),
            *(nothing if m is None else m for m in (pid._legacy, pid._conditional)),
            *(nothing if pid._back is None else pid._back, pid.tracking_time_constant),
        ]
        self._rows = list(zip(*(c.tolist() for c in columns), strict=True))

    @staticmethod
    def are_plain(pid: Pid) -> bool:
        """Return whether PIDs are none of humble, and divide by nothing that is 0."""
        divides = pid._back is not None and (pid.tracking_time_constant == 0.0).any()
        return not (pid.is_humble or divides)

    def step(
        self, memory: list[float], errors: list[float], rates: list[float] | None
    ) -> list[float] | None:
        """Return the commands of a step, and renew the memory; None if it can't be.

        Rates [1/s] are as in `Pid.step`.
        """
        n, dt = self._n, self._dt
        last = memory[n : 2 * n]
        next_last = last
        if rates is None:
            next_last = errors
            rates = [(e - old) / dt for e, old in zip(errors, last, strict=True)]
        if not math.isfinite(sum(errors) + sum(rates)):
            return None
        terms, commands = [], []
        for row, term, error, rate in zip(
            self._rows, memory[:n], errors, rates, strict=True
        ):
            new, command = self._advance(row, term, error, rate)
            terms.append(new)
            commands.append(command)
        memory[:] = terms + next_last + commands + errors + rates
        return commands

    def _advance(
        self, row: tuple[Any, ...], term: float, error: float, rate: float
    ) -> tuple[float, float]:
        """Return an integral term and a command, as `Pid._advance`."""
        p, gain, d, _, _, low, high, deadband, is_legacy, is_conditional, *back = row
        gained = 0.0
        if self._has_integral:
            gained = gain * error
            if self._has_deadband:
                gained *= abs(error) > deadband
        grown = self._grow(row, term, gained)
        command = p * error + (grown if is_legacy else term) + d * rate
        if not self._is_limited:
            return grown, command
        limited = command if command >= low else low
        if limited > high:
            limited = high
        if self._has_integral and self._unwinds:
            excess = limited - command
            if is_conditional and abs(excess) > EPSILON and error * command > 0.0:
                gained = 0.0
            if back[0] and abs(error) > deadband:
                gained += self._dt * (excess / back[1])
            grown = self._grow(row, term, gained)
        return grown, limited

    def _grow(self, row: tuple[Any, ...], term: float, gained: float) -> float:
        grown = term + gained if self._has_integral else term
        if not self._has_i_clamp:
            return grown
        low, high = row[3], row[4]
        if grown < low:
            grown = low
        return high if grown > high else grown


def _array(gains: Sequence[Any], name: str) -> Array:
    return np.array([getattr(one, name) for one in gains], dtype=float)


@dataclass(frozen=True)
class PidGains:
    """Gains and limits of one PID."""

    # Proportional gain, of the error.
    p: float = 0.0

    # Integral gain, of the error's integral over time.
    i: float = 0.0

    # Derivative gain, of the error's rate.
    d: float = 0.0

    # Limits of the output.
    u_clamp_max: Annotated[float, Rule(since="jazzy")] = math.inf
    u_clamp_min: Annotated[float, Rule(since="jazzy")] = -math.inf

    # Limits of the integral term. Humble's zeros switch it off.
    i_clamp_max: Annotated[float, Rule(humble=0.0)] = math.inf
    i_clamp_min: Annotated[float, Rule(humble=0.0)] = -math.inf

    # What the integral does while the output is at a limit.
    antiwindup_strategy: Annotated[
        AntiwindupStrategy,
        Rule(humble="legacy", kilted="none", rolling="none", since="jazzy"),
    ] = "legacy"

    # With "legacy", whether the stored integral is clamped, or only its contribution.
    antiwindup: bool = False

    # Time constant of "back_calculation" [s], at least 0; 0 is made from the gains.
    tracking_time_constant: Annotated[float, Rule(since="jazzy")] = 0.0

    # Errors up to this are not integrated.
    error_deadband: Annotated[float, Rule(since="jazzy")] = 0.0

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take older parameters: one limit for both sides, anti-windup as a bool."""
        limit = params.get("i_clamp", float)
        if limit is not None:
            params.replace("i_clamp", {"i_clamp_max": limit, "i_clamp_min": -limit})
        is_new = params.distro in ("kilted", "rolling")
        if "antiwindup_strategy" in params:
            strategy = params.get("antiwindup_strategy", AntiwindupStrategy)
            if strategy == "legacy" and is_new:
                params.add(
                    "antiwindup_strategy",
                    "warning",
                    "repair",
                    f"'legacy' is a strategy up to jazzy only, not of {params.distro}",
                    "it is taken",
                )
        elif is_new and "antiwindup" in params:
            value = params.get("antiwindup", bool)
            params.replace(
                "antiwindup", {"antiwindup_strategy": "legacy", "antiwindup": value}
            )

    def check(self, name: str) -> None:
        """Raise ValueError if no PID can have these gains, with their name."""
        try:
            check_finite(self, "p", "i", "d")
            fault = find_fault(self)
        except ValueError as error:
            fault = str(error)
        if fault:
            raise ValueError(f"{name}.{fault}")


def adapt_saturation(params: ParameterGroup) -> None:
    """Take `saturation` of a PID: false switches the limits of the output off."""
    is_limited = params.get("saturation", bool)
    if is_limited is None:
        return
    for name in ("u_clamp_max", "u_clamp_min"):
        if not is_limited and name in params:
            what = "saturation is false"
            params.add(name, "warning", "ignored", what, "it has no effect")
            params.drop(name)
    params.drop("saturation")
