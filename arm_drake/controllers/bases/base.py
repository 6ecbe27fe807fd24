"""Base of the controllers that move a base: velocities in, odometry and /tf out.

Sources: ros2_controllers (version 6.9.0), diff_drive_controller and
steering_controllers_library; the prefixes of frames, `tf_prefix`; limits of velocities,
control_toolbox 6.3.0.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeVar

from arm_drake import interfaces
from arm_drake.control.filters import RateLimiter
from arm_drake.control.odometry import PlanarPose
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.topics import CHAINED, TopicController, TopicState
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_at_least,
    check_length,
)
from arm_drake.importing import dataclass
from arm_drake.messages import (
    Header,
    Message,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    SetOdometry,
    TFMessage,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
)

# Of a base: forwards [m/s] and of turning [rad/s], or forwards, to the left and of
# turning; NaN is none.
Velocity: TypeAlias = tuple[float, ...]


class BaseFrames(NamedTuple):
    """Names of the frames of an odometry, with their prefix."""

    odom: str
    base: str


def resolve_frames(
    odom: str,
    base: str,
    *,
    prefix: str,
    namespace: str = "",
    is_enabled: bool = True,
    is_lyrical: bool = False,
) -> BaseFrames:
    """Return the names of the frames with what goes before them."""
    if not is_enabled:
        prefix = ""
    elif prefix == "~" or (not prefix and not is_lyrical):
        prefix = namespace
    prefix = prefix.removeprefix("/")
    if prefix and not prefix.endswith("/"):
        prefix += "/"
    return BaseFrames(prefix + odom, prefix + base)


def diagonal(variances: Sequence[float]) -> tuple[float, ...]:
    """Return the covariance, shape (36,), with these variances, shape (6,)."""
    values = [0.0] * 36
    values[::7] = variances
    return tuple(values)


def make_odometry(
    time_ns: int | None,
    frames: BaseFrames,
    pose: PlanarPose,
    velocity: Velocity,
    covariances: tuple[tuple[float, ...], tuple[float, ...]],
) -> Odometry:
    """Return the message of an odometry.

    `time_ns` is None before the first tick; `covariances` shape (36,).
    """
    if time_ns is None:
        return Odometry()
    vx, *sideways, wz = velocity
    (vy,) = sideways or (0.0,)
    return Odometry(
        Header.from_nanoseconds(time_ns, frames.odom),
        frames.base,
        PoseWithCovariance(
            Pose(Point(pose.x, pose.y, 0.0), Quaternion.from_yaw(pose.heading)),
            covariances[0],
        ),
        TwistWithCovariance(
            Twist(Vector3(vx, vy, 0.0), Vector3(0.0, 0.0, wz)), covariances[1]
        ),
    )


def make_transform(odometry: Odometry) -> TFMessage:
    """Return the message of /tf for an odometry; an empty one before its first."""
    if not odometry.child_frame_id:
        return TFMessage()
    pose = odometry.pose.pose
    where = Vector3(pose.position.x, pose.position.y, pose.position.z)
    return TFMessage(
        (
            TransformStamped(
                odometry.header,
                odometry.child_frame_id,
                Transform(where, pose.orientation),
            ),
        )
    )


_SIGNS = {
    "max_velocity": 1,
    "min_velocity": -1,
    "max_acceleration": 1,
    "max_deceleration": -1,
    "max_acceleration_reverse": -1,
    "max_deceleration_reverse": 1,
    "max_jerk": 1,
    "min_jerk": -1,
}


@dataclass(frozen=True)
class SpeedLimits:
    """Limits of a velocity along or about an axis [m/s] or [rad/s]; NaN is no limit."""

    # Largest velocity, at least 0, and smallest, at most 0; if that is NaN, it is the
    # opposite of the largest.
    max_velocity: float = math.nan
    min_velocity: float = math.nan

    # Rate of change forwards: speeding up, at least 0, and slowing down, at most 0.
    max_acceleration: float = math.nan
    max_deceleration: Annotated[float, Rule(since="jazzy")] = math.nan

    # The same backwards: at most 0, and at least 0.
    max_acceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan
    max_deceleration_reverse: Annotated[float, Rule(since="jazzy")] = math.nan

    # Rate of change of the acceleration, at least 0 and at most 0.
    max_jerk: float = math.nan
    min_jerk: float = math.nan

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take the older min_acceleration, and the deceleration's older sign."""
        names = ["min_acceleration"]
        if not params.is_before("jazzy"):
            names.append("max_deceleration")
        for name in names:
            value = params.get(name, float)
            if value is not None and value > 0.0:
                what = f"must be at most 0, got {value}"
                params.add(name, "warning", "repair", what, f"taken as {-value}")
                params.set(name, -value)
        for name in ("max_velocity", "max_acceleration", "max_jerk"):
            if params.get(name, float) == 0.0:
                what = "0 lets nothing move; .nan is no limit"
                params.add(name, "warning", "invalid", what, "it is taken as it is")
        value = params.get("min_acceleration", float)
        if value is not None:
            params.replace(
                "min_acceleration",
                {"max_deceleration": value, "max_acceleration_reverse": value},
            )

    def __post_init__(self) -> None:
        """Reject limits on the wrong side of 0."""
        for name, sign in _SIGNS.items():
            value = getattr(self, name)
            if sign * value < 0.0:
                allowed = "at least 0" if sign > 0 else "at most 0"
                raise ValueError(f"{name} must be {allowed}, got {value}")


