"""The page's camera: from where it looks, and the link that it follows."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.errors import check_known
from arm_drake.visualization.meshcat import (
    THREE_QUARTER,
    has_moved_camera,
    move_camera,
)
from arm_drake.visualization.page.parts import Live, Part, Viewer
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import Button, Buttons, Choice, Section

Direction = tuple[float, float, float]

# From what is seen to the camera. Robots look along x: their front is seen from there.
DIRECTIONS: Mapping[str, Direction] = {
    "aslant": THREE_QUARTER,
    "top": (0.0, -1e-3, 1.0),
    "front": (1.0, 0.0, 0.0),
    "side": (0.0, -1.0, 0.0),
}

_NOTHING = "nothing"


class CameraPart(Part):
    """The section that says where the camera is."""

    word = "camera"

    def __init__(
        self,
        page: Scene,
        frame: Callable[[Direction], None],
        poses: Callable[[], Mapping[str, RigidTransform]],
    ) -> None:
        """Create it.

        `frame` looks at all of the robots from a direction, and `poses` tells where
        links are drawn, by the names of their frames.
        """
        self._page, self._frame, self._poses = page, frame, poses
        self.followed = ""
        # Where the link was when the camera began to follow it, how far the camera had
        # gone then, and how far it has gone now, since it was placed [m].
        self._start, self._before, self._way = np.zeros(3), np.zeros(3), np.zeros(3)

    def look(self, name: str) -> None:
        """Look at all of the robots from one of `DIRECTIONS`."""
        check_known("view", name, DIRECTIONS, argument="camera")
        self._frame(DIRECTIONS[name])

    def follow(self, link: str | None) -> None:
        """Let the camera go where a link goes, without turning; None is no link."""
        poses = self._poses()
        if link is not None:
            check_known("link", link, poses, argument="camera")
        self.followed = link or ""
        is_placed_anew = not has_moved_camera(self._page.meshcat)
        self._before = self._way = np.zeros(3) if is_placed_anew else self._way
        if link is not None:
            self._start = np.array(poses[link].translation())
            move_camera(self._page.meshcat, self._way)

    def take_over(self, other: Part) -> None:
        """Follow what the other one did."""
        if isinstance(other, CameraPart):
            self.followed, self._start = other.followed, other._start
            self._before, self._way = other._before, other._way

    def draw(self) -> None:
        """Move the camera to where the link has gone."""
        if self.followed:
            now = self._poses().get(self.followed)
            if now is not None:
                if not has_moved_camera(self._page.meshcat):  # It was placed anew.
                    self._start, self._before = np.array(now.translation()), np.zeros(3)
                self._way = self._before + now.translation() - self._start
                move_camera(self._page.meshcat, self._way)

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "follow":
            self.follow(None if value == _NOTHING else str(value))
        else:
            self.look(what)

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, by id."""
        return {"camera:follow": {"value": self.followed or _NOTHING}}

    def section(self) -> Section:
        """Return its part of the panel."""
        hints = {
            "aslant": "from in front, the right and above",
            "top": "from above, x to the right",
            "front": "from where x points to",
            "side": "from the right, x to the right",
        }
        buttons = [Button(f"camera:{name}", name, hints[name]) for name in DIRECTIONS]
        names = (_NOTHING, *self._poses())
        follow = Choice(
            "camera:follow",
            "follow",
            names,
            self.followed or _NOTHING,
            "the camera goes where the link goes",
        )
        return Section("Camera", (Buttons(tuple(buttons)), follow))


def live_camera(live: Live) -> CameraPart:
    """Return the section of a simulation."""
    return CameraPart(live.page, live.views.frame, live.views.drawn_poses)


def view_camera(viewer: Viewer) -> CameraPart:
    """Return the section of a page without physics."""
    return CameraPart(viewer.page, viewer.frame, viewer.drawn_poses)
