from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.forward_command_controller import (
    ForwardCommandController,
    ForwardCommandControllerParameters,
    JointGroupControllerParameters,
    MultiInterfaceForwardCommandController,
    MultiInterfaceForwardCommandControllerParameters,
)
from arm_drake.errors import InputError
from arm_drake.messages import Float64MultiArray, TopicRejected
from tests import models
from tests.controllers.driving import Driven, make_params

JOINTS = ("joint1", "joint2", "joint3")
HELD = (1.1, 2.1, 3.1)
GROUPS = ("position", "velocity", "effort")


def drive_forward(joints: tuple[str, ...] = JOINTS, *, distro: str = "jazzy") -> Driven:
    parameters = ForwardCommandControllerParameters(joints, "position")
    params = make_params(JOINTS, distro=distro)
    return Driven(ForwardCommandController(parameters, params), HELD)


def drive_group(interface: str) -> Driven:
    name = f"JointGroup{interface.capitalize()}Controller"
    system = CONTROLLER_TYPES[f"{interface}_controllers/{name}"].system
    assert system is not None
    parameters = JointGroupControllerParameters(JOINTS)
    return Driven(system(parameters, make_params(JOINTS)), HELD)


def drive_multi(*names: str) -> Driven:
    parameters = MultiInterfaceForwardCommandControllerParameters("joint1", names)
    params = make_params(JOINTS)
    system = MultiInterfaceForwardCommandController(parameters, params)
    return Driven(system, HELD[: len(names)])


def send(driven: Driven, *messages: list[float], **how: Any) -> bool:
    """Run a cycle with messages on the topic; return whether the tick went well."""
    sent = tuple(Float64MultiArray(data) for data in messages)
    topic = sent[0] if len(sent) == 1 else sent
    return driven.run({"commands": topic}, **how).is_ok


@pytest.mark.parametrize(
    ("section", "missing"),
    [
        ("joints: [swing], interface_name: kp", "kp"),
        ("joints: [elbow], interface_name: position", "elbow"),
    ],
)
def test_an_interface_that_is_missing_is_named(  # G3
    tmp_path: Path, section: str, missing: str
) -> None:
    yaml = f"""
controller_manager:
  ros__parameters:
    good: {{type: position_controllers/JointGroupPositionController}}
    bad: {{type: forward_command_controller/ForwardCommandController}}
good: {{ros__parameters: {{joints: [swing]}}}}
bad: {{ros__parameters: {{{section}}}}}
"""
    robot = models.load(tmp_path, models.pendulum(), yaml)

    simulation = ad.Simulation(ad.build_diagram(robot))

    states = {c.name: c.state for c in simulation.list_controllers()}
    assert states == {"good": "active", "bad": "inactive"}
    (line,) = [text for text in str(simulation.report).splitlines() if "bad:" in text]
    assert missing in line
    with pytest.raises(InputError, match=missing):
        simulation.switch_controllers(activate=["bad"])


