"""Options reject what can't be simulated."""

import math

import numpy as np
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

    assert (
        str(caught.value)
        == f"log_rate must be positive and at most 1e+06 Hz, got {value!r}"
    )


def test_defaults_are_a_millisecond_of_full_physics_without_self_collision() -> None:
    options = ad.SimulationOptions()

    assert options.largest_step == 1e-3
    assert options.servo_bandwidth == 40.0
    assert options.gravity is None
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


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("gravity_compensation", "off", "True or False"),
        ("friction", math.nan, "True or False"),
        ("reflected_inertia", "yes", "True, False or None"),
        ("gravity", "off", "True, False, (x, y, z) [m/s^2] or None"),
        ("gravity", (0.0, -9.81), "three finite numbers"),
        ("gravity", (0.0, 0.0, math.inf), "three finite numbers"),
        ("servo_bandwidth", "40", "a number"),
        ("servo_bandwidth", True, "a number"),
        ("time_step", "1 ms", "a number or None"),
        ("log_rate", "100", "a number or None"),
        ("preset", 3, "a text"),
        ("active", None, "names of controllers"),
        ("inactive", (5,), "names of controllers"),
    ],
)
def test_an_option_of_another_type_is_refused(
    option: str, value: object, expected: str
) -> None:
    with pytest.raises(InputError) as caught:
        ad.SimulationOptions(**{option: value})  # type: ignore[arg-type]

    assert str(caught.value) == f"{option}: expected {expected}, got {value!r}"


def test_numbers_of_numpy_are_numbers() -> None:
    options = ad.SimulationOptions(time_step=np.float64(2e-3), log_rate=np.int64(100))

    assert options.time_step == 2e-3


def test_options_are_no_dict() -> None:
    with pytest.raises(InputError, match="expected SimulationOptions"):
        ad.build_diagram(
            ad.load_robot("doosan_a0912"),
            options={"friction": False},  # type: ignore[arg-type]
        )
