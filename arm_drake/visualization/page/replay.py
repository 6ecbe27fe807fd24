"""A recorded rollout, drawn without physics."""

import dataclasses as dc
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.bundled import bundled_robots, models_folder
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.loading import load_robot
from arm_drake.rollout.rollout import Rollout
from arm_drake.visualization.meshcat import frame_shapes
from arm_drake.visualization.page.robot_scene import RobotScene

# What a description has for its controllers, which don't run here.
_CONTROL = ("gazebo", "ros2_control", "transmission")


def load_recorded_robot(
    rollout: Rollout,
    *,
    package_paths: Sequence[Path] = (),
    max_faces: int | None = None,
) -> Robot:
    """Return the robot of a rollout, of the description that was recorded with it.

    Args:
        rollout: The rollout.
        package_paths: Folders to search for the packages that hold its meshes.
        max_faces: Triangles of each mesh that is drawn, at most.

    Raises:
        InputError: If no description was recorded, or it can't be used.
    """
    if not rollout.description:
        raise InputError("the log doesn't hold its robot's description; name the robot")
    try:
        root = ET.fromstring(rollout.description)  # noqa: S314  what was loaded.
    except ET.ParseError as error:
        text = f"the description in the log can't be read: {error}"
        raise InputError(text) from None
    for tag in _CONTROL:
        for element in root.findall(tag):
            root.remove(element)
    about = rollout.info.get("robot", {})
    folders = list(package_paths)
    # What a file says is no path to be followed.
    if about.get("bundled") in bundled_robots():
        folders.append(models_folder() / about["bundled"])
    with tempfile.TemporaryDirectory() as folder:
        # So deep that nothing around the temporary folder is searched for packages.
        file = Path(folder, "a", "log", "is", "replayed", "now", "robot.urdf")
        file.parent.mkdir(parents=True)
        file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
        robot = load_robot(
            file,
            name=rollout.robot_name or None,
            package_paths=folders,
            pose=about.get("pose"),
            max_faces=max_faces,
        )
    has_free_base = any(root in rollout.free_poses for root in robot.description.roots)
    return dc.replace(robot, has_free_base=has_free_base)


class Replay:
    """Shows a robot where it was."""

    def __init__(self, meshcat: Meshcat, rollout: Rollout, robot: Robot) -> None:
        """Draw the robot as in the first row.

        Args:
            meshcat: Where to draw it.
            rollout: Where it was.
            robot: The robot.

        Raises:
            InputError: If the rollout has no rows, or joints that the robot hasn't.
        """
        if not len(rollout.time):
            raise InputError("the log has no rows; there is nothing to show")
        if not np.isfinite(rollout.position).all():
            raise InputError("the log has positions that are no numbers")
        known = [joint.name for joint in robot.description.movable_joints]
        for name in rollout.joint_names:
            if name not in known:
                hint = suggest(name, known)
                raise InputError(f"the robot has no joint {name!r} of the log; {hint}")
        self.rollout, self.robot = rollout, robot
        self._meshcat = meshcat
        self._scene = RobotScene(meshcat, robot)
        self.show(self.start)

    @property
    def start(self) -> float:
        """Time of the first row [s]."""
        return float(self.rollout.time[0])

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return float(self.rollout.time[-1])

    def show(self, time: float) -> None:
        """Draw the robot where it was at a time, between rows in between.

        Args:
            time: When [s].
        """
        rollout = self.rollout
        at = min(max(time, self.start), self.end)
        after = min(int(np.searchsorted(rollout.time, at)), len(rollout.time) - 1)
        before = max(after - 1, 0)
        gap = float(rollout.time[after] - rollout.time[before])
        part = (at - float(rollout.time[before])) / gap if gap else 0.0

        def between(values: Array) -> Array:
            return np.asarray((1.0 - part) * values[before] + part * values[after])

        position = between(rollout.position).tolist()
        self._scene.set_positions(dict(zip(rollout.joint_names, position, strict=True)))
        for link, poses in rollout.free_poses.items():
            pose = between(_aligned(poses, before, after))
            if np.all(np.isfinite(pose)):
                turn = Quaternion(pose[3:] / np.linalg.norm(pose[3:]))
                self._scene.set_free_pose(link, RigidTransform(turn, pose[:3]))
        self._scene.publish(at - self.start)

    def frame(self) -> None:
        """Point the camera at the robot, so that all of it is to be seen now."""
        frame_shapes(self._meshcat, self._scene.query)

    def link_poses(self) -> dict[str, RigidTransform]:
        """Return the pose of every link in the world, as drawn."""
        return self._scene.link_poses()


def _aligned(poses: Array, before: int, after: int) -> Array:
    """Return poses, whose quaternions in two rows are on the same side."""
    if poses[before, 3:] @ poses[after, 3:] >= 0.0:
        return poses
    turned = poses.copy()
    turned[after, 3:] *= -1.0
    return turned
