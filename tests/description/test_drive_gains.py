"""Gains of Gazebo's drives, from descriptions and YAML files."""

import math
from pathlib import Path

import pytest

from arm_drake.description.controllers import load_controllers
from arm_drake.description.drive_gains import (
    DriveGains,
    find_drive_gains,
    gazebo_nodes,
    holds_joints,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.ros2_control import PidGains
from arm_drake.description.urdf import parse_urdf
from tests.robots import real_robot

CLASSIC = "gazebo_ros2_control/GazeboSystem"
SIM = "gz_ros2_control/GazeboSimSystem"
IGNITION = "ign_ros2_control/IgnitionSystem"
MOCK = "mock_components/GenericSystem"

CLASSIC_PLUGIN = ("libgazebo_ros2_control.so", "gazebo_ros2_control")
SIM_PLUGIN = ("gz_ros2_control-system", "gz_ros2_control::GazeboSimROS2ControlPlugin")

OWN = "the joint servo has its own gains"
NO_EFFECT = "it has no effect"

# Upstream's own example, gazebo_ros2_control_demos.
CART = Path("gazebo_ros2_control_demos/gazebo_ros2_control_demos")


@pytest.fixture
def load(tmp_path):
    """Return a function that loads a robot: joints j, a.k, and m that follows j."""

    def load_robot(
        joints: str = "",
        yaml: str = "",
        *,
        plugin: str = CLASSIC,
        tag: tuple[str, str] | None = None,
        fields: str = "",
        plugins: tuple[str, ...] = (),
    ) -> Robot:
        file = tmp_path / "arm.urdf"
        block = (
            '<ros2_control name="h" type="system"><hardware>'
            f"<plugin>{plugin}</plugin></hardware>{joints}</ros2_control>"
        )
        if tag is not None:
            library, name = tag
            block += f'<gazebo><plugin filename="{library}" name="{name}">{fields}'
            block += "</plugin></gazebo>"
        text = '<joint name="{0}" type="revolute"><parent link="b"/><child link="{0}"/>'
        text += '<limit lower="-1" upper="1" effort="1" velocity="1"/>{1}</joint>'
        mimics = {"j": "", "a.k": "", "m": '<mimic joint="j"/>'}
        urdf = "".join(f'<link name="{name}"/>' for name in ("b", *mimics))
        urdf += "".join(text.format(*item) for item in mimics.items())
        report = LoadReport()
        packages = PackageFinder(file)
        description = parse_urdf(
            f'<robot name="r">{urdf}{block}</robot>', file, packages, report
        )
        files = []
        if yaml:
            files.append(tmp_path / "c.yaml")
            files[0].write_text(yaml, encoding="utf-8")
        config = load_controllers(files, {}, report, plugins=plugins)
        return Robot("r", description, config, report, initial_positions={})

    return load_robot


@pytest.fixture
def find(load, tmp_path):
    """Return a function: robot as of `load` -> gains, and lines of the report."""

    def find_gains(*args, **kwargs) -> tuple[dict[str, DriveGains], list[str]]:
        report = LoadReport()
        found = find_drive_gains(load(*args, **kwargs), report)
        return found, [str(e).replace(f"{tmp_path}/", "") for e in report]

    return find_gains


@pytest.fixture
def hold(load, tmp_path):
    """Return a function: robot as of `load` -> whether it holds, and lines."""

    def find_holds(*args, **kwargs) -> tuple[bool, list[str]]:
        report = LoadReport()
        holds = holds_joints(load(*args, **kwargs), report)
        return holds, [str(e).replace(f"{tmp_path}/", "") for e in report]

    return find_holds


def joint(name: str, *commands: str, **parameters: object) -> str:
    inside = "".join(
        f'<param name="{key}">{value}</param>' for key, value in parameters.items()
    )
    inside += "".join(f'<command_interface name="{command}"/>' for command in commands)
    return f'<joint name="{name}">{inside}</joint>'


def node(text: str, name: str = "gazebo_ros2_control") -> str:
    return f"{name}:\n  ros__parameters: {{{text}}}\n"


def gains_of(kind: str, text: str, name: str = "j") -> str:
    return node(f"pid_gains: {{{kind}: {{{name}: {{{text}}}}}}}")


J = joint("j", "position", "velocity")
PID = "kp: 1.0, ki: 2.0, kd: 3.0"


# Gazebo Classic


@pytest.mark.parametrize(
    ("commands", "prefix", "expected"),
    [
        (["position"], "pos_", DriveGains(position_pid=PidGains(1.0, 2.0, 3.0, 4.0))),
        (["position_pid"], "pos_", DriveGains(PidGains(1.0, 2.0, 3.0, 4.0))),
        (["velocity"], "vel_", DriveGains(None, PidGains(1.0, 2.0, 3.0, 4.0))),
        (["velocity_pid"], "vel_", DriveGains(None, PidGains(1.0, 2.0, 3.0, 4.0))),
    ],
)
def test_gains_in_the_tags_of_a_joint_drive_it(find, commands, prefix, expected):
    values = {"kp": 1, "ki": 2, "kd": 3, "max_integral_error": 4}
    gains = {prefix + name: value for name, value in values.items()}

    found, lines = find(joint("j", *commands, **gains) + joint("a.k", "position"))

    assert found == {"j": expected}
    assert lines == []


def test_a_joint_may_have_gains_for_positions_and_velocities(find):
    found, _ = find(joint("j", "position", "velocity", pos_kp=1, vel_ki=2))

    assert found == {"j": DriveGains(PidGains(kp=1.0), PidGains(ki=2.0))}


@pytest.mark.parametrize("plugin", [SIM, IGNITION, MOCK, "a/B"])
def test_gains_of_other_blocks_drive_nothing(find, plugin):
    found, lines = find(joint("j", "position", pos_kp=1), plugin=plugin)

    assert (found, lines) == ({}, [])


@pytest.mark.parametrize(
    ("parameters", "what"),
    [
        ({"pos_kp": -1}, "pos_kp: expected a finite number from 0 on, got -1.0"),
        ({"pos_ki": -1}, "pos_ki: expected a finite number from 0 on, got -1.0"),
        ({"pos_kd": "inf"}, "pos_kd: expected a finite number from 0 on, got inf"),
        (
            {"pos_max_integral_error": -2},
            "expected pos_min_integral_error <= 0 <= pos_max_integral_error, "
            "got -inf and -2.0",
        ),
        (
            {"pos_max_integral_error": 5, "pos_min_integral_error": 6},
            "expected pos_min_integral_error <= 0 <= pos_max_integral_error, "
            "got 6.0 and 5.0",
        ),
    ],
)
def test_bad_gains_in_tags_are_not_used(find, parameters, what):
    found, lines = find(joint("j", "position", **{"pos_kp": 1, **parameters}))

    assert found == {}
    assert lines == [
        f"warning: arm.urdf: ros2_control 'h', joint 'j': {what}; {OWN}",
    ]


@pytest.mark.parametrize("text", ["nan", "big", ""])
def test_gains_in_tags_that_are_no_numbers_are_not_used(load, text):
    robot = load(joint("j", "position", pos_kp=text, pos_kd=1))
    report = LoadReport(robot.report)
    loaded = len(report)

    found = find_drive_gains(robot, report)

    assert found == {}
    # Once, when they are read.
    assert len(report) == loaded
    assert any(f"got {text!r}; {OWN}" in str(entry) for entry in report)


def test_a_limit_of_the_integral_may_be_infinite_or_0(find):
    found, lines = find(
        joint(
            "j",
            "position",
            pos_ki=1,
            pos_max_integral_error="inf",
            pos_min_integral_error=0,
        )
    )

    assert found["j"].position_pid == PidGains(
        ki=1.0, max_integral_error=math.inf, min_integral_error=0.0
    )
    assert lines == []


def test_gains_in_tags_of_a_joint_that_does_not_exist_are_left_out(find):
    # That there is no such joint is said when the block is read.
    assert find(J + joint("x", "position", pos_kp=1)) == ({}, [])


def test_gains_in_tags_need_their_command_interface(find):
    found, lines = find(joint("j", "velocity", "effort", pos_kp=1))

    assert found == {}
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'j': pos_*: "
        f"no command interface 'position'; it has ['velocity', 'effort']; {OWN}"
    ]


