"""Controllers that read each other see what was exported in this very tick."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from tests import models

URDF = models.pendulum(
    control=models.ros2_control("swing").replace(
        "gz_ros2_control/GazeboSimSystem", "mock_components/GenericSystem"
    )
)
PERIOD = 0.01

TYPES = {
    "filter": "chained_filter_controller/ChainedFilter",
    "second": "chained_filter_controller/ChainedFilter",
    "group": "position_controllers/JointGroupPositionController",
    "pid": "pid_controller/PidController",
    "outer": "pid_controller/PidController",
    "watcher": "state_interfaces_broadcaster/StateInterfacesBroadcaster",
}

GROUP = "{joints: [swing]}"

# Without filters an output is its input.
FILTER = "{input_interfaces: [swing/position], output_interfaces: [swing/position]}"
SECOND = "{input_interfaces: [filter/swing/position], output_interfaces: [swing/x]}"


def pid(joint: str, measured: str, p: float) -> str:
    """Return a PID that commands the position of a joint."""
    return (
        f"{{dof_names: [{joint}], command_interface: position, "
        f"reference_and_state_interfaces: [position], "
        f"reference_and_state_dof_names: [{measured}], gains: {{{joint}: {{p: {p}}}}}}}"
    )


def watcher(*names: str) -> str:
    return f"{{interfaces: [{', '.join(names)}]}}"


def simulate(folder: Path, sections: dict[str, str]) -> ad.Simulation:
    types = "\n".join(f"    {name}: {{type: {TYPES[name]}}}" for name in sections)
    nodes = "\n".join(f"{n}: {{ros__parameters: {p}}}" for n, p in sections.items())
    yaml = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
{types}
{nodes}
"""
    robot = models.load(folder, URDF, yaml)
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    assert {c.state for c in sim.list_controllers()} == {"active"}
    return sim


def watch(sim: ad.Simulation, num_ticks: int) -> list[tuple[float, ...]]:
    """Return what the watcher publishes, tick by tick."""
    rows = []
    for tick in range(num_ticks):
        sim.advance_to((tick + 0.5) * PERIOD)
        rows.append(sim.topic("/watcher/values").value().values)
    return rows


def orders(*names: str) -> list[tuple[str, ...]]:
    return [names, names[::-1]]


@pytest.mark.parametrize("order", orders("group", "filter", "second", "watcher"))
def test_a_reader_sees_this_very_tick(tmp_path: Path, order: tuple[str, ...]) -> None:
    names = ("swing/position", "filter/swing/position", "second/swing/x")
    sections = {
        "group": GROUP,
        "filter": FILTER,
        "second": SECOND,
        "watcher": watcher(*names),
    }
    sim = simulate(tmp_path, {name: sections[name] for name in order})

    rows = []
    for tick in range(6):
        sim.controller("group").command([0.1 * tick])
        sim.advance_to((tick + 0.5) * PERIOD)
        rows.append(sim.topic("/watcher/values").value().values)

    # The mirrored joint moves at every tick but the first; both outputs are with it.
    measured, once, twice = np.transpose(rows)
    assert (np.diff(measured) != 0.0)[1:].all()
    np.testing.assert_array_equal(once, measured)
    np.testing.assert_array_equal(twice, measured)


@pytest.mark.parametrize("order", orders("filter", "pid"))
def test_a_controller_acts_on_what_is_filtered_in_this_tick(
    tmp_path: Path, order: tuple[str, ...]
) -> None:
    sections = {"filter": FILTER, "pid": pid("swing", "filter/swing", 0.5)}
    sim = simulate(tmp_path, {name: sections[name] for name in order})

    commands = []
    for tick in range(6):
        if tick == 1:
            sim.controller("pid").command([1.0])
        sim.advance_to((tick + 0.5) * PERIOD)
        commands.append(sim.controller("pid").state().dof_states[0].output)

    # The joint is where the last command was: u[k] = (1 - u[k - 1]) / 2. A tick late it
    # would be (1 - u[k - 2]) / 2.
    np.testing.assert_array_equal(commands[1:], [0.5, 0.25, 0.375, 0.3125, 0.34375])


def test_who_commands_the_exporter_sees_the_tick_before(tmp_path: Path) -> None:
    names = ("swing/position", "pid/swing/position", "filter/swing/position")
    sim = simulate(
        tmp_path,
        {
            # It commands the pid, whose measurement it gets back through the filter.
            "outer": pid("pid/swing", "filter/swing", 0.5),
            "pid": pid("swing", "swing", 1.0),
            "filter": FILTER.replace("[swing/position]", "[pid/swing/position]", 1),
            "watcher": watcher(*names),
        },
    )
    sim.controller("outer").command([1.0])

    rows = np.array(watch(sim, 8))

    position, exported, filtered = rows.T
    np.testing.assert_array_equal(exported, position)
    np.testing.assert_array_equal(filtered, position)
    # With the filter's last output y[k - 1] = q[k - 1]:
    # q[k + 1] = r[k] - q[k], r[k] = (1 - q[k - 1]) / 2.
    expected = 0.5 * (1.0 - position[1:-2]) - position[2:-1]
    np.testing.assert_allclose(position[3:], expected, rtol=1e-15)
    assert np.ptp(position) > 0.1
