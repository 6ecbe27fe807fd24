"""Groups of joints that are planned for together, and how fast they may be.

They are those of the robot's SRDF files, as MoveIt has them, and its trajectory
controllers, each a group of its name: a robot without an SRDF has groups, too. The
limits of speed are those of the `joint_limits.yaml` beside the SRDF, else those of the
description.
"""

import dataclasses as dc
import math
import weakref
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from arm_drake import yaml_files
from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.joints import joints_above, last_master
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import find_group_states, find_groups, find_srdf_files
from arm_drake.errors import InputError, quoted, suggest
from arm_drake.plant.joint_ranges import center, find_gripper_joints, joint_ranges

# The groups where there is neither an SRDF nor a trajectory controller.
ARM, GRIPPER = "arm", "gripper"

_TRAJECTORY_CONTROLLER = "joint_trajectory_controller/JointTrajectoryController"

# Without a limit of its speed a joint has this one [rad/s] or [m/s]; without a limit
# of its acceleration it needs so long to its full speed [s].
_SPEED, _TIME_TO_SPEED = 1.0, 1.0

_LIMITS_FILE = "joint_limits.yaml"


@dc.dataclass(frozen=True)
class PlanningGroup:
    """Joints that are planned for together."""

    name: str

    # Independent joints with one degree of freedom.
    joints: tuple[str, ...]

    # The link that a pose is for unless another one is named.
    tip: str

    # Positions with a name [rad] or [m], by joint.
    states: Mapping[str, Mapping[str, float]]


class MotionLimits(NamedTuple):
    """How fast a joint may be."""

    # [rad/s] or [m/s].
    velocity: float

    # [rad/s^2] or [m/s^2].
    acceleration: float

    # [rad/s^3] or [m/s^3]; infinite without a limit.
    jerk: float = math.inf


# What was found for robots.
_groups: "weakref.WeakKeyDictionary[Robot, dict[str, PlanningGroup]]" = (
    weakref.WeakKeyDictionary()
)
_limits: "weakref.WeakKeyDictionary[Robot, dict[str, MotionLimits]]" = (
    weakref.WeakKeyDictionary()
)


def planning_groups(robot: Robot) -> dict[str, PlanningGroup]:
    """Return the groups of a robot by name.

    Those without a gripper's joints come first, then those with most joints.
    """
    # Looking for SRDF files takes longer than most plans.
    if robot not in _groups:
        _groups[robot] = _find_groups(robot)
    return dict(_groups[robot])


def _find_groups(robot: Robot) -> dict[str, PlanningGroup]:
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    own = {name for name, joint in joints.items() if joint.mimic is None}
    groups: dict[str, tuple[tuple[str, ...], str | None]] = {}
    grippers = {joint.name for joint in find_gripper_joints(robot)}
    for group in find_groups(robot):
        groups[group.name] = group.joints, group.tip
        grippers |= set(group.joints if group.is_end_effector else ())
    for controller in robot.controllers.controllers:
        named = tuple(n for n in joints_of(controller) if n in own)
        if controller.type == _TRAJECTORY_CONTROLLER and named:
            groups.setdefault(controller.name, (named, None))
    if not groups:
        for controller in robot.controllers.controllers:
            named = tuple(n for n in joints_of(controller) if n in own)
            if takes_positions(controller) and named:
                groups[controller.name] = named, None
    if not groups and own:
        for label, members in ((ARM, own - grippers), (GRIPPER, own & grippers)):
            if members:
                groups[label] = tuple(n for n in joints if n in members), None
    found = {
        name: PlanningGroup(
            name, members, tip or _tip(robot, members), _states(robot, name, members)
        )
        for name, (members, tip) in groups.items()
    }

    def rank(name: str) -> tuple[bool, int]:
        return bool(grippers & set(found[name].joints)), -len(found[name].joints)

    return {name: found[name] for name in sorted(found, key=rank)}


def find_group(robot: Robot, group: str | Collection[str] | None) -> PlanningGroup:
    """Return a group by its name or its joints, by default the first.

    Raises:
        InputError: If there is no such group or joint, or no joint at all.
    """
    if group is not None and not isinstance(group, Collection):
        raise InputError(f"group: expected its name or its joints, got {group!r}")
    if group is not None and not isinstance(group, str):
        return _made_of(robot, tuple(dict.fromkeys(group)))
    groups = planning_groups(robot)
    if not groups:
        raise InputError(f"robot {robot.name!r} has no joint that could move")
    if group is None:
        return next(iter(groups.values()))
    if group not in groups:
        raise InputError(f"no planning group {group!r}; {suggest(group, groups)}")
    return groups[group]


def find_state(group: PlanningGroup, name: str) -> Mapping[str, float]:
    """Return the positions of a named state, or raise InputError."""
    if name not in group.states:
        hint = suggest(name, group.states)
        raise InputError(f"group {group.name!r} has no state {name!r}; {hint}")
    return group.states[name]


