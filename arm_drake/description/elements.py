"""Attributes, children and texts of XML elements, with a report of what is wrong."""

import contextlib
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from xml.parsers import expat

from arm_drake.description.report import Kind, LoadReport, Severity
from arm_drake.errors import DescriptionError

# Drake reads a number as far as it can: 1_0 as 1, 0x10 as 0. Python reads 1_0 as 10,
# and the digits of all scripts.
_NUMBER = re.compile(
    r"[+-]?(([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?|inf(inity)?|nan)",
    re.IGNORECASE | re.ASCII,
)
_SPACES = " \t\r\n"


def parse_float(text: str) -> float | None:
    """Return the decimal number, inf or nan that a text is, or None."""
    text = text.strip(_SPACES)
    return float(text) if _NUMBER.fullmatch(text) else None


def parse_comma_separated(text: str) -> list[float]:
    """Return numbers with commas between them; none if something isn't one."""
    found = [parse_float(word) for word in text.split(",")]
    numbers = [number for number in found if number is not None]
    return numbers if len(numbers) == len(found) else []


def numbers(
    text: str, file: Path, where: str, part: str = "", expected: str = "numbers"
) -> list[float]:
    """Return the numbers of a text, separated by spaces.

    DescriptionError, with its place and a part of it, if there is something else.
    """
    found = []
    for word in re.findall(f"[^{_SPACES}]+", text):
        number = parse_float(word)
        if number is None:
            problem = f"expected {expected}, got {text!r}"
            problem = f"{part}: {problem}" if part else problem
            raise DescriptionError(problem, file=file, where=where)
        found.append(number)
    return found


# Elements are nested so deep at most; the functions that read them are recursive.
MAX_DEPTH = 200

# So much of a line is shown.
_MAX_SHOWN = 80

_BOOLS = {"true": True, "false": False}


def declare_prefixes(text: str) -> str:
    """Return an XML text with all its prefixes declared; urdfdom asks for none."""
    data = text.encode(errors="replace")
    # Prefixes that tags and attributes have, those that the root declares, and where
    # its name ends.
    used: dict[str, None] = {}
    declared, ends = {"", "xml", "xmlns"}, list[int]()
    parser = expat.ParserCreate("utf-8")

    def start(tag: str, attributes: Mapping[str, str]) -> None:
        names = [name.partition(":") for name in (tag, *attributes)]
        used.update((prefix, None) for prefix, colon, _ in names if colon)
        if not ends:
            ends.append(parser.CurrentByteIndex + len(f"<{tag}".encode()))
            declared.update(name for prefix, _, name in names if prefix == "xmlns")

    parser.StartElementHandler = start
    with contextlib.suppress(expat.ExpatError):
        parser.Parse(data, True)
    lacking = "".join(f' xmlns:{p}="{p}"' for p in used if p not in declared)
    if not lacking:
        return text
    return f"{data[: ends[0]].decode()}{lacking}{data[ends[0] :].decode()}"


def parse_xml(text: str, file: Path) -> ET.Element:
    """Return the root element of a text."""
    try:
        root = ET.fromstring(text)  # noqa: S314  expat fetches no external entities.
    except ET.ParseError as error:
        line, _ = error.position
        reason = str(error).partition(":")[0]
        raise DescriptionError(
            explain_malformed(text, reason, line), file=file, line=line
        ) from None
    depth, level = 0, [root]
    while level:
        depth, level = depth + 1, [child for element in level for child in element]
        if depth > MAX_DEPTH:
            problem = f"elements are nested more than {MAX_DEPTH} deep"
            raise DescriptionError(f"{problem}; no URDF needs that", file=file)
    return root


def lines_of_elements(text: str) -> list[int]:
    """Return the line of each element of a text, as far as it is XML."""
    lines: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *tag: lines.append(parser.CurrentLineNumber)
    with contextlib.suppress(expat.ExpatError):
        parser.Parse(text, True)
    return lines


def explain_malformed(text: str, reason: str, line: int) -> str:
    """Return what is wrong with a text that is no XML, by expat's reason and line."""
    if not text.strip():
        return "the file is empty"
    parser, waiting = expat.ParserCreate(), []

    def start(tag: str, attributes: Mapping[str, str]) -> None:
        name = f' name="{attributes["name"]}"' if "name" in attributes else ""
        waiting.append((f"<{tag}{name}>", parser.CurrentLineNumber))

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: waiting.pop()
    with contextlib.suppress(expat.ExpatError):
        parser.Parse(text, True)
    around = f"{waiting[-1][0]} of line {waiting[-1][1]}" if waiting else "a tag"
    if reason in ("no element found", "unclosed token", "unclosed CDATA section"):
        return f"malformed XML: the file ends inside {around}; is it complete?"
    if reason.startswith("limit"):  # The line is as long as what it multiplies.
        return f"malformed XML: {reason}"
    shown = "".join(text.split("\n")[line - 1 : line]).strip()
    if len(shown) > _MAX_SHOWN:
        shown = f"{shown[:_MAX_SHOWN]}..."
    inside = f", inside {around}" if waiting else ""
    return f"malformed XML: {reason}{inside}" + (f": {shown!r}" if shown else "")


def free_name(name: str, is_taken: Callable[[str], bool]) -> str:
    """Return a name that isn't taken: this one, or with the first number that helps."""
    free, number = name, 2
    while is_taken(free):
        free, number = f"{name}_{number}", number + 1
    return free


def parse_number(text: str) -> float | None:
    """Return the number that a text is, or None."""
    number = parse_float(text)
    return None if number is None or math.isnan(number) else number


