"""Views of a running simulation: poses, commands, forces, trails."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.visualization.page import Choice, Page, Toggle
from arm_drake.visualization.page.live_views import LiveViews, commanded_positions
from tests.models import (
    FALLING_BALL,
    GRAVITY,
    GRIPPER,
    MASS,
    TWO_LINKS,
    load,
    pendulum,
    ros2_control,
    trajectory_controllers,
)
from tests.visualization.scene import (
    about_y,
    cylinder_ends,
    is_visible,
    pose,
    transform,
    vertices,
)

BALL = "<visual><geometry><sphere radius='0.1'/></geometry></visual>"
ARM = trajectory_controllers({"arm": ["shoulder", "elbow"]})


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


def seen(folder: Path, urdf: str, controllers: str | None = None, **how: Any) -> Any:
    """Load a robot whose links have something to be seen."""
    text = urdf.replace("</inertial>", f"</inertial>{BALL}")
    return load(folder, text, controllers, **how)


def simulate(page: Page, *robots: ad.Robot, **options: Any) -> ad.Simulation:
    settings = ad.SimulationOptions(frame_rate=0.0, **options)
    diagram = ad.build_diagram(list(robots), options=settings, meshcat=page.meshcat)
    return ad.Simulation(diagram)


def goal(time: float, **positions: float) -> ad.JointTrajectory:
    point = ad.JointTrajectoryPoint(list(positions.values()), time_from_start=time)
    return ad.JointTrajectory(joint_names=tuple(positions), points=[point])


def at(sim: ad.Simulation, robot: str | None = None) -> dict[str, float]:
    state = sim.joint_states(robot)
    return dict(zip(state.name, state.position, strict=True))


@pytest.fixture
def arm(page: Page, tmp_path: Path) -> ad.Simulation:
    """An arm on its way."""
    sim = simulate(page, seen(tmp_path, TWO_LINKS, ARM))
    sim.controller("arm").send_goal(goal(1.0, shoulder=0.8, elbow=-0.6))
    return sim


def test_the_robot_is_drawn_where_it_is(page: Page, arm: ad.Simulation) -> None:
    views = LiveViews(page, arm)
    arm.run(0.5)

    views.draw()

    poses = arm.link_poses()
    for link in ("upper", "lower"):
        drawn = pose(page.meshcat, f"/drake/visual/two_links/{link}")
        np.testing.assert_allclose(drawn, poses[link].GetAsMatrix4(), atol=1e-12)
    assert at(arm)["shoulder"] > 0.2


@pytest.mark.parametrize("kind", ["frames", "inertia", "joint_axes"])
def test_what_is_beside_it_moves_along(
    page: Page, arm: ad.Simulation, kind: str
) -> None:
    views = LiveViews(page, arm)
    views.show(kind)
    arm.run(0.5)

    views.draw()

    drawn = transform(page.meshcat, f"/drake/{kind}/two_links/lower")
    expected = arm.link_poses()["lower"].GetAsMatrix4()
    np.testing.assert_allclose(drawn, expected, atol=1e-12)


def test_the_fixed_frame_stays_and_the_world_comes_back(
    page: Page, arm: ad.Simulation
) -> None:
    views = LiveViews(page, arm)
    views.set_fixed_frame("lower")
    for _ in range(3):
        arm.run(0.1)
        views.draw()
        drawn = pose(page.meshcat, "/drake/visual/two_links/lower")
        np.testing.assert_allclose(drawn, np.eye(4), atol=1e-12)

    views.set_fixed_frame("world")

    np.testing.assert_allclose(transform(page.meshcat, "/drake"), np.eye(4))


@pytest.mark.slow
def test_the_trail_is_the_way_of_the_link(page: Page, arm: ad.Simulation) -> None:
    views = LiveViews(page, arm)
    views.set_trail("lower")
    points = [arm.link_poses()["lower"].translation().copy()]
    for _ in range(20):
        arm.run(0.05)
        views.draw()
        points.append(arm.link_poses()["lower"].translation().copy())

    drawn = vertices(page.meshcat, "/drake/trail/0")
    assert len(drawn) > 10
    # Meshcat keeps vertices as 32-bit floats.
    np.testing.assert_allclose(drawn, points[: len(drawn)], atol=1e-6)

    views.set_trail(None)
    assert not page.meshcat.HasPath("/drake/trail")


def test_the_ghost_is_where_the_controller_wants_it(
    page: Page, arm: ad.Simulation
) -> None:
    views = LiveViews(page, arm)
    views.show("ghost")
    arm.run(0.5)
    views.draw()

    wanted = commanded_positions(arm, "two_links")

    # Half-way on a line in half of the time: at constant speed, as the trajectory
    # says; a tick of 10 ms more or less.
    assert wanted["shoulder"] == pytest.approx(0.4, abs=0.8 * 0.01 + 1e-9)
    assert wanted["elbow"] == pytest.approx(-0.3, abs=0.6 * 0.01 + 1e-9)
    upper = transform(page.meshcat, "/drake/ghost/two_links/upper")
    expected = about_y(wanted["shoulder"]).GetAsMatrix4()
    np.testing.assert_allclose(upper, expected, atol=1e-12)
    views.show("ghost", False)
    assert not is_visible(page.meshcat, "/drake/ghost/two_links")


def test_without_a_command_the_ghost_is_the_robot(page: Page, tmp_path: Path) -> None:
    # Nothing holds it: it swings.
    robot = seen(tmp_path, pendulum(), initial_positions={"swing": 1.0})
    sim = simulate(page, robot)
    sim.run(0.2)

    assert commanded_positions(sim, "pendulum") == at(sim)


@pytest.mark.slow
def test_joints_that_follow_are_not_commanded(page: Page, tmp_path: Path) -> None:
    sim = simulate(page, seen(tmp_path, GRIPPER))

    assert list(commanded_positions(sim, "gripper")) == ["finger"]


EFFORT = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [effort]
    state_interfaces: [position, velocity]
    gains: {swing: {p: 50.0, d: 5.0}}
"""


