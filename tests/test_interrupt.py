"""Ctrl-C ends `arm-drake view` and `sim` in any state, with the data so far."""

import contextlib
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
import pytest

from tests.visualization.page.clients import Panel
from tests.waiting import PATIENCE, wait_until

# The longest that an end may take [s]; the goal of 1 s is for a benchmark to measure,
# this is for a machine that has other things to do.
LONGEST_END = 10.0


class State(NamedTuple):
    """What a process is doing when it is interrupted."""

    # Words of the command line; FOLDER stands for a folder of the test.
    words: tuple[str, ...]

    # What it has printed when it is in the state, on any of its outputs: a regular
    # expression.
    until: str

    # Whether it is in the state only when it has done, too, what is clicked on its
    # page then.
    answers: bool = False

    # Its exit codes. Where there is nothing to finish, that of a shell, or the signal,
    # by which Python ends if it met the interrupt in a module of C++.
    codes: tuple[int, ...] = (0,)

    # Files that it writes in the end.
    files: tuple[str, ...] = ()

    # Options of Python.
    flags: tuple[str, ...] = ()


SIM = ("sim", "doosan_a0912")
LOG = ("--log", "FOLDER/run.npz")
TUTORIAL = ("--motion", "tutorial")
PLAN = ("plan", "doosan_a0912", "--to", "joint1=1")

# The command, with a search that finds no way, and tells when it looks for one.
SEARCHING = """
import sys
from arm_drake.cli import main
from arm_drake.planning.collisions import CollisionModel

def is_inside_free(*line):
    print("searching", flush=True)
    return False

CollisionModel.is_inside_free = is_inside_free
sys.exit(main(sys.argv[1:]))
"""

# Python tells of each module that it has imported.
LOADING: Any = {"codes": (130, -signal.SIGINT), "flags": ("-X", "importtime")}

# The simulated time is told on a terminal when the first cycles are done, and then on.
RUNNING = r"(?m)^ +\d+\.\d\d s  "
AFTER_A_SECOND = r"(?m)^ +[1-9]\d*\.\d\d s  "

STATES = {
    "sim, importing": State((*SIM, *LOG), " numpy.version", **LOADING),
    "sim, loading": State((*SIM, *LOG), " arm_drake.loading", **LOADING),
    "sim, playing": State((*SIM, *LOG), AFTER_A_SECOND, files=("run.npz",)),
    "sim, paused": State((*SIM, "--paused", *LOG), RUNNING, answers=True),
    "sim, rate 0": State((*SIM, "--rate", "0"), AFTER_A_SECOND),
    "sim, slow": State((*SIM, "--rate", "0.01"), RUNNING, answers=True),
    "sim, motion": State(
        (*SIM, *TUTORIAL, *LOG, "--record", "FOLDER/run.html"),
        # It is on its way to the goal.
        AFTER_A_SECOND + r"\S+: tracking error",
        files=("run.npz", "run.html"),
    ),
    "sim, holding": State(
        (*SIM, "--duration", "0.2", "--rate", "0", "--hold", *LOG),
        "the page stays",
        answers=True,
        files=("run.npz",),
    ),
    "sim, headless": State(
        (*SIM, "--headless", "--duration", "1000", *LOG),
        AFTER_A_SECOND,
        files=("run.npz",),
    ),
    "view, importing": State(("view", "doosan_a0912"), " numpy.version", **LOADING),
    "view, loading": State(("view", "doosan_a0912"), " arm_drake.loading", **LOADING),
    "plan, importing": State(PLAN, " numpy.version", **LOADING),
    "plan, loading": State(PLAN, " arm_drake.loading", **LOADING),
    "view": State(("view", "doosan_a0912"), "until Ctrl-C", answers=True),
}


class Ended(NamedTuple):
    """How a process has ended."""

    # From Ctrl-C on [s].
    took: float

    code: int
    output: str


def interrupt(name: str, folder: Path) -> Ended:
    """Start a process, bring it into a state, and press Ctrl-C."""
    state = STATES[name]
    words = [word.replace("FOLDER", str(folder)) for word in state.words]
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, *state.flags, "-m", "arm_drake", *words],
        stdin=subprocess.DEVNULL,  # Nobody is there to open the page.
        stdout=theirs,
        stderr=theirs,
    )
    os.close(theirs)
    output = bytearray()
    reader = threading.Thread(target=_read, args=(ours, output))
    reader.start()

    def read() -> str:
        text = output.decode(errors="replace")
        return text.replace("\r\033[K", "\n").replace("\r\n", "\n")

    with contextlib.ExitStack() as stack:
        stack.callback(process.kill)

        def is_there() -> bool:
            assert process.poll() is None, "it has ended by itself"
            return bool(re.search(state.until, read()))

        wait_until(is_there, name)
        if state.answers:
            click(read())
        process.send_signal(signal.SIGINT)
        start = time.perf_counter()
        code = process.wait(PATIENCE)
        took = time.perf_counter() - start
    reader.join(PATIENCE)
    return Ended(took, code, read())


