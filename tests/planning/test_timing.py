"""Limits of jerk, held against derivatives of what a controller would play."""

import math
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform
from scipy.interpolate import BPoly

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.planning.timing import motion_limits
from tests.planning.test_motion_planning import END, START, with_a_post
from tests.robots import load_real_robot

JERK, ACCELERATION = 20.0, 4.0


def with_jerk_limits(
    name: str,
    folder: Path,
    jerk: float = JERK,
    joints: Collection[str] = (),
    acceleration: float = ACCELERATION,
) -> ad.Robot:
    """Load a robot with a MoveIt config package that limits jerk, of all or some."""
    description = ad.load_robot(name).description
    (folder / "robot.srdf").write_text(f'<robot name="{description.name}"/>')
    row = f"has_acceleration_limits: true, max_acceleration: {acceleration}"
    limited = f", has_jerk_limits: true, max_jerk: {jerk}"
    rows = []
    for joint in description.movable_joints:
        is_limited = not joints or joint.name in joints
        rows.append(f"  {joint.name}: {{{row}{limited if is_limited else ''}}}\n")
    (folder / "joint_limits.yaml").write_text("joint_limits:\n" + "".join(rows))
    return ad.load_robot(name, srdf=[folder / "robot.srdf"])


def jerks_of(plan: ad.Plan) -> tuple[float, float]:
    """Return the largest jerk of positions, by differences, and of quintics."""
    points = plan.trajectory.points
    t = np.array([point.time_from_start.to_seconds() for point in points])
    q = np.array([point.positions for point in points])
    v = np.array([point.velocities for point in points])
    a = np.array([point.accelerations for point in points])
    differences = np.diff(q, n=3, axis=0) / (t[1] - t[0]) ** 3
    played = BPoly.from_derivatives(t, np.stack([q, v, a], axis=1))
    third = played.derivative(3)(np.linspace(0.0, t[-1], 20_000))
    return float(np.abs(differences).max()), float(np.abs(third).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["doosan_a0912", "mycobot_280"])
def test_a_line_takes_as_long_as_its_jerk_needs(name: str, tmp_path: Path) -> None:
    robot = with_jerk_limits(name, tmp_path)
    group = next(iter(ad.planning_groups(robot).values()))
    joint = group.joints[0]

    plan = ad.plan(robot, {joint: 0.7}, world="void")

    differences, played = jerks_of(plan)
    assert max(differences, played) <= JERK
    assert played >= 0.5 * JERK
    # From rest to rest within both limits it takes so long, where speed is no limit.
    ramp = ACCELERATION / JERK
    fastest = ramp + math.sqrt(ramp**2 + 4.0 * 0.7 / ACCELERATION)
    assert fastest <= plan.duration <= 1.25 * fastest


@pytest.mark.slow
def test_a_way_around_a_post_keeps_limits_of_jerk(tmp_path: Path) -> None:
    pytest.importorskip("ompl")
    robot = with_jerk_limits("doosan_a0912", tmp_path)

    plan = ad.plan(robot, END, start=START, world=with_a_post)

    differences, played = jerks_of(plan)
    assert max(differences, played) <= JERK
    assert played >= 0.5 * JERK
    assert plan.clearance >= 0.005 - 1e-6
    assert {name: plan.end[name] for name in END} == pytest.approx(END)
    accelerations = [point.accelerations for point in plan.trajectory.points]
    assert np.max(np.abs(accelerations)) <= ACCELERATION
    assert np.abs(accelerations)[[0, -1]] == pytest.approx(0.0, abs=1e-12)


# The fastest way from rest to rest over 0.7 rad within a jerk of 5 rad/s^3, if neither
# speed nor acceleration were limited: four equal parts of it.
FASTEST = 4.0 * (0.7 / (2.0 * 5.0)) ** (1.0 / 3.0)


@pytest.mark.slow
@pytest.mark.parametrize("acceleration", [4.0, 16.0])
def test_more_acceleration_than_jerk_allows_to_use_makes_no_plan_slower(
    tmp_path: Path, acceleration: float
) -> None:
    robot = with_jerk_limits("doosan_a0912", tmp_path, 5.0, acceleration=acceleration)

    plan = ad.plan(robot, {"joint1": 0.7}, world="void")

    assert FASTEST <= plan.duration <= 1.25 * FASTEST


