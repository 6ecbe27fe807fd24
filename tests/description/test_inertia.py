"""Inertias that no body has become those of the nearest one; moving links weigh."""

import logging
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RotationalInertia
from pydrake.systems.analysis import Simulator
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from arm_drake.description.inertia import is_physical, nearest_physical
from tests.description.reading import read_and_write

# How thin a repaired body may be, as the docstring says.
MARGIN = 1e-3

# Volume of a ball of radius 1.
BALL = 4 / 3 * math.pi


def tensor(numbers) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = numbers
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def tensors(scale: float):
    number = st.floats(-scale, scale, allow_subnormal=False)
    return st.lists(number, min_size=6, max_size=6).map(tensor)


def apex(inertia: np.ndarray) -> float:
    return 2.0 * MARGIN * np.abs(np.linalg.eigvalsh(inertia)).max()


# Principal moments, and the nearest ones with a + b >= c, by hand.
NEAREST = [
    # The foot of the perpendicular on a + b = c: all move by the same amount.
    ([1, 1, 3], [4 / 3, 4 / 3, 8 / 3]),
    ([1, 2, 6], [2, 3, 5]),
    ([-1, -1, 3], [2 / 3, 2 / 3, 4 / 3]),
    # It would be beyond the edge a = 0, b = c, so the foot is on the edge.
    ([-1, 1, 1], [0, 1, 1]),
    ([-3, -1, 2], [0, 1 / 2, 1 / 2]),
    # The tip.
    ([-1, -1, -1], [0, 0, 0]),
    ([-3, -2, 1], [0, 0, 0]),
]


@pytest.mark.parametrize(("moments", "nearest"), NEAREST)
def test_the_nearest_moments_are_those_found_by_hand(moments, nearest):
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    inertia = R @ np.diag(moments).astype(float) @ R.T
    inertia = (inertia + inertia.T) / 2.0

    repaired = nearest_physical(1.0, inertia)

    # The margin moves each by at most its apex.
    moved = R.T @ repaired @ R
    tolerance = apex(inertia) * 1.001
    np.testing.assert_allclose(moved, np.diag(nearest), atol=tolerance)
    np.testing.assert_allclose(moved - np.diag(np.diag(moved)), 0.0, atol=1e-14)


@pytest.mark.slow
@settings(deadline=None)
@given(tensors(10.0))
def test_no_tensor_of_a_body_is_nearer(inertia):
    repaired = nearest_physical(1.0, inertia)

    if is_physical(inertia):
        np.testing.assert_array_equal(repaired, inertia)
        return
    # The bodies' tensors are a convex cone about the identity, spanned by 1 - u u'
    # for unit u. What is left must be at a right angle to the repaired one, and
    # point away from all of them: tr(N) - u' N u <= 0.
    rest = inertia - repaired
    size = np.abs(inertia).max()
    above_apex = repaired - apex(inertia) * np.eye(3)
    # Divided first: products of tiny tensors have few digits.
    assert abs(np.sum((rest / size) * (above_apex / size))) <= 1e-12
    assert np.trace(rest) - np.linalg.eigvalsh(rest)[0] <= 1e-12 * size
    second = np.trace(above_apex) / 2.0 * np.eye(3) - above_apex
    assert np.linalg.eigvalsh(second)[0] >= -1e-12 * size


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_a_search_over_all_bodies_finds_nothing_nearer(seed):
    rng = np.random.default_rng(seed)
    inertia = tensor(rng.normal(size=6))
    assert not is_physical(inertia)
    at_apex = apex(inertia) * np.eye(3)

    def misfit(numbers):
        # Second moments of any body: L L'.
        L = np.zeros((3, 3))
        L[np.tril_indices(3)] = numbers
        second = L @ L.T
        body = np.trace(second) * np.eye(3) - second
        return (body + at_apex - inertia).ravel()

    found = min(
        least_squares(misfit, rng.normal(size=6), xtol=1e-14, gtol=1e-14).cost
        for _ in range(5)
    )

    distance = np.linalg.norm(nearest_physical(1.0, inertia) - inertia)
    assert distance == pytest.approx(math.sqrt(2.0 * found), rel=1e-5)


