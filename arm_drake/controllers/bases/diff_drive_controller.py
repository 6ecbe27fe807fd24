"""``diff_drive_controller/DiffDriveController``.

Source: ros2_controllers, `diff_drive_controller` (version 6.9.0; humble starts with a
command of 0). Kinematics and odometry are `arm_drake.control.diff_drive`.

Parameters of ``diff_drive_controller/DiffDriveController``.

Source: ros2_controllers, `diff_drive_controller` (version 6.9.0; defaults of jazzy, and
by rule those of other distros).
"""

import dataclasses as dc
import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import InputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.diff_drive import (
    DiffDriveKinematics,
    DiffDriveOdometryState,
    from_commands,
)
from arm_drake.control.odometry import PlanarPose, RollingMean
from arm_drake.control.rate_limiter import RateLimiter
from arm_drake.controllers.bases.base import (
    SpeedLimits,
    diagonal,
    make_odometry,
    make_transform,
    resolve_frames,
)
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import (
    CHAINED,
    INACTIVE,
    Events,
    Rejection,
    add_events,
    new_messages,
    new_parameters,
)
from arm_drake.description.parameters import (
    Given,
    Rule,
    check_above,
    check_at_least,
    check_duration,
    check_length,
    check_not_empty,
    check_not_zero,
)
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Message,
    Odometry,
    ParametersRejected,
    SetOdometry,
    TopicRejected,
    Twist,
    TwistStamped,
    Vector3,
)

_DECELERATIONS = (
    "max_deceleration",
    "max_acceleration_reverse",
    "max_deceleration_reverse",
)
_LIMITS = {
    "velocity": ("max_velocity", "min_velocity"),
    "acceleration": ("max_acceleration", "min_acceleration"),
    "jerk": ("max_jerk", "min_jerk"),
}


@dc.dataclass(frozen=True)
class DiffDriveSpeedLimits(SpeedLimits):
    """Limits of a velocity, which humble's has_*_limits switch on."""

    @staticmethod
    def adapt(given: Given) -> None:
        """Take has_*_limits: a limit is off by it, and in humble without it.

        Source: ros2_controllers, pull request 1315, which only makes them deprecated.
        """
        for kind, names in _LIMITS.items():
            gate = f"has_{kind}_limits"
            is_on = given.get(gate, bool)
            limits = [n for n in names if _is_number(given.get(n, float))]
            if is_on and given.is_before("kilted") and names[0] not in limits:
                given.reject(gate, f"needs {names[0]}, which is not given")
            is_humble = given.distro == "humble"
            if kind == "acceleration" and not is_humble:
                later = (n for n in _DECELERATIONS if _is_number(given.get(n, float)))
                limits += later
            is_off = not is_on if is_humble else is_on is False
            if is_off and given.is_before("rolling"):
                for name in limits:
                    what = f"{gate} is not true"
                    given.add(name, "warning", "ignored", what, "the limit is off")
                    given.drop(name)
            elif not is_humble and is_on is not None:
                given.add(
                    gate,
                    "warning" if limits and not is_on else "info",
                    "ignored",
                    "a parameter of humble",
                    f"a limit that is given acts: {', '.join(limits) or 'none'}",
                )
            if is_on is not None:
                given.drop(gate)
        SpeedLimits.adapt(given)


