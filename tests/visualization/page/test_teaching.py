"""Way points that are taught on a page become a motion that goes through them."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import Duration, JointTrajectory, JointTrajectoryPoint
from arm_drake.visualization.page import (
    Page,
    Section,
    WidgetEvent,
    live_simulation,
    parts,
)
from arm_drake.visualization.page.live_simulation import LiveSimulation, make_sections
from arm_drake.visualization.page.robot_viewer import RobotViewer
from arm_drake.visualization.page.teaching import WayPoints

CONTROLLER = "joint_trajectory_controller"


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("lab5_arm")


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Page]:
    monkeypatch.chdir(tmp_path)
    with Page() as page:
        yield page


def simulate(page: Page, robot: ad.Robot) -> LiveSimulation:
    options = ad.SimulationOptions(frame_rate=0.0)
    diagram = ad.build_diagram(robot, options=options, meshcat=page.meshcat)
    return LiveSimulation(page, ad.Simulation(diagram), realtime_rate=0.0)


@pytest.mark.slow
def test_what_is_taught_by_sliders_is_done_by_the_physics(
    page: Page, robot: ad.Robot
) -> None:
    viewer = RobotViewer(page, lambda: robot, is_watching=False)
    poses = [[0.5, 0.2, 0.4], [-0.3, 0.6, 0.1]]
    names = [j.name for j in robot.description.movable_joints]
    for pose in poses:
        viewer.set_positions(dict(zip(names, pose, strict=True)))
        viewer.handle([WidgetEvent("teach:add")])
    viewer.handle([WidgetEvent("teach:save"), WidgetEvent("teach:save")])

    assert Path("motion_2.yaml").read_text() == Path("motion.yaml").read_text()
    motion = ad.load_motion("motion.yaml")
    sim = ad.Simulation(ad.build_diagram(robot))
    for k, pose in enumerate(poses, start=1):
        sim.run(2.0 * k - sim.time, motion if k == 1 else None)
        assert sim.joint_states().position == pytest.approx(pose, abs=0.01)
    sim.run(0.5)
    assert sim.goals[0].status.name == "SUCCEEDED"


@pytest.mark.slow
def test_a_motion_taught_while_it_runs_is_played_by_a_click(
    page: Page, robot: ad.Robot
) -> None:
    live = simulate(page, robot)
    live.handle([WidgetEvent("teach:time", 0.5), WidgetEvent("teach:add")])
    live.simulation.run(0.1)
    start = live.simulation.joint_states().position
    goal = [q + 0.3 for q in start]
    point = JointTrajectoryPoint(tuple(goal), time_from_start=Duration(0, 500_000_000))
    trajectory = JointTrajectory(joint_names=tuple(_names(robot)), points=(point,))
    live.simulation.controller(CONTROLLER).send_trajectory(trajectory)
    live.run(1.0)
    live.handle([WidgetEvent("teach:add"), WidgetEvent("teach:play")])
    live.run(0.55)

    # The first way point is where it was at the start.
    assert live.simulation.joint_states().position == pytest.approx(start, abs=0.02)
    live.run(2.0)
    assert live.simulation.joint_states().position == pytest.approx(goal, abs=0.01)


def test_no_joint_is_asked_to_be_faster_than_it_can(robot: ad.Robot) -> None:
    points, names = WayPoints(robot), _names(robot)
    points.add(dict.fromkeys(names, 0.0), 1.0)
    fast = min(
        joint.limits.velocity or 1.0 for joint in robot.description.movable_joints
    )

    at = points.add(dict.fromkeys(names, 10.0), 0.1)

    assert at == pytest.approx(1.0 + 1.5 * 10.0 / fast, abs=1e-3)


def test_a_motion_without_way_points_is_said(page: Page, robot: ad.Robot) -> None:
    viewer = RobotViewer(page, lambda: robot, is_watching=False)
    with pytest.raises(InputError, match="no way points; add one first"):
        viewer.parts[-1].handle("teach:save", None)
    viewer.handle(
        [
            WidgetEvent("teach:add"),
            WidgetEvent("teach:remove"),
            WidgetEvent("teach:save"),
        ]
    )

    assert not list(Path().glob("motion*"))


@pytest.mark.slow
def test_way_points_stay_when_the_robot_is_loaded_again(
    page: Page, robot: ad.Robot
) -> None:
    other = ad.load_robot("mycobot_280")
    loaded = [robot, robot, other]
    viewer = RobotViewer(page, lambda: loaded.pop(0), is_watching=False)
    viewer.handle(
        [
            WidgetEvent("teach:time", 0.5),
            WidgetEvent("teach:add"),
            WidgetEvent("teach:add"),
        ]
    )
    text = viewer.parts[-1].changes()["teach:motion"]["value"]

    assert viewer.reload()
    assert text
    assert viewer.parts[-1].changes()["teach:motion"]["value"] == text
    assert viewer.parts[-1].changes()["teach:time"]["value"] == 0.5
    # Of another robot they would be no motion.
    assert viewer.reload()
    assert not viewer.parts[-1].changes().get("teach:motion", {}).get("value")


def _names(robot: ad.Robot) -> list[str]:
    return [joint.name for joint in robot.description.movable_joints]


class Counter(parts.Part):
    """A part of a panel, as somebody else may write it."""

    def __init__(self, live: parts.Live) -> None:
        self.live, self.clicks = live, 0

    def section(self) -> Section:
        return Section("Clicks", ())

    def changes(self) -> dict[str, dict[str, int]]:
        return {"count:clicks": {"value": self.clicks}}

    def handle(self, event_id: str, value: object) -> bool:
        self.clicks += event_id == "count:up"
        return event_id.startswith("count:")


def test_a_part_is_a_row_of_the_registry(
    page: Page, robot: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [f"{__name__}:Counter", f"{__name__}:_nothing"]
    monkeypatch.setattr(live_simulation, "PARTS", rows)
    live = simulate(page, robot)
    [part] = live.parts
    assert isinstance(part, Counter)
    assert part.live is live
    live.handle([WidgetEvent("count:up"), WidgetEvent("teach:add")])
    live.run(0.1)

    assert part.clicks == 1
    assert page._fields["count:clicks"] == {"value": 1}
    # One without widgets is left out.
    assert "Clicks" not in [section.title for section in make_sections(live)]


def _nothing(live: parts.Live) -> None:
    del live
