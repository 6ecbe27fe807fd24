"""Manager, controllers and logs of one robot, connected with its hardware."""

import dataclasses as dc
from collections.abc import Mapping, Sequence

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import VectorLogSink, ZeroOrderHold

from arm_drake import interfaces
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.generic_system import GenericSystem
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.hardware.drives import make_command_limits
from arm_drake.hardware.hardware import Hardware
from arm_drake.hardware.wiring import Wiring
from arm_drake.importing import dataclass
from arm_drake.manager import (
    MANAGER,
    NUMBERS_PORT,
    STORED_PORT,
    SWITCH_PORT,
    ControllerManager,
)
from arm_drake.manager.connections import (
    COMMAND_LOG,
    SampledStates,
    connect_chains,
    export_topics,
)
from arm_drake.manager.hardware_interfaces import (
    HardwareInterfaces,
    find_hardware_interfaces,
)
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import CONTACT_LOG, ContactForces
from arm_drake.plant.kinematics import LinkFrames
from arm_drake.timing import fit_period, has_rate


@dataclass(frozen=True)
class RobotSystems:
    """Adds the systems of one robot to a builder, and exports their ports."""

    builder: DiagramBuilder

    robot: Robot

    # Start of the names of its systems and ports.
    prefix: str

    # Period of its controller manager [s].
    period: float

    options: SimulationOptions

    # Step of the plant [s].
    step: float

    # Name of the world, which topics of Gazebo contain.
    world_name: str = "empty"

    def find_hardware_interfaces(
        self,
        blocks: Sequence[GenericSystem] | None = None,
        gripper_ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> HardwareInterfaces:
        """Return what the robot offers its controllers."""
        hardware_interfaces = find_hardware_interfaces(
            self.robot.description,
            self.robot.initial_positions,
            blocks,
            sensors=self.robot.sensors,
            robot_name=self.robot.name,
            world_name=self.world_name,
        )
        return dc.replace(
            hardware_interfaces,
            gripper_ranges=gripper_ranges or {},
            namespace=self.namespace,
            seed=self.options.seed,
        )

    @property
    def namespace(self) -> str:
        """Name space of the robot's nodes: with several robots it is the robot's name.

        What ROS has relative to it stands in it: nodes, topics, services, actions.
        """
        return f"/{self.robot.name}" if self.prefix else self.robot.namespace

    @property
    def log_period(self) -> float:
        """Period of the log of the joints' states [s]."""
        rate = self.options.log_rate
        return self.period if rate is None else fit_period(rate, self.step)

    def add(
        self,
        hardware: Hardware,
        hardware_interfaces: HardwareInterfaces,
        controllers: Sequence[LoadedController],
        report: LoadReport,
        drive: DriveCommands,
    ) -> None:
        """Add manager, controllers and logs, connect them, export their ports."""
        builder, prefix = self.builder, self.prefix
        self._report_rate(report)
        manager = builder.AddNamedSystem(
            f"{prefix}{MANAGER}",
            ControllerManager(
                self.robot,
                controllers,
                report,
                prefix=prefix,
                period=self.period,
                log_period=self.log_period,
                drive=drive,
                hardware_interfaces=hardware_interfaces,
                limits=make_command_limits(
                    self.robot, hardware_interfaces, controllers, report
                ),
                keep=hardware.drive,
            ),
        )
        self._record(hardware.recorded)
        if self.options.log_contacts:
            self._record_contacts(hardware.contacts, report)
        self._connect(manager, hardware)
        everything = hardware.everything or self._all_states(
            manager, hardware.joint_states, hardware.readings
        )
        systems = {c.name: c.system for c in controllers if c.system is not None}
        if manager.HasInputPort(interfaces.MEASURED_PORT):
            builder.Connect(everything, manager.GetInputPort(interfaces.MEASURED_PORT))
        for name, system in systems.items():
            self._add_controller(name, system, hardware, everything)
            manager.add_controller(builder, system)
        connect_chains(builder, systems.values())
        export_topics(builder, systems, prefix, report)
        if controllers:
            switch = manager.GetInputPort(SWITCH_PORT)
            builder.ExportInput(switch, f"{prefix}{MANAGER}.{SWITCH_PORT}")
        builder.ExportOutput(hardware.recorded, f"{prefix}joint_states")

    def _report_rate(self, report: LoadReport) -> None:
        """Report a manager whose cycles don't come at its rate."""
        rate = self.robot.controllers.update_rate
        if not has_rate(self.period, rate):
            what = f"update_rate {rate} Hz doesn't fit those of the other robots"
            done = f"its cycles come at {1.0 / self.period:.6g} Hz"
            file = next(iter(self.robot.controllers.files), None)
            report.add("warning", "repair", what, done, where=MANAGER, file=file)

    def _connect(self, manager: ControllerManager, hardware: Hardware) -> None:
        """Connect the manager with the hardware, and log what it commands."""
        rows: dict[str, Sequence[int]] = {"log": manager.logged.rows}
        numbers = manager.numbers
        targets = {"drive": hardware.command, interfaces.VALUES_PORT: hardware.values}
        for name, part in (
            ("drive", numbers.servo),
            (interfaces.VALUES_PORT, numbers.values),
        ):
            if targets[name] is not None:
                rows[name] = range(part.start, part.stop)
        # One system for all: each costs something in each step.
        written = Wiring(self.builder).pick_all(
            f"{self.prefix}commands", rows, manager.GetOutputPort(NUMBERS_PORT)
        )
        self._log(written.pop("log"), COMMAND_LOG, self.period)
        for name, port in written.items():
            self.builder.Connect(port, targets[name])
        if hardware.claimed is not None:
            claimed = manager.GetOutputPort(interfaces.CLAIMED_PORT)
            self.builder.Connect(claimed, hardware.claimed)
        for state, name in (
            (hardware.joint_states, interfaces.STATE_PORT),
            (hardware.joint_motions, interfaces.MOTIONS_PORT),
        ):
            self.builder.Connect(state, manager.GetInputPort(name))

    def add_frames(self, body_poses: OutputPort, bodies: Sequence[int]) -> None:
        """Add the poses of the links, and export them."""
        frames = self.builder.AddNamedSystem(f"{self.prefix}frames", LinkFrames(bodies))
        self.builder.Connect(body_poses, frames.GetInputPort("body_poses"))
        self.builder.ExportOutput(
            frames.GetOutputPort("frames"), f"{self.prefix}frames"
        )

    def _add_controller(
        self,
        name: str,
        system: ControllerInterface,
        hardware: Hardware,
        everything: OutputPort,
    ) -> None:
        """Add a controller and connect what it reads."""
        full_name = f"{self.prefix}{name}"
        # Any name is legal in ROS, also that of one of our own systems.
        is_taken = self.builder.HasSubsystemNamed(full_name)
        self.builder.AddNamedSystem(f"{full_name}:" if is_taken else full_name, system)
        measured = everything if system.reads_all else hardware.joint_motions
        if system.is_sampled:
            if system.params.update_rate < self.robot.controllers.update_rate:
                measured = self._sample_ticks(system, measured, f"{full_name}:sample")
            else:
                kind = ":all" if everything is not hardware.recorded else ""
                measured = self._sample(measured, self.period, kind)
        self.builder.Connect(measured, system.GetInputPort(interfaces.STATE_PORT))
        if system.HasInputPort(interfaces.FRAMES_PORT):
            frames = self.builder.GetSubsystemByName(f"{self.prefix}frames")
            port = system.GetInputPort(interfaces.FRAMES_PORT)
            self.builder.Connect(frames.get_output_port(), port)
        if system.HasInputPort(interfaces.CONTACTS_PORT) and hardware.contacts:
            port = system.GetInputPort(interfaces.CONTACTS_PORT)
            self.builder.Connect(hardware.contacts, port)
        if name in hardware.imus:
            port = system.GetInputPort(interfaces.READINGS_PORT)
            self.builder.Connect(hardware.imus[name], port)

    def _all_states(
        self,
        manager: ControllerManager,
        joint_states: OutputPort,
        readings: OutputPort | None,
    ) -> OutputPort:
        """Return everything that can be read: joints, sensors, what is only stored."""
        ports = [joint_states]
        if readings is not None:
            ports.append(readings)
        if manager.HasOutputPort(STORED_PORT):
            ports.append(manager.GetOutputPort(STORED_PORT))
        return Wiring(self.builder).join(f"{self.prefix}state_interfaces", ports)

    def _record(self, joint_states: OutputPort) -> None:
        """Record the state of the joints at every tick, with the efforts it causes."""
        period = self.log_period
        # Sampled after the tick and logged before the next one: a log of the vector
        # itself would compute the servo with the old command, once more.
        sample = self._sample(joint_states, period)
        self._log(sample, "joint_states", period)

    def _record_contacts(self, contacts: OutputPort | None, report: LoadReport) -> None:
        """Record the contact forces at every tick."""
        if contacts is None:
            what, done = "log_contacts", "nothing touches anything without physics"
            report.add("warning", "unsupported", what, done, where="log_contacts")
            return
        forces = ContactForces(self.robot.description.links)
        self.builder.AddNamedSystem(f"{self.prefix}{CONTACT_LOG}", forces)
        self.builder.Connect(contacts, forces.get_input_port())
        period = self.log_period
        sample = self._sample(forces.get_output_port(), period, ":contacts")
        self._log(sample, CONTACT_LOG, period)

    def _sample_ticks(
        self, system: ControllerInterface, measured: OutputPort, name: str
    ) -> OutputPort:
        """Return states, sampled in the ticks of a slow controller and held."""
        sample = self.builder.AddNamedSystem(
            name,
            SampledStates(system.params.controller_name, measured.size(), self.period),
        )
        cycle = self.builder.GetSubsystemByName(f"{self.prefix}{MANAGER}")
        manager_port = sample.GetInputPort(interfaces.MANAGER_PORT)
        self.builder.Connect(cycle.GetOutputPort("cycle"), manager_port)
        self.builder.Connect(measured, sample.GetInputPort(interfaces.STATE_PORT))
        tick_time = sample.GetOutputPort(interfaces.TICK_PORT)
        self.builder.Connect(tick_time, system.add_tick_time())
        return sample.GetOutputPort(interfaces.STATE_PORT)

    def _sample(self, states: OutputPort, period: float, kind: str = "") -> OutputPort:
        """Return states, sampled and held; one system per kind and period."""
        name = f"{self.prefix}sample"
        if period != self.log_period:
            name += f":{period}"
        name += kind
        if self.builder.HasSubsystemNamed(name):
            return self.builder.GetSubsystemByName(name).get_output_port()
        sample = self.builder.AddNamedSystem(name, ZeroOrderHold(period, states.size()))
        self.builder.Connect(states, sample.get_input_port())
        return sample.get_output_port()

    def _log(self, port: OutputPort, name: str, period: float) -> None:
        log = self.builder.AddNamedSystem(
            f"{self.prefix}log:{name}", VectorLogSink(port.size(), period)
        )
        self.builder.Connect(port, log.get_input_port())
