"""Order, errors, deaths and progress of many runs, wherever they are executed."""

import io
import multiprocessing
import os
import re
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from pickle import UnpicklingError

import numpy as np
import psutil
import pytest

import arm_drake as ad
from arm_drake.batch import api
from arm_drake.batch.processes import Pool, close_server
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.errors import InputError
from tests.batch import functions
from tests.waiting import wait_until

BACKENDS = ("serial", "threads", "processes", "auto")


@pytest.fixture(scope="module", autouse=True)
def no_server_stays() -> Iterator[None]:
    yield
    close_server()


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("backend", BACKENDS)
def test_results_come_in_the_order_of_the_inputs(backend, workers) -> None:
    inputs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]

    results = ad.run_many(
        inputs, functions.wait_and_square, backend=backend, workers=workers
    )

    assert results.values == [0.0, 1.0, 4.0, 9.0, 16.0, 25.0]
    assert [result.index for result in results] == [0, 1, 2, 3, 4, 5]
    assert [result.input for result in results] == inputs


def test_the_number_of_workers_may_be_of_numpy() -> None:
    results = ad.run_many([1, 2], abs, backend="threads", workers=np.int64(2))

    assert results.workers == 2


@pytest.mark.parametrize("runs", [None, ad.Run(robot="lab5_arm")])
def test_what_is_no_list_is_refused(runs) -> None:
    expected = f"^runs: expected a list of what to run, got one {type(runs).__name__}$"
    with pytest.raises(InputError, match=expected):
        ad.run_many(runs)


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_runs_have_no_results(backend) -> None:
    assert ad.run_many([], functions.square, backend=backend).values == []


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_an_error_is_in_the_place_of_its_value(backend) -> None:
    results = ad.run_many(range(5), functions.fail_at_three, backend=backend, workers=2)

    (failed,) = results.failed
    assert (failed.index, failed.input) == (3, 3)
    assert isinstance(failed.error, ValueError)
    assert str(failed.error) == "three is too many"
    # It says where, and holds nothing of that place.
    (note,) = failed.error.__notes__
    assert "in fail_at_three" in note
    assert failed.error.__traceback__ is None
    assert [r.value for r in results if r.error is None] == [0, 1, 2, 4]
    with pytest.raises(ValueError, match="three is too many"):
        _ = results.values


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_first_error_is_raised_if_asked_for(backend) -> None:
    with pytest.raises(ValueError, match="three is too many") as caught:
        ad.run_many(
            range(5),
            functions.fail_at_three,
            backend=backend,
            workers=2,
            raise_errors=True,
        )

    assert "in run 3" in caught.value.__notes__


def test_what_ends_a_process_is_said_of_its_run() -> None:
    ends = [
        "segfault",
        "kill",
        "exit",
        "sys.exit",
        "interrupt",
        "own error",
        "no text",
        "no pickle",
    ]

    results = ad.run_many(
        ["well", *ends, "unreadable", "well"],
        functions.end_at,
        backend="processes",
        workers=2,
    )

    assert [result.value for result in (results[0], results[-1])] == ["well"] * 2
    assert [str(result.error).partition(";")[0] for result in results.failed] == [
        "the process of this run died of SIGSEGV (Segmentation fault)",
        "the process of this run was killed (SIGKILL), as the system does when memory "
        "runs out",
        "the process of this run ended by itself, with exit code 7",
        "the run raised SystemExit(3)",
        "the run raised KeyboardInterrupt()",
        "TwoArgumentsError: one and two",
        "NoTextError: it can't say what",
        "the value of the run can't be sent to other processes: cannot pickle "
        "'generator' object",
        "the value of the run can't be read: ValueError: invalid literal for int() "
        "with base 10: 'no number'",
    ]
    assert all(isinstance(result.error, ad.ArmDrakeError) for result in results.failed)
    assert str(results).splitlines()[1] == (
        "run 1: RunError: the process of this run died of SIGSEGV (Segmentation fault)"
    )


