"""Gains that are found: against closed forms, and better than what was there."""

import io
import json
import math
import re

import numpy as np
import pytest
import yaml

import arm_drake as ad
from arm_drake import cli
from arm_drake.batch.changes import Gains, change_robot, find_pids, with_gains
from arm_drake.batch.tuning import Trace, _choose_pids, _Rig, _sample_plants
from arm_drake.errors import InputError
from tests.models import LENGTH, LIFT, MASS, TWO_LINKS, load, trajectory_controllers

GAINS = "{p: 10.0, i: 0.5, d: 2.0, i_clamp: 3.0}"
PID = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
arm:
  ros__parameters:
    joints: [slide]
    command_interfaces: [effort]
    state_interfaces: [position, velocity]
    gains: {{slide: {GAINS}}}
"""
WEIGHTLESS = ad.SimulationOptions(time_step=0.01, gravity=False)


@pytest.fixture
def lift(tmp_path) -> ad.Robot:
    return load(tmp_path, LIFT.replace('name="position"/>', 'name="effort"/>', 1), PID)


def test_gains_are_found_and_changed(lift) -> None:
    (pid,) = find_pids(lift)

    changed = with_gains(lift, {"slide": Gains(1.0, 2.0, 3.0)}, [pid])

    assert pid.gains == Gains(10.0, 0.5, 2.0, 3.0)
    assert find_pids(changed)[0].gains == Gains(1.0, 2.0, 3.0)
    assert find_pids(lift)[0].gains == pid.gains


@pytest.mark.parametrize(
    ("changes", "gains"),
    [
        ({"gains.slide.p": 7.0}, Gains(7.0, 0.5, 2.0, 3.0)),
        ({"scale.gains": 2.0}, Gains(20.0, 1.0, 4.0, 3.0)),
        ({"scale.gains.slide.d": 0.5}, Gains(10.0, 0.5, 1.0, 3.0)),
        ({"controller.arm.gains.slide.i": 0.0}, Gains(10.0, 0.0, 2.0, 3.0)),
    ],
)
def test_changes_of_gains_are_what_they_are_called(lift, changes, gains) -> None:
    assert find_pids(change_robot(lift, changes))[0].gains == gains


def test_damping_is_scaled_in_the_physics(tmp_path) -> None:
    robot = load(tmp_path, TWO_LINKS, trajectory_controllers({"arm": ["shoulder"]}))
    changed = change_robot(robot, {"scale.damping.shoulder": 4.0})

    plant = ad.Simulation(ad.build_diagram(changed)).plant

    assert plant.GetJointByName("shoulder").default_damping_vector() == [2.0]
    assert robot.description.joint("shoulder").damping == 0.5


def test_what_a_joint_moves_is_known_in_closed_form(tmp_path) -> None:
    # Two points on massless rods, of length l: the shoulder feels most stretched out,
    # m l² + m (2 l)², and its weight then is 3 m g l.
    robot = load(
        tmp_path,
        TWO_LINKS.replace('name="position"/>', 'name="effort"/>'),
        trajectory_controllers({"arm": ["shoulder", "elbow"]}).replace(
            "[position]", "[effort]", 1
        ),
    )
    pids = _choose_pids(robot, None, None)
    rig = _Rig(robot, tuple(pids), 0.3, ad.SimulationOptions())

    shoulder, elbow = _sample_plants(rig, {})

    assert shoulder.largest == pytest.approx(5.0 * MASS * LENGTH**2, rel=0.05)
    assert elbow.largest == pytest.approx(MASS * LENGTH**2, rel=0.05)
    assert shoulder.weight == pytest.approx(3.0 * MASS * 9.81 * LENGTH, rel=0.02)


def test_figures_are_those_of_a_known_curve() -> None:
    # 1 - exp(-t) cos(2 pi t): 5 % from t = 3 on, most beyond at t = 0.475.
    time = np.linspace(0.0, 10.0, 10001)
    moved = 1.0 - np.exp(-time) * np.cos(2.0 * math.pi * time)

    response = Trace(time, -2.0 * moved[:, None], np.array([-2.0])).response()

    peak = 0.5 - math.atan(1.0 / (2.0 * math.pi)) / (2.0 * math.pi)
    beyond = math.exp(-peak) * abs(math.cos(2.0 * math.pi * peak))
    assert response.overshoot == pytest.approx(beyond, rel=1e-3)
    assert 2.5 < response.settling_time < 3.05
    assert response.end_error == pytest.approx(2.0 * math.exp(-10.0), rel=1e-6)


@pytest.mark.slow
def test_tuned_gains_keep_what_was_asked_and_are_better(lift, tmp_path) -> None:
    found = ad.tune_gains(lift, settle=0.25, overshoot=0.1, moves=2, options=WEIGHTLESS)

    assert found.keeps_promise
    assert found.after.is_better(found.before)
    again = ad.measure_gains(found.robot, settle=0.25, moves=2, options=WEIGHTLESS)
    assert again == found.after
    # What is written is what a robot with that file has.
    (tmp_path / "tuned.yaml").write_text(found.to_text())
    written = yaml.safe_load(found.to_text())["arm"]["ros__parameters"]["gains"]
    assert written["slide"]["p"] == pytest.approx(found.gains["slide"].p, rel=1e-4)
    files = [*lift.controllers.files, tmp_path / "tuned.yaml"]
    loaded = ad.load_robot(lift.description.file, controllers=files)
    p, i, d, clamp = find_pids(loaded)[0].gains
    assert (p, i, d, clamp) == pytest.approx(found.gains["slide"], rel=1e-4)


def test_tags_of_plugins_are_written() -> None:
    robot = ad.load_robot("mycobot_280")
    pids = find_pids(robot)

    changed = with_gains(robot, {pids[0].joint: Gains(2.0, 3.0, 4.0)}, pids)

    assert find_pids(changed)[0].gains == Gains(2.0, 3.0, 4.0)
    assert find_pids(changed)[1].gains == pids[1].gains


def tune(robot: ad.Robot, *words: str) -> int:
    """Run the command, and return its exit code."""
    files = [f"--controllers={file}" for file in robot.controllers.files]
    fast = ["--settle=0.25", "--moves=1", "--time-step=0.01"]
    return cli.main(["tune", str(robot.description.file), *files, *fast, *words])


@pytest.mark.slow
def test_the_command_tells_and_draws(lift, tmp_path, capsys) -> None:
    picture = tmp_path / "tuned.png"

    code = tune(lift, "--plot", str(picture), "--json")

    said = capsys.readouterr()
    told = json.loads(said.out)
    assert said.err == ""
    assert code == (0 if told["keeps_promise"] else 1)
    assert set(told["gains"]) == {"slide"}
    assert told["after"]["end_error"] < told["before"]["end_error"]
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_command_tells_units(lift, capsys) -> None:
    tune(lift)

    told = capsys.readouterr().out
    # A force on a slide.
    assert "   [N/m, N/(m·s), N·s/m]\n" in told
    assert len(re.findall(r"before: end error [\d.]+ m, overshoot", told)) == 2


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.slow
def test_a_terminal_is_shown_how_far_it_is(lift, monkeypatch) -> None:
    said = Terminal()
    monkeypatch.setattr("sys.stderr", said)

    tune(lift)

    first, *others, last = said.getvalue().split("\r")[1:]
    total = re.fullmatch(r"\[\.+\] 0/(\d+) runs, 0:00", first)[1]
    assert len(others) > 3
    assert last.startswith(f"[####################] {total}/{total} runs, ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"settle": 0.0}, "settle: expected a number above 0, got 0.0"),
        ({"joints": ["slid"]}, "joint 'slid' has no PID; did you mean 'slide'? known"),
        ({"controller": "am"}, "no controller 'am'; did you mean 'arm'? known: arm"),
        (
            {"robust_to": {"payload": (2, 1)}},
            "robust_to: payload: expected (least, largest) [kg], got (2, 1)",
        ),
        (
            {"robust_to": {"nose": (0, 1)}},
            "robust_to: no link 'nose'; did you mean",
        ),
        (
            {"robust_to": {"payload": (0, 1e3)}},
            "joint 'slide' can't hold the weight of",
        ),
    ],
)
def test_what_can_not_be_tuned_is_reported(lift, options, message) -> None:
    with pytest.raises(InputError) as caught:
        ad.tune_gains(lift, **options)

    assert str(caught.value).startswith(message)


def test_a_robot_without_pids_is_reported(tmp_path) -> None:
    robot = load(tmp_path, TWO_LINKS, trajectory_controllers({"arm": ["shoulder"]}))

    with pytest.raises(InputError, match="has no PIDs that push joints"):
        ad.tune_gains(robot)
