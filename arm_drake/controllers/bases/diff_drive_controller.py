"""The ``diff_drive_controller/DiffDriveController`` and its parameters.

Source: ros2_controllers, `diff_drive_controller` (version 6.9.0; humble starts with a
command of 0; defaults of jazzy, and by rule those of other distros). Kinematics and
odometry are `arm_drake.control.odometry`.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.filters import RateLimiter
from arm_drake.control.odometry import (
    DiffDriveKinematics,
    DiffDriveMotion,
    PlanarPose,
    RollingMean,
    WheelOdometryState,
    from_commands,
)
from arm_drake.controllers.bases.base import (
    BaseCommand,
    BaseController,
    BaseParameters,
    SpeedLimits,
    Velocity,
    limit_velocity,
    make_limiter,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    NEVER_NS,
    SilentTicks,
    SteadyCommand,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import ALWAYS, CHAINED, Inbox, check_change
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_duration,
    check_not_empty,
    check_not_zero,
    check_positive,
)
from arm_drake.description.report import Severity
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    Header,
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


@dataclass(frozen=True)
class DiffDriveSpeedLimits(SpeedLimits):
    """Limits of a velocity, which humble's has_*_limits switch on."""

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take has_*_limits: a limit is off by it, and in humble without it.

        Source: ros2_controllers, pull request 1315, which only makes them deprecated.
        """
        for kind, names in _LIMITS.items():
            gate = f"has_{kind}_limits"
            is_on = params.get(gate, bool)
            limits = [n for n in names if _is_number(params.get(n, float))]
            if is_on and params.is_before("kilted") and names[0] not in limits:
                params.reject(gate, f"needs {names[0]}, which is not given")
            is_humble = params.distro == "humble"
            if kind == "acceleration" and not is_humble:
                later = (n for n in _DECELERATIONS if _is_number(params.get(n, float)))
                limits += later
            is_off = not is_on if is_humble else is_on is False
            if is_off and params.is_before("rolling"):
                # Who says so means it.
                severity: Severity = "warning" if is_on is None else "info"
                what = f"{gate} is {'not true' if is_on is None else 'false'}"
                for name in limits:
                    params.add(name, severity, "ignored", what, "the limit is off")
                    params.drop(name)
            elif not is_humble and is_on is not None:
                params.add(
                    gate,
                    "warning" if limits and not is_on else "info",
                    "ignored",
                    "a parameter of humble",
                    f"a limit that is given acts: {', '.join(limits) or 'none'}",
                )
            if is_on is not None:
                params.drop(gate)
        SpeedLimits.adapt(params)


def _is_number(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


@dataclass(frozen=True)
class DiffDriveLinear:
    """Limits of the velocity forwards."""

    x: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dataclass(frozen=True)
class DiffDriveAngular:
    """Limits of the velocity of turning."""

    z: DiffDriveSpeedLimits = DiffDriveSpeedLimits()


@dataclass(frozen=True)
class DiffDriveControllerParameters(BaseParameters):
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

    # What goes before the names of the odometry's frames.
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""

    # Whether the wheels' positions are read, not their velocities.
    position_feedback: bool = True

    # Age from which a command counts no more [s].
    cmd_vel_timeout: float = 0.5

    # Whether the limited velocity is published.
    publish_limited_velocity: bool = False

    # Rate of the odometry [Hz]; later it is published at every tick.
    publish_rate: Annotated[float, Rule(until="kilted", is_harmless=True)] = 50.0

    linear: DiffDriveLinear = DiffDriveLinear()
    angular: DiffDriveAngular = DiffDriveAngular()

    def __post_init__(self) -> None:
        super().__post_init__()
        check_not_empty(self, "left_wheel_names", "right_wheel_names")
        if len(self.left_wheel_names) != len(self.right_wheel_names):
            raise ValueError(
                f"right_wheel_names must be as many as left_wheel_names, got "
                f"{list(self.right_wheel_names)} and {list(self.left_wheel_names)}"
            )
        check_positive(self, "wheel_separation", "wheel_radius")
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


class DiffDriveSettings(NamedTuple):
    """Parameters of a DiffDriveController in effect, and what they set."""

    parameters: DiffDriveControllerParameters

    # The limits forwards and of turning.
    limiters: tuple[RateLimiter, RateLimiter]

    # The measures that wheels are commanded with.
    kinematics: DiffDriveKinematics


def make_settings(parameters: DiffDriveControllerParameters) -> DiffDriveSettings:
    """Return what parameters set; measures are corrected."""
    config, linear, angular = parameters, parameters.linear.x, parameters.angular.z
    return DiffDriveSettings(
        config,
        (make_limiter(linear), make_limiter(angular)),
        DiffDriveKinematics(
            config.wheel_separation * config.wheel_separation_multiplier,
            config.wheel_radius * config.left_wheel_radius_multiplier,
            config.wheel_radius * config.right_wheel_radius_multiplier,
        ),
    )


_UNKNOWN = (math.nan, math.nan)
_REST = (0.0, 0.0)

# Of how many samples of a mean steady ticks take care.
_MAX_SAMPLES = 100


class DiffDriveState(NamedTuple):
    """State of a DiffDriveController between two ticks."""

    settings: DiffDriveSettings
    odometry: WheelOdometryState

    # What is asked for: forwards [m/s], turning [rad/s].
    reference: Velocity

    # Velocities of the wheels [rad/s], left ones first, shape (k,); NaN is none.
    command: Array

    # The last two velocities that the limits let through, the newest first.
    limited: tuple[Velocity, Velocity] = (_REST, _REST)

    # The last command; None before the first cycle.
    received: BaseCommand | None = None

    # Pose to be taken at the next tick that moves.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # Why the last tick failed; empty if it didn't.
    fault: str = ""

    # When the odometry was published last [ns], and what else was.
    time_ns: int | None = None
    cmd_vel_out: TwistStamped = TwistStamped()


class _SteadyDrive(SilentTicks):
    """Ticks of a base with the same reference, while its wheels are measured."""

    def __init__(
        self,
        system: "DiffDriveController",
        last: DiffDriveState,
        period_ns: int,
        until_ns: int,
    ) -> None:
        """Take what a tick has left, and whose ticks these are."""
        self._system, self._last, self.until_ns = system, last, until_ns
        self._dt = period_ns / NANOSECONDS
        self._window = last.odometry.mean.window

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> list[float] | None:
        """Return the velocities of the wheels; None where a position isn't finite."""
        system, settings, dt = self._system, self._last.settings, self._dt
        limited, odometry = DiffDriveMotion.from_numbers(memory, self._window)
        velocity = limit_velocity(settings.limiters, self._last.reference, limited, dt)
        sides = _REST
        if not settings.parameters.open_loop:
            sides = system._find_sides(motions[system._read_at])
            if not math.isfinite(sum(sides)):
                return None
        odometry = system._integrate(settings, odometry, velocity, sides, dt)
        motion = DiffDriveMotion((velocity, limited[0]), odometry)
        memory[:] = motion.numbers(len(memory))
        return system._find_command(settings, velocity)

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> DiffDriveState:
        """Return the state that a tick leaves behind."""
        limited, odometry = DiffDriveMotion.from_numbers(memory, self._window)
        state = self._last._replace(limited=limited, odometry=odometry)
        return self._system._show(state, time_ns)


