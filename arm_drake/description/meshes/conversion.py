"""Conversion of meshes to what Drake draws and collides, and the cache of the results.

In the cache a ``.json`` with checksums and report lines lies beside the files of a
mesh.
"""

import atexit
import dataclasses as dc
import functools
import io
import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from arm_drake.description.meshes.reading import read_bytes, read_surfaces, references
from arm_drake.description.meshes.surfaces import (
    Array,
    Color,
    Surface,
    decimate,
    encode_gltf,
    encode_surface,
    require_decimation,
    stack,
)
from arm_drake.description.report import Kind, LoadReport, ReportEntry, Severity
from arm_drake.errors import MissingExtraError, OutputError, suggest_file
from arm_drake.importing import dataclass

try:
    # `hashlib` has it, too, and brings OpenSSL: 4 MB, and 27 million instructions.
    from _blake2 import blake2b
except ImportError:
    from hashlib import blake2b

# Names that this module writes or wrote, including what an interrupted write leaves.
_OURS = re.compile(r"[0-9a-f]{64}(_\d+)?\.(gltf|obj|json)(\.json)?(\.\w+\.tmp)?")


@dataclass(frozen=True)
class ConvertedMesh:
    """Files that Drake takes with scale 1, and what was reported on the way."""

    # Absolute; several for the parts of a decomposed mesh.
    paths: tuple[Path, ...]

    # Without place and file, which belong to whoever asks.
    notes: tuple[ReportEntry, ...] = ()

    # Longest side of what is drawn [m]; 0 of a body that collides.
    size: float = 0.0


def cache_directory() -> Path:
    """Return the folder of converted meshes; ``ARM_DRAKE_CACHE`` moves it."""
    root = os.environ.get("ARM_DRAKE_CACHE") or _user_cache()
    return Path(os.path.expanduser(root)).absolute() / "meshes"


def _user_cache() -> str:
    """Return where the system keeps what this program caches."""
    if sys.platform == "linux":
        # The rule of XDG, as platformdirs has it, which brings some twenty modules.
        folder = os.environ.get("XDG_CACHE_HOME", "")
        return f"{folder if os.path.isabs(folder) else '~/.cache'}/arm_drake"
    import platformdirs

    return platformdirs.user_cache_dir("arm_drake")


def clear_cache(cache_dir: Path | None = None) -> int:
    """Remove converted meshes, nothing else, and return how many files that were."""
    folder = cache_directory() if cache_dir is None else cache_dir
    cached = [path for path in folder.glob("*") if _OURS.fullmatch(path.name)]
    for path in cached:
        path.unlink(missing_ok=True)  # Another process may be clearing it too.
    return len(cached)


def _checksum(data: bytes) -> str:
    """Return 64 hexadecimal digits that stand for a content."""
    return blake2b(data, digest_size=32).hexdigest()


