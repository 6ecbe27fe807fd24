"""The command line: exit codes, one clear message, no traceback."""

import json
import math
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.description.entry import (
    bundled_motions,
    bundled_robots,
    configs_folder,
)
from arm_drake.messages import Float64MultiArray
from arm_drake.simulation.recording import list_failures
from tests import models
from tests.robots import real_robot

JTC = "joint_trajectory_controller"
BUMPER = "end_effector_sensor"
JOINTS = [f"joint{i}" for i in range(1, 7)]


@pytest.fixture
def run(capsys):
    """Run a command; return its exit code, standard output and standard error."""

    def run_command(*arguments) -> tuple[int, str, str]:
        capsys.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # argparse
            code = stop.code
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run_command


def motion_file(folder: Path, text: str) -> Path:
    path = folder / "motion.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def goal_file(folder: Path, **changes: str) -> Path:
    """Return a motion file with a goal, some of its fields changed."""
    fields = {
        "joint_names": "[joint1, joint2, joint3, joint4, joint5, joint6]",
        "points": "[{positions: [0, 0, 0, 0, 0, 0], time_from_start: 0.1}]",
    }
    body = ", ".join(f"{k}: {v}" for k, v in (fields | changes).items())
    return motion_file(folder, f"- {{controller: {JTC}, goal: {{{body}}}}}\n")


def test_the_version_is_that_of_the_package(run):
    project = Path(__file__).parents[1] / "pyproject.toml"
    version = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"]

    assert run("--version")[:2] == (0, f"arm-drake {version}\n")


def test_list_names_robots_motions_and_worlds(run):
    code, out, _ = run("list")
    assert code == 0
    assert "doosan_a0912\n  motions: topic, tutorial, waypoints" in out
    assert "worlds: empty, house, house_table, void" in out


MYCOBOT = "arm-drake sim mycobot_280 control:=ros2_control"

# What motions say that don't run with the robot's name alone.
COMMANDS = {
    ("centauri", "pick_and_place"): "arm-drake sim pick_and_place_scene.yaml",
    ("mycobot_280", "classic"): (
        "arm-drake sim mycobot_280 control:=classic --motion classic"
    ),
    ("mycobot_280", "follow"): "arm-drake sim follow_scene.yaml",
    ("mycobot_280", "pick_and_place"): (
        f"{MYCOBOT} --world house_table --motion pick_and_place"
    ),
    ("mycobot_280", "pick_by_camera"): (
        f"{MYCOBOT} camera:=table --world house_table --motion pick_by_camera"
    ),
    ("mycobot_280", "plan_to_poses"): f"{MYCOBOT} --motion plan_to_poses",
    ("mycobot_280", "trajectories"): f"{MYCOBOT} --motion trajectories",
}


@pytest.mark.slow
@pytest.mark.parametrize("robot", bundled_robots())
def test_a_motion_runs_with_its_name_or_says_the_command_that_works(
    run, robot, monkeypatch
):
    monkeypatch.chdir(configs_folder() / robot)  # Scenes are named from here.
    short = ["--headless", "--duration", 0.1]
    for motion in bundled_motions(robot):
        code, _, err = run("sim", robot, "--motion", motion, *short)
        command = COMMANDS.get((robot, motion))
        if command is None:
            assert code == 0, err
            continue
        assert code == 2
        assert err.endswith(f"; the motion is for `{command}`\n")
        # What is planned isn't done by then, but begun.
        assert run(*command.split()[1:], *short)[0] < 2
        assert f"    {motion} needs more: {command}\n" in run("list")[1]


@pytest.mark.slow
def test_who_has_what_a_motion_needs_is_told_only_what_else_is_wrong(run):
    words = ["--world", "house_table", "--motion", "pick_and_place"]
    code, _, err = run(
        "sim", "mycobot_280", "control:=ros2_control", *words, "--set", "thing=bx"
    )

    assert code == 2
    assert "no thing 'bx'" in err
    assert "the motion is for" not in err


def test_list_as_json_has_the_command_of_each_motion(run):
    commands = json.loads(run("list", "--json")[1])["commands"]

    plain = "arm-drake sim doosan_a0912 --motion topic"
    assert commands["doosan_a0912"]["topic"] == plain
    assert commands["mycobot_280"]["trajectories"] == f"{MYCOBOT} --motion trajectories"


def test_list_as_json_is_one_object(run):
    _, out, _ = run("list", "--json")
    listed = json.loads(out)
    assert listed["robots"]["doosan_a0912"] == ["topic", "tutorial", "waypoints"]
    assert listed["worlds"] == ["empty", "house", "house_table", "void"]


@pytest.mark.slow
def test_check_of_a_clean_robot_exits_with_0(run):
    code, out, err = run("check", "doosan_a0912")
    assert (code, err) == (0, "")
    assert f"controller {JTC} (joint_trajectory_controller/" in out
    assert "report: nothing" in out


