"""Controller types that are imported when a robot has one: most robots need three."""

import functools
import importlib
from collections.abc import Iterator, MutableMapping
from typing import Any, NamedTuple

from arm_drake.controllers.controller_type import ControllerType
from arm_drake.importing import without_collection


class LazyType(NamedTuple):
    """A type that isn't imported yet: modules of this package, and names in them."""

    # Dataclass of the parameters, and where it is.
    parameters: str
    module: str

    # Class of the system, and where it is if not there, too. Without one its parameters
    # are read, but it isn't simulated.
    system: str = ""
    system_module: str = ""

    # The `interface` that the system is made with, of one for several types.
    interface: str = ""

    runs_as: str = ""

    def load(self) -> ControllerType:
        """Import it."""
        parameters = _find(self.module, self.parameters)
        if not self.system:
            return ControllerType(parameters, runs_as=self.runs_as)
        system = _find(self.system_module or self.module, self.system)
        if self.interface:
            system = functools.partial(system, interface=self.interface)
        return ControllerType(parameters, system, self.runs_as)


class ControllerTypes(MutableMapping[str, ControllerType]):
    """Controller types by name, each imported when it is first asked for."""

    def __init__(self, rows: dict[str, LazyType]) -> None:
        """Create the table of some types.

        Args:
            rows: They, by name.
        """
        self._rows: dict[str, ControllerType | LazyType] = {**rows}
        self._added: dict[str, ControllerType] = {}

    @property
    def added(self) -> dict[str, ControllerType]:
        """Types that were added since, by name."""
        return dict(self._added)

    def __getitem__(self, name: str) -> ControllerType:
        """Return a type."""
        row = self._rows[name]
        if isinstance(row, LazyType):
            row = self._rows[name] = row.load()
        return row

    def __setitem__(self, name: str, row: ControllerType) -> None:
        """Add a type."""
        self._rows[name] = self._added[name] = row

    def __delitem__(self, name: str) -> None:
        """Remove a type."""
        del self._rows[name]
        self._added.pop(name, None)

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._rows)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._rows)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a type; it isn't imported for that."""
        return name in self._rows


def _find(module: str, name: str) -> Any:
    with without_collection():
        found = importlib.import_module(f"arm_drake.controllers.{module}")
    return getattr(found, name)
