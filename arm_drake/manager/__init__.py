"""The controller manager: loading, switching, and the read-update-write loop."""

from arm_drake.manager.controller_manager import (
    MANAGER,
    STORED_PORT,
    SWITCH_PORT,
    ControllerManager,
)

__all__ = ["MANAGER", "STORED_PORT", "SWITCH_PORT", "ControllerManager"]