@pytest.mark.slow
def test_a_xacro_argument_after_an_option_reaches_the_description(run, tmp_path):
    file = tmp_path / "robot.urdf.xacro"
    file.write_text(
        '<robot name="$(arg name)" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="name" default="r"/><link name="base"/></robot>'
    )

    code, out, err = run("check", file, "--json", "name:=bob", "--strict")

    assert (code, err) == (0, "")
    assert json.loads(out)["robot"] == "bob"


@pytest.mark.slow
def test_check_exits_with_1_for_a_controller_that_does_not_load(run, tmp_path):
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    broken = tmp_path / "controllers.yaml"
    broken.write_text(yaml.replace("JointStateBroadcaster", "JointStateBrodcaster"))

    code, out, _ = run("check", "doosan_a0912", "--controllers", broken, "--json")

    checked = json.loads(out)
    (entry,) = checked["report"]
    assert code == 1
    assert entry["severity"] == "error"
    assert entry["file"] == str(broken)
    assert entry["line"] == 10
    assert entry["what"].startswith(
        "unknown controller type 'joint_state_broadcaster/JointStateBrodcaster'; did "
        "you mean 'joint_state_broadcaster/JointStateBroadcaster'?"
    )
    states = {row["name"]: row["state"] for row in checked["controllers"]}
    assert states == {
        "joint_state_broadcaster": "unconfigured",
        JTC: "active",
        BUMPER: "active",
    }


@pytest.mark.slow
def test_check_reports_a_joint_that_the_robot_lacks(run, tmp_path):
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    broken = tmp_path / "controllers.yaml"
    broken.write_text(yaml.replace("joint6", "joint7"))

    code, out, _ = run("check", "doosan_a0912", "--controllers", broken)

    assert code == 1
    problem = "the robot has no joint 'joint7'; did you mean 'joint6'? known: joint1, "
    assert f"errors:\n  {broken}\n    line 13, {JTC}: {problem}" in out
    # Why it doesn't start is said beside it too.
    kind = "joint_trajectory_controller/JointTrajectoryController"
    assert f"controller {JTC} ({kind}): inactive: {problem}" in out


@pytest.mark.slow
def test_check_names_the_parameter_that_a_controller_lacks(run, tmp_path):
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    broken = tmp_path / "controllers.yaml"
    broken.write_text(yaml.replace("    joints:", "    jionts:", 1))

    _, out, _ = run("check", "doosan_a0912", "--controllers", broken)

    kind = "joint_trajectory_controller/JointTrajectoryController"
    problem = "joints: is required but missing, 'jionts' is given instead"
    assert f"controller {JTC} ({kind}): unconfigured: {problem}\n" in out


@pytest.mark.slow
def test_check_tells_why_a_controller_of_the_hardware_is_left_out(run, tmp_path):
    kind = "picknik_reset_fault_controller/PicknikResetFaultController"
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    section = "  ros__parameters:\n"
    more = tmp_path / "controllers.yaml"
    added = f"{section}    fault_controller: {{type: {kind}}}\n"
    more.write_text(yaml.replace(section, added, 1))

    code, out, _ = run("check", "doosan_a0912", "--controllers", more)

    assert code == 0
    problem = f"controller type '{kind}' only clears the real robot's faults"
    assert f"controller fault_controller ({kind}): unconfigured: {problem}\n" in out


