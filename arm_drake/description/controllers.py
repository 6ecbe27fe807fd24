"""ControllerManagerConfig: what controllers YAML files configure.

The controller manager's own parameters come first. Launch files decide about name
spaces and spawn the controllers. Without them, every name space is taken, and every
controller that has a type.
"""

import dataclasses as dc
import os
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.packages import PackageFinder
from arm_drake.description.parameters import Parameter, Parameters, load_parameters
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.description.ros_parameters import ParameterReader, Section
from arm_drake.errors import PackageError, ParameterError, find_close, suggest
from arm_drake.importing import dataclass

DEFAULT_UPDATE_RATE = 100  # Hz
MAX_UPDATE_RATE = 10_000  # Hz
MANAGER = "controller_manager"

# They tell the manager about a controller, below its name.
CONTROLLER_KEYS = (
    "type",
    "params_file",
    "fallback_controllers",
    "node_options_args",
)

# They mean nothing without threads, clocks and hardware of their own.
_NEEDLESS = (
    "cpu_affinity",
    "diagnostics",
    "hardware_synchronization",
    "lock_memory",
    "overruns",
    "robot_description",
    "thread_priority",
    "use_sim_time",
)

# They change what a controller manager does, but not yet this one.
_NOT_SIMULATED = ("defaults", "handle_exceptions")

# Lists of a manager's parameters with hardware that isn't active, and its states.
_INITIAL_STATES = {
    "unconfigured": "unconfigured",
    "inactive": "inactive",
    "configure_components_on_start": "inactive",
}

_SHUTDOWN = "hardware_components_initial_state.shutdown_on_initial_state_failure"

_NO_EFFECT = "it has no effect"


@dataclass(frozen=True)
class HardwareComponentsInitialState:
    """In which state the blocks of `<ros2_control>` start, by their names."""

    # Those left unconfigured.
    unconfigured: tuple[str, ...] = ()

    # Those configured but not activated.
    inactive: tuple[str, ...] = ()

    # The only ones activated, all others staying unconfigured, as in Humble's
    # activate_components_on_start. Empty: all that are not named above.
    active: tuple[str, ...] = ()


@dataclass(frozen=True)
class ControllerConfig:
    """A controller as its YAML configures it."""

    name: str

    # ros2_control type, such as "forward_command_controller/ForwardCommandController".
    # What is no type at all is kept as text.
    type: str

    # Its parameters by dotted name, without those that the manager reads.
    parameters: dict[str, Parameter]

    # Where its type is given.
    file: Path
    line: int

    # Controllers to activate when an update of this one fails.
    fallback_controllers: tuple[str, ...] = ()

    # Why it can't be loaded, which the report says too; empty if it can.
    problem: str = ""

    # Tags of one kind of Gazebo's plugins that it stands for, if it isn't of a YAML.
    plugins: tuple[Any, ...] = ()

    # The joints that these move.
    plugin_joints: frozenset[str] = frozenset()


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class _InitialState:
    """Parameters below `hardware_components_initial_state`."""

    unconfigured: tuple[str, ...] = ()
    inactive: tuple[str, ...] = ()
    shutdown_on_initial_state_failure: bool = False


@dataclass(frozen=True)
class _Schema:
    """Parameters of a controller manager."""

    update_rate: int = DEFAULT_UPDATE_RATE
    enforce_command_limits: bool = True
    hardware_components_initial_state: _InitialState = _InitialState()
    activate_components_on_start: tuple[str, ...] = ()
    configure_components_on_start: tuple[str, ...] = ()


_KNOWN = tuple(field.name for field in dc.fields(_Schema))


def is_managers(key: str) -> bool:
    """Return whether a parameter is the manager's, wherever it is set."""
    return key.partition(".")[0] in (*_KNOWN, *_NEEDLESS, *_NOT_SIMULATED)


