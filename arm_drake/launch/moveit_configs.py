"""`moveit_configs_utils`, as launch files use it: parameters of MoveIt's nodes.

It has the names and the arguments of that package; the files that are looked for, and
what its launch files start, are told by its documentation.
"""

import types
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from arm_drake.launch import actions, parameters
from arm_drake.launch.actions import DeclareLaunchArgument, LaunchDescription, Node
from arm_drake.launch.substitutions import (
    IfCondition,
    LaunchConfiguration,
    LaunchContext,
    Substitution,
    find_package,
    is_substitution,
    perform,
    read_description,
)

# Where the controllers that a planner talks to are named.
_MANAGER = "moveit_simple_controller_manager"

# What a builder finds by itself if it isn't said, by its methods.
_PARTS = (
    *("robot_description", "robot_description_semantic", "joint_limits"),
    *("robot_description_kinematics", "trajectory_execution"),
)

_CAPABILITIES = ("capabilities", "disable_capabilities")

# Elements of SRDF: their attributes, and the elements in them, which are lists.
_SRDF: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "robot": (
        ("name",),
        (
            *("group", "group_state", "end_effector", "virtual_joint"),
            *("passive_joint", "disable_collisions"),
        ),
    ),
    "group": (("name",), ("link", "joint", "chain", "group")),
    "group_state": (("name", "group"), ("joint",)),
    "end_effector": (("name", "group", "parent_link", "parent_group"), ()),
    "virtual_joint": (("name", "type", "parent_frame", "child_link"), ()),
    "chain": (("base_link", "tip_link"), ()),
    "disable_collisions": (("link1", "link2", "reason"), ()),
}


class SRDF(types.SimpleNamespace):
    """Of `srdfdom.srdf`: an element of SRDF, with those in it."""

    @classmethod
    def from_xml_string(cls, text: str) -> "SRDF":
        """Return what a semantic description says."""
        return cls._of(ET.fromstring(text))  # noqa: S314  no entities.

    @classmethod
    def _of(cls, element: ET.Element) -> "SRDF":
        attributes, inner = _SRDF.get(element.tag, (("name",), ()))
        found = cls(**{name: element.get(name) for name in attributes})
        for tag in inner:
            each = [cls._of(child) for child in element.iterfind(tag)]
            setattr(found, f"{tag}s", each)
        if element.get("value") is not None:
            found.value = [float(word) for word in element.get("value", "").split()]
        return found


class Xacro(Substitution):
    """The text of a xacro file, with arguments that depend on the context."""

    def __init__(
        self,
        file_path: Any,
        mappings: Mapping[Any, Any] | None = None,
        verbose: bool = False,
    ) -> None:
        super().__init__(file_path)
        self.mappings = dict(mappings or {})

    def text_of(self, context: LaunchContext) -> str:
        texts = {
            perform(context, name): perform(context, value)
            for name, value in self.mappings.items()
        }
        return context.note_description(perform(context, self.args[0]), texts)


def _read_description(path: Path, mappings: Mapping[Any, Any] | None) -> Any:
    """Return what stands for a description, now or when its arguments are known."""
    if any(map(is_substitution, (*(mappings or {}), *(mappings or {}).values()))):
        return parameters.ParameterValue(Xacro(str(path), mappings), value_type=str)
    return read_description(path, mappings)


class MoveItConfigs:
    """Result of `MoveItConfigsBuilder.to_moveit_configs`."""

    def __init__(self, package_path: Path, values: Mapping[str, Any]) -> None:
        self.package_path = package_path
        self._values = dict(values)

    def __getattr__(self, name: str) -> Any:
        names = _CAPABILITIES if name == "move_group_capabilities" else ()
        return self._values.get(name, dict.fromkeys(names, ""))

    def to_dict(self, include_moveit_configs: bool = True) -> dict[str, Any]:
        """Return all parameters as one mapping."""
        merged: dict[str, Any] = {"moveit_config_package": str(self.package_path)}
        for each in self._values.values():
            merged |= each
        return merged