def test_check_tells_what_overlaps_where_the_robot_stands(run, tmp_path):
    box = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
    urdf = (
        f'<robot name="r"><link name="a"/><link name="b">{box}</link><joint name="j" '
        'type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(urdf)

    _, out, _ = run("check", tmp_path / "r.urdf")

    assert (
        "    links overlap in the initial pose: b and the world; "
        "they pass through each other until they are apart; another pose (--pose) or "
        "other initial positions (--initial) avoid it\n"
    ) in out


def test_list_names_the_examples(run):
    _, out, _ = run("list")
    _, listed, _ = run("list", "--json")

    examples = json.loads(listed)["examples"]
    assert "example:ur5_robot" in examples
    assert all(name in out for name in examples)
    # Commands stay whole, to be copied.
    lines = [line for line in out.splitlines() if "arm-drake sim" not in line]
    assert max(map(len, lines)) <= 88


@pytest.mark.slow
@pytest.mark.parametrize("command", ["check", "sim"])
def test_what_drake_warns_about_is_read_in_the_report_only(tmp_path, command):
    # Drake takes no mass of a link called "world".
    urdf = (
        '<robot name="r"><link name="world"><inertial><mass value="1"/><inertia '
        'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<link name="b"/>'
        '<joint name="j" type="continuous"><parent link="world"/><child link="b"/>'
        "</joint></robot>"
    )
    (tmp_path / "r.urdf").write_text(urdf)
    options = ["--headless", "--duration", "0.1"] if command == "sim" else []

    done = subprocess.run(
        [sys.executable, "-m", "arm_drake", command, tmp_path / "r.urdf", *options],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    printed = done.stdout + done.stderr
    assert "so says Drake" in printed
    assert "literal-string" not in printed
    assert "[console]" not in printed


@pytest.mark.slow
def test_check_tells_what_the_robot_is(run):
    _, out, _ = run("check", "doosan_a0912", "--json")

    checked = json.loads(out)
    diagram = ad.build_diagram(ad.load_robot("doosan_a0912"), world="void")
    plant = diagram.GetSubsystemByName("plant")
    mass = plant.CalcTotalMass(plant.CreateDefaultContext())
    assert checked["mass"] == pytest.approx(mass, rel=1e-12)
    assert (checked["links"], len(checked["joints"])) == (8, 6)
    assert checked["base"] == "fixed"
    assert checked["reach"] == pytest.approx(1.24, abs=0.01)
    assert [row["problem"] for row in checked["controllers"]] == [None] * 3


@pytest.mark.slow
def test_check_calls_a_robot_as_it_was_asked_for(run):
    _, out, _ = run("check", "doosan_a0912")
    _, renamed, _ = run("check", "doosan_a0912", "--name", "arm")

    assert out.startswith("doosan_a0912: 8 links, 6 movable joints, ")
    assert renamed.startswith("arm: 8 links, ")


@pytest.mark.slow
def test_check_reads_as_blocks_by_severity_and_file(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    urdf = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" '
        'type="continuous"><parent link="a"/><child link="b"/><limit effort="0" '
        'velocity="1"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(urdf)

    code, out, _ = run("check", "r.urdf")

    assert code == 0
    assert out.splitlines() == [
        "r: 2 links, 1 movable joint, 0.001 kg, fixed base",
        "joints: j",
        "controller joint_state_broadcaster "
        "(joint_state_broadcaster/JointStateBroadcaster): active",
        "controller joint_trajectory_controller "
        "(joint_trajectory_controller/JointTrajectoryController): active",
        "",
        "warnings:",
        "  r.urdf",
        "    line 1, link 'b': no mass, but a joint moves it; it gets 0.001 kg and the "
        "moments (1e-06, 1e-06, 1e-06) kg·m^2, it has no geometry to estimate from",
        "",
        "for your information:",
        "  r.urdf",
        "    line 1, joint 'j': effort limit 0; taken as unset",
        "    neither <ros2_control> tags nor a controllers YAML; one "
        "joint_trajectory_controller moves its 1 independent joint",
        "    the description has no <ros2_control>; joints take the commands that "
        "controllers claim, else positions: position (1 joint)",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("robot", bundled_robots())
def test_bundled_robots_bear_strict(run, robot):
    assert run("check", robot, "--strict")[0] == 0

    arguments = ("sim", robot, "--headless", "--duration", "0.01", "--strict")
    assert run(*arguments)[::2] == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("sim", "--headless", "--duration", "0.01"),
        ("ik", "--pose", "0.5,0,0.5"),
        ("plan", "--to", "0.5,0,0.5"),
        ("analyze",),
        ("tune",),
    ],
)
def test_strict_refuses_a_robot_with_a_warning(run, tmp_path, command):
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    wrong = tmp_path / "controllers.yaml"
    wrong.write_text(yaml.replace("goal_time:", "goal_tim:"))
    name, *words = command

    code, out, err = run(
        name, "doosan_a0912", "--controllers", wrong, "--strict", *words
    )

    assert (code, out) == (2, "")
    assert err.startswith("arm-drake: not everything was taken as written:\nwarning: ")


@pytest.mark.slow
def test_strict_check_exits_with_1_for_a_warning(run, tmp_path):
    yaml = (configs_folder() / "doosan_a0912/controllers.yaml").read_text()
    remark = tmp_path / "controllers.yaml"
    remark.write_text(yaml.replace("goal_time:", "goal_tim:"))
    arguments = ("check", "doosan_a0912", "--controllers", remark)
    assert run(*arguments)[0] == 0
    assert run(*arguments, "--strict")[0] == 1


@pytest.mark.slow
def test_sim_prints_one_json_object_with_the_promised_keys(run):
    code, out, _ = run("sim", "doosan_a0912", "--headless", "--duration", 0.2, "--json")
    result = json.loads(out)
    assert code == 0
    assert {
        "robot", "joints", "duration", "wall_time", "real_time_factor",
        "controllers", "goals", "final", "report",
    } <= set(result)  # fmt: skip
    assert result["robot"] == "a0912"
    assert result["joints"] == JOINTS
    assert result["duration"] == 0.2
    assert list(result["final"]) == JOINTS
    assert {
        "name": JTC,
        "type": f"{JTC}/JointTrajectoryController",
        "state": "active",
    } in (result["controllers"])


@pytest.mark.slow
def test_sim_draws_the_kind_of_plot_that_it_is_asked_for(run, tmp_path):
    plot = tmp_path / "a.svg"

    code, out, _ = run(
        "sim", "doosan_a0912", "--headless", "--duration", "0.1",
        "--plot", plot, "--plot-kind", "effort",
    )  # fmt: skip

    assert code == 0
    assert f"plot: {plot}" in out
    assert "<!-- joint1 [N·m] -->" in plot.read_text(encoding="utf-8")


@pytest.mark.slow
def test_sim_runs_the_tutorial_and_writes_what_it_is_asked_for(run, tmp_path):
    log, plot, page = (tmp_path / name for name in ("a.npz", "a.png", "a.html"))

    code, out, err = run(
        "sim", "doosan_a0912", "--motion", "tutorial", "--headless",
        "--log", log, "--plot", plot, "--record", page,
    )  # fmt: skip

    assert code == 0
    # The largest of all rows since the line before; none where there is no error.
    rollout, said = ad.Rollout.load(log), re.findall(r"(\S+) s  .* error (\S+) mr", err)
    error = np.nan_to_num(np.abs(rollout.tracking_error(JTC)).max(axis=1))
    since = 0.0
    for time, largest in said:
        rows = (rollout.time > since) & (rollout.time <= float(time))
        assert f"{1e3 * error[rows].max():.1f}" == largest
        since = float(time)
    assert max(float(largest) for _, largest in said) == round(1e3 * error.max(), 1)
    assert len(said) == len(err.splitlines()) < 5
    assert f"{JTC}: goal accepted" in out
    assert f"{JTC}: SUCCEEDED, error code 0" in out
    with np.load(log) as arrays:
        assert arrays["joint_names"].tolist() == JOINTS
        shapes = {name: arrays[name].shape for name in arrays.files}
        # A row for each tick in 5 s at 100 Hz.
        assert shapes["time"] == (500,)
        for name in ("position", "velocity", "effort", f"{JTC}/reference"):
            assert shapes[name] == (500, 6)
    assert plot.read_bytes().startswith(b"\x89PNG")
    html = page.read_text(encoding="utf-8")
    assert html.lstrip().startswith("<!DOCTYPE html>")
    assert "animation" in html


@pytest.mark.slow
def test_on_a_terminal_a_line_shows_the_largest_error_of_the_last_second(
    run, monkeypatch
):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)

    _, _, err = run(
        "sim", "doosan_a0912", "--motion", "tutorial", "--headless", "--duration", 3.5
    )

    lines = re.findall(
        r"\r\033\[K +(\d+\.\d+) s  (?:\S+ tracking error (\S+) mrad)?", err
    )
    shown = {float(time): error for time, error in lines}
    # The motion ends with its largest error at 2.03 s.
    assert {shown[round(0.1 * k, 1)] for k in range(20)} == {""}
    (largest,) = {shown[round(0.1 * k, 1)] for k in range(30, 35)}
    assert float(largest) > 10.0


@pytest.mark.slow
def test_where_nothing_is_new_nothing_is_said(run):
    _, _, err = run("sim", "lab5_arm", "--headless", "--duration", "1.5")

    assert err == ""


@pytest.mark.slow
def test_errors_of_sliding_joints_are_in_millimetres(run, tmp_path):
    file = tmp_path / "lift.urdf"
    file.write_text(models.LIFT, encoding="utf-8")
    controllers = tmp_path / "controllers.yaml"
    text = models.trajectory_controllers({JTC: ["slide"]})
    controllers.write_text(text, encoding="utf-8")
    goal = goal_file(
        tmp_path,
        joint_names="[slide]",
        points="[{positions: [0.5], time_from_start: 0.5}]",
    )

    _, _, err = run(
        "sim", file, "--controllers", controllers, "--headless", "--motion", goal
    )

    assert re.fullmatch(rf".* s  {JTC}: tracking error \d+\.\d mm\n", err)


@pytest.mark.slow
def test_sim_exits_with_1_when_a_goal_is_rejected(run, tmp_path):
    motion = goal_file(tmp_path, header="{stamp: 0.1}")
    late = motion.read_text().replace("- {", "- {at: 0.5, ")
    motion.write_text(late)

    code, _, err = run("sim", "doosan_a0912", "--headless", "--motion", motion)

    assert code == 1
    assert (
        f"arm-drake: {motion}:1: [0].goal: {JTC}: goal REJECTED, error code -1: ends "
        "in the past: at 0.2 s, and it is 0.5"
    ) in err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (
            {"joint_names": "[joint1, joint2]"},
            "joints ['joint3', 'joint4', 'joint5', 'joint6'] are missing; name all "
            "joints, or set allow_partial_joints_goal",
        ),
        (
            {"joint_names": "[joint1, joint2, joint3, joint4, joint5, wrist]"},
            "unknown joint 'wrist'; known: joint1, joint2, joint3, joint4, joint5, "
            "joint6",
        ),
        (
            {"points": "[{positions: [0, 0, 0], time_from_start: 1}]"},
            "points[0].positions has 3 elements; expected 6, one per joint",
        ),
        (
            {
                "points": "[{positions: [0, 0, 0, 0, 0, 0], time_from_start: 2}, "
                "{positions: [0, 0, 0, 0, 0, 0], time_from_start: 1}]"
            },
            "points[1].time_from_start is 1.0 s, after 2.0 s; times must increase",
        ),
    ],
)
def test_a_trajectory_that_will_be_refused_is_said_at_once(
    run, tmp_path, changes, reason
):
    motion = goal_file(tmp_path, **changes)

    code, _, err = run("sim", "doosan_a0912", "--headless", "--motion", motion)

    assert (code, err) == (2, f"arm-drake: {motion}:1: [0].goal: {JTC}: {reason}\n")
    # A program gets an event, as from ROS.
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    sim.run(0.1, ad.load_motion(motion))
    (goal,) = sim.goals
    assert (goal.status.value, goal.result.error_string) == ("REJECTED", reason)


