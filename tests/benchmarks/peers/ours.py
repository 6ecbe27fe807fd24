"""Our simulation, as anyone would build it, and the same in C++ only."""

from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

import arm_drake as ad
from arm_drake.hardware.drives import commanded_joints
from arm_drake.options import PRESETS
from tests.benchmarks.cpp_only import SAMPLE, STATE_LOG, build_cpp_only
from tests.benchmarks.peers import robots
from tests.benchmarks.peers.commands import commands_of, make_goal
from tests.benchmarks.peers.task import (
    PERIOD,
    STEPS,
    Contestant,
    Recording,
    Runner,
    Task,
)

ENGINE = "arm_drake"
CPP_ONLY = "Drake, C++ only"

# Engine and setting of the default, and of the same without Python.
ACCURATE = (ENGINE, "accurate")
SAME = (CPP_ONLY, "same servo")

# The same with a tick in Python that does nothing: no controllers in Python take less.
EMPTY_TICK = (CPP_ONLY, "same servo, and an empty tick in Python")


def make_contestants(task: Task, *, num_arms: int = 1) -> list[Contestant]:
    """Return all presets with all steps, and the diagram without Python."""
    found = []
    for step in STEPS:
        for preset in PRESETS:
            if preset == "fast" and task.mimics:
                continue  # It would be "accurate" in fact.
            options = ad.SimulationOptions(time_step=step, preset=preset)
            make = partial(make_ours, task, options, num_arms)
            law = "own" if preset == "kinematic" else "servo"
            if preset != "kinematic" or step == STEPS[-1]:
                found.append(Contestant(ENGINE, preset, law, step, make))
        for setting, has_tick in ((SAME, False), (EMPTY_TICK, True)):
            make = partial(make_cpp_only, task, step, num_arms, has_empty_tick=has_tick)
            found.append(Contestant(*setting, "servo", step, make))
    return found


def make_ours(
    task: Task,
    options: ad.SimulationOptions,
    num_arms: int = 1,
    *,
    is_drawn: bool = False,
) -> Runner:
    """Return our diagram of one or several arms, and draw it if asked to."""
    names = [f"arm{i}" for i in range(num_arms)]
    arms = [
        robots.load(task.urdf, name=name, place=2.0 * i) for i, name in enumerate(names)
    ]
    meshcat = ad.start_meshcat() if is_drawn else None
    sim = ad.Simulation(ad.build_diagram(arms, options=options, meshcat=meshcat))
    goal = make_goal(task)
    joints = [j.name for j in arms[0].description.movable_joints]
    columns = [joints.index(name) for name in task.joints]
    every = round(PERIOD * (options.log_rate or robots.RATE))

    def prepare() -> None:
        sim.reset()
        for name in names:
            prefix = f"{name}/" if num_arms > 1 else ""
            sim.controller(prefix + robots.CONTROLLER).send_goal(goal)

    def run() -> Recording:
        sim.run(task.duration)
        rollout = sim.rollout(names[-1])
        rows = slice(None, every * task.num_ticks, every)
        return Recording(
            rollout.position[rows, columns], rollout.velocity[rows, columns]
        )

    return Runner(prepare, run)


def make_cpp_only(
    task: Task, step: float, num_arms: int = 1, *, has_empty_tick: bool = False
) -> Runner:
    """Return the same plant, servos and logs, told what our controller would tell."""
    arms = [
        robots.load(task.urdf, name=f"arm{i}", place=2.0 * i) for i in range(num_arms)
    ]
    description = arms[0].description
    names = [joint.name for joint in commanded_joints(description)]
    order = [task.joints.index(name) for name in names]
    commands = np.hstack([part[:, order] for part in commands_of(task)])
    options = ad.SimulationOptions(time_step=step)
    diagram, drives = build_cpp_only(
        arms, options, commands, has_empty_tick=has_empty_tick
    )
    simulator = Simulator(diagram)
    prefix = f"{arms[-1].name}/" if num_arms > 1 else ""
    joints = [j.name for j in description.movable_joints]
    columns = [joints.index(name) for name in task.joints]
    # The drives' plants must outlive the servos.
    keep: dict[str, Any] = {"drives": drives}

    def prepare() -> None:
        simulator.reset_context(diagram.CreateDefaultContext())
        simulator.Initialize()

    def run() -> Recording:
        assert keep
        simulator.AdvanceTo(task.duration)
        return _read(prefix, diagram, simulator, columns, task.num_ticks)

    return Runner(prepare, run)


def _read(
    prefix: str,
    diagram: Diagram,
    simulator: Simulator,
    columns: list[int],
    num_ticks: int,
) -> Recording:
    """Return what a log of held joint states holds: it shows each tick at the next."""
    context = simulator.get_context()
    sample = diagram.GetSubsystemByName(prefix + SAMPLE)
    log = diagram.GetSubsystemByName(prefix + STATE_LOG)
    last = sample.get_output_port().Eval(sample.GetMyContextFromRoot(context))
    rows = np.vstack([log.FindLog(context).data().T[1:], last])[:num_ticks]
    q, v, _ = np.split(rows, 3, axis=1)
    return Recording(q[:, columns], v[:, columns])
