"""Studies: what they draw, vary and measure; intervals; claims about rates."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import arm_drake as ad
from arm_drake import cli, yaml_files
from arm_drake.batch.statistics import most_failures
from arm_drake.batch.study import MEASURES
from arm_drake.errors import InputError
from tests.models import TWO_LINKS, trajectory_controllers

SCHEMA = Path(ad.__file__).parent / "schemas/study.schema.json"

STUDY = """
robot: {robot: arm.urdf, controllers: controllers.yaml}
duration: 0.2
options: {time_step: 0.005}
vary:
  payload.lower: {uniform: [0.0, 0.5]}
  scale.damping: {values: [1.0, 3.0]}
  initial.elbow: {normal: [0.0, 0.1]}
draws: 3
seed: 7
measures: [peak_effort, settling_time, "mine.py:last"]
"""


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "arm.urdf").write_text(TWO_LINKS)
    controllers = trajectory_controllers({"arm": ["shoulder", "elbow"]})
    (tmp_path / "controllers.yaml").write_text(controllers)
    (tmp_path / "mine.py").write_text(
        "def last(simulation):\n    return simulation.rollout().position[-1, 0]\n"
    )
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path


def test_a_grid_has_the_same_draws_at_each_point(folder) -> None:
    study = ad.load_study(folder / "study.yaml")

    values = list(study.values())

    assert study.num_runs == len(values) == 6
    assert [row["scale.damping"] for row in values] == [1.0] * 3 + [3.0] * 3
    for name in ("payload.lower", "initial.elbow"):
        drawn = [row[name] for row in values]
        assert drawn[:3] == drawn[3:]
        assert len(set(drawn)) == 3
    assert all(0.0 <= row["payload.lower"] <= 0.5 for row in values)
    # A robot goes to each worker once, wherever it begins.
    runs = study.runs()
    assert {run.robot for run in runs} == {study.robot}
    assert runs[1].changes["initial.elbow"] == values[1]["initial.elbow"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "mean", "deviation"),
    [
        ("uniform: [1, 3]", 2.0, 2.0 / math.sqrt(12.0)),
        ("normal: [1, 0.5]", 1.0, 0.5),
        ("lognormal: [0, 0.5]", math.exp(0.125), 0.60402),
        ("triangular: [0, 1, 2]", 1.0, math.sqrt(1.0 / 6.0)),
        ("exponential: [2]", 2.0, 2.0),
        # Half a bell: its mean is sqrt(2/pi), its variance 1 - 2/pi.
        ("truncated_normal: [0, 1, 0, 1000]", 0.79788, 0.60281),
        ("choice: [1, 5]", 3.0, 2.0),
    ],
)
def test_distributions_have_their_moments(folder, words, mean, deviation) -> None:
    text = STUDY.replace("uniform: [0.0, 0.5]", words).replace("draws: 3", "draws: 900")
    (folder / "study.yaml").write_text(text)

    study = ad.load_study(folder / "study.yaml")

    drawn = [row["payload.lower"] for row in study.values()][:900]
    # Four standard errors of the mean.
    assert np.mean(drawn) == pytest.approx(mean, abs=4.0 * deviation / 30.0)
    assert np.std(drawn) == pytest.approx(deviation, rel=0.15)


def test_noise_and_delays_vary_by_name_each_draw_with_noise_of_its_own(folder) -> None:
    vary = """
  noise.position: {values: [0.0, 0.01]}
  noise.elbow/velocity: {uniform: [0.0, 0.1]}
  options.state_delay: {choice: [0, 1, 2]}
