"""Groups of joints that are planned for together.

They are those of the robot's SRDF files, as MoveIt has them, and its trajectory
controllers, each a group of its name: a robot without an SRDF has groups, too.
"""

import weakref
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake import yaml_files
from arm_drake.description.controllers import ControllerConfig
from arm_drake.description.joints import joints_above, last_master
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import find_group_states, find_groups, find_srdf_files
from arm_drake.errors import InputError, check_known, check_type, quoted, suggest
from arm_drake.importing import dataclass
from arm_drake.plant.joint_ranges import center, find_gripper_joints, joint_ranges

# All of a pose counts: x, y, z of the world, turns about x, y, z of the frame.
WHOLE_POSE = (True,) * 6
POSITION = (True, True, True, False, False, False)

# The groups where there is neither an SRDF nor a trajectory controller.
ARM, GRIPPER = "arm", "gripper"

_KINEMATICS_FILE = "kinematics.yaml"

# Levels above what such a file says, where it is one of parameters.
_LEVELS = (
    "/**",
    "ros__parameters",
    "robot_description_kinematics",
    "robot_description_planning",
)

# What of a group's parameters there has an effect.
_POSITION_ONLY = "position_only_ik"

_TRAJECTORY_CONTROLLER = "joint_trajectory_controller/JointTrajectoryController"


@dataclass(frozen=True)
class PlanningGroup:
    """Joints that are planned for together."""

    name: str

    # Independent joints with one degree of freedom.
    joints: tuple[str, ...]

    # The link that a pose is for unless another one is named.
    tip: str

    # Positions with a name [rad] or [m], by joint; joints that are left out stay.
    states: Mapping[str, Mapping[str, float]]

    # Whether the `kinematics.yaml` beside the SRDF has `position_only_ik` for it: what
    # a pose says of turns doesn't count then.
    is_position_only: bool = False


# What was found for robots.
_groups: "weakref.WeakKeyDictionary[Robot, dict[str, PlanningGroup]]" = (
    weakref.WeakKeyDictionary()
)

# The same of joints that are named.
_made: "weakref.WeakKeyDictionary[Robot, dict[tuple[str, ...], PlanningGroup]]" = (
    weakref.WeakKeyDictionary()
)


def planning_groups(robot: Robot) -> dict[str, PlanningGroup]:
    """Return the groups of a robot by name.

    Those without a gripper's joints come first, then those with most joints.
    """
    check_type("robot", robot, Robot, "a Robot, as load_robot returns it")
    # Looking for SRDF files takes longer than most plans.
    if robot not in _groups:
        _groups[robot] = _find_groups(robot)
    return dict(_groups[robot])


def _find_groups(robot: Robot) -> dict[str, PlanningGroup]:
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    own = {joint.name for joint in robot.description.independent_joints}
    groups: dict[str, tuple[tuple[str, ...], str | None]] = {}
    grippers = {joint.name for joint in find_gripper_joints(robot)}
    for group in find_groups(robot, robot.report):
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
    position_only = _find_position_only(robot, groups)
    found = {
        name: PlanningGroup(
            name,
            members,
            tip or _tip(robot, members),
            _states(robot, name, members),
            name in position_only,
        )
        for name, (members, tip) in groups.items()
    }

    def rank(name: str) -> tuple[bool, int]:
        return bool(grippers & set(found[name].joints)), -len(found[name].joints)

    return {name: found[name] for name in sorted(found, key=rank)}


def _find_position_only(robot: Robot, groups: Collection[str]) -> set[str]:
    """Return the groups for which a `kinematics.yaml` has `position_only_ik`.

    Other parameters are those of MoveIt's solvers: they are reported.
    """
    found = set()
    for file, content in read_moveit_files(robot, _KINEMATICS_FILE):
        for name, row in read_rows(robot, file, "group", content, groups):
            where, flag = f"group {name!r}", row.get(_POSITION_ONLY, False)
            if flag is True:
                found.add(name)
            elif flag is not False:
                what = f"{_POSITION_ONLY}: expected true or false, got {flag!r}"
                report_invalid(robot, file, where, what)
            ignored = [key for key in row if key != _POSITION_ONLY]
            report_ignored(robot, file, where, ignored)
    return found


