"""Drive commands: the values of claimed command interfaces, by joint, for the servo.

A drive has n joints. Each follows a position (with the velocity that goes with it), a
velocity, an acceleration or an effort: what is claimed decides, in this order, and can
change at run time. An acceleration or an effort that is claimed beside a position is
added to what the position asks for. A joint that nobody commands holds its position, or
is left to swing. Some command interfaces move nothing, but limit effort and velocity.
"""

import dataclasses as dc
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array, Indices, Mask
from arm_drake.importing import dataclass
from arm_drake.messages import Message


@dataclass(frozen=True, eq=False)
class DriveMode(Message):
    """Command modes of n joints."""

    # Exactly one of these holds for a joint that is commanded. Shape (n,).
    is_position: Mask
    is_velocity: Mask
    is_acceleration: Mask
    is_effort: Mask

    # Whether a joint that follows a position is told its velocity too, an acceleration,
    # an effort. Shape (n,).
    is_guided: Mask
    is_accelerated: Mask
    is_pushed: Mask

    # Joints that nobody commands and that are left to swing, shape (n,).
    is_idle: Mask

    # Where the commands stand among the values; 0 where there is none. Shape (n,).
    position_at: Indices
    velocity_at: Indices
    acceleration_at: Indices
    effort_at: Indices

    # Where the limits of effort and of velocity stand; -1 where there is none. Shape
    # (n,) each.
    effort_limit_at: Indices
    velocity_limit_at: Indices

    # Rate of the controller that commands the joint [Hz], shape (n,).
    rate: Array

    # Of each joint: where its position stands among the values, -1 if it follows none,
    # and its rate [Hz]. What is few is quicker in plain numbers than in numpy.
    positions_at: tuple[tuple[int, float], ...] = dc.field(init=False)

    # Which elements of the drive vector are values, where these stand, and whether a
    # joint follows its velocity, its acceleration, its effort alone, (3 n,).
    others: tuple[tuple[int, int], ...] = dc.field(init=False)
    flags: tuple[float, ...] = dc.field(init=False)

    def __post_init__(self) -> None:
        """Prepare what every cycle reads."""
        at = np.where(self.is_position, self.position_at, -1)
        parts = (
            (self.is_guided | self.is_velocity, self.velocity_at),
            (self.is_acceleration | self.is_accelerated, self.acceleration_at),
            (self.is_effort | self.is_pushed, self.effort_at),
        )
        n = len(at)
        others = tuple(
            (k * n + int(i), int(where[i]))
            for k, (follows, where) in enumerate(parts, start=1)
            for i in np.flatnonzero(follows)
        )
        alone = (self.is_velocity, self.is_acceleration, self.is_effort | self.is_idle)
        flags = tuple(np.concatenate(alone).astype(float).tolist())
        places = tuple(zip(at.tolist(), self.rate.tolist(), strict=True))
        object.__setattr__(self, "positions_at", places)
        object.__setattr__(self, "others", others)
        object.__setattr__(self, "flags", flags)


def is_outdone(name: str, claims: Collection[str]) -> bool:
    """Return whether a drive does not act on a command, for it follows another one."""
    joint, _, interface = name.rpartition("/")
    if f"{joint}/{interfaces.POSITION}" in claims:
        return False  # To what a position asks for, all else is added.
    stronger = {
        interfaces.ACCELERATION: (interfaces.VELOCITY,),
        interfaces.EFFORT: (interfaces.VELOCITY, interfaces.ACCELERATION),
    }
    return any(f"{joint}/{other}" in claims for other in stronger.get(interface, ()))


# Parts of the drive vector, n each: desired position, velocity, acceleration, effort,
# and whether the joint follows the velocity, the acceleration or the effort alone.
# Without other modes than that of following positions the first two are all.
NUM_PARTS: Final = 7
TAU_D: Final = 3
IS_TAU: Final = 6

# Parts with limits of effort and of velocity, which stand behind these.
NUM_LIMITS: Final = 2

