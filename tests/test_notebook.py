"""Pages beside a program: cells that are run again, other threads, static pages."""

import concurrent.futures
import gc
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

import arm_drake as ad
from arm_drake import notebook
from arm_drake.errors import InputError
from tests.models import load, pendulum
from tests.waiting import wait_until

ARM = "lab5_arm"
JOINT = "base_arm1_joint"


@pytest.fixture(autouse=True)
def local_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in notebook._REMOTE_VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def pages() -> Iterator[list[ad.PageHandle]]:
    opened: list[ad.PageHandle] = []
    yield opened
    for page in opened:
        page.close()


def listening() -> list[int]:
    """Return the ports that this process listens to, one for each socket."""
    connections = psutil.Process().net_connections("tcp")
    return [c.laddr.port for c in connections if c.status == psutil.CONN_LISTEN]


def num_listening() -> int:
    return len(listening())


def test_a_viewer_is_used_from_another_thread_than_its_own(pages) -> None:
    page = ad.view(ARM, positions={JOINT: 0.5})
    pages.append(page)

    page.set_positions({JOINT: 0.75})

    assert page.positions[JOINT] == 0.75
    assert page.call(lambda viewer: viewer.positions[JOINT]) == 0.75
    assert page.call(lambda viewer: threading.current_thread()) is not (
        threading.current_thread()
    )


def test_errors_come_to_who_asked(pages) -> None:
    page = ad.view(ARM)
    pages.append(page)

    with pytest.raises(InputError) as caught:
        page.set_positions({"no_joint": 0.0})

    assert str(caught.value).startswith("no joint 'no_joint'; ")
    # It goes on.
    assert page.positions[JOINT] == pytest.approx(0.0, abs=1.0)


def test_a_robot_that_cannot_be_loaded_is_said_at_once(tmp_path) -> None:
    with pytest.raises(ad.ArmDrakeError, match="nothing"):
        ad.view(tmp_path / "nothing.urdf")


def test_options_for_a_robot_that_is_loaded_already_are_refused() -> None:
    robot = ad.load_robot(ARM)

    with pytest.raises(InputError) as caught:
        ad.view(robot, distro="humble")

    assert str(caught.value) == "distro: the robot is loaded already"


@pytest.mark.slow
def test_a_cell_that_is_run_again_keeps_its_address_and_leaves_nothing(pages) -> None:
    page = ad.view(ARM, port=7800)
    url, num_before = page.url, num_listening()
    threads = threading.active_count()

    for _ in range(5):
        page = ad.view(ARM, port=int(url.rpartition(":")[2].strip("/")))
    pages.append(page)

    assert page.url == url
    assert num_listening() == num_before
    assert threading.active_count() == threads


@pytest.mark.slow
def test_a_page_that_nobody_has_is_closed() -> None:
    page = ad.view(ARM)
    port = page.call(lambda viewer: viewer.page.port)
    assert port in listening()

    del page
    gc.collect()

    wait_until(lambda: port not in listening())


@pytest.mark.slow
def test_a_closed_page_says_so() -> None:
    page = ad.view(ARM)

    page.close()

    assert repr(page) == "<page, closed>"
    assert page._repr_html_() is None
    with pytest.raises(RuntimeError, match="the page is closed"):
        page.randomize()
    page.close()


def test_a_page_may_be_used_from_within_its_thread(pages) -> None:
    page = ad.view(ARM)
    pages.append(page)

    page.call(lambda viewer: page.set_positions({JOINT: 0.25}))

    assert page.call(lambda viewer: page.positions[JOINT]) == 0.25


def test_a_page_may_be_closed_from_within_its_thread() -> None:
    page = ad.view(ARM)

    page.call(lambda viewer: page.close())

    wait_until(lambda: not page.is_open)


@pytest.mark.slow
def test_a_page_that_has_failed_says_why(capsys) -> None:
    page = ad.simulate(ARM)

    def fail(live: ad.LiveSimulation) -> None:
        def explode(*arguments: object) -> None:
            raise RuntimeError("own controller exploded")

        live.views.draw = explode

    page.call(fail)
    wait_until(lambda: not page.is_open)

    with pytest.raises(RuntimeError) as caught:
        page.play()
    assert str(caught.value) == "the page is closed: own controller exploded"
    assert capsys.readouterr().err == (
        "arm_drake: a page has ended: own controller exploded\n"
    )


@pytest.mark.slow
def test_an_interrupt_while_a_page_is_made_leaves_none(monkeypatch) -> None:
    class Interrupted(concurrent.futures.Future):
        def result(self, timeout: float | None = None) -> None:
            raise KeyboardInterrupt

    num_before = num_listening()
    future = "arm_drake.notebook.concurrent.futures.Future"
    monkeypatch.setattr(future, Interrupted)
    with pytest.raises(KeyboardInterrupt):
        ad.view(ARM)
    monkeypatch.undo()

    # Meshcat itself waits for the next page.
    wait_until(lambda: num_listening() <= num_before + 1)


