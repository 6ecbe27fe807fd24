"""What a simulation leaves behind: arrays with names, to save and to look at."""

import dataclasses as dc
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.errors import OutputError, suggest
from arm_drake.visualization.plot import plot_tracking

Array = NDArray[np.float64]

# An effort within this part of its limit is at the limit.
_AT_LIMIT = 1e-6


@dc.dataclass(frozen=True, eq=False)
class Reference:
    """What a controller wanted of its joints."""

    # Joints, k of them.
    joint_names: tuple[str, ...]

    # Positions [rad] or [m], shape (N, k); NaN before the first command.
    position: Array


@dc.dataclass(frozen=True, eq=False)
class Rollout:
    """The recorded motion of a robot: N rows, J movable joints.

    A row is the state right after a read at a tick of the controller manager, before
    the tick's command acts.
    """

    # Times of the rows [s], shape (N,).
    time: Array

    # In the order of the description.
    joint_names: tuple[str, ...]

    # [rad] or [m], [rad/s] or [m/s], [N·m] or [N], each of shape (N, J). The effort is
    # what the joint's actuator applies, gravity compensation included, friction not.
    position: Array
    velocity: Array
    effort: Array

    # Effort limit of each joint, infinite where there is none, shape (J,).
    effort_limit: Array

    # URDF type of each joint.
    joint_types: tuple[str, ...]

    # What each controller wanted, by its name.
    references: Mapping[str, Reference]

    def effort_saturation(self) -> dict[str, float]:
        """Return how long joints were at their effort limit [s], by joint.

        Joints that never were are left out. The time is counted in rows.
        """
        if len(self.time) < 2:
            return {}
        row = float(self.time[-1] - self.time[0]) / (len(self.time) - 1)
        is_at_limit = np.abs(self.effort) >= (1.0 - _AT_LIMIT) * self.effort_limit
        return {
            name: count * row
            for name, count in zip(
                self.joint_names, is_at_limit.sum(axis=0).tolist(), strict=True
            )
            if count
        }

    def tracking_error(self, controller: str) -> Array:
        """Return reference less measured positions, shape (N, k).

        Args:
            controller: Name of the controller whose k joints to look at.

        Raises:
            KeyError: If there is no such controller.
        """
        if controller not in self.references:
            raise KeyError(
                f"no references of {controller!r}; "
                f"{suggest(controller, self.references)}"
            )
        reference = self.references[controller]
        columns = [self.joint_names.index(name) for name in reference.joint_names]
        return reference.position - self.position[:, columns]

    def save(self, path: str | Path) -> None:
        """Write the rollout; the same rollout always gives the same bytes.

        Args:
            path: `.npz` for arrays, `.csv` for a table with units in its head.

        Raises:
            OutputError: If the file can't be written, or its type is unknown.
        """
        path = Path(path)
        write = writer_for(path)
        try:
            write(self, path)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(f"can't be written: {reason}", file=path) from None

    def plot(self, path: str | Path) -> None:
        """Draw reference and measured position of every joint into a picture.

        Args:
            path: `.png`, `.svg` or `.pdf` file to write.
        """
        plot_tracking(
            Path(path),
            time=self.time,
            names=self.joint_names,
            types=self.joint_types,
            position=self.position,
            references={
                name: (reference.joint_names, reference.position)
                for name, reference in self.references.items()
            },
        )


def writer_for(path: Path) -> Callable[[Rollout, Path], None]:
    """Return what writes a rollout to a file of this type.

    Raises:
        OutputError: If the type is unknown.
    """
    if path.suffix not in _WRITERS:
        raise OutputError(
            f"unknown type {path.suffix!r} of a log; expected one of "
            f"{', '.join(sorted(_WRITERS))}",
            file=path,
        )
    return _WRITERS[path.suffix]


def _write_npz(rollout: Rollout, path: Path) -> None:
    arrays: dict[str, Any] = {
        "time": rollout.time,
        "joint_names": np.array(rollout.joint_names, dtype=np.str_),
        "position": rollout.position,
        "velocity": rollout.velocity,
        "effort": rollout.effort,
    }
    for name, reference in rollout.references.items():
        arrays[f"{name}/reference"] = reference.position
        arrays[f"{name}/joint_names"] = np.array(reference.joint_names, dtype=np.str_)
    with path.open("wb") as file:
        np.savez(file, **arrays)


def _write_csv(rollout: Rollout, path: Path) -> None:
    columns = {"time [s]": rollout.time}
    quantities = {
        interfaces.POSITION: rollout.position,
        interfaces.VELOCITY: rollout.velocity,
        interfaces.EFFORT: rollout.effort,
    }
    joints = list(zip(rollout.joint_names, rollout.joint_types, strict=True))
    for quantity, values in quantities.items():
        for column, (name, joint_type) in enumerate(joints):
            unit = interfaces.unit(quantity, joint_type)
            columns[f"{name} {quantity} [{unit}]"] = values[:, column]
    types = dict(joints)
    for controller, reference in rollout.references.items():
        for column, name in enumerate(reference.joint_names):
            unit = interfaces.unit(interfaces.POSITION, types[name])
            head = f"{controller} {name} reference [{unit}]"
            columns[head] = reference.position[:, column]
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        for row in zip(*columns.values(), strict=True):
            numbers = (
                "" if math.isnan(number) else repr(float(number)) for number in row
            )
            file.write(",".join(numbers) + "\n")


_WRITERS: Mapping[str, Callable[[Rollout, Path], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
}
