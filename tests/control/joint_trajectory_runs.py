"""Runs of a joint_trajectory_controller's tick, with a plant of one line."""

import dataclasses as dc
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from arm_drake.control.tolerances import make_default_tolerances
from arm_drake.controllers.joint_trajectory.controller import tick
from arm_drake.controllers.joint_trajectory.state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    TickInputs,
    TrajectoryRules,
)
from arm_drake.messages import (
    ActionRequest,
    FollowJointTrajectoryGoal,
    GoalEvent,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    SendGoal,
    SpeedScalingFactor,
    Time,
)

JOINTS = ("joint1", "joint2", "joint3")
START = (1.1, 2.1, 3.1)
PERIOD_NS = 10_000_000
MONITOR_NS = 50_000_000

# From the measured positions before a tick and the command in it to those after it.
Plant = Callable[[np.ndarray, np.ndarray], np.ndarray]


def follow(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
    return command


def stick(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
    return measured


def lag(measured: np.ndarray, command: np.ndarray) -> np.ndarray:
    return measured + 0.5 * (command - measured)


def make_rules(
    joints: tuple[str, ...] = JOINTS,
    *,
    path: float = 0.0,
    goal: float = 0.0,
    goal_time: float = 0.0,
    allow: Sequence[str] = (),
    **changes: Any,
) -> JointTrajectoryRules:
    n = len(joints)
    tolerances = make_default_tolerances(
        [path] * n, [goal] * n, stopped_velocity_tolerance=0.01, goal_time=goal_time
    )
    allowed = TrajectoryRules(joints, **{f"allow_{what}": True for what in allow})
    rules = JointTrajectoryRules(allowed, tolerances, PERIOD_NS, MONITOR_NS)
    return dc.replace(rules, **changes)


def make_message(
    *points: tuple[float, Sequence[float]],
    joints: tuple[str, ...] = JOINTS,
    velocities: Sequence[float] = (),
    stamp: float = 0.0,
) -> JointTrajectory:
    """Return a message; a point is its time [s] and its positions."""
    return JointTrajectory(
        Header(stamp=Time.of(stamp)),
        joints,
        [JointTrajectoryPoint(q, velocities, time_from_start=t) for t, q in points],
    )


def make_goal(message: JointTrajectory, **fields: Any) -> SendGoal:
    return SendGoal(FollowJointTrajectoryGoal(message, **fields))


def run(
    rules: JointTrajectoryRules,
    until: float,
    *,
    plant: Plant = follow,
    start: Sequence[float] = START,
    velocity: Sequence[float] | None = None,
    topic: dict[float, JointTrajectory] | None = None,
    requests: dict[float, ActionRequest] | None = None,
    factors: dict[float, float] | None = None,
) -> list[JointTrajectoryState]:
    """Return the states after the ticks 0, 0.01 s, ... with messages by time [s]."""
    state, measured = JointTrajectoryState(), np.array(start)
    speed = None if velocity is None else np.array(velocity)
    num_commanded = len(rules.commanded_joints or rules.joints)
    held = np.full(num_commanded * len(rules.command_interfaces), np.nan)
    states = []
    for k in range(round(until * 100) + 1):
        message, request = (topic or {}).get(k / 100), (requests or {}).get(k / 100)
        factor = (factors or {}).get(k / 100)
        inputs = TickInputs(
            k * PERIOD_NS,
            PERIOD_NS,
            measured,
            speed,
            commands=functools.partial(np.array, held),
            topics=() if message is None else (message,),
            requests=() if request is None else (request,),
            scaling_factors=() if factor is None else (SpeedScalingFactor(factor),),
        )
        state = tick(rules, state, inputs)
        states.append(state)
        held = np.where(np.isnan(state.command), held, state.command)
        measured = plant(measured, held[: len(measured)])
    return states


def commands(states: Sequence[JointTrajectoryState]) -> np.ndarray:
    return np.array([state.command for state in states])


def references(states: Sequence[JointTrajectoryState]) -> np.ndarray:
    return np.array([state.desired.position for state in states])


def news(states: Sequence[JointTrajectoryState], goal: SendGoal) -> list[Any]:
    """Return (tick, status, result) of all news of a goal but feedback."""
    found: dict[int, Any] = {}
    for k, state in enumerate(states):
        for number, event in state.events:
            if isinstance(event, GoalEvent) and event.request is goal:
                found.setdefault(number, (k, event))
    return [
        (k, event.status, event.result)
        for k, event in found.values()
        if event.feedback is None
    ]


def feedback(states: Sequence[JointTrajectoryState]) -> list[Any]:
    """Return (tick, feedback)."""
    found: dict[int, Any] = {}
    for k, state in enumerate(states):
        for number, event in state.events:
            if isinstance(event, GoalEvent) and event.feedback is not None:
                found.setdefault(number, (k, event.feedback))
    return list(found.values())