def test_an_iterator_yields_in_order_and_may_be_left() -> None:
    results = ad.iterate_many(
        range(1000), functions.wait_and_square, backend="processes", workers=2
    )
    server = psutil.Process().children()[-1]

    for result in results:
        assert result.value == result.index**2
        if result.index == 5:
            break
    results.close()

    _, alive = psutil.wait_procs(server.children(), timeout=10.0)
    assert not alive


@pytest.mark.slow
def test_a_server_that_dies_takes_its_workers_and_what_they_do(tmp_path) -> None:
    inputs = ["", str(tmp_path), ""]
    results = ad.iterate_many(
        inputs, functions.note_and_sleep, backend="processes", workers=1
    )
    assert next(results).error is None
    server = psutil.Process().children()[-1]
    (worker,) = server.children()
    wait_for_note(tmp_path)

    server.kill()
    failed, last = results

    assert "SIGKILL" in str(failed.error) or "is gone" in str(failed.error)
    assert last.error is None
    if sys.platform == "linux":
        assert not psutil.wait_procs([worker], timeout=10.0)[1]


@pytest.mark.slow
def test_what_a_run_has_started_ends_with_it(tmp_path) -> None:
    results = ad.iterate_many(
        ["", str(tmp_path)], functions.start_sleep, backend="processes", workers=1
    )
    next(results)
    wait_for_note(tmp_path)
    (note,) = tmp_path.iterdir()
    started = psutil.Process(int(note.name))

    results.close()

    _, alive = psutil.wait_procs([started], timeout=10.0)
    assert not alive


@pytest.mark.slow
def test_a_fork_of_the_program_keeps_no_worker_alive(tmp_path) -> None:
    results = ad.iterate_many(
        ["", str(tmp_path)], functions.note_and_sleep, backend="processes", workers=1
    )
    next(results)
    server = psutil.Process().children()[-1]
    (worker,) = server.children()
    wait_for_note(tmp_path)
    fork = multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,))
    fork.start()

    results.close()
    _, alive = psutil.wait_procs([worker], timeout=10.0)
    close_server()
    fork.kill()
    fork.join()

    assert not alive
    assert not server.is_running()


@pytest.mark.slow
def test_a_worker_that_dies_while_it_answers_is_noticed(tmp_path) -> None:
    results = ad.run_many(
        ["", str(tmp_path), ""], functions.die_answering, backend="processes", workers=1
    )

    (note,) = tmp_path.iterdir()
    child = psutil.Process(int(note.name))
    assert child.is_running()
    child.kill()
    assert [result.index for result in results.failed] == [1]
    assert "was killed (SIGKILL)" in str(results[1].error)


def wait_for_note(folder: Path) -> None:
    wait_until(lambda: any(folder.iterdir()), "a note")


@pytest.mark.slow
def test_a_worker_that_grows_is_replaced() -> None:
    # 256 MB are the limit of what a worker may gain.
    sizes = [100, 100, 100, 1, 1]

    results = ad.run_many(sizes, functions.leave_behind, backend="processes", workers=1)

    first, second, third, fourth, fifth = results.values
    assert first == second == third
    assert fourth == fifth != first


@pytest.mark.slow
def test_nested_calls_take_no_more_cores() -> None:
    for backend in ("threads", "processes"):
        results = ad.run_many([1, 2], functions.run_nested, backend=backend, workers=2)

        assert results.values == [("serial", [1, 4]), ("serial", [4, 9])]


@pytest.mark.slow
def test_nested_processes_may_be_asked_for() -> None:
    results = ad.run_many(
        [1], functions.run_processes_in_a_process, backend="processes"
    )

    assert results.values == [[1, 4]]


def test_workers_see_what_the_program_sees(tmp_path, monkeypatch) -> None:
    # The server may be older than this.
    ad.run_many([0], functions.square, backend="processes")
    monkeypatch.setenv("ARM_DRAKE_TEST", "here")
    monkeypatch.chdir(tmp_path)

    results = ad.run_many(
        ["ARM_DRAKE_TEST"], functions.see_surroundings, backend="processes"
    )

    assert results.values == [("here", str(tmp_path))]


