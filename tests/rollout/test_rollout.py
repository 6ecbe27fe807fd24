"""Rollouts: what is saved, and what they say."""

import csv

import numpy as np
import pytest

from arm_drake.errors import OutputError
from arm_drake.rollout.rollout import Reference, Rollout


def make_rollout(**changes) -> Rollout:
    values = {
        "time": np.array([0.0, 0.1, 0.2, 0.3]),
        "joint_names": ("shoulder", "slide"),
        "position": np.array([[0.0, 1.0], [0.1, 1.1], [0.2, 1.2], [0.3, 1.3]]),
        "velocity": np.full((4, 2), 1.0),
        "effort": np.array([[0.0, -3.0], [5.0, -3.0], [-5.0, -2.0], [4.9, 0.0]]),
        "effort_limit": np.array([5.0, np.inf]),
        "joint_types": ("revolute", "prismatic"),
        "references": {
            "arm": Reference(("slide",), np.array([[np.nan], [1.0], [1.25], [1.25]]))
        },
    }
    return Rollout(**(values | changes))


def test_effort_saturation_counts_the_rows_at_the_limit():
    # Two rows of 0.1 s at +-5 N·m; the slide has no limit.
    assert make_rollout().effort_saturation() == pytest.approx({"shoulder": 0.2})


def test_it_is_said_in_a_line():
    text = "<Rollout 'arm', 4 rows, 0.30 s, joints ['shoulder', 'slide']>"
    assert repr(make_rollout(robot_name="arm")) == text


def test_tracking_error_is_reference_less_measurement_of_the_right_joint():
    error = make_rollout().tracking_error("arm")
    np.testing.assert_allclose(error, [[np.nan], [-0.1], [0.05], [-0.05]])


def test_tracking_error_of_an_unknown_controller_names_the_known_ones():
    with pytest.raises(KeyError, match="no references of 'leg'; known: arm"):
        make_rollout().tracking_error("leg")


def test_tracking_error_before_anything_is_simulated_says_so():
    empty = make_rollout(time=np.zeros(0), references={})

    with pytest.raises(KeyError, match="of 'arm'; nothing has been simulated yet"):
        empty.tracking_error("arm")


def test_npz_holds_every_array_by_name(tmp_path):
    rollout = make_rollout()
    rollout.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["joint_names"].tolist() == ["shoulder", "slide"]
        for name in ("time", "position", "velocity", "effort"):
            np.testing.assert_array_equal(arrays[name], getattr(rollout, name))
        reference = rollout.references["arm"].position
        np.testing.assert_array_equal(arrays["arm/reference"], reference)
        assert arrays["arm/joint_names"].tolist() == ["slide"]


def test_csv_has_a_head_with_units_and_reads_back(tmp_path):
    rollout = make_rollout()
    rollout.save(tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "time [s]",
        "shoulder position [rad]",
        "slide position [m]",
        "shoulder velocity [rad/s]",
        "slide velocity [m/s]",
        "shoulder effort [N·m]",
        "slide effort [N]",
        "arm slide reference [m]",
    ]
    assert [float(row["shoulder effort [N·m]"]) for row in rows] == [0, 5, -5, 4.9]
    assert [row["arm slide reference [m]"] for row in rows] == [
        "",
        "1.0",
        "1.25",
        "1.25",
    ]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.txt", "unknown type '.txt' of a log; expected one of .csv, .mcap, .npz"),
        ("no/a.npz", "can't be written: the folder '{folder}/no' doesn't exist"),
        ("no/a.csv", "can't be written: the folder '{folder}/no' doesn't exist"),
    ],
)
def test_what_cannot_be_written_is_said(tmp_path, name, message):
    with pytest.raises(OutputError) as error:
        make_rollout().save(tmp_path / name)
    expected = message.format(folder=tmp_path)
    assert str(error.value) == f"{tmp_path / name}: {expected}"


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_plot_is_written_in_each_format(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    make_rollout().plot(path, "tracking")
    head = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    assert path.read_bytes().startswith(head)


@pytest.mark.slow
def test_the_plot_names_joints_units_and_controllers(tmp_path):
    make_rollout().plot(tmp_path / "a.svg", "tracking")
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    for label in (
        "shoulder [rad]",
        "slide [m]",
        "time [s]",
        "measured",
        "reference (arm)",
    ):
        assert f"<!-- {label} -->" in text


def test_an_unknown_picture_type_is_said(tmp_path):
    with pytest.raises(OutputError) as error:
        make_rollout().plot(tmp_path / "a.bmp")
    assert str(error.value) == (
        f"{tmp_path / 'a.bmp'}: unknown type '.bmp' of a picture; expected one of "
        ".png, .svg, .pdf"
    )
