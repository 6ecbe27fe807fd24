"""Which controllers of a robot load, and which of them start.

Follows ros2_control's controller_manager: a controller that can't be loaded or
activated is reported and left out, the others run; a command interface belongs to one
active controller.
"""

import dataclasses as dc
from collections.abc import Collection, Iterable, Mapping, Sequence

from arm_drake import interfaces
from arm_drake.controllers import ControllerType
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.report import LoadReport
from arm_drake.errors import InputError, suggest
from arm_drake.manager.controller_loader import ControllerLoader
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.loaded_controllers import LoadedController, controller_infos
from arm_drake.manager.missing_interfaces import find_missing
from arm_drake.manager.plan import plan_switch
from arm_drake.manager.switching import activation_order


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
    controller_types: Mapping[str, ControllerType] | None = None,
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
        controller_types: Types of this robot alone, by name.

    Raises:
        InputError: If ``active`` or ``inactive`` names no controller.
    """
    names = [controller.name for controller in config.controllers]
    for name in (*active, *inactive):
        if name not in names:
            raise InputError(f"no controller {name!r}; {suggest(name, names)}")
    loader = ControllerLoader(
        config, surroundings, report, period, distro, controller_types
    )
    systems = loader.load_all()
    loaded = {n: s for n, s in systems.items() if s is not None}
    states = config.hardware_components_initial_state
    plugins = {c.name for c in config.controllers if c.plugins}
    missing = {
        n: find_missing(
            s, loaded, surroundings, states, configured=names, reads_all=n in plugins
        )
        for n, s in loaded.items()
    }
    configs = {c.name: c for c in config.controllers}
    for name, system in loaded.items():
        if not missing[name]:
            loader.report_unsimulated(configs[name], system)
    controllers = [
        LoadedController(
            c.name,
            c.type,
            "unconfigured" if systems[c.name] is None else "inactive",
            systems[c.name],
            missing.get(c.name, ()),
            _driven(systems[c.name], surroundings),
        )
        for c in config.controllers
    ]
    infos = controller_infos(controllers)
    started: list[str] = []
    first = [c for c in config.controllers if c.name in set(active)]
    waiting = list(dict.fromkeys(c.name for c in (*first, *config.controllers)))
    for name in [n for n in activation_order(infos, waiting) if n in loaded]:
        if name in inactive:
            continue
        problems: Sequence[str] = missing[name]
        if judges_claims:
            problems = plan_switch(infos, started, [name], [], strict=True).problems
            if not problems and surroundings.refuse is not None:
                fault = surroundings.refuse(infos[name].command_interfaces, ())
                problems = [fault] if fault else []
        if problems:
            loader.report_obstacle(configs[name], missing[name], problems)
        else:
            started.append(name)
    return tuple(
        dc.replace(c, state="active") if c.name in started else c for c in controllers
    )


def report_motionless(
    controllers: Iterable[LoadedController],
    moving: Mapping[str, Collection[str]],
    report: LoadReport,
) -> None:
    """Record the controllers whose commands move nothing where there is no physics.

    Args:
        controllers: The controllers of a robot without physics.
        moving: The interfaces that each joint moves by, by its name.
        report: Where they are recorded.
    """
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
    system: ControllerInterface | None, surroundings: Surroundings
) -> tuple[str, ...]:
    """Return the joints of the drive that a controller moves."""
    if system is None:
        return ()
    claims = [n for n in system.command_interfaces if n not in system.limit_interfaces]
    parts = [name.rpartition("/") for name in claims]
    joints = dict.fromkeys(
        joint for joint, _, name in parts if name in interfaces.MOTIONS
    )
    return tuple(joint for joint in joints if joint in surroundings.driven)