def test_a_controller_of_efforts_says_what_it_follows(
    page: Page, tmp_path: Path
) -> None:
    control = ros2_control("swing", command="effort")
    sim = simulate(page, seen(tmp_path, pendulum(control=control), EFFORT))
    sim.controller("arm").send_goal(goal(1.0, swing=0.8))

    sim.run(0.5)

    wanted = commanded_positions(sim, "pendulum")["swing"]
    assert wanted == pytest.approx(0.4, abs=0.8 * 0.01 + 1e-9)
    # Gravity keeps it from there.
    assert abs(at(sim)["swing"] - wanted) > 0.01


@pytest.mark.slow
def test_of_two_robots_alike_each_has_its_own_ghost(page: Page, tmp_path: Path) -> None:
    robots = []
    for name in ("left", "right"):
        folder = tmp_path / name
        folder.mkdir()
        robots.append(seen(folder, TWO_LINKS, ARM, name=name))
    sim = simulate(page, *robots)
    sim.controller("left/arm").send_goal(goal(0.2, shoulder=0.5, elbow=0.1))
    sim.controller("right/arm").send_goal(goal(0.2, shoulder=-0.5, elbow=-0.1))
    views = LiveViews(page, sim)
    views.show("ghost")

    sim.run(0.5)
    views.draw()

    assert commanded_positions(sim, "left") == {"shoulder": 0.5, "elbow": 0.1}
    assert commanded_positions(sim, "right") == {"shoulder": -0.5, "elbow": -0.1}
    views.set_fixed_frame("right/lower")
    drawn = pose(page.meshcat, "/drake/visual/right/lower")
    np.testing.assert_allclose(drawn, np.eye(4), atol=1e-12)


# The second one is of a type that there isn't.
PARTLY_LOADED = ARM.replace(
    "update_rate: 100", "update_rate: 100\n    other: {type: none/Such}"
)


def test_a_controller_that_could_not_be_loaded_is_no_hindrance(
    page: Page, tmp_path: Path
) -> None:
    sim = simulate(page, seen(tmp_path, TWO_LINKS, PARTLY_LOADED))
    assert {row.state for row in sim.list_controllers()} == {"active", "unconfigured"}

    wanted = commanded_positions(sim, "two_links")

    assert set(wanted) == {"shoulder", "elbow"}


