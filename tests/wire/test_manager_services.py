"""Services of a controller manager and its controllers, as ros2_control's own."""

from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.messages import MultiDOFCommand
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
    gains: {swing: {p: 0.0, feedforward_gain: 2.0}}
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


def test_references_are_listed_as_interfaces_that_are_available_while_active(
    tmp_path: Path,
) -> None:
    sim = simulate(tmp_path, CHAIN)

    chained = marks(sim, "command_interfaces")
    sim.switch_controllers(deactivate=["commander"])
    sim.advance_to(0.1)
    free = marks(sim, "command_interfaces")
    sim.switch_controllers(deactivate=["second"])
    sim.advance_to(0.15)

    reference = "second/first/swing/position"
    assert chained == {
        "swing/position": (True, True),
        "first/swing/position": (True, True),
        reference: (True, True),
    }
    assert free == {**chained, reference: (True, False)}
    assert marks(sim, "command_interfaces") == {
        "swing/position": (True, True),
        "first/swing/position": (True, False),
        reference: (False, False),
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


@pytest.mark.parametrize(
    ("strictness", "is_switched"),
    [(1, True), (2, False), (3, True), (4, True)],
)
def test_only_strict_switches_do_all_or_nothing(
    tmp_path: Path, strictness: int, is_switched: bool
) -> None:
    # AUTO and FORCE_AUTO, 3 and 4, aren't more than BEST_EFFORT in ros2_control so far.
    sim = simulate(tmp_path, CHAIN)
    service = RosServer(sim, ()).graph.services["/controller_manager/switch_controller"]
    request = {
        "activate_controllers": ["first"],  # it is active
        "deactivate_controllers": ["commander"],
        "strictness": strictness,
        "timeout": {"sec": 0, "nanosec": 0},
    }
    answers: list[dict[str, Any]] = []

    service.call(Call(request, "tester", answers.append))
    sim.advance_to(0.1)

    states = {row.name: row.state for row in sim.list_controllers()}
    assert states["commander"] == ("inactive" if is_switched else "active")
    assert [answer["ok"] for answer in answers] == [is_switched]


@pytest.mark.parametrize(
    ("distro", "state"), [("humble", "inactive"), ("jazzy", "active")]
)
def test_best_effort_goes_on_without_what_is_unknown_in_humble(
    tmp_path: Path, distro: str, state: str
) -> None:
    sim = simulate(tmp_path, PID, distro=distro)

    sim.switch_controllers(["missing"], ["pid"], strictness="best_effort")
    sim.advance_to(0.1)

    assert [row.state for row in sim.list_controllers()] == [state]


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
    [("humble", "", 10), ("jazzy", "Chainable", 13)],
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


@pytest.mark.parametrize("distro", ["humble", "jazzy"])
def test_the_feedforward_of_a_pid_is_switched_by_its_service(
    tmp_path: Path, distro: str
) -> None:
    sim = simulate(tmp_path, PID, distro=distro)
    service = RosServer(sim, ()).graph.services["/pid/set_feedforward_control"]
    sim.topic("/pid/reference").publish(MultiDOFCommand(("swing",), (0.1,)))

    def command_after(time: float) -> float:
        sim.advance_to(time)
        return float(sim.rollout().command[-1, 0])

    before = command_after(0.1)
    answer = service.call(Call({"data": True}, "tester", lambda fields: None))
    switched_on = command_after(0.2)
    service.call(Call({"data": False}, "tester", lambda fields: None))

    assert answer == {"success": True, "message": ""}
    assert (before, switched_on) == (0.0, pytest.approx(0.2))
    assert command_after(0.3) == 0.0


def test_later_distros_have_no_such_service(tmp_path: Path) -> None:
    sim = simulate(tmp_path, PID, distro="kilted")

    services = RosServer(sim, ()).graph.services

    assert "/pid/get_parameters" in services
    assert "/pid/set_feedforward_control" not in services
