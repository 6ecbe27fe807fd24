"""Motion files: what they say, or one message with the place."""

import contextlib
import itertools
import math
import re
from pathlib import Path

import pytest
import yaml

import arm_drake as ad
from arm_drake.description.entry import bundled_motions, bundled_robots
from arm_drake.description.joints import JointInfo, JointLimits, beyond_limits
from arm_drake.errors import ArmDrakeError, MotionError
from arm_drake.messages import (
    Duration,
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    GripperCommand,
    Header,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryPoint,
    SpeedScalingFactor,
    SwitchController,
    Time,
    Twist,
    Vector3,
)
from arm_drake.simulation.motion import (
    FollowThing,
    LimitWatch,
    Motion,
    MotionStep,
    PickThing,
    PlaceThing,
    PlanTo,
    SetPayloads,
    TopicMessage,
)
from arm_drake.simulation.motion_files import load_motion, parse_motion

POINT = "{positions: [1, 2.5], time_from_start: 2}"
TIME = "expected seconds or {sec: int, nanosec: int}"
KINDS = (
    "['cancel', 'cmd_vel', 'commands', 'commands_from_to', 'data', 'data_from_to', "
    "'follow', 'goal', 'gripper_command', 'payload', 'pick', 'place', 'plan_to', "
    "'speed_scaling', 'switch_controllers', "
    "'trajectory', 'trajectory_table']"
)
KEYS = (
    "at, cancel, cmd_vel, commands, commands_from_to, controller, count, data, "
    "data_from_to, every, follow, goal, gripper_command, payload, pick, "
    "ping_pong, place, plan_to, repeat, "
    "speed_scaling, switch_controllers, topic, topics, trajectory, trajectory_table"
)
RAMP = "every: 1, count: 3, controller: a, commands_from_to"
TOPICS = "every: 1, count: 3, topics: [/a, /b], data_from_to"


@pytest.fixture
def load(tmp_path):
    """Return a function: text of a motion file -> Motion."""

    def load_text(text: str | bytes) -> Motion:
        path = tmp_path / "motion.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_motion(path)

    return load_text


def goal(body: str) -> str:
    return f"- {{at: 0, controller: arm, goal: {body}}}"


def test_a_goal_has_the_fields_of_the_message(load, tmp_path):
    motion = load(
        "- at: 1.5\n"
        "  controller: arm\n"
        "  goal:\n"
        "    header: {stamp: {sec: 1, nanosec: 2}, frame_id: base}\n"
        "    joint_names: [a, b]\n"
        "    points:\n"
        "      - positions: [1, 2.5]\n"
        "        velocities: [0, 1e-1]\n"
        "        accelerations: [3, 4]\n"
        "        effort: [5, 6]\n"
        "        time_from_start: {sec: 2, nanosec: 500000000}\n"
        "    path_tolerance: [{name: a, position: 0.1}]\n"
        "    goal_tolerance: [{name: b, velocity: 1, acceleration: -1}]\n"
        "    goal_time_tolerance: 0.5\n"
    )

    point = JointTrajectoryPoint(
        (1.0, 2.5), (0.0, 0.1), (3.0, 4.0), (5.0, 6.0), Duration(2, 500_000_000)
    )
    message = FollowJointTrajectoryGoal(
        JointTrajectory(Header(Time(1, 2), "base"), ("a", "b"), (point,)),
        (JointTolerance("a", position=0.1),),
        (JointTolerance("b", velocity=1.0, acceleration=-1.0),),
        Duration(0, 500_000_000),
    )
    step = MotionStep(1.5, "arm", message, "[0].goal")
    assert motion == Motion(tmp_path / "motion.yaml", (step,))


def test_a_goal_may_nest_its_trajectory(load):
    flat = load(goal(f"{{joint_names: [a, b], points: [{POINT}]}}"))
    nested = load(goal(f"{{trajectory: {{joint_names: [a, b], points: [{POINT}]}}}}"))

    assert flat == nested


def test_a_trajectory_is_a_message_of_the_topic(load):
    motion = load(
        "- {controller: arm, trajectory: {joint_names: [a, b], points: ["
        + POINT
        + "]}}"
    )

    (step,) = motion.steps
    assert step.at == 0.0
    assert step.message == JointTrajectory(
        joint_names=("a", "b"),
        points=(JointTrajectoryPoint((1.0, 2.5), time_from_start=Duration(2)),),
    )


def test_cancel_has_no_message(load):
    (step,) = load("- {at: 1, controller: arm, cancel: true}").steps

    assert step == MotionStep(1.0, "arm", None, "[0].cancel")


def test_commands_are_the_values_of_the_step(load):
    (step,) = load("- {at: 1, controller: group, commands: [1, 2.5e-1]}").steps

    assert (step.at, step.controller, step.where) == (1.0, "group", "[0].commands")
    assert isinstance(step.message, Float64MultiArray)
    assert step.message.data == (1.0, 0.25)


