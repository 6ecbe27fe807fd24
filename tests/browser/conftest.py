"""A headless Chromium, and a real robot to look at in it."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright
from pydrake.geometry import Meshcat

import arm_drake as ad
from tests.browser.pictures import VIEWPORT
from tests.robots import real_robot, skip_or_fail

_CHROMIUM = ("chromium", "chromium-browser", "google-chrome")

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


@pytest.fixture(scope="package")
def start_meshcat() -> Callable[[], Meshcat]:
    """Starts a Meshcat, which stays until the browser is closed.

    A Meshcat that Python destroys while its server answers a page's request may hang:
    the server's thread logs, for which it needs Python's lock, and is waited for by
    Drake's destructor, which has it.
    """
    kept = []

    def start() -> Meshcat:
        kept.append(ad.start_meshcat())
        return kept[-1]

    return start


# Not of session scope: while Playwright runs, this thread has an event loop, in which
# tests elsewhere could not start their own.
@pytest.fixture(scope="package")
def browser(start_meshcat: Callable[[], Meshcat]) -> Iterator[Browser]:
    path = next(filter(None, map(shutil.which, _CHROMIUM)), None)
    if path is None:
        skip_or_fail("Chromium is not installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, args=list(_ARGUMENTS)
        )
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport=VIEWPORT)
    yield context.new_page()
    context.close()


@pytest.fixture(scope="package")
def doosan() -> Path:
    return real_robot("doosan_a0912/my_doosan_pkg/description/xacro/a0912.urdf.xacro")
