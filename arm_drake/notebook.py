"""Pages that live beside a program: for notebooks and interactive Python.

Each has a thread of its own. A Meshcat can be used in the thread alone that made it,
and is never destroyed (see `arm_drake.visualization.page.scene`). So a thread that has
served a page waits for the next one: however often a cell is run again, no more servers
are there than pages were at once.
"""

import concurrent.futures
import dataclasses as dc
import functools
import html
import math
import os
import queue
import sys
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.joints import WORLD
from arm_drake.description.robot import Robot, list_robots
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError
from arm_drake.loading import load_robot
from arm_drake.options import SimulationOptions
from arm_drake.output_files import writing
from arm_drake.planning.motion_planning import Plan
from arm_drake.planning.surroundings import show_standing
from arm_drake.plant.plant import add_robot_model, add_visualizer
from arm_drake.simulation.motion_files import (
    MotionSource,
    find_motion,
)
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.drawing import (
    ROOM_TO_MOVE,
    draw,
    frame_robots,
    run_drawing,
)
from arm_drake.visualization.meshcat import frame_shapes, show_ground
from arm_drake.visualization.page import Page, Scene
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.robot_viewer import RobotViewer
from arm_drake.visualization.recording import make_recording, start_recording
from arm_drake.worlds.world import World, load_world

_LAYOUT = 'width="100%" height="520" style="border: 1px solid #ccc"'

# Modules and variables of notebooks that run on another machine than their browser.
_REMOTE_MODULES = ("google.colab",)
_REMOTE_VARIABLES = (
    "BINDER_LAUNCH_HOST",
    "JUPYTERHUB_SERVICE_PREFIX",
    "KAGGLE_KERNEL_RUN_TYPE",
)


class Recording:
    """Recording of a simulation; in a notebook its value plays in the cell."""

    def __init__(self, page: str) -> None:
        """Create it.

        Args:
            page: A page of HTML that needs nothing else.
        """
        self.html = page

    def __repr__(self) -> str:
        """Return how large it is."""
        return f"<Recording, {len(self.html) / 1e6:.1f} MB of HTML>"

    def save(self, path: str | Path) -> None:
        """Write it as a file that any browser opens.

        Args:
            path: HTML file.

        Raises:
            OutputError: If it can't be written.
        """
        with writing(Path(path)):
            Path(path).write_text(self.html, encoding="utf-8")

    def _repr_html_(self) -> str:
        return html_in_a_cell(self.html)


def is_browser_elsewhere() -> bool:
    """Return whether the notebook's browser can't reach pages of this machine."""
    return any(name in sys.modules for name in _REMOTE_MODULES) or any(
        name in os.environ for name in _REMOTE_VARIABLES
    )


def html_in_a_cell(page: str) -> str:
    """Return what shows a page of HTML inside a notebook's cell."""
    return f'<iframe srcdoc="{html.escape(page)}" {_LAYOUT}></iframe>'


def page_in_a_cell(url: str) -> str:
    """Return what shows a page inside a notebook's cell."""
    return f'<iframe src="{url}" {_LAYOUT}></iframe>'


T = TypeVar("T")


