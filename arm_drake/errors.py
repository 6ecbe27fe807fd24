"""Exceptions for what can be wrong with a user's input, each with one clear message.

Every message reads ``<file>:<line>: <place>: <what is wrong>; <what would be right>``,
with the parts that are known.
"""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

# So many names that exist are listed in a message.
_MAX_NAMES = 30

# Of more than that, so many of those that are most alike.
_NEAREST = 5

# So many files beside one that isn't there.
_MAX_FILES = 5


class Located(Protocol):
    """Object with a place in a file, such as a parameter."""

    @property
    def file(self) -> Path:
        """The file."""

    @property
    def line(self) -> int:
        """Line in the file, counted from 1; 0 where it isn't known."""


class ArmDrakeError(Exception):
    """Base of every error that a user's input can cause."""


class InputError(ArmDrakeError, ValueError):
    """An input can't be used: a file, a value in it, or an argument."""

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        where: str | None = None,
        at: Located | None = None,
    ) -> None:
        """Create the error.

        Args:
            problem: What is wrong and what would be right, without a period.
            file: File that holds the input.
            line: Line in the file, counted from 1; 0 where it isn't known.
            where: Place in the file, such as a dotted path or a joint's name.
            at: What is wrong, in place of file and line.
        """
        if at is not None:
            file, line = at.file, at.line
        self.problem = problem
        self.file = None if file is None else str(file)
        self.line = line or None
        self.where = where
        super().__init__(": ".join(self._parts()))

    def _parts(self) -> Iterable[str]:
        if self.file is not None:
            yield self.file if self.line is None else f"{self.file}:{self.line}"
        if self.where:
            yield self.where
        yield self.problem


class PackageError(InputError):
    """A package, or a file in it, can't be found."""


class DescriptionError(InputError):
    """A robot description can't be used."""


class ParameterError(InputError):
    """A parameter is missing, of the wrong type or out of range."""


class MotionError(InputError):
    """A motion file can't be used with this robot."""


class SimulationError(ArmDrakeError):
    """A simulation can't go on."""


class OutputError(InputError):
    """A result can't be written to the requested place."""


class ArmDrakeWarning(UserWarning):
    """What is done as the user said, but hardly as it was meant."""


class MissingExtraError(ArmDrakeError, ImportError):
    """An optional dependency is needed and isn't installed."""

    def __init__(self, feature: str, extra: str) -> None:
        """Create the error.

        Args:
            feature: What needs the dependency.
            extra: Name of the extra that installs it.
        """
        super().__init__(f"{feature} needs `pip install 'arm-drake[{extra}]'`")


def check_type(name: str, value: object, kind: Any, expected: str) -> None:
    """Raise InputError unless an argument is of a kind, one that isinstance takes."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected {expected}, got {value!r}")


def check_known(
    kind: str,
    name: object,
    known: Collection[str],
    *,
    argument: str = "",
    where: str | None = None,
) -> None:
    """Raise InputError unless a name, of a kind of things, is one of those known.

    Args:
        kind: What is named, such as "joint".
        name: The name.
        known: The names of all there are.
        argument: The argument that names it, if the message is to say so.
        where: Place of the name.
    """
    if name not in known:
        start = f"{argument}: " if argument else ""
        problem = f"{start}no {kind} {name!r}; {suggest(str(name), known)}"
        raise InputError(problem, where=where)


def quoted(names: Iterable[str]) -> str:
    """Return names as a message lists them."""
    return ", ".join(map(repr, names))


def counted(number: int, what: str) -> str:
    """Return a number of things in words: "1 joint", "2 joints"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def first_names(names: Sequence[str], most: int) -> str:
    """Return the first names in one text, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


# So much alike are a word and the one that was meant: "val" and "value" just so.
MISSPELT = 0.75


def _likeness(name: str, other: str) -> float:
    """Return how alike two names are, from 0 to 1."""
    from difflib import SequenceMatcher

    return SequenceMatcher(None, other, name).ratio()


def find_close(name: str, known: Iterable[str], likeness: float = 0.5) -> str | None:
    """Return the known name that another one may mean, if any is so much alike."""
    names = list(known)
    if name in names:
        return name
    from difflib import get_close_matches

    close = get_close_matches(name, names, n=1, cutoff=likeness)
    return close[0] if close else None


def did_you_mean(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Return the end of a message about a name: "; did you mean ...?" or ""."""
    close = find_close(name, known, likeness)
    return "" if close is None else f"; did you mean {close!r}?"


def suggest(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about a name that isn't one of the known ones."""
    names = sorted(set(known))
    close = find_close(name, names)
    hint = f"did you mean {close!r}? " if close is not None else ""
    if len(names) > _MAX_NAMES:
        names = sorted(names, key=lambda other: -_likeness(name, other))
        return f"{hint}known: {first_names(names, _NEAREST)}"
    return f"{hint}known: {', '.join(names) or 'none'}"


def suggest_file(path: Path) -> str:
    """Return the end of a message about a missing file: "; ..." or ""."""
    folder = path.parent
    if not folder.is_dir():
        nearest = next((each for each in folder.parents if each.is_dir()), folder)
        other = nearest / path.name
        hint = f", did you mean {str(other)!r}?" if other.is_file() else ""
        return f"; there is no folder {str(folder)!r}{hint}"
    try:
        files = [each for each in folder.iterdir() if each.is_file()]
    except OSError:
        return ""
    suffix = path.suffix.lower()
    names = sorted(each.name for each in files if each.suffix.lower() == suffix)
    stems = {Path(each).stem.lower(): each for each in names}
    close = find_close(path.stem.lower(), stems, 0.6)
    if close is not None:
        return f"; did you mean {stems[close]!r}?"
    found = first_names([*map(repr, names)], _MAX_FILES)
    return f"; there are {found}" if names else ""
