"""Loading of a robot's controllers, and the choice of those that start.

Follows ros2_control's controller_manager: a controller that can't be loaded or
activated is reported and left out, the others run; a command interface belongs to one
active controller.
"""

import dataclasses as dc
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake import interfaces
from arm_drake.control.drive_commands import is_outdone
from arm_drake.control.pid import PidGains
from arm_drake.controllers import (
    ControllerType,
    find_controller_type,
    installed_types,
    list_types,
)
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
    RobotInfo,
)
from arm_drake.controllers.gazebo import make_plugin
from arm_drake.controllers.gazebo.plugin import find_unsupported
from arm_drake.controllers.registry import describe_unknown
from arm_drake.description.controllers import (
    MANAGER,
    ControllerConfig,
    ControllerManagerConfig,
    HardwareComponentsInitialState,
)
from arm_drake.description.parameters import load_parameters
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.description.robot import Robot
from arm_drake.errors import (
    InputError,
    ParameterError,
    check_known,
    first_names,
    suggest,
)
from arm_drake.interfaces import EFFORT, VELOCITY
from arm_drake.manager.hardware_interfaces import (
    HardwareInterfaces,
    find_hardware_interfaces,
)
from arm_drake.manager.lifecycle import effective_rate
from arm_drake.manager.loaded_controllers import LoadedController, controller_infos
from arm_drake.manager.switching import activation_order, find_cycle, plan_switch
from arm_drake.options import SimulationOptions


def report_gains(
    controller: ControllerConfig, parameters: Any, report: LoadReport
) -> None:
    """Report gains that push away from the goal, or not at all."""
    gains = getattr(parameters, "gains", None)
    joints: Mapping[str, PidGains] = getattr(gains, "joint", None) or getattr(
        gains, "dof", {}
    )
    if not joints:
        return
    commands = getattr(parameters, "command_interfaces", (EFFORT,))
    if EFFORT not in commands and tuple(commands) != (VELOCITY,):
        return  # They have no effect, and that is said.
    for joint, pid in joints.items():
        values = {name: getattr(pid, name) for name in ("p", "i", "d")}
        problems = [
            f"{name} is {value}: it pushes away from the goal"
            for name, value in values.items()
            if value < 0.0
        ]
        forward = getattr(pid, "ff_velocity_scale", getattr(pid, "feedforward_gain", 0))
        if not any(values.values()) and not forward:
            problems = ["p, i and d are 0: no error moves the joint"]
        for problem in problems:
            report.add(
                "warning",
                "invalid",
                problem,
                "taken as it is",
                where=f"{controller.name}.gains.{joint}",
                file=controller.file,
                line=controller.line,
            )


def find_missing(
    system: ControllerInterface,
    others: Mapping[str, ControllerInterface],
    hardware: HardwareInterfaces,
    states: HardwareComponentsInitialState,
    *,
    configured: Collection[str] = (),
    reads_all: bool = False,
) -> tuple[str, ...]:
    """Return why a controller can't be activated: what is not there."""
    exported = {n for s in others.values() for n in s.exported_interfaces}
    references = {n for s in others.values() for n in s.reference_interfaces}
    limits = find_undeclared_limits(system, hardware)
    commands = {*hardware.command_interfaces, *references, *limits}
    measured = {*hardware.state_interfaces, *exported}
    if reads_all:
        measured |= {*hardware.measured}
    problems = []
    for kind, needed, known in (
        ("command", system.command_interfaces, commands),
        ("state", system.state_interfaces, measured),
    ):
        groups: dict[str, list[str]] = {}
        for name in needed:
            if name not in known:
                groups.setdefault(name.rpartition("/")[0], []).append(name)
        problems += [
            _missing(kind, names, known, others, hardware, configured)
            for names in groups.values()
        ]
    off = [n for n in system.command_interfaces if _is_off(n, hardware, states)]
    off += [
        n
        for n in system.state_interfaces
        if _is_off(n, hardware, states, is_state=True)
    ]
    if off:
        problems.append(
            f"{off[0]!r} belongs to hardware component {hardware.blocks[off[0]]!r}, "
            "which hardware_components_initial_state leaves inactive"
        )
    return tuple(dict.fromkeys(problems))


def find_undeclared_limits(
    system: ControllerInterface, hardware: HardwareInterfaces
) -> list[str]:
    """Return the limits of a controller that drives know, not the description."""
    return [
        name
        for name in system.limit_interfaces
        if name not in hardware.command_interfaces
        and name.rpartition("/")[0] in (hardware.driven or hardware.joint_types)
    ]