def ramp(load, changes: str = "") -> list[tuple[float, tuple[float, ...]]]:
    """Return times and values of a ramp from 1, 2 to 4, -4 in four messages."""
    motion = load(
        "- {at: 1, every: 0.5, count: 4, controller: group, "
        f"commands_from_to: [[1, 2], [4, -4]]{changes}}}"
    )
    assert {step.where for step in motion.steps} == {"[0].commands_from_to"}
    return [(step.at, step.message.data) for step in motion.steps]


def test_a_ramp_goes_evenly_from_the_first_values_to_the_second(load):
    values = [(1.0, 2.0), (2.0, 0.0), (3.0, -2.0), (4.0, -4.0)]
    times = [1.0, 1.5, 2.0, 2.5]

    sent = ramp(load)

    assert [at for at, _ in sent] == times
    for (_, data), expected in zip(sent, values, strict=True):
        assert data == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_ramp_goes_back_in_as_many_messages(load):
    there = ramp(load)

    sent = ramp(load, ", ping_pong: true")

    # Each end is sent twice where a motion goes to and fro.
    assert sent[:4] == there
    assert [data for _, data in sent[4:]] == [data for _, data in reversed(there)]
    assert [at for at, _ in sent[4:]] == [3.0, 3.5, 4.0, 4.5]
    assert ramp(load, ", ping_pong: false") == there


def test_a_speed_scaling_is_a_factor(load):
    (step,) = load("- {at: 1, controller: arm, speed_scaling: 0}").steps

    assert (step.controller, step.where) == ("arm", "[0].speed_scaling")
    assert isinstance(step.message, SpeedScalingFactor)
    assert step.message.factor == 0.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{activate: [a], deactivate: [b, c]}", (("a",), ("b", "c"), "strict")),
        ("{activate: [a], strictness: best_effort}", (("a",), (), "best_effort")),
        ("{deactivate: [a], strictness: strict}", ((), ("a",), "strict")),
    ],
)
def test_a_switch_is_for_the_controller_manager(load, text, expected):
    (step,) = load(f"- {{at: 1, switch_controllers: {text}}}").steps

    assert (step.controller, step.where) == (None, "[0].switch_controllers")
    message = step.message
    assert isinstance(message, SwitchController)
    assert expected == (
        message.activate_controllers,
        message.deactivate_controllers,
        message.strictness,
    )


def test_a_velocity_of_a_base_is_sent_again_and_again(load):
    motion = load(
        "- {every: 0.1, count: 3, controller: b, cmd_vel: {linear: {x: 1}, "
        "angular: {z: -0.5}}}"
    )

    twist = Twist(Vector3(1.0), Vector3(0.0, 0.0, -0.5))
    assert [step.message for step in motion.steps] == [twist] * 3
    assert [step.at for step in motion.steps] == pytest.approx([0.0, 0.1, 0.2])


def test_a_topic_takes_the_fields_of_its_message(load):
    (step,) = load("- {topic: /b/cmd_vel, data: {twist: {linear: {x: 1}}}}").steps

    assert step.message == TopicMessage("/b/cmd_vel", {"twist": {"linear": {"x": 1}}})


def test_a_gripper_command_has_the_fields_of_the_message(load):
    (step,) = load("- {controller: g, gripper_command: {position: 1}}").steps
    (other,) = load(
        "- {controller: g, gripper_command: {position: -0.1, max_effort: 5}}"
    ).steps

    assert step == MotionStep(0.0, "g", GripperCommand(1.0), "[0].gripper_command")
    assert other.message == GripperCommand(-0.1, 5.0)


@pytest.mark.parametrize(
    ("text", "data"), [("-2", -2.0), ("2e-1", 0.2), ("[1, 2.5]", (1.0, 2.5))]
)
def test_data_is_for_a_topic(load, text, data):
    (step,) = load(f"- {{at: 1, topic: /a/cmd_pos, data: {text}}}").steps

    message = TopicMessage("/a/cmd_pos", data)
    assert step == MotionStep(1.0, None, message, "[0].data")


def test_a_trajectory_may_be_for_a_topic(load):
    body = "{header: {frame_id: base}, joint_names: [a, b], points: [" + POINT + "]}"

    motion = load(f"- {{at: 1, topic: /set_joint_trajectory, trajectory: {body}}}")

    (step,) = motion.steps
    point = JointTrajectoryPoint((1.0, 2.5), time_from_start=Duration(2))
    trajectory = JointTrajectory(Header(frame_id="base"), ("a", "b"), (point,))
    assert step.message == TopicMessage("/set_joint_trajectory", trajectory)
    assert motion.duration == 1.0 + 2.0


