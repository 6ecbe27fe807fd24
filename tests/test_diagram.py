"""The diagram is one of Drake's like any other, with the ports that ROS would have."""

import gc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

import arm_drake as ad
from arm_drake.errors import InputError
from tests import models

W0 = ad.SimulationOptions().servo_bandwidth
STEP = ad.SimulationOptions().largest_step
PERIOD = 1e-2

INPUTS = [
    "joint_trajectory_controller.joint_trajectory",
    "joint_trajectory_controller.follow_joint_trajectory",
    "joint_trajectory_controller.speed_scaling_input",
    "controller_manager.switch_controller",
]
# Of the plant, for all robots.
PUSH = "applied_spatial_force"
OUTPUTS = [
    "contacts",
    "frames",
    "joint_state_broadcaster.joint_states",
    "joint_state_broadcaster.dynamic_joint_states",
    "joint_trajectory_controller.controller_state",
    "joint_trajectory_controller.events",
    "/contact_sensor/bumper_link6",
    "joint_states",
]


def input_names(diagram: Diagram) -> list[str]:
    ports = range(diagram.num_input_ports())
    return [diagram.get_input_port(i).get_name() for i in ports]


def output_names(diagram: Diagram) -> list[str]:
    ports = range(diagram.num_output_ports())
    return [diagram.get_output_port(i).get_name() for i in ports]


def trajectory(
    positions: dict[str, float], at: float, *, is_at_rest: bool = True
) -> ad.JointTrajectory:
    velocities = (0.0,) * len(positions) if is_at_rest else ()
    end = ad.JointTrajectoryPoint(
        positions=tuple(positions.values()),
        velocities=velocities,
        time_from_start=at,
    )
    return ad.JointTrajectory(joint_names=tuple(positions), points=(end,))


def pendulum(folder: Path, dynamics: str = "", **options: object) -> ad.Robot:
    controllers = models.trajectory_controllers({"arm": ["swing"]})
    urdf = models.pendulum(dynamics=dynamics)
    return models.load(folder, urdf, controllers, **options)


def doosan_in_motion() -> tuple[Diagram, Simulator]:
    """Return the bundled robot on its way to a goal."""
    diagram = ad.build_diagram(ad.load_robot("doosan_a0912"))
    simulator = Simulator(diagram)
    goal = {f"joint{i}": 0.1 * i for i in range(1, 7)}
    diagram.GetInputPort(INPUTS[0]).FixValue(
        simulator.get_mutable_context(), trajectory(goal, 1.0)
    )
    return diagram, simulator


def state_bytes(diagram: Diagram, context: Context) -> list[bytes]:
    ports = [diagram.GetOutputPort(name) for name in ("state", "joint_states")]
    return [port.Eval(context).tobytes() for port in ports]


@pytest.mark.slow
def test_ports_of_one_robot_are_named_as_in_ros() -> None:
    diagram = ad.build_diagram(ad.load_robot("doosan_a0912"))

    assert input_names(diagram) == [*INPUTS, PUSH]
    assert output_names(diagram) == [*OUTPUTS, "state"]


@pytest.mark.slow
def test_ports_of_several_robots_start_with_the_robot() -> None:
    robots = [
        ad.load_robot("doosan_a0912", name=name, pose=(0.0, y, 0.0, 0.0, 0.0, 0.0))
        for name, y in (("left", 1.0), ("right", -1.0))
    ]

    diagram = ad.build_diagram(robots)

    names = ("left", "right")
    inputs = [f"{name}/{port}" for name in names for port in INPUTS]
    assert input_names(diagram) == [*inputs, PUSH]
    assert output_names(diagram) == [
        *(f"{name}/{port.lstrip('/')}" for name in names for port in OUTPUTS),
        "state",
    ]


