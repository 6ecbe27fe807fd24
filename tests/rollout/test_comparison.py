"""Differences between two rollouts."""

import dataclasses as dc
import json
import math
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.rollout.comparison import Comparison, compare
from arm_drake.rollout.rollout import GoalRecord, SentMessage
from tests.rollout.test_rollout import make_rollout

INFO = {"versions": {"drake": "1"}, "robot": {"files": [{"file": "a", "sha256": "x"}]}}
GOAL = GoalRecord("arm", "G", 0.0, 0.2, "SUCCEEDED", 0)


def changed(name: str, row: int, column: int, by: float):
    """Return the rollout with one number changed."""
    values = getattr(make_rollout(), name).copy()
    values[row, column] += by
    return make_rollout(**{name: values})


def test_a_rollout_equals_itself() -> None:
    found = compare(make_rollout(), make_rollout())

    assert found.is_equal
    assert (found.num_rows, found.is_interpolated) == (4, False)
    assert [column.name for column in found.columns] == [
        "shoulder position [rad]",
        "slide position [m]",
        "shoulder velocity [rad/s]",
        "slide velocity [m/s]",
        "shoulder effort [N·m]",
        "slide effort [N]",
        "arm slide reference [m]",
    ]


def test_one_number_is_found_with_its_size_and_time() -> None:
    found = compare(make_rollout(), changed("position", 2, 1, -0.5))

    (column,) = found.different
    assert column.name == "slide position [m]"
    assert column.largest == pytest.approx(0.5)
    assert column.at == 0.2
    # One of four rows.
    assert column.rms == pytest.approx(0.5 / math.sqrt(4.0))
    assert (column.final, column.num_missing) == (0.0, 0)


def test_a_number_whose_square_is_beyond_all_is_found() -> None:
    found = compare(make_rollout(), changed("position", 2, 1, 1e308))

    (column,) = found.different
    assert column.largest == 1e308
    assert column.rms == math.inf


def test_the_last_difference_has_its_sign() -> None:
    found = compare(make_rollout(), changed("velocity", 3, 0, -0.25))

    assert found.different[0].final == -0.25


@pytest.mark.parametrize(("tolerance", "is_equal"), [(0.4, False), (0.5, True)])
def test_what_is_within_the_tolerance_is_equal(tolerance, is_equal) -> None:
    found = compare(make_rollout(), changed("effort", 1, 0, 0.5), tolerance)

    assert found.is_equal == is_equal


def test_a_value_that_only_one_has_is_a_difference() -> None:
    found = compare(make_rollout(), changed("position", 1, 0, math.nan), 1e9)

    (column,) = found.different
    assert (column.largest, column.num_missing) == (0.0, 1)


def cut(rows: slice):
    whole = make_rollout()
    arrays = ("time", "position", "velocity", "effort", "active", "command")
    changes = {name: getattr(whole, name)[rows] for name in arrays}
    reference = whole.references["arm"]
    part = dc.replace(reference, position=reference.position[rows])
    return dc.replace(whole, **changes, references={"arm": part})


def test_a_shorter_run_is_another_one_and_its_rows_are_compared() -> None:
    found = compare(make_rollout(), cut(slice(0, 3)))

    assert found.differences == (
        "rows end at 0.3 s in A, at 0.2 s in B",
        "4 rows in A, 3 rows in B",
    )
    assert (found.num_rows, found.different) == (3, ())


def test_rows_at_other_times_are_interpolated() -> None:
    moved = make_rollout(time=np.array([0.05, 0.15, 0.25, 0.35]))

    found = compare(make_rollout(), moved)

    assert found.is_interpolated
    # At 0.1, 0.2 and 0.3 s; positions grow by 1 each second, B is 0.05 s late.
    assert found.num_rows == 3
    position = found.columns[0]
    assert position.largest == pytest.approx(0.05)
    assert position.rms == pytest.approx(0.05)


def test_without_a_common_time_nothing_is_equal() -> None:
    late = make_rollout(time=np.array([1.0, 1.1, 1.2, 1.3]))

    found = compare(make_rollout(), late, tolerance=1e9)

    assert "they have no time in common" in found.differences
    assert not found.is_equal


