"""Parameters of one PID, as control_toolbox has them.

Source: control_toolbox 6.3.0, and its older parameters.
"""

import dataclasses as dc
import math
from typing import Annotated, Literal

from arm_drake.description.given import Given
from arm_drake.description.parameters import Rule

AntiwindupStrategy = Literal[
    "none", "conditional_integration", "back_calculation", "legacy"
]


@dc.dataclass(frozen=True)
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
    def adapt(given: Given) -> None:
        """Take older parameters: one limit for both sides, anti-windup as a bool."""
        limit = given.get("i_clamp", float)
        if limit is not None:
            given.replace("i_clamp", {"i_clamp_max": limit, "i_clamp_min": -limit})
        is_new = given.distro in ("kilted", "rolling")
        if "antiwindup_strategy" in given:
            strategy = given.get("antiwindup_strategy", AntiwindupStrategy)
            if strategy == "legacy" and is_new:
                given.add(
                    "antiwindup_strategy",
                    "warning",
                    "repair",
                    f"'legacy' is a strategy up to jazzy only, not of {given.distro}",
                    "it is taken",
                )
        elif is_new and "antiwindup" in given:
            value = given.get("antiwindup", bool)
            given.replace(
                "antiwindup", {"antiwindup_strategy": "legacy", "antiwindup": value}
            )

    def check(self) -> None:
        """Raise ValueError if no PID can have these gains."""
        for name in ("p", "i", "d"):
            gain = getattr(self, name)
            if not math.isfinite(gain):
                raise ValueError(f"{name} must be a finite number, got {gain}")
        if not self.u_clamp_min < self.u_clamp_max:
            raise ValueError(
                f"u_clamp_min must be below u_clamp_max, got {self.u_clamp_min} and "
                f"{self.u_clamp_max}"
            )
        if not self.i_clamp_min <= 0.0 <= self.i_clamp_max:
            raise ValueError(
                f"i_clamp_min and i_clamp_max must have 0 between them, got "
                f"{self.i_clamp_min} and {self.i_clamp_max}"
            )
        if (
            self.antiwindup_strategy == "back_calculation"
            and not 0.0 <= self.tracking_time_constant < math.inf
        ):
            raise ValueError(
                f"tracking_time_constant must be at least 0, got "
                f"{self.tracking_time_constant}"
            )


def adapt_saturation(given: Given) -> None:
    """Take `saturation` of a PID: false switches the limits of the output off."""
    is_limited = given.get("saturation", bool)
    if is_limited is None:
        return
    for name in ("u_clamp_max", "u_clamp_min"):
        if not is_limited and name in given:
            what = "saturation is false"
            given.add(name, "warning", "ignored", what, "it has no effect")
            given.drop(name)
    given.drop("saturation")
