"""What follows what in `mock_components/GenericSystem`: names to places in vectors.

The rules are those of ros2_control's ``generic_system.cpp``, version 6.8.0.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite, nan
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.control.generic_system_parameters import MODES, Parameters
from arm_drake.description.elements import parse_bool, parse_number
from arm_drake.description.hardware_info import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)
from arm_drake.description.joints import JointInfo
from arm_drake.description.tree import last_master
from arm_drake.interfaces import EFFORT, POSITION

Indices = NDArray[np.intp]

# Place of what isn't there.
_ABSENT: Final = -1


class JointLayout(NamedTuple):
    """Where position, velocity and acceleration of a joint stand; -1 is nowhere."""

    name: str
    states: tuple[int, ...]
    commands: tuple[int, ...]


class MirrorLayout(NamedTuple):
    """Which commands become states; of several for one state the last holds."""

    # Places of commands and states, and what is added to each.
    sources: Indices
    targets: Indices
    offsets: Array

    # Whether a command must not be infinite.
    is_checked: NDArray[np.bool_]

    # Places of states that are 0 or 1.
    bools: Indices

    @classmethod
    def of(
        cls,
        block: HardwareInfo,
        commands: Mapping[str, int],
        states: Mapping[str, int],
        parameters: Parameters,
    ) -> Self:
        """Return the layout of a block with these places of interfaces."""
        rows: list[tuple[int, int, float, bool]] = []
        bools = []
        custom = parameters.custom_interface_with_following_offset
        components = (*block.joints, *block.sensors, *block.gpios)
        for i, component in enumerate(components):
            is_joint = i < len(block.joints)
            for interface in component.state_interfaces:
                name = f"{component.name}/{interface.name}"
                source, target = commands.get(name, _ABSENT), states[name]
                if is_joint and interface.name in parameters.calculated:
                    if source != _ABSENT and not parameters.calculate_dynamics:
                        rows.append((source, target, parameters.position_offset, False))
                    continue
                # Upstream mirrors no other type.
                if source != _ABSENT and interface.data_type in ("double", "bool"):
                    rows.append((source, target, 0.0, True))
                    bools += [target] if interface.data_type == "bool" else []
                position = commands.get(f"{component.name}/{POSITION}", _ABSENT)
                if is_joint and interface.name == custom and position != _ABSENT:
                    offset = parameters.position_state_following_offset
                    rows.append((position, target, offset, False))
        sources, targets, offsets, is_checked = _columns(rows)
        return cls(
            sources.astype(np.intp),
            targets.astype(np.intp),
            offsets,
            is_checked.astype(bool),
            np.array(bools, dtype=np.intp),
        )


class MimicLayout(NamedTuple):
    """Which states follow others: target = factor * source + offset."""

    sources: Indices
    targets: Indices
    factors: Array
    offsets: Array

    @classmethod
    def of(
        cls,
        block: HardwareInfo,
        joints: Iterable[JointInfo],
        states: Mapping[str, int],
        *,
        humble: bool,
    ) -> tuple[Self, tuple[str, ...]]:
        """Return the layout, and warnings about joints that can't follow."""
        by_name = {joint.name: joint for joint in joints}
        in_block = {component.name for component in block.joints}
        rows: list[tuple[int, int, float, float]] = []
        warnings = []
        for component in block.joints:
            joint = by_name.get(component.name)
            if joint is None or joint.mimic is None:
                continue
            master, factor, offset = last_master(joint, by_name)
            if master not in in_block:
                warnings.append(
                    f"joint {joint.name!r} mimics {master!r}, which the block lacks: "
                    "it stays where it is"
                )
            for name in (*MODES, EFFORT) if humble else MODES:
                source = states.get(f"{master}/{name}", _ABSENT)
                target = states.get(f"{joint.name}/{name}", _ABSENT)
                if master in in_block and _ABSENT not in (source, target):
                    shift = offset if name == POSITION else 0.0
                    rows.append((source, target, factor, shift))
        sources, targets, factors, offsets = _columns(rows)
        layout = cls(sources.astype(np.intp), targets.astype(np.intp), factors, offsets)
        return layout, tuple(warnings)


def find_interfaces(
    block: HardwareInfo, parameters: Parameters
) -> tuple[dict[str, int], dict[str, float]]:
    """Return places of the command interfaces, and initial values of the states.

    Sensors have command interfaces only if they are mocked; those of mocked sensors and
    GPIOs are created from their state interfaces.
    """
    commands: dict[str, None] = {}
    initial: dict[str, float] = {}
    for components, has_commands, is_mocked in (
        (block.joints, True, False),
        (block.sensors, False, parameters.mock_sensor_commands),
        (block.gpios, True, parameters.mock_gpio_commands),
    ):
        for component in components:
            listed = component.command_interfaces if has_commands else ()
            mocked = component.state_interfaces if is_mocked else ()
            for interface in (*listed, *mocked):
                commands[f"{component.name}/{interface.name}"] = None
            for interface in component.state_interfaces:
                value = _initial_value(component, interface)
                if components is block.joints:
                    value = _initial_joint_value(interface, value, parameters)
                initial[f"{component.name}/{interface.name}"] = value
    return {name: i for i, name in enumerate(commands)}, initial


def find_joints(
    block: HardwareInfo,
    commands: Mapping[str, int],
    states: Mapping[str, int],
    parameters: Parameters,
) -> tuple[tuple[JointLayout, ...], int]:
    """Return the layout of all joints, and how many of their states are hidden.

    Humble remembers positions, velocities and accelerations that are no interfaces;
    they stand behind the states.
    """
    joints, num_hidden = [], 0
    for component in block.joints:
        names = [f"{component.name}/{mode}" for mode in MODES]
        places = [states.get(name, _ABSENT) for name in names]
        if parameters.humble and parameters.calculate_dynamics:
            for i, place in enumerate(places):
                if place == _ABSENT:
                    places[i] = len(states) + num_hidden
                    num_hidden += 1
        given = tuple(commands.get(name, _ABSENT) for name in names)
        joints.append(JointLayout(component.name, tuple(places), given))
    return tuple(joints), num_hidden


def _columns(rows: Sequence[tuple[float, float, float, float]]) -> Array:
    return np.array(rows, dtype=float).reshape(-1, 4).T


def _initial_value(component: ComponentInfo, interface: InterfaceInfo) -> float:
    """Return what is said about the start, or NaN.

    The joint's parameter, such as `initial_position`, is the form up to Galactic.
    """
    value = interface.initial_value
    if value is None:
        old = component.parameters.get(f"initial_{interface.name}", "")
        value = parse_number(old)
    if value is None and interface.data_type == "bool":
        return float(parse_bool(interface.parameters.get("initial_value", "")) or False)
    return nan if value is None or not isfinite(value) else value


def _initial_joint_value(
    interface: InterfaceInfo, value: float, parameters: Parameters
) -> float:
    # Humble leaves custom interfaces unknown.
    if not isfinite(value) and (
        not parameters.humble or interface.name in (*MODES, EFFORT)
    ):
        value = 0.0
    if interface.name == POSITION and not parameters.humble:
        value += parameters.position_offset
    return value
