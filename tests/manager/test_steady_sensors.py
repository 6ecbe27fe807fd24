"""Broadcasters of sensors tick steadily, and leave the bits of full ticks leave."""

import dataclasses as dc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.controllers.sensor_broadcasters import RangeSensorBroadcaster
from arm_drake.controllers.topics import SensorBroadcaster
from arm_drake.manager.controller_manager import SWITCH_PORT
from arm_drake.manager.lifecycle import TickKeeper
from arm_drake.messages import (
    Header,
    InterfaceValue,
    JointTrajectory,
    JointTrajectoryPoint,
    SwitchController,
)
from arm_drake.messages.control import DynamicInterfaceGroupValues
from arm_drake.messages.sensors import Range
from tests import models
from tests.controllers.driving import NAME, make_params
from tests.controllers.parameters import (
    BATTERY,
    GPS,
    IMU,
    MAGNETOMETER,
    MINIMAL,
    POSE,
    RANGE,
    SAFETY,
    STATES,
    WRENCH,
    load,
)
from tests.manager.both_ways import Count, Managed, compare

FILTER = {
    "type": "control_filters/LowPassFilterWrench",
    "params.sampling_frequency": 100.0,
    "params.damping_frequency": 7.0,
    "params.damping_intensity": 1.5,
}
FILTERS = {
    f"sensor_filter_chain.filter{number}.{name}": value
    for number in (1, 2)
    for name, value in {"name": f"{number}", **FILTER}.items()
}
OFFSETS: Mapping[str, Any] = {"offset.force.x": 0.1, "multiplier.torque.z": -2.5}


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch) -> Count:
    """Compare both ways in each cycle."""
    counted = Count()
    compare(counted, monkeypatch)
    return counted


def manage(
    type_: str, values: Mapping[str, Any] | None = None, system: Any = None
) -> Managed:
    """Return a broadcaster with its manager; of a joint, and of what it reads."""
    make, parameters = system or CONTROLLER_TYPES[type_].system, load(type_, values)
    assert make is not None
    params = dc.replace(make_params(("a",)), is_managed=True)
    names = make(parameters, params).state_interfaces
    measured = (*params.measured, *(n for n in names if n not in params.measured))
    params = dc.replace(params, measured=measured, state_interfaces=frozenset(measured))
    return Managed(make(parameters, params), ("a/position",), "active")


def play(managed: Managed, rows: np.ndarray) -> None:
    """Run a cycle for each row of what is measured, with a break of ten."""
    for number, row in enumerate(rows):
        if number in (40, 50):
            names: Any = [(), (NAME,)]
            start, stop = names if number == 40 else names[::-1]
            request = AbstractValue.Make((SwitchController(start, stop),))
            managed.fix(managed.manager, SWITCH_PORT, request)
        managed.measure(row.tolist())
        managed.simulator.AdvanceTo((number + 0.5) / 100)


@pytest.mark.parametrize(
    ("type_", "values"),
    [
        (IMU, {}),
        (IMU, {"rotation_offset.yaw": 0.7}),
        (WRENCH, OFFSETS),
        (WRENCH, OFFSETS | FILTERS),
        (RANGE, {}),
        (POSE, {}),
        (POSE, {"tf.enable": False}),
        (GPS, {"read_covariance_from_interface": True}),
        (MAGNETOMETER, {}),
        (BATTERY, {"batteries": ["b"], "interfaces.b.battery_charge": True}),
        (STATES, {"interfaces": ["a/position", "a/effort", "b"]}),
        (STATES, {"interfaces": ["a/velocity"]}),
        (SAFETY, {"interfaces.e_stop.manual": ["m"]}),
    ],
)
def test_broadcasters_are_the_same_both_ways(
    count: Count, type_: str, values: Mapping[str, Any]
) -> None:
    managed = manage(type_, {**MINIMAL[type_], **values})
    size = len(managed.system.params.measured)
    rows = np.random.default_rng(7).normal(size=(100, size))
    if type_ == POSE:
        rows[:, -4:] /= np.linalg.norm(rows[:, -4:], axis=1, keepdims=True)
        rows[80:85, -4:] *= 2.0
    rows[30, -1] = np.nan

    play(managed, rows)

    # The first cycle, two switches, the first after the second; ten while it rests.
    num_invalid = 6 if type_ == POSE and values == {} else 0
    assert count.total == 100
    assert count.num_steady >= 100 - 5 - num_invalid, count
    assert count.num_steady <= 100 - 3 - num_invalid, count


