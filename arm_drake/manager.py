"""The controller manager: the read-update-write loop, as a system of the diagram."""

from collections.abc import Callable, Iterable

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    LeafSystem,
    State,
)

from arm_drake import interfaces
from arm_drake.control.command_limits import CommandLimits
from arm_drake.control.drive_commands import DriveCommands, DriveMode
from arm_drake.controllers.controller_interface import (
    Array,
    Cycle,
    TickingController,
    messages_on,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.loaded_controllers import (
    ControllerState,
    LoadedController,
    command_order,
    controller_infos,
)
from arm_drake.manager_claims import Claimants
from arm_drake.manager_lifecycle import (
    Lifecycle,
    ManagerState,
    add_events,
)
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.surroundings import Surroundings

# Name of the manager, and of its port on which a switch is requested.
MANAGER = "controller_manager"
SWITCH_PORT = "switch_controller"

# And of the one with the values that the physics doesn't know.
STORED_PORT = "stored_state_interfaces"

# Part of a period by which an event may miss its time.
_TOLERANCE = 1e-6


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
    claimed            --    --       frozenset of the names of command interfaces
    command_values     k     rad, ..  values of all command interfaces
    drive              5n    rad, ..  what the servo of n joints is told, see
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
        servo_plant: MultibodyPlant | None = None,
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
        self.commands = command_order(surroundings, self.controllers)
        self._servo_plant = servo_plant
        self._drive = drive
        self._limits = limits
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
            is_strict=robot.distro == "rolling",
        )

        self._switch = self.DeclareAbstractInputPort(
            SWITCH_PORT, AbstractValue.Make(())
        )
        measured = interfaces.interface_names(
            surroundings.joint_types, interfaces.STATE_INTERFACES
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, len(measured)
        )
        self._measured_at = [
            [measured.index(f"{joint}/{name}") for joint in drive.joints]
            for name in interfaces.STATE_INTERFACES
        ]
        self._claimants = Claimants(
            systems,
            self.commands,
            drive.joints,
            lambda name: self.DeclareAbstractInputPort(
                f"{interfaces.COMMAND_PORT}:{name}", AbstractValue.Make(())
            ),
        )
        started = [c.name for c in self.controllers if c.state == "active"]
        state = self._lifecycle.start(started)
        self._state_index = self.DeclareAbstractState(AbstractValue.Make(state))
        self._cycle = self.DeclareAbstractOutputPort(
            "cycle",
            lambda: AbstractValue.Make(()),
            self._calc_cycle,
            prerequisites_of_calc={
                self.time_ticket(),
                self.xa_ticket(),
                self.xd_ticket(),
                self.input_port_ticket(self._switch.get_index()),
                self.input_port_ticket(self._measured.get_index()),
            },
        )
        initial = surroundings.initial_positions
        values = [
            initial.get(name.rpartition("/")[0], 0.0)
            if name.endswith(f"/{interfaces.POSITION}")
            else 0.0
            for name in self.commands
        ]
        hold = drive.initial([initial[joint] for joint in drive.joints])
        flags = [float(c.name in state.active) for c in self.controllers]
        self._values = self.DeclareDiscreteState(values)
        self._drive_state = self.DeclareDiscreteState(hold)
        self._flags = self.DeclareDiscreteState(flags)
        # State interfaces that only follow a command of their name, or nothing.
        self._stored = None
        if surroundings.stored:
            order = tuple(surroundings.stored)
            self._stored = self.DeclareDiscreteState(list(surroundings.stored.values()))
            self.DeclareStateOutputPort(STORED_PORT, self._stored)
            mirrored = [n for n in order if n in surroundings.command_interfaces]
            self._mirrored = (
                [order.index(name) for name in mirrored],
                [self.commands.index(name) for name in mirrored],
            )
        self._declare("controllers", self._rows)
        self._declare("events", lambda state: state.events)
        self._declare(
            interfaces.CLAIMED_PORT,
            lambda state: frozenset(self._lifecycle.claims(state.active)),
        )
        self.DeclareStateOutputPort(interfaces.VALUES_PORT, self._values)
        self.DeclareStateOutputPort("drive", self._drive_state)
        self.DeclareStateOutputPort("active", self._flags)
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

    def add_controller(self, builder: DiagramBuilder, name: str) -> None:
        """Connect a controller that is in the builder with this manager.

        Args:
            builder: Where both are.
            name: Name of the controller.
        """
        (system,) = (c.system for c in self.controllers if c.name == name and c.system)
        told = system.GetInputPort(interfaces.MANAGER_PORT)
        builder.Connect(self._cycle, told)
        if isinstance(system, TickingController):
            values = self.GetOutputPort(interfaces.VALUES_PORT)
            builder.Connect(values, system.add_command_values(self.commands))
            port = self._claimants.port(name)
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

    def _calc_cycle(self, context: Context, output: AbstractValue) -> None:
        held = self._state(context)
        ticks = context.get_time() / self.period
        number = round(ticks)
        if number == held.cycle.number or abs(ticks - number) > _TOLERANCE:
            output.set_value(held.cycle)
            return
        rate = self._update_rate
        time_ns = number * NANOSECONDS // rate
        period_ns = time_ns - (number - 1) * NANOSECONDS // rate
        active, chain, values = held.active, held.chained, None
        if self._is_switching(context, held):
            plan = self._lifecycle.switch(held, self._requests(context, held))
            active, chain = plan.active, plan.chained
            values, _ = self._seed(context, held, plan.mode)
        periods = self._lifecycle.periods(held, active, time_ns)
        cycle = Cycle(number, time_ns, period_ns, active, chain, periods, values)
        output.set_value(cycle)

    def _requests(
        self, context: Context, held: ManagerState
    ) -> tuple[SwitchController, ...]:
        """Return the requests that are new."""
        requests = messages_on(self._switch, context, SwitchController)
        old = held.requests
        return tuple(r for r in requests if not any(r is other for other in old))

    def _is_switching(self, context: Context, held: ManagerState) -> bool:
        return held.active is not held.cycle.active or bool(
            self._requests(context, held)
        )

    def _seed(
        self, context: Context, held: ManagerState, mode: DriveMode
    ) -> tuple[Array, Array]:
        """Return the values and the drive vector with which a mode starts."""
        values = context.get_discrete_state(self._values).value()
        drive = context.get_discrete_state(self._drive_state).value()
        if held.cycle.number < 0:
            return values, drive
        measured = self._measured.Eval(context)
        q, v, tau = (measured[at] for at in self._measured_at)
        return self._drive.seed(held.mode, mode, values, drive, (q, v, tau))

    def _update(self, context: Context, state: State) -> None:
        held = self._state(context)
        cycle: Cycle = self._cycle.Eval(context)
        if cycle.number == held.cycle.number:
            return
        active, chain, mode = held.active, held.chained, held.mode
        events, fresh = held.events, None
        number = held.next_activation
        if cycle.commands is None:
            values = context.get_discrete_state(self._values).value().copy()
            drive = context.get_discrete_state(self._drive_state).value()
        else:
            new = self._requests(context, held)
            active, chain, mode, number, news = self._lifecycle.switch(held, new)
            active = cycle.active  # The same, and this very object.
            events = add_events(events, news)
            _, drive = self._seed(context, held, mode)
            values = cycle.commands.copy()
            fresh = self._claimants.fresh(cycle, held.cycle)
            flags = [float(c.name in active) for c in self.controllers]
            state.get_mutable_discrete_state(self._flags).set_value(flags)
        failed = self._claimants.write(context, cycle, held.cycle, values)
        previous = held.previous
        if self._limits is not None:
            if fresh is not None:
                previous = self._claimants.forget(previous, fresh)
            new_limits = self._limits.apply(
                self._lifecycle.claims(active),
                values,
                self._measured.Eval(context),
                previous,
                cycle.period_ns / NANOSECONDS,
            )
            previous = new_limits.previous
            failed += self._claimants.owners(active, new_limits.out_of_bounds)
        last_ns, skipped = held.last_ns, self._claimants.skipped(cycle)
        if cycle.periods:
            due = {n: cycle.time_ns for n, p in cycle.periods.items() if p}
            last_ns = {**last_ns, **due}
        drive = self._drive.write(mode, values, drive, fresh=fresh, skipped=skipped)
        if failed:
            active, number, news = self._lifecycle.replace(failed, active, number)
            events, chain = add_events(events, news), self._lifecycle.chained(active)
        state.get_mutable_abstract_state(self._state_index).set_value(
            ManagerState(
                cycle,
                active,
                chain,
                mode,
                number,
                last_ns,
                messages_on(self._switch, context, SwitchController),
                events,
                previous,
            )
        )
        state.get_mutable_discrete_state(self._values).set_value(values)
        state.get_mutable_discrete_state(self._drive_state).set_value(drive)
        if self._stored is not None:
            stored = context.get_discrete_state(self._stored).value().copy()
            here, there = self._mirrored
            stored[here] = values[there]
            state.get_mutable_discrete_state(self._stored).set_value(stored)
