"""The contact forces on a robot's links, as numbers for a log."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from arm_drake.messages.contacts import ContactsState
from arm_drake.python_system import PythonSystem

# Name of the log, after the prefix of its robot.
CONTACT_LOG = "contact_forces"


class ContactForces(PythonSystem):
    """Adds up the contact forces on each link.

    .. pydrake_system::

        name: ContactForces
        input_ports:
        - contacts
        output_ports:
        - force

    ========  ====  ====  ============================================================
    port      size  unit  meaning
    ========  ====  ====  ============================================================
    contacts  --    --    ContactsState: what touches the robot
    force     3L    [N]   total force on each link in the world, x, y, z
    ========  ====  ====  ============================================================

    It has no state.
    """

    def __init__(self, links: Sequence[str]) -> None:
        """Create the system.

        Args:
            links: Names of the L links.
        """
        super().__init__()
        self._rows = {link: row for row, link in enumerate(links)}
        nothing = AbstractValue.Make(ContactsState())
        self._contacts = self.DeclareAbstractInputPort("contacts", nothing)
        self.DeclareVectorOutputPort(
            "force",
            3 * len(links),
            self._calc_force,
            prerequisites_of_calc={self._contacts.ticket()},
        )

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        total = np.zeros((len(self._rows), 3))
        for state in self._contacts.Eval(context).states:
            # "<robot>::<link>::<shape>".
            link = state.collision1_name.split("::")[-2]
            if link in self._rows:
                force = state.total_wrench.force
                total[self._rows[link]] += (force.x, force.y, force.z)
        output.SetFromVector(total.ravel())
