"""Bad parameters and messages: one clear line each, and the other controllers run."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.manager.state import ControllerFailure
from arm_drake.messages import (
    Float64MultiArray,
    Message,
    MultiDOFCommand,
    TopicRejected,
)
from tests import models

PERIOD = 0.01

TYPES = {
    "jtc": "joint_trajectory_controller/JointTrajectoryController",
    "forward": "forward_command_controller/ForwardCommandController",
    "pid": "pid_controller/PidController",
    "group": "position_controllers/JointGroupPositionController",
}
PARAMETERS = {
    "jtc": (
        "joints: [j1]",
        "command_interfaces: [position]",
        "state_interfaces: [position, velocity]",
    ),
    "forward": ("joints: [j2]", "interface_name: velocity"),
    "pid": (
        "dof_names: [j3]",
        "command_interface: effort",
        "reference_and_state_interfaces: [position]",
        "gains: {j3: {p: 20.0, i: 20.0, i_clamp_max: 10.0, i_clamp_min: -10.0}}",
    ),
    "group": ("joints: [j4]",),
}
JOINTS = dict(zip(TYPES, ("j1", "j2", "j3", "j4"), strict=True))

INTERFACES = "".join(
    f'<command_interface name="{name}"/><state_interface name="{name}"/>'
    for name in ("position", "velocity", "effort")
)
CONTROL = "".join(
    f'<joint name="{joint}">{INTERFACES}</joint>' for joint in JOINTS.values()
)
ARMS = "".join(
    models.joint(joint, "base", f"link_{joint}", inside='<dynamics damping="2"/>')
    + models.bob(f"link_{joint}")
    for joint in JOINTS.values()
)
ROBOT = f"""
<robot name="four">
  <link name="base"/>{ARMS}
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>{CONTROL}
  </ros2_control>
</robot>"""


def write_yaml(
    folder: Path, changes: Mapping[str, str], types: Mapping[str, str]
) -> Path:
    """Write the controllers' YAML.

    Args:
        folder: Where to write it.
        changes: Parameters that a controller gets besides or instead, "joints: [a]";
            "-joints" takes one away.
        types: Types that are not the usual ones.
    """
    rows, sections = "", []
    for name, type_ in TYPES.items():
        rows += f", {name}: {{type: {types.get(name, type_)}}}"
        lines = {line.partition(":")[0]: line for line in PARAMETERS[name]}
        change = changes.get(name, "")
        if change.startswith("-"):
            del lines[change[1:]]
        elif change:
            lines[change.partition(":")[0]] = change
        sections.append(f"{name}: {{ros__parameters: {{{', '.join(lines.values())}}}}}")
    manager = f"controller_manager: {{ros__parameters: {{update_rate: 100{rows}}}}}"
    file = folder / "controllers.yaml"
    file.write_text("\n".join([manager, *sections]), encoding="utf-8")
    return file


def simulate(
    folder: Path,
    changes: Mapping[str, str] | None = None,
    types: Mapping[str, str] | None = None,
    **options: object,
) -> ad.Simulation:
    urdf = folder / "robot.urdf"
    urdf.write_text(ROBOT, encoding="utf-8")
    yaml = write_yaml(folder, changes or {}, types or {})
    robot = ad.load_robot(urdf, controllers=yaml)
    settings = ad.SimulationOptions(**{"time_step": PERIOD, **options})
    return ad.Simulation(ad.build_diagram(robot, options=settings))


def states(sim: ad.Simulation) -> dict[str, str]:
    return {row.name: row.state for row in sim.list_controllers()}


def point(*positions: float, time: float = 0.5) -> ad.JointTrajectory:
    return ad.JointTrajectory(
        joint_names=["j1"],
        points=[ad.JointTrajectoryPoint(positions, time_from_start=time)],
    )


def send(sim: ad.Simulation, controller: str, message: Message) -> None:
    """Put a message on a controller's topic, past what checks it in Python."""
    topic = {"jtc": "joint_trajectory", "pid": "reference"}.get(controller, "commands")
    sim.publish(f"{controller}.{topic}", message, PERIOD)


