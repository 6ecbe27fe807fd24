"""Types of the command line's words."""

import argparse
from collections.abc import Sequence
from typing import Any

from arm_drake.errors import suggest


def pair(separator: str) -> Any:
    """Return what parses NAME<separator>VALUE."""

    def parse(text: str) -> tuple[str, str]:
        name, found, value = text.partition(separator)
        if not found or not name:
            raise argparse.ArgumentTypeError(
                f"expected NAME{separator}VALUE, got {text!r}"
            )
        return name, value

    return parse


def positive(text: str) -> float:
    """Return a number above 0."""
    number = not_negative(text)
    if number == 0.0:
        raise argparse.ArgumentTypeError("expected a positive number, got 0")
    return number


def not_negative(text: str) -> float:
    """Return a number of at least 0."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0.0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return number


def words_of(known: Sequence[str]) -> Any:
    """Return what parses words of a list, with commas between them."""

    def parse(text: str) -> tuple[str, ...]:
        words = tuple(word for word in text.replace(" ", "").split(",") if word)
        for word in words:
            if word not in known:
                raise argparse.ArgumentTypeError(
                    f"unknown {word!r}; {suggest(word, known)}"
                )
        return words

    return parse
