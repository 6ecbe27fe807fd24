"""A recorded rollout, drawn without physics."""

import dataclasses as dc
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.description.entry import bundled_robots, models_folder
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.loading import load_robot
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.meshcat import frame_shapes
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Page,
    Section,
    Slider,
    Text,
    WidgetEvent,
)
from arm_drake.visualization.page.panel import (
    rate_options,
    rate_text,
    read_rate,
    read_time,
)
from arm_drake.visualization.page.robot_viewer import RobotScene

# What a description has for its controllers, which don't run here.
_CONTROL = ("gazebo", "ros2_control", "transmission")


def load_recorded_robot(
    rollout: Rollout,
    *,
    package_paths: Sequence[Path] = (),
    max_faces: int | None = None,
) -> Robot:
    """Return the robot of a rollout, of the description that was recorded with it."""
    if not rollout.description:
        raise InputError("the log doesn't hold its robot's description; name the robot")
    try:
        root = ET.fromstring(rollout.description)  # noqa: S314  what was loaded.
    except ET.ParseError as error:
        text = f"the description in the log can't be read: {error}"
        raise InputError(text) from None
    for tag in _CONTROL:
        for element in root.findall(tag):
            root.remove(element)
    about = rollout.info.get("robot", {})
    folders = list(package_paths)
    # What a file says is no path to be followed.
    if about.get("bundled") in bundled_robots():
        folders.append(models_folder() / about["bundled"])
    with tempfile.TemporaryDirectory() as folder:
        # So deep that nothing around the temporary folder is searched for packages.
        file = Path(folder, "a", "log", "is", "replayed", "now", "robot.urdf")
        file.parent.mkdir(parents=True)
        file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
        robot = load_robot(
            file,
            name=rollout.robot_name or None,
            package_paths=folders,
            pose=about.get("pose"),
            max_faces=max_faces,
        )
    has_free_base = any(root in rollout.free_poses for root in robot.description.roots)
    return dc.replace(robot, has_free_base=has_free_base)


