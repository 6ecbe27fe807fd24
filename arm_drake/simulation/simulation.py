"""Simulation: a Simulator with commands in and a Rollout out."""

import dataclasses as dc
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from arm_drake.arrays import is_finite, is_number
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeError, InputError, OutputError, SimulationError
from arm_drake.manager import MANAGER, SWITCH_PORT
from arm_drake.messages import (
    GoalStatus,
    JointState,
    Message,
    Strictness,
    SwitchController,
)
from arm_drake.output_files import unbroken, writing
from arm_drake.plant.contact import rejoin
from arm_drake.plant.payloads import Payload, Payloads, set_payload, split_payloads
from arm_drake.rollout.formats import stream_writer_for
from arm_drake.rollout.rollout import Rollout
from arm_drake.simulation.clients import ControllerHandle, TopicHandle, list_topics
from arm_drake.simulation.directory import (
    ControllerList,
    Directory,
    TopicList,
    make_switch,
)
from arm_drake.simulation.mailbox import (
    Failure,
    GoalHandle,
    Mailbox,
    Rejection,
    SimulationEvent,
)
from arm_drake.simulation.motion import Motion, PlanTo, TaskOutcome, default_duration
from arm_drake.simulation.motion_files import MotionSource, find_motion
from arm_drake.simulation.playback import Player
from arm_drake.simulation.recording import (
    History,
    collect_rollout,
    find_build_info,
    read_joint_states,
)
from arm_drake.simulation.topics import TopicNames
from arm_drake.worlds.things import free_poses

if TYPE_CHECKING:
    from arm_drake.perception.cameras import CameraHandle
    from arm_drake.perception.lidar import LidarHandle
    from arm_drake.perception.sensors import SensorSystem
    from arm_drake.planning.motion_planning import Plan, Target

# Times of rows are rounded to nanoseconds [s].
_SAME_TIME = 1e-9

# How often it writes [s] of simulated time.
PERIOD = 1.0


class Recorder:
    """Writes the rows, messages and goals of a simulation each simulated second.

    Whenever the program ends, even if it is killed, the file has all but what came
    after the last write. A simulation that is reset begins its file anew.
    """

    def __init__(
        self,
        simulation: "Simulation",
        path: Path,
        *,
        robot: str | None = None,
        history: float = math.inf,
    ) -> None:
        """Start to record; `Simulation.record_to` does that."""
        if not is_number(history) or not history > 0.0:
            raise InputError(f"history must be positive, got {history!r}")
        self.path = path
        self._simulation = simulation
        self._make = stream_writer_for(path)
        self._robots = list(simulation.directory.managers)
        if robot is not None:
            self._robots = [simulation.directory.manager(robot).robot.name]
        if path.suffix == ".csv" and len(self._robots) > 1:
            names = ", ".join(self._robots)
            raise OutputError(
                f"a table is of one robot; expected robot=, one of {names}", file=path
            )
        if any(path.resolve() == r.path.resolve() for r in simulation.recorders):
            raise OutputError("it is being recorded to already", file=path)
        self.history = history
        self._history = History(simulation.mailbox, history)
        # What was before isn't recorded; the first write would find some of it.
        self._start: float | None = simulation.mailbox.time
        self._written = self._start
        self._open()
        simulation.recorders.append(self)

    def update(self) -> None:
        """Write what is new, if it has been a while."""
        if self._simulation.mailbox.time >= self._written + PERIOD:
            self.flush()

    def flush(self) -> None:
        """Write what is new, or raise OutputError."""
        # The last row may have been at the very time of the last write.
        simulation, since = self._simulation, self._written - PERIOD
        find = simulation.directory.manager
        parts = [
            collect_rollout(simulation.mailbox, find(robot), simulation.motions, since)
            for robot in self._robots
        ]
        if self._start is not None:
            parts = [_since(part, self._start) for part in parts]
        # What is half written would be lost, and all that follows with it.
        with unbroken():
            with writing(self.path):
                self._writer.write(*parts)
            self._written, self._start = self._simulation.mailbox.time, None
            self._count(parts)
            # What another one is to keep stays.
            others = self._simulation.recorders
            if all(other.history <= self.history for other in others):
                self._history.trim()

    def restart(self) -> None:
        """Begin the file anew, as the simulation begins anew."""
        self._writer.close()
        self._open()
        self._written, self._start = self._simulation.mailbox.time, None

    def close(self) -> None:
        """Write what is new, and end the file."""
        if self in self._simulation.recorders:
            self._simulation.recorders.remove(self)
            try:
                self.flush()
            finally:
                self._writer.close()

    def effort_saturation(self, robot: str) -> dict[str, float]:
        """Return how long joints were at their effort limit [s], by joint.

        It is as that of the Rollout, also of rows that are no longer in memory.
        """
        return {joint: time for joint, time in self._saturation[robot].items() if time}

    def __enter__(self) -> Self:
        """Return itself; leaving the block ends the file."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the file."""
        self.close()

    def _open(self) -> None:
        with writing(self.path):
            self._writer = self._make(self.path)
        # The last row that was counted [s], and how long joints were at their limits.
        self._counted: dict[str, float] = defaultdict(lambda: -math.inf)
        self._saturation: dict[str, dict[str, float]] = defaultdict(
            lambda: defaultdict(float)
        )

    def _count(self, parts: list[Rollout]) -> None:
        """Add up how long joints were at their effort limits."""
        for robot, part in zip(self._robots, parts, strict=True):
            rows = part.time > self._counted[robot]
            if rows.any():
                self._counted[robot] = float(part.time[-1])
            for joint, time in part.time_at_limit(rows).items():
                self._saturation[robot][joint] += time


