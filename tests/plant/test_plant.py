"""The plant is the description: same joints, same dynamics, same limits."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

import arm_drake as ad
from arm_drake.errors import DescriptionError
from arm_drake.plant.plant import state_indices
from tests import models

POSE = (0.1, -0.2, 0.3, 0.4, -0.5, 0.6)
X_WB = RigidTransform(RollPitchYaw(np.array(POSE[3:])), np.array(POSE[:3]))


def plant_of(diagram: Diagram) -> MultibodyPlant:
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant


def build_plant(robot: ad.Robot, **options: bool) -> MultibodyPlant:
    return plant_of(
        ad.build_diagram(robot, world="void", options=ad.SimulationOptions(**options))
    )


def link_poses(robot: ad.Robot) -> dict[str, RigidTransform]:
    return ad.Simulation(ad.build_diagram(robot, world="void")).link_poses()


def test_each_commanded_joint_has_an_actuator_of_its_name_and_effort_limit() -> None:
    robot = ad.load_robot("doosan_a0912")

    plant = build_plant(robot)

    limits = {
        plant.get_joint_actuator(index).name(): plant.get_joint_actuator(
            index
        ).effort_limit()
        for index in plant.GetJointActuatorIndices()
    }
    efforts = [411.0, 411.0, 194.0, 50.0, 50.0, 50.0]
    assert limits == {f"joint{i}": e for i, e in enumerate(efforts, start=1)}
    for name in limits:
        assert plant.GetJointActuatorByName(name).joint().name() == name


def test_joints_without_command_interface_have_no_actuator(tmp_path: Path) -> None:
    plant = build_plant(models.load(tmp_path, models.PARTLY_COMMANDED))

    actuators = plant.GetJointActuatorIndices()
    names = [plant.get_joint_actuator(index).name() for index in actuators]
    assert names == ["first", "third"]


@pytest.mark.slow
def test_mimic_joints_have_no_actuator_even_where_they_are_listed(
    tmp_path: Path,
) -> None:
    urdf = models.GRIPPER.replace(
        '<joint name="follower">\n',
        '<joint name="follower"><command_interface name="position"/>\n',
    )
    assert urdf != models.GRIPPER

    plant = build_plant(models.load(tmp_path, urdf))

    actuators = plant.GetJointActuatorIndices()
    names = [plant.get_joint_actuator(index).name() for index in actuators]
    assert names == ["finger"]


def test_a_description_without_hardware_commands_every_joint(tmp_path: Path) -> None:
    plant = build_plant(models.load(tmp_path, models.pendulum(control="")))

    (index,) = plant.GetJointActuatorIndices()
    assert plant.get_joint_actuator(index).name() == "swing"


def test_an_effort_limit_of_0_is_none(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="0" velocity="0"'

    plant = build_plant(models.load(tmp_path, models.pendulum(limit=limit)))

    assert plant.GetJointActuatorByName("swing").effort_limit() == math.inf
    assert plant.GetVelocityUpperLimits() == [math.inf]


@pytest.mark.slow
def test_kinematics_and_mass_matrix_are_those_of_another_library() -> None:
    robot = ad.load_robot("doosan_a0912")
    model = pinocchio.buildModelFromXML(robot.description.urdf)
    data = model.createData()
    plant = build_plant(robot)
    context = plant.CreateDefaultContext()
    names = list(model.names)[1:]
    q_at, v_at = state_indices(plant, plant.GetModelInstanceByName("a0912"), names)
    v_at = [index - plant.num_positions() for index in v_at]

    random = np.random.default_rng(1)
    for _ in range(20):
        q = random.uniform(-2.0, 2.0, model.nq)
        positions = np.zeros(plant.num_positions())
        positions[q_at] = q
        plant.SetPositions(context, positions)
        pinocchio.framesForwardKinematics(model, data, q)
        M = pinocchio.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        gravity = pinocchio.computeGeneralizedGravity(model, data, q)

        for link in robot.description.links:
            X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link))
            expected = data.oMf[model.getFrameId(link)].homogeneous
            np.testing.assert_allclose(X.GetAsMatrix4(), expected, atol=1e-12)
        np.testing.assert_allclose(
            plant.CalcMassMatrix(context)[np.ix_(v_at, v_at)], M, atol=1e-11
        )
        np.testing.assert_allclose(
            -plant.CalcGravityGeneralizedForces(context)[v_at], gravity, atol=1e-11
        )


def test_the_model_instance_is_called_as_the_robot(tmp_path: Path) -> None:
    plant = build_plant(models.load(tmp_path, models.TWO_LINKS, name="left arm"))

    assert plant.HasModelInstanceNamed("left arm")


def test_joints_have_the_damping_of_the_description(tmp_path: Path) -> None:
    plant = build_plant(models.load(tmp_path, models.TWO_LINKS))

    assert plant.GetJointByName("shoulder").default_damping_vector() == [0.5]
    assert plant.GetJointByName("elbow").default_damping_vector() == [0.2]


@pytest.mark.parametrize("pose", [None, POSE])
def test_pose_places_a_robot_without_world_link(
    tmp_path: Path, pose: tuple[float, ...] | None
) -> None:
    robot = models.load(tmp_path, models.TWO_LINKS, pose=pose)

    poses = link_poses(robot)

    X_WB_expected = RigidTransform() if pose is None else X_WB
    X_WLower = X_WB_expected @ RigidTransform([0.0, 0.0, -models.LENGTH])
    assert poses["base"].IsNearlyEqualTo(X_WB_expected, 1e-12)
    assert poses["lower"].IsNearlyEqualTo(X_WLower, 1e-12)


@pytest.mark.parametrize("pose", [None, POSE])
@pytest.mark.parametrize(
    ("origin", "X_BP"),
    [
        ("", RigidTransform()),
        ('<origin xyz="1 2 3"/>', RigidTransform([1.0, 2.0, 3.0])),
        (
            '<origin xyz="1 2 3" rpy="0.3 0.2 0.1"/>',
            RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [1.0, 2.0, 3.0]),
        ),
    ],
)
def test_pose_places_a_robot_with_a_world_link(
    tmp_path: Path, origin: str, X_BP: RigidTransform, pose: tuple[float, ...] | None
) -> None:
    mount = (
        f'<link name="world"/><joint name="mount" type="fixed">{origin}'
        '<parent link="world"/><child link="base"/></joint>'
    )
    urdf = models.TWO_LINKS.replace(
        '<link name="base"/>', f'<link name="base"/>{mount}'
    )
    robot = models.load(tmp_path, urdf, pose=pose)

    poses = link_poses(robot)

    X = RigidTransform() if pose is None else X_WB
    assert poses["world"].IsNearlyEqualTo(RigidTransform(), 1e-12)
    assert poses["base"].IsNearlyEqualTo(X @ X_BP, 1e-12)


def test_initial_positions_are_those_of_the_robot(tmp_path: Path) -> None:
    robot = models.load(
        tmp_path, models.TIP_FIRST, initial_positions={"elbow": 0.4, "shoulder": -0.7}
    )

    plant = build_plant(robot)

    context = plant.CreateDefaultContext()
    assert plant.GetJointByName("elbow").get_angle(context) == 0.4
    assert plant.GetJointByName("shoulder").get_angle(context) == -0.7


def test_gravity_acts_downwards_or_not_at_all(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.pendulum())

    on, off = build_plant(robot), build_plant(robot, gravity=False)

    assert on.gravity_field().gravity_vector() == pytest.approx([0.0, 0.0, -9.81])
    np.testing.assert_array_equal(off.gravity_field().gravity_vector(), 0.0)


# Two balls that overlap by 0.2 mm.
TOUCHING = models.OVERLAPPING.replace("0.05 0 0", "0.0999 0 0")


@pytest.mark.parametrize(
    ("urdf", "self_collision", "contacts"),
    [(TOUCHING, False, 0), (TOUCHING, True, 1), (models.OVERLAPPING, True, 0)],
)
def test_links_of_a_robot_collide_by_option_unless_they_overlap_from_the_start(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    urdf: str,
    self_collision: bool,
    contacts: int,
) -> None:
    # No SRDF file of another test is to be found.
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    robot = models.load(tmp_path, urdf)
    options = ad.SimulationOptions(self_collision=self_collision)
    diagram = ad.build_diagram(robot, world="void", options=options)

    context = diagram.CreateDefaultContext()

    plant = plant_of(diagram)
    results = plant.get_contact_results_output_port().Eval(
        plant.GetMyContextFromRoot(context)
    )
    assert results.num_point_pair_contacts() == contacts


@pytest.mark.parametrize(("distance", "contacts"), [(0.1999, 1), (0.15, 0)])
def test_robots_collide_unless_they_overlap_from_the_start(
    tmp_path: Path, distance: float, contacts: int
) -> None:
    robots = [
        models.load(tmp_path, models.FALLING_BALL, name=name, pose=(x, 0, 0, 0, 0, 0))
        for name, x in (("one", 0.0), ("two", distance))
    ]
    diagram = ad.build_diagram(robots, world="void")

    context = diagram.CreateDefaultContext()

    plant = plant_of(diagram)
    results = plant.get_contact_results_output_port().Eval(
        plant.GetMyContextFromRoot(context)
    )
    assert results.num_point_pair_contacts() == contacts


@pytest.mark.slow
def test_a_falling_link_comes_to_rest_on_the_ground(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.FALLING_BALL)
    simulation = ad.Simulation(ad.build_diagram(robot))

    simulation.advance_to(2.0)

    (height,) = simulation.joint_states().position
    # Contact is compliant: the ball sinks in by 20 um.
    assert 1.0 + height == pytest.approx(0.1, abs=1e-3)


def test_ports_of_the_plant_are_not_sampled(tmp_path: Path) -> None:
    # Sampled ports would show last step's contact forces and delay effort by a step.
    diagram = ad.build_diagram(models.load(tmp_path, models.pendulum()))

    assert not plant_of(diagram).has_sampled_output_ports()


@pytest.mark.parametrize("axis", ["0 0 0", "0 1e-170 0"])
def test_an_axis_of_zero_is_refused(tmp_path: Path, axis: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        models.load(tmp_path, models.pendulum().replace("0 1 0", axis))

    assert str(caught.value) == (
        f"{tmp_path / 'robot.urdf'}:9: joint 'swing': <axis xyz>: "
        "expected a direction, got zeros"
    )


def test_a_step_of_the_plant_is_the_one_asked_for(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.pendulum())
    options = ad.SimulationOptions(time_step=2e-3)

    diagram = ad.build_diagram(robot, options=options)

    assert plant_of(diagram).time_step() == pytest.approx(2e-3, rel=1e-12)


MOBILE = """
<robot name="mobile">
  <link name="base">
    <inertial><mass value="10"/><origin xyz="0 0 0.1"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="-0.15 0 0"/><geometry><sphere radius="0.1"/></geometry>
    </collision>
  </link>
  {left}{right}
