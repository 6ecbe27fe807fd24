"""What a robot is, in a few numbers."""

import math
import xml.etree.ElementTree as ET

from arm_drake.description.urdf import RobotDescription


def total_mass(description: RobotDescription) -> float:
    """Return the mass of all links together [kg], as it is simulated."""
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    masses = (mass.get("value", "0") for mass in root.iterfind("link/inertial/mass"))
    return math.fsum(map(float, masses))


def reach(description: RobotDescription) -> float:
    """Return how far the last link can be from the first movable joint [m].

    That is the length of the longest stretched chain of links; a prismatic joint adds
    its travel. Limits and geometry may allow less.
    """
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    origins = {joint.get("name"): joint.find("origin") for joint in root.iter("joint")}
    children: dict[str, list[str]] = {}
    for joint in description.joints:
        children.setdefault(joint.parent, []).append(joint.name)
    longest = 0.0
    # Link, length up to it, and whether a movable joint lies before it.
    waiting = [(name, 0.0, False) for name in (*description.roots, "world")]
    while waiting:
        link, length, has_moved = waiting.pop()
        longest = max(longest, length)
        for name in children.get(link, ()):
            joint, origin = description.joint(name), origins[name]
            text = "" if origin is None else origin.get("xyz", "")
            step = math.hypot(*map(float, text.split())) if has_moved else 0.0
            if joint.type == "prismatic":
                ends = (joint.limits.lower or 0.0, joint.limits.upper or 0.0)
                step += max(map(abs, ends))
            moved = has_moved or joint.is_movable
            waiting.append((joint.child, length + step, moved))
    return longest
