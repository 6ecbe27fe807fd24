"""Parameters that have no effect, or another one than written: a line of the report."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.forward_command_controller import (
    ForwardCommandControllerParameters,
)
from arm_drake.controllers.registry import ControllerType
from arm_drake.description.controllers import ControllerConfig, ControllerManagerConfig
from arm_drake.description.controllers import load_controllers as read_controllers
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.loading import load_controllers
from tests.controllers.parameters import (
    ACKERMANN,
    DIFF_DRIVE,
    GRIPPER,
    JSB,
    JTC,
    MINIMAL,
    OLD_JSB,
    PID,
    SCALED_JTC,
    load,
    report_of,
)
from tests.robots import robots_folder


@pytest.mark.parametrize(
    ("type_", "name", "value"),
    [
        (JTC, "speed_scaling.state_interface", "s/factor"),
        (JTC, "speed_scaling.command_interface", "s/factor"),
        (JTC, "speed_scaling.initial_scaling_factor", 0.5),
        (JTC, "constraints.decelerate_on_cancel", True),
        (JTC, "command_joints", ["b"]),
        (JSB, "map_interface_to_joint_state.position", "angle"),
        (JSB, "map_interface_to_joint_state.velocity", "speed"),
        (JSB, "map_interface_to_joint_state.effort", "torque"),
        (JSB, "publish_dynamic_joint_states", True),
    ],
)
def test_what_a_controller_acts_on_is_not_reported(type_, name, value):
    assert report_of(type_, {name: value}) == []


def test_the_only_value_that_acts_is_named():
    name = "start_with_holding"

    assert report_of(JTC, {name: False}, distro="humble") == [
        f"warning: {name}: False is not acted on yet; the controller acts as with True"
    ]
    assert report_of(JTC, {name: True}, distro="humble") == []


def test_a_pid_says_that_it_has_no_topic_of_its_own() -> None:
    name = "gains.a.activate_state_publisher"

    assert report_of(PID, {name: True}) == [
        f"warning: {name}: True is not acted on yet; the controller acts as with False"
    ]
    assert report_of(PID, {name: False}) == []


@pytest.mark.parametrize(
    ("type_", "name", "done"),
    [
        (JTC, "constraints.a.trajectory", "no tolerance holds, as for 0"),
        (JTC, "constraints.b.goal", "no tolerance holds, as for 0"),
        (JTC, "constraints.stopped_velocity_tolerance", "no tolerance holds, as for 0"),
        (
            GRIPPER,
            "stall_velocity_threshold",
            "the gripper counts as standing, however fast it is",
        ),
        (GRIPPER, "stall_timeout", "the gripper never stalls"),
    ],
)
def test_what_a_number_does_that_is_none_is_said(type_, name, done):
    lines = report_of(type_, {name: float("nan")})

    assert lines == [f"warning: {name}: it is not a number; {done}"]


def test_gains_without_a_pid_are_reported_once():
    parameters = {"gains.a.p": 1.0, "gains.b.p": 1.0}
    velocity = {"command_interfaces": ["velocity"]}

    assert report_of(JTC, parameters) == [
        "info: gains.a.p: gains act on 'velocity' or 'effort' alone, not on "
        "['position']; none of them has an effect"
    ]
    assert report_of(JTC, {**velocity, **parameters}) == []


def test_the_name_of_the_scaled_controllers_factor_is_taken():
    name, factor = "speed_scaling_interface_name", "speed_scaling/speed_scaling_factor"

    loaded = load(SCALED_JTC, {name: factor})

    assert loaded.speed_scaling.state_interface == factor
    assert report_of(SCALED_JTC, {name: factor}) == [
        f"info: {name}: older parameter; later: speed_scaling.state_interface: "
        f"{factor}; taken as that",
    ]


def test_saturation_of_a_trajectory_controller_is_unknown_after_jazzy():
    velocity = {"command_interfaces": ["velocity"]}
    parameters = {**velocity, "gains.a.saturation": False, "gains.a.u_clamp_max": 2.0}

    for distro, limit in (("jazzy", float("inf")), ("kilted", 2.0)):
        assert (
            load(JTC, parameters, distro=distro).gains.joint["a"].u_clamp_max == limit
        )
    assert report_of(JTC, parameters) == [
        "warning: gains.a.u_clamp_max: saturation is false; it has no effect"
    ]
    assert report_of(PID, {"gains.a.saturation": True}) == []


@pytest.mark.parametrize(
    ("distro", "parameters", "lines"),
    [
        (
            "rolling",
            {"linear.x.has_jerk_limits": False, "linear.x.max_jerk": 1.0},
            [
                "warning: linear.x.has_jerk_limits: a parameter of humble; a limit "
                "that is given acts: max_jerk"
            ],
        ),
        (
            "jazzy",
            {"linear.x.has_jerk_limits": False, "linear.x.max_jerk": 0.0},
            ["info: linear.x.max_jerk: has_jerk_limits is false; the limit is off"],
        ),
        (
            "jazzy",
            {
                "angular.z.has_acceleration_limits": False,
                "angular.z.max_deceleration": -1.0,
            },
            [
                "info: angular.z.max_deceleration: has_acceleration_limits is false; "
                "the limit is off"
            ],
        ),
    ],
)
def test_a_switch_of_limits_is_reported(distro, parameters, lines):
    assert report_of(DIFF_DRIVE, parameters, distro=distro) == lines


def test_a_limit_that_humble_does_not_switch_on_is_reported():
    parameters = {"linear.x.max_velocity": 1.0, "angular.z.max_jerk": float("nan")}

    assert report_of(DIFF_DRIVE, parameters, distro="humble") == [
        "warning: linear.x.max_velocity: has_velocity_limits is not true; the limit is "
        "off"
    ]


def test_steered_wheels_need_no_radius():
    parameters = {"front_wheels_radius": 0.2}

    assert report_of(ACKERMANN, parameters) == [
        "info: front_wheels_radius: the steered wheels' radius has no use; it has no "
        "effect"
    ]


FILE = Path("c.yaml")


def loaded_by_manager(
    type_: str, types: Mapping[str, ControllerType] | None = None, **values: Any
) -> tuple[list[str], list[str], bool]:
    """Return state and report of a controller, and whether it has a system."""
    written = {**MINIMAL.get(type_, {}), **values}
    parameters = {name: Parameter(v, FILE, 7) for name, v in written.items()}
    distro = parameters.pop("distro", Parameter("jazzy", FILE, 1)).value
    config = ControllerManagerConfig(
        controllers=(ControllerConfig("c", type_, parameters, FILE, 3),)
    )
    names = [
        f"{joint}/{interface}"
        for interface in ("position", "velocity", "effort")
        for joint in "ab"
    ]
    hardware_interfaces = HardwareInterfaces(
        {"a": "revolute", "b": "revolute"},
        tuple(names[:2]),
        tuple(names),
        {"a": 0.0, "b": 0.0},
    )
    report = LoadReport()
    (controller,) = load_controllers(
        config, hardware_interfaces, report, distro=distro, controller_types=types
    )
    return [controller.state], str(report).splitlines(), controller.system is not None


def test_a_type_that_is_not_simulated_has_its_parameters_checked():
    type_ = "own_controllers/Unfinished"
    types = {type_: ControllerType(ForwardCommandControllerParameters)}
    parameters = {"joints": ["a"], "interface_name": "position"}
    done = "the controller does not run"
    what = f"error: c.yaml:3: c: controller type {type_!r} is not simulated yet; {done}"

    assert loaded_by_manager(type_, types, **parameters) == (
        ["unconfigured"],
        [what],
        False,
    )
    assert loaded_by_manager(type_, types, **{**parameters, "joints": []}) == (
        ["unconfigured"],
        [
            what,
            f"error: c.yaml:7: c: joints must have at least one element; {done}",
        ],
        False,
    )


def test_a_type_that_is_unknown_is_unsupported():
    state, (line,), _ = loaded_by_manager("pid_controller/PidControler")

    assert state == ["unconfigured"]
    assert line.startswith(
        "error: c.yaml:3: c: unknown controller type 'pid_controller/PidControler'; "
        "did you mean 'pid_controller/PidController'?; the controller does not run"
    )


@pytest.mark.parametrize(("type_", "other"), [(SCALED_JTC, JTC), (OLD_JSB, JSB)])
def test_an_equivalent_type_runs_as_ours(type_, other):
    assert loaded_by_manager(type_) == (
        ["active"],
        [f"info: c.yaml:3: c: controller type {type_!r}; run as {other}"],
        True,
    )


def test_the_manager_loads_the_distros_parameters():
    parameters = {"state_publish_rate": 10.0}

    assert loaded_by_manager(JTC, **parameters, distro="humble")[1] == [
        "nothing to report"
    ]
    assert loaded_by_manager(JTC, **parameters)[1] == [
        "info: c.yaml:7: c.state_publish_rate: a parameter up to humble only, not of "
        "jazzy; it has no effect"
    ]


# Types of other packages, which nothing here stands for.
OF_OTHERS = {
    "robotiq_controllers/RobotiqActivationController",
    "kuka_controllers/EventBroadcaster",
    "epick_controllers/EpickGripperActionController",
    "epick_controllers/EpickStatusPublisherController",
}

# The parameters of one robot's controllers are in no file: its driver's launch file
# passes them.
WITHOUT_PARAMETERS = {
    "joint_trajectory_controller.joints: is required but missing",
    "gpio_controller.gpios: is required but missing",
}


def real_controllers() -> Iterator[tuple[str, ControllerConfig]]:
    """Yield every controller of the real robots, all files of a robot together."""
    root = robots_folder()
    index = yaml.safe_load((root / "INDEX.yaml").read_text(encoding="utf-8"))
    for robot in index["robots"]:
        files = [root / file for file in robot["controllers_yaml"] or ()]
        variables = {k: str(v) for k, v in (robot.get("launch_vars") or {}).items()}
        for controller in read_controllers(files, variables, LoadReport()).controllers:
            yield robot["name"], controller


@pytest.mark.slow
@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted", "rolling"])
def test_real_robots_have_their_controllers_parameters(distro):
    loaded = set()
    unknown = set()
    refused = set()
    for robot, controller in real_controllers():
        row = CONTROLLER_TYPES.get(controller.type)
        if row is None:
            unknown.add(controller.type)
            continue
        own = dict(controller.parameters)
        own.pop("update_rate", None)
        name, file = controller.name, controller.file
        schema, report = row.parameters, LoadReport()
        try:
            load_parameters(schema, own, name, file, report, distro=distro)
            loaded.add(controller.type)
        except ParameterError as error:
            refused.add((robot, f"{error.where}: {error.problem}"))

    assert unknown == OF_OTHERS
    assert refused == {("kuka_kr6_agilus", problem) for problem in WITHOUT_PARAMETERS}
    assert len(loaded) > 9
