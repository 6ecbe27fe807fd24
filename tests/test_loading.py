"""load_robot: files on the disk become a Robot, or one located message."""

import contextlib
import math
import os
import pickle
import random
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from pydrake.multibody.parsing import Parser

import arm_drake as ad
from arm_drake.description import entry
from arm_drake.description.entry import bundled_robots, configs_folder, models_folder
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.plant import plant as plant_module
from tests.models import TWO_LINKS, load, trajectory_controllers

KNOWN_ROBOTS = ", ".join(bundled_robots())

JTC = "joint_trajectory_controller/JointTrajectoryController"

# A turning joint with mass behind it.
XACRO = "http://www.ros.org/wiki/xacro"

ARM = """\
<robot name="arm">
  <link name="world"/>
  <link name="a">
    <inertial>
      <mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
  </link>
  <joint name="j" type="revolute">
    <parent link="world"/><child link="a"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="2" effort="3" velocity="4"/>
  </joint>
  {more}
</robot>
"""

CONTROLLERS = """\
controller_manager:
  ros__parameters:
    update_rate: 100
    arm:
      type: joint_trajectory_controller/JointTrajectoryController
arm:
  ros__parameters:
    joints: {joints}
    command_interfaces: {interfaces}
    state_interfaces: [position]
    {more}
"""


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    for name in ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory):
    """Return the folder in which meshes are converted once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def package(tmp_path):
    """Return a package with an arm, below folders of its own."""
    folder = tmp_path / "1" / "2" / "arm"
    write(folder / "package.xml", "<package><name>arm</name></package>")
    write(folder / "urdf" / "arm.urdf", ARM.format(more=""))
    return folder


def write(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def arm_with(package: Path, more: str) -> Path:
    return write(package / "urdf" / "arm.urdf", ARM.format(more=more))


def controllers_with(
    package: Path, more: str = "", joints: str = "[j]", interfaces: str = "[position]"
) -> Path:
    text = CONTROLLERS.format(joints=joints, interfaces=interfaces, more=more)
    return write(package / "config" / "controllers.yaml", text)


def problem(*args: Any, **kwargs: Any) -> str:
    with pytest.raises(ArmDrakeError) as caught:
        ad.load_robot(*args, **kwargs)
    return str(caught.value)


def lines(robot: ad.Robot) -> list[str]:
    """Return the report but for the hardware, which a bare URDF doesn't have."""
    what = "the description has no <ros2_control>"
    return [str(entry) for entry in robot.report if entry.what != what]


def plugin(*texts: str) -> str:
    fields = "".join(f"<parameters>{text}</parameters>" for text in texts)
    file = "libgz_ros2_control-system.so"
    return f'<gazebo><plugin name="p" filename="{file}">{fields}</plugin></gazebo>'


def initial(value: object) -> str:
    return (
        '<ros2_control name="h" type="system"><joint name="j">'
        '<command_interface name="position"/><state_interface name="position">'
        f'<param name="initial_value">{value}</param></state_interface></joint>'
        "</ros2_control>"
    )


# Sources


def test_a_bundled_robot_is_loaded_by_its_name_without_a_report_line():
    robot = ad.load_robot("doosan_a0912")

    assert robot.name == "a0912"
    assert robot.bundled == "doosan_a0912"
    assert [c.name for c in robot.controllers.controllers] == [
        "joint_state_broadcaster",
        "joint_trajectory_controller",
        "end_effector_sensor",
    ]
    assert lines(robot) == []
    assert robot.pose is None
    assert robot.distro == "jazzy"


def test_a_file_is_loaded(package):
    robot = ad.load_robot(package / "urdf" / "arm.urdf")

    assert robot.name == "arm"
    assert robot.bundled is None
    assert robot.description.file == package / "urdf" / "arm.urdf"


@pytest.mark.parametrize("suffix", [".urdf", ".xacro", ".URDF", ".xml", ".xacro.urdf"])
def test_a_description_may_have_any_of_the_usual_suffixes(tmp_path, suffix):
    path = write(tmp_path / f"arm{suffix}", ARM.format(more=""))

    assert ad.load_robot(str(path)).name == "arm"


def test_a_relative_path_becomes_an_absolute_one(package, monkeypatch):
    monkeypatch.chdir(package)

    robot = ad.load_robot("urdf/arm.urdf")

    assert robot.description.file == package / "urdf" / "arm.urdf"


def test_a_folder_with_one_robot_is_loaded(package):
    macros = '<robot xmlns:xacro="x" name="m"><xacro:macro name="a"/></robot>'
    write(package / "urdf" / "macros.xacro", macros)
    write(package / "urdf" / "unnamed.urdf", "<robot/>")
    (package / "folder.urdf").mkdir()

    assert ad.load_robot(package).description.file == package / "urdf" / "arm.urdf"


