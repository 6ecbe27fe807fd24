"""Things of a world that are where others are: what nobody could have put there."""

from pathlib import Path

import pytest

import arm_drake as ad
from tests import models
from tests.models import load

SHAPES = {
    "ball": "<sphere><radius>0.1</radius></sphere>",
    "box": "<box><size>0.1 0.1 0.1</size></box>",
    "can": "<cylinder><radius>0.1</radius><length>0.1</length></cylinder>",
}


def simulate(folder: Path, shape: str, places: list[str]) -> ad.Simulation:
    """Return a simulation with things at places, `x y z`, beside a robot."""
    things = "".join(
        f'<model name="thing{number}"><pose>{place} 0 0 0</pose><link name="l">'
        f'<inertial><mass>0.1</mass></inertial><collision name="c"><geometry>{shape}'
        "</geometry></collision></link></model>"
        for number, place in enumerate(places)
    )
    world = folder / "world.sdf"
    world.write_text(f'<sdf version="1.9"><world name="w">{things}</world></sdf>')
    robot = load(folder, models.TWO_LINKS)
    return ad.Simulation(ad.build_diagram(robot, world=world))


def told(simulation: ad.Simulation) -> list[str]:
    """Return what the report says of things in one place."""
    return [e.what for e in simulation.report if "in one place" in e.what]


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_things_in_one_place_pass_through_each_other(
    tmp_path: Path, shape: str
) -> None:
    sim = simulate(tmp_path, shape, ["2 0 1"] * 5)

    pairs = [f"thing{a}::l and thing{b}::l" for a in range(5) for b in range(a + 1, 5)]
    assert told(sim) == [f"things of the world are in one place: {', '.join(pairs)}"]
    # With contact one step of the balls takes a minute.
    sim.run(0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "places",
    [["2 0 1", "2 0 1.099"], ["2 0 1", "2 0.03 1"], ["2 0 1", "3 0 1"]],
    ids=["on each other", "in each other", "apart"],
)
def test_things_that_touch_or_overlap_keep_their_contact(
    tmp_path: Path, places: list[str]
) -> None:
    sim = simulate(tmp_path, SHAPES["box"], places)

    assert told(sim) == []
