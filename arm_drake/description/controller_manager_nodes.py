"""Which sections of parameter files reach which nodes."""

from collections.abc import Collection, Iterable, Sequence

from arm_drake.description.controller_manager_parameters import MANAGER
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import Section
from arm_drake.errors import suggest


class Nodes:
    """Which sections reach which node."""

    def __init__(self, sections: Sequence[Section], namespaces: Sequence[str]) -> None:
        """Create it.

        Args:
            sections: Sections of all files.
            namespaces: Name spaces of the controller managers.
        """
        self.sections = tuple(sections)
        self._namespaces = tuple(namespaces)
        self._reached: set[int] = set()
        self._named: dict[str, list[int]] = {}
        for index, section in enumerate(self.sections):
            name = "*" if "*" in section.name else section.name
            self._named.setdefault(name, []).append(index)

    def is_reached(self, section: Section, namespace: str, name: str) -> bool:
        """Return whether a node gets a section's parameters.

        A launch file may add name spaces: one that no manager has is taken for any.
        """
        if section.matches(f"{namespace}/{name}"):
            return True
        is_free = "*" not in section.node and section.namespace not in self._namespaces
        return section.name == name and (is_free or len(self._namespaces) == 1)

    def parameters(self, namespace: str, name: str) -> dict[str, Parameter]:
        """Return the parameters of a node."""
        named = {*self._named.get(name, ()), *self._named.get("*", ())}
        reaching = [
            index
            for index in sorted(named)
            if self.is_reached(self.sections[index], namespace, name)
        ]
        self._reached |= set(reaching)
        return merge(self.sections[index] for index in reaching)

    def typed(self, namespace: str) -> list[str]:
        """Return the names of the nodes that sections of their own give a type."""
        is_first = namespace == self._namespaces[0]
        return [
            section.name
            for section in self.sections
            if "type" in section.parameters
            and section.name not in (MANAGER, "*", "**")
            and (
                section.matches(f"{namespace}/{section.name}")
                or (is_first and self.is_reached(section, namespace, section.name))
            )
        ]

    def report_unused(self, names: Collection[str], report: LoadReport) -> None:
        """Report sections that have reached no node.

        Args:
            names: Names of the nodes.
            report: Where they are recorded.
        """
        for index, section in enumerate(self.sections):
            if index in self._reached:
                continue
            report.add(
                "warning",
                "ignored",
                "no controller of this name; "
                f"{suggest(section.node.strip('/'), names)}",
                "the section has no effect",
                where=section.node.lstrip("/"),
                file=section.file,
                line=section.line,
            )


def merge(sections: Iterable[Section]) -> dict[str, Parameter]:
    """Return the parameters of sections, of which later ones override earlier ones."""
    merged: dict[str, Parameter] = {}
    for section in sections:
        merged.update(section.parameters)
    return merged
