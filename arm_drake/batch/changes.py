"""Changes of a loaded robot: gains, dry friction, damping, parameters, where it begins.

PIDs are those of Gazebo's plugins of single joints, of controllers with parameters
`gains.<joint>`, and of Gazebo Classic's joints (`pos_kp`, `vel_kp`).
"""

import dataclasses as dc
import math
from collections.abc import Mapping
from typing import NamedTuple

from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.gazebo_plugins import (
    JointController,
    JointPositionController,
)
from arm_drake.description.parameters import Parameter
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import ComponentInfo, PidGains
from arm_drake.errors import InputError, check_known, suggest


class Gains(NamedTuple):
    """Gains of a PID, of an error in [rad] or [m], or of a velocity's error."""

    # [N·m/rad], [N·m/(rad·s)], [N·m·s/rad], and so on.
    p: float
    i: float
    d: float

    # Largest absolute value of the integral's term [N·m] or [N]; inf if any.
    i_clamp: float = math.inf


class Pid(NamedTuple):
    """A PID that moves a joint."""

    joint: str
    gains: Gains

    # What it controls: "position" or "velocity".
    quantity: str

    # Whose it is: a controller, or the hardware's ("").
    controller: str

    # "plugin", "parameters" or "hardware".
    kind: str


# What the PIDs of a YAML are called, and those of a joint's `<param>`.
_YAML = ("p", "i", "d")
_PREFIXES = {"position": "pos_", "velocity": "vel_"}

_TAGS = ("p_gain", "i_gain", "d_gain")


def find_pids(robot: Robot, controller: str | None = None) -> list[Pid]:
    """Return the PIDs of a robot, or of one of its controllers, that push joints.

    InputError if there is no such controller.
    """
    names = [each.name for each in robot.controllers.controllers]
    if controller is not None:
        check_known("controller", controller, names)
    found: dict[str, Pid] = {}
    for config in robot.controllers.controllers:
        if controller in (None, config.name):
            found |= {pid.joint: pid for pid in _find_of(config)}
    for component in _components(robot):
        if controller is None or component.name in _joints_of(robot, controller):
            for quantity in _PREFIXES:
                gains: PidGains | None = getattr(component, f"{quantity}_pid")
                if gains is not None and component.name not in found:
                    clamp = gains.max_integral_error
                    kept = Gains(gains.kp, gains.ki, gains.kd, clamp)
                    pid = Pid(component.name, kept, quantity, "", "hardware")
                    found[component.name] = pid
    order = [joint.name for joint in robot.description.movable_joints]
    return [found[name] for name in order if name in found]


def _components(robot: Robot) -> list[ComponentInfo]:
    return [each for block in robot.description.hardware for each in block.joints]


def _joints_of(robot: Robot, controller: str) -> set[str]:
    """Return the joints that a controller's parameters name."""
    config = next(c for c in robot.controllers.controllers if c.name == controller)
    named: set[str] = set(config.plugin_joints)
    for name in ("joints", "joint", "dof_names", "left_wheel_names"):
        value = config.parameters.get(name)
        if value is not None:
            named |= {value.value} if isinstance(value.value, str) else {*value.value}
    right = config.parameters.get("right_wheel_names")
    return named | set(right.value if right is not None else ())


def _find_of(config: ControllerConfig) -> list[Pid]:
    found = []
    for tag in config.plugins:
        if isinstance(tag, JointPositionController) and not tag.use_velocity_commands:
            quantity = "position"
        elif isinstance(tag, JointController) and tag.use_force_commands:
            quantity = "velocity"
        else:
            continue
        p, i, d = (getattr(tag, name) for name in _TAGS)
        clamp = tag.i_max if tag.i_max >= tag.i_min else math.inf
        joint = tag.joint_names[0]
        kept = Gains(p, i, d, clamp)
        found.append(Pid(joint, kept, quantity, config.name, "plugin"))
    values = {name: each.value for name, each in config.parameters.items()}
    interfaces = values.get("command_interfaces", values.get("command_interface", ()))
    joints = values.get("dof_names", values.get("joints", ()))
    if "effort" not in ([interfaces] if isinstance(interfaces, str) else interfaces):
        return found
    for joint in joints:
        p, i, d = (float(values.get(f"gains.{joint}.{name}", 0.0)) for name in _YAML)
        high = values.get(f"gains.{joint}.i_clamp_max", math.inf)
        clamp = float(values.get(f"gains.{joint}.i_clamp", high))
        pid = Pid(joint, Gains(p, i, d, clamp), "position", config.name, "parameters")
        found.append(pid)
    return found


