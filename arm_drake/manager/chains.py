"""Connects controllers that command or read each other."""

import itertools
from collections.abc import Collection, Mapping

from pydrake.systems.framework import DiagramBuilder

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterface


def connect_chains(
    builder: DiagramBuilder, systems: Collection[ControllerInterface]
) -> None:
    """Connect the ticks of controllers that command or read each other.

    As in ros2_control, who commands comes before the commanded, and who exports before
    the reader; so all of them see this very tick. Where both can't be, because who
    exports is commanded by the reader, the reader sees the tick before.

    Args:
        builder: Where the controllers are.
        systems: The controllers of a robot; they don't command each other in a circle.
    """
    # Whose ticks a controller's tick waits for.
    waits: dict[str, set[str]] = {system.get_name(): set() for system in systems}
    pairs = list(itertools.permutations(systems, 2))
    for first, second in pairs:
        if not set(first.command_interfaces).isdisjoint(second.reference_interfaces):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_predecessor(first))
            waits[second.get_name()].add(first.get_name())
    for first, second in pairs:
        if set(first.exported_interfaces).isdisjoint(second.state_interfaces):
            continue
        if (
            isinstance(first, TickingController)
            and isinstance(second, TickingController)
            and not _waits(first.get_name(), second.get_name(), waits)
        ):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_exporter_tick(first))
            waits[second.get_name()].add(first.get_name())
        else:
            held = first.GetOutputPort(interfaces.EXPORT_PORT)
            builder.Connect(held, second.add_exporter(first))


def _waits(name: str, other: str, waits: Mapping[str, Collection[str]]) -> bool:
    """Return whether a controller's tick waits for another's, over however many."""
    found, waiting = {name}, [name]
    while waiting:
        new = set(waits[waiting.pop()]) - found
        found |= new
        waiting += new
    return other in found
