"""Gazebo's plugins for bases with two steered wheels, which aren't ros2_control's.

Sources: gz-sim, src/systems/ackermann_steering/AckermannSteering.cc; gazebo_ros_pkgs,
branch ros2, gazebo_plugins/src/gazebo_ros_ackermann_drive.cpp; Gazebo Classic,
gazebo/common/PID.cc, which is that of `GazeboPid`.
"""

import math
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose, WheelOdometryState
from arm_drake.controllers.bases.base import Velocity
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import NEVER_NS, UpdateContext
from arm_drake.controllers.gazebo.drive import (
    REST,
    ClassicController,
    GazeboDrive,
    GazeboDriveState,
    clamp,
)
from arm_drake.controllers.gazebo.plugin import (
    GazeboPid,
    GazeboPidState,
    JointForces,
    drive_topics,
    find_number_fault,
    is_early,
)
from arm_drake.controllers.topics import Inbox
from arm_drake.description.gazebo_plugins import (
    AckermannSteering as AckermannSteeringTag,
)
from arm_drake.description.gazebo_plugins import (
    GazeboRosAckermannDrive as GazeboRosAckermannDriveTag,
)
from arm_drake.messages import (
    NANOSECONDS,
    Float64,
    Odometry,
    TransformStamped,
)
from arm_drake.messages.control import Float32

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
    """Drives and steers the wheels of a base by its velocity command.

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
        super().__init__(tag, params, groups, only_steers=self._steers_alone)
        if self._steers_alone:
            self._period_ns = NEVER_NS
            topic = drive_topics(tag, params.robot_name).command
            self._subscribe(topic, Float64, self._take_angle)

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
        self, state: GazeboDriveState, message: Float64, time_ns: int
    ) -> tuple[GazeboDriveState, str]:
        """Return the state with an angle of steering."""
        if fault := find_number_fault(message):
            return state, fault
        return state._replace(target=(0.0, message.data)), ""


class ClassicAckermannState(NamedTuple):
    """State of a GazeboRosAckermannDrive between two ticks."""

    # What to write, shape (k,); NaN leaves one as it is.
    command: Array

    # Of the PIDs of speed, left and right steering.
    pids: GazeboPidState

    # Forwards [m/s], and the angle of steering [rad].
    target: tuple[float, float] = REST

    # When the joints were pushed last [ns].
    last_ns: int = 0

    # Where the base was at the last tick, None before the first; and how far it has
    # come [m].
    truth: RigidTransform | None = None
    distance: float = 0.0

    # What was published last.
    published: Odometry = Odometry()
    published_distance: Float32 = Float32()
    wheels: tuple[TransformStamped, ...] = ()

    inbox: Inbox = Inbox()


class GazeboRosAckermannDrive(ClassicController[ClassicAckermannState]):
    """Pushes and steers wheels by a velocity command, as Gazebo Classic does.

    With J joints and k of them moved:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    link_frames         --    --       list of RigidTransform: pose of each link in the
                                       world
    /cmd_vel            --    --       Twist: velocity forwards, and as the velocity of
                                       turning the angle of steering [rad]
    command_interfaces  --    N·m,     UpdateResult; (k,): efforts of the rear wheels
                              rad      and of the steering; the steering wheel's angle
    /odom               --    --       Odometry: the truth, if ``publish_odom``
    /distance           --    --       Float32: the way so far [m], if
                                       ``publish_distance``
    /tf                 --    --       TFMessage with the odometry, if
                                       ``publish_odom_tf``, and with the wheels, if
                                       ``publish_wheel_tf``
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    Topics have the names that namespace and remappings make. The state is a
    ClassicAckermannState, renewed in every tick. An update comes 1 / ``update_rate``
    after the last one at the earliest; a rate of 0 is every tick. It publishes, then
    pushes: with the speed v and the angle a, each within its limits and a turned round
    with v < 0, the PID of the speed works on the error of the right rear wheel's
    velocity against v / wheel_radius, for both rear wheels, and those of the steering
    on errors against::

        left, right = atan2(tan(a), 1 -+ wheel_separation tan(a) / (2 wheel_base))

    As in Gazebo, the forces act for one tick, not until the next update: with gains for
    an ``update_rate`` of 100 Hz they act a tenth of the time. The last command holds
    for ever. A steering wheel is put where the mean of both angles has it.

    The odometry is the truth, in the world's coordinates; its velocities are means over
    a tick, Gazebo's are of that instant. Without link_frames its messages are empty. A
    message with a number that isn't finite is dropped, which Gazebo takes.
    """

    _tag: GazeboRosAckermannDriveTag

    def __init__(
        self, tag: GazeboRosAckermannDriveTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        self._pids = _make_pids(tag)
        # What turns both rear wheels is the first force.
        places = {
            **dict.fromkeys(tag.driven_joints, 0),
            **dict.fromkeys(tag.left_steering_joints, 1),
            **dict.fromkeys(tag.right_steering_joints, 2),
        }
        self._forces = JointForces.from_joints(
            places, params.followed, params.effort_limits
        )
        efforts = [f"{joint}/effort" for joint in self._forces.joints]
        put = [f"{joint}/position" for joint in tag.steering_wheel_joints]
        self._rest = np.array([0.0] * len(efforts) + [math.nan] * len(put))
        super().__init__(
            tag,
            params,
            ClassicAckermannState(self._rest, self._pids.initial()),
            state_interfaces=(
                f"{tag.rear_right_joints[0]}/velocity",
                f"{tag.left_steering_joints[0]}/position",
                f"{tag.right_steering_joints[0]}/position",
            ),
            command_interfaces=(*efforts, *put),
        )
        distance = {"distance": attrgetter("published_distance")}
        self._declare_outputs(**(distance if tag.publish_distance else {}))

    def _update(
        self, now: UpdateContext, state: ClassicAckermannState
    ) -> ClassicAckermannState:
        state = self._receive(now, state)
        elapsed_ns = now.time_ns - state.last_ns
        is_due = not is_early(elapsed_ns, self._tag.update_rate)
        state = self._look(now, state, is_due)
        if not is_due:
            return state._replace(command=self._rest)
        rate, left, right = self._measured_now(now).tolist()
        wanted = self._find_targets(*state.target)
        error = np.array([rate, left, right]) - wanted
        pids, forces = self._pids.step(state.pids, error, elapsed_ns / NANOSECONDS)
        ratio = self._tag.max_steer / self._tag.max_steering_angle
        put = [0.5 * (left + right) / ratio] * len(self._tag.steering_wheel_joints)
        command = np.array([*self._forces.to_efforts(forces).tolist(), *put])
        return state._replace(command=command, pids=pids, last_ns=now.time_ns)

    def _find_targets(self, v: float, angle: float) -> tuple[float, float, float]:
        """Return rates of the rear wheels, and angles of the left and right one."""
        tag = self._tag
        speed = clamp(v, -tag.max_speed, tag.max_speed)
        angle *= math.copysign(1.0, v)
        slope = math.tan(clamp(angle, -tag.max_steer, tag.max_steer))
        lean = tag.wheel_separation / 2.0 / tag.wheel_base * slope
        left, right = (math.atan2(slope, 1.0 + d) for d in (-lean, lean))
        return speed / tag.wheel_radius, left, right

    def _look(
        self, now: UpdateContext, state: ClassicAckermannState, is_due: bool
    ) -> ClassicAckermannState:
        """Return the state with where the base is, and what is published if it is due.

        Gazebo counts the way in every step.
        """
        if not (poses := self._see(now)):
            return state
        base, *wheels = poses
        last = state.truth or base
        x, y, _ = (base.translation() - last.translation()).tolist()
        distance = state.distance + math.hypot(x, y)
        state = state._replace(truth=base, distance=distance)
        if not is_due:
            return state
        time_ns, dt = now.time_ns, now.period_ns / NANOSECONDS
        return state._replace(
            published=self._describe_base(time_ns, last, base, dt),
            published_distance=Float32(distance),
            wheels=self._describe_wheels(time_ns, base, wheels),
        )

    def _activate(
        self, now: UpdateContext, state: ClassicAckermannState
    ) -> ClassicAckermannState:
        # Where the base was when it stopped tells no velocity.
        return state._replace(truth=None)

    def _deactivate(
        self, now: UpdateContext, state: ClassicAckermannState
    ) -> ClassicAckermannState:
        return state._replace(
            command=self._rest, target=REST, pids=self._pids.initial()
        )


def _make_pids(tag: GazeboRosAckermannDriveTag) -> GazeboPid:
    """Return the PIDs of speed, left and right steering; commands have no limits."""
    parts = ("linear_velocity", "left_steering", "right_steering")
    gains = [getattr(tag, f"{part}_pid_gain") or (0.0,) * 3 for part in parts]
    ranges = [getattr(tag, f"{part}_i_range") or (0.0, 0.0) for part in parts]
    p, i, d = zip(*gains, strict=True)
    i_min, i_max = zip(*ranges, strict=True)
    none = (math.inf,) * len(parts)
    return GazeboPid.from_gains(
        p, i, d, i_max, i_min, none, [-limit for limit in none], (0.0,) * len(parts)
    )
