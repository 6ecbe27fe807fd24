"""Processes of launch files that make files from others."""

import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.launch.shell import write_files
from tests.launch.packages import describe, make_package, write_launch

TEMPLATE = "first: <name>/a <name>\nsecond: 1+1 (x) a|b\n"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return make_package(tmp_path)


def no_xacro(file: str, arguments: Mapping[str, str]) -> str:
    raise AssertionError


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["cp", "{old}", "{new}"], TEMPLATE),
        (["bash", "-c", "cat {old} > {new}"], TEMPLATE),
        (
            ["sh", "-c", "mkdir -p {new}s && cp {old} {new}s/x; cp {old} {new}"],
            TEMPLATE,
        ),
        (
            ["bash", "-c", "sed \\\n -e 's|<name>|b c|g' \\\n {old} > {new}\n"],
            "first: b c/a b c\nsecond: 1+1 (x) a|b\n",
        ),
        (
            ["bash", "-c", "cp {old} '{new}' && sed -i -e \"s|<name>|q|\" {new}"],
            "first: q/a <name>\nsecond: 1+1 (x) a|b\n",
        ),
        (
            ["bash", "-c", "sed 's/<name>\\/a/\\/b/;' {old} > {new}"],
            None,
        ),
        (
            ["bash", "-c", "sed 's/<name>\\/a/\\/b/' {old} > {new}"],
            "first: /b <name>\nsecond: 1+1 (x) a|b\n",
        ),
        # Without -E these are themselves, and with a backslash special; not so with it.
        (
            ["bash", "-c", "sed -e 's,1+1 (x),\\&,' {old} > {new}"],
            "first: <name>/a <name>\nsecond: & a|b\n",
        ),
        (
            ["bash", "-c", "sed -e 's,\\(f\\)ir*,\\1\\1[&],' {old} > {new}"],
            "ff[fir]st: <name>/a <name>\nsecond: 1+1 (x) a|b\n",
        ),
        (
            ["bash", "-c", "sed -E 's,(1)\\+1,\\1,' {old} > {new}"],
            "first: <name>/a <name>\nsecond: 1 (x) a|b\n",
        ),
        (["bash", "-c", "cat {old} | tr a b > {new}"], None),
        (["bash", "-c", "cp {old} {new} || rm {old}"], None),
        (["bash", "-c", "cp {old} {new}; rm {old}"], None),
        (["bash", "-c", "sed -n p {old} > {new}"], None),
        (["bash", "-c", "sed 's|(|\\(|g' {old} > {new}"], "first"),
        (["bash", "-c", "sed 's|[|b|' {old} > {new}"], None),
        (["bash", "-c", "cat '{old} > {new}"], None),
        (["cp", "{old}s", "{new}"], None),
        (["sed", "-e", "s|a|b|", "{old}"], None),
        (["bash", "-c", "xacro --inorder {old} > {new}"], None),
        (["touch", "{new}"], None),
        ([], None),
    ],
)
def test_commands_write_what_a_shell_does(
    tmp_path: Path, words: list[str], expected: str | None
) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_text(TEMPLATE)

    made = write_files([w.format(old=old, new=new) for w in words], no_xacro)

    assert made == (expected is not None)
    assert old.read_text() == TEMPLATE
    if expected is None:
        assert not new.exists()
    else:
        assert new.read_text().startswith(expected)


# Of what a shell and sed make the same, and of what nothing is done.
ODD = "a <n> ${v} $(f p) 1+1 a.b*c [k]  \r\n\x0bx: ü^y {z}\u2028a a\n\nlast, b"
SAME = r"""
    s/[^,]*$/E/ | s/n>[^,]*/N/ | s/\s*$// | s/$/x/g | s/^/x/g | s/^./T/ | s/\r$//
    s/${v}/V/ | s/$(f p)/V/ | s/ü^y/V/ | s/{z}/V/ | s/\${v}/V/ | s/x$y/V/ | s/^*/V/
    s/[[:space:]]/_/g | s/[^[:alpha:]]*/_/ | s/\<a\>/W/g | s/\ba/W/g | s/[]k]/V/g
    s/a/b\nc/ | s/a/b\tc/ | s/a*/-/ | s/a\{1,2\}/V/ | s/\(a\) .*\1/<\1&>/
    s/a/\&/ | s/a/\\/g | s,a/b,V, | s/1\+/V/ | s/1+1/V/ | s/*/V/ | s/[[]k/V/
"""
SAME_SHELL = [
    "cp old folder && cp old folder/x",
    "cat old odd > new; cp bytes new2",
    "mkdir -p 'a b' c\n\nmkdir -p d/e",
    'sed "s|\\$(f p)|V|" odd > new',
    "sed -E -e 's/(a) ?<n>{1,2}/<\\1>/' odd>new",
    "sed -e 's/a/b/' -e 's/b$/c/' -i odd",
    "sed 's/b*/X/g' old > new",
    "> new cat old",
]
REFUSED = r"""
    s/a/b/e | s/a/b/w x | 1e ls | s/\(a*\)*b/V/ | s/a\|b/V/ | s/a/\2/ | s/a/\U&/ | s//x/
    s/\d/D/ | s/a/b/I | s/a/b/2 | s/[/]/V/ | s/[\n]/V/ | s/a\{1111\}/b/ | s/[[:a:]]/b/
"""
REFUSED_SHELL = [
    "cat old > $HOME",
    'sed "s|a|$HOME|" old > new',
    "cat old > `pwd`/new",
    "mkdir -p {a,b}",
    "mkdir -p ~/a",
    "cp o* new",
    "cat old '>' new",
    "cat old > new 2> new",
    "cat old > old",
    "cat /dev/zero > new",
    "cat pipe > new",
    "cp old none/",
    "cp old /dev/full",
    "sed 's/a*a*a*a*a*a*b/c/' long > new",
    "(cp old new)",
    "cp old new &",
    "cp old new # x",
    "cp old new &&",
    "cp old new ;; cp old new",
]


