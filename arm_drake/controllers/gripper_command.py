"""The plain topic `gripper_command`: a number from 0 (open) to 1 (closed)."""

from arm_drake.messages import Float64

# Name of the port.
GRIPPER_COMMAND = "gripper_command"


def find_part_fault(message: Float64) -> str:
    """Return why a gripper can't take a `gripper_command`; empty if it can."""
    if 0.0 <= message.data <= 1.0:
        return ""
    return f"data must be from 0 (open) to 1 (closed), got {message.data}"


def position_of(part: float, ends: tuple[float, float]) -> float:
    """Return a position [rad] or [m] by a part: 0 is open, 1 is closed.

    Args:
        part: From 0 to 1.
        ends: Where the gripper is open and where closed [rad] or [m].
    """
    is_open, is_closed = ends
    return (1.0 - part) * is_open + part * is_closed
