"""Controllers that write command interfaces or can fail, and the joints they move."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.control.command_limits import Previous
from arm_drake.control.drive_mode import Mask
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.controllers.cycles import Cycle
from arm_drake.manager.ticks import Ticks


class _Claimant(NamedTuple):
    """A controller that writes command interfaces, or whose update can fail."""

    name: str

    # Where its commands stand among the values, shape (k,), and which joints of the
    # drive they are for, shape (n,).
    at: NDArray[np.intp]
    joints: Mask

    # All joints that they are for.
    names: frozenset[str]


class Claimants:
    """All controllers of a robot that write command interfaces or can fail."""

    def __init__(
        self,
        systems: Mapping[str, ControllerInterface],
        order: Sequence[str],
        joints: Sequence[str],
    ) -> None:
        """Create it.

        Args:
            systems: The controllers, by name.
            order: Names of the command values.
            joints: Joints of the drive, n of them.
        """
        self._joints = tuple(joints)
        at = {name: index for index, name in enumerate(order)}
        self._claimants = []
        for name, system in systems.items():
            claims = system.command_interfaces
            if claims or (isinstance(system, TickingController) and system.can_fail):
                claimed = {claim.rpartition("/")[0] for claim in claims}
                # One that claims what isn't there never becomes active.
                indices = [at.get(claim, 0) for claim in claims]
                claimant = _Claimant(
                    name,
                    np.array(indices, dtype=np.intp),
                    self._mask(claimed),
                    frozenset(claimed),
                )
                self._claimants.append(claimant)

    def write(
        self, ticks: Ticks, cycle: Cycle, last: Cycle, values: Array
    ) -> dict[str, str]:
        """Write what controllers command in a cycle; return those that failed.

        A controller that doesn't tick leaves what it wrote, which may be limited since.

        Args:
            ticks: What the controllers' ticks leave behind.
            cycle: The cycle.
            last: The one before; what a controller commands when it ends counts too.
            values: Command values, shape (k,), changed in place.

        Returns:
            Names of controllers whose update failed, and why.
        """
        failed = {}
        claimants: Iterable[_Claimant] = self._claimants
        if cycle.commands is not None:  # Those that end are first.
            claimants = sorted(claimants, key=lambda c: c.name in cycle.active)
        for name, at, _, _ in claimants:
            if name not in cycle.active and name not in last.active:
                continue
            if cycle.periods and cycle.periods.get(name) == 0:
                continue
            tick = ticks[name]
            command = tick.command
            # A sum is finite only if all its terms are; quicker than in numpy.
            if math.isfinite(sum(command.tolist())):
                values[at] = command
            else:
                written = np.isfinite(command)
                values[at[written]] = command[written]
            if not tick.is_ok:
                failed[name] = tick.fault
        return failed

    def restore(self, values: Array, before: Array, names: Collection[str]) -> None:
        """Undo what controllers have written.

        Args:
            values: Command values, shape (k,), changed in place.
            before: Command values before the cycle.
            names: The controllers.
        """
        for claimant in self._claimants:
            if claimant.name in names:
                values[claimant.at] = before[claimant.at]

    def owners(
        self, active: Collection[str], joints: Mapping[str, str]
    ) -> dict[str, str]:
        """Return the active controllers that command joints, and a joint's text.

        Args:
            active: Controllers that are active.
            joints: Texts by the names of joints.
        """
        return {
            claimant.name: text
            for claimant in self._claimants
            for joint, text in joints.items()
            if claimant.name in active and joint in claimant.names
        }

    def fresh(self, cycle: Cycle, last: Cycle) -> Mask:
        """Return the joints of the drive whose controller has just started."""
        fresh = self._mask(())
        for claimant in self._claimants:
            if cycle.active.get(claimant.name) != last.active.get(claimant.name):
                fresh |= claimant.joints
        return fresh

    def skipped(self, cycle: Cycle) -> Mask | None:
        """Return the joints of the drive whose controller doesn't tick, if any."""
        if not cycle.periods:
            return None
        skipped = self._mask(())
        for claimant in self._claimants:
            if cycle.periods.get(claimant.name) == 0:
                skipped |= claimant.joints
        return skipped

    def forget(self, previous: Previous, cycle: Cycle, last: Cycle) -> Previous:
        """Return what is remembered of joints that keep their controller.

        Args:
            previous: What is remembered, by joint.
            cycle: The cycle.
            last: The one before.
        """
        new = {
            joint
            for claimant in self._claimants
            if cycle.active.get(claimant.name) != last.active.get(claimant.name)
            for joint in claimant.names
        }
        return {j: data for j, data in previous.items() if j not in new}

    def _mask(self, joints: Collection[str]) -> Mask:
        return np.array([joint in joints for joint in self._joints], dtype=bool)
