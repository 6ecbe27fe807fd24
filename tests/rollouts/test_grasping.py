"""Grippers of real robots close on a box, lift it, hold it, and let it go.

The robots are those of the index, unchanged, with the gripper controllers of their own
YAML files; `ARM_DRAKE_ROBOTS` names their folder. The box stands on a post, which is
locked in mid-air and falls away when the gripper has closed. From then on nothing but
friction holds the box, of 1.0.
"""

import dataclasses as dc
from collections.abc import Mapping

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import Context

import arm_drake as ad
from arm_drake.messages import (
    Duration,
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
)
from tests import models
from tests.robots import load_real_robot

# How far a held box may get along a finger in 3 s [m] and turn [rad]. Drake's friction
# is a steep slope, not a wall: what it holds creeps. Fingers press with an effort that
# grows for seconds and sink in deeper, by some 0.1 mm; and a box between the teeth of a
# single finger, and another one that comes at an angle, creeps at up to 0.1 mm/s.
CREEP = 6e-4
TURN = 0.06

# How long it is held, and how long an arm takes to lift it [s].
HOLD = 3.0
LIFT = Duration(2)

# When a gripper has closed and stalled for sure [s]: the stall itself takes a second.
CLOSED = 2.5

# An open gripper is out of the way in half a second; free fall is 0.3 m in 0.25 s.
TO_FALL = 1.0
FALLEN = 0.3

# Of boxes and post.
FRICTION = CoulombFriction(1.0, 1.0)
POST = (0.01, 0.01, 0.02)


@dc.dataclass(frozen=True)
class Grasp:
    """A robot, and a box between its fingers. [m], [kg], [rad], [rad] or [m]."""

    # The gripper controller, its joint, open and where it would go without a box.
    controller: str
    joint: str
    opened: float
    closed: float

    # A finger, and the box in the frame of a link: its centre, its angle about z.
    finger: str
    link: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    mass: float
    angle: float = 0.0

    # Whether the YAML lets a goal succeed where it stalls, and whether its tolerance is
    # so wide that the box is within it.
    allows_stalling: bool = False
    is_reached: bool = False

    # Largest effort, where the controller limits it.
    max_effort: float | None = None

    # The other joints, the controller that lifts, by which joint and how far.
    start: Mapping[str, float] = dc.field(default_factory=dict)
    arm: str = ""
    lifting: str = ""
    by: float = 0.0

    pose: tuple[float, ...] | None = None


GRASPS = {
    # A gripper without an arm points down: gravity pulls along its fingers.
    "robotiq_2f85": Grasp(
        controller="robotiq_gripper_controller",
        joint="robotiq_85_left_knuckle_joint",
        opened=0.0,
        closed=0.79,
        finger="robotiq_85_left_finger_tip_link",
        link="robotiq_85_base_link",
        centre=(0.0, 0.0, 0.16),
        size=(0.04, 0.04, 0.06),
        mass=0.1,
        allows_stalling=True,
        max_effort=5.0,
        pose=(0.0, 0.0, 0.6, np.pi, 0.0, 0.0),
    ),
    "open_manipulator_x": Grasp(
        controller="gripper_controller",
        joint="gripper_left_joint",
        opened=0.019,
        closed=-0.01,
        finger="gripper_left_link",
        link="end_effector_link",
        centre=(0.0, 0.0, 0.0),
        size=(0.025, 0.05, 0.04),
        mass=0.05,
        start=dict.fromkeys(("joint1", "joint2", "joint3", "joint4"), 0.0),
        arm="arm_controller",
        lifting="joint2",
        by=-0.4,
    ),
    # One finger moves, and pushes the box against the other one.
    "so100_brukg": Grasp(
        controller="gripper_controller",
        joint="Gripper",
        opened=0.5,
        closed=-0.2,
        finger="Fixed_Gripper",
        link="Fixed_Gripper",
        centre=(-0.0087, -0.0893, 0.0),
        angle=0.3,
        size=(0.012, 0.02, 0.06),
        # Without an effort limit in the description its drive is weak.
        mass=0.005,
        start={
            "Shoulder_Rotation": 0.0,
            "Shoulder_Pitch": 0.0,
            "Elbow": 0.0,
            "Wrist_Pitch": -np.pi / 2.0,
            "Wrist_Roll": 0.0,
        },
        arm="joint_trajectory_controller",
        lifting="Shoulder_Pitch",
        by=-0.3,
    ),
    # Its joints have 1 N·m, which bears little more than this pose: it points down.
    "ar4": Grasp(
        controller="gripper_controller",
        joint="gripper_jaw1_joint",
        opened=0.014,
        closed=0.0,
        finger="gripper_jaw1_link",
        link="gripper_base_link",
        centre=(0.0, -0.0562, 0.0),
        size=(0.02, 0.014, 0.04),
        mass=0.02,
        is_reached=True,
        start={
            "joint_1": 0.0,
            "joint_2": 0.0,
            "joint_3": 0.9,
            "joint_4": 0.0,
            "joint_5": 0.67,
            "joint_6": 0.0,
        },
        arm="joint_trajectory_controller",
        lifting="joint_2",
        by=-0.2,
    ),
}