</robot>"""
WHEEL = """
  <link name="{name}_wheel">
    <inertial><mass value="1"/>
      <inertia ixx="0.003" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.003"/></inertial>
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>
  </link>
  <joint name="{name}" type="continuous">
    <parent link="base"/><child link="{name}_wheel"/>
    <origin xyz="0.1 {y} 0"/><axis xyz="0 1 0"/><limit effort="5" velocity="10"/>
  </joint>"""
DIFF_DRIVE = """
controller_manager:
  ros__parameters:
    base: {type: diff_drive_controller/DiffDriveController}
base:
  ros__parameters:
    left_wheel_names: [left]
    right_wheel_names: [right]
    wheel_separation: 0.3
    wheel_radius: 0.1
"""


def load_mobile(tmp_path: Path, yaml: str = DIFF_DRIVE, **options: Any) -> ad.Robot:
    wheels = {
        name: WHEEL.format(name=name, y=y)
        for name, y in (("left", 0.15), ("right", -0.15))
    }
    return models.load(tmp_path, MOBILE.format(**wheels), yaml, **options)


@pytest.mark.slow
def test_a_base_that_a_controller_drives_stands_freely_on_the_ground(
    tmp_path: Path,
) -> None:
    robot = load_mobile(tmp_path)
    simulation = ad.Simulation(ad.build_diagram(robot))

    X_start = simulation.link_poses()["base"]
    simulation.advance_to(1.0)
    X_end = simulation.link_poses()["base"]

    assert robot.has_free_base
    # Its wheels and its caster, of radius 0.1 m, touch the ground.
    np.testing.assert_allclose(X_start.translation(), [0.0, 0.0, 0.1], atol=1e-9)
    # Contact is compliant: it sinks in by less than a millimetre, and stays.
    np.testing.assert_allclose(X_end.translation(), [0.0, 0.0, 0.1], atol=1e-3)
    # In free fall it would be 4.9 m lower.
    void = ad.Simulation(ad.build_diagram(robot, world="void"))
    void.advance_to(1.0)
    height = void.link_poses()["base"].translation()[2]
    assert height == pytest.approx(0.1 - 9.81 / 2, rel=2e-3)


def test_a_free_base_starts_in_the_pose_that_is_given(tmp_path: Path) -> None:
    robot = load_mobile(tmp_path, pose=POSE)

    assert link_poses(robot)["base"].IsNearlyEqualTo(X_WB, 1e-12)


def test_a_base_that_nothing_drives_is_fixed(tmp_path: Path) -> None:
    yaml = DIFF_DRIVE.partition("base:")[0] + "    update_rate: 50"

    robot = load_mobile(tmp_path, yaml)

    assert not robot.has_free_base
    simulation = ad.Simulation(ad.build_diagram(robot, world="void"))
    simulation.advance_to(0.1)
    pose = simulation.link_poses()["base"]
    np.testing.assert_allclose(pose.translation(), 0.0, atol=1e-12)


def test_the_wheels_of_a_free_base_hold_as_on_a_fixed_one(tmp_path: Path) -> None:
    simulation = ad.Simulation(ad.build_diagram(load_mobile(tmp_path), world="void"))

    simulation.advance_to(0.5)

    rollout = simulation.rollout()
    np.testing.assert_allclose(rollout.position, 0.0, atol=1e-6)


@pytest.mark.parametrize(("joint_type", "dofs"), [("floating", 6), ("planar", 3)])
def test_a_joint_of_several_degrees_of_freedom_moves_freely(
    tmp_path: Path, joint_type: str, dofs: int
) -> None:
    urdf = models.FALLING_BALL.replace(
        "</robot>",
        '<link name="free"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" '
        'iyy="1" iyz="0" izz="1"/></inertial></link>'
        f'<joint name="loose" type="{joint_type}"><parent link="base"/>'
        '<child link="free"/><origin xyz="0.1 0 2"/><axis xyz="0 1 0"/>'
        '<dynamics damping="0"/></joint>'
        "</robot>",
    )
    robot = models.load(tmp_path, urdf)
    diagram = ad.build_diagram(robot, world="void")
    simulation = ad.Simulation(diagram)

    simulation.advance_to(0.5)

    plant = plant_of(diagram)
    (joint,) = (
        plant.get_joint(index)
        for index in plant.GetJointIndices()
        if plant.get_joint(index).child_body().name() == "free"
    )
    assert joint.num_velocities() == dofs
    x, _, z = simulation.link_poses()["free"].translation()
    assert x == pytest.approx(0.1, abs=1e-9)
    # The plane of a planar joint is normal to its axis, here y.
    assert z - 2.0 == pytest.approx(-9.81 * 0.5**2 / 2, rel=5e-3)


def floating(name: str, parent: str, child: str, xyz: str) -> str:
    return (
        f'<joint name="{name}" type="floating"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/></joint>'
    )


def body(name: str) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" '
        'ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
    )


def start_of(robot: ad.Robot, link: str) -> list[float]:
    poses = ad.Simulation(ad.build_diagram(robot, world="void")).link_poses()
    return list(poses[link].translation())


def test_floating_links_start_at_their_joints_whatever_the_order(
    tmp_path: Path,
) -> None:
    # The joint further out stands first.
    urdf = (
        '<robot name="loose">'
        + "".join(map(body, "abc"))
        + floating("far", "b", "c", "0 0 1")
        + floating("near", "a", "b", "1 0 0")
        + floating("world_joint", "world", "a", "0 0 2")
        + "</robot>"
    )

    robot = models.load(tmp_path, urdf, pose=(5, 6, 7, 0, 0, 0))

    assert robot.free_links == {"a", "b", "c"}
    assert start_of(robot, "a") == pytest.approx([5, 6, 9])
    assert start_of(robot, "b") == pytest.approx([6, 6, 9])
    assert start_of(robot, "c") == pytest.approx([6, 6, 10])


def test_a_floating_link_starts_on_the_free_base(tmp_path: Path) -> None:
    wheels = {
        name: WHEEL.format(name=name, y=y)
        for name, y in (("left", 0.15), ("right", -0.15))
    }
    urdf = MOBILE.format(**wheels).replace(
        "</robot>",
        body("ball") + floating("toss", "base", "ball", "0 0 1") + "</robot>",
    )

    robot = models.load(tmp_path, urdf, DIFF_DRIVE)

    # Wheels and caster have a radius of 0.1 m.
    assert start_of(robot, "base") == pytest.approx([0.0, 0.0, 0.1])
    assert start_of(robot, "ball") == pytest.approx([0.0, 0.0, 1.1])


@pytest.mark.parametrize(
    ("shape", "rpy", "lowest"),
    [
        ('<sphere radius="0.1"/>', "0 0.785 0", 0.1),
        ('<cylinder radius="0.1" length="0.4"/>', "0 0 0", 0.2),
        ('<cylinder radius="0.1" length="0.4"/>', "1.5707963267948966 0 0", 0.1),
        (
            '<cylinder radius="0.1" length="0.4"/>',
            "0.7853981633974483 0 0",
            (0.2 + 0.1) * math.sqrt(0.5),
        ),
        (
            '<capsule radius="0.1" length="0.4"/>',
            "0.7853981633974483 0 0",
            0.2 * math.sqrt(0.5) + 0.1,
        ),
        ('<box size="0.2 0.4 0.6"/>', "1.5707963267948966 0 0", 0.2),
    ],
)
def test_a_free_base_stands_on_its_lowest_point(
    tmp_path: Path, shape: str, rpy: str, lowest: float
) -> None:
    wheels = dict.fromkeys(("left", "right"), "")
    urdf = MOBILE.format(**wheels).replace(
        '<origin xyz="-0.15 0 0"/><geometry><sphere radius="0.1"/></geometry>',
        f'<origin rpy="{rpy}"/><geometry>{shape}</geometry>',
    )
    arm = body("arm") + (
        '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/>'
        "</joint></robot>"
    )

    robot = models.load(tmp_path, urdf.replace("</robot>", arm), DIFF_DRIVE)

    assert start_of(robot, "base") == pytest.approx([0.0, 0.0, lowest], abs=1e-9)


@pytest.mark.slow
def test_a_free_base_without_mass_gets_one(tmp_path: Path) -> None:
    wheels = {
        name: WHEEL.format(name=name, y=y)
        for name, y in (("left", 0.15), ("right", -0.15))
    }
    urdf = MOBILE.format(**wheels)
    start, end = urdf.index("<inertial>"), urdf.index("</inertial>")
    urdf = urdf[:start] + urdf[end + len("</inertial>") :]

    robot = models.load(tmp_path, urdf, DIFF_DRIVE)
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.advance_to(0.5)

    (line,) = [e for e in robot.report if e.where == "link 'base'" and "mass" in e.what]
    # Its shape is the caster, a ball of 0.1 m: 4.19 dm^3.
    assert "4.19 kg" in line.done
    assert simulation.link_poses()["base"].translation()[2] > 0.05
    # On a base that is fixed it changes nothing.
    fixed = models.load(tmp_path, urdf)
    assert not [e for e in fixed.report if e.where == "link 'base'"]


def test_the_base_of_the_largest_tree_is_the_free_one(tmp_path: Path) -> None:
    wheels = {
        name: WHEEL.format(name=name, y=y)
        for name, y in (("left", 0.15), ("right", -0.15))
    }
    urdf = MOBILE.format(**wheels).replace("<link", '<link name="cam"/><link', 1)

    robot = models.load(tmp_path, urdf, DIFF_DRIVE)

    assert robot.description.base == "base"
    assert robot.free_links == {"base", "left_wheel", "right_wheel"}
    assert start_of(robot, "cam") == pytest.approx([0.0, 0.0, 0.0])


@pytest.mark.slow
def test_a_loose_link_that_dips_into_the_ground_stays_on_it(tmp_path: Path) -> None:
    link = body("a").replace(
        "</link>",
        '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>',
    )
    urdf = (
        f'<robot name="loose">{link}'
        + floating("f", "world", "a", "0 0 0.098")
        + "</robot>"
    )
    simulation = ad.Simulation(ad.build_diagram(models.load(tmp_path, urdf)))

    simulation.advance_to(1.0)

    height = simulation.link_poses()["a"].translation()[2]
    assert height == pytest.approx(0.1, abs=3e-3)
