"""What drives and steers a base is found in the controllers' parameters."""

from pathlib import Path

import pytest

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
