"""Clicks on the page of `arm-drake view`."""

from collections.abc import Iterator
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.robot_viewer import RobotViewer, handle_events
from tests.models import GRIPPER, load


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RobotViewer]:
    robot: ad.Robot = load(tmp_path_factory.mktemp("robot"), GRIPPER)
    with Page() as page:
        yield RobotViewer(page, lambda: robot, is_watching=False)


@pytest.fixture
def calls(viewer: RobotViewer, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The methods that are called, with their arguments."""
    found: list[Any] = []

    def spy(name: str) -> Any:
        return lambda *inputs: found.append((name, *inputs))

    for name in (
        *("set_positions", "show", "set_fixed_frame", "take_named_pose"),
        *("randomize", "center", "frame", "show_ghost", "hide_ghost"),
    ):
        monkeypatch.setattr(viewer, name, spy(name))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("event", "call"),
    [
        (WidgetEvent("joint:finger", 0.5), ("set_positions", {"finger": 0.5})),
        (WidgetEvent("joint:finger", 1), ("set_positions", {"finger": 1})),
        (WidgetEvent("show:frames", True), ("show", "frames", True)),
        (WidgetEvent("show:frames", False), ("show", "frames", False)),
        (WidgetEvent("fixed_frame", "left"), ("set_fixed_frame", "left")),
        (WidgetEvent("pose:arm: up"), ("take_named_pose", "arm: up")),
        (WidgetEvent("randomize"), ("randomize",)),
        (WidgetEvent("center"), ("center",)),
        (WidgetEvent("frame"), ("frame",)),
        (WidgetEvent("show_ghost"), ("show_ghost",)),
        (WidgetEvent("hide_ghost"), ("hide_ghost",)),
    ],
)
def test_a_click_is_a_method(
    viewer: RobotViewer, calls: list[Any], event: WidgetEvent, call: Any
) -> None:
    assert list(handle_events(viewer, [event])) == []

    assert calls == [call]


@pytest.mark.slow
def test_of_a_sliders_way_the_end_counts_up_to_the_next_click(
    viewer: RobotViewer, calls: list[Any]
) -> None:
    events = [
        *(WidgetEvent("joint:finger", value) for value in (0.1, 0.2, 0.3)),
        WidgetEvent("show_ghost"),
        *(WidgetEvent("joint:finger", value) for value in (0.4, 0.5)),
    ]

    list(handle_events(viewer, events))

    assert calls == [
        ("set_positions", {"finger": 0.3}),
        ("show_ghost",),
        ("set_positions", {"finger": 0.5}),
    ]


@pytest.mark.parametrize(
    "value",
    [None, "1", "x", [], {}, float("nan"), float("inf"), 10**400],
)
def test_a_joint_takes_numbers_only(
    viewer: RobotViewer, calls: list[Any], value: Any
) -> None:
    events = [WidgetEvent("joint:finger", value), WidgetEvent("joint:finger2", 1.0)]

    assert list(handle_events(viewer, events)) == []

    assert calls == []


def test_a_joint_that_follows_or_is_gone_is_left_out(
    viewer: RobotViewer, calls: list[Any]
) -> None:
    events = [WidgetEvent("joint:follower", 0.1), WidgetEvent("joint:gone", 0.1)]

    assert list(handle_events(viewer, events)) == []

    assert calls == []


def test_what_cannot_be_done_is_reported_and_the_rest_is_done(
    viewer: RobotViewer,
) -> None:
    events = [
        WidgetEvent("fixed_frame", "nowhere"),
        WidgetEvent("pose:up"),
        WidgetEvent("show:all", True),
        WidgetEvent("joint:finger", 0.25),
    ]

    problems = list(handle_events(viewer, events))

    assert problems == [
        "fixed frame: no link 'nowhere'; known: base, left, right, world",
        "no pose 'up'; the robot has no SRDF with poses",
        "nothing called 'all' can be shown; known: collision, frames, inertia, "
        "joint_axes, names, visual",
    ]
    assert viewer.positions["finger"] == 0.25


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, True, -1, 1e308, 10**400, [], {}, "x" * 999])
@pytest.mark.parametrize(
    "name",
    [
        *("joint:finger", "joint:", "show:visual", "show:", "fixed_frame", "pose:"),
        *("randomize", "center", "frame", "show_ghost", "hide_ghost"),
        *("run", "stop", "reload", "__init__", "", ":", "nothing:"),
    ],
)
def test_no_event_harms_it(viewer: RobotViewer, name: str, value: Any) -> None:
    list(handle_events(viewer, [WidgetEvent(name, value)]))

    assert set(viewer.positions) == {"finger", "follower"}
    assert all(-3.0 <= q <= 3.0 for q in viewer.positions.values())
