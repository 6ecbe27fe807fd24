import math

import pytest

from arm_drake.controllers.gazebo.joint_trajectory import JointTrajectoryController
from arm_drake.description import gazebo_plugins
from arm_drake.messages import Header, JointTrajectory, JointTrajectoryPoint, Time
from tests.controllers.driving import Driven
from tests.controllers.gazebo_plugins import commands, make_surroundings, push

TOPIC = "/model/arm/joint_trajectory"
DROPPED = "; the trajectory is dropped"

# The effort is the target position, where a joint stands at 0.
SHOWING = gazebo_plugins.JointTrajectoryController(("a",), position_p_gain=(1.0,))


def make_tag(
    *joints: str, **fields: object
) -> gazebo_plugins.JointTrajectoryController:
    return gazebo_plugins.JointTrajectoryController(joints, **fields)  # type: ignore[arg-type]


def drive(
    tag: gazebo_plugins.JointTrajectoryController = SHOWING,
    *,
    joints: tuple[str, ...] = ("a", "b"),
    rate: int = 100,
    **more: object,
) -> Driven:
    params = make_surroundings(*joints, rate=rate, **more)
    return Driven(JointTrajectoryController(tag, params))


def make_message(
    *points: tuple[float, float], joint: str = "a", stamp: float = 0.0
) -> JointTrajectory:
    """Return positions of one joint at times."""
    return JointTrajectory(
        Header(Time.of(stamp)),
        (joint,),
        tuple(
            JointTrajectoryPoint(positions=(position,), time_from_start=time)
            for time, position in points
        ),
    )


def efforts(driven: Driven, num_ticks: int, joint: str = "a") -> list[float]:
    """Return what is commanded in the next ticks."""
    found = []
    for _ in range(num_ticks):
        driven.run()
        found.append(commands(driven)[f"{joint}/effort"])
    return found


def test_targets_jump_when_the_time_of_a_point_is_over() -> None:
    driven = drive()
    driven.run()
    message = make_message((0.02, 1.0), (0.05, 2.0), (0.06, 3.0))

    driven.run({TOPIC: message})
    first = commands(driven)["a/effort"]

    # The trajectory starts with the tick that sees it.
    assert [first, *efforts(driven, 7)] == [1.0] * 3 + [2.0] * 3 + [3.0] * 2


def test_progress_is_told() -> None:
    driven = drive()
    parts = [driven.output(f"{TOPIC}_progress").data]

    driven.run({TOPIC: make_message((0.0, 1.0), (0.01, 2.0), (1.0, 3.0), (1.0, 4.0))})
    parts.append(driven.output(f"{TOPIC}_progress").data)
    for _ in range(2):
        driven.run()
        parts.append(driven.output(f"{TOPIC}_progress").data)

    assert parts == [0.0, 0.25, 0.5, 0.75]


def test_a_new_message_replaces_the_one_before() -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.01, 1.0), (0.03, 2.0))})

    driven.run({TOPIC: make_message((0.01, 5.0), (9.0, 6.0))})

    assert efforts(driven, 4) == [5.0, 6.0, 6.0, 6.0]


def test_the_last_target_holds() -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.0, 1.0), (0.01, 2.0))})

    assert efforts(driven, 100)[-1] == 2.0


def test_without_points_the_target_stays() -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.02, 1.0), (9.0, 2.0))})

    driven.run({TOPIC: make_message()})

    assert efforts(driven, 5) == [1.0] * 5
    assert driven.reasons() == []


def test_by_default_the_stamp_does_not_count() -> None:
    driven = drive()

    driven.run({TOPIC: make_message((0.01, 1.0), (9.0, 2.0), stamp=5.0)})

    assert commands(driven) == {"a/effort": 1.0}


def test_a_trajectory_can_start_at_the_time_in_its_header() -> None:
    driven = drive(make_tag("a", position_p_gain=(1.0,), use_header_start_time=True))
    driven.run({TOPIC: make_message((0.01, 1.0), (9.0, 2.0), stamp=0.03)})

    # Ticks at 0.01 s, 0.02 s, ...; the first point's time is over after 0.04 s.
    assert efforts(driven, 6) == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]


def test_a_trajectory_that_started_before_is_joined_on_the_way() -> None:
    driven = drive(make_tag("a", position_p_gain=(1.0,), use_header_start_time=True))
    efforts(driven, 10)

    driven.run({TOPIC: make_message((0.01, 1.0), (0.05, 2.0), (9.0, 3.0), stamp=0.06)})

    assert efforts(driven, 3) == [2.0, 3.0, 3.0]


def test_a_header_without_a_time_starts_at_once() -> None:
    driven = drive(make_tag("a", position_p_gain=(1.0,), use_header_start_time=True))
    efforts(driven, 10)

    driven.run({TOPIC: make_message((0.01, 1.0), (9.0, 3.0))})

    assert efforts(driven, 3) == [1.0, 3.0, 3.0]


def test_position_velocity_and_effort_add_up() -> None:
    tag = make_tag("a", position_p_gain=(10.0,), velocity_p_gain=(2.0,))
    driven = drive(tag, joints=("a",))
    driven.measure([0.5, -1.0])
    point = JointTrajectoryPoint(positions=(1.0,), velocities=(3.0,), effort=(0.25,))

    driven.run({TOPIC: JointTrajectory(Header(), ("a",), (point,))})

    assert commands(driven) == {"a/effort": 10.0 * 0.5 + 2.0 * 4.0 + 0.25}