def test_a_joint_that_follows_another_has_no_gains(find):
    tags = joint("m", pos_kp=1)

    found, lines = find(J + tags, gains_of("velocity", PID, "m"))

    assert found == {}
    assert lines == [
        "warning: arm.urdf: ros2_control 'h', joint 'm': pos_*: "
        f"joint 'm' follows 'j'; {OWN}",
        "warning: c.yaml:2: gazebo_ros2_control.pid_gains.velocity.m: "
        f"joint 'm' follows 'j'; {NO_EFFECT}",
    ]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("position", DriveGains(PidGains(1.0, 2.0, 3.0))),
        ("position_pid", DriveGains(PidGains(1.0, 2.0, 3.0))),
        ("velocity", DriveGains(None, PidGains(1.0, 2.0, 3.0))),
        ("velocity_pid", DriveGains(None, PidGains(1.0, 2.0, 3.0))),
    ],
)
def test_gains_in_the_yaml_drive_a_joint(find, kind, expected):
    found, lines = find(J, gains_of(kind, PID))

    assert (found, lines) == ({"j": expected}, [])


def test_the_yaml_may_limit_the_integral(find):
    limits = "max_integral_error: 5.0, min_integral_error: -6.0"

    found, _ = find(J, gains_of("position", f"{PID}, {limits}"))

    assert found["j"].position_pid == PidGains(1.0, 2.0, 3.0, 5.0, -6.0)


