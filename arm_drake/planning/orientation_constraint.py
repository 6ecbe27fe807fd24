"""A cone that an axis of a link stays in along a plan: a glass that is kept upright."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from arm_drake.arrays import cross
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.planning.collisions import CollisionModel

# Between two checks joints turn by so little in all that the axis leaves the cone by no
# more than half of it [rad].
_FINEST = 2e-3

# A search keeps to this part of the cone: between its steps there is the rest.
_INNER = 0.75

# What is in the cone though rounding put it out [rad].
_ROUNDING = 1e-6

# Directions that are shorter have none [1].
_SHORTEST = 1e-9


@dataclass(frozen=True)
class OrientationConstraint:
    """A link may tilt by so much along the way, and turn about the vertical freely.

    It is a cone about `direction`, in which `axis` of the link stays: MoveIt's
    `OrientationConstraint` with a free turn about one axis.
    """

    # The link.
    link_name: str

    # How far the axis may be from the direction [rad], up to pi.
    tolerance: float

    # Axis of the link, in its frame; None is the one that has the direction at the
    # start: the link is upright there.
    axis: tuple[float, float, float] | None = None

    # Direction in the world.
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Raise InputError for what can't be."""
        if not isinstance(self.link_name, str):
            raise InputError(f"link_name: expected a name, got {self.link_name!r}")
        angle = self.tolerance
        is_number = isinstance(angle, int | float) and not isinstance(angle, bool)
        if not is_number or not _FINEST <= angle <= math.pi:
            expected = f"expected an angle from {_FINEST} to pi [rad]"
            raise InputError(f"tolerance: {expected}, got {angle!r}")
        for name in ("axis", "direction"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _read_direction(name, value))


def _read_direction(name: str, value: object) -> tuple[float, float, float]:
    expected = f"{name}: expected x, y, z, not all 0"
    try:
        x, y, z = (float(number) for number in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(f"{expected}; got {value!r}") from None
    length = math.sqrt(x * x + y * y + z * z)
    if not _SHORTEST < length < math.inf:
        raise InputError(f"{expected}; got {value!r}")
    return x / length, y / length, z / length


class Tilt(NamedTuple):
    """Angle between a link's axis and its direction, by the planned joints' values."""

    model: CollisionModel
    link: str

    # In the link, and in the world; of length 1.
    axis: np.ndarray
    direction: np.ndarray

    # The most that may be, and what a search keeps to [rad].
    most: float
    inner: float

    def widened(self, ends: Sequence[np.ndarray]) -> "Tilt":
        """Return it with an inner cone in which the ends of a way are."""
        angles = [self.angle(x) + _ROUNDING for x in ends]
        return self._replace(inner=min(max(self.inner, *angles), self.most))

    def angle(self, x: np.ndarray) -> float:
        """Return how far the axis is from the direction [rad]."""
        axis = self.model.rotation_of(self.link, x) @ self.axis
        return _angle_between(axis, self.direction)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Return the derivative of the angle by the planned joints, shape (n,)."""
        R, J = self.model.turning_of(self.link, x)
        normal = cross(R @ self.axis, self.direction)
        length = math.sqrt(normal @ normal)
        if length < _SHORTEST:  # Any way out is as good.
            return J[0]
        return -(normal / length) @ J

    def is_met(self, x: np.ndarray) -> bool:
        """Return whether the axis is in the cone."""
        return self.angle(x) <= self.most + _ROUNDING

    def describe(self, x: np.ndarray) -> str:
        """Return how far the link is tilted, in words."""
        return (
            f"{self.link!r} tilts by {self.angle(x):.3g} rad; the path constraint "
            f"allows {self.most:.3g}"
        )

    def first_exit(self, path: np.ndarray) -> int | None:
        """Return the first segment of a path, shape (m, n), that leaves the cone."""
        angles = [self.angle(x) for x in path]
        for index, (x, y) in enumerate(itertools.pairwise(path)):
            if not self._keeps(x, y, angles[index], angles[index + 1]):
                return index
        return None if len(path) > 1 or self.is_met(path[0]) else 0

    def _keeps(self, x: np.ndarray, y: np.ndarray, one: float, two: float) -> bool:
        """Return whether a line stays in the cone; the angles are those of its ends."""
        # An axis turns by no more than all joints together.
        length = float(np.sum(np.abs(y - x)))
        if 0.5 * (one + two + length) <= self.most:
            return True
        if max(one, two) > self.most + _ROUNDING:
            return False
        if length <= _FINEST:
            return True
        middle = 0.5 * (x + y)
        angle = self.angle(middle)
        return self._keeps(x, middle, one, angle) and self._keeps(middle, y, angle, two)

    def settle(
        self,
        x: np.ndarray,
        error: Callable[[np.ndarray], np.ndarray],
        bounds: tuple[np.ndarray, np.ndarray],
    ) -> np.ndarray | None:
        """Return values nearby in the cone where an error is zero, or None."""
        from scipy.optimize import least_squares

        def residual(values: np.ndarray) -> np.ndarray:
            return np.append(error(values), max(0.0, self.angle(values) - self.inner))

        start = np.clip(x, bounds[0] + 1e-9, bounds[1] - 1e-9)
        found = least_squares(residual, start, bounds=bounds, max_nfev=40, xtol=1e-12)
        values = np.array(found.x)
        is_met = self.angle(values) <= self.most and np.all(
            np.abs(error(values)) < 1e-5
        )
        return values if is_met else None


def find_tilt(
    constraint: OrientationConstraint, model: CollisionModel, start: np.ndarray
) -> Tilt:
    """Return how a constraint is measured; the start decides what is upright.

    InputError if there is no such link.
    """
    links = model.links
    if constraint.link_name not in links:
        hint = suggest(constraint.link_name, links)
        raise InputError(f"path_constraint: no link {constraint.link_name!r}; {hint}")
    direction = np.array(constraint.direction)
    if constraint.axis is None:
        axis = model.rotation_of(constraint.link_name, start).T @ direction
    else:
        axis = np.array(constraint.axis)
    most = float(constraint.tolerance)
    tilt = Tilt(model, constraint.link_name, axis, direction, most, _INNER * most)
    return tilt


def _angle_between(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between two vectors of length 1, exact also near 0 and pi."""
    apart, together = one - other, one + other
    return 2.0 * math.atan2(math.sqrt(apart @ apart), math.sqrt(together @ together))
