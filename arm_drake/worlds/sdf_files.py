"""SDF files: their elements and lines, what is reported of them, what they name."""

import copy
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote
from xml.parsers import expat

from arm_drake.description.elements import MAX_DEPTH, explain_malformed, text_of
from arm_drake.description.packages import PackageFinder, folders_below
from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import InputError, PackageError
from arm_drake.importing import dataclass
from arm_drake.yaml_files import YamlError, read_text

# Largest file to read [bytes].
MAX_SIZE = 64 * 2**20


@dataclass(frozen=True, eq=False)
class SdfFile:
    """An SDF file."""

    path: Path

    # The `<sdf>` element.
    root: ET.Element

    # Lines of the elements.
    lines: dict[ET.Element, int]

    # What was not taken as written; files that belong together share one.
    report: LoadReport

    def error(self, problem: str, element: ET.Element | None = None) -> InputError:
        """Return an error about the file, or about an element of it."""
        line = None if element is None else self.lines.get(element)
        return InputError(problem, file=self.path, line=line)

    def note(
        self,
        severity: Severity,
        kind: Kind,
        what: str,
        done: str,
        element: ET.Element,
        where: str = "",
    ) -> None:
        """Report something about an element; `where` is as `place_of` says it."""
        line = self.lines.get(element)
        self.report.add(
            severity, kind, what, done, where=where, file=self.path, line=line
        )

    def remove(self, parent: ET.Element, tags: Collection[str], where: str) -> None:
        """Remove children that have no effect here, with a line for each."""
        for child in [child for child in parent if child.tag in tags]:
            parent.remove(child)
            name = child.get("filename") or child.get("name") or ""
            what = f"<{child.tag}> {name!r}" if name else f"<{child.tag}>"
            is_usual = child.tag in ("light", "self_collide")
            severity: Severity = "info" if is_usual else "warning"
            self.note(severity, "ignored", what, "it has no effect", child, where)

    def copy(self, element: ET.Element) -> ET.Element:
        """Return a copy of an element that has the same lines."""
        copied = copy.deepcopy(element)
        for old, new in zip(element.iter(), copied.iter(), strict=True):
            self.lines[new] = self.lines[old]
        return copied


def read_sdf(path: Path, report: LoadReport, *, root_tag: str = "sdf") -> SdfFile:
    """Return the elements of an SDF file, whose topmost one is called `root_tag`.

    Nothing outside the file is read: a document type, which can name other files, is
    refused, as is what is malformed or no SDF: with InputError.
    """
    if path.exists() and not path.is_file():  # A pipe would never end.
        raise InputError("can't be read: it is no file", file=path)
    try:
        text = read_text(path, MAX_SIZE)
    except YamlError as error:
        raise InputError(str(error), file=path) from None
    file = SdfFile(path, *_parse(path, text), report)
    if file.root.tag != root_tag:
        problem = f"expected <{root_tag}> at the top, got <{file.root.tag}>"
        raise file.error(problem, file.root)
    version = file.root.get("version", "")
    if root_tag == "sdf" and not re.fullmatch(r"\s*1\.[0-9]{1,3}\s*", version):
        found = f"the version {version!r}" if version else "no version"
        problem = f'<sdf> has {found}; expected such as version="1.6"'
        raise file.error(problem, file.root)
    return file


def _parse(path: Path, text: str) -> tuple[ET.Element, dict[ET.Element, int]]:
    """Return the topmost element of a text, and the lines of all elements."""
    builder, depth = ET.TreeBuilder(), 0
    lines: dict[ET.Element, int] = {}
    # Names with prefixes, such as "drake:", stay as they are.
    parser = expat.ParserCreate()

    def refuse(problem: str) -> InputError:
        return InputError(problem, file=path, line=parser.CurrentLineNumber)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            problem = f"elements are nested more than {MAX_DEPTH} deep"
            raise refuse(f"{problem}; no SDF needs that")
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def start_doctype(*_: object) -> None:
        problem = "a document type isn't read; expected <sdf> without <!DOCTYPE>"
        raise refuse(problem)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = start_doctype
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        problem = explain_malformed(text, reason, error.lineno)
        raise InputError(problem, file=path, line=error.lineno) from None
    return builder.close(), lines


def replace_child(parent: ET.Element, tag: str, text: str | None = None) -> None:
    """Remove the children of a name; with a text, add one that has it."""
    for child in parent.findall(tag):
        parent.remove(child)
    if text is not None:
        ET.SubElement(parent, tag).text = text


def name_of(element: ET.Element) -> str:
    """Return what messages call an element, such as "model 'table'"."""
    name = element.get("name") or text_of(element, "name")
    return f"{element.tag} {name!r}" if name else f"<{element.tag}>"


