"""Launch files: what they start, as ROS's documentation of launch says."""

import gc
from pathlib import Path

import pytest
import yaml

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import InputError, PackageError
from arm_drake.launch.launch_files import load_arguments, show_arguments
from arm_drake.messages import Twist, Vector3
from arm_drake.planning.timing import motion_limits
from tests.carts import cart, diff_drive
from tests.launch.packages import CONTROLLERS, describe, make_package, write_launch


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return make_package(tmp_path)


def states(plan: ad.LaunchPlan) -> dict[str, str]:
    (robot,) = plan.robots
    return dict(robot.spawned)


def names(plan: ad.LaunchPlan) -> list[str]:
    return [each.name for each in plan.not_started]


@pytest.mark.slow
def test_a_robot_runs_under_the_controllers_that_are_spawned(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(),
        spawner("joint_state_broadcaster"),
        spawner("arm_controller", "--controller-manager", "/controller_manager"),
        spawner("forward", "--inactive"),
        """,
    )

    plan = ad.load_launch(path)

    (robot,) = plan.robots
    assert robot.source == package / "urdf" / "pendulum.urdf.xacro"
    assert robot.controllers == (package / "config" / "controllers.yaml",)
    assert plan.world is None
    assert plan.is_simulated
    simulation = ad.Simulation(plan.build_diagram())
    found = {each.name: each.state for each in simulation.list_controllers()}
    assert found == {
        "joint_state_broadcaster": "active",
        "arm_controller": "active",
        "forward": "inactive",
    }
    simulation.run(0.1)


@pytest.mark.slow
def test_what_is_not_spawned_does_not_run(package: Path) -> None:
    path = describe(package, "publisher(), manager(), spawner('forward'),")

    scene = ad.load_launch(path).load_scene()

    assert scene.options.active == ("forward",)
    assert set(scene.options.inactive) == {"joint_state_broadcaster", "arm_controller"}


@pytest.mark.slow
def test_what_is_not_spawned_and_can_not_run_is_left_out(package: Path) -> None:
    config = package / "config" / "controllers.yaml"
    text = config.read_text(encoding="utf-8")
    text = text.replace("joints: [swing], interface", "joints: [gone], interface")
    config.write_text(
        text.replace("    forward:", "    own: {type: own/Own}\n    forward:")
    )
    path = describe(package, 'publisher(), manager(), spawner("arm_controller"),')

    (robot,) = ad.load_launch(path).load_scene().robots

    assert not robot.report.errors
    known = [each.name for each in robot.controllers.controllers]
    assert known == ["joint_state_broadcaster", "arm_controller"]
    assert "no spawner loads own, forward; they are left out" in str(robot.report)
    (reason,) = [entry for entry in robot.report if entry.where == "forward"]
    assert ("no joint 'gone'" in reason.what, reason.severity) == (True, "info")
    path = describe(package, 'publisher(), manager(), spawner("forward"),')
    (robot,) = ad.load_launch(path).load_scene().robots
    (error,) = robot.report.errors
    assert (error.where, "no joint 'gone'" in error.what) == ("forward", True)
    path = describe(package, 'publisher(), manager(), spawner("foward"),')
    plan = ad.load_launch(path)
    (robot,) = plan.load_scene().robots
    assert [each.where for each in robot.report.errors] == ["forward"]
    assert "'foward' is spawned but has no parameters" in str(plan.report)
    assert "did you mean 'forward'?" in str(plan.report)


@pytest.mark.slow
def test_a_controller_without_parameters_is_reported(package: Path) -> None:
    path = describe(package, "publisher(), manager(), spawner('arm_controler'),")
    plan = ad.load_launch(path)

    scene = plan.load_scene()

    assert "arm_controller" in scene.options.inactive
    (line, *_) = map(str, plan.report)
    assert "'arm_controler' is spawned but has no parameters" in line
    assert "did you mean 'arm_controller'?" in line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("initial", "entity", "forward"),
    [
        ("inactive: [pendulum]", 'hardware("pendulum", "--activate")', "active"),
        ("unconfigured: [pendulum]", 'hardware("--activate", "pendulum")', "active"),
        ("unconfigured: [pendulum]", 'hardware("pendulum", "--configure")', "inactive"),
        ("inactive: [pendulum]", 'hardware("other", "--activate")', "inactive"),
        (
            "inactive: [pendulum]",
            'ExecuteProcess(cmd=["ros2", "control", "set_hardware_component_state", '
            '"pendulum", "active"])',
            "active",
        ),
    ],
)
def test_hardware_that_is_activated_later_lets_its_controllers_run(
    package: Path, initial: str, entity: str, forward: str
) -> None:
    file = package / "config" / "controllers.yaml"
    settings = f"update_rate: 100\n    hardware_components_initial_state: {{{initial}}}"
    text = file.read_text(encoding="utf-8").replace("update_rate: 100", settings)
    file.write_text(text, encoding="utf-8")
    path = describe(
        package,
        f"""
        publisher(), manager(), {entity},
        spawner("joint_state_broadcaster", "forward"),
        """,
        before="""
        def hardware(*words):
            return Node(package="controller_manager", executable="hardware_spawner",
                        arguments=[*words, "-c", "/controller_manager"])
        """,
    )

    sim = ad.Simulation(ad.load_launch(path).build_diagram())

    found = {each.name: each.state for each in sim.list_controllers()}
    assert found["forward"] == forward


@pytest.mark.slow
def test_what_is_told_of_a_rewritten_file_names_the_users_own_once(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = package / "config" / "controllers.yaml"
    text = CONTROLLERS.replace("interface_name: position", "interface_name: effort")
    states = (
        "update_rate: 9\n    hardware_components_initial_state.inactive: [pendulum]"
    )
    file.write_text(text.replace("update_rate: 100", states), encoding="utf-8")
    path = describe(
        package,
        """
        publisher(), manager(), spawner("forward"),
        Node(package="controller_manager", executable="hardware_spawner",
             arguments=["pendulum", "--activate"]),
        """,
    )

    main(["launch", str(path), "--headless", "--duration", "0.1"])

    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {file}: forward: ")


@pytest.mark.slow
def test_a_state_of_hardware_that_is_not_taken_is_reported(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(), spawner("forward"), *(
            ExecuteProcess(
                cmd=["ros2", "control", "set_hardware_component_state", name, state])
            for name, state in (("pendulun", "active"), ("pendulum", "inactive"))),
        """,
    )

    (robot,) = ad.load_launch(path).load_scene().robots

    assert [str(entry) for entry in robot.report if "hardware" in entry.what] == [
        "warning: hardware component 'pendulun' is set active; it isn't there; did you "
        "mean 'pendulum'? known: pendulum",
        "warning: hardware component 'pendulum' is set inactive; it stays active",
    ]


