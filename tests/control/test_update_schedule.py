import pytest

from arm_drake.errors import ParameterError
from arm_drake.manager.lifecycle import due_period, effective_rate

MS = 1_000_000


def run(rate: int, manager_rate: int, ticks: int) -> list[tuple[int, int]]:
    """Return tick and period [ns] of each update under an even manager."""
    period_ns = 1_000_000_000 // manager_rate
    last_ns, updates = None, []
    for tick in range(ticks):
        due = due_period(tick * period_ns, last_ns, rate, manager_rate, period_ns)
        if due is not None:
            last_ns = tick * period_ns
            updates.append((tick, due))
    return updates


def test_half_the_rate_runs_in_every_other_tick():
    assert run(50, 100, 6) == [(0, 20 * MS), (2, 20 * MS), (4, 20 * MS)]


def test_a_rate_that_does_not_divide_runs_in_the_nearest_ticks():
    # 33.3 ms are nearer to 3 ticks of 10 ms than to 4.
    assert run(30, 100, 7) == [(0, 33_333_333), (3, 30 * MS), (6, 30 * MS)]


@pytest.mark.parametrize("rate", [100, 200])
def test_a_controller_as_fast_as_the_manager_runs_in_every_tick(rate):
    assert run(rate, 100, 3) == [(0, 10 * MS), (1, 10 * MS), (2, 10 * MS)]


def test_a_controller_as_fast_as_the_manager_leaves_out_no_early_tick():
    assert due_period(MS, 0, 100, 100, MS) == MS


def test_the_first_update_of_a_fast_controller_has_the_manager_s_period():
    assert due_period(0, None, 100, 100, 10_810_071) == 10_810_071


def test_the_first_update_of_a_slow_controller_has_its_own_period():
    assert due_period(5, None, 60, 500, 2 * MS) == 16_666_666


def test_an_update_has_the_time_since_the_last_one():
    assert due_period(20_099_450, 0, 50, 100, 9_348_273) == 20_099_450


def test_between_updates_nothing_is_due():
    assert due_period(10 * MS, 0, 50, 100, 10 * MS) is None


@pytest.mark.parametrize(
    ("requested", "manager_rate", "distro", "rate"),
    [
        (50, 100, "rolling", 50),
        (30, 100, "humble", 30),
        (30, 100, "jazzy", 30),
        (30, 100, "kilted", 33),
        (30, 100, "rolling", 33),
        # 100 / 40 = 2.5 is rounded up, as C++ does.
        (40, 100, "rolling", 33),
        (70, 100, "rolling", 100),
        (333, 1000, "rolling", 333),
        (0, 100, "jazzy", 100),
        (200, 100, "jazzy", 100),
        (200, 100, "rolling", 100),
    ],
)
def test_a_rate_becomes_what_the_distro_makes_of_it(
    requested, manager_rate, distro, rate
):
    assert effective_rate(requested, manager_rate, distro=distro) == rate


def test_without_a_distro_jazzy_s_rule_holds():
    assert effective_rate(30, 100) == 30


def test_a_negative_rate_is_an_error():
    with pytest.raises(ParameterError) as error:
        effective_rate(-5, 100)

    assert str(error.value) == (
        "update_rate: expected a rate above 0, or 0 for the manager's, got -5"
    )
