"""Which positions of a gripper's joint are open and closed."""

import itertools
import re
from collections.abc import Iterator, Mapping

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.joints import JointInfo
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import find_group_states
from arm_drake.plant import add_robot_model

# Names of joints of grippers.
_GRIPPER = re.compile(r"grip|finger|jaw|knuckle|claw", re.I)

# Names of states of a gripper in MoveIt's description.
_OPEN = re.compile(r"open", re.I)
_CLOSED = re.compile(r"clos", re.I)


def find_gripper_ranges(robot: Robot) -> dict[str, tuple[float, float]]:
    """Return where grippers' joints are open and where closed [rad] or [m].

    A joint with limits is a gripper's if a gripper controller moves it, or if it is
    called so. States of MoveIt's description that are called open and closed decide;
    else the gripper is closed at the limit at which its fingers are closer together,
    and open at the other one, or at 0 if that lies between and nearer to it.

    Args:
        robot: The robot.
    """
    joints = list(_gripper_joints(robot))
    if not joints:
        return {}
    states = find_group_states(robot)
    plant = MultibodyPlant(0.0)
    model = add_robot_model(plant, robot.description, "robot", None, is_reduced=True)
    plant.Finalize()
    ranges = {}
    for joint in joints:
        said = [_stated(joint.name, states, name) for name in (_OPEN, _CLOSED)]
        lower, upper = joint.limits.lower, joint.limits.upper
        assert lower is not None
        assert upper is not None
        gaps = [_gap(plant, model, robot, joint.name, q) for q in (lower, upper)]
        wide, narrow = (upper, lower) if gaps[1] > gaps[0] else (lower, upper)
        if lower < 0.0 < upper and abs(wide) < abs(narrow):
            wide = 0.0
        start, end = (
            limit if given is None else given
            for given, limit in zip(said, (wide, narrow), strict=True)
        )
        ranges[joint.name] = (start, end)
    return ranges


def _stated(
    joint: str, states: Mapping[str, Mapping[str, float]], called: re.Pattern[str]
) -> float | None:
    """Return a joint's position in the first state that is called so."""
    for name, positions in states.items():
        if joint in positions and called.search(name):
            return positions[joint]
    return None


def _gripper_joints(robot: Robot) -> Iterator[JointInfo]:
    """Yield the joints that move grippers."""
    named = {
        parameter.value
        for controller in robot.controllers.controllers
        if controller.type.endswith("GripperActionController")
        and (parameter := controller.parameters.get("joint")) is not None
    }
    for joint in robot.description.movable_joints:
        limits = joint.limits
        is_limited = limits.lower is not None and limits.upper is not None
        is_called_so = _GRIPPER.search(joint.name)
        is_gripper = joint.name in named or is_called_so
        if joint.mimic is None and is_limited and is_gripper:
            yield joint


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