def test_a_ramp_of_data_has_a_value_for_each_topic(load):
    motion = load(
        "- {at: 1, every: 0.5, count: 3, topics: [/b, /a], "
        "data_from_to: [[0, 1], [2, -1]], ping_pong: true}"
    )

    sent = [(step.at, *step.message) for step in motion.steps]
    values = [(0.0, 1.0), (1.0, 0.0), (2.0, -1.0)]
    assert sent == [
        (1.0 + 0.5 * index, topic, value)
        for index, row in enumerate([*values, *reversed(values)])
        for topic, value in zip(("/b", "/a"), row, strict=True)
    ]
    assert {step.where for step in motion.steps} == {"[0].data_from_to"}


# The joints of the script and their end; they start at 0.
SCRIPT_END = (
    *(-1.345, -1.23, 0.264, -0.296, 0.389, -1.5),
    *(-0.7, -0.7, 0.7, 0.7, 0.7, -0.7),
)


def test_a_motion_of_a_few_lines_is_the_tutorials_script(load):
    topics = [f"/model/arm/joint/j{index}/cmd_pos" for index in range(12)]
    motion = load(
        f"- {{every: 0.05, count: 52, topics: {topics}, ping_pong: true,\n"
        f"   data_from_to: [{[0.0] * 12}, {list(SCRIPT_END)}]}}\n"
        "- {repeat: true}\n"
    )

    # A timer of 0.05 s, 52 poses to and fro for ever, each end twice: 104 ticks.
    sent = itertools.islice(motion.timeline(), 12 * 3 * 104)
    for count, (at, step) in enumerate(sent):
        tick, joint = divmod(count, 12)
        pose = tick % 104 if tick % 104 < 52 else 103 - tick % 104
        # Times are sums of rounded numbers, below 16 s.
        assert at == pytest.approx(tick * 0.05, rel=0.0, abs=4 * math.ulp(8.0))
        topic, value = step.message
        assert topic == topics[joint]
        # Two roundings in each of the two ways to compute it.
        assert value == pytest.approx(SCRIPT_END[joint] * pose / 51, rel=2**-51, abs=0)
    assert motion.duration == pytest.approx(5.2, rel=1e-15)


def test_a_motion_repeats_after_a_further_period_or_its_last_trajectory(load):
    points = f"{{joint_names: [a, b], points: [{POINT}]}}"
    short = "- {at: 1, every: 1, count: 2, controller: a, commands: [1]}\n"
    long = f"- {{at: 0.5, controller: a, trajectory: {points}}}\n"
    repeat = "- {repeat: true}"

    def times(text: str) -> list[float]:
        timeline = load(text + repeat).timeline()
        return [at for at, _ in itertools.islice(timeline, 5)]

    assert times(short) == [1.0, 2.0, 4.0, 5.0, 7.0]
    assert times(long) == [0.5, 3.0, 5.5, 8.0, 10.5]
    assert load(short + repeat).duration == 3.0
    # Without the last item nothing is repeated.
    assert [at for at, _ in load(short).timeline()] == [1.0, 2.0]
    assert load(short).duration == 2.0


def test_the_motions_of_the_docs_can_be_read():
    docs = Path(__file__).parents[2] / "docs/motions.md"
    blocks = re.findall(
        r"^(?:```|~~~)yaml\n(.*?)^(?:```|~~~)$",
        docs.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )

    motions = [parse_motion(yaml.safe_load(text)) for text in blocks]

    kinds = {type(step.message) for motion in motions for step in motion.steps}
    assert kinds == {
        FollowJointTrajectoryGoal,
        JointTrajectory,
        GripperCommand,
        SetPayloads,
        Float64MultiArray,
        SpeedScalingFactor,
        SwitchController,
        FollowThing,
        PickThing,
        PlaceThing,
        PlanTo,
        TopicMessage,
        Twist,
        type(None),
    }


def test_a_step_is_repeated_every_so_often(load):
    motion = load("- {at: 1, every: 0.5, count: 3, controller: arm, cancel: true}")

    assert [step.at for step in motion.steps] == [1.0, 1.5, 2.0]


def test_steps_are_sorted_by_time_and_keep_their_order_at_one_time(load):
    motion = load(
        "- {at: 2, controller: a, cancel: true}\n"
        "- {at: 1, controller: b, cancel: true}\n"
        "- {at: {sec: 2, nanosec: 0}, controller: c, cancel: true}\n"
    )

    assert [step.controller for step in motion.steps] == ["b", "a", "c"]


def test_the_duration_is_the_end_of_the_last_trajectory(load):
    points = f"{{joint_names: [a, b], points: [{POINT}]}}"

    motion = load(
        f"- {{at: 3, controller: arm, goal: {points}}}\n"
        f"- {{at: 1, controller: arm, trajectory: {points}}}\n"
        "- {at: 4.5, controller: arm, cancel: true}\n"
    )

    assert motion.duration == 3.0 + 2.0


