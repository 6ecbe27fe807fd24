"""News that systems keep for those who don't look at every tick."""

from collections.abc import Iterable
from typing import TypeVar

E = TypeVar("E")

# How many are kept; a Simulation looks every 50 ticks.
NUM_KEPT = 256


def add_news(
    events: tuple[tuple[int, E], ...], news: Iterable[E]
) -> tuple[tuple[int, E], ...]:
    """Return the latest events, numbered one after the other, the newest last.

    Args:
        events: What there was.
        news: What is new.
    """
    first = events[-1][0] + 1 if events else 0
    return (*events, *enumerate(news, start=first))[-NUM_KEPT:]
