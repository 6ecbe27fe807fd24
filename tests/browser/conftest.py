"""A headless Chromium, and a real robot to look at in it."""

import concurrent.futures
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.visualization.screenshot import BrowserError, open_browser
from tests.browser.pictures import new_context
from tests.robots import real_robot, skip_or_fail
from tests.waiting import PATIENCE

expect.set_options(timeout=1000.0 * PATIENCE)


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
    with contextlib.ExitStack() as stack:
        try:
            browser = stack.enter_context(open_browser())
        except BrowserError as error:
            skip_or_fail(str(error))
        yield browser


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    context = new_context(browser)
    yield context.new_page()
    context.close()


@pytest.fixture(scope="package")
def program_thread() -> Iterator[concurrent.futures.ThreadPoolExecutor]:
    """Where programs with a page run, one after the other: a page needs its thread."""
    with concurrent.futures.ThreadPoolExecutor(1, "program") as thread:
        yield thread


@pytest.fixture(scope="package")
def doosan() -> Path:
    return real_robot("doosan_a0912/my_doosan_pkg/description/xacro/a0912.urdf.xacro")
