"""Parameter files are read as rcl and rclcpp read them."""

import ctypes
import math
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import MAX_SIZE, ParameterReader, Section
from arm_drake.errors import ParameterError

TRUE = ["Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"]
FALSE = ["N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"]


@pytest.fixture
def read(tmp_path):
    """Return a function: YAML text -> sections and lines of the report."""

    def read_text(text: str, **variables: str) -> tuple[list[Section], list[str]]:
        file = tmp_path / "a.yaml"
        file.write_text(text, encoding="utf-8", newline="")
        report = LoadReport()
        sections = ParameterReader(variables, report).read(file)
        return sections, [str(e).replace(f"{tmp_path}/", "") for e in report]

    return read_text


@pytest.fixture
def values(read):
    """Return a function: text of parameters -> their values by name."""

    def read_values(text: str) -> dict[str, Any]:
        indented = "".join(f"    {line}\n" for line in text.splitlines())
        ((section,), _) = read(f"a:\n  ros__parameters:\n{indented}")
        return {key: parameter.value for key, parameter in section.parameters.items()}

    return read_values


@pytest.fixture
def problem(read, tmp_path):
    """Return a function: text of a file -> message of its error."""

    def find_problem(text: str) -> str:
        with pytest.raises(ParameterError) as caught:
            read(text)
        return str(caught.value).replace(f"{tmp_path}/", "")

    return find_problem


# Node names


@pytest.mark.parametrize(
    ("key", "node", "is_matched"),
    [
        ("arm", "/arm", True),
        ("arm", "/ns/arm", False),
        ("/arm", "/arm", True),
        ("/ns/arm", "/ns/arm", True),
        ("/ns/arm", "/arm", False),
        ("/ns/arm", "/a/ns/arm", False),
        ("/**", "/arm", True),
        ("/**", "/a/b/arm", True),
        ("/**/arm", "/arm", True),
        ("/**/arm", "/a/b/arm", True),
        ("/**/arm", "/a/b/leg", False),
        ("/*/arm", "/a/arm", True),
        ("/*/arm", "/arm", False),
        ("/*/arm", "/a/b/arm", False),
        ("/*", "/arm", True),
        ("/*", "/a/arm", False),
        ("/a/**/arm", "/a/arm", True),
        ("/a/**/arm", "/a/b/c/arm", True),
        ("/a/**/arm", "/b/arm", False),
        ("/*/b/*", "/a/b/arm", True),
        ("/**/arm", "/é/arm", False),
        ("/a.b", "/axb", False),
    ],
)
def test_a_node_key_matches_as_in_rclcpp(read, key, node, is_matched):
    ((section,), _) = read(f"{key}: {{ros__parameters: {{x: 1}}}}")

    assert section.matches(node) == is_matched


@pytest.mark.parametrize("key", ["/***", "arm**", "/a/***/arm"])
def test_a_node_key_that_is_no_pattern_is_said(read, tmp_path, key):
    ((section,), _) = read(f"{key}: {{ros__parameters: {{x: 1}}}}")

    with pytest.raises(ParameterError) as caught:
        section.matches("/arm")

    name = key if key.startswith("/") else f"/{key}"
    expected = f"{name!r} is no pattern of nodes; expected /* or /** in it"
    assert str(caught.value) == f"{tmp_path}/a.yaml:1: {expected}"


@pytest.mark.parametrize(
    ("text", "node"),
    [
        ("ns: {arm: {ros__parameters: {x: 1}}}", "/ns/arm"),
        ("/ns: {arm: {ros__parameters: {x: 1}}}", "/ns/arm"),
        ("a: {b: {arm: {ros__parameters: {x: 1}}}}", "/a/b/arm"),
        ("/**: {arm: {ros__parameters: {x: 1}}}", "/**/arm"),
        ("/*: {arm: {ros__parameters: {x: 1}}}", "/*/arm"),
        ("ns/: {/arm: {ros__parameters: {x: 1}}}", "/ns/arm"),
    ],
)
def test_nested_keys_are_one_name(read, text, node):
    ((section,), _) = read(text)

    assert (section.node, section.name) == (node, "arm")
    assert section.namespace == node.removesuffix("/arm")


