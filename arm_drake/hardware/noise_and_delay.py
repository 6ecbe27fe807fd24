"""Noise of state interfaces, and delays of state and command interfaces.

They stand between the plant and the controllers; rollouts have what is true. Both are
counted in cycles of the controller manager: in cycle k controllers read what was
measured in cycle k - n, and the servo follows what was commanded in cycle k - m.
"""

import dataclasses as dc
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    InputPort,
    OutputPort,
    State,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.errors import InputError, suggest
from arm_drake.hardware.hardware import Hardware
from arm_drake.hardware.wiring import Wiring
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.options import SimulationOptions
from arm_drake.python_system import PythonSystem

# Some part of a period by which a time may be before its cycle.
_EARLY = 1e-6


class _Delay(PythonSystem):
    """Holds the last n values of a vector of size m, in its discrete state.

    That is n m numbers, the oldest first, and whether they were filled. In the first
    cycle all of them become the first value: before, things were as they are then.
    """

    def __init__(self, size: int, delay: int) -> None:
        super().__init__()
        self._size, self._delay = size, delay
        self._state = int(self.DeclareDiscreteState(delay * size + 1)) if delay else -1

    def _oldest(self, context: Context) -> Array | None:
        """Return the oldest value; None if there is none yet, or no delay."""
        if not self._delay:
            return None
        saved = context.get_discrete_state(self._state).value()
        return saved[: self._size] if saved[-1] > 0.5 else None

    def _push(self, context: Context, state: DiscreteValues, value: Array) -> None:
        """Put a value behind the others, and drop the oldest."""
        saved = context.get_discrete_state(self._state).value()
        is_filled = saved[-1] > 0.5
        older = saved[self._size : -1] if is_filled else np.tile(value, self._delay - 1)
        state.set_value(self._state, np.concatenate((older, value, [1.0])))


class MeasuredStates(_Delay):
    """State interfaces with noise and delay, as they reach the controllers.

    .. pydrake_system::

        name: MeasuredStates
        input_ports:
        - true_states
        output_ports:
        - state_interfaces

    ================  ====  ======  ==================================================
    port              size  unit    meaning
    ================  ====  ======  ==================================================
    true_states       m     rad,    as the physics has them
                            rad/s,
                            N·m ..
    state_interfaces  m     the     in cycle k, those of cycle k - n, with the noise
                            same    that they had then
    ================  ====  ======  ==================================================

    Noise is Gaussian and white, one draw for each interface and cycle. It follows from
    seed, robot and number of the cycle alone, and is no state. Between two cycles it
    stays. The state is what was measured in the last n cycles, a discrete update.
    """

    def __init__(
        self, deviations: Array, seed: Sequence[int], *, delay: int, period: float
    ) -> None:
        """Create it for standard deviations, shape (m,), and the period [s].

        Draws of two such systems with one seed are the same, as far as both have them.
        """
        super().__init__(len(deviations), delay)
        self._deviations, self._seed, self._period = deviations, tuple(seed), period
        self._is_noisy = bool(deviations.any())
        self._true = self.DeclareVectorInputPort("true_states", len(deviations))
        tickets = {self._true.ticket(), self.time_ticket()}
        if delay:
            tickets.add(self.xd_ticket())
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareVectorOutputPort(
            interfaces.STATE_PORT, len(deviations), self._calc_states, tickets
        )

    def _measure(self, context: Context) -> Array:
        true: Array = self._true.Eval(context)
        if not self._is_noisy:
            return true
        number = math.floor(context.get_time() / self._period + _EARLY)
        random = np.random.default_rng((*self._seed, max(0, number)))
        return true + self._deviations * random.standard_normal(self._size)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        self._push(context, state, self._measure(context))

    def _calc_states(self, context: Context, output: BasicVector) -> None:
        oldest = self._oldest(context)
        output.SetFromVector(self._measure(context) if oldest is None else oldest)