def find(folder: Path, key: str, suffix: str) -> ConvertedMesh | None:
    """Return what `keep` wrote, or None if it is missing or damaged."""
    for place in (folder, None):
        try:
            base = place or _substitute(folder)
            record = json.loads((base / f"{key}.json").read_bytes())
            paths = _paths(base, key, suffix, len(record["checksums"]))
            sums = [_checksum(path.read_bytes()) for path in paths]
            if sums and sums == record["checksums"]:
                notes = tuple(ReportEntry(**note) for note in record["notes"])
                return ConvertedMesh(paths, notes, float(record.get("size", 0.0)))
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
    size: float = 0.0,
) -> ConvertedMesh:
    """Write the files of a mesh so that no reader ever sees half of them.

    A cache that can't be written is replaced by a temporary folder, with a report line.
    """
    record = {
        "checksums": [_checksum(content) for content in contents],
        "notes": [dc.asdict(note) for note in notes],
        "size": size,
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
    return ConvertedMesh(paths, tuple(notes), size)


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
    import tempfile

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
    return _temporary_directory() / _checksum(bytes(folder))


@functools.cache
def _temporary_directory() -> Path:
    import shutil
    import tempfile
    from uuid import uuid4

    path = Path(tempfile.gettempdir(), f"arm_drake_meshes_{uuid4().hex}")
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


# Drake's convex hull needs a volume: a flat mesh gets this thickness [m].
_FLAT_THICKNESS = 1e-4
_FLATNESS = 1e-5  # Thickness as a part of the size; less is flat.

# How far a thinned hull may be from the mesh, as a part of its size: half a millimetre
# of a link of half a metre, less than its hull adds where it is hollow. Drake computes
# hulls again at every load, and contact takes longer with every corner.
TOLERANCE = 1e-3

# What people draw by hand has fewer corners: a cylinder of 64 sides has these.
FEW_CORNERS = 128

# Distances between points and planes that are in memory at a time.
_MAX_DISTANCES = 100_000

# Meshes of torn triangles can keep the decomposition busy for hours.
DECOMPOSITION_TIMEOUT = 300.0  # s

# Contact takes longer with every piece.
_MAX_PIECES = 200

# In a process of its own: the library can't be interrupted, and it prints.
_DECOMPOSE = """
import io, os, sys
import numpy as np
result = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
import coacd
mesh = np.load(io.BytesIO(sys.stdin.buffer.read()))
coacd.set_log_level("off")
parts = coacd.run_coacd(coacd.Mesh(mesh["vertices"], mesh["faces"]), seed=0)
np.savez(result, *(points for points, _ in parts))
"""


def require_decomposition() -> str:
    """Return the version of the library that decomposes."""
    import importlib.util

    if importlib.util.find_spec("coacd") is None:
        raise MissingExtraError("convex decomposition of meshes", "decompose")
    from importlib.metadata import version  # It brings e-mail and more.

    return version("coacd")


def split(surfaces: list[Surface]) -> list[Array]:
    """Return the points of each piece of a mesh, each of shape (n, 3).

    Pieces share no corner with each other, as the walls of a house or the legs of a
    table often don't. A mesh of very many pieces is one.
    """
    # Not at the top: most robots are loaded without it, and it takes longest of all.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, faces = _joined(surfaces)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    edges = coo_array(
        (np.ones(len(ends), dtype=bool), (ends[:, 0], ends[:, 1])),
        shape=(len(points), len(points)),
    )
    _, labels = connected_components(edges, directed=False)
    used = np.unique(labels[faces])
    if len(used) > _MAX_PIECES:
        return [points]
    pieces = [solid_points(points[labels == label])[0] for label in used]
    return [piece for piece in pieces if len(piece)]


def decompose(surfaces: list[Surface]) -> list[Array]:
    """Return the points of convex parts that cover a mesh, each of shape (n, 3)."""
    points, faces = _joined(surfaces)
    stream = io.BytesIO()
    np.savez(stream, vertices=points, faces=faces)
    try:
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-c", _DECOMPOSE],
            input=stream.getvalue(),
            capture_output=True,
            timeout=DECOMPOSITION_TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        limit = f"{DECOMPOSITION_TIMEOUT:.0f} s"
        raise ValueError(f"its decomposition takes more than {limit}") from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise ValueError(f"its decomposition failed ({last or done.returncode})")
    with np.load(io.BytesIO(done.stdout)) as parts:
        found = [solid_points(parts[name])[0] for name in parts.files]
    found = [points for points in found if len(points)]
    if not found:
        raise ValueError("its decomposition gave no parts")
    return found


def _joined(surfaces: list[Surface]) -> tuple[Array, Array]:
    """Return different corners, shape (n, 3), and triangles of them, shape (m, 3)."""
    vertices, faces = stack(surfaces)
    # Surfaces of one body share an edge where its colour changes.
    points, rows = np.unique(vertices, axis=0, return_inverse=True)
    return points.astype(float), rows.ravel()[faces]


def solid_points(points: Array) -> tuple[Array, bool]:
    """Return points that span a volume, and whether they had to be made to."""
    points = np.unique(points.astype(float), axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    # Rows of `axes` are the principal axes, the thinnest last.
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1].T[::-1]
    extents = np.ptp(centred @ axes.T, axis=0)
    if extents[1] <= _FLATNESS * size:
        return np.empty((0, 3)), False
    if extents[2] <= _FLATNESS * size:
        offset = axes[2] * max(_FLAT_THICKNESS, 2.0 * _FLATNESS * size) / 2.0
        return np.concatenate([points - offset, points + offset]), True
    return points, False


