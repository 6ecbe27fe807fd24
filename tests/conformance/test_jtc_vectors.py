"""Closed loops with a joint_trajectory_controller, most of them upstream's own tests.

Rows V27 to V45, T13, T14, C1 to C37 and A1 to A16 of the list of conformance vectors;
each test names its rows. Joints are at (1.1, 2.1, 3.1) and go where they are commanded
to be, unless they are `separate`; cycles are 10 ms.
"""

import math
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.errors import ParameterError
from arm_drake.messages import (
    NANOSECONDS,
    CancelGoal,
    Duration,
    FollowJointTrajectoryGoal,
    GoalEvent,
    GoalStatus,
    Header,
    JointTrajectory,
    JointTrajectoryControllerState,
    JointTrajectoryPoint,
    SendGoal,
    SpeedScalingFactor,
    Time,
    TopicRejected,
)
from tests import models
from tests.controllers.mirrored import Mirrored
from tests.controllers.parameters import JTC

JOINTS = ("joint1", "joint2", "joint3")
START = (1.1, 2.1, 3.1)
FIRST, LAST = (3.3, 4.4, 5.5), (10.10, 11.11, 12.12)

POSITION = ("position",)
BOTH = ("position", "velocity")
ALL = ("position", "velocity", "acceleration")
VELOCITY = ("velocity",)
EFFORT = ("effort",)
POSITION_EFFORT = ("position", "effort")

STATUS = GoalStatus
CLOSE = 1e-3


def each(name: str, *values: float) -> dict[str, float]:
    """Return parameters of all joints; one value is for all of them."""
    values = values * len(JOINTS) if len(values) == 1 else values
    return {name.format(j): v for j, v in zip(JOINTS, values, strict=True)}


def make(
    command: Sequence[str] = POSITION,
    state: Sequence[str] = BOTH,
    settings: dict[str, Any] | None = None,
    *,
    velocity: Sequence[float] = (0.0, 0.0, 0.0),
    acceleration: Sequence[float] = (0.0, 0.0, 0.0),
    others: dict[str, float] | None = None,
    **options: Any,
) -> Mirrored:
    """Return a controller of three joints on its hardware."""
    states = {}
    for name, values in (
        ("position", START),
        ("velocity", velocity),
        ("acceleration", acceleration),
    ):
        states |= {f"{j}/{name}": x for j, x in zip(JOINTS, values, strict=True)}
    parameters = {
        "joints": list(JOINTS),
        "command_interfaces": list(command),
        "state_interfaces": list(state),
        "allow_nonzero_velocity_at_trajectory_end": True,
        **(settings or {}),
    }
    states |= others or {}
    return Mirrored(JTC, parameters, joints=JOINTS, states=states, **options)


def message(
    *points: tuple[float, Sequence[float]],
    joints: Sequence[str] = JOINTS,
    stamp_ns: int = 0,
    **vectors: Sequence[Sequence[float]],
) -> JointTrajectory:
    """Return a trajectory; a point is its time [s] and positions."""
    return JointTrajectory(
        Header(Time.from_nanoseconds(stamp_ns)),
        tuple(joints),
        [
            JointTrajectoryPoint(
                positions,
                time_from_start=time,
                **{name: rows[i] for name, rows in vectors.items()},
            )
            for i, (time, positions) in enumerate(points)
        ],
    )


def goal(trajectory: JointTrajectory, **fields: Any) -> SendGoal:
    return SendGoal(FollowJointTrajectoryGoal(trajectory, **fields))


def t3(spacing: float = 0.25) -> JointTrajectory:
    """Return the trajectory that most of upstream's tests have."""
    return message(
        (spacing, FIRST),
        (2 * spacing, (7.7, 8.8, 9.9)),
        (3 * spacing, LAST),
        velocities=[[v] * 3 for v in (0.01, 0.05, 0.06)],
    )


def knots() -> JointTrajectory:
    """Return positions and efforts whose third joint turns by more than pi at first."""
    return message(
        (0.3, (3.3, 4.4, 6.6)),
        (0.6, (7.7, 8.8, 9.9)),
        (0.9, LAST),
    )


def with_efforts(trajectory: JointTrajectory) -> JointTrajectory:
    efforts = ((0.3, 0.4, 0.6), (1.7, 1.8, 1.9), (2.3, 2.4, 2.5))
    points = [
        JointTrajectoryPoint(p.positions, effort=u, time_from_start=p.time_from_start)
        for p, u in zip(trajectory.points, efforts, strict=True)
    ]
    return JointTrajectory(joint_names=JOINTS, points=points)


def plan_of(loop: Mirrored) -> Any:
    return loop.context.get_abstract_state(0).get_value().state.control.plan


def num_points(loop: Mirrored) -> int:
    """Return how many points the trajectory has that is being followed."""
    return len(plan_of(loop).trajectory.times_ns)


def report(loop: Mirrored) -> JointTrajectoryControllerState:
    state: JointTrajectoryControllerState = loop.output("controller_state")
    return state


def seconds(duration: Duration) -> float:
    return duration.to_seconds()


def joint1(loop: Mirrored) -> list[float]:
    return [row[0] for row in loop.rows]


# Where the parameters are judged


