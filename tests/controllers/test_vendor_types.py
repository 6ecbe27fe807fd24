"""Types of other packages: some are one of ours, of others the report knows more."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake import cli
from arm_drake.controllers import CONTROLLER_TYPES, find_controller_type
from arm_drake.controllers.registry import load_other_types
from tests import models

JTC = "joint_trajectory_controller/JointTrajectoryController"
JSB = "joint_state_broadcaster/JointStateBroadcaster"

EQUIVALENTS, HARDWARE_ONLY, OTHERS = load_other_types()

# Every name that is run as a trajectory controller, as C++ calls it too.
TRAJECTORY_TYPES = [
    *(name for name in EQUIVALENTS if "Trajectory" in name),
    "ur_controllers/ScaledJointTrajectoryController",
    "joint_trajectory_controller::JointTrajectoryController",
]

INTERFACES = (
    "command_interfaces: [position]\n    state_interfaces: [position, velocity]"
)


def yaml(type_: str, parameters: str = "") -> str:
    """Return a YAML with a controller of a type and a joint_state_broadcaster."""
    section = f"\narm:\n  ros__parameters:\n    {parameters}\n" if parameters else ""
    return f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {{type: {type_}}}
    jsb: {{type: {JSB}}}
{section}"""


def load(folder: Path, type_: str, parameters: str = "", command: str = "") -> ad.Robot:
    control = models.ros2_control("swing", command=command or "position")
    urdf = models.pendulum(control=control)
    return models.load(folder, urdf, yaml(type_, parameters))


def lines(robot: ad.Robot) -> list[str]:
    """Return the lines of the report, without folders."""
    return [str(entry).replace(f"{entry.file}", "file") for entry in robot.report]


def states(robot: ad.Robot) -> dict[str, str]:
    controllers = ad.Simulation(ad.build_diagram(robot)).list_controllers()
    return {controller.name: controller.state for controller in controllers}


def follow(robot: ad.Robot) -> ad.Rollout:
    """Return what a goal for the joint does."""
    simulation = ad.Simulation(ad.build_diagram(robot))
    point = ad.JointTrajectoryPoint(positions=(0.3,), time_from_start=0.5)
    goal = ad.JointTrajectory(joint_names=("swing",), points=(point,))
    simulation.controller("arm").send_goal(goal)
    simulation.advance_to(1.0)
    return simulation.rollout()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> ad.Rollout:
    folder = tmp_path_factory.mktemp("reference")
    return follow(load(folder, JTC, f"joints: [swing]\n    {INTERFACES}"))


@pytest.mark.slow
@pytest.mark.parametrize("type_", TRAJECTORY_TYPES)
def test_it_moves_as_a_trajectory_controller_and_is_reported(
    tmp_path: Path, type_: str, reference: ad.Rollout
) -> None:
    robot = load(tmp_path, type_, f"joints: [swing]\n    {INTERFACES}")

    rollout = follow(robot)

    assert lines(robot) == [
        f"info: file:5: arm: controller type '{type_}'; run as {JTC}"
    ]
    # 0.5 s after its end, 20 time constants of the servo's 40 rad/s.
    assert rollout.position[-1, 0] == pytest.approx(0.3, abs=1e-4)
    np.testing.assert_array_equal(rollout.position, reference.position)


@pytest.mark.parametrize("interface", ["position", "velocity", "effort"])
def test_a_name_of_ros_1_says_what_it_commands(tmp_path: Path, interface: str) -> None:
    type_ = f"{interface}_controllers/JointTrajectoryController"
    gains = "joints: [swing]\n    gains: {swing: {p: 1.0}}"

    robot = load(tmp_path, type_, gains, command=interface)

    assert [entry.severity for entry in robot.report.errors] == []
    (arm, _) = ad.Simulation(ad.build_diagram(robot)).list_controllers()
    assert arm.state == "active"
    row = find_controller_type(type_)
    assert row is not None
    parameters = row.parameters(joints=("swing",))
    assert parameters.command_interfaces == (interface,)
    assert parameters.state_interfaces == ("position", "velocity")


def test_what_is_written_counts_more_than_a_name_of_ros_1(tmp_path: Path) -> None:
    type_ = "velocity_controllers/JointTrajectoryController"

    robot = load(tmp_path, type_, f"joints: [swing]\n    {INTERFACES}")

    assert states(robot) == {"arm": "active", "jsb": "active"}  # Of a position.


def test_the_scaled_one_of_another_vendor_has_that_ones_parameters(
    tmp_path: Path,
) -> None:
    type_ = "eli_cs_controllers/ScaledJointTrajectoryController"
    more = "speed_scaling_interface_name: speed_scaling/speed_scaling_factor"

    robot = load(tmp_path, type_, f"joints: [swing]\n    {INTERFACES}\n    {more}")

    # The robot doesn't tell a factor, which upstream needs as well.
    (line,) = [text for text in lines(robot) if "error" in text]
    assert "the robot has no joint, sensor or gpio 'speed_scaling'" in line


def test_the_gripper_that_upstreams_warning_names_is_the_parallel_one(
    tmp_path: Path,
) -> None:
    type_ = "parallel_gripper_controllers/GripperActionController"

    robot = load(tmp_path, type_, "joint: swing")

    right = "parallel_gripper_action_controller/GripperActionController"
    line = f"info: file:5: arm: controller type '{type_}'; run as {right}"
    assert line in lines(robot)
    assert find_controller_type(type_) == CONTROLLER_TYPES[right]._replace(
        runs_as=right
    )


