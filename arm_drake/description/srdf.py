"""MoveIt's SRDF: disabled collisions and named positions."""

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake.description.elements import parse_number
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot

# How packages with an SRDF are called.
_MOVEIT = "moveit_config"

Pairs = frozenset[tuple[str, str]]


@dc.dataclass(frozen=True)
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


def find_disabled_collisions(robot: Robot, report: LoadReport) -> Pairs:
    """Return the pairs of links, in order of name, whose collisions are disabled.

    The SRDF files of the description's own package and of the MoveIt packages around
    it are read; those for another robot are left out.
    """
    pairs, description = set(), robot.description
    for _, root in _roots(robot, report):
        for element in root.iter("disable_collisions"):
            one, two = sorted((element.get("link1", ""), element.get("link2", "")))
            if {one, two} <= set(description.links):
                pairs.add((one, two))
    return frozenset(pairs)


def find_group_states(robot: Robot) -> tuple[GroupState, ...]:
    """Return the named states of groups of joints, in the order of the files.

    Of states of one group with the same name, and of positions of one joint, the first
    counts. Joints that the robot doesn't have, that follow others or that have several
    degrees of freedom are left out.
    """
    joints = {j.name for j in robot.description.movable_joints if j.mimic is None}
    states: dict[tuple[str, str], GroupState] = {}
    for _, root in _roots(robot, LoadReport()):
        for element in root.iter("group_state"):
            group, name = element.get("group", ""), element.get("name", "")
            positions: dict[str, float] = {}
            for joint in element.iter("joint"):
                value = parse_number(joint.get("value", ""))
                if value is not None and joint.get("name") in joints:
                    positions.setdefault(joint.get("name", ""), value)
            if positions:
                states.setdefault((group, name), GroupState(group, name, positions))
    return tuple(states.values())


def find_srdf_files(robot: Robot) -> tuple[Path, ...]:
    """Return the SRDF files that are for a robot."""
    return tuple(path for path, _ in _roots(robot, LoadReport()))


def _roots(robot: Robot, report: LoadReport) -> Iterator[tuple[Path, ET.Element]]:
    """Yield the files that are for a robot, and their roots."""
    description = robot.description
    for path in _files(description.file, robot.package_paths):
        try:
            root = ET.parse(path).getroot()  # noqa: S314  no external entities.
        except (OSError, ET.ParseError, ValueError) as error:
            what = f"the SRDF can't be read ({' '.join(str(error).split())})"
            report.add("warning", "invalid", what, "it has no effect", file=path)
            continue
        if root.get("name") == description.name:
            yield path, root


def _files(file: Path, package_paths: Sequence[Path]) -> Iterator[Path]:
    packages = PackageFinder(file, package_paths)
    folders = [f for f in file.parents if (f / "package.xml").is_file()][:1]
    folders += [folder for name, folder in packages.known() if _MOVEIT in name]
    seen = set()
    for folder in folders:
        for path in sorted(folder.rglob("*.srdf")):
            if path.resolve() not in seen:
                seen.add(path.resolve())
                yield path