class DiffDriveController(BaseController[DiffDriveState]):
    """Drives the wheels of a base with differential drive by its velocity command.

    ==================  ====  =====  ===============================================
    port                size  unit   meaning
    ==================  ====  =====  ===============================================
    controller_manager  --    --     Cycle: whether the controller is active
    state_interfaces    m     rad    what is measured
    cmd_vel             --    --     TwistStamped: velocity forwards and of turning
    set_odometry        --    --     SetOdometry: where the base is
    parameters          --    --     DiffDriveControllerParameters
    cmd_vel_unstamped   --    --     Twist, if use_stamped_vel is false
    command_interfaces  --    rad/s  UpdateResult; command (k,), left wheels first
    odom                --    --     Odometry: where the wheels say that the base is
    tf                  --    --     TFMessage with the same, if enable_odom_tf
    cmd_vel_out         --    --     TwistStamped, if publish_limited_velocity
    events              --    --     what was not accepted
    ==================  ====  =====  ===============================================

    References: `<name>/linear/velocity` [m/s] and `<name>/angular/velocity` [rad/s].
    """

    takes_poses_despite = ALWAYS
    reads_by_now = True

    def __init__(
        self,
        parameters: DiffDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        config, is_humble = parameters, params.distro == "humble"
        self._num_left = len(config.left_wheel_names)
        wheels = (*config.left_wheel_names, *config.right_wheel_names)
        feedback = "position" if config.position_feedback else "velocity"
        self._timeout_ns = round(config.cmd_vel_timeout * NANOSECONDS)
        self._first = _REST if is_humble else _UNKNOWN
        settings = make_settings(config)
        # Those of the odometry stay as they are.
        self._kinematics = settings.kinematics
        mean = RollingMean(config.velocity_rolling_window_size)
        num_samples = 0 if config.open_loop else mean.window
        if num_samples <= _MAX_SAMPLES:
            self.num_remembered = DiffDriveMotion.size(num_samples)
        outputs = {"cmd_vel_out": lambda state: state.cmd_vel_out}
        super().__init__(
            config,
            params,
            DiffDriveState(
                settings,
                WheelOdometryState(mean),
                self._first,
                np.full(len(wheels), np.nan),
            ),
            has_references=not is_humble,
            is_lyrical=params.distro == "rolling",
            outputs=outputs if config.publish_limited_velocity else {},
            state_interfaces=interfaces.interface_names(
                () if config.open_loop else wheels, (feedback,)
            ),
            command_interfaces=interfaces.interface_names(wheels, ("velocity",)),
        )
        self._subscribe_parameters(self._take_parameters)
        if not config.use_stamped_vel:
            self._subscribe("cmd_vel_unstamped", Twist, self._take_velocity)

    def _update(self, now: UpdateContext, state: DiffDriveState) -> DiffDriveState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        if chained is None:
            reference = self._follow(now, state)
        else:
            reference = tuple(
                old if math.isnan(new) else new
                for new, old in zip(chained.tolist(), state.reference, strict=True)
            )
        state = state._replace(reference=reference, fault="")
        if not all(map(math.isfinite, reference)):
            return state
        return self._move(now, state)

    def _follow(self, now: UpdateContext, state: DiffDriveState) -> Velocity:
        """Return the reference that the last command makes."""
        assert state.received is not None
        velocity, stamp_ns = state.received
        if self._timeout_ns and now.time_ns - stamp_ns > self._timeout_ns:
            return _REST
        return velocity if all(map(math.isfinite, velocity)) else state.reference

    def _receive(
        self, now: UpdateContext, state: DiffDriveState, obstacle: str = ""
    ) -> DiffDriveState:
        if state.received is None:
            state = state._replace(received=BaseCommand(self._first, now.time_ns))
        return super()._receive(now, state, obstacle)

    def _take_parameters(
        self, state: DiffDriveState, new: object, obstacle: str
    ) -> DiffDriveState:
        parameters = check_change(state.settings.parameters, new, _READ_ONLY)
        return state._replace(settings=make_settings(parameters))

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        if self._timeout_ns and age_ns >= self._timeout_ns:
            age = age_ns / NANOSECONDS
            return None, f"it is {age:g} s old; cmd_vel_timeout is less"
        if all(map(math.isfinite, command.velocity)):
            return command, ""
        # Its stamp counts nevertheless.
        fault = "linear.x and angular.z must be finite; the last reference stays"
        return command, fault

    def _move(self, now: UpdateContext, state: DiffDriveState) -> DiffDriveState:
        """Return the state after a tick with a reference."""
        dt, settings = now.period_ns / NANOSECONDS, state.settings
        limited, old = state.limited, state.odometry
        velocity = limit_velocity(settings.limiters, state.reference, limited, dt)
        limited = (velocity, limited[0])
        sides = _REST
        if not settings.parameters.open_loop:
            measured = self._measured_now(now)
            if not np.isfinite(measured).all():
                bad = np.flatnonzero(~np.isfinite(measured))[0]
                fault = f"{self.state_interfaces[bad]!r} is {measured[bad]}"
                nothing = np.full(len(state.command), np.nan)
                return state._replace(limited=limited, command=nothing, fault=fault)
            sides = self._find_sides(measured)
        if state.pose is not None:
            odometry = old._replace(
                pose=state.pose, velocity=_REST, mean=old.mean.clear()
            )
        else:
            odometry = self._integrate(settings, old, velocity, sides, dt)
        time_ns = state.time_ns
        # Closed loop without a period nothing is published.
        if odometry is not old:
            time_ns = now.time_ns
        state = state._replace(pose=None, limited=limited, odometry=odometry)
        return self._show(state, now.time_ns)._replace(time_ns=time_ns)

    def _find_sides(self, measured: Array) -> tuple[float, float]:
        """Return the means of what is measured of left and right wheels."""
        sums = np.add.reduce(measured.reshape(2, self._num_left), axis=1)
        left, right = (sums / self._num_left).tolist()
        return left, right

    def _integrate(
        self,
        settings: DiffDriveSettings,
        old: WheelOdometryState,
        velocity: Velocity,
        sides: tuple[float, float],
        dt: float,
    ) -> WheelOdometryState:
        """Return the odometry after a tick; the old one itself if it stays."""
        if settings.parameters.open_loop:
            v, w = velocity
            return from_commands(old, v, w, dt)
        move = self._kinematics.from_velocities
        if settings.parameters.position_feedback:
            move = self._kinematics.from_positions
        return move(old, *sides, dt)

    def _find_command(
        self, settings: DiffDriveSettings, velocity: Velocity
    ) -> list[float]:
        """Return the velocities of the wheels [rad/s], left ones first."""
        v, w = velocity
        left, right = settings.kinematics.wheels(v, w)
        return [left] * self._num_left + [right] * self._num_left

    def _show(self, state: DiffDriveState, time_ns: int) -> DiffDriveState:
        """Return the state with what follows from its motion: command and topics."""
        velocity = state.limited[0]
        command = np.array(self._find_command(state.settings, velocity))
        state = state._replace(command=command, time_ns=time_ns)
        if state.settings.parameters.publish_limited_velocity:
            v, w = velocity
            twist = Twist(Vector3(v), Vector3(0.0, 0.0, w))
            header = Header.from_nanoseconds(time_ns)
            state = state._replace(cmd_vel_out=TwistStamped(header, twist))
        return state

    def steady(
        self, last: UpdateResult[DiffDriveState], time_ns: int
    ) -> SteadyTicks[DiffDriveState] | None:
        """Return how it goes on with its reference until that is too old."""
        period_ns, state = self.whole_period_ns, last.state
        until_ns, received = NEVER_NS, state.received
        if received is None or not (period_ns and self.num_remembered):
            return None
        too_old_ns = received.stamp_ns + self._timeout_ns + 1
        if self._timeout_ns and too_old_ns > time_ns:
            until_ns = too_old_ns
        if not all(map(math.isfinite, state.reference)):
            return SteadyCommand(last.command, state, until_ns=until_ns)
        if state.pose is not None:
            return None
        return _SteadyDrive(self, state, period_ns, until_ns)

    def remember(self, state: DiffDriveState) -> list[float]:
        """Return how the base moves, in numbers."""
        motion = DiffDriveMotion(state.limited, state.odometry)
        return motion.numbers(self.num_remembered)

    def _deactivate(self, now: UpdateContext, state: DiffDriveState) -> DiffDriveState:
        return state._replace(
            received=BaseCommand(self._first, now.time_ns),
            reference=self._first,
            limited=(_REST, _REST),
            command=np.zeros(len(state.command)),
        )

    def _is_ok(self, state: DiffDriveState) -> bool:
        return not state.fault

    def _fault(self, state: DiffDriveState) -> str:
        return state.fault