@pytest.mark.slow
@pytest.mark.parametrize(("jerk", "acceleration"), [(JERK, ACCELERATION), (5.0, 16.0)])
def test_a_straight_line_with_limits_of_jerk_is_straight(
    tmp_path: Path, jerk: float, acceleration: float
) -> None:
    robot = with_jerk_limits("doosan_a0912", tmp_path, jerk, acceleration=acceleration)
    start = {"joint2": 0.3, "joint3": 1.5, "joint5": 1.0}
    X = robot.forward_kinematics(start, "link6")
    shift = np.array([0.1, 0.2, -0.15])
    goal = RigidTransform(X.rotation(), X.translation() + shift)

    plan = ad.plan(robot, goal, start=start, world="void", straight=True)

    assert max(jerks_of(plan)) <= jerk
    for point in plan.trajectory.points:
        positions = dict(zip(plan.trajectory.joint_names, point.positions, strict=True))
        at = robot.forward_kinematics(positions, "link6")
        away = at.translation() - X.translation()
        assert np.linalg.norm(np.cross(away, shift)) / np.linalg.norm(shift) < 2e-4
    assert away == pytest.approx(shift, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("jerk", "joints"),
    [(1e5, ()), (7500.0, ()), (JERK, ("joint2",))],  # The last one doesn't move.
)
def test_limits_of_acceleration_are_kept_where_jerk_is_hardly_limited(
    tmp_path: Path, jerk: float, joints: tuple[str, ...]
) -> None:
    robot = with_jerk_limits("doosan_a0912", tmp_path, jerk, joints)

    plan = ad.plan(robot, {"joint1": 0.7}, world="void")

    points = plan.trajectory.points
    t = np.array([point.time_from_start.to_seconds() for point in points])
    rows = [[p.positions, p.velocities, p.accelerations] for p in points]
    played = BPoly.from_derivatives(t, np.array(rows)).derivative(2)
    largest = np.abs(played(np.linspace(0.0, t[-1], 20_000))).max()
    assert 0.9 * ACCELERATION < largest <= 1.02 * ACCELERATION


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e-8, 1e-6, 1e-4, 2e-4])
def test_a_goal_next_to_the_start_is_a_plan(distance: float) -> None:
    robot = ad.load_robot("doosan_a0912")

    plan = ad.plan(robot, {"joint1": distance}, world="void")

    assert plan.end["joint1"] == pytest.approx(distance, abs=1e-12)
    assert plan.duration < 0.1


# A turntable: its inertia [kg·m^2], effort [N·m], damping [N·m·s/rad], friction [N·m].
INERTIA, EFFORT, DAMPING, FRICTION = 0.5, 10.0, 4.0, 1.0


@pytest.mark.parametrize("jerk", [None, 100.0])
def test_what_damping_and_friction_take_is_left_to_them(
    tmp_path: Path, jerk: float | None
) -> None:
    moment = f'ixx="1" iyy="1" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"'
    body = f'<inertial><mass value="2"/><inertia {moment}/></inertial>'
    (tmp_path / "turntable.urdf").write_text(
        f'<robot name="turntable"><link name="base"/><link name="top">{body}</link>'
        '<joint name="turn" type="revolute"><parent link="base"/><child link="top"/>'
        f'<axis xyz="0 0 1"/><limit lower="-4" upper="4" effort="{EFFORT}" '
        f'velocity="5"/><dynamics damping="{DAMPING}" friction="{FRICTION}"/></joint>'
        "</robot>"
    )
    (tmp_path / "turntable.srdf").write_text('<robot name="turntable"/>')
    limits = "has_acceleration_limits: true, max_acceleration: 5"
    if jerk is not None:
        limits += f", has_jerk_limits: true, max_jerk: {jerk}"
    (tmp_path / "joint_limits.yaml").write_text(f"joint_limits: {{turn: {{{limits}}}}}")
    robot = ad.load_robot(
        tmp_path / "turntable.urdf", srdf=[tmp_path / "turntable.srdf"]
    )

    plan = ad.plan(robot, {"turn": 3.0}, start={"turn": -3.0}, world="void")

    points = plan.trajectory.points
    v = np.array([point.velocities[0] for point in points])
    a = np.array([point.accelerations[0] for point in points])
    efforts = INERTIA * a + DAMPING * v + FRICTION * np.sign(v)
    assert np.abs(efforts).max() <= EFFORT * (1.0 + 1e-9)
    # It is no slower than it has to be, by much.
    assert v.max() >= 0.7 * (EFFORT - FRICTION) / DAMPING
    assert "effort" not in " ".join(plan.warnings)


