"""linearize: the sampled closed loop of a robot around a state, and what it tells.

The state is what the simulation's Context holds in numbers: the plant, dry friction,
the servo, and what controllers remember. A period of the controller manager maps it
from before one tick to before the next; central differences of that map, run by the
simulation itself, are the matrices. States that are only held, and those that nothing
reads, are left out.
"""

import bisect
import dataclasses as dc
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.analysis import InitializeParams, Simulator
from pydrake.systems.framework import Context, Diagram, System

from arm_drake.arrays import Array
from arm_drake.batch.linear_model import LinearModel, Margins, margins_of, transfer
from arm_drake.controllers.gazebo.joint_controllers import (
    JointCommandState,
    JointPositionController,
)
from arm_drake.controllers.joint_trajectory.state import JointTrajectoryState
from arm_drake.controllers.pid_controller import PidControllerState
from arm_drake.description.robot import Robot
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError, check_known
from arm_drake.interfaces import EFFORT, POSITION
from arm_drake.manager import ControllerManager
from arm_drake.manager.state import ManagerState
from arm_drake.messages import JointTrajectory, JointTrajectoryPoint, Message
from arm_drake.options import SimulationOptions
from arm_drake.planning.groups import find_group, find_state
from arm_drake.simulation.simulation import Simulation, advance
from arm_drake.simulation.topics import COMMANDS, REFERENCE, TOPIC, ControllerTopics

# How far each number is moved for a difference, of 1 or of itself if that is larger.
# A smaller one loses digits, a larger one leaves the stick of dry friction. Efforts
# besides [N·m, N].
_STEP, _PUSH = 1e-7, 1e-5

# What a difference of rounded numbers may be off, of the largest number / _STEP.
_ROUNDING = 1e-14

# At rest, joints move slower than this [rad/s, m/s]; they are looked at so often, and
# may take so long [s].
_AT_REST, _WAIT, _LONGEST_REST = 1e-5, 0.25, 10.0

# Steps for the region [rad, m], and how long they are compared [s].
_SIZES = tuple(float(x) for x in np.geomspace(1e-6, 1.0, 19))
_REGION_TIME = 0.3

# Frequencies at which margins are looked for.
_GRID = 2000


