"""Forces of Gazebo's joint plugins, as efforts of the joints that carry them.

Gazebo pushes every joint by itself, a mimic joint too. Here a mimic joint follows its
master rigidly and has no drive of its own, so the force at it acts on the master. With
dq_follower = m dq_master, both do the same work if the master's effort is m times the
force (virtual work).
"""

import dataclasses as dc
import math
from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from arm_drake.arrays import Array
from arm_drake.messages import Message

Indices = NDArray[np.intp]


@dc.dataclass(frozen=True, eq=False)
class JointForces(Message):
    """Where n forces act; made by `from_joints`."""

    # Joints that carry them, k of them.
    joints: tuple[str, ...]

    # Of each place where one acts: index of the force, largest absolute value [N·m] or
    # [N], how far the place moves per unit of the joint that carries it, and that
    # joint's index.
    _force: Indices
    _limit: Array
    _multiplier: Array
    _joint: Indices

    @classmethod
    def from_joints(
        cls,
        forces: Mapping[str, int],
        followed: Mapping[str, tuple[str, float]],
        effort_limits: Mapping[str, float],
    ) -> Self:
        """Return where forces act.

        Args:
            forces: Index of the force at each joint.
            followed: Of each mimic joint, its master and how far it moves per unit.
            effort_limits: Largest effort of joints [N·m] or [N]; others have none.
        """
        carriers = [followed.get(joint, (joint, 1.0)) for joint in forces]
        joints = tuple(dict.fromkeys(name for name, _ in carriers))
        return cls(
            joints,
            np.array(list(forces.values()), dtype=np.intp),
            np.array([effort_limits.get(joint, math.inf) for joint in forces]),
            np.array([multiplier for _, multiplier in carriers]),
            np.array([joints.index(name) for name, _ in carriers], dtype=np.intp),
        )

    def to_efforts(self, forces: Array) -> Array:
        """Return the efforts of `joints`, shape (k,).

        Each force is limited to the effort limit of the joint at which it acts.

        Args:
            forces: The forces [N·m] or [N], shape (n,).
        """
        here = forces[self._force]
        limited = np.minimum(np.maximum(here, -self._limit), self._limit)
        # It adds in the order of the places, on every machine.
        efforts: Array = np.zeros(len(self.joints))
        np.add.at(efforts, self._joint, self._multiplier * limited)
        return efforts