def read_rows(
    robot: Robot, file: Path, kind: str, content: Any, known: Collection[str]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what one of MoveIt's files says of each joint or group, by name.

    What can't be used is reported.
    """
    if not isinstance(content, dict | None):
        report_invalid(robot, file, "", f"expected a mapping by {kind}")
        return
    for name, row in (content or {}).items():
        where = f"{kind} {name!r}"
        if str(name) not in known:
            what = f"there is no such {kind} that moves"
            report_invalid(robot, file, where, what)
        elif not isinstance(row, dict):
            report_invalid(robot, file, where, f"expected a mapping, got {row!r}")
        else:
            yield str(name), row


def report_invalid(robot: Robot, file: Path, where: str, what: str) -> None:
    """Report unusable parts of MoveIt's files in a robot's load report."""
    done = "it has no effect on plans"
    robot.report.add("warning", "invalid", what, done, where=where, file=file)


def report_ignored(
    robot: Robot, file: Path, where: str, keys: Collection[object]
) -> None:
    """Report keys of MoveIt's files without effect in a robot's load report."""
    if keys:
        what = f"parameters {quoted(sorted(map(str, keys)))}"
        done = "they have no effect on plans"
        robot.report.add("info", "ignored", what, done, where=where, file=file)


def read_moveit_files(robot: Robot, name: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield the YAML files of a name beside a robot's SRDF files, and what they say.

    InputError if one can't be read.
    """
    folders = dict.fromkeys(file.parent for file in find_srdf_files(robot))
    for path in (folder / name for folder in folders):
        if not path.is_file():
            continue
        try:
            content = yaml_files.load(path)
        except yaml_files.YamlError as error:
            raise InputError(error.problem, file=path, line=error.line) from None
        for level in _LEVELS:
            if isinstance(content, dict):
                content = content.get(level, content)
        if isinstance(content, dict):
            yield path, content
        elif content is not None:
            report_invalid(robot, path, "", "expected a mapping")


def find_group(robot: Robot, group: str | Collection[str] | None) -> PlanningGroup:
    """Return a group by its name or its joints, by default the first.

    InputError if there is no such group or joint, or no joint at all.
    """
    is_list = isinstance(group, Collection) and all(isinstance(n, str) for n in group)
    if group is not None and not is_list:
        raise InputError(f"group: expected its name or its joints, got {group!r}")
    if group is not None and not isinstance(group, str):
        names = tuple(dict.fromkeys(group))
        made = _made.setdefault(robot, {})
        if names not in made:
            made[names] = _made_of(robot, names)
        return made[names]
    groups = planning_groups(robot)
    if not groups:
        raise InputError(f"robot {robot.name!r} has no joint that could move")
    if group is None:
        return next(iter(groups.values()))
    check_known("planning group", group, groups)
    return groups[group]


def find_mask(
    group: PlanningGroup | None, mask: Sequence[bool] | None
) -> Sequence[bool]:
    """Return what of a pose counts for a group, unless it is said.

    InputError if what is said isn't six flags.
    """
    if mask is None:
        is_position_only = group is not None and group.is_position_only
        return POSITION if is_position_only else WHOLE_POSE
    is_list = isinstance(mask, Iterable) and not isinstance(mask, str)
    shown: Any = list(mask) if is_list else mask
    flags = [isinstance(flag, Real | np.bool_) for flag in shown] if is_list else []
    if len(flags) == 6 and all(flags) and any(shown):
        return list(map(bool, shown))
    raise InputError(
        "mask: expected six flags, for x, y, z and turns about x, y, z, with one that "
        f"is set; got {shown!r}"
    )


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


def find_receiver(robot: Robot, group: PlanningGroup) -> str:
    """Return the controller that moves a group as planned, or raise InputError."""
    if (controller := find_controller(robot, group)) is not None:
        return controller
    if (forward := find_position_controller(robot, group)) is not None:
        return forward[0]
    names = [each.name for each in robot.controllers.controllers]
    raise InputError(
        f"no trajectory controller has exactly the joints of group {group.name!r}, "
        f"{quoted(group.joints)}; there are {quoted(names) or 'none'}"
    )


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


def _made_of(robot: Robot, names: tuple[str, ...]) -> PlanningGroup:
    own = [joint.name for joint in robot.description.independent_joints]
    for name in names:
        check_known("joint", name, own)
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
    """Return the named states for a group's joints; its own before those of others.

    Its own may be for some of its joints: the others stay where they are.
    """
    states: dict[str, Mapping[str, float]] = {}
    found = find_group_states(robot, robot.report)
    for state in sorted(found, key=lambda s: s.group != group):
        positions = {n: v for n, v in state.positions.items() if n in names}
        if set(positions) == set(names) or (positions and state.group == group):
            states.setdefault(state.name, positions)
    middle = center(joint_ranges(robot.description))
    initial = robot.initial_positions
    for name, known in (("initial", initial), ("home", initial), ("center", middle)):
        states.setdefault(name, {joint: known[joint] for joint in names})
    return states
