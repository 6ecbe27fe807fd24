"""The joint servo, as Drake systems in C++.

A position command becomes an effort through the robot's own dynamics::

    e   = clamp(brake(q_d - q), ±max_approach) + (2/w0) v_d
    u   = clamp(kp clamp(e, ±max_error) - kd v + a_d, ±max_acceleration) + I
    tau = clamp(bias + s (N' InverseDynamics(q, v, N u) - bias) - f + tau_d, ±limit)
    I   = clamp(w - b v/h, ±max_disturbance)        w[+] = (1 - b) I + b (v/h + s u)

h is the plant's step, b the observer's gain; what w is made of is its state. N takes
the velocities of the commanded joints to those of all joints, so mimic joints follow
their master. `bias` is N' InverseDynamics(q, v, 0), f the dry friction. Where an effort
limit is in the way, all accelerations are made smaller together, by s <= 1: none is
disturbed by what another one can't do. brake() is the identity up to the braking error
e_b, and then the root of e_b (2 |x| - e_b): the speed from which a joint stops in time.

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
    output_ports:
    - friction
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
friction  k         N·m         dry friction of k joints, if there is any
effort    n         N·m         what the actuators apply, within the effort limits
========  ========  ==========  ======================================================
"""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Expression, Variable, if_then_else
from pydrake.symbolic import abs as abs_
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.symbolic import sqrt as sqrt_
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    AffineSystem,
    ConstantVectorSource,
    LinearSystem,
    Saturation,
    SymbolicVectorSystem,
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
from arm_drake.hardware.joint_friction import DryFriction, make_memory
from arm_drake.hardware.wiring import Port, Source, Wiring
from arm_drake.importing import dataclass

# Above it a flag is set.
_FLAG = 0.5

# What stands for no limit where one may be told: far more than any joint has.
_NO_LIMIT = 1e12


@dataclass(frozen=True)
class Layout:
    """Indices of n commanded joints in a robot's state, and parts of their command."""

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
    """Return a limit, or the commanded one if it is lower; 0 is none."""
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


class Observer:
    """Values that the observer of n joints keeps from the step before.

    These are (1 - b) I + b v/h, the accelerations u that were asked for (0 where a
    commanded effort alone counted), the positions that grippers were sent to, and by
    which s each group's u were made smaller. w is made of them where it is read, for a
    system of its own would cost more.
    """

    def __init__(self, gains: ServoGains, layout: Layout, num_groups: int) -> None:
        """Name it; without an observer there is nothing to remember."""
        n = layout.num_joints if gains.observer_gain else 0
        grippers = gains.grippers if n else ()
        self._gains, self._layout = gains, layout
        self._kept = variables("kept", n)
        self._accelerations = variables("accelerations", n)
        self._scale = variables("scale", num_groups if n else 0)
        positions = variables("positions", len(grippers))
        self.gripper_positions = dict(zip(grippers, positions, strict=True))
        self.variables = [
            *self._kept,
            *self._accelerations,
            *positions,
            *self._scale,
        ]

    def w(self, i: int) -> Expression:
        """Return w of a joint."""
        u = Expression(self._accelerations[i])
        if self._scale:
            # s is 1 in most steps, and a product is slow.
            s = self._scale[int(self._gains.group[i])]
            u = if_then_else(s < 1.0, s * u, u)
        return self._kept[i] + self._gains.observer_gain * u

    @property
    def state_at(self) -> int:
        """Place of the robot's state in what these are made of."""
        num_parts = 4 if self._layout.has_modes else 2
        return num_parts * len(self._kept) + len(self.gripper_positions)

    def matrix(self, h: float) -> Array:
        """Return what makes these of the law's output, the robot's state, and s."""
        n, b, m = self._layout.num_joints, self._gains.observer_gain, len(self._scale)
        V = np.zeros((n, self._layout.num_states))
        if not self.variables:
            return np.zeros((0, V.shape[1]))
        V[np.arange(n), self._layout.velocities_at] = b / h
        one, zero = np.eye(n), np.zeros((n, n))
        parts = [[zero, (1.0 - b) * one], [one, one]]
        if self._layout.has_modes:
            parts = [[zero, (1.0 - b) * one, zero, one], [one, one, zero, zero]]
        law = np.block(parts)
        sent = np.eye(len(self.gripper_positions) + m)
        found = np.zeros((len(self.variables), law.shape[1] + V.shape[1] + len(sent)))
        found[: 2 * n, : law.shape[1]] = law
        at = self.state_at
        found[:n, at : at + V.shape[1]] = V
        columns = [*range(law.shape[1], at), *range(at + V.shape[1], found.shape[1])]
        found[2 * n :, columns] = sent
        return found


