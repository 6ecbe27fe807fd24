"""The diagram of a robot without Python: what its own code is measured against.

It has the same plant, servo, friction and logs as ours. Its commands come from Drake's
TrajectorySource and hold from tick to tick, without a delay.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource, VectorLogSink, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

import arm_drake as ad
from arm_drake.hardware.drives import (
    RobotDrive,
    commanded_joints,
    effort_limits,
    make_robot_drive,
)
from arm_drake.hardware.hardware import Hardware, add_hardware, connect_forces
from arm_drake.plant.joint_ranges import find_gripper_joints
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    filter_self_collision,
    set_initial_positions,
)
from arm_drake.python_system import PythonSystem
from arm_drake.timing import choose_time_step
from arm_drake.worlds.world import add_world

# Names of the system that holds the joints' states, and of the logs of these and of the
# commands.
SAMPLE = "sample"
STATE_LOG, COMMAND_LOG = "log:joint_states", "log:commands"


class EmptyTick(PythonSystem):
    """A tick in Python that does nothing, in a system with numbers and an object.

    That is the least that a controller manager in Python can take.
    """

    def __init__(self, period: float) -> None:
        super().__init__()
        self.DeclareDiscreteState(50)
        self.DeclareAbstractState(AbstractValue.Make(_Kept()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, lambda *_: None)


class _Kept:
    """An object that copies as itself."""

    def __deepcopy__(self, memo: object) -> "_Kept":
        return self


class _Silent(PythonSystem):
    """A controller that is never asked."""


def build_cpp_only(
    robots: Sequence[ad.Robot],
    options: ad.SimulationOptions,
    commands: NDArray[np.float64],
    *,
    has_empty_tick: bool = False,
) -> tuple[Diagram, list[RobotDrive]]:
    """Return the diagram without Python, and the drives that must outlive it.

    Args:
        robots: Robots of one kind, with n commanded joints each.
        options: How to simulate.
        commands: What each servo is told from each tick on, shape (ticks, 2n or 7n).
        has_empty_tick: Whether there is a tick in Python for each robot that does
            nothing, in one system, with two more for a controller and a broadcaster.
    """
    step, (period,) = choose_time_step(
        options.time_step, [robots[0].controllers.update_rate]
    )
    builder = DiagramBuilder()
    plant, scene_graph = add_plant(builder, step, options)
    add_world(plant, "empty")
    models = []
    for robot in robots:
        model = add_robot_model(plant, robot.description, robot.name, robot.pose)
        joints = commanded_joints(robot.description)
        names = [joint.name for joint in joints]
        add_actuators(plant, model, names, effort_limits(joints))
        set_initial_positions(plant, model, dict(robot.initial_positions))
        models.append(model)
    plant.Finalize()
    drives, forces = [], {}
    for robot, model in zip(robots, models, strict=True):
        filter_self_collision(plant, scene_graph, model)
        prefix = f"{robot.name}/" if len(robots) > 1 else ""
        drive = make_robot_drive(
            robot.description,
            robot.pose,
            options,
            step,
            grippers={joint.name for joint in find_gripper_joints(robot)},
            period=period,
        )
        hardware = add_hardware(
            builder,
            plant,
            model,
            robot.description,
            prefix=prefix,
            drive=drive,
            initial=robot.initial_positions,
            options=options,
            has_modes=commands.shape[1] > 2 * len(drive.names),
        )
        if hardware.friction is not None:
            forces[model] = hardware.friction
        _add_commands_and_logs(builder, hardware, commands, period, prefix)
        if has_empty_tick:
            for system in (EmptyTick(period), _Silent(), _Silent()):
                builder.AddSystem(system)
        drives.append(drive)
    connect_forces(builder, plant, forces)
    return builder.Build(), drives


def _add_commands_and_logs(
    builder: DiagramBuilder,
    hardware: Hardware,
    commands: NDArray[np.float64],
    period: float,
    prefix: str,
) -> None:
    assert hardware.command is not None
    ticks = period * np.arange(len(commands) + 1)
    held = PiecewisePolynomial.ZeroOrderHold(
        ticks, np.vstack([commands, commands[-1:]]).T
    )
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), hardware.command)
    # What our broadcaster holds and our rollout records.
    states = hardware.joint_states
    sample = ZeroOrderHold(period, states.size())
    builder.AddNamedSystem(prefix + SAMPLE, sample)
    builder.Connect(states, sample.get_input_port())
    for name, port in (
        (STATE_LOG, sample.get_output_port()),
        (COMMAND_LOG, source.get_output_port()),
    ):
        log = builder.AddNamedSystem(prefix + name, VectorLogSink(port.size(), period))
        builder.Connect(port, log.get_input_port())
