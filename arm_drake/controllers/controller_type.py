"""What a controller type is: how its parameters are read, and its system made."""

import dataclasses as dc
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from arm_drake.controllers.controller_interface_part import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.errors import InputError


class ControllerType(NamedTuple):
    """How to parse and build one type of controller."""

    parameters: type

    # None if its parameters are read, but it isn't simulated yet.
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface] | None = (
        None
    )

    # The type that it is run as, if not itself.
    runs_as: str = ""

    # Who brought it, if not this package, and who brings one of this name too; what
    # finds it says so.
    origin: str = ""
    others: tuple[str, ...] = ()


def check_controller_type(row: object, origin: str) -> ControllerType:
    """Return a controller type that somebody else brings.

    Args:
        row: What they bring.
        origin: Where it comes from, for the message.

    Raises:
        InputError: If it isn't a usable ControllerType.
    """
    if not isinstance(row, ControllerType):
        raise InputError(f"{origin}: expected an arm_drake.ControllerType, got {row!r}")
    if not (isinstance(row.parameters, type) and dc.is_dataclass(row.parameters)):
        raise InputError(
            f"{origin}: parameters: expected a dataclass, got {row.parameters!r}"
        )
    if row.system is not None and not callable(row.system):
        raise InputError(
            f"{origin}: system: expected a class or a function, got {row.system!r}"
        )
    return row


def check_controller_types(types: object) -> dict[str, ControllerType]:
    """Return controller types by name, as `load_robot` takes them.

    Args:
        types: A mapping of names to types.

    Raises:
        InputError: If it is none.
    """
    if not isinstance(types, Mapping) or not all(isinstance(n, str) for n in types):
        raise InputError(
            "controller_types: expected a mapping of names to "
            f"arm_drake.ControllerType, got {types!r}"
        )
    return {
        name: check_controller_type(row, f"controller_types[{name!r}]")
        for name, row in types.items()
    }
