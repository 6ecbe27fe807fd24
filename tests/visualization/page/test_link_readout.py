"""The readout of a link: Drake's kinematics are the judge."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.visualization.page import Scene, WidgetEvent
from arm_drake.visualization.page.live_views import LiveViews
from arm_drake.visualization.page.panel import LinkReadout
from arm_drake.visualization.page.robot_viewer import RobotViewer
from tests.models import FALLING_BALL, GRAVITY, MASS, TWO_LINKS, load

# Half of the last decimal that is told.
ROUNDED = 5.1e-7


class Panel(Scene):
    """A scene that knows the values of its widgets."""

    def __init__(self) -> None:
        super().__init__()
        self.values: dict[str, Any] = {}

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        for name, change in changes.items():
            self.values[name] = change.get("value")

    def told(self, name: str) -> dict[str, Any]:
        """Return a text of the readout, which is YAML."""
        content: dict[str, Any] = yaml.safe_load(self.values[f"readout:{name}"])
        return content


@pytest.fixture
def panel() -> Iterator[Panel]:
    with Panel() as panel:
        yield panel


@pytest.fixture
def viewer(panel: Panel, tmp_path: Path) -> RobotViewer:
    robot = load(tmp_path, TWO_LINKS)
    viewer = RobotViewer(panel, lambda: robot, is_watching=False)
    viewer.set_positions({"shoulder": 0.7, "elbow": -1.9})
    return viewer


def by_drake(viewer: RobotViewer, link: str, other: str) -> RigidTransform:
    plant, model = viewer._scene.plant, viewer._scene.model
    frames = [plant.GetFrameByName(name, model) for name in (other, link)]
    return plant.CalcRelativeTransform(viewer._scene.context, *frames)


def test_the_pose_in_the_world_is_told(viewer: RobotViewer, panel: Panel) -> None:
    expected = by_drake(viewer, "lower", "base")

    told = panel.told("pose")

    assert panel.values["readout:frame"] == "lower"
    np.testing.assert_allclose(told["xyz"], expected.translation(), atol=ROUNDED)
    R = RotationMatrix(RollPitchYaw(told["rpy"]))
    np.testing.assert_allclose(
        R.matrix(), expected.rotation().matrix(), atol=4.0 * ROUNDED
    )
    turn = Quaternion(wxyz=np.array([told["quaternion"][c] for c in "wxyz"]))
    np.testing.assert_allclose(
        turn.wxyz(), expected.rotation().ToQuaternion().wxyz(), atol=2.0 * ROUNDED
    )


def test_the_pose_is_relative_to_another_link(
    viewer: RobotViewer, panel: Panel
) -> None:
    viewer.handle([WidgetEvent("readout:relative_to", "upper")])

    expected = by_drake(viewer, "lower", "upper")
    np.testing.assert_allclose(
        panel.told("pose")["xyz"], expected.translation(), atol=ROUNDED
    )


def test_by_default_it_is_relative_to_the_fixed_frame(
    viewer: RobotViewer, panel: Panel
) -> None:
    viewer.set_fixed_frame("upper")

    expected = by_drake(viewer, "lower", "upper").translation()
    np.testing.assert_allclose(panel.told("pose")["xyz"], expected, atol=ROUNDED)


def test_angles_are_in_degrees_if_wanted(viewer: RobotViewer, panel: Panel) -> None:
    viewer.set_positions({"shoulder": 0.0, "elbow": 0.5})

    viewer.readout.set_degrees(True)

    told = panel.told("pose")
    assert "rpy" not in told
    assert told["rpy_degrees"] == pytest.approx([0.0, np.rad2deg(0.5), 0.0], abs=1e-6)


def test_it_says_what_the_link_is(viewer: RobotViewer, panel: Panel) -> None:
    assert panel.told("link") == {
        "name": "lower",
        "mass": MASS,
        "parent": "upper",
        "joint": "elbow",
        "joint_type": "revolute",
    }


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["visual", "collision", "inertia"])
def test_a_click_on_what_is_drawn_of_a_link_chooses_it(
    viewer: RobotViewer, panel: Panel, kind: str
) -> None:
    viewer.handle(
        [WidgetEvent("readout:pick", f"drake/{kind}/two_links/upper/<object>")]
    )

    assert viewer.readout.frame == "upper"
    assert panel.values["readout:frame"] == "upper"


@pytest.mark.slow
@pytest.mark.parametrize("path", ["", "drake", "drake/visual/two_links/up", 7, None])
def test_a_click_beside_links_chooses_nothing(
    viewer: RobotViewer, path: object
) -> None:
    viewer.handle([WidgetEvent("readout:pick", path)])

    assert viewer.readout.frame == "lower"


def test_an_unknown_frame_is_refused(viewer: RobotViewer) -> None:
    with pytest.raises(InputError) as caught:
        viewer.readout.set_relative_to("upperr")

    assert str(caught.value).startswith("pose: no frame 'upperr'; ")
    assert "upper" in str(caught.value)


def test_with_several_robots_links_have_their_names(
    panel: Panel, tmp_path: Path
) -> None:
    robots = [load(tmp_path, TWO_LINKS, name=name) for name in ("left", "right")]
    readout = LinkReadout(panel, robots)

    readout.pick("drake/visual/right/upper/0")

    assert readout.frame == "right/upper"


@pytest.mark.slow
def test_contacts_carry_the_weight_of_a_simulated_link(
    panel: Panel, tmp_path: Path
) -> None:
    options = ad.SimulationOptions(frame_rate=0.0)
    diagram = ad.build_diagram(
        load(tmp_path, FALLING_BALL), options=options, meshcat=panel.meshcat
    )
    sim = ad.Simulation(diagram)
    views = LiveViews(panel, sim)
    sim.run(3.0)
    views.readout.set_frame("ball")

    views.refresh()

    (contact,) = panel.told("link")["contacts"]
    assert contact["force"] == pytest.approx(MASS * GRAVITY, rel=0.01)
    expected = sim.link_poses()["ball"].translation()
    np.testing.assert_allclose(panel.told("pose")["xyz"], expected, atol=ROUNDED)
