"""Robots that SDF models describe."""

import math
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.description.sdf import convert_sdf, is_sdf
from arm_drake.errors import DescriptionError

BOX = "<geometry><box><size>0.4 0.2 0.1</size></box></geometry>"
DRIVE = """
<plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">
  <left_joint>left</left_joint><right_joint>right</right_joint>
  <wheel_separation>0.3</wheel_separation><wheel_radius>0.1</wheel_radius>
  <topic>cmd_vel</topic></plugin>"""


def wheel(name: str, y: float) -> str:
    """Return a wheel whose link is at the model's origin, all it has beside it."""
    place = f"<pose>0 {y} 0.1 -1.5707963267948966 0 0</pose>"
    return f"""
    <link name="{name}_wheel">
      <inertial>{place}<mass>0.5</mass>
        <inertia><ixx>0.002</ixx><iyy>0.002</iyy><izz>0.003</izz></inertia></inertial>
      <collision name="c">{place}<geometry><cylinder>
        <radius>0.1</radius><length>0.04</length></cylinder></geometry>
        <surface><friction><ode><mu>0.8</mu></ode></friction></surface></collision>
    </link>
    <joint name="{name}" type="revolute">
      <parent>base</parent><child>{name}_wheel</child>{place}
      <axis><xyz>0 0 1</xyz></axis></joint>"""


CART = f"""
  <model name="cart">
    <link name="base">
      <inertial><pose>0 0 0.12 0 0 0</pose><mass>4</mass>
        <inertia><ixx>0.02</ixx><iyy>0.06</iyy><izz>0.07</izz></inertia></inertial>
      <collision name="c"><pose>0 0 0.12 0 0 0</pose>{BOX}</collision>
      <sensor name="imu" type="imu"><pose>0 0 0.2 0 0 0</pose>
        <update_rate>50</update_rate><topic>imu</topic></sensor>
    </link>
    {wheel("left", 0.15)} {wheel("right", -0.15)}
    <link name="caster"><pose>-0.15 0 0.05 0 0 0</pose>
      <inertial><mass>0.1</mass>
        <inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial>
      <collision name="c"><geometry><sphere><radius>0.05</radius></sphere></geometry>
      </collision></link>
    <joint name="roll" type="ball"><parent>base</parent><child>caster</child></joint>
    <link name="lamp"><pose>0.15 0 0.05 0 0 0</pose>
      <inertial><mass>0.1</mass>
        <inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia></inertial>
      <collision name="c"><geometry><sphere><radius>0.05</radius></sphere></geometry>
        <surface><friction><ode><mu>0</mu></ode></friction></surface></collision></link>
    <joint name="hold" type="fixed"><parent>base</parent><child>lamp</child></joint>
    {DRIVE}
  </model>"""


def load(folder: Path, model: str, version: str = "1.8") -> ad.Robot:
    path = folder / "model.sdf"
    before = '<?xml version="1.0"?><!-- A robot. -->'
    path.write_text(f'{before}\n<sdf version="{version}">{model}</sdf>')
    return ad.load_robot(path)


def test_a_cart_in_an_sdf_file_drives(tmp_path: Path) -> None:
    robot = load(tmp_path, CART)
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.advance_to(0.5)
    start = simulation.link_poses()["base"].translation()

    simulation.topic("/cmd_vel").publish({"linear": {"x": 0.4}})
    simulation.advance_to(3.0)

    way = simulation.link_poses()["base"].translation() - start
    # It starts within 0.1 s, and slips by a few mm meanwhile.
    assert way == pytest.approx([0.4 * 2.5, 0.0, 0.0], abs=0.03)
    assert robot.has_free_base
    assert robot.description.friction["left_wheel"] == 0.8


def test_a_link_moves_about_its_joint(tmp_path: Path) -> None:
    robot = load(tmp_path, CART)

    wheel = robot.description.link("left_wheel")
    joint = next(j for j in robot.description.joints if j.name == "left")

    assert joint.type == "continuous"
    assert joint.origin.xyz == pytest.approx((0.0, 0.15, 0.1))
    assert joint.origin.rpy == pytest.approx((-math.pi / 2.0, 0.0, 0.0))
    # What was beside the link's frame is in the joint's.
    assert wheel.collisions[0].origin.xyz == pytest.approx((0.0, 0.0, 0.0))
    assert wheel.collisions[0].origin.rpy == pytest.approx((0.0, 0.0, 0.0))


