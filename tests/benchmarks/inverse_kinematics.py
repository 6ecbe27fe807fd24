"""Inverse kinematics: how many reachable poses are reached, and how long that takes.

Poses are those of uniform joint positions within the limits, judged by Drake's forward
kinematics and, where it is installed, by pinocchio: within 1e-4 m and 1e-3 rad, and
within the limits. The seed is the middle of the ranges. Times are the processor's, of
all threads. The table of random poses is made before the clock starts: once a robot and
link. TRAC-IK (`pytracik`) is asked for the same poses where it is installed, but not
for parts of a pose, which it can't; its limit is one of wall time.

    python -m tests.benchmarks.inverse_kinematics [--poses 1000] [--robots NAME ...]
"""

import argparse
import contextlib
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from pydrake.math import RigidTransform

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

# How long TRAC-IK may take [s]: 20 times what is its default.
TRAC_IK_LIMIT = 0.1

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


Solve: TypeAlias = Callable[[RigidTransform], Mapping[str, float] | None]


def make_trac_ik(robot: ad.Robot, frame: str, seed: Mapping[str, float]) -> Solve:
    """Return what has TRAC-IK solve; raise ImportError without it."""
    from trac_ik import TracIK

    above = joints_above(robot.description.joints, frame)
    names = [joint.name for joint in reversed(above) if joint.is_movable]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "robot.urdf")
        file.write_text(robot.description.source, encoding="utf-8")
        base = above[-1].parent  # At the world's origin.
        solver = TracIK(base, frame, str(file), timeout=TRAC_IK_LIMIT)
    # It takes those of a <safety_controller>, also where that has none.
    ranges = {r.name: r for r in joint_ranges(robot.description)}
    low, high = solver.joint_limits
    is_limited = [not ranges[name].wraps for name in names]
    low = np.where(is_limited, [ranges[name].lower for name in names], low)
    high = np.where(is_limited, [ranges[name].upper for name in names], high)
    solver.joint_limits = list(low), list(high)
    start = np.array([seed[name] for name in names])

    def solve(target: RigidTransform) -> Mapping[str, float] | None:
        R = np.array(target.rotation().matrix())
        found = solver.ik(np.array(target.translation()), R, start)
        return None if found is None else dict(zip(names, found, strict=True))

    return solve


def measure(name: str, frame: str, mask: tuple[bool, ...], poses: int) -> Iterator[str]:
    """Yield a robot's lines, one for each solver."""
    robot = load(name)
    ranges = list(joint_ranges(robot.description))
    carriers = {j.name for j in joints_above(robot.description.joints, frame)}
    own = {r.name: r for r in ranges if r.name in carriers and r.follows is None}
    rng, judge, seed = (
        np.random.default_rng(1),
        make_judge(robot, frame),
        center(ranges),
    )
    targets = [
        robot.forward_kinematics(randomize(ranges, rng), frame)
        for _ in range(poses + 1)
    ]

    def solve(target: RigidTransform) -> Mapping[str, float] | None:
        try:
            return ad.solve_ik(robot, frame, target, seed=seed, mask=mask).positions
        except ad.NoSolution:
            return None

    def is_right(target: RigidTransform, positions: Mapping[str, float]) -> bool:
        X = robot.forward_kinematics(positions, frame)
        is_wrong = misses(target, X.rotation().matrix(), X.translation(), mask)
        if judge is not None:
            is_wrong |= misses(target, *judge(positions), mask)
        return not is_wrong and all(
            r.wraps or r.lower - 1e-9 <= positions[n] <= r.upper + 1e-9
            for n, r in own.items()
        )

    solvers: dict[str, Solve] = {"ours": solve}
    if mask == ALL:
        with contextlib.suppress(ImportError):
            solvers["TRAC-IK"] = make_trac_ik(robot, frame, seed)
    by = "pinocchio" if judge is not None else "Drake"
    for label, solver in solvers.items():
        solved, times = 0, []
        solver(targets[0])  # Makes the table.
        for target in targets[1:]:
            start = time.process_time()
            positions = solver(target)
            times.append(time.process_time() - start)
            solved += positions is not None and is_right(target, positions)
        ms = 1e3 * np.array(times)
        yield (
            f"{name:<20} {len(own)} joints  {label:<8} {100 * solved / poses:6.2f} %  "
            f"mean {ms.mean():5.2f} ms  median {np.median(ms):5.2f}  "
            f"p95 {np.percentile(ms, 95):5.2f}  max {ms.max():5.1f}  by {by}"
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
            for line in measure(name, frame, mask, options.poses):
                print(line, flush=True)
        except (ArmDrakeError, KeyError) as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
