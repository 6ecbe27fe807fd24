"""The robots of `example-robot-data`, if that package is installed."""

import importlib.metadata
from pathlib import Path

from arm_drake.errors import DescriptionError, MissingExtraError, suggest

# How an example is named: `example:ur5_robot`.
EXAMPLE = "example:"

_DISTRIBUTION = "example-robot-data"


def example_robots() -> dict[str, Path]:
    """Return the URDF files by the names of the robots; empty if not installed.

    A robot is called as its file, where several are, after `<folder>/`.
    """
    folder = _folder()
    files = [] if folder is None else sorted(folder.rglob("*.urdf"))
    # A package may ship what its generator left empty.
    files = [path for path in files if b"<link" in path.read_bytes()]
    stems = [path.stem for path in files]
    names = {}
    for path in files:
        package = path.relative_to(folder or path).parts[0].partition("_description")[0]
        is_unique = stems.count(path.stem) == 1
        names[path.stem if is_unique else f"{package}/{path.stem}"] = path
    return dict(sorted(names.items()))


def find_example(name: str) -> Path:
    """Return the URDF file of an example.

    Args:
        name: Name of the robot, without "example:".

    Raises:
        DescriptionError: If there is no such robot.
        MissingExtraError: If the examples aren't installed.
    """
    if _folder() is None:
        raise MissingExtraError(_DISTRIBUTION, extra="robots")
    robots = example_robots()
    if name not in robots:
        raise DescriptionError(f"unknown example {name!r}; {suggest(name, robots)}")
    return robots[name]


def _folder() -> Path | None:
    """Return the folder of the robots, without an import: the package is data alone."""
    try:
        distribution = importlib.metadata.distribution(_DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return None
    for file in distribution.files or ():
        if file.name == "package.xml" and "share" in file.parts:
            folder = Path(str(distribution.locate_file(file))).parent / "robots"
            return folder if folder.is_dir() else None
    return None