def test_a_file_of_macros_that_includes_the_links_is_a_robot_if_no_other_is(package):
    (package / "urdf" / "arm.urdf").unlink()
    inside = '<xacro:macro name="a"/><xacro:include filename="core.xacro"/>'
    text = f'<robot xmlns:xacro="{XACRO}" name="arm">{inside}</robot>'
    write(package / "urdf" / "arm.urdf.xacro", text)
    core = '<robot><link name="base"/></robot>'
    write(package / "urdf" / "core.xacro", core)

    assert ad.load_robot(package).description.links == ("base",)


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:macro name="hand"><link name="palm"/></xacro:macro>',
        '<!-- <link name="palm"/> --><xacro:arg name="a" default=""/>',
        '<xacro:include filename="more.xacro"/><xacro:property name="p" value="1"/>'
        '<xacro:macro name="hand"><link name="palm"/></xacro:macro>'
        '<xacro:macro name="foot"><xacro:hand/></xacro:macro>',
    ],
)
def test_a_named_file_of_macros_is_no_robot(package, inside):
    macros = f'<robot xmlns:xacro="{XACRO}" name="hand">{inside}</robot>'
    write(package / "urdf" / "hand.urdf.xacro", macros)
    (package / "urdf" / "arm.urdf").rename(package / "urdf" / "a.urdf")

    assert ad.load_robot(package).description.file == package / "urdf" / "a.urdf"


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:macro name="hand"><link name="palm"/></xacro:macro><xacro:hand/>',
        '<xacro:macro name="hand" params="a"/><link name="palm"/>',
        '<xacro:include filename="hand.xacro"/>',
    ],
)
@pytest.mark.parametrize("name", ['name="hand"', ""])
def test_a_file_that_calls_macros_or_includes_links_is_a_robot(package, name, inside):
    if not name:
        inside = f'<xacro:attribute name="name" value="hand"/>{inside}'
    calls = f'<robot xmlns:xacro="{XACRO}" {name}>{inside}</robot>'
    write(package / "urdf" / "hand.urdf.xacro", calls)
    (package / "urdf" / "arm.urdf").rename(package / "urdf" / "a.urdf")

    assert problem(package).endswith(
        "got 2; name the file: urdf/a.urdf, urdf/hand.urdf.xacro"
    )


def test_of_several_robots_in_a_folder_the_one_of_its_name_is_loaded(package):
    write(package / "urdf" / "leg.urdf", ARM.format(more=""))

    assert ad.load_robot(package).description.file == package / "urdf" / "arm.urdf"


def test_a_folder_with_two_robots_names_them(package):
    (package / "urdf" / "arm.urdf").rename(package / "urdf" / "a.urdf")
    write(package / "urdf" / "b.xacro", ARM.format(more=""))

    assert problem(package) == (
        f"{package}: expected one robot description in the folder, got 2; "
        "name the file: urdf/a.urdf, urdf/b.xacro"
    )


def test_of_files_that_include_each_other_the_outermost_is_loaded(package):
    (package / "urdf" / "arm.urdf").rename(package / "urdf" / "a.urdf")
    include = '<xacro:include filename="$(find {})/urdf/{}" ns="a"/>'
    outer = include.format(package.name, "a.urdf") + "<!-- " + include + " -->"
    write(
        package / "urdf" / "b.xacro",
        f'<robot xmlns:xacro="{XACRO}" name="b">{outer.format(package.name, "c")}'
        "</robot>",
    )

    assert ad.load_robot(package).description.file == package / "urdf" / "b.xacro"

    write(package / "urdf" / "c.xacro", ARM.format(more=""))
    assert problem(package).endswith("got 2; name the file: urdf/b.xacro, urdf/c.xacro")


def test_a_folder_without_a_robot_is_an_error(tmp_path):
    assert problem(tmp_path) == (
        f"{tmp_path}: no robot description (.urdf, .xacro) in the folder"
    )


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            "doosan_a0921",
            "unknown robot 'doosan_a0921': neither a bundled robot nor a file or "
            f"folder; did you mean 'doosan_a0912'? known: {KNOWN_ROBOTS}",
        ),
        (
            "a\0b",
            "unknown robot 'a\\x00b': neither a bundled robot nor a file or folder; "
            f"known: {KNOWN_ROBOTS}",
        ),
        ("nope.urdf", "nope.urdf: no such file or folder"),
        ("nope/nope", "nope/nope: no such file or folder; there is no folder 'nope'"),
        (Path("nope.urdf"), "nope.urdf: no such file or folder"),
        ("n" * 5000 + ".urdf", "n" * 5000 + ".urdf: no such file or folder"),
    ],
)
def test_a_source_that_isnt_there_is_an_error(source, message):
    assert problem(source) == message


def test_the_text_of_a_description_is_loaded():
    robot = ad.load_robot(f"\n  {ARM.format(more='')}")

    assert robot.name == "arm"
    assert [joint.name for joint in robot.description.movable_joints] == ["j"]
    assert robot.source_files == ()
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)
    assert sim.rollout().joint_names == ("j",)


@pytest.mark.parametrize("is_file", [True, False])
def test_prefixes_that_nobody_declares_are_no_mistake_as_for_ros(tmp_path, is_file):
    limit = 'lower="-1" drake:acceleration="2"'
    group = '<drake:group name="g"/><!-- <a:b/> http://c.d -->'
    text = ARM.replace('lower="-1"', limit).format(more=group)
    text = f"<!-- made by xacro from <robot> -->\n<!DOCTYPE robot>\n{text}"
    file = tmp_path / "arm.urdf"
    file.write_text(text)

    robot = ad.load_robot(file if is_file else text)

    assert robot.description.joint("j").limits.range == (-1.0, 2.0)


