"""Scenes to draw on, with or without a page, and the Meshcats that they use.

Drake ends the process when a Meshcat is destroyed in another thread than the one that
made it, and Python's garbage collector runs in whatever thread it likes. So these are
never destroyed: what a page is done with serves the next page of the same thread.
"""

import ctypes
import dataclasses as dc
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

from pydrake.geometry import Meshcat, MeshcatParams

from arm_drake.visualization.page.widgets import Section


class _Free(threading.local):
    """The Meshcats that are nobody's, for each thread its own."""

    def __init__(self) -> None:
        self.meshcats: list[Meshcat] = []


_free = _Free()


def take_meshcat() -> Meshcat:
    """Return an empty Meshcat that listens to this machine alone."""
    if _free.meshcats:
        return _free.meshcats.pop()
    log = logging.getLogger("drake")
    level = log.level
    # It would tell an address that nobody needs.
    log.setLevel(logging.WARNING)
    try:
        params = MeshcatParams(host="localhost", port=0, show_stats_plot=False)
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
    for name in ("/Grid", "/Axes", "/Background", "/Cameras", "/Lights"):
        meshcat.Delete(name)
    _free.meshcats.append(meshcat)


@dc.dataclass(frozen=True)
class Event:
    """What somebody did in a browser."""

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

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets, where there is a panel.

        Args:
            changes: New values of fields, by the widget's name.
        """

    def set_panel(self, title: str, sections: Sequence[Section]) -> None:
        """Replace the panel, where there is one.

        Args:
            title: What stands above it.
            sections: What it consists of.
        """

    def say(self, text: str, severity: str = "info") -> None:
        """Show a message, where there is a page.

        Args:
            text: The message.
            severity: "info", "warning" or "error".
        """

    def call(self, function: Callable[[], None]) -> None:
        """Have something done by the thread of the page; without a page, nobody does.

        Args:
            function: Does it.
        """

    def events(self, timeout: float) -> list[Event]:
        """Return what happened in browsers.

        Args:
            timeout: How long to wait for the first [s].
        """
        time.sleep(timeout)
        return []

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things of the scene, where there is a page.

        Args:
            labels: Names by Meshcat path.
        """

    def close(self) -> None:
        """End it: what is drawn goes."""
        if not self._is_closed:
            self._is_closed = True
            give_back(self.meshcat)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()
