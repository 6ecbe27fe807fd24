import dataclasses as dc
from math import inf, nan
from typing import Any

import pytest

from arm_drake.controllers.joint_trajectory.state import (
    TrajectoryRules,
    find_fault,
    needed_fields,
)
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Time,
)

JOINTS = ("joint1", "joint2", "joint3")
NOW_NS = 100 * NANOSECONDS
POINT = {
    "positions": (1.0, 2.0, 3.0),
    "velocities": (-1.0, -2.0, -3.0),
    "time_from_start": 0.25,
}
INTEGRATE = {"allow_integration_in_goal_trajectories": True}
PARTIAL = {"allow_partial_joints_goal": True}
AT_REST = {"allow_nonzero_velocity_at_trajectory_end": False}
NOT_AT_REST = "; they must be 0, or allow_nonzero_velocity_at_trajectory_end set"
EPSILON = 2.0**-23  # of a 32-bit float


def make_rules(**changes: Any) -> TrajectoryRules:
    rules = TrajectoryRules(JOINTS, allow_nonzero_velocity_at_trajectory_end=True)
    return dc.replace(rules, **changes)


def make_message(
    *changes: dict[str, Any],
    joints: tuple[str, ...] = JOINTS,
    stamp_ns: int = 0,
) -> JointTrajectory:
    """Return the reference message with a point per change, or its only point."""
    points = [JointTrajectoryPoint(**{**POINT, **change}) for change in changes]
    return JointTrajectory(
        Header(Time.from_nanoseconds(stamp_ns)),
        joints,
        points or [JointTrajectoryPoint(**POINT)],
    )


def without(*fields: str, **inputs: Any) -> dict[str, Any]:
    return {**dict.fromkeys(fields, ()), **inputs}


EFFORT = {"effort": (1.0, 2.0, 3.0)}
TWO = {"positions": (1.0, 2.0), "velocities": ()}
ACCELERATIONS = {"accelerations": (1.0, 2.0, 3.0)}
NO_POINTS = JointTrajectory(joint_names=JOINTS)


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        pytest.param(make_message(), {}, id="V1"),
        pytest.param(make_message(EFFORT), {"has_effort_command": True}, id="V9"),
        pytest.param(
            make_message({"time_from_start": 10.0}, stamp_ns=NOW_NS), {}, id="V13"
        ),
        pytest.param(make_message({"velocities": (0.0,) * 3}), AT_REST, id="V15"),
        pytest.param(make_message(ACCELERATIONS), INTEGRATE, id="V17"),
        pytest.param(make_message(without("positions")), INTEGRATE, id="V18"),
        pytest.param(
            make_message(without("positions", "velocities", **ACCELERATIONS)),
            INTEGRATE,
            id="V19",
        ),
        pytest.param(make_message(TWO, joints=("joint2", "joint1")), PARTIAL, id="V26"),
        pytest.param(
            make_message({"velocities": (0.0, 0.0, -EPSILON)}), AT_REST, id="epsilon"
        ),
        pytest.param(
            make_message({}, {"time_from_start": 0.5, "velocities": (0.0,) * 3}),
            AT_REST,
            id="moves on the way",
        ),
        pytest.param(make_message({"time_from_start": 0.0}), {}, id="due at once"),
        pytest.param(
            make_message(stamp_ns=NOW_NS - NANOSECONDS // 4), {}, id="ends now"
        ),
    ],
)
def test_good_trajectories_are_taken(
    message: JointTrajectory, changes: dict[str, Any]
) -> None:
    assert find_fault(message, make_rules(**changes), NOW_NS) is None