@pytest.mark.parametrize(
    "elsewhere", ["<!-- xmlns:s='u' -->", "<gazebo><s:a xmlns:s='u'/></gazebo>"]
)
def test_a_prefix_that_is_declared_elsewhere_alone_is_no_mistake(elsewhere):
    robot = ad.load_robot(ARM.format(more=f"{elsewhere}<gazebo><s:b/></gazebo>"))

    assert robot.description.movable_joints[0].name == "j"


@pytest.mark.parametrize("is_given", [True, False])
def test_a_text_finds_its_meshes_in_the_package_paths_or_here(
    tmp_path, monkeypatch, is_given
):
    ball = models_folder() / "teslabot" / "meshes"
    mesh = min(ball.glob("*.STL"))
    shutil.copy(mesh, tmp_path / mesh.name)
    more = f"<visual><geometry><mesh filename='{mesh.name}'/></geometry></visual>"
    text = ARM.format(more="").replace("</inertial>", f"</inertial>{more}")
    if not is_given:
        monkeypatch.chdir(tmp_path)

    robot = ad.load_robot(text, package_paths=[tmp_path] if is_given else [])

    assert robot.source_files == (tmp_path / mesh.name,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "<robot",
            "<robot_description>:1: malformed XML: the file ends inside a tag; is it "
            "complete?",
        ),
        ("<a/>", "<robot_description>: the root element is <a>; expected <robot>"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"/>',
            "<robot_description>: a text is expanded already; expected the xacro file "
            "itself",
        ),
    ],
)
def test_a_text_that_is_no_description_is_an_error(
    text, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)

    with pytest.raises(ArmDrakeError) as caught:
        ad.load_robot(text)

    assert str(caught.value) == f"{tmp_path}/{message}"


def test_another_file_is_no_description(tmp_path):
    path = write(tmp_path / "arm.yaml", "")

    assert problem(path) == (
        f"{path}: expected a .urdf, .xacro, .xml, .sdf file, or a package folder"
    )


@pytest.mark.parametrize(
    "name",
    ["arm.launch.py", "arm_launch.py", "arm.launch.xml", "arm.launch.yaml", "a.launch"],
)
def test_a_launch_file_is_no_robot(tmp_path, name):
    path = write(tmp_path / name, "<launch/>")

    assert problem(path) == (
        f"{path}: expected a robot, got a launch file, which `arm-drake launch` and "
        "load_launch take"
    )


def test_a_file_of_macros_is_no_robot(tmp_path):
    path = write(
        tmp_path / "arm.xacro",
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="arm">'
        '<link name="a"/></xacro:macro></robot>',
    )

    assert problem(path) == (
        f"{path}: no robot was instantiated: the file has no <link>; a file that only "
        "defines macros needs one that calls them"
    )


# Arguments


@pytest.mark.slow
def test_arguments_of_one_load_dont_reach_the_next():
    arguments = {"hardware": "mock_components/GenericSystem"}
    mock = ad.load_robot("doosan_a0912", xacro_args=arguments)
    usual = ad.load_robot("doosan_a0912")

    assert "mock_components/GenericSystem" in mock.description.source
    assert "mock_components/GenericSystem" not in usual.description.source


def test_the_name_can_be_given():
    assert ad.load_robot("doosan_a0912", name="left").name == "left"


def test_a_package_path_is_searched_first(package, tmp_path):
    text = plugin("package://other/c.yaml")
    write(tmp_path / "far" / "other" / "package.xml", "<name>other</name>")
    write(tmp_path / "far" / "other" / "c.yaml", controllers_with(package).read_bytes())

    robot = ad.load_robot(arm_with(package, text), package_paths=[tmp_path / "far"])

    assert [c.name for c in robot.controllers.controllers] == ["arm"]


def test_a_package_path_that_isnt_there_is_an_error():
    message = problem("doosan_a0912", package_paths=["nope"])

    assert message == "nope: no such folder; expected one to search"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("source", 3, "a name, a path or the text of a URDF"),
        ("source", None, "a name, a path or the text of a URDF"),
        ("controllers", 3, "a path or a list of paths"),
        ("srdf", [3], "a path or a list of paths"),
        ("package_paths", None, "a path or a list of paths"),
        ("xacro_args", ["a:=1"], "values by name"),
        ("variables", "a=1", "values by name"),
        ("initial_positions", [0.0], "positions by joint [rad] or [m]"),
        ("frames", ["tcp"], "a link and a pose by name"),
        ("pose", "1 2 3", "x, y, z [m], roll, pitch, yaw [rad]"),
        ("distro", None, "a name"),
        ("name", 3, "a name"),
        ("pose", 1.0, "x, y, z [m], roll, pitch, yaw [rad]"),
        ("max_faces", "all", "an integer"),
    ],
)
def test_an_argument_of_another_type_is_named(name, value, expected):
    arguments = {"source": "doosan_a0912", name: value}

    with pytest.raises(InputError) as caught:
        ad.load_robot(**arguments)

    got = value[0] if name == "srdf" else value
    assert str(caught.value) == f"{name}: expected {expected}, got {got!r}"


def test_paths_may_come_one_by_one(tmp_path):
    file = tmp_path / "controllers.yaml"
    file.write_text(trajectory_controllers({"arm": ["joint1"]}))

    robot = ad.load_robot(
        "doosan_a0912",
        controllers=tmp_path.glob("*.yaml"),
        package_paths={str(tmp_path)},
    )

    # Beside what a sensor of the description makes.
    assert "arm" in [controller.name for controller in robot.controllers.controllers]


