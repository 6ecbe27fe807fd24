"""Base classes of all controllers: ticks, a life cycle, all state in the Context.

In a cycle a ros2_control manager reads, updates and writes in one instant. Drake's
events of one instant all see the old state, so what a tick computes is an output port,
`tick`: a cached function of old state, inputs and time. The manager takes the commands
there, and a controller down a chain its references; its unrestricted update then stores
it, for every update and every state has its price in Drake. Off the cycles `tick` is
what was stored. A controller without a manager stores it itself.
"""

import dataclasses as dc
import inspect
import textwrap
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.admittance import ChainKinematics
from arm_drake.controllers.cycles import (
    Cycle,
    HardwareValues,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.errors import InputError
from arm_drake.importing import dataclass
from arm_drake.messages import NANOSECONDS, Message
from arm_drake.python_system import PythonSystem
from arm_drake.timing import cycle_at, has_rate

# Returns what a controller exports.
_ReadExports = Callable[[Context], Array]

# See ControllerInterface.find_look.
Look = Callable[[Context], Callable[[Cycle], Any]]


@dataclass(frozen=True, kw_only=True)
class RobotInfo:
    """Data of a robot for its controllers, besides the interfaces."""

    # State interfaces that hold anything but a double, such as a bool.
    other_types: frozenset[str] = frozenset()

    # URDF velocity limit of joints [rad/s] or [m/s]; others have none.
    velocity_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # URDF effort limit of joints [N·m] or [N]; others have none.
    effort_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # Of each mimic joint: the joint that it follows in the end, and how far it moves
    # per unit of it.
    followed: Mapping[str, tuple[str, float]] = dc.field(default_factory=dict)

    # Where grippers' joints are open and where closed [rad] or [m].
    gripper_ranges: Mapping[str, tuple[float, float]] = dc.field(default_factory=dict)

    # Namespace of the robot's nodes; empty at the root.
    namespace: str = ""

    # Names of the links, of the robot and of the world; Gazebo's topics contain them.
    links: tuple[str, ...] = ()
    robot_name: str = ""
    world_name: str = "empty"

    # Of the noise of sensors.
    seed: int = 0

    # Returns the kinematics of joints, seen from a link; None if it isn't known.
    make_kinematics: Callable[[Sequence[str], str], ChainKinematics] | None = None


@dataclass(frozen=True)
class ControllerInterfaceParams(RobotInfo):
    """Configuration of a controller besides its parameters."""

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

    # Whether a manager keeps its state and says when it ticks; else it does so itself.
    is_managed: bool = False


class ControllerInterface(PythonSystem):
    """Base of all controllers: what they read, what they claim.

    A controller that reads no efforts is given none: its port ends after the
    velocities. Efforts take the servo's whole computation. A controller without an
    update of its own, `is_sampled`, is given everything, held from tick to tick; if it
    is slower than its manager, with the time of the tick.
    """

    is_sampled = False

    # Messages of its topics, by port, where it says so.
    message_types: Mapping[str, type[Message]] = MappingProxyType({})

    def __init__(
        self,
        params: ControllerInterfaceParams,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
        limit_interfaces: Mapping[str, str] | None = None,
    ) -> None:
        """Create the system with the input ports that all controllers have.

        Args:
            params: Rate and surroundings of the controller.
            state_interfaces: What it reads, such as "joint1/position".
            command_interfaces: What it claims; another controller's references too.
            reference_interfaces: What other controllers may command of it, with its
                own name in front: "pid/joint1/position".
            exported_interfaces: What other controllers may read of it, likewise.
            limit_interfaces: Command interfaces that don't move a joint, but limit how
                it is moved: "effort" or "velocity", by name; 0 is no limit.
        """
        super().__init__()
        self.set_name(params.controller_name)
        self.params = params
        self.state_interfaces = state_interfaces
        self.command_interfaces = command_interfaces
        self.reference_interfaces = reference_interfaces
        self.exported_interfaces = exported_interfaces
        self.limit_interfaces = dict(limit_interfaces or {})
        order = {name: index for index, name in enumerate(params.measured)}
        num_measured = 2 * len(params.joint_types)
        self.reads_all = self.is_sampled or any(
            order.get(name, 0) >= num_measured for name in state_interfaces
        )
        if self.reads_all:
            num_measured = len(params.measured)
        self._manager = self.DeclareAbstractInputPort(
            interfaces.MANAGER_PORT, AbstractValue.Make(())
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        # What controllers export, where it goes and where it stands there; and what
        # nobody has. The manager never starts a controller that lacks something,
        # but one that is inactive reads, too.
        self._exporters: list[tuple[_ReadExports, list[int], list[int]]] = []
        self._missing = dict.fromkeys(n for n in state_interfaces if n not in order)
        # Of those that are measured: where they go, and where they stand.
        self._target_indices, self._source_indices = _match(
            state_interfaces, params.measured
        )
        # What to index with if all are measured.
        self._read_at: slice | list[int] | None = None
        if not self._missing:
            self._read_at = _as_slice(self._source_indices)
        # By ports, see find_look.
        self._looks: dict[str, Look] = {}
        # At most one port with the time of the last tick.
        self._tick_times: list[InputPort] = []

    def add_tick_time(self) -> InputPort:
        """Declare the port with the time [ns] of what is sampled; NaN is nothing."""
        port = self.DeclareVectorInputPort(interfaces.TICK_PORT, 1)
        self._tick_times.append(port)
        return port

    def add_exporter(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of what a controller's last tick has exported."""
        names = controller.exported_interfaces
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareVectorInputPort(name, len(names))
        self._read_exports(names, port.Eval)
        return port

    def _read_exports(self, names: tuple[str, ...], read: _ReadExports) -> None:
        """Take state interfaces from another controller; `read` has this order."""
        self._exporters.append((read, *_match(self.state_interfaces, names)))
        for name in names:
            self._missing.pop(name, None)

    def _read(self, context: Context) -> Array:
        """Return the measured `state_interfaces`; NaN where there is none.

        Without a manager, which would keep it inactive, that is an InputError.
        """
        if self._read_at is not None:
            return self._measured.Eval(context)[self._read_at]
        if self._missing and not self._manager.HasValue(context):
            raise InputError(
                f"controller {self.params.controller_name!r}: no state interface "
                f"{', '.join(map(repr, self._missing))}; it has "
                f"{sorted(self.params.measured)}"
            )
        values = np.full(len(self.state_interfaces), np.nan)
        values[self._target_indices] = self._measured.Eval(context)[
            self._source_indices
        ]
        for read, target_indices, source_indices in self._exporters:
            values[target_indices] = read(context)[source_indices]
        return values

    def find_lasting_fault(self, context: Context, message: object) -> str:
        """Return why it refuses a message whenever it comes; "" if it needn't."""
        return ""

    def find_look(self, port: str) -> Look | None:
        """Return what reads a port's message so that it can be made elsewhere.

        It takes the diagram's context, and is quick; what it returns makes the message
        of the last cycle, in any thread, or None where there is nothing to say. None
        for a port that can only be evaluated.
        """
        return self._looks.get(port)

    def _is_active(self, context: Context) -> bool:
        """Return whether the controller is active, as of the last cycle or this one."""
        if not self._manager.HasValue(context):
            return True
        cycle: Cycle = self._manager.Eval(context)
        return self.params.controller_name in cycle.active

    def _tick_time(self, number: int) -> int:
        """Return the time of a tick [ns]."""
        return number * NANOSECONDS // self.params.update_rate

    def _time_ns(self, context: Context) -> int:
        """Return the time of the tick of this instant [ns]."""
        if self._manager.HasValue(context):
            cycle: Cycle = self._manager.Eval(context)
            return cycle.time_ns
        return self._tick_time(cycle_at(context.get_time(), self.params.period) or 0)


def _match(names: Sequence[str], others: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return where names stand that are among others, and their places there."""
    order = {name: index for index, name in reversed(list(enumerate(others)))}
    at = [index for index, name in enumerate(names) if name in order]
    return at, [order[names[index]] for index in at]


def _as_slice(at: list[int]) -> slice | list[int]:
    """Return indices as a slice if they are in a row."""
    if at and at == list(range(at[0], at[0] + len(at))):
        return slice(at[0], at[0] + len(at))
    return at


S = TypeVar("S")


class KeptTicks(Generic[S]):
    """The last tick of a controller, on a port of its manager's."""

    def __init__(
        self,
        system: LeafSystem,
        params: ControllerInterfaceParams,
        first: UpdateResult[S],
    ) -> None:
        """Declare the port."""
        self._name = params.controller_name
        self._port = system.DeclareAbstractInputPort(
            interfaces.TICKS_PORT, AbstractValue.Make(())
        )
        self.ticket: DependencyTicket = system.input_port_ticket(self._port.get_index())

    def last(self, context: Context) -> UpdateResult[S]:
        """Return what the last tick left behind."""
        result: UpdateResult[S] = self._port.Eval(context).ticks[self._name]
        return result

    def at(
        self, context: Context, cycle: Cycle | None
    ) -> tuple[Cycle, UpdateResult[S]]:
        """Return a cycle, without one None, and what the tick before it left behind."""
        assert cycle is not None
        return cycle, cycle.ticks[self._name]


class OwnTicks(KeptTicks[S]):
    """The same in the state of a controller that has no manager."""

    def __init__(
        self,
        system: LeafSystem,
        params: ControllerInterfaceParams,
        first: UpdateResult[S],
    ) -> None:
        """Declare the state; arguments are those of KeptTicks."""
        self._update_rate, self._period = params.update_rate, params.period
        # Without a manager on its port it is always active.
        self._always_active = {params.controller_name: 1}
        # An immutable Python object goes into the Context as it is. Drake takes a plain
        # number quicker than its own kind of index.
        self._index = int(system.DeclareAbstractState(AbstractValue.Make(first)))
        self.ticket = system.xa_ticket()

    def last(self, context: Context) -> UpdateResult[S]:
        """Return what the last tick left behind."""
        result: UpdateResult[S] = context.get_abstract_state(self._index).get_value()
        return result

    def at(
        self, context: Context, cycle: Cycle | None
    ) -> tuple[Cycle, UpdateResult[S]]:
        """Return a cycle, and what the tick before it left behind; as KeptTicks."""
        last = self.last(context)
        if cycle is not None:
            return cycle, last
        number = cycle_at(context.get_time(), self._period)
        if number is None:
            number = -1 if last.number is None else last.number
        time_ns = self._time_ns(number)
        period_ns = time_ns - self._time_ns(number - 1)
        return Cycle(number, time_ns, period_ns, self._always_active), last

    def store(self, state: State, result: UpdateResult[Any]) -> None:
        """Store what a tick has left behind."""
        state.get_mutable_abstract_state(self._index).set_value(result)

    def _time_ns(self, number: int) -> int:
        return number * NANOSECONDS // self._update_rate


_NO_COMMAND: Array = np.empty(0)


class TickingController(ControllerInterface, Generic[S]):
    """Base of controllers with an immutable state of type S, renewed at every tick.

    A subclass implements `_update`, and what else it needs of `_activate`,
    `_deactivate`, `_idle`, `_command` and `_is_ok`. It declares its further ports;
    outputs depend on the state alone and show what the last tick left behind.
    Without a manager on its port a controller is always active. Of the table of ports
    in its documentation Drake's block of ports is made.
    """

    def __init_subclass__(cls, **more: Any) -> None:
        """Add the block of ports to the documentation."""
        super().__init_subclass__(**more)
        cls.__doc__ = _document_ports(cls)

    # Whether all that it reads while `UpdateContext.is_quiet` goes through
    # `_measured_now` and `_read_commands`, so that its manager can call it without a
    # Context. It holds for the class that says so, not for those derived from it.
    reads_by_now = False

    # How many numbers its steady ticks have to remember, see `steady`.
    num_remembered = 0

    def __init__(
        self,
        params: ControllerInterfaceParams,
        initial: S,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
        limit_interfaces: Mapping[str, str] | None = None,
    ) -> None:
        """Create the system with its state, its tick and its interfaces.

        `initial` is the state before the first tick; all else is as in
        ControllerInterface.
        """
        # Drake's classes take no notice of what is abstract.
        own = type(self)
        if own._update is TickingController._update:
            raise TypeError(f"{own.__name__} has no _update")
        if command_interfaces and own._command is TickingController._command:
            raise TypeError(f"{own.__name__} has command interfaces and no _command")
        super().__init__(
            params,
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
            reference_interfaces=reference_interfaces,
            exported_interfaces=exported_interfaces,
            limit_interfaces=limit_interfaces,
        )
        # At most one port with the values of all command interfaces, and where those of
        # this one stand there.
        self._values: list[tuple[InputPort, int]] = []
        self._values_at: list[tuple[int, int]] = []
        # Of each controller that may command references: its port, and where its
        # commands stand among them.
        self._predecessors: list[tuple[str, InputPort, list[int], list[int]]] = []
        self._no_references = np.full(len(self.reference_interfaces), np.nan)
        self.first_result: UpdateResult[S] = UpdateResult(
            None, None, initial, np.full(len(self.command_interfaces), np.nan)
        )
        make = KeptTicks if params.is_managed else OwnTicks
        self._ticks: KeptTicks[S] = make(self, params, self.first_result)
        # Whether it says of an update how it went.
        self.can_fail = own._is_ok is not TickingController._is_ok
        # Humble's manager goes on with a controller whose update fails.
        self._ends_on_failure = params.distro != "humble"
        self._declare_tick()

    def _declare_tick(self) -> None:
        """Declare the ports of ticks and exports; who has no manager stores ticks."""
        self._tick_port = self.DeclareAbstractOutputPort(
            interfaces.COMMAND_PORT, lambda: AbstractValue.Make(()), self._calc_tick
        )
        if isinstance(self._ticks, OwnTicks):
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                self.params.period, 0.0, self._update_state
            )
        if self.exported_interfaces:
            self.DeclareVectorOutputPort(
                interfaces.EXPORT_PORT,
                len(self.exported_interfaces),
                lambda context, output: output.SetFromVector(
                    self._export_last(context)
                ),
                prerequisites_of_calc={self._ticks.ticket, self._measured.ticket()},
            )

    def add_command_values(
        self, order: Sequence[str], start: int = 0, size: int | None = None
    ) -> InputPort:
        """Declare the port of what all command interfaces hold, in an order.

        They start at a place of a vector of a size; None is that of the order.
        """
        port = self.DeclareVectorInputPort(interfaces.VALUES_PORT, size or len(order))
        self._values.append((port, start))
        at = _match(self.command_interfaces, order)
        self._values_at.extend(zip(*at, strict=True))
        return port

    def add_predecessor(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of a controller that commands references of this one."""
        name = controller.params.controller_name
        port = self.DeclareAbstractInputPort(
            f"{interfaces.CHAIN_PORT}{name}", AbstractValue.Make(())
        )
        at = _match(self.reference_interfaces, controller.command_interfaces)
        self._predecessors.append((name, port, *at))
        return port

    def _state(self, context: Context) -> S:
        """Return the state that the last tick left."""
        return self._ticks.last(context).state

    def _measured_now(self, now: UpdateContext) -> Array:
        """Return the measured `state_interfaces`; NaN where there is none."""
        if now.hardware_values is None:
            return self._read(now.context)
        return now.hardware_values.motions[self._read_at]

    def _read_commands(self, now: UpdateContext) -> Array:
        """Return the present values of the command interfaces, shape (k,).

        NaN is what was never written. References of other controllers are what was
        written to them last.
        """
        _, last = self._ticks.at(now.context, now.cycle)
        values = np.array(last.command)
        for port, start in self._values:
            present = now.cycle.commands
            if present is None:
                hardware = now.hardware_values
                if hardware is None:
                    present = port.Eval(now.context)[start:]
                else:
                    present = hardware.values
            for i, at in self._values_at:
                values[i] = present[at]
        return values

    def _read_references(self, now: UpdateContext) -> Array | None:
        """Return what other controllers command, NaN where none does; None if none.

        Shape (number of reference_interfaces,).
        """
        if self.params.controller_name not in now.cycle.chained:
            return None
        references = self._no_references.copy()
        for name, port, target_indices, source_indices in self._predecessors:
            if name in now.cycle.active:
                references[target_indices] = port.Eval(now.context).command[
                    source_indices
                ]
        return references

    def add_exporter_tick(self, controller: "TickingController[Any]") -> InputPort:
        """Declare the port of a controller that ticks first and exports state to this.

        Its tick of this very instant counts, not the last one as in `add_exporter`.
        """
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareAbstractInputPort(name, AbstractValue.Make(()))
        self._read_exports(
            controller.exported_interfaces,
            lambda context: controller._export(port.Eval(context).state),
        )
        return port

    @property
    def is_direct(self) -> bool:
        """Whether it needs no Context while nothing comes: see `reads_by_now`.

        While another controller commands its references it does need one.
        """
        is_measured = self._read_at is not None
        reads_by_now = vars(type(self)).get("reads_by_now", False)
        return bool(self.params.is_managed and reads_by_now and is_measured)

    @property
    def whole_period_ns(self) -> int | None:
        """Time between two ticks [ns]; None where it isn't always the same."""
        rate = self.params.update_rate
        is_whole = has_rate(self.params.period, rate) and NANOSECONDS % rate == 0
        return NANOSECONDS // rate if is_whole else None

    def tick(self, cycle: Cycle, hardware: HardwareValues) -> UpdateResult[S]:
        """Return what a cycle leaves behind in which nothing comes.

        The same as what the port says, without a way through Drake.
        """
        name = self.params.controller_name
        last: UpdateResult[S] = cycle.ticks[name]
        activation = cycle.active.get(name)
        goes_on = activation is not None and activation == last.activation
        if not goes_on or cycle.periods or self.can_fail:
            return self._run(None, last, cycle, hardware)
        now = UpdateContext(None, cycle.time_ns, cycle.period_ns, cycle, True, hardware)
        state = self._update(now, last.state)
        command = self._command(state)
        return UpdateResult(
            cycle.number, activation, state, command, True, "", last.inputs
        )

    def steady(self, last: UpdateResult[S], time_ns: int) -> SteadyTicks[S] | None:
        """Return how it ticks from a state on as long as nothing comes.

        None where it always ticks in full, which is right for every controller. What it
        returns has to leave the same behind, bit by bit. What it has to remember from
        tick to tick is `num_remembered` numbers, which `remember` says of a state.

        Args:
            last: What the last tick left behind, with all that came until then.
            time_ns: The time of that tick [ns].
        """
        return None

    def remember(self, state: S) -> Sequence[float]:
        """Return what steady ticks remember of a state, `num_remembered` numbers."""
        return ()

    def resume(
        self,
        steady: SteadyTicks[S],
        last: UpdateResult[S],
        number: int,
        time_ns: int,
        motions: Array,
        memory: Sequence[float],
    ) -> UpdateResult[S]:
        """Return what a steady tick has left behind, as `tick` does.

        `last` is what the last tick in full left; all else is of the steady one.
        """
        state = steady.state(time_ns, motions, memory)
        return UpdateResult(
            number,
            last.activation,
            state,
            self._command(state),
            last.is_ok,
            last.fault,
            last.inputs,
        )

    @abstractmethod
    def _update(self, now: UpdateContext, state: S) -> S:
        """Return the state after a tick; `now` has the time and what it reads."""

    def _activate(self, now: UpdateContext, state: S) -> S:
        """Return the state at the start of an activation, before its first tick."""
        return state

    def _deactivate(self, now: UpdateContext, state: S) -> S:
        """Return the state at the end of an activation."""
        return state

    def _idle(self, now: UpdateContext, state: S) -> S:
        """Return the state after a cycle in which the controller is inactive."""
        return state

    def rests(self, state: S) -> bool:
        """Return whether only a message can change the state while inactive.

        A controller with an `_idle` that does no more than take messages says so here,
        and then costs nothing while it is inactive and nothing comes. It holds for the
        class whose `_idle` it is, not for those with one of their own.
        """
        return type(self)._idle is TickingController._idle

    @property
    def may_rest(self) -> bool:
        """Whether `rests` speaks of this class's own `_idle`."""
        for kind in type(self).__mro__:
            if "rests" in vars(kind):
                return True
            if "_idle" in vars(kind):
                return False
        return True

    def _command(self, state: S) -> Array:
        """Return the commands of a state, shape (k,); NaN leaves one as it is."""
        return _NO_COMMAND

    def _export_last(self, context: Context) -> Array:
        """Return what the last tick exported, or something else before the first."""
        return self._export(self._state(context))

    def _export(self, state: S) -> Array:
        """Return the exported state interfaces of a state."""
        return np.full(len(self.exported_interfaces), np.nan)

    def _fault(self, state: S) -> str:
        """Return why the last tick went wrong, in words."""
        return ""

    def _is_ok(self, state: S) -> bool:
        """Return whether the last tick went well."""
        return True

    def _declare_topic(
        self, name: str, calc: Callable[[S], Any], *, default: Any = ()
    ) -> OutputPort:
        """Declare an abstract output port that shows something of the state."""
        last, own = self._ticks.last, self.params.controller_name
        if self.params.is_managed:

            def show(cycle: Cycle) -> Any:
                return calc(cycle.ticks[own].state)

            self._looks[name] = lambda root: show
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(default),
            lambda context, output: output.set_value(calc(last(context).state)),
            prerequisites_of_calc={self._ticks.ticket},
        )

    def _calc_tick(self, context: Context, output: AbstractValue) -> None:
        has_manager = self.params.is_managed or self._manager.HasValue(context)
        managed_cycle = self._manager.Eval(context) if has_manager else None
        cycle, last = self._ticks.at(context, managed_cycle)
        if cycle.number != last.number:
            last = self._run(context, last, cycle)
        output.set_value(last)

    def _run(
        self,
        context: Context,
        last: UpdateResult[S],
        cycle: Cycle,
        hardware: HardwareValues | None = None,
    ) -> UpdateResult[S]:
        """Return what a cycle leaves behind."""
        name = self.params.controller_name
        period_ns = cycle.period_ns
        if cycle.periods:
            period_ns = cycle.periods.get(name, period_ns)
        inputs = cycle.inputs
        is_quiet = inputs is not None and inputs is last.inputs
        now = UpdateContext(
            context, cycle.time_ns, period_ns, cycle, is_quiet, hardware
        )
        activation = cycle.active.get(name)
        state, command, is_ok, fault = last.state, last.command, True, ""
        ending: Array | None = None
        if activation != last.activation:
            if last.activation is not None:
                state = self._deactivate(now, state)
                command = ending = self._command(state)
            if activation is not None:
                state = self._activate(now, state)
        if activation is None:
            state = self._idle(now, state)
        elif not period_ns:
            inputs = last.inputs
        else:
            state = self._update(now, state)
            command, is_ok = self._command(state), self._is_ok(state)
            if not is_ok:
                fault = self._fault(state)
                if self._ends_on_failure:
                    state, activation = self._deactivate(now, state), None
                    command = self._command(state)
        if ending is not None:  # What a restart leaves unwritten ends.
            command = np.where(np.isnan(command), ending, command)
        return UpdateResult(
            cycle.number, activation, state, command, is_ok, fault, inputs
        )

    def _update_state(self, context: Context, state: State) -> None:
        assert isinstance(self._ticks, OwnTicks)
        self._ticks.store(state, self._tick_port.Eval(context))


def _document_ports(system: type) -> str | None:
    """Return a system's documentation with Drake's block of the ports in its table.

    Without a table of its own it has that of its base.
    """
    summary, _, rest = inspect.cleandoc(system.__doc__ or "").partition("\n\n")
    tables = (_find_table(base) for base in system.__mro__)
    table = next(filter(None, tables), None)
    if table is None:
        return system.__doc__
    if "\n".join(table) not in rest:
        rest = "\n".join([*table, "", rest])
    ports = [row.split()[0] for row in table[3:-1] if not row.startswith(" ")]
    # The command interfaces are the first output port.
    number = ports.index(interfaces.COMMAND_PORT)
    block = [f"name: {system.__name__}", "input_ports:"]
    block += [f"- {port}" for port in ports[:number]]
    block += ["output_ports:", *(f"- {port}" for port in ports[number:])]
    text = textwrap.indent("\n".join(block), "    ")
    return f"{summary}\n\n.. pydrake_system::\n\n{text}\n\n{rest}\n"


def _find_table(system: type) -> list[str]:
    """Return the lines of the table of ports in a system's documentation."""
    lines = inspect.cleandoc(system.__doc__ or "").splitlines()
    borders = [i for i, line in enumerate(lines) if line.startswith("===")]
    table = lines[borders[0] : borders[2] + 1] if len(borders) == 3 else []
    has_ports = any(line.startswith(interfaces.COMMAND_PORT) for line in table)
    return table if has_ports else []