def load_manager_parameters(
    parameters: Parameters, node: str, report: LoadReport
) -> ControllerManagerConfig:
    """Return what the parameters of a controller manager configure of it."""
    rate, where = parameters.get("update_rate"), f"{node}.update_rate"
    if rate is not None and isinstance(rate.value, float) and rate.value.is_integer():
        what = f"{rate.value} is a double; ros2_control refuses it for an integer"
        rate = dc.replace(rate, value=int(rate.value))
        report.add("info", "repair", what, "taken as an integer", where=where, at=rate)
        parameters = {**parameters, "update_rate": rate}
    if rate is not None and (
        type(rate.value) is not int or not 0 < rate.value <= MAX_UPDATE_RATE
    ):
        expected = f"expected an integer from 1 to {MAX_UPDATE_RATE} [Hz]"
        problem = f"{expected}, got {rate.value!r}"
        raise ParameterError(problem, where=where, at=rate)
    own = {k: p for k, p in parameters.items() if k.partition(".")[0] in _KNOWN}
    loaded = load_parameters(_Schema, own, node, Path(), report)
    for key, parameter in parameters.items():
        if key.partition(".")[0] in _NOT_SIMULATED or key == _SHUTDOWN:
            what, where = "it is not simulated", f"{node}.{key}"
            report.add(
                "info", "unsupported", what, _NO_EFFECT, where=where, at=parameter
            )
    for old, new in (
        ("activate_components_on_start", "active"),
        ("configure_components_on_start", "inactive"),
    ):
        if old in parameters:
            what, where = "this is Humble's name", f"{node}.{old}"
            done = f"taken as the {new} ones of hardware_components_initial_state"
            report.add("info", "repair", what, done, where=where, at=parameters[old])
    states = loaded.hardware_components_initial_state
    return ControllerManagerConfig(
        update_rate=loaded.update_rate,
        enforce_command_limits=(
            loaded.enforce_command_limits
            if "enforce_command_limits" in parameters
            else None
        ),
        hardware_components_initial_state=HardwareComponentsInitialState(
            states.unconfigured,
            (*states.inactive, *loaded.configure_components_on_start),
            loaded.activate_components_on_start,
        ),
    )


def set_hardware_states(data: Any, states: Mapping[str, str]) -> Any:
    """Return parameters of a file in which hardware starts in other states, by name."""
    if not isinstance(data, Mapping):
        return data
    found = {key: set_hardware_states(value, states) for key, value in data.items()}
    configured: dict[str, list[str]] = {}
    for key, value in data.items():
        stem, dot, last = str(key).rpartition(".")
        if not _is_list_of_names(value) or not value:
            continue  # What is wrong with it is told where it is loaded.
        if last == "activate_components_on_start":
            active = [name for name, state in states.items() if state == "active"]
            found[key] = list(dict.fromkeys([*value, *active]))
        elif own := _INITIAL_STATES.get(last):
            moved = [n for n in value if states.get(n) == "inactive" != own]
            gone = [*moved, *(n for n in value if states.get(n) == "active")]
            found[key] = [name for name in value if name not in gone]
            if moved:
                configured[f"{stem}{dot}inactive"] = moved
    for key, names in configured.items():
        others = found.get(key) or []
        if _is_list_of_names(others):
            found[key] = list(dict.fromkeys([*others, *names]))
    return found


def _is_list_of_names(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)


def report_foreign(
    parameters: Parameters, node: str, controllers: Collection[str], report: LoadReport
) -> None:
    """Report what in a manager's section is neither its nor a controller's."""
    groups: dict[str, dict[str, Parameter]] = {}
    for key, parameter in parameters.items():
        group, _, rest = key.partition(".")
        if not is_managers(key) and not (
            group in controllers and rest in CONTROLLER_KEYS
        ):
            groups.setdefault(group, {})[rest] = parameter
    for group, members in groups.items():
        listed = ", ".join(sorted(members))
        severity: Severity = "info"
        if group in controllers:
            # They are meant, as an unknown parameter is.
            severity = "warning"
            what = f"{listed}: a controller's parameters stand in its own section"
        elif "" not in members:
            what = f"no controller, for it has no 'type', only {listed}"
        else:
            what = f"unknown parameter; {suggest(group, _KNOWN)}"
        where, first = f"{node}.{group}", next(iter(members.values()))
        report.add(severity, "ignored", what, _NO_EFFECT, where=where, at=first)


def texts_of(parameter: Parameter | None, where: str) -> tuple[str, ...]:
    """Return a parameter that is a list of texts; one text alone is a list of one."""
    if parameter is None:
        return ()
    value = parameter.value
    values = [value] if isinstance(value, str) else value
    if not isinstance(values, list) or not all(isinstance(v, str) for v in values):
        problem = f"expected a text or a list of texts, got {value!r}"
        raise ParameterError(problem, where=where, at=parameter)
    return tuple(values)


# Nodes of Gazebo's plugins, in Gazebo Classic (by its usual name) and in Gazebo Sim.
PLUGIN_NODES = ("gazebo_ros2_control", "gz_ros_control")

