"""Runs on executors and clusters: bits, deaths, refusals, limits, files of results."""

import concurrent.futures as cf
import os
import re
import signal
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.batch import executors
from arm_drake.batch.processes import NO_LIMITS, close_server, loads
from arm_drake.batch.runs import RunStore
from arm_drake.errors import InputError, OutputError
from tests.batch import functions
from tests.models import TWO_LINKS, load, trajectory_controllers

ARM = trajectory_controllers({"arm": ["shoulder", "elbow"]})


@pytest.fixture(scope="module", autouse=True)
def no_server_stays() -> Iterator[None]:
    yield
    close_server()


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    # Half a second, where it is not used too.
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def die_once(folder: str) -> str:
    """Kill its process the first time; later return the folder."""
    if folder and not (Path(folder) / "died").exists():
        (Path(folder) / "died").touch()
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGKILL)
    return folder


@pytest.mark.slow
def test_a_cluster_computes_the_same_bits(client, tmp_path) -> None:
    robot = load(tmp_path, TWO_LINKS, ARM)
    runs = [
        ad.Run(robot=robot, duration=0.1, initial_positions=None, changes=changes)
        for changes in ({}, {"scale.damping": 3.0}, {"scale.friction": 2.0})
    ]
    serial = ad.run_many(runs, backend="serial")

    on_cluster = ad.run_many(runs, on=client)

    for mine, theirs in zip(serial.values, on_cluster.values, strict=True):
        assert mine.rollout.position.tobytes() == theirs.rollout.position.tobytes()
        assert mine.rollout.effort.tobytes() == theirs.rollout.effort.tobytes()
    assert on_cluster.backend == "executor"
    assert all(result.worker.startswith("tcp://") for result in on_cluster)


@pytest.mark.slow
def test_a_run_whose_worker_died_is_tried_again_and_named(client, tmp_path) -> None:
    results = ad.run_many(["", str(tmp_path), "", ""], die_once, on=client)

    assert results.values == ["", str(tmp_path), "", ""]
    assert results[1].attempts == 2
    (died,) = results[1].died
    assert f"run 1: tried again, for {died} died" in str(results)


@pytest.mark.slow
def test_a_broken_pool_is_made_anew_where_it_can_be(tmp_path) -> None:
    inputs = ["", str(tmp_path), "", ""]

    results = ad.run_many(inputs, die_once, on=lambda: cf.ProcessPoolExecutor(2))

    assert results.values == inputs
    assert results[1].attempts == 2


@pytest.mark.slow
def test_a_pool_that_breaks_for_good_keeps_what_was_done(tmp_path) -> None:
    with cf.ProcessPoolExecutor(1) as pool:
        results = ad.run_many(["", str(tmp_path), ""], die_once, on=pool)

    assert results[0].value == ""
    assert "executor broke" in str(results[1].error) or "submitted" in str(
        results[1].error
    )


def test_results_come_as_they_end_or_in_order() -> None:
    with cf.ThreadPoolExecutor(4) as pool:
        inputs = [0.4, 0.0, 0.1]
        ended = ad.iterate_many(inputs, sleep, on=pool, ordered=False)
        assert [result.index for result in ended] == [1, 2, 0]
        ordered = ad.iterate_many(inputs, sleep, on=pool)
        assert [result.index for result in ordered] == [0, 1, 2]


def sleep(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_errors_of_runs_are_theirs() -> None:
    with cf.ThreadPoolExecutor(2) as pool:
        results = ad.run_many([1, 3, 5], functions.fail_at_three, on=pool)

    assert [result.index for result in results.failed] == [1]
    assert str(results[1].error) == "three is too many"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"on": 3},
            "on: expected a Client of dask.distributed, a concurrent.futures.Executor, "
            "or a function that makes one, got int",
        ),
        ({"on": lambda: 3}, "on: expected it to make an Executor, got int"),
        (
            {"on": lambda: 3, "workers": 2},
            "on: it decides; expected neither workers nor backend",
        ),
        (
            {"time_limit": 0.0},
            "time_limit: expected a number above 0 [s], got 0.0",
        ),
        (
            {"memory_limit": 10, "backend": "serial"},
            "backend 'serial': a run with limits has a process of its own; expected "
            "'processes'",
        ),
    ],
)
def test_what_can_not_be_used_is_reported(options, message) -> None:
    with pytest.raises(InputError) as caught:
        ad.run_many([1], abs, **options)

    assert str(caught.value) == message


def test_a_worker_with_other_versions_refuses() -> None:
    other = {**executors.versions(), "drake": "0.1"}

    answer = executors.execute(other, ["x"], {}, [(0, b"")], NO_LIMITS, "")

    assert isinstance(answer, executors.Refused)
    assert f"it has drake {executors.versions()['drake']}" in answer.why


