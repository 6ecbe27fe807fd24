"""The ``gpio_controllers/GpioCommandController`` and its parameters.

Source: ros2_controllers, `gpio_controllers` (version 6.9.0).
"""

from typing import NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import (
    SteadyCommand,
    SteadyTicks,
    UpdateContext,
    UpdateResult,
)
from arm_drake.controllers.topics import Inbox, TopicController, latest_reason
from arm_drake.description.parameters import (
    check_not_empty,
    check_unique,
    per_element_of,
)
from arm_drake.errors import ParameterError, suggest
from arm_drake.importing import dataclass
from arm_drake.messages import Header, InterfaceValue
from arm_drake.messages.control import DynamicInterfaceGroupValues


@dataclass(frozen=True)
class GpioInterfaces:
    """Interfaces of one GPIO."""

    # Each once.
    interfaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_unique(self, "interfaces")


@dataclass(frozen=True)
class InterfacesByGpio:
    """Interfaces by GPIO."""

    gpio: dict[str, GpioInterfaces] = per_element_of("gpios")


@dataclass(frozen=True)
class GpioCommandControllerParameters:
    """Parameters of a GpioCommandController."""

    # GPIOs of the description; at least one, each once.
    gpios: tuple[str, ...]

    # Interfaces to claim.
    command_interfaces: InterfacesByGpio = InterfacesByGpio()

    # Interfaces to read; if there are none at all, every one that the GPIOs have.
    state_interfaces: InterfacesByGpio = InterfacesByGpio()

    def __post_init__(self) -> None:
        check_not_empty(self, "gpios")
        check_unique(self, "gpios")


class GpioCommandControllerState(NamedTuple):
    """State of a GpioCommandController between two ticks."""

    # What to write, shape (k,); NaN leaves a command interface as it is.
    command: Array

    # What was read, shape (m,); NaN before the first tick.
    measured: Array

    # Whether names and values of the message in effect are as many.
    is_ok: bool = True

    # Time of the last tick [ns].
    time_ns: int = 0

    # Its events are of messages that were not accepted, or not all of them.
    inbox: Inbox = Inbox()


