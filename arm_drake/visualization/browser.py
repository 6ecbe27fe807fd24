"""A headless Chromium, which draws Meshcat's page without a screen."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

from arm_drake.errors import ArmDrakeError, MissingExtraError

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Playwright

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
    """There is no browser, or it does not do its work."""


def check_installed() -> None:
    """Raise MissingExtraError if the extra `browser` isn't installed."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        raise MissingExtraError("a picture of the page", "browser") from None


@contextlib.contextmanager
def open_browser() -> Iterator["Browser"]:
    """Start a headless Chromium and close it in the end.

    Raises:
        MissingExtraError: If the extra `browser` isn't installed.
        BrowserError: If there is no Chromium, or it doesn't start.
    """
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
