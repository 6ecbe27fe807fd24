"""What all controllers share: what they read and claim, and when they run."""

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
)

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.cycles import Cycle
from arm_drake.errors import InputError
from arm_drake.messages import NANOSECONDS
from arm_drake.python_system import PythonSystem

if TYPE_CHECKING:
    from arm_drake.control.admittance import ChainKinematics

# Returns what a controller exports.
_ReadExports = Callable[[Context], Array]


@dc.dataclass(frozen=True)
class ControllerInterfaceParams:
    """What a controller is given besides its parameters."""

    controller_name: str

    # Rate of its ticks [Hz].
    update_rate: int

    # Period of its events in Drake's time [s]: the manager's, or 1 / update_rate.
    period: float

    # URDF type of every movable joint of the robot.
    joint_types: Mapping[str, str]

    # What the hardware has, such as "joint1/position".
    command_interfaces: frozenset[str]
    state_interfaces: frozenset[str]

    # Order of the vector of all measured quantities.
    measured: tuple[str, ...]

    # State interfaces that hold anything but a double.
    other_types: frozenset[str] = frozenset()

    # Distribution whose behaviour holds.
    distro: str = "jazzy"

    # URDF velocity limit of joints [rad/s] or [m/s]; others have none.
    velocity_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # URDF effort limit of joints [N·m] or [N]; others have none.
    effort_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # Of each mimic joint: the joint that it follows in the end, and how far it moves
    # per unit of it.
    followed: Mapping[str, tuple[str, float]] = dc.field(default_factory=dict)

    # Where grippers' joints are open and where closed [rad] or [m].
    gripper_ranges: Mapping[str, tuple[float, float]] = dc.field(default_factory=dict)

    # Namespace of the controller's node; empty at the root.
    namespace: str = ""

    # Links of the robot.
    links: tuple[str, ...] = ()

    # Names that Gazebo's topics contain.
    robot_name: str = ""
    world_name: str = "empty"

    # Returns the kinematics of joints, seen from a link; None if it isn't known.
    make_kinematics: Callable[[Sequence[str], str], "ChainKinematics"] | None = None

    # Whether a manager keeps its state and says when it ticks; else it does so itself.
    is_managed: bool = False


class ControllerInterface(PythonSystem):
    """Base of all controllers: what they read, what they claim.

    A controller that reads no efforts is given none: its port ends after the
    velocities. Efforts take the servo's whole computation. A controller without an
    update of its own, `is_sampled`, is given everything, held from tick to tick; if it
    is slower than its manager, with the time of the tick.
    """

    is_sampled = False

    def __init__(
        self,
        params: ControllerInterfaceParams,
        *,
        state_interfaces: tuple[str, ...] = (),
        command_interfaces: tuple[str, ...] = (),
        reference_interfaces: tuple[str, ...] = (),
        exported_interfaces: tuple[str, ...] = (),
        limit_interfaces: Mapping[str, str] | None = None,
    ) -> None:
        """Create the system with the input ports that all controllers have.

        Args:
            params: Rate and surroundings of the controller.
            state_interfaces: What it reads, such as "joint1/position".
            command_interfaces: What it claims; another controller's references too.
            reference_interfaces: What other controllers may command of it, with its
                own name in front: "pid/joint1/position".
            exported_interfaces: What other controllers may read of it, likewise.
            limit_interfaces: Command interfaces that don't move a joint, but limit how
                it is moved: "effort" or "velocity", by name; 0 is no limit.
        """
        super().__init__()
        self.set_name(params.controller_name)
        self.params = params
        self.state_interfaces = state_interfaces
        self.command_interfaces = command_interfaces
        self.reference_interfaces = reference_interfaces
        self.exported_interfaces = exported_interfaces
        self.limit_interfaces = dict(limit_interfaces or {})
        order = {name: index for index, name in enumerate(params.measured)}
        num_measured = 2 * len(params.joint_types)
        self.reads_all = self.is_sampled or any(
            order.get(name, 0) >= num_measured for name in state_interfaces
        )
        if self.reads_all:
            num_measured = len(params.measured)
        self._manager = self.DeclareAbstractInputPort(
            interfaces.MANAGER_PORT, AbstractValue.Make(())
        )
        self._measured = self.DeclareVectorInputPort(
            interfaces.STATE_PORT, num_measured
        )
        # What controllers export, where it goes and where it stands there; and what
        # nobody has. The manager never starts a controller that lacks something,
        # but one that is inactive reads, too.
        self._exporters: list[tuple[_ReadExports, list[int], list[int]]] = []
        self._missing = dict.fromkeys(n for n in state_interfaces if n not in order)
        # Of those that are measured: where they go, and where they stand.
        self._measured_here = [i for i, n in enumerate(state_interfaces) if n in order]
        self._measured_there = [order[n] for n in state_interfaces if n in order]
        # What to index with if all are measured.
        self._read_at: slice | list[int] | None = None
        if not self._missing:
            self._read_at = _as_slice(self._measured_there)
        # At most one port with the time of the last tick.
        self._tick_times: list[InputPort] = []

    def add_tick_time(self) -> InputPort:
        """Declare the port with the time [ns] of what is sampled; NaN is nothing."""
        port = self.DeclareVectorInputPort(interfaces.TICK_PORT, 1)
        self._tick_times.append(port)
        return port

    def add_exporter(self, controller: "ControllerInterface") -> InputPort:
        """Declare the port of what a controller's last tick has exported.

        Args:
            controller: One whose exported interfaces are among the state interfaces.
        """
        names = controller.exported_interfaces
        name = f"{interfaces.EXPORT_PORT}:{controller.params.controller_name}"
        port = self.DeclareVectorInputPort(name, len(names))
        self._read_exports(names, port.Eval)
        return port

    def _read_exports(self, names: tuple[str, ...], read: _ReadExports) -> None:
        """Take state interfaces from another controller.

        Args:
            names: Names of all that it exports.
            read: Returns their values, in this order.
        """
        here = [i for i, name in enumerate(self.state_interfaces) if name in names]
        there = [names.index(self.state_interfaces[i]) for i in here]
        self._exporters.append((read, here, there))
        for name in names:
            self._missing.pop(name, None)

    def _read(self, context: Context) -> Array:
        """Return the measured `state_interfaces`; NaN where there is none.

        Raises:
            InputError: If there is none and no manager that keeps it inactive.
        """
        if self._read_at is not None:
            return self._measured.Eval(context)[self._read_at]
        if self._missing and not self._manager.HasValue(context):
            raise InputError(
                f"controller {self.params.controller_name!r}: no state interface "
                f"{', '.join(map(repr, self._missing))}; it has "
                f"{sorted(self.params.measured)}"
            )
        values = np.full(len(self.state_interfaces), np.nan)
        values[self._measured_here] = self._measured.Eval(context)[self._measured_there]
        for read, here, there in self._exporters:
            values[here] = read(context)[there]
        return values

    def _is_active(self, context: Context) -> bool:
        """Return whether the controller is active, as of the last cycle or this one."""
        if not self._manager.HasValue(context):
            return True
        cycle: Cycle = self._manager.Eval(context)
        return self.params.controller_name in cycle.active

    def _tick_time(self, number: int) -> int:
        """Return the time of a tick [ns]."""
        return number * NANOSECONDS // self.params.update_rate


def _as_slice(at: list[int]) -> slice | list[int]:
    """Return indices as a slice if they are in a row."""
    if at and at == list(range(at[0], at[0] + len(at))):
        return slice(at[0], at[0] + len(at))
    return at
