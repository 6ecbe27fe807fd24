"""Wiring: systems added to a diagram, connected to what they read."""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    OutputPort,
    System,
)
from pydrake.systems.primitives import (
    ConstantVectorSource,
    MatrixGain,
    Selector,
    SelectorParams,
)

from arm_drake.arrays import Array
from arm_drake.importing import dataclass


class Source(NamedTuple):
    """An input of a diagram, for several systems to read."""

    name: str
    num_values: int

    def size(self) -> int:
        """Return how many values it has, as a port does."""
        return self.num_values


# What systems of a diagram read.
Port: TypeAlias = OutputPort | Source


@dataclass(frozen=True)
class Wiring:
    """Adds systems to a builder, connected to what they read.

    Each system costs at every step, whatever it computes: some 3000 instructions of
    events and caches. So inputs are read without one between, and what is picked from
    several ports comes from one.
    """

    builder: DiagramBuilder

    # Inputs of the diagram that somebody reads.
    _sources: set[str] = dc.field(default_factory=set)

    def build(self, name: str) -> Diagram:
        """Return the diagram of all that was added."""
        diagram = self.builder.Build()
        diagram.set_name(name)
        return diagram

    def connect(self, port: Port, target: InputPort) -> None:
        """Let a system read a port, or an input of the diagram."""
        if isinstance(port, OutputPort):
            self.builder.Connect(port, target)
        elif port.name in self._sources:
            self.builder.ConnectInput(port.name, target)
        else:
            self.builder.ExportInput(target, port.name)
            self._sources.add(port.name)

    def join(self, name: str, ports: Sequence[Port]) -> OutputPort:
        """Return ports one after another."""
        return self.pick(name, range(sum(port.size() for port in ports)), *ports)

    def pick(self, name: str, rows: Sequence[int], *ports: Port) -> OutputPort:
        """Return some of what ports have, one after another."""
        (first, *others) = ports
        is_all = not others and [*rows] == [*range(first.size())]
        if is_all and isinstance(first, OutputPort):
            return first
        return self.pick_all(name, {"y": rows}, *ports)["y"]

    def pick_all(
        self, name: str, rows: Mapping[str, Sequence[int]], *ports: Port
    ) -> dict[str, OutputPort]:
        """Return several ports of one system, each with some of what ports have."""
        places = [(k, i) for k, port in enumerate(ports) for i in range(port.size())]
        params = SelectorParams(
            inputs=[
                SelectorParams.InputPortParams(name=f"u{k}", size=port.size())
                for k, port in enumerate(ports)
            ],
            outputs=[
                SelectorParams.OutputPortParams(
                    name=output,
                    selections=[
                        SelectorParams.OutputSelection(
                            input_port_index=places[row][0], input_offset=places[row][1]
                        )
                        for row in picked
                    ],
                )
                for output, picked in rows.items()
            ],
        )
        system = self.builder.AddNamedSystem(name, Selector(params))
        for index, port in enumerate(ports):
            self.connect(port, system.get_input_port(index))
        return {output: system.GetOutputPort(output) for output in rows}

    def add(self, name: str, system: System, *read: Port) -> OutputPort:
        """Add a system of one output, and of one input if it reads anything."""
        self.builder.AddNamedSystem(name, system)
        if read:
            port = read[0] if len(read) == 1 else self.join(f"{name}:inputs", read)
            self.connect(port, system.get_input_port(0))
        return system.get_output_port(0)

    def times(self, name: str, matrix: Array, *ports: Port) -> OutputPort:
        """Return a matrix times ports; a port itself if that changes nothing."""
        if not len(matrix):
            return self.add(name, ConstantVectorSource(np.zeros(0)))
        is_one = matrix == 1.0
        if (is_one.sum(axis=1) == 1).all() and ((matrix == 0.0) | is_one).all():
            return self.pick(name, is_one.argmax(axis=1).tolist(), *ports)
        return self.add(name, MatrixGain(matrix), *ports)

    def inverse_dynamics(
        self, name: str, plant: MultibodyPlant, state: Port, acceleration: OutputPort
    ) -> OutputPort:
        """Return the efforts of all joints for their accelerations."""
        mode = InverseDynamics.InverseDynamicsMode.kInverseDynamics
        dynamics = self.builder.AddNamedSystem(name, InverseDynamics(plant, mode))
        for port, target in (
            (state, dynamics.get_input_port_estimated_state()),
            (acceleration, dynamics.get_input_port_desired_acceleration()),
        ):
            self.connect(port, target)
        return dynamics.get_output_port_generalized_force()
