"""The commands of a robot's joints, gathered from its controllers."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from arm_drake import interfaces


class CommandInterfaces(LeafSystem):
    """Gathers the position commands of a robot's joints from its controllers.

    .. pydrake_system::

        name: CommandInterfaces
        input_ports:
        - <controller>.command_interfaces
        output_ports:
        - command

    With n commanded joints, in the order of ``joints``:

    ===============================  ====  ==========  ================================
    port                             size  unit        meaning
    ===============================  ====  ==========  ================================
    <controller>.command_interfaces  2k    rad, rad/s  positions of the k joints that a
                                                       controller claims, and their
                                                       rates; NaN is no command
    command                          2n    rad, rad/s  desired positions and velocities
    ===============================  ====  ==========  ================================

    It has no state. A joint without a command holds its initial position.
    """

    def __init__(
        self,
        joints: Sequence[str],
        claims: Mapping[str, Sequence[str]],
        initial: np.ndarray,
        *,
        servo_plant: MultibodyPlant | None = None,
    ) -> None:
        """Create the system.

        Args:
            joints: The commanded joints.
            claims: Command interfaces of each active controller.
            initial: Initial positions [rad], shape (n,).
            servo_plant: Plant that the servo computes with, to be kept as long as the
                diagram: Drake's InverseDynamics doesn't keep it.
        """
        super().__init__()
        n = len(joints)
        self._servo_plant = servo_plant
        self._hold = np.concatenate([initial, np.zeros(n)])
        self._commands = []
        order = [f"{joint}/{interfaces.POSITION}" for joint in joints]
        for controller, claimed in claims.items():
            name = f"{controller}.{interfaces.COMMAND_PORT}"
            port = self.DeclareVectorInputPort(name, 2 * len(claimed))
            at = np.array([order.index(name) for name in claimed], dtype=int)
            self._commands.append((port, np.concatenate([at, n + at])))
        self.DeclareVectorOutputPort(
            "command",
            2 * n,
            self._calc_command,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        desired = self._hold.copy()
        for port, at in self._commands:
            command = port.Eval(context)
            # A sum is finite only if all of its terms are.
            if not math.isfinite(command.sum()):
                command = np.where(np.isfinite(command), command, desired[at])
            desired[at] = command
        output.SetFromVector(desired)
