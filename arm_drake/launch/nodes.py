"""The nodes of launch files that have a meaning here, and what others would do."""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

# Programs that end by themselves, after which others may start, and those that don't;
# nodes that have a meaning here say it themselves.
_ENDING = {"remove"}
_LASTING_PROGRAMS = {"gazebo", "gzserver", "gzclient", "gz", "ign", "rviz2", "rqt"}


class NodeRole(NamedTuple):
    """Role that nodes have here."""

    packages: tuple[str, ...]

    # Executables without `.py`, or plugins of components; none for all.
    executables: tuple[str, ...]

    # Method of `Roles` that reads one; empty if nothing is to be read.
    reads: str

    # For the documentation.
    becomes: str

    # Whether it ends by itself, after which others may start.
    ends: bool = False


# The nodes that have a meaning here; all others are users' own, which aren't run.
NODES = (
    NodeRole(
        ("robot_state_publisher",),
        (),
        "publisher",
        'the robot: `robot_description` from `Command(["xacro ", ...])`, '
        "`xacro.process_file`, a file or a text; `frame_prefix`",
    ),
    NodeRole(
        ("controller_manager",),
        ("ros2_control_node",),
        "manager",
        "its controller manager; parameters in files and in the launch file",
    ),
    NodeRole(
        ("controller_manager",),
        ("spawner",),
        "spawner",
        "which controllers run: `--inactive`, `--stopped`, `--load-only`, "
        "`--param-file`, `--controller-type`, `--activate-as-group`, "
        "`--controller-ros-args` (remappings and parameters), "
        "`--controller-manager`, `--namespace`. What isn't spawned doesn't run",
        ends=True,
    ),
    NodeRole(
        ("controller_manager",),
        ("unspawner",),
        "unspawner",
        "which of them don't",
        ends=True,
    ),
    NodeRole(
        ("controller_manager",),
        ("hardware_spawner",),
        "hardware_spawner",
        "which hardware of `hardware_components_initial_state` is active: "
        "`--activate`, `--configure`",
        ends=True,
    ),
    NodeRole(
        ("gazebo_ros",),
        ("spawn_entity",),
        "classic_spawn",
        "the robot's name and pose",
        ends=True,
    ),
    NodeRole(
        ("ros_gz_sim", "ros_ign_gazebo"),
        ("create",),
        "gz_spawn",
        "the same; an SDF model without plugins that move it goes into the world",
        ends=True,
    ),
    NodeRole(
        ("ros_gz_sim", "ros_ign_gazebo", "gazebo_ros"),
        ("gzserver",),
        "server",
        "the world",
    ),
    NodeRole(
        ("ros_gz_bridge", "ros_ign_bridge"),
        (),
        "bridge",
        "topics' names in ROS, by arguments or a `config_file`",
    ),
    NodeRole(
        ("ros_gz_image", "ros_ign_image"),
        (),
        "image_bridge",
        "topics' names in ROS of pictures",
    ),
    NodeRole(
        ("joint_state_publisher",),
        (),
        "",
        "nothing: joints are where they are simulated or set",
    ),
    NodeRole(("joint_state_publisher_gui",), (), "sliders", "the sliders of the page"),
    NodeRole(
        ("rviz2",),
        (),
        "rviz",
        "the page; of its configuration the fixed frame, robot model, TF and the "
        "camera of an orbit view",
    ),
    NodeRole(
        ("tf2_ros",),
        ("static_transform_publisher", "tf2_ros::StaticTransformBroadcasterNode"),
        "static_frame",
        "a frame on the robot's link, or where a robot that nothing spawns stands",
    ),
    NodeRole(
        ("moveit_ros_move_group",),
        (),
        "move_group",
        "the robot's SRDF and limits: `ad.plan`, `arm-drake plan` take its groups",
    ),
)


