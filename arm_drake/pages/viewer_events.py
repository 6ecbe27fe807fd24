"""What a click on the page of `arm-drake view` does."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from arm_drake.errors import InputError
from arm_drake.visualization.page import Event

if TYPE_CHECKING:
    from arm_drake.pages.robot_viewer import RobotViewer


def handle_events(viewer: "RobotViewer", events: Iterable[Event]) -> Iterator[str]:
    """Do what was clicked.

    Args:
        viewer: The viewer.
        events: What happened on its page, in order.

    Yields:
        What can't be done, in words.
    """
    moved: dict[str, Any] = {}
    for event in events:
        kind, _, name = event.id.partition(":")
        if kind == "joint":
            # Of a slider's way the end counts.
            moved[name] = event.value
            continue
        _move(viewer, moved)
        moved = {}
        try:
            _do(viewer, kind, name, event.value)
        except InputError as error:
            yield str(error)
    _move(viewer, moved)


def _move(viewer: "RobotViewer", moved: Mapping[str, Any]) -> None:
    own = {r.name for r in viewer.ranges if r.follows is None}
    there = {
        name: value
        for name, value in moved.items()
        if name in own and _is_finite(value)
    }
    if there:
        viewer.set_positions(there)


def _is_finite(value: Any) -> bool:
    """Return whether it is a number that a joint can take."""
    try:
        return isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # An integer that no float is as large as.
        return False


def _do(viewer: "RobotViewer", kind: str, name: str, value: Any) -> None:
    if kind == "show":
        viewer.show(name, bool(value))
    elif kind == "fixed_frame":
        viewer.set_fixed_frame(str(value))
    elif kind == "pose":
        viewer.take_named_pose(name)
    elif kind in ("randomize", "center", "frame", "show_ghost", "hide_ghost"):
        getattr(viewer, kind)()