def test_what_a_point_lacks_stays() -> None:
    tag = make_tag("a", position_p_gain=(10.0,), velocity_p_gain=(2.0,))
    driven = drive(tag)
    points = (
        JointTrajectoryPoint(positions=(1.0,), velocities=(3.0,), effort=(0.5,)),
        JointTrajectoryPoint(positions=(2.0,), time_from_start=0.01),
    )

    driven.run({TOPIC: JointTrajectory(Header(), ("a",), points)})

    assert efforts(driven, 1) == [10.0 * 2.0 + 2.0 * 3.0 + 0.5]


def test_the_pids_go_on_from_point_to_point() -> None:
    # i dt = 1 in steps of 0.5 s; each point is the target of one tick.
    driven = drive(make_tag("a", position_i_gain=(2.0,)), rate=2)

    driven.run({TOPIC: make_message((0.0, 1.0), (0.5, 2.0), (1.0, 4.0))})

    assert [commands(driven)["a/effort"], *efforts(driven, 2)] == [1.0, 3.0, 7.0]


def test_every_joint_has_its_own_gains_and_without_them_none() -> None:
    tag = make_tag(
        *("c", "a", "b"),
        position_p_gain=(1.0, 2.0),
        initial_positions=(1.0, 1.0, 1.0),
        position_cmd_offset=(0.0, 0.0, 0.5),
    )
    driven = drive(tag, joints=("a", "b", "c"))

    driven.run()

    assert commands(driven) == {"c/effort": 1.0, "a/effort": 2.0, "b/effort": 0.5}


def test_only_limits_in_their_order_are_limits() -> None:
    gains = {"position_p_gain": (1.0, 1.0), "initial_positions": (7.0, 7.0)}
    limits = {"position_cmd_max": (5.0, -9.0), "position_cmd_min": (-5.0,)}
    driven = drive(make_tag("a", "b", **gains, **limits))

    driven.run()

    # A minimum that isn't given is 0.
    assert commands(driven) == {"a/effort": 5.0, "b/effort": 7.0}


def test_without_names_all_joints_are_controlled() -> None:
    driven = drive(make_tag(position_p_gain=(1.0, 2.0), initial_positions=(3.0, 4.0)))

    driven.run()

    assert commands(driven) == {"a/effort": 3.0, "b/effort": 8.0}


def test_joints_of_others_are_passed_over_and_reported() -> None:
    driven = drive()
    point = JointTrajectoryPoint(positions=(7.0, 1.0, 8.0))

    driven.run({TOPIC: JointTrajectory(Header(), ("b", "a", "x"), (point,))})

    assert commands(driven) == {"a/effort": 1.0}
    assert driven.reasons() == ["no joint 'b', 'x' here; the other joints follow it"]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            JointTrajectory(points=(JointTrajectoryPoint(positions=(2.0,)),)),
            "joint_names must not be empty",
        ),
        (make_message((0.0, 2.0), joint="aa"), "none of its joints is here; did you "),
        (
            make_message((0.0, 2.0), (1.0, math.nan)),
            "points[1].positions[0] must be finite, got nan",
        ),
        (
            JointTrajectory(
                Header(), ("a",), (JointTrajectoryPoint(effort=(math.inf,)),)
            ),
            "points[0].effort[0] must be finite, got inf",
        ),
    ],
)
def test_a_message_that_cannot_be_followed_is_dropped(
    message: JointTrajectory, reason: str
) -> None:
    driven = drive()
    driven.run({TOPIC: make_message((0.0, 1.0))})

    driven.run({TOPIC: message})

    assert commands(driven) == {"a/effort": 1.0}
    (published,) = driven.reasons()
    assert published.startswith(reason)
    assert published.endswith(DROPPED)


def test_a_master_carries_the_forces_of_its_followers() -> None:
    tag = make_tag("a", "b", position_p_gain=(1.0, 10.0))
    driven = drive(tag, followed={"b": ("a", 0.5)}, effort_limits={"b": 4.0})
    point = JointTrajectoryPoint(positions=(1.0, 1.0))

    driven.run({TOPIC: JointTrajectory(Header(), ("a", "b"), (point,))})

    assert commands(driven) == {"a/effort": 1.0 + 0.5 * 4.0}


def test_a_deactivation_ends_efforts_and_an_activation_starts_anew() -> None:
    tag = make_tag("a", position_p_gain=(1.0,), initial_positions=(0.5,))
    driven = drive(tag)
    driven.run({TOPIC: make_message((0.05, 1.0), (0.06, 2.0))})

    driven.run(activation=None)
    stopped = commands(driven)
    driven.run({TOPIC: make_message((0.0, 9.0))}, activation=None)
    driven.run(activation=2)

    assert stopped == {"a/effort": 0.0}
    assert efforts_again(driven) == [0.5] * 10
    assert driven.reasons() == ["the controller is not active"]


def efforts_again(driven: Driven) -> list[float]:
    found = []
    for _ in range(10):
        driven.run(activation=2)
        found.append(commands(driven)["a/effort"])
    return found


@pytest.mark.slow
def test_a_ros2_control_like_trajectory_moves_a_mass_to_its_end() -> None:
    # A PD of 10 rad/s without overshoot, and a load that it holds with a sag of 0.02.
    tag = make_tag("a", position_p_gain=(100.0,), position_d_gain=(20.0,))
    driven = drive(tag, joints=("a",), rate=500)
    message = make_message((0.5, 0.5), (1.0, 1.0))
    driven.system.GetInputPort(TOPIC).FixValue(driven.context, message)

    path = push(driven, 5.0, load=-2.0)

    # The last target holds from 0.5 s on; 41 e^-40 is left.
    assert path[-1] == pytest.approx([1.0 - 0.02, 0.0], abs=1e-12)