@pytest.mark.parametrize(
    ("message", "changes", "fault"),
    [
        pytest.param(
            make_message(joints=("bad_name",)),
            {},
            "unknown joint 'bad_name'; known: joint1, joint2, joint3",
            id="V2",
        ),
        pytest.param(
            NO_POINTS, {}, "no points; a trajectory needs at least one", id="V3"
        ),
        pytest.param(
            make_message(without("positions")),
            {},
            "points[0].positions has no elements; expected 3, one per joint",
            id="V4",
        ),
        pytest.param(
            make_message({"positions": (1.0, 2.0)}),
            {},
            "points[0].positions has 2 elements; expected 3, one per joint",
            id="V5",
        ),
        pytest.param(
            make_message({"positions": (1.0, 2.0, 3.0, 4.0)}),
            {},
            "points[0].positions has 4 elements; expected 3, one per joint",
            id="V6",
        ),
        pytest.param(
            make_message({"velocities": (1.0, 2.0)}),
            {},
            "points[0].velocities has 2 elements; expected 3, one per joint",
            id="V7",
        ),
        pytest.param(
            make_message({"accelerations": (1.0, 2.0)}),
            {},
            "points[0].accelerations has 2 elements; expected 3, one per joint",
            id="V8",
        ),
        pytest.param(
            make_message(EFFORT),
            {},
            "points[0].effort is given; the controller has no effort command interface",
            id="V10",
        ),
        pytest.param(
            make_message({}, {}),
            {},
            "points[1].time_from_start is 0.25 s, after 0.25 s; times must increase",
            id="V11",
        ),
        pytest.param(
            make_message(stamp_ns=1),
            {},
            "ends in the past: at 0.250000001 s, and it is 100.0 s; "
            "a stamp of 0 starts now",
            id="V12",
        ),
        pytest.param(
            make_message(),
            AT_REST,
            f"the last point has velocities [-1.0, -2.0, -3.0]{NOT_AT_REST}",
            id="V14",
        ),
        pytest.param(
            JointTrajectory(),
            AT_REST,
            "no joint_names; name the joints of the positions",
            id="V16",
        ),
        pytest.param(
            make_message(without("positions", "velocities")),
            INTEGRATE,
            "points[0].positions has no elements; expected 3, one per joint",
            id="V20",
        ),
        pytest.param(
            make_message({"positions": (1.0, 2.0)}),
            INTEGRATE,
            "points[0].positions has 2 elements; expected 3, one per joint",
            id="V21",
        ),
        pytest.param(
            make_message({"positions": (1.0, 2.0, 3.0, 4.0)}),
            INTEGRATE,
            "points[0].positions has 4 elements; expected 3, one per joint",
            id="V22",
        ),
        pytest.param(
            make_message({"velocities": (1.0,)}),
            INTEGRATE,
            "points[0].velocities has 1 elements; expected 3, one per joint",
            id="V23",
        ),
        pytest.param(
            make_message({"accelerations": (1.0, 2.0)}),
            INTEGRATE,
            "points[0].accelerations has 2 elements; expected 3, one per joint",
            id="V24",
        ),
        pytest.param(
            make_message(TWO, joints=("joint2", "joint1")),
            {},
            "joints ['joint3'] are missing; name all joints, or set "
            "allow_partial_joints_goal",
            id="V25",
        ),
        pytest.param(
            make_message({"velocities": (0.0, 0.0, 2 * EPSILON)}),
            AT_REST,
            f"the last point has velocities [0.0, 0.0, {2 * EPSILON}]{NOT_AT_REST}",
            id="beyond epsilon",
        ),
        pytest.param(
            make_message({}, {"time_from_start": 0.125}),
            {},
            "points[1].time_from_start is 0.125 s, after 0.25 s; times must increase",
            id="back in time",
        ),
        pytest.param(
            make_message(joints=("joint1", "joint2", "joint1")),
            PARTIAL,
            "joint 'joint1' is named twice; name each joint once",
            id="named twice",
        ),
        pytest.param(
            make_message(joints=("joint1", "joint2", "jiont3")),
            PARTIAL,
            "unknown joint 'jiont3'; did you mean 'joint3'? "
            "known: joint1, joint2, joint3",
            id="misspelt",
        ),
        pytest.param(
            make_message({"positions": (1.0, nan, 3.0)}),
            {},
            "points[0].positions[1] is nan; expected a finite number",
            id="not a number",
        ),
        pytest.param(
            make_message({}, {"time_from_start": 1.0, "accelerations": (0, 0, -inf)}),
            {},
            "points[1].accelerations[2] is -inf; expected a finite number",
            id="infinite",
        ),
        pytest.param(
            make_message({"effort": (1.0, 2.0)}),
            {"has_effort_command": True},
            "points[0].effort has 2 elements; expected 3, one per joint",
            id="effort of two",
        ),
    ],
)
def test_bad_trajectories_are_refused(
    message: JointTrajectory, changes: dict[str, Any], fault: str
) -> None:
    assert find_fault(message, make_rules(**changes), NOW_NS) == fault


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        (["position"], ("positions",)),
        (["velocity"], ("positions", "velocities")),
        (
            ["position", "velocity", "acceleration"],
            ("positions", "velocities", "accelerations"),
        ),
        (["effort"], ("positions", "velocities", "effort")),
    ],
)
def test_points_that_are_commanded_as_they_are_need_what_is_commanded(
    commands: list[str], expected: tuple[str, ...]
) -> None:
    assert needed_fields(commands, "none") == expected
    assert needed_fields(commands, "splines") == ()


NONE = {"needed": ("positions", "velocities"), "known_at_start": ("positions",)}
MEASURED = {**NONE, "known_at_start": ("positions", "velocities")}
MISSING = (
    "points[{}] has no velocities; with interpolation_method 'none' every point needs "
    "positions, velocities"
)
AT_1, AT_2 = without("velocities"), without("velocities", time_from_start=2.0)
FULL_AT_2 = {"velocities": (0.0, 0.0, 0.0), "time_from_start": 2.0}


@pytest.mark.parametrize(
    ("points", "changes", "fault"),
    [
        ((AT_1, FULL_AT_2), NONE, MISSING.format(0)),
        # What is measured leads to the first point.
        ((AT_1, FULL_AT_2), MEASURED, None),
        ((FULL_AT_2 | {"time_from_start": 1.0}, AT_2), MEASURED, MISSING.format(1)),
        # Such a point is the end, where velocities are 0.
        ((without("velocities", time_from_start=0.0),), NONE, None),
    ],
)
def test_upstream_s_crash_is_a_refusal(
    points: tuple[dict[str, Any], ...], changes: dict[str, Any], fault: str | None
) -> None:
    message = make_message(*points)

    assert find_fault(message, make_rules(**changes), NOW_NS) == fault
