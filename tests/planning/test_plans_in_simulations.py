"""Plans from running simulations: what is seen there, and what becomes of them."""

import contextlib
import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.errors import InputError, MotionError, SimulationError
from arm_drake.simulation.motion_files import parse_motion
from arm_drake.simulation.task_space import check_arrival
from arm_drake.worlds.world import add_world

START = {"joint1": -1.0, "joint2": 0.9, "joint3": 0.8}
THROUGH = {"joint1": 0.0, "joint2": 0.9, "joint3": 0.8}

SIZE = np.array([0.2, 0.2, 0.8])

CONFIGS = Path(ad.__file__).parents[1] / "configs"


def with_a_crate(plant: MultibodyPlant) -> None:
    """Add the ground, and a crate in front of the robot that could be pushed."""
    add_world(plant, "empty")
    inertia = SpatialInertia.SolidBoxWithMass(5.0, *SIZE)
    crate = plant.AddRigidBody("crate", plant.AddModelInstance("crate"), inertia)
    friction = CoulombFriction(1.0, 1.0)
    box = Box(*SIZE)
    plant.RegisterCollisionGeometry(crate, RigidTransform(), box, "crate", friction)
    pose = RigidTransform([0.7, 0.0, 0.4])
    plant.SetDefaultFloatingBaseBodyPose(crate, pose)


@pytest.fixture
def simulation() -> ad.Simulation:
    robot = ad.load_robot("doosan_a0912", initial_positions=START)
    return ad.Simulation(ad.build_diagram(robot, world=with_a_crate))


def crate_at(simulation: ad.Simulation) -> np.ndarray:
    plant, context = simulation.plant, simulation.context
    own = plant.GetMyContextFromRoot(context)
    body = plant.GetBodyByName("crate")
    return np.array(plant.EvalBodyPoseInWorld(own, body).translation())


def put_crate(simulation: ad.Simulation, place: list[float]) -> None:
    plant, context = simulation.plant, simulation.context
    own = plant.GetMyMutableContextFromRoot(context)
    body = plant.GetBodyByName("crate")
    plant.SetFreeBodyPose(own, body, RigidTransform(place))


def joint(simulation: ad.Simulation, name: str, robot: str | None = None) -> float:
    state = simulation.joint_states(robot)
    return dict(zip(state.name, state.position, strict=True))[name]


@pytest.mark.slow
def test_a_robot_moves_around_what_stands_in_its_way(
    simulation: ad.Simulation,
) -> None:
    pytest.importorskip("ompl")
    before = crate_at(simulation)

    plan = simulation.move_to({"joint1": 1.0})

    assert joint(simulation, "joint1") == pytest.approx(1.0, abs=2e-3)
    assert plan.clearance >= 0.005 - 1e-6
    # Physics is the judge: the straight line would have pushed it.
    assert crate_at(simulation) == pytest.approx(before, abs=1e-4)
    assert simulation.goals[-1].status is ad.GoalStatus.SUCCEEDED


@pytest.mark.slow
def test_what_stands_elsewhere_by_now_is_seen_there(simulation: ad.Simulation) -> None:
    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, THROUGH)
    put_crate(simulation, [-2.0, 0.0, 0.4])

    plan = ad.plan(simulation, THROUGH)

    assert str(caught.value).startswith("the goal is in collision: 'crate' and 'link4'")
    assert len(plan.path) == 2
    put_crate(simulation, [0.7, 0.0, 0.4])
    with pytest.raises(ad.PlanningError):
        ad.plan(simulation, THROUGH)


@pytest.mark.slow
def test_what_is_ignored_may_be_touched(simulation: ad.Simulation) -> None:
    assert ad.plan(simulation, THROUGH, ignore=["crate"]).end["joint1"] == 0.0


@pytest.mark.slow
def test_what_a_link_holds_takes_room(simulation: ad.Simulation) -> None:
    put_crate(simulation, [-2.0, 0.0, 0.4])
    hand = simulation.link_poses()["link6"].translation()
    ends = {"joint1": -0.8}

    free = ad.plan(simulation, ends)
    rods = {
        length: ad.Payload(0.5, shape=Sphere(length)) for length in (0.05, 0.1, 10.0)
    }
    held = ad.plan(simulation, ends, attached={"link6": rods[0.1]})
    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, ends, attached={"link6": rods[10.0]})

    # The ground is next to a ball of 10 cm around the hand's origin.
    assert held.clearance == pytest.approx(min(free.clearance, hand[2] - 0.1), abs=2e-3)
    assert "'ground' and 'what link6 holds' overlap" in str(caught.value)