class Scene:
    """A robot with its gripper open around a box that stands on a post."""

    def __init__(self, name: str, time_step: float) -> None:
        self.grasp = grasp = GRASPS[name]
        start = {**grasp.start, grasp.joint: grasp.opened}
        robot = load_real_robot(name, pose=grasp.pose, initial_positions=start)
        # A step is no longer than a period of the manager, of 1 ms some have.
        robot = models.at_rate_of(robot, time_step)
        alone = ad.build_diagram(robot, world="void")
        frames = alone.GetOutputPort("frames").Eval(alone.CreateDefaultContext())
        at = robot.description.links.index(grasp.link)
        X_LB = RigidTransform(RotationMatrix.MakeZRotation(grasp.angle), grasp.centre)
        self._X_WB = frames[at] @ X_LB
        options = ad.SimulationOptions(time_step=time_step, log_rate=1.0 / time_step)
        self.sim = ad.Simulation(
            ad.build_diagram(robot, world=self._add_things, options=options)
        )
        assert not any("overlap" in entry.what for entry in self.sim.report)
        self.body("post").Lock(self.context)

    def _add_things(self, plant: MultibodyPlant) -> None:
        grasp, X_WB = self.grasp, self._X_WB
        add_box(plant, "box", grasp.size, grasp.mass, X_WB)
        half = np.abs(X_WB.rotation().matrix()[2]) @ grasp.size / 2.0
        below = X_WB.translation() - [0.0, 0.0, half + POST[2] / 2.0]
        add_box(plant, "post", POST, 1.0, RigidTransform(below))

    @property
    def plant(self) -> MultibodyPlant:
        return self.sim.diagram.GetSubsystemByName("plant")

    @property
    def context(self) -> Context:
        root = self.sim.simulator.get_mutable_context()
        return self.plant.GetMyMutableContextFromRoot(root)

    def body(self, name: str) -> RigidBody:
        return self.plant.GetBodyByName(name)

    def height(self) -> float:
        """Return the height of the box [m]."""
        X_WB = self.plant.EvalBodyPoseInWorld(self.context, self.body("box"))
        return float(X_WB.translation()[2])

    def box_in_finger(self) -> RigidTransform:
        finger, box = (
            self.plant.EvalBodyPoseInWorld(self.context, self.body(name))
            for name in (self.grasp.finger, "box")
        )
        return finger.inverse() @ box

    def advance(self, duration: float) -> None:
        self.sim.advance_to(self.sim.time + duration)

    def move_gripper(self, position: float) -> ad.GoalHandle:
        controller = self.sim.controller(self.grasp.controller)
        if self.grasp.max_effort is None:
            goal = GripperCommandGoal(GripperCommand(position))
            return controller.send_goal(goal)
        effort = (self.grasp.max_effort,)
        command = JointState(position=(position,), effort=effort)
        return controller.send_goal(ParallelGripperCommandGoal(command))

    def close(self) -> ad.GoalHandle:
        """Close on the box, and take the post away."""
        goal = self.move_gripper(self.grasp.closed)
        self.advance(CLOSED)
        self.body("post").Unlock(self.context)
        self.advance(0.2)
        return goal

    def lift(self) -> None:
        """Begin to lift the box, if there is an arm."""
        grasp = self.grasp
        if grasp.arm:
            goal = {**grasp.start, grasp.lifting: grasp.start[grasp.lifting] + grasp.by}
            point = ad.JointTrajectoryPoint(
                positions=tuple(goal.values()), time_from_start=LIFT
            )
            trajectory = ad.JointTrajectory(joint_names=tuple(goal), points=(point,))
            self.sim.controller(grasp.arm).send_goal(trajectory)


