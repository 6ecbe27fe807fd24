"""The equations of the joint servo; see the package for what they say.

Each system reads no more than it uses: at every step Drake looks up all variables of a
SymbolicVectorSystem, which costs more than what is computed with them.
"""

from collections.abc import Sequence

import numpy as np
from pydrake.symbolic import Expression, Variable, if_then_else
from pydrake.symbolic import abs as abs_
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.symbolic import sqrt as sqrt_
from pydrake.systems.primitives import (
    AffineSystem,
    LinearSystem,
    Saturation,
    SymbolicVectorSystem,
)

from arm_drake.arrays import Array
from arm_drake.control.servo import ServoGains
from arm_drake.hardware.signals import (
    Command,
    Layout,
    clamp,
    function,
    is_set,
    lower_of,
    variables,
)

# Share of a change that the filters of an acceleration take over at each step, f.
_FELT_GAIN = 0.1

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
    that grippers were sent to, and with modes what `felt_acceleration` says. Its output
    is u, and with an observer (1 - b) I + b v/h and these positions as they are now.
    """
    n, b = layout.num_joints, gains.observer_gain
    x, command = variables("x", layout.num_states), Command(layout)
    w = variables("w", n if b else 0)
    grippers = gains.grippers if b else ()
    held = dict(zip(grippers, variables("held", len(grippers)), strict=True))
    felt, r = (variables(name, n if layout.has_modes else 0) for name in ("felt", "r"))
    kept_at_stop = max(0.0, 1.0 - h / _STOP_TIME)
    accelerations, kept = [], []
    for i in range(n):
        q, v = x[layout.positions_at[i]], x[layout.velocities_at[i]]
        if layout.has_modes:
            u = _wanted_in_modes(gains, command, i, q, v)
        else:
            u = _wanted_by_position(gains, command, i, q, v)
        u = clamp(u, float(gains.max_acceleration[i]))
        if b:
            shift = b / h * v
            disturbance = clamp(w[i] - shift, float(gains.max_disturbance[i]))
            if i in held:
                # What a gripper pressed against is no load when it is sent elsewhere.
                step = abs_(command.q_d[i] - held[i]) - gains.step[i]
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
        accelerations.append(_unless(command.is_tau, i, u, felt))
    inputs = [*x, *command.variables, *w, *held.values(), *felt, *r]
    now = [Expression(command.q_d[i]) for i in held]
    return function(inputs, [*accelerations, *kept, *now])


def mixed_command(part: float, start: Array, h: float) -> AffineSystem:
    """Return a command with a part of that of the step before.

    A joint that follows it is at the end of each step where the ideal drive would be in
    continuous time: `ServoGains.last_command` is that part.

    Args:
        part: Part of the command of the step before.
        start: The command before the first one.
        h: Step of the plant [s].
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


def felt_acceleration(gains: ServoGains, layout: Layout, h: float) -> LinearSystem:
    """Return the filters that tell other joints of the acceleration of a free one.

    The input is the robot's state; the output is a of all joints, then r.
    """
    n, f = layout.num_joints, _FELT_GAIN
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
        """Name what they read.

        Args:
            gains: The servo's numbers.
            layout: The joints.
            knows_friction: Whether dry friction is told, and made up for.
        """
        n = layout.num_joints
        self._gains, self._layout = gains, layout
        has_limit = bool(np.isfinite(gains.effort_limit).any())
        self.is_limited = gains.is_coordinated and (has_limit or layout.has_limits)
        self._limits = variables("limit", n if layout.has_limits else 0)
        self._tau = variables("tau", n)
        self._bias = variables("bias", n if self.is_limited else 0)
        self._friction = variables("friction", n if knows_friction else 0)
        self._told, self._free = (
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
            held = Expression(self._bias[i])
            if self._friction:
                held = held - self._friction[i]
            room = if_then_else(more > 0.0, limit - held, limit + held)
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
            if self._told:
                tau = _unless(self._free, i, tau + self._told[i], self._told)
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
        told = [Expression(position) for position in sent]
        inputs = [*u, *kept, *sent, *self._scale, *self._free]
        return function(inputs, [*found, *told])

    def _scale_of(self, i: int) -> Expression:
        if not self.is_limited:
            return Expression(1.0)
        return Expression(self._scale[int(self._gains.group[i])])

    def _limit_of(self, i: int) -> float | Expression:
        limit = float(self._gains.effort_limit[i])
        return lower_of(limit, self._limits[i]) if self._limits else limit

    def _inputs(self) -> list[Variable]:
        parts = (self._tau, self._bias, self._friction, self._told, self._free)
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


def _wanted_by_position(
    gains: ServoGains, command: Command, i: int, q: Variable, v: Variable
) -> Expression:
    """Return the acceleration that a position with its velocity asks for."""
    error = _brake(command.q_d[i] - q, float(gains.braking_error[i]))
    approach: float | Expression = float(gains.max_approach[i])
    largest: float | Expression = float(gains.max_error[i])
    if command.velocity_limit:
        # A joint moves with kp / kd times the error.
        told = gains.kd[i] / gains.kp[i] * command.velocity_limit[i]
        approach, largest = (
            lower_of(float(limits[i]), told)
            for limits in (gains.max_approach, gains.max_error)
        )
    error = clamp(error, approach)
    error = error + gains.velocity_lead[i] * command.v_d[i]
    error = clamp(error, largest)
    return gains.kp[i] * error - gains.kd[i] * v


def _wanted_in_modes(
    gains: ServoGains, command: Command, i: int, q: Variable, v: Variable
) -> Expression:
    """Return the acceleration that a joint is to have by what it follows."""
    limit, a_d = float(gains.velocity_limit[i]), Expression(command.a_d[i])
    by_position = _wanted_by_position(gains, command, i, q, v) + a_d
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