# What these nodes read, some with further names below them.
PLUGIN_PARAMETERS = ("hold_joints", "pid_gains", "position_proportional_gain")

# What every node takes, and has no meaning here.
_OF_ALL_NODES = ("use_sim_time", "qos_overrides")


class Nodes:
    """Parameter sections by the node that they reach."""

    def __init__(self, sections: Sequence[Section], namespaces: Sequence[str]) -> None:
        """Create it."""
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
        """Return the parameters of a plugin's node, those of all nodes included."""
        parameters: dict[str, Parameter] = {}
        for namespace in reversed(self._namespaces):
            parameters |= self.parameters(namespace, name)
        for section in self.sections:
            keys = section.parameters if section.name == name else {}
            for key in keys:
                if key.partition(".")[0] in (*PLUGIN_PARAMETERS, *_OF_ALL_NODES):
                    continue
                what = f"unknown parameter; {suggest(key, PLUGIN_PARAMETERS)}"
                where, parameter = f"{section.node.lstrip('/')}.{key}", keys[key]
                report.add(
                    "warning", "ignored", what, _NO_EFFECT, where=where, at=parameter
                )
        return parameters

    def has_section(self, name: str) -> bool:
        """Return whether a section is about nodes of a name."""
        return name in self._named

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
        """Report sections that have reached no node."""
        for index, section in enumerate(self.sections):
            if index in self._reached:
                continue
            heads = {key.partition(".")[0] for key in section.parameters}
            sort, known = "controller", names
            if not heads.isdisjoint(PLUGIN_PARAMETERS):
                sort, known = "node", PLUGIN_NODES
            where, done = section.node.lstrip("/"), "the section has no effect"
            hint = suggest(section.node.strip("/"), known)
            what = f"no {sort} of this name; {hint}"
            report.add("warning", "ignored", what, done, where=where, at=section)


def merge(sections: Iterable[Section]) -> dict[str, Parameter]:
    """Return the parameters of sections, of which later ones override earlier ones."""
    merged: dict[str, Parameter] = {}
    for section in sections:
        merged.update(section.parameters)
    return merged


# What becomes of a controller that can't be loaded.
_IDLE = "the controller does not run"


def load_controllers(
    files: Sequence[Path],
    variables: Mapping[str, str],
    report: LoadReport,
    *,
    packages: PackageFinder | None = None,
    manager: str = MANAGER,
    namespace: str = "",
    plugins: Collection[str] = (),
) -> ControllerManagerConfig:
    """Return what controllers YAML files configure; a later one overrides."""
    reader = ParameterReader(variables, report, packages)
    sections = [section for file in files for section in reader.read(file)]
    if not any(section.name == MANAGER for section in sections):
        sections = [_renamed(section, manager) for section in sections]
    namespaces = _namespaces(sections)
    own = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    if own and _has_manager(own, sections, report):
        sections, namespaces = _without_others(sections, own), [own]
    nodes = Nodes(sections, namespaces)
    managers = [
        ManagedControllers(ns, nodes, reader, packages, report) for ns in namespaces
    ]
    controllers = _named_apart(managers, report)
    _report_several(managers, report)
    _report_absent(files, managers, controllers, report)
    for name in reader.substitutions.unused:
        what = f"no controllers YAML uses the variable {name!r}"
        report.add("warning", "ignored", what, "it has no effect")
    plugin_nodes = {
        name: nodes.plugin_parameters(name, report)
        for name in dict.fromkeys((*PLUGIN_NODES, *plugins))
    }
    names = [name for manager in managers for name in manager.controllers]
    nodes.report_unused((*names, MANAGER), report)
    further = [file for manager in managers for file in manager.files]
    return ControllerManagerConfig(
        update_rate=_first_setting("update_rate", managers),
        controllers=tuple(controllers),
        files=tuple(dict.fromkeys((*files, *further))),
        enforce_command_limits=_first_setting("enforce_command_limits", managers),
        hardware_components_initial_state=_merge(m.settings for m in managers),
        plugin_nodes={
            name: parameters for name, parameters in plugin_nodes.items() if parameters
        },
    )


