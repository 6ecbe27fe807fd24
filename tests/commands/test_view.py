"""`arm-drake view` without a browser: positions, messages, the page."""

import json
import signal
import subprocess
import sys
import urllib.request

import pytest

from arm_drake.cli import main
from arm_drake.commands.view import read_positions
from arm_drake.errors import InputError
from tests.models import GRIPPER, PARTLY_COMMANDED, load


@pytest.fixture
def run(capsys):
    """Run the command; return its exit code, standard output and standard error."""

    def run_command(*arguments) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(["view", *map(str, arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run_command


def test_values_are_for_the_joints_in_the_order_of_the_description(tmp_path):
    description = load(tmp_path, PARTLY_COMMANDED).description

    positions = read_positions(["0.1", "-0.2", "3e-1"], description)

    assert positions == {"first": 0.1, "second": -0.2, "third": 0.3}


def test_a_joint_that_follows_takes_no_value(tmp_path):
    description = load(tmp_path, GRIPPER).description

    assert read_positions(["0.1"], description) == {"finger": 0.1}


def test_joints_may_be_named(tmp_path):
    description = load(tmp_path, PARTLY_COMMANDED).description

    positions = read_positions(["third=1", "first=-2"], description)

    assert positions == {"third": 1.0, "first": -2.0}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["1", "2"],
            "--position: expected JOINT=VALUE, or 1 values, of finger; got 2 values",
        ),
        (["finger=a"], "--position finger=a: expected a number [rad or m]"),
        (["a"], "--position finger=a: expected a number [rad or m]"),
        (
            ["fingr=1"],
            "--position fingr=1: no joint 'fingr'; did you mean 'finger'? known: "
            "finger",
        ),
        (
            ["follower=1"],
            "--position follower=1: 'follower' follows 'finger'; give that one",
        ),
        (
            ["finger=1", "finger=2"],
            "--position finger=2: 'finger' has a value already",
        ),
        (
            ["finger=1", "2"],
            "--position 2: expected JOINT=VALUE, as for the other joints",
        ),
    ],
)
def test_positions_that_cannot_be_are_said(tmp_path, words, message):
    description = load(tmp_path, GRIPPER).description

    with pytest.raises(InputError) as caught:
        read_positions(words, description)

    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("robot.jpg", "unknown type '.jpg' of a screenshot; expected .png"),
        ("missing/robot.png", "can't be written: the folder {folder!r} doesn't exist"),
    ],
)
def test_a_picture_that_cannot_be_written_is_said_at_once(run, tmp_path, name, message):
    file = tmp_path / name

    # The robot isn't loaded for it: there is none.
    code, out, err = run("no_robot", "--screenshot", file)

    message = message.format(folder=str(file.parent))
    assert (code, out, err) == (2, "", f"arm-drake: {file}: {message}\n")


@pytest.mark.parametrize("name", ["no_robot", "scene.yaml"])
def test_a_picture_has_no_page(run, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    scene = "robots: [{robot: doosan_a0912}]"
    (tmp_path / "scene.yaml").write_text(scene, encoding="utf-8")

    code, out, err = run(name, "--screenshot", "robot.png", "--host", "*")

    message = "--host is for the page, and with --screenshot there is none"
    assert (code, out, err) == (2, "", f"arm-drake: {message}\n")


@pytest.mark.slow
def test_without_the_extra_the_message_says_how_to_install_it(
    run, tmp_path, monkeypatch
):
    # An import of it now fails.
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)

    code, out, err = run("doosan_a0912", "--screenshot", tmp_path / "robot.png")

    assert (code, out) == (2, "")
    assert err == (
        "arm-drake: a picture of the page needs `pip install 'arm-drake[browser]'`\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_simulation_does_not_start_without_the_extra_for_its_picture(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    words = ["sim", "doosan_a0912", "--headless", "--screenshot"]

    code = main([*words, str(tmp_path / "robot.png")])

    captured = capsys.readouterr()
    assert (code, captured.out) == (2, "")
    assert captured.err.endswith("`pip install 'arm-drake[browser]'`\n")


@pytest.mark.slow
def test_without_chromium_the_message_says_where_it_is_to_be_had(
    run, tmp_path, monkeypatch
):
    monkeypatch.setattr("arm_drake.visualization.screenshot._NAMES", ())
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path / "none"))

    code, out, err = run("doosan_a0912", "--screenshot", tmp_path / "robot.png")

    assert (code, out) == (2, "")
    assert err == (
        "arm-drake: no Chromium is found, which takes the picture; on Debian and "
        "Ubuntu `apt install chromium`, elsewhere `playwright install chromium`\n"
    )


@pytest.mark.slow
def test_strict_refuses_a_position_outside_of_the_limits(run, tmp_path):
    load(tmp_path, GRIPPER)
    robot = tmp_path / "robot.urdf"

    code, out, err = run(robot, "--position", "4", "--strict")

    assert (code, out) == (2, "")
    assert "initial position 4.0 is outside [-3.0, 3.0]; it starts at 3.0" in err


@pytest.mark.slow
def test_the_page_stays_until_ctrl_c(tmp_path):
    command = [sys.executable, "-m", "arm_drake", "view", "doosan_a0912", "--json"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None

    content = json.loads(process.stdout.readline())
    texts = []
    for url in (content["page"], f"{content['page']}meshcat/"):
        with urllib.request.urlopen(url, timeout=30.0) as page:  # noqa: S310
            texts.append(page.read().decode())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30.0)

    assert content["page"].startswith("http://localhost:")
    assert "panel.js" in texts[0]
    assert "Drake MeshCat" in texts[1]
    assert content["positions"] == {f"joint{i}": 0.0 for i in range(1, 7)}
    assert (process.returncode, out, err) == (0, "", "")