def test_the_duration_counts_all_messages_of_a_step(load):
    other = "- {at: 3.5, switch_controllers: {activate: [a]}}\n"
    step = "{at: 1, every: 0.5, count: 4, controller: a, "

    assert load(other).duration == 3.5
    assert load(f"- {step} commands: [1]}}").duration == 2.5
    there = f"- {step} commands_from_to: [[0], [1]]}}"
    assert load(there).duration == 2.5
    assert load(there.replace("}", ", ping_pong: true}")).duration == 4.5
    assert load("- {at: 2, controller: a, speed_scaling: 0.5}").duration == 2.0


@pytest.mark.parametrize(
    ("factors", "duration"),
    [
        # The trajectory starts after 1 s and takes 2 s.
        ([(0.0, 0.5)], 1.0 + 4.0),
        ([(0.0, 2.0)], 1.0 + 1.0),
        ([(2.0, 0.5)], 2.0 + 2.0),
        ([(2.0, 0.0), (3.0, 1.0)], 3.0 + 1.0),
        ([(1.0, 0.5), (2.0, 1.0)], 2.0 + 1.5),
        ([(3.5, 0.5)], 3.5),
        ([(2.0, 0.0)], 2.0),
    ],
)
def test_the_duration_counts_the_speed_of_trajectories(load, factors, duration):
    points = f"{{joint_names: [a, b], points: [{POINT}]}}"
    scalings = "".join(
        f"- {{at: {at}, controller: arm, speed_scaling: {factor}}}\n"
        for at, factor in factors
    )

    motion = load(f"{scalings}- {{at: 1, controller: arm, goal: {points}}}\n")
    other = load(f"{scalings}- {{at: 1, controller: leg, goal: {points}}}\n")

    assert motion.duration == duration
    assert other.duration == max(3.0, *(at for at, _ in factors), 0.0)


def test_a_motion_without_steps_takes_no_time(load):
    assert load("[]").duration == 0.0


def test_a_goal_without_points_or_with_a_negative_time_takes_no_time(load):
    assert load(goal("{}")).duration == 0.0
    assert load(goal("{points: [{time_from_start: -1}]}")).duration == 0.0


def test_a_list_in_python_is_a_motion_too():
    motion = parse_motion([{"at": 1, "controller": "arm", "cancel": True}])

    assert motion.file is None
    assert motion.steps[0].at == 1.0


