"""Controller types of other packages."""

import dataclasses as dc
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake import controllers
from arm_drake.controllers import ControllerType, find_controller_type
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.registry import describe_unknown
from arm_drake.errors import InputError
from arm_drake.messages import NANOSECONDS
from tests import models
from tests.robots import skip_or_fail

TYPE = "my_controllers/Wave"
JTC = "joint_trajectory_controller/JointTrajectoryController"

# Every controller type of ros2_controllers, from humble to rolling. Source: the plugin
# descriptions of its packages.
ROS2_CONTROLLERS = {
    "ackermann_steering_controller/AckermannSteeringController",
    "admittance_controller/AdmittanceController",
    "battery_state_broadcaster/BatteryStateBroadcaster",
    "bicycle_steering_controller/BicycleSteeringController",
    "chained_filter_controller/ChainedFilter",
    "diff_drive_controller/DiffDriveController",
    "effort_controllers/GripperActionController",
    "effort_controllers/JointGroupEffortController",
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
    "forward_command_controller/ForwardCommandController",
    "forward_command_controller/MultiInterfaceForwardCommandController",
    "gpio_controllers/GpioCommandController",
    "gps_sensor_broadcaster/GPSSensorBroadcaster",
    "imu_sensor_broadcaster/IMUSensorBroadcaster",
    "joint_state_broadcaster/JointStateBroadcaster",
    "joint_trajectory_controller/JointTrajectoryController",
    "magnetometer_broadcaster/MagnetometerBroadcaster",
    "mecanum_drive_controller/MecanumDriveController",
    "motion_primitives_controllers/MotionPrimitivesForwardController",
    "motion_primitives_controllers/MotionPrimitivesFromTrajectoryController",
    "omni_wheel_drive_controller/OmniWheelDriveController",
    "parallel_gripper_action_controller/GripperActionController",
    "pid_controller/PidController",
    "pose_broadcaster/PoseBroadcaster",
    "position_controllers/GripperActionController",
    "position_controllers/JointGroupPositionController",
    "range_sensor_broadcaster/RangeSensorBroadcaster",
    "state_interfaces_broadcaster/StateInterfacesBroadcaster",
    "swerve_drive_controller/SwerveController",
    "tricycle_controller/TricycleController",
    "tricycle_steering_controller/TricycleSteeringController",
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster",
    "velocity_controllers/JointGroupVelocityController",
}

# Those that need what a simulation doesn't have: a vendor's own controller of motions.
UNSUPPORTED = {
    "motion_primitives_controllers/MotionPrimitivesForwardController",
    "motion_primitives_controllers/MotionPrimitivesFromTrajectoryController",
}

# The specification, where it lies beside the project; and a type in its text.
SPECIFICATION = Path(__file__).parents[3] / "shared" / "spec" / "controllers.md"
TYPE_NAME = re.compile(r"`([a-z_0-9]+/[A-Z]\w+)((?:\|\w+)*)`")

YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    wave: {{type: {TYPE}}}
wave:
  ros__parameters:
    joints: [swing]
    amplitude: 0.2
