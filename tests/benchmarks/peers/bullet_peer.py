"""PyBullet: its position control."""

import contextlib
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pybullet

from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.robots import Mimic, damping_of
from tests.benchmarks.peers.task import (
    STEPS,
    Contestant,
    Recording,
    Runner,
    Task,
    substeps,
)

ENGINE = "PyBullet"

# A velocity constraint of its own; gains have no units.
USUAL = "POSITION_CONTROL"


def make_contestants(task: Task, *, num_arms: int = 1) -> list[Contestant]:
    """Return position control at all steps."""
    return [
        Contestant(
            ENGINE, USUAL, "own", step, partial(make_usual, task, step, num_arms)
        )
        for step in STEPS
    ]


def make_usual(task: Task, step: float, num_arms: int) -> Runner:
    """Return arms under position control, without gravity."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(step, physicsClientId=client)
    flags = pybullet.URDF_MERGE_FIXED_LINKS | pybullet.URDF_USE_INERTIA_FROM_FILE
    with tempfile.TemporaryDirectory() as folder, silence():
        file = Path(folder) / "robot.urdf"
        file.write_text(task.urdf)
        arms = [
            pybullet.loadURDF(
                str(file),
                [0.0, 2.0 * i, 0.0],
                useFixedBase=True,
                flags=flags,
                physicsClientId=client,
            )
            for i in range(num_arms)
        ]
    count = pybullet.getNumJoints(arms[0], physicsClientId=client)
    infos = [pybullet.getJointInfo(arms[0], i, client) for i in range(count)]
    index = {info[1].decode(): info[0] for info in infos}
    efforts = {info[1].decode(): info[10] or 1e4 for info in infos}
    moved = [index[name] for name in task.joints]
    forces = [efforts[name] for name in task.joints]
    movable = [index[name] for name in damping_of(task.urdf)]
    for arm in arms:
        # It has motors that brake from the start, and friction for all links.
        pybullet.setJointMotorControlArray(
            arm,
            movable,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(movable),
            physicsClientId=client,
        )
        for mimic in task.mimics:
            _add_gear(arm, index[mimic.master], index[mimic.follower], mimic, client)
    commands, number = commands_of(task), substeps(step)
    commanded = list(zip(commands.q.tolist(), commands.v.tolist(), strict=True))

    def prepare() -> None:
        for arm in arms:
            for i in movable:
                pybullet.resetJointState(arm, i, 0.0, 0.0, physicsClientId=client)

    def run() -> Recording:
        shape = task.num_ticks, len(moved)
        q, v = np.empty(shape), np.empty(shape)
        for tick, (positions, velocities) in enumerate(commanded):
            states = pybullet.getJointStates(arms[-1], moved, client)
            q[tick] = [state[0] for state in states]
            v[tick] = [state[1] for state in states]
            for arm in arms:
                pybullet.setJointMotorControlArray(
                    arm,
                    moved,
                    pybullet.POSITION_CONTROL,
                    targetPositions=positions,
                    targetVelocities=velocities,
                    forces=forces,
                    physicsClientId=client,
                )
            for _ in range(number):
                pybullet.stepSimulation(client)
        return Recording(q, v)

    return Runner(prepare, run)


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Keep what Bullet prints about every link off the standard output."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def _add_gear(arm: int, master: int, follower: int, mimic: Mimic, client: int) -> None:
    """Let a joint follow another one, which Bullet calls a gear."""
    gear = pybullet.createConstraint(
        arm,
        master,
        arm,
        follower,
        jointType=pybullet.JOINT_GEAR,
        jointAxis=[0, 0, 1],
        parentFramePosition=[0, 0, 0],
        childFramePosition=[0, 0, 0],
        physicsClientId=client,
    )
    pybullet.changeConstraint(
        gear, gearRatio=-mimic.factor, maxForce=100.0, physicsClientId=client
    )
