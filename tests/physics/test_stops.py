"""Position limits are hard stops: joints that are driven into them stay and come back.

Drake's discrete step gives a limit the compliance R = beta^2 / (4 pi^2 M_ii) per
impulse with beta = 0.1, and a dissipation time of one step (Castro et al. 2022, "An
Unconstrained Convex Formulation of Compliant Contact", near-rigid regime, as
`SapDriver::AddLimitConstraints` sets it). At rest the impulse of a load F is h F, and
that of a joint that is x too far is x / (2 h R), so

    x = 2 h^2 beta^2 / (4 pi^2) F / M_ii

which is 1e-7 rad for 50 N·m on the pendulum below at 1 ms, 1e-5 rad at 10 ms.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

import arm_drake as ad
from tests import models
from tests.robots import load_real_robot

# Too long for every few minutes.
pytestmark = pytest.mark.slow

STEPS = [
    1e-3,
    # What holds at both ends holds in between, which `make bench` shows.
    *(pytest.param(h, marks=pytest.mark.long) for h in (2e-3, 5e-3)),
    1e-2,
]
COMPLIANCE = 2.0 * 0.1**2 / (4.0 * math.pi**2)

PUSH = 50.0  # N·m
LOWER, UPPER = -0.7, 0.5
EFFORT_LIMIT = 100.0
LIMIT = f'lower="{LOWER}" upper="{UPPER}" effort="{EFFORT_LIMIT}" velocity="10"'

WEIGHT = models.MASS * models.GRAVITY * models.LENGTH
FRICTION = 1.0
DYNAMICS = ["", f'<dynamics damping="0.5" friction="{FRICTION}"/>']
STOPS = [(UPPER, 1.0), (LOWER, -1.0)]

# How long joints are pushed [s]: each is at its stop, and at rest, within the first or
# second, and from then on every step is the same.
PUSHED = 3.0

# How near to it a joint rests that has been sent beyond its stop [rad].
AT_STOP = 1e-5

# What iterations of the solver and rounding leave of a joint at rest [rad/s].
AT_REST = 1e-6


def forward(**interfaces: tuple[str, str]) -> str:
    """Return a YAML with a forward controller per name, for (interface, joints)."""
    kind = "forward_command_controller/ForwardCommandController"
    types = "".join(f", {name}: {{type: {kind}}}" for name in interfaces)
    manager = f"controller_manager: {{ros__parameters: {{update_rate: 100{types}}}}}"
    sections = [
        f"{name}: {{ros__parameters: {{joints: [{joints}], interface_name: {kind}}}}}"
        for name, (kind, joints) in interfaces.items()
    ]
    return "\n".join([manager, *sections])


def pendulum(
    folder: Path, interface: str, h: float, *, dynamics: str = "", gravity: bool = True
) -> ad.Simulation:
    urdf = models.pendulum(
        limit=LIMIT,
        dynamics=dynamics,
        control=models.ros2_control("swing", command=interface),
    )
    robot = models.load(folder, urdf, forward(group=(interface, "swing")))
    settings = ad.SimulationOptions(time_step=h, log_rate=1.0 / h, gravity=gravity)
    return ad.Simulation(ad.build_diagram(robot, world="void", options=settings))


def plant_of(sim: ad.Simulation) -> tuple[MultibodyPlant, Context]:
    plant = sim.diagram.GetSubsystemByName("plant")
    context = sim.simulator.get_mutable_context()
    return plant, plant.GetMyMutableContextFromRoot(context)


def give(h: float, effort: float, inertia: float = models.INERTIA) -> float:
    """Return how far an effort pushes a joint beyond its limit [rad]."""
    return h**2 * COMPLIANCE * effort / inertia


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("dynamics", DYNAMICS, ids=["free", "damped with friction"])
@pytest.mark.parametrize(("stop", "sign"), STOPS)
def test_a_joint_that_an_effort_pushes_into_its_stop_stays_there(
    tmp_path: Path, stop: float, sign: float, dynamics: str, h: float
) -> None:
    sim = pendulum(tmp_path, "effort", h, dynamics=dynamics)

    sim.controller("group").command([sign * PUSH])
    sim.advance_to(PUSHED)

    rollout = sim.rollout()
    beyond = sign * (rollout.position[:, 0] - stop)
    late = rollout.time > 1.0
    # Gravity pulls it back; friction may add to the push.
    net = PUSH - WEIGHT * math.sin(abs(stop)) + (FRICTION if dynamics else 0.0)
    assert beyond.max() <= 1.01 * give(h, net)
    assert beyond[late].min() > 0.0
    assert np.abs(rollout.velocity[late]).max() <= AT_REST
    np.testing.assert_array_equal(rollout.effort[late], sign * PUSH)
    # It does not bounce: once there, it never turns round.
    assert (sign * rollout.velocity[:, 0]).min() >= -AT_REST


@pytest.mark.parametrize("h", STEPS)
def test_a_stop_gives_way_by_what_drake_says(tmp_path: Path, h: float) -> None:
    sim = pendulum(tmp_path, "effort", h)

    sim.controller("group").command([PUSH])
    sim.advance_to(1.0)

    net = PUSH - WEIGHT * math.sin(UPPER)
    beyond = sim.rollout().position[-1, 0] - UPPER
    assert beyond == pytest.approx(give(h, net), rel=1e-3)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(("stop", "sign"), STOPS)
def test_a_joint_leaves_its_stop_as_soon_as_its_effort_reverses(
    tmp_path: Path, stop: float, sign: float, h: float
) -> None:
    sim = pendulum(tmp_path, "effort", h)
    sim.controller("group").command([sign * PUSH])
    sim.advance_to(1.0)

    sim.controller("group").command([-sign * PUSH])
    sim.advance_to(1.05)

    # Gravity helps it, less and less; the step adds its first order.
    moved = sign * (stop - sim.rollout().position[-1, 0])
    torques = PUSH + WEIGHT * np.sin([0.0, abs(stop)])
    least, most = 0.5 * torques / models.INERTIA * 0.05**2
    first_order = h / 0.05
    assert (1.0 - 2.0 * first_order) * least <= moved <= (1.0 + first_order) * most


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("dynamics", DYNAMICS, ids=["free", "damped with friction"])
@pytest.mark.parametrize(
    ("interface", "into", "back"),
    # A position is reached again; a velocity leads on to the other stop.
    [("position", 2.5, -0.3), ("velocity", 3.0, -3.0)],
)
def test_a_joint_that_the_servo_drives_into_its_stop_comes_back(
    tmp_path: Path, interface: str, into: float, back: float, dynamics: str, h: float
) -> None:
    sim = pendulum(tmp_path, interface, h, dynamics=dynamics)
    sim.controller("group").command([into])
    sim.advance_to(PUSHED)

    sim.controller("group").command([back])
    sim.advance_to(PUSHED + 1.0)

    rollout = sim.rollout()
    position, velocity, effort = (
        values[:, 0] for values in (rollout.position, rollout.velocity, rollout.effort)
    )
    # The last row has the effort that the next command causes.
    pushed = (rollout.time > 1.0) & (rollout.time < PUSHED)
    net = EFFORT_LIMIT - WEIGHT * math.sin(UPPER) + (FRICTION if dynamics else 0.0)
    assert (position - UPPER).max() <= 1.01 * give(h, net)
    if interface == "velocity":
        assert (position - UPPER)[pushed].min() > 0.0
    else:
        # A drive that is sent beyond its stop goes as far, and does not push.
        np.testing.assert_allclose(position[pushed], UPPER, atol=AT_STOP)
        holds = WEIGHT * math.sin(UPPER)
        friction = FRICTION if dynamics else 0.0
        assert abs(effort[pushed][-1] - holds) <= friction + 1e-3
    assert np.abs(velocity[pushed]).max() <= AT_REST
    assert np.abs(effort).max() <= EFFORT_LIMIT
    # It is not driven faster than it may be, on either way.
    assert np.abs(velocity).max() <= 10.0
    end = back if interface == "position" else LOWER
    assert position[-1] == pytest.approx(end, abs=1e-3)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("speed", [5.0, 50.0])
def test_a_stop_takes_all_energy_of_a_joint_that_hits_it(
    tmp_path: Path, speed: float, h: float
) -> None:
    sim = pendulum(tmp_path, "effort", h, gravity=False)
    plant, context = plant_of(sim)
    plant.SetVelocities(context, [speed])

    sim.controller("group").command([0.0])
    sim.advance_to(2.0)

    rollout = sim.rollout()
    position = rollout.position[:, 0]
    # The first row was logged before it was given its speed.
    velocity = np.array([speed, *rollout.velocity[1:, 0]])
    assert np.diff(velocity**2).max() <= 1e-9 * speed**2
    assert np.abs(velocity[-1]) <= AT_REST
    # Drake looks two steps ahead, and stops it there or at the stop.
    assert position.max() - UPPER <= 1e-9
    assert UPPER - position[-1] <= 2.0 * speed * h


@pytest.mark.parametrize("h", STEPS)
def test_a_joint_that_falls_into_its_stop_comes_to_rest_there(
    tmp_path: Path, h: float
) -> None:
    urdf = models.pendulum(
        limit='lower="0.5" upper="3" effort="100" velocity="10"',
        control=models.ros2_control("swing", command="effort"),
    )
    robot = models.load(
        tmp_path,
        urdf,
        forward(group=("effort", "swing")),
        initial_positions={"swing": 2.0},
    )
    options = ad.SimulationOptions(time_step=h, log_rate=1.0 / h)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))

    sim.controller("group").command([0.0])
    sim.advance_to(6.0)

    rollout = sim.rollout()
    position, velocity = rollout.position[:, 0], rollout.velocity[:, 0]
    kinetic, potential = 0.5 * models.INERTIA * velocity**2, -WEIGHT * np.cos(position)
    energy = kinetic + potential
    # On its way a step is off by half of what it does: h times the power.
    drop = WEIGHT * (math.cos(0.5) - math.cos(2.0))
    fastest = math.sqrt(2.0 * drop / models.INERTIA)
    assert (energy - energy[0]).max() <= 0.5 * h * WEIGHT * fastest
    assert velocity.min() == pytest.approx(-fastest, rel=0.05)
    late = rollout.time > 5.0
    assert np.abs(velocity[late]).max() <= AT_REST
    beyond = 0.5 - position[late]
    assert beyond.max() <= 1.01 * give(h, WEIGHT * math.sin(0.5))
    assert beyond.min() > 0.0


def load_real(folder: Path, name: str, yaml: str, start: dict[str, float]) -> ad.Robot:
    file = folder / "controllers.yaml"
    file.write_text(yaml, encoding="utf-8")
    return load_real_robot(name, controllers=[file], initial_positions=start)


def load_at_stop(sim: ad.Simulation, joint: str, effort: float) -> tuple[float, float]:
    """Return what presses a joint upwards at rest [N·m], and M_ii [kg·m^2]."""
    plant, context = plant_of(sim)
    at = plant.GetJointByName(joint).velocity_start()
    gravity = plant.CalcGravityGeneralizedForces(context)[at]
    return effort + gravity, plant.CalcMassMatrix(context)[at, at]


@pytest.mark.parametrize("h", STEPS)
def test_an_arm_that_an_effort_pushes_into_a_stop_stays_there(
    tmp_path: Path, h: float
) -> None:
    others = [f"joint_{number}" for number in (1, 3, 4, 5, 6)]
    yaml = forward(push=("effort", "joint_2"), hold=("position", ", ".join(others)))
    start = {"joint_2": 0.6, "joint_3": -1.0}
    robot = load_real(tmp_path, "kuka_kr6_agilus", yaml, start)
    options = ad.SimulationOptions(time_step=h, log_rate=1.0 / h)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))
    held = [robot.initial_positions[name] for name in others]
    sim.controller("hold").command(held)
    sim.controller("push").command([PUSH])
    sim.advance_to(PUSHED)
    load, inertia = load_at_stop(sim, "joint_2", PUSH)

    sim.controller("push").command([-PUSH - load])
    sim.advance_to(PUSHED + 0.3)

    rollout = sim.rollout()
    at = rollout.joint_names.index("joint_2")
    (limit,) = (
        j.limits for j in robot.description.movable_joints if j.name == "joint_2"
    )
    assert limit.upper is not None
    beyond = rollout.position[:, at] - limit.upper
    late = (rollout.time > 2.0) & (rollout.time < PUSHED)
    # A load that comes suddenly, as it arrives, gives at most twice that.
    assert beyond.max() <= 2.0 * give(h, load, inertia)
    assert beyond[late] == pytest.approx(give(h, load, inertia), rel=1e-2)
    assert np.abs(rollout.velocity[late, at]).max() <= AT_REST
    columns = [rollout.joint_names.index(name) for name in others]
    assert rollout.position[late][:, columns] == pytest.approx(
        np.array(held)[None, :].repeat(late.sum(), axis=0), abs=1e-3
    )
    assert beyond[-1] < -0.1


@pytest.mark.parametrize("h", STEPS)
def test_an_arm_whose_goal_is_beyond_a_stop_goes_as_far_and_comes_back(
    tmp_path: Path, h: float
) -> None:
    names = [f"joint{number}" for number in range(1, 7)]
    yaml = forward(group=("position", ", ".join(names)))
    start = dict(zip(names, (0.0, 1.8, -1.2, 0.0, 0.5, 0.0), strict=True))
    robot = load_real(tmp_path, "xarm6", yaml, start)
    options = ad.SimulationOptions(time_step=h, log_rate=1.0 / h)
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))
    sim.controller("group").command([0.0, 2.5, -1.2, 0.0, 0.5, 0.0])
    sim.advance_to(PUSHED)
    # Dry friction may help it.
    effort = sim.joint_states().effort[1] + 1.0
    load, inertia = load_at_stop(sim, "joint2", effort)

    sim.controller("group").command(list(start.values()))
    sim.advance_to(PUSHED + 2.0)

    rollout = sim.rollout()
    columns = [rollout.joint_names.index(name) for name in names]
    at = columns[1]
    upper = robot.description.movable_joints[1].limits.upper
    assert upper is not None
    pushed = (rollout.time > 2.0) & (rollout.time <= PUSHED)
    beyond = rollout.position[:, at] - upper
    # A load that comes suddenly, as it arrives, gives at most twice that.
    assert beyond.max() <= 2.0 * give(h, 50.0 + load - effort, inertia)
    assert beyond[pushed].max() <= 1.01 * give(h, load, inertia)
    assert beyond[pushed].min() >= -AT_STOP
    others = [column for column in columns if column != at]
    goal = [start[name] for name in names if name != names[1]]
    reached = rollout.position[pushed][:, others] - goal
    assert np.abs(reached).max() <= 1e-3
    assert np.abs(rollout.velocity[pushed][:, columns]).max() <= 1e-4
    assert (np.abs(rollout.effort) <= rollout.effort_limit).all()
    np.testing.assert_allclose(
        rollout.position[-1, columns], list(start.values()), rtol=0.0, atol=1e-3
    )