@pytest.mark.slow
@settings(deadline=None)
@given(tensors(10.0))
def test_drake_takes_every_repaired_tensor(inertia):
    repaired = nearest_physical(1.0, inertia)

    xx, yy, zz = np.diag(repaired)
    products = repaired[np.triu_indices(3, 1)]
    # It raises an error if no body can have these.
    drakes = RotationalInertia(xx, yy, zz, *products)
    assert drakes.CouldBePhysicallyValid()


@pytest.mark.parametrize(
    ("mass", "inertia"),
    [
        (0.0, np.eye(3)),
        (-1.0, np.eye(3)),
        (math.nan, np.eye(3)),
        (math.inf, np.eye(3)),
        (1.0, np.diag([1.0, 1.0, math.nan])),
        (1.0, np.diag([1.0, 1.0, math.inf])),
        (1.0, np.eye(2)),
        (1.0, np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])),
    ],
)
def test_what_is_no_inertia_is_refused(mass, inertia):
    with pytest.raises(ValueError, match="expected"):
        nearest_physical(mass, inertia)


@pytest.fixture
def repair(tmp_path):
    """Return a function: URDF body -> repaired root and lines of the report."""
    file = tmp_path / "arm.urdf"

    def repair_text(body: str) -> tuple[ET.Element, list[str]]:
        root, report = read_and_write(body, file)
        assert {entry.kind for entry in report} <= {"repair"}
        return root, [str(entry).replace(f"{file}: ", "") for entry in report]

    return repair_text


@pytest.fixture
def simulate(caplog):
    """Return a function that runs a repaired robot, and fails if Drake complains."""

    def run(root: ET.Element) -> None:
        plant = MultibodyPlant(0.001)
        with caplog.at_level(logging.WARNING, logger="drake"):
            Parser(plant).AddModelsFromString(
                ET.tostring(root, encoding="unicode"), "urdf"
            )
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
            plant.Finalize()
            simulator = Simulator(plant)
            simulator.AdvanceTo(0.01)
        assert not [r.getMessage() for r in caplog.records if r.name == "drake"]
        context = simulator.get_context()
        velocities = plant.GetVelocities(context)
        assert np.isfinite(velocities).all()
        assert np.linalg.eigvalsh(plant.CalcMassMatrix(context))[0] > 0.0

    return run


def inertial(mass, moments=(1, 1, 1), products=(0, 0, 0), origin="") -> str:
    ixx, iyy, izz = moments
    ixy, ixz, iyz = products
    return (
        f'<inertial>{origin}<mass value="{mass}"/><inertia ixx="{ixx}" iyy="{iyy}" '
        f'izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial>'
    )


def arm(body: str, *, type="continuous", axis="0 0 1") -> str:
    """A base, and a link `a` on a joint."""
    return f'<link name="base"/><link name="a">{body}</link>' + joint(
        "base", "a", type=type, axis=axis
    )


def joint(parent: str, child: str, *, type="fixed", axis="0 0 1", origin="") -> str:
    limit = '<limit effort="1" velocity="1"/>' if type == "prismatic" else ""
    return (
        f'<joint name="{child}_joint" type="{type}"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>{limit}{origin}</joint>'
    )


def geometry(shape: str, *, tag="collision", origin="") -> str:
    return f"<{tag}>{origin}<geometry>{shape}</geometry></{tag}>"


