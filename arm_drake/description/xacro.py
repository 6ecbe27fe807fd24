"""Expand xacro files with the `xacro` package, without a ROS installation.

xacro keeps its arguments and its stacks of files in module globals and asks
`ament_index_python` for packages. Both are replaced for the time of one expansion, so
that nothing leaks from one load into the next.
"""

import contextlib
import os
import re
import threading
import xml.parsers.expat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import xacro
from xacro import substitution_args

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import ArmDrakeError, DescriptionError, suggest

# xacro's globals serve one expansion at a time.
_LOCK = threading.RLock()

_ARGUMENT = re.compile(r"<xacro:arg\s([^>]*)>")
_ATTRIBUTE = re.compile(r"(\w+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")


def expand_xacro(
    path: Path,
    args: Mapping[str, str],
    packages: PackageFinder,
    report: LoadReport | None = None,
) -> str:
    """Return the URDF text that a file stands for.

    Args:
        path: A xacro file, or a plain URDF, which is returned as it is.
        args: Values of xacro arguments.
        packages: What resolves `$(find <package>)`.
        report: Where arguments that no file asks for are recorded.

    Raises:
        DescriptionError: If the file can't be read or expanded.
        PackageError: If a package isn't found.
    """
    text = _read(path)
    values = _Arguments({name: str(value) for name, value in args.items()})
    if "xacro" not in text and "$(" not in text:
        _check_unused(values, path, text, report)
        return text
    with _LOCK, _package_lookup(packages.find):
        try:
            document = xacro.process_file(str(path), mappings=values, verbosity=0)
        except xacro.XacroException as error:
            raise _explain(error, path, text) from None
        except xml.parsers.expat.ExpatError as error:
            reason = xml.parsers.expat.errors.messages[error.code]
            raise DescriptionError(
                f"malformed XML: {reason}", file=_current_file(path), line=error.lineno
            ) from None
        # xacro evaluates what a file says, and answers a bad one with any exception.
        except Exception as error:
            problem = f"xacro: {type(error).__name__}: {error}"
            raise DescriptionError(problem, file=_current_file(path)) from None
        finally:
            xacro.substitution_args_context["arg"] = {}
    _check_unused(values, path, text, report)
    return str(document.toxml())


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
    values: _Arguments, path: Path, text: str, report: LoadReport | None
) -> None:
    """Say if a value was given that nothing asks for.

    Launch files pass such arguments on, so it is no error where files include others.
    """
    for name in sorted(values.unused):
        problem = f"no xacro argument {name!r}; "
        problem += suggest(name, declared_arguments(text))
        if "xacro:include" not in text:
            raise DescriptionError(problem, file=path)
        if report is not None:
            report.add("warning", "ignored", problem, "it has no effect", file=path)


def declared_arguments(text: str) -> dict[str, str | None]:
    """Return the arguments that a xacro text declares, with their defaults."""
    declared = {}
    for match in _ARGUMENT.finditer(text):
        pairs = _ATTRIBUTE.findall(match.group(1))
        attributes = {name: double or single for name, double, single in pairs}
        if "name" in attributes:
            declared[attributes["name"]] = attributes.get("default")
    return declared


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return path.read_text(encoding="latin-1")
    except OSError as error:
        reason = error.strerror or str(error)
        raise DescriptionError(f"can't be read: {reason}", file=path) from None


@contextlib.contextmanager
def _package_lookup(find: Callable[[str], Path]) -> Iterator[None]:
    """Let `$(find ...)` ask ``find``, in both places where xacro keeps the lookup."""

    def eval_find(name: str) -> str:
        return str(find(name))

    saved = substitution_args._eval_find, substitution_args._eval_dict["find"]
    substitution_args._eval_find = eval_find
    substitution_args._eval_dict["find"] = eval_find
    try:
        yield
    finally:
        substitution_args._eval_find, substitution_args._eval_dict["find"] = saved


def _explain(error: Exception, path: Path, text: str) -> ArmDrakeError:
    """Return a xacro error in our words, with the chain of files that led to it."""
    cause: object = error
    while isinstance(cause, xacro.XacroException) and cause.exc is not None:
        cause = cause.exc
    if isinstance(cause, ArmDrakeError):
        return cause
    problem = " ".join(str(error).split())
    if problem.startswith("<class "):  # xacro says the same twice.
        problem = " ".join(str(cause).split())
    if isinstance(cause, OSError):
        problem = f"{cause.filename!r} can't be read: {cause.strerror}"
    if isinstance(cause, substitution_args.ArgException):
        declared = declared_arguments(text)
        listed = ", ".join(
            name if default is None else f"{name}:={default}"
            for name, default in sorted(declared.items())
        )
        is_late = str(cause) in declared
        state = "used before it is declared" if is_late else "undefined"
        problem = (
            f"xacro argument {str(cause)!r} is {state}; "
            f"give it as {cause}:=VALUE; the file declares: {listed or 'none'}"
        )
    chain = [os.fspath(file) for file in xacro.filestack or [] if file]
    if len(chain) > 1:
        problem += f" (included by {' -> '.join(chain[:-1])})"
    return DescriptionError(problem, file=_current_file(path))


def _current_file(path: Path) -> Path:
    """Return the file that xacro was reading."""
    files = [file for file in xacro.filestack or [] if file]
    return Path(files[-1]) if files else path
