"""Arms that meet the ground or an obstacle: they stop, push, and come back.

The ground is that of the built-in world; the obstacle is a second robot, a fixed box.
At the end things of the world, which lie, slide and are held.
"""

import dataclasses as dc
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    Box,
    ProximityProperties,
    Role,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import ContactResults, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.messages import Duration, FollowJointTrajectoryResult
from arm_drake.worlds.world import World, add_world
from tests import models
from tests.robots import load_real_robot

# Too long for every few minutes.
pytestmark = pytest.mark.slow

# What holds at both ends holds in between, which `make bench` shows.
STEPS = [1e-3, pytest.param(5e-3, marks=pytest.mark.long), 1e-2]

# A held pose is as near as this [rad].
HELD = 1e-3

# What goes on while it pushes: contact may slide by 1 mm/s where friction would hold
# it, Drake's stiction tolerance; at a lever of a tenth of a metre [rad/s].
SLIDING = 1e-2

RADIUS = 0.05
SPEED = 3.0
EFFORT = 60.0
LIMIT = f'lower="-3" upper="3" effort="{EFFORT}" velocity="{SPEED}"'


def two_links(command: str = "position", *, dynamics: str = "") -> str:
    """Return an arm on an axis 0.8 m above the ground, with a ball at its tip."""
    ball = (
        f'<collision><origin xyz="0 0 {-models.LENGTH}"/>'
        f'<geometry><sphere radius="{RADIUS}"/></geometry></collision>'
    )
    shoulder = models.joint(
        "shoulder", "base", "upper", xyz="0 0 0.8", limit=LIMIT, inside=dynamics
    )
    elbow = models.joint(
        "elbow",
        "upper",
        "lower",
        xyz=f"0 0 {-models.LENGTH}",
        limit=LIMIT,
        inside=dynamics,
    )
    return (
        '<robot name="arm"><link name="base"/>'
        f"{models.bob('upper')}{models.bob('lower', geometry=ball)}{shoulder}{elbow}"
        f"{models.ros2_control('shoulder', 'elbow', command=command)}</robot>"
    )


def box(size: str) -> str:
    """Return a fixed box, as a robot."""
    return (
        '<robot name="box"><link name="box">'
        f'<collision><geometry><box size="{size}"/></geometry></collision>'
        "</link></robot>"
    )


def forward(joints: Sequence[str], interface: str = "position") -> str:
    kind = "forward_command_controller/ForwardCommandController"
    return (
        "controller_manager:\n  ros__parameters:\n    update_rate: 100\n"
        f"    arm: {{type: {kind}}}\narm:\n  ros__parameters:\n"
        f"    joints: [{', '.join(joints)}]\n    interface_name: {interface}\n"
    )


@dc.dataclass(frozen=True)
class Arm:
    """An arm in a pose above the ground, and one that is in the ground."""

    robot: ad.Robot
    joints: tuple[str, ...]
    pressed: tuple[float, ...]

    @property
    def start(self) -> np.ndarray:
        return np.array([self.robot.initial_positions[name] for name in self.joints])


SMALL_JOINTS = ("shoulder", "elbow")
SMALL_START = {"shoulder": 0.8, "elbow": -1.6}
# Its ball would be 10 cm deep.
SMALL_PRESSED = (0.2, -0.8)

JOINTS = tuple(f"joint{number}" for number in range(1, 7))


def small_arm(folder: Path, yaml: str, **urdf: str) -> Arm:
    text = two_links(**urdf)
    robot = models.load(folder, text, yaml, initial_positions=SMALL_START)
    return Arm(robot, SMALL_JOINTS, SMALL_PRESSED)


def xarm6(folder: Path, yaml: str) -> Arm:
    """Return an xArm 6 with its gripper 10 cm above the ground."""
    file = folder / "controllers.yaml"
    file.write_text(yaml, encoding="utf-8")
    start = dict(zip(JOINTS, (0.0, 0.3, -1.2, 0.0, 0.9, 0.0), strict=True))
    robot = load_real_robot("xarm6", controllers=[file], initial_positions=start)
    return Arm(robot, JOINTS, (0.0, 0.9, -1.2, 0.0, 0.3, 0.0))