"""


@dc.dataclass(frozen=True)
class WaveParameters:
    """Parameters of a Wave."""

    joints: tuple[str, ...]
    amplitude: float = 0.1


class Wave(TickingController[float]):
    """Moves joints to and fro, once a second; its state is the time [s]."""

    def __init__(
        self, parameters: WaveParameters, params: ControllerInterfaceParams
    ) -> None:
        self._size = len(parameters.joints)
        self._amplitude = parameters.amplitude
        claims = tuple(f"{joint}/position" for joint in parameters.joints)
        super().__init__(params, 0.0, state_interfaces=(), command_interfaces=claims)

    def _update(self, now: UpdateContext, state: float) -> float:
        return now.time_ns / NANOSECONDS

    def _command(self, state: float) -> Any:
        return np.full(self._size, self._amplitude * math.sin(2.0 * math.pi * state))


class Counter(TickingController[dict[str, int]]):
    """Counts its calls by kind."""

    def __init__(
        self, parameters: WaveParameters, params: ControllerInterfaceParams
    ) -> None:
        super().__init__(params, {})
        self._declare_topic("calls", lambda calls: calls)

    def _update(self, now: UpdateContext, state: dict[str, int]) -> dict[str, int]:
        return count(state, "update")

    def _activate(self, now: UpdateContext, state: dict[str, int]) -> dict[str, int]:
        return count(state, "activate")

    def _deactivate(self, now: UpdateContext, state: dict[str, int]) -> dict[str, int]:
        return count(state, "deactivate")

    def _idle(self, now: UpdateContext, state: dict[str, int]) -> dict[str, int]:
        return count(state, "idle")


def count(calls: dict[str, int], kind: str) -> dict[str, int]:
    return {**calls, kind: calls.get(kind, 0) + 1}


class Watcher(ControllerInterface):
    """Shows the positions of joints, and has no tick."""

    def __init__(
        self, parameters: WaveParameters, params: ControllerInterfaceParams
    ) -> None:
        names = tuple(f"{joint}/position" for joint in parameters.joints)
        super().__init__(params, state_interfaces=names)
        self.DeclareVectorOutputPort(
            "positions",
            len(names),
            lambda context, output: output.SetFromVector(self._read(context)),
            prerequisites_of_calc={self._measured.ticket()},
        )


@pytest.fixture(autouse=True)
def own_types(monkeypatch):
    """Leave the registry as it is after each test."""
    types = dict(controllers.CONTROLLER_TYPES)
    monkeypatch.setattr(controllers, "CONTROLLER_TYPES", types)


def make_simulation(folder: Path) -> ad.Simulation:
    robot = models.load(folder, models.pendulum(), YAML)
    return ad.Simulation(ad.build_diagram(robot))


def simulate(folder: Path) -> ad.Rollout:
    simulation = make_simulation(folder)
    simulation.advance_to(2.0)
    return simulation.rollout()


@pytest.mark.slow
def test_a_type_of_ones_own_moves_the_robot(tmp_path):
    ad.register_controller(TYPE, WaveParameters, Wave)

    rollout = simulate(tmp_path)

    late = rollout.position[100:, 0]
    assert late.max() == pytest.approx(0.2, abs=0.01)
    assert late.min() == pytest.approx(-0.2, abs=0.01)


def test_the_life_of_a_controller_calls_its_hooks(tmp_path):
    ad.register_controller(TYPE, WaveParameters, Counter)
    simulation = make_simulation(tmp_path)

    simulation.advance_to(0.095)
    simulation.switch_controllers(deactivate=["wave"])
    simulation.advance_to(0.145)

    # Ten cycles from 0 on, then five.
    expected = {"activate": 1, "update": 10, "deactivate": 1, "idle": 5}
    assert simulation.eval_output("wave.calls") == expected


def test_a_type_of_ones_own_needs_no_tick(tmp_path):
    ad.register_controller(TYPE, WaveParameters, Watcher)
    simulation = make_simulation(tmp_path)

    simulation.advance_to(0.05)

    measured = simulation.joint_states().position
    assert tuple(simulation.eval_output("wave.positions")) == measured


def test_without_it_the_type_is_unknown(tmp_path):
    robot = models.load(tmp_path, models.pendulum(), YAML)

    assert f"unknown controller type {TYPE!r}" in str(robot.report)


@pytest.mark.parametrize("name", [JTC, TYPE])
def test_a_type_is_registered_once(name):
    ad.register_controller(TYPE, WaveParameters, Wave)

    with pytest.raises(ValueError, match=f"'{name}' is registered already"):
        ad.register_controller(name, WaveParameters, Wave)


@pytest.mark.parametrize(
    ("parameters", "system", "message"),
    [
        (dict, Wave, "register_controller: parameters: expected a dataclass"),
        (WaveParameters(()), Wave, "register_controller: parameters: expected a data"),
        (WaveParameters, "Wave", "system: expected a class or a function, got 'Wave'"),
    ],
)
def test_what_is_registered_must_be_usable(parameters, system, message):
    with pytest.raises(InputError, match=message):
        ad.register_controller(TYPE, parameters, system)

    assert find_controller_type(TYPE) is None


def test_a_bug_of_ours_is_no_line_of_a_report(tmp_path):
    def fail(parameters, params):
        raise ZeroDivisionError("ours")

    controllers.CONTROLLER_TYPES[TYPE] = ControllerType(WaveParameters, fail)

    with pytest.raises(ZeroDivisionError, match="ours"):
        models.load(tmp_path, models.pendulum(), YAML)


def test_a_robots_own_type_comes_before_all_others():
    ad.register_controller(TYPE, WaveParameters, Wave)
    own = {TYPE: ControllerType(WaveParameters, Watcher)}

    assert find_controller_type(TYPE, own).system is Watcher
    assert find_controller_type(TYPE, {}).system is Wave


def test_who_brought_a_type_is_known():
    ad.register_controller(TYPE, WaveParameters, Wave)

    assert find_controller_type(TYPE).origin == "register_controller"
    assert find_controller_type(JTC).origin == ""


@pytest.mark.parametrize("name", sorted(ROS2_CONTROLLERS - UNSUPPORTED))
def test_every_type_of_ros2_controllers_is_simulated(name):
    row = find_controller_type(name, installed={})

    assert row is not None
    assert row.system is not None
    assert not row.runs_as


@pytest.mark.parametrize("name", sorted(UNSUPPORTED))
def test_what_can_not_be_simulated_is_said(name):
    assert find_controller_type(name, installed={}) is None

    _, what, done = describe_unknown(name, [])

    assert "unknown" not in what
    assert done in (
        "the controller does not run",
        "left out; a simulation lacks nothing",
    )


def test_the_list_has_all_types_of_the_specification():
    if not SPECIFICATION.is_file():
        skip_or_fail("there is no specification")
    text = SPECIFICATION.read_text(encoding="utf-8")
    text = text[text.index("\n# C. ") : text.index("\n# D. ")]
    # The end of the part is about types of other packages, and about filters.
    types = {
        name
        for name, _ in TYPE_NAME.findall(text.partition("- third-party strings")[0])
        if not name.startswith(("control_filters/", "filters/", "kinematics_"))
    }

    assert len(types) > 25
    assert types <= ROS2_CONTROLLERS
    # Newer than the specification.
    newer = {
        "swerve_drive_controller/SwerveController",
        "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster",
    }
    assert ROS2_CONTROLLERS - types <= UNSUPPORTED | newer