def test_methods_of_what_is_shown_are_offered_for_completion(pages) -> None:
    page = ad.view(ARM)
    pages.append(page)

    assert {"set_positions", "randomize", "close"} <= set(dir(page))


@pytest.mark.slow
@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_an_animation_takes_time(duration: float) -> None:
    with pytest.raises(InputError) as caught:
        ad.animate(ARM, duration)

    text = f"duration: expected more than 0 s, got {duration!r}"
    assert str(caught.value) == text


def test_in_a_notebook_the_page_is_in_the_cell(pages) -> None:
    page = ad.view(ARM)
    pages.append(page)

    shown = page._repr_html_()

    assert shown.startswith(f'<iframe src="{page.url}" ')


@pytest.mark.slow
@pytest.mark.parametrize("name", notebook._REMOTE_VARIABLES)
def test_where_the_browser_is_elsewhere_the_cell_has_all_it_needs(
    pages, monkeypatch, name
) -> None:
    page = ad.view(ARM)
    pages.append(page)
    monkeypatch.setenv(name, "yes")

    shown = page._repr_html_()

    assert shown.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    assert page.url not in shown


@pytest.mark.slow
def test_a_simulation_goes_on_beside_the_program(pages) -> None:
    page = ad.simulate(ad.load_robot(ARM), realtime_rate=0.0)
    pages.append(page)

    wait_until(lambda: page.call(lambda live: live.simulation.time) > 0.5)
    page.pause()

    times = [page.call(lambda live: live.simulation.time) for _ in range(3)]
    assert times[0] == times[-1]
    assert not page.is_playing


@pytest.mark.slow
def test_a_simulation_on_a_page_takes_goals_from_the_program(pages) -> None:
    page = ad.simulate(ad.load_robot(ARM), realtime_rate=0.0)
    pages.append(page)

    def go(live: ad.LiveSimulation) -> None:
        (remote,) = live.remotes
        remote.go_to({JOINT: 0.5})

    page.call(go)

    def position() -> float:
        return page.call(
            lambda live: dict(
                zip(
                    live.simulation.joint_states().name,
                    live.simulation.joint_states().position,
                    strict=True,
                )
            )[JOINT]
        )

    wait_until(lambda: abs(position() - 0.5) < 5e-3)


@pytest.mark.slow
def test_an_animation_is_the_same_simulation(tmp_path) -> None:
    robot = load(tmp_path, pendulum())
    alone = ad.Simulation(ad.build_diagram(robot))
    alone.run(1.0)

    animated, recording = ad.animate(robot, 1.0)

    assert np.array_equal(animated.rollout().position, alone.rollout().position)
    assert recording.html.startswith("<!DOCTYPE html>")
    assert recording._repr_html_().startswith('<iframe srcdoc="')


@pytest.mark.slow
def test_an_animation_is_written_to_a_file(tmp_path) -> None:
    _, recording = ad.animate(ad.load_robot(ARM), 0.1)
    megabytes = len(recording.html) / 1e6
    assert repr(recording) == f"<Recording, {megabytes:.1f} MB of HTML>"

    recording.save(tmp_path / "arm.html")

    assert (tmp_path / "arm.html").read_text(encoding="utf-8") == recording.html
    with pytest.raises(ad.ArmDrakeError):
        recording.save(tmp_path / "none" / "arm.html")


@pytest.mark.slow
def test_a_motion_has_the_name_that_it_has_for_the_command_line(pages) -> None:
    simulation, _ = ad.animate(ad.load_robot("doosan_a0912"), 5.0, motion="tutorial")

    (goal,) = simulation.goals
    assert goal.status is ad.GoalStatus.SUCCEEDED
    with pytest.raises(ad.ArmDrakeError) as caught:
        ad.animate(ad.load_robot(ARM), 1.0, motion="tutorial")
    assert str(caught.value).startswith(
        "no motion 'tutorial' of 'lab5_arm', and no such file; "
    )


@pytest.mark.slow
def test_animations_leave_no_servers() -> None:
    ad.animate(ad.load_robot(ARM), 0.1)
    num_before = num_listening()

    for _ in range(3):
        ad.animate(ad.load_robot(ARM), 0.1)

    assert num_listening() == num_before


@pytest.mark.slow
def test_the_programs_of_the_docs_run(tmp_path, monkeypatch) -> None:
    docs = Path(__file__).parents[1] / "docs/page.md"
    programs = re.findall(r"```python\n(.*?)```", docs.read_text("utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)

    for program in programs:
        exec(compile(program, str(docs), "exec"), {})  # noqa: S102  our own text.

    assert len(programs) == 2
    assert (tmp_path / "arm.html").is_file()
