"""The controller manager: switches, chains, rates, failures, limits, saved states."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.manager.state import CommandLimited, ControllerFailure
from arm_drake.messages import (
    Float64MultiArray,
    SwitchController,
    SwitchControllerResult,
)
from tests import models

PERIOD = 0.01
MANY = "velocity_controllers/JointGroupVelocityController"
FORWARD = "forward_command_controller/ForwardCommandController"

INTERFACES = "".join(
    f'<command_interface name="{name}"/><state_interface name="{name}"/>'
    for name in ("position", "velocity", "effort")
)
CONTROL = "".join(
    f'<joint name="{joint}">{INTERFACES}</joint>' for joint in ("j1", "j2")
)
ROBOT = f"""
<robot name="arm">
  <link name="base"/>
  {models.joint("j1", "base", "a", xyz="0 0 1")}{models.bob("a")}
  {models.joint("j2", "a", "b", xyz="0 0 -0.5")}{models.bob("b")}
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>
    {CONTROL}
  </ros2_control>
</robot>"""

TYPES = {
    "position": "position_controllers/JointGroupPositionController",
    "velocity": "velocity_controllers/JointGroupVelocityController",
    "effort": "effort_controllers/JointGroupEffortController",
}


def pid(*dofs: str, command: str, gain: float = 1.0) -> str:
    """Return parameters of a proportional controller of positions."""
    gains = ", ".join(f"{dof}: {{p: {gain}}}" for dof in dofs)
    return (
        f"{{dof_names: [{', '.join(dofs)}], command_interface: {command}, "
        "reference_and_state_dof_names: [j1, j2], "
        f"reference_and_state_interfaces: [position], gains: {{{gains}}}}}"
    )


def load(
    folder: Path,
    controllers: dict[str, tuple[str, str]],
    text: str = ROBOT,
    **options: object,
) -> ad.Robot:
    """Return the robot with controllers of a type and parameters, by name."""
    urdf, yaml = folder / "arm.urdf", folder / "controllers.yaml"
    urdf.write_text(text, encoding="utf-8")
    extra = str(options.pop("manager", ""))
    rows = "".join(f", {name}: {{{row}}}" for name, (row, _) in controllers.items())
    lines = [
        f"controller_manager: {{ros__parameters: {{update_rate: 100{extra}{rows}}}}}"
    ]
    lines += [
        f"{name}: {{ros__parameters: {parameters}}}"
        for name, (_, parameters) in controllers.items()
    ]
    yaml.write_text("\n".join(lines), encoding="utf-8")
    return ad.load_robot(urdf, controllers=yaml, **options)


def groups(*interfaces: str, joints: str = "[j1, j2]") -> dict[str, tuple[str, str]]:
    return {
        name: (f"type: {TYPES[name]}", f"{{joints: {joints}}}") for name in interfaces
    }


def simulate(robot: ad.Robot, **options: object) -> ad.Simulation:
    return ad.Simulation(
        ad.build_diagram(robot, options=ad.SimulationOptions(**options))
    )


def command(sim: ad.Simulation, controller: str, *values: float) -> None:
    sim.publish(f"{controller}.commands", Float64MultiArray(values), PERIOD)


def values(sim: ad.Simulation) -> dict[str, float]:
    """Return what the command interfaces hold."""
    manager = sim.diagram.GetSubsystemByName("controller_manager")
    root = sim.simulator.get_context()
    held = manager.read_numbers(root, manager.numbers.values)
    return dict(zip(manager.commands, held.tolist(), strict=True))


def events(sim: ad.Simulation) -> list[object]:
    manager = sim.diagram.GetSubsystemByName("controller_manager")
    context = manager.GetMyContextFromRoot(sim.simulator.get_context())
    return [event for _, event in manager.GetOutputPort("events").Eval(context)]


def states(sim: ad.Simulation) -> dict[str, str]:
    return {row.name: row.state for row in sim.list_controllers()}


@pytest.mark.slow
def test_joints_follow_the_controller_that_is_switched_to(tmp_path):
    sim = simulate(load(tmp_path, groups("position", "velocity", "effort")))
    assert states(sim) == {
        "position": "active",
        "velocity": "inactive",
        "effort": "inactive",
    }
    command(sim, "position", 0.5, -0.3)
    sim.advance_to(1.0)
    np.testing.assert_allclose(sim.joint_states().position, [0.5, -0.3], atol=1e-6)

    sim.switch_controllers(["velocity"], ["position"])
    sim.advance_to(1.0 + PERIOD)
    command(sim, "velocity", 0.2, -0.4)
    sim.advance_to(1.5)
    assert states(sim)["velocity"] == "active"
    np.testing.assert_allclose(sim.joint_states().velocity, [0.2, -0.4], atol=1e-6)

    sim.switch_controllers(["effort"], ["velocity"])
    sim.advance_to(1.5 + PERIOD)
    command(sim, "effort", 3.0, -2.0)
    sim.advance_to(1.6)
    assert sim.joint_states().effort == (3.0, -2.0)


@pytest.mark.slow
def test_joints_hold_when_their_controller_is_deactivated(tmp_path):
    sim = simulate(load(tmp_path, groups("velocity")))
    command(sim, "velocity", 0.5, 0.5)
    sim.advance_to(1.0)

    sim.switch_controllers(deactivate=["velocity"])
    sim.advance_to(1.5)
    rested = sim.joint_states()
    sim.advance_to(3.0)

    np.testing.assert_allclose(rested.velocity, 0.0, atol=1e-3)
    np.testing.assert_allclose(
        sim.joint_states().position, rested.position, rtol=0.0, atol=1e-4
    )
    # Where it stopped: 2 / bandwidth further on.
    np.testing.assert_allclose(rested.position, [0.5 + 0.5 * 0.05] * 2, atol=0.02)


@pytest.mark.slow
def test_a_controller_that_takes_over_starts_without_a_jump(tmp_path):
    jtc = "type: joint_trajectory_controller/JointTrajectoryController"
    parameters = (
        "{joints: [j1, j2], command_interfaces: [position], "
        "state_interfaces: [position, velocity]}"
    )
    robot = load(tmp_path, {**groups("velocity"), "jtc": (jtc, parameters)})
    sim = simulate(robot, active=("velocity",), log_rate=1000.0)
    command(sim, "velocity", 0.5, -0.5)
    sim.advance_to(1.0)

    sim.switch_controllers(["jtc"], ["velocity"])
    sim.advance_to(2.0)

    velocity = sim.rollout().velocity
    steps = np.abs(np.diff(velocity[990:], axis=0)).max()
    assert steps < 0.05, "one tenth of the speed, in a millisecond"
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-4)


def test_a_conflict_names_both_controllers_and_the_interface(tmp_path):
    both = groups("position") | {
        "other": (f"type: {FORWARD}", "{joints: [j2], interface_name: position}")
    }
    sim = simulate(load(tmp_path, both))

    with pytest.raises(InputError) as error:
        sim.switch_controllers(["other"])

    assert str(error.value) == (
        "could not activate 'other': 'j2/position' is claimed by 'position', which "
        "stays active"
    )
    assert states(sim) == {"position": "active", "other": "inactive"}


def test_best_effort_does_what_it_can_and_tells_the_rest(tmp_path):
    sim = simulate(load(tmp_path, groups("position", "velocity")))

    problems = sim.switch_controllers(
        ["velocity", "elsewhere"], ["position"], strictness="best_effort"
    )
    sim.advance_to(PERIOD)

    assert problems == ("no controller 'elsewhere'; known: position, velocity",)
    assert states(sim) == {"position": "inactive", "velocity": "active"}
    (result,) = events(sim)
    assert isinstance(result, SwitchControllerResult)
    assert (result.ok, result.message) == (True, problems[0])


def test_a_request_on_the_port_that_can_t_be_met_changes_nothing(tmp_path):
    sim = simulate(load(tmp_path, groups("position", "velocity")))
    request = SwitchController(("velocity",), (), "strict")

    sim.publish("controller_manager.switch_controller", request, PERIOD)
    sim.advance_to(3 * PERIOD)

    assert states(sim) == {"position": "active", "velocity": "inactive"}
    (result,) = events(sim)
    assert result.request is request
    assert not result.ok
    assert "joint 'j1' is commanded by 'position'" in result.message


def test_requests_of_one_instant_are_all_met(tmp_path):
    sim = simulate(
        load(tmp_path, groups("position", joints="[j1]") | {
            "other": (f"type: {FORWARD}", "{joints: [j2], interface_name: position}")
        })
    )  # fmt: skip

    sim.switch_controllers(deactivate=["position"])
    sim.switch_controllers(deactivate=["other"])
    sim.advance_to(PERIOD)

    assert states(sim) == {"position": "inactive", "other": "inactive"}


def test_a_restarted_controller_forgets_its_command(tmp_path):
    sim = simulate(load(tmp_path, groups("effort")))
    command(sim, "effort", 1.0, 1.0)
    sim.advance_to(PERIOD)
    assert values(sim)["j1/effort"] == 1.0

    sim.switch_controllers(["effort"], ["effort"])
    sim.advance_to(3 * PERIOD)

    # Efforts end with 0, and the old message doesn't count any more.
    assert values(sim)["j1/effort"] == 0.0


CHAIN = {
    "top": (
        f"type: {FORWARD}",
        "{joints: [middle/j1, middle/j2], interface_name: position}",
    ),
    "middle": (
        "type: pid_controller/PidController",
        pid("low/j1", "low/j2", command="position", gain=0.5),
    ),
    "low": (
        "type: pid_controller/PidController",
        pid("j1", "j2", command="effort", gain=4.0),
    ),
}


def test_a_chain_of_three_has_no_tick_of_delay(tmp_path):
    sim = simulate(load(tmp_path, CHAIN))
    assert set(states(sim).values()) == {"active"}
    sim.advance_to(0.5 * PERIOD)
    q = np.array(sim.joint_states().position)
    assert np.array_equal(q, [0.0, 0.0])
    sim.advance_to(0.995 * PERIOD)

    command(sim, "top", 0.8, -0.4)
    # Up to, and not including, what the next cycle moves.
    sim.simulator.AdvanceTo(PERIOD)
    q = np.array(sim.joint_states().position)
    sim.simulator.AdvanceTo(PERIOD + 1e-4)

    state = values(sim)
    reference = np.array([0.8, -0.4])
    for joint, wanted, measured in zip(("j1", "j2"), reference, q, strict=True):
        middle = 0.5 * (wanted - measured)
        assert state[f"middle/{joint}/position"] == wanted
        assert state[f"low/{joint}/position"] == pytest.approx(middle, rel=1e-12)
        effort = 4.0 * (middle - measured)
        assert state[f"{joint}/effort"] == pytest.approx(effort, rel=1e-12)


@pytest.mark.slow
def test_a_chain_runs_in_the_same_cycle_whatever_the_order_in_the_file(tmp_path):
    results = []
    for index, names in enumerate((["top", "middle", "low"], ["low", "top", "middle"])):
        folder = tmp_path / str(index)
        folder.mkdir()
        sim = simulate(load(folder, {name: CHAIN[name] for name in names}))
        command(sim, "top", 0.3, 0.1)
        sim.advance_to(1.0)
        results.append(sim.joint_states().position)

    assert results[0] == results[1]


def test_a_follower_can_t_leave_before_its_predecessor(tmp_path):
    sim = simulate(load(tmp_path, CHAIN))

    with pytest.raises(InputError, match=r"could not deactivate 'low'.*'middle'"):
        sim.switch_controllers(deactivate=["low"])
    sim.switch_controllers(deactivate=["top", "middle"])
    sim.advance_to(PERIOD)

    assert states(sim) == {"top": "inactive", "middle": "inactive", "low": "active"}


def test_a_predecessor_without_its_follower_does_not_start(tmp_path):
    sim = simulate(load(tmp_path, CHAIN), inactive=("low",))

    assert set(states(sim).values()) == {"inactive"}
    problems = [entry.what for entry in sim.report if entry.severity != "info"]
    assert problems == [
        "'low/j1/position' belongs to 'low', which is not active",
        "'middle/j1/position' belongs to 'middle', which is not active",
    ]


def test_controllers_that_command_each_other_in_a_circle_do_not_load(tmp_path):
    circle = {
        name: (
            "type: pid_controller/PidController",
            pid(f"{other}/j1", f"{other}/j2", command="position"),
        )
        for name, other in (("a", "b"), ("b", "a"))
    }
    robot = load(tmp_path, circle | groups("position"))

    sim = simulate(robot)

    assert states(sim)["a"] == "unconfigured"
    assert states(sim)["position"] == "active"
    assert any("circle" in entry.what for entry in sim.report)


def test_a_slower_controller_of_a_chain_holds_its_command(tmp_path):
    top = (CHAIN["top"][0], CHAIN["top"][1].replace("{", "{update_rate: 25, ", 1))
    sim = simulate(load(tmp_path, CHAIN | {"top": top}))
    seen = []
    for tick in range(12):
        command(sim, "top", 0.1 * tick, 0.0)
        sim.advance_to(tick * PERIOD + 0.5 * PERIOD)
        seen.append(values(sim)["middle/j1/position"])

    # It ticks in every fourth cycle, and sees the last message that came in between.
    np.testing.assert_allclose(seen, np.repeat([0.0, 0.4, 0.8], 4), atol=1e-15)


def test_the_velocity_of_a_slower_controller_is_that_of_its_commands(tmp_path):
    slow = {
        "slow": (
            f"type: {TYPES['position']}",
            "{joints: [j1, j2], update_rate: 50}",
        )
    }
    sim = simulate(load(tmp_path, slow))
    commands = sim.diagram.GetSubsystemByName("commands")
    for tick in range(8):
        command(sim, "slow", 0.01 * tick, 0.0)
        sim.advance_to(tick * PERIOD + 0.5 * PERIOD)
        context = commands.GetMyContextFromRoot(sim.simulator.get_context())
        drive = commands.GetOutputPort("drive").Eval(context)
        # At first it might be a step.
        speed = 0.02 * 50.0 if tick >= 4 else 0.0
        assert drive[2] == pytest.approx(speed, rel=1e-12)


def test_a_controller_that_fails_is_replaced(tmp_path):
    both = groups("position") | {
        "spare": (f"type: {TYPES['position']}", "{joints: [j1, j2]}")
    }
    both["position"] = (
        f"type: {TYPES['position']}, fallback_controllers: [spare]",
        "{joints: [j1, j2]}",
    )
    sim = simulate(load(tmp_path, both))
    sim.advance_to(PERIOD)

    command(sim, "position", 0.1)  # One value for two joints.
    sim.advance_to(3 * PERIOD)

    assert states(sim) == {"position": "inactive", "spare": "active"}
    reason = "data must have 2 values (j1/position, j2/position), got 1"
    assert events(sim) == [
        ControllerFailure("position", ("position",), ("spare",), reason)
    ]


@pytest.mark.parametrize(
    ("distro", "active"),
    [("rolling", set()), ("jazzy", {"middle", "low"}), ("humble", set(CHAIN))],
)
def test_what_a_failure_ends_depends_on_the_distro(tmp_path, distro, active):
    sim = simulate(load(tmp_path, CHAIN, distro=distro))
    sim.advance_to(PERIOD)

    command(sim, "top", 0.1)
    sim.advance_to(4 * PERIOD)

    assert {name for name, state in states(sim).items() if state == "active"} == active
    (failure,) = events(sim)
    assert set(failure.deactivated) == set(CHAIN) - active


def test_a_joint_far_out_of_its_limits_is_not_commanded(tmp_path):
    limits = '<param name="min">-1</param><param name="max">1</param>'
    text = ROBOT.replace(
        '<command_interface name="position"/>',
        f'<command_interface name="position">{limits}</command_interface>',
    )
    initial = {"j1": 1.5}
    robot = load(
        tmp_path, groups("position"), text, distro="rolling", initial_positions=initial
    )
    sim = simulate(robot)

    command(sim, "position", 0.5, 0.5)
    sim.advance_to(1.0)

    assert states(sim) == {"position": "inactive"}
    np.testing.assert_allclose(sim.joint_states().position, [1.5, 0.0], atol=1e-3)
    (failure,) = (e for e in events(sim) if isinstance(e, ControllerFailure))
    assert failure.reason.startswith("joint 'j1': the joint is at 1.5")


def test_a_slow_controller_is_limited_by_its_own_commands(tmp_path):
    slow = {
        "slow": (f"type: {TYPES['position']}", "{joints: [j1, j2], update_rate: 10}")
    }
    sim = simulate(load(tmp_path, slow, distro="rolling"))

    command(sim, "slow", 3.0, 0.0)
    sim.advance_to(0.95)

    # Ten updates, each of which may move the command by one cycle of 10 rad/s.
    assert values(sim)["j1/position"] == pytest.approx(10 * 10.0 * PERIOD)


def test_commands_beyond_limits_are_reported_once_a_joint(tmp_path):
    sim = simulate(load(tmp_path, groups("position"), distro="rolling"))

    command(sim, "position", 5.0, 0.0)
    sim.advance_to(1.0)

    assert events(sim) == [CommandLimited("j1")]


def test_an_interface_of_its_own_can_be_commanded_by_another_controller(tmp_path):
    gain = '<command_interface name="gain"/><state_interface name="gain"/>'
    both = groups("position") | {
        "gains": (f"type: {FORWARD}", "{joints: [j1], interface_name: gain}")
    }
    text = ROBOT.replace(
        '<joint name="j1"><command', f'<joint name="j1">{gain}<command'
    )
    sim = simulate(load(tmp_path, both, text=text))

    assert set(states(sim).values()) == {"active"}


@pytest.mark.slow
def test_managers_that_no_common_step_fits_are_reported(tmp_path):
    robots = []
    for name, rate in (("one", 500), ("two", 333)):
        (tmp_path / name).mkdir()
        yaml = tmp_path / name
        robot = load(yaml, groups("position"))
        config = dc.replace(robot.controllers, update_rate=rate)
        robots.append(dc.replace(robot, name=name, controllers=config))
    diagram = ad.build_diagram(robots, options=ad.SimulationOptions(time_step=2e-3))
    sim = ad.Simulation(diagram)
    second = diagram.GetSubsystemByName("two/controller_manager")

    sim.advance_to(1.0)

    lines = [entry.what for entry in second.report]
    assert lines == ["update_rate 333 Hz doesn't fit those of the other robots"]
    context = second.GetMyContextFromRoot(sim.simulator.get_context())
    cycle = second.GetOutputPort("cycle").Eval(context)
    assert cycle.time_ns == pytest.approx(1e9, abs=1e9 * second.period)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distro", "manager", "largest"),
    [
        ("jazzy", "", 3.7),
        ("jazzy", ", enforce_command_limits: true", 3.0),
        ("rolling", "", 3.0),
        ("rolling", ", enforce_command_limits: false", 3.7),
        ("humble", ", enforce_command_limits: true", 3.7),
    ],
)
def test_commands_are_held_to_the_limits_where_that_is_on(
    tmp_path, distro, manager, largest
):
    robot = load(tmp_path, groups("position"), distro=distro, manager=manager)
    sim = simulate(robot)

    command(sim, "position", 3.7, 0.0)
    sim.advance_to(1.0)

    assert values(sim)["j1/position"] == largest


def test_a_limited_command_moves_no_faster_than_the_joint_may(tmp_path):
    sim = simulate(load(tmp_path, groups("position"), distro="rolling"))

    command(sim, "position", 1.0, 0.0)
    sim.advance_to(PERIOD / 2)

    assert values(sim)["j1/position"] == pytest.approx(10.0 * PERIOD)


@pytest.mark.slow
def test_a_saved_chain_continues_in_a_rebuilt_diagram_to_the_same_bits(tmp_path):
    robot = load(tmp_path, CHAIN)
    sim = simulate(robot)
    command(sim, "top", 0.8, -0.4)
    sim.advance_to(0.123)
    saved = sim.simulator.get_context().Clone()
    sim.advance_to(0.5)

    diagram = ad.build_diagram(robot)
    other = Simulator(diagram)
    other.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    other.AdvanceTo(0.5)

    state = diagram.GetOutputPort("state").Eval(other.get_context())
    np.testing.assert_array_equal(state, sim.eval_output("state"))


def test_a_rollout_tells_when_a_controller_wanted_something(tmp_path):
    sim = simulate(load(tmp_path, groups("position", "velocity")))
    command(sim, "position", 0.2, 0.1)
    sim.advance_to(0.5)
    sim.switch_controllers(["velocity"], ["position"])
    sim.advance_to(1.0)

    wanted = sim.rollout().references["position"].position

    assert wanted[40].tolist() == [0.2, 0.1]
    assert np.isnan(wanted[60]).all()


@pytest.mark.parametrize("state", ["inactive", "unconfigured"])
def test_hardware_that_starts_inactive_can_t_be_commanded(tmp_path, state):
    off = f", hardware_components_initial_state: {{{state}: [hardware]}}"

    sim = simulate(load(tmp_path, groups("position"), manager=off))

    assert states(sim) == {"position": "inactive"}
    (line,) = (entry for entry in sim.report if entry.severity != "info")
    assert line.what == (
        "'j1/position' belongs to hardware component 'hardware', which "
        "hardware_components_initial_state leaves inactive"
    )
