"""MoveIt's SRDF: groups of joints, disabled collisions and named positions."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake.description.elements import parse_number
from arm_drake.description.joints import joints_above
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.robot import Robot
from arm_drake.errors import quoted
from arm_drake.importing import dataclass

Pairs = frozenset[tuple[str, str]]

# What becomes of what can't be used.
_LEFT_OUT = "it is left out"


@dataclass(frozen=True)
class GroupState:
    """Positions with a name, of a group of joints."""

    # Groups may have states of the same name: an arm and its gripper are both "home".
    group: str
    name: str

    # [rad] or [m] by joint: independent joints of the robot, at least one.
    positions: Mapping[str, float]

    @property
    def label(self) -> str:
        """A name that no other state has."""
        return f"{self.group}: {self.name}"


@dataclass(frozen=True)
class GroupInfo:
    """A `<group>`: joints that are planned for together."""

    name: str

    # Independent joints with one degree of freedom, in the order of the description.
    joints: tuple[str, ...]

    # The last link of its last chain; None without one.
    tip: str | None = None

    # Whether an `<end_effector>` names it.
    is_end_effector: bool = False


def find_groups(robot: Robot, report: LoadReport) -> tuple[GroupInfo, ...]:
    """Return the groups with a joint that moves, in the order of the files.

    A group is made of joints, of links (the joints that hold them), of chains and of
    other groups, without passive joints. Of groups with one name the first counts.
    The report says what of them can't be used.
    """
    groups: dict[str, GroupInfo] = {}
    for path, root in _roots(robot, LoadReport()):
        elements = {e.get("name", ""): e for e in reversed(root.findall("group"))}
        passive = {e.get("name") for e in root.iter("passive_joint")}
        effectors = {e.get("group") for e in root.iter("end_effector")}
        for name in reversed(elements):
            where, problems = f"group {name!r}", list[str]()
            named, tip = _members(robot, root, (name,), problems)
            for what in problems:
                report.add(
                    "warning", "invalid", what, _LEFT_OUT, where=where, file=path
                )
            joints = tuple(
                joint.name
                for joint in robot.description.movable_joints
                if joint.name in named - passive and joint.mimic is None
            )
            if joints and name not in groups:
                groups[name] = GroupInfo(name, joints, tip, name in effectors)
            elif not joints:
                what = "no joint of it moves by itself"
                done = "it can't be planned for"
                # It may be the links of a tool.
                is_whole = len(elements[name]) > 0 and not problems
                severity: Severity = "info" if is_whole else "warning"
                report.add(severity, "ignored", what, done, where=where, file=path)
    return tuple(groups.values())


def _members(
    robot: Robot, root: ET.Element, names: tuple[str, ...], problems: list[str]
) -> tuple[set[str], str | None]:
    """Return the joints of the last of groups in each other, and its last chain's end.

    Problems are those of the first.
    """
    joints, links = robot.description.joints, robot.description.links
    groups = {e.get("name", ""): e for e in reversed(root.findall("group"))}
    holders = {joint.child: joint.name for joint in joints}
    known = {*holders.values(), *(e.get("name") for e in root.iter("virtual_joint"))}
    found: set[str] = set()
    unknown: dict[str, list[str]] = {}
    own: list[str] = []
    tip = None
    for element in groups[names[-1]]:
        other = element.get("name", "")
        if element.tag == "joint" and other in known:
            found.add(other)
        elif element.tag == "link" and other in links:
            found |= {holders[other]} if other in holders else set()
        elif element.tag == "chain":
            base, end = element.get("base_link", ""), element.get("tip_link", "")
            above = joints_above(joints, end)
            parents = [joint.parent for joint in above]
            if missing := [link for link in (base, end) if link not in links]:
                unknown.setdefault("link", []).extend(missing)
            elif base in (end, *parents):
                count = 0 if base == end else parents.index(base) + 1
                found |= {joint.name for joint in above[:count]}
                tip = end
            else:
                own.append(f"link {base!r} doesn't carry link {end!r}")
        elif element.tag == "group" and other in names:
            if other == names[0]:
                problems.append("it is part of itself")
        elif element.tag == "group" and other in groups:
            found |= _members(robot, root, (*names, other), problems)[0]
        elif element.tag in ("joint", "link", "group"):
            unknown.setdefault(element.tag, []).append(other)
    for kind, missing in unknown.items():
        own.append(f"there is no {kind} {quoted(dict.fromkeys(missing))}")
    problems += own if len(names) == 1 else ()
    return found, tip


def find_disabled_collisions(robot: Robot, report: LoadReport) -> Pairs:
    """Return the pairs of links, in order of name, whose collisions are disabled.

    The SRDF files of the description's own package and of the MoveIt packages around
    it are read; those for another robot are left out. Where there are several, as for
    a robot with a gripper and one without, a pair must be in all of them.
    """
    links = set(robot.description.links)
    found = [
        {
            (min(one, two), max(one, two))
            for element in root.iter("disable_collisions")
            if {one := element.get("link1", ""), two := element.get("link2", "")}
            <= links
        }
        for _, root in _roots(robot, report)
    ]
    return frozenset(set.intersection(*found) if found else ())


def find_group_states(
    robot: Robot, report: LoadReport | None = None
) -> tuple[GroupState, ...]:
    """Return the named states of groups of joints, in the order of the files.

    Of states of one group with the same name, and of positions of one joint, the first
    counts. Joints that the robot doesn't have, that follow others or that have several
    degrees of freedom are left out. The report says what can't be used at all.
    """
    joints = {joint.name for joint in robot.description.independent_joints}
    known = {joint.name for joint in robot.description.joints}
    report = LoadReport() if report is None else report
    states: dict[tuple[str, str], GroupState] = {}
    for path, root in _roots(robot, LoadReport()):
        virtual = {e.get("name") for e in root.iter("virtual_joint")}
        for element in root.iter("group_state"):
            group, name = element.get("group", ""), element.get("name", "")
            positions: dict[str, float] = {}
            problems, unknown = list[str](), list[str]()
            for joint in element.iter("joint"):
                other, text = joint.get("name", ""), joint.get("value", "")
                value = parse_number(text)
                if value is not None and other in joints:
                    positions.setdefault(other, value)
                elif other in joints:
                    problems.append(f"joint {other!r}: expected a number, got {text!r}")
                elif other not in known | virtual:
                    unknown.append(other)
            if unknown:
                problems.append(f"there is no joint {quoted(unknown)}")
            where = f"state {name!r} of group {group!r}"
            for what in problems:
                report.add(
                    "warning", "invalid", what, _LEFT_OUT, where=where, file=path
                )
            if positions:
                states.setdefault((group, name), GroupState(group, name, positions))
    return tuple(states.values())


def find_srdf_files(robot: Robot) -> tuple[Path, ...]:
    """Return the SRDF files that are for a robot."""
    return tuple(path for path, _ in _roots(robot, LoadReport()))


def _roots(robot: Robot, report: LoadReport) -> Iterator[tuple[Path, ET.Element]]:
    """Yield the files that are for a robot, and their roots."""
    description, named = robot.description, robot.srdf_files
    files = _files(description.moveit_folders) if named is None else named
    found = []
    for path in files:
        try:
            root = ET.parse(path).getroot()  # noqa: S314  no external entities.
        except (OSError, ET.ParseError, ValueError) as error:
            what = f"the SRDF can't be read ({' '.join(str(error).split())})"
            report.add("warning", "invalid", what, "it has no effect", file=path)
            continue
        if named is not None or root.get("name") == description.name:
            found.append((path, root))
    # Several may have the robot's name: those called as its file, or as itself, count.
    for stem in (description.file.stem, description.name):
        chosen = [each for each in found if each[0].stem == stem]
        if chosen and named is None:
            found = chosen
            break
    yield from found


def _files(folders: Sequence[Path]) -> Iterator[Path]:
    seen = set()
    for folder in folders:
        for path in sorted(folder.rglob("*.srdf")):
            if path.resolve() not in seen:
                seen.add(path.resolve())
                yield path
