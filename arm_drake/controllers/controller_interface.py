"""What all controllers share: ticks, a life cycle, all state in the Context.

In a cycle a ros2_control manager reads, updates and writes in one instant. Drake's
events of one instant all see the old state, so what a tick computes is an output port
of its own, `tick`: a cached function of the old state, the inputs and the time. The
manager takes the commands there, and a controller further down a chain its references;
an unrestricted update then stores it. Off the cycles `tick` is what was stored.
"""

import dataclasses as dc
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.messages import NANOSECONDS, Message

Array = NDArray[np.float64]
S = TypeVar("S")
M = TypeVar("M", bound=Message)

# Part of a period by which an event may miss its time.
_TOLERANCE = 1e-6

_NO_COMMAND: Array = np.empty(0)


@dc.dataclass(frozen=True)
class ControllerInterfaceParams:
    """What a controller is given besides its parameters."""

    controller_name: str

    # Rate of its ticks [Hz].
    update_rate: int

    # Period of its events in Drake's time [s]: the manager's, or 1 / update_rate.
    period: float

    # URDF type of every movable joint of the robot.
    joint_types: Mapping[str, str]

    # What the hardware has, such as "joint1/position".
    command_interfaces: frozenset[str]
    state_interfaces: frozenset[str]

    # Order of the vector of all measured quantities.
    measured: tuple[str, ...]

    # Distribution whose behaviour holds.
    distro: str = "jazzy"

    # URDF velocity limit of joints [rad/s] or [m/s]; others have none.
    velocity_limits: Mapping[str, float] = dc.field(default_factory=dict)


class Cycle(NamedTuple):
    """What the manager tells its controllers in a cycle."""

    # Number of the cycle, its time, and the time since the last one [ns].
    number: int
    time_ns: int
    period_ns: int

    # Active controllers, and the number of their activation.
    active: Mapping[str, int]

    # Those whose references are commanded by another controller.
    chained: frozenset[str] = frozenset()

    # Time since the last tick of controllers with a rate of their own [ns]; 0 if they
    # don't tick in this cycle.
    periods: Mapping[str, int] = {}

    # Values of the command interfaces if a switch has changed them, shape (k,).
    commands: Array | None = None

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class Tick(NamedTuple, Generic[S]):
    """What a tick of a controller leaves behind."""

    # Number of the cycle; None before the first one.
    number: int | None

    # Number of the activation; None if the controller is inactive.
    activation: int | None

    # State of the controller.
    state: S

    # Values of its command interfaces, shape (k,); NaN is left as it is.
    command: Array

    # Whether the tick went well; a controller that fails is deactivated.
    is_ok: bool = True

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class Now(NamedTuple):
    """When and where a tick happens."""

    # Where inputs are read.
    context: Context

    time_ns: int

    # Time since the last tick [ns].
    period_ns: int

    cycle: Cycle


def messages_on(port: InputPort, context: Context, expected: type[M]) -> tuple[M, ...]:
    """Return the messages on an abstract port: one, a tuple of them, or nothing.

    Args:
        port: The port.
        context: Context of its system.
        expected: Type of the messages.

    Raises:
        TypeError: If something else is there.
    """
    if not port.HasValue(context):
        return ()
    value = port.Eval(context)
    messages = value if isinstance(value, tuple) else (value,)
    for message in messages:
        if not isinstance(message, expected):
            raise TypeError(
                f"{port.get_system().get_name()}.{port.get_name()}: expected a "
                f"{expected.__name__}, got {message!r}"
            )
    return messages


