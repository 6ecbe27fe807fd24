"""The controller manager: the read-update-write loop, as a system of the diagram."""

from collections.abc import Callable, Iterable

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    LeafSystem,
    State,
)

from arm_drake import interfaces
from arm_drake.control.command_limits import CommandLimits
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.controllers.cycles import Cycle, messages_on
from arm_drake.controllers.ticking_controller import TickingController
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.loaded_controllers import (
    ControllerState,
    LoadedController,
    command_order,
    controller_infos,
)
from arm_drake.manager.claims import Claimants
from arm_drake.manager.lifecycle import Lifecycle
from arm_drake.manager.loop import (
    Loop,
    Readings,
    StoredStates,
    initial_values,
)
from arm_drake.manager.state import ManagerState
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.surroundings import Surroundings
from arm_drake.timing import cycle_at, has_rate

# Name of the manager, and of its port on which a switch is requested.
MANAGER = "controller_manager"
SWITCH_PORT = "switch_controller"

# And of the one with the values that the physics doesn't know.
STORED_PORT = "stored_state_interfaces"


class ControllerManager(LeafSystem):
    """Tells controllers when to run, and hands their commands to the hardware.

    .. pydrake_system::

        name: ControllerManager
        input_ports:
        - switch_controller
        - state_interfaces
        output_ports:
        - cycle
        - controllers
        - events
        - claimed
        - command_values
        - drive
        - active

    =================  ====  =======  ==================================================
    port               size  unit     meaning
    =================  ====  =======  ==================================================
    switch_controller  --    --       SwitchController: what to activate, deactivate
    state_interfaces   3J    rad, ..  positions, velocities, efforts of the J joints
    cycle              --    --       Cycle: what controllers are told
    controllers        --    --       tuple of ControllerState, in the order of the YAML
    events             --    --       tuple of the latest (number, event), the newest
                                      last
    claimed            --    --       tuple of the names of command interfaces, those
                                      that were claimed last at the end
    command_values     k     rad, ..  values of all command interfaces
    drive              7n    rad, ..  what the servo of n joints is told, see
                                      DriveCommands
    active             c     --       1 for each controller that is active, else 0
    =================  ====  =======  ==================================================

    Further input ports, `command_interfaces:<controller>`, are what they command.

    At every cycle a controller's commands are taken from its tick, so that they act on
    the very step of the plant that starts with the cycle. A controller whose update
    fails is deactivated, its chain with it, and its fallback controllers start in the
    next cycle.
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
        drive: DriveCommands,
        surroundings: Surroundings,
        limits: CommandLimits | None = None,
        keep: object = None,
    ) -> None:
        """Create the system.

        Args:
            robot: The robot.
            controllers: Its controllers.
            report: Its load report, with what its controllers lack.
            prefix: Start of the names of the robot's ports and systems.
            period: Period of the manager in Drake's time [s].
            log_period: Period of the log of the joints' states [s].
            drive: What makes the servo's input of commands.
            surroundings: Interfaces of the robot.
            limits: What commands are held to, if they are.
            keep: What must live as long as the diagram: Drake's InverseDynamics doesn't
                keep the plant that it computes with.
        """
        super().__init__()
        self.robot = robot
        self.report = report
        self.controllers = tuple(controllers)
        self.prefix = prefix
        self.period = period
        self.log_period = log_period
        self.commands = command_order(surroundings, self.controllers)
        self._keep = keep
        self._update_rate = robot.controllers.update_rate
        systems = {c.name: c.system for c in self.controllers if c.system is not None}
        self._lifecycle = Lifecycle(
            controller_infos(self.controllers),
            {name: system.params.update_rate for name, system in systems.items()},
            {
                c.name: c.fallback_controllers
                for c in robot.controllers.controllers
                if c.name in systems
            },
            drive,
            update_rate=self._update_rate,
            distro=robot.distro,
            refuse=surroundings.refuse,
        )

        self._switch = self.DeclareAbstractInputPort(
            SWITCH_PORT, AbstractValue.Make(())
        )
        num_measured = 3 * len(surroundings.joint_types)
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        claimants = Claimants(
            systems,
            self.commands,
            drive.joints,
            lambda name: self.DeclareAbstractInputPort(
                f"{interfaces.COMMAND_PORT}:{name}", AbstractValue.Make(())
            ),
        )
        self._claimants = claimants
        self._loop = Loop(self._lifecycle, claimants, drive, limits, surroundings)
        initial = surroundings.initial_positions
        values = np.array(initial_values(self.commands, drive.joints, initial))
        hold = drive.initial([initial[joint] for joint in drive.joints])
        started = [c.name for c in self.controllers if c.state == "active"]
        state = self._lifecycle.start(started, values, hold)
        self._state_index = int(self.DeclareAbstractState(AbstractValue.Make(state)))
        self._cycle = self.DeclareAbstractOutputPort(
            "cycle",
            lambda: AbstractValue.Make(()),
            self._calc_cycle,
            prerequisites_of_calc={
                self.time_ticket(),
                self.xa_ticket(),
                self.input_port_ticket(self._switch.get_index()),
                self.input_port_ticket(self._measured.get_index()),
            },
        )
        flags = [float(c.name in state.active) for c in self.controllers]
        self._drive = drive
        told = drive.told(hold)
        states = [self.DeclareDiscreteState(x) for x in (values, told, flags)]
        self._values, self._drive_state, self._flags = map(int, states)
        self._stored = None
        if surroundings.stored:
            self._stored_states = StoredStates(surroundings, self.commands)
            self._stored = self.DeclareDiscreteState(list(surroundings.stored.values()))
            self.DeclareStateOutputPort(STORED_PORT, self._stored)
        self._declare("controllers", self._rows)
        self._declare("events", lambda state: state.events)
        self._declare(
            interfaces.CLAIMED_PORT,
            lambda state: self._lifecycle.claimed(state.active),
        )
        names = (interfaces.VALUES_PORT, "drive", "active")
        for name, index in zip(names, states, strict=True):
            self.DeclareStateOutputPort(name, index)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def find_problems(
        self, context: Context, request: SwitchController
    ) -> tuple[str, ...]:
        """Return why a request can't be met in full, as things are.

        Args:
            context: Context of the diagram.
            request: What to activate and deactivate.
        """
        active = self._state(self.GetMyContextFromRoot(context)).active
        return self._lifecycle.judge(active, request).problems

    def add_controller(
        self, builder: DiagramBuilder, system: ControllerInterface
    ) -> None:
        """Connect a controller that is in the builder with this manager.

        Args:
            builder: Where both are.
            system: The controller, one of those that this manager has.
        """
        told = system.GetInputPort(interfaces.MANAGER_PORT)
        builder.Connect(self._cycle, told)
        if isinstance(system, TickingController):
            values = self.GetOutputPort(interfaces.VALUES_PORT)
            builder.Connect(values, system.add_command_values(self.commands))
            port = self._claimants.port(system.params.controller_name)
            if port is not None:
                builder.Connect(system.GetOutputPort(interfaces.COMMAND_PORT), port)

    def _state(self, context: Context) -> ManagerState:
        state: ManagerState = context.get_abstract_state(self._state_index).get_value()
        return state

    def _rows(self, state: ManagerState) -> tuple[ControllerState, ...]:
        return tuple(
            ControllerState(
                c.name,
                c.type,
                "unconfigured"
                if c.system is None
                else "active"
                if c.name in state.active
                else "inactive",
            )
            for c in self.controllers
        )

    def _declare(self, name: str, calc: Callable[[ManagerState], object]) -> None:
        self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(()),
            lambda context, output: output.set_value(calc(self._state(context))),
            prerequisites_of_calc={self.xa_ticket()},
        )

    def _read(self, context: Context, held: ManagerState) -> Readings:
        return Readings(
            held,
            messages_on(self._switch, context, SwitchController),
            lambda: self._measured.Eval(context),
        )

    def _time_ns(self, number: int) -> int:
        """Return the time of a cycle [ns]."""
        if has_rate(self.period, self._update_rate):
            return number * NANOSECONDS // self._update_rate
        # Another robot's manager has the say about the steps.
        return round(number * self.period * NANOSECONDS)

    def _calc_cycle(self, context: Context, output: AbstractValue) -> None:
        held = self._state(context)
        number = cycle_at(context.get_time(), self.period)
        if number is None or number == held.cycle.number:
            output.set_value(held.cycle)
            return
        time_ns = self._time_ns(number)
        period_ns = time_ns - self._time_ns(number - 1)
        readings = self._read(context, held)
        output.set_value(self._loop.begin(readings, number, time_ns, period_ns))

    def _update(self, context: Context, state: State) -> None:
        held = self._state(context)
        cycle: Cycle = self._cycle.Eval(context)
        if cycle.number == held.cycle.number:
            return
        readings = self._read(context, held)
        new = self._loop.finish(context, readings, cycle)
        state.get_mutable_abstract_state(self._state_index).set_value(new)
        state.get_mutable_discrete_state(self._values).set_value(new.values)
        state.get_mutable_discrete_state(self._drive_state).set_value(
            self._drive.told(new.drive)
        )
        if cycle.commands is not None:
            flags = [float(c.name in cycle.active) for c in self.controllers]
            state.get_mutable_discrete_state(self._flags).set_value(flags)
        if self._stored is not None:
            stored = context.get_discrete_state(self._stored).value()
            stored = self._stored_states.update(stored, new.values)
            state.get_mutable_discrete_state(self._stored).set_value(stored)
