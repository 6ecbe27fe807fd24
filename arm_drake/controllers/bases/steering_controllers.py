"""The bicycle, tricycle and ackermann ``...SteeringController``, one system for all.

Source: ros2_controllers, `steering_controllers_library` (version 6.9.0); the equations
are in `arm_drake.control.steering`.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import RollingMean
from arm_drake.control.steering import SteeringOdometry, to_wheel_commands
from arm_drake.control.steering_references import SteeringReferences
from arm_drake.controllers.bases.base import (
    diagonal,
    make_odometry,
    make_transform,
    resolve_frames,
)
from arm_drake.controllers.bases.steering_parameters import SteeringControllerParameters
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import CHAINED, INACTIVE, new_messages
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Odometry,
    SetOdometry,
    TFMessage,
    Twist,
    TwistStamped,
)
from arm_drake.messages.steering import SteeringControllerStatus


class SteeringControllerState(NamedTuple):
    """State of a steering controller between two ticks."""

    odometry: SteeringOdometry

    # Commands since the activation, driven wheels first; NaN is none.
    command: Array

    references: SteeringReferences = SteeringReferences()

    # Of the last tick: its time [ns], None before the first one, what it measured and
    # what it commanded.
    time_ns: int | None = None
    measured: tuple[float, ...] = ()
    shown: tuple[float, ...] = ()


class SteeringController(TickingController[SteeringControllerState]):
    """Drives a base with steered wheels, and tells where it is.

    .. pydrake_system::

        name: SteeringController
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
    command_interfaces  --    Tick; its command is (n + k,): velocities [rad/s], then
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

    def __init__(
        self,
        parameters: SteeringControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        driven = parameters.traction_joints_names
        steered = parameters.steering_joints_names
        self._geometry = parameters.make_geometry()
        self._num_driven = len(driven)
        self._is_open_loop = parameters.open_loop
        self._slows_down = parameters.reduce_wheel_speed_until_steering_reached
        self._reads_positions = parameters.position_feedback
        self._timeout_ns = int(parameters.reference_timeout * NANOSECONDS)
        self._frames = resolve_frames(
            parameters.odom_frame_id,
            parameters.base_frame_id,
            prefix=parameters.tf_frame_prefix,
            namespace=params.namespace,
            is_lyrical=True,
        )
        self._covariances = (
            diagonal(parameters.pose_covariance_diagonal),
            diagonal(parameters.twist_covariance_diagonal),
        )
        self._nothing = np.full(len(driven) + len(steered), np.nan)
        feedback = interfaces.POSITION if self._reads_positions else interfaces.VELOCITY
        read = parameters.traction_joints_state_names or driven
        turned = parameters.steering_joints_state_names or steered
        means = RollingMean(parameters.velocity_rolling_window_size)
        super().__init__(
            params,
            SteeringControllerState(SteeringOdometry(means), self._nothing),
            state_interfaces=(
                *interfaces.interface_names(read, (feedback,)),
                *interfaces.interface_names(turned, (interfaces.POSITION,)),
            ),
            command_interfaces=(
                *interfaces.interface_names(driven, (interfaces.VELOCITY,)),
                *interfaces.interface_names(steered, (interfaces.POSITION,)),
            ),
            reference_interfaces=(
                f"{params.controller_name}/linear/{interfaces.VELOCITY}",
                f"{params.controller_name}/angular/{interfaces.VELOCITY}",
            ),
        )
        is_stamped = parameters.use_stamped_vel
        topic = "reference" if is_stamped else "reference_unstamped"
        self._kind = TwistStamped if is_stamped else Twist
        self.message_types = {topic: self._kind, "set_odometry": SetOdometry}
        nothing = AbstractValue.Make(())
        self._reference = self.DeclareAbstractInputPort(topic, nothing)
        self._set_odometry = self.DeclareAbstractInputPort("set_odometry", nothing)
        self._declare_topic("odometry", self._tell_odometry, default=Odometry())
        if parameters.enable_odom_tf:
            self._declare_topic("tf_odometry", self._tell_frames, default=TFMessage())
        self._declare_topic(
            "controller_state", self._tell_status, default=SteeringControllerStatus()
        )
        self._declare_topic("events", lambda state: state.references.events)

    def _update(
        self, now: Now, state: SteeringControllerState
    ) -> SteeringControllerState:
        chained = self._read_references(now)
        obstacle = "" if chained is None else CHAINED
        references = self._receive(now, state.references, obstacle)
        if chained is not None:
            v, w = chained.tolist()
        else:
            current = references.current(now.time_ns, self._timeout_ns)
            v, w = current or (math.nan, math.nan)
            if not self._timeout_ns:
                references = references._replace(asked=None)
        measured = tuple(self._read(now.context).tolist())
        odometry = state.odometry
        if references.pose is None:
            odometry = self._locate(odometry, (v, w), measured, now)
        else:  # In the place of what is measured.
            odometry = odometry.set_pose(references.pose)
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
            odometry,
            command,
            references._replace(pose=None),
            now.time_ns,
            measured,
            tuple(command.tolist()),
        )

    def _locate(
        self,
        odometry: SteeringOdometry,
        asked: tuple[float, float],
        measured: tuple[float, ...],
        now: Now,
    ) -> SteeringOdometry:
        """Return the odometry after a tick."""
        dt = now.period_ns / NANOSECONDS
        if self._is_open_loop:
            v, w = (value if math.isfinite(value) else 0.0 for value in asked)
            return odometry.follow(v, w, dt)
        wheels, angles = measured[: self._num_driven], measured[self._num_driven :]
        if self._reads_positions:
            return odometry.measure_positions(self._geometry, wheels, angles, dt)
        return odometry.measure_velocities(self._geometry, wheels, angles, dt)

    def _receive(
        self, now: Now, references: SteeringReferences, obstacle: str
    ) -> SteeringReferences:
        """Return what has come in; an obstacle says why no velocities are taken."""
        context = now.context
        requests, asked = new_messages(
            self._set_odometry, context, SetOdometry, references.requests
        )
        new, messages = new_messages(
            self._reference, context, self._kind, references.messages
        )
        if asked is references.requests and messages is references.messages:
            return references
        references = references._replace(requests=asked, messages=messages)
        references = references.put(requests)
        return references.take(new, now.time_ns, self._timeout_ns, obstacle)

    def _activate(
        self, now: Now, state: SteeringControllerState
    ) -> SteeringControllerState:
        del now
        references = state.references._replace(asked=None)
        return state._replace(command=self._nothing, references=references)

    def _deactivate(
        self, now: Now, state: SteeringControllerState
    ) -> SteeringControllerState:
        return self._activate(now, state)

    def _idle(
        self, now: Now, state: SteeringControllerState
    ) -> SteeringControllerState:
        references = self._receive(now, state.references, INACTIVE)
        if references is state.references:
            return state
        return state._replace(references=references)

    def _command(self, state: SteeringControllerState) -> Array:
        return state.command

    def _tell_odometry(self, state: SteeringControllerState) -> Odometry:
        v, w = state.odometry.velocity
        pose, velocity = state.odometry.pose, (v, 0.0, w)
        return make_odometry(
            state.time_ns, self._frames, pose, velocity, self._covariances
        )

    def _tell_frames(self, state: SteeringControllerState) -> TFMessage:
        return make_transform(self._tell_odometry(state))

    def _tell_status(self, state: SteeringControllerState) -> SteeringControllerStatus:
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
