"""Interfaces that nobody has: one line of the report, the rest runs."""

from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.errors import InputError
from tests import models

JOINT = "".join(
    f'<command_interface name="{name}"/><state_interface name="{name}"/>'
    for name in ("position", "velocity")
)
IMU = "".join(
    f'<state_interface name="{group}.{axis}"/>'
    for group, axes in (
        ("orientation", "xyz"),  # No w.
        ("angular_velocity", "xyz"),
        ("linear_acceleration", "xyz"),
    )
    for axis in axes
)
ROBOT = f"""
<robot name="arm">
  <link name="base"/>
  {models.joint("j1", "base", "a", xyz="0 0 1")}{models.bob("a")}
  {models.joint("j2", "a", "b", xyz="0 0 -0.5")}{models.bob("b")}
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>
    <joint name="j1">{JOINT}</joint><joint name="j2">{JOINT}</joint>
    <sensor name="imu">{IMU}</sensor>
    <sensor name="wrist"><state_interface name="force.x"/></sensor>
    <gpio name="lamp">
      <command_interface name="on"/><state_interface name="on"/>
    </gpio>
  </ros2_control>
</robot>"""

GROUP = "position_controllers/JointGroupPositionController"
FORWARD = "forward_command_controller/ForwardCommandController"
FILTER = "chained_filter_controller/ChainedFilter"
PID = "pid_controller/PidController"
GPIO = "gpio_controllers/GpioCommandController"
VALUES = "state_interfaces_broadcaster/StateInterfacesBroadcaster"

# What runs beside, whatever is wrong with the others.
GOOD = ("good", GROUP, "{joints: [j2]}")

Controller = tuple[str, str, str]


def forward(name: str, joint: str, interface: str = "position") -> Controller:
    return name, FORWARD, f"{{joints: [{joint}], interface_name: {interface}}}"


def pid(name: str, joint: str, measured: str = "j1") -> Controller:
    """Return a PID that commands the position of a joint."""
    parameters = (
        f"{{dof_names: [{joint}], command_interface: position, "
        f"reference_and_state_dof_names: [{measured}], "
        f"reference_and_state_interfaces: [position], gains: {{{joint}: {{p: 1.0}}}}}}"
    )
    return name, PID, parameters


def filtered(name: str, of: str) -> Controller:
    parameters = f"{{input_interfaces: [{of}], output_interfaces: [x]}}"
    return name, FILTER, parameters


def watcher(*names: str) -> Controller:
    return "watcher", VALUES, f"{{interfaces: [{', '.join(names)}]}}"


def simulate(folder: Path, *controllers: Controller) -> ad.Simulation:
    rows = (GOOD, *controllers)
    lines = ["controller_manager:", "  ros__parameters:", "    update_rate: 100"]
    lines += [f"    {name}: {{type: {type_}}}" for name, type_, _ in rows]
    lines += [f"{name}: {{ros__parameters: {inputs}}}" for name, _, inputs in rows]
    robot = models.load(folder, ROBOT, "\n".join(lines))
    return ad.Simulation(ad.build_diagram(robot))


def reported(sim: ad.Simulation) -> list[tuple[str, str]]:
    """Return what the report says of controllers, and check that it says where."""
    names = {controller.name for controller in sim.list_controllers()}
    entries = [entry for entry in sim.report if entry.where in names]
    entries = [entry for entry in entries if entry.severity != "info"]
    for entry in entries:
        assert entry.file is not None
        assert entry.line is not None
        text = Path(entry.file).read_text(encoding="utf-8").splitlines()
        assert text[entry.line - 1].strip().startswith(f"{entry.where}:")
    return [(entry.where, entry.what) for entry in entries]


def states(sim: ad.Simulation) -> dict[str, str]:
    return {c.name: c.state for c in sim.list_controllers()}


