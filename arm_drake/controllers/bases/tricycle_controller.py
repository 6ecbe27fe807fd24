"""``tricycle_controller/TricycleController``.

Source: ros2_controllers, `tricycle_controller` (version 6.9.0); the equations are in
`arm_drake.controllers.bases.tricycle`.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.odometry import PlanarPose, RollingMean
from arm_drake.control.steering_references import SteeringReferences
from arm_drake.controllers.bases.base import (
    BaseFrames,
    diagonal,
    make_odometry,
    make_transform,
)
from arm_drake.controllers.bases.tricycle import (
    SteeringLimiter,
    TractionLimiter,
    TricycleCommand,
    TricycleOdometry,
    make_range,
    make_symmetric_range,
    speed_scale,
    to_wheel_command,
)
from arm_drake.controllers.bases.tricycle_parameters import (
    SteeringLimits,
    TractionLimits,
    TricycleControllerParameters,
)
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import INACTIVE, new_messages
from arm_drake.messages import NANOSECONDS, Odometry, TFMessage, Twist, TwistStamped
from arm_drake.messages.steering import AckermannDrive, ResetOdometry

_MILLISECONDS = NANOSECONDS // 1000


class TricycleControllerState(NamedTuple):
    """State of a TricycleController between two ticks."""

    odometry: TricycleOdometry

    # Commands, shape (2,): velocity [rad/s] and angle [rad]; NaN is none.
    command: Array

    references: SteeringReferences = SteeringReferences()

    # Whether the next tick is to reset the odometry, and what was on that port.
    is_reset: bool = False
    resets: tuple[ResetOdometry, ...] = ()

    # The last two commands, the newest last; as upstream keeps them, see `_round`.
    previous: tuple[TricycleCommand, TricycleCommand] = (TricycleCommand(),) * 2

    # Time of the last tick [ns]; None before the first one.
    time_ns: int | None = None

    # Whether the last tick could read what it needs.
    is_ok: bool = True


class TricycleController(TickingController[TricycleControllerState]):
    """Drives a base whose front wheel drives and steers, and tells where it is.

    .. pydrake_system::

        name: TricycleController
        input_ports:
        - controller_manager
        - state_interfaces
        - cmd_vel
        - reset_odometry
        output_ports:
        - command_interfaces
        - odom
        - tf
        - cmd_ackermann
        - events

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    2J    positions and velocities of all J joints of the robot, or
                              more
    cmd_vel             --    TwistStamped: velocity of the base from now on; with
                              humble's ``use_stamped_vel: false`` the port is
                              ``cmd_vel_unstamped`` and takes a Twist
    reset_odometry      --    ResetOdometry: the base is at the origin now
    command_interfaces  --    Tick; its command is (2,): velocity [rad/s], angle [rad]
    odom                --    Odometry
    tf                  --    TFMessage; there only with ``enable_odom_tf``
    cmd_ackermann       --    AckermannDrive, the limited command; there only with
                              ``publish_ackermann_command``
    events              --    tuple of the latest (number, event), the newest last; an
                              event is a TopicRejected
    ==================  ====  =========================================================

    Without a command of the last ``cmd_vel_timeout`` the base stops and the wheel goes
    straight. A command that isn't finite stops it, too; upstream would pass it on. A
    tick that can't read the joints fails. The state is a TricycleControllerState.
    """

    def __init__(
        self,
        parameters: TricycleControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        self._wheelbase, self._radius = parameters.wheelbase, parameters.wheel_radius
        self._is_open_loop = parameters.open_loop
        self._timeout_ns = parameters.cmd_vel_timeout * _MILLISECONDS
        self._traction = _make_traction_limiter(parameters.traction)
        self._steering = _make_steering_limiter(parameters.steering)
        self._frames = BaseFrames(parameters.odom_frame_id, parameters.base_frame_id)
        self._has_pose = not parameters.odom_only_twist
        self._covariances = (
            diagonal(parameters.pose_covariance_diagonal),
            diagonal(parameters.twist_covariance_diagonal),
        )
        names = (
            f"{parameters.traction_joint_name}/{interfaces.VELOCITY}",
            f"{parameters.steering_joint_name}/{interfaces.POSITION}",
        )
        means = RollingMean(parameters.velocity_rolling_window_size)
        super().__init__(
            params,
            TricycleControllerState(TricycleOdometry(means), np.full(2, np.nan)),
            state_interfaces=names,
            command_interfaces=names,
        )
        topic = "cmd_vel" if parameters.use_stamped_vel else "cmd_vel_unstamped"
        self._kind = TwistStamped if parameters.use_stamped_vel else Twist
        self.message_types = {topic: self._kind, "reset_odometry": ResetOdometry}
        nothing = AbstractValue.Make(())
        self._cmd_vel = self.DeclareAbstractInputPort(topic, nothing)
        self._reset = self.DeclareAbstractInputPort("reset_odometry", nothing)
        self._declare_topic("odom", self._tell_odometry, default=Odometry())
        if parameters.enable_odom_tf:
            self._declare_topic("tf", self._tell_frames, default=TFMessage())
        if parameters.publish_ackermann_command:
            self._declare_topic(
                "cmd_ackermann", self._tell_command, default=AckermannDrive()
            )
        self._declare_topic("events", lambda state: state.references.events)

    def _update(
        self, now: Now, state: TricycleControllerState
    ) -> TricycleControllerState:
        state = self._receive(now, state)
        references = state.references
        v = w = 0.0
        age_ns = now.time_ns - references.stamp_ns
        if references.asked is not None and age_ns <= self._timeout_ns:
            v, w = references.asked
        rate, angle = self._read(now.context).tolist()
        if not math.isfinite(angle) or not (self._is_open_loop or math.isfinite(rate)):
            return state._replace(is_ok=False)
        dt = now.period_ns / NANOSECONDS
        if self._is_open_loop:
            odometry = state.odometry.follow(v, w, dt)
        else:
            speed = rate * self._radius
            odometry = state.odometry.measure(speed, angle, self._wheelbase, dt)
        if state.is_reset:
            odometry = odometry.reset()
        asked = to_wheel_command(v, w, wheelbase=self._wheelbase, radius=self._radius)
        slowed = asked.rate * speed_scale(abs(asked.angle - angle))
        second, last = state.previous
        command = TricycleCommand(
            self._traction.limit(slowed, last.rate, second.rate, dt),
            self._steering.limit(asked.angle, last.angle, second.angle, dt),
        )
        return state._replace(
            odometry=odometry,
            command=np.array(command),
            is_reset=False,
            previous=(last, _round(command)),
            time_ns=now.time_ns,
            is_ok=True,
        )

    def _receive(
        self, now: Now, state: TricycleControllerState, obstacle: str = ""
    ) -> TricycleControllerState:
        """Return the state with what has come in."""
        context, references = now.context, state.references
        new_resets, resets = new_messages(
            self._reset, context, ResetOdometry, state.resets
        )
        new, messages = new_messages(
            self._cmd_vel, context, self._kind, references.messages
        )
        if resets is state.resets and messages is references.messages:
            return state
        references = references._replace(messages=messages)
        # Any age is taken; what is too old has no effect.
        references = references.take(new, now.time_ns, 0, obstacle)
        return state._replace(
            references=references,
            is_reset=state.is_reset or bool(new_resets),
            resets=resets,
        )

    def _deactivate(
        self, now: Now, state: TricycleControllerState
    ) -> TricycleControllerState:
        del now
        return state._replace(command=np.zeros(2))

    def _idle(
        self, now: Now, state: TricycleControllerState
    ) -> TricycleControllerState:
        return self._receive(now, state, INACTIVE)

    def _command(self, state: TricycleControllerState) -> Array:
        return state.command

    def _is_ok(self, state: TricycleControllerState) -> bool:
        return state.is_ok

    def _fault(self, state: TricycleControllerState) -> str:
        del state
        return f"not all of {', '.join(self.state_interfaces)} could be read"

    def _tell_odometry(self, state: TricycleControllerState) -> Odometry:
        pose = state.odometry.pose if self._has_pose else PlanarPose()
        return self._make_odometry(state, pose)

    def _tell_frames(self, state: TricycleControllerState) -> TFMessage:
        if state.time_ns is None:
            return TFMessage()
        return make_transform(self._make_odometry(state, state.odometry.pose))

    def _tell_command(self, state: TricycleControllerState) -> AckermannDrive:
        rate, angle = state.previous[-1]
        return AckermannDrive(steering_angle=angle, speed=rate)

    def _make_odometry(
        self, state: TricycleControllerState, pose: PlanarPose
    ) -> Odometry:
        v, w = state.odometry.velocity
        return make_odometry(
            state.time_ns, self._frames, pose, (v, 0.0, w), self._covariances
        )


def _make_traction_limiter(limits: TractionLimits) -> TractionLimiter:
    return TractionLimiter(
        velocity=make_range(limits.min_velocity, limits.max_velocity),
        acceleration=make_range(limits.min_acceleration, limits.max_acceleration),
        deceleration=make_range(limits.min_deceleration, limits.max_deceleration),
        jerk=make_range(limits.min_jerk, limits.max_jerk),
    )


def _make_steering_limiter(limits: SteeringLimits) -> SteeringLimiter:
    return SteeringLimiter(
        position=make_symmetric_range(limits.min_position, limits.max_position),
        velocity=make_range(limits.min_velocity, limits.max_velocity),
        acceleration=make_range(limits.min_acceleration, limits.max_acceleration),
    )


def _round(command: TricycleCommand) -> TricycleCommand:
    """Return a command in the single precision of AckermannDrive.

    Upstream limits the next command by the last two in this form.
    """
    return TricycleCommand(*map(float, np.array(command, dtype=np.float32)))
