"""State of the controller manager from cycle to cycle, and its events."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import DriveMode
from arm_drake.control.joint_limits import Previous
from arm_drake.controllers.cycles import Cycle, UpdateResult
from arm_drake.importing import dataclass
from arm_drake.messages import SwitchController, SwitchControllerResult


@dataclass(frozen=True)
class ControllerFailure:
    """Event: a controller was deactivated because its update failed."""

    controller: str

    # What was deactivated, its chain included, and what was activated in its place.
    deactivated: tuple[str, ...]
    activated: tuple[str, ...] = ()

    # Why it failed, and why fallback controllers could not be activated.
    reason: str = ""
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class CommandLimited:
    """Event: a command went beyond a limit of its joint, reported once a joint."""

    joint: str


ManagerEvent = SwitchControllerResult | ControllerFailure | CommandLimited


class ManagerState(NamedTuple):
    """State of the manager between two cycles."""

    # The last cycle; its number is -1 before the first one.
    cycle: Cycle

    # Active controllers from the next cycle on, and the number of their activation.
    active: Mapping[str, int]
    chained: frozenset[str]

    # Which command interfaces the joints follow.
    mode: DriveMode

    # Number of the next activation.
    next_activation: int

    # Values of the command interfaces, shape (k,), and what the drive is told. They are
    # in the discrete state too, for what reads them without Python.
    values: Array
    drive: Array

    # Time of the last tick of controllers with a rate of their own [ns].
    last_ns: Mapping[str, int]

    # The last ticks of the controllers.
    ticks: Mapping[str, UpdateResult[Any]] = MappingProxyType({})

    # Controllers that have nothing to do until something else lies on the ports than
    # in the last cycle.
    asleep: frozenset[str] = frozenset()

    # The requests seen last.
    requests: tuple[SwitchController, ...] = ()

    # The latest events, numbered, the newest last.
    events: tuple[tuple[int, ManagerEvent], ...] = ()

    # What is remembered of joints whose commands are limited.
    previous: Previous = MappingProxyType({})

    # Joints that were commanded beyond a limit so far.
    limited: frozenset[str] = frozenset()

    # Controllers whose update failed in the last cycle.
    failing: frozenset[str] = frozenset()

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self