def find_controller(robot: Robot, group: PlanningGroup) -> str | None:
    """Return the name of the trajectory controller of exactly a group's joints."""
    for controller in robot.controllers.controllers:
        is_one = controller.type.endswith("JointTrajectoryController")
        if is_one and set(joints_of(controller)) == set(group.joints):
            return controller.name
    return None


def find_position_controller(
    robot: Robot, group: PlanningGroup
) -> tuple[str, tuple[str, ...]] | None:
    """Return a controller that takes positions of a group's joints, and their order."""
    for controller in robot.controllers.controllers:
        joints = joints_of(controller)
        if takes_positions(controller) and set(joints) == set(group.joints):
            return controller.name, joints
    return None


def require_controller(robot: Robot, group: PlanningGroup) -> str:
    """Return the controller that takes plans for a group, or raise InputError."""
    controller = find_controller(robot, group)
    if controller is None:
        names = [each.name for each in robot.controllers.controllers]
        raise InputError(
            f"no trajectory controller has exactly the joints of group "
            f"{group.name!r}, {quoted(group.joints)}; there are "
            f"{quoted(names) or 'none'}"
        )
    return controller


def joints_of(controller: ControllerConfig) -> tuple[str, ...]:
    """Return the joints that a controller's parameter `joints` names."""
    parameter = controller.parameters.get("joints")
    is_list = parameter is not None and isinstance(parameter.value, list)
    return tuple(map(str, parameter.value)) if is_list else ()  # type: ignore[union-attr]


def takes_positions(controller: ControllerConfig) -> bool:
    """Return whether a controller passes on commands, and they are positions."""
    if controller.type == "position_controllers/JointGroupPositionController":
        return True
    parameter = controller.parameters.get("interface_name")
    is_position = parameter is not None and parameter.value == "position"
    return is_position and controller.type.endswith("/ForwardCommandController")


def motion_limits(robot: Robot) -> dict[str, MotionLimits]:
    """Return how fast each movable joint may be.

    Raises:
        InputError: If a `joint_limits.yaml` can't be read.
    """
    if robot not in _limits:
        _limits[robot] = _read_limits(robot)
    return dict(_limits[robot])


def _read_limits(robot: Robot) -> dict[str, MotionLimits]:
    rows: dict[str, Mapping[str, Any]] = {}
    for file in find_srdf_files(robot):
        path = file.parent / _LIMITS_FILE
        if path.is_file():
            try:
                content = yaml_files.load(path)
            except yaml_files.YamlError as error:
                raise InputError(error.problem, file=path, line=error.line) from None
            limits = content.get("joint_limits") if isinstance(content, dict) else None
            if isinstance(limits, dict):
                rows |= {k: row for k, row in limits.items() if isinstance(row, dict)}
    limits = {}
    for joint in robot.description.movable_joints:
        row = rows.get(joint.name, {})
        velocity = _limit(row, "velocity") or joint.limits.velocity or _SPEED
        acceleration = _limit(row, "acceleration") or velocity / _TIME_TO_SPEED
        jerk = _limit(row, "jerk") or math.inf
        limits[joint.name] = MotionLimits(velocity, acceleration, jerk)
    return limits


def _limit(row: Mapping[str, Any], what: str) -> float | None:
    value = row.get(f"max_{what}")
    if not row.get(f"has_{what}_limits") or isinstance(value, bool):
        return None
    if not isinstance(value, int | float) or not 0.0 < value < math.inf:
        return None
    return float(value)


def _made_of(robot: Robot, names: tuple[str, ...]) -> PlanningGroup:
    own = [j.name for j in robot.description.movable_joints if j.mimic is None]
    for name in names:
        if name not in own:
            raise InputError(f"no joint {name!r}; {suggest(name, own)}")
    if not names:
        raise InputError("group: expected at least one joint")
    label = ", ".join(names)
    return PlanningGroup(label, names, _tip(robot, names), _states(robot, "", names))


def _tip(robot: Robot, names: Sequence[str]) -> str:
    """Return the deepest link that only these joints move, of those they do."""
    description, best, depth = robot.description, "", -1
    joints = {joint.name: joint for joint in description.movable_joints}
    for link in description.links:
        above = joints_above(description.joints, link)
        masters = {last_master(j, joints)[0] for j in above if j.name in joints}
        if masters and masters <= set(names) and len(above) > depth:
            best, depth = link, len(above)
    # Where others move what carries them all, it is what the last joint holds.
    return best or joints[names[-1]].child


def _states(
    robot: Robot, group: str, names: Collection[str]
) -> dict[str, Mapping[str, float]]:
    """Return the named states for a group's joints; its own before those of others."""
    states: dict[str, Mapping[str, float]] = {}
    for state in sorted(find_group_states(robot), key=lambda s: s.group != group):
        positions = {n: v for n, v in state.positions.items() if n in names}
        if set(positions) == set(names):
            states.setdefault(state.name, positions)
    middle = center(joint_ranges(robot.description))
    initial = robot.initial_positions
    states.setdefault("initial", {name: initial[name] for name in names})
    states.setdefault("home", {name: initial[name] for name in names})
    states.setdefault("center", {name: middle[name] for name in names})
    return states
