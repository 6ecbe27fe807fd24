"""Controllers YAML to a ControllerManagerConfig.

Launch files decide about name spaces and spawn the controllers. Without them, every
name space is taken, and every controller that has a type.
"""

import dataclasses as dc
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.controller_manager import (
    ControllerConfig,
    ManagedControllers,
)
from arm_drake.description.controller_manager_nodes import PLUGIN_NODES, Nodes
from arm_drake.description.controller_manager_parameters import (
    DEFAULT_UPDATE_RATE,
    MANAGER,
    MAX_UPDATE_RATE,
    ControllerManagerParameters,
    HardwareComponentsInitialState,
)
from arm_drake.description.given import Parameters
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import ParameterReader, Section

__all__ = [
    "DEFAULT_UPDATE_RATE",
    "MANAGER",
    "MAX_UPDATE_RATE",
    "ControllerConfig",
    "ControllerManagerConfig",
    "HardwareComponentsInitialState",
    "load_controllers",
]


@dc.dataclass(frozen=True)
class ControllerManagerConfig:
    """A controller manager and its controllers, in the order of the manager's list."""

    # Rate of the read-update-write loop [Hz].
    update_rate: int = DEFAULT_UPDATE_RATE

    controllers: tuple[ControllerConfig, ...] = ()

    # Files that were read.
    files: tuple[Path, ...] = ()

    # Whether commands are kept within the joints' limits. None: as the distribution
    # does by default.
    enforce_command_limits: bool | None = None

    hardware_components_initial_state: HardwareComponentsInitialState = dc.field(
        default_factory=HardwareComponentsInitialState
    )

    # Parameters of the nodes of Gazebo's plugins, by the nodes' names.
    plugin_nodes: Mapping[str, Parameters] = dc.field(default_factory=dict)


def load_controllers(
    files: Sequence[Path],
    variables: Mapping[str, str],
    report: LoadReport,
    *,
    packages: PackageFinder | None = None,
    manager: str = MANAGER,
    plugins: Collection[str] = (),
) -> ControllerManagerConfig:
    """Return what controllers YAML files configure.

    Args:
        files: YAML files; a later one overrides an earlier one.
        variables: Values of `$(var NAME)`.
        report: Where what is not taken as written is recorded.
        packages: What resolves `$(find-pkg-share PACKAGE)` and `package://`.
        manager: Name of the controller manager's node, where it has one of its own.
        plugins: Names of nodes of Gazebo's plugins beside the usual ones.

    Raises:
        ParameterError: If a file can't be used.
    """
    reader = ParameterReader(variables, report, packages)
    sections = [section for file in files for section in reader.read(file)]
    if not any(section.name == MANAGER for section in sections):
        sections = [_renamed(section, manager) for section in sections]
    namespaces = _namespaces(sections)
    nodes = Nodes(sections, namespaces)
    managers = [
        ManagedControllers(ns, nodes, reader, packages, report) for ns in namespaces
    ]
    controllers = _named_apart(managers, report)
    _report_several(managers, report)
    if files and all("update_rate" not in m.parameters for m in managers):
        report.add(
            "info",
            "missing",
            f"{MANAGER}.update_rate is not given",
            f"{DEFAULT_UPDATE_RATE} Hz is used",
            file=files[0],
        )
    if files and not controllers:
        report.add(
            "warning",
            "missing",
            "no controller is configured",
            "no controller runs",
            file=files[0],
        )
    for name in reader.substitutions.unused:
        report.add(
            "warning",
            "ignored",
            f"no controllers YAML uses the variable {name!r}",
            "it has no effect",
        )
    plugin_nodes = {
        name: nodes.plugin_parameters(name, report)
        for name in dict.fromkeys((*PLUGIN_NODES, *plugins))
    }
    names = [name for manager in managers for name in manager.controllers]
    nodes.report_unused((*names, MANAGER), report)
    further = [file for manager in managers for file in manager.files]
    config = ControllerManagerConfig(
        update_rate=_first_given("update_rate", managers),
        controllers=tuple(controllers),
        files=tuple(dict.fromkeys((*files, *further))),
        enforce_command_limits=_first_given("enforce_command_limits", managers),
        hardware_components_initial_state=_together(m.settings for m in managers),
        plugin_nodes={name: given for name, given in plugin_nodes.items() if given},
    )
    return config


def _renamed(section: Section, manager: str) -> Section:
    """Return a section of the manager under the manager's usual name."""
    if section.name != manager:
        return section
    return dc.replace(section, node=f"{section.namespace}/{MANAGER}")


def _namespaces(sections: Iterable[Section]) -> list[str]:
    """Return the name spaces of the controller managers, one at least."""
    named = (s.namespace for s in sections if s.name == MANAGER)
    return list(dict.fromkeys(ns for ns in named if "*" not in ns)) or [""]


def _named_apart(
    managers: Sequence[ManagedControllers], report: LoadReport
) -> list[ControllerConfig]:
    """Return the controllers of all managers; equal names get their name space."""
    counts = Counter(name for manager in managers for name in manager.controllers)
    controllers: dict[str, ControllerConfig] = {}
    for manager in managers:
        prefix = manager.namespace.strip("/").replace("/", "_")
        names = {
            name: f"{prefix}_{name}" if prefix and counts[name] > 1 else name
            for name in manager.controllers
        }
        for name, controller in manager.controllers.items():
            new = names[name]
            while new in controllers or (new != name and new in counts):
                new += "_"
            if new != name:
                report.add(
                    "warning",
                    "repair",
                    f"several controller managers have a controller {name!r}",
                    f"this one is named {new!r}",
                    where=f"{manager.node}.{name}",
                    file=controller.file,
                    line=controller.line,
                )
            fallback = tuple(names.get(n, n) for n in controller.fallback_controllers)
            controllers[new] = dc.replace(
                controller, name=new, fallback_controllers=fallback
            )
    return list(controllers.values())


def _report_several(managers: Sequence[ManagedControllers], report: LoadReport) -> None:
    first = managers[0]
    for manager in managers[1:]:
        place = manager.section
        report.add(
            "warning",
            "repair",
            f"a further controller manager beside {first.node!r}",
            f"its controllers run under {first.node!r}",
            where=manager.node,
            file=place.file,
            line=place.line,
        )
        for name in ("update_rate", "enforce_command_limits"):
            asked, used = getattr(manager.settings, name), _first_given(name, managers)
            parameter = manager.parameters.get(name)
            if asked != used and parameter is not None:
                report.add(
                    "warning",
                    "ignored",
                    f"{asked} differs from {used} of another controller manager",
                    f"{used} is used",
                    where=f"{manager.node}.{name}",
                    file=parameter.file,
                    line=parameter.line,
                )


def _first_given(name: str, managers: Sequence[ManagedControllers]) -> Any:
    """Return a parameter of the first manager that it is given to, or its default."""
    given = (m.settings for m in managers if name in m.parameters)
    return getattr(next(given, managers[0].settings), name)


def _together(
    settings: Iterable[ControllerManagerParameters],
) -> HardwareComponentsInitialState:
    """Return the initial states that all managers ask for."""
    states = [one.hardware_components_initial_state for one in settings]
    return HardwareComponentsInitialState(
        *(
            tuple(dict.fromkeys(n for state in states for n in getattr(state, f.name)))
            for f in dc.fields(HardwareComponentsInitialState)
        )
    )
