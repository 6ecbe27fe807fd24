"""``parallel_gripper_action_controller/GripperActionController``.

Source: ros2_controllers, `parallel_gripper_controller` (version 6.9.0). Parameters
only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_at_least, check_not_empty


@dc.dataclass(frozen=True)
class ParallelGripperActionControllerParameters:
    """Parameters of a GripperActionController with limits of effort and velocity."""

    # Joint to command.
    joint: str

    # Rate of results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # Interfaces to read of the joint.
    state_interfaces: tuple[str, ...] = ("position", "velocity")

    # Distance at which a goal is reached, at least 0 [rad] or [m].
    goal_tolerance: float = 0.01

    # Whether a goal succeeds where the gripper stalls.
    allow_stalling: bool = False

    # Speed below which the gripper stalls [rad/s] or [m/s], and after how long [s], at
    # least 0.
    stall_velocity_threshold: float = 0.001
    stall_timeout: float = 1.0

    # Full name of the interface that takes the limit of the effort; "" is none.
    max_effort_interface: str = ""

    # Effort where a goal has none, at least 0 [N·m] or [N].
    max_effort: float = 10.0

    # Full name of the interface that takes the limit of the velocity; "" is none.
    max_velocity_interface: str = ""

    # Velocity where a goal has none, at least 0 [rad/s] or [m/s].
    max_velocity: float = 0.1

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint")
        check_at_least(self, 0.1, "action_monitor_rate")
        check_at_least(
            self, 0.0, "goal_tolerance", "stall_timeout", "max_effort", "max_velocity"
        )
