"""``pid_controller/PidController``.

Source: ros2_controllers, `pid_controller` (version 6.9.0 and jazzy); the tick itself is
`arm_drake.controllers.pid_control`.
"""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.dof_messages import find_fault, make_state, sort_values
from arm_drake.controllers.pid_control import PidControl, PidControlState
from arm_drake.controllers.pid_parameters import DofGains, PidControllerParameters
from arm_drake.controllers.topics import (
    CHAINED,
    INACTIVE,
    Events,
    Rejection,
    add_events,
    new_messages,
    new_parameters,
)
from arm_drake.messages import (
    NANOSECONDS,
    MultiDOFCommand,
    MultiDOFStateStamped,
    ParametersRejected,
    TopicRejected,
)

# Parameters that can't change while the controller runs.
_READ_ONLY = (
    "dof_names",
    "reference_and_state_dof_names",
    "command_interface",
    "reference_and_state_interfaces",
    "use_external_measured_states",
)


class Inbox(NamedTuple):
    """What came in on the ports of a PidController."""

    # Parameters in effect, and what was made of them.
    parameters: PidControllerParameters
    rules: PidControl

    # Measurements of the topic, shape (n,) or (2n,); NaN before the first one.
    external: Array

    # What was on the ports at the last tick.
    offered: object = ()
    references: tuple[MultiDOFCommand, ...] = ()
    measurements: tuple[MultiDOFCommand, ...] = ()

    # The latest of all that was not accepted.
    events: Events = ()


class PidControllerState(NamedTuple):
    """State of a PidController between two ticks."""

    inbox: Inbox
    control: PidControlState

    # Time of the last tick, and its period [ns]; None before the first one.
    time_ns: int | None = None
    period_ns: int = 0


