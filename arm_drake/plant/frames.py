"""Poses of a robot's links, as an output of the diagram."""

from collections.abc import Sequence

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from arm_drake.python_system import PythonSystem


class LinkFrames(PythonSystem):
    """Picks the poses of a robot's links out of those of all bodies.

    .. pydrake_system::

        name: LinkFrames
        input_ports:
        - body_poses
        output_ports:
        - frames

    ==========  ====  ====  =========================================================
    port        size  unit  meaning
    ==========  ====  ====  =========================================================
    body_poses  --    --    list of RigidTransform: pose of every body in the world
    frames      --    --    list of RigidTransform: pose of each link in the world, in
                            the order of the description
    ==========  ====  ====  =========================================================

    It has no state.
    """

    def __init__(self, bodies: Sequence[int]) -> None:
        """Create the system.

        Args:
            bodies: Index of the body of each link.
        """
        super().__init__()
        self._bodies = tuple(bodies)
        poses = AbstractValue.Make([RigidTransform()])
        self._poses = self.DeclareAbstractInputPort("body_poses", poses)
        self.DeclareAbstractOutputPort(
            "frames",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc_frames,
            prerequisites_of_calc={self._poses.ticket()},
        )

    def _calc_frames(self, context: Context, output: AbstractValue) -> None:
        poses = self._poses.Eval(context)
        output.set_value([poses[body] for body in self._bodies])
