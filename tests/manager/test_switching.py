import pytest

from arm_drake.manager.switching import (
    ControllerInfo,
    SwitchPlan,
    activation_order,
    chain_of,
    chained,
    find_cycle,
    plan_switch,
)

# The chain of upstream's tests: a base over a controller for each wheel, and another
# one that commands the base; a controller that claims a wheel too; a broadcaster.
LEFT = ControllerInfo("left", ("wheel1/velocity",), (), ("left/velocity",))
RIGHT = ControllerInfo("right", ("wheel2/velocity",), (), ("right/velocity",))
BASE = ControllerInfo("base", ("left/velocity", "right/velocity"), (), ("base/speed",))
PILOT = ControllerInfo("pilot", ("base/speed",))
TEST = ControllerInfo("test", ("arm/position", "wheel1/velocity"))
STATES = ControllerInfo("states", (), ("wheel1/velocity",))
NEW = ControllerInfo("new", ("wheel1/velocity",), is_configured=False)
BROKEN = ControllerInfo(
    "broken",
    ("elbow/effort",),
    missing=("no joint 'elbow'", "no interface 'effort'"),
)
CONTROLLERS = {c.name: c for c in (PILOT, BASE, LEFT, RIGHT, TEST, STATES, NEW, BROKEN)}
KNOWN = "known: base, broken, left, new, pilot, right, states, test"


def plan(
    activate="",
    deactivate="",
    *,
    active="",
    strict=True,
    controllers=CONTROLLERS,
    is_humble=False,
) -> SwitchPlan:
    """Return a plan; names are separated by blanks."""
    return plan_switch(
        controllers,
        active.split(),
        activate.split(),
        deactivate.split(),
        strict=strict,
        is_humble=is_humble,
    )


both = pytest.mark.parametrize("strict", [True, False])


# What goes


@both
def test_controllers_are_activated_and_deactivated(strict):
    result = plan("test", "left states", active="left states right", strict=strict)

    assert result == SwitchPlan(("test",), ("left", "states"), True, ())


@both
def test_nothing_asked_for_is_ok(strict):
    assert plan(strict=strict) == SwitchPlan((), (), True, ())


@both
def test_a_controller_in_both_lists_restarts(strict):
    result = plan("test", "test", active="test", strict=strict)

    assert result == SwitchPlan(("test",), ("test",), True, ())


@both
def test_followers_are_activated_first_and_predecessors_deactivated_first(strict):
    up = plan("pilot base states right left", strict=strict)
    down = plan(
        deactivate="left base states pilot right",
        active="pilot base left right states",
        strict=strict,
    )

    assert up == SwitchPlan(("left", "right", "base", "pilot", "states"), (), True, ())
    assert down == SwitchPlan(
        (), ("pilot", "base", "left", "states", "right"), True, ()
    )


@both
def test_a_whole_chain_can_restart(strict):
    names = "left right base"

    result = plan(names, names, active=names, strict=strict)

    order = ("left", "right", "base")
    assert result == SwitchPlan(order, ("base", "left", "right"), True, ())


@both
def test_a_follower_restarts_when_its_chained_mode_begins(strict):
    result = plan("base", active="right left", strict=strict)

    assert result == SwitchPlan(("base",), (), True, (), ("left", "right"))


@both
def test_a_follower_restarts_when_its_chained_mode_ends(strict):
    result = plan("", "pilot", active="pilot base left right", strict=strict)

    assert result == SwitchPlan((), ("pilot",), True, (), ("base",))


@both
def test_a_follower_that_only_changes_its_predecessor_does_not_restart(strict):
    other = ControllerInfo("other", ("base/speed",))
    result = plan(
        "other",
        "pilot",
        active="pilot base left right",
        strict=strict,
        controllers={**CONTROLLERS, "other": other},
    )

    assert result == SwitchPlan(("other",), ("pilot",), True, ())


@both
def test_a_controller_named_twice_is_taken_once(strict):
    result = plan("test test", "left left", active="left", strict=strict)

    assert result == SwitchPlan(("test",), ("left",), True, ())


# What does not, one by one


UNKNOWN = f"no controller 'lfet'; did you mean 'left'? {KNOWN}"