def test_a_state_of_hardware_that_there_is_none_of_is_reported(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(),
        ExecuteProcess(cmd=["ros2", "control", "set_hardware_component_state",
                            "pendulum", "inactive"]),
        ExecuteProcess(cmd=["ros2", "control", "set_hardware_component_state",
                            "pendulum", "on"]),
        *(Node(package="controller_manager", executable="hardware_spawner",
               arguments=words) for words in (["pendulum"], ["--activate"])),
        """,
    )

    plan = ad.load_launch(path)

    assert plan.robots[0].hardware == {"pendulum": "inactive"}
    done = "it has no effect; expected names and one of unconfigured, inactive, active"
    assert [str(entry) for entry in plan.report] == [
        f"warning: {path}: hardware components 'pendulum' are set on; {done}",
        f"warning: {path}: hardware components 'pendulum' are set no state; {done}",
        f"warning: {path}: hardware components without names are set active; {done}",
    ]


@pytest.mark.slow
def test_hardware_of_a_manager_that_is_not_started_is_reported(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(), Node(package="controller_manager",
            executable="hardware_spawner",
            arguments=["pendulum", "--activate", "-c", "/arm/controller_manager"]),
        """,
    )

    plan = ad.load_launch(path)

    assert [str(each) for each in plan.not_started] == [
        "not started: hardware component pendulum; /arm/controller_manager isn't "
        "started; there is /controller_manager"
    ]


@pytest.mark.slow
def test_arguments_have_defaults_choices_and_given_values(package: Path) -> None:
    path = describe(
        package,
        """
        DeclareLaunchArgument("side", default_value="left", choices=["left", "right"],
                              description="Which side."),
        DeclareLaunchArgument(
            "prefix", default_value=[LaunchConfiguration("side"), "_"]),
        publisher([*XACRO, " prefix:=", LaunchConfiguration("prefix")]),
        """,
    )

    for given, prefix in (({}, "left_"), ({"side": "right"}, "right_")):
        plan = ad.load_launch(path, arguments=given)
        assert plan.robots[0].xacro_args == {"prefix": prefix}
    side = plan.arguments[0]
    assert (side.name, side.default, side.description) == (
        "side",
        "left",
        "Which side.",
    )
    assert side.choices == ("left", "right")

    with pytest.raises(InputError, match="side:=up: expected one of left, right"):
        ad.load_launch(path, arguments={"side": "up"})
    plan = ad.load_launch(path, arguments={"sid": "left"})
    assert "no launch argument 'sid'; did you mean 'side'?" in str(plan.report)


def test_choices_that_are_one_text_are_parts_of_it(package: Path) -> None:
    path = describe(
        package,
        """
        DeclareLaunchArgument("model", default_value="wx", choices=("wx")),
        publisher([*XACRO, " prefix:=", LaunchConfiguration("model")]),
        """,
    )

    plan = ad.load_launch(path)

    assert plan.robots[0].xacro_args == {"prefix": "wx"}
    assert plan.arguments[0].choices == ("wx",)
    with pytest.raises(InputError, match=r"model:=vx: expected one of wx$"):
        ad.load_launch(path, arguments={"model": "vx"})


def test_a_default_that_can_not_be_found_matters_only_without_a_value(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        DeclareLaunchArgument("prefix", default_value=FindPackageShare("not_there")),
        publisher([*XACRO, " prefix:=", LaunchConfiguration("prefix")]),
        """,
    )

    plan = ad.load_launch(path, arguments={"prefix": "left_"})

    assert plan.robots[0].xacro_args == {"prefix": "left_"}
    with pytest.raises(PackageError, match="package 'not_there' not found"):
        ad.load_launch(path)


@pytest.mark.slow
def test_arguments_without_a_default_are_shown_and_asked_for(package: Path) -> None:
    path = describe(
        package,
        """
        DeclareLaunchArgument("robot_ip", description="Where it is."),
        LogInfo(msg=LaunchConfiguration("robot_ip", default="")),
        """,
    )

    with pytest.raises(InputError, match="give it as robot_ip:=VALUE"):
        ad.load_launch(path)
    text = show_arguments(load_arguments(path))
    assert "'robot_ip':\n        Where it is." in text


def test_the_environment_is_that_of_a_shell_with_ros(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    monkeypatch.setenv("LD_LIBRARY_PATH", "/own")
    path = describe(
        package,
        """
        Node(package=os.environ["LD_LIBRARY_PATH"], executable=EnvironmentVariable(
            "ROS_DISTRO")),
        """,
    )

    assert names(ad.load_launch(path)) == ["/own/jazzy"]


def test_all_names_of_a_module_can_be_imported(package: Path) -> None:
    text = """
from launch import LaunchDescription
from launch.actions import *
from launch.conditions import *
from launch.event_handlers import *
from launch.substitutions import *
from launch_ros.actions import *

def generate_launch_description():
    node = Node(package="own", executable=LaunchConfiguration("name"))
    is_false = IfCondition("false")
    return LaunchDescription([
        SetLaunchConfiguration("name", "main"), GroupAction([node]),
        Node(package="own", executable="none", condition=is_false),
        RegisterEventHandler(OnShutdown(on_shutdown=[])),
    ])
"""
    path = write_launch(package, text, "stars.launch.py")

    assert names(ad.load_launch(path)) == ["own/main"]


def test_conditions_decide(package: Path) -> None:
    before = """
    def node(name, condition):
        return Node(package="own", executable=name, condition=condition)
    """
    path = describe(
        package,
        """
        SetLaunchConfiguration("on", "True"), SetLaunchConfiguration("side", "left"),
        node("a", IfCondition(LaunchConfiguration("on"))),
        node("b", UnlessCondition(LaunchConfiguration("on"))),
        node("c", IfCondition(PythonExpression(["not ", LaunchConfiguration("on")]))),
        node("d", IfCondition(PythonExpression(
            ["'", LaunchConfiguration("side"), "' == 'left' and ",
             LaunchConfiguration("on")]))),
        node("e", LaunchConfigurationEquals("side", "left")),
        node("f", LaunchConfigurationEquals("side", "right")),
        """,
        before,
    )

    assert names(ad.load_launch(path)) == ["own/a", "own/d", "own/e"]


def test_a_condition_that_is_neither_is_an_error(package: Path) -> None:
    path = describe(package, "LogInfo(msg='x', condition=IfCondition('maybe')),")

    with pytest.raises(InputError, match="condition 'maybe': expected true, 1, false"):
        ad.load_launch(path)


def test_events_give_the_order(package: Path) -> None:
    before = """
    first = spawner("joint_state_broadcaster")
    second = spawner("forward")
    third = spawner("arm_controller", "--inactive")
    """
    path = describe(
        package,
        """
        publisher(), manager(), first,
        TimerAction(period=10.0, actions=[spawner("last")]),
        RegisterEventHandler(OnProcessExit(target_action=second, on_exit=[third])),
        RegisterEventHandler(OnProcessExit(target_action=first, on_exit=second)),
        RegisterEventHandler(OnProcessStart(
            target_action=third, on_start=lambda event, context: [
                LogInfo(msg="third")])),
        """,
        before,
    )

    plan = ad.load_launch(path)

    assert list(states(plan).items()) == [
        ("joint_state_broadcaster", "active"),
        ("forward", "active"),
        ("arm_controller", "inactive"),
        ("last", "active"),
    ]
    assert "third" in str(plan.report)


def test_what_waits_for_a_node_of_ones_own_is_started_and_reported(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        publisher(), manager(), own,
        RegisterEventHandler(OnProcessExit(
            target_action=own, on_exit=[spawner("forward")])),
        """,
        'own = Node(package="own", executable="wait_for_it")',
    )

    plan = ad.load_launch(path)

    assert states(plan) == {"forward": "active"}
    assert "waits for the end of own/wait_for_it" in str(plan.report)