@pytest.mark.slow
def test_a_body_that_is_held_moves_along(simulation: ad.Simulation) -> None:
    # Held straight ahead of the robot's base, half a turn takes it into its own side.
    put_crate(simulation, [1.2, -1.6, 0.6])

    turned = ad.plan(simulation, {"joint1": -0.5}, ignore=["crate"])
    held = ad.plan(simulation, {"joint1": -0.5}, attached={"link6": "crate"})
    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, {"joint2": 1.3}, attached={"link6": "crate"})

    assert held.end == turned.end
    assert "'crate' and 'ground' overlap" in str(caught.value)


@pytest.mark.slow
def test_a_body_that_stands_on_something_is_lifted_when_it_is_ignored(
    simulation: ad.Simulation,
) -> None:
    put_crate(simulation, [1.2, -1.6, 0.4 - 1e-7])
    attached = {"link6": "crate"}

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, {"joint2": 0.8}, attached=attached)
    lift = ad.plan(simulation, {"joint2": 0.8}, attached=attached, ignore=["crate"])

    assert "'crate' and 'ground' overlap" in str(caught.value)
    assert str(caught.value).endswith(
        "; ignore=['crate'] leaves it out until it is lifted"
    )
    assert lift.end["joint2"] == 0.8


@pytest.mark.slow
def test_heavier_things_are_moved_within_the_limits_of_effort(
    simulation: ad.Simulation,
) -> None:
    put_crate(simulation, [-2.0, 0.0, 0.4])

    plan = ad.plan(simulation, {"joint2": 0.2}, attached={"link6": ad.Payload(500.0)})

    assert plan.warnings == (
        "the joints' limits of effort can't be kept at the speed of the plan",
    )


@pytest.mark.slow
def test_another_robot_is_in_the_way() -> None:
    left = ad.load_robot("doosan_a0912", name="left", initial_positions=START)
    right = ad.load_robot(
        "doosan_a0912", name="right", pose=(1.1, 0, 0, 0, 0, 0), initial_positions=START
    )
    simulation = ad.Simulation(ad.build_diagram([left, right], world="void"))

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, {"joint1": 0.0, "joint2": 1.4}, name="left")
    plan = ad.plan(left, {"joint1": 0.0, "joint2": 1.4}, start=START, world="void")

    assert "'link5' and 'right/base_0' overlap by" in str(caught.value)
    assert plan.robot.name == "left"


@pytest.mark.slow
def test_a_robot_that_moves_is_not_planned_for(simulation: ad.Simulation) -> None:
    put_crate(simulation, [-2.0, 0.0, 0.4])
    plan = ad.plan(simulation, {"joint1": 1.0})
    simulation.controller("joint_trajectory_controller").send_goal(plan.trajectory)
    simulation.advance_to(0.5)

    with pytest.raises(ad.PlanningError) as caught:
        ad.plan(simulation, "home")

    assert "; a plan begins at rest: simulate until the robot rests" in str(
        caught.value
    )
    assert ad.plan(simulation, "home", start=plan.end).end["joint1"] == -1.0


@pytest.mark.slow
def test_a_plan_is_sent_only_where_it_begins(simulation: ad.Simulation) -> None:
    elsewhere = {**START, "joint1": 1.0}
    plan = ad.plan(simulation, {"joint1": 1.2}, start=elsewhere)

    with pytest.raises(InputError) as caught:
        simulation.send_planned(plan)
    with pytest.raises(InputError):
        simulation.move_to({"joint1": 1.2}, start=elsewhere)

    assert str(caught.value).startswith(
        "the plan doesn't begin where the robot is: joint 'joint1' is at -1, not at 1 "
    )
    assert not simulation.goals


