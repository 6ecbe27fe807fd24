import gc
import json
import re
import sys
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main, parse_arguments
from arm_drake.commands.arguments import loading_words

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


def test_ik_prints_units(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["ik", "doosan_a0912", "--frame", FRAME, "--pose", "0.4,0.2,0.6"])

    lines = capsys.readouterr().out.splitlines()
    assert code == 0
    assert len(lines) == 6
    assert all(re.fullmatch(r"joint\d +-?\d\.\d{6} rad", line) for line in lines)


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
            "--pose 1,2: expected finite numbers X,Y,Z [m] or X,Y,Z,R,P,Y [m, rad] "
            "with commas",
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


# As a plan ends, so the controller's goal does: within 5 mrad.
@pytest.mark.slow
def test_a_plan_is_a_motion_that_sim_plays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = tmp_path / "motion.yaml"
    words = ["--to", "joint1=0.4,joint3=0.5", "--to", "0.4,0.2,0.6"]

    shown = {"--plot": tmp_path / "plan.png", "--record": tmp_path / "plan.html"}
    words += [str(word) for pair in shown.items() for word in pair]

    assert main(["plan", "doosan_a0912", *words, "-o", str(motion), "--json"]) == 0
    assert all(path.is_file() for path in shown.values())
    content = json.loads(capsys.readouterr().out)
    log = tmp_path / "log.npz"
    played = ["--motion", str(motion), "--headless", "--log", str(log)]
    code = main(["sim", "doosan_a0912", *played])

    assert code == 0
    rollout = ad.Rollout.load(log)
    last = dict(zip(rollout.joint_names, rollout.position[-1], strict=True))
    assert last == pytest.approx(content["end"], abs=5e-3)
    X = ad.forward_kinematics(ad.load_robot("doosan_a0912"), last, FRAME)
    assert X.translation() == pytest.approx([0.4, 0.2, 0.6], abs=0.01)


@pytest.mark.slow
def test_plans_in_one_process_keep_no_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "ompl", raising=False)
    words = ["plan", "doosan_a0912", "--to", "joint1=0.1"]
    assert main(words) == 0
    kept = gc.get_freeze_count()

    assert main(words) == 0

    assert kept > 0
    assert gc.get_freeze_count() <= kept


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "hom"], "group 'joint_trajectory_controller' has no state 'hom'; "),
        (["--to", "1,2"], "--to 1,2: expected finite numbers X,Y,Z [m] or X,Y,Z,R,P,Y"),
        (["--to", "nan,0,1"], "--to nan,0,1: expected finite numbers X,Y,Z [m] or "),
        (["--to", "home", "--upright", "link6=x"], "--upright link6=x: expected an an"),
        (["--to", "home", "--upright", "lnk=1"], "path_constraint: no link 'lnk'; "),
        (["--to", "joint1=x"], "--to joint1=x: expected a number [rad or m]"),
        (
            ["--to", "joint1=0.3,joint1=0.4"],
            "--to joint1=0.4: joint 'joint1' is named twice",
        ),
        (
            ["--to", "home", "-o", "motion.txt"],
            "motion.txt: unknown type '.txt' of a motion; ",
        ),
        (["--to", "home", "--plot", "p.txt"], "p.txt: unknown type '.txt' of a pictu"),
        (["--to", "home", "--record", "p.t"], "p.t: unknown type '.t' of a recording"),
        (["--to", "home", "--seed=-1"], "seed: expected an integer of at least 0"),
    ],
)
def test_plan_refuses_words(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "doosan_a0912", *words]) == 2

    assert capsys.readouterr().err.startswith(f"arm-drake: {message}")


@pytest.mark.slow
def test_a_plan_for_joints_without_a_controller_is_no_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--to", "home", "--group", "arm", "-o", str(tmp_path / "motion.yaml")]

    assert main(["plan", "mycobot_280", *words]) == 2

    error = capsys.readouterr().err
    assert error.startswith(
        "arm-drake: no trajectory controller has exactly the joints of group 'arm', "
    )


def test_what_plays_a_plan_loads_the_robot_as_the_plan_did() -> None:
    words = ["robot.xacro", "side:=left", "tool:=a=b", "--controllers", "some.yaml"]
    words += ["--controllers", "other file.yaml", "--var", "a=b=c", "--var", "d="]
    words += ["--add-frame", "tip=link6,-1,0,0.1", "--package-path=-folder"]
    words += ["--srdf", "a.srdf", "--distro", "humble", "--name", "arm", "--decompose"]
    words += ["--namespace", "left"]
    planned = parse_arguments(["plan", *words, "--to", "home"])

    played = parse_arguments(["sim", *loading_words(planned)])

    alike = ("robot", "xacro_args", "controllers", "package_path", "var", "decompose")
    for name in (*alike, "add_frame", "srdf", "distro", "name", "namespace"):
        assert getattr(played, name) == getattr(planned, name)
    assert played.package_path == ["-folder"]
    assert played.add_frame == [("tip", "link6,-1,0,0.1")]


@pytest.mark.slow
def test_a_controller_of_positions_plays_a_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion, log = str(tmp_path / "motion.yaml"), tmp_path / "log.npz"

    assert main(["plan", "centauri", "--to", "joint1=0.3", "-o", motion]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    played = ["--motion", motion, "--headless", "--log", str(log)]
    assert main(["sim", "centauri", *played]) == 0

    assert last == f"play it: arm-drake sim centauri --motion {motion}"
    rollout = ad.Rollout.load(log)
    at = list(rollout.joint_names).index("joint1")
    assert rollout.position[-1, at] == pytest.approx(0.3, abs=0.01)
