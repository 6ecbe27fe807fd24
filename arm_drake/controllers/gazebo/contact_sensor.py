"""Gazebo's contact sensors ("bumpers")."""

import dataclasses as dc

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.gazebo.plugin import contact_topic
from arm_drake.description.gazebo_plugins import ContactSensorTag
from arm_drake.messages import Header, Vector3, Wrench
from arm_drake.messages.sensors import ContactsState, ContactState


class ContactSensor(ControllerInterface):
    """Publishes what touches some shapes of a robot.

    .. pydrake_system::

        name: ContactSensor
        input_ports:
        - controller_manager
        - state_interfaces
        - contacts
        - link_frames
        output_ports:
        - /<topic>

    ==================  ====  ==========================================================
    port                size  meaning
    ==================  ====  ==========================================================
    controller_manager  --    Cycle: whether the sensor is active
    state_interfaces    2J    positions and velocities of all joints, or more; not read
    contacts            --    ContactsState: what touches the robot, in the world's
                              frame; without physics not connected
    link_frames         --    poses of the robot's links in the world, in the order of
                              the description; there only where the tag names a frame
    /<topic>            --    ContactsState: the contacts of the sensor's own shapes,
                              forces on these; empty while nothing touches, and while
                              the sensor is inactive
    ==================  ====  ==========================================================

    It has no state: whenever it is asked it tells what touches then. In Gazebo it
    publishes at the ``update_rate`` of its tag.
    """

    def __init__(
        self, tag: ContactSensorTag, params: ControllerInterfaceParams
    ) -> None:
        """Create the system."""
        super().__init__(params)
        self._shapes = {f"{params.robot_name}::{shape}" for shape in tag.shapes}
        self._frame = tag.frame
        self._contacts = self.DeclareAbstractInputPort(
            interfaces.CONTACTS_PORT, AbstractValue.Make(ContactsState())
        )
        if tag.frame:
            self._link = params.links.index(tag.frame)
            poses = AbstractValue.Make([RigidTransform()])
            self._links = self.DeclareAbstractInputPort(interfaces.FRAMES_PORT, poses)
        self.DeclareAbstractOutputPort(
            contact_topic(tag, params.robot_name, params.world_name),
            lambda: AbstractValue.Make(ContactsState()),
            self._calc_contacts,
            # Time and input ports, for there is no state.
            prerequisites_of_calc={self.all_sources_ticket()},
        )

    def _calc_contacts(self, context: Context, output: AbstractValue) -> None:
        message = ContactsState()
        if self._contacts.HasValue(context) and self._is_active(context):
            message = self._contacts.Eval(context)
            states = [s for s in message.states if s.collision1_name in self._shapes]
            header = message.header
            if self._frame:
                X_FW = self._links.Eval(context)[self._link].inverse()
                states = [_in_frame(state, X_FW) for state in states]
                header = Header(header.stamp, self._frame)
            message = ContactsState(header, tuple(states))
        output.set_value(message)


def _in_frame(state: ContactState, X_FW: RigidTransform) -> ContactState:
    """Return a contact in another frame than the world's."""
    R_FW = X_FW.rotation()
    return dc.replace(
        state,
        wrenches=tuple(_turned(wrench, R_FW) for wrench in state.wrenches),
        total_wrench=_turned(state.total_wrench, R_FW),
        contact_positions=tuple(
            Vector3(*(X_FW @ [p.x, p.y, p.z]).tolist()) for p in state.contact_positions
        ),
        contact_normals=tuple(_turned_vector(n, R_FW) for n in state.contact_normals),
    )


def _turned(wrench: Wrench, R_FW: RotationMatrix) -> Wrench:
    force, torque = wrench.force, wrench.torque
    return Wrench(_turned_vector(force, R_FW), _turned_vector(torque, R_FW))


def _turned_vector(vector: Vector3, R_FW: RotationMatrix) -> Vector3:
    return Vector3(*(R_FW @ [vector.x, vector.y, vector.z]).tolist())
