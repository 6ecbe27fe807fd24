"""Reads a part of a URDF and writes it as Drake gets it."""

import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.inertia import repair_free_base, repair_inertials
from arm_drake.description.joints import extent, read_joint
from arm_drake.description.links import read_links
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import report_unread, write_urdf


def read_and_write(
    body: str, file: Path, *, base: str | None = None
) -> tuple[ET.Element, LoadReport]:
    """Return the URDF that a body becomes, and the report about it.

    Of joints it has what is mended. A base moves freely.
    """
    root, report = ET.XML(f'<robot name="r">{body}</robot>'), LoadReport()
    joints = [read_joint(each, file, report) for each in root.iterfind("joint")]
    report = LoadReport(entry for entry in report if entry.kind == "repair")
    report_unread(root, file, report)
    packages, length = PackageFinder(file), extent(joints)
    links = read_links(root, file, packages, report, extent=length)
    links = repair_inertials(links, joints, report, file)
    if base is not None:
        links = repair_free_base(links, joints, base, report, file)
    return ET.XML(write_urdf("r", links, joints)), report
