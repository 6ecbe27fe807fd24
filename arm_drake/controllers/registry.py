"""Controller types that run here, by their ros2_control names, and types that don't."""

import dataclasses as dc
import functools
import importlib
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from arm_drake import yaml_files
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.errors import InputError, find_close
from arm_drake.importing import without_collection

if TYPE_CHECKING:
    import importlib.metadata


class ControllerType(NamedTuple):
    """Parameter class and constructor of one type of controller."""

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
    """Return a type that somebody else brings, or raise InputError that names them."""
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
    """Return controller types by name as `load_robot` takes them, or InputError."""
    if not isinstance(types, Mapping) or not all(isinstance(n, str) for n in types):
        raise InputError(
            "controller_types: expected a mapping of names to "
            f"arm_drake.ControllerType, got {types!r}"
        )
    return {
        name: check_controller_type(row, f"controller_types[{name!r}]")
        for name, row in types.items()
    }


# Our types: "module:System:Parameters", names below this package. A system that isn't
# named is called as the type, and its parameters as the system. Types that share a
# system have its `interface` as a fourth part.
STANDARD_TYPES: Mapping[str, str] = {
    "joint_state_broadcaster/JointStateBroadcaster": "joint_state_broadcaster",
    "joint_trajectory_controller/JointTrajectoryController": (
        "joint_trajectory:controller.JointTrajectoryController"
        ":parameters.JointTrajectoryControllerParameters"
    ),
    "forward_command_controller/ForwardCommandController": "forward_command_controller",
    "forward_command_controller/MultiInterfaceForwardCommandController": (
        "forward_command_controller"
    ),
    "position_controllers/JointGroupPositionController": (
        "forward_command_controller:JointGroupController::position"
    ),
    "velocity_controllers/JointGroupVelocityController": (
        "forward_command_controller:JointGroupController::velocity"
    ),
    "effort_controllers/JointGroupEffortController": (
        "forward_command_controller:JointGroupController::effort"
    ),
    "position_controllers/GripperActionController": "gripper_controllers",
    "effort_controllers/GripperActionController": (
        "gripper_controllers:GripperActionController"
        ":EffortGripperActionControllerParameters:effort"
    ),
    "parallel_gripper_action_controller/GripperActionController": (
        "gripper_controllers:ParallelGripperActionController"
    ),
    "pid_controller/PidController": "pid_controller",
    "diff_drive_controller/DiffDriveController": "bases.diff_drive_controller",
    "bicycle_steering_controller/BicycleSteeringController": (
        "bases.steering_controllers:SteeringController"
        ":BicycleSteeringControllerParameters"
    ),
    "tricycle_steering_controller/TricycleSteeringController": (
        "bases.steering_controllers:SteeringController"
        ":TricycleSteeringControllerParameters"
    ),
    "ackermann_steering_controller/AckermannSteeringController": (
        "bases.steering_controllers:SteeringController"
        ":AckermannSteeringControllerParameters"
    ),
    "tricycle_controller/TricycleController": "bases.tricycle_controller",
    "mecanum_drive_controller/MecanumDriveController": "bases.mecanum_drive_controller",
    "omni_wheel_drive_controller/OmniWheelDriveController": (
        "bases.omni_wheel_drive_controller"
    ),
    "swerve_drive_controller/SwerveController": "bases.swerve_drive_controller",
    "admittance_controller/AdmittanceController": "admittance_controller",
    "gpio_controllers/GpioCommandController": "gpio_controllers",
    "chained_filter_controller/ChainedFilter": "chained_filter_controller",
    "imu_sensor_broadcaster/IMUSensorBroadcaster": "sensor_broadcasters",
    "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster": (
        "force_torque_sensor_broadcaster"
    ),
    "range_sensor_broadcaster/RangeSensorBroadcaster": "sensor_broadcasters",
    "pose_broadcaster/PoseBroadcaster": "sensor_broadcasters",
    "gps_sensor_broadcaster/GPSSensorBroadcaster": "sensor_broadcasters",
    "magnetometer_broadcaster/MagnetometerBroadcaster": "sensor_broadcasters",
    "battery_state_broadcaster/BatteryStateBroadcaster": "battery_state_broadcaster",
    "state_interfaces_broadcaster/StateInterfacesBroadcaster": "sensor_broadcasters",
    "vda5050_safety_state_broadcaster/Vda5050SafetyStateBroadcaster": (
        "sensor_broadcasters"
    ),
    # By other packages, and by older names.
    "passthrough_controller/PassthroughController": "passthrough_controller",
    "ur_controllers/ScaledJointTrajectoryController": (
        "joint_trajectory:controller.JointTrajectoryController"
        ":parameters.ScaledJointTrajectoryControllerParameters"
    ),
    "joint_state_controller/JointStateController": (
        "joint_state_broadcaster:JointStateBroadcaster"
    ),
}