@pytest.mark.slow
def test_an_end_that_is_not_reached_is_raised() -> None:
    def with_a_wall(plant: MultibodyPlant) -> None:
        add_world(plant, "empty")
        friction = CoulombFriction(1.0, 1.0)
        X, box = RigidTransform([0.7, 0.0, 0.4]), Box(*SIZE)
        body = plant.world_body()
        plant.RegisterCollisionGeometry(body, X, box, "wall", friction)

    # What a plan knows of doesn't stop it; here its model hasn't the wall.
    robot = ad.load_robot("doosan_a0912", initial_positions=START)
    simulation = ad.Simulation(ad.build_diagram(robot, world=with_a_wall))
    plan = ad.plan(robot, {"joint1": 1.2}, start=START)
    simulation.send_planned(plan)
    simulation.run(plan.duration + 1.0)

    assert simulation.goals[-1].status is ad.GoalStatus.SUCCEEDED
    with pytest.raises(SimulationError) as caught:
        check_arrival(simulation, plan)
    assert str(caught.value).startswith(
        "the plan was executed, but its end isn't reached: joint 'joint1' is at "
    )


@pytest.mark.slow
def test_arguments_of_another_kind_are_one_message(simulation: ad.Simulation) -> None:
    name = simulation.directory.manager(None).robot.name
    for wrong, message in [
        ({"name": name}, "name: in move_to this argument is called robot"),
        ({"ignore": 5}, "ignore: expected names of bodies, got 5"),
        ({"start": [1]}, "start: expected joint positions by name, got [1]"),
    ]:
        with pytest.raises(ad.ArmDrakeError) as caught:
            simulation.move_to("home", **wrong)
        assert str(caught.value) == message


@pytest.mark.slow
def test_a_goal_that_fails_is_raised(simulation: ad.Simulation) -> None:
    put_crate(simulation, [-2.0, 0.0, 0.4])
    simulation.switch_controllers(deactivate=["joint_trajectory_controller"])
    simulation.advance_to(0.1)

    with pytest.raises(SimulationError) as caught:
        simulation.move_to({"joint1": 0.0})

    assert str(caught.value).startswith("joint_trajectory_controller: goal REJECTED")


@pytest.mark.slow
def test_steps_of_a_motion_are_planned_one_after_the_other(
    simulation: ad.Simulation,
) -> None:
    pytest.importorskip("ompl")
    before = crate_at(simulation)
    steps = [
        {"plan_to": {"positions": {"joint1": 1.0}}},
        {"plan_to": {"positions": THROUGH}},
        {"plan_to": {"state": "home", "velocity_scaling": 0.8}},
    ]

    simulation.run(8.0, motion=parse_motion(steps))

    assert [goal.status.value for goal in simulation.goals] == ["SUCCEEDED"] * 2
    assert joint(simulation, "joint1") == pytest.approx(-1.0, abs=2e-3)
    assert crate_at(simulation) == pytest.approx(before, abs=1e-4)
    (refused,) = simulation.rejected
    assert simulation.mailbox.describe(refused).startswith(
        "[1].plan_to: the goal is in collision: 'crate' and 'link"
    )


@pytest.mark.slow
def test_a_robot_that_never_rests_is_reported_of(simulation: ad.Simulation) -> None:
    put_crate(simulation, [-2.0, 0.0, 0.4])
    steps = [
        {"plan_to": {"positions": {"joint1": 1.0}}},
        {"plan_to": {"state": "home"}},
    ]

    simulation.run(0.3, motion=parse_motion(steps))

    (refused,) = simulation.rejected
    assert simulation.mailbox.describe(refused) == (
        "[1].plan_to: not planned: the robot didn't come to rest in time"
    )


@pytest.mark.slow
@pytest.mark.parametrize("is_interrupted", [False, True])
def test_a_step_whose_time_does_not_come_is_reported_of(
    simulation: ad.Simulation, is_interrupted: bool
) -> None:
    steps = [
        {"at": 2.0, "plan_to": {"state": "home"}},
        {"at": 3.0, "plan_to": {"positions": {"joint1": 1.0}}},
    ]

    def interrupt(time: float) -> None:
        if is_interrupted and time > 0.05:
            raise KeyboardInterrupt

    stopped = pytest.raises(KeyboardInterrupt)
    with stopped if is_interrupted else contextlib.nullcontext():
        simulation.run(0.2, parse_motion(steps), realtime_rate=20.0, progress=interrupt)

    told = [simulation.mailbox.describe(refused) for refused in simulation.rejected]
    reason = "not begun: the simulation ended before its time"
    assert told == [f"[{i}].plan_to: {reason}" for i in range(2)]
    # Who goes on is not held to the rate.
    assert simulation.simulator.get_target_realtime_rate() == 0.0