def with_gains(robot: Robot, gains: Mapping[str, Gains], pids: list[Pid]) -> Robot:
    """Return a robot whose PIDs have other gains, by joint."""
    of = {pid.joint: pid for pid in pids}
    for joint in gains:
        if joint not in of:
            text = f"joint {joint!r} has no PID; {suggest(joint, of)}"
            raise InputError(text)
    configs = []
    for config in robot.controllers.controllers:
        own = {j: g for j, g in gains.items() if of[j].controller == config.name}
        configs.append(_with_gains(config, own) if own else config)
    of_hardware = {j: g for j, g in gains.items() if of[j].kind == "hardware"}
    blocks = tuple(
        dc.replace(
            block,
            joints=tuple(
                _component_with(each, of_hardware[each.name], of[each.name].quantity)
                if each.name in of_hardware
                else each
                for each in block.joints
            ),
        )
        for block in robot.description.hardware
    )
    return dc.replace(
        robot,
        controllers=dc.replace(robot.controllers, controllers=tuple(configs)),
        description=dc.replace(robot.description, hardware=blocks),
    )


def _with_gains(
    config: ControllerConfig, gains: Mapping[str, Gains]
) -> ControllerConfig:
    """Return a controller with other gains of its joints."""
    tags = []
    for tag in config.plugins:
        names = getattr(tag, "joint_names", ())
        new = gains.get(names[0]) if names else None
        if new is not None and hasattr(tag, "p_gain"):
            values = dict(zip(_TAGS, new[:3], strict=True))
            clamp = new.i_clamp if math.isfinite(new.i_clamp) else -1.0
            # A maximum below the minimum is no limit.
            low = -clamp if clamp >= 0.0 else 0.0
            tag = dc.replace(tag, **values, i_max=clamp, i_min=low)
        tags.append(tag)
    parameters = dict(config.parameters)
    if not config.plugins:
        for joint, new in gains.items():
            for name in ("i_clamp", "i_clamp_max", "i_clamp_min"):
                parameters.pop(f"gains.{joint}.{name}", None)
            for name, value in yaml_gains(new).items():
                where = Parameter(value, config.file, config.line)
                parameters[f"gains.{joint}.{name}"] = where
    return dc.replace(config, plugins=tuple(tags), parameters=parameters)


def yaml_gains(gains: Gains) -> dict[str, float]:
    """Return gains by the names that controllers' YAML has."""
    values = dict(zip(_YAML, gains[:3], strict=True))
    return values | ({"i_clamp": gains.i_clamp} if math.isfinite(gains.i_clamp) else {})


def _component_with(joint: ComponentInfo, gains: Gains, quantity: str) -> ComponentInfo:
    """Return a joint of Gazebo Classic with other gains."""
    pid = PidGains(*gains[:3], gains.i_clamp, -gains.i_clamp)
    prefix = _PREFIXES[quantity]
    texts = {f"{prefix}{name}": repr(getattr(pid, name)) for name in ("kp", "ki", "kd")}
    parameters = {**joint.parameters, **texts}
    joint = dc.replace(joint, parameters=parameters)
    if quantity == "position":
        return dc.replace(joint, position_pid=pid)
    return dc.replace(joint, velocity_pid=pid)


# What can be changed, by the start of its name.
CHANGES = (
    "scale.friction",
    "scale.damping",
    "scale.gains",
    "gains",
    "controller",
    "initial",
)


