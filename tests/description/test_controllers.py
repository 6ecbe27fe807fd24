"""Controllers YAML is read as rcl reads parameter files."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.controllers import (
    ControllerManagerConfig,
    load_controllers,
)
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError

JTC = "joint_trajectory_controller/JointTrajectoryController"

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
        config = load_controllers(files, variables, report)
        return config, [str(e).replace(f"{tmp_path}/", "") for e in report]

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
        "    gains: {p: 1.0}\n"
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


def test_an_empty_file_configures_nothing(load):
    config, _ = load("# nothing\n")

    assert config.controllers == ()


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
        "ros__parameters: {x: 1}",
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


@pytest.mark.parametrize("kind", ["var", "arg", "env", "find-pkg-share"])
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


def test_a_node_without_anything_is_nothing(load):
    config, lines = load(f"{MANAGER}arm:\nleg: {{ros__parameters: }}\n")

    assert values(config) == {}
    assert lines == [
        "warning: 0.yaml:6: leg: no controller of this name; "
        "known: arm, controller_manager; the section has no effect"
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "a:\n\tb: 1",
            "0.yaml:2: malformed YAML: found character '\\t' that cannot start any "
            "token",
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
            "got ['a']",
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
            "0.yaml: no 'ros__parameters' anywhere: this is no ROS 2 parameter file "
            "(ROS 1 configurations have none)",
        ),
        (
            "# ros__parameters\na: {}\n",
            "0.yaml: no 'ros__parameters' anywhere: this is no ROS 2 parameter file "
            "(ROS 1 configurations have none)",
        ),
        (
            "? [a]\n: {ros__parameters: {}}\n",
            "0.yaml:1: malformed YAML: expected a name, got ['a']",
        ),
        (
            "a:\n  ros__parameters:\n    ? {b: 1}\n    : 1\n",
            "0.yaml:3: malformed YAML: expected a name, got {'b': 1}",
        ),
        (
            "a:\n  ros__parameters:\n    b: !!int x\n",
            "0.yaml:3: malformed YAML: invalid literal for int() with base 10: 'x'",
        ),
        (
            "a:\n  ros__parameters:\n    b: !mine x\n",
            "0.yaml:3: malformed YAML: could not determine a constructor for the tag "
            "'!mine'",
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


@pytest.mark.parametrize("rate", ["0", "-1", "100.0", "'100'", "true", "[100]", "fast"])
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
    ("value", "shown"), [("5", "5"), ("", "None"), ("[a/A]", "['a/A']")]
)
def test_a_type_that_is_no_text_is_an_error(problem, value, shown):
    message = problem(
        f"controller_manager:\n  ros__parameters:\n    arm:\n      type: {value}\n"
    )

    assert message == f"0.yaml:4: arm.type: expected a controller type, got {shown}"


def test_aliases_that_multiply_end_in_an_error_at_once(problem):
    levels = "".join(
        f"  l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]\n" for i in range(1, 9)
    )
    start = time.perf_counter()

    message = problem(f"a:\n  l0: &l0 [1]\n{levels}  ros__parameters: {{x: *l8}}\n")

    assert message.startswith("0.yaml: malformed YAML: aliases multiply to ")
    assert time.perf_counter() - start < 2.0


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