def test_ports_of_a_robot_without_controllers_are_its_states(tmp_path: Path) -> None:
    diagram = ad.build_diagram(models.load(tmp_path, models.TWO_LINKS))

    assert input_names(diagram) == [PUSH]
    assert output_names(diagram) == ["contacts", "frames", "joint_states", "state"]


def test_a_force_pushes_a_body(tmp_path: Path) -> None:
    # A mass of 1 kg on a vertical slide that nothing drives, without gravity.
    control = models.ros2_control(states=("slide",))
    urdf = models.LIFT.replace(models.ros2_control("slide"), control)
    options = ad.SimulationOptions(gravity=False)
    diagram = ad.build_diagram(models.load(tmp_path, urdf), options=options)
    sim = ad.Simulation(diagram)
    push = ExternallyAppliedSpatialForce()
    push.body_index = diagram.GetSubsystemByName("plant").GetBodyByName("load").index()
    push.F_Bq_W = SpatialForce([0.0, 0.0, 0.0], [0.0, 0.0, 0.3])
    port = diagram.GetInputPort(PUSH)
    port.FixValue(sim.simulator.get_mutable_context(), Value([push]))

    sim.run(1.0)

    rollout = sim.rollout()
    v = rollout.velocity[:, 0]
    np.testing.assert_allclose(v, 0.3 / models.MASS * rollout.time, atol=1e-9)


@pytest.mark.slow
def test_every_system_has_a_name(tmp_path: Path) -> None:
    robots = [
        models.load(tmp_path, models.GRIPPER, name="left"),
        models.load(tmp_path, models.TWO_LINKS, name="right"),
    ]

    diagram = ad.build_diagram(robots)

    assert diagram.get_name() == "arm_drake"
    for system in diagram.GetSystems():
        # Drake's own names for the nameless are a type and an address.
        assert "@" not in system.get_name()


def test_robots_of_the_same_name_are_refused(tmp_path: Path) -> None:
    robot = pendulum(tmp_path)

    with pytest.raises(InputError) as caught:
        ad.build_diagram([robot, robot])

    assert str(caught.value) == (
        "2 robots are called 'pendulum'; "
        "give each its own name with load_robot(..., name=...)"
    )


def test_no_robot_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        ad.build_diagram([])

    assert str(caught.value) == "no robot was given; expected at least one"


@pytest.mark.slow
def test_frames_are_the_links_in_order_with_the_poses_of_another_library() -> None:
    start = {f"joint{i}": 0.2 * i - 0.7 for i in range(1, 7)}
    robot = ad.load_robot("doosan_a0912", initial_positions=start)
    diagram = ad.build_diagram(robot)

    frames = diagram.GetOutputPort("frames").Eval(diagram.CreateDefaultContext())

    model = pinocchio.buildModelFromXML(robot.description.urdf)
    data = model.createData()
    q = np.array([start[name] for name in list(model.names)[1:]])
    pinocchio.framesForwardKinematics(model, data, q)
    assert len(frames) == len(robot.description.links)
    for link, frame in zip(robot.description.links, frames, strict=True):
        expected = data.oMf[model.getFrameId(link)].homogeneous
        np.testing.assert_allclose(frame.GetAsMatrix4(), expected, atol=1e-12)


@pytest.mark.slow
def test_frames_follow_the_motion(tmp_path: Path) -> None:
    robot = pendulum(tmp_path)
    diagram = ad.build_diagram(robot)
    simulator = Simulator(diagram)
    diagram.GetInputPort("arm.joint_trajectory").FixValue(
        simulator.get_mutable_context(), trajectory({"swing": 1.0}, 0.5)
    )
    port = diagram.GetOutputPort("frames")
    before = port.Eval(simulator.get_context())

    simulator.AdvanceTo(1.5)

    base, bob = port.Eval(simulator.get_context())
    assert before[1].IsExactlyIdentity()
    assert base.IsExactlyIdentity()
    expected = [math.sin(-1.0) * models.LENGTH, 0.0, -math.cos(1.0) * models.LENGTH]
    np.testing.assert_allclose(
        bob.multiply([0.0, 0.0, -models.LENGTH]), expected, atol=1e-9
    )