@pytest.mark.parametrize(
    ("activate", "deactivate", "active", "problems"),
    [
        ("lfet", "", "", [UNKNOWN]),
        ("", "lfet", "", [UNKNOWN]),
        ("new", "", "", ["could not activate 'new': it is not configured"]),
        ("", "new", "", ["could not deactivate 'new': it is not configured"]),
        (
            "broken",
            "",
            "",
            [
                "could not activate 'broken': no joint 'elbow'",
                "could not activate 'broken': no interface 'effort'",
            ],
        ),
        (
            "test",
            "",
            "states left",
            [
                "could not activate 'test': 'wheel1/velocity' is claimed by 'left', "
                "which stays active"
            ],
        ),
        (
            "pilot",
            "",
            "left right",
            [
                "could not activate 'pilot': 'base/speed' belongs to 'base', "
                "which is not active"
            ],
        ),
        (
            "",
            "left",
            "base left right",
            [
                "could not deactivate 'left': 'base', which uses 'left/velocity', "
                "stays active"
            ],
        ),
    ],
)
@both
def test_a_request_that_can_not_be_met_changes_nothing(
    activate, deactivate, active, problems, strict
):
    result = plan(activate, deactivate, active=active, strict=strict)

    assert result == SwitchPlan((), (), False, tuple(problems))


ACTIVE_ALREADY = "could not activate 'test': it is already active"
NOT_ACTIVE = "could not deactivate 'test': it is not active"


@pytest.mark.parametrize(
    ("activate", "deactivate", "active", "problem"),
    [("test", "", "test", ACTIVE_ALREADY), ("", "test", "left", NOT_ACTIVE)],
)
@both
def test_being_there_already_is_a_problem_for_a_strict_switch_only(
    activate, deactivate, active, problem, strict
):
    result = plan(activate, deactivate, active=active, strict=strict)

    assert result == SwitchPlan((), (), not strict, (problem,))


LEFT_TOO = (
    "could not activate 'left': 'wheel1/velocity' is claimed by 'test', which is "
    "activated too"
)


def test_two_that_claim_the_same_can_not_start_together():
    result = plan("test left")

    assert result == SwitchPlan((), (), False, (LEFT_TOO,))


def test_best_effort_gives_an_interface_to_the_first():
    result = plan("test left", strict=False)

    assert result == SwitchPlan(("test",), (), True, (LEFT_TOO,))


def test_a_claim_can_change_hands():
    result = plan("test", "left", active="left")

    assert result == SwitchPlan(("test",), ("left",), True, ())


def test_who_restarts_keeps_its_claims():
    result = plan("left test", "left", active="left")

    assert result.problems == (
        "could not activate 'test': 'wheel1/velocity' is claimed by 'left', which is "
        "activated too",
    )


def test_a_claim_is_reported_once_for_each_two_controllers():
    twin = ControllerInfo("twin", TEST.command_interfaces)

    result = plan("twin", active="test", controllers={"twin": twin, "test": TEST})

    assert result.problems == (
        "could not activate 'twin': 'arm/position' is claimed by 'test', which stays "
        "active",
    )


def test_a_follower_must_not_go_while_its_predecessor_comes():
    result = plan("base", "left", active="left right")

    assert result == SwitchPlan(
        (),
        (),
        False,
        (
            "could not activate 'base': 'left/velocity' belongs to 'left', which is "
            "to be deactivated",
        ),
    )


def test_a_follower_can_not_restart_under_its_predecessor():
    result = plan("left", "left", active="base left right")

    assert not result.ok
    assert result.problems == (
        "could not deactivate 'left': 'base', which uses 'left/velocity', stays active",
    )


def test_a_strict_switch_tells_all_problems_at_once():
    result = plan("states new", "lfet test", active="left")

    assert result == SwitchPlan(
        (),
        (),
        False,
        (UNKNOWN, NOT_ACTIVE, "could not activate 'new': it is not configured"),
    )


def test_an_active_controller_s_claim_counts_wherever_it_is_listed():
    result = plan("left test", active="test")

    assert result.problems == (
        "could not activate 'left': 'wheel1/velocity' is claimed by 'test', which "
        "stays active",
        "could not activate 'test': it is already active",
        LEFT_TOO.replace("'left'", "'x'")
        .replace("'test'", "'left'")
        .replace("x", "test"),
    )


# Best effort


def test_best_effort_leaves_out_what_is_unknown():
    result = plan("lfet states", strict=False)

    assert result == SwitchPlan(("states",), (), True, (UNKNOWN,))


@pytest.mark.parametrize(
    ("activate", "deactivate"), [("lfet", "left"), ("states", "lfet")]
)
def test_best_effort_does_nothing_if_all_of_a_list_are_unknown(activate, deactivate):
    result = plan(activate, deactivate, active="left right", strict=False)

    assert result == SwitchPlan((), (), False, (UNKNOWN,))


