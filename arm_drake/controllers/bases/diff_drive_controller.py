"""``diff_drive_controller/DiffDriveController``.

Source: ros2_controllers, `diff_drive_controller` (version 6.9.0; humble starts with a
command of 0). Kinematics and odometry are `arm_drake.control.diff_drive`.
"""

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.diff_drive import DiffDriveOdometryState, from_commands
from arm_drake.control.odometry import RollingMean
from arm_drake.controllers.bases.base import (
    diagonal,
    make_odometry,
    make_transform,
    resolve_frames,
)
from arm_drake.controllers.bases.diff_drive_inbox import (
    DiffDriveInbox,
    DiffDrivePorts,
    follow,
    make_kinematics,
    make_limiters,
    receive,
)
from arm_drake.controllers.bases.diff_drive_parameters import (
    DiffDriveControllerParameters,
)
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import CHAINED, INACTIVE
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Message,
    Odometry,
    SetOdometry,
    Twist,
    TwistStamped,
    Vector3,
)

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
