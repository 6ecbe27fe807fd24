"""Which of the claimed command interfaces a drive acts on, see `drive_commands`."""

import dataclasses as dc
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.messages import Message

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dc.dataclass(frozen=True, eq=False)
class DriveMode(Message):
    """Which commands the n joints follow."""

    # Exactly one of these holds for a joint that is commanded. Shape (n,).
    is_position: Mask
    is_velocity: Mask
    is_acceleration: Mask
    is_effort: Mask

    # Whether a joint that follows a position is told its velocity too, an acceleration,
    # an effort. Shape (n,).
    is_guided: Mask
    is_accelerated: Mask
    is_pushed: Mask

    # Joints that nobody commands and that are left to swing, shape (n,).
    is_idle: Mask

    # Where the commands stand among the values; 0 where there is none. Shape (n,).
    position_at: Indices
    velocity_at: Indices
    acceleration_at: Indices
    effort_at: Indices

    # Where the limits of effort and of velocity stand; -1 where there is none. Shape
    # (n,) each.
    effort_limit_at: Indices
    velocity_limit_at: Indices

    # Rate of the controller that commands the joint [Hz], shape (n,).
    rate: Array

    # Whether all joints follow positions and nothing else is claimed.
    is_plain: bool

    # Of each joint: where its position stands among the values, and its rate [Hz]. What
    # is few is quicker in plain numbers than in numpy.
    positions: tuple[tuple[int, float], ...] = dc.field(init=False)

    def __post_init__(self) -> None:
        """Prepare what every cycle reads."""
        at = zip(self.position_at.tolist(), self.rate.tolist(), strict=True)
        object.__setattr__(self, "positions", tuple(at))


def is_outdone(name: str, claims: Collection[str]) -> bool:
    """Return whether a drive does not act on a command, for it follows another one.

    Args:
        name: A claimed command interface, such as "joint1/effort".
        claims: All claimed command interfaces.
    """
    joint, _, interface = name.rpartition("/")
    if f"{joint}/{interfaces.POSITION}" in claims:
        return False  # To what a position asks for, all else is added.
    stronger = {
        interfaces.ACCELERATION: (interfaces.VELOCITY,),
        interfaces.EFFORT: (interfaces.VELOCITY, interfaces.ACCELERATION),
    }
    return any(f"{joint}/{other}" in claims for other in stronger.get(interface, ()))