def make_files(folder: Path) -> Path:
    (folder / "folder").mkdir(parents=True)
    (folder / "old").write_text(TEMPLATE)
    (folder / "odd").write_text(ODD, encoding="utf-8", newline="")
    (folder / "long").write_text("a" * 3000)
    (folder / "bytes").write_bytes(b"\xff\r\n\x00")
    return folder


def read_files(folder: Path) -> dict[str, bytes | None]:
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def split_scripts(text: str) -> list[str]:
    lines = text.strip().splitlines()
    scripts = [each.strip() for line in lines for each in line.split(" | ")]
    return [f"sed '{script}' odd > new" for script in scripts]


@pytest.mark.skipif(not shutil.which("bash"), reason="compares with a shell")
@pytest.mark.parametrize("text", [*split_scripts(SAME), *SAME_SHELL])
def test_a_shell_makes_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    theirs, ours = make_files(tmp_path / "theirs"), make_files(tmp_path / "ours")
    environment = {"PATH": os.environ["PATH"], "LC_ALL": "C.UTF-8"}
    subprocess.run(["bash", "-c", text], cwd=theirs, env=environment, check=True)
    monkeypatch.chdir(ours)

    assert write_files(["bash", "-c", text], no_xacro)

    assert read_files(ours) == read_files(theirs)


@pytest.mark.parametrize("text", [*split_scripts(REFUSED), *REFUSED_SHELL])
def test_nothing_is_done_of_what_could_come_out_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    before = read_files(make_files(tmp_path))
    monkeypatch.chdir(tmp_path)
    if "pipe" in text:
        os.mkfifo(tmp_path / "pipe")
        before["pipe"] = None

    assert not write_files(["bash", "-c", text], no_xacro)

    assert read_files(tmp_path) == before


def test_a_file_that_is_too_large_is_not_begun(package: Path, tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(2**24 + 1))
    command = f'["cp", "{tmp_path}/large", "{tmp_path}/copy"]'
    entities = f"publisher(), ExecuteProcess(cmd={command}),"

    plan = ad.load_launch(describe(package, entities))

    assert [each.kind for each in plan.not_started] == ["process"]
    assert not list(plan.report)


def test_a_template_that_sed_fills_in_is_the_controllers_file(
    package: Path, tmp_path: Path
) -> None:
    template, made = package / "config" / "controllers.yaml", tmp_path / "made.yaml"
    text = template.read_text(encoding="utf-8").replace("[swing]", "[<side>/swing]")
    template.write_text(text, encoding="utf-8")
    launch = f"""
    launch:
    - arg: {{name: side, default: left_}}
    - let: {{name: made, value: {made}}}
    - executable:
        cmd: |
          bash -c "
            sed \\
              -e 's|<side>/|"$(var side)"|g' \\
              "{template}\\" \\
              > "$(var made)"
          "
    - node:
        pkg: robot_state_publisher
        exec: robot_state_publisher
        param:
        - name: robot_description
          value: $(command "xacro {package}/urdf/pendulum.urdf.xacro
            prefix:=$(var side)")
    - node:
        pkg: controller_manager
        exec: ros2_control_node
        param: [{{from: $(var made)}}]
    - node: {{pkg: controller_manager, exec: spawner, args: forward}}
    """

    plan = ad.load_launch(write_launch(package, launch, "test.launch.yaml"))

    assert not plan.not_started
    (robot,) = plan.load_scene().robots
    (forward,) = (c for c in robot.controllers.controllers if c.name == "forward")
    assert forward.parameters["joints"].value == ["left_swing"]
    assert not made.exists()
    assert f"parameters: {made}" in str(plan)


def test_a_process_may_be_xacro(package: Path, tmp_path: Path) -> None:
    made = tmp_path / "made.urdf"
    entities = f"""
    ExecuteProcess(cmd=["xacro", XACRO[1], "prefix:=left_", "-o", "{made}"]),
    ExecuteProcess(cmd=["xacro", XACRO[1], ">", "{tmp_path}/other"], shell=True),
    Node(package="robot_state_publisher", executable="robot_state_publisher",
         arguments=["{made}"]),
    """

    plan = ad.load_launch(describe(package, entities))

    assert not plan.not_started
    (robot,) = plan.load_scene().robots
    assert robot.description.movable_joints[0].name == "left_swing"
    assert f"it writes {tmp_path}/other; " in str(plan.report)


def test_a_backslash_is_for_what_follows_it(package: Path) -> None:
    launch = r"""
    <launch>
      <let name="a" value="x\\y \$(z) \'q\'"/>
      <log message="$(var a) $(eval &quot;'\\\\n' + 'pq'&quot;)"/>
    </launch>
    """

    report = ad.load_launch(write_launch(package, launch, "test.launch.xml")).report

    assert r"x\y $(z) 'q' \npq; so says" in str(report)