class ManagedControllers:
    """Parameters of a controller manager, and its controllers by name."""

    def __init__(
        self,
        namespace: str,
        nodes: Nodes,
        reader: ParameterReader,
        packages: PackageFinder | None,
        report: LoadReport,
    ) -> None:
        """Create it from what reaches its node."""
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
        listed = [
            group
            for group, _, rest in groups
            if rest in CONTROLLER_KEYS
            or (rest and not is_managers(group) and nodes.has_section(group))
        ]
        self._names = tuple(dict.fromkeys(listed + nodes.typed(namespace)))
        loaded = {name: self._load(name) for name in self._names}
        known = {n: c for n, c in loaded.items() if c is not None}
        self.controllers = {
            n: self._with_fallback(c, [k for k in known if k != n])
            for n, c in known.items()
        }
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
        sections, problem = self._further_sections(name)
        own |= merge(sections)
        parameters = {k: p for k, p in own.items() if not self._is_own(k, p)}
        type_, where = self._choose(name, "type", parameters.pop("type", None))
        if type_ is None:
            self._report_untyped(name)
            return None
        if not isinstance(type_.value, str):
            what = f"expected a controller type, got {type_.value!r}"
            self._note(where, type_, what, "error", _IDLE)
            problem = problem or what
        remaps, where = self._choose(name, "node_options_args", None)
        if remaps is not None:
            what = "options of nodes are not simulated"
            self._note(where, remaps, what, "info", "it has no effect")
        return ControllerConfig(
            name,
            str(type_.value),
            parameters,
            type_.file,
            type_.line,
            problem=problem,
        )

    def _report_untyped(self, name: str) -> None:
        """Report a controller without a type, which a spawner may bring along."""
        start = f"{name}."
        members = {
            key.removeprefix(start): parameter
            for key, parameter in self.parameters.items()
            if key.startswith(start)
        }
        severity: Severity = "warning"
        what, at = "no 'type' is given", next(iter(members.values()))
        if (key := find_close("type", members, 0.6)) is not None:
            severity, what, at = "error", f"{what}, but {key!r}", members[key]
        self._note(f"{self.node}.{name}", at, what, severity, "it is not spawned")

    def _choose(
        self, name: str, key: str, own: Parameter | None
    ) -> tuple[Parameter | None, str]:
        """Return the manager's parameter of a controller, and its full name."""
        parameter = self.parameters.get(f"{name}.{key}")
        if parameter is None:
            return own, f"{name}.{key}"
        return parameter, f"{self.node}.{name}.{key}"

    def _with_fallback(
        self, controller: ControllerConfig, others: Collection[str]
    ) -> ControllerConfig:
        """Return a controller with its fallback controllers, of the other names."""
        name, parameters = controller.name, dict(controller.parameters)
        own = parameters.pop("fallback_controllers", None)
        parameter, where = self._choose(name, "fallback_controllers", own)
        if parameter is None:
            return controller
        names: tuple[str, ...] = ()
        problem = ""
        try:
            names = texts_of(parameter, where)
        except ParameterError as error:
            problem = error.problem
        if name in names:
            problem = "it is its own fallback"
        if problem:
            self._note(where, parameter, problem, "error", _IDLE)
        for other in () if problem else names:
            if other not in others:
                what = f"no controller {other!r}; {suggest(other, others)}"
                self._note(where, parameter, what, "warning", "it is left out")
        return dc.replace(
            controller,
            parameters=parameters,
            fallback_controllers=tuple(n for n in names if n in others),
            problem=controller.problem or problem,
        )

    def _is_own(self, key: str, parameter: Parameter) -> bool:
        """Return whether a controller got a parameter of the manager, by a wildcard."""
        if self.parameters.get(key) is not parameter:
            return False
        return is_managers(key) or key.partition(".")[0] in self._names

    def _further_sections(self, name: str) -> tuple[list[Section], str]:
        """Return what the files of a controller give it, and why it can't be loaded."""
        parameter, where = self._choose(name, "params_file", None)
        sections: list[Section] = []
        if parameter is None:
            return sections, ""
        try:
            texts = texts_of(parameter, where)
        except ParameterError as error:
            self._note(where, parameter, error.problem, "error", "it is ignored")
            return sections, ""
        for text in texts:
            try:
                path = self._resolve(text, parameter.file.parent)
                # Unlike that of Path, it takes names that no file can have.
                is_file = os.path.isfile(path)
                problem = "" if is_file else f"no such file: {text!r}"
            except PackageError as error:
                problem = error.problem
            if problem:
                self._note(where, parameter, problem, "error", "it is left out")
                continue
            self.files.append(path)
            try:
                read = self._reader.read(path)
            except ParameterError as error:
                self._note(where, parameter, str(error), "error", _IDLE)
                return sections, str(error)
            sections += [
                section
                for section in read
                if self._nodes.is_reached(section, self.namespace, name)
            ]
        return sections, ""

    def _resolve(self, text: str, folder: Path) -> Path:
        if self._packages is None:
            return folder / text
        return self._packages.resolve(text, folder)

    def _note(
        self, where: str, parameter: Parameter, what: str, severity: Severity, done: str
    ) -> None:
        kinds: dict[Severity, Kind] = {"info": "unsupported", "warning": "missing"}
        kind = kinds.get(severity, "invalid")
        self._report.add(severity, kind, what, done, where=where, at=parameter)