@pytest.mark.parametrize("distro", ["humble", "kilted", "rolling"])
def test_a_known_distro_is_kept_and_reported(distro):
    robot = ad.load_robot("doosan_a0912", distro=distro)

    assert robot.distro == distro
    assert lines(robot) == [
        f"warning: distro {distro!r}; parameters and defaults are its own, behaviour "
        "is jazzy's"
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distro", "taken"),
    [
        ("lyrical", "rolling"),
        ("foxy", "humble"),
        ("galactic", "humble"),
        ("iron", "humble"),
    ],
)
def test_another_distro_is_taken_as_its_nearest(distro, taken):
    assert ad.load_robot("doosan_a0912", distro=distro).distro == taken


def test_an_unknown_distro_is_an_error():
    assert problem("doosan_a0912", distro="jazy") == (
        "unknown distro 'jazy'; did you mean 'jazzy'? "
        "known: humble, jazzy, kilted, rolling"
    )


def test_a_pose_is_six_numbers():
    robot = ad.load_robot("doosan_a0912", pose=[1, 2, 3, 0.1, 0.2, 0.3])

    assert robot.pose == (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ([1, 2], "pose: expected x, y, z [m], roll, pitch, yaw [rad], got [1, 2]"),
        ([0, 0, 0, 0, 0, "x"], "pose: expected a finite number, got 'x'"),
        ([0, 0, math.nan, 0, 0, 0], "pose: expected a finite number, got nan"),
        ([10**400, 0, 0, 0, 0, 0], f"pose: expected a finite number, got {10**400}"),
    ],
)
def test_another_pose_is_an_error(pose, message):
    assert problem("doosan_a0912", pose=pose) == message


@pytest.mark.slow
def test_strict_turns_warnings_into_an_error(package):
    file = package / "urdf" / "arm.urdf"

    assert problem(file, strict=True, initial_positions={"j": 9.0}) == (
        "not everything was taken as written:\n"
        f"warning: {file}:8: joint 'j': initial position 9.0 is outside [-1.0, 2.0]; "
        "it starts at 2.0"
    )


def test_strict_takes_what_makes_no_difference(package):
    """A plain description says nothing of controllers: that is no fault of it."""
    robot = ad.load_robot(package / "urdf" / "arm.urdf", strict=True)

    assert [entry.severity for entry in robot.report] == ["info", "info"]


# Initial positions


def test_joints_start_at_zero(package):
    assert ad.load_robot(package).initial_positions == {"j": 0.0}


def test_joints_start_at_their_initial_value(package):
    arm_with(package, initial(0.5))

    assert ad.load_robot(package).initial_positions == {"j": 0.5}


def test_a_given_position_wins_over_the_initial_value(package):
    arm_with(package, initial(0.5))

    robot = ad.load_robot(package, initial_positions={"j": -0.5})

    assert robot.initial_positions == {"j": -0.5}


@pytest.mark.parametrize(("value", "clamped"), [(5.0, 2.0), (-5.0, -1.0)])
def test_a_start_outside_the_limits_is_clamped_and_reported(package, value, clamped):
    file = arm_with(package, initial(value))

    robot = ad.load_robot(package)

    assert robot.initial_positions == {"j": clamped}
    assert lines(robot)[-1] == (
        f"warning: {file}:8: joint 'j': initial position {value} is outside "
        "[-1.0, 2.0]; "
        f"it starts at {clamped}"
    )


def test_a_mimic_joint_starts_where_its_master_says(package):
    def follower(name: str, master: str, multiplier: float, offset: float) -> str:
        return (
            f'<link name="{name}_link"/><joint name="{name}" type="continuous">'
            f'<parent link="a"/><child link="{name}_link"/>'
            f'<mimic joint="{master}" multiplier="{multiplier}" offset="{offset}"/>'
            "</joint>"
        )

    arm_with(package, follower("l", "k", 3, 0) + follower("k", "j", -2, 0.5))

    robot = ad.load_robot(package, initial_positions={"j": 1.0})

    assert robot.initial_positions == {"j": 1.0, "k": -1.5, "l": -4.5}


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (
            {"elbow": 0.0},
            "initial position of joint 'elbow': the robot has no such joint; "
            "known: joint1, joint2, joint3, joint4, joint5, joint6",
        ),
        ({"joint1": math.nan}, "joint 'joint1': expected a finite number, got nan"),
        ({"joint1": "up"}, "joint 'joint1': expected a finite number, got 'up'"),
        (
            {"joint1": 10**400},
            f"joint 'joint1': expected a finite number, got {10**400}",
        ),
    ],
)
def test_a_bad_initial_position_is_an_error(positions, message):
    assert problem("doosan_a0912", initial_positions=positions) == message


# Controllers


def test_given_controllers_are_loaded_one_or_several(package):
    file = controllers_with(package)
    other = write(package / "b.yaml", "arm: {ros__parameters: {cmd_timeout: 2.0}}")

    one = ad.load_robot(package, controllers=file)
    two = ad.load_robot(package, controllers=[str(file), other])

    assert one.controllers.files == (file,)
    assert two.controllers.files == (file, other)
    assert two.controllers.controllers[0].parameters["cmd_timeout"].value == 2.0