class OldWorkers(cf.ThreadPoolExecutor):
    """Workers that have another version of Drake."""

    def submit(self, function: Any, theirs: Any, *rest: Any) -> Any:
        return super().submit(function, {**theirs, "drake": "0.1"}, *rest)


def test_who_refuses_is_named_in_the_error() -> None:
    with OldWorkers(1) as pool:
        (result,) = ad.run_many([1], abs, on=pool)

    text = str(result.error)
    assert text.startswith("a worker refused it: ")
    assert text.endswith("this program 0.1 (tried twice)")


def test_what_is_asked_for_is_sent_once() -> None:
    asked: list[int] = []

    class Asked(cf.ThreadPoolExecutor):
        def submit(self, *task: Any) -> Any:
            asked.append(len(task[3]))
            return super().submit(*task)

    data = np.ones(1000)
    with Asked(1) as pool:
        results = ad.run_many(range(6), lambda x: float(data[x]), on=pool)

    assert results.values == [1.0] * 6
    # Without it, with it, and those that were under way when it came.
    assert sum(asked) <= 2


class Counting(cf.ThreadPoolExecutor):
    """Counts the runs of each call."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self.calls: list[int] = []

    def submit(self, *task: Any) -> Any:
        self.calls.append(len(task[4]))
        return super().submit(*task)


def test_short_runs_go_together_and_long_ones_alone() -> None:
    with Counting(2) as pool:
        results = ad.run_many(range(400), abs, on=pool)
    with Counting(1) as alone:
        ad.run_many([0.2] * 4, sleep, on=alone)

    assert results.values == list(range(400))
    assert max(pool.calls) > 10
    # All have something to do until the end.
    assert pool.calls[-1] == 1
    assert set(alone.calls) == {1}


class KilledWorker(Exception):
    """As dask's, of a task whose workers have died again and again."""


class Deadly(Counting):
    """Workers that die of one input."""

    def submit(self, *task: Any) -> Any:
        if 77 not in [index for index, _ in task[4]]:
            return super().submit(*task)
        self.calls.append(len(task[4]))
        future: cf.Future[Any] = cf.Future()
        future.set_exception(KilledWorker())
        return future


def test_who_was_with_a_run_that_kills_its_workers_is_run_without_it() -> None:
    with Deadly(1) as pool:
        results = ad.run_many(range(200), abs, on=pool)

    assert max(pool.calls) > 1
    assert [result.index for result in results.failed] == [77]
    assert str(results[77].error) == "its workers died while they had this run"


def kill_itself(number: int) -> int:
    """Kill the process with the number 7."""
    if number == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.slow
def test_nobody_pays_for_a_run_that_breaks_its_executor() -> None:
    results = ad.run_many(range(20), kill_itself, on=lambda: cf.ProcessPoolExecutor(2))

    assert [result.index for result in results.failed] == [7]
    assert "tried twice" in str(results[7].error)


@pytest.mark.slow
def test_a_run_that_never_ends_is_ended(tmp_path: Path) -> None:
    def sleep_and_touch(seconds: float) -> float:
        sleep(seconds)
        (tmp_path / f"{seconds}").touch()
        return seconds

    results = ad.run_many([0.0, 60.0], sleep_and_touch, time_limit=1.0, workers=2)

    assert [path.name for path in tmp_path.iterdir()] == ["0.0"]
    assert results[0].value == 0.0
    assert str(results[1].error) == "the run took longer than its limit of 1 s"


@pytest.mark.slow
def test_limits_hold_on_workers_of_executors() -> None:
    with cf.ThreadPoolExecutor(1) as pool:
        results = ad.run_many(
            [1, 1000], functions.leave_behind, on=pool, memory_limit=200 * 2**20
        )

    assert results[0].error is None
    assert "Unable to allocate" in str(results[1].error)


def test_what_is_in_the_file_is_not_run_again(tmp_path) -> None:
    path, ran = tmp_path / "study.runs", []

    def note(x: int) -> int:
        ran.append(x)
        if x == 2 and len(ran) <= 3:
            raise ValueError("not yet")
        return x * x

    first = ad.run_many([0, 1, 2], note, to=path, backend="serial")
    again = ad.run_many([0, 1, 2], note, to=path, backend="serial")

    assert [result.index for result in first.failed] == [2]
    assert again.values == [0, 1, 4]
    assert ran == [0, 1, 2, 2]
    assert "2 were there already" in str(again)


@pytest.mark.slow
def test_what_was_there_is_reported_wherever_the_rest_runs(
    tmp_path, monkeypatch
) -> None:
    path, inputs = tmp_path / "study.runs", [0.0, 0.01, 0.02, 0.03, 0.04]
    monkeypatch.setattr(os, "pwrite", fail_after(os.pwrite, 2))
    with pytest.raises(OutputError):
        ad.run_many(inputs, sleep, to=path, backend="serial")
    monkeypatch.undo()
    monkeypatch.setattr("arm_drake.batch.api.COLD_START", 0.0)
    monkeypatch.setattr("arm_drake.batch.api.WARM_START", 0.0)

    results = ad.run_many(inputs, sleep, to=path, workers=2)

    assert results.backend == "processes"
    assert re.search(r"; \d were there already$", results.why)