def _has_manager(
    namespace: str, sections: Iterable[Section], report: LoadReport
) -> bool:
    """Return whether a name space has a manager; it may be one without any."""
    managers = [section for section in sections if section.name == MANAGER]
    if not managers:
        return False
    if any(not s.namespace or s.matches(f"{namespace}/{MANAGER}") for s in managers):
        return True
    hint = suggest(namespace, [section.namespace for section in managers])
    what, done = f"no {MANAGER} of name space {namespace!r}; {hint}", "all are taken"
    report.add("warning", "missing", what, done, at=managers[0])
    return False


def _without_others(sections: list[Section], namespace: str) -> list[Section]:
    """Leave out what is for nodes of other name spaces.

    Robots may share a file. What has no name space is taken for any, unless a manager
    without one stands beside that of the name space: then it is for another robot.
    """
    managers = [section for section in sections if section.name == MANAGER]
    is_any = not (
        any(not each.namespace for each in managers)
        and any(each.matches(f"{namespace}/{MANAGER}") for each in managers)
    )
    return [
        section
        for section in sections
        if (is_any and not section.namespace)
        or section.matches(f"{namespace}/{section.name.replace('*', '_')}")
    ]


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
                what = f"several controller managers have a controller {name!r}"
                done, where = f"this one is named {new!r}", f"{manager.node}.{name}"
                report.add("warning", "repair", what, done, where=where, at=controller)
            fallback = tuple(names.get(n, n) for n in controller.fallback_controllers)
            controllers[new] = dc.replace(
                controller, name=new, fallback_controllers=fallback
            )
    return list(controllers.values())


def _report_absent(
    files: Sequence[Path],
    managers: Sequence[ManagedControllers],
    controllers: Collection[ControllerConfig],
    report: LoadReport,
) -> None:
    """Record an update rate and controllers that files don't give."""
    if files and all("update_rate" not in m.parameters for m in managers):
        what = f"{MANAGER}.update_rate is not given"
        done = f"{DEFAULT_UPDATE_RATE} Hz is used"
        report.add("info", "missing", what, done, file=files[0])
    if files and not controllers:
        what, done = "no controller is configured", "no controller runs"
        report.add("warning", "missing", what, done, file=files[0])


def _report_several(managers: Sequence[ManagedControllers], report: LoadReport) -> None:
    first = managers[0]
    for manager in managers[1:]:
        what = f"a further controller manager beside {first.node!r}"
        done, where = f"its controllers run under {first.node!r}", manager.node
        report.add("warning", "repair", what, done, where=where, at=manager.section)
        for name in ("update_rate", "enforce_command_limits"):
            setting = getattr(manager.settings, name)
            used = _first_setting(name, managers)
            parameter = manager.parameters.get(name)
            if setting != used and parameter is not None:
                what = f"{setting} differs from {used} of another controller manager"
                done, where = f"{used} is used", f"{manager.node}.{name}"
                report.add("warning", "ignored", what, done, where=where, at=parameter)


def _first_setting(name: str, managers: Sequence[ManagedControllers]) -> Any:
    """Return a parameter of the first manager that sets it, or its default."""
    settings = (m.settings for m in managers if name in m.parameters)
    return getattr(next(settings, managers[0].settings), name)


def _merge(
    settings: Iterable[ControllerManagerConfig],
) -> HardwareComponentsInitialState:
    """Return the initial states of all managers."""
    states = [one.hardware_components_initial_state for one in settings]
    return HardwareComponentsInitialState(
        *(
            tuple(dict.fromkeys(n for state in states for n in getattr(state, f.name)))
            for f in dc.fields(HardwareComponentsInitialState)
        )
    )
