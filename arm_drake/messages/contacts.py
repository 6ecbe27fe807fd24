"""What contact sensors feel (`gazebo_msgs`)."""

import dataclasses as dc
from typing import Final

from arm_drake.messages.base import Header, Message
from arm_drake.messages.geometry import Vector3, Wrench

_NOTHING: Final = Wrench()


@dc.dataclass(frozen=True)
class ContactState(Message):
    """Where two shapes touch, and with which forces on the first one."""

    # In words.
    info: str = ""

    # "<robot>::<link>::<shape>" of both.
    collision1_name: str = ""
    collision2_name: str = ""

    # On the first shape at each point, about that point, and their sum about the first
    # shape's link [N], [N·m].
    wrenches: tuple[Wrench, ...] = ()
    total_wrench: Wrench = _NOTHING

    # The points [m]; the direction in which the first shape is pressed; how deep the
    # shapes are in each other [m].
    contact_positions: tuple[Vector3, ...] = ()
    contact_normals: tuple[Vector3, ...] = ()
    depths: tuple[float, ...] = ()


@dc.dataclass(frozen=True)
class ContactsState(Message):
    """All contacts of a sensor; none while nothing touches."""

    header: Header = Header()
    states: tuple[ContactState, ...] = ()
