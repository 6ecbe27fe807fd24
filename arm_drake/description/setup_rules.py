"""What the setup.py of a Python package says about the places of its files.

The file is read, never executed.
"""

import ast
import glob
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath

from arm_drake.description.install_links import Installed

# Bounds on how much of a setup.py is understood: expressions looked at, the length of
# a text [characters], files that a pattern stands for.
_MAX_EXPRESSIONS = 100_000
_MAX_TEXT = 10_000
_MAX_FILES = 10_000


def setup_rules(
    package: Path, text: str, below_share: Callable[[str], PurePosixPath | None]
) -> Iterator[Installed]:
    """Yield what `data_files` of a setup.py says.

    Args:
        package: Folder of the package.
        text: Content of its setup.py.
        below_share: Returns the place in the package that a destination is, or None.

    Raises:
        ValueError: If there is more in the file than in any setup.py.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return
    reader = _SetupReader(package)
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            reader.names[node.targets[0].id] = node.value
    for node in ast.walk(tree):
        if not isinstance(node, ast.Tuple) or len(node.elts) != 2:
            continue
        destination, sources = map(reader.value, node.elts)
        if isinstance(destination, str) and isinstance(sources, list):
            place = below_share(destination)
            if place is not None:
                for source in sources:
                    yield place / PurePosixPath(source).name, package / source


class _SetupReader:
    """Understands how setup.py files spell texts and lists of texts."""

    def __init__(self, package: Path) -> None:
        self._package = package
        self._count = 0
        self.names: dict[str, ast.expr] = {}

    def value(self, node: ast.expr, depth: int = 0) -> str | list[str] | None:
        """Return the text or texts that an expression stands for; None if unknown."""
        self._count += 1
        if self._count > _MAX_EXPRESSIONS:
            raise ValueError(f"more than {_MAX_EXPRESSIONS} expressions in setup.py")
        if depth > 10:
            return None
        match node:
            case ast.Constant(value=str(text)):
                return text if len(text) <= _MAX_TEXT else None
            case ast.Name(id=name) if name in self.names:
                return self.value(self.names[name], depth + 1)
        values = [self.value(child, depth + 1) for child in _operands(node)]
        texts = [value for value in values if isinstance(value, str)]
        are_texts = len(texts) == len(values)
        if isinstance(node, ast.List):
            return texts if are_texts else None
        if sum(map(len, texts)) > _MAX_TEXT:
            return None
        match node:
            case ast.JoinedStr() if are_texts:
                return "".join(texts)
            case ast.BinOp(op=ast.Add()) if are_texts:
                return "".join(texts)
            case ast.BinOp(op=ast.Add()):
                left, right = values
                if isinstance(left, list) and isinstance(right, list):
                    return left + right
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if (
                are_texts and texts
            ):
                if name == "join":
                    return "/".join(texts)
                if name in ("glob", "iglob"):
                    found = glob.iglob(texts[0], root_dir=self._package)
                    return sorted(itertools.islice(found, _MAX_FILES))
        return None


def _operands(node: ast.expr) -> list[ast.expr]:
    match node:
        case ast.List():
            return node.elts
        case ast.JoinedStr():
            return [
                part.value if isinstance(part, ast.FormattedValue) else part
                for part in node.values
            ]
        case ast.BinOp():
            return [node.left, node.right]
        case ast.Call():
            return node.args
    return []