class _Workers:
    """The threads that wait for a page."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[queue.SimpleQueue[Callable[[], None]]] = []

    def do(self, task: Callable[[], None]) -> None:
        """Have a thread do something, an idle one if there is one."""
        with self._lock:
            tasks = self._idle.pop() if self._idle else None
        if tasks is None:
            tasks = queue.SimpleQueue()
            name = "arm_drake pages"
            threading.Thread(
                target=self._work, args=(tasks,), name=name, daemon=True
            ).start()
        tasks.put(task)

    def _work(self, tasks: queue.SimpleQueue[Callable[[], None]]) -> None:
        while True:
            task = tasks.get()
            task()
            del task  # What it holds may go.
            with self._lock:
                self._idle.append(tasks)


_workers = _Workers()


class PageThread:
    """A page with what uses it, in a thread of its own."""

    def __init__(
        self, make_page: Callable[[], Page], make: Callable[[Page], Any]
    ) -> None:
        """Start it, and wait until the page is open."""
        self._ready: concurrent.futures.Future[Page] = concurrent.futures.Future()
        self._done = threading.Event()
        self._is_unwanted = False
        self._runner: Any = None
        self._thread: int | None = None
        # What ended it, if nobody did.
        self.error: BaseException | None = None
        _workers.do(lambda: self._live(make_page, make))
        try:
            self._page = self._ready.result()
        except BaseException:
            # Such as a Ctrl-C, while the page is still being made.
            self._is_unwanted = True
            raise

    @property
    def url(self) -> str:
        """The page's address."""
        return self._page.url

    @property
    def is_open(self) -> bool:
        """Whether the page is still there."""
        return not self._done.is_set()

    def call(self, function: Callable[[Any], T]) -> T:
        """Do something in the thread and return what it returns.

        Args:
            function: Takes what uses the page.

        Raises:
            RuntimeError: If the page is closed.
            Whatever the function raises.
        """
        if threading.get_ident() == self._thread:
            return function(self._runner)
        result: concurrent.futures.Future[T] = concurrent.futures.Future()

        def act() -> None:
            try:
                result.set_result(function(self._runner))
            # It is the caller's, whatever it is; Drake's checks end in a SystemExit.
            except BaseException as error:
                result.set_exception(error)

        if self.is_open:
            self._page.call(act)
        while not result.done():
            concurrent.futures.wait([result], timeout=0.1)
            if not self.is_open and not result.done():
                why = f": {self.error}" if self.error is not None else ""
                raise RuntimeError(f"the page is closed{why}") from self.error
        return result.result()

    def request_close(self) -> None:
        """Have the page end, and don't wait for it."""
        if self.is_open:
            self._page.call(lambda: self._runner.stop())

    def close(self) -> None:
        """End the page; its address is free again."""
        self.request_close()
        if threading.get_ident() != self._thread:
            self._done.wait()

    def _live(self, make_page: Callable[[], Page], make: Callable[[Page], Any]) -> None:
        self._thread = threading.get_ident()
        try:
            with make_page() as page:
                self._runner = make(page)
                self._ready.set_result(page)
                if not self._is_unwanted:
                    self._runner.run()
        except BaseException as error:
            if not self._ready.done():
                self._ready.set_exception(error)
            else:
                self.error = error
                print(f"arm_drake: a page has ended: {error}", file=sys.stderr)
        finally:
            if isinstance(self._runner, LiveSimulation):
                self._runner.close()
            self._runner = self._thread = None
            self._done.set()


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
        """Return also the attributes of what is shown."""
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
        port: Port of the page, or the first free one after it; 0 is any free one.
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
    motion: MotionSource | None = None,
    world: World = "empty",
    options: SimulationOptions | None = None,
    realtime_rate: float = 1.0,
    is_paused: bool = False,
    history: float = 300.0,
    shown: Sequence[str] = ("visual",),
    host: str = "localhost",
    port: int | None = None,
    ros: str | None = None,
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
        port: Port of the page, or the first free one after it; 0 is any free one.
        ros: How programs that speak ROS 2 get in, such as "rosbridge"; see `RosServer`.

    Raises:
        ArmDrakeError: If the robots can't be simulated, or the page can't be there.
    """
    base_options, loaded = options or SimulationOptions(), _load(robots)

    def make(page: Page) -> LiveSimulation:
        own = dc.replace(base_options, frame_rate=0.0)
        diagram = build_diagram(loaded, world=world, options=own, meshcat=page.meshcat)
        return LiveSimulation(
            page,
            Simulation(diagram),
            motion=motion,
            realtime_rate=realtime_rate,
            is_paused=is_paused,
            history=history,
            shown=shown,
            ros=ros,
        )

    names = ", ".join(robot.name for robot in loaded)
    return _open_page(f"simulate {names}", lambda: Page(host=host, port=port), make)


def animate(
    robots: Robots,
    duration: float | None = None,
    *,
    motion: MotionSource | None = None,
    world: World = "empty",
    options: SimulationOptions | None = None,
    loop: bool = False,
) -> tuple[Simulation, Recording]:
    """Simulate robots as fast as it goes; return the simulation and its recording.

    Args:
        robots: One or several loaded robots, or what `load_robot` takes.
        duration: How long [s]; by default as `Simulation.run`.
        motion: What to send to the controllers: a motion, or the name of one that comes
            with the first robot, or of a file.
        world: As `build_diagram`.
        options: How to simulate.
        loop: Whether the recording begins anew at its end.

    Raises:
        ArmDrakeError: If the robots can't be simulated.
    """
    base_options, loaded = options or SimulationOptions(), _load(robots)
    chosen = None if motion is None else find_motion(motion, loaded[0])
    if duration is not None and not 0.0 < duration < math.inf:
        raise InputError(f"duration: expected more than 0 s, got {duration!r}")
    rate = base_options.frame_rate or SimulationOptions.frame_rate
    with Scene() as scene:
        meshcat = scene.meshcat
        # It draws nothing by itself, so that another one may have the Meshcat later.
        own = dc.replace(base_options, frame_rate=0.0)
        diagram = build_diagram(loaded, world=world, options=own, meshcat=meshcat)
        simulation = Simulation(diagram)
        frame_robots(simulation, meshcat, room=ROOM_TO_MOVE)
        start_recording(meshcat, rate)
        run_drawing(
            simulation,
            duration,
            chosen,
            draw=lambda: draw(simulation),
            frame_rate=rate,
        )
        names = ", ".join(robot.title for robot in loaded)
        page = make_recording(meshcat, names, loop=loop)
    return simulation, Recording(page)


def record_plan(plan: Plan, *, loop: bool = True) -> Recording:
    """Return a page that plays a plan; `Plan.animate` does that."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    load_world(plan.world, plan.robot.package_paths).add_to(plant)
    robot = plan.robot
    model = add_robot_model(plant, robot.description, robot.name, robot.pose)
    show_standing(plant, scene_graph, model, plan.things)
    plant.Finalize()
    rate = SimulationOptions.frame_rate
    with Scene() as scene:
        meshcat = scene.meshcat
        show_ground(meshcat)
        add_visualizer(builder, scene_graph, meshcat)
        diagram = builder.Build()
        root = diagram.CreateDefaultContext()
        context = plant.GetMyMutableContextFromRoot(root)
        start_recording(meshcat, rate)
        for index, point in enumerate(plan.trajectory.points):
            root.SetTime(point.time_from_start.to_seconds())
            q = plant.GetPositions(context)
            for name, value in plan.positions_at(index).items():
                q[plant.GetJointByName(name, model).position_start()] = value
            plant.SetPositions(context, q)
            diagram.ForcedPublish(root)
        query = scene_graph.get_query_output_port().Eval(
            scene_graph.GetMyContextFromRoot(root)
        )
        frame_shapes(meshcat, query, models=[robot.name], room=ROOM_TO_MOVE)
        return Recording(make_recording(meshcat, f"{robot.title}: plan", loop=loop))


def _load(robots: Robots) -> list[Robot]:
    """Return robots, which are loaded if they are not yet."""
    if isinstance(robots, str | os.PathLike):
        return [load_robot(robots)]
    return list_robots(robots)


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
