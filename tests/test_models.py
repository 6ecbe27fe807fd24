"""The bundled robots are the published ones: same kinematics, dynamics and limits."""

import itertools
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname
from xml.etree import ElementTree

import collada
import numpy as np
import pinocchio
import pytest
import trimesh
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
    """Lower and upper corner of the box around a mesh, in the link's axes."""
    (shape,) = visual.find("geometry")
    path = url2pathname(urlsplit(shape.attrib["filename"]).path)
    mesh = trimesh.load(path, force="mesh")
    assert shape.attrib["scale"] == "1 1 1"
    assert not numbers(visual, "xyz", "rpy").any()
    return np.asarray(mesh.bounds)


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("color", "body"), [("blue", (0.138, 0.188, 0.238)), ("white", (0.8, 0.81, 0.82))]
)
def test_a0912_is_painted_by_its_argument(
    expand: Expand, color: str, body: tuple[float, float, float]
) -> None:
    root = parse(expand_a0912(expand, color=color))

    for link in ("link1", "link2", "link3", "link4", "link5"):
        (mesh,) = root.iterfind(f"link[@name='{link}']/visual/geometry/mesh")
        path = url2pathname(urlsplit(mesh.attrib["filename"]).path)
        document = collada.Collada(path)
        (paint,) = [m for m in document.materials if m.name == "body"]
        assert paint.effect.diffuse == pytest.approx((*body, 1.0))
        assert document.assetInfo.unitmeter == 1.0


def test_a0912_refuses_a_paint_it_does_not_have(expand: Expand) -> None:
    with pytest.raises(
        xacro.XacroException, match="color: expected blue or white, got 'pink'"
    ):
        expand_a0912(expand, color="pink")


def test_a0912_refuses_a_gripper_it_does_not_have(expand: Expand) -> None:
    with pytest.raises(
        xacro.XacroException, match="gripper: expected none, got 'robotiq_2f'"
    ):
        expand_a0912(expand, gripper="robotiq_2f")


@pytest.mark.parametrize(("namespace", "found"), [("", []), ("cell", ["cell"])])
def test_a0912_controllers_can_have_a_name_space(
    expand: Expand, namespace: str, found: list[str]
) -> None:
    root = parse(expand_a0912(expand, namespace=namespace))

    tags = root.iterfind("gazebo/plugin/ros/namespace")
    assert [tag.text for tag in tags] == found


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


MYCOBOT = MODELS / "mycobot_280"
MYCOBOT_URDFS = "mycobot_280/mycobot_gazebo/urdf"

# What moves the joints, and the published description where it does.
MYCOBOT_CONTROLS = {
    "gazebo": f"{MYCOBOT_URDFS}/mycobot_280_gazebo.urdf.xacro",
    "ros2_control": f"{MYCOBOT_URDFS}/ros2_control/gazebo/mycobot_280.urdf.xacro",
    "classic": f"{MYCOBOT_URDFS}/mycobot_280_classic_gazebo.urdf.xacro",
}

# The joints whose published limits of 0.5 don't let the gripper close to -0.7 [rad].
MYCOBOT_OUTER_JOINTS = (
    "gripper_left3_to_gripper_left1",
    "gripper_right3_to_gripper_right1",
)

# Corners of the box around each published mesh, in the link's frame [mm].
MYCOBOT_BOXES = {
    "link2": ((-24.0, -36.6, -64.1), (24.0, 24.0, 22.9)),
    "link3": ((-132.0, -24.0, 29.8), (24.0, 24.0, 85.3)),
    "link4": ((-115.2, -21.6, -22.4), (21.6, 21.6, 35.4)),
    "link5": ((-19.3, -36.6, -33.7), (19.3, 19.7, 19.1)),
    "link6": ((-19.2, -21.6, -38.0), (19.2, 35.1, 19.1)),
    "link6_flange": ((-19.2, -19.2, -12.0), (19.2, 19.2, 1.7)),
    "gripper_base": ((-29.0, -32.3, -13.2), (29.0, 29.9, 37.7)),
    "gripper_left1": ((-5.7, -5.0, -18.5), (18.8, 53.2, 2.1)),
    "gripper_left2": ((-32.4, -4.7, -18.2), (3.5, 19.6, 1.8)),
    "gripper_left3": ((-32.2, -14.2, -3.2), (12.8, 19.3, 1.8)),
    "gripper_right1": ((-20.0, -4.6, -18.5), (4.5, 53.6, 2.1)),
    "gripper_right2": ((-4.5, -4.7, -18.2), (31.2, 20.0, 1.8)),
    "gripper_right3": ((-14.0, -14.3, -3.2), (31.0, 19.7, 1.8)),
}