def test_a_key_that_stands_twice_keeps_its_first_place(read):
    sections, lines = read(
        "arm: {ros__parameters: {x: 1, y: 1}}\n"
        "/**: {ros__parameters: {x: 2}}\n"
        "arm: {ros__parameters: {x: 3}}\n"
    )

    assert [(s.node, s.line) for s in sections] == [("/arm", 1), ("/**", 2)]
    assert {k: p.value for k, p in sections[0].parameters.items()} == {"x": 3, "y": 1}
    assert lines == [
        "warning: a.yaml:3: arm.x: it stands on line 1, too; what stands last counts"
    ]


def test_a_value_that_stands_twice_is_reported(read):
    section = "a:\n  ros__parameters:\n    b: {c: 1}\n    b: {c: 2}\n"

    (section,), lines = read(section)

    assert section.parameters["b.c"].value == 2
    assert lines == [
        "warning: a.yaml:4: a.b.c: it stands on line 3, too; what stands last counts"
    ]


def test_keys_that_stand_twice_merge_at_every_depth(values):
    read = values("a: {b: {c: 1, d: 2}}\na: {b: {c: 3}}\na.b: {e: 4}\na: {b.d: 5}")

    assert read == {"a.b.c": 3, "a.b.d": 5, "a.b.e": 4}


@pytest.mark.parametrize(
    "key",
    [
        "ros_parameters",
        "ros__parameter",
        "ros___parameters",
        "ros_params",
        "ros__paramters",
        "rosparameters",
        "ROS__PARAMETERS",
        "ros-parameters",
        "ros__parameters_",
    ],
)
def test_a_misspelt_ros__parameters_is_taken_and_reported(read, key):
    ((section,), lines) = read(f"arm:\n  {key}:\n    x: 1\n")

    assert section.node == "/arm"
    assert section.parameters["x"].value == 1
    assert lines == [
        f"warning: a.yaml:2: arm: {key!r} is misspelt; taken as 'ros__parameters'"
    ]


@pytest.mark.parametrize("key", ["ros", "parameters", "ros_parameter_server"])
def test_other_keys_are_names_of_nodes(read, key):
    ((section,), lines) = read(f"{key}:\n  ros__parameters:\n    x: 1\n")

    assert section.node == f"/{key}"
    assert lines == []


def test_a_node_may_be_called_ros_parameters(read):
    ((section,), lines) = read("ros_parameters: {ros__parameters: {x: 1}}")

    assert section.node == "/ros_parameters"
    assert lines == []


# Types of values


def rcl_value(text: str) -> bool | int | float | str:
    """Return what rcl's get_value makes of a text, with the C library's functions."""
    if text in TRUE or text in FALSE:
        return text in TRUE
    libc = ctypes.CDLL(None, use_errno=True)
    libc.strtol.restype, libc.strtod.restype = ctypes.c_long, ctypes.c_double
    end = ctypes.c_char_p()
    is_dotted = text.lstrip("+-").lower() in (".inf", ".nan")
    for convert, raw, *base in (
        (libc.strtol, text, 0),
        (libc.strtod, text.replace(".", "") if is_dotted else text),
    ):
        buffer = ctypes.create_string_buffer(raw.encode())
        ctypes.set_errno(0)
        value = convert(buffer, ctypes.byref(end), *base)
        if ctypes.get_errno() == 0 and not end.value and text:
            return value  # type: ignore[no-any-return]
    return text