def thin_hull(corners: Array) -> Array:
    """Return some corners of a convex hull, whose own hull is nearly the same.

    The hull of what is returned lies in the given one and has the same bounding box. No
    corner is farther from it than `TOLERANCE` times the diagonal of that box. Up to
    `FEW_CORNERS` corners are returned as they are.

    It begins with the farthest corners in fixed directions. Then each facet takes the
    corner farthest from it, until all that are left are near enough.
    """
    if len(corners) <= FEW_CORNERS:
        return corners
    # Not at the top: the import takes longer than all hits of the cache together.
    from scipy.spatial import ConvexHull

    tolerance = TOLERANCE * np.linalg.norm(np.ptp(corners, axis=0))
    taken = _first_corners(corners)
    left = np.setdiff1d(np.arange(len(corners)), taken)
    while True:
        points = corners[taken]
        hull: Any = ConvexHull(points)
        nearest, height = _nearest_planes(corners[left], hull.equations)
        distance = _distances(corners[left], points[hull.simplices[nearest]], height)
        # The hull only grows: what is near enough remains so.
        is_far = distance > tolerance
        if not is_far.any():
            return corners[np.sort(taken)]
        left, nearest, distance = left[is_far], nearest[is_far], distance[is_far]
        farthest = np.full(len(hull.equations), -1)
        order = np.argsort(distance, kind="stable")
        farthest[nearest[order]] = left[order]  # Of several, the last one stays.
        added = farthest[farthest >= 0]
        taken = np.concatenate([taken, added])
        left = np.setdiff1d(left, added)


