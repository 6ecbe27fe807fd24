"""Sliders for controllers that hand on numbers: to joints, topics, or other outputs."""

import dataclasses as dc
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

from arm_drake.controllers.gazebo.gazebo_topics import position_topic, velocity_topic
from arm_drake.description.gazebo_joints import JointController, JointPositionController
from arm_drake.errors import suggest
from arm_drake.interfaces import POSITION, VELOCITY
from arm_drake.messages import DynamicInterfaceGroupValues, JointTrajectoryPoint
from arm_drake.messages.control import InterfaceValue
from arm_drake.visualization.page.axes import Axis, find_axis
from arm_drake.visualization.page.remote import GrippingRemote, find_plugins, shown
from arm_drake.visualization.page.widgets import Button, Buttons, Slider

if TYPE_CHECKING:
    from arm_drake.simulation.simulation import Simulation


class CommandRemote(GrippingRemote):
    """Sends numbers to a controller, which acts on them at once."""

    # Whether a message has all numbers; else those alone that are new.
    sends_all = True

    def __init__(self, simulation: "Simulation", controller: str) -> None:
        """Create it; `find_remotes` does that.

        Args:
            simulation: Where the controller runs.
            controller: Its name with its robot's prefix.
        """
        super().__init__(simulation, controller)
        self._axes = {axis.name: axis for axis in self._find_axes()}
        # What was sent last of each number.
        self._sent: dict[str, float] = {}
        self._grips = self._find_grips()
        interfaces = {axis.interface for axis in self._axes.values()}
        self._layout = tuple(
            Slider(
                self._id(f"value:{name}"),
                axis.joint if len(interfaces) == 1 else name,
                axis.lower,
                axis.upper,
                0.0,
                axis.unit,
            )
            for name, axis in self._axes.items()
        )
        buttons = []
        if interfaces - {POSITION}:
            hint = "set all but positions to 0" if POSITION in interfaces else ""
            buttons.append(Button(self._id("zero"), "zero", hint))
        if self._grips:
            buttons += [Button(self._id(text), text) for text in ("open", "close")]
        if buttons:
            self._layout = (*self._layout, Buttons(tuple(buttons)))

    @abstractmethod
    def _find_axes(self) -> list[Axis]:
        """Return the numbers that the controller takes."""

    @abstractmethod
    def _send(self, values: Mapping[str, float]) -> None:
        """Send numbers, by name."""

    def command(self, values: Mapping[str, float]) -> None:
        """Send numbers; they hold until others come.

        Args:
            values: By name, such as "joint1/position", in their units. The position of
                a joint that turns without end is the same angle nearest to the present
                one. Those that are left out are as they were sent last; if they
                never were and must be, positions as measured, the rest 0.

        Raises:
            InputError: If the controller isn't active, if it takes no such number, or
                if one isn't finite.
        """
        for name, value in values.items():
            if name not in self._axes:
                raise self._error(f"no value {name!r}; {suggest(name, self._axes)}")
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

    def _forget(self) -> None:
        self._sent = {}

    def _values(self) -> dict[str, float]:
        now = {name: shown(value) for name, value in self._present().items()}
        at = {**now, **self._sent}
        return {f"value:{name}": self._axes[name].show(at[name]) for name in at}

    def _act(self, part: str, value: float | None) -> None:
        if part == "zero":
            self.zero()
        elif value is None:
            self._grip(("open", "close").index(part))
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
