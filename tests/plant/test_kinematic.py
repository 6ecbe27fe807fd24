"""The preset kinematic: commands are states one cycle later, as in mock_components."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import Float64MultiArray
from tests import models

KINEMATIC = ad.SimulationOptions(preset="kinematic")
PERIOD = 0.01


def interface(kind: str, name: str, value: str = "") -> str:
    inside = f'<param name="initial_value">{value}</param>' if value else ""
    return f'<{kind}_interface name="{name}">{inside}</{kind}_interface>'


def component(tag: str, name: str, *interfaces: str) -> str:
    return f'<{tag} name="{name}">{"".join(interfaces)}</{tag}>'


def arm(*components: str, hardware: str = "", second: str = "") -> str:
    """Return an arm of two joints; the second one may mimic the first."""
    return f"""
    <robot name="arm">
      <link name="base"/>
      {models.joint("j1", "base", "a", xyz="0 0 1")}{models.bob("a")}
      {models.joint("j2", "a", "b", xyz="0 0 -0.5", inside=second)}{models.bob("b")}
      <ros2_control name="hardware" type="system">
        <hardware>
          <plugin>mock_components/GenericSystem</plugin>{hardware}
        </hardware>
        {"".join(components)}
      </ros2_control>
    </robot>"""


BOTH = [
    component(
        "joint",
        name,
        interface("command", "position"),
        interface("command", "velocity"),
        interface("state", "position", value),
        interface("state", "velocity"),
    )
    for name, value in (("j1", "0.1"), ("j2", "-0.2"))
]
YAML = """
controller_manager:
  ros__parameters:
    update_rate: 100
    position: {type: position_controllers/JointGroupPositionController}
    velocity: {type: velocity_controllers/JointGroupVelocityController}
