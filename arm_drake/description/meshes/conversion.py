"""Mesh files of robot descriptions to what Drake draws and collides, once."""

import dataclasses as dc
import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

from arm_drake.description.meshes import cache, convex
from arm_drake.description.meshes.cache import cache_directory as cache_directory
from arm_drake.description.meshes.cache import clear_cache as clear_cache
from arm_drake.description.meshes.decimation import decimate, require_decimation
from arm_drake.description.meshes.files import read_bytes, references
from arm_drake.description.meshes.gltf import encode_gltf
from arm_drake.description.meshes.reading import read_surfaces
from arm_drake.description.meshes.surface_obj import encode_surface
from arm_drake.description.meshes.surfaces import Array, Color, Surface
from arm_drake.description.report import Kind, LoadReport, ReportEntry, Severity

# Part of every cache key: raise it when the same input gives another output.
CONVERTER_VERSION = 4

MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")

# Browsers draw a few million triangles of all robots together.
MANY_TRIANGLES = 200_000

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
) -> Path | None:
    """Return a glTF file that Drake draws with scale 1, or None and a report line.

    Args:
        source: The mesh file.
        scale: Factors for x, y and z; negative ones mirror.
        report: Receives what was not taken as written.
        where: Place in the description, such as "link 'link1', visual 0".
        file: The description.
        cache_dir: Folder of converted meshes, by default `cache_directory`.
        color: For a mesh that has no colour of its own.
        max_faces: Triangles at most; by default as many as the mesh has.

    Raises:
        InputError: `max_faces` is less than the triangles of a solid.
        MissingExtraError: The library that decimates isn't installed.
        OutputError: Neither the cache nor a temporary folder can be written.
    """
    settings: tuple[object, ...] = (color,)
    if max_faces is not None:
        settings = (color, max_faces, require_decimation(max_faces))
    conversion = _Conversion(
        "visual", source, scale, report, where, file, color, max_faces
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

    Args:
        source: The mesh file.
        scale: Factors for x, y and z; negative ones mirror.
        report: Receives what was not taken as written.
        where: Place in the description, such as "link 'link1', collision 0".
        file: The description.
        cache_dir: Folder of converted meshes, by default `cache_directory`.
        decompose: Whether to cover the mesh with convex parts, one file each, instead
            of its convex hull.
        by_piece: Whether each piece that touches no other one has a hull of its own.

    Raises:
        MissingExtraError: The library that decomposes isn't installed.
        OutputError: Neither the cache nor a temporary folder can be written.
    """
    library = (convex.require_decomposition(),) if decompose else ()
    mode: Mode = "parts" if decompose else "pieces" if by_piece else "hull"
    return _Conversion(mode, source, scale, report, where, file).run(cache_dir, library)


def convert_surface(
    source: Path, scale: Scale, *, cache_dir: Path | None = None
) -> Path | None:
    """Return an OBJ file with the triangles of a collision mesh, or None.

    What can't be read was told when its hull was made.

    Args:
        source: The mesh file.
        scale: Factors for x, y and z; negative ones mirror.
        cache_dir: Folder of converted meshes, by default `cache_directory`.

    Raises:
        OutputError: Neither the cache nor a temporary folder can be written.
    """
    conversion = _Conversion("surface", source, scale, LoadReport(), "", None)
    paths = conversion.run(cache_dir, ())
    return paths[0] if paths else None


@dc.dataclass(frozen=True)
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
            return self._lose("missing", "doesn't exist")
        except OSError as error:
            return self._lose("invalid", f"can't be read ({error.strerror})")
        files = references(self.source, content)
        sums = [hashlib.sha256(content).hexdigest(), *self._checksums(files)]
        scale = tuple(map(float, self.scale))
        key = (CONVERTER_VERSION, self.mode, suffix, scale, settings, [*files], sums)
        digest = hashlib.sha256(repr(key).encode()).hexdigest()
        folder = (cache_directory() if cache_dir is None else cache_dir).absolute()
        kind = ".gltf" if self.mode == "visual" else ".obj"
        converted = cache.find(folder, digest, kind)
        if converted is None:
            notes: list[ReportEntry] = []
            try:
                with np.errstate(all="ignore"):
                    outputs = self._outputs(content, files, notes)
            # The parsers of other projects answer a bad file with any exception.
            except Exception as error:
                reason = " ".join(str(error).split()) or type(error).__name__
                self._add_notes(notes)
                return self._lose("invalid", f"can't be read ({reason[:100]})")
            if not outputs:
                self._add_notes(notes)
                return self._lose("invalid", "holds no triangles", "warning")
            converted = cache.keep(
                folder, digest, kind, outputs, notes=notes, report=self.report
            )
        self._add_notes(converted.notes)
        return converted.paths

    def _checksums(self, files: dict[str, Path | None]) -> list[str]:
        """Return checksums of the files that a mesh file names; report the lost."""
        sums = []
        for name, path in files.items():
            kind: Kind = "missing" if path is None else "invalid"
            problem = "doesn't exist"
            try:
                if path is not None:
                    sums.append(hashlib.sha256(read_bytes(path)).hexdigest())
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
    ) -> list[bytes]:
        """Return the files for Drake, none if there are no triangles."""
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
            return [encode_gltf(surfaces, color)] if surfaces else []
        if self.mode == "surface":
            return [encode_surface(surfaces)] if surfaces else []
        return [convex.encode_hull(body) for body in self._bodies(surfaces, notes)]

    def _bodies(self, surfaces: list[Surface], notes: list[ReportEntry]) -> list[Array]:
        """Return the points of each convex body, none if there are no triangles."""
        if not surfaces:
            return []
        vertices = np.concatenate([surface.vertices for surface in surfaces])
        points, is_flat = convex.solid_points(vertices)
        if is_flat:
            what, done = "the mesh is flat", "its hull is 0.1 mm thick or more"
            notes.append(ReportEntry("info", "repair", what, done))
        elif len(points) and self.mode == "parts":
            try:
                return convex.decompose(surfaces)
            except ValueError as error:
                what, done = str(error), "its convex hull is used"
                notes.append(ReportEntry("warning", "unsupported", what, done))
        elif len(points) and self.mode == "pieces":
            return convex.split(surfaces)
        return [points] if len(points) else []

    def _add_notes(self, notes: Iterable[ReportEntry]) -> None:
        for note in notes:
            what = f"{self._mesh}: {note.what}"
            self.report.add(
                note.severity,
                note.kind,
                what,
                note.done,
                where=self.where,
                file=self.file,
            )

    def _lose(
        self, kind: Kind, problem: str, severity: Severity | None = None
    ) -> _Paths:
        is_visual = self.mode == "visual"
        self.report.add(
            severity or ("warning" if is_visual else "error"),
            kind,
            f"{self._mesh} {problem}",
            "it isn't drawn" if is_visual else "nothing collides with it",
            where=self.where,
            file=self.file,
        )
        return ()

    @property
    def _mesh(self) -> str:
        return f"mesh file {str(self.source)!r}"
