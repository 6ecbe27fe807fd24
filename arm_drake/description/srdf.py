"""MoveIt's semantic description: links that never collide, positions with a name."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path

from arm_drake.description.elements import parse_number
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot

# How packages with an SRDF are called.
_MOVEIT = "moveit_config"

Pairs = frozenset[tuple[str, str]]


def find_disabled_collisions(robot: Robot, report: LoadReport) -> Pairs:
    """Return the pairs of links, in order of name, whose collisions are disabled.

    The SRDF files of the description's own package and of the MoveIt packages around
    it are read; those for another robot are left out.

    Args:
        robot: The robot.
        report: Where a file that can't be read is recorded.
    """
    pairs, description = set(), robot.description
    for root in _roots(robot, report):
        for element in root.iter("disable_collisions"):
            one, two = sorted((element.get("link1", ""), element.get("link2", "")))
            if {one, two} <= set(description.links):
                pairs.add((one, two))
    return frozenset(pairs)


def find_group_states(robot: Robot) -> dict[str, dict[str, float]]:
    """Return the positions [rad] or [m] by joint of named states of groups of joints.

    Of states with the same name the first counts.

    Args:
        robot: The robot.
    """
    states: dict[str, dict[str, float]] = {}
    for root in _roots(robot, LoadReport()):
        for state in root.iter("group_state"):
            positions = states.setdefault(state.get("name", ""), {})
            for joint in state.iter("joint"):
                value = parse_number(joint.get("value", ""))
                if value is not None:
                    positions.setdefault(joint.get("name", ""), value)
    return states


def _roots(robot: Robot, report: LoadReport) -> Iterator[ET.Element]:
    """Yield the roots of the files that are for a robot."""
    description = robot.description
    for path in _files(description.file, robot.package_paths):
        try:
            root = ET.parse(path).getroot()  # noqa: S314  no external entities.
        except (OSError, ET.ParseError, ValueError) as error:
            what = f"the SRDF can't be read ({' '.join(str(error).split())})"
            report.add("warning", "invalid", what, "it has no effect", file=path)
            continue
        if root.get("name") == description.name:
            yield root


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
