"""A robot on a page with sliders: its methods, and what happens when files change."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Meshcat

import arm_drake as ad
from arm_drake.description.source_files import file_of, files_of_failed
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page.robot_viewer import RobotViewer
from tests.models import GRIPPER, TWO_LINKS, bob, joint
from tests.visualization.page.clients import Panel
from tests.visualization.scene import about_y, is_visible, pose, transform
from tests.waiting import wait_until

BALL = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'

# Poses of an arm and of nothing: sorted by file, then by place.
SRDF = """
<robot name="two_links">
  <group_state name="up" group="arm">
    <joint name="shoulder" value="1.5"/><joint name="elbow" value="-0.5"/>
  </group_state>
  <group_state name="half" group="lower">
    <joint name="elbow" value="0.25"/>
  </group_state>
</robot>"""


@pytest.fixture
def tmp_path(tmp_path: Path) -> Path:
    """A package with no others around it: they would be searched, again and again."""
    folder = tmp_path / "workspace" / "src" / "two_links"
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


def write(folder: Path, urdf: str) -> Path:
    """Write a robot whose links are to be seen; one that is new to a watcher."""
    package = "<package><name>two_links</name></package>"
    (folder / "package.xml").write_text(package, encoding="utf-8")
    file = folder / "robot.urdf"
    new = folder / "new.urdf"
    new.write_text(urdf.replace("</inertial>", f"</inertial>{BALL}"), encoding="utf-8")
    # As editors do: another file takes the place.
    new.replace(file)
    return file


def view(
    page: Page, folder: Path, urdf: str = TWO_LINKS, **options: Any
) -> RobotViewer:
    file = write(folder, urdf)
    return RobotViewer(page, lambda: ad.load_robot(file), **options)


def link_at(meshcat: Meshcat, viewer: RobotViewer, link: str) -> np.ndarray:
    """Return where a link is drawn in the world that is seen, shape (4, 4)."""
    return pose(meshcat, f"/drake/visual/{viewer.robot.name}/{link}")


def test_it_starts_in_the_initial_positions(page: Page, tmp_path: Path) -> None:
    file = write(tmp_path, GRIPPER)
    initial = {"finger": 0.5}

    viewer = RobotViewer(page, lambda: ad.load_robot(file, initial_positions=initial))

    # The follower: -0.5 times it plus 0.1.
    assert viewer.positions == pytest.approx({"finger": 0.5, "follower": -0.15})
    assert viewer.robot.name == "gripper"
    assert viewer.ranges == joint_ranges(viewer.robot.description)


def test_links_are_drawn_where_joints_put_them(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    viewer.set_positions({"shoulder": 0.3, "elbow": -1.0})

    upper, lower = (link_at(page.meshcat, viewer, name) for name in ("upper", "lower"))
    expected = about_y(0.3).GetAsMatrix4()
    np.testing.assert_allclose(upper, expected, atol=1e-12)
    # The elbow is 0.5 m down the upper arm.
    expected = expected @ about_y(-1.0, (0.0, 0.0, -0.5)).GetAsMatrix4()
    np.testing.assert_allclose(lower, expected, atol=1e-12)


def test_joints_that_are_left_out_stay(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    viewer.set_positions({"shoulder": 0.3})
    viewer.set_positions({"elbow": 0.5})

    assert viewer.positions == {"shoulder": 0.3, "elbow": 0.5}
    assert viewer.pose_yaml() == "shoulder: 0.3\nelbow: 0.5\n"


def test_positions_are_kept_to_the_limits(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    viewer.set_positions({"shoulder": 100.0, "elbow": -100.0})

    assert viewer.positions == {"shoulder": 3.0, "elbow": -3.0}


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ({"fingr": 0.0}, "no joint 'fingr'; did you mean 'finger'? known: finger"),
        ({"follower": 0.0}, "'follower' follows 'finger'; give that one"),
        (
            {"finger": np.nan},
            "joint 'finger': expected a finite number, got nan",
        ),
    ],
)
def test_positions_that_cannot_be_are_said_and_nothing_moves(
    page: Page, tmp_path: Path, positions: dict[str, float], message: str
) -> None:
    viewer = view(page, tmp_path, GRIPPER)
    before = viewer.positions

    for do in (viewer.set_positions, viewer.show_ghost):
        with pytest.raises(InputError) as caught:
            do(positions)
        assert str(caught.value) == message

    assert viewer.positions == before


def test_random_poses_are_within_the_limits_and_repeatable(
    page: Page, tmp_path: Path
) -> None:
    viewer = view(page, tmp_path)

    viewer.randomize(seed=1)
    first = viewer.positions
    viewer.randomize()
    second = viewer.positions
    viewer.randomize(seed=1)

    assert viewer.positions == first != second
    assert all(-3.0 <= q <= 3.0 for q in (*first.values(), *second.values()))


def test_the_center_is_zero(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    viewer.randomize(seed=1)

    viewer.center()

    assert viewer.positions == {"shoulder": 0.0, "elbow": 0.0}


def test_named_poses_are_taken_by_either_name(page: Page, tmp_path: Path) -> None:
    (tmp_path / "two_links.srdf").write_text(SRDF, encoding="utf-8")
    viewer = view(page, tmp_path)
    assert [pose.label for pose in viewer.named_poses] == ["arm: up", "lower: half"]

    viewer.take_named_pose("up")
    assert viewer.positions == {"shoulder": 1.5, "elbow": -0.5}
    viewer.take_named_pose("lower: half")
    assert viewer.positions == {"shoulder": 1.5, "elbow": 0.25}

    with pytest.raises(InputError) as caught:
        viewer.take_named_pose("down")
    assert str(caught.value) == "no pose 'down'; known: arm: up, lower: half"


def test_without_an_srdf_there_are_no_poses(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    with pytest.raises(InputError) as caught:
        viewer.take_named_pose("up")

    assert str(caught.value) == "no pose 'up'; the robot has no SRDF with poses"


def test_the_fixed_frame_stays_where_the_world_was(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    viewer.set_fixed_frame("lower")

    for shoulder in (0.0, 0.7, -1.2):
        viewer.set_positions({"shoulder": shoulder, "elbow": 0.4})
        at = link_at(page.meshcat, viewer, "lower")
        np.testing.assert_allclose(at, np.eye(4), atol=1e-12)

    viewer.set_fixed_frame("world")
    assert viewer.fixed_frame == "world"
    np.testing.assert_allclose(transform(page.meshcat, "/drake"), np.eye(4))


def test_a_fixed_frame_that_is_not_there_is_said(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    message = (
        "fixed frame: no link 'lowr'; did you mean 'lower'? known: base, lower, upper, "
        "world"
    )

    with pytest.raises(InputError) as caught:
        viewer.set_fixed_frame("lowr")
    assert str(caught.value) == message
    assert viewer.fixed_frame == "world"

    with pytest.raises(InputError) as caught:
        view(page, tmp_path, fixed_frame="lowr")
    assert str(caught.value) == message


def test_what_cannot_be_shown_is_said(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    with pytest.raises(InputError) as caught:
        viewer.show("shadow")

    assert str(caught.value) == (
        "nothing called 'shadow' can be shown; known: collision, frames, inertia, "
        "joint_axes, names, visual"
    )


def test_frames_are_shown_where_links_are_at_once(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    viewer.set_positions({"shoulder": 0.3})

    viewer.show("frames")

    at = transform(page.meshcat, "/drake/frames/two_links/upper")
    np.testing.assert_allclose(at, about_y(0.3).GetAsMatrix4(), atol=1e-12)


def test_a_ghost_stays_while_the_robot_moves(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    viewer.set_positions({"shoulder": 0.5})

    viewer.show_ghost({"elbow": 1.0})
    viewer.set_positions({"shoulder": -1.0, "elbow": -1.0})

    path = "/drake/ghost/two_links/upper"
    expected = about_y(0.5).GetAsMatrix4()
    np.testing.assert_allclose(transform(page.meshcat, path), expected, atol=1e-12)
    assert is_visible(page.meshcat, "/drake/ghost/two_links")
    viewer.hide_ghost()
    assert not is_visible(page.meshcat, "/drake/ghost/two_links")


def test_the_panel_shows_the_pose_and_takes_events(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    with Panel(page.port) as panel:
        message = panel.hear_until(lambda m: m["type"] == "panel")
        panel.say("joint:shoulder", 0.25)
        wait_until(lambda: len(page._events) == 1)
        viewer.handle(page.events(0.0))

        panel.hear_field("joint:shoulder", "value", 0.25)
        panel.hear_field("pose", "value", "shoulder: 0.25\nelbow: 0.0\n")
        panel.hear_field("words", "value", "--position shoulder=0.25 elbow=0.0")
    assert viewer.positions["shoulder"] == 0.25
    assert message["title"] == "two_links"
    titles = [section["title"] for section in message["sections"]]
    assert titles[:5] == ["Joints", "Pose", "Camera", "Pose of a link", "Show"]


# The elbow is gone; a wrist is new, and starts where no initial position says else.
OTHER = f"""
<robot name="two_links">
  <link name="base"/>{bob("upper")}{bob("hand")}
  {joint("shoulder", "base", "upper")}
  {joint("wrist", "upper", "hand", xyz="0 0 -0.5")}
