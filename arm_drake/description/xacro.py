"""Expand xacro files with the `xacro` package, without a ROS installation.

xacro keeps its arguments and its stacks of files in module globals and asks
`ament_index_python` for packages. Both are replaced for the time of one expansion, so
that nothing leaks from one load into the next. So is the evaluation of expressions, for
a description must not run programs.
"""

import contextlib
import io
import os
import threading
import xml.parsers.expat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import xacro
from xacro import substitution_args

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.xacro_evaluation import (
    eval_argument,
    eval_expression,
    make_symbols,
    open_regular,
    replaced,
)
from arm_drake.description.xacro_sources import missing_packages, read_sources
from arm_drake.errors import ArmDrakeError, DescriptionError, PackageError, suggest

# xacro's globals serve one expansion at a time.
_LOCK = threading.RLock()

# More than any robot has: a file of this size is no description [bytes].
MAX_SIZE = 64 * 2**20


def expand_xacro(
    path: Path,
    args: Mapping[str, str],
    packages: PackageFinder,
    report: LoadReport | None = None,
    *,
    files: set[Path] | None = None,
) -> str:
    """Return the URDF text that a file stands for.

    Args:
        path: A xacro file, or a plain URDF, which is returned as it is.
        args: Values of xacro arguments.
        packages: What resolves `$(find <package>)`.
        report: Where arguments that no file asks for are recorded.
        files: Where every file that is read is added, YAML too; if the expansion fails,
            also what it couldn't read.

    Raises:
        DescriptionError: If the file can't be read or expanded.
        PackageError: If a package isn't found.
    """
    files = set() if files is None else files
    files.add(path)
    text = _read(path)
    values = _Arguments({name: str(value) for name, value in args.items()})
    if "xacro" not in text and "$(" not in text:
        _check_unused(values, path, text, packages, report)
        return text
    said, opened = io.StringIO(), set[str]()
    with _LOCK, _our_own(packages.find, opened), contextlib.redirect_stderr(said):
        try:
            document = xacro.process_file(str(path), mappings=values, verbosity=0)
        except xacro.XacroException as error:
            raise _explain(error, path, packages) from None
        except xml.parsers.expat.ExpatError as error:
            reason = xml.parsers.expat.errors.messages[error.code]
            raise DescriptionError(
                f"malformed XML: {reason}",
                file=_current_file(path, packages),
                line=error.lineno,
            ) from None
        # xacro evaluates what a file says, and answers a bad one with any exception.
        except Exception as error:
            problem = f"xacro: {type(error).__name__}: {error}"
            if isinstance(error, RecursionError):
                problem = _explain_recursion(packages)
            raise DescriptionError(
                problem, file=_current_file(path, packages)
            ) from None
        finally:
            xacro.substitution_args_context["arg"] = {}
            files.update(packages.real(Path(name)) for name in opened)
    if report is not None:
        for line in said.getvalue().splitlines():
            what = line.strip().removeprefix("warning: ")
            report.add("info", "ignored", what, "so says xacro", file=path)
    _check_unused(values, path, text, packages, report)
    return packages.real_paths(str(document.toxml()))


