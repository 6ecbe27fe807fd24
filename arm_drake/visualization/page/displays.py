"""Displays of topics in the scene, as RViz has them: each is chosen by its topic."""

import copy
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from arm_drake.description.joints import WORLD
from arm_drake.errors import ArmDrakeError, InputError, suggest
from arm_drake.messages import (
    LaserScan,
    Odometry,
    PointCloud2,
    Pose,
    WrenchStamped,
)
from arm_drake.messages.sensors import ContactsState
from arm_drake.perception.cameras import R_SENSOR_OPTICAL, Camera
from arm_drake.perception.images import to_colors, to_points
from arm_drake.perception.lidar import Lidar
from arm_drake.visualization.contact_arrows import points_and_forces, to_array
from arm_drake.visualization.page.parts import Drawn, Part
from arm_drake.visualization.page.widgets import Section, Toggle
from arm_drake.visualization.trail import Trail

_PATH = "/drake/displays"

# How long the way of a base is seen [s]: as long as simulated time can be shown.
_LONG = 600.0

_RED, _BLUE, _WHITE = (0.85, 0.1, 0.1), (0.1, 0.3, 0.8), (1.0, 1.0, 1.0)

# How large the points are [m], and how many are drawn at most.
_DOT, _POINT, _MOST_POINTS = 0.02, 0.006, 100_000

# So many each scan or cloud of a recording has at most: all of them are in one file.
_MOST_RECORDED = 5_000

# The shortest time between two scans or clouds, and the part of the time they may take
# at most [s]; in a recording the simulated time between two, and no limit.
_PERIOD, _SHARE = 0.1, 0.25


class Display(ABC):
    """Draws the messages of one topic."""

    # What it is, for people.
    kind = ""

    # Whether messages cost much: they are read less often.
    is_dear = False

    def __init__(self, live: Drawn, topic: str, path: str) -> None:
        """Create it, with nothing drawn; it draws below a path."""
        self._live, self.topic, self._path = live, topic, path
        names = list(live.simulation.robots)
        named = [name for name in names if topic.startswith(f"/{name}/")]
        self._robot = (named or names)[0]

    @property
    def _meshcat(self) -> Meshcat:
        return self._live.page.meshcat

    @abstractmethod
    def draw(self, message: Any) -> None:
        """Draw a message in place of that before."""

    def clear(self) -> None:
        """Draw nothing."""
        self._meshcat.Delete(self._path)

    def _pose(self, frame: str) -> RigidTransform:
        """Return the pose of a link in the world, by the name of its frame."""
        poses = self._live.simulation.link_poses(self._robot)
        for name in (frame, frame.rpartition("/")[2]):
            if name in poses:
                return poses[name]
        if frame in ("", WORLD):
            return RigidTransform()
        hint = suggest(frame, poses)
        raise InputError(f"display {self.topic}: no link {frame!r}; {hint}")


class OdometryPath(Display):
    """The way that a base believes it has gone, as a line.

    It begins where the base is, so that one sees how far off it gets from there.
    """

    kind = "path"

    def __init__(self, live: Drawn, topic: str, path: str) -> None:
        """Create it, with nothing drawn."""
        super().__init__(live, topic, path)
        self._trail = Trail(live.page.meshcat, path, duration=_LONG, color=_BLUE)
        self._X_WO: RigidTransform | None = None

    def draw(self, message: Odometry) -> None:
        """Let the line go on."""
        X_OB = _to_transform(message.pose.pose)
        if self._X_WO is None:
            self._X_WO = self._base(message.child_frame_id) @ X_OB.inverse()
        point = (self._X_WO @ X_OB).translation()
        is_recorded = self._live.views.is_recorded
        self._trail.append(self._live.simulation.time, point, is_recorded=is_recorded)

    def clear(self) -> None:
        """Forget the way."""
        self._trail.clear()
        self._X_WO = None

    def _base(self, frame: str) -> RigidTransform:
        try:
            return self._pose(frame)
        except InputError:  # Such as base_footprint where there is none.
            description = self._live.simulation.robots[self._robot].description
            return self._pose(description.base)


