"""What is drawn on, whether there is a page that shows it or not."""

import dataclasses as dc
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

from arm_drake.visualization.page.meshcats import give_back, take_meshcat
from arm_drake.visualization.page.widgets import Section


@dc.dataclass(frozen=True)
class Event:
    """What somebody did in a browser."""

    # The widget's name.
    id: str

    # Its new value; None of a button.
    value: Any = None


class Scene:
    """A Meshcat, for recordings and pictures; a `Page` has a panel besides."""

    def __init__(self) -> None:
        """Create it, with nothing drawn."""
        self.meshcat = take_meshcat()
        self._is_closed = False

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets, where there is a panel.

        Args:
            changes: New values of fields, by the widget's name.
        """

    def set_panel(self, title: str, sections: Sequence[Section]) -> None:
        """Replace the panel, where there is one.

        Args:
            title: What stands above it.
            sections: What it consists of.
        """

    def say(self, text: str, severity: str = "info") -> None:
        """Show a message, where there is a page.

        Args:
            text: The message.
            severity: "info", "warning" or "error".
        """

    def call(self, function: Callable[[], None]) -> None:
        """Have something done by the thread of the page; without a page, nobody does.

        Args:
            function: Does it.
        """

    def events(self, timeout: float) -> list[Event]:
        """Return what happened in browsers.

        Args:
            timeout: How long to wait for the first [s].
        """
        time.sleep(timeout)
        return []

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things of the scene, where there is a page.

        Args:
            labels: Names by Meshcat path.
        """

    def close(self) -> None:
        """End it: what is drawn goes."""
        if not self._is_closed:
            self._is_closed = True
            give_back(self.meshcat)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()
