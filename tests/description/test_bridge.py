"""Bridges of ROS and Gazebo: the topics that they connect, and what they don't."""

import textwrap
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.description import bridge
from arm_drake.description.bridge import TopicAlias, load_bridges, split_bridges
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import InputError
from tests import models
from tests.models import pendulum, ros2_control, trajectory_controllers
from tests.robots import real_robot

FLOAT = "ros_type_name: std_msgs/msg/Float64, gz_type_name: gz.msgs.Double"

CONTROLLERS = trajectory_controllers({"arm": ["swing"]})

KNOWN = (
    "known: direction, frame_id, gz_rep_type_name, gz_req_type_name, gz_topic_name, "
    "gz_type_name, ign_topic_name, ign_type_name, lazy, publish_optical_frame, "
    "publisher_queue, qos_profile, ros_topic_name, ros_type_name, service_name, "
    "subscriber_queue, topic_name"
)


@pytest.fixture
def load(tmp_path):
    """Return a function: text of a bridge -> what it connects, and report lines."""

    def load_text(text: str) -> tuple[tuple[TopicAlias, ...], list[str]]:
        file, report = tmp_path / "bridge.yaml", LoadReport()
        file.write_text(text, encoding="utf-8")
        return load_bridges([file], report), [str(entry) for entry in report]

    return load_text


def make_package(folder: Path, **configs: str) -> Path:
    """Write a package with a robot and files in its config folder; return the robot."""
    (folder / "urdf").mkdir()
    (folder / "config").mkdir()
    (folder / "package.xml").write_text("<package><name>swing</name></package>")
    for name, text in configs.items():
        (folder / "config" / f"{name}.yaml").write_text(text, encoding="utf-8")
    robot = folder / "urdf/robot.urdf"
    robot.write_text(pendulum(control=ros2_control("swing")), encoding="utf-8")
    return robot


def names(aliases: tuple[TopicAlias, ...]) -> list[tuple[str, str, str]]:
    return [(alias.ros_name, alias.gz_name, alias.direction) for alias in aliases]


# What an entry says


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        # The four ways of upstream's documentation.
        ("topic_name: chatter", ("/chatter", "/chatter", "BIDIRECTIONAL")),
        ("ros_topic_name: chatter", ("/chatter", "/chatter", "BIDIRECTIONAL")),
        ("gz_topic_name: chatter", ("/chatter", "/chatter", "BIDIRECTIONAL")),
        ("ros_topic_name: a, gz_topic_name: /b/c", ("/a", "/b/c", "BIDIRECTIONAL")),
        (
            "ros_topic_name: /a, gz_topic_name: b, direction: ROS_TO_GZ",
            ("/a", "/b", "ROS_TO_GZ"),
        ),
        (
            "topic_name: a, direction: GZ_TO_ROS, lazy: true, publisher_queue: 6",
            ("/a", "/a", "GZ_TO_ROS"),
        ),
        # Of the time when it was called Ignition.
        (
            "ros_topic_name: a, ign_topic_name: b, direction: ROS_TO_IGN",
            ("/a", "/b", "ROS_TO_GZ"),
        ),
        ("topic_name: a, direction: IGN_TO_ROS", ("/a", "/a", "GZ_TO_ROS")),
    ],
)
def test_an_entry_connects_a_name_in_ros_with_one_in_gazebo(load, entry, expected):
    aliases, lines = load(f"- {{{entry}, {FLOAT}}}")

    assert names(aliases) == [expected]
    assert lines == []


