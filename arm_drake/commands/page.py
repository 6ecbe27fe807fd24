"""Pages of the commands: their start, the way to them, and their end by Ctrl-C."""

import argparse
import contextlib
import getpass
import os
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator

import numpy as np

from arm_drake.visualization.meshcat import place_camera as put_camera
from arm_drake.visualization.page import Page, Scene


def start_page(options: argparse.Namespace) -> Page:
    """Start a page at the requested address, and print warnings about it."""
    page = Page(host=options.host or "localhost", port=options.port)
    if page.has_moved:
        text = f"port {options.port} is taken; the page is on port {page.port}"
        print(f"warning: {text}", file=sys.stderr)
    if page.is_public:
        text = "whoever reaches this machine can open the page, and move the robot"
        print(f"warning: {text}", file=sys.stderr)
    return page


def remote_hint(page: Page) -> str:
    """Return how to open a page of this machine from another one, where that is likely.

    It is "" where there is a screen, or where others can open the page.
    """
    if page.is_public or not is_without_screen():
        return ""
    return f"from another machine: {ssh_command(page.port)}"


def place_camera(options: argparse.Namespace, page: Scene) -> None:
    """Put the camera where RViz's configuration has it, if there is one."""
    camera = getattr(options, "camera", None)
    if camera is not None:
        eye, target = map(np.array, camera)
        put_camera(page.meshcat, eye, target)


def is_watched() -> bool:
    """Return whether a person looks on: on a terminal, and not in CI."""
    return sys.stdin.isatty() and sys.stdout.isatty() and not os.environ.get("CI")


def open_browser(options: argparse.Namespace, page: Page) -> None:
    """Open a page in a browser, if requested or if a person sits before it."""
    opens = options.open
    if opens is None:
        opens = is_watched() and not is_without_screen()
    if opens and not webbrowser.open(page.url) and options.open:
        print(f"warning: there is no browser to open {page.url}", file=sys.stderr)


def is_without_screen() -> bool:
    """Return whether whoever started the command looks from another machine."""
    names = ("DISPLAY", "WAYLAND_DISPLAY")
    is_headless = sys.platform == "linux" and not any(map(os.environ.get, names))
    return is_headless or "SSH_CONNECTION" in os.environ


def ssh_command(port: int) -> str:
    """Return the command that brings a page, by its port, to another machine."""
    # Where the session's user came from knows this machine by this address.
    address = os.environ.get("SSH_CONNECTION", "").split()
    host = address[2] if len(address) == 4 else socket.gethostname()
    return f"ssh -L {port}:localhost:{port} {getpass.getuser()}@{host}"


@contextlib.contextmanager
def interrupting(stop: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Let the first Ctrl-C end something in good order; the second one ends at once.

    What it yields says whether there was one.
    """
    interrupted = threading.Event()

    def take(*signal_and_frame: object) -> None:
        if interrupted.is_set():
            raise KeyboardInterrupt
        interrupted.set()
        stop()

    before = signal.signal(signal.SIGINT, take)
    try:
        yield interrupted.is_set
    finally:
        signal.signal(signal.SIGINT, before)