def acceleration_law(
    gains: ServoGains, layout: Layout, observer: Observer, h: float
) -> SymbolicVectorSystem:
    """Return what computes the accelerations u.

    Its input is the state, the command, with modes what `measured_acceleration` says,
    and what the observer remembers. Its output is u; with an observer u - I, I, then
    with modes what joints have and what is to be added to their w where a commanded
    effort alone counts, and the positions that grippers are sent to. Nothing is
    computed twice.
    """
    n, b = layout.num_joints, gains.observer_gain
    x, command = variables("x", layout.num_states), Command(layout)
    a, r = (variables(name, n if layout.has_modes else 0) for name in ("a", "r"))
    found: list[Expression] = []
    disturbances: list[Expression] = []
    for i in range(n):
        q, v = x[layout.positions_at[i]], x[layout.velocities_at[i]]
        if layout.has_modes:
            u = _desired_in_modes(gains, command, i, q, v)
        else:
            u = _desired_by_position(gains, command, i, q, v)
        u = clamp(u, float(gains.max_acceleration[i]))
        if b:
            disturbance = _disturbance(gains, observer, command, i, q, v, u, h)
            free = Expression(0.0)
            disturbances.append(_unless(command.is_tau, i, disturbance, free))
            found.append(_unless(command.is_tau, i, u, free))
        else:
            found.append(_unless(command.is_tau, i, u, a))
    found += disturbances
    if b and layout.has_modes:
        # What a free joint does is no disturbance when it is taken again.
        for values in (a, [b * one for one in r]):
            found += [
                if_then_else(is_set(flag), value, 0.0)
                for flag, value in zip(command.is_tau, values, strict=True)
            ]
    found += [Expression(command.q_d[i]) for i in observer.gripper_positions]
    inputs = [*x, *command.variables, *a, *r, *observer.variables]
    return function(inputs, found)


def _disturbance(
    gains: ServoGains,
    observer: Observer,
    command: Command,
    i: int,
    q: Variable,
    v: Variable,
    u: Expression,
    h: float,
) -> Expression:
    """Return I of a joint, of which the other part of its acceleration is u."""
    found = observer.w(i) - gains.observer_gain / h * v
    found = clamp(found, float(gains.max_disturbance[i]))
    if i in observer.gripper_positions:
        # What a gripper pressed against is no load when it is sent elsewhere.
        step = abs_(command.q_d[i] - observer.gripper_positions[i])
        found = if_then_else(step > float(gains.step[i]), 0.0, found)
    # Whatever holds a joint at its stop goes away with what pushes it there, and
    # slowly where nothing does: it may be a load that pulls it back.
    kept_at_stop = max(0.0, 1.0 - h / _STOP_TIME)
    upper, lower = (
        _at_stop(found, u, side, kept_at_stop) if np.isfinite(stop) else found
        for stop, side in ((gains.upper[i], 1.0), (gains.lower[i], -1.0))
    )
    if np.isfinite(gains.lower[i]):
        found = if_then_else(q < float(gains.lower[i]), lower, found)
    if np.isfinite(gains.upper[i]):
        found = if_then_else(q > float(gains.upper[i]), upper, found)
    return found


def _at_stop(
    disturbance: Expression, u: Expression, side: float, kept: float
) -> Expression:
    inwards = side * min_(side * disturbance, 0.0)
    part = if_then_else(side * u > 0.0, 0.0, kept)
    return inwards + part * (disturbance - inwards)


def mixed_command(part: float, start: Array, h: float) -> AffineSystem:
    """Return a command with a part of that of the step before.

    A joint that follows it is at the end of each step where the ideal drive would be in
    continuous time: `ServoGains.last_command` is that part. It starts at positions.
    """
    # The state is the last command less the first, so that it starts at zero.
    first = np.concatenate([start, np.zeros_like(start)])
    one = np.eye(len(first))
    return AffineSystem(
        A=0.0 * one,
        B=one,
        f0=-first,
        C=part * one,
        D=(1.0 - part) * one,
        y0=part * first,
        time_period=h,
    )


