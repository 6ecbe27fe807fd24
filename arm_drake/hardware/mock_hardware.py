"""Hardware blocks that mirror commands to states, as mock_components has them.

The preset `kinematic`: every block is a `GenericSystem`, whatever its plugin is.
"""

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, State

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.generic_system import GenericSystem, GenericSystemState
from arm_drake.description.joints import JointInfo, last_master
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.hardware.hardware import Hardware
from arm_drake.interfaces import CLAIMED_PORT
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.python_system import PythonSystem
from arm_drake.timing import cycle_at


class _Read(NamedTuple):
    """Result of the read of a cycle."""

    # Number of the cycle; -1 before the first one.
    number: int

    blocks: tuple[GenericSystemState, ...]

    # Everything that is measured, in the order of the surroundings.
    measured: Array

    # Command interfaces that were claimed.
    claimed: tuple[str, ...]

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self


class MockHardware(PythonSystem):
    """Hardware blocks that mirror commands to states, one cycle later.

    .. pydrake_system::

        name: MockHardware
        input_ports:
        - command_values
        - claimed
        output_ports:
        - read
        - joint_motions
        - joint_states
        - state_interfaces

    ================  ====  ======  ==================================================
    port              size  unit    meaning
    ================  ====  ======  ==================================================
    command_values    k     rad,    values of all command interfaces
    claimed           --    --      tuple of the names of those that are claimed
    read              --    --      what the last read leaves behind
    joint_motions     2J    rad,    positions and velocities of the J joints
    joint_states      3J    rad,    the same, and efforts
    state_interfaces  --    rad,    the same, and all further state interfaces
    ================  ====  ======  ==================================================

    A read is part of a cycle of the manager: what was written in the last one is
    reported in this one. Joints that no block reports stay where they are, or follow
    the joint that they mimic.
    """

    def __init__(
        self,
        robot: Robot,
        blocks: Sequence[GenericSystem],
        order: Sequence[str],
        measured: Sequence[str],
        period: float,
    ) -> None:
        """Create the system; `order` names the values, `measured` what is read."""
        super().__init__()
        self._blocks = tuple(blocks)
        self._period = period
        self._joints = {j.name: j for j in robot.description.movable_joints}
        commands = {name: index for index, name in enumerate(order)}
        rows = {name: index for index, name in enumerate(measured)}
        self._commands_at = [
            [commands[name] for name in block.command_interfaces] for block in blocks
        ]
        self._measured_at = [
            [rows[name] for name in block.state_interfaces] for block in blocks
        ]
        known = {name for block in blocks for name in block.state_interfaces}
        self._followers = [
            (rows[f"{name}/{interface}"], rows[f"{master}/{interface}"], factor, shift)
            for name, master, factor, offset in _followers(self._joints)
            for interface, shift in (
                (interfaces.POSITION, offset),
                (interfaces.VELOCITY, 0.0),
            )
            if f"{name}/{interface}" not in known
        ]
        self._values = self.DeclareVectorInputPort(interfaces.VALUES_PORT, len(order))
        self._claimed = self.DeclareAbstractInputPort(
            CLAIMED_PORT, AbstractValue.Make(())
        )
        self._state = self.DeclareAbstractState(
            AbstractValue.Make(self._start(robot.initial_positions, measured))
        )
        tickets = {self.time_ticket(), self.xa_ticket()}
        tickets |= {self._values.ticket(), self._claimed.ticket()}
        self._read = self.DeclareAbstractOutputPort(
            "read", lambda: AbstractValue.Make(()), self._calc_read, tickets
        )
        for name, size in (
            ("joint_motions", 2 * len(self._joints)),
            ("joint_states", 3 * len(self._joints)),
            (interfaces.STATE_PORT, len(measured)),
        ):
            self._declare(name, size)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _declare(self, name: str, size: int) -> None:
        """Declare an output port with the first of what is measured."""

        def calc(context: Context, output: BasicVector) -> None:
            read: _Read = self._read.Eval(context)
            output.SetFromVector(read.measured[:size])

        self.DeclareVectorOutputPort(name, size, calc)

    def _start(self, initial: Mapping[str, float], measured: Sequence[str]) -> _Read:
        """Return what is read before the first cycle."""
        positions = {f"{n}/{interfaces.POSITION}": q for n, q in initial.items()}
        states = []
        for block in self._blocks:
            own = zip(block.state_interfaces, block.initial_states(), strict=True)
            states.append(block.start(np.array([positions.get(n, x) for n, x in own])))
        values = np.array([positions.get(name, 0.0) for name in measured])
        first = _Read(-1, tuple(states), values, ())
        return first._replace(measured=self._measure(first.measured, states))

    def _measure(self, last: Array, states: Sequence[GenericSystemState]) -> Array:
        measured = last.copy()
        for at, state in zip(self._measured_at, states, strict=True):
            measured[at] = state.states
        for row, master, factor, offset in self._followers:
            measured[row] = factor * measured[master] + offset
        return measured

    def _calc_read(self, context: Context, output: AbstractValue) -> None:
        last: _Read = context.get_abstract_state(self._state).get_value()
        number = cycle_at(context.get_time(), self._period)
        # The first cycle reads what there is; nothing has been written yet.
        if number is None or number == last.number:
            output.set_value(last)
            return
        values, claimed = self._values.Eval(context), self._claimed.Eval(context)
        states, new = [], [name for name in claimed if name not in last.claimed]
        for block, at, state in zip(
            self._blocks, self._commands_at, last.blocks, strict=True
        ):
            if new:
                modes = block.modes_after(state.modes, new, ())
                state = dc.replace(state, modes=modes)
            states.append(block.read(state, values[at], self._period))
        measured = self._measure(last.measured, states)
        output.set_value(_Read(number, tuple(states), measured, claimed))

    def _update(self, context: Context, state: State) -> None:
        read = self._read.Eval(context)
        state.get_mutable_abstract_state(self._state).set_value(read)


