"""Messages: the fields of ROS, frozen, and copied as themselves."""

import copy
import dataclasses as dc
import math
import pickle

import numpy as np
import pytest

from arm_drake.messages import (
    CancelGoal,
    Duration,
    Float64,
    Float64MultiArray,
    FollowJointTrajectoryErrorCode,
    FollowJointTrajectoryGoal,
    GoalStatus,
    Header,
    JointState,
    JointTolerance,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    MultiDOFCommand,
    SendGoal,
    SpeedScalingFactor,
    SwitchController,
    Time,
)
from arm_drake.messages.base import Message, make_lazy, renew, ros_type

TIME = "expected seconds or {sec: int, nanosec: int}"


@pytest.mark.parametrize(
    ("value", "sec", "nanosec"),
    [
        (0, 0, 0),
        (1.5, 1, 500_000_000),
        (0.1, 0, 100_000_000),
        # As in builtin_interfaces: nanosec is never negative.
        (-0.25, -1, 750_000_000),
        (1e-10, 0, 0),
        (np.float64(2.0), 2, 0),
        (np.int64(2), 2, 0),
        ({"sec": 2, "nanosec": 3}, 2, 3),
        ({"sec": 2}, 2, 0),
        ({"nanosec": 1_500_000_000}, 1, 500_000_000),
        (Time(2, 3), 2, 3),
        (Duration(2, 3), 2, 3),
    ],
)
@pytest.mark.parametrize("kind", [Time, Duration])
def test_a_time_is_made_of_what_stands_for_one(kind, value, sec, nanosec):
    time = kind.of(value)

    assert type(time) is kind
    assert (time.sec, time.nanosec) == (sec, nanosec)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("1", "'1'"),
        (None, "None"),
        (True, "True"),
        (math.nan, "nan"),
        (math.inf, "inf"),
        ([1], "[1]"),
        ({"sec": 1.0}, "{'sec': 1.0}"),
        ({"sec": True}, "{'sec': True}"),
        ({"secs": 1}, "{'secs': 1}"),
    ],
)
def test_anything_else_is_no_time(value, shown):
    with pytest.raises(ValueError, match="expected seconds") as caught:
        Duration.of(value)

    assert str(caught.value) == f"{TIME}, got {shown}"


LIMITS = "expected -2147483648 s to 2147483647 s"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (2.0**31, f"{LIMITS}, got 2147483648.0"),
        (-(2.0**31) - 1.0, f"{LIMITS}, got -2147483649.0"),
        (1e300, f"{LIMITS}, got 1e+300"),
        (10**309, f"{LIMITS}, got {10**309}"),
        (
            {"sec": 2**31},
            "sec: expected an integer from -2147483648 to 2147483647, got 2147483648",
        ),
        (
            {"nanosec": -1},
            "nanosec: expected an integer from 0 to 4294967295, got -1",
        ),
        (
            {"nanosec": 2**32},
            "nanosec: expected an integer from 0 to 4294967295, got 4294967296",
        ),
    ],
)
@pytest.mark.parametrize("kind", [Time, Duration])
def test_a_time_has_the_range_of_builtin_interfaces(kind, value, message):
    with pytest.raises(ValueError, match="expected") as caught:
        kind.of(value)

    assert str(caught.value) == message


@pytest.mark.parametrize("seconds", [-(2**31), 2**31 - 1])
def test_the_ends_of_the_range_are_times(seconds):
    assert Time.of(seconds) == Time(seconds) == Time.of({"sec": seconds})


