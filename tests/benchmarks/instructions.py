"""Instructions of a tick, as valgrind counts them.

A busy machine doesn't disturb the count, so it stands beside the times of the other
benchmarks. Counted is what `Simulator.AdvanceTo` runs between two ticks of 10 ms while
a six-joint arm plays a trajectory: the whole diagram, and the same without Python; the
same of four arms in one diagram, for each of them; and 1 ms of the myCobot with
Gazebo's plugins. Beside them, where MuJoCo is installed, what its `mj_step` takes for
10 ms of the same arm with position actuators. Without valgrind (Debian has it) there is
a message and no count.

    python -m tests.benchmarks.instructions [--ticks 50]
"""

import argparse
import gc
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import ConstantVectorSource

import arm_drake as ad
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint
from tests.benchmarks.cpp_only import build_cpp_only

ROBOT, PERIOD, GAZEBO_PERIOD = "doosan_a0912", 0.01, 0.001
JOINTS = tuple(f"joint{i}" for i in range(1, 7))

# Robots in one diagram.
ARMS = 4

# What is counted, and what callgrind writes a file before.
ADVANCE = "drake::systems::Simulator<double>::AdvanceTo(double const&)"
MUJOCO = "mj_step"
MARK = "drake::systems::Simulator<double>::Initialize*"

# Ticks before the count begins.
WARM_UP = 50

# Tells the process under valgrind where the counts are.
COUNTS = "ARM_DRAKE_COUNTS"

Advance = Callable[[float], object]


def make_trajectory() -> JointTrajectory:
    points = [
        JointTrajectoryPoint(6 * [0.3 * (k % 2)], 6 * [0.0], time_from_start=1.0 + k)
        for k in range(12)
    ]
    return JointTrajectory(joint_names=JOINTS, points=points)


def without_python(options: ad.SimulationOptions) -> Advance:
    robot = ad.load_robot(ROBOT)
    start = list(robot.initial_positions.values())[:6]
    commands = np.tile([*start, *np.zeros(6)], (1500, 1))
    commands[:, :6] += 0.1 * np.sin(PERIOD * np.arange(1500))[:, None]
    diagram, drive = build_cpp_only([robot], options, commands)
    simulator = Simulator(diagram)
    simulator.Initialize()

    def advance(time: float) -> object:
        return simulator.AdvanceTo(time), drive

    return advance


def with_python(options: ad.SimulationOptions, *, is_goal: bool) -> Advance:
    sim = ad.Simulation(ad.build_diagram(ad.load_robot(ROBOT), options=options))
    arm = sim.controller("joint_trajectory_controller")
    (arm.send_goal if is_goal else arm.send_trajectory)(make_trajectory())
    return sim.advance_to


def with_arms(options: ad.SimulationOptions) -> Advance:
    robots = [
        ad.load_robot(ROBOT, name=f"arm{i}", pose=(3.0 * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        for i in range(ARMS)
    ]
    sim = ad.Simulation(ad.build_diagram(robots, options=options))
    for robot in robots:
        arm = sim.controller(f"{robot.name}/joint_trajectory_controller")
        arm.send_trajectory(make_trajectory())
    return sim.advance_to


def with_plugins() -> Advance:
    robot = ad.load_robot("mycobot_280", xacro_args={"control": "gazebo"})
    return ad.Simulation(ad.build_diagram(robot, world="void")).advance_to


def with_mujoco(step: float) -> Advance:
    # Not at the top: it is compared with where it is installed.
    import mujoco

    from tests.benchmarks.peers.mujoco_peer import make_model
    from tests.benchmarks.peers.task import make_tasks

    (task,) = (task for task in make_tasks(4.0) if task.name == ROBOT)
    model = make_model(task, step, 1, is_positioned=True)
    data, rows = mujoco.MjData(model), task.wanted()

    def advance(time: float) -> object:
        for tick in range(round(data.time / PERIOD), round(time / PERIOD)):
            data.ctrl[:] = rows[tick]
            mujoco.mj_step(model, data, round(PERIOD / step))
        return None

    return advance


def cases() -> Iterator[tuple[str, float, Callable[[], Advance], int]]:
    """Yield names, periods [s], what makes a simulation, and of how many robots."""
    for preset in ("fast", "accurate"):
        options = ad.SimulationOptions(preset=preset, time_step=PERIOD)
        yield f"{preset}, C++ only", PERIOD, lambda o=options: without_python(o), 1
        for text, is_goal in (("a trajectory", False), ("a goal, with feedback", True)):
            yield (
                f"{preset}, {text}",
                PERIOD,
                lambda o=options, g=is_goal: with_python(o, is_goal=g),
                1,
            )
    yield f"accurate, each of {ARMS} arms", PERIOD, lambda o=options: with_arms(o), ARMS
    yield "accurate, the myCobot's plugins", GAZEBO_PERIOD, with_plugins, 1
    if importlib.util.find_spec("mujoco") is not None:
        for step in (0.001, 0.002, 0.01):
            name = f"MuJoCo, position actuators, steps of {1e3 * step:.0f} ms"
            yield name, PERIOD, lambda h=step: with_mujoco(h), 1


def count(folder: Path, num_ticks: int) -> None:
    """Print the instructions of a tick of each case, under valgrind."""
    marker = Simulator(ConstantVectorSource(np.zeros(1)))
    gc.disable()
    for name, period, make, num_robots in cases():
        advance = make()
        start = (WARM_UP + 0.5) * period
        advance(start)
        marker.Initialize()
        advance(start + num_ticks * period)
        marker.Initialize()
        newest = max(folder.glob("out.*"), key=lambda path: int(path.suffix[1:]))
        line = next(x for x in newest.open() if x.startswith(("summary", "totals")))
        counted = int(line.split()[1]) / num_ticks / num_robots
        print(f"| {name} | {counted:,.0f} |", flush=True)


def main() -> None:
    """Count, under valgrind if there is one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=50)
    num_ticks = parser.parse_args().ticks
    if COUNTS in os.environ:
        count(Path(os.environ[COUNTS]), num_ticks)
        return
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        print("instructions aren't counted: there is no valgrind", flush=True)
        return
    print("| what runs | instructions in a tick |\n| --- | --- |", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(valgrind, "--tool=callgrind", "--quiet"),
            *(f"--toggle-collect={name}" for name in (ADVANCE, MUJOCO)),
            f"--dump-before={MARK}",
            f"--callgrind-out-file={folder}/out",
            *(sys.executable, "-m", "tests.benchmarks.instructions"),
            *("--ticks", str(num_ticks)),
        ]
        more = {COUNTS: folder, "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
        subprocess.run(command, env={**os.environ, **more}, check=True)


if __name__ == "__main__":
    main()
