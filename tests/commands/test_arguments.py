"""Words of the command line: xacro arguments stand anywhere after ROBOT."""

import argparse
import re
from pathlib import Path

import pytest

from arm_drake.cli import main, make_parser, parse_arguments
from arm_drake.commands.arguments import add_page_arguments

A_B = [("a", "1"), ("b", "2")]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("check r", []),
        ("check r a:=1 b:=2", A_B),
        ("check r --json a:=1", [("a", "1")]),
        ("check --json r a:=1", [("a", "1")]),
        ("check r a:=1 --json b:=2 --strict c:= a:=3", [*A_B, ("c", ""), ("a", "3")]),
        ("sim r --controllers c.yaml a:=1", [("a", "1")]),
        ("sim r --pose 0 0 0 0 0 0 a:=-1 --headless", [("a", "-1")]),
        ("graph r -o d.svg a:=1", [("a", "1")]),
        ("view r --screenshot a.png a:=b:=1", [("a", "b:=1")]),
        ("view r --position j=1 a:=1", [("a", "1")]),
    ],
)
def test_xacro_arguments_stand_anywhere_after_the_robot(words, expected):
    options = parse_arguments(words.split())

    assert options.robot == "r"
    assert options.xacro_args == expected


def test_positions_end_where_xacro_arguments_begin():
    options = parse_arguments(
        ["view", "r", "--position", "0", "a:=1", "-1", "b:=2", "--json", "c:=3"]
    )

    assert options.position == ["0", "-1"]
    assert options.xacro_args == [("a", "1"), ("b", "2"), ("c", "3")]


def test_the_value_of_an_option_is_no_xacro_argument():
    options = parse_arguments(["sim", "r", "--name", "a:=1", "--var", "b=c:=2", "d:=3"])

    assert options.name == "a:=1"
    assert options.var == [("b", "c:=2")]
    assert options.xacro_args == [("d", "3")]


def test_one_command_line_leaves_nothing_for_the_next():
    parse_arguments(["check", "r", "--json", "a:=1"])

    assert parse_arguments(["check", "r"]).xacro_args == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("check r --json other", "unrecognized arguments: other"),
        (
            "check r --jsn a:=1",
            "unrecognized arguments: --jsn; did you mean '--json'?",
        ),
        (
            "sim r --durtion=3",
            "unrecognized arguments: --durtion=3; did you mean '--duration'?",
        ),
        (
            "check r --json a=b=1",
            "unrecognized arguments: a=b=1; did you mean 'a:=b=1'?",
        ),
        ("check r a:=1 --json -x:=1 b", "unrecognized arguments: -x:=1 b"),
        ("sim r --foo", "unrecognized arguments: --foo"),
        ("check r --json :=1", "expected NAME:=VALUE, got ':=1'"),
        ("list a:=1", "unrecognized arguments: a:=1"),
        (
            "sim r --duration -1",
            "argument --duration: expected a positive number, got '-1'",
        ),
    ],
)
def test_other_words_are_refused_in_one_line(capsys, words, message):
    with pytest.raises(SystemExit) as stop:
        parse_arguments(words.split())

    assert stop.value.code == 2
    err = capsys.readouterr().err
    program = "arm-drake" if ":=1'" in message else f"arm-drake {words.split()[0]}"
    assert err == (f"arm-drake: {message}; `{program} --help` tells more\n")


def test_the_options_that_the_docs_name_exist():
    docs = (Path(__file__).parents[2] / "docs/page.md").read_text(encoding="utf-8")
    parser = make_parser()
    helps = subparsers(parser)
    known = set(re.findall(r"--[a-z][a-z-]+", helps["view"] + helps["sim"]))

    named = set(re.findall(r"--[a-z][a-z-]+", docs))

    assert named
    assert named <= known


def test_every_option_of_a_page_is_in_the_docs():
    docs = (Path(__file__).parents[2] / "docs/page.md").read_text(encoding="utf-8")
    parser = argparse.ArgumentParser(add_help=False)
    add_page_arguments(parser)

    options = [word for action in parser._actions for word in action.option_strings]

    assert [option for option in options if option not in docs] == []


def test_the_options_of_logs_are_those_of_the_docs():
    docs = (Path(__file__).parents[2] / "docs/logs.md").read_text(encoding="utf-8")
    helps = subparsers(make_parser())
    own = set(re.findall(r"--[a-z][a-z-]+", helps["replay"] + helps["compare"]))

    named = set(re.findall(r"--[a-z][a-z-]+", docs))

    assert own - {"--help"} <= named
    assert named <= own | set(re.findall(r"--[a-z][a-z-]+", helps["sim"]))


def subparsers(parser):
    """Return the help of each command."""
    (commands,) = (
        action for action in parser._actions if hasattr(action.choices, "items")
    )
    return {name: sub.format_help() for name, sub in commands.choices.items()}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--log-images", "eye"], "--log-images says what else --log holds"),
        (["--log-images", "eye", "--log", "run.csv"], "give a .npz or .mcap file"),
        (["--image-format", "jpeg", "--log", "run.npz"], "of what --log-images logs"),
    ],
)
def test_pictures_of_a_log_need_one_that_takes_them(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "lab5_arm", "--headless", "--duration", "0.1", *words]) == 2
    assert told in capsys.readouterr().err
