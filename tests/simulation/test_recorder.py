"""Logs written while a simulation runs: whole, bounded, readable at any end."""

import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from pydrake.systems.primitives import VectorLogSink

import arm_drake as ad
from arm_drake.description.entry import bundled_motions
from arm_drake.errors import InputError
from arm_drake.rollout.bag import BagWriter
from arm_drake.rollout.mcap import McapFile
from arm_drake.simulation.simulation import PERIOD
from tests import models
from tests.models import load, pendulum
from tests.rollout.test_rollout_files import assert_same, assert_same_rows
from tests.snippets import read_blocks

# So many ticks are simulated between two looks.
CHUNK = 50

# What is written are ticks: one step of the physics is enough in each [s].
COARSE = ad.SimulationOptions(time_step=1e-2)


def make_simulation() -> ad.Simulation:
    robot = ad.load_robot("doosan_a0912")
    return ad.Simulation(ad.build_diagram(robot, options=COARSE))


def run_tutorial(sim: ad.Simulation) -> None:
    motion = ad.load_motion(bundled_motions("doosan_a0912")["tutorial"])
    sim.run(motion.duration + 1.03, motion)


def logged_rows(sim: ad.Simulation) -> list[int]:
    """Return how many rows each log has in memory."""
    root = sim.simulator.get_context()
    logs = [s for s in sim.diagram.GetSystems() if isinstance(s, VectorLogSink)]
    assert len(logs) >= 2
    return [log.FindLog(root).num_samples() for log in logs]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_what_was_written_on_the_way_is_what_is_saved_at_the_end(
    tmp_path: Path, suffix: str
) -> None:
    whole = make_simulation()
    run_tutorial(whole)
    sim = make_simulation()

    with sim.record_to(tmp_path / f"a{suffix}", history=0.5):
        run_tutorial(sim)

    found = ad.Rollout.load(tmp_path / f"a{suffix}")
    assert len(found.time) > 400
    check = assert_same if suffix == ".mcap" else assert_same_rows
    check(found, whole.rollout())


@pytest.mark.slow
def test_the_same_run_writes_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        sim = make_simulation()
        with sim.record_to(tmp_path / f"{name}.mcap"):
            run_tutorial(sim)

    first, second = ((tmp_path / f"{name}.mcap").read_bytes() for name in "ab")
    assert first == second


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_rows_in_memory_are_bounded(tmp_path: Path, suffix: str) -> None:
    # What is kept twice over, what is read between two writes, and a chunk of ticks.
    history = 0.5
    sim = ad.Simulation(ad.build_diagram(load(tmp_path, pendulum())))
    longest = (2.0 * history + PERIOD) / sim.period + 2 * CHUNK
    most = 0
    with sim.record_to(tmp_path / f"a{suffix}", history=history):
        for _ in range(200):
            sim.run(0.1)
            most = max(most, *logged_rows(sim))
        assert len(sim.mailbox.sent) == 0

    assert most <= longest
    # All are in the file, ten times as many.
    rows = len(ad.Rollout.load(tmp_path / f"a{suffix}").time)
    assert rows == round(20.0 / sim.period) > 5 * longest


@pytest.mark.slow
def test_messages_in_memory_are_bounded(tmp_path: Path) -> None:
    sim = make_simulation()
    arm = sim.controller("joint_trajectory_controller")
    most = 0
    with sim.record_to(tmp_path / "a.mcap", history=0.5):
        for _ in range(60):
            arm.send_trajectory(ad.JointTrajectory())
            sim.run(0.1)
            most = max(most, len(sim.mailbox.sent))

    assert most <= (2.0 * 0.5 + PERIOD) / 0.1 + 10
    assert len(ad.Rollout.load(tmp_path / "a.mcap").messages) == 60


@pytest.mark.slow
def test_effort_saturation_counts_rows_that_are_gone(tmp_path: Path) -> None:
    limit = 'lower="-3" upper="3" effort="2" velocity="10"'
    runs = []
    for history in (np.inf, 0.5):
        sim = ad.Simulation(
            ad.build_diagram(
                load(tmp_path, pendulum(limit=limit), initial_positions={"swing": 1.5})
            )
        )
        recorder = sim.record_to(tmp_path / "a.mcap", history=history)
        sim.run(6.0)
        recorder.close()
        (robot,) = sim.robots
        runs.append(recorder.effort_saturation(robot))
        if history == np.inf:
            expected = sim.rollout().effort_saturation()

    assert runs[0] == pytest.approx(expected, abs=1e-9)
    assert runs[1] == pytest.approx(expected, abs=1e-9)
    assert expected["swing"] > 2.0


