"""Decisions of a controller manager in a cycle, without a diagram around it."""

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm_drake.control.drive_commands import DriveCommands
from arm_drake.controllers.cycles import Cycle, UpdateResult
from arm_drake.manager.claimants import Claimants
from arm_drake.manager.controller_manager import Readings, StoredStates, initial_values
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.manager.lifecycle import Lifecycle, ManagerInputs, Refusal
from arm_drake.manager.state import ControllerFailure, ManagerState
from arm_drake.manager.switching import ControllerInfo
from arm_drake.messages import SwitchController, SwitchControllerResult
from arm_drake.messages.base import NUM_KEPT, append_events

JOINTS = ("a", "b")
ORDER = ("a/position", "a/velocity", "b/position", "b/velocity", "low/a/position")

# Two that exclude each other, a chain of two, and one of another joint.
INFOS = {
    info.name: info
    for info in (
        ControllerInfo("arm", ("a/position",), joints=("a",)),
        ControllerInfo("speed", ("a/velocity",), joints=("a",)),
        ControllerInfo("top", ("low/a/position",)),
        ControllerInfo(
            "low", ("a/position",), reference_interfaces=("low/a/position",)
        ),
        ControllerInfo("hand", ("b/position",)),
        ControllerInfo("broken", is_configured=False),
    )
}
RATES = dict.fromkeys(INFOS, 100) | {"hand": 50}


def make_lifecycle(
    *,
    fallback: Mapping[str, tuple[str, ...]] | None = None,
    distro: str = "jazzy",
    refuse: Refusal | None = None,
    infos: Mapping[str, ControllerInfo] = INFOS,
) -> Lifecycle:
    return Lifecycle(
        infos,
        RATES,
        fallback or {},
        DriveCommands(JOINTS, ORDER, velocity_lead=0.05),
        update_rate=100,
        distro=distro,
        refuse=refuse,
    )


def start(lifecycle: Lifecycle, names: list[str]) -> ManagerState:
    return lifecycle.start(names, np.zeros(len(ORDER)), np.zeros(6 * len(JOINTS)))


def after_a_cycle(state: ManagerState, time_ns: int = 0) -> ManagerState:
    """Return the state after a cycle in which nothing happens."""
    cycle = Cycle(state.cycle.number + 1, time_ns, 10_000_000, state.active)
    return state._replace(cycle=cycle)


def test_at_first_those_that_start_are_active_in_their_order():
    state = start(make_lifecycle(), ["low", "top", "hand"])

    assert list(state.active) == ["low", "top", "hand"]
    assert len(set(state.active.values())) == 3
    assert state.next_activation > max(state.active.values())
    assert state.chained == {"low"}
    assert state.cycle.number == -1
    assert not state.cycle.active
    assert state.mode.is_position.tolist() == [True, True]


def test_a_switch_numbers_activations_anew():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["arm", "hand"]))
    request = SwitchController(("hand",), ("arm", "hand"))

    done = lifecycle.switch(state, [request])

    assert list(done.active) == ["hand"]
    assert done.active["hand"] not in state.active.values()
    assert done.next_activation > done.active["hand"]
    assert done.events == (SwitchControllerResult(request, True, ""),)
    assert done.mode.is_position.tolist() == [False, True]
    # What was held is as before.
    assert list(state.active) == ["arm", "hand"]


def test_requests_are_met_one_after_the_other():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["arm"]))
    requests = [
        SwitchController((), ("arm",), "strict"),
        SwitchController(("speed",), (), "strict"),
        SwitchController(("arm",), (), "strict"),
    ]

    done = lifecycle.switch(state, requests)

    assert list(done.active) == ["speed"]
    assert [event.ok for event in done.events] == [True, True, False]
    assert [event.request for event in done.events] == requests
    assert done.mode.is_velocity.tolist() == [True, False]


def test_without_requests_what_is_active_stays():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["arm", "hand"]))

    done = lifecycle.switch(state, [])

    assert done.active == state.active
    assert done.next_activation == state.next_activation
    assert done.events == ()


def test_a_follower_restarts_when_its_predecessor_comes_and_goes():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["low"]))

    chained = lifecycle.switch(state, [SwitchController(("top",))])
    alone = lifecycle.switch(
        state._replace(active=chained.active, next_activation=chained.next_activation),
        [SwitchController((), ("top",))],
    )

    assert (chained.chained, alone.chained) == ({"low"}, frozenset())
    numbers = [a["low"] for a in (state.active, chained.active, alone.active)]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize(
    ("distro", "strictness", "activated"),
    [
        ("jazzy", "", ["hand"]),
        ("rolling", "", []),
        ("rolling", "best_effort", ["hand"]),
        ("jazzy", "strict", []),
    ],
)
def test_a_request_that_does_not_say_how_strict_it_is_follows_the_manager(
    distro, strictness, activated
):
    lifecycle = make_lifecycle(distro=distro)
    request = SwitchController(("hand", "broken"), (), strictness)

    plan = lifecycle.judge([], request)

    assert list(plan.activate) == activated
    assert plan.problems == ("could not activate 'broken': it is not configured",)


