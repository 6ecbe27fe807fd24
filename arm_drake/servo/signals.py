"""What the laws of a servo read, as symbolic variables."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.symbolic import Expression, Variable
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.control.drive_commands import NUM_PARTS, NUM_PARTS_OF_POSITIONS
from arm_drake.control.servo import Array

# Above it a flag is set.
_FLAG = 0.5


@dc.dataclass(frozen=True)
class Layout:
    """Where n commanded joints stand in a robot's state, and what they are told."""

    num_states: int
    positions_at: Sequence[int]
    velocities_at: Sequence[int]

    # Whether joints may follow anything else than positions.
    has_modes: bool

    @property
    def num_joints(self) -> int:
        """Number of commanded joints n."""
        return len(self.positions_at)

    def pick(self, *parts: int) -> Array:
        """Return the matrix that picks parts of a command with modes."""
        n = self.num_joints
        rows = [k * n + i for k in parts for i in range(n)]
        return np.eye(NUM_PARTS * n)[rows]

    @property
    def num_told(self) -> int:
        """Size of the command."""
        parts = NUM_PARTS if self.has_modes else NUM_PARTS_OF_POSITIONS
        return parts * self.num_joints


class Command:
    """Variables of a command, n for each of its parts."""

    def __init__(self, layout: Layout) -> None:
        """Name them."""
        n = layout.num_joints
        self.variables = variables("c", layout.num_told)
        split = [self.variables[k : k + n] for k in range(0, layout.num_told, n)]
        self.q_d, self.v_d = split[:NUM_PARTS_OF_POSITIONS]
        rest = split[NUM_PARTS_OF_POSITIONS:] or [[]] * 5
        self.a_d, self.tau_d, self.is_v, self.is_a, self.is_tau = rest


def variables(name: str, number: int) -> list[Variable]:
    """Return numbered variables."""
    return [Variable(f"{name}{i}") for i in range(number)]


def is_set(flag: Variable | Expression) -> object:
    """Return the condition that a flag is 1, not 0."""
    return flag > _FLAG


def clamp(value: Expression, limit: float) -> Expression:
    """Return a value within ±limit; an infinite limit changes nothing."""
    return max_(-limit, min_(value, limit)) if np.isfinite(limit) else value


def function(
    inputs: Sequence[Variable], outputs: Sequence[Expression]
) -> SymbolicVectorSystem:
    """Return a system without state."""
    return SymbolicVectorSystem(input=np.array(inputs), output=np.array(outputs))