class GpioCommandController(TopicController[GpioCommandControllerState]):
    """Writes the values of a topic to GPIOs, and shows what they report.

    With k command interfaces, one GPIO after the other:

    ==================  ====  =========================================================
    port                size  meaning
    ==================  ====  =========================================================
    controller_manager  --    Cycle: when to tick
    state_interfaces    --    all that is measured
    commands            --    DynamicInterfaceGroupValues: values by GPIO and interface
    command_interfaces  --    UpdateResult; command (k,), in units of the hardware
    gpio_states         --    DynamicInterfaceGroupValues of the last tick, a group for
                              each of ``gpios``; NaN before the first one
    events              --    tuple of the latest (number, TopicRejected), the newest
                              last
    ==================  ====  =========================================================

    The state is a GpioCommandControllerState. The last message holds until the
    controller is deactivated. What it doesn't name stays as it is, as with a value that
    isn't finite. A name that isn't claimed is skipped, with an event; the others are
    written. With another number of values than of names in a group, or fewer of
    ``interface_values`` than of ``interface_groups``, every tick fails and nothing is
    written, where upstream writes the groups before. Without any of the two a message
    takes the last one back.
    """

    reads_by_now = True

    def __init__(
        self,
        parameters: GpioCommandControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        self._gpios = parameters.gpios
        claims = _full_names(parameters.command_interfaces, self._gpios)
        states = _full_names(parameters.state_interfaces, self._gpios)
        if not any(states.values()):
            states = {gpio: _find_states(gpio, params) for gpio in self._gpios}
        command_interfaces = tuple(name for names in claims.values() for name in names)
        state_interfaces = tuple(name for names in states.values() for name in names)
        if not command_interfaces and not state_interfaces:
            has = ", ".join(sorted(params.state_interfaces)) or "none"
            raise ParameterError(
                "no command interface and no state interface is configured, and the "
                f"hardware reports none of {', '.join(self._gpios)}; it has {has}"
            )
        self._places = {name: i for i, name in enumerate(command_interfaces)}
        # Names of the state interfaces of each GPIO, without its own.
        self._names = [
            tuple(name.removeprefix(f"{gpio}/") for name in names)
            for gpio, names in states.items()
        ]
        self._nothing = np.full(len(command_interfaces), np.nan)
        unknown = np.full(len(state_interfaces), np.nan)
        super().__init__(
            params,
            GpioCommandControllerState(self._nothing, unknown),
            state_interfaces=state_interfaces,
            command_interfaces=command_interfaces,
        )
        self._subscribe("commands", DynamicInterfaceGroupValues, self._take)
        self._declare_topic("gpio_states", self._describe)
        self._declare_events()

    def _update(
        self, now: UpdateContext, state: GpioCommandControllerState
    ) -> GpioCommandControllerState:
        state = self._sense(state, now.time_ns, self._measured_now(now))
        return self._receive(now, state)

    def steady(
        self, last: UpdateResult[GpioCommandControllerState], time_ns: int
    ) -> SteadyTicks[GpioCommandControllerState]:
        """Return the command that holds, beside what is read."""
        return SteadyCommand(
            last.command,
            last.state,
            lambda state, at, motions: self._sense(state, at, motions[self._read_at]),
        )

    def _sense(
        self, state: GpioCommandControllerState, time_ns: int, values: Array
    ) -> GpioCommandControllerState:
        """Return the state with what is read, shape (m,)."""
        return state._replace(measured=np.array(values), time_ns=time_ns)

    def _take(
        self,
        state: GpioCommandControllerState,
        message: DynamicInterfaceGroupValues,
        time_ns: int,
    ) -> tuple[GpioCommandControllerState, str]:
        """Return the state with the commands of a message."""
        if fault := _find_fault(message):
            return state._replace(command=self._nothing, is_ok=False), fault
        command, skipped = self._sort(message)
        return state._replace(command=command, is_ok=True), skipped

    def _sort(self, message: DynamicInterfaceGroupValues) -> tuple[Array, str]:
        """Return the values of a message, shape (k,), and what is skipped of it."""
        command, skipped = self._nothing.copy(), []
        groups, values = message.interface_groups, message.interface_values
        for gpio, group in zip(groups, values, strict=False):
            for name, value in zip(group.interface_names, group.values, strict=True):
                full = f"{gpio}/{name}"
                if full in self._places:
                    command[self._places[full]] = value
                else:
                    skipped.append(full)
        if len(groups) != len(values):
            return command, f"{_tell_sizes(message)}; the rest is skipped"
        if not skipped:
            return command, ""
        listed = ", ".join(map(repr, skipped))
        hint = suggest(skipped[0], self._places)
        return command, f"no command interface {listed} here, skipped; {hint}"

    def _activate(
        self, now: UpdateContext, state: GpioCommandControllerState
    ) -> GpioCommandControllerState:
        return state._replace(is_ok=True)

    def _deactivate(
        self, now: UpdateContext, state: GpioCommandControllerState
    ) -> GpioCommandControllerState:
        return state._replace(command=self._nothing)

    def _is_ok(self, state: GpioCommandControllerState) -> bool:
        return state.is_ok

    def _fault(self, state: GpioCommandControllerState) -> str:
        return latest_reason(state.inbox)

    def _describe(
        self, state: GpioCommandControllerState
    ) -> DynamicInterfaceGroupValues:
        """Return the topic gpio_states."""
        values = iter(state.measured.tolist())
        return DynamicInterfaceGroupValues(
            Header.from_nanoseconds(state.time_ns),
            self._gpios,
            tuple(
                InterfaceValue(names, tuple(next(values) for _ in names))
                for names in self._names
            ),
        )


def _full_names(
    chosen: InterfacesByGpio, gpios: tuple[str, ...]
) -> dict[str, tuple[str, ...]]:
    """Return the interfaces that are configured, by GPIO."""
    nothing = GpioInterfaces()
    return {
        gpio: tuple(f"{gpio}/{n}" for n in chosen.gpio.get(gpio, nothing).interfaces)
        for gpio in gpios
    }


def _find_states(gpio: str, params: ControllerInterfaceParams) -> tuple[str, ...]:
    """Return all state interfaces that a GPIO has, in the order of the description."""
    names = (name for name in params.measured if name in params.state_interfaces)
    # Names of interfaces may have slashes, too.
    return tuple(name for name in names if name.startswith(f"{gpio}/"))


def _find_fault(message: DynamicInterfaceGroupValues) -> str:
    """Return why a message makes the update fail; empty if it doesn't."""
    groups, values = message.interface_groups, message.interface_values
    if 0 < len(values) < len(groups):
        return f"{_tell_sizes(message)}; the update fails"
    for index, value in enumerate(values[: len(groups)]):
        num_names, num_values = len(value.interface_names), len(value.values)
        if num_names != num_values:
            return (
                f"interface_values[{index}].values ({groups[index]}) must be as many "
                f"as interface_names, {num_names}, got {num_values}; the update fails"
            )
    return ""


def _tell_sizes(message: DynamicInterfaceGroupValues) -> str:
    groups, values = message.interface_groups, message.interface_values
    return (
        f"interface_values must be as many as interface_groups, {len(groups)}, "
        f"got {len(values)}"
    )