def check_the_rest(sim: ad.Simulation) -> None:
    """Check that the good controller moves its joint."""
    sim.controller("good").command([0.2])
    sim.advance_to(1.0)
    assert sim.joint_states().position[1] == pytest.approx(0.2, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controllers", "message"),
    [
        # A link of a chain that is nowhere.
        (
            [forward("bad", "other/j1", "velocity")],
            "the robot has no joint 'other/j1', and there is no controller 'other'; "
            "known: bad, good",
        ),
        (
            [forward("bad", "goood/j1")],
            "the robot has no joint 'goood/j1', and there is no controller 'goood'; "
            "did you mean 'good'? known: bad, good",
        ),
        # One that takes no references, alone and beside one that does.
        (
            [forward("bad", "good/j2")],
            "controller 'good' takes no references, so there is no good/j2/position; "
            "none does",
        ),
        (
            [forward("bad", "good/j2"), pid("middle", "j1")],
            "controller 'good' takes no references, so there is no good/j2/position; "
            "those that do: middle",
        ),
        # One that has others.
        (
            [forward("bad", "middle/j1", "velocity"), pid("middle", "j1")],
            "controller 'middle' has no reference 'j1/velocity'; it has "
            "['j1/position']",
        ),
        # The same of exported states.
        (
            [filtered("bad", "good/j2/position")],
            "controller 'good' exports no states, so there is no good/j2/position; "
            "those that do: bad",
        ),
        (
            [filtered("bad", "middle/y"), filtered("middle", "j1/position")],
            "controller 'middle' has no exported state 'y'; it has ['x']",
        ),
    ],
)
def test_a_chain_with_a_missing_link_is_one_line(
    tmp_path: Path, controllers: list[Controller], message: str
) -> None:
    sim = simulate(tmp_path, *controllers)

    assert reported(sim) == [("bad", message)]
    expected = {name: "active" for name, *_ in (GOOD, *controllers)}
    assert states(sim) == {**expected, "bad": "inactive"}
    check_the_rest(sim)


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader", [forward("bad", "middle/j1"), filtered("bad", "middle/x")]
)
def test_a_link_that_did_not_load_is_named_as_such(
    tmp_path: Path, reader: Controller
) -> None:
    middle = ("middle", FILTER, "{output_interfaces: [x]}")

    sim = simulate(tmp_path, reader, middle)

    name = "middle/j1/position" if reader[1] == FORWARD else "middle/x"
    kind = "command" if reader[1] == FORWARD else "state"
    problem = (
        f"{kind} interface '{name}' is of controller 'middle', which is not loaded; "
        "its own line says why"
    )
    assert reported(sim) == [("bad", problem)]
    assert [e.where for e in sim.report if e.severity == "error"] == [
        "middle.input_interfaces",
        "bad",
    ]
    assert states(sim) == {
        "good": "active",
        "bad": "inactive",
        "middle": "unconfigured",
    }
    check_the_rest(sim)