def test_gains_of_the_cart_of_upstream_are_those_of_its_yaml():
    path = real_robot(
        str(CART / "urdf" / "test_vertical_cart_position_pids_in_yaml.xacro.urdf")
    )
    file = path.parents[1] / "config" / "cart_controller_position_with_pids.yaml"
    report = LoadReport()
    text = path.read_text(encoding="utf-8")
    description = parse_urdf(text, path, PackageFinder(path), report)
    config = load_controllers([file], {}, report)
    found = LoadReport()

    gains = find_drive_gains(Robot("cart", description, config, report, {}), found)

    assert gains == {
        "slider_to_cart": DriveGains(PidGains(100.0, 1.0, 10.0, 10000.0)),
    }
    assert list(found) == []
    assert not [entry for entry in report if entry.file == str(file)]


def test_gains_in_the_tags_of_a_joint_win(find):
    tags = joint("j", "position", "velocity", pos_kp=9)
    kinds = f"position: {{j: {{{PID}}}}}, velocity: {{j: {{{PID}}}}}"

    found, lines = find(tags, node(f"pid_gains: {{{kinds}}}"))

    assert found == {"j": DriveGains(PidGains(kp=9.0), PidGains(1.0, 2.0, 3.0))}
    assert lines == [
        "warning: c.yaml:2: gazebo_ros2_control.pid_gains.position.j: "
        "its <param> tags give these gains too; those count"
    ]


def test_bad_gains_in_tags_are_not_replaced_by_those_of_the_yaml(find):
    found, lines = find(joint("j", "position", pos_kp=-1), gains_of("position", PID))

    assert found == {}
    assert len(lines) == 2


def test_of_two_names_for_the_same_gains_the_first_counts(find):
    kinds = f"position_pid: {{j: {{{PID}}}}}, position: {{j: {{{PID}, kp: 9.0}}}}"

    found, lines = find(J, node(f"pid_gains: {{{kinds}}}"))

    assert found == {"j": DriveGains(PidGains(1.0, 2.0, 3.0))}
    assert lines == [
        "warning: c.yaml:2: gazebo_ros2_control.pid_gains.position.j: "
        "gazebo_ros2_control.pid_gains.position_pid.j give these gains too; those count"
    ]


