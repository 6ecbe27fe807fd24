"""The ``pid_controller/PidController``: parameters, law and messages.

Source: ros2_controllers, `pid_controller` (version 6.9.0 and jazzy; defaults of jazzy,
and by rule those of other distros). n PIDs take measurements to references; both are of
one quantity, shape (n,), or of one and its rate, shape (2n,), all of the quantity
first. Upstream takes a message's values in the order in which they come, whatever their
names are; here the names count.
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.pid import EPSILON, Pid, PidGains, PidState, adapt_saturation
from arm_drake.control.trajectory import shortest_angular_distance
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.topics import (
    CHAINED,
    INACTIVE,
    Events,
    Rejection,
    add_events,
    new_messages,
    new_parameters,
)
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_not_empty,
    check_unique,
    per_element_of,
)
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Message,
    MultiDOFCommand,
    MultiDOFState,
    MultiDOFStateStamped,
    ParametersRejected,
    TopicRejected,
)
from arm_drake.messages.base import make_lazy


@dc.dataclass(frozen=True)
class DofGains(PidGains):
    """PID of one degree of freedom."""

    # Errors up to this are not integrated.
    error_deadband: Annotated[float, Rule(since="jazzy")] = 1e-16

    # How much of the reference, or of its rate, is added to the output.
    feedforward_gain: float = 0.0

    # Whether errors are angles, which wrap.
    angle_wraparound: bool = False

    # Whether the integral term stays over a deactivation.
    save_i_term: bool = True

    # Whether the PID's own state is published; without effect, see controller_state.
    activate_state_publisher: bool = False

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take what older versions have, and `saturation`."""
        PidGains.adapt(params)
        adapt_saturation(params)


@dc.dataclass(frozen=True)
class PidControllerGains:
    """PIDs by degree of freedom."""

    dof: dict[str, DofGains] = per_element_of("dof_names")


@dc.dataclass(frozen=True)
class PidControllerParameters:
    """Parameters of a PidController."""

    # Joints, or other prefixes, to command; at least one, each once.
    dof_names: tuple[str, ...]

    # Interface to claim on each.
    command_interface: str

    # One interface of references and measurements, or two, the second its rate.
    reference_and_state_interfaces: tuple[str, ...]

    # Prefixes of references and measurements, as many, each once; () is dof_names.
    reference_and_state_dof_names: tuple[str, ...] = ()

    # Whether the first reference is what is measured at the start.
    set_current_state_as_first_setpoint: bool = True

    # Whether measurements come from a topic.
    use_external_measured_states: bool = False

    # Whether feedforward_gain acts; later it always does.
    enable_feedforward: Annotated[
        bool,
        Rule(
            kilted=True, rolling=True, until="jazzy", instead="feedforward_gain decides"
        ),
    ] = False

    gains: PidControllerGains = PidControllerGains()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(
            self, "dof_names", "command_interface", "reference_and_state_interfaces"
        )
        check_unique(self, "dof_names", "reference_and_state_dof_names")
        if len(self.reference_and_state_interfaces) > 2:
            raise ValueError(
                f"reference_and_state_interfaces must have 1 or 2 elements, "
                f"got {list(self.reference_and_state_interfaces)}"
            )
        if len(self.reference_and_state_dof_names) not in (0, len(self.dof_names)):
            raise ValueError(
                f"reference_and_state_dof_names must be as many as dof_names, "
                f"got {list(self.reference_and_state_dof_names)}"
            )
        for gains in self.gains.dof.values():
            gains.check()


Mask = NDArray[np.bool_]


class PidControlState(NamedTuple):
    """What a tick leaves behind; arrays that nobody changes. NaN is unknown."""

    pid: PidState

    # Shape (n,) or (2n,); errors are references minus measurements, angles wrapped.
    references: Array
    measured: Array
    error: Array

    # Commands, shape (n,); NaN where there is no reference or no measurement.
    command: Array

    # What the command interfaces hold then, shape (n,).
    output: Array


