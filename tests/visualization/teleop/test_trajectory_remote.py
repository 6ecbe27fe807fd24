"""Sliders of trajectories: goals are reached, in time and within the speed limits."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import JointTrajectory
from arm_drake.visualization.page.widgets import Slider
from arm_drake.visualization.teleop.remotes import TrajectoryRemote
from tests import models
from tests.carts import plugin
from tests.visualization.teleop import panel

ARM = "joint_trajectory_controller"

# How near a joint is to its goal at rest [rad], as in tests/rollouts.
FINAL = 2e-3

SWING = models.trajectory_controllers({"arm": ["swing"]})

# As `models.pendulum` says it.
VELOCITY = 10.0


def swing(folder: Path, **options: str) -> tuple[ad.Simulation, TrajectoryRemote]:
    sim = panel.simulate(models.load(folder, models.pendulum(**options), SWING))
    return sim, panel.find(sim, "arm", TrajectoryRemote)


def slider(remote: TrajectoryRemote, part: str) -> Slider:
    widget = panel.leaves(remote)[part]
    assert isinstance(widget, Slider)
    return widget


def load_mycobot(control: str) -> ad.Robot:
    return ad.load_robot("mycobot_280", xacro_args={"control": control})


def travel_time(sim: ad.Simulation, goal: float) -> float:
    """Return when the controller's reference is at the goal [s], from now on."""
    start = sim.time
    while sim.time < start + 20.0:
        sim.run(sim.period)
        (reference,) = sim.controller("arm").state().reference.positions
        if abs(reference - goal) < 1e-9:
            break
    return sim.time - start


@pytest.mark.slow
def test_a_slider_moves_its_joint_and_holds_the_others() -> None:
    sim = panel.simulate(ad.load_robot("doosan_a0912"))
    remote = panel.find(sim, ARM, TrajectoryRemote)

    panel.use(remote, "goal:joint1", 0.4)
    panel.run(sim, 1.5, remote)
    panel.use(remote, "goal:joint3", -0.3)
    panel.run(sim, 1.5, remote)

    at = panel.positions(sim)
    goals = {"joint1": 0.4, "joint3": -0.3}
    assert all(abs(q - goals.get(joint, 0.0)) <= FINAL for joint, q in at.items())
    # All joints are in each message, or it would have been refused.
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_a_goal_takes_as_long_as_its_slowest_joint() -> None:
    sim = panel.simulate(ad.load_robot("doosan_a0912"))
    remote = panel.find(sim, ARM, TrajectoryRemote)
    (robot,) = sim.robots.values()
    joints = robot.description.movable_joints
    limits = {joint.name: joint.limits.velocity for joint in joints}
    goal = {"joint1": 0.2, "joint4": 0.8, "joint6": -0.5}
    remote.speed = 0.3

    remote.go_to(goal)
    sim.run(3.0)

    rollout = sim.rollout()
    reference = rollout.references[ARM]
    rates = np.abs(np.diff(reference.position, axis=0)).max(axis=0) * 100.0
    parts = {
        joint: rate / limits[joint]
        for joint, rate in zip(reference.joint_names, rates, strict=True)
    }
    # The reference is a straight line, from where the joints are measured: the slowest
    # one goes at its part of the limit exactly, but for what they sag meanwhile.
    assert max(parts.values()) == pytest.approx(0.3, rel=1e-3)
    end = dict(zip(rollout.joint_names, rollout.position[-1], strict=True))
    assert all(abs(end[joint] - q) <= FINAL for joint, q in goal.items())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "percent", "goal", "expected"),
    [
        (VELOCITY, 10.0, 1.5, 1.5 / (0.1 * VELOCITY)),
        # Half of the speed without being asked.
        (1.0, None, 0.5, 0.5 / 0.5),
        # No limit is taken for 1 rad/s.
        (0.0, 100.0, 0.4, 0.4),
        # So near that the shortest time counts.
        (VELOCITY, 100.0, 0.01, 0.1),
    ],
)
def test_how_long_a_goal_takes(
    tmp_path: Path, limit: float, percent: float | None, goal: float, expected: float
) -> None:
    bounds = f'lower="-3" upper="3" effort="100" velocity="{limit}"'
    sim, remote = swing(tmp_path, limit=bounds)
    sim.run(0.1)
    if percent is not None:
        panel.use(remote, "speed", percent)

    panel.use(remote, "goal:swing", goal)

    # A reference is that of the next tick; a tick sees the message one period later at
    # most, and the run stops at whole periods.
    assert travel_time(sim, goal) == pytest.approx(expected, abs=2.01 * sim.period)


