"""Wheels that drive and steer a base, from the controllers' parameters."""

from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.description.base_wheels import (
    MobileBase,
    find_bases,
    find_load_inertia,
    moved_joints,
    wheel_links,
)
from arm_drake.description.urdf import total_mass
from tests import models
from tests.carts import RADIUS, cart, classic_drive, diff_drive

CONTROL = models.ros2_control("left", "right", command="velocity")


def yaml(type_name: str, **parameters: object) -> str:
    lines = "".join(f"    {name}: {value}\n" for name, value in parameters.items())
    return (
        f"controller_manager:\n  ros__parameters:\n    c: {{type: {type_name}}}\n"
        f"c:\n  ros__parameters:\n{lines}"
    )


def bases(tmp_path: Path, urdf: str, text: str | None = None) -> list[MobileBase]:
    robot = models.load(tmp_path, urdf, text)
    return list(find_bases(robot.description, robot.controllers))


@pytest.mark.parametrize(
    ("type_name", "parameters", "driven", "steered"),
    [
        (
            "diff_drive_controller/DiffDriveController",
            {"left_wheel_names": "[left]", "right_wheel_names": "[right]"},
            ("left", "right"),
            (),
        ),
        (
            "tricycle_controller/TricycleController",
            {"traction_joint_name": "left", "steering_joint_name": "right"},
            ("left",),
            ("right",),
        ),
        (
            "bicycle_steering_controller/BicycleSteeringController",
            {"traction_joints_names": "[left]", "steering_joints_names": "[right]"},
            ("left",),
            ("right",),
        ),
        # Humble's names, by front and rear.
        (
            "bicycle_steering_controller/BicycleSteeringController",
            {"rear_wheels_names": "[left]", "front_wheels_names": "[right]"},
            ("left",),
            ("right",),
        ),
        (
            "bicycle_steering_controller/BicycleSteeringController",
            {
                "front_steering": "false",
                "rear_wheels_names": "[left]",
                "front_wheels_names": "[right]",
            },
            ("right",),
            ("left",),
        ),
        (
            "omni_wheel_drive_controller/OmniWheelDriveController",
            {"wheel_names": "[left, right, missing]"},
            ("left", "right"),
            (),
        ),
        (
            "swerve_drive_controller/SwerveController",
            {"rear_left_wheel_joint": "left", "rear_left_axle_joint": "right"},
            ("left",),
            ("right",),
        ),
        # What isn't a name is the controller's affair.
        (
            "omni_wheel_drive_controller/OmniWheelDriveController",
            {"wheel_names": "3"},
            (),
            (),
        ),
    ],
)
def test_parameters_name_what_is_driven_and_steered(
    tmp_path: Path,
    type_name: str,
    parameters: dict[str, str],
    driven: tuple[str, ...],
    steered: tuple[str, ...],
) -> None:
    text = yaml(type_name, **parameters)

    (found,) = bases(tmp_path, cart(CONTROL), text)

    assert (found.controller, found.link) == ("c", "base_link")
    assert (found.driven, found.steered) == (driven, steered)


def test_the_frame_of_the_odometry_is_a_link_or_the_base(tmp_path: Path) -> None:
    names = {"left_wheel_names": "[left]", "right_wheel_names": "[right]"}
    diff = "diff_drive_controller/DiffDriveController"
    for frame, link in (("caster", "caster"), ("footprint", "base_link")):
        text = yaml(diff, base_frame_id=frame, **names)
        assert bases(tmp_path, cart(CONTROL), text)[0].link == link
    swerve = "swerve_drive_controller/SwerveController"
    text = yaml(swerve, base_footprint="caster")
    assert bases(tmp_path, cart(CONTROL), text)[0].link == "caster"


def test_wheels_behind_a_chained_controller_are_one_base(tmp_path: Path) -> None:
    names = {"left_wheel_names": "[pid/left]", "right_wheel_names": "[pid/right]"}
    text = yaml("diff_drive_controller/DiffDriveController", **names).replace(
        "    c: {", "    pid: {type: pid_controller/PidController}\n    c: {"
    )
    pid = """pid:
  ros__parameters:
    dof_names: [left, right]
    command_interface: velocity
    reference_and_state_interfaces: [velocity]
    gains: {left: {p: 0.0}, right: {p: 0.0}}
"""

    (found,) = bases(tmp_path, cart(CONTROL), text + pid)

    assert (found.controller, found.driven) == ("c", ("left", "right"))


def test_other_controllers_drive_no_base(tmp_path: Path) -> None:
    text = yaml("joint_state_broadcaster/JointStateBroadcaster")

    assert bases(tmp_path, cart(CONTROL), text) == []


@pytest.mark.parametrize("block", [diff_drive(), classic_drive()])
def test_plugins_of_gazebo_drive_bases_too(tmp_path: Path, block: str) -> None:
    (found,) = bases(tmp_path, cart(block))

    assert (set(found.driven), found.steered) == ({"left", "right"}, ())
    assert found.link == "base_link"


