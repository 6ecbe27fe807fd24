"""Mesh files and the files they name, found as RViz and Gazebo find them."""

import errno
import re
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

# Reading takes up to 20 times as much memory as a file is large.
MAX_FILE_BYTES = 128 * 2**20

# How COLLADA, OBJ and MTL, PLY and glTF name the files that belong to them.
_REFERENCE = re.compile(
    rb"<image\b[^<>]*>\s*<init_from>\s*(?:<ref>)?([^<]+)<"
    rb"|^[ \t]*(?:mtllib|map_Kd|comment TextureFile)[ \t]+([^\r\n]+)"
    rb'|"uri"\s*:\s*"(?!data:)([^"]+)"',
    re.MULTILINE,
)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        OSError: It can't be read, is no file or too large; `strerror` says it.
    """
    size = path.stat().st_size
    if path.exists() and not path.is_file():  # A pipe would never end.
        raise OSError(errno.EINVAL, "it is no file")
    if size > MAX_FILE_BYTES:
        known = f"it has {size / 2**20:.0f} MiB, at most {MAX_FILE_BYTES / 2**20:.0f}"
        raise OSError(errno.EFBIG, f"{known} are read")
    return path.read_bytes()


def references(source: Path, content: bytes) -> dict[str, Path | None]:
    """Return where the files are that a mesh file names, None if they don't exist."""
    found: dict[str, Path | None] = {}
    for name in _names(content):
        found[name] = path = beside(source, name)
        if path is not None and path.suffix.lower() == ".mtl":
            try:
                material = read_bytes(path)
            except OSError:  # Whoever wants it will hear.
                continue
            found |= {texture: beside(path, texture) for texture in _names(material)}
    return found


def _names(content: bytes) -> list[str]:
    return [
        next(filter(None, match.groups())).decode(errors="replace").strip()
        for match in _REFERENCE.finditer(content)
    ]


def beside(source: Path, name: str) -> Path | None:
    """Return the file that a mesh file calls `name`, None if it doesn't exist."""
    relative = PureWindowsPath(unquote(name.strip().removeprefix("file://"))).as_posix()
    base = PureWindowsPath(relative).name
    folders = (source.parent, source.parent / "../materials/textures")
    candidates = [source.parent / relative, *(folder / base for folder in folders)]
    try:
        return next((path for path in candidates if path.is_file()), None)
    except OSError:  # Such as a name that is too long.
        return None
