"""A page for the thread that made it: its panel, its events, its scene."""

import threading
from collections.abc import Iterator

import pytest
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform

from arm_drake.visualization.page import (
    Button,
    Buttons,
    Page,
    Section,
    Slider,
    WidgetEvent,
)
from arm_drake.worlds.things import show_backdrop
from tests.visualization.page.clients import Panel
from tests.waiting import PATIENCE, wait_until

SLIDER = Slider("joint:a", "a", -1.0, 2.0, 0.5, "rad")
SECTIONS = [Section("Joints", (SLIDER,)), Section("More", ())]


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


@pytest.fixture
def panel(page: Page) -> Iterator[Panel]:
    with Panel(page.port) as panel:
        wait_until(lambda: page.num_browsers == 1)
        yield panel


def take(page: Page, count: int) -> list[WidgetEvent]:
    """Return so many events."""
    events: list[WidgetEvent] = []
    while len(events) < count:
        new = page.events(PATIENCE)
        assert new
        events += new
    return events


def test_the_panel_comes_as_it_is_described(page: Page, panel: Panel) -> None:
    page.set_panel("arm", SECTIONS)

    assert panel.hear() == {
        "type": "panel",
        "title": "arm",
        "sections": [
            {
                "title": "Joints",
                "is_open": True,
                "widgets": [
                    {
                        "kind": "slider",
                        "id": "joint:a",
                        "label": "a",
                        "lower": -1.0,
                        "upper": 2.0,
                        "value": 0.5,
                        "unit": "rad",
                        "is_enabled": True,
                        "hint": "",
                    }
                ],
            },
            {"title": "More", "is_open": True, "widgets": []},
        ],
    }


def test_who_comes_late_gets_all_that_counts(page: Page) -> None:
    page.say("first")
    page.set_panel("old", SECTIONS)
    page.patch({"joint:a": {"value": 9.0}, "gone": {"value": 9.0}})
    page.set_labels({"/drake/old": "old"})
    page.set_panel("arm", SECTIONS)
    page.patch({"joint:a": {"value": 1.0, "is_enabled": False}})
    page.patch({"joint:a": {"value": 1.5}, "joint:b": {"value": 2.0}})
    page.say("careful", "warning")
    page.set_labels({"/drake/new": "new"})

    with Panel(page.port) as panel:
        heard = [panel.hear() for _ in range(4)]

    by_type = {message["type"]: message for message in heard}
    assert by_type["panel"]["title"] == "arm"
    assert by_type["patch"]["changes"] == {
        "joint:a": {"value": 1.5, "is_enabled": False},
        "joint:b": {"value": 2.0},
    }
    assert by_type["message"] == {
        "type": "message",
        "text": "careful",
        "severity": "warning",
    }
    assert by_type["labels"]["labels"] == {"/drake/new": "new"}
    # A patch is of the panel before it.
    types = [message["type"] for message in heard]
    assert types.index("panel") < types.index("patch")


def test_patches_of_an_old_panel_do_not_reach_the_new_one(
    page: Page, panel: Panel
) -> None:
    page.set_panel("old", SECTIONS)
    for number in range(500):
        page.patch({"joint:a": {"value": float(number)}})
    page.set_panel("new", SECTIONS)
    page.patch({"joint:a": {"is_enabled": False}})

    panel.hear_until(lambda m: m.get("title") == "new")
    panel.hear_until(lambda m: m["type"] == "patch")

    assert panel.fields == {"joint:a": {"is_enabled": False}}


def test_only_what_changes_is_sent(page: Page, panel: Panel) -> None:
    page.patch({"a": {"value": 1, "label": "x"}, "b": {"value": 2}})
    panel.hear()

    page.patch({"a": {"value": 1, "label": "x"}, "b": {"value": 2}})
    page.patch({"a": {"value": 1, "label": "y"}, "b": {"value": 3}})

    assert panel.hear()["changes"] == {"a": {"label": "y"}, "b": {"value": 3}}


