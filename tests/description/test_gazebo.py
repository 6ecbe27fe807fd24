"""`<gazebo>` tags: which plugins there are, and what has no effect."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.gazebo import (
    GazeboPlugin,
    read_friction,
    read_gazebo_plugins,
    read_joint_plugins,
    report_gazebo,
)
from arm_drake.description.gazebo_plugins import Ros2ControlPlugin
from arm_drake.description.report import LoadReport


def lines_of(body: str, **options) -> list[str]:
    report = LoadReport()
    root = ET.XML(f"<robot>{body}</robot>")
    report_gazebo(root, report, Path("arm.urdf"), **options)
    return [str(entry) for entry in report]


def test_plugins_are_read_with_repeated_fields():
    root = ET.XML(
        "<robot><gazebo/><gazebo reference='a'><plugin name=' p ' filename='f.so'>"
        "<parameters> a.yaml </parameters><parameters>b.yaml</parameters><!-- c -->"
        "<empty/></plugin><plugin/></gazebo></robot>"
    )

    plugins = read_gazebo_plugins(root)

    assert plugins == (
        GazeboPlugin(
            "p",
            "f.so",
            (("parameters", "a.yaml"), ("parameters", "b.yaml"), ("empty", "")),
            reference="a",
        ),
        GazeboPlugin("", "", reference="a"),
    )
    assert plugins[0].texts("parameters") == ("a.yaml", "b.yaml")
    assert plugins[0].texts("nope") == ()


def test_nested_fields_and_attributes_are_flattened():
    root = ET.XML(
        "<robot><gazebo><plugin><ros><namespace>/n</namespace>"
        "<remapping>a:=b</remapping><remapping>c:=d</remapping></ros>"
        "<gain joint='j'>2</gain><deep><er><est/></er></deep></plugin></gazebo></robot>"
    )

    (plugin,) = read_gazebo_plugins(root)

    assert plugin.fields == (
        ("ros/namespace", "/n"),
        ("ros/remapping", "a:=b"),
        ("ros/remapping", "c:=d"),
        ("gain", "2"),
        ("gain@joint", "j"),
        ("deep/er/est", ""),
    )


def test_plugins_of_sensors_are_read_with_their_holder():
    root = ET.XML(
        "<robot><gazebo reference='tool'><sensor name='s' type='contact'><contact/>"
        "<plugin filename='bumper.so'><plugin>inner</plugin></plugin></sensor>"
        "</gazebo></robot>"
    )

    (plugin,) = read_gazebo_plugins(root)

    assert (plugin.filename, plugin.reference, plugin.holder) == (
        "bumper.so",
        "tool",
        "sensor 's'",
    )


GZ, IGNITION = "gz::sim::systems::", "ignition::gazebo::systems::"


@pytest.mark.parametrize(
    ("filename", "name", "kind"),
    [
        ("libgazebo_ros2_control.so", "any", "ros2_control"),
        ("libign_ros2_control-system.so", "any", "ros2_control"),
        ("gz_ros2_control-system", "any", "ros2_control"),
        ("/opt/ros/humble/lib/libgz_ros2_control-system.so", "", "ros2_control"),
        ("gz-sim-joint-position-controller-system", "", "joint_position_controller"),
        ("libgz-sim8-joint-controller-system.so", "", "joint_controller"),
        (
            "ignition-gazebo-joint-trajectory-controller-system",
            f"{IGNITION}JointTrajectoryController",
            "joint_trajectory_controller",
        ),
        (
            "ignition-gazebo6-joint-state-publisher-system",
            "",
            "joint_state_publisher",
        ),
        ("gz-sim-diff-drive-system", f"{GZ}DiffDrive", "diff_drive"),
        ("", f"{GZ}JointPositionController", "joint_position_controller"),
        ("", f"{IGNITION}v6::systems::JointController", "other"),
        ("", "ignition::gazebo::v6::systems::JointController", "joint_controller"),
        ("gz-sim-sensors-system", f"{GZ}Sensors", "other"),
        (
            "libgazebo_ros_joint_state_publisher.so",
            "any",
            "gazebo_ros_joint_state_publisher",
        ),
        (
            "libgazebo_ros_joint_pose_trajectory.so",
            "any",
            "gazebo_ros_joint_pose_trajectory",
        ),
        ("libgazebo_ros_diff_drive.so", "any", "gazebo_ros_diff_drive"),
        ("libgazebo_ros_camera.so", "any", "other"),
        ("libmy_gazebo_ros2_control.so", "any", "other"),
        ("other", "any", "other"),
        ("libdiff_drive.so", "diff_drive", "other"),
        ("", "", "other"),
    ],
)
def test_a_plugin_is_known_by_its_library_or_class(filename, name, kind):
    assert GazeboPlugin(name, filename).kind == kind


def test_what_has_no_effect_is_reported_by_sort_with_its_count():
    lines = lines_of(
        "<link name='a'/>"
        "<gazebo reference='a'><material>Red</material><mu1>1</mu1><mu2>1</mu2>"
        "<sensor type='camera'><plugin filename='libcam.so'/></sensor></gazebo>"
        "<gazebo reference='b'><material>Blue</material>"
        "<sensor type='camera'><plugin filename='libcam.so'/></sensor>"
        "<sensor type='imu'/><plugin name='n'/></gazebo>"
    )

    assert lines == [
        "info: arm.urdf: Gazebo plugins 'libcam.so' (2 times), 'n'; they have no "
        "effect",
        "info: arm.urdf: <gazebo> tags <material> (2 times), <mu2>; they have no "
        "effect",
    ]


def test_plugins_that_are_simulated_need_no_line():
    simulated = (
        "<plugin filename='gz_ros2_control-system'/>"
        "<plugin filename='gz-sim-joint-controller-system'/>"
    )
    other = "<plugin filename='gz-sim-buoyancy-system'/>"

    assert lines_of(f"<gazebo>{simulated}</gazebo>") == []
    assert lines_of(f"<gazebo>{simulated}{other}</gazebo>") == [
        "info: arm.urdf: Gazebo plugins 'gz-sim-buoyancy-system'; they have no effect"
    ]


def test_a_plugin_with_a_controllers_yaml_is_one_of_ros2_control():
    text = (
        "<plugin filename='quadruped_hardware-system' name='own'>"
        "<parameters> a.yaml </parameters><hold_joints>false</hold_joints>"
        "<ros><namespace>dog</namespace></ros></plugin>"
        "<plugin filename='libcam.so'><parameters>a.txt</parameters></plugin>"
    )
    root = ET.XML(f"<robot><gazebo>{text}</gazebo></robot>")
    own, camera = read_gazebo_plugins(root)

    assert (own.kind, camera.kind) == ("ros2_control", "other")
    (typed,) = read_joint_plugins([own, camera], [], LoadReport(), Path("arm.urdf"))
    assert isinstance(typed, Ros2ControlPlugin)
    assert (typed.namespace, typed.hold_joints) == ("dog", False)
    assert lines_of(f"<gazebo>{text}</gazebo>") == [
        "info: arm.urdf: Gazebo plugins 'quadruped_hardware-system', with a "
        "controllers YAML in <parameters>; taken as ros2_control's own",
        "info: arm.urdf: Gazebo plugins 'libcam.so'; they have no effect",
    ]


def test_plugins_that_would_move_the_robot_are_a_warning():
    plugins = (
        "<plugin filename='gz-sim-tracked-vehicle-system'/>"
        "<plugin filename='libgazebo_ros_force.so'/>"
        "<plugin filename='libgazebo_ros_imu_sensor.so'/>"
    )

    assert lines_of(f"<gazebo>{plugins}</gazebo>") == [
        "warning: arm.urdf: Gazebo plugins 'gz-sim-tracked-vehicle-system', "
        "'libgazebo_ros_force.so' move the robot; they aren't simulated; "
        "controllers and the plugins that are simulated move it alone",
        "info: arm.urdf: Gazebo plugins 'libgazebo_ros_imu_sensor.so'; they have no "
        "effect",
    ]


def test_friction_of_what_is_no_link_is_reported():
    lines = lines_of(
        '<link name="arm"/><gazebo reference="arm"><mu1>0.2</mu1></gazebo>'
        '<gazebo reference="armm"><mu1>0.2</mu1></gazebo>'
        "<gazebo><mu1>0.2</mu1></gazebo>"
    )

    assert lines == [
        "warning: arm.urdf: <mu1> of 'armm', which is no link; did you mean 'arm'? "
        "known: arm; it has no effect",
        "warning: arm.urdf: <mu1> in a tag without reference, that is, of no link; "
        "it has no effect",
    ]


def test_friction_of_joints_is_one_line_that_names_them():
    tags = "".join(
        f'<joint name="{name}"/><gazebo reference="{name}"><mu1>0.2</mu1></gazebo>'
        for name in "ab"
    )

    report = LoadReport()
    report_gazebo(ET.XML(f"<robot>{tags}</robot>"), report, Path("arm.urdf"))

    assert [str(entry) for entry in report.grouped()] == [
        "warning: arm.urdf: joint 'a', joint 'b': <mu1> of a joint; it has no effect"
    ]


def test_a_value_may_be_an_attribute():
    body = """<link name="a"/><gazebo reference="a"><mu1 value="0.2"/>
      <gravity value="false"/></gazebo>"""

    assert read_friction(ET.XML(f"<robot>{body}</robot>"), ["a"]) == {"a": 0.2}
    assert lines_of(body) == [
        "warning: arm.urdf: link 'a': <gravity> is 'false'; it has its weight here"
    ]


@pytest.mark.parametrize(
    ("tag", "is_told"),
    [
        ("<gravity>true</gravity>", False),
        ("<gravity>1</gravity>", False),
        ("<gravity>0</gravity>", True),
        ("<turnGravityOff>true</turnGravityOff>", True),
        ("<turnGravityOff>false</turnGravityOff>", False),
    ],
)
def test_links_that_are_weightless_in_gazebo_are_told(tag, is_told):
    lines = lines_of(f'<link name="a"/><gazebo reference="a">{tag}</gazebo>')

    assert [line.partition("is ")[0] for line in lines] == [
        f"warning: arm.urdf: link 'a': {tag.partition('>')[0]}> "
    ] * is_told


def test_a_weight_of_no_link_is_a_tag_without_effect():
    assert lines_of('<link name="a"/><gazebo><gravity>0</gravity></gazebo>') == [
        "info: arm.urdf: <gravity> of no link; it has no effect"
    ]


def test_friction_as_sdf_has_it_is_no_tag_without_effect() -> None:
    body = """<link name="a"/><gazebo reference="a"><collision><surface><friction>
      <ode><mu>0.3</mu></ode></friction></surface></collision><kp>1</kp></gazebo>"""

    found = lines_of(body)

    assert read_friction(ET.XML(f"<robot>{body}</robot>"), ["a"]) == {"a": 0.3}
    assert found == ["info: arm.urdf: <gazebo> tags <kp>; they have no effect"]


def test_an_empty_tag_that_could_hold_others_is_no_unknown_one() -> None:
    fields = (("ros", ""), ("left_joint", "a"), ("right_joint", "b"), ("rose", "1"))
    plugin = GazeboPlugin("d", "libgazebo_ros_diff_drive.so", fields)
    report = LoadReport()

    read_joint_plugins([plugin], ["a", "b"], report, Path("arm.urdf"))

    assert [entry.what for entry in report] == ["unknown tags: rose"]
