"""Times that a simulation should reach, by closed forms and a clock of the test."""

import math

import pytest

from arm_drake.errors import InputError
from arm_drake.visualization.page import live_simulation as mut
from arm_drake.visualization.page.live_simulation import RealtimePacer


class Clock:
    """Wall time, which passes when it is told to [s]."""

    def __init__(self) -> None:
        # Far from 0, where floating point is coarser.
        self.now = 1000.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(mut, "time", clock)
    return clock


def play(
    pacer: RealtimePacer, clock: Clock, wait: float, count: int, *, cost: float = 0.0
) -> float:
    """Simulate after every wait; return how far it comes.

    Args:
        pacer: The pace, which has been started at 0.
        clock: The clock.
        wait: Time between two looks at it [s].
        count: How many.
        cost: Wall time that a simulated second takes [s].
    """
    simulated = 0.0
    for _ in range(count):
        clock.now += wait
        step = pacer.target(simulated) - simulated
        took = step * cost
        clock.now += took
        simulated += step
        pacer.note(simulated, step, took)
    return simulated


@pytest.mark.parametrize("rate", [0.1, 0.5, 1.0, 2.0])
def test_simulated_time_is_wall_time_times_the_rate(clock: Clock, rate: float) -> None:
    pacer = RealtimePacer(rate)
    pacer.start(0.0)

    # Pictures are 1/30 s apart; 300 of them.
    simulated = play(pacer, clock, 1.0 / 30.0, 300)

    # Sums of rounded numbers near 1000.
    assert simulated == pytest.approx(10.0 * rate, abs=1e-9)
    assert pacer.factor == pytest.approx(rate, rel=1e-9)
    assert pacer.wall_time == pytest.approx(10.0, abs=1e-9)


def test_a_rate_is_kept_also_where_simulating_takes_time(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)

    simulated = play(pacer, clock, 0.01, 500, cost=0.5)

    # What passes while it simulates is simulated the next time: the last steps.
    assert simulated == pytest.approx(pacer.wall_time, abs=0.02)
    assert pacer.factor == pytest.approx(1.0, abs=0.01)


def test_a_start_somewhere_else_counts_from_there(clock: Clock) -> None:
    pacer = RealtimePacer(2.0)
    pacer.start(5.0)

    clock.now += 0.02

    assert pacer.target(5.0) == pytest.approx(5.04, abs=1e-9)


def test_a_simulation_that_is_too_slow_goes_as_fast_as_it_can(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)

    # A simulated second takes four, all else a microsecond.
    simulated = play(pacer, clock, 1e-6, 400, cost=4.0)

    # 400 microseconds and the first, short steps are lost.
    assert simulated == pytest.approx(pacer.wall_time / 4.0, rel=1e-3)
    assert pacer.factor == pytest.approx(0.25, rel=1e-3)


@pytest.mark.parametrize("cost", [0.1, 4.0, 100.0])
@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_the_page_never_waits_much_longer_than_a_twentieth_of_a_second(
    clock: Clock, rate: float, cost: float
) -> None:
    pacer = RealtimePacer(rate)
    pacer.start(0.0)
    simulated = play(pacer, clock, 1e-3, 50, cost=cost)

    # However late it is.
    clock.now += 5.0
    step = pacer.target(simulated) - simulated

    assert 0.0 < step * cost <= 0.05 * (1.0 + 1e-6)


def test_what_was_missed_is_given_up_after_a_tenth_of_a_second(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)
    simulated = play(pacer, clock, 1.0 / 30.0, 30)

    # Something else had the processor.
    clock.now += 5.0
    after = simulated
    for _ in range(60):
        clock.now += 1.0 / 30.0
        step = pacer.target(after) - after
        after += step
        pacer.note(after, step, 0.0)

    # The first step makes up for a tenth, all others take a thirtieth.
    assert after - simulated == pytest.approx(0.1 + 59.0 / 30.0, abs=1e-6)


