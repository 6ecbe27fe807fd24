"""What is drawn on, whether there is a page that shows it or not."""

from collections.abc import Mapping
from typing import Any, Self

from arm_drake.visualization.page.meshcats import give_back, take_meshcat


class Scene:
    """A Meshcat, for recordings and pictures; a `Page` has a panel besides."""

    def __init__(self) -> None:
        """Create it, with nothing drawn."""
        self.meshcat = take_meshcat()
        self._is_closed = False

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets, where there is a panel.

        Args:
            changes: New values of fields, by the widget's name.
        """

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things of the scene, where there is a page.

        Args:
            labels: Names by Meshcat path.
        """

    def close(self) -> None:
        """End it: what is drawn goes."""
        if not self._is_closed:
            self._is_closed = True
            give_back(self.meshcat)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()
