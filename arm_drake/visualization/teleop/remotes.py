"""Remotes of all kinds of controllers: sliders and buttons, and the same as methods.

The model of the one for trajectories is rqt_joint_trajectory_controller
(ros2_controllers, master): each goal is a trajectory of one point with all joints,
whose time lets the slowest joint move at its largest speed times a factor, at first
50 %. There no goal takes less than 0.5 s over the factor; here a short way may be
quicker, so that the robot follows the slider.
"""

import dataclasses as dc
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from arm_drake import interfaces
from arm_drake.arrays import is_finite
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.gazebo.joint_trajectory import GazeboRosJointPoseTrajectory
from arm_drake.controllers.gazebo.plugin import position_topic, velocity_topic
from arm_drake.description.gazebo_plugins import (
    JointController,
    JointPositionController,
    WheelDrive,
)
from arm_drake.errors import InputError
from arm_drake.importing import dataclass
from arm_drake.interfaces import POSITION, VELOCITY
from arm_drake.messages import (
    Duration,
    DynamicInterfaceGroupValues,
    GripperCommand,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Twist,
    Vector3,
)
from arm_drake.messages.control import InterfaceValue
from arm_drake.simulation.mailbox import GoalHandle
from arm_drake.simulation.simulation import Simulation
from arm_drake.simulation.topics import COMMANDS, TOPIC, ControllerTopics
from arm_drake.visualization.page.widgets import Button, Buttons, Slider
from arm_drake.visualization.teleop.base import (
    GRIPS,
    Axis,
    GrippingRemote,
    Remote,
    find_axis,
    find_plugins,
    shown,
)

# By the sliders' names: the parameters that limit them, their unit, and how far they go
# without limits.
_SLIDERS = {
    "forward": ("linear.x", "m/s", 0.5),
    "sideways": ("linear.y", "m/s", 0.5),
    "turn": ("angular.z", "rad/s", 1.0),
}

_REST = {"forward": 0.0, "sideways": 0.0, "turn": 0.0}


class BaseRemote(Remote):
    """Drives a base; the velocity is sent again in every `tick` until it is 0."""

    def __init__(self, simulation: Simulation, controller: str) -> None:
        """Create it; `find_remotes` does that."""
        super().__init__(simulation, controller)
        self._velocity = dict(_REST)
        system = self._system
        self._port = find_velocity_port(system) or ""
        # Of all bases, some alone are told how fast to go sideways.
        self.has_sideways: bool = getattr(system, "moves_sideways", False)
        self._layout = (
            *(
                Slider(self.id_of(name), name, *self._range(name), 0.0, unit)
                for name, (_, unit, _) in _SLIDERS.items()
                if name != "sideways" or self.has_sideways
            ),
            Button(self.id_of("stop"), "stop"),
        )

    def drive(self, forward: float, sideways: float = 0.0, turn: float = 0.0) -> None:
        """Move at a velocity from now on, as long as `tick` is called.

        It is along the base's x and y axes [m/s], and about z [rad/s]. It is an
        InputError if the controller isn't active, or the base can't do that.
        """
        values = {"forward": forward, "sideways": sideways, "turn": turn}
        new = {name: self._number(value, name) for name, value in values.items()}
        if new["sideways"] and not self.has_sideways:
            raise self._error("this base can't go sideways")
        self._prepare()
        self._send(new)
        self._velocity = new

    def stop(self) -> None:
        """Stop; raises as `drive`."""
        self.drive(0.0)

    def range_of(self, name: str) -> tuple[float, float] | None:
        """Return how fast it may go: "forward", "sideways" [m/s], "turn" [rad/s].

        It is None if it can't.
        """
        can = name != "sideways" or self.has_sideways
        return self._range(name) if can else None

    def _send(self, velocity: Mapping[str, float]) -> None:
        twist = Twist(
            Vector3(velocity["forward"], velocity["sideways"]),
            Vector3(z=velocity["turn"]),
        )
        if self._port:
            self._publish(self._port, twist)
        else:
            self._handle.send_velocity(twist)

    def tick(self, time: float) -> None:
        """Send the velocity once more, unless it is 0: controllers wait for 0.5 s."""
        super().tick(time)
        if self.is_active and any(self._velocity.values()):
            self._send(self._velocity)

    def reset(self) -> None:
        """Forget what was sent."""
        self._velocity = dict(_REST)

    def _values(self) -> dict[str, float]:
        return self._velocity

    def _act(self, part: str, value: float | None) -> None:
        if value is None:
            self.stop()
        else:
            self.drive(**{**self._velocity, part: value})

    def _range(self, name: str) -> tuple[float, float]:
        """Return the range of a slider: the controller's limits, where it has some."""
        place, _, end = _SLIDERS[name]
        upper = self._limit(place, "max")
        lower = self._limit(place, "min")
        # Without a smallest velocity it is the opposite of the largest.
        if lower is None:
            lower = None if upper is None else -upper
        return (-end if lower is None else lower), (end if upper is None else upper)

    def _limit(self, place: str, end: str) -> float | None:
        """Return a limit of the velocity along or about an axis, None for none."""
        for tag in find_plugins(self._manager, self._name):
            if isinstance(tag, WheelDrive):
                kind = place.partition(".")[0]
                own = getattr(tag, f"{end}_{kind}_velocity", math.nan)
                common = getattr(tag, f"{end}_velocity")
                return _finite(common if math.isnan(own) else own)
        for controller in self._manager.robot.controllers.controllers:
            if controller.name == self._name:
                values = {n: p.value for n, p in controller.parameters.items()}
                if values.get(f"{place}.has_velocity_limits") is False:
                    return None
                return _finite(values.get(f"{place}.{end}_velocity"))
        return None