class DelayedCommands(_Delay):
    """Commands on their way to the hardware.

    .. pydrake_system::

        name: DelayedCommands
        input_ports:
        - commands
        output_ports:
        - delayed_commands

    ================  ====  ====  ====================================================
    port              size  unit  meaning
    ================  ====  ====  ====================================================
    commands          m     any   what the manager says from cycle k on
    delayed_commands  m     any   what it said from cycle k - n on
    ================  ====  ====  ====================================================

    The state is what it said in the last n cycles. It is an unrestricted update, as the
    manager's: both are done before the step of the plant that begins with the cycle.
    """

    def __init__(self, size: int, *, delay: int, period: float) -> None:
        """Create it for m numbers, a delay in cycles, at least 1, and their period."""
        super().__init__(size, delay)
        self._commands = self.DeclareVectorInputPort("commands", size)
        self.DeclareVectorOutputPort(
            "delayed_commands",
            size,
            self._calc_commands,
            {self._commands.ticket(), self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        # The manager's update of this instant isn't seen yet.
        value = self._commands.Eval(context)
        self._push(context, state.get_mutable_discrete_state(), value)

    def _calc_commands(self, context: Context, output: BasicVector) -> None:
        oldest = self._oldest(context)
        output.SetFromVector(self._commands.Eval(context) if oldest is None else oldest)


def find_deviations(names: Sequence[str], noise: Mapping[str, float]) -> Array:
    """Return the standard deviations of state interfaces, shape of the names.

    A whole name such as "joint1/position" goes before that of a component, such as
    "imu", and this before a kind such as "position", which is of all that have it.
    Orientations have none: with noise on its numbers a quaternion is none.
    """
    found = (
        next((noise[n] for n in _names_of(name) if n in noise), 0) for name in names
    )
    return np.array(list(found), dtype=float)


def _names_of(name: str) -> tuple[str, ...]:
    """Return keys for the noise of a state interface; () if it has none."""
    component, _, interface = name.rpartition("/")
    if interface in interfaces.ORIENTATIONS:
        return ()
    kind, dot, _ = interface.rpartition(".")
    group = (f"{component}/{kind}", kind) if dot else ()
    return (name, *group[:1], interface, *group[1:])


def check_noise(
    noise: Mapping[str, float], robots: Iterable[HardwareInterfaces]
) -> None:
    """Raise InputError for noise of what no robot measures."""
    known = {
        each
        for offered in robots
        for name in offered.measured
        if name not in offered.stored
        for each in _names_of(name)
    }
    for name in noise:
        if name not in known:
            text = f"state_noise: no state interface {name!r} is measured"
            raise InputError(f"{text}; {suggest(name, known)}")


def add_noise_and_delay(
    hardware: Hardware,
    builder: DiagramBuilder,
    offered: HardwareInterfaces,
    options: SimulationOptions,
    prefix: str,
    period: float,
) -> Hardware:
    """Return the hardware of a robot as its controllers see it.

    `period` is the manager's [s].
    """
    delay, J = options.state_delay, len(offered.joint_types)
    saved = [name in offered.stored for name in offered.measured]
    deviations = find_deviations(offered.measured, options.state_noise)
    deviations[saved] = 0.0
    robot = zlib.crc32(offered.robot_name.encode())

    def measure(port: OutputPort | None, name: str, start: int) -> OutputPort | None:
        if port is None:
            return None
        # Joints' motions have the noise that they have among all states.
        seed = (options.seed, robot, int(start > 0))
        own = deviations[start : start + port.size()]
        system = MeasuredStates(own, seed, delay=delay, period=period)
        return Wiring(builder).add(f"{prefix}measured:{name}", system, port)

    def delayed(port: InputPort | None, name: str) -> InputPort | None:
        if port is None or not options.command_delay:
            return port
        system = DelayedCommands(
            port.size(), delay=options.command_delay, period=period
        )
        builder.AddNamedSystem(f"{prefix}delayed:{name}", system)
        builder.Connect(system.get_output_port(), port)
        return system.get_input_port()

    changed = dc.replace(
        hardware,
        command=delayed(hardware.command, "drive"),
        values=delayed(hardware.values, interfaces.VALUES_PORT),
    )
    if not delay and not deviations.any():
        return changed
    return dc.replace(
        changed,
        joint_states=measure(hardware.joint_states, "joint_states", 0),
        joint_motions=measure(hardware.joint_motions, "joint_motions", 0),
        readings=measure(hardware.readings, "sensors", 3 * J),
        everything=measure(hardware.everything, "state_interfaces", 0),
        true_states=hardware.joint_states,
    )
