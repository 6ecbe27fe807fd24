"""Loading of a robot: from a package on the disk to a Robot, stage by stage."""

import contextlib
import dataclasses as dc
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple

from arm_drake.description.base_wheels import find_bases
from arm_drake.description.bridge import (
    find_bridge_files,
    load_bridges,
    remapped_topics,
    split_bridges,
)
from arm_drake.description.claimed_hardware import (
    WHEEL_PARAMETERS,
    hardware_from_controllers,
)
from arm_drake.description.control_files import default_controllers, find_control_files
from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.controllers import (
    load_controllers as load_controllers_config,
)
from arm_drake.description.drive_gains import gazebo_nodes
from arm_drake.description.elements import declare_prefixes
from arm_drake.description.entry import (
    TEXT,
    Source,
    check_text,
    find_entry,
    is_xml,
    listed,
)
from arm_drake.description.gazebo_plugins import ApplyJointForce, Ros2ControlPlugin
from arm_drake.description.inertia import repair_free_base
from arm_drake.description.initial_positions import find_initial_positions
from arm_drake.description.joints import WORLD
from arm_drake.description.links import Pose
from arm_drake.description.packages import PackageFinder
from arm_drake.description.parameters import DISTROS
from arm_drake.description.plugin_control import add_plugins, plugin_joints
from arm_drake.description.report import LoadReport, Places
from arm_drake.description.robot import Robot
from arm_drake.description.sdf import convert_sdf, is_sdf
from arm_drake.description.sensors import add_gazebo_sensors, find_sensors
from arm_drake.description.source_files import find_source_files
from arm_drake.description.urdf import (
    Frames,
    RobotDescription,
    add_frames,
    parse_urdf,
)
from arm_drake.description.xacro import expand_xacro
from arm_drake.errors import DescriptionError, InputError, check_type, suggest
from arm_drake.importing import without_collection

if TYPE_CHECKING:
    from arm_drake.controllers import ControllerType

# What names of distributions without rules of their own are taken as.
_DISTRO_ALIASES = {
    "lyrical": "rolling",
    "foxy": "humble",
    "galactic": "humble",
    "iron": "humble",
}

# The distribution whose behaviour the controllers have; parameters are each one's own.
_MODELLED_DISTRO = "jazzy"


# Gazebo plugins that drive a mobile robot's base.
_BASE_PLUGINS = re.compile(
    r"(ackermann|diff|mecanum|skid|tricycle|omni)[\w-]*(drive|steer)|planar_?move"
    r"|velocity-control-system|::VelocityControl\b",
    re.I,
)


def load_robot(
    source: Source,
    *,
    controllers: Source | Sequence[Source] | None = None,
    xacro_args: Mapping[str, str] | None = None,
    package_paths: Source | Sequence[Source] = (),
    variables: Mapping[str, str] | None = None,
    distro: str = "jazzy",
    name: str | None = None,
    namespace: str | None = None,
    pose: Sequence[float] | None = None,
    initial_positions: Mapping[str, float] | None = None,
    strict: bool = False,
    decompose: bool = False,
    max_faces: int | None = None,
    controller_types: Mapping[str, "ControllerType"] | None = None,
    frames: Frames | None = None,
    srdf: Source | Sequence[Source] | None = None,
) -> Robot:
    """Load a robot from its description and its controllers YAML.

    Args:
        source: Name of a bundled robot, `example:NAME` (needs the extra `robots`), a
            `.urdf`, `.xacro` or `.sdf` file, a package folder, or a URDF's text, whose
            relative file names start in the first of ``package_paths``, or here.
        controllers: Controllers YAML files. By default the one that the description
            names in its Gazebo plugin tag, else the one in the package's config folder
            if there is exactly one. A robot with neither YAML nor control tags gets a
            joint trajectory controller of all its independent joints. A YAML of a
            ros_gz_bridge among them gives topics their names in ROS; without one it is
            that in the package's config folder.
        xacro_args: Values of xacro arguments.
        package_paths: Folders to search for packages, with all that lies below them.
            The description's surroundings are searched in any case.
        variables: Values of `$(var NAME)` in the YAML.
        distro: ROS distribution whose controllers to follow.
        name: Name of the robot; by default the description's.
        namespace: That of its nodes, in YAML files that robots share and in front of
            its topics where it is alone; by default the one in the Gazebo plugin tag.
        pose: Pose of the base: x, y, z [m], roll, pitch, yaw [rad].
        initial_positions: Initial positions by joint [rad] or [m].
        strict: Whether a warning of the load report is an error, too.
        decompose: Whether a collision mesh becomes several convex parts, not one hull;
            it needs the extra `decompose`, and minutes when it is first done.
        max_faces: Triangles of each mesh that is drawn, at most; needs the extra
            `decimate`. By default meshes are drawn as they are.
        controller_types: Controller types of this robot alone, by name in its YAML;
            they come before all others.
        frames: Frames fixed to links, such as the point of a tool, by name: the link,
            and x, y, z [m], roll, pitch, yaw [rad] in it. Each is a link without mass.
        srdf: SRDF files of MoveIt for it, with the `joint_limits.yaml` beside them. By
            default those of its name in its and the `moveit_config` packages around.

    Raises:
        MissingExtraError: If an extra is needed that isn't installed.
        InputError: If the files can't be used at all; or with ``strict``, if the
            report has an error or a warning.
    """
    arguments = {k: v for k, v in locals().items() if k != "controller_types"}
    return _load(arguments, controller_types)


