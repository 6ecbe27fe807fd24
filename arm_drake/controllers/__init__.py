"""The controller types, by their ros2_control names.

To add one, write its module (parameters dataclass and system) and its test, then add
its row to `STANDARD_TYPES` of the registry.
"""

from collections.abc import Callable, Mapping
from typing import Any

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.registry import (
    STANDARD_TYPES,
    ControllerType,
    ControllerTypes,
    InstalledType,
    check_controller_type,
    check_controller_types,
    installed_types,
    load_other_types,
    parameters_of,
)

__all__ = [
    "CONTROLLER_TYPES",
    "ControllerType",
    "check_controller_type",
    "check_controller_types",
    "find_controller_type",
    "installed_types",
    "list_types",
    "register_controller",
]


CONTROLLER_TYPES = ControllerTypes(STANDARD_TYPES)


def find_controller_type(
    name: str,
    own: Mapping[str, ControllerType] | None = None,
    installed: Mapping[str, InstalledType] | None = None,
) -> ControllerType | None:
    """Return the row of a controller type, or None.

    A robot's `own` types come first, then those of installed packages, then ours, and
    last other packages' types that are one of ours. `installed` is what
    `installed_types` returns, which is asked by default. If an installed package offers
    what can't be used there is an InputError.
    """
    builtin = CONTROLLER_TYPES.get(name)
    equivalent = load_other_types().equivalents.get(name) if builtin is None else None
    is_builtin = equivalent is not None if builtin is None else not builtin.origin
    others = ("arm_drake",) if is_builtin else ()
    if own and name in own:
        origin = "load_robot(controller_types=...)"
        return own[name]._replace(origin=origin, others=others)
    offer = (installed_types() if installed is None else installed).get(name)
    if offer is not None:
        row = check_controller_type(offer.load(), offer.origin)
        return row._replace(origin=offer.origin, others=(*others, *offer.others))
    if builtin is not None:
        return builtin
    if "::" in name:  # As C++ calls it.
        written = name.replace("::", "/")
        row_as_written = find_controller_type(written, own, installed)
        return row_as_written and row_as_written._replace(
            runs_as=row_as_written.runs_as or written
        )
    if equivalent is None:
        return None
    row = CONTROLLER_TYPES[equivalent.runs_as]
    return row._replace(
        parameters=parameters_of(equivalent) or row.parameters,
        runs_as=row.runs_as or equivalent.runs_as,
    )


def list_types() -> list[str]:
    """Return the names of our types, without those that are run as another one."""
    return [name for name, row in CONTROLLER_TYPES.items() if not row.runs_as]


def register_controller(
    name: str,
    parameters: type,
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface],
) -> None:
    """Add a controller type of one's own for all robots that are loaded later.

    `load_robot(..., controller_types=...)` does it for one robot. A package that is
    installed does it with an entry point of the group `arm_drake.controllers`.

    Args:
        name: Its ros2_control type, such as "my_controllers/MyController".
        parameters: Frozen dataclass of its parameters.
        system: Makes the system from parameters and surroundings.

    Raises:
        ValueError: If there is a type of this name.
        InputError: If it can't be used.
    """
    if name in CONTROLLER_TYPES or name in installed_types():
        raise ValueError(f"controller type {name!r} is registered already")
    origin = "register_controller"
    row = check_controller_type(ControllerType(parameters, system), origin)
    CONTROLLER_TYPES[name] = row._replace(origin=origin)
