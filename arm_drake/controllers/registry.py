"""Our controller types, by their ros2_control names: those of ros2_controllers.

Controller types of other packages that are one of ours by another name.

Vendors' drivers bring types of their own, and names of ROS 1 live on in files for
ROS 2. Only those are here whose parameters, actions and behaviour in a simulation are
those of one of ros2_control's types; where that can be read stands beside each. They
are run as it, and the report says so.
"""

import dataclasses as dc
import functools
import importlib
import importlib.metadata
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any, Literal, NamedTuple

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.errors import InputError
from arm_drake.importing import without_collection


class ControllerType(NamedTuple):
    """How to parse and build one type of controller."""

    parameters: type

    # None if its parameters are read, but it isn't simulated yet.
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface] | None = (
        None
    )

    # The type that it is run as, if not itself.
    runs_as: str = ""

    # Who brought it, if not this package, and who brings one of this name too; what
    # finds it says so.
    origin: str = ""
    others: tuple[str, ...] = ()


def check_controller_type(row: object, origin: str) -> ControllerType:
    """Return a controller type that somebody else brings.

    Args:
        row: What they bring.
        origin: Where it comes from, for the message.

    Raises:
        InputError: If it isn't a usable ControllerType.
    """
    if not isinstance(row, ControllerType):
        raise InputError(f"{origin}: expected an arm_drake.ControllerType, got {row!r}")
    if not (isinstance(row.parameters, type) and dc.is_dataclass(row.parameters)):
        raise InputError(
            f"{origin}: parameters: expected a dataclass, got {row.parameters!r}"
        )
    if row.system is not None and not callable(row.system):
        raise InputError(
            f"{origin}: system: expected a class or a function, got {row.system!r}"
        )
    return row


def check_controller_types(types: object) -> dict[str, ControllerType]:
    """Return controller types by name, as `load_robot` takes them.

    Args:
        types: A mapping of names to types.

    Raises:
        InputError: If it is none.
    """
    if not isinstance(types, Mapping) or not all(isinstance(n, str) for n in types):
        raise InputError(
            "controller_types: expected a mapping of names to "
            f"arm_drake.ControllerType, got {types!r}"
        )
    return {
        name: check_controller_type(row, f"controller_types[{name!r}]")
        for name, row in types.items()
    }


class LazyType(NamedTuple):
    """A type that isn't imported yet: modules of this package, and names in them."""

    # Dataclass of the parameters, and where it is.
    parameters: str
    module: str

    # Class of the system, and where it is if not there, too. Without one its parameters
    # are read, but it isn't simulated.
    system: str = ""
    system_module: str = ""

    # The `interface` that the system is made with, of one for several types.
    interface: str = ""

    runs_as: str = ""

    def load(self) -> ControllerType:
        """Import it."""
        parameters = _find(self.module, self.parameters)
        if not self.system:
            return ControllerType(parameters, runs_as=self.runs_as)
        system = _find(self.system_module or self.module, self.system)
        if self.interface:
            system = functools.partial(system, interface=self.interface)
        return ControllerType(parameters, system, self.runs_as)


class ControllerTypes(MutableMapping[str, ControllerType]):
    """Controller types by name, each imported when it is first asked for."""

    def __init__(self, rows: dict[str, LazyType]) -> None:
        """Create the table of some types.

        Args:
            rows: They, by name.
        """
        self._rows: dict[str, ControllerType | LazyType] = {**rows}
        self._added: dict[str, ControllerType] = {}

    @property
    def added(self) -> dict[str, ControllerType]:
        """Types that were added since, by name."""
        return dict(self._added)

    def __getitem__(self, name: str) -> ControllerType:
        """Return a type."""
        row = self._rows[name]
        if isinstance(row, LazyType):
            row = self._rows[name] = row.load()
        return row

    def __setitem__(self, name: str, row: ControllerType) -> None:
        """Add a type."""
        self._rows[name] = self._added[name] = row

    def __delitem__(self, name: str) -> None:
        """Remove a type."""
        del self._rows[name]
        self._added.pop(name, None)

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._rows)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._rows)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a type; it isn't imported for that."""
        return name in self._rows


def _find(module: str, name: str) -> Any:
    with without_collection():
        found = importlib.import_module(f"arm_drake.controllers.{module}")
    return getattr(found, name)


_JSB = "joint_state_broadcaster/JointStateBroadcaster"
_JTC = "joint_trajectory_controller/JointTrajectoryController"

