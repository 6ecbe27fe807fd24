"""ROS packages and their files, where descriptions name them.

A package is a folder with a `package.xml`. Source trees and install trees
(`share/<package>`) are searched alike. First come the folders that the user names, the
entry file's own package and what ROS has installed; then what lies around the entry
file, the nearest first, for one repository may hold several copies of a package.

Descriptions name files by their place below `share/<package>`. In a source tree some
of them lie elsewhere: `install(DIRECTORY ...)` in CMakeLists.txt, or `data_files` in
setup.py, says where they go. Both files are read, never executed.
"""

import ast
import contextlib
import functools
import glob
import itertools
import os
import re
import weakref
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError, suggest

# An installed file or folder: its place below `share/<package>`, and where it lies.
Installed = tuple[PurePosixPath, Path]

# More than any package needs.
_MAX_LINKS = 50_000


def show_as_installed(package: Path, rules: list[Installed], shown: Path) -> None:
    """Fill a new folder with links to a package's files, in their installed places.

    What the package doesn't install is shown in place.
    """
    shown.mkdir(parents=True)
    links = _Links()
    links.add_children(package, shown)
    for place, source in rules:
        if place.is_absolute() or ".." in place.parts:
            raise ValueError(f"{str(place)!r} lies outside of the package")
        folder = shown
        for part in place.parts[:-1]:
            folder = folder / part
            links.open_folder(folder)
        links.add(source, shown / place)


class _Links:
    """Makes links, and counts them."""

    def __init__(self) -> None:
        self._count = 0

    def add(self, source: Path, shown: Path) -> None:
        """Show a file or a folder; a folder that is shown already gets more content."""
        if source.is_dir() and shown.is_dir():
            self.open_folder(shown)
            self.add_children(source, shown)
            return
        self._link(source, shown)

    def add_children(self, source: Path, shown: Path) -> None:
        """Show what is in a folder."""
        for child in sorted(source.iterdir()):
            place = shown / child.name
            # A link to a folder may lead back to where we are.
            if child.is_symlink() and place.is_dir():
                if place.is_symlink():
                    self._link(child, place)
            else:
                self.add(child, place)

    def open_folder(self, shown: Path) -> None:
        """Make a folder of its own of a link to a folder, with links to its content."""
        if not shown.is_symlink():
            shown.mkdir(exist_ok=True)
            return
        target = shown.resolve()
        if not target.is_dir():
            raise NotADirectoryError(f"{str(target)!r} is no folder")
        shown.unlink()
        shown.mkdir()
        self.add_children(target, shown)

    def _link(self, source: Path, shown: Path) -> None:
        self._count += 1
        if self._count > _MAX_LINKS:
            raise ValueError(f"more than {_MAX_LINKS} links")
        shown.unlink(missing_ok=True)
        shown.symlink_to(source.resolve())


# Bounds on how much of a setup.py is understood: expressions looked at, the length of
# a text [characters], files that a pattern stands for.
_MAX_EXPRESSIONS = 100_000
_MAX_SETUP_TEXT = 10_000
_MAX_FILES = 10_000


def setup_rules(
    package: Path, text: str, below_share: Callable[[str], PurePosixPath | None]
) -> Iterator[Installed]:
    """Yield what `data_files` of a setup.py says."""
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
                return text if len(text) <= _MAX_SETUP_TEXT else None
            case ast.Name(id=name) if name in self.names:
                return self.value(self.names[name], depth + 1)
        values = [self.value(child, depth + 1) for child in _operands(node)]
        texts = [value for value in values if isinstance(value, str)]
        are_texts = len(texts) == len(values)
        if isinstance(node, ast.List):
            return texts if are_texts else None
        if sum(map(len, texts)) > _MAX_SETUP_TEXT:
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


