"""The joint servo and dry friction, as Drake systems in C++.

A position command becomes an effort through the robot's own dynamics::

    u*  = clamp(kp clamp(q_d + (2/w0) v_d - q, ±max_error) - kd v, ±max_acceleration)
    I   = clamp(w - b v/h, ±max_disturbance)        w[+] = I + b v/h + b u*
    tau = clamp(N' InverseDynamics(q, v, N (u* + I)), ±effort_limit)

h is the plant's step, b the observer's gain, w its state, and N the matrix that takes
the velocities of the commanded joints to those of all joints, so mimic joints follow
their master. A joint that follows a velocity has u* = clamp(kv (v_d - v), ...), one
that follows an acceleration has u* = clamp(a_d, ...), one that follows an effort has
that effort instead of tau, and its observer rests. The other joints feel its
acceleration through the mass matrix; of that they are told, with the filter gain f::

    a = (1 + kd h/f) r - kd (v - s)     s[+] = s + f (v - s)
                                        r[+] = r + f (f (v - s)/h - r)

Slow changes are its acceleration. Fast ones are as if it were braked like the others: a
light joint that gave way would multiply their gains.
Everything here is evaluated at every step of the plant, hence no Python.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.symbolic import Expression, Variable
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    MatrixGain,
    Multiplexer,
    Saturation,
    SymbolicVectorSystem,
)

from arm_drake.control.drive_commands import NUM_PARTS, NUM_PARTS_OF_POSITIONS
from arm_drake.control.servo import (
    OBSERVER_GAIN,
    Array,
    FrictionGains,
    ServoGains,
)

# Share of a change that the filters of an acceleration take over at each step, f.
_FELT_GAIN = 0.1


def make_joint_servo(
    control_plant: MultibodyPlant,
    gains: ServoGains,
    positions_at: list[int],
    velocities_at: list[int],
    N: Array,
    *,
    has_modes: bool = False,
) -> Diagram:
    """Return the servo of a robot's n commanded joints.

    .. pydrake_system::

        name: servo
        input_ports:
        - state
        - command
        output_ports:
        - effort

    =======  ========  ==========  ===================================================
    port     size      unit        meaning
    =======  ========  ==========  ===================================================
    state    2m        rad, rad/s  state [q; v] of the robot's m joints
    command  2n or 6n  rad, rad/s  desired positions, then desired velocities; with
                                   modes also accelerations [rad/s^2] or efforts [N·m],
                                   and whether the velocity, the acceleration or the
                                   effort alone is followed (1 or 0)
    effort   n         N·m         what the actuators apply, within the effort limits
    =======  ========  ==========  ===================================================

    Args:
        control_plant: Finalized plant that holds this robot alone, with the step's
            damping as rotor inertia (`add_step_inertia`).
        gains: The servo's numbers.
        positions_at: Indices of the commanded positions in the state.
        velocities_at: Indices of the commanded velocities in the state.
        N: As for `sample_dynamics`.
        has_modes: Whether joints may follow velocities or efforts.
    """
    builder = DiagramBuilder()
    m, n = N.shape
    size = (NUM_PARTS if has_modes else NUM_PARTS_OF_POSITIONS) * n
    signals = builder.AddNamedSystem("signals", Multiplexer([2 * m, size]))
    law = builder.AddNamedSystem(
        "acceleration",
        _acceleration_law(
            gains,
            2 * m,
            positions_at,
            velocities_at,
            control_plant.time_step(),
            has_modes=has_modes,
        ),
    )
    dynamics = builder.AddNamedSystem(
        "inverse_dynamics",
        InverseDynamics(
            control_plant, InverseDynamics.InverseDynamicsMode.kInverseDynamics
        ),
    )
    limit = builder.AddNamedSystem(
        "effort_limit", Saturation(-gains.effort_limit, gains.effort_limit)
    )
    state = builder.ExportInput(signals.get_input_port(0), "state")
    builder.ConnectInput(state, dynamics.get_input_port_estimated_state())
    command = builder.ExportInput(signals.get_input_port(1), "command")
    builder.Connect(signals.get_output_port(), law.get_input_port())
    acceleration, effort = (
        law.get_output_port(),
        dynamics.get_output_port_generalized_force(),
    )
    if not np.array_equal(N, np.eye(n)):
        spread = builder.AddNamedSystem("spread", MatrixGain(N))
        gather = builder.AddNamedSystem("gather", MatrixGain(N.T))
        builder.Connect(acceleration, spread.get_input_port())
        builder.Connect(effort, gather.get_input_port())
        acceleration, effort = spread.get_output_port(), gather.get_output_port()
    builder.Connect(acceleration, dynamics.get_input_port_desired_acceleration())
    if has_modes:
        choice = builder.AddNamedSystem("effort", _effort_choice(n))
        chosen = builder.AddNamedSystem("effort_signals", Multiplexer([n, size]))
        builder.Connect(effort, chosen.get_input_port(0))
        builder.ConnectInput(command, chosen.get_input_port(1))
        builder.Connect(chosen.get_output_port(), choice.get_input_port())
        effort = choice.get_output_port()
    builder.Connect(effort, limit.get_input_port())
    builder.ExportOutput(limit.get_output_port(), "effort")
    diagram = builder.Build()
    diagram.set_name("servo")
    return diagram


def _acceleration_law(
    gains: ServoGains,
    num_states: int,
    positions_at: list[int],
    velocities_at: list[int],
    h: float,
    *,
    has_modes: bool,
) -> SymbolicVectorSystem:
    """Return u* + I of the module's docstring, or a; with the states w, s and r."""
    n = len(positions_at)
    x = _variables("x", num_states)
    q_d, v_d = _variables("q_d", n), _variables("v_d", n)
    a_d, is_v, is_a, is_tau, s, r = (
        _variables(name, n if has_modes else 0)
        for name in ("a_d", "is_v", "is_a", "is_tau", "s", "r")
    )
    w = _variables("w", n)
    outputs, updates, lags, rates = [], [], [], []
    for i in range(n):
        q, v = x[positions_at[i]], x[velocities_at[i]]
        error = q_d[i] + gains.velocity_lead * v_d[i] - q
        error = _clamp(error, gains.max_error[i])
        u = gains.kp * error - gains.kd * v
        if has_modes:
            v_error = _clamp(v_d[i], gains.velocity_limit[i]) - v
            u = (1.0 - is_v[i] - is_a[i]) * u
            u = u + is_v[i] * gains.kv * v_error + is_a[i] * a_d[i]
        u = _clamp(u, gains.max_acceleration[i])
        shift = OBSERVER_GAIN / h * v
        disturbance = _clamp(w[i] - shift, gains.max_disturbance[i])
        gain = disturbance + OBSERVER_GAIN * u
        if not has_modes:
            outputs.append(u + disturbance)
            updates.append(shift + gain)
            continue
        lag = v - s[i]
        felt = (1.0 + gains.kd * h / _FELT_GAIN) * r[i] - gains.kd * lag
        acts = 1.0 - is_tau[i]
        outputs.append(acts * (u + disturbance) + is_tau[i] * felt)
        updates.append(shift + acts * gain)
        lags.append(s[i] + _FELT_GAIN * lag)
        rates.append(r[i] + _FELT_GAIN * (_FELT_GAIN / h * lag - r[i]))
    return SymbolicVectorSystem(
        state=np.array([*w, *s, *r]),
        input=np.array([*x, *q_d, *v_d, *a_d, *is_v, *is_a, *is_tau]),
        dynamics=np.array([*updates, *lags, *rates]),
        output=np.array(outputs),
        time_period=h,
    )


