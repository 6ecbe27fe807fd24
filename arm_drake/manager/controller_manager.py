"""The controller manager's read-update-write loop, as a system of the diagram."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    DiagramBuilder,
    DiscreteStateIndex,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.drive_commands import DriveCommands, DriveMode
from arm_drake.control.joint_limits import CommandLimits, Previous
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, HardwareValues, messages_on
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.manager.claimants import Claimants, UpdateResults
from arm_drake.manager.connections import find_logged
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.lifecycle import (
    Lifecycle,
    ManagerInputs,
    QuietTicks,
    TickKeeper,
)
from arm_drake.manager.loaded_controllers import (
    LoadedController,
    command_order,
    controller_infos,
    list_states,
)
from arm_drake.manager.state import CommandLimited, ManagerState
from arm_drake.manager.steady_cycles import CycleNumbers, SteadyCycles
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.messages.base import append_events
from arm_drake.python_system import PythonSystem
from arm_drake.timing import TOLERANCE, cycle_at, cycle_time, cycle_times, has_rate


class Readings(NamedTuple):
    """State and inputs of the manager at the start of a cycle."""

    state: ManagerState

    # What lies on the ports, old and new.
    inputs: ManagerInputs

    # Returns positions, velocities and efforts of all joints, shape (3 J,).
    measure: Callable[[], Array]

    @property
    def new_requests(self) -> tuple[SwitchController, ...]:
        """The new requests since the last cycle."""
        old = set(map(id, self.state.requests))
        return tuple(r for r in self.inputs.requests if id(r) not in old)

    @property
    def is_switching(self) -> bool:
        """Whether controllers may start or end."""
        state = self.state
        return state.active is not state.cycle.active or (
            self.inputs.requests is not state.requests and bool(self.new_requests)
        )


_NO_PERIODS: Mapping[str, int] = MappingProxyType({})


class Loop:
    """The read-update-write loop of a robot."""

    def __init__(
        self,
        lifecycle: Lifecycle,
        claimants: Claimants,
        drive: DriveCommands,
        limits: CommandLimits | None,
        hardware_interfaces: HardwareInterfaces,
    ) -> None:
        """Create it."""
        self._lifecycle = lifecycle
        self._claimants = claimants
        self._drive = drive
        self._limits = limits
        order = hardware_interfaces.measured
        self._measured_at = [
            [order.index(f"{joint}/{name}") for joint in drive.joints]
            for name in interfaces.STATE_INTERFACES
        ]

    def begin(
        self, readings: Readings, number: int, time_ns: int, period_ns: int
    ) -> Cycle:
        """Return the controllers' input in a cycle; its times are in [ns]."""
        state, values = readings.state, None
        active, chain = state.active, state.chained
        if readings.is_switching:
            plan = self._lifecycle.switch(state, readings.new_requests)
            active, chain = plan.active, plan.chained
            values, _ = self._seed(readings, plan.mode)
        periods: Mapping[str, int] = _NO_PERIODS
        if self._lifecycle.slow:
            periods = self._lifecycle.periods(state, active, time_ns)
        return Cycle(
            number,
            time_ns,
            period_ns,
            active,
            chain,
            periods,
            values,
            state.ticks,
            readings.inputs,
        )

    def finish(
        self,
        ticks: UpdateResults,
        asleep: frozenset[str],
        readings: Readings,
        cycle: Cycle,
    ) -> ManagerState:
        """Return what a cycle leads to, once controllers have ticked."""
        state = readings.state
        active, chain, mode = state.active, state.chained, state.mode
        events, number = state.events, state.next_activation
        values, drive, fresh = state.values, state.drive, None
        if cycle.commands is None:
            values = values.copy()
        else:
            plan = self._lifecycle.switch(state, readings.new_requests)
            # The same as in the plan, and this very object.
            active, chain, mode = cycle.active, plan.chained, plan.mode
            events, number = append_events(events, plan.events), plan.next_activation
            _, drive = self._seed(readings, mode)
            values = cycle.commands.copy()
            fresh = self._claimants.fresh(cycle, state.cycle)
        failed = self._claimants.write(ticks, cycle, state.cycle, values)
        previous, all_limited = state.previous, state.limited
        if self._limits is not None:
            previous, limited = self._limit(
                readings, cycle, active, values, failed, is_fresh=fresh is not None
            )
            added = [CommandLimited(j) for j in limited if j not in state.limited]
            if added:
                events = append_events(events, added)
                all_limited |= {event.joint for event in added}
        last_ns, skipped = state.last_ns, None
        if cycle.periods:
            skipped = self._claimants.skipped(cycle)
            due = {n: cycle.time_ns for n, p in cycle.periods.items() if p}
            last_ns = {**last_ns, **due}
        drive = self._drive.write(mode, values, drive, fresh=fresh, skipped=skipped)
        failing = frozenset(failed)
        if failed and (failing != state.failing or self._lifecycle.ends_failed):
            active, number, failures = self._lifecycle.replace(failed, active, number)
            events = append_events(events, failures)
            chain = self._lifecycle.chained(active)
        return ManagerState(
            cycle,
            active,
            chain,
            mode,
            number,
            values,
            drive,
            last_ns,
            ticks,
            asleep,
            readings.inputs.requests,
            events,
            previous,
            all_limited,
            failing,
        )

    @property
    def has_quiet_cycles(self) -> bool:
        """Whether `finish_quietly` does for a cycle in which nothing comes."""
        return self._limits is None and not self._lifecycle.slow

    def finish_quietly(
        self, ticks: UpdateResults, cycle: Cycle, state: ManagerState
    ) -> ManagerState | None:
        """Return what `finish` does if nothing comes or switches; None if one fails."""
        values = state.values.copy()
        if self._claimants.write(ticks, cycle, state.cycle, values):
            return None
        return ManagerState(
            cycle,
            state.active,
            state.chained,
            state.mode,
            state.next_activation,
            values,
            self._drive.write(state.mode, values, state.drive),
            state.last_ns,
            ticks,
            state.asleep,
            state.requests,
            state.events,
            state.previous,
            state.limited,
        )

    def _limit(
        self,
        readings: Readings,
        cycle: Cycle,
        active: Mapping[str, int],
        values: Array,
        failed: dict[str, str],
        *,
        is_fresh: bool,
    ) -> tuple[Previous, Collection[str]]:
        """Hold values to limits; whoever commands what has no limited value fails.

        Return what is remembered of the joints, and those that were limited.
        """
        assert self._limits is not None
        state = readings.state
        previous = state.previous
        if is_fresh:
            previous = self._claimants.forget(previous, cycle, state.cycle)
        previous, limited, lost = self._limits.apply(
            self._lifecycle.claims(active),
            values,
            readings.measure(),
            previous,
            cycle.period_ns / NANOSECONDS,
        )
        if lost:
            owners = self._claimants.owners(active, lost)
            self._claimants.restore(values, state.values, owners)
            failed |= owners
        return previous, limited

    def _seed(self, readings: Readings, mode: DriveMode) -> tuple[Array, Array]:
        """Return the values and the drive vector with which a mode starts."""
        state = readings.state
        values, drive = state.values, state.drive
        if state.cycle.number < 0:
            return values, drive
        measured = readings.measure()
        q, v, tau = (measured[at] for at in self._measured_at)
        return self._drive.seed(state.mode, mode, values, drive, (q, v, tau))