class _Points(Display):
    """Points that a sensor sees."""

    is_dear = True

    def __init__(self, live: Drawn, topic: str, path: str) -> None:
        """Create it, with nothing drawn."""
        super().__init__(live, topic, path)
        self._sensor: Any = None
        # Where those of now are drawn; in a recording each has a path of its own.
        self._own, self._count, self._began = path, 0, math.nan
        # What draws the messages of each sensor on the topic, itself the first's.
        self.parts = [self]

    def see(self, sensors: Sequence[Any]) -> None:
        """Take note of the cameras or lidars that publish on the topic."""
        for number, sensor in enumerate(sensors):
            part = copy.copy(self) if number else self
            part._sensor = sensor
            if number:
                part._path = part._own = f"{self._path}|{number + 1}"
                self.parts.append(part)

    def clear(self) -> None:
        """Draw nothing."""
        for part in self.parts:
            self._meshcat.Delete(part._path)

    def _begin(self) -> None:
        """Replace the points of before by the next ones, in a recording too."""
        now = self._live.simulation.time
        if not self._live.views.is_recorded or now == self._began:
            return
        self._began = now
        if self._count:
            self._meshcat.SetProperty(self._own, "visible", False, now)
        self._own, self._count = f"{self._path}/{self._count}", self._count + 1
        if now > 0.0:
            self._meshcat.SetProperty(self._own, "visible", False, 0.0)
        self._meshcat.SetProperty(self._own, "visible", True, now)

    def _show(
        self, points: NDArray[Any], colors: NDArray[np.uint8] | None, size: float
    ) -> None:
        """Draw points in the sensor's frame [m], shape (n, 3), and their colours."""
        self._begin()
        most = _MOST_RECORDED if self._live.views.is_recorded else _MOST_POINTS
        if len(points) > most:
            step = math.ceil(len(points) / most)
            points = points[::step]
            colors = None if colors is None else colors[::step]
        fields = BaseField.kXYZs | (BaseField.kRGBs if colors is not None else 0)
        cloud = PointCloud(len(points), Fields(fields))
        cloud.mutable_xyzs()[:] = points.T
        if colors is not None:
            cloud.mutable_rgbs()[:] = colors.T
        # In a browser one colour for all is multiplied by those of the points.
        color = _RED if colors is None else _WHITE
        self._meshcat.SetObject(self._own, cloud, size, Rgba(*color))

    def _place(self, frame: str, is_optical: bool) -> None:
        """Put the points where their frame is."""
        sensor = self._sensor
        if sensor is None:
            X_WS = self._pose(frame)
        else:
            context = sensor.GetMyContextFromRoot(self._live.simulation.context)
            X_WS = sensor.pose(context)
            if isinstance(sensor, Camera) and not is_optical:
                X_WS = X_WS @ RigidTransform(R_SENSOR_OPTICAL.inverse(), np.zeros(3))
        self._meshcat.SetTransform(self._own, X_WS)


class Scan(_Points):
    """The points that the rays of a lidar hit, as dots."""

    kind = "scan"

    def draw(self, message: LaserScan) -> None:
        """Draw the scan."""
        ranges = np.array(message.ranges)
        angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
        x, y = ranges * np.cos(angles), ranges * np.sin(angles)
        points = np.column_stack([x, y, np.zeros(len(ranges))])
        self._show(points[np.isfinite(ranges)], None, _DOT)
        self._place(message.header.frame_id, is_optical=False)


class Cloud(_Points):
    """The points of a point cloud, in their colours."""

    kind = "points"

    def draw(self, message: PointCloud2) -> None:
        """Draw the cloud."""
        points = to_points(message).reshape(-1, 3)
        colors = to_colors(message)
        seen = np.isfinite(points).all(axis=1)
        colors = None if colors is None else colors.reshape(-1, 3)[seen]
        self._show(points[seen], colors, _POINT)
        # Those of Gazebo Classic's plugin are in the optical frame.
        sensor = self._sensor
        is_optical = isinstance(sensor, Camera) and sensor.sensor.plugin is not None
        self._place(message.header.frame_id, is_optical)


class _Forces(Display):
    """Forces as rods, with a ball where each acts."""

    def __init__(self, live: Drawn, topic: str, path: str) -> None:
        """Create it, with nothing drawn."""
        super().__init__(live, topic, path)
        self._arrows = live.views.make_arrows(self._robot, topic.strip("/"))

    def clear(self) -> None:
        """Draw nothing."""
        self._arrows.hide()


class WrenchArrow(_Forces):
    """The force of a wrench, at the origin of its frame."""

    kind = "wrench"

    def draw(self, message: WrenchStamped) -> None:
        """Draw the force."""
        X_WF = self._pose(message.header.frame_id)
        force = X_WF.rotation() @ to_array(message.wrench.force)
        self._arrows.draw([(X_WF.translation(), force)])


class Contacts(_Forces):
    """The points where a bumper is touched, with their forces."""

    kind = "contacts"

    def draw(self, message: ContactsState) -> None:
        """Draw the points."""
        X_WF = self._pose(message.header.frame_id)
        self._arrows.draw(
            (X_WF @ point, X_WF.rotation() @ force)
            for point, force in points_and_forces(message)
        )


# What draws messages, by their class's name.
DISPLAYS: Mapping[str, type[Display]] = {
    "Odometry": OdometryPath,
    "LaserScan": Scan,
    "PointCloud2": Cloud,
    "WrenchStamped": WrenchArrow,
    "ContactsState": Contacts,
}


