"""Parts of the panels of `arm-drake sim` and `view` that stand for themselves.

To add one, write a class with what `Part` has, and a row in `PARTS` or `VIEW_PARTS`.
"""

import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from pydrake.math import RigidTransform

from arm_drake.description.robot import Robot
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.ghost import Ghost
from arm_drake.visualization.page.live_views import LiveViews
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import Section
from arm_drake.visualization.teleop.base import Remote
from arm_drake.worlds.things import Thing

if TYPE_CHECKING:
    from arm_drake.scene import Scene as SimulatedScene


class Drawn(Protocol):
    """A simulation that is drawn: on a page, or for a recording."""

    @property
    def page(self) -> Scene:
        """Scene that shows it."""

    @property
    def simulation(self) -> Simulation:
        """Present simulation; ask for it anew each time, for it may be replaced."""

    @property
    def views(self) -> LiveViews:
        """Its views, with the readout of a link."""


class Live(Drawn, Protocol):
    """Interface of the LiveSimulation for its parts."""

    @property
    def remotes(self) -> Sequence[Remote]:
        """Remotes for a person, one for each controller that takes commands."""

    @property
    def scene(self) -> "SimulatedScene | None":
        """Simulated scene, if it is known."""

    @property
    def can_insert(self) -> bool:
        """Whether `insert` does something."""

    def insert(self, thing: Thing) -> None:
        """Put a thing into what is simulated, which goes on with it."""

    def note(self, text: str) -> None:
        """Add a line to the page's news."""


class Viewer(Protocol):
    """Interface of the RobotViewer for its parts."""

    @property
    def page(self) -> Scene:
        """Scene that shows it."""

    @property
    def robot(self) -> Robot:
        """The robot; when it is loaded anew, so are the parts."""

    @property
    def positions(self) -> dict[str, float]:
        """Positions of its joints [rad, m]."""

    def note(self, text: str) -> None:
        """Show a line on the page and the terminal."""

    def set_positions(self, positions: Mapping[str, float]) -> None:
        """Move joints."""

    def make_ghost(self, name: str, color: tuple[float, float, float]) -> Ghost:
        """Return a transparent copy of the robot."""

    def frame(self, direction: tuple[float, float, float]) -> None:
        """Look at all of the robot from a direction."""

    def drawn_poses(self) -> Mapping[str, RigidTransform]:
        """Return where links are drawn, by name."""


class Part(ABC):
    """A section of the panel, and what its widgets do. All runs in the page's thread.

    Ids of its widgets are `<word>:<widget>`.
    """

    word = ""

    @abstractmethod
    def section(self) -> Section:
        """Return the section as it is now; one without widgets is left out."""

    def handle(self, event_id: str, value: object) -> bool:
        """Do what was clicked, and return whether it was one of its widgets.

        What can't be done is an ArmDrakeError, whose text the page shows.
        """
        word, _, what = event_id.partition(":")
        if word == self.word:
            self.act(what, value)
        return word == self.word

    def act(self, what: str, value: object) -> None:  # noqa: B027
        """Do what one of its widgets stands for."""

    def changes(self) -> Mapping[str, Mapping[str, Any]]:
        """Return present fields of widgets, by id; it is called ten times a second."""
        return {}

    def advance(self) -> float:
        """Do what is due before simulated time goes on; return for how long [s]."""
        return math.inf

    def draw(self) -> None:  # noqa: B027  most draw nothing.
        """Draw what belongs to it, after the robots as they are now."""

    def take_over(self, other: "Part") -> None:  # noqa: B027
        """Take what a part of the same kind has kept, whose place it takes."""

    def reset(self) -> None:  # noqa: B027  most have nothing to forget.
        """Begin anew, as the simulation does."""

    def end_recording(self) -> None:  # noqa: B027
        """Leave out what would stand still in a recording."""


# What makes each part of a LiveSimulation, and of a RobotViewer, or None where there is
# nothing for it, as `<module>:<name>`, in the order of the panel. They are strings,
# as those modules import this one.
PARTS = [
    "arm_drake.visualization.page.camera:live_camera",
    "arm_drake.visualization.page.keyboard:make_keyboard",
    "arm_drake.visualization.page.hands:make_hands",
    "arm_drake.visualization.page.insertion:make_insertion",
    "arm_drake.visualization.page.teaching:teach_live",
    "arm_drake.visualization.page.live_plots:LivePlots",
    "arm_drake.visualization.page.displays:make_displays",
    "arm_drake.visualization.page.camera_pictures:make_camera_pictures",
]
VIEW_PARTS = [
    "arm_drake.visualization.page.camera:view_camera",
    "arm_drake.visualization.page.teaching:teach_view",
]


_P = TypeVar("_P", bound=Part)


def find_part(parts: Iterable[Part], kind: type[_P]) -> _P:
    """Return the part of a kind, of which there is one."""
    return next(part for part in parts if isinstance(part, kind))


def make_parts(
    page: Any, rows: Iterable[str], before: Sequence[Part] = ()
) -> list[Part]:
    """Return the parts of a LiveSimulation or a RobotViewer, in place of others."""
    parts = []
    for row in rows:
        module, _, name = row.partition(":")
        part: Part | None = getattr(importlib.import_module(module), name)(page)
        if part is not None:
            parts.append(part)
    for part in parts:
        for other in before:
            part.take_over(other)
    return parts
