"""Scenarios in the form of the reference's, with outputs found by hand.

They have what the reference's don't: controllers that are inactive for a while, or
whose activation fails, and clients that cancel before they send.

One joint, 100 Hz, a plant that does what it is told at once. From 0 to 1 in 0.1 s a
trajectory moves by 0.1 per cycle; commands are a cycle ahead.
"""

from collections.abc import Sequence
from typing import Any

Dict = dict[str, Any]

START_NS, PERIOD_NS = 1_000_000_000, 10_000_000
JOINT = "j1"


def ns(cycle: int) -> int:
    return START_NS + cycle * PERIOD_NS


def make_trajectory(positions: Sequence[Any] = (1.0,), **fields: Any) -> Dict:
    time = {"sec": 0, "nanosec": 10 * PERIOD_NS}
    point = {"time_from_start": time, "positions": list(positions), **fields}
    return {"joint_names": [JOINT], "points": [point]}


def on_topic(cycle: int, message: Dict) -> Dict:
    return {
        "cycle": cycle,
        "type": "topic",
        "topic": "joint_trajectory",
        "msg": message,
    }


def send(cycle: int, name: str, **fields: Any) -> Dict:
    goal = {"trajectory": make_trajectory(), **fields}
    return {"cycle": cycle, "type": "goal", "id": name, "goal": goal}


def switch(cycle: int, kind: str) -> Dict:
    return {"cycle": cycle, "type": kind}


def answers_to(events: list[Dict], *answers: str) -> list[Dict]:
    """Return responses; answers are those to goals and cancels."""
    left = iter(answers)
    return [
        {"cycle": e["cycle"], "type": e["type"]}
        | ({"response": next(left)} if e["type"] in ("goal", "cancel") else {})
        for e in events
    ]


def happened(cycle: int, what: str, goal: str, **fields: Any) -> Dict:
    return {"t_ns": ns(cycle), "event": what, "goal": goal, **fields}


def make_scenario(
    name: str,
    events: list[Dict],
    commands: list[list[float]],
    *,
    interfaces: Sequence[str] = ("position",),
    inactive: range = range(0),
    activations: Sequence[str] = (),
    answers: Sequence[str] = (),
    news: Sequence[Dict] = (),
    columns: Dict | None = None,
) -> Dict:
    """Return a scenario with its output.

    Args:
        name: What it is called.
        events: What happens to the controller.
        commands: Values of the command interfaces after each cycle.
        interfaces: What is commanded and measured.
        inactive: Cycles without an update.
        activations: What becomes of those that `events` ask for.
        answers: To goals and cancels.
        news: What the action server tells.
        columns: Of controller_state, in active cycles.
    """
    names = [f"{JOINT}/{interface}" for interface in interfaces]
    cycles = range(len(commands))
    active = [k for k in cycles if k not in inactive]
    requested = iter(activations)
    lifecycle = [[START_NS, step, "SUCCESS"] for step in ("init", "configure")]
    lifecycle.append([START_NS, "activate", "SUCCESS"])
    lifecycle += [
        [
            ns(e["cycle"]),
            e["type"],
            next(requested) if e["type"] == "activate" else "SUCCESS",
        ]
        for e in events
        if e["type"] in ("activate", "deactivate")
    ]
    state = [[0.0] * len(names), *commands[:-1]]
    zero = [[0.0]] * len(active)
    table = {
        "t_ns": [ns(k) for k in active],
        "feedback_positions": [state[k][:1] for k in active],
        "error_positions": zero,
        "output_positions": [commands[k][:1] for k in active],
        "reference_accelerations": zero,
        "speed_scaling_factor": [1.0],
        **(columns or {}),
    }
    return {
        "input": make_input(name, events, interfaces),
        "output": {
            "lifecycle": lifecycle,
            "command_interfaces": names,
            "state_interfaces": names,
            "t_ns": [ns(k) for k in cycles],
            "period_ns": PERIOD_NS,
            "state": state,
            "command": commands,
            "update_return": ["inactive" if k in inactive else "OK" for k in cycles],
            "responses": answers_to(events, *answers),
            "events": list(news),
            "controller_state": table,
        },
    }


def make_input(name: str, events: list[Dict], interfaces: Sequence[str]) -> Dict:
    return {
        "name": name,
        "update_rate": 100,
        "params": {
            "joints": [JOINT],
            "command_interfaces": list(interfaces),
            "state_interfaces": list(interfaces),
        },
        "events": events,
        "urdf": f'<robot name="r"><joint name="{JOINT}" type="revolute"/></robot>',
    }


