"""Drives one ticking controller cycle by cycle, as its manager and its robot would."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, UpdateResult

NAME = "controller"


def make_params(
    joints: tuple[str, ...], *, distro: str = "jazzy", rate: int = 100
) -> ControllerInterfaceParams:
    """Return surroundings of revolute joints with all standard interfaces."""
    everything = interfaces.interface_names(joints, interfaces.STATE_INTERFACES)
    return ControllerInterfaceParams(
        controller_name=NAME,
        update_rate=rate,
        period=1.0 / rate,
        joint_types=dict.fromkeys(joints, "revolute"),
        command_interfaces=frozenset(everything),
        state_interfaces=frozenset(everything),
        measured=everything,
        distro=distro,
    )


class Driven:
    """A controller, and what its command interfaces hold."""

    def __init__(
        self, system: TickingController[Any], command_values: tuple[float, ...] = ()
    ) -> None:
        """Take a system; ``command_values`` is what its command interfaces hold, else
        NaN."""
        self.system = system
        self.predecessor = system.add_predecessor(
            ControllerInterface(
                ControllerInterfaceParams(
                    "other", 1, 1.0, {}, frozenset(), frozenset(), ()
                ),
                command_interfaces=system.reference_interfaces,
            )
        )
        claims = system.command_interfaces
        self._values = system.add_command_values(claims)
        self.command_values = np.array(command_values or [np.nan] * len(claims))
        self.simulator = Simulator(system)
        self.context = self.simulator.get_mutable_context()
        self.cycle = -1
        self.measure([0.0] * system.GetInputPort(interfaces.STATE_PORT).size())

    def measure(self, values: Any) -> None:
        """Set what is measured: positions, then velocities of all joints."""
        port = self.system.GetInputPort(interfaces.STATE_PORT)
        full = np.zeros(port.size())
        full[: len(values)] = values
        port.FixValue(self.context, full)

    def run(
        self,
        topics: Mapping[str, Any] | None = None,
        *,
        activation: int | None = 1,
        references: Any = None,
    ) -> UpdateResult[Any]:
        """Run one cycle and return what it leaves behind.

        Args:
            topics: What to put on input ports.
            activation: Number of the activation; None is inactive.
            references: What another controller commands, if any.
        """
        self.cycle += 1
        for name, message in (topics or {}).items():
            self.system.GetInputPort(name).FixValue(self.context, message)
        active = {} if activation is None else {NAME: activation}
        if references is not None:
            active["other"] = 0
            tick = UpdateResult(self.cycle, 0, None, np.array(references, dtype=float))
            self.predecessor.FixValue(self.context, tick)
        period_ns = round(1e9 * self.system.params.period)
        self.system.GetInputPort(interfaces.MANAGER_PORT).FixValue(
            self.context,
            Cycle(
                self.cycle,
                self.cycle * period_ns,
                period_ns,
                active,
                frozenset([NAME] if references is not None else []),
            ),
        )
        self._values.FixValue(self.context, self.command_values)
        self.simulator.AdvanceTo((self.cycle + 0.5) * self.system.params.period)
        tick = self.context.get_abstract_state(0).get_value()
        self.command_values = np.where(
            np.isnan(tick.command), self.command_values, tick.command
        )
        return tick

    def output(self, name: str) -> Any:
        """Return what is on an output port."""
        return self.system.GetOutputPort(name).Eval(self.context)

    def reasons(self) -> list[str]:
        """Return why messages weren't accepted, the latest last."""
        return [event.reason for _, event in self.output("events")]