class StoredStates:
    """State interfaces that follow a command interface of their name, or nothing."""

    def __init__(
        self, hardware_interfaces: HardwareInterfaces, commands: Sequence[str]
    ) -> None:
        """Create it."""
        order = tuple(hardware_interfaces.stored)
        mirrored = [name for name in order if name in commands]
        self._target_indices = [order.index(name) for name in mirrored]
        self._source_indices = [commands.index(name) for name in mirrored]

    def update(self, stored: Array, values: Array) -> Array:
        """Return the states after commands, shape (k,); others stay."""
        new, stored = values[self._source_indices], stored.copy()
        stored[self._target_indices] = np.where(
            np.isnan(new), stored[self._target_indices], new
        )
        return stored


def initial_values(
    commands: Sequence[str], joints: Sequence[str], positions: Mapping[str, float]
) -> list[float]:
    """Return what command interfaces hold at first; NaN is nothing."""
    values = []
    for name in commands:
        joint, _, interface = name.rpartition("/")
        if joint not in joints:
            values.append(math.nan)
        elif interface == interfaces.POSITION:
            values.append(positions[joint])
        else:
            values.append(0.0)
    return values


# Name of the manager, and of its port on which a switch is requested.
MANAGER = "controller_manager"
SWITCH_PORT = "switch_controller"

