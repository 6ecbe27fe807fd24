"""The controller manager's read-update-write loop, as a system of the diagram."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    AbstractStateIndex,
    Context,
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
from arm_drake.controllers.cycles import Cycle, messages_on
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.lifecycle import Claimants, Lifecycle, News, TickKeeper, Ticks
from arm_drake.manager.loaded_controllers import (
    LoadedController,
    command_order,
    controller_infos,
    list_states,
)
from arm_drake.manager.state import CommandLimited, ManagerState
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.messages.base import add_news
from arm_drake.python_system import PythonSystem
from arm_drake.timing import cycle_at, cycle_times


class Readings(NamedTuple):
    """What the manager holds and reads at the start of a cycle."""

    held: ManagerState

    # What lies on the ports, old and new.
    news: News

    # Returns positions, velocities and efforts of all joints, shape (3 J,).
    measure: Callable[[], Array]

    @property
    def new_requests(self) -> tuple[SwitchController, ...]:
        """The requests that weren't there in the last cycle."""
        old = self.held.requests
        new = self.news.requests
        return tuple(r for r in new if not any(r is other for other in old))

    @property
    def is_switching(self) -> bool:
        """Whether controllers may start or end."""
        held = self.held
        return held.active is not held.cycle.active or (
            self.news.requests is not held.requests and bool(self.new_requests)
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
        surroundings: Surroundings,
    ) -> None:
        """Create it."""
        self._lifecycle = lifecycle
        self._claimants = claimants
        self._drive = drive
        self._limits = limits
        order = surroundings.measured
        self._measured_at = [
            [order.index(f"{joint}/{name}") for joint in drive.joints]
            for name in interfaces.STATE_INTERFACES
        ]

    def begin(
        self, readings: Readings, number: int, time_ns: int, period_ns: int
    ) -> Cycle:
        """Return what controllers are told in a cycle; its times are in [ns]."""
        held, values = readings.held, None
        active, chain = held.active, held.chained
        if readings.is_switching:
            plan = self._lifecycle.switch(held, readings.new_requests)
            active, chain = plan.active, plan.chained
            values, _ = self._seed(readings, plan.mode)
        periods: Mapping[str, int] = _NO_PERIODS
        if self._lifecycle.slow:
            periods = self._lifecycle.periods(held, active, time_ns)
        return Cycle(
            number,
            time_ns,
            period_ns,
            active,
            chain,
            periods,
            values,
            held.ticks,
            readings.news,
        )

    def finish(
        self, ticks: Ticks, asleep: frozenset[str], readings: Readings, cycle: Cycle
    ) -> ManagerState:
        """Return what a cycle leads to, once controllers have ticked."""
        held = readings.held
        active, chain, mode = held.active, held.chained, held.mode
        events, number = held.events, held.next_activation
        values, drive, fresh = held.values, held.drive, None
        if cycle.commands is None:
            values = values.copy()
        else:
            plan = self._lifecycle.switch(held, readings.new_requests)
            # The same as in the plan, and this very object.
            active, chain, mode = cycle.active, plan.chained, plan.mode
            events, number = add_news(events, plan.events), plan.next_activation
            _, drive = self._seed(readings, mode)
            values = cycle.commands.copy()
            fresh = self._claimants.fresh(cycle, held.cycle)
        failed = self._claimants.write(ticks, cycle, held.cycle, values)
        previous, all_limited = held.previous, held.limited
        if self._limits is not None:
            previous, limited = self._limit(
                readings, cycle, active, values, failed, is_fresh=fresh is not None
            )
            news = [CommandLimited(j) for j in limited if j not in held.limited]
            if news:
                events = add_news(events, news)
                all_limited |= {event.joint for event in news}
        last_ns, skipped = held.last_ns, None
        if cycle.periods:
            skipped = self._claimants.skipped(cycle)
            due = {n: cycle.time_ns for n, p in cycle.periods.items() if p}
            last_ns = {**last_ns, **due}
        drive = self._drive.write(mode, values, drive, fresh=fresh, skipped=skipped)
        failing = frozenset(failed)
        if failed and (failing != held.failing or self._lifecycle.ends_failed):
            active, number, told = self._lifecycle.replace(failed, active, number)
            events, chain = add_news(events, told), self._lifecycle.chained(active)
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
            readings.news.requests,
            events,
            previous,
            all_limited,
            failing,
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
        held = readings.held
        previous = held.previous
        if is_fresh:
            previous = self._claimants.forget(previous, cycle, held.cycle)
        previous, limited, lost = self._limits.apply(
            self._lifecycle.claims(active),
            values,
            readings.measure(),
            previous,
            cycle.period_ns / NANOSECONDS,
        )
        if lost:
            owners = self._claimants.owners(active, lost)
            self._claimants.restore(values, held.values, owners)
            failed |= owners
        return previous, limited

    def _seed(self, readings: Readings, mode: DriveMode) -> tuple[Array, Array]:
        """Return the values and the drive vector with which a mode starts."""
        held = readings.held
        values, drive = held.values, held.drive
        if held.cycle.number < 0:
            return values, drive
        measured = readings.measure()
        q, v, tau = (measured[at] for at in self._measured_at)
        return self._drive.seed(held.mode, mode, values, drive, (q, v, tau))