NONE = "gazebo_ros2_control.pid_gains.position.j"
SHAPE = (
    "expected pid_gains.<position|position_pid|velocity|velocity_pid>.<joint>."
    "<kp|ki|kd|max_integral_error|min_integral_error>"
)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("kp: 1.0, kd: 3.0", f"{NONE}: expected kp, ki, kd, got kp, kd; {OWN}"),
        (
            "max_integral_error: 1.0",
            f"{NONE}: expected kp, ki, kd, got max_integral_error; {OWN}",
        ),
        ("antiwindup: false", f"{NONE}: expected kp, ki, kd, got none; {OWN}"),
        (
            f"{PID}, kp: -1.0",
            f"{NONE}: kp: expected a finite number from 0 on, got -1.0; {OWN}",
        ),
        (
            f"{PID}, ki: .nan",
            f"{NONE}: ki: expected a finite number from 0 on, got nan; {OWN}",
        ),
        (
            f"{PID}, kd: .inf",
            f"{NONE}: kd: expected a finite number from 0 on, got inf; {OWN}",
        ),
        (f"{PID}, kp: big", f"{NONE}.kp: expected float, got 'big'; {OWN}"),
        (f"{PID}, kp: true", f"{NONE}.kp: expected float, got True; {OWN}"),
        (f"{PID}, kp: [1.0]", f"{NONE}.kp: expected float, got [1.0]; {OWN}"),
        (
            f"{PID}, max_integral_error: wide",
            f"{NONE}.max_integral_error: expected float, got 'wide'; {OWN}",
        ),
        (
            f"{PID}, max_integral_error: 1.0, min_integral_error: 2.0",
            f"{NONE}: expected min_integral_error <= 0 <= max_integral_error, "
            f"got 2.0 and 1.0; {OWN}",
        ),
        (
            f"{PID}, max_integral_error: .nan",
            f"{NONE}: expected min_integral_error <= 0 <= max_integral_error, "
            f"got -inf and nan; {OWN}",
        ),
    ],
)
def test_bad_gains_in_the_yaml_are_not_used(find, text, line):
    found, lines = find(J, gains_of("position", text))

    assert found == {}
    assert lines == [f"warning: c.yaml:2: {line}"]


def test_a_whole_number_is_a_gain(find):
    found, lines = find(J, gains_of("position", f"{PID}, kp: 100"))

    assert found["j"].position_pid == PidGains(100.0, 2.0, 3.0)
    assert lines == [
        f"info: c.yaml:2: {NONE}.kp: "
        "100 is an integer; ros2_control refuses it for a double; taken as 100.0"
    ]


def test_unknown_names_beside_gains_are_reported(find):
    found, lines = find(J, gains_of("position", f"{PID}, kpp: 1.0"))

    assert found["j"].position_pid == PidGains(1.0, 2.0, 3.0)
    known = "antiwindup, kd, ki, kp, max_integral_error, min_integral_error"
    assert lines == [
        f"warning: c.yaml:2: {NONE}.kpp: "
        f"unknown parameter; did you mean 'kp'? known: {known}; {NO_EFFECT}"
    ]


@pytest.mark.parametrize(
    ("value", "reported"),
    [
        ("false", []),
        (
            "true",
            [
                f"warning: c.yaml:2: {NONE}.antiwindup: it limits the integral itself, "
                f"here its term is limited; {NO_EFFECT}"
            ],
        ),
        (
            "1.0",
            [
                f"warning: c.yaml:2: {NONE}.antiwindup: "
                "expected bool, got 1.0; taken as not given"
            ],
        ),
    ],
)
def test_antiwindup_is_not_simulated(find, value, reported):
    found, lines = find(J, gains_of("position", f"{PID}, antiwindup: {value}"))

    assert found["j"].position_pid == PidGains(1.0, 2.0, 3.0)
    assert lines == reported


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("jj", "Gazebo Classic drives no joint 'jj'; did you mean 'j'? known: j, m"),
        # A joint of the robot, of no block.
        ("a.k", "Gazebo Classic drives no joint 'a.k'; known: j, m"),
    ],
)
def test_gains_of_joints_that_do_not_exist_are_reported(find, name, what):
    joints = joint("j", "position") + joint("m")

    found, lines = find(joints, gains_of("position", PID, name))

    assert found == {}
    assert lines == [
        f"warning: c.yaml:2: gazebo_ros2_control.pid_gains.position.{name}: "
        f"{what}; {NO_EFFECT}"
    ]