@pytest.mark.slow
def test_sim_exits_with_1_when_a_topic_message_is_refused(run, tmp_path):
    late = goal_file(tmp_path, header="{stamp: 0.1}").read_text()
    text = late.replace("- {", "- {at: 0.5, ").replace("goal", "trajectory")
    motion = motion_file(tmp_path, text)

    code, _, err = run("sim", "doosan_a0912", "--headless", "--motion", motion)

    assert code == 1
    assert err.endswith(
        f"arm-drake: {motion}:1: [0].trajectory: {JTC}: trajectory refused: ends in "
        "the past: at 0.2 s, and it is 0.5 s; a stamp of 0 starts now\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["nowhere/robot.urdf"],
            "nowhere/robot.urdf: no such file or folder; there is no folder 'nowhere'",
        ),
        (
            ["dosan_a0912"],
            "unknown robot 'dosan_a0912': neither a bundled robot nor a file or "
            "folder; did you mean 'doosan_a0912'? known: "
            "centauri, doosan_a0912, lab5_arm, mycobot_280, teslabot",
        ),
        (
            ["doosan_a0912", "--motion", "tutoria"],
            "no motion 'tutoria' of 'doosan_a0912', and no such file; did you mean "
            "'tutorial'? known: topic, tutorial, waypoints",
        ),
        (
            ["doosan_a0912", "--motion", "nowhere.yaml"],
            "nowhere.yaml: can't be read: No such file or directory",
        ),
        (
            ["doosan_a0912", "--log", "nowhere/a.npz"],
            "nowhere/a.npz: can't be written: the folder 'nowhere' doesn't exist",
        ),
        (
            ["doosan_a0912", "--log", "a.xls"],
            "a.xls: unknown type '.xls' of a log; expected one of .csv, .mcap, .npz",
        ),
        (
            ["doosan_a0912", "--plot", "a.bmp"],
            "a.bmp: unknown type '.bmp' of a picture; expected one of .png, .svg, .pdf",
        ),
        (
            ["doosan_a0912", "--plot-kind", "error"],
            "--plot-kind says what --plot draws; give --plot, too",
        ),
        (
            ["doosan_a0912", "--loop"],
            "--loop says how --record plays; give --record, too",
        ),
        (
            ["doosan_a0912", "--record", "a.mp4"],
            "a.mp4: expected a .html file to record to",
        ),
        (
            ["doosan_a0912", "--world", "hous"],
            "unknown world 'hous'; did you mean 'house'? known: empty, house, "
            "house_table, void, or a .world or .sdf file",
        ),
        (
            ["doosan_a0912", "--motion", "/"],
            "/: is a folder; expected the YAML file of a motion",
        ),
        (
            ["doosan_a0912", "--inactive", "jtc"],
            f"no controller 'jtc'; known: {BUMPER}, joint_state_broadcaster, {JTC}",
        ),
        (
            ["doosan_a0912", "--active", "jtc"],
            f"no controller 'jtc'; known: {BUMPER}, joint_state_broadcaster, {JTC}",
        ),
        (
            ["doosan_a0912", "--active", JTC, "--inactive", JTC],
            f"controller {JTC!r} can't be both active and inactive; name it once",
        ),
        (
            ["doosan_a0912", "--preset", "kinematics"],
            "no preset 'kinematics'; did you mean 'kinematic'? known: accurate, "
            "fast, kinematic",
        ),
        (
            ["doosan_a0912", "--initial", "joint9=1"],
            "initial position of joint 'joint9': the robot has no such joint; did you "
            "mean 'joint6'? known: joint1, joint2, joint3, joint4, joint5, joint6",
        ),
        (
            ["doosan_a0912", "--initial", "joint1=x"],
            "--initial joint1=x: expected a number [rad or m]",
        ),
        (
            ["doosan_a0912", "--time-step", "1e-9"],
            "time_step must be at least 1e-06 s, got 1e-09",
        ),
        (
            ["doosan_a0912", "--hold"],
            "--hold is for the page, and with --headless there is none",
        ),
        (
            ["doosan_a0912", "--host", "*"],
            "--host is for the page, and with --headless there is none",
        ),
        (
            ["doosan_a0912", "--port", "7001"],
            "--port is for the page, and with --headless there is none",
        ),
        (
            ["doosan_a0912", "--port", "0"],
            "--port is for the page, and with --headless there is none",
        ),
        (
            ["doosan_a0912", "--ros-reset-clock"],
            "--ros-reset-clock is of what --ros lets in; give that, too",
        ),
        (
            ["doosan_a0912", "--ros-domain", "0"],
            "--ros-domain is of what --ros lets in; give that, too",
        ),
        (
            ["doosan_a0912", "--distro", "noetic"],
            "unknown distro 'noetic'; known: humble, jazzy, kilted, rolling",
        ),
    ],
)
def test_unusable_input_is_one_message_and_exit_code_2(
    run, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)

    code, out, err = run("sim", *arguments, "--headless")

    assert code == 2
    assert out == ""
    assert err == f"arm-drake: {message}\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_motion_for_an_inactive_controller_is_found_before_the_start(run):
    code, out, err = run(
        "sim", "doosan_a0912", "--headless", "--motion", "tutorial", "--inactive", JTC
    )
    file = bundled_motions("doosan_a0912")["tutorial"]
    assert (code, out) == (2, "")
    assert err == (
        f"arm-drake: {file}:6: [0].goal: controller {JTC!r} is inactive, not active\n"
    )


