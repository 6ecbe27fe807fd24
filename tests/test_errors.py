"""Messages say where, what, and what would be right."""

import pytest

from arm_drake.errors import (
    ArmDrakeError,
    DescriptionError,
    InputError,
    MissingExtraError,
    MotionError,
    OutputError,
    PackageError,
    ParameterError,
    suggest,
    suggest_file,
)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ({}, "it is wrong"),
        ({"file": "a.yaml"}, "a.yaml: it is wrong"),
        ({"file": "a.yaml", "line": 3}, "a.yaml:3: it is wrong"),
        ({"where": "arm.joints"}, "arm.joints: it is wrong"),
        ({"file": "a.yaml", "line": 3, "where": "arm"}, "a.yaml:3: arm: it is wrong"),
        ({"line": 3}, "it is wrong"),
        # As of what was rewritten, whose lines aren't the user's.
        ({"file": "a.yaml", "line": 0}, "a.yaml: it is wrong"),
    ],
)
def test_a_message_starts_with_the_known_place(place, message):
    assert str(InputError("it is wrong", **place)) == message


def test_an_error_keeps_its_parts():
    error = InputError("it is wrong", file="a.yaml", line=3, where="arm")

    assert error.problem == "it is wrong"
    assert (error.file, error.line, error.where) == ("a.yaml", 3, "arm")


@pytest.mark.parametrize(
    "kind", [PackageError, DescriptionError, ParameterError, MotionError, OutputError]
)
def test_an_input_error_is_also_a_value_error(kind):
    assert issubclass(kind, InputError)
    assert issubclass(kind, ArmDrakeError)
    assert issubclass(kind, ValueError)


def test_a_missing_extra_names_its_installation():
    error = MissingExtraError("a video", "browser")

    assert str(error) == "a video needs `pip install 'arm-drake[browser]'`"
    assert isinstance(error, ArmDrakeError)
    assert isinstance(error, ImportError)


@pytest.mark.parametrize(
    ("name", "known", "message"),
    [
        ("elbw", ["wrist", "elbow"], "did you mean 'elbow'? known: elbow, wrist"),
        ("x", ["wrist", "elbow", "elbow"], "known: elbow, wrist"),
        ("x", [], "known: none"),
        (
            "joint07",
            [f"joint{n}" for n in range(40)],
            "did you mean 'joint7'? known: joint0, joint7, joint10, joint17, joint20 "
            "and 35 more",
        ),
    ],
)
def test_suggest_names_the_closest_and_all(name, known, message):
    assert suggest(name, known) == message


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("upper_arm.stl", "; did you mean 'Upper_Arm.stl'?"),
        ("goal.yaml", "; did you mean 'gaol.yaml'?"),
        ("wrist.stl", "; there are 'Upper_Arm.stl', 'base.stl'"),
        ("a.urdf", ""),
        (
            "no/gaol.yaml",
            "; there is no folder '{folder}/no', did you mean '{folder}/gaol.yaml'?",
        ),
        ("no/b.yaml", "; there is no folder '{folder}/no'"),
    ],
)
def test_a_file_that_is_not_there_is_answered_by_its_neighbours(
    tmp_path, name, message
):
    for other in ("Upper_Arm.stl", "base.stl", "gaol.yaml"):
        (tmp_path / other).touch()
    (tmp_path / "wrist.stl").mkdir()

    assert suggest_file(tmp_path / name) == message.format(folder=tmp_path)
