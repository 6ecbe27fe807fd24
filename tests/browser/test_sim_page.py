"""The page of `arm-drake sim`, used as a person does, in Chromium.

What must be seen follows from the robot's measures and a pinhole camera.
"""

import concurrent.futures
import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, ViewportSize

import arm_drake as ad
from arm_drake.visualization.page import Page
from arm_drake.visualization.page.keyboard import Keyboard
from arm_drake.visualization.page.live_simulation import LiveSimulation, make_changes
from arm_drake.visualization.page.parts import find_part
from tests import carts
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
from tests.browser.pictures import Camera, Mask, Picture, difference
from tests.models import joint, ros2_control
from tests.visualization.scene import is_visible

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# Looks along y: a link that turns about y turns in the picture, clockwise.
CAMERA = Camera(eye=(0.0, -1.5, 0.5), target=(0.0, 0.0, 0.5))

# Where the arms turn: their x and z. The first is red, the second one is green [m].
ELBOW, SWING = (0.0, 0.5), (-0.4, 0.3)
UPPER, LOWER = 0.4, 0.3

# A blue block on a slide: where it is when that is 0, and when it is closed [m].
BLOCK, CLOSED = (0.3, 0.1), 0.2

# What is seen of a box is its front and one side, whose middle is not the box's.
AWAY = 20.0  # pixels

Drag = Callable[
    [Screen, tuple[float, float], float], contextlib.AbstractContextManager[None]
]

PERIOD = 0.01

ROBOT = f"""
<robot name="worker">
  <link name="base"/>
  <link name="upper">{box(f"0.08 0.08 {UPPER}", UPPER / 2.0, "1 0 0")}</link>
  <link name="tip"/>
  <link name="lower">{box(f"0.06 0.06 {LOWER}", LOWER / 2.0, "0 1 0")}</link>
  <link name="block">{box("0.1 0.1 0.1", 0.0, "0 0 1")}</link>
  {
    joint(
        "elbow",
        "base",
        "upper",
        xyz=f"{ELBOW[0]} 0 {ELBOW[1]}",
        limit='lower="-1" upper="2" effort="50" velocity="2"',
    )
}
  <joint name="flange" type="fixed">
    <parent link="upper"/><child link="tip"/><origin xyz="0 0 {UPPER}"/>
  </joint>
  {
    joint(
        "swing",
        "base",
        "lower",
        xyz=f"{SWING[0]} 0 {SWING[1]}",
        limit='lower="-2" upper="2" effort="50" velocity="0.5"',
    )
}
  {
    joint(
        "finger",
        "base",
        "block",
        type="prismatic",
        axis="1 0 0",
        xyz=f"{BLOCK[0]} 0 {BLOCK[1]}",
        limit=f'lower="0" upper="{CLOSED}" effort="50" velocity="1"',
    )
}
  {ros2_control("elbow", "swing", "finger")}
</robot>"""

POSES = f"""
<robot name="worker">
  <group_state name="open" group="g"><joint name="finger" value="0"/></group_state>
  <group_state name="closed" group="g"><joint name="finger" value="{CLOSED}"/>
  </group_state>
</robot>"""

# The rival would command what the arm commands.
CONTROLLERS = f"""
controller_manager:
  ros__parameters:
    update_rate: {round(1.0 / PERIOD)}
    arm:
      type: joint_trajectory_controller/JointTrajectoryController
    swinger:
      type: forward_command_controller/ForwardCommandController
    gripper:
      type: position_controllers/GripperActionController
    rival:
      type: forward_command_controller/ForwardCommandController
arm:
  ros__parameters:
    joints: [elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
swinger:
  ros__parameters: {{joints: [swing], interface_name: position}}
gripper:
  ros__parameters: {{joint: finger}}
rival:
  ros__parameters: {{joints: [elbow], interface_name: position}}
"""

Live = Program[LiveSimulation]


def pixel(x: float, z: float) -> NDArray[np.float64]:
    """Return where a point in the plane of the arms is in the picture."""
    (at,) = CAMERA.project(np.array([[x, 0.0, z]]))
    return at


def middle_of_arm(
    place: tuple[float, float], length: float, angle: float
) -> NDArray[np.float64]:
    """Return where the middle of an arm is in the picture."""
    x, z = place
    half = 0.5 * length
    return pixel(x + half * math.sin(angle), z + half * math.cos(angle))