def test_a_group_controller_knows_the_interface_that_it_overwrites(
    tmp_path: Path,
) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    group: {type: position_controllers/JointGroupPositionController}
group: {ros__parameters: {joints: [swing], interface_name: velocity}}
"""
    robot = models.load(tmp_path, models.pendulum(), yaml)

    simulation = ad.Simulation(ad.build_diagram(robot))

    assert "interface_name" not in str(simulation.report)
    (group,) = simulation.list_controllers()
    assert group.state == "active"


def test_without_a_message_commands_stay_as_they_are() -> None:  # G4
    driven = drive_forward()

    tick = driven.run()

    assert tick.is_ok
    assert np.isnan(tick.command).all()


@pytest.mark.parametrize("interface", GROUPS)
def test_a_message_goes_to_the_joints_in_their_order(interface: str) -> None:  # G5
    driven = drive_group(interface)

    assert send(driven, [10, 20, 30])

    assert driven.command_values.tolist() == [10.0, 20.0, 30.0]
    assert driven.system.command_interfaces == tuple(
        f"{joint}/{interface}" for joint in JOINTS
    )


def test_the_order_of_the_parameter_counts() -> None:  # G12
    driven = drive_forward(("joint2", "joint1"))

    driven.command_values = driven.command_values[:2]
    send(driven, [10, 20])

    claims = driven.system.command_interfaces
    assert dict(zip(claims, driven.command_values, strict=True)) == {
        "joint2/position": 10.0,
        "joint1/position": 20.0,
    }


def test_a_message_holds_until_the_next_one() -> None:
    driven = drive_forward()
    send(driven, [10, 20, 30])

    ticks = [driven.run() for _ in range(3)]

    assert [tick.command.tolist() for tick in ticks] == [[10.0, 20.0, 30.0]] * 3


def test_a_message_of_another_size_fails_and_writes_nothing() -> None:  # G6
    driven = drive_forward()

    is_ok = send(driven, [10, 20])

    assert not is_ok
    assert driven.command_values.tolist() == list(HELD)
    assert driven.reasons() == [
        "data must have 3 values (joint1/position, joint2/position, joint3/position), "
        "got 2; the update fails"
    ]


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("distro", ["jazzy", "kilted", "rolling"])
def test_a_value_that_is_not_finite_drops_the_message(  # G7
    bad: float, distro: str
) -> None:
    driven = drive_forward(distro=distro)
    send(driven, [1, 2, 3])

    assert send(driven, [10, bad, 30])

    assert driven.command_values.tolist() == [1.0, 2.0, 3.0]
    assert driven.reasons() == [f"data[1] must be finite, got {bad}; it is dropped"]


@pytest.mark.parametrize("bad", [np.inf, np.nan])
def test_humble_takes_what_is_finite(bad: float) -> None:
    driven = drive_forward(distro="humble")

    assert send(driven, [10, bad, 30])

    assert driven.command_values.tolist() == [10.0, 2.1, 30.0]
    assert driven.reasons() == []


def test_an_empty_message_takes_the_last_one_back() -> None:
    driven = drive_forward()
    send(driven, [10, 20, 30])

    assert send(driven, [])

    assert np.isnan(driven.run().command).all()


def test_an_activation_forgets_the_message_on_the_port() -> None:  # G8
    driven = drive_forward()
    send(driven, [10, 20, 30])
    driven.run(activation=None)

    tick = driven.run(activation=2)

    assert tick.is_ok
    assert np.isnan(tick.command).all()
    assert driven.command_values.tolist() == [10.0, 20.0, 30.0]


def test_after_an_activation_new_messages_count() -> None:  # G9
    driven = drive_forward()
    send(driven, [10, 20, 30])
    driven.run(activation=None)
    driven.run(activation=2)

    send(driven, [5.5, 6.6, 7.7], activation=2)

    assert driven.command_values.tolist() == [5.5, 6.6, 7.7]


@pytest.mark.parametrize(
    ("interface", "expected"),
    [
        ("position", [10.0, 20.0, 30.0]),
        ("velocity", [0.0, 0.0, 0.0]),
        ("effort", [0.0, 0.0, 0.0]),
    ],
)
def test_groups_of_velocities_and_efforts_stop_when_deactivated(  # G10, G11
    interface: str, expected: list[float]
) -> None:
    driven = drive_group(interface)
    send(driven, [10, 20, 30])

    driven.run(activation=None)

    assert driven.command_values.tolist() == expected


def test_a_group_that_fails_stops_in_the_same_tick() -> None:
    driven = drive_group("velocity")
    send(driven, [10, 20, 30])

    assert not send(driven, [1])

    assert driven.command_values.tolist() == [0.0, 0.0, 0.0]


def test_a_message_for_an_inactive_controller_is_rejected() -> None:
    driven = drive_forward()
    driven.run(activation=None)

    send(driven, [10, 20, 30], activation=None)
    driven.run(activation=1)

    assert driven.command_values.tolist() == list(HELD)
    assert driven.reasons() == ["the controller is not active"]


def test_several_interfaces_of_a_joint_are_written() -> None:  # G13
    driven = drive_multi("position", "velocity", "effort")

    assert send(driven, [10, 20, 30])

    claims = driven.system.command_interfaces
    assert dict(zip(claims, driven.command_values, strict=True)) == {
        "joint1/position": 10.0,
        "joint1/velocity": 20.0,
        "joint1/effort": 30.0,
    }


def test_there_are_as_many_values_as_interfaces() -> None:  # G14
    driven = drive_multi("position", "velocity")

    assert not send(driven, [10, 20, 30])

    assert driven.command_values.tolist() == [1.1, 2.1]


def test_of_several_messages_the_last_good_one_counts() -> None:
    driven = drive_forward()

    assert send(driven, [1], [1, 2, 3], [4, 5, np.nan])

    assert driven.command_values.tolist() == [1.0, 2.0, 3.0]
    assert [number for number, _ in driven.output("events")] == [0, 1]


def test_an_event_has_the_message() -> None:
    driven = drive_forward()
    message = Float64MultiArray([np.nan] * 3)

    driven.run({"commands": message})
    driven.run({"commands": message})

    reason = "data[0] must be finite, got nan; it is dropped"
    assert driven.output("events") == ((0, TopicRejected(message, reason)),)


def test_something_else_on_the_port_is_an_error() -> None:
    driven = drive_forward()

    with pytest.raises(TypeError, match="expected a Float64MultiArray, got 'no'"):
        driven.run({"commands": "no"})


def test_without_a_manager_it_ticks_at_its_rate() -> None:
    parameters = ForwardCommandControllerParameters(JOINTS, "position")
    system = ForwardCommandController(parameters, make_params(JOINTS))
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    simulator.AdvanceTo(0.055)
    message = Float64MultiArray([1.0, 2.0, 3.0])
    system.GetInputPort("commands").FixValue(context, message)

    simulator.AdvanceTo(0.0599)
    before = context.get_abstract_state(0).get_value()
    simulator.AdvanceTo(0.065)
    after = context.get_abstract_state(0).get_value()

    assert np.isnan(before.command).all()
    assert after.command.tolist() == [1.0, 2.0, 3.0]
