"""Plans, judged by other means than those that made them."""

import base64
import gc
import itertools
import math
import os
import re
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.planning.collisions import CollisionModel, collision_model
from arm_drake.planning.surroundings import PlacedShape, find_standing
from arm_drake.planning.timing import motion_limits
from arm_drake.worlds.world import add_world

START = {"joint1": -1.0, "joint2": 0.9, "joint3": 0.8}
END = {"joint1": 1.0, "joint2": 0.9, "joint3": 0.8}


def with_a_post(plant: MultibodyPlant) -> None:
    """Add the ground, and a post in front of the robot."""
    add_world(plant, "empty")
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.7, 0.0, 0.4]),
        Box(0.2, 0.2, 0.8),
        "post",
        CoulombFriction(1.0, 1.0),
    )


@pytest.fixture(scope="module")
def doosan() -> ad.Robot:
    return ad.load_robot("doosan_a0912")


@pytest.fixture(scope="module")
def around(doosan: ad.Robot) -> ad.Plan:
    pytest.importorskip("ompl")
    return ad.plan(doosan, END, start=START, world=with_a_post)


def positions_of(plan: ad.Plan) -> np.ndarray:
    return np.array([point.positions for point in plan.trajectory.points])


def without_padding(robot: ad.Robot, plan: ad.Plan) -> CollisionModel:
    joints, initial = plan.trajectory.joint_names, robot.initial_positions
    return CollisionModel(robot, joints, with_a_post, padding=0.0, positions=initial)


@pytest.mark.slow
def test_the_straight_line_is_blocked_and_the_plan_is_free(
    doosan: ad.Robot, around: ad.Plan
) -> None:
    q = positions_of(around)
    model = without_padding(doosan, around)

    # Each 2 mrad, which is 3 mm at the hand.
    def is_free(x: np.ndarray, y: np.ndarray) -> bool:
        count = 2 + int(np.max(np.abs(y - x)) / 2e-3)
        return all(model.is_free(x + s * (y - x)) for s in np.linspace(0, 1, count))

    assert not is_free(q[0], q[-1])
    assert all(is_free(x, y) for x, y in itertools.pairwise(q))


def test_a_plan_is_told_in_a_line(around: ad.Plan) -> None:
    assert repr(around) == f"<Plan of {around.describe()}>"
    assert len(repr(around)) < 200
    assert f"{around.duration:.2f} s" in repr(around)
    assert around.clearance >= 0.005 - 1e-6


def test_a_plan_begins_and_ends_at_rest_where_it_should(around: ad.Plan) -> None:
    first, last = around.trajectory.points[0], around.trajectory.points[-1]
    names = around.trajectory.joint_names

    starts = dict(zip(names, first.positions, strict=True))
    assert {name: starts[name] for name in START} == START
    assert {name: around.end[name] for name in END} == pytest.approx(END)
    assert first.velocities == last.velocities == (0.0,) * 6
    assert around.controller == "joint_trajectory_controller"


def test_a_plan_keeps_the_limits_of_speed(doosan: ad.Robot, around: ad.Plan) -> None:
    limits = motion_limits(doosan)
    v_max = np.array([limits[n].velocity for n in around.trajectory.joint_names])
    a_max = np.array([limits[n].acceleration for n in around.trajectory.joint_names])
    points = around.trajectory.points

    v = np.array([point.velocities for point in points])
    a = np.array([point.accelerations for point in points])

    assert np.all(np.abs(v) <= v_max * (1 + 1e-9))
    assert np.all(np.abs(a) <= a_max * (1 + 1e-9))
    # They are those of the positions: between two points the mean velocity differs from
    # the mean of the ends by a quarter of what the acceleration can do, at most.
    t = np.array([point.time_from_start.to_seconds() for point in points])
    dt = np.diff(t)[:, np.newaxis]
    mean = np.diff(positions_of(around), axis=0) / dt
    assert np.all(np.abs(mean - 0.5 * (v[1:] + v[:-1])) <= a_max * dt / 4 + 1e-6)