@pytest.mark.parametrize(
    ("activate", "deactivate", "problem"),
    [
        ("lfet", "left", UNKNOWN),
        ("new", "left", "could not activate 'new': it is not configured"),
    ],
)
def test_best_effort_is_always_ok_in_humble(activate, deactivate, problem):
    options = {"active": "left right", "is_humble": True}

    done = plan(activate, deactivate, strict=False, **options)
    refused = plan(activate, deactivate, strict=True, **options)

    assert done == SwitchPlan((), ("left",), True, (problem,))
    assert refused == SwitchPlan((), (), False, (problem,))


def test_best_effort_is_not_ok_if_all_to_activate_fail():
    result = plan("new", "left", active="left", strict=False)

    assert result == SwitchPlan(
        (), ("left",), False, ("could not activate 'new': it is not configured",)
    )


def test_best_effort_is_not_ok_if_all_to_deactivate_fail():
    result = plan("states", "left", active="base left right", strict=False)

    assert result.activate == ("states",)
    assert result.deactivate == ()
    assert not result.ok


def test_best_effort_deactivates_who_can_not_come_back():
    broken = ControllerInfo("broken", missing=("no joint 'elbow'",))

    result = plan(
        "broken",
        "broken",
        active="broken",
        strict=False,
        controllers={"broken": broken},
    )

    assert result == SwitchPlan(
        (), ("broken",), False, ("could not activate 'broken': no joint 'elbow'",)
    )


def test_best_effort_leaves_out_predecessors_of_what_is_left_out():
    left = ControllerInfo("left", (), (), ("left/velocity",), missing=("no wheel",))
    controllers = {**CONTROLLERS, "left": left}

    result = plan("pilot base left right", strict=False, controllers=controllers)

    assert result == SwitchPlan(
        ("right",),
        (),
        True,
        (
            "could not activate 'left': no wheel",
            "could not activate 'base': 'left/velocity' belongs to 'left', which is "
            "not active",
            "could not activate 'pilot': 'base/speed' belongs to 'base', which is "
            "not active",
        ),
    )


def test_best_effort_keeps_the_claims_of_who_can_not_be_deactivated():
    result = plan("test states", "left", active="base left right", strict=False)

    assert result == SwitchPlan(
        ("states",),
        (),
        False,
        (
            "could not deactivate 'left': 'base', which uses 'left/velocity', stays "
            "active",
            "could not activate 'test': 'wheel1/velocity' is claimed by 'left', which "
            "stays active",
        ),
    )


def test_best_effort_deactivates_followers_and_leaves_predecessors_inactive():
    result = plan("base", "left right", active="left right", strict=False)

    assert result.activate == ()
    assert result.deactivate == ("left", "right")
    assert not result.ok


def test_who_is_left_out_takes_no_interface_from_others():
    broken = ControllerInfo("broken", ("wheel1/velocity",), missing=("no joint",))

    result = plan(
        "broken left", strict=False, controllers={"broken": broken, "left": LEFT}
    )

    assert result == SwitchPlan(
        ("left",), (), True, ("could not activate 'broken': no joint",)
    )


def test_who_loses_an_interface_takes_none_from_others():
    a = ControllerInfo("a", ("j1/position",))
    b = ControllerInfo("b", ("j1/position", "j2/position"))
    c = ControllerInfo("c", ("j2/position",))

    result = plan("a b c", strict=False, controllers={"a": a, "b": b, "c": c})

    assert result.activate == ("a", "c")
    assert len(result.problems) == 1


# States that controllers export


ESTIMATOR = ControllerInfo("estimator", exported_state_interfaces=("estimator/x",))
READER = ControllerInfo("reader", ("arm/position",), ("estimator/x",))
ESTIMATES = {"reader": READER, "estimator": ESTIMATOR}


def test_who_reads_another_s_states_needs_it_to_be_active():
    alone = plan("reader", controllers=ESTIMATES)
    together = plan("reader estimator", controllers=ESTIMATES)
    left = plan("", "estimator", active="estimator reader", controllers=ESTIMATES)

    assert alone.problems == (
        "could not activate 'reader': 'estimator/x' belongs to 'estimator', which is "
        "not active",
    )
    assert together.activate == ("estimator", "reader")
    assert left.problems == (
        "could not deactivate 'estimator': 'reader', which uses 'estimator/x', stays "
        "active",
    )


def test_who_exports_states_is_activated_before_who_reads_them():
    assert activation_order(ESTIMATES, ESTIMATES) == ("estimator", "reader")