@pytest.mark.slow
def test_a_step_passes_way_points_and_keeps_a_link_upright() -> None:
    robot = ad.load_robot("doosan_a0912", initial_positions=START)
    simulation = ad.Simulation(ad.build_diagram(robot))
    step = {
        "through": [{"positions": {"joint1": -0.5}}, {"positions": {"joint1": 0.2}}],
        "positions": {"joint1": -0.3},
        "upright": {"link6": 0.05},
    }

    simulation.run(6.0, motion=parse_motion([{"plan_to": step}]))

    (goal,) = simulation.goals
    assert goal.status.value == "SUCCEEDED"
    first = simulation.rollout().position[:, 0]
    # It went there, further, and back; about the vertical, so no link tilted.
    assert np.max(first) == pytest.approx(0.2, abs=5e-3)
    assert joint(simulation, "joint1") == pytest.approx(-0.3, abs=2e-3)
    bent = {"positions": {"joint2": 0.4}, "upright": {"link6": 0.05}}
    simulation.run(0.1, motion=parse_motion([{"plan_to": bent}]))
    (refused,) = simulation.rejected
    assert "'link6' tilts by 0.5 rad; the path constraint allows 0.05" in (
        simulation.mailbox.describe(refused)
    )


BAD = [
    (
        {"state": "home", "through": {"state": "home"}},
        "[0].plan_to.through: expected a list, got {'state': 'home'}",
    ),
    (
        {"state": "home", "through": [{"pose": [0.4, 0.2]}]},
        "[0].plan_to.through[0].pose: expected x, y, z [m] or x, y, z, roll, pitch, "
        "yaw [m, rad], got [0.4, 0.2]",
    ),
    (
        {"pose": [0.4, 0.2, 0.6], "through": [{"pose": [0.4, 0.2, 0.6, 0, 0, 0]}]},
        "[0].plan_to: expected poses that are all x, y, z, or all six",
    ),
    (
        {"state": "home", "upright": {"link6": 0.1, "link5": 0.1}},
        "[0].plan_to.upright: expected one link and its angle, got "
        "{'link6': 0.1, 'link5': 0.1}",
    ),
    (
        {"state": "home", "upright": {"link9": 0.1}},
        "[0].plan_to: upright: no link 'link9'; did you mean 'link6'? known: "
        "base_0, link1, link2, link3, link4, link5, link6, world",
    ),
    (
        {"state": "home", "upright": {"link6": -0.1}},
        "[0].plan_to: tolerance: expected an angle from 0.002 to pi [rad], got -0.1",
    ),
    ({}, "[0].plan_to: expected one of state, positions, pose; got none"),
    (
        {"state": "home", "pose": [0.0] * 6},
        "[0].plan_to: expected one of state, positions, pose; got 'state', 'pose'",
    ),
    (
        {"pose": [1.0, 2.0]},
        "[0].plan_to.pose: expected x, y, z [m] or x, y, z, roll, pitch, yaw [m, rad], "
        "got [1.0, 2.0]",
    ),
    ({"state": 3}, "[0].plan_to.state: expected a name, got 3"),
    (
        {"state": "home", "straight": 1},
        "[0].plan_to.straight: expected true or false, got 1",
    ),
    (
        {"state": "hom"},
        "[0].plan_to: group 'joint_trajectory_controller' has no state 'hom'; did you "
        "mean 'home'? known: center, home, initial",
    ),
    (
        {"state": "home", "group": "arm"},
        "[0].plan_to: no planning group 'arm'; known: joint_trajectory_controller",
    ),
    (
        {"state": "home", "robot": "b"},
        "[0].plan_to: no robot 'b'; known: a0912",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("value", "message"), BAD)
def test_steps_that_can_not_be_planned(value: dict, message: str) -> None:
    simulation = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))

    with pytest.raises(MotionError) as caught:
        simulation.run(0.0, motion=parse_motion([{"plan_to": value}]))

    assert str(caught.value) == message


@pytest.mark.slow
def test_a_group_without_its_controller_is_an_error() -> None:
    simulation = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))

    with pytest.raises(ad.ArmDrakeError) as caught:
        simulation.move_to({"joint1": 0.1}, group=["joint1"])

    assert str(caught.value) == (
        "no trajectory controller has exactly the joints of group 'joint1', 'joint1'; "
        "there are 'joint_state_broadcaster', 'joint_trajectory_controller', "
        "'end_effector_sensor'"
    )


