"""Pages with a panel: what serves them, what a person does in them, what is seen."""

import concurrent.futures
import contextlib
import dataclasses as dc
import functools
import io
import itertools
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Locator, ViewportSize
from playwright.sync_api import Page as BrowserPage
from pydrake.math import RigidTransform

from arm_drake.visualization.meshcat import place_camera
from arm_drake.visualization.page import Page
from tests.browser.pictures import VIEWPORT, Camera, Mask, Picture, new_context
from tests.waiting import PATIENCE as TIMEOUT

# How often something is looked at that is waited for [ms].
_POLL = 30.0

# Width of the panel, of 20.5 letters' sizes of 13 pixels each, rounded up [pixels].
_PANEL = 267

# The scene is as large as a picture of Meshcat's own page.
_SIZE = ViewportSize(width=_PANEL + VIEWPORT["width"], height=VIEWPORT["height"])

# Part of the track of a slider that its knob takes [pixels].
_KNOB = 16.0

_MARK = "arm_drake_mark"  # Beside "/drake", which moves.

# Notes in a browser which mark its panel has got, before the panel takes it.
_NOTE_MARK = f"""
    window.WebSocket = class extends WebSocket {{
        constructor(...given) {{
            super(...given);
            this.addEventListener("message", ({{data}}) => {{
                if (typeof data !== "string") return;
                const mark = JSON.parse(data).changes?.{_MARK};
                if (mark) window.{_MARK} = mark.value;
            }});
        }}
    }};
"""

Result = TypeVar("Result")


class Runnable(Protocol):
    """What has a page: a RobotViewer or a LiveSimulation."""

    def run(self) -> None: ...

    def stop(self) -> None: ...


Subject = TypeVar("Subject", bound=Runnable)


class Program(Generic[Subject]):
    """A viewer or a simulation that runs in a thread, as in a process of its own.

    Playwright's calls block the thread of the test.
    """

    def __init__(
        self,
        thread: concurrent.futures.ThreadPoolExecutor,
        make: Callable[[Page], Subject],
    ) -> None:
        self._thread = thread
        self._marks = itertools.count(1)
        self.page, self.subject = thread.submit(self._make, make).result(TIMEOUT)
        self._running = thread.submit(self.subject.run)

    @staticmethod
    def _make(make: Callable[[Page], Subject]) -> tuple[Page, Subject]:
        page = Page()
        try:
            return page, make(page)
        except BaseException:
            page.close()
            raise

    def ask(self, function: Callable[[], Result]) -> Result:
        """Call a function in the program's thread, and return what it returns."""
        answer: concurrent.futures.Future[Result] = concurrent.futures.Future()

        def work() -> None:
            try:
                answer.set_result(function())
            except BaseException as error:
                answer.set_exception(error)

        self.page.call(work)
        concurrent.futures.wait(
            [answer, self._running], TIMEOUT, concurrent.futures.FIRST_COMPLETED
        )
        if not answer.done() and self._running.done():
            self._running.result()  # Raises what has ended it.
        return answer.result(0.0)

    def mark(self) -> int:
        """Mark the scene and the panel as they are now, for `Screen.wait_for`."""
        mark = next(self._marks)
        X = RigidTransform([float(mark), 0.0, 0.0])

        def set_mark() -> None:
            self.page.meshcat.SetTransform(f"/{_MARK}", X)
            self.page.patch({_MARK: {"value": mark}})

        self.ask(set_mark)
        return mark

    def look_from(self, camera: Camera) -> None:
        """Put the camera somewhere, and show the program's own things alone."""
        eye, target = np.array(camera.eye), np.array(camera.target)
        self.ask(lambda: place_camera(self.page.meshcat, eye, target))
        for lines in ("/Axes", "/Grid"):
            hide = functools.partial(self.page.meshcat.SetProperty, lines, "visible")
            self.ask(functools.partial(hide, False))

    def end(self) -> None:
        """End it and its page."""
        if not self._running.done():
            self.page.call(self.subject.stop)
        try:
            self._running.result(TIMEOUT)
        finally:
            self._thread.submit(self.page.close).result(TIMEOUT)


