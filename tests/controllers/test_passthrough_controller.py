"""PassthroughController by itself and in chains."""

import math
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.controllers.passthrough_controller import (
    PassthroughController,
    PassthroughControllerParameters,
)
from arm_drake.messages import (
    Duration,
    Float64MultiArray,
    JointTrajectory,
    JointTrajectoryPoint,
)
from tests import models
from tests.controllers.driving import NAME, Driven, make_params
from tests.controllers.parameters import PASSTHROUGH

INTERFACES = ("joint1/position", "joint2/velocity")
PERIOD = 0.01


def drive() -> Driven:
    parameters = PassthroughControllerParameters(INTERFACES)
    system = PassthroughController(parameters, make_params(("joint1", "joint2")))
    return Driven(system, (1.1, 2.1))


def send(driven: Driven, *data: float, activation: int | None = 1) -> list[float]:
    """Run a cycle with a message; return what the command interfaces hold."""
    driven.run({"commands": Float64MultiArray(data)}, activation=activation)
    command_values: list[float] = driven.command_values.tolist()
    return command_values


def test_references_have_the_name_of_the_controller_in_front() -> None:
    system = drive().system

    assert system.reference_interfaces == tuple(f"{NAME}/{name}" for name in INTERFACES)
    assert system.command_interfaces == INTERFACES
    assert system.state_interfaces == ()


def test_without_a_reference_commands_stay_as_they_are() -> None:
    driven = drive()

    tick = driven.run()

    assert np.isnan(tick.command).all()
    assert driven.command_values.tolist() == [1.1, 2.1]


def test_a_message_holds_until_the_next() -> None:
    driven = drive()

    first = send(driven, 0.1, 0.2)
    driven.command_values = np.zeros(2)
    driven.run()

    assert first == [0.1, 0.2]
    assert driven.command_values.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ((1.0,), "data must have 2 values (joint1/position, joint2/velocity), got 1"),
        ((), "data must have 2 values (joint1/position, joint2/velocity), got 0"),
        ((1.0, math.nan), "data[1] must be finite, got nan"),
        ((-math.inf, 1.0), "data[0] must be finite, got -inf"),
    ],
)
def test_a_message_that_can_not_be_passed_on_has_no_effect(
    data: tuple[float, ...], reason: str
) -> None:
    driven = drive()
    send(driven, 0.1, 0.2)

    command_values = send(driven, *data)

    assert command_values == [0.1, 0.2]
    assert driven.reasons() == [reason]


def test_the_references_of_another_controller_are_passed_on() -> None:
    driven = drive()

    driven.run(references=[0.3, math.nan])
    first = driven.command_values.tolist()
    driven.command_values = np.zeros(2)
    driven.run(references=[math.nan, 0.5])

    # A reference holds; what there never was one for stays as it is.
    assert first == [0.3, 2.1]
    assert driven.command_values.tolist() == [0.3, 0.5]


def test_the_topic_is_ignored_in_a_chain() -> None:
    driven = drive()

    message = {"commands": Float64MultiArray((7.0, 7.0))}
    driven.run(message, references=[0.3, 0.4])

    assert driven.command_values.tolist() == [0.3, 0.4]
    assert driven.reasons() == ["another controller commands the references"]


def test_an_activation_forgets_what_was_asked_for() -> None:
    driven = drive()
    send(driven, 0.1, 0.2)

    inactive = send(driven, 7.0, 7.0, activation=None)
    tick = driven.run(activation=2)

    assert inactive == [0.1, 0.2]
    assert np.isnan(tick.command).all()
    assert driven.reasons() == ["the controller is not active"]


YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    trajectory: {{type: joint_trajectory_controller/JointTrajectoryController}}
    both: {{type: {PASSTHROUGH}}}
    upper: {{type: {PASSTHROUGH}}}
    lower: {{type: {PASSTHROUGH}}}
upper: {{ros__parameters: {{interfaces: [shoulder/position]}}}}
lower: {{ros__parameters: {{interfaces: [elbow/position]}}}}
both:
  ros__parameters:
    interfaces: [upper/shoulder/position, lower/elbow/position]
trajectory:
  ros__parameters:
    joints: [shoulder, elbow]
    command_joints: [both/upper/shoulder, both/lower/elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
"""
# The same without the controllers in between.
DIRECT = """
controller_manager:
  ros__parameters:
    update_rate: 100
    trajectory: {type: joint_trajectory_controller/JointTrajectoryController}
trajectory:
  ros__parameters:
    joints: [shoulder, elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
"""
TRAJECTORY = JointTrajectory(
    joint_names=("shoulder", "elbow"),
    points=(
        JointTrajectoryPoint(
            positions=(0.5, -0.3), time_from_start=Duration(0, 500_000_000)
        ),
    ),
)


def follow(folder: Path, yaml: str) -> ad.Rollout:
    folder.mkdir()
    robot = models.load(folder, models.TWO_LINKS, yaml)
    sim = ad.Simulation(ad.build_diagram(robot))
    assert {c.state for c in sim.list_controllers()} == {"active"}
    goal = sim.controller("trajectory").send_goal(TRAJECTORY)
    sim.advance_to(1.0)
    assert goal.status == ad.GoalStatus.SUCCEEDED
    return sim.rollout()


@pytest.mark.slow
def test_a_chain_of_three_follows_a_trajectory_as_one_controller_does(
    tmp_path: Path,
) -> None:  # As in example_12: a trajectory, two in a row, the hardware.
    chain = follow(tmp_path / "chain", YAML)
    direct = follow(tmp_path / "direct", DIRECT)

    # Nothing is late, and nothing is changed on the way.
    np.testing.assert_array_equal(chain.position, direct.position)
    assert np.abs(direct.position[-1] - (0.5, -0.3)).max() < 0.01


@pytest.mark.slow
def test_a_forward_controller_commands_through_it(tmp_path: Path) -> None:
    yaml = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    forward: {{type: forward_command_controller/ForwardCommandController}}
    pass: {{type: {PASSTHROUGH}}}
forward: {{ros__parameters: {{joints: [pass/swing], interface_name: position}}}}
pass: {{ros__parameters: {{interfaces: [swing/position]}}}}
"""
    robot = models.load(tmp_path, models.pendulum(), yaml)
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.controller("forward").command([0.4])
    sim.advance_to(1.0)
    sim.switch_controllers(deactivate=["forward"])
    sim.controller("pass").command([-0.4])
    sim.advance_to(2.0)

    position = sim.rollout().position[:, 0]
    assert position[99] == pytest.approx(0.4, abs=0.01)
    assert position[-1] == pytest.approx(-0.4, abs=0.01)


@pytest.mark.slow
def test_without_hardware_in_the_description_it_is_what_it_claims(
    tmp_path: Path,
) -> None:
    yaml = f"""
controller_manager:
  ros__parameters:
    pass: {{type: {PASSTHROUGH}}}
pass: {{ros__parameters: {{interfaces: [swing/velocity]}}}}
"""
    robot = models.load(tmp_path, models.pendulum(control=""), yaml)
    sim = ad.Simulation(ad.build_diagram(robot))

    sim.controller("pass").command([0.5])
    sim.advance_to(1.0)

    assert sim.joint_states().velocity[0] == pytest.approx(0.5, abs=0.01)
