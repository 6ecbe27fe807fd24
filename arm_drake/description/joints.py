"""Joints of a robot, and whether they make a robot with its links."""

import dataclasses as dc
from pathlib import Path

from arm_drake.description.report import LoadReport
from arm_drake.errors import DescriptionError, suggest

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
# They have several degrees of freedom: no interface of ros2_control is for them.
FREE_TYPES = ("floating", "planar")

JOINT_TYPES = (*MOVABLE_TYPES, "fixed", *FREE_TYPES)

WORLD = "world"


@dc.dataclass(frozen=True)
class JointLimits:
    """`<limit>` of a joint; None where nothing is said, or 0 or inf for "unset"."""

    # [rad] or [m].
    lower: float | None = None
    upper: float | None = None

    # [N·m] or [N].
    effort: float | None = None

    # [rad/s] or [m/s].
    velocity: float | None = None


@dc.dataclass(frozen=True)
class Mimic:
    """`<mimic>`: position = multiplier * position of ``joint`` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dc.dataclass(frozen=True)
class SafetyController:
    """`<safety_controller>` of a joint; the lower and upper limit as urdfdom has them.

    Limits that are both 0 are none.
    """

    # [rad] or [m].
    soft_lower_limit: float = 0.0
    soft_upper_limit: float = 0.0

    # Speed per distance from a limit [1/s].
    k_position: float = 0.0

    # Effort per speed [N·m·s/rad] or [N·s/m]; None where it is not given.
    k_velocity: float | None = None


@dc.dataclass(frozen=True)
class JointInfo:
    """A joint of a robot."""

    name: str

    # One of JOINT_TYPES.
    type: str

    parent: str
    child: str
    limits: JointLimits = JointLimits()

    # Viscous damping [N·m·s/rad] or [N·s/m].
    damping: float = 0.0

    # Dry friction [N·m] or [N].
    friction: float = 0.0

    mimic: Mimic | None = None

    safety_controller: SafetyController | None = None

    @property
    def is_movable(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.type in MOVABLE_TYPES


def check_structure(
    links: tuple[str, ...], joints: tuple[JointInfo, ...], file: Path
) -> None:
    """Raise DescriptionError if links and joints make no trees.

    Args:
        links: Names of the links.
        joints: The joints.
        file: File to name.
    """
    for kind, names in (("link", links), ("joint", [j.name for j in joints])):
        repeated = sorted({name for name in names if list(names).count(name) > 1})
        if repeated:
            raise DescriptionError(
                f"two {kind}s are called {repeated[0]!r}; names must be unique",
                file=file,
            )
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links and link != WORLD:
                raise DescriptionError(
                    f"{role} link {link!r} doesn't exist; {suggest(link, links)}",
                    file=file,
                    where=f"joint {joint.name!r}",
                )
        if joint.child == WORLD:
            raise DescriptionError(
                f"the child is {WORLD!r}, which nothing moves; it can only be a parent",
                file=file,
                where=f"joint {joint.name!r}",
            )
    _check_tree(joints, file)


def _check_tree(joints: tuple[JointInfo, ...], file: Path) -> None:
    holders: dict[str, JointInfo] = {}
    for joint in joints:
        other = holders.setdefault(joint.child, joint)
        if other is not joint:
            raise DescriptionError(
                f"joint {other.name!r} holds link {joint.child!r} already; "
                "a link is the child of one joint",
                file=file,
                where=f"joint {joint.name!r}",
            )
    is_tree: set[str] = set()
    for joint in joints:
        path, link = {joint.child}, joint.parent
        while link in holders and link not in is_tree:
            if link in path:
                raise DescriptionError(
                    f"link {link!r} hangs on itself; links and joints form a tree",
                    file=file,
                    where=f"joint {holders[link].name!r}",
                )
            path.add(link)
            link = holders[link].parent
        is_tree |= path


def drop_bad_mimics(
    joints: tuple[JointInfo, ...], file: Path, report: LoadReport
) -> tuple[JointInfo, ...]:
    """Return the joints without `<mimic>` tags that nothing can follow.

    Args:
        joints: The joints.
        file: File to name.
        report: Where each one is recorded.
    """
    by_name = {joint.name: joint for joint in joints}
    for name, joint in by_name.items():
        problem = _mimic_problem(joint, by_name)
        if problem:
            by_name[name] = dc.replace(joint, mimic=None)
            is_fixed = joint.type == "fixed"
            done = "it is fixed" if is_fixed else "the joint moves on its own"
            where = f"joint {name!r}"
            report.add("warning", "invalid", problem, done, where=where, file=file)
    return tuple(by_name.values())


def _mimic_problem(joint: JointInfo, joints: dict[str, JointInfo]) -> str | None:
    """Return why a joint can't follow its master, None if it can or has none."""
    if joint.mimic is None:
        return None
    name = joint.mimic.joint
    if not joint.is_movable:
        return f"mimics {name!r}, but is {joint.type}"
    if name not in joints:
        return f"mimics {name!r}, which doesn't exist; {suggest(name, joints)}"
    if not joints[name].is_movable:
        kind, expected = joints[name].type, ", ".join(MOVABLE_TYPES)
        return f"mimics {name!r}, which is {kind}; expected one of {expected}"
    # What is wrong with the masters of its master is their problem.
    mimic: Mimic | None = joint.mimic
    seen: set[str] = set()
    while mimic is not None and mimic.joint in joints and mimic.joint not in seen:
        if mimic.joint == joint.name:
            return f"mimics itself, through {name!r}"
        seen.add(mimic.joint)
        mimic = joints[mimic.joint].mimic
    return None
