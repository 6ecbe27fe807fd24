import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from arm_drake.controllers.gazebo.joint_trajectory import GazeboRosJointPoseTrajectory
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Header, JointTrajectory, JointTrajectoryPoint, Time
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings

TOPIC = "/set_joint_trajectory"
DROPPED = "; the trajectory is dropped"
EVERY_TICK = 0.0


def make_system(
    update_rate: float = EVERY_TICK,
    *,
    joints: tuple[str, ...] = ("a", "b"),
    rate: int = 100,
    **more: object,
) -> GazeboRosJointPoseTrajectory:
    tag = gazebo_plugins.GazeboRosJointPoseTrajectory(update_rate)
    hardware_interfaces = {"links": ("base", "hand"), **more}
    return GazeboRosJointPoseTrajectory(
        tag, make_surroundings(*joints, rate=rate, **hardware_interfaces)
    )


def drive(update_rate: float = EVERY_TICK, **more: object) -> Driven:
    return Driven(make_system(update_rate, **more))  # type: ignore[arg-type]


def make_message(
    *points: tuple[float, float],
    joints: tuple[str, ...] = ("a",),
    frame: str = "base",
    stamp: float = 0.0,
) -> JointTrajectory:
    """Return points of a delay and a position, the same for all joints."""
    return JointTrajectory(
        Header(Time.of(stamp), frame),
        joints,
        tuple(
            JointTrajectoryPoint(
                positions=(position,) * len(joints), time_from_start=delay
            )
            for delay, position in points
        ),
    )


def positions(driven: Driven, num_ticks: int) -> list[float]:
    """Return the commands of joint a in the next ticks."""
    found = []
    for _ in range(num_ticks):
        driven.run()
        found.append(commands(driven)["a/position"])
    return found


def ticks_of_changes(values: list[float]) -> list[int]:
    """Return when there is another value."""
    return [k + 1 for k in range(len(values) - 1) if values[k] != values[k + 1]]


def test_times_are_delays_until_the_next_point() -> None:
    driven = drive()
    message = make_message((0.02, 1.0), (0.03, 2.0), (0.01, 3.0), (9.0, 4.0))

    driven.run({TOPIC: message})
    values = [commands(driven)["a/position"], *positions(driven, 8)]

    assert values == [1.0] * 2 + [2.0] * 3 + [3.0] + [4.0] * 3


@pytest.mark.parametrize(
    ("update_rate", "ticks"),
    # At a manager's 1 kHz: 20 Hz are 50 ms, and 30 Hz are 33.3 ms.
    [(0.0, [1, 2, 3]), (20.0, [50, 100, 150]), (30.0, [34, 68, 102])],
)
def test_points_come_no_faster_than_the_update_rate(
    update_rate: float, ticks: list[int]
) -> None:
    driven = drive(update_rate, rate=1000)

    driven.run({TOPIC: make_message((0.0, 1.0), (0.0, 2.0), (0.0, 3.0), (0.0, 4.0))})
    values = [commands(driven)["a/position"], *positions(driven, 200)]

    assert ticks_of_changes(values) == ticks


def test_by_default_points_come_at_100_hz_at_most() -> None:
    tag = gazebo_plugins.GazeboRosJointPoseTrajectory()
    system = GazeboRosJointPoseTrajectory(
        tag, make_surroundings("a", rate=1000, links=("base",))
    )
    driven = Driven(system)

    driven.run({TOPIC: make_message((0.0, 1.0), (0.0, 2.0), (0.0, 3.0))})
    values = [commands(driven)["a/position"], *positions(driven, 25)]

    assert ticks_of_changes(values) == [10, 20]


def test_points_that_come_late_do_not_delay_those_after_them() -> None:
    # The second point is due after 0.01 s and comes after 0.05 s; the third is due
    # 0.08 s after that was, so at 0.09 s, and comes after 0.1 s.
    driven = drive(20.0)

    driven.run({TOPIC: make_message((0.01, 1.0), (0.08, 2.0), (0.0, 3.0))})
    values = [commands(driven)["a/position"], *positions(driven, 12)]

    assert ticks_of_changes(values) == [5, 10]


def test_ticks_whose_times_are_cut_to_nanoseconds_are_in_time() -> None:
    # Every second tick of 60 Hz is one of 30 Hz, though 1 / 60 is no whole number.
    system = make_system(30.0, rate=60)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    message = make_message((0.0, 1.0), (0.0, 2.0), (0.0, 3.0), (0.0, 4.0))
    system.GetInputPort("state_interfaces").FixValue(context, np.zeros(4))
    system.GetInputPort(TOPIC).FixValue(context, message)

    values = []
    for tick in range(8):
        simulator.AdvanceTo((tick + 0.5) / 60)
        values.append(context.get_abstract_state(0).get_value().command[0])

    assert ticks_of_changes(values) == [2, 4, 6]


def test_a_trajectory_starts_at_the_time_in_its_header() -> None:
    driven = drive()

    driven.run({TOPIC: make_message((0.0, 1.0), stamp=0.04)})

    # Ticks at 0.01 s, 0.02 s, ...
    np.testing.assert_equal(positions(driven, 5), [math.nan] * 3 + [1.0] * 2)


