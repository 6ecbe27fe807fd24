"""The controllers that tick: what lies on their ports, and what their ticks leave."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

from pydrake.systems.framework import Context, DiagramBuilder, InputPort

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.controllers.cycles import Cycle, Given, Tick
from arm_drake.manager.inbox import add_inbox
from arm_drake.manager.state import ManagerState
from arm_drake.messages import SwitchController

Ticks = Mapping[str, Tick[Any]]


class News(NamedTuple):
    """What lies on the ports of a manager and of its controllers."""

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
        motions: InputPort,
        declare: Callable[[str], InputPort],
    ) -> None:
        """Create it.

        Args:
            systems: The controllers, by name.
            motions: Where positions and velocities of all joints come in.
            declare: Declares an abstract input port of the manager.
        """
        self._motions = motions
        self._members = {
            name: _Member(
                name,
                system,
                declare(f"{interfaces.COMMAND_PORT}:{name}"),
                declare(f"{interfaces.INBOX_PORT}:{name}"),
                system.is_direct,
                system.may_rest,
            )
            for name, system in systems.items()
            if isinstance(system, TickingController) and system.params.is_managed
        }
        self.inboxes = [member.inbox for member in self._members.values()]
        self.are_direct = all(member.is_direct for member in self._members.values())

    def connect(self, builder: DiagramBuilder, system: TickingController[Any]) -> None:
        """Connect the ports of a controller that is in the builder.

        Args:
            builder: Where manager and controller are.
            system: The controller.
        """
        member = self._members.get(system.params.controller_name)
        if member is not None:
            builder.Connect(system.GetOutputPort(interfaces.COMMAND_PORT), member.ticks)
            builder.Connect(add_inbox(system), member.inbox)

    def start(self) -> Ticks:
        """Return what there is before the first cycle."""
        return {name: m.system.first_tick for name, m in self._members.items()}

    def read_news(
        self, context: Context, requests: tuple[SwitchController, ...]
    ) -> News:
        """Return what lies on all ports.

        Args:
            context: Context of the manager.
            requests: What lies on its own port.
        """
        return News(requests, tuple(port.Eval(context) for port in self.inboxes))

    def run(
        self,
        context: Context,
        cycle: Cycle,
        held: ManagerState,
    ) -> tuple[Ticks, frozenset[str]]:
        """Return what a cycle leaves behind, and who has nothing to do after it.

        Args:
            context: Context of the manager.
            cycle: The cycle, with what the last one left behind.
            held: What the manager holds.
        """
        news, asleep = cycle.news, held.asleep
        ticks: dict[str, Tick[Any]] = {}
        given: Given | None = None
        if cycle.commands is not None or news is not held.cycle.news:
            asleep = frozenset()
        for name, member in self._members.items():
            tick = cycle.ticks[name]
            if name not in asleep:
                if member.is_direct and cycle.commands is None and tick.news is news:
                    if given is None:
                        given = Given(self._motions.Eval(context), held.values)
                    tick = member.system.tick(cycle, given)
                else:
                    tick = member.ticks.Eval(context)
            ticks[name] = tick
        return ticks, self._find_asleep(ticks, cycle.active, asleep)

    def _find_asleep(
        self, ticks: Ticks, active: Collection[str], last: frozenset[str]
    ) -> frozenset[str]:
        """Return the controllers that have nothing to do until something comes.

        Args:
            ticks: What a cycle has left behind.
            active: Controllers that were active in it.
            last: Those that had nothing to do in it.
        """
        if all(name in active or name in last for name in ticks):
            return last
        return frozenset(
            name
            for name, member in self._members.items()
            if name not in active
            and ticks[name].activation is None
            and member.may_rest
            and member.system.rests(ticks[name].state)
        )
