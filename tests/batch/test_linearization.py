"""Linear models against closed forms, python-control, and the simulation itself."""

import cmath
import dataclasses as dc
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake import cli
from arm_drake.batch.linear_model import transfer
from arm_drake.commands import analyze
from arm_drake.errors import InputError
from tests.models import LIFT, MASS, TWO_LINKS, load, trajectory_controllers

# All of them simulate seconds.
pytestmark = pytest.mark.slow

ARM = trajectory_controllers({"arm": ["shoulder", "elbow"]})

# Of the mass on a slide; a tick is a step of the physics.
PERIOD, P, D = 0.01, 90.0, 12.0

PID = f"""
controller_manager:
  ros__parameters:
    update_rate: {round(1 / PERIOD)}
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
arm:
  ros__parameters:
    joints: [slide]
    command_interfaces: [effort]
    state_interfaces: [position, velocity]
    gains: {{slide: {{p: {P}, i: 0.0, d: {D}}}}}
"""
WEIGHTLESS = ad.SimulationOptions(time_step=PERIOD, gravity=False)

# Position and velocity after a step: v' = v + u h / m, q' = q + h v'.
PLANT = np.array([[1.0, PERIOD], [0.0, 1.0]])
PUSH = np.array([[PERIOD**2 / MASS], [PERIOD / MASS]])
GAINS = np.array([[P, D]])


@pytest.fixture
def lift(tmp_path) -> ad.Robot:
    return load(tmp_path, LIFT.replace('name="position"/>', 'name="effort"/>', 1), PID)


@pytest.fixture
def model(lift) -> ad.LinearModel:
    return ad.linearize(lift, options=WEIGHTLESS, region_tolerance=0.01)


def test_a_model_is_short_in_notebooks(model) -> None:
    size = f"{len(model.states)} states, 0.01 s a tick"

    assert repr(model) == f"<LinearModel, joints {[*model.joints]}, {size}, stable>"


def test_poles_of_a_pid_are_those_of_its_closed_form(model) -> None:
    expected = np.linalg.eigvals(PLANT - PUSH @ GAINS)

    found = [pole.z for pole in model.poles]

    # Differences of numbers of 1 by 1e-7 leave eight digits.
    order = np.lexsort((np.imag(expected), -np.abs(expected)))
    assert np.sort_complex(found) == pytest.approx(
        np.sort_complex(expected[order]), abs=1e-6
    )
    for pole in model.poles:
        s = cmath.log(pole.z) / PERIOD
        assert pole.natural_frequency == pytest.approx(abs(s))
        assert pole.damping == pytest.approx(-s.real / abs(s))


def test_responses_of_a_pid_are_those_of_its_closed_form(model) -> None:
    at = np.array([0.5, 3.0, 9.5, 40.0, 200.0])
    z = np.exp(1j * at * PERIOD)
    closed = [np.linalg.inv(each * np.eye(2) - PLANT + PUSH @ GAINS) for each in z]
    pushed = np.array([(each @ PUSH)[0, 0] for each in closed])

    by_command = model.response(at, "slide")
    by_effort = model.response(at, "slide", to="disturbance")

    assert by_command == pytest.approx(P * pushed, rel=1e-5)
    assert by_effort == pytest.approx(pushed, rel=1e-5)
    assert model.stiffness("slide") == pytest.approx(P, rel=1e-5)


def test_a_response_at_a_pole_is_infinite_if_the_pole_is_pushed_and_seen() -> None:
    A, z = np.diag([1.0, 0.5]), np.array([1.0, 2.0])
    apart, both = np.array([0.0, 1.0]), np.array([1.0, 1.0])

    assert transfer(A, apart, both, z) == pytest.approx([2.0, 1.0 / 1.5])
    assert transfer(A, both, both, z) == pytest.approx([math.inf, 1.0 + 1.0 / 1.5])


