"""A robot in a pose, drawn without physics."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.plant.joint_ranges import complete
from arm_drake.visualization.page.robot_viewer import RobotScene
from tests.models import GRIPPER, TWO_LINKS, bob, joint, load
from tests.shown import show_robot
from tests.visualization import scene
from tests.visualization.scene import about_y, pose

BALL = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'


def seen(folder: Path, urdf: str, **options: object) -> ad.Robot:
    """Load a robot whose links have something to be seen."""
    text = urdf.replace("</inertial>", f"</inertial>{BALL}")
    return load(folder, text, **options)  # type: ignore[arg-type]


@pytest.fixture
def meshcat() -> Meshcat:
    return scene.start()


def test_nothing_is_drawn_until_it_is_published(
    meshcat: Meshcat, tmp_path: Path
) -> None:
    drawn = RobotScene(meshcat, seen(tmp_path, TWO_LINKS))
    assert not meshcat.HasPath("/drake/visual/two_links")

    drawn.publish()

    assert meshcat.HasPath("/drake/visual/two_links/lower")


def test_it_is_in_the_initial_positions(meshcat: Meshcat, tmp_path: Path) -> None:
    robot = seen(tmp_path, TWO_LINKS, initial_positions={"shoulder": 0.4})

    poses = RobotScene(meshcat, robot).link_poses()

    expected = about_y(0.4).GetAsMatrix4()
    np.testing.assert_allclose(poses["upper"].GetAsMatrix4(), expected, atol=1e-12)


def test_links_are_where_the_joints_put_them(meshcat: Meshcat, tmp_path: Path) -> None:
    drawn = RobotScene(meshcat, seen(tmp_path, TWO_LINKS))

    drawn.set_positions({"shoulder": 0.3, "elbow": -1.0})
    drawn.publish()

    upper = about_y(0.3).GetAsMatrix4()
    # The elbow is 0.5 m down the upper arm.
    lower = upper @ about_y(-1.0, (0.0, 0.0, -0.5)).GetAsMatrix4()
    poses = drawn.link_poses()
    assert set(poses) == {"base", "upper", "lower"}
    for name, expected in (("base", np.eye(4)), ("upper", upper), ("lower", lower)):
        np.testing.assert_allclose(poses[name].GetAsMatrix4(), expected, atol=1e-12)
    for name, expected in (("upper", upper), ("lower", lower)):
        at = pose(meshcat, f"/drake/visual/two_links/{name}")
        np.testing.assert_allclose(at, expected, atol=1e-12)


def test_joints_that_are_left_out_stay(meshcat: Meshcat, tmp_path: Path) -> None:
    drawn = RobotScene(meshcat, seen(tmp_path, TWO_LINKS))
    drawn.set_positions({"shoulder": 0.3})

    drawn.set_positions({"elbow": 0.2})

    expected = about_y(0.5).GetAsMatrix4()[:3, :3]
    turned = drawn.link_poses()["lower"].rotation().matrix()
    np.testing.assert_allclose(turned, expected, atol=1e-12)


def test_a_follower_is_where_its_master_has_it(
    meshcat: Meshcat, tmp_path: Path
) -> None:
    robot = seen(tmp_path, GRIPPER)
    drawn = RobotScene(meshcat, robot)

    drawn.set_positions(complete(robot.description, {"finger": 0.5}))

    # -0.5 times the finger's angle plus 0.1.
    expected = about_y(-0.15).GetAsMatrix4()[:3, :3]
    turned = drawn.link_poses()["right"].rotation().matrix()
    np.testing.assert_allclose(turned, expected, atol=1e-12)


def test_a_link_called_world_has_no_pose(meshcat: Meshcat, tmp_path: Path) -> None:
    urdf = f"""<robot name="arm">
      <link name="world"/>{bob("upper")}{joint("shoulder", "world", "upper")}</robot>"""

    drawn = RobotScene(meshcat, seen(tmp_path, urdf))

    assert list(drawn.link_poses()) == ["upper"]


def test_the_robot_stands_where_it_is_put(meshcat: Meshcat, tmp_path: Path) -> None:
    robot = seen(tmp_path, TWO_LINKS, pose=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))

    base = RobotScene(meshcat, robot).link_poses()["base"]

    np.testing.assert_allclose(base.translation(), [1.0, 2.0, 3.0], atol=1e-12)


def test_what_there_is_can_be_asked_for(meshcat: Meshcat, tmp_path: Path) -> None:
    drawn = RobotScene(meshcat, seen(tmp_path, TWO_LINKS))
    drawn.set_positions({"shoulder": 0.3})

    query = drawn.query
    inspector = query.inspector()
    (frame,) = (
        frame
        for frame in inspector.GetAllFrameIds()
        if inspector.GetName(frame) == "two_links::upper"
    )

    at = query.GetPoseInWorld(frame).GetAsMatrix4()
    np.testing.assert_allclose(at, about_y(0.3).GetAsMatrix4(), atol=1e-12)


def test_show_robot_draws_it_and_moves_the_camera(
    meshcat: Meshcat, tmp_path: Path
) -> None:
    robot = seen(tmp_path, TWO_LINKS)

    show_robot(meshcat, robot)

    assert meshcat.HasPath("/drake/visual/two_links/upper")
    assert meshcat._GetPackedTransform("/Cameras/default/rotated") or (
        meshcat._GetPackedProperty("/Cameras/default/rotated/<object>", "position")
    )