def check_the_others(sim: ad.Simulation, *bad: str) -> None:
    """Check that each controller moves its joint, but for some."""
    start = sim.time
    good: dict[str, Message] = {
        "jtc": point(0.4),
        "forward": Float64MultiArray([0.5]),
        "pid": MultiDOFCommand(["j3"], [0.3]),
        "group": Float64MultiArray([-0.2]),
    }
    for name, message in good.items():
        if name not in bad:
            assert states(sim)[name] == "active"
            send(sim, name, message)
    sim.advance_to(start + 4.0)

    joints = sim.joint_states()
    position = dict(zip(joints.name, joints.position, strict=True))
    velocity = dict(zip(joints.name, joints.velocity, strict=True))
    assert np.isfinite(joints.position).all()
    found = {
        "jtc": position["j1"] - 0.4,
        "forward": velocity["j2"] - 0.5,
        "pid": position["j3"] - 0.3,
        "group": position["j4"] + 0.2,
    }
    for name, error in found.items():
        if name not in bad:
            assert abs(error) < 0.02, name


@pytest.mark.slow
def test_without_bad_input_all_of_them_run(tmp_path: Path) -> None:
    sim = simulate(tmp_path)

    assert [entry.what for entry in sim.report] == []
    check_the_others(sim)
    assert (sim.rejected, sim.failures) == ([], [])


# What is wrong, and what it is called after the name of the file.
BAD_PARAMETERS = [
    ("jtc", "joints: 3", ":2: jtc.joints: expected a list of str, got 3"),
    ("jtc", "-joints", ":1: jtc.joints: is required but missing"),
    (
        "jtc",
        "state_interfaces: [velocity]",
        ":2: jtc: state_interfaces must have 'position', got ['velocity']",
    ),
    (
        "jtc",
        "action_monitor_rate: 0.0",
        ":2: jtc: action_monitor_rate must be at least 0.1 Hz, got 0.0",
    ),
    (
        "jtc",
        "action_monitor_rate: fast",
        ":2: jtc.action_monitor_rate: expected float, got 'fast'",
    ),
    (
        "jtc",
        "interpolation_method: quintic",
        ":2: jtc.interpolation_method: expected one of ['splines', 'none'], got "
        "'quintic'",
    ),
    (
        "jtc",
        "update_rate: -5",
        ":2: jtc.update_rate: expected an integer from 1 to 100 Hz, got -5",
    ),
    ("forward", "joints: []", ":3: forward: joints must have at least one element"),
    (
        "forward",
        "interface_name: [velocity]",
        ":3: forward.interface_name: expected str, got ['velocity']",
    ),
    (
        "forward",
        "-interface_name",
        ":1: forward.interface_name: is required but missing",
    ),
    (
        "pid",
        "dof_names: [j3, j3]",
        ":4: pid: dof_names must not repeat elements, got ['j3', 'j3']",
    ),
    (
        "pid",
        "gains: {j3: {p: much}}",
        ":4: pid.gains.j3.p: expected float, got 'much'",
    ),
    (
        "pid",
        "gains: {j3: {p: 1.0, i_clamp_max: -1.0}}",
        ":1: pid: gains.j3.i_clamp_min and i_clamp_max must have 0 between them, got "
        "-inf and -1.0",
    ),
    (
        "group",
        "joints: {a: 1}",
        ":5: group.joints: is required but missing, 'joints.a' is given instead",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "change", "message"), BAD_PARAMETERS)
def test_a_bad_parameter_stops_its_controller_alone(
    tmp_path: Path, controller: str, change: str, message: str
) -> None:
    sim = simulate(tmp_path, {controller: change})

    file = tmp_path / "controllers.yaml"
    lines = [str(entry) for entry in sim.report if entry.severity == "error"]
    assert lines == [f"error: {file}{message}; the controller does not run"]
    assert states(sim)[controller] == "unconfigured"
    check_the_others(sim, controller)


