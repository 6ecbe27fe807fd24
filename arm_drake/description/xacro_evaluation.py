"""Evaluate the expressions of xacro files, and nothing that leaves the expression.

xacro looks for names with two underscores in the outermost code alone, and `$(eval)`
has all of Python's functions. Here the whole expression is searched, and what can
reach such names by other ways is replaced: `vars`, `type`, `str.format`.
"""

import ast
import builtins
import contextlib
import errno
import functools
import os
import re
import string
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import xacro

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
    """Return what `${expression}` stands for; takes the place of `xacro.safe_eval`.

    Args:
        expression: Text of the expression.
        symbols: Values by name.
        local_symbols: Further values by name, which come first.

    Raises:
        Exception: Of any type, if the expression is malformed or forbidden.
    """
    code = _compile(expression)
    symbols.update(__builtins__=dict(_HELPERS))
    return eval(code, symbols, local_symbols)  # noqa: S307 What it reaches is checked.


def eval_argument(
    expression: str, symbols: dict[str, Any], local_symbols: Mapping[str, Any]
) -> Any:
    """Return what `$(eval expression)` stands for; takes the place of `eval`.

    Args:
        expression: Text of the expression.
        symbols: Values by name.
        local_symbols: Further values by name, which come first.

    Raises:
        Exception: Of any type, if the expression is malformed or forbidden.
    """
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
    """Open a file; refuse a pipe or device, which would be read for ever.

    Args:
        path: The file.
        mode: As that of `open`.

    Raises:
        OSError: If it can't be opened.
    """
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    return open(path, mode)


@contextlib.contextmanager
def replaced(names: dict[str, Any], **values: Any) -> Iterator[None]:
    """Give names other values for a while.

    Args:
        names: Values by name, such as those of a module.
        **values: The other values.
    """
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
