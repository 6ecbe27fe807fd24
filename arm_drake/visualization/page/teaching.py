"""Teaching a motion on a page: poses are kept as way points, and saved as a file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.output_files import find_free_path, writing
from arm_drake.planning.groups import joints_of
from arm_drake.planning.timing import motion_limits
from arm_drake.simulation.motion_files import parse_motion
from arm_drake.visualization.page.parts import Live, Part, Viewer
from arm_drake.visualization.page.widgets import Button, Buttons, Section, Slider, Text

_CONTROLLER = "JointTrajectoryController"

# Time for the way to a point [s]: at first, and the range of its slider.
_TIME, _SHORTEST, _LONGEST = 2.0, 0.1, 10.0

# A trajectory of a cubic is half as fast again in the middle as in the mean.
_PEAK = 1.5

_DIGITS = 6


def find_trajectory_controllers(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Return the joints of each trajectory controller of a robot."""
    own = {joint.name for joint in robot.description.independent_joints}
    found = {}
    for controller in robot.controllers.controllers:
        joints = joints_of(controller)
        if controller.type.endswith(_CONTROLLER) and joints and set(joints) <= own:
            found[controller.name] = joints
    return found


class WayPoints:
    """Poses of one robot, and the motion through them."""

    def __init__(self, robot: Robot) -> None:
        """Create it without any."""
        self.robot = robot
        self._controllers = find_trajectory_controllers(robot)
        self._limits = motion_limits(robot)
        # When each is reached [s], and positions by joint.
        self._points: list[tuple[float, dict[str, float]]] = []

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self._points)

    def add(self, positions: Mapping[str, float], time: float) -> float:
        """Add a pose [rad, m]; return when it is reached [s].

        `time` [s] is for the way to it, or as long as the joints' velocities ask for.
        """
        last, before = self._points[-1] if self._points else (0.0, {})
        for name, position in positions.items():
            if name in before:
                way = abs(position - before[name])
                time = max(time, _PEAK * way / self._limits[name].velocity)
        self._points.append((round(last + time, 3), dict(positions)))
        return self._points[-1][0]

    def take(self, other: "WayPoints") -> None:
        """Take those of a robot with the same joints."""
        own = {j for joints in self._controllers.values() for j in joints}
        if all(own <= set(positions) for _, positions in other._points):
            self._points = list(other._points)

    def remove(self) -> None:
        """Forget the last one, if any."""
        del self._points[-1:]

    def clear(self) -> None:
        """Forget all."""
        self._points.clear()

    def steps(self) -> list[dict[str, Any]]:
        """Return the steps of a motion file: a goal for each trajectory controller."""
        steps = []
        for name, joints in self._controllers.items() if self._points else ():
            points = [
                {
                    "positions": [round(p[joint], _DIGITS) + 0.0 for joint in joints],
                    "time_from_start": time,
                }
                for time, p in self._points
            ]
            goal = {"joint_names": list(joints), "points": points}
            steps.append({"at": 0.0, "controller": name, "goal": goal})
        return steps

    def text(self) -> str:
        """Return the motion file."""
        steps = self.steps()
        if not steps:
            return ""
        text: str = yaml.safe_dump(
            steps, sort_keys=False, default_flow_style=None, width=1000
        )
        return text


