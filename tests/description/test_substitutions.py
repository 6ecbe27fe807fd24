"""Substitutions and templates in parameter files get their values."""

from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.ros_parameters import ParameterReader
from arm_drake.errors import ParameterError


@pytest.fixture
def reader(tmp_path):
    """Return a function: variables -> reader, which finds the package "my_arm"."""
    package = tmp_path / "src" / "my_arm"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>my_arm</name></package>")

    def make_reader(report: LoadReport, **variables: str) -> ParameterReader:
        packages = PackageFinder(tmp_path / "a.urdf", [tmp_path / "src"])
        return ParameterReader(variables, report, packages)

    return make_reader


@pytest.fixture
def values(reader, tmp_path):
    """Return a function: text of parameters -> their values by name, and the report."""

    def read_values(text: str, **variables: str) -> tuple[dict[str, Any], list[str]]:
        file = tmp_path / "a.yaml"
        indented = "".join(f"    {line}\n" for line in text.splitlines())
        file.write_text(f"a:\n  ros__parameters:\n{indented}")
        report = LoadReport()
        (section,) = reader(report, **variables).read(file)
        lines = [str(e).replace(f"{tmp_path}/", "") for e in report]
        return {k: p.value for k, p in section.parameters.items()}, lines

    return read_values


@pytest.fixture
def problem(values, tmp_path):
    """Return a function: text of parameters -> message of its error."""

    def find_problem(text: str, **variables: str) -> str:
        with pytest.raises(ParameterError) as caught:
            values(text, **variables)
        return str(caught.value).replace(f"{tmp_path}/", "")

    return find_problem


@pytest.mark.parametrize("kind", ["var", "arg"])
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("$(KIND p)", "P"),
        ("$(KIND p)joint1", "Pjoint1"),
        ("a$(KIND p)b$(KIND p)c", "aPbPc"),
        ("[$(KIND p)1, b]", ["P1", "b"]),
        ("'$(KIND p)'", "P"),
        ('"$(KIND p)"', "P"),
        ("$(KIND 'p')", "P"),
        ("$( KIND   p )", "P"),
        ("$(KIND p q)", "P"),
        ("$(KIND nope q)", "q"),
        ("$(KIND nope '')x", "x"),
        ("$(KIND $(KIND name))", "P"),
        ("$(KIND rate)", 10),
        ("'$(KIND rate)'", "10"),
        ("$(KIND is_on)", True),
        ("$(KIND list)", ["a", "b"]),
        ("'$(KIND list)'", "[a, b]"),
        ("x)$(KIND p))", "x)P)"),
    ],
)
def test_a_variable_stands_for_its_value(values, kind, text, value):
    variables = {"p": "P", "name": "p", "rate": "10", "is_on": "on", "list": "[a, b]"}

    read, _ = values(f"x: {text.replace('KIND', kind)}", **variables)

    assert read == {"x": value}
    assert type(read["x"]) is type(value)


def test_a_variable_may_be_a_key(values):
    read, _ = values(
        "$(var p)joint1: {goal: 1.0}\n$(var p)joint1.trajectory: 2.0", p="l_"
    )

    assert read == {"l_joint1.goal": 1.0, "l_joint1.trajectory": 2.0}


