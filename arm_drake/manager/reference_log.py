"""What trajectory controllers want of joints that they don't command positions of."""

from collections.abc import Iterable

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder
from pydrake.systems.primitives import VectorLogSink

from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.messages import JointTrajectoryControllerState
from arm_drake.python_system import PythonSystem

# Start of the names of the logs, after the prefix of their robot.
_LOG = "reference:"


class WantedPositions(PythonSystem):
    """Picks the positions that a trajectory controller wants out of its state.

    .. pydrake_system::

        name: WantedPositions
        input_ports:
        - controller_state
        output_ports:
        - position

    ================  ====  ============  ============================================
    port              size  unit          meaning
    ================  ====  ============  ============================================
    controller_state  --    --            JointTrajectoryControllerState
    position          n     [rad] or [m]  the reference's positions, in the order of
                                          the controller's joints; NaN if it has none
    ================  ====  ============  ============================================

    It has no state.
    """

    def __init__(self, num_joints: int) -> None:
        """Create the system.

        Args:
            num_joints: How many joints the controller has.
        """
        super().__init__()
        state = AbstractValue.Make(JointTrajectoryControllerState())
        self._told = self.DeclareAbstractInputPort("controller_state", state)
        self._unknown = np.full(num_joints, np.nan)
        self.DeclareVectorOutputPort(
            "position",
            num_joints,
            self._calc_position,
            prerequisites_of_calc={self._told.ticket()},
        )

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        wanted = self._told.Eval(context).reference.positions
        has_all = len(wanted) == len(self._unknown)
        output.SetFromVector(wanted if has_all else self._unknown)


def log_references(
    builder: DiagramBuilder,
    systems: Iterable[ControllerInterface],
    prefix: str,
    period: float,
) -> None:
    """Record what trajectory controllers want that command efforts or velocities.

    Of others it is what they command, which is recorded anyway.

    Args:
        builder: Where the controllers are.
        systems: The controllers.
        prefix: Start of the names of their robot's systems.
        period: Period of the log [s].
    """
    for system in systems:
        if joints := wanted_joints(system):
            name = f"{prefix}{log_name(system.params.controller_name)}"
            wanted = builder.AddNamedSystem(name, WantedPositions(len(joints)))
            told = system.GetOutputPort("controller_state")
            builder.Connect(told, wanted.GetInputPort("controller_state"))
            log = VectorLogSink(len(joints), period)
            builder.AddNamedSystem(
                f"{prefix}log:{log_name(system.params.controller_name)}", log
            )
            builder.Connect(wanted.get_output_port(), log.get_input_port())


def log_name(controller: str) -> str:
    """Return the name of the log of what a controller wants.

    Args:
        controller: Name of the controller.
    """
    return f"{_LOG}{controller}"


def wanted_joints(system: ControllerInterface | None) -> tuple[str, ...]:
    """Return the joints whose reference is recorded by itself, if any are.

    Args:
        system: A controller.
    """
    if not isinstance(system, JointTrajectoryController):
        return ()
    end = f"/{interfaces.POSITION}"
    if any(name.endswith(end) for name in system.command_interfaces):
        return ()
    states = system.state_interfaces
    return tuple(name.removesuffix(end) for name in states if name.endswith(end))
