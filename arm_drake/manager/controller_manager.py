"""The controller manager's read-update-write loop, as a system of the diagram."""

import math
import struct
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
    DiscreteValues,
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
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.lifecycle import (
    Lifecycle,
    ManagerInputs,
    QuietTicks,
    SteadyCycles,
    SteadyTick,
    TickKeeper,
)
from arm_drake.manager.loaded_controllers import (
    LoadedController,
    command_order,
    controller_infos,
    list_states,
)
from arm_drake.manager.state import CommandLimited, ManagerState
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.messages.base import append_events
from arm_drake.python_system import PythonSystem
from arm_drake.timing import TOLERANCE, cycle_at, cycle_time, cycle_times, has_rate


class Readings(NamedTuple):
    """What the manager holds and reads at the start of a cycle."""

    state: ManagerState

    # What lies on the ports, old and new.
    inputs: ManagerInputs

    # Returns positions, velocities and efforts of all joints, shape (3 J,).
    measure: Callable[[], Array]

    @property
    def new_requests(self) -> tuple[SwitchController, ...]:
        """The requests that weren't there in the last cycle."""
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
        """Return what controllers are told in a cycle; its times are in [ns]."""
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


def _numbers(count: int) -> Any:
    """Return what reads and writes numbers in an array, as plain floats.

    Arrays of few numbers take longer to make. (Of type Any, for typing doesn't know
    that arrays are buffers.)
    """
    return struct.Struct(f"{count}d")


# Name of the manager, and of its port on which a switch is requested.
MANAGER = "controller_manager"
SWITCH_PORT = "switch_controller"

# And of the one with the values that the physics doesn't know.
STORED_PORT = "stored_state_interfaces"

# And of the one that has what controllers remember from tick to tick.
REMEMBERED_PORT = "remembered"


