"""A log, shown: the robot where it was, on a page or in files."""

import dataclasses as dc
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import InputError
from arm_drake.visualization.page import Page, Scene, WidgetEvent
from arm_drake.visualization.page.replay import Replay, ReplayPage, load_recorded_robot
from tests.carts import cart, diff_drive
from tests.carts import load as load_cart
from tests.visualization.page.clients import Panel


@pytest.fixture(scope="module")
def recorded() -> tuple[ad.Rollout, dict[float, dict[str, np.ndarray]]]:
    """Return a rollout of the Doosan, and where its links were at some times."""
    robot = ad.load_robot("doosan_a0912", pose=(0.3, 0.0, 0.1, 0.0, 0.0, 0.5))
    sim = ad.Simulation(ad.build_diagram(robot))
    seen = {}
    names = [f"joint{k}" for k in range(1, 7)]
    target = ad.JointTrajectoryPoint((1.0, 0.5, 0.8, -0.5, 0.7, 2.0), time_from_start=2)
    goal = ad.JointTrajectory(joint_names=names, points=[target])
    sim.controller("joint_trajectory_controller").send_goal(goal)
    for end in (0.5, 1.0, 2.0):
        sim.advance_to(end)
        seen[end] = poses(sim.link_poses())
    sim.advance_to(2.2)
    return sim.rollout(), seen


@pytest.fixture
def scene() -> Iterator[Scene]:
    with Scene() as made:
        yield made


def poses(links) -> dict[str, np.ndarray]:
    return {name: X_WL.GetAsMatrix4() for name, X_WL in links.items()}


def assert_same_poses(found, expected) -> None:
    for name, X_WL in found.items():
        # Products of a dozen matrices of about 1, along other ways.
        np.testing.assert_allclose(X_WL, expected[name], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".npz", ".mcap"])
def test_links_are_where_they_were(tmp_path: Path, scene, recorded, suffix) -> None:
    rollout, seen = recorded
    rollout.save(tmp_path / f"a{suffix}")
    again = ad.Rollout.load(tmp_path / f"a{suffix}")

    replay = Replay(scene.meshcat, again, load_recorded_robot(again))

    for at, expected in seen.items():
        replay.show(at)
        assert_same_poses(poses(replay.link_poses()), expected)
    moved = [np.ptp([links["link6"][:3, 3] for links in seen.values()], axis=0)]
    assert np.max(moved) > 0.05


def test_the_robot_of_the_log_has_its_meshes(recorded) -> None:
    robot = load_recorded_robot(recorded[0])

    assert not robot.report.errors
    meshes = [file for file in robot.source_files if file.suffix in (".dae", ".stl")]
    assert meshes


@pytest.mark.slow
def test_a_free_base_is_where_it_was(tmp_path: Path, scene) -> None:
    sim = ad.Simulation(ad.build_diagram(load_cart(tmp_path, cart(diff_drive()))))
    for tick in range(50):
        sim.topic("/model/cart/cmd_vel").publish(
            {"linear": {"x": 0.5}, "angular": {"z": 1.0}}
        )
        sim.advance_to((tick + 1) * 0.01)
    expected = poses(sim.link_poses())
    sim.advance_to(0.6)
    rollout = sim.rollout()

    replay = Replay(scene.meshcat, rollout, load_recorded_robot(rollout))
    replay.show(0.5)

    assert_same_poses(poses(replay.link_poses()), expected)
    assert expected["base_link"][0, 3] > 0.1


def test_between_rows_it_is_in_between(scene, recorded) -> None:
    rollout, _ = recorded
    replay = Replay(scene.meshcat, rollout, load_recorded_robot(rollout))
    found = []
    period = rollout.time[1]
    for at in (100 * period, 100.5 * period, 101 * period):
        replay.show(at)
        found.append(replay.link_poses()["link6"].translation())

    # Half a period off a chord, which is short.
    middle = (found[0] + found[2]) / 2.0
    np.testing.assert_allclose(found[1], middle, atol=1e-5)
    assert np.linalg.norm(found[2] - found[0]) > 1e-4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"description": ""},
            "the log doesn't hold its robot's description; name the robot",
        ),
        ({"description": "<robot"}, "the description in the log can't be read: "),
    ],
)
def test_a_log_without_its_robot_says_so(recorded, changes, message) -> None:
    with pytest.raises(InputError) as error:
        load_recorded_robot(dc.replace(recorded[0], **changes))

    assert str(error.value).startswith(message)


def test_another_robot_is_refused(scene, recorded) -> None:
    robot = ad.load_robot("lab5_arm")

    with pytest.raises(InputError) as error:
        Replay(scene.meshcat, recorded[0], robot)

    assert str(error.value).startswith("the robot has no joint 'joint1' of the log; ")


