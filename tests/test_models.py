"""The bundled robots are the published ones: same kinematics, dynamics and limits."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
import xacro
import xacro.substitution_args
import yaml
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JointIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from tests.robots import real_robot

REPO = Path(__file__).resolve().parents[1]
MODELS = REPO / "models"
CONFIGS = REPO / "configs"

A0912 = MODELS / "doosan_a0912"
A0912_CONFIG = CONFIGS / "doosan_a0912"
A0912_JOINTS = [f"joint{i}" for i in range(1, 7)]
A0912_LINKS = ["base_0"] + [f"link{i}" for i in range(1, 7)]

# Corners of the box around each link's published meshes [m].
A0912_BOXES = {
    "base_0": ((-0.091, -0.1105, 0.0), (0.091, 0.091, 0.114)),
    "link1": ((-0.0804, -0.0795, -0.08), (0.0804, 0.0995, 0.1375)),
    "link2": ((-0.0795, -0.0804, 0.0615), (0.6207, 0.0804, 0.279)),
    "link3": ((-0.0587, -0.0587, -0.05), (0.0587, 0.0984, 0.0795)),
    "link4": ((-0.0504, -0.0452, -0.4573), (0.0504, 0.2191, 0.0503)),
    "link5": ((-0.0504, -0.058, -0.0502), (0.0504, 0.0979, 0.063)),
    "link6": ((-0.0433, -0.0432, -0.065), (0.0433, 0.0433, 0.0)),
}

# Configuration [rad], origin of link6 in the world [m], of the published URDF in Drake.
A0912_GOLDEN = [
    ([0, 0, 0, 0, 0, 0], [0.00013, 0.03924, 1.39500]),
    ([0, 0, 0.52, 0, 0, 0], [0.31812, 0.03916, 1.31034]),
    ([0, 0, -0.17, 0, 0, 0], [-0.10815, 0.03926, 1.38580]),
    ([0, 0, -0.52, 0, 0, 0], [-0.31789, 0.03929, 1.31047]),
    ([0, 0, 0.17, 0, 0, 0], [0.10841, 0.03922, 1.38575]),
    ([0.1, 0, 1.5, 1.5, 1.0, 0.4], [0.56492, 0.20047, 0.78875]),
    ([-0.5, -0.5, -0.5, 0.5, 0.5, -0.5], [-0.63969, 0.42676, 1.06803]),
    ([0, np.pi / 2, 0, 0, 0, 0], [1.20000, 0.03876, 0.19487]),
]

Expand = Callable[..., str]


@pytest.fixture
def expand(monkeypatch: pytest.MonkeyPatch) -> Expand:
    """Return a function: xacro file, packages by name, arguments -> URDF text."""

    def expand_file(file: Path, packages: dict[str, Path], **args: str) -> str:
        def find(name: str) -> str:
            return str(packages[name])

        monkeypatch.setattr(xacro.substitution_args, "_eval_find", find)
        return str(xacro.process_file(str(file), mappings=args).toxml())

    return expand_file


@pytest.fixture
def a0912(expand: Expand) -> str:
    return expand_a0912(expand)


@pytest.fixture
def published_a0912(expand: Expand) -> str:
    file = real_robot("doosan_a0912/my_doosan_pkg/description/xacro/a0912.urdf.xacro")
    return expand(file, {"my_doosan_pkg": file.parents[2]})


def expand_a0912(expand: Expand, **args: str) -> str:
    file = A0912 / "urdf" / "doosan_a0912.urdf.xacro"
    return expand(file, {"doosan_a0912": A0912}, **args)


def configurations(model: pinocchio.Model) -> np.ndarray:
    rng = np.random.default_rng(912)
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    return rng.uniform(lower, upper, size=(20, model.nq))


def link_pose(model: pinocchio.Model, q: np.ndarray, link: str) -> np.ndarray:
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    return np.array(data.oMf[model.getFrameId(link)].homogeneous)


def mass_matrix(model: pinocchio.Model, q: np.ndarray) -> np.ndarray:
    upper = np.triu(pinocchio.crba(model, model.createData(), q))
    return np.asarray(upper + np.triu(upper, 1).T)


def gravity_effort(model: pinocchio.Model, q: np.ndarray) -> np.ndarray:
    effort = pinocchio.computeGeneralizedGravity(model, model.createData(), q)
    return np.asarray(effort)


def joint_figures(urdf: str) -> dict[str, dict[str, float]]:
    return {
        joint.attrib["name"]: {
            key: float(value)
            for tag in ("limit", "dynamics")
            for element in joint.iter(tag)
            for key, value in element.attrib.items()
        }
        for joint in parse(urdf).findall("joint")
    }


def collisions(urdf: str, link: str) -> list[tuple[str, list[float], list[float]]]:
    """Shape, its dimensions by attribute name, then xyz and rpy of its origin."""
    found = []
    for element in parse(urdf).iterfind(f"link[@name='{link}']/collision"):
        (shape,) = element.find("geometry")
        sizes = [float(value) for _, value in sorted(shape.attrib.items())]
        found.append((shape.tag, sizes, [*numbers(element, "xyz", "rpy")]))
    return found


def numbers(element: ElementTree.Element, *names: str) -> np.ndarray:
    """Numbers of the element's origin; zero where it says nothing."""
    origin = element.find("origin")
    said = {} if origin is None else origin.attrib
    text = " ".join(said.get(name, "0 0 0") for name in names)
    return np.array([float(word) for word in text.split()])


