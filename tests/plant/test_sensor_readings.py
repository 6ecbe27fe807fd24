"""Sensors measure what the physics does: closed forms, and a gripper with a box."""

import gc
import math
import re
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.messages import Quaternion, Vector3, Wrench
from arm_drake.worlds.world import World, add_world
from tests import models

IMU = (
    *(f"orientation.{axis}" for axis in "xyzw"),
    *(f"angular_velocity.{axis}" for axis in "xyz"),
    *(f"linear_acceleration.{axis}" for axis in "xyz"),
)
FORCES = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
POSE = (
    *(f"position.{axis}" for axis in "xyz"),
    *(f"orientation.{axis}" for axis in "xyzw"),
)

G = models.GRAVITY
GRAVITY = np.array([0.0, 0.0, -G])


def sensor(name: str, *interfaces: str, frame: str = "") -> str:
    """Return a `<sensor>` of `<ros2_control>`."""
    parameter = f'<param name="frame_id">{frame}</param>' if frame else ""
    states = "".join(f'<state_interface name="{i}"/>' for i in interfaces)
    return f'<sensor name="{name}">{parameter}{states}</sensor>'


def with_sensors(urdf: str, *sensors: str) -> str:
    """Return a robot with sensors in its `<ros2_control>`."""
    head, end = urdf.rsplit("</ros2_control>", 1)
    return f"{head}{''.join(sensors)}</ros2_control>{end}"


def simulate(
    folder: Path,
    urdf: str,
    yaml: str,
    *,
    world: World = "void",
    **options: object,
) -> ad.Simulation:
    (folder / "robot.urdf").write_text(urdf)
    (folder / "controllers.yaml").write_text(yaml)
    robot = ad.load_robot(
        folder / "robot.urdf", controllers=folder / "controllers.yaml", **options
    )
    assert not robot.report.errors, robot.report
    return ad.Simulation(ad.build_diagram(robot, world=world))


def controllers(**sections: str) -> str:
    """Return a YAML of controllers: by name, type and parameters."""
    rows, nodes = [], []
    for name, text in sections.items():
        kind, _, parameters = text.partition(" ")
        rows.append(f"    {name}: {{type: {kind}}}")
        nodes.append(f"{name}:\n  ros__parameters: {{{parameters}}}")
    manager = "controller_manager:\n  ros__parameters:\n    update_rate: 100\n"
    return manager + "\n".join(rows) + "\n" + "\n".join(nodes) + "\n"


def array(vector: Vector3 | Quaternion) -> np.ndarray:
    names = "xyzw" if isinstance(vector, Quaternion) else "xyz"
    return np.array([getattr(vector, name) for name in names])


def force(wrench: Wrench) -> np.ndarray:
    return np.concatenate([array(wrench.force), array(wrench.torque)])


def turned(axis: int, angle: float) -> np.ndarray:
    """Return the matrix of a rotation about an axis of the frame."""
    c, s = math.cos(angle), math.sin(angle)
    R = np.eye(3)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    R[one, one] = R[two, two] = c
    R[one, two], R[two, one] = -s, s
    return R


def matrix(q: np.ndarray) -> np.ndarray:
    """Return the matrix of a quaternion x, y, z, w of length 1."""
    (x, y, z), w = q[:3], q[3]
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * K + 2.0 * K @ K


# Of the sensor in the bob's link [m], [rad].
MOUNT, TILT = (0.1, 0.2, -0.3), (0.4, -0.2, 0.7)
R_LS = turned(2, TILT[2]) @ turned(1, TILT[1]) @ turned(0, TILT[0])

# Gazebo's tag of a sensor there.
TAG = f"""<gazebo reference="bob"><sensor name="{{}}" type="{{}}">
<pose>{" ".join(map(str, (*MOUNT, *TILT)))}</pose></sensor></gazebo>"""


def rows(sim: ad.Simulation, topic: str) -> Iterator[tuple[Any, float, float]]:
    """Yield messages of a pendulum's sensor, with position and velocity of the tick."""
    for _ in range(60):
        sim.run(0.01)
        message, rollout = sim.topic(topic).value(), sim.rollout()
        stamp = message.header.stamp
        time = stamp.sec + 1e-9 * stamp.nanosec
        row = int(np.argmin(np.abs(rollout.time - time)))
        assert abs(rollout.time[row] - time) < 1e-6
        yield message, rollout.position[row, 0], rollout.velocity[row, 0]
    # It did swing, through its lowest point.
    assert np.ptp(sim.rollout().position[:, 0]) > 1.0


