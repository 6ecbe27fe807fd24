"""A robot with its servo and friction, commanded directly; without shapes."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

import arm_drake as ad
from arm_drake.description.joints import last_master
from arm_drake.description.urdf import RobotDescription
from arm_drake.hardware.drives import commanded_joints, effort_limits, make_robot_drive
from arm_drake.hardware.hardware import add_hardware, connect_forces
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    set_initial_positions,
)


class Motion(NamedTuple):
    """What the commanded joints did, at every step of the plant."""

    # Time [s], shape (k,), and values of the n joints, shape (k, n).
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


class Payload(NamedTuple):
    """A mass that the servo knows nothing of."""

    link: str

    # Mass [kg], and its place in the frame of the link [m].
    mass: float
    center: Sequence[float] = (0.0, 0.0, 0.0)


class ServoRig:
    """A robot whose commanded joints follow positions."""

    def __init__(
        self,
        robot: ad.Robot,
        *,
        step: float = 1e-3,
        payload: Payload | None = None,
        initial: Mapping[str, float] | None = None,
        **options: object,
    ) -> None:
        """Build it.

        Args:
            robot: The robot.
            step: Step of the plant [s].
            payload: What hangs on it, unknown to the servo.
            initial: Initial positions, in the place of the robot's own.
            options: Fields of SimulationOptions.
        """
        settings = ad.SimulationOptions(time_step=step, **options)  # type: ignore[arg-type]
        description = robot.description
        start = _with_followers(
            description, {**robot.initial_positions, **(initial or {})}
        )
        builder = DiagramBuilder()
        plant, _ = add_plant(builder, step, settings)
        model = add_robot_model(plant, description, "robot", None, is_reduced=True)
        self.joints = commanded_joints(description)
        self.names = [joint.name for joint in self.joints]
        add_actuators(plant, model, self.names, effort_limits(self.joints))
        set_initial_positions(plant, model, start)
        if payload is not None:
            _add_payload(plant, model, payload)
        plant.Finalize()
        hardware = add_hardware(
            builder,
            plant,
            model,
            description,
            prefix="",
            drive=make_robot_drive(description, None, settings, step),
            initial=start,
            options=settings,
        )
        if hardware.friction is not None:
            connect_forces(builder, plant, {model: hardware.friction})
        assert hardware.command is not None
        builder.ExportInput(hardware.command, "command")
        self._log = LogVectorOutput(hardware.joint_states, builder, step)
        movable = [joint.name for joint in description.movable_joints]
        self._columns = [movable.index(name) for name in self.names]
        self._keep_alive = hardware
        self.start = np.array([start[name] for name in self.names])
        diagram = builder.Build()
        self.diagram, self.plant, self.model = diagram, plant, model
        self.simulator = Simulator(diagram)
        self.command(self.start)
        self._initial = self.simulator.get_context().Clone()

    def command(self, positions: Sequence[float] | np.ndarray) -> None:
        """Command positions of the joints, from now on."""
        context = self.simulator.get_mutable_context()
        commands = np.concatenate([positions, np.zeros(len(positions))])
        self.diagram.get_input_port(0).FixValue(context, commands)

    def reset(self) -> None:
        """Go back to the start, as it was built."""
        context = self.simulator.get_mutable_context()
        context.SetTimeStateAndParametersFrom(self._initial)
        self.command(self.start)
        self.simulator.Initialize()

    def run(self, duration: float) -> Motion:
        """Return what happens during the next seconds."""
        context = self.simulator.get_context()
        log = self._log.FindMutableLog(context)
        log.Clear()
        self.simulator.AdvanceTo(context.get_time() + duration)
        states = np.split(log.data().T, 3, axis=1)
        return Motion(log.sample_times(), *(part[:, self._columns] for part in states))


def _with_followers(
    description: RobotDescription, positions: Mapping[str, float]
) -> dict[str, float]:
    """Return positions in which mimic joints are where their masters say."""
    joints = {joint.name: joint for joint in description.movable_joints}
    found = dict(positions)
    for name, joint in joints.items():
        if joint.mimic is not None:
            master, factor, offset = last_master(joint, joints)
            found[name] = factor * positions[master] + offset
    return found


def _add_payload(
    plant: MultibodyPlant, model: ModelInstanceIndex, payload: Payload
) -> None:
    center = np.array(payload.center)
    inertia = SpatialInertia(
        payload.mass,
        center,
        UnitInertia.SolidSphere(0.02).ShiftFromCenterOfMass(center),
    )
    instance = plant.AddModelInstance("payload")
    body = plant.AddRigidBody("payload", instance, inertia)
    frame = plant.GetFrameByName(payload.link, model)
    plant.WeldFrames(frame, body.body_frame())
