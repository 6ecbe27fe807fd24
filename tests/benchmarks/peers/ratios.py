"""Ratios of results, turn by turn, and the ratios that goals ask for."""

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from tests.benchmarks.peers.run import Result

Times = Callable[[Result], Sequence[float]]


class Ratio(NamedTuple):
    """How many times as long one contestant takes: median, least and most of turns."""

    median: float
    least: float
    most: float

    def __str__(self) -> str:
        """Return it as a table has it."""
        return f"{self.median:.2f} ({self.least:.2f} to {self.most:.2f})"


class Choice(NamedTuple):
    """How to pick a contestant: the cheapest that is exact enough."""

    engine: str
    setting: str

    # Its steps [s]; empty for all.
    steps: tuple[float, ...] = ()

    # Whether positions may be moved by half a step, if that helps.
    is_corrected: bool = False

    def fits(self, result: Result) -> bool:
        """Return whether a result is one of those to choose from."""
        return (
            (result.engine, result.setting) == (self.engine, self.setting)
            and not result.problem
            and (not self.steps or result.step in self.steps)
        )

    def error(self, result: Result) -> float:
        """Return the error that counts [rad]; the tracking error for its own law."""
        if result.law == "own" or result.error is None:
            assert result.track is not None
            return result.track
        return best_error(result) if self.is_corrected else result.error


def best_error(result: Result) -> float:
    """Return the error of the positions, or those moved by half a step if better."""
    errors = (result.error, result.error_ahead, result.error_back)
    return min(error for error in errors if error is not None)


def correction(result: Result) -> str:
    """Return which way to move positions by half a step: "+", "-" or "" for neither."""
    if result.error is None or best_error(result) == result.error:
        return ""
    return "+" if best_error(result) == result.error_ahead else "-"


def ratio(one: Sequence[float], other: Sequence[float]) -> Ratio:
    """Return the ratio of times that were taken in turns."""
    turns = [a / b for a, b in zip(one, other, strict=True)]
    return Ratio(statistics.median(turns), min(turns), max(turns))


def cheapest(
    results: Iterable[Result], choice: Choice, limit: float, times: Times
) -> Result | None:
    """Return the cheapest result whose error is within a limit, if there is one.

    Args:
        results: Results of one robot.
        choice: Which of them to choose from.
        limit: Largest error [rad]; infinity for any.
        times: What counts as their times.
    """
    fit = [r for r in results if choice.fits(r) and choice.error(r) <= limit]
    return min(fit, key=lambda r: statistics.median(times(r)), default=None)


def most_exact(
    results: Iterable[Result], choice: Choice, limit: float, times: Times
) -> Result | None:
    """Return the most exact result that costs no more than a limit, if there is one.

    Args:
        results: Results of one robot.
        choice: Which of them to choose from.
        limit: Largest time [ms per simulated second].
        times: What counts as their times.
    """
    fit = [
        r for r in results if choice.fits(r) and statistics.median(times(r)) <= limit
    ]
    return min(fit, key=choice.error, default=None)


class Goal(NamedTuple):
    """A ratio that is aimed at."""

    what: str

    ours: Choice
    theirs: Choice

    # Largest error of either [rad].
    limit: float

    # What the ratio is to be at most, and whether it has to be less.
    most: float

    # Whether only the time of a peer is of interest, for it is what its users run.
    is_as_it_is: bool = False

    def measure(self, results: Sequence[Result], times: Times) -> Ratio | str:
        """Return the ratio, or why there is none."""
        mine = cheapest(results, self.ours, self.limit, times)
        limit = math.inf if self.is_as_it_is else self.limit
        other = cheapest(results, self.theirs, limit, times)
        for found, choice in ((mine, self.ours), (other, self.theirs)):
            if found is None:
                return f"no {choice.setting} ({choice.engine}) is there, or exact"
        assert mine is not None
        assert other is not None
        return ratio(times(mine), times(other))


_OURS, _CPP = "arm_drake", "Drake, C++ only"
_MUJOCO = "position actuators, implicitfast"


