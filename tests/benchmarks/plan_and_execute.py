"""Plans that are executed: rounds of plan, send, simulate, with all contacts logged.

Each robot stands between boxes in the default physics, and moves from one random free
configuration to the next. A round is right if its plan was found, the action ended as
succeeded, and no link of the robot touched a box in any cycle of the manager.

    python -m tests.benchmarks.plan_and_execute [--rounds 250] [--robots NAME ...]
"""

import argparse
import sys
import time

import numpy as np
from pydrake.multibody.plant import ContactResults

import arm_drake as ad
from arm_drake.errors import ArmDrakeError
from arm_drake.plant.joint_ranges import joint_ranges
from tests.benchmarks.inverse_kinematics import load
from tests.benchmarks.planning import RANGE, ROBOTS, make_boxes

# By name, with a trajectory controller: how large a scene is.
ARMS = {
    "doosan_a0912": ROBOTS["doosan_a0912"],
    "example:ur5_robot": ROBOTS["example:ur5_robot"],
    "example:panda": ROBOTS["example:panda"],
    "mycobot_280_ros2_control": ROBOTS["mycobot_280"],
}

# Rounds in one scene.
IN_A_SCENE = 25

# How long a robot takes at most to come to rest [s].
PATIENCE = 3.0


class Contacts:
    """What touched the robot, seen at each step of the physics."""

    def __init__(self, simulation: ad.Simulation) -> None:
        """Watch from now on."""
        plant = simulation.plant
        self._port = plant.get_contact_results_output_port()
        self._plant, self.seen = plant, set[str]()
        world = plant.world_body().index()
        self._world = world
        simulation.simulator.set_monitor(self.look)

    def look(self, root: object) -> None:
        """Take note of what touches the world."""
        context = self._plant.GetMyContextFromRoot(root)
        results: ContactResults = self._port.Eval(context)
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            self._add(info.bodyA_index(), info.bodyB_index())
        inspector = None
        for index in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(index).contact_surface()
            if inspector is None:
                query = self._plant.get_geometry_query_input_port().Eval(context)
                inspector = query.inspector()
            bodies = [
                self._plant.GetBodyFromFrameId(inspector.GetFrameId(g)).index()
                for g in (surface.id_M(), surface.id_N())
            ]
            self._add(*bodies)

    def _add(self, one: object, other: object) -> None:
        if self._world in (one, other):
            link = self._plant.get_body(other if one == self._world else one)
            self.seen.add(str(link.name()))


def measure(name: str, rounds: int) -> str:
    """Return a robot's line."""
    rng, began = np.random.default_rng(5), time.process_time()
    done = found = succeeded = touched = scene = 0
    while done < rounds:
        robot = load(name)
        scale = ARMS[name]
        boxes = make_boxes(np.random.default_rng(100 + scene), scale)
        scene += 1
        joints = ad.planning_groups(robot)
        group = next(iter(joints.values()))
        ranges = {r.name: r for r in joint_ranges(robot.description)}
        low = np.array([max(ranges[n].lower, -RANGE) for n in group.joints])
        high = np.array([min(ranges[n].upper, RANGE) for n in group.joints])
        simulation = ad.Simulation(ad.build_diagram(robot, world=boxes.add_to))
        try:
            ad.plan(simulation, "initial", group=group.name)
        except ArmDrakeError:  # A box stands in the robot.
            continue
        contacts = Contacts(simulation)
        for _ in range(IN_A_SCENE):
            goal = dict(zip(group.joints, rng.uniform(low, high), strict=True))
            try:
                plan = ad.plan(simulation, goal, group=group.name)
            except ArmDrakeError as error:
                if "goal is in collision" in str(error):
                    continue  # No problem.
                print(f"{name}: {error}", file=sys.stderr)
                done += 1
                continue
            done, found = done + 1, found + 1
            contacts.seen.clear()
            handle = simulation.send_planned(plan)
            end = simulation.time + plan.duration + PATIENCE
            while simulation.time < end and not (
                simulation.rests() and (handle is None or handle.status.is_terminal)
            ):
                simulation.advance_to(simulation.time + 0.05)
            succeeded += handle is None or handle.status is ad.GoalStatus.SUCCEEDED
            if contacts.seen:
                touched += 1
                print(f"{name}: touched by {sorted(contacts.seen)}", file=sys.stderr)
            if done >= rounds:
                break
        print(
            f"{name}: {done} of {rounds}: planned {found}, succeeded {succeeded}, "
            f"touched {touched}",
            file=sys.stderr,
            flush=True,
        )
    took = time.process_time() - began
    return (
        f"{name:<20} {done} rounds: planned {found}, succeeded {succeeded}, "
        f"touched the world {touched}; {took:.0f} s"
    )


def main() -> int:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=250)
    parser.add_argument("--robots", nargs="*", default=list(ARMS))
    options = parser.parse_args()
    for name in options.robots:
        try:
            print(measure(name, options.rounds), flush=True)
        except ArmDrakeError as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
