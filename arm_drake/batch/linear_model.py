"""A linear model of a robot's closed loop: poles, responses, margins."""

import cmath
import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from arm_drake.arrays import Array
from arm_drake.errors import InputError, MissingExtraError, check_known, counted
from arm_drake.importing import dataclass

# An eigenvalue that is smaller is of what ends within a period.
_ENDED = 1e-4

# An eigenvector of length 1 that moves joints by less moves none [rad, m].
_UNSEEN = 1e-9

# Compliances below are that of an integrator, and rounding [rad/(N·m), m/N].
_NO_SLACK = 1e-9

# How far from 1 an eigenvalue on the unit circle may be found.
_ON_CIRCLE = 1e-9

# How many systems of equations are solved at once.
_AT_ONCE = 64

# What is left of an equation that holds, beside its right side.
_TINY = 1e-9


class Pole(NamedTuple):
    """An eigenvalue of the closed loop."""

    # Per period, and as s = log(z) / period [1/s].
    z: complex
    s: complex

    # |s| [rad/s], and -Re(s) / |s|: 1 doesn't swing, below 0 grows.
    natural_frequency: float
    damping: float

    # The joint that moves most in it.
    joint: str


class Margins(NamedTuple):
    """Stability margins of the loop of a joint, broken at its effort."""

    # Factors on the loop's gain that it bears, upwards and downwards; inf and 0 if any.
    gain: float
    gain_down: float

    # Delay in angle that it bears [rad], where the gain is 1, and that frequency
    # [rad/s]; inf and nan if it is nowhere.
    phase: float
    crossover: float

    # Least distance of the loop's locus from -1.
    modulus: float


@dataclass(frozen=True, eq=False)
class LinearModel:
    """The closed loop around a state: x[k+1] = A x[k] + B r[k] + E d[k], q[k] = C x[k].

    All are differences from the state where it was taken. r are the commands of
    `commanded`, which hold from the tick at k; d are efforts on `joints`, which act
    until the next one [N·m, N].
    """

    # From tick to tick [s].
    period: float

    # n joints that controllers drive, and m of them whose position is commanded.
    joints: tuple[str, ...]
    commanded: tuple[str, ...]

    # Names of the N states; shapes (N, N), (N, m), (N, n) and (n, N).
    states: tuple[str, ...]
    A: Array
    B: Array
    E: Array
    C: Array

    # Where it was taken: positions by joint [rad, m], and whether it stood still there.
    positions: Mapping[str, float]
    at_rest: bool

    # By joint; those of joints with a servo are of the servo alone, at the physics'
    # step, with its command held.
    margins: Mapping[str, Margins]

    # By joint of `commanded`: the largest step of its command [rad, m] whose response
    # is that of the model within `region_tolerance` of its height; empty if not asked.
    region: Mapping[str, float] = dc.field(default_factory=dict)

    def __repr__(self) -> str:
        """Return its joints, how large it is, and whether it is stable."""
        size = f"{counted(len(self.states), 'state')}, {self.period:g} s a tick"
        kind = "stable" if self.is_stable else "unstable"
        return f"<LinearModel, joints {[*self.joints]}, {size}, {kind}>"

    @property
    def poles(self) -> list[Pole]:
        """The poles, the slowest first, without what ends at once or moves no joint."""
        values, vectors = np.linalg.eig(self.A)
        moved = np.abs(self.C @ vectors)
        found = []
        for z, parts in zip(values, moved.T, strict=True):
            if abs(z) < _ENDED:
                continue
            s = cmath.log(complex(z)) / self.period
            damping = -s.real / abs(s) if s else 1.0
            joint = self.joints[int(np.argmax(parts))]
            if parts.max() > _UNSEEN:
                found.append(Pole(complex(z), s, abs(s), damping, joint))
        return sorted(found, key=lambda pole: (-pole.s.real, pole.s.imag))

    @property
    def is_stable(self) -> bool:
        """Whether no pole is outside the unit circle."""
        return all(abs(pole.z) < 1.0 + _ON_CIRCLE for pole in self.poles)

    def response(
        self,
        frequencies: Sequence[float] | Array,
        joint: str,
        *,
        to: str = "command",
        of: str | None = None,
    ) -> Array:
        """Return the complex response of a position, sampled at the ticks.

        Args:
            frequencies: Frequencies [rad/s], shape (k,), up to pi / period.
            joint: What is commanded, or pushed.
            to: "command", which gives [rad/rad], or "disturbance" [rad/(N·m)].
            of: Joint whose position it is; by default the same one.

        Returns:
            The response, shape (k,); infinite at a pole that it has.

        Raises:
            InputError: If there is no such joint, or it isn't commanded.
        """
        matrix = self._column(joint, to)
        row = self.C[_index(of or joint, self.joints)]
        z = np.exp(1j * np.asarray(frequencies, dtype=float) * self.period)
        return transfer(self.A, matrix, row, z)

    def _column(self, joint: str, to: str) -> Array:
        if to == "command":
            return self.B[:, _index(joint, self.commanded)]
        if to != "disturbance":
            raise InputError(f"to: unknown {to!r}; known: command, disturbance")
        return self.E[:, _index(joint, self.joints)]

    def frequencies(self, count: int = 400) -> Array:
        """Return frequencies for a plot [rad/s], shape (count,), up to pi / period."""
        top = math.pi / self.period
        return np.geomspace(top * 1e-4, top, count)

    def bandwidth(self, joint: str) -> float:
        """Return where a position's response to its command falls by 3 dB [rad/s].

        It is pi / period if it doesn't.
        """
        at = self.frequencies(2000)
        gain = np.abs(self.response(at, joint))
        below = np.flatnonzero(gain < gain[0] / math.sqrt(2.0))
        return float(at[below[0]]) if below.size else math.pi / self.period

    def resonance(self, joint: str) -> float:
        """Return the largest gain from a command to its position, of that at rest."""
        gain = np.abs(self.response(self.frequencies(2000), joint))
        return float(gain.max() / gain[0])

    def stiffness(self, joint: str) -> float:
        """Return what effort holds a joint off its place at rest [N·m/rad, N/m].

        It is inf where an integrator makes up for the effort.
        """
        row, column = _index(joint, self.joints), self._column(joint, "disturbance")
        slack = self.C[row] @ np.linalg.pinv(np.eye(len(self.A)) - self.A) @ column
        return math.inf if abs(slack) < _NO_SLACK else float(1.0 / slack)

    def step_response(self, joint: str, ticks: int) -> Array:
        """Return positions of the joints at ticks after a step of 1 of a command.

        Args:
            joint: What is commanded.
            ticks: How many, k.

        Returns:
            Positions [rad, m], shape (k, n).
        """
        column = self._column(joint, "command")
        x, rows = np.zeros(len(self.A)), []
        for _ in range(ticks):
            x = self.A @ x + column
            rows.append(self.C @ x)
        return np.array(rows)

    def to_control(self, to: str = "command") -> Any:
        """Return it as a discrete StateSpace of python-control.

        Args:
            to: Its inputs: "command" or "disturbance".

        Raises:
            MissingExtraError: Without python-control.
        """
        try:
            import control
        except ImportError:
            raise MissingExtraError("a StateSpace of control", "analysis") from None
        names = self.commanded if to == "command" else self.joints
        columns = [self._column(name, to) for name in names]
        B = np.array(columns).reshape(len(names), len(self.A)).T
        D = np.zeros((len(self.joints), len(names)))
        labels = {"inputs": list(names), "outputs": list(self.joints)}
        return control.ss(self.A, B, self.C, D, self.period, **labels)