def goals() -> list[Goal]:
    """Return what is aimed at, with each preset against each peer."""
    found = [
        Goal(
            f"accurate against C++ only, {1e3 * step:g} ms",
            Choice(_OURS, "accurate", (step,)),
            Choice(_CPP, "same servo", (step,)),
            math.inf,
            most,
        )
        for step, most in ((0.001, 1.1), (0.01, 1.7))
    ]
    found += [
        Goal(
            f"an empty tick in Python against C++ only, {1e3 * step:g} ms",
            Choice(_CPP, "same servo, and an empty tick in Python", (step,)),
            Choice(_CPP, "same servo", (step,)),
            math.inf,
            math.nan,
        )
        for step in (0.001, 0.01)
    ]
    fast, accurate = Choice(_OURS, "fast"), Choice(_OURS, "accurate")
    usual = Choice("MuJoCo", _MUJOCO)
    found += [
        Goal("accurate, 1e-3 rad, MuJoCo implicitfast", accurate, usual, 1e-3, 3.5),
        Goal(
            "the same, MuJoCo corrected by half a step",
            accurate,
            usual._replace(is_corrected=True),
            1e-3,
            math.nan,
        ),
        Goal(
            "the same, MuJoCo by mujoco.rollout",
            accurate,
            Choice("MuJoCo", "position actuators, mujoco.rollout"),
            1e-3,
            math.nan,
        ),
        Goal(
            "the same, MuJoCo with our servo in Python",
            accurate,
            Choice("MuJoCo", "our servo, Python"),
            1e-3,
            math.nan,
        ),
        Goal(
            "C++ only, 1e-3 rad, MuJoCo implicitfast",
            Choice(_CPP, "same servo"),
            usual,
            1e-3,
            math.nan,
        ),
        Goal(
            "an empty tick in Python, 1e-3 rad, MuJoCo implicitfast",
            Choice(_CPP, "same servo, and an empty tick in Python"),
            usual,
            1e-3,
            math.nan,
        ),
        Goal(
            "fast, 2.3e-4 rad, MuJoCo implicitfast 1 ms",
            fast,
            usual._replace(steps=(0.001,)),
            2.3e-4,
            1.3,
            is_as_it_is=True,
        ),
    ]
    peers = [
        ("MuJoCo corrected by half a step", usual._replace(is_corrected=True), 3.0),
        (
            "MuJoCo by mujoco.rollout",
            Choice("MuJoCo", "position actuators, mujoco.rollout"),
            math.nan,
        ),
        ("MuJoCo with the exact servo", Choice("MuJoCo", "exact ZOH"), 3.0),
        ("the least that Drake takes", Choice(_CPP, "exact ZOH"), math.nan),
        ("DART springs", Choice("DART", "implicit springs"), 1.0),
        (
            "DART springs corrected",
            Choice("DART", "implicit springs", is_corrected=True),
            1.0,
        ),
        ("Pinocchio, exact servo", Choice("Pinocchio loop", "exact ZOH"), 1.0),
    ]
    for name, choice, most in peers:
        found.append(Goal(f"fast, 2.3e-4 rad, {name}", fast, choice, 2.3e-4, most))
    found.append(
        Goal(
            "the least that Drake takes, 2.3e-4 rad, MuJoCo implicitfast 1 ms",
            Choice(_CPP, "exact ZOH"),
            usual._replace(steps=(0.001,)),
            2.3e-4,
            math.nan,
            is_as_it_is=True,
        )
    )
    for preset, chosen in (("fast", fast), ("accurate", accurate)):
        found += [
            Goal(
                f"{preset}, tracking as PyBullet's 1 ms",
                chosen,
                Choice("PyBullet", "POSITION_CONTROL", (0.001,)),
                math.inf,
                1.0,
            ),
            Goal(
                f"{preset}, 1e-3 rad, DART springs",
                chosen,
                Choice("DART", "implicit springs"),
                1e-3,
                1.0,
            ),
        ]
    return found
