"""The base class of remotes: widgets that command one controller, and their ranges."""

import dataclasses as dc
import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import Cycle
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import InterfaceInfo
from arm_drake.errors import InputError, check_known
from arm_drake.importing import dataclass
from arm_drake.interfaces import ACCELERATION, EFFORT, POSITION, VELOCITY
from arm_drake.manager import ControllerManager
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page.widgets import Button, Buttons, Slider, Widget

# Measured values are shown in such steps, in their unit: they never stand quite still.
_DIGITS = 4


# What can be done with grippers: their buttons, in the order of both ends.
GRIPS = ("open", "close")


class Remote(ABC):
    """Commands one controller by widgets; what they do are methods too.

    It sends nothing before somebody uses it. What was sent is forgotten when the
    controller is deactivated, as the controller forgets it.
    """

    def __init__(self, simulation: Simulation, controller: str) -> None:
        """Create it, as `find_remotes` does, for `<name>` or `<robot>/<name>`."""
        self._manager, loaded, self._system = simulation.directory.find(controller)
        self.controller = controller
        self.title = controller
        self._simulation = simulation
        self._handle = simulation.controller(controller)
        self._name = loaded.name
        self._activation: int | None = None
        # Made once by the classes below.
        self._layout: tuple[Widget, ...] = ()
        # Fields of the widgets as they were told last.
        self._published: dict[str, dict[str, Any]] = {}

    @abstractmethod
    def _values(self) -> Mapping[str, float]:
        """Return what the sliders show, by their parts of the ids."""

    @abstractmethod
    def _act(self, part: str, value: float | None) -> None:
        """Do what a widget of an active controller stands for."""

    @abstractmethod
    def reset(self) -> None:
        """Forget what was sent, as at the start of a simulation."""

    @property
    def is_active(self) -> bool:
        """Whether the controller runs and takes commands of its topics."""
        cycle = self._cycle()
        return self._name in cycle.active and self._name not in cycle.chained

    def widgets(self) -> tuple[Widget, ...]:
        """Return the widgets as they are now; ids start with `remote:<controller>:`."""
        self._renew()
        self._published = self._fields()
        return tuple(_with_fields(widget, self._published) for widget in self._layout)

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return new values of fields of the widgets since the last time, by id."""
        self._renew()
        fields = self._fields()
        changed = {
            name: {
                key: v for key, v in new.items() if self._published[name].get(key) != v
            }
            if name in self._published
            else new
            for name, new in fields.items()
        }
        self._published = fields
        return {name: new for name, new in changed.items() if new}

    def handle(self, event_id: str, value: Any = None) -> float | None:
        """Do what somebody did in the browser, or raise InputError.

        The value of a slider is kept within its range, and returned; that of a button
        is None.
        """
        # The browser shows another value than it was told.
        self._published.get(event_id, {}).pop("value", None)
        known = {widget.id: widget for widget in self._leaves()}
        self._check_known("widget", event_id, known)
        widget = known[event_id]
        if isinstance(widget, Slider):
            number = self._number(value, widget.label)
            value = min(max(number, widget.lower), widget.upper)
        else:
            value = None
        self._prepare()
        self._act(event_id.removeprefix(self.id_of("")), value)
        return value

    def axes(self) -> "Mapping[str, Axis]":
        """Return what sliders say of joints, by their parts of the ids."""
        return {}

    def value_of(self, part: str) -> float:
        """Return what a slider shows."""
        return self._values()[part]

    def tick(self, time: float) -> None:
        """Send what must be repeated; to be called ten times a second of its time."""
        del time
        self._renew()

    def _prepare(self) -> None:
        """Raise InputError if the controller takes nothing now."""
        self._renew()
        cycle = self._cycle()
        if self._name not in cycle.active:
            raise self._error("it isn't active; activate it first")
        if self._name in cycle.chained:
            raise self._error("another controller commands it, so it takes no topic")

    def _renew(self) -> None:
        """Forget what was sent in an activation that has ended."""
        activation = self._cycle().active.get(self._name)
        if activation != self._activation:
            self._activation = activation
            self.reset()

    def _cycle(self) -> Cycle:
        root = self._simulation.simulator.get_context()
        context = self._manager.GetMyContextFromRoot(root)
        cycle: Cycle = self._manager.GetOutputPort("cycle").Eval(context)
        return cycle

    def _measured(self) -> defaultdict[str, float]:
        """Return positions of joints [rad] or [m]; 0 for those that aren't there.

        A controller that names such a joint is loaded, and can't be activated.
        """
        state = self._simulation.joint_states(self._manager.robot.name)
        return defaultdict(float, zip(state.name, state.position, strict=True))

    def _publish(self, port: str, data: Any) -> None:
        """Publish on a topic that is a port of the controller."""
        own = port if port.startswith("/") else f"/{self._name}/{port}"
        self._simulation.topic(f"/{self._manager.prefix}{own[1:]}").publish(data)

    def id_of(self, part: str) -> str:
        """Return the id of a widget."""
        return f"remote:{self.controller}:{part}"

    def _slider(self, part: str, axis: "Axis", label: str = "") -> Slider:
        """Return the slider of a number, by default called as its joint."""
        ends = axis.lower, axis.upper
        return Slider(self.id_of(part), label or axis.joint, *ends, 0.0, axis.unit)

    def _grip_buttons(self) -> list[Button]:
        return [Button(self.id_of(text), text) for text in GRIPS]

    def _fields(self) -> dict[str, dict[str, Any]]:
        """Return the fields that change of every widget."""
        values, is_enabled = self._values(), self.is_active
        start = self.id_of("")
        fields: dict[str, dict[str, Any]] = {}
        for widget in self._leaves():
            fields[widget.id] = {"is_enabled": is_enabled}
            part = widget.id.removeprefix(start)
            if part in values:
                fields[widget.id]["value"] = values[part]
        return fields

    def _leaves(self) -> Iterator[Slider | Button]:
        for widget in self._layout:
            if isinstance(widget, Buttons):
                yield from widget.buttons
            elif isinstance(widget, Slider | Button):
                yield widget

    def _number(self, value: Any, what: str) -> float:
        try:
            if not isinstance(value, bool) and math.isfinite(value):
                return float(value)
        except (TypeError, OverflowError):
            pass
        raise self._error(f"{what}: expected a finite number, got {value!r}")

    def _check_known(self, kind: str, name: str, known: Collection[str]) -> None:
        check_known(kind, name, known, argument=f"controller {self.controller!r}")

    def _error(self, problem: str) -> InputError:
        return InputError(f"controller {self.controller!r}: {problem}")


class GrippingRemote(Remote):
    """A remote of joints, among which there may be a gripper's."""

    # Where the gripper is open and where closed, by what moves it.
    _grips: Mapping[str, tuple[float, float]]

    @abstractmethod
    def _move_grips(self, positions: Mapping[str, float]) -> None:
        """Send positions of the gripper, by what moves it."""

    def open(self) -> None:
        """Open the gripper among the joints; raise InputError if there is none."""
        self._grip(0)

    def close(self) -> None:
        """Close the gripper that is among the joints; raises as `open`."""
        self._grip(1)

    def _grip(self, end: int) -> None:
        if not self._grips:
            raise self._error("none of its joints is known to be a gripper's")
        self._move_grips({name: ends[end] for name, ends in self._grips.items()})


