"""The benchmark's own computations: motion, references, ratios."""

import dataclasses as dc
import math

import numpy as np
import pytest

from tests.benchmarks.peers import ratios, robots
from tests.benchmarks.peers.reference import (
    ReducedModel,
    integrate,
    pd_dynamics,
    servo_dynamics,
    servo_response_to,
)
from tests.benchmarks.peers.run import Result, check_same_work, judge
from tests.benchmarks.peers.servo_law import SampledServo, exact, sampled
from tests.benchmarks.peers.task import (
    BANDWIDTH,
    PERIOD,
    SPEED,
    Commands,
    Recording,
    Task,
    command_lead,
    substeps,
)

USUAL = "position actuators, implicitfast"

# A rod of 2 kg and 1.2 m that turns about its end, level, with damping.
ROD = """
<robot name="rod"><link name="base"/>
  <link name="rod"><inertial><origin xyz="0.6 0 0"/><mass value="2.0"/>
    <inertia ixx="0.01" iyy="0.24" izz="0.24" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/>
    <axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="100" velocity="10"/>
    <dynamics damping="3.0"/></joint>
</robot>"""
INERTIA, DAMPING = 0.24 + 2.0 * 0.6**2, 3.0


def make_task(urdf: str = ROD, *, kp: float = 400.0, kd: float = 20.0) -> Task:
    n = len(robots.joints_of(urdf))
    gains = np.full(n, kp), np.full(n, kd)
    return Task("rod", urdf, *gains, way=np.ones(n), duration=2.0)


def make_commands(task: Task) -> Commands:
    time = PERIOD * np.arange(task.num_ticks)
    return Commands(*task.motion(time))


def make_result(
    engine: str, setting: str, step: float, error: float, *, wall: list[float]
) -> Result:
    return Result(
        "rod",
        engine,
        setting,
        "servo",
        step,
        wall=wall,
        error=error,
        error_ahead=2.0 * error,
        error_back=0.5 * error,
        track=1.0,
    )


def wall(result: Result) -> list[float]:
    return result.wall


def test_joints_go_there_and_back_at_the_speed_that_is_said():
    task = make_task()
    time = np.linspace(-1.0, 3.0, 4001)

    q, v = task.motion(time)

    at = np.searchsorted(time, [0.0, 1.0, 2.0])
    assert q[at, 0] == pytest.approx([0.0, SPEED * 2.0 / 3.0, 0.0], abs=1e-12)
    assert np.abs(v).max() == pytest.approx(SPEED, rel=1e-5)
    # Differences are off by half a step where the acceleration, 1.8, sets in or ends.
    assert np.gradient(q[:, 0], time)[1:-1] == pytest.approx(v[1:-1, 0], abs=1e-3)


def test_a_period_that_steps_do_not_fit_is_refused():
    assert substeps(0.002) == 5
    with pytest.raises(ValueError, match=r"steps of 0\.003 s don't fit into 0\.01 s"):
        substeps(0.003)


def test_reduced_model_is_that_of_the_rod():
    robot = ReducedModel(make_task())

    M = robot.mass_matrix(np.array([0.3]))
    falls = robot.bias(np.array([0.3]), np.array([2.0]), gravity=True)
    turns = robot.bias(np.array([0.3]), np.array([2.0]), gravity=False)

    assert pytest.approx(INERTIA) == M
    # About y the rod falls forwards: its weight turns it by +m g r cos(q).
    weight = 2.0 * 9.81 * 0.6 * math.cos(0.3)
    assert falls == pytest.approx(DAMPING * 2.0 - weight)
    assert turns == pytest.approx(DAMPING * 2.0)


def test_mimic_joint_adds_its_inertia_by_the_square_of_its_factor():
    extra = """<link name="tip"><inertial><mass value="1.0"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
      </inertial></link>
      <joint name="wheel" type="revolute"><parent link="base"/><child link="tip"/>
      <axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="1" velocity="1"/>
      <mimic joint="hinge" multiplier="-3.0"/></joint></robot>"""
    other = ROD.replace("</robot>", extra)

    task = make_task(other)

    assert task.joints == ("hinge",)
    M = ReducedModel(task).mass_matrix(np.zeros(1))
    assert pytest.approx(INERTIA + 9.0 * 0.1) == M


