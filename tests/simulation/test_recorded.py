"""Records besides the joints: commands, goals, messages, poses, provenance."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.entry import bundled_motions
from arm_drake.errors import InputError
from tests.carts import cart, diff_drive
from tests.carts import load as load_cart
from tests.models import load, pendulum, ros2_control
from tests.physics.support import EFFORT, effort_controller, one_joint
from tests.physics.support import simulate as one_joint_of
from tests.simulation.test_recording import BOTH, command, simulate


def test_commands_are_what_held_until_the_tick(tmp_path: Path) -> None:
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(0.045)

    rollout = sim.rollout()

    columns = [
        rollout.command_names.index(f"{joint}/position")
        for joint in ("shoulder", "elbow")
    ]
    wanted = rollout.references["position"].position
    np.testing.assert_array_equal(rollout.command[:, columns], wanted)
    effort = rollout.command_names.index("shoulder/effort")
    # Nobody claims the efforts.
    assert np.all(np.nan_to_num(rollout.command[:, effort]) == 0.0)


@pytest.mark.parametrize(
    ("preset", "is_limited"), [("accurate", True), ("kinematic", False)]
)
def test_without_physics_no_effort_is_at_a_limit(
    tmp_path: Path, preset: str, is_limited: bool
) -> None:
    urdf = one_joint("prismatic", axis="1 0 0").replace('effort="1000"', 'effort="2"')
    assert 'effort="2"' in urdf
    sim = one_joint_of(tmp_path, urdf, effort_controller(), step=0.01, preset=preset)
    sim.controller(EFFORT).command([5.0])

    sim.advance_to(0.2)

    rollout = sim.rollout()
    assert bool(rollout.effort_saturation()) == is_limited
    assert np.isfinite(rollout.effort_limit).all() == is_limited


def test_who_was_active_is_recorded(tmp_path: Path) -> None:
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)
    sim.switch_controllers(["effort"], ["position"])
    sim.advance_to(0.045)

    rollout = sim.rollout()

    assert list(rollout.controllers) == ["position", "effort"]
    # Before the tick at 0 the state is that of the start; the switch is at 0.02 s.
    assert rollout.active[:, 0].tolist() == [1, 1, 1, 0, 0]
    assert rollout.active[:, 1].tolist() == [0, 0, 0, 1, 1]


@pytest.mark.slow
def test_goals_and_their_results_are_recorded() -> None:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim.run(motion.duration + 1.0, motion)

    rollout = sim.rollout()

    (goal,) = rollout.goals
    (handle,) = sim.goals
    assert (goal.controller, goal.status, goal.error_code) == (
        handle.controller,
        "SUCCEEDED",
        0,
    )
    assert goal.type == "FollowJointTrajectoryGoal"
    assert goal.sent_at == 0.0
    last = goal.goal["trajectory"]["points"][-1]["time_from_start"]["sec"]
    # The news is looked at every 50 ticks.
    assert last <= goal.ended_at <= last + 0.5 + 50 * sim.period
    assert goal.goal["trajectory"]["joint_names"] == list(
        handle.request.goal.trajectory.joint_names
    )


def test_messages_are_recorded_with_their_topics(tmp_path: Path) -> None:
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)
    sim.controller("position").command([0.3, -0.2])
    sim.switch_controllers(["effort"], ["position"])

    messages = sim.rollout().messages

    assert [(m.time, m.topic, m.type) for m in messages] == [
        (0.015, "/position/commands", "Float64MultiArray"),
        (0.015, "/controller_manager/switch_controller", "SwitchController"),
    ]
    assert messages[0].data == {"data": [0.3, -0.2]}


@pytest.mark.slow
def test_poses_of_a_free_base_are_recorded(tmp_path: Path) -> None:
    robot = load_cart(tmp_path, cart(diff_drive()))
    sim = ad.Simulation(ad.build_diagram(robot))
    seen = []
    for tick in range(1, 40):
        sim.topic("/model/cart/cmd_vel").publish({"linear": {"x": 0.5}})
        sim.advance_to(tick * sim.period)
        seen.append(sim.link_poses()[robot.description.base])
    sim.advance_to(40 * sim.period)

    (poses,) = sim.rollout().free_poses.values()

    for pose, X_WB in zip(poses[1:], seen, strict=True):
        np.testing.assert_array_equal(pose[:3], X_WB.translation())
        np.testing.assert_allclose(
            np.abs(pose[3:] @ X_WB.rotation().ToQuaternion().wxyz()), 1.0, atol=1e-12
        )
    assert poses[-1, 0] > poses[0, 0] + 1e-3


@pytest.mark.slow
def test_what_made_a_rollout_is_in_it() -> None:
    robot = ad.load_robot("doosan_a0912")
    options = ad.SimulationOptions(gravity=False)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))
    file = bundled_motions("doosan_a0912")["tutorial"]
    sim.run(0.1, ad.load_motion(file))

    info = sim.rollout().info

    assert info["versions"].keys() == {"arm_drake", "drake", "numpy", "python"}
    assert (info["world"], info["options"]["gravity"]) == ("void", False)
    digest = hashlib.sha256(robot.portable_source.encode()).hexdigest()
    assert info["robot"]["description"]["sha256"] == digest
    hashes = {row["file"]: row["sha256"] for row in info["robot"]["files"]}
    yaml = robot.controllers.files[0]
    assert hashes[yaml.name] == hashlib.sha256(yaml.read_bytes()).hexdigest()
    assert [motion["file"] for motion in info["motions"]] == [file.name]
    # No folder of this machine.
    assert str(file.parent) not in json.dumps(info)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a", "b"])
def test_of_several_robots_each_has_its_own(tmp_path: Path, name: str) -> None:
    robots = [ad.load_robot("doosan_a0912", name=n) for n in "ab"]
    sim = ad.Simulation(ad.build_diagram(robots))
    for each in "ab":
        sim.controller(f"{each}/joint_trajectory_controller").send_trajectory(
            ad.JointTrajectory()
        )
    sim.advance_to(0.05)

    rollout = sim.rollout(name)

    topic = f"/{name}/joint_trajectory_controller/joint_trajectory"
    assert [message.topic for message in rollout.messages] == [topic]
    assert rollout.robot_name == name


ARM = """
controller_manager:
  ros__parameters:
    update_rate: 200
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [{}]
    state_interfaces: [position, velocity]
    {}