def _load(
    arguments: Mapping[str, Any],
    controller_types: Mapping[str, "ControllerType"] | None,
) -> Robot:
    """Load by the arguments of `load_robot`, stage by stage."""
    loading = _start(_check_types(arguments), controller_types)
    description = _read_description(loading)
    bridges, config = _read_controllers(loading, description)
    description, config = _complete(loading, description, config)
    robot = _make_robot(loading, description, config, bridges)
    _try(loading, robot)
    if arguments["strict"]:
        robot.report.check()
    return robot


_PATH = (str, os.PathLike)
# Arguments of load_robot that are no paths, and what each must be if it is given.
_EXPECTED: Mapping[str, tuple[Any, str]] = {
    "source": (_PATH, "a name, a path or the text of a URDF"),
    "distro": (str, "a name"),
    "name": (str, "a name"),
    "namespace": (str, "a name space"),
    "pose": (Iterable, "x, y, z [m], roll, pitch, yaw [rad]"),
    "max_faces": (Integral, "an integer"),
    "xacro_args": (Mapping, "values by name"),
    "variables": (Mapping, "values by name"),
    "initial_positions": (Mapping, "positions by joint [rad] or [m]"),
    "frames": (Mapping, "a link and a pose by name"),
}
_NEEDED = ("source", "distro", "package_paths")

# Names as ROS takes them: topics have them in front. Slashes around them don't count.
_NAMESPACE = re.compile(r"/*(?:[a-z_]\w*/+)*(?:[a-z_]\w*)?", re.ASCII | re.IGNORECASE)


