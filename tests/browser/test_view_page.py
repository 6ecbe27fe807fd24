"""The page of `arm-drake view`, used as a person does, in Chromium.

What must be seen follows from the robot's measures and a pinhole camera.
"""

import concurrent.futures
import contextlib
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from playwright.sync_api import Browser, expect
from pydrake.geometry import Box

import arm_drake as ad
from arm_drake.visualization.page.camera import CameraPart
from arm_drake.visualization.page.robot_viewer import RobotViewer
from tests.browser.pages import (
    Program,
    Screen,
    blue,
    box,
    free_port,
    green,
    look_at,
    middle,
    red,
    run_command,
)
from tests.browser.pictures import Camera, difference

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# Looks along y: a link that turns about y turns in the picture, clockwise.
CAMERA = Camera(eye=(0.0, -1.5, 0.5), target=(0.0, 0.0, 0.5))

# The elbow is so high above the ground, and the upper arm so long [m].
ELBOW, UPPER = 0.5, 0.4

# What is seen of a box is its front and one side, whose middle is not the box's: up to
# half of its depth nearer, 3 % of the picture's half, and up to half a width aside.
AWAY = 20.0  # pixels


def painted(upper: str = "1 0 0") -> str:
    """Return a tower that turns about z, a red arm on it, a green one that follows."""
    return f"""
<robot name="painted">
  <link name="base"/>
  <link name="tower">{box("0.1 0.1 0.5", 0.25, "0.2 0.2 0.2", ball=0.12)}</link>
  <link name="upper">{box(f"0.08 0.08 {UPPER}", UPPER / 2.0, upper, ball=0.12)}</link>
  <link name="tip"/>
  <link name="follower">{box("0.06 0.06 0.3", 0.15, "0 1 0", ball=0.12)}</link>
  <joint name="turn" type="continuous">
    <parent link="base"/><child link="tower"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="tower"/><child link="upper"/>
    <origin xyz="0 0 {ELBOW}"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="upper"/><child link="tip"/><origin xyz="0 0 {UPPER}"/>
  </joint>
  <joint name="half" type="revolute">
    <parent link="tower"/><child link="follower"/>
    <origin xyz="-0.3 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="1"/>
    <mimic joint="elbow" multiplier="-0.5" offset="0.1"/>
  </joint>
</robot>"""


POSES = """
<robot name="painted">
  <group_state name="bent" group="arm"><joint name="elbow" value="1.5"/></group_state>
  <group_state name="home" group="arm">
    <joint name="elbow" value="0"/><joint name="turn" value="0"/>
  </group_state>
</robot>"""


def upper_at(elbow: float, part: float = 0.5) -> NDArray[np.float64]:
    """Return where a part of the upper arm is in the picture, column and row."""
    place = part * UPPER * np.array([math.sin(elbow), 0.0, math.cos(elbow)])
    (pixel,) = CAMERA.project((place + np.array([0.0, 0.0, ELBOW]))[None])
    return pixel