@pytest.mark.parametrize(
    "uri", ["../config/controllers.yaml", "package://arm/config/controllers.yaml"]
)
def test_the_controllers_named_in_the_plugin_tag_are_loaded(package, uri):
    arm_with(package, plugin(uri, uri, ""))
    file = controllers_with(package)
    controllers_with(package / "more")

    assert ad.load_robot(package).controllers.files == (file,)


def test_the_one_file_in_the_packages_config_folder_is_loaded(package):
    file = controllers_with(package)
    write(package / "config" / "rviz.yaml", "panels: []")
    (package / "config" / "folder.yaml").mkdir()

    assert ad.load_robot(package).controllers.files == (file,)


def test_a_file_with_a_manager_comes_before_one_for_all_nodes(package):
    file = controllers_with(package)
    more = "/**:\n  ros__parameters:\n    beat:\n      type: some_plugins/Beat\n"
    write(package / "config" / "plugins.yaml", more)

    assert ad.load_robot(package).controllers.files == (file,)


def test_the_one_file_that_is_installed_in_the_config_folder_is_loaded(package):
    name = re.search(r"<name>(.*?)</name>", (package / "package.xml").read_text())
    bringup = "install(DIRECTORY bringup/config DESTINATION share/${PROJECT_NAME})"
    write(package / "CMakeLists.txt", f"project({name[1]})\n{bringup}\n")
    file = controllers_with(package / "bringup")

    robot = ad.load_robot(package)

    assert robot.controllers.files == (file,)
    assert lines(robot) == []


def test_of_two_files_in_the_config_folder_none_is_taken_and_both_are_named(package):
    file = controllers_with(package)
    other = write(package / "config" / "more" / "b.yml", file.read_bytes())

    robot = ad.load_robot(package)

    assert robot.controllers.files == ()
    assert lines(robot) == [
        f"warning: {package / 'urdf' / 'arm.urdf'}: the description names no "
        f"controllers YAML; candidates: {file}, {other}; no controller runs; "
        "--controllers FILE gives one"
    ]


@pytest.mark.parametrize(
    "other",
    [
        "controller_manager: {ros__parameters: {update_rate: 500}}",
        "controller_manager: {ros__parameters: {hand: {type: "
        "position_controllers/GripperActionController}}}\n"
        "hand: {ros__parameters: {joint: finger}}",
    ],
)
def test_of_two_files_the_one_with_controllers_of_the_joints_is_taken(package, other):
    file = controllers_with(package)
    left = write(package / "config" / "z.yaml", other)

    robot = ad.load_robot(package)

    assert robot.controllers.files == (file,)
    assert lines(robot) == [
        f"info: {package / 'urdf' / 'arm.urdf'}: the description names no controllers "
        f"YAML; others: {left}; taken: {file}, the only one with controllers of its "
        "joints"
    ]


def test_a_file_whose_joints_a_launch_file_names_is_a_candidate(package):
    hardware = '<ros2_control name="h" type="system"><joint name="j"/></ros2_control>'
    arm_with(package, hardware)
    file = write(
        package / "config" / "c.yaml",
        "arm: {ros__parameters: {type: joint_trajectory_controller/"
        "JointTrajectoryController, joints: [$(var prefix)1]}}",
    )

    (line,) = (line for line in lines(ad.load_robot(package)) if "candidates" in line)

    assert f"candidates: {file}; no controller runs" in line


@pytest.mark.parametrize("uri", ["nope.yaml", ".", "file:///nope/%20.yaml", "n" * 5000])
def test_a_missing_parameters_file_is_reported(package, uri):
    file = arm_with(package, plugin(uri))

    robot = ad.load_robot(package)

    assert robot.controllers.files == ()
    assert lines(robot) == [
        f"error: {file}: <parameters>: {uri!r} does not exist; "
        "its controllers are left out"
    ]


def test_candidates_are_named_for_a_missing_parameters_file(package):
    # A launch file puts the path in, which nobody does here.
    file = arm_with(package, plugin("CONTROLLERS"))
    controllers = controllers_with(package)

    robot = ad.load_robot(package)

    assert robot.controllers.files == ()
    assert lines(robot)[0] == (
        f"error: {file}: <parameters>: 'CONTROLLERS' does not exist; its controllers "
        f"are left out; --controllers FILE gives others; candidates: {controllers}"
    )


def test_files_that_other_tags_name_are_no_candidates(package):
    tags = "".join(
        f"<parameters>{name}</parameters>"
        for name in ("nowhere.yaml", "../config/controllers.yaml", "empty.yaml")
    )
    text = f'<gazebo><plugin filename="gz_ros2_control-system">{tags}</plugin></gazebo>'
    file = arm_with(package, text)
    controllers = controllers_with(package)
    write(file.parent / "empty.yaml", "# Nothing yet.\n")

    robot = ad.load_robot(package)

    assert robot.controllers.files == (controllers,)
    assert lines(robot)[:2] == [
        f"error: {file}: <parameters>: {problem}; its controllers are left out"
        for problem in (
            "'nowhere.yaml' does not exist",
            "'empty.yaml' is no ROS 2 parameter file, it has no ros__parameters",
        )
    ]


@pytest.mark.parametrize(
    "uri",
    [
        "/home/nobody/ws/src/arm/config/controllers.yaml",
        "file:///home/nobody/arm/config/controllers.yaml",
        "config/controllers.yaml",
    ],
)
def test_a_file_that_lies_elsewhere_in_the_package_is_found(package, uri):
    entry_file = arm_with(package, plugin(uri))
    file = controllers_with(package)

    robot = ad.load_robot(package)

    assert robot.controllers.files == (file,)
    assert lines(robot)[0] == (
        f"warning: {entry_file}: <parameters>: {uri!r} does not exist; taken from "
        f"{str(file)!r}"
    )