def test_a_list_in_a_variable_keeps_the_line(reader, tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("a:\n  ros__parameters:\n    x: $(var list)\n")

    (section,) = reader(LoadReport(), list="[a, b]").read(file)

    assert section.parameters["x"].line == 3


def test_an_alias_of_a_list_in_a_variable_is_the_list(values):
    read, _ = values("x: &x $(var list)\ny: *x", list="[a, b]")

    assert read == {"x": ["a", "b"], "y": ["a", "b"]}


def test_the_environment_gives_values_unless_a_variable_does(values, monkeypatch):
    monkeypatch.setenv("SIDE", "left")
    monkeypatch.setenv("GIVEN", "environment")
    monkeypatch.delenv("NOPE", raising=False)

    read, _ = values(
        "a: $(env SIDE)_arm\nb: $(env SIDE right)\nc: $(env NOPE right)\n"
        "d: $(env NOPE '')x\ne: $(env GIVEN)",
        GIVEN="variable",
    )

    assert read == {
        "a": "left_arm",
        "b": "left",
        "c": "right",
        "d": "x",
        "e": "variable",
    }


@pytest.mark.parametrize("kind", ["find", "find-pkg-share"])
def test_a_package_stands_for_its_folder(values, tmp_path, kind):
    read, _ = values(f"x: $({kind} my_arm)/config\ny: $({kind} $(var p)_arm)", p="my")

    folder = tmp_path / "src" / "my_arm"
    assert read == {"x": f"{folder}/config", "y": str(folder)}


def test_comments_are_no_place_for_substitutions(values):
    read, lines = values(
        "# $(var none) and ${none}\n"
        "x: 1  # $(var none) and don't\n"
        "y: '# $(var p)'  # '$(var none)'\n"
        'z: "it\'s # $(var p)"\n'
        "w: it's#$(var p) # $(var none)",
        p="P",
    )

    assert read == {"x": 1, "y": "# P", "z": "it's # P", "w": "it's#P"}
    assert lines == []


def test_a_value_is_not_substituted_again(values):
    read, _ = values("x: $(var p)", p="$(var q)")

    assert read == {"x": "$(var q)"}


def test_all_that_has_no_value_is_named_at_once(problem, monkeypatch):
    monkeypatch.delenv("SIDE", raising=False)

    message = problem(
        "a: $(var b)$(var given)\n"
        "c: [$(arg d), $(var b)]\n"
        "e: {$(env SIDE): 1}\n"
        "g: $(find my_arm)",
        given="1",
    )

    assert message == (
        "a.yaml:3: $(var b), $(arg d) (line 4), $(env SIDE) (line 5) have no value; "
        "give them with variables={'b': ..., 'd': ..., 'SIDE': ...} "
        "(--var b=VALUE --var d=VALUE --var SIDE=VALUE)"
    )


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("$(command ls)", "ls"),
        ("$(eval 1 + 1)", "1 + 1"),
        ("$(dirname)", "dirname"),
        ("$(var)", "var"),
    ],
)
def test_other_substitutions_need_a_value(problem, values, text, name):
    assert problem(f"x: {text}") == (
        f"a.yaml:3: {text} has no value; give one with "
        f"variables={{{name!r}: ...}} (--var {name}=VALUE)"
    )
    assert values(f"x: {text}", **{name: "given"})[0] == {"x": "given"}


@pytest.mark.slow
def test_a_missing_package_is_an_error_of_the_one_who_needs_it(values):
    read, lines = values("x: $(find-pkg-share nope)/y\nz: 1")

    assert read == {"x": "$(find-pkg-share nope)/y", "z": 1}
    assert lines == [
        "error: a.yaml:3: package 'nope' not found; $(find-pkg-share nope) stays as it "
        "is; --package-path names the package's folder"
    ]


def test_a_variable_may_stand_for_a_package(values):
    read, _ = values("x: $(find-pkg-share nope)/y", nope="/opt/nope")

    assert read == {"x": "/opt/nope/y"}


def test_an_open_bracket_is_an_error(problem):
    assert problem("y: 1\nx: $(var p") == "a.yaml:4: '$(' without ')' in '$(var p'"


def test_templates_of_vendors_are_filled(values):
    read, lines = values(
        "x: [${p}joint1, <p>joint2]\n<p>joint1: 1.0\ny: '<p>'\nz: ${p}<s>",
        p="left_",
        s="_x",
    )

    assert read == {
        "x": ["left_joint1", "left_joint2"],
        "left_joint1": 1.0,
        "y": "left_",
        "z": "left__x",
    }
    assert lines == []


def test_templates_without_a_value_stay_and_are_reported(values):
    read, lines = values("x: ${p}joint1\ny: [<q>joint2, '${p}joint1']\nz: 1 < 2 > 1")

    assert read == {
        "x": "${p}joint1",
        "y": ["<q>joint2", "${p}joint1"],
        "z": "1 < 2 > 1",
    }
    assert lines == [
        "warning: a.yaml:3: the template '${p}' has no value; it stays as it is; "
        "--var p=VALUE, in Python variables={'p': ...}, fills it",
        "warning: a.yaml:4: the template '<q>' has no value; it stays as it is; "
        "--var q=VALUE, in Python variables={'q': ...}, fills it",
    ]


def test_variables_that_nothing_asks_for_are_known(reader, tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text("a:\n  ros__parameters:\n    x: $(var p)${q}<r> # $(var t)\n")
    parameters = reader(LoadReport(), p="1", q="2", r="3", s="4", t="5")

    parameters.read(Path(file))

    assert parameters.substitutions.unused == ["s", "t"]
