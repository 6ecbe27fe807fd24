"""Bases that can't drive are reported, with what would be right."""

from pathlib import Path
from typing import Any

import pytest
from pydrake.geometry import Box, HalfSpace
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant

import arm_drake as ad
from arm_drake.description.entry import configs_folder
from arm_drake.messages import Twist, TwistStamped, Vector3
from tests import models
from tests.carts import cart, diff_drive
from tests.hardware.test_wheel_slip import CONTROL, YAML

LEFT_SHAPE = """
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>
"""


def lines_of(robot: ad.Robot, **build: Any) -> list[str]:
    """Return what is reported of the base, loaded and built."""
    diagram = ad.build_diagram(robot, **build)
    report = diagram.GetSubsystemByName("controller_manager").report
    found = [e for e in report if e.severity != "info"]
    return [f"{e.severity}: {e.where}: {e.what}; {e.done}" for e in found]


def load(tmp_path: Path, urdf: str, **options: Any) -> ad.Robot:
    return models.load(tmp_path, urdf, YAML, **options)


def test_a_base_on_its_wheels_needs_no_line(tmp_path: Path) -> None:
    assert lines_of(load(tmp_path, cart(CONTROL))) == []


def test_wheels_without_friction_are_an_error(tmp_path: Path) -> None:
    smooth = '<gazebo reference="left_wheel"><mu1>0.0</mu1><mu2>0.0</mu2></gazebo>'

    robot = load(tmp_path, cart(CONTROL, smooth))

    (error,) = robot.report.errors
    assert error.what == "a driven wheel without friction, <mu1> is 0"
    assert error.where == "link 'left_wheel'"
    assert error.done == (
        "it spins and drives nothing; expected more than 0, such as 1"
    )
    assert error.file == str(robot.description.file)


def test_smooth_casters_and_fixed_robots_are_none(tmp_path: Path) -> None:
    smooth = '<gazebo reference="caster"><mu1>0</mu1></gazebo>'

    assert not load(tmp_path, cart(CONTROL, smooth)).report.errors


def test_a_wheel_without_a_shape_is_an_error(tmp_path: Path) -> None:
    urdf = cart(CONTROL)
    assert urdf.count(LEFT_SHAPE.strip()) == 2
    urdf = urdf.replace(LEFT_SHAPE.strip(), "", 1)

    (error,) = load(tmp_path, urdf).report.errors

    assert (error.kind, error.where) == ("invalid", "joint 'left'")
    assert error.what == "a driven wheel without a collision shape"
    assert error.done == (
        "it doesn't touch the ground; expected <collision> in link 'left_wheel'"
    )


def test_wheels_of_gazebos_plugin_are_judged_too(tmp_path: Path) -> None:
    urdf = cart(diff_drive()).replace(LEFT_SHAPE.strip(), "", 1)

    (error,) = models.load(tmp_path, urdf).report.errors

    assert error.where == "joint 'left'"


def test_a_world_without_a_ground_is_an_error(tmp_path: Path) -> None:
    robot = load(tmp_path, cart(CONTROL))
    line = (
        "error: : a mobile base in a world without a ground; it falls; expected "
        "world='empty', or one that has something to stand on"
    )

    assert lines_of(robot, world="void") == [line]
    assert lines_of(robot, world=lambda plant: None) == [line]


@pytest.mark.parametrize(
    ("name", "z", "sizes", "height"),
    [("table", 0.5, (2.0, 2.0, 0.1), 0.55), ("ground", -1.5, (10.0, 10.0, 1.0), -1.0)],
)
def test_a_ground_may_be_anything_at_any_height(
    tmp_path: Path, name: str, z: float, sizes: tuple[float, ...], height: float
) -> None:
    def add_box(plant: MultibodyPlant) -> None:
        plant.RegisterCollisionGeometry(
            plant.world_body(),
            RigidTransform([0.0, 0.0, z]),
            Box(*sizes),
            name,
            CoulombFriction(1.0, 1.0),
        )

    robot = load(tmp_path, cart(CONTROL), pose=(0, 0, height, 0, 0, 0))

    assert lines_of(robot, world=add_box) == []


def test_a_half_space_is_a_ground(tmp_path: Path) -> None:
    def add_half_space(plant: MultibodyPlant) -> None:
        plant.RegisterCollisionGeometry(
            plant.world_body(),
            RigidTransform(),
            HalfSpace(),
            "ground",
            CoulombFriction(1.0, 1.0),
        )

    robot = load(tmp_path, cart(CONTROL))
    high = load(tmp_path, cart(CONTROL), pose=(0, 0, 1, 0, 0, 0))

    assert lines_of(robot, world=add_half_space) == []
    assert len(lines_of(high, world=add_half_space)) == 1


