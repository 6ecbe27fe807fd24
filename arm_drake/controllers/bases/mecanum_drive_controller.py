"""``mecanum_drive_controller/MecanumDriveController``.

Source: ros2_controllers, `mecanum_drive_controller` (version 6.9.0). Kinematics and
odometry are `arm_drake.controllers.bases.mecanum`.
"""

import math
from typing import ClassVar, NamedTuple

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
from arm_drake.controllers.bases.mecanum import (
    REST,
    UNKNOWN,
    MecanumOdometry,
    MecanumReference,
    MecanumWheels,
    Velocity,
)
from arm_drake.controllers.bases.mecanum_drive_parameters import (
    MecanumDriveControllerParameters,
    make_kinematics,
    make_limiters,
)
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import (
    CHAINED,
    INACTIVE,
    Events,
    Rejection,
    add_events,
    new_messages,
)
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Message,
    Odometry,
    SetOdometry,
    TopicRejected,
    Twist,
    TwistStamped,
    Vector3,
)
from arm_drake.messages.mecanum import MecanumDriveControllerState

_WHEELS = ("front_left", "front_right", "rear_right", "rear_left")

_NOTHING = np.full(len(_WHEELS), np.nan)


class MecanumInbox(NamedTuple):
    """What came in on the ports of a MecanumDriveController."""

    reference: MecanumReference = MecanumReference()

    # Pose to be taken at the next tick.
    pose: PlanarPose | None = None

    # What was on the ports at the last tick.
    references: tuple[TwistStamped, ...] = ()
    requests: tuple[SetOdometry, ...] = ()

    # The latest of all that was not accepted.
    events: Events = ()


class MecanumDriveState(NamedTuple):
    """State of a MecanumDriveController between two ticks."""

    inbox: MecanumInbox = MecanumInbox()
    odometry: MecanumOdometry = MecanumOdometry()

    # The last two velocities that the limits let through, the newest first.
    limited: tuple[Velocity, Velocity] = (REST, REST)

    # Velocities of the wheels [rad/s], shape (4,); NaN is none.
    command: Array = _NOTHING

    # Of the last tick: its time [ns], None before the first one, what was asked for
    # and how the wheels turned.
    time_ns: int | None = None
    asked: Velocity = UNKNOWN
    wheels: MecanumWheels = MecanumWheels(0.0, 0.0, 0.0, 0.0)


