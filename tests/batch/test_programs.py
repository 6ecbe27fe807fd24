"""run_many in programs of users: Ctrl-C, scripts without a guard, notebooks."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from tests.waiting import PATIENCE, wait_until

# The longest that an end may take: of a second or so, on a machine that has other
# things to do [s]. The functions sleep for a minute.
LONGEST_END = 15.0

SLEEPING = """
import arm_drake as ad
from tests.batch.functions import note_and_sleep
try:
    ad.run_many([{folder!r}] * 4, note_and_sleep, workers=2, backend={backend!r})
except ad.RunsInterrupted as interrupt:
    print(interrupt, interrupt.results)
"""

HALF = """
import time
import arm_drake as ad
from tests.batch.functions import square
from pathlib import Path
def work(x):
    if x > 1:
        (Path({folder!r}) / str(x)).touch()
        time.sleep(60)
    return x * x
if __name__ == "__main__":
    try:
        ad.run_many(range(9), work, workers=2, backend="processes")
    except ad.RunsInterrupted as interrupt:
        print([result.value for result in interrupt.results])
"""

ARMS = """
import arm_drake as ad
from pathlib import Path
def at_start(plant):
    Path({folder!r}, "a").touch(), Path({folder!r}, "b").touch()
runs = [ad.Run(robot="lab5_arm", duration=1e6, world=at_start)] * 4
try:
    ad.run_many(runs, workers=2, backend={backend!r})
except ad.RunsInterrupted as interrupt:
    print(interrupt, interrupt.results)
"""

DEFINED_HERE = """
import arm_drake as ad
class Point:
    def __init__(self, x):
        self.x = x
def mirror(point):
    assert isinstance(point, Point)
    return Point(-point.x)
def nest(point):
    results = ad.run_many([point], mirror, backend="processes")
    return [p.x for p in results.values]
print("once")
points = ad.run_many([Point(1), Point(2)], mirror, **{how}).values
assert all(isinstance(p, Point) for p in points)
print([p.x for p in points])
print(ad.run_many([Point(3), Point(4)], nest, **{how}).values)
"""

FORK_AMONG_RUNS = """
import os
import sys
import time

import arm_drake as ad


def square(number):
    time.sleep(0.1)
    return number**2


results = ad.iterate_many(list(range(6)), square, backend="processes", workers=2)
values = [next(results).value]
child = os.fork()
if not child:
    sys.exit()  # Ends the iterator, too.
os.waitpid(child, 0)
print(values + [result.value for result in results])
"""

FORKS = """
import multiprocessing, operator
import arm_drake as ad
print(ad.run_many([1, 2], lambda x: x * x, backend="processes").values)
pool = multiprocessing.Pool(2)
print(pool.map(operator.abs, [1, -2]), flush=True)
"""

SILENT = """
import os, pathlib
import arm_drake as ad
def square(x):
    os.write(1, b"said"), os.write(2, b"said")
    return x * x
results = ad.run_many([1, 2], square, backend="processes", progress=True)
pathlib.Path({result!r}).write_text(str(results.values))
"""

ODD = """
import os, pathlib, resource, sys, tempfile
import arm_drake as ad
soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (min(2048, hard), hard))
files = [open(os.devnull) for _ in range(1100)]
sys.path.append(pathlib.Path("somewhere"))
with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)
print(ad.run_many([1, 2], lambda x: x * x, backend="processes").values)
"""

RUNS = """
import operator
import arm_drake as ad
print("once")
runs = [ad.Run(robot="lab5_arm", duration=0.1)] * 2
print(ad.run_many(runs, keep=operator.attrgetter("time"), backend="processes").values)
"""


def start(program: str, folder: Path) -> subprocess.Popen[str]:
    """Start a script in a group of processes of its own, as a shell does."""
    script = folder / "study.py"
    script.write_text(program)
    return subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


def run(program: str, stdin: bool, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script, or a program that is typed: no other process can import that."""
    script = folder / "study.py"
    script.write_text(program)
    return subprocess.run(
        [sys.executable, "-" if stdin else str(script)],
        input=program if stdin else None,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["serial", "processes"])