class Teaching(Part):
    """The section that keeps poses of robots as way points of a motion."""

    word = "teach"

    def __init__(
        self,
        robots: Mapping[str, Robot],
        positions: Callable[[str], Mapping[str, float]],
        note: Callable[[str], None],
        play: Callable[[str, list[dict[str, Any]]], None] | None = None,
    ) -> None:
        """Create it.

        `positions` tells those of a robot's joints now, `note` takes news, and `play`
        sends steps to a robot's controllers, where they run.
        """
        self.way_points = {
            name: WayPoints(robot)
            for name, robot in robots.items()
            if find_trajectory_controllers(robot)
        }
        self.time = _TIME
        self._positions, self._note, self._play = positions, note, play

    def take_over(self, other: Part) -> None:
        """Take the way points of a robot that was loaded again, of joints it has."""
        if not isinstance(other, Teaching):
            return
        self.time = other.time
        for name, points in self.way_points.items():
            if name in other.way_points:
                points.take(other.way_points[name])

    def add(self) -> None:
        """Keep where the robots are now."""
        for name, points in self.way_points.items():
            points.add(self._positions(name), self.time)

    def remove(self) -> None:
        """Forget the last way point."""
        for points in self.way_points.values():
            points.remove()

    def clear(self) -> None:
        """Forget all way points."""
        for points in self.way_points.values():
            points.clear()

    def play(self) -> None:
        """Send what was taught to the controllers."""
        self._require()
        for name, points in self.way_points.items():
            if self._play is not None:
                self._play(name, points.steps())

    def save(self) -> list[Path]:
        """Write a motion file for each robot in the working folder; return them."""
        self._require()
        files = []
        for name, points in self.way_points.items():
            stem = "motion" if len(self.way_points) == 1 else f"motion_{name}"
            path = find_free_path(stem.replace("/", "_"))
            with writing(path):
                path.write_text(points.text(), encoding="utf-8")
            self._note(f"motion saved: {path}; play it by --motion {path}")
            files.append(path)
        return files

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "time":
            if isinstance(value, int | float):
                self.time = min(max(float(value), _SHORTEST), _LONGEST)
        elif what in ("add", "remove", "clear", "play", "save"):
            getattr(self, what)()

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, by id."""
        if not self.way_points:
            return {}
        count = self._count()
        return {
            **{
                f"teach:{what}": {"is_enabled": count > 0}
                for what in ("remove", "clear", "play", "save")
            },
            "teach:count": {"value": str(count)},
            "teach:time": {"value": self.time},
            "teach:motion": {"value": self._text()},
        }

    def section(self) -> Section:
        """Return its part of the panel; it is empty without trajectory controllers."""
        if not self.way_points:
            return Section("Teach a motion", ())
        has_some = self._count() > 0
        buttons = [Button("teach:add", "add to motion", "keep where the robot is now")]
        if self._play is not None:
            hint = "send it to the controllers"
            buttons.append(Button("teach:play", "play it", hint, has_some))
        hint = "as a motion file in the working folder"
        buttons += [
            Button("teach:save", "save", hint, has_some),
            Button("teach:remove", "undo", "forget the last way point", has_some),
            Button("teach:clear", "clear", "forget all way points", has_some),
        ]
        slider = Slider(
            "teach:time",
            "time to the next point",
            _SHORTEST,
            _LONGEST,
            self.time,
            "s",
            hint="or more, where joints can't be so fast",
        )
        return Section(
            "Teach a motion",
            (
                Buttons(tuple(buttons)),
                slider,
                Text("teach:count", "way points", str(self._count())),
                Text("teach:motion", "motion file", self._text(), can_copy=True),
            ),
            is_open=False,
        )

    def _count(self) -> int:
        return max((len(p) for p in self.way_points.values()), default=0)

    def _text(self) -> str:
        texts = {name: points.text() for name, points in self.way_points.items()}
        if len(texts) < 2 or not any(texts.values()):
            return "".join(texts.values())
        return "\n".join(f"# {name}\n{text}" for name, text in texts.items())

    def _require(self) -> None:
        if not self._count():
            raise InputError("the motion has no way points; add one first")


def teach_live(live: Live) -> Teaching:
    """Return the section of a simulation: it keeps where joints are measured."""

    def positions(name: str) -> dict[str, float]:
        state = live.simulation.joint_states(name)
        return dict(zip(state.name, state.position, strict=True))

    def play(name: str, steps: list[dict[str, Any]]) -> None:
        prefix = live.simulation.directory.manager(name).prefix
        for step in parse_motion(steps).steps:
            controller = live.simulation.controller(f"{prefix}{step.controller}")
            controller.send_goal(step.message)  # type: ignore[arg-type]

    return Teaching(live.simulation.robots, positions, live.note, play)


def teach_view(viewer: Viewer) -> Teaching:
    """Return the section of a page without physics: it keeps what sliders say."""
    robot = viewer.robot
    return Teaching({robot.name: robot}, lambda name: viewer.positions, viewer.note)