# Those of them that are run as another one.
RUNS_AS: Mapping[str, str] = {
    "ur_controllers/ScaledJointTrajectoryController": (
        "joint_trajectory_controller/JointTrajectoryController"
    ),
    "joint_state_controller/JointStateController": (
        "joint_state_broadcaster/JointStateBroadcaster"
    ),
}


def load_type(name: str, row: str) -> ControllerType:
    """Import the controller type of a row of `STANDARD_TYPES`."""
    module, system, parameters, interface = (*row.split(":"), "", "", "")[:4]
    system = system or name.rpartition("/")[2]
    make = import_name(f"{module}.{system}")
    if interface:
        make = functools.partial(make, interface=interface)
    schema = import_name(f"{module}.{parameters or f'{system}Parameters'}")
    return ControllerType(schema, make, RUNS_AS.get(name, ""))


def import_name(name: str) -> Any:
    """Return what a dotted name below this package stands for."""
    module, _, attribute = name.rpartition(".")
    with without_collection():
        found = importlib.import_module(f"arm_drake.controllers.{module}")
    return getattr(found, attribute)


class ControllerTypes(MutableMapping[str, ControllerType]):
    """Controller types by name, each imported when it is first used."""

    def __init__(self, rows: Mapping[str, str]) -> None:
        """Create the table of rows like those of `STANDARD_TYPES`, by name."""
        self._rows: dict[str, ControllerType | str] = {**rows}
        self._added: dict[str, ControllerType] = {}

    @property
    def added(self) -> dict[str, ControllerType]:
        """Types that were added since, by name."""
        return dict(self._added)

    def __getitem__(self, name: str) -> ControllerType:
        """Return a type."""
        row = self._rows[name]
        if isinstance(row, str):
            row = self._rows[name] = load_type(name, row)
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
        """Return the number of types."""
        return len(self._rows)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a type; it isn't imported for that."""
        return name in self._rows


# Group of the entry points: a name is a ros2_control type, its object a ControllerType.
ENTRY_POINTS = "arm_drake.controllers"


class InstalledType(NamedTuple):
    """A controller type that a package offers, not imported yet."""

    entry_point: "importlib.metadata.EntryPoint"

    # Who offers it, such as "package 'waves'".
    origin: str

    # Who else does; the first on Python's path counts.
    others: tuple[str, ...] = ()

    def load(self) -> object:
        """Import what the package offers, or raise InputError."""
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
    return _types_installed_in(tuple(map(_folder_state, sys.path)))


def _folder_state(folder: str) -> tuple[str, int | None]:
    """Return a folder of Python's path and when something came into it or left it."""
    try:
        return folder, os.stat(folder or ".").st_mtime_ns
    except OSError:
        return folder, None