def test_groups_have_names_spaces_and_configurations_of_their_own(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        SetLaunchConfiguration("prefix", "outer_"),
        GroupAction([
            PushRosNamespace("left"),
            SetLaunchConfiguration("prefix", "left_"),
            publisher([*XACRO, " prefix:=", LaunchConfiguration("prefix")]), manager(),
            spawner("forward"),
        ]),
        GroupAction([
            PushRosNamespace("right"), publisher(XACRO), manager(),
            spawner("arm_controller"),
        ]),
        LogInfo(msg=["prefix is ", LaunchConfiguration("prefix")]),
        """,
    )

    plan = ad.load_launch(path)

    left, right = plan.robots
    assert (left.namespace, right.namespace) == ("left", "right")
    assert left.xacro_args == {"prefix": "left_"}
    assert (left.spawned, right.spawned) == (
        {"forward": "active"},
        {"arm_controller": "active"},
    )
    assert "prefix is outer_" in str(plan.report)


@pytest.mark.slow
@pytest.mark.parametrize("description", ["", "namespace='/cell'"])
def test_alone_a_robot_has_the_name_space_of_its_manager(
    package: Path, description: str
) -> None:
    path = describe(
        package,
        f"""
        publisher({description}),
        manager(namespace="cell", remappings=[
            ("/cell/forward/commands", "relative"), ("~/robot_description", "/d"),
            ("/cell/arm_controller/joint_trajectory", "/absolute"),
        ]),
        spawner("forward", "-c", "/cell/controller_manager"),
        """,
    )

    sim = ad.Simulation(ad.load_launch(path).build_diagram())

    found = {row.name for row in sim.list_topics()}
    assert {"/cell/forward/commands", "/cell/relative", "/absolute"} <= found
    assert not found & {"/forward/commands", "/relative", "/cell/absolute"}


def test_a_timer_has_the_name_space_and_the_configurations_of_its_group(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        SetLaunchConfiguration("name", "outer"),
        GroupAction([
            PushRosNamespace("left"),
            SetLaunchConfiguration("name", "forward"),
            publisher(), manager(),
            TimerAction(period=1.0, actions=[
                spawner(LaunchConfiguration("name")),
                SetLaunchConfiguration("name", "inner"),
            ]),
        ]),
        TimerAction(period=2.0, actions=[
            Node(package="own", executable=LaunchConfiguration("name")),
        ]),
        """,
    )

    plan = ad.load_launch(path)

    assert states(plan) == {"forward": "active"}
    assert names(plan) == ["own/outer"]


@pytest.mark.slow
def test_two_robots_run_beside_each_other(package: Path) -> None:
    path = describe(
        package,
        """
        *[GroupAction([PushRosNamespace(side), publisher(XACRO), manager(),
                       spawner("arm_controller"), spawner("joint_state_broadcaster")])
          for side in ("left", "right")],
        """,
    )

    simulation = ad.Simulation(ad.load_launch(path).build_diagram())

    found = {
        each.name for each in simulation.list_controllers() if each.state == "active"
    }
    assert {"left/arm_controller", "right/arm_controller"} <= found


def test_robots_that_share_a_file_get_what_is_for_their_name_space(
    package: Path,
) -> None:
    config = package / "config" / "controllers.yaml"
    text = f"/**:{CONTROLLERS.replace(chr(10), chr(10) + '  ')}\n"
    config.write_text(
        text + "/right/arm_controller: {ros__parameters: {open_loop_control: true}}\n"
    )
    path = describe(
        package,
        """
        *[GroupAction([PushRosNamespace(side), publisher(XACRO), manager()])
          for side in ("left", "right")],
        """,
    )

    robots = ad.load_launch(path).load_scene().robots

    found = [
        "open_loop_control" in each.parameters
        for robot in robots
        for each in robot.controllers.controllers
        if each.name == "arm_controller"
    ]
    assert found == [False, True]


