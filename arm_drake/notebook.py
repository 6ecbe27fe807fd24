"""Robots on pages that live beside a program: for notebooks and interactive Python."""

import dataclasses as dc
import functools
import math
import os
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot, list_robots
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError
from arm_drake.loading import load_robot
from arm_drake.notebook_cells import (
    Recording,
    html_in_a_cell,
    is_browser_elsewhere,
    page_in_a_cell,
)
from arm_drake.options import SimulationOptions
from arm_drake.page_threads import PageThread
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.robot_motions import find_motion
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.meshcat import start_recording
from arm_drake.visualization.page import Page, Scene
from arm_drake.visualization.page.drawing import (
    ROOM_TO_MOVE,
    draw,
    frame_robots,
    run_drawing,
)
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.robot_viewer import RobotViewer
from arm_drake.worlds.world import World

T = TypeVar("T")

# Robots that are loaded, or one that can be.
Robots = Robot | Sequence[Robot] | str | os.PathLike[str]

# The pages that are open, by their names.
_open: "weakref.WeakValueDictionary[str, PageHandle]" = weakref.WeakValueDictionary()
_lock = threading.Lock()


class PageHandle:
    """A page, and all that can be done on it, as methods.

    In a notebook its value shows the page in the cell; where the browser is on another
    machine, a picture that can be turned stands there instead. It has the methods and
    properties of what it shows, which are done in the page's thread: `RobotViewer` or
    `LiveSimulation`.
    """

    def __init__(self, thread: PageThread) -> None:
        """Create it; `view` and `simulate` do that."""
        self._thread = thread
        # Whoever forgets it closes the page.
        weakref.finalize(self, thread.request_close)

    @property
    def url(self) -> str:
        """The page's address."""
        return self._thread.url

    @property
    def is_open(self) -> bool:
        """Whether the page is still there."""
        return self._thread.is_open

    def call(self, function: Callable[[Any], T]) -> T:
        """Do something with what is shown, in the page's thread.

        Args:
            function: Takes the `RobotViewer` or the `LiveSimulation`.

        Returns:
            What the function returns.

        Raises:
            RuntimeError: If the page is closed.
        """
        return self._thread.call(function)

    def close(self) -> None:
        """End the page."""
        self._thread.close()

    def to_html(self) -> str:
        """Return what is to be seen now as a page that needs no program."""
        return self.call(lambda runner: runner.page.meshcat.StaticHtml())

    def __getattr__(self, name: str) -> Any:
        """Return a property of what is shown, or a method done in the page's thread."""
        if name.startswith("_"):
            raise AttributeError(name)
        value = self.call(lambda runner: getattr(runner, name))
        if not callable(value):
            return value

        @functools.wraps(value)
        def act(*args: Any, **kwargs: Any) -> Any:
            return self.call(lambda runner: getattr(runner, name)(*args, **kwargs))

        return act

    def __dir__(self) -> list[str]:
        """Return also what there is of what is shown."""
        own = [*super().__dir__()]
        return own + (self.call(dir) if self.is_open else [])

    def __repr__(self) -> str:
        """Return where it is."""
        return f"<page {self.url}>" if self.is_open else "<page, closed>"

    def _repr_html_(self) -> str | None:
        if not self.is_open:
            return None
        if is_browser_elsewhere():
            return html_in_a_cell(self.to_html())
        return page_in_a_cell(self.url)


def view(
    robot: Robot | str | os.PathLike[str],
    *,
    shown: Sequence[str] = ("visual",),
    fixed_frame: str = WORLD,
    positions: Mapping[str, float] | None = None,
    host: str = "localhost",
    port: int | None = None,
    **load_options: Any,
) -> PageHandle:
    """Show a robot on a page with sliders, and go on.

    A page of an earlier call for a robot of the same name is closed: a cell that is run
    again doesn't leave one behind.

    Args:
        robot: A robot, or what `load_robot` takes; then it is loaded again when its
            files change.
        shown: What to draw, as `RobotViewer.show`.
        fixed_frame: Link that stays where it is, or "world".
        positions: Positions [rad] or [m] of independent joints, by name.
        host: Address of the page.
        port: Port of the page, or the first free one after it.
        load_options: What else `load_robot` takes.

    Raises:
        ArmDrakeError: If the robot can't be shown, or the page can't be there.
    """
    if isinstance(robot, Robot):
        if load_options:
            name = next(iter(load_options))
            raise InputError(f"{name}: the robot is loaded already")
        load: Callable[[], Robot] = lambda: robot  # noqa: E731
    else:
        load = functools.partial(load_robot, robot, **load_options)
    # What was loaded is shown; only when files change it is loaded again.
    loaded = [load()]
    name = f"view {loaded[0].name}"

    def make(page: Page) -> RobotViewer:
        viewer = RobotViewer(
            page,
            lambda: loaded.pop() if loaded else load(),
            shown=shown,
            fixed_frame=fixed_frame,
        )
        if positions:
            viewer.set_positions(positions)
        return viewer

    return _open_page(name, lambda: Page(host=host, port=port), make)


