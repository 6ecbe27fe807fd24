"""One controller manager of a YAML file, and the controllers that it loads."""

import dataclasses as dc
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

from arm_drake.description.controller_manager_parameters import (
    CONTROLLER_KEYS,
    MANAGER,
    is_managers,
    load_manager_parameters,
    report_foreign,
    texts_of,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.parameters import Parameter
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.description.ros_parameters import ParameterReader, Section
from arm_drake.errors import PackageError, ParameterError, suggest


@dc.dataclass(frozen=True)
class ControllerConfig:
    """A controller as its YAML configures it."""

    name: str

    # ros2_control type, such as "forward_command_controller/ForwardCommandController".
    type: str

    # Its parameters by dotted name, without those that the manager reads.
    parameters: dict[str, Parameter]

    # Where its type is given.
    file: Path
    line: int

    # Controllers to activate when an update of this one fails.
    fallback_controllers: tuple[str, ...] = ()


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


class ManagedControllers:
    """What a controller manager is told: its parameters, its controllers by name."""

    def __init__(
        self,
        namespace: str,
        nodes: Nodes,
        reader: ParameterReader,
        packages: PackageFinder | None,
        report: LoadReport,
    ) -> None:
        """Create it from what reaches its node.

        Args:
            namespace: Its name space.
            nodes: The sections of all nodes.
            reader: What reads further files.
            packages: What resolves their names.
            report: Where what has no effect is recorded.

        Raises:
            ParameterError: If a parameter can't be used.
        """
        self.namespace = namespace
        self.node = f"{namespace}/{MANAGER}".lstrip("/")
        self.parameters = nodes.parameters(namespace, MANAGER)
        self.files: list[Path] = []
        self._nodes = nodes
        self._reader = reader
        self._packages = packages
        self._report = report
        self.settings = load_manager_parameters(self.parameters, self.node, report)
        groups = (key.partition(".") for key in self.parameters)
        listed = [group for group, _, rest in groups if rest in CONTROLLER_KEYS]
        self._names = tuple(dict.fromkeys(listed + nodes.typed(namespace)))
        loaded = {name: self._load(name) for name in self._names}
        self.controllers = {n: c for n, c in loaded.items() if c is not None}
        self._report_foreign()

    @property
    def section(self) -> Section:
        """The first section that names it."""
        return next(s for s in self._nodes.sections if self._is_named_by(s))

    def _is_named_by(self, section: Section) -> bool:
        return section.name == MANAGER and self._nodes.is_reached(
            section, self.namespace, MANAGER
        )

    def _report_foreign(self) -> None:
        own = merge(s for s in self._nodes.sections if self._is_named_by(s))
        # A wildcard section is for all nodes; only its lists of controllers aren't.
        own |= {
            key: parameter
            for key, parameter in self.parameters.items()
            if key.partition(".")[0] in self._names
        }
        report_foreign(own, self.node, self._names, self._report)

    def _load(self, name: str) -> ControllerConfig | None:
        own = self._nodes.parameters(self.namespace, name)
        own |= merge(self._further_sections(name))
        parameters = {k: p for k, p in own.items() if not self._is_own(k, p)}
        type_ = parameters.pop("type", None)
        type_ = self.parameters.get(f"{name}.type", type_)
        if type_ is None:
            members = (p for k, p in self.parameters.items() if _is_below(k, name))
            self._complain(name, next(members), "no 'type' is given", "warning")
            return None
        if not isinstance(type_.value, str):
            raise ParameterError(
                f"expected a controller type, got {type_.value!r}",
                file=type_.file,
                line=type_.line,
                where=f"{name}.type",
            )
        remaps = self.parameters.get(f"{name}.node_options_args")
        if remaps is not None:
            key = f"{name}.node_options_args"
            what = "options of nodes are not simulated"
            self._complain(key, remaps, what, "info", "it has no effect")
        fallback = parameters.pop("fallback_controllers", None)
        fallback = self.parameters.get(f"{name}.fallback_controllers", fallback)
        names = texts_of(fallback, f"{name}.fallback_controllers")
        if fallback is not None and name in names:
            self._complain(name, fallback, "it is its own fallback", "error")
            return None
        return ControllerConfig(
            name, type_.value, parameters, type_.file, type_.line, names
        )

    def _is_own(self, key: str, parameter: Parameter) -> bool:
        """Return whether a controller got a parameter of the manager, by a wildcard."""
        if self.parameters.get(key) is not parameter:
            return False
        return is_managers(key) or key.partition(".")[0] in self._names

    def _further_sections(self, name: str) -> Iterator[Section]:
        """Yield what the files of a controller give it."""
        key = f"{name}.params_file"
        given = self.parameters.get(key)
        for text in texts_of(given, f"{self.node}.{key}"):
            assert given is not None
            try:
                path = self._resolve(text, given.file.parent)
                # Unlike that of Path, it takes names that no file can have.
                is_file = os.path.isfile(path)
                problem = "" if is_file else f"no such file: {text!r}"
            except PackageError as error:
                problem = error.problem
            if problem:
                self._complain(key, given, problem, "error", "it is left out")
                continue
            self.files.append(path)
            for section in self._reader.read(path):
                if self._nodes.is_reached(section, self.namespace, name):
                    yield section

    def _resolve(self, text: str, folder: Path) -> Path:
        if self._packages is None:
            return folder / text
        return self._packages.resolve(text, folder)

    def _complain(
        self,
        key: str,
        parameter: Parameter,
        what: str,
        severity: Severity,
        done: str = "it is not spawned",
    ) -> None:
        kinds: dict[Severity, Kind] = {"info": "unsupported", "warning": "missing"}
        self._report.add(
            severity,
            kinds.get(severity, "invalid"),
            what,
            done,
            where=f"{self.node}.{key}",
            file=parameter.file,
            line=parameter.line,
        )


def _is_below(key: str, name: str) -> bool:
    return key.startswith(f"{name}.")