def test_other_joints_are_reported() -> None:
    other = make_rollout(joint_names=("shoulder", "lift"), references={})

    found = compare(make_rollout(), other)

    assert found.differences == (
        "only in A: slide position [m], slide velocity [m/s], slide effort [N], "
        "arm slide reference [m]",
        "only in B: lift position [m], lift velocity [m/s], lift effort [N]",
    )


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"status": "ABORTED"}, "another status: SUCCEEDED in A, ABORTED in B"),
        ({"error_code": -4}, "another error_code: 0 in A, -4 in B"),
        ({"goal": {"x": 1}}, "another goal"),
        ({"sent_at": 1.0}, "sent at 0 s in A, at 1 s in B"),
    ],
)
def test_other_goals_are_told(changes, difference) -> None:
    a = make_rollout(goals=(GOAL,), info=INFO)
    b = make_rollout(goals=(dc.replace(GOAL, **changes),), info=INFO)

    assert compare(a, b).differences == (f"goal 1: {difference}",)


def test_goals_are_not_missed_where_a_table_cannot_have_them() -> None:
    a = make_rollout(goals=(GOAL,), info=INFO)

    assert compare(a, make_rollout()).is_equal


MESSAGE = SentMessage(0.1, "/arm/commands", "Float64MultiArray", {"data": [1.0]})


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"data": {"data": [2.0]}}, "another data"),
        ({"topic": "/b"}, "another topic: /arm/commands in A, /b in B"),
        ({"time": 0.2}, "sent at 0.1 s in A, at 0.2 s in B"),
    ],
)
def test_other_messages_are_reported(changes, difference) -> None:
    a = make_rollout(messages=(MESSAGE,), info=INFO)
    b = make_rollout(messages=(dc.replace(MESSAGE, **changes),), info=INFO)

    assert compare(a, b).differences == (f"message 1: {difference}",)
    assert compare(a, make_rollout(info=INFO)).differences == (
        "1 messages in A, 0 messages in B",
    )


def test_other_limits_and_types_of_controllers_are_reported() -> None:
    active = np.ones((4, 1))
    a = make_rollout(info=INFO, controllers={"arm": "old/Type"}, active=active)
    b = make_rollout(
        info=INFO,
        controllers={"arm": "new/Type"},
        active=active,
        effort_limit=np.array([1.0, 2.0]),
    )

    assert compare(a, b).differences == (
        "shoulder: effort limit 5 in A, 1 in B",
        "slide: effort limit inf in A, 2 in B",
        "controller arm: old/Type in A, new/Type in B",
    )


def test_what_differs_most_for_its_unit_is_first() -> None:
    # Positions range over 1 m, efforts over far more: 0.25 m are more than 0.5 N.
    base = changed("position", 2, 1, -0.25)
    effort = base.effort.copy()
    effort[:, 1] = [0.0, 100.0, 0.0, 100.0]
    moved = effort.copy()
    moved[2, 1] += 0.5

    found = compare(make_rollout(effort=effort), dc.replace(base, effort=moved))

    assert [c.name for c in found.different] == [
        "slide position [m]",
        "slide effort [N]",
    ]
    assert found.different[1].relative == pytest.approx(0.5 / 100.0)


def test_unit_quaternions_are_ranked_together() -> None:
    pose = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (4, 1))
    noisy = pose.copy()
    noisy[1, 4] += 1e-13
    a = make_rollout(free_poses={"base": pose})
    b = changed("position", 2, 1, -0.01)
    b = dc.replace(b, free_poses={"base": noisy})

    assert [c.name for c in compare(a, b).different] == [
        "slide position [m]",
        "pose base qx",
    ]


def test_what_one_lacks_in_all_rows_comes_first() -> None:
    b = changed("position", 2, 1, -0.01)
    b = dc.replace(b, velocity=np.full((4, 2), np.nan))

    names = [c.name for c in compare(make_rollout(), b).different]

    assert names[:2] == ["shoulder velocity [rad/s]", "slide velocity [m/s]"]


def test_logs_without_rows_are_equal() -> None:
    empty = cut(slice(0, 0))

    assert compare(empty, empty).is_equal
    assert not compare(empty, make_rollout()).is_equal


