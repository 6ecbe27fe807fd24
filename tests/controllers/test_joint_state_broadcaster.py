from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.joint_state_broadcaster import (
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import Header, JointState, Time

# In the order of the robot's description.
ROBOT = ("joint3", "joint1", "joint2")
MEASURED = interfaces.interface_names(ROBOT, interfaces.STATE_INTERFACES)
POSITIONS = {"joint1": 1.1, "joint2": 2.1, "joint3": 3.1}
ALL = ("joint1", "joint2", "joint3")


def make_broadcaster(
    there: tuple[str, ...] = MEASURED, **parameters: Any
) -> JointStateBroadcaster:
    params = ControllerInterfaceParams(
        controller_name="broadcaster",
        update_rate=100,
        period=0.01,
        joint_types=dict.fromkeys(ROBOT, "revolute"),
        command_interfaces=frozenset(),
        state_interfaces=frozenset(there),
        measured=MEASURED,
        initial_commands={},
    )
    return JointStateBroadcaster(JointStateBroadcasterParameters(**parameters), params)


def make_diagram(broadcaster: JointStateBroadcaster) -> Diagram:
    """Return the broadcaster with its sampling of constant measurements.

    Velocities and efforts are 10 and 20 more than positions.
    """
    offsets = {"position": 0.0, "velocity": 10.0, "effort": 20.0}
    values = [
        POSITIONS[joint] + offsets[interface]
        for joint, interface in (name.split("/") for name in MEASURED)
    ]
    builder = DiagramBuilder()
    builder.AddSystem(broadcaster)
    source = builder.AddSystem(ConstantVectorSource(values))
    sample = builder.AddSystem(ZeroOrderHold(0.01, len(values)))
    builder.Connect(source.get_output_port(), sample.get_input_port())
    builder.Connect(sample.get_output_port(), broadcaster.get_input_port())
    builder.ExportOutput(broadcaster.GetOutputPort("joint_states"), "joint_states")
    return builder.Build()


def publish(broadcaster: JointStateBroadcaster, until: float = 0.005) -> JointState:
    """Return the message at a time [s]."""
    diagram = make_diagram(broadcaster)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(until)
    return diagram.GetOutputPort("joint_states").Eval(simulator.get_context())


def fields(message: JointState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array(message.position),
        np.array(message.velocity),
        np.array(message.effort),
    )


def assert_fields(message: JointState, *expected: list[float]) -> None:
    for actual, values in zip(fields(message), expected, strict=True):
        np.testing.assert_array_equal(actual, values)


@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param({}, id="J1"),
        pytest.param({"joints": ("joint1",)}, id="J2"),
        pytest.param({"interfaces": ("position",)}, id="J3"),
    ],
)
def test_unless_both_are_given_all_joints_and_interfaces_are_published_by_name(
    parameters: dict[str, Any],
) -> None:
    broadcaster = make_broadcaster(**parameters)

    message = publish(broadcaster)

    assert message.name == ALL
    assert_fields(message, [1.1, 2.1, 3.1], [11.1, 12.1, 13.1], [21.1, 22.1, 23.1])
    assert sorted(broadcaster.state_interfaces) == sorted(MEASURED)
    assert broadcaster.command_interfaces == ()


NAN2 = [np.nan, np.nan]


@pytest.mark.parametrize(
    ("names", "velocity"),
    [
        pytest.param(("position",), NAN2, id="J4"),
        pytest.param(("position", "velocity"), [12.1, 11.1], id="J5"),
    ],
)
def test_joints_and_interfaces_together_are_exactly_what_is_published(
    names: tuple[str, ...], velocity: list[float]
) -> None:
    broadcaster = make_broadcaster(joints=("joint2", "joint1"), interfaces=names)

    message = publish(broadcaster)

    assert message.name == ("joint2", "joint1")
    assert_fields(message, [2.1, 1.1], velocity, NAN2)
    assert broadcaster.state_interfaces == interfaces.interface_names(
        ("joint2", "joint1"), names
    )


def test_interfaces_that_a_joint_lacks_are_nan() -> None:
    there = ("joint2/position", "joint1/position", "joint1/effort")

    message = publish(make_broadcaster(there))

    assert message.name == ("joint1", "joint2")
    assert_fields(message, [1.1, 2.1], NAN2, [21.1, np.nan])


@pytest.mark.parametrize(
    ("joints", "missing"),
    [
        pytest.param(("no_joint",), "no_joint/position", id="J6"),
        pytest.param(("joint1", "joint3"), "joint3/position", id="J7"),
    ],
)
def test_an_interface_that_is_asked_for_must_be_there(
    joints: tuple[str, ...], missing: str
) -> None:
    there = ("joint2/position", "joint1/position")

    with pytest.raises(ParameterError) as error:
        make_broadcaster(there, joints=joints, interfaces=("position",))

    assert str(error.value) == (
        f"no state interface {missing}; it has ['joint1/position', 'joint2/position']"
    )


def test_without_any_interface_there_is_nothing_to_publish() -> None:
    with pytest.raises(ParameterError) as error:
        make_broadcaster(())

    assert str(error.value) == "no state interface to publish; the hardware has none"


def test_extra_joints_follow_with_zeros_unless_they_exist() -> None:
    extra = ("extra1", "joint2", "extra2")  # J11, J12

    message = publish(make_broadcaster(extra_joints=extra))

    assert message.name == (*ALL, "extra1", "extra2")
    assert_fields(
        message,
        [1.1, 2.1, 3.1, 0.0, 0.0],
        [11.1, 12.1, 13.1, 0.0, 0.0],
        [21.1, 22.1, 23.1, 0.0, 0.0],
    )


@pytest.mark.parametrize(
    ("until", "stamp_ns"), [(0.005, 0), (0.125, 120_000_000), (0.13, 120_000_000)]
)
def test_the_stamp_is_the_time_of_the_last_tick(until: float, stamp_ns: int) -> None:
    message = publish(make_broadcaster(frame_id="base_link"), until)

    stamp = Time.from_nanoseconds(stamp_ns)
    assert message.header == Header(stamp, "base_link")


def test_by_default_the_frame_has_no_name_as_in_jazzy() -> None:
    assert publish(make_broadcaster()).header.frame_id == ""


def test_before_the_first_tick_the_message_is_empty() -> None:
    diagram = make_diagram(make_broadcaster())
    context = diagram.CreateDefaultContext()

    assert diagram.GetOutputPort("joint_states").Eval(context) == JointState()


def test_ports_are_named_and_sized_as_documented() -> None:
    broadcaster = make_broadcaster()

    assert broadcaster.num_input_ports() == 1
    assert broadcaster.num_output_ports() == 1
    assert broadcaster.GetInputPort("state_interfaces").size() == 9
    assert broadcaster.HasOutputPort("joint_states")
    assert broadcaster.CreateDefaultContext().is_stateless()
