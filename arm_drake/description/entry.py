"""Entry file of a robot's description, by its path, its folder or a name.

Names are those of the robots that come with arm_drake, whose folders are found here,
and of examples.
"""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake.errors import (
    DescriptionError,
    MissingExtraError,
    first_names,
    quoted,
    suggest,
    suggest_file,
)


def _data_folder(name: str) -> Path:
    """Return a data folder: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name


def models_folder() -> Path:
    """Return the folder of the bundled robot packages."""
    return _data_folder("models")


def configs_folder() -> Path:
    """Return the folder of controllers and motions of the bundled robots."""
    return _data_folder("configs")


def bundled_robots() -> dict[str, Path]:
    """Return the entry files of the bundled robots by name."""
    robots = {}
    for folder in sorted(models_folder().glob("*/")):
        for suffix in (".urdf.xacro", ".urdf"):
            entry = folder / "urdf" / f"{folder.name}{suffix}"
            if entry.is_file():
                robots[folder.name] = entry
                break
    return robots


def bundled_motions(robot: str) -> dict[str, Path]:
    """Return the motion files of a bundled robot by name."""
    folder = configs_folder() / robot / "motions"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


# How an example is named: `example:ur5_robot`.
EXAMPLE = "example:"

_DISTRIBUTION = "example-robot-data"


def example_robots() -> dict[str, Path]:
    """Return the URDF files by the names of the robots; empty if not installed.

    A robot is called as its file, where several are, after `<folder>/`.
    """
    folder = _examples_folder()
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
    """Return the URDF file of an example."""
    if _examples_folder() is None:
        raise MissingExtraError(_DISTRIBUTION, extra="robots")
    robots = example_robots()
    if name not in robots:
        raise DescriptionError(f"unknown example {name!r}; {suggest(name, robots)}")
    return robots[name]


def _examples_folder() -> Path | None:
    """Return the folder of the robots, without an import: the package is data alone."""
    import importlib.metadata  # With e-mail and more; only examples need it.

    try:
        distribution = importlib.metadata.distribution(_DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return None
    for file in distribution.files or ():
        if file.name == "package.xml" and "share" in file.parts:
            folder = Path(str(distribution.locate_file(file))).parent / "robots"
            return folder if folder.is_dir() else None
    return None


_SUFFIXES = (".urdf", ".xacro", ".xml", ".sdf")

_LAUNCH_FILE = re.compile(r"[._]launch\.(py|xml|ya?ml)$|\.launch$")

# How packages of a robot's description are called, after the robot.
_FOLDER_SUFFIXES = ("_description", "_descriptions", "_support")

# Tags of a xacro file: a robot's name, what it includes, macros without content, calls
# of macros.
_NAME = re.compile(r"<xacro:attribute\s[^<>]*\bname\s*=\s*['\"]name['\"]")
_INCLUDED = re.compile(
    r"<xacro:include\s[^<>]*?\bfilename\s*=\s*(?:\"([^\"<>]*)\"|'([^'<>]*)')"
)
_EMPTY_MACRO = re.compile(r"<xacro:macro\b[^<>]*/>")
_CALL = re.compile(
    r"<xacro:(?!(arg|attribute|element|else|if|include|insert_block|macro|property"
    r"|unless)\b)"
)

# Bounds on a search: a folder may be that of all files there are.
_MAX_FOLDERS = 5_000
_MAX_CHARACTERS = 2**20
_MAX_LISTED = 20
_MAX_EXAMPLES = 3

Source = str | os.PathLike[str]


def listed(sources: Source | Sequence[Source]) -> list[Path]:
    """Return the paths of one source or of several."""
    several = [sources] if isinstance(sources, str | os.PathLike) else sources
    return [Path(source) for source in several]


# What messages call a description that is given as a text.
TEXT = "<robot_description>"


def is_xml(source: str) -> bool:
    """Return whether a source is the text of a description, not its name."""
    return source.lstrip("\ufeff \t\r\n").startswith("<")


def check_text(text: str, arguments: Mapping[str, str], entry: Path) -> None:
    """Raise DescriptionError of a text that xacro would have to expand."""
    if "http://www.ros.org/wiki/xacro" in text or arguments:
        problem = "a text is expanded already; expected the xacro file itself"
        raise DescriptionError(problem, file=entry)


def find_entry(source: Source) -> tuple[Path, str | None]:
    """Return the entry file of a source, and its name if it is bundled."""
    if not os.fspath(source):
        raise DescriptionError("no robot is named; expected a name, file or folder")
    if isinstance(source, str) and is_xml(source):
        raise DescriptionError("got the text of a description; expected its file")
    robots = bundled_robots()
    if isinstance(source, str) and source in robots:
        return robots[source], source
    if str(source).startswith(EXAMPLE):
        return find_example(str(source).removeprefix(EXAMPLE)), None
    path = Path(source)
    # Unlike those of Path, these take names that no file can have.
    if os.path.isdir(path):
        return _entry_in_folder(path), None
    if os.path.isfile(path):
        if _LAUNCH_FILE.search(path.name):
            raise DescriptionError(
                "expected a robot, got a launch file, which `arm-drake launch` and "
                "load_launch take",
                file=path,
            )
        if path.suffix.lower() not in _SUFFIXES:
            raise DescriptionError(
                f"expected a {', '.join(_SUFFIXES)} file, or a package folder",
                file=path,
            )
        return path.absolute(), None
    if path.suffix or os.sep in str(source):
        problem = f"no such file or folder{suggest_file(path)}"
        raise DescriptionError(problem, file=path)
    # The examples are named only to whom means one of them.
    names = (f"{EXAMPLE}{name}" for name in example_robots())
    like = [name for name in names if name.startswith(f"{EXAMPLE}{source}")]
    hint = f", and as examples {quoted(like[:_MAX_EXAMPLES])}" if like else ""
    raise DescriptionError(
        f"unknown robot {str(source)!r}: neither a bundled robot nor a file or folder; "
        f"{suggest(str(source), robots)}{hint}"
    )


def _entry_in_folder(folder: Path) -> Path:
    """Return the one file in a package folder that makes a robot."""
    files = sorted(
        path
        for path in _files_below(folder)
        if path.suffix.lower() in (".urdf", ".xacro")
    )
    candidates = [path for path in files if _makes_robot(path)]
    # What a file with macros includes are other macros, nearly always.
    candidates = candidates or [p for p in files if _makes_robot(p, has_macros=True)]
    name = folder.absolute().name
    names = {name, *(name.removesuffix(suffix) for suffix in _FOLDER_SUFFIXES)}
    alike = [p for p in candidates if p.name.partition(".")[0] in names]
    if len(alike) == 1:
        return alike[0].absolute()
    candidates = _without_included(candidates)
    if not candidates:
        problem = "no robot description (.urdf, .xacro) in the folder"
        raise DescriptionError(problem, file=folder)
    if len(candidates) != 1:
        named = [str(path.relative_to(folder)) for path in candidates]
        raise DescriptionError(
            f"expected one robot description in the folder, got "
            f"{len(candidates)}; name the file: {first_names(named, _MAX_LISTED)}",
            file=folder,
        )
    return candidates[0].absolute()


def _without_included(paths: list[Path]) -> list[Path]:
    """Return the files that none of the others includes; all, if each is included."""
    included = set()
    for path in paths:
        text = _without(text_of(path), "<!--", "-->")
        names = ("".join(each) for each in _INCLUDED.findall(text))
        included |= {name.rpartition("/")[2] for name in names} - {path.name}
    return [path for path in paths if path.name not in included] or paths


def _files_below(folder: Path) -> Iterator[Path]:
    """Yield the files below a folder, hidden ones left out."""

    def fail(error: OSError) -> None:
        if error.filename == os.fspath(folder):
            problem = f"can't be read: {error.strerror}"
            raise DescriptionError(problem, file=folder)

    walk = os.walk(folder, onerror=fail)
    for count, (root, subfolders, names) in enumerate(walk):
        if count > _MAX_FOLDERS:
            problem = f"more than {_MAX_FOLDERS} folders; name the robot's file"
            raise DescriptionError(problem, file=folder)
        subfolders[:] = sorted(n for n in subfolders if not n.startswith("."))
        yield from (Path(root, name) for name in names)


def _makes_robot(path: Path, *, has_macros: bool = False) -> bool:
    """Return whether a file is a named robot, not only macros to be included.

    One that has nothing but what it includes is one if it has no macros, or may.
    """
    root = text_of(path).partition("<robot")[2].partition(">")
    is_named = "name=" in root[0].replace(" ", "")
    if path.suffix.lower() == ".urdf":
        return is_named
    text = _EMPTY_MACRO.sub("", _without(root[2], "<!--", "-->"))
    outside = _without(text, "<xacro:macro", "</xacro:macro")
    makes_links = "<link" in outside or _CALL.search(outside) is not None
    includes = "<xacro:include" in outside
    includes &= has_macros or "<xacro:macro" not in text
    is_named |= _NAME.search(outside) is not None
    return is_named and (makes_links or includes)


def _without(text: str, start: str, end: str) -> str:
    """Return a text without what stands between two marks."""
    return "".join(part.partition(start)[0] for part in text.split(end))


def text_of(path: Path) -> str:
    """Return the text of a file to look for something in; "" if it can't be read."""
    try:
        if not path.is_file():  # A pipe waits for ever.
            return ""
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.read(_MAX_CHARACTERS)
    except OSError:
        return ""