def _read(terminal: int, output: bytearray) -> None:
    """Read what a process writes to its terminal, to the end."""
    # Linux tells the end as an error.
    with os.fdopen(terminal, "rb", buffering=0) as stream, contextlib.suppress(OSError):
        while data := stream.read(10_000):
            output += data


def click(output: str) -> None:
    """Click what is nothing on the page that a process has told, until it answers."""
    address = re.search(r"http://localhost:(\d+)/", output)
    assert address is not None, output
    with Panel(int(address[1])) as panel:
        panel.say("nothing")
        panel.hear_until(lambda message: message["type"] == "message")


@pytest.mark.slow
def test_on_a_terminal_a_motion_waits_for_a_browser_and_the_page_stays() -> None:
    words = [*SIM, *TUTORIAL, "--duration", "0.3", "--no-open"]
    ours, theirs = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k not in ("CI", "DISPLAY")}
    process = subprocess.Popen(
        [sys.executable, "-m", "arm_drake", *words],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment,
    )
    os.close(theirs)
    said = []

    def until(text: str) -> str:
        while text not in "".join(said):
            said.append(os.read(ours, 1000).decode())
        return "".join(said)

    with contextlib.ExitStack() as stack:
        stack.callback(os.close, ours)
        stack.callback(process.kill)
        address = re.search(r"http://localhost:(\d+)/", until("waiting for a browser"))
        assert address is not None
        assert "goal" not in "".join(said)
        with Panel(int(address[1])) as panel:
            until("the page stays")
            panel.say("end")
            code = process.wait(PATIENCE)

    assert code == 0
    assert "simulated 0.30 s" in "".join(said)


@pytest.mark.slow
@pytest.mark.parametrize("name", STATES)
def test_ctrl_c_ends_it_and_what_was_asked_for_is_there(
    name: str, tmp_path: Path
) -> None:
    state = STATES[name]

    ended = interrupt(name, tmp_path)

    assert "Traceback" not in ended.output
    assert ended.code in state.codes, ended.output[-2000:]
    assert ended.took < LONGEST_END
    assert {path.name for path in tmp_path.iterdir()} >= set(state.files)
    if "run.npz" in state.files:
        with np.load(tmp_path / "run.npz") as rollout:
            # All that was simulated, up to the end that is told.
            steps = np.diff(rollout["time"])
            assert len(steps) >= 10
            np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
            assert rollout["position"].shape == (len(steps) + 1, 6)
            reported = next(
                float(line.split()[1])
                for line in ended.output.splitlines()
                if line.startswith("simulated ")
            )
            # Half a unit of the last digit, and one tick.
            assert abs(rollout["time"][-1] - reported) <= 0.005 + steps[0]
    if "run.html" in state.files:
        page = (tmp_path / "run.html").read_text(encoding="utf-8")
        assert page.startswith("<!DOCTYPE html>")
        assert page.rstrip().endswith("</html>")


@pytest.mark.slow
def test_a_second_ctrl_c_does_not_wait_for_files(tmp_path: Path) -> None:
    # A recording of a robot with meshes takes its time; twice Ctrl-C gives it up.
    words = [*SIM, *TUTORIAL, "--record", str(tmp_path / "run.html")]
    with subprocess.Popen(
        [sys.executable, "-m", "arm_drake", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        assert any("goal accepted" in line for line in lines)
        process.send_signal(signal.SIGINT)
        assert any("stopped at" in line for line in lines)
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        code = process.wait(PATIENCE)

    # It may have been done already, or be ending, when Python listens no more.
    assert code in (0, 130, -signal.SIGINT)
    assert "Traceback" not in rest


@pytest.mark.slow
def test_ctrl_c_ends_a_plan_in_half_a_second() -> None:
    pytest.importorskip("ompl")
    words = [*PLAN, "--time-limit", "100"]
    with subprocess.Popen(
        [sys.executable, "-c", SEARCHING, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert any("searching" in line for line in iter(process.stdout.readline, ""))
        before = sum(psutil.Process(process.pid).cpu_times()[:2])
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)

    assert os.waitstatus_to_exitcode(status) == 130
    assert rest.endswith("arm-drake: interrupted\n")
    # Of the processor, as others may want it, too.
    assert used.ru_utime + used.ru_stime - before < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    # The second one comes while numpy is imported.
    ("number", "after"),
    [(signal.SIGINT, 0.2), (signal.SIGTERM, 0.05)],
)
def test_what_ends_a_command_ends_xacro_too(
    tmp_path: Path, number: int, after: float
) -> None:
    # It would take longer than it may; the signal is for the command alone.
    endless = "len([n for n in range(10**12) if n &lt; 0])"
    robot = tmp_path / "arm.xacro"
    robot.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">'
        f'<link name="${{{endless}}}"/></robot>'
    )
    command = [sys.executable, "-m", "arm_drake", "check", str(robot)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        parent = psutil.Process(process.pid)
        wait_until(lambda: any(c.cpu_times().user > after for c in parent.children()))
        (child,) = parent.children()
        process.send_signal(number)
        _, error = process.communicate(timeout=PATIENCE)

    assert (process.returncode, error) == (130, "arm-drake: interrupted\n")
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE
