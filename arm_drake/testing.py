"""Claims about a run or many runs, for tests, such as `assert_success_rate`."""

import bisect
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from arm_drake.batch.api import iterate_many
from arm_drake.batch.runs import Outcome, RunResult, describe
from arm_drake.batch.statistics import check_confidence, most_failures, rate_interval
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import Rollout
from arm_drake.simulation.simulation import Simulation

# So many failures are named in a message.
_MOST_NAMED = 5

# With more runs nobody waits for it.
_MOST_RUNS = 10_000_000


def assert_succeeded(run: Simulation | Outcome) -> None:
    """Assert that all goals of a run ended well, and nothing was refused or failed.

    Args:
        run: A simulation that has run, or what `run_many` keeps of one.

    Raises:
        AssertionError: If not; each line says what failed, or hasn't ended.
    """
    outcome = run if isinstance(run, Outcome) else Outcome.of(run)
    lines = (*outcome.failures, *outcome.unfinished)
    if lines:
        raise AssertionError("\n".join(lines))


def assert_followed(
    rollout: Rollout,
    controller: str,
    *,
    within: float,
    saturation: float | None = None,
) -> None:
    """Assert that joints followed their references.

    Args:
        rollout: What was recorded.
        controller: Name of the controller whose references count.
        within: The largest tracking error that passes [rad or m].
        saturation: For how long each of its joints may be at its effort limit [s]; by
            default that doesn't matter.

    Raises:
        AssertionError: If not; a line for each joint, with the time and the number.
        KeyError: If there is no such controller.
    """
    error = np.abs(rollout.tracking_error(controller))
    reference = rollout.references[controller]
    if not np.isfinite(reference.position).any():
        raise AssertionError(f"{controller}: it had no references")
    # Without a reference there is no error; a measured NaN is one.
    error[np.isnan(reference.position)] = 0.0
    error[np.isnan(error)] = np.inf
    lines = []
    for name, column in zip(reference.joint_names, error.T, strict=True):
        row = int(np.argmax(column))
        if column[row] > within:
            text = f"tracking error {column[row]:.4g} at {rollout.time[row]:.4g} s"
            lines.append(f"joint {name!r}: {text}; expected at most {within:g}")
    for name, seconds in rollout.effort_saturation().items():
        if saturation is None or name not in reference.joint_names:
            continue
        if seconds > saturation:
            column = rollout.is_at_limit[:, rollout.joint_names.index(name)]
            first = rollout.time[int(np.argmax(column))]
            text = f"at its effort limit for {seconds:.4g} s, first at {first:.4g} s"
            lines.append(f"joint {name!r}: {text}; expected at most {saturation:g} s")
    if lines:
        raise AssertionError("\n".join(lines))


def assert_success_rate(
    runs: Iterable[Any],
    function: Callable[[Any], Any] | None = None,
    *,
    at_least: float,
    confidence: float = 0.95,
    succeeds: Callable[[Any], bool] | None = None,
    **how: Any,
) -> int:
    """Assert that runs succeed at a rate; return how many it took to know.

    It holds if the lower bound of Wilson's interval, one-sided, is as high, for all
    runs together. It stops as soon as those that are left can't change that, either
    way: so its confidence is that of all runs, as if none was left out.

    Args:
        runs: As for `run_many`.
        function: As for `run_many`.
        at_least: The rate, between 0 and 1.
        confidence: That the rate is so high if it passes.
        succeeds: Whether what a run gave is a success; by default that nothing failed
            in an Outcome and all its goals ended, else that it is true. A run that
            raises has failed.
        how: What else `run_many` takes: `workers`, `on`, `to`, `time_limit` and so on.

    Raises:
        AssertionError: If the rate isn't shown; the first failures are named.
        InputError: If so few runs can't show it, even if all succeed.
    """
    check_confidence(confidence)
    if not 0.0 < at_least < 1.0:
        text = f"at_least: expected a rate between 0 and 1, got {at_least!r}"
        raise InputError(text)
    items = list(runs)
    most = most_failures(len(items), at_least, confidence) if items else -1
    if most < 0:
        needed = _find_needed(at_least, confidence)
        claim = f"at least {at_least:g} with confidence {confidence:g}"
        text = f"runs: {len(items)} can't show {claim}, even if all succeed"
        raise InputError(f"{text}; expected {needed} of them or more")
    failed: list[RunResult[Any]] = []
    num_done = 0
    iterate: Any = iterate_many
    results = iterate(items, function, ordered=False, **how)
    try:
        for result in results:
            num_done += 1
            if not _succeeded(result, succeeds):
                failed.append(result)
            if len(failed) > most:
                raise AssertionError(
                    _explain(failed, num_done, len(items), most, at_least, confidence)
                )
            if num_done - len(failed) >= len(items) - most:
                break
    finally:
        results.close()
    return num_done


def _succeeded(result: RunResult[Any], succeeds: Callable[[Any], bool] | None) -> bool:
    if result.error is not None:
        return False
    if succeeds is not None:
        return bool(succeeds(result.value))
    value = result.value
    if isinstance(value, Outcome):
        return not (value.failures or value.unfinished)
    return bool(value)


def _find_needed(at_least: float, confidence: float) -> int:
    """Return how few runs can show a rate."""

    def shows(number: int) -> bool:
        return rate_interval(number, number, confidence, sides=1).low >= at_least

    return 1 + bisect.bisect_left(range(1, _MOST_RUNS), True, key=shows)


def _explain(
    failed: list[RunResult[Any]],
    num_done: int,
    number: int,
    most: int,
    at_least: float,
    confidence: float,
) -> str:
    found = rate_interval(num_done - len(failed), num_done, confidence)
    lines = [
        f"{len(failed)} of {num_done} runs failed: a rate of {found.value:.4g} "
        f"({found.low:.4g} to {found.high:.4g}); at least {at_least:g} with confidence "
        f"{confidence:g} bears {most} of {number}"
    ]
    for result in failed[:_MOST_NAMED]:
        name = getattr(result.input, "name", "") or repr(result.input)
        why = _reason(result)
        lines.append(f"run {result.index} ({name:.60}): {why}")
    if len(failed) > _MOST_NAMED:
        lines.append(f"and {len(failed) - _MOST_NAMED} more")
    return "\n".join(lines)


def _reason(result: RunResult[Any]) -> str:
    if result.error is not None:
        return describe(result.error)
    value = result.value
    if isinstance(value, Outcome) and (value.failures or value.unfinished):
        return (*value.failures, *value.unfinished)[0]
    return f"it gave {value!r:.60}"
