"""Kinematics, odometry and references of a base with four mecanum wheels.

The rules are those of ros2_controllers' mecanum_drive_controller (version 6.9.0). A
velocity is forwards and to the left [m/s], and of turning to the left [rad/s].
"""

import math
from typing import NamedTuple, TypeAlias

from arm_drake.control.odometry import PlanarPose
from arm_drake.messages import NANOSECONDS, TwistStamped

Velocity: TypeAlias = tuple[float, float, float]

UNKNOWN: Velocity = (math.nan, math.nan, math.nan)
REST: Velocity = (0.0, 0.0, 0.0)

# Shorter steps aren't integrated [s].
_MIN_STEP = 1e-4


class MecanumWheels(NamedTuple):
    """A velocity of each wheel [rad/s], in the order in which they are claimed."""

    front_left: float
    front_right: float
    rear_right: float
    rear_left: float


class MecanumKinematics(NamedTuple):
    """Measures of a base, which take its velocity to its wheels and back."""

    # Radius of the wheels [m].
    radius: float

    # Distances of the wheels from their centre, along x plus along y [m].
    reach: float

    # Offset of the base frame against the wheels' centre.
    offset: PlanarPose = PlanarPose()

    def to_wheels(self, velocity: Velocity) -> MecanumWheels:
        """Return how the wheels turn for a velocity of the base frame.

        With the velocity R(offset.heading) (vx, vy) + w (offset.y, -offset.x) of the
        wheels' centre, each wheel turns with (vx -+ vy -+ reach w) / radius.

        Args:
            velocity: Velocity of the base frame.
        """
        w = velocity[2]
        vx, vy = _rotate(velocity[0], velocity[1], self.offset.heading)
        vx, vy = vx + self.offset.y * w, vy - self.offset.x * w
        turn = self.reach * w
        return MecanumWheels(
            (vx - vy - turn) / self.radius,
            (vx + vy + turn) / self.radius,
            (vx - vy + turn) / self.radius,
            (vx + vy - turn) / self.radius,
        )

    def to_base(self, wheels: MecanumWheels) -> Velocity:
        """Return the velocity of the base frame that fits the wheels best.

        Args:
            wheels: How the wheels turn [rad/s].
        """
        front_left, front_right, rear_right, rear_left = wheels
        quarter = self.radius / 4.0
        vx = quarter * (front_left + rear_left + rear_right + front_right)
        vy = quarter * (-front_left + rear_left - rear_right + front_right)
        w = quarter / self.reach * (-front_left - rear_left + rear_right + front_right)
        back = -self.offset.heading
        vx, vy = _rotate(vx, vy, back)
        x, y = _rotate(-self.offset.x, -self.offset.y, back)
        return vx + y * w, vy - x * w, w


class MecanumOdometry(NamedTuple):
    """Where a base takes itself to be, and how it moves."""

    pose: PlanarPose = PlanarPose()
    velocity: Velocity = REST

    def update(
        self, kinematics: MecanumKinematics, wheels: MecanumWheels, dt: float
    ) -> "MecanumOdometry":
        """Return the odometry after a step; itself if the step is too short.

        The position moves with the heading at the end of the step. Velocities are not
        filtered.

        Args:
            kinematics: Measures of the base.
            wheels: How the wheels turn [rad/s].
            dt: Length of the step [s].
        """
        if dt < _MIN_STEP:
            return self
        velocity = kinematics.to_base(wheels)
        heading = self.pose.heading + velocity[2] * dt
        vx, vy = _rotate(velocity[0], velocity[1], heading)
        pose = PlanarPose(self.pose.x + vx * dt, self.pose.y + vy * dt, heading)
        return MecanumOdometry(pose, velocity)


class MecanumReference(NamedTuple):
    """What the last message asks for."""

    # NaN if there is nothing, or nothing any more.
    velocity: Velocity = UNKNOWN

    # [ns].
    stamp_ns: int = 0

    @staticmethod
    def from_message(message: TwistStamped, time_ns: int) -> "MecanumReference":
        """Return what a message asks for; a stamp of 0 means now.

        Args:
            message: The message.
            time_ns: Time at which it came in [ns].
        """
        twist = message.twist
        return MecanumReference(
            (twist.linear.x, twist.linear.y, twist.angular.z),
            message.header.stamp.to_nanoseconds() or time_ns,
        )

    def find_fault(self, time_ns: int, timeout_ns: int) -> str:
        """Return why it stops the base instead; empty if it doesn't.

        Args:
            time_ns: Time at which it came in [ns].
            timeout_ns: Parameter `reference_timeout` [ns]; 0 is none.
        """
        age_ns = time_ns - self.stamp_ns
        if timeout_ns and age_ns > timeout_ns:
            return (
                f"it is {age_ns / NANOSECONDS:g} s old, more than reference_timeout "
                f"({timeout_ns / NANOSECONDS:g} s); the base stops"
            )
        if not all(map(math.isfinite, self.velocity)):
            return (
                "linear.x, linear.y and angular.z must be finite, got "
                f"{', '.join(map(str, self.velocity))}; the base stops"
            )
        return ""

    def follow(
        self, time_ns: int, timeout_ns: int
    ) -> tuple["MecanumReference", Velocity]:
        """Return what is left of it, and what it asks for in a tick.

        What is too old asks for rest, once; without a timeout it holds for one tick.

        Args:
            time_ns: Time of the tick [ns].
            timeout_ns: Parameter `reference_timeout` [ns]; 0 is none.
        """
        if math.isnan(self.velocity[0]):
            return self, self.velocity
        if not timeout_ns:
            return MecanumReference(), self.velocity
        if time_ns - self.stamp_ns <= timeout_ns:
            return self, self.velocity
        return MecanumReference(), REST


def _rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y
