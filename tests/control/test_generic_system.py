"""`mock_components/GenericSystem`, at what its own tests upstream expect."""

import copy
import math
from pathlib import Path

import numpy as np
import pytest

from arm_drake.control.generic_system import (
    GenericSystem,
    GenericSystemState,
    InfiniteCommandError,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import parse_urdf
from arm_drake.errors import DescriptionError

FILE = Path("arm.urdf")
PERIOD = 0.1

ROBOT = """
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="hand"/>
  <joint name="joint1" type="revolute">
    <parent link="base"/><child link="upper"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/>
  </joint>
  <joint name="joint2" type="revolute">
    <parent link="upper"/><child link="lower"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/>{mimic2}
  </joint>
  <joint name="joint3" type="revolute">
    <parent link="lower"/><child link="hand"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/>{mimic3}
  </joint>
  <ros2_control name="hardware" type="system">
    <hardware>
      <plugin>mock_components/GenericSystem</plugin>{parameters}
    </hardware>{components}
  </ros2_control>
</robot>
"""

# Initial positions and interfaces of both joints, as upstream's tests have them.
TWO_JOINTS = """
    <joint name="joint1">
      <command_interface name="position"/>
      <command_interface name="velocity"/>
      <state_interface name="position"><param name="initial_value">3.45</param>
      </state_interface>
      <state_interface name="velocity"/>
    </joint>
    <joint name="joint2">
      <command_interface name="position"/>
      <command_interface name="velocity"/>
      <state_interface name="position"><param name="initial_value">2.78</param>
      </state_interface>
      <state_interface name="velocity"/>
    </joint>
"""
DYNAMIC_JOINTS = """
    <joint name="joint1">
      <command_interface name="position"/>
      <command_interface name="velocity"/>
      <command_interface name="effort"/>
      <state_interface name="position"><param name="initial_value">3.45</param>
      </state_interface>
      <state_interface name="velocity"/>
      <state_interface name="acceleration"/>
      <state_interface name="effort"/>
    </joint>
    <joint name="joint2">
      <command_interface name="velocity"/>
      <command_interface name="acceleration"/>
      <state_interface name="position"><param name="initial_value">2.78</param>
      </state_interface>
      <state_interface name="velocity"/>
      <state_interface name="acceleration"/>
    </joint>
"""
DYNAMIC_NAMES = [f"joint{i}/{n}" for i in (1, 2) for n in ("position", "velocity")]
DYNAMIC_NAMES[2:2] = ["joint1/acceleration"]
DYNAMIC_NAMES += ["joint2/acceleration"]
FOLLOWER = """
    <joint name="joint1">
      <command_interface name="position"/>
      <command_interface name="velocity"/>
      <state_interface name="position"><param name="initial_value">1.57</param>
      </state_interface>
      <state_interface name="velocity"/>
    </joint>
    <joint name="joint2" mimic="true">
      <state_interface name="position"/>
      <state_interface name="velocity"/>
    </joint>
"""
SENSOR_AND_GPIO = """
    <sensor name="tcp">
      <state_interface name="force.x"/>
      <state_interface name="force.z"><param name="initial_value">7</param>
      </state_interface>
    </sensor>
    <gpio name="vacuum">
      <command_interface name="level"/>
      <state_interface name="level"/>
      <state_interface name="pressure"/>
    </gpio>
"""


def make_system(
    components: str,
    *,
    mimic2: str = "",
    mimic3: str = "",
    humble: bool = False,
    **parameters: object,
) -> GenericSystem:
    """Return the hardware of a robot with these parameters of its `<hardware>`."""
    lines = [f'<param name="{k}">{v}</param>' for k, v in parameters.items()]
    text = ROBOT.format(
        components=components,
        parameters="".join(lines),
        mimic2=mimic2,
        mimic3=mimic3,
    )
    robot = parse_urdf(text, FILE, PackageFinder(FILE), LoadReport())
    return GenericSystem.from_component(robot.hardware[0], robot.joints, humble=humble)


class Rig:
    """A system with what it was commanded last and its state."""

    def __init__(self, components: str, **options: object) -> None:
        self.system = make_system(components, **options)  # type: ignore[arg-type]
        self.commands = np.full(len(self.system.command_interfaces), np.nan)
        self.state = self.system.start()

    def command(self, **values: float) -> None:
        for name, value in values.items():
            full = name.replace("__", "/").replace("_dot_", ".")
            self.commands[self.system.command_interfaces.index(full)] = value

    def read(self, **values: float) -> None:
        self.command(**values)
        self.state = self.system.read(self.state, self.commands, PERIOD)

    def switch(self, *start: str) -> None:
        modes = self.system.modes_after(self.state.modes, start, ())
        self.state = GenericSystemState(self.state.states, modes, self.state.hidden)

    def get(self, *names: str) -> list[float]:
        found = self.system.state_interfaces
        return [float(self.state.states[found.index(name)]) for name in names]


POSITIONS = ("joint1/position", "joint2/position")
VELOCITIES = ("joint1/velocity", "joint2/velocity")


# Mirrored commands


def test_joints_start_at_their_initial_values_without_commands():
    system = make_system(TWO_JOINTS)

    assert system.state_interfaces == (
        "joint1/position",
        "joint1/velocity",
        "joint2/position",
        "joint2/velocity",
    )
    assert system.command_interfaces == system.state_interfaces
    assert system.initial_states().tolist() == [3.45, 0, 2.78, 0]
    assert system.warnings == ()


def test_commands_act_at_the_next_read_only():
    rig = Rig(TWO_JOINTS)

    rig.command(joint1__position=0.11, joint2__position=0.33)

    assert rig.get(*POSITIONS) == [3.45, 2.78]
    rig.read()
    assert rig.get(*POSITIONS) == [0.11, 0.33]


def test_without_commands_nothing_moves():
    rig = Rig(TWO_JOINTS)

    rig.read()

    assert rig.get(*POSITIONS, *VELOCITIES) == [3.45, 2.78, 0, 0]


def test_positions_follow_with_an_offset_from_the_start():
    rig = Rig(TWO_JOINTS, position_state_following_offset=-3)

    assert rig.get(*POSITIONS) == pytest.approx([0.45, -0.22])
    rig.read(joint1__position=0.11, joint2__position=0.33)
    assert rig.get(*POSITIONS) == pytest.approx([-2.89, -2.67])


CUSTOM = """
    <joint name="joint1">
      <command_interface name="position"/>
      <state_interface name="position"><param name="initial_value">3.45</param>
      </state_interface>
      <state_interface name="actual_position"/>
    </joint>
"""


def test_a_custom_interface_takes_the_offset_off_the_position():
    rig = Rig(
        CUSTOM,
        position_state_following_offset=-3,
        custom_interface_with_following_offset="actual_position",
    )
    names = ("joint1/position", "joint1/actual_position")

    assert rig.get(*names) == [3.45, 0]
    rig.read(joint1__position=0.11)
    assert rig.get(*names) == pytest.approx([0.11, -2.89])
    assert rig.system.warnings == ()


def test_a_custom_interface_counts_beside_an_offset_only():
    rig = Rig(CUSTOM, custom_interface_with_following_offset="actual_position")

    rig.read(joint1__position=0.11)

    assert rig.get("joint1/position", "joint1/actual_position") == [0.11, 0]


@pytest.mark.parametrize("name", ["actual", "position"])
def test_a_custom_interface_that_is_not_mirrored_takes_the_offset_away(name):
    rig = Rig(
        CUSTOM,
        position_state_following_offset=-3,
        custom_interface_with_following_offset=name,
    )

    rig.read(joint1__position=0.11)

    assert rig.get("joint1/position", "joint1/actual_position") == [0.11, 0]
    assert rig.system.warnings == (
        f"custom_interface_with_following_offset is {name!r}, which no joint mirrors "
        "as a state interface: the offset is added to nothing",
    )


def test_a_velocity_command_is_not_integrated():
    rig = Rig(TWO_JOINTS)

    rig.read(joint1__velocity=0.5)
    rig.read()

    assert rig.get("joint1/position", "joint1/velocity") == [3.45, 0.5]


@pytest.mark.parametrize("humble", [False, True])
def test_nothing_changes_with_disabled_commands(humble):
    rig = Rig(TWO_JOINTS, disable_commands="True", humble=humble)

    rig.read(joint1__position=0.11, joint2__velocity=math.inf)

    assert rig.get(*POSITIONS, *VELOCITIES) == [3.45, 2.78, 0, 0]
    assert rig.system.warnings == ("disable_commands is true: the states never change",)


def test_an_infinite_command_that_would_be_mirrored_is_an_error():
    rig = Rig(TWO_JOINTS)

    with pytest.raises(InfiniteCommandError) as error:
        rig.read(joint1__position=math.inf, joint2__velocity=-math.inf)

    assert str(error.value) == "joint2/velocity: expected a finite command, got -inf"
    assert isinstance(error.value, ValueError)


def test_an_infinite_position_is_no_command():
    rig = Rig(TWO_JOINTS)

    rig.read(joint1__position=math.inf, joint2__position=0.33)
    rig.read(joint2__position=-math.inf)

    assert rig.get(*POSITIONS) == [3.45, 0.33]


def test_a_joint_s_old_parameter_says_where_it_starts():
    old = """
    <joint name="joint1">
      <command_interface name="position"/>
      <state_interface name="position"/>
      <state_interface name="velocity"><param name="initial_value">0.5</param>
      </state_interface>
      <param name="initial_position">1.57</param>
      <param name="initial_velocity">9</param>
    </joint>"""

    assert make_system(old).initial_states().tolist() == [1.57, 0.5]


# Dynamics


def start_dynamics(**options: object) -> Rig:
    rig = Rig(DYNAMIC_JOINTS, calculate_dynamics="true", **options)
    rig.switch("joint1/position", "joint2/acceleration")
    rig.command(joint1__position=0.11, joint2__acceleration=3.5)
    return rig


# Of five reads; between the third and the fourth both joints are switched to velocity.
DYNAMICS = [
    [0.11, -33.4, -334, 2.815, 0.35, 3.5],
    [0.11, 0, 334, 2.885, 0.7, 3.5],
    [0.11, 0, 0, 2.99, 1.05, 3.5],
    [0.16, 0.5, 5, 3.19, 2, 9.5],
    [0.21, 0.5, 0, 3.39, 2, 0],
]

# Humble moves the position first.
DYNAMICS_OF_HUMBLE = [
    [0.11, -33.4, -334, 2.78, 0, 3.5],
    [0.11, 0, 334, 2.78, 0.35, 3.5],
    [0.11, 0, 0, 2.815, 0.7, 3.5],
    [0.11, 0.5, 5, 2.885, 2, 13],
    [0.16, 0.5, 0, 3.085, 2, 0],
]


@pytest.mark.parametrize(
    ("humble", "expected"), [(False, DYNAMICS), (True, DYNAMICS_OF_HUMBLE)]
)
def test_dynamics_are_calculated_from_each_joint_s_mode(humble, expected):
    rig = start_dynamics(humble=humble)

    found = []
    for number in range(5):
        if number == 3:
            rig.switch("joint1/velocity", "joint2/velocity")
            rig.read(joint1__velocity=0.5, joint2__velocity=2.0)
        else:
            rig.read()
        found.append(rig.get(*DYNAMIC_NAMES))

    assert np.array(found) == pytest.approx(np.array(expected))


def test_joints_are_commanded_by_position_first():
    rig = Rig(DYNAMIC_JOINTS, calculate_dynamics="true")

    rig.read(joint1__position=3.55, joint1__velocity=9.0)

    assert rig.state.modes == ("position", "position")
    assert rig.get("joint1/position", "joint1/velocity") == pytest.approx([3.55, 1.0])


def test_efforts_are_mirrored_with_dynamics_too():
    rig = Rig(DYNAMIC_JOINTS, calculate_dynamics="true")

    rig.read(joint1__effort=5.0)

    assert rig.get("joint1/position", "joint1/effort") == [3.45, 5.0]


def test_offsets_act_where_a_position_is_commanded():
    rig = start_dynamics(position_state_following_offset=-3)

    rig.read()

    # 2.78 - 3 is where joint 2 starts.
    assert rig.get(*POSITIONS) == pytest.approx([0.11 - 3, -0.22 + 0.035])


def test_humble_s_offsets_act_in_every_step_but_not_at_the_start():
    rig = start_dynamics(humble=True, position_state_following_offset=-3)

    assert rig.get(*POSITIONS) == [3.45, 2.78]
    rig.read()
    rig.read()
    assert rig.get(*POSITIONS) == pytest.approx([0.11 - 3, 2.78 - 6])


POSITION_ONLY = """
    <joint name="joint1">
      <command_interface name="velocity"/>
      <command_interface name="acceleration"/>
      <state_interface name="position"/>
    </joint>
"""


def test_a_position_is_integrated_without_a_state_interface_for_velocity():
    rig = Rig(POSITION_ONLY, calculate_dynamics="true")
    rig.switch("joint1/velocity")

    rig.read(joint1__velocity=2.0)
    rig.read()

    assert rig.get("joint1/position") == pytest.approx([0.4])


@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_without_a_velocity_the_offset_moves_a_position_as_upstream(offset):
    rig = Rig(
        POSITION_ONLY,
        calculate_dynamics="true",
        position_state_following_offset=offset,
    )
    rig.switch("joint1/velocity")

    assert rig.get("joint1/position") == [offset]
    rig.read()
    assert rig.get("joint1/position") == [2 * offset]


def test_a_joint_goes_on_at_its_velocity_without_a_command():
    rig = start_dynamics()
    rig.read()
    rig.switch("joint2/velocity")

    rig.read()

    assert rig.get(*DYNAMIC_NAMES[3:]) == pytest.approx([2.815 + 0.035, 0.35, 3.5])


def test_a_joint_without_a_command_does_not_take_another_s_velocity():
    both = POSITION_ONLY + POSITION_ONLY.replace("joint1", "joint2")
    rig = Rig(both, calculate_dynamics="true")
    rig.switch("joint1/velocity", "joint2/velocity")

    rig.read(joint1__velocity=2.0)

    assert rig.get(*POSITIONS) == pytest.approx([0.2, 0.0])


def test_velocities_that_are_no_interface_are_kept_in_humble_only():
    now = Rig(POSITION_ONLY, calculate_dynamics="true")
    old = Rig(POSITION_ONLY, calculate_dynamics="true", humble=True)
    for rig in (now, old):
        rig.switch("joint1/acceleration")
        rig.command(joint1__acceleration=1.0)
        for _ in range(4):
            rig.read()

    # Upstream starts at 0 speed in each read; Humble has 0, 0, 0.1, 0.2 rad/s.
    assert now.get("joint1/position") == pytest.approx([4 * 0.01])
    assert old.get("joint1/position") == pytest.approx([0.03])


def test_an_infinite_command_of_what_is_calculated_is_none():
    rig = start_dynamics()

    rig.read(joint1__position=math.inf, joint2__acceleration=-math.inf)

    assert rig.get(*DYNAMIC_NAMES) == [3.45, 0, 0, 2.78, 0, 0]


# Switching


KNOWN = (
    "known: joint1/effort, joint1/position, joint1/velocity, joint2/acceleration, "
    "joint2/velocity"
)
ONE_OF = (
    "calculate_dynamics needs exactly one of position, velocity, acceleration to be "
    "claimed, got"
)


@pytest.mark.parametrize(
    ("start", "fault"),
    [
        (["joint1/position", "joint2/acceleration"], ""),
        (["joint1/position", "joint1/effort"], ""),
        ([], ""),
        (["elbow/x"], f"no command interface 'elbow/x'; {KNOWN}"),
        (["joint1/effort"], f"joint 'joint1': {ONE_OF} ['joint1/effort']"),
        (
            ["joint2/velocity", "joint1/velocity", "joint1/position"],
            f"joint 'joint1': {ONE_OF} ['joint1/position', 'joint1/velocity']",
        ),
    ],
)
def test_dynamics_need_one_mode_for_each_joint_that_is_claimed(start, fault):
    system = make_system(DYNAMIC_JOINTS, calculate_dynamics="true")

    assert system.prepare_switch(start, []) == fault


def test_an_unknown_interface_of_a_joint_is_refused():
    system = make_system(DYNAMIC_JOINTS, calculate_dynamics="true")

    fault = system.prepare_switch(["joint1/positoin"], ["joint2/velocity"])

    assert fault.startswith(
        "no command interface 'joint1/positoin'; did you mean 'joint1/position'? "
    )


def test_without_dynamics_any_claims_go():
    system = make_system(DYNAMIC_JOINTS)

    fault = system.prepare_switch(["joint1/effort", "joint1/position", "x"], [])

    assert fault == ""


def test_a_switch_changes_the_modes_of_the_claimed_joints_only():
    system = make_system(DYNAMIC_JOINTS, calculate_dynamics="true")
    modes = ("velocity", "acceleration")

    after = system.modes_after(
        modes, ["joint1/position", "joint1/effort"], ["joint2/acceleration"]
    )

    assert after == ("position", "acceleration")


# Mimic joints


MIMIC = '<mimic joint="joint1" multiplier="-2"/>'


def test_a_mimic_joint_follows_from_the_first_read_on():
    rig = Rig(FOLLOWER, mimic2=MIMIC)

    assert rig.get(*POSITIONS) == [1.57, 0.0]
    assert rig.system.command_interfaces == ("joint1/position", "joint1/velocity")
    assert rig.system.warnings == ()
    rig.read(joint1__position=0.11, joint1__velocity=0.05)
    assert rig.get(*POSITIONS) == pytest.approx([0.11, -0.22])
    assert rig.get(*VELOCITIES) == pytest.approx([0.05, -0.1])


def test_an_offset_is_added_to_the_position_only():
    mimic = '<mimic joint="joint1" multiplier="-2" offset="0.5"/>'
    rig = Rig(FOLLOWER, mimic2=mimic)

    rig.read(joint1__position=0.11, joint1__velocity=0.05)

    assert rig.get("joint2/position", "joint2/velocity") == pytest.approx([0.28, -0.1])


def test_a_mimic_joint_follows_the_last_of_a_chain():
    third = """
    <joint name="joint3"><state_interface name="position"/></joint>"""
    rig = Rig(
        third + FOLLOWER,
        mimic2=MIMIC,
        mimic3='<mimic joint="joint2" multiplier="3" offset="1"/>',
    )

    rig.read(joint1__position=0.1)

    assert rig.get("joint3/position") == pytest.approx([1 - 0.6])


def test_the_form_up_to_humble_overrides_commands():
    old = TWO_JOINTS.replace(
        '<joint name="joint2">',
        '<joint name="joint2"><param name="mimic">joint1</param>'
        '<param name="multiplier">2</param>',
    )
    rig = Rig(old, humble=True)

    rig.read(joint1__position=0.11, joint2__position=5.0)

    assert rig.get(*POSITIONS) == pytest.approx([0.11, 0.22])


@pytest.mark.parametrize(("humble", "effort"), [(False, 0.0), (True, -6.0)])
def test_efforts_of_mimic_joints_follow_in_humble_only(humble, effort):
    components = """
    <joint name="joint1">
      <command_interface name="effort"/><state_interface name="effort"/>
    </joint>
    <joint name="joint2"><state_interface name="effort"/></joint>"""
    rig = Rig(components, mimic2=MIMIC, humble=humble)

    rig.read(joint1__effort=3.0)

    assert rig.get("joint2/effort") == [effort]


def test_a_mimic_joint_follows_calculated_dynamics():
    rig = Rig(FOLLOWER, mimic2=MIMIC, calculate_dynamics="true")
    rig.switch("joint1/velocity")

    rig.read(joint1__velocity=1.0)
    rig.read()

    assert rig.get(*POSITIONS) == pytest.approx([1.77, -3.54])
    assert rig.get(*VELOCITIES) == pytest.approx([1.0, -2.0])


def test_a_mimic_joint_whose_master_the_block_lacks_stays():
    alone = '<joint name="joint2"><state_interface name="position"/></joint>'
    rig = Rig(alone, mimic2=MIMIC)

    rig.read()

    assert rig.get("joint2/position") == [0.0]
    assert rig.system.warnings == (
        "joint 'joint2' mimics 'joint1', which the block lacks: it stays where it is",
    )


def test_a_joint_that_the_robot_lacks_is_mirrored():
    plain = """
    <joint name="extra">
      <command_interface name="position"/><state_interface name="position"/>
    </joint>"""
    rig = Rig(plain)

    rig.read(extra__position=0.3)

    assert rig.get("extra/position") == [0.3]


# Sensors and GPIOs


def test_sensors_and_gpios_without_initial_values_are_unknown():
    system = make_system(SENSOR_AND_GPIO)

    names = ("tcp/force.x", "tcp/force.z", "vacuum/level", "vacuum/pressure")
    assert system.state_interfaces == names
    assert system.command_interfaces == ("vacuum/level",)
    np.testing.assert_array_equal(
        system.initial_states(), [math.nan, 7, math.nan, math.nan]
    )


def test_a_gpio_s_commands_are_mirrored():
    rig = Rig(SENSOR_AND_GPIO)

    rig.read(vacuum__level=0.7)

    assert rig.get("vacuum/level") == [0.7]


@pytest.mark.parametrize("name", ["mock_sensor_commands", "fake_sensor_commands"])
def test_mocked_sensors_have_commands_that_they_follow(name):
    rig = Rig(SENSOR_AND_GPIO, **{name: "true"})

    rig.read(tcp__force_dot_x=1.5)

    assert rig.system.command_interfaces == (
        "tcp/force.x",
        "tcp/force.z",
        "vacuum/level",
    )
    assert rig.get("tcp/force.x", "tcp/force.z") == [1.5, 7]


@pytest.mark.parametrize("name", ["mock_gpio_commands", "fake_gpio_commands"])
def test_mocked_gpios_have_commands_that_they_follow(name):
    rig = Rig(SENSOR_AND_GPIO, **{name: "true"})

    rig.read(vacuum__level=0.7, vacuum__pressure=2.0)

    assert rig.system.command_interfaces == ("vacuum/level", "vacuum/pressure")
    assert rig.get("vacuum/level", "vacuum/pressure") == [0.7, 2.0]


def test_the_newer_name_of_a_parameter_counts():
    system = make_system(
        SENSOR_AND_GPIO, mock_gpio_commands="false", fake_gpio_commands="true"
    )

    assert system.command_interfaces == ("vacuum/level",)


def test_an_infinite_command_of_a_gpio_is_an_error():
    rig = Rig(SENSOR_AND_GPIO)

    with pytest.raises(InfiniteCommandError, match="vacuum/level: expected a finite"):
        rig.read(vacuum__level=math.inf)


def test_bools_are_mirrored_as_bools_and_other_types_not_at_all():
    typed = """
    <gpio name="io">
      <command_interface name="on" data_type="bool"/>
      <command_interface name="count" data_type="int32"/>
      <state_interface name="on" data_type="bool">
        <param name="initial_value">true</param></state_interface>
      <state_interface name="off" data_type="bool"/>
      <state_interface name="count" data_type="int32"/>
    </gpio>"""
    rig = Rig(typed)
    names = ("io/on", "io/off", "io/count")

    np.testing.assert_array_equal(rig.get(*names), [1, 0, math.nan])
    rig.read()
    np.testing.assert_array_equal(rig.get(*names), [1, 0, math.nan])
    rig.read(io__on=0.3, io__count=4)
    np.testing.assert_array_equal(rig.get(*names), [1, 0, math.nan])
    rig.read(io__on=0.0)
    assert rig.get("io/on") == [0]


def test_custom_interfaces_of_joints_start_unknown_in_humble_only():
    custom = """
    <joint name="joint1"><state_interface name="temperature"/></joint>"""

    assert make_system(custom).initial_states().tolist() == [0.0]
    assert np.isnan(make_system(custom, humble=True).initial_states()).all()


# Values


def test_a_state_can_start_anywhere_and_never_changes():
    system = make_system(TWO_JOINTS)
    states = np.array([1.0, 2.0, 3.0, 4.0])

    first = system.start(states)
    states[0] = 9.0
    second = system.read(first, np.array([0.5, math.nan, math.nan, math.nan]), PERIOD)

    assert first.states.tolist() == [1, 2, 3, 4]
    assert second.states.tolist() == [0.5, 2, 3, 4]
    for array in (system.initial_states(), first.states, second.states):
        assert not array.flags.writeable
    assert copy.deepcopy(second) is second


PLACE = "ros2_control 'hardware', <hardware> parameter"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("calculate_dynamics", "yes", "expected true or false, got 'yes'"),
        ("fake_sensor_commands", "1", "expected true or false, got '1'"),
        ("position_state_following_offset", "x", "expected a finite number, got 'x'"),
        (
            "position_state_following_offset",
            "inf",
            "expected a finite number, got 'inf'",
        ),
    ],
)
def test_a_parameter_without_a_valid_value_is_an_error(name, text, message):
    with pytest.raises(DescriptionError) as error:
        make_system(TWO_JOINTS, **{name: text})

    assert str(error.value) == f"{PLACE} {name!r}: {message}"
