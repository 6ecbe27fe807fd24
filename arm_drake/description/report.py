"""LoadReport: one line for everything that was not taken as written."""

import collections
import dataclasses as dc
import functools
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

from arm_drake.errors import InputError, Located, first_names
from arm_drake.importing import dataclass

Severity = Literal["info", "warning", "error"]
# The order in which people read them.
_ORDER: Sequence[Severity] = ("error", "warning", "info")

# Of things found in many places, so many are named in the text.
_MAX_PLACES = 4

# Of so many that differ in numbers only, those of the first are told.
_MANY = 4
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d*)?(e[-+]?\d+)?(?!\w)")

Kind = Literal["repair", "ignored", "unsupported", "missing", "invalid"]


@dataclass(frozen=True)
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
    """Report of repaired, ignored, unsupported, missing or invalid parts of a load."""

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
            line: Line in the file, counted from 1; 0 where it isn't known.
            at: What is the matter with, in place of file and line.
        """
        if at is not None:
            file, line = at.file, at.line
        name = None if file is None else str(file)
        entry = ReportEntry(severity, kind, what, done, where, name, line or None)
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

    @property
    def problems(self) -> tuple[ReportEntry, ...]:
        """The entries that count with `strict`: errors and warnings.

        What is "info" makes no difference, or is taken as what it stands for.
        """
        return tuple(e for e in self._entries if e.severity != "info")

    def check(self) -> None:
        """Raise InputError for errors and warnings."""
        if self.problems:
            text = str(LoadReport(self.problems))
            raise InputError(f"not everything was taken as written:\n{text}")

    def to_json(self) -> list[dict[str, object]]:
        """Return the entries as plain data for JSON."""
        return [dc.asdict(entry) for entry in self._entries]

    def add_lines(self, find: Callable[[str], tuple[Path, int] | None]) -> None:
        """Add file and line to entries on an expanded description.

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
        return "\n".join(map(str, self.grouped())) or "nothing to report"

    def __repr__(self) -> str:
        """Return how many entries of each severity there are."""
        numbers = collections.Counter(entry.severity for entry in self._entries)
        found = [f"{numbers[each]} {each}" for each in _ORDER if numbers[each]]
        return f"<LoadReport, {', '.join(found) or 'nothing to report'}>"


class Places:
    """Places of a description's elements in the files that it was made of.

    `expand_xacro` fills it; names are looked for when somebody asks.
    """

    def __init__(self) -> None:
        """Create it for a description without files, such as a text."""
        # What xacro made of the files, and file and line of each of its elements, in
        # the order of the text.
        self.text = ""
        self.of_elements: Sequence[tuple[Path, int] | None] = ()

    def find(self, where: str) -> tuple[Path, int] | None:
        """Return file and line of the innermost element that a place names.

        Args:
            where: A place, such as "ros2_control 'arm', joint 'elbow'".
        """
        while where and where not in self._by_name:
            where = where.rpartition(", ")[0]
        return self._by_name.get(where)

    @functools.cached_property
    def _by_name(self) -> dict[str, tuple[Path, int]]:
        if not self.of_elements:
            return {}
        root = ET.fromstring(self.text)  # noqa: S314  It was read already.
        places = dict(zip(root.iter(), self.of_elements, strict=True))
        found: dict[str, tuple[Path, int]] = {}
        for name, element in _named_elements(root):
            place = places[element]
            if place is not None:
                found.setdefault(name, place)
        return found


def _named_elements(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield what reports call elements: "link 'arm'", "link 'arm', visual 0"."""
    for element in root:
        name = f"{element.tag} '{element.get('name', '')}'"
        yield name, element
        numbers: dict[str, int] = {}
        for child in element:
            number = numbers[child.tag] = numbers.get(child.tag, -1) + 1
            if element.tag == "ros2_control":
                yield f"{name}, {child.tag} '{child.get('name', '')}'", child
            elif element.tag == "link":
                yield f"{name}, {child.tag} {number}", child
        if element.tag == "ros2_control":
            continue
        for tag, title in (("material",) * 2, ("sensor",) * 2, ("sensor", "IMU")):
            for each in element.iter(tag):
                yield f"{title} '{each.get('name', '')}'", each
