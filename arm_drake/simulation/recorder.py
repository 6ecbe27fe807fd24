"""Recorder: writes what a simulation records to a file while it runs."""

import dataclasses as dc
import math
from collections import defaultdict
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from arm_drake.errors import InputError, OutputError
from arm_drake.output_files import unbroken, writing
from arm_drake.rollout.formats import stream_writer_for
from arm_drake.rollout.rollout import Rollout
from arm_drake.simulation.directory import Directory
from arm_drake.simulation.mailbox import Mailbox
from arm_drake.simulation.motion import Motion
from arm_drake.simulation.recording import History, collect_rollout

# Times of rows are rounded to nanoseconds [s].
_SAME_TIME = 1e-9

# How often it writes [s] of simulated time.
PERIOD = 1.0


class Recorded(Protocol):
    """What is recorded: a Simulation."""

    directory: Directory
    mailbox: Mailbox

    # What was played, in order.
    motions: list[Motion]

    recorders: "list[Recorder]"


class Recorder:
    """Writes the rows, messages and goals of a simulation each simulated second.

    Whenever the program ends, even if it is killed, the file has all but what came
    after the last write. A simulation that is reset begins its file anew.
    """

    def __init__(
        self,
        simulation: Recorded,
        path: Path,
        *,
        robot: str | None = None,
        history: float = math.inf,
    ) -> None:
        """Start to record; `Simulation.record_to` does that.

        Args:
            simulation: The simulation.
            path: `.mcap` or `.csv` file to write.
            robot: Name of the robot; by default all, or the only one.
            history: How much of the past stays in memory at least [s].

        Raises:
            InputError: If there is no such robot, or the file can't be written.
            MissingExtraError: If what the file needs isn't installed.
        """
        if not history > 0.0:
            raise InputError(f"history must be positive, got {history!r}")
        self.path = path
        self._simulation = simulation
        self._make = stream_writer_for(path)
        self._robots = list(simulation.directory.managers)
        if robot is not None:
            self._robots = [simulation.directory.manager(robot).robot.name]
        if path.suffix == ".csv" and len(self._robots) > 1:
            names = ", ".join(self._robots)
            raise OutputError(
                f"a table is of one robot; expected robot=, one of {names}", file=path
            )
        if any(path.resolve() == r.path.resolve() for r in simulation.recorders):
            raise OutputError("it is being recorded to already", file=path)
        self.history = history
        self._history = History(simulation.mailbox, history)
        # What was before isn't recorded; the first write would find some of it.
        self._start: float | None = simulation.mailbox.time
        self._written = self._start
        self._open()
        simulation.recorders.append(self)

    def update(self) -> None:
        """Write what is new, if it has been a while."""
        if self._simulation.mailbox.time >= self._written + PERIOD:
            self.flush()

    def flush(self) -> None:
        """Write what is new.

        Raises:
            OutputError: If it can't be written.
        """
        # The last row may have been at the very time of the last write.
        simulation, since = self._simulation, self._written - PERIOD
        find = simulation.directory.manager
        parts = [
            collect_rollout(simulation.mailbox, find(robot), simulation.motions, since)
            for robot in self._robots
        ]
        if self._start is not None:
            parts = [_since(part, self._start) for part in parts]
        # What is half written would be lost, and all that follows with it.
        with unbroken():
            with writing(self.path):
                self._writer.write(*parts)
            self._written, self._start = self._simulation.mailbox.time, None
            self._count(parts)
            # What another one is to keep stays.
            others = self._simulation.recorders
            if all(other.history <= self.history for other in others):
                self._history.trim()

    def restart(self) -> None:
        """Begin the file anew, as the simulation begins anew."""
        self._writer.close()
        self._open()
        self._written, self._start = self._simulation.mailbox.time, None

    def close(self) -> None:
        """Write what is new, and end the file."""
        if self in self._simulation.recorders:
            self._simulation.recorders.remove(self)
            try:
                self.flush()
            finally:
                self._writer.close()

    def effort_saturation(self, robot: str) -> dict[str, float]:
        """Return how long joints were at their effort limit [s], by joint.

        It is as that of the Rollout, also of rows that are no longer in memory.

        Args:
            robot: Name of the robot.
        """
        return {joint: time for joint, time in self._saturation[robot].items() if time}

    def __enter__(self) -> Self:
        """Return itself; leaving the block ends the file."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the file."""
        self.close()

    def _open(self) -> None:
        with writing(self.path):
            self._writer = self._make(self.path)
        # The last row that was counted [s], and how long joints were at their limits.
        self._counted: dict[str, float] = defaultdict(lambda: -math.inf)
        self._saturation: dict[str, dict[str, float]] = defaultdict(
            lambda: defaultdict(float)
        )

    def _count(self, parts: list[Rollout]) -> None:
        """Add up how long joints were at their effort limits."""
        for robot, part in zip(self._robots, parts, strict=True):
            rows = part.time > self._counted[robot]
            if rows.any():
                self._counted[robot] = float(part.time[-1])
            for joint, time in part.time_at_limit(rows).items():
                self._saturation[robot][joint] += time


def _since(rollout: Rollout, time: float) -> Rollout:
    """Return a rollout without what was before a time [s]."""
    rows = rollout.time >= time - _SAME_TIME
    return dc.replace(
        rollout,
        time=rollout.time[rows],
        position=rollout.position[rows],
        velocity=rollout.velocity[rows],
        effort=rollout.effort[rows],
        command=rollout.command[rows],
        active=rollout.active[rows],
        references={
            name: dc.replace(reference, position=reference.position[rows])
            for name, reference in rollout.references.items()
        },
        free_poses={name: poses[rows] for name, poses in rollout.free_poses.items()},
        contact_forces={name: f[rows] for name, f in rollout.contact_forces.items()},
        goals=tuple(
            goal
            for goal in rollout.goals
            if goal.ended_at is None or goal.ended_at >= time
        ),
        messages=tuple(m for m in rollout.messages if m.time >= time - _SAME_TIME),
    )
