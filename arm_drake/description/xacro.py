"""Expansion of xacro files with the `xacro` package, without a ROS installation.

xacro keeps its arguments and its stacks of files in module globals and asks
`ament_index_python` for packages. Both are replaced for the time of one expansion, so
that nothing leaks from one load into the next.

So is the evaluation of expressions, for a description must not run programs. xacro
looks for names with two underscores in the outermost code alone, and `$(eval)` has all
of Python's functions. Here the whole expression is searched, and what can reach such
names by other ways is replaced: `vars`, `type`, `str.format`.

xacro stops at the first thing that is missing. To list everything in one message, the
files that can be reached are read without expanding them, too.
"""

import ast
import builtins
import contextlib
import dataclasses as dc
import errno
import functools
import io
import os
import re
import string
import threading
import types
import xml.parsers.expat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import xacro
from xacro import substitution_args

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import ArmDrakeError, DescriptionError, PackageError, suggest

# Attributes of frames, generators and code, which lead to everything else.
_INNER = {
    name
    for kind in (
        types.AsyncGeneratorType,
        types.CodeType,
        types.CoroutineType,
        types.FrameType,
        types.GeneratorType,
        types.TracebackType,
    )
    for name in dir(kind)
    if re.match("(ag|co|cr|f|gi|tb)_", name)
} | {"mro"}

# What `$(eval ...)` may call.
_FUNCTIONS = [
    "abs",
    "all",
    "any",
    "bool",
    "complex",
    "dict",
    "divmod",
    "enumerate",
    "filter",
    "float",
    "frozenset",
    "int",
    "isinstance",
    "len",
    "list",
    "map",
    "max",
    "min",
    "ord",
    "range",
    "repr",
    "reversed",
    "round",
    "set",
    "sorted",
    "str",
    "sum",
    "tuple",
    "zip",
]

# Larger numbers [bits] and longer texts and lists are a mistake, or meant to last.
_MAX_BITS = 100_000
_MAX_LENGTH = 10_000_000


def eval_expression(
    expression: str,
    symbols: dict[str, Any],
    local_symbols: Mapping[str, Any] | None = None,
) -> Any:
    """Return what `${expression}` stands for; takes the place of `xacro.safe_eval`."""
    code = _compile(expression)
    symbols.update(__builtins__=dict(_HELPERS))
    return eval(code, symbols, local_symbols)  # noqa: S307 What it reaches is checked.


def eval_argument(
    expression: str, symbols: dict[str, Any], local_symbols: Mapping[str, Any]
) -> Any:
    """Return what `$(eval expression)` stands for; takes the place of `eval`."""
    functions = {name: getattr(builtins, name) for name in _FUNCTIONS}
    symbols.update(__builtins__=functions | _HELPERS)
    return eval(_compile(expression), symbols, local_symbols)  # noqa: S307


def make_symbols() -> dict[str, Any]:
    """Return what the names in `${}` stand for at first, as xacro defines it."""
    symbols: dict[str, Any] = xacro.create_global_symbols()
    # What it returns holds names with underscores.
    del symbols["python"]["vars"]
    # With more arguments it makes classes.
    symbols["python"]["type"] = lambda value: type(value)
    return symbols