@dc.dataclass(frozen=True)
class Screen:
    """A page in a browser."""

    page: BrowserPage

    def widget(self, name: str) -> Locator:
        return self.page.locator(f'[data-id="{name}"]')

    def click(self, name: str) -> None:
        """Click a button, or switch a toggle."""
        widget = self.widget(name)
        box = widget.locator("input[type=checkbox]")
        (box if box.count() else widget).click()

    def choose(self, name: str, option: str) -> None:
        self.widget(name).locator("select").select_option(option)

    def type(self, name: str, number: str) -> None:
        """Type a number beside a slider."""
        field = self.widget(name).locator("input[type=number]")
        field.fill(number)
        field.press("Enter")

    def leave(self) -> None:
        """Take the keyboard from what has it: a number that has it isn't updated."""
        self.page.evaluate("() => document.activeElement.blur()")

    def slide(self, name: str, part: float) -> None:
        """Drag a slider's knob to a part of its range, from 0 to 1."""
        track = self.widget(name).locator("input[type=range]")
        track.scroll_into_view_if_needed()
        box = track.bounding_box()
        assert box is not None
        lower, upper, value = track.evaluate("(t) => [+t.min, +t.max, t.valueAsNumber]")

        def column(part: float) -> float:
            return box["x"] + _KNOB / 2.0 + part * (box["width"] - _KNOB)

        row = box["y"] + box["height"] / 2.0
        mouse = self.page.mouse
        mouse.move(column((value - lower) / (upper - lower)), row)
        mouse.down()
        mouse.move(column(part), row, steps=5)
        mouse.up()

    def resolution(self, name: str) -> float:
        """Return how far a slider goes in one pixel, in its unit."""
        track = self.widget(name).locator("input[type=range]")
        return float(
            track.evaluate(
                "(t, knob) => (t.max - t.min) / (t.clientWidth - knob)", _KNOB
            )
        )

    def number(self, name: str) -> float:
        """Return the number beside a slider."""
        return float(self.widget(name).locator("input[type=number]").input_value())

    def knob(self, name: str) -> float:
        """Return where a slider is."""
        track = self.widget(name).locator("input[type=range]")
        return float(track.evaluate("(t) => t.valueAsNumber"))

    def text(self, name: str) -> str:
        """Return a text's value, or what is written on a button."""
        widget = self.widget(name)
        value = widget.locator(".value, pre, .state")
        return (value if value.count() else widget).inner_text()

    def seconds(self, name: str) -> float:
        """Return the number of a text."""
        return float(self.text(name).split()[0])

    def is_enabled(self, name: str) -> bool:
        widget = self.widget(name)
        inner = widget.locator("input").first
        return (inner if inner.count() else widget).is_enabled()

    def message(self) -> str:
        """Return the message above everything, empty without one."""
        message = self.page.locator("#message")
        return message.inner_text() if message.is_visible() else ""

    def until(self, holds: Callable[[], bool], what: str) -> None:
        """Wait until something is so."""
        deadline = time.monotonic() + TIMEOUT
        while not holds():
            assert time.monotonic() < deadline, f"not within {TIMEOUT:g} s: {what}"
            self.page.wait_for_timeout(_POLL)

    def wait_for(self, mark: int) -> None:
        """Wait until scene and panel are seen as they were when they got a mark.

        They come on two ways, on a busy machine one long after the other.
        """
        self.page.wait_for_function(
            """([name, mark]) => {
                const viewer = document.getElementById("scene").contentWindow.viewer;
                return window[name] === mark
                    && viewer
                    && viewer.scene_tree.find([name]).object.position.x === mark;
            }""",
            arg=[_MARK, mark],
            timeout=1000.0 * TIMEOUT,
        )
        # Not until nothing is to be drawn: news may come faster than it draws.
        self.page.wait_for_function(
            """() => new Promise((done) => {
                requestAnimationFrame(() => requestAnimationFrame(() => done(true)));
            })""",
            timeout=1000.0 * TIMEOUT,
        )

    def picture(self, mark: int | None = None) -> Picture:
        """Return a picture of the scene, once it doesn't change any more.

        Args:
            mark: What must be in it at least.
        """
        if mark is not None:
            self.wait_for(mark)
        deadline = time.monotonic() + TIMEOUT
        previous = b""
        while time.monotonic() < deadline:
            data = self._screenshot()
            if data == previous:
                return _read(data)
            previous = data
        raise AssertionError(f"the scene still changes after {TIMEOUT:g} s")

    def glance(self) -> Picture:
        """Return a picture of the scene as it is."""
        return _read(self._screenshot())

    def _screenshot(self) -> bytes:
        return self.page.screenshot(
            clip={
                "x": _PANEL,
                "y": 0,
                "width": VIEWPORT["width"],
                "height": VIEWPORT["height"],
            }
        )


