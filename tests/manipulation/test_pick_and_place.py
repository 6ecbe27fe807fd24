"""Picking and placing: where things are afterwards says whether it worked."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

import arm_drake as ad
from arm_drake.errors import MotionError
from arm_drake.simulation.motion_files import load_motion, parse_motion
from arm_drake.worlds.world import add_world
from tests.snippets import ROOT, read_blocks

# The myCobot's plate is 25 mm below its origin.
POSE = (0.0, 0.0, 0.026, 0.0, 0.0, 0.0)

BOX = ad.Thing("box", "box", (0.025, 0.025, 0.04), mass=0.02)


def simulate(*things: ad.Thing) -> ad.Simulation:
    """Return a simulation of the myCobot with things on the ground."""

    def add_things(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        for thing in things:
            thing.add_to(plant)

    robot = ad.load_robot(
        "mycobot_280", xacro_args={"control": "ros2_control"}, pose=POSE
    )
    return ad.Simulation(ad.build_diagram(robot, world=add_things))


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
    simulation = simulate(at(BOX, 0.2, 0.05, 0.4))
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


@pytest.mark.slow
def test_the_page_shows_what_works() -> None:
    page = ROOT / "docs/manipulation.md"
    (program,) = (b.text for b in read_blocks(page) if b.language == "python")
    names: dict[str, Any] = {}

    exec(program, names)  # noqa: S102

    X = pose_of(names["simulation"], "box")
    assert X.translation() == pytest.approx([0.15, -0.15, 0.02], abs=5e-3)


@pytest.mark.slow
def test_the_tutorial_takes_the_box_from_the_table_into_the_bin() -> None:
    robot = ad.load_robot("mycobot_280", xacro_args={"control": "ros2_control"})
    simulation = ad.Simulation(ad.build_diagram(robot, world="house_table"))
    before = pose_of(simulation, "box").translation()

    simulation.run(12.0, load_motion("pick_and_place", robot=robot))

    assert before == pytest.approx([0.2, 0.05, 0.07])
    assert simulation.rejected == []
    # On the bin's bottom, 16 mm high; and the arm is home.
    X = pose_of(simulation, "box")
    assert X.translation() == pytest.approx([0.05, -0.22, 0.036], abs=5e-3)
    assert np.abs(simulation.joint_states().position[:6]).max() < 0.02


def test_a_step_that_can_not_be_done_is_told_with_its_place() -> None:
    simulation = simulate(at(BOX, 1.2, 0.0))
    motion = parse_motion(
        [{"at": 0.0, "pick": "box"}, {"at": 0.0, "place": [0.0, 0.2, 0.0]}]
    )

    simulation.run(0.5, motion)

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


def test_what_is_out_of_reach_is_said() -> None:
    simulation = simulate(at(BOX, 1.2, 0.0))

    picked = ad.pick(simulation, "box")

    assert not picked
    assert "the arm reaches none" in picked.reason


def test_an_unknown_thing_or_option_is_an_error_that_names_those_there_are() -> None:
    simulation = simulate(at(BOX, 0.2, 0.0))

    with pytest.raises(ad.ArmDrakeError, match=r"no thing 'bx'.*'box'"):
        ad.pick(simulation, "bx")
    with pytest.raises(ad.ArmDrakeError, match=r"no option 'lft'.*'lift'"):
        ad.pick(simulation, "box", lft=0.1)
    with pytest.raises(ad.ArmDrakeError, match=r"lift: expected a distance"):
        ad.pick(simulation, "box", lift=-0.1)