@pytest.mark.slow
def test_the_state_is_the_plant_s() -> None:
    diagram, simulator = doosan_in_motion()

    simulator.AdvanceTo(0.5)

    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    context = simulator.get_context()
    np.testing.assert_array_equal(
        diagram.GetOutputPort("state").Eval(context),
        plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(context)),
    )


@pytest.mark.slow
def test_joint_states_start_at_the_initial_positions() -> None:
    start = {f"joint{i}": 0.2 * i - 0.7 for i in range(1, 7)}
    diagram = ad.build_diagram(ad.load_robot("doosan_a0912", initial_positions=start))

    states = diagram.GetOutputPort("joint_states").Eval(diagram.CreateDefaultContext())

    np.testing.assert_array_equal(states[:6], list(start.values()))
    np.testing.assert_array_equal(states[6:12], 0.0)


def test_the_first_step_after_the_first_tick_obeys_its_command(tmp_path: Path) -> None:
    diagram = ad.build_diagram(pendulum(tmp_path), world="void")
    simulator = Simulator(diagram)
    target = 1e-3
    # Reached within one period: the tick at 0, looking a period ahead, commands it.
    diagram.GetInputPort("arm.joint_trajectory").FixValue(
        simulator.get_mutable_context(),
        trajectory({"swing": target}, PERIOD, is_at_rest=False),
    )

    simulator.AdvanceTo(STEP)

    # By hand: v = h kp target, q = h v; the first command carries no velocity.
    kp = ((1.0 - math.exp(-W0 * STEP)) / STEP) ** 2
    velocity = STEP * kp * target
    position, speed, _ = diagram.GetOutputPort("joint_states").Eval(
        simulator.get_context()
    )
    assert speed == pytest.approx(velocity, abs=1e-12)
    assert position == pytest.approx(STEP * velocity, abs=1e-12)


@pytest.mark.parametrize("tick", [1, 7, 50])
def test_the_first_step_after_a_later_tick_obeys_its_command(
    tmp_path: Path, tick: int
) -> None:
    simulation = ad.Simulation(ad.build_diagram(pendulum(tmp_path), world="void"))
    simulation.advance_to(tick * PERIOD)
    target = 1e-3
    simulation.controller("arm").send_trajectory(
        trajectory({"swing": target}, PERIOD, is_at_rest=False)
    )

    simulation.advance_to(tick * PERIOD + STEP)

    # The command came from 0 within a period: a step, which has no speed.
    kp = ((1.0 - math.exp(-W0 * STEP)) / STEP) ** 2
    velocity = STEP * kp * target
    states = simulation.joint_states()
    assert states.velocity == pytest.approx((velocity,), abs=1e-12)
    assert states.position == pytest.approx((STEP * velocity,), abs=1e-12)


@pytest.mark.slow
def test_two_runs_are_identical_to_the_last_bit() -> None:
    runs = []
    for _ in range(2):
        diagram, simulator = doosan_in_motion()
        simulator.AdvanceTo(0.5)
        runs.append(state_bytes(diagram, simulator.get_context()))

    assert runs[0] == runs[1]


@pytest.mark.slow
# A tick, a step between ticks, and a time between steps.
@pytest.mark.parametrize("time", [0.3, 0.304, 0.3042])
def test_a_cloned_context_runs_on_to_the_same_bits(time: float) -> None:
    diagram, simulator = doosan_in_motion()
    simulator.AdvanceTo(time)
    clone = simulator.get_context().Clone()
    simulator.AdvanceTo(0.6)

    again = Simulator(diagram, clone)
    again.AdvanceTo(0.6)

    expected = state_bytes(diagram, simulator.get_context())
    assert state_bytes(diagram, again.get_context()) == expected


