"""RobotViewer: a robot on a page, without physics, with sliders for its joints."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat, QueryObject
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from arm_drake.arrays import is_finite
from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot
from arm_drake.description.source_files import FileWatcher, file_of, watched_files
from arm_drake.description.srdf import GroupState, find_group_states
from arm_drake.errors import ArmDrakeError, check_known
from arm_drake.options import SimulationOptions
from arm_drake.plant.initial_poses import place_free_links
from arm_drake.plant.joint_ranges import (
    JointRange,
    center,
    complete,
    joint_ranges,
    randomize,
)
from arm_drake.plant.plant import (
    add_plant,
    add_robot_model,
    add_visualizer,
    set_initial_positions,
)
from arm_drake.visualization.ghost import BLUE, Ghost
from arm_drake.visualization.meshcat import (
    THREE_QUARTER,
    frame_shapes,
    set_ground_visible,
    show_ground,
)
from arm_drake.visualization.page import Scene, WidgetEvent
from arm_drake.visualization.page.motion_planning import MotionPlanning, ViewedRobot
from arm_drake.visualization.page.panel import (
    LinkReadout,
    LinkViews,
    find_pose,
    list_changes,
    make_fixed_frame,
    make_pose_changes,
    make_viewer_sections,
    pose_yaml,
)
from arm_drake.visualization.page.parts import VIEW_PARTS, Part, make_parts

# Nothing moves, but only discrete plants know joints that follow others.
_TIME_STEP = 0.001


class RobotScene:
    """A robot's plant, and what of it Meshcat shows."""

    def __init__(self, meshcat: Meshcat, robot: Robot) -> None:
        """Create it, in the robot's initial positions, with nothing drawn yet."""
        self.robot = robot
        self._meshcat = meshcat
        builder = DiagramBuilder()
        self.plant, self.scene_graph = add_plant(
            builder, _TIME_STEP, SimulationOptions()
        )
        self.model = add_robot_model(
            self.plant,
            robot.description,
            robot.name,
            robot.pose,
            has_free_base=robot.has_free_base,
        )
        set_initial_positions(self.plant, self.model, dict(robot.initial_positions))
        self.plant.Finalize()
        place_free_links(self.plant, self.scene_graph, self.model, robot)
        add_visualizer(builder, self.scene_graph, meshcat)
        show_ground(meshcat)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self.context = self.plant.GetMyMutableContextFromRoot(self._context)

    @property
    def query(self) -> QueryObject:
        """Query of the present geometries and their poses."""
        port = self.scene_graph.get_query_output_port()
        return port.Eval(self.scene_graph.GetMyContextFromRoot(self._context))

    def set_positions(self, positions: Mapping[str, float]) -> None:
        """Put joints somewhere [rad] or [m], those that follow among them."""
        q = self.plant.GetPositions(self.context)
        for name, position in positions.items():
            joint = self.plant.GetJointByName(name, self.model)
            q[joint.position_start()] = position
        self.plant.SetPositions(self.context, q)

    def link_poses(self) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, by the link's name."""
        return {
            link: self.plant.EvalBodyPoseInWorld(
                self.context, self.plant.GetBodyByName(link, self.model)
            )
            for link in self.robot.description.links
            if link != WORLD
        }

    def make_ghost(
        self, name: str | None = None, color: tuple[float, float, float] = BLUE
    ) -> Ghost:
        """Return a ghost of the robot, which stands where the robot does."""
        return Ghost(
            self._meshcat,
            self.plant,
            self.scene_graph,
            self.model,
            name or self.robot.name,
            self.robot.description,
            base_context=self.context,
            color=color,
        )

    def set_free_pose(self, link: str, X_WL: RigidTransform) -> None:
        """Put a link somewhere that no joint holds."""
        body = self.plant.GetBodyByName(link, self.model)
        self.plant.SetFloatingBaseBodyPoseInWorldFrame(self.context, body, X_WL)

    def publish(self, time: float = 0.0) -> None:
        """Draw visual shapes where they are now, at a recording's time [s]."""
        self._context.SetTime(time)
        self._diagram.ForcedPublish(self._context)


