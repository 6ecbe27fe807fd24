"""Picking and placing: where things are afterwards says whether it worked."""

import dataclasses as dc
import functools
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Convex,
    Sphere,
    SurfaceTriangle,
    TriangleSurfaceMesh,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from scipy.spatial import KDTree

import arm_drake as ad
from arm_drake.errors import MotionError
from arm_drake.manipulation import hand, pick_and_place
from arm_drake.manipulation.activities import (
    Activity,
    Failure,
    find_drive,
    perform,
)
from arm_drake.manipulation.hand import Hand, PickOptions
from arm_drake.manipulation.pick_and_place import placing
from arm_drake.planning.grasps import find_grasps
from arm_drake.planning.grippers import find_gripper, spread, thin
from arm_drake.planning.groups import find_group
from arm_drake.planning.setting import PlanningError
from arm_drake.simulation.motion_files import parse_motion
from arm_drake.simulation.recording import list_failures
from arm_drake.worlds.things import with_things
from arm_drake.worlds.world import add_world, load_world
from tests.robots import load_real_robot
from tests.snippets import ROOT, read_blocks

# All of them simulate seconds.
pytestmark = pytest.mark.slow

# The myCobot's plate is 25 mm below its origin.
POSE = (0.0, 0.0, 0.026, 0.0, 0.0, 0.0)

BOX = ad.Thing("box", "box", (0.025, 0.025, 0.04), mass=0.02)


# A box is held as well in steps five times the default ones [s], which take half of the
# time or less. What defaults do is shown by the page's program and by a notebook.
COARSE = ad.SimulationOptions(time_step=5e-3)

# Things of other shapes roll in such steps; slippery ones slip in the default alone.
MEDIUM = ad.SimulationOptions(time_step=2e-3)