def test_gains_in_the_yaml_need_their_command_interface(find):
    found, lines = find(joint("j", "effort"), gains_of("velocity_pid", PID))

    assert found == {}
    assert lines == [
        "warning: c.yaml:2: gazebo_ros2_control.pid_gains.velocity_pid.j: "
        f"no command interface 'velocity'; it has ['effort']; {NO_EFFECT}"
    ]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("pid_gains: 5.0", "pid_gains"),
        ("pid_gains: {position: 5.0}", "pid_gains.position"),
        ("pid_gains: {position: {j: 5.0}}", "pid_gains.position.j"),
        ("pid_gains: {j: {p: 5.0}}", "pid_gains.j.p"),
        ("pid_gains: {effort: {j: {kp: 5.0}}}", "pid_gains.effort.j.kp"),
    ],
)
def test_gains_at_other_places_are_reported(find, text, key):
    found, lines = find(J, node(text))

    assert found == {}
    assert lines == [
        f"warning: c.yaml:2: gazebo_ros2_control.{key}: {SHAPE}; {NO_EFFECT}"
    ]


def test_a_joints_name_may_have_dots(find):
    joints = J + joint("a.k", "position")

    found, lines = find(joints, gains_of("position", PID, "a.k"))

    assert found == {"a.k": DriveGains(PidGains(1.0, 2.0, 3.0))}
    assert lines == []


def test_the_node_of_gazebo_classic_is_called_as_its_plugin(find):
    options = {"tag": ("libgazebo_ros2_control.so", "mine"), "plugins": ("mine",)}
    yaml = node(f"pid_gains: {{position: {{j: {{{PID}}}}}}}", "mine")

    found, lines = find(J, yaml, **options)
    other, reported = find(J, gains_of("position", PID), **options)

    assert (found, lines) == ({"j": DriveGains(PidGains(1.0, 2.0, 3.0))}, [])
    assert other == {}
    assert reported == [
        "warning: c.yaml:2: gazebo_ros2_control.pid_gains: "
        f"no plugin has a node of this name; known: mine; {NO_EFFECT}"
    ]


def test_nodes_are_those_of_the_blocks_simulators(load):
    tag = ("libgazebo_ros2_control.so", "mine")

    classic, sim, ignition, mock, usual = (
        gazebo_nodes(robot.description)
        for robot in (
            load(J, tag=tag),
            load(J, plugin=SIM, tag=tag),
            load(J, plugin=IGNITION, tag=SIM_PLUGIN),
            load(J, plugin=MOCK, tag=SIM_PLUGIN),
            load(J),
        )
    )

    assert classic == {"mine": "Gazebo Classic"}
    assert sim == ignition == {"gz_ros_control": "Gazebo Sim"}
    assert mock == {}
    assert usual == {"gazebo_ros2_control": "Gazebo Classic"}


# Gazebo Sim


def gain(value: object) -> str:
    return f"<position_proportional_gain>{value}</position_proportional_gain>"


def sim_node(text: str) -> str:
    return node(text, "gz_ros_control")


RATE = "controller_manager: {ros__parameters: {update_rate: 200}}\n"


@pytest.mark.parametrize("plugin", [SIM, IGNITION])
@pytest.mark.parametrize(
    ("fields", "yaml", "rate"),
    [
        # At 200 Hz.
        (gain(0.5), "", 100.0),
        # The default too, if someone asks for it.
        (gain(0.1), "", 20.0),
        ("", sim_node("position_proportional_gain: 0.25"), 50.0),
        # The YAML wins.
        (gain(0.5), sim_node("position_proportional_gain: 0.25"), 50.0),
        (gain(0.5), "/**: {ros__parameters: {position_proportional_gain: 1.5}}\n", 300),
        ("", sim_node("hold_joints: true"), None),
        ("", "", None),
    ],
)
def test_positions_follow_at_a_rate_if_one_is_given(find, plugin, fields, yaml, rate):
    joints = J + joint("a.k", "velocity") + joint("m")

    found, lines = find(
        joints, RATE + yaml, plugin=plugin, tag=SIM_PLUGIN, fields=fields
    )

    # The others have no position to follow, or follow a joint.
    assert found == ({} if rate is None else {"j": DriveGains(position_rate=rate)})
    assert lines == []


