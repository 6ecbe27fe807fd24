"""What a controller manager's services list, as ros2_control's own does."""

from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.wire.graph import Call
from arm_drake.wire.server import RosServer
from tests import models

# As example 12 of ros2_control_demos, on one joint.
CHAIN = """
controller_manager:
  ros__parameters:
    update_rate: 100
    first: {type: passthrough_controller/PassthroughController}
    second: {type: passthrough_controller/PassthroughController}
    commander: {type: forward_command_controller/ForwardCommandController}
first: {ros__parameters: {interfaces: [swing/position]}}
second: {ros__parameters: {interfaces: [first/swing/position]}}
commander:
  ros__parameters: {joints: [second/first/swing], interface_name: position}
"""

PID = """
controller_manager:
  ros__parameters:
    update_rate: 100
    pid: {type: pid_controller/PidController}
pid:
  ros__parameters:
    dof_names: [swing]
    command_interface: position
    reference_and_state_interfaces: [position]
    gains: {swing: {p: 1.0}}
"""


def simulate(
    folder: Path, yaml: str, urdf: str | None = None, **options: Any
) -> ad.Simulation:
    robot = models.load(folder, urdf or models.pendulum(), yaml, **options)
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.advance_to(0.05)
    return sim


def ask(sim: ad.Simulation, service: str) -> dict[str, Any]:
    """Return what a service of the controller manager answers."""
    server = RosServer(sim, ())
    found = server.graph.services[f"/controller_manager/{service}"]
    answer = found.call(Call({}, "tester", lambda fields: None))
    assert answer is not None
    return answer


def marks(sim: ad.Simulation, kind: str) -> dict[str, tuple[bool, bool]]:
    """Return whether interfaces are available and claimed, by name."""
    rows = ask(sim, "list_hardware_interfaces")[kind]
    return {row["name"]: (row["is_available"], row["is_claimed"]) for row in rows}


def test_controllers_are_listed_with_their_own_names_of_references(
    tmp_path: Path,
) -> None:
    sim = simulate(tmp_path, CHAIN)

    rows = {row["name"]: row for row in ask(sim, "list_controllers")["controller"]}

    assert rows["first"]["reference_interfaces"] == ["swing/position"]
    assert rows["second"]["reference_interfaces"] == ["first/swing/position"]
    assert rows["second"]["chain_connections"] == [
        {"name": "first", "reference_interfaces": ["swing/position"]}
    ]
    assert rows["commander"]["chain_connections"] == [
        {"name": "second", "reference_interfaces": ["first/swing/position"]}
    ]
    # Those of what it commands have the other's name before them.
    assert rows["second"]["claimed_interfaces"] == ["first/swing/position"]
    chained = {name: row["is_chained"] for name, row in rows.items()}
    assert chained == {"first": True, "second": True, "commander": False}


def test_a_controller_that_exports_states_is_chainable(tmp_path: Path) -> None:
    sim = simulate(tmp_path, PID)

    [row] = ask(sim, "list_controllers")["controller"]

    assert (row["is_chainable"], row["is_chained"]) == (True, False)
    assert row["reference_interfaces"] == ["swing/position"]
    assert row["exported_state_interfaces"] == ["swing/position"]


def test_references_are_listed_as_interfaces_that_are_available_in_a_chain(
    tmp_path: Path,
) -> None:
    sim = simulate(tmp_path, CHAIN)

    chained = marks(sim, "command_interfaces")
    sim.switch_controllers(deactivate=["commander"])
    sim.advance_to(0.1)

    assert chained == {
        "swing/position": (True, True),
        "first/swing/position": (True, True),
        "second/first/swing/position": (True, True),
    }
    assert marks(sim, "command_interfaces") == {
        "swing/position": (True, True),
        "first/swing/position": (True, True),
        # It is active, but what it does comes from its topic.
        "second/first/swing/position": (False, False),
    }


def test_exported_states_are_available_as_long_as_their_controller_is_active(
    tmp_path: Path,
) -> None:
    sim = simulate(tmp_path, PID)

    active = marks(sim, "state_interfaces")
    sim.switch_controllers(deactivate=["pid"])
    sim.advance_to(0.1)

    assert active["swing/velocity"] == (True, False)
    assert active["pid/swing/position"] == (True, False)
    assert marks(sim, "state_interfaces")["pid/swing/position"] == (False, False)


@pytest.mark.parametrize("service", ["interfaces", "components"])
def test_interfaces_are_listed_with_their_types(tmp_path: Path, service: str) -> None:
    state = '<state_interface name="effort"/>'
    flag = '<state_interface name="homed" data_type="bool"/>'
    urdf = models.pendulum().replace(state, f"{state}{flag}")
    sim = simulate(tmp_path, PID, urdf)

    answer = ask(sim, f"list_hardware_{service}")
    [part] = [answer] if service == "interfaces" else answer["component"]

    types = {row["name"]: row["data_type"] for row in part["state_interfaces"]}
    assert types["swing/homed"] == "bool"
    assert types["swing/position"] == "double"


@pytest.mark.parametrize(
    ("distro", "prefix", "num_chainable"),
    [("humble", "", 9), ("jazzy", "Chainable", 12)],
)
def test_types_are_listed_with_their_base_classes(
    tmp_path: Path, distro: str, prefix: str, num_chainable: int
) -> None:
    sim = simulate(tmp_path, PID, distro=distro)

    answer = ask(sim, "list_controller_types")
    classes = dict(zip(answer["types"], answer["base_classes"], strict=True))

    space = "controller_interface::"
    base = "ControllerInterface"
    trajectory = "joint_trajectory_controller/JointTrajectoryController"
    assert classes[trajectory] == f"{space}{base}"
    assert classes["pid_controller/PidController"] == f"{space}Chainable{base}"
    diff_drive = "diff_drive_controller/DiffDriveController"
    assert classes[diff_drive] == f"{space}{prefix}{base}"
    assert list(classes.values()).count(f"{space}Chainable{base}") == num_chainable
