"""Replays upstream's whole-controller scenarios open loop, through the real LeafSystem.

    loop = OpenLoop(case["input"], case["output"])
    for cycle in loop.cycles():
        assert_close(loop.command, case["output"]["command"][cycle])
        loop.update_return, loop.output("controller_state")

In every cycle the recorded `state` and the scenario's events go to the input ports;
what the controller commands then is there to compare. The plant is not simulated.

Events that this module knows: topic, service, ref, set_params, activate and deactivate;
those that change the plant are skipped, for `state` shows what they do. Others are
handled by who passes `handlers`: functions of the loop and the event, which `send`
messages.

Upstream's harness left a controller whose update failed active, where a manager would
have deactivated it, and where ours deactivates itself. Here it is kept active, too.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pydrake.systems.analysis import Simulator

from arm_drake import interfaces
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, UpdateResult
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.messages import (
    Float64MultiArray,
    Message,
    MultiDOFCommand,
    SetOdometry,
    Time,
    TwistStamped,
)

Event = dict[str, Any]
Handler = Callable[["OpenLoop", Event], None]

# Joints that don't move; and events whose effect is in the recorded state.
_FIXED = ("fixed", "floating", "planar")
_OF_THE_PLANT = ("plant", "set_state")

# Commands the references of a controller in chained mode.
_PREDECESSOR = "predecessor"

# How the message of a topic is made of its fields, by the name of the port.
_MESSAGES: dict[str, Callable[..., Message]] = {
    "commands": Float64MultiArray,
    "reference": MultiDOFCommand,
    "measured_state": MultiDOFCommand,
    "cmd_vel": TwistStamped,
}

# How the request of a service is made of its fields, by the name of the port.
_REQUESTS: dict[str, Callable[..., Message]] = {"set_odometry": SetOdometry}


def numbers(value: Any) -> Any:
    """Return a value of a case with its "nan" and "inf" as floats."""
    if isinstance(value, dict):
        return {name: numbers(part) for name, part in value.items()}
    if isinstance(value, list):
        return [numbers(part) for part in value]
    return float(value) if value in ("nan", "inf", "-inf") else value


def merge(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested parameters, those of the second in place of the first's."""
    merged = dict(below)
    for name, value in above.items():
        if isinstance(value, dict) and isinstance(merged.get(name), dict):
            value = merge(merged[name], value)
        merged[name] = value
    return merged


