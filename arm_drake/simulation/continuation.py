"""Continuation of a simulation with another diagram, to which a thing was added."""

import contextlib

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Context, Diagram
from pydrake.systems.primitives import VectorLogSink

from arm_drake.errors import InputError
from arm_drake.simulation.simulation import Simulation

# Forces on bodies, which are other bodies by their numbers now.
_FORCES = "applied_spatial_force"


def continue_with(simulation: Simulation, diagram: Diagram) -> None:
    """Let a simulation go on with a diagram that has the same robots and more things.

    Time, what moves, controllers, what was sent and logged stay as they are; what is
    new is where its diagram has it. A reset goes back to the start of the new diagram.
    InputError if that has other systems, there is no physics, or the simulation can't
    go on with it.
    """
    _ = simulation.plant  # There is none without physics, which is said.
    if simulation.recorders:
        raise InputError("a simulation that writes its log can't take a new diagram")
    simulator = Simulator(diagram)
    _carry_over(simulation, diagram, simulator.get_mutable_context())
    simulation.replace_diagram(diagram, simulator)
    params = InitializeParams(suppress_initialization_events=True)
    simulator.Initialize(params)


def _carry_over(simulation: Simulation, diagram: Diagram, root: Context) -> None:
    """Set the state of a new diagram to that of the old one."""
    old, old_root = simulation.diagram, simulation.context
    names = [system.get_name() for system in old.GetSystems()]
    # With the first thing that can be held comes what tells the servo of it.
    missing = set(names) - {system.get_name() for system in diagram.GetSystems()}
    if missing:
        text = f"the new diagram has no {', '.join(sorted(missing))}"
        raise InputError(f"{text}; expected one of the same robots")
    root.SetTime(old_root.get_time())
    for name in names:
        before, system = old.GetSubsystemByName(name), diagram.GetSubsystemByName(name)
        if isinstance(before, MultibodyPlant):
            _move_bodies(
                before,
                before.GetMyContextFromRoot(old_root),
                system,
                system.GetMyMutableContextFromRoot(root),
            )
        elif isinstance(before, VectorLogSink):
            rows, log = before.FindLog(old_root), system.FindMutableLog(root)
            for time, row in zip(rows.sample_times(), rows.data().T, strict=True):
                log.AddData(time, row)
        elif not isinstance(before, SceneGraph):
            context = system.GetMyMutableContextFromRoot(root)
            try:
                _copy_state(before.GetMyContextFromRoot(old_root), context)
            except (RuntimeError, ValueError) as error:
                text = f"the state of {name} doesn't fit the new diagram: {error}"
                raise InputError(text) from None
    for index in range(old.num_input_ports()):
        port = old.get_input_port(index)
        if port.get_name() != _FORCES and port.HasValue(old_root):
            value = AbstractValue.Make(port.Eval(old_root))
            with contextlib.suppress(RuntimeError):  # Vectors have a way of their own.
                diagram.GetInputPort(port.get_name()).FixValue(root, value)
                continue
            vector = np.asarray(port.Eval(old_root))
            diagram.GetInputPort(port.get_name()).FixValue(root, vector)


def _copy_state(before: Context, context: Context) -> None:
    """Set state and parameters of a system's context to those of another one's."""
    if context.num_continuous_states():
        context.SetContinuousState(before.get_continuous_state_vector().CopyToVector())
    for index in range(context.num_discrete_state_groups()):
        vector = before.get_discrete_state(index).CopyToVector()
        context.SetDiscreteState(index, vector)
    for index in range(context.num_abstract_states()):
        value = before.get_abstract_state(index).get_value()
        context.SetAbstractState(index, value)
    for index in range(context.num_numeric_parameter_groups()):
        vector = before.get_numeric_parameter(index).CopyToVector()
        context.get_mutable_numeric_parameter(index).SetFromVector(vector)
    for index in range(context.num_abstract_parameters()):
        value = before.get_abstract_parameter(index).get_value()
        context.get_mutable_abstract_parameter(index).set_value(value)


def _move_bodies(
    before: MultibodyPlant, old: Context, plant: MultibodyPlant, context: Context
) -> None:
    """Put the bodies that both plants have where they are, as fast as they are."""
    for index in map(ModelInstanceIndex, range(before.num_model_instances())):
        name = before.GetModelInstanceName(index)
        model = plant.GetModelInstanceByName(name)
        q, v = before.GetPositions(old, index), before.GetVelocities(old, index)
        plant.SetPositions(context, model, q)
        plant.SetVelocities(context, model, v)
    for index in map(BodyIndex, range(1, before.num_bodies())):
        body = before.get_body(index)
        if not body.name().endswith("/payload"):
            continue
        # What a link carries may be set while it runs.
        name = before.GetModelInstanceName(body.model_instance())
        same = plant.GetBodyByName(body.name(), plant.GetModelInstanceByName(name))
        inertia = body.CalcSpatialInertiaInBodyFrame(old)
        same.SetSpatialInertiaInBodyFrame(context, inertia)
