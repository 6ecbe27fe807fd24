"""Hardware without physics: commands become states, as in `mock_components`.

The rules are those of ros2_control's `mock_components/GenericSystem`
(``generic_system.cpp``, version 6.8.0); `fake_components/GenericSystem` and parameters
that start with `fake_` are older names. Where upstream takes a part of a joint's name
for the joint, the whole name counts here.

Units are those of the interfaces: [rad], [rad/s], [rad/s^2] for a revolute joint and
[m], [m/s], [m/s^2] for a prismatic one.
"""

import dataclasses as dc
from collections.abc import Collection, Iterable
from math import isfinite, nan
from typing import Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.generic_system_layout import (
    JointLayout,
    MimicLayout,
    MirrorLayout,
    find_interfaces,
    find_joints,
)
from arm_drake.control.generic_system_parameters import MODES, Parameters
from arm_drake.description.hardware_info import HardwareInfo
from arm_drake.description.joints import JointInfo
from arm_drake.errors import ArmDrakeError, suggest
from arm_drake.interfaces import POSITION, VELOCITY
from arm_drake.messages import Message


class InfiniteCommandError(ArmDrakeError, ValueError):
    """A command that becomes a state is infinite."""


@dc.dataclass(frozen=True, eq=False, slots=True)
class GenericSystemState(Message):
    """What the hardware reports, and what it needs for the next read."""

    # Values of the state interfaces, NaN where nothing is known; read-only.
    states: Array

    # Interface by which each joint of the block is commanded.
    modes: tuple[str, ...]

    # Positions, velocities and accelerations that are no interfaces (Humble).
    hidden: tuple[float, ...] = ()


@dc.dataclass(frozen=True, eq=False)
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

        Args:
            block: The block.
            joints: Joints of the robot, with the mimic that holds.
            humble: Whether the rules are Humble's: positions are integrated with the
                velocity before the step, the following offset counts in each such step
                but not at the start, and efforts of mimic joints follow too.

        Raises:
            DescriptionError: If a parameter of the hardware has no valid value.
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

    def initial_commands(self) -> Array:
        """Return the commands before there are any: NaN, shape (m,)."""
        return np.full(len(self.command_interfaces), nan)

    def start(self, states: Array | None = None) -> GenericSystemState:
        """Return the state before the first read; joints are commanded by position.

        Args:
            states: States to start from, shape (k,); None is `initial_states`.
        """
        values = self._initial if states is None else np.array(states, dtype=float)
        values.setflags(write=False)
        modes = (POSITION,) * len(self._joints)
        return GenericSystemState(values, modes, (0.0,) * self._num_hidden)

    def prepare_switch(self, start: Collection[str], stop: Collection[str]) -> str:
        """Return why interfaces can't be claimed together, "" if they can.

        Only `calculate_dynamics` has an objection: it needs exactly one of position,
        velocity and acceleration on each joint of which anything is claimed.

        Args:
            start: Full names of the command interfaces to be claimed.
            stop: Those to be released; they don't matter.
        """
        del stop
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

        Args:
            modes: The same before it, as in the state.
            start: Full names of the command interfaces that are claimed.
            stop: Those that are released; their joints keep their modes.
        """
        del stop
        claims = [name.rpartition("/") for name in start]
        latest = {joint: mode for joint, _, mode in claims if mode in MODES}
        order = zip(self._joints, modes, strict=True)
        return tuple(latest.get(joint.name, mode) for joint, mode in order)

    def read(
        self, state: GenericSystemState, commands: Array, period: float
    ) -> GenericSystemState:
        """Return the state after a read.

        A command of NaN is none: it leaves the state. So does an infinite one where
        positions, or dynamics, are calculated; elsewhere it is an error, as upstream.

        Args:
            state: State after the last read.
            commands: Commands, shape (m,).
            period: Time since the last read [s], above 0.

        Raises:
            InfiniteCommandError: If an infinite command were to become a state.
        """
        if self._parameters.disable_commands:
            return state
        states, hidden = state.states.copy(), state.hidden
        if self._parameters.calculate_dynamics:
            hidden = self._integrate(states, state, commands, period)
        mirror, mimics = self._mirror, self._mimics
        targets, values = mirror.targets, commands[mirror.sources] + mirror.offsets
        is_given = np.isfinite(values)
        if not is_given.all():
            for i in np.flatnonzero(np.isinf(values) & mirror.is_checked):
                name = self.command_interfaces[mirror.sources[i]]
                problem = f"{name}: expected a finite command, got {values[i]}"
                raise InfiniteCommandError(problem)
            targets, values = targets[is_given], values[is_given]
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
        given = [*commands.tolist(), nan]
        offset = self._parameters.position_offset
        step = _step_explicitly if self._parameters.humble else _step
        for joint, mode in zip(self._joints, state.modes, strict=True):
            q, v, a = (values[i] for i in joint.states)
            command = given[joint.commands[MODES.index(mode)]]
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
