"""A recording that the command has made, opened as a file."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

from tests.browser.pages import box, middle, red
from tests.browser.pictures import Picture, difference, take_picture
from tests.models import joint, ros2_control, trajectory_controllers
from tests.waiting import PATIENCE

pytestmark = [pytest.mark.browser, pytest.mark.slow]

ROBOT = f"""
<robot name="arm">
  <link name="base"/>
  <link name="upper">{box("0.08 0.08 0.4", 0.2, "1 0 0")}</link>
  {joint("elbow", "base", "upper", xyz="0 0 0.5")}
  {ros2_control("elbow")}
</robot>"""

# Level after a second.
MOTION = """
- {at: 0.0, controller: arm, goal: {joint_names: [elbow],
   points: [{positions: [1.5], time_from_start: 1.0}]}}
"""

# What the command is given [s]; a recording has 30 pictures per second.
DURATION = 1.2
FRAME = 1.0 / 30.0


def picture_at(page: Page, time: float) -> Picture:
    """Return a picture at a time of the recording, set with the page's slider."""
    page.evaluate(
        """(time) => {
            viewer.animator.pause();
            viewer.animator.time_scrubber.setValue(time);
        }""",
        time,
    )
    return take_picture(page)


def test_a_recording_of_the_command_plays_as_a_file(page: Page, tmp_path: Path) -> None:
    files = {
        "arm.urdf": ROBOT,
        "controllers.yaml": trajectory_controllers({"arm": ["elbow"]}),
        "motion.yaml": MOTION,
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    words = ["sim", "arm.urdf", "--controllers", "controllers.yaml", "--headless"]
    words += ["--motion", "motion.yaml", "--duration", str(DURATION)]
    words += ["--trail", "upper", "--record", "film.html"]
    subprocess.run(
        [sys.executable, "-m", "arm_drake", *words],
        cwd=tmp_path,
        check=True,
        timeout=PATIENCE,
        capture_output=True,
    )

    page.goto((tmp_path / "film.html").as_uri())

    page.wait_for_function("() => viewer.animator.duration > 0")
    assert page.evaluate("viewer.animator.duration") == pytest.approx(
        DURATION, abs=FRAME
    )
    page.evaluate(
        """() => {
            for (const name of ["Axes", "Grid"])
                viewer.scene_tree.find([name]).object.visible = false;
        }"""
    )
    first, half, last = (picture_at(page, time) for time in (0.0, 0.5, 1.1))
    again = picture_at(page, 0.0)
    assert not difference(first, again).any()
    assert difference(first, last).mean() > 0.01
    # Upright at first, in the middle of its way after half of the time, then level: its
    # end goes down, and to the side where x is.
    upright, oblique, level = (
        np.ptp(np.nonzero(red(p)), axis=1) for p in (first, half, last)
    )
    assert upright[0] > 2.0 * upright[1]
    assert level[0] < 0.7 * upright[0]
    assert oblique[0] > level[0]
    rows = [middle(red(picture))[1] for picture in (first, half, last)]
    assert rows == sorted(rows)