def simulate(
    *things: ad.Thing, options: ad.SimulationOptions | None = None
) -> ad.Simulation:
    """Return a simulation of the myCobot with things on the ground."""

    def add_things(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        for thing in things:
            thing.add_to(plant)

    return simulate_with(add_things, options)


def simulate_with(
    add_things: Callable[[MultibodyPlant], None],
    options: ad.SimulationOptions | None = None,
) -> ad.Simulation:
    """Return a simulation of the myCobot in a world."""
    diagram = ad.build_diagram(load_mycobot(), world=add_things, options=options)
    return ad.Simulation(diagram)


@functools.cache
def load_mycobot() -> ad.Robot:
    """Return the robot, whose gripper is measured once."""
    return ad.load_robot(
        "mycobot_280", xacro_args={"control": "ros2_control"}, pose=POSE
    )


def at(thing: ad.Thing, x: float, y: float, yaw: float = 0.0) -> ad.Thing:
    """Return a thing that stands on the ground somewhere."""
    height = thing.size[-1] if thing.kind != "sphere" else 2.0 * thing.size[0]
    pose = (x, y, 0.5 * height, 0.0, 0.0, yaw)
    return ad.Thing(thing.name, thing.kind, thing.size, mass=thing.mass, pose=pose)


def pose_of(simulation: ad.Simulation, name: str) -> RigidTransform:
    plant = simulation.plant
    context = plant.GetMyContextFromRoot(simulation.context)
    body = plant.GetBodyByName(name)
    return RigidTransform(plant.EvalBodyPoseInWorld(context, body))


@pytest.mark.slow
def test_a_box_is_lifted_and_put_where_it_should_be() -> None:
    simulation = simulate(at(BOX, 0.2, 0.05, 0.4), options=COARSE)
    goal = RigidTransform(RollPitchYaw(0.0, 0.0, 0.9), [0.15, -0.15, 0.02])

    picked = ad.pick(simulation, "box")
    height = pose_of(simulation, "box").translation()[2]
    held = ad.held_thing(simulation)
    placed = ad.place(simulation, goal)

    assert picked, picked.reason
    assert height == pytest.approx(0.02 + 0.05, abs=2e-3)
    assert held == "box"
    assert placed, placed.reason
    miss = goal.inverse() @ pose_of(simulation, "box")
    assert np.linalg.norm(miss.translation()) < 5e-3
    assert miss.rotation().ToAngleAxis().angle() < np.deg2rad(3.0)
    assert placed.position_error == pytest.approx(np.linalg.norm(miss.translation()))
    assert ad.held_thing(simulation) is None


# Robots with grippers of other kinds: two fingers of an arm of four joints, and one
# finger of an arm of five.
OTHERS = {
    "open_manipulator_x": ((0.2, 0.0), (0.16, 0.08)),
    "so100_brukg": ((0.0, -0.25), (0.1, -0.2)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_other_arms_do_so_too(name: str) -> None:
    start, goal = OTHERS[name]
    robot = load_real_robot(name)
    # A manager of 1 kHz would have the physics take steps of 1 ms.
    rate = min(robot.controllers.update_rate, 250)
    robot = dc.replace(
        robot, controllers=dc.replace(robot.controllers, update_rate=rate)
    )
    world = with_things(load_world("empty"), [at(BOX, *start)])
    diagram = ad.build_diagram(robot, world=world, options=MEDIUM)
    simulation = ad.Simulation(diagram)
    simulation.advance_to(0.1)

    picked = ad.pick(simulation, "box", goal=(*goal, 0.02))
    placed = ad.place(simulation, (*goal, 0.02))

    assert picked, picked.reason
    assert placed, placed.reason
    X = pose_of(simulation, "box")
    assert X.translation() == pytest.approx([*goal, 0.02], abs=5e-3)
    # A gripper that stalls on a thing may tell that its goal was aborted.
    assert list_failures(simulation.mailbox) == []


def test_ways_begin_where_a_base_has_gone_to() -> None:
    robot = load_real_robot("so100_brukg")
    start = dict.fromkeys(find_group(robot, None).joints, 0.3)
    everything = {**robot.initial_positions, **start}
    robot = dc.replace(robot, has_free_base=True, initial_positions=everything)
    simulation = ad.Simulation(ad.build_diagram(robot))
    plant, base = simulation.plant, robot.description.base
    context = plant.GetMyContextFromRoot(simulation.context)
    body = plant.GetBodyByName(base)
    X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, 1.0), [0.5, -0.3, 0.2])
    plant.SetFloatingBaseBodyPoseInWorldFrame(context, body, X_WB)
    arm = Hand(simulation, PickOptions())

    nearest, *_ = arm.solve(arm.palm())

    assert nearest == pytest.approx(start, abs=1e-3)
    assert find_gripper(robot) is arm.gripper  # It is measured once.


def test_what_takes_efforts_is_not_sent_positions() -> None:
    robot = ad.load_robot("mycobot_280", xacro_args={"control": "ros2_control"})
    _, arm, _ = robot.controllers.controllers
    joints = arm.parameters["joints"]
    efforts = dc.replace(
        arm,
        name="efforts",
        type="forward_command_controller/ForwardCommandController",
        parameters={
            "joints": joints,
            "interface_name": dc.replace(joints, value="effort"),
        },
    )

    def find(*controllers: Any) -> Any:
        robot = SimpleNamespace(controllers=SimpleNamespace(controllers=controllers))
        simulation = SimpleNamespace(list_controllers=list)
        return find_drive(simulation, robot, "", joints.value)

    assert find(efforts, arm).controller == "arm_controller"
    with pytest.raises(ad.ArmDrakeError, match=r"there are 'efforts'"):
        find(efforts)


def test_fingers_that_never_rest_are_a_failure() -> None:
    simulation = SimpleNamespace(time=0.0)
    simulation.advance_to = lambda until: setattr(simulation, "time", until)
    gripper = SimpleNamespace(
        open={"f": 0.0}, closed={"f": 1.0}, positions=lambda closed: {"f": closed}
    )
    arm: Any = SimpleNamespace(
        simulation=simulation,
        gripper=gripper,
        _positions=lambda: {"f": 0.5 + 0.1 * math.sin(20.0 * simulation.time)},
        _fingers=SimpleNamespace(lead=lambda *_: iter(())),
    )

    with pytest.raises(Failure, match="neither arrive nor stall"):
        perform(simulation, Hand.move_gripper(arm, 1.0, "close"))

    assert 5.0 < simulation.time < 10.0


@pytest.mark.parametrize(
    # The tall one would reach into the palm.
    "shape",
    [Box(0.025, 0.025, 0.3), Sphere(0.018)],
    ids=["box", "ball"],
)
def test_no_grasp_has_the_gripper_in_the_thing_or_below_it(shape: Box | Sphere) -> None:
    gripper = find_gripper(load_mycobot())
    half = shape.size()[2] / 2.0 if isinstance(shape, Box) else shape.radius()
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, 0.4), [0.2, 0.05, half])

    # Every eighth, for around a ball there are hundreds.
    grasps = find_grasps(gripper, shape, X_WO)[::8]

    assert len(grasps) >= 4
    gaps = []
    for grasp in grasps:
        points = grasp.X_OP.multiply(gripper.points(grasp.pre_grasp).T).T
        if isinstance(shape, Box):
            depth = (0.5 * shape.size() - np.abs(points)).min(axis=1)
        else:
            depth = shape.radius() - np.linalg.norm(points, axis=1)
        assert depth.max() < 5e-4 + 1e-9
        gaps.append(X_WO.multiply(points.T)[2].min())
    # Some are as low as they may be, but for what the fingers sweep on an arc.
    assert min(gaps) > 2e-3 - 1e-9
    assert isinstance(shape, Box) or min(gaps) < 3e-3