def test_a_ball_is_told_as_what_slides(tmp_path: Path) -> None:
    robot = load(tmp_path, CART)

    assert robot.description.friction["caster"] == 0.0
    assert [str(e) for e in robot.report if "ball" in e.what] == [
        f"info: {tmp_path}/model.sdf: joint 'roll': a joint of type 'ball'; the joint "
        "is fixed, and its link slides without friction, as a ball rolls"
    ]


def test_comments_in_front_take_no_time() -> None:
    # With each one more it took twice as long: years.
    comments = "<!-- a -->" * 60

    assert not is_sdf(f"{comments}<!DOCTYPE robot><robot/>")
    assert is_sdf(f"<?xml version='1.0'?>{comments}<sdf/>")


FRAMES = """
  <model name="arm">
    <joint name="foot" type="fixed"><parent>world</parent><child>base</child></joint>
    <link name="base"/>
    <frame name="top" attached_to="base"><pose>0 0 1 0 0 90</pose></frame>
    <link name="tip"><pose relative_to="top">1 0 0 0 0 0</pose></link>
    <joint name="lift" type="prismatic"><parent>base</parent><child>tip</child>
      <pose relative_to="top" degrees="true">0 0 0 90 0 90</pose>
      <axis><xyz expressed_in="__model__">0 0 2</xyz>
        <limit><lower>-0.1</lower><upper>0.3</upper><effort>40</effort>
          <velocity>-1</velocity></limit><dynamics><damping>3</damping></dynamics>
      </axis></joint>
    <link name="hand"><pose relative_to="swing"/></link>
    <joint name="swing" type="revolute"><parent>base</parent><child>hand</child>
      <pose relative_to="__model__" rotation_format="quat_xyzw">
        0 2 0 0 0 0.7071067811865476 0.7071067811865476</pose>
      <axis><xyz>1 0 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis>
    </joint>
  </model>"""


def test_frames_are_those_of_sdf(tmp_path: Path) -> None:
    turned = FRAMES.replace("0 0 1 0 0 90<", "0 0 1 0 0 1.5707963267948966<")
    robot = load(tmp_path, turned, version="1.11")

    joints = {joint.name: joint for joint in robot.description.joints}
    lift, swing = joints["lift"], joints["swing"]

    assert lift.origin.xyz == pytest.approx((0.0, 0.0, 1.0))
    # Turned by a quarter about z with the frame, about x and about z again.
    expected = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    np.testing.assert_allclose(lift.origin.rotation, expected, atol=1e-9)
    np.testing.assert_allclose(
        lift.origin.rotation @ np.array(lift.axis), [0.0, 0.0, 1.0], atol=1e-9
    )
    assert (lift.limits.lower, lift.limits.upper) == (-0.1, 0.3)
    assert lift.limits.effort == 40.0
    assert lift.damping == 3.0
    assert swing.origin.xyz == pytest.approx((0.0, 2.0, 0.0))
    assert swing.origin.rpy == pytest.approx((0.0, 0.0, math.pi / 2.0))
    # Without a word of its inertia a link has 1 kg.
    assert robot.description.link("hand").inertial.mass == 1.0


SLIDE = """<model name="m"><link name="a"/><link name="b"/>
  <joint name="j" type="prismatic"><parent>a</parent><child>b</child>
  <axis><xyz>1 0 0</xyz>{}</axis></joint></model>"""


