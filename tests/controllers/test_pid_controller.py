import copy
from typing import Any

import numpy as np
import pytest

from arm_drake.controllers.pid_controller import (
    DofGains,
    PidController,
    PidControllerGains,
    PidControllerParameters,
)
from arm_drake.messages import Header, MultiDOFCommand, MultiDOFState, Time
from tests.controllers.driving import Driven, make_params

JOINTS = ("joint1", "joint2")

# Those of upstream's own tests.
GAINS = {"p": 1.0, "i": 2.0, "d": 3.0, "antiwindup_strategy": "none"}
P_ALONE = {"p": 0.5, "i": 0.0, "d": 0.0}


def make_parameters(
    joints: tuple[str, ...] = JOINTS[:1],
    names: tuple[str, ...] = ("position",),
    *,
    gains: dict[str, Any] | None = None,
    **fields: Any,
) -> PidControllerParameters:
    one = DofGains(**{**GAINS, **(gains or {})})
    return PidControllerParameters(
        dof_names=joints,
        command_interface="effort",
        reference_and_state_interfaces=names,
        gains=PidControllerGains(dict.fromkeys(joints, one)),
        **{"enable_feedforward": True, **fields},
    )


def drive(
    *args: Any, distro: str = "jazzy", measured: Any = (1.1,), **fields: Any
) -> Driven:
    parameters = make_parameters(*args, **fields)
    params = make_params(parameters.dof_names, distro=distro)
    driven = Driven(PidController(parameters, params))
    if not parameters.use_external_measured_states:
        driven.measure(measured)
    return driven


def command(*values: float, **fields: Any) -> MultiDOFCommand:
    return MultiDOFCommand(values=values, **fields)


def refer(driven: Driven, *values: float, **how: Any) -> list[float]:
    """Return the commands of a cycle with references from the topic."""
    driven.run({"reference": command(*values)}, **how)
    return list(driven.command_values)


def references(driven: Driven) -> list[float]:
    return [dof.reference for dof in driven.output("controller_state").dof_states]


def test_a_reference_from_the_topic_is_controlled() -> None:  # Q1
    assert refer(drive(), 101.101) == pytest.approx([30100.301])


def test_a_reference_from_another_controller_is_controlled() -> None:  # Q2
    driven = drive()

    driven.run(references=[5.0])

    assert driven.command_values == pytest.approx([1173.9])


@pytest.mark.parametrize(
    ("wraps", "expected"),
    [pytest.param(False, 2678.9, id="Q3"), pytest.param(True, 787.66122, id="Q4")],
)
def test_angles_take_the_shortest_way_if_they_wrap(
    wraps: bool, expected: float
) -> None:
    driven = drive(gains={"angle_wraparound": wraps})

    assert refer(driven, 10.0) == pytest.approx([expected], abs=1e-5)


@pytest.mark.parametrize(
    ("gain", "enabled", "expected"),
    [
        pytest.param(1.0, True, 6.95, id="Q5"),
        pytest.param(0.0, True, 1.95, id="Q6"),
        pytest.param(1.0, False, 1.95, id="F26"),
    ],
)
def test_feedforward_adds_the_reference(
    gain: float, enabled: bool, expected: float
) -> None:
    gains = {**P_ALONE, "feedforward_gain": gain}
    driven = drive(gains=gains, enable_feedforward=enabled)

    assert refer(driven, 5.0) == pytest.approx([expected])


def test_feedforward_of_two_interfaces_adds_the_rate() -> None:
    gains = {**P_ALONE, "feedforward_gain": 1.0}
    driven = drive(JOINTS[:1], ("position", "velocity"), gains=gains)

    driven.run({"reference": command(5.0, values_dot=[0.25])})

    assert driven.command_values == pytest.approx([0.5 * (5.0 - 1.1) + 0.25])


def test_gains_can_change_at_run_time() -> None:  # Q7
    driven = drive(gains=P_ALONE)
    before = refer(driven, 5.0)

    changed = make_parameters(gains={**P_ALONE, "feedforward_gain": 1.0})
    driven.run({"parameters": changed})

    assert (before, list(driven.command_values)) == (
        pytest.approx([1.95]),
        pytest.approx([6.95]),
    )
    assert driven.reasons() == []


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param({"u_clamp_max": -1.0, "u_clamp_min": 1.0}, id="P5"),
        pytest.param({"i_clamp_max": -1.0, "i_clamp_min": 1.0}, id="P6"),
    ],
)
def test_gains_that_no_pid_can_have_are_no_parameters(bad: dict[str, float]) -> None:
    driven = drive(gains=P_ALONE, enable_feedforward=False)

    with pytest.raises(ValueError, match="clamp_min"):
        make_parameters(gains=bad)
    driven.run({"parameters": bad})

    assert refer(driven, 5.0) == pytest.approx([1.95])
    (reason,) = driven.reasons()
    assert reason.startswith("expected PidControllerParameters, got {")