def test_mimic_joints_and_fixed_links_are_wheels_too(tmp_path: Path) -> None:
    mimic = '<mimic joint="finger" multiplier="-0.5" offset="0.1"/>'
    urdf = models.GRIPPER.replace(mimic, '<mimic joint="finger"/>').replace(
        "</robot>",
        models.bob("tyre")
        + '<joint name="glue" type="fixed"><parent link="right"/><child link="tyre"/>'
        "</joint></robot>",
    )
    description = models.load(tmp_path, urdf).description

    names = [joint.name for joint in moved_joints(description, "finger")]
    assert names == ["finger", "follower"]
    assert wheel_links(description, "finger") == ["left", "right", "tyre"]


def test_wheels_share_what_they_carry(tmp_path: Path) -> None:
    names = {"left_wheel_names": "[left]", "right_wheel_names": "[right]"}
    text = yaml("diff_drive_controller/DiffDriveController", **names)
    robot = models.load(tmp_path, cart(CONTROL), text)
    found = find_bases(robot.description, robot.controllers)

    load_inertia = find_load_inertia(robot.description, found)

    # The mass at the rim: m r^2, by two.
    share = total_mass(robot.description) * RADIUS**2 / 2.0
    assert load_inertia == pytest.approx({"left": share, "right": share})


SLIDING = '<gazebo reference="caster"><mu1>0</mu1></gazebo>'
VELOCITIES = yaml(
    "velocity_controllers/JointGroupVelocityController", joints="[left, right]"
)


def test_wheels_that_take_velocities_drive_the_base(tmp_path: Path) -> None:
    robot = models.load(tmp_path, cart(CONTROL, SLIDING), VELOCITIES)
    simulation = ad.Simulation(ad.build_diagram(robot))

    simulation.topic("/c/commands").publish([4.0, 4.0])
    simulation.advance_to(1.0)

    x = simulation.link_poses()["base_link"].translation()[0]
    # But for the first moments, in which they get up to it.
    assert x == pytest.approx(4.0 * RADIUS, rel=0.1)


def test_wheels_that_take_efforts_push_the_base(tmp_path: Path) -> None:
    control = models.ros2_control("left", "right", command="effort")
    kind = "effort_controllers/JointGroupEffortController"
    text = yaml(kind, joints="[left, right]")
    robot = models.load(tmp_path, cart(control, SLIDING), text)
    simulation = ad.Simulation(ad.build_diagram(robot))

    simulation.topic("/c/commands").publish([0.2, 0.2])
    simulation.advance_to(1.0)

    x = simulation.link_poses()["base_link"].translation()[0]
    # 0.2 N·m at each wheel push 6.2 kg and turn two wheels of 0.0025 kg·m^2.
    force, mass = 2.0 * 0.2 / RADIUS, 6.2 + 2.0 * 0.0025 / RADIUS**2
    assert x == pytest.approx(0.5 * force / mass, rel=0.05)


WORLD = """<link name="world"/><joint name="held" type="fixed">
  <parent link="world"/><child link="base_link"/></joint></robot>"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("</robot>", WORLD),
        # About axes that point up, with an end, one behind the other as of an arm.
        ('axis xyz="0 1 0"', 'axis xyz="0 0 1"'),
        (
            'type="continuous">',
            'type="revolute"><limit lower="-1" upper="1" effort="9" velocity="9"/>',
        ),
        (
            '<parent link="base_link"/><child link="right_wheel"/>',
            '<parent link="left_wheel"/><child link="right_wheel"/>',
        ),
        # What touches no ground: above the base's lowest point, or without a shape.
        (f'0.2 {RADIUS}"/><axis', f'0.2 {4.0 * RADIUS}"/><axis'),
        (
            f'<geometry><cylinder radius="{RADIUS}" length="0.04"/></geometry>',
            "<geometry/>",
        ),
    ],
)
def test_a_base_without_wheels_or_in_the_world_is_held(
    tmp_path: Path, old: str, new: str
) -> None:
    urdf = cart(CONTROL).replace(old, new)

    assert cart(CONTROL) != urdf
    assert not models.load(tmp_path, urdf, VELOCITIES).has_free_base


def test_a_base_with_one_wheel_that_is_commanded_is_held(tmp_path: Path) -> None:
    text = VELOCITIES.replace("[left, right]", "[left]")

    assert not models.load(tmp_path, cart(CONTROL), text).has_free_base


def test_rollers_in_a_gripper_free_no_arm(tmp_path: Path) -> None:
    text = VELOCITIES.replace("[left, right]", "[first, second]")
    rollers = "".join(
        models.bob(name)
        + f"""<joint name="{joint}" type="continuous"><parent link="elbow"/>
        <child link="{name}"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/></joint>"""
        for name, joint in (("upper", "first"), ("lower", "second"))
    )
    urdf = f"""<robot name="arm">{models.bob("foot")}{models.bob("elbow")}
      <joint name="lift" type="revolute"><parent link="foot"/><child link="elbow"/>
        <origin xyz="0 0 1"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="99" velocity="9"/></joint>
      {rollers}{models.ros2_control("first", "second", command="velocity")}</robot>"""
    shape = "<collision><geometry><sphere radius='0.05'/></geometry></collision></link>"

    robot = models.load(tmp_path, urdf.replace("</link>", shape), text)

    assert len(robot.description.link("upper").collisions) == 1
    assert not robot.has_free_base
