"""Mimic joints of real robots keep their ratio, whatever pulls at a finger.

The robots are those of the index that have mimic joints; `ARM_DRAKE_ROBOTS` names its
folder. A load is a wrench on a follower's link with its reaction on the link before it,
which is a generalized force on that joint alone.
"""

import dataclasses as dc
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import Joint

import arm_drake as ad
from arm_drake.description.joints import JointInfo, last_master
from tests.robots import load_real_robot, read_index, skip_or_fail

# How far followers may be off [rad] or [m], by the step. Drake's constraint gives way
# in proportion to the load and to the square of the step.
TOLERANCE = {1e-3: 1e-4, 1e-2: 3e-3}

# Loads on a follower [N·m] or [N]; less where the gripper is a toy.
LOADS = {"prismatic": 2.0, "revolute": 1.0, "continuous": 1.0}
TOY_LOADS = {
    "mycobot_280_ros2_control": 0.05,
    # Its drive has 1 N.
    "ar4": 0.5,
}

# What Gazebo's plugins move has no servo; the same gripper with ros2_control has.
OF_PLUGINS = ("mycobot_280",)

# How far a master moves, as a part of what it and its followers can do, and what a
# wheel's velocity becomes [rad/s].
PART = 0.25
WHEEL_SPEED = 1.0

# How long a load acts before something changes [s].
PHASE = 0.3

# How long a master may take to carry a load, and how near it is then [rad] or [m]. One
# that is thrown to its stop at first is told of the load by its position error alone.
TO_CARRY = {1e-3: 1.0, 1e-2: 3.0}
CARRIED = 2e-3

HIGH_UP = (0.0, 0.0, 3.0, 0.0, 0.0, 0.0)
FORWARD = "forward_command_controller/ForwardCommandController"


def with_mimic_joints() -> list[str]:
    """Return the robots of the index that have mimic joints, or "none" without one."""
    try:
        index = read_index()
    except (pytest.skip.Exception, pytest.fail.Exception):
        return ["none"]
    return [
        name
        for name, row in index.items()
        if row["expected"].get("mimic") and name not in OF_PLUGINS
    ]


@dc.dataclass(frozen=True)
class Follower:
    """A mimic joint: its position is multiplier * that of its master + offset."""

    joint: JointInfo
    master: str
    multiplier: float
    offset: float


@dc.dataclass(frozen=True)
class Gripper:
    """A robot whose masters are commanded, each by a controller of its name."""

    name: str
    robot: ad.Robot
    followers: tuple[Follower, ...]

    # Masters, and what they and all their followers can do [rad] or [m].
    ranges: Mapping[str, tuple[float, float]]

    def load(self, follower: Follower) -> float:
        """Return what pulls at a follower [N·m] or [N]."""
        return TOY_LOADS.get(self.name, LOADS[follower.joint.type])

    def friction(self, master: str) -> float:
        """Return the dry friction of a master and its followers [N·m] or [N]."""
        joints = self.robot.description.movable_joints
        own = sum(joint.friction for joint in joints if joint.name == master)
        rows = [f for f in self.followers if f.master == master]
        return own + sum(abs(f.multiplier) * f.joint.friction for f in rows)


def find_followers(robot: ad.Robot) -> tuple[Follower, ...]:
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    return tuple(
        Follower(joint, *last_master(joint, joints))
        for joint in joints.values()
        if joint.mimic is not None
    )


def common_range(
    master: JointInfo, followers: tuple[Follower, ...]
) -> tuple[float, float]:
    """Return the positions of a master at which no follower is beyond its limits."""
    low, high = -np.inf, np.inf
    own = [f for f in followers if f.master == master.name]
    rows = [(f.joint, f.multiplier, f.offset) for f in own]
    for joint, multiplier, offset in [(master, 1.0, 0.0), *rows]:
        limits = joint.limits
        if joint.type == "continuous" or limits.lower is None or limits.upper is None:
            continue
        ends = [(end - offset) / multiplier for end in (limits.lower, limits.upper)]
        low, high = max(low, min(ends)), min(high, max(ends))
    return low, high


@pytest.fixture
def gripper(request: pytest.FixtureRequest, tmp_path: Path) -> Gripper:
    """Return a robot with its masters halfway, far above the ground."""
    if request.param == "none":
        skip_or_fail("no index of robots")
    row = read_index()[request.param]

    def load(yaml: list[Path], start: dict[str, float]) -> ad.Robot:
        return load_real_robot(
            request.param, controllers=yaml, pose=HIGH_UP, initial_positions=start
        )

    robot = load([], {})
    followers = find_followers(robot)
    assert len(followers) == len(row["expected"]["mimic"])
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    masters = sorted({follower.master for follower in followers})
    ranges = {name: common_range(joints[name], followers) for name in masters}
    start = {
        name: (low + high) / 2.0
        for name, (low, high) in ranges.items()
        if np.isfinite(low) and np.isfinite(high)
    }
    types = "".join(f", {name}: {{type: {FORWARD}}}" for name in masters)
    lines = [f"controller_manager: {{ros__parameters: {{update_rate: 100{types}}}}}"]
    for name in masters:
        kind = "position" if name in start else "velocity"
        parameters = f"{{joints: [{name}], interface_name: {kind}}}"
        lines.append(f"{name}: {{ros__parameters: {parameters}}}")
    file = tmp_path / "controllers.yaml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return Gripper(request.param, load([file], start), followers, ranges)