# Packages of ROS and Gazebo that launch files name and that needn't be there.
PACKAGES = frozenset(
    {
        *(package for role in NODES for package in role.packages),
        "gazebo_ros2_control",
        "gz_ros2_control",
        "ign_ros2_control",
        "moveit_configs_utils",
        "ros_gz",
        "ros_ign",
        "xacro",
    }
)


def find_role(package: str, executable: str) -> NodeRole | None:
    """Return what a node becomes, None if it is a user's own."""
    executable = executable.removesuffix(".py")
    for role in NODES:
        is_meant = not role.executables or executable in role.executables
        if package in role.packages and is_meant:
            return role
    return None


def ends(
    package: str = "",
    executable: str = "",
    command: Sequence[str] = (),
    **others: Any,
) -> bool | None:
    """Return whether a program ends by itself; None if nobody here knows."""
    if executable in _ENDING or command[:1] == ["ros2"]:
        return True
    role = find_role(package, executable)
    if role is not None:
        return role.ends
    program = os.path.basename(command[0]) if command else ""
    return False if program in _LASTING_PROGRAMS else None


# How rclpy and rclcpp say it: what is done, the type, the name.
_CALLS = (
    r"create_(subscription|publisher|service|client)"
    r"\(\s*([\w.]+)\s*,\s*f?['\"]([^'\"]+)['\"]",
    r"(Action(?:Client|Server))\(\s*\w+\s*,\s*([\w.]+)\s*,\s*['\"]([^'\"]+)['\"]",
    r"create_(subscription|publisher|service|client)"
    r"<\s*([\w:]+)\s*>\s*\(\s*\"([^\"]+)\"",
    r"(create_(?:client|server))<\s*([\w:]+)\s*>\s*\(\s*[\w>()-]+\s*,\s*\"([^\"]+)\"",
)
_DOES = {
    "subscription": "subscribe to",
    "publisher": "publish",
    "service": "offer",
    "client": "call",
    "ActionClient": "send goals to",
    "ActionServer": "take goals of",
    "create_client": "send goals to",
    "create_server": "take goals of",
}

# Larger ones are none of somebody's own hand [bytes].
_LARGEST = 500_000


def find_what_it_does(
    folder: Path, executable: str, remappings: Iterable[tuple[str, str]]
) -> str:
    """Return what a user's own node would do, as far as its package's source says."""
    renamed = {source.lstrip("~/"): new for source, new in remappings}
    found: dict[str, list[str]] = {}
    for path in _sources(folder, executable):
        text = path.read_text(encoding="utf-8", errors="replace")
        for pattern in _CALLS:
            for what, kind, topic in re.findall(pattern, text):
                topic = renamed.get(topic.lstrip("~/"), topic)
                line = f"{topic} ({re.split('[.:]', kind)[-1]})"
                lines = found.setdefault(_DOES[what], [])
                if line not in lines:
                    lines.append(line)
    return ", ".join(f"{does} {', '.join(lines)}" for does, lines in found.items())


def _sources(folder: Path, executable: str) -> Iterator[Path]:
    """Yield the files that a node of a package is made of, as far as they are known."""
    stem = executable.removesuffix(".py")
    names = {executable, f"{stem}.py", f"{stem}.cpp", f"{stem}.cc"}
    for setup in (folder / "setup.py", folder / "setup.cfg", folder / "CMakeLists.txt"):
        if not setup.is_file():
            continue
        text = setup.read_text(encoding="utf-8", errors="replace")
        for module in re.findall(rf"\b{re.escape(stem)}\s*=\s*([\w.]+):\w+", text):
            names.add(f"{module.rpartition('.')[2]}.py")
        call = rf"add_executable\(\s*{re.escape(stem)}\s+([^)]*)\)"
        for files in re.findall(call, text):
            names |= {Path(file).name for file in files.split()}
    for path in sorted(folder.rglob("*")):
        if path.name in names and path.is_file() and path.stat().st_size < _LARGEST:
            yield path
