"""Bases with mecanum and omni wheels go where they are told, also sideways."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

import arm_drake as ad
from arm_drake.messages import Twist, Vector3
from tests import models

RADIUS, WIDTH, MASS = 0.05, 0.04, 0.5

# Wheels of the mecanum base [m]; how far those of the omni base are from its middle.
CORNERS = {"fl": (0.15, 0.12), "fr": (0.15, -0.12), "rr": (-0.15, -0.12)}
CORNERS["rl"] = (-0.15, 0.12)
REACH = 0.15

PERIOD = 0.1

# Of the plant [s]; odometry is compared at the default, a fifth of it.
STEP = 5e-3


def wheel(name: str, x: float, y: float, yaw: float, *, axis: str = "0 1 0") -> str:
    """Return a wheel whose axis is y of its link."""
    across = MASS * (RADIUS**2 / 4.0 + WIDTH**2 / 12.0)
    along = MASS * RADIUS**2 / 2.0
    return f"""<link name="{name}"><inertial><mass value="{MASS}"/>
    <inertia ixx="{across}" iyy="{along}" izz="{across}" ixy="0" ixz="0" iyz="0"/>
    </inertial><collision><origin rpy="{math.pi / 2} 0 0"/><geometry>
    <cylinder radius="{RADIUS}" length="{WIDTH}"/></geometry></collision></link>
    <joint name="{name}_joint" type="continuous"><axis xyz="{axis}"/>
    <parent link="base_link"/><child link="{name}"/>
    <origin xyz="{x} {y} 0" rpy="0 0 {yaw}"/>
    <limit effort="5" velocity="50"/></joint>"""


def base(wheels: dict[str, str], plugin: str = "") -> str:
    """Return a base of 8 kg with wheels that are commanded velocities."""
    joints = "".join(
        f"""<joint name="{name}_joint"><command_interface name="velocity"/>
        <state_interface name="position"/><state_interface name="velocity"/></joint>"""
        for name in wheels
    )
    control = f"""<ros2_control name="wheels" type="system"><hardware>
    <plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>{joints}
    </ros2_control>"""
    return f"""<robot name="base"><link name="base_link"><inertial><mass value="8"/>
    <inertia ixx="0.05" iyy="0.1" izz="0.12" ixy="0" ixz="0" iyz="0"/></inertial></link>
    {"".join(wheels.values())}{plugin or control}</robot>"""


def mecanum() -> tuple[str, str]:
    """Return a base and its controllers; one of its wheels is mounted backwards."""
    wheels = {name: wheel(name, *place, 0.0) for name, place in CORNERS.items()}
    ends = {"fl": "front_left", "fr": "front_right"}
    ends |= {"rr": "rear_right", "rl": "rear_left"}
    rows = "\n".join(
        f"    {end}_wheel_command_joint_name: {name}_joint"
        for name, end in ends.items()
    )
    return (
        base(wheels),
        f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    drive: {{type: mecanum_drive_controller/MecanumDriveController}}
drive:
  ros__parameters:
    reference_timeout: 1.0
{rows}
    kinematics:
      base_frame_offset: {{x: 0.0, y: 0.0, theta: 0.0}}
      wheels_radius: {RADIUS}
      sum_of_robot_center_projection_on_X_Y_axis: {sum(CORNERS["fl"])}
""",
    )


