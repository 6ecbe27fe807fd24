import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.planning.inverse_kinematics import (
    TOLERANCE,
    _Chain,
    _kinematics_of,
    _Target,
)

POSITION = (True, True, True, False, False, False)

LIMIT = '<limit lower="{}" upper="{}" effort="9" velocity="2"/>'


def joint(
    name: str,
    parent: str,
    child: str,
    *,
    kind: str = "revolute",
    more: str = "",
    axis: str = "0 0 1",
    origin: str = "0 0 0",
    limits: tuple[float, float] = (-3, 3),
) -> str:
    limit = LIMIT.format(*limits) if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
        f"{limit}{more}</joint>"
    )


def robot_of(*joints: str, links: str) -> ad.Robot:
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    bodies = "".join(
        f'<link name="{n}"><inertial><mass value="1"/>{inertia}</inertial></link>'
        for n in links.split()
    )
    return ad.load_robot(f'<robot name="arm">{bodies}{"".join(joints)}</robot>')


@pytest.fixture(scope="module")
def planar() -> ad.Robot:
    """Two links of 1 m in the plane; an elbow that bends to either side."""
    return robot_of(
        joint("shoulder", "base", "upper"),
        joint("elbow", "upper", "lower", origin="1 0 0"),
        joint("wrist", "lower", "tip", kind="fixed", origin="1 0 0"),
        links="base upper lower tip",
    )


@pytest.fixture(scope="module")
def doosan() -> ad.Robot:
    return ad.load_robot("doosan_a0912")


def random_positions(robot: ad.Robot, rng: np.random.Generator) -> dict[str, float]:
    return {
        joint.name: float(rng.uniform(joint.limits.lower, joint.limits.upper))
        for joint in robot.description.movable_joints
    }


def test_the_law_of_cosines_gives_the_elbow(planar: ad.Robot) -> None:
    solution = planar.solve_ik("tip", [1.0, 1.0, 0, 0, 0, 0], mask=POSITION)

    # 1 m to the side and to the front: the elbow is at a right angle.
    assert abs(solution.positions["elbow"]) == pytest.approx(math.pi / 2, abs=1e-4)
    assert solution.position_error <= 1e-5


def test_all_solutions_are_both_sides_of_the_elbow(planar: ad.Robot) -> None:
    solution = planar.solve_ik(
        "tip",
        [1.0, 1.0, 0, 0, 0, 0],
        mask=POSITION,
        seed={"shoulder": 0.1, "elbow": 1.4},
        all_solutions=True,
    )

    both = [solution.positions, *solution.others]
    elbows = [positions["elbow"] for positions in both]
    assert elbows == pytest.approx([math.pi / 2, -math.pi / 2], abs=1e-4)
    shoulders = [positions["shoulder"] for positions in both]
    assert shoulders == pytest.approx([0.0, math.pi / 2], abs=1e-4)


def test_a_seed_chooses_the_side(planar: ad.Robot) -> None:
    for side in (-1.0, 1.0):
        solution = planar.solve_ik(
            "tip", [1.0, 1.0, 0, 0, 0, 0], mask=POSITION, seed={"elbow": side}
        )

        assert solution.positions["elbow"] == pytest.approx(
            side * math.pi / 2, abs=1e-4
        )
        assert solution.tries == 1


def test_a_link_out_of_reach_is_said_to_be(planar: ad.Robot) -> None:
    with pytest.raises(ad.NoSolution) as caught:
        planar.solve_ik("tip", [3.0, 0.0, 0, 0, 0, 0], mask=POSITION)

    assert caught.value.is_out_of_reach
    assert caught.value.position_error == pytest.approx(1.0, abs=1e-3)
    assert str(caught.value).endswith(
        "it is out of reach: 3 m from joint 'shoulder', and 'tip' gets 2 m far"
    )


