"""Which ticks of the manager a controller with a lower update rate runs in.

The rules are those of ros2_control's controller_manager (6.8.0,
``ControllerManager::update`` and ``configure_controller``). Times are integer
nanoseconds, rates are [Hz].
"""

from arm_drake.description.given import DISTROS
from arm_drake.errors import ParameterError
from arm_drake.messages import NANOSECONDS


def effective_rate(asked: int, manager_rate: int, *, distro: str = "jazzy") -> int:
    """Return the rate [Hz] that a controller gets.

    It is never above the manager's. From kilted on, one that doesn't divide the
    manager's is the manager's divided by a whole number, cut to whole Hz; up to jazzy
    it stays as it is, and the controller runs in the nearest ticks.

    Args:
        asked: The controller's parameter `update_rate` [Hz]; 0 is the manager's.
        manager_rate: Update rate of the manager [Hz].
        distro: Distribution whose rule holds.

    Raises:
        ParameterError: If ``asked`` is negative.
    """
    if asked < 0:
        problem = f"expected a rate above 0, or 0 for the manager's, got {asked}"
        raise ParameterError(problem, where="update_rate")
    if asked == 0 or asked >= manager_rate:
        return manager_rate
    if DISTROS.index(distro) < DISTROS.index("kilted"):
        return asked
    # The nearest whole number, half rounded up as C++ does; Python's round doesn't.
    divisor = (2 * manager_rate + asked) // (2 * asked)
    return manager_rate // divisor


def due_period(
    time_ns: int,
    last_ns: int | None,
    update_rate: int,
    manager_rate: int,
    manager_period_ns: int,
) -> int | None:
    """Return the period of the update due at a tick of the manager, or None.

    An update is due at the tick that is nearest to one period after the last update;
    of two as near, floating-point rounding decides, as it does upstream. The first
    tick after the activation always is.

    Args:
        time_ns: Time of the manager's tick [ns].
        last_ns: Time of the controller's last update [ns]; None if there is none yet.
        update_rate: Rate of the controller [Hz].
        manager_rate: Rate of the manager [Hz].
        manager_period_ns: Period of the manager's tick [ns].

    Returns:
        Time since the last update [ns]. In the first one it is the manager's period if
        the controller is as fast, else the controller's own, cut to whole nanoseconds.
    """
    if last_ns is None:
        if update_rate >= manager_rate:
            return manager_period_ns
        return int(1.0 / update_rate * NANOSECONDS)
    period_ns = time_ns - last_ns
    if update_rate >= manager_rate:
        return period_ns
    period = period_ns / NANOSECONDS
    error_now = abs(period * update_rate - 1.0)
    error_later = abs((period + 1.0 / manager_rate) * update_rate - 1.0)
    return period_ns if error_now <= error_later else None