# Ours; those without a system have their parameters checked alone.
STANDARD_TYPES: dict[str, LazyType] = {
    _JSB: LazyType(
        "JointStateBroadcasterParameters",
        "joint_state_broadcaster",
        "JointStateBroadcaster",
    ),
    _JTC: LazyType(
        "JointTrajectoryControllerParameters",
        "joint_trajectory.parameters",
        "JointTrajectoryController",
        "joint_trajectory.controller",
    ),
    "forward_command_controller/ForwardCommandController": LazyType(
        "ForwardCommandControllerParameters",
        "forward_command_controller",
        "ForwardCommandController",
    ),
    "forward_command_controller/MultiInterfaceForwardCommandController": LazyType(
        "MultiInterfaceForwardCommandControllerParameters",
        "forward_command_controller",
        "MultiInterfaceForwardCommandController",
    ),
    "position_controllers/JointGroupPositionController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="position",
    ),
    "velocity_controllers/JointGroupVelocityController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="velocity",
    ),
    "effort_controllers/JointGroupEffortController": LazyType(
        "JointGroupControllerParameters",
        "forward_command_controller",
        "JointGroupController",
        interface="effort",
    ),
    "position_controllers/GripperActionController": LazyType(
        "GripperActionControllerParameters",
        "gripper_controllers",
        "GripperActionController",
    ),
    "effort_controllers/GripperActionController": LazyType(
        "EffortGripperActionControllerParameters",
        "gripper_controllers",
        "GripperActionController",
        interface="effort",
    ),
    "parallel_gripper_action_controller/GripperActionController": LazyType(
        "ParallelGripperActionControllerParameters",
        "gripper_controllers",
        "ParallelGripperActionController",
    ),
    "pid_controller/PidController": LazyType(
        "PidControllerParameters", "pid_controller", "PidController", "pid_controller"
    ),
    "diff_drive_controller/DiffDriveController": LazyType(
        "DiffDriveControllerParameters",
        "bases.diff_drive_controller",
        "DiffDriveController",
        "bases.diff_drive_controller",
    ),
    "bicycle_steering_controller/BicycleSteeringController": LazyType(
        "BicycleSteeringControllerParameters",
        "bases.steering_controllers",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "tricycle_steering_controller/TricycleSteeringController": LazyType(
        "TricycleSteeringControllerParameters",
        "bases.steering_controllers",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "ackermann_steering_controller/AckermannSteeringController": LazyType(
        "AckermannSteeringControllerParameters",
        "bases.steering_controllers",
        "SteeringController",
        "bases.steering_controllers",
    ),
    "tricycle_controller/TricycleController": LazyType(
        "TricycleControllerParameters",
        "bases.tricycle_controller",
        "TricycleController",
        "bases.tricycle_controller",
    ),
    "mecanum_drive_controller/MecanumDriveController": LazyType(
        "MecanumDriveControllerParameters",
        "bases.mecanum_drive_controller",
        "MecanumDriveController",
        "bases.mecanum_drive_controller",
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": LazyType(
        "OmniWheelDriveControllerParameters",
        "bases.omni_wheel_drive_controller",
        "OmniWheelDriveController",
        "bases.omni_wheel_drive_controller",
    ),
    "admittance_controller/AdmittanceController": LazyType(
        "AdmittanceControllerParameters",
        "admittance_controller",
        "AdmittanceController",
        "admittance_controller",
    ),
    "gpio_controllers/GpioCommandController": LazyType(
        "GpioCommandControllerParameters", "gpio_controllers", "GpioCommandController"
    ),
    "chained_filter_controller/ChainedFilter": LazyType(
        "ChainedFilterParameters", "chained_filter_controller", "ChainedFilter"
    ),
    "imu_sensor_broadcaster/IMUSensorBroadcaster": LazyType(
        "IMUSensorBroadcasterParameters",
        "sensor_broadcasters",
        "IMUSensorBroadcaster",
    ),
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": LazyType(
        "ForceTorqueSensorBroadcasterParameters",
        "force_torque_sensor_broadcaster",
        "ForceTorqueSensorBroadcaster",
    ),
    "range_sensor_broadcaster/RangeSensorBroadcaster": LazyType(
        "RangeSensorBroadcasterParameters",
        "sensor_broadcasters",
        "RangeSensorBroadcaster",
    ),
    "pose_broadcaster/PoseBroadcaster": LazyType(
        "PoseBroadcasterParameters", "sensor_broadcasters", "PoseBroadcaster"
    ),
    "gps_sensor_broadcaster/GPSSensorBroadcaster": LazyType(
        "GPSSensorBroadcasterParameters",
        "sensor_broadcasters",
        "GPSSensorBroadcaster",
    ),
    "magnetometer_broadcaster/MagnetometerBroadcaster": LazyType(
        "MagnetometerBroadcasterParameters",
        "sensor_broadcasters",
        "MagnetometerBroadcaster",
    ),
    "battery_state_broadcaster/BatteryStateBroadcaster": LazyType(
        "BatteryStateBroadcasterParameters",
        "battery_state_broadcaster",
        "BatteryStateBroadcaster",
    ),
    "state_interfaces_broadcaster/StateInterfacesBroadcaster": LazyType(
        "StateInterfacesBroadcasterParameters",
        "sensor_broadcasters",
        "StateInterfacesBroadcaster",
    ),
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster": LazyType(
        "Vda5050SafetyStateBroadcasterParameters",
        "sensor_broadcasters",
        "Vda5050SafetyStateBroadcaster",
    ),
    # By other packages, and by older names.
    "passthrough_controller/PassthroughController": LazyType(
        "PassthroughControllerParameters",
        "passthrough_controller",
        "PassthroughController",
    ),
    "ur_controllers/ScaledJointTrajectoryController": LazyType(
        "ScaledJointTrajectoryControllerParameters",
        "joint_trajectory.parameters",
        "JointTrajectoryController",
        "joint_trajectory.controller",
        runs_as=_JTC,
    ),
    "joint_state_controller/JointStateController": LazyType(
        "JointStateBroadcasterParameters",
        "joint_state_broadcaster",
        "JointStateBroadcaster",
        runs_as=_JSB,
    ),
}


