"""The commands of a robot's joints, held from tick to tick."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from arm_drake import interfaces


class CommandInterfaces(LeafSystem):
    """Holds the position commands of a robot's joints from tick to tick.

    .. pydrake_system::

        name: CommandInterfaces
        input_ports:
        - position_state
        - <controller>.position_command
        output_ports:
        - command

    With n commanded joints, in the order of ``joints``:

    =============================  ====  ==========  ==================================
    port                           size  unit        meaning
    =============================  ====  ==========  ==================================
    position_state                 n     rad         measured positions
    <controller>.position_command  k     rad         what a controller commands to the
                                                     k joints that it claims, at its
                                                     tick; NaN for no command
    command                        2n    rad, rad/s  commanded positions, and the
                                                     velocities that go with them
    =============================  ====  ==========  ==================================

    The discrete state is (q_d, v_d, q_p): the command, its velocity and the position
    claimed at the last tick, each of size n. Every ``period``, with c the commands::

        q_d[+] = c,  v_d[+] = (c - q_p) / period,  q_p[+] = c

    v_d is zero where nothing was claimed before. A joint that nobody claims holds the
    position that it had at the first tick.
    """

    def __init__(
        self,
        joints: Sequence[str],
        claims: Mapping[str, Sequence[str]],
        initial: np.ndarray,
        period: float,
        *,
        servo_plant: MultibodyPlant | None = None,
    ) -> None:
        """Create the system.

        Args:
            joints: The commanded joints.
            claims: Joints whose position each active controller commands.
            initial: Positions to hold before the first tick [rad], shape (n,).
            period: Period of the controller manager [s].
            servo_plant: Plant that the servo computes with, to be kept as long as the
                diagram: Drake's InverseDynamics doesn't keep it.
        """
        super().__init__()
        self._servo_plant = servo_plant
        n = len(joints)
        self._n = n
        self._period = period
        order = list(joints)
        self._is_claimed = np.zeros(n, dtype=bool)
        self._q = self.DeclareVectorInputPort(interfaces.state_port("position"), n)
        self._commands = []
        for controller, claimed in claims.items():
            name = f"{controller}.{interfaces.command_port('position')}"
            port = self.DeclareVectorInputPort(name, len(claimed))
            at = np.array([order.index(joint) for joint in claimed], dtype=int)
            self._is_claimed[at] = True
            self._commands.append((port, at))
        nothing = np.full(n, math.nan)
        self.DeclareDiscreteState(np.concatenate([initial, np.zeros(n), nothing]))
        # An unrestricted update is over before the plant's step of the same instant.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update_command)
        self.DeclareVectorOutputPort(
            "command",
            2 * n,
            self._calc_command,
            prerequisites_of_calc={self.xd_ticket()},
        )

    def _update_command(self, context: Context, state: State) -> None:
        n = self._n
        x = context.get_discrete_state_vector().value()
        new = x.copy()
        q_d, v_d, q_p = new[:n], new[n : 2 * n], new[2 * n :]
        if context.get_time() == 0.0:
            q_d[:] = self._q.Eval(context)
        for port, at in self._commands:
            command = port.Eval(context)
            is_command = np.isfinite(command)
            if not is_command.all():
                command, at = command[is_command], at[is_command]
            velocity = (command - q_p[at]) / self._period
            velocity[np.isnan(velocity)] = 0.0
            q_d[at] = q_p[at] = command
            v_d[at] = velocity
        state.get_mutable_discrete_state(0).set_value(new)

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        x = context.get_discrete_state_vector().value()
        output.SetFromVector(x[: 2 * self._n])
