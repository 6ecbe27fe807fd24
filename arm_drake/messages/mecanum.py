"""What a controller of a base with mecanum wheels tells."""

import dataclasses as dc

from arm_drake.messages.base import Header, Message
from arm_drake.messages.geometry import Twist


@dc.dataclass(frozen=True)
class MecanumDriveControllerState(Message):
    """State of a MecanumDriveController (`control_msgs`)."""

    header: Header = Header()

    # Measured velocities of the wheels [rad/s].
    front_left_wheel_velocity: float = 0.0
    front_right_wheel_velocity: float = 0.0
    back_right_wheel_velocity: float = 0.0
    back_left_wheel_velocity: float = 0.0

    # What is asked for, before limits; NaN if there is nothing.
    reference_velocity: Twist = dc.field(default_factory=Twist)