def test_a_file_of_ros_1_is_left_out_and_reported(package):
    file = arm_with(package, plugin("../config/arm.yaml"))
    write(package / "config" / "arm.yaml", "arm: {type: position_controllers/X}")

    robot = ad.load_robot(package)

    assert robot.controllers.files == ()
    assert lines(robot)[0] == (
        f"error: {file}: <parameters>: '../config/arm.yaml' is no ROS 2 parameter "
        "file, it has no ros__parameters; its controllers are left out"
    )


def test_files_of_other_managers_are_no_candidates(package):
    file = controllers_with(package)
    moveit = "moveit_controller_manager: a/B\n# see ros__parameters\n"
    write(package / "config" / "moveit_controllers.yaml", moveit)

    assert ad.load_robot(package).controllers.files == (file,)


def test_files_of_other_packages_are_named_as_candidates(package):
    hardware = '<ros2_control name="h" type="system"><joint name="j"/></ros2_control>'
    arm_with(package, hardware)
    bringup = package.parent / "bringup"
    write(bringup / "package.xml", "<package><name>bringup</name></package>")
    file = controllers_with(bringup)
    other = controllers_with(package.parent / "other", joints="[k]")
    write(other.parents[1] / "package.xml", "<package><name>other</name></package>")

    (line,) = [line for line in lines(ad.load_robot(package)) if "candidates" in line]

    assert f"candidates: {file}; no controller runs; --controllers FILE " in line


@pytest.mark.parametrize(
    "space", ["<namespace>/", "/${robot}/", "$(var ns)/", "one/${robot}/", "/**/"]
)
def test_a_file_whose_name_space_a_launch_file_fills_in_is_a_candidate(package, space):
    hardware = '<ros2_control name="h" type="system"><joint name="j"/></ros2_control>'
    arm_with(package, hardware)
    bringup = package.parent / "bringup"
    write(bringup / "package.xml", "<package><name>bringup</name></package>")
    file = controllers_with(bringup)
    text = file.read_text()
    assert text.count("controller_manager:") == 1
    write(file, text.replace("controller_manager:", f"{space}controller_manager:"))

    (line,) = [line for line in lines(ad.load_robot(package)) if "candidates" in line]

    assert f"candidates: {file}; no controller runs" in line


def test_files_of_the_same_maker_come_before_those_that_name_the_joints(package):
    hardware = '<ros2_control name="h" type="system"><joint name="j"/></ros2_control>'
    arm_with(package, hardware)
    controllers_with(package.parent / "bringup")
    manifest = package.parent / "bringup" / "package.xml"
    write(manifest, "<package><name>bringup</name></package>")
    driver = package.parent / "driver"
    file = controllers_with(driver, joints="[k]")
    write(driver / "package.xml", "<package><name>arm_driver</name></package>")

    (line,) = [line for line in lines(ad.load_robot(package)) if "candidates" in line]

    assert f"candidates: {file}; no controller runs" in line


def test_of_files_of_a_maker_those_that_name_joints_are_candidates(package):
    hardware = '<ros2_control name="h" type="system"><joint name="j"/></ros2_control>'
    arm_with(package, hardware)
    for folder, joints in (("driver", "[k]"), ("bringup", "[j]")):
        other = package.parent / folder
        file = controllers_with(other, joints=joints)
        manifest = f"<package><name>arm_{folder}</name></package>"
        write(other / "package.xml", manifest)

    (line,) = [line for line in lines(ad.load_robot(package)) if "candidates" in line]

    assert f"candidates: {file}; no controller runs" in line


def test_the_controller_manager_is_called_as_the_plugin_says(package):
    tag = "<controller_manager_name>my_manager</controller_manager_name>"
    text = plugin("../config/controllers.yaml").replace("</plugin>", f"{tag}</plugin>")
    arm_with(package, text)
    file = controllers_with(package)
    file.write_text(file.read_text().replace("controller_manager:", "my_manager:"))

    assert [c.name for c in ad.load_robot(package).controllers.controllers] == ["arm"]


def test_a_base_drives_wheels_alone(package):
    base = (
        '<gazebo><plugin name="d" filename="libgazebo_ros_diff_drive.so">'
        "<left_joint>j</left_joint><right_joint>j</right_joint></plugin></gazebo>"
    )
    arm_with(package, base)

    robot = ad.load_robot(package)

    assert [c.name for c in robot.controllers.controllers] == ["GazeboRosDiffDrive"]


def test_a_parameters_file_of_a_missing_package_is_reported(package):
    arm_with(package, plugin("package://nope/a.yaml"))

    (line,) = lines(ad.load_robot(package))

    assert "<parameters>: package 'nope' not found; " in line
    assert line.endswith("; its controllers are left out")


