"""Words of command lines, as launch files have them."""

import itertools
import shlex
from collections.abc import Sequence
from typing import Any

from arm_drake.launch.parameters import read_value


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


def split_ros_arguments(
    words: Sequence[str],
) -> tuple[list[str], dict[str, Any]]:
    """Return the words of a program, and what those after `--ros-args` mean."""
    own: list[str] = []
    found: dict[str, Any] = {"namespace": None, "name": None}
    files: list[Any] = []
    remappings: list[tuple[str, str]] = []
    rest, is_ros = list(words), False
    while rest:
        word = rest.pop(0)
        if word == "--ros-args":
            is_ros = True
        elif word == "--" and is_ros:
            is_ros = False
        elif not is_ros:
            own.append(word)
        elif word == "--params-file" and rest:
            files.append(rest.pop(0))
        elif word in ("-p", "--param") and rest and ":=" in rest[0]:
            name, value = rest.pop(0).split(":=", 1)
            files.append({name: read_value(value)})
        elif word in ("-r", "--remap") and rest and ":=" in rest[0]:
            source, target = rest.pop(0).split(":=", 1)
            if source in ("__ns", "__node", "__name"):
                found["namespace" if source == "__ns" else "name"] = target
            else:
                remappings.append((source, target))
    return own, found | {"parameters": files, "remappings": remappings}