def test_margins_of_a_pid_are_those_of_python_control(model) -> None:
    import control  # Takes 1.5 s, which not all workers need.

    loop = control.ss(PLANT, PUSH, GAINS, 0.0, PERIOD)
    _, phase, modulus, _, crossover, _ = control.stability_margins(loop)

    margins = model.margins["slide"]

    # Between two frequencies of the grid is a straight line.
    assert margins.phase == pytest.approx(math.radians(phase), rel=1e-3)
    assert margins.crossover == pytest.approx(crossover, rel=1e-3)
    assert margins.modulus == pytest.approx(modulus, rel=1e-3)
    # The root that leaves the circle does so at z = -1.
    assert margins.gain == pytest.approx(4.0 / (P * PERIOD**2 + 2 * D * PERIOD), 1e-5)
    assert margins.gain_down == 0.0


def test_what_is_linear_is_predicted_up_to_its_effort_limit(model) -> None:
    # A step of 1 asks for 90 of the 100 N that it may have.
    assert model.region == {"slide": 1.0}
    assert model.at_rest
    assert model.is_stable


def make_chirp(ticks: int, size: float) -> np.ndarray:
    """Return a sweep from one to ticks / 5 cycles that repeats; each value twice."""
    k, top = np.arange(0, ticks, 2), ticks / 5
    phase = 2.0 * np.pi * (k / ticks + (top - 1.0) * (k / ticks) ** 2 / 2.0)
    return np.repeat(size * np.sin(phase), 2)


def measure_response(
    robot: ad.Robot, joint: str, options: ad.SimulationOptions, ticks: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [rad/s] and responses to a chirp's third round, (k,) each."""
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    (name,) = (c.name for c in robot.controllers.controllers if "Traj" in c.type)
    arm, now = sim.controller(name), sim.joint_states()
    names, period = now.name, 1.0 / robot.controllers.update_rate
    chirp = make_chirp(ticks, 1e-3)
    for tick in range(3 * ticks):
        row = np.array(now.position)
        row[names.index(joint)] += chirp[tick % ticks]
        point = ad.JointTrajectoryPoint(tuple(row))
        arm.send_trajectory(ad.JointTrajectory(joint_names=names, points=(point,)))
        sim.advance_to((tick + 1) * period)
    column = sim.rollout().joint_names.index(joint)
    moved = sim.rollout().position[2 * ticks : 3 * ticks, column]
    bins = np.arange(1, ticks // 5)
    moved = moved - now.position[names.index(joint)]
    response = np.fft.fft(moved)[bins] / np.fft.fft(chirp)[bins]
    return 2.0 * np.pi * bins / (ticks * period), response


def test_a_chirp_through_the_simulation_has_the_responses_of_a_pid(lift, model) -> None:
    at, measured = measure_response(lift, "slide", WEIGHTLESS, 200)

    closed = [
        np.linalg.inv(np.exp(1j * each * PERIOD) * np.eye(2) - PLANT + PUSH @ GAINS)
        for each in at
    ]
    assert measured == pytest.approx(
        np.array([P * (each @ PUSH)[0, 0] for each in closed]), rel=1e-8
    )
    assert measured == pytest.approx(model.response(at, "slide"), rel=1e-5)


@pytest.mark.slow
def test_a_chirp_through_a_robot_has_the_responses_of_its_model() -> None:
    robot = ad.load_robot("doosan_a0912")
    options = ad.SimulationOptions(friction=False, time_step=0.005)

    at, measured = measure_response(robot, "joint2", options, 200)

    model = ad.linearize(robot, options=options)
    assert np.abs(measured).max() > 10.0 * np.abs(measured).min()
    assert measured == pytest.approx(model.response(at, "joint2"), rel=1e-5)


@pytest.mark.slow
def test_the_servo_has_its_bandwidth_in_all_joints_of_a_coupled_arm(tmp_path) -> None:
    robot = load(tmp_path, TWO_LINKS, ARM)
    options = ad.SimulationOptions(servo_bandwidth=25.0)

    model = ad.linearize(robot, {"shoulder": 0.7, "elbow": -1.1}, options=options)

    assert model.positions == pytest.approx({"shoulder": 0.7, "elbow": -1.1}, abs=1e-6)
    # A double root of each joint; it is split by the root of what is rounded.
    found = np.poly([pole.s for pole in model.poles]).real
    assert found == pytest.approx(np.poly([-25.0] * 4), rel=2e-3)


@pytest.mark.slow
def test_a_simulation_is_taken_where_it_is(tmp_path) -> None:
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, TWO_LINKS, ARM)))
    sim.advance_to(0.5)
    before = sim.time

    model = ad.linearize(sim)

    assert sim.time == before
    assert model.at_rest
    assert set(model.positions) == {"shoulder", "elbow"}
    state_space = model.to_control()
    poles = [pole.z for pole in model.poles]
    assert max(abs(state_space.poles())) == pytest.approx(max(map(abs, poles)))


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ({"slid": 0.1}, "at: no joint 'slid'; did you mean 'slide'? known: slide"),
        (
            "hone",
            "group 'arm' has no state 'hone'; did you mean 'home'? "
            "known: center, home, initial",
        ),
    ],
)
def test_a_pose_that_is_none_is_reported(lift, at, message) -> None:
    with pytest.raises(InputError) as caught:
        ad.linearize(lift, at)

    assert str(caught.value) == message