def pendulum(folder: Path, sensors: str, tag: str, yaml: str) -> ad.Simulation:
    """Return a pendulum without friction that is let go at 1 rad."""
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    urdf = with_sensors(urdf, sensors).replace("</robot>", f"{tag}</robot>")
    return simulate(folder, urdf, yaml, initial_positions={"swing": 1.0})


@pytest.mark.slow
def test_an_imu_on_a_swinging_link_measures_the_closed_form(tmp_path: Path) -> None:
    yaml = controllers(
        imu="imu_sensor_broadcaster/IMUSensorBroadcaster sensor_name: imu, frame_id: x"
    )
    sim = pendulum(tmp_path, sensor("imu", *IMU), TAG.format("imu", "imu"), yaml)

    for message, q, w in rows(sim, "/imu/imu"):
        # The link turns about y by q: I q'' = -m g l sin(q).
        wdot = -models.MASS * G * models.LENGTH * math.sin(q) / models.INERTIA
        R_WL = turned(1, q)
        arm, turn, spin = R_WL @ MOUNT, np.array([0, w, 0]), np.array([0, wdot, 0])
        a = np.cross(spin, arm) + np.cross(turn, np.cross(turn, arm))
        R_WS = R_WL @ R_LS
        # A step's acceleration is that of its start: nothing but rounding is left.
        np.testing.assert_allclose(
            array(message.linear_acceleration), R_WS.T @ (a - GRAVITY), atol=1e-9
        )
        np.testing.assert_allclose(
            array(message.angular_velocity), R_WS.T @ turn, atol=1e-12
        )
        np.testing.assert_allclose(matrix(array(message.orientation)), R_WS, atol=1e-12)


def test_a_load_on_a_swinging_link_is_what_moves_it(tmp_path: Path) -> None:
    yaml = controllers(
        load="force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster "
        "sensor_name: load, frame_id: x"
    )
    tag = TAG.format("load", "force_torque").replace(
        "</pose>", "</pose><force_torque><frame>sensor</frame></force_torque>"
    )
    sim = pendulum(tmp_path, sensor("load", *FORCES), tag, yaml)

    for message, q, w in rows(sim, "/load/wrench"):
        wdot = -models.MASS * G * models.LENGTH * math.sin(q) / models.INERTIA
        R_WL = turned(1, q)
        turn, spin = np.array([0, w, 0]), np.array([0, wdot, 0])
        centre = R_WL @ [0.0, 0.0, -models.LENGTH]
        a = np.cross(spin, centre) + np.cross(turn, np.cross(turn, centre))
        # What the bob does to the base: its weight less what moves it; at the joint,
        # which is free, its moment is 0.
        f = models.MASS * (GRAVITY - a)
        R_WS = R_WL @ R_LS
        expected = np.concatenate([R_WS.T @ f, np.zeros(3)])
        np.testing.assert_allclose(force(message.wrench), expected, atol=1e-9)


def test_forces_of_the_parent_on_the_child_have_the_other_sign(tmp_path: Path) -> None:
    readings = []
    for direction in ("child_to_parent", "parent_to_child"):
        tag = f"""<gazebo reference="swing"><sensor name="load" type="force_torque">
        <force_torque><measure_direction>{direction}</measure_direction></force_torque>
        </sensor></gazebo>"""
        yaml = controllers(
            load="force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster "
            "sensor_name: load, frame_id: x"
        )
        sim = pendulum(tmp_path, sensor("load", *FORCES), tag, yaml)
        sim.run(0.1)
        readings.append(force(sim.topic("/load/wrench").value().wrench))

    np.testing.assert_array_equal(readings[0], -readings[1])
    assert np.linalg.norm(readings[0]) > 1.0


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.0])
def test_a_compensated_wrench_of_a_held_tool_is_nothing(
    tmp_path: Path, angle: float
) -> None:
    chain = {
        "name": "gravity",
        "type": "control_filters/GravityCompensationWrench",
        "params": {
            "world_frame": "base",
            "sensor_frame": "bob",
            "tool": {"mass": models.MASS, "CoG": [0.0, 0.0, -models.LENGTH]},
        },
    }
    yaml = controllers(
        hold="position_controllers/JointGroupPositionController joints: [swing]",
        load="force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster "
        f"sensor_name: load, frame_id: bob, sensor_filter_chain: {{filter1: {chain}}}",
    )
    urdf = with_sensors(models.pendulum(), sensor("load", *FORCES))
    tag = """<gazebo reference="swing"><sensor name="load" type="force_torque"/>
    </gazebo></robot>"""
    urdf = urdf.replace("</robot>", tag)
    sim = simulate(tmp_path, urdf, yaml, initial_positions={"swing": angle})

    sim.run(1.0)

    measured = force(sim.topic("/load/wrench").value().wrench)
    weight = models.MASS * models.GRAVITY
    # About y, the joint's axis, along which the bob is at (-sin, 0, -cos) L.
    moment = -weight * models.LENGTH * math.sin(angle)
    assert measured[4] == pytest.approx(moment, abs=1e-6)
    assert np.linalg.norm(measured[:3]) == pytest.approx(weight, abs=1e-6)
    filtered = force(sim.topic("/load/wrench_filtered").value().wrench)
    # It comes to rest within a second.
    np.testing.assert_allclose(filtered, np.zeros(6), atol=1e-6)


