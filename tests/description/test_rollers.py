"""Rollers that wheels of mecanum and omni bases get in the physics."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.base_wheels import (
    Rollers,
    find_bases,
    find_rollers,
    with_rollers,
)
from tests.rollouts.test_sideways_bases import MASS, RADIUS, mecanum, omni


def load(folder: Path, files: tuple[str, str]) -> ad.Robot:
    (folder / "robot.urdf").write_text(files[0])
    (folder / "controllers.yaml").write_text(files[1])
    return ad.load_robot(folder / "robot.urdf", controllers=folder / "controllers.yaml")


def rollers_of(robot: ad.Robot) -> list[Rollers]:
    bases = find_bases(robot.description, robot.controllers)
    return find_rollers(robot.description, bases)


def test_rollers_of_mecanum_wheels_point_as_the_kinematics_have_it(
    tmp_path: Path,
) -> None:
    # The joints' origins aren't turned: links stand as the base does.
    directions = {r.link: r.roller for r in rollers_of(load(tmp_path, mecanum()))}

    half = math.sqrt(0.5)
    # Where the wheel rolls at w, the base goes w r along this axis by w r cos(45°).
    for link, y in (("fl", -half), ("fr", half), ("rr", -half), ("rl", half)):
        np.testing.assert_allclose(directions[link], [half, y, 0.0], atol=1e-12)


def test_rollers_of_a_wheel_that_is_mounted_backwards_point_the_same_way(
    tmp_path: Path,
) -> None:
    urdf, yaml = mecanum()
    urdf = urdf.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 -1 0"/>', 1)

    first = rollers_of(load(tmp_path, (urdf, yaml)))[0]

    half = math.sqrt(0.5)
    np.testing.assert_allclose(first.axis, [0.0, -1.0, 0.0])
    np.testing.assert_allclose(first.roller, [half, -half, 0.0], atol=1e-12)


def test_rollers_of_omni_wheels_point_where_these_roll(tmp_path: Path) -> None:
    for rim in rollers_of(load(tmp_path, omni())):
        np.testing.assert_allclose(np.abs(rim.roller), [1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("lean", [math.sqrt(0.5), 0.0])
def test_the_rim_is_round(lean: float) -> None:
    forwards = math.sqrt(1.0 - lean**2)
    axis, down = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, -1.0])
    roller = np.array([forwards, lean, 0.0])
    rim = Rollers("wheel", RADIUS, np.zeros(3), axis, down, roller)
    count = len(rim.wheels)

    heights = []
    for angle in np.linspace(-math.pi / count, math.pi / count, 41):
        # An ellipsoid reaches as deep as its axes do together.
        slope = math.sin(angle) * forwards
        reach = math.hypot(
            rim.semi_axis * slope, rim.thickness * math.sqrt(1.0 - slope**2)
        )
        heights.append((RADIUS - rim.thickness) * math.cos(angle) + reach)

    assert np.ptp(heights) < 1e-3 * RADIUS
    assert heights[20] == pytest.approx(RADIUS, rel=1e-12)
    assert heights[0] == pytest.approx(RADIUS, rel=1e-12)


def test_the_mass_stays(tmp_path: Path) -> None:
    robot = load(tmp_path, mecanum())
    text = with_rollers(robot.description, rollers_of(robot)).urdf
    root = ET.fromstring(text)  # noqa: S314  our own text.

    masses = {
        link.get("name"): float(link.find("inertial/mass").get("value"))
        for link in root.iterfind("link")
    }

    wheel = [mass for name, mass in masses.items() if name.startswith("fl")]
    assert len(wheel) == 11
    assert sum(wheel) == pytest.approx(MASS)
    assert root.find("link[@name='fl']/collision") is None


def test_a_wheel_with_rollers_of_its_own_keeps_them(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    own = """<link name="own{0}"><inertial><mass value="0.01"/>
      <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>
      </link><joint name="own{0}_joint" type="continuous"><axis xyz="1 0 0"/>
      <parent link="fl"/><child link="own{0}"/></joint>"""
    three = "".join(own.format(number) for number in range(3))

    several = load(tmp_path, (urdf.replace("</robot>", f"{three}</robot>"), yaml))
    one = load(tmp_path, (urdf.replace("</robot>", f"{own.format(0)}</robot>"), yaml))

    assert [rim.link for rim in rollers_of(several)] == ["fr", "rr", "rl"]
    # It may be that of an encoder.
    assert [rim.link for rim in rollers_of(one)] == ["fl", "fr", "rr", "rl"]


def test_a_wheel_may_be_fixed_to_what_turns(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    # The joint turns a hub; the wheel is fixed to it, 4 cm further out and turned.
    hub = f"""<link name="hub"/><joint name="rim_joint" type="fixed">
    <origin xyz="0 0.04 0" rpy="0 0 {math.pi / 2}"/><parent link="hub"/>
    <child link="fl"/></joint></robot>"""
    urdf = urdf.replace('<child link="fl"/>', '<child link="hub"/>')
    urdf = urdf.replace(
        'rpy="1.5707963267948966 0 0"', 'rpy="0 1.5707963267948966 0"', 1
    )

    first = rollers_of(load(tmp_path, (urdf.replace("</robot>", hub), yaml)))[0]

    assert first.link == "fl"
    half = math.sqrt(0.5)
    # Its x axis is the base's y axis.
    np.testing.assert_allclose(first.axis, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(first.roller, [-half, -half, 0.0], atol=1e-12)


def test_the_largest_shape_is_the_rim(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    hub = """<collision><origin xyz="0.1 0 0"/><geometry>
      <cylinder radius="0.02" length="0.1"/></geometry></collision>"""

    urdf = urdf.replace("<collision>", f"{hub}<collision>", 1)
    first = rollers_of(load(tmp_path, (urdf, yaml)))[0]

    assert first.radius == RADIUS
    np.testing.assert_array_equal(first.center, np.zeros(3))


def test_a_wheel_of_another_shape_turns_about_its_middle(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    shape = f"""<collision><origin rpy="{math.pi / 2} 0 0"/><geometry>
    <cylinder radius="{RADIUS}" length="0.04"/></geometry></collision>"""
    assert shape in urdf
    box = """<collision><origin xyz="0 0.03 0"/><geometry>
    <box size="0.1 0.04 0.1"/></geometry></collision>"""

    first = rollers_of(load(tmp_path, (urdf.replace(shape, box, 1), yaml)))[0]

    np.testing.assert_allclose(first.center, [0.0, 0.03, 0.0], atol=1e-12)


@pytest.mark.parametrize("radius", ["abc", "[0.05]"])
def test_a_radius_that_is_no_number_is_a_line_of_the_report(
    tmp_path: Path, radius: str
) -> None:
    urdf, yaml = mecanum()
    text = yaml.replace(f"wheels_radius: {RADIUS}", f"wheels_radius: {radius}")

    robot = load(tmp_path, (urdf, text))

    assert rollers_of(robot) == []
    assert "wheels_radius" in str(robot.report)


def test_the_radius_is_that_of_the_shape(tmp_path: Path) -> None:
    urdf, yaml = mecanum()
    shape = f'<cylinder radius="{RADIUS}" length="0.04"/>'
    urdf = urdf.replace(shape, '<sphere radius="0.06"/>', 1)
    urdf = urdf.replace(shape, '<box size="0.1 0.1 0.04"/>', 1)

    radii = [rim.radius for rim in rollers_of(load(tmp_path, (urdf, yaml)))]

    # Of a box it isn't known: that of the controller holds.
    assert radii == [0.06, RADIUS, RADIUS, RADIUS]


def test_without_physics_there_are_no_rollers(tmp_path: Path) -> None:
    robot = load(tmp_path, mecanum())
    options = ad.SimulationOptions(preset="kinematic")

    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    sim.run(0.1)

    assert len(sim.joint_states().name) == 4
