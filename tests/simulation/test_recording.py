"""Rollouts from a simulation's logs: the rows wanted, at the right times."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Context

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


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["accurate", "fast"])
@pytest.mark.parametrize("log_rate", [1000.0, 100.0, 50.0])
def test_a_log_of_another_rate_has_the_same_efforts_at_the_ticks(
    tmp_path, preset, log_rate
):
    rollouts = []
    for rate in (None, log_rate):
        options = {"preset": preset, "log_rate": rate, "time_step": None}
        sim = simulate(tmp_path, controllers(position="[shoulder, elbow]"), **options)
        assert not any(entry.what.startswith("fast: ") for entry in sim.report)
        sim.advance_to(0.1)
        command(sim, "position", 0.3, 0.5)
        sim.advance_to(0.3)
        rollouts.append(sim.rollout())
    at_ticks, rows = rollouts
    every, of = max(1, round(100.0 / log_rate)), max(1, round(log_rate / 100.0))

    np.testing.assert_array_equal(rows.time[::of], at_ticks.time[::every])
    # The periods differ in their last bits.
    np.testing.assert_allclose(
        rows.effort[::of], at_ticks.effort[::every], rtol=0.0, atol=1e-9
    )
    assert np.ptp(at_ticks.effort) > 1.0


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


def restore(sim: ad.Simulation, saved: Context) -> None:
    """Put a simulation into a saved state."""
    sim.simulator.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    sim.simulator.Initialize()


def halves(folder: Path, **options: object) -> tuple[ad.Simulation, Context]:
    """Return a simulation up to 0.05 s that follows commands, and a copy there."""
    sim = simulate(folder, BOTH, **options)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(0.05)
    return sim, sim.simulator.get_context().Clone()


FIELDS = ("time", "position", "velocity", "effort")


@pytest.mark.parametrize("rate", [None, 400.0, 30.0])
def test_a_rebuilt_diagram_has_the_ticks_since_its_restore(tmp_path, rate):
    sim, saved = halves(tmp_path, log_rate=rate, time_step=2.5e-3)
    sim.advance_to(0.1)
    whole = sim.rollout()
    other = simulate(tmp_path, BOTH, log_rate=rate, time_step=2.5e-3)

    restore(other, saved)
    other.advance_to(0.1)

    rollout = other.rollout()
    # The tick before 0.05 s is in the saved state.
    period = 0.01 if rate is None else 1.0 / rate
    first = round(np.ceil(0.05 / period - 1e-6)) - 1
    assert len(rollout.time) == len(whole.time) - first
    for name in FIELDS:
        np.testing.assert_array_equal(
            getattr(rollout, name), getattr(whole, name)[first:]
        )


def test_references_that_were_not_recorded_are_nan(tmp_path):
    _, saved = halves(tmp_path)
    other = simulate(tmp_path, BOTH)

    restore(other, saved)
    other.advance_to(0.08)

    rollout = other.rollout()
    assert rollout.time.tolist() == [0.04, 0.05, 0.06, 0.07]
    wanted = rollout.references["position"].position
    # What was wanted at 0.04 s is what tick 3 commanded, before the restore.
    np.testing.assert_array_equal(wanted, [[np.nan] * 2] + [[0.3, -0.2]] * 3)


def test_a_rebuilt_diagram_between_ticks_has_its_last_tick_at_once(tmp_path):
    sim, _ = halves(tmp_path)
    sim.advance_to(0.053)
    other = simulate(tmp_path, BOTH)

    restore(other, sim.simulator.get_context().Clone())

    rollout, whole = other.rollout(), sim.rollout()
    assert rollout.time.tolist() == [0.05]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(rollout, name), getattr(whole, name)[-1:])


def test_after_going_back_the_new_rows_count(tmp_path):
    sim, saved = halves(tmp_path)
    command(sim, "position", -0.5, 0.5)
    sim.advance_to(0.1)
    straight, _ = halves(tmp_path)
    for each in (sim, straight):
        if each is sim:
            restore(sim, saved)
        command(each, "position", 0.6, 0.6)
        each.advance_to(0.095)

    rollout, expected = sim.rollout(), straight.rollout()

    assert len(rollout.time) == 10
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(rollout, name), getattr(expected, name))
    wanted = rollout.references["position"].position
    np.testing.assert_array_equal(wanted, expected.references["position"].position)
    # The message is seen at 0.05 s.
    assert wanted[:, 0].tolist() == [0.0] + [0.3] * 5 + [0.6] * 4


@pytest.mark.parametrize("time", [0.05, 0.047])
def test_the_future_that_was_left_does_not_count(tmp_path, time):
    sim = simulate(tmp_path, BOTH)
    command(sim, "position", 0.3, -0.2)
    sim.advance_to(time)
    saved, before = sim.simulator.get_context().Clone(), sim.rollout()
    sim.advance_to(0.1)

    sim.simulator.get_mutable_context().SetTimeStateAndParametersFrom(saved)

    after = sim.rollout()
    assert len(after.time) == 5
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert len(after.references["position"].position) == 5


def test_ticks_that_were_jumped_over_are_left_out(tmp_path):
    _, saved = halves(tmp_path)
    other = simulate(tmp_path, BOTH)
    # That of 0.02 s isn't logged yet.
    other.advance_to(0.025)

    restore(other, saved)
    other.advance_to(0.07)

    assert other.rollout().time.tolist() == [0.0, 0.01, 0.04, 0.05, 0.06]


def test_rows_that_a_program_logs_besides_change_nothing(tmp_path):
    sim, _ = halves(tmp_path)
    plain = sim.rollout()
    other = simulate(tmp_path, BOTH)
    command(other, "position", 0.3, -0.2)
    for time in (0.0, 0.004, 0.01, 0.013, 0.017, 0.05):
        other.advance_to(time)
        other.diagram.ForcedPublish(other.simulator.get_context())

    rollout = other.rollout()

    for name in FIELDS:
        np.testing.assert_array_equal(getattr(rollout, name), getattr(plain, name))


def test_a_tick_that_was_already_run_is_not_taken_for_the_one_before(tmp_path):
    sim, _ = halves(tmp_path)
    # The very time of an event, which is rounded upwards.
    sim.advance_to(7 * sim.directory.manager(None).period)
    before, states = sim.rollout(), sim.joint_states()

    sim.simulator.AdvancePendingEvents()

    after = sim.rollout()
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    # Its time has come: the plant's next step is done.
    assert sim.joint_states() != states
