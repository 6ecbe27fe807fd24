"""Logs of robots whose controllers are not all active, in every format."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from tests import models

INTERFACES = "command_interfaces: [position], state_interfaces: [position, velocity]"

# By what is amiss: type and parameters.
CONTROLLERS = {
    "joint_is_gone": (
        "joint_trajectory_controller/JointTrajectoryController",
        f"joints: [elbow, wrist], {INTERFACES}",
    ),
    "all_joints_are_gone": (
        "position_controllers/JointGroupPositionController",
        "joints: [wrist]",
    ),
    "interface_is_missing": (
        "pid_controller/PidController",
        "dof_names: [elbow], command_interface: effort, gains: {elbow: {p: 1.0}}, "
        "reference_and_state_interfaces: [position]",
    ),
    "gripper_is_gone": (
        "position_controllers/GripperActionController",
        "joint: finger",
    ),
    "claimed_by_another": (
        "forward_command_controller/ForwardCommandController",
        "joints: [shoulder], interface_name: position",
    ),
    "without_parameters": ("admittance_controller/AdmittanceController", ""),
    "of_a_gpio": (
        "gpio_controllers/GpioCommandController",
        "gpios: [door], command_interfaces: {door: {interfaces: [position]}}",
    ),
    "forward_to_a_gpio": (
        "forward_command_controller/ForwardCommandController",
        "joints: [door2], interface_name: position",
    ),
}

GPIOS = "".join(
    f"<gpio name='{name}'><command_interface name='position'/>"
    "<state_interface name='position'/></gpio>"
    for name in ("door", "door2")
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of one simulation, in every format, streamed and saved."""
    folder = tmp_path_factory.mktemp("logs")
    urdf = models.TWO_LINKS.replace("</ros2_control>", f"{GPIOS}</ros2_control>")
    (folder / "robot.urdf").write_text(urdf)
    rows, sections = "", ""
    for name, (type_, parameters) in CONTROLLERS.items():
        rows += f"    {name}: {{type: {type_}}}\n"
        sections += f"{name}: {{ros__parameters: {{{parameters}}}}}\n"
    (folder / "controllers.yaml").write_text(
        "controller_manager:\n  ros__parameters:\n    update_rate: 100\n"
        "    arm: {type: joint_trajectory_controller/JointTrajectoryController}\n"
        f"{rows}arm: {{ros__parameters: {{joints: [shoulder], {INTERFACES}}}}}\n"
        f"{sections}"
    )
    robot = ad.load_robot(
        folder / "robot.urdf", controllers=[folder / "controllers.yaml"]
    )
    sim = ad.Simulation(ad.build_diagram(robot))
    with (
        sim.record_to(folder / "streamed.csv"),
        sim.record_to(folder / "streamed.mcap"),
    ):
        sim.run(0.05)
    for suffix in ("npz", "csv", "mcap"):
        sim.rollout().save(folder / f"saved.{suffix}")
    return folder


FILES = ("saved.npz", "saved.csv", "saved.mcap", "streamed.csv", "streamed.mcap")


@pytest.mark.parametrize("file", FILES)
def test_every_log_has_the_rows(folder: Path, file: str) -> None:
    expected = ad.Rollout.load(folder / "saved.npz")

    rollout = ad.Rollout.load(folder / file)

    assert len(rollout.time) > 1
    for name in ("time", "position", "velocity", "effort", "command", "active"):
        values, wanted = getattr(rollout, name), getattr(expected, name)
        np.testing.assert_array_equal(values, wanted)
    assert list(rollout.controllers) == ["arm", *CONTROLLERS]


@pytest.mark.parametrize("file", FILES)
def test_who_was_active_wanted_what_the_robot_has(folder: Path, file: str) -> None:
    rollout = ad.Rollout.load(folder / file)

    active = {
        name
        for name, column in zip(rollout.controllers, rollout.active.T, strict=True)
        if np.nanmax(column) > 0.0
    }
    assert active == {"arm", "of_a_gpio", "forward_to_a_gpio"}
    wanted = {
        name: reference.joint_names
        for name, reference in rollout.references.items()
        if np.isfinite(reference.position).any()
    }
    assert wanted == {"arm": ("shoulder",)}
    for reference in rollout.references.values():
        assert set(reference.joint_names) <= {"shoulder", "elbow"}
