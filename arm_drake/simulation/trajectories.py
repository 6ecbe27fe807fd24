"""Trajectories and goals of a motion file, with the fields of the ROS messages."""

from typing import Any

from arm_drake.errors import suggest
from arm_drake.messages import (
    Duration,
    FollowJointTrajectoryGoal,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryPoint,
    Time,
)
from arm_drake.simulation.fields import Fields


def read_goal(fields: Fields, value: Any, where: str) -> FollowJointTrajectoryGoal:
    """Return a goal of the action.

    Args:
        fields: What checks the step's fields.
        value: The goal as the file has it.
        where: Its place in the step.

    Raises:
        MotionError: If it is malformed.
    """
    goal = dict(fields.mapping(value, where))
    tolerances = {
        name: _read_tolerances(fields, goal.pop(name, []), f"{where}.{name}")
        for name in ("path_tolerance", "goal_tolerance")
    }
    late = goal.pop("goal_time_tolerance", 0.0)
    # The action nests the trajectory; leaving that level out is fine.
    trajectory = goal.pop("trajectory", None)
    if trajectory is None:
        trajectory, goal = goal, {}
    if goal:
        raise fields.error(where, f"unknown key {next(iter(goal))!r}")
    time = fields.time(Duration, late, f"{where}.goal_time_tolerance")
    return FollowJointTrajectoryGoal(
        trajectory=read_trajectory(fields, trajectory, where),
        goal_time_tolerance=time,
        **tolerances,
    )


def read_trajectory(fields: Fields, value: Any, where: str) -> JointTrajectory:
    """Return a trajectory.

    Args:
        fields: What checks the step's fields.
        value: The trajectory as the file has it.
        where: Its place in the step.

    Raises:
        MotionError: If it is malformed.
    """
    data = dict(fields.mapping(value, where))
    header = fields.mapping(
        data.pop("header", {}), f"{where}.header", ("stamp", "frame_id")
    )
    names = fields.names(data.pop("joint_names", []), f"{where}.joint_names")
    points = fields.list(data.pop("points", []), f"{where}.points")
    if data:
        key = str(next(iter(data)))
        known = ["header", "joint_names", "points"]
        raise fields.error(where, f"unknown key {key!r}; {suggest(key, known)}")
    stamp = fields.time(Time, header.get("stamp", 0.0), f"{where}.header.stamp")
    return JointTrajectory(
        header=Header(stamp=stamp, frame_id=str(header.get("frame_id", ""))),
        joint_names=names,
        points=tuple(
            fields.build(JointTrajectoryPoint, point, f"{where}.points[{index}]")
            for index, point in enumerate(points)
        ),
    )


def _read_tolerances(
    fields: Fields, value: Any, where: str
) -> tuple[JointTolerance, ...]:
    return tuple(
        fields.build(JointTolerance, item, f"{where}[{index}]")
        for index, item in enumerate(fields.list(value, where))
    )
