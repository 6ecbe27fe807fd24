"""The ``chained_filter_controller/ChainedFilter`` and its parameters.

Source: ros2_controllers, `chained_filter_controller` (version 6.9.0); the filters are
in `arm_drake.control.filters`.
"""

import dataclasses as dc
import math
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.filters import ChainState, find_unused, make_filter_chain
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.description.parameters import (
    ParameterGroup,
    check_not_empty,
    per_element_of,
)
from arm_drake.errors import ParameterError
from arm_drake.importing import dataclass

# Group of a chain's parameters, and the one that makes it hold for several inputs.
_CHAIN = "filter_chain"
_FIRST_NAME = "filter1.name"


@dataclass(frozen=True)
class InputFilters:
    """Filters of one input."""

    # Parameters of its filters by name, such as "filter1.type".
    filter_chain: dict[str, Any] = dc.field(default_factory=dict)


@dataclass(frozen=True)
class ChainedFilterParameters:
    """Parameters of a ChainedFilter."""

    # Interfaces to read, at least one, and as many names for what becomes of them.
    input_interfaces: tuple[str, ...]
    output_interfaces: tuple[str, ...]

    # Parameters of filters by name, such as "filter1.type", for all inputs.
    filter_chain: dict[str, Any] = dc.field(default_factory=dict)

    # The same for single inputs of several, if there is no filter for all.
    input: dict[str, InputFilters] = per_element_of("input_interfaces")

    def __post_init__(self) -> None:
        check_not_empty(self, "input_interfaces", "output_interfaces")
        if len(self.input_interfaces) != len(self.output_interfaces):
            raise ValueError(
                f"output_interfaces must be as many as input_interfaces, got "
                f"{list(self.output_interfaces)} and {list(self.input_interfaces)}"
            )

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Report filters that others stand in for, and what belongs to no filter."""
        inputs = params.get("input_interfaces", tuple[str, ...]) or ()
        own = dict.fromkeys(f"{name}.{_CHAIN}" for name in inputs)
        if f"{_CHAIN}.{_FIRST_NAME}" in params:
            ignored, what = list(own), f"{_CHAIN} holds for all inputs"
        elif len(inputs) > 1:
            ignored, what = [_CHAIN], f"without {_FIRST_NAME} it holds for no input"
        else:
            ignored, what = list(own), f"a single input has no filters but {_CHAIN}"
        for group in ignored:
            first = params.first_of(group)
            if first is not None:
                params.add(first, "warning", "ignored", what, f"{group} has no effect")
        for group in (_CHAIN, *own):
            if group not in ignored:
                for name, why in find_unused(params.group(group)).items():
                    what = f"{group}.{name}"
                    params.add(what, "warning", "ignored", why, "it has no effect")

    def chain_of(self, name: str) -> tuple[dict[str, Any], str]:
        """Return the parameters of an input's filters, and where they stand."""
        if len(self.input_interfaces) == 1 or _FIRST_NAME in self.filter_chain:
            return self.filter_chain, _CHAIN
        return self.input[name].filter_chain, f"{name}.{_CHAIN}"


class ChainedFilterState(NamedTuple):
    """State of a ChainedFilter between two ticks."""

    # What it exports, shape (n,); NaN where there has been nothing to filter.
    outputs: Array

    # What the filters of each input remember.
    chains: tuple[ChainState, ...]


class ChainedFilter(TickingController[ChainedFilterState]):
    """Filters state interfaces, for other controllers to read.

    With n = len(input_interfaces), vectors in their order:

    =========================  ====  ==================================================
    port                       size  meaning
    =========================  ====  ==================================================
    controller_manager         --    Cycle: when to tick
    state_interfaces           2J    positions and velocities of all J joints of the
                                     robot, or more
    command_interfaces         --    UpdateResult; no commands
    exported_state_interfaces  n     outputs of the last tick, each in the unit of its
                                     input
    =========================  ====  ==================================================

    They are called "<controller>/<output>" for an output of ``output_interfaces``. The
    state is a ChainedFilterState, renewed at every tick: a finite input goes through
    its filters, any other leaves its output as it is. An activation makes the outputs
    NaN; what the filters remember stays.

    Of several inputs each has the filters of ``filter_chain`` for itself, or else
    those of its own; without filters it is passed on.
    """

    def __init__(
        self,
        parameters: ChainedFilterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system."""
        inputs = parameters.input_interfaces
        try:
            self._chains = [make_filter_chain(*parameters.chain_of(n)) for n in inputs]
        except ValueError as error:
            raise ParameterError(str(error)) from None
        self._nothing = np.full(len(inputs), np.nan)
        chains = tuple(chain.initial(1) for chain in self._chains)
        outputs = parameters.output_interfaces
        super().__init__(
            params,
            ChainedFilterState(self._nothing, chains),
            state_interfaces=inputs,
            exported_interfaces=tuple(f"{params.controller_name}/{n}" for n in outputs),
        )

    def _update(
        self, now: UpdateContext, state: ChainedFilterState
    ) -> ChainedFilterState:
        measured = self._read(now.context).tolist()
        outputs, chains = state.outputs.copy(), list(state.chains)
        for index, value in enumerate(measured):
            if math.isfinite(value):
                last = chains[index]
                chains[index] = self._chains[index].update(last, np.array([value]))
                outputs[index] = chains[index].output[0]
        return ChainedFilterState(outputs, tuple(chains))

    def _activate(
        self, now: UpdateContext, state: ChainedFilterState
    ) -> ChainedFilterState:
        return state._replace(outputs=self._nothing)

    def _export(self, state: ChainedFilterState) -> Array:
        return state.outputs
