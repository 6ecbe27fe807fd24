"""Gazebo's plugins for bases with two steered wheels, which aren't ros2_control's.

Source: gz-sim, src/systems/ackermann_steering/AckermannSteering.cc.
"""

import math
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose, WheelOdometryState
from arm_drake.controllers.bases.base import Velocity
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import NEVER_NS
from arm_drake.controllers.gazebo.drive import (
    GazeboDrive,
    GazeboDriveState,
    clamp,
)
from arm_drake.controllers.gazebo.plugin import GazeboPid, drive_topics
from arm_drake.description.gazebo_plugins import (
    AckermannSteering as AckermannSteeringTag,
)
from arm_drake.messages import Float64, Twist

# Slower turns are none [rad/s], and the radius of those that are none [m].
_NO_TURN = 0.001
_STRAIGHT = 1e9


class AckermannGeometry(NamedTuple):
    """Measures of a base whose front wheels are steered [m]."""

    wheel_base: float
    wheel_separation: float
    kingpin_width: float
    wheel_radius: float

    # Largest angle of steering [rad].
    limit: float

    def turning_radius(self, v: float, w: float) -> float:
        """Return the radius of a way, positive to the left [m].

        It is no smaller than wheel_base / sin(limit). A base that stands is steered as
        far as it goes.
        """
        if abs(w) < _NO_TURN:
            return _STRAIGHT
        smallest = self.wheel_base / math.sin(self.limit)
        radius = v / w
        if v == 0.0:
            return math.copysign(smallest, w)
        return math.copysign(max(abs(radius), smallest), radius)

    def rates(self, v: float, radius: float) -> tuple[float, float]:
        """Return how the left and the right driven wheel turn [rad/s]."""
        lean = self.wheel_separation / (2.0 * radius)
        rate = v / self.wheel_radius
        return rate * (1.0 - lean), rate * (1.0 + lean)

    def angles(self, radius: float) -> tuple[float, float]:
        """Return the angles of the left and the right steering joint [rad]."""
        half = self.kingpin_width / 2.0
        left, right = (
            math.atan(self.wheel_base / arm) if arm else math.pi / 2.0
            for arm in (radius - half, radius + half)
        )
        return left, right

    def angles_around(self, angle: float) -> tuple[float, float]:
        """Return the same for an angle of the wheel between them [rad]."""
        across = 2.0 * self.wheel_base * math.sin(angle)
        along = 2.0 * self.wheel_base * math.cos(angle)
        shift = self.wheel_separation * math.sin(angle)
        left, right = (math.atan(across / (along + d)) for d in (-shift, shift))
        return left, right


class AckermannSteering(GazeboDrive):
    """Turns wheels and steers so that a base moves as it is told.

    With J joints and k of them moved:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       Twist: velocity forwards and of turning. Where it
                                       steers alone, Float64: the angle [rad]
    command_interfaces  --    rad/s    UpdateResult; command (k,): left wheels, right
                                       wheels, left and right steering joints
    /<odom_topic>       --    --       Odometry: where the base is by its wheels; not
                                       where it steers alone
    /<tf_topic>         --    --       TFMessage with the same
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a GazeboDriveState, renewed in every tick. The last command holds for
    ever; there is no timeout. With v and w within the limits (`SpeedLimits`) and the
    radius of `AckermannGeometry.turning_radius`::

        left, right = v (1 -+ wheel_separation / (2 radius)) / wheel_radius

    for all wheels of a side. A steering joint gets a velocity, too: that of a PID whose
    memory is cleared in every tick, from the error of the first joint of its side. The
    angles are atan(wheel_base / (radius -+ kingpin_width / 2)). Where it steers alone
    the limits of the speed of turning hold for the angle, then ``steering_limit``.

    The odometry counts the first wheel of each side from the angle 0 on, whatever it is
    at the start, with the mean of both sides' steering angles; a step goes where the
    base looks at its end. Velocities are those of the last tick. It is published at
    times 1 / ``odom_publish_frequency`` apart; with a frequency of 0 in every tick. Its
    covariances are 0.

    A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    def __init__(
        self, tag: AckermannSteeringTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        self._steers_alone = tag.is_steering_alone
        self._geometry = AckermannGeometry(
            tag.wheel_base,
            tag.wheel_separation,
            tag.kingpin_width,
            tag.wheel_radius,
            tag.steering_limit,
        )
        self._pid = GazeboPid.from_gains(
            *(
                (value, value)
                for value in (
                    *(tag.steer_p_gain, tag.steer_i_gain, tag.steer_d_gain),
                    *(tag.steer_i_max, tag.steer_i_min),
                    *(tag.steer_cmd_max, tag.steer_cmd_min, tag.steer_cmd_offset),
                )
            )
        )
        steering = (tag.left_steering_joints, tag.right_steering_joints)
        wheels = () if self._steers_alone else (tag.left_joints, tag.right_joints)
        groups = (*wheels, *steering)
        # A joint of several follows the last of them.
        moved = {joint: at for at, joints in enumerate(groups) for joint in joints}
        self._group = np.array(list(moved.values()), dtype=np.intp)
        first = [joints[0] for joints in groups]
        super().__init__(tag, params, measured=first, commanded=list(moved))
        topics = drive_topics(tag, params.robot_name)
        if self._steers_alone:
            self._period_ns = NEVER_NS
            self._subscribe(topics.command, Float64, self._take_angle)
        else:
            self._subscribe(topics.command, Twist, self._take_twist)
            self._declare_odometry(topics.odometry, topics.tf)
        self._declare_events()

    def _limit(
        self, target: Velocity, limited: tuple[Velocity, Velocity], dt: float
    ) -> tuple[Velocity, Velocity]:
        (v, w), last = super()._limit(target, limited, dt)
        if self._steers_alone:
            w = clamp(w, -self._geometry.limit, self._geometry.limit)
        return (v, w), last

    def _find_command(self, velocity: Velocity, measured: Array, dt: float) -> Array:
        v, w = velocity
        if self._steers_alone:
            rates: tuple[float, ...] = ()
            angles = self._geometry.angles_around(w)
        else:
            radius = self._geometry.turning_radius(v, w)
            rates = self._geometry.rates(v, radius)
            angles = self._geometry.angles(radius)
        error = measured[-2:] - angles
        _, steering = self._pid.step(self._pid.initial(), error, dt)
        return np.array([*rates, *steering.tolist()])[self._group]

    def _count(
        self, odometry: WheelOdometryState, measured: Array, dt: float
    ) -> WheelOdometryState:
        if self._steers_alone:
            return odometry
        left, right, left_angle, right_angle = measured.tolist()
        turned = left - odometry.positions[0] + right - odometry.positions[1]
        way = 0.5 * self._geometry.wheel_radius * turned
        angle = way * math.tan(0.5 * (left_angle + right_angle))
        angle /= self._geometry.wheel_base
        heading = math.remainder(odometry.pose.heading + angle, 2.0 * math.pi)
        pose = PlanarPose(
            odometry.pose.x + way * math.cos(heading),
            odometry.pose.y + way * math.sin(heading),
            heading,
        )
        return odometry._replace(
            pose=pose, velocity=(way / dt, angle / dt), positions=(left, right)
        )

    def _take_angle(
        self, state: GazeboDriveState, message: Float64, time_ns: int, obstacle: str
    ) -> tuple[GazeboDriveState, str]:
        """Return the state with an angle of steering."""
        if obstacle:
            return state, obstacle
        if not math.isfinite(message.data):
            return state, f"data must be finite, got {message.data}; it is dropped"
        return state._replace(target=(0.0, message.data)), ""
