"""Switching controllers: what happens, in which order, and who commands whom."""

from arm_drake.switching.chains import (
    ControllerInfo,
    chained,
    find_cycle,
    sort_controllers,
)
from arm_drake.switching.plan import SwitchPlan, plan_switch

__all__ = [
    "ControllerInfo",
    "SwitchPlan",
    "chained",
    "find_cycle",
    "plan_switch",
    "sort_controllers",
]
