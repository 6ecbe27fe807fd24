"""The bicycle, tricycle and ackermann ``...SteeringController``, one system for all.

Source: ros2_controllers, `steering_controllers_library`, `bicycle_steering_controller`,
`tricycle_steering_controller`, `ackermann_steering_controller` (version 6.9.0; names of
humble by `adapt`). The equations are in `arm_drake.control.odometry`.
"""

import dataclasses as dc
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import (
    PlanarPose,
    RollingMean,
    SteeringGeometry,
    SteeringOdometry,
    to_wheel_commands,
)
from arm_drake.controllers.bases.base import (
    REFERENCE,
    BaseCommand,
    BaseController,
    BaseParameters,
    take_finite,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import ALWAYS, CHAINED, Inbox
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_duration,
    check_length,
    check_not_empty,
    check_positive,
    check_unique,
)
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS, Header, SetOdometry
from arm_drake.messages.control import SteeringControllerStatus

_WHEELS = (
    "traction_joints_names",
    "steering_joints_names",
    "traction_joints_state_names",
    "steering_joints_state_names",
)


# Upstream's, by default.
_VARIANCES = (0.0, 7.0, 14.0, 21.0, 28.0, 35.0)


@dataclass(frozen=True)
class SteeringControllerParameters(BaseParameters):
    """Parameters that all steering controllers have."""

    # How many driven and how many steered wheels there are.
    wheels: ClassVar[tuple[int, int]]

    # Humble's names of measures, of front and rear wheels: what they are where these
    # are driven, and where they are steered; "" is without use.
    front_and_rear: ClassVar[Mapping[tuple[str, str], tuple[str, str]]]

    # Driven joints, each once; of two the right one first.
    traction_joints_names: Annotated[tuple[str, ...], Rule(since="jazzy", is_kept=True)]

    # Steered joints, each once; of two the right one first.
    steering_joints_names: Annotated[tuple[str, ...], Rule(since="jazzy", is_kept=True)]

    # Joints to read in their places; () is the same.
    traction_joints_state_names: tuple[str, ...] = ()
    steering_joints_state_names: tuple[str, ...] = ()

    # Distance between front and rear wheels, above 0 [m].
    wheelbase: float = 0.0

    # Age from which a command counts no more [s]; 0 uses each one once.
    reference_timeout: float = 1.0

    # Whether wheels slow down until they are steered.
    reduce_wheel_speed_until_steering_reached: bool = False

    # What goes before the names of the odometry's frames.
    tf_frame_prefix: str = ""

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    pose_covariance_diagonal: tuple[float, ...] = dc.field(
        default=_VARIANCES, kw_only=True
    )
    twist_covariance_diagonal: tuple[float, ...] = dc.field(
        default=_VARIANCES, kw_only=True
    )

    # Whether the driven joints' positions are read, not their velocities.
    position_feedback: bool = False

    @abstractmethod
    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""

    @classmethod
    def adapt(cls, params: ParameterGroup) -> None:
        """Take humble's names, by front and rear."""
        is_front = params.get("front_steering", bool)
        steers_front = is_front is None or is_front
        driven, steered = ("rear", "front") if steers_front else ("front", "rear")
        for end, use in ((driven, "traction"), (steered, "steering")):
            params.rename(f"{end}_wheels_names", f"{use}_joints_names")
            params.rename(f"{end}_wheels_state_names", f"{use}_joints_state_names")
        for (front, rear), (traction, steering) in cls.front_and_rear.items():
            of_driven, of_steered = (rear, front) if steers_front else (front, rear)
            params.rename(of_driven, traction)
            if steering:
                params.rename(of_steered, steering)
            elif of_steered in params:
                what = "the steered wheels' radius has no use"
                params.add(of_steered, "info", "ignored", what, "it has no effect")
                params.drop(of_steered)
        if is_front is not None:
            if params.distro != "humble":
                what = "a parameter of humble"
                done = f"{driven} wheels are the traction joints"
                params.add("front_steering", "info", "repair", what, done)
            params.drop("front_steering")
        for name in _WHEELS:
            joints: tuple[str, ...] = params.get(name, tuple[str, ...]) or ()
            if len(joints) == 2 and "left" in joints[0] and "right" in joints[1]:
                what = f"the right joint comes first, got {list(joints)}"
                done = "taken as written: left and right are swapped"
                params.add(name, "warning", "invalid", what, done)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_not_empty(self, *_WHEELS[:2])
        check_unique(self, *_WHEELS)
        check_length(self, self.wheels[0], "traction_joints_names")
        check_length(self, self.wheels[1], "steering_joints_names")
        for name in _WHEELS[2:]:
            use = name.replace("_state", "")
            if getattr(self, name):
                check_length(self, len(getattr(self, use)), name)
        check_positive(self, "wheelbase")
        check_duration(self, "reference_timeout")


