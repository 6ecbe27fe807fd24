"""RViz configurations: fixed frame, displays, camera."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from arm_drake import yaml_files
from arm_drake.errors import InputError

# What a page draws for a kind of display, by what turns it on.
_DISPLAYS: Mapping[str, Mapping[str, str]] = {
    "RobotModel": {"Visual Enabled": "visual", "Collision Enabled": "collision"},
    "TF": {"Enabled": "frames", "Show Names": "names"},
}

# Displays of what is on every page.
_ALWAYS = ("Grid", "Axes", "Group")


class RvizView(NamedTuple):
    """View on a page in place of RViz."""

    # None for the world.
    fixed_frame: str | None
    shown: tuple[str, ...]

    # Where the camera is, and what it looks at [m]; None if that isn't said.
    eye: tuple[float, float, float] | None
    target: tuple[float, float, float] | None

    # Displays that a page doesn't have.
    missing: tuple[str, ...]


def read_rviz(path: Path) -> RvizView:
    """Return what a `.rviz` file shows; it is an InputError if it can't be read."""
    try:
        data = yaml_files.parse(yaml_files.read_text(path))
    except yaml_files.YamlError as error:
        raise InputError(error.problem, file=path, line=error.line) from None
    manager = _mapping(_mapping(data).get("Visualization Manager"))
    shown: list[str] = []
    missing: list[str] = []
    for display in _list(manager.get("Displays")):
        kind = str(display.get("Class", "")).rpartition("/")[2]
        if kind in _ALWAYS or not display.get("Enabled", True):
            continue
        if kind not in _DISPLAYS:
            missing.append(kind)
        for key, what in _DISPLAYS.get(kind, {}).items():
            if display.get(key, key != "Collision Enabled") and what not in shown:
                shown.append(what)
    frame = _mapping(manager.get("Global Options")).get("Fixed Frame")
    view = _mapping(_mapping(manager.get("Views")).get("Current"))
    eye, target = _camera(view)
    is_world = frame in (None, "", "world", "map", "odom")
    return RvizView(
        None if is_world else str(frame),
        tuple(shown),
        eye,
        target,
        tuple(dict.fromkeys(missing)),
    )


def _camera(view: Mapping[str, Any]) -> Any:
    """Return eye and target of a view that orbits a point; else None twice."""
    focus = _mapping(view.get("Focal Point"))
    try:
        x, y, z = (float(focus[axis]) for axis in "XYZ")
        distance, pitch, yaw = (float(view[k]) for k in ("Distance", "Pitch", "Yaw"))
    except (KeyError, TypeError, ValueError):
        return None, None
    if not all(map(math.isfinite, (x, y, z, distance, pitch, yaw))) or distance <= 0:
        return None, None
    flat = distance * math.cos(pitch)
    eye = (
        x + flat * math.cos(yaw),
        y + flat * math.sin(yaw),
        z + distance * math.sin(pitch),
    )
    return eye, (x, y, z)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> list[Mapping[str, Any]]:
    return [_mapping(each) for each in value] if isinstance(value, list) else []