def test_what_hardware_refuses_is_not_done():
    requested = []

    def refuse(start: Collection[str], stop: Collection[str]) -> str:
        requested.append((set(start), set(stop)))
        return "the hardware is busy"

    lifecycle = make_lifecycle(refuse=refuse)

    plan = lifecycle.judge(["arm"], SwitchController(("speed",), ("arm",)))

    assert requested == [({"a/velocity"}, {"a/position"})]
    assert (plan.activate, plan.deactivate, plan.ok) == ((), (), False)
    assert plan.problems == ("the hardware is busy",)


def test_hardware_is_not_asked_where_nothing_changes():
    def refuse(start: Collection[str], stop: Collection[str]) -> str:
        raise AssertionError((start, stop))

    lifecycle = make_lifecycle(refuse=refuse)

    plan = lifecycle.judge(["arm"], SwitchController(("elsewhere",), (), "strict"))

    assert plan.problems[0].startswith("no controller 'elsewhere'; ")


def test_only_those_with_a_rate_of_their_own_have_periods():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["arm", "hand"]))._replace(
        last_ns={"hand": 100_000_000}
    )

    at = {
        ms: lifecycle.periods(state, state.active, ms * 1_000_000) for ms in (110, 120)
    }

    assert at == {110: {"hand": 0}, 120: {"hand": 20_000_000}}
    assert lifecycle.periods(state, {"arm": 0}, 120_000_000) == {}


def test_a_new_activation_ticks_at_once():
    lifecycle = make_lifecycle()
    state = after_a_cycle(start(lifecycle, ["hand"]))._replace(
        last_ns={"hand": 100_000_000}
    )

    periods = lifecycle.periods(state, {"hand": 7}, 110_000_000)

    assert periods == {"hand": 20_000_000}


def test_one_that_fails_ends_with_its_chain_and_others_take_over():
    lifecycle = make_lifecycle(fallback={"top": ("speed",)}, distro="rolling")
    active = {"low": 0, "top": 1, "hand": 2}

    remaining, number, news = lifecycle.replace({"top": ""}, active, 3)

    assert remaining == {"hand": 2, "speed": 3}
    assert number == 4
    (failure,) = news
    assert failure.controller == "top"
    assert sorted(failure.deactivated) == ["low", "top"]
    assert failure.activated == ("speed",)
    assert active == {"low": 0, "top": 1, "hand": 2}


def test_a_fallback_that_can_not_start_is_left_out():
    lifecycle = make_lifecycle(fallback={"arm": ("broken", "hand")})

    remaining, number, news = lifecycle.replace(
        dict.fromkeys(["arm"], ""), {"arm": 0, "hand": 1}, 2
    )

    assert (remaining, number) == ({"hand": 1}, 2)
    (failure,) = news
    assert (failure.deactivated, failure.activated) == (("arm",), ())
    assert [problem.partition(":")[2] for problem in failure.problems] == [
        " it is not configured",
        " it is already active",
    ]


@pytest.mark.parametrize("distro", ["jazzy", "kilted"])
def test_up_to_kilted_a_chain_stays_without_the_one_that_fails(distro):
    lifecycle = make_lifecycle(distro=distro)

    remaining, _, news = lifecycle.replace({"top": ""}, {"low": 0, "top": 1}, 2)

    assert remaining == {"low": 0}
    assert news == (ControllerFailure("top", ("top",)),)


def test_in_humble_one_that_fails_stays_active():
    lifecycle = make_lifecycle(distro="humble")

    remaining, number, news = lifecycle.replace({"arm": "why"}, {"arm": 0}, 1)

    assert (remaining, number) == ({"arm": 0}, 1)
    assert news == (ControllerFailure("arm", (), reason="why"),)


def test_of_a_chain_that_fails_each_is_reported_and_ends_once():
    lifecycle = make_lifecycle(distro="rolling")

    remaining, _, news = lifecycle.replace(
        dict.fromkeys(["top", "low"], ""), {"low": 0, "top": 1}, 2
    )

    assert remaining == {}
    assert [failure.controller for failure in news] == ["top", "low"]
    ended = [name for failure in news for name in failure.deactivated]
    assert sorted(ended) == ["low", "top"]