def make_limiter(limits: SpeedLimits) -> RateLimiter:
    """Return what limits a velocity."""
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


def limit_velocity(
    limiters: Iterable[RateLimiter],
    velocity: Velocity,
    limited: tuple[Velocity, Velocity],
    dt: float,
) -> Velocity:
    """Return a velocity within its limits; `dt` is since the last one [s]."""
    return tuple(
        limiter.limit(v, v0, v1, dt).value
        for limiter, v, v0, v1 in zip(limiters, velocity, *limited, strict=True)
    )


@dataclass(frozen=True, kw_only=True)
class BaseParameters:
    """Parameters that controllers of bases with measured or commanded motions share."""

    # Frames of the odometry.
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    pose_covariance_diagonal: tuple[float, ...] = (0.0,) * 6
    twist_covariance_diagonal: tuple[float, ...] = (0.0,) * 6

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # How many ticks the odometry's velocity is a mean of, at least 1.
    velocity_rolling_window_size: int = 10

    # Whether commands are TwistStamped, not Twist; later they always are.
    use_stamped_vel: Annotated[
        bool, Rule(until="humble", is_kept=True, is_harmless=True)
    ] = True

    def __post_init__(self) -> None:
        check_at_least(self, 1, "velocity_rolling_window_size")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")


class BaseTopics(NamedTuple):
    """Names of the topics of a base: velocities, odometry and its frames."""

    velocity: str
    odometry: str
    tf: str


CMD_VEL = BaseTopics("cmd_vel", "odom", "tf")
REFERENCE = BaseTopics("reference", "odometry", "tf_odometry")


class BaseCommand(NamedTuple):
    """The last velocity that came in, and its stamp [ns]."""

    velocity: Velocity
    stamp_ns: int = 0


def take_finite(command: BaseCommand) -> tuple[BaseCommand, str]:
    """Return the command, or none as upstream has it for NaN, and what is wrong."""
    velocity = command.velocity
    if all(map(math.isfinite, velocity)):
        return command, ""
    fault = f"linear.x and angular.z must be finite, got {list(velocity)}"
    return BaseCommand((math.nan,) * len(velocity)), fault


class BaseOdometry(Protocol):
    """Estimated pose and velocity of a base."""

    @property
    def pose(self) -> PlanarPose:
        """Return where it is."""

    @property
    def velocity(self) -> Velocity:
        """Return how it moves."""


class BaseState(TopicState, Protocol):
    """State of a controller of a base: a named tuple with these fields and its own."""

    @property
    def received(self) -> BaseCommand | None:
        """Return the velocity that counts."""

    @property
    def pose(self) -> PlanarPose | None:
        """Return the pose that the next tick of the odometry takes."""

    @property
    def odometry(self) -> BaseOdometry:
        """Return the odometry."""

    @property
    def time_ns(self) -> int | None:
        """Return when the odometry was published last [ns]."""


B = TypeVar("B", bound=BaseState)


