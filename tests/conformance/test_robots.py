"""Real robots, unchanged: what their index says is found, and they simulate.

The index may be another one: `ARM_DRAKE_ROBOTS` names its folder.
"""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.drive_gains import find_drive_gains
from arm_drake.description.plugin_control import PLUGIN_TYPES
from arm_drake.manager.loading import load_controllers_of
from tests.robots import load_real_robot, read_index, robot_names, robots_folder

# The types that are simulated, and names of other packages for the same. To be extended
# with every new one.
SIMULATED = {
    "joint_state_broadcaster/JointStateBroadcaster",
    "joint_trajectory_controller/JointTrajectoryController",
    "joint_state_controller/JointStateController",
    "ur_controllers/ScaledJointTrajectoryController",
    "forward_command_controller/ForwardCommandController",
    "forward_command_controller/MultiInterfaceForwardCommandController",
    "position_controllers/JointGroupPositionController",
    "velocity_controllers/JointGroupVelocityController",
    "effort_controllers/JointGroupEffortController",
    "pid_controller/PidController",
    "diff_drive_controller/DiffDriveController",
    "bicycle_steering_controller/BicycleSteeringController",
    "tricycle_steering_controller/TricycleSteeringController",
    "ackermann_steering_controller/AckermannSteeringController",
    "tricycle_controller/TricycleController",
    "mecanum_drive_controller/MecanumDriveController",
    "omni_wheel_drive_controller/OmniWheelDriveController",
    "swerve_drive_controller/SwerveController",
    "admittance_controller/AdmittanceController",
    "gpio_controllers/GpioCommandController",
    "passthrough_controller/PassthroughController",
    "chained_filter_controller/ChainedFilter",
    "imu_sensor_broadcaster/IMUSensorBroadcaster",
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
    "range_sensor_broadcaster/RangeSensorBroadcaster",
    "pose_broadcaster/PoseBroadcaster",
    "gps_sensor_broadcaster/GPSSensorBroadcaster",
    "magnetometer_broadcaster/MagnetometerBroadcaster",
    "battery_state_broadcaster/BatteryStateBroadcaster",
    "state_interfaces_broadcaster/StateInterfacesBroadcaster",
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster",
    "position_controllers/GripperActionController",
    "effort_controllers/GripperActionController",
    "parallel_gripper_action_controller/GripperActionController",
    *PLUGIN_TYPES.values(),
}

# How long they simulate [s], and how far a held joint may be off its start [rad, m].
DURATION = 1.0
HOLD_TOLERANCE = 5e-3


@dc.dataclass(frozen=True)
class Case:
    """A robot as loaded, and what the index expects of it."""

    robot: ad.Robot
    expected: dict[str, Any]


@pytest.fixture(scope="module", params=robot_names())
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Case:
    row = read_index()[request.param]
    return Case(load_real_robot(request.param), row["expected"])


def test_links_and_joints_are_those_of_the_index(case: Case) -> None:
    description, expected = case.robot.description, case.expected

    assert description.name == expected["robot_name"]
    movable = [joint.name for joint in description.movable_joints]
    assert movable == expected["movable_joints"]
    for key, found in (
        ("links", len(description.links)),
        ("joints", len(description.joints)),
        ("root_links", _roots(description)),
    ):
        if expected.get(key) is not None:
            assert found == expected[key], key


def _roots(description: Any) -> list[str]:
    children = {joint.child for joint in description.joints}
    return [link for link in description.links if link not in children]


def test_mimic_joints_follow_as_the_index_says(case: Case) -> None:
    joints = case.robot.description.movable_joints
    mimics = {joint.name: joint.mimic for joint in joints if joint.mimic}

    expected = case.expected["mimic"]
    assert list(mimics) == [m["joint"] if isinstance(m, dict) else m for m in expected]
    for mimic in expected:
        if isinstance(mimic, dict):
            found = mimics[mimic["joint"]]
            assert found.joint == mimic["of"]
            assert found.multiplier == mimic.get("multiplier", 1.0)
            assert found.offset == mimic.get("offset", 0.0)