def test_an_arm_needs_no_ground(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.TWO_LINKS)

    assert lines_of(robot, world="void") == []


@pytest.mark.parametrize(
    ("z", "what"),
    [
        (0.5, "the base starts 0.5 m above the ground; it falls"),
        (-0.2, "the base starts 0.2 m below the ground; it is pushed out"),
    ],
)
def test_a_pose_off_the_ground_is_a_warning(
    tmp_path: Path, z: float, what: str
) -> None:
    # A tilt as of a right angle that is written with six digits.
    robot = load(tmp_path, cart(CONTROL), pose=(0, 0, z, 1e-6, 0, 0))

    line = lines_of(robot)[0]

    # The cart's origin is on the ground that it stands on.
    assert line == f"warning: pose: {what}; expected z = 0 m"


def raised(*names: str) -> str:
    """Return the cart with wheels 5 cm higher, on a second caster."""
    urdf = cart(CONTROL)
    for name, y in (("left", 0.2), ("right", -0.2)):
        if name in names:
            urdf = urdf.replace(f'xyz="0 {y} 0.1"', f'xyz="0 {y} 0.15"')
    balls = "".join(
        f'<collision><origin xyz="0.2 {y} 0.05"/><geometry><sphere radius="0.05"/>'
        "</geometry></collision>"
        for y in (0.1, -0.1)
    )
    return urdf.replace('<link name="base_link">', f'<link name="base_link">{balls}')


def test_a_wheel_above_the_ground_is_a_warning(tmp_path: Path) -> None:
    assert lines_of(load(tmp_path, raised("left"))) == [
        "warning: joint 'left': a driven wheel ends 0.05 m above what the robot stands "
        "on; it turns in the air; expected a wheel that reaches the ground"
    ]


def test_a_base_off_the_ground_is_an_error(tmp_path: Path) -> None:
    assert [
        line[:21] for line in lines_of(load(tmp_path, raised("left", "right")))
    ] == [
        "error: joint 'left': ",
        "error: joint 'right':",
    ]


def test_a_sprung_wheel_reaches_what_it_reaches(tmp_path: Path) -> None:
    urdf = raised("left")
    spring = (
        '<link name="fork"><inertial><mass value="0.1"/><inertia ixx="1e-3" ixy="0" '
        'ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
        '<joint name="spring" type="prismatic"><parent link="base_link"/>'
        '<child link="fork"/><axis xyz="0 0 1"/>'
        '<limit lower="-0.05" upper="0.05" effort="0" velocity="0"/></joint>'
    )
    urdf = urdf.replace(
        '<parent link="base_link"/><child link="left_wheel"/>',
        '<parent link="fork"/><child link="left_wheel"/>',
    ).replace("</robot>", f"{spring}</robot>")

    assert lines_of(load(tmp_path, urdf)) == []


@pytest.mark.parametrize(
    ("x", "axis", "goes_wrong"),
    [(0.6, 1, False), (0.6, -1, True), (-0.6, 1, True), (-0.6, -1, False)],
)
def test_steering_that_turns_the_base_the_other_way_is_reported(
    tmp_path: Path, x: float, axis: int, goes_wrong: bool
) -> None:
    folder = configs_folder() / "wheeled_base"
    text = (folder / "bicycle.urdf").read_text()
    at, up = '<origin xyz="0.6 0 0.1"/>', '<axis xyz="0 0 1"/>'
    assert text.count(at) == text.count(up) == 1
    text = text.replace(at, f'<origin xyz="{x} 0 0.1"/>')
    text = text.replace(up, f'<axis xyz="0 0 {axis}"/>')
    path = tmp_path / "bicycle.urdf"
    path.write_text(text)
    robot = ad.load_robot(path, controllers=folder / "bicycle_controllers.yaml")
    sim = ad.Simulation(ad.build_diagram(robot))

    twist = Twist(Vector3(x=0.3), Vector3(z=0.2))
    sim.topic("/base/reference").publish(TwistStamped(twist=twist))
    sim.run(2.0)

    turned = RollPitchYaw(sim.link_poses()["base_link"].rotation()).yaw_angle()
    assert (turned < 0.0) == goes_wrong
    found = [line for line in lines_of(robot) if "to the right" in line]
    start = "warning: controller 'base': a positive angle of 'steering_joint' turns "
    assert [line.startswith(start) for line in found] == [True] * goes_wrong
