"""The ideal servo, sampled: what a peer computes that has it.

`sampled` is the law of our `accurate` preset: poles at exp(-w0 h), and a command that
is (T + h)/2 ahead on average. `exact` gives the continuous servo's positions to the
last digit at any step, for an engine that adds h v[+] to q; its command may jump at
ticks alone. Neither has limits, an observer or friction.
"""

from typing import NamedTuple

import numpy as np

from tests.benchmarks.peers.task import BANDWIDTH, PERIOD, Array, Commands, command_lead


class SampledServo(NamedTuple):
    """u = kp (b0 c + b1 c_before - q) - kd v, with c of now and of a step ago."""

    kp: float
    kd: float

    # Parts of the present command, and of that of a step ago.
    b0: float
    b1: float

    # What c adds of the commanded velocity [s].
    lead: float

    def commands(self, commands: Commands) -> tuple[Array, Array]:
        """Return what counts in the first step of each period, and in the others.

        Args:
            commands: What holds from each tick on.

        Returns:
            kp (b0 c + b1 c_before), each of shape (N, n).
        """
        c = commands.folded(self.lead)
        before = np.vstack([np.zeros_like(c[:1]), c[:-1]])
        return (
            self.kp * (self.b0 * c + self.b1 * before),
            self.kp * (self.b0 + self.b1) * c,
        )


def sampled(step: float) -> SampledServo:
    """Return the servo of our `accurate` preset.

    Args:
        step: Step of the physics h [s].
    """
    z = np.exp(-BANDWIDTH * step)
    lead = 2.0 / BANDWIDTH - (PERIOD + step) / 2.0
    return SampledServo(
        (1.0 - z) ** 2 / step**2, (1.0 - z**2) / step, 1.0, 0.0, float(lead)
    )


def exact(step: float) -> SampledServo:
    """Return the servo whose positions are the continuous one's.

    Args:
        step: Step of the physics h [s].
    """
    z, a = np.exp(-BANDWIDTH * step), BANDWIDTH * step
    kp = (1.0 - z) ** 2
    return SampledServo(
        kp / step**2,
        (1.0 - z**2) / step,
        float((1.0 - z * (1.0 + a)) / kp),
        float(z * (z - 1.0 + a) / kp),
        command_lead(),
    )
