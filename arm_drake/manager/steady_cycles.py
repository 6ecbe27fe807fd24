"""Steady cycles: those in which nothing comes, in the numbers of the discrete state.

A manager's full cycle leaves a state of Python objects. What comes after it in steady
cycles follows from it and from numbers alone, so they change numbers alone.
"""

import itertools
import math
import struct
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.cycles import NEVER_NS, STATE, SteadyTicks, with_field
from arm_drake.manager.claimants import Claimants
from arm_drake.manager.state import ManagerState


def _numbers(count: int) -> Any:
    """Return what reads and writes numbers in an array, as plain floats.

    Arrays of few numbers take longer to make. (Of type Any, for typing doesn't know
    that arrays are buffers.)
    """
    return struct.Struct(f"{count}d")


class CycleNumbers:
    """The numbers that a cycle writes, and where each of them stands.

    They are the number of the cycle; what the servo is told; the values of all command
    interfaces; 1 for each active controller, else 0; the rest of the drive vector, its
    rates; what controllers remember; and what was measured, 0 after a full cycle.
    """

    # Place of the first one.
    NUMBER = 0

    def __init__(
        self,
        *,
        num_servo: int,
        num_values: int,
        num_controllers: int,
        num_joints: int,
        num_remembered: int,
        num_motions: int,
    ) -> None:
        """Create it for n joints, k values, c controllers and so on."""
        sizes = (num_servo, num_values, num_controllers, num_joints, num_remembered)
        ends = list(itertools.accumulate((*sizes, num_motions), initial=1))
        self.servo, self.values, self.active, self.rates, self.memory, self.motions = (
            slice(*pair) for pair in itertools.pairwise(ends)
        )
        self.size = ends[-1]
        # The parts that a cycle needs of the last one, and all that it writes.
        self._positions = 8 * self.servo.start, _numbers(num_joints)
        self._rest = 8 * self.rates.start, _numbers(num_joints + num_remembered)
        self._all = _numbers(self.size)
        self._num_joints, self._num_motions = num_joints, num_motions

    def last(self, numbers: Array) -> tuple[Sequence[float], Sequence[float], Any]:
        """Return positions and rates of the drive vector, and what is remembered."""
        at, struct_of = self._positions
        positions = struct_of.unpack_from(numbers, at)
        at, struct_of = self._rest
        rest, n = struct_of.unpack_from(numbers, at), self._num_joints
        return positions, rest[:n], rest[n:]

    def write(
        self,
        numbers: Array,
        number: int,
        told: Sequence[Iterable[float]],
        motions: Array,
    ) -> None:
        """Write all of them; `told` are the parts in between, in their order."""
        servo, values, active, rates, memory = told
        # Where nobody active reads more, motions are less than there is room for.
        rest = [0.0] * (self._num_motions - len(motions))
        self._all.pack_into(
            numbers,
            0,
            number,
            *servo,
            *values,
            *active,
            *rates,
            *memory,
            *motions.tolist(),
            *rest,
        )


class _SteadyController(NamedTuple):
    """A controller that ticks steadily, and where its commands stand."""

    name: str
    system: TickingController[Any]
    ticks: SteadyTicks[Any]
    at: Sequence[int]

    # Where what it remembers stands; None if it doesn't.
    part: slice | None


# Where the ticks stand in the state.
_TICKS = ManagerState._fields.index("ticks")

# After so many cycles that weren't known others are computed ahead, this many times as
# many as there were since the last full one, and at most so many at once. They are in
# vain where a message comes before them, or where several Contexts take turns.
_NUM_BEFORE, _TIMES_AHEAD, _MOST_AHEAD = 8, 4, 128


class CyclesAhead(NamedTuple):
    """Cycles that follow from the state alone, if what is measured is allowed."""

    # Number of the first one, and times of all [ns].
    first: int
    times_ns: Sequence[int]

    # Where their numbers stand, those of each one, and as bytes what the cycle before
    # each has left there.
    place: slice
    rows: Array
    befores: Sequence[bytes]

    def find(self, number: int, numbers: Array) -> Array | None:
        """Return the numbers of a cycle; None if it doesn't go on from `numbers`."""
        index = number - self.first
        if not 0 <= index < len(self.rows):
            return None
        # Somebody may have written others, or may have gone back.
        if numbers[self.place].tobytes() != self.befores[index]:
            return None
        row: Array = self.rows[index]
        return row