@pytest.mark.parametrize("bad", ["0", "-0.5", "inf"])
def test_a_bad_gain_in_the_tag_counts_as_not_given(find, bad):
    found, lines = find(J, plugin=SIM, tag=SIM_PLUGIN, fields=gain(bad))

    assert found == {}
    assert lines == [
        "warning: arm.urdf: Gazebo plugin 'gz_ros2_control::GazeboSimROS2ControlPlugin'"
        ": position_proportional_gain: expected a finite number above 0, "
        f"got {float(bad)}; taken as not given"
    ]


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        ("0.0", "expected a finite number above 0, got 0.0"),
        ("-1.0", "expected a finite number above 0, got -1.0"),
        (".nan", "expected a finite number above 0, got nan"),
        (".inf", "expected a finite number above 0, got inf"),
        ("high", "expected float, got 'high'"),
        ("true", "expected float, got True"),
    ],
)
def test_a_bad_gain_in_the_yaml_counts_as_not_given(find, bad, what):
    yaml = RATE + sim_node(f"position_proportional_gain: {bad}")

    found, lines = find(J, yaml, plugin=SIM, tag=SIM_PLUGIN, fields=gain(0.5))

    # So the tag's holds.
    assert found == {"j": DriveGains(position_rate=100.0)}
    assert lines == [
        "warning: c.yaml:3: gz_ros_control.position_proportional_gain: "
        f"{what}; taken as not given"
    ]


@pytest.mark.parametrize("text", ["nan", "high", ""])
def test_a_tag_that_is_no_number_is_reported_once(load, text):
    robot = load(J, plugin=SIM, tag=SIM_PLUGIN, fields=gain(text))
    report = LoadReport(robot.report)
    loaded = len(report)

    found = find_drive_gains(robot, report)

    assert found == {}
    assert len(report) == loaded
    assert "position_proportional_gain: expected a number" in str(report)


# Both


HELD = "<hold_joints>{}</hold_joints>"


@pytest.mark.parametrize(
    ("plugin", "tag", "name"),
    [
        (SIM, SIM_PLUGIN, "gz_ros_control"),
        (IGNITION, SIM_PLUGIN, "gz_ros_control"),
        (CLASSIC, CLASSIC_PLUGIN, "gazebo_ros2_control"),
    ],
)
@pytest.mark.parametrize(
    ("fields", "yaml", "holds"),
    [
        ("", "", True),
        (HELD.format("true"), "", True),
        (HELD.format("false"), "", False),
        (HELD.format("False"), "", False),
        (HELD.format("0"), "", False),
        ("", "hold_joints: false", False),
        ("", "hold_joints: true", True),
        # The YAML wins.
        (HELD.format("true"), "hold_joints: false", False),
        (HELD.format("false"), "hold_joints: true", True),
        # What is no bool is reported when the tag is read.
        (HELD.format("maybe"), "", True),
    ],
)
def test_joints_are_held_unless_the_tag_or_the_yaml_says_no(
    hold, plugin, tag, name, fields, yaml, holds
):
    text = node(yaml, name) if yaml else ""

    assert hold(J, text, plugin=plugin, tag=tag, fields=fields) == (holds, [])


@pytest.mark.parametrize("bad", ["1", "maybe", "0.0", "[false]"])
def test_what_is_no_bool_in_the_yaml_counts_as_not_given(hold, bad):
    yaml = sim_node(f"hold_joints: {bad}")
    fields = HELD.format("false")

    holds, lines = hold(J, yaml, plugin=SIM, tag=SIM_PLUGIN, fields=fields)

    assert holds is False
    (line,) = lines
    assert line.startswith("warning: c.yaml:2: gz_ros_control.hold_joints: expected")
    assert line.endswith("; taken as not given")


@pytest.mark.parametrize("plugin", [MOCK, "a/B", ""])
def test_joints_of_other_hardware_are_held(hold, plugin):
    yaml = sim_node("hold_joints: false")
    fields = HELD.format("false")

    assert hold(J, yaml, plugin=plugin, tag=SIM_PLUGIN, fields=fields) == (True, [])