def read_inertial(
    root: ET.Element, link: str = "a"
) -> tuple[float, list[float], np.ndarray]:
    """Mass, centre and tensor in the inertial's frame."""
    (element,) = root.findall(f"link[@name='{link}']/inertial")
    origin = element.find("origin")
    xyz = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    numbers = [float(element.find("inertia").get(name)) for name in names]
    mass = float(element.find("mass").get("value"))
    return mass, [float(x) for x in xyz.split()], tensor(numbers)


def test_what_bodies_have_stays_to_the_bit(repair, simulate):
    root, lines = repair(arm(inertial("2", ("1", "1.50", "2.3"), ("0.1", "0", "0"))))

    mass, center, inertia = read_inertial(root)
    assert (mass, center) == (2.0, [0.0, 0.0, 0.0])
    assert inertia.tolist() == [[1.0, 0.1, 0.0], [0.1, 1.5, 0.0], [0.0, 0.0, 2.3]]
    assert lines == []
    simulate(root)


def test_an_unphysical_inertia_becomes_the_nearest_one(repair, simulate):
    root, lines = repair(arm(inertial(2, (1, 1, 3))))

    mass, _, inertia = read_inertial(root)
    assert mass == 2.0
    expected = np.diag([4 / 3, 4 / 3, 8 / 3])
    np.testing.assert_allclose(inertia, expected, atol=2 * MARGIN * 3)
    assert lines == [
        "warning: link 'a': no body has the principal moments (1, 1, 3) kg·m^2; "
        "the moments are now (1.34, 1.34, 2.66) kg·m^2, the nearest possible ones"
    ]
    simulate(root)


def test_an_inertia_is_repaired_in_its_own_frame(repair, simulate):
    origin = '<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'

    root, _ = repair(arm(inertial(2, (1, 1, 3), origin=origin)))

    _, center, inertia = read_inertial(root)
    assert center == [1.0, 2.0, 3.0]
    assert root.find(".//inertial/origin").get("rpy") == "0.1 0.2 0.3"
    expected = np.diag([4 / 3, 4 / 3, 8 / 3])
    np.testing.assert_allclose(inertia, expected, atol=2 * MARGIN * 3)
    simulate(root)


def test_products_count(repair, simulate):
    # The moments are -1, 1 and 3.
    root, _ = repair(arm(inertial(1, (1, 1, 1), (2, 0, 0))))

    _, _, inertia = read_inertial(root)
    moments = np.linalg.eigvalsh(inertia)
    # All move by (3 - 1 + 1) / 3 = 1.
    np.testing.assert_allclose(moments, [0.0, 2.0, 2.0], atol=7e-3)
    assert inertia[0, 1] == pytest.approx(1.0, abs=2 * MARGIN * 3)
    simulate(root)


def test_a_base_with_an_unphysical_inertia_is_repaired_too(repair, simulate):
    text = arm(inertial(1)).replace(
        '<link name="base"/>', f'<link name="base">{inertial(1, (1, 1, 3))}</link>'
    )

    root, lines = repair(text)

    assert len(lines) == 1
    assert lines[0].startswith("warning: link 'base': no body has")
    simulate(root)


@pytest.mark.parametrize(
    ("mass", "severity"),
    [
        *((mass, "error") for mass in ("-1", "-1e-320")),
        *((mass, "warning") for mass in ("1e-320", "1e-61")),
    ],
)
def test_an_impossible_mass_counts_as_none(repair, simulate, mass, severity):
    root, lines = repair(arm(inertial(mass)))

    assert read_inertial(root)[0] > 0.0
    massless = f"a mass of {mass} kg; it is taken as massless"
    assert lines[0] == f"{severity}: link 'a': {massless}"
    assert lines[1].startswith("warning: link 'a': no mass, but a joint moves it; ")
    assert len(lines) == 2
    simulate(root)