def write_mobile_arm(folder: Path) -> tuple[Path, Path]:
    """Write a bundled base with an arm of two joints on it, and its controllers."""
    base = CONFIGS / "wheeled_base/diff_drive.urdf"
    controllers = CONFIGS / "wheeled_base/diff_drive_controllers.yaml"
    tube = '<geometry><cylinder radius="0.02" length="0.2"/></geometry>'
    arm = interfaces = ""
    for name, parent, z in (("shoulder", "base_link", 0.22), ("elbow", "upper", 0.22)):
        child = {"shoulder": "upper", "elbow": "fore"}[name]
        arm += f"""
          <link name="{child}">
            <inertial>
              <origin xyz="0 0 0.1"/> <mass value="0.3"/>
              <inertia ixx="0.001" iyy="0.001" izz="0.0002" ixy="0" ixz="0" iyz="0"/>
            </inertial>
            <collision><origin xyz="0 0 0.1"/>{tube}</collision>
          </link>
          <joint name="{name}" type="revolute">
            <parent link="{parent}"/> <child link="{child}"/>
            <origin xyz="0 0 {z}"/> <axis xyz="0 1 0"/>
            <limit lower="-2" upper="2" effort="20" velocity="2"/>
          </joint>"""
        interfaces += f"""
          <joint name="{name}">
            <command_interface name="position"/> <state_interface name="position"/>
          </joint>"""
    urdf = base.read_text().replace("</ros2_control>", interfaces + "</ros2_control>")
    config = yaml.safe_load(controllers.read_text())
    config["controller_manager"]["ros__parameters"]["arm"] = {
        "type": "joint_trajectory_controller/JointTrajectoryController"
    }
    config["arm"] = {
        "ros__parameters": {
            "joints": ["shoulder", "elbow"],
            "command_interfaces": ["position"],
            "state_interfaces": ["position"],
        }
    }
    robot, parameters = folder / "robot.urdf", folder / "controllers.yaml"
    robot.write_text(urdf.replace("</robot>", arm + "</robot>"))
    parameters.write_text(yaml.safe_dump(config))
    return robot, parameters


@pytest.mark.slow
def test_an_arm_reaches_for_poses_in_the_world_from_where_its_base_stands(
    tmp_path: Path,
) -> None:
    urdf, controllers = write_mobile_arm(tmp_path)
    robot = ad.load_robot(urdf, controllers=controllers)
    simulation = ad.Simulation(ad.build_diagram(robot))
    plant, context = simulation.plant, simulation.context
    own = plant.GetMyMutableContextFromRoot(context)
    base, hand = plant.GetBodyByName("base_link"), plant.GetBodyByName("fore")
    z = plant.EvalBodyPoseInWorld(own, base).translation()[2]
    stands = RigidTransform(RollPitchYaw(0, 0, 0.7), [1.0, 0.5, z])
    plant.SetFreeBodyPose(own, base, stands)
    # Where the elbow is, with the shoulder at 0.6 rad forwards.
    pose = stands @ RigidTransform(
        RollPitchYaw(0, 0.6, 0),
        [0.22 * np.sin(0.6), 0.0, 0.22 + 0.22 * np.cos(0.6)],
    )
    goal = pose @ RigidTransform(RollPitchYaw(0, 0.5, 0), np.zeros(3))

    simulation.move_to(goal)

    reached = plant.EvalBodyPoseInWorld(own, hand)
    assert reached.translation() == pytest.approx(goal.translation(), abs=2e-3)
    assert joint(simulation, "shoulder") == pytest.approx(0.6, abs=5e-3)
    assert joint(simulation, "elbow") == pytest.approx(0.5, abs=5e-3)


@pytest.mark.slow
def test_what_was_planned_for_goes_when_nobody_has_it_any_more() -> None:
    robots, diagrams = [], []
    for _ in range(12):
        robot = ad.load_robot("lab5_arm")
        diagram = ad.build_diagram(robot, world=with_a_crate)
        name = robot.description.movable_joints[0].name
        ad.plan(ad.Simulation(diagram), {name: 0.1})
        robots.append(weakref.ref(robot))
        diagrams.append(weakref.ref(diagram))
        del robot, diagram
    gc.collect()

    # Some models are kept, but no diagram.
    assert sum(each() is not None for each in robots) < 10
    assert not any(each() for each in diagrams)