class ControllerManager(PythonSystem):
    """Tells controllers when to run, and hands their commands to the hardware.

    .. pydrake_system::

        name: ControllerManager
        input_ports:
        - switch_controller
        - state_interfaces
        - joint_motions
        output_ports:
        - cycle
        - controllers
        - events
        - claimed
        - command_values
        - drive
        - active
        - remembered
        - ticks
        - inputs

    =================  ====  =======  ==================================================
    port               size  unit     meaning
    =================  ====  =======  ==================================================
    switch_controller  --    --       SwitchController: what to activate, deactivate
    state_interfaces   3J    rad, ..  positions, velocities, efforts of the J joints
    joint_motions      2J    rad, ..  the same without the efforts
    cycle              --    --       Cycle: what controllers are told
    controllers        --    --       tuple of ControllerState, in the order of the YAML
    events             --    --       tuple of the latest (number, event), the newest
                                      last
    claimed            --    --       tuple of the names of command interfaces, those
                                      that were claimed last at the end
    command_values     k     rad, ..  values of all command interfaces
    drive              7n    rad, ..  what the servo of n joints is told, see
                                      DriveCommands
    active             c     --       1 for each controller that is active, else 0
    remembered         m     --       numbers that a cycle leaves for the next one
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
        # Start of the names of the robot's ports and systems.
        self.prefix = prefix
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
        self._quiet = QuietTicks(keeper, claimants, drive)
        state = self._start(hardware_interfaces)
        self._state_index = int(self.DeclareAbstractState(AbstractValue.Make(state)))
        self._cycle = self._declare_read("cycle", self._calc_cycle, is_of_now=True)
        self._num_servo = len(drive.servo_input(state.drive))
        self._num_motions = self._keeper.num_measured
        *numbers, steady = self._declare_numbers(state)
        self._values, self._drive_state, self._flags = map(int, numbers)
        self._steady_state = int(steady)
        self._stored_states = StoredStates(hardware_interfaces, self.commands)
        self._stored = self._declare_stored(hardware_interfaces)
        self._declare_shown([*numbers, steady])
        self._present = self._declare(
            interfaces.TICKS_PORT, self.read_state, {self.discrete_state_ticket(steady)}
        )
        # Computed anew only when something is put on a port.
        self._inputs = self._declare_read("inputs", self._calc_inputs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _declare_numbers(self, state: ManagerState) -> list[DiscreteStateIndex]:
        """Declare values, servo's input, active flags, and what steady cycles write."""
        n = len(self._drive.joints)
        self._has_rate = has_rate(self.period, self._update_rate)
        # What steady cycles keep, and all of it but for the motions.
        kept = 1 + 2 * n + self._claimants.num_remembered
        self._kept_struct = _numbers(kept + self._num_motions)
        self._last_struct = _numbers(kept)
        self._values_struct = _numbers(len(state.values))
        self._servo_struct = _numbers(self._num_servo)
        servo_input = self._drive.servo_input(state.drive)
        flags = [float(c.name in state.active) for c in self.controllers]
        start = (state.values, servo_input, flags, self._steady_numbers(state))
        return [self.DeclareDiscreteState(x) for x in start]

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
        ports = [self._switch, *self._keeper.inboxes]
        more = {
            self.time_ticket(),
            self.xa_ticket(),
            self.xd_ticket(),
            self._measured.ticket(),
        }
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            calc,
            prerequisites_of_calc={
                *(port.ticket() for port in ports),
                *(more if is_of_now else ()),
            },
        )

    def _declare_shown(self, numbers: Iterable[DiscreteStateIndex]) -> None:
        """Declare the ports that show the state, as the last full tick has left it."""
        state, claimed = self._state, self._lifecycle.claimed
        self._declare(
            "controllers", lambda c: list_states(self.controllers, state(c).active)
        )
        self._declare("events", lambda c: state(c).events)
        self._declare(interfaces.CLAIMED_PORT, lambda c: claimed(state(c).active))
        names = (interfaces.VALUES_PORT, "drive", "active", REMEMBERED_PORT)
        for name, index in zip(names, numbers, strict=True):
            self.DeclareStateOutputPort(name, index)

    def remembered(self, controller: str) -> range:
        """Return which numbers of `remembered` are a controller's."""
        start, part = 1 + 2 * len(self._drive.joints), self._claimants.parts[controller]
        return range(start + part.start, start + part.stop)

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
            values = self.GetOutputPort(interfaces.VALUES_PORT)
            builder.Connect(values, system.add_command_values(self.commands))
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
        """Return what makes the last cycle as controllers are told it, with its ticks.

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
        numbers = np.array(context.get_discrete_state(self._steady_state).value())
        if round(numbers[0]) == state.cycle.number:
            return lambda: state
        steady = self._quiet.steady_cycles(state)
        assert steady is not None
        values, servo_input = (
            np.array(context.get_discrete_state(index).value())
            for index in (self._values, self._drive_state)
        )
        return partial(self._make_state, steady, values, servo_input, numbers)

    def _make_state(
        self, steady: SteadyCycles, values: Array, servo_input: Array, numbers: Array
    ) -> ManagerState:
        """Return the state after a steady cycle, of what it has written."""
        number, n = round(numbers[0]), len(self._drive.joints)
        times = cycle_times(number, self.period, self._update_rate)
        m = n + self._claimants.num_remembered
        rates, memory, motions = np.split(numbers[1 + n :], [n, m])
        drive = np.concatenate((servo_input, rates))
        return steady.state(number, times, values, drive, motions, memory.tolist())

    def write_state(self, context: Context, state: ManagerState) -> None:
        """Store a state in the manager's own context, for the next cycle."""
        context.SetAbstractState(self._state_index, state)
        context.SetDiscreteState(self._steady_state, self._steady_numbers(state))

    def _steady_numbers(self, state: ManagerState) -> Array:
        """Return what steady cycles keep.

        The number of the cycle, the first and the last part of the drive vector, what
        controllers remember, and what was measured.
        """
        drive, n = state.drive, len(self._drive.joints)
        first, last = drive[:n], drive[len(drive) - n :]
        memory = self._claimants.remember(state.ticks)
        unknown = np.zeros(self._num_motions)
        return np.concatenate(([state.cycle.number], first, last, memory, unknown))

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
        output.set_value(self._keeper.read_inputs(context, requests))

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

    def _tick_steadily(
        self, context: Context, base: ManagerState, numbers: Array
    ) -> SteadyTick | None:
        """Return what a steady cycle writes; None where a cycle isn't of this kind.

        `numbers` are what the last cycle has left for it.
        """
        steady = self._quiet.steady_cycles(base)
        if steady is None or self._inputs.Eval(context) is not steady.inputs:
            return None
        last = self._last_struct.unpack_from(numbers)
        number, rate = int(last[0]) + 1, self._update_rate
        # What `cycle_at` and `cycle_time` say, without calls.
        if abs(context.get_time() / self.period - number) > TOLERANCE:
            return None
        time_ns = number * NANOSECONDS // rate
        if not self._has_rate:
            time_ns = cycle_time(number, self.period, rate)
        if time_ns >= steady.until_ns:
            return None
        if time_ns >= steady.monitor_ns:
            if number == base.cycle.number + 1:
                return None
            last_ns = cycle_time(number - 1, self.period, rate)
            motions = np.array(numbers[-self._num_motions :])
            resumed = steady.report(time_ns, last_ns, motions)
            if resumed is None:
                return None
            self._quiet.remember(resumed)
            steady = resumed
        motions = self._keeper.measure(context, reads_all=steady.reads_all)
        n = len(self._drive.joints)
        memory = list(last[1 + 2 * n :])
        found = steady.tick(time_ns, last[1 : 1 + 2 * n], motions, memory)
        if found is None:
            return None
        return SteadyTick(steady.base, number, motions, memory, *found)

    def _write_steadily(
        self, numbers: DiscreteValues, kept: Array, tick: SteadyTick
    ) -> None:
        """Write a steady cycle to the discrete state, of which `kept` is a part."""
        _, number, motions, memory, values, servo_input, rates = tick
        first = servo_input[: len(rates)]
        # Where nobody active reads more, motions are less than there is room for.
        rest = [0.0] * (self._num_motions - len(motions))
        self._kept_struct.pack_into(
            kept, 0, number, *first, *rates, *memory, *motions.tolist(), *rest
        )
        view = numbers.get_mutable_value(self._drive_state)
        self._servo_struct.pack_into(view, 0, *servo_input)
        view = numbers.get_mutable_value(self._values)
        self._values_struct.pack_into(view, 0, *values)

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
        if self._keeper.are_direct:
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
        base, numbers = self._state(context), state.get_mutable_discrete_state()
        kept = numbers.get_mutable_value(self._steady_state)
        steady = self._tick_steadily(context, base, kept)
        if steady is not None:
            if steady.base is not base:
                index = self._state_index
                state.get_mutable_abstract_state(index).set_value(steady.base)
            self._write_steadily(numbers, kept, steady)
        else:
            old = base  # Without steady cycles since then, it is the present one.
            if kept[0] != base.cycle.number:
                old = self._present.Eval(context)
            new = self._tick_quietly(context, old) or self._tick(context, old)
            if new is old:
                return
            state.get_mutable_abstract_state(self._state_index).set_value(new)
            numbers.set_value(self._drive_state, new.drive[: self._num_servo])
            if new.cycle.active is not old.cycle.active:
                flags = [float(c.name in new.cycle.active) for c in self.controllers]
                numbers.set_value(self._flags, flags)
            numbers.set_value(self._values, new.values)
            kept[:] = self._steady_numbers(new)
        if self._stored is not None:
            stored = context.get_discrete_state(self._stored).value()
            values = numbers.get_value(self._values)
            numbers.set_value(self._stored, self._stored_states.update(stored, values))
