"""Where a ROS package's files lie once it is installed.

Descriptions name files by their place below `share/<package>`. In a source tree some
of them lie elsewhere: `install(DIRECTORY ...)` in CMakeLists.txt, or `data_files` in
setup.py, says where they go. Such a package is shown as installed, with links.
"""

import ast
import glob
import itertools
import re
import shlex
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

# An installed file or folder: its place below `share/<package>`, and where it lies.
Installed = tuple[PurePosixPath, Path]

_COMMENT = re.compile(r"#\[\[.*?\]\]|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(
    r"\b(project|set|install|add_subdirectory|ament_auto_package)\s*\(([^)]*)\)", re.I
)
_VARIABLE = re.compile(r"\$\{(\w+)\}")

# Words of `install(DIRECTORY ...)` after which no folders are named.
_OPTIONS = {
    "COMPONENT",
    "CONFIGURATIONS",
    "DESTINATION",
    "DIRECTORY_PERMISSIONS",
    "FILES_MATCHING",
    "FILE_PERMISSIONS",
    "OPTIONAL",
    "PATTERN",
    "PERMISSIONS",
    "REGEX",
    "RENAME",
    "TYPE",
    "USE_SOURCE_PERMISSIONS",
}


def installed_elsewhere(package: Path, name: str) -> list[Installed]:
    """Return what a source package installs to a place other than its own.

    Args:
        package: Folder of the package.
        name: Name of the package.
    """
    rules = [*_cmake_rules(package, name), *_setup_rules(package, name)]
    found = []
    for place, source in rules:
        there = package / place
        if source.exists() and not (there.exists() and there.samefile(source)):
            found.append((place, source))
    return found


def show_as_installed(package: Path, rules: list[Installed], shown: Path) -> None:
    """Fill a folder with links to a package's files, in their installed places.

    Args:
        package: Folder of the package; what it doesn't install is shown in place.
        rules: What `installed_elsewhere` returned.
        shown: The folder to fill; it must not exist.
    """
    shown.mkdir(parents=True)
    for child in sorted(package.iterdir()):
        _link(child, shown / child.name)
    for place, source in rules:
        _place(source, shown, place)


def _place(source: Path, shown: Path, place: PurePosixPath) -> None:
    folder = shown
    for part in place.parts[:-1]:
        folder = folder / part
        _open_folder(folder)
    _link(source, shown / place)


def _link(source: Path, shown: Path) -> None:
    """Show a file or a folder; a folder that is shown already gets more content."""
    if source.is_dir() and shown.is_dir():
        _open_folder(shown)
        for child in sorted(source.iterdir()):
            _link(child, shown / child.name)
        return
    shown.unlink(missing_ok=True)
    shown.symlink_to(source.resolve())


def _open_folder(shown: Path) -> None:
    """Make a folder of its own of a link to a folder, with links to what is in it."""
    if not shown.is_symlink():
        shown.mkdir(exist_ok=True)
        return
    target = shown.resolve()
    shown.unlink()
    shown.mkdir()
    for child in sorted(target.iterdir()):
        _link(child, shown / child.name)


def _cmake_rules(package: Path, name: str) -> Iterator[Installed]:
    variables = {
        "PROJECT_NAME": name,
        "CMAKE_PROJECT_NAME": name,
        "CMAKE_SOURCE_DIR": str(package),
        "PROJECT_SOURCE_DIR": str(package),
        "CMAKE_INSTALL_PREFIX": "",
        "CMAKE_INSTALL_DATADIR": "share",
        "CMAKE_INSTALL_DATAROOTDIR": "share",
    }
    yield from _cmake_file(package, name, variables, depth=0)