@pytest.mark.parametrize(
    ("ros", "gz"),
    [
        ("std_msgs/msg/Float64", "ignition.msgs.Double"),
        ("std_msgs/msg/Float32", "gz.msgs.Float"),
        ("trajectory_msgs/msg/JointTrajectory", "gz.msgs.JointTrajectory"),
        ("sensor_msgs/msg/JointState", "gz.msgs.Model"),
        ("sensor_msgs/msg/Imu", "gz.msgs.IMU"),
        ("sensor_msgs/msg/Image", "gz.msgs.Image"),
        ("sensor_msgs/msg/CameraInfo", "gz.msgs.CameraInfo"),
        ("sensor_msgs/msg/LaserScan", "gz.msgs.LaserScan"),
        ("sensor_msgs/msg/PointCloud2", "gz.msgs.PointCloudPacked"),
        ("std_msgs/msg/Bool", "gz.msgs.Boolean"),
        ("geometry_msgs/msg/Twist", "ignition.msgs.Twist"),
        ("geometry_msgs/msg/TwistStamped", "gz.msgs.Twist"),
        ("nav_msgs/msg/Odometry", "gz.msgs.Odometry"),
        ("tf2_msgs/msg/TFMessage", "gz.msgs.Pose_V"),
    ],
)
@pytest.mark.parametrize("key", ["gz_type_name", "ign_type_name"])
def test_types_that_are_carried_need_no_line(load, ros, gz, key):
    aliases, lines = load(f"- {{topic_name: a, ros_type_name: {ros}, {key}: {gz}}}")

    assert len(aliases) == 1
    assert lines == []


def test_an_entry_knows_its_place(load, tmp_path):
    aliases, _ = load(f"# A bridge\n- {{topic_name: a, {FLOAT}}}\n\n- topic_name: b\n")

    assert [alias.place for alias in aliases] == [f"{tmp_path / 'bridge.yaml'}:2"]


def test_equal_entries_of_two_files_are_one(tmp_path):
    files = [tmp_path / name for name in ("one.yaml", "two.yaml")]
    for file in files:
        file.write_text(f"- {{topic_name: a, {FLOAT}}}\n", encoding="utf-8")

    aliases = load_bridges(files, LoadReport())

    assert [alias.file for alias in aliases] == files[:1]


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ("5", "warning: {}:2: [1]: expected a mapping, got a value; "),
        ("[a]", "warning: {}:2: [1]: expected a mapping, got a list; "),
        (
            f"{{{FLOAT}}}",
            "warning: {}:2: [1]: no topic is named; expected ros_topic_name and "
            "gz_topic_name; ",
        ),
        (
            f"{{topic_name: a, ros_topic_name: b, {FLOAT}}}",
            "warning: {}:2: [1]: topic_name is for both sides; leave ros_topic_name "
            "out; ",
        ),
        (
            f"{{topic_name: a, ign_topic_name: b, {FLOAT}}}",
            "warning: {}:2: [1]: topic_name is for both sides; leave gz_topic_name "
            "out; ",
        ),
        (
            "{topic_name: a, ros_type_name: std_msgs/msg/Float64}",
            "warning: {}:2: [1]: expected both ros_type_name and gz_type_name; ",
        ),
        (
            "{topic_name: [a], ros_type_name: b, gz_type_name: c}",
            "warning: {}:2: [1]: topic_name: expected a text, got a list; ",
        ),
        (
            f"{{topic_name: a, {FLOAT},\n   direction: ROS_TO_GAZEBO}}",
            "warning: {}:3: [1]: unknown direction 'ROS_TO_GAZEBO'; did you mean "
            "'ROS_TO_GZ'? known: BIDIRECTIONAL, GZ_TO_ROS, ROS_TO_GZ; ",
        ),
        (
            "{topic_name: a, ros_type_name: std_msgs/msg/Float64,"
            " gz_type_name: gz.msgs.Float}",
            "warning: {}:2: [1]: std_msgs/msg/Float64 is bridged with "
            "gz.msgs.Double, not with gz.msgs.Float; ",
        ),
        (
            "{topic_name: /clock, ros_type_name: rosgraph_msgs/msg/Clock,"
            " gz_type_name: gz.msgs.Clock}",
            "info: {}:2: [1]: topics of type rosgraph_msgs/msg/Clock are not "
            "simulated; ",
        ),
        (
            "{service_name: /world/empty/control, "
            "ros_type_name: ros_gz_interfaces/srv/ControlWorld}",
            "info: {}:2: [1]: services can't be bridged; ",
        ),
    ],
)
def test_an_entry_without_effect_is_a_line_and_the_others_hold(
    load, tmp_path, entry, line
):
    good = f"{{topic_name: good, {FLOAT}}}"

    aliases, lines = load(f"- {good}\n- {entry}\n")

    file = tmp_path / "bridge.yaml"
    assert names(aliases) == [("/good", "/good", "BIDIRECTIONAL")]
    assert lines == [f"{line.format(file)}the entry is left out"]


