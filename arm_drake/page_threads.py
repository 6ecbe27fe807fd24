"""Threads in which pages live beside a program that goes on, as in a notebook.

A Meshcat can be used in the thread alone that made it, and is never destroyed (see
`arm_drake.visualization.page.meshcats`). So a thread that has served a page waits for
the next one: however often a cell is run again, no more servers are there than pages
were at once.
"""

import concurrent.futures
import queue
import sys
import threading
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from arm_drake.visualization.page import Page

T = TypeVar("T")


class Runner(Protocol):
    """What uses a page: a RobotViewer, a LiveSimulation."""

    def run(self) -> None:
        """Do what is clicked until it is stopped."""

    def stop(self) -> None:
        """End `run`."""


class _Workers:
    """The threads that wait for a page."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[queue.SimpleQueue[Callable[[], None]]] = []

    def do(self, task: Callable[[], None]) -> None:
        """Have a thread do something, an idle one if there is one."""
        with self._lock:
            tasks = self._idle.pop() if self._idle else None
        if tasks is None:
            tasks = queue.SimpleQueue()
            name = "arm_drake pages"
            threading.Thread(
                target=self._work, args=(tasks,), name=name, daemon=True
            ).start()
        tasks.put(task)

    def _work(self, tasks: queue.SimpleQueue[Callable[[], None]]) -> None:
        while True:
            task = tasks.get()
            task()
            del task  # What it holds may go.
            with self._lock:
                self._idle.append(tasks)


_workers = _Workers()


class PageThread:
    """A page with what uses it, in a thread of its own."""

    def __init__(
        self, make_page: Callable[[], Page], make: Callable[[Page], Any]
    ) -> None:
        """Start it, and wait until the page is there.

        Args:
            make_page: Makes the page, in the thread.
            make: Makes what uses the page, a `Runner`, in the thread.

        Raises:
            Whatever one of these raises.
        """
        self._ready: concurrent.futures.Future[Page] = concurrent.futures.Future()
        self._done = threading.Event()
        self._is_unwanted = False
        self._runner: Any = None
        self._thread: int | None = None
        # What ended it, if nobody did.
        self.error: BaseException | None = None
        _workers.do(lambda: self._live(make_page, make))
        try:
            self._page = self._ready.result()
        except BaseException:
            # Such as a Ctrl-C, while the page is still being made.
            self._is_unwanted = True
            raise

    @property
    def url(self) -> str:
        """The page's address."""
        return self._page.url

    @property
    def is_open(self) -> bool:
        """Whether the page is still there."""
        return not self._done.is_set()

    def call(self, function: Callable[[Any], T]) -> T:
        """Do something in the thread and return what it returns.

        Args:
            function: Takes what uses the page.

        Raises:
            RuntimeError: If the page is closed.
            Whatever the function raises.
        """
        if threading.get_ident() == self._thread:
            return function(self._runner)
        result: concurrent.futures.Future[T] = concurrent.futures.Future()

        def act() -> None:
            try:
                result.set_result(function(self._runner))
            # It is the caller's, whatever it is; Drake's checks end in a SystemExit.
            except BaseException as error:
                result.set_exception(error)

        if self.is_open:
            self._page.call(act)
        while not result.done():
            concurrent.futures.wait([result], timeout=0.1)
            if not self.is_open and not result.done():
                why = f": {self.error}" if self.error is not None else ""
                raise RuntimeError(f"the page is closed{why}") from self.error
        return result.result()

    def request_close(self) -> None:
        """Have the page end, and don't wait for it."""
        if self.is_open:
            self._page.call(lambda: self._runner.stop())

    def close(self) -> None:
        """End the page; its address is free again."""
        self.request_close()
        if threading.get_ident() != self._thread:
            self._done.wait()

    def _live(self, make_page: Callable[[], Page], make: Callable[[Page], Any]) -> None:
        self._thread = threading.get_ident()
        try:
            with make_page() as page:
                self._runner = make(page)
                self._ready.set_result(page)
                if not self._is_unwanted:
                    self._runner.run()
        except BaseException as error:
            if not self._ready.done():
                self._ready.set_exception(error)
            else:
                self.error = error
                print(f"arm_drake: a page has ended: {error}", file=sys.stderr)
        finally:
            self._runner = self._thread = None
            self._done.set()