@pytest.mark.parametrize(
    "text", [inertial(0), '<inertial><inertia ixx="1" iyy="1" izz="1"/></inertial>']
)
def test_an_inertia_without_mass_goes(repair, simulate, text):
    base, tip = f'<link name="base">{text}</link>', f'<link name="tip">{text}</link>'
    body = base + f'<link name="a">{inertial(1)}</link>' + tip

    root, lines = repair(
        body + joint("base", "a", type="continuous") + joint("a", "tip")
    )

    assert len(root.findall("link/inertial")) == 1
    assert lines == [
        f"warning: link '{name}': an inertia without mass; it is taken as massless"
        for name in ("base", "tip")
    ]
    simulate(root)


@pytest.mark.parametrize(
    ("inertia", "lacks"),
    [
        ('<inertia ixx="1" iyy="1" ixy="0" ixz="0" iyz="0"/>', " 'izz' of its"),
        ('<inertia ixx="1" iyy="1" izz="1"/>', " 'ixy', 'ixz', 'iyz' of its"),
        ("", ""),
    ],
)
def test_moments_that_ros_asks_for_are_missed(repair, inertia, lacks):
    _, lines = repair(arm(f'<inertial><mass value="1"/>{inertia}</inertial>'))

    what = f"no{lacks} <inertia>, without which ROS takes no mass; taken as 0"
    assert lines[0] == f"warning: link 'a': {what}"


def test_a_link_of_nothing_that_does_not_move_alone_is_no_news(repair, simulate):
    zero = inertial(0, (0, 0, 0))
    text = arm(inertial(1)) + f'<link name="tip">{zero}</link>' + joint("a", "tip")

    root, lines = repair(text)

    assert lines == []
    simulate(root)


def test_a_point_mass_on_its_axis_gets_the_shape_of_its_geometry(repair, simulate):
    # A box of 2 kg: m / 12 (y^2 + z^2) and so on; its origin doesn't matter.
    box = geometry('<box size="1 2 3"/>', origin='<origin xyz="0 0 9"/>')

    root, lines = repair(arm(inertial(2, (0, 0, 0)) + box))

    mass, center, inertia = read_inertial(root)
    assert (mass, center) == (2.0, [0.0, 0.0, 0.0])
    expected = np.diag([13.0, 10.0, 5.0]) / 6.0
    np.testing.assert_allclose(inertia, expected, atol=1e-12)
    assert lines == [
        "warning: link 'a': no inertia about the joint's axis, principal moments "
        "(0, 0, 0) kg·m^2; the moments are now (0.833, 1.67, 2.17) kg·m^2, "
        "those of its collision geometry"
    ]
    simulate(root)


def test_the_shape_is_turned_into_the_frame_of_the_inertial(repair, simulate):
    # y of the inertial is x of the link.
    origin = f'<origin rpy="0 0 {-math.pi / 2!r}"/>'
    box = geometry('<box size="1 2 3"/>')

    root, _ = repair(arm(inertial(2, (0, 0, 0), origin=origin) + box))

    _, _, inertia = read_inertial(root)
    expected = np.diag([10.0, 13.0, 5.0]) / 6.0
    np.testing.assert_allclose(inertia, expected, atol=1e-12)
    simulate(root)


def test_a_point_mass_without_geometry_becomes_a_ball_of_water(repair, simulate):
    # Of radius 0.1 m: 2/5 m r^2.
    mass = 1000.0 * BALL * 0.1**3

    root, lines = repair(arm(inertial(repr(mass), (0, 0, 0))))

    _, _, inertia = read_inertial(root)
    np.testing.assert_allclose(inertia, 0.4 * mass * 0.01 * np.eye(3), rtol=1e-12)
    assert lines[0].endswith("those of a ball of 1000 kg/m^3")
    simulate(root)


def test_a_line_of_mass_that_turns_about_itself_gets_thicker(repair, simulate):
    root, lines = repair(arm(inertial(1, (1, 1, 0))))

    _, _, inertia = read_inertial(root)
    assert inertia[2, 2] > 0.0
    np.testing.assert_allclose(inertia, np.diag([1, 1, 0]), atol=2 * MARGIN)
    assert lines[0].startswith(
        "warning: link 'a': no inertia about the joint's axis, principal moments "
        "(0, 1, 1) kg·m^2; the moments are now (0.002, 1, 1) kg·m^2"
    )
    simulate(root)