def flatten(inputs: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield nested parameters by their dotted names."""
    for name, value in inputs.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def is_started(expected: Mapping[str, Any]) -> bool:
    """Return whether upstream's controller came to run."""
    return "command" in expected


class OpenLoop:
    """A controller of a case, and the input ports that the case drives."""

    # Whether a manager keeps the controller's state.
    is_managed = False

    def __init__(
        self,
        inputs: Mapping[str, Any],
        expected: Mapping[str, Any],
        *,
        distro: str = "rolling",
        messages: Mapping[str, Callable[..., Message]] = _MESSAGES,
        handlers: Mapping[str, Handler] | None = None,
    ) -> None:
        """Create the system.

        Args:
            inputs: What upstream's controller was given: `input` of the case.
            expected: What it did: `output` of the case.
            distro: Distribution whose defaults and behaviour hold.
            messages: By topic, what makes a message of its fields.
            handlers: What does the events of further types, by type.

        Raises:
            ParameterError: If the controller can't be loaded.
        """
        self.case_input, self.expected = inputs, expected
        self.name: str = inputs["node_name"]

        # Time of the present cycle [ns].
        self.time_ns = 0
        self._distro, self._messages = distro, messages
        self._handlers = dict(handlers or {})
        self._parameters = numbers(inputs["params"])
        self.system = self._make_system()
        self.start()

    def start(self) -> None:
        """Get the controller ready for its first cycle."""
        inputs, expected = self.case_input, self.expected
        self._chain = self._add_predecessor() if inputs.get("chained") else None
        self._values = None
        if isinstance(self.system, TickingController):
            self.system._ends_on_failure = False
            claims = expected["command_interfaces"]
            self._values = self.system.add_command_values(claims)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self._manager = self.system.GetInputPort(interfaces.MANAGER_PORT)
        self._measured = self.system.GetInputPort(interfaces.STATE_PORT)
        self._measured_at = self._find_measured()
        self._activation: int | None = 0
        self._last_activation = 0
        self._sent: dict[str, tuple[Message, ...]] = {}
        self._references = np.full(len(self.system.reference_interfaces), np.nan)

        # Columns of `command`, and where they stand in the controller's own order.
        start = numbers(inputs.get("initial_command", {}))
        names, own = expected["command_interfaces"], self.system.command_interfaces
        self._command_at = [own.index(name) for name in names]

        # What the last cycle left behind: values of the command interfaces in the
        # order of `command`, and "OK", "ERROR" or "inactive".
        self.command = np.array([start.get(name, np.nan) for name in names])
        self.update_return = "inactive"

    @property
    def tick(self) -> UpdateResult[Any]:
        """What the last tick left behind; only of controllers that tick."""
        tick: UpdateResult[Any] = self.context.get_abstract_state(0).get_value()
        return tick

    def output(self, port: str) -> Any:
        """Return what is on an output port."""
        return self.system.GetOutputPort(port).Eval(self.context)

    def send(self, port: str, message: Message) -> None:
        """Put a message on an input port, after those of this cycle."""
        self._sent[port] = (*self._sent.get(port, ()), message)

    def expected_return(self, cycle: int) -> str:
        """Return what upstream's update returned in a cycle."""
        returns = self.expected["update_return"]
        return returns if isinstance(returns, str) else str(returns[cycle])

    def cycles(self) -> Iterator[int]:
        """Run the cycles of the case one after the other."""
        times, periods = self.expected["t_ns"], self.expected["period_ns"]
        if isinstance(periods, int):
            periods = [periods] * len(times)
        events: dict[int, list[Event]] = {}
        for event in self.case_input.get("events", ()):
            events.setdefault(event["cycle"], []).append(event)
        for cycle, (time_ns, period_ns) in enumerate(zip(times, periods, strict=True)):
            self._sent, self.time_ns = {}, time_ns
            for event in events.get(cycle, ()):
                self._do(event)
            self._fix_inputs(cycle, time_ns, period_ns)
            # Drake's time counts cycles; the controller's own is in the message.
            self._advance((cycle + 0.5) * self.system.params.period)
            yield cycle

    def _do(self, event: Event) -> None:
        kind = event["type"]
        if kind in self._handlers:
            self._handlers[kind](self, event)
        elif kind == "topic":
            make, fields = self._messages[event["topic"]], numbers(event["msg"])
            if event.get("stamp_now"):
                stamp = Time.from_nanoseconds(self.time_ns)
                fields = {**fields, "header": {"stamp": stamp}}
            self.send(event["topic"], make(**fields))
        elif kind == "service":
            request = _REQUESTS[event["service"]](**numbers(event["request"]))
            self.send(event["service"], request)
        elif kind == "ref":
            for name, value in numbers(event["values"]).items():
                self._references[self.system.reference_interfaces.index(name)] = value
        elif kind == "set_params":
            changed = numbers(event["params"])
            self._parameters = merge(self._parameters, changed)
            port = self.system.GetInputPort(interfaces.PARAMETERS_PORT)
            port.FixValue(self.context, self._load())
        elif kind == "deactivate":
            self._activation = None
        elif kind == "activate":
            self._last_activation += 1
            self._activation = self._last_activation
        elif kind not in _OF_THE_PLANT:
            raise ValueError(f"no handler for an event of type {kind!r}")

    def _fix_inputs(self, cycle: int, time_ns: int, period_ns: int) -> None:
        active = {_PREDECESSOR: 0}
        if self._activation is not None:
            active[self.name] = self._activation
        chained = frozenset([self.name] if self._chain is not None else [])
        reported = Cycle(cycle, time_ns, period_ns, active, chained)
        self._manager.FixValue(self.context, reported)
        measured = np.full(self._measured.size(), np.nan)
        if "state" in self.expected:
            measured[self._measured_at] = np.array(
                self.expected["state"][cycle], dtype=float
            )
        self._measured.FixValue(self.context, measured)
        if self._values is not None:
            self._values.FixValue(self.context, self.command)
        for port, messages in self._sent.items():
            self.system.GetInputPort(port).FixValue(self.context, messages)
        if self._chain is not None:
            command = self._references.copy()
            self._chain.FixValue(self.context, UpdateResult(cycle, 0, None, command))

    def _advance(self, time: float) -> None:
        if not isinstance(self.system, TickingController):
            self.context.SetTime(time)
            return
        self.simulator.AdvanceTo(time)
        tick = self.tick
        command = tick.command[self._command_at]
        self.command = np.where(np.isnan(command), self.command, command)
        self.update_return = "OK" if tick.is_ok else "ERROR"
        if self._activation is None:
            self.update_return = "inactive"

    def _make_system(self) -> ControllerInterface:
        make = CONTROLLER_TYPES[self.case_input["controller"].replace("::", "/")].system
        assert make is not None
        urdf = self.case_input.get("urdf")
        read = self.expected.get("state_interfaces", [])
        if urdf:
            joints = {
                joint.attrib["name"]: joint.attrib["type"]
                for joint in ElementTree.fromstring(urdf).iter("joint")  # noqa: S314
                if joint.attrib["type"] not in _FIXED
            }
        elif urdf is None:
            # Where there is none, whatever can be read is of a joint.
            joints = {name.rpartition("/")[0]: "revolute" for name in read}
        else:
            joints = {}
        available = [*read, *self.case_input.get("available_states", ())]
        simulated = interfaces.interface_names(joints, interfaces.STATE_INTERFACES)
        others = tuple(dict.fromkeys(n for n in available if n not in simulated))
        return make(
            self._load(),
            ControllerInterfaceParams(
                controller_name=self.name,
                update_rate=self.case_input["update_rate"],
                period=1.0 / self.case_input["update_rate"],
                joint_types=joints,
                command_interfaces=frozenset(
                    self.expected.get("command_interfaces", ())
                ),
                state_interfaces=frozenset(
                    self.case_input.get("available_states", read)
                ),
                measured=(*simulated, *others),
                distro=self._distro,
                is_managed=self.is_managed,
            ),
        )

    def _load(self) -> Any:
        """Return the present parameters."""
        file = Path("case.yaml")
        return load_parameters(
            CONTROLLER_TYPES[
                self.case_input["controller"].replace("::", "/")
            ].parameters,
            {n: Parameter(v, file, 1) for n, v in flatten(self._parameters)},
            self.name,
            file,
            LoadReport(),
            distro=self._distro,
        )

    def _find_measured(self) -> list[int]:
        """Return where the columns of `state` stand on the port."""
        order = self.system.params.measured
        return [order.index(n) for n in self.expected.get("state_interfaces", ())]

    def _add_predecessor(self) -> Any:
        """Return the port on which another controller commands the references."""
        params = ControllerInterfaceParams(
            controller_name=_PREDECESSOR,
            update_rate=1,
            period=1.0,
            joint_types={},
            command_interfaces=frozenset(),
            state_interfaces=frozenset(),
            measured=(),
        )
        other = ControllerInterface(
            params, command_interfaces=self.system.reference_interfaces
        )
        assert isinstance(self.system, TickingController)
        return self.system.add_predecessor(other)
