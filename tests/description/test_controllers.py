"""Controllers YAML is read as rcl reads parameter files."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from arm_drake import yaml_files
from arm_drake.description.controllers import (
    ControllerManagerConfig,
    HardwareComponentsInitialState,
    load_controllers,
    set_hardware_states,
)
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError

JTC = "joint_trajectory_controller/JointTrajectoryController"

IDLE = "the controller does not run"

MANAGER = """\
controller_manager:
  ros__parameters:
    update_rate: 50
    arm: {type: a/A}
"""


@pytest.fixture
def load(tmp_path):
    """Return a function: YAML texts -> configuration and lines of the report."""

    def load_texts(
        *texts: str, **variables: str
    ) -> tuple[ControllerManagerConfig, list[str]]:
        files = [tmp_path / f"{number}.yaml" for number in range(len(texts))]
        for file, text in zip(files, texts, strict=True):
            file.write_text(text, encoding="utf-8")
        report = LoadReport()
        packages = PackageFinder(tmp_path / "a.urdf", [tmp_path])
        config = load_controllers(files, variables, report, packages=packages)
        # What the manager does not do has a test of its own.
        entries = [e for e in report if e.kind != "unsupported" or e.line is not None]
        return config, [str(e).replace(f"{tmp_path}/", "") for e in entries]

    return load_texts


@pytest.fixture
def problem(load, tmp_path):
    """Return a function: YAML text -> message of its error."""

    def find_problem(text: str) -> str:
        with pytest.raises(ParameterError) as caught:
            load(text)
        return str(caught.value).replace(f"{tmp_path}/", "")

    return find_problem


def values(config: ControllerManagerConfig, name: str = "arm") -> Mapping[str, Any]:
    (controller,) = (c for c in config.controllers if c.name == name)
    return {key: parameter.value for key, parameter in controller.parameters.items()}


def problems(config: ControllerManagerConfig) -> Mapping[str, str]:
    return {controller.name: controller.problem for controller in config.controllers}


def read_value(load, text: str) -> Any:
    config, _ = load(f"{MANAGER}arm:\n  ros__parameters:\n    x: {text}\n")
    return values(config)["x"]


def test_the_managers_list_gives_the_controllers_in_order(load):
    config, lines = load(
        "controller_manager:\n"
        "  ros__parameters:\n"
        "    update_rate: 50\n"
        "    b: {type: b/B}\n"
        "    a:\n"
        "      type: a/A\n"
        "    use_sim_time: true\n"
    )

    assert config.update_rate == 50
    assert [(c.name, c.type, c.line) for c in config.controllers] == [
        ("b", "b/B", 4),
        ("a", "a/A", 6),
    ]
    assert lines == []


def test_the_files_are_kept(load, tmp_path):
    config, _ = load(MANAGER)

    assert config.files == (tmp_path / "0.yaml",)
    assert config.controllers[0].file == tmp_path / "0.yaml"


def test_no_file_means_no_controllers_at_the_default_rate(load):
    config, lines = load()

    assert config == ControllerManagerConfig(100, (), ())
    assert lines == []


@pytest.mark.parametrize("text", ["", "\n", "# nothing\n", "---\n"])
def test_an_empty_file_is_an_error(problem, text):
    assert problem(text) == (
        "0.yaml: it is empty; expected <node>: {ros__parameters: {...}}"
    )


def test_a_missing_update_rate_is_100_hz_and_reported(load):
    config, lines = load("controller_manager: {ros__parameters: {}}")

    assert config.update_rate == 100
    assert lines == [
        "info: 0.yaml: controller_manager.update_rate is not given; 100 Hz is used",
        "warning: 0.yaml: no controller is configured; no controller runs",
    ]


def test_a_parameter_knows_its_file_and_line(load, tmp_path):
    config, _ = load(f"{MANAGER}arm:\n  ros__parameters:\n    x: 1\n")

    parameter = config.controllers[0].parameters["x"]
    assert (parameter.file, parameter.line) == (tmp_path / "0.yaml", 7)


@pytest.mark.parametrize(
    "section",
    [
        "arm: {ros__parameters: {x: 1}}",
        "/arm: {ros__parameters: {x: 1}}",
        "/**: {arm: {ros__parameters: {x: 1}}}",
        "/**/arm: {ros__parameters: {x: 1}}",
        "/*/arm: {ros__parameters: {x: 1}}",
        "/robot/arm: {ros__parameters: {x: 1}}",
        "robot: {arm: {ros__parameters: {x: 1}}}",
        "/left: {robot: {arm: {ros__parameters: {x: 1}}}}",
        "/**: {ros__parameters: {x: 1}}",
        "/*: {ros__parameters: {x: 1}}",
        "/**: {ros__parameters: {x: 1, arm: {type: a/A}}}",
    ],
)
def test_every_form_of_node_name_reaches_the_controller(load, section):
    config, lines = load(f"{MANAGER}{section}\n")

    assert values(config) == {"x": 1}
    assert lines == []


@pytest.mark.parametrize(
    "manager",
    [
        "/controller_manager: {ros__parameters: {update_rate: 7, arm: {type: a/A}}}",
        "/**: {ros__parameters: {update_rate: 7, arm: {type: a/A}}}",
        "/**: {controller_manager: {ros__parameters: "
        "{update_rate: 7, arm: {type: a/A}}}}",
        "robot: {controller_manager: {ros__parameters: "
        "{update_rate: 7, arm: {type: a/A}}}}",
        "/robot/controller_manager: {ros__parameters: {update_rate: 7, arm.type: a/A}}",
    ],
)
def test_every_form_of_node_name_reaches_the_manager(load, manager):
    config, lines = load(manager)

    assert config.update_rate == 7
    assert [(c.name, c.type) for c in config.controllers] == [("arm", "a/A")]
    assert values(config) == {}
    assert lines == []


def test_a_rate_in_the_controllers_own_section_is_its_own(load):
    config, _ = load(f"{MANAGER}arm: {{ros__parameters: {{update_rate: 25}}}}\n")

    assert config.update_rate == 50
    assert values(config) == {"update_rate": 25}


def test_nested_and_dotted_keys_mean_the_same(load):
    config, _ = load(
        f"{MANAGER}arm:\n"
        "  ros__parameters:\n"
        "    constraints.goal_time: 1.0\n"
        "    constraints:\n"
        "      joint1.goal: 2.0\n"
        "      joint2: {goal: 3.0}\n"
    )

    assert values(config) == {
        "constraints.goal_time": 1.0,
        "constraints.joint1.goal": 2.0,
        "constraints.joint2.goal": 3.0,
    }


def test_duplicate_keys_merge_and_the_later_value_wins(load):
    config, _ = load(
        "/**:\n"
        "  controller_manager: {ros__parameters: {update_rate: 50, arm: {type: a/A}}}\n"
        "/**:\n"
        "  arm: {ros__parameters: {x: 1, y: {a: 1}, y: {b: 2}}}\n"
        "/**:\n"
        "  arm: {ros__parameters: {x: 3}}\n"
    )

    assert values(config) == {"x": 3, "y.a": 1, "y.b": 2}


def test_a_later_section_overrides_single_values(load):
    config, _ = load(
        f"{MANAGER}arm: {{ros__parameters: {{x: 1, y: 2}}}}\n"
        "/**: {ros__parameters: {x: 3}}\n"
    )

    assert values(config) == {"x": 3, "y": 2}


def test_a_section_overrides_an_earlier_wildcard(load):
    config, _ = load(
        f"/**: {{ros__parameters: {{x: 3}}}}\n{MANAGER}"
        "arm: {ros__parameters: {x: 1, y: 2}}\n"
    )

    assert values(config) == {"x": 1, "y": 2}


def test_files_merge_and_the_later_one_wins(load):
    config, _ = load(
        f"{MANAGER}arm: {{ros__parameters: {{x: 1, y: 2}}}}\n",
        "arm: {ros__parameters: {x: 3}}\n",
        "controller_manager: {ros__parameters: {update_rate: 20, leg: {type: b/B}}}\n",
    )

    assert config.update_rate == 20
    assert [c.name for c in config.controllers] == ["arm", "leg"]
    assert values(config) == {"x": 3, "y": 2}


def test_a_type_may_stand_in_the_controllers_own_section(load):
    config, lines = load(
        f"{MANAGER}leg:\n  ros__parameters:\n    type: b/B\n    x: 1\n"
    )

    assert [(c.name, c.type, c.line) for c in config.controllers] == [
        ("arm", "a/A", 4),
        ("leg", "b/B", 7),
    ]
    assert values(config, "leg") == {"x": 1}
    assert lines == []


def test_the_managers_type_wins_over_the_controllers_own(load):
    config, _ = load(f"{MANAGER}arm: {{ros__parameters: {{type: b/B}}}}\n")

    assert config.controllers[0].type == "a/A"
    assert values(config) == {}


@pytest.mark.parametrize("node", ["/**", "/*"])
def test_a_type_under_a_wildcard_makes_no_controller_of_that_name(load, node):
    config, _ = load(f"{MANAGER}{node}: {{ros__parameters: {{type: b/B}}}}\n")

    assert [c.name for c in config.controllers] == ["arm"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-1", -1),
        ("+1", 1),
        ("0x10", 16),
        ("1.0", 1.0),
        ("1.", 1.0),
        (".5", 0.5),
        ("1e-3", 0.001),
        ("1E3", 1000.0),
        ("1.5e3", 1500.0),
        (".inf", float("inf")),
        ("-.inf", float("-inf")),
        ("true", True),
        ("no", False),
        ("on", True),
        ("'1'", "1"),
        ('"1.0"', "1.0"),
        ("'true'", "true"),
        ("1:30", "1:30"),
        ("2026-01-31", "2026-01-31"),
        ("2026-13-45", "2026-13-45"),
        ("1_000", "1_000"),
        ("joint1", "joint1"),
        ("[1, 2]", [1, 2]),
        ("[]", []),
        ("['1', a]", ["1", "a"]),
        ("!!str 1", "1"),
        ("!!float 1", 1.0),
    ],
)
def test_a_scalar_has_the_type_that_rcl_gives_it(load, text, value):
    read = read_value(load, text)

    assert read == value
    assert type(read) is type(value)


def test_not_a_number_is_a_number(load):
    read = read_value(load, ".nan")

    assert read != read


def test_anchors_and_merges_are_taken(load):
    config, _ = load(
        f"{MANAGER}"
        "arm:\n"
        "  ros__parameters:\n"
        "    a: &gains {p: 1, i: 2}\n"
        "    b: *gains\n"
        "    c: {p: 3, <<: *gains}\n"
    )

    expected = {"a.p": 1, "a.i": 2, "b.p": 1, "b.i": 2, "c.p": 3, "c.i": 2}
    assert values(config) == expected


def test_substitutions_take_the_given_values(load, monkeypatch):
    monkeypatch.setenv("SIDE", "left")
    config, _ = load(
        f"{MANAGER}"
        "arm:\n"
        "  ros__parameters:  # $(var nothing)\n"
        "    a: $(var prefix)joint\n"
        "    b: $(arg rate)\n"
        "    c: [$(var  prefix )1, $(var prefix)2]\n"
        "    d: $(find-pkg-share pkg)/x\n"
        "    e: $(env SIDE)\n"
        "    $(var prefix)f: 1\n",
        prefix="p_",
        rate="10",
        pkg="/opt",
    )

    assert values(config) == {
        "a": "p_joint",
        "b": 10,
        "c": ["p_1", "p_2"],
        "d": "/opt/x",
        "e": "left",
        "p_f": 1,
    }


@pytest.mark.parametrize("kind", ["var", "arg", "env"])
def test_a_substitution_without_a_value_is_an_error(problem, monkeypatch, kind):
    monkeypatch.delenv("nope", raising=False)
    if kind != "env":
        monkeypatch.setenv("nope", "1")

    assert problem(f"a:\n  ros__parameters:\n    b: $({kind} nope)\n") == (
        f"0.yaml:3: $({kind} nope) has no value; give one with "
        "variables={'nope': ...} (--var nope=VALUE)"
    )


def test_a_section_without_a_controller_is_reported(load):
    _, lines = load(
        f"{MANAGER}amr:\n  ros__parameters: {{x: 1}}\n"
        "robot: {leg: {ros__parameters: {x: 1}}}\n"
    )

    assert lines == [
        "warning: 0.yaml:6: amr: no controller of this name; did you mean 'arm'? "
        "known: arm, controller_manager; the section has no effect",
        "warning: 0.yaml:7: robot/leg: no controller of this name; "
        "known: arm, controller_manager; the section has no effect",
    ]


def plugin_values(config: ControllerManagerConfig, name: str) -> Mapping[str, Any]:
    return {key: p.value for key, p in config.plugin_nodes.get(name, {}).items()}


def test_parameters_of_gazebos_plugins_are_kept(load):
    config, lines = load(
        f"{MANAGER}"
        "gz_ros_control: {ros__parameters: {hold_joints: false, use_sim_time: true}}\n"
        "gazebo_ros2_control:\n"
        "  ros__parameters: {pid_gains: {position: {j: {kp: 1.0}}}}\n"
    )

    assert plugin_values(config, "gz_ros_control") == {
        "hold_joints": False,
        "use_sim_time": True,
    }
    assert plugin_values(config, "gazebo_ros2_control") == {
        "pid_gains.position.j.kp": 1.0
    }
    assert lines == []


def test_without_parameters_for_them_there_are_no_plugins(load):
    config, lines = load(f"{MANAGER}gz_ros_control: {{ros__parameters: {{}}}}\n")

    assert (config.plugin_nodes, lines) == ({}, [])


def test_plugins_get_the_parameters_of_all_nodes(load):
    config, lines = load(
        f"{MANAGER}"
        "/**: {ros__parameters: {hold_joints: true, a: 1}}\n"
        "robot: {gz_ros_control: {ros__parameters: {hold_joints: false}}}\n"
    )

    assert plugin_values(config, "gz_ros_control") == {"hold_joints": False, "a": 1}
    assert plugin_values(config, "gazebo_ros2_control") == {"hold_joints": True, "a": 1}
    assert lines == []


def test_plugins_get_the_parameters_of_the_first_managers_name_space(load):
    section = "gz_ros_control: {{ros__parameters: {{hold_joints: {0}, {1}: 1}}}}\n"

    config, _ = load(
        f"{TWO}/right/{section.format('true', 'pid_gains')}"
        f"/left/{section.format('false', 'position_proportional_gain')}"
    )

    assert plugin_values(config, "gz_ros_control") == {
        "hold_joints": False,
        "pid_gains": 1,
        "position_proportional_gain": 1,
    }


def test_parameters_that_no_plugin_has_are_reported(load):
    _, lines = load(
        f"{MANAGER}"
        "gz_ros_control: {ros__parameters: {hold_joint: false, x: {y: 1}}}\n"
    )

    known = "known: hold_joints, pid_gains, position_proportional_gain"
    assert lines == [
        "warning: 0.yaml:5: gz_ros_control.hold_joint: unknown parameter; "
        f"did you mean 'hold_joints'? {known}; it has no effect",
        "warning: 0.yaml:5: gz_ros_control.x.y: unknown parameter; "
        f"{known}; it has no effect",
    ]


def test_a_plugins_node_of_another_name_is_reported(load):
    _, lines = load(
        f"{MANAGER}gz_ros2_control: {{ros__parameters: {{hold_joints: false}}}}\n"
    )

    assert lines == [
        "warning: 0.yaml:5: gz_ros2_control: no node of this name; did you mean "
        "'gz_ros_control'? known: gazebo_ros2_control, gz_ros_control; "
        "the section has no effect"
    ]


def test_further_plugins_may_be_named(tmp_path):
    file, report = tmp_path / "c.yaml", LoadReport()
    file.write_text(
        f"{MANAGER}mine: {{ros__parameters: {{hold_joints: false}}}}\n", "utf-8"
    )

    config = load_controllers([file], {}, report, plugins=["mine"])

    assert plugin_values(config, "mine") == {"hold_joints": False}
    assert list(report) == []


def test_nodes_without_anything_are_reported(load):
    config, lines = load(
        f"{MANAGER}arm:\n"
        "/**/arm: {ros__parameters: }\n"
        "leg: {ros__parameters: {}}\n"
    )

    assert values(config) == {}
    assert lines == [
        "warning: 0.yaml:5: arm: nothing stands below it; it has no effect",
        "warning: 0.yaml:6: **/arm: it has no parameters; defaults are used",
        "warning: 0.yaml:7: leg: no controller of this name; "
        "known: arm, controller_manager; the section has no effect",
    ]


def test_parameters_without_a_node_are_taken_for_every_node(load):
    config, lines = load(f"{MANAGER}ros__parameters: {{x: 1}}\n")

    assert values(config) == {"x": 1}
    assert lines == [
        "warning: 0.yaml:5: it has no node name; it is taken for every node"
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "a:\n\tb: 1",
            "0.yaml:2: malformed YAML: a TAB indents this line; expected spaces",
        ),
        (
            "a:\n  b:\n    c: 1\n   d: 2",
            "0.yaml:4: malformed YAML: the indentation of 'd: 2', 3 columns, fits no "
            "line above; expected 2, as in line 2",
        ),
        (
            "a:\n  - b\n  c: 1",
            "0.yaml:3: malformed YAML: 'c: 1' stands where the lines above begin "
            "otherwise; expected either keys or items '- ...' in one block",
        ),
        (
            "a: b: c",
            "0.yaml:1: malformed YAML: a second ': ' in 'a: b: c'; expected quotes "
            "around a text with ': ' in it",
        ),
        (
            "a:\n  b: 1\n    c: 2",
            "0.yaml:3: malformed YAML: 'c: 2' goes on with the value of the line "
            "above; expected its indentation, or ':' at its end",
        ),
        (
            "a:\n  b: 'x\n  c: 2",
            '0.yaml:2: malformed YAML: the quote that opens in "b: \'x" never closes; '
            "expected another one at the text's end",
        ),
        ("a: {}\n---\nb: {}", "0.yaml:2: malformed YAML: but found another document"),
        ("a: *b", "0.yaml:1: malformed YAML: found undefined alias 'b'"),
        (
            "hello",
            "0.yaml:1: expected a mapping that ends in 'ros__parameters', got 'hello'",
        ),
        (
            "- a\n",
            "0.yaml:1: expected a mapping that ends in 'ros__parameters', got ['a']",
        ),
        (
            f"{MANAGER}arm:\n  joints: [a]\n",
            "0.yaml:6: arm/joints: expected a mapping that ends in 'ros__parameters', "
            "got ['a']; or is 'ros__parameters' missing between 'arm' and 'joints'?",
        ),
        (
            f"{MANAGER}arm: 5\n",
            "0.yaml:5: arm: expected a mapping that ends in 'ros__parameters', got 5",
        ),
        (
            f"{MANAGER}arm: []\n",
            "0.yaml:5: arm: expected a mapping that ends in 'ros__parameters', got []",
        ),
        (
            "arm:\n  ros__parameters: 5\n",
            "0.yaml:2: arm: expected a mapping of parameters, got 5",
        ),
        (
            "arm:\n  ros__parameters: [a]\n",
            "0.yaml:2: arm: expected a mapping of parameters, got ['a']",
        ),
        (
            "joint_state_controller:\n  type: joint_state_controller/A\n",
            "0.yaml: this is a ROS 1 configuration: no 'ros__parameters' anywhere; "
            "expected <node>: {ros__parameters: {...}}",
        ),
        (
            "# ros__parameters\na: {}\n",
            "0.yaml: no ROS 2 parameter file: no 'ros__parameters' anywhere; "
            "expected <node>: {ros__parameters: {...}}",
        ),
        (
            "? [a]\n: {ros__parameters: {}}\n",
            "0.yaml:1: malformed YAML: expected a name, got a sequence",
        ),
        (
            "a:\n  ros__parameters:\n    ? {b: 1}\n    : 1\n",
            "0.yaml:3: malformed YAML: expected a name, got a mapping",
        ),
        (
            "a:\n  ros__parameters:\n    b: !!int x\n",
            "0.yaml:3: 'x' is no int",
        ),
        (
            "a:\n  ros__parameters:\n    b: !mine x\n",
            "0.yaml:3: the tag '!mine' is not taken; known: !!bool, !!float, !!int, "
            "!!str",
        ),
        (
            "a:\n  ros__parameters:\n    b: {<<: 1}\n",
            "0.yaml:3: malformed YAML: expected a mapping or list of mappings for "
            "merging, but found scalar",
        ),
        (
            "a: &a\n  ros__parameters:\n    b: *a\n",
            "0.yaml:1: malformed YAML: the value contains itself",
        ),
        (
            "a:\n  ros__parameters:\n    b: &b [*b]\n",
            "0.yaml:3: malformed YAML: the value contains itself",
        ),
        ("a: " + "[" * 5000, "0.yaml: malformed YAML: nested too deeply"),
    ],
)
def test_a_malformed_file_is_one_located_message(problem, text, message):
    assert problem(text) == message


@pytest.mark.parametrize("rate", ["0", "-1", "100.5", "'100'", "true", "[100]", "fast"])
def test_a_bad_update_rate_is_an_error(problem, rate):
    shown = {"'100'": "'100'", "true": "True", "fast": "'fast'"}.get(rate, rate)

    message = problem(
        f"controller_manager:\n  ros__parameters:\n    update_rate: {rate}\n"
    )

    assert message == (
        "0.yaml:3: controller_manager.update_rate: expected an integer from 1 to "
        f"10000 [Hz], got {shown}"
    )


@pytest.mark.parametrize(
    ("value", "shown"), [("5", "5"), ("true", "True"), ("[b/B]", "['b/B']")]
)
def test_a_type_that_is_no_text_stops_its_controller_alone(load, value, shown):
    what = f"expected a controller type, got {shown}"

    config, lines = load(f"{MANAGER}    leg:\n      type: {value}\n")

    assert problems(config) == {"arm": "", "leg": what}
    assert lines == [f"error: 0.yaml:6: controller_manager.leg.type: {what}; {IDLE}"]


def test_a_type_that_is_no_text_is_named_where_it_stands(load):
    _, lines = load(f"{MANAGER}leg: {{ros__parameters: {{type: 5}}}}\n")

    assert lines == [
        f"error: 0.yaml:5: leg.type: expected a controller type, got 5; {IDLE}"
    ]


def test_aliases_that_multiply_end_in_an_error_at_once(problem):
    levels = "".join(
        f"  l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]\n" for i in range(1, 9)
    )
    start = time.process_time()

    message = problem(f"a:\n  l0: &l0 [1]\n{levels}  ros__parameters: {{x: *l8}}\n")

    assert message.startswith("0.yaml: malformed YAML: aliases multiply to ")
    assert time.process_time() - start < 2.0


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "No such file or directory"),
        (b"\xff\xfe\x00", "it is not UTF-8 text"),
    ],
)
def test_a_file_that_cant_be_read_is_an_error(tmp_path, content, problem):
    file = tmp_path / "a.yaml"
    if content is not None:
        file.write_bytes(content)

    with pytest.raises(ParameterError) as caught:
        load_controllers([file], {}, LoadReport())

    assert str(caught.value) == f"{file}: can't be read: {problem}"


def test_a_folder_in_place_of_a_file_is_an_error(tmp_path):
    with pytest.raises(ParameterError) as caught:
        load_controllers([tmp_path], {}, LoadReport())

    assert str(caught.value) == f"{tmp_path}: can't be read: Is a directory"


def test_a_name_that_no_file_has_is_an_error():
    with pytest.raises(ParameterError) as caught:
        load_controllers([Path("a\0b")], {}, LoadReport())

    assert caught.value.problem == "can't be read: no file has such a name"


# The manager's own parameters


def manager(text: str) -> str:
    indented = "".join(f"    {line}\n" for line in text.splitlines())
    return f"controller_manager:\n  ros__parameters:\n    arm.type: a/A\n{indented}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("update_rate: 50", None),
        ("update_rate: 50\nenforce_command_limits: true", True),
        ("update_rate: 50\nenforce_command_limits: off", False),
    ],
)
def test_enforce_command_limits_is_as_given_or_unknown(load, text, expected):
    config, lines = load(manager(text))

    assert config.enforce_command_limits is expected
    assert lines == []


def test_initial_states_of_hardware_are_lists_of_names(load):
    config, lines = load(
        manager(
            "update_rate: 50\n"
            "hardware_components_initial_state:\n"
            "  unconfigured: [a]\n"
            "  inactive: [b, c, b]"
        )
    )

    assert config.hardware_components_initial_state == HardwareComponentsInitialState(
        unconfigured=("a",), inactive=("b", "c"), active=()
    )
    assert lines == []


def test_humbles_names_of_initial_states_are_mapped(load):
    config, lines = load(
        manager(
            "update_rate: 50\n"
            "activate_components_on_start: [a]\n"
            "configure_components_on_start: [b]\n"
            "hardware_components_initial_state.inactive: [c]"
        )
    )

    assert config.hardware_components_initial_state == HardwareComponentsInitialState(
        unconfigured=(), inactive=("c", "b"), active=("a",)
    )
    assert lines == [
        "info: 0.yaml:5: controller_manager.activate_components_on_start: this is "
        "Humble's name; taken as the active ones of hardware_components_initial_state",
        "info: 0.yaml:6: controller_manager.configure_components_on_start: this is "
        "Humble's name; taken as the inactive ones of "
        "hardware_components_initial_state",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("enforce_command_limits: 1", "enforce_command_limits: expected bool, got 1"),
        (
            "hardware_components_initial_state: {inactive: arm}",
            "hardware_components_initial_state.inactive: expected a list of str, "
            "got 'arm'",
        ),
        (
            "activate_components_on_start: [1]",
            "activate_components_on_start: expected str, got 1",
        ),
    ],
)
def test_a_managers_parameter_of_another_type_is_an_error(problem, text, message):
    assert problem(manager(text)) == f"0.yaml:4: controller_manager.{message}"


def test_what_a_simulation_has_not_is_taken_without_a_word(load):
    _, lines = load(
        manager(
            "update_rate: 50\n"
            "use_sim_time: true\n"
            "lock_memory: false\n"
            "cpu_affinity: 2\n"
            "thread_priority: 50\n"
            "overruns: {manage: true, print_warnings: false}\n"
            "diagnostics: {threshold: {x: {error: 1.0}}}\n"
            "hardware_synchronization: {a: {b: 1}}"
        )
    )

    assert lines == []


def test_parameters_of_the_manager_without_effect_are_reported(load):
    _, lines = load(
        manager(
            "update_rate: 50\n"
            "update_rte: 60\n"
            "gains: {p: 1.0, d: 2.0}\n"
            "handle_exceptions: false\n"
            "arm: {joints: [a], gains: {p: 1}}"
        )
    )

    assert lines == [
        "info: 0.yaml:7: controller_manager.handle_exceptions: it is not simulated; "
        "it has no effect",
        "info: 0.yaml:5: controller_manager.update_rte: unknown parameter; did you "
        "mean 'update_rate'? known: activate_components_on_start, "
        "configure_components_on_start, enforce_command_limits, "
        "hardware_components_initial_state, update_rate; it has no effect",
        "info: 0.yaml:6: controller_manager.gains: no controller, for it has no "
        "'type', only d, p; it has no effect",
        "warning: 0.yaml:8: controller_manager.arm: gains.p, joints: a controller's "
        "parameters stand in its own section; it has no effect",
    ]


def test_parameters_of_all_nodes_are_not_the_managers_alone(load):
    config, lines = load(
        "/**:\n"
        "  ros__parameters:\n"
        "    update_rate: 50\n"
        "    enforce_command_limits: true\n"
        "    joints: [a]\n"
        "    arm: {type: a/A, gains: {p: 1}}\n"
    )

    assert config.update_rate == 50
    assert config.enforce_command_limits is True
    assert values(config) == {"joints": ["a"]}
    assert lines == [
        "warning: 0.yaml:6: controller_manager.arm: gains.p: a controller's "
        "parameters stand in its own section; it has no effect"
    ]


# What the manager's section says about a controller


def test_a_controllers_fallback_is_kept(load):
    config, lines = load(
        f"{MANAGER}    hold: {{type: a/A}}\n    leg: {{type: b/B}}\n"
        "    arm.fallback_controllers: [hold]\n"
        "leg: {ros__parameters: {fallback_controllers: [hold, arm], x: 1}}\n"
    )

    fallback = {c.name: c.fallback_controllers for c in config.controllers}
    assert fallback == {"arm": ("hold",), "hold": (), "leg": ("hold", "arm")}
    assert values(config, "leg") == {"x": 1}
    assert lines == []


def test_options_of_a_node_are_reported(load):
    config, lines = load(f"{MANAGER}    arm.node_options_args: ['-r', 'a:=b']\n")

    assert [c.name for c in config.controllers] == ["arm"]
    assert lines == [
        "info: 0.yaml:5: controller_manager.arm.node_options_args: options of nodes "
        "are not simulated; it has no effect"
    ]


def test_a_controller_is_not_its_own_fallback(load):
    config, lines = load(
        f"{MANAGER}    leg: {{type: b/B}}\n    arm.fallback_controllers: [leg, arm]\n"
    )

    assert problems(config) == {"arm": "it is its own fallback", "leg": ""}
    assert lines == [
        "error: 0.yaml:6: controller_manager.arm.fallback_controllers: "
        f"it is its own fallback; {IDLE}"
    ]


def test_a_controller_alone_that_is_its_own_fallback_is_configured(load):
    config, lines = load(f"{MANAGER}    arm.fallback_controllers: [arm]\n")

    assert [c.name for c in config.controllers] == ["arm"]
    assert len(lines) == 1


@pytest.mark.parametrize("value", ["1", "[1]", "true", "[1.5]"])
@pytest.mark.parametrize(
    ("text", "where"),
    [
        (
            "    leg.fallback_controllers: {}\n",
            "6: controller_manager.leg.fallback_controllers",
        ),
        (
            "leg: {{ros__parameters: {{fallback_controllers: {}}}}}\n",
            "6: leg.fallback_controllers",
        ),
    ],
)
def test_fallback_of_another_type_stops_its_controller_alone(load, text, where, value):
    shown = {"true": "True"}.get(value, value)
    what = f"expected a text or a list of texts, got {shown}"

    config, lines = load(f"{MANAGER}    leg: {{type: b/B}}\n{text.format(value)}")

    assert problems(config) == {"arm": "", "leg": what}
    assert config.controllers[1].fallback_controllers == ()
    assert values(config, "leg") == {}
    assert lines == [f"error: 0.yaml:{where}: {what}; {IDLE}"]


def test_an_unknown_fallback_is_left_out(load):
    config, lines = load(
        f"{MANAGER}    legs: {{type: b/B}}\n"
        "    arm.fallback_controllers: [leg, legs, none]\n"
    )

    assert config.controllers[0].fallback_controllers == ("legs",)
    assert problems(config) == {"arm": "", "legs": ""}
    where = "warning: 0.yaml:6: controller_manager.arm.fallback_controllers"
    assert lines == [
        f"{where}: no controller 'leg'; did you mean 'legs'? known: legs; "
        "it is left out",
        f"{where}: no controller 'none'; known: legs; it is left out",
    ]


def test_a_controller_that_is_not_loaded_stays_a_fallback(load):
    config, lines = load(
        f"{MANAGER}    leg: {{type: 5}}\n    arm.fallback_controllers: [leg]\n"
    )

    assert config.controllers[0].fallback_controllers == ("leg",)
    assert len(lines) == 1


def test_a_controller_without_a_type_is_not_spawned(load):
    config, lines = load(f"{MANAGER}    leg: {{fallback_controllers: [arm]}}\n")

    assert [c.name for c in config.controllers] == ["arm"]
    assert lines == [
        "warning: 0.yaml:5: controller_manager.leg: no 'type' is given; "
        "it is not spawned"
    ]


def test_a_misspelt_type_is_one_error_where_it_is(load):
    config, lines = load(
        f"{MANAGER}    leg:\n      typ: a/A\nleg: {{ros__parameters: {{x: 1}}}}\n"
    )

    assert [c.name for c in config.controllers] == ["arm"]
    assert lines == [
        "error: 0.yaml:6: controller_manager.leg: no 'type' is given, but 'typ'; "
        "it is not spawned",
        "warning: 0.yaml:6: controller_manager.leg: typ: a controller's parameters "
        "stand in its own section; it has no effect",
    ]


def test_a_type_without_a_value_is_not_given(load):
    config, lines = load(f"{MANAGER}    leg:\n      type:\n")

    assert [c.name for c in config.controllers] == ["arm"]
    assert lines == [
        "warning: 0.yaml:6: controller_manager.leg.type: it has no value; "
        "rcl refuses the file; taken as not given"
    ]


def test_files_of_a_controller_are_read_for_it_alone(load, tmp_path):
    package = tmp_path / "pkg"
    package.mkdir()
    (package / "package.xml").write_text("<package><name>pkg</name></package>")
    (package / "far.yaml").write_text("arm: {ros__parameters: {x: 4}}\n")
    (tmp_path / "all.yaml").write_text("/**: {ros__parameters: {x: 3, y: 3, z: 3}}\n")
    (tmp_path / "leg.yaml").write_text(
        "leg: {ros__parameters: {type: b/B}}\nother: {ros__parameters: {x: 1}}\n"
    )

    config, lines = load(
        f"{MANAGER}"
        "    arm.params_file: [all.yaml, package://pkg/far.yaml]\n"
        f"    leg.params_file: {tmp_path}/leg.yaml\n"
        "arm: {ros__parameters: {x: 1, y: 1, w: 1}}\n"
    )

    assert values(config) == {"x": 4, "y": 3, "z": 3, "w": 1}
    assert [(c.name, c.type) for c in config.controllers] == [
        ("arm", "a/A"),
        ("leg", "b/B"),
    ]
    assert values(config, "leg") == {}
    assert config.files == (
        tmp_path / "0.yaml",
        tmp_path / "all.yaml",
        package / "far.yaml",
        tmp_path / "leg.yaml",
    )
    assert lines == []


@pytest.mark.parametrize("value", ["1", "[1.5]"])
def test_a_file_of_a_controller_that_is_no_text_is_ignored(load, value):
    config, lines = load(
        f"{MANAGER}    arm.params_file: {value}\narm: {{ros__parameters: {{x: 1}}}}\n"
    )

    assert problems(config) == {"arm": ""}
    assert values(config) == {"x": 1}
    assert lines == [
        "error: 0.yaml:5: controller_manager.arm.params_file: expected a text or a "
        f"list of texts, got {value}; it is ignored"
    ]


def test_a_malformed_file_of_a_controller_stops_it_alone(load, tmp_path):
    (tmp_path / "arm.yaml").write_text("arm: {ros__parameters: 5}\n")
    expected = "expected a mapping of parameters, got 5"

    config, lines = load(
        f"{MANAGER}    leg: {{type: b/B}}\n    arm.params_file: arm.yaml\n"
    )

    what = f"{tmp_path}/arm.yaml:1: arm: {expected}"
    assert problems(config) == {"arm": what, "leg": ""}
    assert lines == [
        "error: 0.yaml:6: controller_manager.arm.params_file: "
        f"arm.yaml:1: arm: {expected}; {IDLE}"
    ]


@pytest.mark.slow
def test_a_missing_file_of_a_controller_is_reported(load):
    config, lines = load(
        f"{MANAGER}    arm.params_file:\n      - nope.yaml\n      - package://nope/a\n"
    )

    assert [c.name for c in config.controllers] == ["arm"]
    assert lines[0] == (
        "error: 0.yaml:6: controller_manager.arm.params_file: no such file: "
        "'nope.yaml'; it is left out"
    )
    assert "arm.params_file: package 'nope' not found" in lines[1]
    assert len(lines) == 2


# Several managers


TWO = """\
/left/controller_manager:
  ros__parameters:
    update_rate: 50
    arm: {type: a/A, fallback_controllers: [hold, arm2]}
    arm2: {type: a/A}
    hold: {type: h/H}