@pytest.mark.slow
def test_a_context_moves_into_another_diagram_of_the_robot() -> None:
    diagram, simulator = doosan_in_motion()
    simulator.AdvanceTo(0.3)
    other, other_simulator = doosan_in_motion()
    other_context = other_simulator.get_mutable_context()
    other_context.SetTimeStateAndParametersFrom(simulator.get_context())
    # A message is new where it is another object than that of the last tick.
    port = INPUTS[0]
    message = diagram.GetInputPort(port).Eval(simulator.get_context())
    other.GetInputPort(port).FixValue(other_context, message)

    simulator.AdvanceTo(0.6)
    other_simulator.Initialize()
    other_simulator.AdvanceTo(0.6)

    expected = state_bytes(diagram, simulator.get_context())
    assert state_bytes(other, other_context) == expected


@pytest.mark.slow
def test_a_diagram_within_another_outlives_what_built_it() -> None:
    expected_diagram, expected = doosan_in_motion()
    expected.AdvanceTo(0.3)

    builder = DiagramBuilder()
    inner = builder.AddNamedSystem(
        "cell", ad.build_diagram(ad.load_robot("doosan_a0912"))
    )
    for name in INPUTS:
        builder.ExportInput(inner.GetInputPort(name), name)
    for name in ("state", "joint_states"):
        builder.ExportOutput(inner.GetOutputPort(name), name)
    outer = builder.Build()
    del inner, builder
    gc.collect()
    simulator = Simulator(outer)
    goal = {f"joint{i}": 0.1 * i for i in range(1, 7)}
    outer.GetInputPort(INPUTS[0]).FixValue(
        simulator.get_mutable_context(), trajectory(goal, 1.0)
    )
    simulator.AdvanceTo(0.3)

    assert state_bytes(outer, simulator.get_context()) == state_bytes(
        expected_diagram, expected.get_context()
    )


@pytest.mark.slow
def test_robots_in_one_diagram_move_as_each_alone(tmp_path: Path) -> None:
    # Friction of three sizes, also none: each joint gets its own.
    frictions = {"none": 0.0, "some": 1.0, "much": 3.0}
    robots = [
        pendulum(
            tmp_path,
            f'<dynamics damping="{0.1 * index}" friction="{friction}"/>',
            name=name,
            pose=(0.0, 2.0 * index, 0.0, 0.0, 0.0, 0.0),
            initial_positions={"swing": 0.2 * index},
        )
        for index, (name, friction) in enumerate(frictions.items())
    ]
    goal = {"swing": 1.0}
    together = ad.Simulation(ad.build_diagram(robots, world="void"))
    for name in frictions:
        together.controller(f"{name}/arm").send_trajectory(trajectory(goal, 0.5))
    together.advance_to(0.4)

    for robot in robots:
        alone = ad.Simulation(ad.build_diagram(robot, world="void"))
        alone.controller("arm").send_trajectory(trajectory(goal, 0.5))
        alone.advance_to(0.4)
        rollouts = alone.rollout(), together.rollout(robot.name)
        for field in ("position", "velocity", "effort"):
            own, shared = (getattr(rollout, field) for rollout in rollouts)
            np.testing.assert_allclose(shared, own, atol=1e-10)


def test_robots_stand_where_their_poses_say(tmp_path: Path) -> None:
    robots = [
        pendulum(tmp_path, name=name, pose=(x, 0.0, 0.0, 0.0, 0.0, 0.0))
        for name, x in (("one", 1.0), ("two", 2.0))
    ]
    diagram = ad.build_diagram(robots)

    context = diagram.CreateDefaultContext()

    for name, x in (("one", 1.0), ("two", 2.0)):
        base, _ = diagram.GetOutputPort(f"{name}/frames").Eval(context)
        assert base.IsNearlyEqualTo(RigidTransform([x, 0.0, 0.0]), 1e-12)


