"""Interfaces that a controller needs and a robot doesn't have, in words."""

from collections.abc import Collection, Mapping, Sequence

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.description.controller_manager_parameters import (
    HardwareComponentsInitialState,
)
from arm_drake.errors import suggest
from arm_drake.manager.hardware_interfaces import Surroundings


def find_missing(
    system: ControllerInterface,
    others: Mapping[str, ControllerInterface],
    there: Surroundings,
    states: HardwareComponentsInitialState,
    *,
    configured: Collection[str] = (),
    reads_all: bool = False,
) -> tuple[str, ...]:
    """Return why a controller can't be activated: what is not there.

    Args:
        system: The controller.
        others: All controllers that are loaded, by name.
        there: What the robot offers.
        states: Which of its hardware is active.
        configured: Names of all controllers, also of those that aren't loaded.
        reads_all: Whether it reads all joints, as Gazebo's plugins do, not only those
            that the hardware reports.
    """
    exported = {n for s in others.values() for n in s.exported_interfaces}
    references = {n for s in others.values() for n in s.reference_interfaces}
    limits = find_undeclared_limits(system, there)
    commands = {*there.command_interfaces, *references, *limits}
    measured = {*there.state_interfaces, *exported}
    if reads_all:
        measured |= {*there.measured}
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
            _missing(kind, names, known, others, there, configured)
            for names in groups.values()
        ]
    off = [n for n in system.command_interfaces if _is_off(n, there, states)]
    off += [
        n for n in system.state_interfaces if _is_off(n, there, states, is_state=True)
    ]
    if off:
        problems.append(
            f"{off[0]!r} belongs to hardware component {there.blocks[off[0]]!r}, "
            "which hardware_components_initial_state leaves inactive"
        )
    return tuple(dict.fromkeys(problems))


def find_undeclared_limits(
    system: ControllerInterface, there: Surroundings
) -> list[str]:
    """Return the limits of a controller that drives know, not the description."""
    return [
        name
        for name in system.limit_interfaces
        if name not in there.command_interfaces
        and name.rpartition("/")[0] in (there.driven or there.joint_types)
    ]


def _is_off(
    name: str,
    there: Surroundings,
    states: HardwareComponentsInitialState,
    *,
    is_state: bool = False,
) -> bool:
    """Return whether the hardware of an interface isn't active at the start.

    What is configured can be read, and no more.
    """
    block = there.blocks.get(name)
    if block is None:
        return False
    off = states.unconfigured if is_state else states.unconfigured + states.inactive
    return block in off or bool(states.active and block not in states.active)


def _missing(
    kind: str,
    names: Sequence[str],
    known: Collection[str],
    others: Mapping[str, ControllerInterface],
    there: Surroundings,
    configured: Collection[str],
) -> str:
    """Return why there are no command or state interfaces of a component."""
    name = names[0]
    component, _, interface = name.rpartition("/")
    has = sorted(
        n[len(component) + 1 :] for n in known if n.startswith(f"{component}/")
    )
    noun = there.components.get(component, "")
    if component in there.joint_types:
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
        return f"{what}; {suggest(component, there.joint_types)}"
    what = f"the robot has no joint, sensor or gpio {component!r}"
    return f"{what}; {suggest(component, (*there.joint_types, *there.components))}"


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