def test_an_unknown_key_is_a_line_and_the_entry_holds(load, tmp_path):
    aliases, lines = load(f"- {{topic_name: a, {FLOAT},\n   lasy: true}}")

    assert len(aliases) == 1
    assert lines == [
        f"warning: {tmp_path / 'bridge.yaml'}:2: [0]: unknown key 'lasy'; did you mean "
        f"'lazy'? {KNOWN}; it has no effect"
    ]


# Which files are bridges


def test_the_bridge_in_the_config_folder_is_taken_beside_the_controllers(tmp_path):
    entries = f"- {{topic_name: a, {FLOAT}}}"
    others = {"list": "- 1\n- two", "empty": "", "notes": "- about: ros_type_name"}

    robot = ad.load_robot(
        make_package(tmp_path, controllers=CONTROLLERS, bridge=entries, **others)
    )

    assert names(robot.topic_aliases) == [("/a", "/a", "BIDIRECTIONAL")]
    assert [c.name for c in robot.controllers.controllers] == ["arm"]
    assert list(robot.report) == []


def test_a_bridge_that_is_installed_into_the_config_folder_is_taken(tmp_path):
    text = f"- {{topic_name: a, {FLOAT}}}"
    robot = make_package(tmp_path, controllers=CONTROLLERS, bridge=text)
    (tmp_path / "bringup").mkdir()
    (tmp_path / "config").rename(tmp_path / "bringup" / "config")
    install = "install(DIRECTORY urdf bringup/config DESTINATION share/${PROJECT_NAME})"
    (tmp_path / "CMakeLists.txt").write_text(f"project(swing)\n{install}\n")

    found = ad.load_robot(robot)

    assert names(found.topic_aliases) == [("/a", "/a", "BIDIRECTIONAL")]
    (alias,) = found.topic_aliases
    assert alias.file == tmp_path / "bringup" / "config" / "bridge.yaml"


def test_a_robot_without_a_bridge_has_no_aliases(tmp_path):
    robot = ad.load_robot(make_package(tmp_path, controllers=CONTROLLERS))

    assert robot.topic_aliases == ()


def test_a_bridge_that_is_no_yaml_is_a_line(tmp_path):
    text = f"- {{topic_name: a, {FLOAT}}}\n- {{"

    robot = ad.load_robot(make_package(tmp_path, controllers=CONTROLLERS, bridge=text))

    (entry,) = robot.report
    assert (entry.severity, entry.kind, entry.line) == ("warning", "invalid", 2)
    assert entry.file == str(tmp_path / "config/bridge.yaml")
    assert entry.what.startswith("malformed YAML: ")
    assert robot.topic_aliases == ()


@pytest.mark.parametrize("with_controllers", [False, True])
def test_a_bridge_that_is_named_is_taken_instead(tmp_path, with_controllers):
    package, inputs = tmp_path / "package", tmp_path / "given.yaml"
    package.mkdir()
    source = make_package(
        package,
        controllers=CONTROLLERS,
        bridge=f"- {{topic_name: found, {FLOAT}}}",
    )
    inputs.write_text(f"- {{topic_name: given, {FLOAT}}}", encoding="utf-8")
    own = tmp_path / "own.yaml"
    own.write_text(CONTROLLERS.replace("arm:", "own:"), encoding="utf-8")

    controllers = [own, inputs] if with_controllers else inputs
    robot = ad.load_robot(source, controllers=controllers)

    assert names(robot.topic_aliases) == [("/given", "/given", "BIDIRECTIONAL")]
    # A bridge says nothing of the controllers: they are those of the package.
    expected = "own" if with_controllers else "arm"
    assert [c.name for c in robot.controllers.controllers] == [expected]


