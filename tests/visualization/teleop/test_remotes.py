"""Every controller that takes commands has a remote, which is silent until used."""

import re
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import Duration, JointTrajectory, JointTrajectoryPoint
from arm_drake.visualization.page.widgets import Slider
from arm_drake.visualization.teleop.base import Remote
from arm_drake.visualization.teleop.remotes import (
    BaseRemote,
    ForwardRemote,
    TrajectoryRemote,
    find_remotes,
)
from tests import models
from tests.robots import load_real_robot, robot_names
from tests.visualization.teleop import panel

ARM = "joint_trajectory_controller"

# Types of controllers that command something, and that no person commands: why.
WITHOUT_REMOTE: dict[str, str] = {}

TWO_ARMS = models.trajectory_controllers({"first": ["swing"], "second": ["swing"]})


@pytest.mark.slow
@pytest.mark.parametrize("name", robot_names())
def test_every_controller_that_commands_has_a_remote(name: str) -> None:
    sim = panel.simulate(load_real_robot(name))

    remotes = find_remotes(sim)

    commanding = [
        row.name
        for row in sim.list_controllers()
        if row.state != "unconfigured"
        and row.type not in WITHOUT_REMOTE
        and sim.directory.find(row.name)[2].command_interfaces
    ]
    assert [remote.controller for remote in remotes] == commanding
    for remote in remotes:
        shown = panel.leaves(remote)
        assert any(isinstance(widget, Slider) for widget in shown.values())
        assert {w.is_enabled for w in shown.values()} == {remote.is_active}
        sliders = [w for w in shown.values() if isinstance(w, Slider)]
        assert all(w.lower < w.upper and np.isfinite(w.value) for w in sliders)


@pytest.mark.slow
def test_ids_are_unique_and_begin_with_the_controller() -> None:
    sim = panel.simulate(ad.load_robot("mycobot_280"))

    for remote in find_remotes(sim):
        widgets = [w.id for w in panel.leaves(remote).values()]
        assert len(widgets) == len(set(widgets)) > 0
        assert all(id.startswith(f"remote:{remote.controller}:") for id in widgets)


def moving(*, with_remotes: bool) -> ad.Rollout:
    """Return a motion that somebody looks at, or not."""
    sim = panel.simulate(ad.load_robot("doosan_a0912"))
    remotes = find_remotes(sim) if with_remotes else []
    joints = sim.controller(ARM).state().joint_names or sim.joint_states().name
    point = JointTrajectoryPoint((0.3,) * len(joints), time_from_start=Duration.of(0.5))
    sim.controller(ARM).send_trajectory(
        JointTrajectory(joint_names=joints, points=(point,))
    )
    for _ in range(8):
        for remote in remotes:
            remote.widgets()
            remote.tick(sim.time)
            remote.changes()
        sim.run(panel.PERIOD)
    return sim.rollout()


@pytest.mark.slow
def test_remotes_that_nobody_uses_change_no_bit() -> None:
    first, second = (moving(with_remotes=flag) for flag in (False, True))

    assert np.ptp(first.position) > 0.2
    assert panel.same_bits(first, second)


@pytest.mark.slow
def test_an_idle_base_is_told_nothing() -> None:
    first, second = (panel.simulate(load_real_robot("create3")) for _ in range(2))

    first.run(1.0)
    panel.run(second, 1.0, *find_remotes(second))

    # In chunks of other lengths the same steps are taken.
    assert panel.same_bits(first.rollout(), second.rollout())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["trajectory", "command", "base"])
def test_an_inactive_controller_is_sent_nothing(tmp_path: Path, kind: str) -> None:
    remote: Remote
    if kind == "trajectory":
        sim = panel.simulate(models.load(tmp_path, models.pendulum(), TWO_ARMS))
        remote = panel.find(sim, "second", TrajectoryRemote)
        part, value = "goal:swing", 1.0
    elif kind == "command":
        sim = panel.simulate(load_real_robot("demo03_rrbot_system_m"))
        remote = panel.find(sim, "forward_velocity_controller", ForwardRemote)
        part, value = "value:joint1/velocity", 0.5
    else:
        sim = panel.simulate(
            load_real_robot("create3"), inactive=("diffdrive_controller",)
        )
        remote = panel.find(sim, "diffdrive_controller", BaseRemote)
        part, value = "forward", 0.2
    before = dict(panel.leaves(remote))

    problem = re.escape(f"controller {remote.controller!r}: it isn't active")
    with pytest.raises(InputError, match=problem):
        panel.use(remote, part, value)

    assert not any(widget.is_enabled for widget in before.values())
    panel.run(sim, 0.3, remote)
    # What comes to an inactive controller is rejected; nothing came.
    assert not sim.rejected
    assert not sim.goals


