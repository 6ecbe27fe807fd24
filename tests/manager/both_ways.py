"""Computes cycles of a manager both ways: as it takes them, and in full."""

import dataclasses as dc
import functools
import itertools
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from arm_drake import interfaces
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.trajectory import Sample
from arm_drake.description.report import LoadReport
from arm_drake.manager import ControllerManager
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import GoalEvent


@dc.dataclass
class Count:
    """How many cycles were steady, and how many others were quiet or were neither.

    Of the steady ones some were computed ahead.
    """

    num_steady: int = 0
    num_ahead: int = 0
    num_quiet: int = 0
    num_full: int = 0

    @property
    def share(self) -> float:
        return 1.0 - self.num_full / self.total

    @property
    def steady_share(self) -> float:
        return self.num_steady / self.total

    @property
    def total(self) -> int:
        return self.num_steady + self.num_quiet + self.num_full


# Of what has others, which are made when somebody looks at them.
_NAMES = {
    GoalEvent: ("request", "status", "result", "feedback", "note"),
    Sample: (
        "position",
        "velocity",
        "acceleration",
        "effort",
        "segment_start",
        "segment_end",
    ),
    functools.partial: ("func", "args"),
}


@functools.cache
def _names_of(kind: type) -> tuple[str, ...]:
    """Return the names of what a value consists of, none if it has no parts."""
    for known, names in _NAMES.items():
        if issubclass(kind, known):
            return names
    if dc.is_dataclass(kind) and not issubclass(kind, tuple):
        return tuple(field.name for field in dc.fields(kind))
    return ()


def find_difference(one: Any, other: Any) -> str:
    """Return where two values differ in a bit; empty if they don't."""
    kind = type(one)
    if one is other or (kind is float and one == other != 0.0):
        return ""
    if kind is not type(other):
        return f": {one!r} and {other!r}"
    if kind is np.ndarray or issubclass(kind, np.ndarray | float):
        a, b = np.asarray(one), np.asarray(other)
        is_same = (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        return "" if is_same else f": {one!r} and {other!r}"
    if issubclass(kind, tuple):
        if len(one) != len(other):
            return f": {one!r} and {other!r}"
        parts = zip(one, other, strict=True)
        names: Iterable[Any] = getattr(kind, "_fields", itertools.count())
    elif issubclass(kind, dict):
        if list(one) != list(other):
            return f": {list(one)} and {list(other)}"
        parts, names = zip(one.values(), other.values(), strict=True), one
    elif names := _names_of(kind):
        parts = ((getattr(one, name), getattr(other, name)) for name in names)
    else:
        return "" if one == other else f": {one!r} and {other!r}"
    for name, (a, b) in zip(names, parts, strict=False):
        if a is not b and (difference := find_difference(a, b)):
            return f".{name}{difference}"
    return ""


def compare(count: Count, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compute each cycle in full, too, and compare."""
    tick_quietly = ControllerManager._tick_quietly
    go_on = ControllerManager._go_on
    tick_steadily = ControllerManager._tick_steadily

    def tick(manager: ControllerManager, context: Any, old: Any) -> Any:
        new = tick_quietly(manager, context, old)
        if new is None:
            count.num_full += 1
            return None
        count.num_quiet += 1
        difference = find_difference(new, manager._tick(context, old))
        assert not difference, difference
        return new

    def check(
        manager: ControllerManager, context: Any, steady: Any, numbers: Any
    ) -> None:
        # What is remembered of the latest state is of another one than the context's.
        remembered = vars(manager._quiet).copy()
        full = manager._tick(context, manager.read_state(context))
        vars(manager._quiet).update(remembered)
        full = full._replace(cycle=full.cycle._replace(ticks={}))
        difference = find_difference(manager._make_state(steady, numbers), full)
        assert not difference, difference
        # What a full cycle would have written, but for what was measured.
        written, at = manager._numbers_of(full), slice(manager.numbers.motions.start)
        assert written[at].tobytes() == numbers[at].tobytes()

    def tick_in_numbers(
        manager: ControllerManager, context: Any, steady: Any, numbers: Any
    ) -> Any:
        steady = tick_steadily(manager, context, steady, numbers)
        if steady is not None:
            count.num_steady += 1
            check(manager, context, steady, numbers)
        return steady

    def tick_ahead(
        manager: ControllerManager, context: Any, steady: Any, numbers: Any
    ) -> bool:
        is_known = go_on(manager, context, steady, numbers)
        if is_known:
            count.num_steady += 1
            count.num_ahead += 1
            check(manager, context, steady, numbers)
        return is_known

    monkeypatch.setattr(ControllerManager, "_go_on", tick_ahead)
    monkeypatch.setattr(ControllerManager, "_tick_quietly", tick)
    monkeypatch.setattr(ControllerManager, "_tick_steadily", tick_in_numbers)


class Managed:
    """A controller with a manager, and nothing else."""

    def __init__(self, system: Any, claims: tuple[str, ...], status: str) -> None:
        self.system, params = system, system.params
        joints, rate = tuple(params.joint_types), params.update_rate
        basic = interfaces.interface_names(joints, interfaces.STATE_INTERFACES)
        robot: Any = SimpleNamespace(
            controllers=SimpleNamespace(update_rate=rate, controllers=()),
            distro=params.distro,
        )
        offered = HardwareInterfaces(
            params.joint_types,
            claims,
            params.measured,
            dict.fromkeys(joints, 0.0),
            sensed=tuple(n for n in params.measured if n not in basic),
        )
        builder = DiagramBuilder()
        self.manager = ControllerManager(
            robot,
            [LoadedController(params.controller_name, "", status, system)],
            LoadReport(),
            prefix="",
            period=params.period,
            log_period=params.period,
            drive=DriveCommands(joints, claims, velocity_lead=0.05),
            hardware_interfaces=offered,
        )
        builder.AddSystem(self.manager)
        builder.AddSystem(system)
        self.manager.add_controller(builder, system)
        for part in (self.manager, system):
            for index in range(part.num_input_ports()):
                port = part.get_input_port(index)
                if not builder.IsConnectedOrExported(port):
                    name = f"{part.get_name()}.{port.get_name()}"
                    builder.ExportInput(port, name)
        self.manager.set_name("manager")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.simulator.Initialize()
        root = self.simulator.get_mutable_context()
        self.context = system.GetMyMutableContextFromRoot(root)

    def fix(self, system: Any, port: str, value: Any) -> None:
        context = system.GetMyMutableContextFromRoot(
            self.simulator.get_mutable_context()
        )
        if system.HasInputPort(port):
            system.GetInputPort(port).FixValue(context, value)

    def measure(self, measured: list[float]) -> None:
        """Put what is measured on all ports, in the order of the controller's own."""
        J = len(self.system.params.joint_types)
        size = self.system.GetInputPort(interfaces.STATE_PORT).size()
        self.fix(self.system, interfaces.STATE_PORT, measured[:size])
        self.fix(self.manager, interfaces.STATE_PORT, measured[: 3 * J])
        self.fix(self.manager, interfaces.MOTIONS_PORT, measured[: 2 * J])
        self.fix(self.manager, interfaces.MEASURED_PORT, measured)
