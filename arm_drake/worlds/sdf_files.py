"""SDF files as XML elements that know their lines."""

import copy
import dataclasses as dc
import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from arm_drake.errors import InputError
from arm_drake.yaml_files import YamlError, read_text

# Largest file to read [bytes].
MAX_SIZE = 64 * 2**20

# Elements are nested so deep at most; the functions that read them are recursive.
_MAX_DEPTH = 200


@dc.dataclass(frozen=True, eq=False)
class SdfFile:
    """An SDF file."""

    path: Path

    # The `<sdf>` element.
    root: ET.Element

    # Lines of the elements.
    lines: dict[ET.Element, int]

    def error(self, problem: str, element: ET.Element | None = None) -> InputError:
        """Return an error about the file, or about an element of it."""
        line = None if element is None else self.lines.get(element)
        return InputError(problem, file=self.path, line=line)

    def copy(self, element: ET.Element) -> ET.Element:
        """Return a copy of an element that has the same lines."""
        copied = copy.deepcopy(element)
        for old, new in zip(element.iter(), copied.iter(), strict=True):
            self.lines[new] = self.lines[old]
        return copied


def read_sdf(path: Path, *, root_tag: str = "sdf") -> SdfFile:
    """Return the elements of an SDF file.

    Nothing outside the file is read: a document type, which can name other files, is
    refused.

    Args:
        path: The file.
        root_tag: What its topmost element is called.

    Raises:
        InputError: If it can't be read, is malformed, or is no SDF.
    """
    if path.exists() and not path.is_file():  # A pipe would never end.
        raise InputError("can't be read: it is no file", file=path)
    try:
        text = read_text(path, MAX_SIZE)
    except YamlError as error:
        raise InputError(str(error), file=path) from None
    builder, lines, depth = ET.TreeBuilder(), {}, 0
    # Names with prefixes, such as "drake:", stay as they are.
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_DEPTH:
            problem = f"elements are nested more than {_MAX_DEPTH} deep"
            raise InputError(
                f"{problem}; no SDF needs that",
                file=path,
                line=parser.CurrentLineNumber,
            )
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise InputError(
            "a document type isn't read; expected <sdf> without <!DOCTYPE>",
            file=path,
            line=parser.CurrentLineNumber,
        )

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise InputError(
            f"malformed XML: {reason}", file=path, line=error.lineno
        ) from None
    file = SdfFile(path, builder.close(), lines)
    if file.root.tag != root_tag:
        problem = f"expected <{root_tag}> at the top, got <{file.root.tag}>"
        raise file.error(problem, file.root)
    if root_tag == "sdf" and not file.root.get("version"):
        problem = '<sdf> has no version; expected such as version="1.6"'
        raise file.error(problem, file.root)
    return file


def text_of(element: ET.Element, tag: str) -> str:
    """Return the text of a child without white space around it, or ""."""
    return (element.findtext(tag) or "").strip()


def is_true(text: str) -> bool:
    """Return whether a text says true, as SDF writes it."""
    return text.strip().lower() in ("true", "1")


def name_of(element: ET.Element) -> str:
    """Return what messages call an element, such as "model 'table'"."""
    name = element.get("name") or text_of(element, "name")
    return f"{element.tag} {name!r}" if name else f"<{element.tag}>"
