"""Sections of the panels of `arm-drake view` and `arm-drake sim`; a link's readout.

A pose stands there as text to copy: YAML, or words of a command line. Numbers have six
significant digits. Where that would put a joint beyond the end of its range, which it
has reached, they have as many as are needed to stay within. The readout has the pose of
a link in another frame, and what is known of it.
"""

import functools
import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.joints import WORLD
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import GroupState
from arm_drake.errors import InputError, check_known, suggest
from arm_drake.messages.sensors import ContactState
from arm_drake.plant.joint_ranges import JointRange
from arm_drake.visualization.link_drawings import KINDS, LinkDrawings, show_visual
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import (
    Button,
    Buttons,
    Choice,
    Section,
    Slider,
    Text,
    Toggle,
    Widget,
)

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
    planning: Section,
) -> list[Section]:
    """Return the panel of `arm-drake view`, with positions [rad] or [m]."""
    look = Buttons((Button("frame", "look at all", "all of the robot (f)", key="f"),))
    sections = [
        make_joints(ranges, positions),
        make_named_poses(states),
        make_pose(has_ghost=has_ghost),
        *own,
        Section("Show", (look, *shown)),
        planning,
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
    return (WORLD, *_links_by_frame(robots))


def _links_by_frame(robots: Sequence[Robot]) -> dict[str, tuple[Robot, str]]:
    return {
        f"{robot.name}/{link}" if len(robots) > 1 else link: (robot, link)
        for robot in robots
        for link in robot.description.links
        if link != WORLD
    }


def make_report(report: LoadReport) -> Section:
    """Return the load report, folded."""
    lines = [str(entry) for entry in report.grouped()]
    text = Text("report", "not taken as written", "\n\n".join(lines), can_copy=True)
    title = f"Load report ({len(lines)})"
    return Section(title, (text,) if lines else (), is_open=False)


# Choices of how fast time passes.
_RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
AS_FAST_AS_POSSIBLE = "as fast as it goes"
_TIMES = " ×"


def rate_options(now: float) -> tuple[str, ...]:
    """Return the texts of rates to choose from, with the present one."""
    return tuple(map(rate_text, sorted({*_RATES, now} - {0.0})))


def rate_text(rate: float) -> str:
    """Return the text of a rate; 0 is as fast as it goes."""
    return f"{rate:g}{_TIMES}" if rate else AS_FAST_AS_POSSIBLE


def read_rate(text: object) -> float:
    """Return the rate of a text, or raise InputError."""
    if text == AS_FAST_AS_POSSIBLE:
        return 0.0
    try:
        return float(str(text).removesuffix(_TIMES))
    except ValueError:
        raise InputError(f"real-time rate: expected a number, got {text!r}") from None


def read_time(value: Any) -> float:
    """Return the time [s] that a slider says, or raise InputError."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        problem = f"time: expected a number [s], got {value!r}"
        raise InputError(problem) from None


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
        """Names of the shown views."""
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
        named = self._drawings if NAMES in self._shown else None
        self._scene.set_labels({} if named is None else named.frame_paths())


def _check(what: str) -> None:
    if what not in VIEWS:
        raise InputError(
            f"nothing called {what!r} can be shown; {suggest(what, VIEWS)}"
        )


# The frame that poses are relative to at first: what stays, as all else moves.
FIXED_FRAME = "fixed frame"

_DECIMALS = 6


class ThingFacts(NamedTuple):
    """Facts on a thing that moves freely."""

    # Where it is drawn, below its kind of drawing: "<model>/<body>".
    path: str

    # Mass [kg].
    mass: float


class LinkReadout:
    """Shows the pose of one link or thing on a page, and changes as that moves.

    Frames are called as in the choice of the fixed frame: "world", a link, or with
    several robots `<robot>/<link>`. Things have their own names.
    """

    def __init__(self, scene: Scene, robots: Sequence[Robot]) -> None:
        """Create it, for the last link of the first robot."""
        self._scene = scene
        self.frame, self.relative_to, self.in_degrees = "", FIXED_FRAME, False
        self._poses: Mapping[str, RigidTransform] = {}
        self._contacts: tuple[ContactState, ...] = ()
        self._fixed_frame = ""
        self.put(robots)

    def put(
        self, robots: Sequence[Robot], things: Mapping[str, ThingFacts] | None = None
    ) -> None:
        """Be for these robots and things; frames that are still there stay."""
        names, self._links = frame_names(robots), _links_by_frame(robots)
        self._things = {n: t for n, t in (things or {}).items() if n not in names}
        self._names = (*names, *self._things)
        if self.frame not in self._names:
            first = len(frame_names(robots[:1]))
            self.frame = self._names[first - 1]
        if self.relative_to not in self._names:
            self.relative_to = FIXED_FRAME

    def set_frame(self, frame: str) -> None:
        """Be about another frame; raise InputError if there is none of that name."""
        check_known("frame", frame, self._names, argument="pose")
        self.frame = frame
        self._refresh()

    def set_relative_to(self, frame: str) -> None:
        """Show poses in another frame; raise InputError if it is unknown."""
        check_known("frame", frame, (FIXED_FRAME, *self._names), argument="pose")
        self.relative_to = frame
        self._refresh()

    def set_degrees(self, in_degrees: bool) -> None:
        """Show angles in degrees, or in radians."""
        self.in_degrees = in_degrees
        self._refresh()

    def pick(self, path: str) -> None:
        """Be about the link that is drawn at a Meshcat path, if it is one's."""
        drawn = f"{path}/"
        # Below "drake" and what kind of drawing it is.
        below = drawn[drawn.find("/", len("drake/")) :]
        for name, (robot, link) in self._links.items():
            own = f"/{robot.name}/{link}/".replace("::", "/")
            plain = f"/{robot.name.replace('/', '|')}/{link.replace('/', '|')}/"
            if below.startswith((own, plain)):
                self.set_frame(name)
        for name, thing in self._things.items():
            if below.startswith(f"/{thing.path}/"):
                self.set_frame(name)

    def handle(self, event_id: str, value: object) -> bool:
        """Do what was clicked, and return whether it was one of these widgets."""
        kind, _, what = event_id.partition(":")
        if kind != "readout":
            return False
        if what == "degrees":
            self.set_degrees(bool(value))
        elif what == "frame":
            self.set_frame(str(value))
        elif what == "relative_to":
            self.set_relative_to(str(value))
        elif what == "pick":
            self.pick(str(value))
        return True

    def update(
        self,
        poses: Mapping[str, RigidTransform],
        fixed_frame: str,
        contacts: Iterable[ContactState] = (),
    ) -> None:
        """Take where links are in the world, by the names of frames."""
        self._poses, self._fixed_frame = poses, fixed_frame
        self._contacts = tuple(contacts)
        self._refresh()

    def pose(self) -> RigidTransform:
        """Return the pose of the frame in the other one."""
        other = self.relative_to
        X_WR = self._poses.get(self._fixed_frame if other == FIXED_FRAME else other)
        X_WL = self._poses.get(self.frame, RigidTransform())
        return X_WL if X_WR is None else X_WR.inverse() @ X_WL

    def section(self) -> Section:
        """Return its part of the panel."""
        hint = "a click on a link in the scene chooses it, too"
        others = (FIXED_FRAME, *self._names)
        return Section(
            "Pose of a link",
            (
                Choice("readout:frame", "frame", self._names, self.frame, hint),
                Choice("readout:relative_to", "relative to", others, self.relative_to),
                Toggle("readout:degrees", "in degrees", self.in_degrees),
                Text("readout:pose", "pose", can_copy=True),
                Text("readout:link", "link", can_copy=True),
            ),
        )

    def _refresh(self) -> None:
        if self._poses:
            values: dict[str, Any] = {
                "frame": self.frame,
                "relative_to": self.relative_to,
                "degrees": self.in_degrees,
                "pose": pose_text(self.pose(), in_degrees=self.in_degrees),
                "link": self._describe(),
            }
            changes = {f"readout:{k}": {"value": v} for k, v in values.items()}
            self._scene.patch(changes)

    def _describe(self) -> str:
        """Return what is known of the link, as YAML."""
        if self.frame in self._things:
            return f"name: {self.frame}\nmass: {self._things[self.frame].mass:g}  # kg"
        if self.frame not in self._links:
            return f"name: {self.frame}"
        robot, link = self._links[self.frame]
        description = robot.description
        lines = [f"name: {link}", f"mass: {description.link(link).mass:g}  # kg"]
        for joint in description.joints:
            if joint.child == link:
                lines += [f"parent: {joint.parent}", f"joint: {joint.name}"]
                lines.append(f"joint_type: {joint.type}")
        own = f"{robot.name}::{link}::"
        touching = [s for s in self._contacts if s.collision1_name.startswith(own)]
        for contact in touching:
            force = contact.total_wrench.force
            size = math.hypot(force.x, force.y, force.z)
            other = contact.collision2_name
            lines += ["contacts:"] if contact is touching[0] else []
            lines.append(f"- {{with: '{other}', force: {size:.3f}}}  # N")
        return "\n".join(lines)


def pose_text(X_RL: RigidTransform, *, in_degrees: bool = False) -> str:
    """Return a pose as YAML: as in URDF's `<origin>`, and as a quaternion."""
    rpy = RollPitchYaw(X_RL.rotation()).vector()
    turn = X_RL.rotation().ToQuaternion().wxyz()
    w, x, y, z = _numbers(turn if turn[0] >= 0.0 else -turn)
    key, angles = ("rpy_degrees", np.rad2deg(rpy)) if in_degrees else ("rpy", rpy)
    return (
        f"xyz: [{', '.join(_numbers(X_RL.translation()))}]\n"
        f"{key}: [{', '.join(_numbers(angles))}]\n"
        f"quaternion: {{w: {w}, x: {x}, y: {y}, z: {z}}}"
    )


def _numbers(values: Iterable[float]) -> list[str]:
    # Adding 0.0 makes 0.0 of -0.0.
    return [f"{round(float(v), _DECIMALS) + 0.0:.{_DECIMALS}f}" for v in values]