def test_an_error_of_a_list_in_python_has_no_file():
    with pytest.raises(MotionError) as caught:
        parse_motion([5])

    assert str(caught.value) == "[0]: expected a mapping, got 5"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty; expected a list of steps"),
        ("hello", "expected a list of steps, got str"),
        (
            "- {at: 0, controller: a, cancel: true}\n- 5",
            "[1]: expected a mapping, got 5",
        ),
        (
            "- {controller: a, gaol: {}}",
            f"[0]: unknown key 'gaol'; did you mean 'goal'? known: {KEYS}",
        ),
        (
            "- {1: 2}",
            f"[0]: unknown key 1; known: {KEYS}",
        ),
        (
            "- {controller: a}",
            f"[0]: expected one of {KINDS}, got []",
        ),
        (
            "- {controller: a, cancel: true, goal: {}}",
            f"[0]: expected one of {KINDS}, got ['goal', 'cancel']",
        ),
        ("- {cancel: true}", "[0].controller: expected a name, got None"),
        ("- {controller: 5, cancel: true}", "[0].controller: expected a name, got 5"),
        ("- {controller: a, cancel: 1}", "[0].cancel: expected true, got 1"),
        (
            "- {at: -0.5, controller: a, cancel: true}",
            "[0].at: expected at least 0 s, got -0.5",
        ),
        ("- {at: .nan, controller: a, cancel: true}", f"[0].at: {TIME}, got nan"),
        ("- {at: '1', controller: a, cancel: true}", f"[0].at: {TIME}, got '1'"),
        ("- {at: true, controller: a, cancel: true}", f"[0].at: {TIME}, got True"),
        (
            "- {at: 1e308, controller: a, cancel: true}",
            "[0].at: expected -2147483648 s to 2147483647 s, got 1e+308",
        ),
        (
            "- {every: 1, controller: a, cancel: true}",
            "[0].count: expected an integer from 1 to 100000, got None",
        ),
        (
            "- {every: 1, count: 0, controller: a, cancel: true}",
            "[0].count: expected an integer from 1 to 100000, got 0",
        ),
        (
            "- {every: 1, count: 1.0, controller: a, cancel: true}",
            "[0].count: expected an integer from 1 to 100000, got 1.0",
        ),
        (
            "- {every: 1, count: 1000000000000, controller: a, cancel: true}",
            "[0].count: expected an integer from 1 to 100000, got 1000000000000",
        ),
        (
            "- {every: 0, count: 2, controller: a, cancel: true}",
            "[0].every: expected a positive number of seconds, got 0",
        ),
        (
            "- {count: 2, controller: a, cancel: true}",
            f"[0].every: {TIME}, got None",
        ),
        (
            "- {controller: a, commands: 1}",
            "[0].commands: expected a list, got 1",
        ),
        (
            "- {controller: a, commands: [1, .nan]}",
            "[0].commands[1]: expected a finite number, got nan",
        ),
        (
            "- {controller: a, commands: ['1']}",
            "[0].commands[0]: expected a finite number, got '1'",
        ),
        (
            f"- {{controller: a, commands: [{'9' * 400}]}}",
            "[0].commands[0]: the number is out of range",
        ),
        ("- {commands: [1]}", "[0].controller: expected a name, got None"),
        (
            "- {controller: a, commands: [1], ping_pong: true}",
            "[0].ping_pong: only commands_from_to and data_from_to have it",
        ),
        (
            f"- {{{RAMP}: [[1]]}}",
            "[0].commands_from_to: expected two lists of values, got 1",
        ),
        (
            f"- {{{RAMP}: [1, 2]}}",
            "[0].commands_from_to[0]: expected a list, got 1",
        ),
        (
            f"- {{{RAMP}: [[1], [1, 2]]}}",
            "[0].commands_from_to[1]: expected as many values as in the first list, "
            "1, got 2",
        ),
        (
            f"- {{{RAMP}: [[1], [.inf]]}}",
            "[0].commands_from_to[1][0]: expected a finite number, got inf",
        ),
        (
            f"- {{{RAMP}: [[1], [2]], ping_pong: 1}}",
            "[0].ping_pong: expected true or false, got 1",
        ),
        (
            "- {controller: a, commands_from_to: [[1], [2]]}",
            "[0].count: expected an integer from 2 to 100000, got None",
        ),
        (
            "- {every: 1, count: 1, controller: a, commands_from_to: [[1], [2]]}",
            "[0].count: expected an integer from 2 to 100000, got 1",
        ),
        (
            "- {count: 2, controller: a, commands_from_to: [[1], [2]]}",
            f"[0].every: {TIME}, got None",
        ),
        (
            "- {controller: a, speed_scaling: fast}",
            "[0].speed_scaling: expected a finite number, got 'fast'",
        ),
        (
            "- {controller: a, speed_scaling: -0.5}",
            "[0].speed_scaling: expected at least 0, got -0.5",
        ),
        (
            "- {controller: a, speed_scaling: .inf}",
            "[0].speed_scaling: expected a finite number, got inf",
        ),
        ("- {speed_scaling: 1}", "[0].controller: expected a name, got None"),
        (
            "- {switch_controllers: [a]}",
            "[0].switch_controllers: expected a mapping, got ['a']",
        ),
        (
            "- {switch_controllers: {}}",
            "[0].switch_controllers: expected controllers to activate or to "
            "deactivate, got none",
        ),
        (
            "- {switch_controllers: {begin: [a]}}",
            "[0].switch_controllers: unknown key 'begin'; known: activate, "
            "deactivate, strictness",
        ),
        (
            "- {switch_controllers: {activate: a}}",
            "[0].switch_controllers.activate: expected a list, got 'a'",
        ),
        (
            "- {switch_controllers: {deactivate: [1]}}",
            "[0].switch_controllers.deactivate: expected names, got 1",
        ),
        (
            "- {switch_controllers: {activate: [a], strictness: stric}}",
            "[0].switch_controllers.strictness: unknown strictness 'stric'; did you "
            "mean 'strict'? known: best_effort, strict",
        ),
        (
            "- {switch_controllers: {activate: [a], strictness: [strict]}}",
            "[0].switch_controllers.strictness: unknown strictness ['strict']; did "
            "you mean 'strict'? known: best_effort, strict",
        ),
        (
            "- {controller: a, switch_controllers: {activate: [a]}}",
            "[0].controller: switch_controllers is for no controller or topic; leave "
            "it out",
        ),
        (
            "- {controller: b, cmd_vel: 0.1}",
            "[0].cmd_vel: expected a mapping, got 0.1",
        ),
        (
            "- {controller: b, cmd_vel: {forwards: 0.1}}",
            "[0].cmd_vel: unknown key 'forwards'; known: angular, linear",
        ),
        (
            "- {controller: b, cmd_vel: {linear: {x: fast}}}",
            "[0].cmd_vel.linear.x: expected a finite number, got 'fast'",
        ),
        (
            "- {controller: g, gripper_command: 0.1}",
            "[0].gripper_command: expected a mapping, got 0.1",
        ),
        (
            "- {controller: g, gripper_command: {max_effort: 1}}",
            "[0].gripper_command: expected a position",
        ),
        (
            "- {controller: g, gripper_command: {position: .nan}}",
            "[0].gripper_command.position: expected a finite number, got nan",
        ),
        (
            "- {controller: g, gripper_command: {position: 1, effort: 2}}",
            "[0].gripper_command: unknown key 'effort'; did you mean 'max_effort'? "
            "known: max_effort, position",
        ),
        ("- {data: 1}", "[0].topic: expected a name, got None"),
        ("- {topic: 5, data: 1}", "[0].topic: expected a name, got 5"),
        ("- {topic: /a, data: x}", "[0].data: expected a finite number, got 'x'"),
        (
            "- {topic: /a, data: [1, true]}",
            "[0].data[1]: expected a finite number, got True",
        ),
        (
            "- {controller: a, data: 1}",
            "[0].controller: data goes with topic; leave it out",
        ),
        (
            "- {topic: /a, commands: [1]}",
            "[0].topic: commands goes with controller; leave it out",
        ),
        (
            "- {topics: [/a], trajectory: {}}",
            "[0].topics: trajectory goes with controller or topic; leave it out",
        ),
        (
            "- {topic: /a, controller: a, trajectory: {}}",
            "[0].topic: the step is for a controller already; leave it out",
        ),
        (
            "- {topic: /a, switch_controllers: {activate: [a]}}",
            "[0].topic: switch_controllers is for no controller or topic; leave it out",
        ),
        (
            "- {topic: /a, trajectory: 5}",
            "[0].trajectory: expected a mapping, got 5",
        ),
        (
            "- {every: 1, count: 3, data_from_to: [[1], [2]]}",
            "[0].topics: expected a list, got None",
        ),
        (
            "- {every: 1, count: 3, topics: [], data_from_to: [[], []]}",
            "[0].topics: expected at least one name",
        ),
        (
            f"- {{{TOPICS}: [[1], [2]]}}",
            "[0].data_from_to[0]: expected a value for each of 2 topics, got 1",
        ),
        (
            f"- {{{TOPICS}: [[1, 2], [2]]}}",
            "[0].data_from_to[1]: expected as many values as in the first list, "
            "2, got 1",
        ),
        (
            "- {controller: a, cancel: true}\n- {repeat: 1}",
            "[1].repeat: expected true, got 1",
        ),
        (
            "- {every: 1, count: 1, controller: a, cancel: true}\n"
            "- {repeat: true, count: 3}",
            "[1]: unknown key 'count'; known: repeat",
        ),
        (
            "- {repeat: true}\n- {controller: a, cancel: true}",
            "[0].repeat: it is the last item of a motion",
        ),
        (
            "- {controller: a, cancel: true}\n- {repeat: true}",
            "[1].repeat: a round takes no time; `every` and `count` of a step give it "
            "some",
        ),
        (
            "- {every: 1, controller: a, trajectory_tables: a.csv}",
            f"[0]: unknown key 'trajectory_tables'; did you mean 'trajectory_table'? "
            f"known: {KEYS}",
        ),
        (goal("5"), "[0].goal: expected a mapping, got 5"),
        (
            goal("{point: []}"),
            "[0].goal: unknown key 'point'; did you mean 'points'? "
            "known: header, joint_names, points",
        ),
        (goal("{trajectory: {}, points: []}"), "[0].goal: unknown key 'points'"),
        (goal("{trajectory: 5}"), "[0].goal: expected a mapping, got 5"),
        (goal("{joint_names: a}"), "[0].goal.joint_names: expected a list, got 'a'"),
        (goal("{joint_names: [1]}"), "[0].goal.joint_names: expected names, got 1"),
        (goal("{points: {}}"), "[0].goal.points: expected a list, got {}"),
        (goal("{points: [5]}"), "[0].goal.points[0]: expected a mapping, got 5"),
        (
            goal("{points: [{position: [1]}]}"),
            "[0].goal.points[0]: unknown key 'position'; did you mean 'positions'? "
            "known: accelerations, effort, positions, time_from_start, velocities",
        ),
        (
            goal("{points: [{positions: 1}]}"),
            "[0].goal.points[0].positions: expected a list, got 1",
        ),
        (
            goal("{points: [{positions: [0]}, {velocities: [0, '1']}]}"),
            "[0].goal.points[1].velocities[1]: expected a finite number, got '1'",
        ),
        (
            goal("{points: [{accelerations: [true]}]}"),
            "[0].goal.points[0].accelerations[0]: expected a finite number, got True",
        ),
        (
            goal("{points: [{effort: [null]}]}"),
            "[0].goal.points[0].effort[0]: expected a finite number, got None",
        ),
        (
            goal("{points: [{positions: [.nan]}]}"),
            "[0].goal.points[0].positions[0]: expected a finite number, got nan",
        ),
        (
            goal("{points: [{positions: [-.inf]}]}"),
            "[0].goal.points[0].positions[0]: expected a finite number, got -inf",
        ),
        (
            goal("{points: [{time_from_start: soon}]}"),
            f"[0].goal.points[0].time_from_start: {TIME}, got 'soon'",
        ),
        (
            goal("{points: [{time_from_start: {sec: 1, nsec: 2}}]}"),
            f"[0].goal.points[0].time_from_start: {TIME}, got {{'sec': 1, 'nsec': 2}}",
        ),
        (
            goal("{path_tolerance: {}}"),
            "[0].goal.path_tolerance: expected a list, got {}",
        ),
        (
            goal("{goal_tolerance: [a]}"),
            "[0].goal.goal_tolerance[0]: expected a mapping, got 'a'",
        ),
        (
            goal("{goal_tolerance: [{nam: a}]}"),
            "[0].goal.goal_tolerance[0]: unknown key 'nam'; did you mean 'name'? "
            "known: acceleration, name, position, velocity",
        ),
        (
            goal("{path_tolerance: [{name: a, position: '1'}]}"),
            "[0].goal.path_tolerance[0].position: expected a finite number, got '1'",
        ),
        (
            goal("{goal_time_tolerance: x}"),
            f"[0].goal.goal_time_tolerance: {TIME}, got 'x'",
        ),
        (goal("{header: 5}"), "[0].goal.header: expected a mapping, got 5"),
        (goal("{header: {stamp: x}}"), f"[0].goal.header.stamp: {TIME}, got 'x'"),
    ],
)
def test_a_malformed_motion_is_one_located_message(load, tmp_path, text, message):
    with pytest.raises(MotionError) as caught:
        load(text)

    # Each step is on a line of its own.
    step = re.match(r"\[(\d+)\]", message)
    line = f":{int(step[1]) + 1}" if step else ""
    assert str(caught.value) == f"{tmp_path / 'motion.yaml'}{line}: {message}"


