"""Pictures of a robot's cameras on the page, and where the cameras are in the scene."""

import io
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Rgba

from arm_drake.description.meshes.surfaces import data_uri
from arm_drake.errors import ArmDrakeError, InputError, suggest
from arm_drake.perception.cameras import Camera, CameraHandle
from arm_drake.perception.images import color_depths, depth_range
from arm_drake.visualization.page.parts import Live, Part
from arm_drake.visualization.page.widgets import Choice, Picture, Section, Toggle

_NOTHING = "nothing"

# The shortest time between two pictures, and the part of the time they may take at
# most; what a simulation may wait for [s].
_PERIOD, _SHARE = 0.2, 0.25

# The colour scale below depths [pixels].
_SCALE_HEIGHT = 16

# Where frusta are drawn, how deep they are [m], and how they look.
_PATH = "/drake/camera_frusta"
_DEPTH, _COLOR, _WIDTH = 0.15, Rgba(0.85, 0.1, 0.85), 2.0

_QUALITY = 85


class CameraPictures(Part):
    """The section that shows what a camera sees; no picture is taken but that one."""

    word = "cameras"

    def __init__(self, live: Live, cameras: tuple[str, ...]) -> None:
        """Create it for the cameras of a simulation, with none shown."""
        self._live, self._names = live, cameras
        self.shown, self.has_frusta = _NOTHING, False
        # Those whose tags say so are shown from the start.
        wanted = tuple(n for n in cameras if self._camera(n).sensor.visualize)
        self.show_frusta(bool(wanted), wanted)
        # What was drawn last: what it shows, and of which time [s].
        self._drawn: tuple[str, float] | None = None
        self._due = 0.0
        self._fields: dict[str, Any] = {"source": "", "lower": "", "upper": ""}

    @property
    def options(self) -> tuple[str, ...]:
        """Options to show: "<camera> color", and "depth" and "labels"."""
        found = [f"{n} {kind}" for n in self._names for kind in self._camera(n).kinds]
        return (_NOTHING, *found)

    def show(self, what: str) -> None:
        """Show one of the options; a camera alone stands for its first picture."""
        known = self.options
        if what not in known:
            what = next((o for o in known if o.startswith(f"{what} ")), what)
        if what not in known:
            raise InputError(f"camera picture: no {what!r}; {suggest(what, known)}")
        self.shown, self._drawn, self._due = what, None, 0.0

    def show_frusta(self, is_shown: bool = True, names: Sequence[str] = ()) -> None:
        """Draw what cameras see as pyramids in the scene, or don't: all or some."""
        self.has_frusta = is_shown
        self._framed = tuple(names) or self._names
        meshcat = self._live.page.meshcat
        meshcat.Delete(_PATH)
        if is_shown:
            for name in self._framed:
                start, end = _frustum(self._camera(name))
                path = f"{_PATH}/{name}"
                meshcat.SetLineSegments(path, start, end, _WIDTH, _COLOR)
            self.draw()

    def draw(self) -> None:
        """Put the pyramids where the cameras are."""
        if self.has_frusta:
            for name in self._framed:
                X_WC = self._camera(name).pose
                self._live.page.meshcat.SetTransform(f"{_PATH}/{name}", X_WC)

    def changes(self) -> dict[str, dict[str, Any]]:
        """Take a picture if one is due; return present fields of its widgets."""
        if self.shown == _NOTHING:
            self._fields = {"source": "", "lower": "", "upper": ""}
        elif self._live.page.num_browsers and time.perf_counter() >= self._due:
            now = (self.shown, self._live.simulation.time)
            if now != self._drawn:
                self._drawn = now
                self._take()
        return {
            "cameras:shown": {"value": self.shown},
            "cameras:frusta": {"value": self.has_frusta},
            "cameras:picture": dict(self._fields),
        }

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "shown":
            self.show(str(value))
        elif what == "frusta":
            self.show_frusta(bool(value))

    def take_over(self, other: Part) -> None:
        """Show what the other one did."""
        if isinstance(other, CameraPictures):
            self.shown = other.shown
            self.show_frusta(other.has_frusta, other._framed)

    def section(self) -> Section:
        """Return its part of the panel."""
        hint = "what they see, as pyramids in the scene"
        return Section(
            "Cameras",
            (
                Choice("cameras:shown", "picture of", self.options, self.shown),
                Picture("cameras:picture", "what the camera sees", **self._fields),
                Toggle("cameras:frusta", "show the cameras", self.has_frusta, hint),
            ),
            is_open=False,
        )

    def _camera(self, name: str) -> CameraHandle:
        return self._live.simulation.camera(name)

    def _take(self) -> None:
        start = time.perf_counter()
        name, _, kind = self.shown.rpartition(" ")
        try:
            self._fields = _make_fields(self._camera(name), kind)
        except ArmDrakeError as error:  # Such as a library that isn't there.
            self.shown = _NOTHING
            self._live.page.say(str(error), "error")
        now = time.perf_counter()
        self._due = now + max(_PERIOD, (now - start) * (1.0 / _SHARE - 1.0))


def _make_fields(camera: CameraHandle, kind: str) -> dict[str, Any]:
    """Return the fields of a picture, with a colour scale below depths."""
    if kind != "depth":
        return {"source": _as_uri(camera.image(kind)), "lower": "", "upper": ""}
    depths = camera.depth()
    near, far = depth_range(depths)
    row = np.linspace(near, far, depths.shape[1])
    scale = color_depths(np.tile(row, (_SCALE_HEIGHT, 1)))
    gap = np.full((4, depths.shape[1], 3), 255, np.uint8)
    source = _as_uri(np.concatenate([color_depths(depths), gap, scale]))
    return {"source": source, "lower": f"{near:.3g} m", "upper": f"{far:.3g} m"}


def _as_uri(pixels: NDArray[np.uint8]) -> str:
    """Return a picture as an address that holds it."""
    from PIL import Image  # Large, and seldom wanted.

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=_QUALITY)
    return data_uri("image/jpeg", file.getvalue())


def _frustum(camera: CameraHandle) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return lines from a camera to its picture's corners, and between them.

    Starts and ends have the shape (3, 9) [m], in the optical frame.
    """
    info = camera.info
    fx, cx, fy, cy = info.k[0], info.k[2], info.k[4], info.k[5]
    columns = np.array([-0.5, info.width - 0.5, info.width - 0.5, -0.5])
    rows = np.array([-0.5, -0.5, info.height - 0.5, info.height - 0.5])
    x, y = _DEPTH * (columns - cx) / fx, _DEPTH * (rows - cy) / fy
    corners = np.stack([x, y, np.full(4, _DEPTH)])
    # A mark on the upper side says where up is.
    middle = corners[:, :2].mean(axis=1, keepdims=True)
    up = middle * np.array([[1.0], [1.3], [1.0]])
    start = np.hstack([np.zeros((3, 4)), corners, middle])
    end = np.hstack([corners, np.roll(corners, -1, axis=1), up])
    return start, end


def make_camera_pictures(live: Live) -> CameraPictures | None:
    """Return the section of a simulation with cameras; None where there is none."""
    names = tuple(
        f"{manager.prefix}{sensor.sensor.name}"
        for manager in live.simulation.directory.managers.values()
        for sensor in manager.sensors
        if isinstance(sensor, Camera)
    )
    return CameraPictures(live, names) if names else None