@pytest.mark.parametrize(
    "text",
    [
        *TRUE,
        *FALSE,
        *("yES", "tRUE", "oN", "nULL", "null", "~", "Null"),
        *("0", "1", "-1", "+1", "00", "017", "08", "09.5", "0x1F", "-0X1f", "0o17"),
        *(
            "0x",
            "1_000",
            "1:30",
            "2026-01-31",
            "12abc",
            "--1",
            "+-1",
            "1-1",
            "1e",
            "e1",
        ),
        *("9223372036854775807", "9223372036854775808", "-9223372036854775808"),
        *("-9223372036854775809", "9" * 40, "0xFFFFFFFFFFFFFFFFF"),
        *(
            "1.0",
            "1.",
            ".5",
            "-.5",
            "+1.5e-3",
            "1e3",
            "1E+3",
            "1.e3",
            ".e3",
            ".",
            "1.2.3",
        ),
        *("1e308", "1e309", "-1e400", "1e-300", "1e-400", "0e-400", "0.0e999"),
        *("inf", "-inf", "Infinity", "INFINITY", "infinit", "nan", "NaN", "-nan"),
        *(".inf", ".Inf", "+.INF", "-.inf", ".nan", ".NaN", ".NAN", ".iNF"),
        *("joint1", "a/A", "1 2", "٣"),
    ],
)
def test_a_plain_scalar_has_the_type_that_rcl_gives_it(values, text):
    expected = rcl_value(text) if text != ".iNF" else text

    read = values(f"x: {text}")["x"]

    assert type(read) is type(expected)
    assert read == expected or (math.isnan(read) and math.isnan(expected))


@pytest.mark.parametrize("text", ["1", "1.5", "true", "y", ".inf", "", "0x10"])
@pytest.mark.parametrize("quote", ["'", '"'])
def test_quotes_make_a_text(values, text, quote):
    assert values(f"x: {quote}{text}{quote}") == {"x": text}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("!!str 12", "12"),
        ("!!str true", "true"),
        ("!!int '12'", 12),
        ("!!float 12", 12.0),
        ("!!float '1e3'", 1000.0),
        ("!!bool 'yes'", True),
        ("[!!str 1, a]", ["1", "a"]),
        ("!!seq [1, 2]", [1, 2]),
    ],
)
def test_a_tag_gives_the_type(values, text, value):
    read = values(f"x: {text}")["x"]

    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("!!int 1.5", "'1.5' is no int"),
        ("!!int x", "'x' is no int"),
        ("!!float x", "'x' is no float"),
        ("!!bool 1", "'1' is no bool"),
    ],
)
def test_a_value_that_doesnt_fit_its_tag_is_an_error(problem, text, message):
    assert problem(f"a:\n  ros__parameters:\n    x: {text}\n") == f"a.yaml:3: {message}"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[1, 2]", [1, 2]),
        ("[1.0, .inf]", [1.0, math.inf]),
        ("[yes, off]", [True, False]),
        ("['1', a]", ["1", "a"]),
        ("[]", []),
        ("\n  - a\n  - b", ["a", "b"]),
        ("\n- a\n- b", ["a", "b"]),
    ],
)
def test_a_list_has_values_of_one_type(values, text, value):
    assert values(f"x: {text}") == {"x": value}


def test_one_mapping_in_a_list_of_lists_is_read_through(values):
    read = values("x:\n  - interfaces:\n    - a\n    - b\n    more: {c: [1]}\ny: 1")

    assert read == {"x.interfaces": ["a", "b"], "x.more.c": [1], "y": 1}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2.0]", "expected values of one type, as rcl does (1 is first), got 2.0"),
        ("[1, a]", "expected values of one type, as rcl does (1 is first), got 'a'"),
        ("[on, 1]", "expected values of one type, as rcl does (True is first), got 1"),
        ("[[1], [2]]", "expected a list of single values, got [[1], [2]]"),
        ("[1, [2]]", "expected a list of single values, got [1, [2]]"),
        ("[{a: 1}]", "expected a list of values, got [{'a': 1}]"),
        (
            "[{a: [1]}, {b: [2]}]",
            "expected a list of values, got [{'a': [1]}, {'b': [2]}]",
        ),
        ("[1, {a: [1]}]", "expected a list of values, got [1, {'a': [1]}]"),
        ("[a, ]\n    y:\n      - a\n      -", ""),
    ],
)
def test_a_list_that_rcl_refuses_is_an_error(problem, text, message):
    where = "a.yaml:3: a.x: "
    if not message:
        where, message = "a.yaml:6: a.y: ", "expected a value, got None"

    assert problem(f"a:\n  ros__parameters:\n    x: {text}\n\n") == where + message