def measured_acceleration(gains: ServoGains, layout: Layout, h: float) -> LinearSystem:
    """Return the filters of a free joint's acceleration, for the other joints.

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
    both less what dry friction takes, with modes those that are commanded, and whether
    it is they alone that count, and the limits that are told; n each.
    """

    def __init__(self, gains: ServoGains, layout: Layout) -> None:
        """Name what they read."""
        n = layout.num_joints
        self._gains, self._layout = gains, layout
        has_limit = bool(np.isfinite(gains.effort_limit).any())
        self.is_limited = gains.is_coordinated and (has_limit or layout.has_limits)
        self._limits = variables("limit", n if layout.has_limits else 0)
        self._tau = variables("tau", n)
        self._bias = variables("bias", n if self.is_limited else 0)
        self._commanded_effort, self._free = (
            variables(name, n if layout.has_modes else 0)
            for name in ("commanded", "free")
        )
        self.num_groups = int(gains.group.max()) + 1 if self.is_limited else 0
        self._scale = variables("scale", self.num_groups)

    def scale(self) -> SymbolicVectorSystem:
        """Return what computes s of each group of joints from the common inputs."""
        scales = [Expression(1.0) for _ in self._scale]
        for i in map(int, np.flatnonzero(self._gains.is_strong)):
            limit = self._limit_of(i)
            tau, bias = self._tau[i], self._bias[i]
            room = if_then_else(tau > bias, limit - bias, limit + bias)
            # Where there is none, the others are not to stand still all the same.
            part = max_(room, _LEAST_ROOM * limit)
            part = part / max_(abs_(tau - bias), _TINY * limit)
            part = _unless(self._free, i, part, Expression(1.0))
            # Most efforts are within their limits, where it is at least 1.
            part = if_then_else(abs_(tau) > limit, part, 1.0)
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
                s, bias = self._scale[int(self._gains.group[i])], self._bias[i]
                tau = if_then_else(s < 1.0, bias + s * (tau - bias), tau)
            if self._commanded_effort:
                tau = _unless(
                    self._free,
                    i,
                    tau + self._commanded_effort[i],
                    self._commanded_effort,
                )
            efforts.append(clamp(tau, self._limit_of(i)))
        return function([*self._inputs(), *self._scale], efforts)

    def _limit_of(self, i: int) -> float | Expression:
        limit = float(self._gains.effort_limit[i])
        return lower_of(limit, self._limits[i]) if self._limits else limit

    def _inputs(self) -> list[Variable]:
        efforts = (self._tau, self._bias, self._commanded_effort)
        parts = (*efforts, self._free, self._limits)
        return [variable for part in parts for variable in part]


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
    """Return the acceleration for a commanded position with its velocity."""
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
    far = if_then_else(
        error > 0.0,
        sqrt_(begins * (2.0 * error - begins)),
        -sqrt_(begins * (-2.0 * error - begins)),
    )
    return if_then_else(abs_(error) > begins, far, error)


@dataclass(frozen=True)
class DrivePid:
    """Gains of n joints on errors of position and of velocity, None where none."""

    position: Sequence[PidGains | None]
    velocity: Sequence[PidGains | None]

    @property
    def has_gains(self) -> bool:
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
    dry: DryFriction | None = None,
    braked: Array | None = None,
    pid: DrivePid | None = None,
    start: Array | None = None,
) -> Diagram:
    """Return the servo of a robot's n commanded joints.

    The plant holds this robot alone, with the step's damping and its drives' rotors as
    rotor inertia; N is as for `sample_dynamics`. `has_limits` says that effort and
    velocity may be limited at run time. `dry` is the friction of k joints, and `braked`
    says what of it is made up for, as efforts of the n joints, shape (n, k). With
    modes, joints may follow anything else than positions, or the law of a PID. With a
    part of the last command, and then neither modes nor limits, there are initial
    positions [rad], shape (n,).
    """
    h = control_plant.time_step()
    layout = Layout(2 * len(N), positions_at, velocities_at, has_modes, has_limits)
    laws = EffortLaws(gains, layout)
    observer = Observer(gains, layout, laws.num_groups)
    wiring = Wiring(DiagramBuilder())
    state = Source("state", layout.num_states)
    command: Port = Source("command", layout.num_commands)
    if pid is not None:
        command = wiring.add("pid", pid_law(pid, layout, h), state, command)
    if gains.last_command:
        command = _add_mixing(wiring, gains, layout, start, h, command)
    read: list[Port] = [state, command]
    if has_modes:
        measured = measured_acceleration(gains, layout, h)
        read.append(wiring.add("measured_acceleration", measured, state))
    memory = _make_memory(observer, layout, dry, h)
    if memory is not None:
        kept = wiring.builder.AddNamedSystem("memory", memory)
        read.append(kept.get_output_port())
    law_of = acceleration_law(gains, layout, observer, h)
    num_read = law_of.get_input_port().size()
    law_reads, friction_reads = _add_inputs(wiring, read, num_read, dry)
    law = wiring.add("acceleration", law_of, law_reads)
    # Of the law's output, u is the sum of its first parts.
    parts = (2 + has_modes if gains.observer_gain else 1) * [N]
    rest = np.zeros((len(N), law.size() - sum(part.shape[1] for part in parts)))
    u = wiring.times("spread", np.hstack([*parts, rest]), law)
    friction = [dry.add(wiring, friction_reads)] if dry is not None else []
    scale = _add_efforts(
        wiring, laws, layout, control_plant, N, state, command, u, friction, braked
    )
    if memory is not None:
        found = [law, state, *scale] if gains.observer_gain else [state]
        new = wiring.join("memory:inputs", [*found, *friction])
        wiring.builder.Connect(new, memory.get_input_port())
    return wiring.build("servo")