@pytest.mark.slow
@pytest.mark.parametrize("bad", TYPES)
def test_an_unknown_type_stops_its_controller_alone(tmp_path: Path, bad: str) -> None:
    sim = simulate(tmp_path, types={bad: "my_package/MyController"})

    (line,) = [entry for entry in sim.report if entry.severity == "error"]
    assert line.what == "unknown controller type 'my_package/MyController'"
    assert line.where == bad
    assert states(sim)[bad] == "unconfigured"
    check_the_others(sim, bad)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "change", "message"),
    [
        (
            "jtc",
            "joints: [j5]",
            "the robot has no joint 'j5'; did you mean 'j4'? known: j1, j2, j3, j4",
        ),
        (
            "forward",
            "interface_name: torque",
            "joint 'j2' has no command interface 'torque'; it has ['effort', "
            "'position', 'velocity']",
        ),
        (
            "pid",
            "command_interface: current",
            "joint 'j3' has no command interface 'current'; it has ['effort', "
            "'position', 'velocity']",
        ),
        (
            "group",
            "joints: [j]",
            "the robot has no joint 'j'; did you mean 'j4'? known: j1, j2, j3, j4",
        ),
        (
            "group",
            "joints: [j4, elbow]",
            "the robot has no joint 'elbow'; known: j1, j2, j3, j4",
        ),
    ],
)
def test_what_the_robot_lacks_is_named_and_stops_no_other_controller(
    tmp_path: Path, controller: str, change: str, message: str
) -> None:
    sim = simulate(tmp_path, {controller: change})

    errors = [entry for entry in sim.report if entry.severity == "error"]
    assert [(entry.where, entry.what) for entry in errors] == [(controller, message)]
    assert states(sim)[controller] == "inactive"
    with pytest.raises(InputError) as error:
        sim.switch_controllers([controller])
    assert str(error.value) == f"could not activate {controller!r}: {message}"
    check_the_others(sim, controller)


BAD = [np.nan, np.inf, -np.inf]


@pytest.mark.slow
@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("controller", ["forward", "group"])
def test_a_command_that_is_no_number_is_dropped(
    tmp_path: Path, controller: str, value: float
) -> None:
    sim = simulate(tmp_path)
    message = Float64MultiArray([value])

    send(sim, controller, message)
    sim.advance_to(0.1)

    reason = f"data[0] must be finite, got {value}; it is dropped"
    assert sim.rejected == [TopicRejected(message, reason)]
    assert sim.joint_states().velocity == pytest.approx([0.0] * 4, abs=1e-9)
    check_the_others(sim)


@pytest.mark.slow
@pytest.mark.parametrize("value", BAD)
def test_a_trajectory_that_is_no_number_is_rejected(
    tmp_path: Path, value: float
) -> None:
    sim = simulate(tmp_path)
    bad = point(value)

    goal = sim.controller("jtc").send_goal(bad)
    send(sim, "jtc", bad)
    sim.advance_to(0.1)

    reason = f"points[0].positions[0] is {value}; expected a finite number"
    assert goal.status is ad.GoalStatus.REJECTED
    assert goal.result is not None
    assert goal.result.error_string == reason
    assert sim.rejected == [TopicRejected(bad, reason)]
    check_the_others(sim)


@pytest.mark.slow
@pytest.mark.parametrize("value", BAD)
def test_a_reference_that_is_no_number_moves_nothing(
    tmp_path: Path, value: float
) -> None:
    sim = simulate(tmp_path)
    send(sim, "pid", MultiDOFCommand(["j3"], [value]))

    sim.advance_to(0.5)

    assert sim.joint_states().position == pytest.approx([0.0] * 4, abs=1e-6)
    # A pid controller takes it, as upstream does; the next good one counts.
    check_the_others(sim)