def test_a_short_delay_is_made_up_for(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)
    simulated = play(pacer, clock, 1.0 / 30.0, 30)

    clock.now += 0.05
    after = simulated
    for _ in range(30):
        clock.now += 1.0 / 30.0
        step = pacer.target(after) - after
        after += step
        pacer.note(after, step, 0.0)

    assert after == pytest.approx(pacer.wall_time, abs=1e-9)


def test_as_fast_as_it_goes_it_does_not_look_at_the_clock(clock: Clock) -> None:
    pacer = RealtimePacer(0.0)
    pacer.start(0.0)

    simulated = play(pacer, clock, 0.0, 200, cost=1e-3)

    # Steps of 50 ms of wall time, after those that find out how long they are.
    assert simulated > 100 * 0.05 / 1e-3
    assert pacer.factor == pytest.approx(1e3, rel=1e-6)


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_it_goes_on_after_a_step_of_no_length(clock: Clock, rate: float) -> None:
    pacer = RealtimePacer(rate)
    pacer.start(0.0)
    # Two looks at the same time of the clock; or the end is there.
    pacer.note(0.0, 0.0, 0.0)
    pacer.note(0.0, -1e-9, 1e-3)

    simulated = play(pacer, clock, 1.0 / 30.0, 30)

    assert simulated >= 1.0 - 0.1


def test_a_flood_of_events_does_not_slow_it_down(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)

    # Each event ends a wait, after 0.1 ms; then there are pictures alone.
    simulated = play(pacer, clock, 1e-4, 1000, cost=0.05)
    for _ in range(3):
        clock.now += 1.0 / 30.0
        step = pacer.target(simulated) - simulated
        simulated += step
        pacer.note(simulated, step, 0.05 * step)

    assert simulated == pytest.approx(pacer.wall_time, abs=1e-3)


def test_time_stands_while_it_is_stopped(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)
    clock.now += 2.0
    pacer.stop()
    clock.now += 100.0
    assert pacer.wall_time == pytest.approx(2.0)

    pacer.start(1.5)
    clock.now += 0.03

    assert pacer.target(1.5) == pytest.approx(1.53, abs=1e-9)
    assert pacer.wall_time == pytest.approx(2.03)


def test_to_stop_twice_is_to_stop_once(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)
    clock.now += 2.0
    pacer.stop()
    pacer.stop()

    assert pacer.wall_time == pytest.approx(2.0)


def test_another_rate_goes_on_with_the_wall_time(clock: Clock) -> None:
    old, new = RealtimePacer(1.0), RealtimePacer(2.0)
    old.start(0.0)
    clock.now += 3.0

    new.continue_from(old)
    new.start(3.0)
    clock.now += 1.0

    assert new.wall_time == pytest.approx(4.0)


def test_the_factor_is_that_of_the_last_second(clock: Clock) -> None:
    pacer = RealtimePacer(0.0)
    pacer.start(0.0)
    assert pacer.factor == 0.0

    simulated = 0.0
    for step in [0.1] * 50 + [0.02] * 15:
        clock.now += 0.1
        simulated += step
        pacer.note(simulated, step, 0.1)

    # 1 s for 5 s, then 0.2 s for a second, for 1.5 s.
    assert pacer.factor == pytest.approx(0.2, rel=1e-6)


def test_what_is_kept_for_the_factor_does_not_grow(clock: Clock) -> None:
    pacer = RealtimePacer(1.0)
    pacer.start(0.0)

    play(pacer, clock, 0.01, 5000)

    # A second of moments, and those at its ends.
    assert len(pacer._moments) <= 102


@pytest.mark.parametrize("rate", [-1.0, math.nan, math.inf, -math.inf])
def test_a_rate_that_cannot_be_is_said(rate: float) -> None:
    with pytest.raises(InputError) as caught:
        RealtimePacer(rate)

    assert str(caught.value) == f"real-time rate: expected at least 0, got {rate!r}"