# How much faster positions may change than in the last cycle to count as a motion: the
# start of a quadratic has 3. What changes more is a step, which has no speed.
_GROWTH = 3.0
NUM_PARTS_OF_POSITIONS: Final = 2


class DriveCommands:
    """Converts values of command interfaces to commands of a drive of n joints."""

    def __init__(
        self,
        joints: Sequence[str],
        order: Sequence[str],
        *,
        velocity_lead: float | Array,
        has_modes: bool = True,
        has_limits: bool = False,
        holds: bool = True,
        stops: tuple[Array, Array] | None = None,
    ) -> None:
        """Create the map of n joints with actuators; `order` names command interfaces.

        `velocity_lead` is how far ahead of a moving joint the position is to which it
        moves on its own [s]; with `has_modes` joints may follow anything else than
        positions, with `has_limits` effort and velocity may be limited at run time,
        and what nobody commands `holds` its position. `stops` are the lowest and the
        highest positions, shapes (n,): a drive that is sent beyond would push with all
        that it has, and its robot would have nothing left for the other joints.
        """
        self._stops = stops
        self.joints = tuple(joints)
        self.has_modes = has_modes
        self.has_limits = has_limits
        self.holds = holds
        self._at = {name: index for index, name in enumerate(order)}
        self._lead = velocity_lead
        parts = NUM_PARTS if has_modes else NUM_PARTS_OF_POSITIONS
        self._zeros = np.zeros((parts - NUM_PARTS_OF_POSITIONS) * len(joints))
        self._no_limits = np.zeros(NUM_LIMITS * len(joints) if has_limits else 0)
        # Accelerations and efforts that nobody commands.
        self._still = (0.0,) * (2 * len(joints))
        lows, highs = (
            np.broadcast_to(x, len(joints)).tolist()
            for x in stops or (-math.inf, math.inf)
        )
        self._ranges = tuple(zip(lows, highs, strict=True))

    def initial(self, positions: Sequence[float]) -> Array:
        """Return the drive vector that holds positions."""
        q = np.asarray(positions, dtype=float)
        nothing = np.zeros_like(q)
        return np.concatenate([q, nothing, self._zeros, self._no_limits, nothing])

    def servo_input(self, drive: Array) -> Array:
        """Return the servo's part of a drive vector, shape (7 n,) or (2 n,).

        With limits 2 n more. The last part, the rate of change of the positions, is for
        the next cycle.
        """
        return drive[: len(drive) - len(self.joints)]

    def mode(
        self, claims: Mapping[str, float], limits: Mapping[str, str] | None = None
    ) -> DriveMode:
        """Return the mode of joints whose interfaces are claimed, at rates [Hz].

        `limits` are those of them that limit, "effort" or "velocity", by name.
        """
        limits = limits or {}
        claims = {name: rate for name, rate in claims.items() if name not in limits}

        def find(interface: str) -> tuple[Mask, Indices]:
            names = [f"{joint}/{interface}" for joint in self.joints]
            claimed = np.array([name in claims for name in names], dtype=bool)
            at = np.array([self._at.get(name, 0) for name in names], dtype=np.intp)
            return claimed, at

        position, position_at = find(interfaces.POSITION)
        velocity, velocity_at = find(interfaces.VELOCITY)
        acceleration, acceleration_at = find(interfaces.ACCELERATION)
        effort, effort_at = find(interfaces.EFFORT)
        moved = position | velocity
        claimed = moved | acceleration | effort
        rates = [
            next((rate for name, rate in claims.items() if _joint(name) == joint), 0.0)
            for joint in self.joints
        ]
        effort_limit_at, velocity_limit_at = (
            self._find_limits(limits, kind)
            for kind in (interfaces.EFFORT, interfaces.VELOCITY)
        )
        return DriveMode(
            is_position=position,
            is_velocity=velocity & ~position,
            is_acceleration=acceleration & ~moved,
            is_effort=effort & ~moved & ~acceleration,
            is_guided=position & velocity,
            is_accelerated=position & acceleration,
            is_pushed=position & effort,
            is_idle=np.full(len(claimed), not self.holds) & ~claimed,
            position_at=position_at,
            velocity_at=velocity_at,
            acceleration_at=acceleration_at,
            effort_at=effort_at,
            effort_limit_at=effort_limit_at,
            velocity_limit_at=velocity_limit_at,
            rate=np.array(rates),
        )

    def _find_limits(self, limits: Mapping[str, str], kind: str) -> Indices:
        """Return where the limits of a kind stand among the values; -1 if nowhere."""
        at = {_joint(n): self._at[n] for n, other in limits.items() if other == kind}
        return np.array([at.get(joint, -1) for joint in self.joints], dtype=np.intp)

    def seed(
        self,
        old: DriveMode,
        new: DriveMode,
        values: Array,
        drive: Array,
        measured: tuple[Array, Array, Array],
    ) -> tuple[Array, Array]:
        """Return values and drive vector of joints whose mode changes, without a jump.

        A joint that comes to follow a position starts where it comes to rest or is
        held, and without a velocity; one that follows a velocity with its own, one that
        follows an acceleration with none, one that follows an effort with that which it
        applies. `values` are of shape (k,), `drive` (8 n,), `measured` positions,
        velocities and efforts, each (n,).
        """
        values, drive = values.copy(), drive.copy()
        n = len(self.joints)
        zeros = np.zeros(n)
        q, v, tau = measured
        rest = q + self._lead * v
        stops = _moves_freely(old) & ~_moves_freely(new)
        drive[:n][stops] = rest[stops]
        for is_new, at, start in (
            (new.is_position & ~old.is_position, new.position_at, drive[:n]),
            (new.is_guided & ~old.is_guided, new.velocity_at, zeros),
            (new.is_accelerated & ~old.is_accelerated, new.acceleration_at, zeros),
            (new.is_pushed & ~old.is_pushed, new.effort_at, zeros),
            (new.is_velocity & ~old.is_velocity, new.velocity_at, v),
            (new.is_acceleration & ~old.is_acceleration, new.acceleration_at, zeros),
            (new.is_effort & ~old.is_effort, new.effort_at, tau),
        ):
            values[at[is_new]] = start[is_new]
        return values, drive

    def write(
        self,
        mode: DriveMode,
        values: Array,
        last: Array,
        *,
        fresh: Mask | None = None,
        skipped: Mask | None = None,
    ) -> Array:
        """Return the drive vector of a cycle, shape (8 n,), or (3 n,) without modes.

        With limits it has 2 n more, 0 where there is none. The velocity of a joint that
        is commanded positions alone is their rate of change; after a switch and at a
        step it is 0, for a jump is no speed. `values` have the shape (k,); `fresh` are
        joints whose controller starts, `skipped` those whose controller doesn't tick,
        shape (n,); None is none.
        """
        if fresh is not None or skipped is not None or self.has_limits:
            return self._write_anew(mode, values, last, fresh, skipped)
        # To the bit what the other way gives, in an eighth of the time.
        lasts, n = last.tolist(), len(self.joints)
        servo_input, rates = self.go_on(mode, values.tolist(), lasts[:n], lasts[-n:])
        return np.array(servo_input + rates)

    def go_on(
        self,
        mode: DriveMode,
        numbers: Sequence[float],
        lasts: Sequence[float],
        befores: Sequence[float],
    ) -> tuple[list[float], list[float]]:
        """Return the servo input of joints that go on, and the last part.

        That is the drive vector where nothing is limited. `numbers` are the values,
        `lasts` the positions and `befores` the rates of the last cycle's vector.
        """
        positions, speeds, rates = [], [], []
        # All at once: of few joints calls would take most of the time.
        for (at, per_second), (low, high), last, before in zip(
            mode.positions_at, self._ranges, lasts, befores, strict=True
        ):
            wanted = last if at < 0 else numbers[at]
            if low > wanted:
                wanted = low
            if high < wanted:
                wanted = high
            rate = (wanted - last) * per_second
            speed = 0.0  # That of a step.
            if rate * before > 0.0:  # Then both have the same sign.
                most = _GROWTH * before
                is_step = rate > most if before > 0.0 else rate < most
                speed = most if is_step else rate
            positions.append(wanted)
            speeds.append(speed)
            rates.append(rate)
        if not self.has_modes:
            return positions + speeds, rates
        servo_input = [*positions, *speeds, *self._still, *mode.flags]
        for i, at in mode.others:
            servo_input[i] = numbers[at]
        return servo_input, rates

    def go_on_for(
        self,
        mode: DriveMode,
        values: Array,
        lasts: Sequence[float],
        befores: Sequence[float],
    ) -> tuple[Array, Array]:
        """Return what `go_on` does for cycles in a row, to the bit.

        `values` are of shape (T, k); returned are what the servo is told, shape (T, 2 n
        or 7 n), and the rates, shape (T, n).
        """
        q = self._stop(np.where(mode.is_position, values[:, mode.position_at], lasts))
        with np.errstate(over="ignore", invalid="ignore"):  # As in plain numbers.
            rates = (q - _shift(q, lasts)) * mode.rate
            before = _shift(rates, befores)
            most = _GROWTH * before
            v = np.where(before > 0.0, np.minimum(rates, most), np.maximum(rates, most))
            v = np.where(rates * before > 0.0, v, 0.0)
        if not self.has_modes:
            return np.concatenate((q, v), axis=1), rates
        others = np.tile((*self._still, *mode.flags), (len(values), 1))
        servo_input = np.concatenate((q, v, others), axis=1)
        for i, k in mode.others:
            servo_input[:, i] = values[:, k]
        return servo_input, rates

    def _stop(self, positions: Array) -> Array:
        """Return positions that can be reached, shape (..., n).

        np.clip may take -0.0 for 0.0, which plain numbers don't.
        """
        if self._stops is None:
            return positions
        low, high = self._stops
        positions = np.where(low > positions, low, positions)
        return np.where(high < positions, high, positions)

    def _write_anew(
        self,
        mode: DriveMode,
        values: Array,
        last: Array,
        fresh: Mask | None,
        skipped: Mask | None,
    ) -> Array:
        """Return the drive vector where joints start, are skipped or have limits."""
        n, before = len(self.joints), last[len(last) - len(self.joints) :]
        told, rates = self.go_on(
            mode, values.tolist(), last[:n].tolist(), before.tolist()
        )
        servo_input, rate = np.array(told), np.array(rates)
        # The velocities that aren't commanded, but follow from positions.
        v, follows = servo_input[n : 2 * n], np.ones(n, dtype=bool)
        if self.has_modes:
            follows = ~(mode.is_guided | mode.is_velocity)
        if fresh is not None:
            rate[fresh] = 0.0
            v[fresh & follows] = 0.0
        if skipped is not None:
            rate[skipped] = before[skipped]
            at = skipped & follows
            v[at] = last[n : 2 * n][at]
        limits = self._no_limits
        if self.has_limits:
            places = np.concatenate([mode.effort_limit_at, mode.velocity_limit_at])
            limits = np.where(places < 0, 0.0, np.abs(values[places]))
        return np.concatenate((servo_input, limits, rate))


def _shift(rows: Array, first: Sequence[float]) -> Array:
    """Return rows after a first one, without the last."""
    shifted = np.empty_like(rows)
    shifted[0], shifted[1:] = first, rows[:-1]
    return shifted


def _moves_freely(mode: DriveMode) -> Mask:
    return mode.is_velocity | mode.is_acceleration | mode.is_effort | mode.is_idle


def _joint(name: str) -> str:
    return name.rpartition("/")[0]
