"""Recordings: what was drawn, as one page that plays in any browser."""

import html
import json
from pathlib import Path

from pydrake.geometry import Meshcat

from arm_drake.output_files import writing

_STATIC = Path(__file__).parent / "page" / "static"

# What Drake's page has: what stands above it, and what does a command of the scene.
_TITLE = "<title>Drake MeshCat</title>"
_COMMAND = "viewer.handle_command_bytearray("


def start_recording(meshcat: Meshcat, frame_rate: float) -> None:
    """Record what is drawn from now on, at a rate [Hz], and nothing of before."""
    meshcat.DeleteRecording()
    # Meshcat rounds a time down to a picture's: 0.9999... pictures would be none.
    rate = frame_rate * (1.0 + 1e-9)
    meshcat.StartRecording(rate, set_visualizations_while_recording=True)


def make_recording(meshcat: Meshcat, title: str, *, loop: bool = False) -> str:
    """End a recording and return it: a page of HTML that needs nothing else.

    It plays when all of it is drawn, with a time bar, and in a loop if wanted.
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = meshcat.StaticHtml()
    settings = json.dumps({"commands": page.count(_COMMAND), "loop": loop})
    style, widgets, scene, script = (
        (_STATIC / name).read_text(encoding="utf-8")
        for name in ("panel.css", "widgets.js", "scene.js", "recording.js")
    )
    head = (
        f"<title>{html.escape(title)}</title>\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>\n{style}</style>\n<script>\n{widgets}</script>\n<script>\n{scene}</script>\n"
        f'<script data-settings="{html.escape(settings)}">\n{script}</script>'
    )
    assert _TITLE in page
    return page.replace(_TITLE, head, 1)


def save_recording(
    meshcat: Meshcat, path: Path, title: str, *, loop: bool = False
) -> None:
    """Write a page of `make_recording`."""
    page = make_recording(meshcat, title, loop=loop)
    with writing(path):
        path.write_text(page, encoding="utf-8")
