"""The controller manager: loading, switching, and the read-update-write loop."""

from arm_drake.manager.controller_manager import (
    MANAGER,
    NUMBERS_PORT,
    STORED_PORT,
    SWITCH_PORT,
    ControllerManager,
)

__all__ = [
    "MANAGER",
    "NUMBERS_PORT",
    "STORED_PORT",
    "SWITCH_PORT",
    "ControllerManager",
]
