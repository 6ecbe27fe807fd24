import math
from typing import Any

import numpy as np
import pytest

from arm_drake.control.filters import ExponentialFilter, FilterState, LowPassFilter

INF, NAN = math.inf, math.nan
# Samples pass by a half each, so that outputs are easily told.
HALF = LowPassFilter(2.0 * math.pi, math.log(2.0), 0.0)
SMOOTH = ExponentialFilter(0.5)


def run(filter_: Any, *samples: Any) -> list[list[float]]:
    state = FilterState.initial(np.size(samples[0]))
    outputs = []
    for sample in samples:
        state = filter_.update(state, np.atleast_1d(sample))
        outputs.append(state.output.tolist())
    return np.transpose(outputs).tolist()


@pytest.mark.parametrize(
    ("parameters", "a"),
    [
        ((1000.0, 20.5, 1.25), 0.842177376),
        ((100.0, 5.0, 1.0), 0.673341208),
        # The formula's limit cases.
        ((1.0, 1.0, 1e6), 0.0),
        ((1.0, 1.0, -1e6), 1.0),
    ],
)
def test_the_coefficient_follows_from_the_parameters(parameters: Any, a: float) -> None:
    assert LowPassFilter(*parameters).a == pytest.approx(a, abs=1e-8)


@pytest.mark.parametrize(
    ("filter_", "samples", "outputs"),
    [
        (LowPassFilter(1000.0, 20.5, 1.25), [1, 1, 1], [1, 1, 1]),
        (LowPassFilter(1000.0, 20.5, 1.25), [1, 2, 2], [1, 1, 1.157822624]),
        (HALF, [1, 3, 5, 5], [1, 1, 2, 3.5]),
        (SMOOTH, [1, 2, 2], [1, 1.5, 1.75]),
        (ExponentialFilter(1.0), [1, 5, 2], [1, 5, 2]),
        (ExponentialFilter(0.0), [1, 5, 2], [1, 1, 1]),
    ],
)
def test_a_filter_begins_at_its_first_sample(
    filter_: Any, samples: Any, outputs: Any
) -> None:
    assert run(filter_, *samples) == [pytest.approx(outputs, abs=1e-8)]


@pytest.mark.parametrize("first", [NAN, INF, -INF])
@pytest.mark.parametrize("filter_", [HALF, SMOOTH])
def test_nothing_comes_out_before_a_finite_sample(filter_: Any, first: float) -> None:
    outputs = run(filter_, first, first, 4.0, 4.0)

    assert outputs == [pytest.approx([NAN, NAN, 4.0, 4.0], nan_ok=True)]


@pytest.mark.parametrize(
    ("filter_", "samples", "outputs"),
    [
        (HALF, [1, NAN, 3, 4, 5], [1, 1, NAN, 4, 4]),
        (SMOOTH, [1, NAN, 3, 4], [1, NAN, 3, 3.5]),
        (HALF, [1, INF, 3, 4], [1, 1, INF, INF]),
        (SMOOTH, [1, INF, -INF, 4], [1, INF, NAN, 4]),
        (ExponentialFilter(0.0), [1, INF, 4], [1, NAN, 4]),
    ],
)
def test_after_nan_a_filter_begins_again(
    filter_: Any, samples: Any, outputs: Any
) -> None:
    assert run(filter_, *samples) == [pytest.approx(outputs, nan_ok=True)]


@pytest.mark.parametrize("filter_", [HALF, SMOOTH])
def test_each_channel_is_a_filter_of_its_own(filter_: Any) -> None:
    channels = np.array([[1, 2, 3, 4], [NAN, 5, 6, 7], [8, NAN, 9, 1], [1, 1, 2, INF]])

    together = run(filter_, *channels.T)

    for channel, outputs in zip(channels, together, strict=True):
        assert [outputs] == [pytest.approx(run(filter_, *channel)[0], nan_ok=True)]


def test_a_state_keeps_a_copy_of_the_sample() -> None:
    sample = np.array([1.0])
    state = HALF.update(FilterState.initial(1), sample)

    sample[0] = 9.0

    assert HALF.update(state, sample).output == [1.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: LowPassFilter(0.0, 1.0, 1.0),
            "sampling_frequency must be above 0, got 0.0",
        ),
        (
            lambda: LowPassFilter(1.0, -1.0, 1.0),
            "damping_frequency must be above 0, got -1.0",
        ),
        (
            lambda: LowPassFilter(1.0, 1.0, NAN),
            "damping_intensity must be finite, got nan",
        ),
        (lambda: ExponentialFilter(1.5), "alpha must be from 0 to 1, got 1.5"),
        (lambda: ExponentialFilter(NAN), "alpha must be from 0 to 1, got nan"),
    ],
)
def test_parameters_out_of_range_are_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match="must be") as caught:
        make()

    assert str(caught.value) == message
