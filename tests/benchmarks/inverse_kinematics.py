"""Inverse kinematics: how many reachable poses are reached, and how long that takes.

Poses are those of uniform joint positions within the limits, judged by Drake's forward
kinematics and, where it is installed, by pinocchio: within 1e-4 m and 1e-3 rad, and
within the limits. The seed is the middle of the ranges. Times are the processor's. The
table of random poses is made before the clock starts: once a robot and link.

    python -m tests.benchmarks.inverse_kinematics [--poses 1000] [--robots NAME ...]
"""

import argparse
import math
import sys
import time
from typing import Any

import numpy as np

import arm_drake as ad
from arm_drake.description.joints import joints_above
from arm_drake.errors import ArmDrakeError
from arm_drake.plant.joint_ranges import center, joint_ranges, randomize
from tests.benchmarks.loading import find_entries

# What counts of an arm of four or five joints: not the turn about the link's x axis.
POINTING = (True, True, True, False, True, True)
ALL = (True,) * 6

# By name: the link, and what of its pose counts. Those that aren't there are left out.
ROBOTS: dict[str, tuple[str, tuple[bool, ...]]] = {
    "doosan_a0912": ("link6", ALL),
    "mycobot_280": ("link6_flange", ALL),
    "example:ur5_robot": ("tool0", ALL),
    "example:panda": ("panda_link8", ALL),
    "xarm6": ("link6", ALL),
    "kuka_kr6_agilus": ("tool0", ALL),
    "so100_brukg": ("Fixed_Gripper", POINTING),
    "open_manipulator_x": ("end_effector_link", POINTING),
}

# What a judge lets pass [m], [rad].
NEAR, ALIGNED = 1e-4, 1e-3


def load(name: str) -> ad.Robot:
    """Return a robot by its name here."""
    if name.startswith("example:"):
        return ad.load_robot(name)
    entries = {entry["name"]: entry["options"] for entry in find_entries()}
    return ad.load_robot(**entries[name])


def make_judge(robot: ad.Robot, frame: str) -> Any:
    """Return what says where pinocchio has the link; None without it."""
    try:
        import pinocchio as pin
    except ImportError:
        return None
    try:
        model = pin.buildModelFromXML(robot.description.source)
    except (ValueError, RuntimeError):
        return None
    data, index = model.createData(), model.getFrameId(frame)

    def judge(positions: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        q = pin.neutral(model)
        for joint, value in positions.items():
            at = model.joints[model.getJointId(joint)]
            is_circle = at.nq == 2
            values = [math.cos(value), math.sin(value)] if is_circle else [value]
            q[at.idx_q : at.idx_q + at.nq] = values
        pin.framesForwardKinematics(model, data, q)
        return np.array(data.oMf[index].rotation), np.array(data.oMf[index].translation)

    return judge


def misses(target: Any, R: np.ndarray, p: np.ndarray, mask: tuple[bool, ...]) -> bool:
    """Whether a link isn't where it should be."""
    R_d = target.rotation().matrix()
    if mask == ALL:
        cosine = 0.5 * (np.trace(R.T @ R_d) - 1.0)
    else:
        cosine = float(R[:, 0] @ R_d[:, 0])
    is_far = np.linalg.norm(p - target.translation()) > NEAR
    return bool(is_far or cosine < math.cos(ALIGNED))


def measure(name: str, frame: str, mask: tuple[bool, ...], poses: int) -> str:
    """Return a robot's line."""
    robot = load(name)
    ranges = list(joint_ranges(robot.description))
    carriers = {j.name for j in joints_above(robot.description.joints, frame)}
    limits = {r.name: r for r in ranges if r.name in carriers and r.follows is None}
    rng, judge, seed = (
        np.random.default_rng(1),
        make_judge(robot, frame),
        center(ranges),
    )
    solved, times, tries = 0, [], []
    ad.solve_ik(robot, frame, robot.forward_kinematics(randomize(ranges, rng), frame))
    for _ in range(poses):
        target = robot.forward_kinematics(randomize(ranges, rng), frame)
        start = time.process_time()
        try:
            solution = ad.solve_ik(robot, frame, target, seed=seed, mask=mask)
        except ad.NoSolution:
            times.append(time.process_time() - start)
            continue
        times.append(time.process_time() - start)
        tries.append(solution.tries)
        positions = dict(solution.positions)
        X = robot.forward_kinematics(positions, frame)
        is_wrong = misses(target, X.rotation().matrix(), X.translation(), mask)
        if judge is not None:
            is_wrong |= misses(target, *judge(positions), mask)
        is_wrong |= any(
            not r.wraps and not r.lower - 1e-9 <= positions[n] <= r.upper + 1e-9
            for n, r in limits.items()
        )
        solved += not is_wrong
    mean, median = 1e3 * np.mean(times), 1e3 * np.median(times)
    tail = 1e3 * np.percentile(times, 95)
    by = "pinocchio" if judge is not None else "Drake"
    return (
        f"{name:<20} {len(limits)} joints  {100 * solved / poses:6.2f} %  "
        f"mean {mean:5.2f} ms  median {median:5.2f}  p95 {tail:5.2f}  "
        f"max {1e3 * max(times):5.1f}  tries {np.mean(tries):.2f}  by {by}"
    )


def main() -> int:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS))
    options = parser.parse_args()
    for name in options.robots:
        frame, mask = ROBOTS[name]
        try:
            print(measure(name, frame, mask, options.poses), flush=True)
        except (ArmDrakeError, KeyError) as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