def open_regular(path: str | Path, mode: str = "r") -> Any:
    """Open a file; refuse a pipe or device, which would be read for ever."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return open(path, mode)


@contextlib.contextmanager
def replaced(names: dict[str, Any], **values: Any) -> Iterator[None]:
    """Give names other values for a while."""
    saved = {name: names[name] for name in values if name in names}
    names.update(values)
    try:
        yield
    finally:
        for name in values:
            del names[name]
        names.update(saved)


# A macro's expressions are the same at every call.
@functools.lru_cache(maxsize=1000)
def _compile(expression: str) -> types.CodeType:
    tree = ast.parse(expression.strip(), "<expression>", "eval")
    names = dict.fromkeys(name for node in ast.walk(tree) for name in _names(node))
    if refused := [name for name in names if name.startswith("__")]:
        raise xacro.XacroException("Use of invalid name(s): ", ", ".join(refused))
    attributes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    for node in attributes:
        # One that is stored is the target of a comprehension.
        if _is_inner(node.attr) or isinstance(node.ctx, ast.Store):
            raise xacro.XacroException("Use of invalid name(s): ", node.attr)
    tree = ast.fix_missing_locations(_Guard().visit(tree))
    code: types.CodeType = compile(tree, "<expression>", "eval")
    return code


def _names(node: ast.AST) -> list[str]:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
            return [name]
    return []


def _is_inner(name: str) -> bool:
    return name.startswith("__") or name in _INNER


class _Guard(ast.NodeTransformer):
    """Lets helpers do what may lead out of an expression, or never end."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        helpers = {ast.Pow: "__pow", ast.Mult: "__mul", ast.LShift: "__lshift"}
        name = helpers.get(type(node.op))
        if name is None:
            return node
        return ast.copy_location(_call(name, node.left, node.right), node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        if node.attr not in ("format", "format_map"):
            return node
        call = _call("__format", node.value, ast.Constant(node.attr))
        return ast.copy_location(call, node)


def _call(helper: str, *arguments: ast.expr) -> ast.Call:
    return ast.Call(ast.Name(helper, ast.Load()), list(arguments), [])


class _Formatter(string.Formatter):
    """Formats texts without names that an expression may not have."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> Any:
        if any(map(_is_inner, re.split(r"[.\[\]]", field_name))):
            raise xacro.XacroException("Use of invalid name(s): ", field_name)
        return super().get_field(field_name, args, kwargs)


def _format(owner: Any, name: str) -> Any:
    """Return the `format` or `format_map` of a value."""
    formatter = _Formatter()
    # As in `map(str.format, texts)`.
    if isinstance(owner, type) and issubclass(owner, str):
        return lambda text, *args, **kwargs: _format(text, name)(*args, **kwargs)
    if not isinstance(owner, str):
        return getattr(owner, name)
    if name == "format_map":
        return lambda mapping: formatter.vformat(owner, (), mapping)
    return lambda *args, **kwargs: formatter.format(owner, *args, **kwargs)


def _pow(base: Any, exponent: Any) -> Any:
    if isinstance(base, int) and isinstance(exponent, int) and abs(base) > 1:
        _check_bits(base.bit_length() * exponent)
    return base**exponent


def _lshift(value: Any, shift: Any) -> Any:
    if isinstance(value, int) and isinstance(shift, int):
        _check_bits(value.bit_length() + shift)
    return value << shift


def _mul(left: Any, right: Any) -> Any:
    if isinstance(left, int) and isinstance(right, int):
        _check_bits(left.bit_length() + right.bit_length())
    for value, times in ((left, right), (right, left)):
        is_repeated = isinstance(value, str | bytes | list | tuple)
        if is_repeated and isinstance(times, int) and len(value) * times > _MAX_LENGTH:
            raise ValueError(f"more than {_MAX_LENGTH} items or characters")
    return left * right


def _check_bits(number: int) -> None:
    if number > _MAX_BITS:
        raise OverflowError(f"a number of more than {_MAX_BITS} bits")


_HELPERS: dict[str, Callable[..., Any]] = {
    "__format": _format,
    "__lshift": _lshift,
    "__mul": _mul,
    "__pow": _pow,
}


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
    """Return the places that ask for a package that isn't found, by its name."""
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
    """Return the URDF text that a file stands for; a plain URDF is its own.

    Every file that is read is added to ``files``, also where the expansion fails.
    """
    files = set() if files is None else files
    files.add(path)
    text = _read(path)
    values = _Arguments({name: str(value) for name, value in args.items()})
    if "xacro" not in text and "$(" not in text:
        _check_unused(values, path, text, packages, report)
        return text
    stderr, opened = io.StringIO(), set[str]()
    with _LOCK, _our_own(packages.find, opened), contextlib.redirect_stderr(stderr):
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
        for line in stderr.getvalue().splitlines():
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
    """Let xacro use what is ours: the lookup of packages, `eval` and `open`."""

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
