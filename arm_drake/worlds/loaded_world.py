"""A world as loaded: what it adds to a plant, and what was not taken as written."""

import dataclasses as dc
from collections.abc import Callable

from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant

from arm_drake.description.report import LoadReport

Vector = tuple[float, float, float]


def _add_nothing(plant: MultibodyPlant) -> None:
    del plant


@dc.dataclass(frozen=True, eq=False)
class LoadedWorld:
    """A world as loaded."""

    # Its name, which topics of Gazebo contain.
    name: str = "empty"

    # Adds it to a plant that isn't finalized.
    add_to: Callable[[MultibodyPlant], None] = _add_nothing

    # Whether it may have things that move, and can be held.
    has_things: bool = False

    # Acceleration [m/s^2]; None is Earth's, 9.81 along -z.
    gravity: Vector | None = None

    # Whether the page shows its grid.
    has_grid: bool = True

    # Colour of the page behind everything, red, green and blue from 0 to 1.
    background: Vector | None = None

    # What was not taken as written.
    report: LoadReport = dc.field(default_factory=LoadReport)


def show_backdrop(
    meshcat: Meshcat,
    *,
    has_grid: bool = True,
    background: tuple[float, float, float] | None = None,
) -> None:
    """Show a page as a world wants it.

    Args:
        meshcat: The page.
        has_grid: Whether it has its grid.
        background: Colour behind everything, red, green and blue from 0 to 1; None
            leaves Meshcat's own.
    """
    meshcat.SetProperty("/Grid", "visible", has_grid)
    if background is not None:
        for end in ("top_color", "bottom_color"):
            meshcat.SetProperty("/Background", end, list(background))
