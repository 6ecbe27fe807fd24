"""Contact forces as arrows from the points where they act."""

from collections.abc import Iterable, Iterator
from typing import Self

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.messages.geometry import Vector3
from arm_drake.messages.sensors import ContactsState
from arm_drake.options import GRAVITY

_PATH = "/drake/contact_forces"

_GREEN = Rgba(0.1, 0.75, 0.1)

# Forces smaller than this part of the one that sets the scale are not drawn.
_SMALLEST = 1e-3

# How long a robot's weight is drawn, as a part of the robot's size.
_WEIGHT_LENGTH = 0.5

# A robot has at least this weight [N] and this size [m].
_SMALLEST_FORCE = 1e-3
_SMALLEST_SIZE = 0.1

# Thickness of a rod as a part of the length that sets the scale.
_THICKNESS = 0.02


class ContactArrows:
    """Draws a rod for each force; its ball is where the force acts."""

    @classmethod
    def of_robot(
        cls, meshcat: Meshcat, name: str, mass: float, poses: Iterable[RigidTransform]
    ) -> Self:
        """Return those of a robot of a mass [kg] whose links stand in these poses."""
        points = np.array([X_WL.translation() for X_WL in poses])
        size = max(float(np.linalg.norm(np.ptp(points, axis=0))), _SMALLEST_SIZE)
        force = max(mass * GRAVITY, _SMALLEST_FORCE)
        return cls(meshcat, name, force=force, length=_WEIGHT_LENGTH * size)

    def __init__(self, meshcat: Meshcat, name: str, *, force: float, length: float):
        """Create it, unseen; an expected `force` [N] has a `length` [m]."""
        self._meshcat = meshcat
        self._path = f"{_PATH}/{name.replace('/', '|')}"
        self._force = force
        self._length = length
        self._num_made = 0
        self._num_shown = 0

    def show(self, contacts: ContactsState) -> None:
        """Draw the forces on a robot in place of those before."""
        self.draw(points_and_forces(contacts))

    def draw(self, forces: Iterable[tuple[Array, Array]]) -> None:
        """Draw points in the world [m] and forces there [N], in place of others."""
        rods = ((p, force * self._length / self._force) for p, force in forces)
        smallest = _SMALLEST * self._length
        large = [(p, rod) for p, rod in rods if np.linalg.norm(rod) > smallest]
        for index, (point, rod) in enumerate(large):
            path = f"{self._path}/{index}"
            if index == self._num_made:
                self._make(path)
                self._num_made += 1
            self._meshcat.SetTransform(f"{path}/rod", _stretch(point, rod))
            self._meshcat.SetTransform(f"{path}/point", _stretch(point, None))
        for index in range(max(len(large), self._num_shown)):
            is_shown = index < len(large)
            if is_shown != (index < self._num_shown):
                self._meshcat.SetProperty(f"{self._path}/{index}", "visible", is_shown)
        self._num_shown = len(large)

    def hide(self) -> None:
        """Draw nothing."""
        self.draw(())

    def _make(self, path: str) -> None:
        radius = _THICKNESS * self._length
        self._meshcat.SetObject(f"{path}/rod", Cylinder(radius, 1.0), _GREEN)
        self._meshcat.SetObject(f"{path}/point", Sphere(2.0 * radius), _GREEN)


def points_and_forces(contacts: ContactsState) -> Iterator[tuple[Array, Array]]:
    """Yield the points [m] of a message, and the force [N] at each."""
    for state in contacts.states:
        for point, wrench in zip(state.contact_positions, state.wrenches, strict=True):
            yield to_array(point), to_array(wrench.force)


def _stretch(point: Array, rod: Array | None) -> Array:
    """Return what puts a rod of length 1 along z to its place, shape (4, 4)."""
    X = np.eye(4)
    X[:3, 3] = point
    if rod is not None:
        z = rod / np.linalg.norm(rod)
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        X[:3, :3] = np.stack([x, np.cross(z, x), rod], axis=1)
        X[:3, 3] += 0.5 * rod
    return X


def to_array(vector: Vector3) -> Array:
    """Return a vector or point of a message, shape (3,)."""
    return np.array([vector.x, vector.y, vector.z])
