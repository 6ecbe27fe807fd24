"""Things that are inserted into a running simulation fall; all else goes on."""

import dataclasses as dc
from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.systems.framework import Diagram

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.scene import Scene
from arm_drake.simulation.continuation import continue_with
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.insertion import Insertion
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.parts import find_part
from arm_drake.worlds.things import Thing

OPTIONS = ad.SimulationOptions(frame_rate=0.0)
CUBE = Thing("cube", "box", (0.1, 0.1, 0.1), mass=0.2, pose=(3, 0, 1, 0, 0, 0))


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("lab5_arm")


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


def simulate(page: Page, scene: Scene) -> LiveSimulation:
    def build(scene: Scene) -> Diagram:
        return ad.build_diagram(scene, options=OPTIONS, meshcat=page.meshcat)

    return LiveSimulation(
        page,
        Simulation(build(scene)),
        motion=scene.motion,
        realtime_rate=0.0,
        scene=scene,
        build=build,
    )


def height(simulation: Simulation, name: str) -> float:
    """Return how high a thing is [m]."""
    plant = simulation.plant
    body = plant.GetBodyByName(name, plant.GetModelInstanceByName(name))
    context = plant.GetMyContextFromRoot(simulation.context)
    return float(plant.EvalBodyPoseInWorld(context, body).translation()[2])


@pytest.mark.slow
def test_a_thing_falls_from_where_it_is_inserted(page: Page, robot: ad.Robot) -> None:
    live = simulate(page, Scene((robot,)))
    live.run(0.2)
    live.handle(
        [
            WidgetEvent("insert:kind", "sphere"),
            WidgetEvent("insert:x", 1.5),
            WidgetEvent("insert:z", 1.0),
        ]
    )
    live.handle([WidgetEvent("insert:now")])
    assert height(live.simulation, "sphere_1") == pytest.approx(1.0)
    live.run(0.3)

    assert live.simulation.time == pytest.approx(0.5)
    # Half a step of 1 ms more than g t^2 / 2, or less.
    fallen = 1.0 - height(live.simulation, "sphere_1")
    assert fallen == pytest.approx(9.81 * 0.3**2 / 2.0, abs=9.81 * 0.3 * 1e-3)
    assert [thing.name for thing in live.scene.things] == ["sphere_1"]
    # Another one has another name; both are there after a reset, and at the start.
    live.run(0.2)
    live.handle([WidgetEvent("insert:now"), WidgetEvent("reset")])
    assert height(live.simulation, "sphere_1") == pytest.approx(1.0)
    assert height(live.simulation, "sphere_2") == pytest.approx(1.0)
    assert live.simulation.time == 0.0


@pytest.mark.slow
def test_what_would_lie_in_another_thing_is_put_above_it(
    page: Page, robot: ad.Robot
) -> None:
    live = simulate(page, Scene((robot,)))
    live.handle([WidgetEvent("insert:x", 1.5), WidgetEvent("insert:z", 0.025)])

    for _ in range(3):
        live.handle([WidgetEvent("insert:now")])

    heights = [height(live.simulation, f"box_{n}") for n in (1, 2, 3)]
    # Boxes of 50 mm are 43 mm from their middle to a corner.
    apart = 0.025 + 0.05 * np.sqrt(3.0) / 2.0 + 1e-3
    assert np.diff(heights) == pytest.approx([apart, apart])


def test_numbers_beyond_a_slider_are_refused_with_its_range(
    page: Page, robot: ad.Robot
) -> None:
    live = simulate(page, Scene((robot,)))
    part = find_part(live.parts, Insertion)

    for value in (-1.0, 0.0, 99.0, float("nan")):
        with pytest.raises(InputError) as error:
            part.handle("insert:mass", value)
        assert str(error.value) == f"mass: expected 0.01 to 10 kg, got {value:g}"

    assert part.changes()["insert:mass"] == {"value": 0.1}


def test_the_readout_tells_of_a_thing_that_is_clicked(
    page: Page, robot: ad.Robot
) -> None:
    live = simulate(page, Scene((robot,), things=(CUBE,)))
    live.run(0.1)

    live.handle([WidgetEvent("readout:pick", "drake/visual/cube/cube/cube")])
    live.views.refresh()

    readout = live.views.readout
    assert readout.frame == "cube"
    where = live.simulation.things["cube"]
    assert readout.pose().IsExactlyEqualTo(where)
    assert readout._describe() == "name: cube\nmass: 0.2  # kg"
    # Also where it was.
    live.seek(0.0)
    live.views.draw_past(live.views.positions())
    assert readout.pose().translation() == pytest.approx([3.0, 0.0, 1.0], abs=0.06)


@pytest.mark.slow
def test_a_motion_goes_on_as_if_nothing_had_come(robot: ad.Robot) -> None:
    scene = Scene(
        (robot,), motions={robot.name: ad.load_motion("control", robot=robot)}
    )
    runs = []
    for is_interrupted in (False, True):
        simulation = Simulation(ad.build_diagram(scene, options=OPTIONS))
        simulation.run(1.0, scene.motion)
        if is_interrupted:
            more = dc.replace(scene, things=(CUBE,))
            continue_with(simulation, ad.build_diagram(more, options=OPTIONS))
        simulation.run(1.0)
        runs.append(simulation)

    rollouts = [simulation.rollout() for simulation in runs]
    np.testing.assert_array_equal(rollouts[0].time, rollouts[1].time)
    np.testing.assert_allclose(rollouts[0].position, rollouts[1].position, atol=1e-9)
    assert [goal.status for goal in runs[0].goals] == [g.status for g in runs[1].goals]
    assert np.ptp(rollouts[1].position, axis=0).max() > 0.1


def test_what_a_link_carries_stays_on_it(robot: ad.Robot) -> None:
    link = next(reversed(robot.description.links))
    scene = Scene((robot,), payloads={link: 0.1})
    simulation = Simulation(ad.build_diagram(scene, options=OPTIONS))
    simulation.set_payload(link, 1.5)
    more = dc.replace(scene, things=(CUBE,))

    continue_with(simulation, ad.build_diagram(more, options=OPTIONS))

    plant = simulation.plant
    body = plant.GetBodyByName(f"{link}/payload")
    assert body.get_mass(plant.GetMyContextFromRoot(simulation.context)) == 1.5


@pytest.mark.slow
def test_what_cannot_be_inserted_is_said(page: Page, robot: ad.Robot) -> None:
    live = simulate(page, Scene((robot,), things=(CUBE,)))
    with pytest.raises(InputError, match="something else is called 'cube'"):
        live.insert(CUBE)
    other = Simulation(ad.build_diagram(ad.load_robot("doosan_a0912"), options=OPTIONS))
    with pytest.raises(InputError, match=r"the new diagram has no .*same robots"):
        continue_with(other, live.simulation.diagram)
    assert live.scene.things == (CUBE,)
    options = dc.replace(OPTIONS, preset="kinematic")
    other = Simulation(ad.build_diagram(robot, options=options))
    with pytest.raises(InputError, match="kinematic has no physics"):
        continue_with(other, live.simulation.diagram)
