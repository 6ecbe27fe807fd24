"""The panel's part for planned motions, on an arm of two links in a plane."""

import math
import time
import types
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.visualization.page import Page, WidgetEvent, motion_planning
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.motion_planning import (
    GOAL_COLOR,
    TRAIL_PATH,
    TRIAD_PATH,
    WRONG_COLOR,
    MotionPlanning,
)
from arm_drake.visualization.page.robot_viewer import RobotViewer
from tests.models import LENGTH, bob, joint, load, ros2_control
from tests.visualization.scene import is_visible, pose, unpack, vertices
from tests.waiting import wait_until

# Hanging straight down, the ball at the elbow would be in the ground.
HEIGHT = 0.45
BALL = "<{0}><geometry><sphere radius='0.05'/></geometry></{0}>"
ARM = f"""
<robot name="arm">
  <link name="base"/>{bob("upper")}
  {bob("lower", geometry=BALL.format("visual") + BALL.format("collision"))}
  {joint("shoulder", "base", "upper", xyz=f"0 0 {HEIGHT}")}
  {joint("elbow", "upper", "lower", xyz=f"0 0 {-LENGTH}")}
  {ros2_control("shoulder", "elbow")}
</robot>"""

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
arm:
  ros__parameters:
    joints: [shoulder, elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
"""

LEVEL = {"shoulder": -math.pi / 2.0, "elbow": 0.0}
GHOST = "/drake/ghost/arm goal"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> ad.Robot:
    folder = tmp_path_factory.mktemp("arm")
    return load(folder, ARM, CONTROLLERS, initial_positions=LEVEL)


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


@pytest.fixture
def viewer(page: Page, robot: ad.Robot) -> RobotViewer:
    return RobotViewer(page, lambda: robot, is_watching=False)


@pytest.fixture
def live(page: Page, robot: ad.Robot) -> LiveSimulation:
    options = ad.SimulationOptions(frame_rate=0.0, gravity=False)
    diagram = ad.build_diagram(robot, options=options, meshcat=page.meshcat)
    return LiveSimulation(page, ad.Simulation(diagram), realtime_rate=0.0)


def click(subject: RobotViewer | LiveSimulation, *what: Any) -> MotionPlanning:
    """Do what was clicked in one go: names, or names with values."""
    pairs = [each if isinstance(each, tuple) else (each, None) for each in what]
    subject.handle([WidgetEvent(f"plan:{name}", value) for name, value in pairs])
    return subject.planning


def above(angle: float) -> tuple[tuple[str, Any], ...]:
    """Put the elbow at an angle above the level of the shoulder, its turn free."""
    x, z = LENGTH * math.cos(angle), HEIGHT + LENGTH * math.sin(angle)
    return (("position_only", True), ("x", x), ("y", 0.0), ("z", z))


def ghost_color(page: Page) -> list[float]:
    path = f"{GHOST}/lower/0/<object>"
    data = page.meshcat._GetPackedProperty(path, "color")
    return list(unpack(data)["value"][:3]) if data else list(GOAL_COLOR)


def test_the_ghost_is_where_the_sliders_of_the_pose_say(
    page: Page, viewer: RobotViewer
) -> None:
    planning = click(viewer, *above(0.6))

    assert planning.goal is not None
    assert planning.goal["shoulder"] == pytest.approx(-math.pi / 2.0 - 0.6, abs=1e-3)
    place = [LENGTH * math.cos(0.6), 0.0, HEIGHT + LENGTH * math.sin(0.6)]
    assert pose(page.meshcat, f"{GHOST}/lower")[:3, 3] == pytest.approx(place, abs=1e-4)
    assert pose(page.meshcat, TRIAD_PATH)[:3, 3] == pytest.approx(place)
    assert ghost_color(page) == pytest.approx(GOAL_COLOR)
    assert planning.problem == ""


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (above(-math.pi / 2.0), "in collision: 'ground' and 'lower' overlap by 100 mm"),
        ((*above(0.6)[:3], ("z", 9.0)), "no joint positions put 'lower' there"),
    ],
)
def test_a_goal_that_cannot_be_is_red_and_isnt_planned(
    page: Page, viewer: RobotViewer, what: Any, words: str
) -> None:
    planning = click(viewer, *what)

    assert planning.problem.startswith(words)
    assert planning.status == planning.problem
    assert ghost_color(page) == pytest.approx(WRONG_COLOR)
    assert click(viewer, "plan").status.startswith(f"no plan: {words}")
    assert planning.plan is None
    click(viewer, "here")
    assert ghost_color(page) == pytest.approx(GOAL_COLOR)


def test_a_goal_that_tilts_the_frame_is_not_planned_where_it_is_kept_upright(
    viewer: RobotViewer,
) -> None:
    planning = click(viewer, *above(0.6), ("upright", True), "plan")

    assert planning.status.startswith("no plan: the goal: 'lower' tilts by ")


def test_a_named_state_moves_the_sliders(viewer: RobotViewer) -> None:
    planning = click(viewer, ("state", "home"))

    values = {
        widget.id: widget
        for widget in planning.section().widgets
        if hasattr(widget, "id")
    }
    assert values["plan:x"].value == pytest.approx(LENGTH)  # type: ignore[union-attr]
    assert values["plan:z"].value == pytest.approx(HEIGHT)  # type: ignore[union-attr]
    assert values["plan:pitch"].value == pytest.approx(-math.pi / 2.0)  # type: ignore[union-attr]
    assert values["plan:state"].value == "home"  # type: ignore[union-attr]


def test_a_plan_is_played_by_a_ghost_with_its_trail_then_executed(
    page: Page, viewer: RobotViewer
) -> None:
    planning = click(viewer, *above(1.0), "plan")

    assert planning.is_playing
    assert planning.status.startswith("group arm: ")
    way = vertices(page.meshcat, TRAIL_PATH)
    center = np.array([0.0, 0.0, HEIGHT])
    assert np.linalg.norm(way - center, axis=1) == pytest.approx(LENGTH, abs=1e-4)
    assert viewer.positions["shoulder"] == pytest.approx(-math.pi / 2.0)
    click(viewer, "execute")
    assert not planning.is_playing
    wait_until(lambda: viewer.handle([]) or planning.status == "there")
    assert viewer.positions["shoulder"] == pytest.approx(-math.pi / 2.0 - 1.0, abs=1e-3)


def test_the_scale_of_the_speed_makes_it_slower(viewer: RobotViewer) -> None:
    fast = click(viewer, *above(1.0), "plan").plan
    slow = click(viewer, ("velocity_scaling", 0.1), "plan").plan

    assert fast is not None
    assert slow is not None
    limit = 0.1 * 10.0  # Of the joint [rad/s].
    speeds = [abs(p.velocities[0]) for p in slow.trajectory.points]
    assert max(speeds) <= limit + 1e-6
    assert slow.duration > fast.duration


def test_stop_leaves_the_robot_where_it_is(
    viewer: RobotViewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = ("velocity_scaling", 0.01)
    planning = click(viewer, *above(1.0), slow, "plan", "execute")
    wait_until(
        lambda: (
            viewer.handle([])
            or abs(viewer.positions["shoulder"] + math.pi / 2.0) > 1e-3
        )
    )

    click(viewer, "stop")

    stopped, later = viewer.positions, time.monotonic() + 10.0
    clock = types.SimpleNamespace(monotonic=lambda: later)
    monkeypatch.setattr(motion_planning, "time", clock)
    viewer.handle([])
    assert viewer.positions == stopped
    assert planning.status == "stopped"


def test_clear_hides_all_of_it(page: Page, viewer: RobotViewer) -> None:
    planning = click(viewer, *above(1.0), "plan")
    assert is_visible(page.meshcat, GHOST)

    click(viewer, "clear")

    assert not is_visible(page.meshcat, GHOST)
    assert not page.meshcat.HasPath(TRAIL_PATH)
    assert not page.meshcat.HasPath(TRIAD_PATH)
    assert planning.goal is None


@pytest.mark.parametrize(
    "event", [("group", "wing"), ("frame", "wing"), ("x", "far"), ("x", math.nan)]
)
def test_what_makes_no_sense_is_said_and_it_goes_on(
    page: Page, viewer: RobotViewer, event: Any
) -> None:
    click(viewer, *above(0.5))
    known = viewer.planning.goal

    click(viewer, event)

    assert viewer.planning.goal == known


def test_there_is_nothing_to_execute_without_a_plan(
    page: Page, live: LiveSimulation
) -> None:
    said: list[str] = []
    page.say = lambda text, severity="info": said.append(text)  # type: ignore[method-assign]

    click(live, "execute")

    assert said == ["there is no plan to execute: plan first"]


@pytest.mark.slow
def test_a_simulated_robot_executes_it(live: LiveSimulation) -> None:
    planning = click(live, *above(1.0), "plan", "execute")
    assert planning.status == "executing: arm"

    live.run(3.0)

    measured = live.simulation.joint_states()
    assert measured.position[0] == pytest.approx(-math.pi / 2.0 - 1.0, abs=5e-3)
    assert planning.status.startswith("arm: goal SUCCEEDED")


@pytest.mark.slow
def test_stop_cancels_what_a_simulated_robot_does(live: LiveSimulation) -> None:
    slow = ("velocity_scaling", 0.02)
    click(live, *above(1.0), slow, "plan", "execute")
    live.run(0.5)

    click(live, "stop")

    (goal,) = live.simulation.goals
    live.run(0.5)
    assert goal.status is ad.GoalStatus.CANCELED
    before = live.simulation.joint_states().position[0]
    live.run(0.3)
    assert live.simulation.joint_states().position[0] == pytest.approx(before, abs=1e-3)


def test_while_it_moves_the_panel_says_why_there_is_no_plan(
    live: LiveSimulation,
) -> None:
    click(live, *above(1.0), "plan", "execute")
    live.run(0.2)

    planning = click(live, *above(0.3), "plan")

    assert planning.status.startswith("no plan: joint 'shoulder' moves at ")


def test_without_a_click_it_costs_no_model(
    monkeypatch: pytest.MonkeyPatch, live: LiveSimulation
) -> None:
    def fail(*args: Any) -> None:
        raise AssertionError

    check: Callable[..., None] = fail
    monkeypatch.setattr("arm_drake.planning.collisions.CollisionModel.__init__", check)

    live.run(0.1)

    assert live.planning.goal is None
