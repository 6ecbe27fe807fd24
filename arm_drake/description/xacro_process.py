"""Program that expands one xacro file, with limits of memory and processor time.

`xacro.expand_xacro` runs it in a process of its own, for what a description can have
evaluated has no other bound: a format of 2 GB, a factorial, macros that double. It
reads one request from standard input as a line of JSON, asks for packages, and ends
with the expanded text or with what is wrong.

A description must not run programs either. xacro looks for names with two underscores
in the outermost code alone, and `$(eval)` has all of Python's functions. Here the whole
expression is searched, and what can reach such names by other ways is replaced: `vars`,
`type`, `str.format`.
"""

import ast
import builtins
import contextlib
import errno
import functools
import importlib
import io
import json
import os
import re
import resource
import string
import sys
import types
import xml.dom.minidom
import xml.parsers.expat
from collections.abc import Callable, Mapping
from typing import Any, TextIO
from xml.dom.expatbuilder import ExpatBuilderNS


class _Postponed(types.ModuleType):
    """A module that is imported when it is first used."""

    def __getattr__(self, name: str) -> Any:
        del sys.modules[self.__name__]
        vars(self).update(vars(importlib.import_module(self.__name__)))
        return vars(self)[name]


# xacro seldom needs it, and to import it takes longer than to expand a robot.
sys.modules["yaml"] = _Postponed("yaml")
# Its command line, which imports a parser of options, isn't used here.
sys.modules["xacro.cli"] = types.ModuleType("xacro.cli")
vars(sys.modules["xacro.cli"]).update(process_args=None)

import xacro  # noqa: E402
from xacro import substitution_args  # noqa: E402

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


def _make_symbols() -> dict[str, Any]:
    """Return what the names in `${}` stand for at first, as xacro defines it."""
    symbols: dict[str, Any] = xacro.create_global_symbols()
    # What it returns holds names with underscores.
    del symbols["python"]["vars"]
    # With more arguments it makes classes.
    symbols["python"]["type"] = lambda value: type(value)
    return symbols


def _open_regular(path: str | os.PathLike[str], mode: str = "r") -> Any:
    """Open a file; refuse a pipe or device, which would be read for ever."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return open(path, mode)


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
    """Lets a helper do what may lead out of an expression."""

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


_HELPERS: dict[str, Callable[..., Any]] = {"__format": _format}


class _PackageNotFoundError(Exception):
    """A package that the other side doesn't find; it knows why."""


class _Place:
    """Place of a node of a document; the copies that macros make keep it."""

    def __init__(self, file: str, line: int) -> None:
        self.file = file
        self.line = line

    def attach_to(self, node: Any) -> None:
        node.setUserData("place", self, self)

    def handle(self, *arguments: Any) -> None:
        """Put it on the copy of a node, the last argument, as the DOM's handlers do."""
        self.attach_to(arguments[-1])


class _Builder(ExpatBuilderNS):
    """Builds a document whose nodes know their places."""

    _parser: Any
    curNode: Any

    def __init__(self, file: str) -> None:
        super().__init__()
        self._file = file

    def start_element_handler(self, name: str, attributes: Any) -> None:
        super().start_element_handler(name, attributes)
        _Place(self._file, self._parser.CurrentLineNumber).attach_to(self.curNode)

    def character_data_handler_cdata(self, data: str) -> None:
        super().character_data_handler_cdata(data)
        if "$" in data:  # Texts come when they end.
            rest = data.count("\n", data.index("$"))
            place = _Place(self._file, self._parser.CurrentLineNumber - rest)
            place.attach_to(self.curNode.lastChild)


class _Other:
    """The parent process."""

    def __init__(self, incoming: TextIO, outgoing: TextIO) -> None:
        self._incoming = incoming
        self._outgoing = outgoing

    def read(self) -> Any:
        return json.loads(self._incoming.readline())

    def send(self, **values: Any) -> None:
        print(json.dumps(values), file=self._outgoing, flush=True)

    def find(self, name: str) -> str:
        """Return the folder of a package."""
        self.send(find=name)
        folder = self.read()
        if folder is None:
            raise _PackageNotFoundError
        return str(folder)


def main() -> None:
    """Expand the file that standard input names, and print the result."""
    # Nothing that xacro prints may come between what is told.
    other, said = _Other(sys.stdin, sys.stdout), io.StringIO()
    request = other.read()
    for kind, limit in (
        (resource.RLIMIT_AS, request["memory"]),
        (resource.RLIMIT_CPU, request["cpu_time"]),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        # Not every system has each.
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (least, hard))
    values = _Arguments(request["arguments"])
    opened: list[str] = []
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        answer = _expand(request["file"], values, other, opened)
    if len(answer.get("text", "")) > request["size"]:
        answer = {"error": {"kind": "size"}, "files": []}
    unused = sorted(values.unused)
    other.send(**answer, opened=opened, unused=unused, said=said.getvalue())


