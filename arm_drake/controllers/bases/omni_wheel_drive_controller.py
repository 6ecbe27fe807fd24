"""``omni_wheel_drive_controller/OmniWheelDriveController``.

Source: ros2_controllers, `omni_wheel_drive_controller` (version 6.9.0). Kinematics and
odometry are `arm_drake.controllers.bases.omni_wheel_drive_controller`.

Parameters of an OmniWheelDriveController.

Source: ros2_controllers, `omni_wheel_drive_controller` (version 6.9.0).

Kinematics, odometry and commands of a base on three or more omni wheels.

The rules are those of ros2_controllers' omni_wheel_drive_controller (version 6.9.0). A
velocity is forwards and to the left [m/s], and of turning to the left [rad/s]; n is the
number of wheels.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose
from arm_drake.controllers.bases.base import (
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
)
from arm_drake.description.parameters import check_above, check_duration, check_length
from arm_drake.messages import (
    NANOSECONDS,
    Message,
    Odometry,
    SetOdometry,
    TopicRejected,
    TwistStamped,
)


@dc.dataclass(frozen=True)
class DiagonalCovariance:
    """Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw."""

    pose: tuple[float, ...] = (0.0,) * 6
    twist: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_length(self, 6, "pose", "twist")


@dc.dataclass(frozen=True)
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
        """Reject what the types alone can't express."""
        if len(self.wheel_names) < 3:
            raise ValueError(
                f"wheel_names must have at least 3 elements, "
                f"got {list(self.wheel_names)}"
            )
        check_above(self, 0.0, "robot_radius", "wheel_radius")
        check_duration(self, "cmd_vel_timeout")


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


class OmniWheelInbox(NamedTuple):
    """What came in on the ports of an OmniWheelDriveController."""

    # None before the first cycle.
    command: OmniWheelCommand | None = None

    # Pose to be taken at the next tick with a reference.
    pose: PlanarPose | None = None

    # What was on the ports at the last tick.
    commands: tuple[TwistStamped, ...] = ()
    requests: tuple[SetOdometry, ...] = ()

    # The latest of all that was not accepted.
    events: Events = ()


class OmniWheelDriveState(NamedTuple):
    """State of an OmniWheelDriveController between two ticks."""

    inbox: OmniWheelInbox
    odometry: OmniWheelOdometry

    # Velocities of the wheels [rad/s], shape (n,); NaN is none.
    command: Array

    # What is asked for; NaN if there is nothing.
    reference: Velocity = UNKNOWN

    # Time of the last update of the odometry [ns]; None before the first one.
    time_ns: int | None = None

    # Why the last tick failed; empty if it didn't.
    fault: str = ""


