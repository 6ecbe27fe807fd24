"""Kinematics, odometry and commands of a base on three or more omni wheels.

The rules are those of ros2_controllers' omni_wheel_drive_controller (version 6.9.0). A
velocity is forwards and to the left [m/s], and of turning to the left [rad/s]; n is the
number of wheels.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose
from arm_drake.messages import NANOSECONDS, TwistStamped

Velocity: TypeAlias = tuple[float, float, float]

UNKNOWN: Velocity = (math.nan, math.nan, math.nan)
REST: Velocity = (0.0, 0.0, 0.0)

# Shorter steps aren't integrated [s], and smaller turns are straight [rad].
_MIN_STEP = 1e-6
_MIN_TURN = 1e-6


@dc.dataclass(frozen=True, eq=False)
class OmniWheelKinematics:
    """Measures of a base, which take its velocity to its wheels and back."""

    # How many wheels there are, at least 3, anticlockwise at equal angles.
    num_wheels: int

    # Angle of the first one from the x axis [rad].
    wheel_offset: float

    # Distance of the wheels from the centre, and their radius [m].
    robot_radius: float
    wheel_radius: float

    # Velocity of the base to wheels, shape (n, 3), and its pseudo-inverse.
    _to_wheels: Array = dc.field(init=False, repr=False)
    _to_base: Array = dc.field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Prepare both matrices."""
        angles = 2.0 * np.pi / self.num_wheels * np.arange(self.num_wheels)
        angles += self.wheel_offset
        turn = np.full(self.num_wheels, -self.robot_radius)
        matrix = np.column_stack([np.sin(angles), -np.cos(angles), turn])
        object.__setattr__(self, "_to_wheels", matrix / self.wheel_radius)
        object.__setattr__(self, "_to_base", np.linalg.pinv(matrix) * self.wheel_radius)

    def to_wheels(self, velocity: Velocity) -> Array:
        """Return how the wheels turn [rad/s], shape (n,), for a velocity of the base.

        The wheel at the angle a turns with (vx sin a - vy cos a - robot_radius w) /
        wheel_radius.
        """
        return self._to_wheels @ np.array(velocity)

    def to_base(self, wheels: Array) -> Velocity:
        """Return the velocity of the base that fits the wheels best.

        Args:
            wheels: How the wheels turn [rad/s], shape (n,).
        """
        vx, vy, w = (self._to_base @ wheels).tolist()
        return vx, vy, w


class OmniWheelOdometry(NamedTuple):
    """Where a base takes itself to be, and how it moves."""

    # Of the wheels at the last step [rad], shape (n,).
    positions: tuple[float, ...]

    pose: PlanarPose = PlanarPose()
    velocity: Velocity = REST

    def from_positions(
        self, kinematics: OmniWheelKinematics, positions: Sequence[float], dt: float
    ) -> "OmniWheelOdometry":
        """Return the odometry after a step; itself if the step is too short.

        Args:
            kinematics: Measures of the base.
            positions: Where the wheels are [rad], shape (n,).
            dt: Length of the step [s].
        """
        if abs(dt) < _MIN_STEP:
            return self
        moved = (np.array(positions) - np.array(self.positions)) / dt
        new = self.from_velocities(kinematics, moved, dt)
        return new._replace(positions=tuple(positions))

    def from_velocities(
        self, kinematics: OmniWheelKinematics, velocities: Array, dt: float
    ) -> "OmniWheelOdometry":
        """Return the odometry after a step; itself if the step is too short.

        Args:
            kinematics: Measures of the base.
            velocities: How the wheels turn [rad/s], shape (n,).
            dt: Length of the step [s].
        """
        return self.move(kinematics.to_base(velocities), dt)

    def move(self, velocity: Velocity, dt: float) -> "OmniWheelOdometry":
        """Return the odometry after a step with one velocity of the base.

        It is itself if the step is too short.

        Args:
            velocity: Velocity of the base.
            dt: Length of the step [s].
        """
        if abs(dt) < _MIN_STEP:
            return self
        return self._replace(
            pose=_integrate(self.pose, velocity, dt), velocity=velocity
        )


class OmniWheelCommand(NamedTuple):
    """The last command, or when it began that there was none."""

    # [ns].
    stamp_ns: int

    velocity: Velocity = UNKNOWN

    @staticmethod
    def from_message(message: TwistStamped, time_ns: int) -> "OmniWheelCommand":
        """Return the command of a message; a stamp of 0 means now.

        Args:
            message: The message.
            time_ns: Time at which it came in [ns].
        """
        twist = message.twist
        return OmniWheelCommand(
            message.header.stamp.to_nanoseconds() or time_ns,
            (twist.linear.x, twist.linear.y, twist.angular.z),
        )

    def is_old(self, time_ns: int, timeout_ns: int) -> bool:
        """Return whether it is too old to be taken.

        Args:
            time_ns: Time at which it came in [ns].
            timeout_ns: Parameter `cmd_vel_timeout` [ns]; with 0 it never is.
        """
        return timeout_ns != 0 and time_ns - self.stamp_ns >= timeout_ns

    def find_fault(self, time_ns: int, timeout_ns: int) -> str:
        """Return why the base doesn't follow it; empty if it does.

        Args:
            time_ns: As in `is_old`.
            timeout_ns: As in `is_old`.
        """
        if self.is_old(time_ns, timeout_ns):
            age = (time_ns - self.stamp_ns) / NANOSECONDS
            return (
                f"it is {age:g} s old, not less than cmd_vel_timeout "
                f"({timeout_ns / NANOSECONDS:g} s); it is ignored"
            )
        if not all(map(math.isfinite, self.velocity)):
            return (
                "linear.x, linear.y and angular.z must be finite, got "
                f"{', '.join(map(str, self.velocity))}; the last reference goes on"
            )
        return ""

    def follow(self, time_ns: int, timeout_ns: int) -> Velocity:
        """Return what it asks for in a tick; NaN leaves the references.

        Args:
            time_ns: Time of the tick [ns].
            timeout_ns: Parameter `cmd_vel_timeout` [ns]; later there is rest.
        """
        if time_ns - self.stamp_ns > timeout_ns:
            return REST
        return self.velocity if all(map(math.isfinite, self.velocity)) else UNKNOWN


def _integrate(pose: PlanarPose, velocity: Velocity, dt: float) -> PlanarPose:
    """Return where a base stands that moved with one velocity in its own frame."""
    vx, vy, w = velocity
    turn = w * dt
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    heading = pose.heading + turn
    if abs(turn) < _MIN_TURN:
        dx, dy = vx * dt, vy * dt
        return PlanarPose(
            pose.x + dx * cos - dy * sin, pose.y + dx * sin + dy * cos, heading
        )
    change_cos, change_sin = math.cos(heading) - cos, math.sin(heading) - sin
    return PlanarPose(
        pose.x + (vx * change_sin + vy * change_cos) / w,
        pose.y + (vy * change_sin - vx * change_cos) / w,
        heading,
    )