def test_the_same_seed_gives_the_same_plan(doosan: ad.Robot, around: ad.Plan) -> None:
    again = ad.plan(doosan, END, start=START, world=with_a_post)

    assert again.trajectory == around.trajectory


def test_a_line_that_is_free_is_taken_at_its_limits(doosan: ad.Robot) -> None:
    to = {"joint1": 1.0}
    plan = ad.plan(doosan, to, start=START, world="void", velocity_scaling=0.5)

    # From rest to rest, one joint at most at its limits: a trapezoid of velocity.
    limits = motion_limits(doosan)["joint1"]
    velocity = 0.5 * limits.velocity
    ramp = velocity / limits.acceleration
    assert velocity * ramp < 2.0
    assert plan.duration == pytest.approx(2.0 / velocity + ramp, rel=0.05)
    assert len(plan.path) == 2


def test_a_slower_plan_takes_longer(doosan: ad.Robot) -> None:
    fast = ad.plan(doosan, {"joint1": 1.0}, world="void")
    slow = ad.plan(doosan, {"joint1": 1.0}, world="void", velocity_scaling=0.1)

    velocity = 0.1 * motion_limits(doosan)["joint1"].velocity
    assert slow.duration == pytest.approx(1.0 / velocity, rel=0.15)
    assert slow.duration > fast.duration


def test_a_pose_is_reached(doosan: ad.Robot) -> None:
    X = doosan.forward_kinematics({**END, "joint5": 0.5}, "link6")

    plan = ad.plan(doosan, X, start=START, world="void")

    assert doosan.forward_kinematics(plan.end, "link6").IsNearlyEqualTo(X, 1e-4)


def test_a_straight_line_is_straight(doosan: ad.Robot) -> None:
    start = {"joint2": 0.3, "joint3": 1.5, "joint5": 1.0}
    X = doosan.forward_kinematics(start, "link6")
    shift = np.array([0.1, 0.2, -0.15])
    goal = RigidTransform(X.rotation(), X.translation() + shift)

    plan = ad.plan(doosan, goal, start=start, world="void", straight=True)

    direction = shift / np.linalg.norm(shift)
    names = plan.trajectory.joint_names
    for point in plan.trajectory.points:
        at = doosan.forward_kinematics(
            dict(zip(names, point.positions, strict=True)), "link6"
        )
        away = at.translation() - X.translation()
        assert np.linalg.norm(away - direction * (away @ direction)) < 2e-4
        assert np.allclose(at.rotation().matrix(), X.rotation().matrix(), atol=2e-3)
    assert away == pytest.approx(shift, abs=1e-4)


def test_a_straight_line_out_of_reach_says_how_far_it_gets(doosan: ad.Robot) -> None:
    start = {"joint2": 0.3, "joint3": 1.5, "joint5": 1.0}
    X = doosan.forward_kinematics(start, "link6")
    goal = RigidTransform(X.rotation(), X.translation() + np.array([2.0, 0, 0]))

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(doosan, goal, start=start, world="void", straight=True)

    assert 0.05 < caught.value.fraction < 0.6
    assert "% of the straight line" in str(caught.value)


def test_way_points_are_passed(doosan: ad.Robot) -> None:
    middle = {"joint1": 0.5, "joint4": 1.0}

    plan = ad.plan(doosan, [middle, "home"], world="void")

    assert np.min(np.abs(positions_of(plan)[:, [0, 3]] - [0.5, 1.0]).sum(axis=1)) < 1e-9
    assert plan.end == pytest.approx(dict(doosan.initial_positions))


