"""Launch files: what is less common, and what can't be taken as it is written."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.description.xacro import expand_xacro
from arm_drake.errors import ArmDrakeError, InputError, PackageError
from arm_drake.launch.launch_files import load_arguments
from tests.launch.packages import describe, make_package, write_launch

SRDF = """
<robot name="pendulum">
  <group name="arm"><joint name="swing"/></group>
  <virtual_joint name="fixed" type="fixed" parent_frame="table" child_link="world"/>
</robot>
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return make_package(tmp_path)


@pytest.mark.slow
def test_arguments_are_shown_of_what_can_be_read(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = describe(
        package,
        """
        DeclareLaunchArgument("side", choices=["left", "right"]),
        LogInfo(msg=LaunchConfiguration("nowhere")),
        publisher(["xacro ", LaunchConfiguration("file")]),
        OpaqueFunction(function=lambda context: 1 / 0),
        DeclareLaunchArgument("last", default_value=LaunchConfiguration("side")),
        """,
    )

    assert [argument.name for argument in load_arguments(path)] == ["side"]
    found = load_arguments(path, arguments={"side": "left"})
    assert [(each.name, each.default) for each in found] == [
        ("side", None),
        ("last", "left"),
    ]
    words = [str(path), "side:=right", "--show-args", "--json"]
    assert main(["launch", *words]) == 0
    last = json.loads(capsys.readouterr().out)[-1]
    assert (last["name"], last["default"]) == ("last", "right")


@pytest.mark.slow
def test_of_several_copies_of_a_package_the_one_that_is_taken_is_said(
    tmp_path: Path,
) -> None:
    near, first, second = (
        make_package(tmp_path / place) for place in ("near", "far/a", "far/b")
    )
    for folder in (near, first, second):
        describe(folder, "publisher(),")

    plan = ad.load_launch(
        "pendulum_bringup", "test.launch.py", package_paths=[tmp_path]
    )

    assert plan.file == near / "launch/test.launch.py"
    assert [str(entry) for entry in plan.report] == [
        f"warning: package 'pendulum_bringup' is there several times, also as {first}, "
        f"{second}; taken: {near}; another one's folder can be named instead"
    ]
    assert plan.robots[0].source.is_relative_to(near)


@pytest.mark.slow
def test_a_launch_file_that_is_installed_elsewhere_is_found(package: Path) -> None:
    file = describe(package, "publisher(),")
    (package / "CMakeLists.txt").write_text(
        "project(pendulum_bringup)\n"
        "install(DIRECTORY launch/ DESTINATION share/${PROJECT_NAME})\n"
    )

    plan = ad.load_launch(package.name, file.name, package_paths=[package])

    assert plan.file == file


def test_of_several_files_in_a_package_none_is_taken(package: Path) -> None:
    one = describe(package, "publisher(),")
    other = package / "other" / one.name
    other.parent.mkdir()
    other.write_bytes(one.read_bytes())

    with pytest.raises(InputError) as caught:
        ad.load_launch(package.name, one.name, package_paths=[package])

    assert str(caught.value) == (
        f"package {package.name!r} has several {one.name!r}; name one by its path: "
        f"{one}, {other}"
    )


def test_what_names_no_launch_file_is_reported(package: Path) -> None:
    path = describe(package, "publisher(),")

    with pytest.raises(InputError, match=r"is a folder; .*, too: test.launch.py"):
        ad.load_launch(package)
    with pytest.raises(InputError, match="is a folder without launch files; expected"):
        ad.load_launch(package / "config")
    with pytest.raises(InputError, match="'side': expected an argument as NAME:=VALUE"):
        ad.load_launch(path, "side")


@pytest.mark.slow
def test_libraries_of_python_may_be_used(package: Path) -> None:
    before = """
    import numpy as np
    HALF = f"{np.linalg.norm([0.3, 0.4]):g}"
    """
    path = describe(package, "publisher([*XACRO, ' height:=', HALF]),", before)

    assert ad.load_launch(path).robots[0].xacro_args == {"height": "0.5"}


@pytest.mark.slow
@pytest.mark.parametrize("is_changed", [False, True])
def test_a_document_of_xacro_may_be_changed(package: Path, is_changed: bool) -> None:
    before = f"""
    import xacro
    import xml.dom.minidom
    made = xacro.process_file(XACRO[1], mappings={{"prefix": "left_"}})
    if not isinstance(made, xml.dom.minidom.Document):
        raise RuntimeError("no document")
    links = made.getElementsByTagName("link")
    if {is_changed}:
        links[1].setAttribute("name", "pole")
        made.getElementsByTagName("child")[0].setAttribute("link", "pole")
    node = Node(
        package="robot_state_publisher", executable="robot_state_publisher",
        parameters=[{{"robot_description": made.toxml()}}])
    """
    plan = ad.load_launch(describe(package, "node,", before))

    (launched,) = plan.robots
    assert isinstance(launched.source, str) == is_changed
    (robot,) = plan.load_scene().robots
    assert [joint.name for joint in robot.description.joints] == ["left_swing"]
    assert ("pole" in robot.description.links) == is_changed


@pytest.mark.slow
def test_a_function_that_follows_an_end_is_told_how_a_program_ended(
    package: Path,
) -> None:
    before = """
    ends = set()

    def follow(event, context):
        ends.add(event)
        if event.returncode != 0 or not event.process_name.startswith("spawner"):
            return [Shutdown()]
        return spawner("arm_controller", on_exit=lambda event, context: [
            Node(package="own", executable=f"after_{event.cmd[0]}")])

    first = spawner("joint_state_broadcaster")
    """
    path = describe(
        package,
        """
        publisher(), manager(), first,
        RegisterEventHandler(OnProcessExit(target_action=first, on_exit=follow)),
        """,
        before,
    )

    plan = ad.load_launch(path)

    spawned = list(plan.robots[0].spawned)
    assert spawned == ["joint_state_broadcaster", "arm_controller"]
    assert [each.name for each in plan.not_started] == ["own/after_spawner"]
    assert not plan.report.errors


@pytest.mark.parametrize(
    ("words", "expected"),
    [("", "side:=VALUE"), (", choices=['left', 'right']", "side:=left|right")],
)
def test_an_argument_that_must_be_given_is_told_with_its_choices(
    package: Path, words: str, expected: str
) -> None:
    path = describe(package, f"DeclareLaunchArgument('side'{words}),")

    with pytest.raises(InputError) as raised:
        ad.load_launch(path)

    assert str(raised.value).endswith(f"has no default; give it as {expected}")


@pytest.mark.slow
def test_a_robot_that_is_only_shown_needs_no_variables_of_a_yaml(package: Path) -> None:
    file = package / "config" / "controllers.yaml"
    text = file.read_text(encoding="utf-8")
    text = text.replace("[swing]", "[$(var side)swing]")
    file.write_text(text, encoding="utf-8")

    scene = ad.load_launch(describe(package, "publisher(),")).load_scene()

    assert not scene.robots[0].controllers.controllers


@pytest.mark.slow
@pytest.mark.parametrize(("words", "ends"), [("", True), (", on_stderr='warn'", False)])
def test_a_launch_that_ends_where_xacro_warns_is_told(
    package: Path, words: str, ends: bool
) -> None:
    file = package / "urdf" / "pendulum.urdf.xacro"
    text = file.read_text(encoding="utf-8")
    warning = "${xacro.warning('old')}"
    file.write_text(text.replace("</robot>", f"{warning}</robot>"), encoding="utf-8")
    entities = f"""
    Node(
        package="robot_state_publisher", executable="robot_state_publisher",
        parameters=[{{"robot_description": Command(XACRO{words})}}]),
    """

    (robot,) = ad.load_launch(describe(package, entities)).load_scene().robots

    told = [str(each) for each in robot.report.errors]
    assert len(told) == ends
    assert all("xacro prints 'old', and on_stderr" in each for each in told)


@pytest.mark.slow
def test_an_argument_that_is_only_read_has_its_effect(package: Path) -> None:
    entities = """
    Node(package="own", executable=LaunchConfiguration("side", default="left")),
    """
    path = describe(package, entities)

    plan = ad.load_launch(path, arguments={"side": "right"})

    assert [each.name for each in plan.not_started] == ["own/right"]
    assert not list(plan.report)
    plan = ad.load_launch(path, arguments={"sides": "right"})
    assert "no launch argument 'sides'" in str(plan.report)


def test_a_close_name_of_a_launch_configuration_is_suggested(package: Path) -> None:
    entities = """
    DeclareLaunchArgument("frequency", default_value="10"),
    LogInfo(msg=LaunchConfiguration("frequence")),
    """

    with pytest.raises(InputError, match=r"'frequence' .* did you mean 'frequency'"):
        ad.load_launch(describe(package, entities))


def test_an_unknown_way_to_take_errors_of_a_command_is_refused(package: Path) -> None:
    entities = "LogInfo(msg=Command(XACRO, on_stderr='stop')),"

    with pytest.raises(InputError, match="on_stderr 'stop': expected one of fail"):
        ad.load_launch(describe(package, entities))


@pytest.mark.slow
def test_what_one_manager_has_is_the_robot_that_is_published_elsewhere(
    package: Path,
) -> None:
    entities = """
    publisher(namespace="/arm/"),
    manager(parameters=[{"robot_description": Command(XACRO)}, YAML]),
    spawner("arm_controller", "-c", "/controller_manager"),
    spawner("forward", "-c", "/arm/controller_manager"),
    """
    before = """
    def manager(parameters):
        return Node(
            package="controller_manager", executable="ros2_control_node",
            parameters=parameters)
    """

    plan = ad.load_launch(describe(package, entities, before))

    (robot,) = plan.robots
    assert (robot.namespace, dict(robot.spawned)) == ("", {"arm_controller": "active"})
    (left_out,) = plan.not_started
    assert "forward" in str(left_out)


@pytest.mark.parametrize(
    ("package_name", "expected"),
    [
        ("LaunchConfiguration('of')", "is empty; give it as of:=NAME"),
        ("[LaunchConfiguration('of')]", "is empty; give it as of:=NAME"),
        ("['', LaunchConfiguration('of')]", "the name of a package is empty"),
    ],
)
def test_an_argument_that_names_no_package_is_told(
    package: Path, package_name: str, expected: str
) -> None:
    entities = f"""
    DeclareLaunchArgument("of", default_value=""),
    LogInfo(msg=FindPackageShare({package_name})),
    """

    with pytest.raises(InputError, match=expected):
        ad.load_launch(describe(package, entities))


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        "text.replace('child link=\"arm\"', 'child link=\"pole\"')"
        ".replace('link name=\"arm\"', 'link name=\"pole\"')",
        "by_tree(text)",
        "by_pattern(text)",
        "by_document(text)",
        "by_lines(f'  {text}'.strip())",
        "by_compiled(str(text).lstrip() + '\\n')",
        "by_compiled('%s' % text.removeprefix('<!-- nothing -->'))",
    ],
)
def test_the_text_of_a_description_may_be_changed(package: Path, change: str) -> None:
    before = f"""
    import re
    from xml.dom import minidom
    from xml.etree import ElementTree as ET

    def by_tree(text):
        root = ET.fromstring(text)
        root.findall("link")[1].set("name", "pole")
        root.find(".//child").set("link", "pole")
        return ET.tostring(root, encoding="unicode")

    def by_pattern(text):
        if len(re.findall("<link", text)) != 2 or len(text) < 100:
            raise RuntimeError("not the whole text")
        return re.sub('link( name)?="arm"', r'link\\1="pole"', text)

    def by_document(text):
        document = minidom.parseString(text)
        document.getElementsByTagName("link")[1].setAttribute("name", "pole")
        document.getElementsByTagName("child")[0].setAttribute("link", "pole")
        return document.toxml()

    def by_lines(text):
        if not text.startswith("<?xml") or not text.endswith("</robot>"):
            raise RuntimeError("not the whole text")
        lines = (line + "\\n" for line in text.split("\\n"))
        return by_pattern("".join(lines))

    def by_compiled(text):
        pattern = re.compile('link( name)?="arm"')
        if not isinstance(pattern, re.Pattern) or re.findall(pattern, "arm"):
            raise RuntimeError("no pattern")
        return pattern.sub(r'link\\1="pole"', text)

    def start(context):
        text = context.perform_substitution([Command(XACRO)])
        if "<ros2_control" not in text:
            raise RuntimeError("no ros2_control tag")
        return [Node(
            package="robot_state_publisher", executable="robot_state_publisher",
            parameters=[{{"robot_description": {change}}}])]
    """
    plan = ad.load_launch(describe(package, "OpaqueFunction(function=start),", before))

    (robot,) = plan.load_scene().robots
    assert list(robot.description.links) == ["world", "pole"]