@pytest.mark.parametrize(
    ("plugin", "tag"),
    [
        (CLASSIC, SIM_PLUGIN),
        (SIM, CLASSIC_PLUGIN),
        (SIM, ("gz-sim-imu-system", "gz::sim::systems::Imu")),
    ],
)
def test_tags_of_other_plugins_let_no_joint_go(hold, plugin, tag):
    fields = HELD.format("false")

    assert hold(J, plugin=plugin, tag=tag, fields=fields) == (True, [])


def test_parameters_of_another_simulator_are_reported(find):
    both = f"pid_gains: {{position: {{j: {{{PID}}}}}}}, position_proportional_gain: 1.0"

    sim, of_sim = find(J, sim_node(both), plugin=SIM)
    classic, of_classic = find(J, node(both), plugin=CLASSIC)

    assert sim == {"j": DriveGains(position_rate=100.0)}
    assert of_sim == [
        "warning: c.yaml:2: gz_ros_control.pid_gains: "
        f"Gazebo Sim has no such parameter; {NO_EFFECT}"
    ]
    assert classic == {"j": DriveGains(PidGains(1.0, 2.0, 3.0))}
    assert of_classic == [
        "warning: c.yaml:2: gazebo_ros2_control.position_proportional_gain: "
        f"Gazebo Classic has no such parameter; {NO_EFFECT}"
    ]


def test_parameters_of_a_node_that_does_not_run_are_reported(find):
    yaml = sim_node("hold_joints: false, position_proportional_gain: 1.0")

    _, of_classic = find(J, yaml)
    _, of_mock = find(J, yaml, plugin=MOCK)

    names = ("hold_joints", "position_proportional_gain")
    assert of_classic == [
        f"warning: c.yaml:2: gz_ros_control.{name}: no plugin has a node of this name; "
        f"did you mean 'gazebo_ros2_control'? known: gazebo_ros2_control; {NO_EFFECT}"
        for name in names
    ]
    assert of_mock == [
        f"info: c.yaml:2: gz_ros_control.{name}: "
        f"no <ros2_control> block is for Gazebo; {NO_EFFECT}"
        for name in names
    ]


def test_parameters_of_all_nodes_need_not_be_for_these(find):
    yaml = "/**: {ros__parameters: {pid_gains: {position: {j: {kp: 1.0}}}}}\n"

    assert find(J, yaml, plugin=SIM) == ({}, [])
    assert find(J, yaml, plugin=MOCK) == ({}, [])


@pytest.mark.parametrize(
    ("plugin", "tag", "fields", "what"),
    [
        (
            CLASSIC,
            CLASSIC_PLUGIN,
            gain(1.0),
            "<position_proportional_gain>: Gazebo Classic has no such tag",
        ),
        (
            MOCK,
            SIM_PLUGIN,
            gain(1.0),
            "<position_proportional_gain>: no <ros2_control> block is for Gazebo Sim",
        ),
        # Whatever it is.
        (
            MOCK,
            SIM_PLUGIN,
            gain(-1.0),
            "<position_proportional_gain>: no <ros2_control> block is for Gazebo Sim",
        ),
        (
            MOCK,
            CLASSIC_PLUGIN,
            HELD.format("false"),
            "<hold_joints>: no <ros2_control> block is for Gazebo Classic",
        ),
        (MOCK, SIM_PLUGIN, HELD.format("true"), None),
    ],
)
def test_tags_of_a_plugin_that_drives_nothing_are_reported(
    find, plugin, tag, fields, what
):
    found, lines = find(J, plugin=plugin, tag=tag, fields=fields)

    place = f"info: arm.urdf: Gazebo plugin {tag[1]!r}"
    assert found == {}
    assert lines == ([] if what is None else [f"{place}: {what}; {NO_EFFECT}"])


def test_a_robot_about_which_nothing_is_said_has_no_gains(find, hold):
    robot = {"plugin": SIM, "tag": SIM_PLUGIN}

    assert find(J, RATE, **robot) == ({}, [])
    assert hold(J, RATE, **robot) == (True, [])
