"""Meshcats that pages use one after the other.

Drake ends the process when a Meshcat is destroyed in another thread than the one that
made it, and Python's garbage collector runs in whatever thread it likes. So these are
never destroyed: what a page is done with serves the next page of the same thread.
"""

import ctypes
import logging
import threading

from pydrake.geometry import Meshcat, MeshcatParams


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
    """Let another page have a Meshcat; call it in the thread that took it.

    Args:
        meshcat: One that no browser is connected to.
    """
    meshcat.DeleteRecording()
    meshcat.DeleteAddedControls()
    meshcat.Delete()
    meshcat.ResetRenderMode()
    # What was told of these is forgotten: browsers have their own to start with.
    for name in ("/Grid", "/Axes", "/Background", "/Cameras", "/Lights"):
        meshcat.Delete(name)
    _free.meshcats.append(meshcat)