def is_near(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool(np.linalg.norm(one - other) < AWAY)


def pink(picture: Picture) -> Mask:
    """Return which pixels have the colour of trails."""
    r, g, b = np.moveaxis(picture, 2, 0)
    return (r > g + 80) & (b > g + 40)


def simulate(page: Page, robot: ad.Robot) -> LiveSimulation:
    options = ad.SimulationOptions(frame_rate=0.0)
    diagram = ad.build_diagram(robot, options=options, meshcat=page.meshcat)
    return LiveSimulation(page, ad.Simulation(diagram), is_paused=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("worker")
    (folder / "worker.urdf").write_text(ROBOT, encoding="utf-8")
    (folder / "worker.srdf").write_text(POSES, encoding="utf-8")
    (folder / "controllers.yaml").write_text(CONTROLLERS, encoding="utf-8")
    (folder / "package.xml").write_text("<package><name>worker</name></package>")
    return folder


@pytest.fixture(scope="module")
def simulation(
    program_thread: concurrent.futures.ThreadPoolExecutor, folder: Path
) -> Iterator[Live]:
    def make(page: Page) -> LiveSimulation:
        files = [folder / "controllers.yaml"]
        return simulate(page, ad.load_robot(folder / "worker.urdf", controllers=files))

    program = Program(program_thread, make)
    try:
        program.look_from(CAMERA)
        yield program
    finally:
        program.end()


@pytest.fixture(scope="module")
def window(browser: Browser, simulation: Live) -> Iterator[Screen]:
    """Opened once: a page without a graphics card takes seconds to begin."""
    with look_at(browser, simulation.page.url) as screen:
        yield screen


@pytest.fixture
def program(simulation: Live) -> Live:
    """Return the program as it was at its start: it doesn't play."""
    live = simulation.subject

    def restore() -> None:
        live.pause()
        live.set_realtime_rate(1.0)
        live.reset()
        live.views.set_trail(None)
        live.views.show("ghost", False)
        simulation.page.say("")
        simulation.page.patch(make_changes(live))

    simulation.ask(restore)
    return simulation


@pytest.fixture
def screen(window: Screen, program: Live) -> Screen:
    window.wait_for(program.mark())
    window.until(
        lambda: window.text("time") == "0.00 s" and window.text("play") == "play",
        "the panel of the start",
    )
    window.leave()
    return window


def time_of(program: Live) -> float:
    return program.ask(lambda: program.subject.simulation.time)


def position(program: Live, joint: str) -> float:
    def find() -> float:
        state = program.subject.simulation.joint_states()
        return float(state.position[state.name.index(joint)])

    return program.ask(find)


def states(program: Live) -> dict[str, str]:
    rows = program.ask(program.subject.simulation.list_controllers)
    return {row.name: row.state for row in rows}


def pause(program: Live) -> int:
    """Pause, and return a mark of the scene as it is then."""

    def stand() -> None:
        program.subject.pause()
        program.subject.views.draw()

    program.ask(stand)
    return program.mark()


def shows(program: Live, path: str) -> bool:
    """Return whether something is in the scene that can be hidden, and isn't."""
    meshcat = program.page.meshcat
    return program.ask(lambda: meshcat.HasPath(path) and is_visible(meshcat, path))


def play_until(
    program: Live, screen: Screen, holds: Callable[[], bool], what: str
) -> Picture:
    """Play until something is so; return a picture of it, which stands."""
    screen.click("play")
    screen.until(holds, what)
    return screen.picture(pause(program))


def test_the_command_has_a_page(browser: Browser) -> None:
    port = free_port()
    with (
        run_command("sim", "lab5_arm", "--paused", port=port),
        look_at(browser, f"http://localhost:{port}/") as screen,
    ):
        slider = "remote:joint_trajectory_controller:goal:arm1_arm2_joint"
        screen.until(lambda: red(screen.glance()).any(), "the red link")
        before = screen.picture()
        screen.until(lambda: screen.text("time") == "0.00 s", "it is at its start")

        screen.type(slider, "1.2")
        screen.click("play")
        screen.until(lambda: screen.seconds("time") > 0.5, "time goes by")
        screen.click("play")
        screen.until(lambda: screen.text("play") == "play", "it is paused")
        assert screen.number(slider) == 1.2

        def has_moved() -> bool:
            seen = red(screen.glance())
            moved = middle(seen) - middle(red(before)) if seen.any() else 0.0
            return bool(np.linalg.norm(moved) > 20.0)

        screen.until(has_moved, "it bends over: the last link is lower, on one side")
        go_back(screen, before)
        insert_a_thing(screen)
        teach_a_way_point(screen)
        end_it(screen)


def insert_a_thing(screen: Screen) -> None:
    """Put a green box before the robot, which is seen."""
    before = int(green(screen.picture()).sum())  # An axis is green.
    screen.page.locator("summary", has_text="Insert a thing").click()
    screen.choose("insert:color", "green")
    screen.click("insert:now")
    screen.until(lambda: green(screen.glance()).sum() > before + 100, "the green box")


def teach_a_way_point(screen: Screen) -> None:
    """Keep where the robot is; it is a motion file then."""
    screen.page.locator("summary", has_text="Teach a motion").click()
    assert not screen.is_enabled("teach:save")
    screen.click("teach:add")
    screen.until(lambda: screen.text("teach:count") == "1", "a way point")
    (step,) = yaml.safe_load(screen.text("teach:motion"))
    assert "arm1_arm2_joint" in step["goal"]["joint_names"]
    assert screen.is_enabled("teach:save")


def go_back(screen: Screen, start: Picture) -> None:
    """Have the time bar show the start of the run."""
    screen.slide("seek", 0.0)

    def is_back() -> bool:
        seen = red(screen.glance())
        return bool(seen.any()) and is_near(middle(seen), middle(red(start)))

    screen.until(is_back, "the start of the run")
    assert screen.number("seek") == 0.0
    assert screen.seconds("time") > 0.5


def end_it(screen: Screen) -> None:
    """End the program: what can't do anything any more is grey."""
    sections, lost = screen.page.locator("#sections"), screen.page.locator("#lost")
    assert sections.evaluate("(s) => getComputedStyle(s).opacity") == "1"
    screen.click("end")
    screen.until(lambda: screen.text("end") == "end it?", "a question")
    screen.click("end")
    screen.until(lost.is_visible, "the connection is lost")
    assert sections.evaluate("(s) => s.inert && +getComputedStyle(s).opacity < 0.5")


def test_time_stands_while_it_is_paused_and_goes_on(
    program: Live, screen: Screen
) -> None:
    screen.click("play")
    screen.until(lambda: screen.text("play") == "pause", "it plays")
    screen.until(lambda: screen.seconds("time") > 0.1, "time goes by")

    screen.click("play")

    screen.until(lambda: screen.text("play") == "play", "it is paused")
    stands = time_of(program)
    screen.until(lambda: screen.text("time") == f"{stands:.2f} s", "the page has it")
    screen.until(lambda: screen.text("factor") == "–", "the page has it")
    # Between two answers it would have gone on by itself.
    assert [time_of(program) for _ in range(10)] == 10 * [stands]

    screen.click("play")

    screen.until(lambda: time_of(program) > stands + 0.1, "time goes on")
    screen.until(
        lambda: screen.text("factor") not in ("–", "0.00"), "a real-time factor"
    )
    # As fast as real time at most, but for rounding: 0.01 s in 0.1 s and more.
    assert screen.seconds("time") <= screen.seconds("wall_time") + 0.1
    assert 0.0 < float(screen.text("factor")) < 1.5


def test_a_step_is_a_cycle_of_the_controllers(program: Live, screen: Screen) -> None:
    for cycle in (1, 2):
        screen.click("step")

        at = cycle * PERIOD
        screen.until(lambda at=at: screen.text("time") == f"{at:.2f} s", "a step")
        assert time_of(program) == pytest.approx(at, abs=1e-12)
    assert screen.text("play") == "play"


def test_keys_play_and_step(program: Live, screen: Screen) -> None:
    # Where the scene has the keyboard.
    screen.page.frame_locator("#scene").locator("canvas").first.click()

    screen.page.keyboard.press("s")
    screen.until(lambda: screen.text("time") == f"{PERIOD:.2f} s", "a step")
    screen.page.keyboard.press(" ")
    screen.until(lambda: screen.text("play") == "pause", "it plays")
    screen.page.keyboard.press(" ")
    screen.until(lambda: screen.text("play") == "play", "it is paused")

    assert not program.ask(lambda: program.subject.is_playing)


def test_a_goal_by_slider_moves_the_arm_and_reset_brings_it_back(
    program: Live, screen: Screen
) -> None:
    start = screen.picture()

    screen.slide("remote:arm:goal:elbow", 0.8)
    goal = pytest.approx(1.4, abs=2.0 * screen.resolution("remote:arm:goal:elbow"))
    bent = play_until(
        program, screen, lambda: position(program, "elbow") == goal, "the goal"
    )
    assert is_near(middle(red(start)), middle_of_arm(ELBOW, UPPER, 0.0))
    elbow = position(program, "elbow")
    assert is_near(middle(red(bent)), middle_of_arm(ELBOW, UPPER, elbow))
    # From the last value that was sent on, the slider is the goal.
    assert screen.number("remote:arm:goal:elbow") == goal

    screen.click("reset")

    screen.until(lambda: screen.text("time") == "0.00 s", "time 0")
    back = screen.picture(program.mark())
    assert position(program, "elbow") == pytest.approx(0.0, abs=1e-12)
    assert not difference(start, back).any()
    screen.until(
        lambda: screen.number("remote:arm:goal:elbow") == 0.0, "the slider at 0"
    )


def test_a_motion_is_planned_executed_and_stopped_by_the_panel(
    program: Live, screen: Screen
) -> None:
    screen.page.locator("summary", has_text="Motion planning").click()
    screen.choose("plan:group", "arm")
    screen.choose("plan:frame", "tip")
    screen.click("plan:position_only")
    goal = 0.8
    screen.type("plan:x", repr(ELBOW[0] + UPPER * math.sin(goal)))
    screen.type("plan:z", repr(ELBOW[1] + UPPER * math.cos(goal)))
    screen.until(lambda: "free" in screen.text("plan:status"), "the goal is free")

    screen.click("plan:plan")
    screen.until(lambda: "found in" in screen.text("plan:status"), "there is a plan")
    assert position(program, "elbow") == pytest.approx(0.0, abs=1e-12)
    screen.click("plan:execute")
    near = pytest.approx(goal, abs=2e-3)
    bent = play_until(
        program, screen, lambda: position(program, "elbow") == near, "the goal"
    )
    elbow = position(program, "elbow")
    assert is_near(middle(red(bent)), middle_of_arm(ELBOW, UPPER, elbow))

    # Back to a named state, so slowly that it is stopped long before.
    play_until(program, screen, lambda: "goal" in screen.text("plan:status"), "the end")
    screen.choose("plan:state", "home")
    screen.type("plan:velocity_scaling", "0.05")
    screen.click("plan:plan")
    screen.until(lambda: "found in" in screen.text("plan:status"), "there is a plan")
    screen.click("plan:execute")
    play_until(program, screen, lambda: position(program, "elbow") < 0.75, "it moves")
    screen.click("plan:stop")
    screen.until(lambda: "cancel" in screen.text("plan:status"), "it is canceled")
    now = time_of(program)
    play_until(program, screen, lambda: time_of(program) > now + 0.5, "it stands")
    stopped = position(program, "elbow")
    assert stopped > 0.5
    play_until(program, screen, lambda: time_of(program) > now + 1.0, "it still does")
    assert position(program, "elbow") == pytest.approx(stopped, abs=1e-4)
    screen.click("plan:clear")


def test_the_real_time_rate_is_a_choice(program: Live, screen: Screen) -> None:
    rates = []
    for option in ("0.1 ×", "as fast as it goes", "2 ×"):
        before = program.ask(lambda: program.subject.realtime_rate)
        screen.choose("rate", option)
        screen.until(
            lambda before=before: (
                program.ask(lambda: program.subject.realtime_rate) != before
            ),
            option,
        )
        rates.append(program.ask(lambda: program.subject.realtime_rate))

    assert rates == [0.1, 0.0, 2.0]


def test_a_slow_rate_is_kept(program: Live, screen: Screen) -> None:
    screen.choose("rate", "0.1 ×")
    screen.click("play")
    screen.until(lambda: screen.seconds("wall_time") > 1.0, "a second")

    assert time_of(program) <= 0.1 * program.ask(lambda: program.subject.wall_time)
    assert time_of(program) > 0.0


def test_a_controller_is_deactivated_and_activated(
    program: Live, screen: Screen
) -> None:
    slider = "remote:arm:goal:elbow"
    screen.click("play")
    assert screen.text("controller:arm").startswith("active")

    screen.click("deactivate:arm")

    screen.until(lambda: states(program)["arm"] == "inactive", "inactive")
    screen.until(
        lambda: screen.text("controller:arm").startswith("inactive"), "said so"
    )
    screen.until(lambda: not screen.is_enabled(slider), "no goals")

    screen.click("activate:arm")

    screen.until(lambda: states(program)["arm"] == "active", "active")
    screen.until(lambda: screen.text("controller:arm").startswith("active"), "said so")
    screen.until(lambda: screen.is_enabled(slider), "goals")
    assert "arm" in screen.text("log")


def test_what_is_impossible_is_said_until_something_else_is_done(
    program: Live, screen: Screen
) -> None:
    screen.click("play")
    screen.click("activate:rival")

    screen.until(lambda: "rival" in screen.message() + screen.text("log"), "why not")
    said = screen.message() or screen.text("log")
    assert "elbow/position" in said
    assert states(program)["rival"] == "inactive"
    assert states(program)["arm"] == "active"

    # Where the other one gives way it is possible.
    screen.click("deactivate:arm")
    screen.until(lambda: states(program)["arm"] == "inactive", "the arm is inactive")
    screen.until(lambda: not screen.message(), "no message")
    screen.click("activate:rival")
    screen.until(lambda: states(program)["rival"] == "active", "the rival is active")


def test_a_gripper_closes_and_opens(program: Live, screen: Screen) -> None:
    x, z = BLOCK

    screen.click("remote:gripper:close")
    closed = play_until(
        program,
        screen,
        lambda: abs(position(program, "finger") - CLOSED) < 5e-3,
        "it is closed",
    )
    screen.click("remote:gripper:open")
    opened = play_until(
        program, screen, lambda: abs(position(program, "finger")) < 5e-3, "it is open"
    )

    assert is_near(middle(blue(closed)), pixel(x + CLOSED, z))
    assert is_near(middle(blue(opened)), pixel(x, z))


def test_the_ghost_is_where_the_arm_is_told_to_be(
    program: Live, screen: Screen
) -> None:
    screen.click("show:ghost")
    screen.choose("rate", "0.1 ×")
    screen.type("remote:swinger:value:swing/position", "1.5")

    # At 0.5 rad/s the arm needs 3 s, and half a minute at this rate.
    both = play_until(
        program, screen, lambda: time_of(program) > 5.0 * PERIOD, "some cycles"
    )
    screen.click("show:ghost")
    views = program.subject.views
    screen.until(lambda: not program.ask(lambda: views._has_ghosts), "no ghost")
    alone = screen.picture(program.mark())

    measured = position(program, "swing")
    assert measured < 0.5
    assert is_near(middle(green(alone)), middle_of_arm(SWING, LOWER, measured))
    # The other links' ghosts cover them: none of it is far from the told place.
    ghost = difference(both, alone) & blue(both)
    columns = np.arange(ghost.shape[1])
    ghost &= ~red(alone) & ~blue(alone) & (columns < pixel(-0.05, 0.0)[0])
    assert is_near(middle(ghost), middle_of_arm(SWING, LOWER, 1.5))


def test_a_trail_is_where_the_tip_was(program: Live, screen: Screen) -> None:
    before = screen.picture()
    screen.choose("trail", "tip")
    screen.type("remote:arm:goal:elbow", "1.4")

    moved = play_until(
        program,
        screen,
        lambda: abs(position(program, "elbow") - 1.4) < 5e-3,
        "the goal",
    )
    screen.choose("trail", "none")
    screen.until(
        lambda: not pink(screen.picture(program.mark())).any(), "the trail is gone"
    )

    assert not pink(before).any()
    rows, columns = np.nonzero(pink(moved))
    # On the circle around the elbow. The line is three pixels wide.
    x, z = ELBOW
    radius = np.linalg.norm(pixel(x, z + UPPER) - pixel(x, z))
    away = np.hypot(columns - pixel(x, z)[0], rows - pixel(x, z)[1])
    np.testing.assert_allclose(away, radius, atol=4.0)
    angles = np.arctan2(columns - pixel(x, z)[0], pixel(x, z)[1] - rows)
    assert angles.min() < 0.05
    # The arm itself is in front of its end.
    assert angles.max() > 1.2


def test_two_browsers_show_the_same_simulation(
    browser: Browser, program: Live, screen: Screen
) -> None:
    with look_at(browser, program.page.url) as other:
        other.wait_for(program.mark())

        screen.type("remote:arm:goal:elbow", "0.5")
        picture = play_until(
            program,
            other,
            lambda: abs(position(program, "elbow") - 0.5) < 5e-3,
            "the goal",
        )

        mark = program.mark()
        screen.until(
            lambda: screen.text("time") == other.text("time") != "0.00 s", "one time"
        )
        assert other.number("remote:arm:goal:elbow") == 0.5
        assert not difference(picture, screen.picture(mark)).any()
        assert is_near(middle(red(picture)), middle_of_arm(ELBOW, UPPER, 0.5))


@contextlib.contextmanager
def mouse_drag(
    screen: Screen, start: tuple[float, float], right: float
) -> Iterator[None]:
    """Drag by the mouse, with Shift; it is let go at the end."""
    mouse, keyboard = screen.page.mouse, screen.page.keyboard
    mouse.move(*start)
    keyboard.down("Shift")
    mouse.down()
    mouse.move(start[0] + right, start[1], steps=5)
    keyboard.up("Shift")
    yield
    mouse.up()


@contextlib.contextmanager
def finger_drag(
    screen: Screen, start: tuple[float, float], right: float
) -> Iterator[None]:
    """Drag by a finger, which has no Shift: a switch says so; it goes up at the end."""
    screen.page.locator("summary", has_text="Pull and push").click()
    screen.click("hands:drag")
    browser = screen.page.context.new_cdp_session(screen.page)

    def touch(kind: str, *x: float) -> None:
        points = [{"x": each, "y": start[1]} for each in x]
        browser.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", start[0])
    for part in range(1, 6):
        touch("touchMove", start[0] + right * part / 5.0)
    yield
    touch("touchEnd")


@pytest.mark.parametrize("drag", [mouse_drag, finger_drag])
def test_a_link_that_is_dragged_is_pulled_and_the_camera_stays(
    program: Live, screen: Screen, drag: Drag
) -> None:
    screen.click("play")
    column, row = map(float, middle_of_arm(ELBOW, UPPER, 0.0))
    scene = screen.page.locator("#scene").bounding_box()
    assert scene is not None

    def pulled() -> float:
        text = screen.widget("hands:pulling").locator(".value").text_content()
        return 0.0 if text in (None, "–") else float(str(text).split()[0])

    # A spring of 20 rad/s at a link of 1 kg, which its servo holds in its place.
    front = 0.04
    depth = (1.5 - front) / 1.5
    meters = depth * 100.0 / float(pixel(1.0, 0.5)[0] - pixel(0.0, 0.5)[0])
    expected = 400.0 * meters
    meshcat = program.page.meshcat
    with drag(screen, (scene["x"] + column, scene["y"] + row), 100.0):
        screen.until(lambda: abs(pulled() - expected) < 0.05 * expected, "the force")
        assert program.ask(lambda: meshcat.HasPath("/hands/spring"))
    screen.until(lambda: pulled() == 0.0, "it is let go")

    picture = screen.picture(pause(program))
    assert is_near(middle(red(picture)), middle_of_arm(ELBOW, UPPER, 0.0))
    assert not program.ask(lambda: meshcat.HasPath("/hands/spring"))


def test_a_key_jogs_a_joint_while_it_is_down(program: Live, screen: Screen) -> None:
    page = screen.page
    page.locator("summary", has_text="Keyboard").click()
    page.keyboard.press("1")
    screen.click("keys:on")
    before = position(program, "elbow")

    page.keyboard.down("1")
    program.ask(program.subject.play)
    screen.until(lambda: position(program, "elbow") > 0.3, "the arm moves")
    page.keyboard.up("1")
    keyboard = find_part(program.subject.parts, Keyboard)
    screen.until(lambda: not program.ask(lambda: keyboard._pressed), "it is let go")
    end = time_of(program) + 0.5
    screen.until(lambda: time_of(program) > end, "it has come to rest")
    there = position(program, "elbow")
    screen.until(lambda: time_of(program) > end + 0.3, "it stays there")

    assert before == pytest.approx(0.0, abs=1e-3)
    assert position(program, "elbow") == pytest.approx(there, abs=1e-3)
    assert there < 1.9  # It didn't go to its end.


def test_a_plot_is_drawn_zoomed_saved_and_cleared(
    program: Live, screen: Screen
) -> None:
    page = screen.page
    height = page.locator("#scene").bounding_box()["height"]
    screen.type("remote:arm:goal:elbow", "1.4")
    page.locator("summary", has_text="Plot").click()
    assert not page.evaluate("() => typeof uPlot !== 'undefined'")
    screen.choose("plot:topic", "joint_states")
    screen.choose("plot:number", "position[elbow]")
    page.wait_for_selector("#plot canvas")
    play_until(
        program,
        screen,
        lambda: abs(position(program, "elbow") - 1.4) < 5e-3,
        "the goal",
    )

    # What is drawn is the arm's way, and the scene gives way to it.
    times, values = page.evaluate("() => plots.shown")
    assert times[-1] == pytest.approx(time_of(program), abs=0.05)
    assert (values[0], values[-1]) == pytest.approx((0.0, 1.4), abs=0.01)
    assert page.locator("#scene").bounding_box()["height"] < 0.7 * height
    assert page.locator("#plot-curves .value").inner_text().startswith("1.4")

    # A part of it, and all again.
    area = page.locator("#plot .u-over").bounding_box()
    page.mouse.move(area["x"] + 0.25 * area["width"], area["y"] + 20)
    page.mouse.down()
    page.mouse.move(area["x"] + 0.5 * area["width"], area["y"] + 20, steps=4)
    page.mouse.up()
    zoomed = page.evaluate("() => [plots.chart.scales.x.min, plots.chart.scales.x.max]")
    part = np.array([0.25, 0.5]) * (times[-1] - times[0]) + times[0]
    assert zoomed == pytest.approx(part, abs=0.02 * times[-1])
    page.mouse.dblclick(area["x"] + 50, area["y"] + 20)
    assert page.evaluate("() => plots.chart.scales.x.max") >= times[-1]

    with page.expect_download() as numbers:
        page.click("#plot-csv")
    head, *lines = numbers.value.path().read_text().splitlines()
    assert head == "time,joint_states/position[elbow]"
    assert lines[-1] == f"{times[-1]},{values[-1]}"
    with page.expect_download() as picture:
        page.click("#plot-png")
    with Image.open(picture.value.path()) as image:
        drawn = np.asarray(image.convert("RGB")).astype(np.int16)
    assert blue(drawn).sum() > 100

    # What is forgotten isn't shown either, although the plot stands still.
    page.click("#plot-pause")
    page.click("#plot-clear")
    page.wait_for_function("() => plots.is_paused && plots.shown[0].length === 0")

    page.click("#plot-close")
    page.wait_for_selector("#plot", state="hidden")
    assert page.locator("#scene").bounding_box()["height"] == height


def test_the_panel_is_made_wider_by_its_corner(program: Live, browser: Browser) -> None:
    size = ViewportSize(width=1600, height=900)
    with look_at(browser, program.page.url, viewport=size) as screen:
        page, mouse = screen.page, screen.page.mouse

        def place(name: str) -> dict[str, float]:
            box = page.locator(name).bounding_box()
            assert box is not None
            return dict(box)

        before = place("#panel")
        right, bottom = before["x"] + before["width"], before["y"] + before["height"]

        def drag(to: float) -> None:
            corner = place("#panel")
            mouse.move(corner["x"] + corner["width"] - 4.0, bottom - 4.0)
            mouse.down()
            mouse.move(to, bottom - 4.0, steps=5)
            mouse.up()

        drag(right + 146.0)
        wider, scene = place("#panel"), place("#scene")
        drag(1500.0)
        widest = place("#panel")

    assert wider["width"] == pytest.approx(before["width"] + 150.0, abs=1.0)
    # The scene has what is left, and the panel never takes more than its part.
    assert scene["x"] == pytest.approx(wider["x"] + wider["width"], abs=1.0)
    assert scene["x"] + scene["width"] == pytest.approx(1600.0, abs=1.0)
    assert widest["width"] == pytest.approx(0.6 * 1600.0, abs=1.0)


def test_on_a_phone_the_panel_leaves_the_scene_alone(
    program: Live, browser: Browser
) -> None:
    size = ViewportSize(width=390, height=844)
    phone = {"viewport": size, "has_touch": True, "is_mobile": True}
    with look_at(browser, program.page.url, **phone) as screen:
        page = screen.page
        page.locator("#unfold").tap()
        scene, panel = (page.locator(id).bounding_box() for id in ("#scene", "#panel"))
        sizes = page.evaluate(
            "() => [...document.querySelectorAll('details[open] button, details[open] "
            "input:not([type=checkbox])')].map((e) => e.getBoundingClientRect().height)"
        )
        width = page.evaluate("() => document.documentElement.scrollWidth")

        # What a square window shows from side to side is seen in the narrow one.
        def slope(row: int) -> float:
            projection = "viewer.camera.projectionMatrix.elements"
            frame = "document.getElementById('scene').contentWindow"
            return float(page.evaluate(f"() => {frame}.{projection}[{row}]"))

        square = 1.0 / math.tan(math.radians(75.0) / 2.0)
        screen.until(lambda: slope(0) == pytest.approx(square, abs=1e-3), "all of it")
        assert slope(5) == pytest.approx(square * 390.0 / scene["height"], abs=1e-3)

    assert scene is not None
    assert panel is not None
    assert scene["y"] + scene["height"] <= panel["y"] + 0.5
    assert scene["width"] == panel["width"] == width == 390.0
    assert panel["y"] + panel["height"] == pytest.approx(844.0, abs=0.5)
    assert min(sizes) >= 36.0  # Of what a finger should hit.


def test_the_program_ends_by_a_second_click(program: Live, screen: Screen) -> None:
    screen.click("end")

    screen.until(lambda: screen.text("end") == "end it?", "a question")
    assert not program.ask(lambda: program.subject.is_ended)
    # It isn't for ever.
    screen.until(lambda: screen.text("end") == "end", "no question")
    assert not program.ask(lambda: program.subject.is_ended)


@pytest.fixture(scope="module")
def cart(
    program_thread: concurrent.futures.ThreadPoolExecutor,
    simulation: Live,
    window: Screen,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Live]:
    # Programs run one after the other.
    simulation.end()
    window.page.close()
    folder = tmp_path_factory.mktemp("cart")
    text = carts.cart(carts.diff_drive())
    program = Program(
        program_thread, lambda page: simulate(page, carts.load(folder, text))
    )
    try:
        program.look_from(CAMERA)
        yield program
    finally:
        program.end()


@pytest.fixture(scope="module")
def cart_screen(browser: Browser, cart: Live) -> Iterator[Screen]:
    with look_at(browser, cart.page.url) as screen:
        screen.wait_for(cart.mark())
        yield screen


def test_wheels_stand_on_the_ground_with_forces(
    cart: Live, cart_screen: Screen
) -> None:
    screen = cart_screen
    (robot,) = cart.subject.simulation.robots
    force = f"/drake/contact_forces/{robot}/0"
    bare = play_until(cart, screen, lambda: time_of(cart) > 0.5, "it stands")
    assert not shows(cart, force)

    screen.click("show:contacts")
    screen.until(lambda: shows(cart, force), "forces")
    drawn = screen.picture(cart.mark())
    screen.click("show:contacts")
    screen.until(lambda: not shows(cart, force), "no forces")
    back = screen.picture(cart.mark())

    # Rods go up from where the wheels are, at y of 0.2 m to both sides, and x of 0.
    rods = green(drawn) & ~green(bare)
    rows, _ = np.nonzero(rods)
    for y in (-0.2, 0.2):
        (foot,) = CAMERA.project(np.array([[0.0, y, 0.0]]))
        around = rods[foot[1] - 20 : foot[1] + 6, foot[0] - 8 : foot[0] + 8]
        assert around.mean() > 0.1
    (lowest,) = CAMERA.project(np.array([[0.0, -0.2, 0.0]]))
    assert rows.max() < lowest[1] + 10
    assert not difference(bare, back).any()


def test_a_base_drives_by_its_slider_and_stops(cart: Live, cart_screen: Screen) -> None:
    screen = cart_screen
    screen.click("show:collision")
    screen.until(lambda: shows(cart, "/drake/collision"), "what collides is shown")
    (name,) = (r.controller for r in cart.subject.remotes)

    def x() -> float:
        poses = cart.ask(cart.subject.simulation.link_poses)
        return float(poses["base_link"].translation()[0])

    before, start = screen.picture(cart.mark()), x()
    screen.slide(f"remote:{name}:forward", 1.0)
    after = play_until(cart, screen, lambda: x() > start + 0.3, "it drives")

    # The picture moves as the base does, to the right.
    left = difference(before, after)
    _, columns = np.nonzero(left & (np.indices(left.shape)[0] > 100))
    scale = np.linalg.norm(pixel(1.0, 0.0) - pixel(0.0, 0.0))
    assert np.ptp(columns) > (0.3 + 0.3) * scale

    screen.click(f"remote:{name}:stop")
    screen.click("play")
    rest = [(time_of(cart), x())]

    def stands() -> bool:
        (last, there), now = rest[-1], time_of(cart)
        if now < last + 0.1:  # It may not play yet.
            return False
        rest.append((now, x()))
        return abs(rest[-1][1] - there) < 1e-5

    screen.until(lambda: screen.number(f"remote:{name}:forward") == 0.0, "0 m/s")
    screen.until(stands, "it stands")