def find_velocity_port(system: ControllerInterface) -> str | None:
    """Return on which port a controller takes velocities of a base; None for none.

    It is empty where `ControllerHandle.send_velocity` knows it.
    """
    name = system.params.controller_name
    try:
        ControllerTopics(name, "", system).make_velocity(Twist())
    except InputError:
        types = getattr(system, "message_types", {})
        ports = (port for port, kind in types.items() if kind is Twist)
        return next(filter(system.HasInputPort, ports), None)
    return ""


def _finite(value: Any) -> float | None:
    return float(value) if is_finite(value) else None


class CommandRemote(GrippingRemote):
    """Sends numbers to a controller, which acts on them at once."""

    # Whether a message has all numbers; else those alone that are new.
    sends_all = True

    def __init__(self, simulation: Simulation, controller: str) -> None:
        """Create it; `find_remotes` does that."""
        super().__init__(simulation, controller)
        self._axes = {axis.name: axis for axis in self._find_axes()}
        # What was sent last of each number.
        self._sent: dict[str, float] = {}
        self._grips = self._find_grips()
        interfaces = {axis.interface for axis in self._axes.values()}
        is_mixed = len(interfaces) > 1
        self._layout = tuple(
            self._slider(f"value:{name}", axis, name if is_mixed else "")
            for name, axis in self._axes.items()
        )
        buttons = []
        if interfaces - {POSITION}:
            hint = "set all but positions to 0" if POSITION in interfaces else ""
            buttons.append(Button(self.id_of("zero"), "zero", hint))
        if self._grips:
            buttons += self._grip_buttons()
        if buttons:
            self._layout = (*self._layout, Buttons(tuple(buttons)))

    @abstractmethod
    def _find_axes(self) -> list[Axis]:
        """Return the numbers that the controller takes."""

    @abstractmethod
    def _send(self, values: Mapping[str, float]) -> None:
        """Send numbers, by name."""

    def command(self, values: Mapping[str, float]) -> None:
        """Send numbers in their units, by name ("joint1/position"), until others come.

        The position of a joint that turns without end is the same angle nearest to the
        present one. Those that are left out are as they were sent last; if they never
        were and must be, positions as measured, the rest 0. It is an InputError if the
        controller isn't active, or takes no such number.
        """
        for name, value in values.items():
            self._check_known("value", name, self._axes)
            self._number(value, name)
        self._prepare()
        present = self._present()
        new = {
            name: self._axes[name].nearest(float(value), present[name])
            for name, value in values.items()
        }
        sent = {**self._sent, **new}
        if self.sends_all:
            sent = {**present, **sent}
        self._send(sent if self.sends_all else new)
        self._sent = sent

    def axes(self) -> Mapping[str, Axis]:
        """Return what the numbers are of, by the sliders' parts of the ids."""
        return {f"value:{name}": axis for name, axis in self._axes.items()}

    def zero(self) -> None:
        """Send 0 for everything that is no position; raises as `command`."""
        self.command({n: 0.0 for n, a in self._axes.items() if a.interface != POSITION})

    def _move_grips(self, positions: Mapping[str, float]) -> None:
        self.command(positions)

    def _find_grips(self) -> dict[str, tuple[float, float]]:
        """Return where a gripper is open and where closed, by numbers that move it."""
        params, grips = self._system.params, {}
        for axis in self._axes.values():
            master, factor = params.followed.get(axis.joint, (axis.joint, 1.0))
            if axis.interface == POSITION and master in params.gripper_ranges:
                is_open, is_closed = params.gripper_ranges[master]
                grips[axis.name] = (factor * is_open, factor * is_closed)
        return grips

    def _present(self) -> dict[str, float]:
        """Return what is measured of positions, and 0 for the rest."""
        measured = self._measured()
        return {
            name: measured[axis.joint] if axis.interface == POSITION else 0.0
            for name, axis in self._axes.items()
        }

    def reset(self) -> None:
        """Forget what was sent."""
        self._sent = {}

    def _values(self) -> dict[str, float]:
        now = {name: shown(value) for name, value in self._present().items()}
        at = {**now, **self._sent}
        return {f"value:{name}": self._axes[name].show(at[name]) for name in at}

    def _act(self, part: str, value: float | None) -> None:
        if part == "zero":
            self.zero()
        elif value is None:
            self._grip(GRIPS.index(part))
        else:
            self.command({part.removeprefix("value:"): value})


