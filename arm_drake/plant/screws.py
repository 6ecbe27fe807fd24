"""The joints above a link as screws: its poses at many positions at once; turns.

Turns and slides of joints are matrices exp(S q), whose product is the pose. numpy makes
those of a hundred positions in little more time than those of one; what the joints are
is read from Drake's Jacobian at zero.
"""

import math
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

# The axes after x, y, z, and those before.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class Screws:
    """The joints above a link: each turns about an axis, or slides along one."""

    def __init__(self, plant: MultibodyPlant, link: str, at: Sequence[int]) -> None:
        """Read them from a plant.

        Args:
            plant: The plant; the joints' velocities are where their positions are.
            link: The link.
            at: Where the joints that carry it are in q, the first one first.
        """
        self.at = np.array(at, dtype=int)
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.zeros(plant.num_positions()))
        frame, world = plant.GetBodyByName(link).body_frame(), plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
        )
        X = frame.CalcPoseInWorld(context)
        self._X = X.GetAsMatrix4()
        w = J[:3, self.at].T
        # How a point at the world's origin moves. exp(S q) is 1 + sin(q) S + (1 -
        # cos(q)) S^2 where a joint turns, and 1 + q S where it slides.
        v = J[3:, self.at].T - _cross(w, X.translation())
        self._twists = np.stack((w, v), axis=2)
        S = np.zeros((len(at), 4, 4))
        S[:, :3, :3], S[:, :3, 3] = _cross(w[:, np.newaxis], -np.eye(3)), v
        turns = w.any(axis=1)[:, np.newaxis, np.newaxis]
        self._sin, self._versine, self._slide = S * turns, S @ S * turns, S * ~turns
        self._one, self._slides = np.eye(4) + self._versine, not turns.all()

    def poses(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return turns, places and Jacobians of the frame in the world.

        q: The joints' positions, shape (k, n). Shapes (k, 3, 3), (k, 3), (k, 6, n),
        places first.
        """
        angle = q[:, :, np.newaxis, np.newaxis]
        T = self._one + np.sin(angle) * self._sin - np.cos(angle) * self._versine
        if self._slides:
            T += angle * self._slide
        before = np.empty_like(T)
        before[:, 0] = np.eye(4)
        for m in range(1, len(self.at)):
            np.matmul(before[:, m - 1], T[:, m - 1], out=before[:, m])
        X = before[:, -1] @ T[:, -1] @ self._X
        p = X[:, np.newaxis, :3, 3] - before[:, :, :3, 3]
        twists = before[:, :, :3, :3] @ self._twists
        J = np.empty((len(q), len(self.at), 6))
        J[:, :, 3:] = axes = twists[..., 0]
        J[:, :, :3] = twists[..., 1] + _cross(axes, p)
        return X[:, :3, :3], X[:, :3, 3], J.swapaxes(1, 2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(  # numpy's takes ten times as long.
        a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    )


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """Return the axis of a rotation times its angle [rad]."""
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s, c = math.sqrt(v @ v), R[0, 0] + R[1, 1] + R[2, 2] - 1.0
    if s > 1e-6:
        return v * (math.atan2(s, c) / s)
    if c > 0.0:
        return 0.5 * v
    # Half a turn: the axis is the largest column of R + 1.
    column = (R + np.eye(3))[:, int(np.argmax(np.diag(R)))]
    return column * (math.pi / math.sqrt(column @ column))


def rotation_vectors(R: np.ndarray) -> np.ndarray:
    """Return the axes of rotations (k, 3, 3) times their angles [rad], (k, 3)."""
    v = R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]]
    s, c = np.sqrt((v * v).sum(axis=1)), R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0
    angle = np.arctan2(s, c)
    vectors = v * np.where(s > 1e-6, angle / np.maximum(s, 1e-6), 0.5)[:, np.newaxis]
    for k in np.flatnonzero((s <= 1e-6) & (c <= 0.0)):  # Half a turn.
        vectors[k] = rotation_vector(R[k])
    return vectors


def swings(directions: np.ndarray, axis: int) -> np.ndarray:
    """Return the turns [rad] that bring an axis of frames to directions in them."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turns = np.zeros_like(directions)
    s = np.hypot(directions[:, one], directions[:, two])
    angle = np.arctan2(s, directions[:, axis])
    aside = s > 1e-9
    part = np.where(aside, angle / np.maximum(s, 1e-9), 0.0)
    turns[:, one] = np.where(aside, -directions[:, two] * part, angle)
    turns[:, two] = directions[:, one] * part
    return turns