def test_widgets_follow_the_state_of_the_controller(tmp_path: Path) -> None:
    sim = panel.simulate(models.load(tmp_path, models.pendulum(), TWO_ARMS))
    first, second = find_remotes(sim)
    for remote in (first, second):
        remote.widgets()

    sim.switch_controllers(["second"], ["first"])
    sim.run(0.1)

    off, on = first.changes(), second.changes()
    assert {fields["is_enabled"] for fields in off.values()} == {False}
    assert {fields["is_enabled"] for fields in on.values()} == {True}
    assert set(off) == {w.id for w in panel.leaves(first).values()}
    assert not first.changes()
    panel.use(second, "goal:swing", 0.5)
    with pytest.raises(InputError, match="isn't active"):
        panel.use(first, "goal:swing", 0.5)


def test_a_follower_in_a_chain_takes_nothing_from_a_panel(tmp_path: Path) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 100
    hold: {type: pid_controller/PidController}
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
hold:
  ros__parameters:
    dof_names: [swing]
    command_interface: effort
    reference_and_state_interfaces: [position]
    gains: {swing: {p: 50.0, d: 5.0}}
arm:
  ros__parameters:
    joints: [swing]
    command_joints: [hold/swing]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
"""
    control = models.ros2_control("swing", command="effort")
    sim = panel.simulate(models.load(tmp_path, models.pendulum(control=control), yaml))
    hold, arm = find_remotes(sim)

    assert {row.state for row in sim.list_controllers()} == {"active"}
    assert arm.is_active
    with pytest.raises(InputError, match="another controller commands it"):
        panel.use(hold, "value:swing/position", 0.5)

    sim.switch_controllers([], ["arm"])
    sim.run(0.1)
    panel.use(hold, "value:swing/position", 0.5)
    panel.run(sim, 0.1, hold, arm)
    # Its last reference is the message's, as the controller says.
    (state,) = sim.controller("hold").state().dof_states
    assert state.reference == 0.5


@pytest.mark.slow
def test_of_several_robots_each_moves_its_own(tmp_path: Path) -> None:
    yaml = models.trajectory_controllers({"arm": ["swing"]})
    robots = [
        models.load(tmp_path, models.pendulum(), yaml, name=name)
        for name in ("left", "right")
    ]
    sim = ad.Simulation(ad.build_diagram(robots))
    left, right = find_remotes(sim)

    panel.use(right, "goal:swing", 0.4)
    panel.run(sim, 1.5, left, right)

    assert [left.controller, right.controller] == ["left/arm", "right/arm"]
    ids = [w.id for w in panel.leaves(right).values()]
    assert ids == ["remote:right/arm:goal:swing", "remote:right/arm:speed"]
    assert abs(panel.positions(sim, "left")["swing"]) <= 2e-3
    assert abs(panel.positions(sim, "right")["swing"] - 0.4) <= 2e-3


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        (
            "joint_trajectory_controller/JointTrajectoryController",
            "joints: [swing, ghost], command_interfaces: [position], "
            "state_interfaces: [position]",
        ),
        ("position_controllers/GripperActionController", "joint: ghost"),
        ("position_controllers/JointGroupPositionController", "joints: [swing, ghost]"),
    ],
)
def test_a_joint_that_is_not_there_disables_a_remote(
    tmp_path: Path, kind: str, more: str
) -> None:
    yaml = f"""
controller_manager:
  ros__parameters: {{update_rate: 100, arm: {{type: {kind}}}}}
arm:
  ros__parameters: {{{more}}}
"""
    sim = panel.simulate(models.load(tmp_path, models.pendulum(), yaml))
    (remote,) = find_remotes(sim)

    remote.tick(sim.time)

    shown = panel.leaves(remote).values()
    assert not any(w.is_enabled for w in shown)
    assert not remote.changes()


def test_a_reset_forgets_what_was_sent(tmp_path: Path) -> None:
    sim = panel.simulate(models.load(tmp_path, models.pendulum(), TWO_ARMS))
    remote = find_remotes(sim)[0]
    panel.use(remote, "goal:swing", 0.4)
    panel.run(sim, 1.0, remote)

    sim.reset()
    remote.reset()

    slider = panel.leaves(remote)["goal:swing"]
    assert isinstance(slider, Slider)
    assert slider.value == 0.0


def test_unknown_widgets_and_values_are_refused(tmp_path: Path) -> None:
    sim = panel.simulate(models.load(tmp_path, models.pendulum(), TWO_ARMS))
    remote = find_remotes(sim)[0]

    with pytest.raises(InputError, match="no widget 'remote:first:goal:swung'"):
        panel.use(remote, "goal:swung", 1.0)
    for value in (None, "much", float("nan"), True):
        with pytest.raises(InputError, match="swing: expected a finite number"):
            panel.use(remote, "goal:swing", value)  # type: ignore[arg-type]
    # A slider's value is kept within its range.
    panel.use(remote, "goal:swing", 99.0)
    slider = panel.leaves(remote)["goal:swing"]
    assert isinstance(slider, Slider)
    assert slider.value == slider.upper == 3.0
