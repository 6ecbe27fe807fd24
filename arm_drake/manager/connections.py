"""Connections of a robot's controllers: with each other, with topics, with logs."""

import itertools
import math
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    TickingController,
)
from arm_drake.controllers.cycles import Cycle
from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.description.report import LoadReport
from arm_drake.manager.steady_cycles import CycleNumbers
from arm_drake.python_system import PythonSystem

# Name of the log of commands, after "log:" and the prefix of their robot.
COMMAND_LOG = "commands"


def connect_chains(
    builder: DiagramBuilder, systems: Collection[ControllerInterface]
) -> None:
    """Connect the ticks of controllers that command or read each other.

    As in ros2_control, who commands comes before the commanded, and who exports before
    the reader; so all of them see this very tick. Where both can't be, because who
    exports is commanded by the reader, the reader sees the tick before.
    """
    # Whose ticks a controller's tick waits for.
    waits: dict[str, set[str]] = {system.get_name(): set() for system in systems}
    pairs = list(itertools.permutations(systems, 2))
    for first, second in pairs:
        if not set(first.command_interfaces).isdisjoint(second.reference_interfaces):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_predecessor(first))
            waits[second.get_name()].add(first.get_name())
    for first, second in pairs:
        if set(first.exported_interfaces).isdisjoint(second.state_interfaces):
            continue
        if (
            isinstance(first, TickingController)
            and isinstance(second, TickingController)
            and not _waits(first.get_name(), second.get_name(), waits)
        ):
            tick = first.GetOutputPort(interfaces.COMMAND_PORT)
            builder.Connect(tick, second.add_exporter_tick(first))
            waits[second.get_name()].add(first.get_name())
        else:
            exported = first.GetOutputPort(interfaces.EXPORT_PORT)
            builder.Connect(exported, second.add_exporter(first))


def _waits(name: str, other: str, waits: Mapping[str, Collection[str]]) -> bool:
    """Return whether a controller's tick waits for another's, over however many."""
    found, waiting = {name}, [name]
    while waiting:
        new = set(waits[waiting.pop()]) - found
        found |= new
        waiting += new
    return other in found


