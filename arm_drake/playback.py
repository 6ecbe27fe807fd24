"""Sends the steps of a motion to the controllers of a simulation."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from arm_drake.errors import InputError, MotionError
from arm_drake.messages import (
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    JointTrajectory,
    SpeedScalingFactor,
    SwitchController,
)
from arm_drake.motion import Motion, MotionStep

if TYPE_CHECKING:
    from arm_drake.simulation import Simulation


def check_motion(simulation: "Simulation", motion: Motion) -> None:
    """Raise MotionError if a step is for a controller that can't take it.

    A controller that isn't active must have been activated by an earlier step; whether
    that switch works is seen when its time comes.

    Args:
        simulation: What is to run the motion.
        motion: The motion.
    """
    states = {row.name: row.state for row in simulation.list_controllers()}
    activated: set[str] = set()
    for step in motion.steps:
        try:
            if isinstance(step.message, SwitchController):
                activated |= _check_switch(simulation, step.message)
            else:
                _check_message(simulation, step, states, activated)
        except InputError as error:
            raise MotionError(
                error.problem, file=motion.file, where=step.where
            ) from None


def send_step(simulation: "Simulation", motion: Motion, step: MotionStep) -> None:
    """Send a step's message.

    Args:
        simulation: What runs the motion.
        motion: The motion.
        step: Its step.
    """
    where, message = motion.place(step), step.message
    if isinstance(message, SwitchController):
        simulation.request_switch(message, where=where)
        return
    handle = simulation.controller(_receiver(step))
    if message is None:
        handle.cancel()
    elif isinstance(message, FollowJointTrajectoryGoal):
        handle.send_goal(message, where=where)
    elif isinstance(message, JointTrajectory):
        handle.send_trajectory(message, where=where)
    elif isinstance(message, Float64MultiArray):
        handle.command(message.data, where=where)
    elif isinstance(message, SpeedScalingFactor):
        handle.set_speed_scaling(message.factor, where=where)


def _check_switch(simulation: "Simulation", message: SwitchController) -> set[str]:
    """Return what a switch activates; raise InputError if it names no controller."""
    for name in (*message.activate_controllers, *message.deactivate_controllers):
        simulation.directory.check_name(name)
    return set(message.activate_controllers)


def _check_message(
    simulation: "Simulation",
    step: MotionStep,
    states: Mapping[str, str],
    activated: set[str],
) -> None:
    name = _receiver(step)
    simulation.controller(name).check(step.message)
    if states[name] != "active" and name not in activated:
        raise InputError(f"controller {name!r} is {states[name]}, not active")


def _receiver(step: MotionStep) -> str:
    assert step.controller is not None  # Only a switch is for nobody.
    return step.controller