def test_a_duration_can_be_given(tmp_path: Path) -> None:
    sim, remote = swing(tmp_path)

    remote.go_to({"swing": 0.5}, duration=0.8)

    assert travel_time(sim, 0.5) == pytest.approx(0.8, abs=2.01 * sim.period)


@pytest.mark.slow
def test_a_joint_without_end_takes_the_shorter_way(tmp_path: Path) -> None:
    urdf = models.pendulum(limit='effort="100" velocity="10"').replace(
        'type="revolute"', 'type="continuous"'
    )
    sim = panel.simulate(models.load(tmp_path, urdf, SWING))
    remote = panel.find(sim, "arm", TrajectoryRemote)
    shown = slider(remote, "goal:swing")
    assert [shown.lower, shown.upper] == pytest.approx([-math.pi, math.pi])

    panel.use(remote, "goal:swing", 3.0)
    panel.run(sim, 1.5, remote)
    panel.use(remote, "goal:swing", -3.0)
    panel.run(sim, 0.5, remote)

    # Past half a turn, by 0.28 rad and not back by 6 rad.
    expected = 2.0 * math.pi - 3.0
    assert abs(panel.positions(sim)["swing"] - expected) <= FINAL
    assert slider(remote, "goal:swing").value == pytest.approx(-3.0)


@pytest.mark.slow
def test_sliders_follow_the_robot_until_a_goal_is_sent(tmp_path: Path) -> None:
    sim, remote = swing(tmp_path)
    remote.widgets()

    # Somebody else moves it.
    other = panel.find(sim, "arm", TrajectoryRemote)
    other.go_to({"swing": 0.5})
    panel.run(sim, 1.0, remote)
    (followed,) = remote.changes().values()
    panel.use(remote, "goal:swing", -0.5)
    panel.run(sim, 0.1, remote)
    sent = remote.changes()
    panel.run(sim, 1.0, remote)

    assert followed["value"] == pytest.approx(0.5, abs=FINAL)
    assert sent == {"remote:arm:goal:swing": {"value": -0.5}}
    assert not remote.changes()

    # Another activation starts where the joint is then, not at the goal of before.
    other.go_to({"swing": 0.2})
    sim.run(1.0)
    sim.switch_controllers([], ["arm"])
    sim.run(0.1)
    sim.switch_controllers(["arm"], [])
    sim.run(0.1)
    assert slider(remote, "goal:swing").value == pytest.approx(0.2, abs=FINAL)


