"""Hardware from controllers' claims, for descriptions without `<ros2_control>`."""

import collections
from collections.abc import Collection, Iterator, Mapping, Sequence
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

# Parameters that name joints, and what is claimed of them. None is what the parameters
# above say, or else the controller's type.
_JOINTS: Mapping[str, str | None] = {
    "command_joints": None,
    "joints": None,
    "joint": None,
    "dof_names": None,
    "left_wheel_names": _VELOCITY,
    "right_wheel_names": _VELOCITY,
    "wheel_names": _VELOCITY,
    "traction_joints_names": _VELOCITY,
    "traction_joint_name": _VELOCITY,
    "steering_joints_names": _POSITION,
    "steering_joint_name": _POSITION,
    "front_left_wheel_command_joint_name": _VELOCITY,
    "front_right_wheel_command_joint_name": _VELOCITY,
    "rear_left_wheel_command_joint_name": _VELOCITY,
    "rear_right_wheel_command_joint_name": _VELOCITY,
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
    states = tuple(InterfaceInfo(name) for name in interfaces.STATE_INTERFACES)
    return (
        HardwareInfo(
            name="hardware",
            type="system",
            plugin="",
            joints=tuple(
                ComponentInfo(name, tuple(map(InterfaceInfo, names)), states)
                for name, names in claims.items()
            ),
        ),
    )


def _claims_of(
    joints: Sequence[JointInfo], config: ControllerManagerConfig
) -> dict[str, list[str]]:
    """Return the command interfaces of joints, as claimed or else by default."""
    claims: dict[str, list[str]] = {joint.name: [] for joint in joints}
    for controller in config.controllers:
        for name, interface in _claims(controller):
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
        for name, _ in _claims(controller):
            claimed.setdefault(name, controller.name)
    return claimed


def _claims(controller: ControllerConfig) -> Iterator[tuple[str, str]]:
    """Yield the joints of a controller with an interface that it claims."""
    package, _, name = controller.type.partition("/")
    if name.endswith("Broadcaster"):
        return
    declared = tuple(
        interface
        for parameter in _INTERFACES
        for interface in _texts(controller, parameter)
    )
    implied = declared or (_PACKAGES.get(package, _POSITION),)
    parameters = [name for name in _JOINTS if _texts(controller, name)]
    if "command_joints" in parameters and "joints" in parameters:
        parameters.remove("joints")
    for parameter in parameters:
        fixed = _JOINTS[parameter]
        for joint in _texts(controller, parameter):
            for interface in implied if fixed is None else (fixed,):
                yield joint, interface
    # A passthrough controller's are whole names.
    for text in _texts(controller, "interfaces"):
        joint, _, interface = text.rpartition("/")
        yield joint, interface
    yield from _steering_claims(controller)


def _steering_claims(controller: ControllerConfig) -> Iterator[tuple[str, str]]:
    """Yield the claims of a steering controller in the form up to Humble."""
    steers_front = controller.parameters.get("front_steering")
    is_front = steers_front is None or bool(steers_front.value)
    for parameter, is_steering in (
        ("front_wheels_names", is_front),
        ("rear_wheels_names", not is_front),
    ):
        for joint in _texts(controller, parameter):
            yield joint, _POSITION if is_steering else _VELOCITY


def _texts(controller: ControllerConfig, name: str) -> tuple[str, ...]:
    """Return a parameter's text or texts; what is neither is the controller's error."""
    parameter = controller.parameters.get(name)
    value = None if parameter is None else parameter.value
    values = value if isinstance(value, list | tuple) else [value]
    return tuple(text for text in values if isinstance(text, str) and text)
