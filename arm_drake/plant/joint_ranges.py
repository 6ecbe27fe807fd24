"""Ranges of joints for sliders: ends, center, random poses, joints that follow.

The model is joint_state_publisher_gui (ros/joint_state_publisher, branch ros2): a joint
that turns without end has a slider of one turn, soft limits narrow the others, and the
center is 0 where 0 is within the range, else the middle. It refuses a robot with a
joint without limits; here such a joint gets a range to look at.
"""

import itertools
import math
import re
from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.base_wheels import moved_joints
from arm_drake.description.joint_limits import narrowest
from arm_drake.description.joints import JointInfo, last_master, links_on
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import GroupState, find_group_states
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import POSITION
from arm_drake.plant.plant import make_reduced_plant, trial_plant

# How far a joint without limits goes, to either side [rad] and [m].
_TURN, _SLIDE = math.pi, 1.0

# Limits further away stand for none, such as 1e16 [rad] or [m]: a slider is no use.
_FAR = 1e3


@dataclass(frozen=True)
class JointRange:
    """Range of a movable joint's position."""

    name: str

    # Unit of the numbers.
    unit: Literal["rad", "m"]

    # Not above the upper end; equal to it for a joint that can't move.
    lower: float
    upper: float

    # Whether it turns without end; then the range is from -pi to pi.
    wraps: bool = False

    # The joint that it follows, None for an independent one.
    follows: str | None = None

    @property
    def center(self) -> float:
        """0 if that is within the range, else its middle."""
        if self.lower <= 0.0 <= self.upper:
            return 0.0
        return 0.5 * (self.lower + self.upper)

    def fit(self, position: float) -> float:
        """Return the position in the range that is meant by any position.

        One that wraps is turned back to (-pi, pi], any other clamped.
        """
        if not self.wraps:
            return min(max(position, self.lower), self.upper)
        angle = math.remainder(position, 2.0 * math.pi)
        return math.pi if angle <= -math.pi else angle


def joint_ranges(description: RobotDescription) -> tuple[JointRange, ...]:
    """Return the ranges of the joints with one degree of freedom, in their order.

    `<safety_controller>` narrows `<limit>`, unless they have nothing in common; an
    attribute that it lacks is 0, as urdfdom reads it. A revolute joint without limits
    goes from -pi to pi, a prismatic one from -1 m to 1 m; one with a single limit has a
    range as wide. Limits beyond 1000 are none. A joint that follows goes as far as its
    master takes it, unless `<safety_controller>` narrows its own.
    """
    return tuple(_range(joint) for joint in description.movable_joints)


def center(ranges: Iterable[JointRange]) -> dict[str, float]:
    """Return the centers of independent joints [rad] or [m] by name."""
    return {r.name: r.center for r in ranges if r.follows is None}


def randomize(
    ranges: Iterable[JointRange], rng: "np.random.Generator"
) -> dict[str, float]:
    """Return positions of independent joints [rad, m], uniform in their ranges."""
    return {
        r.name: r.fit(float(rng.uniform(r.lower, r.upper)))
        for r in ranges
        if r.follows is None
    }


def complete(
    description: RobotDescription, positions: Mapping[str, float]
) -> dict[str, float]:
    """Return the position of every movable joint [rad] or [m], in their order.

    Given positions are fitted into their ranges; independent joints that are left out
    are at their centers, and one that follows is where its master puts it, also beyond
    its own limits. InputError if a position is for no joint or one that follows, or
    isn't finite.
    """
    ranges = {r.name: r for r in joint_ranges(description)}
    own = [name for name, r in ranges.items() if r.follows is None]
    for name, position in positions.items():
        if name not in ranges:
            raise InputError(f"no joint {name!r}; {suggest(name, own)}")
        if (other := ranges[name].follows) is not None:
            raise InputError(f"{name!r} follows {other!r}; give that one")
        if not math.isfinite(position):
            problem = f"expected a finite number, got {position!r}"
            raise InputError(problem, where=f"joint {name!r}")
    at = {
        name: ranges[name].fit(float(positions.get(name, ranges[name].center)))
        for name in own
    }
    joints = {joint.name: joint for joint in description.movable_joints}
    for name, joint in joints.items():
        if joint.mimic is not None:
            master, factor, offset = last_master(joint, joints)
            at[name] = factor * at[master] + offset
    return {name: at[name] for name in joints}


