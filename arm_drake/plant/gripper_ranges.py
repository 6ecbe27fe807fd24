"""Which positions of a gripper's joint are open and closed."""

import itertools
import re
from collections.abc import Iterable

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.joints import JointInfo
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import GroupState, find_group_states
from arm_drake.interfaces import POSITION
from arm_drake.plant.plant import add_robot_model

# Names of joints of grippers.
_GRIPPER = re.compile(r"grip|finger|jaw|knuckle|claw", re.I)

# Joints that a controller of a gripper moves, at most; one of more has an arm, too.
_FINGERS = 2

# Names of states of a gripper in MoveIt's description.
_OPEN = re.compile(r"open", re.I)
_CLOSED = re.compile(r"clos", re.I)


def find_gripper_ranges(robot: Robot) -> dict[str, tuple[float, float]]:
    """Return where grippers' joints are open and where closed [rad] or [m].

    A joint with limits, its own or those of its commands, is a gripper's if a gripper
    controller moves it, if it is called so, or if its controller is. States of MoveIt's
    description that are called open and closed decide; else the gripper is closed at
    the limit at which its fingers are closer together, and open at the other one, or at
    0 if that lies between and nearer to it.

    Args:
        robot: The robot.
    """
    joints = [*find_gripper_joints(robot), *_joints_of_gripper_controllers(robot)]
    limits = {j.name: _limits(robot, j) for j in joints}
    limited = {name: ends for name, ends in limits.items() if None not in ends}
    if not limited:
        return {}
    states = find_group_states(robot)
    plant = MultibodyPlant(0.0)
    model = add_robot_model(plant, robot.description, "robot", None, is_reduced=True)
    plant.Finalize()
    ranges = {}
    for name, (lower, upper) in limited.items():
        said = [_stated(name, states, called) for called in (_OPEN, _CLOSED)]
        assert lower is not None
        assert upper is not None
        gaps = [_gap(plant, model, robot, name, q) for q in (lower, upper)]
        wide, narrow = (upper, lower) if gaps[1] > gaps[0] else (lower, upper)
        if lower < 0.0 < upper and abs(wide) < abs(narrow):
            wide = 0.0
        start, end = (
            limit if given is None else given
            for given, limit in zip(said, (wide, narrow), strict=True)
        )
        ranges[name] = (start, end)
    return ranges


def _joints_of_gripper_controllers(robot: Robot) -> list[JointInfo]:
    """Return independent joints, at most two, of controllers called gripper's."""
    named: set[object] = set()
    for controller in robot.controllers.controllers:
        parameter = controller.parameters.get("joints")
        joints = parameter.value if parameter is not None else ()
        is_short = isinstance(joints, list | tuple) and len(joints) <= _FINGERS
        if is_short and _GRIPPER.search(controller.name):
            named.update(joints)
    return [
        joint
        for joint in robot.description.movable_joints
        if joint.mimic is None and joint.name in named
    ]


def _stated(
    joint: str, states: Iterable[GroupState], called: re.Pattern[str]
) -> float | None:
    """Return a joint's position in the first state that is called so."""
    for state in states:
        if joint in state.positions and called.search(state.name):
            return state.positions[joint]
    return None


def find_gripper_joints(robot: Robot) -> list[JointInfo]:
    """Return the independent joints that move grippers.

    Args:
        robot: The robot.
    """
    named = {
        parameter.value
        for controller in robot.controllers.controllers
        if controller.type.endswith("GripperActionController")
        and (parameter := controller.parameters.get("joint")) is not None
        and isinstance(parameter.value, str)
    }
    return [
        joint
        for joint in robot.description.movable_joints
        if joint.mimic is None and (joint.name in named or _GRIPPER.search(joint.name))
    ]


def find_gripper_links(robot: Robot) -> set[str]:
    """Return the links of grippers: what their joints move, and what holds these.

    Args:
        robot: The robot.
    """
    joints = robot.description.joints
    grippers = find_gripper_joints(robot)
    moved = {joint.name for joint in grippers}
    while True:
        more = {j.name for j in joints if j.mimic and j.mimic.joint in moved} - moved
        if not more:
            break
        moved |= more
    links = {joint.child for joint in joints if joint.name in moved}
    while True:
        further = {joint.child for joint in joints if joint.parent in links} - links
        if not further:
            return links | {joint.parent for joint in grippers}
        links |= further


def _limits(robot: Robot, joint: JointInfo) -> tuple[float | None, float | None]:
    """Return the limits of a joint, or else those of its position's commands."""
    lower, upper = joint.limits.lower, joint.limits.upper
    for block in robot.description.hardware:
        for component in block.joints:
            for interface in component.command_interfaces:
                if component.name == joint.name and interface.name == POSITION:
                    lower = interface.min if lower is None else lower
                    upper = interface.max if upper is None else upper
    return lower, upper


def _gap(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    robot: Robot,
    name: str,
    position: float,
) -> float:
    """Return how far apart the fingers are that a joint moves [m].

    They are the last links that it moves, by themselves the centers of their masses; a
    single one is seen from the link that it is attached to.
    """
    followers = {
        j.name: j for j in robot.description.movable_joints if j.mimic is not None
    }
    moved = {name: position}
    while True:
        more = {
            j.name: j.mimic.multiplier * moved[j.mimic.joint] + j.mimic.offset
            for j in followers.values()
            if j.mimic is not None and j.mimic.joint in moved and j.name not in moved
        }
        if not more:
            break
        moved |= more
    for joint, q in moved.items():
        plant.GetJointByName(joint, model).set_default_positions([q])
    context = plant.CreateDefaultContext()
    joints = {j.name: j for j in robot.description.movable_joints}
    links = [joints[n].child for n in moved]
    inner = {j.parent for n, j in joints.items() if n in moved}
    fingers = [link for link in links if link not in inner]
    if len(fingers) == 1:
        fingers.append(joints[name].parent)
    points = [
        plant.GetBodyByName(link, model).EvalPoseInWorld(context)
        @ plant.GetBodyByName(link, model).default_com()
        for link in fingers
    ]
    distances = [
        float(np.linalg.norm(a - b)) for a, b in itertools.combinations(points, 2)
    ]
    return sum(distances)