def _add_mixing(
    wiring: Wiring,
    gains: ServoGains,
    layout: Layout,
    start: Array | None,
    h: float,
    command: Port,
) -> OutputPort:
    """Add what gives commands a part of the last one; they start at positions."""
    assert start is not None
    assert not layout.has_modes
    assert not layout.has_limits
    return wiring.add("mixed", mixed_command(gains.last_command, start, h), command)


def _add_inputs(
    wiring: Wiring, read: Sequence[Port], num_law: int, dry: DryFriction | None
) -> tuple[OutputPort, OutputPort]:
    """Return what the law reads of ports, and what friction does: the same if none.

    The state is the first of the ports. The last one is what is kept, the observer's
    values, then those of friction.
    """
    rows: dict[str, Sequence[int]] = {"law": range(num_law)}
    if dry is not None:
        num_all = sum(port.size() for port in read)
        rows["friction"] = [
            *range(read[0].size()),
            *range(num_all - dry.num_joints, num_all),
        ]
    inputs = wiring.pick_all("inputs", rows, *read)
    return inputs["law"], inputs["friction" if dry is not None else "law"]


def _make_memory(
    observer: Observer, layout: Layout, dry: DryFriction | None, h: float
) -> LinearSystem | None:
    """Return what keeps the values of an observer and of dry friction, if any.

    Its input is, with an observer, the law's output, then the state, with an observer
    s, and the friction.
    """
    made = observer.matrix(h)
    start = np.zeros(len(made))
    if dry is not None:
        at, k = observer.state_at, dry.num_joints
        made = np.pad(made, ((0, k), (0, k)))
        keep = dry.keep()
        made[-k:, at : at + layout.num_states] = keep[:, :-k]
        made[-k:, -k:] = keep[:, -k:]
        start = np.concatenate([start, dry.kept_at_start])
    return make_memory(made, start, h) if len(made) else None


def make_push(effort_limit: Array) -> Diagram:
    """Return the servo of n joints that follow nothing but efforts.

    Its input is that of one with modes, and it does the same where is_tau is always
    set. The limits have the shape (n,).
    """
    n = len(effort_limit)
    wiring = Wiring(DiagramBuilder())
    command = Source("command", NUM_PARTS * n)
    commanded = wiring.pick("commanded", range(TAU_D * n, (TAU_D + 1) * n), command)
    limits = Saturation(min_value=-effort_limit, max_value=effort_limit)
    effort = wiring.add("effort", limits, commanded)
    wiring.builder.ExportOutput(effort, "effort")
    return wiring.build("servo")


def _add_efforts(
    wiring: Wiring,
    laws: EffortLaws,
    layout: Layout,
    plant: MultibodyPlant,
    N: Array,
    state: Port,
    command: Port,
    u: OutputPort,
    friction: Sequence[Port],
    braked: Array | None,
) -> list[OutputPort]:
    """Add what makes efforts of accelerations; return s, if efforts are limited."""
    m = len(N)
    read: list[Port] = [wiring.inverse_dynamics("inverse_dynamics", plant, state, u)]
    if laws.is_limited:
        still = wiring.add("still", ConstantVectorSource(np.zeros(m)))
        read.append(wiring.inverse_dynamics("bias", plant, state, still))
    # Of both, dry friction takes its part.
    known = np.kron(np.eye(len(read)), N.T)
    if braked is not None:
        known = np.hstack([known, np.tile(-braked, (len(read), 1))])
        read.extend(friction)
    parts = [TAU_D, IS_TAU] if layout.has_modes else []
    if layout.has_limits:
        parts.append(layout.num_parts)
    if parts:
        rows = layout.pick(*parts)
        known = np.block(
            [
                [known, np.zeros((len(known), rows.shape[1]))],
                [np.zeros((len(rows), known.shape[1])), rows],
            ]
        )
        read.append(command)
    efforts = wiring.times("efforts", np.asarray(known, float), *read)
    scale = []
    if laws.is_limited:
        scale = [wiring.add("scale", laws.scale(), efforts)]
    effort = wiring.add("effort", laws.effort(), efforts, *scale)
    wiring.builder.ExportOutput(effort, "effort")
    return scale
