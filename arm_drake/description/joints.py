"""Joints of a robot, and whether they make a robot with its links."""

import dataclasses as dc
from pathlib import Path

from arm_drake.errors import DescriptionError, suggest

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
UNSUPPORTED_TYPES = ("floating", "planar")
JOINT_TYPES = (*MOVABLE_TYPES, "fixed", *UNSUPPORTED_TYPES)

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
    _check_tree(joints, file)
    _check_mimics({joint.name: joint for joint in joints}, file)


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


def _check_mimics(joints: dict[str, JointInfo], file: Path) -> None:
    for joint in joints.values():
        master, seen = joint, {joint.name}
        while master.mimic is not None:
            name = master.mimic.joint
            if name not in joints:
                problem = f"mimics {name!r}, which doesn't exist; "
                problem += suggest(name, joints)
            elif name in seen:
                problem = f"mimics itself, through {name!r}"
            elif joint.is_movable and not joints[name].is_movable:
                problem = f"mimics {name!r}, which is {joints[name].type}; "
                problem += f"expected one of {', '.join(MOVABLE_TYPES)}"
            else:
                master = joints[name]
                seen.add(name)
                continue
            raise DescriptionError(problem, file=file, where=f"joint {joint.name!r}")
