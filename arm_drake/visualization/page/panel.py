"""Sections of the panels of `arm-drake view` and `arm-drake sim`.

A pose stands there as text to copy: YAML, or words of a command line. Numbers have six
significant digits. Where that would put a joint beyond the end of its range, which it
has reached, they have as many as are needed to stay within.
"""

import functools
import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import yaml
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.joints import WORLD
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import GroupState
from arm_drake.errors import InputError, suggest
from arm_drake.plant.joint_ranges import JointRange
from arm_drake.visualization.link_drawings import KINDS, LinkDrawings, show_visual
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Section,
    Slider,
    Text,
    Widget,
)
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import Toggle

_DIGITS = 6

# As many tell any two numbers apart.
_MOST_DIGITS = 17

# Names that are texts without quotes in every YAML: 1.1, 1.2 and ROS's. All others are
# quoted, `yes`, `null` and `1e3` among them.
_PLAIN = re.compile(
    r"(?!(y|yes|n|no|on|off|true|false|null)$)[a-z_][\w/.-]*", re.ASCII | re.IGNORECASE
)


def pose_yaml(positions: Mapping[str, float], ranges: Iterable[JointRange]) -> str:
    """Return a pose [rad, m] as YAML: a line for each independent joint, in order.

    One without a finite position is an InputError.
    """
    texts = _texts(positions, ranges)
    return "".join(f"{_key(name)}: {number}\n" for name, number in texts.items())


def pose_words(positions: Mapping[str, float], ranges: Iterable[JointRange]) -> str:
    """Return a pose as words for a shell: `--position joint=value ...`.

    `arm-drake view` takes them.
    """
    texts = _texts(positions, ranges)
    words = [shlex.quote(f"{name}={number}") for name, number in texts.items()]
    return " ".join(["--position", *words]) if words else ""


def _texts(
    positions: Mapping[str, float], ranges: Iterable[JointRange]
) -> dict[str, str]:
    """Return the numbers of the independent joints."""
    texts = {}
    for joint in ranges:
        if joint.follows is None:
            position = positions.get(joint.name)
            if position is None or not math.isfinite(position):
                problem = f"expected a finite position, got {position!r}"
                raise InputError(problem, where=f"joint {joint.name!r}")
            texts[joint.name] = _number(float(position), joint)
    return texts


def _number(position: float, joint: JointRange) -> str:
    is_inside = joint.lower <= position <= joint.upper
    for digits in range(_DIGITS, _MOST_DIGITS + 1):
        # Adding 0.0 makes 0.0 of -0.0.
        rounded = float(f"{position:.{digits}g}") + 0.0
        if not is_inside or joint.lower <= rounded <= joint.upper:
            break
    mantissa, letter, exponent = repr(rounded).partition("e")
    # YAML 1.1 takes 1e-05 for a text.
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{letter}{exponent}"


@functools.lru_cache(maxsize=10_000)
def _key(name: str) -> str:
    if _PLAIN.fullmatch(name):
        return name
    text: str = yaml.safe_dump(
        name, default_style='"', allow_unicode=True, width=math.inf
    )
    return text.removesuffix("\n")


def make_viewer_sections(
    robot: Robot,
    ranges: Sequence[JointRange],
    positions: Mapping[str, float],
    states: Iterable[GroupState],
    *,
    own: Sequence[Section],
    has_ghost: bool,
    shown: Sequence[Widget],
) -> list[Section]:
    """Return the panel of `arm-drake view`, with positions [rad] or [m]."""
    look = Buttons((Button("frame", "look at all", "all of the robot (f)", key="f"),))
    sections = [
        make_joints(ranges, positions),
        make_named_poses(states),
        make_pose(has_ghost=has_ghost),
        *own,
        Section("Show", (look, *shown)),
        make_report(robot.report),
    ]
    return [section for section in sections if section.widgets]


def make_pose_changes(
    positions: Mapping[str, float], ranges: Sequence[JointRange]
) -> dict[str, dict[str, Any]]:
    """Return what a pose [rad, m] changes in the panel of `arm-drake view`."""
    sliders = {f"joint:{name}": {"value": q} for name, q in positions.items()}
    texts = {
        "pose": {"value": pose_yaml(positions, ranges)},
        "words": {"value": pose_words(positions, ranges)},
    }
    return {**sliders, **texts}


def make_joints(
    ranges: Iterable[JointRange], positions: Mapping[str, float]
) -> Section:
    """Return sliders of joints, `joint:<name>`, and what moves them all."""
    buttons = Buttons(
        (
            Button("randomize", "randomize", "within the limits (r)", key="r"),
            Button("center", "center", "to 0, or the limits' middle (c)", key="c"),
        )
    )
    sliders = tuple(_slider(joint, positions[joint.name]) for joint in ranges)
    return Section("Joints", (buttons, *sliders) if sliders else ())


