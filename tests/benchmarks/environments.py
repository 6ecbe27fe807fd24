"""Steps per second of environments, beside MuJoCo's Reacher.

All take random actions, in turns in one process; time is the processor's. A step of
Reacher is 0.02 s of two joints, of ours 0.05 s of all of an arm, with its controller.
Without MuJoCo and imageio, which Gymnasium
imports with it, the row of Reacher is left out.

    python -m tests.benchmarks.environments [--robots NAME ...] [--steps 300]
"""

import argparse
import importlib.util
import statistics
import time
from typing import Any

import gymnasium

ROBOTS = ("doosan_a0912", "lab5_arm")
REACH = "arm_drake.environments:ArmDrake/Reach-v0"

# Turns of each, of which the median counts.
TURNS = 5


def measure(environment: Any, steps: int) -> float:
    """Return the processor's time of a step, resets among them [s]."""
    environment.reset()
    begin = time.process_time()
    for _ in range(steps):
        done = environment.step(environment.action_space.sample())[2:4]
        if any(done):
            environment.reset()
    return (time.process_time() - begin) / steps


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    parser.add_argument("--steps", type=int, default=300)
    arguments = parser.parse_args()
    made = {
        f"Reach-v0, {name}": gymnasium.make(REACH, robot=name)
        for name in arguments.robots
    }
    if all(map(importlib.util.find_spec, ("mujoco", "imageio"))):
        made["Reacher-v5, MuJoCo"] = gymnasium.make("Reacher-v5")
    times: dict[str, list[float]] = {name: [] for name in made}
    for environment in made.values():
        environment.reset(seed=0)
        environment.action_space.seed(0)
    for _ in range(TURNS):
        for name, environment in made.items():
            times[name].append(measure(environment, arguments.steps))
    print(f"{'environment':28} {'steps/s':>9} {'simulated s/s':>14}")
    for name, environment in made.items():
        median = statistics.median(times[name])
        inner = environment.unwrapped
        period = getattr(inner, "period", None) or inner.dt
        print(f"{name:28} {1.0 / median:9.0f} {period / median:14.1f}")


if __name__ == "__main__":
    main()