@pytest.mark.parametrize(
    ("limit", "lower", "upper"),
    [
        ("", None, None),
        ("<limit><effort>-1</effort><velocity>1e16</velocity></limit>", None, None),
        ("<limit><lower>-0.5</lower></limit>", -0.5, None),
        ("<limit><lower>-1e16</lower><upper>0.5</upper></limit>", None, 0.5),
    ],
)
def test_a_limit_that_is_not_given_is_none(
    tmp_path: Path, limit: str, lower: float | None, upper: float | None
) -> None:
    robot = load(tmp_path, SLIDE.format(limit))

    limits = robot.description.joints[0].limits
    assert (limits.lower, limits.upper) == (lower, upper)
    assert (limits.effort, limits.velocity) == (None, None)
    assert [entry for entry in robot.report if "limit" in entry.what] == []


def test_what_is_no_limit_or_no_direction_is_an_error(tmp_path: Path) -> None:
    model = SLIDE.format("<limit><upper>far</upper></limit>").replace("1 0 0", "0 0 0")

    found = [str(e).partition("model.sdf: ")[2] for e in load(tmp_path, model).report]

    assert found[:2] == [
        "joint 'j': axis: expected a direction x, y, z, got '0 0 0'; taken as 0 0 1",
        "joint 'j': limit upper: expected a number, got 'far'; taken as not given",
    ]


def test_what_is_no_friction_or_no_multiplier_is_an_error(tmp_path: Path) -> None:
    mimic = """<mimic joint="swing" axis="axis"><multiplier>twice</multiplier>
      </mimic></axis></joint>"""
    ground = """<collision name="c"><geometry><sphere><radius>0.1</radius></sphere>
      </geometry><surface><friction><ode><mu>high</mu></ode></friction></surface>
      </collision></link>"""
    model = FRAMES.replace("</axis></joint>", mimic, 1).replace("</link>", ground, 1)

    found = [str(entry) for entry in load(tmp_path, model, version="1.11").report]

    assert [
        line.partition("model.sdf: ")[2] for line in found if "expected" in line
    ] == [
        "link 'tip': friction mu: expected a number, got 'high'; taken as not given",
        "joint 'lift': mimic multiplier: expected a number, got 'twice'; "
        "taken as not given",
    ]


def test_joints_follow_others(tmp_path: Path) -> None:
    follower = """<mimic joint="swing" axis="axis"><multiplier>2</multiplier>
      <offset>0.5</offset><reference>0.1</reference></mimic></axis></joint>"""
    model = FRAMES.replace("</axis></joint>", follower, 1)

    joints = load(tmp_path, model, version="1.11").description.joints

    (mimic,) = [joint.mimic for joint in joints if joint.name == "lift"]
    assert mimic is not None
    # 2 (q - 0.1) + 0.5
    assert (mimic.joint, mimic.multiplier) == ("swing", 2.0)
    assert mimic.offset == pytest.approx(0.3)


def test_joints_connect_frames_too(tmp_path: Path) -> None:
    model = """<model name="m"><link name="a"/><link name="b"><pose>0 0 1 0 0 0</pose>
      </link><frame name="top" attached_to="a"><pose>0 0 2 0 0 0</pose></frame>
      <frame name="axle" attached_to="b"><pose>0.5 0 0 0 0 0</pose></frame>
      <joint name="j" type="revolute"><parent>top</parent><child>axle</child>
      <axis><xyz>1 0 0</xyz></axis></joint></model>"""

    (joint,) = load(tmp_path, model).description.joints

    assert (joint.parent, joint.child) == ("a", "b")
    # The joint is where the frame of its child is.
    assert joint.origin.xyz == pytest.approx((0.5, 0.0, 1.0))


def test_long_chains_of_poses_are_read_or_refused(tmp_path: Path) -> None:
    links = [
        "".join(
            f"""<link name="l{i}"><pose relative_to="l{i - 1}">0 0 0.1 0 0 0</pose>
        </link><joint name="j{i}" type="fixed">
        <parent>l{i - 1}</parent><child>l{i}</child></joint>"""
            for i in order
        )
        for order in (range(1, 400), range(399, 0, -1))
    ]

    robots = [f'<model name="m"><link name="l0"/>{each}</model>' for each in links]

    last = load(tmp_path, robots[0]).description.joint("j399")
    assert last.origin.xyz == pytest.approx((0.0, 0.0, 0.1))
    with pytest.raises(DescriptionError, match="more than 300 poses are relative"):
        load(tmp_path, robots[1])


