"""Expansion of xacro files with the `xacro` package, without a ROS installation.

xacro runs in a process of its own (`xacro_process`): it keeps its arguments and its
stacks of files in module globals, and what a description can have evaluated is bounded
by what a process may take alone.

xacro stops at the first thing that is missing. To list everything in one message, the
files that can be reached are read without expanding them, too.
"""

import contextlib
import dataclasses as dc
import errno
import glob
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from arm_drake.description.elements import (
    declare_prefixes,
    explain_malformed,
    lines_of_elements,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport, Places, Severity
from arm_drake.errors import (
    ArmDrakeError,
    DescriptionError,
    PackageError,
    suggest,
    suggest_file,
)

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_ARGUMENT = re.compile(r"<xacro:arg\s([^>]*)>")
_INCLUDE = re.compile(r"<xacro:include\s([^>]*)>")
_ATTRIBUTE = re.compile(r"(\w+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
# Names that are put together are left out.
_FIND = re.compile(r"\$\(find\s+([^)\s$]+)\s*\)")
_PACKAGE_URI = re.compile(r"package://([^/\"'$<>\s]+)/")

# A bound on the files read for one message.
_MAX_FILES = 1000


@dc.dataclass
class XacroSources:
    """Declarations in a description's files, and missing files."""

    # The files that were read, the entry file first.
    files: list[Path] = dc.field(default_factory=list)

    # Arguments that are declared, with their defaults.
    arguments: dict[str, str | None] = dc.field(default_factory=dict)

    # Places that include a file that doesn't exist, by its path.
    missing_files: dict[str, list[str]] = dc.field(default_factory=dict)


def read_sources(entry: Path, packages: PackageFinder) -> XacroSources:
    """Return what a file and all that it includes declare and lack."""
    sources = XacroSources()
    waiting, seen = [entry], {entry.resolve()}
    while waiting and len(seen) < _MAX_FILES:
        path = waiting.pop(0)
        if not os.path.isfile(path):  # A pipe would be read for ever.
            continue
        sources.files.append(packages.real(path))
        for included in _read_declarations(path, packages, sources):
            if included.resolve() not in seen:
                seen.add(included.resolve())
                waiting.append(included)
    return sources


def missing_packages(entry: Path, packages: PackageFinder) -> dict[str, list[str]]:
    """Return the places that refer to a package that isn't found, by its name."""
    missing: dict[str, list[str]] = {}
    for path in read_sources(entry, packages).files:
        text = _text(path)
        for match in (*_FIND.finditer(text), *_PACKAGE_URI.finditer(text)):
            if _folder(match[1], packages) is None:
                places, place = missing.setdefault(match[1], []), _place(path, match)
                places += [place] * (place not in places)
    return missing


def _read_declarations(
    path: Path, packages: PackageFinder, sources: XacroSources
) -> list[Path]:
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


def _open_regular(path: Path) -> Any:
    """Open a file; refuse a pipe or device, which would be read for ever."""
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return open(path, "rb")


# What an expansion may take: processor time [s], memory [bytes]. Robots take below a
# second and 100 MB.
CPU_TIME = 10
MEMORY = 2**30

# What the report tells of what xacro prints to its standard error.
SAID = "so says xacro"

# Lines of it that tell where the line before them comes from.
_WHERE = ("when ", "instantiated from: ", "in file: ", "included from: ")

_DECLARATION = re.compile(r"\s+<\?xml\b.*?\?>", re.DOTALL)

# More than any robot has: a file of this size is no description [bytes].
MAX_SIZE = 64 * 2**20


def _sayings(text: str) -> list[str]:
    """Return the messages of xacro, each with its lines of places."""
    found: list[list[str]] = []
    for line in text.splitlines():
        if found and line.startswith(_WHERE):
            found[-1].append(line.strip())
        elif line.strip():
            found.append([line.strip()])
    return [
        first + (f" ({', '.join(where)})" if where else "") for first, *where in found
    ]


def expand_xacro(
    path: Path,
    args: Mapping[str, str],
    packages: PackageFinder,
    report: LoadReport | None = None,
    *,
    files: set[Path] | None = None,
    places: Places | None = None,
) -> str:
    """Return the URDF text that a file stands for; a plain URDF is its own.

    That is one that speaks of xacro in comments alone, as what xacro writes does.
    Every file that is read is added to ``files``, also where the expansion fails;
    ``places`` learns where the elements of the text stand.
    """
    places = Places() if places is None else places
    files = set() if files is None else files
    files.add(path)
    text = _read(path)
    said = _COMMENT.sub("", text)
    if "xacro" not in said and "$(" not in said:
        _cancel_ahead()
        text = declare_prefixes(text)
        _check_unused(args, path, packages, report)
        places.text = text
        places.of_elements = [(path, line) for line in lines_of_elements(text)]
        return text
    answer = _run(path, args, packages)
    files.update(packages.real(Path(name)) for name in answer["opened"])
    if "error" in answer:
        raise _explain(answer, path, packages)
    if report is not None:
        for what in _sayings(answer["said"]):
            is_error = what.startswith("error: ")
            what = what.removeprefix("warning: ").removeprefix("error: ")
            severity: Severity = "error" if is_error else "info"
            report.add(severity, "ignored", what, SAID, file=path)
    _check_unused(answer["unused"], path, packages, report)
    real = [packages.real(Path(name)) for name in answer["place_files"]]
    places.text = answer["text"]
    places.of_elements = [
        each and (real[each[0]], each[1]) for each in answer["places"]
    ]
    return packages.real_paths(answer["text"])


class _Expansion:
    """An expansion by `xacro_process`."""

    def __init__(self, path: Path, arguments: Mapping[str, str]) -> None:
        """Start it."""
        # Modules lie where they lie for this process; of ours it needs one.
        folders = [os.path.abspath(folder) for folder in sys.path]
        folders.append(str(Path(__file__).parent))
        code = f"import sys; sys.path[:] = {folders!r}; "
        code += "import xacro_process as x; x.main()"
        self.path = path
        self.arguments = arguments
        self._process = subprocess.Popen(  # noqa: S603  It is our own program.
            [sys.executable, "-I", "-S", "-X", "utf8", "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            encoding="utf-8",
            errors="surrogateescape",
        )
        self._send(
            {
                "file": str(path),
                "arguments": self.arguments,
                "cpu_time": CPU_TIME,
                "memory": MEMORY,
                "size": MAX_SIZE,
            }
        )

    def finish(self, packages: PackageFinder) -> Any:
        """Return its answer; raise DescriptionError if it has none."""
        failed: PackageError | None = None
        with self._process as process:
            try:
                while line := process.stdout.readline() if process.stdout else "":
                    answer = json.loads(line)
                    if "find" not in answer:
                        return {**answer, "failed": failed}
                    folder = None
                    try:
                        folder = str(packages.find(answer["find"]))
                    except PackageError as error:
                        failed = error
                    self._send(folder)
            finally:
                self._end()
        is_late = process.returncode == -signal.SIGXCPU
        limit = f"takes more than {CPU_TIME} s of processor time"
        problem = limit if is_late else f"ended with code {process.returncode}"
        what = f"can't be expanded: xacro {problem}"
        raise DescriptionError(what, file=self.path)

    def _send(self, value: Any) -> None:
        """Send a line; one that has ended tells why by its code."""
        with contextlib.suppress(BrokenPipeError):
            assert self._process.stdin is not None
            print(json.dumps(value), file=self._process.stdin, flush=True)

    def cancel(self) -> None:
        """End it, for nobody wants its answer."""
        with self._process:
            self._end()

    def _end(self) -> None:
        self._process.kill()
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # Of what it didn't read any more.
            self._process.stdin.close()


# The one that was started ahead, if any.
_ahead: list[_Expansion] = []


@contextlib.contextmanager
def expanding_ahead(path: Path, args: Mapping[str, str]) -> Iterator[None]:
    """Start an expansion that `expand_xacro` will finish, called with the same.

    It has a process of its own, beside which this one can import what it needs. At the
    end of the block it is ended if nothing was expanded.
    """
    if path.suffix == ".xacro":
        _ahead.append(_Expansion(path, args))
    try:
        yield
    finally:
        _cancel_ahead()


def _cancel_ahead() -> None:
    """End what was started ahead, if it is still there."""
    while _ahead:
        _ahead.pop().cancel()


def _run(path: Path, args: Mapping[str, str], packages: PackageFinder) -> Any:
    """Return the answer of `xacro_process` about a file."""
    arguments = {name: str(value) for name, value in args.items()}
    try:
        expansion = _ahead.pop()
    except IndexError:
        return _Expansion(path, arguments).finish(packages)
    if (expansion.path, expansion.arguments) != (path, arguments):
        expansion.cancel()
        expansion = _Expansion(path, arguments)
    return expansion.finish(packages)


def _check_unused(
    unused: Collection[str],
    path: Path,
    packages: PackageFinder,
    report: LoadReport | None,
) -> None:
    """Report arguments that are set but unused.

    Launch files pass such arguments on, to files of which some have them, and xacro
    takes no notice.
    """
    if not unused or report is None:
        return
    declared = read_sources(path, packages).arguments
    for name in sorted(unused):
        problem = f"no xacro argument {name!r}; {suggest(name, declared)}"
        report.add("warning", "ignored", problem, "it has no effect", file=path)


def _read(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_SIZE:
            problem = f"{size / 2**20:.0f} MB; a description has at most 64 MB"
            raise DescriptionError(problem, file=path)
        with _open_regular(path) as file:
            content: bytes = file.read()
    except OSError as error:
        reason = error.strerror or str(error)
        raise DescriptionError(f"can't be read: {reason}", file=path) from None
    # UTF-16 has null bytes, and a mark that says so.
    is_wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in content and not is_wide:
        raise DescriptionError("is no text; expected a URDF or xacro file", file=path)
    try:
        text = content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    # Nothing may stand before an XML declaration, and something often does; without
    # it the lines stay what they are.
    found = _DECLARATION.match(text)
    return text if found is None else "\n" * found[0].count("\n") + text[found.end() :]


def _explain(
    answer: Mapping[str, Any], path: Path, packages: PackageFinder
) -> ArmDrakeError:
    """Return a xacro error in our words, with its place and what led to it."""
    error = answer["error"]
    chain = [str(packages.real(Path(file))) for file in answer["files"]]
    file, line = Path(chain[-1]) if chain else path, None
    if answer.get("place") and error["kind"] != "xml":
        name, line = answer["place"]
        file = packages.real(Path(name))
    match error["kind"]:
        case "package":
            return _list_missing(answer["failed"], path, packages)
        case "recursion":
            problem = _explain_recursion(chain, answer["macros"])
            return DescriptionError(problem, file=file)
        case "xml":
            line, reason = error["line"], error["reason"]
            problem = explain_malformed(_read(file), reason, line)
            return DescriptionError(problem, file=file, line=line)
        case "memory":
            limit = f"{MEMORY // 2**20} MB of memory"
            problem = f"can't be expanded: xacro needs more than {limit}"
            return DescriptionError(problem, file=file)
        case "size":
            limit = f"{MAX_SIZE // 2**20} MB; a description has at most so much"
            return DescriptionError(f"expands to more than {limit}", file=path)
        case "file":
            missing = read_sources(path, packages).missing_files
            if error["is_missing"] and len(missing) > 1:
                problem = f"{len(missing)} files don't exist: {_with_places(missing)}"
            else:
                name = str(packages.real(Path(error["name"])))
                problem = f"{name!r} can't be read: {error['reason']}"
                if error["is_missing"]:
                    problem += suggest_file(Path(name))
        case "argument":
            problem = _explain_argument(error["name"], path, packages)
        case _:
            problem = error["text"]
            if "name" in error:
                problem += f"; {suggest(error['name'], error['known'])}"
    if answer.get("calls"):
        problem += f" ({_list_calls(answer['calls'], packages)})"
    elif len(chain) > 1 and str(file) == chain[-1]:
        problem += f" (included by {' -> '.join(chain[:-1])})"
    return DescriptionError(problem, file=file, line=line)


def _list_calls(calls: list[Any], packages: PackageFinder) -> str:
    """Return where the macros were called in which an error came up."""
    return ", ".join(
        f"in macro {name!r}, called at {packages.real(Path(place[0]))}:{place[1]}"
        for name, place in reversed(calls)
    )


def _explain_argument(name: str, path: Path, packages: PackageFinder) -> str:
    sources = read_sources(path, packages)
    declared = sources.arguments
    listed = ", ".join(
        other if default is None else f"{other}:={default}"
        for other, default in sorted(declared.items())
    )
    state = "used before it is declared" if name in declared else "undefined"
    values = _find_values(name, sources, packages)
    known = f" (the files know {', '.join(values)})" if values else ""
    return (
        f"xacro argument {name!r} is {state}; "
        f"give it as {name}:=VALUE{known}; the file declares: {listed or 'none'}"
    )


def _find_values(
    name: str, sources: XacroSources, packages: PackageFinder
) -> list[str]:
    """Return values that an argument has in files' conditions and in files' names."""
    # As a property it mostly has the same name.
    argument = rf"\$\(arg\s+{re.escape(name)}\s*\)"
    one = rf"(?:\b{re.escape(name)}\b|['\"]?{argument}['\"]?)"
    texts = {file: _text(file) for file in sources.files}
    values: set[str] = set()
    for text in texts.values():
        for match in re.finditer(rf"{one}\s*[!=]=\s*(['\"])(.*?)\1", text):
            values.add(match[2])
        for match in re.finditer(rf"{one}\s+(?:not\s+)?in\s*[\[(](.*?)[\])]", text):
            values.update(re.findall(r"['\"](.*?)['\"]", match[1]))
    for file, text in texts.items():
        for match in re.finditer(rf"\"([^\"]*){argument}([^\"$]*\.\w+)\"", text):
            start = _FIND.sub(lambda m: str(_folder(m[1], packages) or m[0]), match[1])
            if "$" not in start:
                start = os.path.join(file.parent, start)
                files = glob.glob(f"{glob.escape(start)}*{glob.escape(match[2])}")
                values |= {path[len(start) : -len(match[2])] for path in files}
    return sorted(values - {""})


def _list_missing(
    error: PackageError, path: Path, packages: PackageFinder
) -> PackageError:
    """Return an error that names every missing package, and what refers to it."""
    missing = missing_packages(path, packages)
    if not missing:
        return error
    if len(missing) == 1:
        text = f"package {_with_places(missing)} not found; name the folder that holds"
        rest = error.problem.partition(" holds")[2]
        return PackageError(text + rest, file=path)
    return PackageError(
        f"{len(missing)} packages not found: {_with_places(missing)}; name the folders "
        "that hold them with package_paths (--package-path)",
        file=path,
    )


def _explain_recursion(files: list[str], macros: list[str]) -> str:
    for index, file in enumerate(files):
        if file in files[:index]:
            circle = files[files.index(file) : index + 1]
            return f"includes itself: {' -> '.join(circle)}"
    calls = f"; macros that call each other: {macros}" if macros else ""
    return f"nested too deeply{calls}"


def _with_places(missing: Mapping[str, list[str]]) -> str:
    return ", ".join(
        f"{name!r} (asked for by {', '.join(places[:3])}"
        + (f" and {len(places) - 3} more)" if len(places) > 3 else ")")
        for name, places in missing.items()
    )
