"""Pictures of the pages of the bundled robots: `python -m tests.page_pictures OUT`.

For developers who want to see what a change does to what people see.
"""

import argparse
import contextlib
import dataclasses as dc
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from playwright.sync_api import Browser, Page, ViewportSize

from arm_drake.visualization.screenshot import open_browser

_SIZE = ViewportSize(width=1100, height=750)
_SCALE = 0.5
_LABEL = 24  # pixels

# A busy machine needs long to load a robot and to draw it without a GPU [s].
_TIMEOUT = 120.0

# What is drawn stays as it is for so long [s].
_CALM = 1.0


@dc.dataclass(frozen=True)
class _Example:
    """A bundled robot in motion."""

    robot: str
    motion: str

    # Simulated time from which on the picture is taken [s], in the midst of the motion.
    time: float

    # Link whose way is drawn.
    trail: str


_EXAMPLES = (
    _Example("doosan_a0912", "tutorial", 2.2, "link6"),
    _Example("mycobot_280", "ping_pong", 1.2, "gripper_base"),
    _Example("centauri", "ramp", 1.2, "tool_center"),
    _Example("lab5_arm", "control", 1.5, "arm3_link"),
    _Example("teslabot", "air_curls", 1.5, "hand_left"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", metavar="OUT", type=Path, help="folder to write to")
    parser.add_argument("names", metavar="NAME", nargs="*", help="only these robots")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    examples = [e for e in _EXAMPLES if not options.names or e.robot in options.names]
    rows: dict[str, list[Image.Image]] = {}
    with open_browser() as browser:
        for example in examples:
            for name, words in commands(example).items():
                print(example.robot, name, flush=True)
                file = options.output / f"{example.robot}_{name}.png"
                after = example.time if name == "sim" else None
                with serve(words) as url:
                    take_picture(browser, url, file, after)
                label = f"{example.robot}, {name}"
                rows.setdefault(name, []).append(make_tile(file, label))
    paste(list(rows.values())).save(options.output / "sheet.png")


def commands(example: _Example) -> dict[str, list[str]]:
    """Return the words of `arm-drake` for each picture of a robot."""
    robot = example.robot
    sim = [
        "sim",
        robot,
        "--motion",
        example.motion,
        "--duration",
        "600",
        "--rate",
        "0.5",
    ]
    return {
        "view": ["view", robot],
        "sim": [*sim, "--ghost", "--trail", example.trail],
        "frames": ["view", robot, "--show", "visual,frames,names"],
        "collision": ["view", robot, "--show", "collision"],
    }


@contextlib.contextmanager
def serve(words: list[str]) -> Iterator[str]:
    """Run a command with a page, and yield the page's address."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-u", "-m", "arm_drake", *words, "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    alarm = threading.Timer(_TIMEOUT, process.kill)
    alarm.start()
    try:
        assert process.stdout is not None
        # It ends when the program does.
        for line in process.stdout:
            if line.startswith("page: "):
                alarm.cancel()
                yield line.split()[1].rstrip(",")
                return
        raise RuntimeError(f"no page: {' '.join(words)}")
    finally:
        alarm.cancel()
        process.terminate()
        process.communicate()


def take_picture(browser: Browser, url: str, file: Path, after: float | None) -> None:
    """Write a picture of a page.

    Args:
        browser: What opens it.
        url: Its address.
        file: PNG file to write.
        after: Simulated time to wait for [s]; None to wait until nothing changes.
    """
    context = browser.new_context(viewport=_SIZE)
    try:
        page = context.new_page()
        page.goto(url)
        if after is not None:
            page.wait_for_function(
                """(time) => {
                    const text = document.querySelector("[data-id='time'] .value");
                    return text && parseFloat(text.textContent) >= time;
                }""",
                arg=after,
                timeout=1000.0 * _TIMEOUT,
            )
            page.screenshot(path=file)
        else:
            wait_until_calm(page, file)
    finally:
        context.close()


def wait_until_calm(page: Page, file: Path) -> None:
    """Take pictures of a page until it stays as it is."""
    before, since = b"", time.monotonic()
    deadline = since + _TIMEOUT
    while time.monotonic() - since < _CALM and time.monotonic() < deadline:
        data = page.screenshot(path=file)
        if data != before:
            before, since = data, time.monotonic()
        page.wait_for_timeout(200.0)


def make_tile(file: Path, label: str) -> Image.Image:
    """Return a smaller picture with a name under it."""
    with Image.open(file) as image:
        size = tuple(round(_SCALE * side) for side in image.size)
        picture = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    tile = Image.new("RGB", (size[0], size[1] + _LABEL), "white")
    tile.paste(picture, (0, 0))
    font = ImageFont.load_default(size=16)
    draw = ImageDraw.Draw(tile)
    draw.text((size[0] / 2, size[1] + 2), label, "black", font, anchor="ma")
    return tile


def paste(rows: list[list[Image.Image]]) -> Image.Image:
    """Return rows of tiles of one size as one picture."""
    width, height = rows[0][0].size
    sheet = Image.new("RGB", (max(map(len, rows)) * width, len(rows) * height), "white")
    for y, row in enumerate(rows):
        for x, tile in enumerate(row):
            sheet.paste(tile, (x * width, y * height))
    return sheet


if __name__ == "__main__":
    main()
