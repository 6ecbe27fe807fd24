"""Rollouts on the disk: what is written comes back."""

import dataclasses as dc
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import GoalRecord, Reference, SentMessage
from tests.rollout.test_rollout import make_rollout

# All that a rollout can have, with names as descriptions have them.
FULL = make_rollout(
    robot_name="arm",
    joint_types=("continuous", "prismatic"),
    command_names=("shoulder/position", "slide/effort", "gpio/door, left"),
    command=np.array([[np.nan, 1.0, 0.5], [1 / 3, 0.1, -0.0], [1, 2, 3], [4, 5, 6]]),
    controllers={"arm": "a/Type", "hand": "b/Type"},
    active=np.array([[np.nan, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    free_poses={"base link": np.arange(28.0).reshape(4, 7)},
    contact_forces={
        "tip link": np.array([[0.0, 0, 0], [1, 2, 3], [0, 0, -1], [0] * 3])
    },
    goals=(
        GoalRecord("arm", "G", 0.1, None, "EXECUTING", goal={"tolerance": "inf"}),
        GoalRecord("arm", "G", 0.1, 0.2, "ABORTED", -4, "late · ü", {}, {"code": -4}),
    ),
    messages=(SentMessage(0.1, "/arm/commands", "Float64MultiArray", {"data": [1]}),),
    info={"versions": {"drake": "1"}, "world": "empty"},
    description="<robot name='·'/>\0",
)

ROWS = ("time", "position", "velocity", "effort", "command", "active")


def assert_same_rows(found: ad.Rollout, expected: ad.Rollout) -> None:
    for name in ROWS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.joint_names == expected.joint_names
    assert found.command_names == expected.command_names
    assert list(found.controllers) == list(expected.controllers)
    assert found.references.keys() == expected.references.keys()
    for name, reference in expected.references.items():
        assert found.references[name].joint_names == reference.joint_names
        position = found.references[name].position
        np.testing.assert_array_equal(position, reference.position)
    for field in ("free_poses", "contact_forces"):
        values, wanted = getattr(found, field), getattr(expected, field)
        assert values.keys() == wanted.keys()
        for link, array in wanted.items():
            np.testing.assert_array_equal(values[link], array)


def assert_same(found: ad.Rollout, expected: ad.Rollout) -> None:
    assert_same_rows(found, expected)
    np.testing.assert_array_equal(found.effort_limit, expected.effort_limit)
    arrays = {*ROWS, "effort_limit", "references", "free_poses", "contact_forces"}
    for field in dc.fields(ad.Rollout):
        if field.name not in arrays:
            assert getattr(found, field.name) == getattr(expected, field.name)


@pytest.mark.parametrize("rollout", [FULL, make_rollout()], ids=["full", "rows"])
@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_arrays_and_bags_come_back_with_everything(
    tmp_path: Path, suffix: str, rollout: ad.Rollout
) -> None:
    rollout.save(tmp_path / f"a{suffix}")

    assert_same(ad.Rollout.load(tmp_path / f"a{suffix}"), rollout)


@pytest.mark.parametrize("rollout", [FULL, make_rollout()], ids=["full", "rows"])
def test_a_table_comes_back_with_its_rows(tmp_path: Path, rollout: ad.Rollout) -> None:
    rollout.save(tmp_path / "a.csv")

    found = ad.Rollout.load(tmp_path / "a.csv")

    assert_same_rows(found, rollout)
    assert found.joint_types == ("revolute", "prismatic")
    assert found.effort_limit.tolist() == [math.inf, math.inf]
    assert (found.goals, found.messages, found.info, found.description) == (
        (),
        (),
        {},
        "",
    )


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap"])
def test_a_rollout_without_rows_comes_back(tmp_path: Path, suffix: str) -> None:
    empty = dc.replace(
        FULL,
        **{name: getattr(FULL, name)[:0] for name in ROWS},
        references={},
        free_poses={"base link": np.zeros((0, 7))},
        contact_forces={"tip link": np.zeros((0, 3))},
    )
    empty.save(tmp_path / f"a{suffix}")

    assert_same_rows(ad.Rollout.load(tmp_path / f"a{suffix}"), empty)


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".mcap"])
def test_the_same_rollout_is_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    files = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for file in files:
        FULL.save(file)

    assert files[0].read_bytes() == files[1].read_bytes()


def test_arrays_need_no_pickle(tmp_path: Path) -> None:
    FULL.save(tmp_path / "a.npz")

    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert all(array.dtype != object for array in arrays.values())


def test_a_row_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    FULL.save(file)
    file.write_bytes(file.read_bytes()[:-3])

    assert ad.Rollout.load(file).time.tolist() == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.npz", b"text", "can't be read: it is no .npz file, or only a part of one"),
        ("a.mcap", b"text", "no rollout; expected a bag of Rollout.save ("),
        ("a.csv", b"x,y\n1,2\n", "no rollout; expected a table of Rollout.save ("),
        ("a.csv", b"", "no rollout; expected a table of Rollout.save (the file has no"),
        (
            "a.csv",
            b"\n",
            "no rollout; expected a table of Rollout.save (the file has no",
        ),
        ("a.csv", b"time [s],a\n1,2\n", "no rollout; expected a table of Rollout.sa"),
        ("a.txt", b"", "unknown type '.txt' of a log; expected one of "),
        ("no/a.npz", None, "can't be read: No such file or directory"),
    ],
)
def test_what_cannot_be_read_is_said(
    tmp_path: Path, name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)

    with pytest.raises(InputError) as error:
        ad.Rollout.load(tmp_path / name)

    assert str(error.value).startswith(f"{tmp_path / name}: {message}")


