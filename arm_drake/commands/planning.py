"""The commands `arm-drake ik` and `arm-drake plan`."""

import argparse
import json
from collections.abc import Sequence

from arm_drake.description.elements import parse_float
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.planning.groups import find_group
from arm_drake.planning.inverse_kinematics import WHOLE_POSE, solve_ik


def run_ik(options: argparse.Namespace, robot: Robot) -> int:
    """Print joint positions that put a link at a pose; return the exit code."""
    pose, mask = read_pose(options.target)
    if options.pointing is not None:
        if mask != WHOLE_POSE:
            raise InputError("--pointing: expected --pose X,Y,Z,R,P,Y")
        free = 3 + "xyz".index(options.pointing)
        mask = tuple(row != free for row in range(6))
    # A link that is named may be one that other joints move, too.
    group = options.group
    frame = options.frame or find_group(robot, group).tip
    solution = solve_ik(
        robot,
        frame,
        pose,
        seed=read_positions("--seed", options.seed),
        group=group,
        mask=mask,
        all_solutions=options.all,
    )
    solutions = [solution.positions, *solution.others]
    if options.json:
        content = {
            "robot": robot.name,
            "frame": frame,
            "positions": dict(solution.positions),
            "others": [dict(other) for other in solution.others],
            "tries": solution.tries,
            "position_error": solution.position_error,
            "orientation_error": solution.orientation_error,
        }
        print(json.dumps(content))
        return 0
    for number, positions in enumerate(solutions, start=1):
        if options.all:
            print(f"solution {number}:")
        width = max(map(len, positions))
        for name, position in positions.items():
            print(f"{name:<{width}}  {position: .6f}")
    return 0


def read_pose(text: str) -> tuple[Sequence[float], tuple[bool, ...]]:
    """Return a pose in words, and what of it counts: its position, or all of it."""
    numbers = [parse_float(word) for word in text.split(",")]
    values = [number for number in numbers if number is not None]
    if len(values) != len(numbers) or len(values) not in (3, 6):
        raise InputError(
            f"--pose {text}: expected X,Y,Z [m] or X,Y,Z,R,P,Y [m, rad] with commas"
        )
    if len(values) == 3:
        return [*values, 0.0, 0.0, 0.0], (*WHOLE_POSE[:3], False, False, False)
    return values, WHOLE_POSE


def read_positions(option: str, words: Sequence[tuple[str, str]]) -> dict[str, float]:
    """Return positions of JOINT=VALUE."""
    positions = {}
    for joint, text in words:
        value = parse_float(text)
        if value is None:
            raise InputError(f"{option} {joint}={text}: expected a number [rad or m]")
        positions[joint] = value
    return positions
