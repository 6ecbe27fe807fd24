"""``chained_filter_controller/ChainedFilter``.

Source: ros2_controllers, `chained_filter_controller` (version 6.9.0). Parameters only.
"""

import dataclasses as dc
from typing import Any

from arm_drake.controllers.validation import check_not_empty
from arm_drake.description.parameters import per_element_of


@dc.dataclass(frozen=True)
class InputFilters:
    """Filters of one input."""

    # Parameters of its filters by name, such as "filter1.type".
    filter_chain: dict[str, Any] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True)
class ChainedFilterParameters:
    """Parameters of a ChainedFilter."""

    # Interfaces to read, at least one, and as many names for what becomes of them.
    input_interfaces: tuple[str, ...]
    output_interfaces: tuple[str, ...]

    # Parameters of filters by name, such as "filter1.type", for all inputs.
    filter_chain: dict[str, Any] = dc.field(default_factory=dict)

    # The same for single inputs.
    input: dict[str, InputFilters] = per_element_of("input_interfaces")

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "input_interfaces", "output_interfaces")
        if len(self.input_interfaces) != len(self.output_interfaces):
            raise ValueError(
                f"output_interfaces must be as many as input_interfaces, got "
                f"{list(self.output_interfaces)} and {list(self.input_interfaces)}"
            )
