"""The controller manager, as a system of the diagram."""

from collections.abc import Iterable

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, LeafSystem

from arm_drake.controller_loading import ControllerState, LoadedController
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot


class ControllerManager(LeafSystem):
    """Tells which controllers a robot has, and in which state they are.

    .. pydrake_system::

        name: ControllerManager
        output_ports:
        - controllers

    ===========  ====  ====  ========================================================
    port         size  unit  meaning
    ===========  ====  ====  ========================================================
    controllers  --    --    tuple of ControllerState, in the order of the YAML
    ===========  ====  ====  ========================================================

    It has no state: controllers keep the state in which the diagram was built.
    """

    def __init__(
        self,
        robot: Robot,
        controllers: Iterable[LoadedController],
        report: LoadReport,
        *,
        prefix: str,
        period: float,
        log_period: float,
        servo_plant: MultibodyPlant,
    ) -> None:
        """Create the system.

        Args:
            robot: The robot.
            controllers: Its controllers.
            report: Its load report, with what its controllers lack.
            prefix: Start of the names of the robot's ports and systems.
            period: Period of the manager in Drake's time [s].
            log_period: Period of the log of the joints' states [s].
            servo_plant: Plant that the servo computes with, to be kept as long as the
                diagram: Drake's InverseDynamics doesn't keep it.
        """
        super().__init__()
        self.robot = robot
        self.report = report
        self.controllers = tuple(controllers)
        self.prefix = prefix
        self.period = period
        self.log_period = log_period
        self._servo_plant = servo_plant
        rows = tuple(ControllerState(c.name, c.type, c.state) for c in self.controllers)

        def calc(context: Context, output: AbstractValue) -> None:
            del context
            output.set_value(rows)

        self.DeclareAbstractOutputPort(
            "controllers",
            lambda: AbstractValue.Make(()),
            calc,
            prerequisites_of_calc={self.nothing_ticket()},
        )
