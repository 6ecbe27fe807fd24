"""Controllers run as in their distro, row by row: what test_distros says, in motion.

Rows F1 to F43 of the list of differences between humble and rolling; numbers follow
from the rules of the controllers, worked out beside each check.
"""

from collections.abc import Callable
from math import inf, nan, pi
from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.description.parameters import DISTROS
from arm_drake.messages import (
    CancelGoal,
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    GoalEvent,
    GoalStatus,
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFCommand,
    SendGoal,
    SwitchController,
    TopicRejected,
)
from tests import models
from tests.controllers.mirrored import START_NS, Mirrored
from tests.controllers.parameters import FORWARD, GROUPS, JSB, JTC, PID

Check = Callable[[str, Path], None]
CHECKS: dict[str, Check] = {}

NEW = ("kilted", "rolling")


def row(name: str) -> Callable[[Check], Check]:
    """Return a decorator that makes a function the check of a row."""

    def register(check: Check) -> Check:
        assert name not in CHECKS
        CHECKS[name] = check
        return check

    return register


def follow(distro: str, **fields: Any) -> Mirrored:
    """Return a trajectory controller of one joint; `__` in a name stands for a dot."""
    how = {
        name: fields.pop(name)
        for name in (
            "joints",
            "joint_type",
            "velocity_limit",
            "states",
            "commands",
            "separate",
        )
        if name in fields
    }
    joints = how.pop("joints", ("a",))
    parameters = {name.replace("__", "."): value for name, value in fields.items()}
    rate = parameters.pop("rate", 100)
    parameters = {"joints": list(joints), **parameters}
    return Mirrored(JTC, parameters, joints=joints, distro=distro, rate=rate, **how)


def trajectory(
    *points: tuple[float, float], joints: tuple[str, ...] = ("a",), **fields: Any
) -> JointTrajectory:
    """Return a trajectory of joints that move alike; a point is time and position."""
    vectors = {name: [value] * len(joints) for name, value in fields.items()}
    return JointTrajectory(
        joint_names=joints,
        points=[
            JointTrajectoryPoint([q] * len(joints), time_from_start=t, **vectors)
            for t, q in points
        ],
    )


def goal(*points: tuple[float, float], **fields: Any) -> SendGoal:
    return SendGoal(FollowJointTrajectoryGoal(trajectory(*points, **fields)))


def outputs_of_pid(
    distro: str, errors: list[float], *, rate: int = 1, **gains: Any
) -> list[float]:
    """Return what a PidController makes of errors, one after the other."""
    parameters = {"dof_names": ["a"], **{f"gains.a.{n}": v for n, v in gains.items()}}
    loop = Mirrored(PID, parameters, joints=["a"], distro=distro, rate=rate)
    for error in errors:
        loop.tick(reference=MultiDOFCommand(values=[error]))
    return [value for (value,) in loop.rows]


def simulate(folder: Path, distro: str, yaml: str, **changes: Any) -> ad.Simulation:
    """Return a simulation of a pendulum whose commands become its states."""
    urdf = changes.pop("urdf", models.pendulum())
    robot = models.load(folder, urdf, yaml, distro=distro)
    options = ad.SimulationOptions(preset="kinematic", **changes)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def states_of(simulation: ad.Simulation) -> dict[str, str]:
    return {c.name: c.state for c in simulation.list_controllers()}


# Trajectories start from the last command: humble says now, others when it was given.
@row("F1")
def check_start_from_the_last_command(distro: str, folder: Path) -> None:
    for name in ("open_loop_control", "interpolate_from_desired_state"):
        loop = follow(distro, separate=True, **{name: True})

        loop.tick()
        loop.run(0.1, joint_trajectory=trajectory((1.0, 1.0)))
        loop.tick(joint_trajectory=trajectory((1.0, -1.0)))

        # Commands are 0.01 s ahead. The last one before the tick at 0.11 s is c.
        if distro == "humble":
            c = 0.1
            expected = c + (-1.0 - c) * 0.01
        else:
            c = 0.11 / 1.01
            expected = c + (-1.0 - c) * 0.02 / 1.01
        assert loop.rows[-2] == pytest.approx([c], abs=1e-9)
        assert loop.rows[-1] == pytest.approx([expected], abs=1e-9)

    loop = follow(distro, separate=True)
    loop.tick()
    loop.run(0.1, joint_trajectory=trajectory((1.0, 1.0)))
    loop.tick(joint_trajectory=trajectory((1.0, -1.0)))
    assert loop.rows[-1] == pytest.approx([-0.01], abs=1e-9)


