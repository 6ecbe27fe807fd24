"""The myCobot's share of boxes placed right: random sizes, places and turns.

    python -m tests.benchmarks.pick_and_place --trials 100 --first 0

Each trial has a number, which seeds it, so that 100 can be run in pieces. A box counts
as placed if it is within 5 mm and 3 degrees of its goal in the end, as the plant says.

With `--camera` poses and sizes are those that a depth camera before the robot sees, of
boxes in front, at least 20 mm wide; x is along the longer side then. Half turns don't
count, nor do quarters of boxes as wide as deep: they can't be told apart.
"""

import argparse
import dataclasses as dc
import functools
import json
import time

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

import arm_drake as ad
from arm_drake.worlds.world import add_world

POSE = (0.0, 0.0, 0.026, 0.0, 0.0, 0.0)

# How near the goal a box has to be [m], [rad].
NEAR, TURN = 5e-3, np.deg2rad(3.0)

# Where boxes are: distance and angle from the base [m], [rad]; width and height [m].
DISTANCES, ANGLES = (0.15, 0.25), (-2.2, 2.2)
WIDTHS, HEIGHTS = (0.012, 0.03), (0.02, 0.05)

# With the camera: its pose, where boxes are seen, and which are.
CAMERA = (0.55, 0.0, 0.45, 0.0, 0.86, np.pi)
SEEN_ANGLES, SEEN_WIDTHS = (-0.9, 0.9), (0.02, 0.03)

# Sides that differ by less can't be told apart [m].
ALIKE = 1e-3

# Goals are so far from the start [m], and a box has so many [kg/m^3].
APART, DENSITY = 0.06, 700.0


@dc.dataclass(frozen=True)
class Trial:
    """A trial, and what became of it."""

    number: int
    picked: bool
    placed: bool
    reason: str
    position_error: float
    orientation_error: float
    simulated_time: float
    processor_time: float

    @property
    def succeeded(self) -> bool:
        """Whether the box is where it should be."""
        return self.position_error < NEAR and self.orientation_error < TURN


@functools.cache
def load(camera: bool) -> ad.Robot:
    """Return the myCobot; what is known of it is found once for all trials."""
    inputs = {"control": "ros2_control"}
    robot = ad.load_robot("mycobot_280", xacro_args=inputs, pose=POSE)
    if not camera:
        return robot
    return ad.add_camera(
        robot, "world", CAMERA, width=960, height=720, horizontal_fov=0.9
    )


def run(number: int, *, camera: bool = False) -> Trial:
    """Run a trial."""
    rng = np.random.default_rng(number)
    width, depth = rng.uniform(*(SEEN_WIDTHS if camera else WIDTHS), size=2)
    height = float(rng.uniform(*HEIGHTS))
    start = random_place(rng, SEEN_ANGLES if camera else ANGLES)
    goal = random_place(rng)
    while np.hypot(*(np.array(goal[:2]) - start[:2])) < APART:
        goal = random_place(rng)
    size = (float(width), float(depth), height)
    box = ad.Thing(
        "box",
        "box",
        size,
        mass=DENSITY * float(np.prod(size)),
        pose=(start[0], start[1], height / 2.0, 0.0, 0.0, start[2]),
    )

    def add_things(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        box.add_to(plant)

    robot = load(camera)
    simulation = ad.Simulation(ad.build_diagram(robot, world=add_things))
    began = time.process_time()
    X_WG = RigidTransform(
        RollPitchYaw(0.0, 0.0, goal[2]), [goal[0], goal[1], height / 2.0]
    )
    if camera:
        picked, placed = by_camera(simulation, X_WG)
    else:
        picked = ad.pick(simulation, "box", goal=X_WG)
        placed = ad.place(simulation, X_WG) if picked else None
    simulation.advance_to(simulation.time + 0.5)
    plant = simulation.plant
    context = plant.GetMyContextFromRoot(simulation.context)
    X_WB = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("box"))
    miss = X_WG.inverse() @ X_WB
    return Trial(
        number,
        bool(picked),
        bool(placed),
        picked.reason if placed is None else placed.reason,
        float(np.linalg.norm(miss.translation())),
        turned(miss, size) if camera else miss.rotation().ToAngleAxis().angle(),
        simulation.time,
        time.process_time() - began,
    )


def by_camera(
    simulation: ad.Simulation, X_WG: RigidTransform
) -> tuple[ad.PickResult, ad.PlaceResult | None]:
    """Carry the box as the camera sees it."""
    picked = ad.pick(simulation, "box", goal=X_WG, camera="camera")
    if not picked:
        return picked, None
    return picked, ad.place(simulation, X_WG, held=picked.X_PO)


def turned(miss: RigidTransform, size: tuple[float, float, float]) -> float:
    """Return the angle by which a box is turned, as far as its shape tells [rad]."""
    # In the frame that is seen x is along the longer side.
    along = 0.0 if size[0] >= size[1] else np.pi / 2.0
    miss = miss @ RigidTransform(RollPitchYaw(0.0, 0.0, along), np.zeros(3))
    yaw = float(RollPitchYaw(miss.rotation()).yaw_angle())
    step = np.pi / 2.0 if abs(size[0] - size[1]) < ALIKE else np.pi
    back = RigidTransform(
        RollPitchYaw(0.0, 0.0, -step * np.round(yaw / step)), np.zeros(3)
    )
    return float((miss @ back).rotation().ToAngleAxis().angle())


def random_place(
    rng: np.random.Generator, angles: tuple[float, float] = ANGLES
) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] of a box within reach."""
    r, angle = rng.uniform(*DISTANCES), rng.uniform(*angles)
    yaw = float(rng.uniform(-np.pi, np.pi))
    return float(r * np.cos(angle)), float(r * np.sin(angle)), yaw


def main() -> None:
    """Run trials, a line of JSON each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--camera", action="store_true")
    args = parser.parse_args()
    trials = []
    for number in range(args.first, args.first + args.trials):
        trials.append(run(number, camera=args.camera))
        print(json.dumps(dc.asdict(trials[-1])), flush=True)
    good = [trial for trial in trials if trial.succeeded]
    errors = [1e3 * trial.position_error for trial in good] or [np.nan]
    spent = sum(trial.processor_time for trial in trials)
    simulated = sum(trial.simulated_time for trial in trials)
    print(
        f"{len(good)} of {len(trials)} placed; median {np.median(errors):.2f} mm, "
        f"largest {max(errors):.2f} mm; {spent / simulated:.2f} s of processor time "
        "per simulated second"
    )


if __name__ == "__main__":
    main()