class OmniWheelDriveController(TickingController[OmniWheelDriveState]):
    """Turns omni wheels so that a base moves as it is told, sideways too.

    .. pydrake_system::

        name: OmniWheelDriveController
        input_ports:
        - controller_manager
        - state_interfaces
        - cmd_vel
        - set_odometry
        output_ports:
        - command_interfaces
        - odom
        - tf
        - events

    With n = len(wheel_names), vectors in their order:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    what all J joints of the robot measure, or more
    cmd_vel             --    TwistStamped: velocity of the base until it is older than
                              ``cmd_vel_timeout``
    set_odometry        --    SetOdometry: where the base is
    command_interfaces  --    Tick; its command is (n,)
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

    message_types: ClassVar[dict[str, type[Message]]] = {
        "cmd_vel": TwistStamped,
        "set_odometry": SetOdometry,
    }

    def __init__(
        self,
        parameters: OmniWheelDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        wheels, own = parameters.wheel_names, params.controller_name
        self._parameters = parameters
        self._kinematics = OmniWheelKinematics(
            len(wheels),
            parameters.wheel_offset,
            parameters.robot_radius,
            parameters.wheel_radius,
        )
        self._timeout_ns = int(parameters.cmd_vel_timeout * NANOSECONDS)
        self._frames = resolve_frames(
            parameters.odom_frame_id,
            parameters.base_frame_id,
            prefix=parameters.tf_frame_prefix,
            namespace=params.namespace,
            is_enabled=parameters.tf_frame_prefix_enable,
        )
        self._covariances = (
            diagonal(parameters.diagonal_covariance.pose),
            diagonal(parameters.diagonal_covariance.twist),
        )
        self._nothing = np.full(len(wheels), np.nan)
        read = (
            interfaces.POSITION if parameters.position_feedback else interfaces.VELOCITY
        )
        velocity = (interfaces.VELOCITY,)
        super().__init__(
            params,
            OmniWheelDriveState(
                OmniWheelInbox(),
                OmniWheelOdometry((0.0,) * len(wheels)),
                self._nothing,
            ),
            state_interfaces=interfaces.interface_names(
                () if parameters.open_loop else wheels, (read,)
            ),
            command_interfaces=interfaces.interface_names(wheels, velocity),
            reference_interfaces=interfaces.interface_names(
                (f"{own}/linear/x", f"{own}/linear/y", f"{own}/angular/z"), velocity
            ),
        )
        nothing = AbstractValue.Make(())
        self._cmd_vel = self.DeclareAbstractInputPort("cmd_vel", nothing)
        self._set_odometry = self.DeclareAbstractInputPort("set_odometry", nothing)
        self._declare_topic("odom", self._describe_odometry)
        if parameters.enable_odom_tf:
            self._declare_topic(
                "tf", lambda s: make_transform(self._describe_odometry(s))
            )
        self._declare_topic("events", lambda state: state.inbox.events)

    def _update(self, now: Now, state: OmniWheelDriveState) -> OmniWheelDriveState:
        chained = self._read_references(now)
        inbox = self._receive(now, state.inbox, "" if chained is None else CHAINED)
        assert inbox.command is not None
        asked = inbox.command.follow(now.time_ns, self._timeout_ns)
        if chained is not None:
            asked = (float(chained[0]), float(chained[1]), float(chained[2]))
        x, y, z = (
            old if math.isnan(new) else new
            for new, old in zip(asked, state.reference, strict=True)
        )
        reference = (x, y, z)
        state = state._replace(
            inbox=inbox, reference=reference, command=self._nothing, fault=""
        )
        if not all(map(math.isfinite, reference)):
            return state
        if inbox.pose is not None:
            odometry = state.odometry._replace(pose=inbox.pose)
            inbox = inbox._replace(pose=None)
        else:
            measured = self._read(now.context)
            if np.isnan(measured).any():
                wheel = int(np.isnan(measured).argmax())
                return state._replace(fault=f"{self.state_interfaces[wheel]} is NaN")
            odometry = self._move(
                state.odometry, reference, measured, now.period_ns / NANOSECONDS
            )
        time_ns = state.time_ns if odometry is state.odometry else now.time_ns
        command = self._kinematics.to_wheels(reference)
        return OmniWheelDriveState(inbox, odometry, command, reference, time_ns)

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
        self, now: Now, inbox: OmniWheelInbox, obstacle: str = ""
    ) -> OmniWheelInbox:
        """Return what has come in; no commands if there is an obstacle."""
        context = now.context
        if inbox.command is None:
            inbox = inbox._replace(command=OmniWheelCommand(now.time_ns))
        twists, commands = new_messages(
            self._cmd_vel, context, TwistStamped, inbox.commands
        )
        poses, requests = new_messages(
            self._set_odometry, context, SetOdometry, inbox.requests
        )
        if commands is inbox.commands and requests is inbox.requests:
            return inbox
        news: list[Rejection] = []
        for message in twists:
            if obstacle:
                news.append(TopicRejected(message, obstacle))
                continue
            command = OmniWheelCommand.from_message(message, now.time_ns)
            fault = command.find_fault(now.time_ns, self._timeout_ns)
            if fault:
                news.append(TopicRejected(message, fault))
            if not command.is_old(now.time_ns, self._timeout_ns):
                inbox = inbox._replace(command=command)
        for request in poses:
            if obstacle == INACTIVE:
                news.append(TopicRejected(request, obstacle))
            else:
                pose = PlanarPose(request.x, request.y, request.yaw)
                inbox = inbox._replace(pose=pose)
        events = add_events(inbox.events, news)
        return inbox._replace(commands=commands, requests=requests, events=events)

    def _deactivate(self, now: Now, state: OmniWheelDriveState) -> OmniWheelDriveState:
        inbox = state.inbox._replace(command=OmniWheelCommand(now.time_ns))
        rest = np.zeros(len(self._nothing))
        return state._replace(inbox=inbox, command=rest, reference=UNKNOWN)

    def _idle(self, now: Now, state: OmniWheelDriveState) -> OmniWheelDriveState:
        inbox = self._receive(now, state.inbox, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def _command(self, state: OmniWheelDriveState) -> Array:
        return state.command

    def _is_ok(self, state: OmniWheelDriveState) -> bool:
        return not state.fault

    def _fault(self, state: OmniWheelDriveState) -> str:
        return state.fault

    def _describe_odometry(self, state: OmniWheelDriveState) -> Odometry:
        """Return the topic odom."""
        _, pose, velocity = state.odometry
        return make_odometry(
            state.time_ns, self._frames, pose, velocity, self._covariances
        )
