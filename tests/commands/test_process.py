"""Errors of the machine as one message; SIGTERM as Ctrl-C."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main
from tests import models
from tests.waiting import wait_until


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("robot") / "robot.urdf"
    path.write_text(models.TWO_LINKS)
    return str(path)


def run(
    words: list[str], environment: dict[str, str] | None = None
) -> tuple[int, list[str]]:
    """Run a command whose output finds no room; return its code and its errors."""
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "arm_drake", *words],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
            check=False,
        )
    return ended.returncode, ended.stderr.splitlines()


ON_FULL_DISK = "arm-drake: standard output: No space left on device"

needs_full_disk = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="not every system has it"
)


@pytest.mark.slow
@needs_full_disk
@pytest.mark.parametrize(
    "words",
    [
        ["list"],
        ["list", "--json"],
        ["check", "ROBOT"],
        ["check", "ROBOT", "--json"],
        ["sim", "ROBOT", "--headless", "--duration", "0.1"],
        ["sim", "ROBOT", "--headless", "--duration", "0.1", "--json"],
        ["cache"],
    ],
    ids=" ".join,
)
def test_a_full_disk_behind_the_output_is_said(
    words: list[str],
    robot: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Path("/dev/full").open("w") as full:
        monkeypatch.setattr(sys, "stdout", full)

        code = main([robot if word == "ROBOT" else word for word in words])
        # What is left is written at a program's end.
        full.flush()

    assert code == 2
    errors = capsys.readouterr().err
    assert errors.splitlines()[-1] == ON_FULL_DISK
    assert "Traceback" not in errors


@pytest.mark.slow
@needs_full_disk
@pytest.mark.parametrize(
    "words", [["list"], ["sim", "ROBOT", "--duration", "0.1"]], ids=" ".join
)
def test_so_it_is_where_a_program_ends(words: list[str], robot: str) -> None:
    code, errors = run([robot if word == "ROBOT" else word for word in words])

    assert code == 2
    assert errors[-1] == ON_FULL_DISK
    assert "Traceback" not in "\n".join(errors)


@pytest.mark.slow
def test_ascii_alone_is_said(robot: str) -> None:
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}

    code, errors = run(["check", robot], ascii_only)

    text = "Drake can't be used with ASCII; set PYTHONUTF8=1, or LC_ALL=C.UTF-8"
    assert (code, errors) == (2, [f"arm-drake: {text}"])


def test_a_directory_that_is_gone_is_said(
    tmp_path: Path, robot: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = Path.cwd()
    (tmp_path / "gone").mkdir()
    os.chdir(tmp_path / "gone")
    try:
        (tmp_path / "gone").rmdir()
        code = main(["check", robot])
    finally:
        os.chdir(before)

    assert code == 2
    assert capsys.readouterr().err == (
        "arm-drake: the working directory is not there any more; change to another\n"
    )


def test_too_few_files_are_said(
    robot: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda what: (12, 12))

    code = main(["check", robot])

    assert code == 2
    assert capsys.readouterr().err == (
        "arm-drake: no more than 12 files may be open; expected 64 at least: "
        "ulimit -n 64\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "suffix"), [([], "mcap"), (["--headless", "--rate", "1"], "npz")]
)
def test_sigterm_is_ctrl_c(
    words: list[str], suffix: str, robot: str, tmp_path: Path
) -> None:
    log = tmp_path / f"log.{suffix}"
    command = ["sim", robot, *words, "--duration", "1000", "--log", str(log)]
    # Times are told on a terminal.
    terminal, its_end = os.openpty()
    os.set_blocking(terminal, False)
    told = bytearray()

    def is_told() -> bool:
        with contextlib.suppress(BlockingIOError):
            told.extend(os.read(terminal, 10_000))
        return b" 1." in told

    with subprocess.Popen(
        [sys.executable, "-m", "arm_drake", *command],
        stdout=subprocess.PIPE,
        stderr=its_end,
        text=True,
    ) as process:
        os.close(its_end)
        wait_until(is_told)
        process.terminate()
        output, _ = process.communicate()
    os.close(terminal)

    assert process.returncode == 0
    assert "stopped at 1." in output
    assert ad.Rollout.load(log).time[-1] > 0.9


@pytest.mark.slow
def test_numbers_beyond_all_bounds_are_no_warnings_of_numpy(
    robot: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    yaml, motion = tmp_path / "controllers.yaml", tmp_path / "motion.yaml"
    yaml.write_text(
        "controller_manager: {ros__parameters: {update_rate: 100, pid: {type: "
        "pid_controller/PidController}}}\npid: {ros__parameters: {dof_names: [elbow], "
        "command_interface: position, reference_and_state_interfaces: [position], "
        "gains: {elbow: {p: 1.0e+308, i: 1.0e+308}}}}\n"
    )
    motion.write_text(
        "- {topic: /pid/reference, data: {dof_names: [elbow], values: [1.0e+308]}}\n"
    )
    words = ["--controllers", str(yaml), "--motion", str(motion), "--duration", "0.1"]

    # As Python does where nobody makes errors of warnings.
    with warnings.catch_warnings(record=True, action="always") as found:
        code = main(["sim", robot, "--headless", *words])

    assert [str(one.message) for one in found] == []
    assert code in (0, 1), capfd.readouterr().err


@pytest.mark.slow
def test_sigterm_is_what_it_was_afterwards(robot: str) -> None:
    before = signal.getsignal(signal.SIGTERM)

    main(["check", robot])

    assert signal.getsignal(signal.SIGTERM) is before