class MoveItConfigsBuilder:
    """Of `moveit_configs_utils`: description, SRDF and where the rest lies."""

    def __init__(
        self,
        robot_name: str,
        robot_description: str = "robot_description",
        package_name: str | None = None,
    ) -> None:
        package = package_name or f"{robot_name}_moveit_config"
        self._package = Path(find_package(package))
        self._name, self._parameter = robot_name, robot_description
        self._values: dict[str, Any] = {}
        self._setup = {}
        assistant = self._package / ".setup_assistant"
        if assistant.is_file():
            data = parameters.read_parameter_file(str(assistant)) or {}
            self._setup = data.get("moveit_setup_assistant_config", {})

    def robot_description(
        self, file_path: Any = None, mappings: Mapping[str, Any] | None = None
    ) -> "MoveItConfigsBuilder":
        path = self._package / f"config/{self._name}.urdf.xacro"
        urdf = self._setup.get("urdf") or self._setup.get("URDF") or {}
        if file_path is not None:
            path = self._package / str(file_path)
        elif not path.is_file() and urdf.get("relative_path"):
            package = find_package(urdf["package"])
            path = Path(package, urdf["relative_path"])
        if path.is_file():
            self._values["robot_description"] = {
                self._parameter: _read_description(path, mappings)
            }
        return self

    def robot_description_semantic(
        self, file_path: Any = None, mappings: Mapping[str, Any] | None = None
    ) -> "MoveItConfigsBuilder":
        srdf = self._setup.get("srdf") or self._setup.get("SRDF") or {}
        name = file_path or srdf.get("relative_path", f"config/{self._name}.srdf")
        self._values["robot_description_semantic"] = {
            f"{self._parameter}_semantic": _read_description(
                self._package / name, mappings
            )
        }
        return self

    def __getattr__(self, name: str) -> Callable[..., "MoveItConfigsBuilder"]:
        if name.startswith("_"):
            raise AttributeError(name)

        def take(*args: Any, **kwargs: Any) -> "MoveItConfigsBuilder":
            return self

        return take

    def joint_limits(self, file_path: Any = None) -> "MoveItConfigsBuilder":
        path = file_path or "config/joint_limits.yaml"
        return self._take_file("joint_limits", "planning", path)

    def robot_description_kinematics(
        self, file_path: Any = None
    ) -> "MoveItConfigsBuilder":
        path = file_path or "config/kinematics.yaml"
        return self._take_file("robot_description_kinematics", "kinematics", path)

    def trajectory_execution(
        self, file_path: Any = None, *args: Any, **kwargs: Any
    ) -> "MoveItConfigsBuilder":
        found = sorted((self._package / "config").glob("*controllers.yaml"))
        found.sort(key=lambda path: not path.name.startswith("moveit_"))
        path = file_path or next((each for each in found if _is_planners(each)), None)
        file = None if path is None else self._package / str(path)
        if file is not None and file.is_file():
            content = parameters.read_parameter_file(str(file)) or {}
            self._values["trajectory_execution"] = content
        return self

    def _take_file(self, name: str, ending: str, path: Any) -> "MoveItConfigsBuilder":
        """Take a YAML of the package as a parameter, if it exists."""
        file = self._package / str(path)
        if file.is_file():
            content = parameters.read_parameter_file(str(file)) or {}
            self._values[name] = {f"{self._parameter}_{ending}": content}
        return self

    def to_moveit_configs(self) -> MoveItConfigs:
        """Return what was described."""
        for name in _PARTS:
            if name not in self._values:
                getattr(self, name)()
        return MoveItConfigs(self._package, self._values)

    def to_dict(self, include_moveit_configs: bool = True) -> dict[str, Any]:
        """Return all parameters as one mapping."""
        return self.to_moveit_configs().to_dict()


def _is_planners(path: Path) -> bool:
    """Return whether a YAML says which controllers a planner talks to."""
    return _MANAGER in path.read_text(encoding="utf-8", errors="replace")


class DeclareBooleanLaunchArg(DeclareLaunchArgument):
    """Of `moveit_configs_utils.launch_utils`: an argument that is true or false."""

    def __init__(
        self, name: Any, *, default_value: bool = False, **kwargs: Any
    ) -> None:
        super().__init__(name, default_value=str(default_value).lower(), **kwargs)


def add_debuggable_node(
    ld: LaunchDescription, package: Any, executable: Any, *args: Any, **kwargs: Any
) -> None:
    """Add a node, of `launch_utils`; a debugger would make no difference here."""
    others = ("condition_name", "commands_file", "extra_debug_args")
    kwargs = {name: value for name, value in kwargs.items() if name not in others}
    ld.add_action(Node(package=package, executable=executable, **kwargs))


def generate_rsp_launch(moveit_config: MoveItConfigs) -> LaunchDescription:
    """Return what publishes the description."""
    rate = {"publish_frequency": LaunchConfiguration("publish_frequency")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("publish_frequency", default_value="15.0"),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[moveit_config.robot_description, rate],
            ),
        ]
    )