def test_a_command_of_another_size_ends_its_controller_alone(tmp_path: Path) -> None:
    sim = simulate(tmp_path)
    message = Float64MultiArray([0.1, 0.2])

    send(sim, "forward", message)
    sim.advance_to(0.1)

    reason = "data must have 1 value (j2/velocity), got 2"
    assert sim.rejected == [TopicRejected(message, f"{reason}; the update fails")]
    assert sim.failures == [ControllerFailure("forward", ("forward",), reason=reason)]
    assert states(sim) == dict.fromkeys(TYPES, "active") | {"forward": "inactive"}
    check_the_others(sim, "forward")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "message", "reason"),
    [
        (
            "jtc",
            point(0.1, 0.2),
            "points[0].positions has 2 elements; expected 1, one per joint",
        ),
        (
            "pid",
            MultiDOFCommand(["j3"], [0.1, 0.2]),
            "values must have 1 elements (j3), got 2",
        ),
        ("pid", MultiDOFCommand(["j4"], [0.1]), "dof_names must be j3, got j4"),
        (
            "pid",
            MultiDOFCommand([], [0.1, 0.2]),
            "values must have 1 elements (j3), got 2",
        ),
    ],
)
def test_a_message_of_another_size_is_rejected(
    tmp_path: Path, controller: str, message: Message, reason: str
) -> None:
    sim = simulate(tmp_path)

    send(sim, controller, message)
    sim.advance_to(0.1)

    assert sim.rejected == [TopicRejected(message, reason)]
    check_the_others(sim)


def test_a_message_for_another_topic_is_an_error_before_it_is_sent(
    tmp_path: Path,
) -> None:
    sim = simulate(tmp_path)

    with pytest.raises(InputError):
        sim.controller("jtc").command([0.1])
    with pytest.raises(InputError):
        sim.controller("forward").send_goal(point(0.1))

    check_the_others(sim)


@pytest.mark.slow
@pytest.mark.parametrize("controller", TYPES)
def test_what_is_sent_to_an_inactive_controller_is_refused(
    tmp_path: Path, controller: str
) -> None:
    sim = simulate(tmp_path, inactive=(controller,))
    message: Message = {
        "jtc": point(0.4),
        "pid": MultiDOFCommand(["j3"], [0.4]),
    }.get(controller, Float64MultiArray([0.4]))

    send(sim, controller, message)
    goal = sim.controller("jtc").send_goal(point(0.4))
    sim.advance_to(0.1)

    (rejected,) = sim.rejected
    assert isinstance(rejected, TopicRejected)
    assert rejected.message is message
    assert "active" in rejected.reason
    if controller == "jtc":
        assert goal.status is ad.GoalStatus.REJECTED
        assert goal.result is not None
        assert goal.result.error_string == rejected.reason
    check_the_others(sim, controller)


@pytest.mark.slow
def test_a_switch_of_an_unknown_controller_changes_nothing(tmp_path: Path) -> None:
    sim = simulate(tmp_path)

    for arguments in (
        {"activate": ["grup"]},
        {"deactivate": ["grup"]},
        {"activate": ["grup"], "deactivate": ["jtc"]},
    ):
        with pytest.raises(InputError) as error:
            sim.switch_controllers(**arguments)
        hint = "did you mean 'group'? known: forward, group, jtc, pid"
        assert str(error.value) == f"no controller 'grup'; {hint}"

    assert states(sim) == dict.fromkeys(TYPES, "active")
    check_the_others(sim)


@pytest.mark.slow
@pytest.mark.parametrize("value", BAD)
def test_a_goal_with_a_bad_tolerance_or_time_leaves_the_robot_alone(
    tmp_path: Path, value: float
) -> None:
    sim = simulate(tmp_path)

    with pytest.raises((ValueError, OverflowError)):
        point(0.1, time=value)

    check_the_others(sim)