def test_a_bag_that_was_cut_can_be_mended(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    FULL.save(file)
    file.write_bytes(file.read_bytes()[:-100])

    with pytest.raises(InputError, match="`mcap recover` mends a bag that was cut"):
        ad.Rollout.load(file)


@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_another_name_than_the_robots_is_refused(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"a{suffix}"
    dc.replace(FULL, robot_name="arm").save(file)

    assert ad.Rollout.load(file, "arm").robot_name == "arm"
    with pytest.raises(InputError, match="no robot 'leg'; known: arm"):
        ad.Rollout.load(file, "leg")


def test_other_arrays_are_no_rollout(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=np.zeros(3))

    with pytest.raises(InputError, match="no rollout"):
        ad.Rollout.load(tmp_path / "a.npz")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((4, 2), "S8")}, "position holds |S8, expected numbers"),
        (
            {"velocity": np.zeros((4, 2), complex)},
            "velocity holds complex128, expected",
        ),
        ({"time": np.array([0, 1, 2, 3], "M8[s]")}, "times are no numbers of seconds"),
        ({"command": np.zeros((4, 3), "U1")}, "command holds <U1, expected numbers"),
        (
            {"references": {"arm": Reference(("gone",), np.zeros((4, 1)))}},
            "reference of 'arm' is of a joint 'gone' that the rollout doesn't have",
        ),
    ],
)
def test_arrays_of_something_else_are_refused(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = tmp_path / "a.npz"
    dc.replace(FULL, **changes).save(path)

    with pytest.raises(InputError) as caught:
        ad.Rollout.load(path)

    assert str(caught.value).startswith(f"{path}: can't be read: it is damaged or no")
    assert message in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["?", "u1", "i8"])
def test_other_numbers_are_read_as_floating_ones(tmp_path: Path, kind: str) -> None:
    path, position = tmp_path / "a.npz", np.array([[3, 0], [2, 1], [0, 0], [1, 2]])
    dc.replace(FULL, position=position.astype(kind)).save(path)

    loaded = ad.Rollout.load(path)

    expected = position.astype(kind).astype(float)
    assert loaded.position.dtype == float
    np.testing.assert_array_equal(loaded.position, expected)
    loaded.plot(tmp_path / "plot.png")


@pytest.mark.slow
def test_pandas_gets_every_column() -> None:
    frame = FULL.to_pandas()

    assert frame.index.name == "time [s]"
    assert frame.index.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert frame["slide velocity [m/s]"].tolist() == [1.0] * 4
    assert frame["command slide/effort [N]"].tolist() == [1.0, 0.1, 2.0, 5.0]
    assert frame["hand active"].tolist() == [0.0, 0.0, 1.0, 1.0]
    assert frame["pose base link qw"].tolist() == [3.0, 10.0, 17.0, 24.0]


@pytest.mark.slow
def test_without_pandas_it_is_said_what_is_missing() -> None:
    code = (
        "import sys; sys.modules['pandas'] = None\n"
        "from tests.rollout.test_rollout import make_rollout\n"
        "try: make_rollout().to_pandas()\n"
        "except ImportError as error: print(error)"
    )

    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120
    )

    assert done.stdout == "Rollout.to_pandas needs `pip install 'arm-drake[pandas]'`\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"position": np.zeros((3, 1))}, r"position has shape \(3, 1\), expected"),
        ({"effort_limit": np.zeros(7)}, r"effort_limit has shape \(7,\), expected"),
        ({"time": np.zeros((2, 2))}, "times are no numbers of seconds"),
        ({"time": np.full(5, 1e300)}, "times are no numbers of seconds"),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(
    tmp_path: Path, change: dict[str, Any], problem: str
) -> None:
    file = tmp_path / "a.npz"
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
    sim.run(0.1)
    sim.rollout().save(file)
    with np.load(file) as arrays:
        content = {name: arrays[name] for name in arrays.files}
    np.savez(file, **{**content, **change})

    with pytest.raises(InputError, match=f"damaged or no log \\({problem}"):
        ad.Rollout.load(file)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_a_file_with_changed_bytes_is_read_or_refused(
    tmp_path: Path, suffix: str
) -> None:
    file = tmp_path / f"a{suffix}"
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
    sim.run(0.1)
    sim.rollout().save(file)
    whole, random = bytearray(file.read_bytes()), np.random.default_rng(7)
    refused = 0
    for _ in range(60):
        content = bytearray(whole)
        for at in random.integers(0, len(content), 8):
            content[at] = random.integers(256)
        file.write_bytes(content)
        try:
            ad.Rollout.load(file)
        except InputError as error:
            assert str(file) in str(error)  # noqa: PT017
            refused += 1

    assert refused > 30


def test_names_with_spaces_come_back_from_a_table(tmp_path: Path) -> None:
    reference = Reference(("slide", "upper slide"), np.arange(8.0).reshape(4, 2))
    rollout = make_rollout(
        joint_names=("slide", "upper slide"), references={"my ctrl": reference}
    )

    rollout.save(tmp_path / "a.csv")
    found = ad.Rollout.load(tmp_path / "a.csv")

    assert list(found.references) == ["my ctrl"]
    assert found.references["my ctrl"].joint_names == reference.joint_names
    np.testing.assert_array_equal(
        found.references["my ctrl"].position, reference.position
    )
