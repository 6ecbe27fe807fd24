"""Steps of Drake's Simulator, whose faults are errors of ours."""

from pydrake.systems.analysis import Simulator

from arm_drake.errors import SimulationError


def advance(simulator: Simulator, time: float) -> None:
    """Simulate up to a time.

    Args:
        simulator: What to advance.
        time: Simulated time to stop at [s].

    Raises:
        SimulationError: If Drake can't go on, as with a state beyond all numbers.
    """
    try:
        simulator.AdvanceTo(time)
    # Drake's own checks end in a SystemExit.
    except (RuntimeError, SystemExit) as error:
        now, reason = simulator.get_context().get_time(), " ".join(str(error).split())
        text = f"the simulation can't go on at {now:.4f} s: {reason}"
        raise SimulationError(text) from error
