"""Switching controllers: what happens, in which order, and who commands whom."""

from arm_drake.switching.chains import (
    ControllerInfo,
    activation_order,
    chain_of,
    chained,
    find_cycle,
)
from arm_drake.switching.plan import SwitchPlan, plan_switch

__all__ = [
    "ControllerInfo",
    "SwitchPlan",
    "activation_order",
    "chain_of",
    "chained",
    "find_cycle",
    "plan_switch",
]