draws"""
    (folder / "study.yaml").write_text(STUDY.replace("\ndraws", vary))
    study = ad.load_study(folder / "study.yaml")

    options = [run.options for run in study.runs()]

    assert len(options) == 12
    assert [each.seed for each in options] == [0, 1, 2] * 4
    assert options[-1].state_noise["position"] == 0.01
    assert 0.0 < options[-1].state_noise["elbow/velocity"] < 0.1
    assert {each.state_delay for each in options} <= {0, 1, 2}


@pytest.mark.slow
def test_the_command_runs_it_writes_and_goes_on(folder, capsys, monkeypatch) -> None:
    monkeypatch.chdir(folder)

    code = cli.main(["many", "study.yaml", "--json"])
    told = json.loads(capsys.readouterr().out)
    again = cli.main(["many", "study.yaml", "--json"])
    told_again = json.loads(capsys.readouterr().out)

    assert code == again == 0
    assert told["runs"] == 6
    assert told["success"]["rate"] == 1.0
    # Wilson's lower bound of 6 of 6: 1 / (1 + z^2 / n).
    assert told["success"]["interval"][0] == pytest.approx(1 / (1 + 1.959964**2 / 6))
    results = folder / "study_results"
    table = (results / "results.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(table.splitlines()))
    efforts = [float(row["peak_effort"]) for row in rows]
    worst = told["measures"]["peak_effort"]["worst_runs"][0]
    assert efforts[worst] == max(efforts) == told["measures"]["peak_effort"]["largest"]
    assert (results / "results.png").read_bytes().startswith(b"\x89PNG")
    assert "6 were there already" in told_again["where"]
    assert told_again["measures"] == told["measures"]
    # The command that shows the worst one shows the same number.
    words = told["measures"]["peak_effort"]["show"].split()[1:]
    assert cli.main(words) == 0
    assert f"peak_effort: {max(efforts):.4g} N·m\n" in capsys.readouterr().out
    assert cli.main(["many", "study.yaml"]) == 0
    told = capsys.readouterr().out
    assert re.search(
        r"peak_effort: [\d.]+ N·m \(95 %: .*\), from .* N·m; largest", told
    )
    assert re.search(r"settling_time: [\d.]+ s \(95 %: .*\), from .* s; largest", told)
    assert re.search(r"last: [-\d.]+ \(95 %: ", told)
    assert (folder / "run.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "scale.damping: {values: [1.0, 3.0]}",
            "noise.positon: {values: [1.0]}",
            "vary.noise.positon: state_noise: no state interface 'positon' is measured",
        ),
        (
            "scale.damping: {values: [1.0, 3.0]}",
            "options.state_delay: {values: [1.5]}",
            "vary.options.state_delay.values[0]: state_delay: expected an integer of",
        ),
        (
            "uniform: [0.0, 0.5]",
            "values: [1.0, -1.0]",
            "vary.payload.lower.values[1]: mass: expected at least 0 kg, got -1.0",
        ),
        (
            "normal: [0.0, 0.1]",
            "values: [1.0, .inf]",
            "vary.initial.elbow.values[1]: changes: initial.elbow: expected a finite",
        ),
        (
            "scale.damping: {values: [1.0, 3.0]}",
            "options.state_delay: {values: [1, 2, -1]}",
            "vary.options.state_delay.values[2]: state_delay must be 0 to",
        ),
        (
            "robot: {",
            "motion: other.yaml\nrobot: {motion: own.yaml, ",
            "motion: robot has one, too; expected one of them",
        ),
        ("seed: 7", "seed: 1.5", "seed: expected an integer, got 1.5"),
        ("draws: 3", "draw: 3", "unknown key 'draw'; did you mean 'draws'?"),
        ("draws: 3", "draws: 0", "draws: expected a finite number of at least 1, got"),
        ("draws: 3", "draws: 1.5", "draws: expected an integer, got 1.5"),
        ("payload.lower", "payload.lowe", "no link 'lowe'; did you mean 'lower'?"),
        ("payload.lower", "load.lower", "'load.lower' can't be varied; "),
        ("initial.elbow", "initial.elbo", "no joint 'elbo'; did you mean 'elbow'?"),
        ("scale.damping", "scale.dampin", "changes: scale.dampin: unknown; "),
        ("uniform: [0.0, 0.5]", "uniform: [0.0]", "expected 2 numbers, got 1"),
        ("normal: [0.0, 0.1]", "normal: [0.0, -1]", "normal: scale < 0"),
        ("uniform: [0.0, 0.5]", "values: []", "expected one value at least"),
        ("peak_effort", "peak_efort", "unknown measure 'peak_efort'; did you mean"),
        ("mine.py:last", "mine.py:first", "mine.py has no function 'first'"),
        ("mine.py:last", "yours.py:last", "no Python file 'yours.py'"),
        ("robot: {robot: arm.urdf, ", "robot: {", "expected robot: a name, a file"),
        ("seed: 7", "where: {}", "expected cluster: an address, or workers"),
    ],
)
def test_what_is_wrong_is_reported_with_its_place(folder, old, new, message) -> None:
    assert old in STUDY
    file = folder / "study.yaml"
    file.write_text(STUDY.replace(old, new))

    with pytest.raises(InputError) as caught:
        ad.load_study(file)

    text = str(caught.value)
    assert text.startswith(f"{file}:")
    assert message in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("draws: 20000000", "draws: it has 20000000 runs; expected at most 10000000"),
        ("world: hous", "world: unknown world 'hous'; did you mean 'house'? known: "),
        ("world: no.sdf", "world: {folder}/no.sdf: can't be read: No such file"),
        ("motion: no.yaml", "robot.motion: {folder}/no.yaml: can't be read: No such"),
    ],
)
def test_what_is_named_is_reported_with_its_line(folder, text, message) -> None:
    file = folder / "study.yaml"
    file.write_text(f"robot: arm.urdf\n{text}\n")

    with pytest.raises(InputError) as caught:
        ad.load_study(file)

    expected = message.format(folder=folder)
    assert str(caught.value).startswith(f"{file}:2: {expected}")


def test_the_schema_is_one_and_knows_what_the_loader_takes() -> None:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)

    study = yaml_files.parse(STUDY)

    validator.validate(study)
    assert not validator.is_valid({**study, "draw": 3})
    assert not validator.is_valid({**study, "vary": {"nose": {"uniform": [0, 1]}}})
    assert not validator.is_valid({**study, "vary": {"scale.gains": {"uniform": [0]}}})
    page = (Path(__file__).parents[2] / "docs/many.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in page for name in MEASURES)


def test_a_measure_that_raises_is_its_runs_error(folder) -> None:
    (folder / "mine.py").write_text("def last(simulation):\n    return 1 / 0\n")
    study = ad.load_study(folder / "study.yaml")

    (result,) = ad.run_many(study.runs()[:1], keep=study.measures)

    text = "measure 'last': ZeroDivisionError: division by zero"
    assert str(result.error) == text


def test_changes_reach_the_robot(folder) -> None:
    study = ad.load_study(folder / "study.yaml")

    with pytest.raises(InputError, match="joint 'elbow' has no PID"):
        ad.run_many(
            [ad.Run(robot=study.robot, changes={"gains.elbow.p": 3.0})],
            raise_errors=True,
        )


def test_intervals_are_those_of_the_textbook() -> None:
    # Wilson's formula, by hand: 8 of 10, z = 1.959964.
    z, n, p = 1.959964, 10, 0.8
    center = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))

    rate = ad.rate_interval(8, 10)
    mean = ad.mean_interval([1.0, 2.0, 3.0])

    assert rate == pytest.approx((0.8, center - half, center + half), rel=1e-6)
    # Student's t with two degrees of freedom is 4.302653.
    half = 4.302653 / math.sqrt(3.0)
    assert mean == pytest.approx((2.0, 2.0 - half, 2.0 + half), rel=1e-6)


def test_a_rate_that_is_shown_passes_without_the_runs_that_change_nothing() -> None:
    ran: list[int] = []

    took = ad.testing.assert_success_rate(
        range(1000), lambda x: ran.append(x) or True, at_least=0.99, backend="serial"
    )

    # One-sided, z = 1.644854: with all 1000 it bears k failures.
    most = most_failures(1000, 0.99, 0.95)
    assert 1 <= most < 10
    assert took == len(ran) == 1000 - most


def test_a_rate_that_is_not_shown_fails_as_soon_as_that_is_known() -> None:
    ran: list[int] = []

    with pytest.raises(AssertionError) as caught:
        ad.testing.assert_success_rate(
            range(1000), lambda x: ran.append(x), at_least=0.9, backend="serial"
        )

    most = most_failures(1000, 0.9, 0.95)
    assert len(ran) == most + 1
    text = str(caught.value)
    assert text.startswith(f"{most + 1} of {most + 1} runs failed: a rate of 0 ")
    assert "run 0 (0): it gave None" in text


@pytest.mark.slow
def test_a_run_whose_goal_did_not_end_is_no_success() -> None:
    run = ad.Run(robot="doosan_a0912", motion="tutorial", duration=1.0)
    (result,) = ad.run_many([run], backend="serial")
    assert result.value.failures == ()
    (line,) = result.value.unfinished
    assert line.endswith("joint_trajectory_controller: goal is still EXECUTING")

    with pytest.raises(AssertionError, match="goal is still EXECUTING"):
        ad.testing.assert_success_rate([run] * 3, at_least=0.5, backend="serial")


def test_too_few_runs_are_told_how_many_it_takes() -> None:
    with pytest.raises(InputError) as caught:
        ad.testing.assert_success_rate(range(20), bool, at_least=0.99)

    # All of n succeed: n / (n + z^2) >= 0.99 from n = 99 z^2 = 267.9 on.
    assert str(caught.value) == (
        "runs: 20 can't show at least 0.99 with confidence 0.95, even if all succeed; "
        "expected 268 of them or more"
    )
