"""Widgets of a panel.

The names of the fields are those of the page's script, `static/widgets.js`.
"""

import dataclasses as dc
from typing import Any

from arm_drake.importing import dataclass


@dataclass(frozen=True)
class Slider:
    """A number between two others."""

    # Name of its events; unique in the panel.
    id: str

    label: str

    # Its range, in its unit.
    lower: float
    upper: float

    value: float
    unit: str = ""

    # Whether it can be moved.
    is_enabled: bool = True

    # What is shown when the pointer rests on it.
    hint: str = ""


@dataclass(frozen=True)
class Button:
    """Something to click."""

    id: str
    label: str
    hint: str = ""
    is_enabled: bool = True

    # Key of the keyboard that clicks it, as in JavaScript's KeyboardEvent.key.
    key: str = ""

    # What it says after a click, for a while, in which a second one counts; nothing
    # is for buttons whose first click counts.
    question: str = ""


@dataclass(frozen=True)
class Buttons:
    """Buttons beside each other."""

    buttons: tuple[Button, ...]


@dataclass(frozen=True)
class Toggle:
    """Something that is on or off."""

    id: str
    label: str
    value: bool
    hint: str = ""


@dataclass(frozen=True)
class Choice:
    """One of several texts."""

    id: str
    label: str
    options: tuple[str, ...]
    value: str
    hint: str = ""


@dataclass(frozen=True)
class Text:
    """Text to read."""

    id: str
    label: str
    value: str = ""

    # Whether it has several lines, and a button that copies it.
    can_copy: bool = False


@dataclass(frozen=True)
class Item:
    """Something with a state, and buttons that change it."""

    id: str
    label: str

    # What it is, in small letters.
    detail: str
    state: str
    buttons: tuple[Button, ...] = ()


@dataclass(frozen=True)
class Picture:
    """A picture; a click on it makes it large, and small again."""

    id: str

    # What it shows, for who can't see it.
    label: str

    # Address of it, such as one that holds it; nothing is seen without.
    source: str = ""

    # What is written below its left and its right end.
    lower: str = ""
    upper: str = ""


Widget = Slider | Button | Buttons | Toggle | Choice | Text | Item | Picture


@dataclass(frozen=True)
class Section:
    """Widgets below a title; a click on it folds them."""

    title: str
    widgets: tuple[Widget, ...]
    is_open: bool = True

    def to_json(self) -> dict[str, Any]:
        """Return it as the page reads it."""
        widgets = [
            {"kind": type(widget).__name__.lower(), **dc.asdict(widget)}
            for widget in self.widgets
        ]
        return {"title": self.title, "is_open": self.is_open, "widgets": widgets}