@pytest.mark.slow
def test_a_link_that_is_not_active_keeps_the_chain_inactive(tmp_path: Path) -> None:
    sim = simulate(tmp_path, pid("bad", "knee"), forward("top", "bad/j1"))

    assert reported(sim) == [
        ("bad", "the robot has no joint 'knee'; known: j1, j2"),
        ("top", "'bad/j1/position' belongs to 'bad', which is not active"),
    ]
    check_the_rest(sim)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("circle", "problem"),
    [
        ([pid("a", "a/j1")], "controllers command each other in a circle: 'a' -> 'a'"),
        (
            [pid("a", "b/j1"), pid("b", "a/j1")],
            "controllers command each other in a circle: 'a' -> 'b' -> 'a'",
        ),
        (
            [pid("a", "b/j1"), pid("b", "c/j1"), pid("c", "a/j1")],
            "controllers command each other in a circle: 'a' -> 'b' -> 'c' -> 'a'",
        ),
        (
            [filtered("a", "a/x")],
            "controllers wait for each other in a circle: 'a' needs 'a/x'",
        ),
        (
            [filtered("a", "b/x"), filtered("b", "a/x")],
            "controllers wait for each other in a circle: 'a' needs 'b/x', 'b' needs "
            "'a/x'",
        ),
        (
            # Who reads what its commander exports.
            [pid("a", "b/a/j1"), pid("b", "j1", measured="a/j1")],
            "controllers wait for each other in a circle: 'a' needs 'b/a/j1/position', "
            "'b' needs 'a/j1/position'",
        ),
    ],
)
def test_a_circle_is_one_line_and_who_needs_it_says_so(
    tmp_path: Path, circle: list[Controller], problem: str
) -> None:
    sim = simulate(tmp_path, *circle)

    (first, what), *others = reported(sim)
    assert (first, what) == (
        "a",
        f"{problem}; expected chains that end at the hardware",
    )
    # Of a longer circle the others wait for each other, up to the first.
    assert states(sim)["a"] == "unconfigured"
    assert {name for name, _ in others} == {name for name, *_ in circle[1:]}
    assert len(others) == len(circle) - 1
    assert "active" not in [state for n, state in states(sim).items() if n != "good"]
    check_the_rest(sim)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (
            (
                "bad",
                "imu_sensor_broadcaster/IMUSensorBroadcaster",
                "{sensor_name: imu, frame_id: a}",
            ),
            "sensor 'imu' has no state interface 'orientation.w'; it has "
            "['angular_velocity.x', 'angular_velocity.y', 'angular_velocity.z', "
            "'linear_acceleration.x', 'linear_acceleration.y', "
            "'linear_acceleration.z', 'orientation.x', 'orientation.y', "
            "'orientation.z']",
        ),
        (
            (
                "bad",
                "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
                "{sensor_name: wrist, frame_id: a}",
            ),
            "sensor 'wrist' has no state interfaces 'force.y', 'force.z', 'torque.x', "
            "'torque.y', 'torque.z'; it has ['force.x']",
        ),
        (
            (
                "bad",
                "force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster",
                "{interface_names: {force: {x: wrist/force.z}}, frame_id: a}",
            ),
            "sensor 'wrist' has no state interface 'force.z'; it has ['force.x']",
        ),
        (
            (
                "bad",
                "range_sensor_broadcaster/RangeSensorBroadcaster",
                "{sensor_name: lamp, frame_id: a}",
            ),
            "gpio 'lamp' has no state interface 'range'; it has ['on']",
        ),
        (
            (
                "bad",
                "pose_broadcaster/PoseBroadcaster",
                "{pose_name: imuu, frame_id: a}",
            ),
            "the robot has no joint, sensor or gpio 'imuu'; did you mean 'imu'? known: "
            "imu, j1, j2, lamp, wrist",
        ),
        (
            (
                "bad",
                "gps_sensor_broadcaster/GPSSensorBroadcaster",
                "{sensor_name: imu, frame_id: a}",
            ),
            "sensor 'imu' has no state interfaces 'status', 'service', 'latitude', "
            "'longitude', 'altitude'; it has "
            "['angular_velocity.x', 'angular_velocity.y', 'angular_velocity.z', "
            "'linear_acceleration.x', 'linear_acceleration.y', "
            "'linear_acceleration.z', 'orientation.x', 'orientation.y', "
            "'orientation.z']",
        ),
        (
            (
                "bad",
                "magnetometer_broadcaster/MagnetometerBroadcaster",
                "{sensor_name: wrist, frame_id: a}",
            ),
            "sensor 'wrist' has no state interfaces 'magnetic_field.x', "
            "'magnetic_field.y', 'magnetic_field.z'; it has ['force.x']",
        ),
        (
            (
                "bad",
                "battery_state_broadcaster/BatteryStateBroadcaster",
                "{sensor_name: wrist}",
            ),
            "sensor 'wrist' has no state interface 'voltage'; it has ['force.x']",
        ),
        (
            ("bad", VALUES, "{interfaces: [j1/effort]}"),
            "joint 'j1' has no state interface 'effort'; it has ['position', "
            "'velocity']",
        ),
        (
            ("bad", VALUES, "{interfaces: [j3/position]}"),
            "the robot has no joint 'j3'; did you mean 'j2'? known: j1, j2",
        ),
        # A gpio with the name of a controller is the robot's.
        (
            (
                "lamp",
                GPIO,
                "{gpios: [lamp], command_interfaces: {lamp: {interfaces: [dim]}}}",
            ),
            "gpio 'lamp' has no command interface 'dim'; it has ['on']",
        ),
    ],
)
def test_a_broadcaster_whose_sensor_lacks_something_stays_inactive(
    tmp_path: Path, controller: Controller, message: str
) -> None:
    sim = simulate(tmp_path, controller)

    name = controller[0]
    assert reported(sim) == [(name, message)]
    assert states(sim) == {"good": "active", name: "inactive"}
    with pytest.raises(InputError) as error:
        sim.switch_controllers([name])
    assert str(error.value) == f"could not activate {name!r}: {message}"
    check_the_rest(sim)


def test_a_parameter_that_is_missing_is_looked_for_where_the_controller_is(
    tmp_path: Path,
) -> None:
    file = tmp_path / "c.yaml"
    file.write_text(
        "controller_manager:\n"
        "  ros__parameters:\n"
        "    update_rate: 100\n"
        "    arm: {type: joint_trajectory_controller/JointTrajectoryController}\n"
    )

    robot = ad.load_robot(models.LIFT, controllers=file)

    (error,) = robot.report.errors
    assert (error.where, error.file, error.line) == ("arm.joints", str(file), 4)
