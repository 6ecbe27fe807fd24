"""A robot as loaded from its files."""

import dataclasses as dc
from collections.abc import Mapping

from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription

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

    # Distribution whose controllers it runs.
    distro: str = "jazzy"

    # Name of the bundled robot, if it is one.
    bundled: str | None = None
