"""Hardware of a description that has no `<ros2_control>`."""

from pathlib import Path

import pytest

from arm_drake.description.claimed_hardware import hardware_from_controllers
from arm_drake.description.controllers import ControllerConfig, ControllerManagerConfig
from arm_drake.description.joints import JointInfo, Mimic
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import InterfaceInfo

FILE = Path("arm.yaml")
JTC = "joint_trajectory_controller/JointTrajectoryController"
FORWARD = "forward_command_controller/ForwardCommandController"
MULTI = "forward_command_controller/MultiInterfaceForwardCommandController"
STEERING = "ackermann_steering_controller/AckermannSteeringController"
MECANUM = "mecanum_drive_controller/MecanumDriveController"


def controller(type: str, **parameters: object) -> ControllerConfig:
    inputs = {name: Parameter(value, FILE, 1) for name, value in parameters.items()}
    return ControllerConfig("c", type, inputs, FILE, 1)


def joint(name: str, mimic: str | None = None, type: str = "revolute") -> JointInfo:
    relation = None if mimic is None else Mimic(mimic)
    return JointInfo(name, type, "a", "b", mimic=relation)


JOINTS = (joint("j"), joint("k"))


def claim(
    *controllers: ControllerConfig, joints: tuple[JointInfo, ...] = JOINTS
) -> dict[str, list[str]]:
    """Return the command interfaces by joint."""
    config = ControllerManagerConfig(controllers=controllers)
    (block,) = hardware_from_controllers(config, joints, LoadReport(), Path("arm.urdf"))
    return {
        component.name: [interface.name for interface in component.command_interfaces]
        for component in block.joints
    }


def test_without_controllers_every_joint_takes_positions_and_reports_all():
    config = ControllerManagerConfig()
    report = LoadReport()

    (block,) = hardware_from_controllers(config, JOINTS, report, Path("arm.urdf"))

    assert block.type == "system"
    for component, name in zip(block.joints, "jk", strict=True):
        assert component.name == name
        assert component.command_interfaces == (InterfaceInfo("position"),)
        assert component.state_interfaces == tuple(
            map(InterfaceInfo, ("position", "velocity", "effort"))
        )
    assert [str(entry) for entry in report] == [
        "info: arm.urdf: the description has no <ros2_control>; "
        "joints take the commands that controllers claim, else positions: "
        "position (2 joints)"
    ]


def test_the_report_counts_joints_by_interface():
    config = ControllerManagerConfig(
        controllers=(
            controller(JTC, joints=["j"], command_interfaces=["position", "velocity"]),
        )
    )
    report = LoadReport()

    hardware_from_controllers(config, JOINTS, report, Path("arm.urdf"))

    (entry,) = report
    assert entry.done.endswith(": position (2 joints), velocity (1 joint)")


@pytest.mark.parametrize(
    ("configured", "expected"),
    [
        (controller(JTC, joints=["j"], command_interfaces=["effort"]), ["effort"]),
        (
            controller(JTC, joints=["j"], command_interfaces=["position", "velocity"]),
            ["position", "velocity"],
        ),
        (controller(JTC, joints=["j"]), ["position"]),
        (controller(FORWARD, joints=["j"], interface_name="velocity"), ["velocity"]),
        (
            controller(MULTI, joint="j", interface_names=["position", "kp"]),
            ["position", "kp"],
        ),
        (
            controller(
                "pid_controller/PidController",
                dof_names=["j"],
                command_interface="effort",
            ),
            ["effort"],
        ),
        (
            controller(
                "velocity_controllers/JointGroupVelocityController", joints=["j"]
            ),
            ["velocity"],
        ),
        (
            controller("effort_controllers/JointGroupEffortController", joints=["j"]),
            ["effort"],
        ),
        (
            controller("position_controllers/GripperActionController", joint="j"),
            ["position"],
        ),
        (
            controller("effort_controllers/GripperActionController", joint="j"),
            ["effort"],
        ),
        (
            controller(
                "parallel_gripper_action_controller/GripperActionController", joint="j"
            ),
            ["position"],
        ),
        (
            controller(
                "diff_drive_controller/DiffDriveController",
                left_wheel_names=["j"],
                right_wheel_names=["j"],
            ),
            ["velocity"],
        ),
        (controller(STEERING, traction_joints_names=["j"]), ["velocity"]),
        (controller(STEERING, steering_joints_names=["j"]), ["position"]),
        (controller(STEERING, rear_wheels_names=["j"]), ["velocity"]),
        (controller(STEERING, front_wheels_names=["j"]), ["position"]),
        (
            controller(STEERING, rear_wheels_names=["j"], front_steering=False),
            ["position"],
        ),
        (
            controller(STEERING, front_wheels_names=["j"], front_steering=False),
            ["velocity"],
        ),
        (
            controller(MECANUM, front_left_wheel_command_joint_name="j"),
            ["velocity"],
        ),
        (
            controller(
                "tricycle_controller/TricycleController", traction_joint_name="j"
            ),
            ["velocity"],
        ),
        # Broadcasters claim nothing, so the joint is left with a position.
        (
            controller(
                "joint_state_broadcaster/JointStateBroadcaster",
                joints=["j"],
                command_interfaces=["velocity"],
            ),
            ["position"],
        ),
        # Malformed values are the controller's error.
        (controller(JTC, joints=3), ["position"]),
        (controller(JTC, joints=["j"], command_interfaces=[1]), ["position"]),
    ],
)
def test_a_joint_takes_what_its_controller_claims(configured, expected):
    assert claim(configured) == {"j": expected, "k": ["position"]}


def test_claims_of_several_controllers_add_up():
    assert claim(
        controller(JTC, joints=["j", "k"], command_interfaces=["position"]),
        controller(FORWARD, joints=["k"], interface_name="velocity"),
        controller(FORWARD, joints=["k"], interface_name="position"),
    ) == {"j": ["position"], "k": ["position", "velocity"]}


def test_command_joints_replace_the_joints():
    assert claim(
        controller(
            JTC, joints=["j"], command_joints=["k"], command_interfaces=["effort"]
        )
    ) == {"j": ["position"], "k": ["effort"]}


def test_command_joints_may_stand_alone():
    only = controller(JTC, command_joints=["k"], command_interfaces=["effort"])

    assert claim(only) == {"j": ["position"], "k": ["effort"]}


def test_front_steering_may_be_said_to_be_true():
    only = controller(STEERING, rear_wheels_names=["j"], front_steering=True)

    assert claim(only) == {"j": ["velocity"], "k": ["position"]}


def test_joints_of_the_controllers_that_the_robot_lacks_are_passed_over():
    assert claim(controller(JTC, joints=["x"])) == {
        "j": ["position"],
        "k": ["position"],
    }


def test_mimic_joints_take_no_commands_and_fixed_joints_are_none():
    joints = (joint("j"), joint("k", "j"), joint("f", type="fixed"))

    assert claim(controller(JTC, joints=["j", "k", "f"]), joints=joints) == {
        "j": ["position"],
        "k": [],
    }


def test_a_robot_without_movable_joints_has_no_hardware():
    report = LoadReport()
    joints = (joint("f", type="fixed"),)

    assert (
        hardware_from_controllers(
            ControllerManagerConfig(), joints, report, Path("arm.urdf")
        )
        == ()
    )
    assert len(report) == 0