def test_what_lasts_too_long_is_not_recorded(tmp_path: Path, capsys, recorded) -> None:
    rollout, _ = recorded
    time = rollout.time.copy()
    time[-1] = 1e9
    dc.replace(rollout, time=time).save(tmp_path / "a.npz")

    code = main(
        ["replay", str(tmp_path / "a.npz"), "--record", str(tmp_path / "a.html")]
    )

    assert code == 2
    assert "of one hour at most, got a log of 1e+09 s" in capsys.readouterr().err


def test_a_log_without_rows_is_refused(scene, recorded) -> None:
    rollout = recorded[0]
    empty = dc.replace(rollout, time=rollout.time[:0])

    with pytest.raises(InputError, match="the log has no rows"):
        Replay(scene.meshcat, empty, load_recorded_robot(rollout))


@pytest.mark.slow
def test_the_page_plays_to_the_end_and_does_what_is_clicked(recorded) -> None:
    rollout, _ = recorded
    with Page() as page:
        replay = Replay(page.meshcat, rollout, load_recorded_robot(rollout))
        shown = ReplayPage(page, replay, rate=20.0)

        def stop_at_the_end() -> None:
            try:
                with Panel(page.port) as panel:
                    panel.hear_field("play", "label", "play")
            finally:
                shown.stop()

        stopper = threading.Thread(target=stop_at_the_end)
        stopper.start()
        shown.run()
        stopper.join()

        assert (shown.time, shown.is_playing) == (replay.end, False)
        shown.handle([WidgetEvent("play", None)])
        assert (shown.time, shown.is_playing) == (replay.start, True)
        shown.handle(
            [
                WidgetEvent("play", None),
                WidgetEvent("rate", "0.5 ×"),
                WidgetEvent("time", 1.5),
            ]
        )
        assert (shown.is_playing, shown.rate, shown.time) == (False, 0.5, 1.5)
        shown.handle([WidgetEvent("time", 99)])
        assert shown.time == replay.end
        shown.handle([WidgetEvent("restart", None)])
        assert shown.time == replay.start
        for bad in (
            WidgetEvent("time", "x"),
            WidgetEvent("rate", "as fast as it goes"),
        ):
            shown.handle([bad])
        assert (shown.time, shown.rate) == (replay.start, 0.5)


@pytest.mark.slow
def test_the_command_records_a_page(tmp_path: Path, capsys, recorded) -> None:
    rollout, _ = recorded
    rollout.save(tmp_path / "a.mcap")
    words = ["replay", str(tmp_path / "a.mcap"), "--record", str(tmp_path / "a.html")]

    code = main([*words, "--plot", str(tmp_path / "a.png")])

    out = capsys.readouterr().out
    assert code == 0
    assert f"recording: {tmp_path / 'a.html'}" in out
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert len(page) > 1e6
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_named_robot_takes_the_place_of_the_recorded_one(
    tmp_path: Path, capsys, recorded
) -> None:
    rollout, _ = recorded
    rollout.save(tmp_path / "a.csv")
    words = ["replay", str(tmp_path / "a.csv"), "--record", str(tmp_path / "a.html")]

    assert main(words) == 2
    assert "the log doesn't hold its robot's description" in capsys.readouterr().err
    assert main([*words, "--robot", "doosan_a0912"]) == 0
    assert (tmp_path / "a.html").is_file()


def test_xacro_arguments_need_a_robot(tmp_path: Path, capsys, recorded) -> None:
    recorded[0].save(tmp_path / "a.npz")

    code = main(["replay", str(tmp_path / "a.npz"), "a:=1", "--plot", "b.png"])

    assert code == 2
    assert "a:=1 is for a robot's description; give --robot, too" in (
        capsys.readouterr().err
    )


@pytest.mark.slow
@pytest.mark.browser
def test_the_command_takes_a_picture(tmp_path: Path, recorded) -> None:
    recorded[0].save(tmp_path / "a.npz")
    file = tmp_path / "a.png"

    code = main(["replay", str(tmp_path / "a.npz"), "--screenshot", str(file)])

    assert code == 0
    assert file.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("option", "word"),
    [
        (["--plot", "a.png"], ["--rate", "2"]),
        (["--record", "a.html"], ["--host", "*"]),
        (["--screenshot", "a.png"], ["--port", "7001"]),
        (["--video", "a.mp4"], ["--open"]),
    ],
)
def test_files_have_no_page(option, word, capsys) -> None:
    code = main(["replay", "a.npz", *option, *word])

    message = f"{word[0]} is for the page, and with {option[0]} there is none"
    assert (code, capsys.readouterr().err) == (2, f"arm-drake: {message}\n")