def test_reading_a_follower_s_states_does_not_turn_the_chain_around():
    first = ControllerInfo("first", ("middle/q",), ("last/x",))
    middle = ControllerInfo("middle", ("last/q",), ("last/x",), ("middle/q",))
    last = ControllerInfo("last", (), (), ("last/q",), ("last/x",))

    for infos in ((first, middle, last), (last, middle, first), (middle, last, first)):
        controllers = {info.name: info for info in infos}
        assert activation_order(controllers, controllers) == ("last", "middle", "first")
        assert find_cycle(controllers) == ""


def test_a_controller_can_read_and_command_itself():
    info = ControllerInfo("a", ("a/q",), ("a/x",), ("a/q",), ("a/x",))

    assert plan("a", controllers={"a": info}).ok
    assert plan("", "a", active="a", controllers={"a": info}).ok
    assert chained({"a": info}, ["a"]) == frozenset()


def test_reading_states_does_not_begin_the_chained_mode():
    assert chained(ESTIMATES, ["reader", "estimator"]) == frozenset()


# Order and chains


def order(*infos: ControllerInfo) -> tuple[str, ...]:
    controllers = {info.name: info for info in infos}
    return activation_order(controllers, controllers)


def test_followers_are_activated_before_their_predecessors():
    for infos in ((LEFT, RIGHT, BASE, PILOT), (BASE, PILOT, RIGHT, LEFT)):
        names = order(*infos)

        assert names[2:] == ("base", "pilot")
        assert set(names[:2]) == {"left", "right"}


def test_unrelated_controllers_keep_their_order():
    assert order(TEST, STATES, NEW) == ("test", "states", "new")
    assert order(NEW, STATES, TEST) == ("new", "states", "test")
    assert order(STATES, BASE, TEST, RIGHT, LEFT) == (
        "states",
        "left",
        "right",
        "base",
        "test",
    )


def test_a_predecessor_comes_after_all_of_its_followers():
    a = ControllerInfo("a", ("left/velocity", "right/velocity"))

    assert order(a, RIGHT, LEFT) == ("left", "right", "a")


def test_a_chain_is_found_from_each_of_its_controllers():
    active = ["left", "right", "base", "pilot", "test"]

    for name in active[:4]:
        chain = chain_of(CONTROLLERS, active, name)
        assert chain[0] == name
        assert sorted(chain) == ["base", "left", "pilot", "right"]
    # Who is inactive links nothing.
    assert chain_of(CONTROLLERS, ["left", "right"], "left") == ("left",)
    assert chain_of(CONTROLLERS, active, "test") == ("test",)


def test_chains_that_end_at_the_hardware_have_no_cycle():
    assert find_cycle(CONTROLLERS) == ""


def ring(*names: str) -> dict[str, ControllerInfo]:
    """Return controllers of which each commands the next, the last the first."""
    following = (*names[1:], names[0])
    return {
        name: ControllerInfo(name, (f"{other}/q",), (), (f"{name}/q",))
        for name, other in zip(names, following, strict=True)
    }


@pytest.mark.parametrize(
    ("controllers", "names"),
    [
        (ring("a"), "'a' -> 'a'"),
        (ring("a", "b"), "'a' -> 'b' -> 'a'"),
        ({**CONTROLLERS, **ring("a", "b", "c")}, "'a' -> 'b' -> 'c' -> 'a'"),
        (
            {"p": ControllerInfo("p", ("a/q",), (), ("p/q",)), **ring("a", "b")},
            "'a' -> 'b' -> 'a'",
        ),
    ],
)
def test_a_cycle_is_named(controllers, names):
    assert find_cycle(controllers) == (
        f"controllers command each other in a circle: {names}; expected chains that "
        "end at the hardware"
    )


def test_controllers_in_a_cycle_still_have_an_order():
    reader = ControllerInfo("reader", (), ("a/x",))
    a = ControllerInfo("a", ("b/q",), (), ("a/q",), ("a/x",))
    controllers = {**ring("a", "b", "c"), "a": a, "reader": reader}

    names = activation_order(controllers, controllers)

    assert sorted(names) == ["a", "b", "c", "reader"]


@pytest.mark.parametrize(
    ("active", "expected"),
    [
        ("left right", set()),
        ("left right base", {"left", "right"}),
        ("left right base pilot", {"left", "right", "base"}),
        # Neither who is inactive is chained, nor who is commanded by an inactive one.
        ("base pilot", {"base"}),
        ("left right pilot", set()),
    ],
)
def test_who_is_commanded_by_an_active_controller_is_chained(active, expected):
    assert chained(CONTROLLERS, active.split()) == expected
