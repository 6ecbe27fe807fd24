"""Replays the joint_trajectory_controller scenarios of upstream, as of jazzy 4.42.1.

Open loop: what a scenario measured and was sent goes into the tick; commands,
references, errors and the news of goals come out. In which tick a message arrives is
the scenario's; the order in which a client hears of two goals at once isn't compared.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest

from arm_drake import interfaces
from arm_drake.control.joint_trajectory import tick
from arm_drake.control.joint_trajectory_state import (
    JointTrajectoryRules,
    JointTrajectoryState,
    TickInputs,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.joint_trajectory_controller import (
    JointTrajectoryControllerParameters,
    _make_rules,
)
from arm_drake.description.parameters import Parameter, load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    CancelGoal,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    GoalEvent,
    GoalStatus,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryPoint,
    SendGoal,
    Time,
)
from tests.oracle import oracle_cases

Dict = dict[str, Any]

JAZZY = "jtc_scenarios_jazzy_4.42.1"
CASES: dict[str, Dict] = {c["input"]["name"]: c for c in oracle_cases("jtc_scenarios")}
DIFFERING = {
    case["name"]: case["output"] for case in oracle_cases(f"{JAZZY}_differing")
}
IDENTICAL = oracle_cases(f"{JAZZY}_identical")["identical_to_master"]

# Scenarios that aren't replayed, by what they need and this version doesn't have.
LEFT_OUT = {
    "commands other than positions": """
        action_p_posvel_lag action_p_pva_lag action_pv_posvel_lag action_pv_pva_lag
        action_pva_posvel_lag action_pva_pva_lag activation_lastcmd_then_traj_False
        cancel_decelerate_perfect_posvel configure_effort_needs_velocity_state
        configure_velocity_needs_velocity_state effort_cmd_gain_change effort_cmd_pid
        effort_cmd_pid_antiwindup_backcalc effort_cmd_pid_ff_effort
        effort_cmd_pid_iclamp_deadband effort_cmd_wraparound integration_a_pva
        integration_v integration_v_pva integration_v_then_p_pva integration_va
        integration_va_pva interpolation_none_pva jittered_period
        nonzero_end_velocity_allowed_posvel partial_allowed_velocity_cmd
        position_effort_cmd random_02 random_05 random_06 random_07 random_09 random_10
        random_11 random_13 random_14 random_17 random_18 random_19 random_22 random_26
        random_27 random_29 random_31 random_34 random_39 random_41 random_43 random_45
        random_46 random_49 random_50 random_51 random_54 random_57 random_59
        scaling_ignored_posvel stopped_velocity_tolerance_posvel
        stopped_velocity_tolerance_zero_disables topic_p_posvel_perfect
        topic_pv_posvel_perfect topic_pva_posvel_perfect
        topic_replace_topic_pva_repl_True upsampling_action_untouched
        upsampling_freq_0.0_timed upsampling_freq_0.0_untimed
        upsampling_freq_20.0_untimed velocity_cmd_ff_only velocity_cmd_pid
    """,
    "commands from before the activation": """
        hold_activation_lastcmd_True
    """,
    "deceleration on cancel": """
        abort_decelerate_path_tolerance cancel_decelerate
        cancel_decelerate_faster_than_urdf_limit cancel_decelerate_no_urdf_limit
    """,
    "several messages in one tick": """
        cancel_in_accept_cycle two_goals_same_cycle
    """,
    "speed scaling": """
        jittered_period_scaled replace_under_scaling_repl_False scaling_changes
        scaling_constant_0.0 scaling_constant_0.25 scaling_constant_0.5
        scaling_goal_time_tolerance scaling_initial_param scaling_state_interface
    """,
    "a joint named twice, refused here": """
        validate_duplicate_joint
    """,
    "parameters that change while it runs": """
        tolerance_param_change_during_goal tolerance_param_change_next_goal
    """,
    "the service query_state": """
        query_state
    """,
    "command_joints": """
        command_joints_subset configure_command_joints_not_subset
    """,
}

# Scenarios whose parameters upstream refuses.
REFUSED = {
    "configure_no_command": "scenario.yaml: jtc: command_interfaces must have at least "
    "one element",
    "configure_no_state": "scenario.yaml: jtc: state_interfaces must have at least one "
    "element",
}

REPLAYED = [
    name
    for name in CASES
    if name not in REFUSED and not any(name in row.split() for row in LEFT_OUT.values())
]

# Parameters of replayed scenarios that are unknown here: jazzy has no replacement, a
# deceleration needs decelerate_on_cancel, and nothing is commanded before activation.
UNKNOWN = {
    "allow_trajectory_replacement",
    "max_deceleration_on_cancel",
    "set_last_command_interface_value_as_state_on_activation",
}

# What a scenario's event needs, by its topic or its type.
NEEDED_BY_EVENT = {
    "speed_scaling_input": "speed scaling",
    "set_params": "parameters that change while it runs",
    "service": "the service query_state",
}
MESSAGES = ("joint_trajectory", "goal", "cancel")


def needed_feature(given: Dict) -> str | None:
    """Return what a scenario needs and this version doesn't have."""
    parameters = given["params"]
    if set(parameters["command_interfaces"]) - {"position"}:
        return "commands other than positions"
    if "command_joints" in parameters:
        return "command_joints"
    if "speed_scaling" in parameters:
        return "speed scaling"
    if parameters.get("constraints", {}).get("decelerate_on_cancel"):
        return "deceleration on cancel"
    if "initial_command" in given and parameters.get(
        "set_last_command_interface_value_as_state_on_activation", True
    ):
        return "commands from before the activation"
    kinds = [event.get("topic", event["type"]) for event in given["events"]]
    for kind in kinds:
        if kind not in (*MESSAGES, "plant"):
            return NEEDED_BY_EVENT.get(kind, kind)
    ticks = [
        event["cycle"]
        for event, kind in zip(given["events"], kinds, strict=True)
        if kind in MESSAGES
    ]
    if len(set(ticks)) < len(ticks):
        return "several messages in one tick"
    for event in given["events"]:
        message = event.get("msg") or event.get("goal", {}).get("trajectory", {})
        names = message.get("joint_names", [])
        if len(set(names)) < len(names):
            return "a joint named twice, refused here"
    return None


