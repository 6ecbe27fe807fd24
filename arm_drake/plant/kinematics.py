"""Where the links of a robot are, for controllers that ask: a plant without physics."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from arm_drake.arrays import Array
from arm_drake.description.joints import MOVABLE_TYPES, WORLD, JointInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.plant.plant import add_robot_model, set_initial_positions, state_indices


class PlantKinematics:
    """Poses and Jacobians of a robot's links, seen from one of them.

    Joints that aren't asked for, mimic joints too, stay at their initial positions. Its
    plant holds nothing between two calls.
    """

    def __init__(
        self,
        description: RobotDescription,
        initial_positions: Mapping[str, float],
        joints: Sequence[str],
        base: str,
    ) -> None:
        """Create it.

        Args:
            description: The robot.
            initial_positions: Initial positions by joint [rad] or [m].
            joints: Joints that move, n of them.
            base: Link that everything is seen from.

        Raises:
            DescriptionError: If Drake refuses the description.
        """
        self._description = description
        self._plant = plant = MultibodyPlant(0.0)
        model = add_robot_model(plant, description, "robot", None, is_reduced=True)
        plant.Finalize()
        set_initial_positions(plant, model, dict(initial_positions))
        self._frames = {
            link: plant.world_frame()
            if link == WORLD
            else plant.GetBodyByName(link, model).body_frame()
            for link in description.links
        }
        self._name, self._base = base, self._frames[base]
        self._context = plant.CreateDefaultContext()
        # Nothing but the robot is in the plant, whose positions are those of its model.
        self._q = plant.GetPositions(self._context)
        self._q_at, v_at = state_indices(plant, model, joints)
        self._v_at = [at - plant.num_positions() for at in v_at]

    def pose(self, q: Array, link: str) -> Array:
        """Return the pose of a link in the base, shape (4, 4).

        Args:
            q: Positions of the joints [rad] or [m], shape (n,).
            link: Name of the link.
        """
        self._set(q)
        pose = self._frames[link].CalcPose(self._context, self._base)
        return np.asarray(pose.GetAsMatrix4())

    def jacobian(self, q: Array, link: str) -> Array:
        """Return what joint velocities move a link by, in the base, shape (6, n).

        Rows are the velocity along x, y and z [m/s], then about them [rad/s].

        Args:
            q: Positions of the joints [rad] or [m], shape (n,).
            link: Name of the link.
        """
        self._set(q)
        J = self._plant.CalcJacobianSpatialVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._frames[link],
            np.zeros(3),
            self._base,
            self._base,
        )
        return np.roll(J, 3, axis=0)[:, self._v_at]

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Return the movable joints between the base and a link, in that order.

        Args:
            link: Name of the link.
        """
        up, down = self._joints_above(self._name), self._joints_above(link)
        while up and down and up[-1] == down[-1]:
            up.pop()
            down.pop()
        path = (*up, *reversed(down))
        return tuple(joint.name for joint in path if joint.type in MOVABLE_TYPES)

    def _joints_above(self, link: str) -> list[JointInfo]:
        """Return the joints from a link to its root."""
        parents = {joint.child: joint for joint in self._description.joints}
        path = []
        while (joint := parents.get(link)) is not None:
            path.append(joint)
            link = joint.parent
        return path

    def _set(self, q: Array) -> None:
        positions = self._q.copy()
        positions[self._q_at] = q
        self._plant.SetPositions(self._context, positions)