# How often files are looked at, and pictures drawn of what moves by itself [s].
_WATCH_PERIOD, _FRAME_PERIOD = 0.5, 1.0 / 30.0


class RobotViewer:
    """Shows a robot without physics: RViz with joint_state_publisher_gui.

    All that can be clicked is a method, too. It is used in the thread of its page.
    """

    def __init__(
        self,
        page: Scene,
        load: Callable[[], Robot],
        *,
        shown: Sequence[str] = ("visual",),
        fixed_frame: str = WORLD,
        is_watching: bool = True,
        tell: Callable[[str], None] = lambda text: None,
        find_files: Callable[[Exception], Iterable[Path]] = file_of,
    ) -> None:
        """Load the robot and show it in its initial positions.

        Args:
            page: Where to show it.
            load: Loads the robot, again when its files have changed.
            shown: What to draw, as `show`.
            fixed_frame: Link that stays where it is, or "world".
            is_watching: Whether to load the robot again when its files change.
            find_files: Returns the files whose change may mend what can't be loaded.
            tell: Takes how each reload went, in words.

        Raises:
            ArmDrakeError: If the robot can't be loaded, or hasn't what is to be shown.
        """
        self.page = page
        self._load, self._find_files, self._tell = load, find_files, tell
        self._watcher = FileWatcher(period=_WATCH_PERIOD) if is_watching else None
        self._views = LinkViews(page, shown)
        self._random = np.random.default_rng()
        self._fixed_frame, self._positions = WORLD, dict[str, float]()
        self._ghost_positions: dict[str, float] | None = None
        self._is_stopped, self._trouble = False, ""
        self._notes: list[str] = []
        self.parts: list[Part] = []
        robot = load()
        self.readout = LinkReadout(page, [robot])
        self._put(robot)
        self.set_fixed_frame(fixed_frame)
        self.frame()

    @property
    def robot(self) -> Robot:
        """The robot, as it was loaded last."""
        return self._scene.robot

    @property
    def positions(self) -> dict[str, float]:
        """The position of every movable joint [rad] or [m], by name."""
        return dict(self._positions)

    @property
    def ranges(self) -> tuple[JointRange, ...]:
        """Ranges of the joints."""
        return self._ranges

    @property
    def named_poses(self) -> tuple[GroupState, ...]:
        """The poses that the robot's SRDF names."""
        return self._named_poses

    @property
    def fixed_frame(self) -> str:
        """The link that stays where it is, or "world"."""
        return self._fixed_frame

    def pose_yaml(self) -> str:
        """Return the pose as YAML: a line for each independent joint."""
        return pose_yaml(self._positions, self._ranges)

    def set_positions(self, positions: Mapping[str, float]) -> None:
        """Move joints.

        Args:
            positions: Positions [rad] or [m] of independent joints, by name; those
                beyond a limit are taken as the limit, and joints that turn without end
                are turned back. Joints that are left out stay.

        Raises:
            InputError: If one is for no joint or one that follows, or is no number.
        """
        description = self.robot.description
        requested = {**self._independent(self._positions), **positions}
        self._positions = complete(description, requested)
        self._scene.set_positions(self._positions)
        self._draw()

    def randomize(self, seed: int | None = None) -> None:
        """Put every independent joint somewhere within its limits.

        Args:
            seed: Of the random numbers; by default they go on.
        """
        rng = self._random if seed is None else np.random.default_rng(seed)
        self.set_positions(randomize(self._ranges, rng))

    def center(self) -> None:
        """Put every independent joint to 0, or to the middle where 0 isn't allowed."""
        self.set_positions(center(self._ranges))

    def take_named_pose(self, name: str) -> None:
        """Put joints where the SRDF has them.

        Args:
            name: Name of a state, or `<group>: <name>`.

        Raises:
            InputError: If there is no such pose.
        """
        self.set_positions(dict(find_pose(self._named_poses, name).positions))

    def show(self, what: str, is_shown: bool = True) -> None:
        """Draw something, or don't.

        Args:
            what: "visual", "frames", "names", "collision", "inertia" or "joint_axes".
            is_shown: Whether to draw it.

        Raises:
            InputError: If there is no such thing.
        """
        self._views.show(what, is_shown)

    def frame(self, direction: tuple[float, float, float] = THREE_QUARTER) -> None:
        """Point the camera at the robot, so that all of it is to be seen."""
        frame_shapes(self.page.meshcat, self._scene.query, direction=direction)

    def drawn_poses(self) -> dict[str, RigidTransform]:
        """Return where links are drawn, by name: in the fixed frame."""
        poses = self._scene.link_poses()
        X_FW = poses.get(self._fixed_frame, RigidTransform()).inverse()
        return {name: X_FW @ X_WL for name, X_WL in poses.items()}

    def set_fixed_frame(self, link: str) -> None:
        """Let a link stay where it is, and all else move around it, as in RViz.

        Args:
            link: Name of the link, or "world".

        Raises:
            InputError: If the robot has no such link.
        """
        names = (WORLD, *self.robot.description.links)
        check_known("link", link, names, argument="fixed frame")
        self._fixed_frame = link
        set_ground_visible(self.page.meshcat, is_visible=link == WORLD)
        self.page.patch({"fixed_frame": {"value": link}})
        self._draw()

    def show_ghost(self, positions: Mapping[str, float] | None = None) -> None:
        """Draw a transparent copy of the robot in a pose, which stays.

        Args:
            positions: Positions [rad] or [m] of independent joints, by name; by default
                the present ones. Joints that are left out are where they are now.

        Raises:
            InputError: As `set_positions`.
        """
        requested = {**self._independent(self._positions), **(positions or {})}
        self._ghost_positions = complete(self.robot.description, requested)
        self._ghost.show(self._ghost_positions)
        self.page.patch({"hide_ghost": {"is_enabled": True}})

    def hide_ghost(self) -> None:
        """Remove the ghost."""
        self._ghost_positions = None
        self._ghost.hide()
        self.page.patch({"hide_ghost": {"is_enabled": False}})

    def make_ghost(self, name: str, color: tuple[float, float, float]) -> Ghost:
        """Return a transparent copy of the robot that isn't shown yet.

        Args:
            name: Its name among the ghosts.
            color: Red, green and blue from 0 to 1.
        """
        return self._scene.make_ghost(name, color)

    def note(self, text: str) -> None:
        """Print a line, and show it on the page until the next click."""
        self._tell(text)
        self._notes.append(text)

    def reload(self) -> bool:
        """Load the robot again; joints that are still there stay where they are.

        Returns:
            Whether it could be loaded; if not, the last one that could stays.
        """
        known, start = self.robot.report, time.time_ns()
        try:
            self._put(self._load())
        except (ArmDrakeError, OSError) as error:
            self._trouble = f"{error}\n\nThe last robot that could be loaded stays."
            self.page.say(self._trouble, "error")
            self._tell(self._trouble)
            if self._watcher is not None:
                self._watcher.watch({*self._files, *self._find_files(error)}, start)
            return False
        report_changes = list_changes(known, self.robot.report)
        self._trouble = ""
        self.page.say("\n\n".join(report_changes), "warning")
        self._tell("\n".join(["loaded again", *report_changes]))
        return True

    def handle(self, events: Iterable[WidgetEvent]) -> None:
        """Do what was clicked.

        Args:
            events: What happened on the page, in order.
        """
        happened = list(events)
        while happened:  # Of clicks during the search for a plan there may be more.
            self._notes = []
            problems = [self._trouble, *handle_events(self, happened)]
            if not problems[-1] and self._notes:
                self.page.say("\n".join(self._notes))
            else:
                self.page.say(problems[-1], "error")
            happened = self.planning.waiting_events()
        self.planning.tick()

    def run(self) -> None:
        """Do what is clicked until `stop`, or Ctrl-C."""
        while not self._is_stopped:
            is_moving = self.planning.is_playing or self._planned.is_moving
            period = _FRAME_PERIOD if is_moving else _WATCH_PERIOD
            self.handle(self.page.events(period))
            if self._watcher is not None and self._watcher.changed():
                self.reload()
        self._is_stopped = False

    def stop(self) -> None:
        """End `run`, also one that is still to come."""
        self._is_stopped = True
        self.page.call(lambda: None)  # It may wait for a click.

    def _put(self, robot: Robot) -> None:
        """Show a robot in place of the one before."""
        meshcat = self.page.meshcat
        named_poses, files = find_group_states(robot), watched_files(robot)
        scene = RobotScene(meshcat, robot)
        ranges = joint_ranges(robot.description)
        names = {r.name for r in ranges if r.follows is None}
        kept = {n: q for n, q in self._positions.items() if n in names}
        self._scene, self._ranges, self._named_poses = scene, ranges, named_poses
        requested = {**self._independent(robot.initial_positions), **kept}
        self._positions, self._files = complete(robot.description, requested), files
        scene.set_positions(self._positions)
        if self._watcher is not None:
            self._watcher.watch(files)
        if self._fixed_frame not in robot.description.links:
            self._fixed_frame = WORLD
        meshcat.Delete("/drake")
        # Drake makes visible what it draws for the first time.
        scene.publish()
        models = {robot.name: scene.model}
        self._views.put(scene.plant, scene.scene_graph, models, [robot])
        self._ghost = scene.make_ghost()
        if self._ghost_positions is not None:
            ghost = self._ghost_positions.items()
            self.show_ghost({n: q for n, q in ghost if n in names})
        self.readout.put([robot])
        self._planned = ViewedRobot(self)
        self.planning = MotionPlanning(self.page, self._planned)
        self.parts = make_parts(self, VIEW_PARTS, self.parts)
        sections = make_viewer_sections(
            robot,
            ranges,
            self._positions,
            named_poses,
            own=[*(part.section() for part in self.parts), self.readout.section()],
            has_ghost=self._ghost_positions is not None,
            shown=[
                *self._views.toggles(),
                make_fixed_frame([robot], self._fixed_frame),
            ],
            planning=self.planning.section(),
        )
        self.page.set_panel(robot.title, sections)
        self._draw()

    def _draw(self) -> None:
        """Show the present pose, in the scene and in the panel."""
        poses = self._scene.link_poses()
        X_WF = poses.get(self._fixed_frame, RigidTransform())
        self.page.meshcat.SetTransform("/drake", X_WF.inverse())
        self._scene.publish()
        self._views.update({self.robot.name: poses})
        self.page.patch(make_pose_changes(self._positions, self._ranges))
        self.readout.update(poses, self._fixed_frame)
        for part in self.parts:
            part.draw()

    def _independent(self, positions: Mapping[str, float]) -> dict[str, float]:
        return {r.name: positions[r.name] for r in self._ranges if r.follows is None}