def simulate(gripper: Gripper, h: float) -> ad.Simulation:
    options = ad.SimulationOptions(time_step=h, log_rate=1.0 / h)
    # What has wheels would fall.
    robot = dc.replace(gripper.robot, has_free_base=False)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    states = {row.name: row.state for row in sim.list_controllers()}
    assert states == dict.fromkeys(gripper.ranges, "active")
    return sim


def pull(sim: ad.Simulation, joint: str, load: float) -> None:
    """Let a generalized force act on a joint, and on no other one, from now on.

    Nothing else applies spatial forces, so the plant's port is free.
    """
    plant = sim.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    context = plant.GetMyMutableContextFromRoot(sim.simulator.get_mutable_context())
    moved: Joint = plant.GetJointByName(joint)
    X_WF = moved.frame_on_parent().CalcPoseInWorld(context)
    turns = moved.type_name() == "revolute"
    axis = moved.revolute_axis() if turns else moved.translation_axis()
    forces = []
    for body, sign in ((moved.child_body(), 1.0), (moved.parent_body(), -1.0)):
        along = sign * load * (X_WF.rotation() @ axis)
        force = ExternallyAppliedSpatialForce()
        force.body_index = body.index()
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        force.p_BoBq_B = X_WB.inverse() @ X_WF.translation()
        force.F_Bq_W = SpatialForce(
            tau=along if turns else np.zeros(3), f=np.zeros(3) if turns else along
        )
        forces.append(force)
    plant.get_applied_spatial_force_input_port().FixValue(context, forces)


def ratio_errors(gripper: Gripper, rollout: ad.Rollout) -> np.ndarray:
    """Return how far the followers are off at any time [rad] or [m]."""
    columns = {name: at for at, name in enumerate(rollout.joint_names)}
    errors = []
    for follower in gripper.followers:
        master = rollout.position[:, columns[follower.master]]
        expected = follower.multiplier * master + follower.offset
        errors.append(rollout.position[:, columns[follower.joint.name]] - expected)
    return np.abs(errors).max(axis=1)


@pytest.mark.parametrize("h", TOLERANCE)
@pytest.mark.parametrize("gripper", with_mimic_joints(), indirect=True)
def test_followers_keep_their_ratio_under_load_at_rest_and_in_motion(
    gripper: Gripper, h: float
) -> None:
    sim = simulate(gripper, h)
    start = gripper.robot.initial_positions

    for sign, follower in zip([1.0, -1.0] * 3, gripper.followers, strict=False):
        low, high = gripper.ranges[follower.master]
        is_wheel = not np.isfinite(high - low)
        move = WHEEL_SPEED if is_wheel else PART * (high - low)
        rest = 0.0 if is_wheel else start[follower.master]
        master = sim.controller(follower.master)
        # It holds, goes along with the load, goes against it.
        for target in (rest, rest + sign * move, rest - sign * move):
            pull(sim, follower.joint.name, sign * gripper.load(follower))
            master.command([target])
            sim.advance_to(sim.time + PHASE)

    rollout = sim.rollout()
    assert np.isfinite(rollout.position).all()
    errors = ratio_errors(gripper, rollout)
    assert errors.max() <= TOLERANCE[h], errors
    # What keeps its ratio does move, all of it.
    for name, (low, high) in gripper.ranges.items():
        moved = np.ptp(rollout.position[:, rollout.joint_names.index(name)])
        assert moved > (PART * (high - low) if np.isfinite(high - low) else PHASE / 2)


@pytest.mark.parametrize("h", TOLERANCE)
@pytest.mark.parametrize("gripper", with_mimic_joints(), indirect=True)
def test_a_master_carries_what_pulls_at_its_follower(
    gripper: Gripper, h: float
) -> None:
    sim = simulate(gripper, h)
    follower = gripper.followers[-1]
    load = gripper.load(follower)
    sim.advance_to(PHASE)
    before = sim.rollout()

    pull(sim, follower.joint.name, load)
    sim.advance_to(PHASE + TO_CARRY[h])

    rollout = sim.rollout()
    at = rollout.joint_names.index(follower.master)
    off = rollout.position[-1, at] - before.position[-1, at]
    assert abs(off) <= CARRIED
    # By virtual work, of which dry friction may take or leave its part.
    load_inertia = rollout.effort[-1, at] - before.effort[-1, at]
    expected = -follower.multiplier * load
    friction = gripper.friction(follower.master)
    assert load_inertia == pytest.approx(expected, rel=0.02, abs=2.0 * friction)
