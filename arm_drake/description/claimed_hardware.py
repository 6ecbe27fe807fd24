"""Hardware from controllers' claims, for descriptions without `<ros2_control>`."""

import collections
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake import interfaces
from arm_drake.description.controllers import ControllerConfig, ControllerManagerConfig
from arm_drake.description.joints import JointInfo
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)

_POSITION, _VELOCITY = interfaces.POSITION, interfaces.VELOCITY

# Parameters that say what a controller claims of its joints.
_INTERFACES = (
    "command_interfaces",
    "command_interface",
    "interface_names",
    "interface_name",
)

# Wheels of a swerve drive, in the order of its controller.
_CORNERS = ("front_left", "front_right", "rear_left", "rear_right")

# Parameters of bases that name driven joints, and those that name steered ones.
STEERING = (("traction_joints_names",), ("steering_joints_names",))
WHEEL_PARAMETERS: Mapping[str, Sequence[Sequence[str]]] = {
    "diff_drive_controller/DiffDriveController": (
        ("left_wheel_names", "right_wheel_names"),
        (),
    ),
    "mecanum_drive_controller/MecanumDriveController": (
        (
            "front_left_wheel_command_joint_name",
            "front_right_wheel_command_joint_name",
            "rear_right_wheel_command_joint_name",
            "rear_left_wheel_command_joint_name",
        ),
        (),
    ),
    "omni_wheel_drive_controller/OmniWheelDriveController": (("wheel_names",), ()),
    "swerve_drive_controller/SwerveController": (
        tuple(f"{corner}_wheel_joint" for corner in _CORNERS),
        tuple(f"{corner}_axle_joint" for corner in _CORNERS),
    ),
    "tricycle_controller/TricycleController": (
        ("traction_joint_name",),
        ("steering_joint_name",),
    ),
    "ackermann_steering_controller/AckermannSteeringController": STEERING,
    "bicycle_steering_controller/BicycleSteeringController": STEERING,
    "tricycle_steering_controller/TricycleSteeringController": STEERING,
}

# Parameters that name joints, and what is claimed of them. None is what the parameters
# above say, or else the controller's type.
_JOINTS: Mapping[str, str | None] = {
    **dict.fromkeys(("command_joints", "joints", "joint", "dof_names")),
    **{name: _VELOCITY for driven, _ in WHEEL_PARAMETERS.values() for name in driven},
    **{name: _POSITION for _, steered in WHEEL_PARAMETERS.values() for name in steered},
}

# The package of a type says what it claims, where no parameter does.
_PACKAGES = {
    "velocity_controllers": _VELOCITY,
    "effort_controllers": interfaces.EFFORT,
}


def hardware_from_controllers(
    config: ControllerManagerConfig,
    joints: Sequence[JointInfo],
    report: LoadReport,
    file: Path,
    *,
    others: Collection[str] = (),
) -> tuple[HardwareInfo, ...]:
    """Return one block with the command interfaces that the controllers claim.

    A joint that no controller names takes positions, a mimic joint nothing; all report
    position, velocity and effort. Joints in ``others`` have something else that moves
    them, if no controller does.
    """
    claimed = claimed_joints(config)
    movable = [
        joint
        for joint in joints
        if joint.is_movable and (joint.name in claimed or joint.name not in others)
    ]
    if not movable:
        return ()
    claims = _claims_of(movable, config)
    counts = collections.Counter(name for names in claims.values() for name in names)
    listed = ", ".join(
        f"{name} ({count} joint{'s' if count > 1 else ''})"
        for name, count in counts.items()
    )
    what = "the description has no <ros2_control>"
    done = f"joints take the commands that controllers claim, else positions: {listed}"
    report.add("info", "missing", what, done, file=file)
    return (make_block("hardware", claims),)


def make_block(name: str, claims: Mapping[str, Iterable[str]]) -> HardwareInfo:
    """Return a block of joints with the command interfaces that are claimed of them."""
    states = tuple(InterfaceInfo(state) for state in interfaces.STATE_INTERFACES)
    joints = tuple(
        ComponentInfo(joint, tuple(map(InterfaceInfo, commands)), states)
        for joint, commands in claims.items()
    )
    return HardwareInfo(name, "system", "", joints)


def _claims_of(
    joints: Sequence[JointInfo], config: ControllerManagerConfig
) -> dict[str, list[str]]:
    """Return the command interfaces of joints, as claimed or else by default."""
    claims: dict[str, list[str]] = {joint.name: [] for joint in joints}
    for controller in config.controllers:
        for name, interface in claims_by(controller):
            if name in claims and interface not in claims[name]:
                claims[name].append(interface)
    for joint in joints:
        if joint.mimic is not None:
            claims[joint.name] = []
        elif not claims[joint.name]:
            claims[joint.name] = [_POSITION]
    return claims


def claimed_joints(config: ControllerManagerConfig) -> dict[str, str]:
    """Return the joints that controllers name to command them, each with the first."""
    claimed: dict[str, str] = {}
    for controller in config.controllers:
        for name, _ in claims_by(controller):
            claimed.setdefault(name, controller.name)
    return claimed


def claims_by(controller: ControllerConfig) -> Iterator[tuple[str, str]]:
    """Yield the joints of a controller with an interface that it claims."""
    package, _, name = controller.type.partition("/")
    if name.endswith("Broadcaster"):
        return
    implied = texts_of(controller, *_INTERFACES) or (_PACKAGES.get(package, _POSITION),)
    parameters = [name for name in _JOINTS if texts_of(controller, name)]
    if "command_joints" in parameters and "joints" in parameters:
        parameters.remove("joints")
    for parameter in parameters:
        fixed = _JOINTS[parameter]
        for joint in texts_of(controller, parameter):
            for interface in implied if fixed is None else (fixed,):
                yield joint, interface
    # A passthrough controller's are whole names.
    for text in texts_of(controller, "interfaces"):
        joint, _, interface = text.rpartition("/")
        yield joint, interface
    for parameter, interface in zip(
        humble_wheel_parameters(controller), (_VELOCITY, _POSITION), strict=True
    ):
        for joint in texts_of(controller, parameter):
            yield joint, interface


def humble_wheel_parameters(controller: ControllerConfig) -> tuple[str, str]:
    """Return the parameters of driven and of steered joints up to Humble."""
    steers_front = controller.parameters.get("front_steering")
    is_front = steers_front is None or bool(steers_front.value)
    names = ("rear_wheels_names", "front_wheels_names")
    return names if is_front else names[::-1]


def texts_of(controller: ControllerConfig, *names: str) -> tuple[str, ...]:
    """Return the texts of parameters; what is none is the controller's error."""
    found: list[str] = []
    for name in names:
        parameter = controller.parameters.get(name)
        value = None if parameter is None else parameter.value
        values = value if isinstance(value, list | tuple) else [value]
        found += [text for text in values if isinstance(text, str) and text]
    return tuple(found)