def _is_off(
    name: str,
    hardware: HardwareInterfaces,
    states: HardwareComponentsInitialState,
    *,
    is_state: bool = False,
) -> bool:
    """Return whether the hardware of an interface isn't active at the start.

    What is configured can be read, and no more.
    """
    block = hardware.blocks.get(name)
    if block is None:
        return False
    off = states.unconfigured if is_state else states.unconfigured + states.inactive
    return block in off or bool(states.active and block not in states.active)


def _missing(
    kind: str,
    names: Sequence[str],
    known: Collection[str],
    others: Mapping[str, ControllerInterface],
    hardware: HardwareInterfaces,
    configured: Collection[str],
) -> str:
    """Return why command or state interfaces of a component are missing."""
    name = names[0]
    component, _, interface = name.rpartition("/")
    has = sorted(
        n[len(component) + 1 :] for n in known if n.startswith(f"{component}/")
    )
    noun = hardware.components.get(component, "")
    if component in hardware.joint_types:
        noun = "joint"
    owner, _, rest = name.partition("/")
    if noun or (has and owner not in others):
        what = f"{noun} {component!r}".lstrip()
        listed = ", ".join(repr(n.rpartition("/")[2]) for n in names)
        plural = "s" if len(names) > 1 else ""
        return f"{what} has no {kind} interface{plural} {listed}; it has {has}"
    if owner in others:
        return _missing_of(others, owner, kind, rest)
    if owner in configured:
        what = f"{kind} interface {name!r} is of controller {owner!r}"
        return f"{what}, which is not loaded; its own line says why"
    if "/" in component:
        what = f"the robot has no joint {component!r}, and there is no controller"
        return f"{what} {owner!r}; {suggest(owner, configured)}"
    if interface in interfaces.MOTIONS:
        what = f"the robot has no joint {component!r}"
        return f"{what}; {suggest(component, hardware.joint_types)}"
    what = f"the robot has no joint, sensor or gpio {component!r}"
    return (
        f"{what}; {suggest(component, (*hardware.joint_types, *hardware.components))}"
    )


def _missing_of(
    others: Mapping[str, ControllerInterface], owner: str, kind: str, name: str
) -> str:
    """Return why a controller has no interface for others of a name."""
    does = "takes no references" if kind == "command" else "exports no states"
    offers = {
        n: system.reference_interfaces
        if kind == "command"
        else system.exported_interfaces
        for n, system in others.items()
    }
    has = sorted(n.partition("/")[2] for n in offers[owner])
    if has:
        what = "reference" if kind == "command" else "exported state"
        return f"controller {owner!r} has no {what} {name!r}; it has {has}"
    chainable = [n for n in offers if offers[n]]
    listed = (
        f"those that do: {', '.join(sorted(chainable))}" if chainable else "none does"
    )
    return f"controller {owner!r} {does}, so there is no {owner}/{name}; {listed}"