@pytest.mark.slow
def test_after_a_reset_the_file_begins_anew(tmp_path: Path) -> None:
    sim = make_simulation()
    with sim.record_to(tmp_path / "a.mcap"):
        sim.run(2.5)
        sim.reset()
        sim.run(0.5)

    time = ad.Rollout.load(tmp_path / "a.mcap").time
    assert (time[0], time[-1]) == (0.0, pytest.approx(0.49))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_between_writes_the_file_is_whole(tmp_path: Path, suffix: str) -> None:
    sim = make_simulation()
    recorder = sim.record_to(tmp_path / f"a{suffix}")
    sim.run(2.3)

    time = ad.Rollout.load(tmp_path / f"a{suffix}").time

    assert time[0] == 0.0
    # The news is looked at, and so is the clock, every 50 ticks.
    assert 2.3 - PERIOD - CHUNK * sim.period <= time[-1] <= 2.3
    recorder.close()


@pytest.mark.slow
def test_ctrl_c_within_a_write_comes_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim = make_simulation()
    recorder = sim.record_to(tmp_path / "a.mcap")
    write = BagWriter._channel

    def interrupted(*arguments: object) -> int:
        signal.raise_signal(signal.SIGINT)
        return write(*arguments)

    sim.run(0.5)
    monkeypatch.setattr(BagWriter, "_channel", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sim.run(1.0)
    monkeypatch.undo()
    stopped_at = sim.time
    sim.run(0.5)
    recorder.close()

    time = ad.Rollout.load(tmp_path / "a.mcap").time
    assert stopped_at < 1.5
    np.testing.assert_allclose(np.diff(time), 0.01, rtol=1e-6)
    assert time[-1] == pytest.approx(sim.time - 0.01)


@pytest.mark.slow
def test_several_robots_are_in_one_bag(tmp_path: Path) -> None:
    # One would stand in the other, and all of their links would touch.
    places = {"a": (0.0,) * 6, "b": (0.0, 2.0, *(0.0,) * 4)}
    robots = [
        ad.load_robot("doosan_a0912", name=name, pose=pose)
        for name, pose in places.items()
    ]
    sim = ad.Simulation(ad.build_diagram(robots))
    with sim.record_to(tmp_path / "a.mcap"):
        sim.run(0.3)

    for name in "ab":
        found = ad.Rollout.load(tmp_path / "a.mcap", name)
        assert_same(found, sim.rollout(name))
    with pytest.raises(
        InputError, match="a table is of one robot; expected robot=, on"
    ):
        sim.record_to(tmp_path / "a.csv")
    with sim.record_to(tmp_path / "b.csv", robot="b"):
        sim.run(0.3)
    assert len(ad.Rollout.load(tmp_path / "b.csv").time) == 30


@pytest.mark.slow
def test_arrays_cannot_grow(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        make_simulation().record_to(tmp_path / "a.npz")

    assert str(error.value) == (
        f"{tmp_path / 'a.npz'}: a .npz file can't grow while a simulation runs; "
        "expected one of .csv, .mcap, or Rollout.save at the end"
    )


PROGRAM = """
import sys
import arm_drake as ad

sim = ad.Simulation(ad.build_diagram(ad.load_robot("lab5_arm")))
sim.record_to(sys.argv[1])
while True:
    sim.run(0.5)
    print(sim.time, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_a_killed_run_leaves_a_readable_file(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"a{suffix}"
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, file],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as process:
        for line in process.stdout:
            if float(line) >= 3.5:
                break
        os.kill(process.pid, signal.SIGKILL)
        simulated = [3.5, *map(float, process.stdout)][-1]
    assert process.returncode == -signal.SIGKILL

    found = ad.Rollout.load(file).time

    period = 0.01
    steps = np.diff(found)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    assert found[0] == 0.0
    assert found[-1] >= simulated - PERIOD - (CHUNK + 1) * period
    if suffix == ".mcap":
        states = list(read_ros2_messages(file, topics=["/joint_states"]))
        assert len(states) == len(found)


def test_a_bag_that_grows_can_be_read_at_any_time_and_costs_little(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    put = McapFile._put

    def count(file: McapFile, start: int, data: bytes) -> None:
        written.append(len(data))
        put(file, start, data)

    monkeypatch.setattr(McapFile, "_put", count)
    path = tmp_path / "a.mcap"
    file = McapFile(path)
    channel = file.add_channel("/a", "std_msgs/msg/String", "string data" * 500, {})
    has_index = []
    for number in range(300):
        file.write(channel, number, b"x" * 50)
        file.flush()
        if number % 10 == 0:
            with path.open("rb") as stream:
                reader = make_reader(stream)
                assert len(list(reader.iter_messages())) == number + 1
                has_index.append(reader.get_summary() is not None)
    file.close()

    assert set(has_index) == {True, False}
    assert sum(written) < 3 * path.stat().st_size
    with path.open("rb") as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 300


@pytest.mark.slow
def test_the_program_of_the_docs_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = read_blocks(Path(__file__).parents[2] / "docs/logs.md")
    (code,) = (block.text for block in blocks if block.language == "python")
    monkeypatch.chdir(tmp_path)

    exec(code, {})  # noqa: S102

    assert {file.name for file in tmp_path.iterdir()} == {"run.mcap", "run.npz"}
    assert "'drake'" in capsys.readouterr().out


@pytest.mark.slow
def test_the_topics_of_the_docs_are_those_of_a_bag(tmp_path: Path) -> None:
    sim = make_simulation()
    with sim.record_to(tmp_path / "a.mcap"):
        run_tutorial(sim)
        sim.controller("joint_trajectory_controller").send_trajectory(
            ad.JointTrajectory()
        )
        sim.run(0.1)
    docs = (Path(__file__).parents[2] / "docs/logs.md").read_text(encoding="utf-8")

    topics = {
        message.channel.topic for message in read_ros2_messages(tmp_path / "a.mcap")
    }

    for topic in topics:
        name = topic.replace("joint_trajectory_controller", "<controller>")
        assert f"`{name}`" in docs or name.startswith("/arm_drake/"), topic


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_a_record_begins_where_it_was_asked_for(tmp_path: Path, suffix: str) -> None:
    sim, file = make_simulation(), tmp_path / f"a{suffix}"
    sim.run(2.5)

    with sim.record_to(file):
        sim.run(1.5)

    found = ad.Rollout.load(file)
    assert found.time[0] == pytest.approx(2.5)
    whole = sim.rollout()
    np.testing.assert_array_equal(found.position, whole.position[whole.time >= 2.5])


@pytest.mark.slow
def test_a_robot_at_1_khz_has_the_same_rows_in_a_file_as_in_memory(
    tmp_path: Path,
) -> None:
    robot = load(
        tmp_path,
        pendulum(),
        models.trajectory_controllers({"a": ["swing"]}, update_rate=1000),
    )
    sim = ad.Simulation(ad.build_diagram(robot))
    point = ad.JointTrajectoryPoint((1.0,), time_from_start=2.0)
    goal = ad.JointTrajectory(joint_names=("swing",), points=(point,))
    with sim.record_to(tmp_path / "a.mcap"):
        sim.controller("a").send_goal(goal)
        for _ in range(23):  # The time is a sum of rounded numbers then.
            sim.run(0.1)

    whole = sim.rollout()
    assert np.ptp(whole.position) > 0.9
    assert_same_rows(ad.Rollout.load(tmp_path / "a.mcap"), whole)


@pytest.mark.slow
def test_a_file_is_recorded_to_once_at_a_time(tmp_path: Path) -> None:
    sim, file = make_simulation(), tmp_path / "a.csv"

    with sim.record_to(file), pytest.raises(InputError, match="recorded to already"):
        sim.record_to(tmp_path / "." / "a.csv")

    sim.record_to(file).close()


@pytest.mark.slow
def test_of_two_recorders_the_one_that_keeps_more_decides(tmp_path: Path) -> None:
    sim = make_simulation()

    with (
        sim.record_to(tmp_path / "a.csv"),
        sim.record_to(tmp_path / "b.csv", history=1.0),
    ):
        sim.run(6.0)

        assert sim.rollout().time[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("history", [0.0, -1.0, math.nan, "x", True])
def test_a_history_that_is_no_time_is_refused(tmp_path: Path, history: Any) -> None:
    with pytest.raises(InputError, match="history must be positive"):
        make_simulation().record_to(tmp_path / "a.csv", history=history)
