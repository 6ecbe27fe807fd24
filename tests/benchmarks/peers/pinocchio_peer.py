"""A simulation that one writes oneself: Pinocchio's dynamics in a loop in Python."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.servo_law import SampledServo, exact, sampled
from tests.benchmarks.peers.task import (
    STEPS,
    Array,
    Contestant,
    Recording,
    Runner,
    Task,
    substeps,
)

ENGINE = "Pinocchio loop"


def make_contestants(task: Task, *, num_arms: int = 1) -> list[Contestant]:
    """Return both forms of the ideal servo, for a robot without mimic joints."""
    if task.mimics or num_arms > 1:
        return []
    return [
        Contestant(ENGINE, name, "servo", step, partial(make_loop, task, step, law))
        for step in STEPS
        for name, law in (("our servo", sampled), ("exact ZOH", exact))
    ]


def make_loop(task: Task, step: float, law: Callable[[float], SampledServo]) -> Runner:
    """Return semi-implicit steps of the dynamics, with the servo's efforts.

    The damping D is implicit as in the other engines: what moves is M + h D, which
    Pinocchio knows as rotor inertia.
    """
    model = pin.buildModelFromXML(task.urdf)
    order = [task.joints.index(name) for name in list(model.names)[1:]]
    damping = np.asarray(model.damping).copy()
    model.armature = step * damping
    data, servo, number = model.createData(), law(step), substeps(step)
    firsts, others = (part[:, order] for part in servo.commands(commands_of(task)))
    kp, kd = servo.kp, servo.kd

    def run() -> Recording:
        n = len(order)
        q, v = np.zeros(n), np.zeros(n)
        rows: tuple[Array, Array] = (
            np.empty((task.num_ticks, n)),
            np.empty((task.num_ticks, n)),
        )
        for tick in range(task.num_ticks):
            rows[0][tick], rows[1][tick] = q, v
            wanted = firsts[tick]
            for _ in range(number):
                u = wanted - kp * q - kd * v
                # The damping's own effort cancels on both sides.
                effort = pin.rnea(model, data, q, v, u)
                v = v + step * pin.aba(model, data, q, v, effort)
                q = q + step * v
                wanted = others[tick]
        back = np.argsort(order)
        return Recording(rows[0][:, back], rows[1][:, back])

    return Runner(lambda: None, run)
