"""Every real launch file ends as a plan, or says what it needs.

`python -m tests.launch.test_real_launch_files` prints what came out of each.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import ArmDrakeError
from tests.launch.test_expected_plans import launch_folder

REPOSITORIES = (
    "create3_sim",
    "gazebo_ros2_control",
    "gz_ros2_control",
    "mycobot_ros2",
    "open_manipulator",
    "robotic_arm_environment",
    "ros2_control_demos",
    "ros2_robotiq_gripper",
    "xarm_ros2",
)

# What must be given, as its author would: addresses of robots, an arm of six joints.
ARGUMENTS = {
    **dict.fromkeys(("robot_ip", "robot_ip_1", "robot_ip_2"), "192.168.1.1"),
    "dof": "6",
}
ASKS = re.compile(r"give it as (\w+):=|configuration '(\w+)' does not exist")

# What is in none of the folders: a module, packages of cameras; what another file sets.
LACKING = {
    "camera_realsense.launch.py": "package 'realsense2_camera' not found",
    "camera_usb_cam.launch.py": "package 'usb_cam' not found",
    "create3_gz.launch.py": "it imports 'irobot_create_common_bringup', which isn't in",
    "create3_spawn.launch.py": "'irobot_create_common_bringup', which isn't in its",
    "rrbot_base.launch.py": "'description_file'",
}

DOOSAN = "robotic_arm_environment/my_doosan_pkg/launch"


def launch_files(repository: str) -> Iterator[Path]:
    for path in sorted((launch_folder() / repository).rglob("*launch.*")):
        if path.suffix in (".py", ".xml", ".yaml"):
            yield path


@pytest.mark.slow
@pytest.mark.parametrize("repository", REPOSITORIES)
def test_all_launch_files_end_as_plans_but_for_what_is_not_there(
    repository: str,
) -> None:
    plans, errors = [], {}
    addresses: dict[str, str] = {}
    for path in launch_files(repository):
        try:
            plan, given = load(path, addresses)
            plans.append(plan)
            # The first that asks for an address does so for all of its repository.
            addresses |= {k: v for k, v in given.items() if k.startswith("robot_ip")}
        except ArmDrakeError as error:
            errors[path.name] = str(error)

    assert plans
    assert [e for name, e in errors.items() if LACKING.get(name, "?") not in e] == []


def load(
    path: Path, start: Mapping[str, str] | None = None
) -> tuple[ad.LaunchPlan, dict[str, str]]:
    """Return the plan of a launch file, and the arguments that it got.

    To those at the start come what it asks for.
    """
    given = dict(start or {})
    while True:
        try:
            return ad.load_launch(path, arguments=given), given
        except ArmDrakeError as error:
            asked = ASKS.search(str(error))
            name = "" if asked is None else asked[1] or asked[2]
            if name not in ARGUMENTS or name in given:
                raise
            given[name] = ARGUMENTS[name]


@pytest.mark.slow
def test_the_doosan_moves_by_its_launch_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = launch_folder() / DOOSAN / "my_doosan_gazebo_controller.launch.py"

    code = main(["launch", str(path), "--headless", "--motion", "tutorial"])

    assert code == 0
    assert "joint_trajectory_controller: SUCCEEDED" in capsys.readouterr().out


def row_of(path: Path, repository: str) -> list[str]:
    """Return what came out of a launch file: arguments, robots, the rest."""
    name = f"{repository}/{path.name}"
    try:
        plan, given = load(path)
    except ArmDrakeError as error:
        return [name, *[""] * 5, str(error).removeprefix(f"{path}: ")[:150]]
    try:
        joints = [
            sum(joint.type != "fixed" for joint in robot.description.joints)
            for robot in plan.load_scene().robots
        ]
        robots = [
            f"{Path(str(launched.source)).name} ({count} joints)"
            for launched, count in zip(plan.robots, joints, strict=True)
        ]
    except ArmDrakeError as error:
        robots = [str(error).rpartition("/")[2][:150]] if plan.robots else ["none"]
    spawned = [f"{k} {v}" for robot in plan.robots for k, v in robot.spawned.items()]
    world = "" if plan.world is None else Path(plan.world).name
    poses = [str(list(robot.pose)) for robot in plan.robots if robot.pose is not None]
    others = [each.name for each in plan.not_started]
    words = [f"{k}:={v}" for k, v in given.items()]
    columns = (words, robots, spawned, [world], poses, others)
    return [name, *(", ".join(column) for column in columns)]


def print_table() -> None:
    """Print a row for each launch file, run with the arguments that it asks for."""
    heads = ("file", "arguments", "robots", "controllers", "world", "pose")
    print(f"| {' | '.join(heads)} | not run, or what it needs |")
    print(f"|{' --- |' * (len(heads) + 1)}")
    ends = []
    for repository in REPOSITORIES:
        for path in launch_files(repository):
            row = row_of(path, repository)
            ends.append("a plan" if row[2] else row[-1])
            print(f"| {' | '.join(row)} |", flush=True)
    needs = [re.search("package|imports", end) is not None for end in ends]
    plans = ends.count("a plan")
    print(f"{len(ends)} files: {plans} plans, {sum(needs)} lack a package or a module")


if __name__ == "__main__":
    print_table()
