"""Keys drive bases and joints while they are down, and nothing after."""

import argparse
import math
import time
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.commands.sim import _show_live
from arm_drake.errors import InputError
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page import keyboard as module
from arm_drake.visualization.page.keyboard import Keyboard
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.visualization.page.parts import find_part
from tests import carts
from tests.models import joint, ros2_control

OPTIONS = ad.SimulationOptions(frame_rate=0.0)

# Its one joint is told positions by one controller, and velocities by the other.
ROBOT = f"""
<robot name="turner"><link name="world"/>
  <link name="arm"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  {
    joint(
        "turn",
        "world",
        "arm",
        axis="0 0 1",
        limit='lower="-0.5" upper="2" effort="50" velocity="1.0"',
    )
}
  {
    ros2_control("turn").replace(
        '<command_interface name="position"/>',
        '<command_interface name="position"/><command_interface name="velocity"/>',
    )
}
</robot>"""

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: joint_trajectory_controller/JointTrajectoryController}
    speeds: {type: forward_command_controller/ForwardCommandController}
arm:
  ros__parameters:
    joints: [turn]
    command_interfaces: [position]
    state_interfaces: [position, velocity]
speeds:
  ros__parameters: {joints: [turn], interface_name: velocity}
"""


def make(page: Page, robot: ad.Robot) -> LiveSimulation:
    diagram = ad.build_diagram(robot, options=OPTIONS, meshcat=page.meshcat)
    return LiveSimulation(page, Simulation(diagram), realtime_rate=0.0)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody repeats here what is down, and the machine may be busy."""
    monkeypatch.setattr(module, "_PATIENCE", 1000.0)


@pytest.fixture
def cart() -> Iterator[LiveSimulation]:
    with Page() as page:
        yield make(page, ad.load_robot(carts.cart(carts.diff_drive())))


@pytest.fixture
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveSimulation]:
    file = tmp_path_factory.mktemp("keys") / "controllers.yaml"
    file.write_text(CONTROLLERS)
    with Page() as page:
        live = make(page, ad.load_robot(ROBOT, controllers=file))
        yield live


def hold(live: LiveSimulation, *keys: str, on: bool = True) -> None:
    live.handle([WidgetEvent("keys:on", on)] if not keyboard_of(live).is_on else [])
    live.handle([WidgetEvent("keys:held", list(keys))])


def keyboard_of(live: LiveSimulation) -> Keyboard:
    return find_part(live.parts, Keyboard)


def place(live: LiveSimulation) -> np.ndarray:
    return live.simulation.link_poses()["base_link"].translation()


def position(live: LiveSimulation) -> float:
    return float(live.simulation.joint_states().position[0])


@pytest.mark.slow
def test_an_arrow_drives_a_base_until_it_is_let_go(cart: LiveSimulation) -> None:
    start = place(cart)
    hold(cart, "ArrowUp")
    cart.run(1.0)
    gone = place(cart) - start

    # Half of 0.5 m/s, less what it takes to get there.
    assert 0.15 < gone[0] <= 0.27
    assert gone[1] == pytest.approx(0.0, abs=0.01)
    hold(cart)
    cart.run(0.5)
    stopped = place(cart)
    cart.run(0.5)
    assert place(cart) == pytest.approx(stopped, abs=1e-3)


@pytest.mark.slow
def test_two_arrows_drive_a_curve(cart: LiveSimulation) -> None:
    hold(cart, "ArrowUp", "ArrowLeft")
    cart.run(0.5)

    assert cart.remotes[0].value_of("forward") == pytest.approx(0.25)
    assert cart.remotes[0].value_of("turn") == pytest.approx(0.5)


@pytest.mark.slow
def test_a_browser_that_is_gone_lets_go(
    cart: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold(cart, "ArrowUp")
    cart.run(0.1)
    assert cart.remotes[0].value_of("forward") > 0.0
    later = time.perf_counter() + 1.1 * module._PATIENCE
    monkeypatch.setattr(module.time, "perf_counter", lambda: later)

    keyboard_of(cart).changes()

    assert cart.remotes[0].value_of("forward") == 0.0


@pytest.mark.slow
def test_a_digit_jogs_a_joint_and_shift_back(arm: LiveSimulation) -> None:
    hold(arm, "Digit1")
    arm.run(1.0)
    there = position(arm)
    # Half of its 1 rad/s; it follows a little behind.
    assert 0.3 < there <= 0.51

    hold(arm, "Shift", "Digit1")
    arm.run(3.0)

    # Its end is where it stops.
    assert position(arm) == pytest.approx(-0.5, abs=0.02)


@pytest.mark.slow
def test_a_velocity_ends_with_its_key(arm: LiveSimulation) -> None:
    arm.simulation.switch_controllers(activate=["speeds"], deactivate=["arm"])
    arm.run(0.1)
    arm.handle([WidgetEvent("keys:arm", "speeds")])
    hold(arm, "Digit1")
    arm.run(0.5)
    assert arm.simulation.joint_states().velocity[0] == pytest.approx(0.5, abs=0.05)

    hold(arm)
    arm.run(0.5)

    assert arm.simulation.joint_states().velocity[0] == pytest.approx(0.0, abs=0.01)


def test_keys_do_nothing_while_they_are_off(arm: LiveSimulation) -> None:
    arm.handle([WidgetEvent("keys:held", ["Digit1"])])

    assert keyboard_of(arm).advance() == math.inf
    arm.run(0.2)
    assert position(arm) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, 3, "Digit1", [3, None, "KeyA", "Digit0"], {}])
def test_what_makes_no_sense_drives_nothing(arm: LiveSimulation, value: object) -> None:
    arm.handle([WidgetEvent("keys:on", True), WidgetEvent("keys:held", value)])

    assert keyboard_of(arm).advance() == math.inf


def test_an_inactive_controller_is_said_and_the_run_goes_on(
    arm: LiveSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(Page, "say", lambda page, text, *rest: said.append(text))
    arm.handle([WidgetEvent("keys:arm", "speeds")])
    hold(arm, "Digit1")

    arm.run(0.2)

    assert "controller 'speeds': it isn't active; activate it first" in said
    assert arm.simulation.time == pytest.approx(0.2)


def test_an_unknown_controller_is_said(arm: LiveSimulation) -> None:
    with pytest.raises(InputError, match="keyboard: no controller 'arms'; did you"):
        keyboard_of(arm).handle("keys:arm", "arms")


def test_the_option_says_if_there_is_nothing_to_drive() -> None:
    options = argparse.Namespace(curve=[], keyboard=True, display=[])

    with pytest.raises(InputError) as error:
        _show_live(options, SimpleNamespace(parts=[]))

    assert str(error.value) == (
        "--keyboard: no controller here takes velocities of a base or positions of "
        "joints"
    )