def test_files_of_one_name_are_told_apart() -> None:
    def made_of(second: str) -> ad.Rollout:
        files = [{"file": "a", "sha256": "x"}, {"file": "a", "sha256": second}]
        return make_rollout(info={"robot": {"files": files}})

    assert compare(made_of("1"), made_of("2")).inputs == (
        "robot.files[a (2)].sha256: 1 in A, 2 in B",
    )


def test_rows_a_nanosecond_apart_are_two() -> None:
    first = make_rollout(time=np.array([0.0, 1e-9, 2e-9, 3e-9]))
    second = make_rollout(time=np.array([1e-9, 2e-9, 3e-9, 4e-9]))

    assert compare(first, second).num_rows == 3
    assert compare(first, make_rollout(time=first.time + 1e-10)).is_equal is True


def test_other_inputs_are_reported_and_make_no_difference() -> None:
    other = {
        "versions": {"drake": "2"},
        "robot": {"files": [{"file": "a", "sha256": "y"}]},
        "world": "house",
    }

    found = compare(make_rollout(info=INFO), make_rollout(info=other))

    assert found.is_equal
    assert found.inputs == (
        "versions.drake: 1 in A, 2 in B",
        "robot.files[a].sha256: x in A, y in B",
        "world: nothing in A, house in B",
    )


def run(capsys, *words: object) -> tuple[int, str]:
    code = main(["compare", *map(str, words)])
    return code, capsys.readouterr().out


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    paths = (tmp_path / "a.npz", tmp_path / "b.mcap")
    make_rollout().save(paths[0])
    changed("position", 2, 1, -0.5).save(paths[1])
    return paths


def test_the_command_prints_what_differs(capsys, files) -> None:
    code, out = run(capsys, *files)

    assert code == 1
    table = [line.split() for line in out.splitlines() if "slide position" in line]
    assert table == [["slide", "position", "[m]", "0.5", "0.2", "0.25", "0", "0"]]
    assert out.endswith("different: 7 quantities in 4 rows\n")


def test_equal_files_of_any_type_exit_with_0(capsys, files) -> None:
    make_rollout().save(files[0].with_suffix(".csv"))

    code, out = run(capsys, files[0], files[0].with_suffix(".csv"))

    assert (code, out.splitlines()[-1]) == (0, "equal: 7 quantities in 4 rows")
    code, out = run(capsys, *files, "--tolerance", "0.5")
    assert (code, out.splitlines()[-1]) == (
        0,
        "equal within 0.5: 7 quantities in 4 rows",
    )


def test_json_is_one_object_with_every_column(capsys, files) -> None:
    code, out = run(capsys, *files, "--json")

    content = json.loads(out)
    assert (code, content["equal"], content["rows"]) == (1, False, 4)
    assert len(content["columns"]) == 7
    assert {f.name for f in dc.fields(Comparison)} >= {"columns", "inputs"}


@pytest.mark.slow
def test_the_plot_is_a_picture(capsys, files, tmp_path) -> None:
    code, _ = run(capsys, *files, "--plot", tmp_path / "a.png")
    equal, _ = run(capsys, files[0], files[0], "--plot", tmp_path / "b.svg")

    assert (code, equal) == (1, 0)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "no difference" in (tmp_path / "b.svg").read_text(encoding="utf-8")


def test_a_plot_without_quantities_tells_what_differs(capsys, tmp_path) -> None:
    make_rollout(goals=(GOAL,), info=INFO).save(tmp_path / "a.npz")
    make_rollout(info=INFO).save(tmp_path / "b.npz")
    names = [tmp_path / name for name in ("a.npz", "b.npz")]

    code, _ = run(capsys, *names, "--plot", tmp_path / "a.svg")

    assert code == 1
    picture = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "1 goals in A, 0 goals in B" in picture


def test_what_cannot_be_used_exits_with_2(capsys, files, tmp_path) -> None:
    code = main(["compare", str(files[0]), str(tmp_path / "no.npz")])

    assert code == 2
    assert capsys.readouterr().err == (
        f"arm-drake: {tmp_path / 'no.npz'}: can't be read: No such file or directory\n"
    )