@dc.dataclass(frozen=True, eq=False)
class PidControl(Message):
    """The rules of n degrees of freedom, made by `from_gains`."""

    pid: Pid

    # How much of the references is added to the commands, of their rates if there are
    # any; shape (n,), None if nothing is.
    feedforward_gain: Array | None

    # Which errors are angles, which wrap, shape (n,); None if none is.
    angle_wraparound: Mask | None

    # Which integral terms stay over a deactivation, shape (n,).
    save_i_term: Mask

    # Whether there are rates, too.
    has_rate: bool

    @classmethod
    def from_gains(
        cls,
        gains: Sequence[Any],
        *,
        has_rate: bool,
        enable_feedforward: bool = True,
        is_humble: bool = False,
    ) -> Self:
        """Return the rules of degrees of freedom with these gains."""
        feedforward = np.array([one.feedforward_gain for one in gains], dtype=float)
        wraps = np.array([one.angle_wraparound for one in gains], dtype=bool)
        return cls(
            pid=Pid.from_gains(gains, is_humble=is_humble),
            feedforward_gain=(
                feedforward if enable_feedforward and feedforward.any() else None
            ),
            angle_wraparound=wraps if wraps.any() else None,
            save_i_term=np.array([one.save_i_term for one in gains], dtype=bool),
            has_rate=has_rate,
        )

    def initial(self) -> PidControlState:
        """Return the state before the first activation."""
        n = len(self.save_i_term)
        unknown, nothing = np.full(n * (1 + self.has_rate), np.nan), np.full(n, np.nan)
        pid = self.pid.initial()
        return PidControlState(pid, unknown, unknown, unknown, nothing, nothing)

    def start(
        self, state: PidControlState, references: Array, output: Array
    ) -> PidControlState:
        """Return the state at the start of an activation.

        `references`, `output` shape (n,).
        """
        pid = self.pid.reset(state.pid, self.save_i_term)
        return state._replace(pid=pid, references=references, output=output)

    def step(
        self, state: PidControlState, references: Array, measured: Array, dt: float
    ) -> PidControlState:
        """Return the state after a tick; it holds the commands.

        Where reference or measurement isn't finite, there is no command. Where only
        their rates aren't, the difference to the last error is the error's rate.

        `dt` [s].
        """
        n, has_rate = len(self.save_i_term), self.has_rate
        error = references - measured
        if self.angle_wraparound is not None:
            with np.errstate(invalid="ignore"):
                turn = shortest_angular_distance(measured[:n], references[:n])
            np.copyto(error[:n], turn, where=self.angle_wraparound)
        # The quickest way to see that all are finite.
        if not math.isfinite(sum(error.tolist())):
            return self._step_some(state, references, measured, error, dt)
        if has_rate and dt > EPSILON:
            pid = self.pid.step_finite(state.pid, error[:n], dt, error[n:])
        else:
            rate = error[n:] if has_rate else None
            pid = self.pid.step(state.pid, error[:n], dt, rate)
        command = pid.command
        if self.feedforward_gain is not None:
            source = references[n:] if has_rate else references
            command = command + self.feedforward_gain * source
        return PidControlState(pid, references, measured, error, command, command)

    def _step_some(
        self,
        state: PidControlState,
        references: Array,
        measured: Array,
        error: Array,
        dt: float,
    ) -> PidControlState:
        """Do a step where some references or measurements aren't finite."""
        n = len(self.save_i_term)
        is_known = np.isfinite(references[:n]) & np.isfinite(measured[:n])
        has_rate = np.zeros(n, dtype=bool)
        if self.has_rate:
            has_rate = is_known & np.isfinite(error[n:])
        pid = state.pid
        for steps, rate in ((has_rate, error[n:]), (is_known & ~has_rate, None)):
            if steps.any():
                pid = self.pid.step(pid, error[:n], dt, rate, where=steps)
        command = pid.command
        if self.feedforward_gain is not None:
            source = references[n:] if self.has_rate else references
            known = np.where(np.isfinite(source), source, 0.0)
            command = command + self.feedforward_gain * known
        command = np.where(is_known, command, np.nan)
        output = np.where(is_known, command, state.output)
        return PidControlState(pid, references, measured, error, command, output)


def find_fault(
    message: MultiDOFCommand, dofs: Sequence[str], *, takes_rates: bool = True
) -> str | None:
    """Return why a message can't be taken, or None if it can."""
    n, names = len(dofs), message.dof_names
    expected = ", ".join(dofs)
    if names and sorted(names) != sorted(dofs):
        return f"dof_names must be {expected}, got {', '.join(names)}"
    if len(message.values) != n:
        return f"values must have {n} elements ({expected}), got {len(message.values)}"
    if len(message.values_dot) not in (0, n):
        got = len(message.values_dot)
        return f"values_dot must have {n} elements ({expected}) or none, got {got}"
    if message.values_dot and not takes_rates:
        return "values_dot needs a second one of reference_and_state_interfaces"
    return None


def sort_values(
    message: MultiDOFCommand, dofs: Sequence[str], *, has_rate: bool
) -> Array:
    """Return the values of a message in our order, shape (n,); NaN is none.

    `has_rate` shape (2n,).
    """
    names = message.dof_names or tuple(dofs)
    order = [names.index(dof) for dof in dofs]
    values = np.array(message.values)[order]
    if not has_rate:
        return values
    rates = np.full(len(values), np.nan)
    if message.values_dot:
        rates = np.where(np.isnan(values), np.nan, np.array(message.values_dot)[order])
    return np.concatenate([values, rates])


def make_state(
    dofs: Sequence[str], state: PidControlState, time_ns: int, period_ns: int
) -> MultiDOFStateStamped:
    """Return the topic controller_state; rates that there aren't are 0.

    It is made when a field is asked for.
    """
    return make_lazy(
        MultiDOFStateStamped, lambda: _make_state(dofs, state, time_ns, period_ns)
    )


