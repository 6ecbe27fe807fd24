"""Addresses that commands with a page print, and the end of such commands by Ctrl-C."""

import argparse
import signal
import socket
import sys
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.commands.page import (
    interrupting,
    remote_hint,
    ssh_command,
    start_page,
)
from arm_drake.errors import InputError
from arm_drake.visualization.page.live_views import LiveViews
from tests.visualization.page.clients import end_meshcat


@pytest.fixture
def options() -> argparse.Namespace:
    return argparse.Namespace(host="localhost", port=None)


@pytest.fixture(autouse=True)
def at_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody sits at this machine, whose name is known."""
    monkeypatch.delenv("SSH_CONNECTION", raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("USER", "ada")
    monkeypatch.setenv("LOGNAME", "ada")
    monkeypatch.setattr(socket, "gethostname", lambda: "robot-pc")


def test_a_page_of_this_machine_needs_no_words(
    options: argparse.Namespace, capsys: pytest.CaptureFixture[str]
) -> None:
    with start_page(options) as page:
        assert not page.is_public

    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_a_taken_port_is_said(
    options: argparse.Namespace, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        options.port = server.getsockname()[1]
        with start_page(options) as page:
            assert page.port > options.port
            text = f"port {options.port} is taken; the page is on port {page.port}"

    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", f"warning: {text}\n")


def test_port_0_is_any_free_one_and_its_address_is_real(
    options: argparse.Namespace, capsys: pytest.CaptureFixture[str]
) -> None:
    options.port = 0

    with start_page(options) as page, start_page(options) as other:
        assert page.url == f"http://localhost:{page.port}/"
        assert repr(page) == f"<Page http://localhost:{page.port}/>"
        assert 0 not in (page.port, other.port)
        assert page.port != other.port
        with socket.create_connection(("localhost", page.port), timeout=5.0):
            pass

    assert capsys.readouterr().err == ""


def test_a_public_page_is_warned_of(
    options: argparse.Namespace, capsys: pytest.CaptureFixture[str]
) -> None:
    options.host = "*"

    with start_page(options) as page:
        assert page.url == f"http://robot-pc:{page.port}/"

    assert capsys.readouterr().err == (
        "warning: whoever reaches this machine can open the page, and move the robot\n"
    )


def test_at_a_screen_nobody_needs_the_way_from_elsewhere(
    options: argparse.Namespace,
) -> None:
    with start_page(options) as page:
        assert remote_hint(page) == ""


def test_who_comes_through_ssh_is_told_the_way(
    options: argparse.Namespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Even with a screen of its own, which ssh can bring along.
    monkeypatch.setenv("SSH_CONNECTION", "192.0.2.7 50000 192.0.2.1 22")

    with start_page(options) as page:
        assert remote_hint(page) == (
            f"from another machine: ssh -L {page.port}:localhost:{page.port} "
            "ada@192.0.2.1"
        )
        options.host = "*"
        with start_page(options) as public:
            assert remote_hint(public) == ""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have a screen")
def test_without_a_screen_the_way_is_told_too(
    options: argparse.Namespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)

    with start_page(options) as page:
        assert remote_hint(page).endswith(" ada@robot-pc")
        monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
        assert remote_hint(page) == ""


@pytest.mark.parametrize("connection", ["", "192.0.2.7", "a b c d e"])
def test_without_an_address_the_name_of_the_machine_must_do(
    monkeypatch: pytest.MonkeyPatch, connection: str
) -> None:
    monkeypatch.setenv("SSH_CONNECTION", connection)

    assert ssh_command(7000) == "ssh -L 7000:localhost:7000 ada@robot-pc"


def test_a_page_that_cannot_be_is_an_input_error(options: argparse.Namespace) -> None:
    options.port = 1

    with pytest.raises(InputError) as caught:
        start_page(options)

    assert str(caught.value) == "port 1: expected 1024 to 65535, or 0 for any free one"


def test_the_first_ctrl_c_stops_and_the_second_ends() -> None:
    before, stops = signal.getsignal(signal.SIGINT), []

    with interrupting(lambda: stops.append(True)) as is_interrupted:
        assert not is_interrupted()
        signal.raise_signal(signal.SIGINT)
        assert (is_interrupted(), stops) == (True, [True])
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    assert stops == [True]
    assert is_interrupted()
    assert signal.getsignal(signal.SIGINT) is before


def test_without_ctrl_c_nothing_is_interrupted() -> None:
    before = signal.getsignal(signal.SIGINT)

    with interrupting(lambda: None) as is_interrupted:
        assert signal.getsignal(signal.SIGINT) is not before

    assert not is_interrupted()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_error_gives_ctrl_c_back() -> None:
    before = signal.getsignal(signal.SIGINT)

    with pytest.raises(ZeroDivisionError), interrupting(lambda: None):
        raise ZeroDivisionError

    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
@pytest.mark.parametrize("words", [[], ["--headless", "--record", "film.html"]])
def test_what_was_simulated_is_written_when_meshcat_ends(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    draw = LiveViews.draw

    def end_on_the_way(views: LiveViews) -> None:
        if views._simulation.time > 0.2 and views.scene.is_alive:
            end_meshcat(views.scene)
        draw(views)

    monkeypatch.setattr(LiveViews, "draw", end_on_the_way)

    code = main(["sim", "doosan_a0912", "--duration=1000", "--log=log.npz", *words])

    *_, last = capsys.readouterr().err.splitlines()
    assert code == 1
    assert last.startswith("arm-drake: Meshcat has ended: a program of this machine")
    assert 0.2 <= ad.Rollout.load("log.npz").time[-1] < 1000.0
    assert not Path("film.html").exists()


@pytest.mark.slow
def test_a_page_reports_tasks_whose_time_does_not_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = tmp_path / "motion.yaml"
    motion.write_text("- {at: 2.0, plan_to: {positions: {joint1: 1.0}}}")
    words = ["sim", "doosan_a0912", "--motion", str(motion), "--duration", "0.1"]

    code = main([*words, "--no-wait", "--no-hold", "--no-open"])

    assert code == 1
    assert capsys.readouterr().err == (
        f"arm-drake: {motion}:1: [0].plan_to: not begun: the simulation ended before "
        "its time\n"
    )