def _followers(
    joints: Mapping[str, JointInfo],
) -> list[tuple[str, str, float, float]]:
    """Return the mimic joints, their last masters, factors and offsets."""
    return [
        (name, *last_master(joint, joints))
        for name, joint in joints.items()
        if joint.mimic is not None
    ]


def make_blocks(robot: Robot) -> list[GenericSystem]:
    """Return the hardware blocks of a robot."""
    joints = robot.description.joints
    return [
        GenericSystem.from_component(block, joints, humble=robot.distro == "humble")
        for block in robot.description.hardware
    ]


def report_blocks(
    robot: Robot, blocks: Sequence[GenericSystem], report: LoadReport
) -> dict[str, tuple[str, ...]]:
    """Report what blocks warn about; return the interfaces that each joint moves by."""
    moving: dict[str, tuple[str, ...]] = {}
    for info, block in zip(robot.description.hardware, blocks, strict=True):
        done, where = "as mock_components has it", f"ros2_control {info.name!r}"
        for text in block.warnings:
            report.add("warning", "ignored", text, done, where=where)
        moving |= dict.fromkeys((j.name for j in info.joints), block.calculated)
    return moving


def add_mock_hardware(
    builder: DiagramBuilder,
    robot: Robot,
    blocks: Sequence[GenericSystem],
    order: Sequence[str],
    hardware_interfaces: HardwareInterfaces,
    prefix: str,
    period: float,
) -> Hardware:
    """Add the hardware of a robot whose commands become its state.

    `order` names the command values; the period is the manager's in Drake's time [s].
    """
    hardware = builder.AddNamedSystem(
        f"{prefix}hardware",
        MockHardware(robot, blocks, order, hardware_interfaces.measured, period),
    )
    return Hardware(
        commanded=(),
        command=None,
        joint_states=hardware.GetOutputPort("joint_states"),
        joint_motions=hardware.GetOutputPort("joint_motions"),
        friction=None,
        drive=None,
        everything=hardware.GetOutputPort(interfaces.STATE_PORT),
        values=hardware.GetInputPort(interfaces.VALUES_PORT),
        claimed=hardware.GetInputPort(CLAIMED_PORT),
    )
