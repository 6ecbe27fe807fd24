"""Noise and delay between hardware and controllers, against closed forms."""

import dataclasses as dc
import math

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from tests.models import LIFT, MASS, load

# Of the mass on a slide; a tick is a step of the physics.
PERIOD, P, D = 0.01, 40.0, 9.0

PID = f"""
controller_manager:
  ros__parameters:
    update_rate: {round(1 / PERIOD)}
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
    states: {{type: joint_state_broadcaster/JointStateBroadcaster}}
arm:
  ros__parameters:
    joints: [slide]
    command_interfaces: [effort]
    state_interfaces: [position, velocity]
    gains: {{slide: {{p: {P}, i: 0.0, d: {D}}}}}
"""
PLAIN = ad.SimulationOptions(time_step=PERIOD, gravity=False)

# Position and velocity after a step: v' = v + u h / m, q' = q + h v'.
PLANT = np.array([[1.0, PERIOD], [0.0, 1.0]])
PUSH = np.array([PERIOD**2 / MASS, PERIOD / MASS])
GAINS = np.array([P, D])


@pytest.fixture
def lift(tmp_path) -> ad.Robot:
    return load(tmp_path, LIFT.replace('name="position"/>', 'name="effort"/>', 1), PID)


def push(robot: ad.Robot, duration: float = 0.6, **options) -> ad.Simulation:
    """Return a simulation after a step of the command at its start."""
    chosen = dc.replace(PLAIN, **options)
    sim = ad.Simulation(ad.build_diagram(robot, options=chosen))
    send(sim)
    sim.advance_to(duration)
    return sim


def send(sim: ad.Simulation, height: float = 0.1) -> None:
    point = ad.JointTrajectoryPoint((height,))
    message = ad.JointTrajectory(joint_names=("slide",), points=(point,))
    sim.controller("arm").send_trajectory(message)


def solve(
    ticks: int, *, state_delay: int = 0, command_delay: int = 0, steps: int = 1
) -> np.ndarray:
    """Return positions of the slide by its difference equation, shape (ticks,)."""
    h = PERIOD / steps
    plant, effect = np.array([[1.0, h], [0.0, 1.0]]), np.array([h**2, h]) / MASS
    x, states, efforts = np.zeros(2), [], []
    for tick in range(ticks):
        states.append(x)
        seen = states[max(0, tick - state_delay)]
        efforts.append(float(GAINS @ (np.array([0.1, 0.0]) - seen)))
        acting = tick - command_delay
        for _ in range(steps):
            x = plant @ x + effect * (efforts[acting] if acting >= 0 else 0.0)
    return np.array(states)[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 5])
@pytest.mark.parametrize("delays", [(0, 0), (1, 0), (3, 0), (0, 1), (2, 3)])
def test_a_loop_with_delays_moves_as_its_difference_equation(
    lift, delays, steps
) -> None:
    named = dict(zip(("state_delay", "command_delay"), delays, strict=True))

    sim = push(lift, time_step=PERIOD / steps, **named)

    moved = sim.rollout().position[:60, 0]
    assert moved == pytest.approx(solve(60, **named, steps=steps), abs=1e-12)


@pytest.mark.parametrize("name", ["state_delay", "command_delay"])
def test_hardware_without_physics_answers_so_many_cycles_later(tmp_path, name) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: forward_command_controller/ForwardCommandController}
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
arm: {ros__parameters: {joints: [slide], interface_name: position}}
"""
    robot, seen = load(tmp_path, LIFT, yaml), []
    for delay in (0, 4):
        options = ad.SimulationOptions(preset="kinematic", **{name: delay})
        sim = ad.Simulation(ad.build_diagram(robot, options=options))
        sim.controller("arm").command([0.5])
        told = []
        for tick in range(1, 10):
            sim.advance_to(tick * PERIOD)
            message = sim.diagram.GetOutputPort("states.joint_states").Eval(sim.context)
            told.append(message.position[0])
        seen.append(told)

    assert seen[0] == [0.0] * (9 - seen[0].count(0.5)) + [0.5] * seen[0].count(0.5)
    assert seen[1] == [0.0] * 4 + seen[0][:-4]


def measured(sim: ad.Simulation, ticks: int) -> np.ndarray:
    """Return what the broadcaster tells at ticks, shape (ticks, 3)."""
    rows = []
    port = sim.diagram.GetOutputPort("states.joint_states")
    for tick in range(ticks):
        sim.advance_to((tick + 0.5) * PERIOD)
        message = port.Eval(sim.context)
        rows.append([message.position[0], message.velocity[0], message.effort[0]])
    return np.array(rows)


@pytest.mark.slow
def test_noise_is_white_and_of_the_deviation_that_was_asked_for(tmp_path) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 100
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
"""
    robot = load(tmp_path, LIFT, yaml)
    asked, N = {"slide/position": 2e-3, "position": 1.0, "velocity": 0.05}, 600
    options = dc.replace(PLAIN, state_noise=asked)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))

    seen = measured(sim, N)

    noise = seen[:, :2] / (2e-3, 0.05)
    # Nothing moves, and nothing that is recorded has noise.
    assert not sim.rollout().position.any()
    assert not seen[:, 2].any()
    # Within four standard deviations of each of these.
    assert noise.mean(axis=0) == pytest.approx(0.0, abs=4 / math.sqrt(N))
    assert noise.var(axis=0) == pytest.approx(1.0, abs=4 * math.sqrt(2 / N))
    for lag in (1, 2, 7):
        products = (noise[lag:] * noise[:-lag]).mean(axis=0)
        assert products == pytest.approx(0.0, abs=4 / math.sqrt(N))
    assert (noise[:, 0] * noise[:, 1]).mean() == pytest.approx(0, abs=4 / math.sqrt(N))