def omni() -> tuple[str, str]:
    """Return a base with three omni wheels, and its controllers."""
    wheels = {}
    for number in range(3):
        angle, name = 2.0 * math.pi * number / 3.0, f"wheel{number}"
        x, y = REACH * math.cos(angle), REACH * math.sin(angle)
        # The axis points outwards.
        wheels[name] = wheel(name, x, y, angle - math.pi / 2.0)
    return (
        base(wheels),
        f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    drive: {{type: omni_wheel_drive_controller/OmniWheelDriveController}}
drive:
  ros__parameters:
    wheel_names: [{", ".join(f"{name}_joint" for name in wheels)}]
    wheel_offset: 0.0
    robot_radius: {REACH}
    wheel_radius: {RADIUS}
""",
    )


def swerve() -> tuple[str, str]:
    """Return a base whose wheels are steered, each for itself, and its controller."""
    wheels, rows, control = {}, "", ""
    ends = {"fl": "front_left", "fr": "front_right"}
    ends |= {"rl": "rear_left", "rr": "rear_right"}
    for name, (x, y) in CORNERS.items():
        below = wheel(name, 0.0, 0.0, 0.0).replace("base_link", f"{name}_fork")
        wheels[name] = f"""{below}<link name="{name}_fork"><inertial><mass value="0.3"/>
        <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
        </link><joint name="{name}_axle" type="revolute"><axis xyz="0 0 1"/>
        <parent link="base_link"/><child link="{name}_fork"/><origin xyz="{x} {y} 0"/>
        <limit lower="-3.2" upper="3.2" effort="20" velocity="20"/></joint>"""
        control += f"""<joint name="{name}_axle"><command_interface name="position"/>
        <state_interface name="position"/></joint>"""
        rows += f"    {ends[name]}_wheel_joint: {name}_joint\n"
        rows += f"    {ends[name]}_axle_joint: {name}_axle\n"
    return (
        base(wheels).replace("</ros2_control>", f"{control}</ros2_control>"),
        f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    drive: {{type: swerve_drive_controller/SwerveController}}
drive:
  ros__parameters:
{rows}
    wheelbase: {2.0 * CORNERS["fl"][0]}
    trackwidth: {2.0 * CORNERS["fl"][1]}
    wheel_radius: {RADIUS}
""",
    )


def gazebo_mecanum() -> str:
    """Return a base that Gazebo's own plugin drives."""
    wheels = {name: wheel(name, *place, 0.0) for name, place in CORNERS.items()}
    ends = {"fl": "front_left", "fr": "front_right"}
    ends |= {"rr": "back_right", "rl": "back_left"}
    joints = "".join(
        f"<{end}_joint>{name}_joint</{end}_joint>" for name, end in ends.items()
    )
    x, y = CORNERS["fl"]
    tags = f"{joints}<wheel_separation>{2 * y}</wheel_separation>"
    tags += f"<wheelbase>{2 * x}</wheelbase><wheel_radius>{RADIUS}</wheel_radius>"
    name = "gz::sim::systems::MecanumDrive"
    plugin = f'<plugin filename="gz-sim-mecanum-drive-system" name="{name}">'
    return base(wheels, f"<gazebo>{plugin}{tags}</plugin></gazebo>")


class Base:
    """A base in the world."""

    def __init__(
        self, folder: Path, files: tuple[str, str], *, step: float = STEP
    ) -> None:
        (folder / "robot.urdf").write_text(files[0])
        (folder / "controllers.yaml").write_text(files[1])
        self.robot = ad.load_robot(
            folder / "robot.urdf", controllers=folder / "controllers.yaml"
        )
        options = ad.SimulationOptions(time_step=step)
        self.sim = ad.Simulation(ad.build_diagram(self.robot, options=options))
        self.plant: MultibodyPlant = self.sim.diagram.GetSubsystemByName("plant")

    @property
    def pose(self) -> RigidTransform:
        context = self.plant.GetMyContextFromRoot(self.sim.simulator.get_context())
        body = self.plant.GetBodyByName("base_link")
        return self.plant.EvalBodyPoseInWorld(context, body)

    def drive(self, x: float, y: float, turn: float, duration: float) -> None:
        twist = Twist(Vector3(x=x, y=y), Vector3(z=turn))
        for _ in range(round(duration / PERIOD)):
            self.sim.controller("drive").send_velocity(twist)
            self.sim.run(PERIOD)

    def value(self, port: str) -> object:
        context = self.sim.simulator.get_context()
        return self.sim.diagram.GetOutputPort(port).Eval(context)


BASES = {"mecanum": mecanum, "omni": omni}


@pytest.mark.parametrize("name", BASES)
def test_a_base_with_rollers_stands_still(tmp_path: Path, name: str) -> None:
    base = Base(tmp_path, BASES[name]())
    before = base.pose

    base.sim.run(4.0)

    assert np.linalg.norm(base.pose.translation() - before.translation()) < 4e-4
    yaw = RollPitchYaw((before.inverse() @ base.pose).rotation()).yaw_angle()
    assert abs(yaw) < 4e-4