def test_ctrl_c_ends_all_processes_quickly_and_quietly(tmp_path, backend) -> None:
    notes = tmp_path / "notes"
    notes.mkdir()
    program = SLEEPING.format(folder=str(notes), backend=backend)
    process = start(program, tmp_path)
    wait_until(lambda: len(list(notes.iterdir())) == (2 if backend != "serial" else 1))
    family = psutil.Process(process.pid).children(recursive=True)
    assert len(family) == (3 if backend == "processes" else 0)

    # As a terminal does: all processes of the group get it.
    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=LONGEST_END)

    assert said == "0 of 4 runs were finished ()\n"
    assert complained == ""
    assert process.returncode == 0
    _, alive = psutil.wait_procs(family, timeout=LONGEST_END)
    assert not alive


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["serial", "threads"])
def test_ctrl_c_ends_long_rollouts_in_this_process(tmp_path, backend) -> None:
    notes = tmp_path / "notes"
    notes.mkdir()
    process = start(ARMS.format(folder=str(notes), backend=backend), tmp_path)
    wait_until(lambda: len(list(notes.iterdir())) == 2)
    time.sleep(0.3)

    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=LONGEST_END)

    assert said == "0 of 4 runs were finished ()\n"
    assert complained == ""


@pytest.mark.slow
def test_ctrl_c_while_workers_start_is_quiet(tmp_path) -> None:
    program = SLEEPING.format(folder=str(tmp_path), backend="processes")
    process = start(program, tmp_path)
    wait_until(lambda: bool(psutil.Process(process.pid).children()))
    family = psutil.Process(process.pid).children()
    # It is importing, and has no workers.
    time.sleep(0.1)

    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=LONGEST_END)

    assert said == "0 of 4 runs were finished ()\n"
    assert complained == ""
    _, alive = psutil.wait_procs(family, timeout=LONGEST_END)
    assert not alive


@pytest.mark.slow
def test_ctrl_c_leaves_what_was_finished(tmp_path) -> None:
    notes = tmp_path / "notes"
    notes.mkdir()
    process = start(HALF.format(folder=str(notes)), tmp_path)
    wait_until(lambda: len(list(notes.iterdir())) == 2)

    os.killpg(process.pid, signal.SIGINT)
    said, complained = process.communicate(timeout=LONGEST_END)

    assert said == "[0, 1]\n"
    assert complained == ""


@pytest.mark.slow
def test_a_program_that_is_killed_leaves_no_processes(tmp_path) -> None:
    notes = tmp_path / "notes"
    notes.mkdir()
    process = start(SLEEPING.format(folder=str(notes), backend="processes"), tmp_path)
    wait_until(lambda: len(list(notes.iterdir())) == 2)
    family = psutil.Process(process.pid).children(recursive=True)
    assert len(family) == 3

    process.kill()
    process.communicate(timeout=LONGEST_END)

    _, alive = psutil.wait_procs(family, timeout=LONGEST_END)
    assert not alive


@pytest.mark.slow
def test_runs_need_no_guard_and_no_file(tmp_path) -> None:
    for stdin in (False, True):
        done = run(RUNS, stdin, tmp_path)

        assert done.stderr == ""
        assert done.stdout == "once\n[0.1, 0.1]\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "stdin"),
    [
        ({}, False),
        ({"backend": "processes"}, False),
        ({"backend": "processes"}, True),
    ],
)
def test_what_a_program_or_notebook_defines_goes_there_and_back(
    tmp_path, how, stdin
) -> None:
    done = run(DEFINED_HERE.format(how=how), stdin, tmp_path)

    assert done.stderr == ""
    assert done.stdout == "once\n[-1, -2]\n[[-3], [-4]]\n"


@pytest.mark.slow
def test_a_fork_that_ends_leaves_the_runs_of_its_program_alone(tmp_path) -> None:
    done = run(FORK_AMONG_RUNS, False, tmp_path)

    assert (done.stdout, done.stderr) == ("[0, 1, 4, 9, 16, 25]\n", "")


@pytest.mark.slow
def test_a_program_ends_that_has_forks(tmp_path) -> None:
    done = run(FORKS, False, tmp_path)

    assert (done.stdout, done.stderr) == ("[1, 4]\n[1, 2]\n", "")


@pytest.mark.slow
def test_a_program_may_have_closed_all_streams(tmp_path) -> None:
    result = tmp_path / "result"
    script = tmp_path / "study.py"
    script.write_text(SILENT.format(result=str(result)))

    subprocess.run(
        ["sh", "-c", f"{sys.executable} {script} <&- >&- 2>&-"],
        timeout=PATIENCE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=True,
    )

    assert result.read_text() == "[1, 4]"


@pytest.mark.slow
def test_a_program_may_have_many_open_files_and_no_folder(tmp_path) -> None:
    done = run(ODD, False, tmp_path)

    assert (done.stdout, done.stderr) == ("[1, 4]\n", "")