def _range(joint: JointInfo) -> JointRange:
    follows = None if joint.mimic is None else joint.mimic.joint
    if joint.type == "continuous":
        return JointRange(joint.name, "rad", -math.pi, math.pi, True, follows)
    is_slide = joint.type == "prismatic"
    lower, upper = _ends(joint, _SLIDE if is_slide else _TURN)
    unit: Literal["rad", "m"] = "m" if is_slide else "rad"
    return JointRange(joint.name, unit, lower, upper, False, follows)


def _ends(joint: JointInfo, reach: float) -> tuple[float, float]:
    """Return the ends of a range; where both are missing, they are so far from 0."""
    lower, upper = _known(joint.limits.lower), _known(joint.limits.upper)
    soft = joint.safety_controller
    if soft is not None and (soft.soft_lower_limit or soft.soft_upper_limit):
        inner = (
            narrowest(max, lower, _known(soft.soft_lower_limit)),
            narrowest(min, upper, _known(soft.soft_upper_limit)),
        )
        if None in inner or inner[0] <= inner[1]:  # type: ignore[operator]
            lower, upper = inner
    if lower is None:
        lower = -reach if upper is None else upper - 2.0 * reach
    if upper is None:
        upper = lower + 2.0 * reach
    return lower, upper


def _known(limit: float | None) -> float | None:
    return None if limit is None or abs(limit) > _FAR else limit


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
    """
    joints = [*find_gripper_joints(robot), *_joints_of_gripper_controllers(robot)]
    limits = {j.name: _limits(robot, j) for j in joints}
    limited = {name: ends for name, ends in limits.items() if None not in ends}
    if not limited:
        return {}
    states = find_group_states(robot)
    # Which gap is wider may hang on rounding, which the base's pose must not change.
    if robot.pose is None:
        plant = trial_plant(robot).Clone()
    else:
        plant = make_reduced_plant(robot.description, None, 0.0)
    model = plant.GetModelInstanceByName("robot")
    ranges = {}
    for name, (lower, upper) in limited.items():
        declared = [
            _named_position(name, states, called) for called in (_OPEN, _CLOSED)
        ]
        assert lower is not None
        assert upper is not None
        gaps = [_gap(plant, model, robot, name, q) for q in (lower, upper)]
        wide, narrow = (upper, lower) if gaps[1] > gaps[0] else (lower, upper)
        if lower < 0.0 < upper and abs(wide) < abs(narrow):
            wide = 0.0
        start, end = (
            limit if bound is None else bound
            for bound, limit in zip(declared, (wide, narrow), strict=True)
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


def _named_position(
    joint: str, states: Iterable[GroupState], called: re.Pattern[str]
) -> float | None:
    """Return a joint's position in the first state that is called so."""
    for state in states:
        if joint in state.positions and called.search(state.name):
            return state.positions[joint]
    return None


def find_gripper_joints(robot: Robot) -> list[JointInfo]:
    """Return the independent joints that move grippers."""
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
    """Return the links of grippers: what their joints move, and what holds these."""
    description, grippers = robot.description, find_gripper_joints(robot)
    moved = [j for each in grippers for j in moved_joints(description, each.name)]
    links = {link for j in moved for link in links_on(description.joints, j.child)}
    return links | {joint.parent for joint in grippers}


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
    joints = {j.name: j for j in robot.description.movable_joints}
    moved = moved_joints(robot.description, name)
    for joint in moved:
        _, factor, offset = last_master(joint, joints)
        q = factor * position + offset
        plant.GetJointByName(joint.name, model).set_default_positions([q])
    context = plant.CreateDefaultContext()
    inner = {joint.parent for joint in moved}
    fingers = [joint.child for joint in moved if joint.child not in inner]
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
