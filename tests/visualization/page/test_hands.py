"""Hands: what is pulled and pushed moves as Newton says."""

from collections.abc import Iterator

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.scene import Scene
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.hands import Hands
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.worlds.things import Thing

BALL = Thing("ball", "sphere", (0.05,), mass=0.5, pose=(1.0, 0.0, 0.5, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def scene() -> Scene:
    options = ad.SimulationOptions(frame_rate=0.0, gravity=False)
    return Scene((ad.load_robot("lab5_arm"),), things=(BALL,), options=options)


@pytest.fixture
def live(scene: Scene) -> Iterator[LiveSimulation]:
    with Page() as page:
        diagram = ad.build_diagram(scene, meshcat=page.meshcat)
        yield LiveSimulation(page, ad.Simulation(diagram), realtime_rate=0.0)


def hands_of(live: LiveSimulation) -> Hands:
    [hands] = [part for part in live.parts if isinstance(part, Hands)]
    return hands


def ball(live: LiveSimulation) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of the ball."""
    sim = live.simulation
    context = sim.plant.GetMyContextFromRoot(sim.context)
    body = sim.plant.GetBodyByName("ball")
    V = sim.plant.EvalBodySpatialVelocityInWorld(context, body)
    X = sim.plant.EvalBodyPoseInWorld(context, body)
    return X.translation(), V.translational()


@pytest.mark.slow
def test_a_push_is_force_times_time(live: LiveSimulation) -> None:
    live.handle(
        [
            WidgetEvent("hands:body", "ball"),
            WidgetEvent("hands:direction", "+y"),
            WidgetEvent("hands:force", 2.0),
            WidgetEvent("hands:duration", 0.25),
            WidgetEvent("hands:push"),
        ]
    )
    live.run(0.6)

    # 2 N for 0.25 s on 0.5 kg: 1 m/s, after 0.125 m.
    position, velocity = ball(live)
    assert velocity == pytest.approx([0.0, 1.0, 0.0], abs=1e-2)
    assert position == pytest.approx([1.0, 0.125 + 0.35, 0.5], abs=5e-3)
    assert "ball: pushed with 2 N" in live.log


@pytest.mark.slow
def test_what_is_dragged_comes_to_the_pointer_and_stays_when_let_go(
    live: LiveSimulation,
) -> None:
    drag = {"path": "drake/visual/ball/ball/ball", "from": [1, 0, 0.5]}
    for way in (0.1, 0.2, 0.3):
        live.handle([WidgetEvent("hands:pull", {**drag, "to": [1, way, 0.6]})])
        live.run(0.05)
    live.run(1.0)
    assert ball(live)[0] == pytest.approx([1.0, 0.3, 0.6], abs=1e-3)

    live.handle([WidgetEvent("hands:release")])
    live.run(0.5)
    assert ball(live)[0] == pytest.approx([1.0, 0.3, 0.6], abs=2e-3)


@pytest.mark.slow
def test_a_link_that_is_pushed_gives_way_and_comes_back(live: LiveSimulation) -> None:
    hands, sim = hands_of(live), live.simulation
    link = live.simulation.robots["arm"].description.links[-1]
    before = sim.link_poses()[link].translation()
    live.run(0.1)
    hands.push(link, [200.0, 0.0, 0.0], 0.1)
    live.run(0.1)
    during = sim.link_poses()[link].translation()
    live.run(1.0)

    assert during[0] - before[0] > 1e-3
    assert sim.link_poses()[link].translation() == pytest.approx(before, abs=1e-3)


@pytest.mark.slow
def test_a_reset_lets_go(live: LiveSimulation) -> None:
    hands_of(live).push("ball", [50.0, 0.0, 0.0], 10.0)
    live.run(0.1)
    live.reset()
    live.run(0.2)

    assert ball(live)[0] == pytest.approx(BALL.pose[:3], abs=1e-6)


@pytest.mark.slow
def test_who_pulls_nothing_changes_nothing(live: LiveSimulation, scene: Scene) -> None:
    alone = ad.Simulation(ad.build_diagram(scene))
    alone.run(0.3, "control")
    live._motion = ad.load_motion("control", robot=scene.robots[0])
    live.reset()
    live.run(0.3)

    assert np.array_equal(live.simulation.rollout().position, alone.rollout().position)


@pytest.mark.slow
@pytest.mark.parametrize(
    "value",
    [
        None,
        3,
        {},
        {"path": "x", "from": [0, 0], "to": [1, 1]},
        {"path": "drake/visual/ball/ball", "from": [0, 0, 0], "to": ["a", 1, None]},
        {"path": "Grid/ground", "from": [0, 0, 0], "to": [0, 0, 1]},
    ],
)
def test_what_makes_no_sense_pulls_nothing(live: LiveSimulation, value: object) -> None:
    live.handle([WidgetEvent("hands:pull", value)])

    assert hands_of(live).changes()["hands:pulling"] == {"value": "–"}


def test_an_unknown_body_is_said(live: LiveSimulation) -> None:
    with pytest.raises(InputError, match=r"no body 'bal'; did you mean 'ball'\?"):
        hands_of(live).push("bal", [1.0, 0.0, 0.0], 1.0)