def test_the_bridge_of_a_bundled_robot_is_in_its_configs(tmp_path, monkeypatch):
    robot = ad.load_robot("doosan_a0912")
    file = tmp_path / "doosan_a0912/bridge.yaml"
    file.parent.mkdir()
    file.write_text(f"- {{topic_name: a, {FLOAT}}}", encoding="utf-8")
    monkeypatch.setattr(bridge, "configs_folder", lambda: tmp_path)

    found = bridge.find_bridge_files(
        robot.description, PackageFinder(file), robot.bundled, robot.report
    )

    assert robot.topic_aliases == ()
    assert found == [file]


def test_naming_no_file_and_nothing_are_two_things():
    assert split_bridges([]) == ([], [])
    assert split_bridges(None) == ([], None)


def test_a_list_that_is_no_bridge_is_no_bridge(tmp_path):
    source = make_package(tmp_path)
    inputs = tmp_path / "given.yaml"
    inputs.write_text("- 1\n- 2\n", encoding="utf-8")

    with pytest.raises(InputError) as error:
        ad.load_robot(source, controllers=inputs)

    assert str(error.value).startswith(f"{inputs}:1: expected a mapping")


def test_the_bridge_of_a_real_robot_connects_all_of_its_joints():
    path = real_robot("mycobot_280/mycobot_gazebo/config/ros_gz_bridge.yaml")
    report = LoadReport()

    aliases = load_bridges([path], report)

    assert list(report) == []
    first, *others = names(aliases)
    assert first == ("/joint_states", "/joint_states", "GZ_TO_ROS")
    joints = [
        "link1_to_link2",
        "link2_to_link3",
        "link3_to_link4",
        "link4_to_link5",
        "link5_to_link6",
        "link6_to_link6flange",
        "gripper_controller",
        "gripper_base_to_gripper_left2",
        "gripper_left3_to_gripper_left1",
        "gripper_base_to_gripper_right3",
        "gripper_base_to_gripper_right2",
        "gripper_right3_to_gripper_right1",
    ]
    topic = "/model/mycobot_280/joint"
    expected = [
        (f"{topic}/{j}/cmd_pos", f"{topic}/{j}/0/cmd_pos", "ROS_TO_GZ") for j in joints
    ]
    assert others == expected


REMAPPED = """<gazebo><plugin filename="gz_ros2_control-system" name="p">
  <ros><namespace>{}</namespace><remapping>{}</remapping>
  <remapping>nothing:=else</remapping></ros></plugin></gazebo></robot>"""
POSITIONS = """
controller_manager:
  ros__parameters:
    push: {type: position_controllers/JointGroupPositionController}
push:
  ros__parameters: {joints: [shoulder, elbow]}
"""


@pytest.mark.parametrize(
    ("space", "rule"),
    [
        ("", "push/commands:=go"),
        ("/", "/push/commands:=/go"),
        ("left", "push/commands:=go"),
        ("left", "/left/push/commands:=/left/go"),
    ],
)
def test_remappings_of_the_plugin_give_topics_of_controllers_their_names(
    tmp_path: Path, space: str, rule: str
) -> None:
    urdf = models.TWO_LINKS.replace("</robot>", REMAPPED.format(space, rule))
    yaml = POSITIONS
    if space.strip("/"):
        yaml = f"{space}:\n{textwrap.indent(POSITIONS, '  ')}"
    robot = models.load(tmp_path, urdf, yaml)
    simulation = ad.Simulation(ad.build_diagram(robot))

    simulation.topic("/go").publish([0.25, 0.5])
    simulation.advance_to(0.1)

    names = [topic.name for topic in simulation.list_topics()]
    assert "/go" in names
    assert "/else" not in names
    assert list(simulation.rollout().command[-1]) == [0.25, 0.5]