def test_functions_and_included_files(package: Path) -> None:
    write_launch(
        package,
        """
        from launch import LaunchDescription
        from launch.actions import DeclareLaunchArgument
        from launch.substitutions import LaunchConfiguration
        from launch_ros.actions import Node

        def generate_launch_description():
            return LaunchDescription([
                DeclareLaunchArgument("mode", default_value="slow"),
                Node(package="own", executable=LaunchConfiguration("mode")),
            ])
        """,
        "inner.launch.py",
    )
    before = """
    def setup(context, word, *args, **kwargs):
        mode = LaunchConfiguration("mode").perform(context)
        return [Node(package="own", executable=word + mode)]
    """
    path = describe(
        package,
        """
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource([ThisLaunchFileDir(), "/inner.launch.py"]),
            launch_arguments={"mode": "fast"}.items()),
        OpaqueFunction(function=setup, args=["very_"]),
        """,
        before,
    )

    assert names(ad.load_launch(path)) == ["own/fast", "own/very_fast"]


XML = """
<launch>
  <arg name="gui" default="false" description="Show it.">
    <choice value="true"/><choice value="false"/></arg>
  <let name="text"
       value="$(command '$(find-exec xacro) $(var file) prefix:=$(env NONE a_)')"/>
  <group>
    <push-ros-namespace namespace="left"/>
    <node pkg="robot_state_publisher" exec="robot_state_publisher">
      <param name="robot_description" value="$(var text)"/>
    </node>
    <node pkg="controller_manager" exec="ros2_control_node">
      <param from="$(find-pkg-share pendulum_bringup)/config/controllers.yaml"/>
    </node>
  </group>
  <node pkg="controller_manager" exec="spawner"
        args="forward --inactive -c /left/controller_manager"/>
  <node pkg="own" exec="shown" if="$(var gui)"/>
  <node pkg="own" exec="hidden" unless="$(eval '\\'$(var gui)\\' == \\'true\\'')"/>
</launch>
"""

YAML = """
launch:
- arg: {name: gui, default: "false", description: Show it.}
- let:
    name: text
    value: $(command '$(find-exec xacro) $(var file) prefix:=$(env NONE a_)')
- group:
  - push_ros_namespace: {namespace: left}
  - node:
      pkg: robot_state_publisher
      exec: robot_state_publisher
      param:
      - {name: robot_description, value: $(var text)}
  - node:
      pkg: controller_manager
      exec: ros2_control_node
      param:
      - from: $(find-pkg-share pendulum_bringup)/config/controllers.yaml
- node:
    pkg: controller_manager
    exec: spawner
    args: forward --inactive -c /left/controller_manager
- node: {pkg: own, exec: shown, if: $(var gui)}
- node: {pkg: own, exec: hidden, unless: $(var gui)}
"""


@pytest.mark.parametrize(("text", "suffix"), [(XML, "xml"), (YAML, "yaml")])
def test_xml_and_yaml_say_the_same(package: Path, text: str, suffix: str) -> None:
    urdf = package / "urdf" / "pendulum.urdf.xacro"
    path = write_launch(package, text, f"test.launch.{suffix}")

    plan = ad.load_launch(path, arguments={"file": str(urdf)})

    (robot,) = plan.robots
    assert (robot.source, robot.xacro_args) == (urdf, {"prefix": "a_"})
    assert (robot.namespace, robot.spawned) == ("left", {"forward": "inactive"})
    assert robot.controllers == (package / "config" / "controllers.yaml",)
    assert names(plan) == ["own/hidden"]


PARAMETERS_XML = """
<launch>
  <let name="rate" value="250"/>
  <set_parameter name="update_rate" value="$(var rate)"/>
  <set_parameters_from_file filename="$(var rate).yaml"/>
  <set_use_sim_time value="true"/>
  <let name="rate" value="3"/>
  <node pkg="robot_state_publisher" exec="robot_state_publisher">
    <param name="robot_description" value="$(command 'xacro $(var file)')"/>
  </node>
  <node pkg="controller_manager" exec="ros2_control_node"/>
</launch>
"""

PARAMETERS_YAML = """
launch:
- let: {name: rate, value: "250"}
- set_parameter: {name: update_rate, value: $(var rate)}
- set_parameters_from_file: {filename: $(var rate).yaml}
- set_use_sim_time: {value: true}
- let: {name: rate, value: "3"}
- group:
    children:
    - node:
        pkg: robot_state_publisher
        exec: robot_state_publisher
        param:
        - name: robot_description
          value: "$(command 'xacro $(var file)')"
- timer:
    period: 1.0
    children:
    - node: {pkg: controller_manager, exec: ros2_control_node}
"""


@pytest.mark.parametrize(
    ("text", "suffix"), [(PARAMETERS_XML, "xml"), (PARAMETERS_YAML, "yaml")]
)
def test_parameters_are_set_for_all_nodes_that_follow(
    package: Path, text: str, suffix: str
) -> None:
    urdf = package / "urdf" / "pendulum.urdf.xacro"
    path = write_launch(package, text, f"test.launch.{suffix}")

    (robot,) = ad.load_launch(path, arguments={"file": str(urdf)}).robots

    written, named = robot.controllers
    data = yaml.safe_load(written.read_text(encoding="utf-8"))
    assert data == {"controller_manager": {"ros__parameters": {"update_rate": 250}}}
    assert named.name == "250.yaml"


def test_a_parameter_with_a_separator_is_a_list(package: Path) -> None:
    text = """
    <launch>
      <let name="joint" value="swing"/>
      <node pkg="robot_state_publisher" exec="robot_state_publisher">
        <param name="robot_description" value="$(command 'xacro $(var file)')"/>
      </node>
      <node pkg="controller_manager" exec="ros2_control_node">
        <param name="one" value="$(var joint);b"/>
        <param name="two" value="$(var joint);1;b" value-sep=";"/>
      </node>
    </launch>
    """
    urdf = package / "urdf" / "pendulum.urdf.xacro"
    path = write_launch(package, text, "test.launch.xml")

    (robot,) = ad.load_launch(path, arguments={"file": str(urdf)}).robots

    found: dict[str, object] = {}
    for file in robot.controllers:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
        found |= data["controller_manager"]["ros__parameters"]
    assert found == {"one": "swing;b", "two": ["swing", 1, "b"]}


