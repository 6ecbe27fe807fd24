"""Controller types that installed packages bring, as entry points."""

import importlib.metadata
from collections.abc import Mapping
from typing import NamedTuple

from arm_drake.errors import InputError

# Group of the entry points: a name is a ros2_control type, its object a ControllerType.
ENTRY_POINTS = "arm_drake.controllers"


class InstalledType(NamedTuple):
    """A controller type that a package offers, not imported yet."""

    entry_point: importlib.metadata.EntryPoint

    # Who offers it, such as "package 'waves'".
    origin: str

    # Who else does; the first on Python's path counts.
    others: tuple[str, ...] = ()

    def load(self) -> object:
        """Import what the package offers.

        Raises:
            InputError: If it can't be imported.
        """
        try:
            loaded: object = self.entry_point.load()
        # Code of others, which can fail in every way; it must not take ours with it.
        except (Exception, SystemExit) as error:
            raise InputError(
                f"{self.entry_point.value!r} of {self.origin} can't be imported: "
                f"{type(error).__name__}: {error}"
            ) from error
        return loaded


def installed_types() -> Mapping[str, InstalledType]:
    """Return the controller types that installed packages offer, by name."""
    found: dict[str, InstalledType] = {}
    for entry_point in importlib.metadata.entry_points(group=ENTRY_POINTS):
        package = entry_point.dist.name if entry_point.dist else entry_point.module
        origin = f"package {package!r}"
        first = found.get(entry_point.name)
        if first is None:
            found[entry_point.name] = InstalledType(entry_point, origin)
        else:
            others = (*first.others, origin)
            found[entry_point.name] = first._replace(others=others)
    return found
