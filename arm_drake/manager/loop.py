"""A cycle of the controller manager: from what it holds and reads to what it writes."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.control.command_limits import CommandLimits
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.control.drive_mode import DriveMode
from arm_drake.controllers.cycles import Cycle
from arm_drake.manager.claims import Claimants
from arm_drake.manager.hardware_interfaces import Surroundings
from arm_drake.manager.lifecycle import Lifecycle
from arm_drake.manager.state import CommandLimited, ManagerState
from arm_drake.manager.ticks import News, Ticks
from arm_drake.messages import NANOSECONDS, SwitchController
from arm_drake.messages.news import add_news


class Readings(NamedTuple):
    """What the manager holds and reads at the start of a cycle."""

    held: ManagerState

    # What lies on the ports, old and new.
    news: News

    # Returns positions, velocities and efforts of all joints, shape (3 J,).
    measure: Callable[[], Array]

    @property
    def new_requests(self) -> tuple[SwitchController, ...]:
        """The requests that weren't there in the last cycle."""
        old = self.held.requests
        new = self.news.requests
        return tuple(r for r in new if not any(r is other for other in old))

    @property
    def is_switching(self) -> bool:
        """Whether controllers may start or end."""
        held = self.held
        return held.active is not held.cycle.active or (
            self.news.requests is not held.requests and bool(self.new_requests)
        )


class Loop:
    """The read-update-write loop of a robot."""

    def __init__(
        self,
        lifecycle: Lifecycle,
        claimants: Claimants,
        drive: DriveCommands,
        limits: CommandLimits | None,
        surroundings: Surroundings,
    ) -> None:
        """Create it.

        Args:
            lifecycle: What decides which controllers are active.
            claimants: The controllers that command something.
            drive: What makes the servo's input of commands.
            limits: What commands are held to, if they are.
            surroundings: Interfaces of the robot.
        """
        self._lifecycle = lifecycle
        self._claimants = claimants
        self._drive = drive
        self._limits = limits
        order = surroundings.measured
        self._measured_at = [
            [order.index(f"{joint}/{name}") for joint in drive.joints]
            for name in interfaces.STATE_INTERFACES
        ]

    def begin(
        self, readings: Readings, number: int, time_ns: int, period_ns: int
    ) -> Cycle:
        """Return what controllers are told in a cycle.

        Args:
            readings: What is held and read.
            number: Number of the cycle.
            time_ns: Its time [ns].
            period_ns: Time since the last one [ns].
        """
        held, values = readings.held, None
        active, chain = held.active, held.chained
        if readings.is_switching:
            plan = self._lifecycle.switch(held, readings.new_requests)
            active, chain = plan.active, plan.chained
            values, _ = self._seed(readings, plan.mode)
        periods = self._lifecycle.periods(held, active, time_ns)
        return Cycle(
            number,
            time_ns,
            period_ns,
            active,
            chain,
            periods,
            values,
            held.ticks,
            readings.news,
        )

    def finish(
        self, ticks: Ticks, asleep: frozenset[str], readings: Readings, cycle: Cycle
    ) -> ManagerState:
        """Return what a cycle leads to, once controllers have ticked.

        Args:
            ticks: What their ticks leave behind.
            asleep: Controllers that have nothing to do until something comes.
            readings: What is held and read.
            cycle: What the controllers were told.
        """
        held = readings.held
        active, chain, mode = held.active, held.chained, held.mode
        events, number = held.events, held.next_activation
        values, drive, fresh = held.values, held.drive, None
        if cycle.commands is None:
            values = values.copy()
        else:
            plan = self._lifecycle.switch(held, readings.new_requests)
            # The same as in the plan, and this very object.
            active, chain, mode = cycle.active, plan.chained, plan.mode
            events, number = add_news(events, plan.events), plan.next_activation
            _, drive = self._seed(readings, mode)
            values = cycle.commands.copy()
            fresh = self._claimants.fresh(cycle, held.cycle)
        failed = self._claimants.write(ticks, cycle, held.cycle, values)
        previous, all_limited = held.previous, held.limited
        if self._limits is not None:
            if fresh is not None:
                previous = self._claimants.forget(previous, cycle, held.cycle)
            previous, limited, lost = self._limits.apply(
                self._lifecycle.claims(active),
                values,
                readings.measure(),
                previous,
                cycle.period_ns / NANOSECONDS,
            )
            if lost:
                owners = self._claimants.owners(active, lost)
                self._claimants.restore(values, held.values, owners)
                failed |= owners
            news = [CommandLimited(j) for j in limited if j not in held.limited]
            if news:
                events = add_news(events, news)
                all_limited |= {event.joint for event in news}
        last_ns, skipped = held.last_ns, self._claimants.skipped(cycle)
        if cycle.periods:
            due = {n: cycle.time_ns for n, p in cycle.periods.items() if p}
            last_ns = {**last_ns, **due}
        drive = self._drive.write(mode, values, drive, fresh=fresh, skipped=skipped)
        failing = frozenset(failed)
        if failed and (failing != held.failing or self._lifecycle.ends_failed):
            active, number, told = self._lifecycle.replace(failed, active, number)
            events, chain = add_news(events, told), self._lifecycle.chained(active)
        return ManagerState(
            cycle,
            active,
            chain,
            mode,
            number,
            values,
            drive,
            last_ns,
            ticks,
            asleep,
            readings.news.requests,
            events,
            previous,
            all_limited,
            failing,
        )

    def _seed(self, readings: Readings, mode: DriveMode) -> tuple[Array, Array]:
        """Return the values and the drive vector with which a mode starts."""
        held = readings.held
        values, drive = held.values, held.drive
        if held.cycle.number < 0:
            return values, drive
        measured = readings.measure()
        q, v, tau = (measured[at] for at in self._measured_at)
        return self._drive.seed(held.mode, mode, values, drive, (q, v, tau))


class StoredStates:
    """State interfaces that follow a command interface of their name, or nothing."""

    def __init__(self, surroundings: Surroundings, commands: Sequence[str]) -> None:
        """Create it.

        Args:
            surroundings: Interfaces of the robot.
            commands: Names of the command values.
        """
        order = tuple(surroundings.stored)
        mirrored = [name for name in order if name in commands]
        self._here = [order.index(name) for name in mirrored]
        self._there = [commands.index(name) for name in mirrored]

    def update(self, stored: Array, values: Array) -> Array:
        """Return the states after commands; what was never commanded stays.

        Args:
            stored: The states before.
            values: Command values, shape (k,).
        """
        new, stored = values[self._there], stored.copy()
        stored[self._here] = np.where(np.isnan(new), stored[self._here], new)
        return stored


def initial_values(
    commands: Sequence[str], joints: Sequence[str], positions: Mapping[str, float]
) -> list[float]:
    """Return what command interfaces hold at first; NaN is nothing.

    Args:
        commands: Their names.
        joints: Joints of the drive; they hold their position.
        positions: Initial positions by joint [rad] or [m].
    """
    values = []
    for name in commands:
        joint, _, interface = name.rpartition("/")
        if joint not in joints:
            values.append(math.nan)
        elif interface == interfaces.POSITION:
            values.append(positions[joint])
        else:
            values.append(0.0)
    return values
