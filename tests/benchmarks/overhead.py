"""The cost of our own code: a robot's diagram beside the same one in C++ only.

The peer has the same plant, servo, friction and logs; its commands are those that our
controller gave, from Drake's TrajectorySource, held from tick to tick. Both simulate
the tutorial's motion on the bundled Doosan A0912, in turns, in one process, and end in
the same state. Time is the processor's: what else runs on the machine doesn't count.

    python -m tests.benchmarks.overhead [--runs 7] [--json FILE]
"""

import argparse
import json
import statistics
import time
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.description.entry import bundled_motions
from tests.benchmarks.cpp_only import build_cpp_only

# The tutorial's motion ends then [s].
DURATION = 4.0

# What the ratio is to be at most, by the step [s].
GOALS = {0.001: 1.05, 0.01: 1.20}


def record_commands(robot: ad.Robot, options: ad.SimulationOptions) -> np.ndarray:
    """Return what our servo is told from each tick on, shape (ticks, 2n or 7n)."""
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    diagram = ad.build_diagram(robot, options=options)
    sim = ad.Simulation(diagram)
    port = diagram.GetSubsystemByName("commands").GetOutputPort("drive")
    rows = []
    for tick in range(round(DURATION * robot.controllers.update_rate)):
        sim.run((tick + 0.5) / robot.controllers.update_rate - sim.time, motion)
        motion = None
        context = port.get_system().GetMyContextFromRoot(sim.simulator.get_context())
        rows.append(port.Eval(context))
    return np.array(rows)


def time_ours(
    robot: ad.Robot, options: ad.SimulationOptions
) -> tuple[float, np.ndarray]:
    """Return the processor's time for our diagram [s], and where it ends."""
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    start = time.thread_time()
    sim.run(DURATION, motion)
    took = time.thread_time() - start
    return took, np.array(sim.joint_states().position)


def time_peer(
    robot: ad.Robot, options: ad.SimulationOptions, commands: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return the processor's time for the peer [s], and where it ends."""
    diagram, drive = build_cpp_only([robot], options, commands)
    simulator = Simulator(diagram)
    simulator.Initialize()
    start = time.thread_time()
    simulator.AdvanceTo(DURATION)
    took = time.thread_time() - start
    plant = diagram.GetSubsystemByName("plant")
    q = plant.GetPositions(plant.GetMyContextFromRoot(simulator.get_context()))
    del drive
    return took, q


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
    rows = [measure(options.runs, time_step) for time_step in GOALS]
    print("step [ms]  ours  C++ only [ms/s]  ratio (range)        x real time")
    for row in rows:
        print(
            f"{1e3 * row['time_step']:9.0f} {row['ours']:5.1f} {row['peer']:15.1f}  "
            f"{row['ratio']:.3f} ({row['ratio_min']:.3f} to {row['ratio_max']:.3f})"
            f"{row['real_time_factor']:12.1f}"
        )
    goals = (f"{ratio:.2f} at {1e3 * step:.0f} ms" for step, ratio in GOALS.items())
    print(f"goals of the ratio: {', '.join(goals)}")
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
