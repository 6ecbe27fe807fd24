"""What comes in on the ports of a DiffDriveController, and what follows from it."""

import math
from typing import NamedTuple

from pydrake.systems.framework import InputPort

from arm_drake.control.diff_drive import DiffDriveKinematics
from arm_drake.control.odometry import PlanarPose
from arm_drake.control.rate_limiter import RateLimiter
from arm_drake.controllers.bases.diff_drive_parameters import (
    DiffDriveControllerParameters,
)
from arm_drake.controllers.bases.speed_limits import SpeedLimits
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import (
    Events,
    Rejection,
    add_events,
    new_messages,
    new_parameters,
)
from arm_drake.messages import (
    NANOSECONDS,
    Message,
    ParametersRejected,
    SetOdometry,
    TopicRejected,
    Twist,
    TwistStamped,
)

# Parameters that can't change while the controller runs.
_READ_ONLY = (
    "left_wheel_names",
    "right_wheel_names",
    "open_loop",
    "position_feedback",
    "use_stamped_vel",
    "enable_odom_tf",
    "publish_limited_velocity",
)


class DiffDrivePorts(NamedTuple):
    """Input ports of a DiffDriveController."""

    cmd_vel: InputPort
    set_odometry: InputPort
    parameters: InputPort

    # Only where Twists are taken, too.
    unstamped: InputPort | None = None


class DiffDriveInbox(NamedTuple):
    """What came in on the ports of a DiffDriveController."""

    # Parameters in effect, and what they set: the limits forwards and of turning, and
    # the measures that wheels are commanded with.
    parameters: DiffDriveControllerParameters
    limiters: tuple[RateLimiter, RateLimiter]
    kinematics: DiffDriveKinematics

    # Last command: forwards [m/s], turning [rad/s]; and its stamp [ns], None before
    # the first cycle.
    command: tuple[float, float]
    stamp_ns: int | None = None

    # Pose to be taken at the next tick that moves.
    pose: PlanarPose | None = None

    # What was on the ports at the last tick.
    offered: object = ()
    stamped: tuple[TwistStamped, ...] = ()
    unstamped: tuple[Twist, ...] = ()
    requests: tuple[SetOdometry, ...] = ()

    # The latest of all that was not accepted.
    events: Events = ()


def follow(
    inbox: DiffDriveInbox,
    reference: tuple[float, float],
    time_ns: int,
    *,
    timeout_ns: int,
) -> tuple[float, float]:
    """Return the reference that the last command makes: forwards, turning.

    Args:
        inbox: What has come in.
        reference: What was asked for before; it stays if the command isn't finite.
        time_ns: Time of the tick [ns].
        timeout_ns: From which age a command counts no more [ns]; 0 is never.
    """
    assert inbox.stamp_ns is not None
    if timeout_ns and time_ns - inbox.stamp_ns > timeout_ns:
        return 0.0, 0.0
    return inbox.command if all(map(math.isfinite, inbox.command)) else reference