def _is_number(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


@dc.dataclass(frozen=True)
class DiffDriveLinear:
    """Limits of the velocity forwards."""

    x: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dc.dataclass(frozen=True)
class DiffDriveAngular:
    """Limits of the velocity of turning."""

    z: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dc.dataclass(frozen=True)
class DiffDriveControllerParameters:
    """Parameters of a DiffDriveController."""

    # Joints of the wheels of each side, at least one and as many on both.
    left_wheel_names: tuple[str, ...]
    right_wheel_names: tuple[str, ...]

    # Distance between left and right wheels, above 0 [m], and its correction.
    wheel_separation: float = 0.0
    wheel_separation_multiplier: float = 1.0

    # Radius of the wheels, above 0 [m], and its corrections.
    wheel_radius: float = 0.0
    left_wheel_radius_multiplier: float = 1.0
    right_wheel_radius_multiplier: float = 1.0

    # Wheels on a side; no later distro asks for it.
    wheels_per_side: Annotated[int, Rule(until="humble", is_harmless=True)] = 0

    # Frames of the odometry, and what goes before their names.
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    pose_covariance_diagonal: tuple[float, ...] = (0.0,) * 6
    twist_covariance_diagonal: tuple[float, ...] = (0.0,) * 6

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the wheels' positions are read, not their velocities.
    position_feedback: bool = True

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Age from which a command counts no more [s].
    cmd_vel_timeout: float = 0.5

    # Whether the limited velocity is published.
    publish_limited_velocity: bool = False

    # How many ticks the odometry's velocity is a mean of.
    velocity_rolling_window_size: int = 10

    # Whether commands are TwistStamped, not Twist; later they always are.
    use_stamped_vel: Annotated[
        bool, Rule(until="humble", is_kept=True, is_harmless=True)
    ] = True

    # Rate of the odometry [Hz]; later it is published at every tick.
    publish_rate: Annotated[float, Rule(until="kilted", is_harmless=True)] = 50.0

    linear: DiffDriveLinear = DiffDriveLinear()
    angular: DiffDriveAngular = DiffDriveAngular()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "left_wheel_names", "right_wheel_names")
        if len(self.left_wheel_names) != len(self.right_wheel_names):
            raise ValueError(
                f"right_wheel_names must be as many as left_wheel_names, got "
                f"{list(self.right_wheel_names)} and {list(self.left_wheel_names)}"
            )
        check_above(self, 0.0, "wheel_separation", "wheel_radius")
        check_at_least(self, 1, "velocity_rolling_window_size")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")
        check_duration(self, "cmd_vel_timeout")
        check_not_zero(
            self,
            "wheel_separation_multiplier",
            "left_wheel_radius_multiplier",
            "right_wheel_radius_multiplier",
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


_UNKNOWN = (math.nan, math.nan)
_REST = (0.0, 0.0)


class DiffDriveState(NamedTuple):
    """State of a DiffDriveController between two ticks."""

    inbox: DiffDriveInbox
    odometry: DiffDriveOdometryState

    # Forwards [m/s], turning [rad/s]: what is asked for, and the last two that the
    # limits let through, the newest first.
    reference: tuple[float, float]
    limited: tuple[tuple[float, float], tuple[float, float]] = (_REST, _REST)

    # Velocities of the wheels [rad/s], left ones first, shape (k,); NaN is none.
    command: Array = np.empty(0)

    # Why the last tick failed; empty if it didn't.
    fault: str = ""

    # When the odometry was published last [ns], and what else was.
    time_ns: int | None = None
    cmd_vel_out: TwistStamped = TwistStamped()


class DiffDriveController(TickingController[DiffDriveState]):
    """Turns wheels so that a base with differential drive moves as it is told.

    .. pydrake_system::

        name: DiffDriveController
        input_ports:
        - controller_manager
        - state_interfaces
        - cmd_vel
        - set_odometry
        - parameters
        - cmd_vel_unstamped
        output_ports:
        - command_interfaces
        - odom
        - tf
        - cmd_vel_out
        - events

    ==================  ====  =====  ===============================================
    port                size  unit   meaning
    ==================  ====  =====  ===============================================
    controller_manager  --    --     Cycle: whether the controller is active
    state_interfaces    m     rad    what is measured
    cmd_vel             --    --     TwistStamped: velocity forwards and of turning
    set_odometry        --    --     SetOdometry: where the base is
    parameters          --    --     DiffDriveControllerParameters
    cmd_vel_unstamped   --    --     Twist, if use_stamped_vel is false
    command_interfaces  --    rad/s  Tick; its command is (k,), left wheels first
    odom                --    --     Odometry: where the wheels say that the base is
    tf                  --    --     TFMessage with the same, if enable_odom_tf
    cmd_vel_out         --    --     TwistStamped, if publish_limited_velocity
    events              --    --     what was not accepted
    ==================  ====  =====  ===============================================

    References: `<name>/linear/velocity` [m/s] and `<name>/angular/velocity` [rad/s].
    """

    message_types: ClassVar[Mapping[str, type[Message]]] = {
        "cmd_vel": TwistStamped,
        "cmd_vel_unstamped": Twist,
        "set_odometry": SetOdometry,
    }

    def __init__(
        self,
        parameters: DiffDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: Parameters of the controller.
            params: Rate and surroundings of the controller.
        """
        given, name = parameters, params.controller_name
        self._num_left = len(given.left_wheel_names)
        wheels = (*given.left_wheel_names, *given.right_wheel_names)
        feedback = "position" if given.position_feedback else "velocity"
        # Those of the odometry stay as they are.
        self._kinematics = make_kinematics(given)
        self._timeout_ns = round(given.cmd_vel_timeout * NANOSECONDS)
        self._frames = resolve_frames(
            given.odom_frame_id,
            given.base_frame_id,
            prefix=given.tf_frame_prefix,
            namespace=params.namespace,
            is_enabled=given.tf_frame_prefix_enable,
            is_lyrical=params.distro == "rolling",
        )
        self._covariances = (
            diagonal(given.pose_covariance_diagonal),
            diagonal(given.twist_covariance_diagonal),
        )
        self._first = _REST if params.distro == "humble" else _UNKNOWN
        mean = RollingMean(given.velocity_rolling_window_size)
        super().__init__(
            params,
            DiffDriveState(
                DiffDriveInbox(
                    given, make_limiters(given), self._kinematics, self._first
                ),
                DiffDriveOdometryState(mean),
                self._first,
                command=np.full(len(wheels), np.nan),
            ),
            state_interfaces=interfaces.interface_names(
                () if given.open_loop else wheels, (feedback,)
            ),
            command_interfaces=interfaces.interface_names(wheels, ("velocity",)),
            reference_interfaces=()
            if params.distro == "humble"
            else (f"{name}/linear/velocity", f"{name}/angular/velocity"),
        )
        nothing = AbstractValue.Make(())
        self._ports = DiffDrivePorts(
            self.DeclareAbstractInputPort("cmd_vel", nothing),
            self.DeclareAbstractInputPort("set_odometry", nothing),
            self.DeclareAbstractInputPort(interfaces.PARAMETERS_PORT, nothing),
        )
        if not given.use_stamped_vel:
            port = self.DeclareAbstractInputPort("cmd_vel_unstamped", nothing)
            self._ports = self._ports._replace(unstamped=port)
        self._declare_topic("odom", self._describe_odometry)
        if given.enable_odom_tf:
            self._declare_topic(
                "tf", lambda s: make_transform(self._describe_odometry(s))
            )
        if given.publish_limited_velocity:
            self._declare_topic("cmd_vel_out", lambda state: state.cmd_vel_out)
        self._declare_topic("events", lambda state: state.inbox.events)

    def _update(self, now: Now, state: DiffDriveState) -> DiffDriveState:
        chained = self._read_references(now)
        inbox = self._receive(now, state, "" if chained is None else CHAINED)
        state = state._replace(inbox=inbox, fault="")
        if chained is not None:
            asked = [float(value) for value in chained]
            v, w = (
                old if math.isnan(new) else new
                for new, old in zip(asked, state.reference, strict=True)
            )
            state = state._replace(reference=(v, w))
        else:
            last, timeout_ns = state.reference, self._timeout_ns
            reference = follow(inbox, last, now.time_ns, timeout_ns=timeout_ns)
            state = state._replace(reference=reference)
        if not all(map(math.isfinite, state.reference)):
            return state
        return self._move(now, state)

    def _receive(
        self, now: Now, state: DiffDriveState, obstacle: str
    ) -> DiffDriveInbox:
        ports, timeout_ns = self._ports, self._timeout_ns
        return receive(
            now, ports, state.inbox, timeout_ns=timeout_ns, obstacle=obstacle
        )

    def _move(self, now: Now, state: DiffDriveState) -> DiffDriveState:
        """Return the state after a tick with a reference."""
        dt = now.period_ns / NANOSECONDS
        last, before = state.limited
        v, w = (
            limiter.limit(asked, v0, v1, dt).value
            for limiter, asked, v0, v1 in zip(
                state.inbox.limiters, state.reference, last, before, strict=True
            )
        )
        state = state._replace(limited=((v, w), last))
        inbox, old = state.inbox, state.odometry
        parameters = inbox.parameters
        left = right = 0.0
        if not parameters.open_loop:
            measured = self._read(now.context)
            if not np.isfinite(measured).all():
                bad = np.flatnonzero(~np.isfinite(measured))[0]
                fault = f"{self.state_interfaces[bad]!r} is {measured[bad]}"
                nothing = np.full(len(state.command), np.nan)
                return state._replace(command=nothing, fault=fault)
            left = float(measured[: self._num_left].mean())
            right = float(measured[self._num_left :].mean())
        is_published = True
        if inbox.pose is not None:
            odometry = old._replace(
                pose=inbox.pose, velocity=_REST, mean=old.mean.clear()
            )
            inbox = inbox._replace(pose=None)
        elif parameters.open_loop:
            odometry = from_commands(old, v, w, dt)
        else:
            move = self._kinematics.from_velocities
            if parameters.position_feedback:
                move = self._kinematics.from_positions
            odometry = move(old, left, right, dt)
            is_published = odometry is not old
        wheels = inbox.kinematics.wheels(v, w)
        command = np.repeat(wheels, self._num_left)
        state = state._replace(inbox=inbox, odometry=odometry, command=command)
        if is_published:
            state = state._replace(time_ns=now.time_ns)
        if parameters.publish_limited_velocity:
            twist = Twist(Vector3(v), Vector3(0.0, 0.0, w))
            header = Header.from_nanoseconds(now.time_ns)
            state = state._replace(cmd_vel_out=TwistStamped(header, twist))
        return state

    def _deactivate(self, now: Now, state: DiffDriveState) -> DiffDriveState:
        inbox = state.inbox._replace(command=self._first, stamp_ns=now.time_ns)
        return state._replace(
            inbox=inbox,
            reference=self._first,
            limited=(_REST, _REST),
            command=np.zeros(len(state.command)),
        )

    def _idle(self, now: Now, state: DiffDriveState) -> DiffDriveState:
        inbox = self._receive(now, state, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def _command(self, state: DiffDriveState) -> Array:
        return state.command

    def _is_ok(self, state: DiffDriveState) -> bool:
        return not state.fault

    def _fault(self, state: DiffDriveState) -> str:
        return state.fault

    def _describe_odometry(self, state: DiffDriveState) -> Odometry:
        """Return the topic odom."""
        pose, (v, w) = state.odometry.pose, state.odometry.velocity
        return make_odometry(
            state.time_ns, self._frames, pose, (v, 0.0, w), self._covariances
        )
