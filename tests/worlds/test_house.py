"""The house: every piece is there, at its place, to be seen and to be bumped into."""

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FrameIndex, world_index

import arm_drake as ad
from arm_drake.description.entry import models_folder
from arm_drake.worlds.world import add_world, load_world
from tests import models
from tests.robots import real_robot

# Pieces of the tutorial's house: models of furniture, and of the house itself.
NUM_PIECES, NUM_KINDS = 86, 63

FILE = models_folder() / "worlds/house/model.sdf"

# What is too flat to collide with, or is the ground.
FLAT = {"Carpet_01", "FloorB_01"}


@pytest.fixture(scope="module")
def scene() -> tuple[MultibodyPlant, SceneGraph]:
    plant, scene_graph = MultibodyPlant(1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_world(plant, "house")
    plant.Finalize()
    return plant, scene_graph


def kind_of(piece: str) -> str:
    """Return a piece's name without its number."""
    return piece.rpartition("_")[0]


def rounded(kind: str, X: RigidTransform) -> tuple[object, ...]:
    # Positions and angles are written with six digits behind the point.
    angles = np.round(RollPitchYaw(X.rotation()).vector(), 6) + 0.0
    return (kind, *np.round(X.translation(), 6).tolist(), *angles.tolist())


@pytest.mark.slow
def test_every_piece_of_the_tutorials_house_is_at_its_place(
    scene: tuple[MultibodyPlant, SceneGraph],
) -> None:
    path = real_robot("mycobot_280/mycobot_gazebo/worlds/house.world")
    expected: Counter[tuple[object, ...]] = Counter()
    for element in ET.parse(path).getroot().iter("model"):  # noqa: S314
        uri = (element.findtext("include/uri") or "").strip()
        pose = np.array([float(x) for x in (element.findtext("pose") or "").split()])
        X_WM = RigidTransform(RollPitchYaw(pose[3:]), pose[:3])
        kind = uri.removeprefix("model://aws_robomaker_residential_")
        expected[rounded(kind, X_WM)] += 1
    plant, _ = scene
    context = plant.CreateDefaultContext()
    instance = plant.GetModelInstanceByName("house")
    frames = [plant.get_frame(FrameIndex(i)) for i in range(plant.num_frames())]

    found = Counter(
        rounded(kind_of(frame.name()), frame.CalcPoseInWorld(context))
        for frame in frames
        if frame.model_instance() == instance
    )

    assert found == expected


def test_every_piece_is_seen_and_what_is_not_flat_collides(
    scene: tuple[MultibodyPlant, SceneGraph],
) -> None:
    inspector = scene[1].model_inspector()
    seen, solid = (
        {
            inspector.GetName(geometry).split("::")[1]
            for geometry in inspector.GetAllGeometryIds(role)
            if inspector.GetName(geometry).startswith("house::")
        }
        for role in (Role.kIllustration, Role.kProximity)
    )

    pieces = {
        link.get("name", "")
        for link in ET.parse(FILE).getroot().iter("link")  # noqa: S314
        if link.find("visual") is not None
    }
    assert len(pieces) == NUM_PIECES
    assert len({kind_of(piece) for piece in pieces}) == NUM_KINDS
    assert seen == pieces
    assert solid == {piece for piece in pieces if kind_of(piece) not in FLAT}


@pytest.mark.parametrize("name", ["house", "house_table"])
def test_the_house_is_read_as_it_is_written(name: str) -> None:
    assert len(load_world(name).report) == 0


def test_cameras_see_the_house_as_the_world(
    scene: tuple[MultibodyPlant, SceneGraph],
) -> None:
    inspector = scene[1].model_inspector()
    labels = {
        int(properties.GetProperty("label", "id"))
        for geometry in inspector.GetAllGeometryIds(Role.kPerception)
        if (properties := inspector.GetPerceptionProperties(geometry)) is not None
    }

    assert labels == {int(world_index())}


def test_the_house_adds_no_bodies(scene: tuple[MultibodyPlant, SceneGraph]) -> None:
    assert scene[0].num_bodies() == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "height"),
    [
        # The kitchen table, beside its chairs and dishes.
        ((6.55, 0.62), 0.78),
        # The floor where robots stand.
        ((0.0, 0.0), 0.0),
        # On top of the refrigerator.
        ((9.0, -1.03), 1.88),
    ],
)
def test_a_ball_lands_on_the_furniture(
    tmp_path: Path, place: tuple[float, float], height: float
) -> None:
    pose = (*place, height, 0.0, 0.0, 0.0)
    robot = models.load(tmp_path, models.FALLING_BALL, pose=pose)
    simulation = ad.Simulation(ad.build_diagram(robot, world="house"))

    simulation.advance_to(1.0)

    # Its slide begins 1 m above the pose, and its radius is 0.1 m.
    (fallen,) = simulation.joint_states().position
    assert fallen == pytest.approx(-0.9, abs=1e-3)


@pytest.mark.slow
def test_a_robot_at_the_origin_has_room() -> None:
    robot = ad.load_robot("doosan_a0912")

    simulation = ad.Simulation(ad.build_diagram(robot, world="house"))

    assert "overlap" not in str(simulation.report)
    plant = simulation.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(simulation.simulator.get_context())
    query = plant.get_geometry_query_input_port().Eval(context)
    inspector = query.inspector()
    for height in np.arange(0.1, 1.6, 0.1):
        near = [
            (inspector.GetName(d.id_G), d.distance)
            for d in query.ComputeSignedDistanceToPoint([0.0, 0.0, height], 0.6)
            if inspector.GetName(d.id_G).startswith("house::")
        ]
        assert near == []
