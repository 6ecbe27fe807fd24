"""Tables of the controller types, as Markdown, made from the registry.

What a type accepts is read off its parameters: the `Rule`s say which distributions have
a parameter, and `adapt`, asked with nothing given, which older names it looks for.
"""

import dataclasses as dc
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from arm_drake.controllers.registry import ControllerType
from arm_drake.description.parameters import DISTROS, ParameterGroup, Rule

# So many names are listed in a cell, of each kind.
_MAX_NAMES = 3


class _RequestedNames(ParameterGroup):
    """Nothing given, and the names that `adapt` looks for nevertheless."""

    def __init__(self, distro: str) -> None:
        self.distro = distro
        self.names: dict[str, None] = {}

    def __contains__(self, name: str) -> bool:
        self.names[name] = None
        return False

    def get(self, name: str, expected: Any) -> Any:
        """Note the name; it isn't given."""
        self.names[name] = None

    def group(self, group: str) -> dict[str, Any]:
        """Return that none is given."""
        return {}

    def first_of(self, group: str) -> str | None:
        """Return that none is given."""
        return None


def render_types(types: Mapping[str, ControllerType]) -> str:
    """Return the table of types: what is simulated, and whose names each takes."""
    own = {name: row for name, row in types.items() if not row.runs_as}
    simulated = [n for n, row in own.items() if row.system is not None]
    rows = [
        (
            f"`{name}`",
            "all of it" if name in simulated else "parameters only",
            ", ".join(_distros(own[name].parameters)),
            _peculiarities(own[name].parameters),
        )
        for name in sorted(own, key=lambda name: name not in simulated)
    ]
    head = ("controller type", "what of it", "parameter names of", "not in all of them")
    return _table(head, rows)


def render_others(run_as: Mapping[str, str]) -> str:
    """Return the table of others' types that are run as one of ours, by type."""
    rows = [(f"`{name}`", f"`{run_as[name]}`") for name in sorted(run_as)]
    return _table(("type of another package, or an older name", "is run as"), rows)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _distros(schema: type) -> list[str]:
    """Return the distributions whose files have all that a type requires.

    What a distribution doesn't have by our name, it has by an older one, if `adapt`
    looks for any.
    """
    required = [rule for _, rule, is_required in _parameters(schema) if is_required]
    has_older = any(True for _ in _older(schema))
    return [d for d in DISTROS if has_older or all(rule.knows(d) for rule in required)]


def _peculiarities(schema: type) -> str:
    """Return which parameters are of some distributions only, and the older names."""
    found: dict[tuple[int, ...], dict[str, None]] = {}
    for name, rule, _ in _parameters(schema):
        known = tuple(i for i, distro in enumerate(DISTROS) if rule.knows(distro))
        if len(known) < len(DISTROS):
            found.setdefault(known, {})[name] = None
    parts = [
        f"{_span(known)}: {_listed(list(found[known]))}" for known in sorted(found)
    ]
    older = list(dict.fromkeys(_older(schema)))
    if older:
        parts.append(f"older: {_listed(older)}")
    return "; ".join(parts)


def _span(known: tuple[int, ...]) -> str:
    """Return which distributions have a parameter, in words."""
    first, last = DISTROS[known[0]], DISTROS[known[-1]]
    if first == last:
        return first
    if first == DISTROS[0]:
        return f"up to {last}"
    return f"since {first}" if last == DISTROS[-1] else f"{first} to {last}"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_NAMES} more" if len(names) > _MAX_NAMES else ""
    return ", ".join(f"`{name}`" for name in names[:_MAX_NAMES]) + more


def _fields(schema: type) -> Iterator[tuple[str, Any, Rule, "dc.Field[Any]"]]:
    """Yield name, type, rule and field of each field of a schema."""
    hints = typing.get_type_hints(schema, include_extras=True)
    for field in dc.fields(schema):
        expected, rule = hints[field.name], Rule()
        if typing.get_origin(expected) is typing.Annotated:
            expected, rule = typing.get_args(expected)
        if "per_element_of" in field.metadata:
            expected = typing.get_args(expected)[1]
        yield field.name, expected, rule, field


def _parameters(schema: type) -> Iterator[tuple[str, Rule, bool]]:
    """Yield a schema's parameters, its own first: name, rule, whether it is required.

    The name is the last part. Of a group that not all distributions have, it is the
    group's.
    """
    groups = []
    for name, expected, rule, field in _fields(schema):
        if dc.is_dataclass(expected) and all(map(rule.knows, DISTROS)):
            groups.append(typing.cast(type, expected))
            continue
        missing = field.default is dc.MISSING and field.default_factory is dc.MISSING
        yield name, rule, missing
    for group in groups:
        yield from _parameters(group)


def _dotted(schema: type) -> Iterator[str]:
    """Yield the dotted names of a schema's parameters and groups."""
    for name, expected, _, _ in _fields(schema):
        yield name
        if dc.is_dataclass(expected):
            yield from (f"{name}.{n}" for n in _dotted(typing.cast(type, expected)))


def _older(schema: type) -> Iterator[str]:
    """Yield names that a schema and its groups take and that aren't fields' names."""
    known = set(_dotted(schema))
    adapt = getattr(schema, "adapt", None)
    if adapt is not None:
        for distro in DISTROS:
            requested = _RequestedNames(distro)
            adapt(requested)
            yield from (name for name in requested.names if name not in known)
    for _, expected, rule, _ in _fields(schema):
        yield from rule.was
        if dc.is_dataclass(expected):
            yield from _older(typing.cast(type, expected))
