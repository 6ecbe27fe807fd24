"""World files of others, for both Gazebos, as they were published."""

import json

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.worlds.world import load_world
from tests.robots import real_robot
from tests.worlds.sdf import make_plant, shapes

WORLDS = "mycobot_280/mycobot_gazebo/worlds"

PLUGINS = [
    f"plugin 'gz-sim-{name}-system'"
    for name in ("physics", "user-commands", "scene-broadcaster")
]


@pytest.mark.parametrize("name", ["empty", "empty_classic"])
def test_an_empty_world_is_the_ground_and_its_gravity(name: str) -> None:
    path = real_robot(f"{WORLDS}/{name}.world")

    plant, scene_graph = make_plant(path)

    assert plant.num_bodies() == 1
    # What collides, and what cameras see.
    names = [name.rpartition("::")[2] for name in shapes(scene_graph)]
    assert sorted(names) == ["ground", "visual"]
    world = load_world(path)
    assert world.gravity == (0.0, 0.0, -9.8)
    assert {entry.severity for entry in world.report} == {"info"}


def test_what_the_empty_world_for_gazebo_says_is_reported() -> None:
    world = load_world(real_robot(f"{WORLDS}/empty.world"))

    assert [entry.what for entry in world.report] == [
        *PLUGINS,
        "<scene>: shadows",
        "the model of the sun",
    ]


def test_what_the_empty_world_for_classic_says_is_reported() -> None:
    world = load_world(real_robot(f"{WORLDS}/empty_classic.world"))

    whats = [entry.what for entry in world.report]
    assert whats[:2] == ["lights 'sun'", "friction 100 and 50"]
    assert all(what.startswith("Ignoring unsupported") for what in whats[2:])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["house", "house_classic"])
def test_a_house_without_its_furniture_loads(name: str) -> None:
    path = real_robot(f"{WORLDS}/{name}.world")

    world = load_world(path)

    (error,) = world.report.errors
    assert error.what.startswith("63 models aren't there: 'aws_robomaker_residential_")
    assert "'aws_robomaker_residential_Refrigerator_01'" in error.what
    assert world.gravity == (0.0, 0.0, -9.8)
    assert not world.has_grid
    assert not world.has_things


@pytest.mark.slow
def test_a_bundled_robot_stands_on_the_ground_of_another_ones_world() -> None:
    path = real_robot(f"{WORLDS}/empty_classic.world")
    diagram = ad.build_diagram(ad.load_robot("doosan_a0912"), world=str(path))
    simulation = ad.Simulation(diagram)

    simulation.advance_to(0.2)

    assert simulation.joint_states().position == pytest.approx((0.0,) * 6, abs=1e-6)


@pytest.mark.slow
def test_the_command_line_takes_a_file_and_reports_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = real_robot(f"{WORLDS}/house.world")
    words = ["sim", "doosan_a0912", "--world", str(path), "--headless", "--json"]

    code = main([*words, "--duration", "0.1", "--gravity", "off"])

    captured = capsys.readouterr()
    assert code == 0
    report = json.loads(captured.out)["report"]
    (error,) = (entry for entry in report if entry["severity"] == "error")
    assert (error["file"], error["kind"]) == (str(path), "missing")
    assert "63 models aren't there" in captured.err
