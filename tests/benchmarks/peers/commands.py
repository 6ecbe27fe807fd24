"""The commands of a task, as our controllers give them."""

from functools import cache

import numpy as np

import arm_drake as ad
from arm_drake.hardware.drives import commanded_joints
from tests.benchmarks.peers import robots
from tests.benchmarks.peers.task import PERIOD, Commands, Task


def make_goal(task: Task) -> ad.JointTrajectory:
    """Return the motion as a controller's goal."""
    still = (0.0,) * len(task.joints)
    there = tuple(task.waypoint.tolist())
    points = (
        ad.JointTrajectoryPoint(there, still, time_from_start=task.duration / 2.0),
        ad.JointTrajectoryPoint(still, still, time_from_start=task.duration),
    )
    return ad.JointTrajectory(joint_names=task.joints, points=points)


@cache
def commands_of(task: Task) -> Commands:
    """Return what our controller tells our drive, which is what all engines are told.

    A JointTrajectoryController with a position interface says where the joint is to be
    at the end of the period; the drive takes the change for the velocity, but not where
    a motion starts or turns.
    """
    robot = robots.load(task.urdf, name="arm0")
    options = ad.SimulationOptions(time_step=PERIOD)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    sim.controller(robots.CONTROLLER).send_goal(make_goal(task))
    port = sim.diagram.GetSubsystemByName("commands").GetOutputPort("drive")
    rows = []
    for tick in range(task.num_ticks):
        sim.run((tick + 0.5) * PERIOD - sim.time)
        context = port.get_system().GetMyContextFromRoot(sim.simulator.get_context())
        rows.append(port.Eval(context))
    names = [joint.name for joint in commanded_joints(robot.description)]
    columns = [names.index(name) for name in task.joints]
    q, v = np.split(np.array(rows), 2, axis=1)
    return Commands(q[:, columns], v[:, columns])
