"""Processes of launch files that make files from others."""

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