class SampledStates(PythonSystem):
    """Holds what was measured in the last tick of one slow controller.

    .. pydrake_system::

        name: SampledStates
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - state_interfaces
        - tick_time

    ==================  ====  ======  ==============================================
    port                size  unit    meaning
    ==================  ====  ======  ==============================================
    controller_manager  --    --      Cycle: which controllers tick
    state_interfaces    m     rad,    in: what is measured; out: the same, held since
                              rad/s,  the controller's last tick
                              N·m
    tick_time           1     ns      when that was; NaN before the first tick, and
                                      while the controller is inactive
    ==================  ====  ======  ==============================================

    The state is what the outputs show. It is a discrete update at the manager's period:
    Drake does these after the unrestricted updates of an instant, so the manager has
    run its cycle, tells of it and no more of the next one, and what is measured are the
    effects of its commands. A time is a whole number of nanoseconds, exact up to 2^53,
    which is 104 days.
    """

    def __init__(self, controller: str, num_measured: int, period: float) -> None:
        """Create it for m measured numbers and the manager's period [s]."""
        super().__init__()
        self._controller = controller
        self._manager = self.DeclareAbstractInputPort(
            interfaces.MANAGER_PORT, AbstractValue.Make(())
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        values = self.DeclareDiscreteState(num_measured)
        time = self.DeclareDiscreteState([math.nan])
        # Drake takes plain numbers quicker than its own kinds of index.
        self._values, self._time = int(values), int(time)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareStateOutputPort(interfaces.STATE_PORT, values)
        self.DeclareStateOutputPort(interfaces.TICK_PORT, time)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        cycle: Cycle = self._manager.Eval(context)
        if cycle.periods.get(self._controller):
            state.set_value(self._values, self._measured.Eval(context))
            state.set_value(self._time, [cycle.time_ns])
        elif self._controller not in cycle.active:
            state.set_value(self._time, [math.nan])


def exported_name(port: str, controller: str) -> str:
    """Return what a port is called in the diagram, without its robot's prefix.

    A name with a slash in front, as Gazebo's topics have, is its own. It is empty if
    the port is no topic.
    """
    if interfaces.is_internal(port):
        return ""
    return port if port.startswith("/") else f"{controller}.{port}"


# Topics of plugins that are called as ports that every robot has.
_LIKE_OWN_PORTS = ("/joint_states", "/frames")


def with_prefix(prefix: str, name: str) -> str:
    """Return an exported name with its robot's name in front, if several.

    A topic that would then be called as a port that every robot has, such as the
    positions `joint_states`, keeps its slash: `/<robot>/joint_states`.
    """
    slash = "/" if name in _LIKE_OWN_PORTS else ""
    return f"{slash}{prefix}{name.removeprefix('/')}" if prefix else name


def export_topics(
    builder: DiagramBuilder,
    systems: Mapping[str, ControllerInterface],
    prefix: str,
    report: LoadReport,
) -> None:
    """Export the ports of controllers that are topics: all but their interfaces.

    A topic with a name of its own may have several readers, and one publisher.
    """
    readers: set[str] = set()
    publishers: dict[str, str] = {}
    for name, system in systems.items():
        for index in range(system.num_input_ports()):
            port = system.get_input_port(index)
            topic = exported_name(port.get_name(), name)
            if topic in readers:
                builder.ConnectInput(with_prefix(prefix, topic), port)
            elif topic:
                builder.ExportInput(port, with_prefix(prefix, topic))
                readers.add(topic)
        for index in range(system.num_output_ports()):
            output = system.get_output_port(index)
            topic = exported_name(output.get_name(), name)
            first = publishers.setdefault(topic, name) if topic else name
            if first != name:
                where = f"controller {name!r}"
                what = f"publishes on the topic {topic!r}, as {first!r} does"
                done = f"what {first!r} publishes is there"
                report.add("warning", "unsupported", what, done, where=where)
            elif topic:
                builder.ExportOutput(output, with_prefix(prefix, topic))


class LoggedNumbers(NamedTuple):
    """Indices of the logged numbers of a cycle, one after the other."""

    # Values of command interfaces, and who is active.
    values: range
    active: range

    # References of controllers that command no positions, by controller.
    references: Mapping[str, range]

    @property
    def rows(self) -> list[int]:
        """All of them."""
        return [*self.values, *self.active, *itertools.chain(*self.references.values())]

    def split(self, rows: Array) -> tuple[Array, Array, dict[str, Array]]:
        """Return what rows of the log, shape (N, m), have of each."""
        sizes = map(len, (self.values, self.active, *self.references.values()))
        ends = list(itertools.accumulate(sizes))
        values, active, *references = np.split(rows, ends[:-1], axis=1)
        return values, active, dict(zip(self.references, references, strict=True))


def find_logged(
    systems: Mapping[str, ControllerInterface],
    numbers: CycleNumbers,
    remembered: Mapping[str, slice],
) -> LoggedNumbers:
    """Return what is logged of numbers; `remembered` is what each controller has."""
    references, start = {}, numbers.memory.start
    for name, system in systems.items():
        if joints := reference_joints(system):
            end = start + remembered[name].stop
            references[name] = range(end - len(joints), end)
    values, active = numbers.values, numbers.active
    return LoggedNumbers(
        range(values.start, values.stop), range(active.start, active.stop), references
    )


def reference_joints(system: ControllerInterface | None) -> tuple[str, ...]:
    """Return the joints whose reference is recorded by itself, if any are.

    It is of trajectory controllers that command efforts or velocities; of others it is
    what they command, which is recorded anyway. It is the last that they remember.
    """
    if not isinstance(system, JointTrajectoryController):
        return ()
    end = f"/{interfaces.POSITION}"
    if any(name.endswith(end) for name in system.command_interfaces):
        return ()
    states = system.state_interfaces
    return tuple(name.removesuffix(end) for name in states if name.endswith(end))
