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
Everything here is evaluated at every step of the plant, hence no Python. Each system
reads no more than it uses: at every step Drake looks up all variables of a
SymbolicVectorSystem, which costs more than what is computed with them.

.. pydrake_system::

    name: servo
    input_ports:
    - state
    - command
    - friction
    output_ports:
    - effort

========  ========  ==========  ======================================================
port      size      unit        meaning
========  ========  ==========  ======================================================
state     2m        rad, rad/s  state [q; v] of the robot's m joints
command   2n or 7n  rad, rad/s  desired positions, then desired velocities; with modes
                                also accelerations [rad/s^2] and efforts [N·m], and
                                whether the velocity, the acceleration or the effort
                                alone is followed (1 or 0); with limits 2n more, lower
                                limits of efforts and of the velocities of approaches,
                                0 where there is none
friction  n         N·m         dry friction, if it is made up for
effort    n         N·m         what the actuators apply, within the effort limits
========  ========  ==========  ======================================================
"""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Expression, Variable, if_then_else
from pydrake.symbolic import abs as abs_
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.symbolic import sqrt as sqrt_
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import (
    AffineSystem,
    ConstantVectorSource,
    LinearSystem,
    MatrixGain,
    Multiplexer,
    PassThrough,
    Saturation,
    SymbolicVectorSystem,
    ZeroOrderHold,
)

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import (
    IS_TAU,
    NUM_LIMITS,
    NUM_PARTS,
    NUM_PARTS_OF_POSITIONS,
    TAU_D,
)
from arm_drake.control.servo import ServoGains
from arm_drake.description.ros2_control import PidGains

# Above it a flag is set.
_FLAG = 0.5

# What stands for no limit where one may be told: far more than any joint has.
_NO_LIMIT = 1e12


@dc.dataclass(frozen=True)
class Layout:
    """Where n commanded joints stand in a robot's state, and what they are told."""

    num_states: int
    positions_at: Sequence[int]
    velocities_at: Sequence[int]

    # Whether joints may follow anything else than positions.
    has_modes: bool

    # Whether effort and velocity may be limited at run time.
    has_limits: bool = False

    @property
    def num_joints(self) -> int:
        """Number of commanded joints n."""
        return len(self.positions_at)

    def pick(self, *parts: int) -> Array:
        """Return the matrix that picks parts of a command."""
        n = self.num_joints
        rows = [k * n + i for k in parts for i in range(n)]
        return np.eye(self.num_commands)[rows]

    @property
    def num_parts(self) -> int:
        """Number of parts of the command, without limits."""
        return NUM_PARTS if self.has_modes else NUM_PARTS_OF_POSITIONS

    @property
    def num_commands(self) -> int:
        """Size of the command."""
        parts = self.num_parts + (NUM_LIMITS if self.has_limits else 0)
        return parts * self.num_joints


class Command:
    """Variables of a command, n for each of its parts."""

    def __init__(self, layout: Layout) -> None:
        """Name them."""
        n = layout.num_joints
        self.variables = variables("c", layout.num_commands)
        split = [self.variables[k : k + n] for k in range(0, layout.num_commands, n)]
        self.q_d, self.v_d = split[:NUM_PARTS_OF_POSITIONS]
        rest = split[NUM_PARTS_OF_POSITIONS : layout.num_parts] or [[]] * 5
        self.effort_limit, self.velocity_limit = split[layout.num_parts :] or [[]] * 2
        self.a_d, self.tau_d, self.is_v, self.is_a, self.is_tau = rest


def variables(name: str, number: int) -> list[Variable]:
    """Return numbered variables."""
    return [Variable(f"{name}{i}") for i in range(number)]


def is_set(flag: Variable | Expression) -> object:
    """Return the condition that a flag is 1, not 0."""
    return flag > _FLAG


def clamp(value: Expression, limit: float | Expression) -> Expression:
    """Return a value within ±limit; an infinite limit changes nothing."""
    if isinstance(limit, float) and not np.isfinite(limit):
        return value
    return max_(-limit, min_(value, limit))


def lower_of(limit: float, commanded: Variable | Expression) -> Expression:
    """Return a limit, or one that is told if it is lower; 0 is none."""
    most = limit if np.isfinite(limit) else _NO_LIMIT
    return if_then_else(commanded > 0.0, min_(commanded, most), Expression(most))


def function(
    inputs: Sequence[Variable], outputs: Sequence[Expression]
) -> SymbolicVectorSystem:
    """Return a system without state."""
    return SymbolicVectorSystem(input=np.array(inputs), output=np.array(outputs))


