"""Find ROS packages and the files that robot descriptions name.

A package is a folder with a `package.xml`. Source trees and install trees
(`share/<package>`) are searched alike; the package nearest to the entry file wins, for
one repository may hold several copies of a package.
"""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from arm_drake.errors import PackageError, suggest

# How far below a searched folder a package may lie, and how far above the entry file
# its workspace may begin.
_SEARCH_DEPTH = 5
_WORKSPACE_HEIGHT = 4

# A bound on the folders looked at below one ancestor: an entry file in a home folder
# must not start a walk through all of it.
_MAX_FOLDERS = 20_000

_SKIPPED = {"build", "install", "log", "node_modules", "__pycache__"}
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


class PackageFinder:
    """Resolves package names and file URIs for one robot description."""

    def __init__(self, entry: Path, package_paths: Sequence[Path] = ()) -> None:
        """Create a finder.

        Args:
            entry: The description's entry file.
            package_paths: Folders to search first, with all that lies below them.
        """
        self._entry = entry
        self._package_paths = tuple(package_paths)
        self._scanned: dict[Path, dict[str, Path]] = {}

    def find(self, name: str) -> Path:
        """Return the folder of a package.

        Args:
            name: Name in its package.xml.

        Raises:
            PackageError: If there is no such package.
        """
        for folder in self._candidates():
            if name in folder:
                return folder[name]
        known = {package for folder in self._candidates() for package in folder}
        raise PackageError(
            f"package {name!r} not found; name the folder that holds it with "
            f"package_paths (--package-path); {suggest(name, known)}",
            file=self._entry,
        )

    def resolve(self, uri: str, relative_to: Path) -> Path:
        """Return the path that a file name or URI in a description stands for.

        Args:
            uri: `package://`, `model://`, `file://`, an absolute or a relative path.
            relative_to: Folder that relative paths start from.

        Raises:
            PackageError: If the package isn't found. The file itself isn't looked at.
        """
        scheme, separator, rest = uri.partition("://")
        if "\0" in unquote(uri):
            raise PackageError(
                f"{uri!r} can't be loaded; no file name holds a null byte"
            )
        if not separator:
            return relative_to / uri
        if scheme == "file":
            # "file:////abs" and "file:///abs" both occur; both mean "/abs".
            return Path("/" + unquote(rest).lstrip("/"))
        if scheme in ("package", "model"):
            package, _, path = rest.partition("/")
            return self.find(unquote(package)) / unquote(path)
        raise PackageError(
            f"{uri!r} can't be loaded; expected a path, package://, model:// or file://"
        )

    def _candidates(self) -> Iterator[dict[str, Path]]:
        """Yield packages by name, the preferred ones first."""
        for root in self._package_paths:
            yield self._scan(root)
        ancestors = list(self._entry.resolve().parents)[: _WORKSPACE_HEIGHT + 1]
        for folder in ancestors:
            if folder.parent == folder or folder == Path.home():
                break
            yield self._scan(folder)
        for variable in ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"):
            for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                yield self._scan(Path(prefix) / "share")
        for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if path:
                yield self._scan(Path(path))

    def _scan(self, root: Path) -> dict[str, Path]:
        if root not in self._scanned:
            self._scanned[root] = dict(_packages_below(root))
        return self._scanned[root]


def _packages_below(root: Path) -> Iterable[tuple[str, Path]]:
    """Return (name, folder) of the packages below a folder, the nearest one last."""
    found: list[tuple[str, Path]] = []
    level, num_folders = [root], 0
    for _ in range(_SEARCH_DEPTH + 1):
        below: list[Path] = []
        for folder in level:
            num_folders += 1
            if num_folders > _MAX_FOLDERS:
                return reversed(found)
            manifest = folder / "package.xml"
            if manifest.is_file():
                found.append((_package_name(manifest), folder))
            below += _subfolders(folder)
        level = below
    return reversed(found)


def _subfolders(folder: Path) -> list[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return []
    return [
        Path(entry.path)
        for entry in entries
        if entry.is_dir(follow_symlinks=False)
        and not entry.name.startswith(".")
        and entry.name not in _SKIPPED
    ]


def _package_name(manifest: Path) -> str:
    try:
        match = _NAME.search(manifest.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        match = None
    return match.group(1) if match else manifest.parent.name
