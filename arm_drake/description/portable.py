"""Descriptions without folders of this machine: the same bytes wherever they lie."""

import functools
import os
import re
from pathlib import Path

from arm_drake.description.packages import package_name

# What may be an absolute path, as xacro writes it: of meshes as URIs, of other files
# bare, and of the entry file in a comment. One that ends a value may have spaces.
_PATH = re.compile(
    r"(?P<scheme>file:/{0,2}(?=/))?"
    r"(?P<path>/(?:[^\n\"'<>|,;:]+(?=[\"'<,;:]| \|)|[^\s\"'<>|,;:]+))"
)

# A file that is named from the entry file's folder.
_RELATIVE = re.compile(r"(?<=filename=\")(?![\w+.-]+:|/)[^\"<>]+")


def make_portable(text: str, file: Path) -> str:
    """Return a description with package URIs in place of paths into packages.

    So are files named that stand relative to the entry file. Paths to anywhere else
    stay as they are.

    Args:
        text: The expanded description.
        file: Its entry file, which is called by its name where it is in no package.
    """

    def rename(match: re.Match[str]) -> str:
        before = text[match.start() - 1 : match.start()]
        # Part of a relative path, or of another URI; lists have colons, too.
        is_part = before.isalnum() or before in ("/", ".")
        is_part |= before == ":" and match["path"].startswith("//")
        if is_part and match["scheme"] is None:
            return match[0]
        if " /" in match["path"]:  # Several of them.
            first, *others = match["path"].split(" /")
            paths = [(match["scheme"] or "") + first, *(f"/{each}" for each in others)]
        else:
            paths = [match[0]]
        names = [name_portably(path) for path in paths]
        return " ".join(file.name if name == str(file) else name for name in names)

    def resolve(match: re.Match[str]) -> str:
        path = str(file.parent / match[0])
        name = name_portably(path)
        return match[0] if name == path or not os.path.isfile(path) else name

    return _RELATIVE.sub(resolve, _PATH.sub(rename, text))


def name_portably(path: str) -> str:
    """Return a package URI in place of a path into a package; others as they are.

    Args:
        path: An absolute path, or a URI of one.
    """
    place = re.sub("^(file:)?/+", "/", path)
    # As it is written: what climbs out of a package is named from that package.
    end = len(place.rstrip("/"))
    while end > 0:
        name = _package_at(place[:end])
        if name is not None:
            return f"package://{name}{place[end:]}"
        end = place.rfind("/", 0, end)
    return path


@functools.lru_cache(maxsize=10_000)
def _package_at(folder: str) -> str | None:
    """Return the name of the package that a folder is, if it is one."""
    manifest = Path(folder, "package.xml")
    return package_name(manifest) if os.path.isfile(manifest) else None
