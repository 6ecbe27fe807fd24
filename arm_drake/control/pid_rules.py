"""Which gains a PID can have, see `pid`."""

import math
from typing import Any, Final

STRATEGIES: Final = ("none", "conditional_integration", "back_calculation", "legacy")


def find_fault(gains: Any, *, is_humble: bool = False) -> str | None:
    """Return why no PID can have these gains, or None if one can.

    Args:
        gains: What has the attributes that `pid.Pid.from_gains` reads.
        is_humble: Whether humble's rules hold.
    """
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

    Args:
        gains: What has the attributes that `pid.Pid.from_gains` reads.
    """
    p, i, d = float(gains.p), float(gains.i), float(gains.d)
    constant = float(gains.tracking_time_constant)
    if gains.antiwindup_strategy != "back_calculation" or i == 0.0 or constant != 0.0:
        return constant
    if d == 0.0:
        return p / i
    return math.sqrt(d / i) if d / i >= 0.0 else math.nan