@pytest.mark.slow
def test_joints_that_stay_keep_their_last_goal(tmp_path: Path) -> None:
    yaml = models.trajectory_controllers({"arm": ["shoulder", "elbow"]})
    sim = panel.simulate(models.load(tmp_path, models.TWO_LINKS, yaml))
    remote = panel.find(sim, "arm", TrajectoryRemote)

    # The second is sent while the first is on its way.
    panel.use(remote, "goal:shoulder", 1.0)
    sim.run(0.05)
    panel.use(remote, "goal:elbow", -0.5)
    panel.run(sim, 1.5, remote)

    at = panel.positions(sim)
    assert abs(at["shoulder"] - 1.0) <= FINAL
    assert abs(at["elbow"] + 0.5) <= FINAL


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda r: r.go_to({"swang": 1.0}), "no joint 'swang'; did you mean 'swing'"),
        (
            lambda r: r.go_to({"swing": math.nan}),
            "swing: expected a finite number",
        ),
        (lambda r: r.go_to({}, duration=0.0), "duration: expected more than 0 s and"),
        (lambda r: r.go_to({}, duration=1e12), "more than 0 s and at most 1e.09 s"),
        (lambda r: setattr(r, "speed", 50.0), "speed: expected above 0 and at most 1"),
        (lambda r: r.open(), "none of its joints is known to be a gripper's"),
    ],
)
def test_what_makes_no_goal_is_refused(
    tmp_path: Path, use: Callable[[TrajectoryRemote], None], message: str
) -> None:
    sim, remote = swing(tmp_path)

    with pytest.raises(InputError, match=message):
        use(remote)

    assert slider(remote, "speed").value == 50.0
    sim.run(0.2)
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_a_gripper_among_the_joints_opens_and_closes() -> None:
    sim = panel.simulate(load_mycobot("ros2_control"))
    remote = panel.find(sim, "grip_controller", TrajectoryRemote)
    # As its scripts have it.
    for part, goal in (("close", -0.7), ("open", 0.0)):
        panel.use(remote, part)
        panel.run(sim, 3.0, remote)

        at = panel.positions(sim)["gripper_controller"]
        assert abs(at - goal) <= FINAL
        assert slider(remote, "goal:gripper_controller").value == pytest.approx(goal)


@pytest.mark.slow
def test_a_follower_is_no_slider_and_moves_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tag = plugin("gz-sim-joint-trajectory-controller-system")
    gains = "".join(
        f"<joint_name>{name}</joint_name><position_p_gain>40</position_p_gain>"
        "<position_d_gain>8</position_d_gain>"
        for name in ("finger", "follower")
    )
    urdf = models.GRIPPER.replace(
        "</robot>", tag.replace("></plugin>", f">{gains}</plugin>") + "</robot>"
    )
    start, end = urdf.index("<ros2_control"), urdf.index("</ros2_control>")
    urdf = urdf[:start] + urdf[end + len("</ros2_control>") :]
    sim = panel.simulate(models.load(tmp_path, urdf))
    (row,) = (r for r in sim.list_controllers() if "Trajectory" in r.name)
    remote = panel.find(sim, row.name, TrajectoryRemote)

    parts = set(panel.leaves(remote))
    sent = []
    publish = remote._publish

    def spy(port: str, data: JointTrajectory) -> None:
        sent.append(data)
        publish(port, data)

    monkeypatch.setattr(remote, "_publish", spy)
    remote.go_to({"finger": 0.4})
    sim.run(1.5)
    sagging = panel.positions(sim)["finger"]
    remote.go_to({"finger": 0.5}, duration=1.0)

    assert "goal:finger" in parts
    assert "goal:follower" not in parts
    message, further = sent
    goal = message.points[-1].positions
    last = dict(zip(message.joint_names, goal, strict=True))
    # -0.5 times the finger's angle, and an offset of 0.1 rad.
    assert last["finger"] == pytest.approx(0.4)
    assert last["follower"] == pytest.approx(0.1 - 0.5 * 0.4, abs=1e-6)
    # Its PIDs leave it below; the next goal starts at what they were told.
    assert sagging < 0.39
    assert further.points[0].positions[message.joint_names.index("finger")] > 0.4
    sim.run(0.1)
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_a_controller_that_jumps_is_led_step_by_step() -> None:
    sim = panel.simulate(load_mycobot("classic"))
    remote = panel.find(sim, "GazeboRosJointPoseTrajectory", TrajectoryRemote)
    joint = "link1_to_link2"

    remote.go_to({joint: 0.8}, duration=2.0)
    panel.run(sim, 1.0, remote)
    half = panel.positions(sim)[joint]
    panel.run(sim, 2.0, remote)

    # Half of the way after half of the time, but for a step of 0.05 s and the servo's
    # own lag of a few of its time constants of 1 / 40 s; a jump is there by then.
    assert half == pytest.approx(0.4, abs=0.4 * (0.05 + 4.0 / 40.0))
    assert abs(panel.positions(sim)[joint] - 0.8) <= FINAL
    assert panel.nothing_lost(sim)
