"""Runs one controller cycle by cycle on hardware that mirrors commands to states.

A state interface is what was written to the command interface of its name; others stay
as they are. `joints` may be `separate`: then no state follows.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from arm_drake import interfaces
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, UpdateResult
from arm_drake.messages import NANOSECONDS, GoalStatus, Message, SendGoal
from tests.controllers.parameters import load

NAME = "controller"

# Time of the first cycle [ns].
START_NS = NANOSECONDS


class Mirrored:
    """A controller, and what its hardware measures and is commanded."""

    def __init__(
        self,
        type_: str,
        parameters: Mapping[str, Any],
        *,
        joints: Sequence[str],
        joint_type: str | Mapping[str, str] = "revolute",
        velocity_limit: float | None = None,
        distro: str = "rolling",
        rate: int = 100,
        states: Mapping[str, float] | None = None,
        commands: Mapping[str, float] | None = None,
        separate: bool = False,
    ) -> None:
        """Make the controller of a type.

        Args:
            type_: Its ros2_control type.
            parameters: Its parameters by dotted names, besides those of every example.
            joints: Joints of the robot.
            joint_type: Their type in the URDF, or that of each.
            velocity_limit: Velocity limit of every joint in the URDF, if there is one.
            distro: Distribution whose behaviour holds.
            rate: Rate of the cycles [Hz].
            states: What is measured at first, 0 where nothing is said.
            commands: What command interfaces hold at first, else NaN.
            separate: Whether states stay as they are.
        """
        self.parameters = dict(parameters)
        self._type, self._distro = type_, distro
        if isinstance(joint_type, str):
            joint_type = dict.fromkeys(joints, joint_type)
        measured = interfaces.interface_names(joints, interfaces.STATE_INTERFACES)
        others = tuple(name for name in states or () if name not in measured)
        limits = {}
        if velocity_limit is not None:
            limits["velocity_limits"] = dict.fromkeys(joints, velocity_limit)
        params = ControllerInterfaceParams(
            controller_name=NAME,
            update_rate=rate,
            period=1.0 / rate,
            joint_types=joint_type,
            command_interfaces=frozenset((*measured, *others)),
            state_interfaces=frozenset((*measured, *others)),
            measured=(*measured, *others),
            distro=distro,
            **limits,
        )
        make = CONTROLLER_TYPES[type_].system
        assert make is not None
        system = make(load(type_, parameters, distro=distro), params)
        assert isinstance(system, TickingController)
        self.system: TickingController[Any] = system
        claims = system.command_interfaces
        self._values = system.add_command_values(claims)
        self._simulator = Simulator(system)
        self.context = self._simulator.get_mutable_context()
        self._period_ns = NANOSECONDS // rate
        self._cycle, self._activation, self._is_active = -1, 0, False
        self._separate = separate
        self._sent: set[str] = set()
        self._num_seen = 0

        # Time of the next cycle [ns]; not 0, which upstream takes for none.
        self.time_ns = START_NS

        # What is measured and what is commanded, by name.
        self.states = {**dict.fromkeys(params.measured, 0.0), **(states or {})}
        self.commands = {n: (commands or {}).get(n, np.nan) for n in claims}

        # Commands of every cycle, shape (k,), and the news.
        self.rows: list[list[float]] = []
        self.events: list[Any] = []

    def tick(
        self,
        *,
        active: bool = True,
        period_ns: int | None = None,
        **messages: Message | tuple[Message, ...],
    ) -> UpdateResult[Any]:
        """Run a cycle and return what it leaves behind.

        Args:
            active: Whether the controller is active.
            period_ns: Time since the last cycle [ns], if it isn't the period. The time
                of this cycle is as it is.
            messages: What comes in, by port.
        """
        self._cycle += 1
        if active and not self._is_active:
            self._activation += 1
        self._is_active = active
        cycle = Cycle(
            self._cycle,
            self.time_ns,
            self._period_ns if period_ns is None else period_ns,
            {NAME: self._activation} if active else {},
        )
        self._fix(interfaces.MANAGER_PORT, cycle)
        size = self.system.GetInputPort(interfaces.STATE_PORT).size()
        order = self.system.params.measured[:size]
        self._fix(interfaces.STATE_PORT, np.array([self.states[n] for n in order]))
        self._values.FixValue(self.context, np.array(list(self.commands.values())))
        for port in self._sent - messages.keys():
            self._fix(port, ())
        for port, message in messages.items():
            self._fix(port, message)
        self._sent = set(messages) - {interfaces.PARAMETERS_PORT}
        self._simulator.AdvanceTo((self._cycle + 0.5) * self.system.params.period)
        tick: UpdateResult[Any] = self.context.get_abstract_state(0).get_value()
        for name, value in zip(self.commands, tick.command, strict=True):
            if not np.isnan(value):
                self.commands[name] = value
                if not self._separate and name in self.states:
                    self.states[name] = value
        self._is_active = tick.activation is not None
        self.rows.append(list(self.commands.values()))
        if self.system.HasOutputPort("events"):
            events = self.output("events")
            self.events += [event for n, event in events if n >= self._num_seen]
            self._num_seen = events[-1][0] + 1 if events else self._num_seen
        self.time_ns += self._period_ns
        return tick

    def run(self, duration: float, **messages: Any) -> None:
        """Run the cycles of a time [s], with messages at the first of them."""
        for _ in range(round(duration * self.system.params.update_rate)):
            self.tick(**messages)
            messages = {}

    def set_parameters(self, changes: Mapping[str, Any]) -> UpdateResult[Any]:
        """Run a cycle with other parameters from now on."""
        self.parameters |= changes
        changed = load(self._type, self.parameters, distro=self._distro)
        return self.tick(**{interfaces.PARAMETERS_PORT: changed})

    def output(self, port: str) -> Any:
        """Return what is on an output port."""
        return self.system.GetOutputPort(port).Eval(self.context)

    def command(self, interface: str = "position") -> list[float]:
        """Return what the joints' command interfaces of a kind hold."""
        return [
            value
            for name, value in self.commands.items()
            if name.rpartition("/")[2] == interface
        ]

    def news_of(self, goal: SendGoal) -> list[tuple[GoalStatus, int | None]]:
        """Return states and error codes of a goal, feedback left out."""
        return [
            (event.status, None if event.result is None else event.result.error_code)
            for event in self.events
            if getattr(event, "request", None) is goal and event.feedback is None
        ]

    def _fix(self, port: str, value: Any) -> None:
        if not isinstance(value, np.ndarray):
            value = AbstractValue.Make(value)
        self.system.GetInputPort(port).FixValue(self.context, value)
