"""Runs in this process: one after the other, or in threads."""

import contextvars
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from arm_drake.batch.results import Done, attempt
from arm_drake.batch.stopping import Stop, enter_thread


def run_serially(
    function: Callable[[Any], Any], items: Sequence[Any], indices: Iterable[int]
) -> Iterator[Done]:
    """Run inputs one after the other.

    Args:
        function: What to run.
        items: The inputs.
        indices: Places of those to run.
    """
    for index in indices:
        yield attempt(function, index, items[index])


def run_in_threads(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    indices: Iterable[int],
    num_threads: int,
) -> Iterator[Done]:
    """Run inputs in threads; yield what becomes of them as they end.

    Who closes the iterator waits for what is under way: a Run stops within 0.1 s of its
    simulated time, a function of a user ends first.

    Args:
        function: What to run.
        items: The inputs.
        indices: Places of those to run.
        num_threads: How many run at a time.
    """
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    num_waiting = 0
    for index in indices:
        waiting.put(index)
        num_waiting += 1
    ended: queue.SimpleQueue[Done] = queue.SimpleQueue()
    stop = threading.Event()

    def work() -> None:
        enter_thread(stop)
        while not stop.is_set():
            try:
                index = waiting.get_nowait()
                ended.put(attempt(function, index, items[index]))
            except (queue.Empty, Stop):
                return
            except BaseException as error:  # Nobody else would tell.
                ended.put(Done(index, None, RuntimeError(repr(error)), 0.0))

    threads = [
        threading.Thread(target=contextvars.copy_context().run, args=(work,))
        for _ in range(min(num_threads, num_waiting))
    ]
    for thread in threads:
        thread.start()
    try:
        for _ in range(num_waiting):
            yield ended.get()
    finally:
        stop.set()
        for thread in threads:
            thread.join()
