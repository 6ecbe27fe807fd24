"""Sliders that drive a base, and a button that stops it."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.description.gazebo_drives import DiffDrive
from arm_drake.errors import InputError
from arm_drake.messages import Twist, Vector3
from arm_drake.simulation.controller_topics import ControllerTopics
from arm_drake.visualization.page.remote import Remote, find_plugins
from arm_drake.visualization.page.widgets import Button, Slider

if TYPE_CHECKING:
    from arm_drake.simulation.simulation import Simulation

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

    def __init__(self, simulation: "Simulation", controller: str) -> None:
        """Create it; `find_remotes` does that.

        Args:
            simulation: Where the controller runs.
            controller: Its name with its robot's prefix.
        """
        super().__init__(simulation, controller)
        self._velocity = dict(_REST)
        system = self._system
        self._port = find_velocity_port(system) or ""
        # Of all bases, those with rollers alone are told how fast to go sideways.
        self.has_sideways = any("/linear/y/" in n for n in system.reference_interfaces)
        self._layout = (
            *(
                Slider(self._id(name), name, *self._range(name), 0.0, unit)
                for name, (_, unit, _) in _SLIDERS.items()
                if name != "sideways" or self.has_sideways
            ),
            Button(self._id("stop"), "stop"),
        )

    def drive(self, forward: float, sideways: float = 0.0, turn: float = 0.0) -> None:
        """Move at a velocity from now on, as long as `tick` is called.

        Args:
            forward: Along the base's x axis [m/s].
            sideways: Along its y axis, to the left [m/s].
            turn: About its z axis, to the left [rad/s].

        Raises:
            InputError: If the controller isn't active, if a number isn't finite, or if
                the base can't go sideways.
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
        """Send the velocity once more, unless it is 0: controllers wait for 0.5 s.

        Args:
            time: Simulated time [s].
        """
        super().tick(time)
        if self.is_active and any(self._velocity.values()):
            self._send(self._velocity)

    def _forget(self) -> None:
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
            if isinstance(tag, DiffDrive):
                kind = place.partition(".")[0]
                own = getattr(tag, f"{end}_{kind}_velocity")
                common = getattr(tag, f"{end}_velocity")
                return _finite(common if math.isnan(own) else own)
        for controller in self._manager.robot.controllers.controllers:
            if controller.name == self._name:
                given = {n: p.value for n, p in controller.parameters.items()}
                if given.get(f"{place}.has_velocity_limits") is False:
                    return None
                return _finite(given.get(f"{place}.{end}_velocity"))
        return None


def find_velocity_port(system: ControllerInterface) -> str | None:
    """Return on which port a controller takes velocities of a base; None for none.

    It is empty where `ControllerHandle.send_velocity` knows it.

    Args:
        system: The controller.
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
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else None
