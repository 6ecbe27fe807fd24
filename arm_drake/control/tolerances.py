"""Tolerances of a trajectory: how far joints may be off it, on the way and at its end.

The rules are those of ros2_controllers' joint_trajectory_controller
(``tolerances.hpp``, version 6.9.0). n is the number of joints, in the order of the
controller's `joints`. A tolerance is [rad], [rad/s], [rad/s^2] for a revolute joint and
[m], [m/s], [m/s^2] for a prismatic one; 0 or less means that anything goes.
"""

import dataclasses as dc
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from arm_drake.arrays import Array, Mask
from arm_drake.errors import counted, suggest
from arm_drake.importing import dataclass
from arm_drake.messages import FollowJointTrajectoryGoal, JointTolerance, Message

# In a goal, this value takes a tolerance away.
_ERASE = -1.0

# Less counts as nothing: epsilon of a 32-bit float.
EPSILON: Final = float(np.finfo(np.float32).eps)

# Part of a squared tolerance that a sum may reach to be safe.
_SAFE = 1.0 - 1e-9

_FIELDS = ("position", "velocity", "acceleration")

# What follows rad or m in their units.
_PER_TIME = {"position": "", "velocity": "/s", "acceleration": "/s^2"}


@dataclass(frozen=True, eq=False)
class StateTolerances(Message):
    """Tolerances of each joint's state; arrays become read-only copies."""

    # Each of shape (n,).
    position: Array
    velocity: Array
    acceleration: Array

    # The same with infinity where anything goes; None where that is so for all joints.
    _limits: tuple[Array | None, ...] = dc.field(init=False, repr=False)

    # Whether anything is checked at all.
    is_checked: bool = dc.field(init=False, repr=False)

    # Whether that is positions alone, and what the sum of their squared errors may be
    # for none of them to be too large.
    is_position_only: bool = dc.field(init=False, repr=False)
    _safe_sum: float = dc.field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Prepare for checking."""
        limits = []
        for field in _FIELDS:
            tolerance = np.array(getattr(self, field), dtype=float)
            tolerance.setflags(write=False)
            object.__setattr__(self, field, tolerance)
            limit = np.where(tolerance > 0.0, tolerance, np.inf)
            limits.append(limit if np.isfinite(limit).any() else None)
        object.__setattr__(self, "_limits", tuple(limits))
        position = limits[0]
        derived = {
            "is_checked": any(limit is not None for limit in limits),
            "is_position_only": limits[1] is None and limits[2] is None,
            # A little less, for sums are rounded.
            "_safe_sum": np.inf if position is None else _SAFE * position.min() ** 2,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def allows(self, errors: Iterable[float]) -> bool:
        """Return whether errors of positions are far from too large; see `exceeds`.

        Where they aren't, it has to be asked.
        """
        squares = [error * error for error in errors]
        return self.is_position_only and sum(squares) <= self._safe_sum


@dataclass(frozen=True, eq=False)
class Tolerances(Message):
    """Tolerances of a trajectory."""

    # Along the way.
    path: StateTolerances

    # At the end.
    goal: StateTolerances

    # How late the goal may be reached [s]; 0 waits forever.
    goal_time: float


class Resolution(NamedTuple):
    """Tolerances of an action goal, and the problem of the requested ones."""

    tolerances: Tolerances

    # Empty if nothing was wrong; else the tolerances are the defaults.
    problem: str


class _InvalidToleranceError(ValueError):
    """A requested tolerance of a goal is invalid."""


def make_default_tolerances(
    trajectory: Sequence[float],
    goal: Sequence[float],
    *,
    stopped_velocity_tolerance: float,
    goal_time: float,
) -> Tolerances:
    """Return the tolerances that a controller's parameter `constraints` sets.

    `trajectory`, `goal` shape (n,); `goal_time` [s], 0 waits forever.
    """
    zeros = np.zeros(len(goal))
    stopped = np.full(len(goal), stopped_velocity_tolerance)
    return Tolerances(
        path=StateTolerances(np.array(trajectory, dtype=float), zeros, zeros),
        goal=StateTolerances(np.array(goal, dtype=float), stopped, zeros),
        goal_time=goal_time,
    )


def resolve_tolerances(
    goal: FollowJointTrajectoryGoal, joints: Sequence[str], defaults: Tolerances
) -> Resolution:
    """Return the tolerances that hold for an action goal.

    For every value that the goal gives: if it is positive it holds, 0 and NaN take the
    default, -1 takes the tolerance away. With any other negative value or an unknown
    joint all of the defaults hold, goal time included.
    """
    goal_time = goal.goal_time_tolerance.to_seconds()
    if not (goal_time or goal.path_tolerance or goal.goal_tolerance):
        return Resolution(defaults, "")
    try:
        tolerances = Tolerances(
            goal_time=_resolve(goal_time, defaults.goal_time, "goal_time_tolerance"),
            path=_resolve_joints(
                goal.path_tolerance, joints, defaults.path, "path_tolerance"
            ),
            goal=_resolve_joints(
                goal.goal_tolerance, joints, defaults.goal, "goal_tolerance"
            ),
        )
    except _InvalidToleranceError as error:
        return Resolution(defaults, f"{error}; the controller's defaults hold")
    return Resolution(tolerances, "")


def violates(
    error_position: Array,
    error_velocity: Array | None,
    error_acceleration: Array | None,
    tolerances: StateTolerances,
) -> Mask:
    """Return which joints are off by more than their tolerances, shape (n,).

    An error of NaN never is.

    `error_position` shape (n,); `error_velocity`: None isn't checked;
    `error_acceleration`: None isn't checked.
    """
    violated = np.zeros(len(error_position), dtype=bool)
    errors = (error_position, error_velocity, error_acceleration)
    for error, limit in zip(errors, tolerances._limits, strict=True):
        if error is not None and limit is not None:
            violated |= np.abs(error) > limit
    return violated


def exceeds(
    error_position: Array,
    error_velocity: Array | None,
    error_acceleration: Array | None,
    tolerances: StateTolerances,
) -> bool:
    """Return whether any joint is off by more than its tolerances, see `violates`."""
    if tolerances.is_position_only and (
        float(error_position.dot(error_position)) <= tolerances._safe_sum
    ):
        return False
    errors = (error_position, error_velocity, error_acceleration)
    return bool(violates(*errors, tolerances).any())


def describe_violation(
    errors: Sequence[Array | None],
    tolerances: StateTolerances,
    kind: str,
    joints: Sequence[str],
    is_prismatic: Mask | None = None,
) -> str:
    """Return which joint is off by how much, compared with its tolerance the most.

    `errors` of position, velocity and acceleration, shape (n,), as for `violates`;
    `kind` is what the tolerances are called, `is_prismatic` has shape (n,).
    """
    worst, text, off = 1.0, "", np.zeros(len(joints), dtype=bool)
    for field, error, limit in zip(_FIELDS, errors, tolerances._limits, strict=True):
        if error is None or limit is None:
            continue
        size = np.abs(error)
        off |= size > limit
        ratio = np.where(size > limit, size / limit, 0.0)
        joint = int(np.argmax(ratio))
        if ratio[joint] > worst:
            worst = ratio[joint]
            is_sliding = is_prismatic is not None and is_prismatic[joint]
            unit = ("m" if is_sliding else "rad") + _PER_TIME[field]
            text = (
                f"{field} of {joints[joint]!r} is off by {size[joint]:.3g} {unit}, "
                f"its {kind} tolerance is {limit[joint]:.3g} {unit}"
            )
    others = int(off.sum()) - 1
    return f"{text}; {counted(others, 'other joint')} too" if others > 0 else text


def _resolve_joints(
    requested: Iterable[JointTolerance],
    joints: Sequence[str],
    defaults: StateTolerances,
    where: str,
) -> StateTolerances:
    arrays = {field: getattr(defaults, field).copy() for field in _FIELDS}
    for tolerance in requested:
        if tolerance.name not in joints:
            hint = suggest(tolerance.name, joints)
            raise _InvalidToleranceError(
                f"{where}: no joint {tolerance.name!r}; {hint}"
            )
        joint = joints.index(tolerance.name)
        for field, array in arrays.items():
            array[joint] = _resolve(
                getattr(tolerance, field),
                getattr(defaults, field)[joint],
                f"{where}[{tolerance.name!r}].{field}",
            )
    return StateTolerances(**arrays)


def _resolve(value: float, default: float, where: str) -> float:
    if value > 0.0:
        return value
    if abs(value - _ERASE) < EPSILON:
        return 0.0
    if value < 0.0:
        raise _InvalidToleranceError(
            f"{where}: expected a positive number, 0 (the default) or -1 (no limit), "
            f"got {value!r}"
        )
    return default
