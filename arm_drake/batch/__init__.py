"""Many rollouts at a time: parameter studies, and tests of many cases."""

from arm_drake.batch.api import iterate_many, run_many
from arm_drake.batch.processes import RunError
from arm_drake.batch.runs import (
    GoalOutcome,
    Outcome,
    Run,
    RunResult,
    RunResults,
    RunsInterrupted,
)

__all__ = [
    "GoalOutcome",
    "Outcome",
    "Run",
    "RunError",
    "RunResult",
    "RunResults",
    "RunsInterrupted",
    "iterate_many",
    "run_many",
]