def test_the_difference_of_two_times_may_exceed_the_range():
    most, least = Time(2**31 - 1), Time(-(2**31))

    difference = most.to_nanoseconds() - least.to_nanoseconds()

    assert Duration.from_nanoseconds(difference).to_seconds() == 2**32 - 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Time(2**31),
            "sec: expected an integer from -2147483648 to 2147483647, got 2147483648",
        ),
        (
            lambda: Duration(0, -1),
            "nanosec: expected an integer from 0 to 4294967295, got -1",
        ),
        (lambda: Time(1.5), "sec: expected an integer, got 1.5"),
        (lambda: Time(0, True), "nanosec: expected an integer, got True"),
        (
            lambda: Time.from_nanoseconds(1.5),
            "nanoseconds: expected an integer, got 1.5",
        ),
        (
            lambda: Time.from_nanoseconds(2**63),
            "nanoseconds: expected an integer of 64 bits, got 9223372036854775808",
        ),
        (lambda: Header("now"), f"stamp: {TIME}, got 'now'"),
        (lambda: Header(frame_id=1), "frame_id: expected a string, got 1"),
        (
            lambda: JointTrajectoryPoint(time_from_start=1e300),
            f"time_from_start: {LIMITS}, got 1e+300",
        ),
        (
            lambda: JointTrajectoryPoint(time_from_start=None),
            f"time_from_start: {TIME}, got None",
        ),
        (
            lambda: JointTrajectory(header=None),
            "header: expected a Header, got None; or a mapping of its fields",
        ),
        (
            lambda: JointTrajectory(joint_names="j1"),
            "joint_names: expected names, got 'j1'",
        ),
        (
            lambda: JointTrajectory(joint_names=[1]),
            "joint_names: expected names, got [1]",
        ),
        (
            lambda: JointTrajectory(joint_names=None),
            "joint_names: expected names, got None",
        ),
        (
            lambda: JointTrajectory(points=[JointTrajectoryPoint(), 3]),
            "points[1]: expected a JointTrajectoryPoint, got 3",
        ),
        (
            lambda: JointTrajectory(points=[{"positions": 0}]),
            "points[0].positions: expected numbers, got 0",
        ),
        (
            lambda: JointTrajectory(points=JointTrajectoryPoint()),
            "points: expected a sequence of JointTrajectoryPoint, "
            "got a JointTrajectoryPoint",
        ),
        (lambda: JointTolerance(1), "name: expected a string, got 1"),
        (
            lambda: JointTolerance("a", position=None),
            "position: expected a number, got None",
        ),
        (
            lambda: FollowJointTrajectoryGoal(None),
            "trajectory: expected a JointTrajectory, got None",
        ),
        (
            lambda: FollowJointTrajectoryGoal(path_tolerance=[1]),
            "path_tolerance[0]: expected a JointTolerance, got 1",
        ),
        (
            lambda: FollowJointTrajectoryGoal(goal_tolerance=0.1),
            "goal_tolerance: expected a sequence of JointTolerance, got 0.1",
        ),
        (
            lambda: FollowJointTrajectoryGoal(goal_time_tolerance="1"),
            f"goal_time_tolerance: {TIME}, got '1'",
        ),
        (
            lambda: SendGoal(JointTrajectory()),
            "goal: expected a FollowJointTrajectoryGoal or a GripperCommandGoal or a "
            "ParallelGripperCommandGoal, got a JointTrajectory; "
            "FollowJointTrajectoryGoal(trajectory) is one",
        ),
        (
            lambda: SendGoal(None),
            "goal: expected a FollowJointTrajectoryGoal or a GripperCommandGoal or a "
            "ParallelGripperCommandGoal, got None",
        ),
        (
            lambda: CancelGoal(FollowJointTrajectoryGoal()),
            "request: expected a SendGoal, got a FollowJointTrajectoryGoal",
        ),
        (lambda: SpeedScalingFactor("x"), "factor: expected a number, got 'x'"),
        (lambda: SpeedScalingFactor(None), "factor: expected a number, got None"),
        (lambda: SpeedScalingFactor(True), "factor: expected a number, got True"),
        (lambda: Float64MultiArray(None), "data: expected numbers, got None"),
        (lambda: MultiDOFCommand("ab"), "dof_names: expected names, got 'ab'"),
        (lambda: MultiDOFCommand(values=1.0), "values: expected numbers, got 1.0"),
    ],
)
def test_a_malformed_message_is_refused_where_it_is_made(make, message):
    with pytest.raises(ValueError, match="expected") as caught:
        make()

    assert str(caught.value) == message


def test_names_of_an_array_become_strings():
    names = JointTrajectory(joint_names=np.array(["a", "b"])).joint_names

    assert names == ("a", "b")
    assert {type(name) for name in names} == {str}


def test_a_header_takes_seconds():
    assert Header(1.5) == Header(Time(1, 500_000_000))
    assert Header.from_nanoseconds(1_500_000_000, "base") == Header(1.5, "base")