def test_noise_follows_from_its_seed(lift) -> None:
    noise = {"position": 1e-3}

    runs = [
        push(lift, 0.2, state_noise=noise, seed=seed).rollout().position
        for seed in (3, 3, 4)
    ]

    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_controller_reads_what_is_published(lift) -> None:
    sim = push(lift, 0.155, state_noise={"position": 1e-3}, state_delay=2)

    told = sim.diagram.GetOutputPort("states.joint_states").Eval(sim.context)
    used = sim.diagram.GetOutputPort("arm.controller_state").Eval(sim.context)

    assert used.feedback.positions[0] == told.position[0]


def test_what_is_restored_goes_on_as_it_would_have(lift) -> None:
    named = {"state_noise": {"velocity": 0.01}, "state_delay": 2, "command_delay": 1}
    sim = push(lift, 0.2, **named)
    saved = sim.context.Clone()
    sim.advance_to(0.4)
    after = sim.rollout().position[-15:]

    other = ad.Simulation(ad.build_diagram(lift, options=dc.replace(PLAIN, **named)))
    other.simulator.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    send(other)  # The same message lies on its port.
    other.simulator.Initialize()
    other.advance_to(0.4)

    assert np.array_equal(other.rollout().position[-15:], after)


def test_who_asks_for_neither_has_nothing_between(lift) -> None:
    names = [system.get_name() for system in ad.build_diagram(lift).GetSystems()]

    assert not [name for name in names if "measured" in name or "delayed" in name]


@pytest.mark.slow
def test_delays_are_states_of_the_linear_model(lift) -> None:
    none = ad.linearize(lift, options=PLAIN)
    options = dc.replace(PLAIN, state_delay=1, command_delay=2)

    model = ad.linearize(lift, options=options)

    # x, the last x, and the last two efforts.
    A = np.zeros((6, 6))
    A[:2, :2], A[:2, 4] = PLANT, PUSH
    A[2:4, :2] = np.eye(2)
    A[4, 5], A[5, 2:4] = 1.0, -GAINS
    expected = np.linalg.eigvals(A)
    slow = np.sort(np.abs(expected[np.abs(expected) > 0.1]))
    found = np.sort([abs(pole.z) for pole in model.poles if abs(pole.z) > 0.1])
    assert found == pytest.approx(slow, abs=1e-5)
    before, after = (each.margins["slide"] for each in (none, model))
    assert after.crossover == pytest.approx(before.crossover, rel=1e-4)
    lost = before.phase - after.phase
    assert lost == pytest.approx(before.crossover * 3 * PERIOD, rel=1e-3)


BAD = [
    (
        {"state_noise": {"slide/positon": 1e-3}},
        "state_noise: no state interface 'slide/positon' is measured; did you mean "
        "'slide/position'? known: effort, position, slide/effort, slide/position, "
        "slide/velocity, velocity",
    ),
]
WRONG = [
    (
        {"state_noise": {"position": -1.0}},
        "state_noise: position: a standard deviation must be at least 0, got -1.0",
    ),
    ({"state_noise": 0.1}, "state_noise: expected numbers by name, got 0.1"),
    (
        {"state_noise": {"position": "much"}},
        "state_noise: expected numbers by name, got {'position': 'much'}",
    ),
    ({"state_delay": 1.5}, "state_delay: expected an integer of at least 0, got 1.5"),
    ({"command_delay": -1}, "command_delay must be 0 to 10000 cycles, got -1"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_noise_of_what_nothing_measures_is_an_error(lift, options, message) -> None:
    with pytest.raises(InputError) as caught:
        ad.build_diagram(lift, options=dc.replace(PLAIN, **options))

    assert str(caught.value) == message


@pytest.mark.parametrize(("options", "message"), WRONG)
def test_options_that_make_no_sense_are_errors(options, message) -> None:
    with pytest.raises(InputError) as caught:
        ad.SimulationOptions(**options)

    assert str(caught.value) == message