def doosan(folder: Path, yaml: str) -> Arm:
    """Return the Doosan A0912, its wrist 20 cm above the ground."""
    file = folder / "controllers.yaml"
    file.write_text(yaml, encoding="utf-8")
    start = dict(zip(JOINTS, (0.0, 0.7, 1.5, 0.0, 0.9, 0.0), strict=True))
    robot = ad.load_robot("doosan_a0912", controllers=[file], initial_positions=start)
    return Arm(robot, JOINTS, (0.0, 1.3, 1.5, 0.0, 0.3, 0.0))


REAL = {"xarm6": xarm6, "doosan_a0912": doosan}


def make_real(name: str, folder: Path, *, jtc: bool) -> Arm:
    yaml = (
        models.trajectory_controllers({"arm": list(JOINTS)}) if jtc else forward(JOINTS)
    )
    return REAL[name](folder, yaml)


def simulate(
    arm: Arm, h: float, *others: ad.Robot, world: str = "empty"
) -> ad.Simulation:
    options = ad.SimulationOptions(time_step=h, log_rate=1.0 / h)
    robots = [arm.robot, *others] if others else arm.robot
    sim = ad.Simulation(ad.build_diagram(robots, world=world, options=options))
    assert not any("overlap" in entry.what for entry in sim.report)
    return sim


def move(joints: Sequence[str], positions: Iterable[float]) -> ad.JointTrajectory:
    """Return a trajectory that takes a second."""
    still = (0.0,) * len(joints)
    point = ad.JointTrajectoryPoint(
        tuple(positions), still, time_from_start=Duration(1)
    )
    return ad.JointTrajectory(joint_names=tuple(joints), points=(point,))


class Press:
    """An arm goes into the ground, pushes for 1.5 s, goes back and rests for 1 s."""

    DOWN, UP, END = 0.2, 2.7, 4.7  # s

    def __init__(self, arm: Arm, sim: ad.Simulation, *, jtc: bool) -> None:
        """Do it, commanded by trajectories of 1 s or by steps."""
        self.arm, self.sim = arm, sim
        for time, positions in ((self.DOWN, arm.pressed), (self.UP, arm.start)):
            self.sim.advance_to(time)
            if jtc:
                self.sim.controller("arm").send_goal(move(arm.joints, positions))
            else:
                self.sim.controller("arm").command(list(positions))
        self.sim.advance_to(self.END)
        self.rollout = self.sim.rollout()
        self.time = self.rollout.time
        at = [self.rollout.joint_names.index(name) for name in arm.joints]
        self.position = self.rollout.position[:, at]
        self.velocity = self.rollout.velocity[:, at]
        self.effort = self.rollout.effort[:, at]
        self.effort_limit = self.rollout.effort_limit[at]

    @property
    def pressing(self) -> np.ndarray:
        """Rows in which it has been pushing for a while."""
        return (self.time > self.DOWN + 2.0) & (self.time < self.UP)

    def check(self) -> None:
        """Check that it stopped, pushed within its limits, and came back."""
        states = np.hstack([self.rollout.position, self.rollout.velocity])
        assert np.isfinite(states).all()
        assert (np.abs(self.effort) <= self.effort_limit).all()
        # The goal is in the ground, so it is not there; and it pushes.
        off = np.abs(self.position[self.pressing] - self.arm.pressed).max(axis=1)
        assert off.min() > 0.05
        share = np.abs(self.effort[self.pressing]) / self.effort_limit
        assert share.max() > 0.9
        assert (self.gained() <= self.available()).all()
        error = np.abs(self.position[-1] - self.arm.start)
        assert error.max() <= HELD, error

    def gained(self) -> np.ndarray:
        """Return how much more energy there is than at first [J]."""
        plant = self.sim.diagram.GetSubsystemByName("plant")
        assert isinstance(plant, MultibodyPlant)
        context = plant.CreateDefaultContext()
        joints = [plant.GetJointByName(name) for name in self.rollout.joint_names]
        at = [joint.position_start() for joint in joints]
        energies = []
        for position, velocity in zip(
            self.rollout.position, self.rollout.velocity, strict=True
        ):
            states = np.zeros((2, plant.num_positions()))
            states[:, at] = position, velocity
            plant.SetPositionsAndVelocities(context, states.ravel())
            energies.append(
                plant.CalcKineticEnergy(context) + plant.CalcPotentialEnergy(context)
            )
        return np.array(energies) - energies[0]

    def available(self) -> np.ndarray:
        """Return the most that the drives can have done by then [J]."""
        travelled = np.abs(np.diff(self.position, axis=0)).cumsum(axis=0)
        work = travelled @ self.effort_limit
        return np.array([0.0, *work]) + 1e-9


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("jtc", [True, False], ids=["trajectory", "step"])
@pytest.mark.parametrize(
    "dynamics",
    ["", '<dynamics damping="0.5" friction="0.5"/>'],
    ids=["free", "damped with friction"],
)
def test_a_small_arm_presses_the_ground_and_comes_back(
    tmp_path: Path, dynamics: str, jtc: bool, h: float
) -> None:
    joints = list(SMALL_JOINTS)
    yaml = models.trajectory_controllers({"arm": joints}) if jtc else forward(joints)
    arm = small_arm(tmp_path, yaml, dynamics=dynamics)

    press = Press(arm, simulate(arm, h), jtc=jtc)

    press.check()
    # It is never driven faster than it may be, nor thrown by the ground.
    assert np.abs(press.velocity).max() <= SPEED
    assert np.abs(press.velocity[press.pressing]).max() <= SLIDING
    # The ball is on the ground and not in it, but for 1 mm; when it arrives it may be
    # as deep as a step took it before anything touched.
    shoulder, both = press.position[:, 0], press.position.sum(axis=1)
    tip = 0.8 - models.LENGTH * (np.cos(shoulder) + np.cos(both)) - RADIUS
    assert tip.min() > -1e-3 - np.abs(np.diff(tip)).max()
    assert np.abs(tip[press.pressing]).max() < 1e-3


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("jtc", [True, False], ids=["trajectory", "step"])
@pytest.mark.parametrize("name", REAL)
def test_a_real_arm_presses_the_ground_and_comes_back(
    tmp_path: Path, name: str, jtc: bool, h: float
) -> None:
    arm = make_real(name, tmp_path, jtc=jtc)

    press = Press(arm, simulate(arm, h), jtc=jtc)

    press.check()