def _check_types(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments, paths in tuples; InputError if one has another type."""
    given = {
        name: value
        for name, value in arguments.items()
        if value is not None or name in _NEEDED
    }
    for name in filter(given.__contains__, _EXPECTED):
        check_type(name, given[name], *_EXPECTED[name])
    namespace = given.get("namespace", "")
    if not _NAMESPACE.fullmatch(namespace):
        expected = "names of letters, digits and '_' such as 'cell/left'"
        raise InputError(f"namespace: expected {expected}, got {namespace!r}")
    for name in filter(given.__contains__, ("controllers", "package_paths", "srdf")):
        value, expected = given[name], "a path or a list of paths"
        if not isinstance(value, _PATH):
            check_type(name, value, Iterable, expected)
            given[name] = tuple(value)  # Also of what can be looked through but once.
            for path in given[name]:
                check_type(name, path, _PATH, expected)
    return {**arguments, **given}


class _Loading(NamedTuple):
    """Sources and options of a load; its report and its files grow."""

    # Those of `load_robot`, paths in tuples.
    arguments: Mapping[str, Any]

    # The file that is read first, and the name of the bundled robot if it is one. Of a
    # text it is what messages call it.
    entry: Path
    text: str | None
    bundled: str | None

    # Folders that are searched for packages, and what searches them.
    folders: tuple[Path, ...]
    packages: PackageFinder

    # Known to us, such as jazzy.
    distro: str
    types: Mapping[str, "ControllerType"]
    report: LoadReport

    # Files that xacro read, and where the elements of the description stand in them.
    files: set[Path]
    places: Places


def _start(
    arguments: Mapping[str, Any],
    controller_types: Mapping[str, "ControllerType"] | None,
) -> _Loading:
    """Return the sources and options of a load, after a first check."""
    source, name = arguments["source"], arguments["name"]
    if name is not None and (not name or "/" in name):
        raise InputError(f"name {name!r}: expected a name without '/'")
    types: Mapping[str, ControllerType] = {}
    if controller_types:
        from arm_drake.controllers import check_controller_types

        types = check_controller_types(controller_types)
    report = LoadReport()
    distro = _check_distro(arguments["distro"], report)
    folders = _check_folders(arguments["package_paths"])
    text = source if isinstance(source, str) and is_xml(source) else None
    if text is None:
        entry, bundled = find_entry(source)
    else:
        entry, bundled = next(iter(folders), Path.cwd()) / TEXT, None
    packages = PackageFinder(entry, folders, report)
    return _Loading(
        arguments,
        entry,
        text,
        bundled,
        folders,
        packages,
        distro,
        types,
        report,
        files=set(),
        places=Places(),
    )


def _read_description(loading: _Loading) -> RobotDescription:
    """Return the robot that the entry file describes."""
    entry, packages, report = loading.entry, loading.packages, loading.report
    arguments = loading.arguments
    xacro_args, text = dict(arguments["xacro_args"] or {}), loading.text
    if text is None:
        text = _expand(loading, xacro_args)
    else:
        check_text(text, xacro_args, entry)
    text = as_urdf(text, entry, loading.folders, report)
    if arguments["frames"]:
        text = add_frames(text, arguments["frames"], entry)
    try:
        return parse_urdf(
            text,
            entry,
            packages,
            report,
            decompose=arguments["decompose"],
            max_faces=arguments["max_faces"],
        )
    except DescriptionError as error:
        found = None if error.line else loading.places.find(error.where or "")
        if found is None:
            raise
        raise DescriptionError(
            error.problem, file=found[0], line=found[1], where=error.where
        ) from None


def _expand(loading: _Loading, xacro_args: Mapping[str, str]) -> str:
    """Return the text that xacro makes of the entry file.

    xacro runs in a process of its own. Meanwhile a thread of this one imports what
    `_try` needs, which takes about as long.
    """

    def import_meanwhile() -> None:
        with contextlib.suppress(Exception):  # The import in `_try` raises it again.
            import_trial()

    thread = Thread(target=import_meanwhile)
    thread.start()
    try:
        return expand_xacro(
            loading.entry,
            xacro_args,
            loading.packages,
            loading.report,
            files=loading.files,
            places=loading.places,
        )
    finally:
        thread.join()


def import_trial() -> None:
    """Import what `_try` needs, Drake among it."""
    with without_collection():
        import arm_drake.hardware.drives
        import arm_drake.manager.loading  # noqa: F401


def as_urdf(text: str, file: Path, folders: Sequence[Path], report: LoadReport) -> str:
    """Return the text of a description as URDF, also that of an SDF model.

    `folders` are searched first for the models whose meshes it has.

    Raises:
        DescriptionError: If it is SDF that describes no robot.
    """
    if not is_sdf(text):
        return declare_prefixes(text)
    from arm_drake.worlds.sdf_files import ModelFinder  # Few robots are SDF.

    return convert_sdf(text, file, report, ModelFinder(file, folders).find_file)


def _read_controllers(
    loading: _Loading, description: RobotDescription
) -> tuple[Sequence[Path], ControllerManagerConfig]:
    """Return the YAML files of bridges, and what those of controllers configure."""
    bundled, packages, report = loading.bundled, loading.packages, loading.report
    arguments = loading.arguments
    bridges, controllers = split_bridges(arguments["controllers"])
    bridges = bridges or find_bridge_files(description, packages, bundled, report)
    files = find_control_files(controllers, description, packages, bundled, report)
    if files is None:
        return bridges, default_controllers(description, report)
    # Without a tag the manager has its usual name, and no name space.
    tags = [p for p in description.joint_plugins if isinstance(p, Ros2ControlPlugin)]
    tag = tags[0] if tags else Ros2ControlPlugin()
    return bridges, load_controllers_config(
        files,
        dict(arguments["variables"] or {}),
        report,
        packages=packages,
        manager=tag.manager,
        namespace=arguments["namespace"] or tag.namespace,
        plugins=gazebo_nodes(description),
    )


def _complete(
    loading: _Loading,
    description: RobotDescription,
    config: ControllerManagerConfig,
) -> tuple[RobotDescription, ControllerManagerConfig]:
    """Add what follows from both: hardware, plugins, sensors, a base that moves."""
    report, entry = loading.report, loading.entry
    if not description.hardware:
        hardware = hardware_from_controllers(
            config,
            description.joints,
            report,
            entry,
            others=plugin_joints(description),
        )
        description = dc.replace(description, hardware=hardware)
    description, config = add_plugins(description, config, report)
    config = add_gazebo_sensors(description, config, report)
    if _has_free_base(description, config):
        links = repair_free_base(
            description.link_infos,
            description.joints,
            description.base,
            report,
            entry,
        )
        description = dc.replace(description, link_infos=links)
    return description, config


def _make_robot(
    loading: _Loading,
    description: RobotDescription,
    config: ControllerManagerConfig,
    bridges: Sequence[Path],
) -> Robot:
    """Return the robot of a description, of controllers and load_robot's arguments."""
    report, arguments = loading.report, loading.arguments
    return Robot(
        name=arguments["name"] or description.name,
        description=description,
        controllers=config,
        report=report,
        initial_positions=find_initial_positions(
            description, dict(arguments["initial_positions"] or {}), report
        ),
        pose=_check_pose(arguments["pose"]),
        has_free_base=_has_free_base(description, config),
        package_paths=loading.folders,
        source_files=find_source_files(
            description, config, loading.packages, (*loading.files, *bridges)
        ),
        distro=loading.distro,
        bundled=loading.bundled,
        sensors=find_sensors(description, config, report),
        topic_aliases=(
            *load_bridges(bridges, report),
            *remapped_topics(description),
        ),
        controller_types=loading.types,
        load_options=arguments,
        srdf_files=_check_srdf(arguments["srdf"]),
    )


def _try(loading: _Loading, robot: Robot) -> None:
    """Record what controllers, model and bases lack, and the places of all lines."""
    from arm_drake.hardware.drives import check_model
    from arm_drake.hardware.mobile_bases import RobotBases
    from arm_drake.manager.hardware_interfaces import find_hardware_interfaces
    from arm_drake.manager.loading import load_controllers

    report = loading.report
    hardware_interfaces = find_hardware_interfaces(
        robot.description,
        robot.initial_positions,
        sensors=robot.sensors,
        robot_name=robot.name,
    )
    load_controllers(
        robot.controllers,
        hardware_interfaces,
        report,
        judges_claims=False,
        distro=robot.distro,
        controller_types=robot.controller_types,
    )
    check_model(robot)
    RobotBases.of(robot).report(report)
    report.add_lines(loading.places.find)


def _has_free_base(
    description: RobotDescription, config: ControllerManagerConfig
) -> bool:
    """Return whether something drives the base, and no joint holds it in the world."""
    if any(joint.parent == WORLD for joint in description.joints):
        return False
    is_driven = any(c.type in WHEEL_PARAMETERS for c in config.controllers)
    is_driven |= any(base.driven for base in find_bases(description, config))
    pushed = {
        name
        for plugin in description.joint_plugins
        if isinstance(plugin, ApplyJointForce)
        for name in plugin.joint_names[:1]
    }
    is_driven |= any(
        joint.type == "continuous" and joint.name in pushed
        for joint in description.joints
    )
    return is_driven or any(
        _BASE_PLUGINS.search(f"{plugin.filename} {plugin.name}")
        for plugin in description.gazebo_plugins
    )


def _check_distro(distro: str, report: LoadReport) -> str:
    known = _DISTRO_ALIASES.get(distro, distro)
    if known not in DISTROS:
        raise InputError(f"unknown distro {distro!r}; {suggest(distro, DISTROS)}")
    if known != _MODELLED_DISTRO:
        report.add(
            "warning",
            "unsupported",
            f"distro {distro!r}",
            f"parameters and defaults are its own, behaviour is {_MODELLED_DISTRO}'s",
        )
    return known


def _check_srdf(sources: Source | Sequence[Source] | None) -> tuple[Path, ...] | None:
    if sources is None:
        return None
    files = tuple(listed(sources))
    for file in files:
        if not file.is_file():
            raise InputError("no such SRDF file", file=file)
    return files


def _check_folders(sources: Source | Sequence[Source]) -> tuple[Path, ...]:
    folders = tuple(listed(sources))
    for folder in folders:
        if not folder.is_dir():
            raise InputError("no such folder; expected one to search", file=folder)
    return folders


def _check_pose(pose: Sequence[float] | None) -> Pose | None:
    if pose is None:
        return None
    given = pose if isinstance(pose, str) else list(pose)
    if isinstance(given, str) or len(given) != 6:
        raise InputError(
            f"pose: expected x, y, z [m], roll, pitch, yaw [rad], got {given!r}"
        )
    x, y, z, roll, pitch, yaw = (_finite(number, "pose") for number in given)
    return (x, y, z, roll, pitch, yaw)


def _finite(value: object, where: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"expected a finite number, got {value!r}", where=where)
    return number
