"""Environment: a robot under its own controller as Gymnasium has it, and its tasks.

The interface is that of `gymnasium.Env`; `ReachTask` is the Doosan tutorial's: the end
of the arm comes to a sphere somewhere in its reach.
"""

import inspect
import math
import time
import webbrowser
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, SupportsFloat

import gymnasium
import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    RenderCameraCore,
    Rgba,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from arm_drake.arrays import Array, is_finite, is_number
from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.entry import Source
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError, SimulationError, check_known, quoted, suggest
from arm_drake.importing import dataclass
from arm_drake.loading import load_robot
from arm_drake.messages import Duration, JointTrajectory, JointTrajectoryPoint
from arm_drake.options import SimulationOptions
from arm_drake.perception.scenery import RENDERER, Mark, Scenery
from arm_drake.planning.groups import find_group, joints_of
from arm_drake.plant.joint_ranges import joint_ranges, randomize
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.meshcat import THREE_QUARTER, start_meshcat
from arm_drake.worlds.world import World

RENDER_MODES = ("human", "rgb_array", "meshcat")

# Controllers that take the commands of some joints, and what they command.
_FORWARD = {
    "effort_controllers/JointGroupEffortController": "effort",
    "position_controllers/JointGroupPositionController": "position",
    "velocity_controllers/JointGroupVelocityController": "velocity",
}
_FORWARD_COMMAND = "forward_command_controller/ForwardCommandController"
_TRAJECTORY = "joint_trajectory_controller/JointTrajectoryController"

# Where a joint states no limit: [rad/s] or [m/s], and [N m] or [N].
_SPEED, _EFFORT = 1.0, 10.0

# Size of a picture, vertical field of view [rad], and what it sees [m].
_WIDTH, _HEIGHT, _FIELD_OF_VIEW = 640, 480, 0.8
_NEAR, _FAR = 0.01, 100.0

# Colour behind everything.
_SKY = (0.9, 0.93, 0.97)

# Joint velocities that are observed, over the joint's limit, at most.
_MOST = 2.0


class Evaluation(NamedTuple):
    """Evaluation of a task after a step."""

    reward: float

    # Whether the task is done, or can't be done any more.
    is_terminated: bool = False

    # What else is to be known; `is_success` is what libraries look for.
    info: dict[str, Any] = {}  # noqa: RUF012  Nobody changes it.


class TaskShape(NamedTuple):
    """Something that is seen of a task."""

    shape: Shape

    # In the world.
    pose: RigidTransform
    color: Rgba


class Task:
    """Base class of a robot's tasks.

    An environment calls `reset` at the start of each episode, `observe` and `evaluate`
    after each step.
    """

    # After so long an episode is truncated [s].
    time_limit: float = 4.0

    def bounds(self, environment: "Environment") -> tuple[Array, Array]:
        """Return the least and the largest values of `observe`, each shape (n,)."""
        return np.zeros(0), np.zeros(0)

    def reset(self, environment: "Environment", generator: np.random.Generator) -> None:
        """Begin an episode, with all that is random from the generator."""

    def observe(self, environment: "Environment") -> Array:
        """Return what an agent sees of the task beside the robot, shape (n,)."""
        return np.zeros(0)

    def evaluate(self, environment: "Environment") -> Evaluation:
        """Return the reward of the last step, and whether the task is done."""
        raise NotImplementedError

    def shapes(self) -> Sequence[TaskShape]:
        """Return what shows the task on a page and in pictures, after each reset."""
        return ()


