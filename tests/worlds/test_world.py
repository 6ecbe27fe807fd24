"""Worlds: a ground to stand on, nothing at all, or what a function adds."""

import re
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
from pydrake.geometry import Box, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.worlds.world import World, add_world, load_world
from tests import models


def falling_ball(folder: Path, world: World) -> ad.Simulation:
    robot = models.load(folder, models.FALLING_BALL)
    return ad.Simulation(ad.build_diagram(robot, world=world))


@pytest.mark.slow
def test_the_ground_of_the_empty_world_is_at_height_0(tmp_path: Path) -> None:
    simulation = falling_ball(tmp_path, "empty")

    simulation.advance_to(2.0)

    (fallen,) = simulation.joint_states().position
    # From 1 m to its radius of 0.1 m, and 20 um into the compliant ground.
    assert fallen == pytest.approx(-0.9, abs=1e-3)
    assert simulation.joint_states().velocity == pytest.approx((0.0,), abs=1e-5)


def test_in_the_void_everything_falls_for_ever(tmp_path: Path) -> None:
    simulation = falling_ball(tmp_path, "void")

    simulation.advance_to(0.8)

    # Drake's step: v[+] = v - g h, then q[+] = q + h v[+].
    h, n = 1e-3, 800
    expected = -models.GRAVITY * h**2 * n * (n + 1) / 2.0
    np.testing.assert_allclose(
        simulation.joint_states().position, [expected], rtol=1e-9
    )


@pytest.mark.slow
def test_the_world_of_a_file_goes_to_other_processes() -> None:
    world = load_world("house")

    there = cloudpickle.loads(cloudpickle.dumps(world))

    counts = []
    for each in (world, there):
        plant, scene_graph = MultibodyPlant(0.01), SceneGraph()
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        each.add_to(plant)
        counts.append(scene_graph.model_inspector().num_geometries())
    assert counts[0] == counts[1] > 100


def test_an_unknown_world_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        falling_ball(tmp_path, "emty")

    assert str(caught.value) == (
        "unknown world 'emty'; did you mean 'empty'? known: empty, house, "
        "house_table, void, or a .world or .sdf file"
    )


# Edge of a cube [m].
EDGE = 0.1


def add_ground_and_cube(plant: MultibodyPlant) -> None:
    """Add the ground, and a cube of 1 kg that stands on it beside the ball."""
    add_world(plant, "empty")
    inertia = SpatialInertia.SolidBoxWithMass(1.0, EDGE, EDGE, EDGE)
    body = plant.AddRigidBody("cube", plant.AddModelInstance("cube"), inertia)
    shape, friction = Box(EDGE, EDGE, EDGE), CoulombFriction(1.0, 1.0)
    plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "cube", friction)
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform([1.0, 0.0, EDGE / 2.0]))


def cube_pose(simulation: ad.Simulation) -> RigidTransform:
    plant = simulation.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(simulation.simulator.get_context())
    return plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("cube"))


@pytest.mark.slow
def test_a_function_adds_things_that_stand_on_the_ground(tmp_path: Path) -> None:
    simulation = falling_ball(tmp_path, add_ground_and_cube)
    before = cube_pose(simulation)

    simulation.advance_to(2.0)

    moved = before.inverse() @ cube_pose(simulation)
    # Its weight on 100 cm2, by half its height and a modulus of 1e8 Pa: 0.5 um.
    np.testing.assert_allclose(
        moved.translation(), [0.0, 0.0, -0.5e-6], rtol=0.0, atol=1e-7
    )
    assert moved.rotation().ToAngleAxis().angle() < 1e-5
    # The ball, a robot, falls on the same ground as ever.
    (fallen,) = simulation.joint_states().position
    assert fallen == pytest.approx(-0.9, abs=1e-3)


def test_without_physics_things_stay_where_they_are(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.FALLING_BALL)
    options = ad.SimulationOptions(preset="kinematic")
    diagram = ad.build_diagram(robot, world=add_ground_and_cube, options=options)
    port = diagram.GetOutputPort("state")

    state = port.Eval(diagram.CreateDefaultContext())

    # A quaternion and a position, then the ball; then as many velocities less one.
    expected = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, EDGE / 2.0]
    assert state.size == 8 + 7
    assert sorted(state[:8]) == sorted([*expected, 0.0])


def test_a_function_must_not_finalize_the_plant(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        falling_ball(tmp_path, lambda plant: plant.Finalize())

    assert str(caught.value) == (
        "world: the function finalized the plant; the robots come after it"
    )


def test_what_is_neither_a_name_nor_a_function_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        falling_ball(tmp_path, 3)  # type: ignore[arg-type]

    assert str(caught.value) == (
        "world: expected a name, a file or a function of the plant, got 3; "
        "known: empty, house, house_table, void"
    )


@pytest.mark.slow
def test_the_world_of_the_docs_can_be_built():
    docs = Path(__file__).parents[2] / "docs/loading.md"
    programs = re.findall(r"```python\n(.*?)```", docs.read_text("utf-8"), re.DOTALL)
    (program,) = (text for text in programs if "def table" in text)
    names = {}

    exec(compile(program, "loading.md", "exec"), names)  # noqa: S102  our own text.

    plant = names["diagram"].GetSubsystemByName("plant")
    assert plant.GetBodyByName("box").default_mass() == 0.05
