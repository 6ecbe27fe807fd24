"""Plans of launch files: robots, controllers, worlds, as a diagram is built of them."""

import dataclasses as dc
import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydrake.systems.framework import Diagram

from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError
from arm_drake.importing import dataclass
from arm_drake.launch.commanded import save_steps, share_steps
from arm_drake.launch.frames import Placed, StaticFrame, place_frames
from arm_drake.launch.robot import (
    Bridge,
    LaunchedModel,
    LaunchedRobot,
    PlanFolder,
    add_models,
    hold_files,
    write_bridges,
)
from arm_drake.launch.roles import NotStarted
from arm_drake.launch.written_files import name_written
from arm_drake.options import SimulationOptions
from arm_drake.scene import Scene
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.motion_files import find_motion


@dataclass(frozen=True)
class LaunchArgument:
    """An argument that a launch file declares."""

    name: str

    # None if it must be given.
    default: str | None
    description: str
    choices: tuple[str, ...] | None = None


@dataclass(frozen=True, eq=False)
class LaunchPlan:
    """Plan returned by `load_launch`: all that a launch file would start.

    Its robots are loaded by `load_scene`; `build_diagram` does both.
    """

    file: Path

    # All that are declared, also in included files that are found.
    arguments: tuple[LaunchArgument, ...]
    robots: tuple[LaunchedRobot, ...]

    # Name of a built-in world, or an SDF file; None if no simulator is started.
    world: str | Path | None

    # "gazebo" (Classic), "gz", or None; and the SDF models that are put into it.
    simulator: str | None
    models: tuple[LaunchedModel, ...]

    # Whether the simulator waits, and whether it has a window.
    is_paused: bool
    is_headless: bool

    # RViz's configuration; "" for its own one; None if it isn't started.
    rviz: Path | str | None

    # The fixed frame that RViz is started with, if any.
    fixed_frame: str | None

    # Whether there are sliders for the joints, and a planner of MoveIt.
    has_sliders: bool
    has_move_group: bool

    # Bridges of topics to Gazebo: as arguments, and the files of others.
    bridges: tuple[Bridge, ...]
    bridge_files: tuple[Path, ...]

    # Frames that are fixed to others.
    static_frames: tuple[StaticFrame, ...]

    # Motion file of what it publishes and which goals it sends, if any.
    motion: Path | None

    # What isn't run here.
    not_started: tuple[NotStarted, ...]

    # What was not taken as written.
    report: LoadReport

    # What holds the files that were written.
    folder: PlanFolder

    package_paths: tuple[Path, ...] = ()

    @property
    def named_bridge_files(self) -> tuple[str, ...]:
        """The files of bridges; of one that was rewritten the one that it was."""
        names = map(str, self.bridge_files)
        return tuple(self.folder.rewritten.get(name, (name,))[0] for name in names)

    @property
    def is_simulated(self) -> bool:
        """Whether controllers run, not only a view of the robot."""
        return self.world is not None or any(r.is_controlled for r in self.robots)

    def load_scene(
        self,
        *,
        world: str | Path | None = None,
        options: SimulationOptions | None = None,
        initial_positions: Mapping[str, float] | None = None,
    ) -> Scene:
        """Load the robots, and return them with their world.

        Args:
            world: Another world than that of the launch file.
            options: How to simulate; which controllers run is added to it.
            initial_positions: Initial positions by joint, of a single robot [rad or m].

        Raises:
            InputError: If the file starts no robot, or one can't be loaded.
        """
        if not self.robots:
            other = {each.name for each in self.not_started}
            other |= {"MoveIt's move_group"} if self.has_move_group else set()
            others = ", ".join(sorted(other))
            text = f"it starts no robot; it starts {others or 'nothing'}"
            raise InputError(text, file=self.file)
        options = options or SimulationOptions()
        several = len(self.robots) > 1
        names = _number_equal([robot.chosen_name for robot in self.robots])
        for name, launched in zip(names, self.robots, strict=True):
            if name != launched.chosen_name:
                what = f"several robots are called {launched.chosen_name!r}"
                self.report.add("warning", "repair", what, f"one is {name!r} here")
        robots = []
        active, inactive = list(options.active), list(options.inactive)
        for launched, name in zip(self.robots, names, strict=True):
            robot = self.load_robot(launched, name, initial_positions)
            robots.append(robot)
            prefix = f"{robot.name}/" if several else ""
            for controller, state in launched.states_of(robot, self.report).items():
                full = prefix + controller
                if full not in (*active, *inactive):
                    (active if state == "active" else inactive).append(full)
        options = dc.replace(options, active=tuple(active), inactive=tuple(inactive))
        motions = self._find_motions(robots)
        # What the launch file has beside them is told with the first one.
        report = LoadReport([*self._whole_report(), *robots[0].report])
        robots[0] = dc.replace(robots[0], report=report)
        hold_files(robots[0], self.folder)
        return Scene(
            robots=tuple(robots),
            world=add_models(world or self.world or "empty", self.models, self.folder),
            options=options,
            motions=motions,
            file=self.file,
        )

    def _whole_report(self) -> LoadReport:
        """Return the report, with what isn't run."""
        report = LoadReport(self.report)
        for each in self.not_started:
            what, done = f"{each.kind} {each.name}", "it is not started"
            done += f"; {each.reason}" if each.reason else ""
            report.add("info", "ignored", what, done, file=self.file)
        return report

    def load_robot(
        self,
        launched: LaunchedRobot,
        name: str | None,
        initial_positions: Mapping[str, float] | None = None,
    ) -> Robot:
        """Load one of its robots, by a name, with positions at the start [rad, m].

        Raises:
            InputError: If it can't be loaded.
        """
        bridges = [*self.bridge_files, *write_bridges(self.bridges, self.folder)]
        (placed,) = (
            each
            for each, robot in zip(self._placed, self.robots, strict=True)
            if robot is launched
        )
        try:
            robot = launched.load(
                name,
                self.package_paths,
                bridges,
                placed,
                initial_positions=initial_positions,
            )
        except InputError as error:
            if name_written(str(error)) == str(error):
                raise
            problem, file = name_written(error.problem), name_written(error.file or "")
            raise InputError(
                problem, file=file or None, line=error.line, where=error.where
            ) from None
        robot = dc.replace(robot, report=name_files(robot.report))
        hold_files(robot, self.folder)
        return robot

    @functools.cached_property
    def _placed(self) -> list[Placed]:
        """Static frames of each robot."""
        if not self.static_frames:
            return [Placed({}, None) for _ in self.robots]
        links = [
            (robot.frame_prefix.lstrip("/"), robot.read_carriers(self.package_paths))
            for robot in self.robots
        ]

        def leave_out(frame: StaticFrame, reason: str) -> None:
            what = f"static frame {frame.child!r} in {frame.parent!r}"
            self.report.add("info", "ignored", what, f"it is left out: {reason}")

        return place_frames(self.static_frames, links, leave_out)

    def _find_motions(self, robots: Sequence[Robot]) -> dict[str, Motion]:
        """Return what is published and sent, as a motion for each robot."""
        if self.motion is None:
            return {}
        owners = [
            (launched.namespace, [c.name for c in robot.controllers.controllers])
            for launched, robot in zip(self.robots, robots, strict=True)
        ]
        shares, lost = share_steps(self.motion, owners)
        for name in lost:
            what, done = f"{name} is no robot's", "what is sent there is left out"
            self.report.add("warning", "ignored", what, done, file=self.file)
        found = {}
        for index, (robot, share) in enumerate(zip(robots, shares, strict=True)):
            path = save_steps(share, self.folder.path / f"motion_{index}.yaml")
            if path is not None:
                found[robot.name] = find_motion(path, robot, {})
        return found

    def build_diagram(self, **options: Any) -> Diagram:
        """Return the Diagram of the robots in their world.

        Args:
            options: As of `arm_drake.build_diagram`, but for the robots.

        Raises:
            InputError: As of `load_scene` and `arm_drake.build_diagram`.
        """
        scene = self.load_scene(options=options.pop("options", None))
        return build_diagram(scene, **options)

    def __str__(self) -> str:
        """Return the plan as lines."""
        return name_written("\n".join(self._lines()))

    def _lines(self) -> Iterator[str]:
        yield f"launch file: {self.file}"
        for robot in self.robots:
            yield from robot.lines()
        if self.world is not None:
            state = ", paused" if self.is_paused else ""
            yield f"world: {self.world}{state}"
        if self.rviz is not None:
            yield f"rviz: {self.rviz or 'its own configuration'}"
        for bridge in (*self.bridges, *self.named_bridge_files):
            yield f"bridge: {bridge}"
        for parent, child, pose in self.static_frames:
            yield f"static frame: {child} in {parent} at {list(pose)}"
        for model in self.models:
            yield f"model: {model.file} at {list(model.pose or ())}"
        yield from dict.fromkeys(map(str, self.not_started))


def name_files(report: LoadReport) -> LoadReport:
    """Return a report that names written files as the launch file does."""
    return LoadReport(
        dc.replace(
            entry,
            what=name_written(entry.what),
            done=name_written(entry.done),
            file=entry.file and name_written(entry.file),
        )
        for entry in report
    )


def _number_equal(names: Sequence[str | None]) -> list[str | None]:
    """Return names, of which the same ones get numbers."""
    found: list[str | None] = []
    for name in names:
        new, number = name, 1
        while new is not None and new in found:
            number += 1
            new = f"{name}_{number}"
        found.append(new)
    return found
