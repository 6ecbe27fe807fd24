"""Contents of plots: lines that are the rollout's, limits at their values, units."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from arm_drake.cli import make_parser
from arm_drake.errors import InputError
from arm_drake.output_files import PLOT_KINDS
from arm_drake.rollout.rollout import GoalRecord, Reference, Rollout
from tests.made_rollouts import make_described

DOCS = Path(__file__).parents[2] / "docs"

NUM = 41
TIME = 0.1 * np.arange(NUM)

# A crane on a slide; its hook has limits, and its boom only one of velocity.
DESCRIPTION = """<robot name="crane">
  <link name="base"/><link name="boom"/><link name="hook"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="boom"/>
    <origin xyz="0 0 1"/><axis xyz="0 0 1"/><limit effort="8" velocity="1.2"/></joint>
  <joint name="lower" type="prismatic"><parent link="boom"/><child link="hook"/>
    <origin xyz="2 0 0"/><axis xyz="0 0 -1"/>
    <limit lower="-0.05" upper="0.45" velocity="9" effort="100"/></joint>
  <ros2_control name="h" type="system"><joint name="lower"/></ros2_control>
</robot>"""

# At the limit of 8 N·m in rows 10 to 14 and 30.
EFFORT = np.where((np.arange(NUM) // 5 == 2) | (np.arange(NUM) == 30), -8.0, 3.0)


def make_rollout(**changes) -> Rollout:
    """Return a crane that turns at 1 rad/s, and lowers its hook at 0.1 m/s."""
    wanted = np.stack([TIME, 0.1 * TIME + 0.003], axis=1)
    wanted[0] = np.nan
    values = {
        "velocity": np.tile([1.0, 0.1], (NUM, 1)),
        "effort": np.stack([EFFORT, np.full(NUM, 2.0)], axis=1),
        "effort_limit": np.array([8.0, 100.0]),
        "references": {"arm": Reference(("turn", "lower"), wanted)},
    }
    description = changes.pop("description", DESCRIPTION)
    types = {"turn": "continuous", "lower": "prismatic"}
    position = np.stack([TIME - 0.02, 0.1 * TIME], axis=1)
    return make_described(description, types, position, **(values | changes))


def make_many(num: int) -> Rollout:
    """Return a rollout of many joints with long names, one of which has no end."""
    joints = {f"left_hand_finger_{k}_proximal_joint": "revolute" for k in range(num)}
    position = np.tile(np.sin(TIME)[:, None], (1, num))
    wanted = {"hand": Reference(tuple(joints), position + 0.01)} if num else {}
    return make_described("", joints, position, references=wanted)


def line(panel, label):
    """Return the x and y of the one line with a label."""
    (found,) = (each for each in panel.get_lines() if each.get_label() == label)
    return found.get_data()


def levels(panel, label="limit"):
    """Return where straight lines with a label are: y, or x of vertical ones."""
    return sorted(
        float((y if y[0] == y[1] else x)[0])
        for x, y in (
            each.get_data() for each in panel.get_lines() if each.get_label() == label
        )
    )


def legend(figure):
    (found,) = figure.legends
    return [text.get_text() for text in found.get_texts()]


def notes(panel):
    return [text.get_text() for text in panel.texts]


def titles(figure):
    return [panel.get_title(loc="left") for panel in figure.axes]


def test_tracking_draws_what_was_measured_and_wanted():
    rollout = make_rollout()

    figure = rollout.plot(kind="tracking")

    assert titles(figure) == ["turn [rad]", "lower [m]"]
    assert legend(figure) == ["measured", "reference (arm)"]
    for column, panel in enumerate(figure.axes):
        for label, values in (
            ("measured", rollout.position),
            ("reference (arm)", rollout.references["arm"].position),
        ):
            x, y = line(panel, label)
            np.testing.assert_array_equal(x, rollout.time)
            np.testing.assert_array_equal(y, values[:, column])
    assert figure.axes[-1].get_xlabel() == "time [s]"


def test_two_controllers_of_a_joint_are_told_apart():
    half = {
        name: Reference(
            ("turn",), np.where((TIME < 2.0) == is_first, 1.0, np.nan)[:, None]
        )
        for name, is_first in (("first", True), ("second", False))
    }

    panel = make_rollout(references=half).plot(kind="tracking").axes[0]

    lines = {each.get_label(): each for each in panel.get_lines()}
    first, second = (lines[f"reference ({name})"] for name in ("first", "second"))
    assert not same_color(first.get_color(), second.get_color())
    assert first.get_linestyle() != second.get_linestyle()


def test_a_joint_that_is_told_velocities_shows_velocities():
    command = np.full((NUM, 1), 1.25)
    rollout = make_rollout(
        references={}, command_names=("turn/velocity",), command=command
    )

    tracking, error = (rollout.plot(kind=kind) for kind in ("tracking", "error"))

    assert titles(tracking) == ["turn [rad/s]", "lower [m]"]
    _, wanted = line(tracking.axes[0], "commanded velocity")
    np.testing.assert_array_equal(wanted, command[:, 0])
    _, off = line(error.axes[0], "commanded velocity − measured")
    np.testing.assert_allclose(off, 0.25)
    assert error.get_supxlabel() == "nothing was wanted of lower"


def test_errors_are_in_units_that_they_are_large_in():
    rollout = make_rollout()

    figure = rollout.plot(kind="error")

    assert titles(figure) == ["turn [mrad]", "lower [mm]"]
    for column, panel in enumerate(figure.axes):
        _, y = line(panel, "reference (arm) − measured")
        np.testing.assert_allclose(y, 1e3 * rollout.tracking_error("arm")[:, column])


def test_tolerances_of_goals_are_drawn_where_they_held():
    goal = {
        "path_tolerance": [{"name": "turn", "position": 0.03}],
        "goal_tolerance": [
            {"name": "turn", "position": 0.01},
            {"name": "lower", "position": 0.5},
            {"name": "turn", "position": 0.0},
            {"name": "turn", "position": -1.0},
        ],
    }
    record = GoalRecord(
        "arm", "FollowJointTrajectoryGoal", 0.5, 2.5, "ABORTED", goal=goal
    )

    turn, lower = make_rollout(goals=(record,)).plot(kind="error").axes

    assert levels(turn, "path tolerance") == pytest.approx([-30.0, 30.0])
    for each in turn.get_lines():
        if each.get_label() == "path tolerance":
            assert list(each.get_xdata()) == [0.5, 2.5]
    x, y = line(turn, "goal tolerance")
    assert (list(x), list(y)) == ([2.5, 2.5], pytest.approx([-10.0, 10.0]))
    # 500 mm beside an error of 3 mm are said instead.
    assert notes(lower) == ["goal tolerance ±500 mm"]


def test_efforts_stand_against_their_limits():
    rollout = make_rollout()

    figure = rollout.plot(kind="effort")

    turn, lower = figure.axes
    assert titles(figure) == ["turn [N·m]", "lower [N]"]
    np.testing.assert_array_equal(line(turn, "applied")[1], EFFORT)
    assert levels(turn) == [-8.0, 8.0]
    assert levels(lower) == []
    assert notes(turn) == ["at its limit for 0.6 s"]
    assert notes(lower) == ["at most 2 of 100 N, 2 %"]
    assert legend(figure) == ["applied", "limit", "at the limit"]


def test_the_time_at_the_limit_is_shaded():
    rollout = make_rollout()

    turn, lower = rollout.plot(kind="effort").axes

    (shaded,) = turn.collections
    spans = [path.vertices[:, 0] for path in shaded.get_paths()]
    # A row counts until the next one.
    ends = [(span.min(), span.max()) for span in spans]
    np.testing.assert_allclose(ends, [(1.0, 1.5), (3.0, 3.1)])
    total = sum(end - start for start, end in ends)
    assert total == pytest.approx(rollout.effort_saturation()["turn"])
    assert not lower.collections


def test_a_commanded_effort_and_one_without_a_limit():
    command = np.full((NUM, 1), 5.0)
    rollout = make_rollout(
        command_names=("turn/effort",), command=command, effort_limit=np.full(2, np.inf)
    )

    turn, lower = rollout.plot(kind="effort").axes

    np.testing.assert_array_equal(line(turn, "commanded effort")[1], command[:, 0])
    assert notes(turn) == notes(lower) == ["no limit"]
    assert levels(turn) == []


def test_phases_have_the_limits_of_the_description():
    rollout = make_rollout()

    figure = rollout.plot(kind="phase")

    turn, lower = figure.axes
    assert titles(figure) == ["turn", "lower [m, m/s]"]
    assert figure.get_supxlabel() == "position [rad]"
    assert figure.get_supylabel() == "velocity [rad/s]"
    for column, panel in enumerate((turn, lower)):
        x, y = line(panel, "measured")
        np.testing.assert_array_equal(x, rollout.position[:, column])
        np.testing.assert_array_equal(y, rollout.velocity[:, column])
    assert line(turn, "start") == ([-0.02], [1.0])
    assert line(turn, "end")[0] == [pytest.approx(3.98)]
    # From 0 to 0.4 m both ends of the slide are near, a velocity of 9 m/s isn't.
    assert levels(lower) == [-0.05, 0.45]
    assert notes(lower) == ["limits ±9"]
    assert "limit" in legend(figure)


def test_without_a_description_phases_have_no_limits():
    figure = make_rollout(description="").plot(kind="phase")

    assert all(not levels(panel) and not notes(panel) for panel in figure.axes)


def test_the_path_is_that_of_the_end_effector():
    rollout = make_rollout()

    figure = rollout.plot(kind="path")

    space, *over_time = figure.axes
    angle, drop = rollout.position.T
    wanted = [2.0 * np.cos(angle), 2.0 * np.sin(angle), 1.0 - drop]
    # Sums of a few rounded products of numbers near 1.
    np.testing.assert_allclose(space.get_lines()[0].get_data_3d(), wanted, atol=1e-12)
    for panel, values, name in zip(over_time, wanted, "xyz", strict=True):
        np.testing.assert_allclose(line(panel, "measured")[1], values, atol=1e-12)
        assert panel.get_ylabel() == f"{name} [m]"
    # Where the references would have it: lower by 3 mm.
    _, z = line(over_time[2], "reference")
    np.testing.assert_allclose(z, np.where(TIME == 0.0, np.nan, 0.997 - drop))
    assert space.get_title(loc="left") == "way of hook"
    # A chord of 0.02 rad at 2 m, and 3 mm.
    apart = 1e3 * np.hypot(4.0 * np.sin(0.01), 0.003)
    (title,) = (panel.get_title(loc="right") for panel in over_time[:1])
    assert title == f"at most {apart:.3g} mm from its reference"


def test_a_flat_path_is_seen_from_above_and_to_scale():
    space = make_rollout().plot(kind="path", link="boom").axes[0]
    base = np.zeros((NUM, 7))
    base[:, 0], base[:, 3] = TIME, 1.0
    driven = make_rollout(free_poses={"base": base}).plot(kind="path")

    # The boom turns on the spot.
    assert space.get_title(loc="left") == "way of boom, from above"
    assert driven.axes[0].get_title(loc="left") == "way of base, from above"
    assert driven.axes[0].get_aspect() == 1.0
    np.testing.assert_array_equal(line(driven.axes[0], "measured")[0], TIME)


def test_an_overview_names_the_joints_that_stand_out():
    rollout = make_rollout()

    measured, error, effort, way = rollout.plot(kind="overview").axes

    np.testing.assert_array_equal(line(measured, "turn")[1], rollout.position[:, 0])
    np.testing.assert_allclose(
        line(error, "lower")[1], 1e3 * rollout.tracking_error("arm")[:, 1]
    )
    np.testing.assert_allclose(line(effort, "turn")[1], EFFORT / 0.08)
    assert levels(effort, "limit") == []
    assert error.get_title() == "reference − measured [mrad, mm]"
    assert way.get_title(loc="left") == "way of hook"


def test_an_overview_has_references_beside_what_was_measured():
    rollout = make_rollout()

    panel = rollout.plot(kind="overview").axes[0]

    assert panel.get_title() == "measured and reference [rad, m]"
    for column, joint in enumerate(("turn", "lower")):
        wanted = rollout.references["arm"].position[:, column]
        np.testing.assert_array_equal(line(panel, f"_reference {joint}")[1], wanted)
        colours = {
            each.get_color()
            for each in panel.get_lines()
            if each.get_label() in (joint, f"_reference {joint}")
        }
        assert len(colours) == 1
    texts = [text.get_text() for text in panel.get_legend().get_texts()]
    assert texts == ["turn", "lower", "reference"]
    alone = make_rollout(references={}).plot(kind="overview").axes[0]
    assert alone.get_title() == "measured [rad, m]"
    assert "reference" not in {text.get_text() for text in alone.get_legend().texts}


def test_an_overview_marks_goals_that_failed():
    ends = {"SUCCEEDED": 1.0, "ABORTED": 2.0, "REJECTED": 3.0, "EXECUTING": None}
    goals = tuple(
        GoalRecord("arm", "FollowJointTrajectoryGoal", 0.5, end, status)
        for status, end in ends.items()
    )

    *panels, way = make_rollout(goals=goals).plot(kind="overview").axes

    for panel in panels:
        assert line(panel, "goal aborted")[0] == [2.0]
        assert line(panel, "goal rejected")[0] == [3.0]
        texts = [text.get_text() for text in panel.get_legend().get_texts()]
        assert texts[-2:] == ["goal aborted", "goal rejected"]
    assert not any("goal" in each.get_label() for each in way.get_lines())


def test_the_legends_of_an_overview_cover_nothing():
    figure = make_rollout().plot(kind="overview")
    figure.draw_without_rendering()

    for panel in figure.axes[:3]:
        legend_box = panel.get_legend().get_window_extent()
        assert not any(legend_box.overlaps(other.bbox) for other in figure.axes)


def test_a_joint_looks_the_same_in_all_panels_of_an_overview():
    num = 12
    joints = {f"j{k}": "revolute" for k in range(num)}
    sizes = np.arange(1.0, num + 1.0)
    position = np.sin(TIME)[:, None] * sizes
    # The joints that move least are off most.
    wanted = {"arm": Reference(tuple(joints), position + sizes[::-1])}
    rollout = make_described("", joints, position, references=wanted)

    measured, error = (
        {each.get_label(): each for each in panel.get_lines() if len(each.get_xdata())}
        for panel in rollout.plot(kind="overview").axes[:2]
    )

    assert list(measured)[-5:] == ["j11", "j10", "j9", "j8", "j7"]
    assert list(error)[-5:] == ["j0", "j1", "j2", "j3", "j4"]
    looks = {
        (each.get_color(), each.get_linestyle())
        for each in [*list(measured.values())[-5:], *list(error.values())[-5:]]
    }
    assert len(looks) == 10
    one = make_rollout().plot(kind="overview").axes[:3]
    for joint in ("turn", "lower"):
        (colour,) = {
            each.get_color()
            for panel in one
            for each in panel.get_lines()
            if each.get_label() == joint
        }
        assert colour


def test_an_overview_of_a_table_says_what_it_lacks():
    figure = make_rollout(description="").plot(kind="overview")

    assert len(figure.axes) == 3
    assert figure.get_supxlabel().startswith("no way of the end effector: the rollout ")


@pytest.mark.slow
def test_chosen_joints_come_in_the_order_asked_for():
    for kind in ("tracking", "error", "effort", "phase"):
        figure = make_rollout().plot(kind=kind, joints=["lower", "turn"])
        assert [title.split()[0] for title in titles(figure)] == ["lower", "turn"]
        assert len(make_rollout().plot(kind=kind, joints=["lower"]).axes) == 1


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLOT_KINDS)
@pytest.mark.parametrize("num_rows", [0, 1, 2])
def test_a_few_rows_are_drawn_as_they_are(tmp_path, kind, num_rows):
    whole = make_rollout()
    rows = {
        name: getattr(whole, name)[:num_rows]
        for name in ("time", "position", "velocity", "effort")
    }
    wanted = whole.references["arm"].position[1 : num_rows + 1]
    references = {"arm": Reference(("turn", "lower"), wanted)}

    figure = Rollout(**(vars(whole) | rows | {"references": references})).plot(
        tmp_path / "a.png", kind
    )

    texts = [text.get_text() for text in figure.texts]
    assert ("no rows were recorded" in texts) == (num_rows == 0)
    if num_rows == 1 and kind != "path":
        # A line through one point would not be seen.
        markers = {each.get_marker() for each in figure.axes[0].get_lines()}
        assert markers & {"o", "s"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "num"),
    [
        *(("tracking", num) for num in (0, 1, 7, 30)),
        *(("error", num) for num in (0, 12)),
        *(("effort", num) for num in (0, 6)),
        *(("phase", num) for num in (0, 2, 12, 43)),
        *(("overview", num) for num in (0, 12)),
    ],
)
def test_every_joint_has_a_panel_and_none_covers_another(kind, num):
    figure = make_many(num).plot(kind=kind)
    figure.draw_without_rendering()

    panels = [panel for panel in figure.axes if panel.get_visible()]
    if kind == "overview":
        assert len(panels) == 3
        return
    assert len(panels) == num
    boxes = [panel.get_window_extent() for panel in panels]
    heads = [panel._left_title.get_window_extent() for panel in panels]
    # Neither panels nor their titles, and all on the page.
    page = figure.bbox
    for index, (box, head) in enumerate(zip(boxes, heads, strict=True)):
        assert min(box.height, box.width / 2.0) > 40  # pixels
        assert head.x1 <= page.x1
        assert head.y1 <= page.y1
        assert not any(head.overlaps(other) for other in boxes)
        assert not any(head.overlaps(other) for other in heads[:index])
    if num == 0:
        assert [text.get_text() for text in figure.texts][-1] == "nothing to show"


def test_peaks_of_long_runs_are_seen_in_few_points():
    num = 1_000_000
    time, position = 1e-3 * np.arange(num), np.zeros((num, 1))
    position[456_789], position[777_777] = 2.0, -3.0
    rollout = make_described("", {"j": "revolute"}, position, time=time)

    x, y = line(rollout.plot(kind="tracking").axes[0], "measured")

    assert len(x) < 50_000
    assert (x[y.argmax()], y.max()) == (456.789, 2.0)
    assert (x[y.argmin()], y.min()) == (777.777, -3.0)
    assert (x[0], x[-1]) == (0.0, time[-1])
    assert np.all(np.diff(x) > 0.0)


@pytest.mark.slow
def test_a_notebook_shows_a_figure_and_no_file_is_needed():
    figure = make_rollout().plot()

    shown, _ = DisplayFormatter().format(figure)

    assert isinstance(figure, Figure)
    assert shown["image/png"].startswith(b"\x89PNG")


@pytest.mark.slow
def test_plots_leave_pyplot_alone():
    code = (
        "import sys; from tests.visualization.test_plots import make_rollout\n"
        "before = 'matplotlib.pyplot' in sys.modules\n"
        "make_rollout().plot(kind='path'); make_rollout().plot(kind='overview')\n"
        "print(before, 'matplotlib.pyplot' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    assert done.stdout == "False False\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"kind": "fase"},
            "unknown kind 'fase' of a plot; did you mean 'phase'? known: effort, "
            "error, overview, path, phase, tracking",
        ),
        (
            {"joints": ["turm"]},
            "no joint 'turm' in the rollout; did you mean 'turn'? known: lower, turn",
        ),
        (
            {"kind": "tracking", "link": "hook"},
            "a tracking plot has no link; it is for path and overview",
        ),
        (
            {"kind": "overview", "link": "hok"},
            "no link 'hok' in the description; did you mean 'hook'? known: base, boom, "
            "hook",
        ),
    ],
)
def test_what_does_not_exist_is_said(options, message):
    with pytest.raises(InputError) as error:
        make_rollout().plot(**options)

    assert str(error.value) == message


@pytest.mark.slow
def test_the_kinds_of_the_command_line_are_those_that_are_drawn(tmp_path):
    for kind in PLOT_KINDS:
        options = make_parser().parse_args(
            ["sim", "r", "--plot", "a.png", "--plot-kind", kind]
        )
        assert isinstance(make_rollout().plot(kind=options.plot_kind), Figure)


@pytest.mark.slow
def test_the_docs_have_every_kind_and_their_program_runs(tmp_path, monkeypatch):
    text = (DOCS / "plots.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)

    exec(compile(program, "plots.md", "exec"), {})  # noqa: S102  our own page.

    assert tuple(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) == PLOT_KINDS
    assert "--plot-kind effort" in text
    assert {path.name for path in tmp_path.iterdir()} == {"run.svg", "way.png"}
    assert (DOCS / "plots.png").stat().st_size < 200_000
