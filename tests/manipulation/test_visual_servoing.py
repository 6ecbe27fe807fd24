"""Visual servoing, judged by the closed forms of its law."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.multibody.math import SpatialVelocity

import arm_drake as ad
from arm_drake.description.entry import configs_folder
from arm_drake.errors import InputError, MotionError
from arm_drake.manipulation.visual_servoing import Feature, Servo, interaction_matrix
from arm_drake.manipulation.visual_servoing import FollowOptions as Options
from arm_drake.simulation.motion import TaskOutcome
from arm_drake.simulation.motion_files import parse_motion
from arm_drake.worlds.things import with_things
from arm_drake.worlds.world import load_world
from tests.models import bob, joint, load, ros2_control, trajectory_controllers
from tests.snippets import ROOT, read_blocks

GAIN = 2.0

# How far the ball is from the camera [m].
AWAY = 0.5

URDF = f"""<robot name="head"><link name="base"/>
  {bob("pan", "0 0 0")}{bob("tilt", "0 0 0")}
  {joint("one", "base", "pan", axis="0 0 1")}{joint("two", "pan", "tilt")}
  {ros2_control("one", "two")}
</robot>"""
CONTROLLERS = trajectory_controllers({"arm": ["one", "two"]})


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> ad.Robot:
    """Return a camera that two joints turn about its own middle."""
    robot = load(tmp_path_factory.mktemp("head"), URDF, CONTROLLERS)
    return ad.add_camera(
        robot, "tilt", name="eye", width=240, height=180, horizontal_fov=1.2,
        update_rate=25.0,
    )  # fmt: skip


def simulate(
    robot: ad.Robot, y: float, z: float, velocity: float = 0.0
) -> ad.Simulation:
    ball = ad.Thing("ball", "sphere", (0.03,), mass=1.0, pose=(AWAY, y, z, 0, 0, 0))
    options = ad.SimulationOptions(gravity=(0.0, 0.0, 0.0))
    world = with_things(load_world("void"), [ball])
    simulation = ad.Simulation(ad.build_diagram(robot, world=world, options=options))
    push(simulation, velocity)
    return simulation


def push(simulation: ad.Simulation, velocity: float) -> None:
    """Have the ball move to the left [m/s]."""
    plant = simulation.plant
    context = plant.GetMyMutableContextFromRoot(simulation.context)
    twist = SpatialVelocity(np.array([0.0, 0.0, 0.0, 0.0, velocity, 0.0]))
    plant.SetFreeBodySpatialVelocity(plant.GetBodyByName("ball"), twist, context)


@pytest.mark.slow
def test_the_error_decays_with_the_gain(head: ad.Robot) -> None:
    found = ad.follow(simulate(head, 0.15, -0.1), "ball", gain=GAIN, duration=2.5)

    size = np.linalg.norm(found.errors, axis=1)
    is_large = size > 0.02
    rate = -np.polyfit(found.times[is_large], np.log(size[is_large]), 1)[0]
    assert found.errors[0] == pytest.approx([-0.3, 0.2], abs=0.01)
    assert rate == pytest.approx(GAIN, rel=0.05)
    # In a straight line, without overshoot, to nothing: a pixel is 0.006 wide.
    straight = found.errors[is_large] @ [0.2, 0.3]
    assert np.abs(straight).max() < 0.012
    assert np.all(np.diff(size) < 1e-3)
    assert size[-1] < 2e-3 + size[0] * math.exp(-2.5 * GAIN)


@pytest.mark.slow
def test_the_error_of_what_moves_is_its_speed_over_the_gain(head: ad.Robot) -> None:
    speed = 0.05

    found = ad.follow(simulate(head, 0.0, 0.0, speed), "ball", gain=GAIN, duration=2.5)

    # At 2.5 s it has moved by 14 degrees, and is turned and farther away by as much.
    angle = math.atan2(speed * 2.5, AWAY)
    expected = speed / AWAY / GAIN * math.cos(angle) ** 2
    assert -found.errors[-1, 0] == pytest.approx(expected, rel=0.1)
    assert np.abs(found.errors).max() < 1.05 * speed / AWAY / GAIN


@pytest.mark.slow
def test_it_holds_still_while_it_sees_nothing_and_goes_on(head: ad.Robot) -> None:
    simulation = simulate(head, 0.1, 0.0)
    plant = simulation.plant
    ball = plant.GetBodyByName("ball")

    def put(y: float) -> None:
        context = plant.GetMyMutableContextFromRoot(simulation.context)
        pose = plant.GetFreeBodyPose(context, ball)
        pose.set_translation([AWAY, y, 0.0])
        plant.SetFreeBodyPose(context, ball, pose)

    first = ad.follow(simulation, "ball", duration=1.0)
    put(5.0)
    before = simulation.joint_states().position
    second = ad.follow(simulation, "ball", duration=0.5)
    after = simulation.joint_states().position
    put(0.2)
    third = ad.follow(simulation, "ball", duration=2.5)

    assert first
    assert not first.lost
    assert not second
    assert second.reason == "'ball' isn't seen at all; the arm holds still"
    assert second.lost == (pytest.approx((1.0, 1.5)),)
    # What it moved by is the end of its last step.
    np.testing.assert_allclose(before, after, atol=0.02)
    assert third
    assert np.linalg.norm(third.errors[-1]) < 0.02


@pytest.mark.slow
def test_of_what_is_lost_the_time_is_told(head: ad.Robot) -> None:
    simulation = simulate(head, 0.0, 0.0, 3.0)

    found = ad.follow(simulation, "ball", duration=1.0)

    ((begin, end),) = found.lost
    assert not found
    assert found.reason == f"'ball' isn't seen since {begin:.2f} s; the arm holds still"
    # At 3 m/s it leaves the picture, whose edge is 0.34 m off, after 0.12 s.
    assert begin == pytest.approx(0.14, abs=0.05)
    assert end == pytest.approx(1.0)


def test_the_interaction_matrix_is_the_derivative_of_what_is_seen() -> None:
    p, h = np.array([0.1, -0.05, 0.4]), 1e-6

    def see(point: np.ndarray) -> np.ndarray:
        x, y, z = point
        return np.array([x / z, y / z, math.log(z)])

    L = interaction_matrix(Feature(*see(p)[:2], p[2]))

    for column, axis in enumerate(np.eye(3)):
        # A camera that moves or turns sees the point do the contrary.
        moved = (see(p - h * axis) - see(p + h * axis)) / (2.0 * h)
        turn = np.cross(axis, p)
        turned = (see(p - h * turn) - see(p + h * turn)) / (2.0 * h)
        np.testing.assert_allclose(L[:, column], moved, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(L[:, 3 + column], turned, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_the_program_of_the_page_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    page = ROOT / "docs/visual_servoing.md"
    (program,) = (b.text for b in read_blocks(page) if b.language == "python")
    names: dict[str, Any] = {}
    monkeypatch.chdir(ROOT)

    exec(program, names)  # noqa: S102

    assert np.abs(names["found"].errors[-1]).max() < 3e-3


@pytest.mark.slow
def test_an_arm_keeps_the_distance_too() -> None:
    scene = ad.load_scene(configs_folder() / "mycobot_280/follow_scene.yaml")
    simulation = ad.Simulation(ad.build_diagram(scene))

    found = ad.follow(simulation, "ball", duration=4.0, distance=0.18)

    seen = Servo(simulation, "ball", Options()).look()
    assert found
    assert seen is not None
    # The nearest points of the ball are 20 mm before its middle.
    assert seen.depth == pytest.approx(0.18, abs=2e-3)
    assert abs(seen.x) < 3e-3
    assert abs(seen.y) < 3e-3


@pytest.mark.slow
def test_a_distance_that_is_not_held_is_said(head: ad.Robot) -> None:
    # Its joints turn it about its own middle.
    found = ad.follow(simulate(head, 0.0, 0.0), "ball", duration=0.3, distance=0.9)
    near = ad.follow(simulate(head, 0.0, 0.0), "ball", duration=0.3, distance=AWAY)

    assert not found
    assert found.distances.shape == found.times.shape
    # The nearest points of the ball are before its middle.
    away = found.distances[-1]
    assert AWAY - 0.03 < away < AWAY
    assert found.reason == f"'ball' is {away:.3f} m away in the end, not 0.9 m"
    assert near


@pytest.mark.slow
def test_a_motion_follows_and_says_what_it_lost(head: ad.Robot) -> None:
    motion = parse_motion([{"follow": {"thing": "ball", "duration": 0.2}}])
    simulation = simulate(head, 5.0, 0.0)

    simulation.run(motion.duration, motion)

    ((rejected),) = simulation.rejected
    assert motion.duration == 0.2
    assert "'ball' isn't seen at all" in rejected.reason
    (outcome,) = simulation.tasks
    assert outcome.reason == rejected.reason
    assert outcome.to_json()["success"] is False


@pytest.mark.slow
def test_a_motion_that_follows_says_how_well_and_ends_a_second_later(
    head: ad.Robot,
) -> None:
    motion = parse_motion(
        [{"follow": {"thing": "ball", "duration": 0.2}}, {"at": 0.3, "follow": "ball"}]
    )
    motion.steps[1].message.options["duration"] = 0.4
    simulation = simulate(head, 0.0, 0.0)
    news: list[object] = []
    simulation.on_event(news.append)

    simulation.run(motion=motion)

    first, second = simulation.tasks
    assert [first, second] == [e for e in news if isinstance(e, TaskOutcome)]
    assert first.time == pytest.approx(0.2)
    assert first.describe().startswith("follow ball: seen in the end, 0.")
    found = second.to_json()
    assert found["success"]
    assert found["distance"] == pytest.approx(AWAY, abs=0.03)
    assert second.time < simulation.time < second.time + 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"thing": "bal"}, "no thing 'bal'; did you mean 'ball'?"),
        ({"camera": "ear"}, "no camera 'ear'; known: eye"),
        ({"duration": -1.0}, "duration: expected a number above 0, got -1.0"),
        ({"velocity_scaling": 2}, "velocity_scaling: expected more than 0, at most 1"),
        ({"gain": 99.0}, "gain: expected at most 7.36 1/s, where camera and"),
        ({"gian": 1.0}, "follow: no option 'gian'; did you mean 'gain'?"),
        ({"robot": "tail"}, "robot: no robot 'tail'; known: head"),
    ],
)
def test_what_can_not_be_is_named(
    head: ad.Robot, options: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError) as error:
        ad.follow(simulate(head, 0.0, 0.0), **{"thing": "ball", **options})

    assert str(error.value).startswith(message)


def test_without_a_camera_there_is_a_hint(head: ad.Robot, tmp_path: Path) -> None:
    blind = load(tmp_path, URDF, CONTROLLERS)
    fixed = ad.add_camera(blind, "world", name="wall")
    motion = parse_motion([{"follow": "ball"}])

    for robot in (blind, fixed):
        with pytest.raises(MotionError) as error:
            simulate(robot, 0.0, 0.0).run(0.1, motion)
        assert str(error.value).endswith(
            "robot 'head' has no camera that its arm moves; "
            "arm_drake.add_camera adds one"
        )


@pytest.mark.slow
def test_the_controller_is_the_one_that_moves_the_camera(tmp_path: Path) -> None:
    controllers = trajectory_controllers({"lower": ["one"], "upper": ["two"]})
    robot = load(tmp_path, URDF, controllers)
    robot = ad.add_camera(robot, "pan", name="eye", width=120, height=90)

    found = ad.follow(simulate(robot, 0.1, 0.0), "ball", duration=2.0)

    # The joint "two" is after the camera.
    assert found
    assert abs(found.errors[-1, 0]) < 0.02
