"""load_robot: a robot package on the disk becomes a Robot."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from arm_drake.bundled import bundled_robots, configs_folder
from arm_drake.description.controllers import (
    MANAGER,
)
from arm_drake.description.controllers import (
    load_controllers as load_controllers_config,
)
from arm_drake.description.given import DISTROS
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Pose, Robot
from arm_drake.description.urdf import RobotDescription, parse_urdf
from arm_drake.description.xacro import expand_xacro
from arm_drake.errors import DescriptionError, InputError, PackageError, suggest
from arm_drake.manager import find_surroundings, load_controllers

# What names of distributions without rules of their own are taken as.
_DISTRO_ALIASES = {
    "lyrical": "rolling",
    "foxy": "humble",
    "galactic": "humble",
    "iron": "humble",
}

# The distribution whose behaviour the controllers have; parameters are each one's own.
_MODELLED_DISTRO = "jazzy"

_SUFFIXES = (".urdf", ".xacro", ".xml")

Source = str | os.PathLike[str]


def load_robot(
    source: Source,
    *,
    controllers: Source | Sequence[Source] | None = None,
    xacro_args: Mapping[str, str] | None = None,
    package_paths: Source | Sequence[Source] = (),
    variables: Mapping[str, str] | None = None,
    distro: str = "jazzy",
    name: str | None = None,
    pose: Sequence[float] | None = None,
    initial_positions: Mapping[str, float] | None = None,
    strict: bool = False,
) -> Robot:
    """Load a robot from its description and its controllers YAML.

    Args:
        source: Name of a bundled robot, a `.urdf` or `.xacro` file, or a folder.
        controllers: Controllers YAML files. By default the one that the description
            names in its Gazebo plugin tag, else the one in the package's config folder
            if there is exactly one.
        xacro_args: Values of xacro arguments.
        package_paths: Folders to search for packages, with all that lies below them.
            The description's surroundings are searched in any case.
        variables: Values of `$(var NAME)` in the YAML.
        distro: ROS distribution whose controllers to follow.
        name: Name of the robot; by default the description's.
        pose: Pose of the base: x, y, z [m], roll, pitch, yaw [rad].
        initial_positions: Initial positions by joint [rad] or [m].
        strict: Whether every line of the load report is an error.

    Raises:
        InputError: If the files can't be used at all; or with ``strict``, if anything
            was not taken as written.
    """
    if name is not None and (not name or "/" in name):
        raise InputError(f"name {name!r}: expected a name without '/'")
    if isinstance(package_paths, str | os.PathLike):
        package_paths = [package_paths]
    report = LoadReport()
    distro = _check_distro(distro, report)
    entry, bundled = _find_entry(source)
    packages = PackageFinder(entry, [_existing_folder(path) for path in package_paths])
    text = expand_xacro(entry, dict(xacro_args or {}), packages, report)
    description = parse_urdf(text, entry, packages, report)
    files = _find_controllers(controllers, description, packages, bundled, report)
    config = load_controllers_config(
        files, dict(variables or {}), report, packages=packages
    )
    robot = Robot(
        name=name or description.name,
        description=description,
        controllers=config,
        report=report,
        initial_positions=_initial_positions(
            description, dict(initial_positions or {}), report
        ),
        pose=_check_pose(pose),
        distro=distro,
        bundled=bundled,
    )
    surroundings = find_surroundings(description, robot.initial_positions)
    # Which of them start is decided when a diagram is built.
    load_controllers(config, surroundings, report, judges_claims=False, distro=distro)
    if strict and len(report):
        raise InputError(f"not everything was taken as written:\n{report}")
    return robot


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


def _existing_folder(path: Source) -> Path:
    folder = Path(path)
    if not folder.is_dir():
        raise InputError("no such folder; expected one to search", file=folder)
    return folder


def _check_pose(pose: Sequence[float] | None) -> Pose | None:
    if pose is None:
        return None
    if len(pose) != 6:
        raise InputError(
            f"pose: expected x, y, z [m], roll, pitch, yaw [rad], got {list(pose)}"
        )
    x, y, z, roll, pitch, yaw = (_finite(number, "pose") for number in pose)
    return (x, y, z, roll, pitch, yaw)


def _finite(value: object, where: str) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"expected a finite number, got {value!r}", where=where)
    return number


def _find_entry(source: Source) -> tuple[Path, str | None]:
    """Return the entry file of a source, and its name if it is bundled."""
    robots = bundled_robots()
    if isinstance(source, str) and source in robots:
        return robots[source], source
    path = Path(source)
    # Unlike those of Path, these take names that no file can have.
    if os.path.isdir(path):
        return _entry_in_folder(path), None
    if os.path.isfile(path):
        if path.suffix.lower() not in _SUFFIXES:
            raise DescriptionError(
                f"expected a {', '.join(_SUFFIXES)} file, or a package folder",
                file=path,
            )
        return path.absolute(), None
    if path.suffix or os.sep in str(source):
        raise DescriptionError("no such file or folder", file=path)
    raise DescriptionError(
        f"unknown robot {str(source)!r}: neither a bundled robot nor a file or folder; "
        f"{suggest(str(source), robots)}"
    )


def _entry_in_folder(folder: Path) -> Path:
    """Return the one file in a package folder that makes a robot."""
    candidates = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in (".urdf", ".xacro") and _makes_robot(path)
    )
    named = [p for p in candidates if p.name.partition(".")[0] == folder.name]
    if len(named) == 1:
        return named[0].absolute()
    if len(candidates) != 1:
        listed = ", ".join(str(path.relative_to(folder)) for path in candidates)
        raise DescriptionError(
            f"expected one robot description in the folder, got "
            f"{len(candidates)}; name the file: {listed or 'none found'}",
            file=folder,
        )
    return candidates[0].absolute()


def _makes_robot(path: Path) -> bool:
    """Return whether a file is a named robot, not only macros to be included."""
    root = _text(path).partition("<robot")[2].partition(">")
    is_named = "name=" in root[0].replace(" ", "")
    if path.suffix.lower() == ".urdf":
        return is_named
    return is_named and ("<link" in root[2] or "<xacro:include" in root[2])


def _text(path: Path) -> str:
    """Return the text of a file to look for something in; "" if it can't be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _find_controllers(
    given: Source | Sequence[Source] | None,
    description: RobotDescription,
    packages: PackageFinder,
    bundled: str | None,
    report: LoadReport,
) -> list[Path]:
    if given is not None:
        files = [given] if isinstance(given, str | os.PathLike) else list(given)
        return [Path(file) for file in files]
    named = [
        text
        for plugin in description.gazebo_plugins
        for text in plugin.texts("parameters")
        if text
    ]
    found = []
    for text in dict.fromkeys(named):
        try:
            path = packages.resolve(text, description.file.parent)
            problem = None if os.path.isfile(path) else f"{text!r} does not exist"
        except PackageError as error:
            problem = error.problem
        if problem is None:
            found.append(path.resolve())
            continue
        report.add(
            "error",
            "missing",
            f"<parameters>: {problem}",
            "its controllers are left out",
            file=description.file,
        )
    if named:
        return found
    if bundled is not None:
        own = configs_folder() / bundled / "controllers.yaml"
        return [own] if own.is_file() else []
    return _controllers_in_package(description, report)