def test_a_value_that_a_browser_has_changed_is_sent_again(
    page: Page, panel: Panel
) -> None:
    page.patch({"a": {"value": 1.0, "label": "x"}})
    panel.hear()
    panel.say("a", 5.0)
    take(page, 1)

    # It isn't taken: the browser still shows 5.
    page.patch({"a": {"value": 1.0, "label": "x"}})

    assert panel.hear()["changes"] == {"a": {"value": 1.0}}


def test_the_same_panel_again_forgets_what_was_sent(page: Page, panel: Panel) -> None:
    page.set_panel("arm", SECTIONS)
    page.patch({"joint:a": {"value": 1.0}})
    panel.hear_field("joint:a", "value", 1.0)
    page.set_panel("arm", SECTIONS)

    page.patch({"joint:a": {"value": 1.0}})

    panel.hear_until(lambda m: m["type"] == "panel")
    panel.hear_field("joint:a", "value", 1.0)


def test_events_come_in_order_with_their_values(page: Page, panel: Panel) -> None:
    values = [1, 2.5, "text", True, False, [1], {"a": 1}]

    panel.say("play")
    for number, value in enumerate(values):
        panel.say(f"joint:{number}", value)

    assert take(page, 8) == [
        WidgetEvent("play"),
        *(WidgetEvent(f"joint:{number}", value) for number, value in enumerate(values)),
    ]


def test_two_browsers_are_heard_and_told(page: Page, panel: Panel) -> None:
    with Panel(page.port) as other:
        wait_until(lambda: page.num_browsers == 2)
        panel.say("one")
        other.say("two")
        assert {event.id for event in take(page, 2)} == {"one", "two"}

        page.say("both")
        assert panel.hear()["text"] == other.hear()["text"] == "both"

    wait_until(lambda: page.num_browsers == 1)


def test_other_threads_have_things_done_by_the_thread_of_the_page(
    page: Page, panel: Panel
) -> None:
    done: list[threading.Thread] = []
    thread = threading.Thread(
        target=lambda: page.call(lambda: done.append(threading.current_thread()))
    )
    thread.start()
    thread.join()
    assert done == []

    assert page.events(PATIENCE) == []

    assert done == [threading.current_thread()]


def test_without_events_it_waits_as_long_as_it_may(page: Page) -> None:
    assert page.events(0.0) == []
    assert page.events(-1.0) == []
    assert page.events(0.01) == []


def test_what_was_in_the_scene_is_not_in_the_next_one() -> None:
    with Page() as page:
        meshcat = page.meshcat
        meshcat.SetObject("/drake/ball", Sphere(1.0))
        meshcat.AddButton("go")
        show_backdrop(meshcat, has_grid=False, background=(1.0, 0.0, 0.0))
        meshcat.SetTransform("/Grid", RigidTransform([0.0, 0.0, 1.0]))
        meshcat.SetTransform("/drake", RigidTransform([0.0, 0.0, 1.0]))

    with Page() as page:
        # Drake can't destroy one where Python may, so it serves again.
        assert page.meshcat is meshcat
        assert not meshcat.HasPath("/drake/ball")
        with pytest.raises(RuntimeError):
            meshcat.GetButtonClicks("go")
        # A world's backdrop and a small robot's grid are not those of the next one.
        assert not meshcat._GetPackedProperty("/Background", "top_color")
        assert not meshcat._GetPackedTransform("/Grid")
        assert not meshcat._GetPackedTransform("/drake")


def test_two_pages_at_once_have_scenes_of_their_own(page: Page) -> None:
    with Page() as other:
        assert other.meshcat is not page.meshcat
        assert other.port != page.port
        with Panel(other.port) as client:
            other.set_panel("other", [Section("s", (Buttons((Button("b", "b"),)),))])
            assert client.hear()["title"] == "other"
            client.say("b")
            assert take(other, 1) == [WidgetEvent("b")]
    assert page.events(0.0) == []