right:
  controller_manager:
    ros__parameters:
      update_rate: 50
      hold: {type: h/H}
      leg: {type: b/B}
"""

FURTHER = (
    "warning: 0.yaml:9: right/controller_manager: a further controller manager beside "
    "'left/controller_manager'; its controllers run under 'left/controller_manager'"
)


SHARED = f"""\
{TWO}
/**/hold:
  ros__parameters: {{of: all}}
hold:
  ros__parameters: {{at: root}}
/left/hold:
  ros__parameters: {{of: left}}
/*/right/hold:
  ros__parameters: {{of: deeper}}
"""


@pytest.mark.parametrize(
    ("namespace", "names", "hold"),
    [
        ("right", ["hold", "leg"], {"of": "all", "at": "root"}),
        ("/left/", ["arm", "arm2", "hold"], {"of": "left", "at": "root"}),
    ],
)
def test_of_a_name_space_only_its_own_manager_counts(tmp_path, namespace, names, hold):
    file = tmp_path / "a.yaml"
    file.write_text(SHARED, encoding="utf-8")
    report = LoadReport()

    config = load_controllers([file], {}, report, namespace=namespace)

    found = {c.name: c for c in config.controllers}
    assert list(found) == names
    values = {key: each.value for key, each in found["hold"].parameters.items()}
    assert values == hold
    assert not report


def test_a_name_space_without_a_manager_of_its_own_takes_them_all(load, tmp_path):
    load(TWO)
    report = LoadReport()

    config = load_controllers([tmp_path / "0.yaml"], {}, report, namespace="lef")

    assert len(config.controllers) == 5
    lines = str(report).splitlines()
    assert FURTHER in [line.replace(f"{tmp_path}/", "") for line in lines]
    told = (
        f"warning: {tmp_path}/0.yaml:2: no controller_manager of name space '/lef'; "
        "did you mean '/left'? known: /left, /right; all are taken"
    )
    assert told in lines


ROOT = """\
robot_manager:
  ros__parameters: {update_rate: 100, hold: {type: a/B}}
hold:
  ros__parameters: {of: root}
/right/robot_manager:
  ros__parameters: {update_rate: 50, hold: {type: c/D}}
/right/hold:
  ros__parameters: {of: right}
"""

WILD = """\
/*/controller_manager:
  ros__parameters: {update_rate: 100, hold: {type: a/B}}