def test_workers_know_registered_controller_types(monkeypatch) -> None:
    name = "mine/Forward"
    row = CONTROLLER_TYPES["forward_command_controller/ForwardCommandController"]
    monkeypatch.setitem(CONTROLLER_TYPES, name, row)

    results = ad.run_many([name, "no/Type"], functions.knows_type, backend="processes")

    assert results.values == [True, False]


def test_workers_have_random_numbers_of_their_own() -> None:
    numbers = {
        value
        for _ in range(3)
        for value in ad.run_many(
            [0, 1], functions.random_number, backend="processes", workers=2
        ).values
    }

    # Forks alone would share their numbers.
    assert len(numbers) == 6


@pytest.mark.slow
def test_a_server_that_died_is_replaced() -> None:
    ad.run_many([0], functions.square, backend="processes")
    server = psutil.Process().children()[-1]
    server.kill()
    server.wait()

    results = ad.run_many([1, 2], functions.square, backend="processes")

    assert results.values == [1, 4]


@pytest.fixture
def quick_start(monkeypatch) -> None:
    """Let each run that has ended pay for processes."""
    monkeypatch.setattr(api, "COLD_START", 1e-9)
    monkeypatch.setattr(api, "WARM_START", 1e-9)
    monkeypatch.setattr(api._Starter, "_watch_long_runs", lambda self: None)


def test_short_runs_stay_here(monkeypatch) -> None:
    monkeypatch.setattr(api, "COLD_START", 1e9)
    monkeypatch.setattr(api, "WARM_START", 1e9)

    results = ad.run_many(range(4), functions.process_id, workers=2)

    assert set(results.values) == {os.getpid()}
    assert (results.backend, results.workers) == ("serial", 1)
    assert re.fullmatch(
        r"a run took \S+ s, 1 were left: starting processes takes longer than they "
        r"gain",
        results.why,
    )


def test_it_is_said_if_no_run_tells_how_long_they_take() -> None:
    results = ad.run_many([3, 3], functions.fail_at_three, workers=2)

    assert results.why == "no run has told what runs take"


def test_long_runs_go_to_processes(quick_start) -> None:
    results = ad.run_many(range(9), functions.process_id, workers=2)

    here, *there = results.values
    assert here == os.getpid()
    assert os.getpid() not in there
    assert (results.backend, results.workers) == ("processes", 2)
    assert re.fullmatch(r"a run took \S+ s, 8 were left", results.why)


def test_processes_start_while_a_long_run_goes_on_here(tmp_path) -> None:
    # Each of both waits for the other one.
    results = ad.run_many([str(tmp_path)] * 2, functions.meet, workers=2)

    here, there = results.values
    assert here == os.getpid() != there
    assert (results.backend, results.workers) == ("processes", 1)
    assert re.fullmatch(r"a run took longer than \S+ s, 1 were left", results.why)


def test_runs_that_fail_do_not_tell_how_long_runs_take(quick_start) -> None:
    results = ad.run_many([3, 3, 1, 1, 1, 1], functions.fail_at_three, workers=2)

    assert re.fullmatch(r"a run took \S+ s, 3 were left", results.why)


@pytest.fixture
def unknown_function(monkeypatch) -> Callable[[int], int]:
    """Return a function of a module that other processes can't import."""
    module = types.ModuleType("made_here")
    exec("def negate(x): return -x", module.__dict__)  # noqa: S102  Ours.
    monkeypatch.setitem(sys.modules, "made_here", module)
    return module.negate


def test_runs_whose_workers_cannot_begin_have_that_error(unknown_function) -> None:
    results = ad.run_many([1, 2, 3], unknown_function, backend="processes", workers=2)

    assert [str(r.error) for r in results] == ["No module named 'made_here'"] * 3


def test_runs_go_on_here_if_workers_cannot_begin(quick_start, unknown_function) -> None:
    results = ad.run_many([1, 2, 3, 4], unknown_function, workers=2)

    assert results.values == [-1, -2, -3, -4]
    assert (results.backend, results.workers) == ("serial", 1)
    assert results.why.endswith("; 3 ran here, for No module named 'made_here'")


