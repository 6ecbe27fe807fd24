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
        - state
        - <controller>.command_interfaces
        output_ports:
        - command

    With n commanded joints, in the order of ``joints``:

    ===============================  ====  ==========  ================================
    port                             size  unit        meaning
    ===============================  ====  ==========  ================================
    state                            m     rad, rad/s  state [q; v] of the robot
    <controller>.command_interfaces  k     rad         positions that a controller
                                                       commands at its tick; NaN is no
                                                       command
    command                          2n    rad, rad/s  commanded positions, and the
                                                       velocities that go with them
    ===============================  ====  ==========  ================================

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
        num_states: int,
        positions_at: Sequence[int],
        servo_plant: MultibodyPlant | None = None,
    ) -> None:
        """Create the system.

        Args:
            joints: The commanded joints.
            claims: Command interfaces of each active controller.
            initial: Positions to hold before the first tick [rad], shape (n,).
            period: Period of the controller manager [s].
            num_states: Size of the robot's state, m.
            positions_at: Indices of the joints' positions in the state, n of them.
            servo_plant: Plant that the servo computes with, to be kept as long as the
                diagram: Drake's InverseDynamics doesn't keep it.
        """
        super().__init__()
        n = len(joints)
        self._n = n
        self._period = period
        self._servo_plant = servo_plant
        self._positions_at = list(positions_at)
        self._state = self.DeclareVectorInputPort("state", num_states)
        self._commands = []
        for controller, claimed in claims.items():
            name = f"{controller}.{interfaces.COMMAND_PORT}"
            port = self.DeclareVectorInputPort(name, len(claimed))
            order = [f"{joint}/{interfaces.POSITION}" for joint in joints]
            at = np.array([order.index(name) for name in claimed], dtype=int)
            is_all = np.array_equal(at, np.arange(n))
            self._commands.append((port, slice(None) if is_all else at))
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
        x = context.get_discrete_state_vector().value().reshape(3, self._n)
        new = x.copy()
        q_d, v_d, q_p = new
        if context.get_time() == 0.0:
            q_d[:] = self._state.Eval(context)[self._positions_at]
        for port, at in self._commands:
            command = port.Eval(context)
            velocity = (command - q_p[at]) / self._period
            # A sum is finite only if all of its terms are.
            if math.isfinite(velocity.sum()):
                q_d[at] = q_p[at] = command
                v_d[at] = velocity
                continue
            is_command = np.isfinite(command)
            q_d[at] = np.where(is_command, command, q_d[at])
            q_p[at] = np.where(is_command, command, q_p[at])
            v_d[at] = np.where(np.isfinite(velocity), velocity, 0.0)
        state.get_mutable_discrete_state(0).set_value(new.ravel())

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        x = context.get_discrete_state_vector().value()
        output.SetFromVector(x[: 2 * self._n])
