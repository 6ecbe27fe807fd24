"""What the load report says of mobile bases whose wheels can't drive them."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

from arm_drake.description.base_wheels import MobileBase, wheel_links
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription


def report_bases(
    description: RobotDescription,
    bases: Iterable[MobileBase],
    friction: Mapping[str, float],
    report: LoadReport,
) -> None:
    """Record driven wheels that can't touch the ground, or have no friction.

    Args:
        description: The robot.
        bases: What its controllers drive.
        friction: Friction coefficients that links state.
        report: Where they are recorded.
    """
    root = ET.fromstring(description.urdf)  # noqa: S314  our own text.
    solid = {
        link.get("name", "")
        for link in root.iterfind("link")
        if link.find("collision") is not None
    }

    def add(what: str, done: str, where: str) -> None:
        report.add("error", "invalid", what, done, where=where, file=description.file)

    for joint in dict.fromkeys(joint for base in bases for joint in base.driven):
        links = wheel_links(description, joint)
        touching = [link for link in links if link in solid]
        if not touching:
            add(
                "a driven wheel without a collision shape",
                "it doesn't touch the ground; expected <collision> in link "
                f"{' or '.join(map(repr, links))}",
                f"joint {joint!r}",
            )
        for link in touching:
            if friction.get(link) == 0.0:
                add(
                    "a driven wheel without friction, <mu1> is 0",
                    "it spins and drives nothing; expected more than 0, such as 1",
                    f"link {link!r}",
                )