def find_plugins(manager: ControllerManager, name: str) -> tuple[Any, ...]:
    """Return the tags of Gazebo's plugins that a controller stands for."""
    for controller in manager.robot.controllers.controllers:
        if controller.name == name:
            return controller.plugins
    return ()


def shown(measured: float) -> float:
    """Return a measured value as sliders show it."""
    return round(measured, _DIGITS) + 0.0


def _with_fields(widget: Widget, fields: Mapping[str, dict[str, Any]]) -> Widget:
    if isinstance(widget, Buttons):
        buttons = (dc.replace(b, **fields.get(b.id, {})) for b in widget.buttons)
        return Buttons(tuple(buttons))
    return dc.replace(widget, **fields.get(widget.id, {}))


# Largest speed of a joint without a limit [rad/s] and [m/s].
_TURN, _SLIDE = 1.0, 0.1

# Ends of the range of any other number without limits, in its unit.
_END = 1.0

# Limits further away stand for none, such as 1e16: a slider is no use.
_FAR = 1e4


@dataclass(frozen=True)
class Axis:
    """A number that a controller takes for a joint, or for something else."""

    # Such as "joint1/position".
    name: str

    # Such as "joint1" and "position".
    joint: str
    interface: str

    # Where it can be put by a slider, and in which unit.
    lower: float
    upper: float
    unit: str

    # Whether it is the position of a joint that turns without end.
    wraps: bool = False

    # The joint's largest speed, or what stands for it [rad/s] or [m/s].
    speed: float = _TURN

    def show(self, value: float) -> float:
        """Return a value as a slider shows it."""
        return math.remainder(value, 2.0 * math.pi) if self.wraps else value

    def nearest(self, value: float, present: float) -> float:
        """Return what is the same as a value, and nearest to the present one."""
        if not self.wraps:
            return value
        return present + math.remainder(value - present, 2.0 * math.pi)