def fail_after(write: Any, calls: int) -> Any:
    """Return what writes so often, and then finds the disk full."""
    left = [calls]

    def fill(*arguments: Any) -> Any:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device")
        return write(*arguments)

    return fill


def test_a_record_that_was_cut_short_is_run_again(tmp_path) -> None:
    path = tmp_path / "study.runs"
    ad.run_many([1, 2], abs, to=path, backend="serial")
    whole = path.read_bytes()

    for size in (len(whole) - 1, 20, 5, 0):
        path.write_bytes(whole[:size])
        assert ad.run_many([1, 2], abs, to=path, backend="serial").values == [1, 2]
        assert path.read_bytes()[:17] == whole[:17]


def test_a_length_that_is_no_length_ends_the_file(tmp_path) -> None:
    path = tmp_path / "study.runs"
    path.write_bytes(b"arm_drake runs 1\n" + struct.pack("<QI", 2**60, 0) + b"x")

    assert ad.run_many([1], abs, to=path, backend="serial").values == [1]


@pytest.mark.parametrize(
    ("content", "inputs", "message"),
    [
        (b"something else", [1], "expected a file of results, or none"),
        (
            None,
            [2],
            "it has results of other runs: run 0 is another one now; name another file",
        ),
    ],
)
def test_a_file_of_something_else_is_left_alone(
    tmp_path, content, inputs, message
) -> None:
    path = tmp_path / "study.runs"
    if content is None:
        ad.run_many([1], abs, to=path, backend="serial")
    else:
        path.write_bytes(content)
    before = path.read_bytes()

    with pytest.raises(InputError) as caught:
        ad.run_many(inputs, abs, to=path, backend="serial")

    assert str(caught.value) == f"{path}: {message}"
    assert path.read_bytes() == before


def test_a_file_is_one_programs_at_a_time(tmp_path) -> None:
    path = tmp_path / "study.runs"
    store = RunStore(path, [1])

    with pytest.raises(InputError, match="another program writes it"):
        ad.run_many([1], abs, to=path)

    store.close()


def test_a_full_disk_loses_nothing(tmp_path, monkeypatch) -> None:
    path, write = tmp_path / "study.runs", os.pwrite

    def fill(file: int, data: bytes, at: int) -> int:
        if at > 100:
            raise OSError(28, "No space left on device")
        return write(file, data, at)

    monkeypatch.setattr(os, "pwrite", fill)
    with pytest.raises(OutputError, match="No space left on device; what it has"):
        ad.run_many(range(9), abs, to=path, backend="serial")
    monkeypatch.undo()

    results = ad.run_many(range(9), abs, to=path, backend="serial")

    assert results.values == list(range(9))
    assert "were there already" in results.why


@pytest.mark.slow
def test_a_world_that_is_a_file_goes_along(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path / "cache"))
    robot, file = load(tmp_path, TWO_LINKS, ARM), tmp_path / "moon.sdf"
    file.write_text(
        "<sdf version='1.7'><world name='moon'><gravity>0 0 -1.62</gravity>"
        "<model name='rock'><link name='rock'/></model></world></sdf>"
    )

    class Elsewhere(cf.ThreadPoolExecutor):
        """Workers that don't see the file."""

        def submit(self, *task: Any) -> Any:
            file.unlink(missing_ok=True)
            executors._kept.clear()
            return super().submit(*task)

    def gravity(simulation: ad.Simulation) -> float:
        return float(simulation.plant.gravity_field().gravity_vector()[2])

    with Elsewhere(1) as pool:
        run = ad.Run(robot=robot, world=file, duration=0.0)
        results = ad.run_many([run, run], keep=gravity, on=pool)

    assert results.values == [-1.62] * 2


def test_a_mesh_that_a_worker_lacks_is_kept_by_its_content(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path / "cache"))

    kept = executors._keep_file(tmp_path / "gone.obj", b"content")

    assert kept.read_bytes() == b"content"
    assert kept.suffix == ".obj"
    assert executors._keep_file(kept, b"content") == kept


def test_what_goes_while_it_is_needed_is_kept_by_who_runs() -> None:
    # Threads of one worker share what it keeps, and each lets the oldest go.
    def forget(value: int) -> int:
        executors._kept.clear()
        return value + 1

    sender = executors._Sender(forget)
    packed = [sender.dump(value) for value in range(3)]
    items = [(place, data) for place, (data, _) in enumerate(packed)]
    needs, versions = packed[0][1], executors.versions()

    answers = executors.execute(versions, needs, sender.blobs, items, NO_LIMITS, "")

    assert [loads(data).value for data in answers] == [1, 2, 3]
