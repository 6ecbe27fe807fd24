"""The readout of a link: its pose in another frame, and what is known of it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.messages.sensors import ContactState
from arm_drake.visualization.page.panel import frame_names
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import Choice, Section, Text, Toggle

# The frame that poses are relative to at first: what stays, as all else moves.
FIXED_FRAME = "fixed frame"

_DECIMALS = 6


class ThingFacts(NamedTuple):
    """What is known of a thing that moves freely."""

    # Where it is drawn, below its kind of drawing: "<model>/<body>".
    path: str

    # Mass [kg].
    mass: float


class LinkReadout:
    """Tells the pose of one link or thing on a page, and changes as that moves.

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
        self._names = frame_names(robots)
        self._links = dict(
            zip(
                self._names[1:],
                (
                    (robot, link)
                    for robot in robots
                    for link in robot.description.links
                    if link != self._names[0]
                ),
                strict=True,
            )
        )
        self._things = {
            name: thing
            for name, thing in (things or {}).items()
            if name not in self._names
        }
        self._names = (*self._names, *self._things)
        if self.frame not in self._names:
            first = len(frame_names(robots[:1]))
            self.frame = self._names[first - 1]
        if self.relative_to not in self._names:
            self.relative_to = FIXED_FRAME

    def set_frame(self, frame: str) -> None:
        """Be about another frame; raise InputError if there is none of that name."""
        self.frame = _find(frame, self._names)
        self._tell()

    def set_relative_to(self, frame: str) -> None:
        """Tell poses in another frame; raise InputError if there is none."""
        self.relative_to = _find(frame, (FIXED_FRAME, *self._names))
        self._tell()

    def set_degrees(self, in_degrees: bool) -> None:
        """Tell angles in degrees, or in radians."""
        self.in_degrees = in_degrees
        self._tell()

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
        self._tell()

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

    def _tell(self) -> None:
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


def _find(frame: str, known: Sequence[str]) -> str:
    if frame not in known:
        raise InputError(f"pose: no frame {frame!r}; {suggest(frame, known)}")
    return frame