class _Arguments(dict[str, str]):
    """Values of xacro arguments, which remember whether anything asked for them."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.unused = set(values)

    def __contains__(self, name: object) -> bool:
        self.unused.discard(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.unused.discard(name)
        return super().__getitem__(name)


def _check_unused(
    values: _Arguments,
    path: Path,
    text: str,
    packages: PackageFinder,
    report: LoadReport | None,
) -> None:
    """Say if a value was given that nothing asks for.

    Launch files pass such arguments on, so it is no error where files include others.
    """
    if not values.unused:
        return
    declared = read_sources(path, packages).arguments
    for name in sorted(values.unused):
        problem = f"no xacro argument {name!r}; {suggest(name, declared)}"
        if "xacro:include" not in text:
            raise DescriptionError(problem, file=path)
        if report is not None:
            report.add("warning", "ignored", problem, "it has no effect", file=path)


def _read(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > MAX_SIZE:
            problem = f"{size / 2**20:.0f} MB; a description has at most 64 MB"
            raise DescriptionError(problem, file=path)
        with open_regular(path, "rb") as file:
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
    # Nothing may stand before an XML declaration, and something often does.
    return text.lstrip() if text.lstrip().startswith("<?xml") else text


@contextlib.contextmanager
def _our_own(find: Callable[[str], Path], opened: set[str]) -> Iterator[None]:
    """Let xacro use what is ours: the lookup of packages, `eval` and `open`.

    Args:
        find: Finds a package.
        opened: Where the names of files are added that xacro opens.
    """

    def eval_find(name: str) -> str:
        return str(find(name))

    def open_noted(path: str | Path, mode: str = "r") -> Any:
        opened.add(str(path))
        return open_regular(path, mode)

    with (
        replaced(vars(substitution_args), _eval_find=eval_find, eval=eval_argument),
        replaced(substitution_args._eval_dict, find=eval_find),
        replaced(vars(xacro), safe_eval=eval_expression, open=open_noted),
        replaced(vars(xacro), _global_symbols=make_symbols()),
    ):
        yield


def _explain(error: Exception, path: Path, packages: PackageFinder) -> ArmDrakeError:
    """Return a xacro error in our words, with the chain of files that led to it."""
    cause: object = error
    while isinstance(cause, xacro.XacroException) and cause.exc is not None:
        cause = cause.exc
    if isinstance(cause, PackageError):
        return _list_missing(cause, path, packages)
    if isinstance(cause, ArmDrakeError):
        return cause
    if isinstance(cause, RecursionError):
        problem = _explain_recursion(packages)
        return DescriptionError(problem, file=_current_file(path, packages))
    problem = " ".join(str(error).split())
    if problem.startswith("<class "):  # xacro says the same twice.
        problem = " ".join(str(cause).split())
    if isinstance(cause, OSError):
        missing = read_sources(path, packages).missing_files
        if isinstance(cause, FileNotFoundError) and len(missing) > 1:
            problem = f"{len(missing)} files don't exist: {_with_places(missing)}"
        else:
            name = str(packages.real(Path(os.fsdecode(cause.filename or ""))))
            problem = f"{name!r} can't be read: {cause.strerror}"
    if isinstance(cause, substitution_args.ArgException):
        problem = _explain_argument(str(cause), read_sources(path, packages).arguments)
    chain = [str(packages.real(Path(file))) for file in xacro.filestack or [] if file]
    if len(chain) > 1:
        problem += f" (included by {' -> '.join(chain[:-1])})"
    return DescriptionError(problem, file=_current_file(path, packages))


def _explain_argument(name: str, declared: Mapping[str, str | None]) -> str:
    listed = ", ".join(
        other if default is None else f"{other}:={default}"
        for other, default in sorted(declared.items())
    )
    state = "used before it is declared" if name in declared else "undefined"
    return (
        f"xacro argument {name!r} is {state}; "
        f"give it as {name}:=VALUE; the file declares: {listed or 'none'}"
    )


def _list_missing(
    error: PackageError, path: Path, packages: PackageFinder
) -> PackageError:
    """Return an error that names every package that is missing, and who asked."""
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


def _explain_recursion(packages: PackageFinder) -> str:
    files = [str(packages.real(Path(file))) for file in xacro.filestack or [] if file]
    for index, file in enumerate(files):
        if file in files[:index]:
            circle = files[files.index(file) : index + 1]
            return f"includes itself: {' -> '.join(circle)}"
    macros = {macro.body.getAttribute("name") for macro in xacro.macrostack or []}
    calls = f"; macros that call each other: {sorted(macros)}" if macros else ""
    return f"nested too deeply{calls}"


def _with_places(missing: Mapping[str, list[str]]) -> str:
    return ", ".join(
        f"{name!r} (asked for by {', '.join(places[:3])}"
        + (f" and {len(places) - 3} more)" if len(places) > 3 else ")")
        for name, places in missing.items()
    )


def _current_file(path: Path, packages: PackageFinder) -> Path:
    """Return the file that xacro was reading."""
    files = [file for file in xacro.filestack or [] if file]
    return packages.real(Path(files[-1])) if files else path