</robot>"""


def test_after_a_reload_all_is_as_it_was(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path, shown=("visual", "collision"))
    viewer.show("frames")
    viewer.set_positions({"shoulder": 0.5, "elbow": -0.5})
    viewer.set_fixed_frame("upper")
    viewer.show_ghost({"shoulder": 1.0})

    write(tmp_path, OTHER)
    assert viewer.reload()

    assert viewer.positions == {"shoulder": 0.5, "wrist": 0.0}
    assert list(viewer.robot.description.links) == ["base", "upper", "hand"]
    assert viewer.fixed_frame == "upper"
    for kind in ("frames", "collision", "visual"):
        assert is_visible(page.meshcat, f"/drake/{kind}")
    at = link_at(page.meshcat, viewer, "upper")
    np.testing.assert_allclose(at, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(
        transform(page.meshcat, "/drake/frames/two_links/upper"),
        about_y(0.5).GetAsMatrix4(),
        atol=1e-12,
    )
    np.testing.assert_allclose(
        transform(page.meshcat, "/drake/ghost/two_links/upper"),
        about_y(1.0).GetAsMatrix4(),
        atol=1e-12,
    )
    # What is no longer there isn't drawn.
    assert not page.meshcat.HasPath("/drake/visual/two_links/lower")
    assert not page.meshcat.HasPath("/drake/frames/two_links/lower")


def test_a_fixed_frame_that_is_gone_gives_way_to_the_world(
    page: Page, tmp_path: Path
) -> None:
    viewer = view(page, tmp_path)
    viewer.set_fixed_frame("lower")

    write(tmp_path, OTHER)
    viewer.reload()

    assert viewer.fixed_frame == "world"
    np.testing.assert_allclose(transform(page.meshcat, "/drake"), np.eye(4))


def test_positions_are_kept_to_the_new_limits(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    viewer.set_positions({"shoulder": 2.5})

    write(tmp_path, TWO_LINKS.replace('upper="3"', 'upper="1"'))
    viewer.reload()

    assert viewer.positions == {"shoulder": 1.0, "elbow": 0.0}


@pytest.mark.parametrize(
    "text",
    ["", "<robot", "\x00", "<robot name='a'/>", TWO_LINKS.replace("0 1 0", "0 0 0")],
    ids=range(5),
)
def test_a_file_that_cannot_be_read_keeps_the_last_robot(
    page: Page, tmp_path: Path, text: str
) -> None:
    viewer = view(page, tmp_path)
    viewer.set_positions({"shoulder": 0.5})
    robot, file = viewer.robot, tmp_path / "robot.urdf"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ArmDrakeError) as caught:
        ad.load_robot(file)

    with Panel(page.port) as panel:
        assert not viewer.reload()
        said = panel.hear_until(lambda m: m["type"] == "message" and m["text"])
        assert said["text"] == (
            f"{caught.value}\n\nThe last robot that could be loaded stays."
        )
        assert said["severity"] == "error"

        assert viewer.robot is robot
        viewer.set_positions({"elbow": 0.5})
        assert viewer.positions == {"shoulder": 0.5, "elbow": 0.5}

        write(tmp_path, TWO_LINKS)
        assert viewer.reload()
        panel.hear_until(lambda m: m["type"] == "message" and not m["text"])


def test_a_missing_file_keeps_the_last_robot(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)
    (tmp_path / "robot.urdf").unlink()

    assert not viewer.reload()

    assert viewer.positions == {"shoulder": 0.0, "elbow": 0.0}


def run_while(viewer: RobotViewer, page: Page, do: Any) -> None:
    """Run a viewer, while another thread does something, and then stops it."""

    def do_and_stop() -> None:
        try:
            do()
        finally:
            viewer.stop()
            page.call(lambda: None)

    thread = threading.Thread(target=do_and_stop)
    thread.start()
    viewer.run()
    thread.join()


def test_it_reloads_by_itself_when_a_file_changes(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arm_drake.visualization.page.robot_viewer._WATCH_PERIOD", 0.01)
    viewer = view(page, tmp_path)
    names: list[list[str]] = []

    def change() -> None:
        for urdf, name in ((OTHER, "wrist"), (TWO_LINKS, "elbow")):
            write(tmp_path, urdf)
            wait_until(lambda name=name: name in viewer.positions)
            names.append(list(viewer.positions))

    run_while(viewer, page, change)

    assert names == [["shoulder", "wrist"], ["shoulder", "elbow"]]


@pytest.mark.slow
def test_it_reloads_when_a_file_that_was_missing_comes(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arm_drake.visualization.page.robot_viewer._WATCH_PERIOD", 0.01)
    file, part = tmp_path / "robot.urdf.xacro", tmp_path / "part.xacro"
    write(tmp_path, TWO_LINKS)
    xmlns = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    head = f'<robot name="two_links" {xmlns}><link name="base"/>'
    file.write_text(f"{head}</robot>", encoding="utf-8")
    viewer = RobotViewer(
        page,
        lambda: ad.load_robot(file),
        find_files=lambda error: files_of_failed(file, error),
    )
    failures = []
    monkeypatch.setattr(page, "say", lambda *said: failures.append(said))

    def change() -> None:
        include = '<xacro:include filename="part.xacro"/></robot>'
        file.write_text(f"{head}{include}", encoding="utf-8")
        wait_until(lambda: failures)
        # The file that has failed doesn't change any more.
        part.write_text(
            f"<robot {xmlns}>{bob('upper')}{joint('swing', 'base', 'upper')}</robot>",
            encoding="utf-8",
        )
        wait_until(lambda: "swing" in viewer.positions)

    run_while(viewer, page, change)

    assert "part.xacro" in failures[0][0]
    assert list(viewer.positions) == ["swing"]


def test_by_default_the_file_of_the_error_is_watched() -> None:
    assert file_of(InputError("bad", file="/a/b.yaml")) == (Path("/a/b.yaml"),)
    assert file_of(InputError("bad")) == ()
    assert file_of(OSError("bad")) == ()


def test_without_watching_files_may_change(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arm_drake.visualization.page.robot_viewer._WATCH_PERIOD", 0.01)
    viewer = view(page, tmp_path, is_watching=False)
    looks: list[float] = []
    take = page.events
    monkeypatch.setattr(page, "events", lambda t: (looks.append(t), take(t))[1])

    def change() -> None:
        write(tmp_path, OTHER)
        count = len(looks) + 5
        wait_until(lambda: len(looks) > count)

    run_while(viewer, page, change)

    assert "elbow" in viewer.positions


def test_run_does_what_is_clicked(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path)

    def click() -> None:
        with Panel(page.port) as panel:
            panel.say("joint:elbow", 0.75)
            panel.hear_field("joint:elbow", "value", 0.75)
            panel.say("center")
            panel.hear_field("joint:elbow", "value", 0.0)
            panel.say("fixed_frame", "nowhere")
            panel.hear_until(lambda m: m["type"] == "message" and m["text"])

    run_while(viewer, page, click)

    assert viewer.positions["elbow"] == 0.0


def test_a_robot_without_joints_can_be_looked_at(page: Page, tmp_path: Path) -> None:
    viewer = view(page, tmp_path, f'<robot name="rock">{bob("rock")}</robot>')

    viewer.randomize()
    viewer.center()
    viewer.handle([WidgetEvent("joint:none", 1.0), WidgetEvent("frame")])

    assert viewer.positions == {}
    assert viewer.pose_yaml() == ""