def linearize(
    what: Robot | Diagram | Simulation,
    at: str | Mapping[str, float] | None = None,
    *,
    options: SimulationOptions | None = None,
    region_tolerance: float | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> LinearModel:
    """Return the linear model of a robot with its controllers, around a state.

    It is exact for small motions only; `region` says how small, if it is asked for.
    Joints at rest stick in their dry friction, which holds them as a spring would:
    `SimulationOptions(friction=False)` shows the loop as it is when they slide.

    Args:
        what: A robot, which is put there and settles; a diagram of one, which settles
            from where it begins; or a simulation, which is taken as it is now.
        at: Where a robot is: positions by joint [rad, m], or the name of a state of its
            planning groups as "home"; by default its initial positions.
        options: How a robot is simulated, with its delays, without its noise.
        region_tolerance: How far responses may be off the simulation's, of their
            height, for `LinearModel.region`; None asks for none.
        progress: Is told what is done, how many parts of it are, and of how many.

    Raises:
        InputError: If there is no physics, no joint that is driven, or no such pose.
    """
    if at is not None and not isinstance(what, Robot):
        kind = type(what).__name__
        raise InputError(f"at is for a robot; a {kind} is taken where it is")
    if options is not None and not isinstance(what, Robot):
        raise InputError("options are for a robot; give them to build_diagram")
    tell = progress or (lambda _what, _done, _total: None)
    if isinstance(what, Simulation):
        loop = _Loop(what, tell)
        at_rest = loop.is_at_rest()
    else:
        if isinstance(what, Robot):
            # Noise only adds to the state: there is none in a model of it.
            chosen = dc.replace(options or SimulationOptions(), state_noise={})
            what = build_diagram(_placed(what, at), options=chosen)
        loop = _Loop(Simulation(what), tell)
        at_rest = loop.settle()
    model = loop.linearize(at_rest)
    if region_tolerance is not None:
        model = dc.replace(model, region=loop.find_region(model, region_tolerance))
    return model


def _placed(robot: Robot, at: str | Mapping[str, float] | None) -> Robot:
    if at is None:
        return robot
    if isinstance(at, str):
        at = find_state(find_group(robot, None), at)
    known = robot.initial_positions
    for name in at:
        check_known("joint", name, known, argument="at")
    return dc.replace(robot, initial_positions={**known, **at})


class _Input(NamedTuple):
    """Input of a controller for joint positions."""

    controller: str
    joints: tuple[str, ...]
    topics: ControllerTopics

    # Makes port and message of positions in the joints' order; None where targets are
    # set in the controller's state.
    make: Callable[[Sequence[float]], tuple[str, Message]] | None


class _Differences(NamedTuple):
    """A map over a while, and positions C and efforts F of a state, shape (n, N)."""

    names: list[str]
    A: Array
    B: Array
    E: Array
    C: Array
    F: Array


class _Loop:
    """A simulation that can be run again from the state that it has."""

    def __init__(
        self, simulation: Simulation, tell: Callable[[str, int, int], None]
    ) -> None:
        self._tell_progress = tell
        self.simulation = simulation
        self._plant = simulation.plant
        self._manager = simulation.directory.manager(None)
        self._period = float(self._manager.period)
        self._step = float(self._plant.time_step())
        robot = self._manager.robot
        self._movable = [joint.name for joint in robot.description.movable_joints]
        self._active = [
            (controller.name, controller.type, controller.system)
            for controller in self._manager.controllers
            if controller.name in self._state_of(simulation.context).active
            and controller.system is not None
        ]
        driven = {
            tuple(name.rpartition("/")[::2])
            for _, _, system in self._active
            for name in system.command_interfaces
        }
        names = {joint for joint, _ in driven}
        self._joints = tuple(name for name in self._movable if name in names)
        if not self._joints:
            raise InputError("no active controller drives a joint")
        # Their effort is a controller's, the same from tick to tick.
        self._effort_joints = {
            joint for joint, interface in driven if interface == EFFORT
        }
        self._inputs = list(self._find_inputs())
        commanded = {joint for each in self._inputs for joint in each.joints}
        self._commanded_joints = tuple(
            name for name in self._joints if name in commanded
        )
        self._simulator = Simulator(simulation.diagram, simulation.context.Clone())
        self._start: Context = simulation.context.Clone()

    def settle(self) -> bool:
        """Hold all joints where they are until they rest; return whether they do."""
        simulation = self.simulation
        now = self._values(simulation.context)[0]
        start = dict(zip(self._movable, map(float, now), strict=True))
        simulation.advance_to(2.0 * self._period)
        for each in self._inputs:
            self._apply(simulation.context, each, [start[name] for name in each.joints])
        ticks = 2
        while simulation.time < _LONGEST_REST and not (ticks > 2 and self.is_at_rest()):
            ticks += max(1, round(_WAIT / self._period))
            simulation.advance_to(ticks * self._period)
        self._start = simulation.context.Clone()
        return self.is_at_rest()

    def is_at_rest(self) -> bool:
        """Return whether no joint moves."""
        speeds = dict(
            zip(self._movable, self._values(self.simulation.context)[1], strict=True)
        )
        return bool(max(abs(speeds[joint]) for joint in self._joints) < _AT_REST)

    def linearize(self, at_rest: bool) -> LinearModel:
        """Return the model around the start."""
        start = self._start
        coarse = fine = self._differentiate(start, self._period)
        if (
            len(self._effort_joints) < len(self._joints)
            and self._step < 0.99 * self._period
        ):
            # Within a period only the servo answers.
            within = self._advance(start, self._step).Clone()
            fine = self._differentiate(within, self._step)
        margins, outputs = {}, [np.vstack((each.C, each.F)) for each in (coarse, fine)]
        loops = [_reduce(coarse, outputs[0]), _reduce(fine, outputs[1])]
        for index, joint in enumerate(self._joints):
            is_discrete = joint in self._effort_joints
            step = self._period if is_discrete else self._step
            loop = loops[0 if is_discrete else 1]
            margins[joint] = _find_margins(loop, index, step, is_discrete=is_discrete)
        reduced = _reduce(coarse, coarse.C)
        now = dict(zip(self._joints, self._joint_values(start)[0], strict=True))
        return LinearModel(
            self._period,
            self._joints,
            self._commanded_joints,
            tuple(reduced.names),
            reduced.A,
            reduced.B,
            reduced.E,
            reduced.C,
            {joint: float(position) for joint, position in now.items()},
            at_rest,
            margins,
        )

    def find_region(self, model: LinearModel, tolerance: float) -> dict[str, float]:
        """Return the largest step of each command that the model predicts [rad, m]."""
        ticks = max(2, round(_REGION_TIME / self._period))
        nothing = self._run(self._joints[0], 0.0, ticks)
        found = {}
        for done, joint in enumerate(model.commanded):
            self._tell_progress("steps of joints", done, len(model.commanded))
            row = model.joints.index(joint)
            unit = model.step_response(joint, ticks)[:, row]

            def is_off(size: float, joint: str, row: int, unit: Array) -> bool:
                moved = (self._run(joint, size, ticks) - nothing)[:, row]
                return bool(np.abs(moved - size * unit).max() > tolerance * size)

            # What is too large stays so.
            test = functools.partial(is_off, joint=joint, row=row, unit=unit)
            count = bisect.bisect_left(_SIZES, True, key=test)
            found[joint] = _SIZES[count - 1] if count else 0.0
        return found

    def _run(self, joint: str, height: float, ticks: int) -> Array:
        """Return positions at ticks after a command that is higher, shape (k, n)."""
        context, rows = self._commanded(self._start, joint, height), []
        for _ in range(ticks):
            context = self._advance(context, self._period)
            rows.append(self._joint_values(context)[0])
        return np.array(rows)

    def _find_inputs(self) -> Iterator[_Input]:
        chained = self._state_of(self.simulation.context).chained
        commanded: set[str] = set()
        for name, type_, system in self._active:
            topics = ControllerTopics(f"{self._manager.prefix}{name}", type_, system)
            made = None if name in chained else _input_of(name, topics)
            if made is None or commanded & set(made.joints):
                continue
            commanded |= set(made.joints)
            yield made

    def _state_of(self, context: Context) -> ManagerState:
        mine = self._manager.GetMyContextFromRoot(context)
        return self._manager.read_state(mine)

    def _values(self, context: Context) -> Array:
        """Return positions, velocities and efforts of all joints, shape (3, J)."""
        port = f"{self._manager.prefix}joint_states"
        values = self.simulation.diagram.GetOutputPort(port).Eval(context)
        return np.asarray(values, dtype=float).reshape(3, -1)

    def _joint_values(self, context: Context) -> Array:
        """Return positions and efforts of the joints, shape (2, n)."""
        at = [self._movable.index(joint) for joint in self._joints]
        return self._values(context)[::2][:, at]

    def _apply(self, context: Context, input_: _Input, values: Sequence[float]) -> None:
        """Send positions to a controller for its next tick."""
        if input_.make is not None:
            own, message = input_.make(values)
            port = self.simulation.diagram.GetInputPort(input_.topics.exported_as(own))
            port.FixValue(context, AbstractValue.Make((message,)))
            return
        path = ("ticks", input_.controller, "state", "targets")
        state = _with(self._state_of(context), path, np.array(values))
        mine = self._manager.GetMyMutableContextFromRoot(context)
        self._manager.write_state(mine, state)

    def _commanded(self, start: Context, joint: str, height: float) -> Context:
        """Return a copy of a context with the command of a joint so much higher."""
        context = start.Clone()
        measured = dict(zip(self._movable, self._values(start)[0], strict=True))
        for input_ in self._inputs:
            state = self._state_of(start).ticks[input_.controller].state
            now = _references(state, len(input_.joints))
            self._apply(
                context,
                input_,
                [
                    float(measured[name] if math.isnan(value) else value)
                    + (height if name == joint else 0.0)
                    for name, value in zip(input_.joints, now, strict=True)
                ],
            )
        return context

    def _advance(self, start: Context, duration: float) -> Context:
        """Return the simulator's own context, a while after another one."""
        simulator = self._simulator
        # Events are at multiples of the step, as they are rounded.
        end = round((start.get_time() + duration) / self._step) * self._step
        if start is not simulator.get_context():
            simulator.reset_context(start.Clone())
        simulator.Initialize(InitializeParams(suppress_initialization_events=True))
        advance(simulator, end)
        return simulator.get_mutable_context()

    def _differentiate(self, start: Context, duration: float) -> _Differences:
        """Return central differences of what a while makes of a state."""
        start = start.Clone()
        mine = self._manager.GetMyMutableContextFromRoot(start)
        # The numbers of the state then count, not those that it is made of.
        self._manager.write_state(mine, self._manager.read_state(mine))
        numbers = _Numbers(self.simulation.diagram, self._manager, start)
        x = numbers.read(start)
        work = start.Clone()

        def slope(change: Callable[[float], Context], size: float) -> Array:
            after = [
                numbers.read(self._advance(change(sign * size), duration))
                for sign in (1.0, -1.0)
            ]
            return (after[0] - after[1]) / (2.0 * size)

        def moved(index: int, change: float) -> Context:
            work.SetTimeStateAndParametersFrom(start)
            numbers.write(work, index, x[index] + change)
            return work

        size = len(x)
        A, outputs = np.zeros((size, size)), np.zeros((2, len(self._joints), size))
        for index in range(size):
            self._tell_progress("differences of states", index, size)
            step = _STEP * max(1.0, abs(x[index]))
            A[:, index] = slope(functools.partial(moved, index), step)
            ends = [
                self._joint_values(moved(index, sign * step)) for sign in (1.0, -1.0)
            ]
            outputs[:, :, index] = (ends[0] - ends[1]) / (2.0 * step)
        columns = [
            slope(functools.partial(self._commanded, start, joint), _STEP)
            for joint in self._commanded_joints
        ]
        pushes = [
            slope(functools.partial(self._pushed, start, joint), _PUSH)
            for joint in self._joints
        ]
        noise = _ROUNDING / _STEP * np.maximum(1.0, np.abs(x))
        A[np.abs(A) < noise[:, None]] = 0.0
        B, E = (np.array(each).reshape(-1, size).T for each in (columns, pushes))
        return _Differences(numbers.names, A, B, E, *outputs)

    def _pushed(self, start: Context, joint: str, effort: float) -> Context:
        """Return a copy of a context in which an effort acts on a joint besides."""
        context = start.Clone()
        mine = self._plant.GetMyContextFromRoot(context)
        model = self._plant.GetModelInstanceByName(self._manager.robot.name)
        moved: Joint = self._plant.GetJointByName(joint, model)
        child, parent = moved.child_body(), moved.parent_body()
        X_WF = moved.frame_on_parent().CalcPoseInWorld(mine)
        is_prismatic = isinstance(moved, PrismaticJoint)
        axis = moved.translation_axis() if is_prismatic else moved.revolute_axis()
        along, zero = effort * (X_WF.rotation() @ axis), np.zeros(3)
        pushes = []
        for body, sign in ((child, 1.0), (parent, -1.0)):
            push = ExternallyAppliedSpatialForce()
            push.body_index = body.index()
            X_WB = self._plant.EvalBodyPoseInWorld(mine, body)
            push.p_BoBq_B = X_WB.inverse() @ X_WF.translation()
            parts = (zero, sign * along) if is_prismatic else (sign * along, zero)
            push.F_Bq_W = SpatialForce(*parts)
            pushes.append(push)
        port = self.simulation.diagram.GetInputPort("applied_spatial_force")
        port.FixValue(context, AbstractValue.Make(pushes))
        return context


def _input_of(name: str, topics: ControllerTopics) -> _Input | None:
    """Return a controller's input for positions, None if it has none."""
    system = topics.system
    if isinstance(system, JointPositionController):
        joints = tuple(each.split("/")[-2] for each in system.state_interfaces)
        return _Input(name, joints, topics, None)
    if system.HasInputPort(TOPIC):
        joints = tuple(
            dict.fromkeys(each.split("/")[-2] for each in system.command_interfaces)
        )

        def follow(values: Sequence[float]) -> tuple[str, Message]:
            point = JointTrajectoryPoint(tuple(values))
            made = JointTrajectory(joint_names=joints, points=(point,))
            return topics.make_trajectory(made)

        return _Input(name, joints, topics, follow)
    interfaces = system.reference_interfaces or system.command_interfaces
    if not interfaces or any(
        each.rpartition("/")[2] != POSITION for each in interfaces
    ):
        return None
    if not (system.HasInputPort(COMMANDS) or system.HasInputPort(REFERENCE)):
        return None
    joints = tuple(each.split("/")[-2] for each in interfaces)
    return _Input(name, joints, topics, topics.make_command)


def _references(state: Any, count: int) -> Array:
    """Return the positions that a controller goes to, shape (count,); NaN if none."""
    if isinstance(state, JointCommandState):
        return state.targets
    if isinstance(state, PidControllerState):
        return state.control.references[:count]
    if isinstance(state, JointTrajectoryState) and state.desired is not None:
        return np.asarray(state.desired.position)
    command = getattr(state, "command", None)
    return np.full(count, np.nan) if command is None else np.asarray(command)[:count]


class _Numbers:
    """The numbers of a diagram's state in one vector."""

    def __init__(
        self, diagram: Diagram, manager: ControllerManager, start: Context
    ) -> None:
        self._manager = manager
        groups = list(_name_groups(diagram, diagram.GetMyContextFromRoot(start), ""))
        self._ends = np.cumsum([0, *(size for _, size in groups)])
        names = [f"{name}[{i}]" for name, size in groups for i in range(size)]
        # An interface that nobody commands holds NaN: it says nothing of a motion.
        is_own = np.isfinite(_discrete_values(start))
        # What the manager writes in numbers is of its state, which is changed itself.
        written = [name for name, _ in groups].index(manager.get_name())
        is_own[self._ends[written] : self._ends[written + 1]] = False
        self._discrete = np.flatnonzero(is_own)
        self.names = [names[index] for index in self._discrete]
        state = manager.read_state(manager.GetMyContextFromRoot(start))
        own = {name for name, controller in _commanding(manager)}
        ticks = {name: tick for name, tick in state.ticks.items() if name in own}
        whole = [("values",), ("drive",), *(("ticks", name) for name in ticks)]
        # Where each number is: the path to its array, and its place in it.
        self._places = [
            (path, index)
            for root in whole
            for path, array in _find_arrays(_at(state, root), root)
            for index in range(array.size)
            if np.isfinite(array.flat[index])
        ]
        prefix = manager.get_name()
        self.names += [
            f"{prefix}.{'.'.join(map(str, path))}[{index}]"
            for path, index in self._places
        ]

    def read(self, context: Context) -> Array:
        """Return all numbers, shape (N,)."""
        value = self._manager.read_state(self._manager.GetMyContextFromRoot(context))
        arrays, rest = {}, []
        for path, index in self._places:
            if path not in arrays:
                arrays[path] = np.asarray(_at(value, path), dtype=float)
            rest.append(arrays[path].flat[index])
        numbers = _discrete_values(context)[self._discrete]
        return np.concatenate([numbers, np.array(rest)])

    def write(self, context: Context, index: int, value: float) -> None:
        """Set one number."""
        if index < len(self._discrete):
            place = int(self._discrete[index])
            group = int(np.searchsorted(self._ends, place, side="right")) - 1
            vector = context.get_mutable_discrete_state().get_mutable_vector(group)
            vector.SetAtIndex(place - int(self._ends[group]), value)
            return
        path, place = self._places[index - len(self._discrete)]
        mine = self._manager.GetMyMutableContextFromRoot(context)
        state = self._manager.read_state(mine)
        old = _at(state, path)
        new: Any = value
        if isinstance(old, np.ndarray):
            new = old.copy()
            new.flat[place] = value
        self._manager.write_state(mine, _with(state, path, new))


def _discrete_values(context: Context) -> Array:
    """Return the whole discrete state, shape (N,)."""
    state = context.get_discrete_state()
    groups = [state.get_vector(group).value() for group in range(state.num_groups())]
    return np.concatenate([np.empty(0), *groups])


def _commanding(manager: ControllerManager) -> Iterator[tuple[str, Any]]:
    for controller in manager.controllers:
        if controller.system is not None and controller.system.command_interfaces:
            yield controller.name, controller.system


def _name_groups(
    system: System, context: Context, prefix: str
) -> Iterator[tuple[str, int]]:
    """Yield name and size of the groups of discrete state, in a diagram's order."""
    if isinstance(system, Diagram):
        for part in system.GetSystems():
            name = f"{prefix}{part.get_name()}"
            inner = system.GetSubsystemContext(part, context)
            yield from _name_groups(
                part, inner, f"{name}/" if isinstance(part, Diagram) else name
            )
        return
    for group in range(context.num_discrete_state_groups()):
        yield prefix, context.get_discrete_state(group).size()


def _find_arrays(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[Any, Array]]:
    """Yield the numbers in nested tuples, by the path to them."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f":
            yield path, value
    elif type(value) is float:
        yield path, np.array(value)
    elif isinstance(value, tuple):
        names = getattr(value, "_fields", range(len(value)))
        for name, item in zip(names, value, strict=True):
            yield from _find_arrays(item, (*path, name))


def _at(value: Any, path: Sequence[Any]) -> Any:
    for key in path:
        is_field = isinstance(value, tuple) and isinstance(key, str)
        value = getattr(value, key) if is_field else value[key]
    return value


def _with(value: Any, path: Sequence[Any], new: Any) -> Any:
    """Return nested tuples and mappings with something else at a path."""
    if not path:
        return new
    key, *rest = path
    inner = _with(_at(value, [key]), rest, new)
    if isinstance(value, Mapping):
        return MappingProxyType({**value, key: inner})
    if isinstance(key, str):
        return value._replace(**{key: inner})
    return (*value[:key], inner, *value[key + 1 :])


def _reduce(whole: _Differences, outputs: Array) -> _Differences:
    """Return the map without states that are only held, or on which nothing depends."""
    names, A, B, E, C, F = whole
    own = A - np.diag(np.diag(A))
    is_constant = (np.abs(np.diag(A) - 1.0) < 1e-6) & ~own.any(axis=1)
    kept = np.flatnonzero(~is_constant | C.any(axis=0))
    while True:
        inner = A[np.ix_(kept, kept)]
        others = inner - np.diag(np.diag(inner))
        is_read = others.any(axis=0) | outputs[:, kept].any(axis=0)
        if is_read.all():
            return _Differences(
                [names[i] for i in kept],
                inner,
                B[kept],
                E[kept],
                C[:, kept],
                F[:, kept],
            )
        kept = kept[is_read]


def _find_margins(
    found: _Differences, index: int, step: float, *, is_discrete: bool
) -> Margins:
    """Return the margins of the loop that is broken at a joint's effort.

    An effort d beside it makes it T d; then T = -L / (1 + L), where L is the loop's.
    """
    top = math.pi / step
    at = np.geomspace(top * 1e-5, top, _GRID)
    z = np.exp(1j * at * step)
    T = transfer(found.A, found.E[:, index], found.F[index], z)
    if is_discrete:  # It is known of a state a tick later.
        T = T * z
    return margins_of(-T / (1.0 + T), at)