class ReachTask(Task):
    """The tip comes to a sphere, which is somewhere else in each episode.

    The reward of a step is minus the distance [m], and 10 more in the sphere, where the
    episode ends.
    """

    def __init__(
        self,
        *,
        frame: str | None = None,
        radius: float = 0.05,
        region: tuple[tuple[float, ...], tuple[float, ...]] | None = None,
        time_limit: float = 4.0,
    ) -> None:
        """Create it.

        Args:
            frame: Link that comes there, by default the tip of the planning group.
            radius: Radius of the sphere [m].
            region: Least and largest x, y, z of its middle in the world [m]; by default
                it is where the tip is at random positions of the joints, so that it can
                be reached.
            time_limit: How long an episode is [s].

        Raises:
            InputError: If the radius, the region or the time is none.
        """
        if not radius > 0.0 or not time_limit > 0.0:
            text = f"got radius {radius!r}, time limit {time_limit!r}"
            raise InputError(f"expected a radius [m] and a time [s] above 0, {text}")
        if region is not None:
            low, high = (np.asarray(each, float) for each in region)
            if low.shape != (3,) or high.shape != (3,) or not np.all(low <= high):
                text = f"got {region!r}"
                raise InputError(f"region: expected least and largest x, y, z, {text}")
        self.frame, self.radius, self.region = frame, radius, region
        self.time_limit = time_limit
        self.goal = np.zeros(3)
        self._reach = 0.0

    def bounds(self, environment: "Environment") -> tuple[Array, Array]:
        """Return the bounds of the way to the sphere and of where it is [m]."""
        if self.frame is None:
            self.frame = find_group(environment.robot, None).tip
        environment.check_frame(self.frame)
        generator = np.random.default_rng(0)
        tips = [self._draw_reachable(environment, generator) for _ in range(200)]
        corners = [*tips, *(np.asarray(each, float) for each in self.region or ())]
        self._reach = 1.2 * float(np.abs(corners).max())
        most = np.concatenate([np.full(3, 2.0), np.ones(3)]) * self._reach
        return -most, most

    def reset(self, environment: "Environment", generator: np.random.Generator) -> None:
        """Put the sphere somewhere."""
        if self.region is None:
            self.goal = self._draw_reachable(environment, generator)
        else:
            self.goal = generator.uniform(*self.region)

    def _draw_reachable(
        self, environment: "Environment", generator: np.random.Generator
    ) -> Array:
        assert self.frame is not None
        robot = environment.robot
        while True:
            positions = randomize(joint_ranges(robot.description), generator)
            tip = robot.forward_kinematics(positions, self.frame).translation()
            if tip[2] > self.radius:  # Not below the ground.
                return np.asarray(tip)

    def observe(self, environment: "Environment") -> Array:
        """Return the way to the sphere, and where it is in the world [m]."""
        return np.concatenate([self.goal - self._tip(environment), self.goal])

    def evaluate(self, environment: "Environment") -> Evaluation:
        """Return the reward for the distance."""
        distance = float(np.linalg.norm(self.goal - self._tip(environment)))
        is_reached = distance <= self.radius
        info = {"distance": distance, "is_success": is_reached}
        return Evaluation(10.0 * is_reached - distance, is_reached, info)

    def _tip(self, environment: "Environment") -> Array:
        assert self.frame is not None
        return environment.link_pose(self.frame).translation()

    def shapes(self) -> Sequence[TaskShape]:
        """Return the sphere."""
        sphere = Sphere(self.radius)
        return [TaskShape(sphere, RigidTransform(self.goal), Rgba(0.1, 0.7, 0.2, 1.0))]


@dataclass(frozen=True)
class _Actuation:
    """The controller that takes actions, and what they mean."""

    controller: str
    joints: tuple[str, ...]

    # "position", "velocity" or "effort"; a trajectory controller is sent points.
    interface: str
    is_trajectory: bool

    # What an action of 1 is: the joints' limits of velocity or effort, shape (n,).
    scale: Array

    # Limits of the positions [rad] or [m], shape (n,).
    lower: Array
    upper: Array