# Share of a change that the filters of an acceleration take over at each step, f.
_ACCELERATION_GAIN = 0.1

# How fast a push against a stop is forgotten [s].
_STOP_TIME = 0.1

# Below this part of all accelerations joints are on their own.
_SMALLEST_SCALE = 0.01

# Part of an effort limit that counts as left for accelerations when nothing is.
_LEAST_ROOM = 0.1

# What is nothing beside an effort limit.
_TINY = 1e-12


def acceleration_law(
    gains: ServoGains, layout: Layout, h: float
) -> SymbolicVectorSystem:
    """Return what computes the accelerations u, and what the observer keeps of itself.

    Its input is the state, the command, then with an observer w and the last positions
    that grippers were sent to, and with modes what `measured_acceleration` says. Its
    output is u, and with an observer (1 - b) I + b v/h and these positions as they are
    now.
    """
    n, b = layout.num_joints, gains.observer_gain
    x, command = variables("x", layout.num_states), Command(layout)
    w = variables("w", n if b else 0)
    grippers = gains.grippers if b else ()
    held_positions = dict(zip(grippers, variables("held", len(grippers)), strict=True))
    a, r = (variables(name, n if layout.has_modes else 0) for name in ("a", "r"))
    kept_at_stop = max(0.0, 1.0 - h / _STOP_TIME)
    accelerations, kept = [], []
    for i in range(n):
        q, v = x[layout.positions_at[i]], x[layout.velocities_at[i]]
        if layout.has_modes:
            u = _desired_in_modes(gains, command, i, q, v)
        else:
            u = _desired_by_position(gains, command, i, q, v)
        u = clamp(u, float(gains.max_acceleration[i]))
        if b:
            shift = b / h * v
            disturbance = clamp(w[i] - shift, float(gains.max_disturbance[i]))
            if i in held_positions:
                # What a gripper pressed against is no load when it is sent elsewhere.
                step = abs_(command.q_d[i] - held_positions[i]) - gains.step[i]
                disturbance = if_then_else(step > 0.0, 0.0, disturbance)
            # Whatever holds a joint at its stop goes away with what pushes it there,
            # and slowly where nothing does: it may be a load that pulls it back.
            for stop, side in ((gains.upper[i], 1.0), (gains.lower[i], -1.0)):
                if np.isfinite(stop):
                    beyond, outwards = side * (q - float(stop)), side * u
                    inwards = side * min_(side * disturbance, 0.0)
                    part = if_then_else(outwards > 0.0, 0.0, kept_at_stop)
                    pushes = inwards + part * (disturbance - inwards)
                    disturbance = if_then_else(beyond > 0.0, pushes, disturbance)
            u = u + disturbance
            keep = (1.0 - b) * disturbance + shift
            # What a free joint does is no disturbance when it is taken again.
            free = shift + b * r[i] if layout.has_modes else shift
            kept.append(_unless(command.is_tau, i, keep, free))
        accelerations.append(_unless(command.is_tau, i, u, a))
    inputs = [*x, *command.variables, *w, *held_positions.values(), *a, *r]
    now = [Expression(command.q_d[i]) for i in held_positions]
    return function(inputs, [*accelerations, *kept, *now])


def mixed_command(part: float, start: Array, h: float) -> AffineSystem:
    """Return a command with a part of that of the step before.

    A joint that follows it is at the end of each step where the ideal drive would be in
    continuous time: `ServoGains.last_command` is that part.
    """
    one = np.eye(len(start))
    # The state is the last command less the first, so that it starts at zero.
    return AffineSystem(
        A=0.0 * one,
        B=one,
        f0=-start,
        C=part * one,
        D=(1.0 - part) * one,
        y0=part * start,
        time_period=h,
    )


def measured_acceleration(gains: ServoGains, layout: Layout, h: float) -> LinearSystem:
    """Return the filters that tell other joints of the acceleration of a free one.

    The input is the robot's state; the output is a of all joints, then r.
    """
    n, f = layout.num_joints, _ACCELERATION_GAIN
    V = np.zeros((n, layout.num_states))
    V[np.arange(n), layout.velocities_at] = 1.0
    one, zero, kd = np.eye(n), np.zeros((n, n)), np.diag(gains.kd)
    return LinearSystem(
        A=np.block([[(1.0 - f) * one, zero], [-f * f / h * one, (1.0 - f) * one]]),
        B=np.vstack([f * V, f * f / h * V]),
        C=np.block([[kd, one + kd * h / f], [zero, one]]),
        D=np.vstack([-kd @ V, zero @ V]),
        time_period=h,
    )


