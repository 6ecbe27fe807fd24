"""Memory stays flat however many ticks there are: controllers, manager, messages.

What grows by design is kept out: the logs that a rollout is made of are emptied at
every sample, which keeps their capacity, and trajectories go to the topic, for a
program keeps the handles of the goals that it sends. A fresh process measures, since
what others have freed would hide growth:

    python -m tests.test_memory TICKS [LEAK...]
"""

import functools
import gc
import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pytest

RATE = 1000
ONE_MILLION = 10**6

# Trajectories are sent as often, each in the midst of the last one [ticks].
EVERY = 200

# Samples of the memory, without those before everything has been allocated once.
NUM_SAMPLES, NUM_FIRST = 25, 5

# What a tick may leave behind: Python's objects, and resident memory [bytes]. One more
# page table or arena in all the samples is no leak; an object in every tick is 1 block
# and at least 32 bytes.
MAX_BLOCKS = 0.02
MAX_BYTES = 16.0

JOINTS = ("j1", "j2", "j3")

URDF = """
<robot name="arm">
  <link name="base"/>
  {joints}
  <ros2_control name="hardware" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    {interfaces}
  </ros2_control>
</robot>"""

JOINT = """
  <joint name="j{k}" type="revolute">
    <parent link="{parent}"/><child link="l{k}"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="10" velocity="5"/>
  </joint>
  <link name="l{k}"/>"""

INTERFACES = """
    <joint name="j{k}">
      <command_interface name="position"/>
      <state_interface name="position"/><state_interface name="velocity"/>
    </joint>"""

CONTROLLERS = f"""
controller_manager:
  ros__parameters:
    update_rate: {RATE}
    states: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
    pid: {{type: pid_controller/PidController}}
arm:
  ros__parameters:
    joints: [j1, j2]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
pid:
  ros__parameters:
    dof_names: [j3]
    command_interface: position
    reference_and_state_interfaces: [position]
    gains: {{j3: {{p: 0.5, i: 0.1}}}}
"""


class Slopes(NamedTuple):
    """What a tick leaves behind."""

    # Python's objects.
    blocks: float

    # Resident memory [bytes].
    resident: float