CHAIN_OF_FOUR = {
    str(k): ControllerInfo(
        str(k), (f"{k + 1}/x",), reference_interfaces=(f"{k}/x",) if k else ()
    )
    for k in range(4)
}


@pytest.mark.parametrize("failed", CHAIN_OF_FOUR)
def test_a_chain_ends_whole_whoever_fails(failed):
    lifecycle = make_lifecycle(infos={**INFOS, **CHAIN_OF_FOUR}, distro="rolling")
    active = {"hand": 0} | dict.fromkeys(CHAIN_OF_FOUR, 1)

    remaining, _, (failure,) = lifecycle.replace({failed: ""}, active, 2)

    assert remaining == {"hand": 0}
    assert sorted(failure.deactivated) == list(CHAIN_OF_FOUR)


def test_those_that_another_one_commands_are_chained():
    lifecycle = make_lifecycle()

    assert lifecycle.chained(["low", "top", "hand"]) == {"low"}
    assert lifecycle.chained(["low", "hand"]) == frozenset()


def test_a_state_of_the_manager_is_not_copied():
    state = start(make_lifecycle(), ["arm"])

    assert copy.deepcopy(state) is state


def test_claims_have_the_rates_of_their_controllers():
    claims = make_lifecycle().claims(["hand", "top"])

    assert claims == {"b/position": 50.0, "low/a/position": 100.0}


def test_what_is_claimed_is_in_the_order_of_activation():
    claimed = make_lifecycle().claimed({"hand": 5, "top": 9, "low": 2})

    assert claimed == ("a/position", "b/position", "low/a/position")


def test_the_latest_events_are_kept_with_their_numbers():
    num_news = NUM_KEPT + 36
    news = [ControllerFailure(str(number), ()) for number in range(num_news)]

    one_by_one = ()
    for event in news:
        one_by_one = append_events(one_by_one, [event])
    at_once = append_events((), news)

    assert one_by_one == at_once == tuple(enumerate(news))[-NUM_KEPT:]
    assert append_events(at_once, ()) == at_once


def readings(state: ManagerState, requests: tuple[SwitchController, ...]) -> Readings:
    def measure() -> np.ndarray:
        raise AssertionError("not needed")

    return Readings(state, ManagerInputs(requests, ()), measure)


def test_a_request_counts_once_and_an_equal_one_again():
    old, equal = (SwitchController(("hand",)) for _ in range(2))
    state = after_a_cycle(start(make_lifecycle(), ["arm"]))._replace(requests=(old,))

    again = readings(state, (old,))
    another = readings(state, (old, equal))

    assert (again.new_requests, again.is_switching) == ((), False)
    assert another.is_switching
    (new,) = another.new_requests
    assert new is equal


def test_what_starts_with_the_first_cycle_is_a_switch():
    state = start(make_lifecycle(), ["arm"])

    assert readings(state, ()).is_switching
    assert not readings(after_a_cycle(state), ()).is_switching


class Claims:
    """Claimants of some controllers."""

    def __init__(self, **claims: tuple[str, ...]) -> None:
        systems: Any = {
            name: SimpleNamespace(command_interfaces=names)
            for name, names in claims.items()
        }
        self.claimants = Claimants(systems, ORDER, JOINTS)

    def write(
        self,
        active: Collection[str],
        last: Collection[str] | None = None,
        *,
        commands: bool = False,
        failed: Collection[str] = (),
        **ticks: Sequence[float],
    ) -> tuple[list[float], dict[str, str]]:
        """Return values that were all 9, and who failed, after a cycle."""
        # What isn't there isn't to be read.
        there = {
            name: UpdateResult(1, 0, None, np.array(command), name not in failed)
            for name, command in ticks.items()
        }
        values = np.full(len(ORDER), 9.0)
        cycle = make_cycle(active)
        if commands:
            cycle = cycle._replace(commands=np.zeros(len(ORDER)))
        before = make_cycle(active if last is None else last)
        faults = self.claimants.write(there, cycle, before, values)
        return values.tolist(), faults


def make_cycle(active: Collection[str], **periods: int) -> Cycle:
    numbers = {name: number for number, name in enumerate(active)}
    return Cycle(1, 0, 10_000_000, numbers, periods=periods)


def test_active_controllers_write_their_claims():
    claims = Claims(arm=("b/position", "a/position"), top=("low/a/position",), no=ORDER)

    values, failed = claims.write(["arm", "top"], arm=[2.0, 1.0], top=[3.0])

    assert values == [1.0, 9.0, 2.0, 9.0, 3.0]
    assert failed == {}


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_not_written(bad):
    claims = Claims(arm=("a/position", "b/position"))

    values, failed = claims.write(["arm"], arm=[bad, 0.5])

    assert values == [9.0, 9.0, 0.5, 9.0, 9.0]
    assert failed == {}


