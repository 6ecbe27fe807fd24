"""LoadReport: one line for everything that was not taken as written."""

import dataclasses as dc
import functools
import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

from arm_drake.errors import Located, first_names

Severity = Literal["info", "warning", "error"]
# The order in which people read them.
_ORDER = ("error", "warning", "info")

# Of things found in many places, so many are named in the text.
_MAX_PLACES = 4

# Of so many that differ in numbers only, those of the first are told.
_MANY = 4
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?(e[-+]?\d+)?(?!\w)")

Kind = Literal["repair", "ignored", "unsupported", "missing", "invalid"]


@dc.dataclass(frozen=True)
class ReportEntry:
    """One thing that was not taken as written."""

    severity: Severity

    kind: Kind

    # What is the matter.
    what: str

    # What was done about it.
    done: str

    # Place in the file, such as "joint 'elbow'" or a dotted path.
    where: str = ""

    file: str | None = None
    line: int | None = None

    def __str__(self) -> str:
        """Return the entry as one line."""
        place = self.file or ""
        if self.file and self.line is not None:
            place += f":{self.line}"
        parts = [part for part in (place, self.where, self.what) if part]
        return f"{self.severity}: {': '.join(parts)}; {self.done}"


def _shape(text: str) -> str:
    """Return a text without its numbers."""
    return _NUMBER.sub("0", text)


def _key(entry: ReportEntry, of: Callable[[str], str]) -> tuple[str, ...]:
    texts = (entry.what, entry.done)
    return (entry.severity, entry.kind, entry.file or "", *map(of, texts))


def _merge(entries: list[ReportEntry]) -> ReportEntry:
    """Return one entry for things that differ only in their places and numbers."""
    places = list(dict.fromkeys(entry.where for entry in entries if entry.where))
    # Such as "ros2_control 'arm', ", if all are in that block.
    blocks = {"".join(each.rpartition(", ")[:2]) for each in places}
    block = blocks.pop() if len(blocks) == 1 else ""
    short = [each.removeprefix(block) for each in places]
    named = block + first_names(short, _MAX_PLACES)
    lines = {entry.line for entry in entries}
    line = lines.pop() if len(lines) == 1 else None
    done = entries[0].done
    if len({(entry.what, entry.done) for entry in entries}) > 1:
        done += f" (so the first of {len(entries)}; the others have other numbers)"
    return dc.replace(entries[0], where=named, line=line, done=done)


