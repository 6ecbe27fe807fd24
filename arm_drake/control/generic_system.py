"""Hardware without physics, `mock_components/GenericSystem`: commands become states.

The rules are those of ros2_control's ``generic_system.cpp`` (version 6.8.0);
`fake_components/GenericSystem` and parameters that start with `fake_` are older names.
Where upstream takes a part of a joint's name for the joint, the whole name counts here.

Units are those of the interfaces: [rad], [rad/s], [rad/s^2] for a revolute joint and
[m], [m/s], [m/s^2] for a prismatic one.
"""

import dataclasses as dc
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from math import isfinite, nan
from typing import Final, NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array, Indices, Mask
from arm_drake.description.elements import parse_bool, parse_number
from arm_drake.description.joints import JointInfo, last_master
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
)
from arm_drake.errors import ArmDrakeError, DescriptionError, suggest
from arm_drake.importing import dataclass
from arm_drake.interfaces import ACCELERATION, EFFORT, POSITION, VELOCITY
from arm_drake.messages import Message

# What a joint can be commanded by with `calculate_dynamics`.
MODES: Final = (POSITION, VELOCITY, ACCELERATION)


class Parameters(NamedTuple):
    """Parameters of `<hardware>`, with its names, and whether humble's rules apply."""

    calculate_dynamics: bool
    disable_commands: bool
    mock_sensor_commands: bool
    mock_gpio_commands: bool
    position_state_following_offset: float
    custom_interface_with_following_offset: str
    humble: bool

    @classmethod
    def of(cls, block: HardwareInfo, *, humble: bool) -> Self:
        """Return the parameters of a block."""
        offset = _number(block, "position_state_following_offset")
        custom = block.parameters.get("custom_interface_with_following_offset", "")
        return cls(
            _bool(block, "calculate_dynamics"),
            _bool(block, "disable_commands"),
            _bool(block, "mock_sensor_commands", "fake_sensor_commands"),
            _bool(block, "mock_gpio_commands", "fake_gpio_commands"),
            offset or 0.0,
            # Upstream reads it only beside an offset, be it 0.
            "" if offset is None else custom,
            humble,
        )

    @property
    def position_offset(self) -> float:
        """Offset of the positions themselves."""
        custom = self.custom_interface_with_following_offset
        return 0.0 if custom else self.position_state_following_offset

    @property
    def calculated(self) -> tuple[str, ...]:
        """Interfaces of joints that aren't simply mirrored."""
        return MODES if self.calculate_dynamics else (POSITION,)

    def warnings(self, block: HardwareInfo) -> Iterator[str]:
        """Yield warnings about the parameters."""
        if self.disable_commands:
            yield "disable_commands is true: the states never change"
        custom = self.custom_interface_with_following_offset
        others = {i.name for c in block.joints for i in c.state_interfaces}
        others -= set(self.calculated)
        if custom and custom not in others:
            yield (
                f"custom_interface_with_following_offset is {custom!r}, which no joint "
                "mirrors as a state interface: the offset is added to nothing"
            )


def _bool(block: HardwareInfo, *names: str) -> bool:
    """Return the first of these parameters that is set, or False."""
    for name in names:
        text = block.parameters.get(name)
        if text is not None:
            value = parse_bool(text)
            if value is None:
                raise _error(block, name, f"expected true or false, got {text!r}")
            return value
    return False


def _number(block: HardwareInfo, name: str) -> float | None:
    text = block.parameters.get(name)
    if text is None:
        return None
    value = parse_number(text)
    if value is None or not isfinite(value):
        raise _error(block, name, f"expected a finite number, got {text!r}")
    return value


def _error(block: HardwareInfo, name: str, problem: str) -> DescriptionError:
    where = f"ros2_control {block.name!r}, <hardware> parameter {name!r}"
    return DescriptionError(problem, where=where)


# Place of what isn't there.
_ABSENT: Final = -1


class JointLayout(NamedTuple):
    """Indices of a joint's position, velocity and acceleration; -1 is none."""

    name: str
    states: tuple[int, ...]
    commands: tuple[int, ...]