def test_a_pose_is_that_of_the_link_in_the_frame(tmp_path: Path) -> None:
    yaml = controllers(
        world="pose_broadcaster/PoseBroadcaster pose_name: bob, frame_id: map",
        inverse="pose_broadcaster/PoseBroadcaster pose_name: root, frame_id: bob, "
        "tf.child_frame_id: base",
    )
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    urdf = with_sensors(urdf, sensor("bob", *POSE), sensor("root", *POSE))
    pose = (0.1, 0.2, 0.3, 0.0, 0.0, 0.5)
    sim = simulate(tmp_path, urdf, yaml, initial_positions={"swing": 1.0}, pose=pose)

    sim.run(0.001)

    message = sim.topic("/world/pose").value().pose
    np.testing.assert_allclose(array(message.position), pose[:3], atol=1e-12)
    np.testing.assert_allclose(
        matrix(array(message.orientation)), turned(2, 0.5) @ turned(1, 1.0), atol=1e-12
    )
    message = sim.topic("/inverse/pose").value().pose
    np.testing.assert_allclose(array(message.position), np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(
        matrix(array(message.orientation)), turned(1, -1.0), atol=1e-12
    )


@pytest.mark.parametrize("height", [0.002, 0.05])
@pytest.mark.parametrize("pitch", [0.0, 1e-3])
def test_a_beam_along_the_ground_meets_what_is_in_front(
    tmp_path: Path, height: float, pitch: float
) -> None:
    yaml = controllers(
        eye="range_sensor_broadcaster/RangeSensorBroadcaster "
        "sensor_name: eye, frame_id: bob"
    )
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    sim = simulate(
        tmp_path,
        with_sensors(urdf, sensor("eye", "range")),
        yaml,
        initial_positions={"swing": pitch},
        pose=(0, 0, height, 0, 0, 0),
        world="empty",
    )

    sim.run(0.001)

    expected = height / math.sin(pitch) if pitch else math.inf
    assert sim.topic("/eye/range").value().range == pytest.approx(expected, abs=1e-3)


def make_eye(folder: Path, angle: float) -> ad.Simulation:
    """Return a simulation of a beam from the bob, which is a ball."""
    # The beam starts in the origin of the bob, 1 m above the ground, and goes along x,
    # down by the pitch of the joint.
    yaml = controllers(
        eye="range_sensor_broadcaster/RangeSensorBroadcaster "
        "sensor_name: eye, frame_id: bob"
    )
    control = models.ros2_control(states=("swing",))
    urdf = models.pendulum(control=control).replace(
        '<link name="bob">', f'<link name="bob">{models.sphere(0.05)}'
    )
    urdf = with_sensors(urdf, sensor("eye", "range"))
    return simulate(
        folder,
        urdf,
        yaml,
        initial_positions={"swing": angle},
        pose=(0, 0, 1, 0, 0, 0),
        world="empty",
    )


@pytest.mark.parametrize("world", ["empty", "void"])
def test_a_beam_meets_another_link_of_the_robot(tmp_path: Path, world: World) -> None:
    yaml = controllers(
        eye="range_sensor_broadcaster/RangeSensorBroadcaster "
        "sensor_name: eye, frame_id: bob"
    )
    control = models.ros2_control(states=("swing",))
    ball = models.sphere(0.5).replace("<collision>", '<collision><origin xyz="2 0 0"/>')
    urdf = models.pendulum(control=control).replace(
        '<link name="base"/>', f'<link name="base">{ball}</link>'
    )
    sim = simulate(
        tmp_path,
        with_sensors(urdf, sensor("eye", "range")),
        yaml,
        initial_positions={"swing": 0.0},
        pose=(0, 0, 1, 0, 0, 0),
        world=world,
    )

    sim.run(0.001)

    assert sim.topic("/eye/range").value().range == pytest.approx(1.5, abs=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
def test_a_range_is_the_way_to_what_is_in_front(tmp_path: Path, angle: float) -> None:
    sim = make_eye(tmp_path, angle)

    sim.run(0.001)

    expected = 1.0 / math.sin(angle) if angle else math.inf
    assert sim.topic("/eye/range").value().range == pytest.approx(expected, abs=1e-5)


@pytest.mark.slow
def test_what_reads_shapes_is_freed_with_its_diagram(tmp_path: Path) -> None:
    diagram = weakref.ref(make_eye(tmp_path, 0.5).diagram)

    gc.collect()

    assert diagram() is None


def test_a_joint_reports_its_acceleration(tmp_path: Path) -> None:
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    urdf = urdf.replace(
        '<state_interface name="effort"/>',
        '<state_interface name="effort"/><state_interface name="acceleration"/>',
    )
    yaml = controllers(
        all="state_interfaces_broadcaster/StateInterfacesBroadcaster "
        "interfaces: [swing/position, swing/acceleration]"
    )
    sim = simulate(tmp_path, urdf, yaml, initial_positions={"swing": 1.0})

    for _ in range(20):
        sim.run(0.01)
        q, vdot = sim.topic("/all/values").value().values
        expected = -models.MASS * G * models.LENGTH * math.sin(q) / models.INERTIA
        assert vdot == pytest.approx(expected, abs=1e-9)


def test_accelerations_of_joints_are_each_joints_own(tmp_path: Path) -> None:
    # The file has the tip first, the plant numbers from the base on.
    states = models.ros2_control(states=("elbow", "shoulder"))
    urdf = models.TIP_FIRST.replace(models.ros2_control("elbow", "shoulder"), states)
    urdf = urdf.replace(
        '<state_interface name="effort"/>',
        '<state_interface name="effort"/><state_interface name="acceleration"/>',
    )
    names = ["elbow/acceleration", "shoulder/acceleration"]
    yaml = controllers(
        all="state_interfaces_broadcaster/StateInterfacesBroadcaster "
        f"interfaces: [{', '.join(names)}, elbow/velocity, shoulder/velocity]"
    )
    start = {"elbow": 0.5, "shoulder": 1.0}
    sim = simulate(tmp_path, urdf, yaml, initial_positions=start)

    sim.run(0.011)  # The tick at 10 ms.
    early = np.array(sim.topic("/all/values").value().values)
    sim.run(0.01)
    late = np.array(sim.topic("/all/values").value().values)

    # What the velocities have gained in between, to first order.
    gained = (late[2:] - early[2:]) / 0.01
    np.testing.assert_allclose((early[:2] + late[:2]) / 2.0, gained, rtol=1e-2)
    assert abs(gained[0] - gained[1]) > 1.0


# A hand on a slide, with a sensor of forces above it. Of its two fingers [m].
FINGER = (0.02, 0.04, 0.08)
BOX_MASS, BOX_SIZE = 1.0, (0.06, 0.06, 0.06)


def crane() -> str:
    """Return a robot that lifts a hand with two fingers, 0.5 m above the ground."""

    def link(name: str, mass: float, geometry: str = "") -> str:
        return f"""<link name="{name}"><inertial><mass value="{mass}"/>
        <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
        {geometry}</link>"""

    def slide(name: str, parent: str, child: str, xyz: str, axis: str) -> str:
        limit = 'lower="-0.3" upper="0.3" effort="200" velocity="2"'
        return models.joint(
            name, parent, child, xyz=xyz, axis=axis, type="prismatic", limit=limit
        )

    x, y, z = FINGER
    pad = f"""<collision><origin xyz="0 0 {-z / 2}"/><geometry>
    <box size="{x} {y} {z}"/></geometry></collision>"""
    lift = slide("lift", "base", "arm", "0 0 0.5", "0 0 1")
    left = slide("left", "hand", "left_finger", "0.06 0 0", "-1 0 0")
    right = slide("right", "hand", "right_finger", "-0.06 0 0", "1 0 0")
    wrist = models.joint("wrist", "arm", "hand", type="fixed", xyz="0 0 -0.1")
    control = models.ros2_control("lift", "left", "right")
    fingers = models.ros2_control("left", "right", command="effort")
    control = models.ros2_control("lift")
    hand = sensor("wrist_sensor", *FORCES, frame="hand")
    fingers = fingers.replace('name="hardware"', 'name="fingers"')
    return f"""<robot name="crane"><link name="base"/>{link("arm", 1.0)}
    {link("hand", 0.5)}{link("left_finger", 0.1, pad)}{link("right_finger", 0.1, pad)}
    {lift}{wrist}{left}{right}
    {with_sensors(control, hand)}{fingers}</robot>"""


def with_box(plant: MultibodyPlant) -> None:
    """Add the ground, and a box on it, between the fingers."""
    add_world(plant, "empty")
    inertia = SpatialInertia.SolidBoxWithMass(BOX_MASS, *BOX_SIZE)
    body = plant.AddRigidBody("box", plant.AddModelInstance("box"), inertia)
    plant.RegisterCollisionGeometry(
        body, RigidTransform(), Box(*BOX_SIZE), "box", CoulombFriction(1.0, 1.0)
    )
    X_WB = RigidTransform([0.0, 0.0, BOX_SIZE[2] / 2.0])
    plant.SetDefaultFloatingBaseBodyPose(body, X_WB)


@pytest.mark.slow
def test_a_hand_that_holds_a_box_feels_its_weight(tmp_path: Path) -> None:
    forward = "forward_command_controller/ForwardCommandController"
    yaml = controllers(
        lift=f"{forward} joints: [lift], interface_name: position",
        grip=f"{forward} joints: [left, right], interface_name: effort",
        load="force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster "
        "sensor_name: wrist_sensor, frame_id: hand",
    )
    sim = simulate(tmp_path, crane(), yaml, world=with_box)
    weight = np.array([0.0, 0.0, -BOX_MASS * G])

    def read() -> np.ndarray:
        return force(sim.topic("/load/wrench").value().wrench)

    # The hand goes down, closes, and lifts the box by 0.2 m.
    sim.controller("lift").command([-0.3])
    sim.run(1.5)
    empty = read()
    sim.controller("grip").command([60.0, 60.0])
    sim.run(1.0)
    sim.controller("lift").command([-0.1])
    sim.run(2.0)
    loaded = read()

    # Hand and fingers hang in it, then the box as well, below its middle.
    np.testing.assert_allclose(empty[:3], [0.0, 0.0, -0.7 * G], atol=1e-6)
    np.testing.assert_allclose(loaded[:3] - empty[:3], weight, atol=0.01 * BOX_MASS * G)
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    box = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("box"))
    assert box.translation()[2] > 0.15


@pytest.mark.slow
def test_the_program_of_the_docs_runs() -> None:
    docs = Path(__file__).parents[2] / "docs/sensors.md"
    text = docs.read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {}

    exec(compile(program, "sensors.md", "exec"), names)  # noqa: S102  our own text.

    assert names["contacts"].states == ()


def test_sensors_of_several_robots_are_their_own(tmp_path: Path) -> None:
    yaml = controllers(
        imu="imu_sensor_broadcaster/IMUSensorBroadcaster sensor_name: imu, frame_id: x"
    )
    urdf = models.pendulum(control=models.ros2_control(states=("swing",)))
    urdf = with_sensors(urdf, sensor("imu", *IMU, frame="bob"))
    (tmp_path / "robot.urdf").write_text(urdf)
    (tmp_path / "controllers.yaml").write_text(yaml)
    robots = [
        ad.load_robot(
            tmp_path / "robot.urdf",
            controllers=tmp_path / "controllers.yaml",
            name=name,
            initial_positions={"swing": angle},
        )
        for name, angle in (("one", 0.0), ("two", 1.0))
    ]

    sim = ad.Simulation(ad.build_diagram(robots, world="void"))
    sim.run(0.001)

    for name, angle in (("one", 0.0), ("two", 1.0)):
        message = sim.topic(f"/{name}/imu/imu").value()
        np.testing.assert_allclose(
            matrix(array(message.orientation)), turned(1, angle), atol=1e-12
        )