@pytest.fixture(params=MYCOBOT_CONTROLS)
def mycobots(request: pytest.FixtureRequest, expand: Expand) -> tuple[str, str]:
    """Return the URDFs of our myCobot and of the published one."""
    published = real_robot(MYCOBOT_CONTROLS[request.param])
    folder = published.parents[published.parts[::-1].index("mycobot_280") - 1]
    names = ("mycobot_gazebo", "mycobot_description")
    packages = {name: folder / name for name in names}
    ours = expand_mycobot(expand, control=request.param)
    return ours, expand(published, packages)


def expand_mycobot(expand: Expand, **args: str) -> str:
    file = MYCOBOT / "urdf" / "mycobot_280.urdf.xacro"
    return expand(file, {"mycobot_280": MYCOBOT}, **args)


def inertials(urdf: str) -> dict[str, list[float]]:
    """Return mass, centre of mass, its axes and inertia of the links that have them."""
    moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    return {
        link.attrib["name"]: [
            float(inertial.find("mass").attrib["value"]),
            *numbers(inertial, "xyz", "rpy"),
            *(float(inertial.find("inertia").attrib[key]) for key in moments),
        ]
        for link in parse(urdf).findall("link")
        for inertial in link.findall("inertial")
    }


def mimics(urdf: str) -> dict[str, tuple[str, float, float]]:
    return {
        joint.attrib["name"]: (
            mimic.attrib["joint"],
            float(mimic.attrib["multiplier"]),
            float(mimic.attrib["offset"]),
        )
        for joint in parse(urdf).findall("joint")
        for mimic in joint.findall("mimic")
    }


def test_mycobot_has_the_published_limits_but_two(mycobots: tuple[str, str]) -> None:
    ours, published = map(joint_figures, mycobots)

    for joint in MYCOBOT_OUTER_JOINTS:
        assert (published[joint]["lower"], published[joint]["upper"]) == (-0.5, 0.5)
        assert (ours[joint]["lower"], ours[joint]["upper"]) == (-0.8, 0.8)
        ours[joint] |= {"lower": -0.5, "upper": 0.5}
    assert {"lower", "upper", "damping", "friction"} < set(ours["link1_to_link2"])
    assert ours == published


def test_mycobot_has_the_published_masses_and_inertias(
    mycobots: tuple[str, str],
) -> None:
    ours, published = map(inertials, mycobots)

    assert ours == published
    # The sum of the figures in the published file.
    assert sum(link[0] for link in ours.values()) == pytest.approx(1.2549, abs=1e-9)


@pytest.mark.slow
def test_mycobot_poses_all_links_like_the_published_arm(
    mycobots: tuple[str, str],
) -> None:
    ours, published = map(pinocchio.buildModelFromXML, mycobots)
    links = [frame.name for frame in published.frames]

    assert list(ours.names) == list(published.names)
    assert sorted(frame.name for frame in ours.frames) == sorted(links)
    assert mimics(mycobots[0]) == mimics(mycobots[1])
    assert len(mimics(mycobots[0])) == 5
    for q in configurations(published):
        for link in links:
            X_WL = link_pose(published, q, link)
            np.testing.assert_allclose(link_pose(ours, q, link), X_WL, atol=1e-12)


@pytest.mark.parametrize("link", MYCOBOT_BOXES)
def test_mycobot_meshes_fill_the_box_of_the_published_ones(link: str) -> None:
    mesh = trimesh.load(MYCOBOT / "meshes" / f"{link}.dae").to_geometry()

    # Most are within 1.5 mm; the ends that stick in each other differ by up to 3.7 mm.
    np.testing.assert_allclose(mesh.bounds * 1e3, MYCOBOT_BOXES[link], atol=4.0)


@pytest.mark.slow
def test_mycobot_meshes_are_those_that_the_script_makes() -> None:
    script = runpy.run_path(str(MYCOBOT / "meshes" / "make_meshes.py"))
    links, document = script["links"], script["document"]

    for link, parts in links().items():
        made = document(link, parts)
        kept = collada.Collada(str(MYCOBOT / "meshes" / f"{link}.dae"))
        assert kept.assetInfo.unitmeter == 1.0
        assert [e.id for e in kept.effects] == [e.id for e in made.effects]
        for ours, file in zip(made.geometries, kept.geometries, strict=True):
            (shape,), (written,) = ours.primitives, file.primitives
            assert ours.id == file.id
            np.testing.assert_array_equal(written.vertex_index, shape.vertex_index)
            # Written with seven digits.
            np.testing.assert_allclose(written.vertex, shape.vertex, atol=1e-6)


def test_mycobot_refuses_a_control_it_does_not_have(expand: Expand) -> None:
    message = "control: expected gazebo, ros2_control, classic, got 'ros1'"
    with pytest.raises(xacro.XacroException, match=message):
        expand_mycobot(expand, control="ros1")


@pytest.mark.parametrize("control", MYCOBOT_CONTROLS)
def test_mycobot_expands_without_a_word(
    expand: Expand, capsys: pytest.CaptureFixture[str], control: str
) -> None:
    expand_mycobot(expand, control=control)

    assert capsys.readouterr().err == ""