def extent(visual: ElementTree.Element) -> np.ndarray:
    """Lower and upper corner of the box around a shape, in the link's axes."""
    (shape,) = visual.find("geometry")
    sizes = {
        key: np.array([float(word) for word in value.split()])
        for key, value in shape.attrib.items()
    }
    R = pinocchio.rpy.rpyToMatrix(numbers(visual, "rpy"))
    if shape.tag == "box":
        half = np.abs(R) @ sizes["size"] / 2
    elif shape.tag == "sphere":
        half = np.full(3, sizes["radius"].item())
    else:
        axis = np.abs(R[:, 2])
        across = np.sqrt(np.clip(1 - axis**2, 0, None))
        half = sizes["length"] / 2 * axis + sizes["radius"] * across
    center = numbers(visual, "xyz")
    return np.array([center - half, center + half])


def parse(urdf: str) -> ElementTree.Element:
    return ElementTree.fromstring(urdf)  # noqa: S314  # Our own, or one we chose.


def load_yaml(file: Path) -> Any:
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def motion(name: str) -> Any:
    (step,) = load_yaml(A0912_CONFIG / "motions" / f"{name}.yaml")
    return step


def make_drake_diagram(urdf: str) -> tuple[Diagram, MultibodyPlant]:
    """The diagram has to live as long as the plant in it is used."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    Parser(plant).AddModelsFromString(urdf, "urdf")
    plant.Finalize()
    return builder.Build(), plant


def test_every_model_file_is_small() -> None:
    sizes = {file: file.stat().st_size for file in MODELS.rglob("*") if file.is_file()}

    assert sizes
    assert not {file: size for file, size in sizes.items() if size >= 1_000_000}


def test_a0912_poses_its_flange_like_the_published_arm(
    a0912: str, published_a0912: str
) -> None:
    ours = pinocchio.buildModelFromXML(a0912)
    published = pinocchio.buildModelFromXML(published_a0912)

    assert list(ours.names) == list(published.names)
    for q in configurations(published):
        np.testing.assert_allclose(
            link_pose(ours, q, "link6"), link_pose(published, q, "link6"), atol=1e-12
        )


def test_a0912_weighs_and_sags_like_the_published_arm(
    a0912: str, published_a0912: str
) -> None:
    ours = pinocchio.buildModelFromXML(a0912)
    published = pinocchio.buildModelFromXML(published_a0912)

    for q in configurations(published):
        np.testing.assert_allclose(
            mass_matrix(ours, q), mass_matrix(published, q), atol=1e-12
        )
        np.testing.assert_allclose(
            gravity_effort(ours, q), gravity_effort(published, q), atol=1e-10
        )


def test_a0912_has_the_published_limits_damping_and_friction(
    a0912: str, published_a0912: str
) -> None:
    ours = joint_figures(a0912)

    assert sorted(ours) == [*A0912_JOINTS, "world_fixed"]
    assert set(ours["joint1"]) == {
        *("lower", "upper", "effort", "velocity"),
        *("damping", "friction"),
    }
    assert ours == joint_figures(published_a0912)


@pytest.mark.parametrize("link", ["link1", "link2", "link3", "link4", "link5"])
def test_a0912_keeps_the_published_collisions(
    a0912: str, published_a0912: str, link: str
) -> None:
    assert collisions(a0912, link) == collisions(published_a0912, link)


@pytest.mark.parametrize(("q", "origin"), A0912_GOLDEN)
def test_a0912_flange_is_where_drake_found_the_published_one(
    a0912: str, q: list[float], origin: list[float]
) -> None:
    model = pinocchio.buildModelFromXML(a0912)

    X_WF = link_pose(model, np.array(q, dtype=float), "link6")

    # The figures have five decimals.
    np.testing.assert_allclose(X_WF[:3, 3], origin, atol=6e-6)


def test_a0912_weighs_31_562_kg(a0912: str) -> None:
    masses = [float(mass.attrib["value"]) for mass in parse(a0912).iter("mass")]

    assert sum(masses) == pytest.approx(31.562, abs=1e-9)


def test_a0912_inertias_are_those_of_real_bodies(a0912: str) -> None:
    root = parse(a0912)

    inertias = list(root.iter("inertia"))

    assert len(inertias) == len(A0912_LINKS)
    for inertia in inertias:
        value = {key: float(text) for key, text in inertia.attrib.items()}
        xx, yy, zz = value["ixx"], value["iyy"], value["izz"]
        xy, xz, yz = value["ixy"], value["ixz"], value["iyz"]
        smallest, middle, largest = np.linalg.eigvalsh(
            [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        )
        assert smallest > 0
        # Of a sum over points of mass, two moments are never less than the third.
        assert smallest + middle >= largest


def test_a0912_loads_in_drake_with_six_movable_joints(a0912: str) -> None:
    _diagram, plant = make_drake_diagram(a0912)

    joints = [plant.get_joint(JointIndex(i)) for i in range(plant.num_joints())]
    bodies = [plant.get_body(BodyIndex(i)) for i in range(1, plant.num_bodies())]

    movable = [joint.name() for joint in joints if joint.num_positions()]
    assert movable == A0912_JOINTS
    assert plant.num_positions() == 6
    assert {body.name() for body in bodies} >= set(A0912_LINKS)
    assert all(body.default_spatial_inertia().IsPhysicallyValid() for body in bodies)


def test_a0912_collides_with_all_links_but_the_published_exception(a0912: str) -> None:
    _diagram, plant = make_drake_diagram(a0912)

    bare = [
        link
        for link in A0912_LINKS
        if not plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link))
    ]

    assert bare == ["link3"]


@pytest.mark.parametrize("link", A0912_LINKS)
def test_a0912_shapes_fill_the_box_of_the_published_meshes(
    a0912: str, link: str
) -> None:
    root = parse(a0912)

    extents = np.array(
        [extent(v) for v in root.iterfind(f"link[@name='{link}']/visual")]
    )

    found = [extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)]
    np.testing.assert_allclose(found, A0912_BOXES[link], atol=0.01)


@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_a0912_names_each_shape_of_a_link_once(a0912: str, tag: str) -> None:
    for link in parse(a0912).iterfind("link"):
        names = [shape.get("name") for shape in link.iterfind(tag)]

        assert all(names)
        assert len(set(names)) == len(names)


def test_a0912_can_be_white(expand: Expand) -> None:
    white = expand_a0912(expand, color="white")

    color = parse(white).find("material[@name='body']/color")
    red, green, blue, alpha = (float(word) for word in color.attrib["rgba"].split())
    assert min(red, green, blue) > 0.85
    assert alpha == 1


def test_a0912_refuses_a_paint_it_does_not_have(expand: Expand) -> None:
    with pytest.raises(
        xacro.XacroException, match="color: expected blue or white, got 'pink'"
    ):
        expand_a0912(expand, color="pink")


def test_a0912_expands_without_a_word(
    expand: Expand, capsys: pytest.CaptureFixture[str]
) -> None:
    expand_a0912(expand)

    assert capsys.readouterr().err == ""


def test_a0912_interfaces_have_the_ranges_of_the_joints(a0912: str) -> None:
    control = parse(a0912).find("ros2_control")
    figures = joint_figures(a0912)

    joints = control.findall("joint")

    assert [joint.attrib["name"] for joint in joints] == A0912_JOINTS
    for joint in joints:
        (command,) = joint.findall("command_interface")
        states = [state.attrib["name"] for state in joint.findall("state_interface")]
        limits = {p.attrib["name"]: float(p.text) for p in command.findall("param")}
        figure = figures[joint.attrib["name"]]
        assert command.attrib["name"] == "position"
        assert states == ["position", "velocity", "effort"]
        assert limits == {"min": figure["lower"], "max": figure["upper"]}


def test_a0912_names_its_controllers_file(a0912: str) -> None:
    root = parse(a0912)

    named = root.findtext("gazebo/plugin/parameters")

    assert Path(named).resolve() == A0912_CONFIG / "controllers.yaml"
    configured = load_yaml(Path(named))
    parameters = configured["joint_trajectory_controller"]["ros__parameters"]
    assert parameters["joints"] == A0912_JOINTS


def test_a0912_controllers_file_can_be_another(expand: Expand) -> None:
    urdf = expand_a0912(expand, controllers="other.yaml")

    root = parse(urdf)
    assert root.findtext("gazebo/plugin/parameters") == "other.yaml"


@pytest.mark.parametrize(
    ("name", "kind"),
    [("tutorial", "goal"), ("waypoints", "goal"), ("topic", "trajectory")],
)
def test_a0912_motions_stay_within_what_the_joints_can_do(
    a0912: str, name: str, kind: str
) -> None:
    figures = joint_figures(a0912)
    lower = [figures[joint]["lower"] for joint in A0912_JOINTS]
    upper = [figures[joint]["upper"] for joint in A0912_JOINTS]
    velocity = [figures[joint]["velocity"] for joint in A0912_JOINTS]

    trajectory = motion(name)[kind]

    assert trajectory["joint_names"] == A0912_JOINTS
    start = {"positions": [0.0] * 6, "time_from_start": 0.0}
    for before, after in itertools.pairwise([start, *trajectory["points"]]):
        duration = after["time_from_start"] - before["time_from_start"]
        step = np.subtract(after["positions"], before["positions"])
        assert duration > 0
        assert np.all(np.abs(step) / duration <= velocity)
        assert np.all(np.less_equal(lower, after["positions"]))
        assert np.all(np.less_equal(after["positions"], upper))


def test_a0912_tutorial_ends_in_the_pose_of_the_screenshot() -> None:
    goal = motion("tutorial")["goal"]

    times = [point["time_from_start"] for point in goal["points"]]
    assert times == [2.0, 4.0]
    assert goal["points"][-1]["positions"] == [0.1, 0.0, 1.5, 1.5, 1.0, 0.4]
    assert goal["goal_time_tolerance"] == 1.0
    assert [t["name"] for t in goal["goal_tolerance"]] == A0912_JOINTS
    assert {t["position"] for t in goal["goal_tolerance"]} == {0.005}


def test_a0912_waypoints_swing_the_elbow_only() -> None:
    points = motion("waypoints")["goal"]["points"]

    positions = np.array([point["positions"] for point in points])
    assert [point["time_from_start"] for point in points] == [2, 4, 6, 8, 10]
    np.testing.assert_array_equal(positions[:, 2], [0, 0.52, -0.17, -0.52, 0.17])
    np.testing.assert_array_equal(np.delete(positions, 2, axis=1), 0)


def test_a0912_topic_repeats_one_pose_each_second() -> None:
    step = motion("topic")

    assert step["every"] == 1.0
    (point,) = step["trajectory"]["points"]
    assert point["positions"] == [-0.5, -0.5, -0.5, 0.5, 0.5, -0.5]
    assert point["time_from_start"] == 2.0