@pytest.mark.parametrize(
    ("command", "state"),
    [
        pytest.param([], BOTH, id="V27"),
        pytest.param(["bad_name"], BOTH, id="V28"),
        pytest.param(["effort", "velocity"], BOTH, id="V29a"),
        pytest.param(["effort", "acceleration"], BOTH, id="V29b"),
        pytest.param(["effort", "velocity", "acceleration"], BOTH, id="V29c"),
        pytest.param(["velocity", "acceleration"], BOTH, id="V30"),
        pytest.param(["acceleration"], BOTH, id="V31"),
        *(
            pytest.param(command, state, id=f"V32-{'-'.join(command)}-{i}")
            for command in (POSITION, VELOCITY, EFFORT, ALL)
            for i, state in enumerate(
                (
                    [],
                    ["effort"],
                    ["bad_name"],
                    ["velocity"],
                    ["velocity", "acceleration"],
                    ["acceleration"],
                )
            )
        ),
        pytest.param(VELOCITY, POSITION, id="V33"),
        pytest.param(EFFORT, POSITION, id="V34"),
        pytest.param(["effort", "position"], POSITION, id="V35"),
    ],
)
def test_interfaces_that_do_not_go_together_are_refused(command, state):
    with pytest.raises(ParameterError, match="_interfaces"):
        make(command, state)


@pytest.mark.parametrize(
    ("command", "state"),
    [
        *(
            (command, state)
            for command in (POSITION, BOTH, ALL)
            for state in (POSITION, BOTH, ALL)
        ),
        *(
            (command, state)
            for command in (VELOCITY, EFFORT, POSITION_EFFORT)
            for state in (BOTH, ALL)
        ),
    ],
)
def test_interfaces_that_go_together_become_active(command, state):  # V36
    loop = make(command, state)

    tick = loop.tick()

    assert tick.is_ok
    assert tick.activation is not None
    assert np.isfinite(tick.command).all()


@pytest.mark.parametrize(
    "joints",
    [
        pytest.param([*JOINTS, "joint4"], id="V37"),
        pytest.param(["joint1", "joint_4"], id="V38"),
    ],
)
def test_joints_to_command_must_be_some_of_the_joints(joints):
    with pytest.raises(ParameterError, match="command_joints must be some of"):
        make(settings={"command_joints": joints})


def test_some_joints_can_be_left_uncommanded():  # V39
    loop = make(BOTH, ALL, {"command_joints": ["joint1", "joint2"]})

    loop.run(0.1, joint_trajectory=t3())

    claims, read = loop.system.command_interfaces, loop.system.state_interfaces
    assert (len(claims), len(read)) == (2 * 2, 3 * 3)
    output = report(loop).output
    assert np.isfinite([output.positions[:2], output.velocities[:2]]).all()
    assert np.isnan([output.positions[2], output.velocities[2]]).all()


def test_joints_can_be_commanded_by_other_names():  # V40
    names = [f"following_controller/{joint}" for joint in JOINTS]
    loop = make(settings={"command_joints": names})

    loop.run(0.25, joint_trajectory=t3())

    assert loop.system.command_interfaces == tuple(f"{n}/position" for n in names)
    assert loop.command() == pytest.approx(FIRST)


def test_a_description_must_be_one(tmp_path: Path):  # V41
    with pytest.raises(ad.ArmDrakeError, match="robot"):
        models.load(tmp_path, "<invalid_robot_description/>")


ARM = models.trajectory_controllers({"arm": ["swing"]})


def test_continuous_joints_need_no_limit(tmp_path: Path):  # V42
    urdf = models.pendulum().replace("revolute", "continuous")
    urdf = urdf.replace('<limit lower="-3" upper="3" effort="100" velocity="10"/>', "")
    assert "<limit" not in urdf

    robot = models.load(tmp_path, urdf, ARM)
    options = ad.SimulationOptions(preset="kinematic")
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))

    assert [c.state for c in simulation.list_controllers()] == ["active"]


@pytest.mark.parametrize(
    ("cmd_timeout", "ends"),
    [
        pytest.param(3.0, True, id="V43"),
        pytest.param(1.0, False, id="V44"),
    ],
)
def test_a_timeout_counts_if_it_exceeds_the_goal_time(cmd_timeout, ends):
    parameters = {"cmd_timeout": cmd_timeout, "constraints.goal_time": 2.0}
    loop = make(settings=parameters)

    loop.run(3.0, joint_trajectory=t3(spacing=0.05))
    assert num_points(loop) == 3
    loop.run(0.3)

    assert (num_points(loop) == 1) is ends


@pytest.mark.parametrize("which", ["state_interface", "command_interface"])
def test_an_interface_for_scaling_must_be_there(tmp_path: Path, which: str):  # V45
    yaml = models.trajectory_controllers(
        {"arm": ["swing"]}, speed_scaling=f"{{{which}: idontexist/factor}}"
    )
    robot = models.load(tmp_path, models.pendulum(), yaml)

    simulation = ad.Simulation(ad.build_diagram(robot))

    assert [c.state for c in simulation.list_controllers()] == ["inactive"]
    assert "idontexist" in str(simulation.report)


# Tolerances of the parameters