@pytest.mark.slow
def test_the_log_has_a_row_per_tick_or_at_the_rate_asked_for(tmp_path: Path) -> None:
    robot = pendulum(tmp_path)
    for rate, rows in ((None, 51), (50.0, 26), (1000.0, 505)):
        options = ad.SimulationOptions(log_rate=rate)
        simulation = ad.Simulation(ad.build_diagram(robot, options=options))

        simulation.advance_to(0.505)

        times = simulation.rollout().time
        expected = np.arange(len(times)) / (100.0 if rate is None else rate)
        assert len(times) == rows
        np.testing.assert_allclose(times, expected, atol=1e-9)


@pytest.mark.slow
def test_a_robot_that_starts_in_the_ground_is_reported() -> None:
    robot = ad.load_robot("doosan_a0912", initial_positions={"joint2": 2.5})

    report = ad.Simulation(ad.build_diagram(robot)).report

    assert str(report) == (
        f"warning: {robot.description.file}: links overlap in the initial pose: "
        "link2 and the world, link4 and the world, link5 and the world, link6 and the "
        "world; they pass through each other until they are apart; another pose "
        "(--pose) or other initial positions (--initial) avoid it"
    )
    assert len(ad.Simulation(ad.build_diagram(robot, world="void")).report) == 0


LIFTED_BALL = models.LIFT.replace("</inertial>", f"</inertial>{models.sphere(0.1)}")
LIFT_CONTROLLERS = models.trajectory_controllers({"arm": ["slide"]})


def test_links_of_other_robots_are_reported_with_the_robot() -> None:
    one, two = (ad.load_robot(LIFTED_BALL, name=name) for name in ("one", "two"))

    report = ad.Simulation(ad.build_diagram([one, two], world="void")).report

    assert "in the initial pose: load and two/load; they pass" in str(report)


def num_shapes(diagram: Diagram) -> int:
    """Return how many shapes may collide."""
    scene_graph = diagram.GetSubsystemByName("scene_graph")
    assert isinstance(scene_graph, SceneGraph)
    inspector = scene_graph.model_inspector()
    return int(inspector.NumGeometriesWithRole(Role.kProximity))


def test_where_nothing_can_be_touched_nobody_asks_for_collisions() -> None:
    robot = ad.load_robot("doosan_a0912")

    def build(world: str = "void", **more: Any) -> int:
        options = ad.SimulationOptions(**more.pop("options", {}))
        return num_shapes(ad.build_diagram(robot, world=world, options=options, **more))

    assert build() == 0
    num_links = len(robot.description.links) - 1  # All but the world have one shape.
    assert build("empty") >= num_links
    assert build(options={"self_collision": True}) >= num_links
    assert build(payloads={"link6": 1.0}) >= num_links
    assert build(meshcat=Meshcat()) >= num_links
    two = [robot, ad.load_robot("doosan_a0912", name="two", pose=(2, 0, 0, 0, 0, 0))]
    assert num_shapes(ad.build_diagram(two, world="void")) >= 2 * num_links


def test_a_robot_that_nothing_can_touch_moves_the_same_with_its_shapes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = ad.load_robot("doosan_a0912")
    found = []
    for may_touch in (False, True):
        if may_touch:
            monkeypatch.setattr("arm_drake.diagram._may_touch", lambda *args: True)
        options = ad.SimulationOptions(log_contacts=True)
        sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))
        assert (num_shapes(sim.diagram) > 0) is may_touch
        target = trajectory({f"joint{k}": 0.3 * k for k in range(1, 7)}, 0.5)
        sim.controller("joint_trajectory_controller").send_trajectory(target)
        sim.run(0.6)
        rollout = sim.rollout()
        contacts = sim.diagram.GetOutputPort("contacts").Eval(sim.context)
        bumper = sim.topic("/contact_sensor/bumper_link6").value()
        arrays = (rollout.position, rollout.velocity, rollout.effort)
        bits = [array.tobytes() for array in arrays]
        found.append((bits, contacts, bumper, list(sim.report)))

    assert found[0] == found[1]


