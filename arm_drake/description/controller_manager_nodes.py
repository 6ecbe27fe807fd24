"""Which sections of parameter files reach which nodes."""

from collections.abc import Collection, Iterable, Sequence

from arm_drake.description.controller_manager_parameters import MANAGER
from arm_drake.description.given import Parameter
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import Section
from arm_drake.errors import suggest

# Nodes of Gazebo's plugins, in Gazebo Classic (by its usual name) and in Gazebo Sim.
PLUGIN_NODES = ("gazebo_ros2_control", "gz_ros_control")

# What these nodes read, some with further names below them.
PLUGIN_PARAMETERS = ("hold_joints", "pid_gains", "position_proportional_gain")

# What every node takes, and has no meaning here.
_OF_ALL_NODES = ("use_sim_time", "qos_overrides")


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

    def plugin_parameters(self, name: str, report: LoadReport) -> dict[str, Parameter]:
        """Return the parameters of a plugin's node, those of all nodes included.

        Args:
            name: Name of the node. Of several name spaces, the first one's win.
            report: Where those in its own sections are recorded that it doesn't read.
        """
        given: dict[str, Parameter] = {}
        for namespace in reversed(self._namespaces):
            given |= self.parameters(namespace, name)
        for section in self.sections:
            keys = section.parameters if section.name == name else ()
            for key in keys:
                if key.partition(".")[0] in (*PLUGIN_PARAMETERS, *_OF_ALL_NODES):
                    continue
                report.add(
                    "warning",
                    "ignored",
                    f"unknown parameter; {suggest(key, PLUGIN_PARAMETERS)}",
                    "it has no effect",
                    where=f"{section.node.lstrip('/')}.{key}",
                    file=section.file,
                    line=section.parameters[key].line,
                )
        return given

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
            heads = {key.partition(".")[0] for key in section.parameters}
            sort, known = "controller", names
            if not heads.isdisjoint(PLUGIN_PARAMETERS):
                sort, known = "node", PLUGIN_NODES
            report.add(
                "warning",
                "ignored",
                f"no {sort} of this name; {suggest(section.node.strip('/'), known)}",
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
