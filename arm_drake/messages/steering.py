"""What steered bases publish besides odometry (`control_msgs`, `ackermann_msgs`)."""

import dataclasses as dc

from arm_drake.messages.base import Header, Message


@dc.dataclass(frozen=True)
class SteeringControllerStatus(Message):
    """What a steering controller measures and commands (`control_msgs`).

    Of two wheels the right one comes first.
    """

    header: Header = Header()

    # Of the driven wheels: [rad] where positions are read, else (), and [rad/s] where
    # velocities are read, else ().
    traction_wheels_position: tuple[float, ...] = ()
    traction_wheels_velocity: tuple[float, ...] = ()

    # Of the steered wheels [rad].
    steer_positions: tuple[float, ...] = ()

    # Commands of the driven [rad/s] and of the steered wheels [rad]; NaN where there
    # was none yet.
    traction_command: tuple[float, ...] = ()
    steering_angle_command: tuple[float, ...] = ()


@dc.dataclass(frozen=True)
class AckermannDrive(Message):
    """How a steered base is to drive (`ackermann_msgs`)."""

    # [rad], and its rate of change [rad/s].
    steering_angle: float = 0.0
    steering_angle_velocity: float = 0.0

    # [m/s]; upstream's tricycle_controller puts the wheel's velocity here [rad/s].
    speed: float = 0.0

    # [m/s^2].
    acceleration: float = 0.0

    # [m/s^3].
    jerk: float = 0.0


@dc.dataclass(frozen=True, eq=False)
class ResetOdometry(Message):
    """Request of the service `reset_odometry` (`std_srvs/Empty`), one of its own."""
