"""The cost of a controller's tick, beside an empty system with the same event.

Each controller stands in a diagram with constants for what it measures, and runs at its
own rate. The peer is a Python LeafSystem whose unrestricted periodic update does
nothing. Outputs are read by a system that evaluates its input ports at every tick, as a
subscriber would; what reading as many constants takes is measured beside it, for that
is neither the controller's. A JointTrajectoryController makes its controller_state when
a field of it is asked for; "looked at" is the row that asks. All run in turns, in one
process, and time is the processor's: what counts are differences and ratios. Goals are
for what a tick takes less the reading.

    python -m tests.benchmarks.ticks [--runs 41] [--json FILE]
"""

import argparse
import json
import statistics
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
    State,
)
from pydrake.systems.primitives import (
    ConstantValueSource,
    ConstantVectorSource,
    ZeroOrderHold,
)

import arm_drake as ad
from arm_drake import interfaces
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle
from arm_drake.hardware.drives import make_drive_commands, make_robot_drive
from arm_drake.hardware.hardware import Hardware
from arm_drake.hardware.robot_systems import RobotSystems
from arm_drake.manager.hardware_interfaces import find_hardware_interfaces
from arm_drake.manager.loading import load_controllers_of
from arm_drake.messages import (
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFCommand,
    SendGoal,
)
from tests.controllers.parameters import FORWARD, JSB, JTC, PID, load

# The port of a trajectory controller's action.
ACTION = "follow_joint_trajectory"

ROBOT = "doosan_a0912"

RATE = 100
PERIOD = 1.0 / RATE

# Ticks before the clock starts, and those that it counts.
WARM_UP, TICKS = 20, 400

# Points of the trajectory, each in this time after the last one [s].
NUM_POINTS, SPACING = 50, 0.1

JOINTS = tuple(f"joint{i}" for i in range(1, 7))

# What is there to be measured: every joint is at 0.
MEASURED = interfaces.interface_names(JOINTS, interfaces.STATE_INTERFACES)

# No error of a joint that stays where it is reaches this [rad].
TOLERANCE = 100.0

SETTINGS: Mapping[str, Mapping[str, Any]] = {
    JTC: {
        "joints": list(JOINTS),
        **{f"constraints.{joint}.trajectory": TOLERANCE for joint in JOINTS},
        **{f"constraints.{joint}.goal": TOLERANCE for joint in JOINTS},
    },
    JSB: {},
    FORWARD: {"joints": list(JOINTS)},
    PID: {
        "dof_names": list(JOINTS),
        "reference_and_state_interfaces": ["position", "velocity"],
        **{
            f"gains.{joint}.{name}": value
            for joint in JOINTS
            for name, value in {"p": 100.0, "i": 1.0, "d": 10.0}.items()
        },
    },
}


class Subject(NamedTuple):
    """What is measured."""

    diagram: Diagram

    # How many of its outputs are read at every tick.
    num_read: int = 0

    # What lies on its input ports all the time.
    messages: Mapping[str, Any] = {}


class Row(NamedTuple):
    """What a tick of a subject takes, beside the peer [us]."""

    name: str

    # Median of the runs, least and most.
    median: float
    least: float
    most: float

    # Medians of the peer's in the same turns, of what the subject takes more, and of
    # how many times as much.
    empty: float
    difference: float
    ratio: float

    # What reading as many constants takes, and what the subject takes less that.
    reading: float
    net: float

    # What that is to be at most.
    goal: float | None


