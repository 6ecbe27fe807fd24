"""What the tick of a controller reads, and where its last one is."""

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface_part import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.cycles import Now, Tick
from arm_drake.controllers.kept_ticks import KeptTicks, OwnTicks

S = TypeVar("S")


class TickReader(ControllerInterface, Generic[S]):
    """Base of controllers that tick: measurements, commands, references, last tick."""

    def __init__(
        self, params: ControllerInterfaceParams, initial: S, **names: Any
    ) -> None:
        """Create the system with what it reads.

        Args:
            params: Rate and surroundings of the controller.
            initial: State before the first tick.
            names: Interfaces, as in ControllerInterface.
        """
        super().__init__(params, **names)
        # At most one port with the values of all command interfaces, and where those of
        # this one stand there.
        self._values: list[InputPort] = []
        self._values_at: list[tuple[int, int]] = []
        # Of each controller that may command references: its port, and where its
        # commands stand among them.
        self._predecessors: list[tuple[str, InputPort, list[int], list[int]]] = []
        self._no_references = np.full(len(self.reference_interfaces), np.nan)
        self.first_tick: Tick[S] = Tick(
            None, None, initial, np.full(len(self.command_interfaces), np.nan)
        )
        make = KeptTicks if params.is_managed else OwnTicks
        self._ticks: KeptTicks[S] = make(self, params, self.first_tick)

    def add_command_values(self, order: Sequence[str]) -> InputPort:
        """Declare the port of what all command interfaces hold.

        Args:
            order: Their names, in the order of the port.
        """
        at = {name: index for index, name in enumerate(order)}
        port = self.DeclareVectorInputPort(interfaces.VALUES_PORT, len(order))
        self._values.append(port)
        self._values_at.extend(
            (i, at[n]) for i, n in enumerate(self.command_interfaces) if n in at
        )
        return port

    def add_predecessor(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of a controller that commands references of this one.

        Args:
            controller: One whose command interfaces are among the references.
        """
        names = controller.command_interfaces
        here = [i for i, ref in enumerate(self.reference_interfaces) if ref in names]
        there = [names.index(self.reference_interfaces[i]) for i in here]
        name = controller.params.controller_name
        port = self.DeclareAbstractInputPort(
            f"{interfaces.CHAIN_PORT}{name}", AbstractValue.Make(())
        )
        self._predecessors.append((name, port, here, there))
        return port

    def _state(self, context: Context) -> S:
        """Return the state that the last tick left."""
        return self._ticks.last(context).state

    def _measured_now(self, now: Now) -> Array:
        """Return the measured `state_interfaces`; NaN where there is none."""
        if now.given is None:
            return self._read(now.context)
        return now.given.motions[self._read_at]

    def _read_commands(self, now: Now) -> Array:
        """Return the present values of the command interfaces, shape (k,).

        NaN is what was never written. References of other controllers are what was
        written to them last.
        """
        _, last = self._ticks.at(now.context, now.cycle)
        values = np.array(last.command)
        for port in self._values:
            present = now.cycle.commands
            if present is None:
                given = now.given
                present = port.Eval(now.context) if given is None else given.values
            for i, at in self._values_at:
                values[i] = present[at]
        return values

    def _read_references(self, now: Now) -> Array | None:
        """Return what other controllers command, NaN where none does; None if none.

        Shape (number of reference_interfaces,).
        """
        if self.params.controller_name not in now.cycle.chained:
            return None
        references = self._no_references.copy()
        for name, port, here, there in self._predecessors:
            if name in now.cycle.active:
                references[here] = port.Eval(now.context).command[there]
        return references
