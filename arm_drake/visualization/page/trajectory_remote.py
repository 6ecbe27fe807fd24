"""Sliders for the joints of a controller that follows trajectories.

The model is rqt_joint_trajectory_controller (ros2_controllers, master): each goal is a
trajectory of one point with all joints, whose time lets the slowest joint move at its
largest speed times a factor, at first 50 %. There no goal takes less than 0.5 s over
the factor; here a short way may be quicker, so that the robot follows the slider.
"""

import dataclasses as dc
from collections.abc import Mapping
from typing import TYPE_CHECKING

from arm_drake import interfaces
from arm_drake.controllers.gazebo.gazebo_joint_pose_trajectory import (
    GazeboRosJointPoseTrajectory,
)
from arm_drake.errors import suggest
from arm_drake.messages import Duration, Header, JointTrajectory, JointTrajectoryPoint
from arm_drake.simulation.controller_topics import TOPIC
from arm_drake.visualization.page.axes import Axis, find_axis
from arm_drake.visualization.page.remote import GrippingRemote, shown
from arm_drake.visualization.page.widgets import Button, Buttons, Slider

if TYPE_CHECKING:
    from arm_drake.simulation.simulation import Simulation

# The shortest time of a goal [s], and in periods of the controller.
_SHORTEST, _FEWEST_PERIODS = 0.1, 5

# The longest [s]: times of ROS have 32 bits.
_LONGEST = 1e9

# Time between points for controllers that don't interpolate [s], and how many at most.
_STEP, _MAX_STEPS = 0.05, 400


@dc.dataclass(frozen=True)
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

    def __init__(self, simulation: "Simulation", controller: str) -> None:
        """Create it; `find_remotes` does that.

        Args:
            simulation: Where the controller runs.
            controller: Its name with its robot's prefix.
        """
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
                Slider(
                    self._id(f"goal:{joint}"),
                    joint,
                    axis.lower,
                    axis.upper,
                    axis.show(0.0),
                    axis.unit,
                )
                for joint, axis in self._axes.items()
            ),
            Slider(
                self._id("speed"),
                "speed",
                1.0,
                100.0,
                self._percent,
                "%",
                hint="part of the joints' largest speeds, for the next goal",
            ),
        )
        if self._grips:
            buttons = (
                Button(self._id("open"), "open"),
                Button(self._id("close"), "close"),
            )
            self._layout = (*self._layout, Buttons(buttons))

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
        """Send a goal of all joints: a trajectory from where they are.

        Args:
            positions: Goals by joint [rad] or [m]. A joint that turns without end goes
                to the same angle, the shorter way. The others stay at the last goal,
                or without one where they are.
            duration: How long it takes [s]; by default as long as the slowest joint
                needs at its largest speed times `speed`, at least 0.1 s and five
                periods of the controller.

        Raises:
            InputError: If the controller isn't active, if it has no such joint, or if a
                number isn't finite.
        """
        for joint, value in positions.items():
            if joint not in self._axes:
                raise self._error(f"no joint {joint!r}; {suggest(joint, self._axes)}")
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

    def _forget(self) -> None:
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
            self._grip(("open", "close").index(part))
        elif part == "speed":
            self._percent = value
        else:
            self.go_to({part.removeprefix("goal:"): value})