class LoadReport:
    """What was repaired, ignored, unsupported, missing or invalid in a load."""

    def __init__(self, entries: Iterable[ReportEntry] = ()) -> None:
        """Create a report.

        Args:
            entries: What is in it from the start, such as another report.
        """
        self._entries = list(entries)
        self._seen = set(self._entries)

    def add(
        self,
        severity: Severity,
        kind: Kind,
        what: str,
        done: str,
        *,
        where: str = "",
        file: str | Path | None = None,
        line: int | None = None,
        at: Located | None = None,
    ) -> None:
        """Add a line, once, however often the same thing is found.

        Args:
            severity: "error" if something that the user asked for is lost.
            kind: What sort of thing it is.
            what: What is the matter.
            done: What was done about it.
            where: Place in the file.
            file: File that it is in.
            line: Line in the file, counted from 1.
            at: What is the matter with, in place of file and line.
        """
        if at is not None:
            file, line = at.file, at.line
        name = None if file is None else str(file)
        entry = ReportEntry(severity, kind, what, done, where, name, line)
        if entry not in self._seen:
            self._seen.add(entry)
            self._entries.append(entry)

    def __iter__(self) -> Iterator[ReportEntry]:
        """Iterate over the entries in the order in which they were found."""
        return iter(self._entries)

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._entries)

    @property
    def errors(self) -> tuple[ReportEntry, ...]:
        """The entries of severity "error"."""
        return tuple(e for e in self._entries if e.severity == "error")

    def to_json(self) -> list[dict[str, object]]:
        """Return the entries as plain data for JSON."""
        return [dc.asdict(entry) for entry in self._entries]

    def add_lines(self, find: Callable[[str], tuple[Path, int] | None]) -> None:
        """Say where things stand that were found in an expanded description.

        Args:
            find: Returns file and line of a place such as "link 'elbow'", or None.
        """
        for index, entry in enumerate(self._entries):
            if entry.line is not None or not entry.where:
                continue
            found = find(entry.where)
            if found is not None:
                file, line = found
                self._entries[index] = dc.replace(entry, file=str(file), line=line)
        self._seen.update(self._entries)

    def grouped(self) -> list[ReportEntry]:
        """Return the entries for people: errors first, and no line twice.

        What was found in several places is one entry, whose place names the first few;
        so is what differs in its numbers, too, where there is much of it.
        """
        entries = sorted(self._entries, key=lambda e: _ORDER.index(e.severity))
        alike: dict[tuple[str, ...], list[ReportEntry]] = {}
        for entry in entries:
            alike.setdefault(_key(entry, _shape), []).append(entry)
        groups: dict[tuple[str, ...], list[ReportEntry]] = {}
        for entry in entries:
            texts = {_key(each, str) for each in alike[_key(entry, _shape)]}
            key = _key(entry, _shape if len(texts) >= _MANY else str)
            groups.setdefault(key, []).append(entry)
        return [_merge(group) for group in groups.values()]

    def __str__(self) -> str:
        """Return the report as lines of text, errors first, no line twice."""
        return "\n".join(map(str, self.grouped()))

    def __repr__(self) -> str:
        """Return the report as JSON."""
        return f"LoadReport({json.dumps(self.to_json())})"


# Places are written "link 'elbow'", "ros2_control 'arm', joint 'elbow'" and so on.
_PLACE = re.compile(r"(link|joint|material|ros2_control|sensor) '([^']*)'")

_TAG = re.compile(
    r"<(link|joint|material|ros2_control|sensor)\b[^>]*?"
    r"\bname\s*=\s*(?:\"([^\"]+)\"|'([^']+)')"
)

# Joints in such blocks aren't those of the URDF; of Gazebo's the sensors are meant.
_NO_SENSOR = re.compile(r"<(?!sensor\b)")
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
    """
    exact: dict[tuple[str, str], tuple[Path, int]] = {}
    computed: dict[str, list[tuple[re.Pattern[str], tuple[Path, int]]]] = {}

    @functools.cache
    def read() -> None:
        for path in files():
            for kind, name, line in _tags(path):
                exact.setdefault((kind, name), (path, line))
                parts = _COMPUTED.split(name)
                if len(parts) > 1 and any(parts):
                    pattern = re.compile(".*".join(map(re.escape, parts)))
                    computed.setdefault(kind, []).append((pattern, (path, line)))

    def find(where: str) -> tuple[Path, int] | None:
        match = _PLACE.match(where)
        if match is None:
            return None
        read()
        kind, name = match.groups()
        if (kind, name) in exact:
            return exact[kind, name]
        possible = [
            place
            for pattern, place in computed.get(kind, ())
            if pattern.fullmatch(name)
        ]
        return possible[0] if len(possible) == 1 else None

    return find


def _without_joints(block: re.Match[str]) -> str:
    if block[2] == "gazebo":
        return block[1] + _NO_SENSOR.sub("", block[3])
    return block[1] + "\n" * block[3].count("\n")


def _tags(path: Path) -> Iterable[tuple[str, str, int]]:
    """Yield kind, name and line of the tags that have places."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return
    text = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
    text = _BLOCK.sub(_without_joints, text)
    line, end = 1, 0
    for match in _TAG.finditer(text):
        line, end = line + text.count("\n", end, match.start()), match.start()
        yield match[1], match[2] or match[3], line