def generate_moveit_rviz_launch(moveit_config: MoveItConfigs) -> LaunchDescription:
    """Return what shows the robot."""
    file = str(moveit_config.package_path / "config" / "moveit.rviz")
    return LaunchDescription(
        [
            DeclareBooleanLaunchArg("debug", default_value=False),
            DeclareLaunchArgument("rviz_config", default_value=file),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", LaunchConfiguration("rviz_config")],
            ),
        ]
    )


def generate_setup_assistant_launch(moveit_config: MoveItConfigs) -> LaunchDescription:
    """Return what edits the package of a planner."""
    name = "moveit_setup_assistant"
    return LaunchDescription(
        [
            DeclareBooleanLaunchArg("debug", default_value=False),
            Node(package=name, executable=name),
        ]
    )


def generate_static_virtual_joint_tfs_launch(
    moveit_config: MoveItConfigs,
) -> LaunchDescription:
    """Return the frames of fixed virtual joints of the SRDF."""
    found = LaunchDescription()
    for text in moveit_config.robot_description_semantic.values():
        for joint in SRDF.from_xml_string(text).virtual_joints:
            parent, child = joint.parent_frame or "", joint.child_link or ""
            found.add_action(
                Node(
                    package="tf2_ros",
                    executable="static_transform_publisher",
                    arguments=["--frame-id", parent, "--child-frame-id", child],
                )
            )
    return found


def generate_spawn_controllers_launch(
    moveit_config: MoveItConfigs,
) -> LaunchDescription:
    """Return the spawners of the controllers that the planner talks to."""
    manager = moveit_config.trajectory_execution.get(_MANAGER, {})
    names = [*manager.get("controller_names", ()), "joint_state_broadcaster"]
    return LaunchDescription(
        [
            Node(package="controller_manager", executable="spawner", arguments=[name])
            for name in names
        ]
    )


def generate_warehouse_db_launch(moveit_config: MoveItConfigs) -> LaunchDescription:
    """Return the data base of scenes."""
    node = Node(package="warehouse_ros_mongo", executable="mongo_wrapper_ros.py")
    return LaunchDescription(
        [DeclareBooleanLaunchArg("reset", default_value=False), node]
    )


def generate_move_group_launch(moveit_config: MoveItConfigs) -> LaunchDescription:
    """Return the planner."""
    return LaunchDescription(
        [
            DeclareBooleanLaunchArg("debug", default_value=False),
            DeclareBooleanLaunchArg("allow_trajectory_execution", default_value=True),
            DeclareBooleanLaunchArg(
                "publish_monitored_planning_scene", default_value=True
            ),
            *(DeclareLaunchArgument(n, default_value="") for n in _CAPABILITIES),
            DeclareBooleanLaunchArg("monitor_dynamics", default_value=False),
            Node(
                package="moveit_ros_move_group",
                executable="move_group",
                parameters=[moveit_config.to_dict()],
            ),
        ]
    )


def generate_demo_launch(
    moveit_config: MoveItConfigs, launch_package_path: Any = None
) -> LaunchDescription:
    """Return the package's files of all of the above, and a controller manager.

    As in MoveIt only the first of them may be left out.
    """
    package = Path(launch_package_path or moveit_config.package_path)
    found = LaunchDescription(
        [
            DeclareBooleanLaunchArg("db", default_value=False),
            DeclareBooleanLaunchArg("debug", default_value=False),
            DeclareBooleanLaunchArg("use_rviz", default_value=True),
        ]
    )

    def include(name: str, flag: str = "") -> None:
        path = package / "launch" / f"{name}.launch.py"
        condition = IfCondition(LaunchConfiguration(flag)) if flag else None
        source = actions.LaunchDescriptionSource(str(path))
        found.add_action(actions.IncludeLaunchDescription(source, condition=condition))

    if (package / "launch" / "static_virtual_joint_tfs.launch.py").is_file():
        include("static_virtual_joint_tfs")
    include("rsp")
    include("move_group")
    include("moveit_rviz", "use_rviz")
    include("warehouse_db", "db")
    controllers = str(moveit_config.package_path / "config" / "ros2_controllers.yaml")
    found.add_action(
        Node(
            package="controller_manager",
            executable="ros2_control_node",
            parameters=[moveit_config.robot_description, controllers],
        )
    )
    include("spawn_controllers")
    return found
