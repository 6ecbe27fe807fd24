"""A simulation on a page: it is the same one, and all that is clicked is done."""

import itertools
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError, MotionError, SimulationError
from arm_drake.simulation.motion_files import parse_motion
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page import live_simulation as mut
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.page import EventQueue
from tests.models import TWO_LINKS, load
from tests.visualization.page.clients import Panel, WebSocket, end_meshcat
from tests.visualization.scene import pose, unpack
from tests.visualization.teleop.panel import same_bits
from tests.waiting import PATIENCE, wait_until

JOINTS = ("shoulder", "elbow")

# With something to be seen of it.
BALL = "<visual><geometry><sphere radius='0.1'/></geometry></visual>"
SEEN = TWO_LINKS.replace("</inertial>", f"</inertial>{BALL}")

# Two that compete for the joints, the second not from the start.
CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    group: {type: position_controllers/JointGroupPositionController}
arm:
  ros__parameters:
    joints: [shoulder, elbow]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
group:
  ros__parameters:
    joints: [shoulder, elbow]
"""

PERIOD = 0.01

SWITCH = {"activate": ["group"], "deactivate": ["arm"]}

# A goal, another one on its way, and other controllers: at odd times.
MOTION = parse_motion(
    [
        {
            "at": 0.0,
            "controller": "arm",
            "goal": {
                "joint_names": list(JOINTS),
                "points": [{"positions": [0.6, -0.4], "time_from_start": 0.4}],
            },
        },
        {
            "at": 0.237,
            "controller": "arm",
            "goal": {
                "joint_names": list(JOINTS),
                "points": [{"positions": [-0.2, 0.3], "time_from_start": 0.3}],
            },
        },
        {"at": 0.65, "switch_controllers": SWITCH},
        {"at": 0.7, "controller": "group", "commands": [0.1, 0.0]},
    ]
)
DURATION = 1.0


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> ad.Robot:
    folder = tmp_path_factory.mktemp("robot")
    # It hangs from there, above the ground.
    return load(folder, SEEN, CONTROLLERS, pose=[0, 0, 3, 0, 0, 0])


@pytest.fixture(scope="module")
def expected(robot: ad.Robot) -> ad.Rollout:
    """What comes without a page."""
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.run(DURATION, MOTION)
    rollout = simulation.rollout()
    # It moves, in several ways, and nothing fails but what is preempted.
    assert np.ptp(rollout.position, axis=0).min() > 0.3
    (preempted,) = simulation.failures
    assert preempted is simulation.goals[0]
    return rollout


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


def make(
    page: Page, robot: ad.Robot, preset: str = "accurate", **options: Any
) -> LiveSimulation:
    settings = ad.SimulationOptions(preset=preset, frame_rate=0.0)
    diagram = ad.build_diagram(robot, options=settings, meshcat=page.meshcat)
    how = {"motion": MOTION, "realtime_rate": 0.0, **options}
    return LiveSimulation(page, ad.Simulation(diagram), **how)


def run_to_the_end(live: LiveSimulation) -> ad.Rollout:
    """Run up to the duration, and return what was recorded."""
    live.run(DURATION - live.simulation.time)
    assert live.simulation.time == pytest.approx(DURATION, abs=1e-12)
    return live.simulation.rollout()


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.0, 1.0, 3.7])
def test_it_is_the_same_simulation(
    page: Page, robot: ad.Robot, expected: ad.Rollout, rate: float
) -> None:
    live = make(page, robot, realtime_rate=rate)

    assert same_bits(run_to_the_end(live), expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    "what", ["frames", "names", "collision", "inertia", "joint_axes", "ghost"]
)
def test_what_is_shown_does_not_change_it(
    page: Page, robot: ad.Robot, expected: ad.Rollout, what: str
) -> None:
    live = make(page, robot, realtime_rate=2.0)
    live.views.show(what)

    assert same_bits(run_to_the_end(live), expected)


@pytest.mark.slow
def test_all_that_is_shown_at_once_and_changed_on_the_way_does_not_change_it(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot, realtime_rate=2.0, frame_rate=30.0)
    live.views.set_fixed_frame("lower")
    live.views.set_trail("lower")
    for what in ("ghost", "contacts", "frames", "collision"):
        live.views.show(what)
    toggles = itertools.cycle(["contacts", "ghost", "inertia", "visual"])
    is_shown = itertools.cycle([False, False, True, True, True])

    def change(time: float) -> None:
        live.views.show(next(toggles), next(is_shown))

    live.run(DURATION, change)

    assert same_bits(live.simulation.rollout(), expected)


@pytest.mark.slow
def test_a_pause_in_the_middle_does_not_change_it(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot, realtime_rate=2.0)
    # Somewhere between two ticks, twice.
    looks = itertools.count()

    def press(time: float) -> None:
        if next(looks) in (1, 3, 4, 6):
            live.handle([WidgetEvent("play")])

    live.run(DURATION, press)

    assert same_bits(live.simulation.rollout(), expected)


@pytest.mark.slow
def test_a_run_in_steps_does_not_change_it(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot)

    for _ in range(round(DURATION / PERIOD)):
        live.step()

    assert live.simulation.time == pytest.approx(DURATION, abs=1e-12)
    assert same_bits(live.simulation.rollout(), expected)


@pytest.mark.slow
def test_steps_pauses_and_runs_mixed_do_not_change_it(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot)

    live.run(0.1234)
    live.step()
    live.step(7)
    live.play()
    live.run(0.2)
    live.set_realtime_rate(5.0)

    assert same_bits(run_to_the_end(live), expected)


@pytest.mark.parametrize("start", [0.0, 0.05, 0.0512, 0.0599])
def test_a_step_goes_to_the_next_cycle(
    page: Page, robot: ad.Robot, start: float
) -> None:
    live = make(page, robot)
    if start:
        live.run(start)
    # Tick 5 is at 0.05: at that instant it is still to come.
    before = int(np.floor(start / PERIOD + 1e-6))

    for count in (1, 2, 3):
        live.step()
        assert live.simulation.time == pytest.approx((before + count) * PERIOD)
        # Ticks 0 to the one before now.
        assert len(live.simulation.rollout().time) == before + count
    assert not live.is_playing
    live.step(10)
    assert live.simulation.time == pytest.approx((before + 13) * PERIOD)


@pytest.mark.slow
@pytest.mark.parametrize("until", [0.0, 0.3, 0.6789])
def test_after_a_reset_the_same_comes_again(
    page: Page, robot: ad.Robot, expected: ad.Rollout, until: float
) -> None:
    live = make(page, robot)
    if until:
        live.run(until)

    start = time.perf_counter()
    live.reset()

    assert live.simulation.time == 0.0
    assert live.is_playing
    assert live.log == ""
    assert live.wall_time <= time.perf_counter() - start
    assert same_bits(run_to_the_end(live), expected)


@pytest.mark.slow
def test_a_reset_during_a_run_starts_the_motion_anew(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot, realtime_rate=2.0)
    page.call(lambda: None)
    resets: list[float] = []

    def press(time: float) -> None:
        # On any machine it looks between this and the end: see LiveSimulation.run, and
        # Pace, by which it goes on by 0.2 s at once, at most.
        if time > 0.2 and not resets:
            resets.append(time)
            live.handle([WidgetEvent("reset")])

    live.run(DURATION, press)

    assert resets[0] < DURATION
    assert live.simulation.time == pytest.approx(DURATION, abs=1e-12)
    assert same_bits(live.simulation.rollout(), expected)


def test_a_reset_while_it_is_paused_leaves_it_paused(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, is_paused=True)
    live.step(3)

    live.reset()

    assert (live.simulation.time, live.is_playing) == (0.0, False)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_steps_of_a_motion_are_sent_in_time(
    page: Page, robot: ad.Robot, rate: float
) -> None:
    live = make(page, robot, realtime_rate=rate)

    live.run(DURATION)

    # The tick at or after its time takes a step, and its cycle switches.
    lines = [line.split(" s  ") for line in reversed(live.log.splitlines())]
    switch = next(float(time) for time, text in lines if "activated group" in text)
    # News are collected where it has come to: never before, soon after.
    assert 0.65 <= switch <= 0.65 + 0.1 * rate + PERIOD


class Clock:
    """Wall time; simulating takes some of it, and waiting what is asked for [s]."""

    def __init__(self, page: Page, live: LiveSimulation, cost: float) -> None:
        self.now = 0.0
        self._page, self._events = page, page.events
        self._advance_to, self._cost = live._advance_to, cost
        self._live = live

    def perf_counter(self) -> float:
        return self.now

    def events(self, timeout: float) -> list[WidgetEvent]:
        self.now += timeout + 1e-6
        return self._events(0.0)

    def advance_to(self, target: float) -> None:
        self.now += self._cost * (target - self._live.simulation.time)
        self._advance_to(target)


def with_clock(
    live: LiveSimulation, page: Page, patch: pytest.MonkeyPatch, cost: float
) -> Clock:
    clock = Clock(page, live, cost)
    patch.setattr(mut, "time", clock)
    patch.setattr("arm_drake.visualization.page.live_simulation.time", clock)
    patch.setattr(page, "events", clock.events)
    patch.setattr(live, "_advance_to", clock.advance_to)
    return clock


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0])
def test_the_rate_is_kept(
    page: Page, robot: ad.Robot, monkeypatch: pytest.MonkeyPatch, rate: float
) -> None:
    live = make(page, robot, realtime_rate=rate)
    clock = with_clock(live, page, monkeypatch, cost=0.05)

    live.run(4.0)

    # A picture more or less, at the end.
    assert clock.now == pytest.approx(4.0 / rate, abs=0.05)
    assert live.wall_time == pytest.approx(4.0 / rate, abs=0.05)
    assert live.realtime_factor == pytest.approx(rate, rel=0.05)


@pytest.mark.slow
def test_a_simulation_that_is_too_slow_leaves_the_page_alive(
    page: Page, robot: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = make(page, robot, realtime_rate=1.0)
    # A simulated second takes three.
    clock = with_clock(live, page, monkeypatch, cost=3.0)
    looks: list[float] = []
    take = clock.events

    def look(timeout: float) -> list[WidgetEvent]:
        looks.append(clock.now)
        return take(timeout)

    monkeypatch.setattr(page, "events", look)

    live.run(2.0)

    assert live.realtime_factor == pytest.approx(1.0 / 3.0, rel=0.05)
    # But for the first steps, which find out how long one takes.
    assert max(np.diff(looks[5:])) <= 0.05 + 1.0 / 30.0 + 1e-3
    assert clock.now == pytest.approx(6.0, rel=0.05)


def test_the_page_is_served_while_nobody_looks_at_events(
    page: Page, robot: ad.Robot
) -> None:
    make(page, robot, realtime_rate=1.0)

    # This thread, which is the simulation's, does nothing for the page.
    with urllib.request.urlopen(page.url, timeout=PATIENCE) as answer:  # noqa: S310
        assert b"panel.js" in answer.read()


def test_what_is_clicked_is_done(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, motion=None)

    live.handle([WidgetEvent("play")])
    assert not live.is_playing
    live.handle([WidgetEvent("step")])
    assert live.simulation.time == pytest.approx(PERIOD)
    live.handle([WidgetEvent("play")])
    assert live.is_playing
    live.handle([WidgetEvent("rate", "0.25 ×")])
    assert live.realtime_rate == 0.25
    live.handle([WidgetEvent("rate", "as fast as it goes")])
    assert live.realtime_rate == 0.0
    live.handle([WidgetEvent("reset")])
    assert live.simulation.time == 0.0
    live.handle([WidgetEvent("frame")])


def test_controllers_are_switched_and_the_news_say_so(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, motion=None, is_paused=True)
    live.step(3)

    live.handle([WidgetEvent("deactivate:arm")])
    live.step(3)
    live.handle([WidgetEvent("activate:group")])
    live.step(3)

    states = {row.name: row.state for row in live.simulation.list_controllers()}
    assert states == {"states": "active", "arm": "inactive", "group": "active"}
    texts = [line.split(" s  ")[1] for line in reversed(live.log.splitlines())]
    assert texts == ["deactivated arm", "activated group"]


def test_what_sliders_send_is_news_of_a_drag_its_end(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, motion=None, is_paused=True)
    live.step(3)
    joint, other = live.remotes[0].widgets()[:2]

    for value in (0.1, 0.2, 0.3):
        live.handle([WidgetEvent(joint.id, value)])
    live.handle([WidgetEvent(other.id, 0.1)])
    live.handle([WidgetEvent(joint.id, 0.4)])

    texts = [line.split(" s  ")[1] for line in reversed(live.log.splitlines())]
    names = [widget.id.split(":")[-1] for widget in (joint, other)]
    assert texts == [
        f"arm: goal {names[0]} 0.3 by the panel",
        f"arm: goal {names[1]} 0.1 by the panel",
        f"arm: goal {names[0]} 0.4 by the panel",
    ]


def test_news_tell_the_goal_that_is_sent_not_one_beyond_the_range(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, motion=None, is_paused=True)
    live.step(3)
    joint = live.remotes[0].widgets()[0]

    live.handle([WidgetEvent(joint.id, 99.0)])

    assert f"{joint.upper:.4g} by the panel" in live.log
    assert "99" not in live.log


@pytest.mark.slow
def test_news_have_a_line_each_the_newest_first(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot)

    live.run(DURATION)

    texts = [line.split(" s  ")[1] for line in reversed(live.log.splitlines())]
    # Feedback at 20 Hz is no news.
    assert texts == [
        "arm: goal EXECUTING",
        "arm: goal EXECUTING",
        "arm: goal ABORTED, error code -1: Current goal preempted by new incoming "
        "action.",
        "arm: goal SUCCEEDED, error code 0: Goal successfully reached!",
        "activated group; deactivated arm",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("height", "news"),
    [
        (0.0, ""),
        (
            -0.2,
            "0.00 s  arm reaches 200 mm below the ground; to stand on it: --pose "
            "x y z roll pitch yaw, with z larger by 0.2",
        ),
    ],
)
def test_who_stands_in_the_ground_hears_of_it(
    page: Page, height: float, news: str
) -> None:
    sunk = ad.load_robot("lab5_arm", pose=[0, 0, height, 0, 0, 0])

    assert make(page, sunk, motion=None).log == news


@pytest.mark.slow
@pytest.mark.parametrize(
    ("event", "message"),
    [
        (
            WidgetEvent("activate:grup"),
            "no controller 'grup'; did you mean 'group'? known: arm, group, states",
        ),
        (
            WidgetEvent("rate", "quick"),
            "real-time rate: expected a number, got 'quick'",
        ),
        (WidgetEvent("rate", ""), "real-time rate: expected a number, got ''"),
        (WidgetEvent("rate", None), "real-time rate: expected a number, got None"),
        (WidgetEvent("rate", {}), "real-time rate: expected a number, got {}"),
        (WidgetEvent("rate", "-1 ×"), "real-time rate: expected at least 0, got -1.0"),
        (WidgetEvent("rate", "nan"), "real-time rate: expected at least 0, got nan"),
        (
            WidgetEvent("fixed_frame", "lowr"),
            "fixed frame: no link 'lowr'; did you mean 'lower'? known: base, lower, "
            "upper, world",
        ),
        (
            WidgetEvent("trail", 3),
            "trail: no link '3'; known: base, lower, upper",
        ),
        (
            WidgetEvent("show:everything", True),
            "nothing called 'everything' can be shown; known: collision, frames, "
            "inertia, joint_axes, names, visual",
        ),
        (
            WidgetEvent("remote:arm:none", 1.0),
            None,
        ),
    ],
)
def test_what_cannot_be_done_is_said_on_the_page_and_it_goes_on(
    page: Page, robot: ad.Robot, event: WidgetEvent, message: str | None
) -> None:
    live = make(page, robot)
    with Panel(page.port) as panel:
        live.handle([event])
        said = panel.hear_until(lambda m: m["type"] == "message")

        assert said["severity"] == "error"
        if message is not None:
            assert said["text"] == message
        live.run(0.02)

        # The next click that can be done takes it away.
        live.handle([WidgetEvent("frame")])
        panel.hear_until(lambda m: m.get("text") == "")


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, True, -1, 10**400, [], {}, "x", "x" * 1000])
@pytest.mark.parametrize(
    "name",
    [
        "play",
        "seek",
        "replay",
        "rate",
        "activate:",
        "deactivate:none",
        "remote:",
        "remote:arm:",
        "remote:arm:joint:shoulder",
        "trail",
        "fixed_frame",
        "show:",
        "show:ghost",
        "nothing",
        "",
        ":",
    ],
)
def test_no_event_harms_it(
    page: Page, live_for_garbage: LiveSimulation, name: str, value: Any
) -> None:
    live_for_garbage.handle([WidgetEvent(name, value)])

    live_for_garbage.step()


@pytest.fixture(scope="module")
def live_for_garbage(robot: ad.Robot) -> Iterator[LiveSimulation]:
    with Page() as page:
        yield make(page, robot, motion=None)


def test_a_browser_sees_it_go_and_stops_it(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, motion=None, realtime_rate=1.0)
    with Panel(page.port) as panel:
        panel.say("play")
        panel.say("rate", "2 ×")
        page.call(live.stop)
        wait_until(lambda: len(page._events) == 2)

        live.run()

        panel.hear_field("play", "label", "play")
        panel.hear_field("rate", "value", "2 ×")
        panel.hear_field("factor", "value", "–")
        panel.hear_field("controller:arm", "state", "active")
    assert live.simulation.time == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["accurate", "kinematic"])
@pytest.mark.parametrize("fixed_frame", ["world", "lower"])
def test_the_past_is_shown_as_it_was(
    page: Page, robot: ad.Robot, preset: str, fixed_frame: str
) -> None:
    live = make(page, robot, preset, frame_rate=20.0)
    live.views.set_fixed_frame(fixed_frame)
    path = f"/drake/visual/{robot.name}/lower"
    live.run(0.25)
    before = pose(page.meshcat, path)
    live.run(0.3)
    now = pose(page.meshcat, path)
    seen = []

    def look(time: float) -> None:
        seen.append(pose(page.meshcat, path))
        live.stop()

    live.handle([WidgetEvent("seek", 0.26)])
    assert live.shown_time == 0.26
    live.run(1.0, look)

    assert not np.allclose(before, now) or fixed_frame != "world"
    np.testing.assert_allclose(seen[0], before, atol=1e-12)
    # The present is back.
    np.testing.assert_allclose(seen[-1], now, atol=1e-12)
    assert live.simulation.time == pytest.approx(0.55)


@pytest.mark.slow
def test_a_look_at_the_past_does_not_change_what_comes(
    page: Page, robot: ad.Robot, expected: ad.Rollout
) -> None:
    live = make(page, robot, realtime_rate=2.0)
    looks = itertools.count()
    clicks = {
        1: WidgetEvent("seek", 0.05),
        2: WidgetEvent("play"),
        3: WidgetEvent("replay"),
    }

    def press(time: float) -> None:
        if event := clicks.get(next(looks)):
            live.handle([event])
        elif not live.is_playing and live.shown_time == live.simulation.time:
            # All has been replayed.
            live.play()

    live.run(DURATION, press)

    assert next(looks) > 4
    assert same_bits(live.simulation.rollout(), expected)


@pytest.mark.slow
def test_what_was_is_forgotten_with_the_history(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, motion=None, frame_rate=20.0, history=0.5)

    live.run(3.0)
    live.run(0.01)

    assert 1.5 < live.first_time < 2.6
    live.seek(0.0)
    assert live.shown_time == live.first_time
    live.reset()
    assert live.shown_time == live.first_time == 0.0


@pytest.mark.slow
def test_it_waits_for_a_browser(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, motion=None)
    threading.Timer(0.3, live.stop).start()
    live.wait_for_browser()  # Nobody comes.
    live.run(1.0)
    assert live.simulation.time == 0.0

    with Panel(page.port) as panel:
        live.wait_for_browser()
        panel.hear_field("play", "label", "pause")
    assert live.simulation.time == 0.0


def test_a_browser_can_end_it(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, motion=None)

    live.handle([WidgetEvent("end")])
    live.run(1.0)

    assert live.is_ended
    assert live.simulation.time == 0.0


def test_progress_is_told_up_to_the_end(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot)
    reported: list[float] = []

    live.run(0.5, reported.append)

    assert reported == sorted(reported)
    assert reported[-1] == pytest.approx(0.5)


def test_the_present_rate_is_one_of_the_choices(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot, realtime_rate=3.0)
    with Panel(page.port) as panel:
        message = panel.hear_until(lambda m: m["type"] == "panel")

    widgets = [w for s in message["sections"] for w in s["widgets"]]
    rate = next(w for w in widgets if w.get("id") == "rate")
    assert rate["value"] == "3 ×"
    assert rate["options"] == [
        *("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "3 ×", "5 ×", "10 ×"),
        "as fast as it goes",
    ]
    assert live.realtime_rate == 3.0


def test_a_motion_that_the_robot_cannot_do_is_said_at_once(
    page: Page, robot: ad.Robot
) -> None:
    motion = parse_motion([{"at": 0.0, "controller": "none", "commands": [0.0]}])

    with pytest.raises(MotionError, match="no controller 'none'"):
        make(page, robot, motion=motion)


def test_a_task_is_reported_of_that_nobody_goes_on_to_begin(
    page: Page, robot: ad.Robot
) -> None:
    task = {"at": 0.2, "plan_to": {"positions": {"shoulder": 0.3}}}
    live = make(page, robot, motion=parse_motion([task]))
    live.run(0.1)
    # It may go on from there.
    assert not live.simulation.rejected

    live.give_up()

    (outcome,) = live.simulation.rejected
    told = "[0].plan_to: not begun: the simulation ended before its time"
    assert live.simulation.mailbox.describe(outcome) == told
    assert told in live.log
    live.run(0.2)
    assert not live.simulation.goals


def test_a_page_that_closes_gives_up(page: Page, robot: ad.Robot) -> None:
    task = {"at": 0.2, "plan_to": {"positions": {"shoulder": 0.3}}}
    live = make(page, robot, motion=parse_motion([task]))

    live.close()

    assert len(live.simulation.rejected) == 1


def test_what_was_simulated_is_kept_when_meshcat_ends(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, realtime_rate=1.0)
    live.run(0.2)
    end_meshcat(page)

    with pytest.raises(SimulationError, match="Meshcat has ended"):
        live.run(0.2)

    assert live.simulation.rollout().time[-1] == pytest.approx(0.2, abs=0.011)


def test_what_cannot_be_shown_is_said_at_once(page: Page, robot: ad.Robot) -> None:
    with pytest.raises(InputError, match="nothing called 'visul' can be shown"):
        make(page, robot, shown=["visul"])


def test_of_a_sliders_way_the_end_counts() -> None:
    queue = EventQueue()
    events = [
        WidgetEvent("a", 1.0),
        WidgetEvent("a", 2.0),
        WidgetEvent("b", 1.0),
        WidgetEvent("a", 3.0),
        WidgetEvent("a", 4.0),
        WidgetEvent("go"),
        WidgetEvent("go"),
        WidgetEvent("a", 5.0),
    ]

    was_empty = [queue.put(event) for event in events]

    assert was_empty == [True] + [False] * 7
    assert queue.take() == [
        WidgetEvent("b", 1.0),
        WidgetEvent("a", 4.0),
        WidgetEvent("go"),
        WidgetEvent("go"),
        WidgetEvent("a", 5.0),
    ]


@pytest.mark.slow
def test_a_recording_has_a_picture_for_each_of_its_times(
    page: Page, robot: ad.Robot
) -> None:
    rate = 30.0
    live = make(page, robot, realtime_rate=1.0, frame_rate=rate)

    live.run(DURATION)

    page.meshcat.StopRecording()
    with WebSocket(page.port, "/meshcat/") as scene:
        page.meshcat.PublishRecording()
        data = b""
        while b"set_animation" not in data:
            _, data = scene.read()
    (clip,) = (
        animation["clip"]
        for animation in unpack(data)["animations"]
        if animation["path"].endswith("/lower")
    )
    (track,) = (t for t in clip["tracks"] if t["name"] == ".quaternion")
    rollout = live.simulation.rollout()
    angles = rollout.position.sum(axis=1)
    assert len(track["keys"]) == round(DURATION * rate) + 1
    for key in track["keys"]:
        _, y, _, w = key["value"]
        expected = np.interp(key["time"] / rate, rollout.time, angles)
        # Between two ticks of 10 ms it moves evenly, but for acceleration: 20 rad/s^2
        # make 1 mrad at most; a picture of another time is tens of mrad off.
        assert 2.0 * np.arctan2(y, w) == pytest.approx(expected, abs=2e-3)


def test_stop_wakes_a_simulation_that_waits_for_a_click(
    page: Page, robot: ad.Robot
) -> None:
    live = make(page, robot, is_paused=True)

    live.stop()

    # A wait may have no end, see Page.call.
    start = time.monotonic()
    live.page.events(20.0)
    assert time.monotonic() - start < 10.0


@pytest.mark.slow
def test_a_click_saves_the_scene_as_it_is_now(
    page: Page, robot: ad.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text("kept", encoding="utf-8")
    live = make(page, robot, scene=ad.Scene(robots=(robot,)), is_paused=True)
    live.step(200)

    live.handle([WidgetEvent("save_scene", None)])

    assert "scene saved: scene_2.yaml" in live.log
    assert Path("scene.yaml").read_text(encoding="utf-8") == "kept"
    (saved,) = ad.load_scene("scene_2.yaml").robots
    states = live.simulation.joint_states()
    now = dict(zip(states.name, states.position, strict=True))
    assert saved.initial_positions == pytest.approx(now)


def test_without_a_scene_there_is_no_button(page: Page, robot: ad.Robot) -> None:
    live = make(page, robot)

    with pytest.raises(InputError, match="no scene was given"):
        live.save_scene()
