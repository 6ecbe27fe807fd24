"""Scenes to draw on, with or without a page, and the Meshcats that they use.

Drake ends the process when a Meshcat is destroyed in another thread than the one that
made it, and Python's garbage collector runs in whatever thread it likes. So these are
never destroyed: what a page is done with serves the next page of the same thread.
"""

import contextlib
import ctypes
import logging
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Self
from urllib.parse import urlsplit

from pydrake.geometry import Meshcat, MeshcatParams

from arm_drake.errors import SimulationError
from arm_drake.importing import dataclass
from arm_drake.visualization.page.widgets import Section


class _Free(threading.local):
    """The Meshcats that are nobody's, for each thread its own."""

    def __init__(self) -> None:
        self.meshcats: list[Meshcat] = []


_free = _Free()


# A Meshcat ends when anybody sends it a message that makes no sense.
_DIED = (
    "Meshcat has ended: a program of this machine sent it what it can't read. Nothing "
    "more is drawn"
)


def _find_host() -> str:
    """Return an address of this machine, for itself alone, that nobody can guess.

    Meshcat answers whoever finds it, a web site in the user's browser too. Linux has
    16 million such addresses, other systems one.
    """
    numbers = random.SystemRandom()
    host = ".".join(["127", *(str(numbers.randint(1, 254)) for _ in range(3))])
    try:
        socket.create_server((host, 0)).close()
    except OSError:
        return "localhost"
    return host


def meshcat_address(meshcat: Meshcat) -> tuple[str, int]:
    """Return where a Meshcat listens: host and port."""
    return urlsplit(meshcat.web_url()).hostname or "localhost", meshcat.port()


def take_meshcat() -> Meshcat:
    """Return an empty Meshcat that listens to this machine alone."""
    if _free.meshcats:
        return _free.meshcats.pop()
    log = logging.getLogger("drake")
    level = log.level
    # It would tell an address that nobody needs.
    log.setLevel(logging.WARNING)
    try:
        params = MeshcatParams(host=_find_host(), port=0, show_stats_plot=False)
        meshcat = Meshcat(params)
    finally:
        log.setLevel(level)
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(meshcat))
    return meshcat


def give_back(meshcat: Meshcat) -> None:
    """Let another page have a Meshcat; call it in the thread that took it."""
    meshcat.DeleteRecording()
    meshcat.DeleteAddedControls()
    meshcat.Delete()
    meshcat.ResetRenderMode()
    # What was told of these is forgotten: browsers have their own to start with.
    for name in (
        "/Grid",
        "/Ground",
        "/Followed",
        "/Axes",
        "/Background",
        "/Cameras",
        "/Lights",
    ):
        meshcat.Delete(name)
    _free.meshcats.append(meshcat)


@dataclass(frozen=True)
class WidgetEvent:
    """Event of a widget in a browser."""

    # The widget's name.
    id: str

    # Its new value; None of a button.
    value: Any = None


class Scene:
    """A Meshcat, for recordings and pictures; a `Page` has a panel besides."""

    def __init__(self) -> None:
        """Create it, with nothing drawn."""
        self.meshcat = take_meshcat()
        self._is_closed = False

    @property
    def is_alive(self) -> bool:
        """Whether its Meshcat still draws."""
        try:
            self.meshcat.GetNumActiveConnections()
        except RuntimeError:
            return False
        return True

    @contextlib.contextmanager
    def drawing(self) -> Iterator[None]:
        """Make one SimulationError of whatever ends because Meshcat has ended."""
        try:
            yield
        except (RuntimeError, SimulationError) as error:
            if self.is_alive:
                raise
            raise SimulationError(_DIED) from error

    @property
    def num_browsers(self) -> int:
        """Number of browsers that show it, where there is a page."""
        return 0

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets, by the widgets' names, where there is a panel."""

    def set_panel(self, title: str, sections: Sequence[Section]) -> None:
        """Replace the panel, where there is one."""

    def say(self, text: str, severity: str = "info") -> None:
        """Show an "info", "warning" or "error", where there is a page."""

    def call(self, function: Callable[[], None]) -> None:
        """Have something done by the thread of the page, if there is one."""

    def events(self, timeout: float) -> list[WidgetEvent]:
        """Return what happened in browsers; wait so long for the first [s]."""
        time.sleep(timeout)
        return []

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things, by their paths, where there is a page."""

    def set_plot(
        self, curves: Sequence[str], rows: Sequence[Sequence[float | None]]
    ) -> None:
        """Draw curves, with rows of a time and their numbers, where there is a page."""

    def add_samples(self, rows: Sequence[Sequence[float | None]]) -> None:
        """Let the curves go on, where there is a page."""

    def close(self) -> None:
        """End it: what is drawn goes."""
        if not self._is_closed:
            self._is_closed = True
            if self.is_alive:
                give_back(self.meshcat)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Close it; a Meshcat that has ended is a SimulationError."""
        with self.drawing():
            try:
                if isinstance(error, RuntimeError) and not self.is_alive:
                    raise error
            finally:
                self.close()