class ForwardRemote(CommandRemote):
    """Sends all values at once: forward controllers, groups, references of PIDs."""

    def _find_axes(self) -> list[Axis]:
        system = self._system
        names = system.command_interfaces
        if system.reference_interfaces:
            # What it is told is not what it commands; rates of change come after.
            own = f"{self._name}/"
            references = system.reference_interfaces[: len(names)]
            names = tuple(name.removeprefix(own) for name in references)
        return [find_axis(self._manager.robot, system.params, name) for name in names]

    def _send(self, values: Mapping[str, float]) -> None:
        self._handle.command([values[name] for name in self._axes])


class AdmittanceRemote(CommandRemote):
    """Sends positions that an AdmittanceController keeps to when nothing pushes."""

    def _find_axes(self) -> list[Axis]:
        system, end = self._system, f"/{POSITION}"
        names = (name for name in system.state_interfaces if name.endswith(end))
        return [find_axis(self._manager.robot, system.params, name) for name in names]

    def _send(self, values: Mapping[str, float]) -> None:
        positions = tuple(values[name] for name in self._axes)
        self._publish("joint_references", JointTrajectoryPoint(positions))


class GpioRemote(CommandRemote):
    """Sends values to outputs; those that nobody has touched are left alone."""

    sends_all = False

    def _find_axes(self) -> list[Axis]:
        robot, params = self._manager.robot, self._system.params
        names = self._system.command_interfaces
        return [find_axis(robot, params, name) for name in names]

    def _send(self, values: Mapping[str, float]) -> None:
        groups: dict[str, dict[str, float]] = {}
        for name, value in values.items():
            group, _, interface = name.rpartition("/")
            groups.setdefault(group, {})[interface] = value
        message = DynamicInterfaceGroupValues(
            interface_groups=tuple(groups),
            interface_values=tuple(
                InterfaceValue(tuple(group), tuple(group.values()))
                for group in groups.values()
            ),
        )
        self._publish("commands", message)