def tolerances_of(loop: Mirrored) -> tuple[Any, ...]:
    rules = plan_of(loop).rules
    path, end = rules.tolerances.path, rules.tolerances.goal
    return (
        rules.tolerances.goal_time,
        path.position.tolist(),
        end.position.tolist(),
        end.velocity.tolist(),
    )


def test_without_constraints_only_the_last_velocity_is_limited():  # T13
    loop = make()

    loop.tick()

    assert tolerances_of(loop) == (0.0, [0.0] * 3, [0.0] * 3, [0.01] * 3)


def test_constraints_change_while_the_controller_runs():  # T14
    loop = make()
    loop.tick()

    loop.set_parameters(
        {
            "constraints.goal_time": 1.0,
            "constraints.stopped_velocity_tolerance": 0.02,
            **each("constraints.{}.trajectory", 1.0, 2.0, 3.0),
            **each("constraints.{}.goal", 10.0, 20.0, 30.0),
        }
    )

    assert tolerances_of(loop) == (
        1.0,
        [1.0, 2.0, 3.0],
        [10.0, 20.0, 30.0],
        [0.02] * 3,
    )


# Activation and deactivation

SETS = [POSITION, BOTH, ALL, VELOCITY, EFFORT, POSITION_EFFORT]


@pytest.mark.parametrize("command", SETS)
def test_an_active_controller_holds_where_the_joints_are(command):  # C1
    loop = make(command, ALL)

    loop.run(0.25)

    assert num_points(loop) == 1
    for name in command:
        expected = START if name == "position" else [0.0] * 3
        assert loop.command(name) == pytest.approx(expected, abs=CLOSE)


def run_for_150_ms(command: Sequence[str]) -> Mirrored:
    """Return a controller of 10 Hz whose second cycle is 0.15 s after the first."""
    loop = make(command, ALL, rate=10)
    loop.tick(joint_trajectory=t3())
    loop.time_ns += 50_000_000
    loop.tick(period_ns=150_000_000)
    return loop


@pytest.mark.parametrize("command", [POSITION, BOTH, ALL])
def test_the_command_is_one_nominal_period_ahead(command):  # C2
    loop = run_for_150_ms(command)

    assert loop.command() == pytest.approx(FIRST, abs=1e-9)


@pytest.mark.parametrize("command", SETS)
def test_a_deactivation_leaves_positions_and_zeros_the_rest(command):  # C3
    loop = run_for_150_ms(command)
    before = loop.command()

    tick = loop.tick(active=False)

    assert tick.activation is None
    # There is no active trajectory to ask about.
    now = Time.from_nanoseconds(loop.time_ns)
    assert not loop.system.query_state(loop.context, now).success
    assert loop.command() == before
    for name in command:
        if name != "position":
            assert loop.command(name) == [0.0] * 3


@pytest.mark.parametrize("command", [POSITION, BOTH, ALL, POSITION_EFFORT])
def test_a_second_activation_holds_what_was_commanded(command):  # C4
    loop = run_for_150_ms(command)
    before = loop.command()
    for _ in range(30):
        loop.tick(active=False)

    loop.run(0.5)

    assert num_points(loop) == 1
    assert loop.command() == pytest.approx(before, abs=CLOSE)


def commanded(*values: float) -> dict[str, float]:
    """Return commands of all joints from those of the first; others 1 and 0.1 above."""
    steps = (1.0, 1.0, 0.1)
    return {
        f"{joint}/{name}": value + k * step
        for name, value, step in zip(ALL, values, steps, strict=False)
        for k, joint in enumerate(JOINTS)
    }


def quintic(
    a: Sequence[float], b: Sequence[float], duration: float, tau: float
) -> float:
    """Return the position of the polynomial between two (q, v, a)."""
    (qa, va, aa), (qb, vb, ab), d = a, b, duration
    c3 = (20 * (qb - qa) - (12 * va + 8 * vb) * d - (3 * aa - ab) * d**2) / (2 * d**3)
    c4 = (30 * (qa - qb) + (16 * va + 14 * vb) * d + (3 * aa - 2 * ab) * d**2) / (
        2 * d**4
    )
    c5 = (12 * (qb - qa) - 6 * (va + vb) * d - (aa - ab) * d**2) / (2 * d**5)
    return float(np.polyval([c5, c4, c3, aa / 2, va, qa], tau))


@pytest.mark.parametrize("command", [POSITION, BOTH, ALL])
@pytest.mark.parametrize(
    ("commands", "takes_commands"),
    [
        pytest.param({}, True, id="C20"),
        pytest.param(commanded(3.1, 0.25, 0.02), True, id="C21"),
        pytest.param(commanded(3.1, 0.25, 0.02), False, id="C22"),
    ],
)
def test_a_controller_starts_from_what_was_commanded_before(
    command, commands, takes_commands
):
    name = "set_last_command_interface_value_as_state_on_activation"
    parameters = {name: takes_commands, "interpolate_from_desired_state": True}
    loop = make(
        command,
        ALL,
        parameters,
        velocity=(0.5, 0.6, 0.7),
        acceleration=(0.8, 0.9, 1.0),
        commands={n: x for n, x in commands.items() if n.rpartition("/")[2] in command},
        separate=True,
    )
    zeros = [[0.0] * 3]

    loop.tick(
        joint_trajectory=message((1.0, LAST), velocities=zeros, accelerations=zeros)
    )

    expected = []
    for k, joint in enumerate(JOINTS):
        start = [
            loop_start(joint, kind, commands if kind in command else {}, takes_commands)
            for kind in ALL
        ]
        expected.append(quintic(start, (LAST[k], 0.0, 0.0), 1.0, 0.01))
    assert loop.command() == pytest.approx(expected, abs=1e-9)