class EffortLaws:
    """Laws that follow the inverse dynamics; their first inputs are the same.

    These are the efforts for u, then where there are such those for no acceleration,
    those of dry friction, with modes those that are commanded, and whether it is they
    alone that count, and the limits that are told; n each.
    """

    def __init__(
        self, gains: ServoGains, layout: Layout, *, knows_friction: bool
    ) -> None:
        """Name what they read."""
        n = layout.num_joints
        self._gains, self._layout = gains, layout
        self.knows_friction = knows_friction
        has_limit = bool(np.isfinite(gains.effort_limit).any())
        self.is_limited = gains.is_coordinated and (has_limit or layout.has_limits)
        self._limits = variables("limit", n if layout.has_limits else 0)
        self._tau = variables("tau", n)
        self._bias = variables("bias", n if self.is_limited else 0)
        self._friction = variables("friction", n if knows_friction else 0)
        self._commanded_effort, self._free = (
            variables(name, n if layout.has_modes else 0) for name in ("told", "free")
        )
        num_groups = int(gains.group.max()) + 1
        self._scale = variables("scale", num_groups if self.is_limited else 0)

    def scale(self) -> SymbolicVectorSystem:
        """Return what computes s of each group of joints from the common inputs."""
        scales = [Expression(1.0) for _ in self._scale]
        for i in map(int, np.flatnonzero(self._gains.is_strong)):
            limit = self._limit_of(i)
            more = self._tau[i] - self._bias[i]
            bias = Expression(self._bias[i])
            if self._friction:
                bias = bias - self._friction[i]
            room = if_then_else(more > 0.0, limit - bias, limit + bias)
            # Where there is none, the others are not to stand still all the same.
            part = max_(room, _LEAST_ROOM * limit) / max_(abs_(more), _TINY * limit)
            part = _unless(self._free, i, part, Expression(1.0))
            group = int(self._gains.group[i])
            scales[group] = min_(scales[group], part)
        return function(self._inputs(), [max_(s, _SMALLEST_SCALE) for s in scales])

    def effort(self) -> Saturation | SymbolicVectorSystem:
        """Return what computes the efforts from the common inputs and s, if limited."""
        if len(self._inputs()) == self._layout.num_joints:
            limit = self._gains.effort_limit
            return Saturation(min_value=-limit, max_value=limit)
        efforts = []
        for i in range(self._layout.num_joints):
            tau = Expression(self._tau[i])
            if self.is_limited:
                tau = self._bias[i] + self._scale_of(i) * (tau - self._bias[i])
            if self._friction:
                tau = tau - self._friction[i]
            if self._commanded_effort:
                tau = _unless(
                    self._free,
                    i,
                    tau + self._commanded_effort[i],
                    self._commanded_effort,
                )
            efforts.append(clamp(tau, self._limit_of(i)))
        return function([*self._inputs(), *self._scale], efforts)

    def observer(self) -> SymbolicVectorSystem:
        """Return what computes the next w, and passes on where grippers are sent.

        Its input is the output of the acceleration law, then s, if limited, and with
        modes whether commanded efforts alone count.
        """
        n, b = self._layout.num_joints, self._gains.observer_gain
        u, kept = variables("u", n), variables("kept", n)
        sent = variables("sent", len(self._gains.grippers))
        found = [
            _unless(self._free, i, kept[i] + b * self._scale_of(i) * u[i], kept)
            for i in range(n)
        ]
        commanded = [Expression(position) for position in sent]
        inputs = [*u, *kept, *sent, *self._scale, *self._free]
        return function(inputs, [*found, *commanded])

    def _scale_of(self, i: int) -> Expression:
        if not self.is_limited:
            return Expression(1.0)
        return Expression(self._scale[int(self._gains.group[i])])

    def _limit_of(self, i: int) -> float | Expression:
        limit = float(self._gains.effort_limit[i])
        return lower_of(limit, self._limits[i]) if self._limits else limit

    def _inputs(self) -> list[Variable]:
        parts = (
            self._tau,
            self._bias,
            self._friction,
            self._commanded_effort,
            self._free,
        )
        return [variable for part in (*parts, self._limits) for variable in part]


def _unless(
    free: Sequence[Variable],
    i: int,
    value: Expression,
    other: Expression | Sequence[Variable],
) -> Expression:
    """Return a value, but another one where joint i is free."""
    if not free:
        return value
    otherwise = other if isinstance(other, Expression) else Expression(other[i])
    return if_then_else(is_set(free[i]), otherwise, value)