def simulate(
    robots: Robots,
    *,
    motion: Motion | str | None = None,
    world: World = "empty",
    options: SimulationOptions | None = None,
    realtime_rate: float = 1.0,
    is_paused: bool = False,
    history: float = 300.0,
    shown: Sequence[str] = ("visual",),
    host: str = "localhost",
    port: int | None = None,
) -> PageHandle:
    """Simulate robots on a page, with all that Gazebo's window has, and go on.

    A page of an earlier call for robots of the same names is closed. The simulation is
    the attribute `simulation` of what `PageHandle.call` hands over: it runs in the
    page's thread, so use it there alone.

    Args:
        robots: One or several loaded robots, or what `load_robot` takes.
        motion: What to send to the controllers: a motion, or the name of one that comes
            with the first robot, or of a file.
        world: As `build_diagram`.
        options: How to simulate.
        realtime_rate: Simulated seconds per second; 0 is as fast as it goes.
        is_paused: Whether it waits for the page's play button, or `play`.
        history: How much of the past the rollout has at least [s].
        shown: What to draw, as `LiveViews.show`.
        host: Address of the page.
        port: Port of the page, or the first free one after it.

    Raises:
        ArmDrakeError: If the robots can't be simulated, or the page can't be there.
    """
    given, loaded = options or SimulationOptions(), _load(robots)

    def make(page: Page) -> LiveSimulation:
        own = dc.replace(given, frame_rate=0.0)
        diagram = build_diagram(loaded, world=world, options=own, meshcat=page.meshcat)
        return LiveSimulation(
            page,
            Simulation(diagram),
            motion=_motion_of(motion, loaded),
            realtime_rate=realtime_rate,
            is_paused=is_paused,
            history=history,
            shown=shown,
        )

    names = ", ".join(robot.name for robot in loaded)
    return _open_page(f"simulate {names}", lambda: Page(host=host, port=port), make)


def animate(
    robots: Robots,
    duration: float,
    *,
    motion: Motion | str | None = None,
    world: World = "empty",
    options: SimulationOptions | None = None,
) -> tuple[Simulation, Recording]:
    """Simulate robots as fast as it goes; return the simulation and its recording.

    Args:
        robots: One or several loaded robots, or what `load_robot` takes.
        duration: How long [s].
        motion: What to send to the controllers: a motion, or the name of one that comes
            with the first robot, or of a file.
        world: As `build_diagram`.
        options: How to simulate.

    Raises:
        ArmDrakeError: If the robots can't be simulated.
    """
    if not 0.0 < duration < math.inf:
        raise InputError(f"duration: expected more than 0 s, got {duration!r}")
    given, loaded = options or SimulationOptions(), _load(robots)
    rate = given.frame_rate or SimulationOptions.frame_rate
    with Scene() as scene:
        meshcat = scene.meshcat
        # It draws nothing by itself, so that another one may have the Meshcat later.
        own = dc.replace(given, frame_rate=0.0)
        diagram = build_diagram(loaded, world=world, options=own, meshcat=meshcat)
        simulation = Simulation(diagram)
        frame_robots(simulation, meshcat, room=ROOM_TO_MOVE)
        start_recording(meshcat, rate)
        run_drawing(
            simulation,
            duration,
            _motion_of(motion, loaded),
            draw=lambda: draw(simulation),
            frame_rate=rate,
        )
        meshcat.StopRecording()
        meshcat.PublishRecording()
        page = meshcat.StaticHtml()
    return simulation, Recording(page)


def _load(robots: Robots) -> list[Robot]:
    """Return robots, which are loaded if they are not yet."""
    if isinstance(robots, str | os.PathLike):
        return [load_robot(robots)]
    return list_robots(robots)


def _motion_of(motion: Motion | str | None, robots: Sequence[Robot]) -> Motion | None:
    if motion is None or isinstance(motion, Motion):
        return motion
    return find_motion(motion, robots[0])


def _open_page(
    name: str, make_page: Callable[[], Page], make: Callable[[Page], Any]
) -> PageHandle:
    """Return a page, in place of the one of the same name."""
    with _lock:
        before = _open.pop(name, None)
    if before is not None:
        before.close()
    handle = PageHandle(PageThread(make_page, make))
    with _lock:
        _open[name] = handle
    return handle
