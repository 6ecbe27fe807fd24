from collections.abc import Sequence

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.cycles import Cycle
from arm_drake.controllers.gazebo.joint_state_publisher import (
    GazeboRosJointStatePublisher,
    JointStatePublisher,
)
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Header, JointState, Time
from tests.controllers.driving import NAME
from tests.controllers.gazebo_plugins import make_surroundings

JOINTS = ("c", "a", "b")
# Positions of these, velocities, efforts.
MEASURED = [3.0, 1.0, 2.0, 13.0, 11.0, 12.0, 23.0, 21.0, 22.0]
TOPIC = "/world/empty/model/arm/joint_state"

ACTIVE = Cycle(0, 0, 10_000_000, {NAME: 1})
INACTIVE = Cycle(0, 0, 10_000_000, {"other": 1})


def make_message(
    time_ns: int, names: tuple[str, ...], *fields: tuple[float, ...]
) -> JointState:
    return JointState(Header(Time.from_nanoseconds(time_ns)), names, *fields)


def publish(
    joints: tuple[str, ...] = (), until: float = 0.005, cycle: Cycle | None = None
) -> JointState:
    """Return what Gazebo Sim's publisher shows at a time, of samples at 100 Hz."""
    tag = gazebo_plugins.JointStatePublisher(joints)
    system = JointStatePublisher(tag, make_surroundings(*JOINTS, rate=100))
    builder = DiagramBuilder()
    builder.AddSystem(system)
    source = builder.AddSystem(ConstantVectorSource(MEASURED))
    sample = builder.AddSystem(ZeroOrderHold(0.01, len(MEASURED)))
    builder.Connect(source.get_output_port(), sample.get_input_port())
    state = system.GetInputPort("state_interfaces")
    builder.Connect(sample.get_output_port(), state)
    builder.ExportInput(system.GetInputPort("controller_manager"), "manager")
    builder.ExportOutput(system.GetOutputPort(TOPIC), "joint_state")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    if cycle is not None:
        diagram.GetInputPort("manager").FixValue(context, cycle)
    if until > 0.0:
        simulator.AdvanceTo(until)
    message: JointState = diagram.GetOutputPort("joint_state").Eval(context)
    return message


def test_all_joints_are_published_in_the_order_of_the_description() -> None:
    expected = make_message(0, JOINTS, *np.reshape(MEASURED, (3, 3)).tolist())

    message = publish()

    assert message.name == expected.name
    assert message.header == expected.header
    assert list(message.position) == expected.position
    assert list(message.velocity) == expected.velocity
    assert list(message.effort) == expected.effort


def test_joints_that_are_named_are_published_alone() -> None:
    message = publish(("b", "c"))

    assert message == make_message(
        0, ("c", "b"), (3.0, 2.0), (13.0, 12.0), (23.0, 22.0)
    )


@pytest.mark.parametrize(
    ("until", "time_ns"), [(0.005, 0), (0.125, 120_000_000), (0.13, 120_000_000)]
)
def test_the_stamp_is_the_time_of_the_last_tick(until: float, time_ns: int) -> None:
    assert publish(until=until).header.stamp == Time.from_nanoseconds(time_ns)


def test_before_the_first_tick_and_inactive_the_message_is_empty() -> None:
    assert publish(cycle=ACTIVE).name == JOINTS
    assert publish(cycle=INACTIVE) == JointState()
    assert publish(until=0.0) == JointState()


def test_it_runs_no_python_in_the_loop_and_has_no_state() -> None:
    tag = gazebo_plugins.JointStatePublisher(topic="states")
    system = JointStatePublisher(tag, make_surroundings(*JOINTS))

    assert system.is_sampled
    assert system.CreateDefaultContext().is_stateless()
    assert system.HasOutputPort("/states")
    assert system.message_types == {}


def make_classic(
    rate: float, *joints: str, manager_rate: int = 1000
) -> GazeboRosJointStatePublisher:
    tag = gazebo_plugins.GazeboRosJointStatePublisher(joints or ("a",), rate)
    return GazeboRosJointStatePublisher(
        tag, make_surroundings(*JOINTS, rate=manager_rate)
    )


def publish_in_ticks(
    system: ControllerInterface, num_ticks: int, cycles: Sequence[Cycle] = ()
) -> list[JointState]:
    """Return what is shown after each tick, when all measurements are its number."""
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    state = system.GetInputPort("state_interfaces")
    messages = []
    for tick in range(num_ticks):
        state.FixValue(context, np.full(state.size(), float(tick)))
        if cycles:
            manager = system.GetInputPort("controller_manager")
            manager.FixValue(context, cycles[tick])
        simulator.AdvanceTo((tick + 0.5) * system.params.period)
        messages.append(system.GetOutputPort("/joint_states").Eval(context))
    return messages


def test_classic_publishes_positions_and_velocities_in_the_order_of_the_tag() -> None:
    system = make_classic(0.0, "b", "c")
    context = system.CreateDefaultContext()
    before = system.GetOutputPort("/joint_states").Eval(context)
    simulator = Simulator(system, context)
    system.GetInputPort("state_interfaces").FixValue(context, MEASURED[:6])

    simulator.AdvanceTo(0.0005)

    message = system.GetOutputPort("/joint_states").Eval(context)
    assert before == JointState()
    assert message == make_message(0, ("b", "c"), (2.0, 3.0), (12.0, 13.0))


@pytest.mark.parametrize(
    ("rate", "manager_rate", "ticks"),
    [
        (0.0, 1000, [0, 1, 2, 3]),
        (5000.0, 1000, [0, 1, 2, 3]),
        (20.0, 1000, [0, 50, 100, 150]),
        # The first tick that is 33.3 ms later, and so on from there.
        (30.0, 1000, [0, 34, 68, 102]),
        # Times of ticks are cut to nanoseconds.
        (30.0, 60, [0, 2, 4, 6]),
    ],
)
def test_classic_publishes_at_its_rate(
    rate: float, manager_rate: int, ticks: list[int]
) -> None:
    system = make_classic(rate, manager_rate=manager_rate)

    messages = publish_in_ticks(system, ticks[-1] + 1)

    shown = dict.fromkeys(message.position[0] for message in messages)
    stamps = dict.fromkeys(message.header.stamp for message in messages)
    assert list(shown) == [float(tick) for tick in ticks]
    assert list(stamps) == [
        Time.from_nanoseconds(tick * 10**9 // manager_rate) for tick in ticks
    ]


def test_classic_takes_the_time_of_the_manager_and_publishes_while_active() -> None:
    cycles = [
        state._replace(time_ns=7 + 1_000_000 * k)
        for k, state in enumerate([INACTIVE, ACTIVE, ACTIVE, INACTIVE, ACTIVE])
    ]

    messages = publish_in_ticks(make_classic(20.0), len(cycles), cycles)

    first = make_message(7 + 1_000_000, ("a",), (1.0,), (1.0,))
    again = make_message(7 + 4_000_000, ("a",), (4.0,), (4.0,))
    assert messages == [JointState(), first, first, JointState(), again]


def test_classic_makes_its_topic_of_namespace_and_remappings() -> None:
    tag = gazebo_plugins.GazeboRosJointStatePublisher(
        ("a",), namespace="ns", remappings=("joint_states:=here",)
    )

    system = GazeboRosJointStatePublisher(tag, make_surroundings("a"))

    assert system.HasOutputPort("/ns/here")
    assert not system.is_sampled
