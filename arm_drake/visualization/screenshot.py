"""Pictures of a Meshcat scene, taken in a headless browser."""

import base64
import concurrent.futures
import contextlib
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pydrake.geometry import Meshcat

from arm_drake.arrays import Array
from arm_drake.errors import ArmDrakeError, MissingExtraError
from arm_drake.output_files import check_suffix, writing
from arm_drake.visualization.meshcat import THREE_QUARTER, Camera, View, grid_scale

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Playwright

_NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)

_ARGUMENTS = (
    "--no-sandbox",
    # WebGL on the processor. The older --use-gl=swiftshader draws nothing.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # The page around the scene is drawn by the processor itself, as it draws fastest.
    "--disable-gpu-compositing",
    "--hide-scrollbars",
    # Without these, Chromium itself calls home.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-domain-reliability",
    "--disable-sync",
    "--no-first-run",
    "--no-pings",
)


class BrowserError(ArmDrakeError):
    """A browser is missing, or it does not do its work."""


def check_installed() -> None:
    """Raise MissingExtraError if the extra `browser` isn't installed."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        raise MissingExtraError("a picture of the page", "browser") from None


@contextlib.contextmanager
def open_browser() -> Iterator["Browser"]:
    """Start a headless Chromium and close it in the end."""
    check_installed()
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        path = _find_chromium(playwright)
        try:
            browser = playwright.chromium.launch(
                executable_path=path,
                args=list(_ARGUMENTS),
                # With Ctrl-C it would be gone before what it draws is saved.
                handle_sigint=False,
            )
        except Error as error:
            reason = " ".join(error.message.split())
            raise BrowserError(f"{path} does not start: {reason}") from None
        try:
            yield browser
        finally:
            browser.close()


def _find_chromium(playwright: "Playwright") -> str:
    installed = next(filter(None, map(shutil.which, _NAMES)), None)
    path = installed or playwright.chromium.executable_path
    if not os.path.isfile(path):
        raise BrowserError(
            "no Chromium is found, which takes the picture; on Debian and Ubuntu "
            "`apt install chromium`, elsewhere `playwright install chromium`"
        )
    return path


Result = TypeVar("Result")

SCREENSHOT_SUFFIXES = (".png",)

# Width and height [pixels].
DEFAULT_SIZE = (1280, 960)

# Vertical field of view [rad]: that of a person in front of a photograph. Meshcat's own
# 75° distorts what is close.
FIELD_OF_VIEW = np.deg2rad(35.0)

# Meshcat's lamps are set up for something of this diameter [m].
_LIT_DIAMETER = 1.5
# A single point is lit as if it were of this size [m].
_SMALLEST = 1e-3

# A scene is drawn within seconds; a busy machine gets more [s].
_TIMEOUT = 60.0
_POLL = 0.02

# Works in the page.
_SCRIPT = Path(__file__).with_suffix(".js")

# Nothing is there; its deletion is the last change of the page.
_LAST_CHANGE = "arm_drake_last_change"


class Photographer:
    """A headless browser that takes pictures of Meshcat scenes, one after the other.

    It works in a thread of its own: notebooks have an event loop, beside which that of
    Playwright can't be. Use it in a `with` statement.
    """

    def __init__(self) -> None:
        """Create it; the browser starts with the `with` statement."""
        self._stack = contextlib.ExitStack()
        self._thread = concurrent.futures.ThreadPoolExecutor(1)

    def __enter__(self) -> "Photographer":
        """Start the browser, or raise MissingExtraError or BrowserError."""
        try:
            self._browser = self._thread.submit(
                self._stack.enter_context, open_browser()
            ).result()
        except BaseException:
            self._thread.shutdown()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """Close the browser."""
        self._thread.submit(self._stack.close).result()
        self._thread.shutdown()

    def take_picture(
        self,
        meshcat: Meshcat,
        *,
        size: tuple[int, int] = DEFAULT_SIZE,
        paths: Sequence[str] = ("drake/visual",),
        direction: tuple[float, float, float] = THREE_QUARTER,
    ) -> tuple[bytes, Camera]:
        """Return a picture of a scene, a PNG file, and where it was taken from.

        The camera goes where it sees all below `paths`, in this picture only, of a size
        [pixels]. `direction` is from what is seen to the camera, of any length; not
        vertical. It raises BrowserError if the scene isn't drawn, or there is nothing.
        """
        view = View(FIELD_OF_VIEW, size[0] / size[1], direction=direction)

        def work(page: "Page") -> tuple[bytes, Camera]:
            camera = set_up(page, view, find_extremes(page, view, paths), size)
            uri = page.evaluate("([w, h]) => viewer.capture_image(w, h)", list(size))
            return base64.b64decode(uri.partition(",")[2]), camera

        return self.wait(meshcat, self.begin(meshcat, work, size))

    def begin(
        self, meshcat: Meshcat, work: Callable[["Page"], Result], size: tuple[int, int]
    ) -> "concurrent.futures.Future[Result]":
        """Begin to work with a page of a size [pixels]; `wait` ends it.

        The work is called in the browser's thread when all of the scene is drawn.
        """
        url = meshcat.web_url()
        return self._thread.submit(_work, self._browser, url, work, size)

    def wait(
        self,
        meshcat: Meshcat,
        task: "concurrent.futures.Future[Result]",
        tell: Callable[[], None] = lambda: None,
    ) -> Result:
        """Return what the task of `begin` has come to, telling until it is done.

        It raises BrowserError if the browser doesn't draw the scene.
        """
        while not task.done():
            # A page that isn't connected yet misses it; later it comes after all else.
            meshcat.Delete(_LAST_CHANGE)
            concurrent.futures.wait([task], _POLL)
            tell()
        return task.result()


def save_screenshot(
    meshcat: Meshcat,
    path: Path,
    *,
    size: tuple[int, int] = DEFAULT_SIZE,
    paths: Sequence[str] = ("drake/visual",),
    photographer: Photographer | None = None,
) -> Camera:
    """Write a picture of a Meshcat scene as PNG and return where it was taken from.

    The size is [pixels], `paths` are what of the scene must be in the picture. For
    several pictures a photographer is given, else there is a new one.
    """
    check_suffix(path, "a screenshot", SCREENSHOT_SUFFIXES)
    with contextlib.ExitStack() as stack:
        if photographer is None:
            photographer = stack.enter_context(Photographer())
        picture, camera = photographer.take_picture(meshcat, size=size, paths=paths)
    with writing(path):
        path.write_bytes(picture)
    return camera


def find_extremes(page: "Page", view: View, paths: Sequence[str]) -> Array:
    """Return what decides where a camera must be: the farthest points, shape (6, 3).

    They are in the world [m]. It is a BrowserError if there is nothing to be seen.
    """
    extremes = page.evaluate(
        "([paths, directions]) => arm_drake.find_extremes(paths, directions)",
        [[path.split("/") for path in paths], view.normals().tolist()],
    )
    if not extremes:
        raise BrowserError("no picture: nothing of the robot is to be seen")
    return np.array(extremes)


def set_up(page: "Page", view: View, points: Array, size: tuple[int, int]) -> Camera:
    """Make camera, lamps and grid of a page suit some points, once.

    The points are what must be in the picture, in the world [m], shape (n, 3).
    """
    camera = view.camera_for(points)
    diameter = max(float(np.linalg.norm(np.ptp(points, axis=0))), _SMALLEST)
    page.evaluate(
        "(how) => arm_drake.set_up(how)",
        {
            "eye": camera.eye,
            "target": camera.target,
            "field_of_view": np.rad2deg(view.field_of_view),
            "scale": diameter / _LIT_DIAMETER,
            "grid": grid_scale(diameter),
            "width": size[0],
            "height": size[1],
        },
    )
    return camera


def _work(
    browser: "Browser",
    url: str,
    work: Callable[["Page"], Result],
    size: tuple[int, int],
) -> Result:
    from playwright.sync_api import Error

    try:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]})
        try:
            page = context.new_page()
            page.add_init_script(path=_SCRIPT)
            page.goto(url)
            _wait_until_drawn(page)
            return work(page)
        finally:
            context.close()
    except Error as error:
        reason = " ".join(error.message.split())
        raise BrowserError(f"the browser can't draw {url}: {reason}") from None


def _wait_until_drawn(page: "Page") -> None:
    """Wait until a page has the scene, and all of it is drawn."""
    deadline = time.monotonic() + _TIMEOUT
    while True:
        is_complete, waiting = page.evaluate("() => arm_drake.progress()")
        if is_complete and not waiting:
            return
        if time.monotonic() > deadline:
            what = f"draws no {waiting[0]}" if waiting else "does not get the scene"
            raise BrowserError(f"{page.url}: the page {what} within {_TIMEOUT:g} s")
        page.wait_for_timeout(1000.0 * _POLL)