@pytest.mark.parametrize(
    ("rest", "line"),
    [
        ("points: [{positions: [0, .nan]}]", 8),
        ("points:\n    - positions: [0]\n    - positions: [a]", 10),
        ("points:\n    - positions: [0]\n      position: 1", 10),
        ("points:\n    - positions: [0]\n      time_from_start: soon", 10),
        ("points: []\n    header: 1", 9),
        ("points: []\n    more: 1", 9),
        ("points: []\n    path_tolerance:\n    - {name: a}\n    - {nam: b}", 11),
    ],
)
def test_a_message_names_the_line_of_what_is_wrong(load, rest, line):
    with pytest.raises(MotionError) as caught:
        load(
            "parameters:\n"
            "  end: 1\n"
            "steps:\n"
            "- {controller: a, cancel: true}\n"
            "- controller: a\n"
            "  goal:\n"
            "    joint_names: [a, b]\n"
            f"    {rest}\n"
        )

    assert caught.value.line == line


def test_a_step_knows_its_line(load, tmp_path):
    motion = load("- {controller: a, cancel: true}\n- controller: a\n  cancel: true\n")

    lines = [step.line for step in motion.steps]
    assert lines == [1, 3]
    place = f"{tmp_path / 'motion.yaml'}:3: [1].cancel"
    assert motion.place(motion.steps[1]) == place


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "- {at: 1\n- {",
            ":2: malformed YAML: expected ',' or '}', but got '{'",
        ),
        ("- &a [*a]", ":1: malformed YAML: the value contains itself"),
        ("- {[1]: 2}", ":1: malformed YAML: found unhashable key"),
        ("- at: 1\n  cancel: true\n  at: 2", ":3: the key 'at' stands twice"),
        (b"\xff", ": can't be read: it is not UTF-8 text"),
        ("\na: 1", ":2: unknown key 'a'; known: needs, parameters, steps"),
    ],
)
def test_a_text_that_is_no_yaml_is_one_located_message(load, tmp_path, text, message):
    with pytest.raises(MotionError) as caught:
        load(text)

    assert str(caught.value) == f"{tmp_path / 'motion.yaml'}{message}"