def test_axes_of_old_files_are_in_the_model(tmp_path: Path) -> None:
    model = """<model name="m"><link name="a"/><link name="b"/>
      <joint name="j" type="revolute"><parent>a</parent><child>b</child>
      <pose>0 0 0 0 0 1.5707963267948966</pose>
      <axis><xyz>1 0 0</xyz></axis></joint></model>"""

    axes = [load(tmp_path, model, v).description.joints[0].axis for v in ("1.4", "1.6")]

    assert axes[0] == pytest.approx((0.0, -1.0, 0.0))
    assert axes[1] == pytest.approx((1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("version", "found"),
    [("", "no version"), ("1.9.2", "the version '1.9.2'"), ("2", "the version '2'")],
)
def test_a_file_needs_a_version(tmp_path: Path, version: str, found: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        load(tmp_path, '<model name="m"><link name="a"/></model>', version)

    expected = f'<sdf> has {found}; expected such as version="1.9"'
    assert str(caught.value) == f"{tmp_path}/model.sdf: {expected}"


def test_further_models_springs_and_lost_shapes_are_told(tmp_path: Path) -> None:
    shape = "<collision name='c'><geometry><plane/></geometry></collision>"
    stiff = "<dynamics><spring_stiffness>3</spring_stiffness></dynamics>"
    model = SLIDE.format(stiff).replace('name="a"/>', f'name="a">{shape}</link>')

    found = [
        str(entry).replace(f"{tmp_path}/model.sdf: ", "")
        for entry in load(tmp_path, f'{model}<model name="n"/>').report
    ]

    assert found[:3] == [
        "warning: models 'n'; the file's first, 'm', is the robot",
        "error: link 'a': geometry <plane> of collision 'c'; it is left out",
        "warning: joint 'j': <spring_stiffness> of the axis; it is left out",
    ]


@pytest.mark.parametrize("yes", ["true", "1"])
def test_what_is_true_may_be_a_number(tmp_path: Path, yes: str) -> None:
    model = f"""<model name="m"><link name="a"/><link name="b"/>
      <joint name="j" type="revolute"><parent>a</parent><child>b</child>
      <pose degrees="{yes}">0 0 0 0 0 90</pose><axis><xyz>1 0 0</xyz>
      <use_parent_model_frame>{yes}</use_parent_model_frame></axis></joint></model>"""

    (joint,) = load(tmp_path, model, "1.6").description.joints

    assert joint.origin.rpy == pytest.approx((0.0, 0.0, math.pi / 2.0))
    assert joint.axis == pytest.approx((0.0, -1.0, 0.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '<world name="w"/>',
            "<sdf>: expected a robot's <model>, got a <world>, which --world takes",
        ),
        ("", "<sdf>: expected a robot's <model>"),
        (
            '<model name="m"><include><uri>model://arm</uri></include></model>',
            "model 'm' has no <link> of its own; expected a robot's links",
        ),
        (
            '<model name="m"><link name="a"><pose relative_to="tpo"/></link>'
            '<frame name="top"/></model>',
            "model 'm': no link, joint or frame 'tpo'; did you mean 'top'? "
            "known: a, top",
        ),
        (
            '<model name="m"><link name="a"><pose relative_to="f"/></link>'
            '<frame name="f" attached_to="a"/></model>',
            "model 'm': the pose of 'a' is relative to itself",
        ),
        (
            '<model name="m"><link name="a"/><joint name="j" type="fixed">'
            "<parent>a</parent><child>c</child></joint></model>",
            "joint 'j': no link or frame 'c'; known: a",
        ),
        (
            '<model name="m"><link name="a"/><joint name="j" type="fixed"><parent>a'
            '</parent><child>n::c</child></joint><model name="n"><link name="c"/>'
            "</model></model>",
            "joint 'j': no link or frame 'n::c': models in the model and includes are "
            "left out",
        ),
        (
            '<model name="m"><link name="a"/><joint name="j" type="fixed"><parent>f'
            '</parent><child>a</child></joint><frame name="f" attached_to="g"/>'
            '<frame name="g" attached_to="f"/></model>',
            "joint 'j': frame 'f' is attached to itself",
        ),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        load(tmp_path, text)

    assert str(caught.value) == f"{tmp_path}/model.sdf: {message}"


def chain(num_links: int) -> str:
    """Return a model whose links have poses relative to the one before."""
    text = '<link name="l0"/>'
    for i in range(1, num_links):
        pose = f'<pose relative_to="l{i - 1}">0 0 0.1 0 0 0</pose>'
        text += f"""<link name="l{i}">{pose}</link><joint name="j{i}" type="fixed">
            <parent>l{i - 1}</parent><child>l{i}</child></joint>"""
    return f'<model name="m">{text}</model>'


def test_long_chains_of_poses_are_followed(tmp_path: Path) -> None:
    path = tmp_path / "chain.sdf"

    text = convert_sdf(
        f'<sdf version="1.9">{chain(300)}</sdf>',
        path,
        LoadReport(),
        lambda address, folder: None,
    )

    assert text.count("0 0 0.1") == 299


def test_a_text_is_told_from_sdf_behind_many_comments() -> None:
    comments = "<!-- a line -->\n" * 500

    assert is_sdf(f'<?xml version="1.0"?>{comments}<sdf version="1.9"/>')
    # What may stand in several places takes for ever here.
    assert not is_sdf(f"{comments}<!DOCTYPE sdf>")


@pytest.mark.parametrize("axis", ["1 0", "0 0 0", "nan 0 1", "inf 0 0", "one 0 0"])
def test_an_axis_that_is_none_is_told(tmp_path: Path, axis: str) -> None:
    model = f"""<model name="m"><link name="a"/><link name="b"/>
      <joint name="j" type="revolute"><parent>a</parent><child>b</child>
        <axis><xyz>{axis}</xyz><limit><lower>low</lower><upper>nan</upper></limit>
        </axis></joint></model>"""

    robot = load(tmp_path, model)

    told = f"joint 'j': axis: expected a direction x, y, z, got {axis!r}"
    assert f"{told}; taken as 0 0 1" in str(robot.report)
    for key, text in (("lower", "low"), ("upper", "nan")):
        told = f"limit {key}: expected a number, got {text!r}; taken as not given"
        assert told in str(robot.report)
    assert robot.description.joints[0].axis == pytest.approx((0.0, 0.0, 1.0))


def test_what_urdf_has_no_words_for_is_reported(tmp_path: Path) -> None:
    model = """<model name="m"><link name="a"><gravity>false</gravity>
      <inertial auto="true"/>
      <collision name="hill"><geometry><heightmap/></geometry></collision></link>
      <link name="b"/><model name="n"><link name="c"/></model>
      <joint name="j" type="screw"><parent>a</parent><child>b</child></joint></model>"""

    found = [str(e).partition("model.sdf: ")[2] for e in load(tmp_path, model).report]

    assert "link 'a': <inertial auto>; its mass is 1 kg" in found
    assert "<model> in the model; it is left out" in " ".join(found)
    assert "link 'a': geometry <heightmap> of collision 'hill'; it is left out" in found
    assert "joint 'j': a joint of type 'screw'; the joint is fixed" in found
    assert "link 'a': <gravity> is 'false'; it has its weight here" in found


def test_a_base_beside_the_model_is_told(tmp_path: Path) -> None:
    model = '<model name="m"><link name="a"><pose>0 0 0.2 0 0 0</pose></link></model>'

    loose = model.replace("<link", '<link name="b"/><link', 1)

    (told,) = [e for e in load(tmp_path, model).report if "model" in e.what]
    (moved,) = [e for e in load(tmp_path, loose).report if "model" in e.what]

    assert str(told) == (
        f"info: {tmp_path}/model.sdf: link 'a': the base is at 0 0 0.2 0 0 0 in the "
        "model; a pose of the robot is that of the base, not of the model"
    )
    assert str(moved) == (
        f"warning: {tmp_path}/model.sdf: link 'a': at 0 0 0.2 0 0 0 in the model, "
        "where no joint holds it; it is put where the robot's pose is"
    )
