"""Which controllers of a robot load, and which of them start.

Follows ros2_control's controller_manager: a controller that can't be loaded or
activated is reported and left out, the others run; a command interface belongs to one
active controller.
"""

import dataclasses as dc
import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal, NamedTuple

from arm_drake import interfaces
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
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, ParameterError, suggest
from arm_drake.options import SimulationOptions
from arm_drake.surroundings import Surroundings, find_surroundings

# Command interfaces that the simulated hardware acts on.
SIMULATED_COMMANDS = (interfaces.POSITION,)

ControllerStatus = Literal["active", "inactive", "unconfigured"]


class ControllerState(NamedTuple):
    """A row of `ros2 control list_controllers`."""

    name: str
    type: str

    # "unconfigured" is a controller that could not be loaded.
    state: ControllerStatus


@dc.dataclass(frozen=True, eq=False)
class LoadedController:
    """A controller of a robot, with its system if it could be loaded."""

    name: str
    type: str
    state: ControllerStatus
    system: ControllerInterface | None


def load_controllers(
    config: ControllerManagerConfig,
    surroundings: Surroundings,
    report: LoadReport,
    *,
    period: float | None = None,
    active: Iterable[str] = (),
    inactive: Iterable[str] = (),
    judges_claims: bool = True,
    distro: str = "jazzy",
) -> tuple[LoadedController, ...]:
    """Load the controllers of a robot and choose those that start.

    Args:
        config: What the YAML configures.
        surroundings: What the robot offers.
        report: Where controllers that don't load or start are recorded.
        period: Period of the manager in Drake's time [s].
        active: Controllers to start before the others.
        inactive: Controllers not to start.
        judges_claims: Whether a controller whose interfaces are claimed stays inactive.
        distro: Distribution whose parameters and defaults hold.

    Raises:
        InputError: If ``active`` or ``inactive`` names no controller.
    """
    names = [controller.name for controller in config.controllers]
    for name in (*active, *inactive):
        if name not in names:
            raise InputError(f"no controller {name!r}; {suggest(name, names)}")
    loader = _Loader(config, surroundings, report, period, distro)
    systems = {c.name: loader.load(c) for c in config.controllers}
    claims: dict[str, str] = {}
    states: dict[str, ControllerStatus] = {}
    first = [c for c in config.controllers if c.name in set(active)]
    for controller in (*first, *config.controllers):
        if controller.name in states:
            continue
        system = systems[controller.name]
        if system is None:
            states[controller.name] = "unconfigured"
        elif controller.name in inactive or not loader.can_claim(
            controller, system, claims if judges_claims else {}
        ):
            states[controller.name] = "inactive"
        else:
            claims |= dict.fromkeys(system.command_interfaces, controller.name)
            states[controller.name] = "active"
    return tuple(
        LoadedController(c.name, c.type, states[c.name], systems[c.name])
        for c in config.controllers
    )


def load_controllers_of(
    robot: Robot, period: float | None = None, options: SimulationOptions | None = None
) -> tuple[tuple[LoadedController, ...], LoadReport]:
    """Return the controllers of a robot, and its report with what they lack.

    Args:
        robot: The robot; its own report stays as it is.
        period: Period of its controller manager in Drake's time [s].
        options: Which controllers to start or not.
    """
    options = SimulationOptions() if options is None else options
    report = LoadReport(robot.report)
    controllers = load_controllers(
        robot.controllers,
        find_surroundings(robot.description, robot.initial_positions),
        report,
        period=period,
        active=options.active,
        inactive=options.inactive,
        distro=robot.distro,
    )
    return controllers, report


def _similar_type(name: str) -> str:
    """Return the end of a message about an unknown type; most are vendors' own."""
    known = [other for other, row in CONTROLLER_TYPES.items() if not row.runs_as]
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
    close += [other for other in known if other.rpartition("/")[2] == name]
    return f"; did you mean {close[0]!r}?" if close else ""


