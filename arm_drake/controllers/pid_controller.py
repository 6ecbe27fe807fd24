"""The ``pid_controller/PidController``: parameters, law and messages.

Source: ros2_controllers, `pid_controller` (version 6.9.0 and jazzy; defaults of jazzy,
and by rule those of other distros). n PIDs take measurements to references; both are of
one quantity, shape (n,), or of one and its rate, shape (2n,), all of the quantity
first. Upstream takes a message's values in the order in which they come, whatever their
names are; here the names count.
"""

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.arrays import Array, Mask
from arm_drake.control.pid import (
    EPSILON,
    Pid,
    PidGains,
    PidState,
    PlainPids,
    adapt_saturation,
)
from arm_drake.control.trajectory import shortest_angular_distance
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SilentTicks,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import (
    ALWAYS,
    CHAINED,
    Inbox,
    TopicController,
    check_change,
)
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_not_empty,
    check_unique,
    per_element_of,
)
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Message,
    MultiDOFCommand,
    MultiDOFState,
    MultiDOFStateStamped,
)
from arm_drake.messages.base import make_lazy


@dataclass(frozen=True)
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

    # Whether the PID's own state is published too; controller_state tells most of it.
    activate_state_publisher: Annotated[bool, Rule(only=False)] = False

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take what older versions have, and `saturation`."""
        PidGains.adapt(params)
        adapt_saturation(params)


@dataclass(frozen=True)
class PidControllerGains:
    """PIDs by degree of freedom."""

    dof: dict[str, DofGains] = per_element_of("dof_names")


@dataclass(frozen=True)
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
        for dof, gains in self.gains.dof.items():
            gains.check(f"gains.{dof}")


class PidControlState(NamedTuple):
    """Result of a tick; arrays are never changed. NaN is unknown."""

    pid: PidState

    # Shape (n,) or (2n,); errors are references minus measurements, angles wrapped.
    references: Array
    measured: Array
    error: Array

    # Commands, shape (n,); NaN where there is no reference or no measurement.
    command: Array

    # What the command interfaces hold then, shape (n,).
    output: Array


@dataclass(frozen=True, eq=False)
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
        error = self.find_error(references, measured)
        # The quickest way to see that all are finite.
        if not math.isfinite(sum(error.tolist())):
            return self._step_some(state, references, measured, error, dt)
        if has_rate and dt > EPSILON:
            pid = self.pid.step_finite(state.pid, error[:n], dt, error[n:])
        else:
            rate = error[n:] if has_rate else None
            pid = self.pid.step(state.pid, error[:n], dt, rate)
        command = self.add_feedforward(pid.command, references)
        return PidControlState(pid, references, measured, error, command, command)

    def find_error(self, references: Array, measured: Array) -> Array:
        """Return references minus measurements, angles wrapped."""
        error = references - measured
        if self.angle_wraparound is not None:
            n = len(self.save_i_term)
            with np.errstate(invalid="ignore"):
                turn = shortest_angular_distance(measured[:n], references[:n])
            np.copyto(error[:n], turn, where=self.angle_wraparound)
        return error

    def add_feedforward(self, command: Array, references: Array) -> Array:
        """Return what PIDs command, shape (n,), and what references add to it."""
        if self.feedforward_gain is None:
            return command
        source = references[len(command) :] if self.has_rate else references
        return command + self.feedforward_gain * source

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
        known = np.where(np.isfinite(references), references, 0.0)
        command = self.add_feedforward(pid.command, known)
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


class PidControllerState(NamedTuple):
    """State of a PidController between two ticks."""

    # Parameters in effect, and what was made of them.
    parameters: PidControllerParameters
    rules: PidControl

    control: PidControlState

    # Measurements of the topic, shape (n,) or (2n,); NaN before the first one.
    external: Array

    # References that have come since the last tick, if any have, likewise.
    requested: Array | None = None

    inbox: Inbox = Inbox()

    # Time of the last tick, and its period [ns]; None before the first one.
    time_ns: int | None = None
    period_ns: int = 0

    @property
    def command(self) -> Array:
        """Command, shape (n,)."""
        return self.control.command


class _SteadyPids(SilentTicks):
    """Ticks of PIDs that take measurements to the same finite references."""

    def __init__(
        self,
        last: PidControllerState,
        period_ns: int,
        measure: Callable[[PidControllerState, Array], Array],
    ) -> None:
        """Take what a tick has left; `measure` finds measurements in the motions."""
        self._last, self._period_ns, self._measure = last, period_ns, measure
        self._pids = PlainPids(last.rules.pid, period_ns / NANOSECONDS)

    def command(
        self, time_ns: int, motions: Array, memory: list[float]
    ) -> list[float] | None:
        """Return the values that a tick commands; None where one isn't finite."""
        rules, references = self._last.rules, self._last.control.references
        error = rules.find_error(references, self._measure(self._last, motions))
        errors, rates = error.tolist(), None
        if rules.has_rate:
            n = len(errors) // 2
            errors, rates = errors[:n], errors[n:]
        command = self._pids.step(memory, errors, rates)
        if command is None:
            return None
        if rules.feedforward_gain is not None:
            command = rules.add_feedforward(np.array(command), references).tolist()
        return command if math.isfinite(sum(command)) else None

    def state(
        self, time_ns: int, motions: Array, memory: Sequence[float]
    ) -> PidControllerState:
        """Return the state that a tick leaves behind."""
        last = self._last
        references, measured = last.control.references, self._measure(last, motions)
        pid = PidState(*np.split(np.array(memory), len(PidState._fields)))
        command = last.rules.add_feedforward(pid.command, references)
        error = last.rules.find_error(references, measured)
        control = PidControlState(pid, references, measured, error, command, command)
        return last._replace(
            control=control, time_ns=time_ns, period_ns=self._period_ns
        )


