"""The cache of converted meshes.

Beside the files of a mesh lies a ``.json`` with their checksums and report lines.
"""

import atexit
import dataclasses as dc
import functools
import hashlib
import json
import os
import re
import shutil
import tempfile
import uuid
from pathlib import Path

import platformdirs

from arm_drake.description.report import LoadReport, ReportEntry
from arm_drake.errors import OutputError

# Names that this module writes or wrote, including what an interrupted write leaves.
_OURS = re.compile(r"[0-9a-f]{64}(_\d+)?\.(gltf|obj|json)(\.json)?(\.\w+\.tmp)?")


@dc.dataclass(frozen=True)
class ConvertedMesh:
    """Files that Drake takes with scale 1, and what was reported on the way."""

    # Absolute; several for the parts of a decomposed mesh.
    paths: tuple[Path, ...]

    # Without place and file, which belong to whoever asks.
    notes: tuple[ReportEntry, ...] = ()


def cache_directory() -> Path:
    """Return the folder of converted meshes; ``ARM_DRAKE_CACHE`` moves it."""
    root = os.environ.get("ARM_DRAKE_CACHE") or platformdirs.user_cache_dir("arm_drake")
    return Path(os.path.expanduser(root)).absolute() / "meshes"


def clear_cache(cache_dir: Path | None = None) -> int:
    """Remove converted meshes, nothing else, and return how many files that were."""
    folder = cache_directory() if cache_dir is None else cache_dir
    ours = [path for path in folder.glob("*") if _OURS.fullmatch(path.name)]
    for path in ours:
        path.unlink(missing_ok=True)  # Another process may be clearing it too.
    return len(ours)


def find(folder: Path, key: str, suffix: str) -> ConvertedMesh | None:
    """Return what `keep` wrote, or None if it isn't there undamaged."""
    for place in (folder, None):
        try:
            base = place or _substitute(folder)
            record = json.loads((base / f"{key}.json").read_bytes())
            paths = _paths(base, key, suffix, len(record["sha256"]))
            sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
            if sums and sums == record["sha256"]:
                notes = tuple(ReportEntry(**note) for note in record["notes"])
                return ConvertedMesh(paths, notes)
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            continue
    return None


def keep(
    folder: Path,
    key: str,
    suffix: str,
    contents: list[bytes],
    *,
    notes: list[ReportEntry],
    report: LoadReport,
) -> ConvertedMesh:
    """Write the files of a mesh so that no reader ever sees half of them.

    A cache that can't be written is replaced by a temporary folder, with a report line.

    Args:
        folder: The cache.
        key: 64 hexadecimal digits.
        suffix: Type of the files, such as ".obj".
        contents: The files.
        notes: What `find` is to return with them.
        report: Receives that the cache can't be written.

    Raises:
        OutputError: The temporary folder can't be written either.
    """
    record = {
        "sha256": [hashlib.sha256(content).hexdigest() for content in contents],
        "notes": [dc.asdict(note) for note in notes],
    }
    try:
        paths = _write(folder, key, suffix, contents, record)
    except OSError as error:
        what = f"the mesh cache {str(folder)!r} can't be written ({error.strerror})"
        done = "converted meshes last as long as this process"
        report.add("info", "ignored", what, done)
        try:
            paths = _write(_substitute(folder), key, suffix, contents, record)
        except OSError as error:
            what = f"no converted mesh can be written ({error.strerror})"
            raise OutputError(what, file=_substitute(folder)) from error
    return ConvertedMesh(paths, tuple(notes))


def _paths(folder: Path, key: str, suffix: str, count: int) -> tuple[Path, ...]:
    return tuple(folder / f"{key}_{i}{suffix}" for i in range(count))


def _write(
    folder: Path,
    key: str,
    suffix: str,
    contents: list[bytes],
    record: dict[str, object],
) -> tuple[Path, ...]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = _paths(folder, key, suffix, len(contents))
    for path, content in zip(paths, contents, strict=True):
        _write_whole(path, content)
    _write_whole(folder / f"{key}.json", json.dumps(record).encode())
    return paths


def _write_whole(path: Path, content: bytes) -> None:
    handle, unfinished = tempfile.mkstemp(".tmp", f"{path.name}.", path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(unfinished).replace(path)
    except OSError:
        Path(unfinished).unlink(missing_ok=True)
        raise


def _substitute(folder: Path) -> Path:
    """Return where this process keeps what it can't write to a cache."""
    return _temporary_directory() / hashlib.sha256(bytes(folder)).hexdigest()


@functools.cache
def _temporary_directory() -> Path:
    path = Path(tempfile.gettempdir(), f"arm_drake_meshes_{uuid.uuid4().hex}")
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path
