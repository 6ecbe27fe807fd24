"""Players of the reference scenarios of the joint_trajectory_controller.

Open loop: what a scenario measured and was sent goes in. One player asks the system,
the other one the functions below it, for these take messages in any order.
"""

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pydrake.common.value import AbstractValue

from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import Cycle
from arm_drake.controllers.joint_trajectory.controller import (
    JointTrajectoryController,
    activate,
    deactivate,
    idle,
    tick,
)
from arm_drake.controllers.joint_trajectory.goals import receive
from arm_drake.controllers.joint_trajectory.parameters import (
    JointTrajectoryControllerParameters,
    make_rules,
)
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryState,
    TickInputs,
    make_controller_state,
    make_query_response,
)
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.interfaces import STATE_INTERFACES, interface_names
from arm_drake.messages import (
    CancelGoal,
    FollowJointTrajectoryGoal,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    QueryTrajectoryState,
    SendGoal,
    SpeedScalingFactor,
    Time,
)

Dict = dict[str, Any]

NAME = "jtc"
SCHEMA = JointTrajectoryControllerParameters

# "inf" and "nan" are strings in the files.
NUMBERS = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}

# Kinds of events by the order in which the system takes those of one cycle.
RANKS = {"activate": 0, "deactivate": 0, "topic": 1, "goal": 2, "cancel": 2}

# What upstream's update returns where there was none.
INACTIVE = "inactive"