# Only humble's open loop switches the PID of velocity commands off.
@row("F2")
def check_open_loop_without_pid(distro: str, folder: Path) -> None:
    loop = follow(
        distro,
        separate=True,
        open_loop_control=True,
        command_interfaces=["velocity"],
        gains__a__p=7.0,
    )

    loop.tick()
    loop.run(0.11, joint_trajectory=trajectory((1.0, 1.0)))

    # The velocity of the trajectory; or seven times its position after 0.1 s, which
    # starts from the last command, a period earlier.
    expected = 1.0 if distro == "humble" else 7.0 * 0.11 / 1.01
    assert loop.rows[-1] == pytest.approx([expected], abs=1e-9)


@row("F3")
def check_velocity_at_the_end(distro: str, folder: Path) -> None:
    loop = follow(distro)
    sent = goal((1.0, 1.0), velocities=0.5)

    loop.tick(follow_joint_trajectory=sent)

    ((status, _),) = loop.news_of(sent)
    is_taken = distro == "humble"
    assert status is (GoalStatus.EXECUTING if is_taken else GoalStatus.REJECTED)


# Every tick tells its state, whatever the rate.
@row("F4")
def check_state_publish_rate(distro: str, folder: Path) -> None:
    loop = follow(distro, state_publish_rate=1.0)

    for k in range(3):
        loop.tick()
        stamp = loop.output("controller_state").header.stamp
        assert stamp.to_nanoseconds() == START_NS + k * 10_000_000


# Humble looks at the gains, all look at the type of the joint.
@row("F5")
def check_angle_wraparound(distro: str, folder: Path) -> None:
    for joint_type in ("revolute", "continuous"):
        for is_asked in (False, True):
            loop = follow(
                distro,
                joint_type=joint_type,
                states={"a/position": 3.1},
                separate=True,
                command_interfaces=["velocity"],
                gains__a__p=10.0,
                gains__a__angle_wraparound=is_asked,
            )

            loop.tick(joint_trajectory=trajectory((0.0, 6.6)))

            wraps = joint_type == "continuous" or (distro == "humble" and is_asked)
            error = 6.6 - 3.1 - 2.0 * pi * wraps
            assert loop.rows[-1] == pytest.approx([10.0 * error], abs=1e-9)


# Humble's default takes the integral away; P41.
@row("F6")
def check_i_clamp(distro: str, folder: Path) -> None:
    errors, gains = [0.1, 0.1, 0.1], {"rate": 100, "p": 10.0, "i": 5.0}

    free = outputs_of_pid(distro, errors, **gains)
    clamped = outputs_of_pid(distro, errors, **gains, i_clamp=0.007)

    assert free == pytest.approx(
        {"humble": [1.0, 1.0, 1.0], "jazzy": [1.005, 1.01, 1.015]}.get(
            distro, [1.0, 1.005, 1.01]
        )
    )
    late = [1.0, 1.005, 1.007]
    assert clamped == pytest.approx(late if distro in NEW else [1.005, 1.007, 1.007])


# P39 where the stored integral is clamped, and what humble does without.
@row("F7")
def check_antiwindup(distro: str, folder: Path) -> None:
    errors, gains = [-1.0, -1.0, 0.5, 0.0], {"i": 2.0, "i_clamp": 1.0}

    default = outputs_of_pid(distro, errors, **gains)
    stored = outputs_of_pid(distro, errors, **gains, antiwindup=True)
    contribution = outputs_of_pid(distro, errors, **gains, antiwindup=False)

    p39 = [-1.0, -1.0, 0.0, 0.0]
    of_humble = [-1.0, -1.0, -1.0, -1.0]
    assert stored == pytest.approx(p39)
    assert contribution == pytest.approx(of_humble if distro == "humble" else p39)
    assert default == pytest.approx(
        [0.0, -1.0, -1.0, 0.0] if distro in NEW else contribution
    )


# P13 and P38: the first call has an integral or not.
@row("F8")
def check_integration(distro: str, folder: Path) -> None:
    errors = [-0.5, -0.5, 0.0, 0.0, 1.0, 0.0]
    late, early = [0.0, -0.5, -1.0, -1.0, -1.0, 0.0], [-0.5, -1.0, -1.0, -1.0, 0.0, 0.0]
    gains = {"i": 1.0, "i_clamp": 10.0}

    default = outputs_of_pid(distro, errors, **gains)
    none = outputs_of_pid(distro, errors, **gains, antiwindup_strategy="none")

    assert default == pytest.approx(late if distro in NEW else early)
    assert none == pytest.approx(early if distro == "humble" else late)


