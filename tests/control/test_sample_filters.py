from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_drake.control.filters import MeanFilter, MedianFilter, TransferFunctionFilter

# Of upstream's tests: coefficients, samples of each channel, and the last outputs.
LOW_PASS = ((1.0, -0.509525449494429), (0.245237275252786, 0.245237275252786))
SAMPLES = [
    [10.0, 10.0, 10.0],
    [70.0, 30.0, 8.0],
    [-1.0, 5.0, 22.0],
    [44.0, 23.0, 8.0],
    [10.0, 10.0, 10.0],
    [5.0, -1.0, 5.0],
    [6.0, -30.0, 2.0],
]
ONE = [[10.0], [70.0], [10.0], [44.0], [10.0], [5.0], [6.0]]


def run(filter_: Any, samples: Any) -> np.ndarray:
    """Return all outputs, shape (samples, channels)."""
    state = filter_.initial(len(samples[0]))
    outputs = []
    for sample in samples:
        state = filter_.update(state, np.array(sample, dtype=float))
        outputs.append(state.output)
    return np.array(outputs)


def test_a_mean_is_that_of_the_last_samples() -> None:
    outputs = run(MeanFilter(2), [[1.1, 3.0], [2.0, 5.0], [2.0, -1.0], [2.0, 0.0]])

    assert outputs.tolist() == [[1.1, 3.0], [1.55, 4.0], [2.0, 2.0], [2.0, -0.5]]


def test_a_mean_of_one_sample_is_that_sample() -> None:
    assert run(MeanFilter(1), [[1.0], [5.0]]).tolist() == [[1.0], [5.0]]


def test_a_median_is_the_lower_of_the_middle_two() -> None:
    outputs = run(MedianFilter(3), [[5.0], [1.0], [9.0], [7.0], [8.0]])

    # Of {5}, {1, 5}, {1, 5, 9}, {1, 7, 9}, {7, 8, 9}.
    assert outputs[:, 0].tolist() == [5.0, 1.0, 5.0, 7.0, 8.0]


def test_channels_have_medians_of_their_own() -> None:
    outputs = run(MedianFilter(5), [[0, 10], [1, 8], [2, 6]])

    assert outputs[-1].tolist() == [1.0, 8.0]


@pytest.mark.parametrize(
    ("a", "b", "samples", "last"),
    [
        (*LOW_PASS, ONE, [11.8008]),
        ((2.0, LOW_PASS[0][1]), LOW_PASS[1], ONE, [2.4088]),
        (
            (1.0, -1.760041880343169, 1.182893262037831, -0.278059917634546),
            (
                0.018098933007514,
                0.245237275252786,
                0.054296799022543,
                0.018098933007514,
            ),
            SAMPLES,
            [60.6216, 33.9829, 28.1027],
        ),
        (
            (1.0, -1.760041880343169, 1.182893262037831),
            (
                0.018098933007514,
                0.054296799022543,
                0.054296799022543,
                0.018098933007514,
            ),
            SAMPLES,
            [17.1112, 9.0285, 8.3102],
        ),
    ],
)
def test_a_transfer_function_ends_as_in_upstream_s_tests(
    a: Any, b: Any, samples: Any, last: Any
) -> None:
    outputs = run(TransferFunctionFilter(a, b), samples)

    # Upstream's tests ask for 1e-4.
    assert outputs[-1] == pytest.approx(last, abs=1e-4)


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (4, 1), (3, 3)])
def test_a_transfer_function_is_scipy_s_at_rest_before(shape: Any) -> None:
    rng = np.random.default_rng(5)
    a, b = rng.uniform(-0.3, 0.3, shape[0]), rng.uniform(-1.0, 1.0, shape[1])
    a[0] = 1.7
    samples = rng.normal(size=(50, 2))

    outputs = run(TransferFunctionFilter(tuple(a), tuple(b)), samples)

    # The sums are of a few terms near 1, and the filter is stable.
    np.testing.assert_allclose(outputs, lfilter(b, a, samples, axis=0), atol=1e-13)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (
            lambda: MeanFilter(0),
            "number_of_observations must be at least 1, got 0",
        ),
        (
            lambda: MedianFilter(-1),
            "number_of_observations must be at least 1, got -1",
        ),
        (
            lambda: TransferFunctionFilter((), (1.0,)),
            "a must be finite numbers, at least one, got []",
        ),
        (
            lambda: TransferFunctionFilter((1.0,), (float("nan"),)),
            "b must be finite numbers, at least one, got [nan]",
        ),
        (
            lambda: TransferFunctionFilter((0.0, 1.0), (1.0,)),
            "a must not begin with 0, got [0.0, 1.0]",
        ),
    ],
)
def test_what_is_out_of_range_is_refused(make: Any, problem: str) -> None:
    with pytest.raises(ValueError, match="must") as caught:
        make()

    assert str(caught.value) == problem
