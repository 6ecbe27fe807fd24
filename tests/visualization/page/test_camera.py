"""The page's camera looks from where it is told to, and follows a link."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.visualization.meshcat import View
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.camera import DIRECTIONS, CameraPart
from arm_drake.visualization.page.robot_viewer import RobotViewer
from tests.visualization.scene import transform

# An arm of 0.4 m turns at its root about z, which is 0.5 m high.
ARM = """
<robot name="arm">
  <link name="base"/>
  <link name="tip"/>
  <joint name="turn" type="continuous">
    <parent link="base"/><child link="arm"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
  </joint>
  <link name="arm">
    <visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
  </link>
  <joint name="end" type="fixed">
    <parent link="arm"/><child link="tip"/><origin xyz="0.4 0 0"/>
  </joint>
</robot>"""


@pytest.fixture
def viewer() -> Iterator[RobotViewer]:
    with Page() as page:
        robot = ad.load_robot(ARM, controllers=[])
        yield RobotViewer(page, lambda: robot, is_watching=False)


def camera_of(viewer: RobotViewer) -> CameraPart:
    [camera] = [part for part in viewer.parts if isinstance(part, CameraPart)]
    return camera


def test_the_camera_goes_where_the_link_goes(viewer: RobotViewer) -> None:
    viewer.handle([WidgetEvent("camera:follow", "tip")])
    viewer.set_positions({"turn": math.pi / 2.0})

    moved = transform(viewer.page.meshcat, "/Followed")
    np.testing.assert_allclose(moved[:3, 3], [-0.4, 0.4, 0.0], atol=1e-9)
    # It doesn't turn.
    np.testing.assert_allclose(moved[:3, :3], np.eye(3), atol=1e-9)
    viewer.handle([WidgetEvent("camera:follow", "nothing")])
    viewer.set_positions({"turn": math.pi})
    # It stays where it is, and goes on from there.
    viewer.handle([WidgetEvent("camera:follow", "tip")])
    viewer.set_positions({"turn": math.pi / 2.0})
    moved = transform(viewer.page.meshcat, "/Followed")
    np.testing.assert_allclose(moved[:3, 3], [0.0, 0.8, 0.0], atol=1e-9)


def test_what_is_seen_lies_as_a_drawing_has_it() -> None:
    # To the right, upwards and away in the picture.
    expected = {
        "top": [[1, 0, 0], [0, 1, 0], [0, 0, -1]],
        "front": [[0, 1, 0], [0, 0, 1], [-1, 0, 0]],
        "side": [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
    }
    for name, axes in expected.items():
        view = View(field_of_view=1.0, aspect=1.0, direction=DIRECTIONS[name])
        np.testing.assert_allclose(view._axes(), axes, atol=2e-3)


def test_a_view_or_link_that_is_not_there_is_said(viewer: RobotViewer) -> None:
    camera = camera_of(viewer)
    with pytest.raises(InputError, match=r"camera: no view 'left'; "):
        camera.look("left")
    with pytest.raises(InputError, match=r"camera: no link 'tipp'; .*'tip'"):
        camera.follow("tipp")


def test_a_camera_that_is_placed_anew_follows_from_there(viewer: RobotViewer) -> None:
    viewer.handle([WidgetEvent("camera:follow", "tip")])
    viewer.set_positions({"turn": math.pi / 2.0})

    viewer.handle([WidgetEvent("camera:top")])

    # What was gone before is forgotten: a page that comes later sees the same.
    viewer.set_positions({"turn": math.pi / 2.0})
    moved = transform(viewer.page.meshcat, "/Followed")
    np.testing.assert_allclose(moved[:3, 3], np.zeros(3), atol=1e-9)
    viewer.set_positions({"turn": math.pi})
    moved = transform(viewer.page.meshcat, "/Followed")
    np.testing.assert_allclose(moved[:3, 3], [-0.4, -0.4, 0.0], atol=1e-9)