@pytest.mark.parametrize("closed", [0.0, 0.7])
def test_points_of_a_gripper_are_close_to_each_other_and_bound_it(
    closed: float,
) -> None:
    gripper = find_gripper(load_mycobot())
    links = dict.fromkeys([gripper.palm, *gripper.fingers[0], *gripper.fingers[1]])
    surface = gripper.shapes.at(links, gripper.palm, gripper.positions(closed))

    points = gripper.points(closed)

    assert len(points) < 0.8 * len(surface)
    distances, _ = KDTree(points).query(surface)
    # The diagonal of a cube of a millimetre.
    assert distances.max() < math.sqrt(3.0) * 1e-3
    directions = np.random.default_rng(1).normal(size=(3, 200))
    bounds = (surface @ directions).max(axis=0)
    np.testing.assert_allclose((points @ directions).max(axis=0), bounds, atol=1e-9)


@pytest.mark.parametrize(("size", "count"), [(1e-4, 1), (1.0, 8), (1e5, 8)])
def test_few_points_are_of_things_of_any_size(size: float, count: int) -> None:
    corners = size * np.array(list(itertools.product((0.1, 0.9), repeat=3)))

    assert len(thin(corners)) == count


def test_a_shape_in_millimetres_gets_no_more_points_than_memory_has() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
    triangles = [SurfaceTriangle(0, 1, 2)] * 2000

    points = spread(TriangleSurfaceMesh(triangles, list(corners)))

    assert 500_000 < len(points) < 1_500_000


def add_nut(plant: MultibodyPlant, folder: Path) -> None:
    """Add a prism of six sides, as a mesh: 24 mm from face to face, 30 mm high."""
    corners = [
        (0.024 / math.sqrt(3.0) * math.cos(a), 0.024 / math.sqrt(3.0) * math.sin(a), z)
        for z in (-0.015, 0.015)
        for a in np.arange(6) * math.pi / 3.0
    ]
    sides = [(n, n % 6 + 1, n % 6 + 7, n + 6) for n in range(1, 7)]
    faces = [(6, 5, 4, 3, 2, 1), (7, 8, 9, 10, 11, 12), *sides]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {' '.join(map(str, face))}" for face in faces]
    file = folder / "nut.obj"
    file.write_text("\n".join(lines) + "\n")
    model = plant.AddModelInstance("thing")
    inertia = SpatialInertia.SolidCylinderWithMass(0.02, 0.013, 0.03, [0.0, 0.0, 1.0])
    body = plant.AddRigidBody("thing", model, inertia)
    friction = CoulombFriction(1.0, 1.0)
    shape, X = Convex(str(file)), RigidTransform()
    plant.RegisterCollisionGeometry(body, X, shape, "thing", friction)
    pose = RigidTransform([0.2, 0.05, 0.015])
    plant.SetDefaultFloatingBaseBodyPose(body, pose)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cylinder", "ball", "mesh"])