class MirrorLayout(NamedTuple):
    """Commands mirrored as states; of several for one state the last holds."""

    # Places of commands and states, and what is added to each.
    sources: Indices
    targets: Indices
    offsets: Array

    # Whether a command must not be infinite.
    is_checked: Mask

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
    """States that follow others: target = factor * source + offset."""

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
        command_indices = tuple(commands.get(name, _ABSENT) for name in names)
        joints.append(JointLayout(component.name, tuple(places), command_indices))
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


class InfiniteCommandError(ArmDrakeError, ValueError):
    """A command that becomes a state is infinite."""


@dc.dataclass(frozen=True, eq=False, slots=True)
class GenericSystemState(Message):
    """States that the hardware reports, and those that the next read needs."""

    # Values of the state interfaces, NaN where nothing is known; read-only.
    states: Array

    # Interface by which each joint of the block is commanded.
    modes: tuple[str, ...]

    # Positions, velocities and accelerations that are no interfaces (Humble).
    hidden: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class GenericSystem:
    """A block of hardware that mirrors its commands; made by `from_component`.

    k is the number of its state interfaces, m that of its command interfaces.
    """

    # Full names, in the order of the file: joints, then sensors, then GPIOs.
    command_interfaces: tuple[str, ...]
    state_interfaces: tuple[str, ...]

    # What a user should be told about the parameters.
    warnings: tuple[str, ...]

    _parameters: Parameters
    _initial: Array
    _joints: tuple[JointLayout, ...]
    _mirror: MirrorLayout
    _mimics: MimicLayout
    _num_hidden: int

    @classmethod
    def from_component(
        cls, block: HardwareInfo, joints: Iterable[JointInfo], *, humble: bool = False
    ) -> Self:
        """Return the hardware that a `<ros2_control>` block describes.

        Of humble, positions are integrated with the velocity before the step, the
        following offset counts in each such step but not at the start, and efforts of
        mimic joints follow too. A parameter without a valid value is a
        DescriptionError.
        """
        parameters = Parameters.of(block, humble=humble)
        commands, initial = find_interfaces(block, parameters)
        states = {name: i for i, name in enumerate(initial)}
        found, num_hidden = find_joints(block, commands, states, parameters)
        mimics, warnings = MimicLayout.of(block, joints, states, humble=humble)
        values = np.array(list(initial.values()), dtype=float)
        values.setflags(write=False)
        return cls(
            command_interfaces=tuple(commands),
            state_interfaces=tuple(states),
            warnings=(*parameters.warnings(block), *warnings),
            _parameters=parameters,
            _initial=values,
            _joints=found,
            _mirror=MirrorLayout.of(block, commands, states, parameters),
            _mimics=mimics,
            _num_hidden=num_hidden,
        )

    @property
    def calculated(self) -> tuple[str, ...]:
        """Names of the command interfaces that joints move by."""
        return self._parameters.calculated

    def initial_states(self) -> Array:
        """Return the states before the first read, shape (k,); NaN where unknown.

        Those of joints are 0 if nothing is said, also where a joint mimics another.
        """
        return self._initial

    def start(self, states: Array | None = None) -> GenericSystemState:
        """Return the state before the first read; joints are commanded by position.

        `states` shape (k,), None is `initial_states`.
        """
        values = self._initial if states is None else np.array(states, dtype=float)
        values.setflags(write=False)
        modes = (POSITION,) * len(self._joints)
        return GenericSystemState(values, modes, (0.0,) * self._num_hidden)

    def prepare_switch(self, start: Collection[str], stop: Collection[str]) -> str:
        """Return why interfaces can't be claimed together, "" if they can.

        Only `calculate_dynamics` has an objection: it needs exactly one of position,
        velocity and acceleration on each joint of which anything is claimed.

        `start` are full names of command interfaces; those that `stop` don't matter.
        """
        if not self._parameters.calculate_dynamics:
            return ""
        faults = []
        for name in start:
            if name not in self.command_interfaces:
                hint = suggest(name, self.command_interfaces)
                faults.append(f"no command interface {name!r}; {hint}")
        for joint in self._joints:
            claimed = [name for name in start if name.rpartition("/")[0] == joint.name]
            modes = [n for n in claimed if n.rpartition("/")[2] in MODES]
            if claimed and len(modes) != 1:
                faults.append(
                    f"joint {joint.name!r}: calculate_dynamics needs exactly one of "
                    f"{', '.join(MODES)} to be claimed, got {sorted(claimed)}"
                )
        return "; ".join(faults)

    def modes_after(
        self, modes: tuple[str, ...], start: Collection[str], stop: Collection[str]
    ) -> tuple[str, ...]:
        """Return by which interface each joint is commanded after a switch.

        `modes` are those before it; joints whose interfaces `stop` keep theirs.
        """
        claims = [name.rpartition("/") for name in start]
        latest = {joint: mode for joint, _, mode in claims if mode in MODES}
        order = zip(self._joints, modes, strict=True)
        return tuple(latest.get(joint.name, mode) for joint, mode in order)

    def read(
        self, state: GenericSystemState, commands: Array, period: float
    ) -> GenericSystemState:
        """Return the state after a read, a period after the last [s].

        A command, shape (m,), of NaN is none: it leaves the state. So does an infinite
        one where positions, or dynamics, are calculated; elsewhere it is an
        InfiniteCommandError, as upstream.
        """
        if self._parameters.disable_commands:
            return state
        states, hidden = state.states.copy(), state.hidden
        if self._parameters.calculate_dynamics:
            hidden = self._integrate(states, state, commands, period)
        mirror, mimics = self._mirror, self._mimics
        targets, values = mirror.targets, commands[mirror.sources] + mirror.offsets
        is_set = np.isfinite(values)
        if not is_set.all():
            for i in np.flatnonzero(np.isinf(values) & mirror.is_checked):
                name = self.command_interfaces[mirror.sources[i]]
                problem = f"{name}: expected a finite command, got {values[i]}"
                raise InfiniteCommandError(problem)
            targets, values = targets[is_set], values[is_set]
        states[targets] = values
        if len(mirror.bools):
            states[mirror.bools] = states[mirror.bools] != 0.0
        if len(mimics.targets):
            followed = mimics.factors * states[mimics.sources] + mimics.offsets
            states[mimics.targets] = followed
        states.flags.writeable = False
        return GenericSystemState(states, state.modes, hidden)

    def _integrate(
        self, states: Array, state: GenericSystemState, commands: Array, period: float
    ) -> tuple[float, ...]:
        """Move the joints in ``states``, and return what is hidden."""
        # What isn't there is at index -1.
        values = [*state.states.tolist(), *state.hidden, nan]
        command_values = [*commands.tolist(), nan]
        offset = self._parameters.position_offset
        step = _step_explicitly if self._parameters.humble else _step
        for joint, mode in zip(self._joints, state.modes, strict=True):
            q, v, a = (values[i] for i in joint.states)
            command = command_values[joint.commands[MODES.index(mode)]]
            moved = step(mode, command, q, v, a, period, offset)
            for i, value in zip(joint.states, moved, strict=True):
                if i >= 0 and isfinite(value):
                    values[i] = value
        states[:] = values[: len(states)]
        return tuple(values[len(states) : -1])