@pytest.mark.slow
@pytest.mark.parametrize("pieces", [1, 10, 23])
def test_what_overlaps_at_the_start_collides_once_it_is_apart(
    tmp_path: Path, pieces: int
) -> None:
    start = {"slide": -0.05}
    robot = models.load(
        tmp_path, LIFTED_BALL, LIFT_CONTROLLERS, initial_positions=start
    )
    sim = ad.Simulation(ad.build_diagram(robot))

    heights = []
    for goal in (0.0, 0.3, 0.0):
        point = ad.JointTrajectoryPoint(positions=(goal,), time_from_start=0.8)
        sim.controller("arm").send_goal(
            ad.JointTrajectory(joint_names=("slide",), points=(point,))
        )
        now = sim.time
        for piece in range(pieces):
            sim.advance_to(now + (piece + 1) / pieces)
        heights.append(sim.joint_states().position[0])

    # It is in the ground at first, then lies on it.
    np.testing.assert_allclose(heights, [0.0, 0.3, 0.1], atol=2e-3)
    sim.reset()
    sim.advance_to(0.5)
    assert sim.joint_states().position[0] == pytest.approx(-0.05, abs=1e-3)


@pytest.mark.slow
def test_what_lies_on_the_ground_goes_on_in_a_rebuilt_diagram(tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.FALLING_BALL)
    first, second = (ad.Simulation(ad.build_diagram(robot)) for _ in range(2))
    first.advance_to(0.5)  # It has hit the ground and still moves.
    saved = first.simulator.get_context().Clone()
    first.advance_to(1.0)

    root = second.simulator.get_mutable_context()
    root.SetTime(0.5)
    for system in first.diagram.GetSystems():
        if not isinstance(system, SceneGraph):
            target = second.diagram.GetSubsystemByName(system.get_name())
            target.GetMyMutableContextFromRoot(root).SetStateAndParametersFrom(
                system.GetMyContextFromRoot(saved)
            )
    second.simulator.Initialize()
    second.advance_to(1.0)

    states = [sim.joint_states() for sim in (first, second)]
    assert states[0].position == states[1].position
    assert states[0].velocity == states[1].velocity


@pytest.mark.slow
def test_controllers_of_several_robots_are_named_with_their_robot() -> None:
    robots = [ad.load_robot("lab5_arm", name=name) for name in ("left", "right")]
    (first, *_) = (c.name for c in robots[0].controllers.controllers)

    def active(*, inactive: tuple[str, ...]) -> set[str]:
        options = ad.SimulationOptions(preset="kinematic", inactive=inactive)
        simulation = ad.Simulation(ad.build_diagram(robots, options=options))
        return {c.name for c in simulation.list_controllers() if c.state == "active"}

    whole = active(inactive=())
    assert active(inactive=(f"left/{first}",)) == whole - {f"left/{first}"}
    assert active(inactive=(first,)) == whole - {f"left/{first}", f"right/{first}"}
    with pytest.raises(InputError, match=f"no controller 'lft/{first}'; did you mean"):
        active(inactive=(f"lft/{first}",))


@pytest.mark.parametrize(
    ("robots", "expected"),
    [
        ("my.urdf", "expected a robot of load_robot('my.urdf'), got str"),
        (None, "expected a robot of load_robot(...), got NoneType"),
        ([1], "expected a robot of load_robot(...), got int"),
    ],
)
def test_what_is_no_robot_is_reported(robots, expected):
    with pytest.raises(InputError) as caught:
        ad.build_diagram(robots)

    assert str(caught.value) == expected


def test_a_robot_is_no_diagram_and_says_so_in_few_words():
    robot = ad.load_robot("lab5_arm")

    with pytest.raises(InputError, match=r"Diagram of build_diagram.*got Robot"):
        ad.Simulation(robot)
    assert len(repr(robot)) < 300
    assert "joint_trajectory_controller" in repr(robot)
