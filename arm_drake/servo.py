"""The joint servo and dry friction, as Drake systems in C++.

A position command becomes an effort through the robot's own dynamics::

    u*  = clamp(kp clamp(q_d + (2/w0) v_d - q, ±max_error) - kd v, ±max_acceleration)
    I   = clamp(w - b v/h, ±max_disturbance)        w[+] = I + b v/h + b u*
    tau = clamp(N' InverseDynamics(q, v, N (u* + I)), ±effort_limit)

h is the plant's step, b the observer's gain, w its state, and N the matrix that takes
the velocities of the commanded joints to those of all joints, so mimic joints follow
their master. Everything here is evaluated at every step of the plant, hence no Python.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.symbolic import Expression, Variable
from pydrake.symbolic import max as max_
from pydrake.symbolic import min as min_
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    MatrixGain,
    Multiplexer,
    Saturation,
    SymbolicVectorSystem,
)

from arm_drake.control.servo import (
    OBSERVER_GAIN,
    Array,
    DynamicsSamples,
    FrictionGains,
    ServoGains,
)

# Configurations at which the dynamics is sampled, and the seed that picks them.
_NUM_SAMPLES = 100
_SEED = 20_260_101

# Continuous joints, and joints with several turns, are sampled within one turn.
_TURN = np.pi


# Mimic joints: index of the position, of its last master's, factor, offset.
Followers = Sequence[tuple[int, int, float, float]]


def sample_gravity(
    plant: MultibodyPlant, N: Array, num_samples: int, followers: Followers = ()
) -> Array:
    """Return the efforts that hold the commanded joints against gravity.

    Args:
        plant: A finalized plant that holds this robot alone.
        N: As for `sample_dynamics`.
        num_samples: How many poses; the first one is the default configuration.
        followers: The mimic joints.

    Returns:
        Efforts [N·m] or [N], shape (num_samples, n).
    """
    return np.array(
        [
            -N.T @ plant.CalcGravityGeneralizedForces(context)
            for context in _poses(plant, num_samples, followers)
        ]
    )


def _poses(
    plant: MultibodyPlant, num_samples: int, followers: Followers
) -> Iterator[Context]:
    """Yield a context in the default configuration, then in random ones."""
    context, random = plant.CreateDefaultContext(), np.random.default_rng(_SEED)
    limits = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    lower, upper = _sampled_ranges(*limits)
    for sample in range(num_samples):
        if sample:
            q = random.uniform(lower, upper)
            for follower, master, factor, offset in followers:
                q[follower] = factor * q[master] + offset
            plant.SetPositions(context, q)
        yield context


def _sampled_ranges(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the limits, but for ranges of more than a turn: the turn in the middle."""
    low = np.where(np.isfinite(lower), lower, np.minimum(-_TURN, upper - 2.0 * _TURN))
    high = np.where(np.isfinite(upper), upper, np.maximum(_TURN, lower + 2.0 * _TURN))
    low = np.where(np.isfinite(low), low, -_TURN)
    high = np.where(np.isfinite(high), high, _TURN)
    middle, half = (low + high) / 2.0, np.minimum((high - low) / 2.0, _TURN)
    return middle - half, middle + half


def sample_dynamics(
    plant: MultibodyPlant, N: Array, followers: Followers = ()
) -> DynamicsSamples:
    """Return the dynamics of the commanded joints at random configurations.

    Args:
        plant: A finalized plant that holds this robot alone.
        N: Velocities of all joints per velocity of a commanded joint, shape (m, n).
        followers: The mimic joints.
    """
    masses, gravities = [], []
    for context in _poses(plant, _NUM_SAMPLES, followers):
        masses.append(N.T @ plant.CalcMassMatrixViaInverseDynamics(context) @ N)
        gravities.append(-N.T @ plant.CalcGravityGeneralizedForces(context))
    damping = np.zeros(plant.num_velocities())
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        for k in range(joint.num_velocities()):
            damping[joint.velocity_start() + k] = joint.default_damping_vector()[k]
    return DynamicsSamples(
        np.array(masses), np.array(gravities), np.square(N.T) @ damping
    )


def make_joint_servo(
    control_plant: MultibodyPlant,
    gains: ServoGains,
    positions_at: list[int],
    velocities_at: list[int],
    N: Array,
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
    command  2n        rad, rad/s  desired positions, then desired velocities
    effort   n         N·m         what the actuators apply, within the effort limits
    =======  ========  ==========  ===================================================

    Args:
        control_plant: Finalized plant that holds this robot alone, with the step's
            damping as rotor inertia (`add_step_inertia`).
        gains: The servo's numbers.
        positions_at: Indices of the commanded positions in the state.
        velocities_at: Indices of the commanded velocities in the state.
        N: As for `sample_dynamics`.
    """
    builder = DiagramBuilder()
    m, n = N.shape
    signals = builder.AddNamedSystem("signals", Multiplexer([2 * m, 2 * n]))
    law = builder.AddNamedSystem(
        "acceleration",
        _acceleration_law(
            gains, 2 * m, positions_at, velocities_at, control_plant.time_step()
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
    builder.ExportInput(signals.get_input_port(1), "command")
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
) -> SymbolicVectorSystem:
    """Return u* + I of the module's docstring, with the observer's state w."""
    n = len(positions_at)
    x = [Variable(f"x{i}") for i in range(num_states)]
    q_d = [Variable(f"q_d{i}") for i in range(n)]
    v_d = [Variable(f"v_d{i}") for i in range(n)]
    w = [Variable(f"w{i}") for i in range(n)]
    outputs, updates = [], []
    for i in range(n):
        q, v = x[positions_at[i]], x[velocities_at[i]]
        error = q_d[i] + gains.velocity_lead * v_d[i] - q
        error = _clamp(error, gains.max_error[i])
        u = _clamp(gains.kp * error - gains.kd * v, gains.max_acceleration[i])
        shift = OBSERVER_GAIN / h * v
        disturbance = _clamp(w[i] - shift, gains.max_disturbance[i])
        outputs.append(u + disturbance)
        updates.append(disturbance + shift + OBSERVER_GAIN * u)
    return SymbolicVectorSystem(
        state=np.array(w),
        input=np.array([*x, *q_d, *v_d]),
        dynamics=np.array(updates),
        output=np.array(outputs),
        time_period=h,
    )


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