def is_near(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool(np.linalg.norm(one - other) < AWAY)


def write(file: Path, text: str) -> None:
    """Write a file as editors do: a new one takes its place, whole."""
    new = file.with_suffix(".new")
    new.write_text(text, encoding="utf-8")
    new.replace(file)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("painted")
    file = folder / "painted.urdf"
    file.write_text(painted(), encoding="utf-8")
    (folder / "painted.srdf").write_text(POSES, encoding="utf-8")
    (folder / "package.xml").write_text("<package><name>painted</name></package>")
    return file


@pytest.fixture(scope="module")
def viewer(
    program_thread: concurrent.futures.ThreadPoolExecutor, file: Path
) -> Iterator[Program[RobotViewer]]:
    program = Program(
        program_thread,
        lambda page: RobotViewer(page, lambda: ad.load_robot(file, controllers=[])),
    )
    try:
        program.look_from(CAMERA)
        yield program
    finally:
        program.end()


@pytest.fixture(scope="module")
def window(browser: Browser, viewer: Program[RobotViewer]) -> Iterator[Screen]:
    """Opened once: a page without a graphics card takes seconds to begin."""
    with look_at(browser, viewer.page.url) as screen:
        yield screen


@pytest.fixture
def program(viewer: Program[RobotViewer]) -> Program[RobotViewer]:
    """Return the program as it was at its start."""

    def restore() -> None:
        viewer.subject.center()
        viewer.subject.hide_ghost()
        viewer.subject.set_fixed_frame("world")
        for what in ("visual", "frames", "names", "collision", "inertia", "joint_axes"):
            viewer.subject.show(what, what == "visual")

    viewer.ask(restore)
    return viewer


@pytest.fixture
def screen(window: Screen, program: Program[RobotViewer]) -> Screen:
    window.wait_for(program.mark())
    window.leave()
    return window


def positions(program: Program[RobotViewer]) -> dict[str, float]:
    return program.ask(lambda: program.subject.positions)


def wait_for_joint(
    program: Program[RobotViewer],
    screen: Screen,
    joint: str,
    position: float,
    tolerance: float = 1e-9,
) -> int:
    """Wait until a joint is somewhere, and return a mark of the scene."""
    screen.until(
        lambda: abs(positions(program)[joint] - position) <= tolerance,
        f"{joint} at {position}",
    )
    return program.mark()


def test_a_slider_that_is_dragged_moves_its_link(
    program: Program[RobotViewer], screen: Screen
) -> None:
    before = screen.picture()

    screen.slide("joint:elbow", 0.8)

    # From -1 to 2 rad. The knob is put down within a pixel of it.
    resolution = screen.resolution("joint:elbow")
    mark = wait_for_joint(program, screen, "elbow", 1.4, 2.0 * resolution)
    elbow = positions(program)["elbow"]
    after = screen.picture(mark)
    assert is_near(middle(red(before)), upper_at(0.0))
    assert is_near(middle(red(after)), upper_at(elbow))
    assert screen.number("joint:elbow") == pytest.approx(elbow, abs=5e-5)
    said = yaml.safe_load(screen.text("pose"))
    assert said["elbow"] == pytest.approx(elbow, abs=1e-4)


def test_the_keyboard_moves_a_slider_to_its_ends(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.widget("joint:elbow").locator("input[type=range]").focus()

    screen.page.keyboard.press("End")
    mark = wait_for_joint(program, screen, "elbow", 2.0)
    upper = screen.picture(mark)
    screen.page.keyboard.press("Home")
    mark = wait_for_joint(program, screen, "elbow", -1.0)
    lower = screen.picture(mark)

    assert is_near(middle(red(upper)), upper_at(2.0))
    assert is_near(middle(red(lower)), upper_at(-1.0))


@pytest.mark.parametrize(
    ("joint", "typed", "position"),
    [
        ("elbow", "0.75", 0.75),
        ("elbow", "100", 2.0),
        ("elbow", "-100", -1.0),
        # It turns without end.
        ("turn", "4", 4.0 - 2.0 * math.pi),
    ],
)
def test_a_typed_number_ends_within_the_range(
    program: Program[RobotViewer],
    screen: Screen,
    joint: str,
    typed: str,
    position: float,
) -> None:
    screen.type(f"joint:{joint}", typed)

    wait_for_joint(program, screen, joint, position)
    screen.widget(f"joint:{joint}").locator("input[type=number]").blur()
    screen.until(
        lambda: screen.number(f"joint:{joint}") == pytest.approx(position, abs=1e-4),
        "the number is that of the joint",
    )
    assert screen.knob(f"joint:{joint}") == pytest.approx(position)


def test_a_joint_that_follows_cannot_be_moved_and_follows(
    program: Program[RobotViewer], screen: Screen
) -> None:
    before = screen.picture()

    screen.type("joint:elbow", "2")

    mark = wait_for_joint(program, screen, "half", 0.1 - 0.5 * 2.0)
    after = screen.picture(mark)
    assert not screen.is_enabled("joint:half")
    assert screen.is_enabled("joint:elbow")
    assert screen.number("joint:half") == pytest.approx(-0.9)
    # From 0.1 to -0.9 rad about y: its middle goes to the left, and down.
    moved = middle(green(after)) - middle(green(before))
    scale = np.linalg.norm(upper_at(0.0, 1.0) - upper_at(0.0, 0.0)) / UPPER
    wanted = 0.15 * scale * np.array([math.sin(-0.9) - math.sin(0.1), 0.0])
    wanted[1] = -0.15 * scale * (math.cos(-0.9) - math.cos(0.1))
    assert is_near(moved, wanted)


def test_random_positions_and_back_to_the_center(
    program: Program[RobotViewer], screen: Screen
) -> None:
    start = screen.picture()

    screen.click("randomize")
    screen.until(lambda: positions(program)["elbow"] != 0.0, "it is somewhere else")
    random = positions(program)
    elsewhere = screen.picture(program.mark())
    screen.click("center")
    mark = wait_for_joint(program, screen, "elbow", 0.0)
    back = screen.picture(mark)

    assert -1.0 < random["elbow"] < 2.0
    assert abs(random["turn"]) <= math.pi
    assert screen.knob("joint:turn") == 0.0
    assert difference(start, elsewhere).any()
    assert not difference(start, back).any()


def test_keys_do_what_buttons_do(program: Program[RobotViewer], screen: Screen) -> None:
    screen.page.keyboard.press("r")
    screen.until(lambda: positions(program)["elbow"] != 0.0, "it is somewhere else")

    # Also where the scene has the keyboard, or a slider that was moved.
    screen.page.frame_locator("#scene").locator("canvas").first.click()
    screen.page.keyboard.press("c")
    wait_for_joint(program, screen, "elbow", 0.0)
    screen.slide("joint:elbow", 1.0)
    wait_for_joint(program, screen, "elbow", 2.0)
    screen.page.keyboard.press("c")

    wait_for_joint(program, screen, "elbow", 0.0)


def test_names_stand_beside_the_frames(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.type("joint:elbow", "1")
    wait_for_joint(program, screen, "elbow", 1.0)
    bare = screen.picture(program.mark())

    screen.click("show:names")

    labels = screen.page.locator("#labels span")
    screen.until(lambda: labels.count() == 5, "five names")
    drawn = screen.picture(program.mark())
    places = {}
    for label in labels.all():
        place = label.bounding_box()
        assert place is not None
        places[label.inner_text()] = (place["x"], place["y"] + place["height"] / 2.0)
    scene = screen.page.locator("#scene").bounding_box()
    assert scene is not None
    origins = {
        "base": (0.0, 0.0),
        "tower": (0.0, 0.0),
        "upper": (0.0, ELBOW),
        "tip": (UPPER * math.sin(1.0), ELBOW + UPPER * math.cos(1.0)),
        "follower": (-0.3, 0.2),
    }
    assert places.keys() == origins.keys()
    for name, (x, z) in origins.items():
        (pixel,) = CAMERA.project(np.array([[x, 0.0, z]]))
        # They begin to the right of the frame, at its height; where two are in the same
        # place, one of them is a line below.
        right, down = np.array(places[name]) - [scene["x"], scene["y"]] - pixel
        assert 0.0 <= right < 15.0, name
        assert abs(down) < (30.0 if name == "tower" else 10.0), name
    assert places["tower"][1] - places["base"][1] > 10.0
    assert difference(bare, drawn).any()

    # Also where two in one place reach across row 512, at which sums are rounded.
    for distance in np.linspace(1.045, 1.125, 10):
        program.look_from(Camera(eye=(0.0, -distance, 0.5), target=(0.0, 0.0, 0.5)))
        screen.wait_for(program.mark())
    program.look_from(CAMERA)

    # Names without frames would be names of nothing.
    screen.click("show:frames")

    names = screen.widget("show:names").locator("input")
    screen.until(lambda: not names.is_checked(), "names are off")
    screen.until(lambda: labels.count() == 0, "no names")
    assert not difference(bare, screen.picture(program.mark())).any()


@pytest.mark.parametrize(
    "what", ["visual", "frames", "collision", "inertia", "joint_axes"]
)
def test_a_toggle_changes_the_picture_and_back(
    program: Program[RobotViewer], screen: Screen, what: str
) -> None:
    before = screen.picture()

    screen.click(f"show:{what}")
    wait_for_toggle(program, screen, what)
    switched = screen.picture(program.mark())
    screen.click(f"show:{what}")
    wait_for_toggle(program, screen, what)
    back = screen.picture(program.mark())

    # Lines are thin: several of them; what doesn't change has none.
    assert difference(before, switched).sum() > 100
    assert not difference(before, back).any()
    assert red(before).any()
    assert red(switched).any() == (what != "visual")


def wait_for_toggle(program: Program[RobotViewer], screen: Screen, what: str) -> None:
    """Wait until the program knows a toggle, as the browser shows it."""
    wanted = screen.widget(f"show:{what}").locator("input").is_checked()
    views = program.subject._views
    screen.until(
        lambda: program.ask(lambda: what in views.shown) == wanted, f"{what}: {wanted}"
    )


def test_what_is_hidden_stays_hidden_when_files_change(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.click("show:visual")
    wait_for_toggle(program, screen, "visual")
    hidden = screen.picture(program.mark())

    program.ask(program.subject.reload)

    again = screen.picture(program.mark())
    assert not red(hidden).any()
    assert not red(again).any()
    assert not screen.widget("show:visual").locator("input").is_checked()


def test_the_fixed_frame_stays_in_its_place(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.choose("fixed_frame", "upper")
    screen.until(
        lambda: program.ask(lambda: program.subject.fixed_frame) == "upper", "upper"
    )
    before = screen.picture(program.mark())

    screen.type("joint:elbow", "1.2")

    mark = wait_for_joint(program, screen, "elbow", 1.2)
    after = screen.picture(mark)
    # It is at the world's origin now, upright, and all else turns around it.
    (place,) = CAMERA.project(np.array([[0.0, 0.0, UPPER / 2.0]]))
    for picture in (before, after):
        assert is_near(middle(red(picture)), place)
    # The lower end of the tower hides none of it, before or after.
    upper_half = red(before) & (np.indices(red(before).shape)[0] < place[1])
    assert upper_half.sum() > 1000
    assert red(after)[upper_half].mean() > 0.99
    assert not is_near(middle(green(before)), middle(green(after)))


def test_the_camera_follows_a_link_and_looks_from_above(
    browser: Browser, program: Program[RobotViewer], screen: Screen
) -> None:
    screen.choose("camera:follow", "tip")
    [camera] = [p for p in program.subject.parts if isinstance(p, CameraPart)]
    screen.until(lambda: program.ask(lambda: camera.followed) == "tip", "follow")

    screen.type("joint:elbow", "1.2")

    followed = screen.picture(wait_for_joint(program, screen, "elbow", 1.2))
    # The camera has gone as far as the tip, and the arm's middle half as far.
    way = UPPER * np.array([math.sin(1.2), 0.0, math.cos(1.2) - 1.0])
    moved = Camera(
        tuple(np.add(CAMERA.eye, way).tolist()),
        tuple(np.add(CAMERA.target, way).tolist()),
    )
    arm = np.array([math.sin(1.2), 0.0, math.cos(1.2)]) * UPPER / 2.0
    (place,) = moved.project((arm + np.array([0.0, 0.0, ELBOW]))[None])
    assert is_near(middle(red(followed)), place)
    # A browser that comes now looks from there, too.
    with look_at(browser, program.page.url) as other:
        assert not difference(other.picture(program.mark()), followed).any()
    screen.choose("camera:follow", "nothing")
    screen.until(lambda: program.ask(lambda: camera.followed) == "", "nothing")
    screen.click("camera:top")
    screen.wait_for(program.mark())
    eye = screen.page.evaluate(
        "() => { const {viewer} = document.getElementById('scene').contentWindow;"
        " const p = viewer.camera.position.clone().sub(viewer.controls.target);"
        " return [p.x, p.y, p.z]; }"
    )
    program.look_from(CAMERA)
    # The page's own y is up.
    assert eye[1] > 100.0 * math.hypot(eye[0], eye[2])


def test_a_ghost_stays_where_the_robot_was(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.type("joint:elbow", "1.5")
    wait_for_joint(program, screen, "elbow", 1.5)
    bent = screen.picture(program.mark())

    screen.click("show_ghost")
    screen.until(lambda: screen.is_enabled("hide_ghost"), "there is a ghost")
    screen.type("joint:elbow", "-1")
    mark = wait_for_joint(program, screen, "elbow", -1.0)
    both = screen.picture(mark)
    screen.click("hide_ghost")
    screen.until(lambda: not screen.is_enabled("hide_ghost"), "there is no ghost")
    alone = screen.picture(program.mark())

    ghost = blue(both) & ~blue(alone)
    assert is_near(middle(ghost & red(bent)), upper_at(1.5))
    # The whole arm is there, but where its edges are smoothed.
    assert ghost[red(bent)].mean() > 0.9
    assert is_near(middle(red(both)), upper_at(-1.0))


def test_named_poses_are_buttons(program: Program[RobotViewer], screen: Screen) -> None:
    screen.click("pose:arm: bent")
    mark = wait_for_joint(program, screen, "elbow", 1.5)
    bent = screen.picture(mark)
    screen.click("pose:arm: home")
    mark = wait_for_joint(program, screen, "elbow", 0.0)
    home = screen.picture(mark)

    assert is_near(middle(red(bent)), upper_at(1.5))
    assert is_near(middle(red(home)), upper_at(0.0))


def test_the_copied_pose_is_yaml(program: Program[RobotViewer], screen: Screen) -> None:
    screen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    screen.type("joint:elbow", "1.25")
    wait_for_joint(program, screen, "elbow", 1.25)
    screen.until(lambda: "1.25" in screen.text("pose"), "the pose as text")

    screen.widget("pose").locator("button").click()

    copied = screen.page.evaluate("() => navigator.clipboard.readText()")
    # Joints that follow are no input.
    assert yaml.safe_load(copied) == {"turn": 0.0, "elbow": 1.25}
    assert copied.strip() == screen.text("pose").strip()


def test_a_changed_file_is_shown_and_a_wrong_one_is_said(
    program: Program[RobotViewer], screen: Screen, file: Path
) -> None:
    screen.type("joint:elbow", "1.5")
    wait_for_joint(program, screen, "elbow", 1.5)

    write(file, painted(upper="0 0 1"))
    # For a moment there is nothing at all.
    screen.until(lambda: not red(screen.glance()).any(), "nothing is red")
    changed = screen.picture(program.mark())
    assert is_near(middle(blue(changed)), upper_at(1.5))

    # The end tag of the second link has no name.
    broken = painted().replace("</link>", "</>", 1)
    write(file, broken)
    screen.until(lambda: bool(screen.message()), "a message")
    line = broken[: broken.index("</>")].count("\n") + 1
    assert f"{file}:{line}" in screen.message()
    assert "stays" in screen.message()
    still = screen.picture(program.mark())
    assert not difference(*(scene[200:] for scene in (changed, still))).any()

    write(file, painted())
    screen.until(lambda: not screen.message(), "no message")
    mended = screen.picture(program.mark())
    assert is_near(middle(red(mended)), upper_at(1.5))
    assert not blue(mended).any()


def test_two_browsers_show_the_same(
    browser: Browser, program: Program[RobotViewer], screen: Screen
) -> None:
    with look_at(browser, program.page.url) as other:
        other.wait_for(program.mark())

        screen.slide("joint:elbow", 0.1)

        mark = wait_for_joint(
            program, screen, "elbow", -0.7, 2.0 * screen.resolution("joint:elbow")
        )
        elbow = positions(program)["elbow"]
        other.until(
            lambda: other.knob("joint:elbow") == pytest.approx(elbow), "the same"
        )
        assert other.number("joint:elbow") == screen.number("joint:elbow")
        assert not difference(screen.picture(mark), other.picture(mark)).any()


def test_a_page_comes_back_when_the_program_does(browser: Browser, file: Path) -> None:
    port = free_port()
    words = ("view", str(file), "--position")
    with contextlib.ExitStack() as stack:
        with run_command(*words, "0.5", "0.25", port=port):
            screen = stack.enter_context(look_at(browser, f"http://localhost:{port}/"))
            lost = screen.page.locator("#lost")
            assert screen.number("joint:elbow") == 0.25
            screen.until(lambda: red(screen.glance()).any(), "the robot")
            assert not lost.is_visible()

        screen.until(lost.is_visible, "it says that the program has ended")
        # What is there can be read, and nothing be done with it.
        assert screen.page.evaluate("document.getElementById('sections').inert")

        with run_command(*words, "0.5", "1.75", port=port):
            screen.until(
                lambda: (
                    screen.page.locator("details").count() > 0
                    and screen.number("joint:elbow") == 1.75
                ),
                "the new pose",
            )
            screen.until(lambda: red(screen.glance()).any(), "the robot")
            assert not lost.is_visible()


def test_a_click_on_a_link_tells_its_pose(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    screen.type("joint:elbow", "1")
    screen.picture(wait_for_joint(program, screen, "elbow", 1.0))
    scene = screen.page.locator("#scene")

    # In the middle of the upper arm; beside all links first, where nothing happens.
    for column, row in ((5.0, 5.0), tuple(upper_at(1.0))):
        scene.click(position={"x": float(column), "y": float(row)})

    chosen = screen.widget("readout:frame").locator("select")
    screen.until(lambda: chosen.input_value() == "upper", "the link is chosen")
    screen.until(lambda: "joint: elbow" in screen.text("readout:link"), "its joint")
    screen.click("readout:degrees")
    screen.until(lambda: "degrees" in screen.text("readout:pose"), "degrees")
    screen.widget("readout:pose").locator("button").click()
    told = yaml.safe_load(screen.page.evaluate("() => navigator.clipboard.readText()"))
    assert told["xyz"] == pytest.approx([0.0, 0.0, ELBOW])
    assert told["rpy_degrees"] == pytest.approx([0.0, math.degrees(1.0), 0.0])


def test_meshcat_s_own_controls_are_behind_a_button(
    program: Program[RobotViewer], screen: Screen
) -> None:
    del program
    button, scene = (
        screen.page.locator("#controls"),
        screen.page.frame_locator("#scene"),
    )
    controls = scene.get_by_text("Open Controls").or_(
        scene.get_by_text("Close Controls")
    )

    screen.until(lambda: controls.count() == 1, "Meshcat has them")
    assert not controls.is_visible()
    button.click()
    assert controls.is_visible()
    button.click()
    assert not controls.is_visible()


# The scene's objects come when the test lets them.
HOLD_OBJECTS = """
    const {viewer} = document.getElementById("scene").contentWindow;
    const {set_object} = viewer;
    viewer.set_object = (...given) => {
        window.release = () => {
            viewer.set_object = set_object;
            set_object.apply(viewer, given);
        };
    };
"""


def test_what_is_still_loading_is_said(
    program: Program[RobotViewer], screen: Screen
) -> None:
    sign = screen.page.locator("#loading")
    expect(sign).to_be_hidden()
    screen.page.evaluate(HOLD_OBJECTS)
    meshcat = program.page.meshcat

    program.ask(lambda: meshcat.SetObject("/late", Box(0.01, 0.01, 0.01)))
    expect(sign).to_be_visible()
    screen.page.evaluate("() => release()")
    expect(sign).to_be_hidden()
    program.ask(lambda: meshcat.Delete("/late"))


def test_the_background_is_dark_where_the_browser_is(screen: Screen) -> None:
    def brightness() -> float:
        return float(screen.glance()[:5].mean())

    light = brightness()
    screen.page.emulate_media(color_scheme="dark")
    screen.until(lambda: brightness() < 80.0, "it is dark")
    screen.page.emulate_media(color_scheme="light")
    screen.until(lambda: abs(brightness() - light) < 1.0, "it is as before")
    assert light > 150.0


def test_a_motion_is_planned_and_executed_by_the_panel(
    program: Program[RobotViewer], screen: Screen
) -> None:
    screen.page.locator("summary", has_text="Motion planning").click()
    screen.choose("plan:group", "arm")
    screen.choose("plan:frame", "tip")
    screen.click("plan:position_only")
    before = screen.picture(program.mark())
    elbow = 0.7
    x, z = UPPER * math.sin(elbow), ELBOW + UPPER * math.cos(elbow)

    screen.type("plan:z", "3")
    screen.until(
        lambda: "no joint positions" in screen.text("plan:status"), "it is out of reach"
    )
    screen.type("plan:x", repr(x))
    screen.type("plan:z", repr(z))
    screen.until(lambda: "free" in screen.text("plan:status"), "the goal is free")
    seen = screen.picture(program.mark())
    screen.click("plan:plan")
    screen.until(lambda: "group arm" in screen.text("plan:status"), "there is a plan")
    screen.click("plan:execute")

    mark = wait_for_joint(program, screen, "elbow", elbow, 2e-3)
    # The ghost was where the arm comes to.
    place = upper_at(elbow)
    column, row = map(int, place)
    assert difference(before, seen)[row - 5 : row + 5, column - 5 : column + 5].all()
    assert is_near(middle(red(screen.picture(mark))), place)
