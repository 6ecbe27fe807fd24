"""``GripperActionController`` of `position_controllers` and `effort_controllers`.

Source: ros2_controllers, `gripper_controllers` (jazzy). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.pid_gains import PidGains
from arm_drake.controllers.validation import check_at_least, check_not_empty
from arm_drake.description.parameters import per_element_of


@dc.dataclass(frozen=True)
class GripperActionControllerParameters:
    """Parameters of a GripperActionController that commands a position."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Largest effort of a hold, at least 0 [N·m] or [N].
    max_effort: float = 0.0

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s].
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(self, 0.0, "goal_tolerance", "max_effort")


@dc.dataclass(frozen=True)
class GripperGains:
    """PID of the gripper's joint."""

    joint: dict[str, PidGains] = per_element_of("joint")


@dc.dataclass(frozen=True)
class EffortGripperActionControllerParameters(GripperActionControllerParameters):
    """Parameters of a GripperActionController that commands an effort."""

    gains: GripperGains = GripperGains()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        super().__post_init__()
        for gains in self.gains.joint.values():
            gains.check()