@pytest.mark.parametrize(
    ("h", "goals"),
    [
        (1e-2, 3),
        pytest.param(1e-2, 8, marks=pytest.mark.long),
        pytest.param(5e-3, 8, marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("jtc", [True, False], ids=["trajectory", "step"])
@pytest.mark.parametrize("name", REAL)
def test_a_real_arm_comes_back_from_wherever_it_was_sent_into_the_ground(
    tmp_path: Path, name: str, jtc: bool, h: float, goals: int
) -> None:
    arm = make_real(name, tmp_path, jtc=jtc)
    rng = np.random.default_rng(1)

    sim, errors = simulate(arm, h), []
    for _ in range(goals):
        a, b, c, d = rng.uniform((0.5, -0.3, -0.8, -0.4), (1.0, 0.3, 0.3, 0.4))
        goal = arm.start + np.array([d, a, b, d, c, 0.0])
        sim.reset()
        press = Press(dc.replace(arm, pressed=tuple(goal)), sim, jtc=jtc)
        assert np.isfinite(press.position).all()
        assert (np.abs(press.effort) <= press.effort_limit).all()
        errors.append(np.abs(press.position[-1] - arm.start).max())

    assert max(errors) <= HELD, errors


@pytest.mark.parametrize("h", STEPS)
def test_an_arm_without_effort_falls_on_the_ground_and_rests_there(
    tmp_path: Path, h: float
) -> None:
    yaml = forward(SMALL_JOINTS, "effort")
    dynamics = '<dynamics damping="0.5"/>'
    arm = small_arm(tmp_path, yaml, command="effort", dynamics=dynamics)
    sim = simulate(arm, h)

    sim.controller("arm").command([0.0, 0.0])
    sim.advance_to(6.0)

    rollout = sim.rollout()
    assert np.isfinite(rollout.velocity).all()
    np.testing.assert_array_equal(rollout.effort, 0.0)
    late = rollout.time > 5.0
    assert np.abs(rollout.velocity[late]).max() <= SLIDING
    # The ground is in the way: its elbow is bent, and its ball touches.
    shoulder, elbow = rollout.position[-1]
    tip = 0.8 - models.LENGTH * (np.cos(shoulder) + np.cos(shoulder + elbow)) - RADIUS
    assert abs(elbow) > 0.1
    assert abs(tip) < 1e-3


OBSTACLES = ["ground", "box"]


def against(
    obstacle: str, folder: Path, yaml: str, h: float
) -> tuple[ad.Simulation, str, tuple[float, ...]]:
    """Return a small arm, the prefix of its name, and a goal behind an obstacle."""
    arm = small_arm(folder, yaml)
    if obstacle == "ground":
        return simulate(arm, h), "", SMALL_PRESSED
    # The ball is below the axis at first, and would go 0.78 m to the side.
    (folder / "box").mkdir()
    wall = models.load(
        folder / "box", box("0.1 1 2"), pose=(-0.55, 0.0, 0.6, 0.0, 0.0, 0.0)
    )
    sim = simulate(arm, h, wall, world="void")
    return sim, "arm/", (0.8, 0.2)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("obstacle", OBSTACLES)
def test_a_goal_behind_an_obstacle_violates_its_path_tolerance(
    tmp_path: Path, obstacle: str, h: float
) -> None:
    constraints = "{shoulder: {trajectory: 0.1}, elbow: {trajectory: 0.1}}"
    yaml = models.trajectory_controllers(
        {"arm": list(SMALL_JOINTS)}, constraints=constraints
    )
    sim, prefix, behind = against(obstacle, tmp_path, yaml, h)
    controller = sim.controller(f"{prefix}arm")
    goal = controller.send_goal(move(SMALL_JOINTS, behind))
    sim.advance_to(2.5)
    back = controller.send_goal(move(SMALL_JOINTS, tuple(SMALL_START.values())))

    sim.advance_to(4.5)

    assert goal.status is ad.GoalStatus.ABORTED
    assert isinstance(goal.result, FollowJointTrajectoryResult)
    assert goal.result.error_code == -4  # PATH_TOLERANCE_VIOLATED
    assert goal.result.error_string == "Aborted due to path tolerance violation"
    # It is told on the tick that sees it: just beyond the tolerance.
    assert re.search(
        r"'(shoulder|elbow)' is off by 0\.1\d* rad, its path tolerance is 0\.1 rad",
        goal.describe(),
    )
    check_obstructed(sim, back)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("obstacle", OBSTACLES)
def test_without_tolerances_an_arm_pushes_an_obstacle_with_its_effort(
    tmp_path: Path, obstacle: str, h: float
) -> None:
    yaml = models.trajectory_controllers({"arm": list(SMALL_JOINTS)})
    sim, prefix, behind = against(obstacle, tmp_path, yaml, h)
    controller = sim.controller(f"{prefix}arm")
    goal = controller.send_goal(move(SMALL_JOINTS, behind))
    sim.advance_to(2.5)
    pushing = np.array(sim.joint_states("arm").effort)
    off = np.array(sim.joint_states("arm").position) - behind
    back = controller.send_goal(move(SMALL_JOINTS, tuple(SMALL_START.values())))

    sim.advance_to(4.5)

    assert goal.status is ad.GoalStatus.SUCCEEDED
    assert np.abs(off).max() > 0.1
    assert np.abs(pushing).max() > 0.9 * EFFORT
    check_obstructed(sim, back)


def check_obstructed(sim: ad.Simulation, back: ad.GoalHandle) -> None:
    """Check that an arm did nothing wild at an obstacle, and came back from it."""
    rollout = sim.rollout("arm")
    assert np.isfinite(rollout.velocity).all()
    assert np.abs(rollout.velocity).max() <= SPEED
    assert np.abs(rollout.effort).max() <= EFFORT
    assert back.status is ad.GoalStatus.SUCCEEDED
    np.testing.assert_allclose(
        rollout.position[-1], list(SMALL_START.values()), rtol=0.0, atol=HELD
    )


Size = tuple[float, float, float]


def add_thing(
    plant: MultibodyPlant, size: Size, mass: float, mu: float, X_WB: RigidTransform
) -> None:
    """Add a box that moves freely."""
    inertia = SpatialInertia.SolidBoxWithMass(mass, *size)
    body = plant.AddRigidBody("thing", plant.AddModelInstance("things"), inertia)
    friction = CoulombFriction(mu, mu)
    plant.RegisterCollisionGeometry(body, RigidTransform(), Box(*size), "box", friction)
    plant.SetDefaultFloatingBaseBodyPose(body, X_WB)


def plant_of(sim: ad.Simulation) -> MultibodyPlant:
    plant = sim.diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    return plant


def thing_pose(sim: ad.Simulation) -> RigidTransform:
    plant = plant_of(sim)
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    return plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("thing"))


def contacts(sim: ad.Simulation) -> ContactResults:
    plant = plant_of(sim)
    context = plant.GetMyContextFromRoot(sim.simulator.get_context())
    return plant.get_contact_results_output_port().Eval(context)


SLOPE = 0.4  # rad


def on_a_slope(folder: Path, mu: float, h: float) -> ad.Simulation:
    """Return a thing on a fixed robot, whose friction is 1 by default."""
    slope = models.load(folder, box("4 1 0.1"), pose=(0.0, 0.0, 0.0, 0.0, SLOPE, 0.0))
    size, R_WB = (0.1, 0.1, 0.04), RotationMatrix.MakeYRotation(SLOPE)
    X_WB = RigidTransform(R_WB, R_WB @ [-1.0, 0.0, 0.07])
    options = ad.SimulationOptions(time_step=h)
    return ad.Simulation(
        ad.build_diagram(
            slope,
            world=lambda plant: add_thing(plant, size, 0.2, mu, X_WB),
            options=options,
        )
    )


@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_a_thing_stays_on_a_slope_that_its_friction_bears(
    tmp_path: Path, h: float
) -> None:
    sim = on_a_slope(tmp_path, 0.5, h)  # With 1 that makes 2/3; the slope is 0.42.
    sim.advance_to(0.5)
    before = thing_pose(sim)

    sim.advance_to(2.5)

    moved = before.inverse() @ thing_pose(sim)
    # Below 10 um/s is still, and the rest is what an impulse of h gives way.
    assert np.linalg.norm(moved.translation()) < 2.0 * (1e-5 + 1e-2 * h)
    assert moved.rotation().ToAngleAxis().angle() < 1e-3


@pytest.mark.parametrize("h", [1e-3, 5e-3])
def test_a_thing_slides_down_a_steeper_slope_as_coulomb_has_it(
    tmp_path: Path, h: float
) -> None:
    mu = 0.2
    sim = on_a_slope(tmp_path, mu, h)
    together = 2.0 * mu / (mu + 1.0)
    acceleration = models.GRAVITY * (np.sin(SLOPE) - together * np.cos(SLOPE))
    places = []
    for time in (0.4, 0.6, 0.8):
        sim.advance_to(time)
        places.append(thing_pose(sim).translation())

    # The second difference: whatever it did in landing.
    found = (places[0] - 2.0 * places[1] + places[2]) / 0.2**2

    expected = acceleration * np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=0.01 * acceleration)


JAW = 0.04
BEAM: Size = (0.2, 0.02, JAW)
# How far beside the jaws the beam has its centre of mass [m], and its mass [kg].
BESIDE, BEAM_MASS = 0.08, 0.05


def vice(folder: Path) -> ad.Robot:
    """Return a fixed and a moving square jaw, 22 mm apart, that press along y."""

    def jaw(link: str, y: float) -> str:
        shape = f'<box size="{JAW} 0.02 {JAW}"/>'
        return (
            f'<link name="{link}"><inertial><mass value="0.1"/>'
            '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
            f'</inertial><collision><origin xyz="0 {y} 0"/>'
            f"<geometry>{shape}</geometry></collision></link>"
        )

    slide = models.joint(
        "slide",
        "fixed_jaw",
        "jaw",
        axis="0 -1 0",
        type="prismatic",
        limit='lower="0" upper="0.02" effort="20" velocity="1"',
    )
    control = models.ros2_control("slide", command="effort")
    urdf = (
        f'<robot name="vice">{jaw("fixed_jaw", -0.02)}{jaw("jaw", 0.022)}'
        f"{slide}{control}</robot>"
    )
    return models.load(folder, urdf, forward(["slide"], "effort"))


@pytest.mark.parametrize("h", [1e-3, 5e-3])
# Friction 1 of two square faces with even pressure bears a moment of 0.3826 * side *
# 2 * force. The weight has one of 39 mN·m: 1.3 N are needed beside what weight takes.
@pytest.mark.parametrize(("force", "is_held"), [(5.0, True), (0.8, False)])
def test_jaws_hold_a_beam_at_its_end_if_they_press_enough(
    tmp_path: Path, force: float, is_held: bool, h: float
) -> None:
    start = RigidTransform([BESIDE, 0.0, 0.0])
    sim = ad.Simulation(
        ad.build_diagram(
            vice(tmp_path),
            world=lambda plant: add_thing(plant, BEAM, BEAM_MASS, 1.0, start),
            options=ad.SimulationOptions(time_step=h),
        )
    )
    plant = plant_of(sim)
    context = plant.GetMyMutableContextFromRoot(sim.simulator.get_mutable_context())
    plant.GetBodyByName("thing").Lock(context)
    sim.controller("arm").command([force])
    sim.advance_to(0.5)

    plant.GetBodyByName("thing").Unlock(context)
    sim.advance_to(0.7)
    before = thing_pose(sim)
    sim.advance_to(2.2)

    moved = before.inverse() @ thing_pose(sim)
    angle = moved.rotation().ToAngleAxis().angle()
    if is_held:  # It would creep by less than 1 mm and 10 mrad in 3 s.
        assert np.linalg.norm(moved.translation()) < 5e-4
        assert angle < 0.005
    else:
        assert start.translation()[2] - thing_pose(sim).translation()[2] > 0.01


def test_only_what_touches_a_thing_is_touched_by_areas(tmp_path: Path) -> None:
    arm = models.load(tmp_path, models.FALLING_BALL)

    def world(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        add_thing(plant, (0.1, 0.1, 0.1), 1.0, 1.0, RigidTransform([1.0, 0.0, 0.05]))

    sim = ad.Simulation(ad.build_diagram(arm, world=world))

    sim.advance_to(2.0)

    assert contacts(sim).num_point_pair_contacts() == 1
    assert contacts(sim).num_hydroelastic_contacts() == 1


def add_table(plant: MultibodyPlant) -> None:
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        RigidTransform([0.0, 0.0, -0.5]),
        Box(1.0, 1.0, 1.0),
        "table",
        CoulombFriction(1.0, 1.0),
    )


@pytest.mark.parametrize("world", ["empty", add_table], ids=["empty", "table"])
def test_where_nothing_can_be_held_shapes_are_left_as_they_are(
    tmp_path: Path, world: World
) -> None:
    arm = models.load(tmp_path, models.FALLING_BALL)

    diagram = ad.build_diagram(arm, world=world)

    inspector = diagram.GetSubsystemByName("scene_graph").model_inspector()
    shapes = inspector.GetAllGeometryIds(Role.kProximity)
    assert len(shapes) == 2
    for shape in shapes:
        properties = inspector.GetProximityProperties(shape)
        assert not properties.HasGroup("hydroelastic")


def test_properties_that_a_thing_has_are_kept(tmp_path: Path) -> None:
    arm = models.load(tmp_path, models.FALLING_BALL)

    def world(plant: MultibodyPlant) -> None:
        inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
        body = plant.AddRigidBody("thing", plant.AddModelInstance("things"), inertia)
        properties = ProximityProperties()
        AddCompliantHydroelasticProperties(0.01, 1e6, properties)
        plant.RegisterCollisionGeometry(
            body, RigidTransform(), Sphere(0.1), "ball", properties
        )

    diagram = ad.build_diagram(arm, world=world)

    inspector = diagram.GetSubsystemByName("scene_graph").model_inspector()
    plant = diagram.GetSubsystemByName("plant")
    (shape,) = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("thing"))
    properties = inspector.GetProximityProperties(shape)
    modulus = properties.GetProperty("hydroelastic", "hydroelastic_modulus")
    assert modulus == 1e6


def test_a_thing_that_is_in_a_robot_is_named(tmp_path: Path) -> None:
    arm = models.load(tmp_path, models.FALLING_BALL)

    def world(plant: MultibodyPlant) -> None:
        add_thing(plant, (0.1, 0.1, 0.1), 1.0, 1.0, RigidTransform([0.0, 0.0, 1.0]))

    sim = ad.Simulation(ad.build_diagram(arm, world=world))

    (line,) = [entry.what for entry in sim.report if "overlap" in entry.what]
    assert line == "links overlap in the initial pose: ball and thing"
