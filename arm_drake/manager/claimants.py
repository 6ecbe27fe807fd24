"""Claimants: the controllers that write command interfaces, and where they write."""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array, Indices, Mask
from arm_drake.control.joint_limits import Previous
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle, UpdateResult

# What each controller's last tick left behind, by its name.
UpdateResults = Mapping[str, UpdateResult[Any]]


class _Claimant(NamedTuple):
    """A controller that writes command interfaces, or whose update can fail."""

    name: str

    # Where its commands stand among the values, shape (k,), and which joints of the
    # drive they are for, shape (n,).
    at: Indices
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
        """Create it for controllers, names of values, and the drive's n joints."""
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
        # Where the commands of each stand among the values.
        self.places = {c.name: tuple(c.at.tolist()) for c in self._claimants}
        # What steady ticks remember, and where it stands.
        self._remembering = {
            name: system
            for name, system in systems.items()
            if isinstance(system, TickingController) and system.num_remembered
        }
        sizes = [system.num_remembered for system in self._remembering.values()]
        ends = list(itertools.accumulate(sizes, initial=0))
        self.num_remembered = ends.pop()
        self.parts = {
            name: slice(start, start + size)
            for name, start, size in zip(self._remembering, ends, sizes, strict=True)
        }

    def remember(self, ticks: UpdateResults) -> list[float]:
        """Return what steady ticks remember of those in full, of all controllers."""
        return [
            number
            for name, system in self._remembering.items()
            for number in system.remember(ticks[name].state)
        ]

    def write(
        self, ticks: UpdateResults, cycle: Cycle, last: Cycle, values: Array
    ) -> dict[str, str]:
        """Write what controllers command in a cycle; return those that failed, and why.

        A controller that doesn't tick leaves what it wrote, which may be limited since.
        What one commands when it ends in the `last` cycle counts too. `values`, shape
        (k,), are changed in place.
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
            result = ticks[name]
            command = result.command
            # A sum is finite only if all its terms are; quicker than in numpy.
            if math.isfinite(sum(command.tolist())):
                values[at] = command
            else:
                written = np.isfinite(command)
                values[at[written]] = command[written]
            if not result.is_ok:
                failed[name] = result.fault
        return failed

    def restore(self, values: Array, before: Array, names: Collection[str]) -> None:
        """Undo in `values`, shape (k,), what controllers wrote since `before`."""
        for claimant in self._claimants:
            if claimant.name in names:
                values[claimant.at] = before[claimant.at]

    def owners(
        self, active: Collection[str], joints: Mapping[str, str]
    ) -> dict[str, str]:
        """Return the active controllers that command joints, and a joint's text."""
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

    def skipped(self, cycle: Cycle) -> Mask:
        """Return the joints of the drive whose controller doesn't tick."""
        skipped = self._mask(())
        for claimant in self._claimants:
            if cycle.periods.get(claimant.name) == 0:
                skipped |= claimant.joints
        return skipped

    def forget(self, previous: Previous, cycle: Cycle, last: Cycle) -> Previous:
        """Return what is remembered, by joint, of those that keep their controller."""
        new = {
            joint
            for claimant in self._claimants
            if cycle.active.get(claimant.name) != last.active.get(claimant.name)
            for joint in claimant.names
        }
        return {j: data for j, data in previous.items() if j not in new}

    def _mask(self, joints: Collection[str]) -> Mask:
        return np.array([joint in joints for joint in self._joints], dtype=bool)
