"""What our own code costs: a robot's diagram beside the same one in C++ only.

The peer has the same plant, servo, friction and logs; its commands are those that our
controller gave, from Drake's TrajectorySource, held from tick to tick. Both simulate
the tutorial's motion on the bundled Doosan A0912, in turns, in one process, and end in
the same state.

    python -m tests.benchmarks.overhead [--runs 7] [--json FILE]
"""

import argparse
import json
import statistics
import time
from pathlib import Path

import numpy as np
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
    RobotDrive,
    commanded_joints,
    effort_limits,
    make_robot_drive,
)
from arm_drake.hardware import add_hardware, connect_forces
from arm_drake.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    filter_self_collision,
    set_initial_positions,
)
from arm_drake.timing import choose_time_step
from arm_drake.world import add_world

# The tutorial's motion ends then [s].
DURATION = 4.0

# What we aim at with a step of 1 ms.
GOAL_RATIO = 1.15
GOAL_REAL_TIME_FACTOR = 25.0


def record_commands(robot: ad.Robot, options: ad.SimulationOptions) -> np.ndarray:
    """Return what our servo is told from each tick on, shape (ticks, 2n or 7n)."""
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    diagram = ad.build_diagram(robot, options=options)
    sim = ad.Simulation(diagram)
    port = diagram.GetSubsystemByName("controller_manager").GetOutputPort("drive")
    rows = []
    for tick in range(round(DURATION * robot.controllers.update_rate)):
        sim.run((tick + 0.5) / robot.controllers.update_rate - sim.time, motion)
        motion = None
        context = port.get_system().GetMyContextFromRoot(sim.simulator.get_context())
        rows.append(port.Eval(context))
    return np.array(rows)


def make_peer(
    robot: ad.Robot, options: ad.SimulationOptions, commands: np.ndarray
) -> tuple[Diagram, RobotDrive]:
    """Return the diagram without Python, and the drive that must outlive it."""
    step, (period,) = choose_time_step(
        options.time_step, [robot.controllers.update_rate]
    )
    description, initial = robot.description, robot.initial_positions
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, step, options)
    add_world(plant, "empty")
    model = add_robot_model(plant, description, robot.name, robot.pose)
    joints = commanded_joints(description)
    add_actuators(plant, model, [joint.name for joint in joints], effort_limits(joints))
    set_initial_positions(plant, model, dict(initial))
    plant.Finalize()
    filter_self_collision(plant, scene_graph, model)
    drive = make_robot_drive(description, robot.pose, options, step, period=period)
    hardware = add_hardware(
        builder,
        plant,
        model,
        description,
        prefix="",
        drive=drive,
        initial=initial,
        options=options,
        has_modes=commands.shape[1] > 2 * len(joints),
    )
    assert hardware.command is not None
    assert hardware.friction is not None
    # Each command holds from its tick to the next one, without a delay.
    ticks = period * np.arange(len(commands) + 1)
    held = PiecewisePolynomial.ZeroOrderHold(
        ticks, np.vstack([commands, commands[-1:]]).T
    )
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), hardware.command)
    connect_forces(builder, plant, {model: hardware.friction})
    states = hardware.joint_states
    # What our broadcaster holds and our rollout records.
    sample = builder.AddSystem(ZeroOrderHold(period, states.size()))
    builder.Connect(states, sample.get_input_port())
    for port in (sample.get_output_port(), source.get_output_port()):
        log = builder.AddSystem(VectorLogSink(port.size(), period))
        builder.Connect(port, log.get_input_port())
    return builder.Build(), drive


def time_ours(
    robot: ad.Robot, options: ad.SimulationOptions
) -> tuple[float, np.ndarray]:
    """Return the wall time of our diagram [s], and where it ends."""
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    start = time.perf_counter()
    sim.run(DURATION, motion)
    wall_time = time.perf_counter() - start
    return wall_time, np.array(sim.joint_states().position)


def time_peer(
    robot: ad.Robot, options: ad.SimulationOptions, commands: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the wall time of the peer [s], and where it ends."""
    diagram, drive = make_peer(robot, options, commands)
    simulator = Simulator(diagram)
    simulator.Initialize()
    start = time.perf_counter()
    simulator.AdvanceTo(DURATION)
    wall_time = time.perf_counter() - start
    plant = diagram.GetSubsystemByName("plant")
    q = plant.GetPositions(plant.GetMyContextFromRoot(simulator.get_context()))
    del drive
    return wall_time, q


def measure(runs: int, time_step: float) -> dict[str, float]:
    """Return medians [ms per simulated second] and the ratio, run by run in turns."""
    robot = ad.load_robot("doosan_a0912")
    options = ad.SimulationOptions(time_step=time_step)
    commands = record_commands(robot, options)
    times = []
    for _ in range(runs + 1):
        our_time, our_end = time_ours(robot, options)
        peer_time, peer_end = time_peer(robot, options, commands)
        if not np.allclose(our_end, peer_end, rtol=0.0, atol=1e-9):
            raise RuntimeError(f"different work: {our_end} and {peer_end}")
        times.append((our_time, peer_time))
    # The first run warms up.
    ours, peer = (1e3 * np.array(times[1:]) / DURATION).T
    ratios = sorted((ours / peer).tolist())
    return {
        "time_step": time_step,
        "ours": statistics.median(ours.tolist()),
        "peer": statistics.median(peer.tolist()),
        "ratio": statistics.median(ratios),
        "ratio_min": ratios[0],
        "ratio_max": ratios[-1],
        "real_time_factor": 1e3 / statistics.median(ours.tolist()),
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
    print(
        f"goals at 1 ms: ratio at most {GOAL_RATIO}, at least "
        f"{GOAL_REAL_TIME_FACTOR:.0f} x real time"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
