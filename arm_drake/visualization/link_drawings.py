"""What can be shown of links beside their visual shapes: RViz's displays.

Everything lies below ``/drake``, where Drake's MeshcatVisualizer has its shapes: one
transform of ``/drake`` moves it all.
"""

from collections.abc import Mapping

from pydrake.geometry import Meshcat, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError, suggest
from arm_drake.visualization.drawn_robot import DrawnRobot
from arm_drake.visualization.link_pieces import PIECES
from arm_drake.visualization.solids import draw_solid

# What can be shown: "frames", "collision", "inertia", "joint_axes".
KINDS = tuple(PIECES)

_VISUAL = "/drake/visual"


def show_visual(meshcat: Meshcat, is_shown: bool) -> None:
    """Show or hide what Drake draws of all models, their visual shapes.

    Args:
        meshcat: Where they are drawn.
        is_shown: Whether they are to be seen.
    """
    meshcat.SetProperty(_VISUAL, "visible", is_shown)


def path_below(root: str, *names: str) -> str:
    """Return a Meshcat path of names, in which a slash is no separator.

    Args:
        root: Path above them.
        names: Names of robots, links and the like.
    """
    return "/".join([root, *(name.replace("/", "|") for name in names)])


class LinkDrawings:
    """Frames, collision shapes, inertia and joint axes, which move with links.

    Each kind is sent at its first `show`, below ``/drake/<kind>/<robot>/<link>``, and
    then only hidden and shown again. Meshcat wants all calls in the thread that made
    it.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        models: Mapping[str, ModelInstanceIndex],
        descriptions: Mapping[str, RobotDescription],
    ) -> None:
        """Create it; nothing is shown yet, and links are where they are by default.

        Args:
            meshcat: Where to draw.
            plant: The finalized plant.
            scene_graph: Its scene graph.
            models: Model instances by the robots' names.
            descriptions: The same robots, by their names.
        """
        self._meshcat = meshcat
        self._robots = {
            name: DrawnRobot(plant, scene_graph, model, descriptions[name])
            for name, model in models.items()
        }
        self._poses = {
            (name, link): X_WL
            for name, robot in self._robots.items()
            for link, X_WL in robot.link_poses.items()
        }
        # Of the kinds that were sent: paths by robot and link.
        self._paths: dict[str, dict[tuple[str, str], str]] = {}
        self._shown: set[str] = set()

    @property
    def shown(self) -> tuple[str, ...]:
        """The kinds that are shown."""
        return tuple(kind for kind in KINDS if kind in self._shown)

    def show(self, kind: str, is_shown: bool = True) -> None:
        """Show or hide a kind of drawing.

        Args:
            kind: One of `KINDS`.
            is_shown: Whether it is to be seen.

        Raises:
            InputError: If there is no such kind.
        """
        if kind not in KINDS:
            raise InputError(f"no drawing {kind!r}; {suggest(kind, KINDS)}")
        if is_shown == (kind in self._shown):
            return
        if not is_shown:
            self._shown.remove(kind)
            self._meshcat.SetProperty(f"/drake/{kind}", "visible", False)
            return
        self._shown.add(kind)
        if kind not in self._paths:
            self._draw(kind)
        for link, path in self._paths[kind].items():
            self._meshcat.SetTransform(path, self._poses[link])
        self._meshcat.SetProperty(f"/drake/{kind}", "visible", True)

    def update(
        self,
        poses: Mapping[str, Mapping[str, RigidTransform]],
        time: float | None = None,
    ) -> None:
        """Move what is shown along with the links.

        Only links that moved since the last call are sent, or all to a recording.

        Args:
            poses: Poses of links in the world, by robot and link; what is left out
                stays where it was, and what isn't drawn is ignored.
            time: Time in the recording, if there is one [s].
        """
        moved = []
        for robot, of_links in poses.items():
            for name, X_WL in of_links.items():
                link = (robot, name)
                known = self._poses.get(link)
                if known is None:
                    continue
                # Between pictures of a recording, Meshcat interpolates.
                if time is not None or not known.IsExactlyEqualTo(X_WL):
                    # Drake may compute the next pose in the same place.
                    self._poses[link] = RigidTransform(X_WL)
                    moved.append(link)
        for kind in self._shown:
            paths = self._paths[kind]
            for link in moved:
                if link in paths:
                    self._meshcat.SetTransform(paths[link], self._poses[link], time)

    def frame_paths(self) -> dict[str, str]:
        """Return the names of all links by the Meshcat paths of their frames.

        The paths exist once the frames have been shown.
        """
        return {
            path_below("/drake/frames", robot, link): link
            for robot, link in self._poses
        }

    def clear(self) -> None:
        """Delete everything; as after the creation, nothing is shown."""
        for kind in self._paths:
            self._meshcat.Delete(f"/drake/{kind}")
        self._paths.clear()
        self._shown.clear()

    def _draw(self, kind: str) -> None:
        paths = self._paths[kind] = {}
        for name, robot in self._robots.items():
            for piece in PIECES[kind](robot):
                path = path_below(f"/drake/{kind}", name, piece.link)
                paths[name, piece.link] = path
                own = path_below(path, piece.name)
                self._meshcat.SetTransform(own, piece.X_LP)
                draw_solid(
                    self._meshcat,
                    own,
                    piece.solid,
                    piece.rgba,
                    is_on_top=piece.is_on_top,
                )