class Environment(gymnasium.Env[Array, Array]):
    """A robot with a task, as `gymnasium.Env`.

    An action has a number from -1 to 1 for each joint of the controller. Where that
    commands positions, 1 moves the commanded position at the joint's limit of velocity;
    where it commands velocities or efforts, 1 is the joint's limit of these. What a
    joint doesn't limit is 1 rad/s or m/s, and 10 N m or N.

    An observation is, for each of these joints, its position from -1 to 1 within its
    range, and its velocity over its limit; then what the task adds.

    One that failed in physics ends with `info["failure"]`. `simulation` is the
    Simulation beneath, `generator` the source of all that is random.
    """

    def __init__(
        self,
        robot: Robot,
        task: Task,
        *,
        controller: str | None = None,
        period: float = 0.05,
        world: World = "empty",
        options: SimulationOptions | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Create it; `make_env` does that."""
        if render_mode is not None and render_mode not in RENDER_MODES:
            hint = suggest(str(render_mode), RENDER_MODES)
            raise InputError(f"unknown render_mode {render_mode!r}; {hint}")
        if not (is_number(period) and 0.0 < period < math.inf):
            raise InputError(f"period: expected a time [s] above 0, got {period!r}")
        if not isinstance(task, Task):
            text = "expected a task, such as ReachTask() or a class of your own"
            raise InputError(f"task: {text} that is a Task, got {task!r}")
        self.robot, self.task, self.period = robot, task, period
        self.render_mode = render_mode
        self.metadata = {
            "render_modes": list(RENDER_MODES),
            "render_fps": round(1.0 / period),
        }
        self.meshcat = start_meshcat() if render_mode in ("human", "meshcat") else None
        self._actuation = _find_actuation(robot, controller)
        options = options or SimulationOptions(preset="fast")
        diagram = build_diagram(
            robot, world=world, options=options, meshcat=self.meshcat
        )
        self._camera = _Camera() if render_mode == "rgb_array" else None
        self.simulation = Simulation(diagram)
        self.generator = np.random.default_rng()
        count = len(self._actuation.joints)
        self._command = np.zeros(count)
        ones = np.ones(count)
        self.action_space = gymnasium.spaces.Box(-ones, ones, dtype=np.float64)
        low, high = task.bounds(self)
        # A joint may be a little outside, and faster than its limit.
        self.observation_space = gymnasium.spaces.Box(
            np.concatenate([-_MOST * ones, -_MOST * ones, low]),
            np.concatenate([_MOST * ones, _MOST * ones, high]),
            dtype=np.float64,
        )
        self._shown_at: float | None = None

    def check_frame(self, name: str) -> None:
        """Raise InputError if there is no link of this name."""
        links = self.robot.description.links
        check_known("link", name, links)

    def link_pose(self, name: str) -> RigidTransform:
        """Return where a link is in the world, or raise InputError."""
        self.check_frame(name)
        return self.simulation.link_poses()[name]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode: the robot where it starts, the task drawn anew."""
        super().reset(seed=seed)
        self.simulation.reset()
        positions, _ = self._read_joints()
        self._command = positions
        self.task.reset(self, self.np_random)
        for index, (shape, pose, color) in enumerate(self.task.shapes()):
            if self.meshcat is not None:
                self.meshcat.SetObject(f"task/{index}", shape, color)
                self.meshcat.SetTransform(f"task/{index}", pose)
        info = dict(self._evaluate().info)
        if self.render_mode == "human":
            self.render()
        return self._observe(), info

    def step(
        self, action: Array
    ) -> tuple[Array, SupportsFloat, bool, bool, dict[str, Any]]:
        """Send an action to the controller, and go on by one period."""
        action = np.asarray(action, float)
        if action.shape != self.action_space.shape or not np.isfinite(action).all():
            text = f"expected {self.action_space.shape} finite numbers"
            raise InputError(f"action: {text}, got {action!r}")
        self._send(np.clip(action, -1.0, 1.0))
        simulation = self.simulation
        failure = None
        try:
            simulation.advance_to(simulation.time + self.period)
        except SimulationError as error:
            failure = str(error)
        reward, is_terminated, info = self._evaluate()
        info = dict(info)
        if failure is not None:
            info["failure"] = failure
        is_late = simulation.time >= self.task.time_limit - 1e-9
        if self.render_mode == "human":
            self.render()
        is_over = is_terminated or failure is not None
        return self._observe(), reward, is_over, is_late and not is_over, info

    def _evaluate(self) -> Evaluation:
        """Return what the task says, or raise InputError if that is no evaluation."""
        found, name = self.task.evaluate(self), type(self.task).__name__
        if not (isinstance(found, tuple) and len(found) == 3):
            text = f"expected an Evaluation(reward, is_terminated, info), got {found!r}"
            raise InputError(f"{name}.evaluate: {text}")
        found = Evaluation(*found)
        if not is_finite(found.reward):
            text = f"expected a finite number as reward, got {found.reward!r}"
            raise InputError(f"{name}.evaluate: {text}")
        if not isinstance(found.info, Mapping):
            text = f"expected a mapping as info, got {found.info!r}"
            raise InputError(f"{name}.evaluate: {text}")
        return found

    def _send(self, action: Array) -> None:
        actuation = self._actuation
        handle = self.simulation.controller(actuation.controller)
        if actuation.interface != "position":
            handle.command(list(action * actuation.scale))
            return
        change = action * actuation.scale * self.period
        self._command = np.clip(
            self._command + change, actuation.lower, actuation.upper
        )
        positions = tuple(self._command.tolist())
        if not actuation.is_trajectory:
            handle.command(positions)
            return
        takes = Duration.of(self.period)
        point = JointTrajectoryPoint(positions, time_from_start=takes)
        trajectory = JointTrajectory(joint_names=actuation.joints, points=(point,))
        # Said where from, it is not warned of: actions may be as fast as they like.
        handle.send_trajectory(trajectory, where="action")

    def _read_joints(self) -> tuple[Array, Array]:
        """Return positions [rad, m] and velocities of the joints that are moved."""
        states = self.simulation.joint_states()
        index = [states.name.index(name) for name in self._actuation.joints]
        return np.take(states.position, index), np.take(states.velocity, index)

    def _observe(self) -> Array:
        positions, velocities = self._read_joints()
        lower, upper = self._actuation.lower, self._actuation.upper
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        speeds = _limits(self.robot, self._actuation.joints, "velocity", _SPEED)
        seen = np.concatenate([(positions - middle) / half, velocities / speeds])
        seen = np.concatenate([np.clip(seen, -_MOST, _MOST), self.task.observe(self)])
        space = self.observation_space
        return np.clip(seen, space.low, space.high)  # type: ignore[attr-defined]

    def render(self) -> Any:
        """Return a picture, shape (480, 640, 3), uint8, or show the robot on a page.

        With "human" it takes as long as it takes in reality.
        """
        if self._camera is not None:
            return self._camera.take(self.simulation, self.task.shapes())
        if self.meshcat is None:
            return None
        if self.render_mode == "human":
            if self._shown_at is None:
                webbrowser.open(self.meshcat.web_url())
                self._shown_at = time.monotonic()
            self._shown_at += self.period
            time.sleep(max(self._shown_at - time.monotonic(), 0.0))
            self._shown_at = max(self._shown_at, time.monotonic() - self.period)
        return None

    def close(self) -> None:
        """Let the page go."""
        self.meshcat = None
        self._camera = None


def make_env(
    robot: Robot | Source,
    *,
    task: Task | None = None,
    controller: str | None = None,
    period: float = 0.05,
    world: World = "empty",
    options: SimulationOptions | None = None,
    render_mode: str | None = None,
    **load_options: Any,
) -> Environment:
    """Return an environment of Gymnasium: a robot with a task.

    Args:
        robot: A robot, or what `load_robot` takes.
        task: What is asked of it, by default a `ReachTask`. It is this environment's
            own.
        controller: The controller that takes the actions, by default the first that
            takes trajectories or commands of most joints.
        period: Time of a step [s].
        world: As of `build_diagram`.
        options: How to simulate, by default with the preset `fast`.
        render_mode: "human" (a page in the browser, in real time), "rgb_array" (what
            `render` returns), "meshcat" (a page, as fast as it goes) or none.
        load_options: What else `load_robot` takes.

    Raises:
        InputError: If something isn't there, or no controller takes actions.
        MissingExtraError: If Gymnasium isn't installed.
    """
    if not isinstance(robot, Robot):
        known = [*inspect.signature(load_robot).parameters][1:]
        for name in load_options:
            if name not in known:
                own = [*inspect.signature(make_env).parameters][1:-1]
                hint = suggest(name, [*own, *known])
                raise InputError(f"make_env: no option {name!r}; {hint}")
        robot = load_robot(robot, **load_options)
    elif load_options:
        raise InputError(f"{next(iter(load_options))}: the robot is loaded already")
    return Environment(
        robot,
        task or ReachTask(),
        controller=controller,
        period=period,
        world=world,
        options=options,
        render_mode=render_mode,
    )


def _find_actuation(robot: Robot, name: str | None) -> _Actuation:
    """Return the controller that takes actions, or raise InputError."""
    found = {}
    for config in robot.controllers.controllers:
        actuation = _read_actuation(robot, config)
        if actuation is not None:
            found[config.name] = actuation
    if name is not None and name not in found:
        known = [config.name for config in robot.controllers.controllers]
        hint = suggest(name, found)
        problem = "takes no actions" if name in known else "isn't there"
        raise InputError(f"controller {name!r} {problem}; {hint}")
    if not found:
        names = quoted(config.name for config in robot.controllers.controllers)
        raise InputError(
            f"robot {robot.name!r}: no controller takes trajectories or commands of "
            f"joints; there are {names or 'none'}. A xacro argument may choose others, "
            "as xacro_args={'control': 'ros2_control'} does for mycobot_280"
        )
    if name is not None:
        return found[name]
    return max(found.values(), key=lambda each: len(each.joints))


def _read_actuation(robot: Robot, config: ControllerConfig) -> _Actuation | None:
    def parameter(key: str) -> Any:
        parameter = config.parameters.get(key)
        return None if parameter is None else parameter.value

    interface = _FORWARD.get(config.type)
    if config.type == _FORWARD_COMMAND:
        interface = parameter("interface_name")
    elif config.type == _TRAJECTORY:
        commanded = parameter("command_interfaces") or []
        interface = "position" if commanded else None
    known = {joint.name for joint in robot.description.movable_joints}
    joints = joints_of(config)
    if interface not in ("position", "velocity", "effort") or not joints:
        return None
    if not set(joints) <= known:
        return None
    ranges = {each.name: each for each in joint_ranges(robot.description)}
    what = ("effort", _EFFORT) if interface == "effort" else ("velocity", _SPEED)
    return _Actuation(
        controller=config.name,
        joints=joints,
        interface=interface,
        is_trajectory=config.type == _TRAJECTORY,
        scale=_limits(robot, joints, *what),
        lower=np.array([ranges[joint].lower for joint in joints]),
        upper=np.array([ranges[joint].upper for joint in joints]),
    )


def _limits(
    robot: Robot, joints: tuple[str, ...], what: str, otherwise: float
) -> Array:
    description = robot.description
    return np.array(
        [getattr(description.joint(n).limits, what) or otherwise for n in joints]
    )


class _Camera:
    """Takes pictures of a simulation, without a page."""

    def __init__(self) -> None:
        """Load nothing yet."""
        self._scenery = Scenery(None, _SKY)
        core = RenderCameraCore(
            RENDERER,
            CameraInfo(_WIDTH, _HEIGHT, _FIELD_OF_VIEW),
            ClippingRange(_NEAR, _FAR),
            RigidTransform(),
        )
        self._camera = ColorRenderCamera(core)

    def take(self, simulation: Simulation, shapes: Sequence[TaskShape]) -> Array:
        """Return a picture, shape (480, 640, 3), uint8."""
        scene_graph = simulation.diagram.GetSubsystemByName("scene_graph")
        assert isinstance(scene_graph, SceneGraph)
        context = scene_graph.GetMyContextFromRoot(simulation.context)
        query = scene_graph.get_query_output_port().Eval(context)
        self._scenery.mark(query, [Mark(*each) for each in shapes])
        points = np.array([X.translation() for X in simulation.link_poses().values()])
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        size = max(float(np.ptp(points, axis=0).max()), 0.3)
        eye = middle + 2.2 * size * np.array(THREE_QUARTER)
        return self._scenery.color(query, self._camera, _look_at(eye, middle))


def _look_at(eye: Array, target: Array) -> RigidTransform:
    """Return the pose of a camera, z forward and y down."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = RotationMatrix(np.column_stack([right, np.cross(forward, right), forward]))
    return RigidTransform(turn, eye)
