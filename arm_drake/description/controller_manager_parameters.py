"""The controller manager's own parameters."""

import dataclasses as dc
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from arm_drake.description.parameters import Parameter, Parameters, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import Section
from arm_drake.errors import ParameterError, suggest

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
_SHUTDOWN = "hardware_components_initial_state.shutdown_on_initial_state_failure"

_NO_EFFECT = "it has no effect"


@dc.dataclass(frozen=True)
class HardwareComponentsInitialState:
    """In which state the blocks of `<ros2_control>` start, by their names."""

    # Those left unconfigured.
    unconfigured: tuple[str, ...] = ()

    # Those configured but not activated.
    inactive: tuple[str, ...] = ()

    # The only ones activated, all others staying unconfigured, as in Humble's
    # activate_components_on_start. Empty: all that are not named above.
    active: tuple[str, ...] = ()


@dc.dataclass(frozen=True)
class ControllerManagerParameters:
    """The parameters of a controller manager that have an effect."""

    # Rate of the read-update-write loop [Hz].
    update_rate: int = DEFAULT_UPDATE_RATE

    # Whether commands are kept within the joints' limits. None: as the distribution
    # does by default.
    enforce_command_limits: bool | None = None

    hardware_components_initial_state: HardwareComponentsInitialState = (
        HardwareComponentsInitialState()
    )


@dc.dataclass(frozen=True)
class _InitialState:
    unconfigured: tuple[str, ...] = ()
    inactive: tuple[str, ...] = ()
    shutdown_on_initial_state_failure: bool = False


@dc.dataclass(frozen=True)
class _Schema:
    update_rate: int = DEFAULT_UPDATE_RATE
    enforce_command_limits: bool = True
    hardware_components_initial_state: _InitialState = _InitialState()
    activate_components_on_start: tuple[str, ...] = ()
    configure_components_on_start: tuple[str, ...] = ()


_KNOWN = tuple(field.name for field in dc.fields(_Schema))


def is_managers(key: str) -> bool:
    """Return whether a parameter is the manager's, wherever it is given."""
    return key.partition(".")[0] in (*_KNOWN, *_NEEDLESS, *_NOT_SIMULATED)


def load_manager_parameters(
    parameters: Parameters, node: str, report: LoadReport
) -> ControllerManagerParameters:
    """Return the parameters of a controller manager."""
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
    return ControllerManagerParameters(
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
        if group in controllers:
            what = f"{listed}: a controller's parameters stand in its own section"
        elif "" not in members:
            what = f"no controller, for it has no 'type', only {listed}"
        else:
            what = f"unknown parameter; {suggest(group, _KNOWN)}"
        where, first = f"{node}.{group}", next(iter(members.values()))
        report.add("info", "ignored", what, _NO_EFFECT, where=where, at=first)


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
    """Which sections reach which node."""

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
