"""Widgets of a panel, as the page's script reads them."""

import dataclasses as dc
import json
import re
from pathlib import Path
from typing import get_args

import pytest

from arm_drake.visualization import page
from arm_drake.visualization.page import (
    Button,
    Buttons,
    Choice,
    Item,
    Picture,
    Section,
    Slider,
    Text,
    Toggle,
    Widget,
)

SCRIPT = Path(page.__file__).parent / "static" / "widgets.js"

EXAMPLES: list[Widget] = [
    Slider("s", "a slider", 0.0, 1.0, 0.5, "m", is_enabled=False, hint="h"),
    Button("b", "a button", "h", key="k"),
    Buttons((Button("b", "one"), Button("c", "two", is_enabled=False))),
    Toggle("t", "a toggle", True),
    Choice("c", "a choice", ("x", "y"), "y"),
    Text("x", "a text", "value", can_copy=True),
    Picture("p", "a picture", "data:,", "0 m", "1 m"),
    Item("i", "an item", "detail", "active", (Button("b", "stop"),)),
]


def makers() -> dict[str, str]:
    """Return what makes a widget in the script, by kind."""
    text = SCRIPT.read_text(encoding="utf-8")
    text = text[text.index("const makers = {") :]
    body = text[: text.index("\n};")]
    parts = re.split(r"\n    (\w+)\(w\) \{", body)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def test_there_is_an_example_of_every_widget() -> None:
    assert {type(widget) for widget in EXAMPLES} == set(get_args(Widget))


@pytest.mark.parametrize("widget", EXAMPLES, ids=lambda widget: type(widget).__name__)
def test_a_widget_is_reported_with_its_kind_and_fields(widget: Widget) -> None:
    said = json.loads(json.dumps(Section("title", (widget,), is_open=False).to_json()))

    assert (said["title"], said["is_open"]) == ("title", False)
    (reported,) = said["widgets"]
    assert reported.pop("kind") == type(widget).__name__.lower()
    assert reported == json.loads(json.dumps(dc.asdict(widget)))


def test_the_script_makes_every_kind() -> None:
    assert set(makers()) == {kind.__name__.lower() for kind in get_args(Widget)}


@pytest.mark.parametrize("kind", get_args(Widget), ids=lambda kind: kind.__name__)
def test_the_script_reads_fields_that_exist_and_all_that_change(kind: type) -> None:
    fields = {field.name for field in dc.fields(kind)}
    read = set(re.findall(r"\bw\.(\w+)", makers()[kind.__name__.lower()]))

    assert read <= fields
    # `id` names the widget, and `key` is read where keys are.
    assert fields - read <= {"id", "key"}


def test_widgets_cannot_be_changed() -> None:
    for widget in EXAMPLES:
        with pytest.raises(dc.FrozenInstanceError):
            widget.id = "other"  # type: ignore[union-attr,misc]