# Group of the entry points: a name is a ros2_control type, its object a ControllerType.
ENTRY_POINTS = "arm_drake.controllers"


class InstalledType(NamedTuple):
    """A controller type that a package offers, not imported yet."""

    entry_point: importlib.metadata.EntryPoint

    # Who offers it, such as "package 'waves'".
    origin: str

    # Who else does; the first on Python's path counts.
    others: tuple[str, ...] = ()

    def load(self) -> object:
        """Import what the package offers.

        Raises:
            InputError: If it can't be imported.
        """
        try:
            loaded: object = self.entry_point.load()
        # Code of others, which can fail in every way; it must not take ours with it.
        except (Exception, SystemExit) as error:
            raise InputError(
                f"{self.entry_point.value!r} of {self.origin} can't be imported: "
                f"{type(error).__name__}: {error}"
            ) from error
        return loaded


def installed_types() -> Mapping[str, InstalledType]:
    """Return the controller types that installed packages offer, by name."""
    found: dict[str, InstalledType] = {}
    for entry_point in importlib.metadata.entry_points(group=ENTRY_POINTS):
        package = entry_point.dist.name if entry_point.dist else entry_point.module
        origin = f"package {package!r}"
        first = found.get(entry_point.name)
        if first is None:
            found[entry_point.name] = InstalledType(entry_point, origin)
        else:
            others = (*first.others, origin)
            found[entry_point.name] = first._replace(others=others)
    return found


class Equivalent(NamedTuple):
    """Which type of the registry another package's type is."""

    runs_as: str

    # What a trajectory controller commands by default, as those of ROS 1 say by their
    # names; empty if that type's parameters are this one's.
    commands: Literal["", "position", "velocity", "effort"] = ""


@functools.cache
def parameters_of(equivalent: Equivalent) -> type | None:
    """Return the dataclass of a type's parameters, None if that of what it runs as.

    Args:
        equivalent: A row of `EQUIVALENTS`.
    """
    if not equivalent.commands:
        return None
    # Not at the top: few robots have one.
    from arm_drake.controllers.joint_trajectory.parameters import (
        CommandInterface,
        JointTrajectoryControllerParameters,
        StateInterface,
    )

    # They always read the same.
    states: tuple[StateInterface, ...] = ("position", "velocity")
    return dc.make_dataclass(
        "JointTrajectoryControllerParametersOfRos1",
        [
            (
                "command_interfaces",
                tuple[CommandInterface, ...],
                (equivalent.commands,),
            ),
            ("state_interfaces", tuple[StateInterface, ...], states),
        ],
        bases=(JointTrajectoryControllerParameters,),
        frozen=True,
    )


_SCALED = "ur_controllers/ScaledJointTrajectoryController"
_PARALLEL_GRIPPER = "parallel_gripper_action_controller/GripperActionController"

EQUIVALENTS = {
    # ROS 1: same parameters, action and splines; the topic is called `command` there.
    # ros-controls/ros_controllers: joint_trajectory_controller/ros_control_plugins.xml.
    "effort_controllers/JointTrajectoryController": Equivalent(_JTC, "effort"),
    "position_controllers/JointTrajectoryController": Equivalent(_JTC, "position"),
    "velocity_controllers/JointTrajectoryController": Equivalent(_JTC, "velocity"),
    # ROS 1: these, slowed down as the robot says, which here is never.
    # UniversalRobots/Universal_Robots_ROS_scaled_controllers:
    # scaled_joint_trajectory_controller/src/scaled_joint_trajectory_controller.cpp.
    "position_controllers/ScaledJointTrajectoryController": Equivalent(
        _JTC, "position"
    ),
    "velocity_controllers/ScaledJointTrajectoryController": Equivalent(
        _JTC, "velocity"
    ),
    # That of ur_controllers, parameter by parameter.
    # Elite-Robots/Elite_Robots_CS_ROS2_Driver: eli_cs_controllers.
    "eli_cs_controllers/ScaledJointTrajectoryController": Equivalent(_SCALED),
    # A subclass without further parameters; a topic and the robot slow it down, from
    # 100 %. FANUC-CORPORATION/fanuc_driver: fanuc_controllers.
    "fanuc_controllers/ScaledJointTrajectoryController": Equivalent(_JTC),
    # A copy, of the time before upstream's commanded efforts.
    # frankaemika/franka_ros2: joint_effort_trajectory_controller/README.md.
    "joint_effort_trajectory_controller/JointTrajectoryController": Equivalent(_JTC),
    # What upstream's deprecated grippers call their successor in their warning.
    # ros-controls/ros2_controllers: gripper_controllers (jazzy).
    "parallel_gripper_controllers/GripperActionController": Equivalent(
        _PARALLEL_GRIPPER
    ),
}