def test_a_change_of_gains_keeps_the_integral() -> None:
    driven = drive(gains={"p": 0.0, "d": 0.0})
    refer(driven, 2.1)
    driven.run({"parameters": make_parameters(gains={"p": 0.0, "i": 0.0, "d": 0.0})})

    driven.run()

    assert driven.command_values == pytest.approx([2.0 * 1.0 * 0.01])


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        (
            make_parameters(("joint2",)),
            "dof_names can't change while the controller runs",
        ),
        ("gains", "expected PidControllerParameters, got 'gains'"),
    ],
)
def test_parameters_that_can_not_change_are_refused(changed: Any, reason: str) -> None:
    driven = drive(gains=P_ALONE)

    driven.run({"parameters": changed, "reference": command(5.0)})

    assert driven.reasons() == [reason]
    assert driven.command_values == pytest.approx([1.95])


@pytest.mark.parametrize(
    ("saves", "expected"),
    [pytest.param(False, 0.0, id="Q8"), pytest.param(True, 2.00002, id="Q9")],
)
def test_the_integral_stays_over_a_deactivation_if_it_is_saved(
    saves: bool, expected: float
) -> None:
    # An integral term of 2.00002, as in upstream's test.
    driven = drive(gains={"save_i_term": saves})
    refer(driven, 101.101)
    driven.run(activation=None)

    driven.run(activation=2)

    assert driven.command_values == pytest.approx([expected], abs=1e-9)


def test_the_first_reference_is_what_is_measured() -> None:  # Q10
    driven = drive()

    driven.run()

    assert references(driven) == [1.1]
    assert driven.command_values.tolist() == [0.0]


def test_else_there_is_no_reference_and_no_command() -> None:  # Q11
    driven = drive(set_current_state_as_first_setpoint=False)
    driven.command_values = np.array([0.75])

    tick = driven.run()

    assert np.isnan(tick.command).all()
    (state,) = driven.output("controller_state").dof_states
    assert np.isnan([state.reference, state.error]).all()
    assert (state.feedback, state.output) == (1.1, 0.75)


def test_a_reference_holds_until_the_next_one() -> None:  # Q12
    driven = drive()
    refer(driven, 0.45)

    for _ in range(3):
        driven.run()

    assert references(driven) == [0.45]


def test_in_a_chain_the_topic_is_rejected() -> None:  # Q13
    driven = drive()

    refer(driven, 9.0, references=[5.0])

    assert driven.command_values == pytest.approx([1173.9])
    assert driven.reasons() == ["another controller commands the references"]


def test_what_nobody_commands_of_a_chain_stays() -> None:
    driven = drive(JOINTS, measured=(1.1, 2.1))

    driven.run(references=[5.0, np.nan])

    assert references(driven) == [5.0, 2.1]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (command(1.0), "values must have 2 elements (joint1, joint2), got 1"),
        (
            command(1.0, 2.0, values_dot=[1.0]),
            "values_dot must have 2 elements (joint1, joint2) or none, got 1",
        ),
        (
            command(1.0, 2.0, dof_names=["joint1", "joint3"]),
            "dof_names must be joint1, joint2, got joint1, joint3",
        ),
    ],
)
def test_a_bad_message_is_rejected(
    message: MultiDOFCommand, reason: str
) -> None:  # Q16
    driven = drive(JOINTS)
    refer(driven, 0.4, 0.5)

    driven.run({"reference": message})

    assert references(driven) == [0.4, 0.5]
    assert driven.reasons() == [reason]


def test_references_are_sorted_by_name() -> None:
    driven = drive(JOINTS, ("position", "velocity"))
    names = ("joint2", "joint1")

    driven.run({"reference": command(2.0, 1.0, dof_names=names, values_dot=[4.0, 3.0])})

    states = driven.output("controller_state").dof_states
    assert [(dof.reference, dof.error_dot) for dof in states] == [
        (1.0, 3.0),
        (2.0, 4.0),
    ]


def test_a_reference_that_is_nan_leaves_the_last_one() -> None:
    driven = drive(JOINTS)
    refer(driven, 0.4, 0.5)

    refer(driven, np.nan, 0.6)

    assert references(driven) == [0.4, 0.6]