class TopicRemote(CommandRemote):
    """Sends numbers on topics of Gazebo's plugins; a number is named as its topic."""

    sends_all = False

    def _find_axes(self) -> list[Axis]:
        robot, params = self._manager.robot, self._system.params
        axes: dict[str, Axis] = {}
        for tag in find_plugins(self._manager, self._name):
            # Several tags may share a topic; the first joint stands for all.
            joint = tag.joint_names[0]
            if isinstance(tag, JointPositionController):
                topic = position_topic(tag, params.robot_name)
                axis = find_axis(robot, params, f"{joint}/{POSITION}")
            elif isinstance(tag, JointController):
                topic = velocity_topic(tag, params.robot_name)
                axis = find_axis(robot, params, f"{joint}/{VELOCITY}")
            axes.setdefault(topic, dc.replace(axis, name=topic))
        return list(axes.values())

    def _send(self, values: Mapping[str, float]) -> None:
        for topic, value in values.items():
            self._publish(topic, value)


# Effort of a gripper that commands efforts, where its joint has no limit [N·m] or [N].
_EFFORT = 10.0


class GripperRemote(Remote):
    """Moves the joint of a controller with the action `gripper_cmd`."""

    def __init__(self, simulation: Simulation, controller: str) -> None:
        """Create it; `find_remotes` does that."""
        super().__init__(simulation, controller)
        system, params = self._system, self._system.params
        end = f"/{interfaces.POSITION}"
        name = next(n for n in system.state_interfaces if n.endswith(end))
        self._axis = find_axis(self._manager.robot, params, name)
        self._ends = params.gripper_ranges.get(self._axis.joint)
        # Without an effort, one that commands efforts does nothing; others take 0 for
        # their default.
        self._effort = 0.0
        if f"{self._axis.joint}/{interfaces.EFFORT}" == system.command_interfaces[0]:
            limit = params.effort_limits.get(self._axis.joint)
            self._effort = _EFFORT if limit is None else limit
        # Position of the last goal.
        self._goal: float | None = None
        self._layout = (self._slider("position", self._axis),)
        if self._ends is not None:
            self._layout = (*self._layout, Buttons(tuple(self._grip_buttons())))

    def axes(self) -> Mapping[str, Axis]:
        """Return the joint, by its slider's part of the id."""
        return {"position": self._axis}

    def move_to(self, position: float) -> GoalHandle:
        """Send a goal."""
        at = self._number(position, "position")
        self._prepare()
        goal = self._handle.send_goal(GripperCommand(at, self._effort))
        self._goal = at
        return goal

    def open(self) -> GoalHandle:
        """Open it, as `move_to`; not knowing where it is open is an InputError."""
        return self._grip(0)

    def close(self) -> GoalHandle:
        """Close it; raises as `open`."""
        return self._grip(1)

    def _grip(self, end: int) -> GoalHandle:
        if self._ends is None:
            joint = self._axis.joint
            raise self._error(f"joint {joint!r} has no limits to tell open from closed")
        return self.move_to(self._ends[end])

    def reset(self) -> None:
        """Forget what was sent."""
        self._goal = None

    def _values(self) -> dict[str, float]:
        if self._goal is not None:
            return {"position": self._goal}
        return {"position": shown(self._measured()[self._axis.joint])}

    def _act(self, part: str, value: float | None) -> None:
        if value is None:
            self._grip(GRIPS.index(part))
        else:
            self.move_to(value)


# The shortest time of a goal [s], and in periods of the controller.
_SHORTEST, _FEWEST_PERIODS = 0.1, 5

# The longest [s]: times of ROS have 32 bits.
_LONGEST = 1e9

# Time between points for controllers that don't interpolate [s], and how many at most.
_STEP, _MAX_STEPS = 0.05, 400


