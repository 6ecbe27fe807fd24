"""Chains of filters, as parameters configure them.

The rules are those of ROS's package `filters` (branch ``ros2``, ``filter_chain.hpp``):
``filter1``, ``filter2`` and so on, each with a name, a type and parameters.
"""

import dataclasses as dc
import typing
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.filters import (
    ExponentialFilter,
    LowPassFilter,
    RateLimiterFilter,
)
from arm_drake.control.sample_filters import (
    MeanFilter,
    MedianFilter,
    TransferFunctionFilter,
)
from arm_drake.errors import suggest

# Filters of numbers; their fields are their parameters.
FILTERS: Mapping[str, type] = {
    "filters/MeanFilterDouble": MeanFilter,
    "filters/MedianFilterDouble": MedianFilter,
    "filters/TransferFunctionFilterDouble": TransferFunctionFilter,
    "control_filters/LowPassFilterDouble": LowPassFilter,
    "control_filters/ExponentialFilterDouble": ExponentialFilter,
    "control_filters/RateLimiterDouble": RateLimiterFilter,
}


class Filter(Protocol):
    """What all filters have."""

    def initial(self, n: int) -> Any:
        """Return the state of n channels before the first sample."""

    def update(self, state: Any, sample: Array) -> Any:
        """Return the state after a sample of shape (n,); it holds the `output`."""


class ChainState(NamedTuple):
    """What the filters of a chain remember, and what came out of the last one."""

    states: tuple[Any, ...]

    # Shape (n,); NaN before the first sample.
    output: Array


@dc.dataclass(frozen=True)
class FilterChain:
    """Filters one after the other; none at all lets everything pass."""

    filters: tuple[Filter, ...] = ()

    def initial(self, n: int) -> ChainState:
        """Return the state of n channels before the first sample."""
        states = tuple(each.initial(n) for each in self.filters)
        return ChainState(states, np.full(n, np.nan))

    def update(self, state: ChainState, sample: Array) -> ChainState:
        """Return the state after a sample; it holds the output.

        Args:
            state: The state so far.
            sample: What is measured, shape (n,), finite.
        """
        states = []
        for each, last in zip(self.filters, state.states, strict=True):
            states.append(each.update(last, sample))
            sample = states[-1].output
        return ChainState(tuple(states), sample)


def make_filter_chain(parameters: Mapping[str, Any], where: str) -> FilterChain:
    """Return the chain that parameters configure.

    What belongs to no filter has no effect, as in ROS; `find_unused` finds it.

    Args:
        parameters: By their names within the chain, such as "filter1.type".
        where: Name of the chain, for messages.

    Raises:
        ValueError: If one is missing, of the wrong type or out of range.
    """
    filters: list[Filter] = []
    names: list[str] = []
    while True:
        place = f"filter{len(filters) + 1}"
        name, type_ = (parameters.get(f"{place}.{key}") for key in ("name", "type"))
        if name is None and type_ is None:
            break
        for key, value in (("name", name), ("type", type_)):
            if not isinstance(value, str):
                what = "is required but missing"
                if value is not None:
                    what = f"expected str, got {value!r}"
                raise ValueError(f"{where}.{place}.{key}: {what}")
        if name in names:
            raise ValueError(
                f"{where}.{place}.name: another filter of the chain is {name!r}, too"
            )
        if type_ not in FILTERS:
            raise ValueError(
                f"{where}.{place}.type: no filter of numbers {type_!r}; "
                f"{suggest(str(type_), FILTERS)}"
            )
        start = f"{place}.params."
        given = {
            key.removeprefix(start): value
            for key, value in parameters.items()
            if key.startswith(start)
        }
        filters.append(_make_filter(FILTERS[str(type_)], given, f"{where}.{start}"))
        names.append(str(name))
    return FilterChain(tuple(filters))


def find_unused(
    parameters: Mapping[str, Any], known: Mapping[str, Collection[str]] | None = None
) -> dict[str, str]:
    """Return parameters of a chain that belong to none of its filters, and why.

    Args:
        parameters: By their names within the chain.
        known: Parameters of filters by their types, if not those of filters of numbers.
    """
    if known is None:
        known = {type_: parameters_of(kind) for type_, kind in FILTERS.items()}
    size = 0
    while not {f"filter{size + 1}.{n}" for n in ("name", "type")}.isdisjoint(
        parameters
    ):
        size += 1
    places = [f"filter{number}" for number in range(1, size + 1)]
    found = {}
    for name in parameters:
        place, _, key = name.partition(".")
        start, _, parameter = key.partition(".")
        if place not in places or (start != "params" and key not in ("name", "type")):
            found[name] = (
                "belongs to no filter; they are numbered from filter1 on, and the "
                f"chain has {size}, each with name, type and params"
            )
        elif start == "params":
            own = known.get(str(parameters.get(f"{place}.type")))
            if own is not None and parameter not in own:
                found[name] = (
                    f"the filter has no such parameter; {suggest(parameter, own)}"
                )
    return found


def parameters_of(kind: type) -> tuple[str, ...]:
    """Return the names of a filter's parameters."""
    return tuple(field.name for field in dc.fields(kind) if field.init)


def _make_filter(kind: type, given: Mapping[str, Any], where: str) -> Filter:
    """Return a filter of a kind with these parameters."""
    fields = {field.name: field for field in dc.fields(kind) if field.init}
    for name, field in fields.items():
        if field.default is dc.MISSING and name not in given:
            raise ValueError(f"{where}{name}: is required but missing")
    hints = typing.get_type_hints(kind)
    values = {
        name: _convert(hints[name], value, f"{where}{name}")
        for name, value in given.items()
        if name in fields
    }
    try:
        made: Filter = kind(**values)
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None
    return made


def _convert(expected: Any, value: Any, where: str) -> Any:
    """Return a value as the expected type: int, float, or a list of floats."""
    kind = "a list of float"
    if expected is int:
        if type(value) is int:
            return value
        kind = "int"
    elif expected is float:
        # A bool is an int, too; and rcl has no larger ones.
        if type(value) is float or (type(value) is int and abs(value) < 2**63):
            return float(value)
        kind = "float"
    elif isinstance(value, list | tuple):
        return tuple(_convert(float, each, where) for each in value)
    raise ValueError(f"{where}: expected {kind}, got {value!r}")