def _cmake_file(
    folder: Path, name: str, variables: dict[str, str], depth: int
) -> Iterator[Installed]:
    variables = variables | {"CMAKE_CURRENT_SOURCE_DIR": str(folder)}
    for command, text in _COMMAND.findall(_read(folder / "CMakeLists.txt")):
        words = _words(_VARIABLE.sub(lambda m: variables.get(m[1], m[0]), text))
        match command.lower():
            case "project" if words:
                variables["PROJECT_NAME"] = words[0]
            case "set" if words:
                variables[words[0]] = " ".join(words[1:])
            case "add_subdirectory" if words and depth < 3:
                yield from _cmake_file(folder / words[0], name, variables, depth + 1)
            case "install":
                yield from _install_command(words, folder, name)
            case "ament_auto_package" if "INSTALL_TO_SHARE" in words:
                start = words.index("INSTALL_TO_SHARE") + 1
                shared = ["DIRECTORY", *words[start:], "DESTINATION", f"share/{name}"]
                yield from _install_command(shared, folder, name)


def _install_command(words: list[str], folder: Path, name: str) -> Iterator[Installed]:
    if len(words) < 2 or words[0] not in ("DIRECTORY", "FILES", "PROGRAMS"):
        return
    sources = []
    for word in words[1:]:
        if word in _OPTIONS:
            break
        sources.append(word)
    after = dict(itertools.pairwise(words))
    place = _below_share(after.get("DESTINATION", ""), name)
    if place is None:
        return
    for source in sources:
        path = folder / source
        if words[0] == "DIRECTORY" and source.endswith("/"):  # Its content.
            children = sorted(path.iterdir()) if path.is_dir() else []
            yield from ((place / child.name, child) for child in children)
        elif words[0] == "FILES" and "RENAME" in after:
            yield place / after["RENAME"], path
        else:
            yield place / path.name, path


def _below_share(destination: str, name: str) -> PurePosixPath | None:
    """Return the place below `share/<name>` that a destination is, or None."""
    parts = PurePosixPath(destination.lstrip("/")).parts
    if parts[:2] != ("share", name) or ".." in parts:
        return None
    return PurePosixPath(*parts[2:])


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text.replace(";", " "))
    except ValueError:  # An open quote.
        return text.split()


def _read(path: Path) -> str:
    try:
        return _COMMENT.sub("", path.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return ""


def _setup_rules(package: Path, name: str) -> Iterator[Installed]:
    """Yield what `data_files` of a setup.py says; nothing of the file is executed."""
    try:
        text = (package / "setup.py").read_text(encoding="utf-8", errors="replace")
        tree = ast.parse(text)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
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
            place = _below_share(destination, name)
            if place is not None:
                for source in sources:
                    yield place / PurePosixPath(source).name, package / source


class _SetupReader:
    """Understands how setup.py files spell texts and lists of texts."""

    def __init__(self, package: Path) -> None:
        self._package = package
        self.names: dict[str, ast.expr] = {}

    def value(self, node: ast.expr, depth: int = 0) -> str | list[str] | None:
        """Return the text or texts that an expression stands for; None if unknown."""
        if depth > 10:
            return None
        match node:
            case ast.Constant(value=str(text)):
                return text
            case ast.Name(id=name) if name in self.names:
                return self.value(self.names[name], depth + 1)
        values = [self.value(child, depth + 1) for child in _operands(node)]
        texts = [value for value in values if isinstance(value, str)]
        are_texts = len(texts) == len(values)
        match node:
            case ast.List() if are_texts:
                return texts
            case ast.JoinedStr() if are_texts:
                return "".join(texts)
            case ast.BinOp(op=ast.Add()) if are_texts:
                return "".join(texts)
            case ast.BinOp(op=ast.Add()):
                left, right = values
                if isinstance(left, list) and isinstance(right, list):
                    return left + right
            case ast.Call() if are_texts and texts:
                name = ast.unparse(node.func).rpartition(".")[2]
                if name == "join":
                    return "/".join(texts)
                if name in ("glob", "iglob"):
                    return sorted(glob.glob(texts[0], root_dir=self._package))
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
