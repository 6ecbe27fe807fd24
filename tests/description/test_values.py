"""Numbers in attributes: what is one, and the message about what is none."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from arm_drake.description.elements import ElementReader, numbers, parse_float
from arm_drake.description.elements import parse_number as parse_parameter
from arm_drake.description.report import LoadReport
from arm_drake.errors import DescriptionError


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1", 1.0),
        ("+1", 1.0),
        ("-1.", -1.0),
        (".5", 0.5),
        ("-1.5e-3", -0.0015),
        ("2E2", 200.0),
        (" \t\r\n7 \n", 7.0),
        ("inf", math.inf),
        ("-Infinity", -math.inf),
        ("INF", math.inf),
        ("1e999", math.inf),
    ],
)
def test_a_decimal_number_is_read(text, number):
    assert parse_float(text) == number
    assert parse_parameter(text) == number


# Python's float takes the first four.
@pytest.mark.parametrize(
    "text",
    ["1_0", "\u0661", "\u00a01", "\u20071", "0x10", "1f", "1,5", "1 2", "", ".", "e5"],
)
def test_what_drake_reads_otherwise_is_no_number(text):
    assert parse_float(text) is None
    assert parse_parameter(text) is None


def test_nan_is_a_number_of_an_attribute_but_of_no_parameter():
    number = parse_float("NaN")

    assert number is not None
    assert math.isnan(number)
    assert parse_parameter("nan") is None


def test_numbers_are_separated_by_white_space():
    assert numbers(" 1\t2\n\r 3 ", Path("a.urdf"), "x") == [1.0, 2.0, 3.0]
    assert numbers("", Path("a.urdf"), "x") == []


@pytest.mark.parametrize("text", ["1 x", "1\u00a02", "1,2", "1 1_0"])
def test_anything_else_is_one_located_message(text):
    with pytest.raises(DescriptionError) as caught:
        numbers(text, Path("a.urdf"), "link 'a'")

    assert str(caught.value) == f"a.urdf: link 'a': expected numbers, got {text!r}"


def test_an_integer_of_endless_digits_is_reported():
    report = LoadReport()
    reader = ElementReader("arm", report, Path("a.urdf"))
    element = ET.Element("joint", size="9" * 5000)

    assert reader.integer(element, "size", 1) is None
    assert "size: expected an integer from 1 on, got '999" in str(report)