position: {ros__parameters: {joints: [j1, j2]}}
velocity: {ros__parameters: {joints: [j1, j2]}}
"""


def load(folder, text, yaml=YAML, **options):
    (folder / "arm.urdf").write_text(text, encoding="utf-8")
    (folder / "controllers.yaml").write_text(yaml, encoding="utf-8")
    return ad.load_robot(
        folder / "arm.urdf", controllers=folder / "controllers.yaml", **options
    )


def simulate(robot):
    """Return a simulation; positions are commanded first where there is a choice."""
    names = {controller.name for controller in robot.controllers.controllers}
    inactive = tuple(names & {"velocity", "both"})
    options = ad.SimulationOptions(preset="kinematic", inactive=inactive)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def command(sim, controller, *values):
    sim.publish(f"{controller}.commands", Float64MultiArray(values), PERIOD)


@pytest.mark.slow
def test_positions_are_those_commanded_in_the_cycle_before():
    robot = ad.load_robot("doosan_a0912")
    sim = simulate(robot)
    joints = [f"joint{k}" for k in range(1, 7)]
    point = ad.JointTrajectoryPoint(positions=[0.5] * 6, time_from_start=0.5)

    goal = sim.controller("joint_trajectory_controller").send_goal(
        ad.JointTrajectory(joint_names=joints, points=[point])
    )
    sim.advance_to(1.0)

    assert goal.status is ad.GoalStatus.SUCCEEDED
    rollout = sim.rollout()
    reference = rollout.references["joint_trajectory_controller"].position
    # A row of the reference is what the cycle before commanded.
    assert np.isnan(reference[0]).all()
    np.testing.assert_array_equal(rollout.position[1:], reference[1:])
    assert sim.joint_states().position == (0.5,) * 6


@pytest.mark.slow
def test_links_are_where_physics_has_them_at_the_same_positions():
    initial = {f"joint{k}": 0.1 * k for k in range(1, 7)}
    robot = ad.load_robot("doosan_a0912", initial_positions=initial)
    physical = ad.Simulation(ad.build_diagram(robot)).link_poses()

    poses = simulate(robot).link_poses()

    assert poses.keys() == physical.keys()
    for name, X_WL in poses.items():
        np.testing.assert_allclose(
            X_WL.GetAsMatrix4(), physical[name].GetAsMatrix4(), rtol=0.0, atol=1e-12
        )


def test_joints_start_where_their_initial_values_say(tmp_path):
    sim = simulate(load(tmp_path, arm(*BOTH)))

    sim.advance_to(0.1)

    assert sim.joint_states().position == (0.1, -0.2)


def test_only_the_state_of_the_same_name_follows(tmp_path):
    sim = simulate(load(tmp_path, arm(*BOTH)))
    sim.advance_to(PERIOD)
    sim.switch_controllers(["velocity"], ["position"])
    sim.advance_to(2 * PERIOD)

    command(sim, "velocity", 0.5, 0.6)
    sim.advance_to(5 * PERIOD)

    assert sim.joint_states().velocity == (0.5, 0.6)
    assert sim.joint_states().position == (0.1, -0.2)


def test_calculated_dynamics_integrates_velocities(tmp_path):
    dynamics = '<param name="calculate_dynamics">true</param>'
    sim = simulate(load(tmp_path, arm(*BOTH, hardware=dynamics)))
    sim.advance_to(PERIOD)
    sim.switch_controllers(["velocity"], ["position"])
    command(sim, "velocity", 0.5, -0.5)

    sim.advance_to(1.0)

    # Commanded in cycle 1, read in the cycles 2 to 100, which is now.
    travelled = 0.5 * PERIOD * 99
    np.testing.assert_allclose(
        sim.joint_states().position, [0.1 + travelled, -0.2 - travelled], atol=1e-12
    )
    assert sim.joint_states().velocity == (0.5, -0.5)


@pytest.mark.parametrize("has_interfaces", [True, False])
def test_a_mimic_joint_follows_its_master(tmp_path, has_interfaces):
    mimic = '<mimic joint="j1" multiplier="-2" offset="0.3"/>'
    follower = component("joint", "j2", interface("state", "position"))
    text = arm(BOTH[0], follower if has_interfaces else "", second=mimic)
    sim = simulate(load(tmp_path, text, YAML.replace("[j1, j2]", "[j1]")))

    command(sim, "position", 0.7)
    sim.advance_to(0.1)

    np.testing.assert_allclose(
        sim.joint_states().position, [0.7, 0.3 - 2.0 * 0.7], atol=1e-12
    )


def test_gpios_and_further_interfaces_are_mirrored(tmp_path):
    gpio = component(
        "gpio", "io", interface("command", "out"), interface("state", "out", "0.5")
    )
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 100
    io_controller: {type: forward_command_controller/ForwardCommandController}
    jsb: {type: joint_state_broadcaster/JointStateBroadcaster}
io_controller: {ros__parameters: {joints: [io], interface_name: out}}
"""
    sim = simulate(load(tmp_path, arm(*BOTH, gpio), yaml))
    sim.advance_to(PERIOD)
    before = _published(sim)

    command(sim, "io_controller", 3.5)
    sim.advance_to(5 * PERIOD)

    assert (before, _published(sim)) == (0.5, 3.5)


def _published(sim):
    message = sim.eval_output("jsb.dynamic_joint_states")
    values = message.interface_values[message.joint_names.index("io")]
    return dict(zip(values.interface_names, values.values, strict=True))["out"]


def test_a_switch_that_the_hardware_refuses_is_not_made(tmp_path):
    dynamics = '<param name="calculate_dynamics">true</param>'
    yaml = YAML.replace(
        "velocity: {ros__parameters: {joints: [j1, j2]}}",
        "velocity: {ros__parameters: {joints: [j1, j2]}}\n"
        "both: {ros__parameters: {joint: j1, interface_names: [position, velocity]}}",
    ).replace(
        "    velocity: {type",
        "    both: {type: "
        "forward_command_controller/MultiInterfaceForwardCommandController}\n"
        "    velocity: {type",
    )
    robot = load(tmp_path, arm(*BOTH, hardware=dynamics), yaml)
    sim = simulate(robot)

    with pytest.raises(InputError, match="exactly one of position, velocity"):
        sim.switch_controllers(["both"], ["position"])


def test_a_saved_state_continues_in_a_rebuilt_diagram_to_the_same_bits(tmp_path):
    dynamics = '<param name="calculate_dynamics">true</param>'
    robot = load(tmp_path, arm(*BOTH, hardware=dynamics))
    sim = simulate(robot)
    command(sim, "position", 0.4, 0.3)
    sim.advance_to(0.023)
    saved = sim.simulator.get_context().Clone()
    sim.advance_to(0.2)

    diagram = simulate(robot).diagram
    other = Simulator(diagram)
    other.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    other.AdvanceTo(0.2)

    state = diagram.GetOutputPort("state").Eval(other.get_context())
    np.testing.assert_array_equal(state, sim.eval_output("state"))
    assert state[:2].tolist() == [0.4, 0.3]