def test_a_parameter_without_a_value_is_not_given(read):
    ((section,), lines) = read("a:\n  ros__parameters:\n    x:\n    y: 1\n    z: {}\n")

    assert set(section.parameters) == {"y"}
    assert lines == [
        "warning: a.yaml:3: a.x: it has no value; rcl refuses the file; "
        "taken as not given",
        "warning: a.yaml:5: a.z: it is empty; it has no effect",
    ]


def test_aliases_are_taken_and_reported(read):
    ((section,), lines) = read(
        "a:\n  ros__parameters:\n    x: &x {p: 1}\n    y: {<<: *x, q: 2}\n    z: *x\n"
    )

    taken = {key: parameter.value for key, parameter in section.parameters.items()}
    assert taken == {"x.p": 1, "y.p": 1, "y.q": 2, "z.p": 1}
    assert lines == [
        "info: a.yaml:3: aliases and merges (`*`, `<<`) are refused by rcl; "
        "they are taken"
    ]


# TABs


def test_tabs_before_comments_and_after_values_are_taken(read):
    ((section,), lines) = read(
        "\t# first\n"
        "a:\n"
        "\t# before a key\n"
        "  ros__parameters:\t# after a key\n"
        "    x: 1\t# after a value\n"
        "\t\t # between\n"
        " \t\n"
        "    y:\t2\t\n"
        "    z: [1,\t2,\n\t\t3]\n"
        "    l:\n"
        "      - a\t\n"
        "\t# in a list\n"
        "      - b\n"
        "    t: 'a\tb\t# c'\n"
        "\t# last"
    )

    taken = {key: parameter.value for key, parameter in section.parameters.items()}
    assert taken == {"x": 1, "y": 2, "z": [1, 2, 3], "l": ["a", "b"], "t": "a\tb\t# c"}
    assert section.parameters["t"].line == 15
    assert lines == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a:\n\tros__parameters: {}\n", 2),
        ("a:\n  ros__parameters:\n  \tx: 1\n", 3),
        ("a:\n  ros__parameters:\n    x: 1\n\t\ty: 2\n", 4),
        ("a:\n  ros__parameters:\n    x:\n\t  - 2\n", 4),
    ],
)
def test_a_tab_that_indents_is_an_error(problem, text, line):
    assert problem(text) == (
        f"a.yaml:{line}: malformed YAML: a TAB indents this line; expected spaces"
    )


def test_carriage_returns_end_lines(read):
    ((section,), _) = read("a:\r\n  ros__parameters:\r\n    x: 1 # c\r\n    y: b\r\n")

    taken = {key: (p.value, p.line) for key, p in section.parameters.items()}
    assert taken == {"x": (1, 3), "y": ("b", 4)}


# Hostile and foreign files


@pytest.mark.parametrize(
    ("value", "tag"),
    [
        ("!!python/object/apply:os.mkdir [MARK]", "!!python/object/apply:os.mkdir"),
        ("[!!python/name:os.system x]", "!!python/name:os.system"),
        ("!!python/object/new:os.mkdir {args: [MARK]}", "!!python/object/new:os.mkdir"),
        ("!!python/tuple [1]", "!!python/tuple"),
        ("!!binary aGk=", "!!binary"),
        ("!!null ''", "!!null"),
        ("!mine {a: 1}", "!mine"),
    ],
)
def test_a_foreign_tag_is_refused_and_nothing_is_executed(
    problem, tmp_path, value, tag
):
    mark = tmp_path / "mark"
    text = value.replace("MARK", str(mark))

    message = problem(f"a:\n  ros__parameters:\n    x: {text}\n")

    assert message == (
        f"a.yaml:3: the tag {tag!r} is not taken; known: !!bool, !!float, !!int, !!str"
    )
    assert not mark.exists()


def test_a_tag_on_a_node_is_refused(problem):
    assert problem("a: !!python/dict {ros__parameters: {x: 1}}\n") == (
        "a.yaml:1: the tag '!!python/dict' is not taken; known: !!bool, !!float, "
        "!!int, !!str"
    )


