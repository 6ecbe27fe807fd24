"""A broadcaster below its manager's rate: when it samples, and what it says then."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

import arm_drake as ad
from arm_drake.controllers.cycles import Cycle
from arm_drake.manager.connections import SampledStates
from arm_drake.messages import DynamicJointState, Float64MultiArray, JointState, Time
from tests import models

BROADCASTER = "joint_state_broadcaster/JointStateBroadcaster"
EFFORT = "effort_controllers/JointGroupEffortController"


def make_robot(
    folder: Path, rate: int, manager_rate: int = 100, *, distro: str = "jazzy"
) -> ad.Robot:
    """Return a pendulum with an effort controller and a broadcaster of this rate."""
    yaml = f"""
controller_manager:
  ros__parameters:
    update_rate: {manager_rate}
    jsb: {{type: {BROADCASTER}}}
    group: {{type: {EFFORT}}}
jsb: {{ros__parameters: {{update_rate: {rate}}}}}
group: {{ros__parameters: {{joints: [swing]}}}}"""
    control = models.ros2_control("swing", command="effort")
    urdf = models.pendulum(control=control)
    return models.load(
        folder, urdf, yaml, distro=distro, initial_positions={"swing": 1.0}
    )


def simulate(robot: ad.Robot, **options: object) -> ad.Simulation:
    settings = ad.SimulationOptions(**options)
    return ad.Simulation(ad.build_diagram(robot, options=settings))


def message_of(sim: ad.Simulation) -> JointState:
    message: JointState = sim.eval_output("jsb.joint_states")
    return message


def ticks_of(sim: ad.Simulation, manager_rate: int, last: int) -> list[int]:
    """Return the cycles in which the broadcaster ticks, up to the last one."""
    start, found = round(sim.time * manager_rate), []
    for cycle in range(start, last + 1):
        sim.advance_to((cycle + 0.5) / manager_rate)
        message = message_of(sim)
        if not message.name:
            continue
        tick = round(message.header.stamp.to_seconds() * manager_rate)
        if tick not in found:
            # What it says is new in the cycle of the tick itself.
            assert tick == cycle
            found.append(tick)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["accurate", "kinematic"])
@pytest.mark.parametrize(
    ("manager_rate", "rate", "ticks"),
    [
        (100, 20, [0, 5, 10]),
        # Two ticks are 0.9 and 0.6 of a period off, three 0.1, four 0.2.
        (100, 30, [0, 3, 6, 9, 12]),
        (100, 70, [*range(13)]),
        # 2.5 cycles: of ticks as near, the earlier one.
        (100, 40, [0, 2, 4, 6, 8, 10, 12]),
        # 1.5 cycles: rounding decides, as in manager/lifecycle.py.
        (30, 20, [0, 2, 3, 5, 6, 8, 9, 11, 12]),
    ],
)
def test_it_ticks_by_the_manager_s_schedule(
    tmp_path, preset, manager_rate, rate, ticks
):
    sim = simulate(make_robot(tmp_path, rate, manager_rate), preset=preset)

    assert ticks_of(sim, manager_rate, 12) == ticks


def test_from_kilted_on_its_rate_divides_the_manager_s(tmp_path):
    sim = simulate(make_robot(tmp_path, 30, distro="rolling"))

    # 100 / 3, cut to 33 Hz.
    assert ticks_of(sim, 100, 12) == [0, 3, 6, 9, 12]


def test_it_ticks_first_in_the_cycle_of_its_activation(tmp_path):
    sim = simulate(make_robot(tmp_path, 10), inactive=("jsb",))
    sim.advance_to(0.055)
    assert message_of(sim) == JointState()

    sim.switch_controllers(["jsb"])

    assert ticks_of(sim, 100, 27) == [6, 16, 26]


def test_restarted_it_ticks_at_once(tmp_path):
    sim = simulate(make_robot(tmp_path, 10))
    sim.advance_to(0.055)

    sim.switch_controllers(["jsb"], ["jsb"])

    sim.advance_to(0.065)
    assert message_of(sim).header.stamp == Time(0, 60_000_000)


def test_what_was_sampled_before_a_pause_is_not_published_after_it(tmp_path):
    sim = simulate(make_robot(tmp_path, 10))
    sim.advance_to(0.055)
    sim.switch_controllers(deactivate=["jsb"])
    sim.advance_to(0.2)

    # Here it is told of its activation, and has not ticked yet.
    sim.switch_controllers(["jsb"])

    assert message_of(sim) == JointState()
    dynamic = sim.eval_output("jsb.dynamic_joint_states")
    assert dynamic == DynamicJointState()
    sim.advance_to(0.205)
    assert message_of(sim).header.stamp == Time(0, 200_000_000)


def test_it_publishes_the_state_at_its_tick_and_the_effort_caused_there(tmp_path):
    sim = simulate(make_robot(tmp_path, 30))
    sim.advance_to(0.05)
    sim.publish("group.commands", Float64MultiArray((2.0,)), 0.01)
    sim.advance_to(0.06)
    truth = sim.joint_states()

    sim.advance_to(0.085)

    message = message_of(sim)
    assert message.header.stamp == Time(0, 60_000_000)
    assert (message.position, message.velocity) == (truth.position, truth.velocity)
    assert message.effort == (2.0,)
    # At the next tick's own instant it hasn't run yet.
    sim.advance_to(0.09)
    assert message_of(sim) == message
    assert sim.joint_states().position != message.position


def test_each_broadcaster_ticks_by_itself(tmp_path):
    robot = make_robot(tmp_path, 20)
    yaml = tmp_path / "controllers.yaml"
    text = yaml.read_text(encoding="utf-8")
    text = text.replace("    group:", f"    other: {{type: {BROADCASTER}}}\n    group:")
    text += "\nother: {ros__parameters: {update_rate: 50}}"
    yaml.write_text(text, encoding="utf-8")
    robot = ad.load_robot(tmp_path / "robot.urdf", controllers=yaml)
    sim = simulate(robot)

    sim.advance_to(0.095)

    assert message_of(sim).header.stamp == Time(0, 50_000_000)
    assert sim.eval_output("other.joint_states").header.stamp == Time(0, 80_000_000)


def test_a_saved_context_continues_in_a_rebuilt_diagram(tmp_path):
    robot = make_robot(tmp_path, 30)
    sim, other = simulate(robot), simulate(robot)
    sim.advance_to(0.075)
    saved = sim.simulator.get_context().Clone()

    other.simulator.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    other.simulator.Initialize()

    assert message_of(other) == message_of(sim)
    assert message_of(sim).header.stamp == Time(0, 60_000_000)
    for time in (0.095, 0.125):
        sim.advance_to(time)
        other.advance_to(time)
        assert message_of(other) == message_of(sim)
    assert message_of(sim).header.stamp == Time(0, 120_000_000)


def step(simulator: Simulator, cycle: Cycle, *measured: float) -> Context:
    """Let a manager's cycle pass at 100 Hz."""
    context = simulator.get_mutable_context()
    system = simulator.get_system()
    manager_port = system.GetInputPort("controller_manager")
    manager_port.FixValue(context, AbstractValue.Make(cycle))
    system.GetInputPort("state_interfaces").FixValue(context, measured)
    simulator.AdvanceTo(cycle.number * 0.01 + 0.005)
    return context


def test_between_ticks_values_and_time_are_held() -> None:
    system = SampledStates("slow", 2, 0.01)
    simulator = Simulator(system)
    values = system.GetOutputPort("state_interfaces")
    time = system.GetOutputPort("tick_time")
    idle = Cycle(0, 0, 10_000_000, {"slow": 0}, periods={"slow": 0})
    # More nanoseconds than a float of 32 bits would hold, and odd.
    late = 2**53 - 1

    context = step(simulator, idle, 1.0, 2.0)
    assert np.isnan(time.Eval(context))
    due = idle._replace(number=1, time_ns=late, periods={"slow": 20_000_000})
    context = step(simulator, due, 3.0, 4.0)
    context = step(simulator, idle._replace(number=2, time_ns=5), 5.0, 6.0)

    assert values.Eval(context).tolist() == [3.0, 4.0]
    assert int(time.Eval(context)[0]) == late
    gone = idle._replace(number=3, active={}, periods={})
    assert np.isnan(time.Eval(step(simulator, gone, 7.0, 8.0)))