def _since(rollout: Rollout, time: float) -> Rollout:
    """Return a rollout without what was before a time [s]."""
    rows = rollout.time >= time - _SAME_TIME
    return dc.replace(
        rollout,
        time=rollout.time[rows],
        position=rollout.position[rows],
        velocity=rollout.velocity[rows],
        effort=rollout.effort[rows],
        command=rollout.command[rows],
        active=rollout.active[rows],
        references={
            name: dc.replace(reference, position=reference.position[rows])
            for name, reference in rollout.references.items()
        },
        free_poses={name: poses[rows] for name, poses in rollout.free_poses.items()},
        contact_forces={name: f[rows] for name, f in rollout.contact_forces.items()},
        goals=tuple(
            goal
            for goal in rollout.goals
            if goal.ended_at is None or goal.ended_at >= time
        ),
        sensor_messages={
            topic: tuple(
                m
                for m in messages
                if m.header.stamp.to_seconds() >= time - _SAME_TIME  # type: ignore[attr-defined]
            )
            for topic, messages in rollout.sensor_messages.items()
        },
        messages=tuple(m for m in rollout.messages if m.time >= time - _SAME_TIME),
        inputs=tuple(i for i in rollout.inputs if i.time >= time - _SAME_TIME),
    )


class ResetRequested(Exception):
    """Whoever exchanges with a simulation wants it to begin anew."""


def advance(simulator: Simulator, time: float) -> None:
    """Simulate up to a time."""
    try:
        simulator.AdvanceTo(time)
    # Drake's own checks end in a SystemExit.
    except (RuntimeError, SystemExit) as error:
        now, reason = simulator.get_context().get_time(), " ".join(str(error).split())
        text = f"the simulation can't go on at {now:.4f} s: {reason}"
        raise SimulationError(text) from error


# How long a goal may take after the end of its trajectory [s], and how often is looked.
_GOAL_PATIENCE, _GOAL_PERIOD = 5.0, 0.02

# Ticks between two looks at the controllers' events; they keep the latest 64.
_TICKS_AT_A_TIME = 50

# What a robot can be asked for by its name: `/<robot>/home`.
TASK_SPACE = ("kinematics", "trajectory", "home")

# How often shapes that overlapped at the start are looked at [s].
_LOOK_PERIOD = 0.1

# A step is due at the first tick that isn't earlier by more than this part of a period.
TICK_TOLERANCE = 1e-6