@contextlib.contextmanager
def look_at(browser: Browser, url: str, **options: object) -> Iterator[Screen]:
    """Open a page in a browser, and close it in the end."""
    context = new_context(browser, **{"viewport": _SIZE, **options})
    try:
        page = context.new_page()
        page.add_init_script(_NOTE_MARK)
        page.goto(url)
        page.wait_for_selector("details", state="attached")  # On phones it is folded.
        yield Screen(page)
    finally:
        context.close()


@contextlib.contextmanager
def run_command(*words: str, port: int) -> Iterator[subprocess.Popen[str]]:
    """Run `arm-drake` until its page is there; kill it in the end."""
    command = [sys.executable, "-u", "-m", "arm_drake", *words, "--port", str(port)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    alarm = threading.Timer(TIMEOUT, process.kill)
    alarm.start()
    try:
        assert process.stdout is not None
        said = []
        for line in process.stdout:  # Ends with the program.
            said.append(line)
            if line.startswith("page: "):
                break
        assert f"page: http://localhost:{port}/" in "".join(said), said
        alarm.cancel()
        yield process
    finally:
        alarm.cancel()
        process.kill()
        process.communicate()


def box(size: str, z: float, colour: str, *, ball: float = 0.0) -> str:
    """Return what is inside a link: a box of 1 kg at a height, and a ball to collide.

    Args:
        size: Its lengths [m].
        z: Height of its middle [m].
        colour: Red, green and blue, from 0 to 1.
        ball: Radius of the ball [m]; 0 for none.
    """
    visual = (
        f'<visual><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry>'
        f'<material name="{colour}"><color rgba="{colour} 1"/></material></visual>'
    )
    collision = (
        f'<collision><origin xyz="0 0 {z}"/><geometry><sphere radius="{ball}"/>'
        "</geometry></collision>"
    )
    inertial = (
        f'<inertial><origin xyz="0 0 {z}"/><mass value="1"/><inertia ixx="0.01" '
        'iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    return visual + (collision if ball else "") + inertial


def free_port() -> int:
    """Return a port that nobody has."""
    with socket.socket() as found:
        found.bind(("localhost", 0))
        return int(found.getsockname()[1])


def red(picture: Picture) -> Mask:
    """Return which pixels are far more red than anything else."""
    return _dominates(picture, 0)


def green(picture: Picture) -> Mask:
    """Return which pixels are far more green than anything else."""
    return _dominates(picture, 1)


def blue(picture: Picture) -> Mask:
    """Return which pixels are far more blue than anything else."""
    return _dominates(picture, 2)


def middle(mask: Mask) -> NDArray[np.float64]:
    """Return the mean column and row of pixels."""
    assert mask.any(), "nothing of it is to be seen"
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def _dominates(picture: Picture, channel: int) -> Mask:
    others = np.delete(picture, channel, axis=2).max(axis=2)
    return picture[:, :, channel] > others + 40


def _read(data: bytes) -> Picture:
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB")).astype(np.int16)