BOMBS = {
    "lists": ("&l0 [1, 1]", "&l{i} [{refs}]"),
    "mappings": ("&l0 {a: 1}", "&l{i} {{{pairs}}}"),
    "merges": ("&l0 {a: 1}", "&l{i} {{<<: [{refs}]}}"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOMBS)
def test_a_bomb_of_aliases_ends_at_once_in_little_memory(tmp_path, kind):
    first, level = BOMBS[kind]
    text = f"a:\n  ros__parameters:\n    l0: {first}\n"
    for i in range(1, 30):
        refs = ", ".join([f"*l{i - 1}"] * 10)
        pairs = ", ".join(f"k{k}: *l{i - 1}" for k in range(10))
        text += f"    l{i}: {level.format(i=i, refs=refs, pairs=pairs)}\n"
    file = tmp_path / "bomb.yaml"
    file.write_text(text)
    code = (
        "import resource, sys, time; from pathlib import Path\n"
        "from arm_drake.description.report import LoadReport\n"
        "from arm_drake.description.ros_parameters import ParameterReader\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "start = time.process_time()\n"
        "try: ParameterReader({}, LoadReport()).read(Path(sys.argv[1]))\n"
        "except ValueError as error: print(error)\n"
        "print(time.process_time() - start)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )

    done = subprocess.run(
        [sys.executable, "-c", code, str(file)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )

    message, seconds, kilobytes = done.stdout.splitlines()
    assert message.startswith(f"{file}: malformed YAML: aliases multiply to ")
    assert float(seconds) < 2.0
    assert int(kilobytes) < 50_000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n\x00\x00", "can't be read: it is not UTF-8 text"),
        ("a: 1\n".encode("utf-16"), "can't be read: it is not UTF-8 text"),
    ],
)
def test_a_binary_file_is_an_error(tmp_path, content, message):
    file = tmp_path / "a.yaml"
    file.write_bytes(content)

    with pytest.raises(ParameterError) as caught:
        ParameterReader({}, LoadReport()).read(file)

    assert str(caught.value) == f"{file}: {message}"


@pytest.mark.parametrize("character", ["\0", "\x07", "\x1b", "\uffff"])
def test_a_character_that_is_in_no_text_is_an_error(problem, character):
    assert problem(f"a:\n  b: {character}\n") == (
        f"a.yaml:2: malformed YAML: the character {character!r} is in no text"
    )


def test_a_byte_order_mark_is_no_part_of_the_first_name(read):
    ((section,), _) = read("\ufeffarm: {ros__parameters: {x: 1}}")

    assert section.node == "/arm"


def test_a_large_file_is_refused_without_reading_it(tmp_path):
    file = tmp_path / "large.yaml"
    with file.open("wb") as stream:
        stream.write(os.urandom(MAX_SIZE))
        stream.truncate(100_000_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    with pytest.raises(ParameterError) as caught:
        ParameterReader({}, LoadReport()).read(file)

    assert str(caught.value) == f"{file}: can't be read: it is larger than 1 MB"
    # It was not read.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


def test_a_file_that_never_ends_is_refused():
    endless = Path("/dev/zero")

    with pytest.raises(ParameterError) as caught:
        ParameterReader({}, LoadReport()).read(endless)

    assert str(caught.value) == "/dev/zero: can't be read: it is larger than 1 MB"


@pytest.mark.slow
@pytest.mark.parametrize("opening", ["[", "{", "- ", "? ", "{a: ", "a: {"])
def test_what_is_nested_without_end_is_an_error(problem, opening):
    start = time.process_time()

    message = problem(opening * 20_000)

    assert message == "a.yaml: malformed YAML: nested too deeply"
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize(
    "text",
    [
        "joint_state_controller:\n  type: joint_state_controller/A\n",
        "arm:\n  joint_state_controller:\n    type: a/A\n    publish_rate: 50\n",
        "joints: [a]\narm: {type: a/A}\n",
    ],
)
def test_a_ros_1_configuration_is_called_so(problem, text):
    assert problem(text) == (
        "a.yaml: this is a ROS 1 configuration: no 'ros__parameters' anywhere; "
        "expected <node>: {ros__parameters: {...}}"
    )


def test_a_file_of_something_else_is_called_so(problem):
    assert problem("services: {web: {image: x}}\n") == (
        "a.yaml: no ROS 2 parameter file: no 'ros__parameters' anywhere; "
        "expected <node>: {ros__parameters: {...}}"
    )