def test_an_infinite_reference_stops_the_commands_of_its_joint() -> None:
    driven = drive(JOINTS, gains=P_ALONE)
    refer(driven, 0.0, 0.0)

    refer(driven, np.inf, 1.0)

    assert driven.command_values == pytest.approx([-0.55, 0.5])


def test_a_given_rate_takes_the_place_of_the_difference() -> None:
    driven = drive(
        JOINTS,
        ("position", "velocity"),
        gains={"p": 0.0, "i": 0.0, "d": 2.0},
        measured=[0.0] * 4,
        set_current_state_as_first_setpoint=False,
    )

    # Only the first joint has a rate of its reference.
    driven.run({"reference": command(0.5, 0.5, values_dot=[0.25, np.nan])})

    assert driven.command_values == pytest.approx([2.0 * 0.25, 2.0 * 0.5 / 0.01])


def test_measurements_can_come_from_a_topic() -> None:
    driven = drive(gains=P_ALONE, use_external_measured_states=True)
    without = driven.run({"reference": command(5.0)})

    driven.run({"measured_state": command(1.1)})

    assert np.isnan(without.command).all()
    assert driven.command_values == pytest.approx([1.95])
    assert driven.system.state_interfaces == ()


def test_measured_rates_need_a_second_interface() -> None:
    driven = drive(use_external_measured_states=True)

    driven.run({"measured_state": command(1.1, values_dot=[0.1])})

    assert driven.reasons() == [
        "values_dot needs a second one of reference_and_state_interfaces"
    ]


def test_an_activation_forgets_the_measurements_of_the_topic() -> None:
    driven = drive(gains=P_ALONE, use_external_measured_states=True)
    driven.run({"reference": command(5.0), "measured_state": command(1.1)})
    driven.run(activation=None)

    tick = driven.run({"reference": command(5.0)}, activation=2)

    assert np.isnan(tick.command).all()


def test_references_for_an_inactive_controller_are_rejected() -> None:
    driven = drive()

    refer(driven, 5.0, activation=None)
    driven.run()

    assert driven.reasons() == ["the controller is not active"]
    assert references(driven) == [1.1]


def test_the_state_is_described() -> None:
    driven = drive(("joint1",), ("position", "velocity"), gains=P_ALONE)
    driven.run()
    driven.measure([1.0, 0.5])

    driven.run({"reference": command(3.0, values_dot=[0.75])})

    state = driven.output("controller_state")
    assert state.header == Header(Time(0, 10_000_000))
    assert state.dof_states == (
        MultiDOFState("joint1", 3.0, 1.0, 0.5, 2.0, 0.25, 0.01, 1.0),
    )
    assert driven.output("exported_state_interfaces").tolist() == [1.0, 0.5]


def test_before_its_first_tick_it_exports_what_is_measured() -> None:
    driven = drive(("joint1",), ("position", "velocity"), gains=P_ALONE)

    driven.measure([1.0, 0.5])

    assert driven.output("exported_state_interfaces").tolist() == [1.0, 0.5]


def test_references_and_measurements_may_have_other_names() -> None:
    names = ("left", "right")
    driven = drive(JOINTS, reference_and_state_dof_names=names)

    system = driven.system

    assert system.command_interfaces == ("joint1/effort", "joint2/effort")
    assert system.state_interfaces == ("left/position", "right/position")
    own = ("controller/left/position", "controller/right/position")
    assert system.reference_interfaces == system.exported_interfaces == own


# Backward Euler: the integral of this very step acts.
@pytest.mark.parametrize(("distro", "expected"), [("humble", 0.02), ("jazzy", 0.0)])
def test_humble_integrates_before_it_commands(distro: str, expected: float) -> None:
    gains = {"p": 0.0, "d": 0.0, "i_clamp_max": 1.0, "i_clamp_min": -1.0}
    driven = drive(gains=gains, distro=distro)

    assert refer(driven, 2.1) == pytest.approx([expected])


def test_a_copy_of_the_context_holds_the_same_state() -> None:
    driven = drive(JOINTS, gains={"i": 5.0})
    refer(driven, 0.5, 0.6)
    tick = driven.context.get_abstract_state(0).get_value()
    clone = driven.context.Clone()

    restored = clone.get_abstract_state(0).get_value()

    assert copy.deepcopy(tick) is tick
    assert restored is tick


def test_parameters_are_taken_once_also_from_a_copy_of_the_context() -> None:
    driven = drive(gains=P_ALONE)
    driven.run({"parameters": make_parameters(("joint2",))})
    assert len(driven.reasons()) == 1

    driven.context = driven.context.Clone()
    driven.simulator.reset_context(driven.context)
    driven.run()

    assert len(driven.reasons()) == 1