def test_all_types_of_sensors_are_among_them() -> None:
    types = {
        name
        for name, row in CONTROLLER_TYPES.items()
        if isinstance(row.system, type) and issubclass(row.system, SensorBroadcaster)
    }

    assert types >= {IMU, WRENCH, RANGE, POSE, GPS, MAGNETOMETER, BATTERY, STATES}
    for name in types:
        assert vars(CONTROLLER_TYPES[name].system)["reads_by_now"], name


class _Counter(RangeSensorBroadcaster):
    """Reads the Context in each of its ticks."""

    def _update(self, now: UpdateContext, state: Range) -> Range:
        assert now.context is not None
        return dc.replace(super()._update(now, state), max_range=state.max_range + 1.0)


def test_one_with_an_update_of_its_own_does_it_in_every_cycle() -> None:
    managed = manage(RANGE, MINIMAL[RANGE], _Counter)

    play(managed, np.ones((30, len(managed.system.params.measured))))

    shown = managed.system.GetOutputPort("range").Eval(managed.context)
    assert shown.max_range == 30.0


SENSORS = "".join(
    f'<state_interface name="{name}"/>'
    for name in (
        *(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz"),
        *(f"orientation.{axis}" for axis in "xyzw"),
        *(f"angular_velocity.{axis}" for axis in "xyz"),
        *(f"linear_acceleration.{axis}" for axis in "xyz"),
    )
)
ARM = """
controller_manager:
  ros__parameters:
    update_rate: 200
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    wrench: {type: force_torque_sensor_broadcaster/ForceTorqueSensorBroadcaster}
    imu: {type: imu_sensor_broadcaster/IMUSensorBroadcaster}
    states: {type: state_interfaces_broadcaster/StateInterfacesBroadcaster}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
wrench:
  ros__parameters:
    sensor_name: hand
    frame_id: bob
    sensor_filter_chain:
      filter1:
        name: smooth
        type: control_filters/LowPassFilterWrench
        params:
          {sampling_frequency: 200.0, damping_frequency: 20.0, damping_intensity: 1.0}
      filter2:
        name: weight
        type: control_filters/GravityCompensationWrench
        params:
          world_frame: base
          sensor_frame: bob
          tool: {mass: 1.0, CoG: [0.0, 0.0, -0.5]}
imu: {ros__parameters: {sensor_name: hand, frame_id: bob}}
states: {ros__parameters: {interfaces: [swing/position, swing/effort]}}
"""


def simulate(folder: Path, **options: Any) -> ad.Simulation:
    """Return a pendulum with sensors that follows a trajectory."""
    sensor = f'<sensor name="hand"><param name="frame_id">bob</param>{SENSORS}</sensor>'
    control = models.ros2_control("swing")
    control = control.replace("</ros2_control>", f"{sensor}</ros2_control>")
    robot = models.load(folder, models.pendulum(control=control), ARM)
    chosen = ad.SimulationOptions(**options)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=chosen))
    point = JointTrajectoryPoint([0.5], [0.0], time_from_start=1.0)
    message = JointTrajectory(joint_names=["swing"], points=[point])
    sim.controller("arm").send_trajectory(message)
    return sim