class Replay:
    """Shows a robot where it was."""

    def __init__(self, meshcat: Meshcat, rollout: Rollout, robot: Robot) -> None:
        """Draw the robot as in the first row."""
        if not len(rollout.time):
            raise InputError("the log has no rows; there is nothing to show")
        if not np.isfinite(rollout.position).all():
            raise InputError("the log has positions that are no numbers")
        known = [joint.name for joint in robot.description.movable_joints]
        for name in rollout.joint_names:
            if name not in known:
                hint = suggest(name, known)
                raise InputError(f"the robot has no joint {name!r} of the log; {hint}")
        self.rollout, self.robot = rollout, robot
        self._meshcat = meshcat
        self._scene = RobotScene(meshcat, robot)
        self.show(self.start)

    @property
    def start(self) -> float:
        """Time of the first row [s]."""
        return float(self.rollout.time[0])

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return float(self.rollout.time[-1])

    def show(self, time: float) -> None:
        """Draw the robot where it was at a time [s], between rows in between."""
        rollout = self.rollout
        at = min(max(time, self.start), self.end)
        after = min(int(np.searchsorted(rollout.time, at)), len(rollout.time) - 1)
        before = max(after - 1, 0)
        gap = float(rollout.time[after] - rollout.time[before])
        part = (at - float(rollout.time[before])) / gap if gap else 0.0

        def between(values: Array) -> Array:
            return np.asarray((1.0 - part) * values[before] + part * values[after])

        position = between(rollout.position).tolist()
        self._scene.set_positions(dict(zip(rollout.joint_names, position, strict=True)))
        for link, poses in rollout.free_poses.items():
            pose = between(_aligned(poses, before, after))
            if np.all(np.isfinite(pose)):
                turn = Quaternion(pose[3:] / np.linalg.norm(pose[3:]))
                self._scene.set_free_pose(link, RigidTransform(turn, pose[:3]))
        self._scene.publish(at - self.start)

    def frame(self) -> None:
        """Point the camera at the robot, so that all of it is to be seen now."""
        frame_shapes(self._meshcat, self._scene.query)

    def link_poses(self) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, as drawn."""
        return self._scene.link_poses()


def _aligned(poses: Array, before: int, after: int) -> Array:
    """Return poses, whose quaternions in two rows are on the same side."""
    if poses[before, 3:] @ poses[after, 3:] >= 0.0:
        return poses
    turned = poses.copy()
    turned[after, 3:] *= -1.0
    return turned


_FRAME_PERIOD = 1.0 / 30.0


class ReplayPage:
    """Plays a replay by the wall clock.

    All that can be clicked is a method, too. It is used in the thread of its page.
    """

    def __init__(self, page: Page, replay: Replay, *, rate: float = 1.0) -> None:
        """Show a replay; `run` lets it go."""
        self.page, self.replay = page, replay
        self.is_playing = True
        self.time = replay.start
        # Recorded seconds per second.
        self.rate = rate
        self._is_stopped = False
        replay.frame()
        page.set_panel(replay.robot.title, self._sections())

    def play(self) -> None:
        """Let time pass; at the end, from the start."""
        if self.time >= self.replay.end:
            self.time = self.replay.start
        self.is_playing = True

    def pause(self) -> None:
        """Let time stand."""
        self.is_playing = False

    def seek(self, time: float) -> None:
        """Go to a time [s]; what is beyond the log is taken as its end."""
        self.time = min(max(time, self.replay.start), self.replay.end)

    def set_rate(self, rate: float) -> None:
        """Set how fast time passes."""
        if not 0.0 < rate < float("inf"):
            raise InputError(f"speed: expected a positive number, got {rate!r}")
        self.rate = rate

    def run(self) -> None:
        """Do what is clicked, and play, until `stop`."""
        last, drawn_at = time.perf_counter(), None
        while not self._is_stopped:
            self.handle(self.page.events(_FRAME_PERIOD))
            now = time.perf_counter()
            if self.is_playing:
                self.seek(self.time + self.rate * (now - last))
                self.is_playing = self.time < self.replay.end
            last = now
            if self.time != drawn_at:
                self.replay.show(self.time)
                drawn_at = self.time
            self._refresh()
        self._is_stopped = False

    def stop(self) -> None:
        """End `run`, also one that is still to come."""
        self._is_stopped = True
        self.page.call(lambda: None)  # It may wait for a click.

    def handle(self, events: Iterable[WidgetEvent]) -> None:
        """Do what was clicked, in order."""
        self.page.handle(events, self._do)

    def _do(self, event: WidgetEvent) -> None:
        if event.id == "play":
            self.pause() if self.is_playing else self.play()
        elif event.id == "restart":
            self.seek(self.replay.start)
        elif event.id == "frame":
            self.replay.frame()
        elif event.id == "rate":
            self.set_rate(read_rate(event.value))
        elif event.id == "time":
            self.seek(read_time(event.value))

    def _sections(self) -> list[Section]:
        replay, rollout = self.replay, self.replay.rollout
        rates, now = rate_options(self.rate), rate_text(self.rate)
        buttons = (
            Button("play", "pause", "play or pause (space)", key=" "),
            Button("restart", "restart", "back to the start"),
            Button("frame", "look at all", "of the robot"),
        )
        goals = "\n".join(
            f"{goal.sent_at:.2f} s  {goal.controller}: {goal.status} "
            f"{goal.error_string}".strip()
            for goal in rollout.goals
        )
        sections = [
            Section(
                "Replay",
                (
                    Buttons(buttons),
                    Slider("time", "time", replay.start, replay.end, self.time, "s"),
                    Choice("rate", "speed", rates, now),
                ),
            )
        ]
        if goals:
            sections.append(Section("Goals", (Text("goals", "goals", goals, True),)))
        return sections

    def _refresh(self) -> None:
        label = "pause" if self.is_playing else "play"
        self.page.patch({"play": {"label": label}, "time": {"value": self.time}})