def test_what_a_shell_gives_to_xacro_and_only_copies_is_the_description(
    package: Path,
) -> None:
    path = describe(
        package,
        """
        publisher(["bash -c '", *XACRO, " \\\\\\n prefix:=a_ | tee a.urdf'"]),
        """,
    )

    (robot,) = ad.load_launch(path).robots

    assert robot.xacro_args == {"prefix": "a_"}
    path = describe(package, """publisher(["sh -c '", *XACRO, " | sort'"]),""")
    with pytest.raises(InputError, match="is not run; expected xacro FILE"):
        ad.load_launch(path)


ASKING = """
        publisher(command=[*XACRO, " prefix:=a_"]),
        Node(package="controller_manager", executable="ros2_control_node",
             parameters=[YAML, {{"robot_description": Command(
                 ["ros2 param get {}"])}}]),
        """


def test_a_manager_may_ask_the_publisher_for_the_description(package: Path) -> None:
    words = "--hide-type /robot_state_publisher robot_description"

    (robot,) = ad.load_launch(describe(package, ASKING.format(words))).robots

    assert robot.xacro_args == {"prefix": "a_"}
    assert robot.has_manager


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (
            "/robot_state_publisher robot_description",
            "expected ros2 param get --hide-type NODE NAME, which prints the value "
            "alone",
        ),
        (
            "--hide-type /rsp robot_description",
            "/rsp isn't started by then; nodes: /robot_state_publisher",
        ),
        (
            "--hide-type robot_state_publisher description",
            "/robot_state_publisher is given no 'description'; it has: "
            "robot_description, use_sim_time",
        ),
    ],
)
def test_what_can_not_be_asked_for_is_an_error(
    package: Path, words: str, problem: str
) -> None:
    path = describe(package, ASKING.format(words))

    with pytest.raises(InputError) as caught:
        ad.load_launch(path)

    assert str(caught.value) == f"{path}: command 'ros2 param get {words}': {problem}"


def test_arguments_of_controllers_nodes_are_their_parameters(package: Path) -> None:
    path = describe(
        package,
        """
        publisher(), manager(),
        spawner("forward", "--controller-ros-args", "-p interface_name:=velocity"),
        spawner("arm_controller", "--controller-ros-args",
                "--ros-args --params-file own.yaml"),
        """,
    )

    (robot,) = ad.load_launch(path).robots

    _, written, named = robot.controllers
    data = yaml.safe_load(written.read_text(encoding="utf-8"))
    assert data == {"forward": {"ros__parameters": {"interface_name": "velocity"}}}
    assert named.name == "own.yaml"


def test_a_process_that_is_not_run_is_reported_in_one_line(package: Path) -> None:
    path = describe(package, """ExecuteProcess(cmd=["sed", "-e\\n  s|a|b|g"]),""")

    (told,) = ad.load_launch(path).not_started

    assert str(told) == "not started: process sed -e s|a|b|g"


def test_of_a_long_command_the_beginning_is_reported(package: Path) -> None:
    path = describe(package, """ExecuteProcess(cmd=["own" + "x" * 1000]),""")

    (told,) = ad.load_launch(path).not_started

    assert str(told) == f"not started: process own{'x' * 197} ..."


def test_files_of_parameters_are_rewritten_into_a_folder_of_the_plan(
    package: Path,
) -> None:
    source = package / "config" / "substituted.yaml"
    source.write_text("forward: {ros__parameters: {joints: [$(var joint)]}}")
    before = """
    from nav2_common.launch import RewrittenYaml
    """
    path = describe(
        package,
        """
        SetLaunchConfiguration("joint", "swing"),
        publisher(),
        Node(package="controller_manager", executable="ros2_control_node",
             parameters=[
                 ParameterFile(os.path.join(PACKAGE, "config", "substituted.yaml"),
                               allow_substs=True),
                 RewrittenYaml(YAML, {"update_rate": "250"}, convert_types=True),
                 {"update_rate": 500, "forward.type": "a/B"},
             ]),
        """,
        before,
    )

    (robot,) = ad.load_launch(path).robots

    data = [
        yaml.safe_load(file.read_text(encoding="utf-8")) for file in robot.controllers
    ]
    assert data[0] == {"forward": {"ros__parameters": {"joints": ["swing"]}}}
    assert data[1]["controller_manager"]["ros__parameters"]["update_rate"] == 250
    assert data[2] == {
        "controller_manager": {
            "ros__parameters": {"update_rate": 500, "forward": {"type": "a/B"}}
        }
    }


@pytest.mark.slow
def test_what_is_written_is_gone_with_the_plan(package: Path) -> None:
    path = describe(
        package,
        "publisher(), Node(package='controller_manager', "
        "executable='ros2_control_node', parameters=[{'update_rate': 10}]),",
    )
    plan = ad.load_launch(path)
    (file,) = plan.robots[0].controllers
    assert file.is_file()

    folder = file.parent
    del plan
    gc.collect()

    assert not folder.exists()


def test_a_simulator_has_a_world_and_poses(package: Path) -> None:
    world = package / "worlds" / "hall.sdf"
    world.parent.mkdir()
    world.write_text('<sdf version="1.9"><world name="hall"/></sdf>')
    path = describe(
        package,
        """
        SetEnvironmentVariable("GZ_SIM_RESOURCE_PATH", os.path.join(PACKAGE, "worlds")),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(PathJoinSubstitution(
                [FindPackageShare("ros_gz_sim"), "launch", "gz_sim.launch.py"])),
            launch_arguments={"gz_args": "-v 4 hall.sdf"}.items()),
        publisher(),
        Node(package="ros_gz_sim", executable="create", arguments=[
            "-topic", "/robot_description", "-name", "left", "-z", "0.5",
            "-Y", "1.57"]),
        Node(package="ros_gz_bridge", executable="parameter_bridge", arguments=[
            "/clock@rosgraph_msgs/msg/Clock[gz.msgs.Clock"]),
        Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
            "--x", "1", "--yaw", "0.5", "--frame-id", "map",
            "--child-frame-id", "odom"]),
        Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
            "1", "2", "3", "0", "0", "1", "0", "a", "b"]),
        """,
    )

    plan = ad.load_launch(path)

    assert (plan.world, plan.is_paused) == (world, True)
    (robot,) = plan.robots
    assert (robot.name, robot.simulator) == ("left", "gz")
    assert robot.pose == (0.0, 0.0, 0.5, 0.0, 0.0, 1.57)
    (bridge,) = plan.bridges
    assert str(bridge) == "/clock@rosgraph_msgs/msg/Clock[gz.msgs.Clock"
    half_a_turn = (0.0, 0.0, 3.141593)
    assert plan.static_frames == (
        ("map", "odom", (1.0, 0.0, 0.0, 0.0, 0.0, 0.5)),
        ("a", "b", (1.0, 2.0, 3.0, *half_a_turn)),
    )