def read_state(simulator: Simulator) -> list[Any]:
    context = simulator.get_context()
    state = context.get_discrete_state()
    vectors = [state.value(i).tobytes() for i in range(state.num_groups())]
    return [context.get_time(), *vectors]


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"preset": "accurate"},
        {"preset": "kinematic"},
        {"state_noise": {"effort": 0.1, "position": 0.01}, "state_delay": 2},
    ],
)
def test_an_arm_with_sensors_ticks_steadily(
    count: Count, tmp_path: Path, options: dict[str, Any]
) -> None:
    sim = simulate(tmp_path, **options)
    sim.run(0.5)

    assert count.steady_share > 0.97, count
    values = sim.topic("/states/values").value()
    assert values.header.stamp.nanosec == 495_000_000
    assert values.values[0] > 0.01
    if options.get("preset") == "accurate":
        filtered = sim.topic("/wrench/wrench_filtered").value().wrench.force
        assert filtered.z == pytest.approx(0.0, abs=0.2 * models.GRAVITY)


@pytest.mark.slow
def test_an_arm_beside_a_sensor_that_is_off_reads_motions_alone(
    count: Count, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure, sizes = TickKeeper.measure, []

    def look(keeper: TickKeeper, context: Any, *, reads_all: bool) -> np.ndarray:
        found = measure(keeper, context, reads_all=reads_all)
        sizes.append(len(found))
        return found

    monkeypatch.setattr(TickKeeper, "measure", look)
    sim, sensors = simulate(tmp_path), ("wrench", "imu", "states")
    sim.run(0.1)
    # Position, velocity, effort; a wrench, and what the inertial unit measures.
    assert set(sizes) == {3 + 6 + 10}
    sim.switch_controllers(deactivate=sensors)
    sim.run(0.1)
    stamp = sim.topic("/imu/imu").value().header.stamp
    num_full = count.num_full
    sizes.clear()
    sim.run(0.1)
    assert count.num_full == num_full
    assert set(sizes) == {2}
    assert sim.topic("/imu/imu").value().header.stamp == stamp
    sim.switch_controllers(activate=sensors)
    sim.run(0.1)

    assert count.num_full <= num_full + 2
    assert sim.topic("/imu/imu").value().header.stamp.nanosec == 395_000_000


@pytest.mark.slow
def test_a_context_goes_on_from_the_middle_of_steady_sensors(
    count: Count, tmp_path: Path
) -> None:
    sim = simulate(tmp_path)
    sim.advance_to(0.253)
    saved = sim.simulator.get_context().Clone()
    sim.advance_to(0.653)
    expected = read_state(sim.simulator)

    sim.simulator.reset_context(saved.Clone())
    sim.advance_to(0.653)
    assert read_state(sim.simulator) == expected

    rebuilt = Simulator(simulate(tmp_path).diagram)
    rebuilt.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    rebuilt.AdvanceTo(0.653)
    assert read_state(rebuilt) == expected
    assert count.steady_share > 0.95, count


INOUT = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: passthrough_controller/PassthroughController}
    inout: {type: gpio_controllers/GpioCommandController}
arm: {ros__parameters: {interfaces: [swing/position]}}
inout:
  ros__parameters:
    gpios: [lamp]
    command_interfaces: {lamp: {interfaces: ["on"]}}
"""


@pytest.mark.slow
def test_what_holds_a_command_ticks_steadily(count: Count, tmp_path: Path) -> None:
    lamp = '<command_interface name="on"/><state_interface name="on"/>'
    control = models.ros2_control("swing").replace(
        "</ros2_control>", f'<gpio name="lamp">{lamp}</gpio></ros2_control>'
    )
    robot = models.load(tmp_path, models.pendulum(control=control), INOUT)
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.run(0.1)
    sim.topic("/arm/commands").publish([0.2])
    values = (InterfaceValue(("on",), (1.0,)),)
    message = DynamicInterfaceGroupValues(Header(), ("lamp",), values)
    sim.topic("/inout/commands").publish(message)
    sim.run(0.4)

    # The first cycle, and that of the messages.
    assert count.num_steady == count.total - 2, count
    states = sim.topic("/inout/gpio_states").value()
    assert states.interface_values[0].values == (1.0,)
    assert states.header.stamp.nanosec == 490_000_000
    assert sim.joint_states().position[0] == pytest.approx(0.2, abs=1e-3)
