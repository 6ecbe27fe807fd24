"""Replays what upstream's gripper controllers did, tick by tick, and their news."""

from typing import Any

import pytest

from arm_drake.errors import ParameterError
from arm_drake.messages import (
    CancelGoal,
    CancelResponse,
    Goal,
    GoalEvent,
    GoalStatus,
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    ParallelGripperCommandGoal,
    Result,
    SendGoal,
)
from tests.conformance.open_loop import (
    Event,
    OpenLoop,
    is_started,
    numbers,
)
from tests.oracle import assert_close, oracle_cases

PARALLEL = oracle_cases("controller_gripper")
JAZZY = oracle_cases("controller_gripper_action_jazzy_4.42.1")
CASES = [*[("rolling", case) for case in PARALLEL], *[("jazzy", c) for c in JAZZY]]


def make_goal(inputs: dict[str, Any]) -> Goal:
    command = numbers(inputs["command"])
    if "max_effort" in command:
        return GripperCommandGoal(GripperCommand(**command))
    return ParallelGripperCommandGoal(JointState(**command))


class Client:
    """Sends the goals of a case, and knows them by their names."""

    def __init__(self) -> None:
        self.goals: dict[str, SendGoal] = {}

    def send(self, loop: OpenLoop, event: Event) -> None:
        request = SendGoal(make_goal(event["goal"]))
        self.goals[event["id"]] = request
        loop.send("gripper_cmd", request)

    def cancel(self, loop: OpenLoop, event: Event) -> None:
        # Also of a goal that wasn't sent.
        goal = self.goals.get(event["id"]) or SendGoal(GripperCommandGoal())
        loop.send("gripper_cmd", CancelGoal(goal))

    def name_of(self, event: GoalEvent | CancelResponse) -> str:
        request = event.request
        goal = request.request if isinstance(request, CancelGoal) else request
        return next(name for name, sent in self.goals.items() if sent is goal)


def kinds_of(event: Any) -> list[str]:
    """Return what the action server of the cases calls our news."""
    if isinstance(event, CancelResponse):
        return ["canceling" if event.accepted else "cancel_rejected"]
    if event.status is GoalStatus.EXECUTING:
        return ["accepted", "executing"]
    return [event.status.name.lower()]


def fields_of(result: Result | None) -> dict[str, Any]:
    if isinstance(result, GripperCommandResult):
        return vars(result)
    state = result.state
    return {
        "reached_goal": result.reached_goal,
        "stalled": result.stalled,
        "state": {
            "header": {"frame_id": "", "stamp": {"nanosec": 0, "sec": 0}},
            "name": list(state.name),
            "position": list(state.position),
            "velocity": list(state.velocity),
        },
    }


@pytest.mark.parametrize(
    ("distro", "case"), CASES, ids=lambda v: v if isinstance(v, str) else ""
)
def test_commands_and_news_are_upstream_s(distro: str, case: dict[str, Any]) -> None:
    inputs, expected, client = case["input"], case["output"], Client()
    handlers = {"goal": client.send, "cancel": client.cancel}
    if not is_started(expected):
        with pytest.raises(ParameterError):
            OpenLoop(inputs, expected, distro=distro, handlers=handlers)
        return
    loop = OpenLoop(inputs, expected, distro=distro, handlers=handlers)
    news: list[tuple[int, str, str, Any]] = []

    for cycle in loop.cycles():
        assert_close(loop.command, expected["command"][cycle], f"cycle {cycle}")
        assert loop.update_return == loop.expected_return(cycle), f"cycle {cycle}"
        events = [event for _, event in loop.output("events")]
        news += [
            (expected["t_ns"][cycle], kind, client.name_of(event), event)
            for event in events[len({id(n[3]) for n in news}) :]
            for kind in kinds_of(event)
        ]

    wanted = [
        (
            event["t_ns"],
            # A client hears of a goal whose handle is dropped as of one cancelled.
            event["event"].removesuffix("_by_destructor"),
            event["goal"],
        )
        for event in expected["events"]
    ]
    assert [row[:3] for row in news] == wanted
    for (*_, kind, _, event), row in zip(news, expected["events"], strict=True):
        if "result" in row:
            wanted_fields, ours = row["result"], fields_of(event.result)
            for name, value in wanted_fields.items():
                if isinstance(value, float):
                    assert_close(ours[name], value, f"{kind} {name}")
                else:
                    assert ours[name] == value, f"{kind} {name}"