class Empty(LeafSystem):
    """The peer: a Python system with an event that does nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        pass


class Reader(LeafSystem):
    """Reads output ports of other systems at every tick, and looks at the messages."""

    def __init__(self, num_ports: int, *, looks: bool = False) -> None:
        super().__init__()
        self._looks = looks
        self._ports = [
            self.DeclareAbstractInputPort(f"u{i}", AbstractValue.Make(()))
            for i in range(num_ports)
        ]
        self.DeclarePeriodicPublishEvent(PERIOD, 0.0, self._read)

    def _read(self, context: Context) -> EventStatus:
        for port in self._ports:
            value = port.Eval(context)
            if self._looks:
                getattr(value, "header", None)
        return EventStatus.Succeeded()


def make_controller(
    type_: str, name: str = "controller", **changes: Any
) -> ControllerInterface:
    """Return a controller of the six joints that runs at its own rate."""
    settings = {**SETTINGS[type_], **changes}
    params = ControllerInterfaceParams(
        controller_name=name,
        update_rate=RATE,
        period=PERIOD,
        joint_types=dict.fromkeys(JOINTS, "revolute"),
        command_interfaces=frozenset(MEASURED),
        state_interfaces=frozenset(MEASURED),
        measured=MEASURED,
    )
    make = CONTROLLER_TYPES[type_].system
    assert make is not None
    return make(load(type_, settings), params)


def make_goal() -> SendGoal:
    """Return a goal that takes longer than the measurement."""
    times = SPACING * np.arange(1, NUM_POINTS + 1)
    assert times[-1] > (WARM_UP + TICKS) * PERIOD
    phases = np.arange(len(JOINTS))
    points = [
        JointTrajectoryPoint(
            positions=tuple(np.sin(t + phases) - np.sin(phases)),
            # A trajectory that doesn't end at rest is refused.
            velocities=tuple(np.cos(t + phases) * (t < times[-1])),
            time_from_start=float(t),
        )
        for t in times
    ]
    trajectory = JointTrajectory(joint_names=JOINTS, points=tuple(points))
    return SendGoal(FollowJointTrajectoryGoal(trajectory=trajectory))


def add_reader(
    builder: DiagramBuilder, ports: Sequence[OutputPort], *, looks: bool = False
) -> None:
    """Add what reads output ports at every tick."""
    reader = builder.AddSystem(Reader(len(ports), looks=looks))
    for index, port in enumerate(ports):
        builder.Connect(port, reader.get_input_port(index))


def outputs_of(system: LeafSystem) -> list[OutputPort]:
    """Return the abstract output ports of a system: all but exported interfaces."""
    ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return [port for port in ports if port.get_name() != interfaces.EXPORT_PORT]


def feed(builder: DiagramBuilder, system: ControllerInterface) -> None:
    """Connect what a controller measures: zeros, sampled if it has them sampled."""
    target = system.GetInputPort(interfaces.STATE_PORT)
    source = builder.AddSystem(ConstantVectorSource(np.zeros(target.size())))
    if system.is_sampled:
        sample = builder.AddSystem(ZeroOrderHold(PERIOD, target.size()))
        builder.Connect(source.get_output_port(), sample.get_input_port())
        source = sample
    builder.Connect(source.get_output_port(), target)


def make_alone(
    type_: str,
    messages: Mapping[str, Any],
    *outputs: str,
    reads_all: bool = False,
    looks: bool = False,
) -> Subject:
    """Return one controller with its messages, and what reads some of its outputs."""
    builder = DiagramBuilder()
    system = builder.AddSystem(make_controller(type_))
    feed(builder, system)
    for port in messages:
        builder.ExportInput(system.GetInputPort(port), port)
    ports = [system.GetOutputPort(name) for name in outputs]
    if reads_all:
        ports = outputs_of(system)
    if ports:
        add_reader(builder, ports, looks=looks)
    return Subject(builder.Build(), len(ports), messages)


def make_follower(*, reads_all: bool = True, looks: bool = False) -> Subject:
    """Return a JointTrajectoryController that is at a goal of its action."""
    messages = {ACTION: make_goal()}
    return make_alone(JTC, messages, reads_all=reads_all, looks=looks)


def make_pid(*, reads_all: bool) -> Subject:
    """Return a PidController with references from its topic."""
    reference = MultiDOFCommand(
        dof_names=JOINTS, values=(0.1,) * 6, values_dot=(0.0,) * 6
    )
    return make_alone(PID, {"reference": reference}, reads_all=reads_all)


def make_chain(*, reads_all: bool) -> Subject:
    """Return a JointTrajectoryController that commands a PidController's references.

    A follower needs to be told that it is one, so the cycles come from a system.
    """
    builder = DiagramBuilder()
    follower = builder.AddSystem(make_controller(PID, "pid"))
    leader = builder.AddSystem(
        make_controller(
            JTC,
            "leader",
            command_joints=[f"pid/{joint}" for joint in JOINTS],
            command_interfaces=["position", "velocity"],
        )
    )
    builder.ExportInput(leader.GetInputPort(ACTION), ACTION)
    cycles = builder.AddSystem(Cycles(["leader", "pid"], ["pid"]))
    for system in (leader, follower):
        feed(builder, system)
        manager_port = system.GetInputPort(interfaces.MANAGER_PORT)
        builder.Connect(cycles.get_output_port(), manager_port)
    commands = leader.GetOutputPort(interfaces.COMMAND_PORT)
    builder.Connect(commands, follower.add_predecessor(leader))
    ports = outputs_of(leader) + outputs_of(follower) if reads_all else []
    if ports:
        add_reader(builder, ports)
    return Subject(builder.Build(), len(ports), {ACTION: make_goal()})


class Cycles(LeafSystem):
    """The least that tells controllers of their cycles; a manager does more."""

    def __init__(self, active: Sequence[str], chained: Sequence[str]) -> None:
        super().__init__()
        self._active, self._chained = dict.fromkeys(active, 1), frozenset(chained)
        self.DeclareAbstractOutputPort(
            "cycle",
            lambda: AbstractValue.Make(()),
            self._calc,
            prerequisites_of_calc={self.time_ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        number = round(context.get_time() / PERIOD)
        period_ns = round(1e9 * PERIOD)
        output.set_value(
            Cycle(number, number * period_ns, period_ns, self._active, self._chained)
        )


def make_robot(*types: str) -> Subject:
    """Return all Python of a bundled Doosan and its logs, with constants for physics.

    Args:
        types: Types of the controllers to have, none of whose topics are read; without
            any all are there, and their topics are read.
    """
    robot, options = ad.load_robot(ROBOT), ad.SimulationOptions()
    period = 1.0 / robot.controllers.update_rate
    hardware_interfaces = find_hardware_interfaces(
        robot.description, robot.initial_positions
    )
    controllers, report = load_controllers_of(robot, period, options)
    controllers = tuple(c for c in controllers if not types or c.type in types)
    drive = make_robot_drive(robot.description, robot.pose, options, period)
    commands = make_drive_commands(robot, hardware_interfaces, controllers, drive)
    builder = DiagramBuilder()
    states, motions = (
        builder.AddSystem(
            ConstantVectorSource(np.zeros(n * len(hardware_interfaces.joint_types)))
        )
        for n in (3, 2)
    )
    hardware = Hardware(
        commanded=commands.joints,
        command=None,
        joint_states=states.get_output_port(),
        joint_motions=motions.get_output_port(),
        friction=None,
        drive=None,
    )
    systems = RobotSystems(builder, robot, "", period, options, period)
    bodies = range(len(robot.description.links))
    poses = AbstractValue.Make([RigidTransform() for _ in bodies])
    source = builder.AddSystem(ConstantValueSource(poses))
    systems.add_frames(source.get_output_port(), bodies)
    systems.add(hardware, hardware_interfaces, controllers, report, commands)
    ports = []
    for controller in controllers if not types else ():
        assert controller.system is not None
        ports += [
            port
            for port in outputs_of(controller.system)
            if not interfaces.is_internal(port.get_name())
        ]
    if ports:
        add_reader(builder, ports)
    messages = {f"joint_trajectory_controller.{ACTION}": make_goal()}
    return Subject(builder.Build(), len(ports), messages)


def make_peer(num_ports: int = 0) -> Subject:
    """Return the peer, with a reader of constants if there are any."""
    builder = DiagramBuilder()
    builder.AddSystem(Empty())
    if not num_ports:
        return Subject(builder.Build())
    reader = builder.AddSystem(Reader(num_ports))
    names = [f"u{i}" for i in range(num_ports)]
    for name in names:
        builder.ExportInput(reader.GetInputPort(name), name)
    return Subject(builder.Build(), num_ports, dict.fromkeys(names, ()))


def start(subject: Subject) -> Simulator:
    """Return a simulator that has done the first ticks of a subject."""
    simulator = Simulator(subject.diagram)
    context = simulator.get_mutable_context()
    for port, message in subject.messages.items():
        value = AbstractValue.Make(message)
        subject.diagram.GetInputPort(port).FixValue(context, value)
    simulator.Initialize()
    simulator.AdvanceTo((WARM_UP - 0.5) * PERIOD)
    return simulator


def time_ticks(subject: Subject) -> float:
    """Return what a tick takes [us]."""
    simulator = start(subject)
    # Of the processor: what else runs on the machine doesn't count.
    begin = time.process_time()
    simulator.AdvanceTo((WARM_UP + TICKS - 0.5) * PERIOD)
    took = time.process_time() - begin
    check_commands(subject.diagram, simulator)
    return 1e6 * took / TICKS


def check_commands(diagram: Diagram, simulator: Simulator) -> None:
    """Raise RuntimeError if a controller commands nothing, or 0, where joints are."""
    for system in diagram.GetSystems():
        if isinstance(system, TickingController):
            context = system.GetMyContextFromRoot(simulator.get_context())
            tick = system.GetOutputPort(interfaces.COMMAND_PORT).Eval(context)
            if not (tick.command != 0.0).all() or not np.isfinite(tick.command).all():
                raise RuntimeError(f"{system.get_name()} commands {tick.command}")


def measure(name: str, subject: Subject, goal: float | None, runs: int) -> Row:
    """Return what a tick takes, in turns with the peer."""
    peer, reader = make_peer(), make_peer(subject.num_read)
    # The first turn warms up.
    turns = [
        (time_ticks(subject), time_ticks(peer), time_ticks(reader))
        for _ in range(runs + 1)
    ][1:]
    ours, empty, _ = zip(*turns, strict=True)
    reading = statistics.median(read - nothing for _, nothing, read in turns)
    return Row(
        name=name,
        median=statistics.median(ours),
        least=min(ours),
        most=max(ours),
        empty=statistics.median(empty),
        difference=statistics.median(a - b for a, b, _ in turns),
        ratio=statistics.median(a / b for a, b, _ in turns),
        reading=reading if subject.num_read else 0.0,
        net=statistics.median(a - (c - b) for a, b, c in turns)
        if subject.num_read
        else statistics.median(ours),
        goal=goal,
    )


def subjects() -> dict[str, tuple[Subject, float | None]]:
    """Return what is measured by its name, and what it is to take at most [us]."""
    forward = {"commands": Float64MultiArray((0.1,) * 6)}
    return {
        "JTC, all outputs": (make_follower(), 20.0),
        "JTC, all outputs looked at": (make_follower(looks=True), 20.0),
        "JTC": (make_follower(reads_all=False), None),
        "chain JTC to PID, all outputs": (make_chain(reads_all=True), None),
        "chain JTC to PID": (make_chain(reads_all=False), 30.0),
        "JSB, both outputs": (make_alone(JSB, {}, reads_all=True), None),
        "JSB, joint_states": (make_alone(JSB, {}, "joint_states"), 5.0),
        "PID, all outputs": (make_pid(reads_all=True), None),
        "PID": (make_pid(reads_all=False), 10.0),
        "ForwardCommandController": (make_alone(FORWARD, forward), None),
        "manager and JTC, logs": (make_robot(JTC), None),
        "Doosan without physics, all topics": (make_robot(), None),
    }


def main() -> None:
    """Print the table, and write it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=41)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    print("us per tick, 6 joints".ljust(35), end="")
    print("median (range)       empty   more  ratio  reading    net  goal")
    rows = []
    for name, (subject, goal) in subjects().items():
        row = measure(name, subject, goal, options.runs)
        rows.append(row)
        span = f"({row.least:.1f} to {row.most:.1f})"
        print(
            f"{name:34s} {row.median:6.1f} {span:16s} {row.empty:3.1f} "
            f"{row.difference:6.1f} {row.ratio:6.1f} {row.reading:8.1f} {row.net:6.1f}"
            + (f" {goal:5.0f}" if goal is not None else ""),
            flush=True,
        )
    if options.json is not None:
        table = [row._asdict() for row in rows]
        options.json.write_text(json.dumps(table, indent=2) + "\n")


if __name__ == "__main__":
    main()