@pytest.mark.slow
def test_pd_reference_is_the_damped_oscillator():
    task = make_task()
    n = task.num_ticks
    step = Commands(np.full((n, 1), 0.2), np.zeros((n, 1)))

    found = integrate(
        pd_dynamics(task, ReducedModel(task)), step, is_stiff=True, rtol=1e-9
    )

    time = PERIOD * np.arange(n)
    fall, w = (20.0 + DAMPING) / (2.0 * INERTIA), math.sqrt(400.0 / INERTIA)
    wd = math.sqrt(w**2 - fall**2)
    still = np.exp(-fall * time) * (np.cos(wd * time) + fall / wd * np.sin(wd * time))
    # Radau at 1e-9, over a transient of a hundred periods: 1e-8 is far from any model
    # error, of which the least, the damping's, would be 1e-2.
    assert found.q[:, 0] == pytest.approx(0.2 * (1.0 - still), abs=1e-8)


@pytest.mark.slow
def test_servo_reference_through_the_dynamics_is_its_closed_form():
    task = make_task()
    commands = make_commands(task)

    found = integrate(
        servo_dynamics(ReducedModel(task)), commands, is_stiff=False, rtol=1e-12
    )
    expected = servo_response_to(commands)

    assert found.q == pytest.approx(expected.q, abs=1e-12)
    assert found.v == pytest.approx(expected.v, abs=1e-10)


@pytest.mark.parametrize("step", [0.001, 0.005, 0.01])
def test_exact_servo_is_the_continuous_one_at_any_step(step):
    commands = make_commands(make_task())

    q = simulate(exact(step), commands, step)

    # Rounding alone: kp h^2 adds up 1e-16 over some tens of steps.
    assert q == pytest.approx(servo_response_to(commands).q, abs=1e-13)


def test_sampled_servo_comes_closer_in_proportion_to_its_step():
    commands = make_commands(make_task())
    expected = servo_response_to(commands).q

    errors = [
        np.abs(simulate(sampled(step), commands, step) - expected).max()
        for step in (0.01, 0.005, 0.0025)
    ]

    # First order, with terms of the second: w0 h of them are up to 0.4.
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_sampled_servo_follows_a_ramp_without_lag(step):
    # Two seconds of a command that tells where the ramp will be a period later.
    speed, ticks = 0.5, np.arange(200)[:, None]
    commands = Commands(speed * PERIOD * (ticks + 1.0), np.full(ticks.shape, speed))

    q = simulate(sampled(step), commands, step, every_step=True)[:, 0]

    late = (q - speed * step * np.arange(len(q)))[-substeps(step) :].mean()
    # In the mean over a period u is 0, so q is kd/kp behind c. Where the poles are that
    # is 2/w0 but for terms of h^2; transients are down to w0 t exp(-80), 1e-33.
    z = math.exp(-BANDWIDTH * step)
    missing = 2.0 / BANDWIDTH - step * (1.0 + z) / (1.0 - z)
    assert late == pytest.approx(speed * missing, abs=1e-12)


def simulate(
    servo: SampledServo, commands: Commands, step: float, *, every_step: bool = False
) -> np.ndarray:
    """Return positions of a unit mass under a servo, by semi-implicit steps."""
    firsts, others = servo.commands(commands)
    q = v = np.zeros(commands.q.shape[1])
    rows = []
    for first, other in zip(firsts, others, strict=True):
        for i in range(substeps(step)):
            if every_step or not i:
                rows.append(q)
            u = (other if i else first) - servo.kp * q - servo.kd * v
            v = v + step * u
            q = q + step * v
    return np.array(rows)


def test_exact_servo_rests_at_its_command():
    servo = exact(0.004)

    assert servo.b0 + servo.b1 == pytest.approx(1.0)
    assert servo.lead == command_lead() == 2.0 / BANDWIDTH - PERIOD / 2.0


