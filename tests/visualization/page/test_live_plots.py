"""Live plots: samples are what topics say, bounded, and none without a curve."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import (
    JointState,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    Odometry,
)
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page import live_plots as module
from arm_drake.visualization.page.live_plots import (
    PERIOD,
    LivePlots,
    find_number,
    list_numbers,
)
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.page import join
from arm_drake.visualization.page.parts import find_part

REFERENCE = "/joint_trajectory_controller/controller_state/reference/positions[joint3]"
JOINT = "joint_states/position[joint3]"
OPTIONS = ad.SimulationOptions(frame_rate=0.0)


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("doosan_a0912")


@pytest.fixture
def live(robot: ad.Robot) -> Iterator[LiveSimulation]:
    with Page() as page:
        diagram = ad.build_diagram(robot, options=OPTIONS, meshcat=page.meshcat)
        yield LiveSimulation(
            page, Simulation(diagram), motion="tutorial", realtime_rate=0.0
        )


def plots_of(live: LiveSimulation) -> LivePlots:
    return find_part(live.parts, LivePlots)


def test_numbers_are_found_by_the_names_of_joints() -> None:
    state = JointTrajectoryControllerState(
        joint_names=("a", "b/c"), error=JointTrajectoryPoint((0.1, 0.2))
    )

    assert find_number(state, "error/positions[b/c]") == 0.2
    assert find_number(state, "error/positions[0]") == 0.1
    assert find_number(state, "error/positions[d]") is None
    assert (
        find_number(JointState(name=("a",), position=(math.nan,)), "position[a]")
        is None
    )


def test_every_number_that_is_listed_is_found() -> None:
    messages = [
        JointState(name=("a", "b"), position=(1.0, 2.0), effort=(3.0, 4.0)),
        Odometry(),
        JointTrajectoryControllerState(joint_names=("a",)),
    ]

    for message in messages:
        paths = list_numbers(message)
        assert paths
        assert None not in [find_number(message, path) for path in paths]
    assert "twist/twist/linear/x" in list_numbers(Odometry())


@pytest.mark.slow
def test_samples_are_what_a_rollout_says(live: LiveSimulation, robot: ad.Robot) -> None:
    plots = plots_of(live)
    plots.add(JOINT)

    live.run(3.0)

    times, values = np.array(plots.rows).T
    assert np.diff(times) == pytest.approx(PERIOD)
    rollout = live.simulation.rollout()
    column = rollout.joint_names.index("joint3")
    # A row of a rollout is the state after a tick's read.
    expected = np.interp(times, rollout.time, rollout.position[:, column])
    assert values == pytest.approx(expected, abs=2e-3)
    assert np.ptp(values) > 0.1


@pytest.mark.slow
def test_sampling_leaves_the_simulation_as_it_is(
    live: LiveSimulation, robot: ad.Robot
) -> None:
    for name in (JOINT, REFERENCE):
        plots_of(live).add(name)
    live.run(0.3)

    alone = Simulation(ad.build_diagram(robot, options=OPTIONS))
    alone.run(0.3, "tutorial")

    assert np.array_equal(live.simulation.rollout().position, alone.rollout().position)


@pytest.mark.slow
def test_without_a_curve_nothing_is_due_and_nothing_is_read(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    plots, reads = plots_of(live), []
    monkeypatch.setattr(module, "find_number", lambda *args: reads.append(args))
    plots.add(JOINT)
    live.run(0.1)
    read = len(reads)
    plots.close()

    assert plots.advance() == math.inf
    live.run(0.1)
    assert plots.rows == []
    assert len(reads) == read > 0


@pytest.mark.slow
def test_a_curve_that_comes_later_has_no_past(live: LiveSimulation) -> None:
    plots = plots_of(live)
    plots.add(JOINT)
    live.run(0.1)
    plots.add(REFERENCE)
    live.run(0.1)

    rows = plots.rows
    assert rows[0][2] is None
    assert rows[-1][2] is not None
    plots.remove(JOINT)
    assert [row[1] for row in plots.rows] == [row[2] for row in rows]


@pytest.mark.slow
def test_memory_is_bounded(
    live: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CAPACITY", 10)
    plots = LivePlots(live)
    plots.add(JOINT)
    live.parts.append(plots)

    live.run(0.5)

    assert len(plots.rows) == 10
    assert plots.rows[-1][0] == pytest.approx(0.5, abs=1.01 * PERIOD)


@pytest.mark.slow
def test_a_reset_begins_anew(live: LiveSimulation) -> None:
    plots = plots_of(live)
    plots.add(JOINT)
    live.run(0.2)
    live.reset()
    live.run(0.1)

    times = [row[0] for row in plots.rows]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(0.1, abs=1.01 * PERIOD)


@pytest.mark.slow
def test_a_curve_is_chosen_on_the_panel(live: LiveSimulation) -> None:
    live.handle([WidgetEvent("plot:topic", "joint_states")])
    live.handle([WidgetEvent("plot:number", "position[joint3]")])

    assert plots_of(live).curves == (JOINT,)
    live.handle([WidgetEvent("plot:remove", JOINT)])
    assert plots_of(live).curves == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "joint_states/position[joint33]",
            "plot 'joint_states/position[joint33]': no number 'position[joint33]'; "
            "did you mean 'position[joint3]'?",
        ),
        (
            "joint_stats",
            "plot 'joint_stats': expected <topic>/<field>; "
            "did you mean 'joint_states'?",
        ),
    ],
)
def test_an_unknown_number_is_said(
    live: LiveSimulation, name: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        plots_of(live).add(name)

    assert str(caught.value).startswith(message)


def test_samples_add_up_until_the_plot_begins_anew() -> None:
    messages: dict = {}
    join(messages, {"type": "plot", "curves": ["a"], "rows": [[0.0, 1.0]]})
    join(messages, {"type": "samples", "rows": [[1.0, 1.0]]})
    join(messages, {"type": "samples", "rows": [[2.0, 1.0]]})

    assert messages["samples"]["rows"] == [[1.0, 1.0], [2.0, 1.0]]
    join(messages, {"type": "plot", "curves": ["a"], "rows": []})
    assert "samples" not in messages