@pytest.mark.parametrize(
    "text",
    [
        # A pendulum of a point mass, a line that turns about another axis, and what
        # only slides.
        arm(inertial(1, (0, 0, 0), origin='<origin xyz="0.1 0 0"/>')),
        arm(inertial(1, (1, 1, 0)), axis="1 0 0"),
        arm(inertial(1, (0, 0, 0)), type="prismatic"),
        # Along x, where nothing else is said; the length of an axis means nothing.
        arm(inertial(1, (1, 1, 0))).replace('<axis xyz="0 0 1"/>', ""),
        arm(inertial(1), axis="0 0 1e-6"),
        # Links fixed to each other are one body, each with its origin.
        arm(inertial(1, (0, 0, 0)))
        + f'<link name="b">{inertial(1, (0, 0, 0))}</link><link name="c"/>'
        + joint("a", "c", origin='<origin xyz="0 0 1" rpy="0 1.57 0"/>')
        + joint("c", "b", origin='<origin xyz="0 0 1"/>'),
    ],
)
def test_points_and_lines_that_can_move_stay(repair, simulate, text):
    root, lines = repair(text)

    assert lines == []
    simulate(root)


@pytest.mark.parametrize("type", ["continuous", "prismatic"])
@pytest.mark.parametrize("tag", ["collision", "visual"])
def test_a_moving_body_without_mass_gets_that_of_its_geometry(
    repair, simulate, type, tag
):
    # A ball of radius 0.1 m, with water's density.
    mass = 1000.0 * BALL * 0.1**3
    ball = geometry('<sphere radius="0.1"/>', tag=tag, origin='<origin xyz="1 2 3"/>')

    root, lines = repair(arm(ball, type=type))

    got_mass, center, inertia = read_inertial(root)
    assert got_mass == pytest.approx(mass)
    assert center == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(inertia, 0.4 * mass * 0.01 * np.eye(3), atol=1e-12)
    assert lines == [
        "warning: link 'a': no mass, but a joint moves it; it gets 4.19 kg and the "
        "moments (0.0168, 0.0168, 0.0168) kg·m^2, 1000 kg/m^3 times the volume of its "
        f"{tag} geometry"
    ]
    simulate(root)


def test_all_links_of_a_body_without_mass_are_estimated(repair, simulate):
    cube = geometry('<box size="0.1 0.1 0.1"/>')
    text = arm("") + f'<link name="b">{cube}</link><link name="c">{cube}</link>'

    root, lines = repair(text + joint("a", "b") + joint("b", "c"))

    assert root.find("link[@name='a']/inertial") is None
    assert read_inertial(root, "b")[0] == pytest.approx(1.0)
    assert read_inertial(root, "c")[0] == pytest.approx(1.0)
    assert len(lines) == 2
    simulate(root)


@pytest.mark.parametrize(("rest", "mass"), [(0.0, 0.001), (0.5, 0.001), (30.0, 0.03)])
def test_without_geometry_it_gets_a_thousandth_of_the_robot(
    repair, simulate, rest, mass
):
    text = f'<link name="base">{inertial(rest) if rest else ""}</link>'

    root, lines = repair(arm("").replace('<link name="base"/>', text))

    got_mass, center, inertia = read_inertial(root)
    assert got_mass == pytest.approx(mass)
    assert center == [0.0, 0.0, 0.0]
    # A ball of radius 5 cm: 2/5 m r^2.
    np.testing.assert_allclose(inertia, 1e-3 * mass * np.eye(3), rtol=1e-12)
    assert len(lines) == 1
    assert lines[0].endswith("kg·m^2, it has no geometry to estimate from")
    simulate(root)


