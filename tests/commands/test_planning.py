import json

import pytest

from arm_drake.cli import main

FRAME = "link6"


def test_ik_prints_positions_that_reach_the_pose(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["ik", "doosan_a0912", "--frame", FRAME, "--pose", "0.4,0.2,0.6", "--json"]

    code = main(words)

    content = json.loads(capsys.readouterr().out)
    assert code == 0
    assert content["position_error"] < 1e-5
    assert content["tries"] >= 1


def test_ik_says_what_is_out_of_reach(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["ik", "doosan_a0912", "--frame", FRAME, "--pose=-9,0,0"])

    error = capsys.readouterr().err
    assert code == 2
    assert error.startswith(f"arm-drake: no joint positions put '{FRAME}' there; ")
    assert "; it is out of reach: " in error


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--pose", "1,2"],
            "--pose 1,2: expected X,Y,Z [m] or X,Y,Z,R,P,Y [m, rad] with commas",
        ),
        (
            ["--pose", "0,0,1", "--seed", "j=one"],
            "--seed j=one: expected a number [rad or m]",
        ),
        (
            ["--pose", "0,0,1", "--pointing", "x"],
            "--pointing: expected --pose X,Y,Z,R,P,Y",
        ),
    ],
)
def test_ik_refuses_words(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ik", "doosan_a0912", "--frame", FRAME, *words]) == 2

    assert capsys.readouterr().err == f"arm-drake: {message}\n"