@pytest.mark.slow
def test_joints_that_damping_slows_down_follow_their_plan() -> None:
    start = {"joint4": -2.5, "joint6": 2.5}
    robot = ad.load_robot("doosan_a0912", initial_positions=start)
    goal = {"joint4": 2.5, "joint6": -2.5}
    plan = ad.plan(robot, goal, start=start, world="void")
    simulation = ad.Simulation(ad.build_diagram(robot, world="void"))

    simulation.send_planned(plan)
    simulation.run(plan.duration + 0.5)

    assert plan.controller is not None
    behind = np.abs(simulation.rollout().tracking_error(plan.controller)).max()
    # A drive of bandwidth w is behind an acceleration a by a / w^2.
    largest = np.max(np.abs([point.accelerations for point in plan.trajectory.points]))
    assert behind <= 1.1 * largest / 40.0**2


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.0, 2.0, 3.9, 3.999, 4.0, 4.001, 8.0])
@pytest.mark.parametrize("friction", [0.0, 5.0])
def test_a_weight_that_is_nearly_too_much_makes_no_plan_endless(
    tmp_path: Path, mass: float, friction: float
) -> None:
    # At 4 kg the effort just holds it, level.
    effort = 4.0 * 9.81 + 5.0
    inertial = '<inertial><mass value="0.001"/><inertia ixx="0.01" iyy="0.01" '
    inertial += 'izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "lift.urdf").write_text(
        f'<robot name="lift"><link name="base"/><link name="arm">{inertial}</link>'
        '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>'
        f'<axis xyz="0 -1 0"/><limit lower="-2" upper="2" effort="{effort}" '
        f'velocity="3"/><dynamics damping="1" friction="{friction}"/></joint></robot>'
    )
    robot = ad.load_robot(tmp_path / "lift.urdf")
    payloads = {"arm": ad.Payload(mass, com=(1.0, 0.0, 0.0))}

    plan = ad.plan(
        robot, {"turn": 1.0}, start={"turn": -1.0}, world="void", attached=payloads
    )

    # A tenth of its speed, and of what is slowed down for efforts then, at worst.
    assert plan.duration < 30.0
    warns = "effort" in " ".join(plan.warnings)
    left = effort - friction - mass * 9.81
    assert warns if left <= 0.0 else (not warns or left < 0.1)


@pytest.mark.slow
def test_damping_leaves_the_scaling_of_velocities_its_say() -> None:
    start = {"joint4": 0.0}
    robot = ad.load_robot("doosan_a0912", initial_positions=start)

    plans = [
        ad.plan(robot, {"joint4": 3.0}, world="void", velocity_scaling=scaling)
        for scaling in (1.0, 0.5)
    ]

    fastest = [
        max(point.velocities[3] for point in plan.trajectory.points) for plan in plans
    ]
    assert fastest[1] == pytest.approx(0.5 * fastest[0], rel=0.05)


def test_what_is_attached_is_by_link() -> None:
    robot = ad.load_robot("doosan_a0912")

    with pytest.raises(InputError, match="attached: expected what is held by the link"):
        ad.plan(robot, {"joint1": 0.1}, attached=None)


@pytest.mark.slow
def test_a_line_whose_joints_turn_sharply_has_times() -> None:
    # Toppra finds none at the places along it that are taken first.
    robot = load_real_robot("dobot_cr5")
    ends = [[0.315, y, 0.35, 3.14, 0.0, 0.0] for y in (-0.36, 0.36)]
    start = robot.solve_ik("Link6", ends[0], collision_free=True).positions

    plan = ad.plan(robot, ends[1], start=start, straight=True)

    X = robot.forward_kinematics(plan.end, "Link6")
    assert X.translation() == pytest.approx(ends[1][:3], abs=1e-4)
    limits = motion_limits(robot)
    for point in plan.trajectory.points:
        for name, v, a in zip(
            plan.group.joints, point.velocities, point.accelerations, strict=True
        ):
            assert abs(v) <= limits[name].velocity * (1.0 + 1e-9)
            assert abs(a) <= limits[name].acceleration * (1.0 + 1e-9)
