"""Small SDF worlds, as text."""

from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.worlds.world import add_world

# A table, its top at a height [m].
TABLE_HEIGHT = 0.3


def box(size: str, *, pose: str = "0 0 0 0 0 0", tag: str = "collision") -> str:
    return f"""
      <{tag} name="{tag}"><pose>{pose}</pose>
        <geometry><box><size>{size}</size></box></geometry></{tag}>"""


def model(name: str, link: str, *, inside: str = "", static: bool = True) -> str:
    return f"""
    <model name="{name}"><static>{str(static).lower()}</static>{inside}
      <link name="link">{link}</link></model>"""


TABLE = model("table", box("1 1 0.05", pose=f"0 0 {TABLE_HEIGHT - 0.025} 0 0 0"))

# A ball of 0.05 m and 0.1 kg, 0.05 m above the table.
BALL = f"""
    <model name="ball"><pose>0.2 0 {TABLE_HEIGHT + 0.1} 0 0 0</pose><link name="link">
      <inertial><mass>0.1</mass><inertia>
        <ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial>
      <collision name="c"><geometry><sphere><radius>0.05</radius></sphere></geometry>
      </collision></link></model>"""


def write(folder: Path, content: str, *, version: str = "1.6") -> Path:
    """Write a world to a file."""
    path = folder / "test.world"
    path.write_text(
        f'<?xml version="1.0"?>\n<sdf version="{version}">\n'
        f'<world name="lab">{content}\n</world></sdf>'
    )
    return path


def write_model(folder: Path, name: str, content: str, *, version: str = "1.6") -> Path:
    """Write the folder of a model that can be included."""
    place = folder / name
    place.mkdir(parents=True)
    path = place / "model.sdf"
    path.write_text(f'<sdf version="{version}">{content}</sdf>')
    (place / "model.config").write_text(
        f'<model><name>{name}</name><sdf version="{version}">model.sdf</sdf></model>'
    )
    return path


def make_plant(path: Path) -> tuple[MultibodyPlant, SceneGraph]:
    """Return a plant with nothing but a world."""
    plant, scene_graph = MultibodyPlant(1e-3), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    add_world(plant, path)
    plant.Finalize()
    return plant, scene_graph


def frame_pose(plant: MultibodyPlant, name: str, frame: str = "link") -> RigidTransform:
    """Return where a link of a model stands."""
    context = plant.CreateDefaultContext()
    instance = plant.GetModelInstanceByName(name)
    return plant.GetFrameByName(frame, instance).CalcPoseInWorld(context)


def shapes(scene_graph: SceneGraph) -> dict[str, np.ndarray]:
    """Return where shapes of the world body are, by their names."""
    inspector = scene_graph.model_inspector()
    return {
        inspector.GetName(g): np.array(inspector.GetPoseInFrame(g).translation())
        for g in inspector.GetAllGeometryIds()
    }
