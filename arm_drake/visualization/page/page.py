"""A page: Meshcat's scene with a panel, for the thread that made it."""

import queue
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from arm_drake.errors import InputError
from arm_drake.visualization.page.scene import Event, Scene
from arm_drake.visualization.page.server import PageServer
from arm_drake.visualization.page.widgets import Section

# Meshcat ends its connections within milliseconds [s].
_LONGEST_GOODBYE = 1.0


class Page(Scene):
    """A page in the browser, with a scene and a panel.

    Drake's Meshcat can be used in the thread alone that made it: `events` brings what
    happens in browsers, and what other threads want done, to this thread.
    """

    def __init__(self, *, host: str = "localhost", port: int | None = None) -> None:
        """Start to serve a page with an empty scene and no controls.

        Args:
            host: Address to listen on; "localhost" is seen from this machine only, "*"
                from everywhere.
            port: Port to listen on, or the first free one after it; by default the
                first free one from 7000 on.

        Raises:
            InputError: If it can't listen there.
        """
        self._queue: queue.SimpleQueue[Event | Callable[[], None]] = queue.SimpleQueue()
        super().__init__()
        # What was last sent of each widget.
        self._fields: dict[str, dict[str, Any]] = {}
        try:
            self._server = PageServer(
                host=host,
                port=port,
                meshcat_port=self.meshcat.port(),
                on_event=lambda name, value: self._queue.put(Event(name, value)),
            )
        except InputError:
            super().close()
            raise

    @property
    def url(self) -> str:
        """Its address."""
        return self._server.url

    @property
    def port(self) -> int:
        """Its port."""
        return self._server.port

    @property
    def has_moved(self) -> bool:
        """Whether the port that it should have was taken."""
        return self._server.has_moved

    @property
    def is_public(self) -> bool:
        """Whether other machines can open it."""
        return self._server.is_public

    @property
    def num_browsers(self) -> int:
        """How many browsers show it."""
        return self._server.num_clients

    def set_panel(self, title: str, sections: Sequence[Section]) -> None:
        """Replace the panel.

        Args:
            title: What stands above it, and in the browser's tab.
            sections: What it consists of.
        """
        content = [section.to_json() for section in sections]
        self._fields.clear()
        self._server.send({"type": "panel", "title": title, "sections": content})

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets.

        Args:
            changes: New values of fields, by the widget's name.
        """
        news: dict[str, dict[str, Any]] = {}
        for name, fields in changes.items():
            known = self._fields.setdefault(name, {})
            for field, value in fields.items():
                if field not in known or known[field] != value:
                    known[field] = value
                    news.setdefault(name, {})[field] = value
        if news:
            self._server.send({"type": "patch", "changes": news})

    def say(self, text: str, severity: str = "info") -> None:
        """Show a message above everything; an empty one removes it.

        Args:
            text: The message.
            severity: "info", "warning" or "error".
        """
        self._server.send({"type": "message", "text": text, "severity": severity})

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things of the scene.

        Args:
            labels: Names by Meshcat path.
        """
        self._server.send({"type": "labels", "labels": dict(labels)})

    def call(self, function: Callable[[], None]) -> None:
        """Have something done by the thread of the page; any thread may ask.

        A signal's handler may ask, too, and has to, if it wants to end a wait: after a
        signal at the end of its time, Python's SimpleQueue may wait for ever.
        """
        self._queue.put(function)

    def events(self, timeout: float) -> list[Event]:
        """Return what happened in browsers, in order; do what threads asked for.

        Args:
            timeout: How long to wait for the first [s].
        """
        found: list[Event] = []
        try:
            entry = self._queue.get(timeout=timeout) if timeout > 0.0 else None
            while True:
                if isinstance(entry, Event):
                    found.append(entry)
                    # The browser shows another value than it was told.
                    self._fields.get(entry.id, {}).pop("value", None)
                elif entry is not None:
                    entry()
                entry = self._queue.get_nowait()
        except queue.Empty:
            return found

    def close(self) -> None:
        """End it: its address is free again. What is in its scene goes."""
        if self._is_closed:
            return
        self._server.close()
        deadline = time.monotonic() + _LONGEST_GOODBYE
        while self.meshcat.GetNumActiveConnections() and time.monotonic() < deadline:
            time.sleep(0.005)
        super().close()