class ControllerLoader:
    """Loads controllers of one robot and reports what doesn't work."""

    def __init__(
        self,
        config: ControllerManagerConfig,
        hardware_interfaces: HardwareInterfaces,
        report: LoadReport,
        period: float | None,
        distro: str,
        controller_types: Mapping[str, ControllerType] | None = None,
    ) -> None:
        """Create it."""
        self._distro = distro
        self._types = dict(controller_types or {})
        self._installed = installed_types()
        self._config = config
        self._hardware_interfaces = hardware_interfaces
        self._report = report
        self._period = 1.0 / config.update_rate if period is None else period

        # Why controllers could not be loaded, by name.
        self.problems = {c.name: c.problem for c in config.controllers if c.problem}

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
            self.problems[controller.name] = what
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
        available = [name for name in names if name.rpartition("/")[0] in joints]
        params = dc.replace(params, command_interfaces=frozenset(available))
        return make_plugin(controller.plugins, params)

    def _params(
        self, controller: ControllerConfig, rate: int
    ) -> ControllerInterfaceParams:
        """Return the configuration of a controller of this rate."""
        hardware = self._hardware_interfaces
        return ControllerInterfaceParams(
            controller_name=controller.name,
            update_rate=rate,
            period=self._period,
            joint_types=hardware.joint_types,
            command_interfaces=frozenset(hardware.command_interfaces),
            state_interfaces=frozenset(hardware.state_interfaces),
            measured=hardware.measured,
            distro=self._distro,
            **{f.name: getattr(hardware, f.name) for f in dc.fields(RobotInfo)},
            is_managed=True,
        )

    def _take_rate(self, controller: ControllerConfig, own: dict[str, Any]) -> int:
        """Return the rate at which a controller ticks [Hz]."""
        own.pop("use_sim_time", None)
        parameter = own.pop("update_rate", None)
        manager = self._config.update_rate
        if parameter is None or parameter.value in (0, manager):
            return manager
        if type(parameter.value) is not int or parameter.value < 0:
            raise ParameterError(
                f"expected an integer from 1 to {manager} Hz, got {parameter.value!r}",
                file=parameter.file,
                line=parameter.line,
                where=f"{controller.name}.update_rate",
            )
        rate, done = effective_rate(parameter.value, manager, distro=self._distro), ""
        if parameter.value > manager:
            done = f"{manager} Hz is used"
            what = f"update_rate {parameter.value} is above the manager's {manager}"
        elif manager % parameter.value:
            what = (
                f"update_rate {parameter.value} does not divide the manager's {manager}"
            )
            done = f"{rate} Hz is used"
            if rate == parameter.value:
                done = "it ticks in the nearest cycles"
        if done:
            self._report.add(
                "warning",
                "repair",
                what,
                done,
                where=f"{controller.name}.update_rate",
                file=parameter.file,
                line=parameter.line,
            )
        return rate

    def report_unsimulated(
        self, controller: ControllerConfig, system: ControllerInterface
    ) -> None:
        """Record what a controller reads or commands that the physics doesn't know."""
        hardware = self._hardware_interfaces
        if not hardware.has_physics:
            return
        lines = []
        read = [
            name
            for name in system.state_interfaces
            if name in hardware.stored and name not in hardware.command_interfaces
        ]
        if read:
            what = f"state interfaces aren't simulated: {first_names(read, 3)}"
            lines.append((what, "they stay at their initial values"))
        idle = [
            name
            for name in system.command_interfaces
            if name.rpartition("/")[0] in hardware.driven
            and name not in system.limit_interfaces
            and is_outdone(name, system.command_interfaces)
        ]
        if idle:
            what = f"beside velocities, {first_names(idle, 3)} are not acted on"
            lines.append((what, "the joints follow their velocities"))
        for what, done in lines:
            self._add(controller, "info", "unsupported", what, done)
        for name in find_undeclared_limits(system, hardware):
            what = f"the description has no command interface {name!r}"
            self._add(controller, "info", "missing", what, "its joint's drive has it")

    def find_missing_of(
        self, loaded: Mapping[str, ControllerInterface]
    ) -> dict[str, tuple[str, ...]]:
        """Return what each controller lacks; report what the physics doesn't know."""
        states = self._config.hardware_components_initial_state
        configs = {c.name: c for c in self._config.controllers}
        missing = {
            name: find_missing(
                system,
                loaded,
                self._hardware_interfaces,
                states,
                configured=list(configs),
                reads_all=bool(configs[name].plugins),
            )
            for name, system in loaded.items()
        }
        for name, system in loaded.items():
            if not missing[name]:
                self.report_unsimulated(configs[name], system)
        return missing

    def choose_started(
        self,
        controllers: Iterable[LoadedController],
        names: Iterable[str],
        inactive: Iterable[str],
        *,
        judges_claims: bool,
    ) -> list[str]:
        """Return the controllers that start, in order; report why others don't."""
        infos, refuse = controller_infos(controllers), self._hardware_interfaces.refuse
        configs = {c.name: c for c in self._config.controllers}
        started: list[str] = []
        for name in activation_order(infos, names):
            info = infos[name]
            if not info.is_configured or name in inactive:
                continue
            problems: Sequence[str] = info.missing
            if judges_claims:
                problems = plan_switch(infos, started, [name], [], strict=True).problems
                if not problems and refuse is not None:
                    fault = refuse(info.command_interfaces, ())
                    problems = [fault] if fault else []
            if problems:
                self.report_obstacle(configs[name], info.missing, problems)
            else:
                started.append(name)
        return started

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
        place = f"{error.where}: " if error is not None and error.where else ""
        self.problems.setdefault(controller.name, f"{place}{problem}")
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
        # What is missing has no line: it would stand where the controller does.
        file = (error.file if error else None) or controller.file
        line = error.line if error else None
        if line is None and Path(file) == controller.file:
            line = controller.line
        where = (error.where if error else None) or controller.name
        self._report.add(severity, kind, what, done, where=where, file=file, line=line)