@pytest.mark.slow
def test_what_stands_beside_a_description_stays_there(package: Path) -> None:
    before = """
    def start(context):
        text = "".join(["mine: ", Command(XACRO).perform(context)])
        return [LogInfo(msg=text)]
    """
    path = describe(package, "publisher(), OpaqueFunction(function=start),", before)

    report = ad.load_launch(path).report

    assert ["mine: <?xml" in e.what and "<link" in e.what for e in report] == [True]


@pytest.mark.slow
def test_an_expression_counts_a_description_whole(package: Path) -> None:
    words = ["len('''", "''') > 500"]
    expression = f"PythonExpression([{words[0]!r}, Command(XACRO), {words[1]!r}])"
    path = describe(package, f"publisher(), LogInfo(msg={expression}),")

    assert "True; so says" in str(ad.load_launch(path).report)


def test_a_description_may_be_spawned_from_a_file_that_has_it(package: Path) -> None:
    before = """
    import tempfile

    def start(context):
        with tempfile.NamedTemporaryFile("w", suffix=".urdf", delete=False) as file:
            file.write(Command(XACRO).perform(context))
        words = ["-file", file.name, "-name", "arm"]
        return [Node(package="ros_gz_sim", executable="create", arguments=words)]
    """
    path = describe(package, "OpaqueFunction(function=start),", before)

    (robot,) = ad.load_launch(path).robots

    assert robot.source == package / "urdf" / "pendulum.urdf.xacro"


