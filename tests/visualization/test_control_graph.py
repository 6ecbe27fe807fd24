"""Every controller, interface and topic is in the graph, in all of its forms."""

import re
import xml.etree.ElementTree as ET

import pydot
import pytest
from PIL import Image

from arm_drake.commands.graph import save_graph
from arm_drake.errors import OutputError
from arm_drake.visualization.control_graph import (
    ControlGraph,
    ControllerNode,
    HardwareNode,
    make_dot,
)

LONG = "the_very_long_name_of_a_joint_in_the_left_arm_of_a_robot_with_two_arms"

GRAPH = ControlGraph(
    robot='robot "one" $x_1$',
    controllers=(
        ControllerNode(
            "arm_controller",
            "joint_trajectory_controller/JointTrajectoryController",
            "active",
            inputs=("joint_trajectory",),
            outputs=("controller_state", "events"),
            reads=("elbow/position", f"{LONG}/position"),
            commands=("elbow/position",),
        ),
        ControllerNode("gripper", "unknown/Type", "unconfigured"),
    ),
    hardware=(
        HardwareNode(
            "arm",
            ("system: some/Plugin",),
            states=("elbow/position", f"{LONG}/position"),
            commands=("elbow/position", "elbow/effort"),
        ),
        HardwareNode("sensor", states=("wrist/force.x",)),
    ),
    notes=("finger: no interface",),
)


def texts(file) -> list[str]:
    """Return the texts of an SVG picture."""
    tag = "{http://www.w3.org/2000/svg}text"
    return [element.text for element in ET.parse(file).iter(tag)]  # noqa: S314  our own.


@pytest.mark.slow
def test_an_svg_has_every_name_as_text(tmp_path):
    file = tmp_path / "graph.svg"

    save_graph(GRAPH, file)

    assert sorted(texts(file)) == sorted(
        [
            'robot "one" $x_1$', "state interfaces", "controllers",
            "command interfaces", "arm", "elbow/position", f"{LONG}/position",
            "sensor", "wrist/force.x", "arm_controller", "active",
            "joint_trajectory_controller/JointTrajectoryController",
            "→ joint_trajectory", "controller_state →", "events →", "gripper",
            "unconfigured", "unknown/Type", "arm", "elbow/position", "elbow/effort",
            "arm", "system: some/Plugin", "sensor", "finger: no interface",
            "grey: no active controller uses it",
        ]
    )  # fmt: skip


@pytest.mark.slow
def test_the_same_graph_gives_the_same_svg(tmp_path):
    one, other = tmp_path / "one.svg", tmp_path / "other.svg"

    save_graph(GRAPH, one)
    save_graph(GRAPH, other)

    assert one.read_bytes() == other.read_bytes()


@pytest.mark.slow
def test_names_in_a_picture_do_not_overlap_and_none_is_cut_off(tmp_path):
    from arm_drake.visualization.graph_picture import draw_graph

    figure = draw_graph(GRAPH).figure

    (axes,) = figure.axes
    renderer = figure.canvas.get_renderer()
    extents = [text.get_window_extent(renderer) for text in axes.texts]
    width, height = figure.canvas.get_width_height()
    for number, one in enumerate(extents):
        assert one.x0 >= 0.0
        assert one.y0 >= 0.0
        assert one.x1 <= width
        assert one.y1 <= height
        assert not one.count_overlaps(extents[:number]), axes.texts[number]


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_a_picture_is_of_the_type_that_its_suffix_says(tmp_path, suffix, magic):
    file = tmp_path / f"graph{suffix}"

    save_graph(GRAPH, file)

    assert file.read_bytes().startswith(magic)


@pytest.mark.slow
def test_a_png_is_no_blank_page(tmp_path):
    file = tmp_path / "graph.png"

    save_graph(GRAPH, file)

    with Image.open(file) as image:
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 24)}
        # The active controller's, and the idle one's.
        assert {(0x1F, 0x77, 0xB4), (0x88, 0x88, 0x88)} <= colours


@pytest.mark.slow
def test_dot_text_connects_what_belongs_together():
    (graph,) = pydot.graph_from_dot_data(make_dot(GRAPH))

    edges = {
        tuple(
            re.sub('"', "", end) for end in (edge.get_source(), edge.get_destination())
        )
        for edge in graph.get_edges()
    }

    assert edges == {
        ("hardware arm", "state elbow/position"),
        ("hardware arm", f"state {LONG}/position"),
        ("hardware sensor", "state wrist/force.x"),
        ("command elbow/position", "hardware arm"),
        ("command elbow/effort", "hardware arm"),
        ("in arm_controller.joint_trajectory", "controller arm_controller"),
        ("controller arm_controller", "out arm_controller.controller_state"),
        ("controller arm_controller", "out arm_controller.events"),
        ("state elbow/position", "controller arm_controller"),
        (f"state {LONG}/position", "controller arm_controller"),
        ("controller arm_controller", "command elbow/position"),
    }


def test_dot_text_names_types_and_states():
    (graph,) = pydot.graph_from_dot_data(make_dot(GRAPH))

    labels = {
        node.get_name(): node.get("label")
        for node in graph.get_nodes()
        if "controller " in node.get_name()
    }

    assert labels['"controller gripper"'] == '"gripper: unconfigured\\nunknown/Type"'
    assert labels['"controller arm_controller"'] == (
        '"arm_controller: active\\njoint_trajectory_controller/'
        'JointTrajectoryController"'
    )


def test_dot_text_quotes_what_would_end_a_name():
    assert make_dot(GRAPH).startswith('digraph "robot \\"one\\" $x_1$" {\n')


def test_an_unknown_suffix_is_refused(tmp_path):
    file = tmp_path / "graph.jpg"

    with pytest.raises(OutputError) as caught:
        save_graph(GRAPH, file)

    assert str(caught.value) == (
        f"{file}: unknown type '.jpg' of a graph; expected one of .svg, .png, "
        ".pdf, .dot"
    )