@pytest.mark.slow
def test_a_picture_has_all_joints_and_the_way_of_the_link(
    around: ad.Plan, tmp_path: Path
) -> None:
    picture = around.plot(tmp_path / "plan.png")

    way, position, velocity, acceleration = picture.axes
    q = positions_of(around)
    for column, line in enumerate(position.lines):
        assert line.get_label() == around.trajectory.joint_names[column]
        assert np.asarray(line.get_ydata()) == pytest.approx(q[:, column])
    for panel in (velocity, acceleration):
        assert max(np.abs(line.get_ydata()).max() for line in panel.lines) <= 100.0
    assert way.get_title(loc="left") == "way of link6"
    assert (tmp_path / "plan.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_plan_plays_on_a_page_with_what_it_goes_around(around: ad.Plan) -> None:
    page = around.animate().html

    sent = [base64.b64decode(b) for b in re.findall("base64,([A-Za-z0-9+/=]+)", page)]
    paths = {path for text in sent for path in re.findall(rb"visual/[\w/]+", text)}
    assert {b"visual/a0912/link6", b"visual/post_seen"} <= paths


INSIDE = {"joint1": 0.0, "joint2": 0.9, "joint3": 0.8}

BAD = [
    ({"to": INSIDE}, "the goal is in collision: 'link"),
    ({"to": END, "start": INSIDE}, "the start is in collision: 'link"),
    ({"to": {"joint1": 99.0}}, "goal: joint 'joint1' is at 99, out of its limits; "),
    ({"to": {"joint9": 0.0}}, "to: joint 'joint9' is not of group "),
    ({"to": {"joint1": math.nan}}, "to: joint 'joint1': expected a finite number"),
    ({"to": "hom"}, "group 'joint_trajectory_controller' has no state 'hom'; did you"),
    ({"to": []}, "to: expected a state, joint positions, a pose or a list"),
    ({"to": END, "frame": "lnk6"}, "no link 'lnk6'; did you mean 'link6'? known: "),
    ({"to": END, "group": "arms"}, "no planning group 'arms'; "),
    ({"to": [9.0, 0, 0, 0, 0, 0]}, "no joint positions put 'link6' there; "),
    ({"to": END, "velocity_scaling": 2.0}, "velocity_scaling: expected a number above"),
    ({"to": END, "padding": -1.0}, "padding: expected a distance of at least 0 m"),
    ({"to": END, "time_limit": 0.0}, "time_limit: expected a positive time [s]"),
    ({"to": END, "seed": -1}, "seed: expected an integer of at least 0, got -1"),
]


@pytest.mark.parametrize(("wrong", "message"), BAD)
def test_what_can_not_be_planned(doosan: ad.Robot, wrong: dict, message: str) -> None:
    with pytest.raises(ad.ArmDrakeError) as caught:
        ad.plan(doosan, **{"world": with_a_post, "start": START, **wrong})

    assert str(caught.value).startswith(message)


def test_no_way_in_time_is_an_error(doosan: ad.Robot) -> None:
    pytest.importorskip("ompl")

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(doosan, END, start=START, world=with_a_post, time_limit=1e-6)

    assert str(caught.value).startswith("no plan in time: RRT-Connect found no way")


def test_a_slow_clock_changes_nothing(
    doosan: ad.Robot, around: ad.Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    hours = itertools.count(0.0, 3600.0)
    monkeypatch.setattr(time, "monotonic", lambda: next(hours))

    plan = ad.plan(doosan, END, start=START, world=with_a_post)

    assert np.array_equal(positions_of(plan), positions_of(around))


@pytest.mark.slow
def test_a_search_ends_by_its_count_of_iterations(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ompl")
    asked = 0

    def is_inside_free(model: CollisionModel, *line: object) -> bool:
        nonlocal asked
        asked += 1
        return False

    monkeypatch.setattr(CollisionModel, "is_inside_free", is_inside_free)

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(doosan, END, start=START, world=with_a_post)

    assert str(caught.value) == (
        "no plan in 21000 iterations: RRT-Connect found no way from the start to the "
        "goal; a time_limit, to go on with it, or a smaller padding may help"
    )
    # Each iteration asks at least once, but for the sample that is in collision.
    assert 10_000 < asked < 100_000


def test_without_the_extra_it_is_named(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.delitem(sys.modules, "arm_drake.planning.search", raising=False)

    with pytest.raises(ad.ArmDrakeError) as caught:
        ad.plan(doosan, END, start=START, world=with_a_post)

    assert str(caught.value) == (
        "a plan around something needs `pip install 'arm-drake[planning]'`"
    )


@pytest.mark.slow
def test_every_built_in_world_can_be_planned_in(doosan: ad.Robot) -> None:
    for world in ("void", "empty", "house"):
        plan = ad.plan(doosan, {"joint1": 0.3}, world=world)

        assert plan.end["joint1"] == pytest.approx(0.3)


def test_things_of_a_world_are_named(doosan: ad.Robot) -> None:
    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(doosan, INSIDE, start=START, world=with_a_post)

    assert "'post'" in str(caught.value)


def test_a_solution_that_must_be_free_is(doosan: ad.Robot) -> None:
    X = doosan.forward_kinematics({"joint2": 0.4, "joint3": 1.9}, "link6")

    solution = doosan.solve_ik("link6", X, collision_free=True)

    joints = tuple(solution.positions)
    model = CollisionModel(
        doosan, joints, "void", padding=0.0, positions=solution.positions
    )
    assert model.is_free(np.array(list(solution.positions.values())))


def test_a_robot_without_shapes_is_planned_for_with_a_warning() -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial></link>'
        for name in ("base", "arm")
    )
    joint = (
        '<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="2"/></joint>'
    )
    robot = ad.load_robot(f'<robot name="bare">{links}{joint}</robot>')

    plan = ad.plan(robot, {"turn": 0.5})

    assert plan.end == {"turn": 0.5}
    assert plan.warnings == (
        "nothing that moves has a collision shape: whatever is there is passed",
    )


@pytest.mark.slow
def test_what_touches_at_the_start_is_reported_whatever_was_planned_before() -> None:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    box = '<geometry><box size="0.2 0.2 0.2"/></geometry>'
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial>'
        f"<collision>{box}</collision></link>"
        for name in ("top", "block")
    )
    limit = '<limit lower="-1" upper="1" effort="9" velocity="2"/>'
    joints = (
        '<joint name="turn" type="revolute"><parent link="base"/><child link="top"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
        '<joint name="slide" type="prismatic"><parent link="base"/>'
        f'<child link="block"/><axis xyz="1 0 0"/>{limit}</joint>'
    )
    text = f'<robot name="slider"><link name="base"/>{links}{joints}</robot>'
    plans = []
    for ways in ((0.0, 0.8), (0.8, 0.0)):
        robot = ad.load_robot(text, initial_positions={"slide": 0.8})
        made = {}
        for slide in ways:
            try:
                made[slide] = ad.plan(
                    robot,
                    {"turn": 0.5},
                    start={"slide": slide},
                    group=["turn"],
                    world="void",
                ).warnings
            except ad.PlanningError as error:
                made[slide] = str(error)
        plans.append(made)

    assert plans[0] == plans[1]
    assert plans[0][0.8] == ()
    assert "'block' and 'top' overlap" in plans[0][0.0]


@pytest.mark.parametrize(
    ("to", "options", "message"),
    [
        (None, {}, "to: expected a state, joint positions, a pose or a list"),
        (3.0, {}, "to: expected a state, joint positions, a pose or a list"),
        (
            {"joint1": "far"},
            {},
            "to: joint 'joint1': expected a finite number, got 'far'",
        ),
        (
            "home",
            {"start": {"joint1": None}},
            "joint 'joint1': expected a finite number [rad or m], got None",
        ),
        ("home", {"padding": None}, "padding: expected a number, got None"),
        ("home", {"time_limit": "long"}, "time_limit: expected a number, got 'long'"),
        (
            "home",
            {"velocity_scaling": "fast"},
            "velocity_scaling: expected a number, got 'fast'",
        ),
        ("home", {"group": 3}, "group: expected its name or its joints, got 3"),
        ("home", {"group": [3]}, "group: expected its name or its joints, got [3]"),
        ("home", {"start": [1]}, "start: expected joint positions by name, got [1]"),
        (
            "home",
            {"start": "home"},
            "start: expected joint positions by name, got 'home'",
        ),
        ("home", {"ignore": 5}, "ignore: expected names of bodies, got 5"),
        ("home", {"ignore": "box"}, "ignore: expected names of bodies, got 'box'"),
        ("home", {"ignore": [5]}, "ignore: expected names of bodies, got 5"),
        (
            "home",
            {"ignore": ["box"]},
            "ignore: bodies are those of a simulation; leave it out",
        ),
        ("home", {"should_stop": 3}, "should_stop: expected a function, got 3"),
        ("home", {"straight": "yes"}, "straight: expected True or False, got 'yes'"),
        (
            "home",
            {"mask": "abcdef"},
            "mask: expected six flags, for x, y, z and turns about x, y, z, with one "
            "that is set; got 'abcdef'",
        ),
        ({}, {}, "to: expected the position of a joint at least, got {}"),
        (["home", {}], {}, "to: expected the position of a joint at least, got {}"),
    ],
)
def test_what_is_of_another_kind_is_one_message(
    doosan: ad.Robot, to: object, options: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        ad.plan(doosan, to, **options)

    assert str(caught.value) == message


def test_what_is_no_robot_is_one_message() -> None:
    for wrong in ("doosan_a0912", None):
        with pytest.raises(InputError) as caught:
            ad.plan(wrong, "home")
        assert str(caught.value) == (
            "robot: expected a Robot, as load_robot returns it, or a Simulation, "
            f"got {wrong!r}"
        )


def test_numbers_of_numpy_are_goals(doosan: ad.Robot) -> None:
    to = {"joint1": np.float32(0.5), "joint2": np.int64(1)}

    plan = ad.plan(doosan, to, world="void", seed=np.int64(3), padding=np.float32(0))

    expected = ad.plan(doosan, {"joint1": 0.5, "joint2": 1}, world="void", padding=0)
    assert plan.trajectory == expected.trajectory


@pytest.mark.slow
def test_a_glass_is_kept_upright_on_the_way_around_a_post(doosan: ad.Robot) -> None:
    pin = pytest.importorskip("pinocchio")
    pytest.importorskip("ompl")
    start = doosan.solve_ik("link6", [0.3, -0.5, 0.5, math.pi, 0.0, 0.0]).positions
    X_WG = [0.3, 0.5, 0.5, math.pi, 0.0, 1.0]
    end = doosan.solve_ik("link6", X_WG, seed=start).positions
    most = math.radians(5.0)

    plan = ad.plan(
        doosan,
        end,
        start=start,
        world=with_a_post,
        path_constraint=ad.OrientationConstraint("link6", most),
    )

    model = pin.buildModelFromXML(doosan.description.source)
    data, frame = model.createData(), model.getFrameId("link6")
    way = positions_of(plan)
    tilts = []
    for x, y in itertools.pairwise(way):
        for part in (0.0, 0.25, 0.5, 0.75):
            pin.framesForwardKinematics(model, data, x + part * (y - x))
            down = -data.oMf[frame].rotation[2, 2]
            tilts.append(math.acos(min(down, 1.0)))
    # It isn't upright by chance, and leaves the cone by 1 mrad at most.
    assert 1e-3 < max(tilts) <= most + 1e-3
    without = without_padding(doosan, plan)
    assert without.first_collision(way) is None
    assert without.first_collision(way[[0, -1]]) is not None


def test_a_position_is_reached_as_upright_as_the_constraint_wants(
    doosan: ad.Robot,
) -> None:
    start = doosan.solve_ik("link6", [0.4, -0.3, 0.5, math.pi, 0.0, 0.0]).positions

    plan = ad.plan(
        doosan,
        [0.4, -0.1, 0.6, 0.0, 0.0, 0.0],
        mask=(True,) * 3 + (False,) * 3,
        start=start,
        world="void",
        path_constraint=ad.OrientationConstraint("link6", 0.2),
    )

    X = doosan.forward_kinematics(plan.end, "link6")
    assert X.translation() == pytest.approx([0.4, -0.1, 0.6], abs=1e-4)
    assert math.acos(-X.rotation().matrix()[2, 2]) <= 0.2 + 1e-6


@pytest.mark.parametrize("straight", [False, True])
def test_a_goal_that_tilts_too_much_is_an_error(
    doosan: ad.Robot, straight: bool
) -> None:
    start = {"joint2": 0.3, "joint3": 1.5, "joint5": 1.0}
    X = doosan.forward_kinematics({**start, "joint5": 1.3}, "link6")

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(
            doosan,
            X,
            start=start,
            world="void",
            straight=straight,
            path_constraint=ad.OrientationConstraint("link6", 0.1),
        )

    assert "'link6' tilts by " in str(caught.value)
    assert "rad; the path constraint allows 0.1" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3, 0.1), "link_name: expected a name, got 3"),
        (
            ("link6", 0.0),
            "tolerance: expected an angle from 0.002 to pi [rad], got 0.0",
        ),
        (("link6", 0.1, (0, 0, 0)), "axis: expected x, y, z, not all 0; got (0, 0, 0)"),
        (("link6", 0.1, None, 3), "direction: expected x, y, z, not all 0; got 3"),
    ],
)
def test_a_constraint_that_can_not_be(arguments: tuple, message: str) -> None:
    with pytest.raises(InputError) as caught:
        ad.OrientationConstraint(*arguments)

    assert str(caught.value) == message


