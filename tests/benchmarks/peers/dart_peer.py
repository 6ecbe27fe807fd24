"""DART, the engine of Gazebo: implicit springs, and velocities as gz_ros2_control's."""

from functools import partial

import dartpy as dart
import numpy as np

from tests.benchmarks.peers.commands import commands_of
from tests.benchmarks.peers.task import (
    PERIOD,
    STEPS,
    Contestant,
    Recording,
    Runner,
    Task,
    substeps,
)

ENGINE = "DART"

# The same law as a PD servo.
USUAL = "implicit springs"

# What gz_ros2_control makes of a position: a velocity that closes this part of the
# error in a period.
GAZEBO, _GAZEBO_GAIN = "velocities as gz_ros2_control", 0.1


def make_contestants(task: Task, *, num_arms: int = 1) -> list[Contestant]:
    """Return springs, and for one arm Gazebo's velocities at its usual step."""
    found = [
        Contestant(
            ENGINE, USUAL, "pd", step, partial(make_sprung, task, step, num_arms)
        )
        for step in STEPS
    ]
    if num_arms == 1:
        make = partial(make_gazebo, task, STEPS[0])
        found.append(Contestant(ENGINE, GAZEBO, "own", STEPS[0], make))
    return found


def make_world(
    task: Task, step: float, num_arms: int
) -> tuple[dart.simulation.World, list[dart.dynamics.Skeleton]]:
    """Return the arms; without gravity, for their weight is held."""
    world = dart.simulation.World()
    world.setTimeStep(step)
    world.setGravity([0.0, 0.0, 0.0])
    fixed = dart.utils.DartLoaderRootJointType.FIXED
    loader = dart.utils.DartLoader()
    loader.setOptions(dart.utils.DartLoaderOptions(defaultRootJointType=fixed))
    arms = []
    for i in range(num_arms):
        arm = loader.parseSkeletonString(task.urdf, dart.common.Uri())
        arm.setName(f"arm{i}")
        # Far from each other.
        root = arm.getRootJoint()
        pose = dart.math.Isometry3()
        pose.set_translation([0.0, 2.0 * i, 0.0])
        root.setTransformFromParentBodyNode(pose)
        world.addSkeleton(arm)
        arms.append(arm)
    return world, arms


def make_sprung(task: Task, step: float, num_arms: int) -> Runner:
    """Return arms whose joints have springs that rest at the command."""
    world, arms = make_world(task, step, num_arms)
    for arm in arms:
        for i, name in enumerate(task.joints):
            joint = arm.getJoint(name)
            joint.setSpringStiffness(0, float(task.kp[i]))
            damping = joint.getDampingCoefficient(0) + float(task.kd[i])
            joint.setDampingCoefficient(0, damping)
    joints = [[arm.getJoint(name) for name in task.joints] for arm in arms]
    commands = commands_of(task).folded(task.kd / task.kp).tolist()
    at = [arms[-1].getDof(name).getIndexInSkeleton() for name in task.joints]
    number = substeps(step)

    def prepare() -> None:
        for arm in arms:
            arm.resetPositions()
            arm.resetVelocities()

    def run() -> Recording:
        last = arms[-1]
        shape = task.num_ticks, last.getNumDofs()
        q, v = np.empty(shape), np.empty(shape)
        for tick, row in enumerate(commands):
            q[tick], v[tick] = last.getPositions(), last.getVelocities()
            for arm in joints:
                for joint, position in zip(arm, row, strict=True):
                    joint.setRestPosition(0, position)
            for _ in range(number):
                world.step()
        return Recording(q[:, at], v[:, at])

    return Runner(prepare, run)


def make_gazebo(task: Task, step: float) -> Runner:
    """Return an arm whose velocities close part of the position errors."""
    world, (arm,) = make_world(task, step, 1)
    joints = [arm.getJoint(name) for name in task.joints]
    for joint in joints:
        joint.setActuatorType(dart.dynamics.ActuatorType.VELOCITY)
    commands = commands_of(task).q
    at = [arm.getDof(name).getIndexInSkeleton() for name in task.joints]
    number, gain = substeps(step), _GAZEBO_GAIN / PERIOD

    def prepare() -> None:
        arm.resetPositions()
        arm.resetVelocities()
        arm.resetCommands()

    def run() -> Recording:
        shape = task.num_ticks, arm.getNumDofs()
        q, v = np.empty(shape), np.empty(shape)
        for tick, row in enumerate(commands):
            q[tick], v[tick] = arm.getPositions(), arm.getVelocities()
            speeds = gain * (row - q[tick, at])
            for joint, speed in zip(joints, speeds.tolist(), strict=True):
                joint.setCommand(0, speed)
            for _ in range(number):
                # True would forget the commands.
                world.step(False)
        return Recording(q[:, at], v[:, at])

    return Runner(prepare, run)