def flatten(parameters: Dict, prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def load(given: Dict, report: LoadReport) -> JointTrajectoryControllerParameters:
    file = Path("scenario.yaml")
    flat = {n: Parameter(value, file, 1) for n, value in flatten(given["params"])}
    schema = JointTrajectoryControllerParameters
    return load_parameters(schema, flat, "jtc", file, report)


def make_rules(given: Dict) -> JointTrajectoryRules:
    report = LoadReport()
    parameters = load(given, report)
    assert {entry.where.rpartition(".")[2] for entry in report} <= UNKNOWN
    robot = ElementTree.fromstring(given["urdf"])  # noqa: S314
    joint_types = {j.attrib["name"]: j.attrib["type"] for j in robot.iter("joint")}
    names = interfaces.interface_names(joint_types, interfaces.STATE_INTERFACES)
    params = ControllerInterfaceParams(
        controller_name="jtc",
        update_rate=given["update_rate"],
        period=1.0 / given["update_rate"],
        joint_types=joint_types,
        command_interfaces=frozenset(names),
        state_interfaces=frozenset(names),
        measured=names,
        initial_commands={},
    )
    return _make_rules(parameters, params)


def make_trajectory(message: Dict) -> JointTrajectory:
    header = Header(stamp=Time.of(message.get("header", {}).get("stamp", {})))
    points = [JointTrajectoryPoint(**point) for point in message["points"]]
    return JointTrajectory(header, message["joint_names"], points)


def make_goal(goal: Dict) -> SendGoal:
    path, end = (
        [JointTolerance(**tolerance) for tolerance in goal.get(field, ())]
        for field in ("path_tolerance", "goal_tolerance")
    )
    trajectory = make_trajectory(goal["trajectory"])
    late = goal.get("goal_time_tolerance", 0.0)
    return SendGoal(FollowJointTrajectoryGoal(trajectory, path, end, late))


def output_of(name: str) -> Dict:
    return DIFFERING.get(name, CASES[name]["output"])


class Replay(NamedTuple):
    # After every tick.
    states: list[JointTrajectoryState]

    # By the name that the scenario gives them.
    goals: Mapping[str, SendGoal]


@cache
def replay(name: str) -> Replay:
    given, output = CASES[name]["input"], output_of(name)
    rules = make_rules(given)
    measured = {}
    for interface in given["params"]["state_interfaces"]:
        names = [f"{joint}/{interface}" for joint in rules.allowed.joints]
        columns = [output["state_interfaces"].index(name) for name in names]
        measured[interface] = np.array(output["state"], float)[:, columns]
    goals: defaultdict[str, SendGoal] = defaultdict(
        lambda: SendGoal(FollowJointTrajectoryGoal())
    )
    state, topic, request = JointTrajectoryState(), None, None
    states = []
    last_ns = 0
    for k, time_ns in enumerate(output["t_ns"]):
        for event in given["events"]:
            if event["cycle"] != k:
                continue
            if event["type"] == "topic":
                topic = make_trajectory(event["msg"])
            elif event["type"] == "goal":
                request = goals[event["id"]] = make_goal(event["goal"])
            elif event["type"] == "cancel":
                request = CancelGoal(goals[event["id"]])
        inputs = TickInputs(
            time_ns,
            time_ns - last_ns,
            measured["position"][k],
            measured["velocity"][k] if "velocity" in measured else None,
            topic,
            request,
        )
        state = tick(rules, state, inputs)
        states.append(state)
        last_ns = time_ns
    return Replay(states, goals)


def assert_rows(name: str, actual: list[Any], expected: list[Any]) -> None:
    """Compare a column; one element stands for all rows."""
    if len(expected) == 1:
        expected = expected * len(actual)
    for k, (ours, theirs) in enumerate(zip(actual, expected, strict=True)):
        ours = [] if ours is None else ours
        np.testing.assert_allclose(
            ours, np.array(theirs, float), 1e-9, 1e-12, err_msg=f"{name} in row {k}"
        )


def news_of(goal: SendGoal, states: list[JointTrajectoryState]) -> list[Any]:
    """Return (row, event) of all that is said about a goal."""
    news = {}
    for k, state in enumerate(states):
        for number, event in state.events:
            if isinstance(event, GoalEvent) and event.request is goal:
                news.setdefault(number, (k, event))
    return list(news.values())


def summary(event: GoalEvent) -> tuple[Any, ...]:
    if event.feedback is not None:
        return ("feedback",)
    if event.result is None or event.status is GoalStatus.REJECTED:
        return (event.status.name.lower(),)
    result = event.result
    return (event.status.name.lower(), result.error_code, result.error_string)


def assert_feedback(
    feedback: FollowJointTrajectoryFeedback, row: Dict, *, has_index: bool
) -> None:
    """Compare feedback; jazzy itself always says index 0."""
    assert feedback.header.stamp.to_nanoseconds() == row["stamp_ns"]
    from_start_ns = feedback.desired.time_from_start.to_nanoseconds()
    assert from_start_ns == row["desired_time_from_start_ns"]
    if has_index:
        assert feedback.index == row["index"]
    for field in ("desired", "actual", "error"):
        assert_rows(field, [getattr(feedback, field).positions], [row[field]])


@pytest.mark.parametrize("name", REPLAYED)
def test_commands_and_references_are_upstream_s(name: str) -> None:
    output = output_of(name)

    states = replay(name).states

    seen = [state.snapshot for state in states]
    columns = {
        "reference_positions": [s.desired.position for s in seen],
        "reference_velocities": [s.desired.velocity for s in seen],
        "reference_accelerations": [s.desired.acceleration for s in seen],
        "reference_time_from_start_ns": [s.desired_from_start_ns for s in seen],
        "error_positions": [s.error for s in seen],
        "output_positions": [s.command for s in seen],
    }
    assert_rows("command", [s.commanded.positions for s in states], output["command"])
    for column, rows in columns.items():
        assert_rows(column, rows, output["controller_state"][column])


@pytest.mark.parametrize("name", REPLAYED)
def test_news_of_goals_are_upstream_s(name: str) -> None:
    output = output_of(name)
    times = output["t_ns"]

    states, goals = replay(name)

    # "accepted" always comes with "executing", and answers to a cancel request are
    # the action server's, not the controller's.
    theirs = [
        event
        for event in output["events"]
        if event["event"] not in ("accepted", "canceling", "cancel_rejected")
    ]
    assert {event["goal"] for event in theirs} <= set(goals)
    for goal_id, goal in goals.items():
        ours = news_of(goal, states)
        expected = [event for event in theirs if event["goal"] == goal_id]
        assert [(times[k], *summary(event)) for k, event in ours] == [
            (event["t_ns"], event["event"], *event.get("result", {}).values())
            for event in expected
        ]
        for (_, event), row in zip(ours, expected, strict=True):
            if event.feedback is not None:
                assert_feedback(event.feedback, row, has_index=name in IDENTICAL)


@pytest.mark.parametrize(("name", "message"), REFUSED.items())
def test_parameters_that_upstream_refuses_are_refused(name: str, message: str) -> None:
    last = CASES[name]["output"]["lifecycle"][-1]
    assert last[1:] != ["activate", "SUCCESS"]

    with pytest.raises(ParameterError) as error:
        load(CASES[name]["input"], LoadReport())

    assert str(error.value) == message


def test_every_scenario_is_replayed_or_left_out_for_a_reason() -> None:
    listed = {
        name: feature for feature, row in LEFT_OUT.items() for name in row.split()
    }

    needed = {name: needed_feature(case["input"]) for name, case in CASES.items()}

    assert listed == {name: feature for name, feature in needed.items() if feature}
    assert set(CASES) == {*REPLAYED, *REFUSED, *listed}


def test_the_output_of_jazzy_is_known_for_every_scenario() -> None:
    assert sorted([*DIFFERING, *IDENTICAL]) == sorted(CASES)
