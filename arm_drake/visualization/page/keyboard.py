"""Driving by the keyboard of the page: arrows move a base, digits jog joints."""

import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

from arm_drake.errors import InputError, suggest
from arm_drake.interfaces import POSITION
from arm_drake.visualization.page.parts import Live, Part
from arm_drake.visualization.page.widgets import Choice, Section, Slider, Text, Toggle
from arm_drake.visualization.teleop.remotes import BaseRemote

# Names of keys, as in JavaScript's KeyboardEvent.code. With shift digits go back.
DIGITS = tuple(f"Digit{number}" for number in range(1, 10))
ARROWS: Mapping[str, tuple[str, float]] = {
    "ArrowUp": ("forward", 1.0),
    "ArrowDown": ("forward", -1.0),
    "ArrowLeft": ("turn", 1.0),
    "ArrowRight": ("turn", -1.0),
}
SHIFT = "Shift"

# While a key is down the browser says so again and again; what wasn't said for so long
# isn't so any more, in wall time: a browser may be gone [s].
_PATIENCE = 1.0

# Joints are told where to go so often, in simulated time [s].
_PERIOD = 0.05

_NOTHING = "nothing"


class Keyboard(Part):
    """The section that lets keys drive; nothing is sent while none is down."""

    word = "keys"

    def __init__(self, live: Live) -> None:
        """Create it for the controllers of a simulation, switched off."""
        self._live = live
        self.is_on, self.percent = False, 50.0
        self.bases = {
            r.controller: r for r in live.remotes if isinstance(r, BaseRemote)
        }
        self.arms = {r.controller: r for r in live.remotes if r.axes()}
        self.base = next(iter(self.bases), _NOTHING)
        self.arm = next(iter(self.arms), _NOTHING)
        self._pressed: frozenset[str] = frozenset()
        self._heard, self._last = 0.0, math.nan
        # What is told something that has to end with the key.
        self._driving: dict[str, float] = {}
        self._turning: set[str] = set()

    def hold(self, keys: Iterable[object]) -> None:
        """Take which of `ARROWS`, `DIGITS` and "Shift" are down, in wall time now."""
        known = {SHIFT, *ARROWS, *DIGITS}
        names = set(filter(known.__contains__, map(str, keys)))
        before, self._pressed = self._pressed, frozenset(names)
        self._heard = time.perf_counter()
        if not self._pressed - {SHIFT}:
            self._let_go()
        elif not before - {SHIFT}:
            self._last = self._live.simulation.time

    def advance(self) -> float:
        """Send controllers the commands of the keys."""
        if not self._is_driving():
            return math.inf
        now = self._live.simulation.time
        if now >= self._last + _PERIOD or now < self._last:
            passed, self._last = max(now - self._last, 0.0), now
            try:
                self._drive()
                self._jog(passed)
            except InputError as error:
                self._pressed = frozenset()
                self._driving, self._turning = {}, set()
                self._live.page.say(str(error), "error")
                return math.inf
        return max(self._last + _PERIOD - now, 0.0) or _PERIOD

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, by id."""
        self._is_driving()
        return {
            "keys:on": {"value": self.is_on},
            "keys:base": {"value": self.base},
            "keys:arm": {"value": self.arm},
            "keys:speed": {"value": self.percent},
        }

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "held":
            self.hold(value if self.is_on and isinstance(value, list) else ())
        elif what == "on":
            self.is_on = bool(value)
            self.hold(())
        elif what in ("base", "arm"):
            self.hold(())
            known = self.bases if what == "base" else self.arms
            if value not in (*known, _NOTHING):
                hint = suggest(str(value), known)
                raise InputError(f"keyboard: no controller {value!r}; {hint}")
            setattr(self, what, str(value))
        elif what == "speed" and isinstance(value, int | float) and value == value:
            self.percent = min(max(float(value), 1.0), 100.0)

    def reset(self) -> None:
        """Let go of all keys."""
        self._pressed, self._driving, self._turning = frozenset(), {}, set()

    def take_over(self, other: Part) -> None:
        """Be switched on as the other one was."""
        if isinstance(other, Keyboard):
            self.is_on, self.percent = other.is_on, other.percent
            self.base = other.base if other.base in self.bases else self.base
            self.arm = other.arm if other.arm in self.arms else self.arm

    def section(self) -> Section:
        """Return its part of the panel."""
        widgets: list[Any] = [Toggle("keys:on", "keys drive", self.is_on)]
        lines = []
        if self.bases:
            lines.append("arrows: ahead, back, turn; shift: sideways")
            options = (*self.bases, _NOTHING)
            widgets.append(Choice("keys:base", "arrows move", options, self.base))
        if self.arms:
            lines.append("1 to 9: a joint forward; shift: back")
            options = (*self.arms, _NOTHING)
            widgets.append(Choice("keys:arm", "digits jog", options, self.arm))
        speed = Slider("keys:speed", "speed", 1.0, 100.0, self.percent, "%")
        text = Text("keys:help", "keys", "; ".join(lines))
        return Section("Keyboard", (*widgets, speed, text), is_open=False)

    def _is_driving(self) -> bool:
        """Return whether a key is down; what wasn't heard of for long isn't."""
        if not self._pressed - {SHIFT}:
            return False
        if time.perf_counter() - self._heard > _PATIENCE:
            self._pressed = frozenset()
            self._let_go()
            return False
        return True

    def _let_go(self) -> None:
        """Stop what would go on."""
        base, arm = self.bases.get(self.base), self.arms.get(self.arm)
        driving, turning = self._driving, self._turning
        self._driving, self._turning = {}, set()
        if base is not None and driving and base.is_active:
            base.stop()
        for part in turning if arm is not None and arm.is_active else ():
            assert arm is not None
            arm.handle(arm.id_of(part), 0.0)

    def _drive(self) -> None:
        """Send the base's velocity, if it is another one."""
        base = self.bases.get(self.base)
        if base is None:
            return
        velocity: dict[str, float] = {}
        for key in self._pressed & ARROWS.keys():
            name, sign = ARROWS[key]
            if name == "turn" and SHIFT in self._pressed:
                name = "sideways"
            limits = base.range_of(name)
            if limits is not None:
                largest = limits[1] if sign > 0.0 else -limits[0]
                step = sign * self.percent / 100.0 * largest
                velocity[name] = velocity.get(name, 0.0) + step
        if velocity != self._driving:
            self._driving = velocity
            base.drive(**{"forward": 0.0, **velocity})

    def _jog(self, passed: float) -> None:
        """Move joints for the time that has passed [s]."""
        arm = self.arms.get(self.arm)
        if arm is None:
            return
        sign = -1.0 if SHIFT in self._pressed else 1.0
        down = set()
        for key, (part, axis) in zip(DIGITS, arm.axes().items(), strict=False):
            if key not in self._pressed:
                continue
            share = sign * self.percent / 100.0
            if axis.interface != POSITION:
                down.add(part)
                end = axis.upper if sign > 0.0 else -axis.lower
                arm.handle(arm.id_of(part), share * end)
                continue
            target = arm.value_of(part) + share * axis.speed * passed
            arm.handle(arm.id_of(part), axis.show(target))
        for part in self._turning - down:
            arm.handle(arm.id_of(part), 0.0)
        self._turning = down


def make_keyboard(live: Live) -> Keyboard | None:
    """Return the section of a simulation; None where there is nothing to drive."""
    keyboard = Keyboard(live)
    return keyboard if keyboard.bases or keyboard.arms else None
