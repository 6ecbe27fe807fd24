"""``admittance_controller/AdmittanceController``.

Source: ros2_controllers, `admittance_controller` (version 6.9.0); the law itself is
`arm_drake.control.admittance`.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RotationMatrix

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.admittance import AdmittanceFrames, AdmittanceState
from arm_drake.controllers.admittance_inbox import (
    AdmittanceInbox,
    AdmittancePorts,
    receive,
    take_parameters,
)
from arm_drake.controllers.admittance_parameters import AdmittanceControllerParameters
from arm_drake.controllers.admittance_setup import (
    AdmittanceSetup,
    make_kinematics,
    make_setup,
)
from arm_drake.controllers.admittance_status import AdmittanceTick, make_status
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import CHAINED, INACTIVE
from arm_drake.messages import (
    NANOSECONDS,
    AdmittanceControllerState,
    JointTrajectoryPoint,
    Message,
    WrenchStamped,
)

# What a joint is commanded, in the order of rows of commands and references.
_COMMANDS = (interfaces.POSITION, interfaces.VELOCITY, interfaces.ACCELERATION)

_WRENCH = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")


class AdmittanceControllerSystemState(NamedTuple):
    """State of an AdmittanceController between two ticks."""

    inbox: AdmittanceInbox
    control: AdmittanceState

    # Positions, velocities and accelerations, shape (3, n) each: references, new at
    # every activation, and commands, NaN while it is inactive.
    references: Array
    commands: Array

    # What the last tick tells, if there was one.
    last: AdmittanceTick | None = None

    # Why it can't go on; empty if it can.
    fault: str = ""


class AdmittanceController(TickingController[AdmittanceControllerSystemState]):
    """Moves joints by their references, and lets an arm give way to what pushes it.

    .. pydrake_system::

        name: AdmittanceController
        input_ports:
        - controller_manager
        - state_interfaces
        - joint_references
        - wrench_reference
        - parameters
        output_ports:
        - command_interfaces
        - status
        - events

    With n = len(joints), vectors in their order:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    m     everything that is measured; it reads
                              ``state_interfaces`` of the joints, and
                              ``force.{x,y,z}`` [N] and ``torque.{x,y,z}`` [N·m] of
                              ``<ft_sensor.name>``
    joint_references    --    JointTrajectoryPoint: positions and velocities from now on
    wrench_reference    --    WrenchStamped in the sensor's frame: what is added to the
                              measured wrench from now on
    parameters          --    AdmittanceControllerParameters to go on with
    command_interfaces  --    Tick; its command has n values of each of
                              ``command_interfaces``, one after the other
    status              --    AdmittanceControllerState
    events              --    tuple of the latest (number, event), the newest last; an
                              event is a TopicRejected or a ParametersRejected
    ==================  ====  =========================================================

    Other controllers can command the references ``<name>/<joint>/position`` and
    ``/velocity``; the topic is ignored then. The state is an
    AdmittanceControllerSystemState. At every tick::

        command = reference + what the joints give way by

    see `AdmittanceRule.step`. The spring pulls the sensor's frame from where it is
    measured to where it would be at the references. A reference that is NaN is the last
    one, at first what is measured; that of the topic is taken once, when it comes. A
    measured wrench with a NaN is none; that of the topic stays over a deactivation.
    Positions that can't be read when it is activated make its first update fail; later
    the last commands stand for them.

    Unlike upstream's, frames may be any links, not those between base and tip alone;
    joints are told apart by their names, not by their order; and
    ``fixed_world_frame`` may be turned against the base in any way.
    """

    message_types: ClassVar[Mapping[str, type[Message]]] = {
        "joint_references": JointTrajectoryPoint,
        "wrench_reference": WrenchStamped,
    }

    def __init__(
        self,
        parameters: AdmittanceControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.

        Raises:
            ParameterError: If joints or links don't exist, or make no chain.
        """
        joints, name = parameters.joints, params.controller_name
        setup = make_setup(parameters, params.links)
        self._kinematics = make_kinematics(parameters, params)
        n = len(joints)
        self._nothing = np.full((3, n), np.nan)
        references = [
            c for c in _COMMANDS if c in parameters.chainable_command_interfaces
        ]
        sensor = parameters.ft_sensor.name
        super().__init__(
            params,
            AdmittanceControllerSystemState(
                AdmittanceInbox(setup, setup, np.zeros(6)),
                AdmittanceState.initial(n),
                self._nothing,
                self._nothing,
            ),
            state_interfaces=(
                *interfaces.interface_names(joints, parameters.state_interfaces),
                *(f"{sensor}/{part}" for part in _WRENCH),
            ),
            command_interfaces=interfaces.interface_names(
                parameters.command_joints or joints, parameters.command_interfaces
            ),
            reference_interfaces=tuple(
                f"{name}/{reference}"
                for reference in interfaces.interface_names(joints, references)
            ),
        )
        self._commanded = [_COMMANDS.index(c) for c in parameters.command_interfaces]
        self._referred = [_COMMANDS.index(c) for c in references]
        self._measured_rows = [_COMMANDS.index(c) for c in parameters.state_interfaces]
        nothing = AbstractValue.Make(())
        self._ports = AdmittancePorts(
            *(
                self.DeclareAbstractInputPort(port, nothing)
                for port in (*self.message_types, interfaces.PARAMETERS_PORT)
            )
        )
        self._declare_topic("status", self._describe)
        self._declare_topic("events", lambda state: state.inbox.events)

    def _update(
        self, now: Now, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        if state.fault:
            return state
        chained = self._read_references(now)
        obstacle = "" if chained is None else CHAINED
        inbox, asked = receive(now, self._ports, state.inbox, self.params, obstacle)
        if chained is not None:
            asked = self._nothing.copy()
            asked[self._referred] = chained.reshape(len(self._referred), -1)
        references = state.references
        if asked is not None:
            references = np.where(np.isfinite(asked), asked, references)
        measured, wrench = self._measure(now)
        q = measured[0] if np.isfinite(measured[0]).all() else state.commands[0]
        setup, period = inbox.setup, now.period_ns / NANOSECONDS
        frames, X_BR = self._find_frames(setup, q, references[0])
        control = setup.rule.step(state.control, frames, wrench + inbox.wrench, period)
        moved = (control.position, control.velocity, control.acceleration)
        commands = references + np.array(moved)
        fault = ""
        if not np.isfinite(commands).all():
            fault = (
                "it gives way beyond all bounds; mass is too small, or stiffness or "
                f"damping_ratio too large, for a period of {period:g} s"
            )
        last = AdmittanceTick(now.time_ns, setup, frames, control, X_BR)
        return AdmittanceControllerSystemState(
            inbox, control, references, commands, last, fault
        )

    def _measure(self, now: Now) -> tuple[Array, Array]:
        """Return the joints' state, shape (3, n), NaN where unknown, and the wrench."""
        values, measured = self._read(now.context), self._nothing.copy()
        measured[self._measured_rows] = values[:-6].reshape(
            len(self._measured_rows), -1
        )
        wrench = values[-6:]
        return measured, wrench if np.isfinite(wrench).all() else np.zeros(6)

    def _find_frames(
        self, setup: AdmittanceSetup, q: Array, q_ref: Array
    ) -> tuple[AdmittanceFrames, Array]:
        """Return how frames stand, and the sensor's at the references."""
        kinematics, sensor = self._kinematics, setup.sensor
        X_BR = kinematics.pose(q_ref, sensor)
        X_BS = kinematics.pose(q, sensor)
        links = dict.fromkeys((setup.control, setup.center, setup.world))
        R = {link: kinematics.pose(q, link)[:3, :3] for link in links}
        turn = RotationMatrix(X_BS[:3, :3] @ X_BR[:3, :3].T).ToAngleAxis()
        moved = X_BS[:3, 3] - X_BR[:3, 3]
        frames = AdmittanceFrames(
            R_BS=X_BS[:3, :3],
            R_BC=R[setup.control],
            R_BG=R[setup.center],
            R_BW=R[setup.world],
            displacement=np.append(moved, turn.angle() * turn.axis()),
            jacobian=kinematics.jacobian(q, sensor),
        )
        return frames, X_BR

    def _activate(
        self, now: Now, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        inbox = take_parameters(
            now, self._ports, state.inbox, self.params, is_running=False
        )
        measured, _ = self._measure(now)
        joints = inbox.setup.parameters.joints
        unread = [
            j for j, q in zip(joints, measured[0], strict=True) if not np.isfinite(q)
        ]
        fault = f"the position of joint {unread[0]!r} isn't known" if unread else ""
        # As upstream, it goes on with the velocity that it starts with.
        references = np.where(np.isfinite(measured), measured, 0.0)
        return state._replace(inbox=inbox, references=references, fault=fault)

    def _deactivate(
        self, now: Now, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        del now
        return state._replace(
            control=AdmittanceState.initial(self._nothing.shape[1]),
            commands=self._nothing,
        )

    def _idle(
        self, now: Now, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerSystemState:
        inbox, _ = receive(now, self._ports, state.inbox, self.params, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def _command(self, state: AdmittanceControllerSystemState) -> Array:
        return state.commands[self._commanded].ravel()

    def _is_ok(self, state: AdmittanceControllerSystemState) -> bool:
        return not state.fault

    def _fault(self, state: AdmittanceControllerSystemState) -> str:
        return state.fault

    def _describe(
        self, state: AdmittanceControllerSystemState
    ) -> AdmittanceControllerState:
        """Return the topic status."""
        if state.last is None:
            return AdmittanceControllerState()
        return make_status(state.last)