def _first_corners(corners: Array) -> Array:
    """Return rows of corners far apart, which span the bounding box and a volume."""
    directions = np.array(
        [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
    )
    rows = (corners @ directions.T).argmax(axis=0).tolist()
    # A simplex as fat as it can be: farthest from a point, then from a line, a plane.
    rest = corners - corners[rows[0]]
    for _ in range(3):
        length = np.linalg.norm(rest, axis=1)
        row = int(length.argmax())
        rows.append(row)
        axis = rest[row] / length[row]
        rest = rest - np.outer(rest @ axis, axis)
    return np.unique(rows)


def _nearest_planes(points: Array, equations: Array) -> tuple[Array, Array]:
    """Return the plane that each point is farthest outside of, and how far."""
    nearest = np.empty(len(points), int)
    height = np.empty(len(points))
    step = max(1, _MAX_DISTANCES // len(equations))
    for start in range(0, len(points), step):
        rows = slice(start, start + step)
        heights = points[rows] @ equations[:, :3].T + equations[:, 3]
        nearest[rows] = heights.argmax(axis=1)
        height[rows] = heights[np.arange(len(heights)), nearest[rows]]
    return nearest, height


def _distances(points: Array, triangles: Array, height: Array) -> Array:
    """Return the distances of points from triangles, one each, 0 below the plane."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    offsets = points[:, None] - triangles
    along = (offsets * edges).sum(axis=2) / (edges * edges).sum(axis=2)
    nearest = along.clip(0.0, 1.0)[..., None] * edges
    to_edges = np.linalg.norm(offsets - nearest, axis=2).min(axis=1)
    normals = np.cross(edges[:, :1], edges[:, 1:2])
    is_above = ((np.cross(edges, offsets) * normals).sum(axis=2) > 0.0).all(axis=1)
    return np.where(height <= 0.0, 0.0, np.where(is_above, height, to_edges))


def encode_hull(points: Array) -> bytes:
    """Return an OBJ file of the convex hull, thinned by `thin_hull`, faces outward."""
    from scipy.spatial import ConvexHull

    hull: Any = ConvexHull(points)
    corners = points[np.unique(hull.simplices)]
    thinned = thin_hull(corners)
    if len(thinned) < len(corners):
        points, hull = thinned, ConvexHull(thinned)
    faces = hull.simplices
    a, b, c = points[faces.T]
    is_inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = np.where(is_inward[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    return encode_surface([Surface(points[used], rows.reshape(-1, 3))])


# Part of every cache key: raise it when the same input gives another output.
CONVERTER_VERSION = 6

MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")

# Browsers draw a few million triangles of all robots together.
MANY_TRIANGLES = 200_000

# A mesh that is longer than so many robots is in millimetres; a robot has at least this
# extent [m].
_TOO_LARGE = 50.0
_LEAST_EXTENT = 0.2

Scale = tuple[float, float, float]
Mode = Literal["visual", "hull", "parts", "pieces", "surface"]
_Paths = tuple[Path, ...]

_DEFAULT_COLOR: Color = (0.7, 0.7, 0.7, 1.0)

_WITHOUT = "drawn without it"
_IMAGES = (".bmp", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff")


def convert_visual(
    source: Path,
    scale: Scale,
    report: LoadReport,
    *,
    where: str,
    file: Path | None = None,
    cache_dir: Path | None = None,
    color: Color | None = None,
    max_faces: int | None = None,
    extent: float | None = None,
) -> Path | None:
    """Return a glTF file that Drake draws with scale 1, or None and a report line.

    With the ``extent`` [m] of its robot, a mesh that must be in millimetres is told.
    """
    settings: tuple[object, ...] = (color,)
    if max_faces is not None:
        settings = (color, max_faces, require_decimation(max_faces))
    conversion = _Conversion(
        "visual", source, scale, report, where, file, color, max_faces, extent
    )
    paths = conversion.run(cache_dir, settings)
    return paths[0] if paths else None


def convert_collision(
    source: Path,
    scale: Scale,
    report: LoadReport,
    *,
    where: str,
    file: Path | None = None,
    cache_dir: Path | None = None,
    decompose: bool = False,
    by_piece: bool = False,
) -> tuple[Path, ...]:
    """Return OBJ files of convex bodies, or none and a report line.

    A mesh becomes its convex hull; with ``by_piece`` each piece that touches no other
    one its own hull, with ``decompose`` convex parts that cover the mesh.
    """
    library = (require_decomposition(),) if decompose else ()
    mode: Mode = "parts" if decompose else "pieces" if by_piece else "hull"
    return _Conversion(mode, source, scale, report, where, file).run(cache_dir, library)


def convert_surface(
    source: Path, scale: Scale, *, cache_dir: Path | None = None
) -> Path | None:
    """Return an OBJ file with the triangles of a collision mesh, or None.

    What can't be read was told when its hull was made.
    """
    conversion = _Conversion("surface", source, scale, LoadReport(), "", None)
    paths = conversion.run(cache_dir, ())
    return paths[0] if paths else None


def describe_loss(*, is_visual: bool) -> tuple[Severity, str]:
    """Return how grave it is to lose a shape, and what follows.

    Things go through what doesn't collide.
    """
    if is_visual:
        return "warning", "it isn't drawn"
    return "error", "nothing collides with it"


@dataclass(frozen=True)
class _Conversion:
    """One mesh on its way to Drake; the fields are those of `convert_visual`."""

    mode: Mode
    source: Path
    scale: Scale
    report: LoadReport
    where: str
    file: Path | None
    color: Color | None = None
    max_faces: int | None = None
    extent: float | None = None

    def run(self, cache_dir: Path | None, settings: tuple[object, ...]) -> _Paths:
        """Return the converted files, from the cache if it has them."""
        suffix = self.source.suffix.lower()
        if suffix not in MESH_SUFFIXES:
            known = f"known: {', '.join(MESH_SUFFIXES)}"
            return self._lose("unsupported", f"has an unknown type {suffix!r}, {known}")
        if not all(np.isfinite(s) and s != 0.0 for s in self.scale):
            problem = f"has the scale {self.scale}, which has to be finite, not 0"
            return self._lose("invalid", problem)
        try:
            content = read_bytes(self.source)
        except FileNotFoundError:
            return self._lose_missing()
        except OSError as error:
            return self._lose("invalid", f"can't be read ({error.strerror})")
        if not content:
            return self._lose("invalid", "is empty")
        files = references(self.source, content)
        sums = [_checksum(content), *self._checksums(files)]
        scale = tuple(map(float, self.scale))
        key = (CONVERTER_VERSION, self.mode, suffix, scale, settings, [*files], sums)
        digest = _checksum(repr(key).encode())
        folder = (cache_directory() if cache_dir is None else cache_dir).absolute()
        kind = ".gltf" if self.mode == "visual" else ".obj"
        converted = find(folder, digest, kind)
        if converted is None:
            notes: list[ReportEntry] = []
            try:
                with np.errstate(all="ignore"):
                    outputs, size = self._outputs(content, files, notes)
            # The parsers of other projects answer a bad file with any exception.
            except Exception as error:
                reason = " ".join(str(error).split()) or type(error).__name__
                self._add_notes(notes)
                return self._lose("invalid", f"can't be read ({reason[:100]})")
            if not outputs:
                self._add_notes(notes)
                return self._lose("invalid", "holds no triangles")
            converted = keep(
                folder,
                digest,
                kind,
                outputs,
                notes=notes,
                report=self.report,
                size=size,
            )
        self._add_notes(converted.notes)
        self._check_size(converted.size)
        return converted.paths

    def _checksums(self, files: dict[str, Path | None]) -> list[str]:
        """Return checksums of the files that a mesh file names; report the lost."""
        sums = []
        for name, path in files.items():
            kind: Kind = "missing" if path is None else "invalid"
            problem = "doesn't exist"
            try:
                if path is not None:
                    sums.append(_checksum(read_bytes(path)))
                    continue
            except OSError as error:
                problem = f"can't be read ({error.strerror})"
            sums.append(problem)
            if self.mode == "visual":
                what = f"its file {name!r} {problem}"
                self._add_notes([ReportEntry("warning", kind, what, _WITHOUT)])
        return sums

    def _outputs(
        self, content: bytes, files: dict[str, Path | None], notes: list[ReportEntry]
    ) -> tuple[list[bytes], float]:
        """Return the files for Drake, none if there are no triangles, and their size.

        The size is the longest side of what is drawn [m].
        """
        surfaces = read_surfaces(self.source, content, self.scale, notes)
        if self.mode == "visual":
            images = [p for p in files.values() if p and p.suffix.lower() in _IMAGES]
            is_plain = all(surface.texture is None for surface in surfaces)
            if images and is_plain and not any("texture" in n.what for n in notes):
                what = f"its texture {images[0].name!r} can't be read"
                notes.append(ReportEntry("warning", "invalid", what, _WITHOUT))
            if self.max_faces is not None:
                surfaces = decimate(surfaces, self.max_faces, notes)
            count = sum(len(surface.faces) for surface in surfaces)
            if count > MANY_TRIANGLES:
                what = f"it has {count} triangles"
                done = f"drawn; more than {MANY_TRIANGLES} make a browser slow"
                notes.append(ReportEntry("info", "unsupported", what, done))
            color = self.color or _DEFAULT_COLOR
            if not surfaces:
                return [], 0.0
            points = np.concatenate([surface.vertices for surface in surfaces])
            size = float(np.ptp(points, axis=0).max())
            return [encode_gltf(surfaces, color)], size
        if self.mode == "surface":
            return ([encode_surface(surfaces)] if surfaces else []), 0.0
        return [encode_hull(body) for body in self._bodies(surfaces, notes)], 0.0

    def _bodies(self, surfaces: list[Surface], notes: list[ReportEntry]) -> list[Array]:
        """Return the points of each convex body, none if there are no triangles."""
        if not surfaces:
            return []
        vertices = np.concatenate([surface.vertices for surface in surfaces])
        points, is_flat = solid_points(vertices)
        if is_flat:
            what, done = "the mesh is flat", "its hull is 0.1 mm thick or more"
            notes.append(ReportEntry("info", "repair", what, done))
        elif len(points) and self.mode == "parts":
            try:
                return decompose(surfaces)
            except ValueError as error:
                what, done = str(error), "its convex hull is used"
                notes.append(ReportEntry("warning", "unsupported", what, done))
        elif len(points) and self.mode == "pieces":
            return split(surfaces)
        return [points] if len(points) else []

    def _check_size(self, size: float) -> None:
        """Report a mesh so much larger than its robot that its unit is wrong."""
        if not self.extent or size < _TOO_LARGE * max(self.extent, _LEAST_EXTENT):
            return
        scale = " ".join(f"{1e-3 * number:g}" for number in self.scale)
        robot = f"the robot {self.extent:.2g} m"
        what = f"the mesh is {size:.3g} m long, {robot}; in millimetres?"
        self._add("warning", "invalid", f'{what} scale="{scale}"', "drawn as written")

    def _add_notes(self, notes: Iterable[ReportEntry]) -> None:
        for note in notes:
            what = f"{self._mesh}: {note.what}"
            self._add(note.severity, note.kind, what, note.done)

    def _add(self, severity: Severity, kind: Kind, what: str, done: str) -> None:
        where, file = self.where, self.file
        self.report.add(severity, kind, what, done, where=where, file=file)

    def _lose_missing(self) -> _Paths:
        """Report a missing file; all files of a missing folder are one line."""
        hint, folder = suggest_file(self.source), self.source.parent
        if folder.is_dir() or "did you mean" in hint:
            return self._lose("missing", f"doesn't exist{hint}")
        whose = f"mesh files are to lie in {str(folder)!r},"
        return self._lose("missing", "a folder that doesn't exist", whose)

    def _lose(self, kind: Kind, problem: str, mesh: str | None = None) -> _Paths:
        severity, done = describe_loss(is_visual=self.mode == "visual")
        self._add(severity, kind, f"{mesh or self._mesh} {problem}", done)
        return ()

    @property
    def _mesh(self) -> str:
        return f"mesh file {str(self.source)!r}"
