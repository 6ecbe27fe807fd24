"""Find ROS packages and the files that robot descriptions name.

A package is a folder with a `package.xml`. Source trees and install trees
(`share/<package>`) are searched alike. First come the folders that the user names, the
entry file's own package and what ROS has installed; then what lies around the entry
file, the nearest first, for one repository may hold several copies of a package.
"""

import itertools
import os
import re
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from arm_drake.description.install_layout import installed_elsewhere, is_plain_name
from arm_drake.description.install_links import show_as_installed
from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError, suggest

# How far below a searched folder a package may lie, and how far above the entry file's
# package its workspace may begin.
_SEARCH_DEPTH = 5
_WORKSPACE_HEIGHT = 4

# A bound on the folders looked at below one ancestor.
_MAX_FOLDERS = 20_000

_SKIPPED = {"build", "install", "log", "node_modules", "__pycache__"}
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


class PackageFinder:
    """Resolves package names and file URIs for one robot description."""

    def __init__(
        self,
        entry: Path,
        package_paths: Sequence[Path] = (),
        report: LoadReport | None = None,
    ) -> None:
        """Create a finder.

        Args:
            entry: The description's entry file.
            package_paths: Folders to search first, with all that lies below them.
            report: Where a package that only seems to be the right one is recorded.
        """
        self._entry = entry
        parents = list(entry.resolve().parents)
        owners = [i for i, p in enumerate(parents) if os.path.isfile(p / "package.xml")]
        self._own = parents[owners[0]] if owners else None
        del parents[(owners[0] if owners else 1) + _WORKSPACE_HEIGHT :]
        # An entry file in the home folder must not start a walk through all of it.
        home = _home()
        self._ancestors = list(
            itertools.takewhile(
                lambda folder: folder not in (folder.parent, home), parents
            )
        )
        self._package_paths = tuple(path.absolute() for path in package_paths)
        self._report = LoadReport() if report is None else report
        self._scanned: dict[Path, dict[str, Path]] = {}
        self._found: dict[str, Path] = {}
        self._sources: dict[str, Path] = {}
        # Packages that look different when installed, shown as that.
        self._installed: Path | None = None

    def find(self, name: str) -> Path:
        """Return the folder of a package, as `share/<package>` where it is installed.

        Args:
            name: Name in its package.xml, or of its folder.

        Raises:
            PackageError: If there is no such package.
        """
        if name not in self._found:
            self._found[name] = self._as_installed(name, self._search(name))
        return self._found[name]

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
            package, _, path = rest.lstrip("/").partition("/")
            return self.real(self.find(unquote(package)) / unquote(path))
        raise PackageError(
            f"{uri!r} can't be loaded; expected a path, package://, model:// or file://"
        )

    def known(self) -> list[tuple[str, Path]]:
        """Return all packages that can be found, by name, the preferred first."""
        return [item for packages in self._candidates() for item in packages.items()]

    def locate(self, uri: str, relative_to: Path) -> tuple[Path, bool]:
        """Return where a file is, and whether that is elsewhere than its URI says.

        Authors write down where a file lay on their own machine, or relative to their
        package instead of to their file: it is looked for in the entry's package too.

        Args:
            uri: As for `resolve`.
            relative_to: As for `resolve`.

        Raises:
            PackageError: If the package isn't found. A file need not be.
        """
        path = self.resolve(uri, relative_to)
        # Unlike that of Path, it takes names that no file can have.
        if os.path.isfile(path) or self._own is None:
            return path, False
        names = {self._own.name, package_name(self._own / "package.xml")}
        parts = path.parts
        tails = [parts[i + 1 :] for i, part in enumerate(parts) if part in names]
        if path.is_relative_to(self._entry.parent):
            tails.append(path.relative_to(self._entry.parent).parts)
        candidates = [self._own.joinpath(*tail) for tail in tails if tail]
        found = next((other for other in candidates if os.path.isfile(other)), None)
        return (path, False) if found is None else (found, True)

    def real(self, path: Path) -> Path:
        """Return where a file lies that `find` shows as installed."""
        shown = self._installed
        if shown is None or not path.is_relative_to(shown):
            return path
        if os.path.exists(path):
            return path.resolve()
        name, *rest = path.relative_to(shown).parts
        return self._sources[name].joinpath(*rest)

    def real_paths(self, text: str) -> str:
        """Return a text in which every path that `find` made up is the real one."""
        if self._installed is None:
            return text
        pattern = re.escape(str(self._installed)) + r"[^\"'<>|*?\n]*"
        return re.sub(pattern, lambda m: str(self.real(Path(m[0]))), text)

    def _search(self, name: str) -> Path:
        by_folder = None
        for packages in self._candidates():
            if name in packages:
                return packages[name]
            for folder in packages.values():
                if folder.name == name and by_folder is None:
                    by_folder = folder
        found = by_folder or self._folder_called(name)
        if found is not None:
            what = f"no package.xml says that it is the package {name!r}"
            done = f"the folder {str(found)!r} of that name is taken"
            self._report.add("info", "repair", what, done, file=self._entry)
            return found
        known = {package for package, _ in self.known()}
        raise PackageError(
            f"package {name!r} not found; name the folder that holds it with "
            f"package_paths (--package-path); {suggest(name, known)}",
            file=self._entry,
        )

    def _folder_called(self, name: str) -> Path | None:
        """Return a folder of this name beside or above the entry file, if any."""
        if not is_plain_name(name):
            return None
        beside = [folder / name for folder in self._ancestors]
        above = [folder for folder in self._ancestors if folder.name == name]
        given = [root / name for root in self._package_paths]
        candidates = [*given, *above, *beside]
        # Unlike that of Path, it takes names that no folder can have.
        return next((path for path in candidates if os.path.isdir(path)), None)

    def _as_installed(self, name: str, package: Path) -> Path:
        try:
            return self._show(name, package)
        except (OSError, ValueError, RecursionError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            what = f"what package {name!r} installs can't be followed: {reason}"
            done = f"its source folder {str(package)!r} is taken as it is"
            self._report.add("warning", "unsupported", what, done, file=self._entry)
            return package

    def _show(self, name: str, package: Path) -> Path:
        rules = installed_elsewhere(package, name)
        if not rules:
            return package
        if self._installed is None:
            self._installed = Path(tempfile.mkdtemp(prefix="arm_drake_"))
            weakref.finalize(self, shutil.rmtree, self._installed, ignore_errors=True)
        shown = self._installed / name
        try:
            show_as_installed(package, rules, shown)
        except BaseException:
            shutil.rmtree(shown, ignore_errors=True)
            raise
        self._sources[name] = package
        return shown

    def _candidates(self) -> Iterator[dict[str, Path]]:
        """Yield packages by name, the preferred ones first."""
        for root in self._package_paths:
            yield self._scan(root)
        if self._own in self._ancestors:
            yield {package_name(self._own / "package.xml"): self._own}
        for variable in ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"):
            for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                yield self._scan(Path(prefix) / "share")
        for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if path:
                yield self._scan(Path(path))
        for folder in self._ancestors:
            yield self._scan(folder)

    def _scan(self, root: Path) -> dict[str, Path]:
        if root not in self._scanned:
            self._scanned[root] = dict(_packages_below(root))
        return self._scanned[root]


def _home() -> Path | None:
    try:
        return Path.home()
    except RuntimeError:  # A user without one, as in many a container.
        return None


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
            # Unlike that of Path, it takes folders that can't be read.
            if os.path.isfile(manifest):
                found.append((package_name(manifest), folder))
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


def package_name(manifest: Path) -> str:
    """Return the name in a `package.xml`, or that of its folder.

    Args:
        manifest: The file.
    """
    try:
        match = _NAME.search(manifest.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        match = None
    return match.group(1) if match else manifest.parent.name
