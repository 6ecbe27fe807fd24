"""One controller from its configuration: its system, or a line in the report."""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

from arm_drake.control.drive_mode import is_outdone
from arm_drake.controllers import (
    ControllerType,
    find_controller_type,
    installed_types,
    list_types,
)
from arm_drake.controllers.controller_interface_part import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.gazebo import make_plugin
from arm_drake.controllers.gazebo.gazebo_topics import find_unsupported
from arm_drake.controllers.other_types import describe_unknown
from arm_drake.description.controller_manager import ControllerConfig
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.parameters import load_parameters
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import InputError, ParameterError
from arm_drake.manager.gain_report import report_gains
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import LoadedController, controller_infos
from arm_drake.manager.missing_interfaces import find_undeclared_limits
from arm_drake.manager.switching import find_cycle
from arm_drake.manager.update_schedule import effective_rate


def _listed(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


class ControllerLoader:
    """Loads controllers of one robot and reports what doesn't work."""

    def __init__(
        self,
        config: ControllerManagerConfig,
        surroundings: Surroundings,
        report: LoadReport,
        period: float | None,
        distro: str,
        controller_types: Mapping[str, ControllerType] | None = None,
    ) -> None:
        """Create it.

        Args:
            config: What the YAML configures.
            surroundings: What the robot offers.
            report: Where what doesn't work is recorded.
            period: Period of the manager in Drake's time [s].
            distro: Distribution whose parameters and defaults hold.
            controller_types: Types of this robot alone.
        """
        self._distro = distro
        self._types = dict(controller_types or {})
        self._installed = installed_types()
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
        if controller.plugins:
            return self._load_plugin(controller)
        row = self._find_type(controller)
        if row is None:
            return None
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
            system = row.system(parameters, self._params(controller, rate))
            if row.origin and not isinstance(system, ControllerInterface):
                kind = type(system).__name__
                raise TypeError(f"expected a ControllerInterface, got a {kind}")
            if not row.origin:
                report_gains(controller, parameters, self._report)
        except ParameterError as error:
            self._reject(controller, error.problem, error)
            return None
        except Exception as error:
            if not row.origin:
                raise
            # Code of others can fail in every way; it must not take ours with it.
            what = f"controller type {controller.type!r} of {row.origin} can't be made"
            self._reject(controller, f"{what}: {type(error).__name__}: {error}")
            return None
        return system

    def _find_type(self, controller: ControllerConfig) -> ControllerType | None:
        """Return the row of a controller's type; what isn't plain is reported."""
        name, what = controller.type, f"controller type {controller.type!r}"
        try:
            row = find_controller_type(name, self._types, self._installed)
        except InputError as error:
            self._reject(controller, f"{what}: {error.problem}")
            return None
        if row is None:
            known = [*list_types(), *self._types, *self._installed]
            severity, what, done = describe_unknown(name, known)
            self._add(controller, severity, "unsupported", what, done)
            return None
        if row.runs_as:
            self._add(controller, "info", "repair", what, f"run as {row.runs_as}")
        for other in row.others:
            too, done = (
                f"{what} comes from {other} too",
                f"that of {row.origin} is used",
            )
            self._add(controller, "info", "ignored", too, done)
        return row

    def _load_plugin(self, controller: ControllerConfig) -> ControllerInterface:
        """Return the system of a Gazebo plugin; what it can't do is reported."""
        for tag in controller.plugins:
            for problem in find_unsupported(tag):
                done = "it has no effect"
                self._add(controller, "warning", "unsupported", problem, done)
        params = self._params(controller, self._config.update_rate)
        # What it may command, though its tag names no joints.
        joints, names = controller.plugin_joints, params.command_interfaces
        offered = [name for name in names if name.rpartition("/")[0] in joints]
        params = dc.replace(params, command_interfaces=frozenset(offered))
        return make_plugin(controller.plugins, params)

    def _params(
        self, controller: ControllerConfig, rate: int
    ) -> ControllerInterfaceParams:
        """Return what a controller of this rate is given besides its parameters."""
        there = self._surroundings
        return ControllerInterfaceParams(
            controller_name=controller.name,
            update_rate=rate,
            period=self._period,
            joint_types=there.joint_types,
            command_interfaces=frozenset(there.command_interfaces),
            state_interfaces=frozenset(there.state_interfaces),
            measured=there.measured,
            other_types=there.other_types,
            distro=self._distro,
            velocity_limits=there.velocity_limits,
            effort_limits=there.effort_limits,
            followed=there.followed,
            gripper_ranges=there.gripper_ranges,
            namespace=there.namespace,
            links=there.links,
            robot_name=there.robot_name,
            world_name=there.world_name,
            make_kinematics=there.make_kinematics,
            is_managed=True,
        )

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
            and name not in system.limit_interfaces
            and is_outdone(name, system.command_interfaces)
        ]
        if idle:
            what = f"beside velocities, {_listed(idle)} are not acted on"
            lines.append((what, "the joints follow their velocities"))
        for what, done in lines:
            self._add(controller, "info", "unsupported", what, done)
        for name in find_undeclared_limits(system, there):
            what = f"the description has no command interface {name!r}"
            self._add(controller, "info", "missing", what, "its joint's drive has it")

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
