"""Where sliders move joints: ranges, center, random poses, and joints that follow.

The model is joint_state_publisher_gui (ros/joint_state_publisher, branch ros2): a joint
that turns without end has a slider of one turn, soft limits narrow the others, and the
center is 0 where 0 is within the range, else the middle. It refuses a robot with a
joint without limits; here such a joint gets a range to look at.
"""

import dataclasses as dc
import math
from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np

from arm_drake.description.joints import JointInfo
from arm_drake.description.tree import last_master
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError, suggest

# How far a joint without limits goes, to either side [rad] and [m].
_TURN, _SLIDE = math.pi, 1.0

# Limits further away stand for none, such as 1e16 [rad] or [m]: a slider is no use.
_FAR = 1e3


@dc.dataclass(frozen=True)
class JointRange:
    """Where a movable joint can be put."""

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

        Args:
            position: Position of the joint, finite.
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
    range as wide. Limits beyond 1000 are none. Limits of a joint that follows are its
    own, whether its master can keep them or not.

    Args:
        description: The robot.
    """
    return tuple(_range(joint) for joint in description.movable_joints)


def center(ranges: Iterable[JointRange]) -> dict[str, float]:
    """Return the centers of independent joints [rad] or [m] by name.

    Args:
        ranges: Ranges of joints; those that follow are left out.
    """
    return {r.name: r.center for r in ranges if r.follows is None}


def randomize(
    ranges: Iterable[JointRange], rng: np.random.Generator
) -> dict[str, float]:
    """Return random positions of independent joints [rad] or [m], by name.

    Args:
        ranges: Ranges of joints; those that follow are left out.
        rng: Where the numbers come from; each joint's are uniform in its range.
    """
    return {
        r.name: r.fit(float(rng.uniform(r.lower, r.upper)))
        for r in ranges
        if r.follows is None
    }


def complete(
    description: RobotDescription, positions: Mapping[str, float]
) -> dict[str, float]:
    """Return the position of every movable joint [rad] or [m], in their order.

    A joint that follows is where its master puts it, also beyond its own limits.

    Args:
        description: The robot.
        positions: Positions of independent joints [rad] or [m], which are fitted into
            their ranges; joints that are left out are at their centers.

    Raises:
        InputError: If one is for no joint or one that follows, or isn't finite.
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
            _narrowest(lower, _known(soft.soft_lower_limit), is_lower=True),
            _narrowest(upper, _known(soft.soft_upper_limit), is_lower=False),
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


def _narrowest(
    hard: float | None, soft: float | None, *, is_lower: bool
) -> float | None:
    given = [limit for limit in (hard, soft) if limit is not None]
    if not given:
        return None
    return max(given) if is_lower else min(given)
