"""Lines of the report about `<ros2_control>` blocks that are taken as written."""

from pathlib import Path

import pytest

from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import (
    ComponentInfo,
    HardwareInfo,
    InterfaceInfo,
    PidGains,
    TransmissionInfo,
    report_hardware,
)

PLACE = "arm.urdf: ros2_control 'h'"
KEPT = "kept as plain values, not simulated"


def lines_of(plugin: str = "a/B", **fields) -> list[str]:
    block = HardwareInfo(name="h", type="system", plugin=plugin, **fields)
    report = LoadReport()
    report_hardware([block], report, Path("arm.urdf"))
    return [str(entry) for entry in report]


def remarks_of(**fields) -> list[str]:
    """Return the lines after that about the plugin."""
    return lines_of(**fields)[1:]


@pytest.mark.parametrize(
    ("plugin", "called"),
    [
        ("gz_ros2_control/GazeboSimSystem", " (Gazebo Sim)"),
        ("ign_ros2_control/IgnitionSystem", " (Ignition Gazebo)"),
        ("gazebo_ros2_control/GazeboSystem", " (Gazebo Classic)"),
        ("mock_components/GenericSystem", " (mock hardware)"),
        ("fake_components/GenericSystem", " (mock hardware)"),
        ("ur_robot_driver/URPositionHardwareInterface", ""),
    ],
)
def test_the_simulator_says_that_it_stands_in_for_the_plugin(plugin, called):
    done = "the simulator stands in for it"
    line = f"info: {PLACE}: hardware plugin {plugin!r}{called}; {done}"

    # Another simulator's isn't news, unless it has parameters.
    assert lines_of(plugin) == ([] if called else [line])
    assert lines_of(plugin, parameters={"a": "1"}) == [
        f"{line}, without its parameters 'a'"
    ]


@pytest.mark.parametrize(
    ("plugin", "command", "is_told"),
    [
        ("franka_hardware/FrankaHardwareInterface", "effort", True),
        ("franka_hardware/FrankaHardwareInterface", "position", False),
        ("a/B", "effort", False),
    ],
)
def test_hardware_that_holds_the_robots_weight_is_told(plugin, command, is_told):
    joint = ComponentInfo("j", (InterfaceInfo(command),))

    _, *lines = lines_of(plugin, joints=(joint,))

    assert (
        lines
        == [
            f"info: {PLACE}: efforts of 'j', to which its hardware adds the robot's "
            "weight; they act alone: a controller has to hold it"
        ]
        * is_told
    )


def test_parameters_of_the_plugin_are_named():
    assert lines_of(parameters={"ip": "1", "port": "2"}) == [
        f"info: {PLACE}: hardware plugin 'a/B'; "
        "the simulator stands in for it, without its parameters 'ip', 'port'"
    ]


def test_a_block_without_a_plugin_is_a_warning():
    assert lines_of("") == [
        f"warning: {PLACE}: no hardware plugin is named; "
        "expected <hardware><plugin>; the simulator stands in for it"
    ]


def test_interfaces_that_are_not_simulated_share_a_line():
    standard = tuple(map(InterfaceInfo, ("position", "velocity", "effort")))
    joints = (
        ComponentInfo("j", (*standard, InterfaceInfo("stiffness")), standard),
        ComponentInfo("k", (InterfaceInfo("stiffness"),), (InterfaceInfo("kp"),)),
    )

    assert remarks_of(joints=joints) == [
        f"info: {PLACE}: interfaces 'kp', 'stiffness'; {KEPT}"
    ]


def test_standard_interfaces_need_no_line():
    standard = tuple(map(InterfaceInfo, ("position", "velocity", "effort")))

    assert remarks_of(joints=(ComponentInfo("j", standard, standard),)) == []


def test_sensors_gpios_and_transmissions_have_a_line_each():
    lines = remarks_of(
        sensors=(ComponentInfo("imu"), ComponentInfo("fts")),
        gpios=(ComponentInfo("io"),),
        transmissions=(TransmissionInfo("t", "s"),),
    )

    assert lines == [
        f"info: {PLACE}: sensors 'imu', 'fts'; {KEPT}",
        f"info: {PLACE}: gpios 'io'; {KEPT}",
        f"info: {PLACE}: transmissions 't'; joints are driven without them",
    ]


def test_gains_and_unread_joint_parameters_have_a_line_each():
    joints = (
        ComponentInfo("j", position_pid=PidGains(1.0), parameters={"pos_kp": "1"}),
        ComponentInfo("k", velocity_pid=PidGains(1.0)),
        ComponentInfo("l", parameters={"offset": "1", "initial_position": "2"}),
        ComponentInfo("m", parameters={"mimic": "l", "multiplier": "1"}),
    )

    assert remarks_of(joints=joints) == [
        f"info: {PLACE}: PID gains of joints 'j', 'k'; the joint servo has its own",
        f"info: {PLACE}: joint parameters 'offset'; {KEPT}",
    ]


def test_gains_of_gazebo_classic_drive_the_joints_and_need_no_line():
    joints = (ComponentInfo("j", position_pid=PidGains(1.0)),)

    assert lines_of("gazebo_ros2_control/GazeboSystem", joints=joints) == []


def test_timing_of_the_driver_has_one_line():
    lines = remarks_of(rw_rate=5, is_async=True, thread_priority=9, group="g")

    assert lines == [
        f"info: {PLACE}: rw_rate, is_async, thread_priority, group; "
        "the hardware is read and written at every tick of the manager"
    ]