@pytest.mark.parametrize("name", BASES)
@pytest.mark.parametrize(
    "velocity", [(0.2, 0, 0), (0, 0.2, 0), (0, 0, 0.8), (0.15, -0.15, 0)]
)
def test_a_base_with_rollers_goes_where_it_is_told(
    tmp_path: Path, name: str, velocity: tuple[float, float, float]
) -> None:
    base = Base(tmp_path, BASES[name]())
    start, duration = base.pose, 2.0

    base.drive(*velocity, duration)
    base.drive(0.0, 0.0, 0.0, 0.5)

    moved = start.inverse() @ base.pose
    yaw = RollPitchYaw(moved.rotation()).yaw_angle()
    found = np.array([*moved.translation()[:2], yaw])
    # A roller's axis leans when it comes down and goes: over the ground it is 1.6 %
    # shorter on average, for 10 rollers, and with it the way across.
    wanted = duration * np.array(velocity)
    np.testing.assert_allclose(found, wanted, atol=0.03 * np.abs(wanted).max())


@pytest.mark.parametrize("name", BASES)
def test_the_odometry_of_rollers_is_near_the_truth(tmp_path: Path, name: str) -> None:
    base = Base(tmp_path, BASES[name](), step=1e-3)

    base.drive(0.1, 0.1, 0.4, 3.0)
    base.drive(0.0, 0.0, 0.0, 0.5)

    topic = "/drive/odometry" if name == "mecanum" else "/drive/odom"
    odom = base.sim.topic(topic).value().pose.pose.position
    truth = base.value("drive.ground_truth").pose.pose.position
    way = 3.0 * math.hypot(0.1, 0.1)
    assert math.hypot(odom.x - truth.x, odom.y - truth.y) < 0.05 * way
    # At rest nothing slips.
    assert np.abs(base.value("drive.wheel_slip")).max() < 1e-3


def test_a_wheel_slips_along_its_rollers_axis_alone(tmp_path: Path) -> None:
    base = Base(tmp_path, omni())
    base.drive(0.2, 0.0, 0.0, 1.0)

    slip = base.value("drive.wheel_slip")

    # Two wheels run at 0.17 m/s, and are pushed across at 0.1 m/s by their rollers.
    assert np.abs(slip[:3]).max() < 0.01
    np.testing.assert_array_equal(slip[3:], np.zeros(3))