/*/hold:
  ros__parameters: {of: all}
/right/*:
  ros__parameters: {at: right}
/left/**:
  ros__parameters: {at: left}
"""


@pytest.mark.parametrize(
    ("text", "namespace", "rate", "hold"),
    [
        # Of a manager without name space there is one for every robot but "right".
        (ROOT, "left", 100, {"of": "root"}),
        (ROOT, "right", 50, {"of": "right"}),
        (WILD, "left", 100, {"of": "all", "at": "left"}),
        (WILD, "right", 100, {"of": "all", "at": "right"}),
    ],
)
def test_name_spaces_beside_none_and_with_wildcards(
    tmp_path, text, namespace, rate, hold
):
    file = tmp_path / "a.yaml"
    file.write_text(text, encoding="utf-8")
    report = LoadReport()

    config = load_controllers(
        [file], {}, report, namespace=namespace, manager="robot_manager"
    )

    (found,) = config.controllers
    values = {key: each.value for key, each in found.parameters.items()}
    assert (config.update_rate, values) == (rate, hold)
    assert not report


def test_controllers_of_several_managers_are_all_taken(load):
    config, lines = load(TWO)

    assert config.update_rate == 50
    assert [(c.name, c.type, c.fallback_controllers) for c in config.controllers] == [
        ("arm", "a/A", ("left_hold", "arm2")),
        ("arm2", "a/A", ()),
        ("left_hold", "h/H", ()),
        ("right_hold", "h/H", ()),
        ("leg", "b/B", ()),
    ]
    assert lines == [
        "warning: 0.yaml:6: left/controller_manager.hold: several controller managers "
        "have a controller 'hold'; this one is named 'left_hold'",
        "warning: 0.yaml:11: right/controller_manager.hold: several controller "
        "managers have a controller 'hold'; this one is named 'right_hold'",
        FURTHER,
    ]


def test_controllers_of_one_name_get_the_parameters_of_their_name_space(load):
    config, _ = load(
        f"{TWO}"
        "/**: {ros__parameters: {a: 1}}\n"
        "/**/hold: {ros__parameters: {b: 1}}\n"
        "/left/hold: {ros__parameters: {c: 1}}\n"
        "right: {hold: {ros__parameters: {d: 1}}}\n"
        "/*/hold: {ros__parameters: {e: 1}}\n"
        "/a/*/hold: {ros__parameters: {f: 1}}\n"
        "hold: {ros__parameters: {g: 1}}\n"
    )

    assert values(config, "left_hold") == {"a": 1, "b": 1, "c": 1, "e": 1, "g": 1}
    assert values(config, "right_hold") == {"a": 1, "b": 1, "d": 1, "e": 1, "g": 1}


