"""What a scene shows of robots: what the toggles of its panel switch."""

from collections.abc import Mapping, Sequence

from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.visualization.link_drawings import KINDS, LinkDrawings, show_visual
from arm_drake.visualization.page.scene import Scene
from arm_drake.visualization.page.widgets import Toggle

VISUAL, FRAMES, NAMES = "visual", "frames", "names"

# What can be shown, and how the panel calls it.
VIEWS: Mapping[str, str] = {
    VISUAL: "visual shapes",
    FRAMES: "link frames",
    NAMES: "names of the frames",
    "collision": "collision shapes",
    "inertia": "inertia, as ellipsoids of the same mass",
    "joint_axes": "joint axes",
}


class LinkViews:
    """Shows and hides what moves with links."""

    def __init__(self, scene: Scene, shown: Sequence[str] = (VISUAL,)) -> None:
        """Create it; there are no links yet.

        Args:
            scene: Where to show it.
            shown: What is shown at first, see `VIEWS`.

        Raises:
            InputError: If something of it isn't known.
        """
        self._scene = scene
        for what in shown:
            _check(what)
        self._shown = set(shown) | ({FRAMES} if NAMES in shown else set())
        self._drawings: LinkDrawings | None = None

    @property
    def shown(self) -> tuple[str, ...]:
        """What is shown."""
        return tuple(what for what in VIEWS if what in self._shown)

    @property
    def needs_poses(self) -> bool:
        """Whether anything is shown that `update` moves."""
        return bool(self._shown - {VISUAL})

    def put(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        models: Mapping[str, ModelInstanceIndex],
        robots: Sequence[Robot],
    ) -> None:
        """Show it of these robots, in place of those before.

        Args:
            plant: The finalized plant.
            scene_graph: Its scene graph.
            models: Model instances by the robots' names.
            robots: The robots.
        """
        if self._drawings is not None:
            self._drawings.clear()
        descriptions = {robot.name: robot.description for robot in robots}
        meshcat = self._scene.meshcat
        self._drawings = LinkDrawings(meshcat, plant, scene_graph, models, descriptions)
        show_visual(meshcat, VISUAL in self._shown)
        for kind in KINDS:
            self._drawings.show(kind, kind in self._shown)
        self._label()

    def show(self, what: str, is_shown: bool = True) -> None:
        """Show something, or hide it.

        The names of frames are shown beside frames.

        Args:
            what: One of `VIEWS`.
            is_shown: Whether it is to be seen.

        Raises:
            InputError: If there is no such thing.
        """
        _check(what)
        changed = {what}
        if what == NAMES and is_shown:
            changed.add(FRAMES)
        elif what == FRAMES and not is_shown:
            changed.add(NAMES)
        self._shown = self._shown | changed if is_shown else self._shown - changed
        if self._drawings is not None:
            for kind in changed & set(KINDS):
                self._drawings.show(kind, is_shown)
        if VISUAL in changed:
            show_visual(self._scene.meshcat, is_shown)
        self._label()
        self._scene.patch({f"show:{key}": {"value": is_shown} for key in changed})

    def update(
        self,
        poses: Mapping[str, Mapping[str, RigidTransform]],
        time: float | None = None,
    ) -> None:
        """Move all along with the links.

        Args:
            poses: Poses of links in the world, by robot and link.
            time: Time in the recording, if there is one [s].
        """
        if self._drawings is not None:
            self._drawings.update(poses, time)

    def toggles(self) -> tuple[Toggle, ...]:
        """Return the panel's toggles; their events are called `show:<what>`."""
        return tuple(
            Toggle(f"show:{what}", label, what in self._shown)
            for what, label in VIEWS.items()
        )

    def _label(self) -> None:
        has_names = NAMES in self._shown and self._drawings is not None
        assert self._drawings is not None or not has_names
        paths = self._drawings.frame_paths() if self._drawings and has_names else {}
        self._scene.set_labels(paths)


def _check(what: str) -> None:
    if what not in VIEWS:
        raise InputError(
            f"nothing called {what!r} can be shown; {suggest(what, VIEWS)}"
        )
