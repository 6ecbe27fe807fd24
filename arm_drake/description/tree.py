"""The tree that links and joints make, and who follows whom."""

from collections.abc import Mapping, Sequence

from arm_drake.description.joints import JointInfo


def links_on(joints: Sequence[JointInfo], link: str) -> set[str]:
    """Return a link, and all that hang on it through joints."""
    found, waiting = set(), [link]
    children: dict[str, list[str]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint.child)
    while waiting:
        found.add(waiting[-1])
        waiting += children.get(waiting.pop(), [])
    return found


def from_the_root(joints: Sequence[JointInfo]) -> list[JointInfo]:
    """Return the joints so that each comes after those that carry it."""
    carriers = {joint.child: joint.parent for joint in joints}

    def depth(joint: JointInfo) -> int:
        count, link = 0, joint.parent
        while link in carriers:
            count, link = count + 1, carriers[link]
        return count

    return sorted(joints, key=depth)


def last_master(
    joint: JointInfo, joints: Mapping[str, JointInfo]
) -> tuple[str, float, float]:
    """Return the joint that moves a mimic joint in the end, and their relation.

    Args:
        joint: A joint; one that follows none is its own master.
        joints: The joints by name; mimic relations make no circle.

    Returns:
        Name of the master, factor and offset: position = factor * master's + offset.
    """
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = joints[joint.mimic.joint]
    return joint.name, factor, offset
