"""Where a ROS package's files lie once it is installed.

Descriptions name files by their place below `share/<package>`. In a source tree some
of them lie elsewhere: `install(DIRECTORY ...)` in CMakeLists.txt, or `data_files` in
setup.py, says where they go.
"""

import functools
import itertools
import os
import re
import shlex
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from arm_drake.description.install_links import Installed
from arm_drake.description.setup_rules import setup_rules

# The first alternative holds a comment that never ends, too.
_COMMENT = re.compile(r"#\[\[.*?(?:\]\]|\Z)|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(
    r"\b(project|set|install|add_subdirectory|ament_auto_package|foreach|endforeach)"
    r"\s*\(([^)]{0,20000})\)",
    re.I,
)
_VARIABLE = re.compile(r"\$\{(\w+)\}")

# Words of `install(DIRECTORY ...)` after which no folders are named.
_OPTIONS = {
    "COMPONENT",
    "CONFIGURATIONS",
    "DESTINATION",
    "DIRECTORY_PERMISSIONS",
    "FILES_MATCHING",
    "FILE_PERMISSIONS",
    "OPTIONAL",
    "PATTERN",
    "PERMISSIONS",
    "REGEX",
    "RENAME",
    "TYPE",
    "USE_SOURCE_PERMISSIONS",
}

# More than any package has: characters of a file, those of all commands with their
# variables filled in, and rules.
_MAX_TEXT = 256 * 2**10
_MAX_EXPANDED = 2**20
_MAX_RULES = 20_000


def installed_elsewhere(package: Path, name: str) -> list[Installed]:
    """Return what a source package installs to a place other than its own.

    Args:
        package: Folder of the package.
        name: Name of the package.

    Raises:
        OSError: If something can't be read.
        ValueError: If there is more to read than in any package.
    """
    below_share = functools.partial(_below_share, name=name)
    setup = _read(package / "setup.py")
    rules = itertools.chain(
        _CMakeReader(package, name).rules(), setup_rules(package, setup, below_share)
    )
    found = []
    for index, (place, source) in enumerate(rules):
        if index >= _MAX_RULES:
            raise ValueError(f"more than {_MAX_RULES} files and folders are installed")
        if place.is_absolute() or ".." in place.parts:
            continue  # It isn't below `share/<package>`.
        there = package / place
        if source.exists() and not (there.exists() and there.samefile(source)):
            found.append((place, source))
    return found


class _CMakeReader:
    """Follows the commands of a CMakeLists.txt that say where files are installed."""

    def __init__(self, package: Path, name: str) -> None:
        self._package = package
        self._name = name
        self._num_characters = 0
        self._variables = {
            "PROJECT_NAME": name,
            "CMAKE_PROJECT_NAME": name,
            "CMAKE_SOURCE_DIR": str(package),
            "PROJECT_SOURCE_DIR": str(package),
            "CMAKE_INSTALL_PREFIX": "",
            "CMAKE_INSTALL_DATADIR": "share",
            "CMAKE_INSTALL_DATAROOTDIR": "share",
        }

    def rules(self) -> Iterator[Installed]:
        """Yield what is installed below `share/<package>`."""
        yield from self._file(self._package, self._variables, depth=0)

    def _file(
        self, folder: Path, variables: dict[str, str], depth: int
    ) -> Iterator[Installed]:
        text = _read(folder / "CMakeLists.txt")
        self._count(len(text))
        variables = variables | {"CMAKE_CURRENT_SOURCE_DIR": str(folder)}
        commands = [
            (command.lower(), text)
            for command, text in _COMMAND.findall(_COMMENT.sub("", text))
        ]
        yield from self._run(commands, folder, variables, depth)

    def _run(
        self,
        commands: list[tuple[str, str]],
        folder: Path,
        variables: dict[str, str],
        depth: int,
    ) -> Iterator[Installed]:
        waiting = iter(commands)
        for command, text in waiting:
            words = _words(self._expand(text, variables))
            match command:
                case "project" if words:
                    variables["PROJECT_NAME"] = words[0]
                case "set" if words:
                    variables[words[0]] = " ".join(words[1:])
                case "add_subdirectory" if words and depth < 3:
                    yield from self._file(folder / words[0], variables, depth + 1)
                case "install":
                    yield from _install_command(words, folder, self._name)
                case "ament_auto_package" if "INSTALL_TO_SHARE" in words:
                    shared = words[words.index("INSTALL_TO_SHARE") + 1 :]
                    shared += ["DESTINATION", f"share/{self._name}"]
                    shared.insert(0, "DIRECTORY")
                    yield from _install_command(shared, folder, self._name)
                case "foreach":
                    body = _loop_body(waiting)
                    for item in _loop_items(words, variables):
                        variables[words[0]] = item
                        yield from self._run(body, folder, variables, depth)

    def _expand(self, text: str, variables: dict[str, str]) -> str:
        """Return a text with the values of variables, which may not become endless."""
        values = (variables.get(name, "") for name in _VARIABLE.findall(text))
        self._count(len(text) + sum(map(len, values)))
        return _VARIABLE.sub(lambda match: variables.get(match[1], match[0]), text)

    def _count(self, num_characters: int) -> None:
        self._num_characters += num_characters
        if self._num_characters > _MAX_EXPANDED:
            raise ValueError("the commands of its CMakeLists.txt are too long")