def flatten(parameters: Dict, prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            yield prefix + name, [to_number(part) for part in value]
        else:
            yield prefix + name, to_number(value)


def to_number(value: Any) -> Any:
    return NUMBERS.get(value, value) if isinstance(value, str) else value


def load(flat: Dict, distro: str) -> JointTrajectoryControllerParameters:
    file = Path("scenario.yaml")
    inputs = {name: Parameter(value, file, 1) for name, value in flat.items()}
    return load_parameters(SCHEMA, inputs, NAME, file, LoadReport(), distro=distro)


def make_trajectory(message: Dict) -> JointTrajectory:
    header = Header(stamp=Time.of(message.get("header", {}).get("stamp", {})))
    points = [
        JointTrajectoryPoint(**{f: to_numbers(v) for f, v in point.items()})
        for point in message.get("points", ())
    ]
    return JointTrajectory(header, message.get("joint_names", ()), points)


def to_numbers(value: Any) -> Any:
    return [float(x) for x in value] if isinstance(value, list) else value


def make_tolerance(tolerance: Dict) -> JointTolerance:
    limits = {f: float(v) for f, v in tolerance.items() if f != "name"}
    return JointTolerance(tolerance["name"], **limits)


def make_goal(goal: Dict) -> SendGoal:
    path, end = (
        [make_tolerance(tolerance) for tolerance in goal.get(field, ())]
        for field in ("path_tolerance", "goal_tolerance")
    )
    trajectory = make_trajectory(goal["trajectory"])
    late = goal.get("goal_time_tolerance", 0.0)
    return SendGoal(FollowJointTrajectoryGoal(trajectory, path, end, late))


def suits_the_system(inputs: Dict) -> bool:
    """Return whether events of one cycle come in the order in which the system reads.

    It can't know in which order messages came to different ports, and takes parameters
    before it activates.
    """
    ranks = defaultdict(list)
    activated = set()
    for event in inputs["events"]:
        kind, cycle = event["type"], event["cycle"]
        if kind == "activate":
            activated.add(cycle)
        elif kind == "set_params" and cycle in activated:
            return False
        if kind in RANKS and event.get("topic") != "speed_scaling_input":
            ranks[cycle].append(RANKS[kind])
    return all(r == sorted(r) and r.count(0) < 2 for r in ranks.values())


class Player(ABC):
    """Replays one scenario, cycle by cycle."""

    def __init__(self, distro: str, inputs: Dict, output: Dict) -> None:
        self.distro, self.case_input, self.output = distro, inputs, output
        self.flat = dict(flatten(inputs["params"]))
        parameters = inputs["params"]
        commanded = parameters.get("command_joints") or parameters["joints"]
        scaling = parameters.get("speed_scaling", {})
        self.scaling_state = scaling.get("state_interface")
        self.scaling_command = scaling.get("command_interface")
        self.claimed = interface_names(commanded, parameters["command_interfaces"])
        if self.scaling_command:
            self.claimed += (self.scaling_command,)
        robot = ElementTree.fromstring(inputs["urdf"])  # noqa: S314
        joints = {j.attrib["name"]: j for j in robot.iter("joint")}
        self.joint_types = {name: j.attrib["type"] for name, j in joints.items()}
        limits = {name: joint.find("limit") for name, joint in joints.items()}
        self.velocity_limits = {
            name: float(limit.attrib.get("velocity", 0.0))
            for name, limit in limits.items()
            if limit is not None
        }
        initial = inputs.get("initial_command", {})
        self.command_values = np.array(
            [float(initial.get(n, "nan")) for n in self.claimed]
        )
        activations = [row[2] for row in output["lifecycle"] if row[1] == "activate"]
        requested = sum(event["type"] == "activate" for event in inputs["events"])
        self.is_active = len(activations) > requested and activations[0] == "SUCCESS"

        # What becomes of the activations that are asked for.
        self.activations = iter(activations[-requested:] if requested else ())

        # The latest goal of each name in the scenario, and the names of all of them.
        self.goals: dict[str, SendGoal] = {}
        self.names: dict[SendGoal, str] = {}

        # What came out: rows of commands, what updates returned, reports of active
        # cycles, (time, event), and answers to queries.
        self.commands: list[list[float]] = []
        self.returns: list[str] = []
        self.reports: list[JointTrajectoryControllerState] = []
        self.events: list[tuple[int, Any]] = []
        self.answers: list[QueryTrajectoryState] = []

        # Messages on topics that the controller doesn't have.
        self.num_undelivered = 0

    def measured(self, k: int) -> Mapping[str, float]:
        names, row = self.output["state_interfaces"], self.output["state"][k]
        return dict(zip(names, map(float, row or ()), strict=False))

    def period_ns(self, k: int) -> int:
        periods = self.output["period_ns"]
        return int(periods[k] if isinstance(periods, list) else periods)

    def play(self, num_cycles: int | None = None) -> None:
        times = self.output["t_ns"][:num_cycles]
        for k, time_ns in enumerate(times):
            events = [e for e in self.case_input["events"] if e["cycle"] == k]
            self.run(k, time_ns, events)
            self.commands.append(self.command_values.tolist())

    @abstractmethod
    def run(self, k: int, time_ns: int, events: list[Dict]) -> None:
        """Run a cycle."""

    def write(self, command: np.ndarray) -> None:
        self.command_values = np.where(np.isnan(command), self.command_values, command)

    def note(self, time_ns: int, events: tuple[tuple[int, Any], ...]) -> None:
        num_seen = len(self.events)
        self.events += [(time_ns, event) for n, event in events if n >= num_seen]

    def message_of(self, event: Dict) -> tuple[str, Any] | None:
        """Return the field of TickInputs and the message of an event."""
        kind = event["type"]
        if kind == "topic" and event["topic"] == "speed_scaling_input":
            return "scaling_factors", SpeedScalingFactor(float(event["msg"]["factor"]))
        if kind == "topic":
            return "topics", make_trajectory(event["msg"])
        if kind == "goal":
            return "requests", self.name_goal(event["id"], make_goal(event["goal"]))
        if kind == "cancel":
            # Also of a goal that wasn't sent yet.
            goal = self.goals.get(event["id"]) or self.name_goal(
                event["id"], SendGoal(FollowJointTrajectoryGoal())
            )
            return "requests", CancelGoal(goal)
        return None

    def name_goal(self, name: str, goal: SendGoal) -> SendGoal:
        self.goals[name] = goal
        self.names[goal] = name
        return goal

    def moved_by_query(
        self, state: JointTrajectoryState, time_ns: int
    ) -> JointTrajectoryState:
        """Return the state that upstream's query leaves.

        It moves the search for the next reference, which ours doesn't. Here it is moved
        by hand, so that all rows can be compared.
        """
        trajectory = state.plan.trajectory
        if trajectory is None or not self.is_active:
            return state
        sample = trajectory.sample(time_ns, state.cursor)
        if sample is None:
            return state
        return state._replace(cursor=max(state.cursor, sample.segment_start))


class SystemPlayer(Player):
    """Replays a scenario with the system, a manager's cycle at a time."""

    def __init__(self, distro: str, inputs: Dict, output: Dict) -> None:
        super().__init__(distro, inputs, output)
        basic = interface_names(self.joint_types, STATE_INTERFACES)
        others = [n for n in output["state_interfaces"] if n not in basic]
        params = ControllerInterfaceParams(
            controller_name=NAME,
            update_rate=inputs["update_rate"],
            period=1.0 / inputs["update_rate"],
            joint_types=self.joint_types,
            command_interfaces=frozenset(self.claimed),
            state_interfaces=frozenset(output["state_interfaces"]),
            measured=(*basic, *others),
            distro=distro,
            velocity_limits=self.velocity_limits,
        )
        self.system = JointTrajectoryController(load(self.flat, distro), params)
        self.values = self.system.add_command_values(self.claimed)
        self.context = self.system.CreateDefaultContext()
        self.activation = int(self.is_active)

    def fix(self, port: str, value: Any) -> None:
        self.system.GetInputPort(port).FixValue(self.context, value)

    def run(self, k: int, time_ns: int, events: list[Dict]) -> None:
        inputs: defaultdict[str, list[Any]] = defaultdict(list)
        for event in events:
            if event["type"] == "activate":
                self.is_active = next(self.activations, "SUCCESS") == "SUCCESS"
                self.activation += 1
            elif event["type"] == "deactivate":
                self.is_active = False
            elif event["type"] == "service":
                self.query(Time.of(event["request"]["time"]).to_nanoseconds())
            elif event["type"] == "set_params":
                self.flat.update(flatten(event["params"]))
                offered = load(self.flat, self.distro)
                self.fix("parameters", AbstractValue.Make(offered))
            else:
                message = self.message_of(event)
                if message is not None:
                    inputs[message[0]].append(message[1])
        ports = {
            "topics": "joint_trajectory",
            "requests": "follow_joint_trajectory",
            "scaling_factors": "speed_scaling_input",
        }
        for field, messages in inputs.items():
            if self.system.HasInputPort(ports[field]):
                self.fix(ports[field], AbstractValue.Make(tuple(messages)))
            else:
                self.num_undelivered += len(messages)
        active = {NAME: self.activation} if self.is_active else {}
        cycle = Cycle(k, time_ns, self.period_ns(k), active)
        self.fix("controller_manager", AbstractValue.Make(cycle))
        state = self.measured(k)
        num = self.system.GetInputPort("state_interfaces").size()
        order = self.system.params.measured[:num]
        self.fix("state_interfaces", [state.get(name, 0.0) for name in order])
        self.values.FixValue(self.context, self.command_values)
        self.context.SetTime(k / self.case_input["update_rate"])
        ticked = self.system.GetOutputPort("command_interfaces").Eval(self.context)
        self.store(ticked)
        self.write(ticked.command)
        is_ok = "OK" if ticked.is_ok else "ERROR"
        self.returns.append(INACTIVE if ticked.activation is None else is_ok)
        self.note(time_ns, self.system.GetOutputPort("events").Eval(self.context))
        if self.is_active:
            report = self.system.GetOutputPort("controller_state").Eval(self.context)
            self.reports.append(report)

    def store(self, ticked: Any) -> None:
        """Store a tick, as the system's update does."""
        self.context.get_mutable_abstract_state(0).set_value(ticked)

    def query(self, time_ns: int) -> None:
        time = Time.from_nanoseconds(time_ns)
        self.answers.append(self.system.query_state(self.context, time))
        ticked = self.context.get_abstract_state(0).get_value()
        moved = self.moved_by_query(ticked.state.control, time_ns)
        self.store(ticked._replace(state=ticked.state._replace(control=moved)))


class FunctionsPlayer(Player):
    """Replays a scenario with the functions of a tick, message by message."""

    def __init__(self, distro: str, inputs: Dict, output: Dict) -> None:
        super().__init__(distro, inputs, output)
        self.rules = self.make_rules()
        self.state = JointTrajectoryState()
        if self.is_active:
            self.state = activate(self.rules, self.state, self.inputs(0))

    def make_rules(self) -> Any:
        return make_rules(
            load(self.flat, self.distro),
            update_rate=self.case_input["update_rate"],
            joint_types=self.joint_types,
            velocity_limits=self.velocity_limits,
            distro=self.distro,
        )

    def inputs(self, k: int, **messages: Any) -> TickInputs:
        measured, parameters = self.measured(k), self.case_input["params"]

        def read(interface: str) -> np.ndarray | None:
            if interface not in parameters["state_interfaces"]:
                return None
            names = [f"{joint}/{interface}" for joint in parameters["joints"]]
            return np.array([measured.get(name, math.nan) for name in names])

        position = read("position")
        assert position is not None
        scaling = self.scaling_state
        num_commands = len(self.claimed) - bool(self.scaling_command)
        return TickInputs(
            self.output["t_ns"][k],
            self.period_ns(k),
            position,
            read("velocity"),
            read("acceleration"),
            lambda: self.command_values[:num_commands],
            scaling_state=measured.get(scaling, math.nan) if scaling else None,
            **messages,
        )

    def run(self, k: int, time_ns: int, events: list[Dict]) -> None:
        for event in events:
            self.take(event, k)
        inputs = self.inputs(k)
        if self.is_active:
            self.state = tick(self.rules, self.state, inputs)
            self.reports.append(make_controller_state(self.rules, self.state))
        else:
            self.state = idle(self.rules, self.state, inputs)
        self.returns.append("OK" if self.state.plan.is_active else INACTIVE)
        self.write_state()
        self.note(time_ns, self.state.events)

    def take(self, event: Dict, k: int) -> None:
        if event["type"] == "activate":
            self.is_active = next(self.activations, "SUCCESS") == "SUCCESS"
            if self.is_active:
                self.state = activate(self.rules, self.state, self.inputs(k))
        elif event["type"] == "deactivate":
            self.state = deactivate(self.rules, self.state)
            self.is_active = False
            self.write_state()
        elif event["type"] == "service":
            time_ns = Time.of(event["request"]["time"]).to_nanoseconds()
            self.answers.append(make_query_response(self.rules, self.state, time_ns))
            self.state = self.moved_by_query(self.state, time_ns)
        elif event["type"] == "set_params":
            self.flat.update(flatten(event["params"]))
            self.rules = self.make_rules()
        else:
            message = self.message_of(event)
            if message is None:
                return
            if message[0] == "scaling_factors" and not self.rules.is_position_only:
                self.num_undelivered += 1
                return
            inputs = self.inputs(k, **{message[0]: (message[1],)})
            rules = self.state.plan.rules or self.rules
            self.state = receive(rules, self.state, inputs)

    def write_state(self) -> None:
        command = self.state.command
        if command is None:
            return
        if self.scaling_command:
            command = np.append(command, self.state.speed_scaling_command)
        self.write(command)