def test_a_missing_variable_is_an_error_and_a_given_one_is_taken(package):
    file = controllers_with(package, joints="[$(var prefix)j]")

    assert problem(package) == (
        f"{file}:8: $(var prefix) has no value; give one with "
        "variables={'prefix': ...} (--var prefix=VALUE)"
    )
    robot = ad.load_robot(package, variables={"prefix": ""})
    assert lines(robot) == []


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"joints": "[k]"},
            ":5: arm: the robot has no joint 'k'; known: j",
        ),
        ({"joints": "j"}, ":8: arm.joints: expected a list of str, got 'j'"),
        (
            {"interfaces": "[torque]"},
            ":9: arm.command_interfaces: expected one of ['position', 'velocity', "
            "'acceleration', 'effort'], got 'torque'",
        ),
        (
            {"more": "constraints: {goal_time: soon}"},
            ":11: arm.constraints.goal_time: expected float, got 'soon'",
        ),
    ],
)
def test_a_controller_that_cant_run_is_reported_with_its_place(package, changes, line):
    file = controllers_with(package, **changes)

    robot = ad.load_robot(package)

    assert lines(robot) == [f"error: {file}{line}; the controller does not run"]


@pytest.mark.parametrize(
    ("entry", "what"),
    [
        ("{type: 3}", "type: expected a controller type, got 3"),
        (
            f"{{type: {JTC}, fallback_controllers: [1]}}",
            "fallback_controllers: expected a text or a list of texts, got [1]",
        ),
        (
            f"{{type: {JTC}, fallback_controllers: [arm]}}",
            "fallback_controllers: it is its own fallback",
        ),
    ],
)
def test_a_bad_entry_of_the_managers_list_stops_its_controller_alone(
    tmp_path, entry, what
):
    text = trajectory_controllers({"arm": ["shoulder"], "other": ["elbow"]})
    text = text.replace(f"arm:\n      type: {JTC}", f"arm: {entry}")

    robot = load(tmp_path, TWO_LINKS, text)

    rows = ad.Simulation(ad.build_diagram(robot)).list_controllers()
    assert [(row.name, row.state) for row in rows] == [
        ("arm", "unconfigured"),
        ("other", "active"),
    ]
    assert [str(error) for error in robot.report.errors] == [
        f"error: {tmp_path}/controllers.yaml:5: controller_manager.arm.{what}; "
        "the controller does not run"
    ]


def test_an_unknown_controller_type_is_reported_with_the_nearest(package):
    file = controllers_with(package)
    text = file.read_text(encoding="utf-8")
    write(file, text.replace(JTC, "JointTrajectoryController"))

    (line,) = lines(ad.load_robot(package))

    assert line.startswith(
        f"error: {file}:5: arm: unknown controller type 'JointTrajectoryController'; "
        f"did you mean '{JTC}'?; the controller"
    )


def test_a_malformed_controllers_file_is_an_error(package):
    file = write(
        package / "config" / "controllers.yaml",
        "controller_manager:\n  ros__parameters:\n\tx: 1",
    )

    assert problem(package) == (
        f"{file}:3: malformed YAML: a TAB indents this line; expected spaces"
    )


def test_a_binary_file_is_no_text(tmp_path):
    file = write(tmp_path / "a.urdf", b"\x7fELF\0\1 <robot $(find x)")

    assert problem(file) == f"{file}: is no text; expected a URDF or xacro file"


def test_no_robot_is_named():
    assert problem("") == "no robot is named; expected a name, file or folder"


def test_a_search_for_the_description_neither_waits_nor_walks_for_ever(
    package, monkeypatch
):
    os.mkfifo(package / "pipe.urdf")
    (package / "noise.urdf").write_bytes(b"\xff" * 3_000_000)
    assert ad.load_robot(package).description.file == package / "urdf" / "arm.urdf"

    monkeypatch.setattr(entry, "_MAX_FOLDERS", 3)
    for name in "abc":
        (package / name).mkdir()
    assert problem(package) == (
        f"{package}: more than 3 folders; name the robot's file"
    )


def test_of_many_descriptions_the_first_are_listed(package):
    for number in range(30):
        write(package / f"{number:02}.urdf", ARM.format(more=""))
    (package / "urdf" / "arm.urdf").unlink()

    message = problem(package)

    assert "got 30; name the file: 00.urdf, 01.urdf, " in message
    assert message.endswith(", 19.urdf and 10 more")


# Damaged files


def damaged(content: bytes, seed: int) -> list[bytes]:
    """Return what becomes of a file by accident: cut, garbled, mixed up."""
    rng = random.Random(seed)  # noqa: S311  reproducible, not secret.
    rows = content.splitlines(keepends=True)
    results = [content[: rng.randrange(len(content))] for _ in range(2)]
    for _ in range(3):
        row = rng.randrange(len(rows))
        results.append(b"".join(rows[:row] + rows[row + 1 :]))
        results.append(b"".join([*rows[:row], rows[row], *rows[row:]]))
    words = [word for word in set(content.replace(b'"', b" ").split()) if word]
    for _ in range(5):
        old, new = rng.choice(words), rng.choice([*words, b"", b"nan", b"-1", b"x"])
        results.append(content.replace(old, new))
        results.append(content.replace(old, new, 1))
    for _ in range(2):
        start = rng.randrange(len(content))
        results.append(content[:start] + rng.randbytes(5) + content[start + 5 :])
    return results


