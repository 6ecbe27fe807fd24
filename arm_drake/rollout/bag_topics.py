"""Which messages of ROS 2 tell what a rollout holds, and each of them once."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.joints import WORLD
from arm_drake.messages import NANOSECONDS
from arm_drake.rollout.bag_messages import (
    ACTIVE,
    DESCRIPTION,
    NUMBERS_TYPE,
    STATIC,
    BagMessage,
    fixed_frames,
    make_string,
    make_tf,
    tell_goal,
    tell_row,
    tell_sent,
)
from arm_drake.rollout.link_transforms import LinkTransform, base_pose, read_transforms
from arm_drake.rollout.rollout import Rollout
from arm_drake.rollout.static import make_static

# Frames are told at most so often [Hz], as robot_state_publisher does.
_TF_RATE = 50.0


class RobotTopics:
    """Tells the messages of one robot, part by part; nothing twice."""

    def __init__(self) -> None:
        """Create it, with nothing told."""
        self._last_ns = -1
        self._last_tf_ns = -NANOSECONDS
        self._static = self._active = ""
        self._description = ""
        self._transforms: tuple[LinkTransform, ...] = ()
        # Status of each goal as it was told last.
        self._goals: dict[int, str] = {}
        # Time of the last messages that were sent, and how many of that time are told.
        self._sent_at, self._num_sent = -math.inf, 0

    def tell(self, rollout: Rollout) -> Iterator[BagMessage]:
        """Yield the messages of what is new, not in the order of their times.

        Args:
            rollout: Goes on where the last one ended; rows that it had are left out.
        """
        times = np.round(rollout.time * NANOSECONDS).astype(np.int64)
        new = np.flatnonzero(times > self._last_ns)
        start = max(int(times[new[0]]) if len(new) else self._last_ns, 0)
        yield from self._tell_static(rollout, start)
        yield from self._tell_messages(rollout)
        yield from self._tell_goals(rollout)
        prefix = rollout.namespace
        for row in new:
            time_ns = int(times[row])
            yield from tell_row(rollout, int(row), time_ns, prefix)
            yield from self._tell_active(rollout, int(row), time_ns)
        yield from self._tell_tf(rollout, times, new)
        if len(new):
            self._last_ns = int(times[new[-1]])

    def _tell_static(self, rollout: Rollout, time_ns: int) -> Iterator[BagMessage]:
        prefix = rollout.namespace
        text = make_static(rollout, is_whole=False)
        if text != self._static:
            self._static = text
            yield make_string(f"{prefix}{STATIC}", time_ns, text)
        if rollout.description != self._description:
            self._description = rollout.description
            yield make_string(f"{prefix}{DESCRIPTION}", time_ns, rollout.description)
            try:
                pose = base_pose(rollout.info)
                self._transforms = read_transforms(rollout.description, pose)
            except ET.ParseError:
                return
            fixed = fixed_frames(rollout, self._transforms)
            if fixed:
                yield make_tf("/tf_static", fixed, time_ns, rollout.namespace)

    def _tell_messages(self, rollout: Rollout) -> Iterator[BagMessage]:
        known = [m for m in rollout.messages if m.time == self._sent_at]
        later = [m for m in rollout.messages if m.time > self._sent_at]
        for message in known[self._num_sent :] + later:
            yield from tell_sent(message, rollout.namespace)
        if rollout.messages:
            times = [message.time for message in rollout.messages]
            self._sent_at, self._num_sent = times[-1], times.count(times[-1])

    def _tell_goals(self, rollout: Rollout) -> Iterator[BagMessage]:
        for number, goal in enumerate(rollout.goals):
            known = self._goals.get(number, "")
            if known == goal.status:
                continue
            self._goals[number] = goal.status
            yield from tell_goal(goal, number, is_new=not known, rollout=rollout)

    def _tell_active(
        self, rollout: Rollout, row: int, time_ns: int
    ) -> Iterator[BagMessage]:
        active = rollout.active[row].tolist()
        if active and str(active) != self._active:
            self._active = str(active)
            yield BagMessage(
                f"{rollout.namespace}{ACTIVE}", NUMBERS_TYPE, time_ns, {"data": active}
            )

    def _tell_tf(
        self, rollout: Rollout, times: NDArray[np.int64], new: NDArray[np.int64]
    ) -> Iterator[BagMessage]:
        rows = []
        for row in new:
            if times[row] - self._last_tf_ns >= NANOSECONDS / _TF_RATE - 1:
                self._last_tf_ns = int(times[row])
                rows.append(int(row))
        frames = [
            (WORLD, link, poses[rows]) for link, poses in rollout.free_poses.items()
        ]
        columns = {name: column for column, name in enumerate(rollout.joint_names)}
        frames += [
            (
                each.parent,
                each.child,
                each.poses(rollout.position[rows, columns[each.joint]]),
            )
            for each in self._transforms
            if each.joint in columns
        ]
        for index, row in enumerate(rows):
            parts = [(parent, child, poses[index]) for parent, child, poses in frames]
            parts = [part for part in parts if np.all(np.isfinite(part[2]))]
            if parts:
                yield make_tf("/tf", parts, int(times[row]), rollout.namespace)