@pytest.mark.slow
def test_two_robots_stand_beside_each_other():
    robots = [
        ad.load_robot("doosan_a0912", name=name, pose=(0.0, y, 0.0, 0.0, 0.0, 0.0))
        for name, y in (("left", 1.0), ("right", -1.0))
    ]

    sim = ad.Simulation(ad.build_diagram(robots, options=KINEMATIC))

    assert sim.link_poses("left")["link1"].translation()[1] == pytest.approx(1.0)
    assert sim.link_poses("right")["link1"].translation()[1] == pytest.approx(-1.0)


def test_an_unknown_preset_is_an_error():
    with pytest.raises(InputError, match="no preset 'quick'; known: accurate, f"):
        ad.SimulationOptions(preset="quick")


def test_interfaces_of_one_joint_can_be_commanded_by_several_controllers(tmp_path):
    robot = load(tmp_path, arm(*BOTH))

    sim = ad.Simulation(ad.build_diagram(robot, options=KINEMATIC))
    command(sim, "position", 0.4, 0.3)
    command(sim, "velocity", 0.5, 0.6)
    sim.advance_to(0.1)

    assert sim.joint_states().position == (0.4, 0.3)
    assert sim.joint_states().velocity == (0.5, 0.6)


def test_a_controller_that_the_hardware_refuses_does_not_start(tmp_path):
    dynamics = '<param name="calculate_dynamics">true</param>'
    yaml = """
controller_manager:
  ros__parameters:
    update_rate: 100
    both: {type: forward_command_controller/MultiInterfaceForwardCommandController}
both: {ros__parameters: {joint: j1, interface_names: [position, velocity]}}
"""
    robot = load(tmp_path, arm(*BOTH, hardware=dynamics), yaml)

    sim = ad.Simulation(ad.build_diagram(robot, options=KINEMATIC))

    assert [row.state for row in sim.list_controllers()] == ["inactive"]
    assert any("exactly one of position, velocity" in e.what for e in sim.report)


def test_commands_are_held_to_limits_anew_after_a_switch(tmp_path):
    dynamics = '<param name="calculate_dynamics">true</param>'
    robot = load(tmp_path, arm(*BOTH, hardware=dynamics), distro="rolling")
    sim = simulate(robot)
    command(sim, "position", 0.5, 0.0)
    sim.advance_to(1.0)
    sim.switch_controllers(["velocity"], ["position"])
    command(sim, "velocity", -1.0, 0.0)
    sim.advance_to(1.5)
    sim.switch_controllers(["position"], ["velocity"])
    sim.advance_to(1.5 + PERIOD)
    start = sim.joint_states().position[0]

    command(sim, "position", 1.0, 0.0)
    sim.advance_to(1.5 + 3.5 * PERIOD)

    # 10 rad/s at most, in the two cycles that are read by then.
    moved = sim.joint_states().position[0] - start
    assert 0.0 < moved <= 10.0 * 2 * PERIOD + 1e-9


@pytest.mark.parametrize(
    ("kind", "dynamics", "reported"),
    [
        ("velocity", "false", True),
        ("velocity", "true", False),
        ("effort", "true", True),
        ("position", "false", False),
    ],
)
def test_commands_that_move_nothing_are_reported(tmp_path, kind, dynamics, reported):
    text = models.pendulum(control=models.ros2_control("swing", command=kind))
    parameter = f'<param name="calculate_dynamics">{dynamics}</param></hardware>'
    robot = load(
        tmp_path,
        text.replace("</hardware>", parameter),
        f"""
controller_manager:
  ros__parameters:
    forward: {{type: forward_command_controller/ForwardCommandController}}
forward:
  ros__parameters: {{joints: [swing], interface_name: {kind}}}
""",
    )

    sim = ad.Simulation(ad.build_diagram(robot, options=KINEMATIC))
    sim.controller("forward").command([0.5])
    sim.run(1.0)

    said = [str(e) for e in sim.report if "move nothing" in str(e)]
    assert bool(said) == reported
    assert (sim.joint_states().position[0] == 0.0) == reported
    if reported:
        assert f"1 joint follows commands of {kind}" in said[0]
        assert ("calculate_dynamics" in said[0]) == (kind == "velocity")
