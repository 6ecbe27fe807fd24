"""Lifecycle, update rates and ticks of controllers, and the commands that they write.

The rules are those of ros2_control's controller_manager (6.8.0,
``ControllerManager::update`` and ``configure_controller``): requests are judged by
`switching`, a controller whose update fails is deactivated with its chain, and its
fallback controllers take over; one with a lower update rate runs in the nearest ticks.
Times are integer nanoseconds, rates are [Hz].
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
    PortDataType,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.drive_commands import DriveCommands, DriveMode
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, HardwareValues, UpdateResult
from arm_drake.description.parameters import DISTROS
from arm_drake.errors import ParameterError
from arm_drake.manager.claimants import Claimants, UpdateResults
from arm_drake.manager.state import ControllerFailure, ManagerEvent, ManagerState
from arm_drake.manager.steady_cycles import SteadyCycles
from arm_drake.manager.switching import (
    ControllerInfo,
    SwitchPlan,
    chain_of,
    chained,
    plan_switch,
)
from arm_drake.messages import NANOSECONDS, SwitchController, SwitchControllerResult


def effective_rate(requested: int, manager_rate: int, *, distro: str = "jazzy") -> int:
    """Return the rate [Hz] that a controller gets for what its YAML requests; 0 is all.

    It is never above the manager's. From kilted on, one that doesn't divide the
    manager's is the manager's divided by a whole number, cut to whole Hz; up to jazzy
    it stays as it is, and the controller runs in the nearest ticks. A negative one is a
    ParameterError.
    """
    if requested < 0:
        problem = f"expected a rate above 0, or 0 for the manager's, got {requested}"
        raise ParameterError(problem, where="update_rate")
    if requested == 0 or requested >= manager_rate:
        return manager_rate
    if DISTROS.index(distro) < DISTROS.index("kilted"):
        return requested
    # The nearest whole number, half rounded up as C++ does; Python's round doesn't.
    divisor = (2 * manager_rate + requested) // (2 * requested)
    return manager_rate // divisor


def due_period(
    time_ns: int,
    last_ns: int | None,
    update_rate: int,
    manager_rate: int,
    manager_period_ns: int,
) -> int | None:
    """Return the period of the update due at a tick of the manager, or None.

    An update is due at the tick that is nearest to one period after the last update;
    of two as near, floating-point rounding decides, as it does upstream. The first
    tick after the activation always is.
    """
    if last_ns is None:
        if update_rate >= manager_rate:
            return manager_period_ns
        return int(1.0 / update_rate * NANOSECONDS)
    period_ns = time_ns - last_ns
    if update_rate >= manager_rate:
        return period_ns
    period = period_ns / NANOSECONDS
    error_now = abs(period * update_rate - 1.0)
    error_later = abs((period + 1.0 / manager_rate) * update_rate - 1.0)
    return period_ns if error_now <= error_later else None


# Why hardware can't start and stop these command interfaces; "" if it can.
Refusal = Callable[[Collection[str], Collection[str]], str]


class Activation(NamedTuple):
    """Active controllers after a switch."""

    active: Mapping[str, int]
    chained: frozenset[str]
    mode: DriveMode
    next_activation: int
    events: tuple[ManagerEvent, ...]


class Lifecycle:
    """Decides which controllers of a robot are active, and which are due."""

    def __init__(
        self,
        infos: Mapping[str, ControllerInfo],
        rates: Mapping[str, int],
        fallback: Mapping[str, tuple[str, ...]],
        drive: DriveCommands,
        *,
        update_rate: int,
        distro: str = "jazzy",
        refuse: Refusal | None = None,
    ) -> None:
        """Create it.

        `infos` are of all controllers, `rates` [Hz] of those that are configured, by
        name; `fallback` has those that start when one fails. `refuse` tells why the
        hardware can't switch, if it ever does.
        """
        self._refuse = refuse
        self._infos = infos
        self._rates = rates
        self._fallback = fallback
        self._drive = drive
        self._update_rate = update_rate
        self._period_ns = NANOSECONDS // update_rate
        self._distro = distro
        # Whether requests that don't say so are all or nothing.
        self._is_strict = distro == "rolling"
        # Those with a rate of their own.
        self.slow = {name for name, rate in rates.items() if rate < update_rate}

    def start(
        self,
        started: Iterable[str],
        values: Array,
        drive: Array,
        ticks: Mapping[str, UpdateResult[Any]] = MappingProxyType({}),
    ) -> ManagerState:
        """Return the state before the first cycle, in which controllers start.

        `values` are those of the command interfaces, shape (k,).
        """
        active = {name: number for number, name in enumerate(started)}
        return ManagerState(
            cycle=Cycle(-1, 0, 0, {}),
            active=active,
            chained=chained(self._infos, active),
            mode=self._mode(active),
            next_activation=len(active),
            values=values,
            drive=drive,
            last_ns={},
            ticks=ticks,
        )

    def judge(self, active: Collection[str], request: SwitchController) -> SwitchPlan:
        """Return what a request leads to when these controllers are active."""
        strictness = request.strictness
        plan = plan_switch(
            self._infos,
            active,
            request.activate_controllers,
            request.deactivate_controllers,
            strict=self._is_strict if not strictness else strictness == "strict",
            is_humble=self._distro == "humble",
        )
        if self._refuse is not None and (plan.activate or plan.deactivate):
            start, stop = self.claims(plan.activate), self.claims(plan.deactivate)
            fault = self._refuse(start.keys(), stop.keys())
            if fault:
                return SwitchPlan((), (), False, (*plan.problems, fault))
        return plan

    def switch(
        self, state: ManagerState, requests: Iterable[SwitchController]
    ) -> Activation:
        """Return which controllers are active in a cycle."""
        active, number = dict(state.active), state.next_activation
        events: list[ManagerEvent] = []
        for request in requests:
            plan = self.judge(active, request)
            for name in plan.deactivate:
                del active[name]
            for name in (*plan.activate, *plan.restart):
                active[name] = number
                number += 1
            text = "; ".join(plan.problems)
            events.append(SwitchControllerResult(request, plan.ok, text))
        mode, chain = self._mode(active), chained(self._infos, active)
        return Activation(active, chain, mode, number, tuple(events))

    def periods(
        self, state: ManagerState, active: Mapping[str, int], time_ns: int
    ) -> Mapping[str, int]:
        """Return the time since the last tick of controllers with their own rate [ns].

        It is 0 for those that don't tick.
        """
        periods = {}
        for name in self.slow & active.keys():
            is_new = active[name] != state.cycle.active.get(name)
            due = due_period(
                time_ns,
                None if is_new else state.last_ns.get(name),
                self._rates[name],
                self._update_rate,
                self._period_ns,
            )
            periods[name] = due or 0
        return periods

    @property
    def ends_failed(self) -> bool:
        """Whether a controller whose update fails is deactivated; humble's isn't."""
        return self._distro != "humble"

    def replace(
        self, failed: Mapping[str, str], active: Mapping[str, int], number: int
    ) -> tuple[Mapping[str, int], int, tuple[ManagerEvent, ...]]:
        """Return what is active after updates failed."""
        if not self.ends_failed:
            failures = (
                ControllerFailure(n, (), reason=why) for n, why in failed.items()
            )
            return active, number, tuple(failures)
        remaining, failure_events = dict(active), []
        for name, reason in failed.items():
            # Up to kilted its chain stays active without it.
            chain: tuple[str, ...] = (name,)
            if self._distro == "rolling":
                chain = chain_of(self._infos, active, name)
            chain = tuple(other for other in chain if other in remaining)
            for other in chain:
                del remaining[other]
            request = SwitchController(
                activate_controllers=self._fallback.get(name, ()),
                strictness="best_effort",
            )
            plan = self.judge(remaining, request)
            for other in plan.activate:
                remaining[other] = number
                number += 1
            failure_events.append(
                ControllerFailure(name, chain, plan.activate, reason, plan.problems)
            )
        return remaining, number, tuple(failure_events)

    def chained(self, active: Collection[str]) -> frozenset[str]:
        """Return the active controllers whose references another one commands."""
        return chained(self._infos, active)

    def claims(self, active: Iterable[str]) -> dict[str, float]:
        """Return what controllers claim, and their rates [Hz]."""
        return {
            claim: float(self._rates[name])
            for name in active
            for claim in self._infos[name].command_interfaces
        }

    def claimed(self, active: Mapping[str, int]) -> tuple[str, ...]:
        """Return what controllers claim, in the order of their activation."""
        return tuple(self.claims(sorted(active, key=active.__getitem__)))

    def _mode(self, active: Iterable[str]) -> DriveMode:
        names = tuple(active)
        limits = {
            name: kind
            for controller in names
            for name, kind in self._infos[controller].limit_interfaces.items()
        }
        return self._drive.mode(self.claims(names), limits)


_NOTHING = object()


def add_inbox(system: LeafSystem) -> OutputPort:
    """Add an output port with all that lies on the topics of a controller.

    Drake computes it anew only when something is put on one of them, so to see that
    nothing has come takes one look instead of one for each port.
    """
    ports = [
        port
        for port in map(system.get_input_port, range(system.num_input_ports()))
        if port.get_data_type() == PortDataType.kAbstractValued and _is_topic(port)
    ]

    def calc(context: Context, output: AbstractValue) -> None:
        output.set_value(
            tuple(
                port.Eval(context) if port.HasValue(context) else _NOTHING
                for port in ports
            )
        )

    return system.DeclareAbstractOutputPort(
        interfaces.INBOX_PORT,
        lambda: AbstractValue.Make(()),
        calc,
        prerequisites_of_calc={
            system.nothing_ticket(),
            *(system.input_port_ticket(port.get_index()) for port in ports),
        },
    )


def _is_topic(port: InputPort) -> bool:
    name = port.get_name()
    return name == interfaces.PARAMETERS_PORT or not interfaces.is_internal(name)


class ManagerInputs(NamedTuple):
    """Messages on the ports of a manager and of its controllers."""

    requests: tuple[SwitchController, ...]
    inboxes: tuple[object, ...]


class _Member(NamedTuple):
    """A controller that ticks."""

    name: str
    system: TickingController[Any]

    # Where its ticks and what lies on its ports come in.
    ticks: InputPort
    inbox: InputPort

    # Whether it needs no Context in a cycle in which nothing comes.
    is_direct: bool

    # Whether its `rests` counts.
    may_rest: bool


class TickKeeper:
    """Keeps the ticks of all controllers of a manager, and lets them tick."""

    def __init__(
        self,
        systems: Mapping[str, ControllerInterface],
        declare: Callable[[str], InputPort],
        declare_read: Callable[[str], InputPort],
    ) -> None:
        """Create it, and declare ports: of controllers, and of what is measured."""
        ticking = {
            name: system
            for name, system in systems.items()
            if isinstance(system, TickingController) and system.params.is_managed
        }
        # Positions and velocities of all joints; all that is measured, if some that are
        # direct read it.
        self._motions = declare_read(interfaces.MOTIONS_PORT)
        self._measured: InputPort | None = None
        if any(system.is_direct and system.reads_all for system in ticking.values()):
            self._measured = declare_read(interfaces.MEASURED_PORT)
        self._members = {
            name: _Member(
                name,
                system,
                declare(f"{interfaces.COMMAND_PORT}:{name}"),
                declare(f"{interfaces.INBOX_PORT}:{name}"),
                system.is_direct,
                system.may_rest,
            )
            for name, system in ticking.items()
        }
        self.inboxes = [member.inbox for member in self._members.values()]
        self.are_direct = all(
            member.is_direct and not member.system.reference_interfaces
            for member in self._members.values()
        )

    def connect(self, builder: DiagramBuilder, system: TickingController[Any]) -> None:
        """Connect the ports of a controller that is in the builder."""
        member = self._members.get(system.params.controller_name)
        if member is not None:
            builder.Connect(system.GetOutputPort(interfaces.COMMAND_PORT), member.ticks)
            builder.Connect(add_inbox(system), member.inbox)

    @property
    def num_measured(self) -> int:
        """Largest number of values that `measure` returns."""
        return (self._measured or self._motions).size()

    def measure(self, context: Context, *, reads_all: bool) -> Array:
        """Return what direct controllers read, if some of them read all, or none."""
        if reads_all and self._measured is not None:
            motions: Array = self._measured.Eval(context)
            return motions
        motions = self._motions.Eval(context)
        return motions

    def start(self) -> UpdateResults:
        """Return the results before the first cycle."""
        return {name: m.system.first_result for name, m in self._members.items()}

    def run(
        self,
        context: Context,
        cycle: Cycle,
        state: ManagerState,
    ) -> tuple[UpdateResults, frozenset[str]]:
        """Return what a cycle leaves behind, and who has nothing to do after it."""
        inputs, asleep = cycle.inputs, state.asleep
        ticks: dict[str, UpdateResult[Any]] = {}
        hardware: HardwareValues | None = None
        if cycle.commands is not None or inputs is not state.cycle.inputs:
            asleep = frozenset()
        for name, member in self._members.items():
            result = cycle.ticks[name]
            if name not in asleep:
                if (
                    member.is_direct
                    and name not in cycle.chained
                    and cycle.commands is None
                    and result.inputs is inputs
                ):
                    if hardware is None:
                        reads_all = any(
                            m.system.reads_all
                            for name, m in self._members.items()
                            if m.is_direct and name not in asleep
                        )
                        motions = self.measure(context, reads_all=reads_all)
                        hardware = HardwareValues(motions, state.values)
                    result = member.system.tick(cycle, hardware)
                else:
                    result = member.ticks.Eval(context)
            ticks[name] = result
        if ticks.keys() - cycle.active.keys() - asleep:
            asleep = self._find_asleep(ticks, cycle.active)
        return ticks, asleep

    def quiet_controllers(
        self, state: ManagerState
    ) -> tuple[tuple[str, TickingController[Any]], ...] | None:
        """Return who ticks while nothing comes or switches; all others sleep then.

        None if one of them needs its port.
        """
        awake = [m for name, m in self._members.items() if name not in state.asleep]
        for member in awake:
            is_alone = member.name in state.active and member.name not in state.chained
            if not (member.is_direct and is_alone):
                return None
        return tuple((member.name, member.system) for member in awake)

    def _find_asleep(
        self, ticks: UpdateResults, active: Collection[str]
    ) -> frozenset[str]:
        """Return the controllers that have nothing to do until something comes."""
        return frozenset(
            name
            for name, member in self._members.items()
            if name not in active
            and ticks[name].activation is None
            and member.may_rest
            and member.system.rests(ticks[name].state)
        )


class QuietTicks:
    """Ticking controllers of cycles in which nothing comes and nothing switches.

    They follow from the state alone; for the latest state they are remembered.
    """

    def __init__(
        self,
        keeper: TickKeeper | None,
        claimants: Claimants,
        drive: DriveCommands,
        names: Sequence[str],
    ) -> None:
        """Create it for controllers; without a keeper such a cycle is as any other."""
        self._keeper, self._claimants, self._drive = keeper, claimants, drive
        self._names = names
        self._base: ManagerState | None = None
        # What comes after the latest state in plain numbers, if anything does.
        self._steady: SteadyCycles | None = None
        self._offers_steady = True
        self._active: object = None
        self._asleep: object = None
        self._controllers: Collection[tuple[str, TickingController[Any]]] | None = None

    def controllers(
        self, state: ManagerState
    ) -> Collection[tuple[str, TickingController[Any]]] | None:
        """Return them by name; None where such a cycle is as any other."""
        if self._active is not state.active or self._asleep is not state.asleep:
            self._active, self._asleep = state.active, state.asleep
            if self._keeper is not None:
                self._controllers = self._keeper.quiet_controllers(state)
                self._offers_steady = all(
                    type(system).steady is not TickingController.steady
                    for _, system in self._controllers or ()
                )
        return self._controllers

    def steady_cycles(self, base: ManagerState) -> SteadyCycles | None:
        """Return what comes after a state in plain numbers, if anything does."""
        if self._base is not base:
            found = self.controllers(base)
            self._base, self._steady = base, None
            if self._offers_steady:
                self._steady = SteadyCycles.after(
                    base, found, self._claimants, self._drive, self.flags(base)
                )
        return self._steady

    def flags(self, state: ManagerState) -> list[float]:
        """Return 1 for each controller that is active, else 0."""
        return [float(name in state.active) for name in self._names]

    def remember(self, steady: SteadyCycles) -> None:
        """Remember what comes after a state."""
        self._base, self._steady = steady.base, steady