"""


# By what is commanded: distribution and parameters, and the largest command at least;
# humble's open loop has velocities without a PID.
@pytest.mark.parametrize(
    ("interface", "distro", "parameters", "least"),
    [
        ("effort", "jazzy", "gains: {swing: {p: 60.0, d: 8.0}}", 1.0),
        ("velocity", "jazzy", "gains: {swing: {p: 5.0}}", 0.7),
        ("velocity", "humble", "open_loop_control: true", 0.9),
    ],
)
def test_what_is_wanted_is_recorded_also_of_who_commands_no_positions(
    tmp_path: Path, interface: str, distro: str, parameters: str, least: float
) -> None:
    controllers = ARM.format(interface, parameters)
    urdf = pendulum(control=ros2_control("swing", command=interface))
    robot = load(tmp_path, urdf, controllers, distro=distro)
    sim = ad.Simulation(ad.build_diagram(robot))
    points = [
        ad.JointTrajectoryPoint((angle,), time_from_start=end)
        for angle, end in ((0.0, 0.2), (0.6, 0.8))
    ]
    message = ad.JointTrajectory(joint_names=("swing",), points=points)
    sim.controller("arm").send_trajectory(message)
    seen = [np.nan]
    for tick in range(1, 101):
        # Between two ticks the state is that of the last one.
        sim.advance_to((tick - 0.5) * sim.period)
        seen.append(*sim.controller("arm").state().reference.positions)
    sim.advance_to(100 * sim.period)

    rollout = sim.rollout()

    reference = rollout.references["arm"]
    assert reference.joint_names == ("swing",)
    # A row has what the tick before it wanted.
    np.testing.assert_array_equal(reference.position[1:, 0], seen[1:100])
    # A line from 0 at 0.2 s to 0.6 rad at 0.8 s, told a tick later.
    row = rollout.time.searchsorted(0.4)
    assert reference.position[row, 0] == pytest.approx(0.2 - 1.0 / 200.0, abs=1e-9)
    error = rollout.tracking_error("arm")[1:, 0]
    assert 1e-3 < np.abs(error).max() < 0.3
    assert rollout.command_names == (f"swing/{interface}",)
    assert np.nanmax(np.abs(rollout.command)) > least


@pytest.mark.slow
@pytest.mark.parametrize("pose", [None, (0.3, -0.2, 0.5, 0.1, 0.2, 0.3)])
def test_links_are_where_drake_has_them(pose: tuple[float, ...] | None) -> None:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912", pose=pose)))
    target = ad.JointTrajectoryPoint((1.0, 0.5, 0.8, -0.5, 0.7, 2.0), time_from_start=1)
    names = [f"joint{k}" for k in range(1, 7)]
    goal = ad.JointTrajectory(joint_names=names, points=[target])
    sim.controller("joint_trajectory_controller").send_trajectory(goal)
    sim.advance_to(0.5)
    expected = sim.link_poses()
    sim.advance_to(0.55)

    rollout = sim.rollout()

    row = rollout.time.searchsorted(0.5 - 1e-9)
    for link, X_WL in expected.items():
        pose_of_link = rollout.link_poses(link)[row]
        # Sums and products of a dozen numbers of about 1.
        np.testing.assert_allclose(
            pose_of_link[:3], X_WL.translation(), rtol=0.0, atol=1e-13
        )
        cosine = abs(pose_of_link[3:] @ X_WL.rotation().ToQuaternion().wxyz())
        assert cosine == pytest.approx(1.0, abs=1e-13)


@pytest.mark.slow
def test_links_of_a_free_base_move_with_it(tmp_path: Path) -> None:
    sim = ad.Simulation(ad.build_diagram(load_cart(tmp_path, cart(diff_drive()))))
    for tick in range(50):
        sim.topic("/model/cart/cmd_vel").publish(
            {"linear": {"x": 0.5}, "angular": {"z": 1.0}}
        )
        sim.advance_to((tick + 1) * 0.01)
    expected = sim.link_poses()
    sim.advance_to(0.6)

    rollout = sim.rollout()

    row = rollout.time.searchsorted(0.5 - 1e-9)
    for link, X_WL in expected.items():
        found = rollout.link_poses(link)[row, :3]
        np.testing.assert_allclose(found, X_WL.translation(), rtol=0.0, atol=1e-13)


def test_an_unknown_link_names_the_known_ones() -> None:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
    sim.advance_to(0.02)

    with pytest.raises(InputError, match="no link 'nose' in the description; known: "):
        sim.rollout().link_poses("nose")


@pytest.mark.slow
def test_contact_forces_carry_the_weight(tmp_path: Path) -> None:
    robot = load_cart(tmp_path, cart(diff_drive()))
    options = ad.SimulationOptions(log_contacts=True)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    sim.advance_to(1.0)
    sim.rollout().save(tmp_path / "a.mcap")

    forces = ad.Rollout.load(tmp_path / "a.mcap").contact_forces

    assert forces.keys() == set(robot.description.links)
    rows = [len(force) for force in forces.values()]
    assert rows == [len(sim.rollout().time)] * len(rows)
    total = sum(force[-1] for force in forces.values())
    # The cart neither rises nor sinks: 6.2 kg. What is left of its settling is below
    # 1 mm/s^2. (It still trembles sideways, by less than a micrometre.)
    assert total[2] == pytest.approx(6.2 * 9.81, abs=6.2e-3)
    assert np.all(forces["base_link"] == 0.0)
    assert all(forces[f"{side}_wheel"][-1, 2] > 1.0 for side in ("left", "right"))


@pytest.mark.slow
def test_contact_forces_are_recorded_only_when_asked_for(tmp_path: Path) -> None:
    robot = load_cart(tmp_path, cart(diff_drive()))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.advance_to(0.05)

    assert sim.rollout().contact_forces == {}


def test_without_physics_there_are_no_contact_forces(tmp_path: Path) -> None:
    options = ad.SimulationOptions(preset="kinematic", log_contacts=True)
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm"), options=options))
    sim.advance_to(0.05)

    assert sim.rollout().contact_forces == {}
    (entry,) = (e for e in sim.report if e.where == "log_contacts")
    assert entry.done == "nothing touches anything without physics"