def _effort_choice(n: int) -> SymbolicVectorSystem:
    """Return what puts an effort command in the place of the servo's effort."""
    tau, unused = _variables("tau", n), _variables("c", 2 * n)
    tau_d, others, is_tau = (
        _variables(name, size)
        for name, size in (("tau_d", n), ("o", 2 * n), ("is_tau", n))
    )
    # A sum of products, for it is exact.
    chosen = [(1.0 - is_tau[i]) * tau[i] + is_tau[i] * tau_d[i] for i in range(n)]
    return SymbolicVectorSystem(
        input=np.array([*tau, *unused, *tau_d, *others, *is_tau]),
        output=np.array(chosen),
    )


def _variables(name: str, number: int) -> list[Variable]:
    return [Variable(f"{name}{i}") for i in range(number)]


def make_dry_friction(
    friction: Array,
    gains: FrictionGains,
    initial: Array,
    num_states: int,
    positions_at: list[int],
    velocities_at: list[int],
    num_velocities: int,
    h: float,
) -> SymbolicVectorSystem:
    """Return elastoplastic dry friction with true sticking.

    The joint is held at an anchor a by a PD law that gives way at the friction f::

        tau  = clamp(kf (a - q) - df v, ±f)         a[+] = q + (tau + df v) / kf

    The input is the robot's state, the output the generalized forces on the robot's
    velocities. The state is a less the initial positions, so that it starts at zero.

    Args:
        friction: f of the k joints that have friction [N·m], shape (k,).
        gains: kf and df.
        initial: Initial positions of those joints [rad], shape (k,).
        num_states: Size of the robot's state [q; v].
        positions_at: Indices of the joints' positions in the state.
        velocities_at: Indices of their velocities in the state.
        num_velocities: Size of v.
        h: Step of the plant [s].
    """
    x = [Variable(f"x{i}") for i in range(num_states)]
    a = [Variable(f"a{i}") for i in range(len(friction))]
    forces = [Expression(0.0)] * num_velocities
    updates = []
    for i, f in enumerate(friction):
        q, v = x[positions_at[i]] - initial[i], x[velocities_at[i]]
        tau = _clamp(gains.kf[i] * (a[i] - q) - gains.df[i] * v, f)
        forces[velocities_at[i] - (num_states - num_velocities)] = tau
        updates.append(q + (tau + gains.df[i] * v) / gains.kf[i])
    return SymbolicVectorSystem(
        state=np.array(a),
        input=np.array(x),
        dynamics=np.array(updates),
        output=np.array(forces),
        time_period=h,
    )


def add_step_inertia(
    plant: MultibodyPlant, model: ModelInstanceIndex, time_step: float
) -> None:
    """Give each joint of a control plant the inertia h D that Drake's step adds.

    Drake's discrete step treats the damping D implicitly, that is, it moves M + h D.

    Args:
        plant: A plant that isn't finalized and has no actuators.
        model: The robot's model instance.
        time_step: Step of the simulated plant h [s].
    """
    for index in plant.GetJointIndices(model):
        joint = plant.get_joint(index)
        if joint.num_velocities() == 1:
            actuator = plant.AddJointActuator(f"{joint.name()}_step", joint)
            actuator.set_default_rotor_inertia(
                time_step * joint.default_damping_vector()[0]
            )
            actuator.set_default_gear_ratio(1.0)


def _clamp(value: Expression, limit: float) -> Expression:
    return max_(-limit, min_(value, limit)) if np.isfinite(limit) else value
