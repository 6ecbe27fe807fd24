"""Which controllers YAML belongs to a description."""

import os
from collections.abc import Sequence
from pathlib import Path

from arm_drake.bundled import configs_folder
from arm_drake.description.controllers import MANAGER
from arm_drake.description.entry import Source, text_of
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import PackageError


def find_control_files(
    given: Source | Sequence[Source] | None,
    description: RobotDescription,
    packages: PackageFinder,
    bundled: str | None,
    report: LoadReport,
) -> list[Path] | None:
    """Return the controllers YAML files of a robot, None if nothing hints at any.

    Args:
        given: What the user names, if anything.
        description: The robot; its Gazebo plugin may name files.
        packages: What resolves package URIs.
        bundled: Name of the bundled robot, if it is one.
        report: Where files that are missing are recorded.
    """
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
) -> list[Path] | None:
    """Return the controllers YAML in the package's config folder, if there is one."""
    folders = [f for f in description.file.parents if (f / "package.xml").is_file()]
    candidates = [
        path
        for folder in folders[:1]
        for path in sorted((folder / "config").glob("**/*.y*ml"))
        if f"{MANAGER}:" in text_of(path)
    ]
    if len(candidates) == 1:
        return candidates
    if not candidates and not description.hardware:
        return None
    listed = ", ".join(str(path) for path in candidates)
    report.add(
        "warning",
        "missing",
        f"the description names no controllers YAML; candidates: {listed or 'none'}",
        "no controller runs",
        file=description.file,
    )
    return []
