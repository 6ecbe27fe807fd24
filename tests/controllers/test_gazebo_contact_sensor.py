"""Contact sensors feel what touches their shapes, as large as it presses."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.messages import Vector3
from arm_drake.messages.sensors import ContactsState
from tests import models
from tests.robots import load_real_robot

TOPIC = "/world/empty/model/falling_ball/link/ball/sensor/bumper/contact"
WEIGHT = models.MASS * models.GRAVITY

# Fields of the plugin of Gazebo Classic.
PLUGIN = """<plugin name="p" filename="libgazebo_ros_bumper.so">
  <ros><namespace>touch</namespace><remapping>bumper_states:=ball</remapping></ros>
  {}</plugin>"""


def with_sensor(inside: str = "", *, reference: str = "ball") -> str:
    """Return a ball that falls, with a contact sensor."""
    tag = f"""<gazebo reference="{reference}">
      <sensor name="bumper" type="contact">{inside}</sensor></gazebo>"""
    return models.FALLING_BALL.replace("</robot>", f"{tag}</robot>")


def load(folder: Path, urdf: str, **options: object) -> ad.Robot:
    (folder / "robot.urdf").write_text(urdf)
    return ad.load_robot(folder / "robot.urdf", **options)


def array(vector: Vector3) -> np.ndarray:
    return np.array([vector.x, vector.y, vector.z])


def rest(robot: ad.Robot, topic: str = TOPIC) -> ContactsState:
    """Return what is felt when the ball lies on the ground."""
    sim = ad.Simulation(ad.build_diagram(robot))
    assert sim.topic(topic).value().states == ()
    sim.run(0.2)
    assert sim.topic(topic).value().states == ()  # It falls for 0.42 s.
    sim.run(2.8)
    message: ContactsState = sim.topic(topic).value()
    return message


@pytest.mark.slow
def test_a_ball_on_the_ground_feels_its_weight(tmp_path: Path) -> None:
    message = rest(load(tmp_path, with_sensor()))

    (state,) = message.states
    assert message.header.frame_id == "world"
    assert message.header.stamp.sec == 3
    assert state.collision1_name == "falling_ball::ball::ball_collision"
    assert state.collision2_name == "world::ground"
    # It has come to rest: what is left of the impact is less than 1e-6 of the weight.
    (wrench,) = state.wrenches
    np.testing.assert_allclose(array(wrench.force), [0, 0, WEIGHT], atol=1e-5)
    np.testing.assert_allclose(array(state.total_wrench.force), [0, 0, WEIGHT], 1e-5)
    # Under its middle, in which its origin is: nothing turns it.
    np.testing.assert_allclose(array(state.total_wrench.torque), np.zeros(3), atol=1e-6)
    (point,), (normal,), (depth,) = (
        state.contact_positions,
        state.contact_normals,
        state.depths,
    )
    np.testing.assert_allclose(array(point), np.zeros(3), atol=1e-3)
    np.testing.assert_allclose(array(normal), [0, 0, 1], atol=1e-12)
    assert 0.0 < depth < 1e-3


@pytest.mark.slow
def test_the_plugin_of_classic_names_topic_and_frame(tmp_path: Path) -> None:
    plugin = PLUGIN.format("<frame_name>ball</frame_name>")
    # The whole robot is turned: the ball's frame has its z axis along the world's y.
    urdf = with_sensor(plugin).replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>')
    urdf = urdf.replace('<origin xyz="0 0 1"/>', '<origin xyz="0 1 0"/>')
    robot = load(tmp_path, urdf, pose=(0, 0, 0, np.pi / 2.0, 0, 0))

    message = rest(robot, "/touch/ball")

    (state,) = message.states
    assert message.header.frame_id == "ball"
    np.testing.assert_allclose(
        array(state.wrenches[0].force), [0, WEIGHT, 0], atol=1e-5
    )
    np.testing.assert_allclose(array(state.contact_normals[0]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(
        array(state.contact_positions[0]), [0, -0.1, 0], atol=1e-3
    )
    np.testing.assert_allclose(
        array(state.total_wrench.force), [0, WEIGHT, 0], atol=1e-5
    )


@pytest.mark.slow
def test_a_sensor_feels_with_the_shapes_that_it_names(tmp_path: Path) -> None:
    high = '<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.05"/>'
    urdf = models.FALLING_BALL.replace(
        "<collision>", f"{high}</geometry></collision><collision>", 1
    )
    tags = "".join(
        f"""<gazebo reference="ball"><sensor name="{shape}" type="contact">
        <contact><collision>{shape}</collision><topic>{shape}</topic></contact>
        </sensor></gazebo>"""
        for shape in ("ball_collision", "ball_collision_1")
    )
    robot = load(tmp_path, urdf.replace("</robot>", f"{tags}</robot>"))

    assert not robot.report.errors
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(3.0)

    assert sim.topic("/ball_collision").value().states == ()
    (state,) = sim.topic("/ball_collision_1").value().states
    assert state.collision1_name.endswith("::ball_collision_1")


@pytest.mark.slow
def test_the_torque_is_about_the_link(tmp_path: Path) -> None:
    # The ball is beside its link's origin, which slides along z and can't turn.
    moved = with_sensor().replace(
        "<collision>", '<collision><origin xyz="0.3 -0.2 0"/>', 1
    )

    (state,) = rest(load(tmp_path, moved)).states

    wrench = state.total_wrench
    np.testing.assert_allclose(array(wrench.force), [0, 0, WEIGHT], atol=1e-5)
    expected = np.cross([0.3, -0.2, -0.1], [0, 0, WEIGHT])
    np.testing.assert_allclose(array(wrench.torque), expected, atol=1e-2)
    np.testing.assert_array_equal(array(state.wrenches[0].torque), np.zeros(3))


@pytest.mark.slow
def test_a_sensor_that_is_not_active_tells_nothing(tmp_path: Path) -> None:
    options = ad.SimulationOptions(inactive=("bumper",))
    robot = load(tmp_path, with_sensor())
    sim = ad.Simulation(ad.build_diagram(robot, options=options))

    sim.run(3.0)

    assert sim.topic(TOPIC).value() == ContactsState()


@pytest.mark.slow
def test_what_is_held_by_areas_is_felt_along_their_normals(tmp_path: Path) -> None:
    def add_box(plant: MultibodyPlant) -> None:
        inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.2, 0.2, 0.2)
        body = plant.AddRigidBody("box", plant.AddModelInstance("box"), inertia)
        friction = CoulombFriction(1.0, 1.0)
        shape = Box(0.2, 0.2, 0.2)
        pose = RigidTransform()
        plant.RegisterCollisionGeometry(body, pose, shape, "box", friction)
        X_WB = RigidTransform([0.0, 0.0, 0.3001])
        plant.SetDefaultFloatingBaseBodyPose(body, X_WB)

    table = """<link name="table"><collision><geometry><box size="1 1 0.4"/></geometry>
      </collision></link><gazebo reference="table"><sensor name="t" type="contact">
      <topic>table</topic></sensor></gazebo>"""
    robot = load(tmp_path, f'<robot name="desk">{table}</robot>')
    sim = ad.Simulation(ad.build_diagram(robot, world=add_box))

    sim.run(1.0)

    (state,) = sim.topic("/table").value().states
    assert state.collision2_name == "box::box::box_collision"
    # The box of 1 kg presses the table down.
    force = array(state.total_wrench.force)
    np.testing.assert_allclose(force, [0, 0, -models.GRAVITY], atol=1e-2)
    np.testing.assert_allclose(array(state.contact_normals[0]), [0, 0, -1], atol=1e-6)


@pytest.mark.slow
def test_all_contacts_of_a_robot_are_an_output(tmp_path: Path) -> None:
    robot = load(tmp_path, models.FALLING_BALL)
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(3.0)

    port = sim.diagram.GetOutputPort("contacts")
    (state,) = port.Eval(sim.simulator.get_context()).states

    np.testing.assert_allclose(array(state.total_wrench.force), [0, 0, WEIGHT], 1e-5)


@pytest.mark.slow
def test_touching_links_each_feel_the_other(tmp_path: Path) -> None:
    tags = "".join(
        f"""<gazebo reference="{link}"><sensor name="{link}_sensor" type="contact">
        <topic>{link}</topic></sensor></gazebo>"""
        for link in ("ball", "table")
    )
    table = f"""<link name="table">
      <collision><geometry><box size="1 1 0.2"/></geometry></collision></link>
      {models.joint("fix", "base", "table", type="fixed", xyz="0 0 0.2")}"""
    urdf = models.FALLING_BALL.replace("</robot>", f"{table}{tags}</robot>")
    robot = load(tmp_path, urdf)
    options = ad.SimulationOptions(self_collision=True)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))

    sim.run(3.0)

    forces = []
    for link, other in (("ball", "table"), ("table", "ball")):
        (state,) = sim.topic(f"/{link}").value().states
        assert state.collision1_name == f"falling_ball::{link}::{link}_collision"
        assert state.collision2_name == f"falling_ball::{other}::{other}_collision"
        forces.append(array(state.wrenches[0].force))
    np.testing.assert_allclose(forces[0], [0, 0, WEIGHT], atol=1e-5)
    np.testing.assert_array_equal(forces[0], -forces[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("urdf", "severity", "message"),
    [
        (
            with_sensor(reference="bal"),
            "error",
            "contact sensor 'bumper': its reference is no link, 'bal'; "
            "did you mean 'ball'?",
        ),
        (
            with_sensor(reference="base"),
            "error",
            "contact sensor 'bumper': link 'base' has no <collision>",
        ),
        (
            with_sensor("<contact><collision>hull</collision></contact>"),
            "warning",
            "contact sensor 'bumper': the robot has no collision shape 'hull'; link "
            "'ball' has ball_collision; it feels with these",
        ),
        (
            with_sensor(PLUGIN.format("<frame_name>tool</frame_name>")),
            "warning",
            "contact sensor 'bumper': frame_name: no link 'tool'",
        ),
    ],
)
def test_a_sensor_that_cannot_be_as_it_is_written_is_reported(
    tmp_path: Path, urdf: str, severity: str, message: str
) -> None:
    robot = load(tmp_path, urdf)

    lines = [str(e) for e in robot.report if e.severity == severity]
    assert any(message in line for line in lines), str(robot.report)


@pytest.mark.slow
def test_what_has_an_effect_is_not_reported_as_ignored(tmp_path: Path) -> None:
    robot = load(tmp_path, with_sensor(PLUGIN.format("")))

    assert "bumper" not in str(robot.report)


@pytest.mark.slow
def test_the_doosan_has_its_bumper() -> None:
    robot = load_real_robot("doosan_a0912")
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)

    message = sim.topic("/contact_sensor/bumper_link6").value()

    assert message == ContactsState(message.header)
    assert message.header.frame_id == "link6"