@pytest.mark.parametrize("name", ["motions", "motions.d"])
def test_a_folder_is_an_error(tmp_path, name):
    path = tmp_path / name
    path.mkdir()

    with pytest.raises(MotionError) as caught:
        load_motion(path)

    text = "is a folder; expected the YAML file of a motion"
    assert str(caught.value) == f"{path}: {text}"


def test_a_missing_file_is_an_error(tmp_path):
    path = tmp_path / "motion.yaml"

    with pytest.raises(MotionError) as caught:
        load_motion(path)

    assert str(caught.value) == f"{path}: can't be read: No such file or directory"


def test_a_robot_that_is_none_is_said():
    text = "expected a robot of load_robot('doosan_a0912'), got str"

    with pytest.raises(ArmDrakeError) as caught:
        load_motion("tutorial", robot="doosan_a0912")

    assert str(caught.value) == text


def bundled() -> list[Path]:
    return [
        path for robot in bundled_robots() for path in bundled_motions(robot).values()
    ]


@pytest.mark.slow
@pytest.mark.parametrize("path", bundled(), ids=lambda path: path.stem)
def test_a_damaged_motion_file_gives_no_other_error(path, load):
    content = path.read_bytes()
    lines = content.splitlines(keepends=True)
    damaged = [content[: len(content) * part // 40] for part in range(40)]
    # Of a long one, whose steps are alike, lines all over it.
    without = range(0, len(lines), 1 + len(lines) // 60)
    damaged += [b"".join(lines[:i] + lines[i + 1 :]) for i in without]
    damaged += [content.replace(b"0.0", text) for text in (b"x", b"[", b".nan", b"")]
    damaged += [content.replace(b"[", b"{"), content.replace(b": ", b" ")]
    damaged += [content[:300] + bytes(range(20)) + content[300:]]

    for text in damaged:
        with contextlib.suppress(ArmDrakeError):
            load(text)


def test_a_last_step_without_time_can_t_be_repeated():
    steps = [
        {"at": 0.0, "controller": "c", "commands": [0.0]},
        {"at": 2.0, "controller": "c", "commands": [0.5]},
        {"repeat": True},
    ]

    with pytest.raises(MotionError, match=r"\[2\]\.repeat: the next round starts with"):
        parse_motion(steps)


@pytest.mark.slow
def test_a_round_that_is_shorter_than_a_tick_is_refused():
    steps = [
        {"at": 0.0, "every": 1e-6, "count": 1, "controller": "c", "commands": [0.0]},
        {"repeat": True},
    ]
    motion = parse_motion(steps)
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))

    with pytest.raises(MotionError, match="shorter than a tick"):
        sim.run(1.0, motion)


@pytest.mark.parametrize("by_topic", [False, True])
def test_a_duration_heeds_speeds_by_topic_and_by_controller(by_topic):
    points = [{"positions": [1.0], "time_from_start": 1.0}]
    trajectory = {"joint_names": ["j"], "points": points}
    speed = {"at": 0.0, "topic": "/c/speed_scaling_input", "data": 0.5}
    if not by_topic:
        speed = {"at": 0.0, "controller": "c", "speed_scaling": 0.5}

    by_name = parse_motion(
        [speed, {"at": 0.2, "controller": "c", "trajectory": trajectory}]
    )
    topic = "/c/joint_trajectory"
    named = parse_motion([speed, {"at": 0.2, "topic": topic, "trajectory": trajectory}])

    assert by_name.duration == named.duration == pytest.approx(2.2)


def test_positions_beyond_the_limits_are_listed_once_with_their_place():
    limits = JointLimits(lower=-3.14, upper=3.14)
    joints = [JointInfo(name, "revolute", "a", "b", limits) for name in ("pan", "lift")]
    joints.append(JointInfo("slide", "prismatic", "a", "b", limits))
    joints.append(JointInfo("spin", "continuous", "a", "b"))

    def problems(**positions):
        return [line for _, line in beyond_limits(joints, positions)]

    outside = "is outside [-3.14, 3.14]"
    assert problems(pan=3.1405, lift=-3.1405, spin=45.0, other=45.0) == []
    assert problems(pan=45.0, lift=0.0) == [f"pan 45 {outside}; in degrees?"]
    assert problems(pan=45.0, slide=45.0)[1:] == [f"slide 45 {outside}"]
    # No degrees: not whole, or still beyond the limits.
    assert problems(pan=45.5, lift=30.0) == [
        f"pan 45.5 {outside}",
        f"lift 30 {outside}",
    ]
    assert problems(pan=360.0) == [f"pan 360 {outside}"]


def test_speeds_beyond_the_limits_are_those_of_points_and_of_the_ways_between():
    limits = JointLimits(lower=-3.14, upper=3.14, velocity=2.0)
    joints = [JointInfo("pan", "revolute", "a", "b", limits)]
    joints.append(JointInfo("slide", "prismatic", "a", "b", limits))
    joints.append(JointInfo("spin", "continuous", "a", "b", limits))

    def problems(*points, **start):
        names = ("pan", "slide", "spin")
        made = [
            JointTrajectoryPoint(positions, velocities, time_from_start=time)
            for time, positions, *rest in points
            for velocities in (rest[0] if rest else (),)
        ]
        trajectory = JointTrajectory(joint_names=names, points=made)
        return list(LimitWatch(joints).find(trajectory, start))

    assert problems((1.0, (2.0, 0.0, 0.0)), (2.0, (0.0, 2.0, 0.0)), pan=0.0) == []
    assert problems((1.0, (3.0, 0.0, 0.0)), (2.0, (0.5, 0.0, 0.0)), pan=0.0) == [
        (0, "pan", "pan would move at 3 rad/s, its limit is 2 rad/s"),
        (1, "pan", "pan would move at 2.5 rad/s, its limit is 2 rad/s"),
    ]
    # Where it starts isn't known, and an endless joint may take the shorter way.
    assert problems((1.0, (3.0, 3.0, 3.0)), (2.0, (3.0, 3.0, -3.0))) == []
    assert problems((1.0, (0.0, 0.0, 0.0), (0.0, -4.0, 0.0))) == [
        (0, "slide", "slide would move at 4 m/s, its limit is 2 m/s"),
    ]
