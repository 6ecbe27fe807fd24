"""Joints under an effort interface move as textbooks say: nothing acts but the model.

Without contact, Drake's step is the semi-implicit one, with damping D implicit::

    (M + h D) (v[+] - v) / h = effort + gravity - D v        q[+] = q + h v[+]

So its positions are those of the Störmer-Verlet scheme, which starts half a step late.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from tests import models
from tests.physics.support import (
    BELOW,
    EFFORT,
    effort_controller,
    inertia,
    one_joint,
    simulate,
)

STEPS = [1e-3, 5e-3]

# A joint that gravity doesn't move: the axis of a turning one is upright.
LEVEL = {"prismatic": "1 0 0", "revolute": "0 0 1", "continuous": "0 0 1"}
WEIGHT = models.MASS * models.GRAVITY

# Largest moment of gravity on a pendulum, and its frequency at small amplitudes.
MOMENT = WEIGHT * models.LENGTH
FREQUENCY = math.sqrt(MOMENT / models.INERTIA)


def run(
    folder: Path,
    urdf: str,
    duration: float,
    *,
    step: float,
    efforts: Sequence[tuple[float, float]] = (),
    start: float = 0.0,
    speed: float | None = None,
) -> ad.Rollout:
    """Return what the joint did, one row for each step.

    Args:
        folder: Where to write the robot.
        urdf: A robot of `one_joint`.
        duration: How long [s].
        step: Step of the plant [s].
        efforts: Times [s] and what is commanded from then on; 0 before.
        start: Initial position.
        speed: Initial velocity; None is rest.
    """
    simulation = simulate(
        folder,
        urdf,
        effort_controller(),
        step=step,
        start={"axis": start},
        speed=None if speed is None else [speed],
    )
    for time, effort in efforts:
        simulation.advance_to(time)
        simulation.controller(EFFORT).command([effort])
    # The log ends a row before its time.
    simulation.advance_to(duration + 0.5 * step)
    return simulation.rollout()


def pendulum(type: str) -> str:
    return one_joint(type, "0 1 0", center=BELOW)


def elliptic(k: float) -> float:
    """Return the complete elliptic integral K of a modulus, by Gauss's mean."""
    mean, other = 1.0, math.sqrt(1.0 - k**2)
    for _ in range(10):
        mean, other = (mean + other) / 2.0, math.sqrt(mean * other)
    return math.pi / (2.0 * mean)


def crossings(rollout: ad.Rollout, levels: Sequence[float]) -> np.ndarray:
    """Return when the joint first passes each of the positions, upwards, in order."""
    q, t = rollout.position[:, 0], rollout.time
    found, after = [], 0
    for level in levels:
        (at,) = np.nonzero((q[after:-1] < level) & (q[after + 1 :] >= level))
        k = after + at[0]
        found.append(t[k] + (t[k + 1] - t[k]) * (level - q[k]) / (q[k + 1] - q[k]))
        after = k + 1
    return np.array(found)


def swing_period(folder: Path, amplitude: float, h: float, about: float) -> float:
    """Return the mean period of some swings that start at rest, of about as long."""
    duration = 3.5 * about
    rollout = run(folder, pendulum("revolute"), duration, step=h, start=-amplitude)
    at = crossings(rollout, [0.0] * 4)
    return float(at[-1] - at[0]) / 3.0


@pytest.mark.parametrize("amplitude", [0.2, 1.5, 2.8])
def test_a_pendulum_s_period_is_the_elliptic_integral(
    tmp_path: Path, amplitude: float
) -> None:
    exact = 4.0 / FREQUENCY * elliptic(math.sin(amplitude / 2.0))

    steps = [1e-3, 2e-3, 5e-3]
    errors = [abs(swing_period(tmp_path, amplitude, h, exact) - exact) for h in steps]

    # Drake's first-order step is of second order here: the period of small swings is
    # shorter by (w h)^2 / 24 of it, and large ones are no worse.
    for h, error in zip(steps, errors, strict=True):
        assert error < 1.1 * exact * (FREQUENCY * h) ** 2 / 24.0
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.05)
    assert errors[2] / errors[1] == pytest.approx(6.25, rel=0.05)


@pytest.mark.parametrize("amplitude", [0.2, 1.5])
def test_a_pendulum_that_is_released_is_half_a_step_early(
    tmp_path: Path, amplitude: float
) -> None:
    exact = elliptic(math.sin(amplitude / 2.0)) / FREQUENCY

    steps = [1e-3, 2e-3, 5e-3]
    early = []
    for h in steps:
        rollout = run(tmp_path, pendulum("revolute"), 1.0, step=h, start=-amplitude)
        early.append(exact - crossings(rollout, [0.0])[0])

    # The first order of the scheme, in proportion to the step, is at the start: the
    # first step has the acceleration of a whole one, where half of it is right.
    np.testing.assert_allclose(early, np.array(steps) / 2.0, rtol=0.02)


