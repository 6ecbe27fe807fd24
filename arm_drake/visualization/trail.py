"""Trail of a point in the world, as a line behind it."""

import collections
import dataclasses as dc

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Meshcat, Rgba

from arm_drake.arrays import Array

# Points of the piece that is resent whenever it grows.
_PIECE = 50

# A piece covers at most this part of the duration, so that what is slow gets old, too.
_SPAN = 0.05

# None of the colours of collision shapes, inertia, frames and ghosts.
_PINK = (1.0, 0.0, 0.6)
_LINE_WIDTH = 3.0


@dc.dataclass
class _Piece:
    """A part of the line, with an object of its own in Meshcat."""

    path: str

    # When it starts and ends [s].
    start: float
    end: float
    points: list[Array]


class Trail:
    """The way that a point has taken in the last seconds.

    The line is sent in pieces, each of which starts where the one before ends: only the
    last one grows and is sent again. What is old is deleted piece by piece, so a piece
    may be seen for a twentieth of the duration too long.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        path: str = "/drake/trail",
        *,
        duration: float = 20.0,
        min_distance: float = 1e-3,
        color: tuple[float, float, float] = _PINK,
    ) -> None:
        """Create it with nothing to be seen; a relative path is below "/drake".

        A point is seen for a duration [s]; one closer than `min_distance` [m] to the
        last one is left out. `color` is red, green and blue from 0 to 1.
        """
        self._meshcat = meshcat
        self._path = path
        self._duration = duration
        self._min_distance = min_distance
        self._rgba = Rgba(*color)
        self._pieces: collections.deque[_Piece] = collections.deque()
        self._count = 0

    def append(
        self, time: float, point: ArrayLike, *, is_recorded: bool = False
    ) -> None:
        """Let the line go on to a point in the world [m], shape (3,), at a time [s].

        An earlier time than before begins a new line. In a recording a piece comes as a
        whole.
        """
        # A copy: Drake may compute the next point in the same place.
        place = np.array(point, dtype=float)
        if self._pieces and time < self._pieces[-1].end:
            self.clear()
        if not self._pieces:
            self._begin(time, place, is_recorded)
            return
        last = self._pieces[-1]
        is_full = len(last.points) >= _PIECE
        if is_full or time - last.start > _SPAN * self._duration:
            self._begin(last.end, last.points[-1], is_recorded)
            last = self._pieces[-1]
        if np.linalg.norm(place - last.points[-1]) >= self._min_distance:
            last.points.append(place)
            line = np.asfortranarray(np.transpose(last.points))
            self._meshcat.SetLine(last.path, line, _LINE_WIDTH, self._rgba)
        last.end = time
        self._forget(time - self._duration)

    def clear(self) -> None:
        """Delete the line."""
        if self._pieces:
            self._pieces.clear()
            self._meshcat.Delete(self._path)

    def _begin(self, time: float, point: Array, is_recorded: bool) -> None:
        path = f"{self._path}/{self._count}"
        if is_recorded:
            self._meshcat.SetProperty(path, "visible", False, 0.0)
            self._meshcat.SetProperty(path, "visible", True, time)
        self._count += 1
        self._pieces.append(_Piece(path, time, time, [point]))

    def _forget(self, time: float) -> None:
        """Delete the pieces that end before a time, but for the last one."""
        while len(self._pieces) > 1 and self._pieces[0].end < time:
            piece = self._pieces.popleft()
            if len(piece.points) > 1:
                self._meshcat.Delete(piece.path)