PACKAGE = "ros2_control_demos/ros2_control_demo_example_3"
FORWARD = "forward_position_controller"
VELOCITY = "forward_velocity_controller"
ILLEGAL = "forward_illegal1_controller"


@pytest.fixture
def rrbot(run):
    """Return what simulates a real robot whose controllers compete for its joints."""
    file = real_robot(f"{PACKAGE}/urdf/rrbot_system_multi_interface.urdf.xacro")
    return lambda *arguments: run("sim", file, "--headless", *arguments)


def errors(err: str) -> list[str]:
    return [line for line in err.splitlines() if line.startswith("arm-drake: ")]


def table(out: str) -> dict[str, str]:
    """Return the states of the controllers by name, those printed last."""
    rows = [line.split() for line in out.splitlines()]
    return {row[0]: row[2] for row in rows if len(row) == 3 and "/" in row[1]}


@pytest.mark.slow
def test_sim_lists_the_controllers_with_their_states(rrbot):
    code, out, _ = rrbot("--duration", 0.1)

    assert code == 0
    assert out.splitlines()[1].split() == [
        FORWARD,
        "forward_command_controller/ForwardCommandController",
        "active",
    ]
    inactive = {name for name, state in table(out).items() if state == "inactive"}
    assert inactive == {
        VELOCITY,
        "forward_acceleration_controller",
        ILLEGAL,
        "forward_illegal2_controller",
    }
    assert out.count(FORWARD) == 1