def count_tries(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return what will hold how many tries were made at once, each time."""
    tries: list[int] = []
    descend, descend_alone = _Chain.descend, _Chain.descend_alone

    def count(chain: _Chain, q: np.ndarray, starts: np.ndarray, target: Any) -> Any:
        tries.append(len(starts))
        return descend(chain, q, starts, target)

    def count_one(chain: _Chain, q: np.ndarray, start: np.ndarray, target: Any) -> Any:
        tries.append(1)
        return descend_alone(chain, q, start, target)

    monkeypatch.setattr(_Chain, "descend", count)
    monkeypatch.setattr(_Chain, "descend_alone", count_one)
    return tries


@pytest.mark.slow
@pytest.mark.parametrize("pointing", [False, True])
@pytest.mark.parametrize("name", ["doosan_a0912", "mycobot_280"])
def test_tries_at_once_end_where_each_alone_does(name: str, pointing: bool) -> None:
    robot = ad.load_robot(name)
    group = next(iter(ad.planning_groups(robot).values()))
    kinematics = _kinematics_of(robot)
    chain = kinematics.chain(group.tip, group.joints)
    q, rng = kinematics.complete({}), np.random.default_rng(3)
    mask = [True] * 5 + [False] if pointing else [True] * 6
    met = 0
    for _ in range(8):
        values = rng.uniform(chain._low, chain._high)
        pose = kinematics.pose_of(chain.spread(q, values), group.tip)
        target = _Target.of(pose, mask, TOLERANCE)
        starts = chain.starts(q, target, 6)
        at_once = chain.descend(q, starts, target)
        alone = [chain.descend_alone(q, start, target) for start in starts]

        assert [target.is_met(e) for e in at_once] == [target.is_met(e) for e in alone]
        for one, other in zip(at_once, alone, strict=True):
            if target.is_met(one):
                met += 1
                assert one.values == pytest.approx(other.values, abs=1e-4)
    assert met > 12


def test_what_is_out_of_reach_is_refused_after_a_few_tries(
    planar: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries = count_tries(monkeypatch)

    with pytest.raises(ad.NoSolution):
        planar.solve_ik("tip", [3.0, 0.0, 0, 0, 0, 0], mask=POSITION)

    assert tries == [1, 1, 1]


def test_not_all_solutions_are_looked_for_where_there_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = robot_of(
        joint("turn", "base", "arm", limits=(-0.5, 0.5)),
        joint("hand", "arm", "tip", kind="fixed", origin="1 0 0"),
        links="base arm tip",
    )
    tries = count_tries(monkeypatch)

    with pytest.raises(ad.NoSolution):
        robot.solve_ik("tip", [0.0, 1.0, 0, 0, 0, 0], mask=POSITION, all_solutions=True)

    # A quarter of those that look for another side of an elbow.
    assert sum(tries) == 25


def test_more_solutions_are_not_looked_for_when_no_new_one_comes(
    planar: ad.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries = count_tries(monkeypatch)

    solution = planar.solve_ik(
        "tip", [1.0, 0.5, 0, 0, 0, 0], mask=POSITION, all_solutions=True
    )

    # Both sides of the elbow are met by the nearest starts.
    assert len(solution.others) == 1
    assert tries == [25, 25]


def test_limits_that_stand_in_the_way_are_named() -> None:
    robot = robot_of(
        joint("turn", "base", "arm", limits=(-0.5, 0.5)),
        joint("hand", "arm", "tip", kind="fixed", origin="1 0 0"),
        links="base arm tip",
    )

    with pytest.raises(ad.NoSolution) as caught:
        robot.solve_ik("tip", [0.0, 1.0, 0, 0, 0, 0], mask=POSITION)

    assert caught.value.at_limits == ("turn",)
    assert caught.value.positions["turn"] == pytest.approx(0.5)
    assert not caught.value.is_out_of_reach
    assert "at their limits are 'turn'" in str(caught.value)


def test_a_prismatic_joint_slides() -> None:
    robot = robot_of(
        joint("lift", "base", "arm", kind="prismatic", limits=(0.0, 2.0)),
        links="base arm",
    )

    solution = robot.solve_ik("arm", [0, 0, 1.25, 0, 0, 0])

    assert solution.positions == pytest.approx({"lift": 1.25}, abs=1e-5)


def test_a_continuous_joint_is_at_the_turn_nearest_to_the_seed() -> None:
    robot = robot_of(joint("turn", "base", "arm", kind="continuous"), links="base arm")

    solution = robot.solve_ik("arm", [0, 0, 0, 0, 0, 0.5], seed={"turn": 12.0})

    expected = 0.5 + 4.0 * math.pi
    assert solution.positions["turn"] == pytest.approx(expected, abs=1e-4)


def test_a_mimic_joint_moves_with_its_master() -> None:
    robot = robot_of(
        joint("lift", "base", "one", kind="prismatic", limits=(0.0, 1.0)),
        joint(
            "second",
            "one",
            "two",
            kind="prismatic",
            limits=(0.0, 2.0),
            more='<mimic joint="lift" multiplier="2" offset="0.1"/>',
        ),
        links="base one two",
    )

    solution = robot.solve_ik("two", [0, 0, 1.0, 0, 0, 0])

    # lift + (2 lift + 0.1) = 1
    assert solution.positions == pytest.approx({"lift": 0.3, "second": 0.7}, abs=1e-5)


def test_an_axis_that_may_turn_points_where_it_should() -> None:
    """Two joints that point: pan and tilt, no roll."""
    robot = robot_of(
        joint("pan", "base", "head"),
        joint("tilt", "head", "eye", axis="0 1 0"),
        links="base head eye",
    )
    mask = (False, False, False, False, True, True)

    solution = robot.solve_ik("eye", [0, 0, 0, 1.0, 0.4, 0.7], mask=mask)

    # The x axis of the pose is that of the yaw and the pitch, whatever the roll.
    assert solution.positions == pytest.approx({"pan": 0.7, "tilt": 0.4}, abs=1e-4)


def test_joints_that_may_not_move_stay(doosan: ad.Robot) -> None:
    X = doosan.forward_kinematics({"joint1": 0.4, "joint3": 1.0}, "link3")

    solution = doosan.solve_ik(
        "link3", X, group=["joint1", "joint2"], seed={"joint3": 1.0}
    )

    assert solution.positions["joint1"] == pytest.approx(0.4, abs=1e-3)
    assert solution.positions["joint6"] == doosan.initial_positions["joint6"]


def test_the_pose_of_the_base_counts() -> None:
    robot = ad.load_robot("doosan_a0912", pose=[1, 2, 3, 0, 0, math.pi / 2])

    X = robot.forward_kinematics({}, "base_0")

    assert X.IsNearlyEqualTo(
        RigidTransform(RollPitchYaw(0, 0, math.pi / 2), [1, 2, 3]), 1e-9
    )


def test_the_same_question_has_the_same_answer(doosan: ad.Robot) -> None:
    X = doosan.forward_kinematics(
        random_positions(doosan, np.random.default_rng(5)), "link6"
    )

    assert doosan.solve_ik("link6", X) == doosan.solve_ik("link6", X)


# Of 200 poses that the robot reaches, all but one: 99.5 %; pinocchio judges.
@pytest.mark.slow
def test_poses_that_are_reachable_are_reached(doosan: ad.Robot, tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(doosan.description.source)
    data, rng = model.createData(), np.random.default_rng(3)
    frame, failures = model.getFrameId("link6"), 0

    for _ in range(200):
        X = doosan.forward_kinematics(random_positions(doosan, rng), "link6")
        solution = doosan.solve_ik("link6", X)
        q = [solution.positions[name] for name in model.names[1:]]
        pin.framesForwardKinematics(model, data, np.array(q))
        found = data.oMf[frame]
        miss = found.rotation.T @ X.rotation().matrix()
        failures += np.linalg.norm(found.translation - X.translation()) > 1e-4
        failures += np.trace(miss) < 1.0 + 2.0 * math.cos(1e-3)
        failures += bool(np.any(q < model.lowerPositionLimit))
        failures += bool(np.any(q > model.upperPositionLimit))

    assert failures == 0


def test_a_kinematic_loop_of_questions_closes(doosan: ad.Robot) -> None:
    positions = random_positions(doosan, np.random.default_rng(8))
    X = doosan.forward_kinematics(positions, "link6")

    solution = doosan.solve_ik("link6", X)

    found = doosan.forward_kinematics(solution.positions, "link6")
    assert found.IsNearlyEqualTo(X, 1e-4)
    for joint_info in doosan.description.movable_joints:
        limits, value = joint_info.limits, solution.positions[joint_info.name]
        assert limits.lower <= value <= limits.upper


BAD = [
    (
        {"frame": "tipp"},
        "no link 'tipp'; did you mean 'tip'? known: base, lower, tip, upper",
    ),
    (
        {"pose": [0, 0, 1]},
        "pose: expected a RigidTransform, or x, y, z [m], roll, pitch, yaw [rad]; "
        "got [0, 0, 1]",
    ),
    (
        {"pose": [0, 0, math.nan, 0, 0, 0]},
        "pose: expected a RigidTransform, or x, y, z [m], roll, pitch, yaw [rad], all "
        "finite, up to 1e+09; got [0, 0, nan, 0, 0, 0]",
    ),
    (
        {"pose": [1e300, 0, 0, 0, 0, 0]},
        "pose: expected a RigidTransform, or x, y, z [m], roll, pitch, yaw [rad], all "
        "finite, up to 1e+09; got [1e+300, 0, 0, 0, 0, 0]",
    ),
    (
        {"pose": RigidTransform([0.0, 0.0, 1e300])},
        "pose: expected finite numbers up to 1e+09",
    ),
    ({"seed": [0] * 2}, "seed: expected joint positions by name, got [0, 0]"),
    (
        {"seed": {"elbow": True}},
        "joint 'elbow': expected a finite number [rad or m], got True",
    ),
    (
        {"mask": "abcdef"},
        "mask: expected six flags, for x, y, z and turns about x, y, z, with one that "
        "is set; got 'abcdef'",
    ),
    ({"group": [3]}, "group: expected its name or its joints, got [3]"),
    ({"group": [["elbow"]]}, "group: expected its name or its joints, got [['elbow']]"),
    (
        # As of a quaternion that isn't of length 1.
        {"pose": RigidTransform(RotationMatrix(2.0 * np.eye(3)), [1.0, 1.0, 0.0])},
        "pose: expected a rotation, whose axes have the length 1 and are at right "
        "angles; got [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]",
    ),
    (
        {"seed": {"elbo": 1.0}},
        "no joint 'elbo'; did you mean 'elbow'? known: elbow, shoulder",
    ),
    (
        {"seed": {"elbow": math.inf}},
        "joint 'elbow': expected a finite number [rad or m], got inf",
    ),
    (
        {"mask": (False,) * 6},
        "mask: expected six flags, for x, y, z and turns about x, y, z, with one that "
        "is set; got [False, False, False, False, False, False]",
    ),
    (
        {"tolerance": (0.0, 1.0)},
        "tolerance: expected two positive numbers [m] and [rad], got [0.0, 1.0]",
    ),
    (
        {"frame": "base"},
        "no joint moves link 'base'; expected one of those that carry it: none",
    ),
    ({"group": []}, "group: expected at least one joint"),
    (
        {"group": "arm"},
        "no planning group 'arm'; known: joint_trajectory_controller",
    ),
]


@pytest.mark.parametrize(("wrong", "message"), BAD)
def test_bad_arguments(planar: ad.Robot, wrong: dict, message: str) -> None:
    arguments = {"frame": "tip", "pose": [1, 1, 0, 0, 0, 0], **wrong}

    with pytest.raises(ad.ArmDrakeError) as caught:
        planar.solve_ik(**arguments)

    assert str(caught.value) == message


def test_numbers_of_numpy_are_numbers(planar: ad.Robot) -> None:
    seed = {"shoulder": np.int64(0), "elbow": np.float32(1.0)}

    by_numpy = planar.solve_ik("tip", [1, 1, 0, 0, 0, 0], seed=seed, mask=POSITION)
    by_python = planar.solve_ik(
        "tip", [1, 1, 0, 0, 0, 0], seed={"shoulder": 0, "elbow": 1.0}, mask=POSITION
    )

    assert by_numpy.positions == by_python.positions


def test_what_is_no_robot_and_no_positions_by_name(planar: ad.Robot) -> None:
    for wrong, message in [
        (
            lambda: ad.forward_kinematics("planar", {}, "tip"),
            "robot: expected a Robot, as load_robot returns it, got 'planar'",
        ),
        (
            lambda: ad.planning_groups(None),
            "robot: expected a Robot, as load_robot returns it, got None",
        ),
        (
            lambda: planar.forward_kinematics([0.1, 0.2], "tip"),
            "positions: expected joint positions by name, got [0.1, 0.2]",
        ),
        (
            lambda: planar.solve_ik("tip", [1, 1, 0, 0, 0, 0], collision_free="no"),
            "collision_free: expected True or False, got 'no'",
        ),
    ]:
        with pytest.raises(InputError) as caught:
            wrong()
        assert str(caught.value) == message


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "tolerance", "message"),
    [
        (
            "link6",
            3,
            "tolerance: expected two positive numbers [m] and [rad], got 3",
        ),
        (
            "link6",
            (1e-3, "far"),
            "tolerance: expected two positive numbers [m] and [rad], "
            "got [0.001, 'far']",
        ),
        (3, (1e-3, 1e-3), "frame: expected a link's name, got 3"),
    ],
)
def test_arguments_of_another_kind_are_one_message(
    frame: object, tolerance: object, message: str
) -> None:
    robot = ad.load_robot("doosan_a0912")

    with pytest.raises(InputError) as caught:
        robot.solve_ik(frame, [0.4, 0.2, 0.6, 0, 0, 0], tolerance=tolerance)

    assert str(caught.value) == message