def test_runs_go_on_here_if_their_function_cannot_be_sent(quick_start) -> None:
    lock = threading.Lock()

    results = ad.run_many([1, 2, 3], lambda x: (lock, -x)[1], workers=2)

    assert results.values == [-1, -2, -3]
    assert ", but the function can't be sent to other processes: " in results.why


def test_results_stay_if_a_later_worker_cannot_begin(monkeypatch) -> None:
    start, numbers = Pool.start, []

    def fail_the_second_time(pool: Pool, number: int) -> None:
        numbers.append(number)
        if len(numbers) > 1:
            pool._beginning = (b"no pickle", b"", b"")
        start(pool, number)

    monkeypatch.setattr(Pool, "start", fail_the_second_time)

    results = ad.run_many(
        ["a", "exit", "b", "c"], functions.end_at, backend="processes", workers=1
    )

    assert results[0].value == "a"
    assert "exit code 7" in str(results[1].error)
    assert {type(result.error) for result in results[2:]} == {UnpicklingError}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"backend": "thread"},
            "unknown backend 'thread'; did you mean 'threads'? known: auto, "
            "processes, serial, threads",
        ),
        ({"workers": 0}, "workers must be a number of at least 1, got 0"),
        ({"workers": True}, "workers must be a number of at least 1, got True"),
        ({"function": 3}, "function: expected a function, got 3"),
        (
            {"function": functions.square, "keep": functions.final_position},
            "keep is for Runs; a function returns what is to be kept itself",
        ),
        (
            {},
            "runs[0]: expected a Run, got int; or give function=, which runs such an "
            "input",
        ),
    ],
)
def test_an_argument_that_cannot_be_used_is_said_at_once(arguments, message) -> None:
    for call in (ad.run_many, ad.iterate_many):
        with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
            call([1], **arguments)


@pytest.mark.parametrize("shown", [None, True])
def test_closed_streams_hinder_nothing(monkeypatch, shown) -> None:
    closed = io.StringIO()
    closed.close()
    for stream in (None, closed):
        monkeypatch.setattr("sys.stderr", stream)

        results = ad.run_many(
            [1, 2], functions.close_output, backend="processes", progress=shown
        )

        assert results.values == [1, 2]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("stream", "shown", "expected"),
    [
        (io.StringIO, None, ""),
        (io.StringIO, True, "5/5 runs, 0:00, 1 failed\n"),
        (Terminal, False, ""),
    ],
)
def test_progress_is_told_where_it_is_asked_for(
    monkeypatch, stream, shown, expected
) -> None:
    said = stream()
    monkeypatch.setattr("sys.stderr", said)

    ad.run_many(range(5), functions.fail_at_three, backend="serial", progress=shown)

    assert said.getvalue() == expected


def test_progress_stays_on_one_line_of_a_terminal(monkeypatch) -> None:
    said = Terminal()
    monkeypatch.setattr("sys.stderr", said)

    ad.run_many(range(5), functions.fail_at_three, backend="serial")

    first, *_, last = said.getvalue().split("\r")[1:]
    assert first == "[....................] 0/5 runs, 0:00"
    assert last == "[####################] 5/5 runs, 0:00, 1 failed\n"


@pytest.mark.slow
def test_auto_runs_here_what_cannot_be_sent() -> None:
    results = ad.run_many(range(6), functions.wait_for_a_generator, workers=2)

    assert not results.failed
    assert [next(result.value) for result in results] == list(range(6))
    assert "ran here, for they can't be sent" in results.why


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("controllers", 4, "a YAML file, or several"),
        ("package_paths", 3, "a list of folders"),
    ],
)
def test_what_a_run_loads_must_be_files(name, value, expected) -> None:
    with pytest.raises(InputError, match=f"{name}: expected {expected}, got {value}"):
        ad.Run(robot="lab5_arm", **{name: value})
