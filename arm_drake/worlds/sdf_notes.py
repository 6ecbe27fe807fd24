"""Lines of the load report about SDF files."""

import xml.etree.ElementTree as ET
from collections.abc import Collection

from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.worlds.sdf_files import SdfFile, name_of


class Notes:
    """What was not taken as written of a world and its models."""

    def __init__(self) -> None:
        """Create it, with an empty report."""
        self.report = LoadReport()

    def add(
        self,
        severity: Severity,
        kind: Kind,
        what: str,
        done: str,
        *,
        file: SdfFile,
        element: ET.Element,
        where: str = "",
    ) -> None:
        """Add a line about an element.

        Args:
            severity: As in a load report.
            kind: As in a load report.
            what: What is the matter.
            done: What was done about it.
            file: File that it is in.
            element: The element.
            where: Place in the file, such as "model 'table'".
        """
        line = file.lines.get(element)
        self.report.add(
            severity, kind, what, done, where=where, file=file.path, line=line
        )

    def remove(
        self,
        parent: ET.Element,
        tags: Collection[str],
        *,
        file: SdfFile,
        where: str,
    ) -> None:
        """Remove children that have no effect here, with a line for each."""
        for child in [child for child in parent if child.tag in tags]:
            parent.remove(child)
            what = child.get("filename") or child.get("name") or ""
            self.add(
                "info" if child.tag in ("light", "self_collide") else "warning",
                "ignored",
                f"<{child.tag}> {what!r}" if what else f"<{child.tag}>",
                "it has no effect",
                file=file,
                element=child,
                where=where,
            )

    @staticmethod
    def place(parent: str, element: ET.Element) -> str:
        """Return the place of an element that is inside of another place."""
        return ", ".join(filter(None, (parent, name_of(element))))