def test_a_body_with_the_mass_of_a_needle_can_turn(repair, simulate):
    root, lines = repair(arm(geometry('<box size="1e-6 1e-6 1"/>')))

    mass, _, inertia = read_inertial(root)
    assert mass == pytest.approx(1e-9)
    np.testing.assert_allclose(np.diag(inertia)[:2], 1e-9 / 12.0, rtol=3 * MARGIN)
    assert [line.partition(", principal")[0].partition(";")[0] for line in lines] == [
        "warning: link 'a': no mass, but a joint moves it",
        "warning: link 'a': no inertia about the joint's axis",
    ]
    simulate(root)


def test_links_fixed_to_a_heavy_one_need_no_mass_of_their_own(repair, simulate):
    text = arm("") + f'<link name="b">{inertial(1)}</link>' + joint("a", "b")

    root, lines = repair(text)

    assert lines == []
    simulate(root)


def test_the_base_needs_no_mass(repair):
    _, lines = repair('<link name="base"/><link name="b"/>' + joint("base", "b"))

    assert lines == []


@pytest.mark.parametrize("parent", ["base", "a"])
def test_each_of_two_moving_bodies_is_repaired(repair, simulate, parent):
    text = arm("") + '<link name="b"/>' + joint(parent, "b", type="continuous")

    root, lines = repair(text)

    assert [line.split(":")[1] for line in lines] == [" link 'a'", " link 'b'"]
    simulate(root)


def random_inertials(rng: np.random.Generator, scale: float) -> list[str]:
    """Any numbers, thin and flat bodies among them, anywhere."""
    texts = []
    for kind in ("any", "plate", "rod", "body"):
        second = rng.uniform(-1.0 if kind == "any" else 0.0, 1.0, size=3)
        second[: {"plate": 1, "rod": 2}.get(kind, 0)] = 0.0
        R = Rotation.random(random_state=rng).as_matrix()
        tensor = scale * R @ np.diag(second.sum() - second) @ R.T
        moments, products = np.diag(tensor), tensor[np.triu_indices(3, 1)]
        xyz, rpy = rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)
        origin = '<origin xyz="{} {} {}" rpy="{} {} {}"/>'.format(*xyz, *rpy)
        mass = 10.0 ** rng.uniform(-3, 2)
        texts.append(inertial(mass, moments.tolist(), products.tolist(), origin))
    return texts


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-9, 1e-3, 10.0])
def test_drake_takes_whatever_was_repaired(repair, simulate, scale):
    rng = np.random.default_rng(7)
    texts = [text for _ in range(50) for text in random_inertials(rng, scale)]
    links = [f'<link name="l{i}">{text}</link>' for i, text in enumerate(texts)]
    joints = [joint("base", f"l{i}", type="continuous") for i in range(len(texts))]

    root, lines = repair('<link name="base"/>' + "".join(links + joints))

    assert len(lines) > 30
    simulate(root)


@pytest.fixture
def run_free(tmp_path, caplog):
    """Return a function: URDF body -> what moves freely in Drake, and the report."""
    file = tmp_path / "arm.urdf"

    def run(body: str, base: str | None = None) -> tuple[ET.Element, list[str]]:
        root, report = read_and_write(body, file, base=base)
        text = ET.tostring(root, encoding="unicode")
        plant = MultibodyPlant(0.001)
        with caplog.at_level(logging.WARNING, logger="drake"):
            Parser(plant).AddModelsFromString(text, "urdf")
            plant.Finalize()
            Simulator(plant).AdvanceTo(0.01)
        said = [r.getMessage() for r in caplog.records if r.name == "drake"]
        assert all("as a free body" in message for message in said)
        lines = [str(entry).replace(f"{file}: ", "") for entry in report]
        return root, lines

    return run