def make_named_poses(states: Iterable[GroupState]) -> Section:
    """Return buttons of named poses, `pose:<group>: <name>`."""
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
    """Return the choice of the fixed frame, `fixed_frame`."""
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
    """Return the load report, folded."""
    lines = [str(entry) for entry in report.grouped()]
    text = Text("report", "not taken as written", "\n\n".join(lines), can_copy=True)
    title = f"Load report ({len(lines)})"
    return Section(title, (text,) if lines else (), is_open=False)


def find_pose(poses: Sequence[GroupState], name: str) -> GroupState:
    """Return the pose of a name, or of `<group>: <name>`."""
    for pose in poses:
        if name in (pose.label, pose.name):
            return pose
    known = [pose.label for pose in poses]
    hint = suggest(name, known) if known else "the robot has no SRDF with poses"
    raise InputError(f"no pose {name!r}; {hint}")


def list_changes(before: LoadReport, after: LoadReport) -> list[str]:
    """Return the lines of a report that were not in the one before."""
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


VISUAL, FRAMES, NAMES = "visual", "frames", "names"

# What can be shown, and how the panel calls it.
VIEWS: Mapping[str, str] = {
    VISUAL: "visual shapes",
    FRAMES: "link frames",
    NAMES: "names of the frames",
    "collision": "collision shapes",
    "inertia": "inertia, as ellipsoids of the same mass",
    "joint_axes": "joint axes",
}


class LinkViews:
    """Shows and hides what moves with links."""

    def __init__(self, scene: Scene, shown: Sequence[str] = (VISUAL,)) -> None:
        """Create it with what is shown at first, of `VIEWS`; there are no links yet."""
        self._scene = scene
        for what in shown:
            _check(what)
        self._shown = set(shown) | ({FRAMES} if NAMES in shown else set())
        self._drawings: LinkDrawings | None = None

    @property
    def shown(self) -> tuple[str, ...]:
        """What is shown."""
        return tuple(what for what in VIEWS if what in self._shown)

    @property
    def needs_poses(self) -> bool:
        """Whether anything is shown that `update` moves."""
        return bool(self._shown - {VISUAL})

    def put(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        models: Mapping[str, ModelInstanceIndex],
        robots: Sequence[Robot],
    ) -> None:
        """Show it of these robots, in place of those before."""
        if self._drawings is not None:
            self._drawings.clear()
        descriptions = {robot.name: robot.description for robot in robots}
        meshcat = self._scene.meshcat
        self._drawings = LinkDrawings(meshcat, plant, scene_graph, models, descriptions)
        show_visual(meshcat, VISUAL in self._shown)
        for kind in KINDS:
            self._drawings.show(kind, kind in self._shown)
        self._label()

    def show(self, what: str, is_shown: bool = True) -> None:
        """Show or hide one of `VIEWS`; raise InputError if it is none.

        The names of frames are shown beside frames.
        """
        _check(what)
        changed = {what}
        if what == NAMES and is_shown:
            changed.add(FRAMES)
        elif what == FRAMES and not is_shown:
            changed.add(NAMES)
        self._shown = self._shown | changed if is_shown else self._shown - changed
        if self._drawings is not None:
            for kind in changed & set(KINDS):
                self._drawings.show(kind, is_shown)
        if VISUAL in changed:
            show_visual(self._scene.meshcat, is_shown)
        self._label()
        self._scene.patch({f"show:{key}": {"value": is_shown} for key in changed})

    def update(
        self,
        poses: Mapping[str, Mapping[str, RigidTransform]],
        time: float | None = None,
    ) -> None:
        """Move all along with the links, at a time in the recording [s], if any."""
        if self._drawings is not None:
            self._drawings.update(poses, time)

    def toggles(self) -> tuple[Toggle, ...]:
        """Return the panel's toggles; their events are called `show:<what>`."""
        return tuple(
            Toggle(f"show:{what}", label, what in self._shown)
            for what, label in VIEWS.items()
        )

    def _label(self) -> None:
        has_names = NAMES in self._shown and self._drawings is not None
        assert self._drawings is not None or not has_names
        paths = self._drawings.frame_paths() if self._drawings and has_names else {}
        self._scene.set_labels(paths)


def _check(what: str) -> None:
    if what not in VIEWS:
        raise InputError(
            f"nothing called {what!r} can be shown; {suggest(what, VIEWS)}"
        )