@pytest.mark.slow
def test_active_and_inactive_choose_the_controllers(rrbot):
    code, out, _ = rrbot("--duration", 0.1, "--active", VELOCITY, "--json")
    other = rrbot(
        "--duration", 0.1, "--inactive", FORWARD, "--active", ILLEGAL,
        "--active", "forward_illegal2_controller",
    )  # fmt: skip

    states = {row["name"]: row["state"] for row in json.loads(out)["controllers"]}
    assert (code, other[0]) == (0, 0)
    assert (states[VELOCITY], states[FORWARD]) == ("active", "inactive")
    states = table(other[1])
    assert (states[ILLEGAL], states["forward_illegal2_controller"]) == (
        "active",
        "active",
    )
    assert states[FORWARD] == "inactive"


@pytest.mark.slow
def test_a_motion_switches_controllers(rrbot, tmp_path):
    motion = motion_file(
        tmp_path,
        f"- {{controller: {FORWARD}, commands: [0.1, 0.1]}}\n"
        f"- {{at: 0.5, switch_controllers: {{activate: [{VELOCITY}], "
        f"deactivate: [{FORWARD}]}}}}\n"
        f"- {{at: 0.5, controller: {VELOCITY}, commands: [0.1, 0]}}\n",
    )

    code, out, err = rrbot("--motion", motion)

    assert (code, errors(err)) == (0, [])
    assert f"switch of controllers: activate {VELOCITY}; deactivate {FORWARD}\n" in out
    # The table is printed again, for it has changed.
    assert (table(out)[FORWARD], table(out)[VELOCITY]) == ("inactive", "active")
    assert out.count(f"\n{VELOCITY} ") == 2


CLAIMED = (
    f"could not activate {ILLEGAL!r}: 'joint1/position' is claimed by {FORWARD!r}, "
    "which stays active"
)


@pytest.mark.slow
def test_a_refused_switch_exits_with_1_and_its_place(rrbot, tmp_path):
    text = f"- {{at: 0.1, switch_controllers: {{activate: [{ILLEGAL}]}}}}\n"
    motion = motion_file(tmp_path, text)

    code, out, err = rrbot("--motion", motion, "--json")

    line = (
        f"{motion}:1: [0].switch_controllers: controller_manager: switch refused: "
        f"{CLAIMED}"
    )
    assert code == 1
    assert errors(err) == [f"arm-drake: {line}"]
    assert json.loads(out)["failures"] == [line]


