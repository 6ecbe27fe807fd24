"""The plant is the description: same joints, same dynamics, same limits."""

import math
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

import arm_drake as ad
from arm_drake.errors import DescriptionError
from arm_drake.plant import state_indices
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


@pytest.mark.parametrize(("self_collision", "contacts"), [(False, 0), (True, 1)])
def test_links_of_a_robot_collide_with_each_other_by_option_only(
    tmp_path: Path, self_collision: bool, contacts: int
) -> None:
    robot = models.load(tmp_path, models.OVERLAPPING)
    options = ad.SimulationOptions(self_collision=self_collision)
    diagram = ad.build_diagram(robot, world="void", options=options)

    context = diagram.CreateDefaultContext()

    plant = plant_of(diagram)
    results = plant.get_contact_results_output_port().Eval(
        plant.GetMyContextFromRoot(context)
    )
    assert results.num_point_pair_contacts() == contacts


def test_robots_collide_with_each_other(tmp_path: Path) -> None:
    robots = [
        models.load(tmp_path, models.FALLING_BALL, name=name, pose=(x, 0, 0, 0, 0, 0))
        for name, x in (("one", 0.0), ("two", 0.15))
    ]
    diagram = ad.build_diagram(robots, world="void")

    context = diagram.CreateDefaultContext()

    plant = plant_of(diagram)
    results = plant.get_contact_results_output_port().Eval(
        plant.GetMyContextFromRoot(context)
    )
    assert results.num_point_pair_contacts() == 1


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


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "<limit",
            '<dynamics damping="-1"/><limit',
            "Drake refuses the description: "
            "Revolute joint damping must be nonnegative.",
        ),
    ],
)
def test_a_description_that_makes_no_plant_is_refused(
    tmp_path: Path, old: str, new: str, problem: str
) -> None:
    robot = models.load(tmp_path, models.pendulum().replace(old, new))

    with pytest.raises(DescriptionError) as caught:
        ad.build_diagram(robot)

    assert str(caught.value) == f"{robot.description.file}: {problem}"


def test_an_axis_of_zero_is_refused(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.pendulum().replace("0 1 0", "0 0 0"))

    # The line is one of the text that Drake reads.
    with pytest.raises(DescriptionError, match=r"Joint 'swing' axis is zero"):
        ad.build_diagram(robot)


def test_a_step_of_the_plant_is_the_one_asked_for(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.pendulum())
    options = ad.SimulationOptions(time_step=2e-3)

    diagram = ad.build_diagram(robot, options=options)

    assert plant_of(diagram).time_step() == pytest.approx(2e-3, rel=1e-12)
