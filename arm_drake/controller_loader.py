"""One controller from its configuration: its system, or a line in the report."""

import difflib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from arm_drake.control.drive_commands import is_outdone
from arm_drake.control.update_schedule import effective_rate
from arm_drake.controllers import CONTROLLER_TYPES, find_controller_type
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.description.controllers import (
    ControllerConfig,
    ControllerManagerConfig,
)
from arm_drake.description.parameters import load_parameters
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import ParameterError, suggest
from arm_drake.gain_report import report_gains
from arm_drake.loaded_controllers import LoadedController, controller_infos
from arm_drake.surroundings import Surroundings
from arm_drake.switching import find_cycle


def _listed(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def _similar_type(name: str) -> str:
    """Return the end of a message about an unknown type; most are vendors' own."""
    known = [other for other, row in CONTROLLER_TYPES.items() if not row.runs_as]
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
    close += [other for other in known if other.rpartition("/")[2] == name]
    return f"; did you mean {close[0]!r}?" if close else ""


class ControllerLoader:
    """Loads controllers of one robot and reports what doesn't work."""

    def __init__(
        self,
        config: ControllerManagerConfig,
        surroundings: Surroundings,
        report: LoadReport,
        period: float | None,
        distro: str,
    ) -> None:
        """Create it.

        Args:
            config: What the YAML configures.
            surroundings: What the robot offers.
            report: Where what doesn't work is recorded.
            period: Period of the manager in Drake's time [s].
            distro: Distribution whose parameters and defaults hold.
        """
        self._distro = distro
        self._config = config
        self._surroundings = surroundings
        self._report = report
        self._period = 1.0 / config.update_rate if period is None else period

    def load_all(self) -> dict[str, ControllerInterface | None]:
        """Return the systems of all controllers; none commands itself by a detour."""
        configs = {c.name: c for c in self._config.controllers}
        systems = {n: None if c.problem else self.load(c) for n, c in configs.items()}
        while True:
            loaded = [
                LoadedController(name, "", "inactive", system)
                for name, system in systems.items()
                if system is not None
            ]
            problem = find_cycle(controller_infos(loaded))
            if not problem:
                return systems
            # Drake has no diagram of a circle, not even of inactive controllers.
            first = next(c.name for c in loaded if repr(c.name) in problem)
            self._reject(configs[first], problem)
            systems[first] = None

    def load(self, controller: ControllerConfig) -> ControllerInterface | None:
        """Return the system of a controller, or None and a line in the report."""
        row = find_controller_type(controller.type)
        if row is None:
            hint = _similar_type(controller.type)
            problem = f"unknown controller type {controller.type!r}{hint}"
            self._reject(controller, problem, kind="unsupported")
            return None
        if row.runs_as:
            what, done = f"controller type {controller.type!r}", f"run as {row.runs_as}"
            self._add(controller, "info", "repair", what, done)
        if row.system is None:
            problem = f"controller type {controller.type!r} is not simulated yet"
            self._reject(controller, problem, kind="unsupported")
        own = dict(controller.parameters)
        try:
            rate = self._take_rate(controller, own)
            node, file, report = controller.name, controller.file, self._report
            parameters: Any = load_parameters(
                row.parameters, own, node, file, report, distro=self._distro
            )
            if row.system is None:
                return None
            params = ControllerInterfaceParams(
                controller_name=controller.name,
                update_rate=rate,
                period=self._period,
                joint_types=self._surroundings.joint_types,
                command_interfaces=frozenset(self._surroundings.command_interfaces),
                state_interfaces=frozenset(self._surroundings.state_interfaces),
                measured=self._surroundings.measured,
                other_types=self._surroundings.other_types,
                distro=self._distro,
                velocity_limits=self._surroundings.velocity_limits,
            )
            system = row.system(parameters, params)
        except ParameterError as error:
            self._reject(controller, error.problem, error)
            return None
        report_gains(controller, parameters, self._report)
        return system

    def _take_rate(self, controller: ControllerConfig, own: dict[str, Any]) -> int:
        """Return the rate at which a controller ticks [Hz]."""
        own.pop("use_sim_time", None)
        asked = own.pop("update_rate", None)
        manager = self._config.update_rate
        if asked is None or asked.value in (0, manager):
            return manager
        if type(asked.value) is not int or asked.value < 0:
            raise ParameterError(
                f"expected an integer from 1 to {manager} Hz, got {asked.value!r}",
                file=asked.file,
                line=asked.line,
                where=f"{controller.name}.update_rate",
            )
        rate, done = effective_rate(asked.value, manager, distro=self._distro), ""
        if asked.value > manager:
            done = f"{manager} Hz is used"
            what = f"update_rate {asked.value} is above the manager's {manager}"
        elif manager % asked.value:
            what = f"update_rate {asked.value} does not divide the manager's {manager}"
            done = f"{rate} Hz is used"
            if rate == asked.value:
                done = "it ticks in the nearest cycles"
        if done:
            self._report.add(
                "warning",
                "repair",
                what,
                done,
                where=f"{controller.name}.update_rate",
                file=asked.file,
                line=asked.line,
            )
        return rate

    def report_unsimulated(
        self, controller: ControllerConfig, system: ControllerInterface
    ) -> None:
        """Record what a controller reads or commands that the physics doesn't know."""
        there = self._surroundings
        if not there.has_physics:
            return
        lines = []
        read = [
            name
            for name in system.state_interfaces
            if name in there.stored and name not in there.command_interfaces
        ]
        if read:
            what = f"state interfaces aren't simulated: {_listed(read)}"
            lines.append((what, "they stay at their initial values"))
        idle = [
            name
            for name in system.command_interfaces
            if name.rpartition("/")[0] in there.driven
            and is_outdone(name, system.command_interfaces)
        ]
        if idle:
            what = f"beside velocities, {_listed(idle)} are not acted on"
            lines.append((what, "the joints follow their velocities"))
        for what, done in lines:
            self._add(controller, "info", "unsupported", what, done)

    def report_obstacle(
        self,
        controller: ControllerConfig,
        missing: Sequence[str],
        problems: Sequence[str],
    ) -> None:
        """Record why a controller doesn't start."""
        for problem in missing:
            self._reject(controller, problem)
            return
        done = "the controller stays inactive"
        for problem in problems:
            what = problem.removeprefix(f"could not activate {controller.name!r}: ")
            self._add(controller, "warning", "ignored", what, done)

    def find_missing(
        self, system: ControllerInterface, others: Mapping[str, ControllerInterface]
    ) -> tuple[str, ...]:
        """Return why a controller can't be activated: what is not there."""
        there = self._surroundings
        exported = {n for s in others.values() for n in s.exported_interfaces}
        references = {n for s in others.values() for n in s.reference_interfaces}
        commands = {*there.command_interfaces, *references}
        states = {*there.state_interfaces, *exported}
        problems = []
        for kind, needed, known in (
            ("command", system.command_interfaces, commands),
            ("state", system.state_interfaces, states),
        ):
            names = [name for name in needed if name not in known]
            problems += [self._missing(kind, n, known, others) for n in names]
        off = [n for n in system.command_interfaces if self._is_off(n)]
        off += [n for n in system.state_interfaces if self._is_off(n, is_state=True)]
        if off:
            problems.append(
                f"{off[0]!r} belongs to hardware component {there.blocks[off[0]]!r}, "
                "which hardware_components_initial_state leaves inactive"
            )
        return tuple(dict.fromkeys(problems))  # A joint may lack several times.

    def _is_off(self, name: str, *, is_state: bool = False) -> bool:
        """Return whether the hardware of an interface isn't active at the start.

        What is configured can be read, and no more.
        """
        states = self._config.hardware_components_initial_state
        block = self._surroundings.blocks.get(name)
        if block is None:
            return False
        off = states.unconfigured if is_state else states.unconfigured + states.inactive
        return block in off or bool(states.active and block not in states.active)

    def _missing(
        self,
        kind: str,
        name: str,
        known: Collection[str],
        others: Mapping[str, ControllerInterface],
    ) -> str:
        joint, _, interface = name.rpartition("/")
        has = sorted(n[len(joint) + 1 :] for n in known if n.startswith(f"{joint}/"))
        if joint.partition("/")[0] in others:
            owner = joint.partition("/")[0]
            offered = sorted(n for n in known if n.startswith(f"{owner}/"))
            return f"controller {owner!r} has no {kind} interface {name!r}; {offered}"
        if joint in self._surroundings.joint_types or has:
            return (
                f"joint {joint!r} has no {kind} interface {interface!r}; it has {has}"
            )
        hint = suggest(joint, self._surroundings.joint_types)
        return f"the robot has no joint {joint!r}; {hint}"

    def _reject(
        self,
        controller: ControllerConfig,
        problem: str,
        error: ParameterError | None = None,
        *,
        kind: Kind = "invalid",
    ) -> None:
        done = "the controller does not run"
        self._add(controller, "error", kind, problem, done, error)

    def _add(
        self,
        controller: ControllerConfig,
        severity: Severity,
        kind: Kind,
        what: str,
        done: str,
        error: ParameterError | None = None,
    ) -> None:
        self._report.add(
            severity,
            kind,
            what,
            done,
            where=(error.where if error else None) or controller.name,
            file=(error.file if error else None) or controller.file,
            line=error.line if error and error.where else controller.line,
        )
