"""What comes in on the ports of an AdmittanceController, and what follows from it."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import InputPort

from arm_drake.arrays import Array
from arm_drake.controllers.admittance_setup import (
    AdmittanceSetup,
    check_change,
    make_setup,
)
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.controllers.topics import (
    INACTIVE,
    Events,
    Rejection,
    add_events,
    new_messages,
    new_parameters,
)
from arm_drake.messages import (
    JointTrajectoryPoint,
    ParametersRejected,
    TopicRejected,
    WrenchStamped,
)


class AdmittancePorts(NamedTuple):
    """Input ports of an AdmittanceController."""

    joint_references: InputPort
    wrench_reference: InputPort
    parameters: InputPort


class AdmittanceInbox(NamedTuple):
    """What came in on the ports of an AdmittanceController."""

    # What the parameters in effect set, and those that were accepted last.
    setup: AdmittanceSetup
    accepted: AdmittanceSetup

    # What is added to the measured wrench [N], [N·m], shape (6,).
    wrench: Array

    # What was on the ports at the last tick.
    offered: object = ()
    references: tuple[JointTrajectoryPoint, ...] = ()
    wrenches: tuple[WrenchStamped, ...] = ()

    # The latest of all that was not accepted.
    events: Events = ()


def take_parameters(
    now: Now,
    ports: AdmittancePorts,
    inbox: AdmittanceInbox,
    params: ControllerInterfaceParams,
    *,
    is_running: bool,
) -> AdmittanceInbox:
    """Return what has come in, with new parameters if they may take effect.

    Args:
        now: The time, and where the inputs are read.
        ports: The inputs.
        inbox: What had come in before.
        params: Surroundings of the controller.
        is_running: Whether the controller is active and not just being activated.
    """
    accepted, events = inbox.accepted, inbox.events
    offered = new_parameters(ports.parameters, now.context, inbox.offered)
    if offered is not inbox.offered and offered != ():
        try:
            changed = check_change(accepted.parameters, offered)
            accepted = make_setup(changed, params.links)
        except ValueError as error:
            events = add_events(events, [ParametersRejected(str(error))])
    if offered is not inbox.offered:
        inbox = inbox._replace(accepted=accepted, offered=offered, events=events)
    in_effect = inbox.setup.parameters
    takes_changes = in_effect.enable_parameter_update_without_reactivation
    if inbox.setup is not accepted and (takes_changes or not is_running):
        inbox = inbox._replace(setup=accepted)
    return inbox


def receive(
    now: Now,
    ports: AdmittancePorts,
    inbox: AdmittanceInbox,
    params: ControllerInterfaceParams,
    obstacle: str = "",
) -> tuple[AdmittanceInbox, Array | None]:
    """Return what has come in, and references to take, shape (3, n), NaN where none.

    Args:
        now: The time, and where the inputs are read.
        ports: The inputs.
        inbox: What had come in at the last tick.
        params: Surroundings of the controller.
        obstacle: Why no references of the topic are taken; empty if they are.
    """
    context = now.context
    is_running = obstacle != INACTIVE
    inbox = take_parameters(now, ports, inbox, params, is_running=is_running)
    points, references = new_messages(
        ports.joint_references, context, JointTrajectoryPoint, inbox.references
    )
    wrenches, seen = new_messages(
        ports.wrench_reference, context, WrenchStamped, inbox.wrenches
    )
    if references is inbox.references and seen is inbox.wrenches:
        return inbox, None
    news: list[Rejection] = []
    joints, asked = inbox.setup.parameters.joints, None
    for point in points:
        fault = obstacle or _find_fault(point, joints)
        if fault:
            news.append(TopicRejected(point, fault))
            continue
        asked = np.full((3, len(joints)), np.nan) if asked is None else asked
        if point.positions:
            asked[0] = point.positions
        if point.velocities:
            asked[1] = point.velocities
    wrench = inbox.wrench
    for message in wrenches:
        values = _to_array(message)
        frame, sensor = message.header.frame_id, inbox.setup.sensor
        if frame not in ("", sensor):
            fault = f"header.frame_id must be {sensor!r}, the sensor's, got {frame!r}"
            news.append(TopicRejected(message, fault))
        elif not np.isfinite(values).all():
            news.append(TopicRejected(message, "wrench must be finite"))
        else:
            wrench = values
    events = add_events(inbox.events, news)
    inbox = inbox._replace(
        wrench=wrench, references=references, wrenches=seen, events=events
    )
    return inbox, asked


def _find_fault(point: JointTrajectoryPoint, joints: tuple[str, ...]) -> str:
    """Return why references can't be taken; empty if they can."""
    for name in ("positions", "velocities"):
        size = len(getattr(point, name))
        if size not in (0, len(joints)):
            return (
                f"{name} must have {len(joints)} elements ({', '.join(joints)}) or "
                f"none, got {size}"
            )
    return ""


def _to_array(message: WrenchStamped) -> Array:
    """Return force and torque along x, y and z, shape (6,)."""
    parts = (message.wrench.force, message.wrench.torque)
    return np.array([value for part in parts for value in (part.x, part.y, part.z)])
