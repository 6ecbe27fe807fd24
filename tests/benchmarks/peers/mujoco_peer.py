"""MuJoCo: as its users run it, and with the ideal servo written for it."""

from functools import partial

import mujoco
import mujoco.rollout
import numpy as np

from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.robots import damping_of
from tests.benchmarks.peers.servo_law import SampledServo, exact, sampled
from tests.benchmarks.peers.task import (
    STEPS,
    Contestant,
    Recording,
    Runner,
    Task,
    substeps,
)

ENGINE = "MuJoCo"

# Position actuators under the integrator that MuJoCo recommends for them.
USUAL = "position actuators, implicitfast"

# The same in MuJoCo's own loop, which needs all commands beforehand.
ROLLOUT = "position actuators, mujoco.rollout"

_INTEGRATORS = {
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
}


def make_contestants(task: Task, *, num_arms: int = 1) -> list[Contestant]:
    """Return position actuators, and both forms of the ideal servo."""
    found = []
    for step in STEPS:
        make = partial(make_positioned, task, step, num_arms)
        found.append(Contestant(ENGINE, USUAL, "pd", step, make))
        make = partial(make_rolled_out, task, step, num_arms)
        found.append(Contestant(ENGINE, ROLLOUT, "pd", step, make))
        if num_arms > 1 or task.mimics:
            continue
        for setting, law in (("our servo, Python", sampled), ("exact ZOH", exact)):
            driven = partial(make_driven, task, step, law(step))
            found.append(Contestant(ENGINE, setting, "servo", step, driven))
    return found


def make_model(
    task: Task, step: float, num_arms: int, *, is_positioned: bool
) -> mujoco.MjModel:
    """Return the arms, with mimic joints as constraints.

    Args:
        task: Whose robot it is.
        step: Step of the physics [s].
        num_arms: How many of them.
        is_positioned: Whether they have position actuators; their weight is held then.
    """
    world = mujoco.MjSpec()
    # As it does by itself with a URDF: links that are fixed to others become theirs.
    world.compiler.degree, world.compiler.fusestatic = False, True
    for i in range(num_arms):
        arm = mujoco.MjSpec.from_string(task.urdf)
        for geometry in arm.geoms:
            # Links of one robot pass through each other, but not through a floor.
            geometry.contype, geometry.conaffinity = 1, 2
        if is_positioned:
            for body in arm.bodies:
                body.gravcomp = 1.0
            for j, name in enumerate(task.joints):
                _add_actuator(arm, name, float(task.kp[j]), float(task.kd[j]))
        _set_joints(arm, task)
        frame = world.worldbody.add_frame(pos=[0.0, 2.0 * i, 0.0])
        world.attach(arm, prefix=f"arm{i}/", frame=frame)
    world.option.timestep = step
    world.option.integrator = _INTEGRATORS["implicitfast" if is_positioned else "Euler"]
    return world.compile()


def _add_actuator(arm: mujoco.MjSpec, joint: str, kp: float, kd: float) -> None:
    actuator = arm.add_actuator(
        name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    actuator.set_to_position(kp=kp, kv=kd)


def _set_joints(arm: mujoco.MjSpec, task: Task) -> None:
    """Give joints the URDF's damping, and no limits of efforts.

    Gains as stiff as these reach the limits of light wrists at every jump of a command.
    """
    for name, damping in damping_of(task.urdf).items():
        joint = arm.joint(name)
        joint.damping = np.resize([damping, 0.0, 0.0], np.size(joint.damping))
        joint.actfrclimited = 0


def make_positioned(task: Task, step: float, num_arms: int) -> Runner:
    """Return arms with position actuators; a velocity is folded into the command."""
    model = make_model(task, step, num_arms, is_positioned=True)
    data = mujoco.MjData(model)
    # The last arm is recorded.
    at = [model.joint(f"arm{num_arms - 1}/{name}").qposadr[0] for name in task.joints]
    rows = commands_of(task).folded(task.kd / task.kp)
    commands = np.tile(rows, num_arms)
    number = substeps(step)

    def run() -> Recording:
        q, v = (
            np.empty((task.num_ticks, model.nq)),
            np.empty((task.num_ticks, model.nv)),
        )
        for tick, row in enumerate(commands):
            q[tick], v[tick] = data.qpos, data.qvel
            data.ctrl[:] = row
            mujoco.mj_step(model, data, number)
        return Recording(q[:, at], v[:, at])

    return Runner(partial(mujoco.mj_resetData, model, data), run)


def make_rolled_out(task: Task, step: float, num_arms: int) -> Runner:
    """Return the same arms in a loop in C; every step is recorded, as it does."""
    model = make_model(task, step, num_arms, is_positioned=True)
    data = mujoco.MjData(model)
    at = [model.joint(f"arm{num_arms - 1}/{name}").qposadr[0] for name in task.joints]
    rows = commands_of(task).folded(task.kd / task.kp)
    number = substeps(step)
    commands = np.repeat(np.tile(rows, num_arms), number, axis=0)[None]
    start = np.concatenate([[0.0], data.qpos, data.qvel, data.act])

    def run() -> Recording:
        states, _ = mujoco.rollout.rollout(model, data, start, commands)
        found = np.vstack([start, states[0, number - 1 :: number][:-1]])
        q, v = found[:, 1 : 1 + model.nq], found[:, 1 + model.nq :][:, : model.nv]
        return Recording(q[:, at], v[:, at])

    return Runner(partial(mujoco.mj_resetData, model, data), run)


def make_driven(task: Task, step: float, servo: SampledServo) -> Runner:
    """Return an arm whose efforts are computed in Python, at every step.

    They are those for an acceleration u of what MuJoCo's step moves: M + h D.
    """
    model = make_model(task, step, 1, is_positioned=False)
    data = mujoco.MjData(model)
    at = [model.joint(f"arm0/{name}").qposadr[0] for name in task.joints]
    firsts, others = (_in_order(part, at) for part in servo.commands(commands_of(task)))
    kp, kd, number = servo.kp, servo.kd, substeps(step)
    implicit, moved = step * model.dof_damping, np.zeros(model.nv)

    def run() -> Recording:
        q, v = (
            np.empty((task.num_ticks, model.nq)),
            np.empty((task.num_ticks, model.nv)),
        )
        for tick in range(task.num_ticks):
            q[tick], v[tick] = data.qpos, data.qvel
            wanted = firsts[tick]
            for _ in range(number):
                u = wanted - kp * data.qpos - kd * data.qvel
                mujoco.mj_step1(model, data)
                mujoco.mj_mulM(model, data, moved, u)
                data.qfrc_applied[:] = (
                    moved + implicit * u + data.qfrc_bias - data.qfrc_passive
                )
                mujoco.mj_step2(model, data)
                wanted = others[tick]
        return Recording(q[:, at], v[:, at])

    return Runner(partial(mujoco.mj_resetData, model, data), run)


def _in_order(values: np.ndarray, at: list[int]) -> np.ndarray:
    """Return columns of the task's joints in MuJoCo's order."""
    found = np.zeros_like(values)
    found[:, at] = values
    return found