def test_commands_mean_what_they_say(package: Path) -> None:
    path = describe(
        package,
        """
        ExecuteProcess(cmd=["gazebo", "--verbose", "-u", "-s", "libfactory.so"]),
        publisher(),
        ExecuteProcess(cmd=["ros2 run gazebo_ros spawn_entity.py -entity arm "
                            "-topic robot_description"], shell=True),
        ExecuteProcess(cmd=[[FindExecutable(name="ros2"), " control load_controller ",
                             "--set-state active forward"]], shell=True),
        ExecuteProcess(cmd=["ros2", "control", "load_controller", "arm_controller"]),
        ExecuteProcess(cmd=["ros2", "topic", "pub", "--once", "/forward/commands",
                            "std_msgs/msg/Float64MultiArray", "data: [0.5]"]),
        ExecuteProcess(cmd=["ros2", "action", "send_goal",
            "/arm_controller/follow_joint_trajectory",
            "control_msgs/action/FollowJointTrajectory",
            "{trajectory: {joint_names: [swing], points: [{positions: [0.5], "
            "time_from_start: {sec: 1}}]}}"]),
        ExecuteProcess(cmd=["make", "coffee"]),
        """,
    )

    plan = ad.load_launch(path)

    assert (plan.world, plan.is_paused) == ("empty", True)
    assert states(plan) == {"forward": "active", "arm_controller": "inactive"}
    assert plan.robots[0].name == "arm"
    assert names(plan) == ["make coffee"]
    assert plan.motion is not None
    first, second = yaml.safe_load(plan.motion.read_text(encoding="utf-8"))
    assert (first["topic"], first["data"]) == ("/forward/commands", [0.5])
    assert second["goal"]["joint_names"] == ["swing"]


def test_an_argument_that_only_other_descriptions_have_is_no_matter(
    package: Path,
) -> None:
    path = describe(package, 'publisher([*XACRO, " side:=left"]), manager(),')

    (robot,) = ad.load_launch(path).load_scene().robots

    assert robot.name == "pendulum"
    assert "no xacro argument 'side'; known: prefix" in str(robot.report)


def test_ros2_launch_starts_gazebo_as_an_included_file_does(package: Path) -> None:
    world = package / "hall.sdf"
    world.write_text('<sdf version="1.9"><world name="hall"/></sdf>')
    path = describe(
        package,
        """
        ExecuteProcess(cmd=["ros2", "launch", "ros_gz_sim", "gz_sim.launch.py",
                            "gz_args:=" + os.path.join(PACKAGE, "hall.sdf") + " -r"]),
        publisher(),
        """,
    )

    plan = ad.load_launch(path)

    assert (plan.world, plan.is_paused) == (world, False)
    assert names(plan) == []


@pytest.mark.slow
def test_a_model_is_put_into_the_world(package: Path) -> None:
    model = package / "ball.sdf"
    model.write_text(
        '<sdf version="1.9"><model name="ball"><link name="ball">'
        "<inertial><mass>1</mass></inertial><collision name='c'><geometry><sphere>"
        "<radius>0.1</radius></sphere></geometry></collision></link></model></sdf>"
    )
    path = describe(
        package,
        """
        ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]), publisher(),
        Node(package="ros_gz_sim", executable="create", arguments=[
            "-topic", "robot_description"]),
        Node(package="ros_gz_sim", executable="create", arguments=[
            "-file", os.path.join(PACKAGE, "ball.sdf"), "-name", "my_ball", "-z", "2"]),
        """,
    )

    diagram = ad.load_launch(path).build_diagram()

    plant = diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    ball = plant.GetBodyByName("ball", plant.GetModelInstanceByName("my_ball"))
    assert plant.EvalBodyPoseInWorld(context, ball).translation()[2] == pytest.approx(2)


def test_a_package_that_is_not_there_is_reported_with_who_asks(package: Path) -> None:
    path = describe(package, "LogInfo(msg=FindPackageShare('pendulum_brinup')),")

    with pytest.raises(PackageError, match="package 'pendulum_brinup' not found") as it:
        ad.load_launch(path)

    assert str(path) in str(it.value)
    assert "pendulum_bringup" in str(it.value)


def test_a_package_brings_its_own_modules(package: Path) -> None:
    module = package / "pendulum_bringup" / "helpers.py"
    module.parent.mkdir()
    (module.parent / "__init__.py").touch()
    module.write_text("NAME = 'helped'\n")
    path = describe(
        package,
        "Node(package='own', executable=NAME),",
        "from pendulum_bringup.helpers import NAME",
    )

    assert names(ad.load_launch(path)) == ["own/helped"]


def test_moveit_configs_find_the_description(package: Path) -> None:
    config = package / "config" / "pendulum.srdf"
    config.write_text('<robot name="pendulum"/>')
    path = describe(
        package,
        """
        publisher(),
        Node(package="moveit_ros_move_group", executable="move_group",
             parameters=[configs.to_dict()]),
        """,
        """
        from moveit_configs_utils import MoveItConfigsBuilder
        configs = (
            MoveItConfigsBuilder("pendulum", package_name="pendulum_bringup")
            .robot_description(file_path="urdf/pendulum.urdf.xacro")
            .joint_limits(file_path="config/joint_limits.yaml")
            .to_moveit_configs())
        """,
    )

    plan = ad.load_launch(path)

    assert plan.has_move_group
    assert len(plan.robots) == 1


@pytest.mark.slow
def test_a_file_is_found_by_its_package(package: Path, monkeypatch) -> None:
    path = describe(package, "publisher(),")
    monkeypatch.chdir(package.parent)

    assert ad.load_launch("pendulum_bringup", "test.launch.py").file == path
    assert ad.load_launch(package, "test.launch.py").file == path
    with pytest.raises(InputError, match=r"did you mean 'test.launch.py'\?"):
        ad.load_launch(package, "tst.launch.py")
    with pytest.raises(InputError, match="no such launch file"):
        ad.load_launch(package / "none.launch.py")


