"""Controllers tick when they have something to do, and hear all that comes."""

from pathlib import Path
from unittest import mock

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.forward_command_controller import (
    ForwardCommandController,
    ForwardControllersBase,
)
from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint, TopicRejected
from tests import models

PERIOD = 0.01
ARM = "joint_trajectory_controller/JointTrajectoryController"
GROUP = "forward_command_controller/ForwardCommandController"
YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {{type: {ARM}}}
    group: {{type: {GROUP}}}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [position]
    state_interfaces: [position]
group: {{ros__parameters: {{joints: [swing], interface_name: position}}}}
"""
GOAL = JointTrajectory(
    joint_names=("swing",),
    points=(JointTrajectoryPoint(positions=(0.2,), time_from_start=0.1),),
)


def simulate(folder: Path, text: str = YAML) -> ad.Simulation:
    """Return a pendulum whose first controller is active and the second isn't."""
    robot = models.load(folder, models.pendulum(), text)
    options = ad.SimulationOptions(time_step=PERIOD)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def count_idle_cycles(sim: ad.Simulation, system: type, num_cycles: int) -> int:
    """Return in how many cycles an inactive controller is asked what it does."""
    with mock.patch.object(
        system, "_idle", autospec=True, side_effect=system._idle
    ) as idle:
        sim.run(num_cycles * PERIOD)
    return idle.call_count


def test_an_inactive_controller_to_which_nothing_comes_is_left_alone(tmp_path):
    sim = simulate(tmp_path)
    sim.run(2.5 * PERIOD)

    assert count_idle_cycles(sim, ForwardControllersBase, 20) == 0


def test_a_message_wakes_an_inactive_controller_once(tmp_path):
    sim = simulate(tmp_path)
    sim.run(2.5 * PERIOD)

    sim.controller("group").command([0.1])

    assert count_idle_cycles(sim, ForwardControllersBase, 20) == 1
    (rejected,) = sim.rejected
    assert isinstance(rejected, TopicRejected)
    assert rejected.message.data == (0.1,)


def test_a_goal_that_ends_with_its_controller_is_reported_while_that_is_inactive(
    tmp_path,
):
    sim = simulate(tmp_path)
    goal = sim.controller("arm").send_goal(GOAL)
    sim.run(5.5 * PERIOD)

    sim.switch_controllers(["group"], ["arm"])
    sim.run(0.5)

    assert goal.status.name == "ABORTED"
    assert count_idle_cycles(sim, JointTrajectoryController, 20) == 0


@pytest.mark.parametrize("sent", [0.5, 1.5, 2.5, 3.5])
def test_a_slow_controller_hears_what_comes_between_its_ticks(tmp_path, sent):
    slow = YAML.replace("joints: [swing]\n", "joints: [swing]\n    update_rate: 25\n")
    sim = simulate(tmp_path, slow)
    sim.run((8 + sent) * PERIOD)

    goal = sim.controller("arm").send_goal(GOAL)
    sim.run(0.5)

    assert goal.status.name == "SUCCEEDED"
    np.testing.assert_allclose(sim.joint_states().position, [0.2], atol=2e-3)


def test_a_restored_simulation_hears_what_lies_on_its_ports_as_before(tmp_path):
    sim = simulate(tmp_path)
    sim.controller("arm").send_goal(GOAL)
    sim.run(5.5 * PERIOD)
    saved = sim.simulator.get_context().Clone()

    sim.run(10 * PERIOD)
    expected = sim.joint_states()
    sim.simulator.reset_context(saved)
    sim.run(10 * PERIOD)

    assert sim.joint_states() == expected


def test_a_tick_without_a_context_leaves_the_same_behind(tmp_path, monkeypatch):
    def simulate_and_stop(folder: Path) -> list[object]:
        sim = simulate(folder, STRICT)
        goal = sim.controller("arm").send_goal(GOAL)
        sim.run(4.5 * PERIOD)
        # Off its path, the controller stops and reports what it has commanded.
        push(sim)
        sim.run(0.2)
        assert goal.status.name == "ABORTED"
        reported = sim.controller("arm").state()
        rollout = sim.rollout()
        return [rollout.position.tolist(), rollout.effort.tolist(), repr(reported)]

    directly = simulate_and_stop(tmp_path)
    monkeypatch.setattr(JointTrajectoryController, "reads_by_now", False)

    assert simulate_and_stop(tmp_path) == directly


STRICT = YAML.replace(
    "    state_interfaces: [position]\n",
    "    state_interfaces: [position]\n    constraints: {swing: {trajectory: 0.1}}\n",
)


def push(sim: ad.Simulation) -> None:
    """Move the pendulum by hand."""
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyMutableContextFromRoot(sim.simulator.get_mutable_context())
    plant.SetPositions(context, plant.GetPositions(context) + 0.5)


class Reading(JointTrajectoryController):
    """Reads its ports in every cycle, which its base class promises not to."""

    def _update(self, now, state):
        self._read(now.context)
        return super()._update(now, state)


class Counting(ForwardCommandController):
    """Counts the cycles in which it is inactive, which its base class doesn't."""

    cycles = 0

    def _idle(self, now, state):
        Counting.cycles += 1
        return super()._idle(now, state)


def test_what_a_class_promises_does_not_bind_those_derived_from_it(
    tmp_path, monkeypatch
):
    for name, system in ((ARM, Reading), (GROUP, Counting)):
        row = CONTROLLER_TYPES[name]._replace(system=system)
        monkeypatch.setitem(CONTROLLER_TYPES, name, row)
    monkeypatch.setattr(Counting, "cycles", 0)
    sim = simulate(tmp_path)
    goal = sim.controller("arm").send_goal(GOAL)

    sim.run(0.5)

    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert Counting.cycles >= 49