def test_a_free_base_without_mass_gets_some(run_free):
    root, lines = run_free(arm(""), "base")

    # A ball of 1 g and radius 5 cm: 2/5 m r^2.
    mass, _, inertia = read_inertial(root, "base")
    assert mass == pytest.approx(1e-3)
    np.testing.assert_allclose(inertia, 1e-6 * np.eye(3), rtol=1e-12)
    assert [line.partition(";")[0] for line in lines] == [
        "warning: link 'a': no mass, but a joint moves it",
        "warning: link 'base': no mass, but no joint holds it",
    ]


def test_a_free_base_gets_the_mass_of_the_links_fixed_to_it(run_free):
    cube = geometry('<box size="0.1 0.1 0.1"/>')
    text = f'<link name="base"/><link name="shell">{cube}</link>'

    root, lines = run_free(text + joint("base", "shell"), "base")

    assert root.find("link[@name='base']/inertial") is None
    assert read_inertial(root, "shell")[0] == pytest.approx(1.0)
    assert len(lines) == 1


def test_a_free_base_that_can_move_stays_to_the_bit(run_free):
    base = f'<link name="base"/><link name="shell">{inertial(1)}</link>'
    text = base + joint("base", "shell") + f'<link name="a">{inertial(1)}</link>'
    text += joint("shell", "a", type="continuous")

    root, lines = run_free(text, "base")

    for name in ("shell", "a"):
        mass, center, inertia = read_inertial(root, name)
        assert (mass, center) == (1.0, [0.0, 0.0, 0.0])
        assert inertia.tolist() == np.eye(3).tolist()
    assert root.find("link[@name='base']/inertial") is None
    assert lines == []


@pytest.mark.parametrize(
    "moments", [(1e-3, 1e-3, 0), (0, 1e-3, 1e-3), (0, 0, 0), (1e-3, 1e-3, 1e-14)]
)
@pytest.mark.parametrize("is_base", [True, False])
@pytest.mark.parametrize("origin", ["", '<origin xyz="1 2 3" rpy="1 2 3"/>'])
def test_what_floats_has_inertia_about_every_axis(run_free, moments, is_base, origin):
    body = f'<link name="a">{inertial(1, moments, origin=origin)}</link>'
    rest = f'<link name="base">{inertial(1)}</link>'
    rest += joint("base", "a", type="floating", axis="1 0 0")

    root, lines = run_free(body if is_base else body + rest, "a" if is_base else None)

    assert np.linalg.eigvalsh(read_inertial(root)[2])[0] > 1e-7
    assert len(lines) == 1
    assert lines[0].startswith(
        "warning: link 'a': no inertia about every axis, principal moments"
    )


def test_two_rods_at_an_angle_float(run_free):
    rod = inertial(1, (1e-3, 1e-3, 0))
    text = f'<link name="a">{rod}</link><link name="b">{rod}</link>'

    _, lines = run_free(text + joint("a", "b", origin='<origin rpy="1 0 0"/>'), "a")

    assert lines == []


def test_what_moves_in_a_plane_turns_about_its_own_centre(run_free):
    # About the joint's axis, 1 m away, a point has inertia, yet it can't turn.
    origin = '<origin xyz="1 0 0"/>'
    base = f'<link name="base">{inertial(1)}</link>'
    text = f'<link name="a">{inertial(1, (0, 0, 0), origin=origin)}</link>'

    root, lines = run_free(base + text + joint("base", "a", type="planar"))

    assert read_inertial(root)[2][2, 2] > 0.0
    assert len(lines) == 1
    assert lines[0].startswith("warning: link 'a': no inertia about the joint's axis")


def test_what_moves_in_a_plane_needs_no_inertia_across(run_free):
    base = f'<link name="base">{inertial(1)}</link>'
    text = f'<link name="a">{inertial(1, (1e-3, 0, 1e-3))}</link>'

    _, lines = run_free(base + text + joint("base", "a", type="planar"))

    assert lines == []
