"""Times of a path: as fast as the joints' limits allow."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.optimization import Toppra, ToppraDiscretization
from pydrake.multibody.plant import MultibodyPlant
from pydrake.trajectories import PiecewisePolynomial

from arm_drake.description.joints import last_master
from arm_drake.description.robot import Robot
from arm_drake.planning.groups import motion_limits
from arm_drake.plant.drake_log import drake_messages
from arm_drake.plant.payloads import Payload
from arm_drake.plant.plant import make_reduced_plant, trial_plant

# Time between points of a trajectory [s].
_PERIOD = 0.02

# Toppra exceeds limits between its grid points by some percent.
_MARGIN, _GRID = 0.98, 100

# Grid points aren't closer than this; what is no limit for Toppra.
_SMALLEST, _UNLIMITED = 1e-6, 1e6


class Mover(NamedTuple):
    """What moves: joints of a robot, and what its links hold."""

    robot: Robot
    joints: tuple[str, ...]

    # Where all joints are at first [rad] or [m].
    positions: Mapping[str, float]

    payloads: Mapping[str, Payload]

    @property
    def start(self) -> np.ndarray:
        """Where the joints are at first."""
        return np.array([self.positions[name] for name in self.joints])


def time_path(
    mover: Mover, path: np.ndarray, rounding: float, scaling: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, bool] | None:
    """Return times [s], positions and two derivatives, shapes (k,) and (k, n).

    It moves along the path within the limits; last is whether efforts keep theirs.
    Corners are rounded by parabolas that begin `rounding` before them. None is returned
    if there are no times for the path.
    """
    robot, joints = mover.robot, mover.joints
    limits = motion_limits(robot)
    v = np.array([limits[name].velocity for name in joints]) * scaling[0]
    a = np.array([limits[name].acceleration for name in joints]) * scaling[1]
    lengths = [float(np.max(np.abs(y - x) / v)) for x, y in itertools.pairwise(path)]
    keep = [True, *(length > 1e-9 for length in lengths)]
    path, lengths = path[keep], [length for length in lengths if length > 1e-9]
    if not lengths:
        still = np.zeros((1, len(joints)))
        return np.zeros(1), path[:1], still, still, True
    curve = _round(path, lengths, rounding)
    found = _parametrize(mover, curve, v, a)
    if found is None:
        return None
    times, keeps = found
    count = max(2, math.ceil(times.end_time() / _PERIOD) + 1)
    t = np.linspace(0.0, times.end_time(), count)
    s, s1, s2 = (f.vector_values(t)[0] for f in _derivatives(times))
    q, q1, q2 = (f.vector_values(s).T for f in _derivatives(curve))
    velocities = q1 * s1[:, np.newaxis]
    accelerations = q2 * (s1**2)[:, np.newaxis] + q1 * s2[:, np.newaxis]
    slower = max(
        1.0,
        float(np.max(np.abs(velocities) / v)),
        math.sqrt(float(np.max(np.abs(accelerations) / a))),
    )
    velocities[[0, -1]] = 0.0
    q[0], q[-1] = path[0], path[-1]
    return t * slower, q, velocities / slower, accelerations / slower**2, keeps


def _derivatives(curve: PiecewisePolynomial) -> list[PiecewisePolynomial]:
    return [curve, curve.derivative(1), curve.derivative(2)]


def _round(
    path: np.ndarray, lengths: Sequence[float], rounding: float
) -> PiecewisePolynomial:
    """Return a curve of lines and of parabolas at the corners."""
    u = [(y - x) / n for x, y, n in zip(path, path[1:], lengths, strict=False)]
    breaks, values, slopes = [0.0], [path[0]], [u[0]]
    at = 0.0
    for i in range(1, len(path) - 1):
        at += lengths[i - 1]
        b = min(rounding, 0.45 * lengths[i - 1], 0.45 * lengths[i])
        breaks += [at - b, at + b]
        values += [path[i] - b * u[i - 1], path[i] + b * u[i]]
        slopes += [u[i - 1], u[i]]
    breaks.append(at + lengths[-1])
    values.append(path[-1])
    slopes.append(u[-1])
    # Cubics that are given by values and slopes at their ends are these curves.
    return PiecewisePolynomial.CubicHermite(
        breaks, np.array(values).T, np.array(slopes).T
    )


def _parametrize(
    mover: Mover, curve: PiecewisePolynomial, v: np.ndarray, a: np.ndarray
) -> tuple[PiecewisePolynomial, bool] | None:
    """Return the curve's parameter by time, and whether limits of effort are kept."""
    plant, joints = _timing_plant(mover), mover.joints
    chosen = [plant.GetJointByName(name).position_start() for name in joints]
    whole = _of_all_joints(mover, curve)
    breaks = np.array(curve.get_segment_times())
    even = np.linspace(breaks[0], breaks[-1], _GRID)
    grid = np.unique(np.concatenate([breaks, even]))
    grid = grid[np.append(np.diff(grid) > _SMALLEST, True)]
    grid[0] = breaks[0]
    most_v, most_a, most_u = np.full((3, plant.num_positions()), _UNLIMITED)
    most_v[chosen], most_a[chosen] = v, _MARGIN * a
    efforts = {j.name: j.limits.effort for j in mover.robot.description.joints}
    for name, at in zip(joints, chosen, strict=True):
        most_u[at] = min(efforts[name] or _UNLIMITED, _UNLIMITED)
    # Interpolation is exact at more points, collocation rarely fails.
    ways = (ToppraDiscretization.kInterpolation, ToppraDiscretization.kCollocation)
    with drake_messages():  # It says so when it fails.
        for keeps, way in itertools.product((True, False), ways):
            toppra = Toppra(whole, plant, grid)
            toppra.AddJointVelocityLimit(-most_v, most_v)
            toppra.AddJointAccelerationLimit(-most_a, most_a, way)
            if keeps:
                toppra.AddJointTorqueLimit(-most_u, most_u, way)
            times = toppra.SolvePathParameterization()
            if times is not None:
                return times, keeps
    return None


def _timing_plant(mover: Mover) -> MultibodyPlant:
    """Return a plant of the robot alone, with what its links hold."""
    robot = mover.robot
    if not any(payload.mass for payload in mover.payloads.values()):
        return trial_plant(robot)
    return make_reduced_plant(
        robot.description, robot.pose, 1e-3, payloads=mover.payloads
    )


def _of_all_joints(mover: Mover, curve: PiecewisePolynomial) -> Any:
    """Return the curve with the joints that follow, and those that stay."""
    plant, group = trial_plant(mover.robot), mover.joints
    joints = {joint.name: joint for joint in mover.robot.description.movable_joints}
    rest = np.zeros(plant.num_positions())
    spread = np.zeros((plant.num_positions(), len(group)))
    for name, joint in joints.items():
        at = plant.GetJointByName(name).position_start()
        rest[at] = mover.positions[name]
        master, factor, _ = last_master(joint, joints)
        if master in group:
            spread[at, group.index(master)] = factor
    breaks = curve.get_segment_times()
    values = np.array([curve.value(s)[:, 0] for s in breaks])
    slopes = np.array([curve.EvalDerivative(s, 1)[:, 0] for s in breaks])
    offsets = rest + (values - mover.start) @ spread.T
    return PiecewisePolynomial.CubicHermite(breaks, offsets.T, (slopes @ spread.T).T)