def test_a_contact_sensor_on_a_wheel_feels_its_rollers(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    tag = """<gazebo reference="fl"><sensor name="touch" type="contact">
    <contact><collision>fl_collision</collision><topic>touch</topic></contact>
    </sensor></gazebo></robot>"""
    base = Base(tmp_path, (urdf.replace("</robot>", tag), yaml))

    base.sim.run(1.0)

    states = base.sim.topic("/touch").value().states
    forces = [state.total_wrench.force.z for state in states]
    # A quarter of the weight of base and wheels.
    assert sum(forces) == pytest.approx((8.0 + 4.0 * MASS) * 9.81 / 4.0, rel=1e-3)
    assert {state.collision1_name for state in states} == {"base::fl::fl_collision"}


def test_what_the_description_has_is_what_is_reported(tmp_path: Path) -> None:
    base = Base(tmp_path, mecanum())

    names = base.sim.joint_states().name
    frames = base.value("frames")

    assert names == tuple(f"{name}_joint" for name in CORNERS)
    assert len(frames) == 5
    lines = [entry for entry in base.robot.report if "rollers" in entry.what]
    assert [entry.where for entry in lines] == [f"link {n!r}" for n in CORNERS]
    assert {entry.done for entry in lines} == {
        "in the physics it has 10 that turn freely"
    }


def test_gazebo_s_mecanum_drive_goes_round_a_square_sideways_too(
    tmp_path: Path,
) -> None:
    (tmp_path / "base.urdf").write_text(gazebo_mecanum(), encoding="utf-8")
    robot = models.at_rate_of(ad.load_robot(tmp_path / "base.urdf"), STEP)
    options = ad.SimulationOptions(time_step=STEP)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    topic = sim.topic("/model/base/cmd_vel")
    sim.run(0.2)
    start = sim.link_poses()["base_link"]
    found = []

    for x, y in ((0.2, 0.0), (0.0, 0.2), (-0.2, 0.0), (0.0, -0.2), (0.0, 0.0)):
        topic.publish(Twist(Vector3(x=x, y=y)))
        sim.run(2.0)
        moved = start.inverse() @ sim.link_poses()["base_link"]
        found.append(
            [*moved.translation()[:2], RollPitchYaw(moved.rotation()).vector()[2]]
        )

    # Sideways rollers make 1.6 % less than the wheels; 3 % of the way.
    corners = [[0.4, 0, 0], [0.4, 0.4, 0], [0, 0.4, 0], [0, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(found, corners, atol=0.03 * 0.8)
    # The odometry is near the truth, which is near 0 again.
    where = sim.topic("/model/base/odometry").value().pose.pose.position
    np.testing.assert_allclose([where.x, where.y], found[-1][:2], atol=0.03 * 0.8)


def test_the_wheels_of_gazebo_s_mecanum_drive_get_rollers(tmp_path: Path) -> None:
    (tmp_path / "base.urdf").write_text(gazebo_mecanum(), encoding="utf-8")

    robot = ad.load_robot(tmp_path / "base.urdf")

    assert robot.has_free_base
    rolling = [e.where for e in robot.report if "goes sideways" in e.what]
    assert rolling == ["link 'fl'", "link 'fr'", "link 'rl'", "link 'rr'"]


@pytest.mark.parametrize(
    "velocity", [(0.0, 0.2, 0.0), (0.0, 0.0, 0.8), (0.1, 0.1, 0.4)]
)
def test_a_base_with_steered_wheels_goes_where_it_is_told(
    tmp_path: Path, velocity: tuple[float, float, float]
) -> None:
    base = Base(tmp_path, swerve(), step=1e-3)
    # Its wheels stand as they have to, and it waits.
    base.drive(*(1e-4 * np.array(velocity)), 1.0)
    start = base.pose

    base.drive(*velocity, 2.0)
    base.drive(0.0, 0.0, 0.0, 0.5)

    moved = start.inverse() @ base.pose
    yaw = RollPitchYaw(moved.rotation()).yaw_angle()
    *sideways, turn = velocity
    # The integral of a velocity that turns with the base, in the complex plane.
    way = complex(*sideways) * (np.exp(2j * turn) - 1.0) / 1j / turn if turn else 0.4j
    wanted = [way.real, way.imag, 2.0 * turn]
    found = [*moved.translation()[:2], yaw]
    # Wheels lag behind a step of their command by their servo, and slip then.
    np.testing.assert_allclose(found, wanted, atol=0.03 * np.abs(wanted).max())
    odom = base.sim.topic("/drive/odom").value().pose.pose.position
    truth = base.value("drive.ground_truth").pose.pose.position
    assert math.hypot(odom.x - truth.x, odom.y - truth.y) < 0.02


def test_an_omni_base_whose_wheels_have_pids_is_driven_from_the_start(
    tmp_path: Path,
) -> None:
    urdf, yaml = omni()
    joints = [f"wheel{number}_joint" for number in range(3)]
    gains = ", ".join(f"{j}: {{p: 0.2, i: 20.0, i_clamp: 20.0}}" for j in joints)
    wheels = yaml.replace("[wheel", "[pid/wheel").replace(", wheel", ", pid/wheel")
    pids = f"""    position_feedback: false
pid:
  ros__parameters:
    dof_names: [{", ".join(joints)}]
    command_interface: velocity
    reference_and_state_interfaces: [velocity]
    gains: {{{gains}}}
"""
    loaded = "    pid: {type: pid_controller/PidController}\n    drive:"
    wheels = wheels.replace("    drive:", loaded)
    base = Base(tmp_path, (urdf, wheels + pids))
    start = base.pose

    base.drive(0.0, 0.2, 0.0, 2.0)

    assert {c.state for c in base.sim.list_controllers()} == {"active"}
    way = (start.inverse() @ base.pose).translation()
    # A fifth of a second for the integrals, and a tenth of the way.
    np.testing.assert_allclose(way[:2], [0.0, 0.4], atol=0.08)
