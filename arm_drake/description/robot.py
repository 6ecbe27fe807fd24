"""A robot as loaded from its files."""

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.bridge import TopicAlias
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.joints import FREE_TYPES
from arm_drake.description.portable import make_portable
from arm_drake.description.report import LoadReport
from arm_drake.description.sensors import SensorInfo
from arm_drake.description.tree import links_on
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError

# Pose of a robot's base in the world: x, y, z [m], roll, pitch, yaw [rad].
Pose = tuple[float, float, float, float, float, float]


@dc.dataclass(frozen=True, eq=False)
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


def list_robots(robots: Robot | Sequence[Robot]) -> list[Robot]:
    """Return one or several robots as a list.

    Raises:
        InputError: If there is none, or two have the same name.
    """
    several = [robots] if isinstance(robots, Robot) else list(robots)
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