@pytest.mark.parametrize(
    ("commands", "written"),
    [((math.inf, -math.inf), (9.0, 9.0)), ((1.5e308, 1.5e308), (1.5e308, 1.5e308))],
)
def test_commands_are_finite_or_not_each_by_itself(commands, written):
    claims = Claims(arm=("a/position", "b/position"))

    values, _ = claims.write(["arm"], arm=commands)

    assert values == [written[0], 9.0, written[1], 9.0, 9.0]


def test_what_a_controller_writes_when_it_ends_is_overwritten_by_the_next():
    claims = Claims(new=("a/velocity", "b/velocity"), old=("a/velocity", "b/velocity"))

    values, _ = claims.write(
        ["new"], ["old"], commands=True, old=[0.0, 0.0], new=[0.7, math.nan]
    )

    assert values == [9.0, 0.7, 9.0, 0.0, 9.0]


def test_those_whose_update_fails_are_named_and_write_all_the_same():
    claims = Claims(arm=("a/velocity",), hand=("b/velocity",))

    values, failed = claims.write(
        ["arm", "hand"], failed=["arm"], arm=[0.0], hand=[0.5]
    )

    assert list(failed) == ["arm"]
    assert values == [9.0, 0.0, 9.0, 0.5, 9.0]


@pytest.mark.parametrize(
    ("joints", "owners"), [(["a"], ["arm"]), (["b", "a"], ["arm", "hand"]), ([], [])]
)
def test_the_owner_of_a_joint_is_who_commands_it(joints, owners):
    claims = Claims(
        arm=("a/position",), hand=("b/position",), idle=("a/velocity", "b/velocity")
    ).claimants

    found = claims.owners(["arm", "hand"], dict.fromkeys(joints, "lost"))

    assert sorted(found) == owners


def test_joints_whose_controller_started_or_ended_are_fresh():
    claims = Claims(arm=("a/position",), hand=("b/position",), top=("low/a/position",))
    idle, both = make_cycle([]), make_cycle(["arm", "hand"])
    restarted = both._replace(active={"arm": 0, "hand": 5})

    found = [
        claims.claimants.fresh(now, last).tolist()
        for now, last in ((both, idle), (both, both), (idle, both), (restarted, both))
    ]

    assert found == [[True, True], [False, False], [True, True], [False, True]]
    # A reference of another controller is no joint.
    chained = make_cycle(["top"])
    assert claims.claimants.fresh(chained, idle).tolist() == [False, False]


def test_joints_whose_controller_does_not_tick_are_skipped():
    claims = Claims(arm=("a/position",), hand=("b/position",)).claimants

    assert not claims.skipped(make_cycle(["arm", "hand"])).any()
    found = [claims.skipped(make_cycle(["hand"], hand=ns)) for ns in (0, 20_000_000)]
    assert [mask.tolist() for mask in found] == [[False, True], [False, False]]


def test_of_joints_with_a_new_controller_nothing_is_remembered():
    claims = Claims(arm=("a/position",), hand=("b/position",)).claimants
    previous: Any = {"a": 1, "b": 2, "wheel": 3}

    kept = claims.forget(previous, make_cycle(["hand", "arm"]), make_cycle(["hand"]))

    assert kept == {"b": 2, "wheel": 3}


def test_what_controllers_wrote_can_be_undone():
    claims = Claims(arm=("a/position",), hand=("b/position",)).claimants
    values, before = np.full(5, 9.0), np.arange(5.0)

    claims.restore(values, before, {"hand"})

    assert values.tolist() == [9.0, 9.0, 2.0, 9.0, 9.0]


def test_stored_states_follow_commands_of_their_name():
    stored = {"tool/out": math.nan, "imu/x": 0.5, "tool/level": 2.0}
    hardware_interfaces = HardwareInterfaces({}, (), (), {}, stored)
    states = StoredStates(hardware_interfaces, ("a/position", "tool/level", "tool/out"))

    before = np.array([*stored.values()])
    first = states.update(before, np.array([7.0, math.nan, 1.5]))
    second = states.update(first, np.array([7.0, 3.0, math.nan]))

    assert first.tolist() == [1.5, 0.5, 2.0]
    assert second.tolist() == [1.5, 0.5, 3.0]
    np.testing.assert_array_equal(before, [math.nan, 0.5, 2.0])


def test_command_interfaces_of_joints_start_where_they_hold():
    names = ("a/position", "a/velocity", "b/effort", "tool/out", "low/a/position")

    values = initial_values(names, JOINTS, {"a": 0.3, "b": -0.2})

    unknown = pytest.approx(math.nan, nan_ok=True)
    assert values == [0.3, 0.0, 0.0, unknown, unknown]