@pytest.mark.slow
def test_what_best_effort_leaves_out_is_a_warning(rrbot, tmp_path):
    motion = motion_file(
        tmp_path,
        "- {switch_controllers: {strictness: best_effort, "
        f"activate: [{ILLEGAL}, {FORWARD}]}}}}\n",
    )

    code, _, err = rrbot("--motion", motion)

    assert (code, errors(err)) == (0, [])
    (line,) = [line for line in err.splitlines() if "left out" in line]
    assert line.startswith("warning: left out: ")
    assert CLAIMED in line


@pytest.mark.slow
def test_an_unknown_controller_in_a_switch_is_found_before_the_start(rrbot, tmp_path):
    text = "- {switch_controllers: {activate: [forward_position]}}\n"
    motion = motion_file(tmp_path, text)

    code, out, err = rrbot("--motion", motion)

    assert (code, out) == (2, "")
    (line,) = errors(err)
    assert line.startswith(
        f"arm-drake: {motion}:1: [0].switch_controllers: no controller "
        f"'forward_position'; did you mean {FORWARD!r}? known: "
    )


@pytest.mark.slow
def test_commands_of_a_wrong_size_are_found_before_the_start(rrbot, tmp_path):
    motion = motion_file(tmp_path, f"- {{controller: {FORWARD}, commands: [0.1]}}\n")

    code, out, err = rrbot("--motion", motion)

    assert (code, out) == (2, "")
    assert errors(err) == [
        f"arm-drake: {motion}:1: [0].commands: controller {FORWARD!r}: expected 2 "
        "values (joint1/position, joint2/position), got 1"
    ]


@pytest.mark.slow
def test_commands_for_a_controller_that_was_deactivated_are_refused(rrbot, tmp_path):
    motion = motion_file(
        tmp_path,
        f"- {{switch_controllers: {{deactivate: [{FORWARD}]}}}}\n"
        f"- {{at: 0.1, controller: {FORWARD}, commands: [0.1, 0.1]}}\n",
    )

    code, _, err = rrbot("--motion", motion)

    assert code == 1
    assert errors(err) == [
        f"arm-drake: {motion}:2: [1].commands: {FORWARD}: commands refused: the "
        "controller is not active"
    ]


@pytest.mark.slow
def test_a_goal_for_a_controller_that_was_deactivated_is_rejected(run, tmp_path):
    motion = goal_file(tmp_path)
    switch = f"- {{switch_controllers: {{deactivate: [{JTC}]}}}}\n"
    motion.write_text(switch + motion.read_text().replace("{contr", "{at: 0.1, contr"))

    code, _, err = run("sim", "doosan_a0912", "--headless", "--motion", motion)

    assert code == 1
    (line,) = errors(err)
    assert line.startswith(
        f"arm-drake: {motion}:2: [1].goal: {JTC}: goal REJECTED, error code -1: "
    )


@pytest.mark.slow
def test_a_controller_that_fails_is_a_line_of_its_own():
    file = real_robot(f"{PACKAGE}/urdf/rrbot_system_multi_interface.urdf.xacro")
    sim = ad.Simulation(ad.build_diagram(ad.load_robot(file)))
    # Past the motion, where it would have been found.
    sim.publish(f"{FORWARD}.commands", Float64MultiArray((1.0,)), 0.01)
    sim.advance_to(0.1)

    assert list_failures(sim.mailbox) == [
        f"{FORWARD}: commands refused: data must have 2 values (joint1/position, "
        "joint2/position), got 1; the update fails",
        f"{FORWARD}: the update failed (data must have 2 values (joint1/position, "
        "joint2/position), got 1), the controller is deactivated",
    ]


@pytest.mark.slow
def test_a_robot_of_gazebo_takes_commands(run, tmp_path):
    package = "gazebo_ros2_control_demos/gazebo_ros2_control_demos"
    file = real_robot(
        f"{package}/urdf/test_vertical_cart_position_pids_in_yaml.xacro.urdf"
    )
    text = "- {controller: position_controller, commands: [0.5]}\n"
    motion = motion_file(tmp_path, text)

    code, out, err = run(
        "sim", file, "--headless", "--motion", motion, "--duration", 4, "--json"
    )

    assert (code, errors(err)) == (0, [])
    (position,) = json.loads(out)["final"].values()
    # Its own gains drive it, kp = 100 and ki = 1, and nothing else bears its 1 kg.
    sag = 1.0 * 9.81 / 100.0 * math.exp(-1.0 / 100.0 * 4.0)
    assert position == pytest.approx(0.5 - sag, abs=1e-3)


@pytest.mark.slow
def test_the_kinematic_preset_has_no_physics(rrbot, tmp_path):
    text = f"- {{controller: {FORWARD}, commands: [0.5, -0.5]}}\n"
    motion = motion_file(tmp_path, text)

    code, out, _ = rrbot(
        "--motion", motion, "--duration", 0.1, "--preset", "kinematic", "--json"
    )

    assert code == 0
    assert json.loads(out)["final"] == {"joint1": 0.5, "joint2": -0.5}


