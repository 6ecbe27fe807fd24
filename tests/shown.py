"""Robots to look at, without a page."""

from pydrake.geometry import Meshcat

from arm_drake.description.robot import Robot
from arm_drake.visualization.meshcat import frame_shapes
from arm_drake.visualization.page.robot_viewer import RobotScene


def show_robot(meshcat: Meshcat, robot: Robot) -> None:
    """Draw a robot in its initial positions, and point the camera at it.

    Args:
        meshcat: Where to draw it.
        robot: The robot.
    """
    scene = RobotScene(meshcat, robot)
    scene.publish()
    frame_shapes(meshcat, scene.query)
