"""Sections of the panels of `arm-drake view` and `arm-drake sim`."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from arm_drake.description.joints import WORLD
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import GroupState
from arm_drake.errors import InputError, suggest
from arm_drake.plant.joint_ranges import JointRange
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Section,
    Slider,
    Text,
    Widget,
)
from arm_drake.visualization.page.pose_text import pose_words, pose_yaml


def make_viewer_sections(
    robot: Robot,
    ranges: Sequence[JointRange],
    positions: Mapping[str, float],
    states: Iterable[GroupState],
    *,
    has_ghost: bool,
    shown: Sequence[Widget],
) -> list[Section]:
    """Return the panel of `arm-drake view`.

    Args:
        robot: The robot.
        ranges: Ranges of its joints.
        positions: Where they are [rad] or [m].
        states: The poses of its SRDF.
        has_ghost: Whether there is a ghost.
        shown: What says what is shown.
    """
    look = Buttons((Button("frame", "look at all", "all of the robot (f)", key="f"),))
    sections = [
        make_joints(ranges, positions),
        make_named_poses(states),
        make_pose(has_ghost=has_ghost),
        Section("Show", (look, *shown)),
        make_report(robot.report),
    ]
    return [section for section in sections if section.widgets]


def make_pose_changes(
    positions: Mapping[str, float], ranges: Sequence[JointRange]
) -> dict[str, dict[str, Any]]:
    """Return what a pose changes in the panel of `arm-drake view`.

    Args:
        positions: Where the joints are [rad] or [m].
        ranges: Their ranges.
    """
    sliders = {f"joint:{name}": {"value": q} for name, q in positions.items()}
    texts = {
        "pose": {"value": pose_yaml(positions, ranges)},
        "words": {"value": pose_words(positions, ranges)},
    }
    return {**sliders, **texts}


def make_joints(
    ranges: Iterable[JointRange], positions: Mapping[str, float]
) -> Section:
    """Return sliders of joints, `joint:<name>`, and what moves them all.

    Args:
        ranges: Ranges of the joints.
        positions: Where they are [rad] or [m].
    """
    buttons = Buttons(
        (
            Button("randomize", "randomize", "within the limits (r)", key="r"),
            Button("center", "center", "to 0, or the limits' middle (c)", key="c"),
        )
    )
    sliders = tuple(_slider(joint, positions[joint.name]) for joint in ranges)
    return Section("Joints", (buttons, *sliders) if sliders else ())


def make_named_poses(states: Iterable[GroupState]) -> Section:
    """Return buttons of named poses, `pose:<group>: <name>`.

    Args:
        states: The poses of the robot's SRDF.
    """
    buttons = tuple(Button(f"pose:{state.label}", state.label) for state in states)
    return Section("Named poses", (Buttons(buttons),) if buttons else ())


def make_pose(*, has_ghost: bool) -> Section:
    """Return the pose as text, `pose` and `words`, and buttons for the ghost."""
    ghost = (
        Button("show_ghost", "ghost here", "a transparent copy that stays"),
        Button("hide_ghost", "no ghost", is_enabled=has_ghost),
    )
    return Section(
        "Pose",
        (
            Buttons(ghost),
            Text("pose", "as YAML", can_copy=True),
            Text("words", "for the command line", can_copy=True),
        ),
    )


def make_fixed_frame(robots: Sequence[Robot], link: str) -> Choice:
    """Return the choice of the fixed frame, `fixed_frame`.

    Args:
        robots: Robots with the links.
        link: The chosen one.
    """
    names = frame_names(robots)
    hint = "what stays where it is, while all else moves"
    return Choice("fixed_frame", "fixed frame", names, link, hint)


def frame_names(robots: Sequence[Robot]) -> tuple[str, ...]:
    """Return "world" and the links; with several robots, `<robot>/<link>`."""
    names = [
        f"{robot.name}/{link}" if len(robots) > 1 else link
        for robot in robots
        for link in robot.description.links
        if link != WORLD
    ]
    return (WORLD, *names)


def make_report(report: LoadReport) -> Section:
    """Return the load report, folded.

    Args:
        report: What was not taken as written.
    """
    lines = [str(entry) for entry in report.grouped()]
    text = Text("report", "not taken as written", "\n\n".join(lines), can_copy=True)
    title = f"Load report ({len(lines)})"
    return Section(title, (text,) if lines else (), is_open=False)


def find_pose(poses: Sequence[GroupState], name: str) -> GroupState:
    """Return the pose of a name, or of `<group>: <name>`.

    Raises:
        InputError: If there is none.
    """
    for pose in poses:
        if name in (pose.label, pose.name):
            return pose
    known = [pose.label for pose in poses]
    hint = suggest(name, known) if known else "the robot has no SRDF with poses"
    raise InputError(f"no pose {name!r}; {hint}")


def list_news(before: LoadReport, after: LoadReport) -> list[str]:
    """Return the lines of a report that were not in the one before.

    Args:
        before: The earlier report.
        after: The later one.
    """
    known = {str(entry) for entry in before.grouped()}
    lines = [str(entry) for entry in after.grouped()]
    return [line for line in lines if line not in known]


def _slider(joint: JointRange, position: float) -> Slider:
    hint = ""
    if joint.follows is not None:
        hint = f"follows {joint.follows}"
    elif joint.unit == "rad":
        ends = [math.degrees(joint.lower), math.degrees(joint.upper)]
        hint = "{:.4g}° to {:.4g}°".format(*ends)
    return Slider(
        f"joint:{joint.name}",
        joint.name,
        joint.lower,
        joint.upper,
        position,
        joint.unit,
        is_enabled=joint.follows is None,
        hint=hint,
    )
