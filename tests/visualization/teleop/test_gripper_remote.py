"""Grippers open and close by buttons, and go where a slider is put."""

import math
from pathlib import Path

import pytest

from arm_drake.errors import InputError
from arm_drake.messages import GoalStatus
from arm_drake.plant.joint_ranges import find_gripper_ranges
from arm_drake.visualization.page.widgets import Slider
from arm_drake.visualization.teleop.remotes import GripperRemote
from tests import models
from tests.robots import load_real_robot
from tests.visualization.teleop import panel

# How near a joint is to its goal at rest [rad] or [m], as in tests/rollouts.
FINAL = 2e-3

# Robots of the index with an action for their gripper: the controller and its joint.
GRIPPERS = {
    "ar4": ("gripper_controller", "gripper_jaw1_joint"),
    "open_manipulator_x": ("gripper_controller", "gripper_left_joint"),
    "so100_brukg": ("gripper_controller", "Gripper"),
    "robotiq_2f85": ("robotiq_gripper_controller", "robotiq_85_left_knuckle_joint"),
}

YAML = """
controller_manager:
  ros__parameters:
    update_rate: 100
    hand: {{type: {kind}}}
hand:
  ros__parameters:
    joint: finger
    {more}
"""

EFFORT = "effort_controllers/GripperActionController"
GAINS = "gains: {finger: {p: 60.0, i: 60.0, d: 10.0, i_clamp: 20.0}}"


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIPPERS)
def test_a_gripper_closes_and_opens(name: str) -> None:
    controller, joint = GRIPPERS[name]
    robot = load_real_robot(name)
    is_open, is_closed = find_gripper_ranges(robot)[joint]
    sim = panel.simulate(robot)
    remote = panel.find(sim, controller, GripperRemote)

    for part, goal in (("close", is_closed), ("open", is_open), ("close", is_closed)):
        panel.use(remote, part)
        panel.run(sim, 2.0, remote)

        assert abs(panel.positions(sim)[joint] - goal) <= FINAL
        shown = panel.leaves(remote)["position"]
        assert isinstance(shown, Slider)
        assert shown.value == goal
    assert sim.goals[1].status is GoalStatus.SUCCEEDED
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_the_slider_moves_it_part_of_the_way() -> None:
    sim = panel.simulate(load_real_robot("so100_brukg"))
    remote = panel.find(sim, "gripper_controller", GripperRemote)

    panel.use(remote, "position", 0.7)
    panel.run(sim, 2.0, remote)

    (goal,) = sim.goals
    assert goal.status is GoalStatus.SUCCEEDED
    assert abs(panel.positions(sim)["Gripper"] - 0.7) <= FINAL


@pytest.mark.slow
def test_one_that_commands_efforts_is_told_how_much(tmp_path: Path) -> None:
    urdf = models.GRIPPER.replace('name="position"', 'name="effort"', 1)
    yaml = YAML.format(kind=EFFORT, more=GAINS)
    sim = panel.simulate(models.load(tmp_path, urdf, yaml))
    remote = panel.find(sim, "hand", GripperRemote)

    goal = remote.move_to(0.4)
    panel.run(sim, 8.0, remote)

    # Without an effort it would not move at all; that of the joint's limit is 100.
    assert goal.request.goal.command.max_effort == 100.0
    assert abs(panel.positions(sim)["finger"] - 0.4) <= FINAL


def test_a_joint_without_limits_has_no_buttons(tmp_path: Path) -> None:
    urdf = models.GRIPPER.replace('lower="-3" upper="3"', "").replace(
        'type="revolute"', 'type="continuous"'
    )
    kind = "position_controllers/GripperActionController"
    sim = panel.simulate(models.load(tmp_path, urdf, YAML.format(kind=kind, more="")))
    remote = panel.find(sim, "hand", GripperRemote)

    assert set(panel.leaves(remote)) == {"position"}
    with pytest.raises(InputError, match="'finger' has no limits to tell open from"):
        remote.open()
    with pytest.raises(InputError, match="position: expected a finite number, got nan"):
        remote.move_to(math.nan)
    assert not sim.goals


@pytest.mark.slow
def test_the_slider_follows_until_a_goal_is_sent() -> None:
    sim = panel.simulate(load_real_robot("so100_brukg"))
    remote = panel.find(sim, "gripper_controller", GripperRemote)
    other = panel.find(sim, "gripper_controller", GripperRemote)
    remote.widgets()

    other.move_to(0.5)
    panel.run(sim, 2.0, remote)
    name = f"remote:{remote.controller}:position"
    followed = remote.changes()[name]["value"]
    remote.move_to(1.0)

    assert followed == pytest.approx(0.5, abs=FINAL)
    assert remote.changes() == {name: {"value": 1.0}}