class Displays(Part):
    """The section that chooses which topics are drawn; no other is read."""

    word = "display"

    def __init__(self, live: Drawn, topics: Mapping[str, type[Display]]) -> None:
        """Create it for topics that can be drawn, with none drawn."""
        self._live, self.topics = live, topics
        self._shown: dict[str, Display] = {}
        # When those that are dear are read next, see `_now` [s].
        self._due: dict[str, float] = {}
        # Those of sensors that are to be shown, as their tags say.
        self._wanted = _find_wanted(live, topics)

    @property
    def shown(self) -> tuple[str, ...]:
        """The topics that are drawn."""
        return tuple(self._shown)

    def show(self, topic: str, is_shown: bool = True) -> None:
        """Draw what a topic says, or don't."""
        if topic not in self.topics:
            hint = suggest(topic, self.topics)
            raise InputError(f"display: nothing draws a topic {topic!r}; {hint}")
        old = self._shown.pop(topic, None)
        if old is not None:
            old.clear()
        if is_shown:
            path = f"{_PATH}/{topic.strip('/').replace('/', '|')}"
            self._shown[topic] = display = self.topics[topic](self._live, topic, path)
            if isinstance(display, _Points):
                display.see(self._live.simulation.topic(topic).sensors)
            self._due.pop(topic, None)
            self._read(topic)

    def draw(self) -> None:
        """Draw the latest messages."""
        wanted, self._wanted = self._wanted, ()
        for topic in () if self._live.views.is_recorded else wanted:
            self._try(self.show, topic)
        for topic, display in list(self._shown.items()):
            start = self._now()
            if display.is_dear and start < self._due.get(topic, -math.inf) - 1e-9:
                continue
            self._try(self._read, topic)
            now = self._now()
            self._due[topic] = now + max(_PERIOD, (now - start) * (1 / _SHARE - 1))

    def _try(self, act: Callable[[str], None], topic: str) -> None:
        """Do something with a topic; if it can't be, draw it no more and say why."""
        try:
            act(topic)
        except ArmDrakeError as error:
            self._shown.pop(topic).clear()
            self._live.page.say(str(error), "error")

    def end_recording(self) -> None:
        """Leave out what would stand still in a recording: forces."""
        for display in self._shown.values():
            if isinstance(display, _Forces):
                display.clear()

    def _now(self) -> float:
        """Return the time that those that are dear wait by [s]."""
        if self._live.views.is_recorded:  # Else it would depend on the machine.
            return self._live.simulation.time
        return time.perf_counter()

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        self.show(what, bool(value))

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, by id."""
        return {f"display:{t}": {"value": t in self._shown} for t in self.topics}

    def reset(self) -> None:
        """Forget ways that were gone."""
        for display in self._shown.values():
            display.clear()

    def take_over(self, other: Part) -> None:
        """Show what the other one did."""
        if isinstance(other, Displays):
            self._wanted = ()
            for topic in other.shown:
                other.show(topic, False)
                if topic in self.topics:
                    self.show(topic)

    def section(self) -> Section:
        """Return its part of the panel."""
        toggles = [
            Toggle(f"display:{topic}", f"{topic}: {kind.kind}", topic in self._shown)
            for topic, kind in self.topics.items()
        ]
        return Section("Displays", tuple(toggles), is_open=False)

    def _read(self, topic: str) -> None:
        display, source = self._shown[topic], self._live.simulation.topic(topic)
        if isinstance(display, _Points):
            for part, message in zip(display.parts, source.values(), strict=True):
                part.draw(message)
        else:
            display.draw(source.value())


def _to_transform(pose: Pose) -> RigidTransform:
    from pydrake.common.eigen_geometry import Quaternion

    q = pose.orientation
    numbers = np.array([q.w, q.x, q.y, q.z])
    norm = float(np.linalg.norm(numbers))
    rotation = Quaternion(numbers / norm if norm else np.array([1.0, 0.0, 0.0, 0.0]))
    return RigidTransform(rotation, to_array(pose.position))


def _find_wanted(live: Drawn, topics: Mapping[str, type[Display]]) -> tuple[str, ...]:
    """Return the topics of lidars whose tags say that they are to be shown."""
    handles = {topic: live.simulation.topic(topic) for topic in topics}
    return tuple(
        topic
        for topic, handle in handles.items()
        if any(s.sensor.visualize and isinstance(s, Lidar) for s in handle.sensors)
        # Of several rings the scan has one, and the cloud of one ring is its scan.
        and (topics[topic] is Cloud)
        == all(len(s.directions) > 1 or "scan" not in s.topics for s in handle.sensors)
    )


def make_displays(live: Drawn) -> Displays:
    """Return the section of a simulation; it is empty without topics to draw."""
    topics = {
        row.name: DISPLAYS[row.type]
        for row in live.simulation.list_topics()
        if row.direction == "output" and row.type in DISPLAYS
    }
    return Displays(live, topics)
