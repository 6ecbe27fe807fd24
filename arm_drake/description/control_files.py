"""Controllers YAML files that belong to a description."""

import itertools
import os
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from arm_drake.description.controllers import (
    MANAGER,
    ControllerConfig,
    ControllerManagerConfig,
)
from arm_drake.description.entry import Source, configs_folder, listed, text_of
from arm_drake.description.packages import PackageFinder, package_name
from arm_drake.description.parameters import Parameter
from arm_drake.description.plugin_control import (
    moving_plugins,
    plugin_joints,
    rolling_joints,
    suspending_joints,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import PARAMETERS
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import PackageError, counted

# What a file of a controller manager's parameters has; its name space may be one
# that a launch file fills in.
_SPACE = r"([\w*]+|<\w+>|\$\{\w+\}|\$\(var \w+\))/"
_MANAGER = re.compile(
    rf"^[ \t]*['\"]?/?({_SPACE})*{MANAGER}['\"]?[ \t]*:", re.MULTILINE
)
_FOR_ALL = re.compile(r"^['\"]?/\*\*['\"]?[ \t]*:", re.MULTILINE)
_TYPE = re.compile(r"\btype[ \t]*:[ \t]*['\"]?\w+/\w+")

# Misspelt ones are taken, and reported.
_ANY_PARAMETERS = re.compile(r"ros_*param")

# Bounds on a search for candidates.
_MAX_PACKAGES = 100
_MAX_FILES = 100
_MAX_CANDIDATES = 5


def find_control_files(
    sources: Source | Sequence[Source] | None,
    description: RobotDescription,
    packages: PackageFinder,
    bundled: str | None,
    report: LoadReport,
) -> list[Path] | None:
    """Return the controllers YAML files of a robot, None if nothing hints at any."""
    if sources is not None:
        return listed(sources)
    named = [
        text
        for plugin in description.gazebo_plugins
        for text in plugin.texts("parameters")
        if text
    ]
    if named:
        found: list[Path] = []
        lost: dict[str, None] = {}
        for text in dict.fromkeys(named):
            path, problem = _find_named(text, description, packages, report)
            found += [] if path is None else [path]
            lost |= {problem: None} if problem else {}
        _report_lost(lost, found, description, packages, report)
        return found
    if bundled is not None:
        own = configs_folder() / bundled / "controllers.yaml"
        if moving_plugins(description) and not description.hardware:
            return None  # Gazebo runs no controllers beside them.
        return [own] if own.is_file() else []
    return _controllers_in_package(description, packages, report)


def _find_named(
    text: str,
    description: RobotDescription,
    packages: PackageFinder,
    report: LoadReport,
) -> tuple[Path | None, str]:
    """Return the file of a `<parameters>` tag, or None and what is wrong with it."""
    file = description.file
    try:
        path, is_elsewhere = packages.locate(text, file.parent)
        problem = ""
        if not os.path.isfile(path):
            problem = f"{text!r} does not exist"
        elif not _ANY_PARAMETERS.search(text_of(path)):
            problem = f"{text!r} is no ROS 2 parameter file, it has no {PARAMETERS}"
    except PackageError as error:
        problem = error.problem
    if problem:
        return None, problem
    if is_elsewhere:
        what = f"<parameters>: {text!r} does not exist"
        done = f"taken from {str(path)!r}"
        report.add("warning", "repair", what, done, file=file)
    return path.resolve(), ""


def _report_lost(
    problems: Collection[str],
    taken: Collection[Path],
    description: RobotDescription,
    packages: PackageFinder,
    report: LoadReport,
) -> None:
    """Report files of `<parameters>` tags that can't be read, and what others are."""
    if not problems:
        return
    done = "its controllers are left out"
    candidates = _candidates(description, packages)
    others = [path for path in candidates if path.resolve() not in taken]
    if others:
        listed = ", ".join(map(str, others))
        done += f"; --controllers FILE gives others; candidates: {listed}"
    for problem in problems:
        what = f"<parameters>: {problem}"
        report.add("error", "missing", what, done, file=description.file)


def _controllers_in_package(
    description: RobotDescription, packages: PackageFinder, report: LoadReport
) -> list[Path] | None:
    """Return the controllers YAML in the package's config folder, if there is one."""
    in_config = files_in_config(description.file, packages)
    candidates = list(filter(_has_controllers, in_config))
    # Types in a section for all nodes may be of something else.
    candidates = list(filter(_has_manager, candidates)) or candidates
    others = candidates
    if len(candidates) > 1:
        # Some have the manager's rate alone, or are for other robots of the package.
        parts = (_TYPE, _mentions(description))
        texts = {path: text_of(path) for path in candidates}
        ours = [
            path for path, text in texts.items() if all(p.search(text) for p in parts)
        ]
        candidates = ours if len(ours) == 1 else candidates
    if moving_plugins(description) and not description.hardware:
        # Gazebo runs no controllers beside them, unless it is told to.
        if candidates:
            what = f"controllers YAML {', '.join(map(str, candidates))}"
            done = "Gazebo's own plugins move the joints; --controllers FILE takes it"
            report.add("info", "ignored", what, done, file=description.file)
        return None
    if len(candidates) == 1:
        if left := [str(path) for path in others if path not in candidates]:
            what = (
                f"the description names no controllers YAML; others: {', '.join(left)}"
            )
            done = (
                f"taken: {candidates[0]}, the only one with controllers of its joints"
            )
            report.add("info", "missing", what, done, file=description.file)
        return candidates
    if not candidates and not description.hardware:
        return None
    if not candidates:
        # Such as one whose joints have a prefix that a launch file fills in.
        own = list(filter(_has_types, in_config))
        around = dict.fromkeys([*own, *_candidates(description, packages)])
        candidates = list(around)[:_MAX_CANDIDATES]
    listed = ", ".join(map(str, candidates))
    what = f"the description names no controllers YAML; candidates: {listed or 'none'}"
    done = "no controller runs; --controllers FILE gives one"
    report.add("warning", "missing", what, done, file=description.file)
    return []


def files_in_config(file: Path, packages: PackageFinder) -> list[Path]:
    """Return the YAML files of `config` in a file's package, as source or installed.

    Packages after ros2_control's template have it in `bringup/config`.
    """
    own = next((f for f in file.parents if (f / "package.xml").is_file()), None)
    if own is None:
        return []
    found = sorted((own / "config").glob("**/*.y*ml"))
    if found:
        return found
    try:
        installed = packages.find(package_name(own / "package.xml"))
    except PackageError:
        return []
    return [packages.real(f) for f in sorted((installed / "config").glob("**/*.y*ml"))]


def _has_controllers(path: Path) -> bool:
    text = text_of(path)
    is_for_all = _FOR_ALL.search(text) is not None and _TYPE.search(text) is not None
    return PARAMETERS in text and (_has_manager(path) or is_for_all)


def _has_types(path: Path) -> bool:
    text = text_of(path)
    return PARAMETERS in text and _TYPE.search(text) is not None


def _has_manager(path: Path) -> bool:
    return _MANAGER.search(text_of(path)) is not None


def _mentions(description: RobotDescription) -> re.Pattern[str]:
    """Return what finds the name of a joint that moves."""
    names = [re.escape(joint.name) for joint in description.movable_joints]
    return re.compile(rf"\b({'|'.join(names)})\b" if names else r"(?!)")


def _candidates(description: RobotDescription, packages: PackageFinder) -> list[Path]:
    """Return files around the description that control it: of its maker, else others.

    A maker's packages begin with the same word; of their files those count that name
    joints of the description, if any do. Of others only such count, nearer ones first.
    """
    mentions = _mentions(description)
    around = description.file.absolute().parents
    known = {folder: name for name, folder in packages.known()}
    own = next((known[folder] for folder in around if folder in known), "")
    maker = own.partition("_")[0]

    def distance(folder: Path) -> int:
        return next(i for i, each in enumerate(around) if folder.is_relative_to(each))

    def names_joints(path: Path) -> bool:
        return mentions.search(text_of(path)) is not None

    near = sorted(known, key=distance)
    of_maker = [folder for folder in near if known[folder].partition("_")[0] == maker]
    found = _control_files_in(of_maker)
    # Of packages called my_... each is another's.
    found = list(filter(names_joints, found)) or found
    if not found:
        others = [folder for folder in near if folder not in of_maker]
        found = list(filter(names_joints, _control_files_in(others)))
    return found[:_MAX_CANDIDATES]


def _control_files_in(folders: Sequence[Path]) -> list[Path]:
    return [
        path
        for folder in folders[:_MAX_PACKAGES]
        for path in sorted(itertools.islice(folder.glob("**/*.y*ml"), _MAX_FILES))
        if _has_controllers(path)
    ]


def default_controllers(
    description: RobotDescription, report: LoadReport
) -> ControllerManagerConfig:
    """Return a trajectory controller of all joints that nothing else moves."""
    file = description.file
    moved = plugin_joints(description)
    joints = [
        joint.name
        for joint in description.movable_joints
        if joint.mimic is None and joint.name not in moved
    ]
    if rolling := rolling_joints(description):
        what = (
            f"no controller of {', '.join(rolling)} beside a plugin that moves a base"
        )
        done = "taken as wheels, which roll freely; a controllers YAML may hold them"
        report.add("info", "missing", what, done, file=file)
    if sprung := suspending_joints(description):
        what = f"no controller of {', '.join(sprung)}, which carry driven wheels"
        done = "taken as a suspension, which moves as its wheels push it"
        report.add("info", "missing", what, done, file=file)
    if not joints:
        return ControllerManagerConfig()
    parameters = {
        "joints": joints,
        "command_interfaces": ["position"],
        "state_interfaces": ["position", "velocity"],
    }
    placed = {key: Parameter(value, file, 1) for key, value in parameters.items()}
    broadcaster, trajectory = (
        ControllerConfig(package, f"{package}/{type_}", values, file, 1)
        for package, type_, values in (
            ("joint_state_broadcaster", "JointStateBroadcaster", {}),
            ("joint_trajectory_controller", "JointTrajectoryController", placed),
        )
    )
    what = "neither <ros2_control> tags nor a controllers YAML"
    number = counted(len(joints), "independent joint")
    done = f"one joint_trajectory_controller moves its {number}"
    report.add("info", "missing", what, done, file=file)
    return ControllerManagerConfig(controllers=(broadcaster, trajectory))
