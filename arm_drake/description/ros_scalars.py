"""Which type rcl gives a value of a parameter file (get_value in its parse.c)."""

import math
import re

import yaml

from arm_drake import yaml_files

_TRUE = ("Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON")
_FALSE = ("N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF")
_INT = re.compile(r"[-+]?(0[xX][\da-fA-F]+|0[0-7]*|[1-9]\d*)", re.ASCII)
_FLOAT = re.compile(
    r"[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[iI][nN][fF]([iI][nN][iI][tT][yY])?"
    r"|[nN][aA][nN])",
    re.ASCII,
)
_HEX_FLOAT = re.compile(
    r"[-+]?0[xX]([\da-fA-F]+\.?[\da-fA-F]*|\.[\da-fA-F]+)([pP][-+]?\d+)?", re.ASCII
)
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_TAG = "tag:yaml.org,2002:"

# Tag of scalars whose tag isn't written.
UNTAGGED = "untagged"
_TYPES = {f"{_TAG}bool": bool, f"{_TAG}int": int, f"{_TAG}float": float}


def scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    """Return the value that rcl gives a scalar.

    Raises:
        YamlError: If it doesn't fit its tag, or rcl has no such tag.
    """
    text = str(node.value)
    if node.tag == f"{_TAG}str" or (node.tag == UNTAGGED and node.style in ("'", '"')):
        return text
    value = _number_or_text(text)
    if node.tag == UNTAGGED:
        return value
    if node.tag not in _TYPES:
        raise _unknown_tag(node)
    expected = _TYPES[node.tag]
    if expected is float and type(value) is int:
        return float(value)
    if type(value) is not expected:
        problem = f"{text!r} is no {expected.__name__}"
        raise yaml_files.YamlError(problem, node.start_mark.line + 1)
    return value


def check_tag(node: yaml.Node) -> None:
    """Raise YamlError if a list or a mapping has a tag of its own."""
    if node.tag not in (UNTAGGED, f"{_TAG}seq", f"{_TAG}map"):
        raise _unknown_tag(node)


def _unknown_tag(node: yaml.Node) -> yaml_files.YamlError:
    return yaml_files.YamlError(
        f"the tag {node.tag.replace(_TAG, '!!')!r} is not taken; known: !!bool, "
        "!!float, !!int, !!str",
        node.start_mark.line + 1,
    )


def _number_or_text(text: str) -> bool | int | float | str:
    """Return what rcl makes of a text without quotes, with strtol and strtod."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if len(text) < 30 and _INT.fullmatch(text):
        digits = text.lstrip("+-").lower()
        base = 16 if digits.startswith("0x") else 8 if digits[0] == "0" else 10
        number = int(text, base)
        if -(2**63) <= number < 2**63:
            return number
        return float(number)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    if len(text) < 30 and _HEX_FLOAT.fullmatch(text):
        return float.fromhex(text)
    if not _FLOAT.fullmatch(text):
        return text
    value = float(text)
    mantissa = re.split("[eE]", text)[0]
    overflows = math.isinf(value) and "n" not in text.lower()
    underflows = value == 0.0 and bool(re.search("[1-9]", mantissa))
    return text if overflows or underflows else value