@row("F9")
def check_output_limits(distro: str, folder: Path) -> None:
    gains = {"p": 1.0, "u_clamp_max": 1.0, "u_clamp_min": -1.0}

    limited = outputs_of_pid(distro, [0.5, 2.0], **gains)
    free = outputs_of_pid(distro, [0.5, 2.0], **gains, saturation=False)

    assert limited == pytest.approx([0.5, 2.0 if distro == "humble" else 1.0])
    assert free == pytest.approx([0.5, 2.0])


@row("F10")
def check_a_preempted_goal(distro: str, folder: Path) -> None:
    loop = follow(distro)
    old, new = goal((1.0, 1.0)), goal((1.0, -1.0))

    loop.run(0.1, follow_joint_trajectory=old)
    loop.tick(follow_joint_trajectory=new)

    of_old = [e for e in loop.events if isinstance(e, GoalEvent) and e.request is old]
    assert (of_old[-1].status, of_old[-1].result.error_string) == (
        (
            GoalStatus.CANCELED,
            "Current goal cancelled due to new incoming action.",
        )
        if distro == "humble"
        else (GoalStatus.ABORTED, "Current goal preempted by new incoming action.")
    )
    if distro != "humble":
        assert of_old[-1].result.error_code == -1
    assert loop.news_of(new) == [(GoalStatus.EXECUTING, None)]


# The command is a period ahead; in humble too, where upstream's is not.
@row("F11")
def check_look_ahead(distro: str, folder: Path) -> None:
    loop = follow(distro)

    loop.run(0.51, joint_trajectory=trajectory((1.0, 1.0)))

    state = loop.output("controller_state")
    assert state.reference.positions == pytest.approx((0.5,), abs=1e-9)
    assert loop.rows[-1] == pytest.approx([0.51], abs=1e-9)


# At a speed of 0.4 a look-ahead of 10 ms passes the end at 92 ms, and 4 ms later the
# reference is there in jazzy alone.
@row("F11b")
def check_search_cursor(distro: str, folder: Path) -> None:
    loop = follow(distro, speed_scaling__initial_scaling_factor=0.4)

    loop.run(0.25, joint_trajectory=trajectory((0.05, 0.5), (0.1, 1.0)))

    (reference,) = loop.output("controller_state").reference.positions
    assert reference == pytest.approx(1.0 if distro == "jazzy" else 0.96, abs=1e-6)


# Humble commands efforts alone, made by a PID; later points may have efforts too, which
# start from the last command. Those beside positions are of the present.
@row("F12")
def check_efforts(distro: str, folder: Path) -> None:
    both = ["position", "effort"]
    alone = follow(
        distro,
        separate=True,
        command_interfaces=["effort"],
        gains__a__p=7.0,
        commands={"a/effort": 4.0},
    )

    alone.run(0.11, joint_trajectory=trajectory((1.0, 1.0)))
    load_inertia = 0.0 if distro == "humble" else 4.0 * (1.0 - 0.11)
    assert alone.rows[-1] == pytest.approx([0.7 + load_inertia], abs=1e-9)
    alone.tick(joint_trajectory=trajectory((1.0, 1.0), effort=0.3))
    assert len(alone.events) == (distro == "humble")

    if distro == "humble":
        with pytest.raises(ad.ArmDrakeError, match="humble takes 'effort' alone only"):
            follow(distro, command_interfaces=both)
        return
    loop = follow(distro, command_interfaces=both)
    loop.tick()
    loop.run(0.11, joint_trajectory=trajectory((1.0, 1.0), effort=0.3))
    assert loop.rows[-1] == pytest.approx([0.11, 0.03], abs=1e-9)


@row("F13")
def check_speed_scaling(distro: str, folder: Path) -> None:
    loop = follow(distro, speed_scaling__initial_scaling_factor=0.5)

    loop.run(0.51, joint_trajectory=trajectory((1.0, 1.0)))

    state = loop.output("controller_state")
    assert state.speed_scaling_factor == 0.5
    assert state.reference.positions == pytest.approx((0.25,), abs=1e-9)


# Rolling blends: a joint that is left out goes on; else it stays.
@row("F14")
def check_trajectory_replacement(distro: str, folder: Path) -> None:
    both, name = ("a", "b"), "allow_trajectory_replacement"
    for parameters in ({}, {name: True}, {name: False}):
        loop = follow(distro, joints=both, allow_partial_joints_goal=True, **parameters)

        loop.run(0.5, joint_trajectory=trajectory((1.0, 1.0), (2.0, 2.0), joints=both))
        loop.run(0.51, joint_trajectory=trajectory((1.0, 5.0)))

        # The blend starts a period back, from the last tick's reference of 0.49.
        blends = distro == "rolling" and parameters != {name: False}
        assert loop.rows[-1][1] == pytest.approx(1.0 if blends else 0.5, abs=1e-9)