def load_damaged(file, seed, source, **options):
    """Load a robot with a file that is damaged in one way after the other."""
    for content in damaged(file.read_bytes(), seed):
        file.write_bytes(content)
        with contextlib.suppress(ArmDrakeError):
            ad.load_robot(source, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["urdf/doosan_a0912.urdf.xacro", "urdf/doosan_a0912_macro.xacro", "package.xml"],
)
def test_a_damaged_file_gives_no_error_but_ours(tmp_path, name):
    for kind, folder in (("models", models_folder()), ("configs", configs_folder())):
        shutil.copytree(folder / "doosan_a0912", tmp_path / kind / "doosan_a0912")
    package = tmp_path / "models/doosan_a0912"

    load_damaged(package / name, 912, package / "urdf/doosan_a0912.urdf.xacro")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["description", "controllers"])
def test_a_damaged_plain_urdf_or_yaml_gives_no_error_but_ours(tmp_path, kind):
    robot = ad.load_robot("doosan_a0912")
    path, yaml = tmp_path / "arm.urdf", tmp_path / "controllers.yaml"
    path.write_text(robot.description.source.replace("><", ">\n<"), encoding="utf-8")
    shutil.copy(robot.controllers.files[0], yaml)

    file = path if kind == "description" else yaml
    load_damaged(file, 913, path, controllers=yaml)


# Work done once


@pytest.fixture
def parsed(monkeypatch):
    """Models that Drake has parsed, by their texts."""
    texts = []

    class CountingParser(Parser):
        def AddModelsFromString(self, text, kind):
            texts.append(text)
            return super().AddModelsFromString(text, kind)

    monkeypatch.setattr(plant_module, "Parser", CountingParser)
    return texts


@pytest.mark.slow
@pytest.mark.parametrize("name", ["doosan_a0912", "lab5_arm"])
def test_drake_parses_a_robot_twice_on_trial_and_in_earnest(name, parsed):
    robot = ad.load_robot(name)

    ad.build_diagram(robot)

    trial, real = parsed
    assert "<visual" not in trial
    assert "<visual" in real


@pytest.mark.slow
def test_another_diagram_of_a_robot_takes_the_same_trial(parsed):
    robot = ad.load_robot("doosan_a0912")
    ad.build_diagram(robot)
    parsed.clear()

    ad.build_diagram(robot)

    assert len(parsed) == 1


@pytest.mark.slow
def test_a_robot_that_was_on_trial_can_be_pickled():
    robot = ad.load_robot("doosan_a0912")

    again = pickle.loads(pickle.dumps(robot))  # noqa: S301

    assert again.description == robot.description
    assert ad.build_diagram(again).num_output_ports()


def test_a_frame_is_where_its_link_has_it(tmp_path):
    turned = ("a", (0.1, 0, 0, 0, 0, math.pi / 2))
    frames = {"tool": turned, 'tip "of" it': ("tool", (0.2, 0, 0, 0, 0, 0))}
    robot = load(tmp_path, ARM.format(more=""), frames=frames)

    pose = robot.forward_kinematics({"j": math.pi / 2}, 'tip "of" it')

    # The joint turns x to -z; the tool's x is the link's y.
    assert pose.translation() == pytest.approx([0, 0.2, -0.1], abs=1e-12)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ({"tool": ("b", (0,) * 6)}, "frame 'tool': no link 'b'; known: a, world"),
        ({"a": ("world", (0,) * 6)}, "frame 'a': a link is called so"),
        ({"": ("a", (0,) * 6)}, "frame '': expected a name"),
        ({"tool": "a"}, "frame 'tool': expected a link and a pose, got 'a'"),
        ({"tool": 3}, "frame 'tool': expected a link and a pose, got 3"),
        ({"tool": ("a", (0, 0, 1))}, "expected x, y, z .* got .0, 0, 1"),
        ({"tool": ("a", (0, 0, math.nan, 0, 0, 0))}, "expected x, y, z .*nan"),
    ],
)
def test_a_frame_that_can_not_be_is_refused(tmp_path, frames, message):
    with pytest.raises(ArmDrakeError, match=message):
        load(tmp_path, ARM.format(more=""), frames=frames)


@pytest.mark.parametrize(
    ("broken", "problem"),
    [
        ('type="revolut"', "type 'revolut'; expected one of"),
        ('type="fixed"><child link="forarm"/', "child link 'forarm' doesn't exist"),
    ],
)
def test_an_error_about_a_joint_has_its_line(tmp_path, broken, problem):
    file = tmp_path / "arm.urdf"
    joint = f'<joint name="elbow" {broken}><parent link="a"/><child link="b"/></joint>'
    file.write_text(
        f'<robot name="r">\n<link name="a"/><link name="b"/>\n{joint}\n</robot>'
    )

    with pytest.raises(ArmDrakeError) as caught:
        ad.load_robot(file)

    assert str(caught.value).startswith(f"{file}:3: joint 'elbow': {problem}")


@pytest.mark.parametrize("namespace", ["my cell", "~cell", "1st", "cell/2", "..", "é"])
def test_a_name_space_is_one_that_ros_takes(tmp_path: Path, namespace: str) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, TWO_LINKS, namespace=namespace)

    assert str(caught.value) == (
        "namespace: expected names of letters, digits and '_' such as 'cell/left', "
        f"got {namespace!r}"
    )


@pytest.mark.parametrize(
    ("namespace", "expected"), [("", ""), ("/", ""), ("/a_1//B/", "/a_1/B")]
)
def test_slashes_around_a_name_space_do_not_count(
    tmp_path: Path, namespace: str, expected: str
) -> None:
    assert load(tmp_path, TWO_LINKS, namespace=namespace).namespace == expected