class MecanumDriveController(TickingController[MecanumDriveState]):
    """Turns four mecanum wheels so that a base moves as it is told, sideways too.

    .. pydrake_system::

        name: MecanumDriveController
        input_ports:
        - controller_manager
        - state_interfaces
        - reference
        - set_odometry
        output_ports:
        - command_interfaces
        - odometry
        - tf_odometry
        - controller_state
        - events

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    what all J joints of the robot measure, or more
    reference           --    TwistStamped: velocity of the base frame, until it is
                              older than ``reference_timeout``
    set_odometry        --    SetOdometry: where the base is
    command_interfaces  --    Tick; its command is (4,): front left, front right, rear
                              right and rear left wheel [rad/s]
    odometry            --    Odometry: where the wheels say that the base is
    tf_odometry         --    TFMessage with the same, if ``enable_odom_tf``
    controller_state    --    MecanumDriveControllerState
    events              --    tuple of the latest (number, TopicRejected)
    ==================  ====  =========================================================

    Other controllers can command the references; the topic is ignored then. They hold
    for one tick, and so does a message if ``reference_timeout`` is 0. A message that
    gets too old stops the base through the limits for one tick; then, as always without
    a reference, the wheels are told to stop at once, all four, where upstream tells it
    to the first one alone. What the limits remember is then a base at rest. A message
    that isn't finite stops the wheels, too. A pose on ``set_odometry`` takes the place
    of one step of the odometry. The state is a MecanumDriveState.
    """

    message_types: ClassVar[dict[str, type[Message]]] = {
        "reference": TwistStamped,
        "set_odometry": SetOdometry,
    }

    def __init__(
        self,
        parameters: MecanumDriveControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.

        Raises:
            ParameterError: If the wheels can't tell how the base turns.
        """
        commanded = [
            getattr(parameters, f"{wheel}_wheel_command_joint_name")
            for wheel in _WHEELS
        ]
        measured = [
            getattr(parameters, f"{wheel}_wheel_state_joint_name") or joint
            for wheel, joint in zip(_WHEELS, commanded, strict=True)
        ]
        velocity = (interfaces.VELOCITY,)
        own = params.controller_name
        self._kinematics = make_kinematics(parameters)
        self._limiters = make_limiters(parameters)
        self._timeout_ns = int(parameters.reference_timeout * NANOSECONDS)
        self._frames = resolve_frames(
            parameters.odom_frame_id,
            parameters.base_frame_id,
            prefix=parameters.tf_frame_prefix,
            namespace=params.namespace,
            is_enabled=parameters.tf_frame_prefix_enable,
        )
        self._covariances = (
            diagonal(parameters.pose_covariance_diagonal),
            diagonal(parameters.twist_covariance_diagonal),
        )
        super().__init__(
            params,
            MecanumDriveState(),
            state_interfaces=interfaces.interface_names(measured, velocity),
            command_interfaces=interfaces.interface_names(commanded, velocity),
            reference_interfaces=interfaces.interface_names(
                [f"{own}/linear/x", f"{own}/linear/y", f"{own}/angular/z"], velocity
            ),
        )
        nothing = AbstractValue.Make(())
        self._reference = self.DeclareAbstractInputPort("reference", nothing)
        self._set_odometry = self.DeclareAbstractInputPort("set_odometry", nothing)
        self._declare_topic("odometry", self._describe_odometry)
        if parameters.enable_odom_tf:
            self._declare_topic(
                "tf_odometry", lambda s: make_transform(self._describe_odometry(s))
            )
        self._declare_topic("controller_state", self._describe)
        self._declare_topic("events", lambda state: state.inbox.events)

    def _update(self, now: Now, state: MecanumDriveState) -> MecanumDriveState:
        chained = self._read_references(now)
        inbox = self._receive(now, state.inbox, "" if chained is None else CHAINED)
        if chained is None:
            left, asked = inbox.reference.follow(now.time_ns, self._timeout_ns)
            inbox = inbox._replace(reference=left)
        else:
            asked = (float(chained[0]), float(chained[1]), float(chained[2]))
        dt = now.period_ns / NANOSECONDS
        wheels = MecanumWheels(*self._read(now.context).tolist())
        odometry = state.odometry
        if inbox.pose is not None:
            odometry = odometry._replace(pose=inbox.pose)
            inbox = inbox._replace(pose=None)
        elif not any(map(math.isnan, wheels)):
            odometry = odometry.update(self._kinematics, wheels, dt)
        limited, command = (REST, REST), np.zeros(len(_WHEELS))
        if all(map(math.isfinite, asked)):
            limited = (self._limit(asked, state.limited, dt), state.limited[0])
            command = np.array(self._kinematics.to_wheels(limited[0]))
        return MecanumDriveState(
            inbox, odometry, limited, command, now.time_ns, asked, wheels
        )

    def _limit(
        self, asked: Velocity, limited: tuple[Velocity, Velocity], dt: float
    ) -> Velocity:
        """Return a velocity within the limits."""
        x, y, z = (
            limiter.limit(v, v0, v1, dt).value
            for limiter, v, v0, v1 in zip(self._limiters, asked, *limited, strict=True)
        )
        return x, y, z

    def _receive(
        self, now: Now, inbox: MecanumInbox, obstacle: str = ""
    ) -> MecanumInbox:
        """Return what has come in; no references if there is an obstacle."""
        context = now.context
        twists, references = new_messages(
            self._reference, context, TwistStamped, inbox.references
        )
        poses, requests = new_messages(
            self._set_odometry, context, SetOdometry, inbox.requests
        )
        if references is inbox.references and requests is inbox.requests:
            return inbox
        news: list[Rejection] = []
        for message in twists:
            if obstacle:
                news.append(TopicRejected(message, obstacle))
                continue
            reference = MecanumReference.from_message(message, now.time_ns)
            fault = reference.find_fault(now.time_ns, self._timeout_ns)
            if fault:
                news.append(TopicRejected(message, fault))
                reference = MecanumReference()
            inbox = inbox._replace(reference=reference)
        for request in poses:
            if obstacle == INACTIVE:
                news.append(TopicRejected(request, obstacle))
            else:
                pose = PlanarPose(request.x, request.y, request.yaw)
                inbox = inbox._replace(pose=pose)
        events = add_events(inbox.events, news)
        return inbox._replace(references=references, requests=requests, events=events)

    def _deactivate(self, now: Now, state: MecanumDriveState) -> MecanumDriveState:
        del now
        inbox = state.inbox._replace(reference=MecanumReference())
        return state._replace(inbox=inbox, command=_NOTHING, limited=(REST, REST))

    def _idle(self, now: Now, state: MecanumDriveState) -> MecanumDriveState:
        inbox = self._receive(now, state.inbox, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def _command(self, state: MecanumDriveState) -> Array:
        return state.command

    def _describe_odometry(self, state: MecanumDriveState) -> Odometry:
        """Return the topic odometry."""
        return make_odometry(
            state.time_ns, self._frames, *state.odometry, self._covariances
        )

    def _describe(self, state: MecanumDriveState) -> MecanumDriveControllerState:
        """Return the topic controller_state."""
        if state.time_ns is None:
            return MecanumDriveControllerState()
        x, y, z = state.asked
        return MecanumDriveControllerState(
            Header.from_nanoseconds(state.time_ns, self._frames.odom),
            *state.wheels,
            Twist(Vector3(x, y, 0.0), Vector3(0.0, 0.0, z)),
        )