def loop_start(
    joint: str, kind: str, commands: dict[str, float], takes_commands: bool
) -> float:
    """Return a commanded quantity if it counts, else the measured one."""
    measured = {"position": START, "velocity": (0.5, 0.6, 0.7)}.get(
        kind, (0.8, 0.9, 1.0)
    )[JOINTS.index(joint)]
    return commands.get(f"{joint}/{kind}", measured) if takes_commands else measured


# Commands and errors


def test_a_knot_is_commanded_one_tick_before_its_time():  # C5
    loop = make(separate=True)

    loop.run(0.3, joint_trajectory=knots())

    assert seconds(report(loop).reference.time_from_start) == pytest.approx(0.29)
    assert loop.command() == pytest.approx((3.3, 4.4, 6.6), abs=1e-9)


@pytest.mark.parametrize(
    ("joint_type", "last"),
    [
        pytest.param("revolute", 35.0, id="C6"),
        pytest.param("continuous", -27.8318531, id="C7"),
    ],
)
def test_velocities_follow_from_errors(joint_type, last):
    parameters = each("gains.{}.p", 10.0)
    loop = make(VELOCITY, BOTH, parameters, separate=True, joint_type=joint_type)

    loop.run(0.31, joint_trajectory=knots())

    assert loop.command("velocity") == pytest.approx((22.0, 23.0, last), abs=1e-6)
    assert report(loop).error.positions[2] == pytest.approx(last / 10.0, abs=1e-8)


def test_efforts_are_those_of_errors_and_of_the_trajectory():  # C8
    parameters = each("gains.{}.p", 10.0)
    loop = make(EFFORT, BOTH, parameters, separate=True)

    loop.run(0.31, joint_trajectory=with_efforts(knots()))

    # The knot's errors and, a period later, the efforts on their way to the next one.
    ahead = [0.3 + 1.4 / 30, 0.4 + 1.4 / 30, 0.6 + 1.3 / 30]
    expected = np.array([22.0, 23.0, 35.0]) + ahead
    assert loop.command("effort") == pytest.approx(expected, abs=1e-9)


def test_efforts_beside_positions_are_those_of_the_present():  # C9
    loop = make(POSITION_EFFORT, BOTH)

    loop.run(0.31, joint_trajectory=with_efforts(knots()))

    assert loop.command("effort") == pytest.approx((0.3, 0.4, 0.6), abs=1e-9)


def test_joints_come_in_any_order():  # C10
    loop = make()
    joints = ("joint2", "joint3", "joint1")

    loop.run(0.25, joint_trajectory=message((0.25, (2.0, 3.0, 1.0)), joints=joints))

    assert loop.command() == pytest.approx((1.0, 2.0, 3.0), abs=CLOSE)


@pytest.mark.parametrize(
    ("command", "vectors"),
    [
        (POSITION, {}),
        (BOTH, {"velocities": [(2.0, 1.0)]}),
        (ALL, {"velocities": [(2.0, 1.0)], "accelerations": [(0.2, 0.1)]}),
        (POSITION_EFFORT, {"effort": [(2.0, 1.0)]}),
    ],
)
def test_joints_that_are_left_out_stay(command, vectors):  # C11, V26
    loop = make(command, ALL, {"allow_partial_joints_goal": True})
    point = message((0.25, (2.0, 1.0)), joints=("joint2", "joint1"), **vectors)

    loop.tick()
    loop.run(0.26, joint_trajectory=point)

    assert loop.command() == pytest.approx((1.0, 2.0, 3.1), abs=CLOSE)
    for name in command[1:]:
        assert loop.command(name)[2] == 0.0


def test_joints_must_not_be_left_out_unasked():  # V25
    loop = make()

    loop.run(
        0.25, joint_trajectory=message((0.25, (2.0, 1.0)), joints=("joint2", "joint1"))
    )

    assert [type(event) for event in loop.events] == [TopicRejected]
    assert loop.command() == pytest.approx(START)


@pytest.mark.parametrize(
    ("joint_type", "turn", "error"),
    [
        pytest.param("continuous", 1.5 * pi, -0.5 * pi, id="C12"),
        pytest.param("revolute", 0.75 * pi, 0.75 * pi, id="C13"),
    ],
)
def test_errors_of_continuous_joints_are_the_shortest_turns(joint_type, turn, error):
    types = {**dict.fromkeys(JOINTS, "revolute"), "joint1": joint_type}
    loop = make(separate=True, joint_type=types)
    desired = [q + turn for q in START]

    loop.tick(joint_trajectory=message((0.0, desired)))

    expected = (error, turn, turn)
    assert report(loop).error.positions == pytest.approx(expected, abs=1e-9)