class _Arguments(dict[str, str]):
    """Values of xacro arguments, which remember whether anything used them."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.unused = set(values)

    def __contains__(self, name: object) -> bool:
        self.unused.discard(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.unused.discard(name)
        return super().__getitem__(name)


def _expand(
    path: str, values: _Arguments, other: _Other, opened: list[str]
) -> dict[str, Any]:
    def open_noted(name: str | os.PathLike[str], mode: str = "r") -> Any:
        opened.append(str(name))
        return _open_regular(name, mode)

    vars(substitution_args).update(_eval_find=other.find, eval=eval_argument)
    substitution_args._eval_dict["find"] = other.find
    vars(xacro).update(safe_eval=eval_expression, open=open_noted)
    vars(xml.dom.minidom).update(parse=lambda file: _Builder(file.name).parseFile(file))
    vars(xacro).update(_global_symbols=_make_symbols())
    try:
        document = xacro.process_file(path, mappings=values, verbosity=0)
        return {"text": str(document.toxml()), **_places_of_elements(document)}
    # xacro evaluates what a file says, and answers a bad one with any exception.
    except Exception as error:
        return {
            "error": _explain(error),
            "files": [file for file in xacro.filestack or [] if file],
            "macros": sorted({_name(macro) for macro in xacro.macrostack or []}),
            **_locate(error),
        }


def _places_of_elements(document: xml.dom.minidom.Document) -> dict[str, Any]:
    """Return file and line of each element, in order, each file only once."""
    numbers: dict[str, int] = {}
    places: list[tuple[int, int] | None] = []
    for element in document.getElementsByTagName("*"):
        place = _place(element)
        if place is None:
            places.append(None)
        else:
            file, line = place
            places.append((numbers.setdefault(file, len(numbers)), line))
    return {"place_files": list(numbers), "places": places}


def _name(macro: Any) -> str:
    return str(macro.body.getAttribute("name"))


def _frames(error: BaseException) -> list[types.FrameType]:
    """Return the calls in which an error came up, the innermost last."""
    frames, step = [], error.__traceback__
    while step is not None:
        frames.append(step.tb_frame)
        step = step.tb_next
    return frames


def _locate(error: Exception) -> dict[str, Any]:
    """Return where the node is at which xacro stopped, and where macros were called."""
    nodes, calls = [], []
    frames = [each for each in _frames(error) if each.f_globals is vars(xacro)]
    for frame, inner in zip(frames, [*frames[1:], None], strict=True):
        known = frame.f_locals
        node = known.get("node") or known.get("elt")
        if not isinstance(node, xml.dom.minidom.Node):
            continue
        nodes.append(node)
        # It evaluates the body of a macro, and not what stands in the call.
        if (
            inner is not None
            and frame.f_code is xacro.handle_macro_call.__code__
            and inner.f_locals.get("macros") is known.get("scoped_macros")
        ):
            calls.append([_name(known["m"]), _place(node)])
    return {"place": _place(nodes[-1]) if nodes else None, "calls": calls}


def _place(node: xml.dom.minidom.Node | None) -> tuple[str, int] | None:
    """Return file and line of a node, or of the nearest that it is in."""
    while node is not None:
        place = node.getUserData("place")
        if place is not None:
            return place.file, place.line
        node = node.parentNode
    return None


def _explain(error: Exception) -> dict[str, Any]:
    """Return what kind of error it is, and what the message needs to say."""
    cause: Any = error
    while isinstance(cause, xacro.XacroException) and cause.exc is not None:
        cause = cause.exc
    match cause:
        case _PackageNotFoundError():
            return {"kind": "package"}
        case RecursionError():
            return {"kind": "recursion"}
        case MemoryError() if not str(cause):
            return {"kind": "memory"}
        case xml.parsers.expat.ExpatError() if cause is error:
            reason = xml.parsers.expat.errors.messages[cause.code]
            return {"kind": "xml", "reason": reason, "line": cause.lineno}
    match cause:
        case OSError() if isinstance(error, xacro.XacroException):
            name, is_missing = cause.filename, isinstance(cause, FileNotFoundError)
            details = {"name": os.fsdecode(name or ""), "is_missing": is_missing}
            return {"kind": "file", "reason": cause.strerror, **details}
        case substitution_args.ArgException():
            return {"kind": "argument", "name": str(cause)}
    return {"kind": "other", **_describe(error, cause)}


def _describe(error: Exception, cause: Any) -> dict[str, Any]:
    """Return the text of an error, with the names that may be meant."""
    text = " ".join(str(error).split())
    if not isinstance(error, xacro.XacroException) and not text.startswith("xacro:"):
        text = f"xacro: {type(error).__name__}: {text}"
    if text.startswith("<class "):  # xacro says the same twice.
        text = " ".join(str(cause).split())
    if isinstance(cause, SyntaxError):  # What it calls a file and a line is neither.
        text = text.replace(f" ({cause.filename}, line {cause.lineno})", "")
    for macro in getattr(cause, "macros", []):
        params = ", ".join(macro.params) or "none"
        text = f"macro {_name(macro)!r}: {text}; its parameters: {params}"
    match cause:
        case NameError(name=str(name)):
            return {"text": text, "name": name, "known": _known_names(error, cause)}
        case xacro.XacroException() if text.startswith("unknown macro name: "):
            name = text.partition(": ")[2].removeprefix("xacro:")
            return {"text": text, "name": name, "known": _innermost(error, "macros")}
    return {"text": text}


def _known_names(error: Exception, cause: NameError) -> list[str]:
    """Return the properties, or the arguments, that an expression could have named."""
    if any(frame.f_code is eval_argument.__code__ for frame in _frames(cause)):
        return sorted(xacro.substitution_args_context["arg"])
    return _innermost(error, "symbols")


def _innermost(error: Exception, name: str) -> list[str]:
    """Return the names in a table of xacro's, as it was where an error came up."""
    tables = [frame.f_locals.get(name) for frame in _frames(error)]
    table = next((each for each in reversed(tables) if each is not None), None)
    names: set[str] = set()
    while isinstance(table, xacro.Table):
        names.update(key for key in table if re.match(r"(?!__)\w", key))
        table = table.parent
    return sorted(names)


if __name__ == "__main__":
    main()