def test_a_section_of_another_managers_name_space_is_reported(load):
    config, lines = load(f"{TWO}/left/leg: {{ros__parameters: {{x: 1}}}}\n")

    assert values(config, "leg") == {}
    assert lines[-1] == (
        "warning: 0.yaml:13: left/leg: no controller of this name; did you mean 'leg'? "
        "known: arm, arm2, controller_manager, hold, leg; the section has no effect"
    )


def test_a_type_in_its_own_section_belongs_to_one_manager(load):
    config, _ = load(
        f"{TWO}"
        "/right/foot: {ros__parameters: {type: f/F}}\n"
        "wheel: {ros__parameters: {type: w/W}}\n"
    )

    names = [c.name for c in config.controllers]
    assert sorted(names) == sorted(
        ["arm", "arm2", "left_hold", "wheel", "right_hold", "leg", "foot"]
    )


def test_of_several_rates_the_first_is_used(load):
    text = TWO.replace("      update_rate: 50", "      update_rate: 100")

    config, lines = load(text)

    assert config.update_rate == 50
    assert lines[-2:] == [
        FURTHER,
        "warning: 0.yaml:10: right/controller_manager.update_rate: 100 differs from 50 "
        "of another controller manager; 50 is used",
    ]


def test_parameters_of_several_managers_are_taken_together(load):
    config, _ = load(
        TWO.replace(
            "    update_rate: 50\n    arm:",
            "    hardware_components_initial_state.inactive: [a, b]\n    arm:",
        ),
        "/right/controller_manager:\n"
        "  ros__parameters:\n"
        "    enforce_command_limits: true\n"
        "    hardware_components_initial_state.inactive: [b, c]\n",
    )

    assert config.update_rate == 50
    assert config.enforce_command_limits is True
    assert config.hardware_components_initial_state.inactive == ("a", "b", "c")


