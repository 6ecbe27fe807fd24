"""Mesh files and the files they name, found as RViz and Gazebo find them."""

import errno
import re
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

# Reading takes up to 20 times as much memory as a file is large.
MAX_FILE_BYTES = 128 * 2**20

# How files name those that belong to them. Each pattern begins with a word: anything
# else takes far longer to search for in millions of numbers.
_URI = re.compile(rb'"uri"\s*:\s*"(?!data:)([^"]+)"')
_REFERENCES = {
    ".dae": re.compile(rb"<image\b[^<>]*>\s*<init_from>\s*(?:<ref>)?([^<]+)<"),
    ".glb": _URI,
    ".gltf": _URI,
    ".mtl": re.compile(rb"map_Kd[ \t]+([^\r\n]+)"),
    ".obj": re.compile(rb"mtllib[ \t]+([^\r\n]+)"),
    ".ply": re.compile(rb"comment TextureFile[ \t]+([^\r\n]+)"),
}

# Types in which a name stands on a line of its own; elsewhere is a comment.
_OF_LINES = (".mtl", ".obj", ".ply")


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
    for name in _names(source, content):
        found[name] = path = beside(source, name)
        if path is not None and path.suffix.lower() == ".mtl":
            try:
                material = read_bytes(path)
            except OSError:  # Whoever wants it will hear.
                continue
            found |= {
                texture: beside(path, texture) for texture in _names(path, material)
            }
    return found


def _names(path: Path, content: bytes) -> list[str]:
    suffix = path.suffix.lower()
    pattern = _REFERENCES.get(suffix)
    matches = () if pattern is None else pattern.finditer(content)
    return [
        match[1].decode(errors="replace").strip()
        for match in matches
        if suffix not in _OF_LINES or _begins_line(match)
    ]


def _begins_line(match: re.Match[bytes]) -> bool:
    """Return whether nothing but blanks stands before a match in its line."""
    line = match.string.rfind(b"\n", 0, match.start()) + 1
    return not match.string[line : match.start()].strip(b" \t")


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
