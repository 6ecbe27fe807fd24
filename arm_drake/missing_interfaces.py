"""Interfaces that a controller needs and a robot doesn't have, in words."""

from collections.abc import Collection, Mapping

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.controllers import HardwareComponentsInitialState
from arm_drake.errors import suggest
from arm_drake.surroundings import Surroundings


def find_missing(
    system: ControllerInterface,
    others: Mapping[str, ControllerInterface],
    there: Surroundings,
    states: HardwareComponentsInitialState,
    *,
    reads_all: bool = False,
) -> tuple[str, ...]:
    """Return why a controller can't be activated: what is not there.

    Args:
        system: The controller.
        others: All controllers that are loaded, by name.
        there: What the robot offers.
        states: Which of its hardware is active.
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
        names = [name for name in needed if name not in known]
        problems += [_missing(kind, n, known, others, there) for n in names]
    off = [n for n in system.command_interfaces if _is_off(n, there, states)]
    off += [
        n for n in system.state_interfaces if _is_off(n, there, states, is_state=True)
    ]
    if off:
        problems.append(
            f"{off[0]!r} belongs to hardware component {there.blocks[off[0]]!r}, "
            "which hardware_components_initial_state leaves inactive"
        )
    return tuple(dict.fromkeys(problems))  # A joint may lack several times.


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
    name: str,
    known: Collection[str],
    others: Mapping[str, ControllerInterface],
    there: Surroundings,
) -> str:
    joint, _, interface = name.rpartition("/")
    has = sorted(n[len(joint) + 1 :] for n in known if n.startswith(f"{joint}/"))
    if joint.partition("/")[0] in others:
        owner = joint.partition("/")[0]
        offered = sorted(n for n in known if n.startswith(f"{owner}/"))
        return f"controller {owner!r} has no {kind} interface {name!r}; {offered}"
    if joint in there.joint_types or has:
        return f"joint {joint!r} has no {kind} interface {interface!r}; it has {has}"
    return f"the robot has no joint {joint!r}; {suggest(joint, there.joint_types)}"