@dataclass(frozen=True)
class _Plan:
    """A goal on its way, as it was sent."""

    # When it was sent, and how long it takes [s].
    time: float
    duration: float

    # Positions of the joints at both ends [rad] or [m].
    start: Mapping[str, float]
    goal: Mapping[str, float]

    def at(self, time: float) -> dict[str, float]:
        """Return the positions at a time [s]."""
        part = min(max((time - self.time) / self.duration, 0.0), 1.0)
        return {j: q + part * (self.goal[j] - q) for j, q in self.start.items()}


class TrajectoryRemote(GrippingRemote):
    """Moves the joints of a controller that follows trajectories.

    Its controller is a JointTrajectoryController, of ros2_control or of Gazebo, or
    Gazebo Classic's GazeboRosJointPoseTrajectory. The last two jump from point to
    point, so their trajectories have many points.
    """

    def __init__(self, simulation: Simulation, controller: str) -> None:
        """Create it; `find_remotes` does that."""
        super().__init__(simulation, controller)
        system, end = self._system, f"/{interfaces.POSITION}"
        self._interpolates = system.HasInputPort(TOPIC)
        self._is_classic = isinstance(system, GazeboRosJointPoseTrajectory)
        names = system.state_interfaces or system.command_interfaces
        # All joints have a position; it is what trajectories are about.
        joints = tuple(n.removesuffix(end) for n in names if n.endswith(end))
        # Of joints that follow one of the others: which, and how far per unit of it.
        self._followers = {
            joint: followed
            for joint, followed in system.params.followed.items()
            if joint in joints and followed[0] in joints
        }
        self._joints = joints
        self._axes: dict[str, Axis] = {
            joint: find_axis(self._manager.robot, system.params, f"{joint}{end}")
            for joint in joints
            if joint not in self._followers
        }
        # Part of the joints' largest speeds [%].
        self._percent = 50.0
        self._plan: _Plan | None = None
        grips = system.params.gripper_ranges
        self._grips = {j: grips[j] for j in self._axes if j in grips}
        self._layout = (
            *(
                self._slider(f"goal:{joint}", axis)
                for joint, axis in self._axes.items()
            ),
            Slider(
                self.id_of("speed"),
                "speed",
                1.0,
                100.0,
                self._percent,
                "%",
                hint="part of the joints' largest speeds, for the next goal",
            ),
        )
        if self._grips:
            self._layout = (*self._layout, Buttons(tuple(self._grip_buttons())))

    def axes(self) -> Mapping[str, Axis]:
        """Return the joints, by their sliders' parts of the ids."""
        return {f"goal:{joint}": axis for joint, axis in self._axes.items()}

    @property
    def speed(self) -> float:
        """Part of the joints' largest speeds that goals use, above 0 and at most 1."""
        return self._percent / 100.0

    @speed.setter
    def speed(self, part: float) -> None:
        if not 0.0 < self._number(part, "speed") <= 1.0:
            raise self._error(f"speed: expected above 0 and at most 1, got {part!r}")
        self._percent = 100.0 * part

    def go_to(
        self, positions: Mapping[str, float], *, duration: float | None = None
    ) -> None:
        """Send a goal of all joints: a trajectory from where they are."""
        for joint, value in positions.items():
            self._check_known("joint", joint, self._axes)
            self._number(value, joint)
        if duration is not None and not (
            0.0 < self._number(duration, "duration") <= _LONGEST
        ):
            expected = f"more than 0 s and at most {_LONGEST:g} s"
            raise self._error(f"duration: expected {expected}, got {duration!r}")
        self._prepare()
        now = self._simulation.time
        measured = self._measured()
        start = {joint: measured[joint] for joint in self._joints}
        if self._plan is not None and not self._interpolates:
            start = self._plan.at(now)  # What it was told to be, not how it sags.
        goal = dict(start if self._plan is None else self._plan.goal)
        for joint, value in positions.items():
            goal[joint] = self._axes[joint].nearest(float(value), start[joint])
        for joint, (master, factor) in self._followers.items():
            goal[joint] = start[joint] + factor * (goal[master] - start[master])
        if duration is None:
            duration = self._duration(start, goal)
        plan = _Plan(now, float(duration), start, goal)
        # Gazebo Classic's has to be told a frame.
        header = Header(frame_id="world") if self._is_classic else Header()
        trajectory = JointTrajectory(header, self._joints, self._points(plan))
        if self._interpolates:
            self._handle.send_trajectory(trajectory)
        else:
            (port,) = self._system.message_types
            self._publish(port, trajectory)
        self._plan = plan

    def _move_grips(self, positions: Mapping[str, float]) -> None:
        self.go_to(positions)

    def _duration(self, start: Mapping[str, float], goal: Mapping[str, float]) -> float:
        """Return how long the way takes [s]."""
        slowest = max(
            abs(goal[joint] - start[joint]) / (self.speed * axis.speed)
            for joint, axis in self._axes.items()
        )
        period = 1.0 / self._system.params.update_rate
        return min(max(slowest, _SHORTEST, _FEWEST_PERIODS * period), _LONGEST)

    def _points(self, plan: _Plan) -> tuple[JointTrajectoryPoint, ...]:
        """Return the points of a trajectory, the last one the goal."""
        number = 1
        if not self._interpolates:
            number = min(max(1, round(plan.duration / _STEP)), _MAX_STEPS)
        step = plan.duration / number
        points = []
        for k in range(1, number + 1):
            at = plan.at(plan.time + k * step) if k < number else plan.goal
            # There it is the time until the next point.
            time = step if self._is_classic else k * step
            values = tuple(at[joint] for joint in self._joints)
            points.append(
                JointTrajectoryPoint(values, time_from_start=Duration.of(time))
            )
        return tuple(points)

    def reset(self) -> None:
        """Forget what was sent."""
        self._plan = None

    def _values(self) -> dict[str, float]:
        if self._plan is None:
            measured = self._measured()
            at = {j: shown(axis.show(measured[j])) for j, axis in self._axes.items()}
        else:
            at = {j: axis.show(self._plan.goal[j]) for j, axis in self._axes.items()}
        goals = {f"goal:{joint}": value for joint, value in at.items()}
        return {**goals, "speed": self._percent}

    def _act(self, part: str, value: float | None) -> None:
        if value is None:
            self._grip(GRIPS.index(part))
        elif part == "speed":
            self._percent = value
        else:
            self.go_to({part.removeprefix("goal:"): value})