def _make_state(
    dofs: Sequence[str], state: PidControlState, time_ns: int, period_ns: int
) -> MultiDOFStateStamped:
    n = len(dofs)
    measured, error = state.measured.tolist(), state.error.tolist()
    zeros = [0.0] * n
    columns = zip(
        dofs,
        state.references[:n].tolist(),
        measured[:n],
        measured[n:] or zeros,
        error[:n],
        error[n:] or zeros,
        [period_ns / NANOSECONDS] * n,
        state.output.tolist(),
        strict=True,
    )
    states = tuple(MultiDOFState(*row) for row in columns)
    return MultiDOFStateStamped(Header.from_nanoseconds(time_ns), states)


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
    received_parameters: object = ()
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
    command_interfaces         --    UpdateResult; command (n,)
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
        """Create the system."""
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

    def _update(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        chained = self._read_references(now)
        obstacle = "" if chained is None else CHAINED
        inbox, requested = self._receive(now, state.inbox, obstacle)
        references = state.control.references
        if chained is not None:
            requested = chained
        if requested is not None:
            references = np.where(np.isnan(requested), references, requested)
        measured = inbox.external if self._is_external else self._read(now.context)
        period = now.period_ns / NANOSECONDS
        control = inbox.rules.step(state.control, references, measured, period)
        return PidControllerState(inbox, control, now.time_ns, now.period_ns)

    def _receive(
        self, now: UpdateContext, inbox: Inbox, obstacle: str = ""
    ) -> tuple[Inbox, Array | None]:
        """Return what has come in, and the references to take, NaN where none."""
        context = now.context
        rejections: list[Rejection] = []
        parameters, rules = inbox.parameters, inbox.rules
        received_parameters = new_parameters(
            self._parameters, context, inbox.received_parameters
        )
        if (
            received_parameters is not inbox.received_parameters
            and received_parameters != ()
        ):
            try:
                parameters, rules = self._accept(received_parameters, parameters)
            except ValueError as error:
                rejections.append(ParametersRejected(str(error)))
        new, references = new_messages(
            self._reference, context, MultiDOFCommand, inbox.references
        )
        requested = self._take(new, rejections, obstacle) if new else None
        external, measurements = inbox.external, inbox.measurements
        if self._is_external:
            new, measurements = new_messages(
                self._external, context, MultiDOFCommand, measurements
            )
            measured = self._take(new, rejections, takes_rates=self._has_rate)
            external = external if measured is None else measured
        if (
            received_parameters is inbox.received_parameters
            and references is inbox.references
            and measurements is inbox.measurements
        ):
            return inbox, None
        events = add_events(inbox.events, rejections)
        inbox = Inbox(
            parameters,
            rules,
            external,
            received_parameters,
            references,
            measurements,
            events,
        )
        return inbox, requested

    def _take(
        self,
        messages: tuple[MultiDOFCommand, ...],
        rejections: list[Rejection],
        obstacle: str = "",
        *,
        takes_rates: bool = True,
    ) -> Array | None:
        """Return the values of the last message that can be taken, shape (nm,)."""
        taken = None
        for message in messages:
            fault = obstacle or find_fault(message, self._dofs, takes_rates=takes_rates)
            if fault:
                rejections.append(TopicRejected(message, fault))
            else:
                taken = sort_values(message, self._dofs, has_rate=self._has_rate)
        return taken

    def _accept(
        self, received_parameters: object, present: PidControllerParameters
    ) -> tuple[PidControllerParameters, PidControl]:
        """Return new parameters and their rules; raise ValueError for bad ones."""
        if not isinstance(received_parameters, PidControllerParameters):
            raise ValueError(
                f"expected PidControllerParameters, got {received_parameters!r}"
            )
        for name in _READ_ONLY:
            if getattr(received_parameters, name) != getattr(present, name):
                raise ValueError(f"{name} can't change while the controller runs")
        return received_parameters, self._make_rules(received_parameters)

    def _activate(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        inbox, references = state.inbox._replace(external=self._unknown), self._unknown
        if (
            inbox.parameters.set_current_state_as_first_setpoint
            and not self._is_external
        ):
            references = self._read(now.context)
        output = self._read_commands(now)
        control = inbox.rules.start(state.control, references, output)
        return state._replace(inbox=inbox, control=control)

    def _deactivate(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        nothing = self._unknown[: len(self._dofs)]
        return state._replace(control=state.control._replace(command=nothing))

    def _idle(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        inbox, _ = self._receive(now, state.inbox, INACTIVE)
        return state if inbox is state.inbox else state._replace(inbox=inbox)

    def rests(self, state: PidControllerState) -> bool:
        """Return whether only a message can change the state while inactive."""
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
