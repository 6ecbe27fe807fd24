"""Launch files that do what they should not: one message each, and nothing done."""

import os
import time
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.launch import launch_files
from tests.launch.packages import describe, make_package, write_launch

WHOLE = "from launch import LaunchDescription\ndef generate_launch_description():\n    "


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return make_package(tmp_path)


def message(path: Path) -> str:
    with pytest.raises(ArmDrakeError) as error:
        ad.load_launch(path)
    return str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "expected", "line"),
    [
        ("import rclpy\n", "it imports 'rclpy', which isn't there without ROS", 1),
        (
            "from ament_index_python import get_nothing\n",
            "ament_index_python here lacks it: cannot import name 'get_nothing' "
            "from 'ament_index_python'",
            1,
        ),
        ("def (:\n", "SyntaxError: invalid syntax", 1),
        ("1 / 0\n", "ZeroDivisionError: division by zero", 1),
        ("", "it has no function generate_launch_description()", None),
        (WHOLE + "return None\n", "expected a LaunchDescription, got NoneType", None),
        (WHOLE + "raise KeyError('x')\n", "KeyError: 'x'", 3),
        (WHOLE + "return LaunchDescription([5])\n", "expected actions, got int", None),
        (WHOLE + "return LaunchDescription(['a'])\n", "actions, got str 'a'", None),
        (WHOLE + "print('no arm'); exit(1)\n", "SystemExit: 1; it said: no arm", 3),
        (WHOLE + "import sys; sys.exit(3)\n", "SystemExit: 3", 3),
        (WHOLE + "return generate_launch_description()\n", "RecursionError", 3),
        (WHOLE + "return 'x' * 10**11\n", "needs more than 2048 MB of memory", None),
    ],
)
def test_what_is_wrong_with_a_file_is_reported_with_its_place(
    package: Path, text: str, expected: str, line: int | None
) -> None:
    path = write_launch(package, text)

    told = message(path)

    assert expected in told
    assert told.startswith(str(path) if line is None else f"{path}:{line}")
    assert "Traceback" not in told
    assert main(["launch", str(path), "--print"]) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<launch>", ":1: malformed XML: no element found"),
        ("<robot/>", "expected <launch>, got <robot>"),
        ("<launch>\n<nod/></launch>", ":2: unknown <nod>; known: append_env, arg"),
        ("<launch>\n\n<arg/></launch>", ":3: <arg> has no attribute 'name'"),
        ("<launch>\n<set_remap from='a'/></launch>", ":2: <set_remap> has no"),
        ("<launch>\n<timer><log message='a'/></timer></launch>", "no attribute 'peri"),
        ("<launch><timer period='a'/></launch>", "period 'a' of a timer: expected sec"),
        ("<launch><log message='$(var)'/></launch>", "$(var) has 0 words"),
        ("<launch><log message='$(vr x)'/></launch>", "unknown $(vr ...); known: all"),
        ("<launch><log message='$(var x'/></launch>", "a $( is never closed"),
        (
            "<launch>\n<log message='$(var x)'/></launch>",
            ":2: launch configuration 'x'",
        ),
        ("<launch><log message=\"$(command 'ls')\"/></launch>", "'ls' is not run"),
        ("<launch><include file='nowhere'/></launch>", "no such file"),
        ("<launch><include file='$(filename)'/></launch>", "contain each other"),
        (
            f"<launch><let name='a' value='{'$(var ' * 500}a{')' * 500}'/></launch>",
            "xml: substitutions are nested too deeply",
        ),
    ],
)
def test_what_is_wrong_in_xml_is_reported(
    package: Path, text: str, expected: str
) -> None:
    told = message(write_launch(package, text, "test.launch.xml"))

    assert expected in told
    assert str(package) in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("launch:\n- [a", ":2: malformed YAML: expected ',' or ']'"),
        ("launches: []", "expected a mapping with the key 'launch'"),
        ("launch:\n- log: {}\n- 5", ":3: launch: expected a mapping, got 5"),
        ("launch:\n- arg: {name: a}\n- nod: {a: 1}", ":3: unknown <nod>; known:"),
        ("launch:\n- log: {message: $(var x)}", ":2: launch configuration 'x' does no"),
        ("launch: &a\n- group: *a", "yaml: elements are nested too deeply"),
    ],
)
def test_what_is_wrong_in_yaml_is_reported(
    package: Path, text: str, expected: str
) -> None:
    told = message(write_launch(package, text, "test.launch.yaml"))

    assert expected in told
    assert str(package) in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("os.system('touch {file}')", "it starts a program: touch"),
        ("import subprocess; subprocess.run(['touch', '{file}'])", "starts a program"),
        ("os.fork()", "it starts a program"),
        ("os.execvp('touch', ['touch', '{file}'])", "it starts a program: "),
        ("os.open('{file}', os.O_CREAT | os.O_WRONLY)", "it writes: {file}"),
        ("os.remove('{kept}')", "it changes: {kept}"),
        ("os.rename('{kept}', '{file}')", "it changes: {kept}"),
        ("import shutil; shutil.rmtree('{folder}')", "it changes: {folder}"),
        ("os.symlink('{kept}', '{file}')", "it changes: {file}"),
        ("os.kill(os.getppid(), 9)", "it sends a signal"),
        (
            "from signal import *; pidfd_send_signal(os.pidfd_open(os.getppid()), 0)",
            "it sends a signal",
        ),
        ("file = open('{kept}'); os.fchmod(file.fileno(), 0)", "changes: {kept}"),
        ("os.utime(os.open('{above}', os.O_RDONLY), (1, 1))", "it changes: {above}"),
        ("import socket; socket.socket()", "it opens a connection"),
        (
            "import urllib.request; urllib.request.urlopen('http://localhost:9')",
            "it opens a connection",
        ),
        ("import ctypes; ctypes.CDLL(None).system(b'')", "calls code that isn't"),
        ("import ctypes; ctypes.CDLL('libc.so.6')", "it calls code that isn't"),
        ("os.mkfifo('{file}')", "it changes: {file}"),
        ("import sqlite3; sqlite3.connect('{file}')", "it opens a data base: {file}"),
        (
            "os.remove('kept', dir_fd=os.open('{above}', os.O_RDONLY))",
            "it changes: {kept}",
        ),
        (
            "os.open('made', os.O_CREAT, dir_fd=os.open('{above}', os.O_RDONLY))",
            "it writes: {file}",
        ),
    ],
)
def test_what_would_change_the_machine_is_refused(
    package: Path, tmp_path: Path, code: str, expected: str
) -> None:
    kept, file = tmp_path / "kept", tmp_path / "made"
    kept.write_text("as it was")
    mode = kept.stat().st_mode
    places = {"file": file, "kept": kept, "folder": package, "above": tmp_path}
    path = describe(package, "", before=code.format(**places))

    told = message(path)

    assert expected.format(**places) in told
    assert told.startswith(str(path))
    assert kept.stat().st_mode == mode
    assert kept.read_text() == "as it was"
    assert not file.exists()
    assert path.is_file()