@pytest.mark.parametrize("h", STEPS)
def test_a_pendulum_that_turns_over_has_the_period_of_its_elliptic_integral(
    tmp_path: Path, h: float
) -> None:
    speed = 2.5 * FREQUENCY

    rollout = run(tmp_path, pendulum("continuous"), 7.0, step=h, speed=speed)

    turns = 2.0 * math.pi * np.arange(1, 9)
    exact = 4.0 / speed * elliptic(2.0 * FREQUENCY / speed)
    rounds = np.diff(crossings(rollout, list(turns)))
    # Second order, as for swings, with its largest velocity for their frequency.
    np.testing.assert_allclose(rounds.mean(), exact, rtol=(speed * h) ** 2 / 24.0)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    ("type", "start", "speed"),
    [("revolute", 1.5, None), ("revolute", 2.8, None), ("continuous", 0.0, 11.0)],
)
def test_a_pendulum_s_energy_is_off_by_the_first_order_and_does_not_drift(
    tmp_path: Path, type: str, start: float, speed: float | None, h: float
) -> None:
    rollout = run(tmp_path, pendulum(type), 5.0, step=h, start=start, speed=speed)

    q, v = rollout.position[1:, 0], rollout.velocity[1:, 0]
    at_start = _energy(np.array(start), np.array(speed or 0.0))
    error = _energy(q, v) - at_start
    # What the semi-implicit step conserves is E - (h/2) v dV/dq + O(h^2), the second
    # order being (h^2/12) ((dV/dq)^2 / I + v^2 d2V/dq2); the third one is small.
    first_order = h / 2.0 * v * MOMENT * np.sin(q)
    bend = MOMENT * (FREQUENCY**2 * np.sin(q) ** 2 + v**2 * np.cos(q))
    second_order = h**2 / 12.0 * float(np.ptp(bend))
    np.testing.assert_allclose(error, first_order, rtol=0.0, atol=1.1 * second_order)