def test_a_new_name_that_is_taken_gets_a_mark(load):
    config, _ = load(f"{TWO}      left_hold: {{type: l/L}}\n")

    types = {c.name: c.type for c in config.controllers}
    assert types["left_hold"] == "l/L"
    assert types["left_hold_"] == "h/H"


def test_a_rate_written_as_a_double_is_taken(load):
    config, lines = load(
        "controller_manager:\n  ros__parameters:\n    update_rate: 50.0\n"
        "    arm: {type: a/A}\n"
    )

    assert config.update_rate == 50
    assert lines == [
        "info: 0.yaml:3: controller_manager.update_rate: 50.0 is a double; "
        "ros2_control refuses it for an integer; taken as an integer"
    ]


def test_a_manager_may_have_another_name(tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(
        "/ns/simulation_manager:\n  ros__parameters:\n    update_rate: 50\n"
        "    arm: {type: a/A}\n",
        encoding="utf-8",
    )

    config = load_controllers([file], {}, LoadReport(), manager="simulation_manager")

    assert config.update_rate == 50
    assert [controller.name for controller in config.controllers] == ["arm"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("s: {inactive: [a, c]}", "s: {inactive: [a]}"),
        ("s.inactive: [a, c]", "s.inactive: [a]"),
        ("s: {unconfigured: [a, b, c]}", "s: {unconfigured: [a], inactive: [b]}"),
        (
            "{s.unconfigured: [b], s.inactive: [a]}",
            "{s.unconfigured: [], s.inactive: [a, b]}",
        ),
        ("activate_components_on_start: [a]", "activate_components_on_start: [a, c]"),
        ("activate_components_on_start: []", "activate_components_on_start: []"),
        ("configure_components_on_start: [b, c]", "configure_components_on_start: [b]"),
        ("update_rate: 10", "update_rate: 10"),
        # One that doesn't become active doesn't begin so.
        ("s: {inactive: [d]}", "s: {inactive: [d]}"),
        (
            "{s.unconfigured: [b], s.inactive: null}",
            "{s.unconfigured: [], s.inactive: [b]}",
        ),
        (
            "s: {unconfigured: [b], inactive: [b]}",
            "s: {unconfigured: [], inactive: [b]}",
        ),
        # What is wrong stays, and is told where it is loaded.
        ("s: {unconfigured: [b], inactive: b}", "s: {unconfigured: [], inactive: b}"),
        ("s: {inactive: [{c: 1}]}", "s: {inactive: [{c: 1}]}"),
    ],
)
def test_hardware_is_put_into_another_initial_state(text, expected):
    found = set_hardware_states(
        {"m": {"ros__parameters": yaml_files.parse(text)}},
        {"b": "inactive", "c": "active", "d": "unconfigured"},
    )

    assert found == {"m": {"ros__parameters": yaml_files.parse(expected)}}