# Tolerances and timeouts of trajectories


def test_off_its_path_a_motion_is_aborted():  # C14
    loop = make(settings=each("constraints.{}.trajectory", 1e-4), separate=True)

    loop.run(0.25, joint_trajectory=t3(spacing=0.1))

    assert num_points(loop) == 1
    assert plan_of(loop).is_holding
    assert loop.command() == pytest.approx(START, abs=CLOSE)


def test_late_at_its_goal_a_motion_is_aborted():  # C15
    parameters = {**each("constraints.{}.goal", 0.1), "constraints.goal_time": 1e-6}
    loop = make(settings=parameters, separate=True)

    loop.run(0.35, joint_trajectory=t3(spacing=0.1))

    assert num_points(loop) == 1
    assert loop.command() == pytest.approx(START, abs=CLOSE)

    loop.states |= {f"{joint}/position": 0.0 for joint in JOINTS}
    loop.run(0.25)

    assert loop.command() == pytest.approx(START, abs=CLOSE)


@pytest.mark.parametrize(
    ("cmd_timeout", "last_points", "velocity"),
    [
        pytest.param(0.1, 1, 0.0, id="C16"),
        pytest.param(0.0, 3, 0.06, id="C17"),
    ],
)
def test_after_a_timeout_the_last_point_is_held(cmd_timeout, last_points, velocity):
    loop = make(BOTH, BOTH, {"cmd_timeout": cmd_timeout})

    loop.run(0.76, joint_trajectory=t3())
    assert num_points(loop) == 3
    loop.run(0.25)

    assert num_points(loop) == last_points
    assert report(loop).reference.positions == pytest.approx(LAST, abs=CLOSE)
    assert loop.command("velocity") == pytest.approx([velocity] * 3)


# Where a trajectory starts


def follow_with_an_offset(*, from_desired: bool) -> list[float]:
    """Return commands of joints that are 0.3 behind; the first one was at 3.3."""
    parameters = {"interpolate_from_desired_state": from_desired}
    loop = make(POSITION, POSITION, parameters, separate=True)

    def measure(first: float) -> None:
        loop.states |= {f"{joint}/position": first - 0.3 for joint in JOINTS}

    measure(3.6)
    loop.run(0.05)
    measure(3.3)
    sent = message((1.0, (6.6, 6.6, 6.6)), velocities=[(0.66,) * 3])
    # Held at 3.3 and measured at 3.0 from now on.
    assert joint1(loop)[-1] == pytest.approx(3.3)
    for k in range(100):
        loop.tick(**({"joint_trajectory": sent} if k == 0 else {}))
        measure(joint1(loop)[-1])
    return joint1(loop)[5:]


def test_a_motion_from_the_measured_state_jumps_back():  # C18
    first, *_ = follow_with_an_offset(from_desired=False)

    assert 3.0 < first < 3.3
    assert first == pytest.approx(3.0 + 3.6 * 0.01, abs=0.1)


def test_a_motion_from_the_desired_state_does_not_jump():  # C19
    commands = follow_with_an_offset(from_desired=True)

    assert commands[0] >= 3.3
    assert commands[0] == pytest.approx(3.3, abs=0.1)
    assert (np.diff(commands) >= 0.0).all()
    assert commands[-1] == pytest.approx(6.6, abs=0.01)


# Speed scaling


def factors(loop: Mirrored, *values: float) -> None:
    for value in values:
        loop.tick(speed_scaling_input=SpeedScalingFactor(value))


@pytest.mark.parametrize(
    ("values", "factor"), [((0.765,), 0.765), ((0.0,), 0.0), ((0.45, -0.12), 0.45)]
)
def test_factors_come_in_messages(values, factor):  # C23
    loop = make()
    loop.tick()

    factors(loop, *values)

    assert report(loop).speed_scaling_factor == factor


FACTOR = "scaling/factor"


@pytest.mark.parametrize(
    ("state", "expected"), [(None, 0.123), (1.0, 1.0)], ids=["none", "state"]
)
def test_the_first_factor_is_a_parameter_unless_it_is_measured(state, expected):  # C24
    parameters = {"speed_scaling.initial_scaling_factor": 0.123}
    if state is not None:
        parameters["speed_scaling.state_interface"] = FACTOR
    loop = make(settings=parameters, others={} if state is None else {FACTOR: state})

    loop.tick()

    assert report(loop).speed_scaling_factor == expected


def test_a_factor_goes_through_hardware_that_tells_it():  # C24
    parameters = {
        "speed_scaling.initial_scaling_factor": 0.123,
        "speed_scaling.state_interface": FACTOR,
        "speed_scaling.command_interface": FACTOR,
    }
    loop = make(settings=parameters, others={FACTOR: 0.123})

    loop.run(0.02)
    assert report(loop).speed_scaling_factor == 0.123
    factors(loop, 0.765)
    loop.tick()

    assert report(loop).speed_scaling_factor == 0.765