def _loop_body(commands: Iterator[tuple[str, str]]) -> list[tuple[str, str]]:
    """Take the commands up to the end of a loop, whose start has been taken."""
    body, num_open = [], 1
    for command, text in commands:
        num_open += {"foreach": 1, "endforeach": -1}.get(command, 0)
        if num_open == 0:
            break
        body.append((command, text))
    return body


def _loop_items(words: list[str], variables: dict[str, str]) -> list[str]:
    match words:
        case [_, "IN", "LISTS", *lists]:
            return [item for name in lists for item in _words(variables.get(name, ""))]
        case [_, "IN", "ITEMS", *items]:
            return items
        case [_, "RANGE" | "IN", *_] | []:
            return []
    return words[1:]


def _install_command(words: list[str], folder: Path, name: str) -> Iterator[Installed]:
    if len(words) < 2 or words[0] not in ("DIRECTORY", "FILES", "PROGRAMS"):
        return
    sources = []
    for word in words[1:]:
        if word in _OPTIONS:
            break
        sources.append(word)
    after = dict(itertools.pairwise(words))
    place = _below_share(after.get("DESTINATION", ""), name)
    if place is None:
        return
    for source in sources:
        path = folder / source
        if words[0] == "DIRECTORY" and source.endswith("/"):  # Its content.
            children = sorted(path.iterdir()) if path.is_dir() else []
            yield from ((place / child.name, child) for child in children)
        elif words[0] == "FILES" and "RENAME" in after:
            if is_plain_name(after["RENAME"]):
                yield place / after["RENAME"], path
        else:
            yield place / path.name, path


def is_plain_name(name: str) -> bool:
    """Return whether a text names something in a folder, and nothing outside of it."""
    return name not in ("", ".", "..") and "/" not in name and "\0" not in name


def _below_share(destination: str, name: str) -> PurePosixPath | None:
    """Return the place below `share/<name>` that a destination is, or None."""
    parts = PurePosixPath(destination.lstrip("/")).parts
    if parts[:2] != ("share", name) or ".." in parts:
        return None
    return PurePosixPath(*parts[2:])


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text.replace(";", " "))
    except ValueError:  # An open quote.
        return text.split()


def _read(path: Path) -> str:
    if not os.path.isfile(path):  # A pipe would be read for ever.
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(_MAX_TEXT + 1)
    if len(text) > _MAX_TEXT:
        raise ValueError(f"its {path.name} is larger than {_MAX_TEXT // 2**10} kB")
    return text