def _index(joint: str, names: Sequence[str]) -> int:
    check_known("joint", joint, names)
    return names.index(joint)


def transfer(A: Array, b: Array, c: Array, z: Array) -> Array:
    """Return c (zI - A)^-1 b at each z, shape of z."""
    size, found = len(A), np.empty(len(z), dtype=complex)
    diagonal = np.arange(size)
    # A few at a time: of thousands the matrices leave the processor's cache.
    for first in range(0, len(z), _AT_ONCE):
        some = z[first : first + _AT_ONCE]
        resolvents = np.empty((len(some), size, size), dtype=complex)
        resolvents[:] = -A
        resolvents[:, diagonal, diagonal] += some[:, None]
        columns = np.broadcast_to(b.astype(complex), (len(some), size))[..., None]
        try:
            solved = np.linalg.solve(resolvents, columns)[..., 0] @ c
        except np.linalg.LinAlgError:  # One of them is a pole.
            solved = np.array([_at_pole(each, b, c) for each in resolvents])
        found[first : first + _AT_ONCE] = solved
    return found


def _at_pole(resolvent: Array, b: Array, c: Array) -> complex:
    """Return a response that may be infinite: where the pole's motion is pushed."""
    x = np.linalg.lstsq(resolvent, b.astype(complex), rcond=None)[0]
    off = np.abs(resolvent @ x - b).max()
    return complex(c @ x) if off <= _TINY * np.abs(b).max() else complex(math.inf)


def margins_of(L: Array, at: Array) -> Margins:
    """Return the margins of a loop's response at frequencies [rad/s]."""
    angle, size = np.unwrap(np.angle(L)), np.abs(L)
    # Where the locus crosses the negative real axis.
    turns = np.floor((angle + math.pi) / (2.0 * math.pi))
    cross = np.flatnonzero(np.diff(turns))
    at_cross = []
    for k in cross:
        goal = 2.0 * math.pi * max(turns[k], turns[k + 1]) - math.pi
        part = (goal - angle[k]) / (angle[k + 1] - angle[k])
        at_cross.append(math.exp(np.interp(part, [0, 1], np.log(size[k : k + 2]))))
    if L[-1].real < 0.0:  # At half the rate it is real.
        at_cross.append(float(size[-1]))
    up = [1.0 / each for each in at_cross if each < 1.0]
    down = [1.0 / each for each in at_cross if each >= 1.0]
    phases = []
    for k in np.flatnonzero(np.diff(np.sign(np.log(size)))):
        part = np.log(size[k]) / np.log(size[k] / size[k + 1])
        here = angle[k] + part * (angle[k + 1] - angle[k])
        phase = (here + math.pi) % (2.0 * math.pi)
        phase -= 2.0 * math.pi if phase > math.pi else 0.0
        phases.append((abs(phase), phase, at[k] + part * (at[k + 1] - at[k])))
    _, phase, crossover = min(phases, default=(0.0, math.inf, math.nan))
    return Margins(
        min(up, default=math.inf),
        max(down, default=0.0),
        float(phase),
        float(crossover),
        float(np.abs(1.0 + L).min()),
    )
