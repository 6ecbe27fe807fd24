"""Messages and goals that launch files send, as steps of motions."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from arm_drake import yaml_files
from arm_drake.description.elements import parse_float
from arm_drake.launch.words import positional, value_of

# How often a step of a motion may repeat.
_MOST_TIMES = 100_000


def read_publication(words: Sequence[str], time: float) -> dict[str, Any] | None:
    """Return what `ros2 topic pub` publishes as a step at a time [s], None if none."""
    with_value = ("-r", "--rate", "-t", "--times", "-p", "--print", "-w", "-n")
    topic, _, text = (*positional(words, with_value), "", "", "")[:3]
    rate = parse_float(value_of(words, "-r", "--rate") or "1") or 1.0
    times = parse_float(value_of(words, "-t", "--times") or "0") or 0.0
    is_once = "--once" in words or "-1" in words
    step = {"at": time, "topic": topic}
    if not is_once:
        # Without a number of times for ever, which is as often as a motion can.
        count = min(int(times), _MOST_TIMES) or _MOST_TIMES
        step |= {"every": 1.0 / rate, "count": count}
    data = _parse(text)
    if "data" in data:
        return step | {"data": data["data"]}
    return step | {"trajectory": data} if "points" in data else None


def read_goal(words: Sequence[str], time: float) -> dict[str, Any] | None:
    """Return a goal of a trajectory or a gripper as a step at a time [s]."""
    action, _, text = (*positional(words, ()), "", "", "")[:3]
    controller, _, kind = action.strip("/").rpartition("/")
    step: dict[str, Any] = {"at": time, "controller": controller}
    data = _parse(text)
    if kind == "follow_joint_trajectory" and data:
        goal, trajectory = dict(data), data.get("trajectory")
        if isinstance(trajectory, Mapping):
            del goal["trajectory"]
            goal |= trajectory
        return step | {"goal": goal}
    if kind == "gripper_cmd" and data:
        return step | {"gripper_command": data.get("command", {})}
    return None


def _parse(text: str) -> dict[str, Any]:
    try:
        data = yaml_files.parse(text)
    except yaml_files.YamlError:
        data = None
    return dict(data) if isinstance(data, Mapping) else {}


def save_steps(steps: Iterable[Mapping[str, Any]], path: Path) -> Path | None:
    """Write steps to a file of a motion, if there are any; return its path."""
    found = [dict(step) for step in steps]
    if not found:
        return None
    path.write_text(yaml.safe_dump(found), encoding="utf-8")
    return path


def share_steps(
    path: Path, robots: Sequence[tuple[str, Sequence[str]]]
) -> tuple[list[list[dict[str, Any]]], list[str]]:
    """Return which steps of a file are each robot's, and the names of nobody's.

    `robots` has each robot's name space and the names of its controllers.
    """
    shares: list[list[dict[str, Any]]] = [[] for _ in robots]
    lost = []
    for step in yaml.safe_load(path.read_text(encoding="utf-8")):
        key = "topic" if "topic" in step else "controller"
        name = step[key].strip("/")
        for share, (namespace, controllers) in zip(shares, robots, strict=True):
            space = namespace.strip("/")
            own = name.removeprefix(f"{space}/")
            is_own = bool(space) and own != name
            if is_own or own.partition("/")[0] in controllers or len(robots) == 1:
                slash = "/" if key == "topic" else ""
                share.append(step | {key: slash + own})
                break
        else:
            lost.append(step[key])
    return shares, lost