def deactivated_at_a_goal() -> Dict:
    aborted = {
        "error_code": -1,
        "error_string": "Current goal cancelled during deactivate transition.",
    }
    return make_scenario(
        "deactivated_at_a_goal",
        [
            send(3, "g1"),
            switch(6, "deactivate"),
            # Nobody looks at it: that its number isn't one doesn't matter.
            on_topic(7, make_trajectory(["nan"])),
            send(9, "g2"),
            switch(12, "activate"),
        ],
        [[0.0]] * 3 + [[0.1], [0.2]] + [[0.3]] * 10,
        inactive=range(6, 12),
        activations=["SUCCESS"],
        answers=["accepted", "rejected"],
        news=[
            happened(3, "accepted", "g1"),
            happened(3, "executing", "g1"),
            # The monitor looks every 50 ms.
            happened(8, "aborted", "g1", result=aborted),
            happened(9, "rejected", "g2"),
        ],
        columns={
            "reference_positions": [[q] for q in 4 * [0.0] + [0.1, 0.2] + 3 * [0.3]],
            "reference_velocities": [[v] for v in 3 * [0.0] + 3 * [10.0] + 3 * [0.0]],
            "reference_time_from_start_ns": [k * PERIOD_NS for k in 3 * [0, 1, 2]],
            "feedback_time_from_start_ns": [k * PERIOD_NS for k in 3 * [0, 1, 2]],
        },
    )


def deactivated_at_speed() -> Dict:
    moving = [[0.1, 10.0], [0.2, 10.0], [0.3, 10.0]]
    zeros = [[0.0]] * 4
    return make_scenario(
        "deactivated_at_speed",
        [
            on_topic(1, make_trajectory()),
            switch(4, "deactivate"),
            switch(6, "activate"),
        ],
        # A velocity ends with the activation, a position stays.
        [[0.0, 0.0], *moving, *[[0.3, 0.0]] * 4],
        interfaces=("position", "velocity"),
        inactive=range(4, 6),
        activations=["SUCCESS"],
        columns={
            "reference_positions": [[q] for q in (0.0, 0.0, 0.1, 0.2, 0.3, 0.3)],
            "reference_velocities": [[v] for v in (0.0, 10.0, 10.0, 10.0, 0.0, 0.0)],
            "feedback_velocities": [[v] for v in (0.0, 0.0, 10.0, 10.0, 0.0, 0.0)],
            "error_velocities": [[v] for v in (0.0, 10.0, 0.0, 0.0, 0.0, 0.0)],
            "output_velocities": [[0.0], *[[10.0]] * 3, *zeros[:2]],
        },
    )


def never_active_again() -> Dict:
    return make_scenario(
        "never_active_again",
        [
            # There is nothing to command an effort to, whatever their number is.
            on_topic(1, make_trajectory(effort=[1.0, 2.0])),
            switch(2, "deactivate"),
            switch(4, "activate"),
            send(5, "g1"),
        ],
        [[0.0]] * 6,
        inactive=range(2, 6),
        activations=["ERROR"],
        answers=["rejected"],
        news=[happened(5, "rejected", "g1")],
        columns={
            "reference_positions": [[0.0]] * 2,
            "reference_velocities": [[0.0]] * 2,
        },
    )


def cancelled_before_it_is_sent() -> Dict:
    tolerance = {"name": JOINT, "position": "inf"}
    cancel = {"cycle": 1, "type": "cancel", "id": "g1"}
    return make_scenario(
        "cancelled_before_it_is_sent",
        [cancel, send(2, "g1", path_tolerance=[tolerance]), send(3, "g1")],
        # The second goal starts from where the first one has led.
        [[0.0], [0.0], [0.1], [0.19], [0.28]],
        answers=["rejected", "accepted", "accepted"],
        news=[
            happened(1, "cancel_rejected", "g1"),
            happened(2, "accepted", "g1"),
            happened(2, "executing", "g1"),
            happened(3, "accepted", "g1"),
            happened(3, "executing", "g1"),
            happened(3, "aborted", "g1"),
        ],
        columns={
            "reference_positions": [[q] for q in (0.0, 0.0, 0.0, 0.1, 0.19)],
            "reference_velocities": [[v] for v in (0.0, 0.0, 10.0, 9.0, 9.0)],
        },
    )


def not_activated() -> Dict:
    steps = {"init": "SUCCESS", "configure": "SUCCESS", "activate": "ERROR"}
    return {
        "input": make_input("not_activated", [], ("position",)),
        "output": {
            "lifecycle": [[START_NS, *step] for step in steps.items()],
            "events": [],
        },
    }


OWN_SCENARIOS = [
    deactivated_at_a_goal(),
    deactivated_at_speed(),
    never_active_again(),
    cancelled_before_it_is_sent(),
    not_activated(),
]