def _energy(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return models.INERTIA * v**2 / 2.0 - MOMENT * np.cos(q)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("effort", [0.0, 4.0, 15.0])
def test_a_slide_falls_by_half_g_t_squared(
    tmp_path: Path, effort: float, h: float
) -> None:
    rollout = run(
        tmp_path,
        one_joint("prismatic", "0 0 1"),
        2.0,
        step=h,
        efforts=[(0.0, effort)],
        start=0.5,
    )

    acceleration = effort / models.MASS - models.GRAVITY
    assert_accelerates(rollout, acceleration, h, start=0.5)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("type", LEVEL)
def test_a_constant_effort_accelerates_evenly(
    tmp_path: Path, type: str, h: float
) -> None:
    rollout = run(
        tmp_path, one_joint(type, LEVEL[type]), 2.0, step=h, efforts=[(0.0, -3.0)]
    )

    assert_accelerates(rollout, -3.0 / inertia(type), h)


def assert_accelerates(
    rollout: ad.Rollout, a: float, h: float, *, start: float = 0.0
) -> None:
    """Check that an acceleration acts at each step, and nothing else."""
    k = np.arange(len(rollout.time))
    q, v = rollout.position[:, 0] - start, rollout.velocity[:, 0]
    assert k[-1] == round(2.0 / h)
    np.testing.assert_allclose(q, a * h**2 * k * (k + 1) / 2.0, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(v, a * h * k, rtol=0.0, atol=1e-9)
    # Against the continuous motion, of first order: half a step's travel.
    half_a_step = h / 2.0 * np.abs(v).max() + 1e-9
    np.testing.assert_allclose(q, a * (k * h) ** 2 / 2.0, rtol=0.0, atol=half_a_step)


# Dry friction, a speed that it brakes, and an effort that overcomes it.
FRICTION = 2.0
SPEED = 1.5
PUSH = 5.0


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("type", ["prismatic", "revolute"])
def test_friction_stops_a_mass_where_its_energy_is_used_up(
    tmp_path: Path, type: str, sign: float, h: float
) -> None:
    urdf = one_joint(type, LEVEL[type], dynamics=f'friction="{FRICTION}"')

    rollout = run(tmp_path, urdf, 3.0, step=h, speed=sign * SPEED)

    distance = SPEED**2 * inertia(type) / (2.0 * FRICTION)
    # First order: each step goes as far as its end's speed says, which is too little.
    # Second order, in units of h^2 f / M: the part of a step in which it stops 1/8, the
    # bristle's 1 / (1 - z)^2 = 1.6 and its overshoot of as much as 1 / (1 - z).
    expected = distance - h * SPEED / 2.0
    assert sign * rollout.position[-1, 0] == pytest.approx(
        expected, abs=3.0 * h**2 * FRICTION / inertia(type)
    )
    assert_rests(rollout, 1.0 + SPEED * inertia(type) / FRICTION)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("type", ["prismatic", "revolute"])
def test_a_mass_that_is_pushed_and_let_go_slides_on_and_stops(
    tmp_path: Path, type: str, h: float
) -> None:
    urdf = one_joint(type, LEVEL[type], dynamics=f'friction="{FRICTION}"')

    pushes = [(0.1, PUSH), (0.6, 0.0)]
    rollout = run(tmp_path, urdf, 4.0, step=h, efforts=pushes)

    time, M = 0.5, inertia(type)
    speed = (PUSH - FRICTION) / M * time
    distance = speed * time / 2.0 + speed**2 * M / (2.0 * FRICTION)
    # First order: the first step may not feel the friction yet, which makes it faster
    # by h f / M. Second order as above.
    more = h * (FRICTION / M * time + speed) + 3.0 * h**2 * FRICTION / M
    assert rollout.position[-1, 0] == pytest.approx(distance, abs=more)
    assert_rests(rollout, 1.1 + speed * M / FRICTION)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("part", [0.5, 0.9, -0.9])
@pytest.mark.parametrize("type", ["prismatic", "revolute"])
def test_an_effort_below_friction_moves_nothing(
    tmp_path: Path, type: str, part: float, h: float
) -> None:
    urdf = one_joint(type, LEVEL[type], dynamics=f'friction="{FRICTION}"')

    efforts = [(0.0, part * FRICTION)]
    rollout = run(tmp_path, urdf, 2.0, step=h, efforts=efforts)

    # The first step may not be opposed; what friction f leaves of the effort F stops
    # its speed h F / M. Then the bristle bends. All in units of h^2 f / M.
    F = abs(part)
    moved = F**2 / (2.0 * (1.0 - F)) + 3.0
    size = h**2 * FRICTION / inertia(type)
    assert np.abs(rollout.position).max() < moved * size
    assert_rests(rollout, 1.0)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("part", [1.1, 2.0, -1.1])
@pytest.mark.parametrize("type", ["prismatic", "revolute"])
def test_an_effort_above_friction_accelerates_by_what_is_left(
    tmp_path: Path, type: str, part: float, h: float
) -> None:
    urdf = one_joint(type, LEVEL[type], dynamics=f'friction="{FRICTION}"')

    efforts = [(0.0, part * FRICTION)]
    rollout = run(tmp_path, urdf, 2.0, step=h, efforts=efforts)

    acceleration = math.copysign(abs(part) - 1.0, part) * FRICTION / inertia(type)
    # From the second step on it slides.
    rates = np.diff(rollout.velocity[1:, 0]) / h
    np.testing.assert_allclose(rates, acceleration, rtol=1e-9)


def test_without_friction_the_smallest_effort_moves_a_mass(tmp_path: Path) -> None:
    urdf = one_joint("prismatic", LEVEL["prismatic"])

    rollout = run(tmp_path, urdf, 2.0, step=1e-3, efforts=[(0.0, 0.01)])

    assert_accelerates(rollout, 0.01 / models.MASS, 1e-3)


def assert_rests(rollout: ad.Rollout, time: float) -> None:
    """Check that from a time on nothing moves, up to rounding."""
    is_late = rollout.time > time
    assert is_late.sum() > 100
    assert np.abs(rollout.velocity[is_late]).max() < 1e-12
    assert np.ptp(rollout.position[is_late]) < 1e-12


@pytest.mark.parametrize("h", STEPS)
def test_a_falling_slide_reaches_the_speed_at_which_damping_carries_it(
    tmp_path: Path, h: float
) -> None:
    damping = 4.0
    urdf = one_joint("prismatic", "0 0 1", dynamics=f'damping="{damping}"')

    rollout = run(tmp_path, urdf, 8.0, step=h)

    assert_reaches(rollout, -WEIGHT / damping, damping / models.MASS, h)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("type", LEVEL)
def test_an_effort_reaches_the_speed_at_which_damping_balances_it(
    tmp_path: Path, type: str, h: float
) -> None:
    damping = 4.0 * inertia(type)
    urdf = one_joint(type, LEVEL[type], dynamics=f'damping="{damping!r}"')

    rollout = run(tmp_path, urdf, 8.0, step=h, efforts=[(0.0, 3.0)])

    assert_reaches(rollout, 3.0 / damping, 4.0, h)


@pytest.mark.parametrize("h", STEPS)
def test_damping_and_friction_together_brake_a_fall(tmp_path: Path, h: float) -> None:
    urdf = one_joint("prismatic", "0 0 1", dynamics='damping="4" friction="2"')

    rollout = run(tmp_path, urdf, 8.0, step=h)

    assert rollout.velocity[-1, 0] == pytest.approx(-(WEIGHT - 2.0) / 4.0, rel=1e-9)


def assert_reaches(rollout: ad.Rollout, speed: float, rate: float, h: float) -> None:
    """Check that a speed is approached from rest at a rate d/M [1/s]."""
    k = np.arange(len(rollout.time))
    v = rollout.velocity[:, 0]
    assert v[-1] == pytest.approx(speed, rel=1e-9)
    # Exactly what the implicit step makes of it: each one divides what is missing.
    implicit = speed * (1.0 - (1.0 + h * rate) ** -k)
    np.testing.assert_allclose(v, implicit, rtol=0.0, atol=1e-9)
    # Against the continuous motion, of first order: x exp(-x) h d / 2 M, 1/e at most.
    tolerance = abs(speed) * h * rate / (2.0 * math.e)
    exact = speed * (1.0 - np.exp(-rate * h * k))
    np.testing.assert_allclose(v, exact, rtol=0.0, atol=tolerance)
    assert np.abs(v - exact).max() > 0.9 * tolerance


def pid_controller(
    p: float, i: float, d: float, *, interfaces: str = "[position]"
) -> str:
    return f"""
controller_manager:
  ros__parameters:
    update_rate: 200
    pid: {{type: pid_controller/PidController}}
pid:
  ros__parameters:
    dof_names: [axis]
    command_interface: effort
    reference_and_state_interfaces: {interfaces}
    gains: {{axis: {{p: {p}, i: {i}, d: {d}}}}}
"""


def settle(
    folder: Path, urdf: str, yaml: str, reference: float, h: float, *, start: float
) -> ad.Rollout:
    """Return what happens in 10 s under a PID that wants a position."""
    simulation = simulate(folder, urdf, yaml, step=h, start={"axis": start})
    simulation.controller("pid").command([reference])
    simulation.advance_to(10.0)
    return simulation.rollout()


def balance(p: float, reference: float, load: Callable[[float], float]) -> float:
    """Return the position where p (reference - q) = load(q), by bisection."""
    low, high = reference - 2.0, reference + 2.0
    for _ in range(80):
        middle = (low + high) / 2.0
        is_below = p * (reference - middle) > load(middle)
        low, high = (middle, high) if is_below else (low, middle)
    return middle


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    ("type", "reference", "start", "interfaces"),
    [
        ("revolute", 1.0, 0.0, "[position, velocity]"),
        ("revolute", -2.0, -1.0, "[position]"),
        # More than a turn away from where it hangs.
        ("continuous", 7.5, 6.0, "[position]"),
        ("prismatic", 0.4, 0.0, "[position, velocity]"),
        ("prismatic", 0.4, 0.0, "[position]"),
    ],
)
def test_a_pid_without_integral_rests_where_gravity_balances_it(
    tmp_path: Path,
    type: str,
    reference: float,
    start: float,
    interfaces: str,
    h: float,
) -> None:
    p = 30.0
    urdf = one_joint("prismatic", "0 0 1") if type == "prismatic" else pendulum(type)

    yaml = pid_controller(p, 0.0, 5.0, interfaces=interfaces)
    rollout = settle(tmp_path, urdf, yaml, reference, h, start=start)

    expected = balance(p, reference, load_of(type))
    assert abs(reference - expected) > 0.1
    assert rollout.position[-1, 0] == pytest.approx(expected, abs=1e-9)
    assert rollout.velocity[-1, 0] == pytest.approx(0.0, abs=1e-9)
    assert rollout.effort[-1, 0] == pytest.approx(load_of(type)(expected), abs=1e-7)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(
    ("type", "reference", "start"),
    [("revolute", 1.0, 0.0), ("continuous", 7.5, 6.0), ("prismatic", 0.4, 0.0)],
)
def test_a_pid_s_integral_removes_the_sag(
    tmp_path: Path, type: str, reference: float, start: float, h: float
) -> None:
    urdf = one_joint("prismatic", "0 0 1") if type == "prismatic" else pendulum(type)

    yaml = pid_controller(75.0, 125.0, 15.0)
    rollout = settle(tmp_path, urdf, yaml, reference, h, start=start)

    assert rollout.position[-1, 0] == pytest.approx(reference, abs=1e-9)
    assert rollout.effort[-1, 0] == pytest.approx(load_of(type)(reference), abs=1e-7)


def load_of(type: str) -> Callable[[float], float]:
    """Return what gravity asks of the joint at a position, [N·m] or [N]."""
    if type == "prismatic":
        return lambda q: WEIGHT
    return lambda q: MOMENT * math.sin(q)
