"""The least that Drake takes for the task: the exact servo, and nothing else.

No Python, no SceneGraph, no limits, observer or friction: inverse dynamics of what the
servo asks for, whose commands are known beforehand. A preset can't be quicker.
"""

from functools import partial

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import InverseDynamics
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    MatrixGain,
    TrajectorySource,
    VectorLogSink,
)
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.hardware.drives import make_servo_plant
from arm_drake.plant.plant import add_actuators, add_robot_model, state_indices
from tests.benchmarks.peers import robots
from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.ours import CPP_ONLY
from tests.benchmarks.peers.servo_law import exact
from tests.benchmarks.peers.task import (
    PERIOD,
    STEPS,
    Array,
    Contestant,
    Recording,
    Runner,
    Task,
    substeps,
)


def make_contestants(task: Task) -> list[Contestant]:
    """Return the exact servo at all steps, for a robot without mimic joints."""
    if task.mimics:
        return []
    return [
        Contestant(
            CPP_ONLY, "exact ZOH", "servo", step, partial(make_floor, task, step)
        )
        for step in STEPS
    ]


def make_floor(task: Task, step: float) -> Runner:
    """Return the plant with the exact servo and a log."""
    description = robots.load(task.urdf).description
    plant = MultibodyPlant(step)
    plant.SetUseSampledOutputPorts(False)
    model = add_robot_model(plant, description, "robot", None, is_reduced=True)
    add_actuators(plant, model, task.joints, [np.inf] * len(task.joints))
    plant.Finalize()
    options = ad.SimulationOptions(time_step=step)
    # It has the damping that Drake's step adds to the inertia.
    control = make_servo_plant(description, None, options, step)
    diagram = _connect(task, plant, control, step)
    simulator = Simulator(diagram)
    log = diagram.GetSubsystemByName("log")
    q_at, v_at = state_indices(plant, model, task.joints)

    def prepare() -> None:
        simulator.reset_context(diagram.CreateDefaultContext())
        simulator.Initialize()

    def run() -> Recording:
        # The servo reads a plant that Drake doesn't keep.
        assert control.is_finalized()
        simulator.AdvanceTo(task.duration)
        rows = log.FindLog(simulator.get_context()).data().T[: task.num_ticks]
        return Recording(rows[:, q_at], rows[:, v_at])

    return Runner(prepare, run)


def _connect(
    task: Task, plant: MultibodyPlant, control: MultibodyPlant, step: float
) -> Diagram:
    """Return the diagram of plant, servo and log."""
    n, servo = len(task.joints), exact(step)
    order = np.array(
        state_indices(plant, plant.GetModelInstanceByName("robot"), task.joints)[0]
    )
    builder = DiagramBuilder()
    builder.AddNamedSystem("plant", plant)
    state = plant.get_state_output_port()
    times, commands = _table(task, step)
    wanted = np.empty_like(commands)
    wanted[:, order] = commands
    held = PiecewisePolynomial.ZeroOrderHold(times, wanted.T)
    source = builder.AddNamedSystem("commands", TrajectorySource(held))
    K = np.hstack([servo.kp * np.eye(n), servo.kd * np.eye(n)])
    there = builder.AddNamedSystem("there", MatrixGain(-K))
    total = builder.AddNamedSystem("acceleration", Adder(2, n))
    mode = InverseDynamics.InverseDynamicsMode.kInverseDynamics
    dynamics = builder.AddNamedSystem("effort", InverseDynamics(control, mode))
    # Efforts of joints, in the order of the actuators.
    pick = builder.AddNamedSystem("actuation", MatrixGain(np.eye(n)[order]))
    log = builder.AddNamedSystem("log", VectorLogSink(2 * n, PERIOD))
    for output, target in (
        (state, there.get_input_port()),
        (there.get_output_port(), total.get_input_port(0)),
        (source.get_output_port(), total.get_input_port(1)),
        (state, dynamics.get_input_port_estimated_state()),
        (total.get_output_port(), dynamics.get_input_port_desired_acceleration()),
        (dynamics.get_output_port_generalized_force(), pick.get_input_port()),
        (pick.get_output_port(), plant.get_actuation_input_port()),
        (state, log.get_input_port()),
    ):
        builder.Connect(output, target)
    return builder.Build()


def _table(task: Task, step: float) -> tuple[Array, Array]:
    """Return when commands begin to count [s], and what then counts."""
    firsts, others = exact(step).commands(commands_of(task))
    ticks = PERIOD * np.arange(task.num_ticks)
    if substeps(step) == 1:
        times, rows = ticks, firsts
    else:
        times = np.stack([ticks, ticks + step], axis=1).ravel()
        rows = np.stack([firsts, others], axis=1).reshape(len(times), -1)
    # What a step begins with mustn't depend on how its time is rounded.
    times = np.append(times - 0.25 * step, task.duration + PERIOD)
    return times, np.vstack([rows, rows[-1:]])