def _controllers_in_package(
    description: RobotDescription, report: LoadReport
) -> list[Path]:
    """Return the controllers YAML in the package's config folder, if there is one."""
    folders = [f for f in description.file.parents if (f / "package.xml").is_file()]
    candidates = [
        path
        for folder in folders[:1]
        for path in sorted((folder / "config").glob("**/*.y*ml"))
        if f"{MANAGER}:" in _text(path)
    ]
    if len(candidates) == 1:
        return candidates
    listed = ", ".join(str(path) for path in candidates)
    report.add(
        "warning",
        "missing",
        f"the description names no controllers YAML; candidates: {listed or 'none'}",
        "no controller runs",
        file=description.file,
    )
    return []


def _initial_positions(
    description: RobotDescription, given: dict[str, float], report: LoadReport
) -> dict[str, float]:
    """Return where the joints start: given, else `initial_value`, else 0, in limits."""
    movable = {joint.name: joint for joint in description.movable_joints}
    for name in given:
        if name not in movable:
            raise InputError(
                f"initial position of joint {name!r}: the robot has no such joint; "
                f"{suggest(name, movable)}"
            )
    values = {
        component.name: interface.initial_value
        for block in description.hardware
        for component in block.joints
        for interface in component.state_interfaces
        if interface.name == "position" and interface.initial_value is not None
    }
    positions = {}
    for name, joint in movable.items():
        position = _finite(given.get(name, values.get(name, 0.0)), f"joint {name!r}")
        lower, upper = joint.limits.lower, joint.limits.upper
        if joint.mimic is None and lower is not None and upper is not None:
            clamped = min(max(position, lower), upper)
            if clamped != position:
                report.add(
                    "warning",
                    "repair",
                    f"initial position {position} is outside [{lower}, {upper}]",
                    f"it starts at {clamped}",
                    where=f"joint {name!r}",
                    file=description.file,
                )
            position = clamped
        positions[name] = position
    for name, joint in movable.items():
        followed = [joint]
        while (mimic := followed[-1].mimic) is not None:
            followed.append(movable[mimic.joint])
        position = positions[followed.pop().name]
        for follower in reversed(followed):
            assert follower.mimic is not None
            position = follower.mimic.multiplier * position + follower.mimic.offset
        positions[name] = position
    return positions
