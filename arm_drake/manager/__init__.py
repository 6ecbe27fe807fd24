"""The controller manager: who runs when, and what the hardware is told."""

from arm_drake.manager.controller_manager import (
    MANAGER,
    STORED_PORT,
    SWITCH_PORT,
    ControllerManager,
)

__all__ = ["MANAGER", "STORED_PORT", "SWITCH_PORT", "ControllerManager"]