@pytest.mark.parametrize(
    "arguments",
    [
        ["sim"],
        ["fly", "doosan_a0912"],
        ["sim", "doosan_a0912", "--duration", "-1"],
        ["sim", "doosan_a0912", "--rate", "fast"],
        ["sim", "doosan_a0912", "color"],
    ],
)
def test_wrong_usage_exits_with_2(run, arguments):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("arm-drake: ")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_motion_with_nan_is_found_before_the_start(run, tmp_path):
    points = "[{positions: [0, .nan, 0, 0, 0, 0], time_from_start: 1}]"
    motion = goal_file(tmp_path, points=points)

    code, out, err = run("sim", "doosan_a0912", "--headless", "--motion", motion)

    assert (code, out) == (2, "")
    assert err == (
        f"arm-drake: {motion}:1: [0].goal.points[0].positions[1]: expected a finite "
        "number, got nan\n"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--port", "80"], "port 80: expected 1024 to 65535, or 0 for any free one"),
        (
            ["--port", "99999"],
            "port 99999: expected 1024 to 65535, or 0 for any free one",
        ),
        (
            ["--host", "203.0.113.7"],
            "host '203.0.113.7': expected localhost, * (all addresses) or an address "
            "of this machine",
        ),
    ],
)
def test_where_the_page_cannot_be_is_said(run, arguments, message):
    code, out, err = run("sim", "doosan_a0912", "--duration", 0.1, *arguments)
    assert (code, out, err) == (2, "", f"arm-drake: {message}\n")


@pytest.mark.slow
def test_a_cancelled_goal_is_no_failure(run, tmp_path):
    points = "[{positions: [0, 0, 0, 0, 0, 0], time_from_start: 2}]"
    motion = goal_file(tmp_path, points=points)
    cancel = f"- {{at: 0.1, controller: {JTC}, cancel: true}}\n"
    motion.write_text(motion.read_text() + cancel)

    code, out, err = run(
        "sim", "doosan_a0912", "--headless", "--motion", motion, "--duration", 0.3
    )

    assert code == 0
    assert f"{JTC}: CANCELED, error code 0\n" in out
    assert "arm-drake:" not in err


@pytest.mark.slow
def test_an_existing_log_survives_a_run_that_does_not_start(run, tmp_path):
    log = tmp_path / "a.npz"
    log.write_bytes(b"precious")
    run("sim", "doosan_a0912", "--headless", "--log", log, "--motion", "nowhere.yaml")
    assert log.read_bytes() == b"precious"


@pytest.mark.slow
def test_the_module_runs_like_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "arm_drake", "list"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONWARNINGS": "error"},
    )
    assert "doosan_a0912" in done.stdout


@pytest.mark.slow
def test_texts_are_printed_where_only_ascii_is_understood(tmp_path):
    robot = tmp_path / "größe.urdf"
    robot.write_text(
        '<robot name="größe"><link name="a"/><link name="b"/><joint name="j" '
        'type="fixed"><parent link="a"/><child link="b"/></joint></robot>',
        encoding="utf-8",
    )

    done = [
        subprocess.run(
            [sys.executable, "-m", "arm_drake", "check", str(file)],
            env=os.environ | {"PYTHONIOENCODING": "ascii"},
            capture_output=True,
            text=True,
            encoding="ascii",
            timeout=120,
            check=False,
        )
        for file in (robot, tmp_path / "flöte.urdf")
    ]

    assert [one.returncode for one in done] == [0, 2], done
    assert done[0].stdout.startswith("gr\\xf6\\xdfe: ")
    assert "fl\\xf6te.urdf" in done[1].stderr
    assert "Traceback" not in done[0].stderr + done[1].stderr


@pytest.mark.slow
def test_a_goal_beyond_the_limits_is_warned_of_once(run, tmp_path):
    point = "{positions: [45, 10, 0, 0, 0, 0], time_from_start: 0.1}"
    motion = goal_file(tmp_path, points=f"[{point}, {point.replace('0.1', '0.2')}]")

    _, _, err = run(
        "sim", "doosan_a0912", "--headless", "--motion", motion, "--duration", "0.01"
    )

    place = f"warning: {motion}:1: [0].goal.points[0]"
    assert err.splitlines()[:2] == [
        f"{place}: joint1 45 is outside [-6.2832, 6.2832]; in degrees?",
        f"{place}: joint2 10 is outside [-6.2832, 6.2832]; in degrees?",
    ]


@pytest.mark.slow
def test_sim_exits_with_1_when_a_goal_does_not_end(run):
    # Without an upper bound of its time, a goal that isn't reached goes on.
    command = ("sim", "doosan_a0912", "--motion", "tutorial", "--headless")

    code, _, err = run(*command, "--payload", "link6=200")

    assert code == 1
    assert "goal is still EXECUTING" in err
    assert run(*command, "--payload", "link6=200", "--duration", "1")[0] == 0


@pytest.mark.slow
def test_payloads_are_confirmed(run):
    command = ("sim", "doosan_a0912", "--headless", "--duration", "0.01")

    _, out, _ = run(*command, "--payload", "link6=2.0")

    assert "payload: 2 kg on link6, at its origin" in out.splitlines()
