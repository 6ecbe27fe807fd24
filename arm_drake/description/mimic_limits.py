"""Limits of mimic joints, which don't hold back the joints that they follow.

In ROS a joint moves whatever its mimic joints are allowed: mock_components and
robot_state_publisher compute their positions, and gz_ros2_control drives them by
themselves, so that one at its limit stays behind. Here they are coupled, and one at its
limit would stop all. Fingers that move against each other often have the limits of the
same side.
"""

import copy
import dataclasses as dc
import math
import xml.etree.ElementTree as ET

from arm_drake.description.elements import attribute
from arm_drake.description.joints import JointInfo, JointLimits, last_master
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

# Of the way that a joint is taken, so much beyond its limits is rounding, and so much
# makes no difference to see.
_SHARES = 1e-6, 0.01


def fit_mimic_limits(
    description: RobotDescription, report: LoadReport
) -> RobotDescription:
    """Return the robot with limits of mimic joints wide enough for their masters."""
    joints = {joint.name: joint for joint in description.joints}
    fitted = {}
    for joint in description.movable_joints:
        if joint.mimic is not None:
            limits = _fit(joint, joints, description, report)
            if limits != joint.limits:
                fitted[joint.name] = limits
    if not fitted:
        return description
    root = copy.deepcopy(description.root)
    _write(root, fitted)
    return dc.replace(
        description,
        joints=tuple(
            dc.replace(joint, limits=fitted.get(name, joint.limits))
            for name, joint in joints.items()
        ),
        root=root,
    )


def _fit(
    joint: JointInfo,
    joints: dict[str, JointInfo],
    description: RobotDescription,
    report: LoadReport,
) -> JointLimits:
    """Return a mimic joint's limits with those of its master within, and report it."""
    lower, upper = _ends(joint)
    name, factor, offset = last_master(joint, joints)
    # 0 times infinity is no number, but a joint that stays where it is.
    ends = [factor * end if factor else 0.0 for end in _ends(joints[name])]
    low, high = (offset + end for end in sorted(ends))
    below = lower - low if low < lower else 0.0
    above = high - upper if high > upper else 0.0
    beyond = max(below, above)
    way = max(high - low, upper - lower)
    # Of a way without end nothing is small.
    rounding, small = (share * way if way < math.inf else 0.0 for share in _SHARES)
    if beyond <= rounding:
        return joint.limits
    report.add(
        "info" if beyond <= small else "warning",
        "repair",
        f"limits of {lower:.4g} to {upper:.4g} would stop {name!r}, which takes it "
        f"from {low:.4g} to {high:.4g}",
        "it follows beyond them",
        where=f"joint {joint.name!r}",
        file=description.file,
    )
    low, high = min(low, lower), max(high, upper)
    return dc.replace(
        joint.limits,
        lower=low if math.isfinite(low) else None,
        upper=high if math.isfinite(high) else None,
    )


def _ends(joint: JointInfo) -> tuple[float, float]:
    """Return the limits of a joint, infinite where it has none [rad] or [m]."""
    lower, upper = joint.limits.lower, joint.limits.upper
    return -math.inf if lower is None else lower, math.inf if upper is None else upper


def _write(root: ET.Element, limits: dict[str, JointLimits]) -> None:
    """Give the joints of a URDF these limits."""
    for element in root.iterfind("joint"):
        new, limit = limits.get(attribute(element, "name")), element.find("limit")
        if new is None or limit is None:
            continue
        for end, value in (("lower", new.lower), ("upper", new.upper)):
            # Drake takes no infinity, but that an end isn't said.
            limit.attrib.pop(end, None)
            if value is not None:
                limit.set(end, repr(value))
