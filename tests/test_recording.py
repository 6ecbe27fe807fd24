"""What a simulation's logs become: rows at the right times, and what was wanted."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.messages import Float64MultiArray
from tests import models

PERIOD = 0.01

GROUPS = {
    "position": "position_controllers/JointGroupPositionController",
    "effort": "effort_controllers/JointGroupEffortController",
}
JOINTS = "".join(
    f'<joint name="{name}">'
    + "".join(f'<command_interface name="{kind}"/>' for kind in GROUPS)
    + '<state_interface name="position"/></joint>'
    for name in ("shoulder", "elbow")
)
CONTROL = (
    '<ros2_control name="hardware" type="system"><hardware>'
    f"<plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>{JOINTS}"
    "</ros2_control>"
)
UPPER = 'lower="-3" upper="3" effort="0" velocity="10"'
ARM = f"""
<robot name="arm">
  <link name="base"/>{models.bob("upper")}{models.bob("lower")}
  {models.joint("elbow", "upper", "lower", xyz=f"0 0 {-models.LENGTH}")}
  {models.joint("shoulder", "base", "upper", limit=UPPER)}{CONTROL}
</robot>"""


def controllers(**joints: str) -> str:
    """Return a YAML with groups for these joints, such as position="[elbow]"."""
    rows = "".join(f", {name}: {{type: {GROUPS[name]}}}" for name in joints)
    lines = [
        f"controller_manager: {{ros__parameters: {{update_rate: 100{rows}}}}}",
        *(f"{n}: {{ros__parameters: {{joints: {j}}}}}" for n, j in joints.items()),
    ]
    return "\n".join(lines)


def simulate(folder: Path, yaml: str, **options: object) -> ad.Simulation:
    robot = models.load(folder, ARM, yaml, initial_positions={"elbow": 0.4})
    settings = ad.SimulationOptions(**{"time_step": PERIOD, **options})
    return ad.Simulation(ad.build_diagram(robot, options=settings))


def command(sim: ad.Simulation, controller: str, *values: float) -> None:
    sim.publish(f"{controller}.commands", Float64MultiArray(values), PERIOD)


BOTH = controllers(position="[shoulder, elbow]", effort="[shoulder, elbow]")


@pytest.mark.parametrize(
    ("rate", "end", "times"),
    [
        (None, 0.0, []),
        (None, 0.025, [0.0, 0.01, 0.02]),
        # The tick at the end is still to come.
        (None, 0.03, [0.0, 0.01, 0.02]),
        (50.0, 0.05, [0.0, 0.02, 0.04]),
        (400.0, 0.006, [0.0, 0.0025, 0.005]),
    ],
)
def test_rows_are_at_the_ticks_of_the_log(tmp_path, rate, end, times):
    sim = simulate(tmp_path, BOTH, log_rate=rate, time_step=2.5e-3)
    sim.advance_to(end)

    rollout = sim.rollout()

    assert rollout.time.tolist() == times
    for values in (rollout.position, rollout.velocity, rollout.effort):
        assert values.shape == (len(times), 2)


def test_times_are_whole_nanoseconds(tmp_path):
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(3.0)

    time = sim.rollout().time

    assert time.tolist() == [k / 100 for k in range(300)]


def test_columns_are_the_joints_of_the_description(tmp_path):
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)

    rollout = sim.rollout()

    assert rollout.joint_names == ("elbow", "shoulder")
    assert rollout.joint_types == ("revolute", "revolute")
    assert rollout.effort_limit.tolist() == [100.0, np.inf]
    np.testing.assert_allclose(rollout.position[0], [0.4, 0.0], atol=1e-15)


def test_a_row_is_the_state_at_the_tick(tmp_path):
    sim = simulate(tmp_path, BOTH)
    command(sim, "position", 0.3, -0.2)
    seen = []
    for tick in range(1, 30):
        sim.advance_to(tick * PERIOD)
        seen.append(sim.joint_states())

    sim.advance_to(30 * PERIOD)

    rollout = sim.rollout()
    for row, states in enumerate(seen, start=1):
        assert tuple(rollout.position[row]) == states.position
        assert tuple(rollout.velocity[row]) == states.velocity
    assert np.ptp(rollout.position[:, 1]) > 0.1


def test_efforts_are_those_that_a_tick_causes(tmp_path):
    sim = simulate(tmp_path, controllers(effort="[shoulder, elbow]"))
    sim.advance_to(0.025)
    command(sim, "effort", 2.0, -1.0)
    sim.advance_to(0.05)

    effort = sim.rollout().effort

    # The message is seen in the tick at 0.03 s.
    assert effort.tolist() == [[0.0, 0.0]] * 3 + [[-1.0, 2.0]] * 2


def test_the_last_row_is_there_before_it_is_logged(tmp_path):
    sim = simulate(tmp_path, controllers(effort="[shoulder, elbow]"))
    command(sim, "effort", 2.0, -1.0)
    sim.advance_to(0.035)
    early = sim.rollout()

    sim.advance_to(0.1)

    late = sim.rollout()
    assert len(early.time) == 4
    for name in ("time", "position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(early, name), getattr(late, name)[:4])


def test_a_reference_is_what_the_cycle_before_commanded(tmp_path):
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(0.045)

    reference = sim.rollout().references["position"]

    assert reference.joint_names == ("shoulder", "elbow")
    # Joints hold where they start; the message is seen at 0.02 s.
    assert reference.position.tolist() == [[0.0, 0.4]] * 3 + [[0.3, -0.2]] * 2


def test_between_ticks_a_reference_is_that_of_the_tick_before(tmp_path):
    sim = simulate(tmp_path, BOTH, log_rate=400.0, time_step=2.5e-3)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(0.015)
    command(sim, "position", 0.5, -0.2)
    sim.advance_to(0.029)

    rollout = sim.rollout()

    wanted = rollout.references["position"].position[:, 0]
    assert rollout.time.tolist() == [k / 400 for k in range(12)]
    assert wanted.tolist() == [0.0] + [0.3] * 8 + [0.5] * 3


def test_there_are_references_while_a_controller_is_active(tmp_path):
    sim = simulate(tmp_path, BOTH)
    sim.advance_to(0.015)
    sim.switch_controllers(["effort"], ["position"])
    sim.advance_to(0.035)
    sim.switch_controllers(["position"], ["effort"])
    sim.advance_to(0.06)

    references = sim.rollout().references

    # Active in the ticks 0 and 1, and from 4 on.
    is_there = ~np.isnan(references["position"].position[:, 0])
    assert is_there.tolist() == [True, True, True, False, False, True]
    # One that commands no positions has no reference.
    assert set(references) == {"position"}


def test_one_that_was_never_active_has_no_reference(tmp_path):
    sim = simulate(tmp_path, BOTH, inactive=("position",))
    sim.advance_to(0.05)

    assert sim.rollout().references == {}


def test_a_simulation_that_starts_over_is_recorded_anew(tmp_path):
    sim = simulate(tmp_path, BOTH)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(0.5)
    sim.reset()
    sim.advance_to(0.02)

    rollout = sim.rollout()

    assert rollout.time.tolist() == [0.0, 0.01]
    np.testing.assert_allclose(rollout.position, [[0.4, 0.0]] * 2, atol=1e-12)
