"""Files that a robot was made of, and which of them have changed."""

import contextlib
import dataclasses as dc
import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from arm_drake.description.controllers import ControllerManagerConfig
from arm_drake.description.entry import Source, find_entry, listed
from arm_drake.description.packages import PackageFinder
from arm_drake.description.robot import Robot
from arm_drake.description.srdf import find_srdf_files
from arm_drake.description.urdf import RobotDescription
from arm_drake.description.xacro import expand_xacro, read_sources
from arm_drake.errors import ArmDrakeError, InputError, PackageError

# Times of files come from a clock that may be late by so much [ns].
_COARSENESS = 20_000_000

# What tells a file from what it was: time of its last change [ns], size, inode.
_Signature = tuple[int, int, int]


def find_source_files(
    description: RobotDescription,
    controllers: ControllerManagerConfig,
    packages: PackageFinder,
    others: Iterable[Path] = (),
) -> tuple[Path, ...]:
    """Return the files that a robot was made of: sorted, absolute, all there.

    They are its description, its controllers YAML, its meshes and the textures that it
    names itself; what a mesh file refers to is left out.
    """
    meshes = _mesh_files(description, packages)
    files = {description.file, *controllers.files, *others, *meshes}
    return _sorted(file for file in files if os.path.isfile(file))


def watched_files(robot: Robot) -> tuple[Path, ...]:
    """Return the files whose change changes what is seen of a robot.

    They are its source files and the SRDF files for it. Loading doesn't read those, and
    looking for them takes a walk through all packages.
    """
    return _sorted({*robot.source_files, *find_srdf_files(robot)})


def file_of(error: Exception) -> tuple[Path, ...]:
    """Return the file that an error names, if it names one."""
    file = error.file if isinstance(error, InputError) else None
    return () if file is None else (_absolute(Path(file)),)


def files_of_failed(
    source: Source,
    error: Exception | None = None,
    *,
    controllers: Source | Sequence[Source] | None = None,
    xacro_args: Mapping[str, str] | None = None,
    package_paths: Source | Sequence[Source] = (),
) -> tuple[Path, ...]:
    """Return the files whose change may mend a robot that can't be loaded, sorted.

    Files that are asked for and don't exist are among them; there are none if it isn't
    known which file is the robot's. The arguments are those of `load_robot`, and the
    error why it can't be loaded, which may name a file.
    """
    files = set(listed(controllers or ()))
    if error is not None:
        files.update(file_of(error))
    with contextlib.suppress(ArmDrakeError):
        entry, _ = find_entry(source)
        packages = PackageFinder(entry, listed(package_paths))
        # This one follows all includes whose names it can read, but no further; xacro
        # knows all names, up to what it fails on.
        sources = read_sources(entry, packages)
        files.update(sources.files, map(Path, sources.missing_files))
        expand_xacro(entry, dict(xacro_args or {}), packages, files=files)
    return _sorted(file for file in files if not os.path.isdir(file))


class FileWatcher:
    """Finds files that have changed since the last look.

    Editors replace a file by another one, so that there may be none for a moment: one
    that is missing counts as changed when it is back, or missing twice in a row.
    """

    def __init__(self, files: Iterable[Path] = (), *, period: float = 0.0) -> None:
        """Look at files for the first time; they need not exist.

        Two looks are at least a period [s] apart; a file that is being replaced may be
        missing for as long.
        """
        self._period = period
        self._looked_at = -math.inf
        self._watched: dict[Path, _Watched] = {}
        self.watch(files)

    def watch(self, files: Iterable[Path], since: int | None = None) -> None:
        """Watch these files and no others; they need not exist.

        Changes of files that were watched before and that `changed` has not told yet
        are not lost: those made while the robot was loaded anew. Files that are new
        here and were written since a time [ns] of `time.time_ns` count as changed.
        """
        old = self._watched
        self._watched = {
            file: old[file] if file in old else _first_look(file, since)
            for file in files
        }

    def changed(self) -> tuple[Path, ...]:
        """Return the files that have changed since the last look, in their order."""
        if time.monotonic() < self._looked_at + self._period:
            return ()
        self._looked_at = time.monotonic()
        return tuple(
            file
            for file, watched in self._watched.items()
            if watched.is_changed(_signature(file))
        )


@dc.dataclass
class _Watched:
    """State of a file at the last look."""

    # None if there was none.
    signature: _Signature | None

    # Whether it was missing at the last look for the first time.
    is_missed: bool = False

    def is_changed(self, now: _Signature | None) -> bool:
        """Take note of what is seen now, and return whether that is a change."""
        is_missed = now is None and self.signature is not None
        is_changed = not is_missed and (now != self.signature or self.is_missed)
        self.signature, self.is_missed = now, is_missed
        return is_changed


def _first_look(file: Path, since: int | None) -> _Watched:
    signature = _signature(file)
    is_new = (
        since is not None
        and signature is not None
        and signature[0] >= since - _COARSENESS
    )
    return _Watched(None if is_new else signature)


def _signature(file: Path) -> _Signature | None:
    """Return a signature that changes with the file, None without one."""
    try:
        status = os.stat(file)
    except (OSError, ValueError):  # A name that no file can have.
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def _mesh_files(
    description: RobotDescription, packages: PackageFinder
) -> Iterator[Path]:
    """Yield the files of meshes and textures, as the URDF names them."""
    # Looking for a package in vain takes long.
    missing = set()
    for name in description.mesh_names:
        package = name.partition("://")[2].lstrip("/").partition("/")[0]
        if package and package in missing:
            continue
        try:
            yield packages.locate(name, description.file.parent)[0]
        except PackageError:
            missing.add(package)


def _sorted(files: Iterable[Path]) -> tuple[Path, ...]:
    return tuple(sorted({_absolute(file) for file in files}))


def _absolute(file: Path) -> Path:
    """Return a path without "..", which links to folders give another meaning."""
    if ".." not in file.parts:
        return file.absolute()
    return file.parent.resolve() / file.name