@pytest.mark.parametrize(
    ("type_", "what"),
    [
        (
            "ur_controllers/PassthroughTrajectoryController",
            "is not simulated: it hands whole trajectories to the real robot; the "
            f"closest type is {JTC}",
        ),
        (
            "effort_controllers/JointPositionController",
            "is not simulated: it is of ROS 1, a PID with other parameters; the "
            "closest type is pid_controller/PidController",
        ),
        (
            "position_controllers/JointPositionController",
            "is not simulated: it is of ROS 1, and takes one 'joint'; the closest type "
            "is position_controllers/JointGroupPositionController with 'joints'",
        ),
        (  # By its package.
            "franka_example_controllers/MoveToStartExampleController",
            "is not simulated: it is an example of what Franka's own controller can "
            f"do; the closest type is {JTC}",
        ),
        (
            "cartesian_trajectory_controller/CartesianTrajectoryController",
            "is not simulated: it makes trajectories of Cartesian poses; the closest "
            f"type is {JTC}",
        ),
        (
            "ffw_swerve_drive_controller/SwerveDriveController",
            "is not simulated: it steers and drives each wheel of a base, with "
            "parameters of its own; the closest type is "
            "velocity_controllers/JointGroupVelocityController with the wheels, beside "
            "a position_controllers/JointGroupPositionController that steers them",
        ),
        (  # A fork.
            "swerve_drive_controller/SwerveDriveController",
            "is not simulated: it steers and drives each wheel of a base, with "
            "parameters of its own; the closest type is "
            "swerve_drive_controller/SwerveController",
        ),
        (
            "epick_controllers/EpickGripperActionController",
            "is not simulated: it switches suction, of which the physics knows nothing",
        ),
    ],
)
def test_a_type_without_equivalent_is_an_error_that_helps(
    tmp_path: Path, type_: str, what: str
) -> None:
    robot = load(tmp_path, type_, "joints: [swing]")

    assert lines(robot) == [
        f"error: file:5: arm: controller type '{type_}' {what}; the controller does "
        "not run"
    ]
    assert states(robot) == {"arm": "unconfigured", "jsb": "active"}


@pytest.mark.parametrize(
    ("type_", "hint"),
    [
        ("my_package/MyController", ""),
        ("JointStateBroadcaster", f"; did you mean '{JSB}'?"),
        (JTC.replace("Trajectory", "Trajektory"), f"; did you mean '{JTC}'?"),
        (JTC.replace("Controller", "Controler"), f"; did you mean '{JTC}'?"),
        # That both are controllers makes them no likely mistake.
        (
            "gpio_controller/GPIOController",
            "; did you mean 'gpio_controllers/GpioCommandController'?",
        ),
        ("joint_controller/JointController", ""),
        ("odd_controller/OddController", ""),
    ],
)
def test_an_unknown_type_is_an_error(tmp_path: Path, type_: str, hint: str) -> None:
    robot = load(tmp_path, type_)

    assert lines(robot) == [
        f"error: file:5: arm: unknown controller type '{type_}'{hint}; the controller "
        "does not run"
    ]
    assert states(robot) == {"arm": "unconfigured", "jsb": "active"}


@pytest.mark.slow
@pytest.mark.parametrize("type_", HARDWARE_ONLY)
def test_what_only_serves_hardware_is_no_defect(
    tmp_path: Path, type_: str, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = load(tmp_path, type_, "some: 1.0")

    (line,) = lines(robot)
    assert line.startswith(f"info: file:5: arm: controller type '{type_}' only ")
    assert line.endswith("; left out; a simulation lacks nothing")
    files = [str(tmp_path / name) for name in ("robot.urdf", "controllers.yaml")]
    assert cli.main(["check", files[0], "--controllers", files[1]]) == 0
    assert line.removeprefix("info: file:5: ") in capsys.readouterr().out


def test_the_tables_are_read_for_an_unknown_type_alone(tmp_path: Path) -> None:
    load_other_types.cache_clear()

    load(tmp_path, JTC)
    assert load_other_types.cache_info().currsize == 0

    load(tmp_path, "my_package/MyController")
    assert load_other_types.cache_info().currsize == 1


def test_the_rest_of_the_robot_runs_without_it(tmp_path: Path) -> None:
    robot = load(tmp_path, "robotiq_controllers/RobotiqActivationController")

    assert states(robot) == {"arm": "unconfigured", "jsb": "active"}


def test_no_type_has_two_answers() -> None:
    tables = [CONTROLLER_TYPES, EQUIVALENTS, HARDWARE_ONLY, OTHERS]

    names = [name for table in tables for name in table]
    assert len(names) == len(set(names))


def test_what_is_said_to_be_closest_exists() -> None:
    for name, other in OTHERS.items():
        if other.closest:
            closest = other.closest.partition(" with ")[0].partition(",")[0]
            assert not CONTROLLER_TYPES[closest].runs_as, name
    for name, equivalent in EQUIVALENTS.items():
        assert CONTROLLER_TYPES[equivalent.runs_as].system is not None, name
