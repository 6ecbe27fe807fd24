"""Changes to texts, trees and numbers, as a careless or a hostile author makes them."""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import yaml

# Else ElementTree would write other prefixes, which xacro doesn't know.
ET.register_namespace("xacro", "http://www.ros.org/wiki/xacro")

# What is written where something else is expected.
WORDS = [
    *("", " ", "nan", "inf", "-inf", "0", "-1", "1e308", "-1e-320", "1e999", "0x10"),
    *("1,5", "0 0", "0 0 0", "1 2 3 4", "nan nan nan", "true", "yes", "null", "~"),
    *("abc", "ä", "\u202e", "\U0001f916", "a/b", "../../etc/passwd", "/dev/zero"),
    *("package://nowhere/x.stl", "package://", "file:///dev/random", "$(find x)"),
    *("${", "${1/0}", "${'a' * 10**9}", "$(arg x)", "$(eval 1)", "%s%n", "{}", "[]"),
    *("<a>", "&amp;", "\\", "'", '"', "#", "*x", "&x", "!!python/object:os.system x"),
    *("x" * 10_000, "9" * 400, "world", "base", "upper", "shoulder", "revolute"),
    *("continuous", "floating", "planar", "prismatic", "fixed", "position", "effort"),
]

NUMBERS: list[Any] = [
    *(0, 1, -1, 2, 1e-320, 1e308, -1e308, 10**30, 0.5, 1e-9, 1e9),
    *(float("nan"), float("inf"), float("-inf"), True, False, None),
]


def word(rng: Random) -> str:
    """Return what is out of place in most places."""
    return rng.choice(WORDS)


def value(rng: Random) -> Any:
    """Return what YAML or JSON can say."""
    kind = rng.randrange(5)
    if kind == 0:
        return word(rng)
    if kind == 1:
        return [rng.choice(NUMBERS) for _ in range(rng.randrange(4))]
    if kind == 2:
        return {word(rng)[:50]: rng.choice(NUMBERS)}
    return rng.choice(NUMBERS)


def repeated(change: Callable[[Random, Any], None], rng: Random, subject: Any) -> None:
    """Change something once, or up to four times."""
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        change(rng, subject)


def mutate_xml(rng: Random, text: str) -> str:
    """Return a document with elements and attributes changed, or its text."""
    if rng.random() < 0.1:
        return mutate_bytes(rng, text.encode()).decode(errors="replace")
    root = ET.fromstring(text)  # noqa: S314  It is our own.
    repeated(_change_element, rng, root)
    return ET.tostring(root, encoding="unicode")


def _change_element(rng: Random, root: ET.Element) -> None:
    elements = list(root.iter())
    parents = [element for element in elements if len(element)]
    parent, element = rng.choice(parents or elements), rng.choice(elements)
    what = rng.randrange(9)
    if what == 0 and len(parent):
        parent.remove(rng.choice(list(parent)))
    elif what == 1 and len(parent):
        parent.append(copy.deepcopy(rng.choice(list(parent))))
    elif what == 2:
        taken = copy.deepcopy(element)
        rng.choice(elements).insert(0, taken)
    elif what == 3:
        element.tag = rng.choice(elements).tag
    elif what == 4:
        element.text = rng.choice([word(rng), rng.choice(elements).text or ""])
    elif element.attrib:
        name = rng.choice(list(element.attrib))
        if what == 5:
            del element.attrib[name]
        elif what == 6:
            others = [v for other in elements for v in other.attrib.values()]
            element.attrib[name] = rng.choice(others)
        else:
            element.attrib[name] = word(rng)


def mutate_yaml(rng: Random, text: str) -> str:
    """Return a YAML document with keys and values changed, or its text."""
    if rng.random() < 0.15:
        return mutate_bytes(rng, text.encode()).decode(errors="replace")
    tree = yaml.safe_load(text)
    repeated(_change_node, rng, tree)
    return yaml.safe_dump(tree, allow_unicode=True)


def _change_node(rng: Random, tree: Any) -> None:
    places = _places(tree)
    if not places:
        return
    holder, key = rng.choice(places)
    what = rng.randrange(6)
    if what == 0:
        del holder[key]
    elif what == 1:
        other, its_key = rng.choice(places)
        holder[key] = copy.deepcopy(other[its_key])
    elif what == 2 and isinstance(holder, dict):
        holder[word(rng)[:50]] = holder.pop(key)
    elif what == 3 and isinstance(holder[key], list):
        holder[key] = holder[key] * rng.randint(0, 3)
    else:
        holder[key] = value(rng)


def _places(tree: Any) -> list[tuple[Any, Any]]:
    keys: list[Any] = []
    if isinstance(tree, dict):
        keys = list(tree)
    elif isinstance(tree, list):
        keys = list(range(len(tree)))
    found = [(tree, key) for key in keys]
    for key in keys:
        found += _places(tree[key])
    return found


def mutate_bytes(rng: Random, data: bytes) -> bytes:
    """Return data with bytes changed, cut, doubled or put in."""
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        at, size = rng.randrange(len(changed) + 1), rng.randrange(1, 64)
        what = rng.randrange(6)
        if what == 0:
            del changed[at:]
        elif what == 1:
            del changed[at : at + size]
        elif what == 2:
            changed[at:at] = changed[at : at + size]
        elif what == 3:
            changed[at:at] = word(rng).encode()[:200]
        elif what == 4:
            changed[at:at] = rng.randbytes(size)
        elif changed:
            changed[at % len(changed)] = rng.randrange(256)
    return bytes(changed)


def mutate_arrays(rng: Random, arrays: dict[str, Any]) -> dict[str, Any]:
    """Return arrays of which some have other types, shapes or values, or are gone."""
    changed = dict(arrays)
    for _ in range(rng.randint(1, 3)):
        name = rng.choice(sorted(changed))
        array = np.asarray(changed[name])
        what = rng.randrange(7)
        if what == 0:
            del changed[name]
        elif what == 1:
            types = ["S8", "U8", "c16", "i1", "?", "f2", "M8[s]", "O"]
            with np.errstate(all="ignore"):
                changed[name] = np.zeros(array.shape, rng.choice(types))
        elif what == 2:
            changed[name] = array[None]
        elif what == 3:
            changed[name] = array[: len(array) // 2] if array.ndim else array
        elif what == 4 and array.dtype.kind == "f" and array.size:
            flat = array.copy().reshape(-1)
            flat[rng.randrange(flat.size)] = rng.choice([np.nan, np.inf, 1e308])
            changed[name] = flat.reshape(array.shape)
        elif what == 5:
            changed[name] = changed[rng.choice(sorted(changed))]
        else:
            changed[word(rng)[:50] or "x"] = np.zeros(3)
        if not changed:
            break
    return changed
