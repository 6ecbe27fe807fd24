"""A recording that the command has made, opened as a file."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.browser.pages import box, middle, red
from tests.browser.pictures import bar_widget, difference, picture_at
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


def shown_time(page: Page) -> float:
    """Return where the knob of the time bar is [s]."""
    knob = bar_widget(page, "time").locator("input[type=range]")
    return float(knob.evaluate("(range) => range.valueAsNumber"))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp_path = tmp_path_factory.mktemp("film")
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

    return tmp_path / "film.html"


def test_a_recording_of_the_command_plays_as_a_file(page: Page, film: Path) -> None:
    page.goto(film.as_uri())

    # By itself, once.
    expect(page).to_have_title("arm")
    expect(bar_widget(page, "play")).to_have_text("pause")
    expect(bar_widget(page, "play")).to_have_text("play", timeout=1000.0 * PATIENCE)
    assert shown_time(page) == pytest.approx(DURATION, abs=FRAME)
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


# One command of the scene waits until the test lets it go.
HOLD_A_COMMAND = """
    const fetch_now = window.fetch;
    let count = 0;
    window.num_waiting = 0;
    window.fetch = async (...given) => {
        ++num_waiting;
        if (++count === 9) await new Promise((done) => { window.release = done; });
        const answer = await fetch_now(...given);
        --num_waiting;
        return answer;
    };
"""

# Until the page has drawn twice what it has by now.
TWO_FRAMES = """() => new Promise(
    (done) => requestAnimationFrame(() => requestAnimationFrame(done)))"""


def test_a_recording_waits_for_all_of_its_scene(page: Page, film: Path) -> None:
    page.add_init_script(HOLD_A_COMMAND)
    page.goto(film.as_uri())
    page.wait_for_function("() => viewer.animator.duration > 0 && num_waiting === 1")
    page.evaluate(TWO_FRAMES)

    assert bar_widget(page, "play").inner_text() == "loading…"
    assert bar_widget(page, "play").is_disabled()
    assert shown_time(page) == 0.0

    page.evaluate("() => release()")
    expect(bar_widget(page, "play")).to_have_text("pause")


def test_a_recording_loops_if_asked(page: Page, film: Path) -> None:
    page.emulate_media(color_scheme="dark")
    page.goto(film.as_uri())
    # So is what is behind the robot.
    page.wait_for_function(
        """() => viewer.scene_tree.find(["Background", "<object>"]).object
            .top_color.r < 80"""
    )
    bar_widget(page, "rate").locator("select").select_option("5 ×")
    # It has ended.
    expect(bar_widget(page, "play")).to_have_text("play")
    bar_widget(page, "loop").locator("input").check()

    # It goes back to the start, and on, and again.
    page.wait_for_function(
        """() => new Promise((done) => {
            let before = 0;
            const look = () => {
                const {time} = viewer.animator.actions[0];
                if (time < before - 0.3) done(true);
                before = time;
                requestAnimationFrame(look);
            };
            look();
        })"""
    )
    assert bar_widget(page, "play").inner_text() == "pause"
    bar_widget(page, "play").click()
    expect(bar_widget(page, "play")).to_have_text("play")