def load_controllers(
    config: ControllerManagerConfig,
    hardware_interfaces: HardwareInterfaces,
    report: LoadReport,
    *,
    period: float | None = None,
    active: Iterable[str] = (),
    inactive: Iterable[str] = (),
    judges_claims: bool = True,
    distro: str = "jazzy",
    controller_types: Mapping[str, ControllerType] | None = None,
) -> tuple[LoadedController, ...]:
    """Load the controllers of a robot and choose those that start.

    What doesn't load or start is in the report. `period` [s] is the manager's in
    Drake's time; `active` start before the others, and where `judges_claims`, one whose
    interfaces are claimed stays inactive. A name that is no controller's is an
    InputError.
    """
    names = [controller.name for controller in config.controllers]
    for name in (*active, *inactive):
        check_known("controller", name, names)
    loader = ControllerLoader(
        config, hardware_interfaces, report, period, distro, controller_types
    )
    systems = loader.load_all()
    missing = loader.find_missing_of(
        {n: s for n, s in systems.items() if s is not None}
    )
    controllers = [
        LoadedController(
            c.name,
            c.type,
            "unconfigured" if systems[c.name] is None else "inactive",
            systems[c.name],
            missing.get(c.name, ()),
            "" if systems[c.name] else loader.problems.get(c.name, ""),
            _driven(systems[c.name], hardware_interfaces),
        )
        for c in config.controllers
    ]
    first = [c.name for c in config.controllers if c.name in set(active)]
    started = loader.choose_started(
        controllers, (*first, *names), inactive, judges_claims=judges_claims
    )
    return tuple(
        dc.replace(c, state="active") if c.name in started else c for c in controllers
    )


def load_controllers_of(
    robot: Robot,
    period: float | None = None,
    options: SimulationOptions | None = None,
    hardware_interfaces: HardwareInterfaces | None = None,
) -> tuple[tuple[LoadedController, ...], LoadReport]:
    """Return the controllers of a robot, and its report with what they lack.

    The robot's own report stays as it is. `period` [s] is that of its manager in
    Drake's time. The interfaces are those of its description, if not others are given.
    """
    options = SimulationOptions() if options is None else options
    report = LoadReport(robot.report)
    controllers = load_controllers(
        robot.controllers,
        hardware_interfaces
        or find_hardware_interfaces(
            robot.description, robot.initial_positions, robot_name=robot.name
        ),
        report,
        period=period,
        active=options.active,
        inactive=options.inactive,
        distro=robot.distro,
        controller_types=robot.controller_types,
    )
    if robot.controllers.enforce_command_limits and robot.distro == "humble":
        report.add(
            "warning",
            "ignored",
            "humble has no enforce_command_limits",
            "commands aren't limited",
            where=MANAGER,
            file=next(iter(robot.controllers.files), None),
        )
    return controllers, report


def report_motionless(
    controllers: Iterable[LoadedController],
    moving: Mapping[str, Collection[str]],
    report: LoadReport,
) -> None:
    """Record the controllers whose commands move nothing without physics."""
    for controller in controllers:
        system = controller.system
        claims = () if system is None else system.command_interfaces
        names = [n for n in claims if system and n not in system.limit_interfaces]
        parts = [name.rpartition("/") for name in names]
        parts = [part for part in parts if part[0] in moving]
        kinds = sorted({kind for _, _, kind in parts})
        if kinds and not any(kind in moving[joint] for joint, _, kind in parts):
            joints = len({joint for joint, _, _ in parts})
            what = f"{joints} joint{'s follow' if joints > 1 else ' follows'} "
            what += ", ".join(f"commands of {kind}" for kind in kinds)
            done = "without physics these move nothing"
            if kinds != [interfaces.EFFORT]:
                done += "; with calculate_dynamics in <hardware> they do"
            report.add("warning", "unsupported", what, done, where=controller.name)


def _driven(
    system: ControllerInterface | None, hardware_interfaces: HardwareInterfaces
) -> tuple[str, ...]:
    """Return the joints of the drive that a controller moves."""
    if system is None:
        return ()
    claims = [n for n in system.command_interfaces if n not in system.limit_interfaces]
    parts = [name.rpartition("/") for name in claims]
    joints = dict.fromkeys(
        joint for joint, _, name in parts if name in interfaces.MOTIONS
    )
    return tuple(joint for joint in joints if joint in hardware_interfaces.driven)