@pytest.mark.slow
def test_contact_forces_carry_the_weight(page: Page, tmp_path: Path) -> None:
    sim = simulate(page, seen(tmp_path, FALLING_BALL))
    sim.run(3.0)
    views = LiveViews(page, sim)

    views.show("contacts")

    # A weight is half of the robot's size long: from the base to the ball, 0.1 m,
    # though a size of at least 0.1 m counts.
    length = 0.5 * max(sim.link_poses()["ball"].translation()[2], 0.1)
    ends = cylinder_ends(page.meshcat, "/drake/contact_forces/falling_ball/0/rod")
    rod = float(np.linalg.norm(ends[1] - ends[0]))
    force = rod / length * MASS * GRAVITY
    # It may still sink by a little: 1 % of its weight.
    assert force == pytest.approx(MASS * GRAVITY, rel=0.01)
    views.show("contacts", False)
    assert not is_visible(page.meshcat, "/drake/contact_forces/falling_ball/0")


def test_without_physics_there_are_no_contact_forces(
    page: Page, tmp_path: Path
) -> None:
    robot = seen(tmp_path, TWO_LINKS, ARM)
    views = LiveViews(page, simulate(page, robot, preset="kinematic"))

    with pytest.raises(InputError) as caught:
        views.show("contacts")

    assert str(caught.value) == (
        "contact forces need physics, which this preset has not"
    )
    ids = [w.id for w in views.widgets() if isinstance(w, Toggle)]
    assert "show:contacts" not in ids


def test_without_physics_all_else_is_drawn(page: Page, tmp_path: Path) -> None:
    sim = simulate(page, seen(tmp_path, TWO_LINKS, ARM), preset="kinematic")
    sim.controller("arm").send_goal(goal(0.5, shoulder=0.5, elbow=0.0))
    views = LiveViews(page, sim)
    views.show("ghost")
    views.show("frames")
    views.set_trail("lower")
    sim.run(1.0)

    views.draw()

    drawn = pose(page.meshcat, "/drake/visual/two_links/upper")
    np.testing.assert_allclose(drawn, about_y(0.5).GetAsMatrix4(), atol=1e-9)


def test_the_panel_says_what_is_shown(page: Page, arm: ad.Simulation) -> None:
    views = LiveViews(page, arm, ("frames",))
    views.show("contacts")
    views.set_trail("upper")
    views.set_fixed_frame("base")

    values = {w.id: w.value for w in views.widgets()}  # type: ignore[union-attr]

    assert values == {
        **{"show:visual": False, "show:frames": True, "show:names": False},
        **{"show:collision": False, "show:inertia": False, "show:joint_axes": False},
        **{"show:ghost": False, "show:contacts": True},
        **{"trail": "upper", "fixed_frame": "base"},
    }
    options = {w.id: w.options for w in views.widgets() if isinstance(w, Choice)}
    assert options == {
        "trail": ("none", "base", "upper", "lower"),
        "fixed_frame": ("world", "base", "upper", "lower"),
    }


@pytest.mark.parametrize(
    ("event", "value"),
    [
        ("show:frames", True),
        ("show:ghost", True),
        ("trail", "lower"),
        ("trail", "none"),
        ("fixed_frame", "lower"),
    ],
)
def test_what_is_clicked_is_shown(
    page: Page, arm: ad.Simulation, event: str, value: object
) -> None:
    views = LiveViews(page, arm)

    assert views.handle(event, value)

    shown = {w.id: w.value for w in views.widgets()}  # type: ignore[union-attr]
    assert shown[event] == value


def test_other_widgets_are_not_its_own(page: Page, arm: ad.Simulation) -> None:
    assert not LiveViews(page, arm).handle("play", None)


@pytest.mark.parametrize(
    ("method", "argument", "message"),
    [
        (
            "set_fixed_frame",
            "lowr",
            "fixed frame: no link 'lowr'; did you mean 'lower'? known: base, lower, "
            "upper, world",
        ),
        (
            "set_trail",
            "lowr",
            "trail: no link 'lowr'; did you mean 'lower'? known: base, lower, upper",
        ),
        (
            "show",
            "ghosts",
            "nothing called 'ghosts' can be shown; known: collision, frames, inertia, "
            "joint_axes, names, visual",
        ),
    ],
)
def test_what_cannot_be_is_said(
    page: Page, arm: ad.Simulation, method: str, argument: str, message: str
) -> None:
    views = LiveViews(page, arm)

    with pytest.raises(InputError) as caught:
        getattr(views, method)(argument)

    assert str(caught.value) == message
    views.draw()