def receive(
    now: Now,
    ports: DiffDrivePorts,
    inbox: DiffDriveInbox,
    *,
    timeout_ns: int,
    obstacle: str = "",
) -> DiffDriveInbox:
    """Return what has come in.

    Args:
        now: The time, and where the inputs are read.
        ports: The inputs.
        inbox: What had come in at the last tick.
        timeout_ns: From which age commands aren't taken [ns]; 0 is any.
        obstacle: Why no command is taken; empty if they are.
    """
    context = now.context
    news: list[Rejection] = []
    if inbox.stamp_ns is None:
        inbox = inbox._replace(stamp_ns=now.time_ns)
    offered = new_parameters(ports.parameters, context, inbox.offered)
    if offered is not inbox.offered:
        inbox = inbox._replace(offered=offered)
        try:
            parameters = _accept(offered, inbox.parameters)
        except ValueError as error:
            news.append(ParametersRejected(str(error)))
        else:
            inbox = inbox._replace(
                parameters=parameters,
                limiters=make_limiters(parameters),
                kinematics=make_kinematics(parameters),
            )
    new, stamped = new_messages(ports.cmd_vel, context, TwistStamped, inbox.stamped)
    for message in new:
        inbox = _take(now, inbox, message, message, obstacle, timeout_ns, news)
    unstamped = inbox.unstamped
    if ports.unstamped is not None:
        twists, unstamped = new_messages(
            ports.unstamped, context, Twist, inbox.unstamped
        )
        for twist in twists:
            stamp = TwistStamped(twist=twist)
            inbox = _take(now, inbox, stamp, twist, obstacle, timeout_ns, news)
    asked, requests = new_messages(
        ports.set_odometry, context, SetOdometry, inbox.requests
    )
    for request in asked:
        inbox = inbox._replace(pose=PlanarPose(request.x, request.y, request.yaw))
    if (
        not news
        and stamped is inbox.stamped
        and unstamped is inbox.unstamped
        and requests is inbox.requests
    ):
        return inbox
    return inbox._replace(
        stamped=stamped,
        unstamped=unstamped,
        requests=requests,
        events=add_events(inbox.events, news),
    )


def _take(
    now: Now,
    inbox: DiffDriveInbox,
    message: TwistStamped,
    sent: Message,
    obstacle: str,
    timeout_ns: int,
    news: list[Rejection],
) -> DiffDriveInbox:
    """Return what has come in with one more command, if it can be taken."""
    stamp_ns = message.header.stamp.to_nanoseconds() or now.time_ns
    age_ns = now.time_ns - stamp_ns
    command = (message.twist.linear.x, message.twist.angular.z)
    fault = obstacle
    if not fault and timeout_ns and age_ns >= timeout_ns:
        fault = f"it is {age_ns / NANOSECONDS:g} s old; cmd_vel_timeout is less"
    if fault:
        news.append(TopicRejected(sent, fault))
        return inbox
    if not all(map(math.isfinite, command)):
        # Its stamp counts nevertheless.
        what = "linear.x and angular.z must be finite; the last reference stays"
        news.append(TopicRejected(sent, what))
    return inbox._replace(command=command, stamp_ns=stamp_ns)


def make_kinematics(given: DiffDriveControllerParameters) -> DiffDriveKinematics:
    """Return the measures of a base, corrected."""
    return DiffDriveKinematics(
        given.wheel_separation * given.wheel_separation_multiplier,
        given.wheel_radius * given.left_wheel_radius_multiplier,
        given.wheel_radius * given.right_wheel_radius_multiplier,
    )


def make_limiters(
    given: DiffDriveControllerParameters,
) -> tuple[RateLimiter, RateLimiter]:
    """Return the limits of the velocities forwards and of turning."""
    return _make_limiter(given.linear.x), _make_limiter(given.angular.z)


def _make_limiter(limits: SpeedLimits) -> RateLimiter:
    return RateLimiter(
        min_value=limits.min_velocity,
        max_value=limits.max_velocity,
        min_first_derivative_neg=limits.max_acceleration_reverse,
        max_first_derivative_pos=limits.max_acceleration,
        min_first_derivative_pos=limits.max_deceleration,
        max_first_derivative_neg=limits.max_deceleration_reverse,
        min_second_derivative=limits.min_jerk,
        max_second_derivative=limits.max_jerk,
    )


def _accept(
    offered: object, present: DiffDriveControllerParameters
) -> DiffDriveControllerParameters:
    """Return parameters that are to be taken; raise ValueError for bad ones."""
    if offered == ():  # Nothing is on the port any more.
        return present
    if not isinstance(offered, DiffDriveControllerParameters):
        raise ValueError(f"expected DiffDriveControllerParameters, got {offered!r}")
    for name in _READ_ONLY:
        if getattr(offered, name) != getattr(present, name):
            raise ValueError(f"{name} can't change while the controller runs")
    return offered
