"""What our own code costs: a robot's diagram beside the same one in C++ only.

The peer has the same plant, servo, friction and logs; its command comes from Drake's
TrajectorySource, held at the controllers' rate. Both simulate the tutorial's motion on
the bundled Doosan A0912, in turns, in one process.

    python -m tests.benchmarks.overhead [--runs 7] [--json FILE]
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    TrajectorySource,
    VectorLogSink,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.bundled import bundled_motions
from arm_drake.drives import (
    commanded_joints,
    effort_limits,
    make_robot_friction,
    make_robot_servo,
    make_servo_plant,
)
from arm_drake.hardware import add_state_interfaces, connect_forces
from arm_drake.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    filter_self_collision,
    state_indices,
)
from arm_drake.timing import choose_time_step
from arm_drake.world import add_world

# The tutorial's goal.
TIMES = (0.0, 2.0, 4.0)
POSITIONS = ((0.0,) * 6, (0.0,) * 6, (0.1, 0.0, 1.5, 1.5, 1.0, 0.4))

# The largest ratio that we accept [1].
LARGEST_RATIO = 1.15


def make_peer(
    robot: ad.Robot, options: ad.SimulationOptions
) -> tuple[Diagram, MultibodyPlant]:
    """Return the diagram without Python, and the plant that must outlive it."""
    step, (period,) = choose_time_step(
        options.time_step, [robot.controllers.update_rate]
    )
    description = robot.description
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, step, options)
    add_world(plant, "empty")
    model = add_robot_model(plant, description, robot.name, None)
    joints = commanded_joints(description)
    names = [joint.name for joint in joints]
    add_actuators(plant, model, names, effort_limits(joints))
    plant.Finalize()
    filter_self_collision(plant, scene_graph, model)
    alone = make_servo_plant(description, None, options, step)
    at = state_indices(plant, model, names)
    servo = builder.AddSystem(make_robot_servo(alone, description, joints, at, options))
    path = PiecewisePolynomial.FirstOrderHold(TIMES, np.array(POSITIONS).T)
    source = builder.AddSystem(TrajectorySource(path, output_derivative_order=1))
    hold = builder.AddSystem(ZeroOrderHold(period, 2 * len(joints)))
    friction = make_robot_friction(
        plant, model, alone, description, robot.initial_positions
    )
    assert friction is not None
    builder.AddSystem(friction)
    state, effort = plant.get_state_output_port(model), servo.GetOutputPort("effort")
    builder.Connect(source.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), servo.GetInputPort("command"))
    builder.Connect(state, servo.GetInputPort("state"))
    builder.Connect(state, friction.get_input_port())
    builder.Connect(effort, plant.get_actuation_input_port(model))
    connect_forces(builder, plant, {model: friction.get_output_port()})
    states = add_state_interfaces(builder, plant, model, description, names, effort, "")
    for port in (states, source.get_output_port()):
        log = builder.AddSystem(VectorLogSink(port.size(), period))
        builder.Connect(port, log.get_input_port())
    return builder.Build(), alone


def time_ours(robot: ad.Robot, options: ad.SimulationOptions) -> float:
    """Return the wall time of our diagram [s]."""
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    start = time.perf_counter()
    sim.run(TIMES[-1], motion)
    return time.perf_counter() - start


def time_peer(robot: ad.Robot, options: ad.SimulationOptions) -> float:
    """Return the wall time of the peer [s]."""
    diagram, alone = make_peer(robot, options)
    simulator = Simulator(diagram)
    simulator.Initialize()
    start = time.perf_counter()
    simulator.AdvanceTo(TIMES[-1])
    wall_time = time.perf_counter() - start
    del alone
    return wall_time


def measure(runs: int, time_step: float) -> dict[str, float]:
    """Return medians [ms per simulated second] and the ratio, run by run in turns."""
    robot = ad.load_robot("doosan_a0912")
    options = ad.SimulationOptions(time_step=time_step)
    timers: list[Callable[..., float]] = [time_ours, time_peer]
    times = np.array(
        [[timer(robot, options) for timer in timers] for _ in range(runs + 1)]
    )[1:]  # The first run warms up.
    ours, peer = (1e3 * times / TIMES[-1]).T
    ratios = sorted(ours / peer)
    return {
        "time_step": time_step,
        "ours": statistics.median(ours),
        "peer": statistics.median(peer),
        "ratio": statistics.median(ratios),
        "ratio_min": ratios[0],
        "ratio_max": ratios[-1],
        "real_time_factor": 1e3 / statistics.median(ours),
    }


def main() -> None:
    """Print the table, and write it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = [measure(options.runs, time_step) for time_step in (0.001, 0.01)]
    print("step [ms]  ours  C++ only [ms/s]  ratio (range)        x real time")
    for row in rows:
        print(
            f"{1e3 * row['time_step']:9.0f} {row['ours']:5.1f} {row['peer']:15.1f}  "
            f"{row['ratio']:.3f} ({row['ratio_min']:.3f} to {row['ratio_max']:.3f})"
            f"{row['real_time_factor']:12.1f}"
        )
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
