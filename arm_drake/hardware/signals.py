"""What the laws of a servo read, as symbolic variables."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.symbolic import Expression, Variable, if_then_else
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.systems.primitives import SymbolicVectorSystem

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import (
    NUM_LIMITS,
    NUM_PARTS,
    NUM_PARTS_OF_POSITIONS,
)

# Above it a flag is set.
_FLAG = 0.5

# What stands for no limit where one may be told: far more than any joint has.
_NO_LIMIT = 1e12


@dc.dataclass(frozen=True)
class Layout:
    """Where n commanded joints stand in a robot's state, and what they are told."""

    num_states: int
    positions_at: Sequence[int]
    velocities_at: Sequence[int]

    # Whether joints may follow anything else than positions.
    has_modes: bool

    # Whether effort and velocity may be limited at run time.
    has_limits: bool = False

    @property
    def num_joints(self) -> int:
        """Number of commanded joints n."""
        return len(self.positions_at)

    def pick(self, *parts: int) -> Array:
        """Return the matrix that picks parts of a command."""
        n = self.num_joints
        rows = [k * n + i for k in parts for i in range(n)]
        return np.eye(self.num_told)[rows]

    @property
    def num_parts(self) -> int:
        """Number of parts of the command, without limits."""
        return NUM_PARTS if self.has_modes else NUM_PARTS_OF_POSITIONS

    @property
    def num_told(self) -> int:
        """Size of the command."""
        parts = self.num_parts + (NUM_LIMITS if self.has_limits else 0)
        return parts * self.num_joints


class Command:
    """Variables of a command, n for each of its parts."""

    def __init__(self, layout: Layout) -> None:
        """Name them."""
        n = layout.num_joints
        self.variables = variables("c", layout.num_told)
        split = [self.variables[k : k + n] for k in range(0, layout.num_told, n)]
        self.q_d, self.v_d = split[:NUM_PARTS_OF_POSITIONS]
        rest = split[NUM_PARTS_OF_POSITIONS : layout.num_parts] or [[]] * 5
        self.effort_limit, self.velocity_limit = split[layout.num_parts :] or [[]] * 2
        self.a_d, self.tau_d, self.is_v, self.is_a, self.is_tau = rest


def variables(name: str, number: int) -> list[Variable]:
    """Return numbered variables."""
    return [Variable(f"{name}{i}") for i in range(number)]


def is_set(flag: Variable | Expression) -> object:
    """Return the condition that a flag is 1, not 0."""
    return flag > _FLAG


def clamp(value: Expression, limit: float | Expression) -> Expression:
    """Return a value within ±limit; an infinite limit changes nothing."""
    if isinstance(limit, float) and not np.isfinite(limit):
        return value
    return max_(-limit, min_(value, limit))


def lower_of(limit: float, told: Variable | Expression) -> Expression:
    """Return a limit, or one that is told if it is lower; 0 is none."""
    most = limit if np.isfinite(limit) else _NO_LIMIT
    return if_then_else(told > 0.0, min_(told, most), Expression(most))


def function(
    inputs: Sequence[Variable], outputs: Sequence[Expression]
) -> SymbolicVectorSystem:
    """Return a system without state."""
    return SymbolicVectorSystem(input=np.array(inputs), output=np.array(outputs))
