"""The joint servo, as Drake systems in C++.

A position command becomes an effort through the robot's own dynamics::

    e   = clamp(brake(q_d - q), ±max_approach) + (2/w0) v_d
    u   = clamp(kp clamp(e, ±max_error) - kd v + a_d, ±max_acceleration) + I
    tau = clamp(bias + s (N' InverseDynamics(q, v, N u) - bias) - f + tau_d, ±limit)
    I   = clamp(w - b v/h, ±max_disturbance)        w[+] = (1 - b) I + b (v/h + s u)

h is the plant's step, b the observer's gain, w its state. N takes the velocities of the
commanded joints to those of all joints, so mimic joints follow their master. `bias` is
N' InverseDynamics(q, v, 0), f the dry friction. Where an effort limit is in the way,
all accelerations are made smaller together, by s <= 1: none is disturbed by what
another one can't do. brake() is the identity up to the braking error e_b, and then the
root of e_b (2 |x| - e_b): the speed from which a joint stops in time.

A joint that follows a velocity has u = clamp(kv (v_d - v), ...) + I, one that follows
an acceleration has u = clamp(a_d, ...) + I, within its velocity limit; one that follows
an effort applies tau_d alone, and its observer rests. The other joints feel its
acceleration through the mass matrix; of that they are told, with the filter gain f::

    a = (1 + kd h/f) r - kd (v - s)     s[+] = s + f (v - s)
                                        r[+] = r + f (f (v - s)/h - r)

Slow changes are its acceleration. Fast ones are as if it were braked like the others: a
light joint that gave way would multiply their gains.

The preset "fast" has neither s nor I, and follows (1 - p) c + p c[-], with the command
c of this step and c[-] of the one before: its joints are where the ideal drive would be
in continuous time.

A joint whose description has PID gains applies what these say, as under Gazebo Classic.
Everything here is evaluated at every step of the plant, hence no Python.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import (
    ConstantVectorSource,
    MatrixGain,
    Multiplexer,
    PassThrough,
    ZeroOrderHold,
)

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import IS_TAU, TAU_D
from arm_drake.control.servo import ServoGains
from arm_drake.hardware.laws import (
    EffortLaws,
    acceleration_law,
    felt_acceleration,
    mixed_command,
)
from arm_drake.hardware.pid import DrivePid, pid_law
from arm_drake.hardware.signals import Layout


def make_joint_servo(
    control_plant: MultibodyPlant,
    gains: ServoGains,
    positions_at: list[int],
    velocities_at: list[int],
    N: Array,
    *,
    has_modes: bool = False,
    has_limits: bool = False,
    knows_friction: bool = False,
    pid: DrivePid | None = None,
    start: Array | None = None,
) -> Diagram:
    """Return the servo of a robot's n commanded joints.

    .. pydrake_system::

        name: servo
        input_ports:
        - state
        - command
        - friction
        output_ports:
        - effort

    ========  ========  ==========  ==================================================
    port      size      unit        meaning
    ========  ========  ==========  ==================================================
    state     2m        rad, rad/s  state [q; v] of the robot's m joints
    command   2n or 7n  rad, rad/s  desired positions, then desired velocities; with
                                    modes also accelerations [rad/s^2] and efforts
                                    [N·m], and whether the velocity, the acceleration
                                    or the effort alone is followed (1 or 0); with
                                    limits 2n more, lower limits of efforts and of the
                                    velocities of approaches, 0 where there is none
    friction  n         N·m         dry friction, if it is made up for
    effort    n         N·m         what the actuators apply, within the effort limits
    ========  ========  ==========  ==================================================

    Args:
        control_plant: Finalized plant that holds this robot alone, with the step's
            damping and its drives' rotors as rotor inertia (`set_rotor_inertia`).
        gains: The servo's numbers.
        positions_at: Indices of the commanded positions in the state.
        velocities_at: Indices of the commanded velocities in the state.
        N: As for `sample_dynamics`.
        has_modes: Whether joints may follow anything else than positions.
        has_limits: Whether effort and velocity may be limited at run time.
        knows_friction: Whether dry friction is told, and made up for.
        pid: Gains of joints that follow the law of a PID controller; with modes only.
        start: Initial positions [rad], shape (n,); for a servo with a part of the last
            command, which has neither modes nor limits.
    """
    h, m = control_plant.time_step(), len(N)
    layout = Layout(2 * m, positions_at, velocities_at, has_modes, has_limits)
    laws = EffortLaws(gains, layout, knows_friction=knows_friction)
    wiring = _Wiring()
    state = wiring.source("state", layout.num_states)
    command = wiring.source("command", layout.num_told)
    if pid is not None:
        command = wiring.add("pid", pid_law(pid, layout, h), state, command)
    if gains.last_command:
        assert start is not None
        assert not has_modes
        assert not has_limits
        before = np.concatenate([start, np.zeros_like(start)])
        mixed = mixed_command(gains.last_command, before, h)
        command = wiring.add("mixed", mixed, command)

    read = [state, command]
    held = None
    if gains.observer_gain:
        num_held = layout.num_joints + len(gains.grippers)
        held = wiring.builder.AddNamedSystem("w", ZeroOrderHold(h, num_held))
        read.append(held.get_output_port())
    if has_modes:
        read.append(wiring.add("felt", felt_acceleration(gains, layout, h), state))
    law = wiring.add("acceleration", acceleration_law(gains, layout, h), *read)

    # Of the law's output, u is what the first columns pick.
    rest = law.size() - layout.num_joints
    u = wiring.times("spread", np.hstack([N, np.zeros((m, rest))]), law)
    still = wiring.add("still", ConstantVectorSource(np.zeros(m)))
    efforts = [wiring.inverse_dynamics("inverse_dynamics", control_plant, N, state, u)]
    if laws.is_limited:
        bias = wiring.inverse_dynamics("bias", control_plant, N, state, still)
        efforts.append(bias)
    if knows_friction:
        efforts.append(wiring.source("friction", layout.num_joints))
    free = []
    if has_modes:
        efforts.append(wiring.times("told", layout.pick(TAU_D, IS_TAU), command))
        free = [wiring.times("free", layout.pick(IS_TAU), command)]
    if has_limits:
        limits = wiring.times("limits", layout.pick(layout.num_parts), command)
        efforts.append(limits)
    known = [wiring.join("efforts", efforts)]
    scale = []
    if laws.is_limited:
        scale = [wiring.add("scale", laws.scale(), *known)]
    effort = wiring.add("effort", laws.effort(), *known, *scale)
    if held is not None:
        new = wiring.add("observer", laws.observer(), law, *scale, *free)
        wiring.builder.Connect(new, held.get_input_port())
    wiring.builder.ExportOutput(effort, "effort")
    diagram = wiring.builder.Build()
    diagram.set_name("servo")
    return diagram


class _Wiring:
    """Adds systems to a builder, connected to what they read."""

    def __init__(self) -> None:
        self.builder = DiagramBuilder()

    def source(self, name: str, size: int) -> OutputPort:
        """Return an input of the diagram, for several systems to read."""
        wires = self.builder.AddNamedSystem(f"{name}:wires", PassThrough(size))
        self.builder.ExportInput(wires.get_input_port(), name)
        return wires.get_output_port()

    def join(self, name: str, ports: Sequence[OutputPort]) -> OutputPort:
        """Return ports one after another."""
        if len(ports) == 1:
            return ports[0]
        joined = self.builder.AddNamedSystem(
            name, Multiplexer([p.size() for p in ports])
        )
        for index, port in enumerate(ports):
            self.builder.Connect(port, joined.get_input_port(index))
        return joined.get_output_port()

    def add(self, name: str, system: System, *read: OutputPort) -> OutputPort:
        """Add a system of one output, and of one input if it reads anything."""
        self.builder.AddNamedSystem(name, system)
        if read:
            port = self.join(f"{name}:inputs", read)
            self.builder.Connect(port, system.get_input_port(0))
        return system.get_output_port(0)

    def times(self, name: str, matrix: Array, port: OutputPort) -> OutputPort:
        """Return a matrix times a port; the port itself if that changes nothing."""
        rows, columns = matrix.shape
        if rows == columns and np.array_equal(matrix, np.eye(rows)):
            return port
        return self.add(name, MatrixGain(matrix), port)

    def inverse_dynamics(
        self,
        name: str,
        plant: MultibodyPlant,
        N: Array,
        state: OutputPort,
        acceleration: OutputPort,
    ) -> OutputPort:
        """Return the efforts of the commanded joints for accelerations of all."""
        mode = InverseDynamics.InverseDynamicsMode.kInverseDynamics
        dynamics = self.builder.AddNamedSystem(name, InverseDynamics(plant, mode))
        for port, wanted in (
            (state, dynamics.get_input_port_estimated_state()),
            (acceleration, dynamics.get_input_port_desired_acceleration()),
        ):
            self.builder.Connect(port, wanted)
        efforts = dynamics.get_output_port_generalized_force()
        return self.times(f"{name}:gather", N.T, efforts)