def _desired_by_position(
    gains: ServoGains, command: Command, i: int, q: Variable, v: Variable
) -> Expression:
    """Return the acceleration that a position with its velocity asks for."""
    error = _brake(command.q_d[i] - q, float(gains.braking_error[i]))
    approach: float | Expression = float(gains.max_approach[i])
    largest: float | Expression = float(gains.max_error[i])
    if command.velocity_limit:
        # A joint moves with kp / kd times the error.
        commanded_limit = gains.kd[i] / gains.kp[i] * command.velocity_limit[i]
        approach, largest = (
            lower_of(float(limits[i]), commanded_limit)
            for limits in (gains.max_approach, gains.max_error)
        )
    error = clamp(error, approach)
    error = error + gains.velocity_lead[i] * command.v_d[i]
    error = clamp(error, largest)
    return gains.kp[i] * error - gains.kd[i] * v


def _desired_in_modes(
    gains: ServoGains, command: Command, i: int, q: Variable, v: Variable
) -> Expression:
    """Return the acceleration that a joint is to have by what it follows."""
    limit, a_d = float(gains.velocity_limit[i]), Expression(command.a_d[i])
    by_position = _desired_by_position(gains, command, i, q, v) + a_d
    by_velocity = gains.kv * (clamp(Expression(command.v_d[i]), limit) - v)
    if np.isfinite(limit):
        most, least = gains.kv * (limit - v), gains.kv * (-limit - v)
        a_d = max_(least, min_(a_d, most))
    otherwise = if_then_else(is_set(command.is_a[i]), a_d, by_position)
    return if_then_else(is_set(command.is_v[i]), by_velocity, otherwise)


def _brake(error: Expression, begins: float) -> Expression:
    """Return an error, smaller from where a joint has to brake for it."""
    if not np.isfinite(begins):
        return error
    return if_then_else(
        error > begins,
        sqrt_(begins * (2.0 * error - begins)),
        if_then_else(error < -begins, -sqrt_(begins * (-2.0 * error - begins)), error),
    )


@dc.dataclass(frozen=True)
class DrivePid:
    """Gains of n joints on errors of position and of velocity, None where none."""

    position: Sequence[PidGains | None]
    velocity: Sequence[PidGains | None]

    @property
    def is_given(self) -> bool:
        """Whether any joint has gains."""
        return any(gains is not None for gains in (*self.position, *self.velocity))


def pid_law(pid: DrivePid, layout: Layout, h: float) -> SymbolicVectorSystem:
    """Return what makes commanded efforts of commands that PID gains are to follow.

    The law is that of gazebo_ros2_control, with control_toolbox's Pid at every step:
    the error's integral counts with this step, its term is held within limits, and its
    derivative is the change since the last step. What isn't followed starts anew.
    """
    x, command = variables("x", layout.num_states), Command(layout)
    commanded = [Expression(c) for c in command.variables]
    index = {c.get_id(): k for k, c in enumerate(command.variables)}
    states: list[Variable] = []
    updates: list[Expression] = []
    for i in range(layout.num_joints):
        q, v = x[layout.positions_at[i]], x[layout.velocities_at[i]]
        others = command.is_v[i] + command.is_a[i] + command.is_tau[i]
        for gains, acts, error in (
            (pid.position[i], 1.0 - others, command.q_d[i] - q),
            (pid.velocity[i], Expression(command.is_v[i]), command.v_d[i] - v),
        ):
            if gains is None:
                continue
            integral, last = variables(f"pid{len(states)}_", 2)
            summed = integral + h * error
            effort = gains.kp * error + gains.kd / h * (error - last)
            effort = effort + _integral_term(gains, summed)
            for part, value in (
                (command.tau_d, effort),
                (command.is_tau, Expression(1.0)),
                (command.is_v, Expression(0.0)),
            ):
                at = index[part[i].get_id()]
                commanded[at] = if_then_else(is_set(acts), value, commanded[at])
            states += [integral, last]
            updates += [acts * summed, acts * error]
    return SymbolicVectorSystem(
        state=np.array(states),
        input=np.array([*x, *command.variables]),
        dynamics=np.array(updates),
        output=np.array(commanded),
        time_period=h,
    )