def test_what_is_no_box_is_lifted(kind: str, tmp_path: Path) -> None:
    def add_things(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        if kind == "mesh":
            add_nut(plant, tmp_path)
        elif kind == "cylinder":
            can = ad.Thing("thing", "cylinder", (0.012, 0.04), mass=0.02)
            at(can, 0.2, 0.05).add_to(plant)
        else:
            ball = ad.Thing("thing", "sphere", (0.018,), mass=0.01)
            at(ball, 0.2, 0.05).add_to(plant)

    simulation = simulate_with(add_things, COARSE if kind == "cylinder" else MEDIUM)
    before = pose_of(simulation, "thing").translation()[2]

    picked = ad.pick(simulation, "thing")

    assert picked, picked.reason
    height = pose_of(simulation, "thing").translation()[2]
    assert height == pytest.approx(before + 0.05, abs=4e-3)


@pytest.mark.slow
def test_a_thing_is_carried_upright_and_placed_from_what_was_seen() -> None:
    simulation = simulate(at(BOX, 0.2, 0.05, 0.4), options=COARSE)
    # As a camera has it, its longest side along x, by a millimetre too far.
    seen = ad.FoundBox(
        success=True,
        pose=RigidTransform(RollPitchYaw(0.0, 0.0, 0.4), [0.201, 0.05, 0.02]),
        size=np.array([0.025, 0.025, 0.04]),
    )
    goal = RigidTransform([0.1, -0.2, 0.02])
    tilts = []

    picked = ad.pick(simulation, "box", goal=goal, seen=seen)
    assert picked, picked.reason
    for until in placing(simulation, goal, held=picked.X_PO, upright=0.3):
        simulation.advance_to(max(until, simulation.time))
        z = pose_of(simulation, "box").rotation().matrix()[2, 2]
        tilts.append(math.acos(min(z, 1.0)))

    X = pose_of(simulation, "box")
    assert X.translation() == pytest.approx([0.1, -0.2, 0.02], abs=5e-3)
    # As far as it may, and by what it turns between the fingers.
    assert max(tilts) < 0.3 + 0.05


def test_nothing_is_picked_that_was_not_seen() -> None:
    simulation = simulate(at(BOX, 0.2, 0.05))
    nothing = ad.find_box(np.zeros((0, 3)))

    with pytest.raises(ad.ArmDrakeError, match=r"^seen: it is no box: "):
        ad.pick(simulation, "box", seen=nothing)


def watched(*things: ad.Thing) -> ad.Simulation:
    """Return a simulation of the myCobot, seen by a camera."""
    robot = ad.load_robot(
        "mycobot_280", xacro_args={"control": "ros2_control"}, pose=POSE
    )
    eye = (0.55, 0.0, 0.45, 0.0, 0.86, math.pi)
    robot = ad.add_camera(robot, "world", eye, name="eye", width=960, height=720)
    world = with_things(load_world("empty"), things)
    return ad.Simulation(ad.build_diagram(robot, world=world, options=COARSE))


@pytest.mark.slow
def test_of_two_alike_a_camera_tells_which_is_meant_and_where_it_is() -> None:
    other = ad.Thing("other", "box", BOX.size, mass=0.02)
    simulation = watched(at(BOX, 0.2, 0.05, 0.4), at(other, 0.2, -0.08))

    picked = ad.pick(simulation, "box", camera="eye")

    assert picked, picked.reason
    assert ad.held_thing(simulation) == "box"
    assert picked.X_PO is not None
    # The fingers have moved it to their middle.
    X_WP = Hand(simulation, PickOptions()).palm()
    miss = pose_of(simulation, "box").translation() - (X_WP @ picked.X_PO).translation()
    assert np.linalg.norm(miss) < 3e-3


@pytest.mark.parametrize(
    ("things", "reason"),
    [
        ([at(BOX, -0.6, 0.0)], "camera 'eye' doesn't see 'box'"),
        (
            [at(ad.Thing("box", "sphere", (0.018,), mass=0.01), 0.2, 0.05)],
            "what camera 'eye' sees of 'box' is no box: a cluster of",
        ),
    ],
)
def test_what_a_camera_does_not_see_is_not_picked(
    things: list[ad.Thing], reason: str
) -> None:
    simulation = watched(*things)

    picked = ad.pick(simulation, "box", camera="eye")

    assert not picked
    assert picked.attempts[0].stage == "look"
    assert picked.reason.startswith(reason)
    assert simulation.time == 0.0


def test_a_motion_places_what_a_camera_saw_as_it_was_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    X_PO, given = RigidTransform([0.0, 0.0, 0.1]), []

    def fake_picking(*_: Any, **__: Any) -> Activity[ad.PickResult]:
        yield 0.0
        return ad.PickResult("box", success=True, X_PO=X_PO)

    def fake_placing(*_: Any, held: Any, **__: Any) -> Activity[ad.PlaceResult]:
        given.append(held)
        yield 0.0
        return ad.PlaceResult("box", success=True)

    monkeypatch.setattr(pick_and_place, "picking", fake_picking)
    monkeypatch.setattr(pick_and_place, "placing", fake_placing)
    seen = {"pick": {"thing": "box", "camera": "eye"}}
    place, unseen = {"place": [0.2, 0.1, 0.02]}, {"pick": "box"}
    simulation = watched(BOX)

    simulation.run(1.0, parse_motion([seen, place, unseen, place]))
    assert given == [X_PO, None]

    # What another pick sees or doesn't, counts; and a robot may be named or not.
    robot = next(iter(simulation.robots))
    named = {"place": {"pose": [0.2, 0.1, 0.02], "robot": robot}}
    simulation.run(1.0, parse_motion([seen, unseen, place, seen, named]))
    assert given[2:] == [None, X_PO]


def test_a_camera_that_there_is_not_is_an_error() -> None:
    simulation = watched(BOX)

    with pytest.raises(ad.ArmDrakeError, match=r"no camera 'ey'.*'eye'"):
        ad.pick(simulation, "box", camera="ey")
    motion = parse_motion([{"pick": {"thing": "box", "camera": "ey"}}])
    with pytest.raises(MotionError, match=r"no camera 'ey'.*'eye'"):
        simulation.run(0.1, motion)


@pytest.mark.slow
def test_a_grasp_that_misses_says_so_in_each_attempt() -> None:
    simulation = simulate(at(BOX, 0.2, 0.05), options=COARSE)
    # The box isn't where it is said to be.
    seen = ad.FoundBox(
        success=True,
        pose=RigidTransform([0.18, -0.08, 0.02]),
        size=np.array([0.025, 0.025, 0.04]),
    )

    picked = ad.pick(simulation, "box", seen=seen, tries=1)

    assert not picked
    assert picked.attempts[0].stage == "close"
    assert "the fingers don't both press on 'box'" in picked.reason


@pytest.mark.slow
def test_the_page_shows_what_works() -> None:
    page = ROOT / "docs/manipulation.md"
    (program,) = (b.text for b in read_blocks(page) if b.language == "python")
    names: dict[str, Any] = {}

    exec(program, names)  # noqa: S102

    X = pose_of(names["simulation"], "box")
    assert X.translation() == pytest.approx([0.15, -0.15, 0.02], abs=5e-3)


def test_a_step_that_can_not_be_done_is_reported_with_its_place() -> None:
    simulation = simulate(at(BOX, 1.2, 0.0))
    motion = parse_motion(
        [{"at": 0.0, "pick": "box"}, {"at": 0.0, "place": [0.0, 0.2, 0.0]}]
    )

    simulation.run(motion=motion)

    # Where all is refused at once, nothing is waited for.
    assert simulation.time < 1.5
    assert [outcome.reason for outcome in simulation.tasks] == [
        event.reason for event in simulation.rejected
    ]
    reasons = [event.reason for event in simulation.rejected]
    assert "the arm reaches none" in reasons[0]
    assert reasons[1] == "the gripper holds nothing"
    with pytest.raises(MotionError, match=r"\[0\].*no thing 'bx'"):
        simulation.run(0.1, parse_motion([{"at": 0.0, "pick": "bx"}]))


def test_what_is_too_large_for_the_gripper_is_said() -> None:
    crate = ad.Thing("crate", "box", (0.08, 0.06, 0.07), mass=0.1)
    simulation = simulate(at(crate, 0.2, 0.0))

    picked = ad.pick(simulation, "crate")

    assert not picked
    assert "too large: 60.0 mm" in picked.reason
    assert simulation.time == 0.0
    assert ad.place(simulation, (0.2, 0.0, 0.02)).reason == "the gripper holds nothing"


def test_a_goal_in_the_ground_is_said_to_be_there() -> None:
    hand_ = Hand(simulate(BOX), PickOptions())
    approach = hand_.gripper.approach_axis
    down = RotationMatrix.MakeFromOneVector([0.0, 0.0, -1.0], 2)
    R = down @ RotationMatrix.MakeFromOneVector(approach, 2).inverse()
    X_WP = RigidTransform(R, [0.2, 0.05, 0.05])

    with pytest.raises(Failure, match=r"would be in collision there: .* 'ground' over"):
        hand_.find_way(hand_.solve(X_WP), hand_.retreat_poses(X_WP), "box")


def test_what_is_out_of_reach_is_said() -> None:
    simulation = simulate(at(BOX, 1.2, 0.0))

    picked = ad.pick(simulation, "box")

    assert not picked
    assert "the arm reaches none" in picked.reason


@pytest.mark.parametrize(
    ("x", "goal", "where"), [(1.2, (0.2, 0.1, 0.02), ""), (0.2, (0.8, 0.0), "goal")]
)
def test_what_is_too_far_is_refused_by_its_distance(
    x: float, goal: tuple[float, ...], where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulate(at(BOX, x, 0.0))
    asked, solve = [], Hand.solve

    def count(arm: Hand, X_WP: RigidTransform) -> list[dict[str, float]]:
        asked.append(X_WP)
        return solve(arm, X_WP)

    monkeypatch.setattr(Hand, "solve", count)
    found = Hand(simulation, PickOptions(goal=(*goal, 0.02)[:3])).choose("box", [])

    assert len(asked) == 1
    assert "it is out of reach" in found
    assert where in found


def test_where_the_palm_did_not_get_to_is_not_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = simulate(at(BOX, 0.2, 0.05))
    tried: list[RigidTransform] = []

    def solve(_: Hand, X_WP: RigidTransform) -> list[dict[str, float]]:
        if X_WP.translation()[1] < -0.05:
            tried.append(X_WP)
            raise Failure("reach", "too far")
        return []

    monkeypatch.setattr(Hand, "solve", solve)
    found = Hand(simulation, PickOptions(goal=(0.2, -0.3, 0.02))).choose("box", [])

    assert "the arm reaches none: at its goal: too far" in found
    # A square box turned by a quarter is grasped as before.
    misses = [tried[0].inverse() @ X for X in tried[1:]]
    assert misses
    assert all(
        np.linalg.norm(miss.translation()) > 1e-3
        or miss.rotation().ToAngleAxis().angle() > 0.05
        for miss in misses
    )


def test_where_no_way_keeps_its_distance_a_nearer_one_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = simulate()
    arm, paddings = Hand(simulation, PickOptions()), []
    joint = arm.gripper.group.joints[0]

    def plan(*args: Any, padding: float, **options: Any) -> ad.Plan:
        paddings.append(padding)
        if padding == 5e-3:
            raise PlanningError("'link3' and 'link6' are 4.18 mm apart")
        return ad.plan(*args, padding=padding, **options)

    monkeypatch.setattr(hand, "plan", plan)
    perform(simulation, arm.move({joint: 0.1}, "reach"))

    assert paddings == [5e-3, 1e-3]
    state = simulation.joint_states()
    assert state.position[state.name.index(joint)] == pytest.approx(0.1, abs=0.01)


def test_the_reason_is_that_of_a_grasp_that_got_to_the_goal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = simulate(at(BOX, 0.2, 0.05))
    asked: list[RigidTransform] = []

    def solve(_: Hand, X_WP: RigidTransform) -> list[dict[str, float]]:
        asked.append(X_WP)
        if len(asked) == 2:
            return []
        raise Failure("reach", "here" if X_WP.translation()[1] > -0.05 else "there")

    monkeypatch.setattr(Hand, "solve", solve)
    found = Hand(simulation, PickOptions(goal=(0.2, -0.3, 0.02))).choose("box", [])

    assert isinstance(found, str)
    assert found.endswith("at its goal: there")


@pytest.mark.slow
def test_what_is_too_slippery_slips_and_says_so() -> None:
    soap = dc.replace(at(BOX, 0.2, 0.05, 0.4), friction=0.02)
    simulation = simulate(soap)

    picked = ad.pick(simulation, "box", tries=1)

    assert not picked
    assert picked.attempts[0].stage == "lift"
    assert picked.reason.startswith("'box' slipped by ")


@pytest.mark.slow
def test_what_is_lost_on_the_way_is_not_placed() -> None:
    simulation = simulate(at(BOX, 0.2, 0.05, 0.4), options=COARSE)
    goal = (0.15, -0.15, 0.02)
    picked = ad.pick(simulation, "box", goal=goal)
    assert picked, picked.reason

    def take(_: RigidTransform) -> RigidTransform:
        return RigidTransform([-0.3, 0.3, 0.02])

    placed = place_and_move(simulation, goal, take)

    assert not placed
    assert placed.reason == "'box' was lost on the way"


@pytest.mark.slow
@pytest.mark.parametrize("is_seen", [False, True])
def test_what_moves_in_the_fingers_on_the_way_is_told_and_made_up_for(
    is_seen: bool,
) -> None:
    simulation = simulate(at(BOX, 0.2, 0.05, 0.4), options=COARSE)
    goal = (0.15, -0.15, 0.02, 0.0, 0.0, 0.9)
    picked = ad.pick(simulation, "box", goal=goal)
    assert picked, picked.reason

    def slide(X_WB: RigidTransform) -> RigidTransform:
        arm = Hand(simulation, PickOptions())
        across = arm.palm().rotation().matrix() @ arm.gripper.closing_axis
        aside = np.cross([0.0, 0.0, 1.0], across)
        return RigidTransform(X_WB.rotation(), X_WB.translation() + 4e-3 * aside)

    more = {"held": picked.X_PO} if is_seen else {}
    placed = place_and_move(simulation, goal, slide, **more)

    assert placed
    assert placed.slip_distance == pytest.approx(4e-3, abs=1e-3)
    assert placed.slip_angle < 0.05
    if is_seen:
        assert placed.reason == (
            f"'box' moved by {1e3 * placed.slip_distance:.1f} mm and "
            f"{placed.slip_angle:.2f} rad in the gripper on the way, and was placed "
            "as it was seen"
        )
        assert placed.position_error == pytest.approx(4e-3, abs=1e-3)
    else:
        assert placed.reason == ""
        assert placed.position_error < 1e-3


def place_and_move(
    simulation: ad.Simulation,
    goal: Any,
    change: Callable[[RigidTransform], RigidTransform],
    **options: Any,
) -> ad.PlaceResult:
    """Place the box, and put it elsewhere by its pose on the way."""
    plant, began = simulation.plant, simulation.time
    activity, is_changed = placing(simulation, goal, **options), False
    while True:
        try:
            simulation.advance_to(max(next(activity), simulation.time))
        except StopIteration as stop:
            result: ad.PlaceResult = stop.value
            return result
        if simulation.time > began + 0.3 and not is_changed:
            is_changed = True
            context = plant.GetMyMutableContextFromRoot(simulation.context)
            body = plant.GetBodyByName("box")
            X_WB = change(plant.EvalBodyPoseInWorld(context, body))
            plant.SetFloatingBaseBodyPoseInWorldFrame(context, body, X_WB)


def test_an_unknown_thing_or_option_is_an_error_that_names_those_there_are() -> None:
    simulation = simulate(at(BOX, 0.2, 0.0))

    with pytest.raises(ad.ArmDrakeError, match=r"no thing 'bx'.*'box'"):
        ad.pick(simulation, "bx")
    with pytest.raises(ad.ArmDrakeError, match=r"no option 'lft'.*'lift'"):
        ad.pick(simulation, "box", lft=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lift": -0.1}, "lift: expected a distance [m], got -0.1"),
        ({"lift": "high"}, "lift: expected a distance [m], got 'high'"),
        ({"upright": "yes"}, "upright: expected an angle [rad], got 'yes'"),
        ({"group": 3}, "group: expected a name, got 3"),
        ({"tries": 0}, "tries: expected at least 1, got 0"),
        ({"held": 3}, "held: expected a RigidTransform, got 3"),
        ({"seen": 3}, "seen: expected what find_box returns, got 3"),
    ],
)
def test_an_option_that_can_not_be_used_is_named(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ad.ArmDrakeError) as error:
        PickOptions(**options)

    assert str(error.value) == message
