"""Holds the commands of a robot's joints to their limits, once in a cycle.

What ros2_control's resource manager does where `enforce_command_limits` is on: with the
limits of `joint_limits` for each joint, on the command interfaces that are claimed.
Upstream limits a command when it is written, and once more at the end of the cycle;
both give the same, so it is done at the end.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from arm_drake.arrays import Array
from arm_drake.control.joint_limits import (
    NO_COMMAND,
    JointControlInterfacesData,
    PositionOutOfBoundsError,
    limit,
)
from arm_drake.description.joint_limits import JointLimits, SoftJointLimits

# What is remembered of a joint's commands, by its name.
Previous = Mapping[str, JointControlInterfacesData]


class LimitedCommands(NamedTuple):
    """What limiting the commands of a cycle leads to."""

    previous: Previous

    # Joints that a command would have led beyond a limit.
    limited: tuple[str, ...]

    # Joints that are so far outside their limits that they can't be commanded, and what
    # is the matter with them, in words.
    out_of_bounds: Mapping[str, str]


class CommandLimits:
    """The limits of a robot's joints, for the vector of its command values."""

    def __init__(
        self,
        limits: Mapping[str, tuple[JointLimits, SoftJointLimits | None]],
        order: Sequence[str],
        measured: Sequence[str],
    ) -> None:
        """Create it.

        Args:
            limits: Limits by joint; None is no soft limits.
            order: Names of the command values, such as "joint1/position".
            measured: Names of the measured quantities.
        """
        self._limits = limits
        self._order = {name: index for index, name in enumerate(order)}
        self._measured = {name: index for index, name in enumerate(measured)}

    def apply(
        self,
        claimed: Collection[str],
        values: Array,
        measured: Array,
        previous: Previous,
        dt: float,
    ) -> LimitedCommands:
        """Bring command values within the limits, in place.

        Args:
            claimed: Names of the command interfaces that are claimed.
            values: Command values, shape (k,).
            measured: Measured quantities.
            previous: What the last cycle returned; {} at first, and for joints that
                are switched to another interface.
            dt: Time since the last cycle [s].
        """
        remembered = dict(previous)
        limited: list[str] = []
        lost: dict[str, str] = {}
        for joint, (limits, soft_limits) in self._limits.items():
            fields = {
                name: at
                for name in JointControlInterfacesData._fields
                if (full := f"{joint}/{name}") in claimed
                and (at := self._order.get(full)) is not None
            }
            if not fields:
                continue
            state = JointControlInterfacesData(
                *(
                    float(measured[at])
                    if (at := self._measured.get(f"{joint}/{name}")) is not None
                    else None
                    for name in ("position", "velocity")
                )
            )
            desired = JointControlInterfacesData(
                **{name: float(values[at]) for name, at in fields.items()}
            )
            before = previous.get(joint, NO_COMMAND)
            try:
                new = limit(limits, soft_limits, before, state, desired, dt)
            except PositionOutOfBoundsError as error:
                remembered[joint] = error.previous
                lost[joint] = f"joint {joint!r}: {error}"
                continue
            remembered[joint] = new.previous
            if new.is_limited:
                limited.append(joint)
            for name, at in fields.items():
                values[at] = getattr(new.command, name)
        return LimitedCommands(remembered, tuple(limited), lost)