def test_a_description_is_written_to_yaml_as_any_text(package: Path) -> None:
    before = """
    import yaml

    def start(context):
        text = Command(XACRO).perform(context)
        is_same = yaml.safe_load(yaml.safe_dump([text])) == [text]
        return [publisher([*XACRO, " prefix:=", "same_" if is_same else "other_"])]
    """
    path = describe(package, "OpaqueFunction(function=start),", before)

    (robot,) = ad.load_launch(path).load_scene().robots

    assert robot.description.movable_joints[0].name == "same_swing"


def test_a_description_that_is_only_passed_on_is_not_expanded(package: Path) -> None:
    entities = """
        publisher(["xacro ", os.path.join(PACKAGE, "nothing.xacro")]),
        manager(), spawner("forward"),
        """

    plan = ad.load_launch(describe(package, entities))

    with pytest.raises(ArmDrakeError, match="no such file or folder"):
        plan.load_scene()


def test_a_description_is_expanded_once_for_all_that_look_into_it(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expanded = []

    def expand(file: Path, *others: Any) -> str:
        expanded.append(file.name)
        return expand_xacro(file, *others)

    monkeypatch.setattr("arm_drake.launch.robot.expand_xacro", expand)
    before = """
    import xacro

    def start(context):
        made = xacro.process_file(XACRO[1]).toxml()
        return [LogInfo(msg=str(Command(XACRO).perform(context) == made))]
    """
    path = describe(package, "publisher(), OpaqueFunction(function=start),", before)

    plan = ad.load_launch(path)

    assert "True; so says" in str(plan.report)
    assert expanded == ["pendulum.urdf.xacro"]


def test_a_key_that_no_description_has_is_a_text(package: Path) -> None:
    before = """
    import re

    KEY = '<robot key="7" by="arm_drake"/>'
    """
    path = describe(package, "publisher(), LogInfo(msg=re.sub('o', '0', KEY)),", before)

    assert "<r0b0t" in str(ad.load_launch(path).report)


@pytest.mark.slow
def test_a_text_that_stays_as_it_is_comes_from_its_file(package: Path) -> None:
    before = """
    import re

    def start(context):
        text = Command(XACRO).perform(context).replace("${nothing}", "")
        text = re.sub("<nothing/>", "", text)
        return [Node(
            package="robot_state_publisher", executable="robot_state_publisher",
            parameters=[{"robot_description": text}])]
    """
    plan = ad.load_launch(describe(package, "OpaqueFunction(function=start),", before))

    assert plan.robots[0].source == package / "urdf" / "pendulum.urdf.xacro"


def test_both_ways_to_shut_the_launch_down_are_told_alike(package: Path) -> None:
    before = "from launch import events"
    path = describe(
        package,
        """
        Shutdown(reason="done"),
        EmitEvent(event=events.Shutdown(reason="done")),
        """,
        before,
    )

    # What is told twice is so once.
    (told,) = ad.load_launch(path).report
    assert (told.severity, told.what) == ("info", "it shuts the launch down")


def test_a_description_that_xacro_refuses_is_reported(package: Path) -> None:
    (package / "urdf" / "wrong.xacro").write_text(
        "<robot name='a' xmlns:xacro='http://www.ros.org/wiki/xacro'>"
        "<link name='${b}'/></robot>"
    )
    before = """
    import xacro
    file = os.path.join(PACKAGE, "urdf", "wrong.xacro")
    xacro.process_file(file).getElementsByTagName("link")
    """

    with pytest.raises(InputError, match=r"wrong.xacro:1: .*b"):
        ad.load_launch(describe(package, "", before))


@pytest.mark.slow
def test_the_launch_files_of_moveits_assistant_run(package: Path) -> None:
    config, launch = package / "config", package / "launch"
    (config / "pendulum.srdf").write_text(SRDF, encoding="utf-8")
    (config / "ros2_controllers.yaml").write_text(
        (config / "controllers.yaml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    simple = {"controller_names": ["arm_controller"]}
    (config / "moveit_controllers.yaml").write_text(
        yaml.safe_dump({"moveit_simple_controller_manager": simple}), encoding="utf-8"
    )
    parts = ("static_virtual_joint_tfs", "rsp", "move_group", "moveit_rviz")
    for name in (*parts, "spawn_controllers", "demo"):
        text = f"""
        from moveit_configs_utils import MoveItConfigsBuilder
        from moveit_configs_utils.launches import generate_{name}_launch

        def generate_launch_description():
            builder = MoveItConfigsBuilder("pendulum", package_name="pendulum_bringup")
            builder.robot_description("urdf/pendulum.urdf.xacro")
            return generate_{name}_launch(builder.to_moveit_configs())
        """
        write_launch(package, text, f"{name}.launch.py")

    plan = ad.load_launch(launch / "demo.launch.py")

    (robot,) = plan.robots
    assert robot.has_manager
    assert dict(robot.spawned) == {
        "arm_controller": "active",
        "joint_state_broadcaster": "active",
    }
    assert plan.has_move_group
    assert plan.rviz == config / "moveit.rviz"
    (frame,) = plan.static_frames
    assert frame[:2] == ("table", "world")
    (loaded,) = plan.load_scene().robots
    assert [path.name for path in loaded.srdf_files] == ["robot.srdf"]
    (launch / "static_virtual_joint_tfs.launch.py").unlink()
    (launch / "moveit_rviz.launch.py").unlink()
    without = ad.load_launch(launch / "demo.launch.py", arguments={"use_rviz": "0"})
    assert without.rviz is None
    assert not without.static_frames
    (launch / "spawn_controllers.launch.py").unlink()
    with pytest.raises(
        InputError, match=r"spawn_controllers\.launch\.py: no such file"
    ):
        ad.load_launch(launch / "demo.launch.py", arguments={"use_rviz": "0"})


def test_what_copies_of_moveits_demo_import_is_there(package: Path) -> None:
    srdf = SRDF.replace(
        "</robot>",
        "<group name='hand'><chain base_link='world' tip_link='arm'/></group>"
        "<group_state name='up' group='arm'><joint name='swing' value='1.5'/>"
        "</group_state></robot>",
    )
    (package / "config" / "pendulum.srdf").write_text(srdf, encoding="utf-8")
    before = """
    from moveit_configs_utils import MoveItConfigsBuilder
    from moveit_configs_utils.launch_utils import (
        DeclareBooleanLaunchArg, add_debuggable_node)
    from srdfdom.srdf import SRDF

    configs = MoveItConfigsBuilder("pendulum", package_name="pendulum_bringup")
    configs = configs.robot_description("urdf/pendulum.urdf.xacro").to_moveit_configs()
    (text,) = configs.robot_description_semantic.values()
    srdf = SRDF.from_xml_string(text)
    (joint,), (state,) = srdf.virtual_joints, srdf.group_states
    capabilities = configs.move_group_capabilities["capabilities"]
    assert (srdf.name, joint.name, joint.type) == ("pendulum", "fixed", "fixed")
    assert [each.name for each in srdf.groups] == ["arm", "hand"]
    assert [each.name for each in srdf.groups[0].joints] == ["swing"]
    assert srdf.groups[1].chains[0].tip_link == "arm"
    assert (state.group, state.joints[0].value) == ("arm", [1.5])
    assert srdf.disable_collisionss == [] and srdf.end_effectors == []

    more = LaunchDescription()
    add_debuggable_node(
        more, package="moveit_ros_move_group", executable="move_group",
        parameters=[configs.to_dict()], commands_file="gdb", extra_debug_args=["-d"])
    """
    path = describe(
        package,
        """
        DeclareBooleanLaunchArg("db", default_value=True, description="A data base"),
        DeclareLaunchArgument("capabilities", default_value=capabilities),
        publisher(condition=IfCondition(LaunchConfiguration("db"))),
        Node(package="tf2_ros", executable="static_transform_publisher",
             arguments=["--frame-id", joint.parent_frame,
                        "--child-frame-id", joint.child_link]),
        *more.entities,
        """,
        before,
    )

    plan = ad.load_launch(path)

    assert plan.has_move_group
    assert [frame[:2] for frame in plan.static_frames] == [("table", "world")]
    assert {a.name: a.default for a in plan.arguments} == {
        "db": "true",
        "capabilities": "",
    }
    assert len(plan.robots) == 1


def test_actions_of_gazebo_are_its_launch_files(package: Path) -> None:
    (package / "w.sdf").write_text("<sdf version='1.9'><world name='w'/></sdf>")
    before = """
    from ros_gz_bridge.actions import RosGzBridge
    from ros_gz_sim.actions import GzServer, GzSpawnModel
    """
    path = describe(
        package,
        """
        GzServer(world_sdf_file=os.path.join(PACKAGE, "w.sdf")), publisher(),
        GzSpawnModel(topic="robot_description", entity_name="left", x="1.5"),
        GzSpawnModel(topic="robot_description", entity_name="right", x="0"),
        RosGzBridge(bridge_name="b", config_file=os.path.join(PACKAGE, "b.yaml")),
        """,
        before,
    )

    plan = ad.load_launch(path)

    assert plan.world == package / "w.sdf"
    assert [(robot.name, robot.pose) for robot in plan.robots] == [
        ("left", (1.5, 0.0, 0.0, 0.0, 0.0, 0.0)),
        ("right", (0.0,) * 6),
    ]
    assert plan.bridge_files == (package / "b.yaml",)


@pytest.mark.parametrize("suffix", ["xml", "yaml"])
def test_actions_of_gazebo_are_elements_too(package: Path, suffix: str) -> None:
    (package / "w.sdf").write_text("<sdf version='1.9'><world name='w'/></sdf>")
    (package / "launch").mkdir(exist_ok=True)
    path = package / f"launch/gz.launch.{suffix}"
    if suffix == "xml":
        path.write_text("""
<launch>
  <arg name="x" default="1.5"/>
  <arg name="urdf" default="$(dirname)/../urdf/pendulum.urdf.xacro"/>
  <gz_server world_sdf_file="$(find-pkg-share pendulum_bringup)/w.sdf"/>
  <node pkg="robot_state_publisher" exec="robot_state_publisher">
    <param name="robot_description" value="$(command 'xacro $(var urdf)')"/>
  </node>
  <gz_spawn_model topic="robot_description" entity_name="left" x="$(var x)"/>
  <gz_spawn_model topic="robot_description" entity_name="no" if="false"/>
  <ros_gz_bridge bridge_name="b" config_file="$(dirname)/../b.yaml"/>
</launch>""")
    else:
        path.write_text("""
launch:
- arg: {name: x, default: "1.5"}
- arg: {name: urdf, default: $(dirname)/../urdf/pendulum.urdf.xacro}
- gz_server: {world_sdf_file: $(find-pkg-share pendulum_bringup)/w.sdf}
- node:
    pkg: robot_state_publisher
    exec: robot_state_publisher
    param:
    - {name: robot_description, value: "$(command 'xacro $(var urdf)')"}
- gz_spawn_model: {topic: robot_description, entity_name: left, x: $(var x)}
- gz_spawn_model: {topic: robot_description, entity_name: "no", if: false}
- ros_gz_bridge: {bridge_name: b, config_file: $(dirname)/../b.yaml}
""")

    plan = ad.load_launch(path)

    assert plan.world == package / "w.sdf"
    assert [(robot.name, robot.pose) for robot in plan.robots] == [
        ("left", (1.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    ]
    (bridge_file,) = plan.bridge_files
    assert bridge_file.resolve() == package / "b.yaml"


CART = """
<sdf version="1.8"><model name="cart"><link name="base"/>
<link name="a"/><joint name="left" type="revolute"><parent>base</parent>
  <child>a</child><axis><xyz>0 1 0</xyz></axis></joint>
<link name="b"/><joint name="right" type="revolute"><parent>base</parent>
  <child>b</child><axis><xyz>0 1 0</xyz></axis></joint>
<plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">
  <left_joint>left</left_joint><right_joint>right</right_joint>
  <topic>cmd_vel</topic></plugin></model></sdf>"""


def test_an_sdf_model_with_plugins_that_move_it_is_the_robot(package: Path) -> None:
    (package / "cart.sdf").write_text(CART)
    path = describe(
        package,
        """
        publisher(), ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]),
        Node(package="ros_gz_sim", executable="create", arguments=[
            "-file", os.path.join(PACKAGE, "cart.sdf"), "-name", "my_cart"]),
        """,
    )
    plan = ad.load_launch(path)

    (robot,) = plan.load_scene().robots

    # What robot_state_publisher has is how RViz sees it.
    assert robot.name == "my_cart"
    assert [c.name for c in robot.controllers.controllers] == ["DiffDrive"]
    assert plan.models == ()


def test_an_sdf_model_may_be_a_published_description(package: Path) -> None:
    (package / "cart.sdf").write_text(
        CART.replace("<sdf ", '<sdf xmlns:xacro="http://ros.org/wiki/xacro" ').replace(
            '"cart"', "\"${2 * 'x'}\""
        )
    )
    path = describe(
        package,
        """
        publisher(["xacro ", os.path.join(PACKAGE, "cart.sdf")]),
        ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]),
        Node(package="ros_gz_sim", executable="create",
             arguments=["-topic", "robot_description"]),
        """,
    )

    (robot,) = ad.load_launch(path).load_scene().robots

    assert (robot.name, robot.has_free_base) == ("xx", True)


@pytest.mark.parametrize("link", ["world", "trunk"])
def test_a_base_that_gazebo_would_not_hold_is_told(package: Path, link: str) -> None:
    urdf = package / "urdf" / "pendulum.urdf.xacro"
    urdf.write_text(urdf.read_text().replace('"world"', f'"{link}"'))
    path = describe(
        package,
        """
        publisher(), ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]),
        Node(package="ros_gz_sim", executable="create",
             arguments=["-topic", "robot_description"]),
        """,
    )

    (robot,) = ad.load_launch(path).load_scene().robots

    told = [
        f"warning: {urdf}: Gazebo holds 'trunk' nowhere: there is no link 'world'; "
        "it is held where it starts; it neither falls nor walks"
    ]
    found = [str(each) for each in robot.report if "Gazebo" in each.what]
    assert found == (told if link == "trunk" else [])


ROBOTS = "one={x: 1.0, yaw: 0.5}; two = {y: 2.0};"


@pytest.mark.parametrize(
    ("poses", "arguments"),
    [
        ("ParseMultiRobotPose('robots').value()", {"robots": ROBOTS}),
        (f"ParseMultiRobotPose({ROBOTS!r}).perform(None)", {}),
    ],
)
def test_robots_and_their_poses_are_one_argument(
    package: Path, poses: str, arguments: dict[str, str]
) -> None:
    before = "from nav2_common.launch import ParseMultiRobotPose\n"
    path = describe(
        package,
        f"""
        publisher(), *[Node(package="ros_gz_sim", executable="create", arguments=[
            "-topic", "robot_description", "-name", name,
            *[w for a, v in (("x", "x"), ("y", "y"), ("Y", "yaw"))
              for w in ("-" + a, str(pose[v]))]])
          for name, pose in {poses}.items()],
        """,
        before,
    )

    plan = ad.load_launch(path, arguments=arguments)

    assert [(robot.name, robot.pose) for robot in plan.robots] == [
        ("one", (1.0, 0.0, 0.0, 0.0, 0.0, 0.5)),
        ("two", (0.0, 2.0, 0.0, 0.0, 0.0, 0.0)),
    ]


def test_conditions_of_navigation_are_told(package: Path) -> None:
    before = "from nav2_common.launch import HasNodeParams, LaunchConfigAsBool\n"
    path = describe(
        package,
        """
        DeclareLaunchArgument("on", default_value="Yes"),
        publisher(), manager(),
        *[spawner(name, condition=IfCondition(decides)) for name, decides in (
            ("arm_controller", HasNodeParams(YAML, "arm_controller")),
            ("forward", HasNodeParams(YAML, "backward")),
            ("joint_state_broadcaster", LaunchConfigAsBool("on")))],
        """,
        before,
    )

    (robot,) = ad.load_launch(path).robots

    assert list(robot.spawned) == ["arm_controller", "joint_state_broadcaster"]


def test_a_bridges_file_that_is_rewritten_is_told_by_its_name(package: Path) -> None:
    (package / "b.yaml").write_text("[]")
    before = "from nav2_common.launch import ReplaceString\n"
    path = describe(
        package,
        """
        publisher(), Node(package="ros_gz_bridge", executable="parameter_bridge",
            parameters=[{"config_file": ReplaceString(
                os.path.join(PACKAGE, "b.yaml"), {"a": "b"})}]),
        """,
        before,
    )

    plan = ad.load_launch(path)

    assert f"bridge: {package / 'b.yaml'}" in str(plan).splitlines()


@pytest.mark.slow
def test_one_description_may_be_spawned_twice(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(),
        *[Node(package="ros_gz_sim", executable="create",
               arguments=["-topic", "robot_description", "-name", "one", "-y", str(y)])
          for y in (0.0, 2.0)],
        """,
    )
    plan = ad.load_launch(path)

    scene = plan.load_scene()

    assert [robot.name for robot in scene.robots] == ["one", "one_2"]
    assert scene.robots[1].pose[1] == 2.0
    assert "several robots are called 'one'; one is 'one_2' here" in str(plan.report)


def test_a_spawner_without_its_manager_starts_nothing(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(), spawner("forward"),
        spawner("arm_controller", "-c", "/left/controller_manager"),
        Node(package="controller_manager", executable="spawner",
             arguments="joint_state_broadcaster -c /controller_manager"),
        """,
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert list(robot.spawned) == ["forward", "joint_state_broadcaster"]
    assert list(map(str, plan.not_started)) == [
        "not started: controller arm_controller; /left/controller_manager isn't "
        "started; there is /controller_manager"
    ]


def test_the_functions_of_launch_utils_take_what_upstream_takes(package: Path) -> None:
    before = """
    from controller_manager.launch_utils import (
        generate_controllers_spawner_launch_description as spawn,
        generate_controllers_spawner_launch_description_from_dict as spawn_from_dict,
        generate_load_controller_launch_description as load)

    HERE = get_package_share_directory("pendulum_bringup") + "/config/"
    """
    for name in ("arm", "torso"):
        text = f"{name}: {{ros__parameters: {{type: own/Own}}}}"
        (package / "config" / f"{name}.yaml").write_text(text)
    path = describe(
        package,
        """
        publisher(), manager(),
        load(controller_name="arm", controller_params_file=HERE + "arm.yaml"),
        load("torso", HERE + "torso.yaml", ["--inactive"]),
        load("head", "own/Head"),
        spawn(controller_names=["forward"], extra_spawner_args=["--inactive"]),
        spawn_from_dict(controller_info_dict={"arm_controller": None}),
        """,
        before,
    )

    (robot,) = ad.load_launch(path).robots

    assert robot.spawned == {
        "arm": "active",
        "torso": "inactive",
        "head": "active",
        "forward": "inactive",
        "arm_controller": "active",
    }
    files = [file.name for file in robot.controllers[:3]]
    assert files == ["controllers.yaml", "arm.yaml", "torso.yaml"]


def test_the_index_of_resources_knows_packages(package: Path) -> None:
    before = """
    from ament_index_python import get_resources, get_search_paths, has_resource
    from ament_index_python.resources import get_resource

    IS_THERE = bool(has_resource("packages", "pendulum_bringup"))
    FOUND = [get_resources("own_type"), get_search_paths(), IS_THERE,
             has_resource("packages", "gone"), has_resource("own_type", "a")]
    SHARE = os.path.join(get_resource("packages", "pendulum_bringup")[1], "share",
                         "pendulum_bringup", "config")
    """
    actions = (
        "LogInfo(msg=str(FOUND)), LogInfo(msg=str(os.listdir(SHARE))), publisher(),"
    )

    plan = ad.load_launch(describe(package, actions, before))

    assert "[{}, [], True, False, False]" in str(plan.report)
    assert "['controllers.yaml']" in str(plan.report)


def test_spawners_without_manager_and_simulator_start_nothing(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = describe(package, "publisher(), spawner('forward'),")

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert not robot.spawned
    assert list(map(str, plan.not_started)) == [
        "not started: controller forward; /controller_manager isn't started; there is "
        "no ros2_control_node, and nothing puts it into a simulator"
    ]
    assert main(["launch", str(path), "--headless"]) == 2
    assert "controller forward; /controller_manager" in capsys.readouterr().err


def test_a_node_with_controllers_and_spawners_is_a_controller_manager(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        publisher(),
        Node(package="own_driver", executable="control_node",
             parameters=[CONTROLLERS]),
        Node(package="own_driver", executable="publisher_node",
             parameters=[CONTROLLERS], name="goals"),
        Node(package="own_driver", executable="watcher", namespace="left",
             parameters=[{"arm": {"type": "own/Arm"}}]),
        spawner("forward"),
        """,
        "CONTROLLERS = get_package_share_directory('pendulum_bringup') "
        "+ '/config/controllers.yaml'",
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert (robot.has_manager, robot.spawned) == (True, {"forward": "active"})
    assert [file.name for file in robot.controllers] == ["controllers.yaml"]
    names = [each.name for each in plan.not_started]
    assert names == ["own_driver/publisher_node", "own_driver/watcher"]
    told = "own_driver/control_node has the controllers of /controller_manager"
    assert f"node {told}; it is taken as a controller manager" in str(plan.report)


def test_the_ros2_control_node_of_another_package_is_a_controller_manager(
    package: Path,
) -> None:
    # As mujoco_ros2_control has it, with types in the files of the spawners alone.
    path = describe(
        package,
        """
        publisher(),
        Node(package="own_simulator", executable="ros2_control_node",
             parameters=[{"update_rate": 50}]),
        spawner("forward", "--param-file", CONTROLLERS),
        """,
        "CONTROLLERS = get_package_share_directory('pendulum_bringup') "
        "+ '/config/controllers.yaml'",
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert (robot.has_manager, robot.spawned) == (True, {"forward": "active"})
    assert not plan.not_started
    told = "own_simulator/ros2_control_node is asked for controllers of"
    assert (
        f"node {told} /controller_manager; it is taken as a controller manager"
        in str(plan.report)
    )


def test_a_world_that_a_robot_is_put_into_by_other_means_has_its_controllers(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        publisher(), ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]),
        spawner("forward"),
        """,
    )

    plan = ad.load_launch(path)

    assert list(plan.robots[0].spawned) == ["forward"]
    assert not plan.not_started


def test_a_description_that_two_nodes_publish_is_one_robot(package: Path) -> None:
    entities = "publisher(), publisher(), manager(), spawner('forward'),"

    plan = ad.load_launch(describe(package, entities))

    assert len(plan.robots) == 1
    assert not list(plan.report)


@pytest.mark.parametrize(
    ("entities", "name"),
    [
        ("again, again, manager(), spawner('forward'),", "robot_state_publisher"),
        ("publisher(), manager(), waited,", "controller_manager/spawner"),
    ],
)
def test_an_action_that_starts_its_program_once_more_is_an_error(
    package: Path, entities: str, name: str
) -> None:
    before = """
    again = publisher()
    first, second = spawner("forward"), spawner("joint_state_broadcaster")
    waited = GroupAction([
        first, RegisterEventHandler(OnProcessExit(target_action=first, on_exit=second)),
        second])
    """

    plan = ad.load_launch(describe(package, entities, before))

    assert len(plan.robots) == 1
    assert next(iter(plan.robots[0].spawned)) == "forward"
    (entry,) = plan.report.errors
    assert f"{name} is started once more" in str(entry)
    assert "'executed more than once'" in str(entry)
    assert str(entry.file).endswith(".launch.py")


@pytest.mark.parametrize(
    ("parameters", "line"),
    [
        ('ReplaceString(SOURCE, {"<joint>": "swung"})', 4),
        ("ParameterFile(SOURCE, allow_substs=True)", 4),
        ('ReplaceString(ReplaceString(SOURCE, {}), {"<joint>": "swung"})', 4),
        ('RewrittenYaml(SOURCE, {"joints": "[swung]"}, convert_types=True)', None),
    ],
)
def test_messages_name_the_file_of_which_parameters_are_rewritten(
    package: Path, parameters: str, line: int | None
) -> None:
    source = package / "config" / "templates.yaml"
    source.write_text(
        "# Of a template.\n"
        "controller_manager:\n"
        "  ros__parameters:\n"
        "    forward: {type: forward_command_controller/ForwardCommandController}\n"
        "forward:\n"
        "  ros__parameters: {joints: [$(var joint)], interface_name: position}\n"
    )
    text = source.read_text()
    if "ReplaceString" in parameters:
        source.write_text(text.replace("$(var joint)", "<joint>"))
    before = f"""
    from nav2_common.launch import ReplaceString, RewrittenYaml
    SOURCE = {str(source)!r}
    """
    path = describe(
        package,
        f"""
        SetLaunchConfiguration("joint", "swung"), publisher(),
        Node(package="controller_manager", executable="ros2_control_node",
             parameters=[{parameters}]),
        spawner("forward"),
        """,
        before,
    )
    plan = ad.load_launch(path)

    robot = plan.load_scene().robots[0]

    (entry,) = [e for e in robot.report.errors if "swung" in str(e)]
    assert (entry.file, entry.line) == (str(source), line)
    assert f"parameters: {source}" in str(plan)


@pytest.mark.parametrize(
    "parameters",
    [
        "ReplaceString('{}', {{'a': 'b'}})",
        "RewrittenYaml('{}', {{}})",
        "ParameterFile('{}', allow_substs=True)",
    ],
)
def test_a_file_to_rewrite_that_can_not_be_read_is_named(
    package: Path, parameters: str
) -> None:
    source = package / "config" / "nothing.yaml"
    before = "from nav2_common.launch import ReplaceString, RewrittenYaml\n"
    entities = (
        "publisher(), Node(package='controller_manager', "
        f"executable='ros2_control_node', parameters=[{parameters.format(source)}]),"
    )
    path = describe(package, entities, before)

    with pytest.raises(InputError) as caught:
        ad.load_launch(path)

    assert str(caught.value) == (
        f"{path}: {source} can't be read: No such file or directory"
    )


def test_a_file_that_is_broken_once_it_is_rewritten_is_named(package: Path) -> None:
    source = package / "config" / "templates.yaml"
    source.write_text("# Of a template.\nforward: <joint>\n")
    before = f"""
    from nav2_common.launch import ReplaceString
    SOURCE = {str(source)!r}
    """
    path = describe(
        package,
        """
        publisher(),
        Node(package="controller_manager", executable="ros2_control_node",
             parameters=[ReplaceString(SOURCE, {"<joint>": "{joint: ["})]),
        """,
        before,
    )
    plan = ad.load_launch(path)

    with pytest.raises(InputError) as caught:
        plan.load_scene()

    assert str(caught.value).startswith(f"{source}:")


def test_a_package_may_execute_actions_and_have_its_own(package: Path) -> None:
    before = """
    from launch import Action

    class Twice(Action):
        def execute(self, context):
            name = context.launch_configurations["controller"]
            return [spawner(name), spawner("joint_state_broadcaster")]

    class Manager(Node):
        def execute(self, context):
            LogInfo(msg=["it is ", self.name]).execute(context=context)
            return super().execute(context)

    def start(context):
        SetLaunchConfiguration("controller", "forward").execute(context)
        publisher(condition=UnlessCondition("true")).visit(context)
        publisher().visit(context)
        return [Twice(), Twice(condition=IfCondition("false"))]
    """
    path = describe(
        package,
        """
        OpaqueFunction(function=start),
        Manager(package="controller_manager", executable="ros2_control_node",
                name="controller_manager", parameters=[YAML]),
        """,
        before,
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert list(robot.spawned) == ["forward", "joint_state_broadcaster"]
    assert robot.has_manager
    (entry,) = plan.report
    assert entry.what == "it is controller_manager"


def test_relative_paths_are_those_of_the_working_directory(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = """
    with open("config/controllers.yaml") as file:
        assert "forward" in file.read()
    try:
        open("written.txt", "w")
    except PermissionError:
        pass
    """
    path = describe(
        package,
        """
        publisher(["xacro ", "urdf/pendulum.urdf.xacro"]),
        Node(package="controller_manager", executable="ros2_control_node",
             parameters=["config/controllers.yaml"]),
        spawner("forward"),
        """,
        before,
    )
    monkeypatch.chdir(package)

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert robot.source == package / "urdf" / "pendulum.urdf.xacro"
    options = plan.load_scene().options
    assert options.active == ("forward",)
    assert not (package / "written.txt").exists()


@pytest.mark.slow
def test_what_is_sent_to_one_of_several_robots_is_its_motion(package: Path) -> None:
    before = """
    def send(name):
        command = ["ros2", "topic", "pub", "--once", f"/{name}/forward/commands",
                   "std_msgs/msg/Float64MultiArray", "{data: [0.5]}"]
        return ExecuteProcess(cmd=command)

    def robot(name):
        return GroupAction([
            PushRosNamespace(name), publisher([*XACRO, " prefix:="]),
            manager(), spawner("forward")])
    """
    names = "left", "right"
    parts = [f"robot('{name}'), send('{name}')," for name in names]
    plan = ad.load_launch(describe(package, "\n".join([*parts, "send('up'),"]), before))

    scene = plan.load_scene()

    assert set(scene.motions) == {"left", "right"}
    for motion in scene.motions.values():
        (step,) = motion.steps
        assert "/forward/commands" in str(step.message)
    assert "/up/forward/commands is no robot's" in str(plan.report)


@pytest.mark.slow
def test_what_can_not_be_taken_is_reported_with_the_robot(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(), spawner("forward"),
        Node(package="own", executable="watcher"),
        Node(package="tf2_ros", executable="static_transform_publisher",
             arguments=["--x", "much", "--frame-id", "a", "--child-frame-id", "b"]),
        Node(package="tf2_ros", executable="static_transform_publisher"),
        Node(package="ros_gz_sim", executable="create",
             arguments=["-file", "/nowhere/table.sdf"]),
        """,
    )
    plan = ad.load_launch(path)

    told = str(plan.load_scene().robots[0].report)

    for part in (
        "node own/watcher; it is not started",
        "--x much --frame-id a --child-frame-id b: much is no number; it is left out",
        "static_transform_publisher : it names no frames",
        "no such model: /nowhere/table.sdf",
    ):
        assert part in told
    assert (
        main(["launch", str(path), "--headless", "--duration", "0.1", "--strict"]) == 2
    )
    assert main(["launch", str(path), "--print", "--strict"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "entities",
    [
        "Node(package='robot_state_publisher', executable='r', arguments=['no.urdf']),",
        "publisher(), manager(), Node(package='controller_manager', "
        "executable='ros2_control_node', parameters=[{'a': 1, 'a.b': 2}]),",
        "publisher(), manager(name='../up'), spawner('forward', '-c', '../up'),",
        "publisher(), Node(package='ros_gz_sim', executable='create', "
        "arguments=['-file', 'x' * 5000]),",
        "ExecuteProcess(cmd=['gz', 'sim', 'w' * 5000]),",
        "Node(package='robot_state_publisher', executable='r', parameters=["
        "{'robot_description': '<robot key=\"99\" by=\"arm_drake\"/>'}]),",
        "publisher(), LogInfo(msg=str({1, 2.5, (3,)})), Node(package='a', "
        "executable='b', parameters=[{'c': object()}]),",
    ],
)
def test_odd_things_end_as_a_plan(package: Path, entities: str) -> None:
    plan = ad.load_launch(describe(package, entities))

    assert str(plan).startswith("launch file: ")


def test_a_package_without_a_name_is_reported(package: Path) -> None:
    path = describe(package, "", "get_package_share_directory(None)")

    with pytest.raises(PackageError, match="None"):
        ad.load_launch(path)


def test_descriptions_of_moveit_take_arguments_of_the_launch(package: Path) -> None:
    (package / "config" / "pendulum.srdf").write_text(SRDF, encoding="utf-8")
    path = describe(
        package,
        """
        DeclareLaunchArgument("side", default_value="left_"),
        Node(package="robot_state_publisher", executable="robot_state_publisher",
             parameters=[configs.robot_description]),
        Node(package="moveit_ros_move_group", executable="move_group",
             parameters=[configs.to_dict()]),
        """,
        """
        from moveit_configs_utils import MoveItConfigsBuilder
        configs = (
            MoveItConfigsBuilder("pendulum", package_name="pendulum_bringup")
            .robot_description(
                file_path="urdf/pendulum.urdf.xacro",
                mappings={"prefix": LaunchConfiguration("side")})
            .to_moveit_configs())
        """,
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert robot.xacro_args == {"prefix": "left_"}
    assert plan.has_move_group


def test_rviz_may_be_started_with_a_fixed_frame(package: Path) -> None:
    path = describe(
        package,
        "publisher(), Node(package='rviz2', executable='rviz2',"
        " arguments=['-f', 'arm', '-d', PACKAGE + '/none.rviz']),",
    )

    plan = ad.load_launch(path)

    assert plan.fixed_frame == "arm"
    assert plan.rviz == package / "none.rviz"


def test_a_fixed_frame_of_rviz_is_no_matter_without_a_page(package: Path) -> None:
    rviz = 'Node(package="rviz2", executable="rviz2", arguments=["-f", "world"])'
    path = describe(package, f"publisher(), manager(), spawner('forward'), {rviz}")

    assert main(["launch", str(path), "--headless", "--duration", "0.1"]) == 0


@pytest.mark.slow
def test_the_command_line_says_how_a_robot_is_loaded(
    package: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = describe(package, "publisher(), manager(), spawner('slow'),")
    text = (package / "config" / "controllers.yaml").read_text(encoding="utf-8")
    other = tmp_path / "other.yaml"
    # Another name for one of them, and a variable for its joint.
    text = text.replace("forward:", "slow:").replace("[swing]", '["$(var joint)"]')
    other.write_text(text, encoding="utf-8")
    words = ["launch", str(path), "--headless", "--duration", "0.01", "--name", "one"]
    words += ["--controllers", str(other), "--var", "joint=swing", "--json"]

    assert main([*words, "--add-frame", "tip=arm,0,0,1"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["robot"] == "one"
    assert {c["name"]: c["state"] for c in told["controllers"]}["slow"] == "active"
    assert main([*words, "--add-frame", "tip=leg,0,0,1"]) == 2
    assert "no link 'leg'; known: arm, world" in capsys.readouterr().err


def test_a_module_that_its_package_lacks_is_reported(package: Path) -> None:
    path = describe(package, "", "from pendulum_bringup.msg import Angle")

    with pytest.raises(InputError, match=r"'pendulum_bringup.*', which isn't in its"):
        ad.load_launch(path)


@pytest.mark.slow
def test_a_function_may_add_actions_to_the_description_that_it_is_in(
    package: Path,
) -> None:
    text = """
        from launch import LaunchDescription
        from launch.actions import LogInfo, OpaqueFunction

        def add(context, description):
            description.add_action(LogInfo(msg="added"))

        def generate_launch_description():
            description = LaunchDescription([])
            description.add_action(OpaqueFunction(function=add, args=[description]))
            return description
        """

    plan = ad.load_launch(write_launch(package, text))

    assert [entry.what for entry in plan.report] == ["added"]
