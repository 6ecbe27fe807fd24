"""`arm-drake graph`: what a robot's files say is in the picture."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.commands.graph import make_graph
from arm_drake.manager.loading import load_controllers_of
from arm_drake.visualization.control_graph import make_dot
from tests.models import GRIPPER, pendulum, ros2_control, trajectory_controllers

JTC = "joint_trajectory_controller"


@pytest.fixture
def run(capsys):
    """Run the command; return its exit code, standard output and standard error."""

    def run_command(*arguments) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(["graph", *map(str, arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run_command


def texts(file) -> set[str]:
    tag = "{http://www.w3.org/2000/svg}text"
    return {element.text for element in ET.parse(file).iter(tag)}  # noqa: S314  our own.


def write(folder, urdf, controllers=None):
    """Return the words of a command line for a robot from its texts."""
    file = folder / "robot.urdf"
    file.write_text(urdf, encoding="utf-8")
    if controllers is None:
        return [file]
    yaml = folder / "controllers.yaml"
    yaml.write_text(controllers, encoding="utf-8")
    return [file, "--controllers", yaml]


@pytest.mark.slow
def test_a_bundled_robot_is_drawn_with_all_controllers_and_interfaces(run, tmp_path):
    file = tmp_path / "graph.svg"

    code, out, err = run("doosan_a0912", "-o", file)

    assert (code, out, err) == (0, f"graph: {file}\n", "")
    joints = [f"joint{number}" for number in range(1, 7)]
    names = {f"{j}/{i}" for j in joints for i in ("position", "velocity", "effort")}
    names |= {"doosan_a0912", JTC, "joint_state_broadcaster", "active"}
    names |= {f"{JTC}/JointTrajectoryController", "→ joint_trajectory"}
    names |= {"joint_state_broadcaster/JointStateBroadcaster", "joint_states →"}
    assert names <= texts(file)


def test_json_says_what_each_controller_reads_and_commands(run, tmp_path):
    yaml = trajectory_controllers({"arm": ["swing"], "other": ["swing"]})
    robot = write(tmp_path, pendulum(), yaml)
    file = tmp_path / "graph.dot"

    code, out, _ = run(*robot, "-o", file, "--json")

    content = json.loads(out)
    assert code == 0
    assert content["robot"] == "pendulum"
    assert content["graph"] == str(file)
    arm, other = content["controllers"]
    assert (arm["name"], arm["state"]) == ("arm", "active")
    assert arm["commands"] == ["swing/position"]
    assert arm["reads"] == ["swing/position", "swing/velocity"]
    # The interface is claimed.
    assert (other["name"], other["state"]) == ("other", "inactive")
    (hardware,) = content["hardware"]
    assert hardware["commands"] == ["swing/position"]
    assert hardware["states"] == [
        "swing/position", "swing/velocity", "swing/effort",
    ]  # fmt: skip
    assert file.read_text(encoding="utf-8").startswith('digraph "pendulum" {')


@pytest.mark.slow
def test_a_controller_that_does_not_load_is_drawn_as_unconfigured(run, tmp_path):
    yaml = trajectory_controllers({"arm": ["swing"]}).replace("Controller\n", "Contr\n")
    file = tmp_path / "graph.svg"

    code, _, err = run(*write(tmp_path, pendulum(), yaml), "-o", file)

    assert code == 0
    assert "unknown controller type" in err
    assert {"arm", "unconfigured", f"{JTC}/JointTrajectoryContr"} <= texts(file)


@pytest.mark.slow
def test_a_joint_without_an_interface_is_named(run, tmp_path):
    alone = ros2_control("finger")
    urdf = GRIPPER.replace(ros2_control("finger", states=("follower",)), alone)
    file = tmp_path / "graph.svg"

    code, _, _ = run(*write(tmp_path, urdf), "-o", file)

    assert code == 0
    assert "follower: no interface, follows finger" in texts(file)
    assert "follower/position" not in texts(file)


@pytest.mark.slow
def test_without_ros2_control_the_simulated_hardware_is_drawn(run, tmp_path):
    file = tmp_path / "graph.svg"

    code, _, _ = run(*write(tmp_path, pendulum(control="")), "-o", file)

    assert code == 0
    assert {"swing/position", "swing/velocity", "swing/effort"} <= texts(file)
    assert "system: simulated by Drake" in texts(file)


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (
            "graph.jpg",
            "unknown type '.jpg' of a graph; expected one of .svg, .png, .pdf, .dot",
        ),
        ("missing/graph.svg", "can't be written: the folder {folder!r} doesn't exist"),
    ],
)
def test_a_graph_that_cannot_be_written_is_said_at_once(run, tmp_path, output, message):
    file = tmp_path / output

    # The robot isn't loaded for it: there is none.
    code, out, err = run("no_robot", "-o", file)

    message = message.format(folder=str(file.parent))
    assert (code, out, err) == (2, "", f"arm-drake: {file}: {message}\n")


def test_strict_refuses_a_robot_with_a_report(run, tmp_path):
    yaml = trajectory_controllers({"arm": ["swing"]}, unknown_parameter=1)
    file = tmp_path / "graph.svg"

    code, out, err = run(*write(tmp_path, pendulum(), yaml), "-o", file, "--strict")

    assert (code, out) == (2, "")
    assert "arm-drake: not everything was taken as written:\n" in err
    assert "unknown_parameter" in err
    assert not file.exists()


def test_a_chain_leads_from_controller_to_controller(tmp_path):
    forward = "forward_command_controller/ForwardCommandController"
    yaml = tmp_path / "controllers.yaml"
    yaml.write_text(
        "controller_manager: {ros__parameters: {update_rate: 100, "
        f"top: {{type: {forward}}}, pid: {{type: pid_controller/PidController}}}}}}\n"
        "top: {ros__parameters: {joints: [pid/joint1], interface_name: position}}\n"
        "pid: {ros__parameters: {dof_names: [joint1], command_interface: position, "
        "reference_and_state_interfaces: [position], gains: {joint1: {p: 1.0}}}}\n",
        encoding="utf-8",
    )
    robot = ad.load_robot("doosan_a0912", controllers=yaml)
    controllers, _ = load_controllers_of(robot)

    graph = make_graph(robot, controllers)

    assert [node.followers for node in graph.controllers] == [("pid",), (), ()]
    assert graph.notes[0] == "top commands pid"
    assert '"controller top" -> "controller pid";' in make_dot(graph)


@pytest.mark.slow
def test_a_graph_as_text_does_not_wait_for_matplotlib(tmp_path):
    file = tmp_path / "graph.dot"
    words = [*map(str, write(tmp_path, pendulum())), "-o", str(file)]

    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "arm_drake", "graph", *words],
        capture_output=True,
        text=True,
        check=True,
    )

    assert "arm_drake.commands.graph" in done.stderr
    assert "matplotlib" not in done.stderr
    assert file.read_text(encoding="utf-8").startswith('digraph "pendulum" {\n')