def test_a_time_that_is_past_is_now() -> None:
    driven = drive()
    positions(driven, 50)

    driven.run({TOPIC: make_message((0.02, 1.0), (0.0, 2.0), stamp=0.1)})

    assert [commands(driven)["a/position"], *positions(driven, 2)] == [1.0, 1.0, 2.0]


def test_a_new_message_replaces_the_one_before() -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.02, 1.0), (0.02, 2.0), (0.02, 3.0))})

    driven.run({TOPIC: make_message((0.01, 7.0), (0.02, 8.0))})

    assert positions(driven, 6) == [8.0] * 6


def test_only_the_joints_of_a_message_move() -> None:
    driven = drive(joints=("a", "b", "c"))
    driven.run({TOPIC: make_message((0.0, 1.0), joints=("b",))})
    one = commands(driven)

    driven.run({TOPIC: make_message((0.0, 2.0), joints=("c",))})
    two = commands(driven)

    nan = math.nan
    names = ["a/position", "b/position", "c/position"]
    np.testing.assert_equal(one, dict(zip(names, [nan, 1.0, nan], strict=True)))
    np.testing.assert_equal(two, dict(zip(names, [nan, 1.0, 2.0], strict=True)))


def test_it_claims_the_positions_that_there_are_of_independent_joints() -> None:
    system = make_system(
        joints=("c", "b", "a", "d"),
        followed={"b": ("a", 1.0)},
        command_interfaces=frozenset(["a/position", "b/position", "c/position"]),
    )

    assert system.command_interfaces == ("c/position", "a/position")
    assert system.message_types == {TOPIC: JointTrajectory}


def test_a_mimic_joint_is_left_to_its_master() -> None:
    driven = drive(followed={"b": ("a", 1.0)})
    point = JointTrajectoryPoint(positions=(5.0, 1.0))

    driven.run({TOPIC: JointTrajectory(Header(frame_id="map"), ("b", "a"), (point,))})

    assert commands(driven) == {"a/position": 1.0}
    assert driven.reasons() == []


@pytest.mark.parametrize("frame", ["base", "hand", "world", "map"])
def test_frames_of_links_and_of_the_world_are_taken(frame: str) -> None:
    driven = drive()

    driven.run({TOPIC: make_message((0.0, 1.0), frame=frame)})

    assert commands(driven)["a/position"] == 1.0


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            make_message((0.0, 2.0), frame="bass"),
            "header.frame_id must be a link, 'world' or 'map', got 'bass'; did you "
            "mean 'base'? known: base, hand",
        ),
        (
            make_message((0.0, 2.0), frame=""),
            "header.frame_id must be a link, 'world' or 'map', got ''; known: base, "
            "hand",
        ),
        (
            make_message((0.0, 2.0), joints=("a", "x")),
            "the robot has no joint 'x'; known: a, b, c",
        ),
        (
            make_message((0.0, 2.0), joints=("c", "a")),
            "joint 'c' has no position command",
        ),
        (
            JointTrajectory(
                Header(frame_id="map"),
                ("a", "b"),
                (
                    JointTrajectoryPoint(positions=(2.0, 2.0)),
                    JointTrajectoryPoint(positions=(2.0,)),
                ),
            ),
            "points[1] has 1 positions for 2 joints",
        ),
        (
            make_message((0.0, 2.0), (0.0, math.inf)),
            "points[1].positions[0] must be finite, got inf",
        ),
    ],
)
def test_a_message_that_cannot_be_set_is_dropped(
    message: JointTrajectory, reason: str
) -> None:
    available = frozenset(["a/position", "b/position", "c/effort"])
    driven = drive(joints=("a", "b", "c"), command_interfaces=available)
    driven.run({TOPIC: make_message((0.0, 1.0))})

    driven.run({TOPIC: message})

    assert commands(driven)["a/position"] == 1.0
    assert driven.reasons() == [reason + DROPPED]


def test_namespace_and_remappings_make_the_topic() -> None:
    tag = gazebo_plugins.GazeboRosJointPoseTrajectory(
        namespace="/ns", remappings=("set_joint_trajectory:=go",)
    )

    system = GazeboRosJointPoseTrajectory(tag, make_surroundings("a"))

    assert system.message_types == {"/ns/go": JointTrajectory}
    assert system.HasInputPort("/ns/go")


def test_a_deactivation_leaves_the_joints_where_they_are() -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.05, 1.0), (0.0, 2.0))})

    tick = driven.run(activation=None)
    driven.run({TOPIC: make_message((0.0, 3.0))}, activation=None)
    again = [driven.run(activation=2) for _ in range(10)]

    assert np.isnan(tick.command).all()
    # The trajectory is over, and that for an inactive controller was never one.
    assert all(np.isnan(tick.command).all() for tick in again)
    assert commands(driven)["a/position"] == 1.0
    assert driven.reasons() == ["the controller is not active"]
