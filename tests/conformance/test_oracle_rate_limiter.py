"""Replays the rate limiter of upstream."""

from typing import Any

import pytest

from arm_drake.control.filters import RateLimiter
from tests.oracle import assert_close, number, oracle_cases

CASES = oracle_cases("rate_limiter")


@pytest.mark.parametrize("case", CASES)
def test_limited_values_are_upstream_s(case: dict[str, Any]) -> None:
    inputs, expected = case["input"], case["output"]
    limits = [number(limit) for limit in inputs["limits"]]
    if "exception" in expected:
        with pytest.raises(ValueError, match="must not exceed"):
            RateLimiter(*limits)
        return
    limiter = RateLimiter(*limits)

    v0, v1 = number(inputs["v0"]), number(inputs["v1"])
    results = []
    for v, dt in zip(inputs["input"], inputs["dt"], strict=True):
        results.append(limiter.limit(number(v), v0, v1, number(dt)))
        v0, v1 = results[-1].value, v0

    assert_close([result.value for result in results], expected["output"])
    assert_close([result.factor for result in results], expected["factor"])
