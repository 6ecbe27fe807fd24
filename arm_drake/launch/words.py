"""Words of command lines, as launch files have them."""

import itertools
import shlex
from collections.abc import Sequence


def split_words(text: str) -> list[str]:
    """Return the words of a text, as a shell takes them."""
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()


def value_of(words: Sequence[str], *keys: str) -> str | None:
    """Return the word after an option, None if it is missing."""
    for index, word in enumerate(words[:-1]):
        if word in keys:
            return words[index + 1]
    for word in words:
        key, found, value = word.partition("=")
        if found and key in keys and key.startswith("--"):
            return value
    return None


def values_of(words: Sequence[str], key: str) -> list[str]:
    """Return the words after an option, up to the next one."""
    found: list[str] = []
    for index, word in enumerate(words):
        if word == key:
            for other in words[index + 1 :]:
                if other.startswith("-"):
                    break
                found.append(other)
    return found


def all_values_of(words: Sequence[str], key: str) -> list[str]:
    """Return the words after an option that may come several times, each one."""
    found = [value for word, value in itertools.pairwise(words) if word == key]
    return found + [w.removeprefix(f"{key}=") for w in words if w.startswith(f"{key}=")]


def without_options(words: Sequence[str], keys: Sequence[str]) -> list[str]:
    """Return words without options that take one value, which may come again."""
    return [
        word
        for before, word in zip(["", *words], words, strict=False)
        if word not in keys and before not in keys
    ]


def positional(words: Sequence[str], with_value: Sequence[str]) -> list[str]:
    """Return the words that are neither options nor their values."""
    found, skip = [], False
    for word in words:
        if word == "--ros-args":
            break
        if not skip and not word.startswith("-"):
            found.append(word)
        skip = word in with_value
    return found
