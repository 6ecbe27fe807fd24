from typing import Any

import numpy as np
import pytest

from arm_drake.control.filters import (
    FILTERS,
    RateLimiterFilter,
    find_unused,
    make_filter_chain,
)

MEAN = "filters/MeanFilterDouble"
SMOOTH = "control_filters/ExponentialFilterDouble"
LIMITER = "control_filters/RateLimiterDouble"
KNOWN = (
    "control_filters/ExponentialFilterDouble, control_filters/LowPassFilterDouble, "
    "control_filters/RateLimiterDouble, filters/MeanFilterDouble, "
    "filters/MedianFilterDouble, filters/TransferFunctionFilterDouble"
)


# Types, their parameters, samples, and what comes out of a filter at rest before.
CASES: list[tuple[str, dict[str, Any], list[float], list[float]]] = [
    (MEAN, {"number_of_observations": 2}, [1.1, 2, 2], [1.1, 1.55, 2]),
    (
        "filters/MedianFilterDouble",
        {"number_of_observations": 3},
        [1, 9, 5],
        [1, 1, 5],
    ),
    (
        "filters/TransferFunctionFilterDouble",
        {"a": [2, -1.0], "b": [1.0]},
        [2, 0, 0],
        [1, 0.5, 0.25],
    ),
    (
        "control_filters/LowPassFilterDouble",
        {
            "sampling_frequency": 1000.0,
            "damping_frequency": 20.5,
            "damping_intensity": 1.25,
        },
        [1, 2, 2],
        [1, 1, 1.157822624],
    ),
    (SMOOTH, {"alpha": 0.5}, [1, 2, 2], [1, 1.5, 1.75]),
    (
        LIMITER,
        {"sampling_interval": 0.5, "max_first_derivative_pos": 1.0},
        [0, 10, 10, -10],
        [0, 0.5, 1, 0.5],
    ),
]