def find_axis(robot: Robot, params: ControllerInterfaceParams, name: str) -> Axis:
    """Return what is to be known of a command interface.

    Its range is that of the joint, within the limits that the hardware's description
    gives the interface. A joint without a velocity limit is taken to reach 1 rad/s or
    0.1 m/s; other limits that are missing are -1 and 1. An interface of another
    controller stands for the joint that its name tells.
    """
    owner, _, interface = name.rpartition("/")
    joint = owner if owner in params.joint_types else owner.rpartition("/")[2]
    kind = params.joint_types.get(joint)
    limits = _find_interface(robot, f"{joint}/{interface}")
    if kind is None or interface not in interfaces.MOTIONS:
        ends = _narrow(-math.inf, math.inf, limits)
        lower, upper = ends if all(map(math.isfinite, ends)) else (-_END, _END)
        return Axis(name, joint, interface, lower, upper, "")
    is_slide = kind == "prismatic"
    speed = _known(params.velocity_limits.get(joint), _SLIDE if is_slide else _TURN)
    wraps = False
    if interface == POSITION:
        own = next(r for r in joint_ranges(robot.description) if r.name == joint)
        lower, upper, wraps = own.lower, own.upper, own.wraps
    else:
        largest = {
            VELOCITY: speed,
            ACCELERATION: _END,
            EFFORT: _known(params.effort_limits.get(joint), _END),
        }
        lower, upper = -largest[interface], largest[interface]
    inner = _narrow(lower, upper, limits)
    wraps = wraps and inner == (lower, upper)
    unit = ("m/s²" if is_slide else "rad/s²") if interface == ACCELERATION else ""
    unit = unit or interfaces.unit(interface, kind)
    return Axis(name, joint, interface, *inner, unit, wraps, speed)


def _known(limit: float | None, otherwise: float) -> float:
    """Return a limit if it is one."""
    return limit if limit is not None and limit <= _FAR else otherwise


def _find_interface(robot: Robot, name: str) -> InterfaceInfo | None:
    """Return a command interface of the hardware, if its limits hold."""
    for block in robot.description.hardware:
        for component in (*block.joints, *block.gpios):
            for interface in component.command_interfaces:
                if f"{component.name}/{interface.name}" == name:
                    holds = component.enable_limits and interface.enable_limits
                    return interface if holds else None
    return None


def _narrow(
    lower: float, upper: float, limits: InterfaceInfo | None
) -> tuple[float, float]:
    """Return a range within limits, unless they have nothing in common."""
    if limits is None:
        return lower, upper
    inner_lower = lower if limits.min is None else max(lower, limits.min)
    inner_upper = upper if limits.max is None else min(upper, limits.max)
    if not inner_lower <= inner_upper:
        return lower, upper
    return inner_lower, inner_upper