class Simulation:
    """Runs a diagram of `build_diagram`, sends to its controllers, records it.

    Drake's own objects are its attributes: `diagram`, `simulator`, the simulator's
    `context` (the root context), and `plant`, whose context is
    `plant.GetMyContextFromRoot(context)`.
    """

    def __init__(self, diagram: Diagram) -> None:
        """Create a simulation at time 0.

        Args:
            diagram: Diagram of `build_diagram`; with its robots and controllers in it.

        Raises:
            InputError: If it is none, or has no robot.
        """
        self._take(diagram, Simulator(Directory.checked(diagram)))
        self._on_event: list[Callable[[SimulationEvent], None]] = []
        # Called between any two ticks, by who talks to others meanwhile. It returns the
        # time at which it wants to be called next at the latest [s], and may raise
        # ResetRequested.
        self.exchange: Callable[[], float] | None = None
        self.recorders: list[Recorder] = []
        managers = self.directory.managers.values()
        self.mailbox = Mailbox(diagram, self.simulator, managers)
        self._start()

    def _take(self, diagram: Diagram, simulator: Simulator) -> None:
        self.diagram, self.simulator = diagram, simulator
        self.directory = Directory(diagram)
        self._topics = TopicNames(self.directory.managers)
        managers = self.directory.managers.values()
        # Of the quickest controller manager [s].
        self.period = min(manager.period for manager in managers)
        info = find_build_info(diagram)
        # Shapes that overlap at the start, and how often is looked at them.
        self._parted = () if info is None else info.parted
        self._ticks_of_looks = max(round(_LOOK_PERIOD / self.period), 1)

    def replace_diagram(self, diagram: Diagram, simulator: Simulator) -> None:
        """Go on with another diagram of the same robots, in its simulator's state."""
        self._take(diagram, simulator)
        self.mailbox.move_to(diagram, simulator, self.directory.managers.values())

    def _start(self) -> None:
        self.simulator.Initialize()
        self.mailbox.reset()
        # What was played, in order.
        self.motions: list[Motion] = []

    def __repr__(self) -> str:
        """Return its robots and its time."""
        return f"<Simulation, robots {[*self.directory.managers]}, {self.time:g} s>"

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.mailbox.time

    @property
    def context(self) -> Context:
        """The root context of the diagram, as it is now, to be read and to be set."""
        return self.simulator.get_mutable_context()

    @property
    def plant(self) -> MultibodyPlant:
        """The plant of robots and world; the preset kinematic has none in its diagram.

        Raises:
            InputError: If there is none.
        """
        plant = self.diagram.GetSubsystemByName("plant")
        if not isinstance(plant, MultibodyPlant):
            raise InputError("the preset kinematic has no physics, and no plant")
        return plant

    @property
    def robots(self) -> dict[str, Robot]:
        """The robots by name."""
        return {n: each.robot for n, each in self.directory.managers.items()}

    @property
    def things(self) -> dict[str, RigidTransform]:
        """Poses of bodies of the world that move freely, by the names `pick` takes."""
        return free_poses(self.plant, self.context, self.robots)

    @property
    def goals(self) -> list[GoalHandle]:
        """The goals that were sent, in order."""
        return self.mailbox.goals

    @property
    def tasks(self) -> list[TaskOutcome]:
        """Results of picking, placing and following in motions, in order."""
        return self.mailbox.tasks

    @property
    def rejected(self) -> list[Rejection]:
        """Messages and parameters that controllers refused, in order."""
        return self.mailbox.rejected

    @property
    def failures(self) -> list[GoalHandle | Failure]:
        """Goals that were rejected or aborted; then what else failed, in order.

        That are controllers, and switches that were refused. A goal that is part of
        another task, as a gripper's of a pick, is left to that task's result. Refused
        messages are in `rejected`.
        """
        return [*self.mailbox.failed_goals, *self.mailbox.failures]

    @property
    def report(self) -> LoadReport:
        """The load report of the first robot, and what its controllers lack."""
        return self.directory.manager(None).report

    def controller(self, name: str) -> ControllerHandle:
        """Return what sends to a controller.

        Args:
            name: Its name; `<robot>/<name>` where there are several robots.

        Raises:
            InputError: If there is no such controller, or it could not be loaded.
        """
        manager, controller, system = self.directory.find(name)
        robot = manager.robot
        return ControllerHandle(self.mailbox, robot, name, system, controller.type)

    def topic(self, name: str) -> TopicHandle:
        """Return what publishes on a topic, or reads it.

        Args:
            name: Its name in ROS or Gazebo, as "/arm/joint_trajectory"; or a request of
                a robot, `/<robot>/kinematics`, `/<robot>/trajectory`, `/<robot>/home`.

        Raises:
            InputError: If there is no such topic.
        """
        if isinstance(name, str) and name.rpartition("/")[2] in TASK_SPACE:
            from arm_drake.simulation.task_space import find_request

            if (request := find_request(self, name)) is not None:
                return request
        return TopicHandle(self.mailbox, self._topics.find(name))

    def camera(self, name: str) -> "CameraHandle":
        """Return what a camera sees.

        Args:
            name: Its name; `<robot>/<name>` where there are several robots.

        Raises:
            InputError: If there is no such camera.
        """
        from arm_drake.perception.cameras import Camera, CameraHandle
        from arm_drake.perception.sensors import find_sensor

        none = "; arm_drake.add_camera adds one"
        camera = find_sensor(self._sensors(), Camera, name, none)
        return CameraHandle(camera, lambda: self.simulator.get_context())

    def lidar(self, name: str) -> "LidarHandle":
        """Return what a lidar measures.

        Args:
            name: Its name; `<robot>/<name>` where there are several robots.

        Raises:
            InputError: If there is no such lidar.
        """
        from arm_drake.perception.lidar import Lidar, LidarHandle
        from arm_drake.perception.sensors import find_sensor

        lidar = find_sensor(self._sensors(), Lidar, name)
        return LidarHandle(lidar, lambda: self.simulator.get_context())

    def _sensors(self) -> "dict[str, SensorSystem]":
        """Return cameras and lidars by name, with the robot's prefix."""
        return {
            f"{manager.prefix}{sensor.sensor.name}": sensor
            for manager in self.directory.managers.values()
            for sensor in manager.sensors
        }

    def list_topics(self) -> TopicList:
        """Return the topics and the types of their messages; as text, a table."""
        return list_topics(self._topics, self.eval_output)

    def list_controllers(self) -> ControllerList:
        """Return the controllers and their states, in the order of the YAML.

        As text it is a table as that of `ros2 control list_controllers`.
        """
        return self.directory.list_controllers(self.simulator.get_context())

    def switch_controllers(
        self,
        activate: Sequence[str] = (),
        deactivate: Sequence[str] = (),
        *,
        strictness: Strictness = "strict",
        robot: str | None = None,
    ) -> tuple[str, ...]:
        """Activate and deactivate controllers of a robot in the manager's next cycle.

        Args:
            activate: Names of controllers to start.
            deactivate: Names of controllers to stop; one in both lists is restarted.
            strictness: "strict" does all of it or nothing; "best_effort" what can be.
            robot: Name of the robot. By default the names are those of `controller`, or
                else of the first robot.

        Returns:
            What can't be done and is left out, in words.

        Raises:
            InputError: If it is strict and can't be done.
        """
        request = make_switch(activate, deactivate, strictness)
        manager, local = self.directory.address(request, robot)
        problems = manager.find_problems(self.simulator.get_context(), local)
        if problems and strictness == "strict":
            raise InputError("; ".join(problems))
        self.request_switch(request, robot)
        return problems

    def request_switch(
        self, request: SwitchController, robot: str | None = None, *, where: str = ""
    ) -> None:
        """Send a request to the controller manager; what becomes of it is an event.

        Args:
            request: What to activate and deactivate.
            robot: As that of `switch_controllers`.
            where: Where the request comes from, for messages.
        """
        manager, local = self.directory.address(request, robot)
        if where:
            self.mailbox.add_message(local, where)
        if manager.controllers:
            port = f"{manager.prefix}{MANAGER}.{SWITCH_PORT}"
            self.publish(port, local, manager.period)

    def set_payload(self, link: str, payload: Payload | float) -> None:
        """Fix a thing to a link from now on, in place of the one that it has.

        Controllers and servo know nothing of it. What is seen of it, and collides, is
        what `build_diagram(payloads=...)` was given. A reset undoes it.

        Args:
            link: Name of the link; `<robot>/<link>` where there are several robots.
            payload: The thing, or its mass [kg]; 0 is none.

        Raises:
            InputError: If there is no such link, no such thing, or no physics.
        """
        plant = self.plant
        for robot, things in self.check_payloads({link: payload}).items():
            model = plant.GetModelInstanceByName(robot)
            for name, thing in things.items():
                context = plant.GetMyMutableContextFromRoot(self.context)
                set_payload(plant, context, model, name, thing)

    def check_payloads(self, payloads: Payloads) -> dict[str, dict[str, Payload]]:
        """Return payloads by robot and link, or raise as `set_payload`."""
        links = {name: r.description.links for name, r in self.robots.items()}
        return split_payloads(payloads, links) if self.plant else {}

    def joint_states(self, robot: str | None = None) -> JointState:
        """Return position, velocity and effort of every movable joint, now.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self.directory.manager(robot)
        return read_joint_states(self.diagram, self.simulator.get_context(), manager)

    def on_event(self, callback: Callable[[SimulationEvent], None]) -> None:
        """Call a function with events of controllers and their managers.

        Goals come as their handles; refused messages and parameters, answers to
        cancels, results of switches and failures of controllers as themselves.
        """
        self._on_event.append(callback)

    def advance_to(self, time: float) -> None:
        """Simulate up to a time.

        Args:
            time: Simulated time to stop at [s].

        Raises:
            SimulationError: If Drake can't go on, as with a state beyond all numbers.
            ValueError: If the time is past, or no number.
        """
        now = self.time
        if not hasattr(time, "__float__"):
            raise InputError(f"expected a time to simulate up to [s], got {time!r}")
        if not time >= now or not math.isfinite(time):
            raise ValueError(f"can't go from {now} s to {time} s")
        slack = TICK_TOLERANCE * self.period
        while now < time:
            end = min(now + _TICKS_AT_A_TIME * self.period, time)
            if self.mailbox.waiting:
                end = min(end, self.mailbox.publish_due(now + slack) - 0.5 * slack)
            if self.exchange is not None:
                end = min(self.exchange(), self._next_tick(now), end)
            look_at = math.inf
            if self._parted:
                look_at = self._next_tick(now, self._ticks_of_looks)
            end = min(end, look_at)
            advance(self.simulator, end)
            if end >= look_at - slack:
                rejoin(self.diagram, self.context, self._parted)
            if self.exchange is None or end >= self._next_tick(now, _TICKS_AT_A_TIME):
                self.collect_events()
            for recorder in self.recorders:
                recorder.update()
            now = self.time

    def _next_tick(self, time: float, ticks: int = 1) -> float:
        """Return when the next one of so many ticks is [s].

        These times are the same however a run is cut into pieces.
        """
        ticks *= math.floor(time / (ticks * self.period) + TICK_TOLERANCE) + 1
        return ticks * self.period

    def collect_events(self) -> None:
        """Call the listeners with the new events."""
        for event in self.mailbox.collect():
            for callback in self._on_event:
                callback(event)

    def run(
        self,
        duration: float | None = None,
        motion: MotionSource | None = None,
        realtime_rate: float = 0.0,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Simulate for a while, sending the steps of a motion when they are due.

        Args:
            duration: How long [s]; by default 1 s longer than the motion (one round of
                it, or until its tasks are done), 10 s without one.
            motion: What to send, its times counted from now: a Motion, the name of one
                that comes with the first robot, or a file.
            realtime_rate: Simulated seconds per second of wall time; 0 is as fast as
                it goes.
            progress: Called with the simulated time [s], ten times a second of it.

        Raises:
            MotionError: If a step is for a controller that can't take it, or that is
                not active and isn't activated by an earlier step.
            ValueError: If the duration is negative, or no number.
        """
        if motion is not None:
            motion = find_motion(motion, self.directory.manager(None).robot)
        ends = duration is None
        if duration is None:
            duration = default_duration(motion)
        if not is_finite(duration) or duration < 0.0:
            raise ValueError(f"duration must be at least 0 s, got {duration!r}")
        player = Player(self, motion, TICK_TOLERANCE * self.period)
        with player.paced(realtime_rate):
            player.play(duration, progress, ends=ends)

    def move_to(
        self, to: "Target", *, robot: str | None = None, **options: Any
    ) -> "Plan":
        """Plan a motion from where a robot is, execute it, and wait for its end.

        Args:
            to: A state, joint positions, a pose, or a list of these; see `plan`.
            robot: Name of the robot; by default the first one.
            options: Further arguments of `plan`.

        Returns:
            The plan that was executed.

        Raises:
            PlanningError: If there is no plan, or the robot moves.
            NoSolution: If a pose can't be reached.
            SimulationError: If the controller refused or didn't finish it, or the
                robot isn't where it ends.
            InputError: If an argument can't be used, or no controller has the joints.
        """
        from arm_drake.planning.motion_planning import plan
        from arm_drake.simulation.task_space import check_arrival

        if "name" in options:
            raise InputError("name: in move_to this argument is called robot")
        name = self.directory.manager(robot).robot.name
        found = plan(self, to, name=name, **options)
        goal = self.send_planned(found)
        end = self.time + found.duration + _GOAL_PATIENCE
        while goal and not goal.status.is_terminal and self.time < end:
            self.advance_to(self.time + _GOAL_PERIOD)
        if goal and goal.status is not GoalStatus.SUCCEEDED:
            late = "" if goal.status.is_terminal else " after its trajectory's end"
            self.controller(goal.controller).cancel()
            raise SimulationError(f"{goal.controller}: goal {goal.describe()}{late}")
        while not self.rests(name) and self.time < end:
            self.advance_to(self.time + self.period)
        check_arrival(self, found)
        return found

    def check_plan(self, message: PlanTo) -> None:
        """Raise InputError if no plan can be made, or no controller takes it."""
        from arm_drake.simulation.task_space import check_plan

        manager = self.directory.manager(message.robot)
        self.controller(f"{manager.prefix}{check_plan(manager.robot, message)}")

    def send_plan(self, message: PlanTo, *, where: str) -> bool:
        """Plan and send a motion, unless the robot moves; return whether it rested.

        What can't be planned is among `rejected`.
        """
        from arm_drake.planning.motion_planning import plan
        from arm_drake.simulation.task_space import plan_options

        name = self.directory.manager(message.robot).robot.name
        if not self.rests(name):
            return False
        try:
            found = plan(self, message.to, name=name, **plan_options(message))
            self.send_planned(found, where=where)
        except ArmDrakeError as error:
            self.mailbox.reject(message, str(error), where)
        return True

    def end_task(self, outcome: TaskOutcome) -> None:
        """Take note of what became of a task of a motion."""
        self.mailbox.end_task(outcome)
        self.collect_events()

    def send_planned(self, plan: "Plan", *, where: str = "") -> GoalHandle | None:
        """Send a plan to the trajectory controller of its group.

        Where there is none but one that takes positions, it gets them one after the
        other, and there is no goal: None.

        Args:
            plan: The plan of one of the robots, which is where it begins.
            where: The place in a motion file that asks for it.

        Raises:
            InputError: If no controller has exactly the group's joints, the one that
                takes positions isn't active, or the robot isn't where the plan begins.
        """
        from arm_drake.simulation.task_space import send_planned

        return send_planned(self, plan, where)

    def stop_planned(self, robot: str | None = None) -> None:
        """Send no more of the positions of plans that a robot waits for."""
        self.mailbox.forget_waiting(self.directory.manager(robot).prefix)

    def rests(self, robot: str | None = None) -> bool:
        """Return whether no joint of a robot moves, and no goal makes one move."""
        from arm_drake.planning.setting import find_moving

        prefix = self.directory.manager(robot).prefix
        goals = (goal for goal in self.goals if goal.controller.startswith(prefix))
        is_busy = any(not goal.status.is_terminal for goal in goals)
        is_busy |= any(port.startswith(prefix) for port in self.mailbox.waiting)
        return not is_busy and not find_moving(self.joint_states(robot))

    def link_poses(self, robot: str | None = None) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, by the link's name.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self.directory.manager(robot)
        poses = self.eval_output(f"{manager.prefix}frames")
        return dict(zip(manager.robot.description.links, poses, strict=True))

    def reset(self) -> None:
        """Go back to the start: time 0, initial positions, nothing sent."""
        self.simulator.reset_context(self.diagram.CreateDefaultContext())
        self._start()
        for recorder in self.recorders:
            recorder.restart()

    def rollout(self, robot: str | None = None) -> Rollout:
        """Return what was recorded so far.

        Args:
            robot: Name of the robot; by default the first one.
        """
        manager = self.directory.manager(robot)
        return collect_rollout(self.mailbox, manager, self.motions)

    def record_to(
        self, path: str | Path, *, robot: str | None = None, history: float = 60.0
    ) -> Recorder:
        """Write what is recorded to a file, each simulated second; see `Recorder`.

        Args:
            path: `.mcap` file for all robots, or `.csv` file for one.
            robot: Name of the robot; by default all, or the only one.
            history: How much of the past stays in memory at least, for `rollout` [s].
        """
        return Recorder(self, Path(path), robot=robot, history=history)

    def publish(self, port: str, message: Message, period: float) -> None:
        """Put a message on a port, where its controller sees it at its next tick.

        Those of before stay as long as the controller may not have seen them.

        Args:
            port: Input port of the diagram.
            message: What to put there.
            period: Period of the controller [s].
        """
        self.mailbox.publish(port, message, period)

    def eval_output(self, port: str) -> Any:
        """Return the present value of an output port of the diagram."""
        return self.mailbox.eval_output(port)