# S74 and the cubic between its second and third point; refused without.
@row("F15")
def check_positions_upsampling(distro: str, folder: Path) -> None:
    loop = follow(
        distro,
        rate=60,
        positions_upsampling__enable=True,
        positions_upsampling__policy_frequency=30.0,
    )
    points = [(0.0, q) for q in (0.0, 0.1, 0.2, 0.1, 0.0)]

    loop.run(0.05, joint_trajectory=trajectory(*points))

    rejected = [event for event in loop.events if isinstance(event, TopicRejected)]
    if distro != "rolling":
        assert len(rejected) == 1
        return
    assert not rejected
    assert loop.rows[-1] == pytest.approx([0.05 - 4.5 / 240], abs=1e-6)


# C27; humble holds at once.
@row("F16")
def check_decelerate_on_cancel(distro: str, folder: Path) -> None:
    loop = follow(
        distro,
        velocity_limit=1.0,
        states={"a/position": 1.1, "a/velocity": 0.2},
        separate=True,
        constraints__decelerate_on_cancel=True,
        constraints__a__max_deceleration_on_cancel=10.0,
    )
    sent = goal((1.0, 3.3))

    loop.run(0.1, follow_joint_trajectory=sent)
    loop.tick(follow_joint_trajectory=CancelGoal(sent))
    loop.tick()

    stops = [1.1, 1.1] if distro == "humble" else [1.1015, 1.102]
    assert [q for (q,) in loop.rows[-2:]] == pytest.approx(stops, abs=1e-9)


# Q5 and Q6.
@row("F26")
def check_feedforward(distro: str, folder: Path) -> None:
    for parameters in ({}, {"enable_feedforward": True}, {"enable_feedforward": False}):
        gains = {"gains.a.p": 0.5, "gains.a.feedforward_gain": 1.0}
        loop = Mirrored(
            PID,
            {"dof_names": ["a"], **gains, **parameters},
            joints=["a"],
            distro=distro,
            states={"a/position": 1.1},
        )

        loop.tick(reference=MultiDOFCommand(values=[5.0]))

        is_on = parameters.get("enable_feedforward", False) or distro in NEW
        assert loop.rows[-1] == pytest.approx([6.95 if is_on else 1.95])


@row("F27")
def check_groups(distro: str, folder: Path) -> None:
    names = ("position", "velocity", "effort")
    for type_, interface in zip(GROUPS, names, strict=True):
        loop = Mirrored(type_, {}, joints=["a", "b"], distro=distro)

        loop.tick(commands=Float64MultiArray([10.0, 20.0]))

        assert loop.commands == {f"a/{interface}": 10.0, f"b/{interface}": 20.0}


BROADCASTER = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    jsb: {{type: {JSB}}}
"""


@row("F29")
def check_dynamic_joint_states(distro: str, folder: Path) -> None:
    simulation = simulate(folder, distro, BROADCASTER)

    simulation.advance_to(0.05)

    topic = "jsb.dynamic_joint_states"
    assert simulation.diagram.HasOutputPort(topic) is (distro != "rolling")
    if distro != "rolling":
        message = simulation.eval_output(topic)
        assert message.joint_names == ("swing",)
        (values,) = message.interface_values
        assert set(values.interface_names) == {"position", "velocity", "effort"}


@row("F30")
def check_frame_id(distro: str, folder: Path) -> None:
    simulation = simulate(folder, distro, BROADCASTER)

    simulation.advance_to(0.05)

    header = simulation.eval_output("jsb.joint_states").header
    assert header.frame_id == ("base_link" if distro == "rolling" else "")


def group(manager: str = "", rate: str = "") -> str:
    return f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    {manager}
    group: {{type: {GROUPS[0]}}}
    other: {{type: {GROUPS[0]}}}
    arm: {{type: {JTC}}}
group: {{ros__parameters: {{joints: [swing]}}}}
other: {{ros__parameters: {{joints: [swing]}}}}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
    {rate}
"""