def test_controllers_are_those_of_the_index(case: Case) -> None:
    config, expected = case.robot.controllers, case.expected

    if expected.get("update_rate") is not None:
        assert config.update_rate == expected["update_rate"]
    found = {controller.name: controller for controller in config.controllers}
    for name, parts in (expected.get("controllers") or {}).items():
        assert found[name].type == parts["type"]


def test_the_controllers_that_are_not_simulated_are_reported_exactly(
    case: Case,
) -> None:
    _, report = load_controllers_of(case.robot)

    reported = {
        entry.where
        for entry in report
        if entry.kind == "unsupported" and "controller type" in entry.what
    }
    # Those of a YAML; the others stand for tags.
    configured = [c for c in case.robot.controllers.controllers if not c.plugins]
    assert reported == {c.name for c in configured if c.type not in SIMULATED}
    expected = case.expected.get("controllers") or {}
    assert {n for n, c in expected.items() if c["type"] not in SIMULATED} <= reported
    # The others are there, unless a parameter or an interface is missing.
    for name, parts in expected.items():
        if parts["type"] in SIMULATED and parts.get("command_interfaces"):
            assert name in _active_controllers(case.robot), name


def _active_controllers(robot: ad.Robot) -> set[str]:
    controllers, _ = load_controllers_of(robot)
    claimed = {c.name for c in controllers if c.state == "active"}
    # An earlier one that moves the same joints keeps a controller inactive, rightly.
    return claimed | {
        c.name
        for c in controllers
        if any(
            set(c.joints) & set(other.joints)
            for other in controllers
            if other.name in claimed
        )
    }


@pytest.mark.parametrize("preset", ["accurate", "fast"])
def test_it_simulates_and_holds_what_its_controllers_hold(
    case: Case, preset: str
) -> None:
    robot, options = case.robot, ad.SimulationOptions(preset=preset)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    if any(entry.what.startswith("fast: ") for entry in simulation.report):
        return  # It is simulated with "accurate", and is a case of that.

    simulation.advance_to(DURATION)

    rollout = simulation.rollout()
    assert rollout.time[-1] >= DURATION - 0.11
    for values in (rollout.position, rollout.velocity, rollout.effort):
        assert np.isfinite(values).all()
    if any(entry.done == "the joint sinks" for entry in simulation.report):
        # Its effort limits are too low, and the whole arm sags.
        return
    start = [robot.initial_positions[name] for name in rollout.joint_names]
    error = np.abs(rollout.position - start).max(axis=0)
    # PID gains of its own know nothing of its weight.
    held = _held_joints(robot) - find_drive_gains(robot, simulation.report).keys()
    deviations = dict(zip(rollout.joint_names, error, strict=True))
    assert all(deviations[name] <= HOLD_TOLERANCE for name in held), deviations


def _held_joints(robot: ad.Robot) -> set[str]:
    """Return the joints whose positions active controllers command."""
    controllers, _ = load_controllers_of(robot)
    return {
        interface.rpartition("/")[0]
        for controller in controllers
        if controller.state == "active" and controller.system is not None
        for interface in controller.system.command_interfaces
        if interface.endswith("/position")
    }


def test_an_arm_too_weak_for_its_weight_is_reported() -> None:
    rows = {name: row for name, row in read_index().items() if name == "denso_cobotta"}
    for row in rows.values():  # In the folder that this was written for.
        robot = ad.load_robot(
            robots_folder() / row["entry"], xacro_args=row["xacro_args"]
        )
        lines = [entry for entry in robot.report if "gravity asks" in entry.what]
        wheres = {entry.where: entry.what for entry in lines}
        assert wheres["joint 'joint_2'"] == (
            "gravity asks for 7.7 N·m in some poses, the effort limit is 1 N·m"
        )