class SteadyCycles:
    """Cycles from a state on in which nothing comes and nobody does anything new.

    Who reads the state in between has it made of the numbers of the last one.
    """

    def __init__(
        self,
        base: ManagerState,
        controllers: Sequence[_SteadyController],
        drive: DriveCommands,
        active: Sequence[float],
    ) -> None:
        """Create it for cycles after a state; `active` are the numbers that say so."""
        self._drive, self._active = drive, active
        self._values: list[float] = base.values.tolist()
        # Where commands stand, with a slice where they stand in a row.
        self._rows = [(_row(c.at), c.at) for c in controllers]
        # What is computed ahead, whether that can be, and how many weren't known.
        self._ahead: CyclesAhead | None = None
        self._has_ahead, self._num_unknown = True, 0
        self._take(base, controllers)

    def _take(
        self, base: ManagerState, controllers: Sequence[_SteadyController]
    ) -> None:
        """Take the state, and how controllers tick after it."""
        self.base, self._controllers = base, controllers
        self._commanding = [
            (c.ticks.command, c.part, *row)
            for c, row in zip(controllers, self._rows, strict=True)
        ]
        # From then on cycles take the full way [ns].
        self.until_ns = min((c.ticks.until_ns for c in controllers), default=NEVER_NS)
        # Somebody has to tell something then [ns].
        self.monitor_ns = min(
            (c.ticks.monitor_ns for c in controllers), default=NEVER_NS
        )
        # What is on the ports meanwhile, and whether they read more than motions.
        self.inputs = base.cycle.inputs
        self.reads_all = any(c.system.reads_all for c in controllers)
        # Those who judge what is measured in cycles that are known ahead.
        self._judging = [c.ticks for c in controllers if c.ticks.is_judging]
        self.is_judging = bool(self._judging)
        # The first cycle that isn't looked up.
        self.end_ahead = 0
        self._limit_ahead()

    @classmethod
    def after(
        cls,
        base: ManagerState,
        controllers: Collection[tuple[str, TickingController[Any]]] | None,
        claimants: Claimants,
        drive: DriveCommands,
        active: Sequence[float],
    ) -> Self | None:
        """Return the cycles after a state, by those that tick quietly; None if none."""
        cycle = base.cycle
        if controllers is None or base.failing or cycle.active is not base.active:
            return None
        if drive.has_limits:
            return None
        found = []
        for name, system in controllers:
            last = base.ticks[name]
            goes_on = last.number == cycle.number and last.inputs is cycle.inputs
            if not (goes_on and last.activation == base.active[name]):
                return None
            ticks = system.steady(last, cycle.time_ns)
            if ticks is None:
                return None
            at, part = claimants.places.get(name, ()), claimants.parts.get(name)
            found.append(_SteadyController(name, system, ticks, at, part))
        return cls(base, found, drive, active)

    def report(self, time_ns: int, last_ns: int, motions: Array) -> Self | None:
        """Return the cycles that go on after due reports; None if they end."""
        ticks, controllers = dict(self.base.ticks), list(self._controllers)
        for i, (name, system, steady, at, part) in enumerate(self._controllers):
            if time_ns >= steady.monitor_ns:
                resumed = steady.report(time_ns, last_ns, motions)
                if resumed is None:
                    return None
                ticks[name] = with_field(ticks[name], STATE, resumed[0])
                controllers[i] = _SteadyController(name, system, resumed[1], at, part)
        new = object.__new__(type(self))
        new._values, new._drive, new._rows = self._values, self._drive, self._rows
        new._active, new._has_ahead = self._active, self._has_ahead
        new._num_unknown = self._num_unknown
        new._ahead = self._ahead  # It doesn't hang on what has been told.
        new._take(with_field(self.base, _TICKS, ticks), controllers)
        return new

    def tick(
        self,
        time_ns: int,
        positions: Sequence[float],
        rates: Sequence[float],
        motions: Array,
        memory: list[float],
    ) -> tuple[Sequence[float], ...] | None:
        """Return what a cycle writes, the parts of `CycleNumbers`; None if it ends.

        `positions` and `rates` are of the last cycle's drive vector; `motions` is what
        is measured; `memory` what is remembered, which is renewed.
        """
        values = self._values.copy()
        for find, part, row, at in self._commanding:
            own = [] if part is None else memory[part]
            command = find(time_ns, motions, own)
            if part is not None:
                memory[part] = own
            if command is None:
                return None
            if row is not None and math.isfinite(sum(command)):
                values[row] = command
                continue
            for i, value in zip(at, command, strict=True):
                if math.isfinite(value):
                    values[i] = value
        servo, rates = self._drive.go_on(self.base.mode, values, positions, rates)
        return servo, values, self._active, rates, memory

    def look_ahead(
        self,
        number: int,
        find_time: Callable[[int], int],
        numbers: Array,
        layout: CycleNumbers,
    ) -> None:
        """Compute cycles ahead of one that wasn't known, if that can be and pays.

        `numbers` are what it has written.
        """
        ahead = self._ahead
        is_used_up = ahead is not None and number == ahead.first + len(ahead.rows)
        self._num_unknown += 1
        if not self._has_ahead or not (is_used_up or self._num_unknown >= _NUM_BEFORE):
            return
        self._num_unknown, num_before = 0, number - self.base.cycle.number
        end = number + 1 + min(_TIMES_AHEAD * num_before, _MOST_AHEAD)
        times = [find_time(later) for later in range(number + 1, end)]
        times = times[: bisect_left(times, self.until_ns)]
        if not times:
            return
        values = np.tile(np.array(self._values), (len(times), 1))
        for _, _, ticks, at, part in self._controllers:
            commands = None if part is not None else ticks.commands_ahead(times)
            if commands is None or not np.isfinite(commands).all():
                self._has_ahead = False
                return
            values[:, at] = commands
        positions, before, _ = layout.last(numbers)
        servo, rates = self._drive.go_on_for(self.base.mode, values, positions, before)
        place = slice(layout.servo.start, layout.memory.stop)
        start = numbers[place].copy()
        rows = np.tile(start, (len(values), 1))
        for part, found in (
            (layout.servo, servo),
            (layout.values, values),
            (layout.rates, rates),
        ):
            rows[:, part.start - place.start : part.stop - place.start] = found
        befores = [start.tobytes(), *map(np.ndarray.tobytes, rows[:-1])]
        self._ahead = CyclesAhead(number + 1, times, place, rows, befores)
        self._limit_ahead()

    def _limit_ahead(self) -> None:
        """End the cycles computed ahead where a report is due."""
        if self._ahead is not None:
            until_ns = min(self.until_ns, self.monitor_ns)
            end = bisect_left(self._ahead.times_ns, until_ns)
            self.end_ahead = self._ahead.first + end

    def find(self, number: int, numbers: Array) -> Array | None:
        """Return what a cycle writes if it is computed ahead, else None.

        `numbers` are those of the last cycle; it writes `CyclesAhead.place`.
        """
        return None if self._ahead is None else self._ahead.find(number, numbers)

    def allows(self, time_ns: int, motions: Array) -> bool:
        """Return whether a cycle that is known ahead is one, by what is measured."""
        return all(ticks.allows(time_ns, motions) for ticks in self._judging)

    def state(
        self, times: tuple[int, int], numbers: Array, layout: CycleNumbers
    ) -> ManagerState:
        """Return the state after one of these cycles, of the numbers it has written.

        `times` are its time and the time since the last one [ns].
        """
        base, time_ns, number = self.base, times[0], round(numbers[layout.NUMBER])
        memory, motions = numbers[layout.memory].tolist(), numbers[layout.motions]
        ticks = dict(base.ticks)
        for name, system, steady, _, part in self._controllers:
            last, own = ticks[name], () if part is None else memory[part]
            ticks[name] = system.resume(steady, last, number, time_ns, motions, own)
        cycle = base.cycle._replace(
            number=number,
            time_ns=time_ns,
            period_ns=times[1],
            chained=base.chained,
            commands=None,
            ticks={},
        )
        drive = np.concatenate((numbers[layout.servo], numbers[layout.rates]))
        values = numbers[layout.values].copy()
        return base._replace(cycle=cycle, values=values, drive=drive, ticks=ticks)


def _row(at: Sequence[int]) -> slice | None:
    """Return the slice that indices are; None if they don't stand in a row."""
    start = at[0] if at else 0
    is_row = list(at) == list(range(start, start + len(at)))
    return slice(start, start + len(at)) if is_row else None