def test_a_file_without_a_robot_is_reported_so(package: Path) -> None:
    path = describe(package, "Node(package='own', executable='node'),")

    with pytest.raises(InputError, match="it starts no robot; it starts own/node"):
        ad.load_launch(path).build_diagram()


@pytest.mark.slow
def test_the_command_line_says_where_one_robot_starts(
    package: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = describe(package, "publisher(), manager(), spawner('forward'),")
    log = tmp_path / "log.npz"
    words = ["launch", str(path), "--headless", "--duration", "0.1", "--log", str(log)]

    code = main([*words, "--initial", "swing=0.5", "--pose", *"000000"])

    assert code == 0
    assert ad.Rollout.load(log).position[0] == pytest.approx([0.5])
    assert main([*words, "--initial", "swing=up"]) == 2
    assert "--initial swing=up: expected a number" in capsys.readouterr().err


def test_a_place_for_one_of_two_robots_is_refused(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = describe(
        package,
        "*[GroupAction([PushRosNamespace(side), publisher(XACRO), manager()])"
        " for side in 'ab'],",
    )

    assert main(["launch", str(path), "--headless", "--initial", "swing=1"]) == 2
    assert "--initial is for one robot; it starts 2" in capsys.readouterr().err


@pytest.mark.slow
def test_a_motion_of_several_robots_names_their_controllers_in_full(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = describe(
        package,
        """
        *[GroupAction([PushRosNamespace(side), publisher(XACRO), manager(),
                       spawner("arm_controller")]) for side in ("left", "right")],
        """,
    )
    points = "{positions: [0.1], time_from_start: 0.5}"
    goal = f"goal: {{joint_names: [swing], points: [{points}]}}"
    motion = package / "both.yaml"
    motion.write_text(
        f"- {{at: 0.0, controller: left/arm_controller, {goal}}}\n"
        f"- {{at: 0.1, controller: right/arm_controller, {goal}}}\n"
    )
    words = ["launch", str(path), "--headless", "--duration", "1", "--motion"]

    code = main([*words, str(motion)])

    assert code == 0
    out = capsys.readouterr().out
    for side in ("left", "right"):
        assert f"{side}/arm_controller: SUCCEEDED" in out
    assert main([*words, "swing"]) == 2
    assert "no motion 'swing'" in capsys.readouterr().err


@pytest.mark.slow
def test_variables_of_parameter_files_are_launch_configurations(package: Path) -> None:
    file = package / "config" / "controllers.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("[swing]", '["$(var joint)"]'), encoding="utf-8")
    path = describe(
        package,
        """
        SetLaunchConfiguration("joint", "swing"), SetLaunchConfiguration("other", "x"),
        publisher(), manager(), spawner("forward"),
        """,
    )

    (robot,) = ad.load_launch(path).load_scene().robots

    assert "other" not in str(robot.report)
    (forward,) = (c for c in robot.controllers.controllers if c.name == "forward")
    assert forward.parameters["joints"].value == ["swing"]


@pytest.mark.slow
def test_arguments_of_a_bridge_give_topics_their_names(package: Path) -> None:
    path = package / "urdf" / "pendulum.urdf.xacro"
    plugin = """
      <gazebo><plugin filename="gz-sim-joint-position-controller-system"
          name="gz::sim::systems::JointPositionController">
        <joint_name>swing</joint_name><topic>/swing_to</topic></plugin></gazebo>
    </robot>"""
    text = path.read_text(encoding="utf-8")
    text = text[: text.index("<ros2_control")] + plugin
    path.write_text(text, encoding="utf-8")
    file = describe(
        package,
        """
        ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]), publisher(),
        Node(package="ros_gz_sim", executable="create", arguments=[
            "-topic", "robot_description"]),
        Node(package="ros_gz_bridge", executable="parameter_bridge", arguments=[
                "/swing_to@std_msgs/msg/Float64]gz.msgs.Double",
                "/world/empty/set_pose@ros_gz_interfaces/srv/SetEntityPose"],
            remappings=[("/swing_to", "/arm/command")]),
        """,
    )

    (robot,) = ad.load_launch(file).load_scene().robots

    (alias,) = robot.topic_aliases
    assert (alias.ros_name, alias.gz_name) == ("/arm/command", "/swing_to")
    assert (alias.is_to_gz, alias.is_to_ros) == (True, False)


def test_a_bridge_of_pictures_gives_them_their_names(package: Path) -> None:
    file = describe(
        package,
        """
        ExecuteProcess(cmd=["gz", "sim", "-r", "empty.sdf"]), publisher(),
        Node(package="ros_gz_image", executable="image_bridge",
             arguments=["/eye/image", "depth"], remappings=[("depth", "far")],
             namespace="left"),
        """,
    )

    plan = ad.load_launch(file)

    assert [(str(b).partition("@")[0], b.ros_topic) for b in plan.bridges] == [
        ("/eye/image", "/eye/image"),
        ("depth", "/left/far"),
    ]
    assert plan.not_started == ()


FRAMES = """
    publisher(), manager(),
    Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
        "--x", "0.1", "--z", "-1", "--frame-id", "arm", "--child-frame-id", "tool"]),
    Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
        "0", "0", "-0.1", "0", "0", "0", "tool", "tip"]),
    Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
        "1", "0", "0", "0", "0", "0", "map", "odom"]),
    Node(package="tf2_ros", executable="static_transform_publisher", arguments=[
        "1", "0", "0", "0", "0", "0", "map", "arm"]),
"""


@pytest.mark.slow
def test_static_frames_are_frames_of_the_robot(package: Path) -> None:
    plan = ad.load_launch(describe(package, FRAMES))

    (robot,) = plan.load_scene().robots

    tip = robot.forward_kinematics({"swing": 0.0}, "tip")
    assert tip.translation() == pytest.approx([0.1, 0.0, -1.1])
    assert robot.pose is None
    lines = [entry.what for entry in plan.report if "frame" in entry.what]
    assert lines == ["static frame 'arm' in 'map'", "static frame 'odom' in 'map'"]


@pytest.mark.slow
def test_a_static_frame_says_where_a_robot_stands(package: Path) -> None:
    path = package / "urdf" / "pendulum.urdf.xacro"
    text = path.read_text(encoding="utf-8").replace('"world"', '"foot"')
    path.write_text(text, encoding="utf-8")
    file = describe(
        package,
        """
        publisher(),
        ComposableNodeContainer(name="c", namespace="", package="rclcpp_components",
            executable="component_container", composable_node_descriptions=[
                ComposableNode(package="tf2_ros",
                    plugin="tf2_ros::StaticTransformBroadcasterNode",
                    parameters=[{"frame_id": "map", "child_frame_id": "foot",
                        "translation": {"x": 1.0}, "rotation": {"z": 1.0}}])]),
        """,
        "from launch_ros.actions import ComposableNodeContainer\n"
        "from launch_ros.descriptions import ComposableNode",
    )

    (robot,) = ad.load_launch(file).load_scene().robots

    assert robot.pose == pytest.approx((1.0, 0.0, 0.0, 0.0, 0.0, 3.141593))


@pytest.mark.slow
def test_a_planner_gives_the_robot_its_groups_and_limits(package: Path) -> None:
    (package / "config" / "my.srdf.xacro").write_text(
        '<robot name="other" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="group" default=""/><group name="$(arg group)">'
        '<joint name="swing"/></group><group_state name="up" group="$(arg group)">'
        '<joint name="swing" value="3"/></group_state></robot>'
    )
    (package / "config" / "joint_limits.yaml").write_text(
        "joint_limits: {swing: {has_velocity_limits: true, max_velocity: 0.7}}"
    )
    path = describe(
        package,
        """
        publisher(),
        Node(package="moveit_ros_move_group", executable="move_group",
             parameters=[configs.to_dict()]),
        """,
        """
        from moveit_configs_utils import MoveItConfigsBuilder
        configs = (
            MoveItConfigsBuilder("pendulum", package_name="pendulum_bringup")
            .robot_description(file_path="urdf/pendulum.urdf.xacro")
            .robot_description_semantic("config/my.srdf.xacro", {"group": "whole"})
            .planning_pipelines(pipelines=["ompl"])
            .to_moveit_configs())
        """,
    )

    (robot,) = ad.load_launch(path).load_scene().robots

    group = ad.planning_groups(robot)["whole"]
    assert group.states["up"] == {"swing": 3.0}
    assert motion_limits(robot)["swing"].velocity == 0.7


@pytest.mark.slow
@pytest.mark.parametrize("word", ["", "--activate-as-group"])
def test_a_group_of_controllers_runs_whole_or_not_at_all(
    package: Path, word: str
) -> None:
    # Both want the position of the joint.
    words = f"'arm_controller', 'forward', {word!r}" if word else "'forward'"
    plan = ad.load_launch(
        describe(
            package,
            "publisher(), manager(), spawner('joint_state_broadcaster'),"
            f" spawner({words}),",
        )
    )

    options = plan.load_scene().options

    running = {"joint_state_broadcaster"} | (set() if word else {"forward"})
    assert set(options.active) == running
    lines = [str(entry) for entry in plan.report]
    assert any("start as a group" in line for line in lines) == bool(word)


def test_a_node_that_is_not_run_is_reported_with_what_it_would_do(
    package: Path,
) -> None:
    (package / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ["
        "'sphere = pendulum_bringup.random_sphere:main']})"
    )
    (package / "CMakeLists.txt").write_text("add_executable(mover src/my_mover.cpp)")
    for name, text in {
        "pendulum_bringup/random_sphere.py": (
            "self.create_subscription(JointState, '/joint_states', self.take, 10)\n"
            "self.create_publisher(msgs.Marker, 'marker', 10)\n"
            "ActionClient(self, FollowJointTrajectory, '/arm/follow')"
        ),
        "src/my_mover.cpp": (
            'pub_ = create_publisher<std_msgs::msg::Float64>("command", 10);\n'
            'create_service<Trigger>("~/go", call);'
        ),
    }.items():
        (package / name).parent.mkdir(exist_ok=True)
        (package / name).write_text(text)
    path = describe(
        package,
        """
        Node(package="pendulum_bringup", executable="sphere",
             remappings=[("marker", "/ball")]),
        Node(package="pendulum_bringup", executable="mover"),
        Node(package="teleop_twist_keyboard", executable="teleop_twist_keyboard"),
        """,
    )

    sphere, mover, teleop = map(str, ad.load_launch(path).not_started)

    assert sphere == (
        "not started: node pendulum_bringup/sphere; it would subscribe to "
        "/joint_states (JointState), publish /ball (Marker), "
        "send goals to /arm/follow (FollowJointTrajectory)"
    )
    assert mover.endswith("it would publish command (Float64), offer ~/go (Trigger)")
    assert teleop.endswith("; the page's teleop moves a base")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("entities", "words", "message"),
    [
        ("publisher(),", ["--motion", "home"], "--motion is for a simulation"),
        ("publisher(),", ["--ros"], "--ros is for a simulation"),
        ("publisher(),", ["--image", "eye=a.png"], "--image is for a simulation"),
        ("publisher(),", ["--ghost"], "--ghost: expected a pose"),
        ("publisher(), manager(),", ["--position", "1"], "--initial JOINT=VALUE says"),
        ("publisher(), manager(),", ["--ghost", "1"], "expected --ghost alone"),
    ],
)
def test_options_of_another_kind_of_launch_are_refused(
    package: Path,
    capsys: pytest.CaptureFixture[str],
    entities: str,
    words: list[str],
    message: str,
) -> None:
    path = describe(package, entities)

    assert main(["launch", str(path), *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_plugins_of_a_simulator_run_without_being_spawned(package: Path) -> None:
    (package / "urdf" / "pendulum.urdf.xacro").write_text(cart(diff_drive()))
    create = """publisher(), Node(package="ros_gz_sim", executable="create",
      arguments=["-topic", "robot_description"]),"""

    simulation = ad.Simulation(
        ad.load_launch(describe(package, create)).build_diagram()
    )

    assert {each.name: each.state for each in simulation.list_controllers()} == {
        "DiffDrive": "active"
    }
    simulation.topic("/model/cart/cmd_vel").publish(Twist(Vector3(x=0.5)))
    simulation.run(2.0)
    assert simulation.link_poses()["base_link"].translation()[0] > 0.5
