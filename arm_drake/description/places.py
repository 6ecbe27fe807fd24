"""Find the line of a file that makes a link or joint of the expanded description."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

# Places are written "link 'elbow'", "ros2_control 'arm', joint 'elbow'" and so on.
_PLACE = re.compile(r"(link|joint|material|ros2_control) '([^']*)'")

_TAG = re.compile(
    r"<(link|joint|material|ros2_control)\b[^>]*?\bname\s*=\s*(?:\"([^\"]+)\"|'([^']+)')"
)

# Joints in such blocks aren't those of the URDF.
_BLOCK = re.compile(
    r"(<(ros2_control|transmission|gazebo)(?=[\s>])(?:\"[^\"]*\"|'[^']*'|[^>\"'])*(?<!/)>)"
    r"(.*?)</\2\s*>",
    re.DOTALL,
)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)

# Parts of a name that xacro computes.
_COMPUTED = re.compile(r"\$\{[^}]*\}|\$\([^)]*\)")


def find_place(
    files: Callable[[], Sequence[Path]],
) -> Callable[[str], tuple[Path, int] | None]:
    """Return what finds file and line of a place in a description.

    A name that xacro computes is found if only one tag can be meant.

    Args:
        files: Returns the description's files; called when a place is asked for.
    """
    tags: list[tuple[str, str, Path, int]] = []

    def find(where: str) -> tuple[Path, int] | None:
        match = _PLACE.match(where)
        if match is None:
            return None
        if not tags:
            tags.extend(tag for path in files() for tag in _tags(path))
        kind, name = match.groups()
        found: dict[bool, list[tuple[Path, int]]] = {True: [], False: []}
        for other, tag, path, line in tags:
            if other == kind and (tag == name or _may_be(tag, name)):
                found[tag == name].append((path, line))
        if found[True]:
            return found[True][0]
        return found[False][0] if len(found[False]) == 1 else None

    return find


def _may_be(tag: str, name: str) -> bool:
    parts = _COMPUTED.split(tag)
    pattern = ".*".join(map(re.escape, parts))
    return len(parts) > 1 and any(parts) and re.fullmatch(pattern, name) is not None


def _tags(path: Path) -> Iterable[tuple[str, str, Path, int]]:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    text = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
    text = _BLOCK.sub(lambda block: block[1] + "\n" * block[3].count("\n"), text)
    for match in _TAG.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        yield match[1], match[2] or match[3], path, line
