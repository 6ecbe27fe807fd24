"""Which velocity a steered base is asked for by its topic, and where it is put.

The rules are those of ros2_controllers' `steering_controllers_library` (version 6.9.0).
"""

import math
from collections.abc import Iterable
from typing import NamedTuple, Self

from arm_drake.control.odometry import PlanarPose
from arm_drake.control.steering import BaseVelocity
from arm_drake.messages import (
    NANOSECONDS,
    Message,
    SetOdometry,
    TopicRejected,
    Twist,
    TwistStamped,
)
from arm_drake.messages.news import add_news


class SteeringReferences(NamedTuple):
    """What came in on the ports of a steered base; each method returns a new one."""

    # Velocity that is asked for, and as of when [ns]; None is nothing.
    asked: BaseVelocity | None = None
    stamp_ns: int = 0

    # Where the next tick is to put the base.
    pose: PlanarPose | None = None

    # What was on the ports at the last tick.
    messages: tuple[Message, ...] = ()
    requests: tuple[SetOdometry, ...] = ()

    # The latest messages that were not accepted, numbered, the newest last.
    events: tuple[tuple[int, TopicRejected], ...] = ()

    def put(self, requests: Iterable[SetOdometry]) -> Self:
        """Take requests to put the base somewhere."""
        state = self
        for request in requests:
            pose = PlanarPose(request.x, request.y, request.yaw)
            if all(map(math.isfinite, pose)):
                state = state._replace(pose=pose)
            else:
                fault = f"x, y and yaw must be finite, got {list(pose)}"
                state = state.reject(request, fault)
        return state

    def take(
        self,
        messages: Iterable[Message],
        time_ns: int,
        timeout_ns: int,
        obstacle: str = "",
    ) -> Self:
        """Take velocities of the topic: Twist or TwistStamped.

        One that isn't finite takes the last one away, as upstream does for NaN.

        Args:
            messages: They, the newest last.
            time_ns: When they came [ns].
            timeout_ns: Age beyond which none is taken [ns]; 0 is any.
            obstacle: Why none is taken; empty if they are.
        """
        state = self
        for message in messages:
            stamp_ns, twist = _read(message, time_ns)
            age_ns = time_ns - stamp_ns
            asked = BaseVelocity(twist.linear.x, twist.angular.z)
            if obstacle:
                state = state.reject(message, obstacle)
            elif 0 < timeout_ns < age_ns:
                state = state.reject(
                    message,
                    f"header.stamp must be at most {timeout_ns / NANOSECONDS} s "
                    f"(reference_timeout) old, got {age_ns / NANOSECONDS} s",
                )
            elif all(map(math.isfinite, asked)):
                state = state._replace(asked=asked, stamp_ns=stamp_ns)
            else:
                fault = f"linear.x and angular.z must be finite, got {list(asked)}"
                state = state._replace(asked=None).reject(message, fault)
        return state

    def current(self, time_ns: int, timeout_ns: int) -> BaseVelocity | None:
        """Return the velocity that is asked for; None if there is none or it is old.

        Args:
            time_ns: Time of the tick [ns].
            timeout_ns: Age beyond which it counts no more [ns]; 0 is any.
        """
        if 0 < timeout_ns < time_ns - self.stamp_ns:
            return None
        return self.asked

    def reject(self, message: Message, reason: str) -> Self:
        """Note that a message wasn't accepted."""
        events = add_news(self.events, [TopicRejected(message, reason)])
        return self._replace(events=events)


def _read(message: Message, time_ns: int) -> tuple[int, Twist]:
    """Return as of when [ns] a message holds, and its twist."""
    if isinstance(message, TwistStamped):
        return message.header.stamp.to_nanoseconds() or time_ns, message.twist
    assert isinstance(message, Twist)
    return time_ns, message