def test_ctrl_c_ends_a_search(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ompl")
    told: list[float] = []

    def interrupt() -> None:
        told.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    def is_inside_free(model: CollisionModel, *line: object) -> bool:
        return False  # A search without an end.

    monkeypatch.setattr(CollisionModel, "is_inside_free", is_inside_free)
    timer = threading.Timer(0.5, interrupt)
    timer.start()

    with pytest.raises(KeyboardInterrupt):
        ad.plan(doosan, END, start=START, world=with_a_post, time_limit=60.0)

    timer.join()
    assert time.process_time() - told[0] < 0.5


def with_many_boxes(plant: MultibodyPlant) -> None:
    """Add the ground, boxes within reach, and boxes that are far away."""
    add_world(plant, "empty")
    rng, friction = np.random.default_rng(3), CoulombFriction(1.0, 1.0)
    for index in range(12):
        away = 0.0 if index < 9 else 20.0
        place = RigidTransform(rng.uniform(-1.0, 1.0, 3) + np.array([away, 0.0, 0.9]))
        body = plant.world_body()
        shape, name = Box(0.3, 0.2, 0.1), f"box_{index}"
        plant.RegisterCollisionGeometry(body, place, shape, name, friction)


@pytest.mark.slow
def test_many_shapes_are_checked_in_parts(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    joints = tuple(doosan.initial_positions)
    ball = [PlacedShape("ball", Sphere(0.15), RigidTransform([0, 0, 0.2]), "link6")]

    def make() -> CollisionModel:
        initial = doosan.initial_positions
        made = CollisionModel(
            doosan, joints, with_many_boxes, padding=0.005, positions=initial
        )
        made.set_things(ball)
        return made

    whole = make()
    monkeypatch.setattr("arm_drake.planning.surroundings._MOST_SHAPES", 2)
    parted = make()

    # Drake's checker of all shapes at once is the judge.
    qs = np.random.default_rng(4).uniform(-2.0, 2.0, (60, len(joints)))
    free = [whole.is_free(q) for q in qs]
    assert 5 < sum(free) < 55
    assert [parted.is_free(q) for q in qs] == free
    assert [parted.describe(q) for q in qs] == [whole.describe(q) for q in qs]
    way = qs[free]
    assert parted.first_collision(way) == whole.first_collision(way)
    for q in way:
        near = whole.clearance([q], 0.3)
        assert parted.clearance([q], 0.3) == pytest.approx(near, abs=1e-9)
    for x, y in itertools.pairwise(way):
        assert parted.is_edge_free(x, y, 0.1) == whole.is_edge_free(x, y, 0.1)
    # What is out of reach costs nothing.
    assert parted.count_around < whole.count_around == 13


def test_configurations_are_free_where_drake_finds_them_so(doosan: ad.Robot) -> None:
    initial = doosan.initial_positions
    names = tuple(initial)
    model = CollisionModel(
        doosan, names, with_many_boxes, padding=0.02, positions=initial
    )

    qs = np.random.default_rng(5).uniform(-2.0, 2.0, (300, len(names)))
    configurations = [model.configuration(q) for q in qs]

    free = list(map(model.checker.CheckConfigCollisionFree, configurations))
    assert [model.is_free(q) for q in qs] == free
    # Some are apart, but nearer than the padding.
    clearances = [model.clearance([q], 0.3) for q in qs]
    assert any(0.0 < clearance < 0.02 for clearance in clearances)
    assert 50 < sum(free) < 250


def test_worlds_that_were_looked_at_are_no_longer_in_memory() -> None:
    def plants() -> dict[int, object]:
        gc.collect()
        found = gc.get_objects()
        return {id(o): o for o in found if issubclass(type(o), MultibodyPlant)}

    find_standing("house")  # The plant that its SDF was read with is kept with it.
    before = plants()  # It keeps them, so that no other one has their numbers.
    assert len(find_standing("house")) > 256  # Of so many some are written down.
    assert plants().keys() <= before.keys()


def test_parts_that_are_all_far_away_leave_plans_as_they_are(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def with_far_boxes(plant: MultibodyPlant) -> None:
        with_a_post(plant)
        for index in range(2):
            place, body = RigidTransform([20.0 + index, 0, 0.5]), plant.world_body()
            friction, name = CoulombFriction(1.0, 1.0), f"far_{index}"
            shape = Box(0.3, 0.2, 0.1)
            plant.RegisterCollisionGeometry(body, place, shape, name, friction)

    monkeypatch.setattr("arm_drake.planning.surroundings._MOST_SHAPES", 2)

    plans = [
        ad.plan(doosan, {"joint1": 0.1}, world=world)
        for world in (with_far_boxes, with_a_post)
    ]

    assert plans[0].trajectory == plans[1].trajectory
    assert plans[0].clearance == pytest.approx(plans[1].clearance, abs=1e-9)


def test_very_many_shapes_are_reported_of(
    doosan: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arm_drake.planning.motion_planning._MANY", 1)

    plan = ad.plan(doosan, {"joint1": 0.1}, world=with_a_post)

    assert plan.warnings == (
        "2 collision shapes of the world are within reach: what a plan takes grows "
        "with their number",
    )


# A table that turns 3 mm above the ground, and an arm on it.
TURNTABLE = """
<robot name="turntable">
  <link name="base"/>
  <link name="table">
    <inertial><mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.053"/>
      <geometry><box size="0.3 0.3 0.1"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.3 0 0"/>
      <geometry><box size="0.4 0.04 0.04"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="100" velocity="2"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="table"/><child link="arm"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.2"/>
    <limit lower="-1.5" upper="0.5" effort="100" velocity="2"/>
  </joint>
</robot>
"""


def test_what_is_always_closer_to_the_world_has_no_padding(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(TURNTABLE)
    robot = ad.load_robot(tmp_path / "robot.urdf")

    plan = ad.plan(robot, {"turn": 1.0})
    with pytest.raises(ad.PlanningError) as low:
        ad.plan(robot, {"lift": 0.3645})
    sunk = ad.load_robot(tmp_path / "robot.urdf", pose=(0, 0, -0.004, 0, 0, 0))
    with pytest.raises(ad.PlanningError) as below:
        ad.plan(sunk, {"turn": 1.0})

    assert plan.clearance == pytest.approx(3e-3, abs=1e-6)
    assert plan.warnings == (
        "'table' is always closer to the world than the padding: it has none",
    )
    # What may be farther away keeps its own, and nothing may overlap.
    assert str(low.value).startswith(
        "the goal is in collision: 'arm' and 'ground' are "
    )
    assert str(below.value) == (
        "the start is in collision: 'ground' and 'table' overlap by 1 mm"
    )


def test_padding_is_back_for_the_next_plan(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(TURNTABLE)
    robot = ad.load_robot(tmp_path / "robot.urdf")
    around = {"padding": 0.005, "positions": robot.initial_positions}

    models = []
    for _ in range(2):
        models.append(collision_model(robot, ("turn", "lift"), "empty", **around))
        assert not models[-1].is_free(np.zeros(2))
        assert models[-1].is_free_somehow(np.zeros(2))
        assert models[-1].is_free(np.zeros(2))

    assert models[0] is models[1]