def test_what_has_no_physics_is_refused(lift) -> None:
    with pytest.raises(InputError, match="no physics"):
        ad.linearize(lift, options=ad.SimulationOptions(preset="kinematic"))


def test_an_interface_that_nobody_commands_takes_no_part(tmp_path, model) -> None:
    urdf = LIFT.replace('name="position"/>', 'name="effort"/>', 1)
    light = """<gpio name="light"><command_interface name="on"/>
      <state_interface name="on"/></gpio></ros2_control>"""
    more = urdf.replace("</ros2_control>", light)
    assert more != urdf

    found = ad.linearize(load(tmp_path, more, PID), options=WEIGHTLESS)

    assert np.isfinite(found.A).all()
    assert [pole.z for pole in found.poles] == [pole.z for pole in model.poles]


def test_a_joint_that_rests_at_its_limit_is_reported(tmp_path) -> None:
    urdf = LIFT.replace('lower="-1"', 'lower="0"')
    robot = load(tmp_path, urdf, trajectory_controllers({"arm": ["slide"]}))
    told: list[tuple[str, int, int]] = []

    model = ad.linearize(robot, progress=lambda *done: told.append(done))

    line = "slide rests at its limit: its figures are those of the stop"
    shown = analyze.to_text(robot, dc.replace(model, region={"slide": 0.0}))
    assert line in shown.splitlines()
    count = len(told) // 2  # Over a period, and over a step of the servo in it.
    assert told == 2 * [("differences of states", k, count) for k in range(count)]


@pytest.mark.slow
def test_the_command_tells_and_draws(tmp_path, capsys) -> None:
    picture = tmp_path / "bode.png"
    words = ["analyze", "doosan_a0912", "--no-friction", "--plot", str(picture)]

    code = cli.main([*words, "--time-step", "0.005", "--json"])

    told = json.loads(capsys.readouterr().out)
    assert code == 0
    assert told["stable"]
    assert len(told["joints"]) == 6
    # The servo's bandwidth.
    assert told["poles"][0]["natural_frequency"] == pytest.approx(40.0, rel=1e-3)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_example_of_the_docs(capsys) -> None:
    page = Path(__file__).parents[2] / "docs" / "analysis.md"
    (example,) = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)

    exec(example, {})  # noqa: S102

    stable, frequency, *_ = capsys.readouterr().out.split()
    assert stable == "True"
    assert float(frequency) == pytest.approx(40.0, rel=0.02)  # The servo's.