def test_a_factor_takes_integers():
    assert type(SpeedScalingFactor(2).factor) is float


def test_a_lazy_message_is_made_once_when_it_is_looked_at():
    made = []

    def make():
        made.append(JointState(name=("a",), position=(1.0,)))
        return made[-1]

    message = make_lazy(JointState, make)
    assert copy.deepcopy(message) is message
    assert isinstance(message, JointState)
    assert made == []

    fields = message.name, message.position, message.header

    assert fields == (("a",), (1.0,), Header())
    assert len(made) == 1


def test_a_lazy_message_is_as_good_as_any():
    plain = JointState(name=("a",), position=(1.0,))
    message = make_lazy(JointState, lambda: plain)

    assert message == plain
    assert plain == message
    assert message == make_lazy(JointState, lambda: plain)
    assert message != JointState()
    assert hash(message) == hash(plain)
    assert repr(message) == repr(plain)
    assert dc.asdict(message) == dc.asdict(plain)
    assert dc.replace(message, name=("b",)) == JointState(name=("b",), position=(1.0,))
    assert type(pickle.loads(pickle.dumps(message))) is JointState  # noqa: S301
    with pytest.raises(dc.FrozenInstanceError):
        message.name = ()


def test_a_message_that_is_renewed_is_an_ordinary_one_of_its_own():
    plain = JointState(name=("a",), position=(1.0,))
    lazy = make_lazy(JointState, lambda: plain)

    for message in (plain, lazy):
        new = renew(message)
        assert new == plain
        assert new is not message
        assert type(new) is JointState
        assert hash(new) == hash(plain)
    with pytest.raises(TypeError):
        renew({"name": ("a",)})


@dc.dataclass(frozen=True, slots=True)
class Slotted(Message):
    """A message of a user's own."""

    data: float = 0.0


def test_a_message_with_slots_is_renewed_with_its_fields():
    message = Slotted(3.0)

    new = renew(message)

    assert new == message
    assert new is not message


def test_a_time_converts_to_seconds_and_nanoseconds():
    assert Time(1, 500_000_000).to_seconds() == 1.5
    assert Time(-1, 750_000_000).to_nanoseconds() == -250_000_000
    assert Time.from_nanoseconds(-250_000_000) == Time(-1, 750_000_000)


def test_times_are_ordered():
    assert Time(0, 5) < Time(1, 0) < Time(1, 1)


@pytest.mark.parametrize(
    "message",
    [
        Time(1),
        JointState(name=("a",)),
        JointTrajectory(),
        FollowJointTrajectoryGoal(),
        JointTrajectoryControllerState(),
        SendGoal(FollowJointTrajectoryGoal()),
    ],
)
def test_a_message_never_changes_and_copies_as_itself(message):
    assert copy.copy(message) is message
    assert copy.deepcopy([message])[0] is message
    with pytest.raises(dc.FrozenInstanceError):
        setattr(message, dc.fields(message)[0].name, None)


def test_a_point_takes_sequences_and_seconds():
    point = JointTrajectoryPoint(
        positions=[1, 2],
        velocities=np.array([3.0, 4.0]),
        accelerations=(5,),
        effort=range(2),
        time_from_start=0.5,
    )

    assert point == JointTrajectoryPoint(
        (1.0, 2.0), (3.0, 4.0), (5.0,), (0.0, 1.0), Duration(0, 500_000_000)
    )
    assert [type(value) for value in (*point.positions, *point.velocities)] == [
        float
    ] * 4


@pytest.mark.parametrize(
    "field", ["positions", "velocities", "accelerations", "effort"]
)
@pytest.mark.parametrize(
    ("values", "shown"),
    [
        (["1"], "['1']"),
        ([True], "[True]"),
        ("1", "['1']"),
        ([b"1"], "[b'1']"),
        ([None], "[None]"),
        (None, "None"),
        (3, "3"),
        ([[1.0]], "[[1.0]]"),
        (np.array([[1.0]]), "[array([1.])]"),
        (np.array(1.0), "array(1.)"),
        ([1j], "[1j]"),
        ([10**309], f"[{10**309}]"),
    ],
)
def test_a_point_refuses_what_is_no_number(field, values, shown):
    with pytest.raises(ValueError, match="expected numbers") as caught:
        JointTrajectoryPoint(**{field: values})

    assert str(caught.value) == f"{field}: expected numbers, got {shown}"