@pytest.mark.parametrize("factor", [0.25, 0.87, 1.0, 2.0])
def test_time_passes_at_the_factor(factor):  # C25
    loop = make(settings={"speed_scaling.initial_scaling_factor": factor})
    sent = goal(message((0.1, (4.0, 5.0, 6.0)), (0.2, (7.0, 8.0, 9.0))))
    # The goal is reached as soon as its end is less than a cycle ahead.
    num_cycles = math.ceil(0.19 / factor * 100 - 1e-6) + 1

    for k in range(num_cycles):
        loop.tick(**({"follow_joint_trajectory": sent} if k == 0 else {}))
        state, time = report(loop), k * 0.01 * factor
        for joint, (start, q1, q2) in enumerate(
            zip(START, (4.0, 5.0, 6.0), (7.0, 8.0, 9.0), strict=True)
        ):
            expected = np.interp(time, (0.0, 0.1, 0.2), (start, q1, q2))
            # Times are cut to whole nanoseconds.
            assert state.reference.positions[joint] == pytest.approx(expected, abs=1e-5)
        desired = seconds(state.reference.time_from_start)
        actual = seconds(state.feedback.time_from_start)
        assert desired == pytest.approx(factor * actual, rel=1e-3)
    loop.run(0.1)

    assert loop.news_of(sent)[-1] == (STATUS.SUCCEEDED, 0)


def test_times_from_the_start_go_on_after_the_end():  # C26
    loop = make()

    loop.run(0.21, joint_trajectory=message((0.1, FIRST)))

    state = report(loop)
    assert seconds(state.reference.time_from_start) == pytest.approx(0.2, abs=0.01)
    assert seconds(state.feedback.time_from_start) == pytest.approx(0.2, abs=0.01)


# Braking

BRAKE = {
    "constraints.decelerate_on_cancel": True,
    **each("constraints.{}.max_deceleration_on_cancel", 10.0),
}


def cancel(loop: Mirrored, sent: SendGoal, *, after: float = 0.5) -> None:
    """Send a goal, and cancel it a while later; that cycle is the last one."""
    loop.run(after, follow_joint_trajectory=sent)
    loop.tick(follow_joint_trajectory=CancelGoal(sent))


def far() -> SendGoal:
    return goal(message((1.0, LAST)))


@pytest.mark.parametrize(
    ("velocity", "stops"),
    [
        pytest.param((0.2,) * 3, (0.002,) * 3, id="C27"),
        pytest.param((-0.2,) * 3, (-0.002,) * 3, id="C28"),
        pytest.param((0.2, -0.1, 0.0), (0.002, -0.0005, 0.0), id="C29"),
    ],
)
def test_joints_brake_at_their_decelerations(velocity, stops):
    loop = make(BOTH, BOTH, BRAKE, velocity=velocity, velocity_limit=1.0, separate=True)

    cancel(loop, far())

    # After 10 ms, and after 20 ms.
    v1 = np.sign(velocity) * np.maximum(np.abs(velocity) - 0.1, 0.0)
    q1 = np.array(START) + (np.array(velocity) + v1) / 2 * 0.01
    assert num_points(loop) > 1
    assert plan_of(loop).is_holding
    assert loop.command() == pytest.approx(q1, abs=1e-9)
    assert loop.command("velocity") == pytest.approx(v1, abs=1e-9)
    loop.run(0.2)
    assert loop.command() == pytest.approx(np.array(START) + stops, abs=1e-9)
    assert loop.command("velocity") == pytest.approx([0.0] * 3)
    reference = report(loop).reference.positions
    assert reference == pytest.approx(np.array(START) + stops, abs=1e-9)


@pytest.mark.parametrize(
    ("parameters", "state"),
    [
        ({"constraints.decelerate_on_cancel": True}, BOTH),
        (BRAKE, POSITION),
    ],
)
def test_without_numbers_to_brake_by_joints_hold(parameters, state):  # C30, A10
    loop = make(
        POSITION,
        state,
        parameters,
        velocity=(0.2,) * 3,
        velocity_limit=1.0,
        separate=True,
    )
    sent = far()

    cancel(loop, sent)
    loop.run(0.2)

    assert num_points(loop) == 1
    assert loop.command() == pytest.approx(START)
    assert loop.news_of(sent)[-1] == (STATUS.CANCELED, 0)


# Replacement while moving


def test_a_blend_starts_where_the_old_motion_is():  # C31
    loop = make(settings={"speed_scaling.initial_scaling_factor": 0.5})
    old = message((1.0, (11.1, 12.1, 13.1)), (2.0, (21.1, 22.1, 23.1)))

    loop.run(1.0, joint_trajectory=old)
    before = np.array(report(loop).reference.positions)
    loop.tick(joint_trajectory=message((1.0, START), (2.0, LAST)))
    after = np.array(report(loop).reference.positions)

    assert np.abs(after - before).max() < 0.3
    assert plan_of(loop).num_prefix > 0


def stamp_in(loop: Mirrored, delay: float, since: int | None = None) -> int:
    start = loop.time_ns if since is None else since
    return start + round(delay * NANOSECONDS)


def test_until_its_stamp_the_old_motion_goes_on():  # C32
    loop = make()
    start, rest = loop.time_ns, START[1:]
    old = message((0.5, (10.0, *rest)), (1.0, (0.0, *rest)))

    loop.run(0.05, joint_trajectory=old)
    stamp = stamp_in(loop, 1.5, start)
    loop.run(1.5, joint_trajectory=message((0.5, (1.0, *rest)), stamp_ns=stamp))

    assert max(joint1(loop)) > 8.0