class ControllerInterface(LeafSystem):
    """Base of all controllers: what they read, what they claim.

    A controller that reads no efforts is given none: its port ends after the
    velocities. Efforts take the servo's whole computation. A controller without an
    update of its own, `is_sampled`, is given everything, held from tick to tick.
    """

    is_sampled = False

    def __init__(
        self,
        params: ControllerInterfaceParams,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
    ) -> None:
        """Create the system with the input ports that all controllers have.

        Args:
            params: Rate and surroundings of the controller.
            state_interfaces: What it reads, such as "joint1/position".
            command_interfaces: What it claims; another controller's references too.
            reference_interfaces: What other controllers may command of it, with its
                own name in front: "pid/joint1/position".
            exported_interfaces: What other controllers may read of it, likewise.
        """
        super().__init__()
        self.set_name(params.controller_name)
        self.params = params
        self.state_interfaces = state_interfaces
        self.command_interfaces = command_interfaces
        self.reference_interfaces = reference_interfaces
        self.exported_interfaces = exported_interfaces
        motions = interfaces.STATE_INTERFACES[:2]
        self.reads_all = self.is_sampled or any(
            name.rpartition("/")[2] not in motions for name in state_interfaces
        )
        num_measured = len(params.measured)
        if not self.reads_all:
            num_measured = 2 * len(params.joint_types)
        self._manager = self.DeclareAbstractInputPort(
            interfaces.MANAGER_PORT, AbstractValue.Make(())
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        self._read_at = _positions(state_interfaces, params.measured)
        # Ports of controllers that export state interfaces, and where these go.
        self._exporters: list[tuple[InputPort, list[int], list[int]]] = []

    def add_exporter(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of a controller some of whose state this one reads.

        Args:
            controller: One whose exported interfaces are among the state interfaces.
        """
        names = controller.exported_interfaces
        here = [i for i, name in enumerate(self.state_interfaces) if name in names]
        there = [names.index(self.state_interfaces[i]) for i in here]
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareVectorInputPort(name, len(names))
        self._exporters.append((port, here, there))
        return port

    def _read(self, context: Context) -> Array:
        """Return the measured `state_interfaces`."""
        if not self._exporters:
            return self._measured.Eval(context)[self._read_at]
        order, measured = self.params.measured, self._measured.Eval(context)
        values = np.full(len(self.state_interfaces), np.nan)
        for i, name in enumerate(self.state_interfaces):
            if name in order:
                values[i] = measured[order.index(name)]
        for port, here, there in self._exporters:
            values[here] = port.Eval(context)[there]
        return values

    def _is_active(self, context: Context) -> bool:
        """Return whether the controller is active, as of the last cycle or this one."""
        if not self._manager.HasValue(context):
            return True
        cycle: Cycle = self._manager.Eval(context)
        return self.params.controller_name in cycle.active

    def _tick_time(self, number: int) -> int:
        """Return the time of a tick [ns]."""
        return number * NANOSECONDS // self.params.update_rate


class TickingController(ControllerInterface, Generic[S]):
    """Base of controllers with an immutable state of type S, renewed at every tick.

    A subclass implements `_update`, and what else it needs of `_activate`,
    `_deactivate`, `_idle`, `_command` and `_is_ok`. It declares its further ports;
    outputs depend on `xa_ticket()` alone and show what the last tick left behind.
    Without a manager on its port a controller is always active.
    """

    def __init__(
        self,
        params: ControllerInterfaceParams,
        initial: S,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
    ) -> None:
        """Create the system with its state, its tick and its interfaces.

        Args:
            params: Rate and surroundings of the controller.
            initial: State before the first tick.
            state_interfaces: As in ControllerInterface.
            command_interfaces: As in ControllerInterface.
            reference_interfaces: As in ControllerInterface.
            exported_interfaces: As in ControllerInterface.
        """
        super().__init__(
            params,
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
            reference_interfaces=reference_interfaces,
            exported_interfaces=exported_interfaces,
        )
        k = len(command_interfaces)
        # What is active where there is no manager.
        self._always_active = {params.controller_name: 1}
        # Values of all command interfaces, and where those of this one stand there.
        self._values: InputPort | None = None
        self._values_at: list[tuple[int, int]] = []
        # Of each controller that may command references: its port, and where its
        # commands stand among them.
        self._predecessors: list[tuple[str, InputPort, list[int], list[int]]] = []
        self._no_references = np.full(len(reference_interfaces), np.nan)
        # An immutable Python object goes into the Context as it is. Drake takes a plain
        # number quicker than its own kind of index.
        first: Tick[S] = Tick(None, None, initial, np.full(k, np.nan))
        self._ticks = int(self.DeclareAbstractState(AbstractValue.Make(first)))
        self._tick_port = self.DeclareAbstractOutputPort(
            interfaces.COMMAND_PORT, lambda: AbstractValue.Make(()), self._calc_tick
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            params.period, 0.0, self._update_state
        )
        if exported_interfaces:
            self.DeclareVectorOutputPort(
                interfaces.EXPORT_PORT,
                len(exported_interfaces),
                lambda context, output: output.SetFromVector(
                    self._export(self._state(context))
                ),
                prerequisites_of_calc={self.xa_ticket()},
            )

    def add_command_values(self, order: Sequence[str]) -> InputPort:
        """Declare the port of what all command interfaces hold.

        Args:
            order: Their names, in the order of the port.
        """
        at = {name: index for index, name in enumerate(order)}
        self._values = self.DeclareVectorInputPort(interfaces.VALUES_PORT, len(order))
        self._values_at = [
            (i, at[n]) for i, n in enumerate(self.command_interfaces) if n in at
        ]
        return self._values

    def add_predecessor(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of a controller that commands references of this one.

        Args:
            controller: One whose command interfaces are among the references.
        """
        names = controller.command_interfaces
        here = [i for i, ref in enumerate(self.reference_interfaces) if ref in names]
        there = [names.index(self.reference_interfaces[i]) for i in here]
        name = controller.params.controller_name
        port = self.DeclareAbstractInputPort(
            f"{interfaces.CHAIN_PORT}{name}", AbstractValue.Make(())
        )
        self._predecessors.append((name, port, here, there))
        return port

    @abstractmethod
    def _update(self, now: Now, state: S) -> S:
        """Return the state after a tick.

        Args:
            now: The time, and where the inputs are read.
            state: State after the last tick.
        """

    def _activate(self, now: Now, state: S) -> S:
        """Return the state at the start of an activation, before its first tick."""
        del now
        return state

    def _deactivate(self, now: Now, state: S) -> S:
        """Return the state at the end of an activation."""
        del now
        return state

    def _idle(self, now: Now, state: S) -> S:
        """Return the state after a cycle in which the controller is inactive."""
        del now
        return state

    def _command(self, state: S) -> Array:
        """Return the commands of a state, shape (k,); NaN leaves one as it is."""
        del state
        return _NO_COMMAND

    def _export(self, state: S) -> Array:
        """Return the exported state interfaces of a state; a tick old for readers."""
        del state
        return np.full(len(self.exported_interfaces), np.nan)

    def _is_ok(self, state: S) -> bool:
        """Return whether the last tick went well."""
        del state
        return True

    def _state(self, context: Context) -> S:
        """Return the state that the last tick left."""
        tick: Tick[S] = context.get_abstract_state(self._ticks).get_value()
        return tick.state

    def _read_commands(self, now: Now) -> Array:
        """Return the present values of the command interfaces, shape (k,).

        NaN is what was never written. References of other controllers are what was
        written to them last.
        """
        context = now.context
        values = np.array(context.get_abstract_state(self._ticks).get_value().command)
        if self._values is not None:
            present = now.cycle.commands
            if present is None:
                present = self._values.Eval(context)
            for i, at in self._values_at:
                values[i] = present[at]
        return values

    def _read_references(self, now: Now) -> Array | None:
        """Return what other controllers command, NaN where none does; None if none.

        Shape (number of reference_interfaces,).
        """
        if self.params.controller_name not in now.cycle.chained:
            return None
        references = self._no_references.copy()
        for name, port, here, there in self._predecessors:
            if name in now.cycle.active:
                references[here] = port.Eval(now.context).command[there]
        return references

    def _declare_topic(
        self, name: str, calc: Callable[[S], Any], *, default: Any = ()
    ) -> OutputPort:
        """Declare an abstract output port that shows something of the state."""

        def calc_output(context: Context, output: AbstractValue) -> None:
            output.set_value(calc(self._state(context)))

        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(default),
            calc_output,
            prerequisites_of_calc={self.xa_ticket()},
        )

    def _calc_tick(self, context: Context, output: AbstractValue) -> None:
        held: Tick[S] = context.get_abstract_state(self._ticks).get_value()
        if self._manager.HasValue(context):
            cycle: Cycle = self._manager.Eval(context)
        else:
            cycle = self._own_cycle(context, held)
        if cycle.number != held.number:
            held = self._run(context, held, cycle)
        output.set_value(held)

    def _run(self, context: Context, held: Tick[S], cycle: Cycle) -> Tick[S]:
        """Return what a cycle leaves behind."""
        name = self.params.controller_name
        period_ns = cycle.period_ns
        if cycle.periods:
            period_ns = cycle.periods.get(name, period_ns)
        now = Now(context, cycle.time_ns, period_ns, cycle)
        activation = cycle.active.get(name)
        state, command, is_ok = held.state, held.command, True
        ending: Array | None = None
        if activation != held.activation:
            if held.activation is not None:
                state = self._deactivate(now, state)
                command = ending = self._command(state)
            if activation is not None:
                state = self._activate(now, state)
        if activation is None:
            state = self._idle(now, state)
        elif period_ns:
            state = self._update(now, state)
            command, is_ok = self._command(state), self._is_ok(state)
            if not is_ok:
                state, activation = self._deactivate(now, state), None
                command = self._command(state)
        if ending is not None:  # What a restart leaves unwritten ends.
            command = np.where(np.isnan(command), ending, command)
        return Tick(cycle.number, activation, state, command, is_ok)

    def _own_cycle(self, context: Context, held: Tick[S]) -> Cycle:
        """Return a cycle of a controller that has no manager."""
        ticks = context.get_time() / self.params.period
        number = round(ticks)
        if abs(ticks - number) > _TOLERANCE:
            number = -1 if held.number is None else held.number
        time_ns = self._tick_time(number)
        period_ns = time_ns - self._tick_time(number - 1)
        return Cycle(number, time_ns, period_ns, self._always_active)

    def _update_state(self, context: Context, state: State) -> None:
        tick = self._tick_port.Eval(context)
        state.get_mutable_abstract_state(self._ticks).set_value(tick)


def _positions(names: Sequence[str], order: Sequence[str]) -> slice | list[int]:
    """Return where names stand in a vector; as a slice if they are in a row."""
    try:
        at = [order.index(name) for name in names]
    except ValueError:
        # The manager says so before such a controller starts.
        return []
    if at and at == list(range(at[0], at[0] + len(at))):
        return slice(at[0], at[0] + len(at))
    return at
