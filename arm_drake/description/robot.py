"""A robot as loaded from its files."""

import dataclasses as dc
import functools
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_drake.description.bridge import TopicAlias
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.gazebo_plugins import Ros2ControlPlugin
from arm_drake.description.joints import FREE_TYPES, links_on
from arm_drake.description.links import Pose
from arm_drake.description.packages import package_name
from arm_drake.description.report import LoadReport
from arm_drake.description.sensors import SensorInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError
from arm_drake.importing import dataclass

if TYPE_CHECKING:
    import arm_drake

# What may be an absolute path, as xacro writes it: of meshes as URIs, of other files
# bare, and of the entry file in a comment. One that ends a value may have spaces.
_PATH = re.compile(
    r"(?P<scheme>file:/{0,2}(?=/))?"
    r"(?P<path>/(?:[^\n\"'<>|,;:]+(?=[\"'<,;:]| \|)|[^\s\"'<>|,;:]+))"
)

# A file that is named from the entry file's folder.
_RELATIVE = re.compile(r"(?<=filename=\")(?![\w+.-]+:|/)[^\"<>]+")


def make_portable(text: str, file: Path) -> str:
    """Return a description with package URIs in place of paths into packages.

    So are files named that stand relative to the entry file. Paths to anywhere else
    stay as they are.
    """

    def rename(match: re.Match[str]) -> str:
        before = text[match.start() - 1 : match.start()]
        # Part of a relative path, or of another URI; lists have colons, too.
        is_part = before.isalnum() or before in ("/", ".")
        is_part |= before == ":" and match["path"].startswith("//")
        if is_part and match["scheme"] is None:
            return match[0]
        if " /" in match["path"]:  # Several of them.
            first, *others = match["path"].split(" /")
            paths = [(match["scheme"] or "") + first, *(f"/{each}" for each in others)]
        else:
            paths = [match[0]]
        names = [name_portably(path) for path in paths]
        return " ".join(file.name if name == str(file) else name for name in names)

    def resolve(match: re.Match[str]) -> str:
        path = str(file.parent / match[0])
        name = name_portably(path)
        return match[0] if name == path or not os.path.isfile(path) else name

    return _RELATIVE.sub(resolve, _PATH.sub(rename, text))


def name_portably(path: str) -> str:
    """Return a package URI in place of a path into a package; others as they are."""
    place = re.sub("^(file:)?/+", "/", path)
    # As it is written: what climbs out of a package is named from that package.
    end = len(place.rstrip("/"))
    while end > 0:
        name = _package_at(place[:end])
        if name is not None:
            return f"package://{name}{place[end:]}"
        end = place.rfind("/", 0, end)
    return path


@functools.lru_cache(maxsize=10_000)
def _package_at(folder: str) -> str | None:
    """Return the name of the package that a folder is, if it is one."""
    manifest = Path(folder, "package.xml")
    return package_name(manifest) if os.path.isfile(manifest) else None


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot as loaded: what it is, how it is controlled, and what was mended."""

    # Name of its model, and of its ports where there are several robots.
    name: str

    description: RobotDescription
    controllers: ControllerManagerConfig
    report: LoadReport

    # Initial position of every movable joint [rad] or [m].
    initial_positions: Mapping[str, float]

    # Pose of the base in the world: x, y, z [m], roll, pitch, yaw [rad].
    pose: Pose | None = None

    # Whether its base moves freely, as that of a mobile robot; else it is fixed.
    has_free_base: bool = False

    # Folders that were searched for packages.
    package_paths: tuple[Path, ...] = ()

    # The files that it was made of, sorted: description, YAML, meshes.
    source_files: tuple[Path, ...] = ()

    # Distribution whose controllers it runs.
    distro: str = "jazzy"

    # Name of the bundled robot, if it is one.
    bundled: str | None = None

    # Sensors of `<ros2_control>` that measure something of the physics.
    sensors: tuple[SensorInfo, ...] = ()

    # Topics of ROS that a bridge connects with Gazebo's.
    topic_aliases: tuple[TopicAlias, ...] = ()

    # Each ControllerType of this robot alone, by its ros2_control name.
    controller_types: Mapping[str, Any] = dc.field(default_factory=dict)

    # SRDF files of MoveIt that are for it; None for those around the description.
    srdf_files: tuple[Path, ...] | None = None

    # Arguments of `load_robot` that made it, but for types of controllers.
    load_options: Mapping[str, Any] = dc.field(default_factory=dict)

    def __repr__(self) -> str:
        """Return its name, what moves, and what commands that; its fields are long."""
        joints = [joint.name for joint in self.description.movable_joints]
        names = [controller.name for controller in self.controllers.controllers]
        return f"<Robot {self.name!r}, joints {joints}, controllers {names}>"

    @property
    def title(self) -> str:
        """Title where there is room for one name: as it was requested."""
        is_renamed = self.name != self.description.name
        return self.name if is_renamed or self.bundled is None else self.bundled

    @property
    def namespace(self) -> str:
        """Name space of its nodes where it is alone: "", or such as "/cell".

        It is that of its controller manager: what it was loaded with, else what its
        Gazebo plugin says.
        """
        plugins = self.description.joint_plugins
        tags = (p.namespace for p in plugins if isinstance(p, Ros2ControlPlugin))
        named = self.load_options.get("namespace") or next(filter(None, tags), "")
        return "".join(f"/{part}" for part in named.split("/") if part)

    @functools.cached_property
    def portable_source(self) -> str:
        """The expanded description without folders of this machine, as logs have it."""
        return make_portable(self.description.source, self.description.file)

    @property
    def free_links(self) -> set[str]:
        """The links that nothing holds: those on a free base or a loose joint."""
        description = self.description
        roots = [j.child for j in description.joints if j.type in FREE_TYPES]
        if self.has_free_base:
            roots.append(description.base)
        return {link for root in roots for link in links_on(description.joints, root)}

    def forward_kinematics(self, positions: Mapping[str, float], frame: str) -> Any:
        """Return where a link is; see `arm_drake.forward_kinematics`."""
        import arm_drake

        return arm_drake.forward_kinematics(self, positions, frame)

    def solve_ik(self, frame: str, pose: Any, **options: Any) -> "arm_drake.IkSolution":
        """Return joint positions that put a link at a pose; see `arm_drake.solve_ik`.

        It takes the same options.
        """
        import arm_drake

        return arm_drake.solve_ik(self, frame, pose, **options)


def list_robots(robots: Robot | Sequence[Robot]) -> list[Robot]:
    """Return one or several robots as a list."""
    several: list[Any] = [robots]
    if isinstance(robots, Iterable) and not isinstance(robots, str):
        several = list(robots)
    for robot in several:
        if not isinstance(robot, Robot):
            source = repr(str(robot)) if isinstance(robot, str | Path) else "..."
            got = f"got {type(robot).__name__}"
            raise InputError(f"expected a robot of load_robot({source}), {got}")
    if not several:
        raise InputError("no robot was given; expected at least one")
    names = [robot.name for robot in several]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{names.count(name)} robots are called {name!r}; "
                "give each its own name with load_robot(..., name=...)"
            )
    return several
