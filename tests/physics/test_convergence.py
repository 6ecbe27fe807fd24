"""Halving the time step halves the error, against references computed elsewhere."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import arm_drake as ad
from tests import models
from tests.physics.support import EFFORT, effort_controller, simulate

JOINTS = ("shoulder", "elbow")
STEPS = [4e-3, 2e-3, 1e-3, 5e-4]

# The scheme is of first order: a halving halves the error, up to the second order.
RATIO = 1.9

# Without its first order, 2 x(h / 2) - x(h), it quarters, up to the third.
RATIO_WITHOUT = 3.8

# Rate of the controllers [Hz], whose ticks are at steps of any of these sizes.
RATE = 50

# Rate of the log [Hz]; so are its rows.
LOG_RATE = 250


def assert_halves(
    results: Sequence[np.ndarray], expected: np.ndarray, ratio: float = RATIO
) -> None:
    """Check that the largest error falls at least by a ratio from one to the next."""
    errors = np.array([np.abs(result - expected).max() for result in results])
    ratios = errors[:-1] / errors[1:]
    assert (ratios >= ratio).all(), f"errors {errors}, ratios {ratios}"


# A double pendulum, damped as TWO_LINKS is.
FREE = models.TWO_LINKS.replace(
    models.ros2_control(*JOINTS), models.ros2_control(*JOINTS, command="effort")
)
DAMPING = np.array([0.5, 0.2])
START = np.array([1.0, -0.8])


def swing(
    urdf: str, effort: np.ndarray, times: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the double pendulum, each of shape (k, 2).

    Args:
        urdf: The robot as Drake gets it.
        effort: Constant efforts.
        times: When to tell [s], shape (k,).
        tolerance: Relative and absolute tolerance of the integration.
    """
    model = pinocchio.buildModelFromXML(urdf)
    assert tuple(model.names)[1:] == JOINTS
    data = model.createData()

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        q, v = np.split(x, 2)
        acting = effort - DAMPING * v
        return np.concatenate([v, pinocchio.aba(model, data, q, v, acting)])

    solution = solve_ivp(
        rate,
        (0.0, times[-1]),
        np.concatenate([START, np.zeros(2)]),
        method="DOP853",
        t_eval=times,
        rtol=tolerance,
        atol=tolerance,
    )
    assert solution.success
    q, v = np.split(solution.y.T, 2, axis=1)
    return q, v


@pytest.mark.parametrize("effort", [(0.0, 0.0), (6.0, -2.0)])
def test_a_double_pendulum_under_constant_effort_converges(
    tmp_path: Path, effort: tuple[float, float]
) -> None:
    start = dict(zip(JOINTS, START, strict=True))
    rollouts = []
    for h in STEPS:
        simulation = simulate(
            tmp_path,
            FREE,
            effort_controller(JOINTS, rate=RATE),
            step=h,
            start=start,
            log_rate=LOG_RATE,
        )
        simulation.controller(EFFORT).command(effort)
        simulation.advance_to(1.0 + h / 2.0)
        rollouts.append(simulation.rollout())

    times = np.arange(LOG_RATE + 1) / LOG_RATE
    urdf = simulation.robots["two_links"].description.urdf
    q, v = swing(urdf, np.array(effort), times, 1e-12)
    # The reference is known to 1e-10: ten times the tolerance changes less.
    less_exact, _ = swing(urdf, np.array(effort), times, 1e-11)
    assert np.abs(less_exact - q).max() < 1e-10
    assert np.ptp(q, axis=0).min() > 0.25
    for rollout in rollouts:
        np.testing.assert_allclose(rollout.time, times, rtol=0.0, atol=1e-9)
    positions = [rollout.position for rollout in rollouts]
    assert_halves(positions, q)
    assert_halves([rollout.velocity for rollout in rollouts], v)
    # What they converge to is the reference, and nothing that is a little off.
    extrapolated = [2.0 * y - x for x, y in itertools.pairwise(positions)]
    assert_halves(extrapolated, q, RATIO_WITHOUT)