class StoredStates:
    """State interfaces that follow a command interface of their name, or nothing."""

    def __init__(self, surroundings: Surroundings, commands: Sequence[str]) -> None:
        """Create it."""
        order = tuple(surroundings.stored)
        mirrored = [name for name in order if name in commands]
        self._here = [order.index(name) for name in mirrored]
        self._there = [commands.index(name) for name in mirrored]

    def update(self, stored: Array, values: Array) -> Array:
        """Return the states after commands; what was never commanded stays.

        Args:
            stored: The states before.
            values: Command values, shape (k,).
        """
        new, stored = values[self._there], stored.copy()
        stored[self._here] = np.where(np.isnan(new), stored[self._here], new)
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
        - ticks
        - news

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
    ticks              --    --       ManagerState: the last ticks of the controllers
    news               --    --       News: what lies on all ports of messages
    =================  ====  =======  ==================================================

    Further input ports, `command_interfaces:<controller>`, are what their ticks leave
    behind, and `inbox:<controller>` what lies on their topics.

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
        surroundings: Surroundings,
        limits: CommandLimits | None = None,
        keep: object = None,
    ) -> None:
        """Create the system; `RobotSystems` does that."""
        super().__init__()
        self.robot = robot
        # Its load report, with what its controllers lack.
        self.report = report
        self.controllers = tuple(controllers)
        # Start of the names of the robot's ports and systems.
        self.prefix = prefix
        # Periods of the manager, and of the log of joints' states, in Drake's time [s].
        self.period = period
        self.log_period = log_period
        self.commands = command_order(surroundings, self.controllers)
        # What must live as long as the diagram, such as the servo's plant.
        self._keep = keep
        self._update_rate = robot.controllers.update_rate
        self._drive = drive
        systems = {c.name: c.system for c in self.controllers if c.system is not None}
        self._lifecycle = self._make_lifecycle(systems, surroundings)
        nothing, J = AbstractValue.Make(()), len(surroundings.joint_types)
        self._switch = self.DeclareAbstractInputPort(SWITCH_PORT, nothing)
        self._measured = self.DeclareVectorInputPort(interfaces.STATE_PORT, 3 * J)
        self._keeper = TickKeeper(
            systems,
            self.DeclareVectorInputPort(interfaces.MOTIONS_PORT, 2 * J),
            lambda name: self.DeclareAbstractInputPort(name, nothing),
        )
        claimants = Claimants(systems, self.commands, drive.joints)
        self._loop = Loop(self._lifecycle, claimants, drive, limits, surroundings)
        state = self._start(surroundings)
        kept = self.DeclareAbstractState(AbstractValue.Make(state))
        self._state_index = int(kept)
        self._cycle = self._declare_read("cycle", self._calc_cycle, is_of_now=True)
        flags = [float(c.name in state.active) for c in self.controllers]
        start = (state.values, drive.told(state.drive), flags)
        numbers = [self.DeclareDiscreteState(x) for x in start]
        self._values, self._drive_state, self._flags = map(int, numbers)
        self._stored = None
        if surroundings.stored:
            self._stored_states = StoredStates(surroundings, self.commands)
            self._stored = self.DeclareDiscreteState(list(surroundings.stored.values()))
            self.DeclareStateOutputPort(STORED_PORT, self._stored)
        self._declare_shown(kept, numbers)
        # Computed anew only when something is put on a port.
        self._news = self._declare_read("news", self._calc_news)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _make_lifecycle(
        self, systems: Mapping[str, ControllerInterface], surroundings: Surroundings
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
            refuse=surroundings.refuse,
        )

    def _start(self, surroundings: Surroundings) -> ManagerState:
        """Return the state before the first cycle, in which controllers start."""
        drive, initial = self._drive, surroundings.initial_positions
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
        more = {self.time_ticket(), self.xa_ticket(), self._measured.ticket()}
        return self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            calc,
            prerequisites_of_calc={
                *(port.ticket() for port in ports),
                *(more if is_of_now else ()),
            },
        )

    def _declare_shown(
        self, kept: AbstractStateIndex, numbers: Iterable[DiscreteStateIndex]
    ) -> None:
        """Declare the ports that show the state."""
        self._declare(
            "controllers", lambda state: list_states(self.controllers, state.active)
        )
        self._declare("events", lambda state: state.events)
        claimed = self._lifecycle.claimed
        self._declare(interfaces.CLAIMED_PORT, lambda state: claimed(state.active))
        names = (interfaces.VALUES_PORT, "drive", "active")
        for name, index in zip(names, numbers, strict=True):
            self.DeclareStateOutputPort(name, index)
        self.DeclareStateOutputPort(interfaces.TICKS_PORT, kept)

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
        state: ManagerState = context.get_abstract_state(self._state_index).get_value()
        return state

    def _declare(self, name: str, calc: Callable[[ManagerState], object]) -> None:
        self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            lambda context, output: output.set_value(calc(self._state(context))),
            prerequisites_of_calc={self.xa_ticket()},
        )

    def _calc_news(self, context: Context, output: AbstractValue) -> None:
        requests = messages_on(self._switch, context, SwitchController)
        output.set_value(self._keeper.read_news(context, requests))

    def _calc_cycle(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._find_cycle(context, self._state(context)))

    def _find_cycle(self, context: Context, held: ManagerState) -> Cycle:
        number = cycle_at(context.get_time(), self.period)
        if number is None or number == held.cycle.number:
            return held.cycle._replace(ticks=held.ticks)
        times = cycle_times(number, self.period, self._update_rate)
        news = self._news.Eval(context)
        readings = Readings(held, news, partial(self._measured.Eval, context))
        return self._loop.begin(readings, number, *times)

    def _update(self, context: Context, state: State) -> None:
        held: ManagerState = context.get_abstract_state(self._state_index).get_value()
        if self._keeper.are_direct:
            cycle = self._find_cycle(context, held)
        else:  # Others ask for it too, and the port remembers it.
            cycle = self._cycle.Eval(context)
        if cycle.number == held.cycle.number:
            return
        news = cast(News, cycle.news)
        readings = Readings(held, news, partial(self._measured.Eval, context))
        ticks, asleep = self._keeper.run(context, cycle, held)
        new = self._loop.finish(ticks, asleep, readings, cycle)
        state.get_mutable_abstract_state(self._state_index).set_value(new)
        numbers = state.get_mutable_discrete_state()
        numbers.set_value(self._values, new.values)
        numbers.set_value(self._drive_state, self._drive.told(new.drive))
        if cycle.commands is not None:
            flags = [float(c.name in cycle.active) for c in self.controllers]
            numbers.set_value(self._flags, flags)
        if self._stored is not None:
            stored = context.get_discrete_state(self._stored).value()
            stored = self._stored_states.update(stored, new.values)
            numbers.set_value(self._stored, stored)