def find_remotes(simulation: Simulation) -> list[Remote]:
    """Return what a person can command, one for each controller that takes commands.

    They are in the order of the list, and found by what a controller takes, not by its
    type: active or not, but none that could not be loaded. What publishes alone has
    none.
    """
    remotes = (
        _make_remote(simulation, row.name)
        for row in simulation.list_controllers()
        if row.state != "unconfigured"
    )
    return [remote for remote in remotes if remote is not None]


def _make_remote(simulation: Simulation, name: str) -> Remote | None:
    manager, loaded, system = simulation.directory.find(name)
    if not system.command_interfaces and not system.HasOutputPort(
        interfaces.TWIST_PORT
    ):
        return None
    types = getattr(system, "message_types", {})
    if system.HasInputPort("gripper_cmd"):
        return GripperRemote(simulation, name)
    if system.HasInputPort(TOPIC) or JointTrajectory in types.values():
        return TrajectoryRemote(simulation, name)
    plugins = find_plugins(manager, loaded.name)
    if any(
        isinstance(tag, JointPositionController | JointController) for tag in plugins
    ):
        return TopicRemote(simulation, name)
    if find_velocity_port(system) is not None:
        return BaseRemote(simulation, name)
    if types.get(COMMANDS) is DynamicInterfaceGroupValues:
        return GpioRemote(simulation, name)
    if types.get("joint_references") is JointTrajectoryPoint:
        return AdmittanceRemote(simulation, name)
    try:
        zeros = [0.0] * len(system.command_interfaces)
        ControllerTopics(name, loaded.type, system).make_command(zeros)
    except InputError:
        return None
    return ForwardRemote(simulation, name)