def test_joints_that_a_blend_leaves_out_go_on():  # C33
    loop = make(settings={"allow_partial_joints_goal": True})
    old = message((1.5, (11.1, 12.1, 13.1)), (3.0, (21.1, 22.1, 23.1)))
    new = message((0.4, (2.0, 3.0)), (0.9, (1.0, 2.0)), joints=JOINTS[:2])

    loop.run(0.3, joint_trajectory=old)
    loop.tick(joint_trajectory=new)
    first = loop.command()[2]
    loop.run(0.6)
    within = loop.command()[2]
    loop.run(0.6)

    assert within - first > 0.5
    assert loop.command()[2] - within > 0.5
    assert loop.command()[:2] == pytest.approx((1.0, 2.0), abs=CLOSE)


def test_the_old_motion_peaks_at_the_stamp_of_a_partial_one():  # C34
    loop = make(settings={"allow_partial_joints_goal": True})
    start, rest = loop.time_ns, START[1:]
    old = message((1.0, (5.0, *rest)), (2.0, (50.0, *rest)))

    loop.run(0.5, joint_trajectory=old)
    stamp = stamp_in(loop, 1.5, start)
    loop.run(
        4.5,
        joint_trajectory=message((3.0, (-5.0,)), joints=("joint1",), stamp_ns=stamp),
    )

    assert max(joint1(loop)) == pytest.approx(27.5, abs=2.0)
    assert joint1(loop)[-1] == pytest.approx(-5.0, abs=CLOSE)


def test_a_motion_of_the_future_is_replaced_on_its_way():  # C35
    loop = make()
    rest = START[1:]
    old = message(
        (1.0, (5.0, *rest)), (2.0, (50.0, *rest)), stamp_ns=stamp_in(loop, 5.0)
    )

    loop.run(0.5, joint_trajectory=old)
    new = message((0.5, (-5.0, *rest)), stamp_ns=stamp_in(loop, 0.5))
    loop.run(2.0, joint_trajectory=new)

    assert max(joint1(loop)) < 4.0
    assert joint1(loop)[-1] == pytest.approx(-5.0, abs=CLOSE)


def test_a_motion_of_the_future_is_reached_from_a_hold():  # C36
    loop = make()
    loop.run(0.1)
    stamp = stamp_in(loop, 0.5)

    loop.run(1.2, joint_trajectory=message((0.3, (4.0, 5.0, 6.0)), stamp_ns=stamp))

    reference = report(loop).reference.positions
    assert reference == pytest.approx((4.0, 5.0, 6.0), abs=0.1)


def test_a_motion_of_the_past_is_ignored():  # C37
    loop = make()
    start = loop.time_ns

    loop.run(0.5, joint_trajectory=t3())
    late = message((0.1, START), stamp_ns=stamp_in(loop, 0.0, start))
    loop.run(0.3, joint_trajectory=late)

    assert [type(event) for event in loop.events] == [TopicRejected]
    assert loop.command() == pytest.approx(LAST, abs=CLOSE)


# The action


@pytest.mark.parametrize(
    ("velocities", "last"),
    [
        pytest.param({}, 0.0, id="A1"),
        pytest.param({"velocities": [(1.0, 1.0, 1.0)]}, 1.0, id="A2"),
    ],
)
def test_a_goal_of_one_point_succeeds(velocities, last):
    loop = make(BOTH, BOTH, {"constraints.stopped_velocity_tolerance": 0.0})
    sent = goal(message((0.5, (1.0, 2.0, 3.0)), **velocities), goal_time_tolerance=1.0)

    loop.run(0.8, follow_joint_trajectory=sent)

    assert loop.news_of(sent) == [(STATUS.EXECUTING, None), (STATUS.SUCCEEDED, 0)]
    assert num_points(loop) == 1
    assert loop.command() == pytest.approx((1.0, 2.0, 3.0), abs=CLOSE)
    assert loop.command("velocity") == pytest.approx([last] * 3)


def two_points(first: float = 0.2, second: float = 0.3) -> JointTrajectory:
    return message((first, (4.0, 5.0, 6.0)), (second, (7.0, 8.0, 9.0)))


def test_feedback_counts_the_points_that_are_past():  # A3
    loop = make()
    sent = goal(two_points())

    loop.run(0.5, follow_joint_trajectory=sent)

    assert loop.news_of(sent)[-1] == (STATUS.SUCCEEDED, 0)
    feedback = [
        event.feedback
        for event in loop.events
        if isinstance(event, GoalEvent) and event.feedback is not None
    ]
    seen = [(seconds(f.desired.time_from_start), f.index) for f in feedback]
    assert seen
    assert [index for _, index in seen] == [
        sum(time < now for time in (0.2, 0.3)) for now, _ in seen
    ]
    assert {index for _, index in seen} == {0, 1}


def test_a_goal_within_its_tolerance_succeeds():  # A4
    loop = make(settings=each("constraints.{}.goal", 0.1))
    sent = goal(two_points())

    loop.run(0.5, follow_joint_trajectory=sent)

    assert loop.news_of(sent)[-1] == (STATUS.SUCCEEDED, 0)


