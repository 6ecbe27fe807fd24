"""The ``omni_wheel_drive_controller/OmniWheelDriveController``, on n wheels.

Source: ros2_controllers, `omni_wheel_drive_controller` (version 6.9.0). A velocity is
forwards and to the left [m/s], and of turning to the left [rad/s]; n is the number of
wheels, and a step takes dt [s].
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose
from arm_drake.controllers.bases.base import BaseCommand, BaseController, Velocity
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import CHAINED, Inbox
from arm_drake.description.parameters import (
    check_duration,
    check_length,
    check_positive,
)
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS


@dataclass(frozen=True)
class DiagonalCovariance:
    """Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw."""

    pose: tuple[float, ...] = (0.0,) * 6
    twist: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        check_length(self, 6, "pose", "twist")


@dataclass(frozen=True)
class OmniWheelDriveControllerParameters:
    """Parameters of an OmniWheelDriveController."""

    # Joints of the wheels, anticlockwise from the first; at least three.
    wheel_names: tuple[str, ...]

    # Angle of the first wheel from the x axis [rad].
    wheel_offset: float

    # Distance of the wheels from the centre, above 0 [m].
    robot_radius: float

    # Radius of the wheels, above 0 [m].
    wheel_radius: float

    # Frames of the odometry, and what goes before their names.
    tf_frame_prefix_enable: bool = True
    tf_frame_prefix: str = ""
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"

    diagonal_covariance: DiagonalCovariance = DiagonalCovariance()

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether the wheels' positions are read, not their velocities.
    position_feedback: bool = True

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Age from which a command counts no more [s].
    cmd_vel_timeout: float = 0.5

    def __post_init__(self) -> None:
        if len(self.wheel_names) < 3:
            raise ValueError(
                f"wheel_names must have at least 3 elements, "
                f"got {list(self.wheel_names)}"
            )
        check_positive(self, "robot_radius", "wheel_radius")
        check_duration(self, "cmd_vel_timeout")


UNKNOWN: Velocity = (math.nan, math.nan, math.nan)
REST: Velocity = (0.0, 0.0, 0.0)

# Shorter steps aren't integrated [s], and smaller turns are straight [rad].
_MIN_STEP = 1e-6
_MIN_TURN = 1e-6


@dataclass(frozen=True, eq=False)
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
        """Return the velocity of the base that fits the wheels [rad/s] best."""
        vx, vy, w = (self._to_base @ wheels).tolist()
        return vx, vy, w


class OmniWheelOdometry(NamedTuple):
    """Estimated pose and velocity of a base."""

    # Of the wheels at the last step [rad], shape (n,).
    positions: tuple[float, ...]

    pose: PlanarPose = PlanarPose()
    velocity: Velocity = REST

    def from_positions(
        self, kinematics: OmniWheelKinematics, positions: Sequence[float], dt: float
    ) -> "OmniWheelOdometry":
        """Return the odometry after a step; itself if it is too short."""
        if abs(dt) < _MIN_STEP:
            return self
        moved = (np.array(positions) - np.array(self.positions)) / dt
        new = self.from_velocities(kinematics, moved, dt)
        return new._replace(positions=tuple(positions))

    def from_velocities(
        self, kinematics: OmniWheelKinematics, velocities: Array, dt: float
    ) -> "OmniWheelOdometry":
        """Return the odometry after a step; itself if it is too short."""
        return self.move(kinematics.to_base(velocities), dt)

    def move(self, velocity: Velocity, dt: float) -> "OmniWheelOdometry":
        """Return the odometry after a step of the base; itself if it is too short."""
        if abs(dt) < _MIN_STEP:
            return self
        return self._replace(
            pose=_integrate(self.pose, velocity, dt), velocity=velocity
        )


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


class OmniWheelDriveState(NamedTuple):
    """State of an OmniWheelDriveController between two ticks."""

    odometry: OmniWheelOdometry

    # Velocities of the wheels [rad/s], shape (n,); NaN is none.
    command: Array

    # The last command, or when it began that there was none; None before.
    received: BaseCommand | None = None

    # What is asked for; NaN if there is nothing.
    reference: Velocity = UNKNOWN

    # Pose to be taken at the next tick with a reference.
    pose: PlanarPose | None = None

    inbox: Inbox = Inbox()

    # Time of the last update of the odometry [ns]; None before the first one.
    time_ns: int | None = None

    # Why the last tick failed; empty if it didn't.
    fault: str = ""


class OmniWheelDriveController(BaseController[OmniWheelDriveState]):
    """Drives the omni wheels of a base by its velocity command, sideways too.

    With n = len(wheel_names), vectors in their order:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    what all J joints of the robot measure, or more
    cmd_vel             --    TwistStamped: velocity of the base until it is older than
                              ``cmd_vel_timeout``
    set_odometry        --    SetOdometry: where the base is
    command_interfaces  --    UpdateResult; command (n,)
    odom                --    Odometry: where the wheels, or with ``open_loop`` the
                              commands, say that the base is
    tf                  --    TFMessage with the same, if ``enable_odom_tf``
    events              --    tuple of the latest (number, TopicRejected)
    ==================  ====  =========================================================

    Other controllers can command the references; the topic is ignored then. References
    hold until there are others. Before the first one nothing is commanded or published,
    until a time of ``cmd_vel_timeout`` has passed: then, as when a command is too old,
    the base is to rest. With a timeout of 0 that is so in each tick after the stamp. Of
    a command that isn't finite the stamp alone counts. A pose on ``set_odometry`` takes
    the place of one update of the odometry. A measurement of NaN ends the activation.
    The state is an OmniWheelDriveState.
    """

    moves_sideways = True

    def __init__(
        self,
        parameters: OmniWheelDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        config, wheels = parameters, parameters.wheel_names
        self._parameters = config
        self._kinematics = OmniWheelKinematics(
            len(wheels), config.wheel_offset, config.robot_radius, config.wheel_radius
        )
        self._timeout_ns = int(config.cmd_vel_timeout * NANOSECONDS)
        self._nothing = np.full(len(wheels), np.nan)
        read = interfaces.POSITION if config.position_feedback else interfaces.VELOCITY
        covariance = config.diagonal_covariance
        super().__init__(
            config,
            params,
            OmniWheelDriveState(OmniWheelOdometry((0.0,) * len(wheels)), self._nothing),
            covariances=(covariance.pose, covariance.twist),
            state_interfaces=interfaces.interface_names(
                () if config.open_loop else wheels, (read,)
            ),
            command_interfaces=interfaces.interface_names(
                wheels, (interfaces.VELOCITY,)
            ),
        )

    def _update(
        self, now: UpdateContext, state: OmniWheelDriveState
    ) -> OmniWheelDriveState:
        chained = self._read_references(now)
        state = self._receive(now, state, "" if chained is None else CHAINED)
        requested = self._follow(now, state) if chained is None else chained.tolist()
        reference = tuple(
            old if math.isnan(new) else new
            for new, old in zip(requested, state.reference, strict=True)
        )
        state = state._replace(reference=reference, command=self._nothing, fault="")
        if not all(map(math.isfinite, reference)):
            return state
        if state.pose is not None:
            odometry = state.odometry._replace(pose=state.pose)
        else:
            measured = self._read(now.context)
            if np.isnan(measured).any():
                wheel = int(np.isnan(measured).argmax())
                return state._replace(fault=f"{self.state_interfaces[wheel]} is NaN")
            odometry = self._move(
                state.odometry, reference, measured, now.period_ns / NANOSECONDS
            )
        return state._replace(
            odometry=odometry,
            command=self._kinematics.to_wheels(reference),
            pose=None,
            time_ns=state.time_ns if odometry is state.odometry else now.time_ns,
        )

    def _follow(self, now: UpdateContext, state: OmniWheelDriveState) -> Velocity:
        """Return the velocity of the last command; NaN leaves the references."""
        assert state.received is not None
        velocity, stamp_ns = state.received
        if now.time_ns - stamp_ns > self._timeout_ns:
            return REST
        return velocity if all(map(math.isfinite, velocity)) else UNKNOWN

    def _move(
        self, old: OmniWheelOdometry, reference: Velocity, measured: Array, dt: float
    ) -> OmniWheelOdometry:
        """Return the odometry after a tick; the old one if it is too short."""
        if self._parameters.open_loop:
            return old.move(reference, dt)
        if self._parameters.position_feedback:
            return old.from_positions(self._kinematics, measured.tolist(), dt)
        return old.from_velocities(self._kinematics, measured, dt)

    def _receive(
        self, now: UpdateContext, state: OmniWheelDriveState, obstacle: str = ""
    ) -> OmniWheelDriveState:
        if state.received is None:
            state = state._replace(received=BaseCommand(UNKNOWN, now.time_ns))
        return super()._receive(now, state, obstacle)

    def _check(
        self, command: BaseCommand, age_ns: int
    ) -> tuple[BaseCommand | None, str]:
        if self._timeout_ns and age_ns >= self._timeout_ns:
            return None, (
                f"it is {age_ns / NANOSECONDS:g} s old, not less than cmd_vel_timeout "
                f"({self._timeout_ns / NANOSECONDS:g} s); it is ignored"
            )
        if all(map(math.isfinite, command.velocity)):
            return command, ""
        return command, (
            "linear.x, linear.y and angular.z must be finite, got "
            f"{', '.join(map(str, command.velocity))}; the last reference goes on"
        )

    def _deactivate(
        self, now: UpdateContext, state: OmniWheelDriveState
    ) -> OmniWheelDriveState:
        return state._replace(
            received=BaseCommand(UNKNOWN, now.time_ns),
            command=np.zeros(len(self._nothing)),
            reference=UNKNOWN,
        )

    def _is_ok(self, state: OmniWheelDriveState) -> bool:
        return not state.fault

    def _fault(self, state: OmniWheelDriveState) -> str:
        return state.fault