def _integral_term(gains: PidGains, summed: Expression) -> Expression:
    term = gains.ki * summed
    if np.isfinite(gains.max_integral_error):
        term = min_(term, gains.max_integral_error)
    if np.isfinite(gains.min_integral_error):
        term = max_(term, gains.min_integral_error)
    return term


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

    The plant holds this robot alone, with the step's damping and its drives' rotors as
    rotor inertia; N is as for `sample_dynamics`. `has_limits` says that effort and
    velocity may be limited at run time, `knows_friction` that dry friction is told and
    made up for. With modes, joints may follow anything else than positions, or the law
    of a PID. With a part of the last command, and then neither modes nor limits, there
    are initial positions [rad], shape (n,).
    """
    h = control_plant.time_step()
    layout = Layout(2 * len(N), positions_at, velocities_at, has_modes, has_limits)
    laws = EffortLaws(gains, layout, knows_friction=knows_friction)
    wiring = Wiring(DiagramBuilder())
    state = wiring.source("state", layout.num_states)
    command = wiring.source("command", layout.num_commands)
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
    hold = None
    if gains.observer_gain:
        num_hold = layout.num_joints + len(gains.grippers)
        hold = wiring.builder.AddNamedSystem("w", ZeroOrderHold(h, num_hold))
        read.append(hold.get_output_port())
    if has_modes:
        read.append(
            wiring.add(
                "measured_acceleration", measured_acceleration(gains, layout, h), state
            )
        )
    law = wiring.add("acceleration", acceleration_law(gains, layout, h), *read)
    added = _add_efforts(wiring, laws, layout, control_plant, N, state, command, law)
    if hold is not None:
        new = wiring.add("observer", laws.observer(), law, *added)
        wiring.builder.Connect(new, hold.get_input_port())
    diagram = wiring.builder.Build()
    diagram.set_name("servo")
    return diagram


def make_push(effort_limit: Array) -> Diagram:
    """Return the servo of n joints that follow nothing but efforts.

    It is told the same as one with modes, and does the same where is_tau is always set.
    The limits have the shape (n,).
    """
    n = len(effort_limit)
    wiring = Wiring(DiagramBuilder())
    command = wiring.source("command", NUM_PARTS * n)
    told = np.eye(NUM_PARTS * n)[TAU_D * n : (TAU_D + 1) * n]
    limits = Saturation(min_value=-effort_limit, max_value=effort_limit)
    effort = wiring.add("effort", limits, wiring.times("told", told, command))
    wiring.builder.ExportOutput(effort, "effort")
    diagram = wiring.builder.Build()
    diagram.set_name("servo")
    return diagram


def _add_efforts(
    wiring: "Wiring",
    laws: EffortLaws,
    layout: Layout,
    plant: MultibodyPlant,
    N: Array,
    state: OutputPort,
    command: OutputPort,
    law: OutputPort,
) -> list[OutputPort]:
    """Add what makes efforts of accelerations; return s, and which joints are free."""
    # Of the law's output, u is what the first columns pick.
    m, rest = len(N), law.size() - layout.num_joints
    u = wiring.times("spread", np.hstack([N, np.zeros((m, rest))]), law)
    still = wiring.add("still", ConstantVectorSource(np.zeros(m)))
    efforts = [wiring.inverse_dynamics("inverse_dynamics", plant, N, state, u)]
    if laws.is_limited:
        efforts.append(wiring.inverse_dynamics("bias", plant, N, state, still))
    if laws.knows_friction:
        efforts.append(wiring.source("friction", layout.num_joints))
    free = []
    if layout.has_modes:
        efforts.append(wiring.times("told", layout.pick(TAU_D, IS_TAU), command))
        free = [wiring.times("free", layout.pick(IS_TAU), command)]
    if layout.has_limits:
        limits = wiring.times("limits", layout.pick(layout.num_parts), command)
        efforts.append(limits)
    known = [wiring.join("efforts", efforts)]
    scale = []
    if laws.is_limited:
        scale = [wiring.add("scale", laws.scale(), *known)]
    effort = wiring.add("effort", laws.effort(), *known, *scale)
    wiring.builder.ExportOutput(effort, "effort")
    return [*scale, *free]


@dc.dataclass(frozen=True)
class Wiring:
    """Adds systems to a builder, connected to what they read."""

    builder: DiagramBuilder

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
        if not rows:
            return self.add(name, ConstantVectorSource(np.zeros(0)))
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
        for port, target in (
            (state, dynamics.get_input_port_estimated_state()),
            (acceleration, dynamics.get_input_port_desired_acceleration()),
        ):
            self.builder.Connect(port, target)
        efforts = dynamics.get_output_port_generalized_force()
        return self.times(f"{name}:gather", N.T, efforts)
