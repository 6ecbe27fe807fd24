"""Where a camera must be to see all of something."""

import dataclasses as dc

import numpy as np

from arm_drake.arrays import Array

# Where a robot is looked at from: in front of it, to its right, above it.
THREE_QUARTER = (0.8, -1.0, 0.45)

# A camera comes no closer to the only point that it sees [m].
_SMALLEST_DISTANCE = 1e-3


@dc.dataclass(frozen=True)
class Camera:
    """Where a camera is, and what is in the middle of its picture, z up [m]."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    @property
    def distance(self) -> float:
        """From the camera to the middle [m]."""
        return float(np.linalg.norm(np.subtract(self.target, self.eye)))


@dc.dataclass(frozen=True)
class View:
    """How a camera looks at something; where it must be follows from that."""

    # Vertical field of view [rad].
    field_of_view: float

    # Width of the picture over its height.
    aspect: float

    # Share of the width, and of the height, that stays free on each side.
    margin: float = 0.06

    # From the middle of the picture to the camera, any length; not vertical.
    direction: tuple[float, float, float] = THREE_QUARTER

    def normals(self) -> Array:
        """Return the outward normals of what the camera sees, shape (6, 3).

        These are right, left, top, bottom, back, front. What the camera sees of a set
        of points depends on nothing but its farthest points in these directions.
        """
        right, up, forward = self._axes()
        across, along = self._slopes()
        return np.stack(
            [
                right - across * forward,
                -right - across * forward,
                up - along * forward,
                -up - along * forward,
                forward,
                -forward,
            ]
        )

    def camera_for(self, points: Array) -> Camera:
        """Return the closest camera that sees all points, with the margin around them.

        Args:
            points: At least one point in the world [m], shape (n, 3).
        """
        right, up, forward = self._axes()
        # The camera lies in each side of its own pyramid, and the points inside.
        to_right, to_left, to_top, to_bottom, back, front = (
            self.normals() @ points.T
        ).max(axis=1)
        across, along = self._slopes()
        depth = min(
            -(to_right + to_left) / (2.0 * across),
            -(to_top + to_bottom) / (2.0 * along),
            -front - _SMALLEST_DISTANCE,
        )
        eye = (
            right * (to_right - to_left) / 2.0
            + up * (to_top - to_bottom) / 2.0
            + forward * depth
        )
        target = eye + forward * ((back - front) / 2.0 - depth)
        return Camera(_triple(eye), _triple(target))

    def _axes(self) -> Array:
        """Return the directions right, up and forward of the picture, shape (3, 3)."""
        forward = -np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def _slopes(self) -> tuple[float, float]:
        """Return how fast what is to be filled widens with the depth."""
        along = float(np.tan(self.field_of_view / 2.0)) * (1.0 - 2.0 * self.margin)
        return along * self.aspect, along


def round_number(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that is not above a number.

    Args:
        value: The number, positive; the others go on below 1 as well.
    """
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value))


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return (x, y, z)
