"""``gpio_controllers/GpioCommandController``.

Source: ros2_controllers, `gpio_controllers` (version 6.9.0). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_not_empty, check_unique
from arm_drake.description.parameters import per_element_of


@dc.dataclass(frozen=True)
class GpioInterfaces:
    """Interfaces of one GPIO."""

    # Each once.
    interfaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_unique(self, "interfaces")


@dc.dataclass(frozen=True)
class InterfacesByGpio:
    """Interfaces by GPIO."""

    gpio: dict[str, GpioInterfaces] = per_element_of("gpios")


@dc.dataclass(frozen=True)
class GpioCommandControllerParameters:
    """Parameters of a GpioCommandController."""

    # GPIOs of the description; at least one, each once.
    gpios: tuple[str, ...]

    # Interfaces to claim.
    command_interfaces: InterfacesByGpio = InterfacesByGpio()

    # Interfaces to read; if there are none at all, every one that the GPIOs have.
    state_interfaces: InterfacesByGpio = InterfacesByGpio()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "gpios")
        check_unique(self, "gpios")
