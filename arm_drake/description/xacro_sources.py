"""What xacro files ask for, read without expanding them.

xacro stops at the first thing that is missing. Here all files that can be reached are
read, so that one message lists everything.
"""

import dataclasses as dc
import os
import re
from pathlib import Path

from arm_drake.description.packages import PackageFinder
from arm_drake.errors import PackageError

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_ARGUMENT = re.compile(r"<xacro:arg\s([^>]*)>")
_INCLUDE = re.compile(r"<xacro:include\s([^>]*)>")
_ATTRIBUTE = re.compile(r"(\w+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_FIND = re.compile(r"\$\(find\s+([^)\s]+)\s*\)")
_PACKAGE_URI = re.compile(r"package://([^/\"'$<>\s]+)/")

# A bound on the files read for one message.
_MAX_FILES = 1000


@dc.dataclass
class XacroSources:
    """What the files of a description declare, and what they lack."""

    # The files that were read, the entry file first.
    files: list[Path] = dc.field(default_factory=list)

    # Arguments that are declared, with their defaults.
    arguments: dict[str, str | None] = dc.field(default_factory=dict)

    # Places that include a file that doesn't exist, by its path.
    missing_files: dict[str, list[str]] = dc.field(default_factory=dict)


def read_sources(entry: Path, packages: PackageFinder) -> XacroSources:
    """Return what a file and all that it includes declare and lack.

    Args:
        entry: The description's entry file.
        packages: What resolves `$(find <package>)`.
    """
    sources = XacroSources()
    waiting, seen = [entry], {entry.resolve()}
    while waiting and len(seen) < _MAX_FILES:
        path = waiting.pop(0)
        if not os.path.isfile(path):  # A pipe would be read for ever.
            continue
        sources.files.append(packages.real(path))
        for included in _read(path, packages, sources):
            if included.resolve() not in seen:
                seen.add(included.resolve())
                waiting.append(included)
    return sources


def missing_packages(entry: Path, packages: PackageFinder) -> dict[str, list[str]]:
    """Return the places that ask for a package that isn't found, by its name.

    Args:
        entry: The description's entry file.
        packages: What resolves `$(find <package>)`.
    """
    missing: dict[str, list[str]] = {}
    for path in read_sources(entry, packages).files:
        text = _text(path)
        for match in (*_FIND.finditer(text), *_PACKAGE_URI.finditer(text)):
            if _folder(match[1], packages) is None:
                places, place = missing.setdefault(match[1], []), _place(path, match)
                places += [place] * (place not in places)
    return missing


def _read(path: Path, packages: PackageFinder, sources: XacroSources) -> list[Path]:
    """Add what one file declares and lacks; return the files that it includes."""
    text = _text(path)
    for name, default in declared_arguments(text).items():
        sources.arguments.setdefault(name, default)
    found = []
    for match in _INCLUDE.finditer(text):
        attributes = _attributes(match[1])
        name = _FIND.sub(
            lambda m: str(_folder(m[1], packages) or m[0]),
            attributes.get("filename", ""),
        )
        if "$" in name or "*" in name or not name:
            continue
        included = path.parent / name
        if os.path.isfile(included):
            found.append(included)
        elif attributes.get("optional", "").lower() not in ("true", "1"):
            real, place = (
                str(packages.real(included)),
                _place(packages.real(path), match),
            )
            sources.missing_files.setdefault(real, []).append(place)
    return found


def _text(path: Path) -> str:
    """Return a file's text without comments, line by line as it was."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return _COMMENT.sub(lambda match: "\n" * match[0].count("\n"), text)


def _place(path: Path, match: re.Match[str]) -> str:
    return f"{path}:{match.string.count(chr(10), 0, match.start()) + 1}"


def _folder(name: str, packages: PackageFinder) -> Path | None:
    try:
        return packages.find(name)
    except PackageError:
        return None


def declared_arguments(text: str) -> dict[str, str | None]:
    """Return the arguments that a xacro text declares, with their defaults."""
    declared = {}
    for match in _ARGUMENT.finditer(text):
        attributes = _attributes(match[1])
        if "name" in attributes:
            declared[attributes["name"]] = attributes.get("default")
    return declared


def _attributes(text: str) -> dict[str, str]:
    return {name: double or single for name, double, single in _ATTRIBUTE.findall(text)}