def test_a_late_recording_is_mended_by_half_a_step():
    task, step = make_task(), 0.01
    time = PERIOD * np.arange(task.num_ticks)
    reference = Recording(*task.motion(time))
    late = Recording(*task.motion(time - step / 2.0))

    result = judge(Result("rod", "", "", "pd", step), task, late, reference)

    # Half a step of the largest speed; what is left is the curvature, h^2/8 of the
    # acceleration at either end, 6 x 0.3 rad/s^2.
    assert result.error == pytest.approx(SPEED * step / 2.0, rel=1e-2)
    assert result.error_ahead == pytest.approx(step**2 / 8.0 * 1.8, rel=0.05)
    assert ratios.correction(result) == "+"


def test_what_flies_away_is_no_result():
    task = make_task()
    q, v = task.motion(PERIOD * np.arange(task.num_ticks))

    for far in (2.0, math.nan):
        result = judge(
            Result("rod", "", "", "pd", 0.01), task, Recording(q + far, v), None
        )
        assert result.problem.startswith("not the task: off by")


def test_ratio_is_taken_turn_by_turn():
    found = ratios.ratio([2.0, 30.0, 8.0], [1.0, 10.0, 2.0])

    assert found == (3.0, 2.0, 4.0)
    assert str(found) == "3.00 (2.00 to 4.00)"


def test_equal_error_takes_the_cheapest_and_equal_cost_the_most_exact():
    rows = [
        make_result("a", "x", 0.001, 1e-4, wall=[10.0, 11.0, 12.0]),
        make_result("a", "x", 0.01, 1e-3, wall=[1.0, 1.0, 2.0]),
        make_result("b", "x", 0.01, 1e-9, wall=[0.1, 0.1, 0.1]),
    ]
    choice = ratios.Choice("a", "x")

    assert ratios.cheapest(rows, choice, 1e-3, wall) is rows[1]
    assert ratios.cheapest(rows, choice, 6e-4, wall) is rows[0]
    corrected = choice._replace(is_corrected=True)
    assert ratios.cheapest(rows, corrected, 6e-4, wall) is rows[1]
    assert ratios.cheapest(rows, choice, 1e-5, wall) is None
    assert ratios.most_exact(rows, choice, 11.0, wall) is rows[0]
    assert ratios.most_exact(rows, choice, 10.9, wall) is rows[1]
    assert ratios.most_exact(rows, choice, 0.5, wall) is None


def test_goals_compare_what_is_exact_enough_and_name_what_is_missing():
    rows = [
        make_result("arm_drake", "accurate", 0.01, 9e-4, wall=[4.0, 6.0]),
        make_result("MuJoCo", USUAL, 0.002, 5e-4, wall=[2.0, 2.0]),
        make_result("MuJoCo", USUAL, 0.01, 2e-3, wall=[0.2, 0.2]),
    ]
    goals = {goal.what: goal for goal in ratios.goals()}

    found = goals["accurate, 1e-3 rad, MuJoCo implicitfast"].measure(rows, wall)
    missing = goals["fast, 2.3e-4 rad, DART springs"].measure(rows, wall)

    assert found == (2.5, 2.0, 3.0)
    assert missing == "no fast (arm_drake) is there, or exact"


def test_a_result_with_a_problem_is_never_chosen():
    row = make_result("a", "x", 0.001, 1e-4, wall=[])

    broken = dc.replace(row, problem="RuntimeError: no")

    assert ratios.cheapest([broken], ratios.Choice("a", "x"), 1.0, wall) is None


def test_cylinder_links_have_the_inertia_of_cylinders():
    arm = robots.ur5e_like()

    assert robots.joints_of(arm)[0] == "shoulder_pan"
    assert len(robots.joints_of(arm)) == 6
    # The lift's upper arm: m (3 r^2 + l^2) / 12 across, of 8.058 kg, 0.06 m, 0.425 m.
    expected = 8.058 * (3.0 * 0.06**2 + 0.425**2) / 12.0
    assert f'iyy="{expected}"' in arm


def test_a_peer_that_did_something_else_is_no_peer():
    mine = make_result("arm_drake", "accurate", 0.01, 3e-4, wall=[1.0])
    same = make_result("Drake, C++ only", "same servo", 0.01, 3e-4, wall=[1.0])
    other = dc.replace(same, error=3.1e-4)

    assert check_same_work([mine, same]) == [mine, same]
    assert check_same_work([mine, other])[1].problem == (
        "other work than ours: errors 0.00031, 0.0003"
    )