def change_robot(robot: Robot, changes: Mapping[str, float]) -> Robot:
    """Return a robot that is changed as `Run.changes` says, or raise InputError."""
    for name, value in changes.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"changes: {name}: expected a number, got {value!r}")
        try:
            robot = _change(robot, name, float(value))
        except InputError as error:
            raise InputError(f"changes: {name}: {error.problem}") from None
    return robot


def _change(robot: Robot, name: str, value: float) -> Robot:
    kind, _, rest = name.partition(".")
    if kind == "scale":
        quantity, _, rest = rest.partition(".")
        if quantity in ("friction", "damping"):
            return _scale_joints(robot, quantity, rest, value)
        if quantity == "gains":
            return _scale_gains(robot, rest, value)
    if kind == "gains":
        joint, _, gain = rest.rpartition(".")
        return _set_gain(robot, joint, gain, value)
    if kind == "controller":
        return _set_parameter(robot, rest, value)
    if kind == "initial":
        known = robot.initial_positions
        check_known("joint", rest, known)
        if not math.isfinite(value):
            raise InputError(f"expected a finite number, got {value:g}")
        return dc.replace(robot, initial_positions={**known, rest: value})
    raise InputError(f"unknown; {suggest(name, CHANGES)}")


def _scale_joints(robot: Robot, field: str, joint: str, factor: float) -> Robot:
    """Return a robot with more or less friction in a joint, or in all."""
    description = robot.description
    names = [each.name for each in description.movable_joints]
    if joint:
        check_known("joint", joint, names)
    if not 0.0 <= factor < math.inf:
        raise InputError(f"expected a factor of at least 0, got {factor:g}")
    joints = tuple(
        dc.replace(each, **{field: factor * getattr(each, field)})
        if joint in ("", each.name)
        else each
        for each in description.joints
    )
    changed = dc.replace(description, joints=joints)
    return dc.replace(robot, description=changed)


def _scale_gains(robot: Robot, which: str, factor: float) -> Robot:
    """Return a robot with more or less of all gains, of a joint's, or of one."""
    pids = find_pids(robot)
    joint, gain = which, ""
    if which and which.rpartition(".")[2] in Gains._fields:
        joint, _, gain = which.rpartition(".")
    if not pids or (joint and joint not in {pid.joint for pid in pids}):
        raise InputError(f"no PID {joint!r}; {suggest(joint, {p.joint for p in pids})}")
    new = {}
    for pid in pids:
        if joint in ("", pid.joint):
            names = (gain,) if gain else _YAML
            values = {name: factor * getattr(pid.gains, name) for name in names}
            new[pid.joint] = pid.gains._replace(**values)
    return with_gains(robot, new, pids)


def _set_gain(robot: Robot, joint: str, gain: str, value: float) -> Robot:
    pids = {pid.joint: pid for pid in find_pids(robot)}
    if joint not in pids:
        raise InputError(f"joint {joint!r} has no PID; {suggest(joint, pids)}")
    check_known("gain", gain, Gains._fields)
    gains = pids[joint].gains._replace(**{gain: value})
    return with_gains(robot, {joint: gains}, list(pids.values()))


def _set_parameter(robot: Robot, path: str, value: float) -> Robot:
    """Return a robot one of whose controllers has another parameter."""
    configs = {each.name: each for each in robot.controllers.controllers}
    name, _, parameter = path.partition(".")
    if name not in configs or not parameter:
        raise InputError(f"no controller {name!r}; {suggest(name, configs)}")
    config = configs[name]
    old = config.parameters.get(parameter)
    where = old or Parameter(None, config.file, config.line)
    # Whole numbers stay such.
    is_int = old is not None and type(old.value) is int and value == int(value)
    changed = dc.replace(where, value=int(value) if is_int else value)
    parameters = {**config.parameters, parameter: changed}
    configs[name] = dc.replace(config, parameters=parameters)
    controllers = dc.replace(robot.controllers, controllers=tuple(configs.values()))
    return dc.replace(robot, controllers=controllers)