def chain(*filters: tuple[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the parameters of a chain of filters with these types and parameters."""
    found: dict[str, Any] = {}
    for number, (type_, params) in enumerate(filters, start=1):
        found |= {f"filter{number}.name": f"f{number}", f"filter{number}.type": type_}
        found |= {f"filter{number}.params.{n}": v for n, v in params.items()}
    return found


def run(parameters: dict[str, Any], *samples: float) -> list[float]:
    made = make_filter_chain(parameters, "filter_chain")
    state, outputs = made.initial(1), []
    for sample in samples:
        state = made.update(state, np.array([sample]))
        outputs.append(float(state.output[0]))
    return outputs


def test_without_filters_everything_passes() -> None:
    assert run({}, 1.0, 5.0) == [1.0, 5.0]
    assert np.isnan(make_filter_chain({}, "").initial(2).output).all()


@pytest.mark.parametrize(("type_", "params", "samples", "outputs"), CASES)
def test_each_type_filters_as_its_parameters_say(
    type_: str, params: Any, samples: Any, outputs: Any
) -> None:
    assert run(chain((type_, params)), *samples) == pytest.approx(outputs, abs=1e-8)


def test_filters_follow_each_other_in_the_order_of_their_numbers() -> None:
    smooth, limiter = (
        (SMOOTH, {"alpha": 0.5}),
        (LIMITER, {"sampling_interval": 1.0, "max_value": 2.0}),
    )

    # 0, 4 is smoothed to 0, 2; limited to 2 it is smoothed to 0, 1.
    assert run(chain(smooth, limiter), 0.0, 4.0) == [0.0, 2.0]
    assert run(chain(limiter, smooth), 0.0, 4.0) == [0.0, 1.0]


def test_a_rate_limiter_goes_on_from_its_own_outputs() -> None:
    limits = {
        "sampling_interval": 0.5,
        "max_value": 6.0,
        "max_second_derivative": 2.0,
    }

    outputs = run(chain((LIMITER, limits)), 0.0, *[10.0] * 6)

    # Each step is longer by 2 * 0.5^2, until the value is at its limit.
    assert outputs == [0.0, 0.5, 1.5, 3.0, 5.0, 6.0, 6.0]


def test_a_rate_limiter_limits_each_channel_from_its_first_sample_on() -> None:
    limiter = RateLimiterFilter(1.0, max_value=3.0, max_first_derivative_pos=1.0)

    first = limiter.update(limiter.initial(2), np.array([5.0, -1.0]))
    second = limiter.update(first, np.array([-5.0, 2.0]))

    assert first.output.tolist() == [3.0, -1.0]
    assert second.output.tolist() == [2.0, 0.0]


@pytest.mark.parametrize(
    ("parameters", "problem"),
    [
        (
            {"filter1.type": MEAN},
            "c.filter1.name: is required but missing",
        ),
        (
            {"filter1.name": "x"},
            "c.filter1.type: is required but missing",
        ),
        (
            {"filter1.name": 3, "filter1.type": MEAN},
            "c.filter1.name: expected str, got 3",
        ),
        (
            chain(("control_filters/LowPassFilterWrench", {})),
            "c.filter1.type: no filter of numbers 'control_filters/LowPassFilterWrench'"
            f"; did you mean 'control_filters/LowPassFilterDouble'? known: {KNOWN}",
        ),
        (
            chain((SMOOTH, {"alpha": 0.5}), (SMOOTH, {"alpha": 0.5}))
            | {"filter2.name": "f1"},
            "c.filter2.name: another filter of the chain is 'f1', too",
        ),
        (
            chain((MEAN, {})),
            "c.filter1.params.number_of_observations: is required but missing",
        ),
        (
            chain((MEAN, {"number_of_observations": 2.0})),
            "c.filter1.params.number_of_observations: expected int, got 2.0",
        ),
        (
            chain((MEAN, {"number_of_observations": True})),
            "c.filter1.params.number_of_observations: expected int, got True",
        ),
        (
            chain((MEAN, {"number_of_observations": 0})),
            "c.filter1.params.number_of_observations must be at least 1, got 0",
        ),
        (
            chain((SMOOTH, {"alpha": "1"})),
            "c.filter1.params.alpha: expected float, got '1'",
        ),
        (
            chain(("filters/TransferFunctionFilterDouble", {"a": 1.0, "b": [1.0]})),
            "c.filter1.params.a: expected a list of float, got 1.0",
        ),
        (
            chain((LIMITER, {"sampling_interval": 0.0})),
            "c.filter1.params.sampling_interval must be above 0, got 0.0",
        ),
        (
            chain((LIMITER, {"sampling_interval": 1.0, "max_value": -1.0})),
            "c.filter1.params.max_value must not be below 0, got -1.0",
        ),
        (
            chain((LIMITER, {"sampling_interval": 1.0, "min_value": 1.0})),
            "c.filter1.params.min_value must not be above 0, got 1.0",
        ),
    ],
)
def test_what_is_wrong_with_a_chain_is_reported(parameters: Any, problem: str) -> None:
    with pytest.raises(ValueError, match="filter") as caught:
        make_filter_chain(parameters, "c")

    assert str(caught.value) == problem


NO_FILTER = (
    "belongs to no filter; they are numbered from filter1 on, and the chain has {}, "
    "each with name, type and params"
)


@pytest.mark.parametrize(
    ("parameters", "unused"),
    [
        (chain((SMOOTH, {"alpha": 0.5})), {}),
        (
            chain((SMOOTH, {"alpha": 0.5, "alfa": 1.0})),
            {
                "filter1.params.alfa": "the filter has no such parameter; did you mean "
                "'alpha'? known: alpha"
            },
        ),
        (
            {"filter2.name": "x", "filter2.type": MEAN},
            dict.fromkeys(("filter2.name", "filter2.type"), NO_FILTER.format(0)),
        ),
        (
            chain((SMOOTH, {"alpha": 0.5})) | {"filter1.parameters.a": 1, "b": [2]},
            dict.fromkeys(("filter1.parameters.a", "b"), NO_FILTER.format(1)),
        ),
        # What isn't known of a filter that isn't known can't be told.
        ({"filter1.name": "x", "filter1.type": [1], "filter1.params.a": 1}, {}),
    ],
)
def test_what_belongs_to_no_filter_is_found(
    parameters: dict[str, Any], unused: dict[str, str]
) -> None:
    assert find_unused(parameters) == unused


def test_what_belongs_to_no_filter_has_no_effect() -> None:
    plain = chain((SMOOTH, {"alpha": 0.5}))
    more = {"filter1.params.alfa": "x", "filter3.name": 1, "other": 2}

    assert make_filter_chain(plain | more, "c") == make_filter_chain(plain, "c")


def test_there_is_a_case_for_each_type() -> None:
    assert {type_ for type_, *_ in CASES} == set(FILTERS)