def handle_events(viewer: RobotViewer, events: Iterable[WidgetEvent]) -> Iterator[str]:
    """Do what was clicked."""
    moved: dict[str, Any] = {}
    for event in events:
        kind, _, name = event.id.partition(":")
        if kind == "joint":
            # Of a slider's way the end counts.
            moved[name] = event.value
            continue
        _move(viewer, moved)
        moved = {}
        try:
            _do(viewer, kind, name, event.value)
        except ArmDrakeError as error:
            yield str(error)
    _move(viewer, moved)


def _move(viewer: RobotViewer, moved: Mapping[str, Any]) -> None:
    own = {r.name for r in viewer.ranges if r.follows is None}
    changed = {
        name: value for name, value in moved.items() if name in own and is_finite(value)
    }
    if changed:
        viewer.set_positions(changed)


def _do(viewer: RobotViewer, kind: str, name: str, value: Any) -> None:
    if kind == "show":
        viewer.show(name, bool(value))
    elif kind == "fixed_frame":
        viewer.set_fixed_frame(str(value))
    elif kind == "pose":
        viewer.take_named_pose(name)
    elif kind == "plan":
        viewer.planning.handle(f"{kind}:{name}", value)
    elif kind == "readout":
        viewer.readout.handle(f"{kind}:{name}", value)
    elif kind in ("randomize", "center", "frame", "show_ghost", "hide_ghost"):
        getattr(viewer, kind)()
    else:
        for part in viewer.parts:
            if part.handle(f"{kind}:{name}", value):
                viewer.page.patch(part.changes())
