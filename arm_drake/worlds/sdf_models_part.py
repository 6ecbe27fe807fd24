"""Where models and meshes of SDF files are: nothing is downloaded."""

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from arm_drake.description.packages import PackageFinder
from arm_drake.errors import InputError, PackageError
from arm_drake.worlds.sdf_files import read_sdf

# Folders of models, as Gazebo's users name them.
_VARIABLES = (
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "GAZEBO_MODEL_PATH",
    "SDF_PATH",
)

# How far above a world's package or folder its models may lie, and how far below.
_HEIGHT = 3
_DEPTH = 5

# A bound on the folders looked at below one place.
_MAX_FOLDERS = 5_000

_REMOTE = re.compile(r"https?://", re.IGNORECASE)


class ModelFinder:
    """Finds what an SDF file and the models in it name."""

    def __init__(self, world: Path, package_paths: Sequence[Path] = ()) -> None:
        """Create a finder.

        Args:
            world: The file of the world.
            package_paths: Folders to search first, with all that lies below them.
        """
        self._packages = PackageFinder(world, package_paths)
        self._package_paths = tuple(package_paths)
        parents = list(world.resolve().parents)
        owners = [i for i, p in enumerate(parents) if (p / "package.xml").is_file()]
        # The last is what is searched below: the package, or the world's own folder.
        self._near = parents[: (owners[0] if owners else 0) + 1]
        self._above = [
            folder
            for folder in parents[len(self._near) : len(self._near) + _HEIGHT]
            if folder != folder.parent
        ]
        self._below: dict[Path, dict[str, Path]] = {}

    def find_model(self, uri: str, relative_to: Path) -> Path | None:
        """Return the SDF file of a model, or None.

        Args:
            uri: `model://`, `package://`, `file://`, a path, or an address of Fuel,
                whose models are taken where they are already.
            relative_to: Folder that relative paths start from.
        """
        if _REMOTE.match(uri):
            parts = [unquote(part) for part in uri.split("/") if part]
            # Such as .../models/Ground Plane/2; the version is a number.
            uri = f"model://{next((p for p in parts[::-1] if not p.isdigit()), '')}"
        path = self.find_file(uri, relative_to)
        if path is None or path.is_file():
            return path
        return _file_of_model(path)

    def find_file(self, uri: str, relative_to: Path) -> Path | None:
        """Return where a file or folder is, or None.

        Args:
            uri: As that of `find_model`; remote files are never there.
            relative_to: Folder that relative paths start from.
        """
        if _REMOTE.match(uri) or "\0" in unquote(uri):
            return None
        scheme, found, rest = uri.partition("://")
        if found and scheme == "model":
            name, _, inside = unquote(rest).lstrip("/").partition("/")
            folder = self._find_folder(name)
            return None if folder is None else _existing(folder / inside)
        try:
            return _existing(self._packages.locate(uri, relative_to)[0])
        except PackageError:
            return None

    def _find_folder(self, name: str) -> Path | None:
        """Return the folder of a model, by its name."""
        if not name or name in (".", ".."):
            return None
        for folder in self._candidates(name):
            if os.path.isdir(folder):
                return folder
        try:
            return self._packages.find(name)
        except PackageError:
            return None

    def _candidates(self, name: str) -> Iterator[Path]:
        for root in self._package_paths:
            yield from self._search_below(root, name)
        for folder in self._near:
            yield from (folder / name, folder / "models" / name)
        yield from self._search_below(self._near[-1], name)
        for variable in _VARIABLES:
            for place in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                yield Path(place) / name
        for folder in self._above:
            yield from (folder / name, folder / "models" / name)

    def _search_below(self, root: Path, name: str) -> Iterator[Path]:
        """Yield the folder below a place that holds a model of this name, if any."""
        if root not in self._below:
            self._below[root] = _models_below(root)
        if name in self._below[root]:
            yield self._below[root][name]


def _existing(path: Path) -> Path | None:
    return path if os.path.exists(path) else None


def _models_below(root: Path) -> dict[str, Path]:
    """Return the folders that hold models, by name, the topmost of each."""
    found: dict[str, Path] = {}
    level, count = [root], 0
    for _ in range(_DEPTH + 1):
        below: list[Path] = []
        for folder in level:
            count += 1
            if count > _MAX_FOLDERS:
                return found
            try:
                entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
            except OSError:
                continue
            names = {entry.name for entry in entries}
            if names & {"model.config", "model.sdf"}:
                found.setdefault(folder.name, folder)
            below += [
                Path(entry.path)
                for entry in entries
                if entry.is_dir(follow_symlinks=False)
                and not entry.name.startswith(".")
            ]
        level = below
    return found


def _file_of_model(folder: Path) -> Path | None:
    """Return the SDF file of a model's folder: that of the newest version."""
    config = folder / "model.config"
    if config.is_file():
        named = _named_in(config)
        if named is not None:
            return named
    path = folder / "model.sdf"
    return path if path.is_file() else None


def _named_in(config: Path) -> Path | None:
    try:
        root = read_sdf(config, root_tag="model").root
    except InputError:
        return None
    versions = {
        _version(element.get("version", "")): element.text
        for element in root.iterfind("sdf")
    }
    for _, name in sorted(versions.items(), reverse=True):
        path = config.parent / (name or "").strip()
        if path.is_file() and path.resolve().is_relative_to(config.parent.resolve()):
            return path
    return None


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall("[0-9]+", text))
