"""What a person sends to controllers: sliders and buttons, and the same as methods."""

from typing import TYPE_CHECKING

from arm_drake.description.gazebo_joints import JointController, JointPositionController
from arm_drake.errors import InputError
from arm_drake.messages import (
    DynamicInterfaceGroupValues,
    JointTrajectory,
    JointTrajectoryPoint,
)
from arm_drake.simulation.controller_topics import COMMANDS, TOPIC, ControllerTopics
from arm_drake.visualization.page.base_remote import BaseRemote, find_velocity_port
from arm_drake.visualization.page.command_remote import (
    AdmittanceRemote,
    CommandRemote,
    ForwardRemote,
    GpioRemote,
    TopicRemote,
)
from arm_drake.visualization.page.gripper_remote import GripperRemote
from arm_drake.visualization.page.remote import Remote, find_plugins
from arm_drake.visualization.page.trajectory_remote import TrajectoryRemote

if TYPE_CHECKING:
    from arm_drake.simulation.simulation import Simulation

__all__ = [
    "AdmittanceRemote",
    "BaseRemote",
    "CommandRemote",
    "ForwardRemote",
    "GpioRemote",
    "GripperRemote",
    "Remote",
    "TopicRemote",
    "TrajectoryRemote",
    "find_remotes",
]


def find_remotes(simulation: "Simulation") -> list[Remote]:
    """Return what a person can command, one for each controller that takes commands.

    They are found by what a controller takes, not by its type: active or not, but none
    that could not be loaded. What publishes alone has none.

    Args:
        simulation: Where the controllers are; those of the list, in its order.
    """
    remotes = (
        _make_remote(simulation, row.name)
        for row in simulation.list_controllers()
        if row.state != "unconfigured"
    )
    return [remote for remote in remotes if remote is not None]


def _make_remote(simulation: "Simulation", name: str) -> Remote | None:
    manager, loaded, system = simulation.directory.find(name)
    if not system.command_interfaces:
        return None
    types = getattr(system, "message_types", {})
    if system.HasInputPort("gripper_cmd"):
        return GripperRemote(simulation, name)
    if system.HasInputPort(TOPIC) or JointTrajectory in types.values():
        return TrajectoryRemote(simulation, name)
    plugins = find_plugins(manager, loaded.name)
    if any(
        isinstance(tag, JointPositionController | JointController) for tag in plugins
    ):
        return TopicRemote(simulation, name)
    if find_velocity_port(system) is not None:
        return BaseRemote(simulation, name)
    if types.get(COMMANDS) is DynamicInterfaceGroupValues:
        return GpioRemote(simulation, name)
    if types.get("joint_references") is JointTrajectoryPoint:
        return AdmittanceRemote(simulation, name)
    try:
        zeros = [0.0] * len(system.command_interfaces)
        ControllerTopics(name, loaded.type, system).make_command(zeros)
    except InputError:
        return None
    return ForwardRemote(simulation, name)
