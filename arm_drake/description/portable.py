"""Descriptions without folders of this machine: the same bytes wherever they lie."""

import functools
import os
import re
from pathlib import Path

from arm_drake.description.packages import package_name

# What may be an absolute path, as xacro writes it: of meshes as URIs, of other files
# bare, and of the entry file in a comment. One that ends a value may have spaces.
_PATH = re.compile(
    r"(?P<scheme>file:/{1,2}(?=/))?"
    r"(?P<path>/(?:[^\n\"'<>|]+(?=[\"'<]| \|)|[^\s\"'<>|]+))"
)


def make_portable(text: str, file: Path) -> str:
    """Return a description with package URIs in place of paths into packages.

    What lies below the entry file's folder, but in no package, is named from there;
    paths to anywhere else stay as they are.

    Args:
        text: The expanded description.
        file: Its entry file.
    """
    folder = f"{file.absolute().parent}{os.sep}"

    @functools.cache
    def find_package(parent: str) -> str | None:
        manifest = Path(parent, "package.xml")
        return package_name(manifest) if os.path.isfile(manifest) else None

    def rename(match: re.Match[str]) -> str:
        before = text[match.start() - 1 : match.start()]
        path = re.sub("^/+", "/", match["path"])
        if match["scheme"] is None and (before.isalnum() or before in ("", ":", "/")):
            return match[0]  # Part of something else, such as a URI or a relative path.
        # As it is written: what climbs out of a package is named from that package.
        end = path.rfind("/")
        while end > 0:
            name = find_package(path[:end])
            if name is not None:
                return f"package://{name}{path[end:]}"
            end = path.rfind("/", 0, end)
        return path.removeprefix(folder) if path.startswith(folder) else match[0]

    return _PATH.sub(rename, text)