def test_what_a_file_catches_is_in_the_report(package: Path) -> None:
    before = """
    try:
        os.remove(YAML)
    except OSError:
        pass
    """
    plan = ad.load_launch(describe(package, "publisher(),", before))

    (line,) = map(str, plan.report)
    assert "it changes: " in line
    assert "which a launch file here may not do" in line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "limit", "value", "expected"),
    [
        ("while True: pass", "CPU_TIME", 1, "takes more than 1 s of processor time"),
        ("import time; time.sleep(1000)", "TIME", 1.0, "takes more than 1 s; launch "),
    ],
)
def test_a_file_that_never_ends_is_ended(
    package: Path,
    monkeypatch: pytest.MonkeyPatch,
    code: str,
    limit: str,
    value: float,
    expected: str,
) -> None:
    monkeypatch.setattr(launch_files, limit, value)
    start = time.monotonic()

    told = message(describe(package, "", before=code))

    assert expected in told
    assert time.monotonic() - start < 60.0


@pytest.mark.parametrize(
    "text",
    [
        "a: &a\n  b: *a\n",
        "a: &a [x]\n"
        + "".join(
            f"k{i + 1}: &k{i + 1} {{l: *{f'k{i}' if i else 'a'}, "
            f"r: *{f'k{i}' if i else 'a'}}}\n"
            for i in range(40)
        ),
        "{a: " * 3000 + "1" + "}" * 3000,
        "a: " + "9" * 5000,
    ],
    ids=["contains itself", "multiplies", "deep", "a long number"],
)
def test_parameters_of_an_own_node_that_are_none_are_left_out(
    package: Path, text: str
) -> None:
    (package / "config/own.yaml").write_text(text, encoding="utf-8")
    path = describe(
        package,
        """
        publisher(), spawner("forward"),
        Node(package="own", executable="driver", name="controller_manager",
             parameters=[os.path.join(PACKAGE, "config", "own.yaml")]),
        """,
    )

    plan = ad.load_launch(path)

    assert "own/driver" in [each.name for each in plan.not_started]


