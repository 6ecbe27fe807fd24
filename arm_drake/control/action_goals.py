"""Goals of an action server of ros2_control: what it remembers of the one it executes.

Results wait for the goal's monitor, a timer that counts from its acceptance. If another
goal comes before it, the client of the first is told CANCELED, whatever the outcome
was. A goal that is cancelled after it ended, but before its monitor said so, is told
nothing until another goal comes, and then CANCELED.

Source: realtime_tools, `RealtimeServerGoalHandle`, as ros2_controllers use it.
"""

import dataclasses as dc

from arm_drake.importing import dataclass
from arm_drake.messages import (
    CancelGoal,
    CancelResponse,
    GoalEvent,
    GoalStatus,
    Message,
    Result,
    SendGoal,
)


@dataclass(frozen=True, eq=False)
class ActiveGoal(Message):
    """A goal that was accepted and whose result isn't delivered yet."""

    request: SendGoal

    # When it was accepted [ns].
    accepted_ns: int

    # When feedback or the result is due [ns].
    monitor_ns: int

    # How it ended.
    outcome: GoalEvent | None = None

    # Whether its client was told that it is being cancelled.
    is_canceling: bool = False

    @property
    def is_executing(self) -> bool:
        """Whether it hasn't ended."""
        return self.outcome is None

    @property
    def is_deliverable(self) -> bool:
        """Whether the monitor can tell how it ended."""
        outcome = self.outcome
        if outcome is None:
            return False
        return not self.is_canceling or outcome.status is GoalStatus.CANCELED

    def end(self, status: GoalStatus, result: Result, detail: str = "") -> "ActiveGoal":
        """Return the goal with its outcome; the monitor will tell."""
        event = GoalEvent(self.request, status, result, detail=detail)
        return dc.replace(self, outcome=event)

    def next_monitor(self, now_ns: int, period_ns: int) -> int:
        """Return when the monitor looks again after now [ns]."""
        period_ns = max(period_ns, 1)
        missed = (now_ns - self.monitor_ns) // period_ns
        return self.monitor_ns + (missed + 1) * period_ns


def answer_cancel(goal: ActiveGoal | None, request: CancelGoal) -> CancelResponse:
    """Return whether a goal can be cancelled."""
    if goal is None or goal.request is not request.request or goal.is_canceling:
        reason = "no such goal is being executed; it has ended, or was never accepted"
        return CancelResponse(request, False, reason)
    return CancelResponse(request, True)