def add_box(
    plant: MultibodyPlant,
    name: str,
    size: tuple[float, float, float],
    mass: float,
    X_WB: RigidTransform,
) -> None:
    inertia = SpatialInertia.SolidBoxWithMass(mass, *size)
    body = plant.AddRigidBody(name, plant.AddModelInstance(name), inertia)
    shape = Box(*size)
    plant.RegisterCollisionGeometry(body, RigidTransform(), shape, name, FRICTION)
    plant.SetDefaultFloatingBaseBodyPose(body, X_WB)


def outcome(goal: ad.GoalHandle) -> tuple[ad.GoalStatus, bool, bool]:
    """Return how a goal ended: status, stalled, reached."""
    result = goal.result
    assert isinstance(result, GripperCommandResult | ParallelGripperCommandResult)
    return goal.status, result.stalled, result.reached_goal


@pytest.mark.parametrize(
    ("name", "time_step", "hold"),
    [
        ("robotiq_2f85", 5e-3, HOLD),
        ("open_manipulator_x", 5e-3, HOLD),
        ("so100_brukg", 5e-3, HOLD),
        ("ar4", 5e-3, HOLD),
        # As much as it may creep a second.
        ("robotiq_2f85", 1e-3, HOLD / 3.0),
        pytest.param("robotiq_2f85", 1e-3, HOLD, marks=pytest.mark.long),
        pytest.param("open_manipulator_x", 1e-3, HOLD, marks=pytest.mark.long),
    ],
)
def test_a_gripper_stalls_on_a_box_lifts_it_and_drops_it_when_it_opens(
    name: str, time_step: float, hold: float
) -> None:
    scene = Scene(name, time_step)
    grasp = scene.grasp

    goal = scene.close()
    before, low = scene.box_in_finger(), scene.height()
    scene.lift()
    scene.advance(hold)
    after, high = scene.box_in_finger(), scene.height()

    is_good = grasp.allows_stalling or grasp.is_reached
    status = ad.GoalStatus.SUCCEEDED if is_good else ad.GoalStatus.ABORTED
    assert outcome(goal) == (status, not grasp.is_reached, grasp.is_reached)
    moved = before.inverse() @ after
    assert np.linalg.norm(moved.translation()) < CREEP * hold / HOLD
    assert moved.rotation().ToAngleAxis().angle() < TURN * hold / HOLD
    if grasp.arm:
        assert high > low + 0.02
    if grasp.max_effort is not None:
        rollout = scene.sim.rollout()
        effort = rollout.effort[:, rollout.joint_names.index(grasp.joint)]
        assert np.abs(effort).max() <= grasp.max_effort

    goal = scene.move_gripper(grasp.opened)
    scene.advance(TO_FALL)

    assert outcome(goal) == (ad.GoalStatus.SUCCEEDED, False, True)
    assert scene.height() < high - FALLEN


@pytest.mark.parametrize(
    ("name", "almost"),
    # Where the box is, less half of the goal tolerance: 0.02 rad, 0.01 m, 0.01 rad.
    [
        ("robotiq_2f85", 0.4485 + 0.01),
        ("open_manipulator_x", 0.004 - 0.005),
        ("so100_brukg", 0.152 - 0.005),
    ],
)
def test_a_goal_just_inside_the_box_is_reached(name: str, almost: float) -> None:
    scene = Scene(name, 5e-3)

    goal = scene.move_gripper(almost)
    scene.advance(CLOSED)

    assert outcome(goal) == (ad.GoalStatus.SUCCEEDED, False, True)
