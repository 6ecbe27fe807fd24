"""xacro without ROS: packages, arguments, and errors with their place."""

import contextlib
import os
import time
from pathlib import Path

import psutil
import pytest
import xacro
from xacro import substitution_args

from arm_drake.description import xacro as description_xacro
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.xacro import (
    declared_arguments,
    expand_xacro,
    expanding_ahead,
)
from arm_drake.errors import DescriptionError, PackageError
from tests.description.patience import within
from tests.waiting import wait_until

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


def robot(body: str) -> str:
    return f'<robot name="r" {NAMESPACE}>\n{body}\n</robot>'


@pytest.fixture
def expand(tmp_path):
    """Return a function: body of robot.xacro, arguments -> URDF text."""

    def expand_text(body: str, **args: object) -> str:
        path = tmp_path / "robot.xacro"
        path.write_text(body if body.startswith("<!") else robot(body), "utf-8")
        return expand_xacro(path, args, PackageFinder(path))

    return expand_text


def test_macros_properties_and_expressions_are_expanded(expand):
    text = expand(
        '<xacro:property name="r" value="2"/>'
        '<xacro:macro name="ball" params="name"><link name="${name}_${r * 3}"/>'
        '</xacro:macro><xacro:ball name="ball"/>'
    )

    assert '<link name="ball_6"/>' in text