def _may_offer(folder: str) -> bool:
    """Return whether a package in a folder of Python's path may name the group.

    `importlib.metadata` reads what all packages are called: with its import that takes
    a twentieth of the time from a program's start to the first step, this a tenth of
    that.
    """
    if os.path.isfile(folder):
        return True  # An archive.
    try:
        names = os.listdir(folder)
    except OSError:
        return False
    for name in names:
        if name.lower().endswith((".dist-info", "egg-info")):
            try:
                path = os.path.join(folder, name, "entry_points.txt")
                with open(path, "rb") as file:
                    if ENTRY_POINTS.encode() in file.read():
                        return True
            except OSError:
                continue  # Most have none.
    return False


# Folders are read anew when something came into them or left them.
@functools.lru_cache(maxsize=1)
def _types_installed_in(
    path: tuple[tuple[str, int | None], ...],
) -> Mapping[str, InstalledType]:
    found: dict[str, InstalledType] = {}
    if not any(_may_offer(folder or ".") for folder, _ in path):
        return found
    from importlib.metadata import entry_points  # It brings e-mail and more.

    for entry_point in entry_points(group=ENTRY_POINTS):
        package = entry_point.dist.name if entry_point.dist else entry_point.module
        origin = f"package {package!r}"
        first = found.get(entry_point.name)
        if first is None:
            found[entry_point.name] = InstalledType(entry_point, origin)
        else:
            others = (*first.others, origin)
            found[entry_point.name] = first._replace(others=others)
    return found


_FILE = Path(__file__).with_name("other_types.yaml")


class Equivalent(NamedTuple):
    """Type of the registry that stands for another package's type."""

    runs_as: str

    # What a trajectory controller commands by default, as those of ROS 1 say by their
    # names; empty if that type's parameters are this one's.
    commands: Literal["", "position", "velocity", "effort"] = ""


class Other(NamedTuple):
    """Description of a type that isn't simulated."""

    # What it does, that ours don't.
    does: str

    # The type that stands closest, and how to use it.
    closest: str = ""


class OtherTypes(NamedTuple):
    """The tables of `other_types.yaml`, where each is explained."""

    equivalents: Mapping[str, Equivalent]
    hardware_only: Mapping[str, str]

    # By type, or by package with a "/" at its end.
    others: Mapping[str, Other]


@functools.cache
def load_other_types() -> OtherTypes:
    """Read the tables; done when a type isn't ours, which is rare."""
    tables = yaml_files.load(_FILE)
    return OtherTypes(
        {name: Equivalent(**row) for name, row in tables["equivalents"].items()},
        tables["hardware_only"],
        {name: Other(**row) for name, row in tables["others"].items()},
    )


@functools.cache
def parameters_of(equivalent: Equivalent) -> type | None:
    """Return the dataclass of a type's parameters, None if that of what it runs as."""
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


def _own_words(name: str) -> str:
    """Return the distinctive part of a type's name, without "controller"."""
    name = re.sub(r"_?controll?ers?", "", name.lower())
    return re.sub(r"_?broadcasters?", "*", name)


def describe_unknown(
    name: str, known: Iterable[str]
) -> tuple[Literal["info", "error"], str, str]:
    """Return what the report says of a type: severity, what it is, what is done.

    It is neither in the registry, of which `known` are the types, nor equivalent to
    one.
    """
    _, hardware_only, others = load_other_types()
    what, done = f"controller type {name!r}", "the controller does not run"
    if name in hardware_only:
        done = "left out; a simulation lacks nothing"
        return "info", f"{what} {hardware_only[name]}", done
    other = others.get(name) or others.get(f"{name.partition('/')[0]}/")
    if other is not None:
        instead = f"; the closest type is {other.closest}" if other.closest else ""
        return "error", f"{what} is not simulated: {other.does}{instead}", done
    types = list(known)
    own = {_own_words(type_): type_ for type_ in types}
    closest = find_close(_own_words(name), own, 0.7)
    same = [type_ for type_ in types if type_.rpartition("/")[2] == name]
    close = [own[closest]] if closest is not None else same
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return "error", f"unknown {what}{hint}", done