# From 0 at 10 rad/s at most, to 3 rad at most: by 0.1 rad in a cycle.
@row("F31")
def check_enforced_limits(distro: str, folder: Path) -> None:
    for requested in (None, True, False):
        parameters = (
            ""
            if requested is None
            else f"enforce_command_limits: {str(requested).lower()}"
        )
        simulation = simulate(folder, distro, group(parameters), active=("group",))
        simulation.advance_to(0.005)

        simulation.controller("group").command([5.0])
        simulation.advance_to(0.025)
        first = simulation.eval_output("joint_states")[0]
        simulation.advance_to(1.0)
        last = simulation.eval_output("joint_states")[0]

        default = distro in NEW
        is_limited = (
            default if requested is None else requested
        ) and distro != "humble"
        assert (first, last) == pytest.approx((0.1, 3.0) if is_limited else (5.0, 5.0))


# Strict in rolling alone: of a switch that can't be done whole, nothing is done.
@row("F32")
def check_strictness(distro: str, folder: Path) -> None:
    simulation = simulate(folder, distro, group(), inactive=("group", "other", "arm"))
    simulation.advance_to(0.05)

    simulation.request_switch(SwitchController(["group", "arm"]))
    simulation.advance_to(0.1)

    states = states_of(simulation)
    assert states["arm"] == "inactive"
    assert states["group"] == ("inactive" if distro == "rolling" else "active")


# 30 Hz of 100 Hz are 33 Hz from kilted on; the look-ahead shows it.
@row("F34")
def check_rate(distro: str, folder: Path) -> None:
    yaml = group(rate="update_rate: 30")
    simulation = simulate(folder, distro, yaml, active=("arm",))
    simulation.advance_to(0.005)

    simulation.controller("arm").send_trajectory(
        trajectory((10.0, 2.0), joints=("swing",))
    )
    simulation.advance_to(1.0)

    state = simulation.controller("arm").state()
    ahead = state.output.positions[0] - state.reference.positions[0]
    rate = 33 if distro in NEW else 30
    assert ahead == pytest.approx(0.2 / rate, rel=1e-6)


def mocked(joint: str = "", block: str = "", plugin: str = "mock_components") -> str:
    """Return a pendulum with a sensor on hardware of a plugin's GenericSystem."""
    return models.pendulum(
        control=f"""
  <ros2_control name="hardware" type="system">
    <hardware><plugin>{plugin}/GenericSystem</plugin>{block}</hardware>
    <joint name="swing">
      {joint}
      <command_interface name="position"/>
      <state_interface name="position"/>
    </joint>
    <sensor name="tcp"><state_interface name="force.x"/></sensor>
  </ros2_control>"""
    )


# Both names of the hardware and of its parameter, in every distro.
@row("F36")
def check_names_of_mock_components(distro: str, folder: Path) -> None:
    yaml = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    force: {{type: {FORWARD}}}
force: {{ros__parameters: {{joints: [tcp], interface_name: force.x}}}}
"""
    for plugin, parameter in (
        ("fake_components", "fake_sensor_commands"),
        ("mock_components", "mock_sensor_commands"),
    ):
        block = f'<param name="{parameter}">true</param>'
        urdf = mocked(block=block, plugin=plugin)
        simulation = simulate(folder, distro, yaml, urdf=urdf)

        simulation.controller("force").command([7.5])
        simulation.advance_to(0.05)

        hardware = simulation.diagram.GetSubsystemByName("hardware")
        context = hardware.GetMyContextFromRoot(simulation.simulator.get_context())
        measured = hardware.GetOutputPort("state_interfaces").Eval(context)
        assert measured[-1] == 7.5


# Both ways to say where a joint starts, in every distro.
@row("F37")
def check_initial_position(distro: str, folder: Path) -> None:
    old = '<param name="initial_position">0.4</param>'
    new = mocked().replace(
        '<state_interface name="position"/>',
        '<state_interface name="position"><param name="initial_value">0.4</param>'
        "</state_interface>",
    )
    for urdf in (mocked(joint=old), new):
        simulation = simulate(folder, distro, BROADCASTER, urdf=urdf)

        simulation.advance_to(0.05)

        assert simulation.joint_states().position == (0.4,)


# Humble takes what is not finite; here nothing is written of that, but of the rest.
@row("F43")
def check_values_that_are_not_finite(distro: str, folder: Path) -> None:
    for bad in (nan, inf):
        loop = Mirrored(FORWARD, {}, joints=["a", "b"], distro=distro)
        loop.tick(commands=Float64MultiArray([1.0, 2.0]))

        loop.tick(commands=Float64MultiArray([10.0, bad]))

        assert loop.rows[-1] == ([10.0, 2.0] if distro == "humble" else [1.0, 2.0])


@pytest.mark.slow
@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("name", CHECKS)
def test_a_row_holds_in_motion(name: str, distro: str, tmp_path: Path) -> None:
    CHECKS[name](distro, tmp_path)