# Where the arm is told to go, how long that takes [s], and when it is told [ticks].
GOAL = np.array([1.0, -1.4])
DURATION = 1.0
TOLD = 5
TICKS = 70


def commands() -> tuple[np.ndarray, np.ndarray]:
    """Return the positions and velocities that hold from each tick on, (TICKS, 2).

    The controller commands where its cubic is a period later, and the velocity is the
    difference to the command before; what was at rest before has none, nor has what
    turns or is more than three times as fast: it may be a step.
    """
    times = (np.arange(TICKS) - TOLD + 1) / RATE
    s = np.clip(times / DURATION, 0.0, 1.0)
    position = np.outer(3.0 * s**2 - 2.0 * s**3, GOAL)
    position[:TOLD] = 0.0
    rate = np.diff(position, axis=0, prepend=0.0) * RATE
    before = np.vstack([np.zeros(2), rate[:-1]])
    most = 3.0 * np.abs(before)
    return position, np.where(rate * before > 0.0, np.clip(rate, -most, most), 0.0)


def follow_ideally(w0: float) -> np.ndarray:
    """Return positions of an ideal servo, at the log's rate.

    With the period T of the commands they obey
    q'' = w0^2 (q_d - v_d T/2 - q) + 2 w0 (v_d - v).
    """
    A = np.array([[0.0, 1.0], [-(w0**2), -2.0 * w0]])
    Phi = expm(A / LOG_RATE)
    state, rows = np.zeros((2, 2)), []
    for q_d, v_d in zip(*commands(), strict=True):
        # Where it would come to rest under this command, and around which it is linear.
        rest = np.array([q_d + (2.0 / w0 - 0.5 / RATE) * v_d, np.zeros(2)])
        for _ in range(LOG_RATE // RATE):
            rows.append(state[0])
            state = rest + Phi @ (state - rest)
    return np.array(rows)


def follow(folder: Path, step: float, preset: str, log_rate: float) -> np.ndarray:
    """Return positions of an arm that is sent to the goal, at a log's rate."""
    yaml = models.trajectory_controllers({"arm": list(JOINTS)}, update_rate=RATE)
    end = ad.JointTrajectoryPoint(
        positions=tuple(GOAL), velocities=(0.0, 0.0), time_from_start=DURATION
    )
    simulation = simulate(
        folder, models.TWO_LINKS, yaml, step=step, log_rate=log_rate, preset=preset
    )
    simulation.advance_to(TOLD / RATE)
    simulation.controller("arm").send_goal(
        ad.JointTrajectory(joint_names=JOINTS, points=(end,))
    )
    simulation.advance_to(TICKS / RATE - step / 2.0)
    return simulation.rollout().position


def test_an_arm_that_follows_a_trajectory_converges_to_the_ideal_servo(
    tmp_path: Path,
) -> None:
    expected = follow_ideally(40.0)

    positions = [follow(tmp_path, h, "accurate", LOG_RATE) for h in STEPS]

    assert_halves(positions, expected)
    # The step runs half a step ahead of the continuous motion, at its speed of 2.1
    # rad/s. The servo takes that off; where the speed changes, a fifth of it is left.
    speed = 1.5 * np.abs(GOAL).max() / DURATION
    errors = [np.abs(position - expected).max() for position in positions]
    assert (np.array(errors) <= 0.2 * speed * np.array(STEPS) / 2.0).all()


@pytest.mark.parametrize("h", [2e-2, 4e-3, 1e-3])
def test_a_fast_arm_is_where_the_ideal_servo_is_at_any_step(
    tmp_path: Path, h: float
) -> None:
    # A row at each tick, for between them a large step has none.
    expected = follow_ideally(40.0)[:: LOG_RATE // RATE]

    position = follow(tmp_path, h, "fast", RATE)

    assert np.ptp(position, axis=0).min() > 0.9
    # Positions of 1 rad, each of up to 1400 steps adds a rounding error.
    np.testing.assert_allclose(position, expected, rtol=0.0, atol=1e-12)