def test_a_pipe_as_parameters_of_an_own_node_is_not_waited_for(package: Path) -> None:
    os.mkfifo(package / "pipe")
    path = describe(
        package,
        """
        publisher(), spawner("forward"),
        Node(package="own", executable="driver", name="controller_manager",
             parameters=[os.path.join(PACKAGE, "pipe")]),
        """,
    )

    plan = ad.load_launch(path)

    assert "own/driver" in [each.name for each in plan.not_started]


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        ("HasNodeParams(DEEP, 'a').perform(context)", "deep.yaml is nested too deeply"),
        (
            "ParseMultiRobotPose('a=' + '{x: ' * 3000).perform(context)",
            "expected NAME={x: 0.0, y: 0.0, yaw: 0.0}; ...",
        ),
    ],
)
def test_what_is_nested_too_deeply_is_told_with_its_line(
    package: Path, call: str, expected: str
) -> None:
    (package / "deep.yaml").write_text("[" * 3000 + "]" * 3000, encoding="utf-8")
    before = f"""
        from nav2_common.launch import HasNodeParams, ParseMultiRobotPose
        DEEP = os.path.join(PACKAGE, "deep.yaml")
        def call(context):
            return [LogInfo(msg={call})]
        """

    told = message(describe(package, "OpaqueFunction(function=call)", before))

    assert "test.launch.py:" in told
    assert told.endswith(expected)


def test_a_bridges_file_that_is_no_name_is_reported(package: Path) -> None:
    entities = """
        publisher(), manager(),
        Node(package="ros_gz_bridge", executable="parameter_bridge",
             parameters=[{"config_file": 5}]),
        """

    plan = ad.load_launch(describe(package, entities))

    assert "config_file: expected a file's name, got 5" in str(plan.report)


def test_a_trajectory_that_is_none_is_refused(package: Path) -> None:
    entities = """
        publisher(), manager(), spawner("arm_controller"),
        ExecuteProcess(cmd=["ros2", "action", "send_goal",
            "/arm_controller/follow_joint_trajectory",
            "control_msgs/action/FollowJointTrajectory", "{trajectory: 5}"]),
        """

    plan = ad.load_launch(describe(package, entities))

    with pytest.raises(ArmDrakeError, match="goal: expected a mapping, got 5"):
        plan.load_scene()


@pytest.mark.slow
def test_actions_that_start_each_other_for_ever_are_ended(package: Path) -> None:
    before = """
    def another(event=None, context=None):
        return ExecuteProcess(cmd=["ros2", "control", "list"])
    """
    path = describe(
        package,
        """
        another(), RegisterEventHandler(OnProcessExit(on_exit=another)),
        """,
        before,
    )

    assert "it starts itself again" in message(path)


def test_what_it_prints_does_not_come_between(package: Path) -> None:
    before = """
    import sys
    print('{"error": null}')
    sys.stdout.write("x" * 100000)
    os.write(1, b'{"find": "x"}')
    """
    plan = ad.load_launch(describe(package, "publisher(),", before))

    assert len(plan.robots) == 1


def test_the_environment_of_this_process_stays(package: Path) -> None:
    entities = "SetEnvironmentVariable('ARM_DRAKE_TEST_VARIABLE', '1'), publisher(),"

    ad.load_launch(describe(package, entities))

    assert "ARM_DRAKE_TEST_VARIABLE" not in os.environ


def test_a_folder_that_is_not_there_is_reported(package: Path) -> None:
    path = describe(package, "publisher(),")

    with pytest.raises(InputError, match="no such folder; expected one to search"):
        ad.load_launch(path, package_paths=package / "nowhere")
