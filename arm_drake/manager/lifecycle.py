"""Which controllers are active, and which are due: what a manager decides.

Follows ros2_control's controller_manager (6.8.0): requests are judged by `switching`, a
controller whose update fails is deactivated with its chain, and its fallback
controllers take over.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.drive_mode import DriveMode
from arm_drake.controllers.cycles import Cycle, Tick
from arm_drake.manager.plan import SwitchPlan, plan_switch
from arm_drake.manager.state import ControllerFailure, Event, ManagerState
from arm_drake.manager.switching import ControllerInfo, chain_of, chained
from arm_drake.manager.update_schedule import due_period
from arm_drake.messages import NANOSECONDS, SwitchController, SwitchControllerResult

# Why hardware can't start and stop these command interfaces; "" if it can.
Refusal = Callable[[Collection[str], Collection[str]], str]


_NO_PERIODS: Mapping[str, int] = MappingProxyType({})


class Activation(NamedTuple):
    """Which controllers are active after a switch."""

    active: Mapping[str, int]
    chained: frozenset[str]
    mode: DriveMode
    next_activation: int
    events: tuple[Event, ...]


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

        Args:
            infos: What is to be known of the controllers, by name.
            rates: Rates of those that are configured [Hz].
            fallback: Controllers that start when one fails, by its name.
            drive: What follows the commands.
            update_rate: Rate of the manager [Hz].
            distro: Distribution whose behaviour holds.
            refuse: Tells why the hardware can't switch, if it ever does.
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
        self._slow = {name for name, rate in rates.items() if rate < update_rate}

    def start(
        self,
        started: Iterable[str],
        values: Array,
        drive: Array,
        ticks: Mapping[str, Tick[Any]] = MappingProxyType({}),
    ) -> ManagerState:
        """Return the state before the first cycle, in which controllers start.

        Args:
            started: Names of the controllers.
            values: Values of the command interfaces, shape (k,).
            drive: What the drive is told.
            ticks: What there is of the controllers' ticks.
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
        )
        if self._refuse is not None and (plan.activate or plan.deactivate):
            start, stop = self.claims(plan.activate), self.claims(plan.deactivate)
            fault = self._refuse(start.keys(), stop.keys())
            if fault:
                return SwitchPlan((), (), False, (*plan.problems, fault))
        return plan

    def switch(
        self, held: ManagerState, requests: Iterable[SwitchController]
    ) -> Activation:
        """Return which controllers are active in a cycle.

        Args:
            held: State after the last cycle.
            requests: New requests, one after the other.
        """
        active, number = dict(held.active), held.next_activation
        events: list[Event] = []
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
        self, held: ManagerState, active: Mapping[str, int], time_ns: int
    ) -> Mapping[str, int]:
        """Return the time since the last tick of controllers with their own rate [ns].

        It is 0 for those that don't tick.

        Args:
            held: State after the last cycle.
            active: Which controllers are active in this one.
            time_ns: Its time [ns].
        """
        if not self._slow:
            return _NO_PERIODS
        periods = {}
        for name in self._slow & active.keys():
            is_new = active[name] != held.cycle.active.get(name)
            due = due_period(
                time_ns,
                None if is_new else held.last_ns.get(name),
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
    ) -> tuple[Mapping[str, int], int, tuple[Event, ...]]:
        """Return what is active after updates failed.

        Args:
            failed: Controllers whose update failed, and why.
            active: Which controllers were active.
            number: Number of the next activation.

        Returns:
            Active controllers, number of the next activation, and the news of it.
        """
        if not self.ends_failed:
            told = (ControllerFailure(n, (), reason=why) for n, why in failed.items())
            return active, number, tuple(told)
        remaining, news = dict(active), []
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
            news.append(
                ControllerFailure(name, chain, plan.activate, reason, plan.problems)
            )
        return remaining, number, tuple(news)

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
