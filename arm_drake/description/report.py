"""The load report: one line for everything that was not taken as written."""

import dataclasses as dc
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

Severity = Literal["info", "warning", "error"]
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
        if self.line is not None:
            place += f":{self.line}"
        parts = [part for part in (place, self.where, self.what) if part]
        return f"{self.severity}: {': '.join(parts)}; {self.done}"


class LoadReport:
    """What was repaired, ignored, unsupported, missing or invalid in a load."""

    def __init__(self, entries: Iterable[ReportEntry] = ()) -> None:
        """Create a report.

        Args:
            entries: What is in it from the start, such as another report.
        """
        self._entries = list(entries)

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
        """
        name = None if file is None else str(file)
        entry = ReportEntry(severity, kind, what, done, where, name, line)
        if entry not in self._entries:
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

    def __str__(self) -> str:
        """Return the report as lines of text."""
        return "\n".join(str(entry) for entry in self._entries)

    def __repr__(self) -> str:
        """Return the report as JSON."""
        return f"LoadReport({json.dumps(self.to_json())})"