def test_a_plain_urdf_is_returned_as_it_is(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text('<robot  name="r"/> <!-- é -->', encoding="utf-8")

    text = expand_xacro(path, {}, PackageFinder(path))

    assert text == '<robot  name="r"/> <!-- é -->'


def test_the_files_that_are_read_are_reported(tmp_path):
    part, entry = tmp_path / "part.xacro", tmp_path / "robot.xacro"
    part.write_text(robot('<xacro:property name="r" value="2"/>'), encoding="utf-8")
    include = '<xacro:include filename="{}.xacro"/>'
    missing = tmp_path / "none.xacro"
    bodies = ["<link/>", include.format("part")]
    bodies.append(bodies[1] + include.format("none"))

    reported: list[set[Path]] = []
    for body in bodies:
        entry.write_text(robot(body) if "xacro" in body else body, encoding="utf-8")
        reported.append(set())
        with contextlib.suppress(DescriptionError):
            expand_xacro(entry, {}, PackageFinder(entry), files=reported[-1])

    assert reported == [{entry}, {entry, part}, {entry, part, missing}]


def test_a_plain_urdf_may_be_latin_1_or_start_with_a_mark(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes('<robot name="é"/>'.encode("latin-1"))
    assert expand_xacro(path, {}, PackageFinder(path)) == '<robot name="é"/>'

    path.write_bytes('<robot name="é"/>'.encode("utf-8-sig"))
    assert expand_xacro(path, {}, PackageFinder(path)) == '<robot name="é"/>'


def test_an_argument_has_its_default_or_the_given_value(expand):
    body = '<xacro:arg name="side" default="left"/><link name="$(arg side)"/>'

    assert '<link name="left"/>' in expand(body)
    assert '<link name="right"/>' in expand(body, side="right")
    assert '<link name="2"/>' in expand(body, side=2)


def test_an_argument_given_once_doesnt_leak_into_the_next_expansion(expand):
    body = '<xacro:arg name="side" default="left"/><link name="$(arg side)"/>'
    expand(body, side="right")

    assert '<link name="left"/>' in expand(body)


@pytest.mark.parametrize("ahead", ["the same", "other arguments", "another file"])
def test_an_expansion_that_began_ahead_ends_as_any_other(tmp_path, monkeypatch, ahead):
    path = tmp_path / "arm.xacro"
    path.write_text(robot('<xacro:arg name="a" default=""/><link name="$(arg a)"/>'))
    other = tmp_path / "other.xacro"
    other.write_text(robot('<link name="another"/>'))
    begun = []
    start = description_xacro._Expansion.__init__

    def note(expansion, path, args):
        begun.append((path, args))
        start(expansion, path, args)

    monkeypatch.setattr(description_xacro._Expansion, "__init__", note)
    args = {"a": "arm"} if ahead != "other arguments" else {"a": "leg"}
    with expanding_ahead(path if ahead != "another file" else other, args):
        text = expand_xacro(path, {"a": "arm"}, PackageFinder(path))

    assert '<link name="arm"/>' in text
    assert len(begun) == (1 if ahead == "the same" else 2)
    assert '<link name="arm"/>' in expand_xacro(path, {"a": "arm"}, PackageFinder(path))


@pytest.mark.parametrize("end", ["unused", "plain", "died"])
def test_no_process_stays_of_an_expansion_that_began_ahead(tmp_path, end):
    path = tmp_path / "arm.xacro"
    path.write_text('<robot name="r"/>' if end == "plain" else robot(""))
    before = set(psutil.Process().children())

    with expanding_ahead(path, {}):
        (child,) = set(psutil.Process().children()) - before
        if end == "plain":
            expand_xacro(path, {}, PackageFinder(path))
            assert not child.is_running()
        elif end == "died":
            child.kill()
            wait_until(lambda: child.status() == psutil.STATUS_ZOMBIE)
            description_xacro._ahead[0]._send(None)

    assert not child.is_running()


def test_an_argument_doesnt_leak_after_an_error(expand):
    declared = '<xacro:arg name="side" default="left"/>'
    with pytest.raises(DescriptionError):
        expand(f"{declared}${{nope}}", side="right")

    with pytest.raises(DescriptionError) as caught:
        expand('<link name="$(arg side)"/>')

    assert "xacro argument 'side' is undefined" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "known"),
    [
        ("<xacro:if value=\"${side == 'left' or 'up' != side}\"/>", "left"),
        ("<xacro:if value=\"${'$(arg side)' == 'a b'}\"/>", "a b"),
        ("<xacro:if value=\"${side not in ['x', 'y-1']}\"/>", "x, y-1"),
        ('<link name="${side2 == 3}" file="$(arg side)"/>', ""),
        ('<xacro:m file="$(find arm)/of_$(arg side).yaml"/>', "left, right"),
        ('<xacro:m file="$(find nothing)/of_$(arg side).yaml"/>', ""),
        ('<xacro:include filename="of_$(arg side).yaml"/>', "left, right"),
        ('<xacro:include filename="of_$(arg side)/a/arm.xacro"/>', "up"),
    ],
)
def test_values_that_files_know_of_an_argument_are_reported(
    expand, tmp_path, body, known
):
    (tmp_path / "package.xml").write_text("<name>arm</name>", encoding="utf-8")
    for name in ("of_left.yaml", "of_right.yaml", "of_none.txt", "right.yaml"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    (tmp_path / "of_up/a").mkdir(parents=True)
    (tmp_path / "of_up/a/arm.xacro").write_text(robot(""), encoding="utf-8")

    with pytest.raises(DescriptionError) as caught:
        expand(f'<link name="$(arg side)"/>{body}')

    words = f" (the files know {known})" if known else ""
    assert f"give it as side:=VALUE{words}; the file declares: none" in str(
        caught.value
    )


def test_a_missing_yaml_file_is_reported_with_those_that_are_there(expand, tmp_path):
    (tmp_path / "mk3.yaml").write_text("{}", encoding="utf-8")

    with pytest.raises(DescriptionError) as caught:
        expand("${xacro.load_yaml('mk4.yaml')}")

    assert str(caught.value).endswith("; did you mean 'mk3.yaml'?")


def test_find_gives_the_folder_of_a_package(expand, tmp_path):
    (tmp_path / "package.xml").write_text("<name>arm</name>", encoding="utf-8")
    part = robot('<link name="included"/>')
    (tmp_path / "part with space é.xacro").write_text(part, encoding="utf-8")

    text = expand('<xacro:include filename="$(find arm)/part with space é.xacro"/>')

    assert '<link name="included"/>' in text


MACROS = """<xacro:macro name="foot" params="side">
<link name="${sid}"/>
</xacro:macro>
<xacro:macro name="leg" params="side">
<xacro:foot side="${side}"/>
</xacro:macro>"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            '<xacro:arg name="a" default="1"/><xacro:arg default="" name="b"/>$(arg c)',
            "{file}:2: xacro argument 'c' is undefined; give it as c:=VALUE; "
            "the file declares: a:=1, b:=",
        ),
        (
            "$(arg c)",
            "{file}:2: xacro argument 'c' is undefined; give it as c:=VALUE; "
            "the file declares: none",
        ),
        ("${1 / 0}", "{file}:2: division by zero when evaluating expression '1 / 0'"),
        ("$(eval 1 / 0)", "{file}:2: division by zero"),
        (
            "${x}",
            "{file}:2: name 'x' is not defined when evaluating expression 'x'; "
            "known: none",
        ),
        ("${1", "{file}:2: invalid expression: ${{1"),
        (
            "${''.__class__}",
            "{file}:2: Use of invalid name(s): __class__ when evaluating expression "
            "'''.__class__'",
        ),
        (
            "$(env NO_SUCH_THING)",
            "{file}:2: environment variable 'NO_SUCH_THING' is not set",
        ),
        ("<xacro:nope/>", "{file}:2: unknown macro name: xacro:nope; known: none"),
        (
            '<xacro:if value="maybe"/>',
            '{file}:2: Xacro conditional "maybe" evaluated to "maybe", which is not a '
            "boolean expression.",
        ),
        (
            "<xacro:property/>",
            "{file}:2: xacro:property: missing attribute 'name'",
        ),
        (
            "<a>\n</b>",
            "{file}:3: malformed XML: mismatched tag, inside <a> of line 2: '</b>'",
        ),
        ("<other:a/>", "{file}:2: malformed XML: unbound prefix: '<other:a/>'"),
        (
            '<xacro:include filename="nope.xacro"/>',
            "{file}:2: '{folder}/nope.xacro' can't be read: No such file or directory; "
            "there are 'broken.xacro', 'macros.xacro', 'outer.xacro', 'robot.xacro'",
        ),
        (
            "${xacro.load_yaml('nope.yaml')}",
            "{file}:2: '{folder}/nope.yaml' can't be read: No such file or directory",
        ),
        (
            '<xacro:include filename="outer.xacro"/>',
            "{folder}/outer.xacro:2: '{folder}/inner.xacro' can't be read: No such "
            "file or directory; there are 'broken.xacro', 'macros.xacro', "
            "'outer.xacro', 'robot.xacro' (included by {file})",
        ),
        (
            '<xacro:property name="length" value="1"/>\n\n<a b="${lenght}"/>',
            "{file}:4: name 'lenght' is not defined when evaluating expression "
            "'lenght'; did you mean 'length'? known: length",
        ),
        (
            "<a>\n\n  ${1 +* 2}</a>",
            "{file}:4: invalid syntax when evaluating expression '1 +* 2'",
        ),
        (
            '<xacro:arg name="size" default="1"/>\n$(eval 2 * sice)',
            "{file}:3: name 'sice' is not defined; did you mean 'size'? known: size",
        ),
        (
            '<xacro:macro name="leg" params="a *b"/>\n<xacro:lag/>',
            "{file}:3: unknown macro name: xacro:lag; did you mean 'leg'? known: leg",
        ),
        (
            '<xacro:macro name="leg" params="a b"/>\n<xacro:leg a="1"/>',
            "{file}:3: macro 'leg': Undefined parameters [b]; its parameters: a, b",
        ),
        (
            '<xacro:include filename="macros.xacro"/>\n<xacro:leg side="left"/>',
            "{folder}/macros.xacro:3: name 'sid' is not defined when evaluating "
            "expression 'sid'; did you mean 'side'? known: side (in macro 'foot', "
            "called at {folder}/macros.xacro:6, in macro 'leg', called at {file}:3)",
        ),
        (
            '<xacro:include filename="broken.xacro"/>',
            "{folder}/broken.xacro:2: malformed XML: mismatched tag, inside <robot> "
            "of line 1: '</a>'",
        ),
    ],
)
def test_an_error_says_where_and_what(expand, tmp_path, body, message):
    outer = robot('<xacro:include filename="inner.xacro"/>')
    (tmp_path / "outer.xacro").write_text(outer, encoding="utf-8")
    (tmp_path / "broken.xacro").write_text("<robot>\n</a>", encoding="utf-8")
    (tmp_path / "macros.xacro").write_text(robot(MACROS), encoding="utf-8")

    with pytest.raises(DescriptionError) as caught:
        expand(body)

    places = {"file": tmp_path / "robot.xacro", "folder": tmp_path}
    assert str(caught.value) == message.format(**places)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (
            '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
            "nested too deeply; macros that call each other: ['m']",
        ),
        (
            '<xacro:include filename="robot.xacro"/>',
            "includes itself: {folder}/robot.xacro -> {folder}/robot.xacro",
        ),
        (
            '<xacro:include filename="$(find other)/part.xacro"/>',
            "includes itself: {folder}/other/part.xacro -> {folder}/again.xacro -> "
            "{folder}/other/part.xacro",
        ),
    ],
)
def test_an_endless_recursion_ends_in_an_error(expand, tmp_path, body, problem):
    (tmp_path / "package.xml").write_text("<name>arm</name>", encoding="utf-8")
    (tmp_path / "other").mkdir()
    (tmp_path / "other/package.xml").write_text("<name>other</name>", encoding="utf-8")
    again = robot('<xacro:include filename="$(find other)/part.xacro"/>')
    (tmp_path / "again.xacro").write_text(again, encoding="utf-8")
    part = robot('<xacro:include filename="$(find arm)/again.xacro"/>')
    (tmp_path / "other/part.xacro").write_text(part, encoding="utf-8")

    with pytest.raises(DescriptionError) as caught:
        expand(body)

    assert str(caught.value).endswith(f": {problem.format(folder=tmp_path)}")


@pytest.mark.slow
def test_a_missing_package_is_named_with_who_asked(expand, tmp_path):
    with pytest.raises(PackageError) as caught:
        expand('<xacro:include filename="$(find nope)/a.xacro"/>')

    file = tmp_path / "robot.xacro"
    assert str(caught.value).startswith(
        f"{file}: package 'nope' (asked for by {file}:2) not found; name the folder "
        "that holds it with package_paths (--package-path); "
    )


@pytest.mark.slow
def test_all_missing_packages_are_named_at_once(expand, tmp_path):
    part = robot(
        """
        <!-- <xacro:include filename="$(find unused)/a.xacro"/> -->
        <xacro:include filename="$(find two)/a.xacro"/>
        <xacro:macro name="m" params="p"><m file="$(find ${p})/a.stl"/></xacro:macro>
        <link name="a"><visual><geometry><mesh filename="package://three/a.stl"/>
        </geometry></visual></link>
        """
    )
    (tmp_path / "part.xacro").write_text(part, encoding="utf-8")

    with pytest.raises(PackageError) as caught:
        expand(
            """
            <xacro:include filename="part.xacro"/>
            <xacro:include filename="$(find one)/a.xacro"/>
            <xacro:include filename="$(find one)/b.xacro"/>
            """
        )

    file = tmp_path / "robot.xacro"
    assert str(caught.value) == (
        f"{file}: 3 packages not found: 'one' (asked for by {file}:4, {file}:5), "
        f"'two' (asked for by {tmp_path / 'part.xacro'}:4), "
        f"'three' (asked for by {tmp_path / 'part.xacro'}:6); name the folders that "
        "hold them with package_paths (--package-path)"
    )


def test_all_missing_files_are_named_at_once(expand, tmp_path):
    with pytest.raises(DescriptionError) as caught:
        expand(
            """
            <xacro:include filename="1.xacro"/>
            <xacro:include filename="0.xacro" optional="true"/>
            <xacro:include filename="2.xacro"/>
            """
        )

    file = tmp_path / "robot.xacro"
    assert str(caught.value) == (
        f"{file}:3: 2 files don't exist: '{tmp_path / '1.xacro'}' (asked for by "
        f"{file}:3), '{tmp_path / '2.xacro'}' (asked for by {file}:5)"
    )


def test_errors_name_the_files_of_the_source_tree(expand, tmp_path):
    cmake = "install(DIRECTORY src/urdf DESTINATION share/arm)"
    (tmp_path / "package.xml").write_text("<name>arm</name>", encoding="utf-8")
    (tmp_path / "CMakeLists.txt").write_text(cmake, encoding="utf-8")
    (tmp_path / "src" / "urdf").mkdir(parents=True)
    part = tmp_path / "src" / "urdf" / "part.xacro"
    part.write_text(robot("${nope}"), encoding="utf-8")

    with pytest.raises(DescriptionError) as caught:
        expand('<xacro:include filename="$(find arm)/urdf/part.xacro"/>')

    assert str(caught.value).startswith(f"{part}:2: name 'nope' is not defined")


def test_a_file_larger_than_any_description_is_refused_unread(tmp_path):
    path = tmp_path / "robot.xacro"
    with path.open("wb") as file:
        file.truncate(100 * 2**20)

    with pytest.raises(DescriptionError) as caught:
        expand_xacro(path, {}, PackageFinder(path))

    problem = "100 MB; a description has at most 64 MB"
    assert str(caught.value) == f"{path}: {problem}"


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        (
            robot('<xacro:arg name="side" default=""/>'),
            "did you mean 'side'? known: side",
        ),
        (robot("<link/>"), "known: none"),
        ('<robot name="r"/>', "known: none"),
    ],
)
def test_an_argument_that_the_file_doesnt_have_is_reported(tmp_path, text, hint):
    path, report = tmp_path / "robot.xacro", LoadReport()
    path.write_text(text, encoding="utf-8")

    expand_xacro(path, {"sied": "left"}, PackageFinder(path), report)

    (line,) = map(str, report)
    problem = f"no xacro argument 'sied'; {hint}; it has no effect"
    assert line == f"warning: {path}: {problem}"


def test_an_argument_of_an_included_file_can_be_given(expand, tmp_path):
    part = robot('<xacro:arg name="side" default="left"/><link name="$(arg side)"/>')
    (tmp_path / "part.xacro").write_text(part, encoding="utf-8")

    text = expand('<xacro:include filename="part.xacro"/>', side="right")

    assert '<link name="right"/>' in text


def test_a_missing_file_is_an_error(tmp_path):
    path = tmp_path / "robot.xacro"

    with pytest.raises(DescriptionError) as caught:
        expand_xacro(path, {}, PackageFinder(path))

    assert str(caught.value) == f"{path}: can't be read: No such file or directory"


@pytest.mark.parametrize(
    ("text", "declared"),
    [
        ('<xacro:arg name="a" default="1"/>', {"a": "1"}),
        ("<xacro:arg  default = '1'\n name = 'a' />", {"a": "1"}),
        ('<xacro:arg name="a"/>', {"a": None}),
        ('<xacro:arg name="a" default=""/>', {"a": ""}),
        ("<arg name='a'/>", {}),
    ],
)
def test_declared_arguments_are_read_with_their_defaults(text, declared):
    assert declared_arguments(text) == declared


@pytest.mark.parametrize(
    "doctype",
    [
        '<!DOCTYPE r [<!ENTITY e SYSTEM "secret.txt">]>',
        '<!DOCTYPE r [<!ENTITY e SYSTEM "file://{secret}">]>',
        '<!DOCTYPE r [<!ENTITY % p SYSTEM "file://{secret}"> %p; <!ENTITY e "">]>',
    ],
)
def test_an_external_entity_is_not_read(expand, tmp_path, doctype):
    secret = tmp_path / "secret.txt"
    secret.write_text("the secret", encoding="utf-8")

    text = expand(doctype.format(secret=secret) + robot("<link>&e;</link>"))

    assert "the secret" not in text


@pytest.mark.slow
def test_entities_that_multiply_end_in_an_error_at_once(expand, tmp_path):
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    start = time.process_time()

    with pytest.raises(DescriptionError) as caught:
        expand(f'<!DOCTYPE r [<!ENTITY e0 "lol">{entities}]>' + robot("&e11;"))

    assert str(caught.value) == (
        f"{tmp_path / 'robot.xacro'}:2: malformed XML: limit on input amplification "
        "factor (from DTD and entities) breached"
    )
    assert time.process_time() - start < 2.0


def test_what_xacro_warns_about_is_in_the_report(tmp_path, capsys):
    path = tmp_path / "robot.xacro"
    (tmp_path / "a.yaml").write_text("b: 1", encoding="utf-8")
    path.write_text(robot("<link name=\"${load_yaml('a.yaml')['b']}\"/>"))
    report = LoadReport()

    expand_xacro(path, {}, PackageFinder(path), report)

    assert str(report) == (
        f"info: {path}: Using load_yaml() directly is deprecated. Use "
        "xacro.load_yaml() instead.; so says xacro"
    )
    assert capsys.readouterr() == ("", "")


def test_what_xacro_calls_an_error_is_one_with_its_place(tmp_path):
    path = tmp_path / "robot.xacro"
    macro = "<xacro:macro name=\"m\">${xacro.error('no hand')}</xacro:macro>"
    path.write_text(robot(f"{macro}<link name='a'/><xacro:m/>"))
    report = LoadReport()

    expand_xacro(path, {}, PackageFinder(path), report)

    (told,) = report
    where = f"when instantiating macro: m ({path}), in file: {path}"
    assert (told.severity, told.what) == ("error", f"no hand ({where})")


# Ways from an expression to a function that makes the file TARGET.
SYSTEM = (
    "[c for c in ().__class__.__base__.__subclasses__() if c.__name__=='_wrap_close']"
    "[0].__init__.__globals__['system']('touch TARGET')"
)
GETTER = "python.vars(python.type(xacro.load_yaml))['__globals__']"
ESCAPES = [
    f"(lambda: {SYSTEM})()",
    f"[{SYSTEM} for x in [1]]",
    # Letters that Python takes for underscores.
    f"(lambda: {SYSTEM})()".replace("__class__", "_\uff3fclass\uff3f_"),
    # Neither with underscores: the frame of a generator, and a name in a text.
    "(lambda g: [g.append((g[0].gi_frame.f_back.f_back.f_back.f_globals['os']"
    ".system('touch TARGET') for _ in [1])), list(g[0])])([])",
    f"python.vars(python.type({GETTER}))['__get__']({GETTER}, xacro.load_yaml)['os']"
    ".system('touch TARGET')",
]


@pytest.mark.parametrize("index", range(len(ESCAPES)))
def test_an_expression_runs_no_program(expand, tmp_path, index):
    target = tmp_path / "made"
    expression = ESCAPES[index].replace("TARGET", str(target))

    with pytest.raises(DescriptionError, match=r"invalid name|'vars' is not defined"):
        expand(f'<link name="${{{expression}}}"/>')

    assert not target.exists()


@pytest.mark.parametrize(
    "call",
    [
        "open('TARGET', 'w')",
        "exec('open(\\'TARGET\\', \\'w\\')')",
        "getattr(str, 'join')",
        f"(lambda: {SYSTEM})()",
    ],
)
def test_an_argument_expression_runs_no_program(expand, tmp_path, call):
    target = tmp_path / "made"
    call = call.replace("TARGET", str(target))

    # xacro reads $(eval) up to the first bracket; a property may hold more of them.
    with pytest.raises(DescriptionError, match=r"not defined|double underscore"):
        expand(f'<xacro:property name="e" value="{call}"/><a b="$(eval ${{e}})"/>')

    assert not target.exists()


@pytest.mark.parametrize(
    "expression",
    [
        r"'{0.__globals__[os]\x7d'.format(xacro.load_yaml)",
        r"'{a.__globals__[os]\x7d'.format_map(dict(a=xacro.load_yaml))",
        r"list(map(str.format, ['{0.__globals__[os]\x7d'], [xacro.load_yaml]))",
        r"'{0:{1.__globals__[os]\x7d\x7d'.format(1, xacro.load_yaml)",
        "python.type('A', (), dict(a=1))",
        "[0 for xacro.dotify.wrap in [1]]",
        "__mul(2, 3)",
    ],
)
def test_an_expression_reaches_nothing_outside(expand, expression):
    with pytest.raises(DescriptionError):
        expand(f'<link name="${{{expression}}}"/>')


@pytest.mark.slow
@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2**3 + 2*3", "14"),
        ("-2**2", "-4"),
        ("2.0**-1", "0.5"),
        ("[0]*2 + ['a'*2]", "[0, 0, 'aa']"),
        ("(lambda f_x: f_x*2)(4)", "8"),
        ("[x*y for x in [1, 2] for y in [3]]", "[3, 6]"),
        (r"'{\x7d_{a[0]:.2f\x7d'.format('x', a=[1.5])", "x_1.50"),
        (r"list(map(str.format, ['{\x7d!'], [1]))", "['1!']"),
        ("xacro.dotify(dict(format=3)).format", "3"),
        ("python.type(1) == int", "True"),
        ("python.sum(python.range(4))", "6"),
        ("radians(180) == math.pi", "True"),
    ],
)
def test_an_expression_has_the_value_that_python_gives_it(expand, expression, value):
    assert f'<link name="{value}"/>' in expand(f'<link name="${{{expression}}}"/>')


def test_an_argument_expression_knows_numbers_texts_and_mathematics(expand):
    text = expand('<xacro:arg name="n" default="3"/><a b="$(eval n * 2 + pi > 9)"/>')
    assert '<a b="True"/>' in text

    call = "max(len('ab'), int('7'))"
    text = expand(f'<xacro:property name="e" value="{call}"/><a b="$(eval ${{e}})"/>')
    assert '<a b="7"/>' in text


DOUBLING = '<xacro:macro name="m0" params=""><link/></xacro:macro>' + "".join(
    f'<xacro:macro name="m{i + 1}" params=""><xacro:m{i}/><xacro:m{i}/></xacro:macro>'
    for i in range(40)
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "body",
    [
        '<link name="${9**9**9}"/>',
        '<link name="${math.factorial(10**7)}"/>',
        '<link name="${[n for n in range(10**12) if n < 0]}"/>',
        DOUBLING + "<xacro:m40/>",
    ],
    ids=["power", "factorial", "loop", "macros"],
)
def test_an_expansion_that_takes_too_long_is_an_error(expand, monkeypatch, body):
    monkeypatch.setattr(description_xacro, "CPU_TIME", 1)
    problem = "xacro takes more than 1 s of processor time"

    with within(30.0), pytest.raises(DescriptionError, match=problem):
        expand(body.replace("< 0", "&lt; 0"))


@pytest.mark.parametrize(
    "expression",
    [
        "'a'*10**12",
        "[0]*10**12",
        "1 &lt;&lt; 10**12",
        "'%2000000000d' % 1",
        "list(range(10**9))",
    ],
)
def test_an_expansion_that_takes_too_much_memory_is_an_error(expand, expression):
    with within(30.0), pytest.raises(DescriptionError, match="more than 1024 MB of"):
        expand(f'<link name="${{{expression}}}"/>')


def test_an_expansion_to_more_than_any_description_has_is_an_error(expand, monkeypatch):
    monkeypatch.setattr(description_xacro, "MAX_SIZE", 2**20)

    with pytest.raises(DescriptionError, match="expands to more than 1 MB"):
        expand("<link name=\"${'a' * 1100000}\"/>")


def test_what_an_expression_changes_doesnt_leak_into_the_next_expansion(expand):
    expand('<a b="${math.update(pi=3)}"/><a b="${python.update(len=str)}"/>')

    assert '<a b="3.14"/>' in expand('<a b="${round(math.pi, 2)}"/>')
    assert "eval" not in vars(substitution_args)
    assert "open" not in vars(xacro)


@pytest.mark.parametrize(
    "body",
    [
        '<xacro:include filename="pipe"/>',
        "${xacro.load_yaml('pipe')}",
        "${load_yaml('pipe')}",
    ],
)
def test_a_pipe_is_not_read(expand, tmp_path, body):
    os.mkfifo(tmp_path / "pipe")

    with within(10.0), pytest.raises(DescriptionError) as caught:
        expand(body)

    file, pipe = tmp_path / "robot.xacro", tmp_path / "pipe"
    assert str(caught.value) == f"{file}:2: '{pipe}' can't be read: Not a regular file"


def test_a_description_that_is_a_pipe_is_not_read(tmp_path):
    path = tmp_path / "robot.xacro"
    os.mkfifo(path)

    with within(10.0), pytest.raises(DescriptionError) as caught:
        expand_xacro(path, {}, PackageFinder(path))

    assert str(caught.value) == f"{path}: can't be read: Not a regular file"


def test_an_included_file_of_a_name_that_none_can_have_is_missing(expand):
    with pytest.raises(DescriptionError, match="File name too long"):
        expand(f'<xacro:include filename="{"n" * 300}"/>')