# And of the one with the values that the physics doesn't know.
STORED_PORT = "stored_state_interfaces"

# And of the one with all numbers that a cycle writes.
NUMBERS_PORT = "numbers"


class ControllerManager(PythonSystem):
    """Triggers the controllers' ticks, and writes their commands to the hardware.

    .. pydrake_system::

        name: ControllerManager
        input_ports:
        - switch_controller
        - state_interfaces
        - joint_motions
        output_ports:
        - cycle
        - numbers
        - controllers
        - events
        - claimed
        - ticks
        - inputs

    =================  ====  =======  ==================================================
    port               size  unit     meaning
    =================  ====  =======  ==================================================
    switch_controller  --    --       SwitchController: what to activate, deactivate
    state_interfaces   3J    rad, ..  positions, velocities, efforts of the J joints
    joint_motions      2J    rad, ..  the same without the efforts
    cycle              --    --       Cycle: what controllers are told
    numbers            m     rad, ..  all that a cycle writes in numbers, see
                                      CycleNumbers: what the servo is told, values of
                                      command interfaces, who is active, ...
    controllers        --    --       tuple of ControllerState, in the order of the YAML
    events             --    --       tuple of the latest (number, event), the newest
                                      last
    claimed            --    --       tuple of the names of command interfaces, those
                                      that were claimed last at the end
    ticks              --    --       ManagerState: the last ticks of the controllers
    inputs             --    --       ManagerInputs: messages on all ports
    =================  ====  =======  ==================================================

    Further input ports, `command_interfaces:<controller>`, are what their ticks leave
    behind, and `inbox:<controller>` what lies on their topics; `measured` is all that
    is measured, where one that reads more than the motions ticks without its ports.

    One update stores what all controllers leave behind. Their commands are taken from
    their ticks, so they act on the very step of the plant that starts with the cycle. A
    controller whose update fails is deactivated, its chain with it, and its fallback
    controllers start in the next cycle.
    """

    def __init__(
        self,
        robot: Robot,
        controllers: Iterable[LoadedController],
        report: LoadReport,
        *,
        prefix: str,
        period: float,
        log_period: float,
        drive: DriveCommands,
        hardware_interfaces: HardwareInterfaces,
        limits: CommandLimits | None = None,
        keep: object = None,
    ) -> None:
        """Create the system; `RobotSystems` does that."""
        super().__init__()
        self.robot = robot
        # Its load report, with what its controllers lack.
        self.report = report
        self.controllers = tuple(controllers)
        self.sensors: tuple[Any, ...] = ()  # Its cameras and lidars, beside it.
        # Start of the names of its ports and systems; name space of its nodes in ROS.
        self.prefix, self.namespace = prefix, hardware_interfaces.namespace
        # Periods of the manager, and of the log of joints' states, in Drake's time [s].
        self.period = period
        self.log_period = log_period
        self.commands = command_order(hardware_interfaces, self.controllers)
        # What must live as long as the diagram, such as the servo's plant.
        self._keep = keep
        self._update_rate = robot.controllers.update_rate
        self._drive = drive
        systems = {c.name: c.system for c in self.controllers if c.system is not None}
        self._lifecycle = self._make_lifecycle(systems, hardware_interfaces)
        nothing, J = AbstractValue.Make(()), len(hardware_interfaces.joint_types)
        self._switch = self.DeclareAbstractInputPort(SWITCH_PORT, nothing)
        self._measured = self.DeclareVectorInputPort(interfaces.STATE_PORT, 3 * J)
        self._keeper = self._make_keeper(systems, hardware_interfaces)
        self._claimants = claimants = Claimants(systems, self.commands, drive.joints)
        self._loop = Loop(
            self._lifecycle, claimants, drive, limits, hardware_interfaces
        )
        keeper = self._keeper if self._loop.has_quiet_cycles else None
        names = [controller.name for controller in self.controllers]
        self._quiet = QuietTicks(keeper, claimants, drive, names)
        state = self._start(hardware_interfaces)
        self._state_index = int(self.DeclareAbstractState(AbstractValue.Make(state)))
        self._cycle = self._declare_read("cycle", self._calc_cycle, is_of_now=True)
        numbers = self._declare_numbers(state)
        self.logged = find_logged(systems, self.numbers, claimants.parts)
        self._stored_states = StoredStates(hardware_interfaces, self.commands)
        self._stored = self._declare_stored(hardware_interfaces)
        self._declare_shown()
        self._present = self._declare(
            interfaces.TICKS_PORT,
            self.read_state,
            {self.discrete_state_ticket(numbers)},
        )
        # Computed anew only when something is put on a port.
        self._inputs = self._declare_read("inputs", self._calc_inputs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _declare_numbers(self, state: ManagerState) -> DiscreteStateIndex:
        """Declare what cycles write besides the state, and its port."""
        self._has_rate = has_rate(self.period, self._update_rate)
        self.numbers = CycleNumbers(
            num_servo=len(self._drive.servo_input(state.drive)),
            num_values=len(state.values),
            num_controllers=len(self.controllers),
            num_joints=len(self._drive.joints),
            num_remembered=self._claimants.num_remembered,
            num_motions=self._keeper.num_measured,
        )
        index = self.DeclareDiscreteState(self._numbers_of(state))
        self._numbers_index = int(index)
        self.DeclareStateOutputPort(NUMBERS_PORT, index)
        return index

    def _declare_stored(
        self, hardware_interfaces: HardwareInterfaces
    ) -> DiscreteStateIndex | None:
        """Declare the states that mirror commands, and their port, if there are any."""
        if not hardware_interfaces.stored:
            return None
        values = list(hardware_interfaces.stored.values())
        index = self.DeclareDiscreteState(values)
        self.DeclareStateOutputPort(STORED_PORT, index)
        return index

    def _make_keeper(
        self,
        systems: Mapping[str, ControllerInterface],
        hardware_interfaces: HardwareInterfaces,
    ) -> TickKeeper:
        """Declare the ports of what controllers say, and of what they read."""
        nothing = AbstractValue.Make(())
        sizes = {
            interfaces.MOTIONS_PORT: 2 * len(hardware_interfaces.joint_types),
            interfaces.MEASURED_PORT: len(hardware_interfaces.measured),
        }
        return TickKeeper(
            systems,
            lambda name: self.DeclareAbstractInputPort(name, nothing),
            lambda name: self.DeclareVectorInputPort(name, sizes[name]),
        )

    def _make_lifecycle(
        self,
        systems: Mapping[str, ControllerInterface],
        hardware_interfaces: HardwareInterfaces,
    ) -> Lifecycle:
        """Return what decides which controllers are active."""
        return Lifecycle(
            controller_infos(self.controllers),
            {name: system.params.update_rate for name, system in systems.items()},
            {
                c.name: c.fallback_controllers
                for c in self.robot.controllers.controllers
                if c.name in systems
            },
            self._drive,
            update_rate=self._update_rate,
            distro=self.robot.distro,
            refuse=hardware_interfaces.refuse,
        )

    def _start(self, hardware_interfaces: HardwareInterfaces) -> ManagerState:
        """Return the state before the first cycle, in which controllers start."""
        drive, initial = self._drive, hardware_interfaces.initial_positions
        values = np.array(initial_values(self.commands, drive.joints, initial))
        hold = drive.initial([initial[joint] for joint in drive.joints])
        started = [c.name for c in self.controllers if c.state == "active"]
        return self._lifecycle.start(started, values, hold, self._keeper.start())

    def _declare_read(
        self,
        name: str,
        calc: Callable[[Context, AbstractValue], None],
        *,
        is_of_now: bool = False,
    ) -> OutputPort:
        """Declare what is computed of messages, and of time, state and measurements."""
        tickets = {port.ticket() for port in (self._switch, *self._keeper.inboxes)}
        if is_of_now:
            tickets |= {self.time_ticket(), self.xa_ticket(), self.xd_ticket()}
            tickets.add(self._measured.ticket())
        return self.DeclareAbstractOutputPort(
            name, lambda: AbstractValue.Make(()), calc, tickets
        )

    def _declare_shown(self) -> None:
        """Declare the ports that show the state, as the last full tick has left it."""
        state, claimed = self._state, self._lifecycle.claimed
        self._declare(
            "controllers", lambda c: list_states(self.controllers, state(c).active)
        )
        self._declare("events", lambda c: state(c).events)
        self._declare(interfaces.CLAIMED_PORT, lambda c: claimed(state(c).active))

    def read_numbers(self, root: Context, part: slice) -> Array:
        """Return a part of what the last cycle has written, from the root context.

        Of `numbers.values` it is what all command interfaces hold, in the order of
        `commands`, where NaN is nothing.
        """
        own = self.GetMyContextFromRoot(root).get_discrete_state(self._numbers_index)
        return np.array(own.value()[part])

    def find_problems(
        self, context: Context, request: SwitchController
    ) -> tuple[str, ...]:
        """Return why a request can't be met in full, as things are."""
        active = self._state(self.GetMyContextFromRoot(context)).active
        return self._lifecycle.judge(active, request).problems

    def add_controller(
        self, builder: DiagramBuilder, system: ControllerInterface
    ) -> None:
        """Connect a controller that is in the builder with this manager."""
        builder.Connect(self._cycle, system.GetInputPort(interfaces.MANAGER_PORT))
        if isinstance(system, TickingController):
            numbers, at = self.GetOutputPort(NUMBERS_PORT), self.numbers.values.start
            values = system.add_command_values(self.commands, at, numbers.size())
            builder.Connect(numbers, values)
            if system.params.is_managed:
                kept = interfaces.TICKS_PORT
                builder.Connect(self.GetOutputPort(kept), system.GetInputPort(kept))
                self._keeper.connect(builder, system)

    def _state(self, context: Context) -> ManagerState:
        """Return the state that the last full tick has left."""
        state: ManagerState = context.get_abstract_state(self._state_index).get_value()
        return state

    def read_state(self, context: Context) -> ManagerState:
        """Return the state after the last cycle, from the manager's own context.

        After steady cycles it is made of what these have kept.
        """
        return self._find_maker(context)()

    def look(self, context: Context) -> Callable[[], Cycle]:
        """Return a function for the last cycle as controllers get it, with its ticks.

        That may be done later and in another thread: what it is made of is read now,
        from the manager's own context, in a tenth of the time.
        """
        make = self._find_maker(context)

        def tell() -> Cycle:
            state = make()
            return state.cycle._replace(ticks=state.ticks)

        return tell

    def _find_maker(self, context: Context) -> Callable[[], ManagerState]:
        """Return what makes the state as after a full cycle, of what is read now."""
        state = self._state(context)
        numbers = np.array(context.get_discrete_state(self._numbers_index).value())
        if round(numbers[CycleNumbers.NUMBER]) == state.cycle.number:
            return lambda: state
        steady = self._quiet.steady_cycles(state)
        assert steady is not None
        return partial(self._make_state, steady, numbers)

    def _make_state(self, steady: SteadyCycles, numbers: Array) -> ManagerState:
        """Return the state after a steady cycle, of what it has written."""
        number = round(numbers[CycleNumbers.NUMBER])
        times = cycle_times(number, self.period, self._update_rate)
        return steady.state(times, numbers, self.numbers)

    def write_state(self, context: Context, state: ManagerState) -> None:
        """Store a state in the manager's own context, for the next cycle."""
        context.SetAbstractState(self._state_index, state)
        context.SetDiscreteState(self._numbers_index, self._numbers_of(state))

    def _numbers_of(self, state: ManagerState) -> Array:
        """Return what a full cycle writes in numbers, which leads to a state."""
        numbers, layout = np.zeros(self.numbers.size), self.numbers
        n = len(self._drive.joints)
        drive, start = state.drive, len(state.drive) - n
        told = (
            *(drive[:start], state.values, self._quiet.flags(state), drive[start:]),
            self._claimants.remember(state.ticks),
        )
        # What was measured isn't known here, nor is it asked for.
        unknown = np.zeros(layout.motions.stop - layout.motions.start)
        layout.write(numbers, state.cycle.number, told, unknown)
        return numbers

    def _declare(
        self,
        name: str,
        calc: Callable[[Context], object],
        more: Collection[DependencyTicket] = (),
    ) -> OutputPort:
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            lambda context, output: output.set_value(calc(context)),
            prerequisites_of_calc={self.xa_ticket(), *more},
        )

    def _calc_inputs(self, context: Context, output: AbstractValue) -> None:
        requests = messages_on(self._switch, context, SwitchController)
        inboxes = tuple(port.Eval(context) for port in self._keeper.inboxes)
        output.set_value(ManagerInputs(requests, inboxes))

    def _calc_cycle(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._find_cycle(context, self._present.Eval(context)))

    def _find_cycle(self, context: Context, state: ManagerState) -> Cycle:
        number = cycle_at(context.get_time(), self.period)
        if number is None or number == state.cycle.number:
            return state.cycle._replace(ticks=state.ticks)
        times = cycle_times(number, self.period, self._update_rate)
        inputs = self._inputs.Eval(context)
        readings = Readings(state, inputs, partial(self._measured.Eval, context))
        return self._loop.begin(readings, number, *times)

    def _go_on(self, context: Context, steady: SteadyCycles, numbers: Array) -> bool:
        """Write a cycle that is known ahead; return whether it is.

        `numbers` are those of the last cycle, and then of this one.
        """
        number = int(numbers.item(CycleNumbers.NUMBER)) + 1
        if number >= steady.end_ahead:
            return False
        if abs(context.get_time() / self.period - number) > TOLERANCE:
            return False
        if self._inputs.Eval(context) is not steady.inputs:
            return False
        return self._write_known(context, steady, number, numbers)

    def _write_known(
        self, context: Context, steady: SteadyCycles, number: int, numbers: Array
    ) -> bool:
        """Write a cycle that is computed ahead if there is one that goes on."""
        row = steady.find(number, numbers)
        if row is None:
            return False
        motions = self._keeper.measure(context, reads_all=steady.reads_all)
        if steady.is_judging and not steady.allows(self._find_time(number), motions):
            return False
        numbers[CycleNumbers.NUMBER] = number
        start = self.numbers.servo.start
        numbers[start : start + len(row)] = row
        start = self.numbers.motions.start
        numbers[start : start + len(motions)] = motions
        return True

    def _find_time(self, number: int) -> int:
        """Return the time of a cycle [ns]."""
        if self._has_rate:  # As `cycle_time` says, without a call.
            return number * NANOSECONDS // self._update_rate
        return cycle_time(number, self.period, self._update_rate)

    def _tick_steadily(
        self, context: Context, steady: SteadyCycles, numbers: Array
    ) -> SteadyCycles | None:
        """Write a steady cycle; return its kind, None where a cycle isn't steady.

        `numbers` are those of the last cycle, and then of this one.
        """
        if self._inputs.Eval(context) is not steady.inputs:
            return None
        layout, number = self.numbers, int(numbers.item(CycleNumbers.NUMBER)) + 1
        # What `cycle_at` says, without a call.
        if abs(context.get_time() / self.period - number) > TOLERANCE:
            return None
        is_first = number == steady.base.cycle.number + 1
        time_ns = self._find_time(number)
        if time_ns >= steady.until_ns:
            return None
        if time_ns >= steady.monitor_ns:
            if is_first:
                return None
            motions = np.array(numbers[layout.motions])
            resumed = steady.report(time_ns, self._find_time(number - 1), motions)
            if resumed is None:
                return None
            self._quiet.remember(resumed)
            steady = resumed
            if self._write_known(context, steady, number, numbers):
                return steady
        motions = self._keeper.measure(context, reads_all=steady.reads_all)
        positions, rates, memory = layout.last(numbers)
        memory = list(memory)
        told = steady.tick(time_ns, positions, rates, motions, memory)
        if told is None:
            return None
        layout.write(numbers, number, told, motions)
        steady.look_ahead(number, self._find_time, numbers, layout)
        return steady

    def _tick_quietly(self, context: Context, old: ManagerState) -> ManagerState | None:
        """Return what a cycle leads to in which nothing comes; None for all others.

        It is what `_tick` would return, without a way through Drake for what can't be.
        """
        inputs, last = self._inputs.Eval(context), old.cycle
        if inputs is not last.inputs or old.active is not last.active or old.failing:
            return None
        controllers = self._quiet.controllers(old)
        number = cycle_at(context.get_time(), self.period)
        if controllers is None or number is None or number == last.number:
            return None
        cycle = Cycle(
            number,
            *cycle_times(number, self.period, self._update_rate),
            old.active,
            old.chained,
            _NO_PERIODS,
            None,
            old.ticks,
            inputs,
        )
        reads_all = any(controller.reads_all for _, controller in controllers)
        motions = self._keeper.measure(context, reads_all=reads_all)
        hardware = HardwareValues(motions, old.values)
        ticks = {**old.ticks}
        for name, controller in controllers:
            ticks[name] = controller.tick(cycle, hardware)
        # Where one fails, the full way decides what follows.
        return self._loop.finish_quietly(ticks, cycle, old)

    def _tick(self, context: Context, old: ManagerState) -> ManagerState:
        """Return what a cycle leads to; the old state between two cycles."""
        is_quiet = self._inputs.Eval(context) is old.cycle.inputs
        if self._keeper.are_direct and is_quiet:
            cycle = self._find_cycle(context, old)
        else:  # Others ask for it too, and the port remembers it.
            cycle = self._cycle.Eval(context)
        if cycle.number == old.cycle.number:
            return old
        inputs = cast(ManagerInputs, cycle.inputs)
        readings = Readings(old, inputs, partial(self._measured.Eval, context))
        ticks, asleep = self._keeper.run(context, cycle, old)
        return self._loop.finish(ticks, asleep, readings, cycle)

    def _update(self, context: Context, state: State) -> None:
        numbers = state.get_mutable_discrete_state().get_mutable_value(
            self._numbers_index
        )
        base = self._state(context)
        steady = self._quiet.steady_cycles(base)
        if steady is None or not self._go_on(context, steady, numbers):
            self._tick_anew(context, base, steady, state, numbers)
        if self._stored is not None:
            values = numbers[self.numbers.values]
            stored = context.get_discrete_state(self._stored).value()
            state.get_mutable_discrete_state().set_value(
                self._stored, self._stored_states.update(stored, values)
            )

    def _tick_anew(
        self,
        context: Context,
        base: ManagerState,
        steady: SteadyCycles | None,
        state: State,
        numbers: Array,
    ) -> None:
        """Write a cycle that isn't known ahead; nothing between two cycles."""
        index = self._state_index
        is_present = numbers[CycleNumbers.NUMBER] == base.cycle.number
        if steady is not None:
            steady = self._tick_steadily(context, steady, numbers)
        if steady is not None:
            if steady.base is not base:
                state.get_mutable_abstract_state(index).set_value(steady.base)
            return
        # Without steady cycles since then, the last full one's is the present state.
        old = base if is_present else self._present.Eval(context)
        new = self._tick_quietly(context, old) or self._tick(context, old)
        if new is not old:
            state.get_mutable_abstract_state(index).set_value(new)
            numbers[:] = self._numbers_of(new)
