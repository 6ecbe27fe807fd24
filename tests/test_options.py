"""Options reject what can't be simulated."""

import math

import pytest

import arm_drake as ad
from arm_drake.errors import InputError


@pytest.mark.parametrize("value", [0.0, -1e-3, math.inf, math.nan])
def test_a_bandwidth_must_be_positive(value: float) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared.
        ad.SimulationOptions(servo_bandwidth=value)

    assert str(caught.value) == f"servo_bandwidth must be positive, got {value!r}"


@pytest.mark.parametrize("value", [0.0, -1e-3, 1e-9, math.inf, math.nan])
def test_a_step_must_be_a_microsecond_at_least(value: float) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared.
        ad.SimulationOptions(time_step=value)

    assert str(caught.value) == f"time_step must be at least 1e-06 s, got {value!r}"


@pytest.mark.parametrize("value", [0.0, -100.0, math.nan])
def test_a_log_rate_must_be_positive(value: float) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared.
        ad.SimulationOptions(log_rate=value)

    assert str(caught.value) == f"log_rate must be positive, got {value!r}"


def test_defaults_are_a_millisecond_of_full_physics_without_self_collision() -> None:
    options = ad.SimulationOptions()

    assert options.time_step == 1e-3
    assert options.servo_bandwidth == 40.0
    assert options.gravity
    assert options.friction
    assert not options.self_collision
    assert options.log_rate is None
    assert options.active == options.inactive == ()


def test_a_controller_is_not_active_and_inactive() -> None:
    with pytest.raises(InputError) as caught:
        ad.SimulationOptions(active=("b", "a"), inactive=("a",))

    assert str(caught.value) == (
        "controller 'a' can't be both active and inactive; name it once"
    )


@pytest.mark.parametrize("field", ["active", "inactive"])
def test_a_text_is_no_list_of_controllers(field: str) -> None:
    with pytest.raises(InputError) as caught:
        ad.SimulationOptions(**{field: "jtc"})

    assert str(caught.value) == f"{field}: expected names of controllers, got 'jtc'"
