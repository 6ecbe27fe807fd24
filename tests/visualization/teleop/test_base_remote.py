"""Bases drive at the speed that is set, as long as somebody ticks, and stop."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.visualization.page.widgets import Slider
from arm_drake.visualization.teleop.remotes import BaseRemote, find_remotes
from tests import carts
from tests.robots import load_real_robot
from tests.rollouts.test_sideways_bases import BASES as SIDEWAYS
from tests.rollouts.test_sideways_bases import Base, gazebo_mecanum
from tests.visualization.teleop import panel

# Controllers of bases of the index, and the link to look at.
BASES = {
    "create3": ("diffdrive_controller", "base_link"),
    "pmb2": ("mobile_base_controller", "base_footprint"),
    "gz_ackermann_drive": ("ackermann_steering_controller", "base_link"),
    "demo11_carlikebot": ("bicycle_steering_controller", "base_link"),
}

# Of them, the one whose wheels cost the least to simulate.
CHEAP = "gz_ackermann_drive"

SPEED = 0.2

# Of the plant [s], of which the remote knows nothing.
STEP = 5e-3


def base_of(name: str) -> tuple[ad.Simulation, BaseRemote, str]:
    controller, link = BASES[name]
    sim = panel.simulate(load_real_robot(name), time_step=STEP)
    sim.run(0.5)  # Until it stands on its wheels.
    return sim, panel.find(sim, controller, BaseRemote), link


def moved(first: RigidTransform, last: RigidTransform) -> tuple[float, float, float]:
    """Return how far forwards and to the left [m], and by which angle [rad]."""
    way = first.inverse() @ last
    x, y = way.translation()[:2]
    return x, y, float(RollPitchYaw(way.rotation()).yaw_angle())


@pytest.mark.slow
@pytest.mark.parametrize("name", BASES)
def test_a_base_drives_straight_at_the_speed_and_stops(name: str) -> None:
    sim, remote, link = base_of(name)

    panel.use(remote, "forward", SPEED)
    panel.run(sim, 1.0, remote)
    at_one = sim.link_poses()[link]
    panel.run(sim, 1.0, remote)
    at_two = sim.link_poses()[link]
    panel.use(remote, "stop")
    panel.run(sim, 1.5, remote)
    stopped = sim.link_poses()[link]
    panel.run(sim, 0.5, remote)

    x, y, yaw = moved(at_one, at_two)
    # In the second second nothing accelerates any more: it is the speed, but for slip
    # of the wheels under 2 % (tests/rollouts/test_bases.py), and a controller that has
    # timed out would stand by then.
    assert x == pytest.approx(SPEED * 1.0, rel=0.02)
    assert abs(y) <= 0.01 * x
    assert abs(yaw) <= 0.01
    assert np.linalg.norm(moved(stopped, sim.link_poses()[link])[:2]) <= 1e-3
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_without_ticks_the_controller_stops_by_itself() -> None:
    sim, remote, link = base_of("pmb2")

    remote.drive(SPEED)
    panel.run(sim, 1.0)  # Nobody ticks.
    before = sim.link_poses()[link]
    panel.run(sim, 1.0)

    # Its timeout is 0.5 s.
    assert abs(moved(before, sim.link_poses()[link])[0]) <= 1e-3


@pytest.mark.slow
def test_nothing_is_repeated_after_a_stop() -> None:
    sim, remote, _ = base_of("create3")
    (port,) = (
        sim.diagram.GetInputPort(name) for name in ["diffdrive_controller.cmd_vel"]
    )
    remote.drive(SPEED)
    panel.run(sim, 0.3, remote)

    remote.stop()
    context = sim.simulator.get_context()
    last = port.Eval(context)[-1]
    panel.run(sim, 0.5, remote)

    assert last.twist.linear.x == 0.0
    assert port.Eval(context)[-1] is last


@pytest.mark.slow
@pytest.mark.parametrize("name", SIDEWAYS)
def test_a_base_with_rollers_goes_sideways(tmp_path: Path, name: str) -> None:
    base = Base(tmp_path, SIDEWAYS[name]())
    base.sim.run(0.5)
    remote = panel.find(base.sim, "drive", BaseRemote)
    first = base.pose

    panel.use(remote, "sideways", SPEED)
    panel.run(base.sim, 2.0, remote)
    panel.use(remote, "stop")
    panel.run(base.sim, 1.0, remote)

    x, y, _ = moved(first, base.pose)
    assert set(panel.leaves(remote)) == {"forward", "sideways", "turn", "stop"}
    # As tests/rollouts/test_sideways_bases.py has it for a way of seconds.
    assert y == pytest.approx(2.0 * SPEED, rel=0.1)
    assert abs(x) <= 0.1 * y


@pytest.mark.slow
def test_a_base_turns_while_it_drives() -> None:
    sim, remote, link = base_of("create3")

    panel.use(remote, "turn", 0.5)
    panel.use(remote, "forward", 0.1)
    panel.run(sim, 1.0, remote)
    before = sim.link_poses()[link]
    panel.run(sim, 1.0, remote)

    x, y, yaw = moved(before, sim.link_poses()[link])
    # An arc of a circle of 0.2 m; wheels of a turning base slip by up to 5 %.
    radius = 0.1 / 0.5
    assert yaw == pytest.approx(0.5, rel=0.05)
    assert x == pytest.approx(radius * math.sin(0.5), rel=0.05)
    assert y == pytest.approx(radius * (1.0 - math.cos(0.5)), rel=0.1)


@pytest.mark.parametrize(
    ("tags", "forward", "turn"),
    [
        ((), (-0.5, 0.5), (-1.0, 1.0)),
        ((("max_velocity", 0.8), ("min_velocity", -0.3)), (-0.3, 0.8), (-0.3, 0.8)),
        ((("max_linear_velocity", 0.8),), (-0.8, 0.8), (-1.0, 1.0)),
    ],
)
def test_ranges_are_the_limits_of_the_plugin(
    tmp_path: Path,
    tags: tuple[tuple[str, object], ...],
    forward: tuple[float, float],
    turn: tuple[float, float],
) -> None:
    sim = panel.simulate(carts.load(tmp_path, carts.cart(carts.diff_drive(*tags))))

    shown = panel.leaves(panel.find(sim, "DiffDrive", BaseRemote))

    for name, ends in (("forward", forward), ("turn", turn)):
        slider = shown[name]
        assert isinstance(slider, Slider)
        assert (slider.lower, slider.upper) == ends


@pytest.mark.slow
def test_ranges_are_the_limits_of_the_controller() -> None:
    # Of its YAML.
    _, remote, _ = base_of("pmb2")

    shown = panel.leaves(remote)

    assert "sideways" not in shown
    forward, turn = shown["forward"], shown["turn"]
    assert isinstance(forward, Slider)
    assert isinstance(turn, Slider)
    assert (forward.lower, forward.upper, forward.unit) == (-0.2, 1.0, "m/s")
    assert (turn.lower, turn.upper, turn.unit) == (-1.05, 1.05, "rad/s")


@pytest.mark.slow
@pytest.mark.parametrize("plugin", [carts.diff_drive(), carts.classic_drive()])
def test_plugins_of_gazebo_drive(tmp_path: Path, plugin: str) -> None:
    sim = panel.simulate(carts.load(tmp_path, carts.cart(plugin)))
    sim.run(0.5)
    (remote,) = (r for r in find_remotes(sim) if isinstance(r, BaseRemote))
    first = sim.link_poses()["base_link"]

    panel.use(remote, "forward", SPEED)
    panel.run(sim, 2.0, remote)
    panel.use(remote, "stop")
    panel.run(sim, 1.5, remote)

    # What it starts late it stops late, as tests/rollouts/test_gazebo_bases.py has it.
    x, y, _ = moved(first, sim.link_poses()["base_link"])
    assert x == pytest.approx(2.0 * SPEED, rel=0.02)
    assert abs(y) <= 0.01 * x


@pytest.mark.slow
def test_a_base_that_is_switched_off_does_not_drive_on_later() -> None:
    sim, remote, link = base_of(CHEAP)
    remote.drive(SPEED)
    panel.run(sim, 0.5, remote)

    sim.switch_controllers([], [remote.controller])
    panel.run(sim, 1.0, remote)
    sim.switch_controllers([remote.controller], [])
    panel.run(sim, 0.5, remote)
    before = sim.link_poses()[link]
    panel.run(sim, 0.5, remote)

    assert abs(moved(before, sim.link_poses()[link])[0]) <= 1e-3
    forward = panel.leaves(remote)["forward"]
    assert isinstance(forward, Slider)
    assert forward.value == 0.0
    assert panel.nothing_lost(sim)


@pytest.mark.slow
def test_velocities_that_make_no_sense_are_refused() -> None:
    _, remote, _ = base_of(CHEAP)

    with pytest.raises(InputError, match="this base can't go sideways"):
        remote.drive(0.1, 0.1)
    with pytest.raises(InputError, match="turn: expected a finite number, got inf"):
        remote.drive(0.1, turn=math.inf)


@pytest.mark.parametrize(
    ("block", "name"),
    [
        (carts.plugin("gz-sim-velocity-control-system"), "VelocityControl"),
        (carts.plugin("libgazebo_ros_planar_move.so"), "GazeboRosPlanarMove"),
    ],
)
def test_a_base_whose_velocity_is_set_has_a_slider_to_go_sideways(
    tmp_path: Path, block: str, name: str
) -> None:
    sim = panel.simulate(carts.load(tmp_path, carts.cart(block)))

    assert "sideways" in panel.leaves(panel.find(sim, name, BaseRemote))


def test_gazebo_s_mecanum_drive_is_limited_and_goes_sideways(tmp_path: Path) -> None:
    limit = "<max_linear_velocity>0.3</max_linear_velocity></plugin>"
    text = gazebo_mecanum().replace("</plugin>", limit)
    sim = panel.simulate(carts.load(tmp_path, text))

    slider = panel.leaves(panel.find(sim, "MecanumDrive", BaseRemote))["sideways"]

    assert isinstance(slider, Slider)
    assert (slider.lower, slider.upper) == (-0.3, 0.3)


def test_a_base_with_steered_wheels_has_the_limits_of_its_plugin(
    tmp_path: Path,
) -> None:
    block = carts.ackermann_steering(("max_velocity", 0.3))
    sim = panel.simulate(carts.load(tmp_path, carts.steered_cart(block)))

    shown = panel.leaves(panel.find(sim, "AckermannSteering", BaseRemote))

    assert set(shown) == {"forward", "turn", "stop"}
    for name in ("forward", "turn"):
        slider = shown[name]
        assert isinstance(slider, Slider)
        assert (slider.lower, slider.upper) == (-0.3, 0.3)