class _Loader:
    """Loads controllers of one robot and reports what doesn't work."""

    def __init__(
        self,
        config: ControllerManagerConfig,
        surroundings: Surroundings,
        report: LoadReport,
        period: float | None,
        distro: str,
    ) -> None:
        self._distro = distro
        self._config = config
        self._surroundings = surroundings
        self._report = report
        self._period = 1.0 / config.update_rate if period is None else period

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
        divisor = self._take_rate(controller, own)
        try:
            node, file, report = controller.name, controller.file, self._report
            parameters: Any = load_parameters(
                row.parameters, own, node, file, report, distro=self._distro
            )
            if row.system is None:
                return None
            params = ControllerInterfaceParams(
                controller_name=controller.name,
                update_rate=self._config.update_rate // divisor,
                period=self._period * divisor,
                joint_types=self._surroundings.joint_types,
                command_interfaces=self._surroundings.command_interfaces,
                state_interfaces=self._surroundings.state_interfaces,
                measured=interfaces.interface_names(
                    self._surroundings.joint_types, interfaces.STATE_INTERFACES
                ),
                initial_commands={
                    f"{joint}/{interfaces.POSITION}": position
                    for joint, position in self._surroundings.initial_positions.items()
                },
            )
            return row.system(parameters, params)
        except ParameterError as error:
            self._reject(controller, error.problem, error)
            return None

    def _take_rate(self, controller: ControllerConfig, own: dict[str, Any]) -> int:
        """Return every how many ticks of the manager a controller ticks."""
        own.pop("use_sim_time", None)
        asked = own.pop("update_rate", None)
        manager = self._config.update_rate
        if asked is None or asked.value in (0, manager):
            return 1
        if type(asked.value) is not int or not 0 < asked.value < manager:
            divisor = 1
        else:
            divisor = max(1, round(manager / asked.value))
        if divisor == 1 or manager % divisor or asked.value * divisor != manager:
            while manager % divisor:
                divisor -= 1
            self._report.add(
                "warning",
                "repair",
                f"update_rate {asked.value!r} does not divide the manager's {manager}",
                f"{manager // divisor} Hz is used",
                where=f"{controller.name}.update_rate",
                file=asked.file,
                line=asked.line,
            )
        return divisor

    def can_claim(
        self,
        controller: ControllerConfig,
        system: ControllerInterface,
        claims: Mapping[str, str],
    ) -> bool:
        """Return whether a controller can start, with a line in the report if not."""
        for problem in self._obstacles(system):
            self._reject(controller, problem)
            return False
        taken = [name for name in system.command_interfaces if name in claims]
        if taken:
            done = "the controller stays inactive"
            what = f"{taken[0]} is already claimed by {claims[taken[0]]!r}"
            self._add(controller, "warning", "ignored", what, done)
        return not taken

    def _obstacles(self, system: ControllerInterface) -> Iterator[str]:
        there = self._surroundings
        for kind, needed, known in (
            ("command", system.command_interfaces, there.command_interfaces),
            ("state", system.state_interfaces, there.state_interfaces),
        ):
            for name in needed:
                joint, _, interface = name.rpartition("/")
                if joint not in there.joint_types:
                    hint = suggest(joint, there.joint_types)
                    yield f"the robot has no joint {joint!r}; {hint}"
                elif name not in known:
                    has = sorted(
                        n.rpartition("/")[2] for n in known if n.startswith(f"{joint}/")
                    )
                    yield (
                        f"joint {joint!r} has no {kind} interface {interface!r}; "
                        f"it has {has}"
                    )
        for name in system.command_interfaces:
            interface = name.rpartition("/")[2]
            if interface not in SIMULATED_COMMANDS:
                yield (
                    f"command interface {interface!r} is not simulated yet; "
                    f"simulated: {list(SIMULATED_COMMANDS)}"
                )

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