def place_of(element: ET.Element, parent: str = "") -> str:
    """Return the place of an element in another place, such as "model 'table'"."""
    return ", ".join(filter(None, (parent, name_of(element))))


# Folders of models, as Gazebo's users name them.
_VARIABLES = (
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "GAZEBO_MODEL_PATH",
    "SDF_PATH",
)

# How far above a world's package or folder its models may lie.
_HEIGHT = 3

# A bound on the folders looked at below one place.
_MAX_FOLDERS = 5_000

_REMOTE = re.compile(r"https?://", re.IGNORECASE)


class ModelFinder:
    """Finds what an SDF file and the models in it name."""

    def __init__(self, world: Path, package_paths: Sequence[Path] = ()) -> None:
        """Create it for the file of a world; `package_paths` are searched first."""
        self._packages = PackageFinder(world, package_paths)
        self._package_paths = tuple(package_paths)
        parents = list(world.resolve().parents)
        owners = [i for i, p in enumerate(parents) if (p / "package.xml").is_file()]
        # The last is what is searched below: the package, or the world's own folder.
        self._near = parents[: (owners[0] if owners else 0) + 1]
        self._above = [
            folder
            for folder in parents[len(self._near) : len(self._near) + _HEIGHT]
            if folder != folder.parent
        ]
        self._below: dict[Path, dict[str, Path]] = {}

    def find_model(self, uri: str, relative_to: Path) -> Path | None:
        """Return the SDF file of a model, or None.

        An address is `model://`, `package://`, `file://`, a path that starts from
        `relative_to`, or one of Fuel, whose models are taken where they are already.
        """
        if _REMOTE.match(uri):
            parts = [unquote(part) for part in uri.split("/") if part]
            # Such as .../models/Ground Plane/2; the version is a number.
            uri = f"model://{next((p for p in parts[::-1] if not p.isdigit()), '')}"
        path = self.find_file(uri, relative_to)
        if path is None or path.is_file():
            return path
        return _file_of_model(path)

    def find_file(self, uri: str, relative_to: Path) -> Path | None:
        """Return where a file or folder is, or None; a remote one never is."""
        if _REMOTE.match(uri) or "\0" in unquote(uri):
            return None
        scheme, found, rest = uri.partition("://")
        if found and scheme == "model":
            name, _, inside = unquote(rest).lstrip("/").partition("/")
            folder = self._find_folder(name)
            return None if folder is None else _existing(folder / inside)
        try:
            return _existing(self._packages.locate(uri, relative_to)[0])
        except PackageError:
            return None

    def _find_folder(self, name: str) -> Path | None:
        """Return the folder of a model, by its name."""
        if not name or name in (".", ".."):
            return None
        for folder in self._candidates(name):
            if os.path.isdir(folder):
                return folder
        try:
            return self._packages.find(name)
        except PackageError:
            return None

    def _candidates(self, name: str) -> Iterator[Path]:
        for root in self._package_paths:
            yield from self._search_below(root, name)
        for folder in self._near:
            yield from (folder / name, folder / "models" / name)
        yield from self._search_below(self._near[-1], name)
        for variable in _VARIABLES:
            for place in filter(None, os.environ.get(variable, "").split(os.pathsep)):
                yield Path(place) / name
        for folder in self._above:
            yield from (folder / name, folder / "models" / name)

    def _search_below(self, root: Path, name: str) -> Iterator[Path]:
        """Yield the folder below a place that holds a model of this name, if any."""
        if root not in self._below:
            self._below[root] = _models_below(root)
        if name in self._below[root]:
            yield self._below[root][name]


def _existing(path: Path) -> Path | None:
    return path if os.path.exists(path) else None


def _models_below(root: Path) -> dict[str, Path]:
    """Return the folders that hold models, by name, the topmost of each."""
    found: dict[str, Path] = {}
    for folder in folders_below(root, _MAX_FOLDERS):
        if any(os.path.lexists(folder / n) for n in ("model.config", "model.sdf")):
            found.setdefault(folder.name, folder)
    return found


def _file_of_model(folder: Path) -> Path | None:
    """Return the SDF file of a model's folder: that of the newest version."""
    config = folder / "model.config"
    if config.is_file():
        named = _named_in(config)
        if named is not None:
            return named
    path = folder / "model.sdf"
    return path if path.is_file() else None


def _named_in(config: Path) -> Path | None:
    try:
        root = read_sdf(config, LoadReport(), root_tag="model").root
    except InputError:
        return None
    versions = {
        _version(element.get("version", "")): element.text
        for element in root.iterfind("sdf")
    }
    for _, name in sorted(versions.items(), reverse=True):
        path = config.parent / (name or "").strip()
        if path.is_file() and path.resolve().is_relative_to(config.parent.resolve()):
            return path
    return None


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall("[0-9]+", text))