@pytest.mark.parametrize(
    "trajectory",
    [
        pytest.param(two_points(0.0, 0.1), id="A5"),
        pytest.param(message((0.0, (4.0, 5.0, 6.0))), id="A7"),
    ],
)
def test_a_goal_off_its_path_aborts(trajectory):
    loop = make(settings=each("constraints.{}.trajectory", 1e-4), separate=True)
    sent = goal(trajectory)

    loop.run(0.3, follow_joint_trajectory=sent)

    assert loop.news_of(sent) == [(STATUS.EXECUTING, None), (STATUS.ABORTED, -4)]
    assert num_points(loop) == 1
    assert loop.command() == pytest.approx(START, abs=CLOSE)


def test_a_goal_that_is_late_aborts():  # A6
    parameters = {**each("constraints.{}.goal", 0.1), "constraints.goal_time": 1e-6}
    loop = make(settings=parameters, separate=True)
    sent = goal(message((0.0, (4.0, 5.0, 6.0))), goal_time_tolerance=1.0)

    loop.run(0.95, follow_joint_trajectory=sent)
    assert loop.news_of(sent) == [(STATUS.EXECUTING, None)]
    loop.run(0.25)

    assert loop.news_of(sent)[-1] == (STATUS.ABORTED, -5)
    assert loop.command() == pytest.approx(START, abs=CLOSE)


def test_a_canceled_goal_holds():  # A8
    loop = make()
    sent = far()

    cancel(loop, sent)
    there = loop.command()
    loop.run(0.3)

    assert loop.news_of(sent) == [(STATUS.EXECUTING, None), (STATUS.CANCELED, 0)]
    assert num_points(loop) == 1
    assert there == pytest.approx((np.array(START) + LAST) / 2, abs=0.1)
    assert loop.command() == pytest.approx(there)


def test_a_canceled_goal_brakes():  # A9
    loop = make(BOTH, BOTH, BRAKE, velocity_limit=20.0)
    sent = far()

    cancel(loop, sent)
    assert num_points(loop) > 1
    speeds = [loop.command("velocity")]
    while len(speeds) < 200:
        loop.tick()
        speeds.append(loop.command("velocity"))

    assert loop.news_of(sent)[-1] == (STATUS.CANCELED, 0)
    assert speeds[-1] == pytest.approx([0.0] * 3)
    # 10 rad/s^2 are 0.1 rad/s in a cycle.
    assert np.abs(np.diff(speeds, axis=0)).max() == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("velocities", "status"),
    [((4.0, 5.0, 6.0), STATUS.REJECTED), ((0.0, 0.0, 0.0), STATUS.EXECUTING)],
)
def test_a_goal_must_end_at_rest_unless_it_may_not(velocities, status):  # A11
    loop = make(settings={"allow_nonzero_velocity_at_trajectory_end": False})
    sent = goal(message((0.5, FIRST), velocities=[velocities]))

    loop.tick(follow_joint_trajectory=sent)

    assert loop.news_of(sent)[0][0] is status


@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted", "rolling"])
@pytest.mark.parametrize(
    ("old", "new_stamp", "is_blended"),
    [
        pytest.param(message((1.0, LAST)), 0.0, False, id="A12"),
        pytest.param(t3(spacing=0.5), 0.0, True, id="A13"),
        pytest.param(t3(spacing=0.5), 1.0, True, id="A14"),
    ],
)
def test_a_new_goal_preempts_the_old_one(old, new_stamp, is_blended, distro):
    loop = make(distro=distro)
    first = goal(old)
    loop.run(0.3, follow_joint_trajectory=first)
    stamp = stamp_in(loop, new_stamp) if new_stamp else 0
    second = goal(message((0.5, START), (0.8, FIRST), stamp_ns=stamp))

    loop.tick(follow_joint_trajectory=second)
    assert (plan_of(loop).num_prefix > 0) is (is_blended and distro == "rolling")
    loop.run(2.0)

    of_first = loop.news_of(first)[-1]
    if distro == "humble":
        assert of_first[0] is STATUS.CANCELED
    else:
        assert of_first == (STATUS.ABORTED, -1)
    assert loop.news_of(second)[-1] == (STATUS.SUCCEEDED, 0)
    assert loop.command() == pytest.approx(FIRST, abs=CLOSE)


@pytest.mark.parametrize("command", SETS)
def test_a_deactivation_aborts_the_goal(command):  # A15
    loop = make(command, ALL)
    sent = goal(t3())
    loop.run(0.2, follow_joint_trajectory=sent)

    for _ in range(10):
        loop.tick(active=False)

    assert loop.news_of(sent)[-1] == (STATUS.ABORTED, -1)
    for name in command:
        if name != "position":
            assert loop.command(name) == [0.0] * 3


def test_an_inactive_controller_rejects_goals():  # A16
    loop = make()
    sent = far()
    loop.tick()
    loop.tick(active=False)

    loop.tick(active=False, follow_joint_trajectory=sent)

    ((status, _),) = loop.news_of(sent)
    assert status is STATUS.REJECTED