# The first alternative holds a comment that never ends, too.
_COMMENT = re.compile(r"#\[\[.*?(?:\]\]|\Z)|#[^\n]*", re.DOTALL)
_COMMAND = re.compile(
    r"\b(project|set|install|add_subdirectory|ament_auto_package|foreach|endforeach)"
    r"\s*\(([^)]{0,20000})\)",
    re.I,
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

# More than any package has: characters of a file, those of all commands with their
# variables filled in, and rules.
_MAX_TEXT = 256 * 2**10
_MAX_EXPANDED = 2**20
_MAX_RULES = 20_000


def installed_elsewhere(package: Path, name: str) -> list[Installed]:
    """Return what a source package installs to a place other than its own."""
    below_share = functools.partial(_below_share, name=name)
    setup = _read(package / "setup.py")
    rules = itertools.chain(
        _CMakeReader(package, name).rules(), setup_rules(package, setup, below_share)
    )
    found = []
    for index, (place, source) in enumerate(rules):
        if index >= _MAX_RULES:
            raise ValueError(f"more than {_MAX_RULES} files and folders are installed")
        if place.is_absolute() or ".." in place.parts:
            continue  # It isn't below `share/<package>`.
        original = package / place
        if source.exists() and not (original.exists() and original.samefile(source)):
            found.append((place, source))
    return found


class _CMakeReader:
    """Follows the commands of a CMakeLists.txt that say where files are installed."""

    def __init__(self, package: Path, name: str) -> None:
        self._package = package
        self._name = name
        self._num_characters = 0
        self._variables = {
            "PROJECT_NAME": name,
            "CMAKE_PROJECT_NAME": name,
            "CMAKE_SOURCE_DIR": str(package),
            "PROJECT_SOURCE_DIR": str(package),
            "CMAKE_INSTALL_PREFIX": "",
            "CMAKE_INSTALL_DATADIR": "share",
            "CMAKE_INSTALL_DATAROOTDIR": "share",
        }

    def rules(self) -> Iterator[Installed]:
        """Yield what is installed below `share/<package>`."""
        yield from self._file(self._package, self._variables, depth=0)

    def _file(
        self, folder: Path, variables: dict[str, str], depth: int
    ) -> Iterator[Installed]:
        text = _read(folder / "CMakeLists.txt")
        self._count(len(text))
        variables = variables | {"CMAKE_CURRENT_SOURCE_DIR": str(folder)}
        commands = [
            (command.lower(), text)
            for command, text in _COMMAND.findall(_COMMENT.sub("", text))
        ]
        yield from self._run(commands, folder, variables, depth)

    def _run(
        self,
        commands: list[tuple[str, str]],
        folder: Path,
        variables: dict[str, str],
        depth: int,
    ) -> Iterator[Installed]:
        waiting = iter(commands)
        for command, text in waiting:
            words = _words(self._expand(text, variables))
            match command:
                case "project" if words:
                    variables["PROJECT_NAME"] = words[0]
                case "set" if words:
                    variables[words[0]] = " ".join(words[1:])
                case "add_subdirectory" if words and depth < 3:
                    yield from self._file(folder / words[0], variables, depth + 1)
                case "install":
                    yield from _install_command(words, folder, self._name)
                case "ament_auto_package" if "INSTALL_TO_SHARE" in words:
                    shared = words[words.index("INSTALL_TO_SHARE") + 1 :]
                    shared += ["DESTINATION", f"share/{self._name}"]
                    shared.insert(0, "DIRECTORY")
                    yield from _install_command(shared, folder, self._name)
                case "foreach":
                    body = _loop_body(waiting)
                    for item in _loop_items(words, variables):
                        variables[words[0]] = item
                        yield from self._run(body, folder, variables, depth)

    def _expand(self, text: str, variables: dict[str, str]) -> str:
        """Return a text with the values of variables, which may not become endless."""
        values = (variables.get(name, "") for name in _VARIABLE.findall(text))
        self._count(len(text) + sum(map(len, values)))
        return _VARIABLE.sub(lambda match: variables.get(match[1], match[0]), text)

    def _count(self, num_characters: int) -> None:
        self._num_characters += num_characters
        if self._num_characters > _MAX_EXPANDED:
            raise ValueError("the commands of its CMakeLists.txt are too long")


def _loop_body(commands: Iterator[tuple[str, str]]) -> list[tuple[str, str]]:
    """Take the commands up to the end of a loop, whose start has been taken."""
    body, num_open = [], 1
    for command, text in commands:
        num_open += {"foreach": 1, "endforeach": -1}.get(command, 0)
        if num_open == 0:
            break
        body.append((command, text))
    return body


def _loop_items(words: list[str], variables: dict[str, str]) -> list[str]:
    match words:
        case [_, "IN", "LISTS", *lists]:
            return [item for name in lists for item in _words(variables.get(name, ""))]
        case [_, "IN", "ITEMS", *items]:
            return items
        case [_, "RANGE" | "IN", *_] | []:
            return []
    return words[1:]


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
            if is_plain_name(after["RENAME"]):
                yield place / after["RENAME"], path
        else:
            yield place / path.name, path


def is_plain_name(name: str) -> bool:
    """Return whether a text names something in a folder, and nothing outside of it."""
    return name not in ("", ".", "..") and "/" not in name and "\0" not in name


def _below_share(destination: str, name: str) -> PurePosixPath | None:
    """Return the place below `share/<name>` that a destination is, or None."""
    parts = PurePosixPath(destination.lstrip("/")).parts
    if parts[:2] != ("share", name) or ".." in parts:
        return None
    return PurePosixPath(*parts[2:])


def _words(text: str) -> list[str]:
    try:
        import shlex

        return shlex.split(text.replace(";", " "))
    except ValueError:  # An open quote.
        return text.split()


def _read(path: Path) -> str:
    if not os.path.isfile(path):  # A pipe would be read for ever.
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(_MAX_TEXT + 1)
    if len(text) > _MAX_TEXT:
        raise ValueError(f"its {path.name} is larger than {_MAX_TEXT // 2**10} kB")
    return text


# How far below a searched folder something may lie, and how far above the entry file's
# package its workspace may begin.
_SEARCH_DEPTH = 5
_WORKSPACE_HEIGHT = 4

# A bound on the folders looked at below one ancestor.
_MAX_FOLDERS = 20_000

_SKIPPED = {"build", "install", "log", "node_modules", "__pycache__"}
_NAME = re.compile(r"<name>\s*([^<\s]+)\s*</name>")


class PackageFinder:
    """Resolves package names and file URIs for one robot description."""

    def __init__(
        self,
        entry: Path,
        package_paths: Sequence[Path] = (),
        report: LoadReport | None = None,
    ) -> None:
        """Create a finder."""
        self._entry = entry
        parents = list(entry.resolve().parents)
        owners = [i for i, p in enumerate(parents) if os.path.isfile(p / "package.xml")]
        self._own = parents[owners[0]] if owners else None
        del parents[(owners[0] if owners else 1) + _WORKSPACE_HEIGHT :]
        ends = shared_folders()
        self._ancestors = list(
            itertools.takewhile(
                lambda folder: folder not in (folder.parent, *ends), parents
            )
        )
        self.package_paths = tuple(path.absolute() for path in package_paths)
        self._report = LoadReport() if report is None else report
        self._scanned: dict[Path, dict[str, Path]] = {}
        # All folders of each package in what was searched, the preferred one first.
        self._copies: dict[str, dict[Path, None]] = {}
        self._found: dict[str, Path] = {}
        self._sources: dict[str, Path] = {}
        # Packages that look different when installed, shown as that.
        self._installed: Path | None = None

    def find(self, name: str) -> Path:
        """Return the folder of a package, as `share/<package>` where installed."""
        if name not in self._found:
            self._found[name] = self._as_installed(name, self._search(name))
        return self._found[name]

    def source(self, name: str) -> Path:
        """Return the folder that a package has its sources in."""
        self.find(name)
        return self._sources.get(name, self._found[name])

    def sources(self) -> list[Path]:
        """Return the source folders of all packages that were looked up."""
        return [self.source(name) for name in self._found]

    def copies(self, name: str) -> list[Path]:
        """Return other folders of a package in what `find` searched for it."""
        taken = self.source(name)
        return [folder for folder in self._copies.get(name, ()) if folder != taken]

    def resolve(self, uri: str, relative_to: Path) -> Path:
        """Return the path that a file name or URI in a description stands for."""
        scheme, separator, rest = uri.partition("://")
        if "\0" in unquote(uri):
            raise PackageError(
                f"{uri!r} can't be loaded; no file name holds a null byte"
            )
        if not separator:
            return self.real(relative_to / uri)
        if scheme == "file":
            # "file:////abs" and "file:///abs" both occur; both mean "/abs".
            return Path("/" + unquote(rest).lstrip("/"))
        if scheme in ("package", "model"):
            package, _, path = rest.lstrip("/").partition("/")
            return self.real(self.find(unquote(package)) / unquote(path))
        raise PackageError(
            f"{uri!r} can't be loaded; expected a path, package://, model:// or file://"
        )

    def known(self) -> list[tuple[str, Path]]:
        """Return all packages that can be found, by name, the preferred first."""
        return [item for packages in self._candidates() for item in packages.items()]

    def locate(self, uri: str, relative_to: Path) -> tuple[Path, bool]:
        """Return where a file is, and whether that is elsewhere than its URI says.

        Authors write down where a file lay on their own machine, or relative to their
        package instead of to their file: it is looked for in the entry's package too.
        """
        path = self.resolve(uri, relative_to)
        # Unlike that of Path, it takes names that no file can have.
        if os.path.isfile(path) or self._own is None:
            return path, False
        names = {self._own.name, package_name(self._own / "package.xml")}
        parts = path.parts
        tails = [parts[i + 1 :] for i, part in enumerate(parts) if part in names]
        if path.is_relative_to(self._entry.parent):
            tails.append(path.relative_to(self._entry.parent).parts)
        candidates = [self._own.joinpath(*tail) for tail in tails if tail]
        found = next((other for other in candidates if os.path.isfile(other)), None)
        return (path, False) if found is None else (found, True)

    def real(self, path: Path) -> Path:
        """Return where a file lies that `find` shows as installed, without `..`."""
        shown = self._installed
        if shown is None or not path.is_relative_to(shown):
            if ".." not in path.parts:
                return path
            plain = os.path.normpath(path)
            # Behind a link `..` may lead elsewhere.
            is_same = os.path.realpath(plain) == os.path.realpath(path)
            return Path(plain) if is_same else path
        if os.path.exists(path):
            return path.resolve()
        name, *rest = path.relative_to(shown).parts
        return self._sources[name].joinpath(*rest)

    def real_paths(self, text: str) -> str:
        """Return a text in which every path that `find` made up is the real one."""
        if self._installed is None:
            return text
        pattern = re.escape(str(self._installed)) + r"[^\"'<>|*?\n]*"
        return re.sub(pattern, lambda m: str(self.real(Path(m[0]))), text)

    def _search(self, name: str) -> Path:
        by_folder = None
        for packages in self._candidates():
            if name in packages:
                return packages[name]
            for folder in packages.values():
                if folder.name == name and by_folder is None:
                    by_folder = folder
        found = by_folder or self._folder_called(name)
        if found is not None:
            what = f"no package.xml says that it is the package {name!r}"
            done = f"the folder {str(found)!r} of that name is taken"
            self._report.add("info", "repair", what, done, file=self._entry)
            return found
        known = {package for package, _ in self.known()}
        raise PackageError(
            f"package {name!r} not found; name the folder that holds it with "
            f"package_paths (--package-path); {suggest(name, known)}",
            file=self._entry,
        )

    def _folder_called(self, name: str) -> Path | None:
        """Return a folder of this name beside or above the entry file, if any."""
        if not is_plain_name(name):
            return None
        beside = [folder / name for folder in self._ancestors]
        above = [folder for folder in self._ancestors if folder.name == name]
        explicit = [root / name for root in self.package_paths]
        candidates = [*explicit, *above, *beside]
        # Unlike that of Path, it takes names that no folder can have.
        return next((path for path in candidates if os.path.isdir(path)), None)

    def _as_installed(self, name: str, package: Path) -> Path:
        try:
            return self._show(name, package)
        except (OSError, ValueError, RecursionError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            what = f"what package {name!r} installs can't be followed: {reason}"
            done = f"its source folder {str(package)!r} is taken as it is"
            self._report.add("warning", "unsupported", what, done, file=self._entry)
            return package

    def _show(self, name: str, package: Path) -> Path:
        rules = installed_elsewhere(package, name)
        if not rules:
            return package
        import shutil
        import tempfile

        if self._installed is None:
            self._installed = Path(tempfile.mkdtemp(prefix="arm_drake_"))
            weakref.finalize(self, shutil.rmtree, self._installed, ignore_errors=True)
        shown = self._installed / name
        try:
            show_as_installed(package, rules, shown)
        except BaseException:
            shutil.rmtree(shown, ignore_errors=True)
            raise
        self._sources[name] = package
        return shown

    def _candidates(self) -> Iterator[dict[str, Path]]:
        """Yield packages by name, the preferred ones first.

        Of several copies of the entry's own package below a folder that a user names,
        such as those of two workspaces, the one that holds the entry counts.
        """
        own = (
            {package_name(self._own / "package.xml"): self._own}
            if self._own is not None and self._own in self._ancestors
            else {}
        )
        for root in self.package_paths:
            if self._own is not None and self._own.is_relative_to(root.resolve()):
                yield own
            yield self._scan(root)
        yield own
        for variable in ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"):
            for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                yield self._scan(Path(prefix) / "share")
        for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if path:
                yield self._scan(Path(path))
        for folder in self._ancestors:
            yield self._scan(folder)

    def _scan(self, root: Path) -> dict[str, Path]:
        if root not in self._scanned:
            found = list(_packages_below(root))
            self._scanned[root] = dict(found)
            for name, folder in reversed(found):
                self._copies.setdefault(name, {})[folder] = None
        return self._scanned[root]


def shared_folders() -> tuple[Path | None, ...]:
    """Return where the search for packages around a file ends.

    One in the home folder must not start a walk through all of it, and what lies in the
    folder of temporary files belongs to nobody.
    """
    named = (os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP"))
    temporary = (*filter(None, named), "/tmp", "/var/tmp")  # noqa: S108
    return _home(), *(Path(folder).resolve() for folder in temporary)


def _home() -> Path | None:
    try:
        return Path.home()
    except RuntimeError:  # A user without one, as in many a container.
        return None


def _packages_below(root: Path) -> Iterable[tuple[str, Path]]:
    """Return (name, folder) of the packages below a folder, the nearest one last."""
    found: list[tuple[str, Path]] = []
    for folder in folders_below(root, _MAX_FOLDERS, _SKIPPED):
        manifest = folder / "package.xml"
        # Unlike that of Path, it takes folders that can't be read.
        if os.path.isfile(manifest):
            found.append((package_name(manifest), folder))
    return reversed(found)


def folders_below(
    root: Path, most: int, skipped: Collection[str] = ()
) -> Iterator[Path]:
    """Yield a folder and those below it, the topmost first, at most so many.

    Hidden ones are left out, and those of names to skip.
    """
    level = [root]
    for _ in range(_SEARCH_DEPTH + 1):
        below: list[Path] = []
        for folder in level:
            if most == 0:
                return
            most -= 1
            yield folder
            with contextlib.suppress(OSError):
                below += [
                    Path(entry.path)
                    for entry in sorted(os.scandir(folder), key=lambda e: e.name)
                    if entry.is_dir(follow_symlinks=False)
                    and not entry.name.startswith(".")
                    and entry.name not in skipped
                ]
        level = below


def package_name(manifest: Path) -> str:
    """Return the name in a `package.xml`, or that of its folder."""
    try:
        match = _NAME.search(manifest.read_text(encoding="utf-8", errors="replace"))
    except OSError:
        match = None
    return match.group(1) if match else manifest.parent.name