@dataclass(frozen=True)
class BicycleSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of a BicycleSteeringController: one driven, one steered wheel."""

    wheels = (1, 1)
    front_and_rear: ClassVar = {
        ("front_wheel_radius", "rear_wheel_radius"): ("traction_wheel_radius", "")
    }

    # Radius of the driven wheel, above 0 [m].
    traction_wheel_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(self.wheelbase, self.traction_wheel_radius)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "traction_wheel_radius")


@dataclass(frozen=True)
class TricycleSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of a TricycleSteeringController: two driven, one steered wheel."""

    wheels = (2, 1)
    front_and_rear: ClassVar = {
        ("front_wheels_radius", "rear_wheels_radius"): ("traction_wheels_radius", "")
    }

    # Distance between the driven wheels, above 0 [m].
    traction_track_width: Annotated[float, Rule(was=("wheel_track",))] = 0.0

    # Radius of the driven wheels, above 0 [m].
    traction_wheels_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(
            self.wheelbase,
            self.traction_wheels_radius,
            num_driven=2,
            traction_track_width=self.traction_track_width,
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "traction_track_width", "traction_wheels_radius")


@dataclass(frozen=True)
class AckermannSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of an AckermannSteeringController: two driven, two steered wheels."""

    wheels = (2, 2)
    front_and_rear: ClassVar = {
        ("front_wheels_radius", "rear_wheels_radius"): ("traction_wheels_radius", ""),
        ("front_wheel_track", "rear_wheel_track"): (
            "traction_track_width",
            "steering_track_width",
        ),
    }

    # Distance between the driven wheels, above 0 [m].
    traction_track_width: float = 0.0

    # Distance between the steered wheels [m]; 0 is traction_track_width.
    steering_track_width: float = 0.0

    # Radius of the driven wheels, above 0 [m].
    traction_wheels_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(
            self.wheelbase,
            self.traction_wheels_radius,
            num_driven=2,
            num_steered=2,
            traction_track_width=self.traction_track_width,
            steering_track_width=self.steering_track_width or self.traction_track_width,
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "traction_track_width", "traction_wheels_radius")


_UNKNOWN = (math.nan, math.nan)


class SteeringControllerState(NamedTuple):
    """State of a steering controller between two ticks."""

    odometry: SteeringOdometry

    # Commands since the activation, driven wheels first; NaN is none.
    command: Array

    # The velocity that is asked for; NaN is nothing.
    received: BaseCommand = BaseCommand(_UNKNOWN)

    # Where the next tick is to put the base.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # Of the last tick: its time [ns], None before the first one, what it measured and
    # what it commanded.
    time_ns: int | None = None
    measured: tuple[float, ...] = ()
    shown: tuple[float, ...] = ()


class SteeringController(BaseController[SteeringControllerState]):
    """Drives a base with steered wheels, and publishes its odometry.

    With n driven and k steered wheels; of two the right one comes first:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    positions and velocities of all J joints of the robot, or
                              more
    reference           --    TwistStamped: velocity of the base from now on; with
                              humble's ``use_stamped_vel: false`` the port is
                              ``reference_unstamped`` and takes a Twist
    set_odometry        --    SetOdometry: where the base is
    command_interfaces  --    UpdateResult; command (n + k,): velocities [rad/s], then
                              angles [rad]
    odometry            --    Odometry
    tf_odometry         --    TFMessage; there only with ``enable_odom_tf``
    controller_state    --    SteeringControllerStatus
    events              --    tuple of the latest (number, event), the newest last; an
                              event is a TopicRejected
    ==================  ====  =========================================================

    Other controllers can command the references, linear and angular velocity; the topic
    is ignored then. A reference holds for ``reference_timeout``, or one tick if that is
    0. Without one the driven wheels stop and the steered ones stay. One that isn't
    finite is none; upstream would command infinite ones. The state is a
    SteeringControllerState.
    """

    topics = REFERENCE
    takes_poses_despite = ALWAYS

    def __init__(
        self,
        parameters: SteeringControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        driven = parameters.traction_joints_names
        steered = parameters.steering_joints_names
        self._geometry = parameters.make_geometry()
        self._num_driven = len(driven)
        self._is_open_loop = parameters.open_loop
        self._slows_down = parameters.reduce_wheel_speed_until_steering_reached
        self._reads_positions = parameters.position_feedback
        self._timeout_ns = int(parameters.reference_timeout * NANOSECONDS)
        self._nothing = np.full(len(driven) + len(steered), np.nan)
        feedback = interfaces.POSITION if self._reads_positions else interfaces.VELOCITY
        read = parameters.traction_joints_state_names or driven
        turned = parameters.steering_joints_state_names or steered
        means = RollingMean(parameters.velocity_rolling_window_size)
        super().__init__(
            parameters,
            params,
            SteeringControllerState(SteeringOdometry(means), self._nothing),
            is_stamped=parameters.use_stamped_vel,
            is_lyrical=True,
            outputs={"controller_state": self._describe_status},
            state_interfaces=(
                *interfaces.interface_names(read, (feedback,)),
                *interfaces.interface_names(turned, (interfaces.POSITION,)),
            ),
            command_interfaces=(
                *interfaces.interface_names(driven, (interfaces.VELOCITY,)),
                *interfaces.interface_names(steered, (interfaces.POSITION,)),
            ),
        )
        # Of one tick, what is wrong with poses is told first.
        self._topics.reverse()

    def _update(
        self, now: UpdateContext, state: SteeringControllerState
    ) -> SteeringControllerState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        received = state.received
        if chained is not None:
            v, w = chained.tolist()
        else:
            v, w = received.velocity
            if 0 < self._timeout_ns < now.time_ns - received.stamp_ns:
                v, w = _UNKNOWN
            if not self._timeout_ns:
                received = BaseCommand(_UNKNOWN)
        measured = tuple(self._read(now.context).tolist())
        odometry = state.odometry
        if state.pose is None:
            odometry = self._locate(odometry, (v, w), measured, now)
        else:  # In the place of what is measured.
            odometry = odometry.set_pose(state.pose)
        if math.isfinite(v) and math.isfinite(w):
            commands = to_wheel_commands(
                self._geometry,
                v,
                w,
                measured=None if self._is_open_loop else odometry.steering,
                slows_down=self._slows_down,
            )
            command = np.array([*commands.traction, *commands.steering])
        else:
            command = state.command.copy()
            command[: self._num_driven] = 0.0
        return SteeringControllerState(
            odometry=odometry,
            command=command,
            received=received,
            inbox=state.inbox,
            time_ns=now.time_ns,
            measured=measured,
            shown=tuple(command.tolist()),
        )

    def _locate(
        self,
        odometry: SteeringOdometry,
        requested: tuple[float, float],
        measured: tuple[float, ...],
        now: UpdateContext,
    ) -> SteeringOdometry:
        """Return the odometry after a tick."""
        dt = now.period_ns / NANOSECONDS
        if self._is_open_loop:
            v, w = (value if math.isfinite(value) else 0.0 for value in requested)
            return odometry.follow(v, w, dt)
        wheels, angles = measured[: self._num_driven], measured[self._num_driven :]
        if self._reads_positions:
            return odometry.measure_positions(self._geometry, wheels, angles, dt)
        return odometry.measure_velocities(self._geometry, wheels, angles, dt)

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        if 0 < self._timeout_ns < age_ns:
            return None, (
                f"header.stamp must be at most {self._timeout_ns / NANOSECONDS} s "
                f"(reference_timeout) old, got {age_ns / NANOSECONDS} s"
            )
        return take_finite(command)

    def _take_pose(
        self, state: SteeringControllerState, message: SetOdometry, time_ns: int
    ) -> tuple[SteeringControllerState, str]:
        pose = [message.x, message.y, message.yaw]
        if not all(map(math.isfinite, pose)):
            return state, f"x, y and yaw must be finite, got {pose}"
        return super()._take_pose(state, message, time_ns)

    def _activate(
        self, now: UpdateContext, state: SteeringControllerState
    ) -> SteeringControllerState:
        return state._replace(command=self._nothing, received=BaseCommand(_UNKNOWN))

    def _deactivate(
        self, now: UpdateContext, state: SteeringControllerState
    ) -> SteeringControllerState:
        return self._activate(now, state)

    def _describe_status(
        self, state: SteeringControllerState
    ) -> SteeringControllerStatus:
        """Return the topic controller_state."""
        if state.time_ns is None:
            return SteeringControllerStatus()
        n = self._num_driven
        wheels = state.measured[:n]
        return SteeringControllerStatus(
            Header.from_nanoseconds(state.time_ns),
            wheels if self._reads_positions else (),
            () if self._reads_positions else wheels,
            state.measured[n:],
            state.shown[:n],
            state.shown[n:],
        )
