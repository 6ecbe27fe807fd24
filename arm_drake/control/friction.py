"""Numbers of dry friction, from samples of the robot's dynamics."""

import dataclasses as dc

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.servo import DynamicsSamples

# Pole of the presliding motion.
_POLE = 0.2


@dc.dataclass(frozen=True)
class FrictionGains:
    """Numbers of elastoplastic dry friction for n joints."""

    # Stiffness [N·m/rad] and damping [N·m·s/rad] of the presliding, shape (n,).
    kf: Array
    df: Array


def compute_friction_gains(samples: DynamicsSamples, time_step: float) -> FrictionGains:
    """Return the numbers of a friction that sticks and is stable at any step.

    Args:
        samples: Dynamics of all the joints that have friction, with the step's damping
            h D in their inertia.
        time_step: Step of the plant h [s].
    """
    diagonal = samples.inertia
    scale = np.sqrt(diagonal)
    correlation = samples.mass_matrix / scale[:, :, None] / scale[:, None, :]
    coupling = float(np.linalg.eigvalsh(correlation).min())
    min_inertia = diagonal.min(axis=0)
    z = _POLE
    reach = coupling * min_inertia
    own = reach - coupling * time_step * samples.damping
    return FrictionGains(
        kf=reach * (1.0 - z) ** 2 / time_step**2,
        df=(own - reach * z**2) / time_step,
    )
