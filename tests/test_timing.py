"""Steps and ticks meet exactly, however long a simulation runs."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from arm_drake.timing import choose_time_step, cycle_at, fit_period, has_rate

RATES = [100, 125, 30, 60, 333, 500, 1000]
STEPS = [1e-3, 2e-3, 5e-3, 1e-2, 3e-3]

# Steps are rounded up in their last bits, by less than this part.
ROUNDING = 1e-11


class Clock(LeafSystem):
    """Notes the times of its periodic events."""

    def __init__(self, period: float) -> None:
        super().__init__()
        self.times: list[float] = []
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._note)

    def _note(self, context: Context, state: State) -> None:
        del state
        self.times.append(context.get_time())


@pytest.mark.parametrize("wanted", STEPS)
@pytest.mark.parametrize("rate", RATES)
def test_every_tick_is_a_step_to_the_last_bit(rate: int, wanted: float) -> None:
    step, (period,) = choose_time_step(wanted, [rate])

    multiple = round(period / step)
    ticks = np.arange(1, 10_001)
    np.testing.assert_array_equal(ticks * period, (ticks * multiple) * step)
    assert period == pytest.approx(1.0 / rate, rel=ROUNDING)


@pytest.mark.parametrize("wanted", STEPS)
@pytest.mark.parametrize("rate", RATES)
def test_the_step_is_the_largest_within_the_wanted_one(
    rate: int, wanted: float
) -> None:
    step, (period,) = choose_time_step(wanted, [rate])

    assert step <= wanted * (1.0 + ROUNDING)
    fewer = round(period / step) - 1
    assert fewer == 0 or period / fewer > wanted * (1.0 + ROUNDING)


@pytest.mark.parametrize("divisor", range(1, 12))
@pytest.mark.parametrize("rate", RATES)
def test_a_part_of_the_period_is_taken_whichever_way_it_rounds(
    rate: int, divisor: int
) -> None:
    step, (period,) = choose_time_step(1.0 / (rate * divisor), [rate])

    assert round(period / step) == divisor


@pytest.mark.parametrize("rate", RATES)
def test_no_tick_comes_before_its_time(rate: int) -> None:
    _, (period,) = choose_time_step(1e-3, [rate])

    assert period >= 1.0 / rate


@pytest.mark.parametrize(
    "rates", [[100, 50], [100, 125], [60, 30, 100], [500, 1000], [50, 1000]]
)
def test_one_step_divides_the_periods_of_several_managers(rates: list[int]) -> None:
    step, periods = choose_time_step(1e-2, rates)

    for rate, period in zip(rates, periods, strict=True):
        multiple = round(period / step)
        ticks = np.arange(1, 10_001)
        assert period == pytest.approx(1.0 / rate, rel=ROUNDING)
        np.testing.assert_array_equal(ticks * period, (ticks * multiple) * step)


def test_where_no_common_step_is_reasonable_the_first_manager_decides() -> None:
    # 1 / lcm(100, 333) is 30 us.
    step, periods = choose_time_step(1e-3, [100, 333])

    assert step == pytest.approx(1e-3, rel=ROUNDING)
    assert periods[0] == pytest.approx(1e-2, rel=ROUNDING)
    # The other one ticks every 3 steps, as near to 333 Hz as steps allow.
    assert periods[1] == 3 * step


def test_no_manager_ticks_more_often_than_the_plant_steps() -> None:
    # 1 / lcm(50, 333) is 60 us.
    step, periods = choose_time_step(2e-2, [50, 333])

    assert step <= 1.0 / 333.0
    assert periods[0] == pytest.approx(2e-2, rel=ROUNDING)
    assert periods[1] == step


def test_without_managers_the_step_is_as_wanted() -> None:
    assert choose_time_step(0.0123, []) == (0.0123, [])


@pytest.mark.parametrize(
    ("rate", "wanted"), [(100, 1e-3), (333, 3e-3), (30, 1e-2), (125, 2e-3)]
)
def test_a_simulator_s_events_coincide(rate: int, wanted: float) -> None:
    step, (period,) = choose_time_step(wanted, [rate])
    builder = DiagramBuilder()
    steps, ticks = Clock(step), Clock(period)
    builder.AddSystem(steps)
    builder.AddSystem(ticks)

    Simulator(builder.Build()).AdvanceTo(10.0)

    multiple = round(period / step)
    assert ticks.times == steps.times[::multiple]


@pytest.mark.parametrize(
    ("time", "number"),
    [(0.0, 0), (0.03, 3), (0.03 + 1e-12, 3), (0.0304, None), (0.0299, None)],
)
def test_a_cycle_is_there_at_its_time_only(time, number):
    assert cycle_at(time, 0.01) == number


def test_a_period_has_its_rate_but_for_rounding():
    assert has_rate(1.0 / 97.0, 97)
    assert not has_rate(0.01, 97)


@pytest.mark.parametrize("wanted", [1e-3, 1e-2])
@pytest.mark.parametrize(
    ("update_rate", "log_rate"),
    [
        (100, 3000),
        (100, 1000),
        (100, 100),
        (100, 20),
        (125, 1),
        (125, 1000),
        (30, 60),
        (30, 90),
        (30, 7),
    ],
)
def test_a_log_meets_the_ticks_to_the_last_bit(
    wanted: float, update_rate: int, log_rate: int
) -> None:
    step, (period,) = choose_time_step(wanted, [update_rate], log_rate)
    logged = fit_period(log_rate, step)

    assert step <= wanted * (1.0 + 1e-9)
    assert logged == pytest.approx(1.0 / log_rate, rel=1e-9)
    common = math.gcd(update_rate, log_rate)
    for k in range(0, 1_000_000, 997):
        # Products of whole numbers and a period, as Drake computes times of events.
        tick, row = k * update_rate // common, k * log_rate // common
        assert tick * period == row * logged


def test_a_log_rate_that_fits_no_step_stays_as_it_is() -> None:
    step, _ = choose_time_step(1e-3, [100], 333.3)

    assert fit_period(333.3, step) == 1.0 / 333.3


@pytest.mark.parametrize("log_rate", [1e-12, 1e-9, 1e-4])
def test_a_log_that_is_hardly_ever_written_does_not_touch_the_step(
    log_rate: float,
) -> None:
    assert choose_time_step(1e-3, [100], log_rate) == choose_time_step(1e-3, [100])
