"""How many cores this process may use."""

import math
import os
from pathlib import Path

_V2 = Path("/sys/fs/cgroup")
_V1 = Path("/sys/fs/cgroup/cpu")


def available_cores() -> int:
    """Return how many cores this process may use: affinity, and a container's quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    quota = read_quota()
    return cores if quota is None else max(1, min(cores, math.ceil(quota)))


def read_quota(v2: Path = _V2, v1: Path = _V1) -> float | None:
    """Return how many cores a container may use by its cgroup, None if all.

    Source: the kernel's cgroup-v2 (`cpu.max`: quota and period in us, or "max") and
    cgroup-v1 (`cpu.cfs_quota_us`, -1 for none) documents.

    Args:
        v2: Where a container sees its cgroup, version 2.
        v1: The same, version 1.
    """
    try:
        quota, period = (v2 / "cpu.max").read_text().split()
    except (OSError, ValueError):
        try:
            quota = (v1 / "cpu.cfs_quota_us").read_text()
            period = (v1 / "cpu.cfs_period_us").read_text()
        except OSError:
            return None
    try:
        cores = float(quota) / float(period)
    except ValueError:  # "max"
        return None
    return cores if cores > 0.0 else None