def _step(
    mode: str,
    command: float,
    q: float,
    v: float,
    a: float,
    period: float,
    offset: float,
) -> tuple[float, float, float]:
    """Return position, velocity and acceleration after a step; NaN where unknown."""
    if mode == POSITION:
        # Without a command all of it is NaN, which changes nothing.
        q_old, q = q, command + offset
        v_old, v = (v if isfinite(v) else 0.0), (q - q_old) / period
        return q, v, (v - v_old) / period
    if mode == VELOCITY:
        if isfinite(command):
            v_old, v = (v if isfinite(v) else 0.0), command
            a = (v - v_old) / period
        # Upstream adds the offset to a position only where there is no velocity.
        return q + (v * period if isfinite(v) else offset), v, a
    a = command if isfinite(command) else a
    v = (v if isfinite(v) else 0.0) + (a * period if isfinite(a) else 0.0)
    return q + v * period, v, a


def _step_explicitly(
    mode: str,
    command: float,
    q: float,
    v: float,
    a: float,
    period: float,
    offset: float,
) -> tuple[float, float, float]:
    """Return the same in Humble's order: the position moves first."""
    if mode == POSITION:
        return _step(mode, command, q, v, a, period, offset)
    q += v * period + offset
    if mode == VELOCITY:
        return (q, command, (command - v) / period) if isfinite(command) else (q, v, a)
    return q, v + a * period, command if isfinite(command) else a