class BaseController(TopicController[B]):
    """Base of controllers that move a base: velocities and poses in, odometry out.

    A subclass says by `_check` which velocities it takes, and in its `_update` what
    follows from them.
    """

    topics: ClassVar[BaseTopics] = CMD_VEL

    # Whether velocities have a component to the left.
    moves_sideways: ClassVar[bool] = False

    # The topic that says where the base is, None if no one does, and despite what it
    # counts.
    pose_topic: ClassVar[tuple[str, type[Message]] | None] = (
        "set_odometry",
        SetOdometry,
    )
    takes_poses_despite: ClassVar[tuple[str, ...]] = (CHAINED,)

    def __init__(
        self,
        parameters: Any,
        params: ControllerInterfaceParams,
        initial: B,
        *,
        covariances: tuple[Sequence[float], Sequence[float]] | None = None,
        is_stamped: bool = True,
        has_references: bool = True,
        is_lyrical: bool = False,
        outputs: Mapping[str, Callable[[B], Any]] = MappingProxyType({}),
        **names: Any,
    ) -> None:
        """Create the system."""
        own = params.controller_name
        axes = ("linear/x", "linear/y", "angular/z")
        references = [
            f"{own}/{axis}"
            for axis in (axes if self.moves_sideways else ("linear", "angular"))
        ]
        super().__init__(
            params,
            initial,
            reference_interfaces=interfaces.interface_names(
                references if has_references else (), (interfaces.VELOCITY,)
            ),
            **names,
        )
        pose, twist = covariances or (
            parameters.pose_covariance_diagonal,
            parameters.twist_covariance_diagonal,
        )
        self._covariances = (diagonal(pose), diagonal(twist))
        self._frames = resolve_frames(
            parameters.odom_frame_id,
            parameters.base_frame_id,
            prefix=getattr(parameters, "tf_frame_prefix", ""),
            namespace=params.namespace,
            is_enabled=getattr(parameters, "tf_frame_prefix_enable", True),
            is_lyrical=is_lyrical,
        )
        velocity, odometry, tf = self.topics
        if is_stamped:
            self._subscribe(velocity, TwistStamped, self._take_velocity)
        else:
            self._subscribe(f"{velocity}_unstamped", Twist, self._take_velocity)
        if self.pose_topic is not None:
            self._subscribe(
                *self.pose_topic, self._take_pose, despite=self.takes_poses_despite
            )
        self._declare_topic(odometry, self._describe_odometry)
        if parameters.enable_odom_tf:
            self._declare_topic(tf, self._describe_frames)
        for name, describe in outputs.items():
            self._declare_topic(name, describe)
        self._declare_events()

    @abstractmethod
    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        """Return what counts from now on, None if it is no other, and what is wrong."""

    def _take_velocity(
        self, state: B, message: Twist | TwistStamped, time_ns: int
    ) -> tuple[B, str]:
        """Return the state with a velocity; a stamp of 0 means now."""
        if isinstance(message, TwistStamped):
            stamp_ns = message.header.stamp.to_nanoseconds() or time_ns
            twist = message.twist
        else:
            stamp_ns, twist = time_ns, message
        x, y, z = twist.linear.x, twist.linear.y, twist.angular.z
        velocity = (x, y, z) if self.moves_sideways else (x, z)
        command, fault = self._check(
            BaseCommand(velocity, stamp_ns), time_ns - stamp_ns
        )
        if command is not None:
            state = state._replace(received=command)
        return state, fault

    def _take_pose(self, state: B, message: Any, time_ns: int) -> tuple[B, str]:
        """Return the state with a pose for the odometry."""
        pose = PlanarPose(message.x, message.y, message.yaw)
        return state._replace(pose=pose), ""

    def _make_odometry(self, state: B, pose: PlanarPose) -> Odometry:
        velocity = state.odometry.velocity
        return make_odometry(
            state.time_ns, self._frames, pose, velocity, self._covariances
        )

    def _describe_odometry(self, state: B) -> Odometry:
        """Return the topic with the odometry."""
        return self._make_odometry(state, state.odometry.pose)

    def _describe_frames(self, state: B) -> TFMessage:
        """Return the topic with the frames of the odometry."""
        return make_transform(self._make_odometry(state, state.odometry.pose))
