"""Requests in space: points, points in a time, home; and plans sent as positions."""

import re

import numpy as np
import pinocchio as pin
import pytest

import arm_drake as ad
from arm_drake.errors import InputError, MotionError
from arm_drake.simulation.motion_files import parse_motion

JOINTS = [f"joint{number}" for number in range(1, 7)]

# A goal of the published client [m], in the frame of link0.
POINT = {"x": 0.351, "y": -0.288, "z": 0.351}


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("centauri")


@pytest.fixture
def simulation(robot: ad.Robot) -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(robot))


def point_of(robot: ad.Robot, q_list: tuple[float, ...]) -> np.ndarray:
    """Return where pinocchio has link6, in the frame of link0 [m]."""
    model = pin.buildModelFromXML(robot.description.source)
    data, q = model.createData(), pin.neutral(model)
    for joint, value in zip(JOINTS, q_list, strict=True):
        q[model.joints[model.getJointId(joint)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    base, end = (data.oMf[model.getFrameId(name)] for name in ("link0", "link6"))
    return np.array((base.inverse() * end).translation)


def arm_of(simulation: ad.Simulation) -> np.ndarray:
    state = simulation.joint_states()
    values = dict(zip(state.name, state.position, strict=True))
    return np.array([values[name] for name in JOINTS])


@pytest.mark.slow
def test_a_point_is_answered_with_joint_positions_which_the_arm_takes(
    robot: ad.Robot, simulation: ad.Simulation
) -> None:
    result = simulation.topic("/centauri/kinematics").call(POINT)

    assert result.success
    assert np.allclose(point_of(robot, result.q_list), list(POINT.values()), atol=1e-4)
    (sent,) = simulation.mailbox.sent
    assert sent.port == "joint_group_position_controller.commands"
    assert tuple(sent.message.data) == result.q_list
    simulation.advance_to(2.0)
    assert np.allclose(arm_of(simulation), result.q_list, atol=0.01)
    home = simulation.topic("/centauri/home")
    assert repr(home) == "<TopicHandle '/centauri/home'>"
    assert not home.call(False).success
    assert home.call({"data": True}).success
    assert simulation.mailbox.sent[-1].message.data == (0.0,) * 6


@pytest.mark.slow
def test_a_point_in_a_time_is_a_polynomial_of_degree_five(
    robot: ad.Robot, simulation: ad.Simulation
) -> None:
    result = simulation.topic("/centauri/trajectory").call({**POINT, "time_range": 0.5})

    simulation.advance_to(0.6)

    sent = [each for each in simulation.mailbox.sent if "commands" in each.port]
    times = np.array([each.time for each in sent])
    s = np.clip(times / 0.5, 0.0, 1.0)
    part = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
    expected = part[:, np.newaxis] * np.array(result.q_list)
    assert len(sent) == 51
    assert np.allclose([each.message.data for each in sent], expected, atol=1e-6)


@pytest.mark.slow
def test_a_controller_that_is_not_active_takes_no_plan(robot: ad.Robot) -> None:
    name = "joint_group_position_controller"
    options = ad.SimulationOptions(inactive=(name,))
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))

    with pytest.raises(InputError, match=f"controller '{name}' is inactive"):
        simulation.move_to({"joint1": 0.3})

    assert not simulation.mailbox.sent


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "data", "words"),
    [
        ("kinematics", {"x": 1.0, "w": 2.0}, "no field w"),
        ("kinematics", {"x": float("nan")}, "x: expected a finite number, got nan"),
        ("kinematics", [1.0, 2.0, 3.0], "expected {x, y, z}"),
        ("trajectory", POINT, "time_range: expected 0.01 to 10000 s, got 0.0"),
        ("trajectory", {**POINT, "time_range": 1e12}, "expected 0.01 to 10000 s"),
        ("trajectory", {**POINT, "time_range": 0.05}, "the joints' limits of speed"),
        ("home", 1.0, "expected {data}"),
        ("home", {"data": "yes"}, "data: expected true or false"),
    ],
)
def test_what_cannot_be_asked_is_one_message(
    simulation: ad.Simulation, topic: str, data: object, words: str
) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        simulation.topic(f"/centauri/{topic}").call(data)
    assert not simulation.mailbox.sent


def test_a_point_out_of_reach_moves_nothing_and_is_reported(
    simulation: ad.Simulation,
) -> None:
    motion = parse_motion(
        [{"topic": "/centauri/kinematics", "data": {"x": 3.0, "z": 0.3}}]
    )

    simulation.run(0.02, motion=motion)

    assert not simulation.mailbox.sent
    (refused,) = simulation.rejected
    text = simulation.mailbox.describe(refused)
    assert "/centauri/kinematics: the point is missed by 2." in text
    result = simulation.topic("/centauri/kinematics").call({"x": 3.0, "z": 0.3})
    assert not result.success
    # What is missed is the way from where the answer puts the arm.
    assert result.error > 2.0


@pytest.mark.slow
def test_a_robot_with_a_trajectory_controller_is_asked_alike() -> None:
    doosan = ad.load_robot("doosan_a0912")
    simulation = ad.Simulation(ad.build_diagram(doosan))
    result = simulation.topic(f"/{doosan.name}/kinematics").call(
        {"x": 0.4, "y": 0.2, "z": 0.6}
    )

    simulation.advance_to(2.0)

    assert result.success
    X = simulation.link_poses()["link6"]
    assert np.allclose(X.translation(), [0.4, 0.2, 0.6], atol=5e-3)


@pytest.mark.slow
def test_a_plan_is_sent_position_by_position_without_a_trajectory_controller(
    simulation: ad.Simulation,
) -> None:
    motion = parse_motion(
        [
            {"plan_to": {"positions": {"joint1": 0.4, "joint2": 0.3}}},
            {"plan_to": {"state": "home"}},
        ]
    )

    simulation.run(4.0, motion=motion)

    assert not simulation.rejected
    sent = np.array([each.message.data for each in simulation.mailbox.sent])
    assert np.allclose(np.max(sent[:, :2], axis=0), [0.4, 0.3], atol=1e-9)
    assert np.allclose(sent[-1], 0.0, atol=1e-9)
    plan = simulation.move_to({"joint1": -0.3})
    assert plan.group.name == "joint_group_position_controller"
    assert plan.frame == "tool_center"
    assert np.allclose(arm_of(simulation), [-0.3, 0, 0, 0, 0, 0], atol=0.02)


@pytest.mark.slow
def test_an_unknown_request_is_an_unknown_topic(simulation: ad.Simulation) -> None:
    with pytest.raises(InputError, match="/other/home"):
        simulation.topic("/other/home")
    with pytest.raises(InputError, match="gives no answer"):
        simulation.topic("/joint_states").call(None)
    motion = parse_motion([{"topic": "/centauri/kinematics", "data": 3.0}])
    with pytest.raises(MotionError, match=r"expected \{x, y, z\}"):
        simulation.run(motion=motion)