class PidController(TopicController[PidControllerState]):
    """Takes measurements to references with a PID for each degree of freedom.

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
    exported_state_interfaces  nm    measurements of the last tick; before the first
                                     one, those of now
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
    order in which they come. One that is NaN leaves the last one in effect. The service
    `set_feedforward_control` of humble and jazzy sets ``enable_feedforward``.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: PidControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self.num_remembered = len(PidState._fields) * len(parameters.dof_names)
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
            PidControllerState(parameters, rules, rules.initial(), self._unknown),
            state_interfaces=() if self._is_external else read,
            command_interfaces=interfaces.interface_names(
                parameters.dof_names, (parameters.command_interface,)
            ),
            reference_interfaces=own,
            exported_interfaces=own,
        )
        self._subscribe("reference", MultiDOFCommand, self._take_references)
        self._subscribe_parameters(self._take_parameters)
        if self._is_external:
            take = self._take_measurements
            self._subscribe("measured_state", MultiDOFCommand, take, despite=ALWAYS)
        self._declare_topic("controller_state", self._describe)
        self._declare_events()

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
        state = self._receive(now, state, "" if chained is None else CHAINED)
        references = state.control.references
        requested = state.requested if chained is None else chained
        if requested is not None:
            references = np.where(np.isnan(requested), references, requested)
        measured = state.external if self._is_external else self._measured_now(now)
        period = now.period_ns / NANOSECONDS
        return state._replace(
            control=state.rules.step(state.control, references, measured, period),
            requested=None,
            time_ns=now.time_ns,
            period_ns=now.period_ns,
        )

    def steady(
        self, last: UpdateResult[PidControllerState], time_ns: int
    ) -> SteadyTicks[PidControllerState] | None:
        """Return how it goes on with its references where all of them are finite."""
        period_ns, state = self.whole_period_ns, last.state
        is_plain = PlainPids.are_plain(state.rules.pid)
        if period_ns is None or state.time_ns != time_ns or not is_plain:
            return None
        if not math.isfinite(sum(state.control.references.tolist())):
            return None
        return _SteadyPids(state, period_ns, self._find_measured)

    def remember(self, state: PidControllerState) -> list[float]:
        """Return what PIDs remember."""
        return [number for field in state.control.pid for number in field.tolist()]

    def _find_measured(self, state: PidControllerState, motions: Array) -> Array:
        return state.external if self._is_external else motions[self._read_at]

    def _take_references(
        self, state: PidControllerState, message: MultiDOFCommand, time_ns: int
    ) -> tuple[PidControllerState, str]:
        if fault := find_fault(message, self._dofs):
            return state, fault
        values = sort_values(message, self._dofs, has_rate=self._has_rate)
        return state._replace(requested=values), ""

    def _take_measurements(
        self, state: PidControllerState, message: MultiDOFCommand, time_ns: int
    ) -> tuple[PidControllerState, str]:
        if fault := find_fault(message, self._dofs, takes_rates=self._has_rate):
            return state, fault
        values = sort_values(message, self._dofs, has_rate=self._has_rate)
        return state._replace(external=values), ""

    def _take_parameters(
        self, state: PidControllerState, new: object, obstacle: str
    ) -> PidControllerState:
        parameters = check_change(state.parameters, new, _READ_ONLY)
        rules = self._make_rules(parameters)
        return state._replace(parameters=parameters, rules=rules)

    def _activate(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        references = self._unknown
        if (
            state.parameters.set_current_state_as_first_setpoint
            and not self._is_external
        ):
            references = self._read(now.context)
        output = self._read_commands(now)
        control = state.rules.start(state.control, references, output)
        return state._replace(control=control, external=self._unknown)

    def _deactivate(
        self, now: UpdateContext, state: PidControllerState
    ) -> PidControllerState:
        nothing = self._unknown[: len(self._dofs)]
        return state._replace(control=state.control._replace(command=nothing))

    def _export_last(self, context: Context) -> Array:
        """Return what the last tick measured; before the first, what is measured.

        ROS 2 activates who commands it after it, so that one never sees it without a
        tick; here both may start in the same cycle.
        """
        state = self._state(context)
        if (
            state.time_ns is None
            and not self._is_external
            and self._read_at is not None
        ):
            return self._read(context)
        return self._export(state)

    def _export(self, state: PidControllerState) -> Array:
        return state.control.measured

    def _describe(self, state: PidControllerState) -> MultiDOFStateStamped:
        """Return the topic controller_state."""
        if state.time_ns is None:
            return MultiDOFStateStamped()
        return make_state(self._dofs, state.control, state.time_ns, state.period_ns)