def test_a_tolerance_refuses_what_is_no_number():
    with pytest.raises(ValueError, match="expected a number") as caught:
        JointTolerance("a", velocity="1")

    assert str(caught.value) == "velocity: expected a number, got '1'"


def test_a_tolerance_takes_integers():
    tolerance = JointTolerance("a", position=1, velocity=-1)

    assert (tolerance.position, tolerance.velocity) == (1.0, -1.0)
    assert type(tolerance.position) is float


def test_a_trajectory_and_a_goal_take_lists():
    point = JointTrajectoryPoint([1.0])
    trajectory = JointTrajectory(joint_names=["a"], points=[point])
    goal = FollowJointTrajectoryGoal(
        trajectory, [JointTolerance("a")], [JointTolerance("b")], 1.5
    )

    assert trajectory.joint_names == ("a",)
    assert trajectory.points == (point,)
    assert goal.path_tolerance == (JointTolerance("a"),)
    assert goal.goal_tolerance == (JointTolerance("b"),)
    assert goal.goal_time_tolerance == Duration(1, 500_000_000)


def test_a_trajectory_takes_mappings_as_a_topic_has_them():
    point = {"positions": [1], "time_from_start": {"sec": 2, "nanosec": 0}}

    trajectory = JointTrajectory({"frame_id": "a"}, ["j"], [point])

    assert trajectory == JointTrajectory(
        Header(frame_id="a"), ("j",), (JointTrajectoryPoint((1.0,), time_from_start=2),)
    )


def test_equal_goals_sent_twice_are_two_requests():
    goal = FollowJointTrajectoryGoal()
    first, second = SendGoal(goal), SendGoal(goal)

    assert first != second
    assert CancelGoal(first) != CancelGoal(first)


def test_error_codes_are_those_of_control_msgs():
    codes = {code.name: int(code) for code in FollowJointTrajectoryErrorCode}

    assert codes == {
        "SUCCESSFUL": 0,
        "INVALID_GOAL": -1,
        "INVALID_JOINTS": -2,
        "OLD_HEADER_TIMESTAMP": -3,
        "PATH_TOLERANCE_VIOLATED": -4,
        "GOAL_TOLERANCE_VIOLATED": -5,
    }


def test_a_goal_is_done_unless_it_waits_or_runs():
    running = {status for status in GoalStatus if not status.is_terminal}

    assert running == {GoalStatus.PENDING, GoalStatus.EXECUTING}


def test_a_switch_takes_sequences_of_names():
    request = SwitchController(["a"], (name for name in "bc"), "best_effort")

    assert request.activate_controllers == ("a",)
    assert request.deactivate_controllers == ("b", "c")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"activate_controllers": "abc"},
            "activate_controllers: expected names of controllers, got 'abc'",
        ),
        (
            {"activate_controllers": None},
            "activate_controllers: expected names of controllers, got None",
        ),
        (
            {"deactivate_controllers": [1]},
            "deactivate_controllers: expected names of controllers, got [1]",
        ),
        (
            {"strictness": "bogus"},
            "strictness: expected one of 'strict', 'best_effort', '', got 'bogus'",
        ),
        (
            {"strictness": [1]},
            "strictness: expected one of 'strict', 'best_effort', '', got [1]",
        ),
    ],
)
def test_a_switch_refuses_what_no_service_would_get(arguments, message):
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared.
        SwitchController(**arguments)

    assert str(caught.value) == message


def test_a_message_that_derives_from_another_has_a_type_of_its_own() -> None:
    @dc.dataclass(frozen=True)
    class Labelled(JointState):
        label: str = ""

    class Level(Float64, ros="std_msgs/msg/UInt8"):
        pass

    class Short(Float64, ros="std_msgs/UInt8"):
        pass

    assert ros_type(JointState) == "sensor_msgs/msg/JointState"
    assert ros_type(Labelled) is None
    assert ros_type(Level) == ros_type(Short) == "std_msgs/msg/UInt8"