def parse_floats(text: str) -> tuple[float, ...] | None:
    """Return the finite numbers that a text consists of, or None."""
    found = [parse_float(word) for word in text.split()]
    known = tuple(x for x in found if x is not None and math.isfinite(x))
    return known if len(known) == len(found) else None


def parse_bool(text: str) -> bool | None:
    """Return the bool that a text is, in any letter case, or None."""
    return _BOOLS.get(text.lower())


def parse_sdf_bool(text: str) -> bool | None:
    """Return the bool that a text is to SDF, or None."""
    text = text.strip()
    return parse_bool({"1": "true", "0": "false"}.get(text, text))


def parse_sdf_pose(pose: ET.Element) -> tuple[float, ...] | None:
    """Return the numbers of a `<pose>` of SDF, None if they are none.

    They are x, y, z [m] and roll, pitch, yaw [rad], or a quaternion x, y, z, w.
    """
    found = parse_floats(pose.text or "")
    is_quaternion = attribute(pose, "rotation_format") == "quat_xyzw"
    if found is None or len(found) != 6 + is_quaternion:
        return None
    if is_quaternion or not parse_sdf_bool(attribute(pose, "degrees")):
        return found
    return (*found[:3], *map(math.radians, found[3:]))


def attribute(element: ET.Element, name: str) -> str:
    """Return an attribute without white space around it, or ""."""
    return (element.get(name) or "").strip()


# What stands for characters within the quotes of an attribute.
_ENTITIES = str.maketrans(
    {
        "&": "&amp;",
        "<": "&lt;",
        ">": "&gt;",
        '"': "&quot;",
        "\t": "&#9;",
        "\n": "&#10;",
        "\r": "&#13;",
    }
)


def quote_attribute(value: str) -> str:
    """Return the value of an attribute as it is written, in quotes.

    `xml.sax.saxutils` would bring all that opens pages of the web.
    """
    return f'"{value.translate(_ENTITIES)}"'


def text_of(element: ET.Element | None, tag: str = ".") -> str:
    """Return the text of an element, or of a child, without white space around it."""
    return "" if element is None else (element.findtext(tag) or "").strip()


class ElementReader:
    """Reads elements of one part of a description.

    What is malformed becomes a line in the report and counts as not given.
    """

    def __init__(self, place: str, report: LoadReport, file: Path) -> None:
        """Create the reader."""
        self._place = place
        self._report = report
        self._file = file

    def note(
        self, severity: Severity, kind: Kind, what: str, done: str, where: str = ""
    ) -> None:
        """Add a line about the part, or about a place in it."""
        place = ", ".join(filter(None, (self._place, where)))
        self._report.add(severity, kind, what, done, where=place, file=self._file)

    def error(self, problem: str) -> DescriptionError:
        """Return what to raise about the part."""
        return DescriptionError(problem, file=self._file, where=self._place)

    def check(
        self,
        element: ET.Element,
        attributes: Collection[str],
        children: Collection[str],
        where: str = "",
    ) -> None:
        """Report attributes and children other than these."""
        unknown = {
            f"attribute {name!r}" for name in set(element.attrib) - set(attributes)
        }
        unknown |= {f"<{name}>" for name in {e.tag for e in element} - set(children)}
        for name in sorted(unknown):
            what = f"<{element.tag}> has no {name}"
            self.note("warning", "ignored", what, "it has no effect", where)

    def boolean(self, element: ET.Element, name: str, where: str = "") -> bool | None:
        """Return a bool attribute, None if it is missing."""
        text = attribute(element, name)
        value = parse_bool(text)
        if value is None and element.get(name) is not None:
            self.expected(name, "true or false", text, where)
        return value

    def integer(
        self, element: ET.Element, name: str, least: int, where: str = ""
    ) -> int | None:
        """Return an integer attribute, None if it is missing."""
        if element.get(name) is None:
            return None
        text = attribute(element, name)
        if re.fullmatch("[0-9]{1,18}", text) and int(text) >= least:
            return int(text)
        self.expected(name, f"an integer from {least} on", text, where)
        return None

    def number(self, text: str | None, name: str, where: str = "") -> float | None:
        """Return the number that a text is, None if it is missing."""
        if text is None:
            return None
        value = parse_number(text.strip())
        if value is None:
            self.expected(name, "a number", text.strip(), where)
        return value

    def finite(self, text: str | None, name: str, where: str = "") -> float | None:
        """Return the finite number that a text is, None if it is missing."""
        value = self.number(text, name, where)
        if value is not None and math.isinf(value):
            self.expected(name, "a finite number", str(text).strip(), where)
            return None
        return value

    def parameters(self, element: ET.Element, where: str = "") -> dict[str, str]:
        """Return the texts of the `<param>` children by name."""
        parameters: dict[str, str] = {}
        for param in element.iterfind("param"):
            self.check(param, ["name"], [], where)
            name, text = attribute(param, "name"), text_of(param)
            if not name:
                what = f"a <param> without a name, its text is {text!r}"
                self.note("warning", "invalid", what, "left out", where)
                continue
            if not text:
                what = f"<param> {name!r} has no text"
                self.note("info", "missing", what, "taken as empty", where)
            if name in parameters:
                what = f"<param> {name!r} is given twice"
                self.note("warning", "invalid", what, f"{text!r} counts", where)
            parameters[name] = text
        return parameters

    def expected(self, name: str, expected: str, text: str, where: str = "") -> None:
        """Report a text that is not what it should be."""
        what = f"{name}: expected {expected}, got {text!r}"
        self.note("warning", "invalid", what, "taken as not given", where)