class PidController(TickingController[PidControllerState]):
    """Takes measurements to references with a PID for each degree of freedom.

    .. pydrake_system::

        name: PidController
        input_ports:
        - controller_manager
        - state_interfaces
        - reference
        - parameters
        - measured_state
        output_ports:
        - command_interfaces
        - exported_state_interfaces
        - controller_state
        - events

    With n = len(dof_names), vectors in their order, and m = 1 or 2 interfaces:

    =========================  ====  ==================================================
    port                       size  meaning
    =========================  ====  ==================================================
    controller_manager         --    Cycle: when to tick
    state_interfaces           2J    positions and velocities of all J joints of the
                                     robot, or more
    reference                  --    MultiDOFCommand: references from now on
    parameters                 --    PidControllerParameters to go on with
    measured_state             --    MultiDOFCommand: measurements; there only with
                                     ``use_external_measured_states``
    command_interfaces         --    Tick; its command is (n,)
    exported_state_interfaces  nm    measurements of the last tick
    controller_state           --    MultiDOFStateStamped
    events                     --    tuple of the latest (number, event), the newest
                                     last; an event is a TopicRejected or a
                                     ParametersRejected
    =========================  ====  ==================================================

    Other controllers can command the references; the topic is ignored then. The state
    is a PidControllerState. At every tick, with reference r and measurement y, the
    rule of control_toolbox's PID and a feed-forward::

        command = pid(r - y, dr/dt - dy/dt) + feedforward_gain * (dr/dt if m = 2 else r)

    References are sorted by the names in the message, where upstream takes them in the
    order in which they come. One that is NaN leaves the last one in effect. Humble's
    service `set_feedforward_control` is the parameter ``enable_feedforward``.
    """

    def __init__(
        self,
        parameters: PidControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        names = parameters.reference_and_state_interfaces
        self._dofs = parameters.reference_and_state_dof_names or parameters.dof_names
        self._has_rate = len(names) == 2
        self._is_external = parameters.use_external_measured_states
        self._is_humble = params.distro == "humble"
        read = interfaces.interface_names(self._dofs, names)
        own = tuple(f"{params.controller_name}/{name}" for name in read)
        self._unknown = np.full(len(read), np.nan)
        rules = self._make_rules(parameters)
        super().__init__(
            params,
            PidControllerState(
                Inbox(parameters, rules, self._unknown), rules.initial()
            ),
            state_interfaces=() if self._is_external else read,
            command_interfaces=interfaces.interface_names(
                parameters.dof_names, (parameters.command_interface,)
            ),
            reference_interfaces=own,
            exported_interfaces=own,
        )
        nothing = AbstractValue.Make(())
        self._reference = self.DeclareAbstractInputPort("reference", nothing)
        self._parameters = self.DeclareAbstractInputPort(
            interfaces.PARAMETERS_PORT, nothing
        )
        if self._is_external:
            self._external = self.DeclareAbstractInputPort("measured_state", nothing)
        self._declare_topic("controller_state", self._describe)
        self._declare_topic("events", lambda state: state.inbox.events)

    def _make_rules(self, parameters: PidControllerParameters) -> PidControl:
        by_dof = parameters.gains.dof
        return PidControl.from_gains(
            [by_dof.get(dof, DofGains()) for dof in parameters.dof_names],
            has_rate=self._has_rate,
            enable_feedforward=parameters.enable_feedforward,
            is_humble=self._is_humble,
        )

    def _update(self, now: Now, state: PidControllerState) -> PidControllerState:
        chained = self._read_references(now)
        obstacle = "" if chained is None else CHAINED
        inbox, asked = self._receive(now, state.inbox, obstacle)
        references = state.control.references
        if chained is not None:
            asked = chained
        if asked is not None:
            references = np.where(np.isnan(asked), references, asked)
        measured = inbox.external if self._is_external else self._read(now.context)
        period = now.period_ns / NANOSECONDS
        control = inbox.rules.step(state.control, references, measured, period)
        return PidControllerState(inbox, control, now.time_ns, now.period_ns)

    def _receive(
        self, now: Now, inbox: Inbox, obstacle: str = ""
    ) -> tuple[Inbox, Array | None]:
        """Return what has come in, and the references to take, NaN where none.

        Args:
            now: The time, and where the inputs are read.
            inbox: What had come in at the last tick.
            obstacle: Why no references of the topic are taken; empty if they are.
        """
        context = now.context
        news: list[Rejection] = []
        parameters, rules = inbox.parameters, inbox.rules
        offered = new_parameters(self._parameters, context, inbox.offered)
        if offered is not inbox.offered and offered != ():
            try:
                parameters, rules = self._accept(offered, parameters)
            except ValueError as error:
                news.append(ParametersRejected(str(error)))
        new, references = new_messages(
            self._reference, context, MultiDOFCommand, inbox.references
        )
        asked = self._take(new, news, obstacle) if new else None
        external, measurements = inbox.external, inbox.measurements
        if self._is_external:
            new, measurements = new_messages(
                self._external, context, MultiDOFCommand, measurements
            )
            measured = self._take(new, news, takes_rates=self._has_rate)
            external = external if measured is None else measured
        if (
            offered is inbox.offered
            and references is inbox.references
            and measurements is inbox.measurements
        ):
            return inbox, None
        events = add_events(inbox.events, news)
        inbox = Inbox(
            parameters, rules, external, offered, references, measurements, events
        )
        return inbox, asked

    def _take(
        self,
        messages: tuple[MultiDOFCommand, ...],
        news: list[Rejection],
        obstacle: str = "",
        *,
        takes_rates: bool = True,
    ) -> Array | None:
        """Return the values of the last message that can be taken, shape (nm,)."""
        taken = None
        for message in messages:
            fault = obstacle or find_fault(message, self._dofs, takes_rates=takes_rates)
            if fault:
                news.append(TopicRejected(message, fault))
            else:
                taken = sort_values(message, self._dofs, has_rate=self._has_rate)
        return taken

    def _accept(
        self, offered: object, present: PidControllerParameters
    ) -> tuple[PidControllerParameters, PidControl]:
        """Return new parameters and their rules; raise ValueError for bad ones."""
        if not isinstance(offered, PidControllerParameters):
            raise ValueError(f"expected PidControllerParameters, got {offered!r}")
        for name in _READ_ONLY:
            if getattr(offered, name) != getattr(present, name):
                raise ValueError(f"{name} can't change while the controller runs")
        return offered, self._make_rules(offered)

    def _activate(self, now: Now, state: PidControllerState) -> PidControllerState:
        inbox, references = state.inbox._replace(external=self._unknown), self._unknown
        if (
            inbox.parameters.set_current_state_as_first_setpoint
            and not self._is_external
        ):
            references = self._read(now.context)
        output = self._read_commands(now)
        control = inbox.rules.start(state.control, references, output)
        return state._replace(inbox=inbox, control=control)

    def _deactivate(self, now: Now, state: PidControllerState) -> PidControllerState:
        del now
        nothing = self._unknown[: len(self._dofs)]
        return state._replace(control=state.control._replace(command=nothing))

    def _idle(self, now: Now, state: PidControllerState) -> PidControllerState:
        inbox, _ = self._receive(now, state.inbox, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def rests(self, state: PidControllerState) -> bool:
        """Return whether only a message can change the state while inactive."""
        del state
        return True

    def _command(self, state: PidControllerState) -> Array:
        return state.control.command

    def _export(self, state: PidControllerState) -> Array:
        return state.control.measured

    def _describe(self, state: PidControllerState) -> MultiDOFStateStamped:
        """Return the topic controller_state."""
        if state.time_ns is None:
            return MultiDOFStateStamped()
        return make_state(self._dofs, state.control, state.time_ns, state.period_ns)