def resident_memory() -> int:
    """Return the resident memory of this process [bytes]; the most of it so far where
    the system doesn't tell."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(statm.read_text(encoding="ascii").split()[1]) * resource.getpagesize()


def make_simulation() -> Any:
    """Return a robot without physics, with controllers of three kinds."""
    import arm_drake as ad

    numbers = range(1, len(JOINTS) + 1)
    parents = ("base", "l1", "l2")
    joints = "".join(JOINT.format(k=k, parent=parents[k - 1]) for k in numbers)
    urdf = URDF.format(
        joints=joints, interfaces="".join(INTERFACES.format(k=k) for k in numbers)
    )
    with TemporaryDirectory() as folder:
        file, yaml = Path(folder) / "arm.urdf", Path(folder) / "controllers.yaml"
        file.write_text(urdf, encoding="utf-8")
        yaml.write_text(CONTROLLERS, encoding="utf-8")
        robot = ad.load_robot(file, controllers=yaml)
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    assert {row.state for row in sim.list_controllers()} == {"active"}
    return sim


def send(sim: Any, number: int) -> None:
    """Send a trajectory that the next one interrupts, and a reference."""
    import arm_drake as ad

    target = (-1.0) ** number
    seconds = 2.0 * EVERY / RATE
    points = [
        ad.JointTrajectoryPoint((part * target, 0.5), time_from_start=part * seconds)
        for part in (0.5, 1.0)
    ]
    arm = sim.controller("arm")
    arm.send_trajectory(ad.JointTrajectory(joint_names=("j1", "j2"), points=points))
    sim.controller("pid").command([0.1 * target])


def empty_logs(sim: Any) -> None:
    """Forget what was logged."""
    from pydrake.systems.primitives import VectorLogSink

    for system in sim.diagram.GetSystems():
        if isinstance(system, VectorLogSink):
            system.FindMutableLog(sim.simulator.get_mutable_context()).Clear()
    sim.mailbox.forget_before(sim.time)


def measure(num_ticks: int) -> Slopes:
    """Return what a tick leaves behind in this process."""
    sim = make_simulation()
    rows = []
    # What is there before the first tick is no garbage later, and to look through it
    # at each sample takes a sixth of the time.
    gc.collect()
    gc.freeze()
    per_sample = num_ticks // NUM_SAMPLES
    assert per_sample % EVERY == 0
    for sample in range(1, NUM_SAMPLES + 1):
        for start in range((sample - 1) * per_sample, sample * per_sample, EVERY):
            send(sim, start // EVERY)
            sim.advance_to((start + EVERY) / RATE)
            # What is published is read too.
            sim.controller("arm").state()
            sim.eval_output("states.joint_states")
        empty_logs(sim)
        gc.collect()
        rows.append((sample * per_sample, sys.getallocatedblocks(), resident_memory()))
    assert not sim.rejected
    moved = sim.joint_states().position
    assert all(abs(angle) > 1e-3 for angle in moved), moved
    ticks, blocks, resident = np.array(rows[NUM_FIRST:], dtype=float).T
    return Slopes(
        *(float(np.polyfit(ticks, values, 1)[0]) for values in (blocks, resident))
    )


def leak_ticks(kept: Any, original: Callable[..., Any]) -> Callable[..., Any]:
    """Return an update that keeps what every tick has left behind."""

    def update(self: Any, context: Any, state: Any) -> None:
        original(self, context, state)
        kept.append(self._cycle.Eval(context))

    return update


def leak_bytes(kept: Any, original: Callable[..., Any]) -> Callable[..., Any]:
    """Return an update that lets one buffer grow, which is no new object."""

    def update(self: Any, context: Any, state: Any) -> None:
        original(self, context, state)
        kept.extend(b"x" * 64)

    return update


LEAKS = {"ticks": (leak_ticks, list), "bytes": (leak_bytes, bytearray)}


def measure_leak(num_ticks: int, name: str) -> Slopes:
    """Return what a tick leaves behind when the manager leaks."""
    from arm_drake.manager import ControllerManager

    make, container = LEAKS[name]
    update = make(container(), ControllerManager._update)
    with mock.patch.object(ControllerManager, "_update", update):
        return measure(num_ticks)


def run(num_ticks: int, *leaks: str) -> list[Slopes]:
    """Return what a tick leaves behind, measured in a process of its own.

    Args:
        num_ticks: How many ticks there are.
        leaks: With which leaks, one after the other; by default once without any.
    """
    done = subprocess.run(
        [sys.executable, "-m", "tests.test_memory", str(num_ticks), *leaks],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[1],
    )
    assert done.returncode == 0, done.stderr
    return [Slopes(*slopes) for slopes in json.loads(done.stdout)]


@pytest.mark.slow
def test_memory_is_flat() -> None:
    (slopes,) = run(ONE_MILLION // 20)

    assert slopes.blocks < MAX_BLOCKS
    assert slopes.resident < MAX_BYTES


@pytest.mark.slow
@pytest.mark.long
def test_memory_is_flat_over_a_million_ticks() -> None:
    (slopes,) = run(ONE_MILLION)

    # Twenty times as long, twenty times as sharp.
    assert slopes.blocks < MAX_BLOCKS / 20
    assert slopes.resident < MAX_BYTES / 20


@pytest.mark.slow
def test_a_leak_is_seen() -> None:
    # The buffer first: what the ticks have kept is free then, and would be used again.
    bytes_, ticks = run(ONE_MILLION // 200, "bytes", "ticks")

    assert bytes_.resident > 2.0 * MAX_BYTES
    # An object in every tick; so few ticks leave 0.05 without any leak.
    assert ticks.blocks > 1.0 > 2.0 * MAX_BLOCKS


if __name__ == "__main__":
    ticks, *leaks = sys.argv[1:]
    one = functools.partial(measure_leak, int(ticks))
    print(json.dumps([one(leak) for leak in leaks] or [measure(int(ticks))]))
